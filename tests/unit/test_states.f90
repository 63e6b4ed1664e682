!> A motion with a third slip unknown.
module pushed_motion
  use dst_full_model, only: full_smoothed_t
  use dst_kinds, only: wp
  use dst_slip_system, only: stage_terms_t
  implicit none
  private

  public :: pushed_t, rate

  real(wp), parameter :: rate = 30.0_wp   !! 1/s

  !> The smoothed contact with a force q [N] along x that decays: m w' = ... + push q, q' = -rate q.
  type, extends(full_smoothed_t) :: pushed_t
    real(wp) :: push = 0.0_wp
  contains
    procedure :: dynamics
    procedure :: decay_polynomial
  end type pushed_t

contains

  pure subroutine dynamics(self, stages, drive_velocity, u, y, velocity_y, terms)
    class(pushed_t), intent(in) :: self
    integer, intent(in) :: stages
    real(wp), intent(in) :: drive_velocity(stages)
    real(wp), intent(in) :: u(stages, self%components), y(stages, self%unknowns)
    real(wp), intent(in) :: velocity_y(stages, self%components, self%unknowns)
    type(stage_terms_t), intent(inout) :: terms

    terms%force_y = 0.0_wp
    terms%force_u = 0.0_wp
    terms%inertia_y = 0.0_wp
    terms%dissipation_y = 0.0_wp
    call self%full_smoothed_t%dynamics(stages, drive_velocity, u, y, velocity_y, terms)
    terms%inertia(:, 3) = 1.0_wp
    terms%force(:, 1) = terms%force(:, 1) + self%push*y(:, 3)/self%slider%mass
    terms%force_y(:, 1, 3) = self%push/self%slider%mass
    terms%force(:, 3) = -rate*y(:, 3)
    terms%force_y(:, 3, 3) = -rate
    terms%dissipation_y(:, 3) = 0.0_wp
  end subroutine dynamics

  !> Steady sliding counts as stable, (lambda + rate)^5: growth is not tested here.
  pure subroutine decay_polynomial(self, y, drive_velocity, coefficient, weakening)
    class(pushed_t), intent(in) :: self
    real(wp), intent(in) :: y(self%unknowns), drive_velocity
    real(wp), intent(out) :: coefficient(0:self%components + self%unknowns), weakening

    associate (unused => [y, drive_velocity])
    end associate
    coefficient = [rate**5, 5.0_wp*rate**4, 10.0_wp*rate**3, 10.0_wp*rate**2, 5.0_wp*rate, 1.0_wp]
    weakening = 0.0_wp
  end subroutine decay_polynomial
end module pushed_motion

!> A model with more slip unknowns than elongations, with every kind of adaptive method: a third unknown that only decays does not
!> change the motion of two unknowns and has its own closed form; with one that pushes, all methods agree.
program test_states
  use checks, only: check, check_close, finish
  use dst_drive, only: drive_segment_t
  use dst_friction, only: new_friction_law
  use dst_full_model, only: new_full_smoothed
  use dst_kinds, only: wp
  use dst_radau, only: new_radau
  use dst_runge_kutta, only: new_runge_kutta
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_slip_system, only: slip_system_t
  use dst_state, only: state_t
  use dst_stepper, only: stepper_t, attempt_t
  use pushed_motion, only: pushed_t, rate
  implicit none

  real(wp), parameter :: first_push = 0.3_wp, duration = 0.1_wp
  character(7), parameter :: methods(5) = ['radau5 ', 'radau9 ', 'radau13', 'dopri5 ', 'dop853 ']
  type(state_t) :: plain, beside, pushed(size(methods))
  integer :: i

  do i = 1, size(methods)
    call integrate(methods(i), new_full_smoothed(slider()), 0.0_wp, plain)
    call integrate(methods(i), new_pushed(0.0_wp), first_push, beside)
    call integrate(methods(i), new_pushed(1.0_wp), first_push, pushed(i))
    call check_close(trim(methods(i))//': beside the motion, slip velocity', norm2(beside%y(1:2) - plain%y(1:2)), 0.0_wp, &
      1.0e-8_wp*norm2(plain%y))
    call check_close(trim(methods(i))//': beside the motion, elongation', norm2(beside%u - plain%u), 0.0_wp, &
      1.0e-8_wp*norm2(plain%u))
    call check_close(trim(methods(i))//': friction work', beside%friction_work, plain%friction_work, 1.0e-8_wp*plain%friction_work)
    call check_close(trim(methods(i))//': decays', beside%y(3), first_push*exp(-rate*duration), 1.0e-6_wp*first_push)
    call check(trim(methods(i))//': a push moves', norm2(pushed(i)%u - plain%u) > 0.01_wp*norm2(plain%u))
    call check_close(trim(methods(i))//': as the others', norm2(pushed(i)%u - pushed(1)%u), 0.0_wp, 1.0e-7_wp*norm2(pushed(1)%u))
  end do
  call finish()

contains

  function slider()
    type(slider_t) :: slider

    slider%mass = 0.25_wp
    slider%stiffness = [4.0e2_wp, 1.0e3_wp]
    slider%along = cos_sin_degrees(20.0_wp)
    slider%smoothing = 1.0e-2_wp**2
    call new_friction_law('weakening', 0.20_wp, 0.15_wp, 0.10_wp, 1.0_wp, slider%law)
  end function slider

  function new_pushed(push) result(system)
    real(wp), intent(in) :: push
    type(pushed_t) :: system

    system%full_smoothed_t = new_full_smoothed(slider())
    system%unknowns = 3
    system%push = push
  end function new_pushed

  !> The motion from rest after `duration`, with the third unknown beginning at `third`.
  subroutine integrate(method, system, third, motion)
    character(*), intent(in) :: method
    class(slip_system_t), intent(in) :: system
    real(wp), intent(in) :: third
    type(state_t), intent(out) :: motion
    class(stepper_t), allocatable :: stepper
    type(drive_segment_t) :: drive
    type(state_t) :: next
    type(attempt_t) :: outcome
    real(wp), parameter :: rtol = 1.0e-10_wp
    real(wp) :: step

    select case (method)
    case ('radau5')
      stepper = new_radau(3, system%components, system%unknowns, rtol)
    case ('radau9')
      stepper = new_radau(5, system%components, system%unknowns, rtol)
    case ('radau13')
      stepper = new_radau(7, system%components, system%unknowns, rtol)
    case default
      stepper = new_runge_kutta(trim(method), system%components, system%unknowns, rtol)
    end select
    drive = drive_segment_t(velocity=5.0e-2_wp)
    motion%y(3) = third
    call stepper%restart([0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp])
    step = 1.0e-4_wp
    do while (motion%time < duration)
      step = min(step, motion%until(duration))
      call stepper%attempt(system, drive, motion, step, next, outcome)
      if (outcome%solved .and. outcome%error <= 1.0_wp) then
        call stepper%accept()
        motion = next
      end if
      step = step*outcome%factor
    end do
  end subroutine integrate
end program test_states
