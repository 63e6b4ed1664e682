!> The limit cycles of the full model, and what its motion comes to, from its map from release to release (dst_release_map).
!>
!> A slow cycle ends with the passage that turns the force back. Where the release with which it ends agrees with that of the m-th
!> slow cycle before, the motion repeats after m slow cycles; unstable cycles are zeros of the map of one slow cycle minus identity,
!> found in the same way as stable ones: because of rest the motion need not be followed backwards.
module dst_full_cycles
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use dst_assembly, only: new_motion
  use dst_cycle_map, only: cycle_map_t
  use dst_cycles, only: extremum_t, measures, period, peak, valley, threshold
  use dst_divergence, only: judge, regular, irregular, undecided
  use dst_errors, only: error_t
  use dst_kinds, only: wp, pi
  use dst_motion, only: motion_t, next_piece
  use dst_motion_summary, only: motion_summary_t
  use dst_piece, only: piece_t
  use dst_piece_view, only: piece_view_t
  use dst_passage, only: passage_t, duration
  use dst_release_map, only: release_map_t, new_release_map
  use dst_roots, only: bracket_t
  use dst_scene, only: scene_t
  use dst_state, only: state_t
  use dst_summary, only: summary_t, contribution_t
  implicit none
  private

  public :: full_cycle_t, regularity_t, find_full_cycles, steady_sliding
  public :: settle, map_of, steady, extremes_of, measures_of, share_out

  !> Accuracy of the motion. Ten times: the cycle of Fig. 3 changes by 1e-10, relative to it.
  real(wp), parameter :: rtol = 1.0e-11_wp
  !> Two releases are the same if their angles differ by no more than this [rad]. Convention.
  real(wp), parameter :: same = 1.0e-10_wp
  !> A motion repeats after so many slow cycles at most. It is followed for so many. Conventions.
  integer, parameter :: most_repeats = 8, followed = 400
  !> Numbers of releases between which fixed points are searched: if the motion settles, and if it does not. Conventions; twice: no
  !> more cycles of Fig. 3 and k_y = 5e6 N/m, 19 instead of 17 with k_y = 1e6 N/m.
  integer, parameter :: few = 8, many = 256
  integer, parameter :: max_iterations = 40
  !> Two cycles are the same if their releases differ by no more than this [rad]. Convention.
  real(wp), parameter :: alike = 1.0e-6_wp
  !> A jump of the map from one side of the diagonal to the other is not a fixed point: the map misses it by more than this [rad].
  real(wp), parameter :: missed = 1.0e-7_wp
  real(wp), parameter :: fine = 1.0e-13_wp
  !> A further verdict, beside those of dst_divergence.
  integer, parameter :: steady_sliding = 2

  !> A cycle: its measures as in dst_cycles, the logarithm of its multiplier, the slow cycles after which it repeats (0: it is the
  !> fast oscillation alone), and the release with which it begins. A cycle without a release is only known as one to which the
  !> motion settles. Of several slow cycles the period is that of all, the peak the highest, and the valley the lowest; the other
  !> measures are means.
  type :: full_cycle_t
    real(wp) :: measure(measures) = 0.0_wp
    logical :: has_multiplier = .true.
    real(wp) :: log_multiplier = 0.0_wp
    integer :: slow_cycles = 1
    real(wp) :: alpha = 0.0_wp
  end type full_cycle_t

  !> What a motion is like after some time.
  type :: regularity_t
    !> Slow cycles that were followed, and after how many it repeats; 0 if it does not.
    integer :: slow_cycles = 0, repeats = 0
    !> The time that they took [s].
    real(wp) :: time = 0.0_wp
    !> Lyapunov exponent for a slow cycle and its standard error, NaN if they are not known, and the verdict.
    real(wp) :: exponent = 0.0_wp, error = 0.0_wp
    integer :: verdict = undecided
    !> Mean and scatter of the measures of its cycles.
    real(wp) :: mean(measures) = 0.0_wp, scatter(measures) = 0.0_wp
    integer :: cycles = 0
  end type regularity_t

contains

  !> The cycles of a scene under one drive velocity [m/s], and what its motion comes to.
  subroutine find_full_cycles(scene, velocity, sliding_is_stable, cycles, regularity, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    logical, intent(in) :: sliding_is_stable
    type(full_cycle_t), allocatable, intent(out) :: cycles(:)
    type(regularity_t), intent(out) :: regularity
    type(error_t), allocatable, intent(out) :: error
    type(release_map_t) :: map
    real(wp), allocatable :: returns(:)
    logical :: goes_on

    call settle(scene, velocity, map, returns, goes_on, cycles, regularity, error)
    if (allocated(error)) return
    if (.not. goes_on) then
      call look_at_the_end(steady(scene, velocity), sliding_is_stable, cycles, regularity, error)
    else if (regularity%repeats == 0) then
      call measure_scatter(steady(scene, velocity), regularity, error)
    end if
    if (.not. allocated(error) .and. size(returns) > 1) call find_fixed_points(map, returns, regularity%repeats, cycles, error)
    if (allocated(error) .or. regularity%repeats == 0 .or. size(cycles) == 0) return
    ! The cycle to which it settles determines its regularity.
    if (.not. cycles(1)%has_multiplier) return
    regularity%exponent = cycles(1)%log_multiplier/real(regularity%repeats, wp)
    regularity%error = 0.0_wp
  end subroutine find_full_cycles

  !> Follow the motion of a scene under one drive velocity [m/s] by its map: the releases with which slow cycles end, and the cycle
  !> with rest to which it settles, if it does.
  subroutine settle(scene, velocity, map, returns, goes_on, cycles, regularity, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(release_map_t), intent(out) :: map
    real(wp), allocatable, intent(out) :: returns(:)
    logical, intent(out) :: goes_on
    type(full_cycle_t), allocatable, intent(out) :: cycles(:)
    type(regularity_t), intent(out) :: regularity
    type(error_t), allocatable, intent(out) :: error

    allocate (cycles(0))
    goes_on = .false.
    regularity%exponent = ieee_value(regularity%exponent, ieee_quiet_nan)
    regularity%error = regularity%exponent
    call map_of(steady(scene, velocity), map, error)
    if (.not. allocated(error)) call follow(map, returns, goes_on, regularity, error)
    if (allocated(error) .or. regularity%repeats == 0) return
    call take(map, returns(size(returns)), regularity%repeats, cycles, error)
  end subroutine settle

  !> The map of a scene, which must have one steady drive velocity, exact contact and a method for it.
  subroutine map_of(scene, map, error)
    type(scene_t), intent(in) :: scene
    type(release_map_t), intent(out) :: map
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: plain
    class(motion_t), allocatable :: motion, other

    plain = scene
    plain%cycle_map = 'off'
    call new_motion(plain, motion, other, error)
    if (allocated(error)) return
    select type (motion)
    class is (cycle_map_t)
      call new_release_map(motion%steps, scene%drive_velocity(1), scene%rtol, .false., map)
    end select
    map%longest = scene%t_end
  end subroutine map_of

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

  !> The releases with which slow cycles end, until they repeat, or decide that they do not. `goes_on`: there is always one more.
  subroutine follow(map, returns, goes_on, regularity, error)
    type(release_map_t), intent(inout) :: map
    real(wp), allocatable, intent(out) :: returns(:)
    logical, intent(out) :: goes_on
    type(regularity_t), intent(inout) :: regularity
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: slow_cycle, slip
    real(wp) :: logarithm(followed), here
    integer :: n, known

    allocate (returns(0))
    known = 0
    call map%first(here, goes_on, error)
    do n = 1, followed
      if (allocated(error) .or. .not. goes_on) return
      call map%come_back(here, slow_cycle, slip, goes_on, error)
      if (allocated(error) .or. .not. goes_on) return
      here = slow_cycle%to
      returns = [returns, here]
      regularity%slow_cycles = n
      regularity%time = regularity%time + slow_cycle%measure(duration)
      regularity%repeats = repeats_of(returns)
      if (regularity%repeats > 0) then
        regularity%verdict = regular
        return
      end if
      if (slow_cycle%has_slope) then
        known = known + 1
        logarithm(known) = slow_cycle%log_slope
      end if
    end do
    call judge(logarithm(known/2 + 1:known), regularity%exponent, regularity%error, regularity%verdict)
  end subroutine follow

  !> The number of releases after which they are the same again, 0 if they are not.
  pure integer function repeats_of(alpha) result(m)
    real(wp), intent(in) :: alpha(:)
    !> Times as far apart. Convention: enough for all that come nearer by a factor of 1.02 in a slow cycle.
    real(wp), parameter :: both_sides = 100.0_wp
    integer :: n

    n = size(alpha)
    do m = 1, most_repeats
      if (apart(m) <= same) exit
    end do
    if (m > most_repeats) m = 0
    ! It may come nearer from both sides in turn, so that twice as many agree before.
    do while (m > 1 .and. modulo(m, 2) == 0)
      if (apart(m/2) > both_sides*same) exit
      m = m/2
    end do

  contains

    !> The largest distance of the last releases from those of as many slow cycles before [rad].
    pure real(wp) function apart(by)
      integer, intent(in) :: by
      integer :: seen

      apart = huge(apart)
      seen = max(by, 3)
      if (n >= seen + by) apart = maxval(abs(alpha(n - seen + 1:) - alpha(n - seen + 1 - by:n - by)))
    end function apart
  end function repeats_of

  !> The motion of a scene, with its summary, until its end.
  subroutine run(scene, motion, summary, error)
    type(scene_t), intent(in) :: scene
    class(motion_t), allocatable, intent(out) :: motion
    type(motion_summary_t), intent(out) :: summary
    type(error_t), allocatable, intent(out) :: error
    class(motion_t), allocatable :: other

    call new_motion(scene, motion, other, error)
    if (allocated(error)) return
    call summary%start(motion, 0.0_wp)
    do while (.not. motion%finished())
      call next_piece(motion, other, error)
      if (allocated(error)) return
      call summary%follow(motion)
    end do
  end subroutine run

  !> Mean and scatter of the cycles of a motion that does not repeat.
  subroutine measure_scatter(scene, regularity, error)
    type(scene_t), intent(in) :: scene
    type(regularity_t), intent(inout) :: regularity
    type(error_t), allocatable, intent(out) :: error
    class(motion_t), allocatable :: motion
    type(motion_summary_t) :: summary
    type(scene_t) :: shorter
    !> In slow cycles: as many as are kept count. Convention.
    real(wp), parameter :: long_enough = 200.0_wp

    shorter = scene
    shorter%t_end = long_enough*regularity%time/real(regularity%slow_cycles, wp)
    call run(shorter, motion, summary, error)
    if (.not. allocated(error)) call summary%cycles%means(.false., regularity%cycles, regularity%mean, regularity%scatter)
  end subroutine measure_scatter

  !> A motion that ceases to rest comes to a cycle without releases, or to steady sliding.
  subroutine look_at_the_end(scene, sliding_is_stable, cycles, regularity, error)
    type(scene_t), intent(in) :: scene
    logical, intent(in) :: sliding_is_stable
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(regularity_t), intent(inout) :: regularity
    type(error_t), allocatable, intent(out) :: error
    !> Scatter over the mean up to which cycles are equal: those that count began in the second half of a long run. Convention.
    real(wp), parameter :: equal = 1.0e-7_wp
    class(motion_t), allocatable :: motion
    type(motion_summary_t) :: summary

    call run(scene, motion, summary, error)
    if (allocated(error)) return
    call summary%cycles%means(.false., regularity%cycles, regularity%mean, regularity%scatter)
    if (regularity%cycles == 0) then
      if (sliding_is_stable) regularity%verdict = steady_sliding
    else if (regularity%cycles > 1 .and. regularity%scatter(period) <= equal*regularity%mean(period)) then
      cycles = [full_cycle_t(measure=regularity%mean, has_multiplier=.false.)]
      regularity%verdict = regular
      regularity%repeats = 1
    end if
  end subroutine look_at_the_end

  !> The cycles that the map of one slow cycle has around its releases.
  subroutine find_fixed_points(map, returns, repeats, cycles, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: returns(:)
    integer, intent(in) :: repeats
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: first, last, alpha, alpha_before, turn, turn_before, slope
    logical :: found, found_before
    integer :: i, points

    points = merge(few, many, repeats > 0)
    ! The first release comes from the beginning of the scene.
    first = minval(returns(2:))
    last = maxval(returns(2:))
    associate (margin => max(0.05_wp*(last - first), 1.0e-3_wp))
      first = first - margin
      last = last + margin
    end associate
    found_before = .false.
    turn_before = 0.0_wp
    alpha_before = first
    do i = 0, points
      alpha = first + (last - first)*(real(i, wp)/real(points, wp))
      call look(alpha, turn, slope, found)
      if (allocated(error)) return
      if (found .and. found_before .and. turn_before*turn < 0.0_wp) call refine(alpha_before, alpha, turn)
      if (allocated(error)) return
      found_before = found
      turn_before = turn
      alpha_before = alpha
    end do
    if (map%has_fixed) call take(map, map%fixed, 1, cycles, error)

  contains

    !> The angle by which a slow cycle turns the release with which it begins [rad], and its derivative.
    subroutine look(from, by, rate, is_known)
      real(wp), intent(in) :: from
      real(wp), intent(out) :: by, rate
      logical, intent(out) :: is_known
      type(passage_t) :: slow_cycle, slip

      call map%come_back(from, slow_cycle, slip, is_known, error)
      by = slow_cycle%to - from
      rate = slow_cycle%slope - 1.0_wp
    end subroutine look

    !> By Newton's method in the bracket.
    subroutine refine(a, b, f_b)
      real(wp), intent(in) :: a, b, f_b
      type(bracket_t) :: bracket
      real(wp) :: x, f, rate, side
      integer :: iteration
      logical :: is_known

      side = sign(1.0_wp, f_b)
      bracket = bracket_t([a, b], [-1.0_wp, 1.0_wp])
      x = bracket%middle()
      do iteration = 1, max_iterations
        call look(x, f, rate, is_known)
        if (allocated(error) .or. .not. is_known) return
        if (abs(f) <= fine) exit
        call bracket%narrow(x, side*f)
        if (bracket%width() <= fine) exit
        x = bracket%newton(x, side*f, side*rate)
      end do
      if (abs(f) <= missed) call take(map, x, 1, cycles, error)
    end subroutine refine
  end subroutine find_fixed_points

  !> The cycle that begins with a release and repeats after so many slow cycles, unless it is known.
  subroutine take(map, alpha, repeats, cycles, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: alpha
    integer, intent(in) :: repeats
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(error_t), allocatable, intent(out) :: error
    type(full_cycle_t) :: cycle
    type(passage_t) :: slow_cycle, slip
    real(wp) :: here, one(measures), old(measures), new(measures)
    logical :: found
    integer :: i

    ! Newton's step: a motion that settles slowly is still on its way.
    cycle%alpha = alpha
    call map%power(alpha, repeats, slow_cycle, found, error)
    if (allocated(error) .or. .not. found) return
    if (abs(slow_cycle%to - alpha) > missed) return
    cycle%has_multiplier = slow_cycle%has_slope
    if (cycle%has_multiplier) then
      cycle%log_multiplier = slow_cycle%log_slope
      associate (slope => slow_cycle%slope)
        if (abs(1.0_wp - slope) > 0.0_wp) cycle%alpha = alpha + (slow_cycle%to - alpha)/(1.0_wp - slope)
      end associate
    end if
    if (any(abs(cycles%alpha - cycle%alpha) <= alike .and. cycles%has_multiplier)) return
    here = cycle%alpha
    do i = 1, repeats
      call map%come_back(here, slow_cycle, slip, found, error)
      if (allocated(error) .or. .not. found) return
      here = slow_cycle%to
      call measure(map, slip%from, slow_cycle%measure(duration), one, error)
      if (allocated(error)) return
      call share_out(i, cycle%measure, one, old, new)
      cycle%measure = old*cycle%measure + new*one
    end do
    associate (swing => cycle%measure(peak) - cycle%measure(valley), limit => map%steps%slider%law%kinetic_limit)
      cycle%slow_cycles = merge(repeats, 0, swing > threshold*limit)
    end associate
    cycles = [cycles, cycle]
  end subroutine take

  !> What several slow cycles have of their measures, and what one more adds, the `number`-th: the period is that of all, the peak the
  !> highest, the valley the lowest; the others are means.
  pure subroutine share_out(number, value, one, old, new)
    integer, intent(in) :: number
    real(wp), intent(in) :: value(measures), one(measures)
    real(wp), intent(out) :: old(measures), new(measures)

    new = 1.0_wp/real(number, wp)
    new(peak) = merge(1.0_wp, 0.0_wp, number == 1 .or. one(peak) > value(peak))
    new(valley) = merge(1.0_wp, 0.0_wp, number == 1 .or. one(valley) < value(valley))
    old = 1.0_wp - new
    new(period) = 1.0_wp
    old(period) = 1.0_wp
  end subroutine share_out

  !> The measures of a slow cycle of this duration [s] that ends with the slip from a release: its load has its peak and its valley
  !> in this slip.
  subroutine measure(map, alpha, lasting, value, error)
    type(release_map_t), intent(inout), target :: map
    real(wp), intent(in) :: alpha, lasting
    real(wp), intent(out) :: value(measures)
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: slip
    type(extremum_t) :: high, low
    logical :: found

    call map%run(alpha, map%longest, slip, found, error)
    if (allocated(error)) return
    call extremes_of(map, high, low)
    value = measures_of(high, low, lasting, map%velocity)
  end subroutine measure

  !> The peak and the valley, as seen in the direction of the drive, of the load in the passage that was run last.
  subroutine extremes_of(map, high, low)
    type(release_map_t), intent(in), target :: map
    type(extremum_t), intent(out) :: high, low
    type(summary_t) :: summary
    type(piece_view_t) :: view
    type(contribution_t) :: slip
    type(piece_t), target :: piece
    integer :: i

    associate (slider => map%steps%slider)
      call summary%cycles%begin(slider%along(1), slider%law%kinetic_limit, slider%stiffness(1), slider%mass)
      do i = 1, map%recording%count
        call map%recording%get(i, state_t(), piece)
        call view%show(map%steps, piece)
        if (i == 1) call summary%begin(view%first, 0.0_wp, 0.0_wp)
        call summary%take_in(view)
      end do
      slip = summary%contribution()
      high = slip%highest
      low = slip%lowest
      if (slider%along(1)*map%velocity < 0.0_wp) then
        high = extremum_t(-low%load, low%time, low%position)
        low = extremum_t(-slip%highest%load, slip%highest%time, slip%highest%position)
      end if
    end associate
  end subroutine extremes_of

  !> The measures of a slow cycle of this duration [s] with this peak and this valley in its slip.
  pure function measures_of(high, low, lasting, velocity) result(value)
    type(extremum_t), intent(in) :: high, low
    real(wp), intent(in) :: lasting, velocity
    real(wp) :: value(measures), falling

    falling = modulo(low%time - high%time, lasting)
    value = [lasting, high%load, low%load, lasting - falling, falling, sign(1.0_wp, velocity)*(low%position - high%position)]
  end function measures_of
end module dst_full_cycles
