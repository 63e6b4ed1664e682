!> Radau IIA, compared with its defining conditions; interpolation and zeros of polynomials.
!>
!> Source of the conditions B, C, D: Hairer & Wanner, Solving Ordinary Differential Equations II, Sec. IV.5.
program test_collocation
  use checks, only: check, check_close, finish
  use random_numbers, only: start_random, uniform
  use dst_kinds, only: wp
  use dst_bernstein, only: first_zero, sign_changes, bernstein_value
  use dst_collocation, only: collocation_t, radau_iia
  implicit none

  interface
    !> LAPACK: eigenvalues of a general matrix.
    subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
      import :: wp
      character, intent(in) :: jobvl, jobvr
      integer, intent(in) :: n, lda, ldvl, ldvr, lwork
      integer, intent(out) :: info
      real(wp), intent(inout) :: a(lda, *)
      real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)
    end subroutine dgeev
  end interface

  real(wp), parameter :: eps = epsilon(1.0_wp), none = 2.0_wp
  integer, parameter :: stage_counts(4) = [1, 3, 5, 7]
  integer :: k

  call start_random(1)
  do k = 1, size(stage_counts)
    call test_conditions(radau_iia(stage_counts(k)))
    call test_real_pole(radau_iia(stage_counts(k)))
    call test_interpolation(radau_iia(stage_counts(k)))
  end do
  call test_sign_changes()
  call test_tangents()
  call test_zeros_of_coefficients()
  call test_random_polynomials()
  call finish()

contains

  !> B(2s-1), C(s), D(s-1), stiff accuracy, and that the method is not of order 2s.
  subroutine test_conditions(method)
    type(collocation_t), intent(in) :: method
    character(12) :: name
    real(wp) :: worst, identity(method%stages, method%stages)
    integer :: i, j, q

    write (name, '(i0, a)') method%stages, ' stages: '
    associate (s => method%stages, b => method%weight(1:method%stages), c => method%grid%node(1:method%stages), &
        a => method%integral(1:method%stages, 1:method%stages))
      call check(name//'order', method%order == 2*s - 1)
      call check(name//'first node', abs(method%grid%node(0)) <= 0.0_wp)
      call check_close(name//'last node', c(s), 1.0_wp, 0.0_wp)
      call check(name//'nodes ascend', all(method%grid%node(1:s) > method%grid%node(0:s - 1)))
      call check(name//'weights are positive', all(b > 0.0_wp))
      call check_close(name//'stiffly accurate', maxval(abs(a(s, :) - b)), 0.0_wp, 4.0_wp*eps)
      worst = maxval([(abs(dot_product(b, c**(q - 1)) - 1.0_wp/real(q, wp)), q=1, 2*s - 1)])
      call check_close(name//'B(2s-1)', worst, 0.0_wp, 8.0_wp*eps)
      call check(name//'not B(2s)', abs(dot_product(b, c**(2*s - 1)) - 0.5_wp/real(s, wp)) > 1.0e-8_wp)
      worst = maxval([((abs(dot_product(a(i, :), c**(q - 1)) - c(i)**q/real(q, wp)), q=1, s), i=1, s)])
      call check_close(name//'C(s)', worst, 0.0_wp, 8.0_wp*eps)
      worst = maxval([((abs(dot_product(b*c**(q - 1), a(:, j)) - b(j)*(1.0_wp - c(j)**q)/real(q, wp)), q=1, s - 1), j=1, s), &
        0.0_wp])
      call check_close(name//'D(s-1)', worst, 0.0_wp, 8.0_wp*eps)
      identity = matmul(a, method%grid%derivative(1:s, 1:s))
      do i = 1, s
        identity(i, i) = identity(i, i) - 1.0_wp
      end do
      call check_close(name//'A and the derivative matrix are inverse', maxval(abs(identity)), 0.0_wp, 100.0_wp*eps)
    end associate
  end subroutine test_conditions

  !> gamma is the only real eigenvalue of A.
  subroutine test_real_pole(method)
    type(collocation_t), intent(in) :: method
    real(wp) :: a(method%stages, method%stages), re(method%stages), im(method%stages), unused(1, 1), unused_too(1, 1), work(100)
    real(wp), allocatable :: real_ones(:)
    integer :: info

    a = method%integral(1:method%stages, 1:method%stages)
    call dgeev('N', 'N', method%stages, a, method%stages, re, im, unused, 1, unused_too, 1, work, &
      size(work), info)
    allocate (real_ones(count(abs(im) <= 1.0e-12_wp)))
    real_ones = pack(re, abs(im) <= 1.0e-12_wp)
    call check('real pole: one real eigenvalue', info == 0 .and. size(real_ones) == 1)
    call check_close('real pole', method%gamma, real_ones(1), 20.0_wp*eps)
  end subroutine test_real_pole

  !> A polynomial of full degree is reproduced, with its derivative at the nodes, inside and outside [0, 1].
  subroutine test_interpolation(method)
    type(collocation_t), intent(in) :: method
    real(wp) :: monomial(0:method%stages), values(0:method%stages), basis(0:method%stages), bernstein(0:7)
    real(wp) :: tau, slope, nodal(0:7), places(3), found(3)
    integer :: i, trial
    logical :: agrees, unit_sum, differentiates, converts, extrapolates

    associate (grid => method%grid, s => method%stages)
      agrees = .true.
      unit_sum = .true.
      differentiates = .true.
      converts = .true.
      extrapolates = .true.
      do trial = 1, 50
        monomial = uniform(s + 1, -1.0_wp, 1.0_wp)
        values = [(polynomial(monomial, grid%node(i)), i=0, s)]
        tau = minval(uniform(1, -0.5_wp, 2.0_wp))
        call grid%lagrange(tau, basis)
        agrees = agrees .and. near(dot_product(basis, values), polynomial(monomial, tau), sum(abs(basis)))
        unit_sum = unit_sum .and. near(sum(basis), 1.0_wp, sum(abs(basis)))
        ! In Newton's form, at several places at once.
        nodal = 0.0_wp
        nodal(:s) = values
        places = [tau, 0.5_wp, 1.5_wp]
        call grid%values_at(nodal, 3, places, found)
        do i = 1, 3
          call grid%lagrange(places(i), basis)
          extrapolates = extrapolates .and. near(found(i), polynomial(monomial, places(i)), sum(abs(basis)))
        end do
        do i = 0, s
          slope = dot_product(grid%derivative(i, 0:s), values)
          differentiates = differentiates .and. near(slope, derivative(monomial, grid%node(i)), sum(abs(grid%derivative(i, 0:s))))
        end do
        call grid%bernstein_coefficients(nodal, bernstein)
        tau = minval(uniform(1, 0.0_wp, 1.0_wp))
        converts = converts .and. near(bernstein_value(s, bernstein(:s), tau), polynomial(monomial, tau), sum(abs(monomial)))
      end do
      call check('interpolation agrees', agrees)
      call check('interpolation: the basis sums to 1', unit_sum)
      call check('interpolation: the first guess is the polynomial too', extrapolates)
      call check('differentiation agrees', differentiates)
      call check('Bernstein coefficients agree', converts)
      call grid%lagrange(grid%node(s), basis)
      call check_close('the last basis polynomial is 1 at the end', basis(s), 1.0_wp, 100.0_wp*eps)
      call check('the others vanish at the end', all(abs(basis(0:s - 1)) <= 0.0_wp))
    end associate
  end subroutine test_interpolation

  !> Equal within roundoff of numbers up to `scale`.
  pure logical function near(actual, expected, scale)
    real(wp), intent(in) :: actual, expected, scale

    near = abs(actual - expected) <= 64.0_wp*eps*max(scale, 1.0_wp)
  end function near

  pure real(wp) function polynomial(monomial, x)
    real(wp), intent(in) :: monomial(0:), x
    integer :: i

    polynomial = 0.0_wp
    do i = ubound(monomial, 1), 0, -1
      polynomial = polynomial*x + monomial(i)
    end do
  end function polynomial

  pure real(wp) function derivative(monomial, x)
    real(wp), intent(in) :: monomial(0:), x
    integer :: i

    derivative = polynomial([(real(i, wp)*monomial(i), i=1, ubound(monomial, 1)), 0.0_wp], x)
  end function derivative

  !> Bernstein coefficients of sign*product(x - zeros), computed as in the integrators: from nodal values.
  pure function with_zeros(stages, zeros, sign) result(coefficient)
    integer, intent(in) :: stages
    real(wp), intent(in) :: zeros(:), sign
    real(wp) :: coefficient(0:stages)
    type(collocation_t) :: method
    real(wp) :: values(0:7), padded(0:7)
    integer :: i

    method = radau_iia(stages)
    values = 0.0_wp
    do i = 0, stages
      values(i) = sign*product(method%grid%node(i) - zeros)
    end do
    call method%grid%bernstein_coefficients(values, padded)
    coefficient = padded(:stages)
  end function with_zeros

  !> A dip that just reaches below zero is found, and none is found that just does not.
  subroutine test_tangents()
    real(wp), parameter :: depth(4) = [1.0e-3_wp, 1.0e-6_wp, 1.0e-9_wp, 1.0e-13_wp]
    real(wp), parameter :: bottom(5) = [0.03_wp, 0.25_wp, 0.5_wp, 0.7123_wp, 0.97_wp]
    real(wp) :: found, width, coefficient(0:7)
    integer :: i, j, s

    do s = 3, 7, 2
      do j = 1, size(bottom)
        do i = 1, size(depth)
          ! (x - bottom)^2 - depth.
          width = sqrt(depth(i))
          coefficient(0:s) = with_zeros(s, [bottom(j) - width, bottom(j) + width], 1.0_wp)
          found = first_zero(coefficient(0:s))
          if (bottom(j) > width) call check_close('a dip just below zero', found, bottom(j) - width, 2.0e-14_wp/width)
          ! (x - bottom)^2 + depth: the Bernstein coefficients of a constant are that constant.
          coefficient(0:s) = coefficient(0:s) + 2.0_wp*depth(i)
          call check_close('a dip just above zero', first_zero(coefficient(0:s)), none, 0.0_wp)
        end do
        ! Roundoff decides whether it touches; the search must end, and not return another place.
        found = first_zero(with_zeros(s, [bottom(j), bottom(j)], 1.0_wp))
        call check('a dip to zero', found > 1.0_wp .or. abs(found - bottom(j)) <= 1.0e-7_wp)
      end do
    end do
  end subroutine test_tangents

  !> Cases made of coefficients directly, without roundoff.
  subroutine test_zeros_of_coefficients()
    call check_close('zero at the end', first_zero([1.0_wp, 0.5_wp, 0.0_wp]), 1.0_wp, 0.0_wp)
    call check_close('zero at the end, touching', first_zero([1.0_wp, 0.0_wp, 0.0_wp]), 1.0_wp, 1.0e-7_wp)
    call check_close('zero at the end, from below the chord', first_zero([1.0_wp, 2.0_wp, 0.0_wp]), 1.0_wp, 0.0_wp)
    call check_close('just above zero at the end', first_zero([1.0_wp, 0.5_wp, tiny(1.0_wp)]), none, 0.0_wp)
    call check_close('a straight line', first_zero([0.25_wp, -0.75_wp]), 0.25_wp, eps)
    call check_close('from zero upwards', first_zero([0.0_wp, 1.0_wp, 2.0_wp]), none, 0.0_wp)
    call check('from zero downwards', first_zero([0.0_wp, -1.0_wp, -2.0_wp]) <= 1.0e-15_wp)
    call check('from below upwards: the start counts as positive', first_zero([-1.0e-20_wp, 1.0_wp, 2.0_wp]) >= none)
    ! The scale of the values does not matter.
    call check_close('tiny values', first_zero(1.0e-200_wp*[0.25_wp, -0.75_wp]), 0.25_wp, eps)
    call check_close('huge values', first_zero(1.0e200_wp*[0.25_wp, -0.75_wp]), 0.25_wp, eps)
  end subroutine test_zeros_of_coefficients

  !> Compared with dense sampling: nothing is below zero before the zero, and the zero is one.
  subroutine test_random_polynomials()
    integer, parameter :: trials = 4000, samples = 400
    real(wp) :: coefficient(0:7), found, x
    logical :: none_missed, is_zero, none_invented
    integer :: trial, i, s, first

    none_missed = .true.
    is_zero = .true.
    none_invented = .true.
    do trial = 1, trials
      s = 3 + 2*modulo(trial, 3)
      coefficient(0:s) = uniform(s + 1, -1.0_wp, 1.0_wp)
      coefficient(0) = abs(coefficient(0))
      ! Every other one is lifted so that it nearly touches.
      if (modulo(trial, 2) == 0) coefficient(0:s) = coefficient(0:s) - minimum(s, coefficient(0:s), samples) &
        + 1.0e-4_wp*sum(uniform(1, -1.0_wp, 1.0_wp))
      if (coefficient(0) <= 0.0_wp) cycle
      found = first_zero(coefficient(0:s))
      first = samples + 1
      do i = samples, 1, -1
        if (bernstein_value(s, coefficient(0:s), real(i, wp)/real(samples, wp)) < 0.0_wp) first = i
      end do
      x = real(first, wp)/real(samples, wp)
      if (first <= samples) none_missed = none_missed .and. found <= x
      if (found <= 1.0_wp) then
        is_zero = is_zero .and. abs(bernstein_value(s, coefficient(0:s), found)) <= 8.0_wp*eps
      else
        none_invented = none_invented .and. first > samples
      end if
    end do
    call check('random polynomials: no zero is missed', none_missed)
    call check('random polynomials: what is found is a zero', is_zero)
    call check('random polynomials: none means none', none_invented)
  end subroutine test_random_polynomials

  !> Between the changes of sign that are found the polynomial has one sign, and alternates from one to the next.
  subroutine test_sign_changes()
    integer, parameter :: trials = 4000, samples = 400
    real(wp) :: coefficient(0:7), position(7), x, value, largest
    logical :: complete, in_order
    integer :: trial, i, s, n

    call sign_changes(7, with_zeros(7, [0.1_wp, 0.3_wp, 0.30001_wp, 0.5_wp, 0.6_wp, 0.95_wp, 1.2_wp], 1.0_wp), position, n)
    call check('all changes of sign', n == 6)
    if (n == 6) call check_close('their positions', maxval(abs(position(:6) - &
      [0.1_wp, 0.3_wp, 0.30001_wp, 0.5_wp, 0.6_wp, 0.95_wp])), 0.0_wp, 1.0e-7_wp)
    call sign_changes(3, with_zeros(3, [0.0_wp, 0.5_wp, 1.0_wp], 1.0_wp), position, n)
    call check('the ends are none', n >= 1 .and. any(abs(position(:n) - 0.5_wp) < 1.0e-12_wp) .and. &
      all(abs(position(:n) - 0.5_wp) < 1.0e-12_wp .or. min(position(:n), 1.0_wp - position(:n)) < 1.0e-12_wp))
    call sign_changes(2, [1.0_wp, -0.5_wp, 0.25_wp], position, n)
    call check('a double zero is none', n == 0 .or. n == 2)
    call sign_changes(2, [0.0_wp, 0.0_wp, 0.0_wp], position, n)
    call check('zero everywhere has none', n == 0)
    complete = .true.
    in_order = .true.
    do trial = 1, trials
      s = 1 + modulo(trial, 7)
      coefficient(0:s) = uniform(s + 1, -1.0_wp, 1.0_wp)
      call sign_changes(s, coefficient(0:s), position, n)
      in_order = in_order .and. all(position(2:n) >= position(:n - 1))
      largest = maxval(abs(coefficient(0:s)))
      do i = 0, samples
        x = real(i, wp)/real(samples, wp)
        value = bernstein_value(s, coefficient(0:s), x)*sign(1.0_wp, coefficient(0))*(-1.0_wp)**count(position(:n) < x)
        complete = complete .and. value >= -1.0e-9_wp*largest
      end do
    end do
    call check('changes of sign are in order', in_order)
    call check('no change of sign is missed or invented', complete)
  end subroutine test_sign_changes

  !> Smallest value at equidistant points.
  pure real(wp) function minimum(s, coefficient, samples)
    integer, intent(in) :: s, samples
    real(wp), intent(in) :: coefficient(0:s)
    integer :: i

    minimum = minval([(bernstein_value(s, coefficient, real(i, wp)/real(samples, wp)), i=0, samples)])
  end function minimum
end program test_collocation
