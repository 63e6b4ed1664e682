!> Calls of the operating system: the functions of posix.c, and those of the C library whose arguments are plain numbers and texts.
!> Texts end with NUL. This is the only module that uses the system's C names; the meaning of the calls for this program is
!> explained where they are used.
module dst_posix
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_size_t, c_double, c_bool, c_char, c_ptr, c_funptr, &
    c_associated, c_f_pointer, c_null_char
  implicit none
  public

  !> Constants of the system, with the system's names.
  integer(c_int), protected, bind(c) :: dst_o_rdonly, dst_o_rdwr, dst_o_creat, dst_o_excl, dst_o_nonblock, &
    dst_o_nofollow, dst_lock_ex, dst_lock_sh, dst_lock_nb, dst_eexist, dst_eloop, dst_enoent, &
    dst_ewouldblock, dst_sighup, dst_sigint, dst_sigterm, dst_sigusr1

  interface
    integer(c_int) function c_errno() bind(c, name='dst_errno')
      import :: c_int
    end function c_errno

    type(c_ptr) function c_reason() bind(c, name='dst_reason')
      import :: c_ptr
    end function c_reason

    subroutine c_free(address) bind(c, name='free')
      import :: c_ptr
      type(c_ptr), value :: address
    end subroutine c_free

    subroutine c_listen(signal) bind(c, name='dst_listen')
      import :: c_int
      integer(c_int), value :: signal
    end subroutine c_listen

    integer(c_int) function stop_signal() bind(c, name='dst_stop_signal')
      import :: c_int
    end function stop_signal

    subroutine ignore_size_limit_signal() bind(c, name='dst_ignore_size_limit_signal')
    end subroutine ignore_size_limit_signal

    integer(c_int) function c_open(path, flags) bind(c, name='dst_open')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: flags
    end function c_open

    integer(c_int) function c_fsync(descriptor) bind(c, name='dst_fsync')
      import :: c_int
      integer(c_int), value :: descriptor
    end function c_fsync

    integer(c_int) function c_close(descriptor) bind(c, name='dst_close')
      import :: c_int
      integer(c_int), value :: descriptor
    end function c_close

    integer(c_int) function c_flock(descriptor, operation) bind(c, name='flock')
      import :: c_int
      integer(c_int), value :: descriptor, operation
    end function c_flock

    integer(c_int) function c_rename(from, to) bind(c, name='rename')
      import :: c_int, c_char
      character(c_char), intent(in) :: from(*), to(*)
    end function c_rename

    subroutine c_keep_mode(path, descriptor) bind(c, name='dst_keep_mode')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: descriptor
    end subroutine c_keep_mode

    integer(c_int) function c_link(from, to) bind(c, name='link')
      import :: c_int, c_char
      character(c_char), intent(in) :: from(*), to(*)
    end function c_link

    integer(c_int) function c_unlink(path) bind(c, name='unlink')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
    end function c_unlink

    subroutine c_forget_matches(found) bind(c, name='dst_forget_matches')
      import :: c_ptr
      type(c_ptr), value :: found
    end subroutine c_forget_matches

    subroutine occupy_descriptors() bind(c, name='dst_occupy_descriptors')
    end subroutine occupy_descriptors

    integer(c_int) function c_is_terminal() bind(c, name='dst_is_terminal')
      import :: c_int
    end function c_is_terminal

    logical(c_bool) function has_v3() bind(c, name='dst_has_v3')
      import :: c_bool
    end function has_v3

    subroutine c_exit(status) bind(c, name='exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit

    subroutine c_join_thread(thread) bind(c, name='dst_join_thread')
      import :: c_ptr
      type(c_ptr), value :: thread
    end subroutine c_join_thread

    subroutine c_wait(seconds) bind(c, name='dst_wait')
      import :: c_double
      real(c_double), value :: seconds
    end subroutine c_wait

    integer(c_int64_t) function seconds_now() bind(c, name='dst_now')
      import :: c_int64_t
    end function seconds_now

    integer(c_int) function c_utc(seconds, text) bind(c, name='dst_utc')
      import :: c_int, c_int64_t, c_char
      integer(c_int64_t), value :: seconds
      character(c_char), intent(out) :: text(21)
    end function c_utc

    integer(c_int) function c_look_up(descriptor, path, facts) bind(c, name='dst_look_up')
      import :: c_int, c_int64_t, c_char
      integer(c_int), value :: descriptor
      character(c_char), intent(in) :: path(*)
      integer(c_int64_t), intent(out) :: facts(5)
    end function c_look_up

    integer(c_int) function c_write(descriptor, bytes, count, place) bind(c, name='dst_write')
      import :: c_int, c_int64_t, c_char
      integer(c_int), value :: descriptor
      character(c_char), intent(in) :: bytes(*)
      integer(c_int64_t), value :: count, place
    end function c_write

    integer(c_int64_t) function c_read(descriptor, bytes, count, place) bind(c, name='dst_read')
      import :: c_int, c_int64_t, c_char
      integer(c_int), value :: descriptor
      character(c_char), intent(inout) :: bytes(*)
      integer(c_int64_t), value :: count, place
    end function c_read

    subroutine set_file_size(descriptor, length) bind(c, name='dst_set_file_size')
      import :: c_int, c_int64_t
      integer(c_int), value :: descriptor
      integer(c_int64_t), value :: length
    end subroutine set_file_size

    real(c_double) function c_free_space(folder) bind(c, name='dst_free_space')
      import :: c_double, c_char
      character(c_char), intent(in) :: folder(*)
    end function c_free_space

    type(c_ptr) function c_realpath(path, resolved) bind(c, name='realpath')
      import :: c_ptr, c_char
      character(c_char), intent(in) :: path(*)
      type(c_ptr), value :: resolved
    end function c_realpath

    integer(c_int64_t) function c_matches(beginning, found, names) bind(c, name='dst_matches')
      import :: c_int64_t, c_char, c_ptr
      character(c_char), intent(in) :: beginning(*)
      type(c_ptr), intent(out) :: found, names
    end function c_matches

    integer(c_int) function c_gethostname(name, length) bind(c, name='gethostname')
      import :: c_int, c_char, c_size_t
      character(c_char), intent(out) :: name(*)
      integer(c_size_t), value :: length
    end function c_gethostname

    integer(c_int) function c_put_output(text, count) bind(c, name='dst_put_output')
      import :: c_int, c_int64_t, c_char
      character(c_char), intent(in) :: text(*)
      integer(c_int64_t), value :: count
    end function c_put_output

    subroutine c_put_error(text, count) bind(c, name='dst_put_error')
      import :: c_int64_t, c_char
      character(c_char), intent(in) :: text(*)
      integer(c_int64_t), value :: count
    end subroutine c_put_error

    subroutine c_become(words, count) bind(c, name='dst_become')
      import :: c_int, c_char
      character(c_char), intent(in) :: words(*)
      integer(c_int), value :: count
    end subroutine c_become

    type(c_ptr) function c_begin_thread(start, argument, stack_bytes) bind(c, name='dst_begin_thread')
      import :: c_ptr, c_funptr, c_int64_t
      type(c_funptr), value :: start
      type(c_ptr), value :: argument
      integer(c_int64_t), value :: stack_bytes
    end function c_begin_thread

    integer(c_int64_t) function c_stack_limit() bind(c, name='dst_stack_limit')
      import :: c_int64_t
    end function c_stack_limit

  end interface

contains

  !> A text from C; '' if there is none.
  function fortran_text(address) result(text)
    type(c_ptr), intent(in) :: address
    character(:), allocatable :: text
    character(c_char), pointer, contiguous :: bytes(:)
    integer :: n

    text = ''
    if (.not. c_associated(address)) return
    call c_f_pointer(address, bytes, [huge(n)])
    n = 0
    do while (bytes(n + 1) /= c_null_char)
      n = n + 1
    end do
    text = repeat(' ', n)
    text = transfer(bytes(:n), text)
  end function fortran_text
end module dst_posix
