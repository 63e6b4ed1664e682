!> The SHA-256 digest of a text (FIPS 180-4), by which a file identifies the deck that it came from.
!>
!> A word of 32 bits is kept in a 64-bit integer, since Fortran has no unsigned arithmetic with wrap-around.
module dst_sha256
  use dst_kinds, only: int64
  use dst_text, only: lower_case
  implicit none
  private

  public :: sha256

  integer, parameter :: block_size = 64   ! bytes
  integer(int64), parameter :: word_mask = int(z'FFFFFFFF', int64)

  !> First 32 bits of the fractional parts of the square roots of the first 8 primes.
  integer(int64), parameter :: initial_state(8) = [ &
    int(z'6a09e667', int64), int(z'bb67ae85', int64), int(z'3c6ef372', int64), int(z'a54ff53a', int64), &
    int(z'510e527f', int64), int(z'9b05688c', int64), int(z'1f83d9ab', int64), int(z'5be0cd19', int64)]

  !> First 32 bits of the fractional parts of the cube roots of the first 64 primes.
  integer(int64), parameter :: round_constant(64) = [ &
    int(z'428a2f98', int64), int(z'71374491', int64), int(z'b5c0fbcf', int64), int(z'e9b5dba5', int64), &
    int(z'3956c25b', int64), int(z'59f111f1', int64), int(z'923f82a4', int64), int(z'ab1c5ed5', int64), &
    int(z'd807aa98', int64), int(z'12835b01', int64), int(z'243185be', int64), int(z'550c7dc3', int64), &
    int(z'72be5d74', int64), int(z'80deb1fe', int64), int(z'9bdc06a7', int64), int(z'c19bf174', int64), &
    int(z'e49b69c1', int64), int(z'efbe4786', int64), int(z'0fc19dc6', int64), int(z'240ca1cc', int64), &
    int(z'2de92c6f', int64), int(z'4a7484aa', int64), int(z'5cb0a9dc', int64), int(z'76f988da', int64), &
    int(z'983e5152', int64), int(z'a831c66d', int64), int(z'b00327c8', int64), int(z'bf597fc7', int64), &
    int(z'c6e00bf3', int64), int(z'd5a79147', int64), int(z'06ca6351', int64), int(z'14292967', int64), &
    int(z'27b70a85', int64), int(z'2e1b2138', int64), int(z'4d2c6dfc', int64), int(z'53380d13', int64), &
    int(z'650a7354', int64), int(z'766a0abb', int64), int(z'81c2c92e', int64), int(z'92722c85', int64), &
    int(z'a2bfe8a1', int64), int(z'a81a664b', int64), int(z'c24b8b70', int64), int(z'c76c51a3', int64), &
    int(z'd192e819', int64), int(z'd6990624', int64), int(z'f40e3585', int64), int(z'106aa070', int64), &
    int(z'19a4c116', int64), int(z'1e376c08', int64), int(z'2748774c', int64), int(z'34b0bcb5', int64), &
    int(z'391c0cb3', int64), int(z'4ed8aa4a', int64), int(z'5b9cca4f', int64), int(z'682e6ff3', int64), &
    int(z'748f82ee', int64), int(z'78a5636f', int64), int(z'84c87814', int64), int(z'8cc70208', int64), &
    int(z'90befffa', int64), int(z'a4506ceb', int64), int(z'bef9a3f7', int64), int(z'c67178f2', int64)]

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
    integer(int64) :: schedule(64), a, b, c, d, e, f, g, h, t1, t2
    integer :: i

    do i = 1, 16
      schedule(i) = big_endian_word(chunk(4*i - 3:4*i))
    end do
    do i = 17, 64
      schedule(i) = iand(word_mask, schedule(i - 16) + schedule(i - 7) &
        + ieor(ieor(rotated(schedule(i - 15), 7), rotated(schedule(i - 15), 18)), shiftr(schedule(i - 15), 3)) &
        + ieor(ieor(rotated(schedule(i - 2), 17), rotated(schedule(i - 2), 19)), shiftr(schedule(i - 2), 10)))
    end do

    a = state(1); b = state(2); c = state(3); d = state(4)
    e = state(5); f = state(6); g = state(7); h = state(8)
    do i = 1, 64
      t1 = h + ieor(ieor(rotated(e, 6), rotated(e, 11)), rotated(e, 25)) &
        + ieor(iand(e, f), iand(iand(word_mask, not(e)), g)) + round_constant(i) + schedule(i)
      t2 = ieor(ieor(rotated(a, 2), rotated(a, 13)), rotated(a, 22)) &
        + ieor(ieor(iand(a, b), iand(a, c)), iand(b, c))
      h = g; g = f; f = e
      e = iand(word_mask, d + t1)
      d = c; c = b; b = a
      a = iand(word_mask, t1 + t2)
    end do
    state = iand(word_mask, state + [a, b, c, d, e, f, g, h])
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
