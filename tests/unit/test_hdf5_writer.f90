!> The result file through its writer: written data are read back, invalid data are refused and left unchanged.
program test_hdf5_writer
  use, intrinsic :: iso_c_binding, only: c_loc, nul => c_null_char
  use checks, only: check, finish
  use dst_kinds, only: wp, real64
  use dst_errors, only: error_t, file_error, result_done, stopped_early
  use dst_writer, only: quantity_t, outcome_t
  use dst_hdf5_library, only: hid_t, h5fopen, h5fclose, h5dopen, h5dread, h5idec_ref, h5dget_space, h5sget_simple_extent_npoints, &
    h5f_acc_rdonly, h5t_native_double, h5s_all, h5p_default
  use dst_hdf5_tools, only: hdf5_t, start_hdf5, get_attribute, get_text
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, bookmark_t, create_hdf5, rebuild_hdf5, reopen_hdf5
  use dst_parameters, only: parameter_t
  use dst_process, only: guard_t
  implicit none

  character(*), parameter :: file_name = 'test_hdf5_writer.h5'
  type(hdf5_t) :: h5

  call remove(file_name)
  call start_hdf5(h5)
  call check('HDF5 starts', h5%status >= 0)
  call test_written_is_read()
  call test_reads_before_the_end()
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
      call writer%write_events([real(i, wp)], [2 - modulo(i, 2)], error)
      call check('events written', .not. allocated(error))
      if (i == 3) call writer%flush(error)
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

  !> Flushed data can be read by another opening of the file while the run continues, and the file is marked as unfinished.
  subroutine test_reads_before_the_end()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    character(*), parameter :: copy_name = 'test_hdf5_writer_copy.h5'

    call remove(file_name)
    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
    call check('created again', .not. allocated(error))
    call writer%write_samples(ramp(0, 10), error)
    call writer%flush(error)
    call check('flushed', .not. allocated(error))
    call copy(file_name, copy_name)
    call check('rows before the end', size(read_column('time_series/time', copy_name)) == 10)
    call check('not complete', root_integer('complete', copy_name) == 0)
    call check('no result yet', root_integer('result_code', copy_name) == -1)
    call remove(copy_name)
    call writer%finish(outcome(stopped_early), error)
    call check('stopped early is not complete', root_integer('complete') == 0)
  end subroutine test_reads_before_the_end

  subroutine test_refusals()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    integer :: bytes_before, bytes_after

    inquire (file=file_name, size=bytes_before)
    call create_hdf5(writer, file_name, 'shown', metadata(), columns(), error)
    call check_refusal('an existing file', error, 'shown: cannot create')
    inquire (file=file_name, size=bytes_after)
    call check('the existing file is untouched', bytes_before == bytes_after)
    call check('the existing file is as it was', root_integer('complete') == 0)
    call create_hdf5(writer, 'no/such/folder/x.h5', 'shown', metadata(), columns(), error)
    call check_refusal('a folder that is not there', error, 'removed or renamed')
  end subroutine test_refusals

  !> A run continues after its bookmark; later data of the file are dropped. A file without the data that it had at the bookmark is
  !> not written again; one with them is, with the same numbers.
  subroutine test_resume()
    type(hdf5_writer_t) :: writer
    type(guard_t) :: no_guard
    character(*), parameter :: new_name = 'test_hdf5_writer_new.h5'
    type(bookmark_t) :: bookmark, other
    type(error_t), allocatable :: error
    integer :: i

    call remove(file_name)
    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
    call writer%write_samples(ramp(0, 2000), error)
    call writer%write_events([1.0_wp, 2.0_wp], [1, 2], error)
    call writer%set_bookmark(.true., bookmark, error)
    call check('bookmark', .not. allocated(error) .and. all(bookmark%rows == [2000, 2]))
    call writer%write_samples(ramp(2000, 1000), error)
    call writer%write_events([3.0_wp], [1], error)
    call writer%finish(outcome(stopped_early), error)

    other = bookmark
    other%rows(1) = 3001
    call rebuild_hdf5(file_name, new_name, 'shown', other, metadata(), columns(), no_guard, error)
    call remove(new_name)
    call check_refusal('a file that is too short', error, 'time_series/time has fewer rows')
    other = bookmark
    other%checksums(2) = bookmark%checksums(3)
    call rebuild_hdf5(file_name, new_name, 'shown', other, metadata(), columns(), no_guard, error)
    call remove(new_name)
    call check_refusal('a column that changed', error, 'time_series/u_x is not as it was')
    other = bookmark
    other%checksums(5) = bookmark%checksums(3)
    call rebuild_hdf5(file_name, new_name, 'shown', other, metadata(), columns(), no_guard, error)
    call remove(new_name)
    call check_refusal('events that changed', error, 'events/kind is not as it was')
    call rebuild_hdf5('none.h5', new_name, 'shown', bookmark, metadata(), columns(), no_guard, error)
    call check_refusal('a file that is not there', error, 'removed or renamed')
    call rebuild_hdf5(file_name, 'no/such/folder.h5', 'shown', bookmark, metadata(), columns(), no_guard, error)
    call check_refusal('no place for the new file', error, 'removed or renamed')
    call rebuild_hdf5(file_name, new_name, 'shown', bookmark, metadata(), columns(), no_guard, error)
    call check('written again', .not. allocated(error))
    call check('rows up to the bookmark', all(same(read_column('time_series/u_x', new_name), [(2.0_wp*i, i=0, 1999)])))
    call check('events up to the bookmark', all(same(read_column('events/time', new_name), [1.0_wp, 2.0_wp])))
    call check('the new file is unfinished', root_integer('result_code', new_name) == -1)
    call remove(new_name)
    call check('refusals leave the rows', size(read_column('time_series/time')) == 3000)

    call reopen_hdf5(writer, file_name, file_name, bookmark, columns(), error)
    call check('reopened', .not. allocated(error))
    call writer%write_samples(ramp(2000, 2500), error)
    call writer%write_events([4.0_wp], [2], error)
    call writer%set_bookmark(.false., other, error)
    call writer%finish(outcome(result_done), error)
    call check('finished after resuming', .not. allocated(error))
    call check('rows over the resumption', all(same(read_column('time_series/time'), [(0.5_wp*i, i=0, 4499)])))
    call check('events over the resumption', all(same(read_column('events/time'), [1.0_wp, 2.0_wp, 4.0_wp])))
    call check('complete after resuming', root_integer('complete') == 1)
    call rebuild_hdf5(file_name, new_name, 'shown', other, metadata(), columns(), no_guard, error)
    call check('checksums over the resumption', .not. allocated(error))
    call remove(new_name)
    if (digits(1.0_wp) > digits(1.0_real64)) call test_remainders()
  end subroutine test_resume

  !> In a build with more digits a column and its remainder have all of them, also after the resumption.
  subroutine test_remainders()
    type(hdf5_writer_t) :: writer
    type(error_t), allocatable :: error
    type(bookmark_t) :: bookmark
    real(wp) :: samples(3, 100), time(100)
    integer :: i

    time = [(real(i, wp)/3.0_wp, i=1, 100)]
    samples = spread(time, 1, 3)
    samples(3, :) = 0.0_wp
    call remove(file_name)
    call create_hdf5(writer, file_name, file_name, metadata(), columns(), error)
    call writer%write_samples(samples(:, :50), error)
    call writer%write_events(time(:2), [1, 2], error)
    call writer%set_bookmark(.false., bookmark, error)
    call writer%write_samples(samples(:, 51:70), error)
    call writer%write_events(time(3:3), [1], error)
    call writer%finish(outcome(stopped_early), error)
    call reopen_hdf5(writer, file_name, file_name, bookmark, columns(), error)
    call writer%write_samples(samples(:, 51:), error)
    call writer%write_events(time(3:4), [1, 2], error)
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
    metadata%mpi = ''
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

  subroutine copy(from, to)
    character(*), intent(in) :: from, to
    character(:), allocatable :: bytes
    integer :: unit, length

    inquire (file=from, size=length)
    allocate (character(length) :: bytes)
    open (newunit=unit, file=from, access='stream', form='unformatted', status='old', action='read')
    read (unit) bytes
    close (unit)
    open (newunit=unit, file=to, access='stream', form='unformatted', status='replace', action='write')
    write (unit) bytes
    close (unit)
  end subroutine copy

  subroutine remove(name)
    character(*), intent(in) :: name
    integer :: unit, io_status

    open (newunit=unit, file=name, status='old', iostat=io_status)
    if (io_status == 0) close (unit, status='delete')
  end subroutine remove
end program test_hdf5_writer
