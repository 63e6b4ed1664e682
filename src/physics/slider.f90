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
    !> What a model holds: along a principal axis with `free` = 0 the elongation is constant, and slip
    !> whose direction is not free keeps that in which it began.
    real(wp) :: free(2) = 1.0_wp
    logical :: direction_free = .true.
    class(friction_law_t), allocatable :: law
    !> Square of the smoothing velocity [m2/s2]; 0 = exact contact.
    real(wp) :: smoothing = 0.0_wp
  contains
    procedure :: drive_coupling
    procedure :: elongation_at_limit
    procedure :: held_force
    procedure :: acceleration_noise
    procedure :: frequency
    procedure :: radian_time
    procedure :: static_speed
  end type slider_t

contains

  !> Elongation of the springs per displacement of the drive.
  pure function drive_coupling(self)
    class(slider_t), intent(in) :: self
    real(wp) :: drive_coupling(2)

    drive_coupling = self%free*self%along
  end function drive_coupling

  !> Elongation [m] at the static limit, with the spring force in the direction `theta` [rad].
  pure function elongation_at_limit(self, theta) result(u)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: theta
    real(wp) :: u(2)

    u = self%law%static_limit*[cos(theta), sin(theta)]/self%stiffness
  end function elongation_at_limit

  !> Force of the held springs [N] at elongation `u` [m].
  pure function held_force(self, u) result(force)
    class(slider_t), intent(in) :: self
    real(wp), intent(in) :: u(2)
    real(wp) :: force(2)

    force = (1.0_wp - self%free)*self%stiffness*u
  end function held_force

  !> Roundoff of the acceleration [m/s2]: forces of size F_0 are differenced.
  pure real(wp) function acceleration_noise(self)
    class(slider_t), intent(in) :: self

    acceleration_noise = force_roundoff*self%law%static_limit/self%mass
  end function acceleration_noise

  !> Frequencies sqrt(k/m) of the mass on either spring [rad/s].
  pure function frequency(self)
    class(slider_t), intent(in) :: self
    real(wp) :: frequency(2)

    frequency = sqrt(self%stiffness/self%mass)
  end function frequency

  !> Time in which the faster oscillation passes one radian [s].
  pure real(wp) function radian_time(self)
    class(slider_t), intent(in) :: self

    radian_time = sqrt(self%mass/maxval(self%stiffness))
  end function radian_time

  !> Slip speeds F_0/sqrt(m k) that stretch either spring to the static limit [m/s]; huge where there is no friction or no spring,
  !> which set no scale then.
  pure function static_speed(self)
    class(slider_t), intent(in) :: self
    real(wp) :: static_speed(2)

    static_speed = huge(1.0_wp)
    if (.not. self%law%static_limit > 0.0_wp) return
    where (self%stiffness > 0.0_wp) static_speed = self%law%static_limit/sqrt(self%mass*self%stiffness)
  end function static_speed

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
    ! No negative zeros: they would turn angles of pi into -pi.
    direction = direction + 0.0_wp
  end function cos_sin_degrees

  !> Angle of a vector to the x-axis [rad], 0 for the zero vector.
  pure real(wp) function direction_of(vector)
    real(wp), intent(in) :: vector(2)

    direction_of = 0.0_wp
    if (any(abs(vector) > 0.0_wp)) direction_of = atan2(vector(2), vector(1))
  end function direction_of
end module dst_slider
