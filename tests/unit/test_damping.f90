!> Dampers parallel to the springs: release, start of slip and the linear theory, from the equations alone. Their equations, the
!> derivatives and the end of slip: test_models.f90.
program test_damping
  use checks, only: check, check_close, finish
  use random_numbers, only: start_random, uniform, log_uniform
  use scenes, only: fig3_slider, random_slider
  use dst_kinds, only: wp, pi
  use dst_drive, only: drive_segment_t
  use dst_friction, only: new_friction_law
  use dst_full_model, only: plane_decay
  use dst_rest, only: spring_force_size, is_held, release_delay, slip_start_t, start_of_slip
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)

  call start_random(3)
  call test_release()
  call test_jump()
  call test_decay()
  call finish()

contains

  !> The first time at which |K u + C V e| reaches the static limit, compared with a search in small steps and bisection.
  subroutine test_release()
    type(slider_t) :: slider
    type(drive_segment_t) :: drive
    real(wp) :: u(2), expected, found, worst, angle
    integer :: trial, released, kept, early

    worst = 0.0_wp
    released = 0
    kept = 0
    early = 0
    do trial = 1, 300
      slider = random_slider(.true.)
      angle = sum(uniform(1, -pi, pi))
      u = sum(uniform(1, 0.0_wp, 0.9_wp))*slider%law%static_limit*[cos(angle), sin(angle)]/slider%stiffness
      drive = drive_segment_t(start=1.0_wp, end=1.5_wp, velocity=sum(uniform(1, -2.0e-3_wp, 2.0e-3_wp)), &
        acceleration=sum(uniform(1, -8.0e-3_wp, 8.0e-3_wp)))
      if (modulo(trial, 5) == 0) drive%acceleration = 0.0_wp
      found = release_delay(slider, u, drive, 1.1_wp)
      if (excess(slider, u, drive, 0.0_wp) > 0.0_wp) then
        early = early + 1
        call check('release: at once beyond the limit', .not. found > 0.0_wp)
        cycle
      end if
      expected = search(slider, u, drive)
      if (expected > 0.4_wp) then
        kept = kept + 1
        call check('release: not within the ramp', found >= 0.4_wp*(1.0_wp - 1.0e-6_wp))
      else
        released = released + 1
        worst = max(worst, abs(found - expected))
      end if
    end do
    call check('release: all outcomes occur', released > 100 .and. kept > 10 .and. early > 5)
    call check_close('release: delay', worst, 0.0_wp, 1.0e-12_wp)
  end subroutine test_release

  !> |K u + C V e| minus the static limit [N] after a delay [s].
  real(wp) function excess(slider, u, drive, delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2), delay
    type(drive_segment_t), intent(in) :: drive
    real(wp) :: force(2)

    force = slider%stiffness*(u + drive%displacement(1.1_wp, delay)*slider%along) &
      + slider%damping*slider%along*drive%velocity_at(1.1_wp + delay)
    excess = hypot(force(1), force(2)) - slider%law%static_limit
  end function excess

  !> The first zero of it within 0.4 s, 1 s if there is none.
  real(wp) function search(slider, u, drive) result(delay)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2)
    type(drive_segment_t), intent(in) :: drive
    integer, parameter :: parts = 4000
    real(wp) :: low, high, middle
    integer :: i

    delay = 1.0_wp
    do i = 1, parts
      if (excess(slider, u, drive, 0.4_wp*real(i, wp)/real(parts, wp)) <= 0.0_wp) cycle
      low = 0.4_wp*real(i - 1, wp)/real(parts, wp)
      high = 0.4_wp*real(i, wp)/real(parts, wp)
      do while (high - low > 2.0_wp*eps*high)
        middle = 0.5_wp*(low + high)
        if (.not. (middle > low .and. middle < high)) exit
        if (excess(slider, u, drive, middle) > 0.0_wp) then
          high = middle
        else
          low = middle
        end if
      end do
      delay = high
      return
    end do
  end function search

  !> A drive at rest that jumps: the damper alone decides.
  subroutine test_jump()
    type(slider_t) :: slider
    type(slip_start_t) :: beginning
    real(wp), parameter :: nothing(2) = 0.0_wp

    slider = fig3_slider(0.0_wp)
    slider%damping = [100.0_wp, 0.0_wp]
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    call check_close('jump: force at rest', spring_force_size(slider, nothing, 0.03_wp), 3.0_wp, 4.0_wp*eps)
    call check('jump: holds below the limit', is_held(slider, nothing, 0.0199_wp) .and. is_held(slider, nothing, -0.0199_wp))
    call check('jump: does not above', .not. (is_held(slider, nothing, 0.0201_wp) .or. is_held(slider, nothing, -0.0201_wp)))
    call check('jump: at the limit the ramp decides', is_held(slider, [-1.0e-3_wp, 0.0_wp], 0.03_wp, -1.0_wp) &
      .and. .not. is_held(slider, [-1.0e-3_wp, 0.0_wp], 0.03_wp, 1.0_wp))
    call check_close('jump: released at once', release_delay(slider, nothing, drive_segment_t(velocity=0.03_wp), 0.0_wp), 0.0_wp, &
      0.0_wp)
    beginning = start_of_slip(slider, nothing, -0.03_wp)
    call check_close('jump: sets off backwards', abs(beginning%y(2)), pi, 0.0_wp)
    call check_close('jump: acceleration', beginning%rate(1), 4.0_wp, 1.0e-14_wp)
    ! m v'' = k V - c v'.
    call check_close('jump: and its change', beginning%curvature(1), (30.0_wp - 400.0_wp)/0.25_wp, 1.0e-10_wp)
  end subroutine test_jump

  !> The characteristic polynomial compared with the determinant, at complex points.
  subroutine test_decay()
    type(slider_t) :: slider
    complex(wp) :: z, matrix(2, 2), expected, found
    real(wp) :: coefficient(0:4), along, across, n(2), worst, angle
    integer :: trial, k

    worst = 0.0_wp
    do trial = 1, 40
      slider = random_slider(.true.)
      angle = sum(uniform(1, -pi, pi))
      n = [cos(angle), sin(angle)]
      along = -log_uniform(0.1_wp, 10.0_wp)
      across = log_uniform(1.0_wp, 1.0e3_wp)
      coefficient = plane_decay(slider, n, along, across)
      z = cmplx(sum(uniform(1, -1.0_wp, 1.0_wp)), sum(uniform(1, -1.0_wp, 1.0_wp)), wp)*sqrt(slider%stiffness(1)/slider%mass)
      associate (m => slider%mass)
        matrix(1, 1) = m*z**2 + z*(slider%damping(1) + along*n(1)**2 + across*n(2)**2) + slider%stiffness(1)
        matrix(2, 2) = m*z**2 + z*(slider%damping(2) + along*n(2)**2 + across*n(1)**2) + slider%stiffness(2)
        matrix(1, 2) = z*(along - across)*n(1)*n(2)
        expected = (matrix(1, 1)*matrix(2, 2) - matrix(1, 2)**2)/m**2
      end associate
      found = sum([(coefficient(k)*z**k, k=0, 4)])
      worst = max(worst, abs(found - expected)/sum([(coefficient(k)*abs(z)**k, k=0, 4)]))
    end do
    call check_close('decay: polynomial', worst, 0.0_wp, 1.0e-12_wp)
  end subroutine test_decay
end program test_damping
