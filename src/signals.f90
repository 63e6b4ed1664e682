!> The signals that ask a run to stop: it then writes a checkpoint and ends.
!>
!> A handler can do nothing but set a variable of its module, so here is the one that changes. The run loop of the
!> executable reads it; nothing that Python uses does. POSIX; numbers are Linux's.
module dst_signals
  use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_funptr, c_null_funptr, c_funloc
  implicit none
  private

  public :: listen_to_signals, stop_signal

  integer(c_int), parameter :: sighup = 1, sigint = 2, sigusr1 = 10, sigterm = 15
  integer(c_intptr_t), parameter :: default_action = 0, ignore = 1

  integer(c_int), volatile :: received = 0

  interface
    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
  end interface

contains

  !> From now on SIGHUP (the terminal is gone), SIGINT, SIGTERM and SIGUSR1 are remembered. A second SIGINT ends the program at once.
  subroutine listen_to_signals()
    call listen(sighup)
    call listen(sigint)
    call listen(sigterm)
    call listen(sigusr1)
  end subroutine listen_to_signals

  !> The shell lets a job in the background ignore SIGINT: what is ignored stays so.
  subroutine listen(number)
    integer(c_int), intent(in) :: number
    type(c_funptr) :: previous

    previous = c_signal(number, transfer(ignore, c_null_funptr))
    if (transfer(previous, ignore) /= ignore) previous = c_signal(number, c_funloc(remember))
  end subroutine listen

  subroutine remember(number) bind(c)
    integer(c_int), value :: number
    type(c_funptr) :: previous

    received = number
    if (number == sigint) previous = c_signal(number, transfer(default_action, c_null_funptr))
  end subroutine remember

  !> The name of the signal that asked to stop; '' if none did.
  function stop_signal() result(name)
    character(:), allocatable :: name

    select case (received)
    case (sighup)
      name = 'SIGHUP'
    case (sigint)
      name = 'SIGINT'
    case (sigterm)
      name = 'SIGTERM'
    case (sigusr1)
      name = 'SIGUSR1'
    case default
      name = ''
    end select
  end function stop_signal
end module dst_signals
