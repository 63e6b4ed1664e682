!> Passages that were run once and need not be run again: polynomials between those that are near each other.
!>
!> A passage gives its end and how that changes with its beginning, so that a few of them, wherever they are, are Hermite's data.
!> What the last one adds to the polynomial through the others is its error. Between a lap and a slip sticks end, and nothing is
!> known.
module dst_remembered
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, turn
  implicit none
  private

  public :: remembered_t

  !> So many passages are kept, no nearer to each other than this [rad], and so many are used at once. Conventions; twice each: no
  !> change.
  integer, parameter :: most = 256, most_used = 6
  real(wp), parameter :: apart = 1.0e-5_wp

  !> Passages by increasing angle.
  type :: remembered_t
    type(passage_t), allocatable, private :: passage(:)
  contains
    procedure :: keep
    procedure :: recall
  end type remembered_t

contains

  !> Keep a passage that was run.
  pure subroutine keep(self, passage)
    class(remembered_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    integer :: place

    if (.not. allocated(self%passage)) allocate (self%passage(0))
    if (.not. passage%has_slope .or. size(self%passage) == most) return
    if (any(abs(self%passage%from - passage%from) < apart)) return
    place = count(self%passage%from < passage%from)
    self%passage = [self%passage(:place), passage, self%passage(place + 1:)]
  end subroutine keep

  !> The passage from `alpha` [rad] with an end that is in error by about this [rad] at most, but with the times and works of
  !> another one. It lies between passages of its kind or hardly beside one, or below the angle `end` [rad] up to which all are
  !> slips.
  subroutine recall(self, alpha, error, end, passage, found)
    class(remembered_t), intent(in) :: self
    real(wp), intent(in) :: alpha, error, end
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    real(wp), dimension(2*most_used) :: node, difference
    real(wp) :: angle, rate, added
    real(wp) :: factor(2)           !! product of the distances from the nodes so far, and its derivative
    integer :: low, high, used, next
    logical :: is_slip

    found = .false.
    if (.not. allocated(self%passage)) return
    low = count(self%passage%from < alpha + apart)
    high = low + 1
    if (low == 0) return
    is_slip = self%passage(low)%turns_back()
    if (.not. (is_slip .and. alpha < end .or. is_like(high))) return
    angle = 0.0_wp
    rate = 0.0_wp
    factor = [1.0_wp, 0.0_wp]
    do used = 1, most_used
      if (is_like(low) .and. is_like(high)) then
        next = merge(low, high, alpha - self%passage(low)%from <= self%passage(high)%from - alpha)
      else if (is_like(low) .or. is_like(high)) then
        next = merge(low, high, is_like(low))
      else
        return
      end if
      if (used == 1) passage = self%passage(next)
      added = 0.0_wp
      call add(2*used - 1, self%passage(next))
      call add(2*used, self%passage(next))
      if (next == low) low = low - 1
      if (next == high) high = high + 1
      found = used > 1 .and. added <= error
      if (found) exit
    end do
    passage%from = alpha
    passage%steps = 0
    passage%measure(turn) = angle
    passage%to = alpha + angle
    call passage%take_slope(1.0_wp + rate, passage%shift)

  contains

    !> Whether there is such a passage, of the kind of the one just below.
    pure logical function is_like(place)
      integer, intent(in) :: place

      is_like = place >= 1 .and. place <= size(self%passage)
      if (is_like) is_like = self%passage(place)%turns_back() .eqv. is_slip
    end function is_like

    !> The n-th term of Newton's polynomial, with each node twice.
    subroutine add(n, at)
      integer, intent(in) :: n
      type(passage_t), intent(in) :: at
      real(wp) :: new, last
      integer :: k

      node(n) = at%from
      new = at%measure(turn)
      do k = 1, n - 1
        last = new
        if (modulo(n, 2) == 0 .and. k == 1) then
          new = at%slope - 1.0_wp
        else
          new = (new - difference(k))/(node(n) - node(n - k))
        end if
        difference(k) = last
      end do
      difference(n) = new
      angle = angle + new*factor(1)
      rate = rate + new*factor(2)
      added = added + abs(new*factor(1))
      factor = [factor(1)*(alpha - node(n)), factor(2)*(alpha - node(n)) + factor(1)]
    end subroutine add
  end subroutine recall
end module dst_remembered
