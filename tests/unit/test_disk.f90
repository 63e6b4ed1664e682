!> Names, reasons and moments as the result file's user meets them.
program test_disk
  use checks, only: check, finish
  use dst_disk, only: prepare_file, move_file, delete_file, file_exists, is_folder, folder_of, true_path, scratch_name, &
    with_remedy, utc_now, utc_of
  implicit none

  character(*), parameter :: first = 'test_disk_first', second = 'test_disk_second'

  call test_names()
  call test_files()
  call test_reasons()
  call test_moment()
  call test_calendar()

  call finish()

contains

  subroutine test_names()
    call check('folder of a bare name', folder_of('x.h5') == '.')
    call check('folder of a relative name', folder_of('a/b/x.h5') == 'a/b')
    call check('folder at the root', folder_of('/x.h5') == '/')
    call check('a path that does not exist stays', true_path('no/such/x.h5') == 'no/such/x.h5')
    call check('a path through the parent', true_path('/usr/..') == '/')
    call check('a scratch name stands beside the file', index(scratch_name('a/x.h5'), 'a/x.h5.') == 1)
  end subroutine test_names

  subroutine test_files()
    character(:), allocatable :: reason
    logical :: moved

    call delete_file(first)
    call delete_file(second)
    call prepare_file(first, reason)
    call check('a new file', .not. allocated(reason))
    call check('the new file is there', file_exists(first))
    call prepare_file(first, reason)
    call check('a file that is there', .not. allocated(reason))
    call check('a file is not a folder', .not. is_folder(first))
    call check('a folder is a folder', is_folder('.'))
    call move_file(first, second, moved)
    call check('moved', moved)
    call check('there after moving', file_exists(second))
    call check('gone after moving', .not. file_exists(first))
    call move_file(first, second, moved)
    call check('nothing to move', .not. moved)
    call delete_file(second)
    call check('deleted', .not. file_exists(second))
    call prepare_file('no/such/folder/x', reason)
    call check('no such folder', allocated(reason))
  end subroutine test_files

  !> A reason that is known says what to do; an unknown one is passed on.
  subroutine test_reasons()
    call check('disk full', index(with_remedy('No space left on device'), 'free some space') > 0)
    call check('quota', index(with_remedy('Disk quota exceeded'), 'quota') > 0)
    call check('limit', index(with_remedy('File too large'), 'ulimit') > 0)
    call check('lock', index(with_remedy('Resource temporarily unavailable'), 'HDF5_USE_FILE_LOCKING=FALSE') > 0)
    call check('no locks', index(with_remedy('No locks available'), 'HDF5_USE_FILE_LOCKING=FALSE') > 0)
    call check('a block is no lock', index(with_remedy('bad local heap block'), 'HDF5_USE_FILE_LOCKING') == 0)
    call check('unknown', with_remedy('Input/output error') == 'Input/output error')
  end subroutine test_reasons

  !> The date that the system's own clock gives in UTC, unless midnight passes in between.
  subroutine test_moment()
    character(20) :: now
    integer :: clock(8), year, month, day, hour, minute, second_, io_status

    now = utc_now()
    read (now, '(i4, 5(1x, i2))', iostat=io_status) year, month, day, hour, minute, second_
    call check('form of the moment', io_status == 0 .and. now(5:5)//now(8:8)//now(11:11)//now(20:20) == '--TZ')
    call date_and_time(values=clock)
    call check('year', abs(year - clock(1)) <= 1)
    call check('month', month >= 1 .and. month <= 12)
    call check('day', day >= 1 .and. day <= 31)
    call check('time of day', hour >= 0 .and. hour < 24 .and. minute >= 0 .and. minute < 60)
    call check('minutes past the hour, but for the zone''s', modulo(minute - (clock(6) - clock(4)), 60) <= 1)
  end subroutine test_moment

  !> Where the zone moves the date over the end of a day, a month, a February or a year.
  subroutine test_calendar()
    call check_moment('no zone', [2026, 7, 15], 0, [12, 34], '2026-07-15T12:34:56Z')
    call check_moment('the same day', [2026, 7, 15], 120, [12, 34], '2026-07-15T10:34:56Z')
    call check_moment('minutes of a zone', [2026, 7, 15], 345, [12, 34], '2026-07-15T06:49:56Z')
    call check_moment('the day before', [2026, 7, 15], 120, [1, 59], '2026-07-14T23:59:56Z')
    call check_moment('midnight', [2026, 7, 15], 120, [2, 0], '2026-07-15T00:00:56Z')
    call check_moment('the day after', [2026, 7, 15], -600, [14, 0], '2026-07-16T00:00:56Z')
    call check_moment('the month before', [2026, 5, 1], 60, [0, 30], '2026-04-30T23:30:56Z')
    call check_moment('the month after', [2026, 4, 30], -60, [23, 30], '2026-05-01T00:30:56Z')
    call check_moment('the year before', [2026, 1, 1], 60, [0, 30], '2025-12-31T23:30:56Z')
    call check_moment('the year after', [2026, 12, 31], -300, [20, 0], '2027-01-01T01:00:56Z')
    call check_moment('into February', [2026, 3, 1], 120, [0, 10], '2026-02-28T22:10:56Z')
    call check_moment('out of February', [2026, 2, 28], -120, [22, 10], '2026-03-01T00:10:56Z')
    call check_moment('into a leap day', [2024, 3, 1], 120, [0, 10], '2024-02-29T22:10:56Z')
    call check_moment('out of a leap day', [2024, 2, 29], -120, [22, 10], '2024-03-01T00:10:56Z')
    call check_moment('a century', [2100, 3, 1], 120, [0, 10], '2100-02-28T22:10:56Z')
    call check_moment('four centuries', [2000, 3, 1], 120, [0, 10], '2000-02-29T22:10:56Z')
  end subroutine test_calendar

  subroutine check_moment(what, date, zone, time, expected)
    character(*), intent(in) :: what, expected
    integer, intent(in) :: date(3), zone, time(2)     !! year, month, day; minutes; hours, minutes

    call check(what//': '//utc_of([date, zone, time, 56, 0]), utc_of([date, zone, time, 56, 0]) == expected)
  end subroutine check_moment
end program test_disk
