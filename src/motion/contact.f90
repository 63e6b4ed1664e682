!> The exact contact: set-valued Coulomb friction at rest (NUMERICS: "rest is part of the model").
!>
!> Stuck while |K u| <= F_0; u then follows the drive, u(t) = u_s + D(t) e. Released when
!> |K u| = F_0, in the direction of K u. Coming to rest with |K u| >= F_0 is no rest: the motion
!> goes on in the direction of K u.
!>
!> A rest that lasts no longer than a thousandth of the time in which the stiffer spring oscillates by one radian, or in which the
!> drive loads the springs from nothing to the static limit, is a touch: the object passes on, and neither a stick nor an event
!> is counted. How many touches there are hangs on roundoff where the slip speed just reaches zero in each oscillation.
!>
!> An implicit method starts from rest by itself. For an explicit one the slip that follows a release
!> is given here as a power series, and the end of slip in closed form.
module dst_contact
  use dst_kinds, only: wp
  use dst_drive, only: drive_segment_t
  use dst_slider, only: slider_t
  use dst_stepper, only: motion_t
  implicit none
  private

  public :: load, holds, release_delay, onset_t, onset_of_slip, braking_t, braking, end_of_slip, touch_time
  public :: release_t, series_order, release_series, default_cut_speed

  !> How slip starts from rest: y = (v, theta) at v = 0 with its time derivatives.
  type :: onset_t
    real(wp) :: y(2) = 0.0_wp
    real(wp) :: rate(2) = 0.0_wp
    real(wp) :: curvature(2) = 0.0_wp
  end type onset_t

  !> How slip ends: v + acceleration t + jerk t^2/2 in the direction that it has.
  type :: braking_t
    real(wp) :: acceleration = 0.0_wp  !! m/s2
    real(wp) :: jerk = 0.0_wp          !! m/s3
    !> Whether v falls to zero, and after what time [s].
    logical :: falls = .false.
    real(wp) :: delay = 0.0_wp
    !> Whether friction changes little and evenly until then, compared with the force that brakes.
    logical :: steady = .false.
    !> Highest v until then [m/s].
    real(wp) :: highest = 0.0_wp
  end type braking_t

  !> Order of the power series of a release.
  integer, parameter :: series_order = 10

  !> Slip from rest as power series in tau = t/unit, up to tau = reach.
  type :: release_t
    real(wp) :: unit = 0.0_wp                                !! s
    real(wp) :: reach = 0.0_wp
    real(wp) :: slipped(0:series_order, 2) = 0.0_wp          !! way of the object, m
    real(wp) :: v(0:series_order) = 0.0_wp                   !! m/s
    real(wp) :: theta(0:series_order) = 0.0_wp
    real(wp) :: drive_work(0:series_order) = 0.0_wp          !! J
    real(wp) :: friction_work(0:series_order) = 0.0_wp       !! J
    !> Whether there is slip, and whether the series could be made accurate enough.
    logical :: moves = .false.
    logical :: accurate = .false.
  contains
    procedure :: at => release_at
  end type release_t

contains

  !> Magnitude of the spring force |K u| [N].
  pure real(wp) function load(slider, u)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)

    load = hypot(slider%stiffness(1)*u(1), slider%stiffness(2)*u(2))
  end function load

  !> Whether an object at rest stays at rest. Exactly at the static limit that depends on whether the
  !> drive [m/s] pulls further out.
  pure logical function holds(slider, u, drive_velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    real(wp) :: pull(2), outward, force

    force = load(slider, u)
    pull = slider%stiffness*slider%pulled()*drive_velocity
    outward = dot_product(pull, slider%stiffness*u)
    if (.not. force > 0.0_wp) outward = dot_product(pull, pull)
    holds = force < slider%law%onset
    if (.not. outward > 0.0_wp) holds = force <= slider%law%onset*(1.0_wp + 4.0_wp*epsilon(force))
  end function holds

  !> Time [s] from `time` until the stuck object is released, huge if it is not within the segment.
  !> |K (u + D e)| = F_0 is quadratic in D, and D(t) is quadratic in t.
  pure real(wp) function release_delay(slider, u, drive, time)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), time
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: force(2), gain(2), a, b, c, root, forward, backward

    force = slider%stiffness*u
    gain = slider%stiffness*slider%pulled()
    a = dot_product(gain, gain)
    release_delay = huge(release_delay)
    if (.not. a > 0.0_wp) return
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
    if (velocity >= 0.0_wp .and. .not. goal > 0.0_wp) then
      delay = 0.0_wp
    else if (velocity >= 0.0_wp) then
      delay = 2.0_wp*goal/(velocity + sqrt(discriminant))
    else
      delay = (sqrt(discriminant) - velocity)/acceleration
    end if
    if (.not. delay <= huge(delay)) delay = huge(delay)
  end function time_to_travel

  !> Longest rest [s] that is a touch only, with the drive at this velocity [m/s].
  pure real(wp) function touch_time(slider, drive_velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: drive_velocity
    real(wp) :: pull(2), growth
    real(wp), parameter :: share = 1.0e-3_wp

    pull = slider%stiffness*slider%pulled()*drive_velocity
    growth = hypot(pull(1), pull(2))
    touch_time = sqrt(slider%mass/maxval(slider%stiffness))
    if (growth*touch_time > slider%law%onset) touch_time = slider%law%onset/growth
    touch_time = share*touch_time
  end function touch_time

  !> Start of slip from rest at elongation `u`, where |K u| >= F_0.
  pure function onset_of_slip(slider, u, drive_velocity) result(onset)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive_velocity
    type(onset_t) :: onset
    real(wp) :: force(2), growth(2), along, across, magnitude

    growth = slider%stiffness*slider%pulled()*drive_velocity
    force = slider%stiffness*u
    magnitude = load(slider, u)
    if (.not. magnitude > 0.0_wp) force = growth
    onset%y = [0.0_wp, atan2(force(2), force(1))]
    associate (c => cos(onset%y(2)), s => sin(onset%y(2)), m => slider%mass)
      along = growth(1)*c + growth(2)*s
      across = growth(2)*c - growth(1)*s
      ! An excess within roundoff is none.
      onset%rate(1) = 0.0_wp
      if (magnitude > slider%law%onset*(1.0_wp + 16.0_wp*epsilon(m))) onset%rate(1) = (magnitude - slider%law%onset)/m
      onset%rate(2) = 0.0_wp
      if (magnitude > 0.0_wp .and. slider%turns) onset%rate(2) = across/(magnitude + m*onset%rate(1))
      onset%curvature(1) = along/m
    end associate
  end function onset_of_slip

  !> Acceleration and jerk of the slip speed with the direction held, and when it reaches zero.
  pure function braking(slider, drive, from) result(course)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    type(braking_t) :: course
    real(wp) :: direction(2), friction(1), slope(1), driven(2), discriminant

    associate (v => from%y(1), theta => from%y(2), k => slider%stiffness, m => slider%mass)
      direction = [cos(theta), sin(theta)]
      driven = drive%velocity_at(from%time)*slider%pulled()
      call slider%law%evaluate(1, [v], friction, slope)
      course%acceleration = (dot_product(k*from%u, direction) - friction(1))/m
      course%jerk = (dot_product(k*(driven - v*slider%follows*direction), direction) - slope(1)*course%acceleration)/m
      discriminant = course%acceleration**2 - 2.0_wp*course%jerk*v
      course%falls = discriminant >= 0.0_wp
      if (course%falls) course%falls = sqrt(discriminant) > course%acceleration .and. &
        (course%acceleration < 0.0_wp .or. course%jerk < 0.0_wp)
      if (course%falls) course%delay = 2.0_wp*v/(sqrt(discriminant) - course%acceleration)
      associate (change => [abs(slope(1))*v, abs(friction(1) - slope(1)*v - slider%law%onset)])
        course%steady = change(1) <= 0.1_wp*m*abs(course%acceleration) .and. change(2) <= 0.01_wp*m*abs(course%acceleration)
      end associate
      course%highest = v
      if (course%falls .and. course%acceleration > 0.0_wp) &
        course%highest = v - 0.5_wp*course%acceleration**2/course%jerk
    end associate
  end function braking

  !> The motion at the end of slip.
  pure function end_of_slip(slider, drive, from, course) result(to)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    type(braking_t), intent(in) :: course
    type(motion_t) :: to
    real(wp) :: direction(2), friction(1), slope(1), slipped, travel

    to = from
    associate (v => from%y(1), theta => from%y(2), k => slider%stiffness, delay => course%delay)
      direction = [cos(theta), sin(theta)]
      call slider%law%evaluate(1, [v], friction, slope)
      slipped = delay*(v + delay*(0.5_wp*course%acceleration + delay*course%jerk/6.0_wp))
      travel = drive%displacement(from%time, delay)
      call to%later(from, delay)
      to%u = from%u + travel*slider%pulled() - slipped*slider%follows*direction
      to%y = 0.0_wp
      to%position = from%position + slipped*dot_product(slider%along, direction)
      to%friction_work = from%friction_work + friction(1)*slipped
      to%drive_work = from%drive_work + travel*dot_product(k*slider%pulled(), from%u) &
        + slipped*dot_product(slider%held_force(from%u), direction)
    end associate
  end function end_of_slip

  !> Slip speed [m/s] below which an explicit method leaves the end of slip to `braking`, with the drive at this velocity and this
  !> largest slip speed of late [m/s]. What that leaves out (the turning of the direction, the change of the jerk) has an effect on
  !> the slip velocity of about the third power of this speed; the factor is measured on Fig. 3.
  pure real(wp) function default_cut_speed(rtol, drive_velocity, peak_speed)
    real(wp), intent(in) :: rtol, drive_velocity, peak_speed
    real(wp), parameter :: largest_share = 30.0_wp, least_share = 1.0e-4_wp

    default_cut_speed = 0.014_wp*rtol**(1.0_wp/3.0_wp)*max(least_share*abs(drive_velocity), &
      min(largest_share*peak_speed, max(abs(drive_velocity), peak_speed)))
  end function default_cut_speed

  !> Slip after a release at `from` (v = 0, u, theta), where v starts with `rate` [m/s2], as power
  !> series; `tolerance` is relative to the slip speed at their end.
  pure function release_series(slider, drive, from, rate, tolerance) result(release)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    real(wp), intent(in) :: rate, tolerance
    type(release_t) :: release
    real(wp) :: gain(2), growth, v_range, law(0:5), discrepancy
    integer :: attempt

    release%unit = sqrt(slider%mass/maxval(slider%stiffness))
    gain = slider%stiffness*slider%pulled()
    growth = hypot(gain(1), gain(2))*(abs(drive%velocity_at(from%time)) + abs(drive%acceleration)*release%unit)
    v_range = release%unit*(rate + growth*release%unit/slider%mass)
    if (.not. load(slider, from%u) > 0.0_wp .or. .not. v_range > 0.0_wp) return
    do attempt = 1, 40
      call fit_law(slider, v_range, law, discrepancy)
      call expand(slider, drive, from, rate, law, v_range, release)
      call choose_reach(release, v_range, tolerance)
      if (.not. release%moves) return
      associate (v => value(release%v, release%reach))
        release%accurate = release%reach*release%unit*discrepancy <= tolerance*v*slider%mass
        if (release%accurate) exit
        v_range = 0.25_wp*min(v, v_range)
      end associate
    end do
  end function release_series

  !> The friction law on 0 <= v <= v_range as a polynomial in v/v_range through values and slopes at
  !> 0, 1/2 and 1, and how far it is off [N] where it is worst.
  pure subroutine fit_law(slider, v_range, law, discrepancy)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: v_range
    real(wp), intent(out) :: law(0:5), discrepancy
    real(wp) :: force(4), slope(4), half, half_slope, full, full_slope
    real(wp), parameter :: position(4) = [0.0_wp, 0.5_wp, 1.0_wp, 0.8_wp]

    call slider%law%evaluate(4, position*v_range, force, slope)
    slope = slope*v_range
    ! What value and slope at 0 do not explain.
    half = force(2) - force(1) - 0.5_wp*slope(1)
    half_slope = slope(2) - slope(1)
    full = force(3) - force(1) - slope(1)
    full_slope = slope(3) - slope(1)
    law(0) = force(1)
    law(1) = slope(1)
    law(2) = 16.0_wp*half - 8.0_wp*half_slope + 7.0_wp*full - full_slope
    law(3) = -32.0_wp*half + 32.0_wp*half_slope - 34.0_wp*full + 5.0_wp*full_slope
    law(4) = 16.0_wp*half - 40.0_wp*half_slope + 52.0_wp*full - 8.0_wp*full_slope
    law(5) = 16.0_wp*half_slope - 24.0_wp*full + 4.0_wp*full_slope
    discrepancy = abs(value(law, position(4)) - force(4))
    ! Forces are not known better than this.
    if (discrepancy <= 8.0_wp*epsilon(1.0_wp)*abs(force(1))) discrepancy = 0.0_wp
  end subroutine fit_law

  !> The coefficients, order by order. With n = (cos, sin) and t = (-sin, cos) of theta,
  !> f = K u and primes for d/dtau,
  !>     v' = unit (f . n - F(v))/m,    m v theta' = unit f . t,    slipped' = unit v n.
  !> The second equation at order k gives theta_k, because v_0 = 0 and f . t holds -|f_0| theta_k.
  pure subroutine expand(slider, drive, from, rate, law, v_range, release)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    real(wp), intent(in) :: rate, law(0:5), v_range
    type(release_t), intent(inout) :: release
    real(wp), dimension(0:series_order) :: cosine, sine, friction, spring, drive_speed
    real(wp) :: force(0:series_order, 2), power(0:series_order, 5), driven(0:series_order), angle_part
    integer :: j, k

    associate (v => release%v, theta => release%theta, slip => release%slipped, unit => release%unit, &
        m => slider%mass, stiffness => slider%stiffness)
      slip = 0.0_wp
      v = 0.0_wp
      theta = 0.0_wp
      power = 0.0_wp
      driven = 0.0_wp
      drive_speed = 0.0_wp
      drive_speed(0) = drive%velocity_at(from%time)
      drive_speed(1) = unit*drive%acceleration
      driven(1) = unit*drive_speed(0)
      driven(2) = 0.5_wp*unit*drive_speed(1)
      theta(0) = from%y(2)
      cosine(0) = cos(theta(0))
      sine(0) = sin(theta(0))
      force(0, :) = stiffness*from%u
      friction(0) = law(0)
      v(1) = unit*rate
      do k = 1, series_order
        slip(k, 1) = unit*convolution(v, cosine, k - 1)/real(k, wp)
        slip(k, 2) = unit*convolution(v, sine, k - 1)/real(k, wp)
        force(k, :) = stiffness*slider%follows*(driven(k)*slider%along - slip(k, :))
        if (k > 1) v(k) = unit*(convolution(force(:, 1), cosine, k - 1) + convolution(force(:, 2), sine, k - 1) &
          - friction(k - 1))/(m*real(k, wp))
        cosine(k) = 0.0_wp
        sine(k) = 0.0_wp
        angle_part = 0.0_wp
        do j = 1, k - 1
          cosine(k) = cosine(k) - real(j, wp)*theta(j)*sine(k - j)/real(k, wp)
          sine(k) = sine(k) + real(j, wp)*theta(j)*cosine(k - j)/real(k, wp)
          angle_part = angle_part + real(j, wp)*theta(j)*v(k + 1 - j)
        end do
        angle_part = unit*(convolution(force(:, 2), cosine, k) - convolution(force(:, 1), sine, k)) - m*angle_part
        if (slider%turns) theta(k) = angle_part/(m*v(1)*real(k, wp) + unit*(force(0, 1)*cosine(0) + force(0, 2)*sine(0)))
        cosine(k) = cosine(k) - theta(k)*sine(0)
        sine(k) = sine(k) + theta(k)*cosine(0)
        power(k, 1) = v(k)/v_range
        do j = 2, 5
          power(k, j) = convolution(power(:, 1), power(:, j - 1), k)
        end do
        friction(k) = dot_product(law(1:5), power(k, :))
      end do
      do k = 1, series_order
        spring(k - 1) = dot_product(slider%pulled(), force(k - 1, :))
      end do
      spring(series_order) = 0.0_wp
      release%drive_work = 0.0_wp
      release%friction_work = 0.0_wp
      do k = 1, series_order
        release%drive_work(k) = unit*convolution(drive_speed, spring, k - 1)/real(k, wp) &
          + dot_product(slider%held_force(from%u), slip(k, :))
        release%friction_work(k) = unit*convolution(friction, v, k - 1)/real(k, wp)
      end do
    end associate
  end subroutine expand

  !> Coefficient k of the product of two series.
  pure real(wp) function convolution(a, b, k)
    real(wp), intent(in) :: a(0:), b(0:)
    integer, intent(in) :: k
    integer :: j

    convolution = 0.0_wp
    do j = 0, k
      convolution = convolution + a(j)*b(k - j)
    end do
  end function convolution

  !> Value at x of the polynomial with these coefficients.
  pure real(wp) function value(coefficient, x)
    real(wp), intent(in) :: coefficient(0:), x
    integer :: k

    value = 0.0_wp
    do k = ubound(coefficient, 1), 0, -1
      value = value*x + coefficient(k)
    end do
  end function value

  !> The longest reach at which the last two terms of v and theta are small enough and up to which
  !> v rises, within v_range.
  pure subroutine choose_reach(release, v_range, tolerance)
    type(release_t), intent(inout) :: release
    real(wp), intent(in) :: v_range, tolerance
    real(wp) :: excess, v
    integer :: attempt
    real(wp), parameter :: longest = 2.0_wp
    integer, parameter :: n = series_order

    release%reach = longest
    do attempt = 1, 1000
      associate (x => release%reach)
        v = value(release%v, x)
        release%moves = rises(release%v, x)
        if (release%moves) then
          excess = max((abs(release%v(n))*x + abs(release%v(n - 1)))*x**(n - 1)/v, &
            (abs(release%theta(n))*x + abs(release%theta(n - 1)))*x**(n - 1))/tolerance
          if (excess <= 1.0_wp .and. v <= v_range) exit
          x = x*min(0.9_wp, max(0.5_wp, 0.95_wp*max(excess, 1.0e-10_wp)**(-1.0_wp/real(n - 2, wp))))
        else
          x = 0.5_wp*x
        end if
        release%moves = .false.
        if (x < tiny(x)) exit
      end associate
    end do
  end subroutine choose_reach

  !> Whether v > 0 and v' >= 0 on (0, x], judged at eight points.
  pure logical function rises(v, x)
    real(wp), intent(in) :: v(0:series_order), x
    real(wp) :: slope(0:series_order - 1)
    integer :: k

    slope = [(real(k, wp)*v(k), k=1, series_order)]
    rises = value(v, x) > 0.0_wp
    do k = 1, 8
      rises = rises .and. value(slope, 0.125_wp*real(k, wp)*x) >= 0.0_wp
    end do
  end function rises

  !> The motion `tau` units after the release at `from`.
  pure function release_at(self, slider, drive, from, tau) result(motion)
    class(release_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(motion_t), intent(in) :: from
    real(wp), intent(in) :: tau
    type(motion_t) :: motion
    real(wp) :: slipped(2)

    slipped = [value(self%slipped(:, 1), tau), value(self%slipped(:, 2), tau)]
    call motion%later(from, tau*self%unit)
    motion%u = from%u + drive%displacement(from%time, tau*self%unit)*slider%pulled() - slider%follows*slipped
    motion%y = [value(self%v, tau), value(self%theta, tau)]
    motion%position = from%position + dot_product(slider%along, slipped)
    motion%drive_work = from%drive_work + value(self%drive_work, tau)
    motion%friction_work = from%friction_work + value(self%friction_work, tau)
  end function release_at
end module dst_contact
