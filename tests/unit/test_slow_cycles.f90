!> The map of the slow motion and its cycles, and the estimate of a Lyapunov exponent.
program test_slow_cycles
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use checks, only: check, check_close, finish
  use scenes, only: fig3_slider
  use dst_chebyshev, only: chebyshev_coefficients, chebyshev_derivative, chebyshev_points, chebyshev_polynomials
  use dst_divergence, only: divergence_t, regular, irregular, undecided
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_slow_cycles, only: find_slow_cycles
  use dst_slow_map, only: slow_map_t, slow_turn_t, new_slow_map
  implicit none

  call check_slope()
  call check_cycles()
  call check_derivative()
  call check_estimate()
  call finish()

contains

  !> Liouville's formula, compared with a difference.
  subroutine check_slope()
    type(slow_map_t) :: map
    type(slow_turn_t) :: turn, beside(2)
    type(error_t), allocatable :: error
    real(wp), parameter :: push = 1.0e-8_wp
    real(wp) :: from, slope

    call new_slow_map(fig3_slider(3.5_wp), 0.075_wp, 1.0e-12_wp, map)
    from = map%equilibrium - 0.9e-3_wp
    call map%turn(from, turn, error)
    call map%turn(from - push, beside(1), error)
    call map%turn(from + push, beside(2), error)
    slope = (map%equilibrium - from)/(map%equilibrium - turn%to)*exp(turn%log_area)
    call check('a motion comes back', turn%returns .and. .not. allocated(error))
    call check_close('slope of the map', (beside(2)%to - beside(1)%to)/(2.0_wp*push), slope, 1.0e-6_wp)
    call check('the peak lies above the equilibrium', turn%peak > map%equilibrium .and. turn%to < map%equilibrium)
  end subroutine check_slope

  subroutine check_cycles()
    type(slow_map_t) :: map
    type(slow_turn_t), allocatable :: cycles(:)
    type(error_t), allocatable :: error

    call new_slow_map(fig3_slider(3.5_wp), 0.075_wp, 1.0e-12_wp, map)
    call find_slow_cycles(map, cycles, error)
    call check('two cycles beside stable sliding', size(cycles) == 2 .and. map%damping > 0.0_wp)
    if (size(cycles) /= 2) return
    ! From another integration of the same equations, and from AUTO-07p.
    call check_close('stable: valley', cycles(2)%to/2.0e-3_wp, 0.209330198039_wp, 1.0e-11_wp)
    call check_close('stable: peak', cycles(2)%peak/2.0e-3_wp, 1.289672996761_wp, 1.0e-11_wp)
    call check_close('stable: multiplier', exp(cycles(2)%log_area), 0.242084267218_wp, 1.0e-10_wp)
    call check_close('unstable: multiplier', exp(cycles(1)%log_area), 1.032218745172_wp, 1.0e-10_wp)
    call check_close('unstable: period', cycles(1)%rise_time + cycles(1)%fall_time, 0.0993462114055_wp, 1.0e-12_wp)
    call new_slow_map(fig3_slider(4.40_wp), 0.075_wp, 1.0e-12_wp, map)
    call find_slow_cycles(map, cycles, error)
    call check('none beyond the fold', size(cycles) == 0)
    ! A pair between two points of the scan.
    call new_slow_map(fig3_slider(4.3832_wp), 0.075_wp, 1.0e-12_wp, map)
    call find_slow_cycles(map, cycles, error)
    call check('a pair just before the fold', size(cycles) == 2)
  end subroutine check_cycles

  !> The derivative of T_0 + 2 T_1 + 3 T_2 + 4 T_3 is 2 + 12 x + 12 (4 x^2 - 1).
  subroutine check_derivative()
    real(wp), parameter :: coefficient(4) = [1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp], x = 0.3_wp
    real(wp) :: polynomial(4), values(4, 1)

    call chebyshev_polynomials(4, x, polynomial)
    call check_close('derivative', dot_product(polynomial, chebyshev_derivative(coefficient)), &
      2.0_wp + 12.0_wp*x + 12.0_wp*(4.0_wp*x**2 - 1.0_wp), 1.0e-13_wp)
    values(:, 1) = exp(chebyshev_points(4))
    values = chebyshev_coefficients(values)
    call check('of a constant', all(abs(chebyshev_derivative([values(1, 1), 0.0_wp])) <= 0.0_wp))
  end subroutine check_derivative

  !> Growth by given factors.
  subroutine check_estimate()
    type(divergence_t) :: orbit
    real(wp) :: exponent, error
    integer :: i, verdict

    do i = 1, 40
      call orbit%come_back(merge(7.0_wp, 2.0_wp + merge(0.5_wp, -0.5_wp, modulo(i, 2) == 0), i <= 15), .true.)
    end do
    call orbit%estimate(exponent, error, verdict)
    call check_close('the mean of the later half', exponent, 2.0_wp, 1.0e-14_wp)
    call check('irregular', verdict == irregular .and. error < 0.1_wp)
    orbit = divergence_t()
    do i = 1, 40
      call orbit%come_back(merge(7.0_wp, 2.0_wp, modulo(i, 20) == 5), modulo(i, 20) /= 5)
    end do
    call orbit%estimate(exponent, error, verdict)
    call check_close('what is not known does not count', exponent, 2.0_wp, 1.0e-14_wp)
    call check('of the last ones either', ieee_is_nan(orbit%mean_of(20)) .and. abs(orbit%mean_of(8) - 2.0_wp) <= 0.0_wp)
    orbit = divergence_t()
    do i = 1, 10
      call orbit%come_back(-3.0_wp, .true.)
    end do
    call orbit%estimate(exponent, error, verdict)
    call check('regular', verdict == regular .and. abs(exponent + 3.0_wp) <= 1.0e-14_wp)
    orbit = divergence_t()
    do i = 1, 12
      call orbit%come_back(real(modulo(7*i, 12), wp) - 5.5_wp, .true.)
    end do
    call orbit%estimate(exponent, error, verdict)
    call check('undecided', verdict == undecided)
  end subroutine check_estimate
end program test_slow_cycles
