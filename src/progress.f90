!> How far a run has come, on the terminal: one line that updates, or a plain line every 10 s.
module dst_progress
  use, intrinsic :: iso_fortran_env, only: error_unit
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_kinds, only: wp
  use dst_text, only: printable
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
    procedure, private :: put_line
    procedure :: remark
    procedure :: close
  end type progress_t

  interface
    integer(c_int) function isatty(descriptor) bind(c)
      import :: c_int
      integer(c_int), value :: descriptor
    end function isatty
  end interface

contains

  !> The progress of what `label` names.
  function new_progress(label, quiet) result(progress)
    character(*), intent(in) :: label
    logical, intent(in) :: quiet
    type(progress_t) :: progress

    progress%label = printable(label)
    progress%quiet = quiet
    progress%terminal = isatty(2_c_int) == 1
    progress%next = merge(terminal_interval, plain_interval, progress%terminal)
  end function new_progress

  !> Report that `done` of `total` [s] of `what` took `elapsed` wall time [s], if it is time to.
  subroutine show(self, what, done, total, elapsed)
    class(progress_t), intent(inout) :: self
    character(*), intent(in) :: what
    real(wp), intent(in) :: done, total, elapsed
    character(200) :: text
    real(wp) :: share

    if (self%quiet .or. elapsed < self%next) return
    share = done/total
    write (text, '(a,f6.1,a,es10.3,a,es10.3,a,f0.1,a)') self%label//':', 100.0_wp*share, ' %, '//what//' =', done, ' of', &
      total, ' s, ', elapsed*(1.0_wp - share)/max(share, epsilon(share)), ' s left'
    call self%put_line(trim(text), elapsed)
  end subroutine show

  !> Report that, besides `before` cases, `done` of `to_do` took `elapsed` wall time [s], if it is time to; `failed` of all.
  subroutine show_cases(self, before, done, to_do, failed, elapsed)
    class(progress_t), intent(inout) :: self
    integer, intent(in) :: before, done, to_do, failed
    real(wp), intent(in) :: elapsed
    character(200) :: text
    character(40) :: pace

    if (self%quiet .or. elapsed < self%next) return
    pace = ''
    if (done > 0) write (pace, '(a, g0.3, a, i0, a)') ', ', real(done, wp)/elapsed, ' cases/s, ', &
      ceiling(elapsed*real(to_do - done, wp)/real(done, wp)), ' s left'
    write (text, '(a, i0, a, i0, a, i0, 2a)') self%label//': ', before + done, ' of ', before + to_do, ' cases, ', failed, &
      ' failed', trim(pace)
    call self%put_line(trim(text), elapsed)
  end subroutine show_cases

  subroutine put_line(self, text, elapsed)
    class(progress_t), intent(inout) :: self
    character(*), intent(in) :: text
    real(wp), intent(in) :: elapsed

    if (self%terminal) then
      write (error_unit, '(a)', advance='no') achar(13)//text//achar(27)//'[K'
      flush (error_unit)
      self%next = elapsed + terminal_interval
    else
      write (error_unit, '(a)') text
      self%next = elapsed + plain_interval
    end if
    self%shown = .true.
  end subroutine put_line

  !> One line that stays.
  subroutine remark(self, text)
    class(progress_t), intent(in) :: self
    character(*), intent(in) :: text

    if (.not. self%quiet) write (error_unit, '(a)') self%label//': '//text
  end subroutine remark

  !> Wipe the line on a terminal.
  subroutine close(self)
    class(progress_t), intent(inout) :: self

    if (self%shown .and. self%terminal) write (error_unit, '(a)', advance='no') achar(13)//achar(27)//'[K'
  end subroutine close
end module dst_progress
