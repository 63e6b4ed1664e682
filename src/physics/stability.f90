!> Linear theory of steady sliding.
!>
!> A perturbation u of sliding with the constant velocity V along s = (cos phi, sin phi) obeys
!>
!>     m u'' + D u' + K u = 0,     D = alpha s s^T + beta n n^T,     alpha = F'(V),  beta = F(V)/V,
!>
!> n normal to s (F v/sqrt(v^2 + v_s^2) for F on the smoothed contact); dampers C parallel to the springs add to D. Routh's
!> criterion is quadratic in sin^2(phi), and without dampers docs/theory_stability.md derives the critical angles from it. The
!> damping ratio of the slow motion at any direction of friction is Eq. (10) of Nakano & Popov (2020). SI units, angles in radians.
module dst_stability
  use dst_eigenvalues, only: find_eigenvalues
  use dst_kinds, only: wp, pi
  use dst_errors, only: error_t, raise, usage_error
  use dst_slider, only: slider_t
  use dst_text, only: short_text
  implicit none
  private

  public :: critical_t, low_branch, fast_branch
  public :: steady_sliding_eigenvalues, critical_misalignment, low_frequency_limit, is_stable
  public :: damping_scale, overdamped_angle, damping_ratio, weakening_damping_ratio

  !> Branches of the critical angle: the slow mode, and the fast one.
  integer, parameter :: low_branch = 1, fast_branch = 2

  !> The angles in 0 < phi < pi/2 at which the largest real part of the eigenvalues crosses zero. There are two such
  !> angles, one for each branch, or none; with dampers there may be one.
  type :: critical_t
    logical :: exists = .false.
    !> Whether each branch has an angle: with dampers one branch may have one and the other none.
    logical :: has(2) = .false.
    real(wp) :: angle(2) = 0.0_wp        !! of the low-frequency and of the fast branch, rad
    real(wp) :: frequency(2) = 0.0_wp    !! of the oscillation there, rad/s
    !> Steady sliding is stable between these angles [rad]; they are equal if it is stable at none.
    real(wp) :: window(2) = 0.0_wp
  end type critical_t

  !> A slider as its perturbations see it: masses and springs, alpha and beta, and the dampers. SI units.
  type :: perturbed_t
    real(wp) :: mass, stiffness(2)
    real(wp) :: alpha, beta, damping(2)
  end type perturbed_t

  character(*), parameter :: beyond = 'beyond the range of the numbers: bring the mass, the stiffnesses, the friction and the '// &
    'velocity nearer to each other'

contains

  !> The four eigenvalues [1/s], by falling real part; of a conjugate pair the positive imaginary part comes first.
  subroutine steady_sliding_eigenvalues(slider, velocity, eigenvalues, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s, not 0
    complex(wp), intent(out) :: eigenvalues(4)
    type(error_t), allocatable, intent(out) :: error
    type(perturbed_t) :: own
    complex(wp) :: unsorted(4)
    real(wp) :: normal(2), frequency(2), matrix(4, 4), real_part(4)
    logical :: found
    integer :: i, j

    eigenvalues = (0.0_wp, 0.0_wp)
    call perturb(slider, velocity, own, error)
    if (allocated(error)) return
    ! Unknowns sqrt(k) u and sqrt(m) u': the elastic part is skew and the friction part symmetric.
    normal = [-slider%along(2), slider%along(1)]
    frequency = sqrt(own%stiffness/own%mass)
    matrix = 0.0_wp
    do i = 1, 2
      matrix(i, i + 2) = frequency(i)
      matrix(i + 2, i) = -frequency(i)
      do j = 1, 2
        matrix(i + 2, j + 2) = -(own%alpha*slider%along(i)*slider%along(j) + own%beta*normal(i)*normal(j))/own%mass
      end do
      matrix(i + 2, i + 2) = matrix(i + 2, i + 2) - own%damping(i)/own%mass
    end do
    call find_eigenvalues(matrix, unsorted, found)
    if (.not. found) then
      call raise(error, usage_error, 'an eigenvalue of steady sliding is '//beyond)
      return
    end if
    real_part = real(unsorted)
    do i = 1, 4
      j = maxloc(real_part, 1)
      eigenvalues(i) = unsorted(j)
      real_part(j) = -huge(1.0_wp)
    end do
  end subroutine steady_sliding_eigenvalues

  !> The critical angles for this slider; its own misalignment is ignored. With q = sin^2(phi), D_11 = alpha (1 - q) + beta q + c_x
  !> and D_22 = alpha q + beta (1 - q) + c_y, both linear in q as the determinant E of D + C, and S = D_11 + D_22, Routh's criterion
  !> for the eigenvalues is S > 0, R > 0 and
  !>     G = m (k_y - k_x)^2 D_11 D_22 + S R E > 0,      R = k_x D_22 + k_y D_11;
  !> G is quadratic in q, and where it vanishes, m omega^2 = R/S.
  subroutine critical_misalignment(slider, velocity, critical, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s, not 0
    type(critical_t), intent(out) :: critical
    type(error_t), allocatable, intent(out) :: error
    type(perturbed_t) :: own
    real(wp) :: edge(4), angle, square, ratio
    integer :: side, i, edges, branch, power

    call perturb(slider, velocity, own, error)
    if (allocated(error)) return
    call use_own_units(own, power)
    edge(1) = 0.0_wp
    edges = 1
    ! Angles up to 45 degrees from sin^2, the others from cos^2: so each has all its digits.
    do side = 1, 2
      associate (zeros => zeros_of_stability(own, side))
        do i = 1, 2
          ratio = zeros(merge(i, 3 - i, side == 1))
          if (.not. (ratio > 0.0_wp .and. (ratio < 0.5_wp .or. (side == 1 .and. ratio <= 0.5_wp)))) cycle
          if (.not. min(trace(own), rigidity(own, side, ratio)) > 0.0_wp) cycle
          angle = atan2(sqrt(ratio), sqrt(1.0_wp - ratio))
          if (side == 2) angle = atan2(sqrt(1.0_wp - ratio), sqrt(ratio))
          square = crossing(own, side, ratio)/own%mass
          call check_finite('the frequency at the critical angle', [square], error)
          if (allocated(error)) return
          branch = merge(low_branch, fast_branch, square*own%mass <= sqrt(product(own%stiffness)))
          if (critical%has(branch)) branch = 3 - branch
          critical%has(branch) = .true.
          critical%angle(branch) = angle
          critical%frequency(branch) = scale(sqrt(square), power)
          edges = edges + 1
          edge(edges) = angle
        end do
      end associate
    end do
    critical%exists = any(critical%has)
    if (all(critical%has) .and. critical%frequency(1) > critical%frequency(2)) then
      critical%angle = critical%angle([2, 1])
      critical%frequency = critical%frequency([2, 1])
    end if
    edges = edges + 1
    edge(edges) = 0.5_wp*pi
    ! The stable part; the widest if there are several.
    do i = 2, edges
      angle = 0.5_wp*(edge(i - 1) + edge(i))
      if (.not. is_stable_along(own, [cos(angle), sin(angle)])) cycle
      if (edge(i) - edge(i - 1) > critical%window(2) - critical%window(1)) critical%window = edge(i - 1:i)
    end do
  end subroutine critical_misalignment

  !> Trace of D + C, S above.
  pure real(wp) function trace(own)
    type(perturbed_t), intent(in) :: own

    trace = own%alpha + own%beta + sum(own%damping)
  end function trace

  !> The values at q = 0 (side 1; 2: at cos^2(phi) = 0) of D_11, D_22 and E above, and their slopes with sin^2 (cos^2).
  pure function damping_terms(own, side) result(term)
    type(perturbed_t), intent(in) :: own
    integer, intent(in) :: side
    real(wp) :: term(3, 2), here, there

    here = merge(own%alpha, own%beta, side == 1)
    there = merge(own%beta, own%alpha, side == 1)
    term(:, 1) = [here + own%damping(1), there + own%damping(2), (here + own%damping(1))*(there + own%damping(2))]
    term(:, 2) = [there - here, here - there, (there - here)*(own%damping(2) - own%damping(1))]
  end function damping_terms

  !> R above, at sin^2(phi), or at cos^2(phi).
  pure real(wp) function rigidity(own, side, square)
    type(perturbed_t), intent(in) :: own
    integer, intent(in) :: side
    real(wp), intent(in) :: square
    real(wp) :: term(3, 2)

    term = damping_terms(own, side)
    rigidity = own%stiffness(1)*(term(2, 1) + square*term(2, 2)) + own%stiffness(2)*(term(1, 1) + square*term(1, 2))
  end function rigidity

  !> p = m omega^2 where G vanishes, at sin^2(phi), or at cos^2(phi). R/S loses digits if one spring is much stiffer; it tells which
  !> of the two solutions of (k_x - p)(k_y - p) = p E/m it is.
  pure real(wp) function crossing(own, side, square)
    type(perturbed_t), intent(in) :: own
    integer, intent(in) :: side
    real(wp), intent(in) :: square
    real(wp) :: term(3, 2), coupling, root_sum, gap, p(2)

    term = damping_terms(own, side)
    coupling = (term(3, 1) + square*term(3, 2))/own%mass
    root_sum = sum(sqrt(own%stiffness))
    gap = ((own%stiffness(2) - own%stiffness(1))/root_sum)**2 + coupling
    crossing = rigidity(own, side, square)/trace(own)
    if (.not. gap > 0.0_wp) return
    p(2) = 0.5_wp*(sum(own%stiffness) + coupling + sqrt(gap)*sqrt(root_sum**2 + coupling))
    p(1) = product(own%stiffness)/p(2)
    crossing = p(minloc(abs(log(p/crossing)), 1))
  end function crossing

  !> The zeros of G in sin^2(phi), or in cos^2(phi), the smaller one first; 2 if there are none.
  pure function zeros_of_stability(own, side) result(zeros)
    type(perturbed_t), intent(in) :: own
    integer, intent(in) :: side
    real(wp) :: zeros(2), term(3, 2), rest, slope, a, b, c, discriminant, larger

    term = damping_terms(own, side)
    zeros = 2.0_wp
    associate (gap => own%mass*(own%stiffness(2) - own%stiffness(1))**2, s => trace(own))
      rest = rigidity(own, side, 0.0_wp)
      slope = own%stiffness(1)*term(2, 2) + own%stiffness(2)*term(1, 2)
      a = gap*term(1, 2)*term(2, 2) + s*slope*term(3, 2)
      b = gap*(term(1, 1)*term(2, 2) + term(2, 1)*term(1, 2)) + s*(rest*term(3, 2) + slope*term(3, 1))
      c = gap*term(1, 1)*term(2, 1) + s*rest*term(3, 1)
    end associate
    discriminant = b**2 - 4.0_wp*a*c
    if (.not. discriminant >= 0.0_wp) return
    larger = -0.5_wp*(b + sign(sqrt(discriminant), b))
    if (abs(larger) > 0.0_wp) zeros(1) = c/larger
    if (abs(larger) < 2.0_wp*abs(a)) zeros(2) = larger/a
    if (zeros(1) > zeros(2)) zeros = zeros([2, 1])
  end function zeros_of_stability

  !> Routh's criterion for a drive along (cos(phi), sin(phi)).
  pure logical function is_stable_along(own, along)
    type(perturbed_t), intent(in) :: own
    real(wp), intent(in) :: along(2)
    real(wp) :: term(3, 2), damping(3), square
    integer :: side

    side = merge(1, 2, abs(along(2)) <= abs(along(1)))
    square = along(3 - side)**2
    term = damping_terms(own, side)
    damping = term(:, 1) + square*term(:, 2)
    is_stable_along = min(trace(own), rigidity(own, side, square)) > 0.0_wp
    if (is_stable_along) is_stable_along = own%mass*(own%stiffness(2) - own%stiffness(1))**2*damping(1)*damping(2) &
      + trace(own)*rigidity(own, side, square)*damping(3) > 0.0_wp
  end function is_stable_along

  !> The critical angle [rad] in the limit of a rigid stiff axis, tan^2(phi) = -(F' + c_x)/(F/V + c_x); stable above it.
  !> 0 if friction weakens no more than the damper takes.
  subroutine low_frequency_limit(slider, velocity, angle, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s, not 0
    real(wp), intent(out) :: angle
    type(error_t), allocatable, intent(out) :: error
    type(perturbed_t) :: own

    angle = 0.0_wp
    call perturb(slider, velocity, own, error)
    if (allocated(error)) return
    associate (alpha => own%alpha + slider%damping(1), beta => own%beta + slider%damping(1))
      if (alpha < 0.0_wp .and. beta >= 0.0_wp) angle = atan2(sqrt(-alpha), sqrt(beta))
    end associate
  end subroutine low_frequency_limit

  !> Whether all eigenvalues have negative real parts, decided without computing them: the sign of a real part far below the largest
  !> eigenvalue is lost in working precision.
  subroutine is_stable(slider, velocity, stable, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s, not 0
    logical, intent(out) :: stable
    type(error_t), allocatable, intent(out) :: error
    type(perturbed_t) :: own
    integer :: power

    stable = .false.
    call perturb(slider, velocity, own, error)
    if (allocated(error)) return
    call use_own_units(own, power)
    stable = is_stable_along(own, slider%along)
  end subroutine is_stable

  !> Lambda = mu_0 W/(2 V sin(phi) sqrt(m k_x)), the damping ratio at theta = 90 degrees (Eq. 10).
  subroutine damping_scale(slider, velocity, lambda, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s
    real(wp), intent(out) :: lambda
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: drift

    lambda = 0.0_wp
    drift = abs(velocity*slider%along(2))
    if (.not. (drift > 0.0_wp .and. drift <= huge(drift))) then
      call raise(error, usage_error, 'V sin(phi) = '//trim(short_text(drift))//' m/s: Eq. (10) divides by it, '// &
                 'so V and the misalignment must be finite and not 0')
      return
    end if
    lambda = 0.5_wp*slider%law%kinetic_limit/(drift*impedance(slider))
    call check_finite('Lambda', [lambda], error)
  end subroutine damping_scale

  !> sqrt(m k_x) [N s/m], half the damping above which the slow motion is overdamped.
  pure real(wp) function impedance(slider)
    type(slider_t), intent(in) :: slider

    impedance = sqrt(slider%mass)*sqrt(slider%stiffness(1))
  end function impedance

  !> theta* = asin(Lambda^(-1/3)) [rad]: from this angle up to pi - theta* the slow motion is overdamped.
  subroutine overdamped_angle(lambda, angle, error)
    real(wp), intent(in) :: lambda
    real(wp), intent(out) :: angle
    type(error_t), allocatable, intent(out) :: error

    angle = 0.0_wp
    if (lambda >= 1.0_wp) then
      angle = asin(lambda**(-1.0_wp/3.0_wp))
    else
      call raise(error, usage_error, 'Lambda = '//trim(short_text(lambda))// &
                 ': the slow motion is overdamped at no angle; theta* exists for Lambda >= 1')
    end if
  end subroutine overdamped_angle

  !> zeta = Lambda |sin(theta)|^3 of the slow motion with constant friction (Eq. 10).
  elemental real(wp) function damping_ratio(lambda, theta)
    real(wp), intent(in) :: lambda
    real(wp), intent(in) :: theta                        !! from the soft axis to the friction, rad

    damping_ratio = lambda*abs(sin(theta))**3
  end function damping_ratio

  !> The same with the slider's own law: [F'(v) cos^2(theta) + F(v) |sin(theta)|^3/(V sin(phi))]/(2 sqrt(m k_x)) at the slip speed
  !> v = V sin(phi)/sin(theta) that belongs to the direction of friction.
  subroutine weakening_damping_ratio(slider, velocity, theta, zeta, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s
    real(wp), intent(in) :: theta                        !! from the soft axis to the friction, rad
    real(wp), intent(out) :: zeta
    type(error_t), allocatable, intent(out) :: error
    !> Below this sine the damping is 0 to working precision.
    real(wp), parameter :: smallest_sine = 1.0e-100_wp
    real(wp) :: drift, sine, force(1), slope(1), lambda

    zeta = 0.0_wp
    call damping_scale(slider, velocity, lambda, error)
    if (allocated(error)) return
    drift = abs(velocity*slider%along(2))
    sine = abs(sin(theta))
    if (sine < smallest_sine) return
    call slider%law%evaluate(1, [drift/sine], force, slope)
    zeta = 0.5_wp*slope(1)/impedance(slider)*cos(theta)**2 + 0.5_wp*force(1)/(drift*impedance(slider))*sine**3
    call check_finite('zeta', [zeta], error)
  end subroutine weakening_damping_ratio

  !> The slider with alpha = dG/dv and beta = G/v [N s/m] at v = |V|; G = F v/sqrt(v^2 + v_s^2) is the friction force.
  subroutine perturb(slider, velocity, own, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity                     !! of the drive, m/s
    type(perturbed_t), intent(out) :: own
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: speed, force(1), slope(1), smoothing, smoothed

    speed = abs(velocity)
    if (.not. (speed > 0.0_wp .and. speed <= huge(speed))) then
      call raise(error, usage_error, 'V = '//trim(short_text(velocity))// &
                 ' m/s: there is no steady sliding; the drive velocity must be finite and not 0')
      return
    end if
    call slider%law%evaluate(1, [speed], force, slope)
    smoothing = sqrt(slider%smoothing)
    smoothed = hypot(speed, smoothing)
    own%mass = slider%mass
    own%stiffness = slider%stiffness
    own%damping = slider%damping
    own%beta = force(1)/smoothed
    own%alpha = slope(1)*(speed/smoothed) + own%beta*(smoothing/smoothed)**2
    call check_finite('F/V', [own%alpha, own%beta], error)
  end subroutine perturb

  !> Units of mass and time near the slider's own, powers of two, in which no product is out of range; rates are in 2**power 1/s.
  pure subroutine use_own_units(own, power)
    type(perturbed_t), intent(inout) :: own
    integer, intent(out) :: power
    integer :: mass

    mass = exponent(own%mass)
    power = exponent(maxval(own%stiffness)) - mass
    power = (power - modulo(power, 2))/2
    own%mass = scale(own%mass, -mass)
    own%stiffness = scale(own%stiffness, -mass - 2*power)
    own%alpha = scale(own%alpha, -mass - power)
    own%beta = scale(own%beta, -mass - power)
    own%damping = scale(own%damping, -mass - power)
  end subroutine use_own_units

  !> Refuse what the range of the numbers was too small for.
  subroutine check_finite(name, values, error)
    character(*), intent(in) :: name
    real(wp), intent(in) :: values(:)
    type(error_t), allocatable, intent(out) :: error

    if (.not. all(abs(values) <= huge(values))) call raise(error, usage_error, name//' is '//beyond)
  end subroutine check_finite
end module dst_stability
