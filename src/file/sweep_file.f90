!> The file of a sweep, or of a share of it: one row for each case, in the order of the cases.
!>
!> A case that has not been run has the datasets' fill values: NaN, and result_code -1. The file gets its name when it is made whole
!> (dst_result_file); the sweep then goes on in a new file, which takes the rows of the former. A sweep that is started again takes
!> them in the same way, and a merge those of shares.
module dst_sweep_file
  use, intrinsic :: iso_c_binding, only: nul => c_null_char
  use, intrinsic :: iso_fortran_env, only: int8
  use dst_disk, only: path_t, with_remedy
  use dst_ending, only: check_ending
  use dst_errors, only: error_t, raise, file_error, out_of_memory, result_done, some_failed, stopped_early
  use dst_hdf5_table, only: table_t
  use dst_hdf5_tools, only: hid_t, hsize_t, hdf5_t, open_file, close_file, failure_reason, as_text, as_double, as_int32, &
    put_attribute, get_value, create_group, dataset_t, column_t, create_column, open_dataset, write_rows, read_rows, append_text, &
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
    integer :: window = 1                         !! number of rows that wait in memory at most
  contains
    procedure :: open => open_sweep_file
    procedure :: put
    procedure :: take_rows
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
    call open_file(file_name, .false., file, h5)
    if (h5%status < 0) then
      reason = failure_reason()
      return
    end if
    call get_value(file, 'sweep_identity', identity, h5)
    call get_value(file, 'sweep_build', build, h5)
    call get_value(file, 'share', head%share, h5)
    call get_value(file, 'complete', complete, h5)
    call get_value(file, 'cases_done', head%done, h5)
    call get_value(file, 'cases_failed', head%failed, h5)
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
    allocate (self%code(self%rows), stat=status)
    if (status == 0) allocate (self%message(self%rows), stat=status)
    if (status /= 0) then
      call raise(error, out_of_memory, 'no memory for the list of '//integer_text(self%rows)// &
        ' cases: divide the sweep with --share I/N')
      return
    end if
    self%code = not_run
    call lay_out(self)
    if (goes_on) then
      call self%file%claim_again(name, error)
    else
      call self%file%claim(name, overwrite, error)
    end if
    if (goes_on .and. .not. allocated(error)) call check_former(self, error)
    if (.not. allocated(error)) call create(self, error)
    if (goes_on .and. .not. allocated(error)) call take_former(self, error)
  end subroutine open_sweep_file

  !> The tables, with no rows yet.
  subroutine lay_out(self)
    class(sweep_file_t), intent(inout) :: self
    type(quantity_t), allocatable :: quantities(:)
    type(quantity_t) :: values(value_count)
    real(real64) :: nan
    character(24) :: group
    integer :: i

    nan = absent()
    values = value_quantities()
    group = inner_group(self)
    allocate (self%tables(1)%columns, source=[(column_t(values(i), 'sweep/summary', as_double, nan), i=1, value_count), &
      column_t(quantity_t('result_code', '1', '0: done; -1: not run; else why it failed, see dynstiction help errors'), 'sweep', &
      as_int32, real(not_run, real64))])
    self%tables(1)%columns(wall_time_value)%group = 'sweep'
    if (self%sweep%keeps_cycles) self%tables(1)%columns = [self%tables(1)%columns, &
      column_t(quantity_t('count', '1', 'cycles that are kept of the case'), group, as_int32)]
    self%tables(1)%chunk_rows = (self%rows - 1)/((self%rows - 1)/most_rows + 1) + 1
    allocate (quantities, source=table_quantities(self%sweep))
    allocate (self%tables(2)%columns, source=[(column_t(quantities(i), group, as_double, nan), i=1, size(quantities))])
    self%tables(2)%row_length = self%sweep%table_rows()
    self%tables(2)%chunk_rows = max(1, min(self%rows, usual_chunk/max(1, self%tables(2)%row_length)))
    self%tables%rows = self%rows
    self%window = min(self%rows, most_bytes/8/size(self%tables(1)%columns))
    if (size(quantities) > 0) self%window = max(1, min(self%window, most_bytes/8/(self%tables(2)%row_length*size(quantities))))
  end subroutine lay_out

  !> The file under the name must still be the one that was found.
  subroutine check_former(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(sweep_head_t) :: head
    character(:), allocatable :: reason

    call read_head(self%file%place, head, reason)
    if (.not. allocated(reason)) then
      if (head%identity == self%head%identity .and. head%build == self%head%build) return
      reason = 'it was replaced meanwhile'
    end if
    call raise(error, file_error, self%file%name//': cannot go on: '//reason)
    call self%file%discard()
  end subroutine check_former

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
      row = self%share%row_of(nint(number(i)))
      if (row >= 1 .and. row <= self%rows) self%message(row)%text = text_of_row(texts, i, h5)
    end do
  end subroutine take_messages

  !> Create the file with all its rows.
  subroutine create(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5

    call open_file(self%file%path(), .true., self%id, h5)
    call write_metadata(self%id, self%metadata, h5)
    call create_columns(self, h5)
    if (h5%status < 0) call give_up(self, failure_reason(), error)
  end subroutine create

  !> Take the rows that the file under the name has.
  subroutine take_former(self, error)
    class(sweep_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    integer :: first

    do first = 1, self%rows, self%window
      if (.not. allocated(error)) call self%take_rows(self%file%place, self%share, first, error)
    end do
    self%is_changed = .false.
  end subroutine take_former

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
    type(dataset_t) :: scales(2)
    integer(hid_t) :: group
    integer :: k

    group = create_group(self%id, 'sweep'//nul, h5)
    call put_attribute(group, 'grid', grid_text(self), h5)
    call put_attribute(group, 'parameters', self%sweep%parameters(), h5)
    call create_coordinates(self, scales(1), h5)
    if (inner_group(self) /= '') call create_inner_scale(self, scales(2), h5)
    do k = 1, size(self%tables)
      call self%tables(k)%create(self%id, self%window, h5, scales(:k))
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
  subroutine create_coordinates(self, case, h5)
    class(sweep_file_t), intent(in) :: self
    type(dataset_t), intent(out) :: case
    type(hdf5_t), intent(inout) :: h5
    type(table_t) :: table
    real(real64) :: values(1, 1 + size(self%sweep%axes))
    integer :: i

    allocate (table%columns, source=[column_t(quantity_t('case', '1', 'number of the case'), 'sweep', as_int32), &
      (column_t(parameter_of(self%sweep%axes(i)), 'sweep'), i=1, size(self%sweep%axes))])
    table%chunk_rows = min(self%rows, most_rows)
    call table%create(self%id, table%chunk_rows, h5)
    do i = 1, self%rows
      values(1, 1) = real(self%share%case_of(i), real64)
      values(1, 2:) = real(self%sweep%coordinates(self%share%case_of(i)), real64)
      call table%put_row(int(i, hsize_t), values, h5)
    end do
    call table%write_waiting(h5)
    case = table%columns(1)%dataset
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
  subroutine create_inner_scale(self, scale, h5)
    class(sweep_file_t), intent(in) :: self
    type(dataset_t), intent(out) :: scale
    type(hdf5_t), intent(inout) :: h5
    type(column_t) :: column
    real(real64), allocatable :: values(:)
    integer :: i

    if (self%sweep%keeps_series) then
      values = real(self%sweep%series_times(), real64)
      column = column_t(quantity_t('time', 's', 'time of the samples'), inner_group(self))
    else
      values = [(real(i, real64), i=1, self%tables(2)%row_length)]
      column = column_t(quantity_t('cycle', '1', 'number of the cycle among those that are kept'), inner_group(self), as_int32)
    end if
    call create_column(self%id, column, min(8192, size(values)), .true., h5)
    scale = column%dataset
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

    row = self%share%row_of(case%number)
    values(:value_count) = real(case%values, real64)
    values(value_count + 1) = real(case%result_code, real64)
    if (size(self%tables(2)%columns) > 0) then
      allocate (table(self%tables(2)%row_length, size(self%tables(2)%columns)), source=real(absent(), real64))
      if (allocated(case%table)) table(:size(case%table, 2), :) = real(transpose(case%table), real64)
      if (self%sweep%keeps_cycles) then
        values(value_count + 2) = 0.0_real64
        if (allocated(case%table)) values(value_count + 2) = real(size(case%table, 2), real64)
      end if
      call self%tables(2)%put_row(int(row, hsize_t), table, h5)
    end if
    call self%tables(1)%put_row(int(row, hsize_t), reshape(values, [1, size(values)]), h5)
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
    if (self%code(row) /= result_code) self%is_changed = .true.
    self%code(row) = int(result_code, int8)
    if (result_code == result_done .and. allocated(self%message(row)%text)) deallocate (self%message(row)%text)
  end subroutine note

  !> Take the cases of a share's file, except those that failed there and not here, if their rows are among the `window` ones from
  !> `first` on.
  subroutine take_rows(self, file_name, share, first, error)
    class(sweep_file_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(share_t), intent(in) :: share
    integer, intent(in) :: first
    type(error_t), allocatable, intent(out) :: error
    type(dataset_t) :: column
    real(real64), allocatable :: values(:)
    integer(int8), allocatable :: codes(:)
    logical, allocatable :: is_wanted(:)
    integer, allocatable :: rows(:)
    type(hdf5_t) :: from, to
    integer(hid_t) :: file
    integer :: i, begin

    begin = share%size(self%share%case_of(first) - 1) + 1
    associate (last => share%size(self%share%case_of(min(self%rows, first + self%window - 1))))
      allocate (rows, source=self%share%row_of(share%case_of([(i, i=begin, last)])))
    end associate
    if (size(rows) == 0) return
    call open_file(file_name, .false., file, from)
    allocate (values(size(rows)), source=real(not_run, real64))
    call open_dataset(file, 'sweep/result_code', column, from)
    call read_rows(column, begin - 1_hsize_t, size(rows, kind=hsize_t), values, from)
    codes = nint(values, int8)
    is_wanted = codes == result_done .or. (codes > 0 .and. self%code(rows) /= result_done)
    if (any(is_wanted .and. codes > 0)) call take_messages(self, file, share, from)
    do i = 1, size(self%tables)
      if (any(is_wanted)) call self%tables(i)%take_rows(file, int(begin, hsize_t), int(rows, hsize_t), is_wanted, from, to)
    end do
    do i = 1, size(rows)
      if (is_wanted(i) .and. from%status >= 0) call note(self, rows(i), int(codes(i)))
    end do
    if (from%status >= 0) call close_file(file, from)
    if (to%status < 0) then
      call give_up(self, failure_reason(), error)
    else if (from%status < 0) then
      call raise(error, file_error, file_name//': cannot be read: '//failure_reason()//': run this share again with --overwrite')
      call self%discard()
    end if
  end subroutine take_rows

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
    type(column_t) :: cases, texts
    integer :: i

    cases = column_t(quantity_t('case', '1', 'number of a case that failed'), 'sweep/failures', as_int32)
    texts = column_t(quantity_t('result_text', '1', 'why it failed'), 'sweep/failures', as_text)
    call create_column(self%id, cases, chunk, .true., h5)
    call create_column(self%id, texts, chunk, .false., h5)
    call attach_scale(texts%dataset, cases%dataset, 0, h5)
    ! One by one: very many have no room on the stack.
    do i = 1, self%rows
      if (self%code(i) <= 0) cycle
      call write_rows(cases%dataset, cases%dataset%rows, 1_hsize_t, [real(self%share%case_of(i), real64)], h5)
      call append_text(texts%dataset, self%message(i)%text, h5)
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
    if (.not. allocated(error)) call create(self, error)
    if (.not. allocated(error)) call take_former(self, error)
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
