!> Where the small cycles of the slow model begin, without integration in time. docs/notebooks/closed_laws.ipynb has the theory.
!>
!> The slow model is m w'' + Phi'(w) w' + k_x (w - V c) = 0 with Phi(w) = F(v) w/v, v = sqrt(w^2 + (V s)^2), c = cos(phi),
!> s = sin(phi) (dst_low_frequency). Small cycles begin where Phi'(V c) = 0; they are stable if Phi'''(V c) > 0 there, and the
!> Bautin point is where that changes.
module dst_small_cycles
  use dst_chebyshev, only: chebyshev_points, chebyshev_coefficients, chebyshev_derivative
  use dst_friction, only: friction_law_t
  use dst_kinds, only: wp
  use dst_slider, only: slider_t
  implicit none
  private

  public :: bautin_point, critical_velocities, criticality

  !> Number of points, and width over the distance to the next singularity of Phi, of the polynomials by which Phi is
  !> differentiated. Conventions.
  integer, parameter :: points = 24
  real(wp), parameter :: width = 0.4_wp
  !> Range of V in which they are searched [m/s], with this number of steps per factor of ten. Conventions.
  real(wp), parameter :: least_velocity = 1.0e-9_wp, largest_velocity = 1.0e4_wp
  integer, parameter :: steps_per_decade = 16
  integer, parameter :: max_iterations = 80
  real(wp), parameter :: fine = 8.0_wp*epsilon(1.0_wp)

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

  !> Phi'''(w) [N s3/m3], by differentiating the polynomial through Chebyshev points around w. Phi is singular at w = +- i V s, so
  !> these points extend over a share of the distance to it, and at most over a range of the size of v_f.
  pure real(wp) function third_derivative(law, across, w)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(in) :: across, w
    real(wp) :: radius, x(points), value(points, 1)
    integer :: j

    radius = width*hypot(w, across)
    x = chebyshev_points(points)
    do j = 1, points
      value(j, 1) = resistance(law, across, w + radius*x(j))
    end do
    value = chebyshev_coefficients(value)
    third_derivative = value_at_middle(chebyshev_derivative(chebyshev_derivative(value(:, 1))))/radius**2
  end function third_derivative

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
    real(wp) :: square

    square = weakening(law, abs(velocity))
    criticality = 0.0_wp
    if (.not. square > 0.0_wp) return
    criticality = third_derivative(law, abs(velocity)*sqrt(square/(1.0_wp + square)), abs(velocity)/sqrt(1.0_wp + square))
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
end module dst_small_cycles
