!> Rest in the exact contact: set-valued Coulomb friction (NUMERICS: "rest is part of the model").
!>
!> The object sticks while |K u| <= F_s, the static limit; u then follows the drive, u(t) = u_s + D(t) e. It is released when
!> |K u| = F_s, in the direction of K u, with the acceleration (F_s - F_0)/m; this is zero if F_s is the kinetic limit F_0 = F(0+).
!> A limit that ages is F_s(age), with the time since rest began.
!>
!> Slip comes to rest only where |K u| < F_0, because friction in slip is F_0 down to v = 0: under more load the direction of slip
!> turns at a speed that never vanishes, into the direction of K u, and slip goes on. Slip on a straight line cannot turn: there it
!> stops, and rests up to F_s. So an object at rest `is_held` up to F_s, and slip `comes_to_rest` up to F_0.
!>
!> With dampers C the force on the object at rest is K u + C V e, with the velocity V of the drive, instead of K u. It jumps where V
!> jumps.
!>
!> A rest that lasts no longer than a thousandth of the time in which the stiffer spring oscillates by one radian, or in which the
!> drive loads the springs from zero to the static limit, is a touch: the object slips on, and neither a stick nor an event is
!> counted. The number of touches depends on roundoff if the slip speed just reaches zero in each oscillation.
module dst_rest
  use dst_bernstein, only: first_zero
  use dst_kinds, only: wp
  use dst_drive, only: drive_segment_t
  use dst_slider, only: slider_t
  implicit none
  private

  public :: spring_force_size, is_held, comes_to_rest, is_on_line, delay_by_turning
  public :: release_delay, slip_start_t, start_of_slip, start_at_release, touch_time, limit_roundoff

  !> Roundoff of the spring force at the static limit, relative to it: of a force that rests there, and of one that has been moved
  !> there. It is the roundoff of |K u|, with a margin. Twice: no change on Fig. 3 with radau9 and dopri5.
  real(wp), parameter :: limit_roundoff = 4.0_wp*epsilon(1.0_wp), excess_roundoff = 16.0_wp*epsilon(1.0_wp)
  !> A touch lasts no longer than this share of a radian of the faster oscillation, or of the loading of the springs. Convention.
  !> Twice: no change on Fig. 3; 31 instead of 32 sticks where the slip speed just reaches zero in each oscillation.
  real(wp), parameter :: touch_share = 1.0e-3_wp

  !> What strays from a line within roundoff: of an elongation or a drive velocity, relative to it; and the angle of a slip, which
  !> the stiffer spring magnifies [rad]. Conventions: 1e5 slips along the stiff axis stray by 6e-12, and an angle by 4e-16 k_y/k_x.
  !> Twice: the same steps and events in 60 random scenes, 40 of them on a line or nearly.
  real(wp), parameter :: line_roundoff = 4.0e4_wp*epsilon(1.0_wp), line_angle = 1.0e-6_wp

  !> Most limits that are tried for the release under a limit that ages. Each is nearer by the ratio of the rates of limit and
  !> force; this many are needed where they agree to 0.4 %. Convention; twice: no change.
  integer, parameter :: most_limits = 10000

  !> How slip starts from rest: y = (v, theta) at v = 0 with its time derivatives.
  type :: slip_start_t
    real(wp) :: y(2) = 0.0_wp
    real(wp) :: rate(2) = 0.0_wp
    real(wp) :: curvature(2) = 0.0_wp
  end type slip_start_t

contains

  !> Magnitude of the spring force |K u| [N]; if a drive velocity [m/s] is given, of the force of springs and dampers at rest.
  pure real(wp) function spring_force_size(slider, u, drive_velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)
    real(wp), intent(in), optional :: drive_velocity
    real(wp) :: force(2)

    force = slider%stiffness*u
    if (present(drive_velocity)) force = slider%force_at_rest(u, drive_velocity)
    spring_force_size = hypot(force(1), force(2))
  end function spring_force_size

  !> Whether an object at rest stays at rest, with the drive at this velocity [m/s] and acceleration [m/s2], after so long a rest
  !> [s].
  pure logical function is_held(slider, u, drive_velocity, drive_acceleration, age)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    real(wp), intent(in), optional :: drive_acceleration, age

    is_held = balances(slider, limit_of(slider, age), u, drive_velocity, drive_acceleration)
  end function is_held

  !> The static limit [N] after so long a rest [s]; of a rest that begins, if no time is given.
  pure real(wp) function limit_of(slider, age)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in), optional :: age

    limit_of = slider%law%static_limit
    if (present(age)) limit_of = slider%law%limit_after(age)
  end function limit_of

  !> Whether slip in the direction `theta` [rad] whose speed falls to zero ends at rest. On a straight line it stops against any
  !> force, and then the static limit holds it.
  pure logical function comes_to_rest(slider, theta, u, drive_velocity, drive_acceleration)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: theta, u(2), drive_velocity, drive_acceleration
    real(wp) :: direction(2)

    comes_to_rest = balances(slider, slider%law%kinetic_limit, u, drive_velocity, drive_acceleration)
    if (comes_to_rest .or. .not. slider%law%static_limit > slider%law%kinetic_limit) return
    direction = [cos(theta), sin(theta)]
    comes_to_rest = is_held(slider, u, drive_velocity, drive_acceleration) .and. is_on_line(slider, direction, u, drive_velocity) &
      .and. dot_product(slider%force_at_rest(u, drive_velocity), direction) < 0.0_wp
  end function comes_to_rest

  !> Whether friction up to `limit` [N] balances the force on the object at rest. Exactly at the limit this depends on whether the
  !> drive increases the force.
  pure logical function balances(slider, limit, u, drive_velocity, drive_acceleration)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: limit, u(2), drive_velocity
    real(wp), intent(in), optional :: drive_acceleration
    real(wp) :: pull(2), outward, force

    force = spring_force_size(slider, u, drive_velocity)
    pull = slider%loading_rate(drive_velocity, drive_acceleration)
    outward = dot_product(pull, slider%force_at_rest(u, drive_velocity))
    if (.not. force > 0.0_wp) outward = dot_product(pull, pull)
    balances = force < limit
    if (.not. outward > 0.0_wp) balances = force <= limit*(1.0_wp + limit_roundoff)
  end function balances

  !> Whether slip in this direction, the elongation and the drive are on one line, and the forces of springs and dampers with them:
  !> on a principal axis, or on any line if both springs and both dampers are equal.
  pure logical function is_on_line(slider, direction, u, drive_velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: direction(2), u(2), drive_velocity
    real(wp) :: across(2), drive(2)

    across = [-direction(2), direction(1)]
    if (abs(slider%stiffness(1) - slider%stiffness(2)) + abs(slider%damping(1) - slider%damping(2)) > 0.0_wp) &
      across = merge([0.0_wp, 1.0_wp], [1.0_wp, 0.0_wp], abs(direction(1)) > abs(direction(2)))
    drive = slider%drive_coupling()*drive_velocity
    is_on_line = abs(dot_product(across, direction)) <= line_angle &
      .and. abs(dot_product(across, u)) <= line_roundoff*hypot(u(1), u(2)) &
      .and. abs(dot_product(across, drive)) <= line_roundoff*hypot(drive(1), drive(2))
  end function is_on_line

  !> Share of the time up to the end of slip in the direction `theta` [rad] by which the end is later, or the turn, because the
  !> direction does not stay: f^2 sin(delta)^2/|F_0^2 - f^2|, with the angle delta to the force f, if both forces are constant.
  pure real(wp) function delay_by_turning(slider, theta, u, drive_velocity) result(share)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: theta, u(2), drive_velocity
    real(wp) :: force(2), size, across

    force = slider%force_at_rest(u, drive_velocity)
    size = hypot(force(1), force(2))
    across = force(2)*cos(theta) - force(1)*sin(theta)
    share = 0.0_wp
    associate (limit => slider%law%kinetic_limit)
      if (abs(across) > 0.0_wp) share = across/max(abs(limit - size), epsilon(limit)*limit)*(across/(limit + size))
    end associate
  end function delay_by_turning

  !> Time [s] from `time` until the stuck object, which has rested for `age` [s], is released, huge if it is not released within the
  !> segment. Under a limit that ages it is the limit of the times at which the force reaches F_s as it was at the one before: they
  !> rise to the first at which the force is as large as the limit.
  pure real(wp) function release_delay(slider, u, drive, time, age) result(delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), time
    type(drive_segment_t), intent(in) :: drive
    real(wp), intent(in), optional :: age
    real(wp) :: before, later
    integer :: i

    delay = delay_to(slider, limit_of(slider, age), u, drive, time)
    if (.not. slider%law%ageing > 0.0_wp) return
    before = 0.0_wp
    if (present(age)) before = age
    do i = 1, most_limits
      if (.not. delay < huge(delay)) return
      later = delay_to(slider, slider%law%limit_after(before + delay), u, drive, time)
      if (.not. later > delay*(1.0_wp + epsilon(delay))) return
      delay = later
    end do
  end function release_delay

  !> Time [s] until the force on the object at rest reaches this limit [N].
  !> |K (u + D e) + C V e| = F_s is quadratic in D at a constant velocity V and without dampers, and D(t) is quadratic in t.
  pure real(wp) function delay_to(slider, limit, u, drive, time)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: limit, u(2), time
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: force(2), gain(2), a, b, c, root, forward, backward

    if (slider%is_damped()) then
      if (spring_force_size(slider, u, drive%velocity_at(time)) > limit*(1.0_wp + excess_roundoff)) then
        ! The velocity of the drive has jumped.
        delay_to = 0.0_wp
        return
      else if (abs(drive%acceleration) > 0.0_wp) then
        delay_to = damped_delay(slider, limit, u, drive, time)
        return
      end if
    end if
    force = slider%force_at_rest(u, drive%velocity_at(time))
    gain = slider%stiffness*slider%drive_coupling()
    a = dot_product(gain, gain)
    delay_to = huge(delay_to)
    if (.not. a > 0.0_wp) return
    b = dot_product(gain, force)
    ! F_s^2 - |K u|^2 as a product has all digits close to the limit.
    associate (size => hypot(force(1), force(2)))
      c = max(0.0_wp, (limit - size)*(limit + size))
    end associate
    root = sqrt(b**2 + a*c)
    if (b >= 0.0_wp) then
      backward = -(b + root)/a
      forward = quotient(c, b + root)
    else
      forward = (root - b)/a
      backward = -quotient(c, root - b)
    end if
    delay_to = min(time_to_travel(drive, time, forward, 1.0_wp), time_to_travel(drive, time, backward, -1.0_wp))
  end function delay_to

  !> The same with dampers under a ramp: the force is a quadratic polynomial in time, its square one of degree 4.
  pure real(wp) function damped_delay(slider, limit, u, drive, time) result(delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: limit, u(2), time
    type(drive_segment_t), intent(in) :: drive
    integer, parameter :: most_iterations = 4
    real(wp) :: force(2, 0:2), power(0:4), coefficient(0:4), here(2), there(2), length, size, slope
    integer :: iteration

    ! A polynomial in the share of the remaining ramp, in units of the limit.
    delay = huge(delay)
    length = drive%end - time
    if (.not. (length > 0.0_wp .and. limit > 0.0_wp)) then
      if (length > 0.0_wp .and. any(abs(slider%drive_coupling()) > 0.0_wp)) delay = 0.0_wp
      return
    end if
    force(:, 0) = slider%force_at_rest(u, drive%velocity_at(time))/limit
    force(:, 1) = (length/limit)*slider%loading_rate(drive%velocity_at(time), drive%acceleration)
    force(:, 2) = (0.5_wp*length/limit)*slider%loading_rate(drive%acceleration*length, 0.0_wp)
    size = hypot(force(1, 0), force(2, 0))
    power(0) = min(0.0_wp, (size - 1.0_wp)*(size + 1.0_wp))
    power(1) = 2.0_wp*dot_product(force(:, 0), force(:, 1))
    power(2) = dot_product(force(:, 1), force(:, 1)) + 2.0_wp*dot_product(force(:, 0), force(:, 2))
    power(3) = 2.0_wp*dot_product(force(:, 1), force(:, 2))
    power(4) = dot_product(force(:, 2), force(:, 2))
    if (.not. power(0) < 0.0_wp .and. (power(1) > 0.0_wp .or. (.not. power(1) < 0.0_wp .and. power(2) > 0.0_wp))) then
      delay = 0.0_wp
      return
    end if
    ! 1 - |f|^2 falls through zero.
    coefficient(0) = -power(0)
    coefficient(1) = coefficient(0) - power(1)/4.0_wp
    coefficient(2) = coefficient(0) - power(1)/2.0_wp - power(2)/6.0_wp
    coefficient(3) = coefficient(0) - 3.0_wp*power(1)/4.0_wp - power(2)/2.0_wp - power(3)/4.0_wp
    coefficient(4) = coefficient(0) - sum(power(1:4))
    delay = first_zero(coefficient)
    if (delay > 1.0_wp) then
      delay = huge(delay)
      return
    end if
    ! The release may be near the beginning of a long ramp, where this share has few digits.
    do iteration = 1, most_iterations
      here = force(:, 0) + delay*(force(:, 1) + delay*force(:, 2))
      there = force(:, 1) + 2.0_wp*delay*force(:, 2)
      size = hypot(here(1), here(2))
      slope = dot_product(here, there)/size
      if (.not. slope > 0.0_wp) exit
      delay = min(1.0_wp, max(0.0_wp, delay - (size - 1.0_wp)/slope))
    end do
    delay = delay*length
  end function damped_delay

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
    if (velocity >= 0.0_wp .and. .not. goal > 0.0_wp) then
      delay = 0.0_wp
    else if (velocity >= 0.0_wp) then
      delay = 2.0_wp*goal/(velocity + sqrt(discriminant))
    else
      delay = (sqrt(discriminant) - velocity)/acceleration
    end if
    if (.not. delay <= huge(delay)) delay = huge(delay)
  end function time_to_travel

  !> Longest rest [s] that is only a touch, with the drive at this velocity [m/s] and acceleration [m/s2].
  pure real(wp) function touch_time(slider, drive_velocity, drive_acceleration)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: drive_velocity
    real(wp), intent(in), optional :: drive_acceleration
    real(wp) :: pull(2), growth

    pull = slider%loading_rate(drive_velocity, drive_acceleration)
    growth = hypot(pull(1), pull(2))
    touch_time = slider%radian_time()
    if (growth*touch_time > slider%law%static_limit) touch_time = slider%law%static_limit/growth
    touch_time = touch_share*touch_time
  end function touch_time

  !> Start of slip from rest at elongation `u`, where |K u| >= F_0, with the acceleration due to the excess of the force.
  pure function start_of_slip(slider, u, drive_velocity, drive_acceleration) result(begin)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    real(wp), intent(in), optional :: drive_acceleration
    type(slip_start_t) :: begin
    real(wp) :: force(2), growth(2), along, across, magnitude

    growth = slider%loading_rate(drive_velocity, drive_acceleration)
    force = slider%force_at_rest(u, drive_velocity)
    magnitude = hypot(force(1), force(2))
    if (.not. magnitude > 0.0_wp) force = growth
    begin%y = [0.0_wp, atan2(force(2), force(1))]
    associate (c => cos(begin%y(2)), s => sin(begin%y(2)), m => slider%mass)
      along = growth(1)*c + growth(2)*s
      across = growth(2)*c - growth(1)*s
      ! An excess within roundoff is ignored.
      begin%rate(1) = 0.0_wp
      if (magnitude > slider%law%kinetic_limit*(1.0_wp + excess_roundoff)) begin%rate(1) = (magnitude - slider%law%kinetic_limit)/m
      ! The dampers oppose the slip that begins.
      if (slider%is_damped()) then
        growth = growth - begin%rate(1)*slider%free*slider%damping*[c, s]
        along = growth(1)*c + growth(2)*s
        across = growth(2)*c - growth(1)*s
      end if
      begin%rate(2) = 0.0_wp
      if (magnitude > 0.0_wp .and. slider%direction_free) begin%rate(2) = across/(magnitude + m*begin%rate(1))
      begin%curvature(1) = along/m
    end associate
  end function start_of_slip

  !> Start of slip at a release, after so long a rest [s], where |K u| = F_s by definition: any excess over the static limit is
  !> roundoff.
  pure function start_at_release(slider, u, drive_velocity, drive_acceleration, age) result(begin)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    real(wp), intent(in), optional :: drive_acceleration, age
    type(slip_start_t) :: begin

    begin = start_of_slip(slider, u, drive_velocity, drive_acceleration)
    begin%rate(1) = (limit_of(slider, age) - slider%law%kinetic_limit)/slider%mass
  end function start_at_release
end module dst_rest
