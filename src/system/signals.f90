!> The signals that ask a run to stop: it then makes its file whole and ends.
!>
!> A handler can do nothing but set a variable, which is in posix.c. The run loop of the executable reads it; nothing that Python
!> uses does.
module dst_signals
  use dst_posix, only: c_listen, stop_signal, dst_sighup, dst_sigint, dst_sigterm, dst_sigusr1
  implicit none
  private

  public :: listen_to_requests, listen_to_signals, stop_signal, is_told_to_end, stopped_by, no_signal

  !> No signal has arrived.
  integer, parameter :: no_signal = 0

contains

  !> From now on SIGUSR1 is remembered. It only asks to stop, and a scheduler may send it before there is a run.
  subroutine listen_to_requests()
    call c_listen(dst_sigusr1)
  end subroutine listen_to_requests

  !> From now on SIGHUP (the terminal is gone), SIGINT and SIGTERM are remembered too. A second SIGINT ends the program at once.
  subroutine listen_to_signals()
    call c_listen(dst_sighup)
    call c_listen(dst_sigint)
    call c_listen(dst_sigterm)
  end subroutine listen_to_signals

  !> Whether a signal asks to end now. SIGUSR1 only asks not to begin anything new.
  logical function is_told_to_end()
    integer :: signal

    signal = stop_signal()
    is_told_to_end = signal /= no_signal .and. signal /= dst_sigusr1
  end function is_told_to_end

  !> 'stopped by SIGTERM': by the signal that has arrived, or by `number`.
  function stopped_by(number) result(text)
    integer, intent(in), optional :: number
    character(:), allocatable :: text
    integer :: signal

    signal = stop_signal()
    if (present(number)) signal = number
    text = 'stopped by a signal'
    if (signal == dst_sighup) text = 'stopped by SIGHUP'
    if (signal == dst_sigint) text = 'stopped by SIGINT'
    if (signal == dst_sigterm) text = 'stopped by SIGTERM'
    if (signal == dst_sigusr1) text = 'stopped by SIGUSR1'
  end function stopped_by
end module dst_signals
