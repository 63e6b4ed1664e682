!> Child processes: for work that must be completed even if this process is killed, and for work that may crash or never end.
module dst_process
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t
  use dst_disk, only: close_descriptor, write_bytes
  use dst_posix, only: c_allow_seconds, c_await_child, c_begin_child, c_exit, c_read, end_child, is_child
  implicit none
  private

  public :: is_child, end_child, guard_t

  !> Work in a child process. Only an answer comes back from it: neither a crash nor an endless loop affects the parent. The child
  !> ends with `reply`; the parent waits for it in `await`.
  type :: guard_t
    logical :: in_child = .false.
    integer(c_int), private :: process = -1
    integer(c_int), private :: pipe = -1   !! the end that this process has
  contains
    procedure :: begin
    procedure :: show_life
    procedure :: reply
    procedure :: await
  end type guard_t

  !> Processor time that a child may use between two signs of life [s]. Waiting for a slow disk does not count.
  integer, parameter :: patience = 1
  character, parameter :: reply_mark = achar(0)

contains

  !> Divide into parent and child; `in_child` says which one this is. If a child cannot be created, `await` says so.
  subroutine begin(self)
    class(guard_t), intent(out) :: self

    self%process = c_begin_child(self%pipe)
    self%in_child = self%process == 0
    call self%show_life()
  end subroutine begin

  !> The child has made progress: it may use `patience` once more.
  subroutine show_life(self)
    class(guard_t), intent(in) :: self

    if (self%in_child) call c_allow_seconds(int(patience, c_int))
  end subroutine show_life

  !> End the child with an answer; '' means success. The child ends as programs do, so that coverage tools count its lines.
  subroutine reply(self, text)
    class(guard_t), intent(in) :: self
    character(*), intent(in) :: text
    character(:), allocatable :: ignored

    if (.not. self%in_child) return
    call write_bytes(self%pipe, reply_mark//text, ignored)
    call c_exit(0_c_int)
  end subroutine reply

  !> The child's answer; unallocated if it crashed or made no progress. If no child could be created, the answer says so.
  subroutine await(self, answer)
    class(guard_t), intent(inout) :: self
    character(:), allocatable, intent(out) :: answer
    character(4096) :: bytes
    character(:), allocatable :: text
    integer(c_int64_t) :: count
    integer :: mark

    if (self%process < 0) then
      answer = 'this needs a child process, and the system allows none: raise the limit of processes (ulimit -u)'
      return
    end if
    text = ''
    do
      count = c_read(self%pipe, bytes, len(bytes, c_int64_t), -1_c_int64_t)
      if (count <= 0) exit
      text = text//bytes(:count)
    end do
    call close_descriptor(self%pipe)
    mark = index(text, reply_mark, back=.true.)
    if (c_await_child(self%process) == 0 .and. mark > 0) answer = text(mark + 1:)
  end subroutine await
end module dst_process
