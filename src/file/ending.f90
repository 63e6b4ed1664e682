!> What stands behind HDF5's end in a whole file: the state of a run that can be resumed, and a checksum of all bytes before it.
!>
!> HDF5 ignores these bytes, and cuts them off when somebody changes the file: then it is read without a check, and has no state.
!> The last line is 'dynstiction CRC-32 ' and 8 hexadecimal digits; before it, if there is a state, are its words, 8 bytes each in
!> the machine's order, and the line 'dynstiction state ' with their number of bytes.
!>
!> CRC-32 as in gzip, PNG and Ethernet (ISO 3309; reflected polynomial EDB88320), by zlib: any change within 32 successive bits
!> changes it, and so do all other changes except one in 2^32.
module dst_ending
  use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_int, c_loc, c_long, c_ptr
  use dst_disk, only: close_descriptor, identity_of, identity_t, open_regular, read_at, system_reason, write_at
  use dst_kinds, only: int64
  implicit none
  private

  public :: append_ending, has_ending, check_ending, read_state

  character(*), parameter :: checksum_mark = 'dynstiction CRC-32 ', state_mark = 'dynstiction state '
  character, parameter :: line_end = achar(10)
  integer, parameter :: digits_of_bytes = 16
  integer(int64), parameter :: checksum_bytes = len(checksum_mark) + 8 + 1, state_line_bytes = len(state_mark) + digits_of_bytes + 1
  integer, parameter :: word_bytes = 8

  interface
    pure integer(c_long) function zlib_crc32(before, bytes, count) bind(c, name='crc32')
      import :: c_int, c_long, c_ptr
      integer(c_long), value :: before
      type(c_ptr), value :: bytes
      integer(c_int), value :: count
    end function zlib_crc32
  end interface

contains

  !> Append the ending to an open file that HDF5 has closed, which is read once for this.
  subroutine append_ending(descriptor, state, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in), target, contiguous :: state(:)   !! from which the run can be resumed; empty: none
    character(:), allocatable, intent(out) :: reason             !! unallocated on success
    character(digits_of_bytes) :: count
    character(8) :: checksum
    type(identity_t) :: file
    character(c_char), pointer, contiguous :: bytes(:)
    integer(int64) :: place

    file = identity_of(descriptor)
    place = file%bytes
    if (size(state) > 0) then
      call c_f_pointer(c_loc(state), bytes, [word_bytes*size(state)])
      write (count, '(i16)') size(bytes)
      call write_at(descriptor, place, bytes, size(bytes, kind=int64), reason)
      place = place + size(bytes)
      if (.not. allocated(reason)) call write_at(descriptor, place, state_mark//count//line_end, state_line_bytes, reason)
      place = place + state_line_bytes
    end if
    if (allocated(reason)) return
    checksum = checksum_of(descriptor, place)
    if (checksum == '') then
      reason = 'it cannot be read: '//system_reason()
    else
      call write_at(descriptor, place, checksum_mark//checksum//line_end, checksum_bytes, reason)
    end if
  end subroutine append_ending

  !> Whether the last line of a file is that of an ending: then this program has written it.
  logical function has_ending(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: reason
    integer(c_int) :: descriptor
    integer(int64) :: bytes

    has_ending = .false.
    call open_regular(file_name, .false., descriptor, bytes, reason)
    if (allocated(reason)) return
    has_ending = index(text_at(descriptor, bytes - checksum_bytes, int(checksum_bytes)), checksum_mark) == 1
    call close_descriptor(descriptor)
  end function has_ending

  !> Whether a file that has an ending is as it was when that was written.
  subroutine check_ending(file_name, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated if it is, or if there is no ending
    integer(c_int) :: descriptor
    integer(int64) :: bytes
    logical :: ignored

    call open_whole(file_name, descriptor, bytes, ignored, reason)
    call close_descriptor(descriptor)
  end subroutine check_ending

  !> Open a file, and compare its bytes with its ending.
  subroutine open_whole(file_name, descriptor, bytes, is_whole, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes
    logical, intent(out) :: is_whole                   !! it has an ending
    character(:), allocatable, intent(out) :: reason
    character(:), allocatable :: line

    is_whole = .false.
    call open_regular(file_name, .false., descriptor, bytes, reason)
    if (allocated(reason)) return
    line = text_at(descriptor, bytes - checksum_bytes, int(checksum_bytes))
    is_whole = index(line, checksum_mark) == 1
    if (.not. is_whole) return
    if (line /= checksum_mark//checksum_of(descriptor, bytes - checksum_bytes)//line_end) &
      reason = 'the file is damaged: its checksum is not that of its bytes'
  end subroutine open_whole

  !> The state in a file, which must be as it was when it was written.
  subroutine read_state(file_name, state, reason)
    character(*), intent(in) :: file_name
    integer(int64), allocatable, target, intent(out) :: state(:)   !! empty if the file holds none
    character(:), allocatable, intent(out) :: reason       !! unallocated on success
    character(:), allocatable :: line
    integer(c_int) :: descriptor
    integer(int64) :: bytes, length, place
    character(c_char), pointer, contiguous :: words(:)
    integer :: io_status
    logical :: is_whole, complete

    allocate (state(0))
    call open_whole(file_name, descriptor, bytes, is_whole, reason)
    if (is_whole .and. .not. allocated(reason)) then
      place = bytes - checksum_bytes - state_line_bytes
      line = text_at(descriptor, place, int(state_line_bytes))
      io_status = 1
      if (index(line, state_mark) == 1) read (line(len(state_mark) + 1:len(line) - 1), *, iostat=io_status) length
      if (io_status == 0) then
        if (length > 0 .and. length <= place) then
          deallocate (state)
          allocate (state(length/word_bytes))
          call c_f_pointer(c_loc(state), words, [word_bytes*size(state)])
          call read_at(descriptor, place - length, words, complete)
          if (.not. complete) state = [integer(int64) ::]
        end if
      end if
    else if (.not. allocated(reason)) then
      reason = 'the file was changed since it was written: it has no checksum'
    end if
    call close_descriptor(descriptor)
  end subroutine read_state

  !> `length` bytes from a place on; '' if they are not all there.
  function text_at(descriptor, place, length) result(text)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: place
    integer, intent(in) :: length
    character(:), allocatable :: text
    character(c_char) :: bytes(length)
    logical :: complete

    text = ''
    if (place < 0) return
    call read_at(descriptor, place, bytes, complete)
    if (.not. complete) return
    text = repeat(' ', length)
    text = transfer(bytes, text)
  end function text_at

  !> CRC-32 of the first `bytes` bytes of an open file as 8 hexadecimal digits; '' if they cannot be read.
  function checksum_of(descriptor, bytes) result(checksum)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: bytes
    character(8) :: checksum
    integer(int64), parameter :: most = 262144
    character(c_char), target :: block(most)
    integer(int64) :: place, count
    integer(c_long) :: value
    logical :: complete

    checksum = ''
    value = 0
    place = 0
    do while (place < bytes)
      count = min(bytes - place, most)
      call read_at(descriptor, place, block(:count), complete)
      if (.not. complete) return
      value = zlib_crc32(value, c_loc(block), int(count, c_int))
      place = place + count
    end do
    write (checksum, '(z8.8)') value
  end function checksum_of
end module dst_ending
