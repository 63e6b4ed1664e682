!> The summary of a run: stick-slip cycles (dst_cycles), largest velocity, rest, energy balance. It is updated after each advance,
!> so that it needs no stored series. Single runs and lanes use it: each passes an advance as a `stretch_t`.
!>
!> The mirror images of a scene, V -> -V and phi -> -phi, 180 deg - phi, 180 deg + phi, have the same summary: loads count in the
!> direction in which the drive pulls, lengths in that of the drive, velocities and angles by their size.
!>
!> The settled motion is described by its second half, from t_end/2 on: `swing` is 0 in steady sliding and the amplitude (peak to
!> peak) of lasting stick-slip, `creep_share` the share of it in which the object seems to rest. If a run ends because it has
!> settled, the last cycle is used instead of the second half.
!>
!> Slip begins when the spring pulls harder along the soft axis than friction can balance in any direction, |k_x u_x| > F(v); until
!> then friction turns towards the soft axis and keeps the balance. `slip_angle` is the angle that friction has then.
module dst_summary
  use dst_archive, only: archive_t
  use dst_cycles, only: cycles_t, extremum_t, period, peak, valley, stick_time, slip_time, slip_length, measures
  use dst_kinds, only: wp, int64
  use dst_roots, only: bracket_t
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: summary_t, energies_t, moment_t, stretch_t, passage_t
  public :: summary_quantities, summary_values
  public :: tiny_rate, short, creeping, worth_parts, near

  !> An object that is slower than this share of the drive velocity seems to rest.
  real(wp), parameter :: tiny_rate = 0.1_wp
  integer, parameter :: most_parts = 8
  !> X' and the load may turn between the ends of an advance that is longer than this share of the soft spring's period, while the
  !> object is faster than this share of the drive velocity. Convention.
  real(wp), parameter :: short = 0.25_wp, creeping = 0.5_wp
  !> Where the largest |X'| is searched: only if an end reaches the first share of the largest so far, and a part the second.
  real(wp), parameter :: worth_parts = 0.9_wp, worth_refining = 0.99_wp
  !> Slip is searched if this share more of |k_x u_x| would exceed F(v). Convention.
  real(wp), parameter :: near = 0.5_wp
  !> A zero is found to this share of the values at the ends, or of the advance's time: far below the digits of the results.
  real(wp), parameter :: close_to_zero = 1.0e-7_wp, close_in_time = 1.0e-8_wp
  integer, parameter :: most_iterations = 40
  !> Permitted difference of a window from whole cycles, relative to it. Convention: its share of creep has this accuracy.
  real(wp), parameter :: alike = 1.0e-3_wp

  !> Quantities that may pass through zero inside a stretch, see `crossing_value`.
  integer, parameter :: elongation_rate = 1, excess_rate = 2, excess_force = 3, rate = 4

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
    quantity_t('swing', 'N', 'peak-to-peak amplitude of k_x u_x in the second half of the run'), &
    quantity_t('creep_share', '1', 'share of the second half of the run with |X_rate| at most V/10'), &
    quantity_t('slip_angle', 'rad', 'angle of friction to the soft axis when |k_x u_x| first exceeds F(v)'), &
    quantity_t('fast_decay', '1', 'D: the fast oscillation decays by exp(-D) before slip, in theory; full model, steady drive'), &
    quantity_t('undecided_from', 's', 'time from which only roundoff keeps or ends unstable steady sliding'), &
    quantity_t('settled_at', 's', 'when two cycles had agreed to scene.settle, which ended the run'), &
    quantity_t('lyapunov_exponent', '1', 'mean ln of the growth of a small difference in a slow cycle'), &
    quantity_t('lyapunov_error', '1', 'standard error of lyapunov_exponent'), &
    quantity_t('regularity', '1', '1 regular, -1 irregular, 0 undecided: the sign of lyapunov_exponent')]

  !> A part of a run: the extremes of k_x u_x, its length so far, and the length at rest or in creep.
  type :: window_t
    type(extremum_t) :: highest = extremum_t(load=-huge(1.0_wp)), lowest = extremum_t(load=huge(1.0_wp))
    real(wp) :: length = 0.0_wp, creep_time = 0.0_wp    !! s
  contains
    procedure :: widen => widen_window
    procedure :: serialise => serialise_window
  end type window_t

  !> The results of the run so far.
  type :: summary_t
    type(cycles_t) :: cycles = cycles_t()
    real(wp) :: largest_rate = 0.0_wp
    integer(int64) :: sticks = 0
    real(wp) :: sticking_time = 0.0_wp
    real(wp) :: first_energy = 0.0_wp
    !> First energy and absolute works of all advances [J]. The net works may cancel.
    real(wp) :: exchanged = 0.0_wp
    !> The second half, which begins at `half` [s].
    real(wp) :: half = 0.0_wp
    type(window_t), private :: late = window_t()
    !> Permitted difference of two consecutive cycles in settled motion; 0 if settling is ignored. The time at which it settled [s];
    !> negative if it did not. The present cycle: if the motion settled it replaces the second half.
    real(wp), private :: settle = 0.0_wp
    real(wp) :: settled_at = -1.0_wp
    type(window_t), private :: this_cycle = window_t()
    integer(int64), private :: cycles_seen = 0
    !> Whether slip has begun, and the angle of friction then [rad].
    logical :: has_slipped = .false.
    real(wp), private :: slip_angle = 0.0_wp
    !> D of dst_creep_end; negative if the scene has none.
    real(wp) :: fast_decay = -1.0_wp
    !> Time after which disturbances too small to be visible would have ended steady sliding [s]; negative if there is none.
    real(wp) :: undecided_from = -1.0_wp
  contains
    procedure :: begin
    procedure :: take_in
    procedure :: pass_over
    procedure :: follow_slip
    procedure :: passage
    procedure :: add
    procedure :: kept_cycles
    procedure :: serialise
  end type summary_t

  !> The contribution of a passage from rest to rest to a summary: a leap of the cycle map, or one of its cycles. Times and
  !> positions count from its beginning.
  type :: passage_t
    real(wp) :: duration = 0.0_wp           !! s
    integer(int64) :: sticks = 0
    real(wp) :: sticking_time = 0.0_wp      !! s
    real(wp) :: creep_time = 0.0_wp         !! at rest or in creep, s
    real(wp) :: exchanged = 0.0_wp          !! J
    real(wp) :: largest_rate = 0.0_wp       !! of |X'|, m/s
    type(extremum_t) :: highest, lowest     !! of the load
    !> Points at which the load turns back, with beginning and end.
    type(extremum_t), allocatable :: turns(:)
  end type passage_t

  !> The motion at one instant, in the form that the summary uses.
  type :: moment_t
    real(wp) :: time = 0.0_wp               !! s
    real(wp) :: position = 0.0_wp           !! X, m
    real(wp) :: rate = 0.0_wp               !! X', m/s
    real(wp) :: slip_velocity(2) = 0.0_wp   !! m/s
    real(wp) :: force = 0.0_wp              !! k_x u_x, N
    real(wp) :: force_rate = 0.0_wp         !! its derivative, N/s
    real(wp) :: drive_velocity = 0.0_wp     !! V, m/s
  end type moment_t

  !> One advance of a motion: its ends, and the motion between them.
  type, abstract :: stretch_t
    type(moment_t) :: first, last
    logical :: sticking = .false.
    !> Number of parts in which X' and the load are evaluated if they may turn between the ends.
    integer :: parts = most_parts
  contains
    procedure(moment_inside), deferred :: at
    procedure(friction_at), deferred :: friction
  end type stretch_t

  abstract interface
    !> The motion at a time between the ends [s].
    function moment_inside(self, time) result(moment)
      import :: stretch_t, moment_t, wp
      class(stretch_t), intent(in) :: self
      real(wp), intent(in) :: time
      type(moment_t) :: moment
    end function moment_inside

    !> F(v) [N] at a slip speed [m/s].
    pure real(wp) function friction_at(self, speed)
      import :: stretch_t, wp
      class(stretch_t), intent(in) :: self
      real(wp), intent(in) :: speed
    end function friction_at
  end interface

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

    if (stretch%sticking) then
      self%sticking_time = self%sticking_time + (stretch%last%time - stretch%first%time)
    else
      call follow_rate(self, stretch)
      call follow_slip(self, stretch)
    end if
    call follow_force(self, stretch)
    call follow_creep(self, stretch)
    if (self%settle > 0.0_wp) call look_whether_settled(self, stretch%last%time)
  end subroutine take_in

  !> Skip advances of a slide under a steady drive in which nothing turned back and nothing began, up to their end. The times [s],
  !> of these advances and of their creep, are those in the second half.
  subroutine pass_over(self, last, duration, creep_time)
    class(summary_t), intent(inout) :: self
    type(moment_t), intent(in) :: last
    real(wp), intent(in) :: duration, creep_time

    call take_force(self, last)
    call lengthen(self%late, duration, creep_time)
  end subroutine pass_over

  !> Everything processed since the beginning, at time 0 and X = 0, as a passage.
  pure function passage(self)
    class(summary_t), intent(in) :: self
    type(passage_t) :: passage

    passage%duration = self%late%length
    passage%sticks = self%sticks
    passage%sticking_time = self%sticking_time
    passage%creep_time = self%late%creep_time
    passage%exchanged = self%exchanged
    passage%largest_rate = self%largest_rate
    passage%highest = self%late%highest
    passage%lowest = self%late%lowest
    if (allocated(self%cycles%turns)) passage%turns = self%cycles%turns(:self%cycles%turn_count)
  end function passage

  !> Add a passage that begins at a time [s] and a position X [m], and is in one half of the run.
  subroutine add(self, passage, time, position, end)
    class(summary_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    real(wp), intent(in) :: time, position
    real(wp), intent(in) :: end               !! of the passage, s
    integer :: i

    self%sticks = self%sticks + passage%sticks
    self%sticking_time = self%sticking_time + passage%sticking_time
    self%exchanged = self%exchanged + passage%exchanged
    self%largest_rate = max(self%largest_rate, passage%largest_rate)
    do i = 1, size(passage%turns)
      associate (turn => passage%turns(i))
        call self%cycles%consider(turn%load, time + turn%time, position + turn%position)
        call widen(self, extremum_t(turn%load, time + turn%time, position + turn%position))
      end associate
    end do
    if (time >= self%half) call lengthen(self%late, passage%duration, passage%creep_time)
    if (.not. self%settle > 0.0_wp) return
    call lengthen(self%this_cycle, passage%duration, passage%creep_time)
    call look_whether_settled(self, end)
  end subroutine add

  !> After each cycle: whether it agrees with the one before. Then the window since then replaces the second half of the run, which
  !> ends at this time [s]. The window ends with the step, or the leap, in which the cycle was completed: if that is not whole
  !> cycles after its beginning, the next cycle is added, too, so that the difference is a smaller part of the window.
  subroutine look_whether_settled(self, time)
    class(summary_t), intent(inout) :: self
    real(wp), intent(in) :: time

    if (self%cycles%count == self%cycles_seen .or. self%settled_at >= 0.0_wp) return
    self%cycles_seen = self%cycles%count
    if (self%cycles%agree(self%settle)) then
      associate (length => self%this_cycle%length, period => self%cycles%last_period())
        if (abs(length - max(1.0_wp, anint(length/period))*period) > alike*length) return
      end associate
      self%settled_at = time
      self%late = self%this_cycle
    end if
    self%this_cycle = window_t()
  end subroutine look_whether_settled

  !> The quantity that passes through zero: k_x u_x' [N/s], X' [m/s], |X'| - V/10 [m/s] or |k_x u_x| - F(v) [N].
  real(wp) function crossing_value(which, stretch, moment)
    integer, intent(in) :: which
    class(stretch_t), intent(in) :: stretch
    type(moment_t), intent(in) :: moment

    select case (which)
    case (elongation_rate)
      crossing_value = moment%force_rate
    case (rate)
      crossing_value = moment%rate
    case (excess_rate)
      crossing_value = abs(moment%rate) - tiny_rate*abs(moment%drive_velocity)
    case default
      crossing_value = abs(moment%force) - stretch%friction(hypot(moment%slip_velocity(1), moment%slip_velocity(2)))
    end select
  end function crossing_value

  !> The motion where a crossing value passes through zero between two times [s], by false positions.
  function moment_at_zero(which, stretch, first, last, ends) result(moment)
    integer, intent(in) :: which
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: first, last
    real(wp), intent(in) :: ends(2)           !! values there, of opposite signs
    type(moment_t) :: moment
    type(bracket_t) :: bracket
    real(wp) :: time, value
    integer :: iteration

    bracket = bracket_t([first, last], ends)
    do iteration = 1, most_iterations
      time = min(bracket%x(2), max(bracket%x(1), bracket%false_position()))
      moment = stretch%at(time)
      value = crossing_value(which, stretch, moment)
      if (abs(value) <= close_to_zero*maxval(abs(ends))) exit
      call bracket%narrow(time, value)
      if (bracket%width() <= close_in_time*(stretch%last%time - stretch%first%time)) exit
    end do
  end function moment_at_zero

  !> The extrema of the load. A step of a method of high order may contain two of them, unless the object creeps.
  subroutine follow_force(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    type(moment_t) :: from, to
    integer :: i

    associate (first => stretch%first, last => stretch%last, n => real(stretch%parts, wp))
      if (stretch%sticking .or. last%time - first%time <= short*self%cycles%natural_time .or. &
        max(abs(first%rate), abs(last%rate)) <= creeping*max(abs(first%drive_velocity), abs(last%drive_velocity))) then
        call follow_part(self, stretch, first, last)
        return
      end if
      from = first
      do i = 1, stretch%parts - 1
        to = stretch%at(first%time + (last%time - first%time)*real(i, wp)/n)
        call follow_part(self, stretch, from, to)
        from = to
      end do
      call follow_part(self, stretch, from, last)
    end associate
  end subroutine follow_force

  !> The extrema of the load between two instants, with a cut where the drive reverses.
  subroutine follow_part(self, stretch, first, last)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    type(moment_t), intent(in) :: first, last
    type(moment_t) :: reversal

    if (first%drive_velocity*last%drive_velocity < 0.0_wp) then
      reversal = stretch%at(first%time + (last%time - first%time)*first%drive_velocity &
        /(first%drive_velocity - last%drive_velocity))
      call follow_row(self, stretch, first, reversal)
      call follow_row(self, stretch, reversal, last)
    else
      call follow_row(self, stretch, first, last)
    end if
  end subroutine follow_part

  !> The extrema of the load between two instants between which the drive keeps its direction.
  subroutine follow_row(self, stretch, first, last)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    type(moment_t), intent(in) :: first, last

    ! At one of the ends V may be zero, or its roundoff.
    call self%cycles%pull(first%drive_velocity + last%drive_velocity, first%force, first%time, first%position)
    if (.not. stretch%sticking .and. first%force_rate*last%force_rate < 0.0_wp) call refine_extreme(self, stretch, first, last)
    call take_force(self, last)
  end subroutine follow_row

  !> If k_x u_x passes between two instants through an extreme that may count, process it at its own time.
  subroutine refine_extreme(self, stretch, first, last)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    type(moment_t), intent(in) :: first, last
    real(wp) :: force_ahead

    ! A load whose rise slows down is below its tangent.
    force_ahead = first%force + (last%time - first%time)*first%force_rate
    if (self%cycles%may_be_extremum(first%force_rate > 0.0_wp, force_ahead) .or. &
      (last%time >= self%half .and. (force_ahead > self%late%highest%load .or. force_ahead < self%late%lowest%load))) &
      call take_force(self, moment_at_zero(elongation_rate, stretch, first%time, last%time, [first%force_rate, last%force_rate]))
  end subroutine refine_extreme

  subroutine take_force(self, moment)
    class(summary_t), intent(inout) :: self
    type(moment_t), intent(in) :: moment

    call self%cycles%consider(moment%force, moment%time, moment%position)
    call widen(self, extremum_of(moment))
  end subroutine take_force

  !> Add k_x u_x at one instant to its ranges.
  pure subroutine widen(self, here)
    class(summary_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    if (here%time >= self%half) call self%late%widen(here)
    if (self%settle > 0.0_wp) call self%this_cycle%widen(here)
  end subroutine widen

  pure subroutine widen_window(self, here)
    class(window_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    if (here%load > self%highest%load) self%highest = here
    if (here%load < self%lowest%load) self%lowest = here
  end subroutine widen_window

  !> Time [s] that is added to a part of the run, and the time at rest or in creep in it.
  pure subroutine lengthen(window, duration, creep_time)
    type(window_t), intent(inout) :: window
    real(wp), intent(in) :: duration, creep_time

    window%length = window%length + duration
    window%creep_time = window%creep_time + creep_time
  end subroutine lengthen

  pure type(extremum_t) function extremum_of(moment)
    type(moment_t), intent(in) :: moment

    extremum_of = extremum_t(moment%force, moment%time, moment%position)
  end function extremum_of

  !> Note the angle of friction when slip begins for the first time.
  subroutine follow_slip(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    !> Number of parts in which the force is evaluated when it is near: the fast oscillation makes friction fall and rise within a
    !> step.
    integer, parameter :: slip_parts = 8
    type(moment_t) :: before, after
    real(wp) :: ends(2)
    integer :: i, start

    if (self%has_slipped) return
    before = stretch%first
    ends(1) = crossing_value(excess_force, stretch, before)
    start = merge(1, slip_parts, crossing_value(excess_force, stretch, stretch%last) > -near*abs(stretch%last%force))
    do i = start, slip_parts
      after = stretch%last
      if (i < slip_parts) after = stretch%at(inside(i))
      ends(2) = crossing_value(excess_force, stretch, after)
      if (ends(2) > 0.0_wp) exit
      before = after
      ends(1) = ends(2)
    end do
    if (.not. ends(2) > 0.0_wp) return
    if (ends(1) < 0.0_wp) after = moment_at_zero(excess_force, stretch, before%time, after%time, ends)
    if (any(abs(after%slip_velocity) > 0.0_wp)) self%slip_angle = atan2(abs(after%slip_velocity(2)), abs(after%slip_velocity(1)))
    self%has_slipped = .true.

  contains

    real(wp) function inside(part)
      integer, intent(in) :: part

      inside = stretch%first%time + (stretch%last%time - stretch%first%time)*real(part, wp)/real(slip_parts, wp)
    end function inside
  end subroutine follow_slip

  !> The time at rest or in creep: of the second half, with its first instant, and of the present cycle.
  subroutine follow_creep(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    type(moment_t) :: first

    if (stretch%last%time >= self%half) then
      first = stretch%first
      if (first%time < self%half) then
        first = stretch%at(self%half)
        call self%late%widen(extremum_of(first))
      end if
      call take_creep(stretch, first, self%late)
    end if
    if (self%settle > 0.0_wp) call take_creep(stretch, stretch%first, self%this_cycle)
  end subroutine follow_creep

  !> Extend a window by a stretch that begins at an instant.
  subroutine take_creep(stretch, first, window)
    class(stretch_t), intent(in) :: stretch
    type(moment_t), intent(in) :: first
    type(window_t), intent(inout) :: window
    type(moment_t) :: crossing, slow
    real(wp) :: ends(2), slowest, share, duration

    duration = stretch%last%time - first%time
    ! If the mass is tiny, steps may be shorter than the resolution of the time.
    if (.not. duration > 0.0_wp) return
    ends = 0.0_wp
    if (.not. stretch%sticking) &
      ends = [crossing_value(excess_rate, stretch, first), crossing_value(excess_rate, stretch, stretch%last)]
    share = merge(1.0_wp, 0.0_wp, ends(2) <= 0.0_wp)
    if (minval(ends) > 0.0_wp .and. first%rate*stretch%last%rate < 0.0_wp) then
      ! The object turns back, and is slow for a while between the ends.
      crossing = moment_at_zero(rate, stretch, first%time, stretch%last%time, [first%rate, stretch%last%rate])
      slowest = crossing_value(excess_rate, stretch, crossing)
      slow = moment_at_zero(excess_rate, stretch, first%time, crossing%time, [ends(1), slowest])
      crossing = moment_at_zero(excess_rate, stretch, crossing%time, stretch%last%time, [slowest, ends(2)])
      share = (crossing%time - slow%time)/duration
    else if (ends(1)*ends(2) < 0.0_wp) then
      crossing = moment_at_zero(excess_rate, stretch, first%time, stretch%last%time, ends)
      share = (crossing%time - first%time)/duration
      if (ends(2) < 0.0_wp) share = 1.0_wp - share
    end if
    call lengthen(window, duration, share*duration)
  end subroutine take_creep

  !> Largest |X'|: the interior of advances is searched only if it may exceed the largest one so far.
  subroutine follow_rate(self, stretch)
    class(summary_t), intent(inout) :: self
    class(stretch_t), intent(in) :: stretch
    real(wp), parameter :: offset = 1.0e-3_wp
    integer :: i, best
    real(wp) :: rates(0:most_parts), part, inner

    associate (n => stretch%parts)
      rates(0) = abs(stretch%first%rate)
      rates(n) = abs(stretch%last%rate)
      if (max(rates(0), rates(n)) <= worth_parts*self%largest_rate) return
      part = 1.0_wp/real(n, wp)
      do i = 1, n - 1
        rates(i) = rate_at(stretch, real(i, wp)*part)
      end do
      best = maxloc(rates(:n), dim=1) - 1
      if (rates(best) <= worth_refining*self%largest_rate) return
      inner = min(1.0_wp - offset, max(offset, real(best, wp)*part))
      if (best == 0 .or. best == n) then
        ! The maximum may be just inside.
        if (rate_at(stretch, inner) <= rates(best)) inner = 0.0_wp
      end if
      if (inner > 0.0_wp) self%largest_rate = max(self%largest_rate, largest_near(stretch, inner, part))
      self%largest_rate = max(self%largest_rate, rates(best))
    end associate
  end subroutine follow_rate

  !> |X'| at position tau of a stretch.
  real(wp) function rate_at(stretch, tau)
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: tau
    type(moment_t) :: moment

    moment = stretch%at(stretch%first%time + tau*(stretch%last%time - stretch%first%time))
    rate_at = abs(moment%rate)
  end function rate_at

  !> Largest |X'| near position `middle` of a stretch, if a maximum is no further than `distance` away, by parabolas through three
  !> points. Near a maximum the value is as accurate as the square of the position.
  real(wp) function largest_near(stretch, middle, distance) result(largest)
    class(stretch_t), intent(in) :: stretch
    real(wp), intent(in) :: middle, distance
    !> The distance of the points is reduced by this share down to the smallest one, at which the value is accurate to its square.
    real(wp), parameter :: shrink = 0.1_wp, least = 0.004_wp
    real(wp) :: x, d, left, top, right, curvature

    x = middle
    d = distance
    largest = 0.0_wp
    do while (d > least)
      x = min(1.0_wp - d, max(d, x))
      left = rate_at(stretch, x - d)
      top = rate_at(stretch, x)
      right = rate_at(stretch, x + d)
      largest = max(largest, left, top, right)
      curvature = 2.0_wp*top - left - right
      if (.not. curvature > 0.0_wp) return
      x = x + d*min(1.0_wp, max(-1.0_wp, 0.5_wp*(right - left)/curvature))
      d = shrink*d
    end do
    x = min(1.0_wp, max(0.0_wp, x))
    largest = max(largest, rate_at(stretch, x))
  end function largest_near

  !> The last cycles that count for the means, at most this many, (measure, cycle) as `cycle_quantities`, the oldest first. A motion
  !> that was ended because it has settled continues with its last cycle, and has no other.
  pure function kept_cycles(self, most) result(cycles)
    class(summary_t), intent(in) :: self
    integer, intent(in) :: most
    real(wp), allocatable :: cycles(:, :)
    integer :: n

    n = min(most, self%cycles%lasting())
    if (self%settled_at >= 0.0_wp) n = 1
    cycles = self%cycles%last_cycles(n)
  end function kept_cycles

  !> The values of all `summary_quantities`, and whether this motion has them; the others are 0. A motion in closed form has no
  !> energies and no cycles.
  subroutine summary_values(self, value, given, energies)
    type(summary_t), intent(in) :: self
    real(wp), intent(out) :: value(:)
    logical, intent(out) :: given(:)
    type(energies_t), intent(in), optional :: energies
    real(wp) :: mean(measures), scatter(measures)
    integer :: next, n

    value = 0.0_wp
    given = .false.
    next = 1
    if (present(energies)) then
      call self%cycles%means(n, mean, scatter)
      call put('cycles', real(self%cycles%count, wp))
      call put_mean('period', period)
      call put_mean('peak_force', peak)
      call put_mean('valley_force', valley)
      call put_mean('stick_duration', stick_time)
      call put_mean('slip_duration', slip_time)
      call put_mean('slip_length', slip_length)
      if (self%cycles%has_peaked) call put('first_peak_force', self%cycles%first_peak)
    end if
    call put('max_X_rate', self%largest_rate)
    call put('sticks', real(self%sticks, wp))
    call put('sticking_time', self%sticking_time)
    if (.not. present(energies)) return
    call put('drive_work', energies%drive_work)
    call put('friction_work', energies%friction_work)
    if (energies%damper_work >= 0.0_wp) call put('damper_work', energies%damper_work)
    if (self%exchanged > 0.0_wp) then
      call put('energy_residual', &
        (energies%drive_work - energies%friction_work - max(0.0_wp, energies%damper_work) - (energies%now - energies%first)) &
        /self%exchanged)
    else
      call put('energy_residual', 0.0_wp)
    end if
    if (self%late%length > 0.0_wp) then
      call put('swing', self%late%highest%load - self%late%lowest%load)
      call put('creep_share', self%late%creep_time/self%late%length)
    end if
    if (self%has_slipped) call put('slip_angle', self%slip_angle)
    if (self%fast_decay >= 0.0_wp) call put('fast_decay', self%fast_decay)
    if (self%undecided_from >= 0.0_wp) call put('undecided_from', self%undecided_from)
    if (self%settled_at >= 0.0_wp) call put('settled_at', self%settled_at)

  contains

    subroutine put_mean(name, measure)
      character(*), intent(in) :: name
      integer, intent(in) :: measure

      if (n > 0) call put(name, mean(measure))
      if (n > 1) call put(name//'_scatter', scatter(measure))
    end subroutine put_mean

    !> Find a quantity by name; as a rule it is the next one.
    subroutine put(name, number)
      character(*), intent(in) :: name
      real(wp), intent(in) :: number
      integer :: i

      do i = 1, size(summary_quantities)
        if (summary_quantities(next)%name == name) exit
        next = merge(next + 1, 1, next < size(summary_quantities))
      end do
      value(next) = number
      given(next) = .true.
    end subroutine put
  end subroutine summary_values

  !> Save or load.
  subroutine serialise(self, archive)
    class(summary_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call self%cycles%serialise(archive)
    call archive%serialise(self%largest_rate)
    call archive%serialise(self%sticks)
    call archive%serialise(self%sticking_time)
    call archive%serialise(self%first_energy)
    call archive%serialise(self%exchanged)
    call self%late%serialise(archive)
    call archive%serialise(self%has_slipped)
    call archive%serialise(self%slip_angle)
    call archive%serialise(self%undecided_from)
    call archive%serialise(self%settled_at)
    call self%this_cycle%serialise(archive)
    call archive%serialise(self%cycles_seen)
  end subroutine serialise

  subroutine serialise_window(self, archive)
    class(window_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call self%highest%serialise(archive)
    call self%lowest%serialise(archive)
    call archive%serialise(self%length)
    call archive%serialise(self%creep_time)
  end subroutine serialise_window
end module dst_summary
