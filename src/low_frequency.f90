!> The slow motion alone: the stiff spring is rigid (Eq. 4 of Nakano & Popov 2020 with u_y' = 0).
!>
!> Across the soft axis the object follows the drive, w_y = V s with s = sin(phi), so that the slip speed
!> v = sqrt(w_x^2 + (V s)^2) never vanishes while the drive moves. One unknown, y = w_x:
!>
!>     u_x' = V c - w_x,      w_x' = (k_x u_x - F(v) w_x/v)/m.
!>
!> The guiding force of the rigid spring is F(v) V s/v + m s V'. The drive's work against friction across
!> the axis enters as `supply`; the inertia of the guided motion is in neither work nor energy.
!>
!> Where V s = 0 there is rest, and dst_straight_slip takes over.
module dst_low_frequency
  use dst_kinds, only: wp
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, max_components
  implicit none
  private

  public :: low_frequency_t, new_low_frequency

  type, extends(slip_system_t) :: low_frequency_t
    type(slider_t) :: slider
  contains
    procedure :: kinematics
    procedure :: dynamics
    procedure :: slip_velocity
  end type low_frequency_t

contains

  pure function new_low_frequency(slider) result(model)
    type(slider_t), intent(in) :: slider
    type(low_frequency_t) :: model

    model%slider = slider
    model%components = 1
    model%axis = 1
    model%along = [slider%along(1), 0.0_wp]
    model%along_stiffness = slider%stiffness(1)*model%along
    model%forward = model%along
    model%carried = slider%along(2)**2
    model%guided = slider%along(2)
    model%acceleration_noise = 8.0_wp*epsilon(1.0_wp)*slider%law%onset/slider%mass
  end function new_low_frequency

  pure subroutine kinematics(self, stages, y, velocity, velocity_y)
    class(low_frequency_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: y(stages, self%components)
    real(wp), intent(out) :: velocity(stages, self%components)
    real(wp), intent(out) :: velocity_y(stages, self%components, self%components)

    velocity = y
    velocity_y = 1.0_wp
  end subroutine kinematics

  pure subroutine dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(low_frequency_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%components)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%components)
    type(stage_terms_t), intent(inout) :: terms
    real(wp), dimension(stages) :: across, speed, friction, slope, along_share, across_share
    real(wp) :: per_mass

    per_mass = 1.0_wp/self%slider%mass
    across = self%guided*drive_velocity
    speed = sqrt(y(:, 1)**2 + across**2)
    call self%slider%law%evaluate(stages, speed, friction, slope)
    along_share = y(:, 1)/speed
    across_share = across/speed
    terms%force(:, 1) = per_mass*(self%slider%stiffness(1)*u(:, 1) - friction*along_share)
    terms%force_u(:, 1, 1) = per_mass*self%slider%stiffness(1)*velocity_y(:, 1, 1)
    terms%force_y(:, 1, 1) = -per_mass*(slope*along_share**2 + friction*across_share**2/speed)
    terms%inertia(:, 1) = 1.0_wp
    terms%inertia_y(:, 1, 1) = 0.0_wp
    terms%dissipation = friction*speed
    terms%dissipation_y(:, 1) = (friction + slope*speed)*along_share
    terms%supply = friction*across*across_share
    terms%supply_y(:, 1) = (slope*speed - friction)*across_share**2*along_share
  end subroutine dynamics

  pure function slip_velocity(self, y, drive_velocity) result(velocity)
    class(low_frequency_t), intent(in) :: self
    real(wp), intent(in) :: y(max_components), drive_velocity
    real(wp) :: velocity(2)

    velocity = [y(1), self%guided*drive_velocity]
  end function slip_velocity
end module dst_low_frequency
