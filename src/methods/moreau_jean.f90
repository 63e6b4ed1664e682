!> The Moreau-Jean scheme: fixed step, no events, for the full model with the exact contact.
!>
!> Friction is an impulse over the step and obeys the set-valued law at its end, so that rest is one of the solutions of a step and
!> needs no event. With the elongation u, the slip velocity w (Cartesian), K = diag(k_x, k_y), D the drive's displacement over the
!> step h, and theta = 1/2,
!>
!>     u_1 = u_0 + D e - h w_h,                  w_h = theta w_1 + (1 - theta) w_0,
!>     m (w_1 - w_0) = h K u_h - h f_1,          u_h = theta u_1 + (1 - theta) u_0,
!>     f_1 = F(|w_1|) w_1/|w_1|  or, where w_1 = 0,  |f_1| <= F_0.
!>
!> An object that rests, or whose slip turns back on a straight line within the step, sticks up to the static limit F_s >= F_0. If
!> slip ends with w_1 = 0 under more than F_0, it does not rest but turns (dst_rest): it goes on from a speed that is roundoff.
!>
!> Eliminating u_1 leaves A w_1 + f_1 = b with the diagonal A = m/h + theta^2 h K and
!> b = m w_0/h + K (u_0 + theta D e - theta (1 - theta) h w_0): either |b| <= F_0 and w_1 = 0, or
!> w_1 = r b/(a r + F(r)) component by component, with the speed r = |w_1| from one scalar equation.
!>
!> Dampers C add the impulse C (u_1 - u_0) = h C (D e/h - w_h): A then contains theta C, and b contains C (D e/h - (1 - theta) w_0).
!>
!> theta = 1/2 damps no oscillation: without friction the scheme is of second order, with friction, which is taken at the end of the
!> step, of first order. The energy balance of a step, change = D e . K u_h - h f_1 . w_h, holds to roundoff; with dampers, too, if
!> their power is included.
!>
!> Source: M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177 (1999)
!> 235; V. Acary and B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), Ch. 10.
module dst_moreau_jean
  use dst_kinds, only: wp
  use dst_dense_output, only: column_u, column_y, column_position
  use dst_drive, only: drive_segment_t
  use dst_friction, only: friction_law_t
  use dst_interpolation, only: new_grid
  use dst_rest, only: comes_to_rest, is_on_line
  use dst_roots, only: bracket_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t
  use dst_state, only: state_t
  use dst_stepper, only: stepper_t, attempt_t
  implicit none
  private

  public :: moreau_jean_t, new_moreau_jean, speed_after

  real(wp), parameter :: theta = 0.5_wp

  !> The scheme for one slider.
  type, extends(stepper_t) :: moreau_jean_t
    type(slider_t) :: slider
  contains
    procedure :: restart
    procedure :: attempt
    procedure :: accept
  end type moreau_jean_t

contains

  !> The scheme for this slider; the unknowns are its slip velocity in the principal axes.
  function new_moreau_jean(slider) result(stepper)
    type(slider_t), intent(in) :: slider
    type(moreau_jean_t) :: stepper

    stepper%slider = slider
    ! The slip velocity is linear within a step, so the elongation is quadratic.
    stepper%grid = new_grid([0.0_wp, 0.5_wp, 1.0_wp])
  end function new_moreau_jean

  !> A step does not use the ones before.
  pure subroutine restart(self, rate, curvature)
    class(moreau_jean_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    associate (unused => [rate, curvature])
    end associate
    self%start_speed = 0.0_wp
    self%peak_speed = 0.0_wp
  end subroutine restart

  !> One step. `system` must have the slip velocity as its unknowns.
  subroutine attempt(self, system, drive, from, step, to, outcome)
    class(moreau_jean_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    real(wp), dimension(2) :: driven, inertia, free_force, friction, mean_velocity, mean_elongation, rate

    self%step = step
    associate (m => self%slider%mass, k => self%slider%stiffness, w => from%y(1:2))
      driven = drive%displacement(from%time, step)*system%drive_coupling
      inertia = m/step + theta**2*step*k
      free_force = m*w/step + k*(from%u + theta*(driven - (1.0_wp - theta)*step*w))
      if (self%slider%is_damped()) then
        inertia = inertia + theta*self%slider%damping
        free_force = free_force + self%slider%damping*(driven/step - (1.0_wp - theta)*w)
      end if
      if (is_held(self%slider, free_force, w, from%u, drive%velocity_at(from%time))) then
        to%y(1:2) = 0.0_wp
        friction = free_force
      else
        call slip_velocity_after(self, inertia, free_force, hypot(w(1), w(2)), to%y(1:2), friction)
      end if
      mean_velocity = theta*to%y(1:2) + (1.0_wp - theta)*w
      to%u = from%u + driven - step*mean_velocity
      mean_elongation = theta*to%u + (1.0_wp - theta)*from%u
      call to%later(from, step)
      call turn(self%slider, drive, w, to)
      to%position = from%position + step*dot_product(system%drive_coupling, mean_velocity)
      to%drive_work = from%drive_work + dot_product(driven, k*mean_elongation)
      to%friction_work = from%friction_work + step*dot_product(friction, mean_velocity)
      to%damper_work = from%damper_work
      if (self%slider%is_damped()) then
        rate = driven/step - mean_velocity
        to%drive_work = to%drive_work + dot_product(driven, self%slider%damping*rate)
        to%damper_work = from%damper_work + step*dot_product(rate, self%slider%damping*rate)
      end if
      self%speed_scale = max(hypot(w(1), w(2)), hypot(to%y(1), to%y(2)))
    end associate
    call set_nodal(self, system, from, to)
    outcome = attempt_t(solved=.true., error=0.0_wp, factor=1.0_wp)
  end subroutine attempt

  !> Whether static friction above the kinetic one holds the object: one that is at rest, or that has been at rest in the step
  !> because it turns back on a straight line.
  pure logical function is_held(slider, free_force, velocity, u, drive_velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: free_force(2), velocity(2)      !! b [N] and w_0 [m/s]
    real(wp), intent(in) :: u(2), drive_velocity            !! m, m/s
    real(wp) :: speed

    is_held = slider%law%static_limit > slider%law%kinetic_limit
    if (is_held) is_held = hypot(free_force(1), free_force(2)) <= slider%law%static_limit
    speed = hypot(velocity(1), velocity(2))
    if (is_held .and. speed > 0.0_wp) is_held = dot_product(free_force, velocity) <= 0.0_wp .and. &
      is_on_line(slider, velocity/speed, u, drive_velocity)
  end function is_held

  !> Let slip with the velocity `before` [m/s] that ended within the step go on in the direction of the force, if it does not come
  !> to rest. That matters only if the static limit would hold it.
  pure subroutine turn(slider, drive, before, to)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    real(wp), intent(in) :: before(2)
    type(state_t), intent(inout) :: to
    real(wp) :: force(2), drive_velocity

    if (.not. slider%law%static_limit > slider%law%kinetic_limit) return
    if (any(abs(to%y(1:2)) > 0.0_wp) .or. .not. any(abs(before) > 0.0_wp)) return
    drive_velocity = drive%velocity_at(to%time)
    if (comes_to_rest(slider, atan2(before(2), before(1)), to%u, drive_velocity, drive%acceleration)) return
    force = slider%force_at_rest(to%u, drive_velocity)
    to%y(1:2) = epsilon(1.0_wp)*hypot(before(1), before(2))*force/hypot(force(1), force(2))
  end subroutine turn

  !> w_1 and f_1 of A w_1 + f_1 = b.
  subroutine slip_velocity_after(self, inertia, free_force, speed_before, velocity, friction)
    class(moreau_jean_t), intent(inout) :: self
    real(wp), intent(in) :: inertia(2), free_force(2)   !! A [kg/s] and b [N]
    real(wp), intent(in) :: speed_before                !! m/s
    real(wp), intent(out) :: velocity(2), friction(2)   !! m/s, N
    real(wp) :: force(1), slope(1), speed
    integer :: iterations

    call speed_after(self%slider%law, inertia, free_force, speed_before, speed, iterations)
    self%count%newton = self%count%newton + iterations
    self%count%rhs = self%count%rhs + 1
    velocity = 0.0_wp
    friction = free_force
    if (.not. speed > 0.0_wp) return
    call self%slider%law%evaluate(1, [speed], force, slope)
    velocity = speed*free_force/(inertia*speed + force(1))
    friction = force(1)*free_force/(inertia*speed + force(1))
  end subroutine slip_velocity_after

  !> The slip speed r at the end of a step, 0 for rest. With q = A r + F(r), slip is a zero of
  !>
  !>     e(r) = 1/|b/q| - 1,
  !>
  !> the excess of resistance over the free force: if it is negative the speed rises, if it is positive the speed falls. In steps so
  !> long that friction weakens faster than inertia grows, several speeds, rest among them, solve the step. The solution used is the
  !> one to which the speed rises or falls from the speed before: the continuation of the motion.
  pure subroutine speed_after(law, inertia, free_force, before, speed, iterations)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: inertia(2), free_force(2)   !! A [kg/s] and b [N]
    real(wp), intent(in) :: before                      !! slip speed at the start of the step, m/s
    real(wp), intent(out) :: speed                      !! m/s
    integer, intent(out) :: iterations
    real(wp) :: low, high, value, slope, force(1), weakening(1)
    logical :: can_rest, falls
    integer :: pieces
    integer, parameter :: most_pieces = 64

    speed = 0.0_wp
    iterations = 0
    can_rest = hypot(free_force(1), free_force(2)) <= law%kinetic_limit
    call law%evaluate(1, [0.0_wp], force, weakening)
    ! Friction weakens most at rest. If inertia outweighs that, e never falls and there is only one solution.
    pieces = merge(1, most_pieces, minval(inertia) + weakening(1) >= 0.0_wp)
    if (pieces == 1 .and. can_rest) return
    call excess(law, inertia, free_force, before, can_rest, value, slope)
    falls = value >= 0.0_wp
    if (falls) then
      low = 0.0_wp
      high = before
    else
      ! Friction does not accelerate the object: the speed is below this limit.
      low = before
      high = max(before, 2.0_wp*maxval(abs(free_force)/inertia))
    end if
    call narrow(law, inertia, free_force, can_rest, falls, pieces, low, high)
    if (high > 0.0_wp) call find_zero(law, inertia, free_force, can_rest, before, low, high, speed, iterations)
  end subroutine speed_after

  !> Narrow the speeds between `low` and `high`, one of which is the speed before, to the interval next to it in which e changes its
  !> sign; both become 0 if the object stops.
  pure subroutine narrow(law, inertia, free_force, can_rest, falls, pieces, low, high)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: inertia(2), free_force(2)
    logical, intent(in) :: can_rest, falls
    integer, intent(in) :: pieces
    real(wp), intent(inout) :: low, high
    real(wp) :: start, finish, edge, next, value, slope
    integer :: i

    if (pieces == 1) return
    start = merge(high, low, falls)
    finish = merge(low, high, falls)
    edge = start
    do i = 1, pieces
      next = start + (finish - start)*(real(i, wp)/real(pieces, wp))
      if (i == pieces) next = finish
      call excess(law, inertia, free_force, next, can_rest, value, slope)
      if ((value >= 0.0_wp) .neqv. falls) exit
      edge = next
    end do
    low = min(edge, next)
    high = max(edge, next)
  end subroutine narrow

  !> The zero of e between `low` and `high`: Newton's method, and bisection if that leaves the interval or is slow.
  pure subroutine find_zero(law, inertia, free_force, can_rest, guess, low, high, speed, iterations)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: inertia(2), free_force(2), guess
    logical, intent(in) :: can_rest
    real(wp), intent(in) :: low, high
    real(wp), intent(out) :: speed
    integer, intent(out) :: iterations
    type(bracket_t) :: bracket
    real(wp) :: value, slope, next
    integer, parameter :: most_iterations = 200, halving = 8

    bracket = bracket_t([low, high], [-1.0_wp, 1.0_wp])
    speed = bracket%middle()
    if (guess > 0.0_wp .and. guess >= low .and. guess <= high) speed = guess
    do iterations = 1, most_iterations
      call excess(law, inertia, free_force, speed, can_rest, value, slope)
      ! Roundoff of e: the free force has no more digits.
      if (abs(value) <= 4.0_wp*epsilon(value)) exit
      call bracket%narrow(speed, value)
      next = bracket%middle()
      if (modulo(iterations, halving) /= 0) next = bracket%newton(speed, value, slope)
      if (min(abs(next - speed), bracket%width()) <= 2.0_wp*epsilon(speed)*speed) exit
      speed = next
    end do
  end subroutine find_zero

  !> e(r) and e'(r); at r = 0 only the sign counts, which says whether rest is possible.
  pure subroutine excess(law, inertia, free_force, speed, can_rest, value, slope)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: inertia(2), free_force(2), speed
    logical, intent(in) :: can_rest
    real(wp), intent(out) :: value, slope
    real(wp) :: force(1), weakening(1), resistance(2), share(2), total

    slope = 0.0_wp
    value = merge(1.0_wp, -1.0_wp, can_rest)
    if (.not. speed > 0.0_wp) return
    call law%evaluate(1, [speed], force, weakening)
    resistance = inertia*speed + force(1)
    share = free_force/resistance
    total = hypot(share(1), share(2))
    value = huge(value)
    if (.not. total > 0.0_wp) return
    value = 1.0_wp/total - 1.0_wp
    slope = sum((share/total)**2*(inertia + weakening(1))/resistance)/total
  end subroutine excess

  !> Node values of the dense output: w linear, u and X its integrals.
  pure subroutine set_nodal(self, system, from, to)
    class(moreau_jean_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(state_t), intent(in) :: from, to
    real(wp) :: slipped(2), tau
    integer :: i

    associate (before => from%y(1:2), after => to%y(1:2))
      do i = 0, self%grid%degree
        tau = self%grid%node(i)
        slipped = tau*self%step*(before + 0.5_wp*tau*(after - before))
        self%nodal(i, column_u:column_u + 1) = from%u - slipped
        self%nodal(i, column_y:column_y + 1) = before + tau*(after - before)
        self%nodal(i, column_position) = from%position + dot_product(system%drive_coupling, slipped)
      end do
    end associate
  end subroutine set_nodal

  pure subroutine accept(self)
    class(moreau_jean_t), intent(inout) :: self

    call self%note_speed()
  end subroutine accept
end module dst_moreau_jean
