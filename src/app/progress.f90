!> The progress of a run on the terminal: one line that is updated, or a plain line every 10 s.
module dst_progress
  use dst_kinds, only: wp
  use dst_plain_numbers, only: duration_text
  use dst_posix, only: c_is_terminal, put_error
  use dst_text, only: printable
  implicit none
  private

  public :: progress_t, new_progress, time_left

  real(wp), parameter :: terminal_interval = 0.2_wp, plain_interval = 10.0_wp   ! s

  !> What has been shown, and when to show more.
  type :: progress_t
    private
    character(:), allocatable :: label
    logical :: quiet = .false.
    logical :: terminal = .false.
    logical :: shown = .false.
    real(wp) :: next = 0.0_wp      !! wall time of the next line, s
  contains
    procedure :: is_due
    procedure :: show
    procedure :: remark
    procedure :: close
  end type progress_t

contains

  !> The progress of the run that `label` names.
  function new_progress(label, quiet) result(progress)
    character(*), intent(in) :: label
    logical, intent(in) :: quiet
    type(progress_t) :: progress

    progress%label = printable(label)
    progress%quiet = quiet
    progress%terminal = c_is_terminal() == 1
    progress%next = merge(terminal_interval, plain_interval, progress%terminal)
  end function new_progress

  !> Whether it is time to show more, after so much wall time [s].
  pure logical function is_due(self, elapsed)
    class(progress_t), intent(in) :: self
    real(wp), intent(in) :: elapsed

    is_due = .not. self%quiet .and. elapsed >= self%next
  end function is_due

  !> ', 12 s left', if a share took `elapsed` wall time [s]; '' before the remaining time can be estimated.
  pure function time_left(elapsed, share) result(text)
    real(wp), intent(in) :: elapsed, share
    character(:), allocatable :: text

    text = ''
    if (share > sqrt(tiny(share))) text = ', '//duration_text(elapsed*(1.0_wp - share)/share)//' left'
  end function time_left

  !> Show a line, which is not kept on a terminal.
  subroutine show(self, words, elapsed)
    class(progress_t), intent(inout) :: self
    character(*), intent(in) :: words
    real(wp), intent(in) :: elapsed
    character(:), allocatable :: text

    text = self%label//': '//words
    if (self%terminal) then
      call put_error(achar(13)//text//achar(27)//'[K')
      self%next = elapsed + terminal_interval
    else
      call put_error(text//new_line('a'))
      self%next = elapsed + plain_interval
    end if
    self%shown = .true.
  end subroutine show

  !> A line that is kept.
  subroutine remark(self, text)
    class(progress_t), intent(in) :: self
    character(*), intent(in) :: text

    if (.not. self%quiet) call put_error(self%label//': '//text//new_line('a'))
  end subroutine remark

  !> Clear the line on a terminal.
  subroutine close(self)
    class(progress_t), intent(inout) :: self

    if (self%shown .and. self%terminal) call put_error(achar(13)//achar(27)//'[K')
  end subroutine close
end module dst_progress
