!> The slider: mass, anisotropic spring, misalignment (Nakano & Popov 2020, Fig. 1 and Eqs. 1-6).
module dst_slider
  use dst_kinds, only: wp, degree
  use dst_friction, only: friction_law_t
  implicit none
  private

  public :: slider_t, cos_sin_degrees, direction_of

  !> Roundoff of a difference of forces, relative to them, with a margin. Twice: up to 0.7 % fewer or more iterations of radau9 on
  !> Fig. 3, the same error.
  real(wp), parameter :: force_roundoff = 8.0_wp*epsilon(1.0_wp)

  !> All parameters of the object and its contact. Vectors are in the principal axes x, y.
  type :: slider_t
    real(wp) :: mass = 1.0_wp                              !! kg
    real(wp) :: stiffness(2) = 1.0_wp                      !! k_x, k_y, N/m
    real(wp) :: along(2) = [1.0_wp, 0.0_wp]                !! drive direction (cos phi, sin phi)
    !> What a model keeps constant: along a principal axis with `free` = 0 the elongation is constant, and slip whose direction is
    !> not free keeps the direction in which it began.
    real(wp) :: free(2) = 1.0_wp
    logical :: direction_free = .true.
    class(friction_law_t), allocatable :: law
    !> Square of the smoothing velocity [m2/s2]; 0 = exact contact.
    real(wp) :: smoothing = 0.0_wp
    !> c_x, c_y of the dampers parallel to the springs, N s/m.
    real(wp) :: damping(2) = 0.0_wp
  contains
    procedure :: is_damped
    procedure :: force_at_rest
    procedure :: loading_rate
    procedure :: drive_coupling
    procedure :: elongation_at_limit
    procedure :: held_force
    procedure :: pull_force
    procedure :: acceleration_noise
    procedure :: radian_time
  end type slider_t

contains

  !> Elongation of the springs per displacement of the drive.
  pure function drive_coupling(self)
    class(slider_t), intent(in) :: self
    real(wp) :: drive_coupling(2)

    drive_coupling = self%free*self%along
  end function drive_coupling

  !> Whether there is a damper parallel to a spring.
  pure logical function is_damped(self)
    class(slider_t), intent(in) :: self

    is_damped = any(self%damping > 0.0_wp)
  end function is_damped

  !> Force of springs and dampers [N] on the object at rest, K u + C V e, at elongation `u` [m] and velocity V of the drive [m/s].
  pure function force_at_rest(self, u, drive_velocity) result(force)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: u(2), drive_velocity
    real(wp) :: force(2)

    force = self%stiffness*u
    if (self%is_damped()) force = force + self%damping*self%drive_coupling()*drive_velocity
  end function force_at_rest

  !> Rate [N/s] at which a drive with this velocity [m/s] and acceleration [m/s2], 0 if not given, loads the object at rest:
  !> K V e + C V' e.
  pure function loading_rate(self, drive_velocity, drive_acceleration) result(rate)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: drive_velocity
    real(wp), intent(in), optional :: drive_acceleration
    real(wp) :: rate(2)

    rate = self%stiffness*self%drive_coupling()*drive_velocity
    if (present(drive_acceleration) .and. self%is_damped()) &
      rate = rate + self%damping*self%drive_coupling()*drive_acceleration
  end function loading_rate

  !> Elongation [m] at the static limit, with the force on the object at rest in the direction `theta` [rad]; with dampers that
  !> hangs on the velocity of the drive [m/s].
  pure function elongation_at_limit(self, theta, drive_velocity) result(u)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: theta
    real(wp), intent(in) :: drive_velocity
    real(wp) :: u(2)

    u = (self%law%static_limit*[cos(theta), sin(theta)] - self%force_at_rest([0.0_wp, 0.0_wp], drive_velocity))/self%stiffness
  end function elongation_at_limit

  !> Force of springs and dampers [N] on the object along the drive: what a load cell measures. The springs lengthen with the
  !> velocity of the drive minus that of the object [m/s].
  pure real(wp) function pull_force(self, spring_force, drive_velocity, slip_velocity)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: spring_force(2), drive_velocity, slip_velocity(2)

    pull_force = dot_product(spring_force + self%damping*(drive_velocity*self%along - slip_velocity), self%along)
  end function pull_force

  !> Force of the springs of constant elongation [N] at elongation `u` [m].
  pure function held_force(self, u) result(force)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: u(2)
    real(wp) :: force(2)

    force = (1.0_wp - self%free)*self%stiffness*u
  end function held_force

  !> Roundoff of the acceleration [m/s2]: it is a difference of forces of size F_0, and of those of dampers at a velocity of this
  !> size [m/s].
  pure real(wp) function acceleration_noise(self, velocity)
    class(slider_t), intent(in) :: self
    real(wp), intent(in), optional :: velocity

    acceleration_noise = force_roundoff*self%law%static_limit/self%mass
    if (present(velocity)) acceleration_noise = acceleration_noise &
      + force_roundoff*(maxval(self%free*self%damping)/self%mass)*velocity
  end function acceleration_noise

  !> Time in which the faster oscillation passes one radian [s].
  pure real(wp) function radian_time(self)
    class(slider_t), intent(in) :: self

    radian_time = sqrt(self%mass/maxval(self%stiffness))
  end function radian_time

  !> (cos, sin) of an angle in degrees, exact at multiples of 90 and odd/even to the last bit.
  pure function cos_sin_degrees(angle) result(direction)
    real(wp), intent(in) :: angle
    real(wp) :: direction(2)
    real(wp) :: quarter, rest, c, s

    quarter = anint(angle/90.0_wp)
    rest = (angle - 90.0_wp*quarter)*degree
    c = cos(rest)
    s = sin(rest)
    select case (modulo(nint(quarter), 4))
    case (0)
      direction = [c, s]
    case (1)
      direction = [-s, c]
    case (2)
      direction = [-c, -s]
    case default
      direction = [s, -c]
    end select
    ! No negative zeros: they would change angles of pi to -pi.
    direction = direction + 0.0_wp
  end function cos_sin_degrees

  !> Angle of a vector to the x-axis [rad], 0 for the zero vector.
  pure real(wp) function direction_of(vector)
    real(wp), intent(in) :: vector(2)

    direction_of = 0.0_wp
    if (any(abs(vector) > 0.0_wp)) direction_of = atan2(vector(2), vector(1))
  end function direction_of
end module dst_slider
