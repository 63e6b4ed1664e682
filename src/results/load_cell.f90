!> What a load cell on the drive shows: the largest and the smallest pull force, and how often it rises and falls.
!>
!> The pull force is that of springs and dampers on the object along the drive (the column `pull_force`), positive if the drive
!> pulls. Its extremes are those of the second half of a run, or of the last cycle of a run that ends because it has settled, as the
!> `swing` of the load. Unlike the load k_x u_x it contains the stiff spring, and with it the fast oscillation.
!>
!> Its frequency is that of its largest movement: of rises and falls by more than half of the whole swing. So stick-slip is counted
!> where it is the larger movement, and the fast oscillation where that is.
module dst_load_cell
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp, int64
  use dst_piece_view, only: piece_view_t, most_pull_turns
  implicit none
  private

  public :: load_cell_t, cell_state_t

  !> A movement counts if it is larger than this share of the swing so far; what was counted before the swing grew by this factor is
  !> forgotten. Conventions.
  real(wp), parameter :: counted = 0.5_wp, grown = 1.5_wp
  !> Movements that are surely not counted are smaller than this share. Convention.
  real(wp), parameter :: small = 0.25_wp

  !> The movement of the force in a part of the run. Plain data.
  type :: movement_t
    real(wp) :: highest = -huge(1.0_wp), lowest = huge(1.0_wp)   !! N
    !> The swing when the force first turned since counting began, or up to now [N], and whether it has turned; whether the force
    !> rises (1) or falls (-1), 0 as long as it has not moved, and its last extreme: force [N] and time [s].
    real(wp), private :: swing = 0.0_wp
    logical, private :: has_turned = .false.
    integer, private :: heading = 0
    real(wp), private :: extreme = 0.0_wp, since = 0.0_wp
    !> Peaks so far, the times of the first and the last one [s], and the force at the last one [N].
    integer(int64), private :: peaks = 0
    real(wp), private :: first = 0.0_wp, last = 0.0_wp, top = 0.0_wp
  contains
    procedure :: go_to
    procedure :: frequency
  end type movement_t

  !> The movement since `from` [s], or, if the run may settle, since the last peak of the load but one, and since the last peak.
  type :: cell_state_t
    real(wp) :: from = 0.0_wp
    logical, private :: may_settle = .false.
    !> The direction in which the drive first moves.
    real(wp), private :: side = 1.0_wp
    type(movement_t) :: movement = movement_t()
    type(movement_t), private :: recent = movement_t()
  end type cell_state_t

  !> The load cell.
  type, extends(cell_state_t) :: load_cell_t
    !> On request: all forces that it saw [N], and when [s].
    logical :: keeps_forces = .false.
    real(wp), allocatable, private :: force(:), time(:)    !! valid up to count
    integer, private :: count = 0
  contains
    procedure :: begin
    procedure :: take_in
    procedure :: begin_cycle
    procedure :: see
    procedure :: may_hang_on
    procedure :: see_again
  end type load_cell_t

contains

  !> Begin a run of this length [s] under a drive that first moves with a velocity of this sign, if it does.
  pure subroutine begin(self, velocity, t_end, may_settle)
    class(load_cell_t), intent(inout) :: self
    real(wp), intent(in) :: velocity, t_end
    logical, intent(in) :: may_settle

    self%side = sign(1.0_wp, velocity)
    self%may_settle = may_settle
    self%from = merge(0.0_wp, 0.5_wp*t_end, may_settle)
  end subroutine begin

  !> There was a peak of the load.
  pure subroutine begin_cycle(self)
    class(load_cell_t), intent(inout) :: self

    if (.not. self%may_settle) return
    self%movement = self%recent
    self%recent = movement_t()
  end subroutine begin_cycle

  !> Process a piece of the motion.
  subroutine take_in(self, view)
    class(load_cell_t), intent(inout) :: self
    type(piece_view_t), intent(in) :: view
    real(wp) :: places(most_pull_turns), coefficient(0:max_degree), from
    integer :: count, degree, i

    if (view%last%time < self%from) return
    from = 0.0_wp
    if (view%first%time < self%from) from = (self%from - view%first%time)/view%duration()
    call see_at(from)
    call view%pull_polynomial(degree, coefficient)
    call view%pull_turns(degree, coefficient, places, count)
    do i = 1, count
      if (places(i) > from) call see_at(places(i))
    end do
    call see_at(1.0_wp)

  contains

    subroutine see_at(place)
      real(wp), intent(in) :: place

      call self%see(view%pull_at(place), view%first%time + place*view%duration())
    end subroutine see_at
  end subroutine take_in

  !> The pull force [N] along X at an instant [s].
  subroutine see(self, force, time)
    class(load_cell_t), intent(inout) :: self
    real(wp), intent(in) :: force, time

    call self%movement%go_to(self%side*force, time)
    if (self%may_settle) call self%recent%go_to(self%side*force, time)
    if (self%keeps_forces) call keep(self, force, time)
  end subroutine see

  subroutine keep(self, force, time)
    class(load_cell_t), intent(inout) :: self
    real(wp), intent(in) :: force, time

    if (.not. allocated(self%force)) allocate (self%force(64), self%time(64))
    if (self%count == size(self%force)) then
      self%force = [self%force, self%force]
      self%time = [self%time, self%time]
    end if
    self%count = self%count + 1
    self%force(self%count) = force
    self%time(self%count) = time
  end subroutine keep

  !> Whether the extremes of the run or its peaks may hang on a passage of which is only known that its pull force is between these
  !> two along X [N], and turns back by no more than `ripple` [N] but for its largest fall.
  pure logical function may_hang_on(self, forces, ripple)
    class(load_cell_t), intent(in) :: self
    real(wp), intent(in) :: forces(2), ripple

    associate (seen => self%side*forces, movement => self%movement)
      may_hang_on = maxval(seen) > movement%highest .or. minval(seen) < movement%lowest
      if (.not. may_hang_on) may_hang_on = ripple > small*(movement%highest - movement%lowest)
    end associate
  end function may_hang_on

  !> See what another one has kept so many times again, each of this duration [s], the first one from a time [s] on.
  subroutine see_again(self, other, time, times, duration)
    class(load_cell_t), intent(inout) :: self
    type(load_cell_t), intent(in) :: other
    real(wp), intent(in) :: time, duration
    integer(int64), intent(in) :: times
    type(movement_t) :: before
    integer :: i, k

    ! From the second on all are alike.
    do i = 1, int(min(times, 2_int64))
      before = self%movement
      do k = 1, other%count
        call self%see(other%force(k), time + real(i - 1, wp)*duration + other%time(k))
      end do
    end do
    associate (now => self%movement, more => max(0_int64, times - 2))
      now%peaks = now%peaks + more*(now%peaks - before%peaks)
      now%last = now%last + real(more, wp)*duration
      now%since = now%since + real(more, wp)*duration
    end associate
  end subroutine see_again

  !> The force, positive if the drive pulls, is this [N] at an instant [s].
  pure subroutine go_to(self, force, time)
    class(movement_t), intent(inout) :: self
    real(wp), intent(in) :: force, time
    real(wp) :: ahead

    if (force > self%highest .or. force < self%lowest) then
      self%highest = max(self%highest, force)
      self%lowest = min(self%lowest, force)
      if (self%has_turned .and. self%highest - self%lowest > grown*self%swing .or. self%heading == 0) then
        self%swing = self%highest - self%lowest
        self%has_turned = .false.
        if (self%heading > 0) call take_peak(self)
        self%peaks = merge(1, 0, self%heading /= 0 .and. force < self%highest .and. self%top - force > counted*self%swing)
        self%first = self%last
        self%heading = merge(1, -1, force >= self%highest)
        if (.not. self%swing > 0.0_wp) self%heading = 0
        self%extreme = force
        self%since = time
        return
      end if
      if (.not. self%has_turned) self%swing = self%highest - self%lowest
    end if
    ahead = real(self%heading, wp)*(force - self%extreme)
    if (ahead < 0.0_wp) then
      if (-ahead <= counted*(self%highest - self%lowest)) return
      if (self%heading > 0) call take_peak(self)
      self%heading = -self%heading
      self%has_turned = .true.
    end if
    self%extreme = force
    self%since = time
  end subroutine go_to

  !> The last extreme was a peak.
  pure subroutine take_peak(self)
    type(movement_t), intent(inout) :: self

    if (self%peaks == 0) self%first = self%since
    self%peaks = self%peaks + 1
    self%last = self%since
    self%top = self%extreme
  end subroutine take_peak

  !> Peaks per time [Hz]; negative if there are fewer than two.
  pure real(wp) function frequency(self)
    class(movement_t), intent(in) :: self

    frequency = -1.0_wp
    if (self%peaks > 1 .and. self%last > self%first) frequency = real(self%peaks - 1, wp)/(self%last - self%first)
  end function frequency
end module dst_load_cell
