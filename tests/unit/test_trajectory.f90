!> The full model with exact contact as a whole: reference states, accuracy compared with the tolerance, symmetries, balances.
!>
!> Reference states and numbers of sticks of Fig. 3 (Nakano & Popov 2020): converged in quadruple precision with exact contact,
!> as in tests/reference/fig3.json.
program test_trajectory
  use checks, only: check, check_close, finish
  use scenes, only: fig3, constant_friction, along_a_line, without_map, begin, complete, energy, velocity
  use dst_kinds, only: wp, degree
  use dst_rest, only: spring_force_size
  use dst_errors, only: error_t
  use dst_memory_writer, only: memory_writer_t
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_state, only: state_t
  use dst_motion, only: next_piece
  use dst_piece, only: stick_begins, slips
  implicit none

  real(wp), parameter :: eps = epsilon(1.0_wp)
  character(7), parameter :: methods(3) = ['radau5 ', 'radau9 ', 'radau13']
  !> t, u_x, u_y, w_x, w_y.
  real(wp), parameter :: reference(5, 5) = reshape([ &
    0.02_wp, 1.9995769485350064e-5_wp, 1.9872958183374369e-7_wp, 3.4657221958313615e-7_wp, 3.4464837227950101e-5_wp, &
    0.05_wp, 4.9981994355053295838e-5_wp, 1.9777009741426093201e-7_wp, 7.7718265581718725420e-7_wp, &
    3.0762498951531784662e-5_wp, &
    0.5_wp, 4.9881686313895216e-4_wp, 1.9613798061520180e-7_wp, 6.6869132069817701e-6_wp, 2.6297324897503335e-5_wp, &
    2.0_wp, 1.9692956749747725e-3_wp, 3.1878007765597037e-8_wp, 1.1151220751611373e-4_wp, 1.8056009394322286e-5_wp, &
    2.5_wp, 1.5711430457285813e-3_wp, 1.2381977151085114e-7_wp, 4.5514731831979764e-5_wp, 3.5908257054622328e-5_wp], [5, 5])
  integer, parameter :: sticks(5) = [9, 39, 485, 1536, 1826]
  integer :: i

  !> The results by which two runs are compared.
  type :: result_t
    logical :: sound = .false.
    type(state_t) :: motion
    real(wp) :: velocity(2) = 0.0_wp
    integer :: steps = 0, rejected = 0, events = 0, sticks = 0
    real(wp), allocatable :: event_time(:)
  end type result_t

  call test_reference()
  call test_accuracy_follows_tolerance()
  call test_error_falls_with_tolerance()
  do i = 1, 3
    call test_units(trim(methods(i)))
    call test_mirror(trim(methods(i)))
    call test_sampling(trim(methods(i)))
    call test_equal_stiffness(trim(methods(i)))
    call test_right_angles(trim(methods(i)))
    call test_time_shift(trim(methods(i)))
    call test_every_piece(fig3(2.2_wp, trim(methods(i)), 1.0e-8_wp), trim(methods(i))//', Fig. 3')
    call test_every_piece(steep(trim(methods(i))), trim(methods(i))//', 10 degrees')
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
    type(memory_writer_t) :: writer

    call complete(scene, simulation, writer, found%sound)
    found%motion = simulation%motion%piece%to
    found%velocity = velocity(simulation)
    associate (count => simulation%motion%work())
      found%steps = int(count%steps)
      found%rejected = int(count%rejected)
    end associate
    found%events = writer%events
    found%sticks = 0
    allocate (found%event_time(writer%events))
    if (writer%events == 0) return
    found%event_time = writer%log(:writer%events)%time
    found%sticks = count(writer%log(:writer%events)%kind == stick_begins)
  end function run

  !> Distance of a vector from another, relative to the latter.
  pure real(wp) function relative(actual, expected)
    real(wp), intent(in) :: actual(:), expected(:)

    relative = norm2(actual - expected)/norm2(expected)
  end function relative

  subroutine test_reference()
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(memory_writer_t) :: writer
    integer :: k, row
    logical :: sound

    scene = fig3(2.5_wp, 'radau9', 1.0e-10_wp)
    scene%interval = 0.01_wp
    call complete(scene, simulation, writer, sound)
    call check('reference: complete', sound)
    do k = 1, size(sticks)
      associate (t => reference(1, k))
        row = nint(t/scene%interval) + 1
        call check_close('reference: time', writer%samples(1, row), t, eps)
        call check_close('reference: u', relative(writer%samples(2:3, row), reference(2:3, k)), 0.0_wp, 1.0e-10_wp)
        call check_close('reference: w', relative(writer%samples(4:5, row), reference(4:5, k)), 0.0_wp, 1.0e-8_wp)
        call check('reference: sticks', sticks(k) == count(writer%log(:writer%events)%kind == stick_begins &
          .and. writer%log(:writer%events)%time <= t))
      end associate
    end do
  end subroutine test_reference

  !> Error of the final state at 2.5 s: of u and of the slip velocity, relative.
  subroutine errors_at_the_end(method, rtol, error_u, error_w, stick_count)
    character(*), intent(in) :: method
    real(wp), intent(in) :: rtol
    real(wp), intent(out) :: error_u, error_w
    integer, intent(out) :: stick_count
    type(result_t) :: found

    found = run(fig3(2.5_wp, method, rtol))
    call check(method//': runs to the end', found%sound)
    error_u = relative(found%motion%u, reference(2:3, 5))
    error_w = relative(found%velocity, reference(4:5, 5))
    stick_count = found%sticks
  end subroutine errors_at_the_end

  subroutine test_accuracy_follows_tolerance()
    real(wp) :: rtol, error_u, error_w
    integer :: k, stick_count

    do k = 4, 10
      rtol = 10.0_wp**(-k)
      call errors_at_the_end('radau9', rtol, error_u, error_w, stick_count)
      call check_close('radau9: error of u against rtol', error_u, 0.0_wp, 100.0_wp*rtol)
      call check_close('radau9: error of w against rtol', error_w, 0.0_wp, 100.0_wp*rtol)
      if (k >= 6) call check('radau9: all sticks are found', stick_count == sticks(5))
    end do
  end subroutine test_accuracy_follows_tolerance

  !> Over two decades of the tolerance the error falls at least tenfold, unless it is below the tolerance (ten times that in w) or
  !> below the roundoff of 2500 oscillations.
  subroutine test_error_falls_with_tolerance()
    integer, parameter :: first(3) = [5, 4, 4]
    real(wp) :: error_u(4:11), error_w(4:11)
    integer :: k, m, stick_count

    do m = 1, 3
      do k = first(m), 11
        call errors_at_the_end(trim(methods(m)), 10.0_wp**(-k), error_u(k), error_w(k), stick_count)
        if (k < first(m) + 2) cycle
        call check(trim(methods(m))//': the error of u falls with rtol', error_u(k) <= max(0.1_wp*error_u(k - 2), &
          10.0_wp**(-k), 1.0e-12_wp))
        call check(trim(methods(m))//': the error of w falls with rtol', error_w(k) <= max(0.1_wp*error_w(k - 2), &
          10.0_wp**(1 - k), 1.0e-9_wp))
      end do
    end do
  end subroutine test_error_falls_with_tolerance

  !> The scene in other units: a length, a time and a mass of 1 become these numbers.
  pure function in_units(scene, length, time, mass) result(scaled)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: length, time, mass
    type(scene_t) :: scaled

    scaled = scene
    scaled%t_end = scene%t_end*time
    scaled%interval = scene%interval*time
    scaled%step_max = scene%step_max*time
    scaled%mass = scene%mass*mass
    scaled%stiffness_x = scene%stiffness_x*(mass/time**2)
    scaled%stiffness_y = scene%stiffness_y*(mass/time**2)
    scaled%normal_load = scene%normal_load*(mass*length/time**2)
    scaled%v_f = scene%v_f*(length/time)
    scaled%v_smooth = scene%v_smooth*(length/time)
    scaled%elongation_x = scene%elongation_x*length
    scaled%elongation_y = scene%elongation_y*length
    scaled%drive_time = scene%drive_time*time
    scaled%drive_velocity = scene%drive_velocity*(length/time)
  end function in_units

  !> Bit for bit the same, so that there is no hidden absolute constant.
  subroutine test_units(method)
    character(*), intent(in) :: method

    call check_units(fig3(0.3_wp, method, 1.0e-8_wp), method//', creep')
    call check_units(reversing(method), method//', reversing')
    call check_units(along_a_line(fig3(3.0_wp, method, 1.0e-7_wp)), method//', along a line')
    call check_units(smoothed(method), method//', smoothed')
  end subroutine test_units

  subroutine check_units(scene, name)
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: name
    real(wp), parameter :: large = 2.0_wp**20, small = 2.0_wp**(-30)
    type(result_t) :: plain

    plain = run(scene)
    call check(name//': runs to the end', plain%sound)
    call check_same(plain, scene, large, 1.0_wp, 1.0_wp, name//': unit of length')
    call check_same(plain, scene, small, 1.0_wp, 1.0_wp, name//': unit of length')
    call check_same(plain, scene, 1.0_wp, large, 1.0_wp, name//': unit of time')
    call check_same(plain, scene, 1.0_wp, small, 1.0_wp, name//': unit of time')
    call check_same(plain, scene, 1.0_wp, 1.0_wp, large, name//': unit of mass')
    call check_same(plain, scene, 1.0_wp, 1.0_wp, small, name//': unit of mass')
    call check_same(plain, scene, small, large, 8.0_wp, name//': all units')
    call check_same(plain, scene, 0.5_wp, small, large, name//': all units')
  end subroutine check_units

  subroutine check_same(plain, scene, length, time, mass, name)
    type(result_t), intent(in) :: plain
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: length, time, mass
    character(*), intent(in) :: name
    type(result_t) :: scaled
    real(wp) :: joule
    logical :: events

    scaled = run(in_units(scene, length, time, mass))
    joule = mass*(length/time)**2
    call check(name//': steps', scaled%steps == plain%steps .and. scaled%rejected == plain%rejected)
    call check(name//': state', all(identical(scaled%motion%u, plain%motion%u*length)) &
      .and. all(identical(scaled%velocity, plain%velocity*(length/time))) &
      .and. identical(scaled%motion%position, plain%motion%position*length))
    call check(name//': work', identical(scaled%motion%drive_work, plain%motion%drive_work*joule) &
      .and. identical(scaled%motion%friction_work, plain%motion%friction_work*joule))
    events = scaled%events == plain%events
    if (events) events = all(identical(scaled%event_time, plain%event_time*time))
    call check(name//': events', events)
  end subroutine check_same

  elemental logical function identical(a, b)
    real(wp), intent(in) :: a, b

    identical = abs(a - b) <= 0.0_wp
  end function identical

  function smoothed(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(0.1_wp, method, 1.0e-7_wp)
    scene%contact = 'smoothed'
    scene%v_smooth = 1.0e-7_wp
  end function smoothed

  function reversing(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(0.5_wp, method, 1.0e-8_wp)
    scene%drive_time = [0.0_wp, 0.1_wp, 0.1_wp, 0.15_wp, 0.2_wp, 0.3_wp, 0.35_wp]
    scene%drive_velocity = [1.0e-3_wp, 1.0e-3_wp, 0.0_wp, 0.0_wp, 2.0e-3_wp, 2.0e-3_wp, -1.0e-3_wp]
  end function reversing

  function steep(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(1.0_wp, method, 1.0e-8_wp)
    scene%misalignment_deg = 10.0_wp
  end function steep

  !> phi -> -phi: u_x and w_x are the same to the last bit, u_y and w_y change sign; so does the whole motion if V changes sign.
  subroutine test_mirror(method)
    character(*), intent(in) :: method
    type(scene_t) :: scene
    type(result_t) :: plain, mirrored

    scene = fig3(2.2_wp, method, 1.0e-8_wp)
    plain = run(scene)
    scene%misalignment_deg = -scene%misalignment_deg
    mirrored = run(scene)
    call check(method//', mirror: u_x, w_x, X', identical(mirrored%motion%u(1), plain%motion%u(1)) &
      .and. identical(mirrored%velocity(1), plain%velocity(1)) .and. identical(mirrored%motion%position, plain%motion%position))
    call check(method//', mirror: u_y, w_y', identical(mirrored%motion%u(2), -plain%motion%u(2)) &
      .and. identical(mirrored%velocity(2), -plain%velocity(2)))
    call check(method//', mirror: v, theta', identical(mirrored%motion%y(1), plain%motion%y(1)) &
      .and. identical(mirrored%motion%y(2), -plain%motion%y(2)))
    call check(method//', mirror: steps and events', mirrored%steps == plain%steps .and. mirrored%events == plain%events)
    scene%misalignment_deg = -scene%misalignment_deg
    scene%drive_velocity = -scene%drive_velocity
    scene%t_end = 0.5_wp
    mirrored = run(scene)
    scene%drive_velocity = -scene%drive_velocity
    plain = run(scene)
    call check_close(method//', backwards: u', relative(-mirrored%motion%u, plain%motion%u), 0.0_wp, 1.0e-9_wp)
    call check_close(method//', backwards: w', relative(-mirrored%velocity, plain%velocity), 0.0_wp, 1.0e-6_wp)
    call check(method//', backwards: events', mirrored%events == plain%events)
  end subroutine test_mirror

  !> The choice of samples changes no state.
  subroutine test_sampling(method)
    character(*), intent(in) :: method
    real(wp), parameter :: interval(4) = [1.0e-5_wp, 0.0_wp, 0.0371_wp, 10.0_wp]
    type(scene_t) :: scene
    type(result_t) :: plain, other
    integer :: k

    scene = fig3(0.3_wp, method, 1.0e-8_wp)
    plain = run(scene)
    do k = 1, size(interval)
      scene%interval = interval(k)
      other = run(scene)
      call check(method//', sampling: state', all(identical(other%motion%u, plain%motion%u)) &
        .and. all(identical(other%motion%y, plain%motion%y)) .and. identical(other%motion%position, plain%motion%position) &
        .and. identical(other%motion%drive_work, plain%motion%drive_work) &
        .and. identical(other%motion%friction_work, plain%motion%friction_work))
      call check(method//', sampling: steps and events', other%steps == plain%steps .and. other%events == plain%events)
    end do
  end subroutine test_sampling

  !> k_y = k_x has no principal axes: phi = 0 turned by phi.
  subroutine test_equal_stiffness(method)
    character(*), intent(in) :: method
    real(wp), parameter :: angle(5) = [30.0_wp, 90.0_wp, -45.0_wp, 180.0_wp, 123.4_wp]
    type(scene_t) :: scene
    type(result_t) :: plain, turned
    real(wp) :: c, s
    integer :: k

    ! It ends in the middle of the second slip.
    scene = along_a_line(fig3(2.03_wp, method, 1.0e-9_wp))
    scene%stiffness_y = scene%stiffness_x
    plain = run(scene)
    call check(method//', equal stiffness: along the drive', identical(plain%motion%u(2), 0.0_wp) &
      .and. plain%velocity(1) > 1.0e-3_wp)
    do k = 1, size(angle)
      scene%misalignment_deg = angle(k)
      turned = run(scene)
      c = cos(angle(k)*degree)
      s = sin(angle(k)*degree)
      call check_close(method//', equal stiffness: u', relative(turned%motion%u, plain%motion%u(1)*[c, s]), 0.0_wp, 1.0e-10_wp)
      call check_close(method//', equal stiffness: w', relative(turned%velocity, plain%velocity(1)*[c, s]), 0.0_wp, 1.0e-8_wp)
      call check_close(method//', equal stiffness: X', turned%motion%position, plain%motion%position, &
        1.0e-10_wp*plain%motion%position)
      call check(method//', equal stiffness: events', turned%events == plain%events)
    end do
  end subroutine test_equal_stiffness

  !> At multiples of 90 degrees the motion is along one axis; 180 is 0 turned, 90 is 0 with the axes exchanged.
  subroutine test_right_angles(method)
    character(*), intent(in) :: method
    type(scene_t) :: scene, exchanged
    type(result_t) :: along_x, along_y, turned

    scene = along_a_line(fig3(3.0_wp, method, 1.0e-9_wp))
    along_x = run(scene)
    call check(method//', phi = 0: nothing across', identical(along_x%motion%u(2), 0.0_wp) &
      .and. identical(along_x%velocity(2), 0.0_wp))
    call check(method//', phi = 0: stick-slip', along_x%sticks >= 2)
    scene%misalignment_deg = 180.0_wp
    turned = run(scene)
    call check_close(method//', phi = 180: u', relative(-turned%motion%u, along_x%motion%u), 0.0_wp, 1.0e-10_wp)
    call check_close(method//', phi = 180: X', turned%motion%position, along_x%motion%position, &
      1.0e-10_wp*abs(along_x%motion%position))
    call check(method//', phi = 180: events', turned%events == along_x%events)

    exchanged = scene
    exchanged%stiffness_x = scene%stiffness_y
    exchanged%stiffness_y = scene%stiffness_x
    exchanged%misalignment_deg = 90.0_wp
    along_y = run(exchanged)
    call check_close(method//', phi = 90: u', relative(along_y%motion%u, [0.0_wp, along_x%motion%u(1)]), 0.0_wp, 1.0e-10_wp)
    call check(method//', phi = 90: events', along_y%events == along_x%events)
    exchanged%misalignment_deg = -90.0_wp
    along_y = run(exchanged)
    call check_close(method//', phi = -90: u', relative(along_y%motion%u, [0.0_wp, -along_x%motion%u(1)]), 0.0_wp, 1.0e-10_wp)
    call check(method//', phi = -90: events', along_y%events == along_x%events)
  end subroutine test_right_angles

  !> Driven from 1 s on: the same motion, 1 s later.
  subroutine test_time_shift(method)
    character(*), intent(in) :: method
    type(scene_t) :: scene
    type(result_t) :: plain, later

    scene = fig3(0.3_wp, method, 1.0e-9_wp)
    scene%velocity_ratio = 0.0_wp
    plain = run(scene)
    scene%t_end = 1.3_wp
    scene%drive_time = [0.0_wp, 1.0_wp, 1.0_wp]
    scene%drive_velocity = [0.0_wp, 0.0_wp, 1.0e-3_wp]
    later = run(scene)
    call check(method//', time shift: events', later%events == plain%events)
    if (later%events == plain%events) call check_close(method//', time shift: time of the events', &
      maxval(abs(later%event_time(2:) - 1.0_wp - plain%event_time(2:))), 0.0_wp, 1.0e-12_wp)
    call check_close(method//', time shift: u', relative(later%motion%u, plain%motion%u), 0.0_wp, 1.0e-10_wp)
    call check_close(method//', time shift: w', relative(later%velocity, plain%velocity), 0.0_wp, 1.0e-7_wp)
  end subroutine test_time_shift

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
