!> Stick-slip cycles, and their measures once the motion has settled. The storage has a fixed size, whatever the length of the run.
!>
!> The load is the spring force k_x u_x, positive in the direction in which the drive pulls the soft spring, that of V cos(phi). A
!> cycle goes from a peak of the load over a valley to the next peak. An extremum counts if the load leaves it by more than
!> `threshold` of the kinetic limit F_0 = mu_0 W: the 1 kHz ripple of dynamic stiction stays far below this. If the drive stops or
!> reverses, the present cycle is discarded; a long steady slide also ends it.
!>
!> Means and scatters are over the later half of the complete cycles: over at least two of them if there are two, at most over the
!> last `kept`, and over whole repetitions of a motion that repeats. A motion that rings down has no means: its amplitude decreases
!> from cycle to cycle, or its last extremum is long past.
module dst_cycles
  use dst_kinds, only: wp, int64, pi
  use dst_slow_cycle, only: most_repeats
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: cycles_t, recent_cycles_t, extremum_t, threshold, repeated
  public :: period, peak, valley, stick_time, slip_time, slip_length, measures, cycle_quantities, rise, creep, most_cycles

  ! The effects of "twice" were measured on 21 motions: those of tests/python/test_settled.py, stick-slip of 3 to 30 s, driven
  ! unsteadily.
  !
  !> The difference by which an extremum counts, over F_0. Convention. Twice: 10 to 75 % of the cycles of motions that ring down are
  !> not counted, and one of eight such motions has a period; for lasting stick-slip, no change.
  real(wp), parameter :: threshold = 0.01_wp
  !> Number of cycles that are kept. Convention. Means are over half of the cycles: with fewer than 200 cycles, twice is no change.
  integer, parameter :: kept = 100, most_cycles = kept
  !> A motion rings down if its amplitude decreases to less than this share; a single cycle has to lose more. Conventions. Half: one
  !> of eight motions that ring down has a period; no change. Twice means any decrease: lasting stick-slip has no period either.
  real(wp), parameter :: ring_down = 0.9_wp, ring_down_of_one = 0.5_wp
  !> Growth of an amplitude that is ignored: the ripple moves peaks and valleys a little. Convention; twice: no change.
  real(wp), parameter :: ripple = 0.01_wp
  !> Number of cycles from which on decreasing amplitudes are not random, if there are as many. Convention; twice: no change.
  integer, parameter :: telling = 4
  !> Time without an extremum, in lengths of the longest cycle, after which the cycles have ended. Convention; twice: no change.
  real(wp), parameter :: patience = 3.0_wp
  !> A peak this many natural lengths and times, and lengths of the longest cycle, after the last one follows a steady slide.
  !> Convention; twice: no change.
  real(wp), parameter :: long = 10.0_wp

  !> A motion repeats after so many cycles at most, if they agree to this share of their size. Convention; a slow cycle whose load
  !> has two peaks is two.
  integer, parameter :: most_peaks = 2*most_repeats
  real(wp), parameter :: repeated = 1.0e-5_wp

  !> The measures of a cycle: durations [s], loads [N] and the advance in X in the direction of the drive [m].
  integer, parameter :: period = 1, peak = 2, valley = 3, stick_time = 4, slip_time = 5, slip_length = 6, measures = 6
  !> The published measures of a cycle, in the order of these numbers.
  type(quantity_t), parameter :: cycle_quantities(measures) = [ &
    quantity_t('period', 's', 'time from peak to peak of the load'), &
    quantity_t('peak_force', 'N', 'peak of the load with which the cycle begins: k_x u_x, positive where the drive pulls'), &
    quantity_t('valley_force', 'N', 'valley of the load'), &
    quantity_t('stick_duration', 's', 'time from valley to peak: dynamic stiction'), &
    quantity_t('slip_duration', 's', 'time from peak to valley'), &
    quantity_t('slip_length', 'm', 'advance in X from peak to valley, positive with the drive')]
  !> Further measures: the rise of the load to the next peak [N], the advance in X from peak to peak [m], and the time in creep [s].
  integer, parameter :: rise = 7, travel = 8, creep = 9, remembered = 9

  !> A peak or a valley: the load k_x u_x [N], the time [s], X [m], and the time in creep until then [s], if it is followed.
  type :: extremum_t
    real(wp) :: load = 0.0_wp, time = 0.0_wp, position = 0.0_wp, creep = 0.0_wp
  contains
    procedure :: plus
  end type extremum_t

  !> The last cycles, and what the present one is up to now.
  type :: recent_cycles_t
    !> All complete cycles.
    integer(int64) :: count = 0
    !> Whether there has been a peak, and the load there [N].
    logical :: has_peaked = .false.
    real(wp) :: first_peak = 0.0_wp
    !> Period of the free oscillation on the soft spring [s].
    real(wp) :: natural_time = 0.0_wp
    !> Constants of the scene: cos(phi) if the soft spring is pulled; F_0 [N]; the advance that loads the spring up to F_0 [m].
    real(wp), private :: drive_coupling = 0.0_wp, kinetic_limit = 0.0_wp, natural_length = 0.0_wp
    !> Directions of the drive and of its pull, 0 as long as there is none.
    integer, private :: drive_side = 0, side = 0
    !> Whether the load rises (1) or falls (-1) by more than the threshold; 0 as long as neither is known.
    integer, private :: heading = 0
    !> The highest load since it began to rise, or the lowest since it began to fall; both as long as neither is known.
    type(extremum_t), private :: candidate = extremum_t(), other_candidate = extremum_t()
    !> Extrema of the present cycle.
    logical, private :: has_peak = .false., has_valley = .false.
    type(extremum_t) :: last_peak = extremum_t()
    type(extremum_t), private :: last_valley = extremum_t()
    !> Position of the object [m] and time [s] at the last extremum, and now.
    real(wp), private :: extremum_position = 0.0_wp, extremum_time = 0.0_wp, position = 0.0_wp
    real(wp) :: time = 0.0_wp
    !> Number of cycles since the last steady slide, and of those without a break between; whether the next one follows a break.
    integer(int64), private :: recent = 0, row = 0
    logical, private :: follows_break = .true.
    real(wp), private :: cycle(remembered, kept) = 0.0_wp
  end type recent_cycles_t

  !> The cycles so far.
  type, extends(recent_cycles_t) :: cycles_t
    !> On request: the points at which the load turned back in the whole motion, with its beginning and its end.
    logical :: keeps_turns = .false.
    type(extremum_t), allocatable :: turns(:)    !! valid up to turn_count
    integer :: turn_count = 0
  contains
    procedure :: begin
    procedure :: pull
    procedure :: consider
    procedure :: skip
    procedure :: may_turn
    procedure :: means
    procedure :: lasting
    procedure :: last_cycle
    procedure :: last_cycles
    procedure :: agree
    procedure :: repeats
    procedure :: slides
    procedure :: is_long_ago
  end type cycles_t

contains

  !> Begin a motion: cos(phi), 0 if the soft spring is not pulled; F_0 [N], k_x [N/m] and the mass [kg].
  pure subroutine begin(self, drive_coupling, kinetic_limit, stiffness, mass)
    class(cycles_t), intent(inout) :: self
    real(wp), intent(in) :: drive_coupling, kinetic_limit, stiffness, mass

    self%drive_coupling = drive_coupling
    self%kinetic_limit = kinetic_limit
    if (abs(drive_coupling) > 0.0_wp) self%natural_length = kinetic_limit/(stiffness*abs(drive_coupling))
    self%natural_time = 2.0_wp*pi*sqrt(mass/stiffness)
  end subroutine begin

  !> The drive moves in the direction of V [m/s] from this instant on. If that changes, a new row of cycles begins.
  pure subroutine pull(self, velocity, here)
    class(cycles_t), intent(inout) :: self
    real(wp), intent(in) :: velocity
    type(extremum_t), intent(in) :: here
    integer :: side

    side = merge(nint(sign(1.0_wp, velocity)), 0, abs(velocity) > 0.0_wp)
    if (side == self%drive_side) return
    self%drive_side = side
    self%side = side*merge(nint(sign(1.0_wp, self%drive_coupling)), 0, abs(self%drive_coupling) > 0.0_wp)
    self%heading = 0
    self%candidate = pulled(self, here)
    self%other_candidate = self%candidate
    self%has_peak = .false.
    self%has_valley = .false.
    self%extremum_position = here%position
    self%extremum_time = here%time
    self%position = here%position
    self%time = here%time
    self%follows_break = .true.
  end subroutine pull

  !> With the load positive in the direction in which the drive pulls.
  pure type(extremum_t) function pulled(self, here)
    class(cycles_t), intent(in) :: self
    type(extremum_t), intent(in) :: here

    pulled = here
    pulled%load = real(self%side, wp)*here%load
  end function pulled

  !> Process the load k_x u_x [N] at an instant.
  pure subroutine consider(self, here)
    class(cycles_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here
    real(wp) :: ahead

    if (self%keeps_turns) call keep_turn(self, here)
    if (self%side == 0) return
    self%position = here%position
    self%time = here%time
    if (self%heading == 0) then
      call find_heading(self, pulled(self, here))
      return
    end if
    ahead = real(self%heading, wp)*(real(self%side, wp)*here%load - self%candidate%load)
    if (ahead < 0.0_wp) then
      if (-ahead <= threshold*self%kinetic_limit) return
      if (self%heading > 0) then
        call take_peak(self, self%candidate)
      else
        self%has_valley = .true.
        self%last_valley = self%candidate
      end if
      self%extremum_position = self%candidate%position
      self%extremum_time = self%candidate%time
      self%heading = -self%heading
    end if
    self%candidate = pulled(self, here)
  end subroutine consider

  !> Skip a time [s] in which the last motion repeats: so many cycles, a multiple of those that are kept, in which X advances by
  !> `advance` [m].
  pure subroutine skip(self, duration, advance, cycles)
    class(cycles_t), intent(inout) :: self
    real(wp), intent(in) :: duration, advance
    integer(int64), intent(in) :: cycles
    type(extremum_t) :: by

    by = extremum_t(0.0_wp, duration, advance)
    self%candidate = self%candidate%plus(by)
    self%other_candidate = self%other_candidate%plus(by)
    self%last_peak = self%last_peak%plus(by)
    self%last_valley = self%last_valley%plus(by)
    self%extremum_position = self%extremum_position + advance
    self%extremum_time = self%extremum_time + duration
    self%position = self%position + advance
    self%time = self%time + duration
    self%count = self%count + cycles
    self%recent = self%recent + cycles
    self%row = self%row + cycles
  end subroutine skip

  !> Sum of two loads, times and positions.
  pure type(extremum_t) function plus(self, by) result(sum)
    class(extremum_t), intent(in) :: self
    type(extremum_t), intent(in) :: by

    sum = extremum_t(self%load + by%load, self%time + by%time, self%position + by%position, self%creep + by%creep)
  end function plus

  !> Append a point to those at which the load turned back; the last one is only the present one.
  pure subroutine keep_turn(self, here)
    class(cycles_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    if (.not. allocated(self%turns)) allocate (self%turns(32))
    associate (n => self%turn_count)
      if (n == size(self%turns)) self%turns = [self%turns, self%turns]
      if (n > 1) then
        if ((here%load - self%turns(n)%load)*(self%turns(n)%load - self%turns(n - 1)%load) >= 0.0_wp) n = n - 1
      end if
      n = n + 1
      self%turns(n) = here
    end associate
  end subroutine keep_turn

  !> A row does not begin with an extremum: wait until the load has risen or fallen.
  pure subroutine find_heading(self, here)
    class(cycles_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    associate (highest => self%candidate, lowest => self%other_candidate)
      if (here%load >= highest%load) highest = here
      if (here%load <= lowest%load) lowest = here
      if (highest%load - lowest%load <= threshold*self%kinetic_limit) return
      self%heading = merge(1, -1, highest%time > lowest%time)
    end associate
    if (self%heading < 0) self%candidate = self%other_candidate
  end subroutine find_heading

  !> Whether a point at which the load turns back between these two loads [N] may count: one of them is beyond the candidate, or so
  !> far away that the candidate becomes an extremum.
  pure logical function may_turn(self, lowest, highest)
    class(cycles_t), intent(in) :: self
    real(wp), intent(in) :: lowest, highest
    real(wp) :: ahead(2)

    may_turn = self%side /= 0
    if (.not. may_turn .or. self%heading == 0) return
    ahead = real(self%heading, wp)*(real(self%side, wp)*[lowest, highest] - self%candidate%load)
    may_turn = maxval(ahead) >= 0.0_wp .or. minval(ahead) < -threshold*self%kinetic_limit
  end function may_turn

  pure subroutine take_peak(self, here)
    class(cycles_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    if (.not. self%has_peaked) self%first_peak = here%load
    self%has_peaked = .true.
    if (self%has_peak .and. self%has_valley) then
      if (has_slid_steadily(self, here)) then
        self%recent = 0
        self%follows_break = .true.
      else
        call take_cycle(self, here)
      end if
    end if
    self%has_peak = .true.
    self%has_valley = .false.
    self%last_peak = here
  end subroutine take_peak

  !> Whether so much time has passed since the last peak that the cycles before belong to another motion.
  pure logical function has_slid_steadily(self, here)
    class(cycles_t), intent(in) :: self
    type(extremum_t), intent(in) :: here
    real(wp) :: length

    length = abs(here%position - self%last_peak%position)
    has_slid_steadily = length > long*self%natural_length .and. here%time - self%last_peak%time > long*self%natural_time
    if (has_slid_steadily .and. self%recent > 0) has_slid_steadily = length > long*longest(self)
  end function has_slid_steadily

  !> The cycle that ends with this peak is complete.
  pure subroutine take_cycle(self, here)
    class(cycles_t), intent(inout) :: self
    type(extremum_t), intent(in) :: here

    self%count = self%count + 1
    self%recent = self%recent + 1
    self%row = merge(1_int64, self%row + 1, self%follows_break)
    self%follows_break = .false.
    associate (from => self%last_peak, between => self%last_valley, side => real(self%drive_side, wp))
      self%cycle(:, place(self%recent)) = [here%time - from%time, from%load, between%load, here%time - between%time, &
        between%time - from%time, side*(between%position - from%position), here%load - between%load, &
        abs(here%position - from%position), here%creep - from%creep]
    end associate
  end subroutine take_cycle

  !> The place of a cycle, by its number since the last steady slide.
  pure integer function place(number)
    integer(int64), intent(in) :: number

    place = int(modulo(number - 1, int(kept, int64))) + 1
  end function place

  !> The places of the last n cycles, the oldest first.
  pure function last_places(self, n) result(places)
    class(cycles_t), intent(in) :: self
    integer, intent(in) :: n
    integer :: places(n), i

    places = [(place(self%recent - n + i), i=1, n)]
  end function last_places

  !> The number of cycles that count for the means: of a motion that repeats, a multiple of those that repeat.
  pure integer function settled(self)
    class(cycles_t), intent(in) :: self

    settled = int(min(int(kept, int64), max(min(2_int64, self%recent), self%recent/2)))
    associate (m => self%repeats())
      if (m > 1 .and. settled >= m) settled = settled - modulo(settled, m)
    end associate
  end function settled

  !> Advance in X of the longest of the cycles that count [m].
  pure real(wp) function longest(self)
    class(cycles_t), intent(in) :: self

    longest = maxval(self%cycle(travel, last_places(self, settled(self))))
  end function longest

  !> Number of cycles that count for the means and with which the motion continues: of a motion that has settled the last one, none
  !> if there is no cycle, or if the motion rings down.
  pure integer function lasting(self, has_settled)
    class(cycles_t), intent(in) :: self
    logical, intent(in) :: has_settled

    lasting = settled(self)
    if (lasting == 0) return
    if (has_settled) then
      lasting = 1
    else if (rings_down(self)) then
      lasting = 0
    end if
  end function lasting

  !> The measures of the last `n` cycles, (measure, cycle), the oldest first; at least `n` must exist.
  pure function last_cycles(self, n) result(cycles)
    class(cycles_t), intent(in) :: self
    integer, intent(in) :: n
    real(wp) :: cycles(measures, n)

    cycles = self%cycle(:measures, last_places(self, n))
  end function last_cycles

  !> Mean and scatter, which is the standard deviation (n - 1), of all measures, and the number of cycles for it: none if there is
  !> no cycle or the motion rings down, and no scatter of a single cycle.
  pure subroutine means(self, has_settled, n, mean, scatter)
    class(cycles_t), intent(in) :: self
    logical, intent(in) :: has_settled
    integer, intent(out) :: n
    real(wp), intent(out) :: mean(measures), scatter(measures)

    mean = 0.0_wp
    scatter = 0.0_wp
    n = self%lasting(has_settled)
    if (n == 0) return
    associate (cycle => self%cycle(:measures, last_places(self, n)))
      mean = sum(cycle, dim=2)/real(n, wp)
      if (n > 1) scatter = sqrt(sum((cycle - spread(mean, 2, n))**2, dim=2)/real(n - 1, wp))
    end associate
  end subroutine means

  !> Whether the cycles die out, or have done so.
  pure logical function rings_down(self)
    class(cycles_t), intent(in) :: self
    real(wp) :: swing(2*kept)
    integer :: n

    rings_down = self%slides()
    if (rings_down) return
    n = int(min(int(max(telling, settled(self)), int64), self%recent, self%row))
    swing = 0.0_wp
    associate (cycle => self%cycle(:, last_places(self, n)))
      ! Falls and rises alternate.
      swing(1:2*n:2) = cycle(peak, :) - cycle(valley, :)
      swing(2:2*n:2) = cycle(rise, :)
    end associate
    rings_down = all(swing(2:2*n) <= (1.0_wp + ripple)*swing(:2*n - 1)) &
      .and. swing(2*n) < merge(ring_down_of_one, ring_down, n == 1)*swing(1)
  end function rings_down

  !> Slow cycles after which the motion repeats: the last cycles agree with those of so many before. 0 if it has not been seen to.
  pure integer function repeats(self) result(m)
    class(cycles_t), intent(in) :: self

    do m = 1, most_peaks
      if (self%agree(m, max(m, 2), repeated)) return
    end do
    m = 0
  end function repeats

  !> Whether each of the last `n` cycles of a row is equal to the one that is `m` before it, within a share of their durations, of
  !> F_0, and of their slip length.
  pure logical function agree(self, m, n, tolerance)
    class(cycles_t), intent(in) :: self
    integer, intent(in) :: m, n
    real(wp), intent(in) :: tolerance
    real(wp) :: size_of(measures)
    integer :: i

    agree = min(self%recent, self%row) >= n + m
    if (.not. agree) return
    do i = 0, n - 1
      associate (last => self%cycle(:measures, place(self%recent - i)), before => self%cycle(:measures, place(self%recent - i - m)))
        size_of = last(period)
        size_of([peak, valley]) = self%kinetic_limit
        size_of(slip_length) = abs(last(slip_length))
        agree = agree .and. all(abs(last - before) <= tolerance*size_of)
      end associate
    end do
  end function agree

  !> The last cycle, which must exist: its measures, `rise`, the advance in X from peak to peak [m], and the time in `creep`, if
  !> that is followed.
  pure function last_cycle(self) result(cycle)
    class(cycles_t), intent(in) :: self
    real(wp) :: cycle(remembered)

    cycle = self%cycle(:, place(self%recent))
  end function last_cycle

  !> Whether the object slides without an extremum of the load that counts: the last one is long past.
  pure logical function slides(self)
    class(cycles_t), intent(in) :: self
    real(wp) :: length

    length = self%natural_length
    if (self%recent > 0) length = longest(self)
    slides = self%side /= 0 .and. abs(self%position - self%extremum_position) > patience*length
    ! A fast object oscillates over a longer way.
    if (self%recent == 0) slides = slides .and. self%is_long_ago(self%extremum_time)
  end function slides

  !> Whether more than some periods of the free oscillation have passed since a time [s].
  pure logical function is_long_ago(self, time)
    class(cycles_t), intent(in) :: self
    real(wp), intent(in) :: time

    is_long_ago = self%time - time > patience*self%natural_time
  end function is_long_ago
end module dst_cycles
