!> Standard output and standard error, byte by byte: what could not be written is known, which Fortran's own output does not tell
!> of a full disk.
module dst_standard_streams
  use, intrinsic :: iso_c_binding, only: c_int64_t
  use dst_posix, only: c_put_error, c_put_output, occupy_descriptors
  implicit none
  private

  public :: occupy_descriptors, put_output, put_error

contains

  !> Write to standard output; `failed` if not all of it arrived. A reader that has gone ends the program by SIGPIPE, unless that
  !> is ignored.
  subroutine put_output(text, failed)
    character(*), intent(in) :: text
    logical, intent(out) :: failed

    failed = c_put_output(text, len(text, c_int64_t)) /= 0
  end subroutine put_output

  !> Write to standard error. Nobody is left to be told if that fails, and nothing is lost by it: a run goes on.
  subroutine put_error(text)
    character(*), intent(in) :: text

    call c_put_error(text, len(text, c_int64_t))
  end subroutine put_error
end module dst_standard_streams
