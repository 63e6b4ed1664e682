!> The full model (Nakano & Popov 2020, Eqs. 1-5) in two sets of slip unknowns.
!>
!> Polar, for the exact contact: y = (v, theta), w = v (cos theta, sin theta),
!>     v' = (K u . n - F(v))/m,    v theta' = K u . t/m,    n = (cos, sin), t = (-sin, cos).
!> Smooth through v = 0 in this form. With dampers C parallel to the springs, K u is replaced by K u + C (V e - w) everywhere.
!>
!> Cartesian, for the smoothed contact: y = w,
!>     w' = (K u - F(|w|) w/sqrt(|w|^2 + v_s^2))/m.
module dst_full_model
  use dst_kinds, only: wp, pi
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, max_unknowns
  implicit none
  private

  public :: full_polar_t, full_smoothed_t, new_full_polar, new_full_smoothed, plane_decay

  !> The exact contact in slip, in the unknowns y = (v, theta).
  type, extends(slip_system_t) :: full_polar_t
  contains
    procedure :: kinematics => polar_kinematics
    procedure :: dynamics => polar_dynamics
    procedure :: slip_velocity => polar_velocity
    procedure :: decay_polynomial => polar_decay
    procedure :: has_turned => polar_turned
  end type full_polar_t

  !> The smoothed contact, in the unknowns y = w.
  type, extends(slip_system_t) :: full_smoothed_t
  contains
    procedure :: kinematics => smoothed_kinematics
    procedure :: dynamics => smoothed_dynamics
    procedure :: slip_velocity => smoothed_velocity
    procedure :: decay_polynomial => smoothed_decay
  end type full_smoothed_t

contains

  !> The exact contact of a slider.
  function new_full_polar(slider) result(model)
    type(slider_t), intent(in) :: slider
    type(full_polar_t) :: model

    call model%take(slider)
    model%is_polar = .true.
    model%advance_by_slip = slider%along
  end function new_full_polar

  !> For slider%smoothing > 0.
  function new_full_smoothed(slider) result(model)
    type(slider_t), intent(in) :: slider
    type(full_smoothed_t) :: model

    call model%take(slider)
    model%advance_by_slip = slider%along
  end function new_full_smoothed

  pure subroutine polar_kinematics(self, stages, y, velocity, velocity_y)
    class(full_polar_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: y(stages, self%unknowns)
    real(wp), intent(out) :: velocity(stages, self%components)
    real(wp), intent(out) :: velocity_y(stages, self%components, self%unknowns)
    integer :: i

    do i = 1, stages
      velocity_y(i, 1, 1) = cos(y(i, 2))
      velocity_y(i, 2, 1) = sin(y(i, 2))
    end do
    velocity(:, 1) = y(:, 1)*velocity_y(:, 1, 1)
    velocity(:, 2) = y(:, 1)*velocity_y(:, 2, 1)
    velocity_y(:, 1, 2) = -velocity(:, 2)
    velocity_y(:, 2, 2) = velocity(:, 1)
  end subroutine polar_kinematics

  pure subroutine polar_dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(full_polar_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms
    real(wp) :: friction(stages), slope(stages), velocity(stages, 2), springs(stages, 2), accel_x, accel_y, per_mass
    integer :: i

    call self%slider%law%evaluate(stages, y(:, 1), friction, slope)
    per_mass = 1.0_wp/self%slider%mass
    associate (k => self%slider%stiffness)
      do i = 1, stages
        associate (cosine => velocity_y(i, 1, 1), sine => velocity_y(i, 2, 1))
          terms%force_u(i, 1, 1) = k(1)*cosine*per_mass
          terms%force_u(i, 1, 2) = k(2)*sine*per_mass
          terms%force_u(i, 2, 1) = -k(1)*sine*per_mass
          terms%force_u(i, 2, 2) = k(2)*cosine*per_mass
        end associate
        accel_x = terms%force_u(i, 1, 1)*u(i, 1) + terms%force_u(i, 1, 2)*u(i, 2)
        accel_y = terms%force_u(i, 2, 1)*u(i, 1) + terms%force_u(i, 2, 2)*u(i, 2)
        terms%force(i, 1) = accel_x - friction(i)*per_mass
        terms%force(i, 2) = accel_y
        terms%force_y(i, 1, 1) = -slope(i)*per_mass
        terms%force_y(i, 1, 2) = accel_y
        terms%force_y(i, 2, 1) = 0.0_wp
        terms%force_y(i, 2, 2) = -accel_x
        terms%inertia(i, 1) = 1.0_wp
        terms%inertia(i, 2) = y(i, 1)
        terms%inertia_y(i, 1, 1) = 0.0_wp
        terms%inertia_y(i, 1, 2) = 0.0_wp
        terms%inertia_y(i, 2, 1) = 1.0_wp
        terms%inertia_y(i, 2, 2) = 0.0_wp
        terms%dissipation(i) = friction(i)*y(i, 1)
        terms%dissipation_y(i, 1) = friction(i) + slope(i)*y(i, 1)
        terms%dissipation_y(i, 2) = 0.0_wp
      end do
    end associate
    if (.not. self%is_damped) return
    ! The force of the dampers turns with the direction of slip as that of the springs does.
    velocity(:, 1) = y(:, 1)*velocity_y(:, 1, 1)
    velocity(:, 2) = y(:, 1)*velocity_y(:, 2, 1)
    springs = terms%force(1:stages, 1:2)
    call self%add_dampers(stages, drive_velocity, velocity, velocity_y, terms)
    do i = 1, stages
      terms%force_y(i, 1, 2) = terms%force_y(i, 1, 2) + (terms%force(i, 2) - springs(i, 2))
      terms%force_y(i, 2, 2) = terms%force_y(i, 2, 2) - (terms%force(i, 1) - springs(i, 1))
    end do
  end subroutine polar_dynamics

  pure function polar_velocity(self, y, drive_velocity) result(velocity)
    class(full_polar_t), intent(in) :: self
    real(wp), intent(in) :: y(max_unknowns), drive_velocity
    real(wp) :: velocity(2)

    velocity = y(1)*[cos(y(2)), sin(y(2))]
  end function polar_velocity

  pure logical function polar_turned(self, before, after)
    class(full_polar_t), intent(in) :: self
    real(wp), intent(in) :: before(:), after(:)

    polar_turned = abs(after(2) - before(2)) > 0.5_wp*pi
  end function polar_turned

  pure subroutine polar_decay(self, y, drive_velocity, coefficient, weakening)
    class(full_polar_t), intent(in) :: self
    real(wp), intent(in) :: y(self%unknowns), drive_velocity
    real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening
    !> A direction that relaxes so much faster than the springs oscillate follows at once: a higher rate makes no difference.
    real(wp), parameter :: at_once = 1.0e8_wp
    real(wp) :: friction(1), slope(1), across

    call self%slider%law%evaluate(1, y(1:1), friction, slope)
    weakening = -slope(1)/self%slider%mass
    across = at_once*sqrt(self%slider%mass*maxval(self%slider%stiffness))
    if (across*abs(y(1)) > friction(1)) across = friction(1)/abs(y(1))
    coefficient = plane_decay(self%slider, [cos(y(2)), sin(y(2))], slope(1), across)
  end subroutine polar_decay

  !> Coefficients, by rising power, of the determinant of m lambda^2 + D lambda + K over m^2, with D = F' n n^T + (F/v) t t^T + C:
  !> `along` is F' and `across` F/v [N s/m], C the dampers.
  pure function plane_decay(slider, n, along, across) result(coefficient)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: n(2), along, across
    real(wp) :: coefficient(0:4)
    real(wp) :: damping(2), frequency_square(2)

    associate (m => slider%mass)
      damping = [along*n(1)**2 + across*n(2)**2, along*n(2)**2 + across*n(1)**2]/m
      frequency_square = slider%stiffness/m
      coefficient = [product(frequency_square), damping(1)*frequency_square(2) + damping(2)*frequency_square(1), &
        sum(frequency_square) + (along/m)*(across/m), (along + across)/m, 1.0_wp]
      if (.not. slider%is_damped()) return
      associate (dampers => slider%damping/m)
        coefficient(1) = coefficient(1) + dampers(1)*frequency_square(2) + dampers(2)*frequency_square(1)
        coefficient(2) = coefficient(2) + dampers(1)*damping(2) + dampers(2)*damping(1) + product(dampers)
        coefficient(3) = coefficient(3) + sum(dampers)
      end associate
    end associate
  end function plane_decay

  pure subroutine smoothed_kinematics(self, stages, y, velocity, velocity_y)
    class(full_smoothed_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: y(stages, self%unknowns)
    real(wp), intent(out) :: velocity(stages, self%components)
    real(wp), intent(out) :: velocity_y(stages, self%components, self%unknowns)

    velocity = y(:, 1:2)
    velocity_y(:, :, 3:) = 0.0_wp
    velocity_y(:, 1, 1) = 1.0_wp
    velocity_y(:, 2, 1) = 0.0_wp
    velocity_y(:, 1, 2) = 0.0_wp
    velocity_y(:, 2, 2) = 1.0_wp
  end subroutine smoothed_kinematics

  pure subroutine smoothed_dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(full_smoothed_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms
    real(wp) :: speed(stages), friction(stages), slope(stages)
    real(wp) :: per_mass, smooth, viscosity, curvature
    integer :: i, j, k

    per_mass = 1.0_wp/self%slider%mass
    speed = sqrt(y(:, 1)**2 + y(:, 2)**2)
    call self%slider%law%evaluate(stages, speed, friction, slope)
    do i = 1, stages
      smooth = sqrt(speed(i)**2 + self%slider%smoothing)
      viscosity = friction(i)/smooth
      ! d(F/smooth)/d|w| / |w|, written without a division by |w| where F' vanishes with it.
      curvature = -viscosity/smooth**2
      if (speed(i) > 0.0_wp) curvature = curvature + slope(i)/(smooth*speed(i))
      do k = 1, 2
        do j = 1, 2
          terms%force_y(i, j, k) = -per_mass*curvature*y(i, j)*y(i, k)
          terms%inertia_y(i, j, k) = 0.0_wp
          terms%force_u(i, j, k) = 0.0_wp
        end do
        terms%force_y(i, k, k) = terms%force_y(i, k, k) - per_mass*viscosity
        terms%force_u(i, k, k) = per_mass*self%slider%stiffness(k)*velocity_y(i, k, k)
        terms%force(i, k) = per_mass*(self%slider%stiffness(k)*u(i, k) - viscosity*y(i, k))
        terms%inertia(i, k) = 1.0_wp
      end do
      terms%dissipation(i) = viscosity*speed(i)**2
      terms%dissipation_y(i, :) = (2.0_wp*viscosity + curvature*speed(i)**2)*y(i, :)
    end do
    if (self%is_damped) call self%add_dampers(stages, drive_velocity, y(:, 1:2), velocity_y, terms)
  end subroutine smoothed_dynamics

  pure function smoothed_velocity(self, y, drive_velocity) result(velocity)
    class(full_smoothed_t), intent(in) :: self
    real(wp), intent(in) :: y(max_unknowns), drive_velocity
    real(wp) :: velocity(2)

    velocity = y(1:2)
  end function smoothed_velocity

  pure subroutine smoothed_decay(self, y, drive_velocity, coefficient, weakening)
    class(full_smoothed_t), intent(in) :: self
    real(wp), intent(in) :: y(self%unknowns), drive_velocity
    real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening
    real(wp) :: friction(1), slope(1), speed, smooth, direction(2)

    speed = hypot(y(1), y(2))
    smooth = sqrt(speed**2 + self%slider%smoothing)
    direction = [1.0_wp, 0.0_wp]
    if (speed > 0.0_wp) direction = y/speed
    call self%slider%law%evaluate(1, [speed], friction, slope)
    weakening = -slope(1)/self%slider%mass
    coefficient = plane_decay(self%slider, direction, (slope(1)*speed + friction(1)*self%slider%smoothing/smooth**2)/smooth, &
      friction(1)/smooth)
  end subroutine smoothed_decay
end module dst_full_model
