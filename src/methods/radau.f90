!> Adaptive Radau IIA (orders 5, 9, 13) with the stage elongations eliminated.
!>
!> Because u' is linear in the slip velocity, the stage elongations follow from the slip unknowns,
!>
!>     u_i = u_0 + D_i e - h sum_j a_ij w(y_j),      D_i the drive's displacement,
!>
!> and Newton's method runs on the slip unknowns of all stages only (full Newton, exact Jacobian):
!>
!>     B(y_i) sum_j (A^-1)_ij (y_j - y_0) = h g(u_i, y_i).
!>
!> The error estimate is the defect of the collocation polynomial in both equations, at the start of the step and at one point
!> inside, passed through a one-stage stiff filter (Hairer & Wanner II, Sec. IV.8, in implicit form). It is of order s + 1 in h
!> while the method's own error is of order 2 s; the tolerance of the estimate is chosen so that the true error follows rtol. The
!> roundoff of the forces, which no step size reduces, passes the same filter and is permitted in addition.
module dst_radau
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  use dst_linear_solve, only: solve_in_place
  use dst_collocation, only: collocation_t, radau_iia, max_stages, max_rows
  use dst_dense_output, only: column_u, column_y, column_position
  use dst_drive, only: drive_segment_t
  use dst_instability, only: follow_instability
  use dst_interpolation, only: max_degree
  use dst_newton_kernels, only: solve_stages
  use dst_slip_memory, only: slip_memory_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms, max_components, max_unknowns
  use dst_state, only: state_t
  use dst_step_control, only: step_control_t, new_step_control, shortened
  use dst_stepper, only: stepper_t, attempt_t, serialise_stepper
  implicit none
  private

  public :: radau_t, new_radau

  ! The effects of "twice" were measured on Fig. 3 (2.4 s, full model, rtol 1e-6 and 1e-8) and on the low-frequency motion at 1e-6.
  !
  !> Tolerance of the estimate, the smaller of two: samples_share rtol, because the error of the polynomial from which samples are
  !> read is an eighth of the estimate; and result_share rtol**((s + 1)/(2 s - 1)), because the error of the result is of order 2 s
  !> - 1 and the estimate of order s + 1. Fitted to 100 random scenes and tested on 100 others (bench/tolerance.py). Twice: 3 to 10
  !> % less work, twice the error of samples; 1 to 6 % less work and up to three times the error of the result at 1e-4 and looser.
  real(wp), parameter :: samples_share = 10.0_wp, result_share = 0.15_wp
  !> Its bounds. Above the upper one, longer steps need more Newton iterations, and cost as much: twice gives 0 to 10 % less work
  !> with 3 or 5 stages, 5 to 10 % more with 7, and twice the error. Below the lower one, the estimate is roundoff if a spring has a
  !> scale far below that of the slip; half: too small there.
  real(wp), parameter :: largest_tolerance = 5.0e-4_wp, least_tolerance = 2.0e4_wp*epsilon(1.0_wp)
  !> Error of a step in exp(z) that affects no growth. Convention; twice: no change.
  real(wp), parameter :: harmless_error = 1.0e-6_wp
  !> Roundoff of the slip velocity that is ignored. Convention; twice: 0.4 % fewer iterations, the same error.
  real(wp), parameter :: velocity_roundoff = 8.0_wp*epsilon(1.0_wp)
  !> Growth is ignored if it is slower than this many times the change that the roundoff of the forces makes in the time of the
  !> growth; and with a drive that changes its velocity disturbances below this many tolerances of the estimate are not noticed.
  !> Conventions; they matter if steady sliding is unstable (tests/python/test_unstable_sliding.py), not in Fig. 3.
  real(wp), parameter :: growing_noise = 10.0_wp, seen_on_ramp = 10.0_wp
  !> Largest factor between steps; twice: 3 % more work for rejected steps, the same error. And the factor used if steady sliding is
  !> unstable but no disturbance is visible: when a drive begins to disturb it, the steps are not too long. Conventions.
  real(wp), parameter :: largest_factor = 4.0_wp, largest_unseen_factor = 2.0_wp
  !> Share of the slip speed that stretches a spring to the static limit from which on its axis has its own scale: the estimate
  !> contains a tenth of an oscillation that a long step erases. Twice: the same steps, 2 to 3 times the error.
  real(wp), parameter :: own_share = 0.1_wp
  !> Permitted error of a turn, in units of rtol. Measured where friction peaks in a turn (tests/python/test_friction_peak.py);
  !> Fig. 3 has no such turn.
  real(wp), parameter :: turn_allowance = 5.0_wp

  !> A point of the step at which the defect of the collocation polynomial is evaluated. Beyond the nodes of the method its weights
  !> are zero.
  type :: probe_t
    real(wp) :: position = 0.0_wp
    !> Converts the defect to one at the start, where the filter's gamma is valid.
    real(wp) :: weight = 0.0_wp
    !> y' times the step from the values at all nodes; and u' - V e from the slip velocities at the stages, negative.
    real(wp) :: derivative(0:max_degree) = 0.0_wp
    real(wp) :: extrapolation(max_stages) = 0.0_wp
    !> The polynomial from its values at all nodes.
    real(wp) :: interpolation(0:max_degree) = 0.0_wp
  end type probe_t

  !> What the guess of the stage values and the length of the next step are made of.
  type :: history_t
    !> Predictor: the last accepted step, or the given rate and curvature after a restart.
    logical :: restarted = .true.
    !> Whether `nodal` holds a solved attempt, of length attempted_step, from the point of the next one.
    logical :: retry = .false.
    real(wp) :: attempted_step = 0.0_wp
    real(wp) :: rate(max_unknowns) = 0.0_wp
    real(wp) :: curvature(max_unknowns) = 0.0_wp
    type(step_control_t) :: control
    !> Whether this attempt repeats another one.
    logical :: repeated = .false.
    real(wp) :: last_nodal(0:max_degree, max_unknowns) = 0.0_wp
    type(slip_memory_t) :: memory_of_slips
  end type history_t

  !> A Radau IIA method for one system, with its state between steps.
  type, extends(stepper_t) :: radau_t
    type(collocation_t) :: method
    !> Relative tolerance of the slip velocity and the tolerance of the estimate that gives it.
    real(wp) :: rtol = 1.0e-8_wp
    real(wp) :: estimate_tolerance = 1.0e-6_wp
    !> Leading relative error of exp(z) by the method, times z^(2 s); and the |z| up to which it affects no growth.
    real(wp) :: error_constant = 0.0_wp
    real(wp) :: harmless_phase = 0.0_wp
    type(history_t) :: history
    !> Stage values of the current attempt (stage, component or unknown), contiguous.
    real(wp) :: y(max_stages*max_unknowns) = 0.0_wp
    real(wp) :: u(max_stages*max_components) = 0.0_wp
    real(wp) :: velocity(max_stages*max_components) = 0.0_wp
    real(wp) :: velocity_y(max_stages*max_components*max_unknowns) = 0.0_wp
    real(wp) :: increment(max_stages*max_unknowns) = 0.0_wp
    real(wp) :: drive_velocity(max_stages) = 0.0_wp
    type(stage_terms_t) :: terms
    type(stage_terms_t) :: point_terms
    !> Where the defect is evaluated: the start, and one point inside.
    type(probe_t) :: start, inside
  contains
    procedure :: restart
    procedure :: begin_slip
    procedure :: attempt
    procedure :: accept
    procedure :: serialise
  end type radau_t

contains

  !> Radau IIA with 3, 5 or 7 stages for a system of n components and m slip unknowns.
  function new_radau(stages, components, unknowns, rtol) result(stepper)
    integer, intent(in) :: stages, components, unknowns
    real(wp), intent(in) :: rtol
    type(radau_t) :: stepper

    stepper%method = radau_iia(stages)
    stepper%grid = stepper%method%grid
    stepper%rtol = rtol
    stepper%estimate_tolerance = max(least_tolerance, min(largest_tolerance, samples_share*rtol, &
      result_share*rtol**(real(stages + 1, wp)/real(2*stages - 1, wp))))
    stepper%error_constant = gamma(real(stages, wp))*gamma(real(stages + 1, wp)) &
      /(gamma(real(2*stages, wp))*gamma(real(2*stages + 1, wp)))
    stepper%harmless_phase = (harmless_error/stepper%error_constant)**(0.5_wp/real(stages, wp))
    stepper%history%control = new_step_control(stages + 1, largest_factor, predicts=.true.)
    stepper%terms = new_terms(stages, components, unknowns)
    stepper%point_terms = new_terms(1, components, unknowns)
    call set_probes(stepper)
  end function new_radau

  !> Probe the defect at the start, and half way between the last two nodes, where an approaching stop becomes visible. The defect
  !> of collocation varies like M(tau) = product (tau - c_i); the weight converts it to the start.
  pure subroutine set_probes(stepper)
    type(radau_t), intent(inout) :: stepper

    associate (s => stepper%method%stages, c => stepper%grid%node)
      stepper%start = probe_at(stepper%method, 0.0_wp)
      stepper%inside = probe_at(stepper%method, 0.5_wp*(c(s) + c(s - 1)))
      stepper%inside%weight = stepper%method%gamma*product(abs(c(1:s)/(stepper%inside%position - c(1:s))))
    end associate
  end subroutine set_probes

  !> A probe of the defect without conversion.
  pure function probe_at(method, position) result(probe)
    type(collocation_t), intent(in) :: method
    real(wp), intent(in) :: position
    type(probe_t) :: probe
    real(wp) :: basis(0:max_degree)
    integer :: k

    probe%position = position
    probe%weight = method%gamma
    associate (s => method%stages, grid => method%grid)
      call grid%lagrange(position, basis)
      probe%interpolation(0:s) = basis(0:s)
      probe%extrapolation(1:s) = stage_basis(grid%node(1:s), position)
      do k = 0, s
        probe%derivative(0:s) = probe%derivative(0:s) + probe%interpolation(k)*grid%derivative(k, 0:s)
      end do
    end associate
  end function probe_at

  !> Lagrange basis on the stages alone, at a position.
  pure function stage_basis(node, position) result(basis)
    real(wp), intent(in) :: node(:), position
    real(wp) :: basis(size(node))
    integer :: i, j

    basis = 1.0_wp
    do j = 1, size(node)
      do i = 1, size(node)
        if (i /= j) basis(j) = basis(j)*(position - node(i))/(node(j) - node(i))
      end do
    end do
  end function stage_basis

  pure subroutine restart(self, rate, curvature)
    class(radau_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    self%history%restarted = .true.
    self%history%retry = .false.
    self%history%repeated = .false.
    call self%history%control%restart()
    self%start_speed = 0.0_wp
    self%peak_speed = 0.0_wp
    self%history%rate = 0.0_wp
    self%history%rate(1:size(rate)) = rate
    self%history%curvature = 0.0_wp
    self%history%curvature(1:size(rate)) = curvature
    call self%history%memory_of_slips%forget()
  end subroutine restart

  pure subroutine begin_slip(self, rate, curvature)
    class(radau_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    call self%restart(rate, curvature)
    call self%history%memory_of_slips%begin()
  end subroutine begin_slip

  !> A step of the given length or, to a stop, of a length that is solved for with this guess.
  subroutine attempt(self, system, drive, from, step, to, outcome, to_stop)
    class(radau_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(in), optional :: to_stop
    real(wp) :: own_speed(max_components)
    integer :: iterations
    logical :: lands

    lands = present(to_stop)
    if (lands) lands = to_stop
    if (lands) self%count%landings = self%count%landings + 1
    self%step = step
    own_speed = own_share*system%spring_speed(from%u)
    associate (s => self%method%stages, n => system%components, m => system%unknowns)
      call predict(self, s, m, from, self%y)
      call solve_stages(s, n, m, system, self%method, drive, from, lands, self%newton_share*self%rtol, own_speed(system%axis:), &
        self%step, self%y, self%u, self%velocity, self%velocity_y, self%increment, self%drive_velocity, self%terms, &
        self%speed_scale, iterations, outcome%solved)
      ! Every Newton iteration evaluates all stages and solves one linear system.
      self%count%newton = self%count%newton + iterations
      self%count%rhs = self%count%rhs + s*iterations
      outcome%solved = outcome%solved .and. self%step > 0.0_wp
      if (.not. outcome%solved) self%step = step
      self%history%retry = outcome%solved
      self%history%attempted_step = self%step
      if (outcome%solved) then
        call complete(s, n, m, self%y, self%u, self%velocity, self%increment)
        call estimate_error(s, n, m, own_speed(system%axis:), self%velocity)
        call follow_growth(s, n, m, self%y)
      end if
      self%history%repeated = .true.
    end associate

  contains

    !> Node values for the dense output, quadratures, and the state at the end of the step.
    subroutine complete(s, n, m, y, u, velocity, increment)
      integer, intent(in) :: s, n, m
      real(wp), intent(in) :: y(s, m), u(s, n), velocity(s, n), increment(s, m)
      real(wp) :: x_rate(s), displacement(s), advanced(max_rows), drive_power, friction_power, supplied
      real(wp) :: damper_power, driven, taken
      integer :: i, k, axis

      do i = 1, s
        displacement(i) = drive%displacement(from%time, self%grid%node(i)*self%step)
      end do
      to%u = from%u
      to%y = from%y
      x_rate = 0.0_wp
      do k = 1, n
        axis = system%axis + k - 1
        x_rate = x_rate + system%advance_by_slip(axis)*velocity(:, k)
        self%nodal(0, column_u + axis - 1) = from%u(axis)
        self%nodal(1:s, column_u + axis - 1) = u(:, k) - displacement*system%drive_coupling(axis)
        to%u(axis) = u(s, k)
      end do
      do k = 1, m
        self%nodal(0, column_y + k - 1) = from%y(k)
        self%nodal(1:s, column_y + k - 1) = y(:, k)
        to%y(k) = y(s, k)
      end do
      self%nodal(0, column_position) = from%position
      advanced = 0.0_wp
      do i = 1, s
        advanced = advanced + self%method%integral(:, i)*x_rate(i)
      end do
      self%nodal(1:s, column_position) = from%position + system%advance_by_drive*displacement + self%step*advanced(1:s)
      drive_power = 0.0_wp
      friction_power = 0.0_wp
      do i = 1, s
        associate (b => self%method%weight(i), terms => self%terms)
          drive_power = drive_power + b*terms%supply(i)
          friction_power = friction_power + b*terms%dissipation(i)
          do k = 1, m
            supplied = terms%supply_y(i, k)*increment(i, k)
            if (k <= n) supplied = supplied + self%drive_velocity(i)*system%drive_stiffness(system%axis + k - 1)*u(i, k)
            drive_power = drive_power + b*supplied
            friction_power = friction_power + b*terms%dissipation_y(i, k)*increment(i, k)
          end do
        end associate
      end do
      call to%later(from, self%step)
      to%position = self%nodal(s, column_position)
      to%drive_work = from%drive_work + self%step*drive_power
      to%friction_work = from%friction_work + self%step*friction_power
      to%damper_work = from%damper_work
      if (.not. system%is_damped) return
      drive_power = 0.0_wp
      damper_power = 0.0_wp
      do i = 1, s
        call system%damper_powers(self%drive_velocity(i), velocity(i, :), driven, taken)
        drive_power = drive_power + self%method%weight(i)*driven
        damper_power = damper_power + self%method%weight(i)*taken
      end do
      to%drive_work = to%drive_work + self%step*drive_power
      to%damper_work = to%damper_work + self%step*damper_power
    end subroutine complete

    !> Filtered defect of the collocation polynomial, as an error of the slip velocity at the end relative to the largest slip speed
    !> of the step or, along an axis, to the own speed of that axis if that is lower: so the spring forces are as accurate as the
    !> slip velocity, each in its own scale. The defect is probed at the start and at one point inside, where it also shows
    !> directions that turn quickly while the start is at rest; and wherever the slip turns back (`error_of_turns`).
    subroutine estimate_error(s, n, m, own_speed, stage_velocity)
      integer, intent(in) :: s, n, m
      real(wp), intent(in) :: own_speed(n), stage_velocity(s, n)
      real(wp) :: error(n), noise(n), allowed(n)

      call defect_error(s, n, m, self%start, stage_velocity, error, noise)
      allowed = self%estimate_tolerance*min(self%speed_scale, own_speed) + velocity_roundoff*self%speed_scale
      outcome%error = norm(error/max(allowed + noise, tiny(noise)))
      call defect_error(s, n, m, self%inside, stage_velocity, error, noise)
      outcome%error = max(outcome%error, norm(error/max(allowed + noise, tiny(noise))))
      if (outcome%error <= 1.0_wp) outcome%error = max(outcome%error, &
        self%error_of_turns(system, drive, from, allowed*(turn_allowance*self%rtol/self%estimate_tolerance)))
      call self%history%control%advise(self%step, self%history%repeated, outcome%error, outcome%factor)
    end subroutine estimate_error

    !> A long implicit step damps exponential growth, and would stay on a motion that has become unstable: it may be no longer than
    !> a step that follows the growth at the stage where it is fastest. If the motion is so close to steady sliding that no
    !> disturbance is visible, there is nothing to follow.
    subroutine follow_growth(s, n, m, y)
      integer, intent(in) :: s, n, m
      real(wp), intent(in) :: y(s, m)
      real(wp) :: longest, growth, fastest, steepest(s), y_there(m), coefficient(0:n + m), weakening, limit, rate
      integer :: point(2), k
      logical :: disturbed

      self%unseen_growth = 0.0_wp
      self%emerged = .false.
      ! At the point where friction falls most with the speed, and at the end of the step.
      steepest = self%terms%force_y(1:s, 1, 1)
      if (system%is_damped) steepest = steepest + self%terms%damping(1:s, 1, 1)
      point = [maxloc(steepest, dim=1), s]
      fastest = maxval(system%frequency(system%axis:system%axis + n - 1)) + max(0.0_wp, steepest(point(1)))
      if (self%step*fastest <= self%harmless_phase) return
      longest = huge(longest)
      growth = 0.0_wp
      do k = 1, 2
        y_there = y(point(k), :)
        call system%decay_polynomial(y_there, self%drive_velocity(point(k)), coefficient, weakening)
        call follow_instability(coefficient, 2*s - 1, self%error_constant, limit, rate)
        longest = min(longest, limit)
        growth = max(growth, rate)
      end do
      if (.not. growth > 0.0_wp) return
      ! Growth is ignored if it is slower than the change that the roundoff of the forces makes in the time of the growth.
      disturbed = self%speed_scale*growth > growing_noise*system%acceleration_noise
      if (disturbed) disturbed = self%is_disturbed(system, drive, from, 0.0_wp, seen_on_ramp*self%estimate_tolerance)
      call self%look_at_growth(drive, from, growth, disturbed)
      if (disturbed) then
        if (self%step > longest) outcome%error = max(outcome%error, self%step/longest)
        outcome%factor = min(outcome%factor, shortened(longest, self%step))
      else
        outcome%factor = min(outcome%factor, largest_unseen_factor)
      end if
    end subroutine follow_growth

    !> Slip-velocity error at the end of the step from the defects of the collocation polynomial p at a probe,
    !>
    !>     d_u = V e - w(y) - p_u',      d_y = g - B p_y',
    !>
    !> and the contribution of the roundoff of the forces.
    subroutine defect_error(s, n, m, probe, stage_velocity, error, noise)
      integer, intent(in) :: s, n, m
      type(probe_t), intent(in) :: probe
      real(wp), intent(in) :: stage_velocity(s, n)
      real(wp), intent(out) :: error(n), noise(n)
      real(wp) :: velocity(1, n), velocity_y(1, n, m), defect(m), shift(n), u(n), y(m), drive_velocity, elapsed, filter_step
      real(wp) :: filter(m, m), response(n, m)
      logical :: singular
      integer :: k, l, axis

      elapsed = probe%position*self%step
      drive_velocity = drive%velocity_at(from%time + elapsed)
      do k = 1, n
        axis = system%axis + k - 1
        u(k) = from%u(axis)
        if (elapsed > 0.0_wp) u(k) = dot_product(probe%interpolation, self%nodal(:, column_u + axis - 1)) &
          + system%drive_coupling(axis)*drive%displacement(from%time, elapsed)
      end do
      do k = 1, m
        y(k) = from%y(k)
        if (elapsed > 0.0_wp) y(k) = dot_product(probe%interpolation, self%nodal(:, column_y + k - 1))
      end do
      call system%kinematics(1, y, velocity, velocity_y)
      call system%dynamics(1, [drive_velocity], u, y, velocity_y, self%point_terms)
      self%count%rhs = self%count%rhs + 1
      self%speed_scale = max(self%speed_scale, sqrt(sum(velocity**2) + (system%prescribed*drive_velocity)**2))
      filter_step = self%method%gamma*self%step
      do k = 1, n
        shift(k) = filter_step*(dot_product(probe%extrapolation(1:s), stage_velocity(:, k)) - velocity(1, k))
      end do
      do k = 1, m
        defect(k) = self%point_terms%force(1, k)
        do l = 1, n
          defect(k) = defect(k) + self%point_terms%force_u(1, k, l)*shift(l)
        end do
        defect(k) = probe%weight*(self%step*defect(k) - self%point_terms%inertia(1, k) &
          *dot_product(probe%derivative, self%nodal(:, column_y + k - 1)))
      end do
      call set_filter(n, m, self%point_terms, filter_step, velocity_y, filter)
      if (system%is_damped) call add_dampers(m, self%point_terms, filter_step, filter)
      call respond(n, m, filter, velocity_y, response, singular)
      do k = 1, n
        error(k) = 0.0_wp
        noise(k) = 0.0_wp
        do l = 1, m
          error(k) = error(k) + response(k, l)*defect(l)
          noise(k) = noise(k) + abs(response(k, l))
        end do
      end do
      noise = self%step*system%acceleration_noise*noise
      if (singular) error = huge(error)
    end subroutine defect_error
  end subroutine attempt

  !> First guess of the stage values: from the last attempt if it began at the same point, else from the last slips if they are
  !> alike, else from the last step, or from the rate and curvature at the start.
  pure subroutine predict(self, s, m, from, y)
    class(radau_t), intent(in) :: self
    integer, intent(in) :: s, m
    type(state_t), intent(in) :: from
    real(wp), intent(out) :: y(s, m)
    real(wp) :: elapsed
    integer :: i, k
    logical :: known

    known = .false.
    if (.not. self%history%repeated) call self%history%memory_of_slips%guess(self%grid, s, m, self%step, from%y(1:m), y, known)
    if (known) return
    associate (c => self%grid%node(1:s))
      if (self%history%retry) then
        do k = 1, m
          call self%grid%values_at(self%nodal(:, column_y + k - 1), s, c*(self%step/self%history%attempted_step), y(:, k))
        end do
      else if (self%history%restarted) then
        do i = 1, s
          elapsed = c(i)*self%step
          y(i, :) = from%y(:m) + elapsed*(self%history%rate(:m) + 0.5_wp*elapsed*self%history%curvature(:m))
        end do
      else
        do k = 1, m
          call self%grid%values_at(self%history%last_nodal(:, k), s, 1.0_wp + c*(self%step/self%history%control%last_step), y(:, k))
        end do
      end if
    end associate
  end subroutine predict

  !> The matrix of a one-stage implicit step of length `filter_step` at one point: B + h^2 (dg/du)(dw/dy) - h dg/dy. Of the last
  !> term only the damping part is used, and the coupling with a state of friction.
  pure subroutine set_filter(n, m, terms, filter_step, velocity_y, filter)
    integer, intent(in) :: n, m
    type(stage_terms_t), intent(in) :: terms
    real(wp), intent(in) :: filter_step, velocity_y(1, n, m)
    real(wp), intent(out) :: filter(m, m)
    real(wp) :: coupling
    integer :: i, k, l

    do k = 1, m
      do l = 1, m
        coupling = 0.0_wp
        do i = 1, n
          coupling = coupling + terms%force_u(1, k, i)*velocity_y(1, i, l)
        end do
        filter(k, l) = filter_step**2*coupling
        if (max(k, l) > n .and. k /= l) filter(k, l) = filter(k, l) - filter_step*terms%force_y(1, k, l)
      end do
      filter(k, k) = filter(k, k) + abs(terms%inertia(1, k)) + max(0.0_wp, -filter_step*terms%force_y(1, k, k))
      ! At rest without a load the direction is free: it has no equation there, and no error.
      if (.not. filter(k, k) > 0.0_wp) filter(k, k) = 1.0_wp
    end do
  end subroutine set_filter

  !> Include the dampers completely instead of their damping part: a damper resists the slip along its own axis only.
  pure subroutine add_dampers(m, terms, filter_step, filter)
    integer, intent(in) :: m
    type(stage_terms_t), intent(in) :: terms
    real(wp), intent(in) :: filter_step
    real(wp), intent(inout) :: filter(m, m)
    integer :: k

    filter = filter + filter_step*terms%damping(1, :, :)
    do k = 1, m
      filter(k, k) = filter(k, k) + max(0.0_wp, -filter_step*(terms%force_y(1, k, k) + terms%damping(1, k, k))) &
        - max(0.0_wp, -filter_step*terms%force_y(1, k, k))
    end do
  end subroutine add_dampers

  pure real(wp) function norm(vector)
    real(wp), intent(in) :: vector(:)

    norm = sqrt(sum(vector**2))
  end function norm

  !> Change of the slip velocity by a filtered defect, (dw/dy) filter^-1.
  pure subroutine respond(n, m, filter, velocity_y, response, singular)
    integer, intent(in) :: n, m
    real(wp), intent(in) :: filter(m, m), velocity_y(n, m)
    real(wp), intent(out) :: response(n, m)
    logical, intent(out) :: singular
    real(wp) :: determinant, matrix(m, m), row(m)
    integer :: k

    select case (m)
    case (1)
      determinant = filter(1, 1)
      response(1, 1) = velocity_y(1, 1)
    case (2)
      determinant = filter(1, 1)*filter(2, 2) - filter(1, 2)*filter(2, 1)
      response(:, 1) = velocity_y(:, 1)*filter(2, 2) - velocity_y(:, 2)*filter(2, 1)
      response(:, 2) = velocity_y(:, 2)*filter(1, 1) - velocity_y(:, 1)*filter(1, 2)
    case default
      do k = 1, n
        matrix = transpose(filter)
        row = velocity_y(k, :)
        call solve_in_place(m, matrix, row, singular)
        response(k, :) = row
        if (singular) return
      end do
      return
    end select
    singular = .not. abs(determinant) > 0.0_wp
    if (.not. singular) response = response/determinant
  end subroutine respond

  pure subroutine accept(self)
    class(radau_t), intent(inout) :: self

    self%history%restarted = .false.
    self%history%retry = .false.
    self%history%repeated = .false.
    call self%history%control%accept(self%step)
    call self%note_speed()
    self%history%last_nodal = self%nodal(:, column_y:column_y + max_unknowns - 1)
    call self%history%memory_of_slips%keep(self%step, self%history%last_nodal)
    call self%note_growth()
  end subroutine accept

  !> Save or load. Stage values and terms are scratch: each attempt computes them again.
  subroutine serialise(self, archive)
    class(radau_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call serialise_stepper(self, archive)
    call archive%serialise(c_loc(self%history), storage_size(self%history))
  end subroutine serialise
end module dst_radau
