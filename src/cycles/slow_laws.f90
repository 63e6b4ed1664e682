!> Laws for where the stick-slip of the slow model begins and ends, without integration in time. docs/closed_laws.md derives them.
!>
!> The slow model is m w'' + Phi'(w) w' + k_x (w - V c) = 0 with Phi(w) = F(v) w/v, v = sqrt(w^2 + (V s)^2), c = cos(phi),
!> s = sin(phi) (dst_low_frequency). Small cycles begin where Phi'(V c) = 0; they are stable if Phi'''(V c) > 0 there, and the
!> Bautin point is where that changes. With a slow drive, stick-slip ends at a canard; with a fast one, at a fold of nearly harmonic
!> oscillations.
module dst_slow_laws
  use dst_chebyshev, only: chebyshev_points, chebyshev_coefficients, chebyshev_derivative
  use dst_friction, only: friction_law_t
  use dst_kinds, only: wp, pi
  use dst_roots, only: bracket_t
  use dst_slider, only: slider_t
  implicit none
  private

  public :: law_end_t, canard_end, swing_end, bautin_point, critical_velocities, criticality

  !> Number of points, and width over the distance to the next singularity of Phi, of the polynomials by which Phi is
  !> differentiated. Conventions: the seventh derivative, which is the least accurate, then has six digits.
  integer, parameter :: points = 24
  real(wp), parameter :: width = 0.4_wp
  !> Number of points of an average over an oscillation: exact to roundoff unless its turn is much sharper than a hundredth of it.
  !> Convention.
  integer, parameter :: phases = 1024
  !> Range of V in which a law is searched [m/s], with this number of steps per factor of ten. Conventions.
  real(wp), parameter :: least_velocity = 1.0e-9_wp, largest_velocity = 1.0e4_wp
  integer, parameter :: steps_per_decade = 16
  integer, parameter :: max_iterations = 80
  real(wp), parameter :: fine = 8.0_wp*epsilon(1.0_wp)

  !> The result of a law.
  type :: law_end_t
    logical :: exists = .false.
    real(wp) :: angle = 0.0_wp           !! phi [rad]
    !> A measure of its error: for the canard the last term of its series over the sum, for oscillations the largest damping ratio
    !> in one.
    real(wp) :: doubt = 0.0_wp
    logical :: is_fold = .false.         !! of oscillations: a fold, or else where they have the smallest amplitude
    real(wp) :: swing = 0.0_wp           !! amplitude (peak to peak) there, N
  end type law_end_t

contains

  !> Phi'(w) [N s/m] for a drive velocity across the soft axis [m/s].
  pure real(wp) function resistance(law, across, w)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: across, w
    real(wp) :: speed, force(1), slope(1)

    speed = hypot(w, across)
    call law%evaluate(1, [speed], force, slope)
    resistance = slope(1)*(w/speed)**2 + (force(1)/speed)*(across/speed)**2
  end function resistance

  !> Phi'(w) and its next derivatives at w, by differentiating the polynomial through Chebyshev points around it. Phi is singular at
  !> w = +- i V s, so these points extend over a share of the distance to it, and at most over a range of the size of v_f.
  pure function derivatives(law, across, w, count) result(derivative)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: across, w
    integer, intent(in) :: count
    real(wp) :: derivative(count), radius, x(points), value(points, 1), coefficient(points)
    integer :: j, k

    radius = width*hypot(w, across)
    x = chebyshev_points(points)
    do j = 1, points
      value(j, 1) = resistance(law, across, w + radius*x(j))
    end do
    value = chebyshev_coefficients(value)
    coefficient = value(:, 1)
    do k = 1, count
      derivative(k) = value_at_middle(coefficient)/radius**(k - 1)
      coefficient = chebyshev_derivative(coefficient)
    end do
  end function derivatives

  !> Value at 0 of a series in Chebyshev polynomials: T_0, T_4, ... are 1 there, T_2, T_6, ... are -1.
  pure real(wp) function value_at_middle(coefficient)
    real(wp), intent(in) :: coefficient(:)

    value_at_middle = sum(coefficient(1::4)) - sum(coefficient(3::4))
  end function value_at_middle

  !> -V F'(V)/F(V), the square of the tangent of the angle at which small cycles begin; negative if there is none.
  pure real(wp) function weakening(law, velocity)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: velocity
    real(wp) :: force(1), slope(1)

    call law%evaluate(1, [velocity], force, slope)
    weakening = -1.0_wp
    if (force(1) > 0.0_wp) weakening = -velocity*slope(1)/force(1)
  end function weakening

  !> Phi'''(V c) [N s3/m3] at the angle at which steady sliding changes its stability, if there is one: small cycles are stable
  !> there if it is positive. It depends on the law and V [m/s] alone.
  pure real(wp) function criticality(law, velocity)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: velocity
    real(wp) :: derivative(3), square

    square = weakening(law, abs(velocity))
    criticality = 0.0_wp
    if (.not. square > 0.0_wp) return
    derivative = derivatives(law, abs(velocity)*sqrt(square/(1.0_wp + square)), abs(velocity)/sqrt(1.0_wp + square), 3)
    criticality = derivative(3)
  end function criticality

  !> The drive velocities [m/s] between which steady sliding is unstable at this misalignment, in the limit of a rigid stiff axis:
  !> the lowest and the highest; and whether there are any.
  pure subroutine critical_velocities(slider, velocity, exist)
    type(slider_t), intent(in) :: slider
    real(wp), intent(out) :: velocity(2)
    logical, intent(out) :: exist
    real(wp) :: square, v, next
    integer :: i

    square = (slider%along(2)/slider%along(1))**2
    velocity = 0.0_wp
    exist = .false.
    do i = 0, steps() - 1
      v = grid(i)
      next = grid(i + 1)
      if ((weakening(slider%law, v) > square) .eqv. (weakening(slider%law, next) > square)) cycle
      velocity(2) = crossing(v, next)
      if (.not. exist) velocity(1) = velocity(2)
      exist = .true.
    end do

  contains

    pure real(wp) function crossing(first, second) result(middle)
      real(wp), intent(in) :: first, second
      real(wp) :: low, high
      integer :: iteration

      low = first
      high = second
      do iteration = 1, max_iterations
        middle = 0.5_wp*(low + high)
        if ((weakening(slider%law, middle) > square) .eqv. (weakening(slider%law, low) > square)) then
          low = middle
        else
          high = middle
        end if
        if (high - low <= fine*high) exit
      end do
    end function crossing
  end subroutine critical_velocities

  pure integer function steps()
    steps = nint(log10(largest_velocity/least_velocity))*steps_per_decade
  end function steps

  pure real(wp) function grid(i)
    integer, intent(in) :: i

    grid = least_velocity*10.0_wp**(real(i, wp)/real(steps_per_decade, wp))
  end function grid

  !> The Bautin point: V [m/s] and phi [rad] at which small cycles change from stable to unstable, Phi' = Phi''' = 0. It depends on
  !> the law alone.
  pure subroutine bautin_point(law, velocity, angle, exists)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(out) :: velocity, angle
    logical, intent(out) :: exists
    real(wp) :: low, high
    integer :: i, iteration

    exists = .false.
    velocity = 0.0_wp
    angle = 0.0_wp
    do i = 0, steps() - 1
      low = grid(i)
      high = grid(i + 1)
      if (.not. min(weakening(law, low), weakening(law, high)) > 0.0_wp) cycle
      exists = criticality(law, low) > 0.0_wp .and. criticality(law, high) <= 0.0_wp
      if (exists) exit
    end do
    if (.not. exists) return
    do iteration = 1, max_iterations
      velocity = 0.5_wp*(low + high)
      if (criticality(law, velocity) > 0.0_wp) then
        low = velocity
      else
        high = velocity
      end if
      if (high - low <= fine*high) exit
    end do
    angle = atan(sqrt(weakening(law, velocity)))
  end subroutine bautin_point

  !> Slow drive: the angle of the canard, along which the motion follows the falling part of Phi, to three orders in m k_x beyond
  !> the fold Phi'(w_f) = 0.
  pure subroutine canard_end(slider, velocity, end)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity         !! m/s, not 0
    type(law_end_t), intent(out) :: end
    type(bracket_t) :: bracket
    real(wp) :: critical, angle, excess, last, nearer
    integer :: iteration
    logical :: found

    if (.not. weakening(slider%law, abs(velocity)) > 0.0_wp) return
    critical = atan(sqrt(weakening(slider%law, abs(velocity))))
    call look(critical, bracket%f(2), last, found)
    bracket%x(2) = critical
    if (.not. found .or. bracket%f(2) > 0.0_wp) return
    nearer = critical
    do iteration = 1, 20
      nearer = 0.95_wp*nearer
      call look(nearer, excess, last, found)
      if (.not. found) return
      if (excess > 0.0_wp) exit
    end do
    if (.not. excess > 0.0_wp) return
    bracket%x(1) = nearer
    bracket%f(1) = excess
    do iteration = 1, max_iterations
      angle = bracket%false_position()
      call look(angle, excess, last, found)
      if (.not. found) return
      if (.not. abs(excess) > 0.0_wp) exit
      call bracket%narrow(angle, excess)
      if (bracket%width() <= fine*angle) exit
    end do
    end%exists = .true.
    end%angle = angle
    end%doubt = abs(last)

  contains

    !> V c over the sum of the series, minus 1, and the last term over the sum.
    pure subroutine look(phi, value, last_term, is_fold)
      real(wp), intent(in) :: phi
      real(wp), intent(out) :: value, last_term
      logical, intent(out) :: is_fold
      real(wp) :: across, w, p(7), q(7), smallness, term(3), total
      integer :: k

      across = abs(velocity)*sin(phi)
      value = 0.0_wp
      last_term = 0.0_wp
      call find_fold(slider%law, across, w, is_fold)
      if (.not. is_fold) return
      p = derivatives(slider%law, across, w, 7)
      ! If inertia dominates, the series does not hold.
      is_fold = -p(2)*w > sqrt(slider%mass)*sqrt(slider%stiffness(1))
      if (.not. is_fold) return
      ! In units of w_f and Phi''(w_f).
      q = [(p(k)/p(2)*w**(k - 2), k=1, 7)]
      smallness = slider%mass*slider%stiffness(1)/(p(2)*w)**2
      term(1) = -0.5_wp*q(3)*smallness
      term(2) = -(3.0_wp*q(5) - 26.0_wp*q(3)*q(4) + 36.0_wp*q(3)**3)/24.0_wp*smallness**2
      term(3) = -(3.0_wp*q(7) - 51.0_wp*q(3)*q(6) - 81.0_wp*q(4)*q(5) + 432.0_wp*q(3)**2*q(5) + 556.0_wp*q(3)*q(4)**2 &
        - 2268.0_wp*q(3)**3*q(4) + 1557.0_wp*q(3)**5)/144.0_wp*smallness**3
      total = w*(1.0_wp + sum(term))
      is_fold = total > 0.0_wp
      if (.not. is_fold) return
      value = abs(velocity)*cos(phi)/total - 1.0_wp
      last_term = term(3)*w/total
    end subroutine look
  end subroutine canard_end

  !> The first maximum of Phi: w_f [m/s] with Phi'(w_f) = 0.
  pure subroutine find_fold(law, across, w, exists)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: across           !! V s, m/s
    real(wp), intent(out) :: w
    logical, intent(out) :: exists
    !> The search begins at this share of V s, and doubles it. Convention.
    real(wp), parameter :: first_share = 0.1_wp
    integer, parameter :: doublings = 60
    real(wp) :: low, high
    integer :: i

    high = first_share*across
    exists = .false.
    do i = 1, doublings
      low = high
      high = 2.0_wp*low
      exists = resistance(law, across, high) < 0.0_wp
      if (exists) exit
    end do
    w = high
    if (.not. exists) return
    do i = 1, max_iterations
      w = 0.5_wp*(low + high)
      if (resistance(law, across, w) > 0.0_wp) then
        low = w
      else
        high = w
      end if
      if (high - low <= fine*high) exit
    end do
  end subroutine find_fold

  !> Fast drive: oscillations w = V c + A cos(psi) lose no energy on average if W(A) = 0, where 2 pi W is the integral of Phi
  !> cos(psi) over psi. They end at the largest phi at which there is such an A: at a fold, W = dW/dA = 0, or where the amplitude
  !> (peak to peak) is `least_swing` [N].
  pure subroutine swing_end(slider, velocity, least_swing, end)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity         !! m/s, not 0
    real(wp), intent(in) :: least_swing
    type(law_end_t), intent(out) :: end
    !> Amplitudes that are tried: by this step in their logarithm, up to this many times V and F_0/sqrt(m k_x). Conventions.
    real(wp), parameter :: step = 0.1_wp, largest = 4.0_wp
    real(wp) :: least, most, a, angle, left, right, third(2), at(2)
    integer :: i, n, best
    logical :: exists

    associate (impedance => sqrt(slider%mass*slider%stiffness(1)))
      least = 0.5_wp*least_swing/impedance
      most = largest*(abs(velocity) + slider%law%kinetic_limit/impedance)
      if (.not. (least > 0.0_wp .and. most > least)) return
      n = ceiling(log(most/least)/step)
      best = -1
      do i = 0, n
        call angle_of(least*exp(real(i, wp)*step), angle, exists)
        if (.not. exists .or. (best >= 0 .and. angle <= end%angle)) cycle
        best = i
        end%angle = angle
      end do
      end%exists = best >= 0 .and. best < n
      if (.not. end%exists) return
      a = least
      end%is_fold = best > 0
      if (end%is_fold) then
        ! The largest angle between the neighbours: by division into thirds, as it is flat there.
        left = log(least) + real(best - 1, wp)*step
        right = left + 2.0_wp*step
        do i = 1, max_iterations
          third = [left + (right - left)/3.0_wp, right - (right - left)/3.0_wp]
          call angle_of(exp(third(1)), at(1), exists)
          call angle_of(exp(third(2)), at(2), exists)
          if (at(1) < at(2)) then
            left = third(1)
          else
            right = third(2)
          end if
          if (right - left <= sqrt(fine)) exit
        end do
        a = exp(0.5_wp*(left + right))
        call angle_of(a, end%angle, exists)
      end if
      end%swing = 2.0_wp*a*impedance
      end%doubt = largest_damping(a, end%angle)/(2.0_wp*impedance)
    end associate

  contains

    !> The angle at which oscillations of amplitude `amplitude` [m/s] keep their energy.
    pure subroutine angle_of(amplitude, phi, found)
      real(wp), intent(in) :: amplitude
      real(wp), intent(out) :: phi
      logical, intent(out) :: found
      real(wp) :: low, high
      integer :: iteration

      ! Larger oscillations are damped, smaller ones grow.
      high = 0.5_wp*pi
      low = high
      phi = 0.0_wp
      found = .false.
      do iteration = 1, max_iterations
        low = 0.8_wp*low
        found = loss(amplitude, low) < 0.0_wp
        if (found .or. low < 1.0e-4_wp) exit
        high = low
      end do
      if (.not. found) return
      do iteration = 1, max_iterations
        phi = 0.5_wp*(low + high)
        if (loss(amplitude, phi) < 0.0_wp) then
          low = phi
        else
          high = phi
        end if
        if (high - low <= fine*high) exit
      end do
    end subroutine angle_of

    !> W [N].
    pure real(wp) function loss(amplitude, phi)
      real(wp), intent(in) :: amplitude, phi
      real(wp) :: cosine(phases), w(phases), speed(phases), force(phases), slope(phases)
      integer :: j

      ! Half a turn, at midpoints: the other half gives the same.
      cosine = [(cos(pi*(real(j, wp) - 0.5_wp)/real(phases, wp)), j=1, phases)]
      w = abs(velocity)*cos(phi) + amplitude*cosine
      speed = sqrt(w**2 + (velocity*sin(phi))**2)
      call slider%law%evaluate(phases, speed, force, slope)
      loss = sum(force*w/speed*cosine)/real(phases, wp)
    end function loss

    !> Largest |Phi'| [N s/m] in an oscillation.
    pure real(wp) function largest_damping(amplitude, phi)
      real(wp), intent(in) :: amplitude, phi
      integer :: j

      largest_damping = 0.0_wp
      do j = 0, phases
        largest_damping = max(largest_damping, abs(resistance(slider%law, abs(velocity)*sin(phi), &
          abs(velocity)*cos(phi) + amplitude*cos(pi*real(j, wp)/real(phases, wp)))))
      end do
    end function largest_damping
  end subroutine swing_end
end module dst_slow_laws
