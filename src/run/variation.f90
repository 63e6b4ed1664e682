!> A scene with a little more and a little less of a parameter, for derivatives.
module dst_variation
  use dst_assembly, only: new_motion
  use dst_cycle_map, only: cycle_map_t
  use dst_deck_sweep, only: varied_key, variation_problem
  use dst_deck_values, only: deck_t
  use dst_errors, only: error_t, raise, deck_error, usage_error
  use dst_kinds, only: wp
  use dst_motion, only: motion_t
  use dst_scene, only: scene_t, set_number
  use dst_schema, only: schema, longest_text
  use dst_stepping, only: stepping_t
  use dst_tangent, only: variation_t
  use dst_text, only: has_word, lower_case, word, word_count
  implicit none
  private

  public :: steps_of, vary

  !> How far from a value the rigs are of which differences are taken, over the value. Twice: elasticities of up to 6
  !> change by 5e-9; ten times: by 8e-8.
  real(wp), parameter :: near = 1.0e-6_wp
  !> Groups of the parameters on which a motion hangs.
  character(*), parameter :: groups = 'system friction drive initial'

contains

  !> The motion of a scene step by step, which has been started: of one that has derivatives.
  subroutine steps_of(scene, steps, error)
    type(scene_t), intent(in) :: scene
    class(stepping_t), allocatable, intent(out) :: steps
    type(error_t), allocatable, intent(out) :: error
    class(motion_t), allocatable :: motion, other
    type(scene_t) :: plain

    if (scene%model == 'full' .or. scene%model == 'low_frequency') then
      plain = scene
      plain%cycle_map = 'off'
      call new_motion(plain, motion, other, error)
      if (allocated(error)) return
      select type (motion)
      class is (cycle_map_t)
        call move_alloc(motion%steps, steps)
      class is (stepping_t)
        allocate (steps, source=motion)
      end select
    end if
    if (.not. allocated(steps)) call raise(error, deck_error, &
      "scene.model: derivatives are those of models 'full' and 'low_frequency' with an adaptive method: give these", 'scene.model')
  end subroutine steps_of

  !> The values of the keys GROUP.KEY in a list, and the motions of a scene with a little more and a little less of them.
  subroutine vary(deck, scene, names, key, value, variation, error)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: names               !! separated by blanks
    character(longest_text), allocatable, intent(out) :: key(:)
    real(wp), allocatable, intent(out) :: value(:)
    type(variation_t), allocatable, intent(out) :: variation(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: name, problem
    integer :: i

    associate (n => word_count(names))
      allocate (key(n), value(n), variation(n))
    end associate
    value = 0.0_wp
    do i = 1, size(key)
      name = word(names, i)
      key(i) = lower_case(name)
      problem = variation_problem(deck, name)
      if (problem == '') then
        associate (entry => schema(varied_key(name)))
          if (.not. has_word(groups, trim(entry%group))) then
            problem = "no motion hangs on '"//name//"': name numbers of &system, &friction, &drive or &initial"
          else
            value(i) = deck%real_of(trim(entry%group), trim(entry%name))
            if (.not. abs(value(i)) > 0.0_wp) problem = "'"//name//"' is 0, so that it has no small share: give a small value"
          end if
        end associate
      end if
      if (problem /= '') call raise(error, usage_error, problem)
      if (.not. allocated(error)) call take_rig(value(i)*(1.0_wp + near), variation(i)%more)
      if (.not. allocated(error)) call take_rig(value(i)*(1.0_wp - near), variation(i)%less)
      if (allocated(error)) return
      variation(i)%apart = 2.0_wp*near*value(i)
    end do

  contains

    !> The motion with another value of the key.
    subroutine take_rig(other, rig)
      real(wp), intent(in) :: other
      class(stepping_t), allocatable, intent(out) :: rig
      type(scene_t) :: changed

      changed = scene
      call set_number(changed, trim(schema(varied_key(name))%name), other)
      call steps_of(changed, rig, error)
    end subroutine take_rig
  end subroutine vary
end module dst_variation
