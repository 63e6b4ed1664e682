!> Newton's method for the stages of a Radau IIA step, compiled once for every size of the paper's models, and once for any other.
!>
!> Arguments of each kernel, with s stages, n components and m slip unknowns:
!>   system, method         the model; the collocation method with s stages
!>   drive, from            motion of the drive; state at the start of the step
!>   to_stop                whether the step is to end where the first slip unknown, the slip speed, vanishes
!>   tolerance              of the slip velocity, relative to the largest slip speed, for the remaining error of the solution
!>   own_speed(n) [m/s]     slip speed that counts as large along each axis, for its spring
!>   step [s]               step size; of a step to a stop, guess on entry and solution on exit
!>   y(s, m)                stage values: guess on entry, solution on exit
!>   u, velocity (s, n)     elongation [m] and slip velocity [m/s] that belong to y
!>   velocity_y(s, n, m)    dw/dy of the last iteration
!>   increment(s, m)        the last one
!>   drive_velocity(s)      velocity of the drive at the stages [m/s]
!>   terms                  terms of the equations of the last iteration
!>   speed_scale [m/s]      largest slip speed of the stages
!>   iterations, solved     number of iterations; whether they converged
!>
!> A step to a stop has its length as an unknown in place of the slip speed at its end, which is known: the order of the linear
!> systems stays the same. Convergence is that of the slip velocity. An unknown on which it does not depend directly converges with
!> it.
module dst_newton_kernels
  use dst_kinds, only: wp
  use dst_collocation, only: collocation_t
  use dst_drive, only: drive_segment_t
  use dst_slip_system, only: slip_system_t, stage_terms_t
  use dst_state, only: state_t
  implicit none
  private

  public :: solve_stages

  integer, parameter :: max_iterations = 10
  !> Change of the slip velocity, relative to itself, beyond which Newton's method does not converge any more. Twice: no change on
  !> Fig. 3.
  real(wp), parameter :: hopeless = 1.0e6_wp
  !> Assumed constant of the quadratic convergence before it is known. Twice: 0.6 % more iterations.
  real(wp), parameter :: first_convergence = 10.0_wp
  !> An increment that grows by this factor after the second ends the iteration. Twice: no change.
  real(wp), parameter :: diverging = 2.0_wp
  !> Roundoff of the slip velocity in an iteration. Twice: no change.
  real(wp), parameter :: velocity_roundoff = 4.0_wp*epsilon(1.0_wp)
  !> No value this large is a step towards a solution, and its square would overflow.
  real(wp), parameter :: no_increment = 1.0e100_wp

contains

  !> The kernel for s stages, n components and m slip unknowns.
  subroutine solve_stages(s, n, m, system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, intent(in) :: s, n, m
    class(slip_system_t), intent(in) :: system
    type(collocation_t), intent(in) :: method
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    logical, intent(in) :: to_stop
    real(wp), intent(in) :: tolerance, own_speed(n)
    real(wp), intent(inout) :: step, y(s, m)
    real(wp), intent(out) :: u(s, n), velocity(s, n), velocity_y(s, n, m), increment(s, m), drive_velocity(s), speed_scale
    type(stage_terms_t), intent(inout) :: terms
    integer, intent(out) :: iterations
    logical, intent(out) :: solved

    select case (100*s + 10*n + m)
    case (311)
      call kernel_3_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case (322)
      call kernel_3_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case (511)
      call kernel_5_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case (522)
      call kernel_5_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case (711)
      call kernel_7_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case (722)
      call kernel_7_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
        increment, drive_velocity, terms, speed_scale, iterations, solved)
    case default
      call kernel_of_any_size(s, n, m, system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, &
        velocity_y, increment, drive_velocity, terms, speed_scale, iterations, solved)
    end select
  end subroutine solve_stages

  subroutine kernel_3_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 3, n = 1, m = 1
    include 'newton_kernel.inc'
  end subroutine kernel_3_1

  subroutine kernel_3_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 3, n = 2, m = 2
    include 'newton_kernel.inc'
  end subroutine kernel_3_2

  subroutine kernel_5_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 5, n = 1, m = 1
    include 'newton_kernel.inc'
  end subroutine kernel_5_1

  subroutine kernel_5_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 5, n = 2, m = 2
    include 'newton_kernel.inc'
  end subroutine kernel_5_2

  subroutine kernel_7_1(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 7, n = 1, m = 1
    include 'newton_kernel.inc'
  end subroutine kernel_7_1

  subroutine kernel_7_2(system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, velocity_y, &
    increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, parameter :: s = 7, n = 2, m = 2
    include 'newton_kernel.inc'
  end subroutine kernel_7_2

  subroutine kernel_of_any_size(s, n, m, system, method, drive, from, to_stop, tolerance, own_speed, step, y, u, velocity, &
    velocity_y, increment, drive_velocity, terms, speed_scale, iterations, solved)
    integer, intent(in) :: s, n, m
    include 'newton_kernel.inc'
  end subroutine kernel_of_any_size
end module dst_newton_kernels
