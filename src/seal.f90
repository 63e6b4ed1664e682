!> The last line of a finished file: a checksum of all bytes before it.
!>
!> HDF5 passes over what stands behind its own end, and drops it when it changes the file: a file that was edited later has no
!> seal, and is as good as one of a run that was killed.
module dst_seal
  use dst_crc32, only: crc32_t
  use dst_disk, only: append_text, file_size
  use dst_kinds, only: int64
  implicit none
  private

  public :: seal_file, checksum_of_file

  character(*), parameter :: mark = 'dynstiction CRC-32 '

contains

  !> Append the seal to a closed file. Without room for it the file goes without: it is complete.
  subroutine seal_file(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: checksum

    checksum = checksum_of_file(file_name)
    if (checksum /= '-') call append_text(file_name, mark//checksum//achar(10))
  end subroutine seal_file

  !> CRC-32 of a file's bytes as 8 hexadecimal digits; '-' if it cannot be read.
  function checksum_of_file(file_name) result(text)
    character(*), intent(in) :: file_name
    character(:), allocatable :: text
    integer(int64), parameter :: block_words = 32768, word_bytes = 8
    integer(int64), allocatable :: words(:)
    integer(int64) :: left
    type(crc32_t) :: crc
    character :: byte
    integer :: unit, io_status, i

    text = '-'
    left = file_size(file_name)
    if (left <= 0) return
    open (newunit=unit, file=file_name, status='old', action='read', access='stream', form='unformatted', iostat=io_status)
    if (io_status /= 0) return
    call crc%start()
    allocate (words(block_words))
    do while (left >= word_bytes .and. io_status == 0)
      if (left < word_bytes*size(words)) words = words(:left/word_bytes)
      read (unit, iostat=io_status) words
      call crc%add_words(words)
      left = left - word_bytes*size(words)
    end do
    do i = 1, int(left)
      if (io_status == 0) read (unit, iostat=io_status) byte
      call crc%add_byte(byte)
    end do
    close (unit)
    if (io_status == 0) text = crc%text()
  end function checksum_of_file
end module dst_seal
