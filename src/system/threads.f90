!> Threads with stacks of a known size, as many as the system allows.
!>
!> The threads of OpenMP have stacks of OMP_STACKSIZE or `ulimit -s`; a stack overflow is a segmentation fault, and one thread too
!> many for the system ends the program. OpenMP's locks and atomic operations also work between the threads of this module.
!>
!> Where memory is limited (`ulimit -v`, a job's share), so are the threads: what their stacks took, their work would lack.
module dst_threads
  use, intrinsic :: iso_c_binding, only: c_int8_t, c_int64_t, c_ptr, c_loc, c_funloc, c_associated, c_f_pointer, c_null_ptr
  use dst_posix, only: c_begin_thread, c_join_thread, c_stack_limit
  implicit none
  private

  public :: task_t, run_in_threads, run_with_room

  !> A task that threads do together.
  type, abstract :: task_t
  contains
    procedure(work), deferred :: work
  end type task_t

  abstract interface
    !> The part of thread `number`, counted from 1, which is the calling thread.
    subroutine work(self, number)
      import :: task_t
      class(task_t), intent(inout), target :: self
      integer, intent(in) :: number
    end subroutine work
  end interface

  type :: member_t
    class(task_t), pointer :: task => null()
    integer :: number = 0
    type(c_ptr) :: thread = c_null_ptr   !! null if it has not started
  end type member_t

  !> Bytes of a stack: the default of Linux for a program, and the size that suffices.
  integer(c_int64_t), parameter :: stack_bytes = 8*1024**2, least_stack_bytes = 1024**2

  !> Bytes that the work of a thread may need besides (an arena of malloc holds 64 MB, for two threads or more), and that of all.
  integer(c_int64_t), parameter :: work_bytes = 32*1024**2, common_bytes = 64*1024**2

contains

  !> Do a task with this thread and up to `wanted - 1` others, as many as the system allows, and wait for all.
  subroutine run_in_threads(task, wanted)
    class(task_t), intent(inout), target :: task
    integer, intent(in) :: wanted
    type(member_t), allocatable, target :: members(:)
    integer :: i

    allocate (members(2:threads_with_room(wanted)))
    do i = 2, ubound(members, 1)
      call begin(task, i, members(i))
      if (.not. c_associated(members(i)%thread)) exit
    end do
    call task%work(1)
    do i = 2, ubound(members, 1)
      call await(members(i))
    end do
  end subroutine run_in_threads

  !> How many of so many threads have room for their stacks and their work. Asked before the first begins: later the question would
  !> itself take room, if only for a moment. Memory that is not touched is not used.
  integer function threads_with_room(wanted)
    integer, intent(in) :: wanted
    integer(c_int8_t), allocatable, volatile :: room(:)   ! volatile: a compiler may leave out what is never read
    integer :: status

    threads_with_room = max(1, wanted)
    do while (threads_with_room > 1)
      allocate (room(common_bytes + (threads_with_room - 1)*(stack_bytes + work_bytes)), stat=status)
      if (status == 0) exit
      threads_with_room = threads_with_room - max(1, threads_with_room/8)
    end do
  end function threads_with_room

  !> Do a task where the stack is large enough: in this thread, or, if its stack is limited to less, in another one. `done` is false
  !> if no other thread can be created and the stack of this one is too small.
  subroutine run_with_room(task, done)
    class(task_t), intent(inout), target :: task
    logical, intent(out) :: done
    type(member_t), target :: member
    integer(c_int64_t) :: room

    room = c_stack_limit()
    if (room < stack_bytes) call begin(task, 1, member)
    done = c_associated(member%thread) .or. room >= least_stack_bytes
    if (c_associated(member%thread)) then
      call await(member)
    else if (done) then
      call task%work(1)
    end if
  end subroutine run_with_room

  subroutine begin(task, number, member)
    class(task_t), intent(inout), target :: task
    integer, intent(in) :: number
    type(member_t), intent(inout), target :: member

    member%task => task
    member%number = number
    member%thread = c_begin_thread(c_funloc(follow), c_loc(member), stack_bytes)
  end subroutine begin

  subroutine await(member)
    type(member_t), intent(in) :: member

    if (c_associated(member%thread)) call c_join_thread(member%thread)
  end subroutine await

  !> The procedure in which a thread begins.
  type(c_ptr) function follow(argument) bind(c)
    type(c_ptr), value :: argument
    type(member_t), pointer :: member

    call c_f_pointer(argument, member)
    call member%task%work(member%number)
    follow = c_null_ptr
  end function follow
end module dst_threads
