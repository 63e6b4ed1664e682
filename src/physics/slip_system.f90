!> The interface of a model to an integrator.
!>
!> A model has n spring elongations u (n = 1 or 2) and m slip unknowns y (m = n in the paper's models; m > n if friction has a state
!> of its own). With the slip velocity w(y), the drive velocity V(t) and its direction e,
!>
!>     u' = V(t) e - w(y),      B(y) y' = g(u, y, V),      B diagonal.
!>
!> The second equation is kept in its implicit form, because B may vanish (polar slip velocity at
!> rest). All stages of a step are evaluated in one call: arrays are (stage, component) or (stage, unknown).
!>
!> A model with one component follows one principal axis. The elongation along the other axis is constant, and the slip velocity
!> along it is a function of y and V.
module dst_slip_system
  use dst_kinds, only: wp
  use dst_slider, only: slider_t
  implicit none
  private

  public :: slip_system_t, stage_terms_t, new_terms, max_components, max_unknowns

  !> Numbers of components (elongations) and of slip unknowns of the largest model.
  integer, parameter :: max_components = 2, max_unknowns = 3

  !> g and its derivatives at `stages` points, arrays (stage, unknown[, derivative with respect to]).
  type :: stage_terms_t
    real(wp), allocatable :: force(:, :)         !! g
    real(wp), allocatable :: force_u(:, :, :)    !! dg/du
    real(wp), allocatable :: force_y(:, :, :)    !! dg/dy
    real(wp), allocatable :: inertia(:, :)       !! diagonal of B
    real(wp), allocatable :: inertia_y(:, :, :)  !! dB/dy
    !> The dampers' part of -dg/dy, except the turning of the direction of slip.
    real(wp), allocatable :: damping(:, :, :)
    real(wp), allocatable :: dissipation(:)      !! power of the friction force, W
    real(wp), allocatable :: dissipation_y(:, :) !! its derivative
    !> Power that does not enter through the springs that the drive stretches, W.
    real(wp), allocatable :: supply(:)
    real(wp), allocatable :: supply_y(:, :)      !! its derivative
  end type stage_terms_t

  !> A model as an integrator uses it: u' = V e - w(y), B(y) y' = g(u, y).
  type, abstract :: slip_system_t
    type(slider_t) :: slider
    !> Number of components n, and of slip unknowns m >= n.
    integer :: components = max_components
    integer :: unknowns = max_components
    !> Principal axis of the first component.
    integer :: axis = 1
    !> Elongations per displacement of the drive: its direction in the principal axes, but 0 for a constant elongation.
    real(wp) :: drive_coupling(max_components) = 0.0_wp
    !> The drive's power through the springs that it stretches [W] is V `drive_stiffness . u`.
    real(wp) :: drive_stiffness(max_components) = 0.0_wp
    !> X' = `advance_by_slip . w` (w of the components, by axis) + `advance_by_drive` V.
    real(wp) :: advance_by_slip(max_components) = 0.0_wp
    real(wp) :: advance_by_drive = 0.0_wp
    !> Whether a component of the slip velocity itself is an unknown, and may pass through zero without a rest.
    logical :: turns_back = .false.
    !> Whether the unknowns are (v, theta).
    logical :: is_polar = .false.
    !> w_y/V if the drive prescribes the motion along y, which then is not a component.
    real(wp) :: prescribed = 0.0_wp
    !> Roundoff of the acceleration [m/s2]: it is a difference of forces of size F_0.
    real(wp) :: acceleration_noise = 0.0_wp
    !> Along each principal axis: frequency of the mass on the spring [rad/s], and the slip speed F_0/sqrt(m k) [m/s] that
    !> stretches the spring to the static limit.
    real(wp) :: frequency(max_components) = 0.0_wp
    real(wp) :: static_speed(max_components) = huge(1.0_wp)
    !> Whether there are dampers, c [N s/m], and the times c/k [s], along each principal axis.
    logical :: is_damped = .false.
    real(wp) :: damping(max_components) = 0.0_wp
    real(wp) :: relaxation(max_components) = 0.0_wp
  contains
    !> Slip velocity w(y) and dw/dy at the stages.
    procedure(kinematics), deferred :: kinematics
    !> The terms of the second equation at the stages; `velocity_y` is dw/dy from `kinematics`.
    procedure(dynamics), deferred :: dynamics
    !> Slip velocity (w_x, w_y) [m/s] at one point.
    procedure(slip_velocity), deferred :: slip_velocity
    !> Growth or decay of disturbances of steady sliding, with these slip unknowns.
    procedure(decay_polynomial), deferred :: decay_polynomial
    !> Become the model of a slider.
    procedure :: take
    !> Add the force of the dampers to the terms of the springs.
    procedure :: add_dampers
    !> Powers of drive and dampers due to the dampers.
    procedure :: damper_powers
    !> Whether the slip has turned by more than a right angle from one point to another.
    procedure :: has_turned
    !> Slip speed that is large along each axis, compared with its spring.
    procedure :: spring_speed
    !> Friction [N] if it is not a function of the slip speed.
    procedure :: own_friction
    !> Slip begins, with friction at this angle to the x-axis [rad].
    procedure :: set_slip_direction
  end type slip_system_t

  abstract interface
    pure subroutine kinematics(self, stages, y, velocity, velocity_y)
      import :: slip_system_t, wp
      class(slip_system_t), intent(in) :: self
      integer, intent(in) :: stages
      real(wp), intent(in) :: y(stages, self%unknowns)
      real(wp), intent(out) :: velocity(stages, self%unknowns)
      real(wp), intent(out) :: velocity_y(stages, self%components, self%unknowns)
    end subroutine kinematics

    pure subroutine dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
      import :: slip_system_t, stage_terms_t, wp
      class(slip_system_t), intent(in) :: self
      integer, intent(in) :: stages
      real(wp), intent(in) :: drive_velocity(stages)
      real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
      real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
      type(stage_terms_t), intent(inout) :: terms
    end subroutine dynamics

    pure function slip_velocity(self, y, drive_velocity) result(velocity)
      import :: slip_system_t, wp, max_unknowns
      class(slip_system_t), intent(in) :: self
      real(wp), intent(in) :: y(max_unknowns), drive_velocity
      real(wp) :: velocity(2)
    end function slip_velocity

    !> Characteristic polynomial, by rising power: its n + m roots are the rates lambda [1/s] of exp(lambda t); and -F'(v)/m [1/s],
    !> the rate at which friction that decreases with the speed feeds disturbances.
    pure subroutine decay_polynomial(self, y, drive_velocity, coefficient, weakening)
      import :: slip_system_t, wp
      class(slip_system_t), intent(in) :: self
      real(wp), intent(in) :: y(self%unknowns), drive_velocity
      real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening
    end subroutine decay_polynomial
  end interface

contains

  !> Allocate terms for a number of stages.
  pure function new_terms(stages, components, unknowns) result(terms)
    integer, intent(in) :: stages, components, unknowns
    type(stage_terms_t) :: terms

    allocate (terms%force(stages, unknowns), terms%inertia(stages, unknowns))
    allocate (terms%force_u(stages, unknowns, components), terms%force_y(stages, unknowns, unknowns))
    allocate (terms%inertia_y(stages, unknowns, unknowns))
    allocate (terms%damping(stages, unknowns, unknowns), source=0.0_wp)
    allocate (terms%dissipation(stages), terms%dissipation_y(stages, unknowns))
    allocate (terms%supply(stages), terms%supply_y(stages, unknowns), source=0.0_wp)
  end function new_terms

  !> The slider, and what follows from it in every model that leaves the same axes free.
  subroutine take(self, slider)
    class(slip_system_t), intent(inout) :: self
    type(slider_t), intent(in) :: slider

    self%slider = slider
    self%drive_coupling = slider%drive_coupling()
    self%drive_stiffness = slider%stiffness*self%drive_coupling
    self%acceleration_noise = slider%acceleration_noise()
    self%frequency = sqrt(slider%stiffness/slider%mass)
    ! Without friction or without a spring there is no scale.
    if (slider%law%static_limit > 0.0_wp) then
      where (slider%stiffness > 0.0_wp) self%static_speed = slider%law%static_limit/sqrt(slider%mass*slider%stiffness)
    end if
    self%is_damped = slider%is_damped()
    self%damping = slider%free*slider%damping
    ! A model without this spring has no damper parallel to it.
    where (slider%damping > 0.0_wp) self%relaxation = slider%free*slider%damping/slider%stiffness
  end subroutine take

  !> Dampers act as longer springs: with the times r = c/k, k u becomes k (u + r u'), u' = V e - w. To be called last in `dynamics`,
  !> with dg/du of the springs, where w = `velocity`.
  pure subroutine add_dampers(self, stages, drive_velocity, velocity, velocity_y, terms)
    class(slip_system_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages), velocity(stages, self%components)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms
    real(wp) :: longer(stages)
    integer :: i, j, k

    terms%damping(1:stages, :, :) = 0.0_wp
    do k = 1, self%components
      associate (axis => self%axis + k - 1)
        longer = self%relaxation(axis)*(drive_velocity*self%drive_coupling(axis) - velocity(:, k))
        do i = 1, self%unknowns
          terms%force(1:stages, i) = terms%force(1:stages, i) + terms%force_u(1:stages, i, k)*longer
          do j = 1, self%unknowns
            terms%damping(1:stages, i, j) = terms%damping(1:stages, i, j) &
              + self%relaxation(axis)*terms%force_u(1:stages, i, k)*velocity_y(:, k, j)
          end do
        end do
      end associate
    end do
    terms%force_y(1:stages, :, :) = terms%force_y(1:stages, :, :) - terms%damping(1:stages, :, :)
  end subroutine add_dampers

  !> Power of the drive through the dampers, and the power that they take [W], at slip velocities [m/s] along the components.
  pure subroutine damper_powers(self, drive_velocity, velocity, driven, taken)
    class(slip_system_t), intent(in) :: self
    real(wp), intent(in) :: drive_velocity, velocity(:)
    real(wp), intent(out) :: driven, taken
    real(wp) :: rate(self%components)

    associate (first => self%axis, last => self%axis + self%components - 1)
      rate = drive_velocity*self%drive_coupling(first:last) - velocity
      driven = drive_velocity*sum(self%drive_coupling(first:last)*self%damping(first:last)*rate)
      taken = sum(self%damping(first:last)*rate**2)
    end associate
  end subroutine damper_powers

  !> For unknowns y of which the first are the slip velocity itself, or its magnitude along a fixed direction.
  pure logical function has_turned(self, before, after)
    class(slip_system_t), intent(in) :: self
    real(wp), intent(in) :: before(:), after(:)

    associate (n => self%components)
      has_turned = dot_product(before(1:n), after(1:n)) < 0.0_wp
    end associate
  end function has_turned

  !> Slip speed [m/s] along each axis that stretches its spring by as much as it is stretched now (`u` [m]), or to the static limit.
  !> Relative to this, an error of the slip velocity is an error of the spring force.
  pure function spring_speed(self, u) result(speed)
    class(slip_system_t), intent(in) :: self
    real(wp), intent(in) :: u(max_components)
    real(wp) :: speed(max_components)

    speed = max(self%static_speed, self%frequency*abs(u))
  end function spring_speed

  !> Set the magnitude of friction [N] at the slip unknowns y; most models have no state for it, and leave the value of the law.
  pure subroutine own_friction(self, y, friction)
    class(slip_system_t), intent(in) :: self
    real(wp), intent(in) :: y(max_unknowns)
    real(wp), intent(inout) :: friction
  end subroutine own_friction

  !> Most models have the direction among their unknowns.
  pure subroutine set_slip_direction(self, theta)
    class(slip_system_t), intent(inout) :: self
    real(wp), intent(in) :: theta
  end subroutine set_slip_direction
end module dst_slip_system
