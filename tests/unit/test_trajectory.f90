!> The full model with exact contact as a whole: accuracy compared with the tolerance, axes, balances. Reference states:
!> tests/python/test_references.py; what must not matter, units, mirrors, samples, turned axes and times: tests/invariance.
program test_trajectory
  use checks, only: check, check_close, finish
  use scenes, only: fig3, along_a_line, without_map, begin, complete, energy, velocity, relative, identical, reference, &
    reference_sticks
  use dst_kinds, only: wp, degree
  use dst_rest, only: spring_force_size
  use dst_errors, only: error_t
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_state, only: state_t
  use dst_motion, only: next_piece
  use dst_piece, only: stick_begins, slips
  use dst_writer, only: writer_t
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)
  character(7), parameter :: methods(3) = ['radau5 ', 'radau9 ', 'radau13']
  type(scene_t) :: scene
  integer :: i

  !> The results by which two runs are compared.
  type :: result_t
    logical :: sound = .false.
    type(state_t) :: motion
    real(wp) :: velocity(2) = 0.0_wp
    integer :: events = 0, sticks = 0
  end type result_t

  call test_error_falls_with_tolerance()
  do i = 1, 3
    call test_right_angles(trim(methods(i)))
    call test_every_piece(fig3(2.2_wp, trim(methods(i)), 1.0e-8_wp), trim(methods(i))//', Fig. 3')
    scene = fig3(1.0_wp, trim(methods(i)), 1.0e-8_wp)
    scene%misalignment_deg = 10.0_wp
    call test_every_piece(scene, trim(methods(i))//', 10 degrees')
    call test_every_piece(along_a_line(fig3(4.0_wp, trim(methods(i)), 1.0e-8_wp)), trim(methods(i))//', along a line')
    call test_every_piece(reversing(trim(methods(i))), trim(methods(i))//', reversing')
    call test_saturation(trim(methods(i)))
    call test_viscous_creep(trim(methods(i)), 'full')
    call test_viscous_creep(trim(methods(i)), 'low_frequency')
  end do
  call finish()

contains

  function run(scene) result(found)
    type(scene_t), intent(in) :: scene
    type(result_t) :: found
    type(simulation_t) :: simulation
    type(writer_t) :: writer

    call complete(scene, simulation, writer, found%sound)
    found%motion = simulation%motion%piece%to
    found%velocity = velocity(simulation)
    found%events = writer%events
    if (writer%events > 0) found%sticks = count(writer%log(:writer%events)%kind == stick_begins)
  end function run

  !> Error of the final state at 2.5 s: over two decades of the tolerance it falls at least tenfold, unless it is below the
  !> tolerance (ten times that in w) or below the roundoff of 2500 oscillations.
  subroutine test_error_falls_with_tolerance()
    integer, parameter :: first(3) = [5, 4, 4]
    type(result_t) :: found
    real(wp) :: error_u(4:11), error_w(4:11), rtol
    integer :: k, m

    do m = 1, 3
      do k = first(m), 11
        rtol = 10.0_wp**(-k)
        found = run(fig3(2.5_wp, trim(methods(m)), rtol))
        call check(methods(m)//': runs to the end', found%sound)
        error_u(k) = relative(found%motion%u, reference(2:3, 5))
        error_w(k) = relative(found%velocity, reference(4:5, 5))
        if (methods(m) == 'radau9' .and. k <= 10) then
          call check_close('radau9: error of u against rtol', error_u(k), 0.0_wp, 100.0_wp*rtol)
          call check_close('radau9: error of w against rtol', error_w(k), 0.0_wp, 100.0_wp*rtol)
          if (k >= 6) call check('radau9: all sticks are found', found%sticks == reference_sticks(5))
        end if
        if (k < first(m) + 2) cycle
        call check(methods(m)//': the error of u falls with rtol', error_u(k) <= max(0.1_wp*error_u(k - 2), rtol, 1.0e-12_wp))
        call check(methods(m)//': the error of w falls with rtol', error_w(k) <= max(0.1_wp*error_w(k - 2), &
          10.0_wp**(1 - k), 1.0e-9_wp))
      end do
    end do
  end subroutine test_error_falls_with_tolerance

  function reversing(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(0.5_wp, method, 1.0e-8_wp)
    scene%drive_time = [0.0_wp, 0.1_wp, 0.1_wp, 0.15_wp, 0.2_wp, 0.3_wp, 0.35_wp]
    scene%drive_velocity = [1.0e-3_wp, 1.0e-3_wp, 0.0_wp, 0.0_wp, 2.0e-3_wp, 2.0e-3_wp, -1.0e-3_wp]
  end function reversing

  !> At multiples of 90 degrees the motion is along one axis; 180 is 0 turned, 90 is 0 with the axes exchanged.
  subroutine test_right_angles(method)
    character(*), intent(in) :: method
    real(wp), parameter :: angle(3) = [180.0_wp, 90.0_wp, -90.0_wp]
    real(wp), parameter :: direction(2, 3) = reshape([-1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, -1.0_wp], [2, 3])
    type(scene_t) :: scene
    type(result_t) :: along_x, other
    integer :: k

    scene = along_a_line(fig3(3.0_wp, method, 1.0e-9_wp))
    along_x = run(scene)
    call check(method//', phi = 0: nothing across', identical(along_x%motion%u(2), 0.0_wp) &
      .and. identical(along_x%velocity(2), 0.0_wp))
    call check(method//', phi = 0: stick-slip', along_x%sticks >= 2)
    do k = 1, size(angle)
      scene%misalignment_deg = angle(k)
      if (k == 2) then
        scene%stiffness_x = scene%stiffness_y
        scene%stiffness_y = 1.0e3_wp
      end if
      other = run(scene)
      call check_close(method//', a right angle: u', relative(other%motion%u, along_x%motion%u(1)*direction(:, k)), 0.0_wp, &
        1.0e-10_wp)
      call check_close(method//', a right angle: X', other%motion%position, along_x%motion%position, &
        1.0e-10_wp*abs(along_x%motion%position))
      call check(method//', a right angle: events', other%events == along_x%events)
    end do
  end subroutine test_right_angles

  !> Conditions after every advance: the energy balance closes, rest obeys the static limit, v never falls below zero.
  subroutine test_every_piece(scene, name)
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: name
    type(simulation_t) :: simulation
    type(error_t), allocatable :: error
    type(state_t) :: state
    real(wp) :: before, after, residual, exchanged, worst_balance, balance, all_exchanged, worst_sum, least_speed, limit
    real(wp) :: scale
    logical :: rests, still
    integer :: k

    call begin(without_map(scene), simulation)
    worst_balance = 0.0_wp
    worst_sum = 0.0_wp
    balance = 0.0_wp
    all_exchanged = 0.0_wp
    least_speed = 0.0_wp
    rests = .true.
    still = .true.
    before = energy(simulation)
    associate (motion => simulation%motion)
      limit = motion%slider%law%static_limit
      scale = limit**2/maxval(motion%slider%stiffness)
      do while (.not. motion%finished())
        call next_piece(simulation%motion, simulation%other, error)
        if (allocated(error)) exit
        after = energy(simulation)
        associate (from => motion%piece%from, now => motion%piece%to)
          residual = (now%drive_work - from%drive_work) - (now%friction_work - from%friction_work) - (after - before)
          exchanged = abs(now%drive_work - from%drive_work) + abs(now%friction_work - from%friction_work) + abs(after - before)
          if (motion%piece%contact /= slips) then
            rests = rests .and. max(spring_force_size(motion%slider, from%u), spring_force_size(motion%slider, now%u)) &
              <= limit*(1.0_wp + 8.0_wp*eps)
          else
            do k = 0, 8
              state = motion%piece%at(from%time + real(k, wp)/8.0_wp*(now%time - from%time))
              least_speed = min(least_speed, state%y(1))
            end do
          end if
          if (motion%contact /= slips) still = still .and. all(identical(now%y, 0.0_wp))
        end associate
        ! Differences below the roundoff of the energies that are subtracted are meaningless.
        worst_balance = max(worst_balance, (abs(residual) - 16.0_wp*eps*(after + abs(motion%piece%to%drive_work)))/max(exchanged, &
          1.0e-6_wp*scale))
        balance = balance + residual
        all_exchanged = all_exchanged + exchanged
        worst_sum = max(worst_sum, abs(balance)/(all_exchanged + 1.0e-6_wp*scale))
        before = after
      end do
    end associate
    call check(name//': runs to the end', .not. allocated(error))
    call check_close(name//': energy balance of every piece', worst_balance, 0.0_wp, 100.0_wp*scene%rtol)
    call check_close(name//': energy balance up to every piece', worst_sum, 0.0_wp, 10.0_wp*scene%rtol)
    call check(name//': |K u| <= F_0 at rest', rests)
    call check(name//': w = 0 at rest', still)
    call check_close(name//': v >= 0', least_speed, 0.0_wp, 1.0e-12_wp*maxval(abs(scene%drive_velocity)))
  end subroutine test_every_piece

  !> Once the oscillation on the stiff spring is saturated, w touches 0 once a period, where u_y' = V sin(phi); it is never larger.
  subroutine test_saturation(method)
    character(*), intent(in) :: method
    type(simulation_t) :: simulation
    type(error_t), allocatable :: error
    type(state_t) :: state
    real(wp) :: w(2), largest, side
    integer :: k, stick_count

    call begin(without_map(fig3(0.6_wp, method, 1.0e-8_wp)), simulation)
    side = 1.0e-3_wp*sin(degree)
    largest = 0.0_wp
    stick_count = 0
    associate (motion => simulation%motion)
      do while (.not. motion%finished())
        call next_piece(simulation%motion, simulation%other, error)
        if (allocated(error)) exit
        if (motion%piece%to%time < 0.1_wp) cycle
        if (motion%piece%event == stick_begins) stick_count = stick_count + 1
        do k = 0, 8
          state = motion%piece%at(motion%piece%from%time + real(k, wp)/8.0_wp*(motion%piece%to%time - motion%piece%from%time))
          w = motion%velocity(state)
          largest = max(largest, side - w(2))
        end do
      end do
    end associate
    call check_close(method//', saturation: largest u_y''', largest, side, 1.0e-9_wp*side)
    call check(method//', saturation: a stick a period', stick_count > 450 .and. stick_count < 510)
  end subroutine test_saturation

  !> Nearly without mass and with friction that grows with the speed, u creeps: k u = F(v), u' = V - v, here by the classical
  !> Runge-Kutta method. The slip velocity follows u, so its error is that of u, which the error estimate has to include.
  subroutine test_viscous_creep(method, model)
    character(*), intent(in) :: method, model
    type(scene_t) :: scene
    type(result_t) :: found
    character(:), allocatable :: title
    real(wp) :: rtol, u
    integer :: k

    title = method//', viscous creep of '//model
    do k = 4, 10, 2
      rtol = 10.0_wp**(-k)
      scene = along_a_line(fig3(1.0_wp, method, rtol))
      scene%model = model
      scene%mass = 1.0e-9_wp
      scene%mu_inf = 0.24_wp
      scene%v_f = 1.0e-3_wp
      scene%velocity_ratio = 0.0_wp
      scene%elongation_x = 2.05e-3_wp
      found = run(scene)
      call check(title//': runs to the end', found%sound)
      u = creep_by_runge_kutta(scene)
      call check_close(title//': u', found%motion%u(1), u, 0.05_wp*rtol*u)
      call check_close(title//': w', found%velocity(1), creep_speed(scene, u), &
        (100.0_wp*rtol + 1.0e-10_wp)*creep_speed(scene, u))
    end do
  end subroutine test_viscous_creep

  !> u at the end of the scene [m].
  pure real(wp) function creep_by_runge_kutta(scene) result(u)
    type(scene_t), intent(in) :: scene
    integer, parameter :: steps = 4000
    real(wp) :: h, k1, k2, k3, k4
    integer :: i

    h = scene%t_end/real(steps, wp)
    u = scene%elongation_x
    associate (v => scene%drive_velocity(1))
      do i = 1, steps
        k1 = v - creep_speed(scene, u)
        k2 = v - creep_speed(scene, u + 0.5_wp*h*k1)
        k3 = v - creep_speed(scene, u + 0.5_wp*h*k2)
        k4 = v - creep_speed(scene, u + h*k3)
        u = u + h/6.0_wp*(k1 + 2.0_wp*k2 + 2.0_wp*k3 + k4)
      end do
    end associate
  end function creep_by_runge_kutta

  !> The slip velocity at which friction balances the spring [m/s].
  pure real(wp) function creep_speed(scene, u)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: u

    creep_speed = -scene%v_f*log((scene%mu_inf - scene%stiffness_x*u/scene%normal_load)/(scene%mu_inf - scene%mu_0))
  end function creep_speed
end program test_trajectory
