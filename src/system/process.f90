!> Child processes: what must be done as a whole even if this process is killed, and what may crash or never end.
!>
!> POSIX, and Linux's numbers.
module dst_process
  use, intrinsic :: iso_c_binding, only: c_int, c_long, c_intptr_t, c_size_t, c_ptr, c_funptr, c_char, c_null_char, c_null_ptr, &
    c_null_funptr, c_loc
  use dst_disk, only: write_bytes, system_error
  implicit none
  private

  public :: is_child, end_child, guard_t

  !> Work in a child process, out of which nothing comes but an answer: neither a crash nor an endless loop reaches the parent.
  !> The child ends with `reply`; the parent waits for it in `await`.
  type :: guard_t
    logical :: in_child = .false.
    integer(c_int), private :: process = -1
    integer(c_int), private :: ends(2) = -1   !! of a pipe: to read, to write
  contains
    procedure :: begin
    procedure :: show_life
    procedure :: reply
    procedure :: await
  end type guard_t

  !> Processor time that a child may spend between two signs of life [s]. Waiting for a slow disk does not count.
  integer(c_long), parameter :: patience = 1
  character, parameter :: reply_mark = c_null_char
  integer(c_int), parameter :: interrupted = 4

  interface
    integer(c_int) function c_fork() bind(c, name='fork')
      import :: c_int
    end function c_fork

    integer(c_int) function c_getpid() bind(c, name='getpid')
      import :: c_int
    end function c_getpid

    integer(c_int) function c_getppid() bind(c, name='getppid')
      import :: c_int
    end function c_getppid

    integer(c_int) function c_setsid() bind(c, name='setsid')
      import :: c_int
    end function c_setsid

    integer(c_int) function c_prctl(option, argument) bind(c, name='prctl')
      import :: c_int, c_long
      integer(c_int), value :: option
      integer(c_long), value :: argument
    end function c_prctl

    integer(c_int) function c_waitpid(process, status, options) bind(c, name='waitpid')
      import :: c_int
      integer(c_int), value :: process, options
      integer(c_int), intent(out) :: status
    end function c_waitpid

    subroutine c_exit(status) bind(c, name='exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit

    subroutine c_exit_at_once(status) bind(c, name='_exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit_at_once

    integer(c_int) function c_pipe(ends) bind(c, name='pipe')
      import :: c_int
      integer(c_int), intent(out) :: ends(2)
    end function c_pipe

    integer(c_int) function c_dup2(from, to) bind(c, name='dup2')
      import :: c_int
      integer(c_int), value :: from, to
    end function c_dup2

    integer(c_intptr_t) function c_read(descriptor, bytes, count) bind(c, name='read')
      import :: c_int, c_intptr_t, c_ptr, c_size_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
    end function c_read

    integer(c_int) function c_close(descriptor) bind(c, name='close')
      import :: c_int
      integer(c_int), value :: descriptor
    end function c_close

    integer(c_int) function c_setitimer(which, timer, before) bind(c, name='setitimer')
      import :: c_int, c_long, c_ptr
      integer(c_int), value :: which
      integer(c_long), intent(in) :: timer(4)   !! interval and value, in seconds and microseconds
      type(c_ptr), value :: before
    end function c_setitimer

    integer(c_int) function c_setrlimit(resource, limits) bind(c, name='setrlimit')
      import :: c_int, c_long
      integer(c_int), value :: resource
      integer(c_long), intent(in) :: limits(2)
    end function c_setrlimit

    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
  end interface

contains

  !> Whether this is a child process, a copy of the one that asked. The latter goes on, with `.false.`, when the child
  !> has called `end_child`. The child is out of reach of a signal to the parent or its group, so what it does to files
  !> is done as a whole even if the parent is killed; if that has happened already, it does nothing. Without a child the
  !> parent goes on at once.
  logical function is_child()
    integer(c_int) :: parent, process, ignored

    parent = c_getpid()
    process = c_fork()
    is_child = process == 0
    if (is_child) then
      ignored = c_setsid()
      if (c_getppid() /= parent) call end_child()
    else if (process > 0) then
      ignored = status_of(process)
    end if
  end function is_child

  !> End a child process at once, without its parent's clearing up.
  subroutine end_child()
    call c_exit_at_once(0_c_int)
  end subroutine end_child

  !> Divide into parent and child; `in_child` tells which. If there can be no child, `await` says so.
  subroutine begin(self)
    class(guard_t), intent(out) :: self
    integer(c_int) :: ignored

    if (c_pipe(self%ends) /= 0) return
    self%process = c_fork()
    self%in_child = self%process == 0
    if (self%in_child) then
      ignored = c_close(self%ends(1))
      call prepare_for_the_worst(self%ends(2))
      call self%show_life()
    else
      ignored = c_close(self%ends(2))
      if (self%process < 0) ignored = c_close(self%ends(1))
    end if
  end subroutine begin

  !> A crash shall end the child without words or core dump; what libraries say goes where nobody reads it; the child does not
  !> outlive its parent.
  subroutine prepare_for_the_worst(answer_end)
    integer(c_int), intent(in) :: answer_end
    integer(c_int), parameter :: crashes(6) = [4, 6, 7, 8, 11, 27]   ! SIGILL, SIGABRT, SIGBUS, SIGFPE, SIGSEGV, SIGPROF
    integer(c_int), parameter :: standard_error = 2, core_size = 4, signal_at_parents_death = 1
    integer(c_long), parameter :: none(2) = 0, sigkill = 9
    type(c_funptr) :: previous
    integer(c_int) :: ignored
    integer :: i

    do i = 1, size(crashes)
      previous = c_signal(crashes(i), c_null_funptr)
    end do
    ignored = c_setrlimit(core_size, none)
    ignored = c_dup2(answer_end, standard_error)
    ignored = c_prctl(signal_at_parents_death, sigkill)
  end subroutine prepare_for_the_worst

  !> The child is getting on: it may spend `patience` once more.
  subroutine show_life(self)
    class(guard_t), intent(in) :: self
    integer(c_int), parameter :: processor_time = 2
    integer(c_int) :: ignored

    if (self%in_child) ignored = c_setitimer(processor_time, [0_c_long, 0_c_long, patience, 0_c_long], c_null_ptr)
  end subroutine show_life

  !> End the child with an answer; '' means that all is well. It ends as programs do, so that tools that count lines see it.
  subroutine reply(self, text)
    class(guard_t), intent(in) :: self
    character(*), intent(in) :: text
    character(:), allocatable :: ignored

    if (.not. self%in_child) return
    call write_bytes(self%ends(2), reply_mark//text, ignored)
    call c_exit(0_c_int)
  end subroutine reply

  !> The child's answer; unallocated if it crashed or did not get on. That there could be no child is an answer too.
  subroutine await(self, answer)
    class(guard_t), intent(inout) :: self
    character(:), allocatable, intent(out) :: answer
    character(c_char), target :: bytes(4096)
    character(:), allocatable :: text
    integer(c_intptr_t) :: count
    integer(c_int) :: status
    integer :: mark, i

    if (self%process < 0) then
      answer = 'this needs a child process, and the system allows none: raise the limit of processes (ulimit -u)'
      return
    end if
    text = ''
    do
      count = c_read(self%ends(1), c_loc(bytes), size(bytes, kind=c_size_t))
      if (count < 0) then
        if (system_error() == interrupted) cycle
      end if
      if (count <= 0) exit
      do i = 1, int(count)
        text = text//bytes(i)
      end do
    end do
    status = c_close(self%ends(1))
    status = status_of(self%process)
    mark = index(text, reply_mark, back=.true.)
    if (mark > 0 .and. status == 0) answer = text(mark + 1:)
  end subroutine await

  !> Wait for the end of a child.
  integer(c_int) function status_of(process) result(status)
    integer(c_int), intent(in) :: process

    do while (c_waitpid(process, status, 0_c_int) < 0)
      status = -1
      if (system_error() /= interrupted) return
    end do
  end function status_of
end module dst_process
