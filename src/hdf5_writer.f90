!> The result file of one run, in HDF5.
!>
!> Samples and events wait in memory for a chunk's worth of rows, are written at once and flushed at least every second,
!> so that memory does not grow with the run and a killed run leaves a file that opens. (The file is inconsistent only for
!> the microseconds of a flush, so flushing more often would not be safer.) Before each write the disk space that it and
!> the file's ending need is reserved: a full disk is met while the file is still sound, and what was written stays readable.
!>
!> Columns are doubles. In a build with more digits /remainder holds, under the same names, what rounding left over as doubles
!> too: the sum of both has 32 digits, and the rest of the file is what every reader knows.
module dst_hdf5_writer
  use, intrinsic :: iso_c_binding, only: c_int
  use hdf5, only: hid_t, hsize_t, h5fcreate_f, h5fopen_f, h5fclose_f, h5fflush_f, h5fget_filesize_f, h5gclose_f, &
    h5pcreate_f, h5pclose_f, h5pset_fclose_degree_f, h5pset_libver_bounds_f, h5p_file_access_f, h5f_close_strong_f, &
    h5f_libver_v18_f, h5f_acc_trunc_f, h5f_acc_rdwr_f, h5f_acc_rdonly_f, h5f_scope_local_f, h5t_ieee_f64le, h5t_std_i8le, &
    h5t_std_i64le
  use dst_kinds, only: wp, real64, int64
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_writer, only: writer_t, quantity_t, outcome_t
  use dst_disk, only: prepare_file, reserve_space, set_file_size, move_file, delete_file, file_exists, is_folder, &
    true_path, scratch_name, with_remedy, ignore_size_limit_signal, utc_now
  use dst_hdf5_tools, only: start_hdf5, failure_reason, file_descriptor, put_attribute, get_attribute, put_text, put_number, &
    create_group, delete_link, column_t, create_column, open_column, append, cut_column, make_scale, attach_scale
  implicit none
  private

  public :: hdf5_writer_t, run_metadata_t, text_parameter_t, create_hdf5, reopen_hdf5

  !> A parameter of the deck whose value is text.
  type :: text_parameter_t
    character(24) :: name = ''
    character(96) :: long_name = ''
    character(:), allocatable :: value
  end type text_parameter_t

  !> What a file says about its run before the run begins.
  type :: run_metadata_t
    character(:), allocatable :: program, version, git_revision, compiler
    character(:), allocatable :: model, method
    character(:), allocatable :: model_choice    !! why 'auto' is this model; '' if it was not asked
    character(:), allocatable :: deck_text       !! the deck as read
    character(:), allocatable :: deck_resolved   !! every key as used
    character(:), allocatable :: deck_sha256
    type(quantity_t), allocatable :: parameters(:)
    real(wp), allocatable :: parameter_value(:)
    type(text_parameter_t), allocatable :: text_parameters(:)
  end type run_metadata_t

  type, extends(writer_t) :: hdf5_writer_t
    private
    character(:), allocatable :: file_name
    integer(hid_t) :: file = -1
    integer(c_int) :: descriptor = -1
    type(column_t), allocatable :: columns(:)     !! of the time series
    type(column_t) :: event_time, event_kind
    type(column_t), allocatable :: remainders(:)  !! of the columns; allocated only if doubles lose digits
    type(column_t) :: event_remainder
    integer :: chunk_rows = 0
    real(wp), allocatable :: samples(:, :)        !! waiting: (row, column)
    real(wp), allocatable :: events(:, :)         !! waiting: (row, time and kind)
    integer :: waiting_samples = 0
    integer :: waiting_events = 0
    integer(int64) :: flushed_at = 0              !! system_clock's count
    logical :: sound = .false.                    !! no write has failed half-way
    type(error_t), allocatable :: failure         !! the first one; nothing more is appended after it
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: flush => flush_all
    procedure :: finish
    procedure, private :: write_waiting
    procedure, private :: reserve
    procedure, private :: fail
  end type hdf5_writer_t

  integer, parameter :: smallest_chunk = 64, usual_chunk = 1024, largest_chunk = 4096   ! rows
  integer, parameter :: event_chunk = 1024                                              ! rows
  !> Room kept for the file's ending: summary, statistics and attributes take some 60 kB.
  integer(int64), parameter :: ending_bytes = 131072
  !> Room a column's index may take when one chunk is added.
  integer(int64), parameter :: index_bytes = 4096
  real(wp), parameter :: flush_interval = 1.0_wp   ! s
  logical, parameter :: doubles_lose_digits = digits(1.0_wp) > digits(1.0_real64)

  character(*), parameter :: hdf5_signature = char(137)//'HDF'//char(13)//char(10)//char(26)//char(10)

contains

  !> Create the file of a run. Without `overwrite` an existing file is refused; with it, the old file is replaced only
  !> once the new one stands complete with its header beside it.
  subroutine create_hdf5(self, file_name, overwrite, metadata, columns, error, expected_rows)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name
    logical, intent(in) :: overwrite
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)        !! of the time series; the first is 'time'
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! samples of the whole run, when they are known
    character(:), allocatable :: created_name
    logical :: is_ours

    call allocate_waiting(self, size(columns), expected_rows)
    call choose_name(true_path(trim(file_name)), overwrite, created_name, error)
    is_ours = .not. file_exists(created_name)
    if (.not. allocated(error)) call open_new(self, created_name, error)
    if (allocated(error)) then
      error%text = trim(file_name)//': cannot create: '//error%text
      return
    end if

    self%file_name = trim(file_name)
    call write_header(self, metadata, columns, error)
    if (.not. allocated(error)) call put_in_place(created_name, true_path(self%file_name), error)
    if (allocated(error)) then
      if (self%sound) call close_file(self)
      if (is_ours) call delete_file(created_name)
      self%failure = error
      self%sound = .false.
    end if
  end subroutine create_hdf5

  !> Open the file of an unfinished run to go on after its first `rows` samples and `events` events.
  subroutine reopen_hdf5(self, file_name, rows, events, deck_sha256, columns, error)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name
    integer(int64), intent(in) :: rows, events        !! kept; what the file has behind them is dropped
    character(*), intent(in) :: deck_sha256           !! of the run to go on with: must be the file's
    type(quantity_t), intent(in) :: columns(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: file_sha256, reason
    integer :: status, complete

    call allocate_waiting(self, size(columns))
    self%file_name = trim(file_name)
    call start_hdf5(status)
    call open_file(self%file_name, h5f_acc_rdwr_f, self%file, status)
    call get_attribute(self%file, 'complete', complete, status)
    call get_attribute(self%file, 'deck_sha256', file_sha256, status)
    call file_descriptor(self%file, self%descriptor, status)
    if (status < 0) then
      reason = with_remedy(failure_reason())
    else if (complete /= 0) then
      reason = 'the run is complete'
    else if (file_sha256 /= deck_sha256) then
      reason = 'the checkpoint is of another deck'
    end if
    if (.not. allocated(reason)) then
      call reopen_columns(self, rows, events, columns, status)
      if (status < 0) reason = with_remedy(failure_reason())
    end if
    self%sound = .not. allocated(reason)
    if (self%sound) return
    call raise(error, file_error, self%file_name//': cannot resume: '//reason)
    if (self%file >= 0) call h5fclose_f(self%file, status)
  end subroutine reopen_hdf5

  subroutine write_samples(self, samples, error)
    class(hdf5_writer_t), intent(inout) :: self
    real(wp), intent(in) :: samples(:, :)
    type(error_t), allocatable, intent(out) :: error
    integer :: row, first, count

    first = 1
    do while (first <= size(samples, 2))
      ! A write ends where a chunk of the file ends, so that none is read back.
      count = min(size(samples, 2) - first + 1, &
        self%chunk_rows - int(modulo(self%columns(1)%rows, int(self%chunk_rows, hsize_t))) - self%waiting_samples)
      do row = 0, count - 1
        self%samples(self%waiting_samples + 1 + row, :) = samples(:, first + row)
      end do
      self%waiting_samples = self%waiting_samples + count
      first = first + count
      if (modulo(self%columns(1)%rows + self%waiting_samples, int(self%chunk_rows, hsize_t)) == 0) then
        call self%write_waiting(flush_now=.false., error=error)
        if (allocated(error)) return
      end if
    end do
  end subroutine write_samples

  subroutine write_events(self, time, kind, error)
    class(hdf5_writer_t), intent(inout) :: self
    real(wp), intent(in) :: time(:)
    integer, intent(in) :: kind(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    do i = 1, size(time)
      self%waiting_events = self%waiting_events + 1
      self%events(self%waiting_events, :) = [time(i), real(kind(i), wp)]
      if (self%waiting_events == event_chunk) then
        call self%write_waiting(flush_now=.false., error=error)
        if (allocated(error)) return
      end if
    end do
  end subroutine write_events

  subroutine flush_all(self, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    call self%write_waiting(flush_now=.true., error=error)
  end subroutine flush_all

  subroutine finish(self, outcome, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(out) :: error

    call self%write_waiting(flush_now=.false., error=error)
    if (.not. self%sound) return
    call write_ending(self, outcome, error)
    if (self%sound) call close_file(self)
    if (.not. self%sound .and. allocated(self%failure)) error = self%failure
    if (allocated(error)) return
    if (.not. file_exists(self%file_name)) call raise(error, file_error, &
      self%file_name//': the file or its folder was removed or renamed during the run')
  end subroutine finish

  !> Append what waits, and flush when told to or when the last flush is long ago.
  subroutine write_waiting(self, flush_now, error)
    class(hdf5_writer_t), intent(inout) :: self
    logical, intent(in) :: flush_now
    type(error_t), allocatable, intent(out) :: error
    integer :: status, i
    logical :: due

    if (.not. allocated(self%failure) .and. self%waiting_samples + self%waiting_events > 0) call self%reserve()
    if (.not. allocated(self%failure)) then
      status = 0
      do i = 1, size(self%columns)
        call append(self%columns(i), real(self%samples(:self%waiting_samples, i), real64), status)
      end do
      call append(self%event_time, real(self%events(:self%waiting_events, 1), real64), status)
      call append(self%event_kind, real(self%events(:self%waiting_events, 2), real64), status)
      if (doubles_lose_digits) call append_remainders(self, status)
      due = flush_now
      if (.not. due) due = seconds_since(self%flushed_at) > flush_interval
      if (due) then
        call flush_file(self%file, status)
        call system_clock(self%flushed_at)
      end if
      if (status < 0) call self%fail(failure_reason(), sound=.false.)
    end if
    self%waiting_samples = 0
    self%waiting_events = 0
    if (allocated(self%failure)) error = self%failure
  end subroutine write_waiting

  subroutine append_remainders(self, status)
    class(hdf5_writer_t), intent(inout) :: self
    integer, intent(inout) :: status
    integer :: i

    do i = 1, size(self%remainders)
      call append(self%remainders(i), remainder(self%samples(:self%waiting_samples, i)), status)
    end do
    call append(self%event_remainder, remainder(self%events(:self%waiting_events, 1)), status)
  end subroutine append_remainders

  !> What a double does not hold of a number.
  elemental real(real64) function remainder(value)
    real(wp), intent(in) :: value

    remainder = real(value - real(real(value, real64), wp), real64)
  end function remainder

  !> See that the disk has room for one chunk of everything and for the file's ending.
  subroutine reserve(self)
    class(hdf5_writer_t), intent(inout) :: self
    integer(hsize_t) :: present_size
    integer(int64) :: needed
    character(:), allocatable :: reason
    integer :: status

    call h5fget_filesize_f(self%file, present_size, status)
    if (status < 0) return
    needed = 2*(size(self%columns)*(8_int64*self%chunk_rows + index_bytes) + 2*(8_int64*event_chunk + index_bytes))
    if (doubles_lose_digits) needed = 2*needed
    call reserve_space(self%descriptor, int(present_size, int64) + needed + ending_bytes, reason)
    if (allocated(reason)) call self%fail(reason, sound=.true.)
  end subroutine reserve

  !> Remember the first failure, and whether the open file survived it.
  subroutine fail(self, reason, sound)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: reason
    logical, intent(in) :: sound

    self%sound = sound
    if (allocated(self%failure)) return
    allocate (self%failure)
    self%failure%code = file_error
    self%failure%text = self%file_name//': cannot write: '//with_remedy(reason)
  end subroutine fail

  !> How the run ended; `complete` comes after everything else has reached the file.
  subroutine write_ending(self, outcome, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(inout) :: error
    integer :: status, result_code
    character(:), allocatable :: result_text

    result_code = outcome%result_code
    result_text = ''
    if (allocated(outcome%result_text)) result_text = outcome%result_text
    if (allocated(error)) then
      result_code = error%code
      result_text = error%text
    end if

    status = 0
    call put_numbers(self%file, 'summary', outcome%summary, outcome%summary_value, .false., status)
    call put_numbers(self%file, 'statistics', outcome%statistics, outcome%statistics_value, .true., status)
    call put_attribute(self%file, 'result_code', result_code, status)
    call put_attribute(self%file, 'result_text', result_text, status)
    call flush_file(self%file, status)
    if (result_code == result_done) call put_attribute(self%file, 'complete', 1, status)
    call flush_file(self%file, status)
    if (status < 0) call self%fail(failure_reason(), sound=.false.)
  end subroutine write_ending

  !> A group of numbers; counters are stored as integers.
  subroutine put_numbers(file, name, quantities, values, counters, status)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(quantity_t), intent(in), allocatable :: quantities(:)
    real(wp), intent(in), allocatable :: values(:)
    logical, intent(in) :: counters   !! what has the unit '1' counts something
    integer, intent(inout) :: status
    integer(hid_t) :: group
    integer :: i

    call delete_link(file, name, status)
    call create_group(file, name, group, status)
    if (status < 0 .or. .not. allocated(quantities)) return
    do i = 1, size(quantities)
      if (counters .and. quantities(i)%units == '1') then
        call put_number(group, quantities(i), values(i), status, h5t_std_i64le)
      else
        call put_number(group, quantities(i), values(i), status)
      end if
    end do
    call close_group(group, status)
  end subroutine put_numbers

  !> Under which name the file is created: beside an existing file that is to be replaced.
  subroutine choose_name(file_name, overwrite, created_name, error)
    character(*), intent(in) :: file_name
    logical, intent(in) :: overwrite
    character(:), allocatable, intent(out) :: created_name
    type(error_t), allocatable, intent(out) :: error

    created_name = file_name
    if (file_name == '') then
      call raise(error, file_error, 'the file has no name: give one with -o')
    else if (is_folder(file_name)) then
      call raise(error, file_error, 'it is a folder: give a file name')
    else if (file_exists(file_name)) then
      if (.not. overwrite) then
        call raise(error, file_error, 'the file exists: use --overwrite or another name')
      else
        select case (content_of(file_name))
        case ('hdf5')
          created_name = scratch_name(file_name)
          if (is_being_written(file_name)) call raise(error, file_error, &
            'another process is writing this file: wait for it or use another name')
        case ('other')
          call raise(error, file_error, 'the file exists and is not an HDF5 file: use another name or remove it')
        end select
      end if
    end if
  end subroutine choose_name

  !> Whether another process holds HDF5's lock for writing.
  logical function is_being_written(file_name)
    character(*), intent(in) :: file_name
    integer(hid_t) :: file
    integer :: status

    is_being_written = .false.
    call start_hdf5(status)
    call open_file(file_name, h5f_acc_rdonly_f, file, status)
    if (status == 0) then
      call h5fclose_f(file, status)
    else
      is_being_written = index(failure_reason(), 'temporarily unavailable') > 0
    end if
  end function is_being_written

  !> What an existing file holds, so that --overwrite never destroys something else: 'hdf5', 'other', 'nothing', 'unknown'.
  function content_of(file_name) result(content)
    character(*), intent(in) :: file_name
    character(:), allocatable :: content
    character(len(hdf5_signature)) :: beginning
    integer(int64) :: bytes
    integer :: unit, io_status

    content = 'unknown'
    open (newunit=unit, file=file_name, status='old', action='read', access='stream', form='unformatted', iostat=io_status)
    if (io_status /= 0) return
    inquire (unit, size=bytes)
    if (bytes <= 0) then
      content = 'nothing'
    else
      read (unit, iostat=io_status) beginning
      content = 'other'
      if (io_status == 0 .and. beginning == hdf5_signature) content = 'hdf5'
    end if
    close (unit)
  end function content_of

  !> Create an empty HDF5 file.
  subroutine open_new(self, file_name, error)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    logical :: was_there
    integer :: status

    call ignore_size_limit_signal()
    was_there = file_exists(file_name)
    call prepare_file(file_name, reason)
    if (allocated(reason)) then
      call raise(error, file_error, reason)
      return
    end if
    call start_hdf5(status)
    call open_file(file_name, h5f_acc_trunc_f, self%file, status)
    call file_descriptor(self%file, self%descriptor, status)
    if (status == 0) then
      self%sound = .true.
    else
      call raise(error, file_error, with_remedy(failure_reason()))
      if (.not. was_there) call delete_file(file_name)
    end if
  end subroutine open_new

  !> Create or open a file whose objects close with it.
  subroutine open_file(file_name, mode, file, status)
    character(*), intent(in) :: file_name
    integer, intent(in) :: mode
    integer(hid_t), intent(out) :: file
    integer, intent(inout) :: status
    integer(hid_t) :: access

    file = -1
    if (status < 0) return
    call h5pcreate_f(h5p_file_access_f, access, status)
    if (status < 0) return
    call h5pset_fclose_degree_f(access, h5f_close_strong_f, status)
    if (status < 0) return
    ! The oldest format with checksums of what describes the data. A newer one would have to be freed by h5clear after a kill.
    call h5pset_libver_bounds_f(access, h5f_libver_v18_f, h5f_libver_v18_f, status)
    if (status < 0) return
    if (mode == h5f_acc_trunc_f) then
      call h5fcreate_f(file_name, mode, file, status, access_prp=access)
    else
      call h5fopen_f(file_name, mode, file, status, access_prp=access)
    end if
    if (status < 0) return
    call h5pclose_f(access, status)
  end subroutine open_file

  !> Everything that is known before the run begins.
  subroutine write_header(self, metadata, columns, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: status

    call self%reserve()
    if (.not. allocated(self%failure)) then
      status = 0
      call put_root_attributes(self%file, metadata, status)
      call put_deck(self%file, metadata, status)
      call put_parameters(self%file, metadata, status)
      call create_columns(self, columns, status)
      call flush_file(self%file, status)
      call system_clock(self%flushed_at)
      if (status < 0) call self%fail(failure_reason(), sound=.false.)
    end if
    if (allocated(self%failure)) error = self%failure
  end subroutine write_header

  subroutine put_root_attributes(file, metadata, status)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status

    call put_attribute(file, 'program', metadata%program, status)
    call put_attribute(file, 'version', metadata%version, status)
    call put_attribute(file, 'git_revision', metadata%git_revision, status)
    call put_attribute(file, 'compiler', metadata%compiler, status)
    call put_attribute(file, 'created', utc_now(), status)
    call put_attribute(file, 'deck_sha256', metadata%deck_sha256, status)
    call put_attribute(file, 'model', metadata%model, status)
    call put_attribute(file, 'method', metadata%method, status)
    if (allocated(metadata%model_choice)) then
      if (metadata%model_choice /= '') call put_attribute(file, 'model_choice', metadata%model_choice, status)
    end if
    call put_attribute(file, 'result_code', -1, status)
    call put_attribute(file, 'result_text', 'running', status)
    call put_attribute(file, 'complete', 0, status)
  end subroutine put_root_attributes

  subroutine put_deck(file, metadata, status)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status
    integer(hid_t) :: group

    call create_group(file, 'deck', group, status)
    call put_text(group, 'text', metadata%deck_text, 'the deck as read', status)
    call put_text(group, 'resolved', metadata%deck_resolved, 'the deck with every key as used', status)
    call close_group(group, status)
  end subroutine put_deck

  subroutine put_parameters(file, metadata, status)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status
    integer(hid_t) :: group
    integer :: i

    call create_group(file, 'parameters', group, status)
    if (allocated(metadata%parameters)) then
      do i = 1, size(metadata%parameters)
        call put_number(group, metadata%parameters(i), metadata%parameter_value(i), status)
      end do
    end if
    if (allocated(metadata%text_parameters)) then
      do i = 1, size(metadata%text_parameters)
        associate (parameter => metadata%text_parameters(i))
          call put_text(group, trim(parameter%name), parameter%value, trim(parameter%long_name), status)
        end associate
      end do
    end if
    call close_group(group, status)
  end subroutine put_parameters

  subroutine create_columns(self, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer(hid_t) :: group
    integer :: i

    call create_group(self%file, 'time_series', group, status)
    do i = 1, size(columns)
      if (columns(i)%name == 'sticking') then
        call create_column(group, columns(i), h5t_std_i8le, self%chunk_rows, self%columns(i), status)
      else
        call create_column(group, columns(i), h5t_ieee_f64le, self%chunk_rows, self%columns(i), status)
      end if
      if (i == 1) then
        call make_scale(self%columns(1), 'time', status)
      else
        call attach_scale(self%columns(i), self%columns(1), status)
      end if
    end do
    call close_group(group, status)

    call create_group(self%file, 'events', group, status)
    call create_column(group, quantity_t('time', 's', 'time of the event'), h5t_ieee_f64le, event_chunk, self%event_time, status)
    call create_column(group, quantity_t('kind', '1', '1 = stick begins, 2 = slip begins'), h5t_std_i8le, event_chunk, &
      self%event_kind, status)
    call make_scale(self%event_time, 'time', status)
    call attach_scale(self%event_kind, self%event_time, status)
    call close_group(group, status)
    if (doubles_lose_digits) call create_remainders(self, columns, status)
  end subroutine create_columns

  subroutine create_remainders(self, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer(hid_t) :: remainder_group, group
    integer :: i

    allocate (self%remainders(size(columns)))
    call create_group(self%file, 'remainder', remainder_group, status)
    call create_group(remainder_group, 'time_series', group, status)
    do i = 1, size(columns)
      call create_column(group, quantity_t(columns(i)%name, columns(i)%units, 'to be added to /time_series/'//columns(i)%name), &
        h5t_ieee_f64le, self%chunk_rows, self%remainders(i), status)
    end do
    call close_group(group, status)
    call create_group(remainder_group, 'events', group, status)
    call create_column(group, quantity_t('time', 's', 'to be added to /events/time'), h5t_ieee_f64le, event_chunk, &
      self%event_remainder, status)
    call close_group(group, status)
    call close_group(remainder_group, status)
  end subroutine create_remainders

  subroutine reopen_columns(self, rows, events, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    integer(int64), intent(in) :: rows, events
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer :: i

    do i = 1, size(columns)
      call open_column(self%file, 'time_series/'//trim(columns(i)%name), self%chunk_rows, self%columns(i), status)
      call cut_column(self%columns(i), int(rows, hsize_t), status)
    end do
    call open_column(self%file, 'events/time', event_chunk, self%event_time, status)
    call cut_column(self%event_time, int(events, hsize_t), status)
    call open_column(self%file, 'events/kind', event_chunk, self%event_kind, status)
    call cut_column(self%event_kind, int(events, hsize_t), status)
    if (doubles_lose_digits) call reopen_remainders(self, rows, events, columns, status)
    call put_attribute(self%file, 'result_code', -1, status)
    call put_attribute(self%file, 'result_text', 'running', status)
    call flush_file(self%file, status)
  end subroutine reopen_columns

  subroutine reopen_remainders(self, rows, events, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    integer(int64), intent(in) :: rows, events
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer :: i

    allocate (self%remainders(size(columns)))
    do i = 1, size(columns)
      call open_column(self%file, 'remainder/time_series/'//trim(columns(i)%name), self%chunk_rows, self%remainders(i), status)
      call cut_column(self%remainders(i), int(rows, hsize_t), status)
    end do
    call open_column(self%file, 'remainder/events/time', event_chunk, self%event_remainder, status)
    call cut_column(self%event_remainder, int(events, hsize_t), status)
  end subroutine reopen_remainders

  subroutine allocate_waiting(self, columns, expected_rows)
    class(hdf5_writer_t), intent(inout) :: self
    integer, intent(in) :: columns
    integer, intent(in), optional :: expected_rows

    self%chunk_rows = usual_chunk
    if (present(expected_rows)) self%chunk_rows = max(smallest_chunk, min(expected_rows, largest_chunk))
    allocate (self%columns(columns), self%samples(self%chunk_rows, columns), self%events(event_chunk, 2))
  end subroutine allocate_waiting

  !> Give the file its final name.
  subroutine put_in_place(created_name, final_name, error)
    character(*), intent(in) :: created_name, final_name
    type(error_t), allocatable, intent(out) :: error
    logical :: moved

    if (created_name == final_name) return
    call move_file(created_name, final_name, moved)
    if (.not. moved) call raise(error, file_error, final_name//': cannot create: the existing file cannot be replaced')
  end subroutine put_in_place

  !> Close the file and give back the disk space it did not need.
  subroutine close_file(self)
    class(hdf5_writer_t), intent(inout) :: self
    integer(hsize_t) :: bytes
    integer :: status

    call h5fget_filesize_f(self%file, bytes, status)
    if (status == 0) call set_file_size(self%descriptor, int(bytes, int64))
    call h5fclose_f(self%file, status)
    if (status < 0) call self%fail(failure_reason(), sound=.false.)
    self%file = -1
  end subroutine close_file

  real(wp) function seconds_since(count)
    integer(int64), intent(in) :: count   !! of system_clock
    integer(int64) :: now, rate

    call system_clock(now, rate)
    seconds_since = real(now - count, wp)/real(rate, wp)
  end function seconds_since

  subroutine close_group(group, status)
    integer(hid_t), intent(in) :: group
    integer, intent(inout) :: status

    if (status < 0) return
    call h5gclose_f(group, status)
  end subroutine close_group

  subroutine flush_file(file, status)
    integer(hid_t), intent(in) :: file
    integer, intent(inout) :: status

    if (status < 0) return
    call h5fflush_f(file, h5f_scope_local_f, status)
  end subroutine flush_file
end module dst_hdf5_writer
