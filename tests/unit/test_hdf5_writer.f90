!> The result file through its writer: rows and events that are written are read back, also over the ends of chunks and over a
!> resumption; what else a file holds: tests/python/test_file.py.
program test_hdf5_writer
  use checks, only: check, finish
  use dst_disk, only: delete_file
  use dst_kinds, only: wp, real64
  use dst_errors, only: error_t, file_error, result_done, stopped_early
  use dst_writer, only: event_t, quantity_t, outcome_t
  use dst_hdf5_tools, only: hid_t, hdf5_t, open_existing, close_file, read_list, get_number
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_parameters, only: parameter_t
  implicit none

  character(*), parameter :: file_name = 'test_hdf5_writer.h5'

  call delete_file(file_name)
  call test_written_is_read()
  call test_refusals()
  call delete_file(file_name)
  call finish()

contains

  !> Blocks of any size arrive in order and complete, also across the ends of chunks; a file that begins with the rows of a former
  !> one has them all, whatever their number in the last chunk.
  subroutine test_written_is_read()
    character(*), parameter :: former = 'test_hdf5_writer_former.h5'
    integer, parameter :: blocks(7) = [1, 63, 64, 65, 1000, 807, 2500]
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    integer :: i, first

    call create_hdf5(writer, former, former, metadata(), columns(), error, expected_rows=100)
    call check('created', .not. allocated(error))
    first = 0
    do i = 1, size(blocks)
      if (i == size(blocks)) then
        call writer%finish(outcome(stopped_early), error)
        call check('stopped early', .not. allocated(error))
        call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
        call writer%copy_rows(former, error)
        call check('copied', .not. allocated(error))
      end if
      call writer%write_samples(ramp(first, blocks(i)), error)
      call check('samples written', .not. allocated(error))
      call writer%write_events([event_t(i/3.0_wp, 2 - modulo(i, 2))], error)
      call check('events written', .not. allocated(error))
      first = first + blocks(i)
    end do
    call writer%finish(outcome(result_done), error)
    call check('finished', .not. allocated(error))
    call check_rows('time_series/time', [(i/3.0_wp, i=0, first - 1)])
    call check_rows('time_series/u_x', [(2.0_wp*i/3.0_wp, i=0, first - 1)])
    call check_rows('time_series/sticking', [(real(modulo(i, 2), wp), i=0, first - 1)])
    call check_rows('events/time', [(i/3.0_wp, i=1, size(blocks))])
    call check_rows('events/kind', [(real(2 - modulo(i, 2), wp), i=1, size(blocks))])
    call check_steps(3.0e10_wp)
    call delete_file(former)
  end subroutine test_written_is_read

  subroutine test_refusals()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error

    call create_hdf5(writer, 'no/such/folder/x.h5', 'shown', metadata(), columns(), error)
    call check('a folder that is not there', refused(error))
    call create_hdf5(writer, file_name, 'shown', metadata(), columns(), error)
    call writer%copy_rows('none.h5', error)
    call check('a file that is not there', refused(error))
  end subroutine test_refusals

  logical function refused(error)
    type(error_t), allocatable, intent(in) :: error

    refused = allocated(error)
    if (refused) refused = error%code == file_error .and. index(error%text, 'removed or renamed') > 0
  end function refused

  function metadata()
    type(run_metadata_t) :: metadata

    metadata%program = 'dynstiction'
    metadata%version = '0'
    metadata%git_revision = 'unknown'
    metadata%compiler = 'gfortran µ'
    metadata%build_flags = '-O3'
    metadata%host = 'here'
    metadata%job = ''
    metadata%created = '2026-01-31T23:59:59Z'
    metadata%model = 'full'
    metadata%method = 'radau9'
    metadata%deck_text = '&scene /'
    metadata%deck_resolved = '&scene /'
    metadata%deck_sha256 = 'abc'
    allocate (metadata%parameters(1))
    metadata%parameters(1) = parameter_t(quantity_t('mass', 'kg', 'mass'), 0.25_wp)
  end function metadata

  function columns()
    type(quantity_t) :: columns(3)

    columns = [quantity_t('time', 's', 'time'), quantity_t('u_x', 'm', 'elongation'), quantity_t('sticking', '1', 'at rest')]
  end function columns

  function outcome(code)
    integer, intent(in) :: code
    type(outcome_t) :: outcome

    outcome%result_code = code
    outcome%result_text = 'as the test says'
    allocate (outcome%summary, source=[quantity_t('period', 's', 'period')])
    allocate (outcome%summary_value, source=[0.25_wp])
    allocate (outcome%statistics, source=[quantity_t('steps', '1', 'steps'), quantity_t('wall_time', 's', 'wall time')])
    allocate (outcome%statistics_value, source=[3.0e10_wp, 0.5_wp])
  end function outcome

  !> Samples number first to first + count - 1.
  function ramp(first, count)
    integer, intent(in) :: first, count
    real(wp) :: ramp(3, count)
    integer :: i

    do i = 1, count
      ramp(:2, i) = [1.0_wp, 2.0_wp]*(first + i - 1)/3.0_wp
      ramp(3, i) = modulo(first + i - 1, 2)
    end do
  end function ramp

  !> Bit for bit; in a build with more digits a column and its remainder have all of them.
  subroutine check_rows(path, expected)
    character(*), intent(in) :: path
    real(wp), intent(in) :: expected(:)
    real(wp), allocatable :: found(:), remainder(:)

    call read_column(path, found)
    call check(path//': all rows', size(found) == size(expected))
    if (size(found) /= size(expected)) return
    if (digits(1.0_wp) == digits(1.0_real64) .or. all(abs(found - expected) <= 0.0_wp)) then
      call check(path//': every row', all(abs(found - expected) <= 0.0_wp))
    else
      call read_column('remainder/'//path, remainder)
      call check(path//': 31 digits', all(abs(found + remainder - expected) <= 1.0e-31_wp*expected))
    end if
  end subroutine check_rows

  subroutine check_steps(expected)
    real(wp), intent(in) :: expected
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    real(wp) :: found

    call open_existing(file_name, file, h5)
    call get_number(file, 'statistics/steps', found, h5)
    call close_file(file, h5)
    call check('statistics/steps is read', h5%status >= 0)
    call check('statistics/steps', abs(found - expected) <= 0.0_wp)
  end subroutine check_steps

  subroutine read_column(path, values)
    character(*), intent(in) :: path
    real(wp), allocatable, intent(out) :: values(:)
    type(hdf5_t) :: h5
    integer(hid_t) :: file

    call open_existing(file_name, file, h5)
    call read_list(file, path, values, h5)
    call close_file(file, h5)
    call check('read '//path, h5%status >= 0)
  end subroutine read_column
end program test_hdf5_writer
