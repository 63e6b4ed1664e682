!> Slow creep: the table of Eq. (8)'s errors, the closed form compared with integrations of Eq. (7) in quadruple precision, limits.
!>
!> Source: Nakano & Popov (2020), Eqs. (6)-(8); the table's values were computed in quadruple precision.
program test_creep
  use checks, only: check, check_close, check_order, finish
  use dst_kinds, only: wp, pi, degree
  use dst_creep, only: creep_t, creep_path_t, new_creep_path, creep_at, creep_exact, creep_asymptotic
  implicit none

  !> Quadruple precision, if the compiler has it.
  integer, parameter :: qp = merge(selected_real_kind(30), wp, selected_real_kind(30) > 0)
  real(wp), parameter :: eps = epsilon(1.0_wp)

  call test_table()
  call test_orders()
  if (qp /= wp) then
    call test_positions_of_the_forms()
    call test_integration()
  else
    print '(a)', 'without quadruple precision: the closed form is not compared with it'
  end if
  call test_stick()
  call test_limits()
  call finish()

contains

  !> Errors of the three forms at tau = 0.5, to every known digit.
  subroutine test_table()
    real(wp), parameter :: phi(6) = [4.0_wp, 2.0_wp, 1.0_wp, 0.5_wp, 0.25_wp, 0.125_wp]*degree
    real(wp), parameter :: first_power(6) = &
      [1.24194e-3_wp, 2.80997e-4_wp, 6.65453e-5_wp, 1.61725e-5_wp, 3.98509e-6_wp, 9.89017e-7_wp]
    real(wp), parameter :: printed(6) = &
      [1.89114e-2_wp, 9.79567e-3_wp, 4.97179e-3_wp, 2.50299e-3_wp, 1.2556e-3_wp, 6.28802e-4_wp]
    real(wp), parameter :: third(6) = &
      [2.36619e-4_wp, 2.96666e-5_wp, 3.7127e-6_wp, 4.64322e-7_wp, 5.80536e-8_wp, 7.25749e-9_wp]
    type(creep_t) :: creep(6), form(6)

    creep = creep_exact(phi, 0.0_wp, 0.5_wp)
    form = creep_asymptotic('first_power', phi, 0.5_wp)
    call check_digits('Eq. (8), first power', abs(form%x_rate - creep%x_rate), first_power)
    form = creep_asymptotic('printed', phi, 0.5_wp)
    call check_digits('Eq. (8) as printed', abs(form%x_rate - creep%x_rate), printed)
    form = creep_asymptotic('third_order', phi, 0.5_wp)
    call check_digits('third order', abs(form%x_rate - creep%x_rate), third)
  end subroutine test_table

  !> Six digits: half a unit of the last one.
  subroutine check_digits(name, actual, expected)
    character(*), intent(in) :: name
    real(wp), intent(in) :: actual(:), expected(:)
    integer :: i

    do i = 1, size(actual)
      call check_close(name, actual(i), expected(i), 0.5_wp*10.0_wp**(floor(log10(expected(i))) - 5)*(1.0_wp + 1.0e-9_wp))
    end do
  end subroutine check_digits

  subroutine test_orders()
    real(wp), parameter :: phi(2) = [0.02_wp, 0.01_wp]*degree, tau(3) = [0.25_wp, 0.5_wp, 0.8_wp]
    type(creep_t) :: creep(2), form(2)
    real(wp) :: error(2)
    integer :: i

    do i = 1, 3
      creep = creep_exact(phi, 0.0_wp, tau(i))
      form = creep_asymptotic('first_power', phi, tau(i))
      error = abs(form%x_rate - creep%x_rate)
      call check_order('first power', error(1), error(2), 2.0_wp, 2.0_wp, 0.05_wp)
      form = creep_asymptotic('printed', phi, tau(i))
      error = abs(form%x_rate - creep%x_rate)
      call check_order('printed', error(1), error(2), 2.0_wp, 1.0_wp, 0.05_wp)
      form = creep_asymptotic('third_order', phi, tau(i))
      error = abs(form%x_rate - creep%x_rate)
      call check_order('third order', error(1), error(2), 2.0_wp, 3.0_wp, 0.05_wp)
    end do
  end subroutine test_orders

  !> The integrals of the three forms over tau to the last digits, compared with quadruple precision: including small tau, where the
  !> terms cancel, and both sides of the point at which a series is used.
  subroutine test_positions_of_the_forms()
    real(wp), parameter :: phi(3) = [1.0e-8_wp, 1.0e-3_wp, 0.1_wp]
    real(wp), parameter :: tau(9) = [1.0e-9_wp, 1.0e-4_wp, 1.0e-2_wp, 0.05_wp, 0.0999_wp, 0.1001_wp, 0.3_wp, 0.7_wp, 0.99_wp]
    type(creep_t) :: form
    real(wp) :: worst(4)
    real(qp) :: angle, t, root, half
    integer :: i, j

    worst = 0.0_wp
    do i = 1, size(phi)
      do j = 1, size(tau)
        angle = real(phi(i), qp)
        t = real(tau(j), qp)
        root = sqrt(1.0_qp - t**2)
        half = 0.5_qp*(asin(t) - t*root)
        form = creep_asymptotic('first_power', phi(i), tau(j))
        worst(1) = max(worst(1), off(form%position, angle*(angle*t + 1.0_qp - root)))
        form = creep_asymptotic('third_order', phi(i), tau(j))
        worst(2) = max(worst(2), off(form%position, angle*(1.0_qp - root) + angle**2*(t + atanh(t) - t/root)))
        form = creep_asymptotic('printed', phi(i), tau(j))
        associate (error => off(form%position, angle*(angle*t + half)))
          if (tau(j) < 0.1_wp) worst(3) = max(worst(3), error)
          worst(4) = max(worst(4), error)
        end associate
      end do
    end do
    call check_close('X/l_x, first power', worst(1), 0.0_wp, 4.0_wp*eps)
    call check_close('X/l_x, third order', worst(2), 0.0_wp, 16.0_wp*eps)
    call check_close('X/l_x as printed, small tau', worst(3), 0.0_wp, 4.0_wp*eps)
    call check_close('X/l_x as printed', worst(4), 0.0_wp, 200.0_wp*eps)
  end subroutine test_positions_of_the_forms

  !> Eq. (7) and dX/d(tau) integrated with order 20 in quadruple precision, compared with the closed form: from 1e-6 to 89 degrees,
  !> from release (of the rigid stiff axis 1e-9 of its turn after it) to where 1 - X'/V = 1e-14.
  subroutine test_integration()
    real(wp), parameter :: angle(8) = [1.0e-6_wp, 1.0e-3_wp, 0.1_wp, 1.0_wp, 10.0_wp, 45.0_wp, 60.0_wp, 89.0_wp]
    real(wp), parameter :: kappa(5) = [0.0_wp, 1.0e-12_wp, 1.0e-4_wp, 1.0e-2_wp, 0.6_wp]
    real(wp) :: worst(7)
    integer :: i, j, points

    points = 0
    do i = 1, size(angle)
      do j = 1, size(kappa)
        call follow(angle(i)*degree, kappa(j), worst, points)
        call check_close('alpha by integration', worst(1), 0.0_wp, 1.0e-14_wp)
        call check_close('psi by integration', worst(2), 0.0_wp, 1.0e-13_wp)
        call check_close("X'/V by integration", worst(3), 0.0_wp, 1.0e-14_wp)
        call check_close("Y'/V by integration", worst(4), 0.0_wp, 1.0e-13_wp)
        call check_close("1 - X'/V by integration", worst(5), 0.0_wp, 1.0e-13_wp)
        call check_close('X by quadrature', worst(6), 0.0_wp, 1.0e-14_wp)
        call check_close('v/V by integration', worst(7), 0.0_wp, 1.0e-14_wp)
      end do
    end do
    call check('points of the integration', points > 1500)
  end subroutine test_integration

  !> The largest relative errors of the closed form at doubles tau along one integration. The unknown is psi, because
  !> alpha + phi = pi/2 - psi loses its digits at the end.
  subroutine follow(phi, kappa, worst, points)
    real(wp), intent(in) :: phi, kappa
    real(wp), intent(out) :: worst(7)
    integer, intent(inout) :: points
    type(creep_path_t) :: path
    type(creep_t) :: creep
    real(qp) :: state(2), now, next, phi_q, kappa_q, s, c, r, longest, rest(2), reach

    path = new_creep_path(phi, kappa)
    phi_q = real(phi, qp)
    kappa_q = real(kappa, qp)
    s = sin(phi_q)
    c = cos(phi_q)
    r = hypot(kappa_q*c, s)
    now = kappa_q/r
    state = [atan2((1.0_qp - kappa_q)*s*c/r, (kappa_q*c**2 + s**2)/r), 0.0_qp]
    ! at the end the digits of tau that count are those of s^2 + kappa
    longest = merge(0.05_qp, 0.1_qp, s**2 + kappa_q < 1.0e-12_qp)
    worst = 0.0_wp
    ! With a finite stiffness X is a small difference at first.
    reach = merge(0.5_qp, 1.0e-9_qp, kappa > 0.0_wp)
    do
      next = real(nearest(real(now + reach*width(phi_q, kappa_q, state(1)), wp), 1.0_wp), qp)
      reach = min(0.5_qp, 10.0_qp*reach)
      do while (now < next .and. state(1) > 1.0e-28_qp)
        r = min(next - now, longest*width(phi_q, kappa_q, state(1)))
        call extrapolate(phi_q, kappa_q, r, state)
        now = now + r
      end do
      rest = rate(phi_q, kappa_q, state)
      if (1.0_qp - rest(2) < 1.0e-14_qp) exit
      creep = creep_at(path, real(next, wp))
      points = points + 1
      worst = max(worst, [off(creep%alpha, 0.5_qp*acos(-1.0_qp) - phi_q - state(1)), off(creep%psi, state(1)), &
        off(creep%x_rate, rest(2)), off(creep%y_rate, rest(2)*tan(state(1))), off(creep%deficit, 1.0_qp - rest(2)), &
        off(creep%position, state(2)), off(creep%speed, rest(2)/cos(state(1)))])
    end do
  end subroutine follow

  !> d(psi)/d(tau) from Eq. (7) and its extension to a finite stiffness along the stiff axis, and X'/V = 1 - (u_x' cos(phi) + u_y'
  !> sin(phi))/V, directly from Eq. (6).
  pure function rate(phi, kappa, state)
    real(qp), intent(in) :: phi, kappa, state(2)
    real(qp) :: rate(2)

    associate (theta => phi + state(1))
      rate(1) = -sin(state(1))/width(phi, kappa, state(1))
      rate(2) = 1.0_qp + rate(1)*(sin(theta)*cos(phi) - kappa*cos(theta)*sin(phi))
    end associate
  end function rate

  !> cos^2(alpha) + kappa sin^2(alpha), approximately the tau in which friction turns.
  pure real(qp) function width(phi, kappa, psi)
    real(qp), intent(in) :: phi, kappa, psi

    width = sin(phi + psi)**2 + kappa*cos(phi + psi)**2
  end function width

  !> One step of Gragg, Bulirsch and Stoer with 10 columns, order 20.
  subroutine extrapolate(phi, kappa, h, state)
    real(qp), intent(in) :: phi, kappa, h
    real(qp), intent(inout) :: state(2)
    integer, parameter :: columns = 10
    real(qp) :: table(2, columns), before(2), here(2), after(2), ratio
    integer :: i, j, n

    do i = 1, columns
      n = 2*i
      before = state
      here = state + h/n*rate(phi, kappa, state)
      do j = 2, n
        after = before + 2.0_qp*h/n*rate(phi, kappa, here)
        before = here
        here = after
      end do
      table(:, i) = 0.5_qp*(here + before + h/n*rate(phi, kappa, here))
      do j = i - 1, 1, -1
        ratio = (real(i, qp)/real(j, qp))**2
        table(:, j) = table(:, j + 1) + (table(:, j + 1) - table(:, j))/(ratio - 1.0_qp)
      end do
    end do
    state = table(:, 1)
  end subroutine extrapolate

  pure real(wp) function off(actual, expected)
    real(wp), intent(in) :: actual
    real(qp), intent(in) :: expected

    off = real(abs(actual/expected - 1.0_qp), wp)
  end function off

  !> With a finite k_y nothing moves until |K u| = F_0; then creep starts from the direction of K u.
  subroutine test_stick()
    type(creep_path_t) :: path
    type(creep_t) :: before, after
    real(wp) :: u(2)

    path = new_creep_path(5.0_wp*degree, 0.3_wp)
    u = path%tau_1*[path%c, path%s]
    call check_close('release at |K u| = F_0', hypot(u(1), u(2)/0.3_wp), 1.0_wp, 4.0_wp*eps)
    before = creep_at(path, path%tau_1*(1.0_wp - 1.0e-9_wp))
    after = creep_at(path, path%tau_1*(1.0_wp + 1.0e-9_wp))
    call check('at rest before', before%speed <= 0.0_wp .and. before%position <= 0.0_wp .and. before%deficit >= 1.0_wp)
    call check_close('direction of K u', before%alpha, atan2(u(1), u(2)/0.3_wp), 4.0_wp*eps)
    call check_close('continuous direction', after%alpha, before%alpha, 1.0e-8_wp)
    call check('moves after', after%speed > 0.1_wp)
    after = creep_exact(5.0_wp*degree, 0.0_wp, 0.0_wp)
    call check_close('rigid across: slides sideways from the start', after%speed, sin(5.0_wp*degree), eps)
  end subroutine test_stick

  subroutine test_limits()
    type(creep_t) :: creep, other
    real(wp), parameter :: tau(5) = [1.0e-300_wp, 1.0e-8_wp, 0.3_wp, 0.9_wp, 0.999999_wp]
    real(wp), parameter :: misalignment(3) = [1.0e-10_wp, 0.02_wp, 1.5_wp]
    real(wp) :: phi
    integer :: i, j

    do i = 1, size(tau)
      creep = creep_exact(0.0_wp, 0.0_wp, tau(i))
      call check_close('phi = 0: sin(alpha) = tau', creep%alpha, asin(tau(i)), 8.0_wp*eps*creep%alpha/(1.0_wp - tau(i)))
      call check('phi = 0: no motion', abs(creep%x_rate) + creep%speed + creep%position <= 0.0_wp)
    end do
    creep = creep_exact(degree, 0.0_wp, 1.0e6_wp)
    call check_close('late: friction along the drive', creep%psi, 0.0_wp, 0.0_wp)
    call check_close('late: theta = phi', 0.5_wp*pi - creep%alpha, degree, 2.0_wp*eps)
    call check_close("late: X' = V", creep%x_rate, 1.0_wp, 2.0_wp*eps)
    do j = 1, size(misalignment)
      phi = misalignment(j)
      other = creep_exact(phi, 0.0_wp, 0.0_wp)
      do i = 1, 4000
        creep = creep_exact(phi, 0.0_wp, 5.0e-4_wp*i)
        if (creep%x_rate < other%x_rate*(1.0_wp - 4.0_wp*eps) .or. abs(creep%x_rate + creep%deficit - 1.0_wp) > 8.0_wp*eps) exit
        other = creep
      end do
      call check("X' rises, and 1 - X'/V is what its name says", i == 4001)
    end do
    creep = creep_exact(30.0_wp*degree, 0.3_wp, 600.0_wp)
    other = creep_exact(30.0_wp*degree, 0.3_wp, 400.0_wp)
    call check_close('X when saturated, finite k_y', creep%position - other%position, 200.0_wp, 1.0e-12_wp)
    creep = creep_exact(1.0e-8_wp, 0.0_wp, huge(1.0_wp))
    call check('the largest tau', creep%x_rate >= 1.0_wp .and. creep%position >= huge(1.0_wp)*(1.0_wp - eps))
    do i = -3, 3
      creep = creep_exact(1.0e-200_wp, 0.0_wp, 1.0_wp + i*eps)
      call check_close('the smallest phi', creep%x_rate, merge(1.0_wp, 0.0_wp, i > 0), 1.0e-90_wp)
      call check('the smallest phi: X', creep%position >= 0.0_wp .and. creep%position < 1.0e-15_wp)
    end do
    ! From tau = 1 + s + 1000 s^2 on the motion counts as saturated: there is no jump there.
    creep = creep_exact(degree, 0.0_wp, 1.0_wp + sin(degree) + 999.0_wp*sin(degree)**2)
    call check_close('X when saturated', creep%position, 999.0_wp*sin(degree)**2 + sin(degree) + sin(degree)**2, 4.0_wp*eps)
    creep = creep_exact(degree, 0.0_wp, 1.0_wp + sin(degree) + 1001.0_wp*sin(degree)**2)
    call check_close('X when saturated', creep%position, 1001.0_wp*sin(degree)**2 + sin(degree) + sin(degree)**2, 4.0_wp*eps)
    creep = creep_exact(degree, 1.0e-9_wp, 0.7_wp)
    other = creep_exact(degree, 0.0_wp, 0.7_wp)
    call check_close('kappa to 0', creep%x_rate, other%x_rate, 1.0e-8_wp)
    creep = creep_exact(degree, 0.0_wp, 0.5_wp)
    call check_close("Eq. (6): Y' = -w_x s + w_y c", creep%y_rate, &
      creep%speed*(-cos(0.5_wp*pi - creep%alpha)*sin(degree) + sin(0.5_wp*pi - creep%alpha)*cos(degree)), 4.0_wp*eps)
  end subroutine test_limits
end program test_creep
