!> Fast cycles of a steadily driven object on an interval of angles. A cycle goes from one release through slip and stick to the
!> next.
!>
!> At a release the object rests under |K u| = F_0, so the angle of K u is the whole state, and the measures of a cycle - its
!> length, the change of the angle, its works, the motion inside - are functions of that angle. They are computed at Chebyshev
!> points, from cycles that were run, and interpolated by polynomials. docs/cycle_map.md derives this and explains where it ends.
!>
!> Angles count from the soft axis, positive on either side: K u = F_0 (cos angle, side sin angle).
module dst_cycle_table
  use dst_archive, only: archive_t
  use dst_chebyshev, only: chebyshev_points, chebyshev_polynomials, chebyshev_coefficients, chebyshev_derivative, &
    cardinal_functions
  use dst_interpolation, only: grid_t, max_degree
  use dst_kinds, only: wp
  use dst_piece, only: piece_t, stick_begins, slip_begins, slips, sticks
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  implicit none
  private

  public :: cycle_table_t, new_cycle_table, is_cycle, measures_of
  public :: duration, turn, slip_duration, drive_work, friction_work, damper_work, exchanged, measures

  !> The measures of a cycle: its length [s], the change of the angle [rad], the length of its slip [s], the works and the sum of
  !> their absolute values in the steps [J].
  integer, parameter :: duration = 1, turn = 2, slip_duration = 3, drive_work = 4, friction_work = 5, damper_work = 6, &
    exchanged = 7, measures = 7
  !> The motion inside slip: change of u since the release [m], v [m/s], change of theta [rad].
  integer, parameter :: slip_columns = 4
  !> Panels into which a long piece in closed form is divided. Convention.
  integer, parameter :: closed_form_panels = 3

  !> The cycles that begin at an angle between `first` and `last`, with the drive at one velocity.
  type :: cycle_table_t
    real(wp) :: velocity = 0.0_wp             !! V, m/s
    real(wp) :: side = 1.0_wp                 !! sign of u_y
    real(wp) :: first = 0.0_wp, last = 0.0_wp !! rad
    integer :: points = 0
    !> Coefficients of the measures (point, measure) in Chebyshev polynomials; and their errors, relative to rtol = 1.
    real(wp), allocatable :: coefficient(:, :)
    real(wp) :: error = 0.0_wp
    !> The values of an observer for the cycles at the points (point, value), and their coefficients.
    real(wp), allocatable :: observed(:, :), observed_coefficient(:, :)
    !> The slip of the cycles at the points: ends of its panels as shares of its length, and nodal values (column, node, panel,
    !> point).
    real(wp), allocatable :: point(:)
    integer :: panels = 0
    real(wp), allocatable :: panel_end(:)
    real(wp), allocatable :: inside(:, :, :, :)
  contains
    procedure :: holds
    procedure :: place
    procedure :: angle_at
    procedure :: follow
    procedure :: slip_at
    procedure :: take
    procedure :: settle
    procedure :: error_inside
    procedure :: measures_at
    procedure :: log_stretch
    procedure :: serialise
  end type cycle_table_t

contains

  !> A table without cycles.
  pure subroutine new_cycle_table(velocity, side, first, last, points, values, table)
    real(wp), intent(in) :: velocity, side, first, last
    integer, intent(in) :: points
    integer, intent(in) :: values     !! number of values of an observer
    type(cycle_table_t), intent(out) :: table

    table%velocity = velocity
    table%side = side
    table%first = first
    table%last = last
    table%points = points
    table%point = chebyshev_points(points)
    allocate (table%coefficient(points, measures), table%observed(points, values))
  end subroutine new_cycle_table

  !> Whether an angle lies in the interval.
  pure logical function holds(self, angle)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: angle

    holds = angle >= self%first .and. angle <= self%last
  end function holds

  !> Position of an angle in [-1, 1].
  elemental real(wp) function place(self, angle)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: angle

    place = (angle - 0.5_wp*(self%first + self%last))*(2.0_wp/(self%last - self%first))
  end function place

  !> The angle [rad] at a position in [-1, 1].
  elemental real(wp) function angle_at(self, x)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: x

    angle_at = 0.5_wp*((self%first + self%last) + x*(self%last - self%first))
  end function angle_at

  !> Whether a recording that begins with a release is one cycle: a slip, and a stick up to a release.
  pure logical function is_cycle(recording)
    type(recording_t), intent(in) :: recording
    integer :: i, n

    n = recording%count
    is_cycle = n > 1
    if (.not. is_cycle) return
    is_cycle = recording%contact(n) == sticks .and. recording%event(n) == slip_begins .and. recording%event(n - 1) == stick_begins
    do i = 1, n - 1
      is_cycle = is_cycle .and. recording%contact(i) == slips
    end do
  end function is_cycle

  !> Angle [rad] by which the force on the object at rest has turned, towards positive angles, after u has changed by `advance` [m]
  !> along the drive and the force is again at the static limit. From the ends alone it has the roundoff of the angle; from the
  !> advance, which counts from 0, its own.
  pure real(wp) function turn_of(side, slider, velocity, from, to, advance)
    real(wp), intent(in) :: side, velocity   !! V [m/s]
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: from(2), to(2)   !! u [m]
    real(wp), intent(in) :: advance
    real(wp), parameter :: least_slope = 0.01_wp
    integer, parameter :: iterations = 3
    real(wp) :: before(2), after(2), length(2), theta, turn, slope
    integer :: i

    before = slider%force_at_rest(from, velocity)
    after = slider%force_at_rest(to, velocity)
    turn = atan2(before(1)*after(2) - before(2)*after(1), dot_product(before, after))
    theta = atan2(before(2), before(1))
    length = slider%along*slider%law%static_limit/slider%stiffness
    do i = 1, iterations
      slope = length(2)*cos(theta + turn) - length(1)*sin(theta + turn)
      if (.not. abs(slope) > least_slope*maxval(abs(length))) exit
      associate (half => 0.5_wp*turn)
        turn = turn + (advance - 2.0_wp*sin(half)*(length(2)*cos(theta + half) - length(1)*sin(theta + half)))/slope
      end associate
    end do
    turn_of = side*turn
  end function turn_of

  !> The measures of a recorded cycle.
  pure function measures_of(recording, side, slider) result(measure)
    type(recording_t), intent(in) :: recording
    real(wp), intent(in) :: side
    type(slider_t), intent(in) :: slider
    real(wp) :: measure(measures)
    type(state_t) :: from, to

    from = recording%from(1)
    to = recording%to(recording%count)
    measure(duration) = recording%duration()
    measure(turn) = turn_of(side, slider, recording%velocity(), from%u, to%u, &
      recording%velocity()*measure(duration) - (to%position - from%position))
    measure(slip_duration) = recording%end_of(recording%count - 1)
    measure(drive_work) = to%drive_work - from%drive_work
    measure(friction_work) = to%friction_work - from%friction_work
    measure(damper_work) = to%damper_work - from%damper_work
    measure(exchanged) = recording%exchanged()
  end function measures_of

  !> Add the cycle at point `j`. The first one sets the panels.
  pure subroutine take(self, j, recording, observed, slider, grid)
    class(cycle_table_t), intent(inout) :: self
    integer, intent(in) :: j
    type(recording_t), intent(in) :: recording
    real(wp), intent(in) :: observed(:)
    type(slider_t), intent(in) :: slider
    type(grid_t), intent(in) :: grid         !! of the panels
    type(state_t) :: from, state
    type(piece_t) :: piece
    real(wp) :: slip, elapsed, begin
    integer :: i, k, now

    self%coefficient(j, :) = measures_of(recording, self%side, slider)
    self%observed(j, :) = observed
    slip = self%coefficient(j, slip_duration)
    if (.not. allocated(self%inside)) call set_panels(self, recording, slip, grid)
    from = recording%from(1)
    now = 1
    call recording%get(now, piece)
    do k = 1, self%panels
      do i = 0, grid%degree
        elapsed = slip*(self%panel_end(k - 1) + grid%node(i)*(self%panel_end(k) - self%panel_end(k - 1)))
        do while (now < recording%count - 1)
          if (recording%end_of(now) >= elapsed) exit
          now = now + 1
          call recording%get(now, piece)
        end do
        begin = 0.0_wp
        if (now > 1) begin = recording%end_of(now - 1)
        state = piece%inside(min(1.0_wp, max(0.0_wp, (elapsed - begin)/piece%path%step)))
        self%inside(:, i, k, j) = [state%u - from%u, state%y(1), self%side*(state%y(2) - from%y(2))]
      end do
    end do
    ! Slip begins and ends at rest.
    self%inside(3, 0, 1, j) = 0.0_wp
    self%inside(3, grid%degree, self%panels, j) = 0.0_wp
  end subroutine take

  !> Panels as the pieces of the slip of a cycle; pieces in closed form are divided, as they are too long for polynomials on the
  !> grid.
  pure subroutine set_panels(self, recording, slip, grid)
    class(cycle_table_t), intent(inout) :: self
    type(recording_t), intent(in) :: recording
    real(wp), intent(in) :: slip
    type(grid_t), intent(in) :: grid
    type(piece_t) :: piece
    real(wp) :: begin
    integer :: i, j, parts, n

    allocate (self%panel_end(0:closed_form_panels*recording%count))
    self%panel_end(0) = 0.0_wp
    n = 0
    do i = 1, recording%count - 1
      call recording%get(i, piece)
      parts = merge(1, closed_form_panels, abs(piece%path%grid%node(1) - grid%node(1)) > 0.0_wp)
      begin = 0.0_wp
      if (i > 1) begin = recording%end_of(i - 1)
      do j = 1, parts
        n = n + 1
        self%panel_end(n) = (begin + real(j, wp)/real(parts, wp)*piece%path%step)/slip
      end do
    end do
    self%panels = n
    self%panel_end(n) = 1.0_wp
    allocate (self%inside(slip_columns, 0:grid%degree, n, self%points))
  end subroutine set_panels

  !> Convert the measures of the cycles to polynomials.
  pure subroutine settle(self)
    class(cycle_table_t), intent(inout) :: self

    self%coefficient = chebyshev_coefficients(self%coefficient)
    self%observed_coefficient = chebyshev_coefficients(self%observed)
  end subroutine settle

  !> Largest error of the motion inside the slip of a recorded cycle that begins at an angle [rad], relative to the largest
  !> elongation and slip speed in it: in the middle of each panel.
  pure real(wp) function error_inside(self, grid, angle, recording) result(error)
    class(cycle_table_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: angle
    type(recording_t), intent(in) :: recording
    real(wp) :: found(slip_columns), right(slip_columns), slip, elapsed, begin, largest(slip_columns)
    type(state_t) :: from, state
    type(piece_t) :: piece
    integer :: k, now

    largest = [(maxval(abs(self%inside(k, :, :, :))), k=1, slip_columns)]
    error = 0.0_wp
    from = recording%from(1)
    slip = recording%end_of(recording%count - 1)
    do k = 1, self%panels
      elapsed = 0.5_wp*slip*(self%panel_end(k - 1) + self%panel_end(k))
      now = min(recording%place_of(elapsed), recording%count - 1)
      call recording%get(now, piece)
      begin = 0.0_wp
      if (now > 1) begin = recording%end_of(now - 1)
      state = piece%inside(min(1.0_wp, max(0.0_wp, (elapsed - begin)/piece%path%step)))
      right = [state%u - from%u, state%y(1), state%y(2) - from%y(2)]
      found = self%slip_at(grid, angle, elapsed/slip)
      ! The direction matters as much as the speed.
      error = max(error, maxval(abs(found(1:3) - right(1:3))/largest(1:3)), abs(found(4) - right(4))*right(3)/largest(3))
    end do
  end function error_inside

  !> The measures of the cycle that begins at an angle [rad].
  pure function measures_at(self, angle) result(measure)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: angle
    real(wp) :: measure(measures), polynomial(self%points)

    call chebyshev_polynomials(self%points, self%place(angle), polynomial)
    measure = matmul(polynomial, self%coefficient)
  end function measures_at

  !> Logarithm of the factor by which a small difference of the angle grows in the cycles from these angles [rad].
  pure real(wp) function log_stretch(self, angle)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: angle(:)
    real(wp) :: polynomial(self%points), slope(self%points)
    integer :: i

    slope = chebyshev_derivative(self%coefficient(:, turn))*(2.0_wp/(self%last - self%first))
    log_stretch = 0.0_wp
    do i = 1, size(angle)
      call chebyshev_polynomials(self%points, self%place(angle(i)), polynomial)
      log_stretch = log_stretch + log(max(tiny(1.0_wp), abs(1.0_wp + dot_product(polynomial, slope))))
    end do
  end function log_stretch

  !> Follow cycle after cycle from an angle, up to a number of cycles, for `longest` [s] at most, or until the angle leaves the
  !> interval. angle(i) and start(i) are the end of cycle i; `total` is the sum of the polynomials at all cycles, for the sums of
  !> measures.
  pure subroutine follow(self, longest, angle, start, slip, cycles, total)
    class(cycle_table_t), intent(in) :: self
    real(wp), intent(in) :: longest
    real(wp), intent(inout) :: angle(0:)      !! rad; the first one is given
    real(wp), intent(out) :: start(0:)        !! s
    real(wp), intent(out) :: slip(:)          !! length of slip, s
    integer, intent(out) :: cycles
    real(wp), intent(out) :: total(:)
    real(wp) :: polynomial(self%points), now, elapsed, lasting
    integer :: n, i

    n = self%points
    now = angle(0)
    elapsed = 0.0_wp
    start(0) = 0.0_wp
    total = 0.0_wp
    cycles = 0
    do i = 1, size(slip)
      if (.not. self%holds(now)) exit
      call chebyshev_polynomials(n, self%place(now), polynomial)
      lasting = dot_product(polynomial, self%coefficient(:, duration))
      if (elapsed + lasting > longest) exit
      slip(i) = dot_product(polynomial, self%coefficient(:, slip_duration))
      now = now + dot_product(polynomial, self%coefficient(:, turn))
      elapsed = elapsed + lasting
      total = total + polynomial
      angle(i) = now
      start(i) = elapsed
      cycles = i
    end do
  end subroutine follow

  !> Change of u [m], v [m/s] and change of theta [rad] at a share `phase` of the slip of the cycle from an angle [rad].
  pure function slip_at(self, grid, angle, phase) result(value)
    class(cycle_table_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: angle, phase
    real(wp) :: value(slip_columns), cardinal(self%points), basis(0:max_degree), at_point(slip_columns)
    integer :: i, j, k, above

    k = 1
    above = self%panels + 1
    do while (above - k > 1)
      i = (k + above)/2
      if (self%panel_end(i - 1) <= phase) then
        k = i
      else
        above = i
      end if
    end do
    call cardinal_functions(self%points, self%point, self%place(angle), cardinal)
    call grid%lagrange((phase - self%panel_end(k - 1))/(self%panel_end(k) - self%panel_end(k - 1)), basis)
    value = 0.0_wp
    do j = 1, self%points
      at_point = 0.0_wp
      do i = 0, grid%degree
        at_point = at_point + basis(i)*self%inside(:, i, k, j)
      end do
      value = value + cardinal(j)*at_point
    end do
    value(3) = max(0.0_wp, value(3))
    value(4) = self%side*value(4)
  end function slip_at

  !> Save or load.
  subroutine serialise(self, archive)
    class(cycle_table_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer :: j, k, last, values

    call archive%serialise(self%velocity)
    call archive%serialise(self%side)
    call archive%serialise(self%first)
    call archive%serialise(self%last)
    call archive%serialise(self%points)
    call archive%serialise(self%panels)
    call archive%serialise(self%error)
    last = 0
    values = 0
    if (.not. archive%is_loading()) then
      last = ubound(self%inside, 2)
      values = size(self%observed, 2)
    end if
    call archive%serialise(last)
    call archive%serialise(values)
    if (archive%is_loading()) then
      if (allocated(self%coefficient)) deallocate (self%coefficient, self%panel_end, self%inside, self%observed)
      self%point = chebyshev_points(self%points)
      allocate (self%coefficient(self%points, measures), self%panel_end(0:self%panels), &
        self%inside(slip_columns, 0:last, self%panels, self%points), self%observed(self%points, values))
    end if
    call archive%serialise(self%coefficient)
    call archive%serialise(self%observed)
    self%observed_coefficient = chebyshev_coefficients(self%observed)
    call archive%serialise(self%panel_end(0:self%panels))
    do j = 1, self%points
      do k = 1, self%panels
        call archive%serialise(self%inside(:, :, k, j))
      end do
    end do
  end subroutine serialise
end module dst_cycle_table
