!> Calls of the operating system: the functions of posix.c, and those of the C library whose arguments are plain numbers and texts.
!> Texts end with NUL. This is the only module that uses the system's C names; the meaning of the calls for this program is
!> explained where they are used. A handler of signals sets a variable in posix.c, which the executable reads; nothing that Python
!> uses does.
module dst_posix
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_size_t, c_double, c_bool, c_char, c_ptr, c_funptr, &
    c_associated, c_f_pointer, c_null_char
  implicit none
  public

  !> No signal has arrived: `stop_signal`.
  integer, parameter :: no_signal = 0

  !> Identity of a file, whatever its name is.
  type, bind(c) :: identity_t
    logical(c_bool) :: exists = .false.
    logical(c_bool) :: is_regular = .false.   !! neither a folder, a link, a device nor a pipe
    integer(c_int64_t) :: bytes = 0, inode = 0, device = 0
  end type identity_t

  !> Forms of calls that several have.
  abstract interface
    subroutine plain_call() bind(c)
    end subroutine plain_call

    integer(c_int) function number_call() bind(c)
      import :: c_int
    end function number_call

    logical(c_bool) function question() bind(c)
      import :: c_bool
    end function question

    subroutine address_call(address) bind(c)
      import :: c_ptr
      type(c_ptr), value :: address
    end subroutine address_call

    integer(c_int) function descriptor_call(descriptor) bind(c)
      import :: c_int
      integer(c_int), value :: descriptor
    end function descriptor_call

    integer(c_int) function naming_call(from, to) bind(c)
      import :: c_int, c_char
      character(c_char), intent(in) :: from(*), to(*)
    end function naming_call
  end interface

  procedure(plain_call), bind(c, name='dst_listen_to_requests') :: listen_to_requests
  procedure(plain_call), bind(c, name='dst_listen_to_signals') :: listen_to_signals
  procedure(plain_call), bind(c, name='dst_occupy_descriptors') :: occupy_descriptors
  procedure(number_call), bind(c, name='dst_stop_signal') :: stop_signal
  procedure(number_call), bind(c, name='dst_is_terminal') :: c_is_terminal
  procedure(question), bind(c, name='dst_is_told_to_end') :: is_told_to_end
  procedure(address_call), bind(c, name='free') :: c_free
  procedure(address_call), bind(c, name='dst_forget_matches') :: c_forget_matches
  procedure(descriptor_call), bind(c, name='dst_fsync') :: c_fsync
  procedure(descriptor_call), bind(c, name='dst_close') :: c_close
  procedure(naming_call), bind(c, name='rename') :: c_rename
  procedure(naming_call), bind(c, name='dst_place') :: c_place

  !> Whether two names, or two moments, refer to one file.
  interface operator(==)
    pure logical(c_bool) function is_same_file(a, b) bind(c, name='dst_is_same')
      import :: c_bool, identity_t
      type(identity_t), intent(in) :: a, b
    end function is_same_file
  end interface operator(==)

  ! gfortran 12 passes a number after a text by reference to a procedure that is declared by such a form.
  interface
    subroutine c_keep_mode(path, descriptor) bind(c, name='dst_keep_mode')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: descriptor
    end subroutine c_keep_mode

    subroutine c_remove_own(path, descriptor) bind(c, name='dst_remove_own')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: descriptor
    end subroutine c_remove_own

    type(c_ptr) function c_reason() bind(c, name='dst_reason')
      import :: c_ptr
    end function c_reason

    type(c_ptr) function c_signal_name(number) bind(c, name='dst_signal_name')
      import :: c_int, c_ptr
      integer(c_int), value :: number
    end function c_signal_name

    integer(c_int) function c_open_regular(path, writes) bind(c, name='dst_open_regular')
      import :: c_bool, c_int, c_char
      character(c_char), intent(in) :: path(*)
      logical(c_bool), value :: writes
    end function c_open_regular

    integer(c_int) function c_open_locked(path) bind(c, name='dst_open_locked')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
    end function c_open_locked

    logical(c_bool) function c_is_locked(path) bind(c, name='dst_is_locked')
      import :: c_bool, c_char
      character(c_char), intent(in) :: path(*)
    end function c_is_locked

    subroutine c_sync_folder(path) bind(c, name='dst_sync_folder')
      import :: c_char
      character(c_char), intent(in) :: path(*)
    end subroutine c_sync_folder

    subroutine c_exit(status) bind(c, name='exit')
      import :: c_int
      integer(c_int), value :: status
    end subroutine c_exit

    subroutine wait_seconds(seconds) bind(c, name='dst_wait')
      import :: c_double
      real(c_double), value :: seconds
    end subroutine wait_seconds

    subroutine c_utc(text) bind(c, name='dst_utc')
      import :: c_char
      character(c_char), intent(out) :: text(21)
    end subroutine c_utc

    subroutine c_look_up(descriptor, path, found) bind(c, name='dst_look_up')
      import :: c_int, c_char, identity_t
      integer(c_int), value :: descriptor
      character(c_char), intent(in) :: path(*)
      type(identity_t), intent(out) :: found
    end subroutine c_look_up

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

    real(c_double) function free_space(folder) bind(c, name='dst_free_space')
      import :: c_double, c_char
      character(c_char), intent(in) :: folder(*)
    end function free_space

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

    subroutine run_in_threads(work, task, wanted) bind(c, name='dst_run_in_threads')
      import :: c_int, c_ptr, c_funptr
      type(c_funptr), value :: work   !! (address of the task, number of the thread)
      type(c_ptr), value :: task
      integer(c_int), value :: wanted
    end subroutine run_in_threads

    logical(c_bool) function run_with_room(work) bind(c, name='dst_run_with_room')
      import :: c_bool, c_funptr
      type(c_funptr), value :: work
    end function run_with_room
  end interface

contains

  !> 'stopped by SIGTERM': by the signal that has arrived.
  function stopped_by() result(text)
    character(:), allocatable :: text

    text = 'stopped by '//fortran_text(c_signal_name(stop_signal()))
  end function stopped_by

  !> Write to standard output; `failed` if some of it was not written, which Fortran's own output does not report if a disk is full.
  !> If the reader has ended, SIGPIPE ends the program, unless the signal is ignored.
  subroutine put_output(text, failed)
    character(*), intent(in) :: text
    logical, intent(out) :: failed

    failed = c_write(1_c_int, text, len(text, c_int64_t), -1_c_int64_t) /= 0
  end subroutine put_output

  !> Write to standard error. If this fails, there is nowhere to report it, and nothing is lost: a run continues.
  subroutine put_error(text)
    character(*), intent(in) :: text

    call c_put_error(text, len(text, c_int64_t))
  end subroutine put_error

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
