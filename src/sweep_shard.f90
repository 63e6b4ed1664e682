!> The finished cases of one process: a file of records, one a case, each appended with one call of the system.
!>
!> A process that is killed leaves whole records and at most a part of one at the end, which its checksum tells; the next
!> process that opens the shard cuts it off. A record is a row of 64-bit words in the order of this machine:
!> case and result code, length and bytes of the message, the values, the message, the series, the checksum.
!> Anybody may have written a file of that name: it is emptied or removed only if it begins with the magic word, and what a
!> record says of itself is believed only as far as this sweep allows.
module dst_sweep_shard
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_disk, only: open_for_appending, open_for_reading, lock_attempt, held, append_words, read_words, close_descriptor, &
    set_file_size, delete_file, matching_files, path_t
  use dst_errors, only: error_t, raise, file_error, out_of_memory, stopped_early
  use dst_kinds, only: wp, int64, real64
  use dst_sweep, only: sweep_t, case_t, value_count, series_quantities
  use dst_text, only: printable
  implicit none
  private

  public :: shard_t, index_t, layout_t, layout_of, shard_name, shards_of, open_shard, empty_shard, delete_shard, scan_shard
  public :: reader_t, open_records, read_record

  !> A shard, open to append finished cases.
  type :: shard_t
    private
    character(:), allocatable :: file_name
    integer(c_int) :: descriptor = -1
    integer(int64), allocatable :: words(:)   !! of the next record
  contains
    procedure :: append => append_case
    procedure :: close => close_shard
  end type shard_t

  !> The series that a record of a sweep may hold.
  type :: layout_t
    integer :: columns = 0   !! 0 = none is kept
    integer :: rows = 0      !! at most
  end type layout_t

  !> A shard that is read; a part of it is in memory. Words are counted from 0.
  type :: reader_t
    private
    character(:), allocatable :: file_name
    integer(c_int) :: descriptor = -1
    integer(int64) :: bytes = 0               !! of the file
    integer(int64) :: first = 0               !! word of the file that is the first in `window`
    integer(int64), allocatable :: window(:)
  contains
    procedure :: word
    procedure :: close => close_reader
  end type reader_t

  !> What a record says of itself.
  type :: record_t
    logical :: is_possible = .false.          !! in this sweep
    integer :: case = 0, result_code = 0, message_bytes = 0, rows = 0
    integer(int64) :: length = 0              !! words
  end type record_t

  !> Where the cases are: number of the shard, 0 if a case is in none, and word of the record in it.
  type :: index_t
    integer, allocatable :: shard(:)
    integer(int64), allocatable :: place(:)
    integer :: done = 0
    integer :: failed = 0
  end type index_t

  integer(int64), parameter :: magic = int(z'445354534841524B', int64)
  integer(int64), parameter :: half = 2_int64**32
  integer, parameter :: word_bytes = 8
  !> Of the header: magic word, 64 characters of the sweep's identity, values of a case, columns of its series, checksum.
  integer, parameter :: header_words = 12
  !> Of a record without message and series.
  integer, parameter :: shortest_record = 2 + value_count + 1
  integer, parameter :: longest_message = 4096  !! bytes
  integer, parameter :: window_words = 8192     !! read at once
  character(*), parameter :: extension = '.shard-'
  integer, parameter :: shown = 12             !! characters of an identity in a message
  integer, parameter :: digits = 6             !! of its number

contains

  !> The shard of worker `number` of the sweep into `result_file`.
  function shard_name(result_file, number) result(name)
    character(*), intent(in) :: result_file
    integer, intent(in) :: number
    character(:), allocatable :: name
    character(digits) :: text

    write (text, '(i6.6)') number
    name = result_file//extension//text
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
      associate (number => found(i)%text(len(result_file//extension) + 1:))
        is_shard(i) = len(number) == digits .and. verify(number, '0123456789') == 0
      end associate
    end do
    files = pack(found, is_shard)
  end subroutine shards_of

  !> What the records of a sweep may hold.
  function layout_of(sweep) result(layout)
    type(sweep_t), intent(in) :: sweep
    type(layout_t) :: layout

    layout = layout_t(size(series_quantities(sweep)), sweep%series_rows())
  end function layout_of

  !> Open the shard to append; what a killed process left unfinished at its end is cut off.
  subroutine open_shard(shard, file_name, identity, layout, error)
    type(shard_t), intent(out) :: shard
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    type(layout_t), intent(in) :: layout
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(reader_t) :: reader
    character(:), allocatable :: reason
    integer(int64) :: words

    call open_for_appending(file_name, shard%descriptor, reader%bytes, reason)
    if (allocated(reason)) then
      call raise(error, file_error, file_name//': '//reason)
      return
    end if
    shard%file_name = file_name
    reader%file_name = file_name
    reader%descriptor = shard%descriptor
    allocate (index%shard(0), index%place(0))
    call scan(reader, identity, layout, 1, index, words, error)
    if (allocated(error)) then
      call shard%close()
      return
    end if
    call set_file_size(shard%descriptor, word_bytes*words)
    if (words > 0) return
    call append_words(shard%descriptor, header(identity, layout%columns), reason)
    if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
  end subroutine open_shard

  !> Empty a shard of another sweep, unless a process is writing it. The file stays, since another process may be about to open
  !> it. What is no shard is refused.
  subroutine empty_shard(file_name, identity, layout, error)
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    type(layout_t), intent(in) :: layout
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(reader_t) :: reader
    character(:), allocatable :: reason
    integer(int64) :: words

    call open_for_appending(file_name, reader%descriptor, reader%bytes, reason)
    if (allocated(reason)) then
      call raise(error, file_error, file_name//': '//reason)
      return
    end if
    reader%file_name = file_name
    ! Another process may have done this meanwhile, and begun.
    allocate (index%shard(0), index%place(0))
    call scan(reader, identity, layout, 1, index, words, error)
    if (allocated(error)) then
      if (is_shard(reader)) then
        call set_file_size(reader%descriptor, 0_int64)
        deallocate (error)
      end if
    end if
    call reader%close()
  end subroutine empty_shard

  !> Remove a shard whose cases are in the result file.
  subroutine delete_shard(file_name)
    character(*), intent(in) :: file_name
    type(error_t), allocatable :: error
    type(reader_t) :: reader

    call open_records(file_name, reader, error)
    if (allocated(error)) return
    ! A process that has opened it meanwhile goes on with it.
    if (lock_attempt(reader%descriptor) /= held) then
      if (is_shard(reader)) call delete_file(file_name)
    end if
    call reader%close()
  end subroutine delete_shard

  pure function header(identity, columns) result(words)
    character(64), intent(in) :: identity
    integer, intent(in) :: columns
    integer(int64) :: words(header_words)

    words(1) = magic
    words(2:9) = transfer(identity, words(2:9))
    words(10) = value_count
    words(11) = columns
    words(12) = checksum(words(:11))
  end function header

  !> The beginning of the identity in a header.
  pure function identity_in(words) result(text)
    integer(int64), intent(in) :: words(header_words)
    character(shown) :: text

    text = transfer(words(2:9), text)
  end function identity_in

  !> Rotate and add without carry: no damage to a single word goes unnoticed.
  pure integer(int64) function checksum(words)
    integer(int64), intent(in) :: words(:)
    integer :: i

    checksum = magic
    do i = 1, size(words)
      checksum = with_word(checksum, words(i))
    end do
  end function checksum

  pure integer(int64) function with_word(checksum, word)
    integer(int64), intent(in) :: checksum, word
    integer, parameter :: places = 5

    with_word = ieor(ishftc(checksum, places), word)
  end function with_word

  !> Append a finished case. A series may be longer than a thread's stack: its values are taken one by one.
  subroutine append_case(self, case, error)
    class(shard_t), intent(inout) :: self
    type(case_t), intent(in) :: case
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    integer :: length, message_bytes, no_memory, i, j, n

    message_bytes = min(len(case%result_text), longest_message)
    length = shortest_record + words_for(message_bytes)
    if (allocated(case%series)) length = length + size(case%series)
    if (allocated(self%words)) then
      if (size(self%words) < length) deallocate (self%words)
    end if
    if (.not. allocated(self%words)) allocate (self%words(length), stat=no_memory)
    if (.not. allocated(self%words)) then
      call raise(error, out_of_memory, 'no memory for the record of a case: keep fewer samples or use fewer threads')
      return
    end if
    associate (words => self%words)
      words(1) = case%number + half*case%result_code
      words(2) = length + half*message_bytes
      n = 2
      do i = 1, value_count
        n = n + 1
        words(n) = transfer(real(case%values(i), real64), words(n))
      end do
      do i = 1, message_bytes, word_bytes
        n = n + 1
        words(n) = transfer(case%result_text(i:min(i + word_bytes - 1, message_bytes))//repeat(' ', word_bytes), words(n))
      end do
      if (allocated(case%series)) then
        do j = 1, size(case%series, 2)
          do i = 1, size(case%series, 1)
            n = n + 1
            words(n) = transfer(real(case%series(i, j), real64), words(n))
          end do
        end do
      end if
      words(length) = checksum(words(:length - 1))
      call append_words(self%descriptor, words(:length), reason)
    end associate
    if (allocated(reason)) call raise(error, file_error, self%file_name//': '//reason)
  end subroutine append_case

  !> Words that hold so many bytes.
  pure integer function words_for(bytes)
    integer, intent(in) :: bytes

    words_for = (bytes + word_bytes - 1)/word_bytes
  end function words_for

  subroutine close_shard(self)
    class(shard_t), intent(inout) :: self

    call close_descriptor(self%descriptor)
  end subroutine close_shard

  !> Open a shard to read it.
  subroutine open_records(file_name, reader, error)
    character(*), intent(in) :: file_name
    type(reader_t), intent(out) :: reader
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    reader%file_name = file_name
    call open_for_reading(file_name, reader%descriptor, reader%bytes, reason)
    if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
  end subroutine open_records

  subroutine close_reader(self)
    class(reader_t), intent(inout) :: self

    call close_descriptor(self%descriptor)
  end subroutine close_reader

  !> A word of the file; what is not there is 0.
  integer(int64) function word(self, place)
    class(reader_t), intent(inout) :: self
    integer(int64), intent(in) :: place

    if (.not. allocated(self%window)) then
      allocate (self%window(window_words))
      self%first = -window_words - 1
    end if
    if (place < self%first .or. place >= self%first + window_words) then
      ! Cases stand almost in the order of their numbers, in which they are read.
      self%first = max(0_int64, place - window_words/4)
      call read_words(self%descriptor, self%first, self%window)
    end if
    word = self%window(place - self%first + 1)
  end function word

  !> Whether a file is empty or begins with the magic word, or with what a process wrote of it that was killed.
  logical function is_shard(reader)
    type(reader_t), intent(inout) :: reader
    character(word_bytes) :: beginning, expected
    integer :: there

    beginning = transfer(reader%word(0_int64), beginning)
    expected = transfer(magic, expected)
    there = int(min(reader%bytes, int(word_bytes, int64)))
    is_shard = beginning(:there) == expected(:there)
  end function is_shard

  !> Note in `index` the cases that shard `number` holds and no other before it; `words` is the length of what is sound.
  !> Cases beyond the index's size are passed over.
  subroutine scan_shard(file_name, identity, layout, number, index, words, error)
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    type(layout_t), intent(in) :: layout
    integer, intent(in) :: number
    type(index_t), intent(inout) :: index
    integer(int64), intent(out) :: words
    type(error_t), allocatable, intent(out) :: error
    type(reader_t) :: reader

    words = 0
    call open_records(file_name, reader, error)
    if (.not. allocated(error)) call scan(reader, identity, layout, number, index, words, error)
    call reader%close()
  end subroutine scan_shard

  subroutine scan(reader, identity, layout, number, index, words, error)
    type(reader_t), intent(inout) :: reader
    character(64), intent(in) :: identity
    type(layout_t), intent(in) :: layout
    integer, intent(in) :: number
    type(index_t), intent(inout) :: index
    integer(int64), intent(out) :: words
    type(error_t), allocatable, intent(out) :: error
    type(record_t) :: record

    words = 0
    call check_head(reader, identity, layout%columns, error)
    if (allocated(error) .or. reader%bytes < word_bytes*header_words) return
    words = header_words
    do
      record = record_at(reader, words, layout)
      if (.not. record%is_possible) exit
      if (.not. is_sound(reader, words, record%length)) exit
      if (record%case <= size(index%shard)) then
        if (index%shard(record%case) == 0) then
          index%shard(record%case) = number
          index%place(record%case) = words
          index%done = index%done + 1
          if (record%result_code > 0) index%failed = index%failed + 1
        end if
      end if
      words = words + record%length
    end do
  end subroutine scan

  !> Refuse what is no shard of this sweep. A head that is not whole is that of a process which was killed.
  subroutine check_head(reader, identity, columns, error)
    type(reader_t), intent(inout) :: reader
    character(64), intent(in) :: identity
    integer, intent(in) :: columns
    type(error_t), allocatable, intent(out) :: error
    integer(int64) :: start(header_words)
    integer :: i

    if (.not. is_shard(reader)) then
      call raise(error, file_error, reader%file_name//': has the name of a shard of a sweep, but is none, or its head is '// &
        'damaged: move it away, or use another output file')
    end if
    if (allocated(error) .or. reader%bytes < word_bytes*header_words) return
    do i = 1, header_words
      start(i) = reader%word(i - 1_int64)
    end do
    if (start(header_words) /= checksum(start(:header_words - 1))) then
      call raise(error, file_error, reader%file_name//': is no shard of a sweep, or its head is damaged: remove it')
    else if (any(start /= header(identity, columns))) then
      call raise(error, file_error, reader%file_name//': is of another sweep, or of another version of deck or program: '// &
        'it has the identity '//identity_in(start)//', this sweep '//identity(:shown)//': remove it, or use --overwrite')
    end if
  end subroutine check_head

  !> What the record at `place` says of itself, and whether this sweep can have written that.
  function record_at(reader, place, layout) result(record)
    type(reader_t), intent(inout) :: reader
    integer(int64), intent(in) :: place
    type(layout_t), intent(in) :: layout
    type(record_t) :: record
    integer(int64) :: start(2), series

    if (word_bytes*(place + shortest_record) > reader%bytes) return
    start = [reader%word(place), reader%word(place + 1)]
    if (any(start < 0)) return
    if (modulo(start(1), half) < 1 .or. modulo(start(1), half) > huge(record%case)) return
    if (start(1)/half > stopped_early .or. start(2)/half > longest_message) return
    record%case = int(modulo(start(1), half))
    record%result_code = int(start(1)/half)
    record%message_bytes = int(start(2)/half)
    record%length = modulo(start(2), half)
    series = record%length - shortest_record - words_for(record%message_bytes)
    if (series < 0 .or. series > int(layout%columns, int64)*layout%rows) return
    if (layout%columns > 0) then
      if (modulo(series, int(layout%columns, int64)) > 0) return
      record%rows = int(series/layout%columns)
    end if
    record%is_possible = word_bytes*(place + record%length) <= reader%bytes
  end function record_at

  !> Whether a record has the checksum that it states.
  logical function is_sound(reader, place, length)
    type(reader_t), intent(inout) :: reader
    integer(int64), intent(in) :: place, length
    integer(int64) :: sum, i

    sum = magic
    do i = place, place + length - 2
      sum = with_word(sum, reader%word(i))
    end do
    is_sound = sum == reader%word(place + length - 1)
  end function is_sound

  !> The case whose record is at `place`; `is_possible` is false if the file was changed since it was scanned.
  subroutine read_record(reader, place, layout, case, is_possible)
    type(reader_t), intent(inout) :: reader
    integer(int64), intent(in) :: place
    type(layout_t), intent(in) :: layout
    type(case_t), intent(inout) :: case
    logical, intent(out) :: is_possible
    type(record_t) :: record
    character(word_bytes) :: part
    integer(int64) :: n
    integer :: i, j, last

    record = record_at(reader, place, layout)
    is_possible = record%is_possible
    if (.not. is_possible) return
    case%number = record%case
    case%result_code = record%result_code
    if (.not. allocated(case%values)) allocate (case%values(value_count))
    n = place + 2
    do i = 1, value_count
      case%values(i) = number_in(reader%word(n))
      n = n + 1
    end do
    case%result_text = repeat(' ', record%message_bytes)
    do i = 1, record%message_bytes, word_bytes
      last = min(i + word_bytes - 1, record%message_bytes)
      part = transfer(reader%word(n), part)
      case%result_text(i:last) = part(:last - i + 1)
      n = n + 1
    end do
    case%result_text = printable(case%result_text)
    if (allocated(case%series)) deallocate (case%series)
    if (layout%columns == 0) return
    allocate (case%series(layout%columns, record%rows))
    do j = 1, record%rows
      do i = 1, layout%columns
        case%series(i, j) = number_in(reader%word(n))
        n = n + 1
      end do
    end do
  end subroutine read_record

  pure real(wp) function number_in(word)
    integer(int64), intent(in) :: word

    number_in = real(transfer(word, 0.0_real64), wp)
  end function number_in
end module dst_sweep_shard
