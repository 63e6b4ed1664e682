!> Explicit methods: the tableaux, the orders, and the exact contact with them. References: order conditions of Hairer, Norsett &
!> Wanner I; quadruple-precision values of Fig. 3; Radau IIA of order 13.
program test_runge_kutta
  use checks, only: check, check_close, finish
  use dst_kinds, only: wp, degree, pi
  use dst_drive, only: new_drive
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_full_model, only: new_full_polar, new_full_smoothed
  use dst_methods, only: methods
  use dst_past_rest, only: new_past_rest
  use dst_radau, only: new_radau
  use dst_runge_kutta, only: new_runge_kutta
  use dst_runge_kutta_tableaux, only: tableau_t, tableau_named, dense_weights
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  use dst_stepper, only: attempt_t
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_piece, only: piece_t, stick_begins, slips
  use dst_slip_stick, only: slip_stick_t
  use dst_stepping, only: stepping_t
  use scenes, only: fig3, begin, go_to, fig3_slider, relative, reference, reference_sticks
  implicit none

  character(*), parameter :: method(3) = [character(6) :: 'rk4', 'dopri5', 'dop853']
  !> The results of a run: its samples, its stops and its work.
  type :: run_t
    type(state_t), allocatable :: sample(:)
    type(state_t) :: final
    integer :: sticks = 0
    integer :: rejected = 0, evaluations = 0
    !> Drive work minus friction work minus the change of energy, relative to the drive work.
    real(wp) :: unbalanced = 0.0_wp
    logical :: failed = .false.
  end type run_t

  real(wp), parameter :: at_rest(2) = 0.0_wp, one_speed(1) = [1.0e-3_wp], zero_time(1) = 0.0_wp

  call test_list()
  call test_tableaux()
  call test_orders()
  call test_smoothed()
  call test_longest_stable_step()
  call test_references()
  call test_rests()

  call finish()

contains

  !> The data in the list of methods for those that are tableaux.
  subroutine test_list()
    type(tableau_t) :: tableau
    integer :: i

    do i = 1, size(methods)
      if (methods(i)%kind /= 'explicit' .and. methods(i)%kind /= 'fixed_step') cycle
      tableau = tableau_named(trim(methods(i)%name))
      call check(methods(i)%name//': order and stages of the list', &
        tableau%order == methods(i)%order .and. tableau%stages == methods(i)%stages)
    end do
  end subroutine test_list

  subroutine test_tableaux()
    type(tableau_t) :: tableau
    integer, parameter :: estimate_order(3) = [0, 4, 5], dense_order(3) = [3, 4, 7]
    integer :: i

    do i = 1, size(method)
      tableau = tableau_named(method(i))
      call check(method(i)//': row sums', maxval(abs(sum(tableau%a, dim=2) - tableau%c)) < 3.0e-14_wp)
      call check(method(i)//': the last stage is the end', maxval(abs(tableau%a(tableau%stages + 1, :) - tableau%b)) <= 0.0_wp)
      call check(method(i)//': explicit', all_above(tableau))
      call check_close(method(i)//': order conditions', order_defect(tableau, min(5, tableau%order)), 0.0_wp, 3.0e-15_wp)
      call check_close(method(i)//': quadrature', quadrature_defect(tableau%c, tableau%b, tableau%order, 1.0_wp), 0.0_wp, &
        3.0e-15_wp)
      call check(method(i)//': no higher order', &
        quadrature_defect(tableau%c, tableau%b, tableau%order + 1, 1.0_wp) > 1.0e-5_wp)
      if (tableau%errors > 0) then
        call check_close(method(i)//': estimate', &
          quadrature_defect(tableau%c, tableau%error(:, 1), estimate_order(i), 0.0_wp), 0.0_wp, 3.0e-15_wp)
        call check(method(i)//': estimate of no higher order', &
          quadrature_defect(tableau%c, tableau%error(:, 1), estimate_order(i) + 1, 0.0_wp) > 1.0e-5_wp)
      end if
      call check_close(method(i)//': dense output', dense_defect(tableau, dense_order(i)), 0.0_wp, 1.0e-14_wp)
      call check(method(i)//': dense output of no higher order', dense_defect(tableau, dense_order(i) + 1) > 1.0e-5_wp)
    end do
    call check_close('dop853: second estimate', quadrature_defect(tableau%c, tableau%error(:, 2), 3, 0.0_wp), 0.0_wp, 3.0e-15_wp)
  end subroutine test_tableaux

  pure logical function all_above(tableau)
    type(tableau_t), intent(in) :: tableau
    integer :: i

    all_above = .true.
    do i = 1, tableau%all_stages
      all_above = all_above .and. .not. any(abs(tableau%a(i, i:)) > 0.0_wp)
    end do
  end function all_above

  !> Worst violation of sum weight c^(q-1) = expected*tau^q/q for q up to `order`, at tau = 1.
  pure real(wp) function quadrature_defect(c, weight, order, expected) result(defect)
    real(wp), intent(in) :: c(:), weight(:), expected
    integer, intent(in) :: order
    integer :: q

    defect = abs(sum(weight) - expected)
    do q = 2, order
      defect = max(defect, abs(sum(weight*c**(q - 1)) - expected/real(q, wp)))
    end do
  end function quadrature_defect

  !> Worst violation of the order conditions of all trees with up to `order` <= 5 nodes.
  pure real(wp) function order_defect(tableau, order) result(defect)
    type(tableau_t), intent(in) :: tableau
    integer, intent(in) :: order
    real(wp) :: ac(size(tableau%b)), acc(size(tableau%b)), aac(size(tableau%b))

    associate (b => tableau%b, c => tableau%c)
      ac = times(tableau%a, c)
      acc = times(tableau%a, c**2)
      aac = times(tableau%a, ac)
      defect = max(abs(sum(b) - 1.0_wp), abs(sum(b*c) - 1.0_wp/2.0_wp))
      if (order >= 3) defect = max(defect, abs(sum(b*c**2) - 1.0_wp/3.0_wp), abs(sum(b*ac) - 1.0_wp/6.0_wp))
      if (order >= 4) defect = max(defect, abs(sum(b*c**3) - 1.0_wp/4.0_wp), abs(sum(b*c*ac) - 1.0_wp/8.0_wp), &
        abs(sum(b*acc) - 1.0_wp/12.0_wp), abs(sum(b*aac) - 1.0_wp/24.0_wp))
      if (order >= 5) defect = max(defect, abs(sum(b*c**4) - 1.0_wp/5.0_wp), abs(sum(b*c**2*ac) - 1.0_wp/10.0_wp), &
        abs(sum(b*ac**2) - 1.0_wp/20.0_wp), abs(sum(b*c*acc) - 1.0_wp/15.0_wp), &
        abs(sum(b*c*aac) - 1.0_wp/30.0_wp), abs(sum(b*times(tableau%a, c**3)) - 1.0_wp/20.0_wp), &
        abs(sum(b*times(tableau%a, c*ac)) - 1.0_wp/40.0_wp), abs(sum(b*times(tableau%a, acc)) - 1.0_wp/60.0_wp), &
        abs(sum(b*times(tableau%a, aac)) - 1.0_wp/120.0_wp))
    end associate
  end function order_defect

  pure function times(matrix, vector) result(product)
    real(wp), intent(in) :: matrix(:, :), vector(:)
    real(wp) :: product(size(vector))

    product = matmul(matrix, vector)
  end function times

  !> Worst violation, over the step, of the quadrature conditions of the dense output.
  pure real(wp) function dense_defect(tableau, order) result(defect)
    type(tableau_t), intent(in) :: tableau
    integer, intent(in) :: order
    real(wp) :: weight(size(tableau%b)), tau
    integer :: i, q

    defect = 0.0_wp
    do i = 0, 10
      tau = 0.1_wp*real(i, wp)
      weight = dense_weights(tableau, tau)
      defect = max(defect, abs(sum(weight) - tau))
      do q = 2, order
        defect = max(defect, abs(sum(weight*tableau%c**(q - 1)) - tau**q/real(q, wp)))
      end do
    end do
  end function dense_defect

  !> Observed order for fast slip with smoothed contact, where nothing is stiff.
  subroutine test_orders()
    integer, parameter :: order(3) = [4, 5, 8], dense_order(3) = [3, 4, 7], steps(3) = [128, 128, 16]
    real(wp), parameter :: duration = 1.3e-3_wp, tau = 0.37_wp
    real(wp) :: error(2)
    integer :: i, j, n

    do i = 1, size(method)
      do j = 1, 2
        n = j*steps(i)
        error(j) = distance(march(trim(method(i)), duration, n, 1.0_wp), march('dop853', duration, 256, 1.0_wp))
      end do
      call check_close(method(i)//': observed order', log(error(1)/error(2))/log(2.0_wp), real(order(i), wp), 0.5_wp)
      do j = 1, 2
        n = j*steps(i)
        error(j) = distance(march(trim(method(i)), duration/n, 1, tau), march('dop853', tau*duration/n, 64, 1.0_wp))
      end do
      call check_close(method(i)//': observed order of the dense output', &
        log(error(1)/error(2))/log(2.0_wp), real(dense_order(i) + 1, wp), 0.4_wp)
    end do
  end subroutine test_orders

  !> The motion after `steps` equal steps, or inside the only one.
  function march(name, duration, steps, tau) result(motion)
    character(*), intent(in) :: name
    real(wp), intent(in) :: duration, tau
    integer, intent(in) :: steps
    type(state_t) :: motion
    type(stepping_t) :: scene
    type(piece_t) :: piece
    type(state_t) :: to
    type(attempt_t) :: outcome
    integer :: i

    scene = smoothed_scene(1.0e-3_wp)
    ! No tolerance: an adaptive method uses the given steps.
    call choose_method(scene, name, 1.0e6_wp)
    motion%u = [1.0e-3_wp, 1.5e-7_wp]
    motion%y(1:2) = [6.0e-3_wp, -4.0e-3_wp]
    do i = 1, steps
      call scene%stepper%attempt(scene%system, scene%drive%segment(1), motion, duration/real(steps, wp), to, outcome)
      if (.not. outcome%solved) error stop 'a step of the order test failed'
      if (tau < 1.0_wp) then
        piece%from = motion
        piece%drive = scene%drive%segment(1)
        call piece%obey(scene%system)
        call piece%path%take(scene%stepper)
        to = piece%inside(tau)
      end if
      motion = to
    end do
  end function march

  !> Difference of two motions as a slip velocity relative to the slip speed.
  pure real(wp) function distance(a, b)
    type(state_t), intent(in) :: a, b

    distance = norm2(a%y - b%y)/norm2(b%y)
  end function distance

  !> Without friction rk4 is stable up to a step of 2 sqrt(2)/omega; the program keeps steps up to 2.7/omega, omega^2 being the sum
  !> of the squares along both axes, and cuts longer ones; in seconds as in units of 12 days.
  subroutine test_longest_stable_step()
    real(wp), parameter :: unit_of_time(2) = [1.0_wp, 2.0_wp**20]
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    real(wp) :: omega
    integer :: i, j
    logical :: sound

    do i = 1, 2
      do j = 1, 2
        scene = fig3(1.0_wp, 'rk4', 0.0_wp)
        scene%contact = 'smoothed'
        scene%v_smooth = 1.0e-5_wp
        scene%mu_0 = 0.0_wp
        scene%mu_inf = 0.0_wp
        scene%misalignment_deg = 30.0_wp
        scene%velocity_ratio = 0.0_wp
        scene%stiffness_x = scene%stiffness_x/unit_of_time(i)**2
        scene%stiffness_y = scene%stiffness_y/unit_of_time(i)**2
        omega = sqrt((scene%stiffness_x + scene%stiffness_y)/scene%mass)
        scene%step = merge(2.69_wp, 2.75_wp, j == 1)/omega
        scene%t_end = 100.5_wp*scene%step
        call begin(scene, simulation)
        call go_to(simulation, huge(1.0_wp), sound)
        associate (count => simulation%motion%work())
          call check('rk4: the longest stable step', sound .and. (count%rejected == 0 .eqv. j == 1))
          call check('rk4: what is cut is cut to nine tenths of the limit', &
            count%steps == merge(101, ceiling(100.5_wp*2.75_wp/(0.9_wp*2.7_wp)), j == 1))
        end associate
      end do
    end do
  end subroutine test_longest_stable_step

  !> Smoothed contact: a tolerance that is met, and a fixed step that never becomes unstable.
  subroutine test_smoothed()
    real(wp), parameter :: duration = 0.05_wp
    type(stepping_t) :: scene
    type(run_t) :: right, loose, tight
    integer :: i

    scene = smoothed_scene(1.0e-6_wp)
    scene%t_end = duration
    call choose_method(scene, 'radau13', 1.0e-12_wp)
    right = run(scene, at_rest, at_rest)
    do i = 2, size(method)
      call choose_method(scene, trim(method(i)), 1.0e-6_wp)
      loose = run(scene, at_rest, at_rest)
      call choose_method(scene, trim(method(i)), 1.0e-9_wp)
      tight = run(scene, at_rest, at_rest)
      call check_close(method(i)//': smoothed, rtol = 1e-6', worst_slip(loose, right, .false.), 0.0_wp, 1.0e-6_wp)
      call check_close(method(i)//': smoothed, rtol = 1e-9', worst_slip(tight, right, .false.), 0.0_wp, 2.0e-9_wp)
      call check_close(method(i)//': smoothed, energy', tight%unbalanced, 0.0_wp, 1.0e-13_wp)
    end do
    call choose_method(scene, 'rk4', 1.0e-6_wp)
    scene%fixed_step = 2.5e-7_wp
    tight = run(scene, at_rest, at_rest)
    call check('rk4: a stable step is kept', tight%rejected == 0)
    call check_close('rk4: smoothed', worst_slip(tight, right, .false.), 0.0_wp, 1.0e-9_wp)
    scene%fixed_step = 1.0e-5_wp
    loose = run(scene, at_rest, at_rest)
    call check('rk4: a step beyond stability is cut', loose%rejected > 0)
    call check_close('rk4: and the motion stays right', worst_slip(loose, right, .false.), 0.0_wp, 1.0e-6_wp)
  end subroutine test_smoothed

  !> Fig. 3 with exact contact, compared with the values in quadruple precision.
  subroutine test_references()
    class(slip_stick_t), allocatable :: scene
    type(run_t) :: whole
    integer :: i, j

    do i = 2, size(method)
      do j = 1, 3
        call exact_scene(scene, trim(method(i)), fig3_slider(1.0_wp), zero_time, one_speed, 1.0e-8_wp, reference(1, j))
        whole = run(scene, at_rest, [1.0e-9_wp, degree])
        call check(method(i)//': sticks', whole%sticks == reference_sticks(j))
        call check_close(method(i)//': u_x', whole%final%u(1)/reference(2, j), 1.0_wp, 1.0e-13_wp)
        call check_close(method(i)//': u_y', whole%final%u(2)/reference(3, j), 1.0_wp, 1.0e-9_wp)
        call check_close(method(i)//': w', relative(slip(whole%final), reference(4:5, j)), 0.0_wp, 5.0e-8_wp)
        call check_close(method(i)//': energy', whole%unbalanced, 0.0_wp, 1.0e-11_wp)
      end do
    end do
    ! A coarser cut-off must make a difference: otherwise the bounds above say nothing about it.
    call exact_scene(scene, 'dop853', fig3_slider(1.0_wp), zero_time, one_speed, 1.0e-8_wp, reference(1, 3))
    scene%cut_share = 0.1_wp
    whole = run(scene, at_rest, [1.0e-9_wp, degree])
    call check('a coarse cut-off costs digits', relative(slip(whole%final), reference(4:5, 3)) > 1.0e-5_wp)
    call check('but no stick', whole%sticks == reference_sticks(3))
  end subroutine test_references

  !> Every kind of stop and release, compared with Radau IIA.
  subroutine test_rests()
    real(wp), parameter :: rest(1) = 0.0_wp
    real(wp), parameter :: there(4) = [0.0_wp, 0.05_wp, 0.1_wp, 0.15_wp], ramp(4) = [0.0_wp, 2.0e-3_wp, -2.0e-3_wp, 0.0_wp]
    real(wp), parameter :: speeds(4) = [1.0e-3_wp, 1.0e-3_wp, -1.0e-3_wp, 1.0e-3_wp], faster(3) = [1.0e-3_wp, 1.0e-3_wp, 2.0e-3_wp]
    real(wp) :: released

    released = release_time()
    call compare('start from rest', 1.0_wp, 'weakening', zero_time, one_speed, at_rest, at_rest, 0.1_wp)
    call compare('constant friction', 1.0_wp, 'constant', zero_time, one_speed, at_rest, at_rest, 0.05_wp)
    call compare('aligned spring', 0.0_wp, 'weakening', zero_time, one_speed, at_rest, [1.0e-9_wp, 0.0_wp], 3.0_wp)
    call compare('crosswise spring', 90.0_wp, 'weakening', zero_time, one_speed, at_rest, at_rest, 0.05_wp)
    call compare('drive at rest', 1.0_wp, 'weakening', zero_time, rest, at_rest, [1.0_wp, 0.3_wp], 0.5_wp)
    call compare('released at once', 1.0_wp, 'weakening', zero_time, rest, [5.0e-3_wp, 3.0e-6_wp], at_rest, 0.3_wp)
    call compare('pulled back', 1.0_wp, 'weakening', zero_time, one_speed, [-5.0e-3_wp, 0.0_wp], at_rest, 0.1_wp)
    call compare('turn under load', 0.0_wp, 'weakening', zero_time, one_speed, [9.0e-3_wp, 0.0_wp], [0.1_wp, pi], 0.3_wp)
    call compare('turn with a curve', 1.0_wp, 'weakening', zero_time, one_speed, [5.0e-3_wp, 0.0_wp], [0.1_wp, pi], 0.1_wp)
    call compare('slow slip under load', 1.0_wp, 'weakening', zero_time, one_speed, [3.0e-3_wp, 0.0_wp], [1.0e-9_wp, 2.0_wp], &
      0.05_wp)
    call compare('slow slip without drive', 1.0_wp, 'weakening', zero_time, rest, at_rest, [1.0e-9_wp, 2.0_wp], 0.05_wp)
    call compare('to and fro, then hold', 1.0_wp, 'weakening', there, ramp, at_rest, at_rest, 0.2_wp)
    call compare('sharp law', 1.0_wp, 'sharp', zero_time, one_speed, at_rest, at_rest, 0.05_wp)
    call compare('turning back after the release', 1.0_wp, 'weakening', &
      [0.0_wp, released + 1.0e-6_wp, released + 1.0e-6_wp, 0.0115_wp], speeds, at_rest, at_rest, 0.03_wp)
    call compare('turning back at the release', 1.0_wp, 'weakening', &
      [0.0_wp, released + 1.0e-9_wp, released + 1.0e-9_wp, 0.0115_wp], speeds, at_rest, at_rest, 0.03_wp)
    call compare('faster at the release', 1.0_wp, 'weakening', &
      [0.0_wp, released + 1.0e-9_wp, released + 1.0e-9_wp], faster, at_rest, at_rest, 0.03_wp)
    call test_limit()
  end subroutine test_rests

  !> Time of the first release of Fig. 3 [s]: |K u| = F_0 with u = V t e.
  real(wp) function release_time()
    type(slider_t) :: slider

    slider = fig3_slider(1.0_wp)
    release_time = slider%law%static_limit/(one_speed(1)*norm2(slider%stiffness*slider%along))
  end function release_time

  !> One scene by dopri5 and dop853, compared with Radau IIA; 'sharp' is the weakening law with v_f = 10 um/s.
  subroutine compare(name, misalignment, law, time, velocity, u, y, t_end)
    character(*), intent(in) :: name, law
    real(wp), intent(in) :: misalignment, time(:), velocity(:), u(2), y(2), t_end
    class(slip_stick_t), allocatable :: scene
    type(slider_t) :: slider
    type(run_t) :: right, explicit
    integer :: i

    slider = fig3_slider(misalignment)
    if (law == 'constant') call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    if (law == 'sharp') call new_friction_law('weakening', 0.2_wp, 0.15_wp, 1.0e-5_wp, 10.0_wp, slider%law)
    call exact_scene(scene, 'radau9', slider, time, velocity, 1.0e-11_wp, t_end)
    right = run(scene, u, y)
    do i = 2, size(method)
      call exact_scene(scene, trim(method(i)), slider, time, velocity, 1.0e-7_wp, t_end)
      explicit = run(scene, u, y)
      call check(name//', '//method(i)//': no error', .not. (right%failed .or. explicit%failed))
      call check(name//', '//method(i)//': sticks', explicit%sticks == right%sticks)
      call check_close(name//', '//method(i)//': slip velocity', worst_slip(explicit, right, .true.), 0.0_wp, 1.0e-6_wp)
      call check_close(name//', '//method(i)//': energy', explicit%unbalanced, 0.0_wp, 3.0e-7_wp)
      call check(name//', '//method(i)//': work', explicit%evaluations < 4000000)
    end do
  end subroutine compare

  !> At rest with a force equal to friction and no drive: it stays at rest.
  subroutine test_limit()
    class(slip_stick_t), allocatable :: scene
    type(slider_t) :: slider
    type(run_t) :: explicit

    slider = fig3_slider(0.0_wp)
    call new_friction_law('constant', 0.2_wp, 0.2_wp, 1.0_wp, 10.0_wp, slider%law)
    call exact_scene(scene, 'dopri5', slider, zero_time, [0.0_wp], 1.0e-7_wp, 0.1_wp)
    explicit = run(scene, [scene%slider%law%static_limit/scene%slider%stiffness(1), 0.0_wp], at_rest)
    call check('at the limit: no error', .not. explicit%failed)
    call check('at the limit: no motion', .not. norm2(explicit%final%y) > 0.0_wp .and. .not. abs(explicit%final%position) > 0.0_wp)
  end subroutine test_limit

  !> Fig. 3 with another misalignment [deg], law or drive, and exact contact.
  subroutine exact_scene(scene, name, slider, time, velocity, rtol, t_end)
    class(slip_stick_t), allocatable, intent(out) :: scene
    character(*), intent(in) :: name
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: time(:), velocity(:), rtol, t_end

    allocate (scene)
    call scene%set_up(slider, new_drive(time, velocity), t_end)
    scene%system = new_full_polar(slider)
    call choose_method(scene, name, rtol)
    if (index(name, 'radau') == 0) then
      deallocate (scene%stepper)
      scene%stepper = new_past_rest(name, 2, 2, rtol)
    end if
    scene%cut_share = 0.03_wp*sqrt(rtol)
  end subroutine exact_scene

  subroutine choose_method(scene, name, rtol)
    class(stepping_t), intent(inout) :: scene
    character(*), intent(in) :: name
    real(wp), intent(in) :: rtol

    ! Assignment to an allocated object of another type overruns its memory with gfortran 12.
    if (allocated(scene%stepper)) deallocate (scene%stepper)
    select case (name)
    case ('radau9')
      scene%stepper = new_radau(5, 2, 2, rtol)
    case ('radau13')
      scene%stepper = new_radau(7, 2, 2, rtol)
    case default
      scene%stepper = new_runge_kutta(name, 2, 2, rtol)
    end select
  end subroutine choose_method

  !> Fig. 3 with contact smoothed by `v_smooth` [m/s].
  function smoothed_scene(v_smooth) result(scene)
    real(wp), intent(in) :: v_smooth
    type(stepping_t) :: scene
    type(slider_t) :: slider

    slider = fig3_slider(1.0_wp)
    slider%smoothing = v_smooth**2
    call scene%set_up(slider, new_drive(zero_time, one_speed), 0.0_wp)
    scene%system = new_full_smoothed(slider)
  end function smoothed_scene

  !> The whole motion, sampled at 200 equal intervals.
  function run(scene, u, y) result(outcome)
    class(stepping_t), intent(inout) :: scene
    real(wp), intent(in) :: u(2), y(2)
    type(run_t) :: outcome
    type(error_t), allocatable :: error
    integer, parameter :: intervals = 200
    integer :: next

    allocate (outcome%sample(0:intervals))
    next = 0
    call scene%start(u, y, 0.0_wp)
    if (scene%contact /= slips) outcome%sticks = 1
    do while (.not. scene%finished())
      call scene%advance(error)
      outcome%failed = allocated(error)
      if (outcome%failed) return
      do while (next <= intervals)
        if (next*scene%t_end/intervals > scene%piece%to%time) exit
        outcome%sample(next) = scene%piece%at(next*scene%t_end/intervals)
        next = next + 1
      end do
      if (scene%piece%event == stick_begins) outcome%sticks = outcome%sticks + 1
    end do
    outcome%final = scene%piece%to
    outcome%rejected = int(scene%stepper%count%rejected)
    outcome%evaluations = int(scene%stepper%count%rhs)
    associate (to => scene%piece%to)
      outcome%unbalanced = (to%drive_work - to%friction_work - energy(scene, to%u, to%y) + energy(scene, u, y)) &
        /max(abs(to%drive_work), to%friction_work, tiny(1.0_wp))
    end associate
  end function run

  !> Kinetic and elastic energy [J].
  pure real(wp) function energy(scene, u, y)
    class(stepping_t), intent(in) :: scene
    real(wp), intent(in) :: u(2), y(2)

    energy = 0.5_wp*sum(scene%slider%stiffness*u**2)
    select type (scene)
    class is (slip_stick_t)
      energy = energy + 0.5_wp*scene%slider%mass*y(1)**2
    class default
      energy = energy + 0.5_wp*scene%slider%mass*sum(y**2)
    end select
  end function energy

  !> Slip velocity of a motion in polar unknowns.
  pure function slip(motion)
    type(state_t), intent(in) :: motion
    real(wp) :: slip(2)

    slip = motion%y(1)*[cos(motion%y(2)), sin(motion%y(2))]
  end function slip

  !> Largest difference of the sampled slip velocities relative to the largest slip speed.
  pure real(wp) function worst_slip(a, b, polar) result(worst)
    type(run_t), intent(in) :: a, b
    logical, intent(in) :: polar
    real(wp) :: difference, speed
    integer :: i

    worst = 0.0_wp
    speed = 0.0_wp
    do i = 0, ubound(b%sample, 1)
      if (polar) then
        difference = norm2(slip(a%sample(i)) - slip(b%sample(i)))
        speed = max(speed, b%sample(i)%y(1))
      else
        difference = norm2(a%sample(i)%y - b%sample(i)%y)
        speed = max(speed, norm2(b%sample(i)%y))
      end if
      worst = max(worst, difference)
    end do
    worst = worst/max(speed, tiny(speed))
  end function worst_slip
end program test_runge_kutta
