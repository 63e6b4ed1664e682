!> Commands that Python carries out: the executable makes way for `python3 -m dynstiction`.
!>
!> The interpreter is that of the environment variable DYNSTICTION_PYTHON, else the python3 beside the executable (a virtual
!> environment's), else the python3 of PATH. POSIX.
module dst_handover
  use, intrinsic :: iso_c_binding, only: c_int, c_char, c_ptr, c_loc, c_null_ptr, c_null_char
  use dst_command_line, only: argument_t
  use dst_disk, only: file_exists, folder_of, true_path
  use dst_errors, only: error_t, raise, file_error
  use dst_machine, only: environment
  implicit none
  private

  public :: hand_over

  character(*), parameter :: variable = 'DYNSTICTION_PYTHON'

  !> A word that C can read.
  type :: word_t
    character(kind=c_char), allocatable :: bytes(:)
  end type word_t

  interface
    integer(c_int) function c_execvp(file, arguments) bind(c, name='execvp')
      import :: c_int, c_char, c_ptr
      character(kind=c_char), intent(in) :: file(*)
      type(c_ptr), intent(in) :: arguments(*)
    end function c_execvp
  end interface

contains

  !> The interpreter for Python's commands: a path, or a name to be looked up in PATH.
  function chosen_interpreter() result(interpreter)
    character(:), allocatable :: interpreter

    interpreter = environment(variable)
    if (interpreter /= '') return
    interpreter = folder_of(true_path('/proc/self/exe'))//'/python3'
    if (.not. file_exists(interpreter)) interpreter = 'python3'
  end function chosen_interpreter

  !> Become Python with the arguments of this program; returns only if there is no interpreter.
  subroutine hand_over(own_arguments, error)
    type(argument_t), intent(in) :: own_arguments(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: interpreter
    type(word_t), allocatable, target :: words(:)
    type(c_ptr), allocatable :: arguments(:)
    integer(c_int) :: status
    integer :: i

    interpreter = chosen_interpreter()
    allocate (words(3 + size(own_arguments)), arguments(4 + size(own_arguments)))
    words(1) = as_word(interpreter)
    words(2) = as_word('-c')
    words(3) = as_word(bootstrap())
    do i = 1, size(own_arguments)
      words(3 + i) = as_word(own_arguments(i)%text)
    end do
    do i = 1, size(words)
      arguments(i) = c_loc(words(i)%bytes(1))
    end do
    arguments(size(arguments)) = c_null_ptr
    status = c_execvp(words(1)%bytes, arguments)
    if (status /= 0) call raise(error, file_error, interpreter//': no Python interpreter that can be started: install '// &
      'Python 3.11 or later, or set '//variable//' to the one that has the package dynstiction')
  end subroutine hand_over

  !> The program for Python. A folder named dynstiction where the user happens to be is not the package.
  function bootstrap() result(text)
    character(:), allocatable :: text
    character, parameter :: n = new_line('a')

    text = 'import sys'//n// &
      'sys.path = [folder for folder in sys.path if folder]'//n// &
      'try:'//n// &
      '    from dynstiction.__main__ import main'//n// &
      'except ImportError as error:'//n// &
      '    print(f"dynstiction: {sys.executable}: {error}: install the package there (pip install .), '// &
      'or set '//variable//' to an interpreter that has it", file=sys.stderr)'//n// &
      '    sys.exit(3)'//n// &
      'sys.exit(main(program="dynstiction"))'//n
  end function bootstrap

  pure function as_word(text) result(word)
    character(*), intent(in) :: text
    type(word_t) :: word
    integer :: i

    allocate (word%bytes(len(text) + 1))
    do i = 1, len(text)
      word%bytes(i) = text(i:i)
    end do
    word%bytes(len(text) + 1) = c_null_char
  end function as_word
end module dst_handover
