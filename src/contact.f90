!> The exact contact: set-valued Coulomb friction at rest (NUMERICS: "rest is part of the model").
!>
!> Stuck while |K u| <= F_0; u then follows the drive, u(t) = u_s + D(t) e. Released when
!> |K u| = F_0, in the direction of K u. Coming to rest with |K u| >= F_0 is no rest: the motion
!> goes on in the direction of K u.
module dst_contact
  use dst_kinds, only: wp
  use dst_drive, only: drive_segment_t
  use dst_slider, only: slider_t
  use dst_stepper, only: motion_t
  implicit none
  private

  public :: load, holds, release_delay, onset_t, onset_of_slip, brake

  !> How slip starts from rest: y = (v, theta) at v = 0 with its time derivatives.
  type :: onset_t
    real(wp) :: y(2) = 0.0_wp
    real(wp) :: rate(2) = 0.0_wp
    real(wp) :: curvature(2) = 0.0_wp
  end type onset_t

contains

  !> Magnitude of the spring force |K u| [N].
  pure real(wp) function load(slider, u)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)

    load = hypot(slider%stiffness(1)*u(1), slider%stiffness(2)*u(2))
  end function load

  !> Whether an object at rest stays at rest.
  pure logical function holds(slider, u)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)

    holds = load(slider, u) < slider%law%onset
  end function holds

  !> Time [s] from `time` until the stuck object is released, huge if it is not within the segment.
  !> |K (u + D e)| = F_0 is quadratic in D, and D(t) is quadratic in t.
  pure real(wp) function release_delay(slider, u, drive, time)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), time
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: force(2), gain(2), a, b, c, root, forward, backward

    force = slider%stiffness*u
    gain = slider%stiffness*slider%along
    a = dot_product(gain, gain)
    b = dot_product(gain, force)
    ! F_0^2 - |K u|^2 as a product keeps its digits close to the limit.
    c = max(0.0_wp, (slider%law%onset - load(slider, u))*(slider%law%onset + load(slider, u)))
    root = sqrt(b**2 + a*c)
    if (b >= 0.0_wp) then
      backward = -(b + root)/a
      forward = quotient(c, b + root)
    else
      forward = (root - b)/a
      backward = -quotient(c, root - b)
    end if
    release_delay = min(time_to_travel(drive, time, forward, 1.0_wp), time_to_travel(drive, time, backward, -1.0_wp))
  end function release_delay

  !> x/y with 0/0 = 0.
  pure real(wp) function quotient(x, y)
    real(wp), intent(in) :: x, y

    quotient = 0.0_wp
    if (x > 0.0_wp) quotient = x/y
  end function quotient

  !> First delay >= 0 at which the drive has moved by `distance` (towards `side`), huge if never.
  pure real(wp) function time_to_travel(drive, time, distance, side) result(delay)
    type(drive_segment_t), intent(in) :: drive
    real(wp), intent(in) :: time, distance, side
    real(wp) :: goal, velocity, acceleration, discriminant

    delay = huge(delay)
    goal = side*distance
    velocity = side*drive%velocity_at(time)
    acceleration = side*drive%acceleration
    if (acceleration <= 0.0_wp .and. velocity <= 0.0_wp) return
    discriminant = velocity**2 + 2.0_wp*acceleration*goal
    if (discriminant < 0.0_wp) return
    if (velocity >= 0.0_wp) then
      delay = 2.0_wp*goal/(velocity + sqrt(discriminant))
    else
      delay = (sqrt(discriminant) - velocity)/acceleration
    end if
    if (.not. delay <= huge(delay)) delay = huge(delay)
  end function time_to_travel

  !> Start of slip from rest at elongation `u`, where |K u| >= F_0.
  pure function onset_of_slip(slider, u, drive_velocity) result(onset)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    type(onset_t) :: onset
    real(wp) :: force(2), growth(2), along, across, magnitude

    growth = slider%stiffness*slider%along*drive_velocity
    force = slider%stiffness*u
    magnitude = load(slider, u)
    if (.not. magnitude > 0.0_wp) force = growth
    onset%y = [0.0_wp, atan2(force(2), force(1))]
    associate (c => cos(onset%y(2)), s => sin(onset%y(2)), m => slider%mass)
      along = growth(1)*c + growth(2)*s
      across = growth(2)*c - growth(1)*s
      onset%rate(1) = max(0.0_wp, (magnitude - slider%law%onset)/m)
      onset%rate(2) = 0.0_wp
      if (magnitude > 0.0_wp) onset%rate(2) = across/(magnitude + m*onset%rate(1))
      onset%curvature(1) = along/m
    end associate
  end function onset_of_slip

  !> The last instants before a stop in closed form, for a slip speed so small that the direction
  !> does not matter any more: v falls to zero with the acceleration and jerk that it has now.
  !> `stops` is false where it does not fall to zero.
  pure subroutine brake(slider, drive, from, to, stops)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    type(motion_t), intent(out) :: to
    logical, intent(out) :: stops
    real(wp) :: direction(2), friction(1), slope(1), driven(2)
    real(wp) :: acceleration, jerk, delay, slipped, discriminant, travel

    associate (v => from%y(1), theta => from%y(2), k => slider%stiffness, m => slider%mass)
      direction = [cos(theta), sin(theta)]
      driven = drive%velocity_at(from%time)*slider%along
      call slider%law%evaluate(1, [v], friction, slope)
      acceleration = (dot_product(k*from%u, direction) - friction(1))/m
      jerk = (dot_product(k*(driven - v*direction), direction) - slope(1)*acceleration)/m
      discriminant = acceleration**2 - 2.0_wp*jerk*v
      stops = acceleration < 0.0_wp .and. discriminant >= 0.0_wp
      to = from
      if (.not. stops) return
      delay = 2.0_wp*v/(sqrt(discriminant) - acceleration)
      slipped = delay*(v + delay*(0.5_wp*acceleration + delay*jerk/6.0_wp))
      travel = drive%displacement(from%time, delay)
      to%time = from%time + delay
      to%u = from%u + travel*slider%along - slipped*direction
      to%y = 0.0_wp
      to%position = from%position + slipped*dot_product(slider%along, direction)
      to%friction_work = from%friction_work + friction(1)*slipped
      to%drive_work = from%drive_work + travel*dot_product(k*slider%along, from%u)
      stops = holds(slider, to%u)
    end associate
  end subroutine brake
end module dst_contact
