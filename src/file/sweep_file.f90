!> The file of a sweep, or of a share of it: one row for each case, in the order of the cases.
!>
!> Rows wait in memory until there are many, and are then written in their order, so that the memory hardly grows with the number
!> of cases. A case that has not been run has the datasets' fill values: NaN, and result_code -1. The file gets its name when it is
!> made whole (dst_result_file); the sweep then goes on in a new file, to which the rows of the former are copied. A sweep that is
!> started again goes on in the same way, and so does a merge with rows of shares.
module dst_sweep_file
  use, intrinsic :: iso_fortran_env, only: int8
  use dst_disk, only: path_t, with_remedy
  use dst_ending, only: check_ending
  use dst_errors, only: error_t, raise, file_error, out_of_memory, result_done, some_failed, stopped_early
  use dst_hdf5_tools, only: hid_t, hsize_t, hdf5_t, create_file, open_existing, close_file, failure_reason, as_double, as_int32, &
    put_attribute, get_attribute, create_group, dataset_t, create_dataset, open_dataset, write_rows, read_rows, append_text, &
    text_of_row, attach_scale
  use dst_hdf5_writer, only: run_metadata_t, write_metadata, put_ending
  use dst_kinds, only: int64, real64
  use dst_result_file, only: result_file_t
  use dst_schema, only: schema
  use dst_share, only: share_t
  use dst_sweep, only: sweep_t, case_t, axis_t, value_count, value_quantities, wall_time_value, table_quantities
  use dst_text, only: integer_text
  use dst_writer, only: quantity_t, absent
  implicit none
  private

  public :: sweep_file_t, sweep_head_t, read_head, not_run

  !> result_code of a case that has not been run.
  integer, parameter :: not_run = -1
  !> Rows of a chunk; numbers in a chunk of samples or cycles; bytes of the waiting rows of a table.
  integer, parameter :: most_rows = 2048, usual_chunk = 16384, most_bytes = 16*1024**2
  integer, parameter :: identity_length = 24, build_length = 16

  !> What the attributes of a file say about its sweep.
  type :: sweep_head_t
    character(identity_length) :: identity = ''   !! of deck and points; '' if the file is of no sweep
    character(build_length) :: build = ''         !! of the program and the machine's arithmetic
    character(:), allocatable :: share            !! 'I/N'
    integer :: cases = 0                          !! of the share
    integer :: done = 0, failed = 0               !! finished cases, and how many of them failed
    logical :: complete = .false.
  end type sweep_head_t

  !> A column of a table.
  type :: column_t
    type(quantity_t) :: quantity
    character(24) :: group = ''                   !! in which it is, like sweep/summary
    logical :: is_integer = .false.
    real(real64) :: fill = 0.0_real64
    type(dataset_t) :: dataset = dataset_t()
  end type column_t

  !> Columns with rows of one length, and their rows that wait to be written.
  type :: table_t
    type(column_t), allocatable :: columns(:)
    integer :: rows = 0, row_length = 1           !! rows, and numbers of one column in a row
    integer :: chunk_rows = 1
    logical :: is_inner = .false.                 !! the columns have a second dimension: samples or cycles
    integer :: count = 0
    integer, allocatable :: waiting(:), place(:)  !! rows in ascending order, and the places of their values
    real(real64), allocatable :: values(:, :, :)  !! (number in a row, place, column)
  contains
    procedure :: put_row
    procedure :: write_waiting
    procedure :: copy_former
  end type table_t

  !> The file while the sweep is run or merged.
  type :: sweep_file_t
    type(share_t) :: share
    integer :: rows = 0, done = 0, failed = 0     !! cases; finished ones, and how many of them failed
    integer(int8), allocatable :: code(:)         !! result_code of each row
    logical :: is_changed = .false.               !! there are rows that the file under the name does not have
    type(path_t), allocatable, private :: message(:)   !! of each row, if its case failed
    type(sweep_t), pointer, private :: sweep => null()
    type(sweep_head_t), private :: head
    type(run_metadata_t), private :: metadata
    type(result_file_t), private :: file
    integer(hid_t), private :: id = -1
    type(table_t), private :: tables(2)           !! values; samples or cycles
  contains
    procedure :: open => open_sweep_file
    procedure :: put
    procedure :: take_rows
    procedure :: window
    procedure :: make_whole
    procedure :: go_on
    procedure :: discard
  end type sweep_file_t

contains

  !> Read what a file says about its sweep. A file of no sweep has no identity; `reason` says why it cannot be read.
  subroutine read_head(file_name, head, reason)
    character(*), intent(in) :: file_name
    type(sweep_head_t), intent(out) :: head
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    character(:), allocatable :: identity, build
    type(dataset_t) :: codes
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    integer :: complete

    head%share = ''
    call check_ending(file_name, reason)
    if (allocated(reason)) return
    call open_existing(file_name, file, h5)
    if (h5%status < 0) then
      reason = failure_reason()
      return
    end if
    call get_attribute(file, 'sweep_identity', identity, h5)
    call get_attribute(file, 'sweep_build', build, h5)
    call get_attribute(file, 'share', head%share, h5)
    call get_attribute(file, 'complete', complete, h5)
    call get_attribute(file, 'cases_done', head%done, h5)
    call get_attribute(file, 'cases_failed', head%failed, h5)
    call open_dataset(file, 'sweep/result_code', codes, h5)
    if (h5%status >= 0) then
      head%cases = int(codes%rows)
      head%identity = identity
      head%build = build
      head%complete = complete == 1
    end if
    call close_file(file, h5)
  end subroutine read_head

  !> Begin the file of a share; `goes_on`: with the rows of the file that has its name.
  subroutine open_sweep_file(self, name, sweep, share, head, metadata, goes_on, overwrite, error)
    class(sweep_file_t), intent(inout) :: self
    character(*), intent(in) :: name
    type(sweep_t), intent(in), target :: sweep
    type(share_t), intent(in) :: share
    type(sweep_head_t), intent(in) :: head             !! identity and build
    type(run_metadata_t), intent(in) :: metadata
    logical, intent(in) :: goes_on, overwrite
    type(error_t), allocatable, intent(out) :: error
    integer :: status

    self%sweep => sweep
    self%share = share
    self%head = head
    self%metadata = metadata
    self%rows = share%size(sweep%cases)
    allocate (self%code(self%rows), self%message(self%rows), stat=status)
    if (status /= 0) then
      call raise(error, out_of_memory, 'no memory for the list of '//integer_text(self%rows)// &
        ' cases: divide the sweep with --share I/N')
      return
    end if
    self%code = not_run
    call lay_out(self)
    if (goes_on) then
      call self%file%claim_again(name, error)
      if (.not. allocated(error)) call take_former(self, error)
    else
      call self%file%claim(name, overwrite, error)
    end if
    if (.not. allocated(error)) call create(self, goes_on, error)
  end subroutine open_sweep_file

  !> The tables, with no rows yet.
  subroutine lay_out(self)
    class(sweep_file_t), intent(inout) :: self
    type(quantity_t), allocatable :: quantities(:)
    type(quantity_t) :: values(value_count)
    real(real64) :: nan
    character(24) :: group
    integer :: i, rows

    nan = absent()
    values = value_quantities()
    allocate (self%tables(1)%columns, source=[(column_t(values(i), 'sweep/summary', .false., nan), i=1, value_count), &
      column_t(quantity_t('result_code', '1', '0: done; -1: not run; else why it failed, see dynstiction help errors'), 'sweep', &
      .true., real(not_run, real64))])
    self%tables(1)%columns(wall_time_value)%group = 'sweep'
    self%tables%rows = self%rows
    self%tables(1)%chunk_rows = (self%rows - 1)/((self%rows - 1)/most_rows + 1) + 1
    group = inner_group(self)
    if (self%sweep%keeps_cycles) self%tables(1)%columns = [self%tables(1)%columns, &
      column_t(quantity_t('count', '1', 'cycles that are kept of the case'), group, .true., 0.0_real64)]
    allocate (quantities, source=table_quantities(self%sweep))
    allocate (self%tables(2)%columns, source=[(column_t(quantities(i), group, .false., nan), i=1, size(quantities))])
    self%tables(2)%is_inner = size(quantities) > 0
    self%tables(2)%row_length = max(1, self%sweep%table_rows())
    self%tables(2)%chunk_rows = max(1, min(self%rows, usual_chunk/self%tables(2)%row_length))
    do i = 1, size(self%tables)
      associate (table => self%tables(i))
        rows = max(1, min(self%rows, most_bytes/8/max(1, table%row_length*size(table%columns))))
        allocate (table%waiting(rows), table%place(rows), table%values(table%row_length, rows, size(table%columns)))
      end associate
    end do
  end subroutine lay_out

  !> Which rows the file under the name has.
  subroutine take_former(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(sweep_head_t) :: head
    character(:), allocatable :: reason
    type(hdf5_t) :: h5
    integer(hid_t) :: file

    call read_head(self%file%former_path(), head, reason)
    if (.not. allocated(reason)) then
      if (head%identity /= self%head%identity .or. head%build /= self%head%build) reason = 'it was replaced meanwhile'
    end if
    if (.not. allocated(reason)) then
      call open_existing(self%file%former_path(), file, h5)
      call read_codes(file, 1, self%code, h5)
      call take_messages(self, file, self%share, h5)
      if (h5%status < 0) reason = failure_reason()
      call close_file(file, h5)
    end if
    if (allocated(reason)) then
      call raise(error, file_error, self%file%name//': cannot go on: '//reason)
      call self%file%discard()
      return
    end if
    self%done = count(self%code /= not_run)
    self%failed = count(self%code > 0)
  end subroutine take_former

  !> The result codes of rows of a file.
  subroutine read_codes(file, first, codes, h5)
    integer(hid_t), intent(in) :: file
    integer, intent(in) :: first
    integer(int8), intent(out) :: codes(:)
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: dataset
    real(real64), allocatable :: values(:)

    allocate (values(size(codes)), source=real(not_run, real64))
    call open_dataset(file, 'sweep/result_code', dataset, h5)
    call read_rows(dataset, first - 1_hsize_t, size(values, kind=hsize_t), values, h5)
    if (h5%status >= 0) codes = nint(values, int8)
  end subroutine read_codes

  !> Why cases of a share failed, unless they are done here.
  subroutine take_messages(self, file, share, h5)
    class(sweep_file_t), intent(inout) :: self
    integer(hid_t), intent(in) :: file
    type(share_t), intent(in) :: share
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: cases, texts
    real(real64), allocatable :: number(:)
    integer :: i, row

    call open_dataset(file, 'sweep/failures/case', cases, h5)
    call open_dataset(file, 'sweep/failures/result_text', texts, h5)
    if (h5%status < 0) return
    allocate (number(min(cases%rows, texts%rows)))
    call read_rows(cases, 0_hsize_t, size(number, kind=hsize_t), number, h5)
    do i = 1, size(number)
      if (h5%status < 0 .or. modulo(nint(number(i)) - share%number, share%count) /= 0) cycle
      row = (nint(number(i)) - self%share%number)/self%share%count + 1
      if (row >= 1 .and. row <= self%rows) self%message(row)%text = text_of_row(texts, i, h5)
    end do
  end subroutine take_messages

  !> Create the file with all its rows, and copy those that the former one has.
  subroutine create(self, has_former, error)
    class(sweep_file_t), intent(inout) :: self
    logical, intent(in) :: has_former
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer(hid_t) :: former
    integer :: i

    self%is_changed = .false.
    call create_file(self%file%path(), self%id, h5)
    call write_metadata(self%id, self%metadata, h5)
    call create_columns(self, h5)
    if (has_former) then
      call open_existing(self%file%former_path(), former, h5)
      do i = 1, size(self%tables)
        call self%tables(i)%copy_former(former, self%code, h5)
      end do
      if (h5%status >= 0) call close_file(former, h5)
    end if
    if (h5%status < 0) call give_up(self, failure_reason(), error)
  end subroutine create

  !> After a failure HDF5 cannot be trusted to close its file: it is abandoned, and the former one stays.
  subroutine give_up(self, reason, error)
    class(sweep_file_t), intent(inout) :: self
    character(*), intent(in) :: reason
    type(error_t), allocatable, intent(out) :: error

    call raise(error, file_error, self%file%name//': cannot write: '//with_remedy(reason))
    self%id = -1
    call self%file%discard()
  end subroutine give_up

  subroutine create_columns(self, h5)
    class(sweep_file_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: case, inner
    character(24) :: names(3)
    integer(hid_t) :: groups(3)
    integer :: i, k

    names = [character(24) :: 'sweep', 'sweep/summary', inner_group(self)]
    do k = 1, count(names /= '')
      call create_group(self%id, trim(names(k)), groups(k), h5)
    end do
    call put_attribute(groups(1), 'grid', grid_text(self), h5)
    call put_attribute(groups(1), 'parameters', self%sweep%parameters(), h5)
    call create_coordinates(self, groups(1), case, h5)
    if (self%tables(2)%is_inner) call create_inner_scale(self, groups(3), inner, h5)
    do k = 1, size(self%tables)
      associate (table => self%tables(k))
        do i = 1, size(table%columns)
          associate (column => table%columns(i))
            column%dataset = dataset_t(rows=self%rows, row_length=merge(table%row_length, 0, table%is_inner))
            call create_dataset(groups(findloc(names, column%group, dim=1)), column%quantity, table%chunk_rows, &
              column%dataset, h5, merge(as_int32, as_double, column%is_integer), whole_chunks=.true., fill=column%fill)
            call attach_scale(column%dataset, case, 0, h5)
            if (table%is_inner) call attach_scale(column%dataset, inner, 1, h5)
          end associate
        end do
      end associate
    end do
  end subroutine create_columns

  !> The group of the samples or cycles of all cases; '' if none are kept.
  pure function inner_group(self) result(name)
    class(sweep_file_t), intent(in) :: self
    character(12) :: name

    name = ''
    if (self%sweep%keeps_series) name = 'sweep/series'
    if (self%sweep%keeps_cycles) name = 'sweep/cycles'
  end function inner_group

  !> The number of each case, which is the scale of all columns, and its parameters.
  subroutine create_coordinates(self, group, case, h5)
    class(sweep_file_t), intent(in) :: self
    integer(hid_t), intent(in) :: group
    type(dataset_t), intent(out) :: case
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: parameters(size(self%sweep%axes))
    real(real64) :: values(min(self%rows, most_rows), size(self%sweep%axes))
    integer :: first, i, rows

    call create_dataset(group, quantity_t('case', '1', 'number of the case'), size(values, 1), case, h5, as_int32, &
      whole_chunks=.true., is_scale=.true.)
    do i = 1, size(parameters)
      call create_dataset(group, parameter_of(self%sweep%axes(i)), size(values, 1), parameters(i), h5, as_double, &
        whole_chunks=.true.)
      call attach_scale(parameters(i), case, 0, h5)
    end do
    do first = 0, self%rows - 1, size(values, 1)
      rows = min(size(values, 1), self%rows - first)
      associate (cases => self%share%case_of([(first + i, i=1, rows)]))
        do i = 1, rows
          values(i, :) = real(self%sweep%coordinates(cases(i)), real64)
        end do
        call write_rows(case, case%rows, int(rows, hsize_t), real(cases, real64), h5)
      end associate
      do i = 1, size(parameters)
        call write_rows(parameters(i), parameters(i)%rows, int(rows, hsize_t), values(:, i), h5)
      end do
    end do
  end subroutine create_coordinates

  type(quantity_t) function parameter_of(axis) result(parameter)
    type(axis_t), intent(in) :: axis

    associate (key => schema(axis%key))
      parameter = quantity_t(axis%name, key%unit, key%meaning)
      if (key%unit == '') parameter%units = '1'
    end associate
  end function parameter_of

  !> The scale of the samples or cycles of all cases: time, or the number of the cycle among those that are kept; the last cycle
  !> that was run is in the last place that has one.
  subroutine create_inner_scale(self, group, scale, h5)
    class(sweep_file_t), intent(in) :: self
    integer(hid_t), intent(in) :: group
    type(dataset_t), intent(out) :: scale
    type(hdf5_t), intent(inout) :: h5
    real(real64), allocatable :: values(:)
    integer :: i

    if (self%sweep%keeps_series) then
      values = real(self%sweep%series_times(), real64)
      call create_dataset(group, quantity_t('time', 's', 'time of the samples'), min(8192, size(values)), scale, h5, as_double, &
        is_scale=.true.)
    else
      values = [(real(i, real64), i=1, self%tables(2)%row_length)]
      call create_dataset(group, quantity_t('cycle', '1', 'number of the cycle among those that are kept'), size(values), &
        scale, h5, as_int32, is_scale=.true.)
    end if
    call write_rows(scale, 0_hsize_t, size(values, kind=hsize_t), values, h5)
  end subroutine create_inner_scale

  !> '40 40', or 'list', as the cases of a share are none of a grid.
  function grid_text(self) result(text)
    class(sweep_file_t), intent(in) :: self
    character(:), allocatable :: text
    integer :: i

    text = 'list'
    if (self%sweep%is_list .or. self%share%count > 1) return
    text = ''
    do i = 1, size(self%sweep%axes)
      text = text//integer_text(size(self%sweep%axes(i)%values))//' '
    end do
    text = trim(text)
  end function grid_text

  !> A finished case gets its row.
  subroutine put(self, case, error)
    class(sweep_file_t), intent(inout) :: self
    type(case_t), intent(in) :: case
    type(error_t), allocatable, intent(out) :: error
    real(real64) :: values(size(self%tables(1)%columns))
    real(real64), allocatable :: table(:, :)
    type(hdf5_t) :: h5
    integer :: row

    row = (case%number - self%share%number)/self%share%count + 1
    values(:value_count) = real(case%values, real64)
    values(value_count + 1) = real(case%result_code, real64)
    if (self%tables(2)%is_inner) then
      allocate (table(self%tables(2)%row_length, size(self%tables(2)%columns)), source=real(absent(), real64))
      if (allocated(case%table)) table(:size(case%table, 2), :) = real(transpose(case%table), real64)
      if (self%sweep%keeps_cycles) then
        values(value_count + 2) = 0.0_real64
        if (allocated(case%table)) values(value_count + 2) = real(size(case%table, 2), real64)
      end if
      call self%tables(2)%put_row(row, table, h5)
    end if
    call self%tables(1)%put_row(row, reshape(values, [1, size(values)]), h5)
    call note(self, row, case%result_code)
    if (case%result_code /= result_done) self%message(row)%text = case%result_text
    if (h5%status < 0) call give_up(self, failure_reason(), error)
  end subroutine put

  !> A row has a case with this result.
  subroutine note(self, row, result_code)
    class(sweep_file_t), intent(inout) :: self
    integer, intent(in) :: row, result_code

    if (self%code(row) == not_run) self%done = self%done + 1
    if (self%code(row) > 0) self%failed = self%failed - 1
    if (result_code > 0) self%failed = self%failed + 1
    self%code(row) = int(result_code, int8)
    self%is_changed = .true.
    if (result_code == result_done .and. allocated(self%message(row)%text)) deallocate (self%message(row)%text)
  end subroutine note

  !> Let a row wait; the rows that wait are written if there is no room for it.
  subroutine put_row(self, row, values, h5)
    class(table_t), intent(inout) :: self
    integer, intent(in) :: row
    real(real64), intent(in) :: values(:, :)      !! (number, column)
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    if (self%count == size(self%waiting)) call self%write_waiting(h5)
    self%count = self%count + 1
    do i = self%count, 2, -1
      if (self%waiting(i - 1) <= row) exit
      self%waiting(i) = self%waiting(i - 1)
      self%place(i) = self%place(i - 1)
    end do
    self%waiting(i) = row
    self%place(i) = self%count
    self%values(:, self%count, :) = values
  end subroutine put_row

  !> Write the rows that wait: successive rows of a chunk at once.
  subroutine write_waiting(self, h5)
    class(table_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    real(real64), allocatable :: values(:, :)
    integer :: first, last, i

    first = 1
    do while (first <= self%count)
      do last = first, self%count - 1
        if (self%waiting(last + 1) /= self%waiting(last) + 1 .or. modulo(self%waiting(last), self%chunk_rows) == 0) exit
      end do
      do i = 1, size(self%columns)
        values = self%values(:, self%place(first:last), i)
        call write_rows(self%columns(i)%dataset, self%waiting(first) - 1_hsize_t, size(values, 2, hsize_t), values, h5)
      end do
      first = last + 1
    end do
    self%count = 0
  end subroutine write_waiting

  subroutine open_columns(self, file, datasets, h5)
    type(table_t), intent(in) :: self
    integer(hid_t), intent(in) :: file
    type(dataset_t), intent(out) :: datasets(:)
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    do i = 1, size(datasets)
      call open_dataset(file, trim(self%columns(i)%group)//'/'//trim(self%columns(i)%quantity%name), datasets(i), h5, &
        merge(self%row_length, 0, self%is_inner))
    end do
  end subroutine open_columns

  !> Copy the chunks of a former file that have cases which were run.
  subroutine copy_former(self, former, codes, h5)
    class(table_t), intent(inout) :: self
    integer(hid_t), intent(in) :: former
    integer(int8), intent(in) :: codes(:)
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: datasets(size(self%columns))
    real(real64), allocatable :: values(:)
    integer(hsize_t) :: rows
    integer :: first, i

    call open_columns(self, former, datasets, h5)
    if (size(datasets) > 0) allocate (values(self%chunk_rows*self%row_length))
    do first = 0, self%rows - 1, self%chunk_rows
      rows = min(self%chunk_rows, self%rows - first)
      if (all(codes(first + 1:first + rows) == not_run)) cycle
      do i = 1, size(datasets)
        call read_rows(datasets(i), int(first, hsize_t), rows, values, h5)
        call write_rows(self%columns(i)%dataset, int(first, hsize_t), rows, values, h5)
      end do
    end do
  end subroutine copy_former

  !> Copy those cases of a share's file that are missing here, or failed here and not there, if their rows are from `first` to
  !> `last`. Only `window` rows are in memory at once.
  subroutine take_rows(self, file_name, share, first, last, error)
    class(sweep_file_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(share_t), intent(in) :: share
    integer, intent(in) :: first, last
    type(error_t), allocatable, intent(out) :: error
    integer(int8), allocatable :: codes(:)
    logical, allocatable :: is_wanted(:)
    integer, allocatable :: rows(:)
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    integer :: i, begin

    begin = share%size(first - 1) + 1
    allocate (rows, source=share%case_of([(i, i=begin, share%size(last))]))
    if (size(rows) == 0) return
    allocate (codes(size(rows)))
    call open_existing(file_name, file, h5)
    call read_codes(file, begin, codes, h5)
    if (h5%status >= 0) then
      is_wanted = codes /= not_run .and. (self%code(rows) == not_run .or. (self%code(rows) > 0 .and. codes == 0))
      if (any(is_wanted .and. codes > 0)) call take_messages(self, file, share, h5)
      do i = 1, size(self%tables)
        call copy_rows(self%tables(i), file, begin, rows, is_wanted, h5)
      end do
      do i = 1, size(rows)
        if (is_wanted(i)) call note(self, rows(i), int(codes(i)))
      end do
      if (h5%status >= 0) call close_file(file, h5)
    end if
    if (h5%status < 0) then
      call raise(error, file_error, file_name//': cannot be read: '//failure_reason()//': run this share again with --overwrite')
      call self%discard()
    end if
  end subroutine take_rows

  !> Copy wanted rows of a file, from its row `begin` on, to `rows`.
  subroutine copy_rows(table, file, begin, rows, is_wanted, h5)
    type(table_t), intent(inout) :: table
    integer(hid_t), intent(in) :: file
    integer, intent(in) :: begin, rows(:)
    logical, intent(in) :: is_wanted(:)
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: datasets(size(table%columns))
    real(real64), allocatable :: values(:, :)
    integer :: i

    allocate (values(table%row_length*size(rows), size(datasets)))
    call open_columns(table, file, datasets, h5)
    do i = 1, size(datasets)
      call read_rows(datasets(i), begin - 1_hsize_t, size(rows, kind=hsize_t), values(:, i), h5)
    end do
    if (table%count + count(is_wanted) > size(table%waiting)) call table%write_waiting(h5)
    do i = 1, size(rows)
      if (is_wanted(i) .and. h5%status >= 0 .and. size(datasets) > 0) &
        call table%put_row(rows(i), values((i - 1)*table%row_length + 1:i*table%row_length, :), h5)
    end do
  end subroutine copy_rows

  !> Number of rows that wait in memory at most.
  pure integer function window(self)
    class(sweep_file_t), intent(in) :: self

    window = min(size(self%tables(1)%waiting), size(self%tables(2)%waiting))
  end function window

  !> Write everything that is known, and give the file its name. Then it goes on, or is closed.
  subroutine make_whole(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer(int64), parameter :: no_state(0) = 0
    integer :: i

    do i = 1, size(self%tables)
      call self%tables(i)%write_waiting(h5)
    end do
    call write_failures(self, h5)
    call describe_sweep(self, h5)
    if (h5%status >= 0) call close_file(self%id, h5)
    if (h5%status < 0) then
      call give_up(self, failure_reason(), error)
    else
      self%id = -1
      call self%file%put_in_place(no_state, error)
    end if
  end subroutine make_whole

  !> Which cases failed, and why.
  subroutine write_failures(self, h5)
    class(sweep_file_t), intent(in) :: self
    type(hdf5_t), intent(inout) :: h5
    integer, parameter :: chunk = 1024
    type(dataset_t) :: cases, texts
    integer(hid_t) :: group
    integer :: i

    call create_group(self%id, 'sweep/failures', group, h5)
    call create_dataset(group, quantity_t('case', '1', 'number of a case that failed'), chunk, cases, h5, as_int32, is_scale=.true.)
    call create_dataset(group, quantity_t('result_text', '1', 'why it failed'), chunk, texts, h5)
    call attach_scale(texts, cases, 0, h5)
    do i = 1, self%rows
      if (self%code(i) <= 0) cycle
      call write_rows(cases, cases%rows, 1_hsize_t, [real(self%share%case_of(i), real64)], h5)
      call append_text(texts, self%message(i)%text, h5)
    end do
  end subroutine write_failures

  !> How much of the sweep or share is finished.
  subroutine describe_sweep(self, h5)
    class(sweep_file_t), intent(in) :: self
    type(hdf5_t), intent(inout) :: h5
    character(:), allocatable :: text
    integer :: code

    text = 'done'
    code = result_done
    if (self%failed > 0) then
      code = some_failed
      text = integer_text(self%failed)//' of '//integer_text(self%rows)//' cases failed'
    end if
    if (self%done < self%rows) then
      code = stopped_early
      text = integer_text(self%rows - self%done)//' of '//integer_text(self%rows)//' cases have not been run'
    end if
    call put_attribute(self%id, 'sweep_identity', self%head%identity, h5)
    call put_attribute(self%id, 'sweep_build', self%head%build, h5)
    call put_attribute(self%id, 'share', self%share%text(), h5)
    call put_attribute(self%id, 'cases_done', self%done, h5)
    call put_attribute(self%id, 'cases_failed', self%failed, h5)
    call put_ending(self%id, code, text, h5)
    call put_attribute(self%id, 'complete', merge(1, 0, self%done == self%rows), h5)
  end subroutine describe_sweep

  !> After the file was made whole: go on in a new one.
  subroutine go_on(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    call self%file%begin_next(error)
    if (.not. allocated(error)) call create(self, .true., error)
  end subroutine go_on

  !> The file under the name, if there is one, stays as it is.
  subroutine discard(self)
    class(sweep_file_t), intent(inout) :: self
    type(hdf5_t) :: h5

    call close_file(self%id, h5)
    self%id = -1
    call self%file%discard()
  end subroutine discard
end module dst_sweep_file
