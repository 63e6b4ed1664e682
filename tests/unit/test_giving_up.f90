!> A method that works for some steps and then fails in a given manner.
module failing_method
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use dst_drive, only: drive_segment_t
  use dst_kinds, only: wp
  use dst_slip_system, only: slip_system_t
  use dst_state, only: state_t
  use dst_stepper, only: stepper_t, attempt_t
  implicit none
  private

  public :: failing_t

  type, extends(stepper_t) :: failing_t
    character(12) :: manner = ''
    integer :: good_steps = 3
    integer :: attempts = 0
  contains
    procedure :: restart
    procedure :: attempt
    procedure :: accept
  end type failing_t

contains

  pure subroutine restart(self, rate, curvature)
    class(failing_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    associate (unused => [rate, curvature])
    end associate
    self%peak_speed = 0.0_wp
  end subroutine restart

  subroutine attempt(self, system, drive, from, step, to, outcome, to_stop)
    class(failing_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(in), optional :: to_stop

    associate (unused => system, also_unused => drive)
    end associate
    if (present(to_stop)) then
      if (to_stop) return
    end if
    self%attempts = self%attempts + 1
    self%step = step
    to = from
    to%time = from%time + step
    outcome%solved = .true.
    outcome%error = 0.5_wp
    outcome%factor = 1.0_wp
    if (self%good_steps > 0) return
    select case (self%manner)
    case ('collapsing')
      outcome%solved = .false.
      outcome%factor = 0.1_wp
    case ('stubborn')
      outcome%error = 2.0_wp
      outcome%factor = 0.9_wp
    case ('nan')
      to%u(1) = ieee_value(1.0_wp, ieee_quiet_nan)
    case ('nan work')
      to%friction_work = ieee_value(1.0_wp, ieee_quiet_nan)
    case ('standing')
      to%time = from%time
    case ('huge force')
      to%u(1) = 0.1_wp*huge(1.0_wp)
    end select
  end subroutine attempt

  pure subroutine accept(self)
    class(failing_t), intent(inout) :: self

    self%good_steps = self%good_steps - 1
  end subroutine accept
end module failing_method

!> Every way in which the solver gives up: its own result code, the time and the state, a remedy and the page that explains it. A
!> method that fails in a given way replaces the integrators.
program test_giving_up
  use checks, only: check, finish
  use dst_cycle_map, only: cycle_map_t
  use dst_kinds, only: wp
  use dst_errors, only: error_t, exit_status, step_underflow, too_many_steps, not_finite, too_many_rejections, chattering
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_writer, only: writer_t
  use failing_method, only: failing_t
  use scenes, only: fig3
  implicit none

  call expect('collapsing', step_underflow, 'step size fell to')
  call expect('stubborn', too_many_rejections, 'more than 60 steps in a row were rejected')
  call expect('standing', chattering, 'time stands still')
  if (.not. traps()) then
    call expect('nan', not_finite, 'the motion is not finite')
    call expect('nan work', not_finite, 'the motion is not finite')
    call expect('huge force', not_finite, 'spring_force_x is not finite')
  end if
  call expect('', too_many_steps, 'integrator.max_steps = 20')
  call finish()

contains

  !> Whether this build ends at a NaN or an overflow without a check of ours.
  logical function traps()
    use, intrinsic :: ieee_exceptions, only: ieee_get_halting_mode, ieee_invalid
    call ieee_get_halting_mode(ieee_invalid, traps)
  end function traps

  !> A smoothed scene with a method that works for some steps and then fails in this manner.
  subroutine expect(manner, code, words)
    character(*), intent(in) :: manner, words
    integer, intent(in) :: code
    type(scene_t) :: scene
    type(simulation_t) :: simulation
    type(writer_t) :: writer
    type(error_t), allocatable :: error
    type(failing_t) :: stepper

    scene = fig3(1.0_wp, 'dopri5', 1.0e-6_wp)
    scene%contact = 'smoothed'
    scene%v_smooth = 1.0e-5_wp
    scene%interval = 0.0_wp
    scene%max_steps = 20
    scene%fields = [character(24) :: 'u_x', 'spring_force_x']
    call simulation%start(scene, error)
    if (manner /= '') then
      scene%max_steps = 0
      simulation%scene%max_steps = 0
      stepper%manner = manner
      ! At time 0 every step increases the time.
      if (manner == 'stubborn') stepper%good_steps = 0
      call replace_method(simulation, stepper)
    end if
    call simulation%proceed(huge(1.0_wp), writer, error)
    call check(manner//': gives up', allocated(error))
    if (.not. allocated(error)) return
    call check(manner//': finished', simulation%finished .and. exit_status(error%code) == 4)
    call check(manner//': '//error%text, error%code == code .and. index(error%text, words) > 0)
    call check(manner//': time, state, remedy and page', index(error%text, 't =') > 0 .and. index(error%text, '(u =') > 0 &
      .and. index(error%text, '): ') > 0 .and. index(error%text, 'dynstiction help errors') > 0)
    call check(manner//': samples so far', writer%rows >= stepper%good_steps + 1)
    select type (motion => simulation%motion)
    class is (cycle_map_t)
      select type (method => motion%steps%stepper)
      type is (failing_t)
        call check(manner//': an attempt is accepted or rejected', &
          method%count%steps + method%count%rejected == method%attempts)
      end select
    end select
  end subroutine expect

  !> From now on this method makes the steps.
  subroutine replace_method(simulation, stepper)
    type(simulation_t), intent(inout) :: simulation
    type(failing_t), intent(inout) :: stepper

    select type (motion => simulation%motion)
    class is (cycle_map_t)
      stepper%grid = motion%steps%stepper%grid
      deallocate (motion%steps%stepper)
      allocate (motion%steps%stepper, source=stepper)
    end select
  end subroutine replace_method
end program test_giving_up
