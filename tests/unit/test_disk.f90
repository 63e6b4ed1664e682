!> Names, reasons and times as the user of a result file sees them.
program test_disk
  use checks, only: check, finish
  use, intrinsic :: iso_c_binding, only: c_int, c_char
  use dst_disk, only: identity_t, identity_of, operator(==), create_file, write_bytes, read_at, close_descriptor, &
    set_file_size, move_file, place_file, delete_file, delete_own_file, file_exists, is_folder, folder_of, &
    place_of, true_path, with_remedy, utc_at
  use dst_kinds, only: int64
  implicit none

  character(*), parameter :: first = 'test_disk_first', second = 'test_disk_second'

  call test_names()
  call test_files()
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

  subroutine test_files()
    type(identity_t) :: one, two
    character(:), allocatable :: reason
    character(c_char) :: bytes(3)
    integer(c_int) :: descriptor, other
    logical :: moved, complete

    call delete_file(first)
    call delete_file(second)
    call check('no file', .not. exists(first))
    call create_file(first, descriptor, reason)
    call check('a new file', file_exists(first) .and. .not. allocated(reason))
    one = identity_of(descriptor)
    call check('one file by name and descriptor', one == identity_of(first))
    call check('a regular file', one%is_regular)
    call create_file(first, other, reason)
    call check('a name that is taken', allocated(reason) .and. other < 0)
    call write_bytes(descriptor, 'abc', reason, 2_int64)
    call write_bytes(descriptor, 'xy', reason, 0_int64)
    call read_at(descriptor, 1_int64, bytes, complete)
    call check('bytes at a place', complete .and. all(bytes == ['y', 'a', 'b']))
    call read_at(descriptor, 3_int64, bytes, complete)
    call check('bytes beyond the end', .not. complete)
    call set_file_size(descriptor, 2_int64)
    two = identity_of(descriptor)
    call check('cut', two%bytes == 2)
    call close_descriptor(descriptor, reason)
    call check('closed', .not. allocated(reason) .and. descriptor == -1)

    call check('a file is not a folder', .not. is_folder(first))
    call check('a folder is a folder', is_folder('.'))
    two = identity_of('.')
    call check('a folder is no regular file', two%exists .and. .not. two%is_regular)
    call create_file(second, descriptor, reason)
    call close_descriptor(descriptor)
    call place_file(first, second, moved)
    call check('a name that is taken is kept', exists(first) .and. .not. moved)
    call delete_own_file(second, one)
    call check('another file is not removed', exists(second))
    call move_file(first, second, moved)
    call check('moved', identity_of(second) == one .and. moved)
    call check('from there', .not. exists(first))
    call move_file(first, second, moved)
    call check('nothing to move', .not. moved)
    call delete_own_file(second, one)
    call check('deleted', .not. exists(second))
    call create_file('no/such/folder/x', descriptor, reason)
    call check('no such folder', allocated(reason))
  end subroutine test_files

  logical function exists(file_name)
    character(*), intent(in) :: file_name
    type(identity_t) :: identity

    identity = identity_of(file_name)
    exists = identity%exists
  end function exists

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
