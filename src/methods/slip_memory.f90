!> The last slips, step by step: they give a first guess for the next one.
!>
!> During creep each slip hardly differs from the one before, and the differences hardly change. With the slip unknowns A(t) of the
!> last slip and B(t) of the one before, where t is the time since the release, the guess for a step from t_0 is
!>
!>     y(t) = y_0 + 2 (A(t) - A(t_0)) - (B(t) - B(t_0)).
module dst_slip_memory
  use dst_interpolation, only: grid_t, max_degree
  use dst_kinds, only: wp
  use dst_slip_system, only: max_unknowns
  implicit none
  private

  public :: slip_memory_t

  !> Number of steps of a slip that are kept; of a longer slip only these are kept. Convention; half: no change on Fig. 3.
  integer, parameter :: max_steps = 32
  !> Two slips are alike if their changes over a step differ by less than this share. Convention. Twice and half: at most 0.2 %
  !> fewer iterations on Fig. 3.
  real(wp), parameter :: alike = 0.2_wp
  !> Distance beyond its end, relative to its length, up to which a step gives a guess. Convention; twice: 0.1 % fewer iterations.
  real(wp), parameter :: farthest = 1.5_wp

  !> The steps of one slip.
  type :: slip_t
    integer :: steps = 0
    real(wp) :: begin(max_steps) = 0.0_wp, length(max_steps) = 0.0_wp  !! since the release, s
    real(wp) :: nodal(0:max_degree, max_unknowns, max_steps) = 0.0_wp
  contains
    procedure :: values_at
  end type slip_t

  !> The present slip and the two before.
  type :: slip_memory_t
    type(slip_t), private :: slip(0:2)
    !> Which of them is the present one; the last one has the next number, modulo 3.
    integer, private :: present_one = 0
    logical, private :: follows = .false.
    real(wp), private :: elapsed = 0.0_wp
  contains
    procedure :: begin
    procedure :: forget
    procedure :: keep
    procedure :: guess
  end type slip_memory_t

contains

  !> A slip begins with a release.
  pure subroutine begin(self)
    class(slip_memory_t), intent(inout) :: self

    if (self%slip(self%present_one)%steps > 0) self%present_one = modulo(self%present_one - 1, 3)
    self%slip(self%present_one)%steps = 0
    self%follows = .true.
    self%elapsed = 0.0_wp
  end subroutine begin

  !> The motion that follows is not a slip from a release.
  pure subroutine forget(self)
    class(slip_memory_t), intent(inout) :: self

    self%follows = .false.
  end subroutine forget

  !> Keep an accepted step with the slip unknowns at its nodes.
  pure subroutine keep(self, step, nodal)
    class(slip_memory_t), intent(inout) :: self
    real(wp), intent(in) :: step                                  !! s
    real(wp), intent(in) :: nodal(0:max_degree, max_unknowns)

    if (.not. self%follows) return
    associate (slip => self%slip(self%present_one))
      if (slip%steps < max_steps) then
        slip%steps = slip%steps + 1
        slip%begin(slip%steps) = self%elapsed
        slip%length(slip%steps) = step
        slip%nodal(:, :, slip%steps) = nodal
      end if
    end associate
    self%elapsed = self%elapsed + step
  end subroutine keep

  !> Expected slip unknowns y(s, m) at the nodes 1 ... s of a step [s] from `start`(m); `known` if the last two slips are alike.
  pure subroutine guess(self, grid, s, m, step, start, y, known)
    class(slip_memory_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    integer, intent(in) :: s, m
    real(wp), intent(in) :: step, start(m)
    real(wp), intent(out) :: y(s, m)
    logical, intent(out) :: known
    real(wp), dimension(0:s, m) :: last, before
    integer :: k

    known = self%follows
    if (known) call self%slip(modulo(self%present_one + 1, 3))%values_at(grid, s, m, self%elapsed, step, last, known)
    if (known) call self%slip(modulo(self%present_one + 2, 3))%values_at(grid, s, m, self%elapsed, step, before, known)
    if (.not. known) return
    do k = 1, m
      known = known .and. maxval(abs(last(1:s, k) - last(0, k) - (before(1:s, k) - before(0, k)))) &
        <= alike*maxval(abs(last(1:s, k) - last(0, k)))
      y(:, k) = start(k) + 2.0_wp*(last(1:s, k) - last(0, k)) - (before(1:s, k) - before(0, k))
    end do
  end subroutine guess

  !> The slip unknowns at the nodes 0 ... s of a step that begins `elapsed` [s] after the release; not `known` if the slip ended
  !> long before.
  pure subroutine values_at(self, grid, s, m, elapsed, step, y, known)
    class(slip_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    integer, intent(in) :: s, m
    real(wp), intent(in) :: elapsed, step
    real(wp), intent(out) :: y(0:s, m)
    logical, intent(out) :: known
    real(wp) :: time(0:s)
    integer :: first, next, j, k

    known = self%steps > 0
    if (.not. known) return
    known = elapsed + step <= self%begin(self%steps) + farthest*self%length(self%steps)
    if (.not. known) return
    time = elapsed + grid%node(0:s)*step
    first = 0
    do j = 1, self%steps
      next = s + 1
      if (j < self%steps) next = first + count(time(first:) <= self%begin(j + 1))
      if (next == first) cycle
      do k = 1, m
        call grid%values_at(self%nodal(:, k, j), next - first, (time(first:next - 1) - self%begin(j))/self%length(j), &
          y(first:next - 1, k))
      end do
      first = next
      if (first > s) exit
    end do
  end subroutine values_at
end module dst_slip_memory
