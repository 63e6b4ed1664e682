!> The progress of a run on the terminal: one line that is updated, or a plain line every 10 s.
module dst_progress
  use dst_kinds, only: wp, int64
  use dst_plain_numbers, only: number_text, duration_text
  use dst_posix, only: c_is_terminal
  use dst_standard_streams, only: put_error
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: progress_t, new_progress

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
    procedure :: show
    procedure :: show_cases
    procedure :: show_search
    procedure, private :: put_line
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

  !> Report that `done` of `total` [s] of `what` took `elapsed` wall time [s], if it is time to.
  subroutine show(self, what, done, total, elapsed)
    class(progress_t), intent(inout) :: self
    character(*), intent(in) :: what
    real(wp), intent(in) :: done, total, elapsed
    real(wp) :: share
    character(6) :: percent

    if (self%quiet .or. elapsed < self%next) return
    share = done/total
    write (percent, '(f6.1)') 100.0_wp*share
    call self%put_line(self%label//':'//percent//' %, '//what//' = '//number_text(done)//' of '//number_text(total)// &
      ' s'//time_left(elapsed, share), elapsed)
  end subroutine show

  !> Report that, in addition to `before` cases, `done` of `to_do` took `elapsed` wall time [s], if it is time to; `failed` of all.
  subroutine show_cases(self, before, done, to_do, failed, elapsed)
    class(progress_t), intent(inout) :: self
    integer, intent(in) :: before, done, to_do, failed
    real(wp), intent(in) :: elapsed
    character(:), allocatable :: pace

    if (self%quiet .or. elapsed < self%next) return
    pace = ''
    if (done > 0) pace = ', '//number_text(real(done, wp)/elapsed)//' cases/s'//time_left(elapsed, real(done, wp)/real(to_do, wp))
    call self%put_line(self%label//': '//integer_text(before + done)//' of '//integer_text(before + to_do)//' cases, '// &
      integer_text(failed)//' failed'//pace, elapsed)
  end subroutine show_cases

  !> Report that a search for cycles has followed so many passages in `elapsed` wall time [s], if it is time to.
  subroutine show_search(self, passages, elapsed)
    class(progress_t), intent(inout) :: self
    integer(int64), intent(in) :: passages
    real(wp), intent(in) :: elapsed

    if (self%quiet .or. elapsed < self%next) return
    call self%put_line(self%label//': cycles of '//number_text(real(passages, wp))//' passages', elapsed)
  end subroutine show_search

  !> ', 12 s left', if a share took `elapsed` wall time [s]; '' before the remaining time can be estimated.
  pure function time_left(elapsed, share) result(text)
    real(wp), intent(in) :: elapsed, share
    character(:), allocatable :: text

    text = ''
    if (share > sqrt(tiny(share))) text = ', '//duration_text(elapsed*(1.0_wp - share)/share)//' left'
  end function time_left

  subroutine put_line(self, text, elapsed)
    class(progress_t), intent(inout) :: self
    character(*), intent(in) :: text
    real(wp), intent(in) :: elapsed

    if (self%terminal) then
      call put_error(achar(13)//text//achar(27)//'[K')
      self%next = elapsed + terminal_interval
    else
      call put_error(text//new_line('a'))
      self%next = elapsed + plain_interval
    end if
    self%shown = .true.
  end subroutine put_line

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
