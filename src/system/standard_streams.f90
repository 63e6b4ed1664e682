!> Standard output and standard error, byte by byte: failures to write are detected, which Fortran's own output does not report if a
!> disk is full.
module dst_standard_streams
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t
  use dst_posix, only: c_put_error, c_write, occupy_descriptors
  implicit none
  private

  public :: occupy_descriptors, put_output, put_error

contains

  !> Write to standard output; `failed` if some of it was not written. If the reader has ended, SIGPIPE ends the program, unless the
  !> signal is ignored.
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
end module dst_standard_streams
