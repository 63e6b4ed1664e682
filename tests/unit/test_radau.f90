!> Radau IIA as an integrator: linear solver, order, dense output, convergence of Newton's method.
!>
!> Expected orders: 2 s - 1 at the end of a step and s + 1 inside it (Hairer & Wanner II, Sec. IV.5; Hairer, Norsett & Wanner I,
!> Thm. II.7.9 for collocation with the start as a further node).
program test_radau
  use checks, only: check, check_close, check_order, finish
  use random_numbers, only: start_random, uniform
  use scenes, only: fig3_slider
  use dst_kinds, only: wp
  use dst_drive, only: drive_segment_t
  use dst_friction, only: new_friction_law
  use dst_full_model, only: full_polar_t, full_smoothed_t, new_full_polar, new_full_smoothed
  use dst_linear_solve, only: solve_in_place
  use dst_radau, only: radau_t, new_radau
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_state, only: state_t
  use dst_stepper, only: attempt_t
  use dst_piece, only: piece_t
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: stages(3) = [3, 5, 7]
  character(7), parameter :: methods(3) = ['radau5 ', 'radau9 ', 'radau13']
  integer :: i

  call start_random(3)
  do i = 1, 3
    call test_orders(trim(methods(i)), stages(i))
    call test_newton(trim(methods(i)), stages(i))
    call test_landing(trim(methods(i)), stages(i))
  end do
  call test_linear_solver()
  call finish()

contains

  !> Small residuals, also where rows must be exchanged; a system with a column of zeros is singular.
  subroutine test_linear_solver()
    integer, parameter :: largest = 14, trials = 100
    real(wp) :: a(largest, largest), b(largest), x(largest), worst
    real(wp), allocatable :: destroyed(:, :)
    integer :: n, trial, j
    logical :: singular, told

    worst = 0.0_wp
    told = .true.
    do n = 2, largest
      do trial = 1, trials
        do j = 1, n
          a(:n, j) = uniform(n, -1.0_wp, 1.0_wp)
          ! No elimination without an exchange of rows.
          if (modulo(trial, 2) == 1) a(j, j) = 0.0_wp
        end do
        if (trial == trials) a(:n, n) = 0.0_wp
        b(:n) = uniform(n, -1.0_wp, 1.0_wp)
        x(:n) = b(:n)
        destroyed = a(:n, :n)
        call solve_in_place(n, destroyed, x(:n), singular)
        told = told .and. (singular .eqv. trial == trials)
        if (singular) cycle
        worst = max(worst, maxval(abs(matmul(a(:n, :n), x(:n)) - b(:n))) &
          /(maxval(sum(abs(a(:n, :n)), dim=2))*maxval(abs(x(:n))) + maxval(abs(b(:n)))))
      end do
    end do
    call check('linear solver: what is singular, and nothing else', told)
    call check_close('linear solver: residuals', worst, 0.0_wp, 1.0e-13_wp)
  end subroutine test_linear_solver

  !> A scene without events and without stiffness: the smoothed contact with a smoothing velocity as large as the drive's.
  function smooth_system() result(system)
    type(full_smoothed_t) :: system
    type(slider_t) :: slider

    slider%mass = 0.25_wp
    slider%stiffness = [4.0e2_wp, 1.0e3_wp]
    slider%along = cos_sin_degrees(20.0_wp)
    slider%smoothing = 5.0e-2_wp**2
    call new_friction_law('weakening', 0.20_wp, 0.15_wp, 0.10_wp, 1.0_wp, slider%law)
    system = new_full_smoothed(slider)
  end function smooth_system

  !> The motion after `duration` in equal steps of any size, and in the middle of the last step by dense output.
  subroutine integrate(stage_count, steps, start, duration, last, inside)
    integer, intent(in) :: stage_count, steps
    type(state_t), intent(in) :: start
    real(wp), intent(in) :: duration
    type(state_t), intent(out) :: last, inside
    type(full_smoothed_t) :: system
    type(radau_t) :: stepper
    type(drive_segment_t) :: drive
    type(state_t) :: from
    type(piece_t) :: piece
    type(attempt_t) :: outcome
    integer :: k

    system = smooth_system()
    drive = drive_segment_t(velocity=5.0e-2_wp, acceleration=5.0e-3_wp)
    ! So small that Newton's method continues to roundoff.
    stepper = new_radau(stage_count, 2, 2, 1.0e-14_wp)
    call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    last = start
    do k = 1, steps
      from = last
      call stepper%attempt(system, drive, from, duration/real(steps, wp), last, outcome)
      if (.not. outcome%solved) error stop 'a step of the smooth scene is not solved'
      call stepper%accept()
    end do
    piece%from = from
    piece%drive = drive
    call piece%obey(system)
    call piece%path%take(stepper)
    inside = piece%inside(0.5_wp)
  end subroutine integrate

  !> Distance of two motions in the norm of the energy [sqrt(J)].
  real(wp) function distance(a, b)
    type(state_t), intent(in) :: a, b
    type(full_smoothed_t) :: system

    system = smooth_system()
    distance = sqrt(sum(system%slider%stiffness*(a%u - b%u)**2) + system%slider%mass*sum((a%y - b%y)**2))
  end function distance

  !> Kinetic and elastic energy [J].
  real(wp) function energy(motion)
    type(state_t), intent(in) :: motion

    energy = 0.5_wp*distance(motion, state_t())**2
  end function energy

  !> The error is the mean over several starts: at a single one the leading term may happen to vanish.
  subroutine test_orders(name, stage_count)
    character(*), intent(in) :: name
    integer, intent(in) :: stage_count
    integer, parameter :: starts = 24
    type(state_t) :: start, exact, found, unused
    real(wp), parameter :: duration = 0.2_wp
    character(*), parameter :: what(4) = [character(21) :: 'state', 'X', 'work of the drive', 'work against friction']
    real(wp) :: worst(4, 2), inside(2)
    integer :: steps, trial, k

    steps = sum(pack([32, 20, 8], stages == stage_count))
    worst = 0.0_wp
    inside = 0.0_wp
    do trial = 1, starts
      start = state_t(u=uniform(2, -3.0e-4_wp, 3.0e-4_wp), y=[[4.0e-2_wp, 0.0_wp] + uniform(2, -1.0e-2_wp, 1.0e-2_wp), 0.0_wp])
      call integrate(7, 40, start, duration, exact, unused)
      call check_close(name//': energy balance', exact%drive_work - exact%friction_work, energy(exact) - energy(start), &
        1.0e-12_wp*exact%drive_work)
      do k = 1, 2
        call integrate(stage_count, k*steps, start, duration, found, unused)
        worst(:, k) = worst(:, k) + [distance(found, exact), abs(found%position - exact%position), &
          abs(found%drive_work - exact%drive_work), abs(found%friction_work - exact%friction_work)]
      end do
      ! Dense output half way through one step: a polynomial of degree s through the start and the stages.
      do k = 1, 2
        call integrate(7, 10, start, 0.5_wp*dense_step(stage_count)/real(k, wp), exact, unused)
        call integrate(stage_count, 1, start, dense_step(stage_count)/real(k, wp), unused, found)
        call check_close(name//': dense output is half way', found%time, exact%time, 4.0_wp*eps*exact%time)
        inside(k) = inside(k) + distance(found, exact)
      end do
    end do
    do k = 1, size(what)
      ! Order 13 shows its last digit only where errors are roundoff: with few steps it is 12 and a bit.
      call check_order(name//': '//what(k), worst(k, 1), worst(k, 2), 2.0_wp, real(2*stage_count - 1, wp), &
        merge(0.6_wp, 1.0_wp, k == 1)*merge(2.0_wp, 1.0_wp, stage_count == 7))
    end do
    call check_order(name//': dense output', inside(1), inside(2), 2.0_wp, real(stage_count + 1, wp), 0.5_wp)
  end subroutine test_orders

  !> A step that is small enough to show the order of the dense output and large enough that it is above roundoff [s].
  pure real(wp) function dense_step(stage_count)
    integer, intent(in) :: stage_count

    dense_step = 1.0e-3_wp*real(stage_count - 2, wp)
  end function dense_step

  !> Quadratic convergence: each iteration doubles the digits, so that ten digits more cost about one iteration or two.
  subroutine test_newton(name, stage_count)
    character(*), intent(in) :: name
    integer, intent(in) :: stage_count
    real(wp), parameter :: rtol(4) = [1.0e-3_wp, 1.0e-6_wp, 1.0e-9_wp, 1.0e-13_wp], within(3) = [1.0e-3_wp, 1.0e-7_wp, 1.0e-10_wp]
    type(full_smoothed_t) :: system
    type(radau_t) :: stepper
    type(state_t) :: start, last(4), beyond
    type(attempt_t) :: outcome
    integer :: k, iterations(4)

    system = smooth_system()
    start = state_t(u=[3.0e-4_wp, 1.0e-4_wp], y=[4.0e-2_wp, 1.0e-2_wp, 0.0_wp])
    do k = 1, 4
      stepper = new_radau(stage_count, 2, 2, rtol(k))
      call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
      call stepper%attempt(system, drive_segment_t(velocity=1.0e-2_wp), start, 0.01_wp, last(k), outcome)
      call check(name//': Newton converges', outcome%solved)
      iterations(k) = int(stepper%count%newton)
    end do
    ! No value this large is a solution, and it must not be accepted as one.
    start%u = 1.0e120_wp
    call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    call stepper%attempt(system, drive_segment_t(velocity=1.0e-2_wp), start, 0.01_wp, beyond, outcome)
    call check(name//': Newton gives up where nothing can be solved', .not. outcome%solved)
    call check(name//': Newton needs more than one iteration', iterations(1) >= 2)
    call check(name//': Newton is fast', iterations(4) <= 6)
    call check(name//': Newton is quadratic', all(iterations(2:) - iterations(:3) <= 1))
    do k = 1, 3
      call check_close(name//': Newton, as asked for', norm2(last(k)%y - last(4)%y), 0.0_wp, within(k)*norm2(last(4)%y))
    end do
  end subroutine test_newton

  !> A step that is solved for its length ends where the slip speed vanishes, and equals the step of that length; a guess with an
  !> error of a fifth costs no more than a few iterations. The drive accelerates, so that the motion depends on the length, too.
  subroutine test_landing(name, stage_count)
    character(*), intent(in) :: name
    integer, intent(in) :: stage_count
    type(full_polar_t) :: system
    type(slider_t) :: slider
    type(radau_t) :: stepper
    type(drive_segment_t) :: drive
    type(state_t) :: start, stop, same
    type(attempt_t) :: outcome
    real(wp) :: length

    slider = fig3_slider(20.0_wp, 1.0e4_wp)
    slider%stiffness(1) = 4.0e2_wp
    system = new_full_polar(slider)
    drive = drive_segment_t(velocity=1.0e-2_wp, acceleration=10.0_wp)
    start = state_t(u=[1.0e-3_wp, 2.0e-5_wp], y=[1.0e-2_wp, 0.2_wp, 0.0_wp])
    stepper = new_radau(stage_count, 2, 2, 1.0e-12_wp)
    call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    call stepper%attempt(system, drive, start, 2.0e-3_wp, stop, outcome, to_stop=.true.)
    length = stepper%step
    call check(name//': a step to a stop is solved', outcome%solved)
    call check(name//': its length is another than the guess', abs(length - 2.0e-3_wp) > 1.0e-4_wp)
    call check(name//': it ends at rest', .not. abs(stop%y(1)) > 0.0_wp)
    call check_close(name//': its end is as far away', stop%time - start%time, length, 4.0_wp*eps*length)
    call check(name//': in a few iterations', stepper%count%newton <= 8)
    call check(name//': it is counted', stepper%count%landings == 1)
    call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    call stepper%attempt(system, drive, start, length, same, outcome)
    call check(name//': the step of that length is solved', outcome%solved)
    call check_close(name//': it stops too', same%y(1), 0.0_wp, 1.0e-12_wp*start%y(1))
    call check_close(name//': in the same direction', same%y(2), stop%y(2), 1.0e-9_wp)
    call check_close(name//': at the same place', norm2(same%u - stop%u), 0.0_wp, 1.0e-14_wp)
    call check_close(name//': with the same work', same%friction_work, stop%friction_work, 1.0e-11_wp*stop%friction_work)
    ! It is pulled forwards so hard that it never stops.
    start%u(1) = 0.1_wp
    call stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    call stepper%attempt(system, drive, start, 2.0e-3_wp, stop, outcome, to_stop=.true.)
    call check(name//': where there is no stop ahead, none is found', .not. outcome%solved)
  end subroutine test_landing

end program test_radau
