!> Radau IIA as an integrator: linear solver, order, dense output, location of events, convergence of Newton's method.
!>
!> Expected orders: 2 s - 1 at the end of a step and s + 1 inside it (Hairer & Wanner II, Sec. IV.5; Hairer, Norsett & Wanner I,
!> Thm. II.7.9 for collocation with the start as a further node).
program test_radau
  use checks, only: check, check_close, check_order, finish
  use random_numbers, only: start_random, uniform
  use scenes, only: fig3, fig3_slider, constant_friction, along_a_line, begin
  use dst_kinds, only: wp, pi, degree
  use dst_drive, only: drive_segment_t
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_collocation, only: collocation_t, radau_iia
  use dst_full_model, only: full_polar_t, full_smoothed_t, new_full_polar, new_full_smoothed
  use dst_interpolation, only: max_degree
  use dst_linear_solve, only: solve_in_place
  use dst_radau, only: radau_t, new_radau
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_slip_memory, only: slip_memory_t
  use dst_slip_system, only: max_unknowns
  use dst_state, only: state_t
  use dst_stepper, only: attempt_t
  use dst_motion, only: next_piece
  use dst_piece, only: piece_t, stick_begins, slip_begins
  implicit none

  interface
    !> LAPACK: solution of a general linear system.
    subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
      import :: wp
      integer, intent(in) :: n, nrhs, lda, ldb
      integer, intent(out) :: ipiv(*), info
      real(wp), intent(inout) :: a(lda, *), b(ldb, *)
    end subroutine dgesv
  end interface

  real(wp), parameter :: eps = epsilon(1.0_wp)
  integer, parameter :: stages(3) = [3, 5, 7]
  character(7), parameter :: methods(3) = ['radau5 ', 'radau9 ', 'radau13']
  integer :: i

  call start_random(3)
  call test_linear_solver()
  call test_singular_systems()
  do i = 1, 3
    call test_orders(trim(methods(i)), stages(i))
    call test_newton(trim(methods(i)), stages(i))
    call test_landing(trim(methods(i)), stages(i))
    call test_memory_of_slips(trim(methods(i)), stages(i))
    call test_first_events_of_fig3(trim(methods(i)))
    call test_events_along_a_line(trim(methods(i)))
  end do
  call finish()

contains

  !> A solution as good as LAPACK's: both by the residual, which pivoting keeps small.
  subroutine test_linear_solver()
    integer, parameter :: largest = 14
    real(wp) :: a(largest, largest), b(largest), x(largest), factors(largest, largest), expected(largest, 1), worst(0:2), error
    integer :: n, trial, pivots(largest), info, j
    logical :: singular, regular

    worst = 0.0_wp
    regular = .true.
    do n = 1, largest
      do trial = 1, 100
        do j = 1, n
          a(:n, j) = uniform(n, -1.0_wp, 1.0_wp)
        end do
        b(:n) = uniform(n, -1.0_wp, 1.0_wp)
        do j = 1, n
          ! Zeros on the diagonal: no elimination without an exchange of rows.
          if (modulo(trial, 3) == 1 .and. n > 1) a(j, j) = 0.0_wp
          if (modulo(trial, 3) < 2) cycle
          ! Rows of very different size, as with small and large inertia.
          a(j, :n) = a(j, :n)*10.0_wp**modulo(5*j, 13)
          b(j) = b(j)*10.0_wp**modulo(5*j, 13)
        end do
        factors(:n, :n) = a(:n, :n)
        expected(:n, 1) = b(:n)
        call dgesv(n, 1, factors(:n, :n), n, pivots, expected(:n, :), n, info)
        if (info /= 0) cycle
        x(:n) = b(:n)
        call solve(n, a(:n, :n), x(:n), singular)
        regular = regular .and. .not. singular
        error = backward_error(n, a(:n, :n), x(:n), b(:n))
        if (modulo(trial, 3) == 2) error = maxval(abs(x(:n) - expected(:n, 1))/max(maxval(abs(expected(:n, 1))), 1.0e-300_wp)) &
          /condition(n, a(:n, :n))
        worst(modulo(trial, 3)) = max(worst(modulo(trial, 3)), error)
      end do
    end do
    call check('linear solver: regular systems are regular', regular)
    call check_close('linear solver: random systems', worst(0), 0.0_wp, 1.0e-13_wp)
    call check_close('linear solver: systems that need pivoting', worst(1), 0.0_wp, 1.0e-13_wp)
    call check_close('linear solver: as dgesv for rows of different size', worst(2), 0.0_wp, 1.0e-13_wp)
  end subroutine test_linear_solver

  subroutine solve(n, a, b, singular)
    integer, intent(in) :: n
    real(wp), intent(in) :: a(n, n)
    real(wp), intent(inout) :: b(n)
    logical, intent(out) :: singular
    real(wp) :: destroyed(n, n)

    destroyed = a
    call solve_in_place(n, destroyed, b, singular)
  end subroutine solve

  !> Residual over the effect of roundoff in the matrix alone.
  pure real(wp) function backward_error(n, a, x, b)
    integer, intent(in) :: n
    real(wp), intent(in) :: a(n, n), x(n), b(n)

    backward_error = maxval(abs(matmul(a, x) - b))/(maxval(sum(abs(a), dim=2))*maxval(abs(x)) + maxval(abs(b)))
  end function backward_error

  !> Condition number of the system with rows scaled to the same size, in the maximum norm; by dgesv.
  real(wp) function condition(n, a)
    integer, intent(in) :: n
    real(wp), intent(in) :: a(n, n)
    real(wp) :: scaled(n, n), factors(n, n), inverse(n, n)
    integer :: j, pivots(n), info

    inverse = 0.0_wp
    do j = 1, n
      scaled(j, :) = a(j, :)/maxval(abs(a(j, :)))
      inverse(j, j) = 1.0_wp
    end do
    factors = scaled
    call dgesv(n, n, factors, n, pivots, inverse, n, info)
    condition = maxval(sum(abs(scaled), dim=2))*maxval(sum(abs(inverse), dim=2))
  end function condition

  subroutine test_singular_systems()
    !> Zero; a zero column; a multiple of a column.
    real(wp), parameter :: a(3, 3, 3) = reshape([[0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], &
      [1.0_wp, 2.0_wp, 3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 3.0_wp, 1.0_wp, 2.0_wp], &
      [1.0_wp, 2.0_wp, 4.0_wp, 2.0_wp, 4.0_wp, 8.0_wp, 3.0_wp, 1.0_wp, 2.0_wp]], [3, 3, 3])
    real(wp) :: b(3)
    logical :: singular
    integer :: k

    do k = 1, 3
      b = 1.0_wp
      call solve(3, a(:, :, k), b, singular)
      call check('linear solver: singular', singular)
    end do
  end subroutine test_singular_systems

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

    steps = sum(pack([32, 16, 8], stages == stage_count))
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
      call check_order(name//': '//what(k), worst(k, 1), worst(k, 2), 2.0_wp, real(2*stage_count - 1, wp), &
        merge(0.6_wp, 1.0_wp, k == 1))
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

  !> Slips that change by equal differences are predicted, however they were divided into steps; others are not, nor times long
  !> after their end, nor a motion that follows no release.
  subroutine test_memory_of_slips(name, stage_count)
    character(*), intent(in) :: name
    integer, intent(in) :: stage_count
    type(slip_memory_t) :: memory
    type(collocation_t) :: method
    real(wp) :: y(stage_count, 2), expected(stage_count, 2)
    logical :: known

    method = radau_iia(stage_count)
    call slide(memory, method, 1.0_wp, [0.5_wp, 0.3_wp, 0.4_wp])
    call slide(memory, method, 1.1_wp, [0.4_wp, 0.4_wp, 0.3_wp])
    call slide(memory, method, 1.2_wp, [0.35_wp])
    call memory%guess(method%grid, stage_count, 2, 0.5_wp, [slip_unknown(1.2_wp, 1, 0.35_wp), 7.0_wp], y, known)
    call check(name//': alike slips are remembered', known)
    expected(:, 1) = slip_unknown(1.2_wp, 1, 0.35_wp + 0.5_wp*method%grid%node(1:stage_count))
    expected(:, 2) = 7.0_wp - slip_unknown(1.2_wp, 2, 0.35_wp) &
      + slip_unknown(1.2_wp, 2, 0.35_wp + 0.5_wp*method%grid%node(1:stage_count))
    call check_close(name//': the next one is foretold', maxval(abs(y - expected)), 0.0_wp, 1.0e-13_wp)
    call memory%guess(method%grid, stage_count, 2, 1.5_wp, [0.0_wp, 0.0_wp], y, known)
    call check(name//': not what comes long after their end', .not. known)
    call memory%forget()
    call memory%guess(method%grid, stage_count, 2, 0.5_wp, [0.0_wp, 0.0_wp], y, known)
    call check(name//': nor what follows no release', .not. known)
    call slide(memory, method, 2.0_wp, [0.5_wp, 0.5_wp])
    call memory%begin()
    call memory%guess(method%grid, stage_count, 2, 0.5_wp, [0.0_wp, 0.0_wp], y, known)
    call check(name//': nor after slips that are not alike', .not. known)
  end subroutine test_memory_of_slips

  !> Store a slip of this size in steps of these lengths.
  subroutine slide(memory, method, size_of_slip, step)
    type(slip_memory_t), intent(inout) :: memory
    type(collocation_t), intent(in) :: method
    real(wp), intent(in) :: size_of_slip, step(:)
    real(wp) :: nodal(0:max_degree, max_unknowns)
    integer :: j, k

    call memory%begin()
    do j = 1, size(step)
      nodal = 0.0_wp
      do k = 1, 2
        nodal(0:method%stages, k) = slip_unknown(size_of_slip, k, sum(step(:j - 1)) + step(j)*method%grid%node(0:method%stages))
      end do
      call memory%keep(step(j), nodal)
    end do
  end subroutine slide

  !> A slip unknown as a cubic in time.
  elemental real(wp) function slip_unknown(size_of_slip, unknown, time)
    real(wp), intent(in) :: size_of_slip, time
    integer, intent(in) :: unknown

    slip_unknown = size_of_slip*time**unknown*(1.3_wp - time) + real(unknown, wp)
  end function slip_unknown

  !> Advance to the next event and check its kind.
  subroutine next_event(simulation, kind, name)
    type(simulation_t), intent(inout) :: simulation
    integer, intent(in) :: kind
    character(*), intent(in) :: name
    type(error_t), allocatable :: error

    do
      call next_piece(simulation%motion, simulation%other, error)
      if (allocated(error) .or. simulation%motion%finished() .or. simulation%motion%piece%event /= 0) exit
    end do
    call check(name//': the event that is due', .not. allocated(error) .and. simulation%motion%piece%event == kind)
  end subroutine next_event

  !> It stops after the time that friction alone needs, m int dv/F(v), and is released at t_1 after the spring is loaded.
  subroutine test_first_events_of_fig3(name)
    character(*), intent(in) :: name
    type(simulation_t) :: simulation
    real(wp) :: v, stop_time, release_time, first_slip
    real(wp), parameter :: limit = 1.5_wp, drop = 0.5_wp, v_f = 0.01_wp

    call begin(fig3(1.0_wp, name, 1.0e-10_wp), simulation)
    v = 1.0e-9_wp
    stop_time = 0.25_wp*v_f/limit*log((limit*exp(v/v_f) + drop)/(limit + drop))
    call next_event(simulation, stick_begins, name//', Fig. 3, stop')
    associate (now => simulation%motion%piece%to)
      ! The contribution of the spring is k V t/F_0 = 1e-9 of it.
      call check_close(name//', Fig. 3: first stop', now%time, stop_time, 2.0e-8_wp*stop_time)
      call check_close(name//', Fig. 3: at rest', maxval(abs(now%y)), 0.0_wp, 0.0_wp)
      first_slip = now%position
      call check_close(name//', Fig. 3: slipped before', first_slip, 0.5_wp*v*stop_time, 1.0e-6_wp*v*stop_time)
      call next_event(simulation, slip_begins, name//', Fig. 3, release')
      release_time = 2.0_wp/(1.0e-3_wp*hypot(1.0e3_wp*cos(degree), 1.0e7_wp*sin(degree)))
      call check_close(name//', Fig. 3: first release', now%time, release_time, 1.0e-12_wp*release_time)
    end associate
  end subroutine test_first_events_of_fig3

  !> Constant friction along a line is piecewise harmonic: z = u - F_0/k obeys z'' = -omega^2 z and v = V - z' while it slips
  !> forwards. Thrown forwards at 20 V, it stops where z' = V, and is released after (F_0/k - u)/V.
  subroutine test_events_along_a_line(name)
    character(*), intent(in) :: name
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    real(wp) :: omega, z, amplitude, phase, stop_time, u
    real(wp), parameter :: v = 1.0e-3_wp

    scene = constant_friction(along_a_line(fig3(10.0_wp, name, 1.0e-10_wp)))
    scene%elongation_x = 1.5e-3_wp
    scene%velocity_ratio = 20.0_wp
    omega = sqrt(scene%stiffness_x/scene%mass)
    z = scene%elongation_x - 2.0e-3_wp
    ! z = amplitude cos(omega t + phase) with z' = V - 20 V at the start.
    amplitude = hypot(z, 19.0_wp*v/omega)
    phase = atan2(19.0_wp*v/omega, z)
    ! z' = V: sin(omega t + phase) = -V/(amplitude omega), the first one after the start.
    stop_time = (pi + asin(v/(amplitude*omega)) - phase)/omega
    u = 2.0e-3_wp + amplitude*cos(omega*stop_time + phase)
    call begin(scene, simulation)
    associate (now => simulation%motion%piece%to)
      call next_event(simulation, stick_begins, name//', along a line, stop')
      call check_close(name//', along a line: stop', now%time, stop_time, 1.0e-9_wp*stop_time)
      call check(name//', along a line: the step that finds the stop ends in it', &
        now%time - simulation%motion%piece%from%time > 1.0e-9_wp*stop_time)
      call check_close(name//', along a line: elongation there', now%u(1), u, 1.0e-10_wp*abs(u))
      call check_close(name//', along a line: position there', now%position, v*stop_time - u, 1.0e-10_wp*abs(u))
      call next_event(simulation, slip_begins, name//', along a line, release')
      call check_close(name//', along a line: release', now%time, stop_time + (2.0e-3_wp - u)/v, 1.0e-9_wp*now%time)
      call check_close(name//', along a line: elongation at release', now%u(1), 2.0e-3_wp, 1.0e-15_wp*2.0e-3_wp)
    end associate
  end subroutine test_events_along_a_line
end program test_radau
