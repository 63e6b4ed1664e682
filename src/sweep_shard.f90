!> The finished cases of one process: a file of records, one a case, each appended with one call of the system.
!>
!> A process that is killed leaves whole records and at most a part of one at the end, which its checksum tells; the next
!> process that opens the shard cuts it off. A record is a row of 64-bit words in the order of this machine:
!> case and result code, length and bytes of the message, the values, the message, the series, the checksum.
module dst_sweep_shard
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_disk, only: file_size, open_for_appending, append_words, close_descriptor, set_file_size, matching_files, path_t
  use dst_errors, only: error_t, raise, file_error
  use dst_kinds, only: wp, int64, real64
  use dst_sweep, only: case_t, value_count
  implicit none
  private

  public :: shard_t, index_t, shard_name, shards_of, open_shard, empty_shard, scan_shard, read_record

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

  !> Where the cases are: number of the shard, 0 if a case is in none, and word of the record in it.
  type :: index_t
    integer, allocatable :: shard(:)
    integer(int64), allocatable :: place(:)
    integer :: done = 0
    integer :: failed = 0
  end type index_t

  integer(int64), parameter :: magic = int(z'445354534841524B', int64)
  integer(int64), parameter :: half = 2_int64**32
  !> Of the header: magic word, 64 characters of the sweep's identity, values of a case, columns of its series, checksum.
  integer, parameter :: header_words = 12
  !> Of a record without message and series.
  integer, parameter :: shortest_record = 2 + value_count + 1
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

  !> Open the shard to append; what a killed process left unfinished at its end is cut off.
  subroutine open_shard(shard, file_name, identity, columns, error)
    type(shard_t), intent(out) :: shard
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    integer, intent(in) :: columns               !! of the series; 0 = none is kept
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    character(:), allocatable :: reason
    integer(int64) :: words

    call open_for_appending(file_name, shard%descriptor, reason)
    if (allocated(reason)) then
      call raise(error, file_error, file_name//': '//reason)
      return
    end if
    shard%file_name = file_name
    allocate (index%shard(0), index%place(0))
    call scan_shard(file_name, identity, columns, 1, index, words, error)
    if (allocated(error)) return
    call set_file_size(shard%descriptor, 8_int64*words)
    if (words > 0) return
    call append_words(shard%descriptor, header(identity, columns), reason)
    if (allocated(reason)) call raise(error, file_error, file_name//': '//reason)
  end subroutine open_shard

  !> Empty a file that is not a shard of this sweep, unless a process is writing it. The file stays, since another process may
  !> be about to open it.
  subroutine empty_shard(file_name, identity, columns, error)
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    integer, intent(in) :: columns
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    character(:), allocatable :: reason
    integer(int64) :: words
    integer(c_int) :: descriptor

    call open_for_appending(file_name, descriptor, reason)
    if (allocated(reason)) then
      call raise(error, file_error, file_name//': '//reason)
      return
    end if
    ! Another process may have done this meanwhile, and begun.
    allocate (index%shard(0), index%place(0))
    call scan_shard(file_name, identity, columns, 1, index, words, error)
    if (allocated(error)) call set_file_size(descriptor, 0_int64)
    if (allocated(error)) deallocate (error)
    call close_descriptor(descriptor)
  end subroutine empty_shard

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
    integer, parameter :: places = 5
    integer :: i

    checksum = magic
    do i = 1, size(words)
      checksum = ieor(ishftc(checksum, places), words(i))
    end do
  end function checksum

  !> Append a finished case.
  subroutine append_case(self, case, error)
    class(shard_t), intent(inout) :: self
    type(case_t), intent(in) :: case
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    integer :: length, text_words, n

    text_words = (len(case%result_text) + 7)/8
    length = shortest_record + text_words
    if (allocated(case%series)) length = length + size(case%series)
    if (allocated(self%words)) then
      if (size(self%words) < length) deallocate (self%words)
    end if
    if (.not. allocated(self%words)) allocate (self%words(length))
    associate (words => self%words)
      words(1) = case%number + half*case%result_code
      words(2) = length + half*len(case%result_text)
      n = 2 + value_count
      words(3:n) = transfer(real(case%values, real64), words(3:n))
      if (text_words > 0) words(n + 1:n + text_words) = &
        transfer(case%result_text//repeat(' ', 8*text_words - len(case%result_text)), words(n + 1:n + text_words))
      n = n + text_words
      if (length - n > 1) words(n + 1:length - 1) = transfer(real(case%series, real64), words(n + 1:length - 1))
      words(length) = checksum(words(:length - 1))
      call append_words(self%descriptor, words(:length), reason)
    end associate
    if (allocated(reason)) call raise(error, file_error, self%file_name//': '//reason)
  end subroutine append_case

  subroutine close_shard(self)
    class(shard_t), intent(inout) :: self

    call close_descriptor(self%descriptor)
  end subroutine close_shard

  !> Note in `index` the cases that shard `number` holds and no other before it; `words` is the length of what is sound.
  !> Cases beyond the index's size are passed over.
  subroutine scan_shard(file_name, identity, columns, number, index, words, error)
    character(*), intent(in) :: file_name
    character(64), intent(in) :: identity
    integer, intent(in) :: columns, number
    type(index_t), intent(inout) :: index
    integer(int64), intent(out) :: words
    type(error_t), allocatable, intent(out) :: error
    integer(int64), allocatable :: record(:)
    integer(int64) :: start(header_words), bytes, length
    integer :: unit, status, case

    words = 0
    bytes = file_size(file_name)
    ! Nothing has been written; a pipe would wait for its writer for ever.
    if (bytes == 0) return
    open (newunit=unit, file=file_name, status='old', action='read', access='stream', form='unformatted', iostat=status)
    if (status /= 0) then
      call raise(error, file_error, file_name//': cannot be read: see its permissions')
      return
    end if
    start = 0
    read (unit, iostat=status) start(:min(int(header_words, int64), bytes/8))
    if (bytes >= 8 .and. start(1) /= magic) then
      call raise(error, file_error, file_name//': is no shard of a sweep, or its head is damaged: remove it')
    else if (bytes >= 8*header_words) then
      if (start(12) /= checksum(start(:11))) then
        call raise(error, file_error, file_name//': is no shard of a sweep, or its head is damaged: remove it')
      else if (any(start /= header(identity, columns))) then
        call raise(error, file_error, file_name//': is of another sweep, or of another version of deck or program: it has '// &
          'the identity '//identity_in(start)//', this sweep '//identity(:shown)//': remove it, or use --overwrite')
      else
        words = header_words
      end if
    end if
    allocate (record(shortest_record))
    do while (words > 0 .and. status == 0)
      if (8*(words + shortest_record) > bytes) exit
      read (unit, pos=8*words + 1, iostat=status) record(:2)
      length = modulo(record(2), half)
      if (status /= 0 .or. length < shortest_record .or. 8*(words + length) > bytes) exit
      if (length > size(record)) then
        deallocate (record)
        allocate (record(length))
      end if
      read (unit, pos=8*words + 1, iostat=status) record(:length)
      if (status /= 0) exit
      if (record(length) /= checksum(record(:length - 1))) exit
      case = int(modulo(record(1), half))
      if (case >= 1 .and. case <= size(index%shard)) then
        if (index%shard(case) == 0) then
          index%shard(case) = number
          index%place(case) = words
          index%done = index%done + 1
          if (record(1) >= half) index%failed = index%failed + 1
        end if
      end if
      words = words + length
    end do
    close (unit)
  end subroutine scan_shard

  !> The case whose record is at `place` in the shard opened as `unit`; `columns` of its series.
  subroutine read_record(unit, place, columns, case, status)
    integer, intent(in) :: unit, columns
    integer(int64), intent(in) :: place
    type(case_t), intent(inout) :: case
    integer, intent(out) :: status
    integer(int64) :: start(2)
    integer(int64), allocatable :: rest(:)
    integer :: text_bytes, text_words, length, n

    read (unit, pos=8*place + 1, iostat=status) start
    if (status /= 0) return
    case%number = int(modulo(start(1), half))
    case%result_code = int(start(1)/half)
    length = int(modulo(start(2), half))
    text_bytes = int(start(2)/half)
    text_words = (text_bytes + 7)/8
    allocate (rest(length - 2))
    read (unit, iostat=status) rest
    if (status /= 0) return
    if (.not. allocated(case%values)) allocate (case%values(value_count))
    n = value_count
    case%values = real(transfer(rest(:n), [0.0_real64]), wp)
    case%result_text = repeat(' ', text_bytes)
    if (text_words > 0) case%result_text = transfer(rest(n + 1:n + text_words), case%result_text)
    n = n + text_words
    if (allocated(case%series)) deallocate (case%series)
    if (columns > 0) case%series = reshape(real(transfer(rest(n + 1:length - 3), [0.0_real64]), wp), &
      [columns, (length - 3 - n)/columns])
  end subroutine read_record
end module dst_sweep_shard
