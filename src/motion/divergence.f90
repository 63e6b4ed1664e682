!> How fast two motions with a small difference separate or converge: the Lyapunov exponent of a map, from the stretching along one
!> orbit.
!>
!> With P the map from release to release, a small difference of the angle grows by P' in each cycle. The exponent for a slow cycle
!> is the mean of the sum of ln|P'| over its cycles, here over the later half of the slow cycles, in which the motion has settled.
!> If it is positive the motion is chaotic: no tolerance determines when its hundredth slip occurs.
module dst_divergence
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: divergence_t, regular, irregular, undecided

  !> Kinds of motion.
  integer, parameter :: regular = 1, undecided = 0, irregular = -1
  !> Smallest number of slow cycles, after how many they are measured, and how many, and number of standard errors by which the exponent has to
  !> differ from 0. Conventions.
  integer, parameter :: least_count = 8, first_measured = 3, measured = 24
  real(wp), parameter :: certain = 3.0_wp
  !> The share of slow cycles that has to be known; otherwise those that are measured count. Convention.
  real(wp), parameter :: nearly_all = 0.99_wp
  !> Number of slow cycles that are kept. Convention.
  integer, parameter :: kept = 1024
  !> Number of batches for the standard error. Convention.
  integer, parameter :: most_batches = 8
  !> Smallest standard error of a few values that are alike: for a motion that repeats itself they are all the same.
  real(wp), parameter :: least_error = 0.01_wp

  !> The stretching along an orbit.
  type :: divergence_t
    !> Number of slow cycles so far, and those of them whose stretching is known: their numbers and their logarithms, the last ones
    !> at places modulo `kept`.
    integer(int64) :: returns = 0
    integer(int64), private :: known_count = 0
    integer(int64), private :: number(kept) = 0
    real(wp), private :: logarithm(kept) = 0.0_wp
  contains
    procedure :: is_wanted
    procedure :: come_back
    procedure :: estimate
  end type divergence_t

contains

  !> Whether the stretching of the present slow cycle has to be measured: that of some, after the beginning. Later it is known where
  !> the passages are known. Convention.
  pure logical function is_wanted(self)
    class(divergence_t), intent(in) :: self

    is_wanted = self%returns >= first_measured .and. self%returns < first_measured + measured
  end function is_wanted

  !> A slow cycle is complete; it stretches a difference by exp(log_stretch), if that is known.
  pure subroutine come_back(self, log_stretch, is_known)
    class(divergence_t), intent(inout) :: self
    real(wp), intent(in) :: log_stretch
    logical, intent(in) :: is_known
    integer :: place

    self%returns = self%returns + 1
    if (.not. is_known) return
    place = int(modulo(self%known_count, int(kept, int64))) + 1
    self%known_count = self%known_count + 1
    self%number(place) = self%returns
    self%logarithm(place) = log_stretch
  end subroutine come_back

  !> The exponent for a slow cycle, its standard error, the number of slow cycles, and the kind of motion. The error is that of the
  !> means of some batches of successive slow cycles, so that it is zero for a motion which repeats itself after several.
  pure subroutine estimate(self, exponent, error, count, verdict)
    class(divergence_t), intent(in) :: self
    real(wp), intent(out) :: exponent, error
    integer, intent(out) :: count, verdict
    real(wp) :: logarithm(kept), batch(most_batches)
    integer :: i, place, batches, late
    logical :: is_complete

    ! Those that are known by chance are no fair selection of all.
    associate (n => int(min(self%known_count, int(kept, int64))))
      late = 0
      do i = 1, n
        place = int(modulo(self%known_count - i, int(kept, int64))) + 1
        if (self%number(place) > self%returns/2) late = i
      end do
      is_complete = real(late, wp) >= nearly_all*real(min(int(kept, int64), self%returns - self%returns/2), wp)
      count = 0
      do i = 1, n
        place = int(modulo(self%known_count - i, int(kept, int64))) + 1
        if (is_complete) then
          if (self%number(place) <= self%returns/2 .and. count >= least_count) exit
        else if (self%number(place) <= first_measured .or. self%number(place) > first_measured + measured) then
          cycle
        end if
        count = count + 1
        logarithm(count) = self%logarithm(place)
      end do
    end associate
    exponent = 0.0_wp
    error = huge(error)
    verdict = undecided
    if (count < least_count) return
    exponent = sum(logarithm(:count))/real(count, wp)
    batches = min(most_batches, count)
    do i = 1, batches
      associate (first => ((i - 1)*count)/batches + 1, last => (i*count)/batches)
        batch(i) = sum(logarithm(first:last))/real(last - first + 1, wp)
      end associate
    end do
    error = sqrt(sum((batch(:batches) - exponent)**2)/real((batches - 1)*batches, wp))
    if (abs(exponent) <= certain*max(least_error, error)) return
    verdict = merge(irregular, regular, exponent > 0.0_wp)
  end subroutine estimate
end module dst_divergence
