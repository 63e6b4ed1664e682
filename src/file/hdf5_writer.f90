!> The contents of a result file of one run, in HDF5.
!>
!> A run that goes on from a former file begins with its rows. Where the file is, and when it gets its name: dst_result_file.
!>
!> Columns are doubles. In a build with more digits /remainder contains, under the same names, the rounding errors as doubles: the
!> sum of both has 32 digits, and every reader can use the other datasets.
module dst_hdf5_writer
  use, intrinsic :: iso_c_binding, only: nul => c_null_char
  use dst_kinds, only: wp, real64
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_writer, only: writer_t, quantity_t, event_t, outcome_t
  use dst_disk, only: with_remedy
  use dst_hdf5_table, only: table_t
  use dst_hdf5_tools, only: hid_t, hsize_t, hdf5_t, open_file, close_file, failure_reason, damage_reason, &
    as_double, as_int8, as_int64, dataset_t, column_t, put_attribute, put_value, create_group
  use dst_parameters, only: parameter_t
  use dst_sha256, only: sha256
  implicit none
  private

  public :: write_metadata, put_ending, hdf5_writer_t, run_metadata_t, attribute_t, create_hdf5

  !> A name and its text.
  type :: attribute_t
    character(16) :: name
    character(:), allocatable :: text
  end type attribute_t

  !> The description of a run that its file contains before the run begins.
  type :: run_metadata_t
    type(attribute_t), allocatable :: attributes(:)   !! of the program, the machine and the model
    character(:), allocatable :: created         !! when the run began: ISO 8601, UTC
    character(:), allocatable :: deck_text       !! the deck as read
    character(:), allocatable :: deck_resolved   !! every key as used: --set makes a different deck
    character(:), allocatable :: model_choice    !! why 'auto' is this model; '' if the deck names the model
    integer :: threads = 1
    type(parameter_t), allocatable :: parameters(:)
  end type run_metadata_t

  !> The tables; in a build with more digits each has one with the rounding errors of its doubles.
  integer, parameter :: series = 1, log = 2, parts = merge(2, 1, digits(1.0_wp) > digits(1.0_real64))

  !> The result file of one run, open for writing.
  type :: hdf5_writer_t
    private
    character(:), allocatable :: shown_name       !! name in messages
    integer(hid_t) :: file = -1
    type(table_t) :: tables(2, parts)
    integer(hsize_t) :: rows(2) = 0               !! of samples and events so far
    type(error_t), allocatable :: failure         !! the first one; after it HDF5 is not called any more: it may crash
  contains
    procedure :: take
    procedure :: copy_rows
    procedure :: finish
    procedure, private :: check
  end type hdf5_writer_t

  integer, parameter :: smallest_chunk = 64, usual_chunk = 1024, largest_chunk = 4096   ! rows

contains

  !> Create the file of a run; an empty file may have the name.
  subroutine create_hdf5(self, file_name, shown_name, metadata, columns, expected_rows, error)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name             !! path at which it is created
    character(*), intent(in) :: shown_name            !! its name in messages
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)        !! of the time series; the first is 'time'
    integer, intent(in) :: expected_rows              !! number of samples of the whole run
    type(error_t), allocatable, intent(out) :: error
    type(quantity_t), parameter :: event_columns(4) = [quantity_t('time', 's', 'time of the event'), &
      quantity_t('kind', '1', '1 = stick begins, 2 = slip begins'), &
      quantity_t('occurs', '1', 'how many times the event occurs', .true.), &
      quantity_t('period', 's', 'the time after which it occurs again')]
    type(hdf5_t) :: h5

    self%shown_name = shown_name
    call open_file(file_name, .true., self%file, h5)
    call write_metadata(self%file, metadata, h5)
    self%tables(series, :)%chunk_rows = max(smallest_chunk, min(expected_rows, largest_chunk))
    self%tables(log, :)%chunk_rows = usual_chunk
    call create_table(self, series, 'time_series', columns, h5)
    call create_table(self, log, 'events', event_columns, h5)
    call self%check(h5, error)
  end subroutine create_hdf5

  !> The columns of samples or events; the first is time.
  subroutine create_table(self, table, group, quantities, h5)
    class(hdf5_writer_t), intent(inout) :: self
    integer, intent(in) :: table
    character(*), intent(in) :: group
    type(quantity_t), intent(in) :: quantities(:)
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t), parameter :: no_scales(0) = [dataset_t ::]
    integer :: i

    associate (exact => self%tables(table, 1), rest => self%tables(table, parts))
      allocate (exact%columns, source=[(column_t(quantities(i), group), i=1, size(quantities))])
      where (quantities%name == 'sticking' .or. quantities%name == 'kind') exact%columns%stored_as = as_int8
      where (quantities%counts) exact%columns%stored_as = as_int64
      call exact%create(self%file, exact%chunk_rows, h5)
      if (parts == 1) return
      rest%columns = exact%columns
      rest%columns%group = 'remainder/'//group
      rest%columns%stored_as = as_double
      do i = 1, size(quantities)
        rest%columns(i)%quantity%long_name = 'to be added to '//group//'/'//quantities(i)%name
      end do
      call rest%create(self%file, rest%chunk_rows, h5, no_scales)
    end associate
  end subroutine create_table

  !> Begin with the rows of a former file, which is as it was when it was written.
  subroutine copy_rows(self, file_name, error)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: most = 64*usual_chunk
    type(hdf5_t) :: h5, former
    integer(hid_t) :: file
    integer(hsize_t) :: first, i
    integer :: table, part

    call open_file(file_name, .false., file, former)
    do table = 1, size(self%tables, 1)
      self%rows(table) = self%tables(table, 1)%rows_in(file, former)
      do part = 1, parts
        do first = 1, self%rows(table), most
          associate (rows => [(i, i=first, min(self%rows(table), first + most - 1))])
            call self%tables(table, part)%take_rows(file, first, rows, rows > 0, former, h5)
          end associate
        end do
      end do
    end do
    call self%check(h5, error)
    if (former%status < 0 .and. .not. allocated(error)) &
      call raise(error, file_error, self%shown_name//': cannot resume: '//damage_reason())
    if (.not. allocated(error)) call close_file(file, former)
  end subroutine copy_rows

  !> Take the samples and events that a run has written.
  subroutine take(self, writer, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer :: i

    do i = 1, writer%rows
      call put_row(self, series, writer%samples(:, i), h5)
    end do
    do i = 1, writer%events
      associate (event => writer%log(i))
        call put_row(self, log, [event%time, real(event%kind, wp), real(event%occurs, wp), event%period], h5)
      end associate
    end do
    writer%rows = 0
    writer%events = 0
    call self%check(h5, error)
  end subroutine take

  subroutine put_row(self, table, row, h5)
    type(hdf5_writer_t), intent(inout) :: self
    integer, intent(in) :: table
    real(wp), intent(in) :: row(:)
    type(hdf5_t), intent(inout) :: h5
    real(real64) :: values(1, size(row))

    if (allocated(self%failure)) return
    self%rows(table) = self%rows(table) + 1
    values(1, :) = real(row, real64)
    call self%tables(table, 1)%put_row(self%rows(table), values, h5)
    values(1, :) = real(row - real(values(1, :), wp), real64)
    if (parts > 1) call self%tables(table, parts)%put_row(self%rows(table), values, h5)
  end subroutine put_row

  !> Write the waiting rows and how the run ended, and close the file.
  subroutine finish(self, outcome, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer :: table, part

    if (.not. allocated(self%failure)) then
      do part = 1, parts
        do table = 1, size(self%tables, 1)
          call self%tables(table, part)%write_waiting(h5)
        end do
      end do
      call put_results(self%file, 'summary', outcome%summary, outcome%summary_value, h5)
      call put_results(self%file, 'statistics', outcome%statistics, outcome%statistics_value, h5)
      call put_ending(self%file, outcome%result_code, outcome%result_text, h5)
      if (outcome%result_code == result_done) call put_attribute(self%file, 'complete', 1, h5)
      if (h5%status >= 0) call close_file(self%file, h5)
    end if
    call self%check(h5, error)
  end subroutine finish

  !> Keep the first failure.
  subroutine check(self, h5, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(hdf5_t), intent(in) :: h5
    type(error_t), allocatable, intent(out) :: error

    if (h5%status < 0 .and. .not. allocated(self%failure)) &
      call raise(self%failure, file_error, self%shown_name//': cannot write: '//with_remedy(failure_reason()))
    if (allocated(self%failure)) error = self%failure
  end subroutine check

  !> A group of numbers about how the run ended; counters are stored as integers.
  subroutine put_results(file, name, quantities, values, h5)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(quantity_t), intent(in), allocatable :: quantities(:)
    real(wp), intent(in), allocatable :: values(:)
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: group
    integer :: i

    group = create_group(file, name//nul, h5)
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

    do i = 1, size(metadata%attributes)
      call put_attribute(file, trim(metadata%attributes(i)%name), metadata%attributes(i)%text, h5)
    end do
    call put_attribute(file, 'created', metadata%created, h5)
    call put_attribute(file, 'threads', metadata%threads, h5)
    call put_attribute(file, 'deck_sha256', sha256(metadata%deck_text), h5)
    if (metadata%model_choice /= '') call put_attribute(file, 'model_choice', metadata%model_choice, h5)
    call put_ending(file, -1, 'running', h5)
    call put_attribute(file, 'complete', 0, h5)

    group = create_group(file, 'deck'//nul, h5)
    call put_value(group, quantity_t('text', '1', 'the deck as read'), metadata%deck_text, h5)
    call put_value(group, quantity_t('resolved', '1', 'the deck with every key as used'), metadata%deck_resolved, h5)

    group = create_group(file, 'parameters'//nul, h5)
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
