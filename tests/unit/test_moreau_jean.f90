!> The Moreau-Jean scheme: its order, exact rest, energy, symmetry, and steps of any length.
!>
!> Expected orders (theta = 1/2, friction at the end of a step): 2 without friction or with a constant friction force,
!> 1 where the friction turns or weakens.
program test_moreau_jean
  use checks, only: check, check_close, check_order, finish
  use random_numbers, only: start_random, uniform, log_uniform
  use scenes, only: fig3, constant_friction, along_a_line, begin, go_to, energy, velocity
  use dst_kinds, only: wp, pi
  use dst_friction, only: friction_law_t, new_friction_law
  use dst_moreau_jean, only: speed_after
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_motion, only: next_piece
  use dst_piece, only: stick_begins, slip_begins, slips
  implicit none

  real(wp), parameter :: v = 1.0e-3_wp

  call start_random(7)
  call test_equation_of_a_step()
  call test_which_solution()
  call test_order_without_friction()
  call test_counts()
  call test_order_with_constant_force()
  call test_order_with_friction()
  call test_first_stick()
  call test_hold()
  call test_stop_along_a_line()
  call test_fig3()
  call test_mirror()
  call test_energy()
  call test_long_steps()
  call finish()

contains

  !> Fig. 3 with this method and step.
  function steps_of(step, t_end) result(scene)
    real(wp), intent(in) :: step, t_end
    type(scene_t) :: scene

    scene = fig3(t_end, 'moreau_jean', 0.0_wp)
    scene%step = step
  end function steps_of

  !> u and w at the end of a scene.
  function final_state(scene) result(state)
    type(scene_t), intent(in) :: scene
    real(wp) :: state(4)
    type(simulation_t) :: simulation
    logical :: sound

    call begin(scene, simulation)
    call go_to(simulation, huge(1.0_wp), sound)
    call check('runs to the end', sound .and. abs(simulation%motion%piece%to%time - scene%t_end) <= 0.0_wp)
    state = [simulation%motion%piece%to%u, velocity(simulation)]
  end function final_state

  !> A w + F(r) w/r = b with |w| = r, or |b| <= F_0; for both laws, any loads, and steps from short to far too long.
  subroutine test_equation_of_a_step()
    class(friction_law_t), allocatable :: law
    real(wp) :: mu(2), inertia(2), load(2), w(2), speed, before, force(1), slope(1), worst
    integer :: trial, iterations, most
    logical :: rest_is_allowed

    worst = 0.0_wp
    most = 0
    rest_is_allowed = .true.
    do trial = 1, 20000
      mu = uniform(2, 0.0_wp, 1.0_wp)
      call new_friction_law(trim(merge('weakening', 'constant ', modulo(trial, 2) == 0)), mu(1), mu(2), &
        log_uniform(1.0e-5_wp, 10.0_wp), merge(0.0_wp, 10.0_wp, modulo(trial, 10) == 0), law)
      inertia = [log_uniform(1.0e-3_wp, 1.0e8_wp), log_uniform(1.0e-3_wp, 1.0e8_wp)]
      load = log_uniform(1.0e-3_wp, 1.0e4_wp)*uniform(2, -1.0_wp, 1.0_wp)
      before = merge(0.0_wp, log_uniform(1.0e-9_wp, 10.0_wp), modulo(trial, 3) == 0)
      call speed_after(law, inertia, load, before, speed, iterations)
      most = max(most, iterations)
      if (speed > 0.0_wp) then
        call law%evaluate(1, [speed], force, slope)
        w = speed*load/(inertia*speed + force(1))
        ! The equation is satisfied by construction; the zero must give |w| = r, up to the roundoff of F(r).
        worst = max(worst, abs(norm2(w) - speed)*minval(inertia + force(1)/speed)/norm2(load))
      else
        rest_is_allowed = rest_is_allowed .and. norm2(load) <= law%static_limit
      end if
    end do
    call check_close('equation of a step: |w| = r', worst, 0.0_wp, 1.0e-12_wp)
    call check('equation of a step: rest within the static limit', rest_is_allowed)
    call check('equation of a step: found in time', most < 120)
  end subroutine test_equation_of_a_step

  !> F = 1 + exp(-10 r), A = 1, b = 1.9: rest (b < 2), and two speeds, (a r + F = b) at 0.0127… and 0.8999….
  subroutine test_which_solution()
    class(friction_law_t), allocatable :: law
    real(wp) :: speed, slow
    integer :: iterations
    real(wp), parameter :: one(2) = [1.0_wp, 1.0_wp], load(2) = [1.9_wp, 0.0_wp]

    call new_friction_law('weakening', 0.2_wp, 0.1_wp, 0.1_wp, 10.0_wp, law)
    call speed_after(law, one, load, 0.0_wp, speed, iterations)
    call check('of several solutions: rest stays', .not. speed > 0.0_wp)
    call speed_after(law, one, load, 0.005_wp, speed, iterations)
    call check('of several solutions: slow slip falls to rest', .not. speed > 0.0_wp)
    call speed_after(law, one, load, 0.05_wp, speed, iterations)
    call check_close('of several solutions: faster slip rises', speed + exp(-10.0_wp*speed), 0.9_wp, 1.0e-14_wp)
    call check('of several solutions: to the upper one', speed > 0.5_wp)
    slow = speed
    call speed_after(law, one, load, 5.0_wp, speed, iterations)
    call check_close('of several solutions: fast slip falls to the upper one', speed, slow, 1.0e-14_wp)
  end subroutine test_which_solution

  !> mu = 0: two oscillators that the drive starts, u = (V e/omega) sin(omega t), w = V e (1 - cos(omega t)).
  subroutine test_order_without_friction()
    type(scene_t) :: scene
    real(wp) :: omega(2), along(2), exact(4), state(4), errors(3)
    integer :: i
    real(wp), parameter :: t = 0.1_wp

    do i = 1, 3
      scene = steps_of(1.0e-3_wp/2**i, t)
      scene%mu_0 = 0.0_wp
      scene%mu_inf = 0.0_wp
      scene%velocity_ratio = 0.0_wp
      scene%stiffness_y = 4.0e3_wp
      scene%misalignment_deg = 30.0_wp
      along = [cos(pi/6.0_wp), sin(pi/6.0_wp)]
      omega = sqrt([scene%stiffness_x, scene%stiffness_y]/scene%mass)
      exact = [v*along/omega*sin(omega*t), v*along*(1.0_wp - cos(omega*t))]
      state = final_state(scene)
      errors(i) = norm2(state - exact)
    end do
    call check_order('without friction', errors(1), errors(2), 2.0_wp, 2.0_wp, 0.1_wp)
    call check_order('without friction', errors(2), errors(3), 2.0_wp, 2.0_wp, 0.1_wp)
  end subroutine test_order_without_friction

  !> One equation in each step. Newton's method solves it in a few iterations, and needs at least one evaluation if there is slip.
  subroutine test_counts()
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    logical :: sound

    scene = steps_of(1.0e-4_wp, 0.1_wp)
    scene%misalignment_deg = 30.0_wp
    scene%elongation_x = 8.0e-3_wp
    call begin(scene, simulation)
    call go_to(simulation, huge(1.0_wp), sound)
    associate (count => simulation%motion%work())
      call check('counts: steps', count%steps == 1000)
      call check('counts: an equation a step', count%rhs == count%steps)
      call check('counts: iterations', count%newton > count%steps/2 .and. count%newton < 10*count%steps)
      call check('counts: no matrix', count%jacobians == 0 .and. count%factorisations == 0)
    end associate
  end subroutine test_counts

  !> Sliding along a line against constant friction: u_x - F_0/k_x oscillates about 0 until the object stops.
  subroutine test_order_with_constant_force()
    real(wp) :: omega, amplitude, phase, exact(4), errors(3), state(4)
    type(scene_t) :: scene
    integer :: i
    real(wp), parameter :: t = 0.005_wp

    do i = 1, 3
      scene = along_the_soft_axis(1.0e-3_wp/2**i, t)
      call oscillation(scene, omega, amplitude, phase)
      exact = [2.0e-3_wp + amplitude*cos(omega*t + phase), 0.0_wp, v + amplitude*omega*sin(omega*t + phase), 0.0_wp]
      state = final_state(scene)
      errors(i) = norm2(state - exact)
    end do
    call check_order('constant force', errors(1), errors(2), 2.0_wp, 2.0_wp, 0.1_wp)
    call check_order('constant force', errors(2), errors(3), 2.0_wp, 2.0_wp, 0.1_wp)
  end subroutine test_order_with_constant_force

  !> Friction that turns and weakens, before any stop, compared with radau13.
  subroutine test_order_with_friction()
    type(scene_t) :: scene
    real(wp) :: errors(3), reference(4), state(4)
    integer :: i
    real(wp), parameter :: t = 0.01_wp

    scene = turning(fig3(t, 'radau13', 1.0e-12_wp))
    reference = final_state(scene)
    do i = 1, 3
      scene = turning(steps_of(1.0e-4_wp/2**i, t))
      state = final_state(scene)
      errors(i) = norm2(state - reference)
    end do
    call check_order('with friction', errors(1), errors(2), 2.0_wp, 1.0_wp, 0.1_wp)
    call check_order('with friction', errors(2), errors(3), 2.0_wp, 1.0_wp, 0.1_wp)
  end subroutine test_order_with_friction

  !> Loaded across the drive, so that the friction turns at some 10 mm/s.
  function turning(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%stiffness_y = 4.0e3_wp
    changed%misalignment_deg = 20.0_wp
    changed%velocity_ratio = 30.0_wp
    changed%elongation_x = 2.0e-3_wp
    changed%elongation_y = -4.0e-4_wp
  end function turning

  !> Fig. 3 from rest: exactly at rest, u = V t e, until the step in which |K u| reaches F_0, at 11.46 ms.
  subroutine test_first_stick()
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    logical :: sound, at_rest
    real(wp), parameter :: step = 1.0e-5_wp
    real(wp) :: release_time

    scene = steps_of(step, 1.0_wp)
    scene%velocity_ratio = 0.0_wp
    call begin(scene, simulation)
    associate (motion => simulation%motion)
      call check('first stick: begins', motion%contact /= slips .and. motion%piece%event == stick_begins)
      release_time = 2.0_wp/(v*norm2(motion%slider%stiffness*motion%slider%along))
      at_rest = .true.
      do
        call go_to(simulation, motion%piece%to%time + 0.5_wp*step, sound)
        if (motion%piece%event == slip_begins .or. .not. sound) exit
        at_rest = at_rest .and. motion%piece%contact /= slips .and. .not. any(abs(motion%piece%to%y) > 0.0_wp)
        if (motion%piece%to%time > 2.0_wp*release_time) exit
      end do
      call check('first stick: no slip at all', at_rest)
      call check('first stick: elongation', all(abs(motion%piece%from%u - v*motion%piece%from%time*motion%slider%along) &
        <= 1.0e-12_wp*abs(motion%piece%from%u)))
      ! A step uses the load at its middle, and records the slip at its end.
      call check_close('first stick: release', motion%piece%to%time, release_time + 0.5_wp*step, 1.01_wp*step)
    end associate
  end subroutine test_first_stick

  !> A drive that stops: the object stops, and then nothing changes any more, to the last bit.
  subroutine test_hold()
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    logical :: sound, unchanged
    real(wp) :: u(2), position

    scene = steps_of(1.0e-4_wp, 2.0_wp)
    scene%drive_time = [0.0_wp, 0.5_wp, 0.5_wp]
    scene%drive_velocity = [v, v, 0.0_wp]
    call begin(scene, simulation)
    associate (now => simulation%motion%piece%to)
      call go_to(simulation, 1.0_wp, sound)
      call check('hold: at rest', sound .and. simulation%motion%contact /= slips)
      u = now%u
      position = now%position
      unchanged = .true.
      do while (.not. simulation%motion%finished() .and. sound)
        call go_to(simulation, now%time + 0.5e-4_wp, sound)
        unchanged = unchanged .and. .not. any(abs([now%u - u, now%y, now%position - position]) > 0.0_wp)
      end do
      call check('hold: nothing moves', unchanged .and. sound)
    end associate
  end subroutine test_hold

  !> phi = 0: the stop and the elongation there have a closed form; nothing ever moves across.
  subroutine test_stop_along_a_line()
    type(simulation_t) :: simulation
    real(wp) :: omega, amplitude, phase, stop_time
    real(wp), parameter :: step = 1.0e-6_wp
    logical :: sound, straight

    call begin(along_the_soft_axis(step, 1.0_wp), simulation)
    call oscillation(simulation%scene, omega, amplitude, phase)
    stop_time = (pi + asin(v/(amplitude*omega)) - phase)/omega
    straight = .true.
    associate (motion => simulation%motion)
      do
        call go_to(simulation, motion%piece%to%time + 0.5_wp*step, sound)
        straight = straight .and. .not. (abs(motion%piece%to%u(2)) > 0.0_wp .or. abs(motion%piece%to%y(2)) > 0.0_wp)
        if (motion%piece%event == stick_begins .or. motion%finished() .or. .not. sound) exit
      end do
      call check('along a line: nothing across', straight)
      call check_close('along a line: stop', motion%piece%to%time, stop_time, 1.01_wp*step)
      call check_close('along a line: elongation there', motion%piece%to%u(1), &
        2.0e-3_wp + amplitude*cos(omega*stop_time + phase), 2.0_wp*v*step)
      call go_to(simulation, huge(1.0_wp), sound)
    end associate
  end subroutine test_stop_along_a_line

  !> Sliding at 20 V against constant friction, at phi = 0.
  function along_the_soft_axis(step, t_end) result(scene)
    real(wp), intent(in) :: step, t_end
    type(scene_t) :: scene

    scene = constant_friction(along_a_line(steps_of(step, t_end)))
    scene%elongation_x = 1.5e-3_wp
    scene%velocity_ratio = 20.0_wp
  end function along_the_soft_axis

  !> u_x = F_0/k_x + amplitude cos(omega t + phase) while that scene slides.
  subroutine oscillation(scene, omega, amplitude, phase)
    type(scene_t), intent(in) :: scene
    real(wp), intent(out) :: omega, amplitude, phase

    omega = sqrt(scene%stiffness_x/scene%mass)
    amplitude = hypot(scene%elongation_x - 2.0e-3_wp, 19.0_wp*v/omega)
    phase = atan2(19.0_wp*v/omega, scene%elongation_x - 2.0e-3_wp)
  end subroutine oscillation

  !> Fig. 3 with some 80 sticks up to 0.1 s: all of them are found, and the order is one in spite of them.
  subroutine test_fig3()
    real(wp) :: reference(4), state(4), errors(3)
    type(simulation_t) :: exact, simulation
    integer :: i
    logical :: sound
    real(wp), parameter :: t_end = 0.1_wp

    call begin(fig3(t_end, 'radau13', 1.0e-11_wp), exact)
    call go_to(exact, t_end, sound)
    reference = [exact%motion%piece%to%u, velocity(exact)]
    do i = 1, 3
      call begin(steps_of(8.0e-6_wp/4**i, t_end), simulation)
      call go_to(simulation, t_end, sound)
      state = [simulation%motion%piece%to%u, velocity(simulation)]
      errors(i) = norm2(state(3:) - reference(3:))/norm2(reference(3:))
    end do
    associate (count => simulation%motion%work(), right => exact%motion%work())
      call check('Fig. 3: all sticks', count%events == right%events)
    end associate
    call check_order('Fig. 3', errors(1), errors(3), 16.0_wp, 1.0_wp, 0.3_wp)
    call check('Fig. 3: slip velocity', errors(3) < 0.01_wp)
  end subroutine test_fig3

  !> phi -> -phi mirrors u_y and w_y bit for bit.
  subroutine test_mirror()
    type(scene_t) :: scene
    real(wp) :: state(4), mirrored(4)

    scene = steps_of(1.0e-5_wp, 0.2_wp)
    state = final_state(scene)
    scene%misalignment_deg = -scene%misalignment_deg
    mirrored = final_state(scene)
    call check('mirrored', all(abs(mirrored*[1, -1, 1, -1] - state) <= 0.0_wp))
    call check('something to mirror', abs(state(2)) > 0.0_wp .and. abs(state(4)) > 0.0_wp)
  end subroutine test_mirror

  !> The balance of every step closes to roundoff, through sticks, a ramp and steps of any length.
  subroutine test_energy()
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    real(wp) :: first, exchanged, open
    logical :: sound
    integer :: i
    real(wp), parameter :: step(3) = [1.0e-5_wp, 1.0e-3_wp, 0.3_wp]

    do i = 1, 3
      scene = steps_of(step(i), 3.0_wp)
      scene%drive_time = [0.0_wp, 1.0_wp, 2.0_wp]
      scene%drive_velocity = [0.0_wp, 4.0_wp*v, -v]
      scene%elongation_x = -3.0e-3_wp
      call begin(scene, simulation)
      first = energy(simulation)
      call go_to(simulation, huge(1.0_wp), sound)
      associate (now => simulation%motion%piece%to)
        exchanged = abs(now%drive_work) + abs(now%friction_work) + first
        open = now%drive_work - now%friction_work - (energy(simulation) - first)
        call check_close('energy', open/exchanged, 0.0_wp, 1.0e-12_wp)
        call check('energy: friction takes some', now%friction_work > 0.1_wp*exchanged)
      end associate
    end do
  end subroutine test_energy

  !> However long the step is, a run ends with numbers.
  subroutine test_long_steps()
    type(scene_t) :: scene
    real(wp) :: state(4)
    integer :: i

    do i = -2, 6, 2
      scene = steps_of(10.0_wp**i, 30.0_wp*10.0_wp**i)
      state = final_state(scene)
      call check('long steps: finite', all(abs(state) < 1.0_wp))
      scene = constant_friction(scene)
      scene%misalignment_deg = 45.0_wp
      scene%stiffness_y = 1.0_wp
      scene%mass = 1.0e-12_wp
      state = final_state(scene)
      call check('long steps, hardly any mass: finite', all(abs(state) <= huge(1.0_wp)))
    end do
  end subroutine test_long_steps
end program test_moreau_jean
