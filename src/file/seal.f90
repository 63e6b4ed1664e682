!> The last line of a finished file: a checksum of all bytes before it.
!>
!> HDF5 passes over what stands behind its own end, and drops it when it changes the file: a file that was edited later has no
!> seal, and is as good as one of a run that was killed.
module dst_seal
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_f_pointer, c_loc
  use dst_crc32, only: crc32_t
  use dst_disk, only: close_descriptor, identity_of, identity_t, open_for_reading, read_at, set_file_size, system_reason, &
    write_bytes
  use dst_kinds, only: int64
  implicit none
  private

  public :: seal, break_seal, has_sound_seal, checksum_of

  character(*), parameter :: mark = 'dynstiction CRC-32 '
  integer(int64), parameter :: seal_bytes = len(mark) + 8 + 1

contains

  !> Append the seal to an open file, which is read for that once. `checksum`: of the file with its seal, as `checksum_of` would
  !> find it; '-' if that fails, which leaves the file as it was.
  subroutine seal(descriptor, checksum, reason)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable, intent(out) :: checksum
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(identity_t) :: file
    type(crc32_t) :: crc
    character(:), allocatable :: line
    integer :: i

    checksum = '-'
    file = identity_of(descriptor)
    if (.not. covers(descriptor, file%bytes, crc)) then
      reason = 'it cannot be read: '//system_reason()
      return
    end if
    line = mark//crc%text()//achar(10)
    call write_bytes(descriptor, line, reason, file%bytes)
    if (allocated(reason)) then
      call set_file_size(descriptor, file%bytes)
      return
    end if
    do i = 1, len(line)
      call crc%add_byte(line(i:i))
    end do
    checksum = crc%text()
  end subroutine seal

  !> Cut off the seal of a file that is to be changed.
  subroutine break_seal(descriptor)
    integer(c_int), intent(in) :: descriptor
    type(identity_t) :: file
    character(c_char) :: beginning(len(mark))
    logical :: complete

    file = identity_of(descriptor)
    if (file%bytes < seal_bytes) return
    call read_at(descriptor, file%bytes - seal_bytes, beginning, complete)
    if (complete .and. transfer(beginning, mark) == mark) call set_file_size(descriptor, file%bytes - seal_bytes)
  end subroutine break_seal

  !> Whether a file is as it was when it was sealed.
  logical function has_sound_seal(file_name)
    character(*), intent(in) :: file_name
    character(c_char) :: ending(seal_bytes)
    character(seal_bytes) :: line
    character(:), allocatable :: reason
    type(crc32_t) :: crc
    integer(c_int) :: descriptor
    integer(int64) :: bytes

    call open_for_reading(file_name, descriptor, bytes, reason)
    has_sound_seal = bytes > seal_bytes .and. .not. allocated(reason)
    if (has_sound_seal) call read_at(descriptor, bytes - seal_bytes, ending, has_sound_seal)
    if (has_sound_seal) has_sound_seal = covers(descriptor, bytes - seal_bytes, crc)
    if (has_sound_seal) has_sound_seal = transfer(ending, line) == mark//crc%text()//achar(10)
    call close_descriptor(descriptor)
  end function has_sound_seal

  !> CRC-32 of an open file's bytes as 8 hexadecimal digits; '-' if it cannot be read, or is empty.
  function checksum_of(descriptor) result(text)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable :: text
    type(identity_t) :: file
    type(crc32_t) :: crc

    text = '-'
    file = identity_of(descriptor)
    if (covers(descriptor, file%bytes, crc)) text = crc%text()
  end function checksum_of

  !> Take the first `bytes` bytes of a file into a checksum; false if they are not to be had.
  logical function covers(descriptor, bytes, crc)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: bytes
    type(crc32_t), intent(out) :: crc
    integer(int64), parameter :: block_words = 32768, word_bytes = 8
    integer(int64), allocatable, target :: words(:)
    character(c_char), pointer, contiguous :: block(:)
    integer(int64) :: place, count, i

    call crc%start()
    allocate (words(block_words))
    call c_f_pointer(c_loc(words), block, [word_bytes*block_words])
    covers = bytes > 0
    place = 0
    do while (covers .and. place < bytes)
      count = min(bytes - place, size(block, kind=int64))
      call read_at(descriptor, place, block(:count), covers)
      call crc%add_words(words(:count/word_bytes))
      do i = count - modulo(count, word_bytes) + 1, count
        call crc%add_byte(block(i))
      end do
      place = place + count
    end do
  end function covers
end module dst_seal
