!> CRC-32, compared with published values and zlib's, and the seal at the end of a file.
program test_seal
  use checks, only: check, finish
  use dst_crc32, only: crc32_t
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_disk, only: close_descriptor, delete_file, file_size, identity_of, open_own_file
  use dst_kinds, only: int64
  use dst_seal, only: seal, break_seal, sound_seal, has_sound_seal
  implicit none

  character(*), parameter :: file_name = 'test_seal.bin'

  ! The check value of the catalogue of parametrised CRC algorithms; the others from zlib.
  call check_text('123456789', 'CBF43926')
  call check_text('a', 'E8B7BE43')
  call check_text(repeat('dynstiction', 5), '67D77458')
  call test_file()

  call finish()

contains

  !> Words and bytes in any mixture give the same.
  subroutine check_text(text, expected)
    character(*), intent(in) :: text, expected
    integer(int64) :: words(len(text)/8)
    type(crc32_t) :: by_bytes, by_words, in_parts
    integer :: i, middle

    call by_bytes%start()
    call by_words%start()
    do i = 1, len(text)
      call by_bytes%add_bytes([text(i:i)])
    end do
    words = transfer(text(:8*size(words)), words)
    call by_words%add_words(words)
    do i = 8*size(words) + 1, len(text)
      call by_words%add_bytes([text(i:i)])
    end do
    call check('CRC of '//text//' by bytes', by_bytes%text() == expected)
    call check('CRC of '//text//' by words', by_words%text() == expected)
    middle = len(text)/2
    call by_bytes%start()
    do i = 1, middle
      call by_bytes%add_bytes([text(i:i)])
    end do
    call in_parts%start(by_bytes%text())
    do i = middle + 1, len(text)
      call in_parts%add_bytes([text(i:i)])
    end do
    call check('CRC of '//text//' from its middle on', in_parts%text() == expected)
  end subroutine check_text

  !> Longer than a block, and not a whole number of words.
  subroutine test_file()
    integer :: unit, i
    integer(c_int) :: descriptor
    character(28) :: last
    character(:), allocatable :: checksum, reason

    open (newunit=unit, file=file_name, access='stream', form='unformatted', status='replace')
    write (unit) [(int(i, int64), i=0, 69999)], 'abc'
    close (unit)
    call open_own_file(file_name, identity_of(file_name), descriptor, reason)
    call check('no seal yet', sound_seal(descriptor) == '-')
    call seal(descriptor, checksum, reason)
    call check('checksum of a file', checksum == 'B93B6C3E')
    call check('it is sound', has_sound_seal(file_name))
    call check('the seal is 28 bytes', file_size(file_name) == 8*70000 + 3 + 28)
    call check('the checksum in the seal', sound_seal(descriptor) == checksum)
    open (newunit=unit, file=file_name, access='stream', form='unformatted', status='old')
    read (unit, pos=8*70000 + 4) last
    close (unit)
    call check('the seal', last == 'dynstiction CRC-32 B93B6C3E'//achar(10))
    open (newunit=unit, file=file_name, access='stream', form='unformatted', status='old')
    write (unit, pos=400001) 'x'
    close (unit)
    call check('not so of a file that was changed', .not. has_sound_seal(file_name))
    call check('nor has it a checksum then', sound_seal(descriptor) == '-')
    open (newunit=unit, file=file_name, access='stream', form='unformatted', status='old')
    write (unit, pos=400001) achar(80)
    close (unit)
    call check('and again of the file as it was', has_sound_seal(file_name))
    call break_seal(descriptor)
    call check('without a seal none is sound', .not. has_sound_seal(file_name))
    call check('the seal is gone', file_size(file_name) == 8*70000 + 3)
    call break_seal(descriptor)
    call check('what is no seal stays', file_size(file_name) == 8*70000 + 3)
    call seal(descriptor, checksum, reason)
    call check('the same seal again', checksum == 'B93B6C3E')
    call check('which is sound', has_sound_seal(file_name))
    call close_descriptor(descriptor)
    call delete_file(file_name)
    call check('no file, no checksum', sound_seal(descriptor) == '-')
    call seal(descriptor, checksum, reason)
    call check('no file, no seal', checksum == '-')
  end subroutine test_file
end program test_seal
