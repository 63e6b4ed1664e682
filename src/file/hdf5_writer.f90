!> The result file of one run, in HDF5.
!>
!> Samples and events wait in memory for a chunk of rows and are written at once, so that the memory does not grow with the run.
!> Written rows become part of the file with a flush. In between, the file stays as it was at the last flush, since new rows are
!> written to unused space. During the microseconds of a flush it would be inconsistent, so a child process writes first, which
!> survives if this one is killed. Before each write the disk space for it and for the file's ending is reserved: if the disk is
!> full, this is detected while the file is still consistent, and the data stay readable.
!>
!> Columns are doubles. In a build with more digits /remainder contains, under the same names, the rounding errors as doubles: the
!> sum of both has 32 digits, and every reader can use the other datasets.
module dst_hdf5_writer
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_kinds, only: wp, real64, int64
  use dst_errors, only: error_t, raise, file_error, result_done
  use dst_writer, only: writer_t, quantity_t, outcome_t
  use dst_archive, only: archive_t
  use dst_checkpoint, only: provenance_t
  use dst_crc32, only: crc32_t
  use dst_disk, only: reserve_space, set_file_size, make_durable, lock_file, unlock_file, with_remedy
  use dst_hdf5_library, only: hid_t, hsize_t, h5fclose, h5fflush, h5fget_filesize, h5f_acc_excl, h5f_acc_rdwr, h5f_scope_local, &
    h5t_ieee_f64le, h5t_std_i8le, h5t_std_i64le
  use dst_hdf5_tools, only: hdf5_t, start_hdf5, open_file, open_existing, failure_reason, damage_reason, file_descriptor, &
    put_attribute, put_value, create_group, delete_link, release, dataset_t, create_dataset, open_dataset, append, cut, &
    read_rows, make_scale, attach_scale
  use dst_parameters, only: parameter_t
  use dst_process, only: guard_t, is_child, end_child
  implicit none
  private

  public :: write_metadata, put_ending, hdf5_writer_t, run_metadata_t
  public :: bookmark_t, empty_bookmark, create_hdf5, rebuild_hdf5, reopen_hdf5

  !> The description of a run that its file contains before the run begins.
  type, extends(provenance_t) :: run_metadata_t
    character(:), allocatable :: program
    character(:), allocatable :: model, method
    character(:), allocatable :: model_choice    !! why 'auto' is this model; '' if the deck names the model
    character(:), allocatable :: build_flags     !! of the compiler
    character(:), allocatable :: host, job       !! machine that wrote it, and the job of its scheduler; '' if there is none
    character(:), allocatable :: mpi             !! the library; '' if the program has none
    integer :: processes = 1, threads = 1        !! number of processes that shared the work; threads of each process
    type(parameter_t), allocatable :: parameters(:)
  end type run_metadata_t

  logical, parameter :: doubles_lose_digits = digits(1.0_wp) > digits(1.0_real64)
  !> Groups of columns, and the datasets that keep one column.
  integer, parameter :: series = 1, events = 2, parts = merge(2, 1, doubles_lose_digits)
  character(*), parameter :: group_name(2) = [character(11) :: 'time_series', 'events']

  !> A dataset of doubles that grows with the run.
  type :: column_t
    integer :: group = series                        !! or `events`
    integer :: place = 0                             !! in the rows of that group
    integer :: part = 1                              !! 2: rounding errors of the doubles
    type(quantity_t) :: quantity
    type(dataset_t) :: dataset = dataset_t()
    type(crc32_t) :: checksum = crc32_t()            !! of all its rows
  contains
    procedure :: path => path_of_column
    procedure :: append => append_to_column
  end type column_t

  !> Rows of a group that wait to be appended to its columns.
  type :: waiting_t
    real(wp), allocatable :: values(:, :)            !! (row in a chunk, place)
    integer :: count = 0
  end type waiting_t

  !> How far a file has been written.
  type :: bookmark_t
    integer(int64) :: rows(2) = 0                    !! samples, events
    character(8), allocatable :: checksums(:)        !! CRC-32 of each column up to there
  contains
    procedure :: serialise => serialise_bookmark
  end type bookmark_t

  !> The result file of one run, open for writing.
  type, extends(writer_t) :: hdf5_writer_t
    private
    character(:), allocatable :: shown_name       !! name in messages
    integer(hid_t) :: file = -1
    integer(c_int) :: descriptor = -1
    type(column_t), allocatable :: columns(:)     !! of the time series, of the events, then the rounding errors of these
    type(waiting_t) :: waiting(2)
    integer(int64) :: rows(2) = 0                 !! of samples and events in the file
    logical :: sound = .false.                    !! no write has failed half-way
    integer(int64) :: reserved = 0                !! bytes, more than the header of the file has ever counted
    type(error_t), allocatable :: failure         !! the first one; after it nothing more is appended
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: flush => flush_all
    procedure :: finish
    procedure :: discard
    procedure :: set_bookmark
    procedure, private :: write_row
    procedure, private :: write_waiting
    procedure, private :: reserve
    procedure, private :: fail
  end type hdf5_writer_t

  integer, parameter :: smallest_chunk = 64, usual_chunk = 1024, largest_chunk = 4096   ! rows
  integer, parameter :: event_chunk = 1024                                              ! rows
  !> Space that is kept for the file's ending: summary, statistics and attributes take some 60 kB.
  integer(int64), parameter :: ending_bytes = 131072
  !> Space that a column's index may take when one chunk is added.
  integer(int64), parameter :: index_bytes = 4096

contains

  !> Create the file of a run; a name that is already used is refused. After a failure the file has to be discarded.
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
    call start_hdf5(h5)
    call open_file(file_name, h5f_acc_excl, self%file, h5)
    call file_descriptor(self%file, self%descriptor, h5)
    self%sound = h5%status >= 0
    if (.not. self%sound) then
      call raise(error, file_error, shown_name//': cannot create: '//with_remedy(failure_reason()))
      return
    end if
    call self%reserve()
    if (.not. allocated(self%failure)) then
      call write_metadata(self%file, metadata, h5)
      if (size(columns) > 0) call create_columns(self, h5)
      call flush_file(self, h5)
      if (h5%status < 0) call self%fail(failure_reason(), sound=.false.)
    end if
    if (allocated(self%failure)) error = self%failure
  end subroutine create_hdf5

  !> The data that are kept in memory; without columns of samples there are none of events either.
  subroutine prepare(self, shown_name, quantities, expected_rows)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: shown_name
    type(quantity_t), intent(in) :: quantities(:)
    integer, intent(in), optional :: expected_rows
    type(quantity_t), parameter :: event_quantities(2) = [quantity_t('time', 's', 'time of the event'), &
      quantity_t('kind', '1', '1 = stick begins, 2 = slip begins')]
    integer :: chunk_rows, part, i

    self%shown_name = shown_name
    chunk_rows = usual_chunk
    if (present(expected_rows)) chunk_rows = max(smallest_chunk, min(expected_rows, largest_chunk))
    allocate (self%columns(0), self%waiting(series)%values(chunk_rows, size(quantities)), &
      self%waiting(events)%values(event_chunk, size(event_quantities)))
    if (size(quantities) == 0) return
    do part = 1, parts
      self%columns = [self%columns, (column_t(series, i, part, quantities(i)), i=1, size(quantities)), &
        (column_t(events, i, part, event_quantities(i)), i=1, size(event_quantities))]
    end do
    do i = 1, size(self%columns)
      call self%columns(i)%checksum%start()
    end do
  end subroutine prepare

  subroutine create_columns(self, h5)
    class(hdf5_writer_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    type(column_t) :: first(2)
    integer(hid_t) :: parent, groups(2, parts), stored_as
    integer :: part, i

    parent = self%file
    do part = 1, parts
      if (part > 1) call create_group(self%file, 'remainder', parent, h5)
      do i = 1, size(groups, 1)
        call create_group(parent, trim(group_name(i)), groups(i, part), h5)
      end do
    end do
    do i = 1, size(self%columns)
      associate (column => self%columns(i))
        stored_as = h5t_ieee_f64le
        if (column%part > 1) then
          column%quantity%long_name = 'to be added to '//column%path(1)
        else if (column%quantity%name == 'sticking' .or. column%quantity%name == 'kind') then
          stored_as = h5t_std_i8le
        end if
        call create_dataset(groups(column%group, column%part), column%quantity, size(self%waiting(column%group)%values, 1), &
          column%dataset, h5, stored_as)
        if (column%part > 1) cycle
        if (column%place == 1) then
          call make_scale(column%dataset, 'time', h5)
          first(column%group) = column
        else
          call attach_scale(column%dataset, first(column%group)%dataset, 1, h5)
        end if
      end associate
    end do
    call release([groups], h5)
  end subroutine create_columns

  !> Close a file that is not needed.
  subroutine discard(self)
    class(hdf5_writer_t), intent(inout) :: self

    if (self%sound) call close_file(self)
    self%sound = .false.
  end subroutine discard

  !> Write the file of a run that was killed again as `new_name`: its header from `metadata`, its columns with the numbers they had
  !> at `bookmark`. Only numbers come from the old file, and all of them are checked; damage in its structure cannot affect the new
  !> file. It can make HDF5 crash or loop: this procedure is for a child process, which reports its progress to `guard`.
  subroutine rebuild_hdf5(file_name, new_name, shown_name, bookmark, metadata, columns, guard, error, expected_rows)
    character(*), intent(in) :: file_name, new_name, shown_name
    type(bookmark_t), intent(in) :: bookmark
    type(run_metadata_t), intent(in) :: metadata
    type(quantity_t), intent(in) :: columns(:)
    type(guard_t), intent(in) :: guard
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! as when the file was created
    type(hdf5_writer_t) :: old, new
    type(hdf5_t) :: h5
    character(:), allocatable :: reason
    integer :: ignored

    call prepare(old, shown_name, columns, expected_rows)
    call open_existing(file_name, old%file, h5)
    call open_columns(old, h5)
    if (h5%status < 0) reason = damage_reason(h5)
    if (.not. allocated(reason)) then
      call create_hdf5(new, new_name, shown_name, metadata, columns, error, expected_rows)
      if (.not. allocated(error)) then
        call copy_columns(old, new, bookmark, guard, reason)
        if (.not. allocated(reason)) call make_durable(new%descriptor, reason)
        call close_file(new)
        if (allocated(new%failure) .and. .not. allocated(reason)) reason = new%failure%text
      end if
    end if
    if (old%file >= 0) ignored = h5fclose(old%file)
    if (allocated(reason)) call raise(error, file_error, shown_name//': cannot resume: '//reason)
  end subroutine rebuild_hdf5

  !> Copy the rows that every column of `old` had at `bookmark` to the empty columns of `new`; `reason` names a column without them.
  subroutine copy_columns(old, new, bookmark, guard, reason)
    type(hdf5_writer_t), intent(in) :: old
    type(hdf5_writer_t), intent(inout) :: new
    type(bookmark_t), intent(in) :: bookmark
    type(guard_t), intent(in) :: guard
    character(:), allocatable, intent(out) :: reason
    integer(hsize_t), parameter :: most = 65536
    integer(int64), parameter :: row_bytes = 10   !! including the overhead of HDF5
    real(real64), allocatable :: values(:)
    type(hdf5_t) :: h5
    integer(int64) :: left
    integer :: i

    call reserve_space(new%descriptor, 0_int64, &
      ending_bytes + sum(index_bytes + row_bytes*bookmark%rows(new%columns%group)), reason)
    do i = 1, size(new%columns)
      associate (from => old%columns(i)%dataset, column => new%columns(i))
        do while (h5%status >= 0 .and. .not. allocated(reason))
          left = min(int(from%rows, int64), bookmark%rows(column%group)) - column%dataset%rows
          if (left <= 0) exit
          call guard%show_life()
          allocate (values(min(most, left)))
          call read_rows(from, column%dataset%rows, values, h5)
          call column%append(values, h5)
          deallocate (values)
        end do
        if (h5%status < 0 .and. .not. allocated(reason)) reason = damage_reason(h5)
        if (allocated(reason)) return
        if (column%dataset%rows < bookmark%rows(column%group)) then
          reason = column%path()//' has fewer rows than when the checkpoint was written: run the deck again'
        else if (column%checksum%text() /= bookmark%checksums(i)) then
          reason = column%path()//' is not as it was when the checkpoint was written: run the deck again'
        end if
      end associate
    end do
  end subroutine copy_columns

  !> Open the file of an unfinished run to continue it from `bookmark`; later rows of the file are dropped. It must be as this
  !> program left it.
  subroutine reopen_hdf5(self, file_name, shown_name, bookmark, columns, error, expected_rows)
    class(hdf5_writer_t), intent(out) :: self
    character(*), intent(in) :: file_name, shown_name
    type(bookmark_t), intent(in) :: bookmark
    type(quantity_t), intent(in) :: columns(:)
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in), optional :: expected_rows    !! as when the file was created
    type(hdf5_t) :: h5

    call prepare(self, shown_name, columns, expected_rows)
    call start_hdf5(h5)
    call open_file(file_name, h5f_acc_rdwr, self%file, h5)
    call file_descriptor(self%file, self%descriptor, h5)
    call open_columns(self, h5)
    ! Before anything is changed.
    if (h5%status >= 0) call self%reserve()
    if (h5%status >= 0 .and. .not. allocated(self%failure)) call return_to(self, bookmark, h5)
    self%sound = h5%status >= 0 .and. .not. allocated(self%failure)
    if (self%sound) return
    if (allocated(self%failure)) then
      error = self%failure
    else
      call raise(error, file_error, shown_name//': cannot resume: '//with_remedy(failure_reason()))
    end if
  end subroutine reopen_hdf5

  subroutine open_columns(self, h5)
    class(hdf5_writer_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    do i = 1, size(self%columns)
      associate (column => self%columns(i))
        call open_dataset(self%file, column%path(), size(self%waiting(column%group)%values, 1), column%dataset, h5)
      end associate
    end do
  end subroutine open_columns

  !> Drop the data after the bookmark, and the attributes of how the run ended.
  subroutine return_to(self, bookmark, h5)
    class(hdf5_writer_t), intent(inout) :: self
    type(bookmark_t), intent(in) :: bookmark
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    self%rows = bookmark%rows
    do i = 1, size(self%columns)
      call cut(self%columns(i)%dataset, int(bookmark%rows(self%columns(i)%group), hsize_t), h5)
      call self%columns(i)%checksum%start(bookmark%checksums(i))
    end do
    call delete_link(self%file, 'summary', h5)
    call delete_link(self%file, 'statistics', h5)
    call put_ending(self%file, -1, 'running', h5)
    ! Before the space that is now free is written to: until then the file still refers to it.
    call flush_file(self, h5)
  end subroutine return_to

  !> Write and flush all waiting rows, and return how far the file then is.
  subroutine set_bookmark(self, durable, bookmark, error)
    class(hdf5_writer_t), intent(inout) :: self
    logical, intent(in) :: durable                    !! make sure that all this survives a power failure
    type(bookmark_t), intent(out) :: bookmark
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    integer :: i

    call self%write_waiting(flush_now=.true., error=error)
    if (allocated(error)) return
    if (durable) call make_durable(self%descriptor, reason)
    if (allocated(reason)) then
      call self%fail(reason, sound=.false.)
      error = self%failure
      return
    end if
    bookmark = empty_bookmark(size(self%waiting(series)%values, 2))
    bookmark%rows = self%rows
    do i = 1, size(self%columns)
      bookmark%checksums(i) = self%columns(i)%checksum%text()
    end do
  end subroutine set_bookmark

  !> A bookmark for a file with this number of columns in its time series, to be loaded.
  type(bookmark_t) function empty_bookmark(columns) result(bookmark)
    integer, intent(in) :: columns
    integer, parameter :: event_columns = 2

    allocate (bookmark%checksums(parts*(columns + event_columns)))
    bookmark%checksums = ''
  end function empty_bookmark

  !> Save or load. A checksum's text has the length of a word.
  subroutine serialise_bookmark(self, archive)
    class(bookmark_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer(int64) :: words(size(self%checksums))

    words = transfer(self%checksums, words)
    call archive%serialise(self%rows)
    call archive%serialise(words)
    self%checksums = transfer(words, self%checksums)
  end subroutine serialise_bookmark

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

  subroutine write_events(self, time, kind, error)
    class(hdf5_writer_t), intent(inout) :: self
    real(wp), intent(in) :: time(:)
    integer, intent(in) :: kind(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    do i = 1, size(time)
      call self%write_row(events, [time(i), real(kind(i), wp)], error)
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
        call self%write_waiting(flush_now=.false., error=error)
    end associate
  end subroutine write_row

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

  !> Append the waiting rows, and flush on request.
  subroutine write_waiting(self, flush_now, error)
    class(hdf5_writer_t), intent(inout) :: self
    logical, intent(in) :: flush_now
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer :: i

    if (.not. allocated(self%failure) .and. any(self%waiting%count > 0)) call self%reserve()
    if (.not. allocated(self%failure)) then
      do i = 1, size(self%columns)
        associate (column => self%columns(i), waiting => self%waiting(self%columns(i)%group))
          call column%append(as_double(waiting%values(:waiting%count, column%place), column%part), h5)
        end associate
      end do
      if (flush_now) call flush_file(self, h5)
      if (h5%status < 0) call self%fail(failure_reason(), sound=.false.)
    end if
    self%rows = self%rows + self%waiting%count
    self%waiting%count = 0
    if (allocated(self%failure)) error = self%failure
  end subroutine write_waiting

  !> A number as a double, or its rounding error.
  elemental real(real64) function as_double(value, part)
    real(wp), intent(in) :: value
    integer, intent(in) :: part

    as_double = real(value, real64)
    if (part > 1) as_double = real(value - real(as_double, wp), real64)
  end function as_double

  subroutine append_to_column(self, values, h5)
    class(column_t), intent(inout) :: self
    real(real64), intent(in), contiguous :: values(:)
    type(hdf5_t), intent(inout) :: h5

    call append(self%dataset, size(values), values, h5)
    call self%checksum%add_words(transfer(values, [0_int64]))
  end subroutine append_to_column

  !> The path of a column in the file; of `part`, if it is given.
  function path_of_column(self, part) result(path)
    class(column_t), intent(in) :: self
    integer, intent(in), optional :: part
    character(:), allocatable :: path

    path = trim(group_name(self%group))//'/'//trim(self%quantity%name)
    if (present(part)) return
    if (self%part > 1) path = 'remainder/'//path
  end function path_of_column

  !> Make sure that the disk has room for one chunk of everything and for the file's ending.
  subroutine reserve(self)
    class(hdf5_writer_t), intent(inout) :: self
    integer(hsize_t) :: present_size
    integer(int64) :: needed
    character(:), allocatable :: reason
    integer :: i

    if (h5fget_filesize(self%file, present_size) < 0) return
    needed = ending_bytes
    do i = 1, size(self%columns)
      needed = needed + 2*(8_int64*size(self%waiting(self%columns(i)%group)%values, 1) + index_bytes)
    end do
    self%reserved = max(self%reserved, int(present_size, int64) + needed)
    call reserve_space(self%descriptor, int(present_size, int64), self%reserved, reason)
    if (allocated(reason)) call self%fail(reason, sound=.true.)
  end subroutine reserve

  !> Keep the first failure, and whether the open file is still consistent. If not, HDF5 may have cut off data that an older header
  !> on the disk still counts, and no reader would open the file: its length is restored.
  subroutine fail(self, reason, sound)
    class(hdf5_writer_t), intent(inout) :: self
    character(*), intent(in) :: reason
    logical, intent(in) :: sound

    self%sound = sound
    if (.not. sound) call set_file_size(self%descriptor, self%reserved)
    if (allocated(self%failure)) return
    call raise(self%failure, file_error, self%shown_name//': cannot write: '//with_remedy(reason))
  end subroutine fail

  !> Write how the run ended; `complete` is written after everything else has reached the file.
  subroutine write_ending(self, outcome, error)
    class(hdf5_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(in) :: error
    type(hdf5_t) :: h5
    integer :: result_code
    character(:), allocatable :: result_text

    result_code = outcome%result_code
    result_text = ''
    if (allocated(outcome%result_text)) result_text = outcome%result_text
    if (allocated(error)) then
      result_code = error%code
      result_text = error%text
    end if
    call put_results(self%file, 'summary', outcome%summary, outcome%summary_value, h5)
    call put_results(self%file, 'statistics', outcome%statistics, outcome%statistics_value, h5)
    call put_ending(self%file, result_code, result_text, h5)
    call flush_file(self, h5)
    if (result_code == result_done) call put_attribute(self%file, 'complete', 1, h5)
    call flush_file(self, h5)
    if (h5%status < 0) call self%fail(failure_reason(), sound=.false.)
  end subroutine write_ending

  !> A group of numbers about how the run ended; counters are stored as integers.
  subroutine put_results(file, name, quantities, values, h5)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(quantity_t), intent(in), allocatable :: quantities(:)
    real(wp), intent(in), allocatable :: values(:)
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: group
    integer :: i

    call delete_link(file, name, h5)
    call create_group(file, name, group, h5)
    if (allocated(quantities)) then
      do i = 1, size(quantities)
        call put_value(group, quantities(i), values(i), h5, merge(h5t_std_i64le, h5t_ieee_f64le, quantities(i)%counts))
      end do
    end if
    call release([group], h5)
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
    call put_attribute(file, 'mpi', metadata%mpi, h5)
    call put_attribute(file, 'processes', metadata%processes, h5)
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
    call release([group], h5)

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
    call release([group], h5)
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

  !> Close the file and free the disk space that it did not need.
  subroutine close_file(self)
    class(hdf5_writer_t), intent(inout) :: self
    integer(hsize_t) :: bytes

    if (h5fget_filesize(self%file, bytes) >= 0) call set_file_size(self%descriptor, int(bytes, int64))
    if (h5fclose(self%file) < 0) call self%fail(failure_reason(), sound=.false.)
    self%file = -1
  end subroutine close_file

  subroutine flush_file(self, h5)
    class(hdf5_writer_t), intent(in) :: self
    type(hdf5_t), intent(inout) :: h5

    if (h5%status < 0) return
    ! The child's data are written by this process again, so that a kill in between does no harm. The child shares the lock: without
    ! the lock, a reader could open the file of a run that was killed while the child writes.
    call unlock_file(self%descriptor)
    if (is_child()) then
      h5%status = h5fflush(self%file, h5f_scope_local)
      call end_child()
    end if
    call lock_file(self%descriptor)
    h5%status = h5fflush(self%file, h5f_scope_local)
  end subroutine flush_file
end module dst_hdf5_writer
