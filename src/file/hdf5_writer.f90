!> The result file of one run, in HDF5.
!>
!> Samples and events wait in memory for a chunk's worth of rows and are written at once, so that memory does not grow with
!> the run. What is written becomes part of the file with a flush. In between, the file stays as it was at the last flush,
!> since new rows go where nothing is; during the microseconds of a flush it would be torn, so a child process writes first,
!> which survives when this one is killed. Before each write the disk space that it and the file's ending need is reserved:
!> a full disk is met while the file is still sound, and what was written stays readable.
!>
!> Columns are doubles. In a build with more digits /remainder holds, under the same names, what rounding left over as doubles
!> too: the sum of both has 32 digits, and the rest of the file is what every reader knows.
module dst_hdf5_writer
  use, intrinsic :: iso_c_binding, only: c_int
  use hdf5, only: hid_t, hsize_t, h5fclose_f, h5fflush_f, h5fget_filesize_f, h5gclose_f, h5f_acc_excl_f, h5f_acc_rdwr_f, &
    h5f_scope_local_f, h5t_ieee_f64le, h5t_std_i8le, h5t_std_i64le
  use dst_kinds, only: wp, real64, int64
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_writer, only: writer_t, quantity_t, outcome_t
  use dst_archive, only: archive_t
  use dst_disk, only: reserve_space, set_file_size, make_durable, lock_file, unlock_file, with_remedy, ignore_size_limit_signal
  use dst_hdf5_tools, only: start_hdf5, open_file, open_existing, failure_reason, damage_reason, file_descriptor, &
    put_attribute, put_text, put_number, create_group, delete_link, column_t, create_column, open_column, append, &
    cut_column, copy_rows, make_scale, attach_scale
  use dst_process, only: guard_t, is_child, end_child
  implicit none
  private

  public :: write_metadata, hdf5_writer_t, run_metadata_t, text_parameter_t, bookmark_t, create_hdf5, rebuild_hdf5, reopen_hdf5

  !> A parameter of the deck whose value is text.
  type :: text_parameter_t
    character(24) :: name = ''
    character(96) :: long_name = ''
    character(:), allocatable :: value
  end type text_parameter_t

  !> What a file says about its run before the run begins.
  type :: run_metadata_t
    character(:), allocatable :: program, version, git_revision, compiler
    character(:), allocatable :: created         !! ISO 8601, UTC
    character(:), allocatable :: model, method
    character(:), allocatable :: model_choice    !! why 'auto' is this model; '' if it was not asked
    character(:), allocatable :: build_flags     !! of the compiler
    character(:), allocatable :: host, job       !! where it was written, and in which job of a scheduler; '' in none
    character(:), allocatable :: mpi             !! the library; '' if the program has none
    integer :: processes = 1, threads = 1        !! that shared the work; threads of each process
    character(:), allocatable :: deck_text       !! the deck as read
    character(:), allocatable :: deck_resolved   !! every key as used
    character(:), allocatable :: deck_sha256
    type(quantity_t), allocatable :: parameters(:)
    real(wp), allocatable :: parameter_value(:)
    type(text_parameter_t), allocatable :: text_parameters(:)
  end type run_metadata_t

  !> How far a file has been written.
  type :: bookmark_t
    integer(int64) :: rows = 0, events = 0
    integer(int64), allocatable :: checksum(:)   !! of each column up to there, then of the two of the events
  contains
    procedure :: exchange => exchange_bookmark
  end type bookmark_t

  !> The result file of one run, open for writing.
  type, extends(writer_t) :: hdf5_writer_t
    private
    character(:), allocatable :: shown_name       !! in messages
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
    logical :: sound = .false.                    !! no write has failed half-way
    integer(int64) :: reserved = 0                !! bytes, more than any header of the file has counted
    type(error_t), allocatable :: failure         !! the first one; nothing more is appended after it
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: flush => flush_all
    procedure :: finish
    procedure :: discard
    procedure :: set_bookmark
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
  logical, parameter :: doubles_lose_digits = digits(1.0_wp) > digits(1.0_real64)

contains

  !> Create the file of a run; a name that is taken is refused. After a failure it is to be discarded.
  subroutine create_hdf5(self, file_name, shown_name, metadata, columns, error, expected_rows)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name             !! where it is created
    character(*), intent(in) :: shown_name            !! what it is called in messages
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)        !! of the time series; the first is 'time'. None: no series, no events
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! samples of the whole run, when they are known

    self%shown_name = shown_name
    call allocate_waiting(self, size(columns), expected_rows)
    call open_new(self, file_name, error)
    if (.not. allocated(error)) call write_header(self, metadata, columns, error)
  end subroutine create_hdf5

  !> Close a file that is not wanted.
  subroutine discard(self)
    class(hdf5_writer_t), intent(inout) :: self

    if (self%sound) call close_file(self)
    self%sound = .false.
  end subroutine discard

  !> Write the file of a run that was killed anew as `new_name`: its header from `metadata`, its columns with what they held at
  !> `bookmark`. Only numbers come from the old file, and all of them are checked; what is bent in its structure can spoil
  !> nothing that follows. It can make HDF5 crash or run in circles: this is for a child process, which shows life to `guard`.
  subroutine rebuild_hdf5(file_name, new_name, shown_name, bookmark, metadata, columns, guard, error, expected_rows)
    character(*), intent(in) :: file_name, new_name, shown_name
    type(bookmark_t), intent(in) :: bookmark
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)
    type(guard_t), intent(in) :: guard
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! as when the file was created
    type(hdf5_writer_t) :: old, new
    character(:), allocatable :: reason
    integer :: status

    call open_existing(file_name, old%file, status)
    call allocate_waiting(old, size(columns), expected_rows)
    call open_columns(old, columns, status)
    if (status < 0) reason = damage_reason()
    if (.not. allocated(reason)) then
      call allocate_waiting(new, size(columns), expected_rows)
      new%shown_name = shown_name
      call open_new(new, new_name, error)
      if (.not. allocated(error)) call write_header(new, metadata, columns, error)
      if (.not. allocated(error)) then
        call copy_columns(old, new, bookmark, columns, guard, reason)
        if (.not. allocated(reason)) call make_durable(new%descriptor, reason)
        call close_file(new)
        if (allocated(new%failure) .and. .not. allocated(reason)) reason = new%failure%text
      end if
    end if
    if (old%file >= 0) call h5fclose_f(old%file, status)
    if (allocated(reason)) call raise(error, file_error, shown_name//': cannot resume: '//reason)
  end subroutine rebuild_hdf5

  !> Copy what every column of `old` held at `bookmark` to the empty columns of `new`; `reason` says which does not hold it.
  subroutine copy_columns(old, new, bookmark, columns, guard, reason)
    type(hdf5_writer_t), intent(inout) :: old, new
    type(bookmark_t), intent(in) :: bookmark
    type(quantity_t), intent(in) :: columns(:)
    type(guard_t), intent(in) :: guard
    character(:), allocatable, intent(out) :: reason
    integer :: i, status

    call reserve_space(new%descriptor, 0_int64, ending_bytes + (size(columns) + 2)*index_bytes + &
      merge(20, 10, doubles_lose_digits)*(size(columns)*bookmark%rows + 2*bookmark%events), reason)
    if (allocated(reason)) return
    status = 0
    do i = 1, size(columns)
      call copy(old%columns(i), new%columns(i), bookmark%rows)
    end do
    call copy(old%event_time, new%event_time, bookmark%events)
    call copy(old%event_kind, new%event_kind, bookmark%events)
    if (doubles_lose_digits) then
      do i = 1, size(columns)
        call copy(old%remainders(i), new%remainders(i), bookmark%rows)
      end do
      call copy(old%event_remainder, new%event_remainder, bookmark%events)
    end if
    if (status < 0) reason = damage_reason()
    call check_bookmark(new, bookmark, columns, reason)

  contains

    subroutine copy(from, to, rows)
      type(column_t), intent(in) :: from
      type(column_t), intent(inout) :: to
      integer(int64), intent(in) :: rows
      integer(hsize_t), parameter :: most = 1048576
      integer(hsize_t) :: last

      last = min(from%rows, int(rows, hsize_t))
      do while (to%rows < last .and. status >= 0)
        call guard%show_life()
        call copy_rows(from, to, min(most, last - to%rows), status)
      end do
    end subroutine copy
  end subroutine copy_columns

  !> Open the file of an unfinished run to go on from `bookmark`; what the file has behind it is dropped. It must be as
  !> this program left it.
  subroutine reopen_hdf5(self, file_name, shown_name, bookmark, columns, error, expected_rows)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name, shown_name
    type(bookmark_t), intent(in) :: bookmark
    type(quantity_t), intent(in) :: columns(:)
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! as when the file was created
    integer :: status

    self%shown_name = shown_name
    call allocate_waiting(self, size(columns), expected_rows)
    call ignore_size_limit_signal()
    call start_hdf5(status)
    call open_file(file_name, h5f_acc_rdwr_f, self%file, status)
    call file_descriptor(self%file, self%descriptor, status)
    call open_columns(self, columns, status)
    ! Before anything is changed.
    if (status >= 0) call self%reserve()
    if (status >= 0 .and. .not. allocated(self%failure)) call cut_columns(self, bookmark, status)
    self%sound = status >= 0 .and. .not. allocated(self%failure)
    if (self%sound) return
    if (allocated(self%failure)) then
      error = self%failure
    else
      call raise(error, file_error, shown_name//': cannot resume: '//with_remedy(failure_reason()))
    end if
  end subroutine reopen_hdf5

  !> Write and flush all that waits, and tell how far the file then is.
  subroutine set_bookmark(self, durable, bookmark, error)
    class(hdf5_writer_t), intent(inout) :: self
    logical, intent(in) :: durable                    !! see that all this survives a power failure
    type(bookmark_t), intent(out) :: bookmark
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    call self%write_waiting(flush_now=.true., error=error)
    if (allocated(error)) return
    if (durable) call make_durable(self%descriptor, reason)
    if (allocated(reason)) then
      call self%fail(reason, sound=.false.)
      error = self%failure
      return
    end if
    bookmark%rows = int(self%columns(1)%rows, int64)
    bookmark%events = int(self%event_time%rows, int64)
    bookmark%checksum = [self%columns%checksum, self%event_time%checksum, self%event_kind%checksum]
  end subroutine set_bookmark

  !> Save or load; `checksum` has its size already.
  subroutine exchange_bookmark(self, archive)
    class(bookmark_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%exchange(self%rows)
    call archive%exchange(self%events)
    call archive%exchange(self%checksum)
  end subroutine exchange_bookmark

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
  end subroutine finish

  !> Append what waits, and flush when told to.
  subroutine write_waiting(self, flush_now, error)
    class(hdf5_writer_t), intent(inout) :: self
    logical, intent(in) :: flush_now
    type(error_t), allocatable, intent(out) :: error
    integer :: status, i

    if (.not. allocated(self%failure) .and. self%waiting_samples + self%waiting_events > 0) call self%reserve()
    if (.not. allocated(self%failure)) then
      status = 0
      do i = 1, size(self%columns)
        call append(self%columns(i), real(self%samples(:self%waiting_samples, i), real64), status)
      end do
      call append(self%event_time, real(self%events(:self%waiting_events, 1), real64), status)
      call append(self%event_kind, real(self%events(:self%waiting_events, 2), real64), status)
      if (doubles_lose_digits) call append_remainders(self, status)
      if (flush_now) call flush_file(self, status)
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
    self%reserved = max(self%reserved, int(present_size, int64) + needed + ending_bytes)
    call reserve_space(self%descriptor, int(present_size, int64), self%reserved, reason)
    if (allocated(reason)) call self%fail(reason, sound=.true.)
  end subroutine reserve

  !> Remember the first failure, and whether the open file survived it. If not, HDF5 may have cut off what an older header on the
  !> disk still counts, which no reader would open: the file gets its length back.
  subroutine fail(self, reason, sound)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: reason
    logical, intent(in) :: sound

    self%sound = sound
    if (.not. sound) call set_file_size(self%descriptor, self%reserved)
    if (allocated(self%failure)) return
    allocate (self%failure)
    self%failure%code = file_error
    self%failure%text = self%shown_name//': cannot write: '//with_remedy(reason)
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
    call flush_file(self, status)
    if (result_code == result_done) call put_attribute(self%file, 'complete', 1, status)
    call flush_file(self, status)
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

  !> Create an empty HDF5 file.
  subroutine open_new(self, file_name, error)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: file_name
    type(error_t), allocatable, intent(out) :: error
    integer :: status

    call ignore_size_limit_signal()
    call start_hdf5(status)
    call open_file(file_name, h5f_acc_excl_f, self%file, status)
    call file_descriptor(self%file, self%descriptor, status)
    self%sound = status == 0
    if (.not. self%sound) call raise(error, file_error, self%shown_name//': cannot create: '//with_remedy(failure_reason()))
  end subroutine open_new

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
      call write_metadata(self%file, metadata, status)
      call create_columns(self, columns, status)
      call flush_file(self, status)
      if (status < 0) call self%fail(failure_reason(), sound=.false.)
    end if
    if (allocated(self%failure)) error = self%failure
  end subroutine write_header

  !> What every result file says about its origin.
  subroutine write_metadata(file, metadata, status)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status

    call put_root_attributes(file, metadata, status)
    call put_deck(file, metadata, status)
    call put_parameters(file, metadata, status)
  end subroutine write_metadata

  subroutine put_root_attributes(file, metadata, status)
    integer(hid_t), intent(in) :: file
    type(run_metadata_t), intent(in) :: metadata
    integer, intent(inout) :: status

    call put_attribute(file, 'program', metadata%program, status)
    call put_attribute(file, 'version', metadata%version, status)
    call put_attribute(file, 'git_revision', metadata%git_revision, status)
    call put_attribute(file, 'compiler', metadata%compiler, status)
    call put_attribute(file, 'created', metadata%created, status)
    call put_attribute(file, 'build_flags', metadata%build_flags, status)
    call put_attribute(file, 'host', metadata%host, status)
    call put_attribute(file, 'job', metadata%job, status)
    call put_attribute(file, 'mpi', metadata%mpi, status)
    call put_attribute(file, 'processes', metadata%processes, status)
    call put_attribute(file, 'threads', metadata%threads, status)
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

    if (size(columns) == 0) return
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
        call attach_scale(self%columns(i)%dataset, self%columns(1), status)
      end if
    end do
    call close_group(group, status)

    call create_group(self%file, 'events', group, status)
    call create_column(group, quantity_t('time', 's', 'time of the event'), h5t_ieee_f64le, event_chunk, self%event_time, status)
    call create_column(group, quantity_t('kind', '1', '1 = stick begins, 2 = slip begins'), h5t_std_i8le, event_chunk, &
      self%event_kind, status)
    call make_scale(self%event_time, 'time', status)
    call attach_scale(self%event_kind%dataset, self%event_time, status)
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

  subroutine open_columns(self, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer :: i

    do i = 1, size(columns)
      call open_column(self%file, 'time_series/'//trim(columns(i)%name), self%chunk_rows, self%columns(i), status)
    end do
    call open_column(self%file, 'events/time', event_chunk, self%event_time, status)
    call open_column(self%file, 'events/kind', event_chunk, self%event_kind, status)
    if (doubles_lose_digits) call open_remainders(self, columns, status)
  end subroutine open_columns

  !> Whether the copied columns are those of the bookmark; `reason` says which is not.
  subroutine check_bookmark(self, bookmark, columns, reason)
    class(hdf5_writer_t), intent(in) :: self
    type(bookmark_t), intent(in) :: bookmark
    type(quantity_t), intent(in) :: columns(:)
    character(:), allocatable, intent(inout) :: reason   !! unallocated if all are
    integer :: i

    do i = 1, size(columns)
      call check_column('time_series/'//trim(columns(i)%name), self%columns(i), bookmark%rows, bookmark%checksum(i))
    end do
    call check_column('events/time', self%event_time, bookmark%events, bookmark%checksum(i))
    call check_column('events/kind', self%event_kind, bookmark%events, bookmark%checksum(i + 1))

  contains

    subroutine check_column(name, column, rows, checksum)
      character(*), intent(in) :: name
      type(column_t), intent(in) :: column
      integer(int64), intent(in) :: rows, checksum

      if (allocated(reason)) return
      if (column%rows < rows) then
        reason = name//' has fewer rows than when the checkpoint was written: run the deck again'
      else if (column%checksum /= checksum) then
        reason = name//' is not as it was when the checkpoint was written: run the deck again'
      end if
    end subroutine check_column
  end subroutine check_bookmark

  !> Drop what was written after the bookmark, and how the run ended.
  subroutine cut_columns(self, bookmark, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(bookmark_t), intent(in) :: bookmark
    integer, intent(inout) :: status
    integer :: i

    do i = 1, size(self%columns)
      call cut_column(self%columns(i), int(bookmark%rows, hsize_t), status)
      self%columns(i)%checksum = bookmark%checksum(i)
    end do
    call cut_column(self%event_time, int(bookmark%events, hsize_t), status)
    call cut_column(self%event_kind, int(bookmark%events, hsize_t), status)
    self%event_time%checksum = bookmark%checksum(i)
    self%event_kind%checksum = bookmark%checksum(i + 1)
    if (doubles_lose_digits) call cut_remainders(self, bookmark, status)
    call delete_link(self%file, 'summary', status)
    call delete_link(self%file, 'statistics', status)
    call put_attribute(self%file, 'result_code', -1, status)
    call put_attribute(self%file, 'result_text', 'running', status)
    ! Before the space that is now free is written to: until then the file still refers to it.
    call flush_file(self, status)
  end subroutine cut_columns

  subroutine open_remainders(self, columns, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(quantity_t), intent(in) :: columns(:)
    integer, intent(inout) :: status
    integer :: i

    if (.not. allocated(self%remainders)) allocate (self%remainders(size(columns)))
    do i = 1, size(columns)
      call open_column(self%file, 'remainder/time_series/'//trim(columns(i)%name), self%chunk_rows, self%remainders(i), status)
    end do
    call open_column(self%file, 'remainder/events/time', event_chunk, self%event_remainder, status)
  end subroutine open_remainders

  subroutine cut_remainders(self, bookmark, status)
    class(hdf5_writer_t), intent(inout) :: self
    type(bookmark_t), intent(in) :: bookmark
    integer, intent(inout) :: status
    integer :: i

    do i = 1, size(self%remainders)
      call cut_column(self%remainders(i), int(bookmark%rows, hsize_t), status)
    end do
    call cut_column(self%event_remainder, int(bookmark%events, hsize_t), status)
  end subroutine cut_remainders

  subroutine allocate_waiting(self, columns, expected_rows)
    class(hdf5_writer_t), intent(inout) :: self
    integer, intent(in) :: columns
    integer, intent(in), optional :: expected_rows

    self%chunk_rows = usual_chunk
    if (present(expected_rows)) self%chunk_rows = max(smallest_chunk, min(expected_rows, largest_chunk))
    allocate (self%columns(columns), self%samples(self%chunk_rows, columns), self%events(event_chunk, 2))
  end subroutine allocate_waiting

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

  subroutine close_group(group, status)
    integer(hid_t), intent(in) :: group
    integer, intent(inout) :: status

    if (status < 0) return
    call h5gclose_f(group, status)
  end subroutine close_group

  subroutine flush_file(self, status)
    class(hdf5_writer_t), intent(in) :: self
    integer, intent(inout) :: status

    if (status < 0) return
    ! What the child writes, this process writes again, so that a kill in between tears nothing. The child shares the
    ! lock: without it, it does not keep a reader out of the file of a run that was killed.
    call unlock_file(self%descriptor)
    if (is_child()) then
      call h5fflush_f(self%file, h5f_scope_local_f, status)
      call end_child()
    end if
    call lock_file(self%descriptor)
    call h5fflush_f(self%file, h5f_scope_local_f, status)
  end subroutine flush_file
end module dst_hdf5_writer
