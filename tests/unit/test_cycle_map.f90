!> Fast cycles that are leapt equal those computed by steps: as many sticks, at the same times, to the same state; where there is
!> nothing to leap the map changes no bit. That mirrors and samples do not matter:
!> tests/invariance; nor stopping inside a leap: test_resume.f90.
program test_cycle_map
  use checks, only: check, check_close, finish
  use scenes, only: fig3, fast, constant_friction, along_a_line, without_map, begin, complete, energy, velocity, relative, identical
  use dst_kinds, only: wp, int64
  use dst_piece, only: stick_begins
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_state, only: state_t
  use dst_stepper, only: work_count_t
  use dst_writer, only: writer_t
  implicit none

  real(wp), parameter :: rtol = 1.0e-9_wp

  !> How a run ends, and its events.
  type :: result_t
    logical :: sound = .false.
    type(state_t) :: state
    type(work_count_t) :: work
    real(wp) :: velocity(2) = 0.0_wp
    real(wp) :: imbalance = 0.0_wp      !! of the energies, relative to the drive's work
    real(wp), allocatable :: time(:)
    integer, allocatable :: kind(:)
    real(wp), allocatable :: samples(:, :)
  end type result_t

  type(scene_t) :: scene


  call compare('Fig. 3', fig3(4.2_wp, 'radau9', rtol))
  call compare('radau5', fig3(2.2_wp, 'radau5', 1.0e-8_wp))
  call compare('radau13', fig3(4.2_wp, 'radau13', rtol))
  call compare('dopri5', fig3(1.2_wp, 'dopri5', 1.0e-7_wp))
  call compare('dop853', fig3(1.2_wp, 'dop853', 1.0e-7_wp))
  scene = fig3(4.2_wp, 'radau9', rtol)
  scene%drive_velocity = -scene%drive_velocity
  call compare('backwards', scene)
  scene = fig3(2.2_wp, 'radau9', rtol)
  scene%stiffness_y = 1.0e8_wp
  call compare('stiff', scene)
  scene = fig3(2.2_wp, 'radau9', rtol)
  scene%misalignment_deg = 10.0_wp
  call compare('10 degrees', scene)
  ! One slow cycle, a stretch twice as fast, and the first velocity again.
  scene = fig3(6.0_wp, 'radau9', rtol)
  scene%drive_time = [0.0_wp, 2.5_wp, 2.6_wp, 3.6_wp, 3.8_wp]
  scene%drive_velocity = [1.0e-3_wp, 1.0e-3_wp, 2.0e-3_wp, 2.0e-3_wp, -1.0e-3_wp]
  call compare('there and back', scene)

  call test_unused('smoothed', smoothed())
  scene = fig3(2.0_wp, 'radau9', 1.0e-7_wp)
  scene%drive_time = [0.0_wp, 3.0_wp]
  scene%drive_velocity = [1.0e-3_wp, 1.2e-3_wp]
  call test_unused('V grows all the time', scene)
  call test_unused('constant friction', constant_friction(fig3(1.0_wp, 'radau9', 1.0e-7_wp)))
  call test_unused('along a line', along_a_line(fig3(3.0_wp, 'radau9', 1.0e-7_wp)))

  call compare('without a rest', fast(fig3(4.0_wp, 'radau13', rtol)), rests=.false.)
  call compare('without a rest, dop853', fast(fig3(1.5_wp, 'dop853', 1.0e-7_wp)), rests=.false.)
  scene = fast(fig3(4.0_wp, 'radau9', rtol))
  scene%misalignment_deg = -scene%misalignment_deg
  scene%drive_velocity = -scene%drive_velocity
  call compare('without a rest, mirrored and backwards', scene, rests=.false.)
  call compare('smoothed, fast', fast(smoothed()), rests=.false.)
  scene = fig3(12.0_wp, 'radau9', 1.0e-7_wp)
  scene%model = 'low_frequency'
  call compare('low frequency', scene, rests=.false.)
  call compare('low frequency, fast', fast(scene), rests=.false.)
  call finish()

contains

  function smoothed() result(scene)
    type(scene_t) :: scene

    scene = fig3(3.0_wp, 'radau9', 1.0e-6_wp)
    scene%contact = 'smoothed'
    scene%v_smooth = 1.0e-5_wp
  end function smoothed

  subroutine run(scene, found)
    type(scene_t), intent(in) :: scene
    type(result_t), intent(out) :: found
    type(simulation_t) :: simulation
    type(writer_t) :: writer
    real(wp) :: before

    call begin(scene, simulation)
    before = energy(simulation)
    call complete(scene, simulation, writer, found%sound)
    found%state = simulation%motion%piece%to
    found%work = simulation%motion%work()
    found%velocity = velocity(simulation)
    found%imbalance = (found%state%drive_work - found%state%friction_work - (energy(simulation) - before)) &
      /max(tiny(1.0_wp), abs(found%state%drive_work))
    allocate (found%time(writer%events), found%kind(writer%events))
    if (writer%events > 0) then
      found%time = writer%log(:writer%events)%time
      found%kind = writer%log(:writer%events)%kind
    end if
    found%samples = writer%samples(:, :writer%rows)
  end subroutine run

  !> With the map and without: sticks, times, final state, works, samples, energy balance; `rests`: many passages are leapt, if not,
  !> some slow cycles without a rest.
  subroutine compare(name, scene, rests)
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    logical, intent(in), optional :: rests
    type(result_t) :: map, steps
    real(wp) :: limit(5)
    integer(int64) :: least
    logical :: has_sticks

    has_sticks = .true.
    if (present(rests)) has_sticks = rests

    call run(scene, map)
    call run(without_map(scene), steps)
    call check(name//': both run to the end', map%sound .and. steps%sound)
    least = merge(size(steps%time)/4, 3, has_sticks)
    call check(name//': the map is used, if it is not off', map%work%cycles_leapt > least &
      .and. steps%work%cycles_leapt == 0 .and. steps%work%cycles_sampled == 0)
    call check_close(name//': error of the tables', map%work%map_error, 0.0_wp, 0.1_wp*scene%rtol)
    call check(name//': as many events', size(map%time) == size(steps%time))
    call check(name//': as many events are counted', map%work%events == steps%work%events)
    if (size(map%time) /= size(steps%time)) return
    call check(name//': of the same kinds', all(map%kind == steps%kind))
    if (has_sticks) call check(name//': there are sticks', count(map%kind == stick_begins) > 100)
    if (size(map%time) > 0) &
      call check_close(name//': times of events', maxval(abs(map%time - steps%time)), 0.0_wp, rtol*scene%t_end)
    call check_close(name//': final time', map%state%time, steps%state%time, 0.0_wp)
    call check_close(name//': u', relative(map%state%u, steps%state%u), 0.0_wp, 10.0_wp*scene%rtol)
    ! At the end the fast oscillation may be in any phase: its velocity differs as much as the times do.
    call check_close(name//': w', norm2(map%velocity - steps%velocity), 0.0_wp, 3.0e-6_wp*maxval(abs(scene%drive_velocity)))
    call check_close(name//': X', map%state%position, steps%state%position, 10.0_wp*scene%rtol*abs(steps%state%position))
    call check_close(name//': work of the drive', map%state%drive_work, steps%state%drive_work, &
      10.0_wp*scene%rtol*abs(steps%state%drive_work))
    call check_close(name//': work of friction', map%state%friction_work, steps%state%friction_work, &
      10.0_wp*scene%rtol*abs(steps%state%friction_work))
    call check_close(name//': energy balance', map%imbalance, 0.0_wp, 10.0_wp*scene%rtol)
    call check(name//': as many samples', all(shape(map%samples) == shape(steps%samples)))
    if (any(shape(map%samples) /= shape(steps%samples))) return
    ! An excursion that is reused began at a slightly different angle.
    limit = [0.0_wp, 10.0_wp, 10.0_wp, 30.0_wp, 30.0_wp]*scene%rtol
    if (map%work%excursions_reused > 0) limit = max(limit, [0.0_wp, 1.0e-6_wp, 1.0e-6_wp, 1.0e-5_wp, 1.0e-5_wp])
    limit = limit*maxval(abs(steps%samples), dim=2)
    call check(name//': samples', all(maxval(abs(map%samples - steps%samples), dim=2) <= limit))
  end subroutine compare

  !> If there is nothing to leap, the map changes no bit.
  subroutine test_unused(name, scene)
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    type(result_t) :: map, steps

    call run(scene, map)
    call run(without_map(scene), steps)
    call check(name//': both run to the end', map%sound .and. steps%sound)
    call check(name//': no cycle is leapt or run in vain', map%work%cycles_leapt == 0 .and. map%work%cycles_sampled == 0)
    call check(name//': the same final state', all(identical( &
      [map%state%time, map%state%time_rest, map%state%u, map%state%y, map%state%position], &
      [steps%state%time, steps%state%time_rest, steps%state%u, steps%state%y, steps%state%position])) &
      .and. identical(map%state%drive_work, steps%state%drive_work) &
      .and. identical(map%state%friction_work, steps%state%friction_work))
    call check(name//': as many rows', all(shape(map%samples) == shape(steps%samples)) .and. size(map%time) == size(steps%time))
    if (any(shape(map%samples) /= shape(steps%samples)) .or. size(map%time) /= size(steps%time)) return
    call check(name//': the same samples', all(identical(map%samples, steps%samples)))
    call check(name//': the same events', all(identical(map%time, steps%time)) .and. all(map%kind == steps%kind))
    call check(name//': the same work', map%work%steps == steps%work%steps .and. map%work%rhs == steps%work%rhs)
  end subroutine test_unused
end program test_cycle_map
