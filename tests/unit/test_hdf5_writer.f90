!> The result file through its writer: written data are read back, invalid data are refused and left unchanged.
program test_hdf5_writer
  use, intrinsic :: iso_c_binding, only: c_loc, nul => c_null_char
  use checks, only: check, finish
  use dst_kinds, only: wp, real64
  use dst_errors, only: error_t, file_error, result_done, stopped_early
  use dst_writer, only: event_t, quantity_t, outcome_t
  use dst_hdf5_library, only: hid_t, h5fopen, h5fclose, h5dopen, h5dread, h5idec_ref, h5dget_space, h5sget_simple_extent_npoints, &
    h5f_acc_rdonly, h5t_native_double, h5s_all, h5p_default
  use dst_hdf5_tools, only: hdf5_t, start_hdf5, get_attribute, get_text
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_parameters, only: parameter_t
  implicit none

  character(*), parameter :: file_name = 'test_hdf5_writer.h5'
  type(hdf5_t) :: h5

  call remove(file_name)
  call start_hdf5(h5)
  call check('HDF5 starts', h5%status >= 0)
  call test_written_is_read()
  call test_refusals()
  call test_resume()
  call remove(file_name)

  call finish()

contains

  !> Blocks of any size arrive in order and complete, also across the ends of chunks.
  subroutine test_written_is_read()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    integer, parameter :: blocks(6) = [1, 63, 64, 65, 1000, 7]
    integer :: i, first

    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error, expected_rows=100)
    call check('created', .not. allocated(error))
    first = 0
    do i = 1, size(blocks)
      call writer%write_samples(ramp(first, blocks(i)), error)
      call check('samples written', .not. allocated(error))
      call writer%write_events([event_t(real(i, wp), 2 - modulo(i, 2))], error)
      call check('events written', .not. allocated(error))
      first = first + blocks(i)
    end do
    call writer%finish(outcome(result_done), error)
    call check('finished', .not. allocated(error))

    call check('rows of time', all(same(read_column('time_series/time'), [(0.5_wp*i, i=0, sum(blocks) - 1)])))
    call check('rows of u_x', all(same(read_column('time_series/u_x'), [(2.0_wp*i, i=0, sum(blocks) - 1)])))
    call check('rows of sticking', all(same(read_column('time_series/sticking'), [(real(modulo(i, 2), wp), i=0, sum(blocks) - 1)])))
    call check('events', all(same(read_column('events/kind'), [1.0_wp, 2.0_wp, 1.0_wp, 2.0_wp, 1.0_wp, 2.0_wp])))
    call check('period', all(same(read_column('summary/period'), [0.25_wp])))
    call check('mass', all(same(read_column('parameters/mass'), [0.25_wp])))
    call check('law', text_at('parameters/law') == 'weakening')
    call check('a counter beyond 32 bits', all(same(read_column('statistics/steps'), [3.0e10_wp])))
    call check('complete', root_integer('complete') == 1)
    call check('result code', root_integer('result_code') == result_done)
    call check('deck hash', root_text('deck_sha256') == 'abc')
    call check('UTF-8', root_text('compiler') == 'gfortran µ')
  end subroutine test_written_is_read

  subroutine test_refusals()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error

    call create_hdf5(writer, 'no/such/folder/x.h5', 'shown', metadata(), columns(), error)
    call check_refusal('a folder that is not there', error, 'removed or renamed')
  end subroutine test_refusals

  !> A file that begins with the rows of a former one has them all, whatever their number in the last chunk.
  subroutine test_resume()
    type(hdf5_writer_t) :: writer
    character(*), parameter :: former = 'test_hdf5_writer_former.h5', other = 'test_hdf5_writer_other.h5'
    type(error_t), allocatable :: error
    integer :: i

    call create_hdf5(writer, former, former, metadata(), columns(), error)
    call writer%write_samples(ramp(0, 2000), error)
    call writer%write_events([event_t(1.0_wp, 1), event_t(2.0_wp, 2)], error)
    call writer%finish(outcome(stopped_early), error)
    call check('stopped early', .not. allocated(error))
    call check('stopped early is not complete', root_integer('complete', former) == 0)
    call create_hdf5(writer, other, 'shown', metadata(), columns(), error)
    call writer%copy_rows('none.h5', error)
    call check_refusal('a file that is not there', error, 'removed or renamed')
    call remove(other)

    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
    call writer%copy_rows(former, error)
    call check('copied', .not. allocated(error))
    call writer%write_samples(ramp(2000, 2500), error)
    call writer%write_events([event_t(4.0_wp, 2)], error)
    call writer%finish(outcome(result_done), error)
    call check('finished after resuming', .not. allocated(error))
    call check('rows over the resumption', all(same(read_column('time_series/time'), [(0.5_wp*i, i=0, 4499)])))
    call check('events over the resumption', all(same(read_column('events/time'), [1.0_wp, 2.0_wp, 4.0_wp])))
    call check('complete after resuming', root_integer('complete') == 1)
    if (digits(1.0_wp) > digits(1.0_real64)) call test_remainders(former)
    call remove(former)
  end subroutine test_resume

  !> In a build with more digits a column and its remainder have all of them, also after the resumption.
  subroutine test_remainders(former)
    character(*), intent(in) :: former
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    real(wp) :: samples(3, 100), time(100)
    integer :: i

    time = [(real(i, wp)/3.0_wp, i=1, 100)]
    samples = spread(time, 1, 3)
    samples(3, :) = 0.0_wp
    call create_hdf5(writer, former, former, metadata(), columns(), error)
    call writer%write_samples(samples(:, :50), error)
    call writer%write_events([event_t(time(1), 1), event_t(time(2), 2)], error)
    call writer%finish(outcome(stopped_early), error)
    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
    call writer%copy_rows(former, error)
    call writer%write_samples(samples(:, 51:), error)
    call writer%write_events([event_t(time(3), 1), event_t(time(4), 2)], error)
    call writer%finish(outcome(result_done), error)
    call check_digits('u_x', 'time_series/u_x', time)
    call check_digits('events', 'events/time', time(:4))
  end subroutine test_remainders

  subroutine check_digits(what, path, expected)
    character(*), intent(in) :: what, path
    real(wp), intent(in) :: expected(:)
    real(wp), allocatable :: sum(:)

    sum = real(read_column(path), wp) + real(read_column('remainder/'//path), wp)
    call check(what//': all rows', size(sum) == size(expected))
    call check(what//': 31 digits', all(abs(sum - expected(:size(sum))) <= 1.0e-31_wp*expected(:size(sum))))
  end subroutine check_digits

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
    allocate (metadata%parameters(2))
    metadata%parameters(1) = parameter_t(quantity_t('mass', 'kg', 'mass'), 0.25_wp)
    metadata%parameters(2) = parameter_t(quantity_t('law', '1', 'friction law'), text='weakening')
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
      ramp(:, i) = [0.5_wp, 2.0_wp, 0.0_wp]*(first + i - 1)
      ramp(3, i) = modulo(first + i - 1, 2)
    end do
  end function ramp

  function read_column(path, from) result(values)
    character(*), intent(in) :: path
    character(*), intent(in), optional :: from
    real(real64), allocatable, target :: values(:)
    integer(hid_t) :: file, dataset, space
    integer :: ignored

    file = opened(from)
    dataset = h5dopen(file, path//nul, h5p_default)
    space = h5dget_space(dataset)
    allocate (values(h5sget_simple_extent_npoints(space)))
    call check('read '//path, h5dread(dataset, h5t_native_double, h5s_all, h5s_all, h5p_default, c_loc(values)) >= 0)
    ignored = h5idec_ref(space)
    ignored = h5idec_ref(dataset)
    ignored = h5fclose(file)
  end function read_column

  integer function root_integer(name, from) result(value)
    character(*), intent(in) :: name
    character(*), intent(in), optional :: from
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    integer :: ignored

    file = opened(from)
    call get_attribute(file, name, value, h5)
    call check('attribute '//name, h5%status >= 0)
    ignored = h5fclose(file)
  end function root_integer

  function root_text(name) result(text)
    character(*), intent(in) :: name
    character(:), allocatable :: text
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    integer :: ignored

    file = opened()
    call get_attribute(file, name, text, h5)
    call check('attribute '//name, h5%status >= 0)
    ignored = h5fclose(file)
  end function root_text

  function text_at(path) result(text)
    character(*), intent(in) :: path
    character(:), allocatable :: text
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    integer :: ignored

    file = opened()
    call get_text(file, path, text, h5)
    call check('text '//path, h5%status >= 0)
    ignored = h5fclose(file)
  end function text_at

  function opened(from) result(file)
    character(*), intent(in), optional :: from
    integer(hid_t) :: file

    if (present(from)) then
      file = h5fopen(from//nul, h5f_acc_rdonly, h5p_default)
    else
      file = h5fopen(file_name//nul, h5f_acc_rdonly, h5p_default)
    end if
    call check('the file opens', file >= 0)
  end function opened

  !> Bit for bit; arrays of different lengths differ.
  function same(actual, expected)
    real(real64), intent(in) :: actual(:)
    real(wp), intent(in) :: expected(:)
    logical, allocatable :: same(:)

    if (size(actual) == size(expected)) then
      same = abs(real(actual, wp) - expected) <= 0.0_wp
    else
      same = [.false.]
    end if
  end function same

  subroutine check_refusal(what, error, words)
    character(*), intent(in) :: what, words
    type(error_t), allocatable, intent(in) :: error

    call check(what//' is refused', allocated(error))
    if (.not. allocated(error)) return
    call check(what//': code', error%code == file_error)
    call check(what//': "'//error%text//'"', index(error%text, words) > 0)
  end subroutine check_refusal

  subroutine remove(name)
    character(*), intent(in) :: name
    integer :: unit, io_status

    open (newunit=unit, file=name, status='old', iostat=io_status)
    if (io_status == 0) close (unit, status='delete')
  end subroutine remove
end program test_hdf5_writer
