!> CRC-32 as in gzip, PNG and Ethernet (ISO 3309; reflected polynomial EDB88320), by zlib.
!>
!> Any change within 32 successive bits changes the checksum, and so do all other changes except one in 2^32.
module dst_crc32
  use, intrinsic :: iso_c_binding, only: c_int, c_long, c_char, c_ptr, c_loc
  use dst_kinds, only: int64
  implicit none
  private

  public :: crc32_t

  !> A checksum of bytes that are added piece by piece.
  type :: crc32_t
    private
    integer(c_long) :: value = 0
  contains
    procedure :: start
    procedure :: add_words
    procedure :: add_bytes
    procedure :: text
  end type crc32_t

  interface
    pure integer(c_long) function zlib_crc32(before, bytes, count) bind(c, name='crc32')
      import :: c_int, c_long, c_ptr
      integer(c_long), value :: before
      type(c_ptr), value :: bytes
      integer(c_int), value :: count
    end function zlib_crc32
  end interface

contains

  !> The checksum of no bytes, or of those whose checksum has the text `before`.
  pure subroutine start(self, before)
    class(crc32_t), intent(inout) :: self
    character(8), intent(in), optional :: before
    integer :: io_status

    self%value = 0
    if (.not. present(before)) return
    read (before, '(z8)', iostat=io_status) self%value
    if (io_status /= 0) self%value = 0
  end subroutine start

  !> Add words of 8 bytes each, the lowest byte first, at most 2^28 words.
  pure subroutine add_words(self, words)
    class(crc32_t), intent(inout) :: self
    integer(int64), intent(in), target, contiguous :: words(:)

    if (size(words) > 0) self%value = zlib_crc32(self%value, c_loc(words), 8*size(words, kind=c_int))
  end subroutine add_words

  !> Add at most 2^31 bytes.
  pure subroutine add_bytes(self, bytes)
    class(crc32_t), intent(inout) :: self
    character(c_char), intent(in), target, contiguous :: bytes(:)

    if (size(bytes) > 0) self%value = zlib_crc32(self%value, c_loc(bytes), size(bytes, kind=c_int))
  end subroutine add_bytes

  !> The checksum so far, as 8 hexadecimal digits.
  pure function text(self)
    class(crc32_t), intent(in) :: self
    character(8) :: text

    write (text, '(z8.8)') self%value
  end function text
end module dst_crc32
