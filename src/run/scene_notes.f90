!> Settings that a deck may have, but that are seldom intended: notes for people, which refuse nothing.
module dst_scene_notes
  use dst_deck_values, only: deck_t
  use dst_faults, only: faults_t
  use dst_kinds, only: wp, pi
  use dst_plain_numbers, only: number_text
  use dst_sampling, only: sampling_note
  use dst_scene, only: scene_t
  use dst_schema, only: find_key
  use dst_stiffness, only: stiffness_note
  implicit none
  private

  public :: scene_notes

  !> A ratio above which a quantity is far larger. A convention: on Fig. 3 v_f is ten times V, which is intended.
  real(wp), parameter :: far = 30.0_wp
  !> Smoothing velocity over V sin(phi) from which on the smoothed contact is not near the exact one. A convention.
  real(wp), parameter :: most_smoothing = 0.1_wp

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
end module dst_scene_notes
