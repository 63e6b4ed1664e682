!> The signals that ask a run to stop: it then makes its file whole and ends.
!>
!> A handler can do nothing but set a variable, which is in posix.c. The run loop of the executable reads it; nothing that Python
!> uses does.
module dst_signals
  use dst_posix, only: c_signal_name, fortran_text, is_told_to_end, listen_to_requests, listen_to_signals, stop_signal
  implicit none
  private

  public :: listen_to_requests, listen_to_signals, stop_signal, is_told_to_end, stopped_by, no_signal

  !> No signal has arrived.
  integer, parameter :: no_signal = 0

contains

  !> 'stopped by SIGTERM': by the signal that has arrived.
  function stopped_by() result(text)
    character(:), allocatable :: text

    text = 'stopped by '//fortran_text(c_signal_name(stop_signal()))
  end function stopped_by
end module dst_signals
