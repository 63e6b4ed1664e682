!> CRC-32 as in zlib, gzip, PNG and Ethernet (ISO 3309; reflected polynomial EDB88320), eight bytes at a time.
!>
!> Any change within 32 successive bits changes it, and of other changes all but one in 2^32.
!> Source of the method: M. E. Kounavis and F. L. Berry, Proc. ISCC 2005, 855 ("slicing by eight").
module dst_crc32
  use dst_kinds, only: int64
  implicit none
  private

  public :: crc32_t

  integer(int64), parameter :: polynomial = int(z'EDB88320', int64), all_ones = int(z'FFFFFFFF', int64)

  !> A checksum of bytes that come piece by piece.
  type :: crc32_t
    private
    integer(int64) :: register = all_ones
    !> What a byte followed by so many zero bytes adds.
    integer(int64) :: table(0:255, 0:7) = 0
  contains
    procedure :: start
    procedure :: add_words
    procedure :: add_byte
    procedure :: text
  end type crc32_t

contains

  !> Of no bytes yet, or of those of which `before` is the text.
  pure subroutine start(self, before)
    class(crc32_t), intent(inout) :: self
    character(8), intent(in), optional :: before
    integer(int64) :: remainder
    integer :: byte, bit, zeros, io_status

    self%register = 0
    if (present(before)) then
      read (before, '(z8)', iostat=io_status) self%register
      if (io_status /= 0) self%register = 0
    end if
    self%register = ieor(self%register, all_ones)
    if (self%table(255, 0) /= 0) return
    do byte = 0, 255
      remainder = byte
      do bit = 1, 8
        remainder = merge(ieor(shiftr(remainder, 1), polynomial), shiftr(remainder, 1), btest(remainder, 0))
      end do
      self%table(byte, 0) = remainder
    end do
    do zeros = 1, 7
      do byte = 0, 255
        remainder = self%table(byte, zeros - 1)
        self%table(byte, zeros) = ieor(shiftr(remainder, 8), self%table(iand(remainder, 255_int64), 0))
      end do
    end do
  end subroutine start

  !> Take in 8 bytes a word, the lowest first.
  pure subroutine add_words(self, words)
    class(crc32_t), intent(inout) :: self
    integer(int64), intent(in) :: words(:)
    integer(int64) :: x, r
    integer :: i

    r = self%register
    associate (t => self%table)
      do i = 1, size(words)
        x = ieor(words(i), r)
        r = ieor( &
          ieor(ieor(t(ibits(x, 0, 8), 7), t(ibits(x, 8, 8), 6)), ieor(t(ibits(x, 16, 8), 5), t(ibits(x, 24, 8), 4))), &
          ieor(ieor(t(ibits(x, 32, 8), 3), t(ibits(x, 40, 8), 2)), ieor(t(ibits(x, 48, 8), 1), t(ibits(x, 56, 8), 0))))
      end do
    end associate
    self%register = r
  end subroutine add_words

  pure subroutine add_byte(self, byte)
    class(crc32_t), intent(inout) :: self
    character, intent(in) :: byte

    self%register = ieor(shiftr(self%register, 8), &
      self%table(iand(ieor(self%register, int(ichar(byte), int64)), 255_int64), 0))
  end subroutine add_byte

  !> The checksum so far, as 8 hexadecimal digits.
  pure function text(self)
    class(crc32_t), intent(in) :: self
    character(8) :: text

    write (text, '(z8.8)') ieor(self%register, all_ones)
  end function text
end module dst_crc32
