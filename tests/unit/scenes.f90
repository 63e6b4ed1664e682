!> Scenes for the unit tests, and their motions without any output.
module scenes
  use dst_kinds, only: wp
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_motion, only: next_piece
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_writer, only: writer_t
  use random_numbers, only: uniform, log_uniform
  implicit none
  private

  public :: fig3, fast, constant_friction, along_a_line, without_map, begin, go_to, complete, energy, velocity, fig3_slider, &
    random_slider, relative, identical, reference, reference_sticks

  !> States of Fig. 3, converged in quadruple precision with exact contact (tests/reference/fig3.json): t, u_x, u_y, w_x, w_y, and
  !> the number of sticks until then.
  real(wp), parameter :: reference(5, 5) = reshape([ &
    0.02_wp, 1.9995769485350064e-5_wp, 1.9872958183374369e-7_wp, 3.4657221958313615e-7_wp, 3.4464837227950101e-5_wp, &
    0.05_wp, 4.9981994355053295838e-5_wp, 1.9777009741426093201e-7_wp, 7.7718265581718725420e-7_wp, &
    3.0762498951531784662e-5_wp, &
    0.5_wp, 4.9881686313895216e-4_wp, 1.9613798061520180e-7_wp, 6.6869132069817701e-6_wp, 2.6297324897503335e-5_wp, &
    2.0_wp, 1.9692956749747725e-3_wp, 3.1878007765597037e-8_wp, 1.1151220751611373e-4_wp, 1.8056009394322286e-5_wp, &
    2.5_wp, 1.5711430457285813e-3_wp, 1.2381977151085114e-7_wp, 4.5514731831979764e-5_wp, 3.5908257054622328e-5_wp], [5, 5])
  integer, parameter :: reference_sticks(5) = [9, 39, 485, 1536, 1826]

contains

  !> Fig. 3's slider with a misalignment [deg] and, if given, another stiff spring [N/m] and a friction that weakens to mu_inf.
  function fig3_slider(misalignment_deg, stiffness_y, mu_inf) result(slider)
    real(wp), intent(in) :: misalignment_deg
    real(wp), intent(in), optional :: stiffness_y, mu_inf
    type(slider_t) :: slider
    real(wp) :: weakest

    weakest = 0.15_wp
    if (present(mu_inf)) weakest = mu_inf
    slider%mass = 0.25_wp
    slider%stiffness = [1.0e3_wp, 1.0e7_wp]
    if (present(stiffness_y)) slider%stiffness(2) = stiffness_y
    slider%along = cos_sin_degrees(misalignment_deg)
    call new_friction_law('weakening', 0.2_wp, weakest, 0.01_wp, 10.0_wp, slider%law)
  end function fig3_slider

  !> A slider with random parameters near those of Fig. 3, and dampers if wanted.
  function random_slider(damped) result(slider)
    logical, intent(in) :: damped
    type(slider_t) :: slider

    slider = fig3_slider(sum(uniform(1, -180.0_wp, 180.0_wp)))
    slider%mass = log_uniform(0.01_wp, 1.0_wp)
    slider%stiffness = [log_uniform(1.0e2_wp, 1.0e4_wp), log_uniform(1.0e4_wp, 1.0e7_wp)]
    if (damped) slider%damping = 2.0_wp*sqrt(slider%stiffness*slider%mass) &
      *[log_uniform(1.0e-2_wp, 3.0_wp), log_uniform(1.0e-2_wp, 3.0_wp)]
  end function random_slider

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
    type(writer_t), intent(out) :: writer
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

  !> Distance of a vector from another, relative to the latter.
  pure real(wp) function relative(actual, expected)
    real(wp), intent(in) :: actual(:), expected(:)

    relative = norm2(actual - expected)/norm2(expected)
  end function relative

  !> No difference; 0 and -0 are the same.
  elemental logical function identical(a, b)
    real(wp), intent(in) :: a, b

    identical = abs(a - b) <= 0.0_wp
  end function identical
end module scenes
