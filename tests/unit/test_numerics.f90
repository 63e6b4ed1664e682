!> Small procedures of the numerics: the step-size control, bracketed roots, exponentials, the coefficients of RODAS4P.
program test_numerics
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
  use checks, only: check, check_close, check_order, finish
  use dst_exponentials, only: exponentials
  use dst_kinds, only: wp
  use dst_rodas4p, only: stages, order, gamma, a, c
  use dst_roots, only: bracket_t
  use dst_step_control, only: step_control_t, new_step_control, factor_for, shortened
  implicit none

  call check_control()
  call check_brackets()
  call check_exponentials()
  call check_order('RODAS4P', rodas_error(0.02_wp), rodas_error(0.01_wp), 2.0_wp, real(order + 1, wp), 0.3_wp)
  call finish()

contains

  subroutine check_control()
    type(step_control_t) :: plain, predicting, remembering
    real(wp) :: factor, other, error

    plain = new_step_control(4, 5.0_wp)
    predicting = new_step_control(4, 5.0_wp, predicts=.true.)
    remembering = new_step_control(4, 5.0_wp, memory=0.04_wp)
    call check_close('sixteen times the error halves the step', factor_of(plain, 16.0_wp), 0.45_wp, 1.0e-14_wp)
    call check_close('the factor is bounded above', factor_of(plain, 0.0_wp), 5.0_wp, 1.0e-14_wp)
    call check_close('and below', factor_of(plain, 1.0e30_wp), 0.2_wp, 1.0e-14_wp)
    error = ieee_value(error, ieee_positive_inf)
    call plain%advise(1.0_wp, .false., error, factor)
    call check('what is no number becomes a large error', error > 1.0_wp .and. error < 1.0e10_wp .and. factor < 0.3_wp)
    error = 1.0e-3_wp
    call plain%advise(1.0_wp, .true., error, factor)
    call check_close('no growth after a rejection', factor, 1.0_wp, 1.0e-14_wp)
    ! The error has grown sixteenfold since the last step: the same is expected for the next one.
    error = 0.5_wp/16.0_wp
    call predicting%advise(1.0_wp, .false., error, factor)
    call predicting%accept(1.0_wp)
    error = 0.5_wp
    call predicting%advise(1.0_wp, .false., error, other)
    call check_close('prediction', other, 0.5_wp*factor_of(plain, 0.5_wp), 1.0e-14_wp)
    call predicting%restart()
    call check_close('a restart forgets', factor_of(predicting, 0.5_wp), factor_of(plain, 0.5_wp), 1.0e-14_wp)
    error = 1.0_wp
    call remembering%advise(1.0_wp, .false., error, factor)
    call remembering%accept(1.0_wp)
    call check_close('memory', factor_of(remembering, 0.5_wp), 0.9_wp*0.5_wp**(0.03_wp - 0.25_wp), 1.0e-14_wp)
    call check_close('from the error alone', factor_for(128.0_wp, 7), 0.45_wp, 1.0e-14_wp)
    call check_close('to what is allowed', shortened(1.0_wp, 2.0_wp), 0.45_wp, 1.0e-14_wp)
  end subroutine check_control

  real(wp) function factor_of(control, of_error) result(factor)
    type(step_control_t), intent(in) :: control
    real(wp), intent(in) :: of_error
    type(step_control_t) :: own
    real(wp) :: error

    own = control
    error = of_error
    call own%advise(1.0_wp, .false., error, factor)
  end function factor_of

  !> In the whole range of normal numbers, close to 0, and below.
  subroutine check_exponentials()
    integer, parameter :: n = 100000
    real(wp) :: x(n), values(n), exact(n)
    integer :: i

    do i = 1, n
      x(i) = -708.0_wp*(real(i - 1, wp)/real(n - 1, wp))**3
    end do
    call exponentials(n, x, values)
    exact = exp(x)
    ! The compiler's own function may have a larger error in its vectors.
    call check_close('exponentials', maxval(abs(values - exact)/spacing(exact)), 0.0_wp, 4.0_wp)
    call check('exp(0) = 1', .not. abs(values(1) - 1.0_wp) > 0.0_wp)
    call exponentials(3, [-1.0e4_wp, -huge(1.0_wp), -tiny(1.0_wp)], values(:3))
    call check('exponentials of large numbers', all(values(:2) > 0.0_wp .and. values(:2) < 1.0e-300_wp))
    call check('exponentials of small numbers', .not. abs(values(3) - 1.0_wp) > 0.0_wp)
  end subroutine check_exponentials

  !> cos has its zero at pi/2; both orientations, and both rules.
  subroutine check_brackets()
    type(bracket_t) :: bracket
    real(wp) :: x, side
    integer :: i, sign_of_f

    do sign_of_f = -1, 1, 2
      side = real(sign_of_f, wp)
      bracket = bracket_t([0.0_wp, 3.0_wp], side*[1.0_wp, cos(3.0_wp)])
      do i = 1, 12
        x = bracket%false_position()
        call bracket%narrow(x, side*cos(x))
        if (abs(cos(x)) < 1.0e-15_wp) exit
      end do
      call check_close('false position', x, acos(0.0_wp), 1.0e-14_wp)
      call check('the zero stays inside', bracket%width() >= 0.0_wp .and. bracket%f(1)*bracket%f(2) <= 0.0_wp)
    end do
    ! Without Illinois' rule one end never changes, and 30 false positions leave an error of 0.1.
    bracket = bracket_t([0.0_wp, 2.0_wp], [0.0_wp, 2.0_wp]**9 - 1.0_wp)
    do i = 1, 30
      x = bracket%false_position()
      call bracket%narrow(x, x**9 - 1.0_wp)
      if (abs(x**9 - 1.0_wp) < 1.0e-14_wp) exit
    end do
    call check_close('a convex function', x, 1.0_wp, 1.0e-13_wp)
    bracket = bracket_t([0.0_wp, 3.0_wp], [-1.0_wp, 1.0_wp])
    call check_close('Newton inside', bracket%newton(1.0_wp, -1.0_wp, 1.0_wp), 2.0_wp, 1.0e-15_wp)
    call check_close('Newton outside', bracket%newton(1.0_wp, -5.0_wp, 1.0_wp), 1.5_wp, 1.0e-15_wp)
    call check_close('Newton where it falls', bracket%newton(1.0_wp, -1.0_wp, -1.0_wp), 1.5_wp, 1.0e-15_wp)
  end subroutine check_brackets

  !> Error of one step of z' = -z**2 from 1, whose solution is 1/(1 + t).
  real(wp) function rodas_error(h) result(error)
    real(wp), intent(in) :: h
    real(wp) :: k(stages), z
    integer :: i

    do i = 1, stages
      z = 1.0_wp + dot_product(a(i, :i - 1), k(:i - 1))
      k(i) = (-z**2 + dot_product(c(i, :i - 1), k(:i - 1))/h)/(1.0_wp/(gamma*h) + 2.0_wp)
    end do
    error = abs(z + k(stages) - 1.0_wp/(1.0_wp + h))
  end function rodas_error
end program test_numerics
