!> Names, reasons and times as the user of a result file sees them. What is done with files: tests/faults.
program test_disk
  use checks, only: check, finish
  use dst_disk, only: folder_of, place_of, true_path, with_remedy
  use dst_machine, only: utc_at
  use dst_kinds, only: int64
  implicit none

  call test_names()
  call test_reasons()
  call test_calendar()

  call finish()

contains

  subroutine test_names()
    call check('folder of a bare name', folder_of('x.h5') == '.')
    call check('folder of a relative name', folder_of('a/b/x.h5') == 'a/b')
    call check('folder at the root', folder_of('/x.h5') == '/')
    call check('a path that does not exist stays', true_path('no/such/x.h5') == 'no/such/x.h5')
    call check('a path through the parent', true_path('/usr/..') == '/')
    call check('a place that is not there yet', place_of('x.h5') == true_path('.')//'/x.h5')
    call check('a place through the parent', place_of('/usr/../usr/no.h5') == '/usr/no.h5')
  end subroutine test_names

  !> A known reason says what to do; an unknown one is passed on.
  subroutine test_reasons()
    call check('disk full', index(with_remedy('No space left on device'), 'free some space') > 0)
    call check('unknown', with_remedy('Input/output error') == 'Input/output error')
  end subroutine test_reasons

  !> Ends of days, months, Februaries and years; a time without a year of four digits is marked, whatever a damaged file says.
  subroutine test_calendar()
    integer(int64), parameter :: seconds(16) = [0_int64, 86399_int64, 951782399_int64, 951782400_int64, 1709251199_int64, &
      1709251200_int64, 1772323199_int64, 1772323200_int64, 1798761599_int64, 1798761600_int64, 2147483648_int64, &
      4107542400_int64, 253402300799_int64, 253402300800_int64, huge(0_int64), -huge(0_int64)]
    character(20), parameter :: moment(16) = [ &
      '1970-01-01T00:00:00Z', '1970-01-01T23:59:59Z', '2000-02-28T23:59:59Z', '2000-02-29T00:00:00Z', '2024-02-29T23:59:59Z', &
      '2024-03-01T00:00:00Z', '2026-02-28T23:59:59Z', '2026-03-01T00:00:00Z', '2026-12-31T23:59:59Z', '2027-01-01T00:00:00Z', &
      '2038-01-19T03:14:08Z', '2100-03-01T00:00:00Z', '9999-12-31T23:59:59Z', '****-**-**T**:**:**Z', '****-**-**T**:**:**Z', &
      '****-**-**T**:**:**Z']
    integer :: i

    do i = 1, size(seconds)
      call check(moment(i)//': '//utc_at(seconds(i)), utc_at(seconds(i)) == moment(i))
    end do
  end subroutine test_calendar
end program test_disk
