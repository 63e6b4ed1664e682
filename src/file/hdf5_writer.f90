!> The contents of a result file of one run, in HDF5.
!>
!> Samples and events wait in memory for a chunk of rows and are written at once, so that the memory does not grow with the run. A
!> run that goes on from a former file begins with its rows. Where the file is, and when it gets its name: dst_result_file.
!>
!> Columns are doubles. In a build with more digits /remainder contains, under the same names, the rounding errors as doubles: the
!> sum of both has 32 digits, and every reader can use the other datasets.
module dst_hdf5_writer
  use dst_kinds, only: wp, real64, int64
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_writer, only: writer_t, quantity_t, event_t, outcome_t
  use dst_disk, only: with_remedy
  use dst_hdf5_tools, only: hid_t, hdf5_t, create_file, open_existing, close_file, failure_reason, damage_reason, as_double, &
    as_int8, as_int64, put_attribute, put_value, create_group, dataset_t, create_dataset, open_dataset, write_rows, read_rows, &
    attach_scale
  use dst_parameters, only: parameter_t
  implicit none
  private

  public :: write_metadata, put_ending, hdf5_writer_t, run_metadata_t, create_hdf5

  !> The description of a run that its file contains before the run begins.
  type :: run_metadata_t
    character(:), allocatable :: program, version, git_revision, compiler
    character(:), allocatable :: created         !! when the run began: ISO 8601, UTC
    character(:), allocatable :: deck_text       !! the deck as read
    character(:), allocatable :: deck_resolved   !! every key as used: --set makes a different deck
    character(:), allocatable :: deck_sha256     !! of the deck as read
    character(:), allocatable :: model, method
    character(:), allocatable :: model_choice    !! why 'auto' is this model; '' if the deck names the model
    character(:), allocatable :: build_flags     !! of the compiler
    character(:), allocatable :: host, job       !! machine that wrote it, and the job of its scheduler; '' if there is none
    integer :: threads = 1
    type(parameter_t), allocatable :: parameters(:)
  end type run_metadata_t

  logical, parameter :: doubles_lose_digits = digits(1.0_wp) > digits(1.0_real64)
  !> Groups of columns, and the datasets that keep one column.
  integer, parameter :: series = 1, log = 2, parts = merge(2, 1, doubles_lose_digits)
  character(*), parameter :: group_name(2) = [character(11) :: 'time_series', 'events']

  !> A dataset of doubles that grows with the run.
  type :: column_t
    integer :: group = series                        !! or `log`
    integer :: place = 0                             !! in the rows of that group
    integer :: part = 1                              !! 2: rounding errors of the doubles
    type(quantity_t) :: quantity
    type(dataset_t) :: dataset = dataset_t()
  contains
    procedure :: path => path_of_column
  end type column_t

  !> Rows of a group that wait to be appended to its columns.
  type :: waiting_t
    real(wp), allocatable :: values(:, :)            !! (row in a chunk, place)
    integer :: count = 0
  end type waiting_t

  !> The result file of one run, open for writing.
  type, extends(writer_t) :: hdf5_writer_t
    private
    character(:), allocatable :: shown_name       !! name in messages
    integer(hid_t) :: file = -1
    type(column_t), allocatable :: columns(:)     !! of the time series, of the events, then the rounding errors of these
    type(waiting_t) :: waiting(2)
    integer(int64) :: rows(2) = 0                 !! of samples and events in the file
    type(error_t), allocatable :: failure         !! the first one; after it HDF5 is not called any more: it may crash
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: copy_rows
    procedure :: finish
    procedure, private :: write_row
    procedure, private :: write_waiting
    procedure, private :: fail
  end type hdf5_writer_t

  integer, parameter :: smallest_chunk = 64, usual_chunk = 1024, largest_chunk = 4096   ! rows
  integer, parameter :: event_chunk = 1024                                              ! rows

contains

  !> Create the file of a run; an empty file may have the name.
  subroutine create_hdf5(self, file_name, shown_name, metadata, columns, error, expected_rows)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name             !! path at which it is created
    character(*), intent(in) :: shown_name            !! its name in messages
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)        !! of the time series; the first is 'time'. None: no series, no events
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! number of samples of the whole run, if it is known
    type(hdf5_t) :: h5

    call prepare(self, shown_name, columns, expected_rows)
    call create_file(file_name, self%file, h5)
    call write_metadata(self%file, metadata, h5)
    if (size(columns) > 0) call create_columns(self, h5)
    if (h5%status < 0) call self%fail(failure_reason())
    if (allocated(self%failure)) error = self%failure
  end subroutine create_hdf5

  !> The data that are kept in memory; without columns of samples there are none of events either.
  subroutine prepare(self, shown_name, quantities, expected_rows)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: shown_name
    type(quantity_t), intent(in) :: quantities(:)
    integer, intent(in), optional :: expected_rows
    type(quantity_t), parameter :: event_quantities(4) = [quantity_t('time', 's', 'time of the event'), &
      quantity_t('kind', '1', '1 = stick begins, 2 = slip begins'), &
      quantity_t('occurs', '1', 'how many times the event occurs', .true.), &
      quantity_t('period', 's', 'the time after which it occurs again')]
    integer :: chunk_rows, part, i

    self%shown_name = shown_name
    chunk_rows = usual_chunk
    if (present(expected_rows)) chunk_rows = max(smallest_chunk, min(expected_rows, largest_chunk))
    allocate (self%columns(0), self%waiting(series)%values(chunk_rows, size(quantities)), &
      self%waiting(log)%values(event_chunk, size(event_quantities)))
    if (size(quantities) == 0) return
    do part = 1, parts
      self%columns = [self%columns, (column_t(series, i, part, quantities(i)), i=1, size(quantities)), &
        (column_t(log, i, part, event_quantities(i)), i=1, size(event_quantities))]
    end do
  end subroutine prepare

  subroutine create_columns(self, h5)
    class(hdf5_writer_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    type(column_t) :: first(2)
    integer(hid_t) :: parent, groups(2, parts)
    integer :: part, stored_as, i

    parent = self%file
    do part = 1, parts
      if (part > 1) call create_group(self%file, 'remainder', parent, h5)
      do i = 1, size(groups, 1)
        call create_group(parent, trim(group_name(i)), groups(i, part), h5)
      end do
    end do
    do i = 1, size(self%columns)
      associate (column => self%columns(i))
        stored_as = as_double
        if (column%part > 1) then
          column%quantity%long_name = 'to be added to '//column%path(1)
        else if (column%quantity%name == 'sticking' .or. column%quantity%name == 'kind') then
          stored_as = as_int8
        else if (column%quantity%counts) then
          stored_as = as_int64
        end if
        call create_dataset(groups(column%group, column%part), column%quantity, size(self%waiting(column%group)%values, 1), &
          column%dataset, h5, stored_as, is_scale=column%part == 1 .and. column%place == 1)
        if (column%part > 1) cycle
        if (column%place == 1) then
          first(column%group) = column
        else
          call attach_scale(column%dataset, first(column%group)%dataset, 0, h5)
        end if
      end associate
    end do
  end subroutine create_columns

  !> Begin with the rows of a former file, which is as it was when it was written.
  subroutine copy_rows(self, file_name, error)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(error_t), allocatable, intent(out) :: error
    integer(int64), parameter :: most = 64*usual_chunk
    real(real64), allocatable :: values(:)
    type(dataset_t) :: from
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    integer(int64) :: done
    integer :: i

    call open_existing(file_name, file, h5)
    do i = 1, size(self%columns)
      associate (column => self%columns(i))
        call open_dataset(file, column%path(), from, h5)
        done = 0
        do while (h5%status >= 0 .and. done < from%rows)
          allocate (values(min(most, from%rows - done)))
          call read_rows(from, done, size(values, kind=int64), values, h5)
          if (h5%status < 0) exit
          call write_rows(column%dataset, done, size(values, kind=int64), values, h5)
          done = done + size(values)
          if (h5%status < 0) call self%fail(failure_reason())
          deallocate (values)
        end do
        if (allocated(self%failure)) error = self%failure
        if (h5%status < 0 .and. .not. allocated(error)) &
          call raise(error, file_error, self%shown_name//': cannot resume: '//damage_reason(h5))
        if (allocated(error)) return
        self%rows(column%group) = done
      end associate
    end do
    call close_file(file, h5)
  end subroutine copy_rows

  subroutine write_samples(self, samples, error)
    class(hdf5_writer_t), intent(inout) :: self
    real(wp), intent(in) :: samples(:, :)
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    do i = 1, size(samples, 2)
      call self%write_row(series, samples(:, i), error)
      if (allocated(error)) return
    end do
  end subroutine write_samples

  subroutine write_events(self, events, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(event_t), intent(in) :: events(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    do i = 1, size(events)
      associate (event => events(i))
        call self%write_row(log, [event%time, real(event%kind, wp), real(event%occurs, wp), event%period], error)
      end associate
      if (allocated(error)) return
    end do
  end subroutine write_events

  !> Add a row to those that wait. A write ends where a chunk of the file ends, so that no chunk is read back.
  subroutine write_row(self, group, row, error)
    class(hdf5_writer_t), intent(inout) :: self
    integer, intent(in) :: group
    real(wp), intent(in) :: row(:)
    type(error_t), allocatable, intent(out) :: error

    associate (waiting => self%waiting(group))
      waiting%count = waiting%count + 1
      waiting%values(waiting%count, :) = row
      if (modulo(self%rows(group) + waiting%count, size(waiting%values, 1, int64)) == 0) &
        call self%write_waiting(error)
    end associate
  end subroutine write_row

  !> Write the waiting rows and how the run ended, and close the file.
  subroutine finish(self, outcome, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5

    call self%write_waiting(error)
    if (allocated(error)) return
    call put_results(self%file, 'summary', outcome%summary, outcome%summary_value, h5)
    call put_results(self%file, 'statistics', outcome%statistics, outcome%statistics_value, h5)
    call put_ending(self%file, outcome%result_code, outcome%result_text, h5)
    if (outcome%result_code == result_done) call put_attribute(self%file, 'complete', 1, h5)
    if (h5%status >= 0) call close_file(self%file, h5)
    if (h5%status >= 0) return
    call self%fail(failure_reason())
    error = self%failure
  end subroutine finish

  !> Append the waiting rows.
  subroutine write_waiting(self, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer :: i

    if (.not. allocated(self%failure)) then
      do i = 1, size(self%columns)
        associate (column => self%columns(i), waiting => self%waiting(self%columns(i)%group))
          associate (values => waiting%values(:waiting%count, column%place), rows => int(waiting%count, int64))
            if (column%part == 1) then
              call write_rows(column%dataset, column%dataset%rows, rows, real(values, real64), h5)
            else
              call write_rows(column%dataset, column%dataset%rows, rows, rounding_error(values), h5)
            end if
          end associate
        end associate
      end do
      if (h5%status < 0) call self%fail(failure_reason())
    end if
    self%rows = self%rows + self%waiting%count
    self%waiting%count = 0
    if (allocated(self%failure)) error = self%failure
  end subroutine write_waiting

  !> What a number as a double lacks.
  elemental real(real64) function rounding_error(value)
    real(wp), intent(in) :: value

    rounding_error = real(value - real(real(value, real64), wp), real64)
  end function rounding_error

  !> The path of a column in the file; of `part`, if it is given.
  function path_of_column(self, part) result(path)
    class(column_t), intent(in) :: self
    integer, intent(in), optional :: part
    character(:), allocatable :: path

    path = trim(group_name(self%group))//'/'//trim(self%quantity%name)
    if (present(part)) return
    if (self%part > 1) path = 'remainder/'//path
  end function path_of_column

  !> Keep the first failure.
  subroutine fail(self, reason)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: reason

    if (allocated(self%failure)) return
    call raise(self%failure, file_error, self%shown_name//': cannot write: '//with_remedy(reason))
  end subroutine fail

  !> A group of numbers about how the run ended; counters are stored as integers.
  subroutine put_results(file, name, quantities, values, h5)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(quantity_t), intent(in), allocatable :: quantities(:)
    real(wp), intent(in), allocatable :: values(:)
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: group
    integer :: i

    call create_group(file, name, group, h5)
    if (allocated(quantities)) then
      do i = 1, size(quantities)
        call put_value(group, quantities(i), values(i), h5)
      end do
    end if
  end subroutine put_results

  !> The description of its origin that every result file has.
  subroutine write_metadata(file, metadata, h5)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: group
    integer :: i

    call put_attribute(file, 'program', metadata%program, h5)
    call put_attribute(file, 'version', metadata%version, h5)
    call put_attribute(file, 'git_revision', metadata%git_revision, h5)
    call put_attribute(file, 'compiler', metadata%compiler, h5)
    call put_attribute(file, 'created', metadata%created, h5)
    call put_attribute(file, 'build_flags', metadata%build_flags, h5)
    call put_attribute(file, 'host', metadata%host, h5)
    call put_attribute(file, 'job', metadata%job, h5)
    call put_attribute(file, 'threads', metadata%threads, h5)
    call put_attribute(file, 'deck_sha256', metadata%deck_sha256, h5)
    call put_attribute(file, 'model', metadata%model, h5)
    call put_attribute(file, 'method', metadata%method, h5)
    if (allocated(metadata%model_choice)) then
      if (metadata%model_choice /= '') call put_attribute(file, 'model_choice', metadata%model_choice, h5)
    end if
    call put_ending(file, -1, 'running', h5)
    call put_attribute(file, 'complete', 0, h5)

    call create_group(file, 'deck', group, h5)
    call put_value(group, quantity_t('text', '1', 'the deck as read'), metadata%deck_text, h5)
    call put_value(group, quantity_t('resolved', '1', 'the deck with every key as used'), metadata%deck_resolved, h5)

    call create_group(file, 'parameters', group, h5)
    if (allocated(metadata%parameters)) then
      do i = 1, size(metadata%parameters)
        associate (parameter => metadata%parameters(i))
          if (allocated(parameter%text)) then
            call put_value(group, parameter%quantity, parameter%text, h5)
          else
            call put_value(group, parameter%quantity, parameter%value, h5)
          end if
        end associate
      end do
    end if
  end subroutine write_metadata

  !> The attributes of how a run or sweep ended.
  subroutine put_ending(file, result_code, result_text, h5)
    integer(hid_t), intent(in) :: file
    integer, intent(in) :: result_code
    character(*), intent(in) :: result_text
    type(hdf5_t), intent(inout) :: h5

    call put_attribute(file, 'result_code', result_code, h5)
    call put_attribute(file, 'result_text', result_text, h5)
  end subroutine put_ending
end module dst_hdf5_writer
