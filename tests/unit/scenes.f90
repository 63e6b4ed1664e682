!> Scenes for the unit tests, and their motions without any output.
module scenes
  use dst_kinds, only: wp
  use dst_errors, only: error_t
  use dst_memory_writer, only: memory_writer_t
  use dst_motion, only: next_piece
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  implicit none
  private

  public :: fig3, fast, constant_friction, along_a_line, without_map, begin, go_to, complete, energy, velocity

contains

  !> Fig. 3 of Nakano & Popov (2020), to be run to `t_end`.
  function fig3(t_end, method, rtol) result(scene)
    real(wp), intent(in) :: t_end, rtol
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene%title = ''
    scene%model = 'full'
    scene%law = 'weakening'
    scene%contact = 'exact'
    scene%method = method
    scene%cycle_map = 'auto'
    scene%output_file = ''
    scene%t_end = t_end
    scene%mass = 0.25_wp
    scene%stiffness_x = 1.0e3_wp
    scene%stiffness_y = 1.0e7_wp
    scene%misalignment_deg = 1.0_wp
    scene%mu_0 = 0.20_wp
    scene%mu_inf = 0.15_wp
    scene%v_f = 0.010_wp
    scene%normal_load = 10.0_wp
    scene%velocity_ratio = 1.0e-6_wp
    scene%rtol = rtol
    scene%interval = 1.0e-3_wp
    allocate (scene%drive_time(1), source=0.0_wp)
    allocate (scene%drive_velocity(1), source=1.0e-3_wp)
    allocate (scene%fields(4))
    scene%fields = [character(24) :: 'u_x', 'u_y', 'w_x', 'w_y']
  end function fig3

  !> The same with mu_inf = mu_0.
  pure function constant_friction(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%law = 'constant'
    changed%mu_inf = scene%mu_0
    changed%v_f = 1.0_wp
  end function constant_friction

  !> So fast that the object does not come to rest after some slow cycles, which repeat.
  pure function fast(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%drive_velocity = 50.0_wp*scene%drive_velocity
  end function fast

  !> The same with misalignment 0: all motion is along the soft axis.
  pure function along_a_line(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%misalignment_deg = 0.0_wp
  end function along_a_line

  !> The same without the cycle map: each piece is a step.
  pure function without_map(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%cycle_map = 'off'
  end function without_map

  !> The scene at time 0.
  subroutine begin(scene, simulation)
    type(scene_t), intent(in) :: scene
    type(simulation_t), intent(out) :: simulation
    type(error_t), allocatable :: error

    call simulation%start(scene, error)
    if (allocated(error)) error stop 'a test scene is refused'
  end subroutine begin

  !> Continue until a piece ends after `time` [s], or to the end; `sound` is false if the solver gives up.
  subroutine go_to(simulation, time, sound)
    type(simulation_t), intent(inout) :: simulation
    real(wp), intent(in) :: time
    logical, intent(out) :: sound
    type(error_t), allocatable :: error

    sound = .true.
    do while (.not. simulation%motion%finished() .and. simulation%motion%piece%to%time < time)
      call next_piece(simulation%motion, simulation%other, error)
      sound = .not. allocated(error)
      if (.not. sound) return
    end do
  end subroutine go_to

  !> Run a scene to its end, with all its output.
  subroutine complete(scene, simulation, writer, sound)
    type(scene_t), intent(in) :: scene
    type(simulation_t), intent(out) :: simulation
    type(memory_writer_t), intent(out) :: writer
    logical, intent(out) :: sound
    type(error_t), allocatable :: error

    call begin(scene, simulation)
    call simulation%proceed(huge(1.0_wp), writer, error)
    sound = .not. allocated(error)
  end subroutine complete

  !> Slip velocity [m/s] at the end of the last piece.
  pure function velocity(simulation)
    type(simulation_t), intent(in) :: simulation
    real(wp) :: velocity(2)

    velocity = simulation%motion%velocity_now()
  end function velocity

  !> Kinetic and elastic energy [J] at the end of the last piece.
  pure real(wp) function energy(simulation)
    type(simulation_t), intent(in) :: simulation

    associate (motion => simulation%motion)
      energy = 0.5_wp*(motion%slider%mass*sum(velocity(simulation)**2) &
        + sum(motion%slider%stiffness*motion%piece%to%u**2))
    end associate
  end function energy
end module scenes
