!> What a run amounts to: stick-slip cycles, largest velocity, rest, energy balance. Kept up to date
!> advance by advance, so that it needs no stored series.
!>
!> A stick-slip cycle is a fall and a rise of the longitudinal spring force k_x u_x by more than
!> `threshold` of the static limit F_0: the 1 kHz ripple of dynamic stiction stays far below it.
!>
!> What a motion settles to is told by its second half, from t_end/2 on: `swing` is 0 in steady sliding and the amplitude
!> of a stick-slip that goes on, `creep_share` the share of it in which the object looks at rest.
!>
!> Slip begins when the spring pulls harder along the soft axis than friction can hold in any direction,
!> |k_x u_x| > F(v); until then friction turns towards the soft axis and keeps the balance. `slip_angle` is how far it has come.
module dst_summary
  use dst_archive, only: archive_t
  use dst_kinds, only: wp, int64
  use dst_observables, only: slip_velocity, drive_velocity, direction_of
  use dst_stepper, only: motion_t, work_count_t
  use dst_trajectory, only: trajectory_t, stick_begins
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: summary_t, energies_t, start_summary, follow, consider, widen, note_creep, describe
  public :: summary_quantities, summary_values, values_with_energies, tiny_rate

  real(wp), parameter :: threshold = 0.01_wp
  !> An object that is slower than this share of the drive looks at rest.
  real(wp), parameter :: tiny_rate = 0.1_wp

  !> What may pass through zero inside an advance, see `level`.
  integer, parameter :: elongation_rate = 1, excess_rate = 2, excess_force = 3

  !> What `summary_values` gives, in its order.
  type(quantity_t), parameter :: summary_quantities(*) = [ &
    quantity_t('cycles', '1', 'completed stick-slip cycles, peak to peak'), &
    quantity_t('period', 's', 'mean time from peak to peak of k_x u_x'), &
    quantity_t('peak_force', 'N', 'mean peak of k_x u_x'), &
    quantity_t('valley_force', 'N', 'mean valley of k_x u_x'), &
    quantity_t('stick_duration', 's', 'mean time from valley to peak: dynamic stiction'), &
    quantity_t('slip_duration', 's', 'mean time from peak to valley'), &
    quantity_t('slip_length', 'm', 'mean advance in X from peak to valley'), &
    quantity_t('max_X_rate', 'm s-1', 'largest slip velocity along the drive'), &
    quantity_t('sticks', '1', 'times that the object came to rest, the start included'), &
    quantity_t('sticking_time', 's', 'time at rest'), &
    quantity_t('drive_work', 'J', 'work of the drive on the spring'), &
    quantity_t('friction_work', 'J', 'work done against friction'), &
    quantity_t('energy_residual', '1', 'open energy balance over all energy exchanged: first energy and absolute works'), &
    quantity_t('swing', 'N', 'largest less smallest k_x u_x in the second half of the run'), &
    quantity_t('creep_share', '1', 'share of the second half of the run with |X_rate| at most V/10'), &
    quantity_t('slip_angle', 'rad', 'angle of friction to the soft axis when |k_x u_x| first exceeds F(v)')]

  !> Mean of a quantity that comes one by one.
  type :: mean_t
    integer(int64) :: count = 0
    real(wp) :: sum = 0.0_wp
  contains
    procedure :: exchange => exchange_mean
  end type mean_t

  !> What is known of the run so far.
  type :: summary_t
    !> Stick-slip cycles: looking for a peak (or for a valley), and the best candidate so far.
    logical :: rising = .true.
    real(wp) :: extreme_force = -huge(1.0_wp)
    real(wp) :: extreme_time = 0.0_wp
    real(wp) :: extreme_position = 0.0_wp
    logical :: has_peak = .false., has_valley = .false.
    real(wp) :: peak_time = 0.0_wp, peak_position = 0.0_wp, valley_time = 0.0_wp
    type(mean_t) :: period, peak, valley, stick, slip, length
    real(wp) :: largest_rate = -huge(1.0_wp)
    real(wp) :: velocity(2) = 0.0_wp
    integer(int64) :: sticks = 0
    real(wp) :: sticking_time = 0.0_wp
    real(wp) :: first_energy = 0.0_wp
    !> The second half: extremes of k_x u_x, its length so far, and of it at rest or in creep.
    real(wp) :: late_highest = -huge(1.0_wp), late_lowest = huge(1.0_wp)
    real(wp) :: late_time = 0.0_wp, creep_time = 0.0_wp
    !> Whether slip has begun, and how friction pointed then [rad].
    logical :: has_slipped = .false.
    real(wp) :: slip_angle = 0.0_wp
    !> First energy and absolute works of all advances [J]. The net works may cancel out.
    real(wp) :: exchanged = 0.0_wp
  contains
    procedure :: exchange
  end type summary_t

  !> Energies [J] that a motion began with, has now, and has exchanged.
  type :: energies_t
    real(wp) :: first = 0.0_wp, now = 0.0_wp, drive_work = 0.0_wp, friction_work = 0.0_wp
  end type energies_t

contains

  !> Begin with a trajectory that has been started.
  subroutine start_summary(self, trajectory)
    type(summary_t), intent(out) :: self
    type(trajectory_t), intent(in) :: trajectory

    self%velocity = velocity_of(trajectory, trajectory%now, trajectory%sticking)
    self%largest_rate = dot_product(self%velocity, trajectory%slider%along)
    self%first_energy = energy(trajectory, self%velocity)
    self%exchanged = self%first_energy
    call consider_motion(self, trajectory, trajectory%now)
    if (trajectory%event == stick_begins) self%sticks = 1
  end subroutine start_summary

  !> Take in the trajectory's last advance.
  subroutine follow(self, trajectory)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp) :: before(2), ends(2)

    self%exchanged = self%exchanged + abs(trajectory%now%drive_work - trajectory%from%drive_work) + &
      abs(trajectory%now%friction_work - trajectory%from%friction_work)
    before = self%velocity
    self%velocity = velocity_of(trajectory, trajectory%now, trajectory%sticking)
    if (trajectory%event == stick_begins) self%sticks = self%sticks + 1
    if (trajectory%was_sticking) then
      self%sticking_time = self%sticking_time + (trajectory%now%time - trajectory%from%time)
    else
      ends = [level(elongation_rate, trajectory, trajectory%from, before), &
        level(elongation_rate, trajectory, trajectory%now, self%velocity)]
      if (ends(1)*ends(2) < 0.0_wp) call refine_extreme(self, trajectory, ends)
      call follow_rate(self, trajectory, before)
      call follow_slip(self, trajectory, before)
    end if
    if (is_late(trajectory, trajectory%now%time)) call follow_late(self, trajectory, before)
    call consider_motion(self, trajectory, trajectory%now)
  end subroutine follow

  pure function velocity_of(trajectory, motion, sticking) result(velocity)
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion
    logical, intent(in) :: sticking
    real(wp) :: velocity(2)

    velocity = 0.0_wp
    if (.not. sticking) velocity = slip_velocity(trajectory, motion)
  end function velocity_of

  !> What passes through zero: u_x' [m/s], |X'| - V/10 [m/s] or |k_x u_x| - F(v) [N], of a motion with this slip velocity.
  pure real(wp) function level(which, trajectory, motion, velocity)
    integer, intent(in) :: which
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion
    real(wp), intent(in) :: velocity(2)
    real(wp) :: force(1), slope(1)

    associate (slider => trajectory%slider)
      select case (which)
      case (elongation_rate)
        level = drive_velocity(trajectory, motion%time)*slider%along(1) - velocity(1)
        ! High frequency: the longitudinal load is given.
        if (.not. slider%follows(1) > 0.0_wp) level = 0.0_wp
      case (excess_rate)
        level = abs(dot_product(velocity, slider%along)) - tiny_rate*abs(drive_velocity(trajectory, motion%time))
      case default
        call slider%law%evaluate(1, [hypot(velocity(1), velocity(2))], force, slope)
        level = abs(slider%stiffness(1)*motion%u(1)) - force(1)
      end select
    end associate
  end function level

  !> The motion where a level passes through zero inside the last advance, by false position after Illinois: the end that
  !> stays loses half its weight.
  function motion_at_zero(which, trajectory, first, last, ends) result(motion)
    integer, intent(in) :: which
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: first, last       !! s
    real(wp), intent(in) :: ends(2)           !! values there, of opposite signs
    type(motion_t) :: motion
    real(wp) :: time(2), value(2), middle, found
    integer :: iteration, replaced

    time = [first, last]
    value = ends
    replaced = 0
    do iteration = 1, 40
      middle = (time(1)*value(2) - time(2)*value(1))/(value(2) - value(1))
      middle = min(time(2), max(time(1), middle))
      motion = trajectory%at(middle)
      found = level(which, trajectory, motion, slip_velocity(trajectory, motion))
      if (abs(found) <= 1.0e-7_wp*maxval(abs(ends))) exit
      if (found*value(1) > 0.0_wp) then
        time(1) = middle
        value(1) = found
        if (replaced == 1) value(2) = 0.5_wp*value(2)
        replaced = 1
      else
        time(2) = middle
        value(2) = found
        if (replaced == 2) value(1) = 0.5_wp*value(1)
        replaced = 2
      end if
      if (time(2) - time(1) <= 1.0e-8_wp*trajectory%stepper%step) exit
    end do
  end function motion_at_zero

  !> Kinetic and elastic energy [J], without that of a motion which the drive guides.
  pure real(wp) function energy(trajectory, velocity)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: velocity(2)

    real(wp) :: own(2)

    own = velocity
    if (abs(trajectory%system%guided) > 0.0_wp) own(2) = 0.0_wp
    energy = 0.5_wp*(trajectory%slider%mass*sum(own**2) + sum(trajectory%slider%stiffness*trajectory%now%u**2))
  end function energy

  !> If u_x passes inside the advance through an extreme that may count, take it in at its own time.
  subroutine refine_extreme(self, trajectory, rate)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: rate(2)
    real(wp) :: reach, side
    logical :: counts

    side = sign(1.0_wp, rate(1))
    reach = trajectory%slider%stiffness(1)*(trajectory%from%u(1) + 0.5_wp*(trajectory%now%time - trajectory%from%time)*rate(1))
    counts = (side > 0.0_wp .eqv. self%rising) .and. side*reach >= side*self%extreme_force
    if (is_late(trajectory, trajectory%now%time)) &
      counts = counts .or. reach > self%late_highest .or. reach < self%late_lowest
    if (counts) call consider_motion(self, trajectory, &
      motion_at_zero(elongation_rate, trajectory, trajectory%from%time, trajectory%now%time, rate))
  end subroutine refine_extreme

  !> Note how friction points when slip begins for the first time.
  subroutine follow_slip(self, trajectory, before)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: before(2)
    type(motion_t) :: motion
    real(wp) :: ends(2)

    if (self%has_slipped) return
    ends(2) = level(excess_force, trajectory, trajectory%now, self%velocity)
    if (.not. ends(2) > 0.0_wp) return
    ends(1) = level(excess_force, trajectory, trajectory%from, before)
    motion = trajectory%now
    if (ends(1) < 0.0_wp) motion = motion_at_zero(excess_force, trajectory, trajectory%from%time, trajectory%now%time, ends)
    self%slip_angle = direction_of(abs(slip_velocity(trajectory, motion)))
    self%has_slipped = .true.
  end subroutine follow_slip

  !> The second half of the run: its first instant, its time, and of that the time at rest or in creep.
  subroutine follow_late(self, trajectory, before)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: before(2)
    type(motion_t) :: first
    real(wp) :: velocity(2), ends(2), duration, crossing

    first = trajectory%from
    velocity = before
    if (.not. is_late(trajectory, first%time)) then
      first = trajectory%at(0.5_wp*trajectory%t_end)
      velocity = velocity_of(trajectory, first, trajectory%was_sticking)
      call widen(self, trajectory%slider%stiffness(1)*first%u(1))
    end if
    duration = trajectory%now%time - first%time
    ! Where the mass is tiny, steps may be shorter than the time can tell.
    if (.not. duration > 0.0_wp) return
    ends = 0.0_wp
    if (.not. trajectory%was_sticking) &
      ends = [level(excess_rate, trajectory, first, velocity), level(excess_rate, trajectory, trajectory%now, self%velocity)]
    crossing = 0.0_wp
    if (ends(1)*ends(2) < 0.0_wp) then
      associate (zero => motion_at_zero(excess_rate, trajectory, first%time, trajectory%now%time, ends))
        crossing = (zero%time - first%time)/duration
      end associate
    end if
    call note_creep(self, duration, ends, crossing)
  end subroutine follow_late

  !> Take in a stretch of the second half [s] with |X'| - V/10 at its ends; `crossing` is the share of it after which that passes
  !> through zero, if the ends have opposite signs.
  pure subroutine note_creep(self, duration, ends, crossing)
    type(summary_t), intent(inout) :: self
    real(wp), intent(in) :: duration, ends(2), crossing
    real(wp) :: share

    share = merge(1.0_wp, 0.0_wp, ends(2) <= 0.0_wp)
    if (ends(1)*ends(2) < 0.0_wp) share = merge(1.0_wp - crossing, crossing, ends(2) < 0.0_wp)
    self%late_time = self%late_time + duration
    self%creep_time = self%creep_time + share*duration
  end subroutine note_creep

  !> Take the longitudinal spring force [N] at one instant of the second half into its range.
  pure subroutine widen(self, force)
    type(summary_t), intent(inout) :: self
    real(wp), intent(in) :: force

    self%late_highest = max(self%late_highest, force)
    self%late_lowest = min(self%late_lowest, force)
  end subroutine widen

  pure logical function is_late(trajectory, time)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: time

    is_late = time >= 0.5_wp*trajectory%t_end
  end function is_late

  !> Take in the longitudinal spring force at one instant.
  subroutine consider_motion(self, trajectory, motion)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion

    if (is_late(trajectory, motion%time)) call widen(self, trajectory%slider%stiffness(1)*motion%u(1))
    call consider(self, trajectory%slider%stiffness(1)*motion%u(1), motion%time, motion%position, trajectory%slider%law%onset)
  end subroutine consider_motion

  !> Take in the longitudinal spring force [N] at a time [s] and position X [m]; `onset` is the static limit [N].
  pure subroutine consider(self, force, time, position, onset)
    type(summary_t), intent(inout) :: self
    real(wp), intent(in) :: force, time, position, onset
    real(wp) :: side

    side = merge(1.0_wp, -1.0_wp, self%rising)
    if (side*(force - self%extreme_force) >= 0.0_wp) then
      call set_extreme(self, force, time, position)
    else if (side*(self%extreme_force - force) > threshold*onset) then
      if (self%rising) then
        call confirm_peak(self)
      else
        call confirm_valley(self)
      end if
      self%rising = .not. self%rising
      call set_extreme(self, force, time, position)
    end if
  end subroutine consider

  pure subroutine set_extreme(self, force, time, position)
    type(summary_t), intent(inout) :: self
    real(wp), intent(in) :: force, time, position

    self%extreme_force = force
    self%extreme_time = time
    self%extreme_position = position
  end subroutine set_extreme

  pure subroutine confirm_peak(self)
    type(summary_t), intent(inout) :: self

    if (self%has_peak) call add(self%period, self%extreme_time - self%peak_time)
    if (self%has_valley) call add(self%stick, self%extreme_time - self%valley_time)
    call add(self%peak, self%extreme_force)
    self%has_peak = .true.
    self%peak_time = self%extreme_time
    self%peak_position = self%extreme_position
  end subroutine confirm_peak

  pure subroutine confirm_valley(self)
    type(summary_t), intent(inout) :: self

    self%has_valley = .true.
    self%valley_time = self%extreme_time
    call add(self%valley, self%extreme_force)
    call add(self%slip, self%extreme_time - self%peak_time)
    call add(self%length, self%extreme_position - self%peak_position)
  end subroutine confirm_valley

  pure subroutine add(mean, value)
    type(mean_t), intent(inout) :: mean
    real(wp), intent(in) :: value

    mean%count = mean%count + 1
    mean%sum = mean%sum + value
  end subroutine add

  !> Largest X': inside advances only where it may be exceeded.
  subroutine follow_rate(self, trajectory, before)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: before(2)
    real(wp) :: first, last, candidate
    integer, parameter :: probes = 8
    integer :: i, best
    real(wp) :: rates(0:probes)

    first = dot_product(before, trajectory%slider%along)
    last = dot_product(self%velocity, trajectory%slider%along)
    if (max(first, last) > self%largest_rate - 0.1_wp*abs(self%largest_rate)) then
      rates(0) = first
      rates(probes) = last
      do i = 1, probes - 1
        rates(i) = rate_at(trajectory, real(i, wp)/real(probes, wp))
      end do
      best = maxloc(rates, dim=1) - 1
      if (best > 0 .and. best < probes .and. rates(best) > self%largest_rate - 0.01_wp*abs(self%largest_rate)) then
        candidate = golden_maximum(trajectory, real(best - 1, wp)/real(probes, wp), real(best + 1, wp)/real(probes, wp))
        self%largest_rate = max(self%largest_rate, candidate)
      end if
      self%largest_rate = max(self%largest_rate, rates(best))
    end if
  end subroutine follow_rate

  !> X' at position tau of the last advance.
  real(wp) function rate_at(trajectory, tau)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: tau
    type(motion_t) :: motion

    motion = trajectory%at(trajectory%from%time + tau*(trajectory%now%time - trajectory%from%time))
    rate_at = dot_product(slip_velocity(trajectory, motion), trajectory%slider%along)
  end function rate_at

  !> Largest X' between two positions of the last advance, by golden-section search.
  real(wp) function golden_maximum(trajectory, left, right) result(largest)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: left, right
    real(wp), parameter :: ratio = 0.5_wp*(sqrt(5.0_wp) - 1.0_wp)
    real(wp) :: a, b, x, y, fx, fy
    integer :: iteration

    a = left
    b = right
    x = b - ratio*(b - a)
    y = a + ratio*(b - a)
    fx = rate_at(trajectory, x)
    fy = rate_at(trajectory, y)
    do iteration = 1, 30
      if (fx > fy) then
        b = y
        y = x
        fy = fx
        x = b - ratio*(b - a)
        fx = rate_at(trajectory, x)
      else
        a = x
        x = y
        fx = fy
        y = a + ratio*(b - a)
        fy = rate_at(trajectory, y)
      end if
    end do
    largest = max(fx, fy)
  end function golden_maximum

  !> Write summary and statistics into the outcome. A mean of nothing is left out, not invented.
  subroutine describe(self, trajectory, wall_time, outcome)
    type(summary_t), intent(in) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: wall_time
    type(outcome_t), intent(inout) :: outcome
    type(work_count_t) :: work
    real(wp) :: value(size(summary_quantities))
    logical :: given(size(summary_quantities))

    call summary_values(self, trajectory, value, given)
    outcome%summary = pack(summary_quantities, given)
    outcome%summary_value = pack(value, given)
    allocate (outcome%statistics(0), outcome%statistics_value(0))
    if (allocated(trajectory%stepper)) work = trajectory%stepper%count
    call put_count('steps', 'accepted steps', work%steps)
    call put_count('rejected', 'rejected steps', work%rejected)
    call put_count('rhs', 'evaluations of the equations of motion', work%rhs)
    call put_count('jacobians', 'evaluations of the Jacobian of a step', work%jacobians)
    call put_count('factorisations', 'factorised linear systems', work%factorisations)
    call put_count('newton', 'Newton iterations', work%newton)
    call put_count('events', 'stick and slip events', work%events)
    outcome%statistics = [outcome%statistics, quantity_t('wall_time', 's', 'wall time of the run')]
    outcome%statistics_value = [outcome%statistics_value, wall_time]

  contains

    subroutine put_count(name, long_name, count)
      character(*), intent(in) :: name, long_name
      integer(int64), intent(in) :: count

      outcome%statistics = [outcome%statistics, quantity_t(name, '1', long_name)]
      outcome%statistics_value = [outcome%statistics_value, real(count, wp)]
    end subroutine put_count
  end subroutine describe

  !> The values of all `summary_quantities`, and which of them this run has; the others are 0.
  subroutine summary_values(self, trajectory, value, given)
    type(summary_t), intent(in) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(out) :: value(:)
    logical, intent(out) :: given(:)

    if (allocated(trajectory%stepper)) then
      call values_with_energies(self, energies_t(self%first_energy, energy(trajectory, self%velocity), &
        trajectory%now%drive_work, trajectory%now%friction_work), value, given)
    else
      call values_with_energies(self, energies_t(), value, given)
      given(1) = .false.
      given(11:) = .false.
    end if
    where (.not. given) value = 0.0_wp
  end subroutine summary_values

  !> The same for a motion whose energies are known.
  subroutine values_with_energies(self, energies, value, given)
    type(summary_t), intent(in) :: self
    type(energies_t), intent(in) :: energies
    real(wp), intent(out) :: value(:)
    logical, intent(out) :: given(:)

    value = 0.0_wp
    given = .true.
    value(1) = real(self%period%count, wp)
    call put_mean(2, self%period)
    call put_mean(3, self%peak)
    call put_mean(4, self%valley)
    call put_mean(5, self%stick)
    call put_mean(6, self%slip)
    call put_mean(7, self%length)
    value(8) = self%largest_rate
    value(9) = real(self%sticks, wp)
    value(10) = self%sticking_time
    value(11) = energies%drive_work
    value(12) = energies%friction_work
    if (self%exchanged > 0.0_wp) &
      value(13) = (energies%drive_work - energies%friction_work - (energies%now - energies%first))/self%exchanged
    given(14:15) = self%late_time > 0.0_wp
    if (given(14)) value(14:15) = [self%late_highest - self%late_lowest, self%creep_time/self%late_time]
    given(16) = self%has_slipped
    value(16) = self%slip_angle

  contains

    subroutine put_mean(i, mean)
      integer, intent(in) :: i
      type(mean_t), intent(in) :: mean

      given(i) = mean%count > 0
      if (given(i)) value(i) = mean%sum/real(mean%count, wp)
    end subroutine put_mean
  end subroutine values_with_energies

  !> Save or load.
  subroutine exchange(self, archive)
    class(summary_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%exchange(self%rising)
    call archive%exchange(self%extreme_force)
    call archive%exchange(self%extreme_time)
    call archive%exchange(self%extreme_position)
    call archive%exchange(self%has_peak)
    call archive%exchange(self%has_valley)
    call archive%exchange(self%peak_time)
    call archive%exchange(self%peak_position)
    call archive%exchange(self%valley_time)
    call self%period%exchange(archive)
    call self%peak%exchange(archive)
    call self%valley%exchange(archive)
    call self%stick%exchange(archive)
    call self%slip%exchange(archive)
    call self%length%exchange(archive)
    call archive%exchange(self%largest_rate)
    call archive%exchange(self%velocity)
    call archive%exchange(self%sticks)
    call archive%exchange(self%sticking_time)
    call archive%exchange(self%first_energy)
    call archive%exchange(self%late_highest)
    call archive%exchange(self%late_lowest)
    call archive%exchange(self%late_time)
    call archive%exchange(self%creep_time)
    call archive%exchange(self%has_slipped)
    call archive%exchange(self%slip_angle)
    call archive%exchange(self%exchanged)
  end subroutine exchange

  subroutine exchange_mean(self, archive)
    class(mean_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%exchange(self%count)
    call archive%exchange(self%sum)
  end subroutine exchange_mean
end module dst_summary
