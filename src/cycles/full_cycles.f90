!> The limit cycles of the full model, and what its motion comes to, from its map from release to release (dst_release_map).
!>
!> A slow cycle ends with the passage that turns the force back. Where the release with which it ends agrees with that of the m-th
!> slow cycle before, the motion repeats after m slow cycles. Other orbits, which begin with releases of all directions, come to the
!> other stable cycles. Cycles that no motion comes to are zeros of the map of n slow cycles minus identity, which the orbits have
!> already: between two releases next to each other of which one was followed by a larger one n slow cycles later, the other by a
!> smaller one. Because of rest no motion need be followed backwards. A search is less accurate than the cycles that it finds: these
!> are found once more, by Newton's method, in an accurate map.
module dst_full_cycles
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
  use dst_assembly, only: new_motion
  use dst_cycles, only: extremum_t, measures, period, peak, valley, threshold
  use dst_divergence, only: judge, regular, undecided, steady_sliding
  use dst_errors, only: error_t
  use dst_kinds, only: wp, pi
  use dst_motion, only: motion_t, next_piece
  use dst_motion_summary, only: motion_summary_t
  use dst_piece, only: piece_t
  use dst_piece_view, only: piece_view_t
  use dst_passage, only: passage_t, duration
  use dst_release_map, only: release_map_t, watch_t, new_release_map
  use dst_roots, only: bracket_t
  use dst_scene, only: scene_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t
  use dst_stepping, only: stepping_t
  use dst_summary, only: summary_t, contribution_t, summary_quantities
  use dst_variation, only: steps_of
  use dst_writer, only: find_quantity
  implicit none
  private

  public :: full_cycle_t, orbit_t, regularity_t, find_full_cycles
  public :: settle, sharpen, map_of, steady, extremes_of, measures_of, share_out, measure_cycle, most_repeats

  !> Accuracy of the cycles, and of the motion among which they are searched. Ten times the former: the cycle of Fig. 3 changes by
  !> 1e-10, relative to it.
  real(wp), parameter :: rtol = 1.0e-11_wp, searching = 1.0e-8_wp
  !> Two releases are the same if their angles differ by no more than this [rad]. Convention.
  real(wp), parameter :: same = 1.0e-10_wp
  !> A motion repeats after so many slow cycles at most. It is followed for so many. Conventions.
  integer, parameter :: most_repeats = 8, followed = 400
  !> How long it may take: in lengths F_0/k_x of drive displacement, and as many periods of the free oscillation. Convention.
  real(wp), parameter :: lengths = 200.0_wp
  !> Releases with which other orbits begin: in all directions, and around those of the motion of the scene if it repeats, and if it
  !> does not; and slow cycles for which such an orbit is followed. Conventions.
  integer, parameter :: few = 8, many = 128, explored = 60
  !> Orbits resolve cycles of n slow cycles if there is one between no more than this share of their releases. Convention.
  real(wp), parameter :: resolved = 0.25_wp
  integer, parameter :: max_iterations = 40
  !> Two cycles are the same if their releases differ by no more than this [rad]. Convention.
  real(wp), parameter :: alike = 1.0e-6_wp
  !> A jump of the map from one side of the diagonal to the other is not a fixed point: the map misses it by more than this [rad].
  real(wp), parameter :: missed = 1.0e-7_wp
  real(wp), parameter :: fine = 1.0e-13_wp
  !> The share of what a search may cost after which an orbit is followed no further. Convention.
  real(wp), parameter :: share_of_orbit = 0.4_wp
  !> Nobody knows how many slips a search needs.
  real(wp), parameter :: unknown = -1.0_wp
  !> No range of releases.
  real(wp), parameter :: nowhere(2) = [huge(1.0_wp), -huge(1.0_wp)]

  !> A cycle: its measures as in dst_cycles, the logarithm of its multiplier, the slow cycles after which it repeats (0: it is the
  !> fast oscillation alone), and the release with which it begins. A cycle without a release is only known as one to which the
  !> motion settles. Of several slow cycles the period is that of all, the peak the highest, and the valley the lowest; the other
  !> measures are means.
  type :: full_cycle_t
    real(wp) :: measure(measures) = 0.0_wp
    logical :: has_multiplier = .true.
    real(wp) :: log_multiplier = 0.0_wp
    integer :: slow_cycles = 1
    !> The releases with which its slow cycles begin [rad], the first one the largest, and their number.
    real(wp) :: release(most_repeats) = huge(1.0_wp)
    integer :: repeats = 1
  contains
    procedure :: is_stable
  end type full_cycle_t

  !> The slow cycles of a motion, one after the other.
  type :: orbit_t
    !> The first release, and those with which slow cycles end [rad].
    real(wp), allocatable :: release(:)
    !> The logarithms of the slopes of its slow cycles, NaN if they are not known, and the time that they took [s].
    real(wp), allocatable :: log_slope(:)
    real(wp) :: time = 0.0_wp
    !> After how many slow cycles it repeats, 0 if it does not; and whether there is always one more.
    integer :: repeats = 0
    logical :: goes_on = .true.
  end type orbit_t

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
    !> Cycles of up to so many slow cycles were looked for.
    integer :: searched = 0
  end type regularity_t

contains

  !> Whether a motion can stay at the cycle.
  elemental logical function is_stable(self)
    class(full_cycle_t), intent(in) :: self

    is_stable = self%log_multiplier < 0.0_wp .or. .not. self%has_multiplier
  end function is_stable

  !> The cycles of a scene under one drive velocity [m/s], and what its motion comes to.
  subroutine find_full_cycles(scene, velocity, sliding_is_stable, cycles, regularity, error, watch)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    logical, intent(in) :: sliding_is_stable
    type(full_cycle_t), allocatable, intent(out) :: cycles(:)
    type(regularity_t), intent(out) :: regularity
    type(error_t), allocatable, intent(out) :: error
    procedure(watch_t), optional :: watch
    type(release_map_t) :: map
    type(orbit_t) :: orbit
    type(orbit_t), allocatable :: orbits(:)
    logical :: are_all
    integer :: n

    call settle(scene, velocity, map, orbit, cycles, regularity, error, watch)
    if (allocated(error)) return
    if (.not. orbit%goes_on) call look_at_the_end(steady(scene, velocity), sliding_is_stable, cycles, regularity, error)
    if (allocated(error)) return
    orbits = [orbit]
    call explore(map, steady(scene, velocity), orbits, cycles)
    if (map%has_fixed) call take(map, map%fixed, 1, cycles, error)
    if (allocated(error)) deallocate (error)
    do n = 1, most_repeats
      call find_between(map, orbits, n, cycles, are_all)
      if (.not. are_all) exit
      regularity%searched = n
    end do
    ! The cycle to which it settles determines its regularity.
    n = place_of_end(orbit, cycles)
    call sharpen(steady(scene, velocity), cycles, map, error)
    if (allocated(error)) return
    if (n > 0) then
      regularity%verdict = regular
      regularity%repeats = cycles(n)%repeats
      regularity%exponent = cycles(n)%log_multiplier/real(cycles(n)%repeats, wp)
      regularity%error = 0.0_wp
    else if (orbit%goes_on .and. orbit%repeats == 0) then
      call measure_scatter(rough(steady(scene, velocity)), regularity, error)
    end if
  end subroutine find_full_cycles

  !> Find cycles once more, in an accurate map, but for unstable ones of several slow cycles, of which there may be very many. Where the
  !> map has no such cycle nearby, it is left as it is.
  subroutine sharpen(scene, cycles, map, error)
    type(scene_t), intent(in) :: scene
    type(full_cycle_t), intent(inout) :: cycles(:)
    type(release_map_t), intent(inout) :: map
    type(error_t), allocatable, intent(out) :: error
    !> Newton's steps, of which the last one is no longer than this [rad]. Conventions.
    integer, parameter :: most_steps = 5
    real(wp), parameter :: short = 1.0e-8_wp
    type(release_map_t) :: exact
    type(full_cycle_t) :: one
    type(passage_t) :: whole
    real(wp) :: step
    logical :: found
    integer :: i, iteration

    call map_of(scene, exact, error)
    if (allocated(error)) return
    exact%slips_expected = unknown
    exact%watch => map%watch
    do i = 1, size(cycles)
      one = cycles(i)
      if (.not. one%has_multiplier .or. one%release(1) > pi .or. (one%repeats > 1 .and. .not. one%is_stable())) cycle
      do iteration = 1, most_steps
        call exact%power(one%release(1), one%repeats, whole, found, error)
        if (allocated(error)) deallocate (error)
        if (.not. (found .and. whole%has_slope .and. abs(1.0_wp - whole%slope) > 0.0_wp)) exit
        step = (whole%to - one%release(1))/(1.0_wp - whole%slope)
        if (abs(step) > alike) exit
        one%release(1) = one%release(1) + step
        if (abs(step) > short) cycle
        one%log_multiplier = whole%log_slope
        call measure_cycle(exact, one%release(1), one%repeats, one%release, one%measure, found, error)
        if (allocated(error)) return
        if (found) cycles(i) = one
        exit
      end do
    end do
    map = exact
  end subroutine sharpen

  !> The place of the stable cycle to which an orbit comes, 0 if there is none or it is not known: it repeats it, or its distance
  !> decreases by the multiplier each time.
  pure integer function place_of_end(orbit, cycles) result(place)
    type(orbit_t), intent(in) :: orbit
    type(full_cycle_t), intent(in) :: cycles(:)
    !> How far a decrease may be from the multiplier, and how many have to agree. Conventions.
    real(wp), parameter :: near = 0.05_wp
    integer, parameter :: telling = 4
    real(wp) :: distance(0:telling)
    integer :: i, k

    do place = 1, size(cycles)
      associate (one => cycles(place), last => size(orbit%release))
        if (.not. (one%has_multiplier .and. one%log_multiplier < 0.0_wp) .or. last <= telling*one%repeats) cycle
        i = minloc(abs(one%release - orbit%release(last)), 1)
        distance = [(abs(orbit%release(last - k*one%repeats) - one%release(i)), k=telling, 0, -1)]
        if (distance(telling) <= alike) return
        if (all(abs(distance(1:) - exp(one%log_multiplier)*distance(:telling - 1)) <= near*distance(1:))) return
      end associate
    end do
    place = 0
  end function place_of_end

  !> Follow the motion of a scene under one drive velocity [m/s] by its map: the releases with which slow cycles end, and the cycle
  !> with rest to which it settles, if it does.
  subroutine settle(scene, velocity, map, orbit, cycles, regularity, error, watch)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(release_map_t), intent(out) :: map
    type(orbit_t), intent(out) :: orbit
    type(full_cycle_t), allocatable, intent(out) :: cycles(:)
    type(regularity_t), intent(out) :: regularity
    type(error_t), allocatable, intent(out) :: error
    procedure(watch_t), optional :: watch
    real(wp) :: start

    allocate (cycles(0), orbit%release(0), orbit%log_slope(0))
    regularity%exponent = ieee_value(regularity%exponent, ieee_quiet_nan)
    regularity%error = regularity%exponent
    call map_of(rough(steady(scene, velocity)), map, error)
    map%slips_expected = unknown
    if (present(watch)) map%watch => watch
    if (.not. allocated(error)) call map%first(start, orbit%goes_on, error)
    if (.not. allocated(error) .and. orbit%goes_on) call follow(map, start, followed, nowhere, cycles, orbit, error)
    if (allocated(error)) return
    regularity%slow_cycles = size(orbit%log_slope)
    regularity%time = orbit%time
    regularity%repeats = orbit%repeats
    if (orbit%repeats > 0) then
      regularity%verdict = regular
      call take(map, orbit%release(size(orbit%release)), orbit%repeats, cycles, error)
    else if (orbit%goes_on) then
      associate (known => pack(orbit%log_slope, .not. ieee_is_nan(orbit%log_slope)))
        call judge(known(size(known)/2 + 1:), regularity%exponent, regularity%error, regularity%verdict)
      end associate
    end if
  end subroutine settle

  !> The map of a scene, which must have one steady drive velocity, exact contact and a method for it.
  subroutine map_of(scene, map, error)
    type(scene_t), intent(in) :: scene
    type(release_map_t), intent(out) :: map
    type(error_t), allocatable, intent(out) :: error
    class(stepping_t), allocatable :: steps

    call steps_of(scene, steps, error)
    if (allocated(error)) return
    select type (steps)
    class is (slip_stick_t)
      call new_release_map(steps, scene%drive_velocity(1), scene%rtol, .false., map)
    end select
    map%longest = scene%t_end
  end subroutine map_of

  !> The scene under a steady drive, as accurate as cycles shall be, for as long as they may take.
  pure function steady(scene, velocity) result(changed)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(scene_t) :: changed

    changed = scene
    changed%model = 'full'
    changed%method = 'radau13'
    changed%rtol = rtol
    changed%cycle_map = 'auto'
    changed%drive_time = [0.0_wp]
    changed%drive_velocity = [velocity]
    changed%step_max = 0.0_wp
    changed%settle = 0.0_wp
    changed%t_end = lengths*(scene%mu_0*scene%normal_load/(scene%stiffness_x*abs(velocity)) &
      + 2.0_wp*pi*sqrt(scene%mass/scene%stiffness_x))
  end function steady

  !> The scene as accurate as a search needs it.
  pure function rough(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%rtol = searching
  end function rough

  !> The orbit from a release [rad] until it repeats, over so many slow cycles at most: no further than to a known stable cycle, or
  !> into a range of releases [rad].
  subroutine follow(map, start, most, range, cycles, orbit, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: start, range(2)
    integer, intent(in) :: most
    type(full_cycle_t), intent(in) :: cycles(:)
    type(orbit_t), intent(out) :: orbit
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: slow_cycle, slip
    logical :: found
    integer :: n, i

    orbit%release = [start]
    allocate (orbit%log_slope(0))
    do n = 1, most
      if (map%is_spent(share_of_orbit)) return
      call map%come_back(orbit%release(n), slow_cycle, slip, found, error)
      orbit%goes_on = found
      if (.not. found) orbit%goes_on = map%is_spent()
      if (allocated(error) .or. .not. found) return
      orbit%release = [orbit%release, slow_cycle%to]
      if (.not. slow_cycle%has_slope) slow_cycle%log_slope = ieee_value(slow_cycle%log_slope, ieee_quiet_nan)
      orbit%log_slope = [orbit%log_slope, slow_cycle%log_slope]
      orbit%time = orbit%time + slow_cycle%measure(duration)
      orbit%repeats = repeats_of(orbit%release)
      if (orbit%repeats > 0 .or. (slow_cycle%to >= range(1) .and. slow_cycle%to <= range(2))) return
      if (any([(cycles(i)%is_stable() .and. any(abs(cycles(i)%release - slow_cycle%to) <= alike), i=1, size(cycles))])) return
    end do
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
    call summary%start(motion, scene%settle)
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
    !> In slow cycles: as many as are kept count, if so many were followed. Convention.
    integer, parameter :: long_enough = 200

    if (regularity%slow_cycles == 0) return
    shorter = scene
    shorter%t_end = regularity%time*min(1.0_wp, real(long_enough, wp)/real(regularity%slow_cycles, wp))
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
    !> To what two cycles agree that are the same one. Convention.
    real(wp), parameter :: equal = 1.0e-6_wp
    class(motion_t), allocatable :: motion
    type(motion_summary_t) :: summary
    real(wp) :: value(size(summary_quantities))
    logical :: repeats
    integer :: i

    call run(scene, motion, summary, error)
    if (allocated(error)) return
    call summary%cycles%means(.false., regularity%cycles, regularity%mean, regularity%scatter)
    call summary%values(motion, value)
    repeats = .not. ieee_is_nan(of('regularity') + of('repeats'))
    if (repeats) repeats = nint(of('regularity')) == regular .and. nint(of('repeats')) == 1
    if (regularity%cycles == 0) then
      if (sliding_is_stable) regularity%verdict = steady_sliding
    else if (repeats) then
      regularity%exponent = of('lyapunov_exponent')
      regularity%error = of('lyapunov_error')
      associate (is_known => .not. ieee_is_nan(regularity%exponent))
        if (.not. any([(all(abs(cycles(i)%measure - regularity%mean) <= equal*abs(regularity%mean)), i=1, size(cycles))])) &
          cycles = [cycles, full_cycle_t(measure=regularity%mean, has_multiplier=is_known, &
          log_multiplier=merge(regularity%exponent, 0.0_wp, is_known))]
      end associate
      regularity%verdict = regular
      regularity%repeats = 1
    end if

  contains

    pure real(wp) function of(name)
      character(*), intent(in) :: name

      of = value(find_quantity(summary_quantities, name))
    end function of
  end subroutine look_at_the_end

  !> Add orbits that begin elsewhere, and the stable cycles to which they come. What fails in them fails not in the motion.
  subroutine explore(map, scene, orbits, cycles)
    type(release_map_t), intent(inout) :: map
    type(scene_t), intent(in) :: scene
    type(orbit_t), allocatable, intent(inout) :: orbits(:)
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    !> A passage that takes longer than so many lengths F_0/k_x of drive displacement, and as many periods, has no end. Convention.
    real(wp), parameter :: long = 10.0_wp
    type(error_t), allocatable :: error
    type(orbit_t) :: orbit
    type(scene_t) :: other
    type(regularity_t) :: unused
    real(wp) :: range(2), pull(2), lowest
    logical :: is_endless
    integer :: i

    range = nowhere
    is_endless = orbits(1)%goes_on .and. orbits(1)%repeats == 0
    if (is_endless) range = [minval(orbits(1)%release(2:)), maxval(orbits(1)%release(2:))]
    map%longest = long*scene%t_end/lengths
    ! Below, the force on the object decreases as the drive moves.
    pull = abs(map%steps%slider%stiffness*map%steps%slider%along)
    lowest = -atan2(pull(1), pull(2))
    call begin_between(lowest, 0.5_wp*pi, few)
    if (size(orbits(1)%release) < 2) return
    associate (seen => orbits(1)%release(2:))
      associate (margin => max(0.05_wp*(maxval(seen) - minval(seen)), 1.0e-3_wp))
        call begin_between(minval(seen) - margin, maxval(seen) + margin, merge(many, few, is_endless))
      end associate
    end associate

  contains

    subroutine begin_between(low, high, starts)
      real(wp), intent(in) :: low, high
      integer, intent(in) :: starts

      do i = starts, 1, -1
        call follow(map, low + (high - low)*(real(i, wp) - 0.5_wp)/real(starts, wp), explored, range, cycles, orbit, error)
        if (.not. allocated(error) .and. orbit%repeats > 0) &
          call take(map, orbit%release(size(orbit%release)), orbit%repeats, cycles, error)
        if (.not. (allocated(error) .or. orbit%goes_on) .and. all(orbits(2:)%goes_on)) then
          other = scene
          associate (u => map%elongation(orbit%release(size(orbit%release))))
            other%elongation_x = u(1)
            other%elongation_y = u(2)
          end associate
          other%velocity_ratio = 0.0_wp
          call look_at_the_end(other, .false., cycles, unused, error)
        end if
        orbits = [orbits, orbit]
        if (allocated(error)) deallocate (error)
      end do
    end subroutine begin_between
  end subroutine explore

  !> The cycles of n slow cycles between releases of orbits. `are_all`: they are not too many for these, or for the time.
  subroutine find_between(map, orbits, n, cycles, are_all)
    type(release_map_t), intent(inout) :: map
    type(orbit_t), intent(in) :: orbits(:)
    integer, intent(in) :: n
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    logical, intent(out) :: are_all
    real(wp), allocatable :: from(:), turn(:)
    integer, allocatable :: next(:)
    logical, allocatable :: is_new(:)
    integer :: i

    allocate (from(0), turn(0))
    do i = 1, size(orbits)
      associate (release => orbits(i)%release, last => size(orbits(i)%release) - n)
        if (last < 1) cycle
        from = [from, release(:last)]
        turn = [turn, release(n + 1:) - release(:last)]
      end associate
    end do
    ! At a cycle there is nothing between.
    from = pack(from, abs(turn) > missed)
    turn = pack(turn, abs(turn) > missed)
    next = [(minloc(from, 1, from > from(i)), i=1, size(from))]
    where (next == 0) next = [(i, i=1, size(from))]
    is_new = [(turn(i)*turn(next(i)) < 0.0_wp .and. .not. any(is_between(cycles, from(i), from(next(i)))), i=1, size(from))]
    are_all = n == 1 .or. count(is_new) <= resolved*real(size(from), wp)
    if (.not. are_all) return
    do i = 1, size(from)
      if (is_new(i)) call refine(from(i), from(next(i)), turn(next(i)))
    end do
    are_all = .not. map%is_spent()

  contains

    !> Whether a cycle which repeats itself after n slow cycles has a release between.
    elemental logical function is_between(cycle, low, high)
      type(full_cycle_t), intent(in) :: cycle
      real(wp), intent(in) :: low, high

      is_between = modulo(n, cycle%repeats) == 0 .and. any(cycle%release >= low .and. cycle%release <= high)
    end function is_between

    !> By Newton's method in the bracket.
    subroutine refine(a, b, f_b)
      real(wp), intent(in) :: a, b, f_b
      type(error_t), allocatable :: error
      type(passage_t) :: whole
      type(bracket_t) :: bracket
      real(wp) :: x, f, side
      integer :: iteration
      logical :: found

      side = sign(1.0_wp, f_b)
      bracket = bracket_t([a, b], [-1.0_wp, 1.0_wp])
      x = bracket%middle()
      do iteration = 1, max_iterations
        call map%power(x, n, whole, found, error)
        if (allocated(error) .or. .not. found) return
        f = whole%to - x
        if (abs(f) <= fine) exit
        call bracket%narrow(x, side*f)
        if (bracket%width() <= fine) exit
        x = bracket%newton(x, side*f, side*(whole%slope - 1.0_wp))
      end do
      if (abs(f) <= missed) call take(map, x, n, cycles, error)
    end subroutine refine
  end subroutine find_between

  !> The cycle that begins with a release and repeats after so many slow cycles, unless it is known.
  recursive subroutine take(map, alpha, slow_cycles, cycles, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: alpha
    integer, intent(in) :: slow_cycles
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(error_t), allocatable, intent(out) :: error
    type(full_cycle_t) :: cycle
    type(passage_t) :: whole
    real(wp) :: begins
    logical :: found
    integer :: i

    ! Newton's step: a motion that settles slowly is still on its way.
    begins = alpha
    call map%power(alpha, slow_cycles, whole, found, error)
    if (allocated(error) .or. .not. found) return
    if (abs(whole%to - alpha) > missed) return
    cycle%has_multiplier = whole%has_slope
    if (cycle%has_multiplier) then
      cycle%log_multiplier = whole%log_slope
      if (abs(1.0_wp - whole%slope) > 0.0_wp) begins = alpha + (whole%to - alpha)/(1.0_wp - whole%slope)
    end if
    call measure_cycle(map, begins, slow_cycles, cycle%release, cycle%measure, found, error)
    if (allocated(error) .or. .not. found) return
    do i = 1, slow_cycles - 1
      ! It may be one of fewer.
      if (modulo(slow_cycles, i) == 0 .and. abs(cycle%release(i + 1) - cycle%release(1)) <= alike) then
        call take(map, cycle%release(1), i, cycles, error)
        return
      end if
    end do
    cycle%repeats = slow_cycles
    associate (release => cycle%release(:slow_cycles))
      release = cshift(release, maxloc(release, 1) - 1)
    end associate
    if (any([(abs(cycles(i)%release(1) - cycle%release(1)) <= alike, i=1, size(cycles))])) return
    associate (swing => cycle%measure(peak) - cycle%measure(valley), limit => map%steps%slider%law%kinetic_limit)
      cycle%slow_cycles = merge(slow_cycles, 0, swing > threshold*limit)
    end associate
    cycles = [cycles, cycle]
  end subroutine take

  !> The releases [rad] with which so many slow cycles begin, the first one at `alpha`, and their measures.
  subroutine measure_cycle(map, alpha, slow_cycles, release, value, found, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: alpha
    integer, intent(in) :: slow_cycles
    real(wp), intent(inout) :: release(:)
    real(wp), intent(out) :: value(measures)
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: slow_cycle, slip
    real(wp) :: begins, one(measures), old(measures), new(measures)
    integer :: i

    begins = alpha
    value = 0.0_wp
    do i = 1, slow_cycles
      release(i) = begins
      call map%come_back(begins, slow_cycle, slip, found, error)
      if (allocated(error) .or. .not. found) return
      begins = slow_cycle%to
      call measure(map, slip%from, slow_cycle%measure(duration), one, error)
      if (allocated(error)) return
      call share_out(i, value, one, old, new)
      value = old*value + new*one
    end do
  end subroutine measure_cycle

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
