!> Dampers parallel to the springs: derivatives, release, start and end of slip, and the linear theory, from the equations alone.
program test_damping
  use checks, only: check, check_close, check_order, finish
  use random_numbers, only: start_random, uniform, log_uniform
  use dst_kinds, only: wp, pi
  use dst_braking, only: braking_t, braking
  use dst_drive, only: drive_segment_t
  use dst_friction, only: new_friction_law
  use dst_full_model, only: full_polar_t, full_smoothed_t, new_full_polar, new_full_smoothed, plane_decay
  use dst_low_frequency, only: new_low_frequency
  use dst_release, only: release_t, release_series
  use dst_rest, only: spring_force_size, is_held, release_delay, slip_start_t, start_of_slip
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms
  use dst_state, only: state_t
  use dst_straight_slip, only: straight_slip_t, new_straight_slip
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)

  call start_random(3)
  call test_derivatives()
  call test_terms()
  call test_release()
  call test_jump()
  call test_start()
  call test_series()
  call test_braking()
  call test_decay()
  call finish()

contains

  function random_slider() result(slider)
    type(slider_t) :: slider

    slider%mass = log_uniform(0.01_wp, 1.0_wp)
    slider%stiffness = [log_uniform(1.0e2_wp, 1.0e4_wp), log_uniform(1.0e4_wp, 1.0e7_wp)]
    slider%damping = 2.0_wp*sqrt(slider%stiffness*slider%mass)*[log_uniform(1.0e-2_wp, 3.0_wp), log_uniform(1.0e-2_wp, 3.0_wp)]
    slider%along = cos_sin_degrees(sum(uniform(1, -180.0_wp, 180.0_wp)))
    call new_friction_law('weakening', 0.2_wp, 0.15_wp, 0.01_wp, 10.0_wp, slider%law)
  end function random_slider

  !> Exact derivatives of g compared with central differences, in all models.
  subroutine test_derivatives()
    type(slider_t) :: slider
    type(straight_slip_t) :: straight
    real(wp) :: worst(4)
    integer :: trial

    worst = 0.0_wp
    do trial = 1, 40
      slider = random_slider()
      worst(1) = max(worst(1), derivative_error(new_full_polar(slider), slider, [0.01_wp, 1.0_wp]))
      slider%smoothing = log_uniform(1.0e-3_wp, 1.0e-1_wp)**2
      worst(2) = max(worst(2), derivative_error(new_full_smoothed(slider), slider, sqrt(slider%smoothing)*[1.0_wp, 1.0_wp]))
      slider%smoothing = 0.0_wp
      slider%free = [1.0_wp, 0.0_wp]
      worst(3) = max(worst(3), derivative_error(new_low_frequency(slider), slider, abs(slider%along(2))*[1.0e-3_wp, 1.0_wp]))
      slider%free = merge([1.0_wp, 0.0_wp], [0.0_wp, 1.0_wp], modulo(trial, 2) == 0)
      straight = new_straight_slip(slider, merge(1, 2, modulo(trial, 2) == 0), [1.0e-4_wp, 1.0e-7_wp])
      call straight%set_slip_direction(sum(uniform(1, -pi, pi)))
      worst(4) = max(worst(4), derivative_error(straight, slider, [0.01_wp, 1.0_wp]))
    end do
    call check_close('derivatives: polar', worst(1), 0.0_wp, 3.0e-7_wp)
    call check_close('derivatives: smoothed', worst(2), 0.0_wp, 3.0e-7_wp)
    call check_close('derivatives: low frequency', worst(3), 0.0_wp, 3.0e-7_wp)
    call check_close('derivatives: straight slip', worst(4), 0.0_wp, 3.0e-7_wp)
  end subroutine test_derivatives

  !> Largest difference of dg/du and dg/dy, relative to the acting forces, with arguments of these scales.
  function derivative_error(system, slider, scale) result(worst)
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: scale(2)
    integer, parameter :: s = 2
    real(wp), parameter :: drive(s) = [1.0e-3_wp, -5.0e-3_wp]
    real(wp) :: worst, size, h
    type(stage_terms_t) :: terms, above, below
    real(wp), dimension(s, system%components) :: u, y, unused, shift
    real(wp), dimension(s, system%components, system%components) :: velocity_y
    integer :: l, n

    n = system%components
    do l = 1, n
      u(:, l) = uniform(s, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness(system%axis + l - 1)
      y(:, l) = uniform(s, -2.0_wp, 2.0_wp)*scale(l)
    end do
    terms = new_terms(s, n, n)
    above = new_terms(s, n, n)
    below = new_terms(s, n, n)
    call system%kinematics(s, y, unused, velocity_y)
    call system%dynamics(s, drive, u, y, velocity_y, terms)
    size = (slider%law%static_limit + maxval(slider%damping)*(0.02_wp + maxval(abs(drive))))/slider%mass
    worst = 0.0_wp
    do l = 1, n
      h = 1.0e-4_wp*slider%law%static_limit/slider%stiffness(system%axis + l - 1)
      shift = 0.0_wp
      shift(:, l) = h
      call system%dynamics(s, drive, u + shift, y, velocity_y, above)
      call system%dynamics(s, drive, u - shift, y, velocity_y, below)
      worst = max(worst, maxval(abs((above%force - below%force)/2.0_wp - terms%force_u(:, :, l)*h))/(size*1.0e-4_wp))
      h = 1.0e-4_wp*scale(l)
      shift(:, l) = h
      call system%kinematics(s, y + shift, unused, velocity_y)
      call system%dynamics(s, drive, u, y + shift, velocity_y, above)
      call system%kinematics(s, y - shift, unused, velocity_y)
      call system%dynamics(s, drive, u, y - shift, velocity_y, below)
      worst = max(worst, maxval(abs((above%force - below%force)/2.0_wp - terms%force_y(:, :, l)*h))/(size*1.0e-4_wp))
    end do
  end function derivative_error

  !> f = K u + C (V e - w) in both sets of unknowns of the full model, and the part in `damping`.
  subroutine test_terms()
    type(slider_t) :: slider
    type(full_polar_t) :: exact
    type(full_smoothed_t) :: smoothed
    type(stage_terms_t) :: polar, plain
    real(wp) :: u(1, 2), w(2), y(1, 2), v, friction(1), slope(1), velocity(1, 2), velocity_y(1, 2, 2), force(2), drive, n(2)
    real(wp) :: worst(3)
    integer :: trial

    worst = 0.0_wp
    polar = new_terms(1, 2, 2)
    plain = new_terms(1, 2, 2)
    do trial = 1, 40
      slider = random_slider()
      u(1, :) = uniform(2, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness
      w = uniform(2, -0.02_wp, 0.02_wp)
      drive = sum(uniform(1, -0.01_wp, 0.01_wp))
      v = hypot(w(1), w(2))
      n = w/v
      force = slider%stiffness*u(1, :) + slider%damping*(drive*slider%along - w)
      call slider%law%evaluate(1, [v], friction, slope)
      y(1, :) = [v, atan2(w(2), w(1))]
      exact = new_full_polar(slider)
      call exact%kinematics(1, y, velocity, velocity_y)
      call exact%dynamics(1, [drive], u, y, velocity_y, polar)
      associate (size => (sum(abs(force)) + friction(1))/slider%mass)
        worst(1) = max(worst(1), abs(polar%force(1, 1) - (dot_product(force, n) - friction(1))/slider%mass)/size, &
          abs(polar%force(1, 2) - (n(1)*force(2) - n(2)*force(1))/slider%mass)/size)
      end associate
      worst(2) = max(worst(2), abs(polar%damping(1, 1, 1)*slider%mass/sum(slider%damping*n**2) - 1.0_wp))
      y(1, :) = w
      smoothed = new_full_smoothed(slider)
      call smoothed%kinematics(1, y, velocity, velocity_y)
      call smoothed%dynamics(1, [drive], u, y, velocity_y, plain)
      worst(3) = max(worst(3), maxval(abs(plain%force(1, :) - (force - friction(1)*n)/slider%mass)) &
        /maxval(abs(plain%force(1, :))))
    end do
    call check_close('terms: polar', worst(1), 0.0_wp, 1.0e-14_wp)
    call check_close('terms: damping along the slip', worst(2), 0.0_wp, 1.0e-13_wp)
    call check_close('terms: Cartesian', worst(3), 0.0_wp, 1.0e-11_wp)
  end subroutine test_terms

  !> The first time at which |K u + C V e| reaches the static limit, compared with a search in small steps and bisection.
  subroutine test_release()
    type(slider_t) :: slider
    type(drive_segment_t) :: drive
    real(wp) :: u(2), expected, found, worst, angle
    integer :: trial, released, kept, early

    worst = 0.0_wp
    released = 0
    kept = 0
    early = 0
    do trial = 1, 300
      slider = random_slider()
      angle = sum(uniform(1, -pi, pi))
      u = sum(uniform(1, 0.0_wp, 0.9_wp))*slider%law%static_limit*[cos(angle), sin(angle)]/slider%stiffness
      drive = drive_segment_t(start=1.0_wp, end=1.5_wp, velocity=sum(uniform(1, -2.0e-3_wp, 2.0e-3_wp)), &
        acceleration=sum(uniform(1, -8.0e-3_wp, 8.0e-3_wp)))
      if (modulo(trial, 5) == 0) drive%acceleration = 0.0_wp
      found = release_delay(slider, u, drive, 1.1_wp)
      if (excess(slider, u, drive, 0.0_wp) > 0.0_wp) then
        early = early + 1
        call check('release: at once beyond the limit', .not. found > 0.0_wp)
        cycle
      end if
      expected = search(slider, u, drive)
      if (expected > 0.4_wp) then
        kept = kept + 1
        call check('release: not within the ramp', found >= 0.4_wp*(1.0_wp - 1.0e-6_wp))
      else
        released = released + 1
        worst = max(worst, abs(found - expected))
      end if
    end do
    call check('release: all outcomes occur', released > 100 .and. kept > 10 .and. early > 5)
    call check_close('release: delay', worst, 0.0_wp, 1.0e-12_wp)
  end subroutine test_release

  !> |K u + C V e| minus the static limit [N] after a delay [s].
  real(wp) function excess(slider, u, drive, delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), delay
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: force(2)

    force = slider%stiffness*(u + drive%displacement(1.1_wp, delay)*slider%along) &
      + slider%damping*slider%along*drive%velocity_at(1.1_wp + delay)
    excess = hypot(force(1), force(2)) - slider%law%static_limit
  end function excess

  !> The first zero of it within 0.4 s, 1 s if there is none.
  real(wp) function search(slider, u, drive) result(delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)
    type(drive_segment_t), intent(in) :: drive
    integer, parameter :: parts = 4000
    real(wp) :: low, high, middle
    integer :: i

    delay = 1.0_wp
    do i = 1, parts
      if (excess(slider, u, drive, 0.4_wp*real(i, wp)/real(parts, wp)) <= 0.0_wp) cycle
      low = 0.4_wp*real(i - 1, wp)/real(parts, wp)
      high = 0.4_wp*real(i, wp)/real(parts, wp)
      do while (high - low > 2.0_wp*eps*high)
        middle = 0.5_wp*(low + high)
        if (.not. (middle > low .and. middle < high)) exit
        if (excess(slider, u, drive, middle) > 0.0_wp) then
          high = middle
        else
          low = middle
        end if
      end do
      delay = high
      return
    end do
  end function search

  !> A drive at rest that jumps: the damper alone decides.
  subroutine test_jump()
    type(slider_t) :: slider
    type(slip_start_t) :: beginning
    real(wp), parameter :: nothing(2) = 0.0_wp

    slider%stiffness = [1.0e3_wp, 1.0e7_wp]
    slider%damping = [100.0_wp, 0.0_wp]
    slider%mass = 0.25_wp
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    call check_close('jump: force at rest', spring_force_size(slider, nothing, 0.03_wp), 3.0_wp, 4.0_wp*eps)
    call check('jump: holds below the limit', is_held(slider, nothing, 0.0199_wp) .and. is_held(slider, nothing, -0.0199_wp))
    call check('jump: does not above', .not. (is_held(slider, nothing, 0.0201_wp) .or. is_held(slider, nothing, -0.0201_wp)))
    call check('jump: at the limit the ramp decides', is_held(slider, [-1.0e-3_wp, 0.0_wp], 0.03_wp, -1.0_wp) &
      .and. .not. is_held(slider, [-1.0e-3_wp, 0.0_wp], 0.03_wp, 1.0_wp))
    call check_close('jump: released at once', release_delay(slider, nothing, drive_segment_t(velocity=0.03_wp), 0.0_wp), 0.0_wp, &
      0.0_wp)
    beginning = start_of_slip(slider, nothing, -0.03_wp)
    call check_close('jump: sets off backwards', abs(beginning%y(2)), pi, 0.0_wp)
    call check_close('jump: acceleration', beginning%rate(1), 4.0_wp, 1.0e-14_wp)
    ! m v'' = k V - c v'.
    call check_close('jump: and its change', beginning%curvature(1), (30.0_wp - 400.0_wp)/0.25_wp, 1.0e-10_wp)
  end subroutine test_jump

  !> The first derivatives at the start satisfy the equations of motion: the residual falls as the next power of time.
  subroutine test_start()
    type(slider_t) :: slider
    type(slip_start_t) :: beginning
    real(wp) :: angle, u(2), leftover(2), reach, drive, acceleration
    integer :: trial, i

    do trial = 1, 10
      slider = random_slider()
      angle = sum(uniform(1, -pi, pi))
      drive = sum(uniform(1, 0.5e-3_wp, 1.0e-3_wp))
      acceleration = sum(uniform(1, -1.0e-3_wp, 1.0e-3_wp))
      ! One and a half times friction.
      u = (1.5_wp*slider%law%static_limit*[cos(angle), sin(angle)] - slider%damping*drive*slider%along)/slider%stiffness
      beginning = start_of_slip(slider, u, drive, acceleration)
      call check_close('start: acceleration', beginning%rate(1), 0.5_wp*slider%law%static_limit/slider%mass, &
        1.0e-11_wp*beginning%rate(1))
      reach = 1.0e-3_wp*min(slider%radian_time(), 1.0_wp/slider%damping_rate())
      do i = 1, 2
        leftover(i) = turning(slider, u, drive, acceleration, beginning, reach/2.0_wp**(i - 1))
      end do
      call check_order('start: theta', leftover(1), leftover(2), 2.0_wp, 2.0_wp, 0.2_wp)
    end do
  end subroutine test_start

  !> m v theta' - f . t at a time t [s] after the start.
  real(wp) function turning(slider, u, drive, acceleration, beginning, t)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), drive, acceleration, t
    type(slip_start_t), intent(in) :: beginning
    real(wp) :: v, theta, now(2), n(2), force(2)

    v = t*(beginning%rate(1) + 0.5_wp*t*beginning%curvature(1))
    theta = beginning%y(2) + t*beginning%rate(2)
    n = [cos(theta), sin(theta)]
    now = u + t*(drive + 0.5_wp*t*acceleration)*slider%along - 0.5_wp*t**2*beginning%rate(1)*n
    force = slider%stiffness*now + slider%damping*((drive + t*acceleration)*slider%along - v*n)
    turning = abs(slider%mass*v*beginning%rate(2) - dot_product(force, [-n(2), n(1)]))
  end function turning

  !> The power series of a release satisfies the equations of motion to the last term and balances the works.
  subroutine test_series()
    type(slider_t) :: slider
    type(drive_segment_t) :: drive
    type(state_t) :: from, here, before, after
    type(release_t) :: release
    type(slip_start_t) :: beginning
    real(wp) :: angle, speed, tau, h, n(2), force(2), friction(1), slope(1), worst(3), energy(2)
    integer :: trial, made

    worst = 0.0_wp
    made = 0
    do trial = 1, 40
      slider = random_slider()
      angle = atan2(slider%stiffness(2)*slider%along(2), slider%stiffness(1)*slider%along(1)) + sum(uniform(1, -1.0_wp, 1.0_wp))
      speed = sum(uniform(1, 0.5e-3_wp, 1.0e-3_wp))
      drive = drive_segment_t(velocity=speed, acceleration=sum(uniform(1, 0.0_wp, 1.0e-3_wp)))
      from = state_t()
      from%u = (slider%law%static_limit*[cos(angle), sin(angle)] - slider%damping*speed*slider%along)/slider%stiffness
      beginning = start_of_slip(slider, from%u, drive%velocity, drive%acceleration)
      from%y(1:2) = beginning%y
      release = release_series(slider, drive, from, 0.0_wp, 1.0e-12_wp)
      if (.not. (release%moves .and. release%accurate)) cycle
      made = made + 1
      tau = 0.8_wp*release%tau_end
      h = 1.0e-4_wp*release%tau_end
      here = release%at(slider, drive, from, tau)
      before = release%at(slider, drive, from, tau - h)
      after = release%at(slider, drive, from, tau + h)
      h = h*release%unit
      n = [cos(here%y(2)), sin(here%y(2))]
      force = slider%stiffness*here%u + slider%damping*(drive%velocity_at(here%time)*slider%along - here%y(1)*n)
      call slider%law%evaluate(1, here%y(1:1), friction, slope)
      associate (rate => (after%y(1) - before%y(1))/(2.0_wp*h), turn => (after%y(2) - before%y(2))/(2.0_wp*h), &
          scale => (after%y(1) - before%y(1))/(2.0_wp*h))
        worst(1) = max(worst(1), abs(rate - (dot_product(force, n) - friction(1))/slider%mass)/abs(scale))
        worst(2) = max(worst(2), abs(slider%mass*here%y(1)*turn - dot_product(force, [-n(2), n(1)]))/(slider%mass*abs(scale)))
      end associate
      energy = 0.5_wp*[sum(slider%stiffness*from%u**2), sum(slider%stiffness*here%u**2) + slider%mass*here%y(1)**2]
      worst(3) = max(worst(3), abs(here%drive_work - here%friction_work - here%damper_work - energy(2) + energy(1)) &
        /(abs(here%drive_work) + here%damper_work))
    end do
    call check('series: there are some', made > 20)
    call check_close('series: v', worst(1), 0.0_wp, 1.0e-5_wp)
    call check_close('series: theta', worst(2), 0.0_wp, 1.0e-5_wp)
    call check_close('series: works', worst(3), 0.0_wp, 1.0e-8_wp)
  end subroutine test_series

  !> The closed form of the last instants along a line: exact to the second power of the remaining time, and in the balance of
  !> energy.
  subroutine test_braking()
    type(slider_t) :: slider
    type(state_t) :: from, to
    type(drive_segment_t) :: drive
    type(braking_t) :: stopping
    real(wp) :: v, exact, errors(2), balance, root(2), shift, part(2), low, high, middle
    integer :: i

    slider%mass = 0.25_wp
    slider%stiffness = [1.0e3_wp, 1.0e7_wp]
    slider%damping = [60.0_wp, 0.0_wp]
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    drive = drive_segment_t(velocity=1.0e-3_wp)
    ! z = u - F_0/k decays with these rates, and v = V - z' passes through zero.
    root = -120.0_wp + [1.0_wp, -1.0_wp]*sqrt(120.0_wp**2 - 4000.0_wp)
    do i = 1, 2
      v = 1.0e-4_wp/2.0_wp**(i - 1)
      from = state_t(time=1.0_wp, u=[1.2e-3_wp, 0.0_wp], y=[v, 0.0_wp, 0.0_wp])
      stopping = braking(slider, drive, from)
      call check('braking: stops', stopping%falls)
      to = stopping%end_of_slip(slider, drive, from)
      shift = from%u(1) - 2.0e-3_wp
      part(1) = (drive%velocity - v - root(2)*shift)/(root(1) - root(2))
      part(2) = shift - part(1)
      low = 0.0_wp
      high = 2.0_wp*stopping%delay
      do while (high - low > 4.0_wp*eps*high)
        middle = 0.5_wp*(low + high)
        if (drive%velocity - sum(root*part*exp(root*middle)) > 0.0_wp) then
          low = middle
        else
          high = middle
        end if
      end do
      exact = high
      errors(i) = abs(stopping%delay/exact - 1.0_wp)
      call check_close('braking: delay', stopping%delay, exact, 1.0e-4_wp*exact)
      balance = to%drive_work - to%friction_work - to%damper_work - 0.5_wp*slider%stiffness(1)*(to%u(1)**2 - from%u(1)**2) &
        + 0.5_wp*slider%mass*v**2
      call check_close('braking: energy', balance/(0.5_wp*slider%mass*v**2), 0.0_wp, 1.0e-3_wp)
      call check('braking: the damper takes some', to%damper_work > 0.0_wp)
    end do
    call check_order('braking: better the later', errors(1), errors(2), 2.0_wp, 2.0_wp, 0.2_wp)
  end subroutine test_braking

  !> The characteristic polynomial compared with the determinant, at complex points.
  subroutine test_decay()
    type(slider_t) :: slider
    complex(wp) :: z, matrix(2, 2), expected, found
    real(wp) :: coefficient(0:4), along, across, n(2), worst, angle
    integer :: trial, k

    worst = 0.0_wp
    do trial = 1, 40
      slider = random_slider()
      angle = sum(uniform(1, -pi, pi))
      n = [cos(angle), sin(angle)]
      along = -log_uniform(0.1_wp, 10.0_wp)
      across = log_uniform(1.0_wp, 1.0e3_wp)
      coefficient = plane_decay(slider, n, along, across)
      z = cmplx(sum(uniform(1, -1.0_wp, 1.0_wp)), sum(uniform(1, -1.0_wp, 1.0_wp)), wp)*sqrt(slider%stiffness(1)/slider%mass)
      associate (m => slider%mass)
        matrix(1, 1) = m*z**2 + z*(slider%damping(1) + along*n(1)**2 + across*n(2)**2) + slider%stiffness(1)
        matrix(2, 2) = m*z**2 + z*(slider%damping(2) + along*n(2)**2 + across*n(1)**2) + slider%stiffness(2)
        matrix(1, 2) = z*(along - across)*n(1)*n(2)
        expected = (matrix(1, 1)*matrix(2, 2) - matrix(1, 2)**2)/m**2
      end associate
      found = sum([(coefficient(k)*z**k, k=0, 4)])
      worst = max(worst, abs(found - expected)/sum([(coefficient(k)*abs(z)**k, k=0, 4)]))
    end do
    call check_close('decay: polynomial', worst, 0.0_wp, 1.0e-12_wp)
  end subroutine test_decay
end program test_damping
