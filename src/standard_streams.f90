!> Standard output and standard error, byte by byte: what could not be written is known, which Fortran's own output does not tell
!> of a full disk. POSIX.
module dst_standard_streams
  use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_size_t, c_char, c_ptr, c_funptr, c_loc, c_f_pointer, c_null_char, &
    c_null_funptr
  implicit none
  private

  public :: occupy_descriptors, put_output, put_error

  integer(c_int), parameter :: standard_output = 1, standard_error = 2
  ! Of Linux.
  integer(c_int), parameter :: interrupted = 4, try_again = 11, sigpipe = 13

  interface
    integer(c_intptr_t) function c_write(descriptor, bytes, count) bind(c, name='write')
      import :: c_int, c_intptr_t, c_ptr, c_size_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
    end function c_write

    integer(c_int) function c_open(path, flags) bind(c, name='open')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: flags
    end function c_open

    integer(c_int) function c_fcntl(descriptor, command) bind(c, name='fcntl')
      import :: c_int
      integer(c_int), value :: descriptor, command
    end function c_fcntl

    integer(c_int) function c_usleep(microseconds) bind(c, name='usleep')
      import :: c_int
      integer(c_int), value :: microseconds
    end function c_usleep

    type(c_ptr) function c_error_number() bind(c, name='__errno_location')
      import :: c_ptr
    end function c_error_number

    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
  end interface

contains

  !> Occupy those of the descriptors 0 to 2 that were closed when the program began, so that no file gets one of them. They are
  !> opened the wrong way round: writing to a closed standard output still fails.
  subroutine occupy_descriptors()
    integer(c_int), parameter :: get_flags = 1, read_only = 0, write_only = 1
    integer(c_int) :: descriptor, ignored

    do descriptor = 0, standard_error
      if (c_fcntl(descriptor, get_flags) >= 0) cycle
      ! The lowest free one is given.
      ignored = c_open('/dev/null'//c_null_char, merge(write_only, read_only, descriptor == 0))
    end do
  end subroutine occupy_descriptors

  !> Write to standard output; `failed` if not all of it arrived. A reader that has gone ends the program by SIGPIPE, unless that
  !> is ignored.
  subroutine put_output(text, failed)
    character(*), intent(in) :: text
    logical, intent(out) :: failed

    call put(standard_output, text, failed)
  end subroutine put_output

  !> Write to standard error. Nobody is left to be told if that fails, and nothing is lost by it: a run goes on.
  subroutine put_error(text)
    character(*), intent(in) :: text
    type(c_funptr) :: previous, ignored
    logical :: failed

    previous = c_signal(sigpipe, ignore_signal())
    call put(standard_error, text, failed)
    ignored = c_signal(sigpipe, previous)
  end subroutine put_error

  !> SIG_IGN.
  pure type(c_funptr) function ignore_signal()
    ignore_signal = transfer(1_c_intptr_t, c_null_funptr)
  end function ignore_signal

  subroutine put(descriptor, text, failed)
    integer(c_int), intent(in) :: descriptor
    character(*), intent(in) :: text
    logical, intent(out) :: failed
    character(c_char), allocatable, target :: bytes(:)
    integer(c_int), pointer :: error_number
    integer(c_intptr_t) :: count
    integer(c_int) :: ignored
    integer :: i, written

    allocate (bytes(len(text)))
    do i = 1, len(text)
      bytes(i) = text(i:i)
    end do
    written = 0
    failed = .false.
    do while (written < len(text) .and. .not. failed)
      count = c_write(descriptor, c_loc(bytes(written + 1)), int(len(text) - written, c_size_t))
      if (count >= 0) then
        written = written + int(count)
        cycle
      end if
      call c_f_pointer(c_error_number(), error_number)
      select case (error_number)
      case (interrupted)
      case (try_again)
        ! Somebody has made the descriptor non-blocking.
        ignored = c_usleep(1000_c_int)
      case default
        failed = .true.
      end select
    end do
  end subroutine put
end module dst_standard_streams
