!> The finished cases of one process: a file of records, one for each case, each appended with one system call.
!>
!> A process that is killed leaves complete records and at most a part of one at the end, which its checksum reveals; the next
!> process that opens the shard cuts it off. A record is a row of 64-bit words in the order of this machine: case and result code,
!> length and bytes of the message, the values, the message, the series or the cycles, the checksum. A file of that name may have
!> been written by another program: it is emptied or removed only if it begins with the magic word, and the numbers in a record are
!> used only if they are possible in this sweep.
!>
!> The head identifies the sweep, the build of the program, and the division of which this is a part. If the name is used by a shard
!> of another build or division, a process appends .1, .2, ... to it.
module dst_sweep_shard
  use, intrinsic :: iso_c_binding, only: c_int, c_f_pointer, c_loc
  use, intrinsic :: iso_fortran_env, only: int8
  use dst_crc32, only: crc32_t
  use dst_disk, only: open_for_appending, open_for_reading, is_locked_elsewhere, lock_attempt, held, append_words, read_words, &
    close_descriptor, set_file_size, delete_file, file_exists, identity_t, identity_of, matching_files, path_t, seconds_now, &
    wait_seconds
  use dst_division, only: division_t
  use dst_errors, only: error_t, raise, file_error, out_of_memory, stopped_early
  use dst_kinds, only: wp, int64, real64
  use dst_sweep, only: sweep_t, case_t, value_count, table_quantities
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: shard_t, head_t, index_t, layout_t, layout_of, shards_of, open_shard, empty_shard, delete_shard
  public :: divisions_of, is_being_written
  public :: missing, is_done, without_concern, inspect_shard, check_sweep, scan_shard, open_records, read_record

  !> A shard, open for reading or for appending finished cases; a part of it is in memory. Words are counted from 0.
  type :: shard_t
    private
    character(:), allocatable :: file_name
    integer(c_int) :: descriptor = -1
    integer(int64) :: bytes = 0               !! of the file
    integer(int64) :: first = 0, end = 0      !! words of the file: the first in `window`, and the one after its last
    integer(int64), allocatable :: window(:)  !! or the next record
  contains
    procedure :: append => append_case
    procedure :: close => close_shard
    procedure, private :: show
  end type shard_t

  !> The samples or cycles in a record of a sweep.
  type :: layout_t
    integer :: columns = 0   !! 0 = none are kept
    integer :: rows = 0      !! at most
  end type layout_t

  !> The description of a record by its own numbers.
  type :: record_t
    logical :: is_possible = .false.          !! in this sweep
    integer :: case = 0, result_code = 0, message_bytes = 0, rows = 0
    integer(int64) :: length = 0              !! words
  end type record_t

  !> Consecutive records in a shard, of cases of one block.
  type :: stretch_t
    integer :: shard = 0
    integer :: records = 0
    integer(int64) :: first = 0, end = 0         !! words: of the first record, and after the last
    integer :: next = 0                          !! stretch of the same block
  end type stretch_t

  !> Which cases there are, and where: for each block of cases, a list of stretches.
  type :: index_t
    integer(int8), allocatable :: state(:)       !! of each case: one of those below
    integer :: block = 0                         !! cases of a block; 0: the places are not needed
    integer, allocatable :: first(:), last(:)    !! stretch of each block; 0: none
    type(stretch_t), allocatable :: stretches(:)
    integer :: count = 0                         !! of stretches
    integer :: done = 0
    integer :: failed = 0
    integer :: of_other_builds = 0               !! number of shards that were skipped
    logical :: is_in_result = .false.            !! all cases are in the result file, and only shards have to be removed
    integer(int64) :: begun = 0, ended = 0       !! first head and last change of the shards [s since 1970]
  contains
    procedure :: allocate => allocate_index
    procedure, private :: note
  end type index_t

  !> The contents of the head of a shard.
  type :: head_t
    character(24) :: identity = ''               !! of the sweep: deck as used, list
    character(16) :: build = ''                  !! of the program: version, revision
    integer :: values = value_count, columns = 0 !! of a case, of its series or cycles
    integer :: cases = 0
    integer(int64) :: begun = 0                  !! s since 1970
    type(division_t) :: division = division_t()
    logical :: is_whole = .true.                 !! false: of a process that was killed before it had written it, or is writing it
  contains
    procedure :: is_of_build
    procedure, private :: is_part_of
  end type head_t

  !> States of a case: in no shard; in one; not needed.
  integer(int8), parameter :: missing = 0, is_done = 1, without_concern = 2
  integer(int64), parameter :: magic = int(z'445354534841524B', int64)
  integer, parameter :: word_bytes = 8
  !> Words of the header: magic word, identity of the sweep (3) and the build (2), values and columns, cases and time, I and N,
  !> first and last index of the array, its step and the processes of a task, checksum.
  integer, parameter :: header_words = 12
  !> Words of a record without message, series and cycles.
  integer, parameter :: shortest_record = 2 + value_count + 1
  integer, parameter :: longest_message = 4096  !! bytes
  integer(int64), parameter :: window_words = 8192   !! read at once
  character(*), parameter :: extension = '.shard-'
  integer, parameter :: shown = 12             !! characters of an identity in a message
  integer, parameter :: digits = 6             !! of its number

contains

  !> The shard of worker `number` of the sweep with the result `result_file`; `others` of this number existed before.
  function shard_name(result_file, number, others) result(name)
    character(*), intent(in) :: result_file
    integer, intent(in) :: number, others
    character(:), allocatable :: name
    character(digits) :: text

    write (text, '(i6.6)') number
    name = result_file//extension//text
    if (others > 0) name = name//'.'//integer_text(others)
  end function shard_name

  !> The shards of a result file.
  subroutine shards_of(result_file, files)
    character(*), intent(in) :: result_file
    type(path_t), allocatable, intent(out) :: files(:)

    type(path_t), allocatable :: found(:)
    logical, allocatable :: is_shard(:)
    integer :: i

    call matching_files(result_file//extension, found)
    allocate (is_shard(size(found)))
    do i = 1, size(found)
      is_shard(i) = is_number(found(i)%text(len(result_file//extension) + 1:))
    end do
    files = pack(found, is_shard)
  end subroutine shards_of

  !> 'NNNNNN' or 'NNNNNN.M'
  pure logical function is_number(text)
    character(*), intent(in) :: text
    character(*), parameter :: figures = '0123456789'

    is_number = .false.
    if (len(text) < digits) return
    is_number = verify(text(:digits), figures) == 0
    if (len(text) == digits .or. .not. is_number) return
    is_number = text(digits + 1:digits + 1) == '.' .and. len(text) > digits + 1 .and. verify(text(digits + 2:), figures) == 0
  end function is_number

  !> The limits of the records of a sweep.
  function layout_of(sweep) result(layout)
    type(sweep_t), intent(in) :: sweep
    type(layout_t) :: layout

    layout = layout_t(size(table_quantities(sweep)), sweep%table_rows())
  end function layout_of

  !> Open a shard of worker `number` for appending; the unfinished part that a killed process left at its end is cut off. Shards of
  !> another build or division with this name are skipped.
  subroutine open_shard(shard, result_file, number, head, layout, error)
    type(shard_t), intent(out), target :: shard
    character(*), intent(in) :: result_file
    integer, intent(in) :: number
    type(head_t), intent(in) :: head
    type(layout_t), intent(in) :: layout
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(head_t) :: found
    integer(int64) :: words
    character(:), allocatable :: file_name, reason
    logical :: is_others
    integer :: others

    others = 0
    do
      file_name = shard_name(result_file, number, others)
      call open_locked(file_name, head, shard, is_others, error)
      if (.not. (allocated(error) .or. is_others)) then
        call read_head(shard, found, error)
        if (.not. allocated(error)) is_others = .not. found%is_part_of(head)
      end if
      if (.not. is_others) exit
      call shard%close()
      others = others + 1
    end do
    if (.not. allocated(error)) call check_sweep(file_name, found, head, error)
    if (.not. allocated(error)) then
      allocate (index%state(0))
      call scan(shard, found, layout, 1, index, words)
      call set_file_size(shard%descriptor, word_bytes*words)
      if (words == 0) call append_words(shard%descriptor, words_of(head, seconds_now()), reason)
      if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
    end if
    if (allocated(error)) call shard%close()
  end subroutine open_shard

  !> Open and lock a shard. The process that has the lock may be of another division, or may have just created the shard.
  subroutine open_locked(file_name, head, shard, is_others, error)
    character(*), intent(in) :: file_name
    type(head_t), intent(in) :: head
    type(shard_t), intent(inout) :: shard
    logical, intent(out) :: is_others
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: most_tries = 10
    real(wp), parameter :: pause = 0.02_wp
    character(:), allocatable :: reason
    type(head_t) :: found
    logical :: is_elsewhere
    integer :: i

    shard%file_name = file_name
    is_others = .false.
    do i = 1, most_tries
      call open_for_appending(file_name, shard%descriptor, shard%bytes, is_elsewhere, reason)
      if (.not. is_elsewhere) exit
      call inspect_shard(file_name, found, error)
      if (.not. allocated(error)) is_others = .not. found%is_part_of(head)
      if (is_others) return
      call wait_seconds(pause)
    end do
    if (allocated(error)) deallocate (error)
    if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
  end subroutine open_locked

  !> Empty a shard of another sweep or build, unless a process is writing it. The file is kept, since another process may be about
  !> to open it. A file that is not a shard is refused.
  subroutine empty_shard(file_name, head, error)
    character(*), intent(in) :: file_name
    type(head_t), intent(in) :: head
    type(error_t), allocatable, intent(out) :: error
    type(shard_t) :: shard
    type(head_t) :: found
    character(:), allocatable :: reason
    logical :: is_elsewhere

    call open_for_appending(file_name, shard%descriptor, shard%bytes, is_elsewhere, reason)
    if (is_elsewhere) then
      ! The process that has the lock may have emptied the shard, and begun.
      call inspect_shard(file_name, found, error)
      if (.not. allocated(error)) call check_sweep(file_name, found, head, error)
      if (.not. allocated(error) .and. found%is_of_build(head)) return
    end if
    if (allocated(reason)) then
      call raise(error, file_error, file_name//': '//reason)
      return
    end if
    shard%file_name = file_name
    call read_head(shard, found, error)
    if (.not. allocated(error)) call check_sweep(file_name, found, head, error)
    if (allocated(error)) then
      ! Not if another process has done this meanwhile, and begun.
      if (is_shard(shard)) then
        call set_file_size(shard%descriptor, 0_int64)
        deallocate (error)
      end if
    else if (found%is_whole .and. .not. found%is_of_build(head)) then
      call set_file_size(shard%descriptor, 0_int64)
    end if
    call shard%close()
  end subroutine empty_shard

  !> Remove a shard whose cases are in the result file. Shards that another process has taken or removed meanwhile are left to it.
  subroutine delete_shard(file_name, head, error)
    character(*), intent(in) :: file_name
    type(head_t), intent(in) :: head
    type(error_t), allocatable, intent(out) :: error   !! the shard still exists
    type(error_t), allocatable :: others
    type(shard_t) :: shard
    type(head_t) :: found
    logical :: is_ours

    call open_records(file_name, shard, error)
    is_ours = .not. allocated(error)
    if (is_ours) is_ours = .not. is_locked_elsewhere(shard%descriptor)
    if (is_ours) call read_head(shard, found, error)
    is_ours = is_ours .and. .not. allocated(error)
    if (is_ours) call check_sweep(file_name, found, head, others)
    is_ours = is_ours .and. .not. allocated(others) .and. found%is_of_build(head)
    if (is_ours) call delete_file(file_name)
    call shard%close()
    if (.not. (is_ours .or. allocated(error))) return
    if (allocated(error)) deallocate (error)
    if (file_exists(file_name)) call raise(error, file_error, file_name//': the result is complete, but this shard could '// &
      'not be removed: run the same again, or remove it')
  end subroutine delete_shard

  !> Whether a process has a shard open for appending. Other processes may check at the same time.
  logical function is_being_written(file_name)
    character(*), intent(in) :: file_name
    type(error_t), allocatable :: error
    type(shard_t) :: shard

    call open_records(file_name, shard, error)
    is_being_written = .false.
    if (.not. allocated(error)) is_being_written = lock_attempt(shard%descriptor, shared=.true.) == held
    call shard%close()
  end function is_being_written

  pure function words_of(head, time) result(words)
    type(head_t), intent(in) :: head
    integer(int64), intent(in) :: time        !! s since 1970
    integer(int64) :: words(header_words)

    associate (division => head%division)
      words = [magic, transfer(head%identity, words, 3), transfer(head%build, words, 2), transfer([head%values, head%columns, &
        head%cases, int(time), division%share, division%shares, division%first, division%last, division%step, division%inner], &
        words, 5), 0_int64]
    end associate
    words(header_words) = checksum(words(:header_words - 1))
  end function words_of

  !> The head from its words, if all its numbers are possible.
  pure subroutine take_words(words, head, is_possible)
    integer(int64), intent(in) :: words(header_words)
    type(head_t), intent(out) :: head
    logical, intent(out) :: is_possible
    integer :: n(10)

    n = transfer(words(7:11), n)
    is_possible = all([n(:3), n(5:)] >= 0)
    if (.not. is_possible) return
    head%identity = transfer(words(2:4), head%identity)
    head%build = transfer(words(5:6), head%build)
    head%values = n(1)
    head%columns = n(2)
    head%cases = n(3)
    head%begun = shiftr(words(8), 32)
    head%division = division_t(share=n(5), shares=n(6), first=n(7), last=n(8), step=n(9), inner=n(10))
    is_possible = head%cases > 0 .and. head%division%is_possible()
  end subroutine take_words

  !> Whether this is of the same build; an incomplete head counts as being of any build.
  pure logical function is_of_build(self, head)
    class(head_t), intent(in) :: self
    type(head_t), intent(in) :: head

    is_of_build = self%build == head%build .or. .not. self%is_whole
  end function is_of_build

  !> Whether a process with this head continues a shard with that one; a shard of another sweep is not skipped either.
  pure logical function is_part_of(self, head)
    class(head_t), intent(in) :: self
    type(head_t), intent(in) :: head

    is_part_of = .not. self%is_whole .or. self%identity /= head%identity .or. &
      (self%is_of_build(head) .and. self%division%share == head%division%share .and. self%division%shares == head%division%shares)
  end function is_part_of

  !> CRC-32 of words. Its 8 hexadecimal digits fill a word.
  pure integer(int64) function checksum(words)
    integer(int64), intent(in), contiguous :: words(:)   ! contiguous, as a copy of a long record would be on the stack
    type(crc32_t) :: crc

    call crc%start()
    call crc%add_words(words)
    checksum = transfer(crc%text(), checksum)
  end function checksum

  !> Append a finished case. A series may be longer than a thread's stack: it is copied to the memory from which it is written.
  subroutine append_case(self, case, error)
    class(shard_t), intent(inout), target :: self
    type(case_t), intent(in) :: case
    type(error_t), allocatable, intent(out) :: error
    real(real64), pointer :: table(:, :)
    character(:), allocatable :: reason
    integer :: length, message_bytes, message_words, first, no_memory

    message_bytes = min(len(case%result_text), longest_message)
    message_words = words_for(message_bytes)
    length = shortest_record + message_words
    if (allocated(case%table)) length = length + size(case%table)
    if (allocated(self%window)) then
      if (size(self%window) < length) deallocate (self%window)
    end if
    no_memory = 0
    if (.not. allocated(self%window)) allocate (self%window(length), stat=no_memory)
    if (no_memory /= 0) then
      call raise(error, out_of_memory, 'no memory for the record of a case: keep fewer samples or use fewer threads')
      return
    end if
    associate (words => self%window, padded => case%result_text(:message_bytes)//repeat(' ', word_bytes))
      first = value_count + 3
      words(:first - 1) = [transfer([case%number, case%result_code, length, message_bytes], words, 2), &
        transfer(real(case%values, real64), words)]
      words(first:first + message_words - 1) = transfer(padded, words, message_words)
      if (allocated(case%table)) then
        call c_f_pointer(c_loc(words(first + message_words)), table, shape(case%table))
        table = real(case%table, real64)
      end if
      words(length) = checksum(words(:length - 1))
      call append_words(self%descriptor, words(:length), reason)
    end associate
    if (allocated(reason)) call raise(error, file_error, self%file_name//': '//reason)
  end subroutine append_case

  !> Number of words for this many bytes.
  pure integer function words_for(bytes)
    integer, intent(in) :: bytes

    words_for = (bytes + word_bytes - 1)/word_bytes
  end function words_for

  subroutine close_shard(self)
    class(shard_t), intent(inout) :: self

    call close_descriptor(self%descriptor)
  end subroutine close_shard

  !> Open a shard to read it.
  subroutine open_records(file_name, shard, error)
    character(*), intent(in) :: file_name
    type(shard_t), intent(out) :: shard
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    shard%file_name = file_name
    call open_for_reading(file_name, shard%descriptor, shard%bytes, reason)
    if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
  end subroutine open_records

  !> Some words of the file, valid until others are requested; words that do not exist are 0.
  subroutine show(self, place, count, words)
    class(shard_t), intent(inout), target :: self
    integer(int64), intent(in) :: place, count
    integer(int64), pointer, contiguous, intent(out) :: words(:)

    if (place < self%first .or. place + count > self%end) then
      if (allocated(self%window)) deallocate (self%window)
      allocate (self%window(max(count, window_words)))
      self%first = place
      self%end = place + size(self%window)
      call read_words(self%descriptor, place, self%window)
    end if
    words => self%window(place - self%first + 1:place - self%first + count)
  end subroutine show

  !> Whether a file is empty or begins with the magic word, or with the part of it that a killed process wrote.
  logical function is_shard(shard)
    type(shard_t), intent(in) :: shard
    integer(int64) :: first(1)
    character(word_bytes) :: beginning, expected
    integer :: there

    call read_words(shard%descriptor, 0_int64, first)
    beginning = transfer(first, beginning)
    expected = transfer(magic, expected)
    there = int(min(shard%bytes, int(word_bytes, int64)))
    is_shard = beginning(:there) == expected(:there)
  end function is_shard

  !> Read the head of a shard. A file without a valid head is refused.
  subroutine inspect_shard(file_name, head, error)
    character(*), intent(in) :: file_name
    type(head_t), intent(out) :: head
    type(error_t), allocatable, intent(out) :: error
    type(shard_t) :: shard

    call open_records(file_name, shard, error)
    if (.not. allocated(error)) call read_head(shard, head, error)
    call shard%close()
  end subroutine inspect_shard

  !> If there are thousands of shards, perhaps only the heads are needed: no more is read.
  subroutine read_head(shard, head, error)
    type(shard_t), intent(inout) :: shard
    type(head_t), intent(out) :: head
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: most_tries = 5
    type(identity_t) :: file
    integer :: i

    do i = 1, most_tries
      call read_head_once(shard, head, error)
      if (.not. allocated(error)) exit
      ! Another process may empty the file in this moment, and write its own head.
      call wait_seconds(0.005_wp)
      file = identity_of(shard%descriptor)
      shard%bytes = file%bytes
    end do
  end subroutine read_head

  subroutine read_head_once(shard, head, error)
    type(shard_t), intent(in) :: shard
    type(head_t), intent(out) :: head
    type(error_t), allocatable, intent(out) :: error
    integer(int64) :: words(header_words)
    logical :: is_possible

    head%is_whole = shard%bytes >= word_bytes*header_words
    if (.not. is_shard(shard)) then
      call raise(error, file_error, shard%file_name//': has the name of a shard of a sweep, but is none, or its head is '// &
        'damaged: move it away, or use another output file')
    else if (head%is_whole) then
      call read_words(shard%descriptor, 0_int64, words)
      call take_words(words, head, is_possible)
      if (words(header_words) /= checksum(words(:header_words - 1))) then
        call raise(error, file_error, shard%file_name//': is no shard of a sweep, or its head is damaged: remove it')
      else if (.not. is_possible) then
        call raise(error, file_error, shard%file_name//': is of another sweep, or of another version of deck or program: '// &
          'remove it, or use --overwrite')
      end if
    end if
  end subroutine read_head_once

  !> The divisions of the shards, the newest last; of two with the same time that with the longer name, which is newer.
  function divisions_of(heads, files) result(divisions)
    type(head_t), intent(in) :: heads(:)
    type(path_t), intent(in) :: files(:)
    type(division_t), allocatable :: divisions(:)
    integer, allocatable :: order(:)
    integer :: i, n

    allocate (order(0))
    do i = 1, size(heads)
      if (heads(i)%division%shares == 0) cycle
      do n = size(order), 1, -1
        if (heads(order(n))%begun < heads(i)%begun) exit
        if (heads(order(n))%begun == heads(i)%begun .and. len(files(order(n))%text) <= len(files(i)%text)) exit
      end do
      order = [order(:n), i, order(n + 1:)]
    end do
    divisions = heads(order)%division
  end function divisions_of

  !> Refuse a shard of another sweep.
  subroutine check_sweep(file_name, found, head, error)
    character(*), intent(in) :: file_name
    type(head_t), intent(in) :: found, head
    type(error_t), allocatable, intent(out) :: error
    logical :: is_same

    if (.not. found%is_whole) return
    is_same = found%identity == head%identity
    if (is_same .and. found%is_of_build(head)) &
      is_same = found%values == head%values .and. found%columns == head%columns .and. found%cases == head%cases
    if (.not. is_same) call raise(error, file_error, file_name//': is of another sweep, or of another version of deck or '// &
      'program: it has the identity '//found%identity(:shown)//', this sweep '//head%identity(:shown)// &
      ': remove it, or use --overwrite')
  end subroutine check_sweep

  !> Note in `index` the cases that shard `number` has and no other one before it; its first `records` are valid. Cases beyond the
  !> index's size are skipped.
  subroutine scan_shard(file_name, layout, number, index, records, error)
    character(*), intent(in) :: file_name
    type(layout_t), intent(in) :: layout
    integer, intent(in) :: number
    type(index_t), intent(inout) :: index
    integer, intent(out) :: records
    type(error_t), allocatable, intent(out) :: error
    type(shard_t), target :: shard
    type(head_t) :: head
    integer(int64) :: ignored

    records = 0
    call open_records(file_name, shard, error)
    if (.not. allocated(error)) call read_head(shard, head, error)
    if (.not. allocated(error)) call scan(shard, head, layout, number, index, ignored, records)
    call shard%close()
  end subroutine scan_shard

  !> The same for an open shard; `words` is the length of the valid part.
  subroutine scan(shard, head, layout, number, index, words, records)
    type(shard_t), intent(inout), target :: shard
    type(head_t), intent(in) :: head
    type(layout_t), intent(in) :: layout
    integer, intent(in) :: number
    type(index_t), intent(inout) :: index
    integer(int64), intent(out) :: words
    integer, intent(out), optional :: records
    type(record_t) :: record
    integer(int64), pointer, contiguous :: content(:)
    integer :: count

    words = 0
    count = 0
    if (head%is_whole) then
      words = header_words
      do
        record = record_at(shard, words, layout)
        if (.not. record%is_possible) exit
        call shard%show(words, record%length, content)
        if (content(record%length) /= checksum(content(:record%length - 1))) exit
        call index%note(record, number, words)
        words = words + record%length
        count = count + 1
      end do
    end if
    if (present(records)) records = count
  end subroutine scan

  !> Allocate room for `cases`, of which blocks of this size are read at once; 0: none is.
  subroutine allocate_index(self, cases, block, status)
    class(index_t), intent(inout) :: self
    integer, intent(in) :: cases, block
    integer, intent(out) :: status        !! 0, or not enough memory
    integer :: blocks

    self%block = block
    blocks = 0
    if (block > 0) blocks = (cases - 1)/block + 1
    allocate (self%state(cases), stat=status)
    if (status == 0) allocate (self%first(blocks), stat=status)
    if (status == 0) allocate (self%last(blocks), stat=status)
    if (status == 0) allocate (self%stretches(blocks), stat=status)
    if (status /= 0) return
    self%state = missing
    self%first = 0
    self%last = 0
  end subroutine allocate_index

  subroutine note(index, record, shard, place)
    class(index_t), intent(inout) :: index
    type(record_t), intent(in) :: record
    integer, intent(in) :: shard
    integer(int64), intent(in) :: place

    if (record%case > size(index%state)) return
    if (index%block > 0) call note_place((record%case - 1)/index%block + 1)
    if (index%state(record%case) /= missing) return
    index%state(record%case) = is_done
    index%done = index%done + 1
    if (record%result_code > 0) index%failed = index%failed + 1

  contains

    !> A record that follows the last stretch of its block lengthens it.
    subroutine note_place(block)
      integer, intent(in) :: block
      type(stretch_t), allocatable :: longer(:)
      integer :: last

      last = index%last(block)
      if (last > 0) then
        associate (stretch => index%stretches(last))
          if (stretch%shard == shard .and. stretch%end == place) then
            stretch%records = stretch%records + 1
            stretch%end = place + record%length
            return
          end if
        end associate
      end if
      if (index%count == size(index%stretches)) then
        allocate (longer(2*index%count + 1))
        longer(:index%count) = index%stretches
        call move_alloc(longer, index%stretches)
      end if
      index%count = index%count + 1
      index%stretches(index%count) = stretch_t(shard, 1, place, place + record%length)
      if (last > 0) index%stretches(last)%next = index%count
      if (last == 0) index%first(block) = index%count
      index%last(block) = index%count
    end subroutine note_place
  end subroutine note

  !> The description of the record at `place`, and whether this sweep can have written it.
  function record_at(shard, place, layout) result(record)
    type(shard_t), intent(inout), target :: shard
    integer(int64), intent(in) :: place
    type(layout_t), intent(in) :: layout
    type(record_t) :: record
    integer(int64), pointer, contiguous :: start(:)
    integer :: n(4), numbers

    if (word_bytes*(place + shortest_record) > shard%bytes) return
    call shard%show(place, 2_int64, start)
    n = transfer(start, n)
    if (n(1) < 1 .or. any(n < 0) .or. n(2) > stopped_early .or. n(4) > longest_message) return
    record%case = n(1)
    record%result_code = n(2)
    record%length = n(3)
    record%message_bytes = n(4)
    numbers = n(3) - shortest_record - words_for(n(4))
    if (numbers < 0 .or. numbers > int(layout%columns, int64)*layout%rows) return
    if (layout%columns > 0) then
      if (modulo(numbers, layout%columns) > 0) return
      record%rows = numbers/layout%columns
    end if
    record%is_possible = word_bytes*(place + record%length) <= shard%bytes
  end function record_at

  !> The case whose record is at `place`, which becomes that of the next one; `is_possible` is false if the file was changed since
  !> it was scanned.
  subroutine read_record(shard, place, layout, case, is_possible)
    type(shard_t), intent(inout), target :: shard
    integer(int64), intent(inout) :: place
    type(layout_t), intent(in) :: layout
    type(case_t), intent(inout) :: case
    logical, intent(out) :: is_possible
    type(record_t) :: record
    integer(int64), pointer, contiguous :: words(:)
    real(real64), pointer :: table(:, :)
    character(longest_message) :: message
    integer :: first

    record = record_at(shard, place, layout)
    is_possible = record%is_possible
    if (.not. is_possible) return
    call shard%show(place, record%length, words)
    place = place + record%length
    case%number = record%case
    case%result_code = record%result_code
    case%values = real(transfer(words(3:value_count + 2), [0.0_real64]), wp)
    first = value_count + 3
    message = transfer(words(first:first + words_for(record%message_bytes) - 1), message)
    case%result_text = printable(message(:record%message_bytes))
    if (allocated(case%table)) deallocate (case%table)
    if (layout%columns == 0) return
    call c_f_pointer(c_loc(words(first + words_for(record%message_bytes))), table, [layout%columns, record%rows])
    case%table = real(table, wp)
  end subroutine read_record
end module dst_sweep_shard
