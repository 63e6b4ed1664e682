!> `model = 'auto'`: the cheapest model whose error compared with the full one stays below scene.accuracy.
!>
!> The error of a reduced model, due to the fast oscillation and the elasticity of the stiff axis, is bounded by formulas whose
!> factors were fitted to some 6000 random scenes and tested on others (bench/model_choice.py, docs/models.md). Those of stick-slip
!> depend on how creep ends (dst_creep_end): only if the fast oscillation has decayed before slip is the slow motion independent of
!> it. The effect of inertia on the closed forms follows from the low-frequency motion, which costs below a millisecond and is run
!> only if it can change the choice. Outside the range of the calibration, the full model is chosen.
!> A column that is requested by name counts like a quantity: it must be that of the full model, to the same accuracy.
module dst_model_choice
  use dst_kinds, only: wp, int64
  use dst_creep, only: creep_t, creep_exact, position_third_order
  use dst_creep_end, only: creep_end_t, creep_end
  use dst_errors, only: error_t
  use dst_friction, only: falls_exponentially
  use dst_memory_writer, only: memory_writer_t
  use dst_methods, only: fixed_step_methods
  use dst_model_columns, only: column_obstacle, gives_column, holds_column
  use dst_columns, only: columns
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_slow_validity, only: slow_validity_t, slow_validity, rigidity_obstacle, slip_error, margin, gradual
  use dst_stepper, only: work_count_t
  use dst_plain_numbers, only: number_text
  use dst_text, only: has_word
  use dst_writer, only: outcome_t
  implicit none
  private

  public :: settle_model

  !> Number of equal parts of a run at whose ends models are compared.
  integer, parameter :: samples = 64

  !> The low-frequency motion of a scene: X and u_x [m] at equal times, and whether it slips.
  type :: slow_motion_t
    logical :: tried = .false.     !! whether it has been run
    logical :: known = .false.     !! with success
    logical :: has_slipped = .false.
    real(wp), allocatable :: time(:), position(:), elongation(:)
    real(wp) :: cycles = 0.0_wp
    real(wp) :: fastest = 0.0_wp   !! largest |X'|, m/s
    real(wp) :: load = 0.0_wp      !! largest |k_x u_x|, N
    real(wp) :: swing = 0.0_wp     !! mean fall of k_x u_x over the static limit
    integer(int64) :: iterations = 0   !! Newton iterations, its cost
  end type slow_motion_t

  !> The advance X/l_x at equal times in two ways.
  type :: advances_t
    real(wp) :: tau(0:samples) = 0.0_wp
    real(wp) :: rigid(0:samples) = 0.0_wp      !! exact creep, rigid k_y
    real(wp) :: elastic(0:samples) = 0.0_wp    !! exact creep
    real(wp) :: reached = 0.0_wp               !! the last value of these
    real(wp) :: elasticity = 0.0_wp            !! largest difference of the two, over the last value
  end type advances_t

  !> Quantities that are small if a reduced model is accurate. Without unit.
  type :: smallness_t
    logical :: weakens = .false.
    logical :: will_slip = .false.             !! it has been driven far beyond the end of creep
    real(wp) :: softness = 0.0_wp              !! k_x/k_y
    real(wp) :: delay = 0.0_wp                 !! k_x/(k_y tan(phi)), about V t/l_x up to which the object truly sticks
    real(wp) :: ripple = 0.0_wp                !! V sin(phi) sqrt(m k_y)/F_0, force of the fast oscillation
    real(wp) :: inertia = 0.0_wp               !! V sin(phi) sqrt(m k_x)/F_0
    real(wp) :: feeding = 0.0_wp               !! F'(0)^2/(m k_y)
    real(wp) :: drift = 0.0_wp                 !! fall of friction over F_0, up to the velocity V sin(phi)
    real(wp) :: weakening = 0.0_wp             !! -F'(0)/sqrt(m k_x)
    real(wp) :: share = 0.0_wp                 !! tan(phi)^2 over its critical value, if friction weakens at V
    real(wp) :: speed = 0.0_wp                 !! V/v_f
    real(wp) :: length = 0.0_wp                !! V t_end/l_x
    real(wp) :: sine = 0.0_wp                  !! |sin(phi)|
    type(creep_end_t) :: end
    type(slow_validity_t) :: slow              !! whether the slow motion holds through slips
    type(advances_t) :: creep
  end type smallness_t

  !> Largest number of steps for the choice.
  integer, parameter :: affordable_steps = 100000
  real(wp), parameter :: excluded = huge(1.0_wp)
  !> Accuracy of the low-frequency motion that the choice uses: far below any accuracy that is requested. Convention.
  real(wp), parameter :: slow_rtol = 1.0e-8_wp

  ! All constants below are fitted to some 6000 random scenes and tested on 4000 others of free lengths: the largest error is 0.8 of
  ! its estimate (bench/model_choice.py draws others); docs/models.md gives the formulas. A larger margin reduces fewer scenes, and
  ! changes no number of a chosen model. A wider range admits scenes that have not been tested.
  !
  !> Range of creep: largest ripple, largest contribution of inertia to it.
  real(wp), parameter :: largest_ripple = 2.0_wp, largest_inertia = 0.3_wp
  !> With weakening friction: largest ripple, largest feeding over sin(theta)^2 before slip, share of the load at the end of creep
  !> up to which the motion is creep, largest share of the critical tan(phi)^2.
  real(wp), parameter :: largest_weak_ripple = 0.5_wp, largest_feeding = 0.3_wp, near_slip = 0.95_wp, largest_share = 0.6_wp
  !> V t/l_x from which on an object whose creep ends has slipped; scenes between these limits are checked. Convention.
  real(wp), parameter :: surely_slipped = 2.0_wp
  !> For stick-slip, besides those at slip (dst_slow_validity): weights of delay, inertia, feeding, drift.
  real(wp), parameter :: delay_weight = 0.03_wp, inertia_weight = 0.2_wp, feeding_weight = 0.05_wp, drift_weight = 0.4_wp
  !> For creep: weights of the effect of inertia on a closed form, and on low_frequency with weakening; of the ripple added to 1; of
  !> a finite k_y: as it raises both, as it remains after slip, and in low_frequency; of k_x/k_y after slip.
  real(wp), parameter :: inertia_in_creep = 2.0_wp, inertia_in_slow = 1.0_wp, ripple_weight = 10.0_wp, elastic_gain = 50.0_wp, &
    elastic_remainder = 0.2_wp, elastic_in_slow = 1.5_wp, softness_in_slow = 3.0_wp
  !> For strong stick-slip, fitted to 2700 scenes: its own margin, the weight of k_x/k_y added to the feeding, and the amplitude
  !> (peak to peak) over F_0 below which cycles are sensitive, with their power. Its range: largest feeding, largest k_x/k_y, fewest
  !> cycles, largest V/v_f.
  real(wp), parameter :: strong_margin = 5.0_wp, softness_weight = 30.0_wp, small_swing = 0.45_wp, swing_power = 1.5_wp
  real(wp), parameter :: largest_strong_feeding = 0.03_wp, largest_softness = 1.0e-3_wp, least_cycles = 2.0_wp, &
    largest_speed = 0.5_wp

contains

  !> Replace the model 'auto' by a model, and say why; other models are not changed, and need no reason. If no column is requested
  !> by name, the output has only the columns that the model does not keep constant.
  subroutine settle_model(scene, reason)
    type(scene_t), intent(inout) :: scene
    character(:), allocatable, intent(out) :: reason
    type(slow_motion_t) :: slow
    type(slider_t) :: slider
    type(smallness_t) :: small
    character(:), allocatable :: passed_over
    character(20) :: cost

    reason = ''
    if (scene%model /= 'auto') return
    scene%model = 'full'
    call slider_from_scene(scene, slider)
    reason = obstacle_to_reduction(scene, slider)
    if (reason /= '') then
      reason = 'full: '//reason
      return
    end if
    small = smallness_of(scene, slider)
    passed_over = ''
    if (scene%quantities == 'creep') then
      if (.not. accept('creep_asymptotic')) then
        if (.not. accept('creep')) call settle_on_integration()
      else
        scene%form = 'third_order'
      end if
    else
      call settle_on_integration()
    end if
    if (slow%tried) then
      write (cost, '(i0)') slow%iterations
      reason = reason//'; the choice took '//trim(cost)//' Newton iterations'
    end if

  contains

    subroutine settle_on_integration()
      if (.not. accept('low_frequency')) reason = 'full: '//passed_over
    end subroutine settle_on_integration

    logical function accept(model)
      character(*), intent(in) :: model
      character(:), allocatable :: lack
      real(wp) :: error

      accept = .false.
      lack = lack_of_columns(scene, model)
      if (lack == '') then
        error = estimated_error(scene, slider, small, model, slow)
        accept = error <= scene%accuracy
        if (error < excluded) then
          lack = model//' may have an error of '//number_text(error, 2)//', more than accuracy = '//number_text(scene%accuracy, 2)
        else
          lack = model//' is not known to be that accurate here'
          if (scene%quantities == 'stick_slip' .and. small%slow%obstacle /= '') lack = lack//': '//trim(small%slow%obstacle)
        end if
      end if
      if (.not. accept) then
        if (passed_over /= '') passed_over = passed_over//'; '
        passed_over = passed_over//lack
        return
      end if
      scene%model = model
      if (scene%fields(1) == 'default') scene%fields = free_columns(model)
      reason = model//': for '//trim(scene%quantities)//' its error is at most '//number_text(error, 2)// &
        ' (estimated), accuracy = '//number_text(scene%accuracy, 2)
      if (passed_over /= '') reason = reason//'; '//passed_over
    end function accept
  end subroutine settle_model

  !> Largest error of a model in the requested quantities. Estimates that need no motion come first: if they exceed the accuracy, or
  !> are complete, the low-frequency motion is not run.
  real(wp) function estimated_error(scene, slider, small, model, slow) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    character(*), intent(in) :: model
    type(slow_motion_t), intent(inout) :: slow

    if (scene%quantities == 'creep') then
      error = least_error_in_creep(small, model)
    else
      error = least_error_in_stick_slip(small)
    end if
    if (error > scene%accuracy) return
    if (.not. slow%tried) call follow_slow_motion(scene, slider, slow)
    if (.not. slow%known) then
      error = excluded
    else if (scene%quantities == 'creep') then
      error = error_in_creep(slider, small, slow, model)
    else
      error = error_in_stick_slip(slider, small, slow)
    end if
    error = max(error, error_in_columns(scene, slider, small, slow, model, error))
  end function estimated_error

  !> Why a model cannot replace the full one in the columns requested by name; '' if it can.
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

  !> The columns that a model provides and does not keep constant.
  pure function free_columns(model) result(names)
    character(*), intent(in) :: model
    character(len(columns%name)), allocatable :: names(:)

    names = pack(columns%name, columns%name /= 'time' .and. gives_column(model, columns%name) &
      .and. .not. holds_column(model, columns%name))
  end function free_columns

  !> Largest error of the columns requested by name, each over its largest value, if the model has the error `error` in the
  !> quantities for which it is chosen.
  pure real(wp) function error_in_columns(scene, slider, small, slow, model, error) result(worst)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
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
        ! X = D - u_x cos(phi) - u_y sin(phi): the error of X, and the u_y that a rigid spring lacks, are in u_x.
        of_position = error
        rigidity = merge(across*slider%law%static_limit/slider%stiffness(2), 0.0_wp, model == 'low_frequency')
        of_elongation = (error*advance + rigidity)/(along*stretch)
      else
        ! An error of the period shifts the slips in time. Without slip X is creep.
        shift = error*scene%t_end
        of_position = error + slow%fastest*shift/advance
        if (.not. (small%weakens .and. slow%has_slipped)) &
          of_position = max(of_position, error_in_creep(slider, small, slow, model))
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
      text = 'the errors of the reduced models are known only for a constant drive velocity'
    else if (abs(scene%elongation_x) + abs(scene%elongation_y) > 0.0_wp) then
      text = 'the errors of the reduced models are known only for unstretched springs at the start'
    else if (abs(scene%velocity_ratio) > 1.0_wp) then
      text = 'the errors of the reduced models are known only for a slow start'
    else if (slider%is_damped()) then
      text = 'the errors of the reduced models are known only without dampers'
    else if (.not. falls_exponentially(slider%law)) then
      text = "the errors of the reduced models are known only for the laws 'constant' and 'weakening'"
    else if (slider%law%holds_more()) then
      text = 'the errors of the reduced models are known only without a separate static limit (mu_static, ageing)'
    else if (.not. slider%law%static_limit > 0.0_wp) then
      text = 'without friction there is nothing to reduce'
    else if (.not. slider%along(1) > 0.0_wp .or. .not. abs(slider%along(2)) > 0.0_wp) then
      text = 'the errors of the reduced models are known only for 0 < |misalignment_deg| < 90'
    else
      text = rigidity_obstacle(slider)
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
    type(work_count_t) :: work

    slow%tried = .true.
    sketch = scene
    sketch%model = 'low_frequency'
    ! If it is driven backwards it is the mirror image.
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
    work = simulation%motion%work()
    slow%iterations = work%newton
    if (allocated(error)) return
    call simulation%outcome(error, outcome)
    slow%known = .true.
    slow%time = writer%samples(1, :writer%rows)
    slow%position = writer%samples(2, :writer%rows)
    slow%elongation = writer%samples(3, :writer%rows)
    slow%cycles = outcome%summary_of('cycles')
    slow%fastest = abs(outcome%summary_of('max_X_rate'))
    slow%load = slider%stiffness(1)*maxval(abs(slow%elongation))
    slow%swing = simulation%summary%cycles%mean_swing()/slider%law%static_limit
    slow%has_slipped = simulation%summary%has_slipped
  end subroutine follow_slow_motion

  !> The small numbers of a scene to which the estimates apply.
  function smallness_of(scene, slider) result(small)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(smallness_t) :: small
    real(wp) :: speed, across, friction(3), slope(3)

    speed = abs(scene%drive_velocity(1))
    across = speed*abs(slider%along(2))
    call slider%law%evaluate(3, [0.0_wp, across, speed], friction, slope)
    associate (limit => slider%law%static_limit, mass => slider%mass, stiffness => slider%stiffness)
      small%weakens = minval(slope) < 0.0_wp
      small%sine = abs(slider%along(2))
      small%softness = stiffness(1)/stiffness(2)
      small%delay = small%softness*abs(slider%along(1)/slider%along(2))
      small%ripple = across/limit*sqrt(mass*stiffness(2))
      small%inertia = across/limit*sqrt(mass*stiffness(1))
      small%length = speed*scene%t_end*stiffness(1)/limit
      if (small%weakens) then
        small%feeding = minval(slope)**2/(mass*stiffness(2))
        small%weakening = -minval(slope)/sqrt(mass*stiffness(1))
        small%drift = min(-minval(slope)*across, limit - minval(friction))/limit
        small%share = excluded
        if (slope(3) < 0.0_wp) small%share = (slider%along(2)/slider%along(1))**2*friction(3)/(-speed*slope(3))
        small%speed = speed/scene%v_f
        small%end = creep_end(slider, speed)
        small%slow = slow_validity(slider, speed, excluded)
        small%will_slip = small%end%exists .and. small%length > surely_slipped
      end if
    end associate
    if (scene%quantities == 'creep' .or. scene%fields(1) /= 'default') small%creep = creep_in_two_ways(slider, small)
  end function smallness_of

  !> Exact creep with the elastic and with a rigid stiff spring.
  pure function creep_in_two_ways(slider, small) result(advances)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    type(advances_t) :: advances
    type(creep_t) :: creep(0:samples)
    real(wp) :: phi
    integer :: i

    phi = atan2(abs(slider%along(2)), slider%along(1))
    advances%tau = small%length*[(real(i, wp)/real(samples, wp), i=0, samples)]
    creep = creep_exact(phi, 0.0_wp, advances%tau)
    advances%rigid = creep%position
    creep = creep_exact(phi, small%softness, advances%tau)
    advances%elastic = creep%position
    advances%reached = creep(samples)%position
    if (advances%reached > 0.0_wp) advances%elasticity = maxval(abs(advances%elastic - advances%rigid))/advances%reached
  end function creep_in_two_ways

  !> The effect of the fast oscillation on the advance, relative to it: the displacement in a radian of it, more if its force is
  !> large, and the missing friction as long as the oscillation is young.
  pure real(wp) function ripple_in_creep(small)
    type(smallness_t), intent(in) :: small

    ripple_in_creep = small%inertia*sqrt(small%softness)/small%creep%reached*(1.0_wp + ripple_weight*small%ripple) &
      + drift_weight*small%drift/small%length
  end function ripple_in_creep

  !> Smallest error of X(t) over X(t_end), whatever the low-frequency motion is.
  pure real(wp) function least_error_in_creep(small, model) result(error)
    type(smallness_t), intent(in) :: small
    character(*), intent(in) :: model

    error = excluded
    if (.not. small%creep%reached > 0.0_wp) return
    if (small%ripple > merge(largest_weak_ripple, largest_ripple, small%weakens) .or. small%will_slip) return
    if (model == 'creep_asymptotic' .and. small%length >= 1.0_wp) return
    error = margin*ripple_in_creep(small)
    if (model == 'low_frequency') then
      error = error + margin*elastic_in_slow*small%creep%elasticity
    else
      error = error*(1.0_wp + elastic_gain*small%creep%elasticity)
      if (model == 'creep_asymptotic') error = error + expansion_error(small)
    end if
  end function least_error_in_creep

  !> Largest error of X(t) over X(t_end): from the fast oscillation, a finite k_y, and inertia with weakening, which is the
  !> difference of the low-frequency motion from exact creep if both have a rigid k_y.
  pure real(wp) function error_in_creep(slider, small, slow, model) result(error)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    type(slow_motion_t), intent(in) :: slow
    character(*), intent(in) :: model
    real(wp) :: inertia, weight, advance
    logical :: beyond

    error = excluded
    if (.not. slow%known .or. least_error_in_creep(small, model) >= excluded) return
    if (small%weakens) then
      if (slow%has_slipped .or. slow%cycles > 0.0_wp .or. is_near_slip(small, slow)) return
      if (feeding_in_creep(slider, small, slow) > largest_feeding) return
    end if
    associate (creep => small%creep, length => slider%law%static_limit/slider%stiffness(1))
      if (size(slow%position) /= size(creep%rigid)) return
      inertia = maxval(abs(abs(slow%position)/length - creep%rigid))/creep%reached
      advance = abs(slow%position(size(slow%position)))/length
      beyond = small%length >= 1.0_wp
      if (model == 'low_frequency') then
        if (.not. advance > 0.0_wp) return
        weight = merge(inertia_in_slow, 0.0_wp, small%weakens)
        error = ripple_in_creep(small) + elastic_in_slow*creep%elasticity + weight*inertia
        if (beyond) error = error + softness_in_slow*small%softness
        error = margin*error*max(1.0_wp, creep%reached/advance)
      else
        if (inertia > largest_inertia) return
        error = (inertia_in_creep*inertia + ripple_in_creep(small))*(1.0_wp + elastic_gain*creep%elasticity)
        if (beyond) error = error + elastic_remainder*creep%elasticity
        error = margin*error
        if (model == 'creep_asymptotic') error = error + expansion_error(small)
      end if
    end associate
  end function error_in_creep

  !> The difference of the asymptotics from exact creep.
  pure real(wp) function expansion_error(small)
    type(smallness_t), intent(in) :: small

    associate (creep => small%creep)
      expansion_error = maxval(abs(position_third_order(asin(small%sine), creep%tau) - creep%elastic))/creep%reached
    end associate
  end function expansion_error

  !> F'(0)^2/(m k_y sin(theta)^2) where friction has turned furthest: above 1 weakening is stronger than the stiff spring.
  pure real(wp) function feeding_in_creep(slider, small, slow)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    type(slow_motion_t), intent(in) :: slow

    feeding_in_creep = small%feeding/max(slider%along(2)**2, 1.0_wp - min(1.0_wp, slow%load/slider%law%static_limit)**2)
  end function feeding_in_creep

  !> Whether the slow motion ends so near the end of creep that the full one may have slipped.
  pure logical function is_near_slip(small, slow)
    type(smallness_t), intent(in) :: small
    type(slow_motion_t), intent(in) :: slow

    is_near_slip = small%end%exists .and. slow%load > near_slip*small%end%load
  end function is_near_slip

  !> The effect of a finite k_y and of the fast oscillation at the start on the force, without slip.
  pure real(wp) function error_in_force(small) result(error)
    type(smallness_t), intent(in) :: small

    error = margin*(delay_weight*small%delay + small%softness + inertia_weight*small%inertia*min(1.0_wp, small%ripple))
    if (small%weakens .and. small%ripple > largest_weak_ripple) error = excluded
  end function error_in_force

  !> Smallest relative error of period, peak force and slip length, or of the force if there is no cycle, whether the low-frequency
  !> motion slips or not.
  pure real(wp) function least_error_in_stick_slip(small) result(error)
    type(smallness_t), intent(in) :: small

    error = error_in_force(small)
    if (.not. small%weakens) return
    if (error < excluded) error = error + margin*(feeding_weight*small%feeding + drift_weight*small%drift)
    if (small%will_slip) error = excluded
    error = min(error, error_in_cycles(small, huge(1.0_wp), huge(1.0_wp)))
  end function least_error_in_stick_slip

  !> Largest relative error of period, peak force and slip length; of the force, over friction, if there is no cycle.
  pure real(wp) function error_in_stick_slip(slider, small, slow) result(error)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    type(slow_motion_t), intent(in) :: slow
    real(wp) :: feeding

    error = error_in_force(small)
    if (.not. small%weakens) then
      ! Every oscillation dies out. Its cycles count until they have shrunk by a share, which two models pass at different times.
      if (slow%cycles > 0.0_wp) error = excluded
      return
    end if
    if (slow%has_slipped .or. slow%cycles > 0.0_wp) then
      error = excluded
      if (slow%cycles > 0.0_wp) error = error_in_cycles(small, slow%cycles, slow%swing)
      return
    end if
    if (error >= excluded) return
    feeding = feeding_in_creep(slider, small, slow)
    error = error + margin*(feeding_weight*feeding + drift_weight*small%drift)
    if (is_near_slip(small, slow) .or. feeding > largest_feeding) error = excluded
  end function error_in_stick_slip

  !> The same for stick-slip by weakening, from its cycles and their mean fall of k_x u_x over F_0. It includes the remainder of the
  !> fast oscillation at slip, exp(-D), and how far the stiff spring is from rigid there: F'^2/(m k_y sin(theta)^2) and k_x/(k_y
  !> sin(theta)^2). If D is small the fast oscillation triggers slip, and the cycles of the full model need not repeat. Strong
  !> stick-slip has a bound that may be lower.
  pure real(wp) function error_in_cycles(small, cycles, swing) result(error)
    type(smallness_t), intent(in) :: small
    real(wp), intent(in) :: cycles, swing

    error = excluded
    if (.not. (small%end%exists .and. small%slow%obstacle == '' .and. small%share <= largest_share)) return
    if (small%ripple <= largest_weak_ripple) error = error_in_force(small) + margin*slip_error(small%end, small%weakening)
    if (small%weakening >= gradual .and. small%speed <= largest_speed .and. cycles >= least_cycles .and. &
      small%feeding <= largest_strong_feeding .and. small%softness <= largest_softness) &
      error = min(error, strong_margin*max(small%feeding, softness_weight*small%softness) &
        *max(1.0_wp, small_swing/swing)**swing_power)
  end function error_in_cycles
end module dst_model_choice
