!> Slip that keeps the direction n = (cos theta, sin theta) in which it began, with one elongation that follows it. One unknown,
!> y = v >= 0; along the axis i of that elongation
!>
!>     u_i' = V e_i - v n_i,      v' = (K u . n - F(v))/m,
!>
!> the other elongation is constant. A damper parallel to the spring that follows adds c_i u_i' to its force. Rest and release are
!> those of the exact contact.
!>
!> These are two models. `high_frequency` (Eq. 9 of Nakano & Popov 2020; i = 2): the longitudinal load k_x u_x = F_0 cos theta is
!> given, and the object oscillates on the stiff spring with the mass m/sin^2 theta, since friction keeps it on a line in this
!> direction. `low_frequency` if the drive prescribes no motion normal to the soft axis, V sin(phi) = 0 (i = 1): u_y = 0, theta = 0
!> or pi.
module dst_straight_slip
  use dst_kinds, only: wp, pi
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, max_unknowns
  implicit none
  private

  public :: straight_slip_t, new_straight_slip, on_line

  !> Slip of a slider along a fixed line, in the unknown y = v.
  type, extends(slip_system_t) :: straight_slip_t
    !> Direction n of the slip, and the force of the spring of constant elongation in that direction [N].
    real(wp) :: direction(2) = [1.0_wp, 0.0_wp]
    real(wp) :: held_force = 0.0_wp
    !> Elongations, of which only the constant one is used [m].
    real(wp) :: held(2) = 0.0_wp
  contains
    procedure :: kinematics
    procedure :: dynamics
    procedure :: slip_velocity
    procedure :: decay_polynomial
    procedure :: set_slip_direction
  end type straight_slip_t

contains

  !> The model that follows principal axis `axis`; the elongation along the other axis keeps its value in `held` [m]. slider%free
  !> and slider%direction_free say the same to the contact.
  function new_straight_slip(slider, axis, held) result(model)
    type(slider_t), intent(in) :: slider
    integer, intent(in) :: axis
    real(wp), intent(in) :: held(2)
    type(straight_slip_t) :: model

    call model%take(slider)
    model%components = 1
    model%unknowns = 1
    model%axis = axis
    model%held = held
    call model%set_slip_direction(0.0_wp)
  end function new_straight_slip

  pure subroutine set_slip_direction(self, theta)
    class(straight_slip_t), intent(inout) :: self
    real(wp), intent(in) :: theta

    self%direction = [cos(theta), sin(theta)]
    if (self%axis == 1) self%direction = [sign(1.0_wp, cos(theta)), 0.0_wp]
    self%held_force = dot_product(self%slider%held_force(self%held), self%direction)
    self%advance_by_slip = 0.0_wp
    ! X' = v n . e, expressed by the component w_i = v n_i.
    if (abs(self%direction(self%axis)) > 0.0_wp) &
      self%advance_by_slip(self%axis) = dot_product(self%direction, self%slider%along)/self%direction(self%axis)
  end subroutine set_slip_direction

  pure subroutine kinematics(self, stages, y, velocity, velocity_y)
    class(straight_slip_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: y(stages, self%unknowns)
    real(wp), intent(out) :: velocity(stages, self%components)
    real(wp), intent(out) :: velocity_y(stages, self%components, self%unknowns)
    integer :: i

    do i = 1, stages
      velocity(i, 1) = self%direction(self%axis)*y(i, 1)
      velocity_y(i, 1, 1) = self%direction(self%axis)
    end do
  end subroutine kinematics

  pure subroutine dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(straight_slip_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms
    real(wp) :: friction(stages), slope(stages), per_mass, stiffness
    integer :: i

    per_mass = 1.0_wp/self%slider%mass
    stiffness = self%slider%stiffness(self%axis)
    call self%slider%law%evaluate(stages, y(:, 1), friction, slope)
    do i = 1, stages
      terms%force_u(i, 1, 1) = per_mass*stiffness*velocity_y(i, 1, 1)
      terms%force(i, 1) = terms%force_u(i, 1, 1)*u(i, 1) + per_mass*(self%held_force - friction(i))
      terms%force_y(i, 1, 1) = -per_mass*slope(i)
      terms%inertia(i, 1) = 1.0_wp
      terms%inertia_y(i, 1, 1) = 0.0_wp
      terms%dissipation(i) = friction(i)*y(i, 1)
      terms%dissipation_y(i, 1) = friction(i) + slope(i)*y(i, 1)
      terms%supply(i) = self%held_force*y(i, 1)
      terms%supply_y(i, 1) = self%held_force
    end do
    if (self%is_damped) call self%add_dampers(stages, drive_velocity, self%direction(self%axis)*y(:, 1:1), velocity_y, terms)
  end subroutine dynamics

  !> The unknowns (v, theta) of slip along a line with velocity `w` [m/s].
  pure function on_line(w) result(y)
    real(wp), intent(in) :: w
    real(wp) :: y(2)

    y = [abs(w), merge(pi, 0.0_wp, w < 0.0_wp)]
  end function on_line

  pure function slip_velocity(self, y, drive_velocity) result(velocity)
    class(straight_slip_t), intent(in) :: self
    real(wp), intent(in) :: y(max_unknowns), drive_velocity
    real(wp) :: velocity(2)

    ! In the direction of the motion there: the slip may have turned since.
    velocity = y(1)*[cos(y(2)), sin(y(2))]
    if (self%axis == 1) velocity = [sign(y(1), cos(y(2))), 0.0_wp]
  end function slip_velocity

  pure subroutine decay_polynomial(self, y, drive_velocity, coefficient, weakening)
    class(straight_slip_t), intent(in) :: self
    real(wp), intent(in) :: y(self%unknowns), drive_velocity
    real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening
    real(wp) :: friction(1), slope(1)

    call self%slider%law%evaluate(1, y(1:1), friction, slope)
    weakening = -slope(1)/self%slider%mass
    coefficient = [self%slider%stiffness(self%axis)*self%direction(self%axis)**2, slope(1), self%slider%mass]/self%slider%mass
    if (self%is_damped) coefficient(1) = coefficient(1) &
      + self%damping(self%axis)*self%direction(self%axis)**2/self%slider%mass
  end subroutine decay_polynomial
end module dst_straight_slip
