!> How fast two motions with a small difference separate or converge: the Lyapunov exponent of a map, from the stretching along one
!> orbit.
!>
!> With P the map from release to release, a small difference of the angle grows by P' in each cycle. The exponent for a slow cycle
!> is the mean of the sum of ln|P'| over its cycles, here over the later half of the slow cycles, in which the motion has settled.
!> If it is positive the motion is chaotic: no tolerance determines when its hundredth slip occurs.
module dst_divergence
  use dst_archive, only: archive_t
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: divergence_t, regular, irregular, undecided

  !> Kinds of motion.
  integer, parameter :: regular = 1, undecided = 0, irregular = -1
  !> Smallest number of slow cycles, and number of standard errors by which the exponent has to differ from 0. Conventions.
  integer, parameter :: least_count = 3
  real(wp), parameter :: certain = 3.0_wp
  !> Number of slow cycles that are kept, and of those that are measured one by one: of the next ones, as many again, every second
  !> group is measured, and so on, so that a long run costs little more. Conventions.
  integer, parameter :: kept = 128
  integer(int64), parameter :: one_by_one = 64
  !> Number of slow cycles before the first that is measured: the beginning of the motion matters in a short run only. Convention;
  !> none: half as much work again for Fig. 3, the same exponent.
  integer(int64), parameter :: first_measured = 3
  !> Number of batches for the standard error. Convention.
  integer, parameter :: most_batches = 8
  !> Smallest standard error of a few values that are alike: for a motion that repeats itself they are all the same.
  real(wp), parameter :: least_error = 0.01_wp

  !> The stretching along an orbit.
  type :: divergence_t
    !> Number of slow cycles so far, and those of them that are measured: their numbers and their logarithms, the last ones at
    !> places modulo `kept`.
    integer(int64) :: returns = 0
    integer(int64), private :: known_count = 0, number(kept) = 0
    real(wp), private :: logarithm(kept) = 0.0_wp
    !> The logarithm since the last return, and whether it is known.
    real(wp), private :: sum = 0.0_wp
    logical, private :: known = .false.
  contains
    procedure :: is_worth_measuring
    procedure :: pass
    procedure :: lose
    procedure :: come_back
    procedure :: estimate
    procedure :: serialise
  end type divergence_t

contains

  !> Whether the present slow cycle is one of those that are measured.
  pure logical function is_worth_measuring(self)
    class(divergence_t), intent(in) :: self
    integer(int64) :: stride
    !> Slow cycles are measured in groups, so that a motion which repeats after a few has all its phases in a group. Convention.
    integer(int64), parameter :: group = 8

    stride = 1
    do while (self%returns > one_by_one*stride)
      stride = 2*stride
    end do
    is_worth_measuring = self%known .and. self%returns >= first_measured .and. modulo(self%returns/group, stride) == 0
  end function is_worth_measuring

  !> Continue by a part of a slow cycle that stretches a difference by exp(log_stretch).
  pure subroutine pass(self, log_stretch)
    class(divergence_t), intent(inout) :: self
    real(wp), intent(in) :: log_stretch

    self%sum = self%sum + log_stretch
  end subroutine pass

  !> The stretching in the present slow cycle is not known.
  pure subroutine lose(self)
    class(divergence_t), intent(inout) :: self

    self%known = .false.
  end subroutine lose

  !> A slow cycle is complete.
  pure subroutine come_back(self)
    class(divergence_t), intent(inout) :: self
    integer :: place

    self%returns = self%returns + 1
    if (self%known) then
      place = int(modulo(self%known_count, int(kept, int64))) + 1
      self%known_count = self%known_count + 1
      self%number(place) = self%returns
      self%logarithm(place) = self%sum
    end if
    self%sum = 0.0_wp
    self%known = .true.
  end subroutine come_back

  !> The exponent for a slow cycle, its standard error, the number of slow cycles, and the kind of motion. The error is that of the
  !> means of some batches of successive slow cycles, so that it is zero for a motion which repeats itself after several.
  pure subroutine estimate(self, exponent, error, count, verdict)
    class(divergence_t), intent(in) :: self
    real(wp), intent(out) :: exponent, error
    integer, intent(out) :: count, verdict
    real(wp) :: logarithm(kept), batch(most_batches)
    integer :: i, place, batches

    count = 0
    do i = 1, int(min(self%known_count, int(kept, int64)))
      place = int(modulo(self%known_count - i, int(kept, int64))) + 1
      if (self%number(place) <= self%returns/2) exit
      count = i
      logarithm(i) = self%logarithm(place)
    end do
    exponent = 0.0_wp
    error = huge(error)
    verdict = undecided
    if (count < 2) return
    exponent = sum(logarithm(:count))/real(count, wp)
    batches = min(most_batches, count)
    do i = 1, batches
      associate (first => ((i - 1)*count)/batches + 1, last => (i*count)/batches)
        batch(i) = sum(logarithm(first:last))/real(last - first + 1, wp)
      end associate
    end do
    error = sqrt(sum((batch(:batches) - exponent)**2)/real((batches - 1)*batches, wp))
    if (count < least_count .or. abs(exponent) <= certain*max(least_error, error)) return
    verdict = merge(irregular, regular, exponent > 0.0_wp)
  end subroutine estimate

  !> Save or load.
  subroutine serialise(self, archive)
    class(divergence_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer :: i

    call archive%serialise(self%returns)
    call archive%serialise(self%known_count)
    do i = 1, int(max(0_int64, min(self%known_count, int(kept, int64))))
      call archive%serialise(self%number(i))
      call archive%serialise(self%logarithm(i))
    end do
    call archive%serialise(self%sum)
    call archive%serialise(self%known)
  end subroutine serialise
end module dst_divergence
