!> Friction laws, drive, models and exact contact, with dampers and without: the equations, their derivatives and closed forms.
!>
!> Source: Nakano & Popov (2020), Eqs. (1)-(5).
program test_models
  use checks, only: check, check_close, check_order, finish
  use random_numbers, only: start_random, uniform, log_uniform
  use scenes, only: fig3_slider, random_slider
  use dst_kinds, only: wp, pi, degree
  use dst_braking, only: braking_t, braking
  use dst_drive, only: drive_segment_t
  use dst_friction, only: falls_exponentially, friction_law_t, new_friction_law
  use dst_full_model, only: full_polar_t, full_smoothed_t, new_full_polar, new_full_smoothed
  use dst_monotone_cubic, only: monotone_cubic_t, new_monotone_cubic
  use dst_low_frequency, only: low_frequency_t, new_low_frequency
  use dst_rest, only: spring_force_size, is_held, release_delay, slip_start_t, start_of_slip
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms
  use dst_state, only: state_t
  use dst_straight_slip, only: straight_slip_t, new_straight_slip
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)

  call start_random(2)
  call test_friction_laws()
  call test_stribeck()
  call test_table()
  call test_directions()
  call test_jacobians()
  call test_equations()
  call test_reduced_equations()
  call test_release()
  call test_release_at_the_limit()
  call test_onset()
  call test_onset_along_a_line()
  call test_brake()
  call test_time()
  call finish()

contains

  subroutine test_friction_laws()
    class(friction_law_t), allocatable :: law
    real(wp) :: v(6), force(6), slope(6), above(6), below(6), unused(6), h
    real(wp), parameter :: mu_0 = 0.2_wp, mu_inf = 0.15_wp, v_f = 0.01_wp, w = 10.0_wp

    v = [0.0_wp, 1.0e-9_wp, 1.0e-3_wp, v_f, 0.1_wp, 100.0_wp]
    call new_friction_law('weakening', mu_0, mu_inf, v_f, w, law)
    call law%evaluate(6, v, force, slope)
    call check_close('weakening: static limit', law%static_limit, mu_0*w, 0.0_wp)
    call check_close('weakening: starts at the static limit', force(1), law%static_limit, 2.0_wp*eps*law%static_limit)
    call check_close('weakening: Eq. (3)', maxval(abs(force - (mu_inf + (mu_0 - mu_inf)*exp(-v/v_f))*w)), 0.0_wp, 8.0_wp*eps)
    call check_close('weakening: limit', force(6), mu_inf*w, 2.0_wp*eps*w)
    h = 1.0e-5_wp*v_f
    call law%evaluate(6, v + h, above, unused)
    call law%evaluate(6, v - h, below, unused)
    call check_close('weakening: slope', maxval(abs(slope - (above - below)/(2.0_wp*h))), 0.0_wp, 1.0e-8_wp*maxval(abs(slope)))

    ! Below v = 0, where there are only stages beyond a stop: continuous with its slope, finite, falling.
    v = [-0.5_wp*v_f, -0.999999_wp*v_f, -1.000001_wp*v_f, -2.0_wp*v_f, -1.0_wp, -1.0e6_wp]
    call law%evaluate(6, v, force, slope)
    call check_close('weakening: analytic down to -v_f', force(1), (mu_inf + (mu_0 - mu_inf)*exp(0.5_wp))*w, 8.0_wp*eps*w)
    call check_close('weakening: continuous at -v_f', force(3) - force(2), 2.0e-6_wp*v_f*abs(slope(2)), 1.0e-10_wp)
    call check_close('weakening: smooth at -v_f', slope(3), slope(2), 1.0e-5_wp*abs(slope(2)))
    call check('weakening: falls with the speed everywhere', all(slope < 0.0_wp) .and. all(force(2:) > force(:5)))
    call law%evaluate(6, v + h, above, unused)
    call law%evaluate(6, v - h, below, unused)
    call check_close('weakening: slope below zero', maxval(abs(slope(:5) - (above(:5) - below(:5))/(2.0_wp*h))), 0.0_wp, &
      2.0e-5_wp*maxval(abs(slope)))
    call check('weakening: no overflow', all(abs(force) <= huge(1.0_wp)))

    call new_friction_law('constant', mu_0, mu_inf, v_f, w, law)
    call law%evaluate(6, v, force, slope)
    call check('constant friction', all(abs(force - mu_0*w) <= 0.0_wp) .and. all(abs(slope) <= 0.0_wp))
    call new_friction_law('weakening', 0.2_wp, 0.2_wp, v_f, w, law)
    call law%evaluate(6, v, force, slope)
    call check('equal coefficients are constant friction', all(abs(force - mu_0*w) <= 2.0_wp*eps) .and. all(abs(slope) <= 0.0_wp))
    call new_friction_law('weakening', 0.0_wp, 0.0_wp, v_f, w, law)
    call law%evaluate(6, v, force, slope)
    call check('no friction', all(abs(force) <= 0.0_wp) .and. all(abs(slope) <= 0.0_wp))
  end subroutine test_friction_laws

  !> Compared with the formula, and its slope with differences; with p = 1 it has the bits of the weakening law, and at any speed it
  !> is a number.
  subroutine test_stribeck()
    class(friction_law_t), allocatable :: law, weakening
    real(wp), parameter :: mu_0 = 0.2_wp, mu_inf = 0.15_wp, v_f = 0.01_wp, w = 10.0_wp, viscous = 0.3_wp
    real(wp), parameter :: powers(4) = [1.0_wp, 1.5_wp, 2.0_wp, 10.0_wp]
    real(wp) :: v(40), force(40), slope(40), above(40), below(40), unused(40), expected(40), h
    real(wp) :: far(6), far_force(6), far_slope(6)
    integer :: i, side

    v = exp(uniform(40, log(1.0e-4_wp), log(1.0e2_wp)))*v_f
    do i = 1, size(powers)
      call new_friction_law('stribeck', mu_0, mu_inf, v_f, w, law, powers(i), viscous)
      call check_close('stribeck: kinetic limit', law%kinetic_limit, mu_0*w, 0.0_wp)
      call law%evaluate(40, v, force, slope)
      expected = (mu_inf + (mu_0 - mu_inf)*exp(-(v/v_f)**powers(i)) + viscous*v)*w
      call check_close('stribeck: its formula', maxval(abs(force/expected - 1.0_wp)), 0.0_wp, 16.0_wp*eps)
      ! On either side of v = 0, but not across it, since the power has no second derivative there.
      do side = 1, -1, -2
        h = real(side, wp)
        call law%evaluate(40, h*v, force, slope)
        call law%evaluate(40, h*v*(1.0_wp + 1.0e-5_wp), above, unused)
        call law%evaluate(40, h*v*(1.0_wp - 1.0e-5_wp), below, unused)
        call check_close('stribeck: slope', maxval(abs(slope - (above - below)/(2.0e-5_wp*h*v))*v_f), 0.0_wp, 2.0e-7_wp*w)
      end do
      call law%evaluate(2, [-1.0e-300_wp, 0.0_wp], force(:2), slope(:2))
      call check_close('stribeck: smooth through v = 0', slope(1), slope(2), 0.0_wp)
      far = [-1.0e100_wp, -1.0e10_wp, -2.0_wp*v_f, 1.0e10_wp, 1.0e100_wp, 1.0e300_wp]
      call law%evaluate(6, far, far_force, far_slope)
      call check('stribeck: a number at any speed', all(abs(far_force) <= huge(1.0_wp)) .and. all(abs(far_slope) <= huge(1.0_wp)))
      call check_close('stribeck: viscous at last', far_slope(6), viscous*w, 4.0_wp*eps*viscous*w)
    end do
    call new_friction_law('weakening', mu_0, mu_inf, v_f, w, weakening)
    ! So little that it differs from 1 and 0 only because of the form of the law.
    do i = 1, 2
      call new_friction_law('stribeck', mu_0, mu_inf, v_f, w, law, 1.0_wp, merge(0.0_wp, tiny(1.0_wp), i == 1))
      v = exp(uniform(40, log(1.0e-6_wp), log(1.0e6_wp)))*v_f
      v(21:) = -v(21:)
      call law%evaluate(40, v, force, slope)
      call weakening%evaluate(40, v, above, below)
      call check('stribeck: the bits of the weakening law', all(abs(force - above) <= 0.0_wp) .and. &
        all(abs(slope - below) <= 100.0_wp*tiny(1.0_wp)))
      call check('stribeck: exponential if it is that', falls_exponentially(law) .eqv. i == 1)
    end do
  end subroutine test_stribeck

  !> Through the points, smooth between them, without overshoot, constant above, straight below; of the third order.
  subroutine test_table()
    integer, parameter :: n = 12, fine = 2001
    type(monotone_cubic_t) :: curve
    class(friction_law_t), allocatable :: law
    real(wp) :: x(n), y(n), value(n), slope(n), at(fine), values(fine), slopes(fine), above(fine), below(fine), unused(fine)
    real(wp) :: error(3), step, part
    integer :: i, k, trial, panels
    logical :: within

    do trial = 1, 50
      x(1) = 0.0_wp
      y(1) = log_uniform(0.1_wp, 1.0_wp)
      do i = 2, n
        x(i) = x(i - 1) + log_uniform(1.0e-3_wp, 1.0_wp)
        y(i) = log_uniform(0.1_wp, 1.0_wp)
        if (modulo(i, 5) == 0) y(i) = y(i - 1)
      end do
      curve = new_monotone_cubic(x, y)
      call curve%evaluate(x, value, slope)
      call check('table: through its points', all(abs(value - y) <= 0.0_wp))
      within = .true.
      do k = 1, n - 1
        do i = 0, 20
          part = real(i, wp)/20.0_wp
          call curve%evaluate([x(k) + part*(x(k + 1) - x(k))], values(:1), slopes(:1))
          within = within .and. values(1) >= min(y(k), y(k + 1)) - 4.0_wp*eps .and. values(1) <= max(y(k), y(k + 1)) + 4.0_wp*eps
          within = within .and. slopes(1)*(y(k + 1) - y(k)) >= -1.0e-9_wp
        end do
      end do
      call check('table: monotone between two points', within)
      at(:n - 2) = x(2:n - 1)
      call curve%evaluate(at(:n - 2)*(1.0_wp - 1.0e-12_wp), values(:n - 2), slopes(:n - 2))
      call check_close('table: one slope at a point', maxval(abs(slopes(:n - 2) - slope(2:n - 1))/(1.0_wp + abs(slope(2:n - 1)))), &
        0.0_wp, 1.0e-4_wp)
    end do

    do i = 1, 3
      panels = 16*2**i
      step = 10.0_wp/real(panels, wp)
      curve = new_monotone_cubic([(real(k, wp)*step, k=0, panels)], [(exp(-real(k, wp)*step), k=0, panels)])
      at = [(10.0_wp*real(k, wp)/real(fine, wp), k=0, fine - 1)]
      call curve%evaluate(at, values, slopes)
      error(i) = maxval(abs(values - exp(-at)))
      call curve%evaluate(at + 1.0e-6_wp, above, unused)
      call curve%evaluate(at - 1.0e-6_wp, below, unused)
      call check_close('table: its derivative', maxval(abs(slopes - (above - below)/2.0e-6_wp)), 0.0_wp, 2.0e-6_wp)
    end do
    call check('table: of the third order', minval(log(error(:2)/error(2:))/log(2.0_wp)) > 2.7_wp)

    call new_friction_law('table', 0.0_wp, 0.0_wp, 1.0_wp, 10.0_wp, law, speed=[0.0_wp, 0.1_wp, 0.3_wp], &
      mu=[0.2_wp, 0.16_wp, 0.15_wp])
    call check_close('table: kinetic limit', law%kinetic_limit, 2.0_wp, 0.0_wp)
    call law%evaluate(5, [-1.0_wp, 0.0_wp, 0.3_wp, 1.0e300_wp, -1.0e300_wp], values(:5), slopes(:5))
    call check_close('table: straight below v = 0', values(1), values(2) - slopes(2), 4.0_wp*eps)
    call check('table: constant above', all(abs(values(3:4) - 1.5_wp) <= 0.0_wp) .and. all(abs(slopes(3:4)) <= 0.0_wp))
    ! The slope of the parabola at its end, -0.4667 s/m: (mu_2 - mu_1)/h_1 + h_1/(h_1 + h_2) (s_1 - s_2).
    call check_close('table: slope at rest', slopes(2), 10.0_wp*(-0.4_wp - (0.4_wp - 0.05_wp)/3.0_wp), 1.0e-13_wp)
  end subroutine test_table

  subroutine test_directions()
    real(wp) :: angle, direction(2), mirrored(2), worst, worst_unit
    real(wp), parameter :: axis(2, 0:3) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp], [2, 4])
    logical :: odd_and_even
    integer :: i

    do i = -8, 8
      direction = cos_sin_degrees(90.0_wp*real(i, wp))
      call check('exact at multiples of 90 degrees', all(abs(direction - axis(:, modulo(i, 4))) <= 0.0_wp))
      call check('no negative zero', all(sign(1.0_wp, direction) > 0.0_wp .or. abs(direction) > 0.0_wp))
    end do
    worst = 0.0_wp
    worst_unit = 0.0_wp
    odd_and_even = .true.
    do i = 1, 1000
      angle = sum(uniform(1, -360.0_wp, 360.0_wp))
      direction = cos_sin_degrees(angle)
      mirrored = cos_sin_degrees(-angle)
      odd_and_even = odd_and_even .and. all(abs(direction - [mirrored(1), -mirrored(2)]) <= 0.0_wp)
      worst = max(worst, maxval(abs(direction - [cos(angle*degree), sin(angle*degree)])))
      worst_unit = max(worst_unit, abs(sum(direction**2) - 1.0_wp))
    end do
    call check('cosine even, sine odd, to the last bit', odd_and_even)
    call check_close('cosine and sine', worst, 0.0_wp, 8.0_wp*eps)
    call check_close('unit vector', worst_unit, 0.0_wp, 4.0_wp*eps)
    direction = cos_sin_degrees(1.0e-9_wp)
    call check_close('a tiny angle keeps its digits', direction(2), 1.0e-9_wp*degree, 4.0_wp*eps*1.0e-9_wp*degree)
    direction = cos_sin_degrees(90.0_wp + 2.0_wp**(-40))
    call check_close('a tiny angle to the y-axis too', direction(1), -2.0_wp**(-40)*degree, 4.0_wp*eps*2.0_wp**(-40)*degree)
  end subroutine test_directions

  !> Exact derivatives compared with central differences, for all stages of one call, with dampers in every other trial.
  subroutine test_jacobians()
    character(*), parameter :: model(4) = [character(13) :: 'polar', 'smoothed', 'low frequency', 'straight slip']
    character(*), parameter :: what(6) = [character(13) :: 'force_u', 'force_y', 'inertia_y', 'velocity_y', 'dissipation_y', &
      'supply_y']
    integer :: trial, i, axis
    real(wp) :: worst(6, 4)
    type(slider_t) :: slider
    type(straight_slip_t) :: straight

    worst = 0.0_wp
    do trial = 1, 80
      slider = random_slider(modulo(trial, 2) == 0)
      if (modulo(trial, 8) < 2) call new_friction_law('constant', 0.2_wp, 0.15_wp, 0.01_wp, 10.0_wp, slider%law)
      worst(:, 1) = max(worst(:, 1), jacobian_errors(new_full_polar(slider), slider, .true.))
      worst(:, 3) = max(worst(:, 3), jacobian_errors(new_low_frequency(slider), slider, .false.))
      slider%smoothing = log_uniform(1.0e-4_wp, 1.0e-1_wp)**2
      worst(:, 2) = max(worst(:, 2), jacobian_errors(new_full_smoothed(slider), slider, .false.))
      slider%smoothing = 0.0_wp
      slider%direction_free = .false.
      axis = 1 + modulo(trial/2, 2)
      slider%free = merge([1.0_wp, 0.0_wp], [0.0_wp, 1.0_wp], axis == 1)
      straight = new_straight_slip(slider, axis, [1.0e-4_wp, 1.0e-7_wp])
      call straight%set_slip_direction(sum(uniform(1, -pi, pi)))
      worst(:, 4) = max(worst(:, 4), jacobian_errors(straight, slider, .false.))
    end do
    do i = 1, size(model)
      do trial = 1, size(what)
        call check_close(trim(model(i))//': '//what(trial), worst(trial, i), 0.0_wp, 3.0e-7_wp)
      end do
    end do
  end subroutine test_jacobians

  !> Largest differences, relative to the size of the function over the scale of its argument, of force_u, force_y, inertia_y,
  !> velocity_y, dissipation_y and supply_y.
  function jacobian_errors(system, slider, polar) result(worst)
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    logical, intent(in) :: polar
    integer, parameter :: s = 3
    real(wp), parameter :: drive(s) = [1.0e-3_wp, -5.0e-3_wp, 2.0e-2_wp]
    real(wp) :: worst(6)
    type(stage_terms_t) :: terms, above, below
    real(wp), dimension(s, system%components) :: u, y, velocity, velocity_above, velocity_below, shift
    real(wp), dimension(s, system%components, system%components) :: velocity_y, unused
    real(wp) :: scale(2), force, h
    integer :: l, n

    n = system%components
    do l = 1, n
      u(:, l) = uniform(s, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness(system%axis + l - 1)
      y(:, l) = uniform(s, -0.02_wp, 0.02_wp)
    end do
    if (polar) y(:, n) = uniform(s, -pi, pi)
    terms = new_terms(s, n, system%unknowns)
    above = new_terms(s, n, system%unknowns)
    below = new_terms(s, n, system%unknowns)
    call system%kinematics(s, y, velocity, velocity_y)
    call system%dynamics(s, drive, u, y, velocity_y, terms)
    force = (slider%law%static_limit + maxval(slider%damping)*(0.02_wp + maxval(abs(drive))))/slider%mass
    scale = [0.01_wp, merge(1.0_wp, 0.01_wp, polar)]
    if (slider%smoothing > 0.0_wp) scale = min(scale, sqrt(slider%smoothing))
    if (abs(system%prescribed) > 0.0_wp) scale = min(scale, abs(system%prescribed)*minval(abs(drive)))
    worst = 0.0_wp
    do l = 1, n
      h = 1.0e-4_wp*slider%law%static_limit/slider%stiffness(system%axis + l - 1)
      shift = 0.0_wp
      shift(:, l) = h
      call system%dynamics(s, drive, u + shift, y, velocity_y, above)
      call system%dynamics(s, drive, u - shift, y, velocity_y, below)
      worst(1) = max(worst(1), maxval(abs((above%force - below%force)/2.0_wp - terms%force_u(:, :, l)*h))/(force*1.0e-4_wp))
      h = 1.0e-4_wp*scale(l)
      shift(:, l) = h
      call system%kinematics(s, y + shift, velocity_above, unused)
      call system%dynamics(s, drive, u, y + shift, unused, above)
      call system%kinematics(s, y - shift, velocity_below, unused)
      call system%dynamics(s, drive, u, y - shift, unused, below)
      worst(2) = max(worst(2), maxval(abs((above%force - below%force)/2.0_wp - terms%force_y(:, :, l)*h))/(force*1.0e-4_wp))
      worst(3) = max(worst(3), maxval(abs((above%inertia - below%inertia)/2.0_wp - terms%inertia_y(:, :, l)*h))/h)
      worst(4) = max(worst(4), maxval(abs((velocity_above - velocity_below)/2.0_wp - velocity_y(:, :, l)*h)) &
        /(0.01_wp*1.0e-4_wp))
      worst(5) = max(worst(5), maxval(abs((above%dissipation - below%dissipation)/2.0_wp - terms%dissipation_y(:, l)*h)) &
        /(slider%law%static_limit*0.01_wp*1.0e-4_wp))
      worst(6) = max(worst(6), maxval(abs((above%supply - below%supply)/2.0_wp - terms%supply_y(:, l)*h)) &
        /(slider%law%static_limit*0.01_wp*1.0e-4_wp))
    end do
  end function jacobian_errors

  !> m w' = K u + C (V e - w) - F(v) w/v, in both sets of unknowns, with dampers in every other trial.
  subroutine test_equations()
    integer, parameter :: s = 2
    type(full_polar_t) :: polar
    type(full_smoothed_t) :: smoothed
    type(slider_t) :: slider
    type(stage_terms_t) :: terms
    real(wp), dimension(s, 2) :: u, y, w, right, left
    real(wp) :: w_y(s, 2, 2), drive(s), v(s), friction(s), slope(s), worst(5), force
    integer :: trial, i

    terms = new_terms(s, 2, 2)
    worst = 0.0_wp
    do trial = 1, 80
      slider = random_slider(modulo(trial, 2) == 0)
      u(:, 1) = uniform(s, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness(1)
      u(:, 2) = uniform(s, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness(2)
      drive = uniform(s, -0.01_wp, 0.01_wp)
      polar = new_full_polar(slider)
      v = uniform(s, 1.0e-4_wp, 0.05_wp)
      y(:, 1) = v
      y(:, 2) = uniform(s, -pi, pi)
      call polar%kinematics(s, y, w, w_y)
      call polar%dynamics(s, drive, u, y, w_y, terms)
      worst(1) = max(worst(1), maxval(abs(sqrt(w(:, 1)**2 + w(:, 2)**2) - v)/v), maxval(abs(atan2(w(:, 2), w(:, 1)) - y(:, 2))))
      call slider%law%evaluate(s, v, friction, slope)
      force = slider%law%static_limit + maxval(slider%damping)*(maxval(abs(drive)) + maxval(v))
      do i = 1, s
        right(i, :) = slider%stiffness*u(i, :) + slider%damping*(drive(i)*slider%along - w(i, :))
        ! w' = v' n + v theta' t.
        left(i, :) = terms%force(i, 1)*[cos(y(i, 2)), sin(y(i, 2))] + terms%force(i, 2)*[-sin(y(i, 2)), cos(y(i, 2))]
        worst(2) = max(worst(2), maxval(abs(slider%mass*left(i, :) - right(i, :) + friction(i)*w(i, :)/v(i)))/force)
        if (maxval(slider%damping) > 0.0_wp) worst(5) = max(worst(5), &
          abs(terms%damping(i, 1, 1)*slider%mass/sum(slider%damping*(w(i, :)/v(i))**2) - 1.0_wp))
      end do
      worst(4) = max(worst(4), maxval(abs(terms%inertia(:, 1) - 1.0_wp)), maxval(abs(terms%inertia(:, 2) - v)), &
        maxval(abs(terms%dissipation/(friction*v) - 1.0_wp)))

      slider%smoothing = 1.0e-3_wp**2
      smoothed = new_full_smoothed(slider)
      y = w
      call smoothed%kinematics(s, y, w, w_y)
      call smoothed%dynamics(s, drive, u, y, w_y, terms)
      do i = 1, s
        worst(3) = max(worst(3), maxval(abs(slider%mass*terms%force(i, :) - right(i, :) &
          + friction(i)*w(i, :)/hypot(v(i), 1.0e-3_wp)))/force)
        worst(4) = max(worst(4), abs(terms%dissipation(i)*hypot(v(i), 1.0e-3_wp)/(friction(i)*v(i)**2) - 1.0_wp))
      end do
      worst(4) = max(worst(4), maxval(abs(terms%inertia - 1.0_wp)))
    end do
    call check_close('polar: speed and angle', worst(1), 0.0_wp, 8.0_wp*eps)
    call check_close('polar: Eqs. (1)-(5)', worst(2), 0.0_wp, 16.0_wp*eps)
    call check_close('smoothed: Eqs. (1)-(5)', worst(3), 0.0_wp, 16.0_wp*eps)
    call check_close('inertia and dissipation', worst(4), 0.0_wp, 64.0_wp*eps)
    call check_close('polar: damping along the slip', worst(5), 0.0_wp, 1.0e-13_wp)
    call check('direction of the drive', all(abs(polar%drive_coupling - slider%along) <= 0.0_wp) &
      .and. all(abs(smoothed%drive_coupling - slider%along) <= 0.0_wp))
    ! A compiler may round the product and the difference together.
    call check('force along the drive', all(abs(polar%drive_stiffness - slider%stiffness*slider%along) <= eps*slider%stiffness))
    y = 0.0_wp
    call smoothed%dynamics(s, drive, u, y, w_y, terms)
    call check('smoothed: finite at rest', all(abs(terms%force) <= huge(1.0_wp)) .and. all(abs(terms%force_y) <= huge(1.0_wp)) &
      .and. all(abs(terms%dissipation_y) <= 0.0_wp))
  end subroutine test_equations

  !> The reduced models against m w' = K u - F(v) w/v, and their power balance.
  subroutine test_reduced_equations()
    type(low_frequency_t) :: low
    type(straight_slip_t) :: straight
    type(slider_t) :: slider
    type(stage_terms_t) :: terms
    real(wp) :: y(2), w(2), u(2), drive, v, friction(1), slope(1), n(2), one(1, 1), gradient(1, 1, 1), worst(4), input
    integer :: trial

    terms = new_terms(1, 1, 1)
    worst = 0.0_wp
    do trial = 1, 50
      slider = random_slider(.false.)
      u = [1.0_wp, 0.3_wp]*uniform(2, -1.0_wp, 1.0_wp)*slider%law%static_limit/slider%stiffness
      drive = sum(uniform(1, -0.01_wp, 0.01_wp))
      y = [sum(uniform(1, -0.02_wp, 0.02_wp)), 0.0_wp]
      low = new_low_frequency(slider)
      w = low%slip_velocity([y, 0.0_wp], drive)
      v = norm2(w)
      call slider%law%evaluate(1, [v], friction, slope)
      call low%kinematics(1, y(1:1), one, gradient)
      call low%dynamics(1, [drive], u(1:1), y(1:1), gradient, terms)
      worst(1) = max(worst(1), abs(w(2) - drive*slider%along(2))/v, &
        abs(slider%mass*terms%force(1, 1) - slider%stiffness(1)*u(1) + friction(1)*w(1)/v)/slider%law%static_limit)
      ! X' = w . e; the power put in is that stored and that lost.
      worst(2) = max(worst(2), abs(low%advance_by_slip(1)*w(1) + low%advance_by_drive*drive - dot_product(w, slider%along))/v)
      input = drive*low%drive_stiffness(1)*u(1) + terms%supply(1)
      worst(2) = max(worst(2), abs(input - terms%dissipation(1) - slider%mass*w(1)*terms%force(1, 1) &
        - slider%stiffness(1)*u(1)*(drive*slider%along(1) - w(1)))/(slider%law%static_limit*v))

      slider%free = [0.0_wp, 1.0_wp]
      slider%direction_free = .false.
      straight = new_straight_slip(slider, 2, u)
      y(2) = sum(uniform(1, -pi, pi))
      call straight%set_slip_direction(y(2))
      n = straight%direction
      y(1) = abs(y(1))
      w = straight%slip_velocity([y, 0.0_wp], drive)
      call slider%law%evaluate(1, y(1:1), friction, slope)
      call straight%kinematics(1, y(1:1), one, gradient)
      call straight%dynamics(1, [drive], u(2:2), y(1:1), gradient, terms)
      worst(3) = max(worst(3), norm2(w - y(1)*n)/y(1), abs(one(1, 1) - w(2))/y(1), &
        abs(slider%mass*terms%force(1, 1) - dot_product(slider%stiffness*u, n) + friction(1))/slider%law%static_limit)
      worst(4) = max(worst(4), abs(straight%advance_by_slip(2)*w(2) - dot_product(w, slider%along))/y(1))
      input = drive*straight%drive_stiffness(2)*u(2) + terms%supply(1)
      worst(4) = max(worst(4), abs(input - terms%dissipation(1) - slider%mass*y(1)*terms%force(1, 1) &
        - slider%stiffness(2)*u(2)*(drive*slider%along(2) - w(2)))/(slider%law%static_limit*y(1)))
    end do
    call check_close('low frequency: Eq. (4)', worst(1), 0.0_wp, 16.0_wp*eps)
    call check_close('low frequency: power', worst(2), 0.0_wp, 64.0_wp*eps)
    call check_close('straight slip: Eq. (9)', worst(3), 0.0_wp, 16.0_wp*eps)
    call check_close('straight slip: power', worst(4), 0.0_wp, 256.0_wp*eps)
  end subroutine test_reduced_equations

  !> First delay at which |K (u + D(t) e)| = F_0, by bisection on each stretch between the turns of the drive: there D(t) is
  !> monotone, and the force is convex in D.
  function release_by_bisection(slider, u, drive, time, last) result(delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), time, last
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: delay
    real(wp) :: edges(0:2), low, middle
    integer :: i, edge

    edges = [0.0_wp, last, last]
    if (abs(drive%acceleration) > 0.0_wp) edges(1) = min(last, max(0.0_wp, -drive%velocity_at(time)/drive%acceleration))
    do edge = 1, 2
      low = edges(edge - 1)
      delay = edges(edge)
      if (spring_force_size(slider, u + drive%displacement(time, delay)*slider%along) < slider%law%static_limit) cycle
      do i = 1, 200
        middle = 0.5_wp*(low + delay)
        if (spring_force_size(slider, u + drive%displacement(time, middle)*slider%along) < slider%law%static_limit) then
          low = middle
        else
          delay = middle
        end if
      end do
      return
    end do
    delay = huge(delay)
  end function release_by_bisection

  subroutine test_release()
    type(slider_t) :: slider
    type(drive_segment_t) :: drive
    real(wp) :: u(2), angle, expected, found, time, last, worst
    integer :: trial, released, kept
    logical :: agree_on_never, at_limit

    worst = 0.0_wp
    released = 0
    kept = 0
    agree_on_never = .true.
    at_limit = .true.
    do trial = 1, 4000
      slider = random_slider(.false.)
      angle = sum(uniform(1, -pi, pi))
      u = sqrt(sum(uniform(1, 0.0_wp, 1.0_wp)))*slider%law%static_limit*[cos(angle), sin(angle)]/slider%stiffness
      drive = drive_segment_t(start=1.0_wp, velocity=sum(uniform(1, -1.0e-3_wp, 1.0e-3_wp)))
      ! Constant, ramped (also against the velocity), starting from rest, or at rest.
      if (modulo(trial, 4) > 0) drive%acceleration = sum(uniform(1, -1.0e-3_wp, 1.0e-3_wp))
      if (modulo(trial, 4) == 1) drive%velocity = 0.0_wp
      if (modulo(trial, 40) == 0) drive%velocity = 0.0_wp
      time = 1.0_wp + sum(uniform(1, 0.0_wp, 2.0_wp))
      last = 1.0e4_wp
      expected = release_by_bisection(slider, u, drive, time, last)
      found = release_delay(slider, u, drive, time)
      if (expected < last) then
        released = released + 1
        worst = max(worst, abs(found/expected - 1.0_wp))
        at_limit = at_limit .and. &
          abs(spring_force_size(slider, u + drive%displacement(time, found)*slider%along)/slider%law%static_limit - 1.0_wp) &
          <= 1.0e-10_wp
      else
        kept = kept + 1
        agree_on_never = agree_on_never .and. found > last
      end if
    end do
    call check('release: both outcomes occur', released > 1000 .and. kept > 50)
    call check_close('release: delay', worst, 0.0_wp, 1.0e-9_wp)
    call check('release: the static limit is reached', at_limit)
    call check('release: never', agree_on_never)

    ! Fig. 3: t_1 = F_0/(V sqrt(k_x^2 c^2 + k_y^2 s^2)) = 11.46 ms.
    slider = fig3_slider(1.0_wp)
    drive = drive_segment_t(velocity=1.0e-3_wp)
    found = release_delay(slider, [0.0_wp, 0.0_wp], drive, 0.0_wp)
    call check_close('release: first one of Fig. 3', found, 2.0_wp/(1.0e-3_wp*hypot(1.0e3_wp*cos(degree), 1.0e7_wp*sin(degree))), &
      4.0_wp*eps*found)
    call check_close('release: as printed', found, 11.46e-3_wp, 0.005e-3_wp)
    call check('release: a standing drive releases nothing', &
      release_delay(slider, [1.0e-3_wp, 1.0e-8_wp], drive_segment_t(), 0.0_wp) >= huge(1.0_wp))
  end subroutine test_release

  !> Exactly at the static limit: released at once if the load grows, at rest if it falls.
  subroutine test_release_at_the_limit()
    type(slider_t) :: slider
    real(wp), parameter :: u(2) = [2.0e-3_wp, 0.0_wp]

    slider = fig3_slider(1.0_wp)
    slider%along = [1.0_wp, 0.0_wp]
    call check('holds below the limit', is_held(slider, 0.95_wp*u, 1.0e-3_wp) .and. is_held(slider, 0.95_wp*u, -1.0e-3_wp))
    call check('does not hold above it', .not. (is_held(slider, 1.05_wp*u, 1.0e-3_wp) .or. is_held(slider, 1.05_wp*u, -1.0e-3_wp)))
    call check('at the limit: held if it is unloaded or nothing moves', is_held(slider, u, -1.0e-3_wp) &
      .and. is_held(slider, u, 0.0_wp) .and. is_held(slider, -u, 1.0e-3_wp))
    call check('at the limit: not held if it is loaded', .not. (is_held(slider, u, 1.0e-3_wp) .or. is_held(slider, -u, -1.0e-3_wp)))
    call check_close('at the limit: forwards', release_delay(slider, u, drive_segment_t(velocity=1.0e-3_wp), 0.0_wp), &
      0.0_wp, 0.0_wp)
    call check_close('at the limit: forwards by a ramp from rest', &
      release_delay(slider, u, drive_segment_t(velocity=0.0_wp, acceleration=1.0e-3_wp), 0.0_wp), 0.0_wp, 0.0_wp)
    call check_close('at the limit: backwards', release_delay(slider, u, drive_segment_t(velocity=-1.0e-3_wp), 0.0_wp), &
      4.0_wp, 1.0e-14_wp)
    call check_close('at the limit: backwards by a ramp from rest', &
      release_delay(slider, u, drive_segment_t(velocity=0.0_wp, acceleration=-2.0e-3_wp), 0.0_wp), 2.0_wp, 1.0e-14_wp)
    call check_close('at the limit: back and forth again', &
      release_delay(slider, u, drive_segment_t(velocity=-1.0e-3_wp, acceleration=1.0e-3_wp), 0.0_wp), 2.0_wp, 1.0e-14_wp)
  end subroutine test_release_at_the_limit

  !> The series of the start of slip satisfies the equations of motion: the residual falls as the next power of time.
  !>
  !> With v = a t + b t^2/2 and theta = theta_0 + r t, where a = 0 at a release, v' - (K u . n - F)/m must fall as t^2 (a > 0: as t)
  !> and m v theta' - K u . t as t^2.
  subroutine test_onset()
    type(slider_t) :: slider
    type(slip_start_t) :: beginning
    type(drive_segment_t) :: drive
    real(wp) :: u(2), angle, leftover(2, 2), reach, t
    integer :: trial, i

    do trial = 1, 6
      slider = random_slider(.false.)
      angle = atan2(slider%stiffness(2)*slider%along(2), slider%stiffness(1)*slider%along(1)) + sum(uniform(1, -1.2_wp, 1.2_wp))
      u = slider%law%static_limit*[cos(angle), sin(angle)]/slider%stiffness
      beginning = start_of_slip(slider, u, 1.0e-3_wp)
      beginning%rate(1) = 0.0_wp
      call check_close('onset: from rest', beginning%y(1), 0.0_wp, 0.0_wp)
      call check_close('onset: in the direction of K u', beginning%y(2), atan2(sin(angle), cos(angle)), 8.0_wp*eps)
      call check_close('onset: w = (g.n/2m) t^2', beginning%curvature(1), &
        1.0e-3_wp*dot_product(slider%stiffness*slider%along, [cos(angle), sin(angle)])/slider%mass, &
        1.0e-12_wp*beginning%curvature(1))
      reach = 1.0e-3_wp*sqrt(slider%mass/slider%stiffness(2))
      do i = 1, 2
        t = reach/2.0_wp**(i - 1)
        leftover(:, i) = abs(leftover_of(slider, u, drive_segment_t(velocity=1.0e-3_wp), beginning, t))
      end do
      call check_order('onset: v', leftover(1, 1), leftover(1, 2), 2.0_wp, 2.0_wp, 0.15_wp)
      call check_order('onset: theta', leftover(2, 1), leftover(2, 2), 2.0_wp, 2.0_wp, 0.15_wp)
    end do
    ! At one and a half times friction: Fig. 3, and sliders with dampers, whose drive accelerates.
    do trial = 0, 10
      slider = fig3_slider(1.0_wp)
      drive = drive_segment_t(velocity=1.0e-3_wp)
      angle = 0.5_wp
      reach = 1.0e-4_wp*sqrt(slider%mass/slider%stiffness(2))
      if (trial > 0) then
        slider = random_slider(.true.)
        drive = drive_segment_t(velocity=sum(uniform(1, 0.5e-3_wp, 1.0e-3_wp)), &
          acceleration=sum(uniform(1, -1.0e-3_wp, 1.0e-3_wp)))
        angle = sum(uniform(1, -pi, pi))
        reach = 1.0e-3_wp*min(slider%radian_time(), slider%mass/maxval(slider%damping))
      end if
      u = (1.5_wp*slider%law%static_limit*[cos(angle), sin(angle)] - slider%damping*drive%velocity*slider%along)/slider%stiffness
      beginning = start_of_slip(slider, u, drive%velocity, drive%acceleration)
      call check_close('onset beyond the limit: acceleration', beginning%rate(1), &
        0.5_wp*slider%law%static_limit/slider%mass, merge(1.0e-11_wp*beginning%rate(1), 1.0e-14_wp, trial > 0))
      do i = 1, 2
        leftover(:, i) = abs(leftover_of(slider, u, drive, beginning, reach/2.0_wp**(i - 1)))
      end do
      if (trial == 0) call check_order('onset beyond the limit: v', leftover(1, 1), leftover(1, 2), 2.0_wp, 1.0_wp, 0.1_wp)
      call check_order('onset beyond the limit: theta', leftover(2, 1), leftover(2, 2), 2.0_wp, 2.0_wp, &
        merge(0.2_wp, 0.15_wp, trial > 0))
    end do
  end subroutine test_onset

  !> The residuals of the series in both equations at time t.
  function leftover_of(slider, u, drive, beginning, t) result(leftover)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), t
    type(drive_segment_t), intent(in) :: drive
    type(slip_start_t), intent(in) :: beginning
    real(wp) :: leftover(2)
    real(wp) :: v, theta, now(2), slipped, friction(1), slope(1), n(2), force(2)

    v = t*(beginning%rate(1) + 0.5_wp*t*beginning%curvature(1))
    slipped = t**2*(0.5_wp*beginning%rate(1) + t*beginning%curvature(1)/6.0_wp)
    theta = beginning%y(2) + t*beginning%rate(2)
    ! The direction turns by O(t) while slipping O(t^2): the curve of the path is of higher order.
    now = u + drive%displacement(0.0_wp, t)*slider%along - slipped*[cos(beginning%y(2)), sin(beginning%y(2))]
    n = [cos(theta), sin(theta)]
    force = slider%stiffness*now + slider%damping*(drive%velocity_at(t)*slider%along - v*n)
    call slider%law%evaluate(1, [v], friction, slope)
    leftover(1) = slider%mass*(beginning%rate(1) + t*beginning%curvature(1)) - (dot_product(force, n) - friction(1))
    leftover(2) = slider%mass*v*beginning%rate(2) - dot_product(force, [-n(2), n(1)])
  end function leftover_of

  !> At phi = 0 with constant friction the start is harmonic: v = V (1 - cos(omega t)).
  subroutine test_onset_along_a_line()
    type(slider_t) :: slider
    type(slip_start_t) :: beginning
    real(wp) :: omega

    slider = fig3_slider(1.0_wp)
    slider%along = [1.0_wp, 0.0_wp]
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    omega = sqrt(slider%stiffness(1)/slider%mass)
    beginning = start_of_slip(slider, [2.0e-3_wp, 0.0_wp], 1.0e-3_wp)
    call check_close('onset along a line: V omega^2', beginning%curvature(1), 1.0e-3_wp*omega**2, 1.0e-14_wp)
    call check_close('onset along a line: straight', beginning%rate(2), 0.0_wp, 0.0_wp)
    beginning = start_of_slip(slider, [-2.0e-3_wp, 0.0_wp], -1.0e-3_wp)
    call check_close('onset backwards', beginning%y(2), pi, 0.0_wp)
    call check_close('onset backwards: V omega^2', beginning%curvature(1), 1.0e-3_wp*omega**2, 1.0e-14_wp)
    ! Without friction and without elongation the drive determines the direction.
    call new_friction_law('constant', 0.0_wp, 0.0_wp, 1.0_wp, 10.0_wp, slider%law)
    slider%along = cos_sin_degrees(30.0_wp)
    beginning = start_of_slip(slider, [0.0_wp, 0.0_wp], 1.0e-3_wp)
    call check_close('onset without force', beginning%y(2), atan2(1.0e7_wp*0.5_wp, 1.0e3_wp*cos(30.0_wp*degree)), 1.0e-15_wp)
  end subroutine test_onset_along_a_line

  !> The time is the sum of its steps, whatever their number: the rounding errors are kept.
  subroutine test_time()
    type(state_t) :: from, to
    integer :: i
    integer, parameter :: n = 1000000
    real(wp), parameter :: step = 1.0_wp/3.0e3_wp

    from = state_t(time=1.0e3_wp)
    do i = 1, n
      call to%later(from, step)
      from%time = to%time
      from%time_rest = to%time_rest
    end do
    call check_close('time: sum of a million steps', from%time - 1.0e3_wp, real(n, wp)*step, 2.0_wp*eps*1.0e3_wp)
    call check_close('time: duration up to another', from%until(from%time + 0.25_wp), 0.25_wp, 2.0_wp*eps*1.0e3_wp)
  end subroutine test_time

  !> The last instants before a stop: exact along a line with constant friction up to the second order in the remaining time, and
  !> the energy balance closes; without a damper, and with one above the critical damping.
  subroutine test_brake()
    real(wp), parameter :: damping(2) = [0.0_wp, 60.0_wp], near(2) = [1.0e-6_wp, 1.0e-4_wp]
    type(slider_t) :: slider
    type(state_t) :: from, to
    type(drive_segment_t) :: drive
    type(braking_t) :: stopping
    complex(wp) :: root(2), part(2)
    real(wp) :: v, shift, low, high, middle, errors(2), balance
    integer :: i, k

    drive = drive_segment_t(velocity=1.0e-3_wp)
    do k = 1, 2
      slider = fig3_slider(0.0_wp)
      slider%damping = [damping(k), 0.0_wp]
      call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
      ! z = u - F_0/k grows at these rates, and v = V - z' passes through zero.
      middle = 0.5_wp*slider%damping(1)/slider%mass
      root = -middle + [1.0_wp, -1.0_wp]*sqrt(cmplx(middle**2 - slider%stiffness(1)/slider%mass, kind=wp))
      do i = 1, 2
        v = 1.0e-4_wp/2.0_wp**(i - 1)
        from = state_t(time=1.0_wp, u=[1.2e-3_wp, 0.0_wp], y=[v, 0.0_wp, 0.0_wp])
        stopping = braking(slider, drive, from)
        call check('brake: stops', stopping%falls .and. stopping%acceleration < 0.0_wp)
        to = stopping%end_of_slip(slider, drive, from)
        shift = from%u(1) - slider%law%static_limit/slider%stiffness(1)
        part(1) = (drive%velocity - v - root(2)*shift)/(root(1) - root(2))
        part(2) = shift - part(1)
        low = 0.0_wp
        high = 2.0_wp*stopping%delay
        do while (high - low > 4.0_wp*eps*high)
          middle = 0.5_wp*(low + high)
          if (drive%velocity - real(sum(root*part*exp(root*middle))) > 0.0_wp) then
            low = middle
          else
            high = middle
          end if
        end do
        errors(i) = abs(stopping%delay/high - 1.0_wp)
        call check_close('brake: delay', stopping%delay, high, near(k)*high)
        call check_close('brake: time of the stop', to%time - from%time, high, near(k)*high + 4.0_wp*eps)
        call check_close('brake: at rest', to%y(1), 0.0_wp, 0.0_wp)
        call check_close('brake: position', to%position, drive%displacement(1.0_wp, to%time - from%time) - (to%u(1) - from%u(1)), &
          1.0e-18_wp)
        balance = to%drive_work - to%friction_work - to%damper_work - 0.5_wp*slider%stiffness(1)*(to%u(1)**2 - from%u(1)**2) &
          + 0.5_wp*slider%mass*v**2
        call check_close('brake: energy', balance/(0.5_wp*slider%mass*v**2), 0.0_wp, 1.0e-3_wp)
        call check('brake: a damper takes some', (to%damper_work > 0.0_wp) .eqv. k == 2)
      end do
      if (k == 1) call check('brake: better the later', errors(2) <= 0.3_wp*errors(1) + 1.0e-10_wp)
      if (k == 2) call check_order('brake: better the later', errors(1), errors(2), 2.0_wp, 2.0_wp, 0.2_wp)
    end do
    slider%damping = 0.0_wp
    from%u = [2.5e-3_wp, 0.0_wp]
    call check('brake: speeding up is no stop', .not. stops(slider, drive, from))
    ! Nor if the drive, which moves back, stops it later: the direction may have changed by then.
    from%u = [2.02e-3_wp, 0.0_wp]
    call check('brake: speeding up at first is no stop', .not. stops(slider, drive_segment_t(velocity=-1.0e-3_wp), from))
    from%u = [-3.0e-3_wp, 0.0_wp]
    call check('brake: beyond the limit it ends', stops(slider, drive, from))
    stopping = braking(slider, drive, from)
    to = stopping%end_of_slip(slider, drive, from)
    call check('brake: in a turn', .not. is_held(slider, to%u, drive%velocity))
  end subroutine test_brake

  !> Whether the slip ends soon.
  logical function stops(slider, drive, from)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    type(braking_t) :: stopping

    stopping = braking(slider, drive, from)
    stops = stopping%falls .and. stopping%acceleration < 0.0_wp
  end function stops
end program test_models
