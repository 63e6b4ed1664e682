!> Errors as values: a code and a text that says what is wrong and what to do.
!>
!> Nothing below the command line prints or stops; a procedure that can fail has a last argument
!> `type(error_t), allocatable, intent(out) :: error`, unallocated on success.
module dst_errors
  use dst_text, only: printable
  implicit none
  private

  public :: error_t, raise, raise_lines, has_code, exit_status
  public :: result_done, usage_error, deck_error, file_error, some_failed
  public :: step_underflow, too_many_steps, not_finite, too_many_rejections, chattering, out_of_memory, &
    stopped_early

  !> What went wrong, in one line, or, of a deck, in one line for each fault: no name in it breaks a line. `code` is one of the
  !> constants below and also the `result_code` of a file.
  type :: error_t
    integer :: code = 0
    character(:), allocatable :: text
    character(:), allocatable :: key   !! key of a deck, as GROUP.KEY, if its value is wrong; mostly unallocated
  end type error_t

  !> Codes. They are also the exit status, except those of the solver.
  integer, parameter :: result_done = 0
  integer, parameter :: usage_error = 1
  integer, parameter :: deck_error = 2
  integer, parameter :: file_error = 3
  integer, parameter :: some_failed = 5   !! of the cases of a sweep
  !> The run could not be finished: the solver or the machine failed. 40 to 49.
  integer, parameter :: step_underflow = 41
  integer, parameter :: too_many_steps = 42
  integer, parameter :: not_finite = 43
  integer, parameter :: too_many_rejections = 44
  integer, parameter :: chattering = 45
  integer, parameter :: out_of_memory = 47
  integer, parameter :: stopped_early = 75

contains

  !> Set `error`. If it may become the result of a result file, its text refers to the page that explains all results.
  pure subroutine raise(error, code, text, key)
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in) :: code
    character(*), intent(in) :: text
    character(*), intent(in), optional :: key   !! key of the deck, as GROUP.KEY

    allocate (error)
    error%code = code
    error%text = printable(text)
    if (present(key)) error%key = key
    ! A process that leaves the message to another process says nothing.
    if (text == '') return
    if (exit_status(code) == 4 .or. code == some_failed .or. code == stopped_early) &
      error%text = error%text//'; see dynstiction help errors'
  end subroutine raise

  !> Set `error` to several faults, one in each line.
  pure subroutine raise_lines(error, code, lines)
    type(error_t), allocatable, intent(out) :: error
    integer, intent(in) :: code
    character(*), intent(in) :: lines    !! every line is printable

    allocate (error)
    error%code = code
    error%text = lines
  end subroutine raise_lines

  !> Whether there is an error, and whether it has this code.
  pure logical function has_code(error, code)
    type(error_t), allocatable, intent(in) :: error
    integer, intent(in) :: code

    has_code = .false.
    if (allocated(error)) has_code = error%code == code
  end function has_code

  !> Exit status of the executable for an error or result code.
  pure integer function exit_status(code)
    integer, intent(in) :: code

    exit_status = merge(4, code, code >= 40 .and. code <= 49)
  end function exit_status
end module dst_errors
