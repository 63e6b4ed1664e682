!> The slow motion alone: the stiff spring is rigid (Eq. 4 of Nakano & Popov 2020 with u_y' = 0).
!>
!> Normal to the soft axis the object follows the drive, w_y = V s with s = sin(phi), so that the slip speed v = sqrt(w_x^2 + (V
!> s)^2) is never zero while the drive moves. One unknown, y = w_x:
!>
!>     u_x' = V c - w_x,      w_x' = (k_x u_x - F(v) w_x/v)/m.
!>
!> A damper parallel to the soft spring adds c_x u_x' to its force. The force of the rigid spring is F(v) V s/v + m s V'. The
!> drive's work against friction along the stiff axis enters as `supply`; the inertia of the prescribed motion is in neither work
!> nor energy.
!>
!> If V s = 0 the object can rest, and dst_straight_slip is used.
module dst_low_frequency
  use dst_kinds, only: wp
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, max_unknowns
  implicit none
  private

  public :: low_frequency_t, new_low_frequency, slow_forces

  !> The slow motion of a slider, in the unknown y = w_x.
  type, extends(slip_system_t) :: low_frequency_t
  contains
    procedure :: kinematics
    procedure :: dynamics
    procedure :: slip_velocity
    procedure :: decay_polynomial
  end type low_frequency_t

contains

  !> The slow motion of a slider.
  function new_low_frequency(slider) result(model)
    type(slider_t), intent(in) :: slider
    type(low_frequency_t) :: model

    call model%take(slider)
    model%components = 1
    model%unknowns = 1
    model%turns_back = .true.
    model%axis = 1
    model%drive_coupling = [slider%along(1), 0.0_wp]
    model%drive_stiffness = slider%stiffness(1)*model%drive_coupling
    model%advance_by_slip = model%drive_coupling
    model%advance_by_drive = slider%along(2)**2
    model%prescribed = slider%along(2)
  end function new_low_frequency

  pure subroutine kinematics(self, stages, y, velocity, velocity_y)
    class(low_frequency_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: y(stages, self%unknowns)
    real(wp), intent(out) :: velocity(stages, self%components)
    real(wp), intent(out) :: velocity_y(stages, self%components, self%unknowns)
    integer :: i

    do i = 1, stages
      velocity(i, 1) = y(i, 1)
      velocity_y(i, 1, 1) = 1.0_wp
    end do
  end subroutine kinematics

  pure subroutine dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(low_frequency_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms
    real(wp), dimension(stages) :: across, speed, friction, slope, pull, force, damping
    real(wp) :: per_mass, stiffness
    integer :: i

    per_mass = 1.0_wp/self%slider%mass
    stiffness = self%slider%stiffness(1)
    do i = 1, stages
      pull(i) = stiffness*u(i, 1)
      across(i) = self%prescribed*drive_velocity(i)
      speed(i) = sqrt(y(i, 1)**2 + across(i)**2)
    end do
    call self%slider%law%evaluate(stages, speed, friction, slope)
    call slow_forces(stages, pull, y, across, speed, friction, slope, force, damping, &
      terms%dissipation, terms%dissipation_y, terms%supply, terms%supply_y)
    do i = 1, stages
      terms%force(i, 1) = per_mass*force(i)
      terms%force_u(i, 1, 1) = per_mass*stiffness*velocity_y(i, 1, 1)
      terms%force_y(i, 1, 1) = -per_mass*damping(i)
      terms%inertia(i, 1) = 1.0_wp
      terms%inertia_y(i, 1, 1) = 0.0_wp
    end do
    if (self%is_damped) call self%add_dampers(stages, drive_velocity, y, velocity_y, terms)
  end subroutine dynamics

  include 'slow_forces.inc'

  pure function slip_velocity(self, y, drive_velocity) result(velocity)
    class(low_frequency_t), intent(in) :: self
    real(wp), intent(in) :: y(max_unknowns), drive_velocity
    real(wp) :: velocity(2)

    velocity = [y(1), self%prescribed*drive_velocity]
  end function slip_velocity

  pure subroutine decay_polynomial(self, y, drive_velocity, coefficient, weakening)
    class(low_frequency_t), intent(in) :: self
    real(wp), intent(in) :: y(self%unknowns), drive_velocity
    real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening
    real(wp) :: friction(1), slope(1), speed, across

    across = self%prescribed*drive_velocity
    speed = sqrt(y(1)**2 + across**2)
    call self%slider%law%evaluate(1, [speed], friction, slope)
    associate (m => self%slider%mass)
      weakening = -slope(1)/m
      coefficient = [self%slider%stiffness(1)/m, (slope(1)*y(1)**2 + friction(1)*across**2/speed)/(m*speed**2), 1.0_wp]
      if (self%is_damped) coefficient(1) = coefficient(1) + self%damping(1)/m
    end associate
  end subroutine decay_polynomial
end module dst_low_frequency
