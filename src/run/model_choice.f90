!> `model = 'auto'`: the cheapest model whose error compared with the full one stays below scene.accuracy.
!>
!> The error of a reduced model, due to the fast oscillation and the elasticity of the stiff axis, is bounded by formulas whose
!> factors were fitted to some 6000 random scenes and tested on others (bench/model_choice.py, docs/models.md). Those of stick-slip
!> depend on how creep ends (dst_creep_end): only if the fast oscillation has decayed before slip is the slow motion independent of
!> it. No motion is run: what inertia and weakening do to creep follows from creep itself. Outside the range of the calibration, the
!> full model is chosen.
!> A column that is requested by name counts like a quantity: it must be that of the full model, to the same accuracy.
module dst_model_choice
  use dst_kinds, only: wp
  use dst_creep, only: creep_t, creep_exact, creep_asymptotic
  use dst_creep_end, only: creep_end_t, creep_end
  use dst_friction, only: falls_exponentially
  use dst_methods, only: fixed_step_methods
  use dst_model_columns, only: column_obstacle, gives_column, holds_column
  use dst_columns, only: columns
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_slow_validity, only: slow_validity_t, slow_validity, rigidity_obstacle, slip_error, margin, gradual
  use dst_plain_numbers, only: number_text
  use dst_text, only: has_word
  implicit none
  private

  public :: settle_model

  !> Number of equal parts of a run at whose ends creep is looked at.
  integer, parameter :: samples = 64
  real(wp), parameter :: excluded = huge(1.0_wp)

  !> Quantities that are small if a reduced model is accurate, and creep with constant friction up to t_end. Without unit.
  type :: smallness_t
    logical :: weakens = .false.
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
    type(creep_end_t) :: end
    real(wp) :: slip_load = huge(1.0_wp)       !! k_x u_x/F_0 where creep ends in slip
    real(wp) :: swing = 0.0_wp                 !! by how much it falls in a strong slip, against the least friction
    type(slow_validity_t) :: slow              !! whether the slow motion holds through slips
    real(wp) :: load = 0.0_wp                  !! k_x u_x/F_0 at the end; less if friction weakens
    real(wp) :: reached = 0.0_wp               !! X/l_x at the end
    logical :: is_overdamped = .false.         !! at each direction of friction
    ! Largest differences of X, over its last value: between creep with an elastic and with a rigid k_y; what inertia and the fall
    ! of friction do to it; and that of the asymptotics.
    real(wp) :: elasticity = 0.0_wp, lag = excluded, expansion = excluded
  end type smallness_t

  ! All constants below are fitted to some 6000 random scenes and tested on 4000 others of free lengths: the largest error is 0.8 of
  ! its estimate (bench/model_choice.py draws others); docs/models.md gives the formulas. A larger margin reduces fewer scenes, and
  ! changes no number of a chosen model. A wider range admits scenes that have not been tested.
  !
  !> Range of creep: largest ripple, largest lag.
  real(wp), parameter :: largest_ripple = 2.0_wp, largest_lag = 0.3_wp
  !> With weakening friction: largest ripple, largest feeding over sin(theta)^2 before slip, share of the load at the end of creep
  !> up to which the motion is creep, largest share of the critical tan(phi)^2.
  real(wp), parameter :: largest_weak_ripple = 0.5_wp, largest_feeding = 0.3_wp, near_slip = 0.95_wp, largest_share = 0.6_wp
  !> V t/l_x from which on an object whose creep ends has slipped. Convention.
  real(wp), parameter :: surely_slipped = 2.0_wp
  !> For stick-slip, besides those at slip (dst_slow_validity): weights of delay, inertia, feeding, drift.
  real(wp), parameter :: delay_weight = 0.03_wp, inertia_weight = 0.2_wp, feeding_weight = 0.05_wp, drift_weight = 0.4_wp
  !> For strong stick-slip, fitted to 2700 scenes: its own margin, the weight of k_x/k_y added to the feeding, and the fall of the
  !> load over F_0 in a slip below which cycles are sensitive, with their power. Its range: largest feeding, largest k_x/k_y,
  !> largest V/v_f.
  real(wp), parameter :: strong_margin = 6.0_wp, softness_weight = 30.0_wp, small_swing = 0.45_wp, swing_power = 1.5_wp
  real(wp), parameter :: largest_strong_feeding = 0.03_wp, largest_softness = 1.0e-3_wp, largest_speed = 0.5_wp
  !> For creep: weights of the lag in a closed form, and in low_frequency with weakening; of the ripple added to 1; of a finite k_y:
  !> as it raises both, as it remains after slip, and in low_frequency; of k_x/k_y after slip.
  real(wp), parameter :: lag_in_creep = 1.9_wp, lag_in_slow = 1.0_wp, ripple_weight = 10.0_wp, elastic_gain = 50.0_wp, &
    elastic_remainder = 0.2_wp, elastic_in_slow = 1.5_wp, softness_in_slow = 3.0_wp

contains

  !> Replace the model 'auto' by a model, and say why; other models are not changed, and need no reason. If no column is requested
  !> by name, the output has only the columns that the model does not keep constant.
  subroutine settle_model(scene, reason)
    type(scene_t), intent(inout) :: scene
    character(:), allocatable, intent(out) :: reason
    type(slider_t) :: slider
    type(smallness_t) :: small
    character(:), allocatable :: passed_over
    logical :: found

    reason = ''
    if (scene%model /= 'auto') return
    scene%model = 'full'
    call slider_from_scene(scene, slider)
    passed_over = obstacle_to_reduction(scene, slider)
    found = .false.
    if (passed_over == '') then
      small = smallness_of(scene, slider)
      if (scene%quantities == 'creep') then
        found = accept('creep_asymptotic')
        if (found) scene%form = 'third_order'
        if (.not. found) found = accept('creep')
      end if
      if (.not. found) found = accept('low_frequency')
    end if
    if (.not. found) reason = 'full: '//passed_over

  contains

    logical function accept(model)
      character(*), intent(in) :: model
      character(:), allocatable :: lack
      real(wp) :: error

      accept = .false.
      lack = lack_of_columns(scene, model)
      if (lack == '') then
        error = estimated_error(scene, slider, small, model)
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

  !> Largest error of a model in the requested quantities and columns. X and u_x of creep are known at all times; in stick-slip an
  !> error of the period shifts the slips.
  pure real(wp) function estimated_error(scene, slider, small, model) result(error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    character(*), intent(in) :: model
    real(wp) :: of_position, rigidity

    of_position = error_in_creep(slider, small, model)
    error = of_position
    if (scene%quantities /= 'creep') error = error_in_stick_slip(slider, small)
    if (scene%fields(1) == 'default') return
    error = max(error, of_position)
    ! X = D - u_x cos(phi) - u_y sin(phi): the error of X, and the u_y that a rigid spring lacks, are in u_x.
    rigidity = merge(abs(slider%along(2))*small%softness, 0.0_wp, model == 'low_frequency')
    if (error < excluded .and. any(scene%fields /= 'X')) &
      error = max(error, (of_position*small%reached + rigidity)/(slider%along(1)*small%load))
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
        if (small%end%exists) small%slip_load = small%end%load/limit
        small%swing = 2.0_wp*(small%slip_load - slider%law%least_force/limit)
      end if
    end associate
    call look_at_creep(slider, speed, small)
  end function smallness_of

  !> Creep with constant friction up to the end of the run, and what it leaves out. With the rate at which the load rises as
  !> friction turns by theta, and q = V sin(phi) sqrt(m k_x)/F_0,
  !>
  !>     rise = (F sin(theta)^2 + v F' cos(theta)^2)/F_0,
  !>
  !> the slow motion lags behind its rate by q^2/(sin(theta)^3 sin(phi)) l_x/V; friction that has fallen by a share raises the rate
  !> by that share over rise, and X leads; and the motion is overdamped (Eq. 10) if rise sin(theta) > 2 q.
  pure subroutine look_at_creep(slider, speed, small)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: speed              !! |V|, m/s
    type(smallness_t), intent(inout) :: small
    type(creep_t), dimension(0:samples) :: rigid, elastic, expanded
    real(wp), dimension(0:samples) :: tau, sine, force, slope, rise, part
    real(wp) :: phi, lag, lead
    integer :: i

    phi = atan2(abs(slider%along(2)), slider%along(1))
    tau = small%length*[(real(i, wp)/real(samples, wp), i=0, samples)]
    rigid = creep_exact(phi, 0.0_wp, tau)
    elastic = creep_exact(phi, small%softness, tau)
    sine = sin(phi + rigid%psi)
    call slider%law%evaluate(samples + 1, speed*rigid%speed, force, slope)
    associate (limit => slider%law%static_limit)
      force = force/limit
      rise = force*sine**2 + slope*(speed/limit)*rigid%speed*(1.0_wp - sine**2)
    end associate
    small%is_overdamped = all(rise*sine >= 2.0_wp*small%inertia)
    small%load = sin(rigid(samples)%alpha)
    small%reached = elastic(samples)%position
    if (.not. small%reached > 0.0_wp) return
    small%elasticity = maxval(abs(elastic%position - rigid%position))/small%reached
    if (all(rise > 0.0_wp)) then
      lag = small%inertia**2/sin(phi)*maxval(rigid%x_rate/sine**3)
      part = rigid%x_rate*(1.0_wp - force)/rise
      lead = 0.5_wp*small%length/real(samples, wp)*sum(part(1:) + part(:samples - 1))
      small%lag = max(lag, lead, lag - lead)/small%reached
    end if
    if (small%length >= 1.0_wp) return
    expanded = creep_asymptotic('third_order', phi, tau)
    small%expansion = maxval(abs(expanded%position - elastic%position))/small%reached
  end subroutine look_at_creep

  !> Largest error of X(t) over X(t_end): from the fast oscillation (the displacement in a radian of it, more if its force is large,
  !> and the missing friction as long as it is young), a finite k_y, inertia and the fall of friction.
  pure real(wp) function error_in_creep(slider, small, model) result(error)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    character(*), intent(in) :: model
    real(wp) :: of_oscillation
    logical :: beyond

    error = excluded
    if (small%lag > largest_lag .or. small%ripple > merge(largest_weak_ripple, largest_ripple, small%weakens)) return
    if (small%weakens .and. (is_near_slip(small) .or. feeding_in_creep(slider, small) > largest_feeding)) return
    if (model == 'creep_asymptotic' .and. .not. small%expansion < excluded) return
    of_oscillation = small%inertia*sqrt(small%softness)/small%reached*(1.0_wp + ripple_weight*small%ripple) &
      + drift_weight*small%drift/small%length
    beyond = small%length >= 1.0_wp
    if (model == 'low_frequency') then
      error = of_oscillation + elastic_in_slow*small%elasticity + merge(lag_in_slow*small%lag, 0.0_wp, small%weakens)
      if (beyond) error = error + softness_in_slow*small%softness
      error = margin*error/(1.0_wp - small%lag)
    else
      error = (lag_in_creep*small%lag + of_oscillation)*(1.0_wp + elastic_gain*small%elasticity)
      if (beyond) error = error + elastic_remainder*small%elasticity
      error = margin*error
      if (model == 'creep_asymptotic') error = error + small%expansion
    end if
  end function error_in_creep

  !> F'(0)^2/(m k_y sin(theta)^2) where friction has turned furthest: above 1 weakening is stronger than the stiff spring.
  pure real(wp) function feeding_in_creep(slider, small)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small

    feeding_in_creep = small%feeding/max(slider%along(2)**2, 1.0_wp - small%load**2)
  end function feeding_in_creep

  !> Whether creep has come so near its end that the object may have slipped.
  pure logical function is_near_slip(small)
    type(smallness_t), intent(in) :: small

    is_near_slip = small%load > near_slip*small%slip_load
  end function is_near_slip

  !> Largest relative error of period, peak force and slip length by low_frequency; of the force, over friction, before slip. With
  !> weakening it includes the remainder of the fast oscillation at slip, exp(-D), and how far the stiff spring is from rigid there:
  !> F'^2/(m k_y sin(theta)^2) and k_x/(k_y sin(theta)^2). If D is small the fast oscillation triggers slip, and the cycles of the
  !> full model need not repeat. Oscillations that die out count as cycles until they have shrunk by a share, which two models pass
  !> at different times.
  pure real(wp) function error_in_stick_slip(slider, small) result(error)
    type(slider_t), intent(in) :: slider
    type(smallness_t), intent(in) :: small
    real(wp) :: feeding
    logical :: slips

    error = excluded
    feeding = feeding_in_creep(slider, small)
    slips = is_near_slip(small)
    if (slips) then
      if (.not. (small%length > surely_slipped .and. small%slow%obstacle == '' .and. small%share <= largest_share)) return
      error = slip_error(small%end, small%weakening)
    else
      if (.not. (small%is_overdamped .and. feeding <= largest_feeding)) return
      error = feeding_weight*feeding + drift_weight*small%drift
    end if
    ! The effect of a finite k_y and of the fast oscillation at the start on the force.
    error = margin*(error + delay_weight*small%delay + small%softness + inertia_weight*small%inertia*min(1.0_wp, small%ripple))
    if (small%weakens .and. small%ripple > largest_weak_ripple) error = excluded
    ! Strong stick-slip has a bound that may be lower, once there are two cycles.
    if (slips .and. small%weakening >= gradual .and. small%speed <= largest_speed .and. small%feeding <= largest_strong_feeding &
      .and. small%softness <= largest_softness .and. small%length >= surely_slipped + small%swing) &
      error = min(error, strong_margin*max(small%feeding, softness_weight*small%softness) &
        *max(1.0_wp, small_swing/small%swing)**swing_power)
  end function error_in_stick_slip
end module dst_model_choice
