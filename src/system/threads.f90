!> Threads with stacks of a known size, as many as the system gives. POSIX.
!>
!> The threads of OpenMP have the stacks of OMP_STACKSIZE or `ulimit -s`, whose end is a segmentation fault, and one thread too many
!> for the system ends the program. OpenMP's locks and atomic operations hold between these threads too.
module dst_threads
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_long, c_ptr, c_funptr, c_size_t, c_loc, c_funloc, &
    c_f_pointer, c_null_ptr
  implicit none
  private

  public :: task_t, run_in_threads, run_with_room, allowed_cores, most_cores

  !> What threads do together.
  type, abstract :: task_t
  contains
    procedure(work), deferred :: work
  end type task_t

  abstract interface
    !> The part of thread `number`, counted from 1, which is the calling thread.
    subroutine work(self, number)
      import :: task_t
      class(task_t), intent(inout) :: self
      integer, intent(in) :: number
    end subroutine work
  end interface

  type :: member_t
    class(task_t), pointer :: task => null()
    integer :: number = 0
    logical :: begun = .false.
    integer(c_long) :: thread = 0
  end type member_t

  !> Bytes of a stack: what Linux gives a program unasked, and what suffices.
  integer(c_size_t), parameter :: stack_bytes = 8_c_size_t*1024_c_size_t**2, least_stack_bytes = 1024_c_size_t**2
  !> That a machine can have here.
  integer, parameter :: most_cores = 1024
  !> pthread_attr_t is shorter everywhere.
  integer, parameter :: attribute_words = 16

  interface
    integer(c_int) function pthread_attr_init(attributes) bind(c)
      import :: c_int, c_int64_t, attribute_words
      integer(c_int64_t), intent(inout) :: attributes(attribute_words)
    end function pthread_attr_init

    integer(c_int) function pthread_attr_setstacksize(attributes, bytes) bind(c)
      import :: c_int, c_int64_t, c_size_t, attribute_words
      integer(c_int64_t), intent(inout) :: attributes(attribute_words)
      integer(c_size_t), value :: bytes
    end function pthread_attr_setstacksize

    integer(c_int) function pthread_create(thread, attributes, start, argument) bind(c)
      import :: c_int, c_int64_t, c_long, c_ptr, c_funptr, attribute_words
      integer(c_long), intent(out) :: thread
      integer(c_int64_t), intent(in) :: attributes(attribute_words)
      type(c_funptr), value :: start
      type(c_ptr), value :: argument
    end function pthread_create

    integer(c_int) function pthread_join(thread, value) bind(c)
      import :: c_int, c_long, c_ptr
      integer(c_long), value :: thread
      type(c_ptr), value :: value
    end function pthread_join

    integer(c_int) function c_sched_getaffinity(process, bytes, mask) bind(c, name='sched_getaffinity')
      import :: c_int, c_int64_t, c_size_t
      integer(c_int), value :: process
      integer(c_size_t), value :: bytes
      integer(c_int64_t), intent(out) :: mask(*)
    end function c_sched_getaffinity

    integer(c_int) function c_getrlimit(resource, limits) bind(c, name='getrlimit')
      import :: c_int, c_long
      integer(c_int), value :: resource
      integer(c_long), intent(out) :: limits(2)
    end function c_getrlimit
  end interface

contains

  !> Do a task with this thread and up to `wanted - 1` others, as many as the system gives, and wait for all.
  subroutine run_in_threads(task, wanted)
    class(task_t), intent(inout), target :: task
    integer, intent(in) :: wanted
    type(member_t), allocatable, target :: members(:)
    integer :: i

    allocate (members(2:max(1, wanted)))
    do i = 2, wanted
      call begin(task, i, members(i))
      if (.not. members(i)%begun) exit
    end do
    call task%work(1)
    do i = 2, wanted
      call await(members(i))
    end do
  end subroutine run_in_threads

  !> Do a task where there is room on the stack: in this thread, or, if its stack is limited to less, in another. `done` is false
  !> if there can be no other and the room here would not do.
  subroutine run_with_room(task, done)
    class(task_t), intent(inout), target :: task
    logical, intent(out) :: done
    integer(c_int), parameter :: stack = 3
    integer(c_long), parameter :: no_limit = -1
    type(member_t), target :: member
    integer(c_long) :: limits(2)

    if (c_getrlimit(stack, limits) /= 0) limits(1) = no_limit
    if (limits(1) /= no_limit .and. limits(1) < stack_bytes) call begin(task, 1, member)
    done = member%begun .or. limits(1) == no_limit .or. limits(1) >= least_stack_bytes
    if (member%begun) then
      call await(member)
    else if (done) then
      call task%work(1)
    end if
  end subroutine run_with_room

  subroutine begin(task, number, member)
    class(task_t), intent(inout), target :: task
    integer, intent(in) :: number
    type(member_t), intent(inout), target :: member
    integer(c_int64_t) :: attributes(attribute_words)

    member%task => task
    member%number = number
    attributes = 0
    if (pthread_attr_init(attributes) /= 0) return
    if (pthread_attr_setstacksize(attributes, stack_bytes) /= 0) return
    member%begun = pthread_create(member%thread, attributes, c_funloc(follow), c_loc(member)) == 0
  end subroutine begin

  subroutine await(member)
    type(member_t), intent(in) :: member
    integer(c_int) :: ignored

    if (member%begun) ignored = pthread_join(member%thread, c_null_ptr)
  end subroutine await

  !> The cores of the machine that this process may use, by number.
  function allowed_cores() result(allowed)
    logical :: allowed(0:most_cores - 1)
    integer, parameter :: bits = bit_size(0_c_int64_t)
    integer(c_int64_t) :: mask(0:most_cores/bits - 1)
    integer(c_int) :: ignored
    integer :: i, bit

    mask = 0
    ignored = c_sched_getaffinity(0_c_int, int(most_cores/8, c_size_t), mask)
    do i = 0, size(mask) - 1
      do bit = 0, bits - 1
        allowed(bits*i + bit) = btest(mask(i), bit)
      end do
    end do
  end function allowed_cores

  !> Where a thread begins.
  type(c_ptr) function follow(argument) bind(c)
    type(c_ptr), value :: argument
    type(member_t), pointer :: member

    call c_f_pointer(argument, member)
    call member%task%work(member%number)
    follow = c_null_ptr
  end function follow
end module dst_threads
