!> From a scene to its motion: slider, drive, equations, method.
module dst_assembly
  use dst_cycle_map, only: cycle_map_t, new_cycle_map
  use dst_creep_motion, only: creep_motion_t, new_creep_motion
  use dst_drive, only: drive_t, new_drive
  use dst_errors, only: error_t, raise, deck_error
  use dst_friction, only: new_friction_law
  use dst_full_model, only: new_full_polar, new_full_smoothed
  use dst_kinds, only: wp
  use dst_methods, only: method_t, method_named
  use dst_low_frequency, only: new_low_frequency
  use dst_motion, only: motion_t
  use dst_past_rest, only: new_past_rest
  use dst_radau, only: new_radau
  use dst_runge_kutta, only: new_runge_kutta
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_slip_stick, only: slip_stick_t
  use dst_slip_system, only: slip_system_t
  use dst_stepper, only: stepper_t
  use dst_stepping, only: stepping_t
  use dst_straight_slip, only: new_straight_slip, on_line
  use dst_text, only: short_text
  implicit none
  private

  public :: new_motion, slider_from_scene

  ! The effects of "twice" were measured on Fig. 3 (rtol 1e-6 and 1e-8) and on drives that reverse.
  !
  !> Time for which the largest slip speed is kept, in radians of the faster oscillation. Convention: about one and a half
  !> oscillations. Twice: 1 % less work of dopri5 and 1.2 times the error, no change with radau9.
  real(wp), parameter :: memory = 10.0_wp
  !> Share of the peak speed over sqrt(rtol) below which a stop is finished in closed form: the remaining distance is below rtol of
  !> the distance slipped. Twice: 0.3 % fewer iterations of radau9, the same error.
  real(wp), parameter :: cut_factor = 0.03_wp
  !> Share of its largest velocity below which a ramp through zero counts as rest (low frequency), over sqrt(rtol), and the smallest
  !> share (which applies below rtol 1e-9): the drive displacement meanwhile is proportional to its square. Conventions. Twice: 3 %
  !> fewer steps, 1.1 times the error; no change.
  real(wp), parameter :: rest_factor = 0.1_wp, least_rest = 3.0e-6_wp

contains

  !> The motion of a scene at time 0; `other`, if there is one, alternates with it where the drive begins or ceases to rest.
  subroutine new_motion(scene, motion, other, error)
    type(scene_t), intent(in) :: scene
    class(motion_t), allocatable, intent(out) :: motion, other
    type(error_t), allocatable, intent(out) :: error
    type(slider_t) :: slider
    type(drive_t) :: drive
    class(slip_system_t), allocatable :: resting, sliding
    class(stepping_t), allocatable :: first, second
    type(cycle_map_t), allocatable :: map
    logical :: can_rest, rests_first

    call slider_from_scene(scene, slider)
    if (scene%mu_static > 0.0_wp .and. scene%mu_static < scene%mu_0) then
      call raise(error, deck_error, 'mu_static = '//trim(short_text(scene%mu_static))//' is below the friction coefficient '// &
        'F(0)/W as slip begins, mu_0 = '//trim(short_text(scene%mu_0))//': give mu_static >= mu_0, or 0 for the same', &
        'friction.mu_static')
      return
    end if
    drive = new_drive(scene%drive_time, scene%drive_velocity)
    if (scene%is_closed_form()) then
      call start_creep(scene, slider, drive, motion, error)
      return
    end if
    call choose_equations(scene, slider, drive, resting, sliding, error)
    if (.not. allocated(error)) call check_method(scene, drive, resting, sliding, error)
    if (allocated(error)) return
    can_rest = allocated(resting)
    rests_first = can_rest
    if (can_rest .and. allocated(sliding)) rests_first = drive%segment(1)%rests
    if (rests_first) then
      call new_steps(scene, slider, drive, resting, .true., first)
      if (allocated(sliding)) call new_steps(scene, slider, drive, sliding, .false., second)
    else
      call new_steps(scene, slider, drive, sliding, .false., first)
      if (can_rest) call new_steps(scene, slider, drive, resting, .true., second)
    end if
    call choose_method(scene, first%system, can_rest, first%stepper)
    call start_motion(scene, first)
    ! A release under a limit that ages is more than an angle; the rigid spring of the slow motion has no elongation at the limit.
    if (allocated(second) .or. (first%may_rest .and. scene%model == 'low_frequency') .or. slider%law%ageing > 0.0_wp) then
      call move_alloc(first, motion)
    else
      allocate (map)
      ! Whether a motion has settled is decided slip by slip, and these by steps.
      call new_cycle_map(first, scene%rtol, scene%cycle_map == 'auto', scene%settle > 0.0_wp, map)
      call move_alloc(map, motion)
    end if
    if (allocated(second)) call move_alloc(second, other)
  end subroutine new_motion

  !> The equations of motion by name: of motion that can rest (exact contact), of motion that cannot, or both.
  subroutine choose_equations(scene, slider, drive, resting, sliding, error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(inout) :: slider
    type(drive_t), intent(inout) :: drive
    class(slip_system_t), allocatable, intent(out) :: resting, sliding
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: slow

    select case (scene%model)
    case ('low_frequency')
      slider%free = [1.0_wp, 0.0_wp]
      slider%direction_free = .false.
      resting = new_straight_slip(slider, 1, [0.0_wp, 0.0_wp])
      if (.not. abs(slider%along(2)) > 0.0_wp) return
      slow = max(least_rest, rest_factor*sqrt(scene%rtol))
      drive = drive%with_rests(slow)
      sliding = new_low_frequency(slider)
      if (.not. any(drive%segment%rests)) deallocate (resting)
    case ('high_frequency')
      slider%free = [0.0_wp, 1.0_wp]
      slider%direction_free = .false.
      if (abs(slider%stiffness(1)*scene%elongation_x) >= slider%law%static_limit) then
        call raise(error, deck_error, 'high_frequency holds for a longitudinal load below the static limit: '// &
          '|stiffness_x*elongation_x| must be < mu_0*normal_load = '//trim(short_text(slider%law%static_limit))//' N', &
          'initial.elongation_x')
        return
      end if
      resting = new_straight_slip(slider, 2, [scene%elongation_x, 0.0_wp])
    case default
      if (scene%contact == 'exact') then
        resting = new_full_polar(slider)
      else
        sliding = new_full_smoothed(slider)
      end if
    end select
  end subroutine choose_equations

  !> Slow creep in closed form.
  subroutine start_creep(scene, slider, drive, motion, error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    class(motion_t), allocatable, intent(out) :: motion
    type(error_t), allocatable, intent(out) :: error
    type(creep_motion_t), allocatable :: creep
    character(:), allocatable :: form

    if (.not. scene%interval > 0.0_wp) then
      call raise(error, deck_error, "output.interval must be > 0 with model = '"//scene%model// &
        "': a closed form has no steps", 'output.interval')
      return
    end if
    form = ''
    if (scene%model == 'creep_asymptotic') form = scene%form
    allocate (creep)
    call new_creep_motion(slider, drive, form, scene%t_end, creep, error)
    call move_alloc(creep, motion)
  end subroutine start_creep

  !> The object and its contact.
  subroutine slider_from_scene(scene, slider)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(out) :: slider

    slider%mass = scene%mass
    slider%stiffness = [scene%stiffness_x, scene%stiffness_y]
    slider%damping = [scene%damping_x, scene%damping_y]
    slider%along = cos_sin_degrees(scene%misalignment_deg)
    call new_friction_law(scene%law, scene%mu_0, scene%mu_inf, scene%v_f, scene%normal_load, slider%law, &
      scene%exponent, scene%viscous, scene%table_speed, scene%table_mu)
    slider%law%static_limit = max(slider%law%static_limit, scene%mu_static*scene%normal_load)
    slider%law%ageing = scene%ageing*scene%normal_load
    slider%law%ageing_time = scene%ageing_time
    if (scene%contact /= 'exact') slider%smoothing = scene%v_smooth**2
  end subroutine slider_from_scene

  !> Refuse methods that cannot compute this motion.
  subroutine check_method(scene, drive, resting, sliding, error)
    type(scene_t), intent(in) :: scene
    type(drive_t), intent(in) :: drive
    class(slip_system_t), allocatable, intent(in) :: resting, sliding
    type(error_t), allocatable, intent(out) :: error
    type(method_t) :: method
    logical :: may_rest

    method = method_named(scene%method)
    may_rest = allocated(resting)
    if (may_rest .and. allocated(sliding)) may_rest = any(drive%segment%start < scene%t_end .and. drive%segment%rests)
    if (method%kind == 'fixed_step' .and. may_rest) then
      call raise(error, deck_error, "method '"//trim(method%name)// &
        "' cannot follow the exact contact, and here the object may come to rest: use an adaptive method", 'integrator.method')
    else if (method%kind == 'rosenbrock') then
      call raise(error, deck_error, "method 'rodas4p' is for the cases of a sweep, and keeps no series: use radau9", &
        'integrator.method')
    end if
  end subroutine check_method

  !> The integrators by name.
  subroutine choose_method(scene, system, can_rest, stepper)
    type(scene_t), intent(in) :: scene
    class(slip_system_t), intent(in) :: system
    logical, intent(in) :: can_rest
    class(stepper_t), allocatable, intent(out) :: stepper
    type(method_t) :: method

    method = method_named(scene%method)
    associate (n => system%components, m => system%unknowns)
      if (method%kind == 'implicit') then
        stepper = new_radau(method%stages, n, m, scene%rtol)
      else if (can_rest) then
        stepper = new_past_rest(scene%method, n, m, scene%rtol)
      else
        stepper = new_runge_kutta(scene%method, n, m, scene%rtol)
      end if
    end associate
    stepper%memory = memory/maxval(system%frequency)
  end subroutine choose_method

  !> Motion by steps of a system that can rest, or cannot.
  subroutine new_steps(scene, slider, drive, system, can_rest, motion)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    class(slip_system_t), allocatable, intent(inout) :: system
    logical, intent(in) :: can_rest
    class(stepping_t), allocatable, intent(out) :: motion
    type(slip_stick_t), allocatable :: made

    if (.not. can_rest) then
      allocate (stepping_t :: motion)
      motion%may_rest = .false.
      motion%fixed_step = scene%step
    else
      allocate (made)
      made%cut_share = cut_factor*sqrt(scene%rtol)
      call move_alloc(made, motion)
    end if
    motion%step_max = scene%step_max
    call motion%set_up(slider, drive, scene%t_end)
    ! With dampers, larger forces are subtracted.
    if (slider%is_damped()) system%acceleration_noise = slider%acceleration_noise(drive%largest_speed())
    call move_alloc(system, motion%system)
  end subroutine new_steps

  !> Initial elongation and slip velocity X'(0) = velocity_ratio V(0), Y'(0) = 0.
  subroutine start_motion(scene, motion)
    type(scene_t), intent(in) :: scene
    class(stepping_t), intent(inout) :: motion
    real(wp) :: u(2), y(2), w(2)

    u = [scene%elongation_x, scene%elongation_y]
    w = scene%velocity_ratio*scene%drive_velocity(1)*motion%slider%along
    select case (scene%model)
    case ('low_frequency')
      y = [w(1), 0.0_wp]
      if (motion%may_rest) y = on_line(w(1))
    case ('high_frequency')
      y = straight_slip_from(motion%slider, w, u)
    case default
      y = w
      if (motion%may_rest) y = [hypot(w(1), w(2)), atan2(w(2), w(1))]
    end select
    call motion%start(u, y, -dot_product(u, motion%slider%along))
  end subroutine start_motion

  !> (v, theta) of a slip in the direction in which friction balances the longitudinal load, F_0 cos(theta) = k_x u_x, on the side
  !> of u_y or of the drive, with the component of the velocity w in that direction.
  pure function straight_slip_from(slider, w, u) result(y)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: w(2), u(2)
    real(wp) :: y(2), side

    side = u(2)
    if (.not. abs(side) > 0.0_wp) side = w(2)
    y(2) = sign(acos(slider%stiffness(1)*u(1)/slider%law%static_limit), side)
    y(1) = max(0.0_wp, dot_product(w, [cos(y(2)), sin(y(2))]))
  end function straight_slip_from
end module dst_assembly
