!> The limit cycles of the full model, from its map from release to release (dst_release_map), and whether its motion is regular.
module dst_full_cycles
  use dst_cycle_map, only: cycle_map_t
  use dst_cycles, only: measures, period
  use dst_divergence, only: regular, undecided
  use dst_errors, only: error_t
  use dst_fast_cycle, only: release_angle_t
  use dst_kinds, only: wp, pi
  use dst_release_map, only: release_map_t, new_release_map
  use dst_roots, only: bracket_t
  use dst_scene, only: scene_t
  implicit none
  private

  public :: full_cycle_t, regularity_t, find_full_cycles

  !> Accuracy of the motion. Ten times: the cycle of Fig. 3 changes by 1e-10, relative to it.
  real(wp), parameter :: rtol = 1.0e-11_wp
  !> Number of slow cycles that are followed from the initial state of the scene until two releases agree, and the difference up to
  !> which they agree [rad]. Conventions.
  integer, parameter :: followed = 48
  real(wp), parameter :: same = 1.0e-10_wp
  !> Numbers of releases between which fixed points are searched: if the motion settles, and if it does not. Conventions; twice: no
  !> more cycles of Fig. 3 and k_y = 5e6 N/m, 19 instead of 17 with k_y = 1e6 N/m.
  integer, parameter :: few = 8, many = 256
  integer, parameter :: max_iterations = 40
  !> A jump of the map from one side of the diagonal to the other is not a fixed point: the map misses it by more than this [rad].
  real(wp), parameter :: missed = 1.0e-7_wp
  real(wp), parameter :: fine = 1.0e-13_wp

  !> A cycle: its measures as in dst_cycles, the logarithm of its multiplier, and the release with which it begins. A cycle without
  !> a release is only known as one to which the motion settles.
  type :: full_cycle_t
    real(wp) :: measure(measures) = 0.0_wp
    logical :: has_multiplier = .true.
    real(wp) :: log_multiplier = 0.0_wp
    type(release_angle_t) :: release = release_angle_t()
  end type full_cycle_t

  !> What a motion is like after some time.
  type :: regularity_t
    integer :: slow_cycles = 0
    !> Lyapunov exponent for a slow cycle and its standard error, and the verdict, as in dst_divergence.
    real(wp) :: exponent = 0.0_wp, error = 0.0_wp
    integer :: verdict = undecided
    !> Mean and scatter of the measures of its cycles.
    real(wp) :: mean(measures) = 0.0_wp, scatter(measures) = 0.0_wp
    integer :: cycles = 0
  end type regularity_t

contains

  !> The cycles of a scene under one drive velocity [m/s] that are fixed points of its map.
  subroutine find_full_cycles(scene, velocity, cycles, regularity, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(full_cycle_t), allocatable, intent(out) :: cycles(:)
    type(regularity_t), intent(out) :: regularity
    type(error_t), allocatable, intent(out) :: error
    type(release_map_t) :: map
    type(release_angle_t) :: release(followed)
    integer :: n

    allocate (cycles(0))
    call new_release_map(steady(scene, velocity), map, error)
    if (allocated(error)) return
    call follow(map, release, n, error)
    if (allocated(error)) return
    call judge(map, n, regularity)
    ! Two releases that agree are a cycle to which the motion has settled.
    if (n > 1 .and. n < followed) regularity%verdict = regular
    if (n < 2) then
      call take_what_it_settles_to(regularity, cycles)
      return
    end if
    call find_fixed_points(map, release(:n), cycles, error)
    if (n == followed .or. size(cycles) == 0) return
    ! The cycle to which it settles determines its regularity.
    regularity%exponent = cycles(1)%log_multiplier
    regularity%error = 0.0_wp
  end subroutine find_full_cycles

  !> The scene under a steady drive, as accurate as cycles shall be, for as long as they may take.
  pure function steady(scene, velocity) result(changed)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(scene_t) :: changed
    !> In lengths F_0/k_x of drive displacement, and in periods of the free oscillation. Convention.
    real(wp), parameter :: long = 200.0_wp

    changed = scene
    changed%model = 'full'
    changed%method = 'radau13'
    changed%rtol = rtol
    changed%cycle_map = 'auto'
    changed%drive_time = [0.0_wp]
    changed%drive_velocity = [velocity]
    changed%step_max = 0.0_wp
    changed%settle = 0.0_wp
    changed%t_end = long*(scene%mu_0*scene%normal_load/(scene%stiffness_x*abs(velocity)) &
      + 2.0_wp*pi*sqrt(scene%mass/scene%stiffness_x))
  end function steady

  !> The releases with which the slow cycles begin, until two agree.
  subroutine follow(map, release, n, error)
    type(release_map_t), intent(inout) :: map
    type(release_angle_t), intent(out) :: release(:)
    integer, intent(out) :: n
    type(error_t), allocatable, intent(out) :: error
    type(release_angle_t) :: here
    real(wp) :: log_stretch
    logical :: found, known

    n = 0
    do while (n < size(release))
      call map%come_back(here, log_stretch, known, found, error)
      if (allocated(error) .or. .not. found) return
      n = n + 1
      release(n) = here
      if (n < 4) cycle
      if (abs(here%angle - release(n - 1)%angle) <= same) return
    end do
  end subroutine follow

  !> What the motion so far shows about its regularity.
  subroutine judge(map, n, regularity)
    type(release_map_t), intent(in) :: map
    integer, intent(in) :: n
    type(regularity_t), intent(out) :: regularity
    integer :: count

    regularity%slow_cycles = n
    call map%summary%cycles%means(.false., regularity%cycles, regularity%mean, regularity%scatter)
    select type (motion => map%motion)
    class is (cycle_map_t)
      call motion%divergence%estimate(regularity%exponent, regularity%error, count, regularity%verdict)
    end select
  end subroutine judge

  !> If the motion has no releases: the cycle to which it has settled, if there is one.
  subroutine take_what_it_settles_to(regularity, cycles)
    type(regularity_t), intent(inout) :: regularity
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    !> Scatter over the mean up to which cycles are equal: those that count began in the second half of a long run. Convention.
    real(wp), parameter :: alike = 1.0e-7_wp

    if (regularity%cycles < 2) return
    if (regularity%scatter(period) > alike*regularity%mean(period)) return
    cycles = [full_cycle_t(measure=regularity%mean, has_multiplier=.false.)]
    regularity%verdict = regular
  end subroutine take_what_it_settles_to

  !> Scan the releases around those with which slow cycles begin for fixed points.
  subroutine find_fixed_points(map, release, cycles, error)
    type(release_map_t), intent(inout) :: map
    type(release_angle_t), intent(in) :: release(:)
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: first, last, angle, before_angle, excess, before, side
    logical :: found, has_before, settles
    integer :: i, n, points

    n = size(release)
    side = release(n)%side
    settles = abs(release(n)%angle - release(n - 1)%angle) <= same
    if (settles) call take(release(n)%angle)
    if (allocated(error)) return
    points = merge(few, many, settles)
    ! The first release comes from the beginning of the scene.
    first = minval(release(2:)%angle)
    last = maxval(release(2:)%angle)
    associate (margin => max(0.05_wp*(last - first), 1.0e-3_wp))
      first = first - margin
      last = last + margin
    end associate
    has_before = .false.
    before = 0.0_wp
    before_angle = first
    do i = 0, points
      angle = first + (last - first)*(real(i, wp)/real(points, wp))
      call look(angle, excess, found)
      if (allocated(error)) return
      if (found .and. has_before .and. before*excess < 0.0_wp) call refine(before_angle, before, angle, excess)
      if (allocated(error)) return
      has_before = found
      before = excess
      before_angle = angle
    end do

  contains

    !> The angle by which a slow cycle turns the release with which it begins [rad].
    subroutine look(from, turn, is_known)
      real(wp), intent(in) :: from
      real(wp), intent(out) :: turn
      logical, intent(out) :: is_known
      type(release_angle_t) :: to
      real(wp) :: log_stretch
      logical :: with_growth

      call map%begin(release_angle_t(from, side), with_growth=.false.)
      call map%come_back(to, log_stretch, with_growth, is_known, error)
      turn = 0.0_wp
      if (is_known) turn = to%angle - from
    end subroutine look

    subroutine refine(a, f_a, b, f_b)
      real(wp), intent(in) :: a, f_a, b, f_b
      type(bracket_t) :: bracket
      real(wp) :: x, f
      integer :: iteration
      logical :: is_known

      bracket = bracket_t([a, b], [f_a, f_b])
      do iteration = 1, max_iterations
        x = bracket%false_position()
        if (modulo(iteration, 4) == 0) x = bracket%middle()
        call look(x, f, is_known)
        if (allocated(error) .or. .not. is_known) return
        if (abs(f) <= fine) exit
        call bracket%narrow(x, f)
        if (bracket%width() <= fine) exit
      end do
      if (abs(f) <= missed) call take(x)
    end subroutine refine

    !> The cycle that begins with a release.
    subroutine take(from)
      real(wp), intent(in) :: from
      type(full_cycle_t) :: cycle
      type(release_angle_t) :: to
      real(wp) :: log_stretch
      logical :: is_known, has_growth
      integer :: i

      cycle%release = release_angle_t(from, side)
      if (size(cycles) > 0) then
        if (any(abs(cycles%release%angle - from) <= same)) return
      end if
      call map%begin(cycle%release, with_growth=.true.)
      do i = 1, 3
        call map%come_back(to, log_stretch, has_growth, is_known, error)
        if (allocated(error) .or. .not. is_known) return
        if (i == 1) cycle%has_multiplier = has_growth
        if (i == 1) cycle%log_multiplier = log_stretch
        ! Unstable cycles are left soon.
        if (map%summary%cycles%count > 0) exit
      end do
      if (map%summary%cycles%count == 0) return
      cycle%measure = reshape(map%summary%cycles%last_cycles(1), [measures])
      cycles = [cycles, cycle]
    end subroutine take
  end subroutine find_fixed_points
end module dst_full_cycles
