!> The result file of a sweep: one row a case, in the order of the cases, from the shards.
!>
!> Rows are gathered block by block, so that memory does not grow with the number of cases. The file gets its name when it is whole.
module dst_sweep_file
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use hdf5, only: hid_t, hsize_t, h5fclose_f, h5f_acc_trunc_f, h5t_ieee_f64le, h5t_std_i32le
  use dst_disk, only: path_t, scratch_name, delete_file, move_file, place_file, true_path, with_remedy, ignore_size_limit_signal
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_hdf5_tools, only: start_hdf5, open_file, failure_reason, put_attribute, create_group, column_t, create_column, append, &
    make_scale, attach_scale, table_t, create_table, append_rows, put_messages
  use dst_hdf5_writer, only: run_metadata_t, write_metadata
  use dst_kinds, only: wp, int64, real64
  use dst_schema, only: schema
  use dst_sweep, only: sweep_t, case_t, value_count, value_quantities, wall_time_value, series_quantities
  use dst_sweep_shard, only: index_t, read_record
  use dst_text, only: integer_text
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: merge_shards

  !> Cases held in memory; values of the series held in memory.
  integer, parameter :: usual_block = 32768, most_series_values = 4000000
  !> result_code of a case that has not been run.
  integer, parameter :: not_run = -1

  type :: output_t
    integer(hid_t) :: file = -1
    type(column_t) :: case_number, result_code
    type(column_t), allocatable :: coordinates(:), values(:)
    type(table_t), allocatable :: series(:)
    !> Of the failed cases so far.
    integer, allocatable :: failed(:)
    type(path_t), allocatable :: failure(:)
    integer :: failures = 0
  end type output_t

contains

  !> Write what the shards hold to `result_file`.
  subroutine merge_shards(sweep, files, index, metadata, result_file, overwrite, error)
    type(sweep_t), intent(in) :: sweep
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    type(run_metadata_t), intent(in) :: metadata
    character(*), intent(in) :: result_file
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error
    type(output_t) :: output
    character(:), allocatable :: scratch
    integer :: units(size(files)), i, status, ignored
    logical :: placed

    call ignore_size_limit_signal()
    scratch = scratch_name(true_path(result_file))
    do i = 1, size(files)
      open (newunit=units(i), file=files(i)%text, status='old', action='read', access='stream', form='unformatted', iostat=status)
      if (status /= 0) call raise(error, file_error, files(i)%text//': cannot be read: see its permissions')
    end do
    if (allocated(error)) return
    call start_hdf5(status)
    call open_file(scratch, h5f_acc_trunc_f, output%file, status)
    call create_columns(output, sweep, metadata, status)
    call copy_cases(output, sweep, index, units, status)
    call write_failures(output, status)
    call put_ending(output, sweep, index, status)
    if (status < 0) call raise(error, file_error, result_file//': cannot write: '//with_remedy(failure_reason()))
    if (output%file >= 0) call h5fclose_f(output%file, status)
    if (status < 0 .and. .not. allocated(error)) &
      call raise(error, file_error, result_file//': cannot write: '//with_remedy(failure_reason()))
    do i = 1, size(files)
      ! allow(C181)
      close (units(i), iostat=ignored)
    end do
    if (.not. allocated(error)) then
      if (overwrite) then
        call move_file(scratch, true_path(result_file), placed)
      else
        call place_file(scratch, true_path(result_file), placed)
      end if
      if (.not. placed) call raise(error, file_error, result_file//': cannot create: another file has taken the name: '// &
        'use --overwrite or another name')
    end if
    if (allocated(error)) call delete_file(scratch)
  end subroutine merge_shards

  !> Cases taken in at once.
  integer function block_of(sweep)
    type(sweep_t), intent(in) :: sweep

    block_of = min(sweep%cases, usual_block)
    if (sweep%keeps_series) block_of = max(1, min(block_of, most_series_values/max(1, sweep%series_values())))
  end function block_of

  subroutine create_columns(output, sweep, metadata, status)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status
    type(quantity_t) :: quantities(value_count), parameter
    type(quantity_t), allocatable :: columns(:)
    integer(hid_t) :: group, summary, series
    integer :: i, block

    block = block_of(sweep)
    call write_metadata(output%file, metadata, status)
    call create_group(output%file, 'sweep', group, status)
    call create_group(group, 'summary', summary, status)
    call put_attribute(group, 'grid', grid_text(sweep), status)
    call put_attribute(group, 'parameters', names_text(sweep), status)
    call create_column(group, quantity_t('case', '1', 'number of the case'), h5t_std_i32le, block, output%case_number, status)
    call make_scale(output%case_number, 'case', status)
    allocate (output%coordinates(size(sweep%axes)), output%values(value_count), output%series(0))
    do i = 1, size(sweep%axes)
      associate (key => schema(sweep%axes(i)%key))
        parameter = quantity_t(sweep%axes(i)%name, key%unit, key%meaning)
        if (key%unit == '') parameter%units = '1'
        call create_column(group, parameter, h5t_ieee_f64le, block, output%coordinates(i), status)
        call attach_scale(output%coordinates(i), output%case_number, status)
      end associate
    end do
    quantities = value_quantities()
    do i = 1, value_count
      if (i == wall_time_value) then
        call create_column(group, quantities(i), h5t_ieee_f64le, block, output%values(i), status)
      else
        call create_column(summary, quantities(i), h5t_ieee_f64le, block, output%values(i), status)
      end if
      call attach_scale(output%values(i), output%case_number, status)
    end do
    call create_column(group, quantity_t('result_code', '1', '0: done; -1: not run; else why it failed, see docs/errors.md'), &
      h5t_std_i32le, block, output%result_code, status)
    call attach_scale(output%result_code, output%case_number, status)
    if (.not. sweep%keeps_series) return
    call create_group(group, 'series', series, status)
    columns = series_quantities(sweep)
    deallocate (output%series)
    allocate (output%series(size(columns)))
    do i = 1, size(columns)
      call create_table(series, columns(i), sweep%series_rows(), output%series(i), status)
    end do
  end subroutine create_columns

  !> '40 40', or 'list'.
  function grid_text(sweep) result(text)
    type(sweep_t), intent(in) :: sweep
    character(:), allocatable :: text
    integer :: i

    text = 'list'
    if (sweep%is_list) return
    text = ''
    do i = 1, size(sweep%axes)
      text = text//integer_text(size(sweep%axes(i)%values, kind=int64))//' '
    end do
    text = trim(text)
  end function grid_text

  function names_text(sweep) result(text)
    type(sweep_t), intent(in) :: sweep
    character(:), allocatable :: text
    integer :: i

    text = ''
    do i = 1, size(sweep%axes)
      text = text//trim(sweep%axes(i)%name)//' '
    end do
    text = trim(text)
  end function names_text

  subroutine copy_cases(output, sweep, index, units, status)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    type(index_t), intent(in) :: index
    integer, intent(in) :: units(:)
    integer, intent(inout) :: status
    real(real64), allocatable :: values(:, :), coordinates(:, :), codes(:), numbers(:), series(:, :, :)
    type(case_t) :: case
    integer :: first, last, block, n, i

    block = block_of(sweep)
    allocate (values(block, value_count), coordinates(block, size(sweep%axes)), codes(block), numbers(block))
    allocate (series(sweep%series_rows(), block, size(output%series)))
    allocate (output%failed(index%failed), output%failure(index%failed))
    do first = 1, sweep%cases, block
      last = min(sweep%cases, first + block - 1)
      if (status < 0) return
      series = ieee_value(1.0_real64, ieee_quiet_nan)
      do i = first, last
        n = i - first + 1
        numbers(n) = real(i, real64)
        coordinates(n, :) = real(sweep%coordinates(i), real64)
        call take_case(output, index, units, i, size(output%series), case, status)
        codes(n) = case%result_code
        values(n, :) = real(case%values, real64)
        if (size(output%series) > 0 .and. allocated(case%series)) &
          series(:size(case%series, 2), n, :) = transpose(real(case%series, real64))
      end do
      n = last - first + 1
      call append(output%case_number, numbers(:n), status)
      call append(output%result_code, codes(:n), status)
      do i = 1, size(sweep%axes)
        call append(output%coordinates(i), coordinates(:n, i), status)
      end do
      do i = 1, value_count
        call append(output%values(i), values(:n, i), status)
      end do
      do i = 1, size(output%series)
        call append_rows(output%series(i), series(:, :n, i), status)
      end do
    end do
  end subroutine copy_cases

  subroutine take_case(output, index, units, number, columns, case, status)
    type(output_t), intent(inout) :: output
    type(index_t), intent(in) :: index
    integer, intent(in) :: units(:), number, columns
    type(case_t), intent(inout) :: case
    integer, intent(inout) :: status
    integer :: read_status

    if (index%shard(number) > 0 .and. status >= 0) then
      call read_record(units(index%shard(number)), index%place(number), columns, case, read_status)
      if (read_status /= 0) status = -1
      if (case%result_code == result_done) return
      output%failures = output%failures + 1
      output%failed(output%failures) = number
      output%failure(output%failures)%text = case%result_text
    else
      case%result_code = not_run
      if (.not. allocated(case%values)) allocate (case%values(value_count))
      case%values = ieee_value(1.0_wp, ieee_quiet_nan)
      if (allocated(case%series)) deallocate (case%series)
    end if
  end subroutine take_case

  !> The messages of the cases that failed.
  subroutine write_failures(output, status)
    type(output_t), intent(inout) :: output
    integer, intent(inout) :: status
    integer(hid_t) :: group
    type(column_t) :: numbers

    call create_group(output%file, 'sweep/failures', group, status)
    call create_column(group, quantity_t('case', '1', 'number of a case that failed'), h5t_std_i32le, &
      max(1, min(1024, output%failures)), numbers, status)
    call append(numbers, real(output%failed(:output%failures), real64), status)
    call put_messages(group, quantity_t('result_text', '1', 'why it failed'), output%failure(:output%failures), status)
  end subroutine write_failures

  subroutine put_ending(output, sweep, index, status)
    type(output_t), intent(in) :: output
    type(sweep_t), intent(in) :: sweep
    type(index_t), intent(in) :: index
    integer, intent(inout) :: status
    character(:), allocatable :: text
    integer :: code

    text = 'done'
    code = result_done
    if (index%failed > 0) then
      code = 5
      text = integer_text(int(index%failed, int64))//' of '//integer_text(int(sweep%cases, int64))//' cases failed'
    end if
    if (index%done < sweep%cases) then
      code = 75
      text = integer_text(int(sweep%cases - index%done, int64))//' of '//integer_text(int(sweep%cases, int64))// &
        ' cases have not been run'
    end if
    call put_attribute(output%file, 'result_code', code, status)
    call put_attribute(output%file, 'result_text', text, status)
    call put_attribute(output%file, 'complete', merge(1, 0, index%done == sweep%cases), status)
  end subroutine put_ending
end module dst_sweep_file
