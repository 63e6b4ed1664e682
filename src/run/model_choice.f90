!> `model = 'auto'`: the cheapest model whose error against the full one stays below scene.accuracy.
!>
!> The closed forms are compared with the low-frequency motion, which costs below a millisecond. What that leaves
!> out, the elasticity across, is bounded by formulas that were calibrated on some thousand random scenes
!> (bench/model_choice.py, docs/models.md). Where the calibration does not reach, it is the full model.
!> A column that is asked for by name counts like a quantity: it must be the full model's, to the same accuracy.
module dst_model_choice
  use dst_kinds, only: wp
  use dst_creep, only: creep_t, creep_exact, position_third_order
  use dst_errors, only: error_t
  use dst_memory_writer, only: memory_writer_t
  use dst_methods, only: fixed_step_methods
  use dst_model_columns, only: column_obstacle, gives_column, holds_column
  use dst_columns, only: columns
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_text, only: formatted, has_word
  use dst_writer, only: outcome_t
  implicit none
  private

  public :: settle_model

  !> The low-frequency motion of a scene: X and u_x [m] at equal times, and its stick-slip.
  type :: slow_motion_t
    logical :: known = .false.
    real(wp), allocatable :: time(:), position(:), elongation(:)
    real(wp) :: cycles = 0.0_wp
    real(wp) :: swing = 0.0_wp     !! mean fall of k_x u_x over the static limit
    real(wp) :: fastest = 0.0_wp   !! largest |X'|, m/s
  end type slow_motion_t

  !> The advance X/l_x at the same times in three ways.
  type :: advances_t
    real(wp) :: length = 0.0_wp                !! l_x, m
    real(wp), allocatable :: tau(:)
    real(wp), allocatable :: slow(:)           !! low-frequency motion
    real(wp), allocatable :: rigid(:)          !! exact creep, rigid k_y
    real(wp), allocatable :: elastic(:)        !! exact creep
    real(wp) :: reached = 0.0_wp               !! the last of these
  end type advances_t

  integer, parameter :: samples = 64
  !> Most steps that the choice may cost.
  integer, parameter :: affordable_steps = 100000
  real(wp), parameter :: excluded = huge(1.0_wp)
  !> Accuracy of the low-frequency motion that the choice follows: far below any accuracy that is asked for. Convention.
  real(wp), parameter :: slow_rtol = 1.0e-8_wp

  ! All below is fitted to some 2700 random scenes and tried on others (bench/model_choice.py), so that the bounds hold with a
  ! margin of about five; docs/models.md gives the formulas. Doubling a margin doubles the estimate: fewer scenes are reduced, no
  ! number of a chosen model changes. Doubling what limits the range the other way leaves scenes that nobody has tried.
  !
  !> Range: least stiffness_y/stiffness_x, least tan(phi) over stiffness_x/stiffness_y, largest feeding of the fast oscillation.
  real(wp), parameter :: least_anisotropy = 1.0e3_wp, least_misalignment = 3.0_wp, largest_fast_growth = 0.03_wp
  !> Margins of what inertia and what a finite k_y does to slow creep, and of what the fast oscillation does to it.
  real(wp), parameter :: inertia_margin = 5.0_wp, elasticity_margin = 3.0_wp, fast_margin = 2.0_wp
  !> The fast oscillation: half periods in its advance (2 pi rounded down), and the factor of the square of its force.
  real(wp), parameter :: half_period_factor = 6.0_wp, fast_force_factor = 2.0_wp
  !> Of stick-slip the margin, the weight of k_x/k_y beside the fast growth, and the swing over F_0 below which cycles are
  !> sensitive, with their power.
  real(wp), parameter :: cycle_margin = 5.0_wp, anisotropy_weight = 30.0_wp, small_swing = 0.45_wp, swing_power = 1.5_wp
  !> Range of stick-slip: least cycles, least -F' over sqrt(m k_x), largest share of the critical tan(phi)^2, largest V/v_f.
  real(wp), parameter :: least_cycles = 2.0_wp, least_weakening = 2.5_wp, largest_share = 0.6_wp, largest_speed = 0.5_wp

  !> Format of the numbers in messages.
  character(*), parameter :: short = '(es8.1)'

contains

  !> Replace the model 'auto' by a model, and say why; other models are left alone, with no reason. If no column is asked
  !> for by name, the output is left with those that the model does not hold constant.
  subroutine settle_model(scene, reason)
    type(scene_t), intent(inout) :: scene
    character(:), allocatable, intent(out) :: reason
    type(slow_motion_t) :: slow
    type(slider_t) :: slider
    character(:), allocatable :: obstacle, passed_over
    real(wp) :: error

    reason = ''
    if (scene%model /= 'auto') return
    scene%model = 'full'
    call slider_from_scene(scene, slider)
    obstacle = obstacle_to_reduction(scene, slider)
    if (obstacle /= '') then
      reason = 'full: '//obstacle
      return
    end if
    passed_over = ''
    call follow_slow_motion(scene, slider, slow)
    if (scene%quantities == 'creep') then
      error = creep_error(scene, slider, slow, asymptotic=.true.)
      if (accept('creep_asymptotic')) then
        scene%form = 'third_order'
        return
      end if
      error = creep_error(scene, slider, slow, asymptotic=.false.)
      if (accept('creep')) return
    end if
    error = elasticity_error(scene, slider, slow)
    if (accept('low_frequency')) return
    reason = 'full: '//passed_over

  contains

    logical function accept(model)
      character(*), intent(in) :: model
      character(:), allocatable :: lack

      accept = .false.
      lack = lack_of_columns(scene, model)
      if (lack == '') then
        error = max(error, error_in_columns(scene, slider, slow, model, error))
        accept = error <= scene%accuracy
        lack = model//' is not known to be that accurate here'
        if (error < excluded) lack = model//' may err by '//formatted(short, error)
        lack = lack//', more than accuracy = '//formatted(short, scene%accuracy)
      end if
      if (.not. accept) then
        if (passed_over /= '') passed_over = passed_over//'; '
        passed_over = passed_over//lack
        return
      end if
      scene%model = model
      if (scene%fields(1) == 'default') scene%fields = free_columns(model)
      reason = model//': for '//trim(scene%quantities)//' it errs by at most '//formatted(short, error)// &
        ' (estimated), accuracy = '//formatted(short, scene%accuracy)
      if (passed_over /= '') reason = reason//'; '//passed_over
    end function accept
  end subroutine settle_model

  !> Why a model cannot stand for the full one in the columns asked for by name; '' if it can.
  function lack_of_columns(scene, model) result(text)
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: model
    character(:), allocatable :: text
    integer :: i

    text = ''
    if (scene%fields(1) == 'default') return
    do i = 1, size(scene%fields)
      text = column_obstacle(model, scene%fields(i))
      if (text /= '') return
    end do
  end function lack_of_columns

  !> The columns that a model gives and does not hold constant.
  pure function free_columns(model) result(names)
    character(*), intent(in) :: model
    character(len(columns%name)), allocatable :: names(:)

    names = pack(columns%name, columns%name /= 'time' .and. gives_column(model, columns%name) &
      .and. .not. holds_column(model, columns%name))
  end function free_columns

  !> Largest error of the columns asked for by name, each over its largest value, if the model errs by `error` in the
  !> quantities that it is chosen for.
  pure real(wp) function error_in_columns(scene, slider, slow, model, error) result(worst)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow
    character(*), intent(in) :: model
    real(wp), intent(in) :: error
    real(wp) :: of_position, of_elongation, shift, rigidity
    integer :: i

    worst = 0.0_wp
    if (scene%fields(1) == 'default' .or. error > scene%accuracy) return
    associate (along => slider%along(1), across => abs(slider%along(2)), speed => abs(scene%drive_velocity(1)), &
        advance => maxval(abs(slow%position)), stretch => maxval(abs(slow%elongation)))
      worst = excluded
      if (.not. (advance > 0.0_wp .and. stretch > 0.0_wp)) return
      if (scene%quantities == 'creep') then
        ! X = D - u_x cos(phi) - u_y sin(phi): what X errs by, and the u_y that a rigid spring lacks, is in u_x.
        of_position = error
        rigidity = merge(across*slider%law%static_limit/slider%stiffness(2), 0.0_wp, model == 'low_frequency')
        of_elongation = (error*advance + rigidity)/(along*stretch)
      else
        ! An error of the period shifts the slips in time.
        shift = error*scene%t_end
        of_position = error + slow%fastest*shift/advance
        of_elongation = error + (speed*along + slow%fastest/along)*shift/stretch
      end if
    end associate
    worst = 0.0_wp
    do i = 1, size(scene%fields)
      worst = max(worst, merge(of_position, of_elongation, scene%fields(i) == 'X'))
    end do
  end function error_in_columns

  !> Why no reduced model may be considered; '' if one may.
  function obstacle_to_reduction(scene, slider) result(text)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    character(:), allocatable :: text

    text = ''
    if (scene%quantities == 'high_frequency') then
      text = 'the high-frequency motion alone costs as much'
    else if (scene%contact /= 'exact') then
      text = 'the reduced models have the exact contact'
    else if (has_word(fixed_step_methods, scene%method)) then
      text = 'the method has a fixed step, and so no error estimate'
    else if (size(scene%drive_velocity) > 1 .or. .not. abs(scene%drive_velocity(1)) > 0.0_wp) then
      text = 'the errors of the reduced models are known for a constant drive velocity'
    else if (abs(scene%elongation_x) + abs(scene%elongation_y) > 0.0_wp) then
      text = 'the errors of the reduced models are known for unstretched springs at the start'
    else if (abs(scene%velocity_ratio) > 1.0_wp) then
      text = 'the errors of the reduced models are known for a slow start'
    else if (.not. slider%law%static_limit > 0.0_wp) then
      text = 'without friction there is nothing to reduce'
    else if (.not. slider%along(1) > 0.0_wp .or. .not. abs(slider%along(2)) > 0.0_wp) then
      text = 'the errors of the reduced models are known for 0 < |misalignment_deg| < 90'
    else if (slider%stiffness(2) < least_anisotropy*slider%stiffness(1)) then
      text = 'stiffness_y is below 1000 stiffness_x'
    else if (abs(slider%along(2)/slider%along(1)) < least_misalignment*slider%stiffness(1)/slider%stiffness(2)) then
      text = 'the misalignment is not above stiffness_x/stiffness_y'
    else if (fast_growth(slider) > largest_fast_growth) then
      text = 'weakening feeds the fast oscillation too strongly'
    end if
  end function obstacle_to_reduction

  !> Integrate the low-frequency motion.
  subroutine follow_slow_motion(scene, slider, slow)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(out) :: slow
    type(scene_t) :: sketch
    type(simulation_t) :: simulation
    type(memory_writer_t) :: writer
    type(outcome_t) :: outcome
    type(error_t), allocatable :: error

    sketch = scene
    sketch%model = 'low_frequency'
    ! Driven backwards it is the mirror image.
    sketch%drive_velocity = abs(scene%drive_velocity)
    sketch%method = 'radau9'
    sketch%rtol = slow_rtol
    sketch%step_max = 0.0_wp
    sketch%max_steps = affordable_steps
    sketch%interval = scene%t_end/real(samples, wp)
    sketch%wall_limit = 0.0_wp
    deallocate (sketch%fields)
    allocate (sketch%fields(2))
    sketch%fields = [character(len(sketch%fields)) :: 'X', 'u_x']
    call simulation%start(sketch, error)
    if (allocated(error)) return
    call simulation%proceed(huge(1.0_wp), writer, error)
    if (allocated(error)) return
    call simulation%outcome(error, outcome)
    slow%known = .true.
    slow%time = writer%samples(1, :writer%rows)
    slow%position = writer%samples(2, :writer%rows)
    slow%elongation = writer%samples(3, :writer%rows)
    slow%cycles = outcome%summary_of('cycles')
    slow%swing = simulation%summary%cycles%mean_swing()/slider%law%static_limit
    slow%fastest = abs(outcome%summary_of('max_X_rate'))
  end subroutine follow_slow_motion

  !> Exact creep beside the low-frequency motion.
  pure subroutine compare_advances(scene, slider, slow, advances)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow
    type(advances_t), intent(out) :: advances
    type(creep_t) :: creep(size(slow%time))

    associate (n => size(slow%time))
      allocate (advances%tau(n), advances%slow(n), advances%rigid(n), advances%elastic(n))
    end associate
    advances%length = slider%law%static_limit/slider%stiffness(1)
    advances%tau = abs(scene%drive_velocity(1))*slow%time/advances%length
    advances%slow = abs(slow%position)/advances%length
    creep = creep_exact(misalignment(slider), 0.0_wp, advances%tau)
    advances%rigid = creep%position
    creep = creep_exact(misalignment(slider), slider%stiffness(1)/slider%stiffness(2), advances%tau)
    advances%elastic = creep%position
    advances%reached = advances%elastic(size(advances%elastic))
  end subroutine compare_advances

  !> |phi| [rad].
  pure real(wp) function misalignment(slider)
    type(slider_t), intent(in) :: slider

    misalignment = atan2(abs(slider%along(2)), slider%along(1))
  end function misalignment

  !> Whether the drive moves by less than l_x: slip, and the end of Eq. (8), lie beyond.
  pure logical function is_before_slip(scene, slider)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider

    is_before_slip = abs(scene%drive_velocity(1))*scene%t_end < slider%law%static_limit/slider%stiffness(1)
  end function is_before_slip

  !> Largest error of X(t) over X(t_end) that a closed form makes: what it differs from the low-frequency motion where
  !> both have a rigid k_y, what the asymptotics differ from the exact creep, and the fast oscillation.
  pure real(wp) function creep_error(scene, slider, slow, asymptotic) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow
    logical, intent(in) :: asymptotic
    type(advances_t) :: advances
    real(wp) :: inertia, expansion

    error = excluded
    if (.not. (slow%known .and. scene%interval > 0.0_wp)) return
    if (asymptotic .and. .not. is_before_slip(scene, slider)) return
    call compare_advances(scene, slider, slow, advances)
    if (.not. advances%reached > 0.0_wp) return
    inertia = maxval(abs(advances%slow - advances%rigid))
    expansion = 0.0_wp
    if (asymptotic) expansion = maxval(abs(position_third_order(misalignment(slider), advances%tau) - advances%elastic))
    error = (inertia_margin*inertia + expansion)/advances%reached + fast_effect(scene, slider, advances)
  end function creep_error

  !> What the fast oscillation may do to the advance, over it.
  pure real(wp) function fast_effect(scene, slider, advances)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(advances_t), intent(in) :: advances

    fast_effect = fast_margin*(ripple(scene, slider, advances%reached*advances%length) + fast_growth(slider))
  end function fast_effect

  !> What the fast oscillation does to the advance over a distance [m]: the way made in half a period at the velocity
  !> V sin(phi), and the square of its force V sin(phi) sqrt(m k_y) over the static limit.
  pure real(wp) function ripple(scene, slider, distance)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: distance
    real(wp) :: across

    across = abs(scene%drive_velocity(1)*slider%along(2))
    ripple = half_period_factor*across*sqrt(slider%mass/slider%stiffness(2))/distance &
      + fast_force_factor*(across/slider%law%static_limit)**2*slider%mass*slider%stiffness(2)
  end function ripple

  !> How far weakening feeds the fast oscillation: F'^2/(m k_y), with the steepest F'.
  pure real(wp) function fast_growth(slider)
    type(slider_t), intent(in) :: slider
    real(wp) :: friction(1), slope(1)

    call slider%law%evaluate(1, [0.0_wp], friction, slope)
    fast_growth = min(slope(1), 0.0_wp)**2/(slider%mass*slider%stiffness(2))
  end function fast_growth

  !> Error of the low-frequency model for want of k_y.
  real(wp) function elasticity_error(scene, slider, slow) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow

    error = excluded
    if (.not. slow%known) return
    if (scene%quantities == 'creep') then
      error = elasticity_error_in_creep(scene, slider, slow)
    else
      error = elasticity_error_in_stick_slip(scene, slider, slow)
    end if
  end function elasticity_error

  !> Of the advance X(t) over X(t_end), before slip: what a finite k_y changes in the exact creep, and the fast oscillation.
  pure real(wp) function elasticity_error_in_creep(scene, slider, slow) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow
    type(advances_t) :: advances

    error = excluded
    if (slow%cycles > 0.0_wp .or. .not. is_before_slip(scene, slider)) return
    call compare_advances(scene, slider, slow, advances)
    if (.not. advances%reached > 0.0_wp) return
    error = elasticity_margin*maxval(abs(advances%elastic - advances%rigid))/advances%reached + fast_effect(scene, slider, advances)
  end function elasticity_error_in_creep

  !> Largest relative error of period, peak force and slip length. With F' the steepest weakening, F'^2 against m k_y
  !> and k_x against k_y count; small cycles are sensitive. Only for stick-slip that weakening drives strongly.
  pure real(wp) function elasticity_error_in_stick_slip(scene, slider, slow) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(slow_motion_t), intent(in) :: slow
    real(wp) :: speed, friction(2), slope(2)

    error = excluded
    if (slow%cycles < least_cycles) return
    speed = abs(scene%drive_velocity(1))
    call slider%law%evaluate(2, [0.0_wp, speed], friction, slope)
    if (-slope(1) < least_weakening*sqrt(slider%mass*slider%stiffness(1))) return
    ! Well inside the range of stick-slip, tan(phi)^2 < -V F'(V)/F(V), and where friction has not weakened at V.
    if ((slider%along(2)/slider%along(1))**2 > -largest_share*speed*slope(2)/friction(2) &
      .or. speed > largest_speed*scene%v_f) return
    error = cycle_margin*max(fast_growth(slider), anisotropy_weight*slider%stiffness(1)/slider%stiffness(2)) &
      *max(1.0_wp, small_swing/slow%swing)**swing_power
  end function elasticity_error_in_stick_slip
end module dst_model_choice
