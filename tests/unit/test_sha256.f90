!> SHA-256, compared with the vectors of FIPS 180-4 / NIST's examples and RFC 6234.
program test_sha256
  use checks, only: check, finish
  use dst_sha256, only: sha256
  implicit none

  call check_hash('empty', sha256(''), 'e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855')
  call check_hash('abc', sha256('abc'), 'ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad')
  call check_hash('two blocks', sha256('abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq'), &
    '248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1')
  call check_hash('a million a', sha256(repeat('a', 1000000)), &
    'cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0')
  ! Lengths near the end of the padding; values from coreutils' sha256sum.
  call check_hash('55 bytes', sha256(repeat('a', 55)), '9f4390f8d30c2dd92ec9f095b65e2b9ae9b0a925a5258e241c9f1e910f734318')
  call check_hash('56 bytes', sha256(repeat('a', 56)), 'b35439a4ac6f0948b6d6f9e3c6af0f5f590ce20f1bde7090ef7970686ec6738a')
  call check_hash('64 bytes', sha256(repeat('a', 64)), 'ffe054fe7ae0cb6dc65c3af9b61d5209f439851db43d0ba5997337df154668eb')
  call check_hash('UTF-8', sha256('µ'), '5a072f1be4c3ee04849a9ad686b287d12d6a99dc4eba13c7a2ca1844e7923a0a')
  call check_hash('a different text differs', merge('same', 'else', sha256('abd') == sha256('abc')), 'else')

  call finish()

contains

  subroutine check_hash(name, actual, expected)
    character(*), intent(in) :: name, actual, expected

    call check(name//': '//actual//' instead of '//expected, actual == expected)
  end subroutine check_hash
end program test_sha256
