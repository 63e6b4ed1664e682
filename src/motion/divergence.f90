!> How fast two motions with a small difference separate or converge: the Lyapunov exponent of a map, from the stretching along one
!> orbit.
!>
!> With P the map from release to release, a small difference of the angle grows by P' in each passage. The exponent for a slow
!> cycle is the mean of the sum of ln|P'| over its passages, here over the later half of the slow cycles, in which the motion has
!> settled. If it is positive the motion is chaotic: no tolerance determines when its hundredth slip occurs.
module dst_divergence
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_is_nan
  use dst_kinds, only: wp, int64
  use dst_passage, only: passage_t, loss_t
  implicit none
  private

  public :: divergence_t, judge, regular, irregular, undecided, steady_sliding, ringing_down

  !> Kinds of motion: it repeats, or small differences shrink; it is not known; they grow; it slides steadily; its cycles die out.
  integer, parameter :: regular = 1, undecided = 0, irregular = -1, steady_sliding = 2, ringing_down = 3
  !> Smallest number of slow cycles, and number of standard errors by which the exponent has to differ from 0. Conventions; twice
  !> each: no change.
  integer, parameter :: least_count = 8
  real(wp), parameter :: certain = 3.0_wp
  !> Number of slow cycles that are kept, and of batches for the standard error. Conventions; twice the first: no change; the
  !> second: the error by as much as it is uncertain.
  integer, parameter :: kept = 1024, most_batches = 8
  !> Smallest standard error of a few values that are alike: for a motion that repeats itself they are all the same.
  real(wp), parameter :: least_error = 0.01_wp

  !> The stretching along an orbit.
  type :: divergence_t
    !> Number of slow cycles so far, and the logarithms of the last ones, at places modulo `kept`, NaN if they are not known.
    integer :: count = 0
    real(wp), private :: logarithm(0:kept - 1) = 0.0_wp
    !> What was lost since the beginning, and whether it is known.
    type(loss_t), private :: lost = loss_t()
    logical, private :: knows_loss = .true.
  contains
    procedure :: lose
    procedure :: conditioning
    procedure :: come_back
    procedure :: come_back_like
    procedure :: mean_of
    procedure :: estimate
  end type divergence_t

contains

  !> A slow cycle is complete; it stretches a difference by exp(log_stretch), if that is known.
  pure subroutine come_back(self, log_stretch, is_known)
    class(divergence_t), intent(inout) :: self
    real(wp), intent(in) :: log_stretch
    logical, intent(in) :: is_known

    self%count = self%count + 1
    self%logarithm(modulo(self%count, kept)) = log_stretch
    if (.not. is_known) self%logarithm(modulo(self%count, kept)) = ieee_value(log_stretch, ieee_quiet_nan)
  end subroutine come_back

  !> A slow cycle is complete that is the same as so many before.
  pure subroutine come_back_like(self, ago)
    class(divergence_t), intent(inout) :: self
    integer, intent(in) :: ago

    self%count = self%count + 1
    self%logarithm(modulo(self%count, kept)) = self%logarithm(modulo(self%count - ago, kept))
  end subroutine come_back_like

  !> So many times these passages are complete.
  pure subroutine lose(self, whole, times)
    class(divergence_t), intent(inout) :: self
    type(passage_t), intent(in) :: whole
    integer(int64), intent(in) :: times

    call self%lost%go_on(whole%loss%repeated(times))
    self%knows_loss = self%knows_loss .and. whole%has_slope
  end subroutine lose

  !> The conditioning of the motion: if every passage has a small relative error, that of the time at the end is so many times as
  !> large at most. NaN if it is not known.
  pure real(wp) function conditioning(self)
    class(divergence_t), intent(in) :: self

    conditioning = ieee_value(conditioning, ieee_quiet_nan)
    if (self%knows_loss .and. self%lost%lasted > 0.0_wp) conditioning = self%lost%time/self%lost%lasted
  end function conditioning

  !> The last logarithms, in their order.
  pure function latest(self, many) result(logarithm)
    class(divergence_t), intent(in) :: self
    integer, intent(in) :: many
    real(wp) :: logarithm(many)
    integer :: i

    logarithm = [(self%logarithm(modulo(self%count - many + i, kept)), i=1, many)]
  end function latest

  !> The exponent of a motion that repeats after so many slow cycles; NaN if it is not known.
  pure real(wp) function mean_of(self, last) result(exponent)
    class(divergence_t), intent(in) :: self
    integer, intent(in) :: last

    exponent = ieee_value(exponent, ieee_quiet_nan)
    if (self%count >= last) exponent = sum(latest(self, last))/real(last, wp)
  end function mean_of

  !> The exponent for a slow cycle, its standard error, and the kind of motion, from the later half.
  pure subroutine estimate(self, exponent, error, verdict)
    class(divergence_t), intent(in) :: self
    real(wp), intent(out) :: exponent, error
    integer, intent(out) :: verdict

    associate (late => latest(self, min(kept, max(self%count - self%count/2, min(self%count, least_count)))))
      call judge(pack(late, .not. ieee_is_nan(late)), exponent, error, verdict)
    end associate
  end subroutine estimate

  !> The exponent from the growth in successive slow cycles, its standard error, and the kind of motion. The error is that of the
  !> means of some batches, so that it is zero for a motion which repeats itself after several. Of too few both are NaN.
  pure subroutine judge(logarithm, exponent, error, verdict)
    real(wp), intent(in) :: logarithm(:)
    real(wp), intent(out) :: exponent, error
    integer, intent(out) :: verdict
    real(wp) :: batch(most_batches)
    integer :: i

    exponent = ieee_value(exponent, ieee_quiet_nan)
    error = exponent
    verdict = undecided
    associate (n => size(logarithm))
      if (n < least_count) return
      do i = 1, most_batches
        associate (first => ((i - 1)*n)/most_batches + 1, last => (i*n)/most_batches)
          batch(i) = sum(logarithm(first:last))/real(last - first + 1, wp)
        end associate
      end do
      exponent = sum(logarithm)/real(n, wp)
    end associate
    error = sqrt(sum((batch - exponent)**2)/real((most_batches - 1)*most_batches, wp))
    if (abs(exponent) > certain*max(least_error, error)) verdict = merge(irregular, regular, exponent > 0.0_wp)
  end subroutine judge
end module dst_divergence
