!> The last line of a finished file: a checksum of all bytes before it.
!>
!> HDF5 ignores data after its own end, and drops them when it changes the file: a file that was edited later has no seal, and is
!> treated like the file of a run that was killed.
module dst_seal
  use, intrinsic :: iso_c_binding, only: c_int, c_char
  use dst_crc32, only: crc32_t
  use dst_disk, only: close_descriptor, identity_of, identity_t, open_for_reading, read_at, set_file_size, system_reason, &
    write_bytes
  use dst_kinds, only: int64
  implicit none
  private

  public :: seal, break_seal, sound_seal, has_sound_seal

  character(*), parameter :: mark = 'dynstiction CRC-32 ', none = '-'
  integer(int64), parameter :: seal_bytes = len(mark) + 8 + 1

contains

  !> Append the seal to an open file, which is read once for this. `checksum`: the one in the seal; '-' if that fails, which leaves
  !> the file unchanged.
  subroutine seal(descriptor, checksum, reason)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable, intent(out) :: checksum
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(identity_t) :: file

    file = identity_of(descriptor)
    checksum = checksum_of(descriptor, file%bytes)
    if (checksum == none) then
      reason = 'it cannot be read: '//system_reason()
      return
    end if
    call write_bytes(descriptor, mark//checksum//achar(10), reason, file%bytes)
    if (.not. allocated(reason)) return
    call set_file_size(descriptor, file%bytes)
    checksum = none
  end subroutine seal

  !> Cut off the seal of a file that is to be changed.
  subroutine break_seal(descriptor)
    integer(c_int), intent(in) :: descriptor
    type(identity_t) :: file

    file = identity_of(descriptor)
    if (index(last_line(descriptor, file%bytes), mark) == 1) call set_file_size(descriptor, file%bytes - seal_bytes)
  end subroutine break_seal

  !> The checksum in the seal of an open file that has not changed since it was sealed, '-' for any other file.
  function sound_seal(descriptor) result(checksum)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable :: checksum
    type(identity_t) :: file

    file = identity_of(descriptor)
    checksum = checksum_of(descriptor, file%bytes - seal_bytes)
    if (last_line(descriptor, file%bytes) /= mark//checksum//achar(10)) checksum = none
  end function sound_seal

  !> Whether a file has not changed since it was sealed.
  logical function has_sound_seal(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: reason
    integer(c_int) :: descriptor
    integer(int64) :: bytes

    call open_for_reading(file_name, descriptor, bytes, reason)
    has_sound_seal = .not. allocated(reason)
    if (has_sound_seal) has_sound_seal = sound_seal(descriptor) /= none
    call close_descriptor(descriptor)
  end function has_sound_seal

  !> The text at the place of the seal in a file of this many bytes.
  function last_line(descriptor, bytes) result(line)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: bytes
    character(seal_bytes) :: line
    character(c_char) :: ending(seal_bytes)
    logical :: complete

    line = ''
    if (bytes < seal_bytes) return
    call read_at(descriptor, bytes - seal_bytes, ending, complete)
    if (complete) line = transfer(ending, line)
  end function last_line

  !> CRC-32 of the first `bytes` bytes of an open file as 8 hexadecimal digits; '-' if there are none, or if they cannot be read.
  function checksum_of(descriptor, bytes) result(checksum)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: bytes
    character(:), allocatable :: checksum
    integer(int64), parameter :: most = 262144
    character(c_char), allocatable :: block(:)
    type(crc32_t) :: crc
    integer(int64) :: place
    logical :: complete

    call crc%start()
    complete = bytes > 0
    place = 0
    do while (complete .and. place < bytes)
      allocate (block(min(bytes - place, most)))
      call read_at(descriptor, place, block, complete)
      call crc%add_bytes(block)
      place = place + size(block)
      deallocate (block)
    end do
    checksum = none
    if (complete) checksum = crc%text()
  end function checksum_of
end module dst_seal
