!> The limit cycles of the full model, and what its motion comes to, from its map from release to release (dst_release_map).
!>
!> A slow cycle ends with the passage that turns the force back. Where the release with which it ends agrees with that of the m-th
!> slow cycle before, the motion repeats after m slow cycles. Other orbits, which begin with releases of all directions, come to the
!> other stable cycles. Cycles that no motion comes to are zeros of the map of n slow cycles minus identity, which the orbits have
!> already: between two releases next to each other of which one was followed by a larger one n slow cycles later, the other by a
!> smaller one. Because of rest no motion need be followed backwards. A search is less accurate than the cycles that it finds: these
!> are found once more, by Newton's method, in an accurate map, and measured there.
module dst_full_cycles
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_assembly, only: new_motion
  use dst_cycles, only: extremum_t, measures, period, peak, valley, stick_time, threshold, repeated
  use dst_divergence, only: judge, regular, undecided, steady_sliding
  use dst_errors, only: error_t
  use dst_kinds, only: wp, pi
  use dst_motion, only: motion_t, next_piece
  use dst_motion_summary, only: motion_summary_t
  use dst_piece, only: piece_t
  use dst_passage, only: passage_t, duration
  use dst_passage_summary, only: piece_summary_t, begin_at_release
  use dst_release_map, only: release_map_t, watch_t, new_release_map
  use dst_roots, only: bracket_t
  use dst_scene, only: scene_t
  use dst_slip_stick, only: slip_stick_t
  use dst_slow_cycle, only: most_repeats
  use dst_state, only: state_t
  use dst_stepping, only: stepping_t
  use dst_variation, only: steps_of
  use dst_writer, only: outcome_t, absent
  implicit none
  private

  public :: full_cycle_t, orbit_t, regularity_t, find_full_cycles
  public :: settle, sharpen, map_of, steady, go_around, measure, shares

  !> Accuracy of the cycles, and of the motion among which they are searched. Ten times the former: the period of Fig. 3 changes by
  !> 2e-14, relative to it, and its multiplier by 2e-7.
  real(wp), parameter :: rtol = 1.0e-11_wp, searching = 1.0e-8_wp
  !> Two releases are the same if their angles differ by no more than this [rad], if the slope of the map between is not known.
  !> Convention; twice: no change.
  real(wp), parameter :: same = 1.0e-10_wp
  !> A motion is followed for so many slow cycles. Convention; twice: no change.
  integer, parameter :: followed = 400
  !> How long it may take: in lengths F_0/k_x of drive displacement, and as many periods of the free oscillation. Convention; twice:
  !> no change.
  real(wp), parameter :: lengths = 200.0_wp
  !> Releases with which other orbits begin: in all directions, and around those of the motion of the scene if differences always
  !> shrink there, if they do in the end, and if they do not; and slow cycles for which such an orbit is followed. Conventions;
  !> twice each: no change.
  integer, parameter :: few = 8, some = 32, many = 128, explored = 60
  !> Orbits resolve cycles of n slow cycles if there is one between no more than this share of their releases. Convention; twice: no
  !> change.
  real(wp), parameter :: resolved = 0.25_wp
  integer, parameter :: max_iterations = 40
  !> Two cycles are the same if their releases differ by no more than this [rad]. Convention; twice: the same cycles.
  real(wp), parameter :: alike = 1.0e-6_wp
  !> To what the measures of two cycles agree that are the same one. Convention; twice: no change.
  real(wp), parameter :: equal = 1.0e-6_wp
  !> At a fixed point the map returns to it, and Newton's step to one leads no further, than so much [rad]. A jump of the map from
  !> one side of the diagonal to the other is none.
  real(wp), parameter :: missed = 1.0e-7_wp
  real(wp), parameter :: fine = 1.0e-13_wp
  !> Slow cycles that are enough for the mean and the scatter of cycles: so many are kept. Convention; twice: no change.
  real(wp), parameter :: long_enough = 200.0_wp
  !> The share of what a search may cost after which an orbit is followed no further. Convention; twice: the same, but for one of 15
  !> scenes in 1.5 times the time.
  real(wp), parameter :: share_of_orbit = 0.4_wp
  !> Nobody knows how many slips a search needs.
  real(wp), parameter :: unknown = -1.0_wp
  !> No range of releases.
  real(wp), parameter :: nowhere(2) = [huge(1.0_wp), -huge(1.0_wp)]

  !> A cycle: its measures as in dst_cycles, the logarithm of its multiplier, NaN if it is not known, the slow cycles after which it
  !> repeats (0: it is the fast oscillation alone), and the release with which it begins. A cycle without a release or a multiplier
  !> is only known as one to which the motion settles. Of several slow cycles the period is that of all, the peak the highest, and
  !> the valley the lowest; the other measures are means.
  type :: full_cycle_t
    real(wp) :: measure(measures) = 0.0_wp
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
    !> The slopes of its slow cycles, NaN if they are not known, and the time that they took [s].
    real(wp), allocatable :: slope(:)
    real(wp) :: time = 0.0_wp
    !> After how many slow cycles it repeats, 0 if it does not; and whether there is always one more.
    integer :: repeats = 0
    logical :: goes_on = .true.
  end type orbit_t

  !> What a motion is like after some time.
  type :: regularity_t
    !> Slow cycles that were followed, and after how many it repeats; 0 if it does not.
    integer :: slow_cycles = 0, repeats = 0
    !> Lyapunov exponent for a slow cycle and its standard error, NaN if they are not known, and the verdict.
    real(wp) :: exponent = 0.0_wp, error = 0.0_wp
    integer :: verdict = undecided
    !> Mean and scatter of the measures of its cycles.
    real(wp) :: mean(measures) = 0.0_wp, scatter(measures) = 0.0_wp
    integer :: cycles = 0
    !> Of a motion without a rest and without such cycles: how far its load swings [N].
    real(wp) :: swing = 0.0_wp
    !> Cycles of up to so many slow cycles were looked for.
    integer :: searched = 0
  end type regularity_t

contains

  !> Whether a motion can stay at the cycle.
  elemental logical function is_stable(self)
    class(full_cycle_t), intent(in) :: self

    is_stable = .not. self%log_multiplier >= 0.0_wp
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
    type(scene_t) :: long
    type(outcome_t) :: outcome
    logical :: are_all
    integer :: n

    call settle(scene, velocity, map, orbit, cycles, regularity, error, watch)
    if (allocated(error)) return
    if (.not. orbit%goes_on) call look_at_the_end(steady(scene, velocity), sliding_is_stable, cycles, regularity, error)
    if (allocated(error)) return
    orbits = [orbit]
    map%recalls = missed
    call explore(map, steady(scene, velocity), orbits, cycles)
    map%recalls = 0.0_wp
    if (map%has_fixed) call take([map%fixed], 0.0_wp, cycles, map)
    do n = 1, most_repeats
      call find_between(map, orbits, n, cycles, are_all)
      if (.not. are_all) exit
      regularity%searched = n
    end do
    call sharpen(steady(scene, velocity), cycles, map, error)
    if (allocated(error)) return
    ! The cycle to which it settles determines its regularity.
    n = place_of_end(orbit, cycles)
    if (n > 0) then
      regularity%verdict = regular
      regularity%repeats = cycles(n)%repeats
      regularity%exponent = cycles(n)%log_multiplier/real(cycles(n)%repeats, wp)
      regularity%error = 0.0_wp
    else if (orbit%goes_on .and. size(orbit%slope) > 0 .and. orbit%repeats == 0) then
      long = steady(scene, velocity, searching)
      long%t_end = orbit%time*min(1.0_wp, long_enough/real(size(orbit%slope), wp))
      call run(long, regularity, outcome, error)
    end if
  end subroutine find_full_cycles

  !> Find cycles once more, in an accurate map, which replaces that of the search, but for unstable ones of several slow cycles, of
  !> which there may be very many. One which that map does not have nearby is that of the search, measured there.
  subroutine sharpen(scene, cycles, map, error)
    type(scene_t), intent(in) :: scene
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(release_map_t), intent(inout) :: map
    type(error_t), allocatable, intent(out) :: error
    type(release_map_t) :: exact
    type(full_cycle_t), allocatable :: found_by_release(:)
    logical :: found
    integer :: i, k

    call map_of(scene, exact, error)
    if (allocated(error)) return
    exact%slips_expected = unknown
    exact%watch => map%watch
    call exact%part_as(map, maxval(cycles%release(1), cycles%release(1) <= pi) + alike)
    do i = 1, size(cycles)
      if (cycles(i)%release(1) > pi) cycle
      if (cycles(i)%repeats > 1 .and. .not. cycles(i)%is_stable()) cycle
      call improve(exact, cycles(i), found)
      if (.not. (found .or. cycles(i)%measure(period) > 0.0_wp)) call improve(map, cycles(i), found)
    end do
    ! What was found twice came to the same; the end of a run may be a cycle that was found by its release.
    found_by_release = pack(cycles, cycles%release(1) <= pi .and. cycles%measure(period) > 0.0_wp)
    cycles = pack(cycles, cycles%measure(period) > 0.0_wp .and. [(merge(.not. is_among(found_by_release, cycles(i)%measure), &
      all([(abs(cycles(k)%release(1) - cycles(i)%release(1)) > alike, k=1, i - 1)]), cycles(i)%release(1) > pi), &
      i=1, size(cycles))])
    map = exact
  end subroutine sharpen

  !> Whether one of the cycles has these measures.
  pure logical function is_among(cycles, measure)
    type(full_cycle_t), intent(in) :: cycles(:)
    real(wp), intent(in) :: measure(measures)
    integer :: i

    is_among = any([(all(abs(cycles(i)%measure - measure) <= equal*abs(measure)), i=1, size(cycles))])
  end function is_among

  !> Newton's method to a cycle of a map near another one, and its measures.
  subroutine improve(map, cycle, found)
    type(release_map_t), intent(inout) :: map
    type(full_cycle_t), intent(inout) :: cycle
    logical, intent(out) :: found
    !> Newton's steps, of which the last one is no longer than this [rad]. Conventions; twice each: no change.
    integer, parameter :: most_steps = 5
    real(wp), parameter :: short = 1.0e-11_wp
    type(error_t), allocatable :: error
    type(full_cycle_t) :: one
    type(passage_t) :: whole
    real(wp) :: step
    integer :: iteration

    one = cycle
    do iteration = 1, most_steps
      call go_around(map, one%repeats, one%release, whole, found, error, one%measure)
      found = found .and. .not. allocated(error)
      if (.not. found) return
      step = whole%to - one%release(1)
      if (whole%has_slope) step = step/(1.0_wp - whole%slope)
      found = abs(step) <= alike
      if (.not. found) return
      if (.not. whole%has_slope) exit
      one%release(1) = one%release(1) + step
      if (abs(step) <= short) exit
    end do
    one%log_multiplier = absent()
    if (whole%has_slope) then
      one%log_multiplier = whole%log_slope
      ! The last step makes the load rise for longer.
      one%measure([period, stick_time]) = one%measure([period, stick_time]) &
        + whole%shift*step*[1.0_wp, 1.0_wp/real(one%repeats, wp)]
    end if
    if (one%measure(peak) - one%measure(valley) <= threshold*map%steps%slider%law%kinetic_limit) one%slow_cycles = 0
    cycle = one
  end subroutine improve

  !> The place of the stable cycle to which an orbit comes, 0 if there is none or it is not known.
  pure integer function place_of_end(orbit, cycles) result(place)
    type(orbit_t), intent(in) :: orbit
    type(full_cycle_t), intent(in) :: cycles(:)

    do place = 1, size(cycles)
      associate (one => cycles(place), last => size(orbit%release))
        if (.not. one%log_multiplier < 0.0_wp .or. last <= one%repeats) cycle
        if (minval(abs(one%release - orbit%release(last) - way_to_cycle(orbit, one%repeats))) <= alike) return
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

    allocate (cycles(0), orbit%release(0), orbit%slope(0))
    regularity%exponent = absent()
    regularity%error = absent()
    call map_of(steady(scene, velocity, searching), map, error)
    map%slips_expected = unknown
    if (present(watch)) map%watch => watch
    if (.not. allocated(error)) call map%first(start, orbit%goes_on, error)
    if (.not. allocated(error) .and. orbit%goes_on) call follow(map, start, followed, nowhere, cycles, orbit, error)
    if (allocated(error)) return
    regularity%slow_cycles = size(orbit%slope)
    regularity%repeats = orbit%repeats
    if (orbit%repeats > 0) then
      regularity%verdict = regular
      call take_end(orbit, cycles)
    else if (orbit%goes_on) then
      associate (known => pack(orbit%slope, .not. ieee_is_nan(orbit%slope)))
        call judge(log_of(known(size(known)/2 + 1:)), regularity%exponent, regularity%error, regularity%verdict)
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

  !> The scene under a steady drive, for as long as cycles may take.
  pure function steady(scene, velocity, tolerance) result(changed)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    real(wp), intent(in), optional :: tolerance     !! that of cycles if absent
    type(scene_t) :: changed

    changed = scene
    changed%model = 'full'
    changed%method = 'radau13'
    changed%rtol = rtol
    if (present(tolerance)) changed%rtol = tolerance
    changed%cycle_map = 'auto'
    changed%drive_time = [0.0_wp]
    changed%drive_velocity = [velocity]
    changed%step_max = 0.0_wp
    changed%settle = 0.0_wp
    changed%t_end = lengths*(scene%mu_0*scene%normal_load/(scene%stiffness_x*abs(velocity)) &
      + 2.0_wp*pi*sqrt(scene%mass/scene%stiffness_x))
  end function steady

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
    allocate (orbit%slope(0))
    do n = 1, most
      if (map%is_spent(share_of_orbit)) return
      call map%come_back(orbit%release(n), slow_cycle, slip, found, error)
      orbit%goes_on = found
      if (.not. found) orbit%goes_on = map%is_spent()
      if (allocated(error) .or. .not. found) return
      orbit%release = [orbit%release, slow_cycle%to]
      if (.not. slow_cycle%has_slope) slow_cycle%slope = absent()
      orbit%slope = [orbit%slope, slow_cycle%slope]
      orbit%time = orbit%time + slow_cycle%measure(duration)
      orbit%repeats = repeats_of(orbit)
      if (orbit%repeats > 0 .or. (slow_cycle%to >= range(1) .and. slow_cycle%to <= range(2))) return
      if (any([(cycles(i)%is_stable() .and. any(abs(cycles(i)%release - slow_cycle%to) <= alike), i=1, size(cycles))])) return
    end do
  end subroutine follow

  !> The number of slow cycles after which an orbit repeats, 0 if it does not.
  pure integer function repeats_of(orbit) result(m)
    type(orbit_t), intent(in) :: orbit

    do m = 1, min(most_repeats, size(orbit%slope))
      associate (last => size(orbit%release))
        if (abs(orbit%release(last) - orbit%release(last - m)) + abs(way_to_cycle(orbit, m)) <= missed) return
      end associate
    end do
    m = 0
  end function repeats_of

  !> The way [rad] from the last release of an orbit to the stable cycle of m slow cycles to which it comes: Newton's step, with the
  !> slopes that it has. Huge if there is no such cycle.
  pure real(wp) function way_to_cycle(orbit, m) result(way)
    type(orbit_t), intent(in) :: orbit
    integer, intent(in) :: m
    real(wp) :: slope

    associate (n => size(orbit%slope))
      slope = product(orbit%slope(n - m + 1:))
      way = orbit%release(n + 1) - orbit%release(n + 1 - m)
    end associate
    if (abs(slope) < 1.0_wp) then
      way = way*slope/(1.0_wp - slope)
    else if (.not. (ieee_is_nan(slope) .and. abs(way) <= same)) then
      way = huge(way)
    end if
  end function way_to_cycle

  !> The motion of a scene until its end: its outcome, and mean and scatter of its cycles.
  subroutine run(scene, regularity, outcome, error)
    type(scene_t), intent(in) :: scene
    type(regularity_t), intent(inout) :: regularity
    type(outcome_t), intent(out) :: outcome
    type(error_t), allocatable, intent(out) :: error
    class(motion_t), allocatable :: motion, other
    type(motion_summary_t) :: summary

    call new_motion(scene, motion, other, error)
    if (allocated(error)) return
    call summary%start(motion, scene%settle)
    do while (.not. motion%finished())
      call next_piece(motion, other, error)
      if (allocated(error)) return
      call summary%follow(motion)
    end do
    call summary%cycles%means(.false., regularity%cycles, regularity%mean, regularity%scatter)
    call summary%describe(motion, 0.0_wp, outcome)
  end subroutine run

  !> A motion that ceases to rest comes to a cycle without releases, or to steady sliding.
  subroutine look_at_the_end(scene, sliding_is_stable, cycles, regularity, error)
    type(scene_t), intent(in) :: scene
    logical, intent(in) :: sliding_is_stable
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(regularity_t), intent(inout) :: regularity
    type(error_t), allocatable, intent(out) :: error
    !> A motion that comes slowly to its cycle is followed for so many times as long, if differences then shrink until it repeats.
    !> Convention; twice: no change.
    real(wp), parameter :: patience = 8.0_wp
    type(scene_t) :: longer
    type(outcome_t) :: outcome
    logical :: repeats
    integer :: i

    longer = scene
    do i = 1, 2
      call run(longer, regularity, outcome, error)
      if (allocated(error)) return
      ! Values that do not exist are NaN, which nothing equals.
      repeats = abs(outcome%summary_of('regularity') - real(regular, wp)) + abs(outcome%summary_of('repeats') - 1.0_wp) < 0.5_wp
      if (repeats .or. regularity%cycles == 0) exit
      if (.not. outcome%summary_of('lyapunov_exponent')*patience*outcome%summary_of('cycles') < log(repeated)) exit
      longer%t_end = patience*scene%t_end
    end do
    regularity%swing = outcome%summary_of('swing')
    if (regularity%cycles == 0) then
      if (sliding_is_stable) regularity%verdict = steady_sliding
    else if (repeats) then
      regularity%exponent = outcome%summary_of('lyapunov_exponent')
      regularity%error = outcome%summary_of('lyapunov_error')
      if (.not. is_among(cycles, regularity%mean)) &
        cycles = [cycles, full_cycle_t(measure=regularity%mean, log_multiplier=regularity%exponent)]
      regularity%verdict = regular
      regularity%repeats = 1
    end if
  end subroutine look_at_the_end

  !> Add orbits that begin elsewhere, and the stable cycles to which they come. What fails in them fails not in the motion.
  subroutine explore(map, scene, orbits, cycles)
    type(release_map_t), intent(inout) :: map
    type(scene_t), intent(in) :: scene
    type(orbit_t), allocatable, intent(inout) :: orbits(:)
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    !> A passage that takes longer than so many lengths F_0/k_x of drive displacement, and as many periods, has no end. Convention;
    !> twice: no change.
    real(wp), parameter :: long = 10.0_wp
    type(error_t), allocatable :: error
    type(orbit_t) :: orbit
    type(scene_t) :: other
    type(regularity_t) :: unused
    real(wp) :: range(2), pull(2), lowest
    logical :: is_endless
    integer :: i, starts

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
        starts = merge(many, some, is_endless)
        ! Where differences only shrink, there is no other cycle.
        if (all(abs(orbits(1)%slope) < 1.0_wp)) starts = few
        call begin_between(minval(seen) - margin, maxval(seen) + margin, starts)
      end associate
    end associate

  contains

    subroutine begin_between(low, high, starts)
      real(wp), intent(in) :: low, high
      integer, intent(in) :: starts

      do i = starts, 1, -1
        call follow(map, low + (high - low)*(real(i, wp) - 0.5_wp)/real(starts, wp), explored, range, cycles, orbit, error)
        if (.not. allocated(error)) call take_end(orbit, cycles)
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
      real(wp) :: release(most_repeats), f, side
      integer :: iteration
      logical :: found

      side = sign(1.0_wp, f_b)
      bracket = bracket_t([a, b], [-1.0_wp, 1.0_wp])
      associate (x => release(1))
        x = bracket%middle()
        do iteration = 1, max_iterations
          call go_around(map, n, release, whole, found, error)
          if (allocated(error) .or. .not. found) return
          f = whole%to - x
          if (abs(f) <= fine) exit
          call bracket%narrow(x, side*f)
          if (bracket%width() <= fine) exit
          x = bracket%newton(x, side*f, side*(whole%slope - 1.0_wp))
        end do
      end associate
      if (abs(f) <= missed) call take(release(:n), whole%log_slope, cycles, map)
    end subroutine refine
  end subroutine find_between

  !> The cycle to which an orbit comes, if it does and the cycle is not known.
  subroutine take_end(orbit, cycles)
    type(orbit_t), intent(in) :: orbit
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)

    associate (n => size(orbit%slope), m => orbit%repeats)
      if (m > 0) call take(orbit%release(n + 2 - m:) + way_to_cycle(orbit, m), sum(log_of(orbit%slope(n - m + 1:))), cycles)
    end associate
  end subroutine take_end

  !> The logarithm of the size of a slope, which may be 0.
  elemental real(wp) function log_of(slope)
    real(wp), intent(in) :: slope

    log_of = log(abs(slope) + tiny(slope))
  end function log_of

  !> The cycle of slow cycles that begin with these releases [rad], with this logarithm of its multiplier, unless it is known; with
  !> a map, if it has this cycle, measured there.
  subroutine take(release, log_multiplier, cycles, map)
    real(wp), intent(in) :: release(:), log_multiplier
    type(full_cycle_t), allocatable, intent(inout) :: cycles(:)
    type(release_map_t), intent(inout), optional :: map
    type(full_cycle_t) :: cycle
    logical :: found
    integer :: i, m

    ! It may be one of fewer.
    do m = 1, size(release)
      if (modulo(size(release), m) == 0 .and. maxval(abs(cshift(release, m) - release)) <= alike) exit
    end do
    cycle%repeats = m
    cycle%slow_cycles = m
    cycle%release(:m) = cshift(release(:m), maxloc(release(:m), 1) - 1)
    if (any([(abs(cycles(i)%release(1) - cycle%release(1)) <= alike, i=1, size(cycles))])) return
    cycle%log_multiplier = log_multiplier*real(m, wp)/real(size(release), wp)
    found = .true.
    if (present(map)) call improve(map, cycle, found)
    if (found) cycles = [cycles, cycle]
  end subroutine take

  !> So many slow cycles, the first one from `release(1)`, as one passage, with the releases [rad] that begin them; and their
  !> measures.
  subroutine go_around(map, slow_cycles, release, whole, found, error, value)
    type(release_map_t), intent(inout) :: map
    integer, intent(in) :: slow_cycles
    real(wp), intent(inout) :: release(:)
    type(passage_t), intent(out) :: whole
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(out), optional :: value(measures)
    type(passage_t) :: one, slip, again
    type(extremum_t) :: high, low
    real(wp) :: each(measures, slow_cycles)
    integer :: i

    do i = 1, slow_cycles
      if (i > 1) release(i) = whole%to
      call map%come_back(release(i), one, slip, found, error)
      if (found .and. present(value) .and. .not. allocated(error)) then
        if (abs(map%ran - slip%from) > 0.0_wp) call map%run(slip%from, map%longest, again, found, error)
        if (.not. allocated(error)) call measure(map, one%measure(duration), each(:, i), high, low)
      end if
      if (allocated(error) .or. .not. found) return
      if (i == 1) whole = one
      if (i > 1) call whole%go_on(one)
    end do
    if (present(value)) value = sum(shares(each)*each, 2)
  end subroutine go_around

  !> What slow cycles have in the measures of all (measure, slow cycle): the period is that of all, the peak the highest, the valley
  !> the lowest; the others are means.
  pure function shares(each)
    real(wp), intent(in) :: each(:, :)
    real(wp) :: shares(size(each, 1), size(each, 2))

    shares = 1.0_wp/real(size(each, 2), wp)
    shares(period, :) = 1.0_wp
    shares([peak, valley], :) = 0.0_wp
    shares(peak, maxloc(each(peak, :), 1)) = 1.0_wp
    shares(valley, minloc(each(valley, :), 1)) = 1.0_wp
  end function shares

  !> The measures of a slow cycle of this duration [s] that ends with the slip that was run last: its load has its peak and its
  !> valley, as seen in the direction of the drive, in this slip.
  subroutine measure(map, lasting, value, high, low)
    type(release_map_t), intent(in) :: map
    real(wp), intent(in) :: lasting
    real(wp), intent(out) :: value(measures)
    type(extremum_t), intent(out) :: high, low
    type(piece_summary_t) :: slip
    type(piece_t) :: piece
    real(wp) :: falling
    integer :: i

    call begin_at_release(map%steps%slider, map%velocity, map%elongation(map%ran), slip)
    do i = 1, map%recording%count
      call map%recording%get(i, state_t(), piece)
      call slip%take_piece(map%steps, piece)
    end do
    high = slip%highest
    low = slip%lowest
    if (map%steps%slider%along(1)*map%velocity < 0.0_wp) then
      high = slip%lowest
      low = slip%highest
      high%load = -high%load
      low%load = -low%load
    end if
    falling = modulo(low%time - high%time, lasting)
    value = [lasting, high%load, low%load, lasting - falling, falling, sign(1.0_wp, map%velocity)*(low%position - high%position)]
  end subroutine measure
end module dst_full_cycles
