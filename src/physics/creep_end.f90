!> Where slow creep ends in slip, and how far the fast oscillation has decayed by then.
!>
!> While an object creeps, friction points along theta and turns towards the soft axis, from pi/2 down. The stiff axis is nearly
!> rigid, so that the mean slip speed is v = V sin(phi)/sin(theta), and k_x u_x = F(v) cos(theta). With weakening friction this load
!> has a maximum, tan^2(theta) = -v F'(v)/F(v): there creep ends and slip begins, unless theta reaches phi before.
!>
!> A small oscillation along the stiff axis grows at the rate sigma. Normal to the direction of friction, the turning of the
!> friction vector resists with F/v, so strongly that the motion there has no inertia; the speed b along
!> n = (cos theta, sin theta) remains:
!>
!>     m b' = k_y u_y sin(theta) - F'(v) b,      u_y' = -b sin(theta) - (v k_y cos^2(theta)/F) u_y,
!>
!> an oscillation whose growth rate is half the trace, sigma = [-F'(v)/m - v k_y cos^2(theta)/F(v)]/2. It grows while theta is large
!> and is damped near slip. From the zero of sigma to slip the oscillation decays by exp(-D), D = -(integral of sigma dt), with
!> k_x u_x' = k_x V sin(theta - phi)/sin(theta) = d(F cos theta)/dt: this is an integral over theta, and no motion is computed. If D
!> is large, slip is independent of the fast oscillation; if it is small, the oscillation triggers slip, and slow cycles need not
!> repeat.
!>
!> Source: Nakano & Popov (2020), Eqs. (1)-(4), linearised about creep; docs/theory_stability.md, section 4. SI units.
module dst_creep_end
  use dst_kinds, only: wp, pi
  use dst_roots, only: bracket_t
  use dst_slider, only: slider_t
  implicit none
  private

  public :: creep_end_t, creep_end, fast_growth_rate

  !> How creep ends.
  type :: creep_end_t
    !> Whether it ends in slip; the other components have values only then.
    logical :: exists = .false.
    real(wp) :: angle = 0.0_wp    !! from the soft axis to friction, rad
    real(wp) :: speed = 0.0_wp    !! mean slip speed there, m/s
    real(wp) :: load = 0.0_wp     !! |k_x u_x| there, N
    real(wp) :: decay = 0.0_wp    !! D, without unit; 0 if the oscillation still grows
    !> Ratios without unit that show how far the stiff spring is from rigid there: F'(v)^2/(m k_y sin(theta)^2), above 1 if the
    !> oscillation grows, and k_x/(k_y sin(theta)^2).
    real(wp) :: feeding = 0.0_wp, softness = 0.0_wp
  end type creep_end_t

  !> Creep in units of V, F_0 and l_x/V.
  type :: path_t
    real(wp) :: speed = 0.0_wp            !! |V|, m/s
    real(wp) :: phi = 0.0_wp              !! |phi|, rad
    real(wp) :: resistance = 0.0_wp       !! k_y/k_x
    real(wp) :: feeding = 0.0_wp          !! F_0^2/(m k_x V^2)
  end type path_t

  !> Number of panels, for the search and for the integral. D of random sliders agrees with a fine midpoint rule to 2e-6. Twice: the
  !> same, so that it changes by less than 4e-6.
  integer, parameter :: panels = 64
  !> Ratios beyond this power of two and its inverse are not multiplied. Convention, twice: no change; far from overflow, far from
  !> any rig.
  integer, parameter :: most_power = maxexponent(1.0_wp)/8
  integer, parameter :: most_iterations = 100
  real(wp), parameter :: roundoff = 4.0_wp*epsilon(1.0_wp)
  !> Nodes and weights of Gauss's rule with three points on [-1, 1].
  real(wp), parameter :: node(3) = sqrt(0.6_wp)*[-1.0_wp, 0.0_wp, 1.0_wp]
  real(wp), parameter :: weight(3) = [5.0_wp, 8.0_wp, 5.0_wp]/9.0_wp

contains

  !> The end of creep from unstretched springs under a constant drive velocity V [m/s], for both stiffnesses > 0. Creep has no such
  !> end if friction does not weaken from rest on, F'(0) >= 0, if it has a static limit above F(0), without misalignment, if creep
  !> turns into steady sliding, and beyond ratios of 2^128.
  pure function creep_end(slider, velocity) result(end)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(creep_end_t) :: end
    type(path_t) :: path
    logical :: found
    real(wp) :: last, friction(1), slope(1)

    call new_path(slider, velocity, path, found)
    if (.not. found) return
    call find_slip(slider, path, last, end%exists)
    if (.not. end%exists) return
    end%angle = exp(last)
    end%speed = path%speed*sin(path%phi)/sin(end%angle)
    call slider%law%evaluate(1, [end%speed], friction, slope)
    end%load = friction(1)*cos(end%angle)
    end%softness = slider%stiffness(1)/slider%stiffness(2)/sin(end%angle)**2
    end%feeding = (slope(1)/slider%mass)*(slope(1)/slider%stiffness(2))/sin(end%angle)**2
    end%decay = decay_until(slider, path, last)
  end function creep_end

  !> sigma [1/s] while friction points along theta [rad], 0 < theta <= pi/2, under a drive velocity V [m/s].
  pure real(wp) function fast_growth_rate(slider, velocity, theta) result(rate)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, theta
    real(wp) :: friction(1), slope(1), speed

    speed = abs(velocity*slider%along(2))/sin(theta)
    call slider%law%evaluate(1, [speed], friction, slope)
    rate = -0.5_wp*(slope(1)/slider%mass + speed*slider%stiffness(2)*cos(theta)**2/friction(1))
  end function fast_growth_rate

  !> The path of creep, if it exists and its ratios can be multiplied.
  pure subroutine new_path(slider, velocity, path, exists)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(path_t), intent(out) :: path
    logical, intent(out) :: exists
    real(wp) :: friction(1), slope(1)
    integer :: powers(4)

    exists = slider%mass > 0.0_wp .and. minval(slider%stiffness) > 0.0_wp .and. minval(abs(slider%along)) > 0.0_wp &
      .and. abs(velocity) > 0.0_wp .and. slider%law%kinetic_limit > 0.0_wp
    ! If friction at rest is higher than in slip, the object jumps and does not creep.
    if (slider%law%holds_more()) exists = .false.
    if (.not. exists) return
    call slider%law%evaluate(1, [0.0_wp], friction, slope)
    exists = slope(1) < 0.0_wp
    if (.not. exists) return
    associate (limit => exponent(slider%law%kinetic_limit), speed => exponent(velocity), stiffness => exponent(slider%stiffness))
      powers = [stiffness(2) - stiffness(1), 2*(limit - speed) - exponent(slider%mass) - stiffness(1), &
        exponent(slope(1)) + speed - limit, exponent(minval(abs(slider%along)))]
    end associate
    exists = all(abs(powers) < most_power)
    if (.not. exists) return
    path%speed = abs(velocity)
    path%phi = atan2(abs(slider%along(2)), abs(slider%along(1)))
    path%resistance = slider%stiffness(2)/slider%stiffness(1)
    path%feeding = (slider%law%kinetic_limit/path%speed/slider%mass)*(slider%law%kinetic_limit/path%speed/slider%stiffness(1))
  end subroutine new_path

  !> Along the path, at x = ln(theta): the rate at which the load rises as theta falls, -sin(theta) d(F cos theta)/d(theta) over
  !> F_0, and -2 sigma over V/l_x.
  pure subroutine look(slider, path, x, rise, decay)
    type(slider_t), intent(in) :: slider
    type(path_t), intent(in) :: path
    real(wp), intent(in) :: x(:)
    real(wp), intent(out) :: rise(:), decay(:)
    real(wp) :: theta(size(x)), speed(size(x)), force(size(x)), slope(size(x)), cosine2(size(x))

    theta = exp(x)
    speed = sin(path%phi)/sin(theta)
    cosine2 = cos(theta)**2
    call slider%law%evaluate(size(x), path%speed*speed, force, slope)
    force = force/slider%law%kinetic_limit
    slope = slope*(path%speed/slider%law%kinetic_limit)
    rise = force*sin(theta)**2 + slope*speed*cosine2
    decay = path%resistance*speed*cosine2/force + path%feeding*slope
  end subroutine look

  !> The first maximum of the load, as ln(theta), searched from pi/2 down to phi.
  pure subroutine find_slip(slider, path, x, exists)
    type(slider_t), intent(in) :: slider
    type(path_t), intent(in) :: path
    real(wp), intent(out) :: x
    logical, intent(out) :: exists
    real(wp) :: knots(0:panels), rise(0:panels), decay(0:panels)
    integer :: i

    x = log(0.5_wp*pi)
    knots = x + (log(path%phi) - x)*[(real(i, wp)/real(panels, wp), i=0, panels)]
    call look(slider, path, knots, rise, decay)
    i = findloc(rise <= 0.0_wp, .true., dim=1) - 1
    exists = i > 0
    if (exists) x = zero_between(slider, path, knots([i, i - 1]), .true.)
  end subroutine find_slip

  !> The zero of the load's rate, or of sigma, between two values of ln(theta) at which it has opposite signs.
  pure real(wp) function zero_between(slider, path, ends, of_load) result(x)
    type(slider_t), intent(in) :: slider
    type(path_t), intent(in) :: path
    real(wp), intent(in) :: ends(2)
    logical, intent(in) :: of_load
    type(bracket_t) :: bracket
    real(wp) :: rise(2), decay(2)
    integer :: iteration

    call look(slider, path, ends, rise, decay)
    bracket%x = ends
    bracket%f = merge(rise, decay, of_load)
    do iteration = 1, most_iterations
      x = min(maxval(ends), max(minval(ends), bracket%false_position()))
      call look(slider, path, [x], rise(:1), decay(:1))
      call bracket%narrow(x, merge(rise(1), decay(1), of_load))
      if (abs(bracket%width()) <= roundoff .or. .not. abs(merge(rise(1), decay(1), of_load)) > 0.0_wp) exit
    end do
  end function zero_between

  !> D: from the zero of sigma to slip at ln(theta).
  pure real(wp) function decay_until(slider, path, last) result(total)
    type(slider_t), intent(in) :: slider
    type(path_t), intent(in) :: path
    real(wp), intent(in) :: last
    real(wp) :: knots(0:panels), rise(0:panels), decay(0:panels), angle(3), away(2), first, part, half
    integer :: i

    total = 0.0_wp
    first = log(0.5_wp*pi)
    knots = last + (first - last)*[(real(i, wp)/real(panels, wp), i=0, panels)]
    call look(slider, path, knots, rise, decay)
    if (.not. decay(0) > 0.0_wp) return
    i = findloc(decay > 0.0_wp, .false., dim=1) - 1
    if (i > 0) first = zero_between(slider, path, knots([i - 1, i]), .false.)
    ! Near phi creep takes long, dt ~ dtheta/(theta - phi): equal steps of ln(theta - phi).
    away = log(max(exp([last, first]) - path%phi, roundoff*path%phi))
    part = (away(2) - away(1))/real(panels, wp)
    half = 0.5_wp*part
    do i = 1, panels
      angle = exp(away(1) + (real(i, wp) - 0.5_wp)*part + half*node)
      call look(slider, path, log(path%phi + angle), rise(1:3), decay(1:3))
      total = total + half*0.5_wp*sum(weight*decay(1:3)*rise(1:3)*angle/sin(angle))
    end do
  end function decay_until
end module dst_creep_end
