!> Settings that a deck may have, but that are seldom intended: notes for people, which refuse nothing.
!>
!> One of them tells of an explicit method that is slow because its stability, and not accuracy, limits the steps.
!> Friction turns towards the slip with the rate F_0/(m v). While the object creeps it follows the drive across the soft axis,
!> v = V sin(phi)/sin(theta), and the load rises with V as k_x u_x = F_0 cos(theta); the rate at which w_x relaxes in the slow
!> motion is F_0 sin(theta)^3/(m V sin(phi)). So the first creep, F_0/(k_x V) long, has the number of steps
!>
!>     F_0/(m V sin(phi)) min(t_end, F_0/(k_x V)) <sin(theta)^n>/limit,
!>
!> n = 1 or 3, with the mean over the load. Each later creep has as many: this is the least number.
module dst_scene_notes
  use dst_assembly, only: slider_from_scene
  use dst_deck_values, only: deck_t
  use dst_faults, only: faults_t
  use dst_kinds, only: wp, pi
  use dst_methods, only: method_t, method_named
  use dst_plain_numbers, only: number_text
  use dst_sampling, only: sampling_note
  use dst_scene, only: scene_t
  use dst_schema, only: find_key
  use dst_slider, only: slider_t
  implicit none
  private

  public :: scene_notes, stiffness_note

  !> A ratio above which a quantity is far larger. A convention: on Fig. 3 v_f is ten times V, which is intended.
  real(wp), parameter :: far = 30.0_wp
  !> Smoothing velocity over V sin(phi) from which on the smoothed contact is not near the exact one. A convention.
  real(wp), parameter :: most_smoothing = 0.1_wp
  !> Length of a step times the rate at which a method of this order becomes unstable: of dopri5, and of dop853, which takes half as
  !> many steps on Fig. 3.
  real(wp), parameter :: stable(5:8) = [3.3_wp, 0.0_wp, 0.0_wp, 6.6_wp]
  !> Share of these steps that dst_past_rest leaves to dopri5 in the full model, where the object rests again and again: 0.41 to
  !> 0.56 for phi = 0.1 deg and rtol from 1e-8 to 1e-4. It leaves dop853 hardly any.
  real(wp), parameter :: left = 0.4_wp
  !> Number of steps that is worth a note: a few seconds. And how many times that of an implicit method it is then, which takes some
  !> ten steps in a period of the fastest oscillation. Conventions.
  real(wp), parameter :: many = 1.0e6_wp, far_more = 10.0_wp, in_period = 10.0_wp

contains

  !> The notes on a deck, where `scene` has its final model and interval: one in each line, with places named as in errors. Of a
  !> sweep of so many `cases` they are only those that hold for all.
  subroutine scene_notes(deck, scene, text, cases)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(:), allocatable, intent(out) :: text
    real(wp), intent(in), optional :: cases
    type(faults_t) :: notes

    notes = deck%notes
    if (present(cases)) then
      call note('integrator', 'method', stiffness_note(scene, cases))
    else
      call note_scene()
      call note('output', 'interval', sampling_note(scene))
      call note('integrator', 'method', stiffness_note(scene, 1.0_wp))
    end if
    text = ''
    if (notes%count > 0) text = notes%report(deck%name)//new_line('a')

  contains

    subroutine note_scene()
      real(wp) :: fastest

      fastest = maxval(abs(scene%drive_velocity))
      if (.not. fastest > 0.0_wp) call note('drive', 'velocity', 'the drive never moves: give a velocity that is not 0')
      if (scene%stiffness_y > 0.0_wp .and. scene%stiffness_x > scene%stiffness_y) call note('system', 'stiffness_x', &
        'stiffness_x = '//number_text(scene%stiffness_x)//' is above stiffness_y = '//number_text(scene%stiffness_y)// &
        ' N/m, but x is the soft axis: exchange them, and turn misalignment_deg by 90')
      if (abs(scene%misalignment_deg) > 90.0_wp) call note('system', 'misalignment_deg', 'misalignment_deg = '// &
        number_text(scene%misalignment_deg)//': the soft axis then points against the drive; '// &
        number_text(scene%misalignment_deg - 180.0_wp*anint(scene%misalignment_deg/180.0_wp))//' is the same axis')
      if (any(scene%law == [character(9) :: 'weakening', 'stribeck']) .and. deck%is_used('friction', 'mu_inf')) &
        call note_weakening(fastest)
      if (deck%is_used('friction', 'v_smooth')) call note_smoothing(fastest*abs(sin(scene%misalignment_deg*pi/180.0_wp)))
    end subroutine note_scene

    !> Friction that does not fall, or not at the velocities of this scene.
    subroutine note_weakening(fastest)
      real(wp), intent(in) :: fastest
      real(wp) :: slip

      if (scene%mu_inf > scene%mu_0) then
        call note('friction', 'mu_inf', 'mu_inf = '//number_text(scene%mu_inf)//' is above mu_0 = '//number_text(scene%mu_0)// &
          ': friction rises with the slip velocity; stick-slip needs mu_inf < mu_0')
        return
      end if
      ! The fastest slip that the fall of friction can drive.
      slip = fastest
      if (scene%mass > 0.0_wp) slip = max(slip, (scene%mu_0 - scene%mu_inf)*scene%normal_load/ &
        (sqrt(scene%stiffness_x)*sqrt(scene%mass)))
      if (scene%v_f > far*slip) then
        call note('friction', 'v_f', 'v_f = '//number_text(scene%v_f)//' m/s is far above the velocities of this scene, some '// &
          number_text(slip)//' m/s: friction hardly falls; v_f is the velocity over which it falls')
      else if (fastest > far*scene%v_f) then
        call note('drive', 'velocity', 'the drive velocity '//number_text(fastest)//' m/s is far above v_f = '// &
          number_text(scene%v_f)//' m/s: friction has already fallen, and sliding is steady')
      end if
    end subroutine note_weakening

    subroutine note_smoothing(across)
      real(wp), intent(in) :: across

      if (scene%v_smooth <= most_smoothing*across) return
      call note('friction', 'v_smooth', 'v_smooth = '//number_text(scene%v_smooth)//' m/s is not far below V sin(phi) = '// &
        number_text(across)//' m/s: the contact creeps where a Coulomb contact rests; give less than '// &
        number_text(most_smoothing*across))
    end subroutine note_smoothing

    subroutine note(group, key, what)
      character(*), intent(in) :: group, key, what

      if (what /= '') call notes%add(deck%value(find_key(group, key))%place, 'note: '//what)
    end subroutine note
  end subroutine scene_notes

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
    if (steps*max(1.0_wp, cases) < many .or. steps < others*far_more) return
    text = "'"//trim(scene%method)//"' is stable only in short steps while the object creeps: at least "// &
      number_text(anint(steps), 2)//' steps'
    if (cases > 1.0_wp) text = text//' in each of '//number_text(cases)//' cases'
    text = text//', where an implicit method takes some '//number_text(anint(others), 2)//": give integrator.method = 'radau13'"
    if (is_slow .and. cases > 1.0_wp) text = text//" or 'rodas4p'"
  end function stiffness_note
end module dst_scene_notes
