!> The summary of a run: stick-slip cycles (dst_cycles), largest velocity, rest, energy balance. It is updated after each advance,
!> so that it needs no stored series. Single runs and lanes use it: each passes an advance as a `stretch_t`.
!>
!> The mirror images of a scene, V -> -V and phi -> -phi, 180 deg - phi, 180 deg + phi, have the same summary: loads count in the
!> direction in which the drive pulls, lengths in that of the drive, velocities and angles by their size.
!>
!> The settled motion is described by its second half, from t_end/2 on: `swing` is 0 in steady sliding and the range (peak to
!> peak) of lasting stick-slip, `creep_share` the share of it in which the object seems to rest. If a run ends because it has
!> settled, all this, and the means, are those of the last cycle, from peak to peak. The values are properties of the motion
!> (dst_stretch) and do not depend on where steps end; a settled run ends in the next valley of the load for the same reason.
!>
!> Slip begins when the spring pulls harder along the soft axis than friction can balance in any direction, |k_x u_x| > F(v); until
!> then friction turns towards the soft axis and keeps the balance. `slip_angle` is the angle that friction has then.
module dst_summary
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_cycles, only: cycles_t, extremum_t, period, peak, valley, slip_time, rise, creep, measures, cycle_quantities, most_cycles
  use dst_divergence, only: undecided, steady_sliding, ringing_down
  use dst_interpolation, only: grid_t, chebyshev_grid, max_degree
  use dst_kinds, only: wp, int64
  use dst_stretch, only: stretch_t, moment_t, nowhere, most_turns
  use dst_writer, only: quantity_t, find_quantity, absent
  implicit none
  private

  public :: summary_t, contribution_t, energies_t
  public :: summary_quantities, summary_values

  !> The results of `summary_values`, in its order.
  type(quantity_t), parameter :: summary_quantities(*) = [ &
    quantity_t('cycles', '1', 'completed stick-slip cycles, peak to peak of the load'), &
    quantity_t('period', 's', 'mean time from peak to peak of the load, later half of the cycles'), &
    quantity_t('period_scatter', 's', 'standard deviation of period over these cycles'), &
    quantity_t('peak_force', 'N', 'mean peak of the load: k_x u_x, positive where the drive pulls'), &
    quantity_t('peak_force_scatter', 'N', 'standard deviation of peak_force over these cycles'), &
    quantity_t('valley_force', 'N', 'mean valley of the load'), &
    quantity_t('valley_force_scatter', 'N', 'standard deviation of valley_force over these cycles'), &
    quantity_t('stick_duration', 's', 'mean time from valley to peak: dynamic stiction'), &
    quantity_t('stick_duration_scatter', 's', 'standard deviation of stick_duration over these cycles'), &
    quantity_t('slip_duration', 's', 'mean time from peak to valley'), &
    quantity_t('slip_duration_scatter', 's', 'standard deviation of slip_duration over these cycles'), &
    quantity_t('slip_length', 'm', 'mean advance in X from peak to valley, positive with the drive'), &
    quantity_t('slip_length_scatter', 'm', 'standard deviation of slip_length over these cycles'), &
    quantity_t('first_peak_force', 'N', 'first peak of the load, after the stick at the start'), &
    quantity_t('max_X_rate', 'm/s', 'largest |X_rate|, slip speed along the drive'), &
    quantity_t('sticks', '1', 'times that the object came to rest, the start included'), &
    quantity_t('sticking_time', 's', 'time at rest'), &
    quantity_t('drive_work', 'J', 'work of the drive on the spring'), &
    quantity_t('friction_work', 'J', 'work done against friction'), &
    quantity_t('damper_work', 'J', 'work done on the dampers parallel to the springs; only with dampers'), &
    quantity_t('energy_residual', '1', 'error of the energy balance, relative to the total energy exchanged'), &
    quantity_t('swing', 'N', 'peak-to-peak value of k_x u_x in the second half of the run'), &
    quantity_t('pull_peak', 'N', 'largest pull force in the second half of the run: what a load cell shows; not with rodas4p'), &
    quantity_t('pull_valley', 'N', 'smallest pull force in the second half of the run'), &
    quantity_t('pull_swing', 'N', 'pull_peak minus pull_valley'), &
    quantity_t('pull_frequency', 'Hz', 'how often the pull force rises and falls by more than half of pull_swing'), &
    quantity_t('creep_share', '1', 'share of the second half of the run with |X_rate| at most V/10'), &
    quantity_t('slip_angle', 'rad', 'angle of friction to the soft axis when |k_x u_x| first exceeds F(v)'), &
    quantity_t('fast_decay', '1', 'D: the fast oscillation decays by exp(-D) before slip, in theory; full model, steady drive'), &
    quantity_t('undecided_from', 's', 'time from which only roundoff keeps or ends unstable steady sliding'), &
    quantity_t('settled_at', 's', 'when two cycles had agreed to scene.settle, which ended the run'), &
    quantity_t('repeats', '1', 'slow cycles after which the last ones repeat, to 1e-5; 0 if they do not after 1 to 16'), &
    quantity_t('lyapunov_exponent', '1', 'mean ln of the growth of a small difference in a slow cycle'), &
    quantity_t('lyapunov_error', '1', 'standard error of lyapunov_exponent'), &
    quantity_t('conditioning', '1', 'what a small relative error of each passage makes of the time at the end, over it'), &
    quantity_t('regularity', '1', '1 repeats, or differences shrink; -1 irregular, 2 steady sliding, 3 rings down, 0 undecided')]

  !> What a part of a motion adds to a summary.
  type :: contribution_t
    integer(int64) :: sticks = 0
    real(wp) :: sticking_time = 0.0_wp      !! s
    real(wp) :: exchanged = 0.0_wp          !! absolute works, J: net ones may cancel; of a run also its first energy
    real(wp) :: largest_rate = 0.0_wp       !! of |X'|, m/s
    !> Its length, and the time at rest or in creep in it [s]; of a run, those of the second half so far.
    real(wp) :: length = 0.0_wp, creep_time = 0.0_wp
  end type contribution_t

  !> The results of the run so far, without its cycles.
  type, extends(contribution_t) :: totals_t
    !> The end of the last rest [s].
    real(wp), private :: rested = 0.0_wp
    real(wp) :: first_energy = 0.0_wp
    !> The extremes of k_x u_x in the second half, which begins at `half` [s].
    real(wp) :: half = 0.0_wp
    type(extremum_t) :: highest = extremum_t(load=-huge(1.0_wp)), lowest = extremum_t(load=huge(1.0_wp))
    !> Permitted difference of two consecutive cycles in settled motion; 0 if settling is ignored. The time in creep so far [s], if
    !> it is not. The time of the peak at which the motion had settled, negative if it has not, and when the run ends then [s].
    real(wp), private :: settle = 0.0_wp, crept = 0.0_wp
    real(wp) :: settled_at = -1.0_wp, end_at = huge(1.0_wp)
    !> Whether slip has begun, and the angle of friction then [rad].
    logical :: has_slipped = .false.
    real(wp), private :: slip_angle = 0.0_wp
    !> D of dst_creep_end; negative if the scene has none.
    real(wp) :: fast_decay = -1.0_wp
    !> Time after which disturbances too small to be visible would have ended steady sliding [s]; negative if there is none.
    real(wp) :: undecided_from = -1.0_wp
    type(grid_t), private :: grid = grid_t()
  end type totals_t

  !> The results of the run so far.
  type, extends(totals_t) :: summary_t
    type(cycles_t) :: cycles = cycles_t()
  contains
    procedure :: begin
    procedure :: take_in
    procedure :: pass_over
    procedure :: follow_slip
    procedure :: add
    procedure :: may_settle
    procedure :: kept_cycles
    procedure :: without_cycles
    procedure :: serialise
  end type summary_t

  !> Energies [J] at the beginning of a motion and now, and the energy exchanged.
  type :: energies_t
    real(wp) :: first = 0.0_wp, now = 0.0_wp, drive_work = 0.0_wp, friction_work = 0.0_wp
    real(wp) :: damper_work = -1.0_wp           !! negative if there are no dampers
  end type energies_t

contains

  !> Begin with the motion at time 0, its energy [J], the end of the run [s], and the difference of two cycles that ends it earlier.
  subroutine begin(self, moment, energy, t_end, settle)
    class(summary_t), intent(inout) :: self
    type(moment_t), intent(in) :: moment
    real(wp), intent(in) :: energy, t_end
    real(wp), intent(in), optional :: settle

    self%grid = chebyshev_grid()
    self%largest_rate = abs(moment%rate)
    self%first_energy = energy
    self%exchanged = energy
    self%half = 0.5_wp*t_end
    if (present(settle)) self%settle = settle
    call widen(self, extremum_of(moment))
  end subroutine begin

  !> Process an advance.
  subroutine take_in(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp) :: load(0:max_degree)
    integer(int64) :: seen
    integer :: degree

    call stretch%load(degree, load)
    if (stretch%sticking) then
      self%sticking_time = self%sticking_time + stretch%duration()
      self%rested = stretch%last%time
    else
      self%largest_rate = stretch%largest_rate(self%grid, self%largest_rate)
      if (.not. self%has_slipped) call self%follow_slip(stretch, load(:degree))
    end if
    seen = self%cycles%count
    call follow_load(self, stretch, load(:degree))
    call follow_creep(self, stretch)
    if (self%settle > 0.0_wp .and. self%cycles%count > seen .and. self%settled_at < 0.0_wp) then
      ! A cycle is complete. If it agrees with the one before, the run ends in the next valley.
      if (.not. self%cycles%agree(1, 1, self%settle)) return
      self%settled_at = self%cycles%last_peak%time
      associate (now => stretch%last%time, cycle => self%cycles%last_cycle())
        self%end_at = self%settled_at + cycle(slip_time)
        if (self%end_at <= now) &
          self%end_at = self%end_at + cycle(period)*ceiling((now - self%end_at)/cycle(period) + epsilon(now))
      end associate
    end if
  end subroutine take_in

  !> Skip advances of a slide under a steady drive in which nothing turned back and nothing began, up to their end. The times [s],
  !> of these advances and of their creep, are those in the second half.
  subroutine pass_over(self, last, duration, creep_time)
    class(summary_t), intent(inout) :: self
    type(moment_t), intent(in) :: last
    real(wp), intent(in) :: duration, creep_time

    call take_load(self, extremum_of(last))
    self%length = self%length + duration
    self%creep_time = self%creep_time + creep_time
  end subroutine pass_over

  !> Add so many times a part of a motion that begins at a time [s] and a position X [m], and is in one half of the run; X advances
  !> by `advance` [m] in each. Of very many all but some are alike.
  subroutine add(self, part, turns, time, position, times, advance)
    class(summary_t), intent(inout) :: self
    class(contribution_t), intent(in) :: part
    type(extremum_t), intent(in) :: turns(:)   !! where the load turns back, and the end; from its beginning on
    real(wp), intent(in) :: time, position, advance
    integer(int64), intent(in) :: times
    integer(int64) :: done, skipped, seen
    integer :: i

    associate (n => real(times, wp), duration => part%length)
      self%sticks = self%sticks + times*part%sticks
      self%sticking_time = self%sticking_time + n*part%sticking_time
      if (part%sticks > 0) self%rested = time + n*duration
      self%exchanged = self%exchanged + n*part%exchanged
      self%largest_rate = max(self%largest_rate, part%largest_rate)
      if (self%settle > 0.0_wp) self%crept = self%crept + n*part%creep_time
      if (time >= self%half) then
        self%length = self%length + n*duration
        self%creep_time = self%creep_time + n*part%creep_time
      end if
      ! The cycles that are kept are then in the same places.
      skipped = max(0_int64, (times - 2*most_cycles)/most_cycles)*most_cycles
      done = 0
      do while (done < times)
        seen = self%cycles%count
        associate (begin => extremum_t(0.0_wp, time + real(done, wp)*duration, position + real(done, wp)*advance, self%crept))
          do i = 1, size(turns)
            call take_load(self, begin%plus(turns(i)))
          end do
        end associate
        done = done + 1
        if (done /= most_cycles .or. skipped == 0) cycle
        call self%cycles%skip(real(skipped, wp)*duration, real(skipped, wp)*advance, skipped*(self%cycles%count - seen))
        done = done + skipped
      end do
    end associate
  end subroutine add

  !> Whether the run ends when two cycles agree.
  pure logical function may_settle(self)
    class(summary_t), intent(in) :: self

    may_settle = self%settle > 0.0_wp
  end function may_settle

  !> The extremes of the load, with a cut where the drive reverses.
  subroutine follow_load(self, stretch, load)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: load(0:)   !! Bernstein coefficients, N
    real(wp) :: places(most_turns), reversal
    integer :: count, i
    logical :: reverses

    associate (first => stretch%first%drive_velocity, last => stretch%last%drive_velocity)
      reversal = nowhere
      reverses = first*last < 0.0_wp
      if (reverses) reversal = first/(first - last)
      ! At one of the ends V may be zero, or its roundoff.
      call self%cycles%pull(merge(first, first + last, reverses), extremum_of(stretch%first, self%crept))
      count = 0
      if (reverses .or. may_matter(self, minval(load), maxval(load))) call stretch%turning_places(self%grid, load, places, count)
      do i = 1, count
        if (places(i) > reversal) call turn_round()
        call take_load(self, extremum_at(self, stretch, places(i)))
      end do
      if (reversal < 1.0_wp) call turn_round()
      call take_load(self, extremum_at(self, stretch, 1.0_wp))
    end associate

  contains

    subroutine turn_round()
      type(extremum_t) :: here

      here = extremum_at(self, stretch, reversal)
      call take_load(self, here)
      call self%cycles%pull(stretch%last%drive_velocity, here)
      reversal = nowhere
    end subroutine turn_round
  end subroutine follow_load

  !> Whether a load between these two [N] may be an extreme that counts.
  pure logical function may_matter(self, lowest, highest)
    class(summary_t), intent(in) :: self
    real(wp), intent(in) :: lowest, highest

    may_matter = self%cycles%may_turn(lowest, highest) .or. highest > self%highest%load .or. lowest < self%lowest%load
  end function may_matter

  !> The load at a place of a stretch.
  type(extremum_t) function extremum_at(self, stretch, place)
    class(summary_t), intent(in) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: place
    type(moment_t) :: moment
    real(wp) :: crept

    moment = stretch%last
    if (place < 1.0_wp) moment = stretch%at(place)
    crept = self%crept
    if (self%settle > 0.0_wp) crept = crept + stretch%creep_time(self%grid, 0.0_wp, place)
    extremum_at = extremum_of(moment, crept)
  end function extremum_at

  !> Process a load.
  pure subroutine take_load(self, here)
    class(summary_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    call self%cycles%consider(here)
    call widen(self, here)
  end subroutine take_load

  !> Add a load to the range of the second half.
  pure subroutine widen(self, here)
    class(summary_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    if (here%time < self%half) return
    if (here%load > self%highest%load) self%highest = here
    if (here%load < self%lowest%load) self%lowest = here
  end subroutine widen

  !> The load at an instant, after this time in creep [s].
  pure type(extremum_t) function extremum_of(moment, creep)
    type(moment_t), intent(in) :: moment
    real(wp), intent(in), optional :: creep

    extremum_of = extremum_t(moment%force, moment%time, moment%position)
    if (present(creep)) extremum_of%creep = creep
  end function extremum_of

  !> Note the angle of friction when slip begins for the first time.
  subroutine follow_slip(self, stretch, load)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: load(0:)   !! Bernstein coefficients, N
    type(moment_t) :: moment
    real(wp) :: place
    !> A share of a stretch in which the direction of slip does not change.
    real(wp), parameter :: just_after = 1.0e-10_wp

    place = stretch%slip_begins_at(self%grid, load)
    if (place > 1.0_wp) return
    moment = stretch%at(place)
    ! A motion that begins at rest under more load than friction can balance has a direction just afterwards.
    if (.not. any(abs(moment%slip_velocity) > 0.0_wp)) moment = stretch%at(place + just_after)
    if (any(abs(moment%slip_velocity) > 0.0_wp)) &
      self%slip_angle = atan2(abs(moment%slip_velocity(2)), abs(moment%slip_velocity(1)))
    self%has_slipped = .true.
  end subroutine follow_slip

  !> The time at rest or in creep: of the second half, with its first instant, and of the whole motion if it may settle.
  subroutine follow_creep(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp) :: half

    ! If the mass is tiny, steps may be shorter than the resolution of the time.
    if (.not. stretch%duration() > 0.0_wp) return
    if (self%settle > 0.0_wp) self%crept = self%crept + stretch%creep_time(self%grid, 0.0_wp, 1.0_wp)
    if (stretch%last%time < self%half) return
    half = max(0.0_wp, (self%half - stretch%first%time)/stretch%duration())
    if (half > 0.0_wp) call widen(self, extremum_of(stretch%at(half)))
    self%length = self%length + (1.0_wp - half)*stretch%duration()
    self%creep_time = self%creep_time + stretch%creep_time(self%grid, half, 1.0_wp)
  end subroutine follow_creep

  !> The last cycles that count for the means, at most this many, (measure, cycle) as `cycle_quantities`, the oldest first.
  pure function kept_cycles(self, most) result(cycles)
    class(summary_t), intent(in) :: self
    integer, intent(in) :: most
    real(wp), allocatable :: cycles(:, :)

    cycles = self%cycles%last_cycles(min(most, self%cycles%lasting(self%settled_at >= 0.0_wp)))
  end function kept_cycles

  !> The values of all `summary_quantities`, NaN for those that this motion does not have. A motion in closed form has no energies
  !> and no cycles.
  subroutine summary_values(self, value, energies)
    type(summary_t), intent(in) :: self
    real(wp), intent(out) :: value(:)
    type(energies_t), intent(in), optional :: energies
    real(wp) :: mean(measures), scatter(measures)
    logical :: has_settled
    integer :: n, repeats, i

    value = absent()
    has_settled = self%settled_at >= 0.0_wp
    call put('max_X_rate', self%largest_rate)
    call put('sticks', real(self%sticks, wp))
    call put('sticking_time', self%sticking_time)
    if (.not. present(energies)) return
    call self%cycles%means(has_settled, n, mean, scatter)
    call put('cycles', real(self%cycles%count, wp))
    do i = 1, measures
      if (n > 0) call put(trim(cycle_quantities(i)%name), mean(i))
      if (n > 1) call put(trim(cycle_quantities(i)%name)//'_scatter', scatter(i))
    end do
    repeats = self%cycles%repeats()
    if (has_settled) repeats = 1
    if (has_settled .or. (n > 0 .and. self%cycles%count > 2)) call put('repeats', real(repeats, wp))
    if (self%cycles%has_peaked) call put('first_peak_force', self%cycles%first_peak)
    call put('drive_work', energies%drive_work)
    call put('friction_work', energies%friction_work)
    if (energies%damper_work >= 0.0_wp) call put('damper_work', energies%damper_work)
    call put('energy_residual', 0.0_wp)
    if (self%exchanged > 0.0_wp) call put('energy_residual', (energies%drive_work - energies%friction_work &
      - max(0.0_wp, energies%damper_work) - (energies%now - energies%first))/self%exchanged)
    if (has_settled) then
      associate (cycle => self%cycles%last_cycle())
        call put('swing', max(cycle(peak) - cycle(valley), cycle(rise)))
        call put('creep_share', cycle(creep)/cycle(period))
      end associate
      call put('settled_at', self%settled_at)
    else if (self%length > 0.0_wp) then
      call put('swing', self%highest%load - self%lowest%load)
      call put('creep_share', self%creep_time/self%length)
    end if
    if (self%has_slipped) call put('slip_angle', self%slip_angle)
    if (self%fast_decay >= 0.0_wp) call put('fast_decay', self%fast_decay)
    if (self%undecided_from >= 0.0_wp) call put('undecided_from', self%undecided_from)

  contains

    subroutine put(name, number)
      character(*), intent(in) :: name
      real(wp), intent(in) :: number

      value(find_quantity(summary_quantities, name)) = number
    end subroutine put
  end subroutine summary_values

  !> What a motion is under a steady drive if it has no cycles that last.
  pure integer function without_cycles(self) result(verdict)
    class(summary_t), intent(in) :: self

    verdict = undecided
    if (self%cycles%lasting(self%settled_at >= 0.0_wp) > 0) return
    if (self%cycles%count > 0) verdict = ringing_down
    if (.not. self%cycles%slides()) return
    ! The fast oscillation alone, which stops in each period, is on its way.
    verdict = merge(steady_sliding, undecided, self%cycles%is_long_ago(self%rested))
  end function without_cycles

  !> Save or load.
  subroutine serialise(self, archive)
    class(summary_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(c_loc(self%totals_t), storage_size(self%totals_t))
    call archive%serialise(c_loc(self%cycles%recent_cycles_t), storage_size(self%cycles%recent_cycles_t))
  end subroutine serialise
end module dst_summary
