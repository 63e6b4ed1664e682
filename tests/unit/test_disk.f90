!> Names and reasons as the user of a result file sees them. What is done with files: tests/faults.
program test_disk
  use checks, only: check, finish
  use dst_disk, only: folder_of, place_of, true_path, with_remedy
  implicit none

  call test_names()
  call test_reasons()

  call finish()

contains

  subroutine test_names()
    call check('folder of a bare name', folder_of('x.h5') == '.')
    call check('folder of a relative name', folder_of('a/b/x.h5') == 'a/b')
    call check('folder at the root', folder_of('/x.h5') == '/')
    call check('a path that does not exist stays', true_path('no/such/x.h5') == 'no/such/x.h5')
    call check('a path through the parent', true_path('/usr/..') == '/')
    call check('a place that is not there yet', place_of('x.h5') == true_path('.')//'/x.h5')
    call check('a place through the parent', place_of('/usr/../usr/no.h5') == '/usr/no.h5')
  end subroutine test_names

  !> A known reason says what to do; an unknown one is passed on.
  subroutine test_reasons()
    call check('disk full', index(with_remedy('No space left on device'), 'free some space') > 0)
    call check('unknown', with_remedy('Input/output error') == 'Input/output error')
  end subroutine test_reasons

end program test_disk
