!> What stands behind HDF5's end in a whole file: the state of a run that can be resumed, and a checksum of all bytes before it.
!>
!> HDF5 ignores these bytes, and cuts them off when somebody changes the file: then it is read without a check, and has no state.
!> The last line is 'dynstiction CRC-32 ' and 8 hexadecimal digits; before it, if there is a state, are its words, 8 bytes each in
!> the machine's order, and the line 'dynstiction state ' with their number of bytes.
!>
!> CRC-32 as in gzip, PNG and Ethernet (ISO 3309; reflected polynomial EDB88320), by zlib: any change within 32 successive bits
!> changes it, and so do all other changes except one in 2^32.
module dst_ending
  use, intrinsic :: iso_c_binding, only: c_bool, c_char, c_f_pointer, c_int, c_loc, c_long, c_ptr, nul => c_null_char
  use dst_disk, only: close_descriptor, identity_of, identity_t, system_reason
  use dst_kinds, only: int64
  use dst_posix, only: c_open_regular, c_read, c_write
  implicit none
  private

  public :: append_ending, has_ending, check_ending, read_state

  character(*), parameter :: checksum_mark = 'dynstiction CRC-32 ', state_mark = 'dynstiction state '
  character, parameter :: line_end = achar(10)
  integer, parameter :: digits_of_bytes = 16, word_bytes = 8
  integer, parameter :: checksum_bytes = len(checksum_mark) + 8 + 1, state_line_bytes = len(state_mark) + digits_of_bytes + 1

  !> A file that is read, and its last line.
  type :: reader_t
    integer(c_int) :: descriptor = -1
    integer(int64) :: place = 0            !! of the last line: number of the bytes before it
    logical :: has_ending = .false.
    character(checksum_bytes) :: line = ''
  end type reader_t

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
      call append(bytes, size(bytes))
      call append(state_mark//count//line_end, state_line_bytes)
    end if
    if (allocated(reason)) return
    checksum = checksum_of(descriptor, place)
    if (checksum == '') reason = 'it cannot be read: '//system_reason()
    call append(checksum_mark//checksum//line_end, checksum_bytes)

  contains

    subroutine append(bytes, length)
      integer, intent(in) :: length
      character(c_char), intent(in) :: bytes(length)

      if (allocated(reason)) return
      if (c_write(descriptor, bytes, int(length, int64), place) /= 0) reason = system_reason()
      place = place + length
    end subroutine append
  end subroutine append_ending

  !> Open a file, read its last line, and, if that is an ending and `checks`, compare it with the bytes before it.
  subroutine open_file(file_name, checks, file, reason)
    character(*), intent(in) :: file_name
    logical, intent(in) :: checks
    type(reader_t), intent(out) :: file
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(identity_t) :: found

    file%descriptor = c_open_regular(file_name//nul, .false._c_bool)
    if (file%descriptor < 0) then
      reason = system_reason()
      return
    end if
    found = identity_of(file%descriptor)
    file%place = found%bytes - checksum_bytes
    if (is_read(file%descriptor, file%line, checksum_bytes, file%place)) file%has_ending = index(file%line, checksum_mark) == 1
    if (.not. (checks .and. file%has_ending)) return
    if (file%line /= checksum_mark//checksum_of(file%descriptor, file%place)//line_end) &
      reason = 'the file is damaged: its checksum is not that of its bytes'
  end subroutine open_file

  !> Whether so many bytes could be read from a place on.
  logical function is_read(descriptor, bytes, length, place)
    integer(c_int), intent(in) :: descriptor
    integer, intent(in) :: length
    character(c_char), intent(inout) :: bytes(length)
    integer(int64), intent(in) :: place

    is_read = place >= 0
    if (is_read) is_read = c_read(descriptor, bytes, int(length, int64), place) == length
  end function is_read

  !> Whether the last line of a file is that of an ending: then this program has written it.
  logical function has_ending(file_name)
    character(*), intent(in) :: file_name
    type(reader_t) :: file
    character(:), allocatable :: ignored

    call open_file(file_name, .false., file, ignored)
    has_ending = file%has_ending
    call close_descriptor(file%descriptor)
  end function has_ending

  !> Whether a file that has an ending is as it was when that was written.
  subroutine check_ending(file_name, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated if it is, or if there is no ending
    type(reader_t) :: file

    call open_file(file_name, .true., file, reason)
    call close_descriptor(file%descriptor)
  end subroutine check_ending

  !> The state in a file, which must be as it was when it was written.
  subroutine read_state(file_name, state, reason)
    character(*), intent(in) :: file_name
    integer(int64), allocatable, target, intent(out) :: state(:)   !! empty if the file holds none
    character(:), allocatable, intent(out) :: reason       !! unallocated on success
    character(state_line_bytes) :: line
    type(reader_t) :: file
    integer(int64) :: length
    character(c_char), pointer, contiguous :: words(:)
    integer :: io_status

    allocate (state(0))
    call open_file(file_name, .true., file, reason)
    if (.not. (file%has_ending .or. allocated(reason))) reason = 'the file was changed since it was written: it has no checksum'
    if (.not. allocated(reason)) then
      associate (place => file%place - state_line_bytes)
        line = ''
        length = 0
        io_status = 0
        if (.not. is_read(file%descriptor, line, state_line_bytes, place)) line = ''
        if (index(line, state_mark) == 1) read (line(len(state_mark) + 1:len(line) - 1), *, iostat=io_status) length
        if (io_status == 0 .and. length > 0 .and. length <= place) then
          deallocate (state)
          allocate (state(length/word_bytes))
          call c_f_pointer(c_loc(state), words, [word_bytes*size(state)])
          if (.not. is_read(file%descriptor, words, size(words), place - length)) state = [integer(int64) ::]
        end if
      end associate
    end if
    call close_descriptor(file%descriptor)
  end subroutine read_state

  !> CRC-32 of the first `bytes` bytes of an open file as 8 hexadecimal digits; '' if they cannot be read.
  function checksum_of(descriptor, bytes) result(checksum)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: bytes
    character(8) :: checksum
    integer, parameter :: most = 262144
    character(c_char), target :: block(most)
    integer(int64) :: place
    integer(c_long) :: value
    integer :: count

    checksum = ''
    value = 0
    do place = 0, bytes - 1, most
      count = int(min(bytes - place, int(most, int64)))
      if (.not. is_read(descriptor, block, count, place)) return
      value = zlib_crc32(value, c_loc(block), int(count, c_int))
    end do
    write (checksum, '(z8.8)') value
  end function checksum_of
end module dst_ending
