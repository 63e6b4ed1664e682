!> The result file of a sweep: one row a case, in the order of the cases, from the shards.
!>
!> Rows are gathered block by block, so that memory does not grow with the number of cases. The file gets its name when it is whole.
module dst_sweep_file
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use hdf5, only: hid_t, h5fclose_f, h5f_acc_excl_f, h5t_ieee_f64le, h5t_std_i32le
  use dst_disk, only: path_t, place_of, utc_at, with_remedy, ignore_size_limit_signal
  use dst_errors, only: error_t, raise, file_error, out_of_memory, result_done, some_failed, stopped_early
  use dst_hdf5_tools, only: start_hdf5, open_file, failure_reason, put_attribute, create_group, column_t, create_column, append, &
    make_scale, attach_scale, table_t, create_table, append_rows, message_list_t, create_messages, append_messages
  use dst_hdf5_origin, only: sweep_state_t, state_of_sweep
  use dst_hdf5_writer, only: run_metadata_t, write_metadata
  use dst_kinds, only: int64, real64
  use dst_result_file, only: result_file_t, check_target
  use dst_schema, only: schema
  use dst_signals, only: is_told_to_end, stopped_by
  use dst_sweep, only: sweep_t, case_t, value_count, value_quantities, wall_time_value, series_quantities
  use dst_seal, only: has_sound_seal
  use dst_sweep_shard, only: head_t, index_t, layout_t, layout_of, reader_t, without_concern, open_records, &
    read_record, shards_of
  use dst_text, only: integer_text
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: block_of, merge_shards, look_at_result, is_of_unfinished_sweep

  !> Cases held in memory; values of the series held in memory.
  integer, parameter :: usual_block = 16384, most_series_values = 4000000
  !> result_code of a case that has not been run.
  integer, parameter :: not_run = -1

  type :: output_t
    integer(hid_t) :: file = -1
    type(column_t) :: case_number, result_code, series_time, failed
    type(column_t), allocatable :: coordinates(:), values(:)
    type(table_t), allocatable :: series(:)
    type(message_list_t) :: failure
  end type output_t

  !> Some cases one after the other, as they are written.
  type :: block_t
    integer :: first = 0, count = 0
    real(real64), allocatable :: number(:), result_code(:), coordinates(:, :), values(:, :)   !! (case), (case, parameter or value)
    real(real64), allocatable :: series(:, :, :)                                              !! (row, case, column)
    type(path_t), allocatable :: message(:)
  end type block_t

contains

  !> Whether a file is of a sweep that is not at its end: cases are missing, or shards are still beside it.
  logical function is_of_unfinished_sweep(result_file)
    character(*), intent(in) :: result_file
    type(sweep_state_t) :: state
    type(path_t), allocatable :: files(:)

    state = state_of_sweep(place_of(result_file))
    call shards_of(result_file, files)
    is_of_unfinished_sweep = state%identity /= '' .and. (state%complete == 0 .or. size(files) > 0)
  end function is_of_unfinished_sweep

  !> Refuse to replace what has the name of the result, but for a partial result of this sweep. Of a whole one beside which there
  !> are still shards `index` says that all is done; not so for one of several processes, which `is_shared`.
  subroutine look_at_result(result_file, head, is_shared, files, index, error)
    character(*), intent(in) :: result_file
    type(head_t), intent(in) :: head
    logical, intent(in) :: is_shared
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(inout) :: index
    type(error_t), allocatable, intent(out) :: error
    type(sweep_state_t) :: state

    call check_target(result_file, .false., error)
    if (.not. allocated(error)) return
    state = state_of_sweep(place_of(result_file))
    if (state%identity /= head%identity) return
    if (state%complete == 1) then
      if (is_shared .or. size(files) == 0) return
      if (.not. has_sound_seal(place_of(result_file))) return
      index%is_in_result = .true.
      index%state = without_concern
      index%done = state%done
      index%failed = state%failed
    end if
    deallocate (error)
  end subroutine look_at_result

  !> Write what the shards hold to `result_file`.
  subroutine merge_shards(sweep, head, files, index, metadata, result_file, overwrite, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    type(run_metadata_t), intent(in) :: metadata
    character(*), intent(in) :: result_file
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error
    type(result_file_t) :: file
    type(output_t) :: output
    character(:), allocatable :: checksum
    integer :: status

    call file%claim(result_file, .true., error)
    if (allocated(error)) return
    if (.not. overwrite) call check_replaceable(result_file, head, index, error)
    if (allocated(error)) then
      call file%release()
      return
    end if
    call ignore_size_limit_signal()
    call start_hdf5(status)
    call open_file(file%path(), h5f_acc_excl_f, output%file, status)
    call file%adopt()
    call create_columns(output, sweep, metadata, status)
    call copy_cases(output, sweep, files, index, status, error)
    call put_ending(output, sweep, head, index, status)
    if (status < 0) call raise_cannot_write(result_file, error)
    if (output%file >= 0) call h5fclose_f(output%file, status)
    if (status < 0) call raise_cannot_write(result_file, error)
    if (.not. allocated(error)) call file%seal(checksum, error)
    if (.not. allocated(error)) call file%put_in_place(error)
    if (allocated(error)) then
      call file%abandon()
    else
      call file%release()
    end if
  end subroutine merge_shards

  !> Only a partial result of the same sweep is, and none that holds more cases. Nobody else writes it meanwhile.
  subroutine check_replaceable(result_file, head, index, error)
    character(*), intent(in) :: result_file
    type(head_t), intent(in) :: head
    type(index_t), intent(in) :: index
    type(error_t), allocatable, intent(out) :: error
    type(sweep_state_t) :: state

    call check_target(result_file, .false., error)
    if (.not. allocated(error)) return
    state = state_of_sweep(place_of(result_file))
    if (state%identity /= head%identity .or. state%complete == 1) return
    deallocate (error)
    if (state%done > index%done) call raise(error, file_error, result_file//': the file holds '//integer_text(state%done)// &
      ' cases, the shards '//integer_text(index%done)//': use --overwrite or another name')
  end subroutine check_replaceable

  !> The first error counts.
  subroutine raise_cannot_write(result_file, error)
    character(*), intent(in) :: result_file
    type(error_t), allocatable, intent(inout) :: error

    if (.not. allocated(error)) call raise(error, file_error, result_file//': cannot write: '//with_remedy(failure_reason()))
  end subroutine raise_cannot_write

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
    integer(hid_t) :: group, summary, series, failures
    integer :: i, block

    block = block_of(sweep)
    call write_metadata(output%file, metadata, status)
    call create_group(output%file, 'sweep', group, status)
    call create_group(group, 'summary', summary, status)
    call put_attribute(group, 'grid', grid_text(sweep), status)
    call put_attribute(group, 'parameters', sweep%parameters(), status)
    call create_column(group, quantity_t('case', '1', 'number of the case'), h5t_std_i32le, block, output%case_number, status, &
      whole_chunks=.true.)
    call make_scale(output%case_number, 'case', status)
    allocate (output%coordinates(size(sweep%axes)), output%values(value_count), output%series(0))
    do i = 1, size(sweep%axes)
      associate (key => schema(sweep%axes(i)%key))
        parameter = quantity_t(sweep%axes(i)%name, key%unit, key%meaning)
        if (key%unit == '') parameter%units = '1'
        call create_column(group, parameter, h5t_ieee_f64le, block, output%coordinates(i), status, whole_chunks=.true.)
        call attach_scale(output%coordinates(i)%dataset, output%case_number, status)
      end associate
    end do
    quantities = value_quantities()
    do i = 1, value_count
      if (i == wall_time_value) then
        call create_column(group, quantities(i), h5t_ieee_f64le, block, output%values(i), status, whole_chunks=.true.)
      else
        call create_column(summary, quantities(i), h5t_ieee_f64le, block, output%values(i), status, whole_chunks=.true.)
      end if
      call attach_scale(output%values(i)%dataset, output%case_number, status)
    end do
    call create_column(group, quantity_t('result_code', '1', '0: done; -1: not run; else why it failed, see docs/errors.md'), &
      h5t_std_i32le, block, output%result_code, status, whole_chunks=.true.)
    call attach_scale(output%result_code%dataset, output%case_number, status)
    call create_group(group, 'failures', failures, status)
    call create_column(failures, quantity_t('case', '1', 'number of a case that failed'), h5t_std_i32le, 1024, output%failed, &
      status)
    call make_scale(output%failed, 'case', status)
    call create_messages(failures, quantity_t('result_text', '1', 'why it failed'), output%failure, status)
    call attach_scale(output%failure%dataset, output%failed, status)
    if (.not. sweep%keeps_series) return
    call create_group(group, 'series', series, status)
    columns = series_quantities(sweep)
    deallocate (output%series)
    allocate (output%series(size(columns)))
    call create_column(series, quantity_t('time', 's', 'time of the samples'), h5t_ieee_f64le, min(8192, sweep%series_rows()), &
      output%series_time, status)
    call make_scale(output%series_time, 'time', status)
    call append(output%series_time, real(sweep%series_times(), real64), status)
    do i = 1, size(columns)
      call create_table(series, columns(i), sweep%series_rows(), output%series(i), status)
      call attach_scale(output%series(i)%dataset, output%case_number, status)
      call attach_scale(output%series(i)%dataset, output%series_time, status, side=1)
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
      text = text//integer_text(size(sweep%axes(i)%values))//' '
    end do
    text = trim(text)
  end function grid_text

  subroutine copy_cases(output, sweep, files, index, status, error)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    integer, intent(inout) :: status
    type(error_t), allocatable, intent(out) :: error
    type(block_t) :: block
    type(layout_t) :: layout
    integer :: first, length, no_memory

    layout = layout_of(sweep)
    length = index%block
    allocate (block%number(length), block%result_code(length), block%message(length))
    allocate (block%coordinates(length, size(sweep%axes)), block%values(length, value_count))
    allocate (block%series(sweep%series_rows(), length, size(output%series)), stat=no_memory)
    if (no_memory /= 0) then
      call raise(error, out_of_memory, 'no memory for the series of '//integer_text(length)//' cases: the shards keep what is '// &
        'done: merge them where there is more')
      return
    end if
    do first = 1, sweep%cases, length
      if (status < 0) return
      if (is_told_to_end()) then
        call raise(error, stopped_early, stopped_by()//' while the result was written: the shards '// &
          'keep what is done: start it again')
        return
      end if
      block%first = first
      block%count = min(length, sweep%cases - first + 1)
      call clear(block, sweep)
      call read_block(files, index, layout, block, error)
      if (allocated(error)) return
      call write_block(output, block, status)
    end do
  end subroutine copy_cases

  !> As if no case had been run.
  subroutine clear(block, sweep)
    type(block_t), intent(inout) :: block
    type(sweep_t), intent(in) :: sweep
    real(real64) :: nan
    integer :: i

    nan = ieee_value(nan, ieee_quiet_nan)
    block%values = nan
    block%series = nan
    block%result_code = not_run
    do i = 1, block%count
      block%number(i) = block%first + i - 1
      block%coordinates(i, :) = real(sweep%coordinates(block%first + i - 1), real64)
    end do
  end subroutine clear

  !> What the shards hold of the block, shard by shard: there may be more of them than a process can have open. Of the records of a
  !> case the first counts.
  subroutine read_block(files, index, layout, block, error)
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    type(layout_t), intent(in) :: layout
    type(block_t), intent(inout) :: block
    type(error_t), allocatable, intent(out) :: error
    type(case_t) :: case
    type(reader_t) :: reader
    integer(int64) :: place
    integer :: stretch, shard, i
    logical :: is_possible

    shard = 0
    is_possible = .true.
    stretch = index%first((block%first - 1)/index%block + 1)
    do while (stretch > 0 .and. is_possible)
      associate (from => index%stretches(stretch))
        if (from%shard /= shard) then
          if (shard > 0) call reader%close()
          shard = from%shard
          call open_records(files(shard)%text, reader, error)
          if (allocated(error)) return
        end if
        place = from%first
        do i = 1, from%records
          call read_record(reader, place, layout, case, is_possible)
          if (is_possible) is_possible = case%number >= block%first .and. case%number < block%first + block%count
          if (.not. is_possible) exit
          call take_case(case, layout, block)
        end do
        stretch = from%next
      end associate
    end do
    if (shard > 0) call reader%close()
    if (.not. is_possible) call raise(error, file_error, files(shard)%text//': was changed meanwhile: start again')
  end subroutine read_block

  subroutine take_case(case, layout, block)
    type(case_t), intent(in) :: case
    type(layout_t), intent(in) :: layout
    type(block_t), intent(inout) :: block
    integer :: j, n

    n = case%number - block%first + 1
    if (nint(block%result_code(n)) /= not_run) return
    block%result_code(n) = case%result_code
    block%values(n, :) = real(case%values, real64)
    if (case%result_code /= result_done) block%message(n)%text = case%result_text
    do j = 1, layout%columns
      block%series(:size(case%series, 2), n, j) = real(case%series(j, :), real64)
    end do
  end subroutine take_case

  subroutine write_block(output, block, status)
    type(output_t), intent(inout) :: output
    type(block_t), intent(in) :: block
    integer, intent(inout) :: status
    real(real64), allocatable :: numbers(:)
    type(path_t), allocatable :: messages(:)
    integer :: i, n, failed

    n = block%count
    call append(output%case_number, block%number(:n), status)
    call append(output%result_code, block%result_code(:n), status)
    do i = 1, size(output%coordinates)
      call append(output%coordinates(i), block%coordinates(:n, i), status)
    end do
    do i = 1, value_count
      call append(output%values(i), block%values(:n, i), status)
    end do
    do i = 1, size(output%series)
      call append_rows(output%series(i), block%series(:, :n, i), status)
    end do
    failed = count(block%result_code(:n) > 0.0_real64)
    allocate (numbers(failed), messages(failed))
    failed = 0
    do i = 1, n
      if (.not. block%result_code(i) > 0.0_real64) cycle
      failed = failed + 1
      numbers(failed) = block%number(i)
      messages(failed)%text = block%message(i)%text
    end do
    call append(output%failed, numbers, status)
    call append_messages(output%failure, messages, status)
  end subroutine write_block

  subroutine put_ending(output, sweep, head, index, status)
    type(output_t), intent(in) :: output
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    type(index_t), intent(in) :: index
    integer, intent(inout) :: status
    character(:), allocatable :: text
    integer :: code

    text = 'done'
    code = result_done
    if (index%failed > 0) then
      code = some_failed
      text = integer_text(index%failed)//' of '//integer_text(sweep%cases)//' cases failed'
    end if
    if (index%done < sweep%cases) then
      code = stopped_early
      text = integer_text(sweep%cases - index%done)//' of '//integer_text(sweep%cases)// &
        ' cases have not been run'
    end if
    call put_attribute(output%file, 'sweep_identity', head%identity, status)
    call put_attribute(output%file, 'cases_done', index%done, status)
    call put_attribute(output%file, 'cases_failed', index%failed, status)
    call put_attribute(output%file, 'begun', utc_at(index%begun), status)
    call put_attribute(output%file, 'ended', utc_at(index%ended), status)
    call put_attribute(output%file, 'result_code', code, status)
    call put_attribute(output%file, 'result_text', text, status)
    call put_attribute(output%file, 'complete', merge(1, 0, index%done == sweep%cases), status)
  end subroutine put_ending
end module dst_sweep_file
