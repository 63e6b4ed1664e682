!> The SHA-256 digest of a text (FIPS 180-4), by which a file identifies the deck that it came from.
!>
!> A word of 32 bits is kept in a 64-bit integer, since Fortran has no unsigned arithmetic with wrap-around.
module dst_sha256
  use dst_kinds, only: int64, real64
  use dst_text, only: lower_case
  implicit none
  private

  public :: sha256

  integer, parameter :: block_size = 64   ! bytes
  integer(int64), parameter :: word_mask = int(z'FFFFFFFF', int64)

  integer, parameter :: primes(64) = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, &
    97, 101, 103, 107, 109, 113, 127, 131, 137, 139, 149, 151, 157, 163, 167, 173, 179, 181, 191, 193, 197, 199, 211, 223, 227, &
    229, 233, 239, 241, 251, 257, 263, 269, 271, 277, 281, 283, 293, 307, 311]
  !> First 32 bits of the fractional parts of the square roots of the first 8 primes, and of the cube roots of all.
  integer(int64), parameter :: initial_state(8) = &
    int(2.0_real64**32*modulo(sqrt(real(primes(:8), real64)), 1.0_real64), int64)
  integer(int64), parameter :: round_constant(64) = &
    int(2.0_real64**32*modulo(real(primes, real64)**(1.0_real64/3.0_real64), 1.0_real64), int64)

contains

  !> Digest of `text` as 64 lower-case hexadecimal digits.
  pure function sha256(text) result(digest)
    character(*), intent(in) :: text
    character(64) :: digest
    integer(int64) :: state(8)
    character(:), allocatable :: message
    integer :: first, i

    message = padded(text)
    state = initial_state
    do first = 1, len(message), block_size
      call compress(state, message(first:first + block_size - 1))
    end do
    do i = 1, 8
      write (digest(8*i - 7:8*i), '(z8.8)') state(i)
    end do
    digest = lower_case(digest)
  end function sha256

  !> The text, a one bit, zeros, and the text's length in bits as 64 big-endian bits: whole blocks.
  pure function padded(text) result(message)
    character(*), intent(in) :: text
    character(:), allocatable :: message
    integer(int64) :: bits
    integer :: i

    message = text//char(128)//repeat(char(0), modulo(block_size - 9 - len(text), block_size))
    bits = 8_int64*len(text, int64)
    do i = 7, 0, -1
      message = message//char(int(iand(shiftr(bits, 8*i), 255_int64)))
    end do
  end function padded

  !> Add one block of 64 bytes to the state.
  pure subroutine compress(state, chunk)
    integer(int64), intent(inout) :: state(8)
    character(block_size), intent(in) :: chunk
    integer(int64) :: schedule(64), v(8), t1, t2
    integer :: i

    do i = 1, 16
      schedule(i) = big_endian_word(chunk(4*i - 3:4*i))
    end do
    do i = 17, 64
      schedule(i) = iand(word_mask, schedule(i - 16) + schedule(i - 7) &
        + ieor(ieor(rotated(schedule(i - 15), 7), rotated(schedule(i - 15), 18)), shiftr(schedule(i - 15), 3)) &
        + ieor(ieor(rotated(schedule(i - 2), 17), rotated(schedule(i - 2), 19)), shiftr(schedule(i - 2), 10)))
    end do

    v = state
    do i = 1, 64
      associate (a => v(1), b => v(2), c => v(3), e => v(5), f => v(6), g => v(7), h => v(8))
        t1 = h + ieor(ieor(rotated(e, 6), rotated(e, 11)), rotated(e, 25)) &
          + ieor(iand(e, f), iand(iand(word_mask, not(e)), g)) + round_constant(i) + schedule(i)
        t2 = ieor(ieor(rotated(a, 2), rotated(a, 13)), rotated(a, 22)) &
          + ieor(ieor(iand(a, b), iand(a, c)), iand(b, c))
      end associate
      v = iand(word_mask, [t1 + t2, v(1:3), v(4) + t1, v(5:7)])
    end do
    state = iand(word_mask, state + v)
  end subroutine compress

  !> A 32-bit word, rotated to the right.
  elemental integer(int64) function rotated(word, places)
    integer(int64), intent(in) :: word
    integer, intent(in) :: places

    rotated = iand(word_mask, ior(shiftr(word, places), shiftl(word, 32 - places)))
  end function rotated

  pure integer(int64) function big_endian_word(bytes)
    character(4), intent(in) :: bytes
    integer :: i

    big_endian_word = 0
    do i = 1, 4
      big_endian_word = 256*big_endian_word + iand(int(ichar(bytes(i:i)), int64), 255_int64)
    end do
  end function big_endian_word
end module dst_sha256
