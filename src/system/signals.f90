!> The signals that ask a run to stop: it then writes a checkpoint and ends.
!>
!> A handler can do nothing but set a variable of its module, so here is the one that changes. The run loop of the
!> executable reads it; nothing that Python uses does. POSIX; numbers are Linux's.
module dst_signals
  use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_funptr, c_null_funptr, c_funloc
  implicit none
  private

  public :: listen_to_requests, listen_to_signals, stop_listening, stop_signal, is_told_to_end, stopped_by, no_signal

  integer(c_int), parameter :: sighup = 1, sigint = 2, sigusr1 = 10, sigterm = 15
  integer(c_intptr_t), parameter :: default_action = 0, ignore = 1

  !> No signal has come.
  integer, parameter :: no_signal = 0
  integer(c_int), volatile :: received = no_signal

  interface
    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
  end interface

contains

  !> From now on SIGUSR1, which asks to stop and nothing else, is remembered: a scheduler may send it before there is a run.
  subroutine listen_to_requests()
    call listen(sigusr1)
  end subroutine listen_to_requests

  !> From now on SIGHUP (the terminal is gone), SIGINT and SIGTERM are remembered too. A second SIGINT ends the program at once.
  subroutine listen_to_signals()
    call listen(sighup)
    call listen(sigint)
    call listen(sigterm)
  end subroutine listen_to_signals

  !> From now on signals that end a program have their usual effect. What is done need not be asked to stop.
  subroutine stop_listening()
    integer(c_int), parameter :: all(3) = [sighup, sigint, sigterm]
    type(c_funptr) :: previous
    integer :: i

    do i = 1, size(all)
      previous = c_signal(all(i), c_null_funptr)
      if (transfer(previous, ignore) == ignore) previous = c_signal(all(i), previous)
    end do
  end subroutine stop_listening

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

  !> The number of the signal that asked to stop, or `no_signal`.
  integer function stop_signal()
    stop_signal = received
  end function stop_signal

  !> Whether a signal says to end now. SIGUSR1 only asks to begin nothing new.
  logical function is_told_to_end()
    is_told_to_end = received /= no_signal .and. received /= sigusr1
  end function is_told_to_end

  !> 'stopped by SIGTERM': by the signal that has come, or by `number`.
  function stopped_by(number) result(text)
    integer, intent(in), optional :: number
    character(:), allocatable :: text
    integer :: signal

    signal = received
    if (present(number)) signal = number
    select case (signal)
    case (sighup)
      text = 'stopped by SIGHUP'
    case (sigint)
      text = 'stopped by SIGINT'
    case (sigterm)
      text = 'stopped by SIGTERM'
    case (sigusr1)
      text = 'stopped by SIGUSR1'
    case default
      text = 'stopped by a signal'
    end select
  end function stopped_by
end module dst_signals
