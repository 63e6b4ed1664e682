!> What a run amounts to: stick-slip cycles, largest velocity, rest, energy balance. Kept up to date
!> advance by advance, so that it needs no stored series.
!>
!> A stick-slip cycle is a fall and a rise of the longitudinal spring force k_x u_x by more than
!> `threshold` of the static limit F_0: the 1 kHz ripple of dynamic stiction stays far below it.
module dst_summary
  use dst_archive, only: archive_t
  use dst_kinds, only: wp, int64
  use dst_observables, only: slip_velocity, drive_velocity
  use dst_stepper, only: motion_t, work_count_t
  use dst_trajectory, only: trajectory_t, stick_begins
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: summary_t, start_summary, follow, describe, summary_quantities, summary_values

  real(wp), parameter :: threshold = 0.01_wp

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
    quantity_t('energy_residual', '1', 'open energy balance over all energy exchanged: first energy and absolute works')]

  !> Mean of a quantity that comes one by one.
  type :: mean_t
    integer(int64) :: count = 0
    real(wp) :: sum = 0.0_wp
  contains
    procedure :: exchange => exchange_mean
  end type mean_t

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
    !> First energy and absolute works of all advances [J]. The net works may cancel out.
    real(wp) :: exchanged = 0.0_wp
  contains
    procedure :: exchange
  end type summary_t

contains

  !> Begin with a trajectory that has been started.
  subroutine start_summary(self, trajectory)
    type(summary_t), intent(out) :: self
    type(trajectory_t), intent(in) :: trajectory

    self%velocity = velocity_of(trajectory, trajectory%now, trajectory%sticking)
    self%largest_rate = dot_product(self%velocity, trajectory%slider%along)
    self%first_energy = energy(trajectory, self%velocity)
    self%exchanged = self%first_energy
    call consider(self, trajectory, trajectory%now)
    if (trajectory%event == stick_begins) self%sticks = 1
  end subroutine start_summary

  !> Take in the trajectory's last advance.
  subroutine follow(self, trajectory)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp) :: before(2), rate(2)

    self%exchanged = self%exchanged + abs(trajectory%now%drive_work - trajectory%from%drive_work) + &
      abs(trajectory%now%friction_work - trajectory%from%friction_work)
    before = self%velocity
    self%velocity = velocity_of(trajectory, trajectory%now, trajectory%sticking)
    if (trajectory%event == stick_begins) self%sticks = self%sticks + 1
    if (trajectory%was_sticking) then
      self%sticking_time = self%sticking_time + (trajectory%now%time - trajectory%from%time)
    else
      rate = [elongation_rate(trajectory, trajectory%from%time, before(1)), &
        elongation_rate(trajectory, trajectory%now%time, self%velocity(1))]
      if (rate(1)*rate(2) < 0.0_wp) call refine_extreme(self, trajectory, rate)
      call follow_rate(self, trajectory, before)
    end if
    call consider(self, trajectory, trajectory%now)
  end subroutine follow

  pure function velocity_of(trajectory, motion, sticking) result(velocity)
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion
    logical, intent(in) :: sticking
    real(wp) :: velocity(2)

    velocity = 0.0_wp
    if (.not. sticking) velocity = slip_velocity(trajectory, motion)
  end function velocity_of

  !> u_x' [m/s].
  pure real(wp) function elongation_rate(trajectory, time, slip)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: time, slip

    elongation_rate = drive_velocity(trajectory, time)*trajectory%slider%along(1) - slip
    ! High frequency: the longitudinal load is given.
    if (.not. trajectory%slider%follows(1) > 0.0_wp) elongation_rate = 0.0_wp
  end function elongation_rate

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
    type(motion_t) :: motion
    real(wp) :: time(2), slope(2), middle, found, velocity(2), reach, side
    integer :: iteration, replaced

    side = merge(1.0_wp, -1.0_wp, self%rising)
    if (side*rate(1) < 0.0_wp) return
    time = [trajectory%from%time, trajectory%now%time]
    slope = rate
    reach = side*trajectory%from%u(1) + 0.5_wp*(time(2) - time(1))*side*rate(1)
    if (trajectory%slider%stiffness(1)*reach < side*self%extreme_force) return
    ! False position after Illinois: the end that stays loses half its weight.
    replaced = 0
    do iteration = 1, 40
      middle = (time(1)*slope(2) - time(2)*slope(1))/(slope(2) - slope(1))
      middle = min(time(2), max(time(1), middle))
      motion = trajectory%at(middle)
      velocity = slip_velocity(trajectory, motion)
      found = elongation_rate(trajectory, middle, velocity(1))
      if (abs(found) <= 1.0e-7_wp*maxval(abs(rate))) exit
      if (found*slope(1) > 0.0_wp) then
        time(1) = middle
        slope(1) = found
        if (replaced == 1) slope(2) = 0.5_wp*slope(2)
        replaced = 1
      else
        time(2) = middle
        slope(2) = found
        if (replaced == 2) slope(1) = 0.5_wp*slope(1)
        replaced = 2
      end if
      if (time(2) - time(1) <= 1.0e-8_wp*trajectory%stepper%step) exit
    end do
    call consider(self, trajectory, motion)
  end subroutine refine_extreme

  !> Take in the longitudinal spring force at one instant.
  subroutine consider(self, trajectory, motion)
    type(summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion
    real(wp) :: force, side

    force = trajectory%slider%stiffness(1)*motion%u(1)
    side = merge(1.0_wp, -1.0_wp, self%rising)
    if (side*(force - self%extreme_force) >= 0.0_wp) then
      call set_extreme(self, force, motion)
    else if (side*(self%extreme_force - force) > threshold*trajectory%slider%law%onset) then
      if (self%rising) then
        call confirm_peak(self)
      else
        call confirm_valley(self)
      end if
      self%rising = .not. self%rising
      call set_extreme(self, force, motion)
    end if
  end subroutine consider

  pure subroutine set_extreme(self, force, motion)
    type(summary_t), intent(inout) :: self
    real(wp), intent(in) :: force
    type(motion_t), intent(in) :: motion

    self%extreme_force = force
    self%extreme_time = motion%time
    self%extreme_position = motion%position
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
    if (max(first, last) > 0.9_wp*self%largest_rate) then
      rates(0) = first
      rates(probes) = last
      do i = 1, probes - 1
        rates(i) = rate_at(trajectory, real(i, wp)/real(probes, wp))
      end do
      best = maxloc(rates, dim=1) - 1
      if (best > 0 .and. best < probes .and. rates(best) > 0.99_wp*self%largest_rate) then
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
    real(wp) :: change

    value = 0.0_wp
    given = .true.
    value(1) = real(self%period%count, wp)
    given(1) = allocated(trajectory%stepper)
    call put_mean(2, self%period)
    call put_mean(3, self%peak)
    call put_mean(4, self%valley)
    call put_mean(5, self%stick)
    call put_mean(6, self%slip)
    call put_mean(7, self%length)
    value(8) = self%largest_rate
    value(9) = real(self%sticks, wp)
    value(10) = self%sticking_time
    given(11:) = allocated(trajectory%stepper)
    if (.not. allocated(trajectory%stepper)) return
    change = energy(trajectory, self%velocity) - self%first_energy
    value(11) = trajectory%now%drive_work
    value(12) = trajectory%now%friction_work
    if (self%exchanged > 0.0_wp) &
      value(13) = (trajectory%now%drive_work - trajectory%now%friction_work - change)/self%exchanged

  contains

    subroutine put_mean(i, mean)
      integer, intent(in) :: i
      type(mean_t), intent(in) :: mean

      given(i) = mean%count > 0
      if (given(i)) value(i) = mean%sum/real(mean%count, wp)
    end subroutine put_mean
  end subroutine summary_values

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
    call archive%exchange(self%exchanged)
  end subroutine exchange

  subroutine exchange_mean(self, archive)
    class(mean_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%exchange(self%count)
    call archive%exchange(self%sum)
  end subroutine exchange_mean
end module dst_summary
