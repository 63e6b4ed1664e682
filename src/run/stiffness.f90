!> Whether an explicit method is slow on a scene because its stability, and not accuracy, limits the steps.
!>
!> Friction turns towards the slip with the rate F_0/(m v). While the object creeps it follows the drive across the soft axis,
!> v = V sin(phi)/sin(theta), and the load rises with V as k_x u_x = F_0 cos(theta); the rate at which w_x relaxes in the slow
!> motion is F_0 sin(theta)^3/(m V sin(phi)). So the first creep, F_0/(k_x V) long, has the number of steps
!>
!>     F_0/(m V sin(phi)) min(t_end, F_0/(k_x V)) <sin(theta)^n>/limit,
!>
!> n = 1 or 3, with the mean over the load. Each later creep has as many: this is the least number.
module dst_stiffness
  use dst_assembly, only: slider_from_scene
  use dst_kinds, only: wp, pi
  use dst_methods, only: method_t, method_named
  use dst_plain_numbers, only: number_text
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  implicit none
  private

  public :: stiffness_note

  !> Length of a step times the rate at which a method of this order becomes unstable: of dopri5, and of dop853, which takes half as
  !> many steps on Fig. 3.
  real(wp), parameter :: stable(5:8) = [3.3_wp, 0.0_wp, 0.0_wp, 6.6_wp]
  !> Share of these steps that dst_past_rest leaves to dopri5 in the full model, where the object rests again and again: 0.41 to 0.56 for
  !> phi = 0.1 deg and rtol from 1e-8 to 1e-4. It leaves dop853 hardly any.
  real(wp), parameter :: left = 0.4_wp
  !> Number of steps that is worth a note: a few seconds. And how many times that of an implicit method it is then, which takes some
  !> ten steps in a period of the fastest oscillation. Conventions.
  real(wp), parameter :: many = 1.0e6_wp, far = 10.0_wp, in_period = 10.0_wp

contains

  !> Why the method of a scene, the first of so many `cases`, is slow, and what to do; '' if it is not.
  function stiffness_note(scene, cases) result(text)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: cases
    character(:), allocatable :: text
    type(slider_t) :: slider
    type(method_t) :: method
    real(wp) :: duration, steps, others
    logical :: is_slow

    text = ''
    is_slow = scene%model == 'low_frequency'
    if (.not. (is_slow .or. scene%model == 'full') .or. scene%contact /= 'exact') return
    method = method_named(scene%method)
    if (method%kind /= 'explicit' .or. .not. (is_slow .or. method%order == 5)) return
    call slider_from_scene(scene, slider)
    associate (speed => maxval(abs(scene%drive_velocity)), limit => slider%law%kinetic_limit)
      ! If friction at rest is higher than in slip, the object jumps and does not creep.
      if (slider%law%holds_more() .or. .not. min(limit, speed, abs(slider%along(2)), slider%mass) > 0.0_wp) return
      duration = min(scene%t_end, limit/slider%stiffness(1)/speed)
      steps = duration*(limit/slider%mass/speed/abs(slider%along(2)))
    end associate
    steps = steps*merge(3.0_wp*pi/16.0_wp, left*pi/4.0_wp, is_slow)/stable(method%order)
    others = max(1.0_wp, duration*in_period/(2.0_wp*pi) &
      *sqrt(merge(slider%stiffness(1), slider%stiffness(2), is_slow)/slider%mass))
    if (steps*max(1.0_wp, cases) < many .or. steps < others*far) return
    text = "'"//trim(scene%method)//"' is stable only in short steps while the object creeps: at least "// &
      number_text(anint(steps), 2)//' steps'
    if (cases > 1.0_wp) text = text//' in each of '//number_text(cases)//' cases'
    text = text//', where an implicit method takes some '//number_text(anint(others), 2)//": give integrator.method = 'radau13'"
    if (is_slow .and. cases > 1.0_wp) text = text//" or 'rodas4p'"
  end function stiffness_note
end module dst_stiffness
