!> The result file of a sweep: one row for each case, in the order of the cases, from the shards.
!>
!> Rows are gathered block by block, so that the memory does not grow with the number of cases. The file gets its name when it is
!> complete.
module dst_sweep_file
  use dst_disk, only: path_t, place_of, utc_at, with_remedy
  use dst_errors, only: error_t, raise, file_error, out_of_memory, result_done, some_failed, stopped_early
  use dst_hdf5_library, only: hid_t, h5fclose, h5f_acc_trunc, h5t_ieee_f64le, h5t_std_i32le
  use dst_hdf5_tools, only: hdf5_t, start_hdf5, open_file, failure_reason, put_attribute, create_group, dataset_t, &
    create_dataset, append, append_texts, make_scale, attach_scale
  use dst_hdf5_origin, only: sweep_state_t, state_of_sweep
  use dst_hdf5_writer, only: run_metadata_t, write_metadata, put_ending
  use dst_kinds, only: int64, real64
  use dst_result_file, only: result_file_t, check_target
  use dst_schema, only: schema
  use dst_signals, only: is_told_to_end, stopped_by
  use dst_sweep, only: sweep_t, case_t, axis_t, value_count, value_quantities, wall_time_value, table_quantities
  use dst_sweep_shard, only: head_t, index_t, layout_t, layout_of, shard_t, without_concern, open_records, &
    read_record, shards_of
  use dst_text, only: integer_text
  use dst_writer, only: quantity_t, absent
  implicit none
  private

  public :: block_of, merge_shards, look_at_result, is_of_unfinished_sweep

  !> Number of cases in memory; number of values of their series or cycles in memory.
  integer, parameter :: usual_block = 16384, most_table_values = 4000000
  !> result_code of a case that has not been run.
  integer, parameter :: not_run = -1

  type :: output_t
    integer(hid_t) :: file = -1
    type(dataset_t), allocatable :: columns(:)   !! number of the case, parameters, values, result code
    type(dataset_t), allocatable :: table(:)     !! of the series or of the cycles
    type(dataset_t) :: count                     !! of the cycles of a case
    type(dataset_t) :: failed, failure
  end type output_t

  !> Some cases in the order in which they are written.
  type :: block_t
    integer :: first = 0, count = 0
    real(real64), allocatable :: columns(:, :)   !! (case, column)
    real(real64), allocatable :: table(:, :, :)  !! (row, case, column)
    integer, allocatable :: rows(:)              !! of the table of each case
    type(path_t), allocatable :: message(:)
  end type block_t

contains

  !> Whether a file is of an unfinished sweep: cases are missing, or there are still shards next to it.
  logical function is_of_unfinished_sweep(result_file)
    character(*), intent(in) :: result_file
    type(sweep_state_t) :: state
    type(path_t), allocatable :: files(:)

    state = state_of_sweep(place_of(result_file))
    call shards_of(result_file, files)
    is_of_unfinished_sweep = state%identity /= '' .and. (state%complete == 0 .or. size(files) > 0)
  end function is_of_unfinished_sweep

  !> Refuse to replace the file with the name of the result, except a partial result of this sweep. If a complete one still has
  !> shards next to it, `index` says that all cases are finished; but not for one of several processes, which `is_shared`.
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
      index%is_in_result = .true.
      index%state = without_concern
      index%done = state%done
      index%failed = state%failed
    end if
    deallocate (error)
  end subroutine look_at_result

  !> Write the cases of the shards to `result_file`.
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
    type(hdf5_t) :: h5
    integer :: status

    call file%claim(result_file, .true., error)
    if (allocated(error)) return
    if (.not. overwrite) call check_replaceable(result_file, head, index, error)
    if (allocated(error)) then
      call file%discard()
      return
    end if
    call start_hdf5(h5)
    call open_file(file%path(), h5f_acc_trunc, output%file, h5)
    call write_metadata(output%file, metadata, h5)
    call create_columns(output, sweep, h5)
    call copy_cases(output, sweep, files, index, h5, error)
    call describe_sweep(output, sweep, head, index, h5)
    if (h5%status < 0) call raise_cannot_write(result_file, error)
    status = 0
    if (output%file >= 0) status = h5fclose(output%file)
    if (status < 0) call raise_cannot_write(result_file, error)
    if (.not. allocated(error)) call file%put_in_place(error)
    call file%discard()
  end subroutine merge_shards

  !> Only a partial result of the same sweep may be replaced, and none that has more cases. No other process writes it meanwhile.
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

  !> Number of cases that are read at once.
  integer function block_of(sweep)
    type(sweep_t), intent(in) :: sweep

    block_of = min(sweep%cases, usual_block)
    if (sweep%table_rows() > 0) block_of = max(1, min(block_of, most_table_values/max(1, sweep%table_values())))
  end function block_of

  subroutine create_columns(output, sweep, h5)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    type(hdf5_t), intent(inout) :: h5
    type(quantity_t), allocatable :: columns(:)
    integer(hid_t), allocatable :: places(:), stored_as(:)
    integer(hid_t) :: group, summary, failures
    integer :: i, axes

    axes = size(sweep%axes)
    allocate (columns, source=[quantity_t('case', '1', 'number of the case'), (parameter_of(sweep%axes(i)), i=1, axes), &
      value_quantities(), quantity_t('result_code', '1', '0: done; -1: not run; else why it failed, see dynstiction help errors')])
    allocate (output%columns(size(columns)), output%table(0))
    call create_group(output%file, 'sweep', group, h5)
    call create_group(group, 'summary', summary, h5)
    allocate (places, source=[group, (group, i=1, axes), (merge(group, summary, i == wall_time_value), i=1, value_count), group])
    allocate (stored_as, source=[h5t_std_i32le, (h5t_ieee_f64le, i=2, size(columns) - 1), h5t_std_i32le])
    call put_attribute(group, 'grid', grid_text(sweep), h5)
    call put_attribute(group, 'parameters', sweep%parameters(), h5)
    do i = 1, size(columns)
      call create_dataset(places(i), columns(i), block_of(sweep), output%columns(i), h5, stored_as(i), whole_chunks=.true.)
      if (i == 1) call make_scale(output%columns(1), 'case', h5)
      if (i > 1) call attach_scale(output%columns(i), output%columns(1), 1, h5)
    end do
    call create_group(group, 'failures', failures, h5)
    call create_dataset(failures, quantity_t('case', '1', 'number of a case that failed'), 1024, output%failed, h5, h5t_std_i32le)
    call make_scale(output%failed, 'case', h5)
    call create_dataset(failures, quantity_t('result_text', '1', 'why it failed'), 1024, output%failure, h5)
    call attach_scale(output%failure, output%failed, 1, h5)
    if (sweep%keeps_series) then
      call create_series(output, sweep, group, h5)
    else if (sweep%keeps_cycles) then
      call create_cycles(output, sweep, group, h5)
    end if
  end subroutine create_columns

  type(quantity_t) function parameter_of(axis) result(parameter)
    type(axis_t), intent(in) :: axis

    associate (key => schema(axis%key))
      parameter = quantity_t(axis%name, key%unit, key%meaning)
      if (key%unit == '') parameter%units = '1'
    end associate
  end function parameter_of

  subroutine create_series(output, sweep, group, h5)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    integer(hid_t), intent(in) :: group
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: time
    integer(hid_t) :: series

    call create_group(group, 'series', series, h5)
    call create_dataset(series, quantity_t('time', 's', 'time of the samples'), min(8192, sweep%table_rows()), time, h5, &
      h5t_ieee_f64le)
    call make_scale(time, 'time', h5)
    call append(time, sweep%table_rows(), real(sweep%series_times(), real64), h5)
    call create_table(output, sweep, series, time, h5)
  end subroutine create_series

  !> The cycles of a case in a row; the last one that was run is in the last place that has one.
  subroutine create_cycles(output, sweep, group, h5)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    integer(hid_t), intent(in) :: group
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: cycle
    integer(hid_t) :: cycles
    integer :: i

    associate (rows => sweep%table_rows())
      call create_group(group, 'cycles', cycles, h5)
      call create_dataset(cycles, quantity_t('cycle', '1', 'number of the cycle among those that are kept'), rows, cycle, h5, &
        h5t_std_i32le)
      call make_scale(cycle, 'cycle', h5)
      call append(cycle, rows, [(real(i, real64), i=1, rows)], h5)
    end associate
    call create_dataset(cycles, quantity_t('count', '1', 'cycles that are kept of the case'), block_of(sweep), output%count, h5, &
      h5t_std_i32le, whole_chunks=.true.)
    call attach_scale(output%count, output%columns(1), 1, h5)
    call create_table(output, sweep, cycles, cycle, h5)
  end subroutine create_cycles

  !> The samples or cycles of the cases, a row for each case.
  subroutine create_table(output, sweep, group, scale, h5)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    integer(hid_t), intent(in) :: group
    type(dataset_t), intent(in) :: scale          !! of the samples or cycles
    type(hdf5_t), intent(inout) :: h5
    integer, parameter :: usual_chunk = 16384     ! values
    type(quantity_t), allocatable :: columns(:)
    integer :: i, rows

    rows = sweep%table_rows()
    allocate (columns, source=table_quantities(sweep))
    deallocate (output%table)
    allocate (output%table(size(columns)))
    do i = 1, size(columns)
      call create_dataset(group, columns(i), max(1, usual_chunk/rows), output%table(i), h5, h5t_ieee_f64le, row_length=rows)
      call attach_scale(output%table(i), output%columns(1), 1, h5)
      call attach_scale(output%table(i), scale, 2, h5)
    end do
  end subroutine create_table

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

  subroutine copy_cases(output, sweep, files, index, h5, error)
    type(output_t), intent(inout) :: output
    type(sweep_t), intent(in) :: sweep
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    type(hdf5_t), intent(inout) :: h5
    type(error_t), allocatable, intent(out) :: error
    type(block_t) :: block
    type(layout_t) :: layout
    integer :: first, length, no_memory

    layout = layout_of(sweep)
    length = index%block
    allocate (block%message(length), block%columns(length, size(output%columns)), block%rows(length))
    allocate (block%table(sweep%table_rows(), length, size(output%table)), stat=no_memory)
    if (no_memory /= 0) then
      call raise(error, out_of_memory, 'no memory for the '//merge('cycles', 'series', sweep%keeps_cycles)//' of '// &
        integer_text(length)//' cases: the shards keep all finished cases: merge them on a machine with more')
      return
    end if
    do first = 1, sweep%cases, length
      if (h5%status < 0) return
      if (is_told_to_end()) then
        call raise(error, stopped_early, stopped_by()//' while the result was written: the shards '// &
          'keep all finished cases: start it again')
        return
      end if
      block%first = first
      block%count = min(length, sweep%cases - first + 1)
      call clear(block, sweep)
      call read_block(files, index, layout, block, error)
      if (allocated(error)) return
      call write_block(output, block, h5)
    end do
  end subroutine copy_cases

  !> Reset a block to cases that have not been run.
  subroutine clear(block, sweep)
    type(block_t), intent(inout) :: block
    type(sweep_t), intent(in) :: sweep
    real(real64) :: nan
    integer :: i

    nan = absent()
    block%columns = nan
    block%table = nan
    block%rows = 0
    do i = 1, block%count
      associate (number => block%first + i - 1, axes => size(sweep%axes))
        block%columns(i, :axes + 1) = [real(number, real64), real(sweep%coordinates(number), real64)]
      end associate
    end do
    block%columns(:, size(block%columns, 2)) = not_run
  end subroutine clear

  !> Read the records of a block, shard by shard: there may be more shards than a process can have open. If a case has several
  !> records, the first counts.
  subroutine read_block(files, index, layout, block, error)
    type(path_t), intent(in) :: files(:)
    type(index_t), intent(in) :: index
    type(layout_t), intent(in) :: layout
    type(block_t), intent(inout) :: block
    type(error_t), allocatable, intent(out) :: error
    type(case_t) :: case
    type(shard_t), target :: reader
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
    integer :: j, n, last

    n = case%number - block%first + 1
    last = size(block%columns, 2)
    if (nint(block%columns(n, last)) /= not_run) return
    block%columns(n, last - value_count:last - 1) = real(case%values, real64)
    block%columns(n, last) = real(case%result_code, real64)
    if (case%result_code /= result_done) block%message(n)%text = case%result_text
    if (layout%columns > 0) block%rows(n) = size(case%table, 2)
    do j = 1, layout%columns
      block%table(:size(case%table, 2), n, j) = real(case%table(j, :), real64)
    end do
  end subroutine take_case

  subroutine write_block(output, block, h5)
    type(output_t), intent(inout) :: output
    type(block_t), intent(in) :: block
    type(hdf5_t), intent(inout) :: h5
    integer, allocatable :: failed(:)
    type(path_t), allocatable :: messages(:)
    integer :: i, last

    last = size(output%columns)
    do i = 1, last
      call append(output%columns(i), block%count, block%columns(:block%count, i), h5)
    end do
    if (output%count%id >= 0) call append(output%count, block%count, real(block%rows(:block%count), real64), h5)
    do i = 1, size(output%table)
      call append(output%table(i), block%count, block%table(:, :, i), h5)
    end do
    failed = pack([(i, i=1, block%count)], block%columns(:block%count, last) > 0.0_real64)
    allocate (messages(size(failed)))
    do i = 1, size(failed)
      messages(i)%text = block%message(failed(i))%text
    end do
    call append(output%failed, size(failed), real(failed + block%first - 1, real64), h5)
    call append_texts(output%failure, messages, h5)
  end subroutine write_block

  !> How much of the sweep is finished.
  subroutine describe_sweep(output, sweep, head, index, h5)
    type(output_t), intent(in) :: output
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    type(index_t), intent(in) :: index
    type(hdf5_t), intent(inout) :: h5
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
    call put_attribute(output%file, 'sweep_identity', head%identity, h5)
    call put_attribute(output%file, 'cases_done', index%done, h5)
    call put_attribute(output%file, 'cases_failed', index%failed, h5)
    call put_attribute(output%file, 'begun', utc_at(index%begun), h5)
    call put_attribute(output%file, 'ended', utc_at(index%ended), h5)
    call put_ending(output%file, code, text, h5)
    call put_attribute(output%file, 'complete', merge(1, 0, index%done == sweep%cases), h5)
  end subroutine describe_sweep
end module dst_sweep_file
