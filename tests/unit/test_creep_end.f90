!> The end of slow creep: other quadratures, the linear theory of sliding in the direction of friction, and limits.
program test_creep_end
  use dst_kinds, only: wp, pi, degree
  use dst_creep_end, only: creep_end_t, creep_end, fast_growth_rate
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_stability, only: steady_sliding_eigenvalues, low_frequency_limit
  use checks, only: check, check_close, finish
  use random_numbers, only: start_random, log_uniform
  use scenes, only: fig3_slider
  implicit none

  call test_figure_3()
  call test_growth_rate()
  call test_random_sliders()
  call test_a_steep_angle()
  call test_where_creep_does_not_end()
  call test_symmetries_and_units()
  call test_extremes()
  call finish()

contains

  !> If friction falls to zero, creep ends with friction far from the soft axis: tan(theta)^2 = v/v_f.
  subroutine test_a_steep_angle()
    type(slider_t) :: slider
    type(creep_end_t) :: end

    slider = fig3_slider(10.0_wp, 1.0e9_wp)
    call new_friction_law('weakening', 0.2_wp, 0.0_wp, 0.01_wp, 10.0_wp, slider%law)
    end = creep_end(slider, 0.12_wp)
    call check('creep ends', end%exists .and. end%angle > 45.0_wp*degree)
    call check_close('at a steep angle', tan(end%angle)**2, 0.12_wp*slider%along(2)/sin(end%angle)/0.01_wp, 1.0e-9_wp)
  end subroutine test_a_steep_angle

  !> D by scipy.integrate.quad of -sigma dt over theta, to nine digits.
  subroutine test_figure_3()
    call expect(fig3_slider(1.0_wp), 1.0e-3_wp, 10.3402141787_wp, 4.31636334_wp)
    call expect(fig3_slider(3.0_wp), 1.0e-3_wp, 88.588356007_wp, 6.17845466_wp)
    call expect(fig3_slider(7.0_wp), 1.0e-3_wp, 362.7067326_wp, 8.09942293_wp)
    call expect(fig3_slider(1.0_wp, 1.0e8_wp), 1.0e-3_wp, 478.0391087_wp, 4.31636334_wp)
    call expect(fig3_slider(1.0_wp), 2.0e-4_wp, 0.63966400569_wp, 2.53550850_wp)
    call check('no decay where the oscillation grows up to slip', .not. decay_of(fig3_slider(1.0_wp, 5.0e5_wp), 1.0e-3_wp) > 0.0_wp)
  end subroutine test_figure_3

  subroutine expect(slider, velocity, decay, angle_deg)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, decay, angle_deg
    type(creep_end_t) :: end

    end = creep_end(slider, velocity)
    call check('Fig. 3: creep ends', end%exists)
    call check_close('Fig. 3: decay', end%decay, decay, 1.0e-7_wp*decay)
    call check_close('Fig. 3: angle', end%angle/degree, angle_deg, 1.0e-8_wp*angle_deg)
  end subroutine expect

  real(wp) function decay_of(slider, velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(creep_end_t) :: end

    end = creep_end(slider, velocity)
    decay_of = end%decay
  end function decay_of

  !> Sliding along n = (cos theta, sin theta) at the speed v is steady sliding with the misalignment theta: its fast pair of
  !> eigenvalues grows at sigma, except terms of the order of k_x/k_y and of v (k_y m)^(1/2)/F.
  subroutine test_growth_rate()
    real(wp), parameter :: angles(4) = [6.0_wp, 15.0_wp, 30.0_wp, 60.0_wp]
    type(slider_t) :: slider, turned
    type(error_t), allocatable :: error
    complex(wp) :: eigenvalues(4)
    real(wp) :: rate
    integer :: i, fast

    slider = fig3_slider(1.0_wp)
    do i = 1, size(angles)
      turned = slider
      turned%along = cos_sin_degrees(angles(i))
      call steady_sliding_eigenvalues(turned, 1.0e-3_wp*slider%along(2)/sin(angles(i)*degree), eigenvalues, error)
      call check('eigenvalues without error', .not. allocated(error))
      fast = maxloc(abs(aimag(eigenvalues)), dim=1)
      rate = fast_growth_rate(slider, 1.0e-3_wp, angles(i)*degree)
      call check_close('sigma at an angle', real(eigenvalues(fast), wp), rate, 0.01_wp*abs(rate) + 0.02_wp)
    end do
  end subroutine test_growth_rate

  !> The load has its first maximum at the end, and D is the integral over theta by the midpoint rule.
  subroutine test_random_sliders()
    integer, parameter :: points = 60000
    type(slider_t) :: slider
    type(creep_end_t) :: end
    real(wp) :: velocity, angle, theta, width, rate, total, least
    integer :: i, j, ended

    call start_random(20261123)
    ended = 0
    do i = 1, 200
      slider = fig3_slider(log_uniform(0.1_wp, 20.0_wp), 1.0e3_wp*log_uniform(1.0e3_wp, 1.0e6_wp))
      slider%mass = log_uniform(1.0e-3_wp, 10.0_wp)
      velocity = log_uniform(1.0e-5_wp, 1.0e-2_wp)
      end = creep_end(slider, velocity)
      if (.not. end%exists) cycle
      ended = ended + 1
      call check_close('slip begins at the load F cos(theta)', load(slider, velocity, end%angle), end%load, 1.0e-12_wp*end%load)
      call check('the load is largest there', max(load(slider, velocity, 1.01_wp*end%angle), &
        load(slider, velocity, 0.99_wp*end%angle)) < end%load)
      least = 0.0_wp
      total = 0.0_wp
      width = (log(0.5_wp*pi) - log(end%angle))/points
      do j = 1, points
        theta = end%angle*exp((real(j, wp) - 0.5_wp)*width)
        angle = end%angle*exp(real(j - 1, wp)*width)
        rate = fast_growth_rate(slider, velocity, theta)
        total = total - rate*(load(slider, velocity, angle) - load(slider, velocity, angle*exp(width)))*sin(theta) &
          /(slider%stiffness(1)*velocity*sin(theta - atan2(slider%along(2), slider%along(1))))
        least = max(least, total)
      end do
      call check_close('D is the integral', end%decay, least, 2.0e-6_wp*least + 1.0e-8_wp)
    end do
    call check('most sliders slip', ended > 120)
  end subroutine test_random_sliders

  !> F(v) cos(theta) [N].
  real(wp) function load(slider, velocity, theta)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, theta
    real(wp) :: friction(1), slope(1)

    call slider%law%evaluate(1, [velocity*slider%along(2)/sin(theta)], friction, slope)
    load = friction(1)*cos(theta)
  end function load

  !> Above the critical angle of a rigid stiff axis creep turns into steady sliding; without weakening always.
  subroutine test_where_creep_does_not_end()
    type(slider_t) :: slider
    type(error_t), allocatable :: error
    real(wp) :: limit

    call low_frequency_limit(fig3_slider(1.0_wp), 1.0e-3_wp, limit, error)
    call check('creep ends below the critical angle', ends(fig3_slider(0.999_wp*limit/degree), 1.0e-3_wp))
    call check('creep does not end above it', .not. ends(fig3_slider(1.001_wp*limit/degree), 1.0e-3_wp))
    slider = fig3_slider(1.0_wp)
    call check('a drive that rests', .not. ends(slider, 0.0_wp))
    call check('without misalignment', .not. ends(fig3_slider(0.0_wp), 1.0e-3_wp))
    call check('along the stiff axis', .not. ends(fig3_slider(90.0_wp), 1.0e-3_wp))
    slider%mass = 0.0_wp
    call check('without mass', .not. ends(slider, 1.0e-3_wp))
    slider = fig3_slider(1.0_wp)
    call new_friction_law('weakening', 0.2_wp, 0.25_wp, 0.01_wp, 10.0_wp, slider%law)
    call check('strengthening friction', .not. ends(slider, 1.0e-3_wp))
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 0.01_wp, 10.0_wp, slider%law)
    call check('constant friction', .not. ends(slider, 1.0e-3_wp))
  end subroutine test_where_creep_does_not_end

  logical function ends(slider, velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(creep_end_t) :: end

    end = creep_end(slider, velocity)
    ends = end%exists
  end function ends

  !> The four mirror images, and units that are powers of two.
  subroutine test_symmetries_and_units()
    type(slider_t) :: slider
    type(creep_end_t) :: plain, end
    real(wp), parameter :: angles(4) = [1.0_wp, -1.0_wp, 179.0_wp, -179.0_wp]
    integer :: i

    plain = creep_end(fig3_slider(1.0_wp), 1.0e-3_wp)
    do i = 1, size(angles)
      end = creep_end(fig3_slider(angles(i)), -1.0e-3_wp)
      call check_close('a mirror image has the same decay', end%decay, plain%decay, 1.0e-13_wp*plain%decay)
    end do
    slider = fig3_slider(1.0_wp)
    ! Kilogram, metre and second are 1/4, 1/8 and 1/2 of the previous ones.
    slider%mass = 4.0_wp*slider%mass
    call new_friction_law('weakening', 0.2_wp, 0.15_wp, 0.04_wp, 80.0_wp, slider%law)
    end = creep_end(slider, 4.0e-3_wp)
    call check_close('a ratio has no unit', end%decay, plain%decay, 1.0e-13_wp*plain%decay)
  end subroutine test_symmetries_and_units

  !> Numbers beyond any rig: the result is finite, or there is none.
  subroutine test_extremes()
    type(slider_t) :: slider
    type(creep_end_t) :: end
    real(wp) :: velocity
    integer :: i

    call start_random(20261123)
    do i = 1, 2000
      slider%mass = log_uniform(1.0e-300_wp, 1.0e300_wp)
      slider%stiffness = [log_uniform(1.0e-300_wp, 1.0e300_wp), log_uniform(1.0e-300_wp, 1.0e300_wp)]
      slider%along = cos_sin_degrees(log_uniform(1.0e-300_wp, 90.0_wp))
      velocity = log_uniform(1.0e-300_wp, 1.0e300_wp)
      call new_friction_law('weakening', log_uniform(0.1_wp, 1.0_wp), log_uniform(0.1_wp, 1.0_wp), &
        log_uniform(1.0e-100_wp, 1.0e100_wp), log_uniform(1.0e-200_wp, 1.0e200_wp), slider%law)
      if (mod(i, 2) == 0) then
        slider%mass = log_uniform(1.0e-30_wp, 1.0e30_wp)
        slider%stiffness = [log_uniform(1.0e-30_wp, 1.0e30_wp), log_uniform(1.0e-30_wp, 1.0e30_wp)]
        velocity = log_uniform(1.0e-30_wp, 1.0e30_wp)
        slider%along = cos_sin_degrees(log_uniform(1.0e-20_wp, 90.0_wp))
      end if
      end = creep_end(slider, velocity)
      call check('a finite end of creep', .not. end%exists .or. (end%decay >= 0.0_wp .and. end%decay <= huge(1.0_wp) &
        .and. end%angle > 0.0_wp .and. end%angle < 0.5_wp*pi .and. end%load > 0.0_wp))
    end do
  end subroutine test_extremes
end program test_creep_end
