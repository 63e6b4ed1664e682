!> The start of slip as power series in time, for methods that cannot start from rest.
module dst_release
  use dst_dense_output, only: dense_output_t, column_u, column_y, column_position
  use dst_drive, only: drive_segment_t
  use dst_kinds, only: wp
  use dst_rest, only: spring_force_size
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  implicit none
  private

  public :: release_t, series_order, release_series

  ! The effects of "twice" were measured with dopri5 and dop853 on Fig. 3 (rtol 1e-6 and 1e-8) and on a drive that reverses.
  !
  !> Order of the power series of a release. Convention. Twice: the series reaches further, 16 % (dopri5) to 28 % (dop853) less work
  !> and 1.0 to 1.2 times the error, but a series itself costs four times as much.
  integer, parameter :: series_order = 10
  !> Longest series, in units; and for its length the largest number of attempts, the smallest and the largest factor between them,
  !> the safety by which the factor from the error is multiplied, and the smallest error in it. Conventions. Twice: 1 % more work
  !> for the smallest factor and the safety, no change for the others; half: 17 % more work for the largest factor, 10 % for the
  !> safety. The error is the same.
  real(wp), parameter :: longest = 2.0_wp
  integer, parameter :: max_lengths = 1000
  real(wp), parameter :: least_left = 0.5_wp, most_left = 0.9_wp, safety = 0.95_wp, least_excess = 1.0e-10_wp
  !> Number of equal parts of the series at which the rise of v is checked. Convention; twice: no change.
  integer, parameter :: looks = 8
  !> Attempts at the range of v in which the law is a polynomial, and the share of the last one or of v in the next. Conventions;
  !> twice: no change.
  integer, parameter :: max_ranges = 40
  real(wp), parameter :: range_share = 0.25_wp
  !> Roundoff of a friction force, with a margin. Twice: no change.
  real(wp), parameter :: force_roundoff = 8.0_wp*epsilon(1.0_wp)

  !> Slip from rest as power series in tau = t/unit, up to tau = tau_end.
  type :: release_t
    real(wp) :: unit = 0.0_wp                                !! s
    real(wp) :: tau_end = 0.0_wp
    real(wp) :: slipped(0:series_order, 2) = 0.0_wp          !! distance slipped, m
    real(wp) :: v(0:series_order) = 0.0_wp                   !! m/s
    real(wp) :: theta(0:series_order) = 0.0_wp
    real(wp) :: drive_work(0:series_order) = 0.0_wp          !! J
    real(wp) :: friction_work(0:series_order) = 0.0_wp       !! J
    real(wp) :: damper_work(0:series_order) = 0.0_wp         !! J
    !> Whether there is slip, and whether the series could be made accurate enough.
    logical :: moves = .false.
    logical :: accurate = .false.
  contains
    procedure :: at => release_at
    procedure :: describe
  end type release_t

contains

  !> Slip after a release at `from` (v = 0, u, theta), where v starts with `rate` [m/s2], as power
  !> series; `tolerance` is relative to the slip speed at their end.
  pure function release_series(slider, drive, from, rate, tolerance) result(release)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: rate, tolerance
    type(release_t) :: release
    real(wp) :: gain(2), growth, v_range, law(0:5), discrepancy
    integer :: attempt

    release%unit = slider%radian_time()
    if (slider%is_damped()) release%unit = min(release%unit, 1.0_wp/slider%damping_rate())
    gain = slider%stiffness*slider%drive_coupling()
    growth = hypot(gain(1), gain(2))*(abs(drive%velocity_at(from%time)) + abs(drive%acceleration)*release%unit)
    if (slider%is_damped()) then
      gain = slider%damping*slider%drive_coupling()
      growth = growth + hypot(gain(1), gain(2))*abs(drive%acceleration)
    end if
    v_range = min(release%unit*(rate + growth*release%unit/slider%mass), slider%law%first_knot())
    if (.not. spring_force_size(slider, from%u, drive%velocity_at(from%time)) > 0.0_wp .or. .not. v_range > 0.0_wp) return
    do attempt = 1, max_ranges
      call fit_law(slider, v_range, law, discrepancy)
      call expand(slider, drive, from, rate, law, v_range, release)
      call choose_end(release, v_range, tolerance)
      if (.not. release%moves) return
      associate (v => value(release%v, release%tau_end))
        release%accurate = release%tau_end*release%unit*discrepancy <= tolerance*v*slider%mass
        if (release%accurate) exit
        v_range = range_share*min(v, v_range)
      end associate
    end do
  end function release_series

  !> The friction law on 0 <= v <= v_range as a polynomial in v/v_range through values and slopes at 0, 1/2 and 1, and its largest
  !> error [N].
  pure subroutine fit_law(slider, v_range, law, discrepancy)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: v_range
    real(wp), intent(out) :: law(0:5), discrepancy
    real(wp) :: force(4), slope(4), half, half_slope, full, full_slope
    real(wp), parameter :: position(4) = [0.0_wp, 0.5_wp, 1.0_wp, 0.8_wp]

    call slider%law%evaluate(4, position*v_range, force, slope)
    slope = slope*v_range
    ! The part that value and slope at 0 do not determine.
    half = force(2) - force(1) - 0.5_wp*slope(1)
    half_slope = slope(2) - slope(1)
    full = force(3) - force(1) - slope(1)
    full_slope = slope(3) - slope(1)
    law(0) = force(1)
    law(1) = slope(1)
    law(2) = 16.0_wp*half - 8.0_wp*half_slope + 7.0_wp*full - full_slope
    law(3) = -32.0_wp*half + 32.0_wp*half_slope - 34.0_wp*full + 5.0_wp*full_slope
    law(4) = 16.0_wp*half - 40.0_wp*half_slope + 52.0_wp*full - 8.0_wp*full_slope
    law(5) = 16.0_wp*half_slope - 24.0_wp*full + 4.0_wp*full_slope
    discrepancy = abs(value(law, position(4)) - force(4))
    ! Forces are not more accurate than this.
    if (discrepancy <= force_roundoff*abs(force(1))) discrepancy = 0.0_wp
  end subroutine fit_law

  !> The coefficients, order by order. With n = (cos, sin) and t = (-sin, cos) of theta,
  !> f = K u and primes for d/dtau,
  !>     v' = unit (f . n - F(v))/m,    m v theta' = unit f . t,    slipped' = unit v n.
  !> The second equation at order k gives theta_k, because v_0 = 0 and f . t contains -|f_0| theta_k. Dampers add C (V e - w) to f,
  !> w = v n, of which order k needs v_k but no theta_k.
  pure subroutine expand(slider, drive, from, rate, law, v_range, release)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: rate, law(0:5), v_range
    type(release_t), intent(inout) :: release
    real(wp), dimension(0:series_order) :: cosine, sine, friction, spring, drive_speed
    real(wp) :: force(0:series_order, 2), power(0:series_order, 5), driven(0:series_order), angle_part
    real(wp) :: stretch(0:series_order, 2)   !! u'
    logical :: damped
    integer :: j, k, axis

    associate (v => release%v, theta => release%theta, slip => release%slipped, unit => release%unit, &
        m => slider%mass, stiffness => slider%stiffness)
      slip = 0.0_wp
      v = 0.0_wp
      theta = 0.0_wp
      power = 0.0_wp
      driven = 0.0_wp
      drive_speed = 0.0_wp
      drive_speed(0) = drive%velocity_at(from%time)
      drive_speed(1) = unit*drive%acceleration
      driven(1) = unit*drive_speed(0)
      driven(2) = 0.5_wp*unit*drive_speed(1)
      theta(0) = from%y(2)
      cosine(0) = cos(theta(0))
      sine(0) = sin(theta(0))
      force(0, :) = slider%force_at_rest(from%u, drive_speed(0))
      damped = slider%is_damped()
      stretch = 0.0_wp
      stretch(0, :) = slider%drive_coupling()*drive_speed(0)
      friction(0) = law(0)
      v(1) = unit*rate
      do k = 1, series_order
        slip(k, 1) = unit*convolution(v, cosine, k - 1)/real(k, wp)
        slip(k, 2) = unit*convolution(v, sine, k - 1)/real(k, wp)
        force(k, :) = stiffness*slider%free*(driven(k)*slider%along - slip(k, :))
        if (k > 1) v(k) = unit*(convolution(force(:, 1), cosine, k - 1) + convolution(force(:, 2), sine, k - 1) &
          - friction(k - 1))/(m*real(k, wp))
        if (damped) then
          cosine(k) = 0.0_wp
          sine(k) = 0.0_wp
          stretch(k, :) = slider%free*(slider%along*drive_speed(k) - [convolution(v, cosine, k), convolution(v, sine, k)])
          force(k, :) = force(k, :) + slider%damping*stretch(k, :)
        end if
        cosine(k) = 0.0_wp
        sine(k) = 0.0_wp
        angle_part = 0.0_wp
        do j = 1, k - 1
          cosine(k) = cosine(k) - real(j, wp)*theta(j)*sine(k - j)/real(k, wp)
          sine(k) = sine(k) + real(j, wp)*theta(j)*cosine(k - j)/real(k, wp)
          angle_part = angle_part + real(j, wp)*theta(j)*v(k + 1 - j)
        end do
        angle_part = unit*(convolution(force(:, 2), cosine, k) - convolution(force(:, 1), sine, k)) - m*angle_part
        if (slider%direction_free) theta(k) = angle_part/(m*v(1)*real(k, wp) + unit*(force(0, 1)*cosine(0) + force(0, 2)*sine(0)))
        cosine(k) = cosine(k) - theta(k)*sine(0)
        sine(k) = sine(k) + theta(k)*cosine(0)
        power(k, 1) = v(k)/v_range
        do j = 2, 5
          power(k, j) = convolution(power(:, 1), power(:, j - 1), k)
        end do
        friction(k) = dot_product(law(1:5), power(k, :))
      end do
      do k = 1, series_order
        spring(k - 1) = dot_product(slider%drive_coupling(), force(k - 1, :))
      end do
      spring(series_order) = 0.0_wp
      release%drive_work = 0.0_wp
      release%friction_work = 0.0_wp
      do k = 1, series_order
        release%drive_work(k) = unit*convolution(drive_speed, spring, k - 1)/real(k, wp) &
          + dot_product(slider%held_force(from%u), slip(k, :))
        release%friction_work(k) = unit*convolution(friction, v, k - 1)/real(k, wp)
      end do
      release%damper_work = 0.0_wp
      if (damped) then
        do k = 1, series_order
          do axis = 1, 2
            release%damper_work(k) = release%damper_work(k) &
              + slider%damping(axis)*unit*convolution(stretch(:, axis), stretch(:, axis), k - 1)/real(k, wp)
          end do
        end do
      end if
    end associate
  end subroutine expand

  !> Coefficient k of the product of two series.
  pure real(wp) function convolution(a, b, k)
    real(wp), intent(in) :: a(0:), b(0:)
    integer, intent(in) :: k
    integer :: j

    convolution = 0.0_wp
    do j = 0, k
      convolution = convolution + a(j)*b(k - j)
    end do
  end function convolution

  !> Value at x of the polynomial with these coefficients.
  pure real(wp) function value(coefficient, x)
    real(wp), intent(in) :: coefficient(0:), x
    integer :: k

    value = 0.0_wp
    do k = ubound(coefficient, 1), 0, -1
      value = value*x + coefficient(k)
    end do
  end function value

  !> The longest series in which the last two terms of v and theta are small enough and up to which
  !> v rises, within v_range.
  pure subroutine choose_end(release, v_range, tolerance)
    type(release_t), intent(inout) :: release
    real(wp), intent(in) :: v_range, tolerance
    real(wp) :: excess, v
    integer :: attempt
    integer, parameter :: n = series_order

    release%tau_end = longest
    do attempt = 1, max_lengths
      associate (x => release%tau_end)
        v = value(release%v, x)
        release%moves = rises(release%v, x)
        if (release%moves) then
          excess = max((abs(release%v(n))*x + abs(release%v(n - 1)))*x**(n - 1)/v, &
            (abs(release%theta(n))*x + abs(release%theta(n - 1)))*x**(n - 1))/tolerance
          if (excess <= 1.0_wp .and. v <= v_range) exit
          x = x*min(most_left, max(least_left, safety*max(excess, least_excess)**(-1.0_wp/real(n - 2, wp))))
        else
          x = least_left*x
        end if
        release%moves = .false.
        if (x < tiny(x)) exit
      end associate
    end do
  end subroutine choose_end

  !> Whether v > 0 and v' >= 0 on (0, x], checked at a few points.
  pure logical function rises(v, x)
    real(wp), intent(in) :: v(0:series_order), x
    real(wp) :: slope(0:series_order - 1)
    integer :: k

    slope = [(real(k, wp)*v(k), k=1, series_order)]
    rises = value(v, x) > 0.0_wp
    do k = 1, looks
      rises = rises .and. value(slope, real(k, wp)/real(looks, wp)*x) >= 0.0_wp
    end do
  end function rises

  !> The motion `tau` units after the release at `from`.
  pure function release_at(self, slider, drive, from, tau) result(motion)
    class(release_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: tau
    type(state_t) :: motion
    real(wp) :: slipped(2)

    slipped = [value(self%slipped(:, 1), tau), value(self%slipped(:, 2), tau)]
    call motion%later(from, tau*self%unit)
    motion%u = from%u + drive%displacement(from%time, tau*self%unit)*slider%drive_coupling() - slider%free*slipped
    motion%y(1:2) = [value(self%v, tau), value(self%theta, tau)]
    motion%position = from%position + dot_product(slider%along, slipped)
    motion%drive_work = from%drive_work + value(self%drive_work, tau)
    motion%friction_work = from%friction_work + value(self%friction_work, tau)
    motion%damper_work = from%damper_work + value(self%damper_work, tau)
  end function release_at

  !> The motion during `duration` [s] after the release at `from`, at the nodes of `path`, and the state at its end.
  pure subroutine describe(self, slider, drive, from, duration, path, to)
    class(release_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: duration
    type(dense_output_t), intent(inout) :: path
    type(state_t), intent(out) :: to
    real(wp) :: tau
    integer :: i

    path%step = duration
    do i = 0, path%grid%degree
      tau = path%grid%node(i)*(duration/self%unit)
      to = self%at(slider, drive, from, tau)
      path%nodal(i, column_u:column_u + 1) = to%u - drive%displacement(from%time, tau*self%unit)*slider%drive_coupling()
      path%nodal(i, column_y:column_y + 1) = to%y(1:2)
      path%nodal(i, column_position) = to%position
    end do
    call to%later(from, duration)
  end subroutine describe
end module dst_release
