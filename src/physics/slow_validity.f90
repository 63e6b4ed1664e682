!> Where the slow motion (model low_frequency) stands for that of the full model, and how far its answers may be off.
!>
!> The slow motion takes the stiff axis as rigid. It needs k_y >> k_x, an angle at which the object creeps instead of resting,
!> and an oscillation on the stiff spring that has decayed before a slip begins, so that it cannot trigger it: by exp(-D), D of
!> dst_creep_end. Where creep does not end in slip it becomes steady sliding, in which the oscillation must decay (dst_stability).
!> How rigid the stiff spring is at slip gives the error of what follows: of period, forces and slip length, and of the angle or
!> the velocity at which stick-slip ends. docs/models.md, section low_frequency, compares it with the full model.
module dst_slow_validity
  use dst_creep_end, only: creep_end_t, creep_end, fast_growth_rate
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_plain_numbers, only: number_text
  use dst_slider, only: slider_t
  use dst_stability, only: critical_t, critical_misalignment
  implicit none
  private

  public :: slow_validity_t, slow_validity, rigidity_obstacle, slip_error, common_accuracy, margin, gradual

  !> Whether the slow motion holds.
  type :: slow_validity_t
    character(200) :: obstacle = ''            !! why it does not hold; '' if it does
    real(wp) :: error = 0.0_wp                 !! largest relative error then, estimated
  end type slow_validity_t

  ! Fitted to random scenes of the full model and tested on others (bench/model_choice.py, docs/models.md). A wider range admits
  ! scenes that have not been tested.
  !
  !> Smallest stiffness_y/stiffness_x; largest k_x/(k_y tan(phi)), the share of l_x during which the object truly rests; smallest D.
  real(wp), parameter :: least_anisotropy = 300.0_wp, largest_delay = 1.0_wp/3.0_wp, least_decay = 1.0_wp
  !> Largest force (F_s - F_0) sin(theta) of a release with a static limit over the force v sqrt(m k_y) with which the oscillation
  !> reaches rest, at slip. Twice: the first of 60 random scenes with mu_static has no stick-slip where the slow motion has.
  real(wp), parameter :: largest_release = 0.05_wp
  !> Estimated error up to which cycles and ends of stick-slip count as known: with D = 1 it is the same. Twice: answers that say
  !> little, ends up to a tenth off.
  real(wp), parameter :: common_accuracy = 0.15_wp
  !> Margin over the errors that occurred, and weights of the feeding, of k_x/(k_y sin(theta)^2) and of exp(-D).
  real(wp), parameter :: margin = 4.0_wp, feeding_weight = 0.05_wp, elastic_weight = 0.2_wp, decay_weight = 0.1_wp
  !> Weakening over sqrt(m k_x) below which slip is gradual and cycles are sensitive, and by how much.
  real(wp), parameter :: gradual = 2.5_wp, sensitivity = 2.0_wp

contains

  !> Whether the slow motion of a slider without dampers holds under a constant drive velocity [m/s], through its slips. A slider
  !> whose stiff axis is rigid, stiffness 0, is that of the slow motion itself. The slow motion never rests: a static limit only has
  !> an effect on whether it holds.
  function slow_validity(slider, velocity, accuracy) result(validity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    real(wp), intent(in) :: accuracy                     !! largest estimated error that is accepted
    type(slow_validity_t) :: validity
    type(critical_t) :: critical
    type(error_t), allocatable :: error
    type(slider_t) :: own
    type(creep_end_t) :: last
    real(wp) :: force(2), slope(2), release

    if (.not. slider%stiffness(2) > 0.0_wp) return
    validity%obstacle = rigidity_obstacle(slider)
    if (validity%obstacle /= '') return
    own = slider
    own%law%static_limit = own%law%kinetic_limit
    call own%law%evaluate(2, [0.0_wp, abs(velocity)], force, slope)
    if (.not. minval(slope) < 0.0_wp) return
    call critical_misalignment(own, velocity, critical, error)
    if (allocated(error)) then
      validity%obstacle = error%text
      return
    end if
    last = last_of_creep(own, velocity, slope(2))
    validity%error = margin*slip_error(last, -slope(1)/(sqrt(own%mass)*sqrt(own%stiffness(1))))
    release = (slider%law%static_limit - own%law%kinetic_limit)*sin(last%angle)/(last%speed*sqrt(own%mass)*sqrt(own%stiffness(2)))
    if (slope(2) < 0.0_wp .and. .not. atan2(abs(own%along(2)), abs(own%along(1))) < critical%window(2)) then
      validity%obstacle = 'the oscillation on the stiff spring grows in steady sliding'
    else if (.not. last%decay >= least_decay) then
      validity%obstacle = 'the oscillation on the stiff spring does not decay before slip (D = '//number_text(last%decay, 2)//')'
    else if (.not. release <= largest_release) then
      validity%obstacle = 'with mu_static the oscillation on the stiff spring does not die before slip'
    else if (.not. validity%error <= accuracy) then
      validity%obstacle = 'the stiff spring is not rigid enough at slip (estimated error '//number_text(validity%error, 2)//')'
    end if
  end function slow_validity

  !> Why the stiff axis cannot be taken as rigid, whether the object slips or not; '' if it can.
  function rigidity_obstacle(slider) result(text)
    type(slider_t), intent(in) :: slider
    character(:), allocatable :: text

    text = ''
    if (slider%stiffness(2) < least_anisotropy*slider%stiffness(1)) then
      text = 'stiffness_y is below '//number_text(least_anisotropy, 3)//' stiffness_x'
    else if (largest_delay*abs(slider%along(2)) < abs(slider%along(1))*slider%stiffness(1)/slider%stiffness(2)) then
      text = 'the misalignment is not above stiffness_x/stiffness_y'
    end if
  end function rigidity_obstacle

  !> Relative error of the slow motion from the elasticity of the stiff spring and the remainder of its oscillation where creep
  !> ends, without the margin. `weakening`: -F' over sqrt(m k_x).
  pure real(wp) function slip_error(end, weakening)
    type(creep_end_t), intent(in) :: end
    real(wp), intent(in) :: weakening

    slip_error = merge(sensitivity, 1.0_wp, weakening < gradual)*(feeding_weight*end%feeding + elastic_weight*end%softness) &
      + decay_weight*exp(-end%decay)
  end function slip_error

  !> The end of creep in slip, or else in steady sliding, where friction has a slope [N s/m].
  pure function last_of_creep(slider, velocity, slope) result(last)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, slope
    type(creep_end_t) :: last

    last = creep_end(slider, velocity)
    if (last%exists) return
    last%angle = atan2(abs(slider%along(2)), abs(slider%along(1)))
    last%speed = abs(velocity)
    if (fast_growth_rate(slider, velocity, last%angle) < 0.0_wp) last%decay = huge(1.0_wp)
    associate (square => abs(slider%along(2))**2)
      last%softness = slider%stiffness(1)/slider%stiffness(2)/square
      last%feeding = (slope/slider%mass)*(slope/slider%stiffness(2))/square
    end associate
  end function last_of_creep
end module dst_slow_validity
