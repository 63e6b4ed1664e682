!> Standard output and standard error, byte by byte: what could not be written is known, which Fortran's own output does not tell
!> of a full disk. POSIX.
module dst_standard_streams
  use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_char, c_funptr, c_null_char, c_null_funptr
  use dst_disk, only: write_bytes
  implicit none
  private

  public :: occupy_descriptors, put_output, put_error

  integer(c_int), parameter :: standard_output = 1, standard_error = 2
  integer(c_int), parameter :: sigpipe = 13   ! of Linux

  interface
    integer(c_int) function c_open(path, flags) bind(c, name='open')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: flags
    end function c_open

    integer(c_int) function c_fcntl(descriptor, command) bind(c, name='fcntl')
      import :: c_int
      integer(c_int), value :: descriptor, command
    end function c_fcntl

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
    character(:), allocatable :: reason

    call write_bytes(descriptor, text, reason)
    failed = allocated(reason)
  end subroutine put
end module dst_standard_streams
