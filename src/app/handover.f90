!> Commands that Python carries out: the executable replaces itself by `python3 -m dynstiction`.
!>
!> The interpreter is that of the environment variable DYNSTICTION_PYTHON, else the python3 next to the executable (in a virtual
!> environment), else the python3 of PATH.
module dst_handover
  use, intrinsic :: iso_c_binding, only: c_int, nul => c_null_char
  use dst_disk, only: path_t, file_exists, folder_of, true_path
  use dst_errors, only: error_t, raise, file_error
  use dst_machine, only: environment
  use dst_posix, only: c_become
  implicit none
  private

  public :: hand_over

  character(*), parameter :: variable = 'DYNSTICTION_PYTHON'

contains

  !> The interpreter for Python's commands: a path, or a name to be searched in PATH.
  function chosen_interpreter() result(interpreter)
    character(:), allocatable :: interpreter

    interpreter = environment(variable)
    if (interpreter /= '') return
    interpreter = own_path()
    ! A word without a folder was found in PATH, where python3 is searched, too.
    if (index(interpreter, '/') > 0) interpreter = folder_of(true_path(interpreter))//'/python3'
    if (index(interpreter, '/') > 0) then
      if (file_exists(interpreter)) return
    end if
    interpreter = 'python3'
  end function chosen_interpreter

  !> The executable's file: Linux provides it; elsewhere it is the word with which it was called.
  function own_path() result(path)
    character(:), allocatable :: path
    integer :: length

    path = '/proc/self/exe'
    if (file_exists(path)) return
    call get_command_argument(0, length=length)
    path = repeat(' ', length)
    call get_command_argument(0, path)
  end function own_path

  !> Replace this program by Python with the same arguments; returns only if there is no interpreter.
  subroutine hand_over(own_arguments, error)
    type(path_t), intent(in) :: own_arguments(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: interpreter, words
    integer :: i

    interpreter = chosen_interpreter()
    words = interpreter//nul//'-c'//nul//bootstrap()//nul
    do i = 1, size(own_arguments)
      words = words//own_arguments(i)%text//nul
    end do
    call c_become(words, int(3 + size(own_arguments), c_int))
    call raise(error, file_error, interpreter//": no Python interpreter that can be started for '"//own_arguments(1)%text// &
      "', which is no command of the executable: install Python 3.11 or later, or set "//variable// &
      ' to the one that has the package dynstiction')
  end subroutine hand_over

  !> The program for Python. Nothing in the current folder is imported. Ctrl-C while Python starts (when it is blocked) and while
  !> modules are imported ends the process without a traceback.
  function bootstrap() result(text)
    character(:), allocatable :: text
    character, parameter :: n = new_line('a')

    ! _signal and sys are within the interpreter, unlike signal, which takes time and is looked for in folders.
    text = 'import _signal, sys'//n// &
      'if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:'//n// &
      '    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)'//n// &
      '_signal.pthread_sigmask(_signal.SIG_UNBLOCK, [_signal.SIGINT])'//n// &
      'sys.path = [folder for folder in sys.path if folder]'//n// &
      'try:'//n// &
      '    from dynstiction.__main__ import main'//n// &
      'except ImportError as error:'//n// &
      '    print(f"dynstiction: {sys.argv[1]!r} is no command of the executable, and other commands need its Python package: '// &
      '{sys.executable}: {error}: install the package there (pip install .), '// &
      'or set '//variable//' to an interpreter that has it", file=sys.stderr)'//n// &
      '    sys.exit(3)'//n// &
      'sys.exit(main(program="dynstiction"))'//n
  end function bootstrap
end module dst_handover
