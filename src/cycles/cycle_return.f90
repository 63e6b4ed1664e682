!> The map of a scene at one place: to which place a motion returns after some slow cycles, with the slope of the map. A cycle is a
!> place that returns to itself; its branch over a parameter is followed with these numbers (python/dynstiction/branches.py).
!>
!> A place is the direction of the force at a release [rad] in the full model, the load k_x u_x at a valley [N] in the slow motion.
module dst_cycle_return
  use dst_assembly, only: slider_from_scene
  use dst_cycles, only: measures
  use dst_errors, only: error_t
  use dst_full_cycles, only: map_of, steady, go_around, most_repeats
  use dst_kinds, only: wp
  use dst_limit_cycles, only: check_model, slow_rtol
  use dst_passage, only: passage_t
  use dst_release_map, only: release_map_t
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  use dst_slow_map, only: slow_map_t, slow_turn_t, new_slow_map
  use dst_writer, only: absent
  implicit none
  private

  public :: find_return, return_values

  !> The place to which the motion returns; slope of the map there and ln of its size; the measures of the cycles between, as
  !> dst_limit_cycles has them.
  integer, parameter :: to = 1, slope = 2, log_slope = 3, return_values = 3 + measures
  !> A passage that takes longer than this share of a long motion leads to no cycle that anybody looks for. Convention.
  real(wp), parameter :: patience = 0.05_wp

contains

  !> The motion from a place after so many slow cycles under a drive velocity [m/s]; NaN if it does not return, or a number is not known.
  subroutine find_return(scene, velocity, place, slow_cycles, value, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity, place
    integer, intent(in) :: slow_cycles
    real(wp), intent(out) :: value(return_values)
    type(error_t), allocatable, intent(out) :: error
    type(slider_t) :: slider
    character(:), allocatable :: model

    value = absent()
    call slider_from_scene(scene, slider)
    call check_model(scene, slider, model, error)
    if (allocated(error)) return
    if (model == 'low_frequency') then
      call from_valley(slider, velocity, place, value, error)
    else
      call from_release(scene, velocity, place, max(1, min(most_repeats, slow_cycles)), value, error)
    end if
  end subroutine find_return

  subroutine from_release(scene, velocity, alpha, slow_cycles, value, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity, alpha
    integer, intent(in) :: slow_cycles
    real(wp), intent(inout) :: value(return_values)
    type(error_t), allocatable, intent(out) :: error
    type(release_map_t) :: map
    type(passage_t) :: whole
    real(wp) :: release(most_repeats), measured(measures)
    logical :: found

    call map_of(steady(scene, velocity), map, error)
    if (allocated(error)) return
    map%slips_expected = 2.0_wp*real(slow_cycles, wp)
    map%longest = patience*map%longest
    release(1) = alpha
    call go_around(map, slow_cycles, release, whole, found, error, measured)
    if (allocated(error) .or. .not. found) return
    value(log_slope + 1:) = measured
    value(to) = whole%to
    if (whole%has_slope) value([slope, log_slope]) = [whole%slope, whole%log_slope]
  end subroutine from_release

  subroutine from_valley(slider, velocity, load, value, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, load
    real(wp), intent(inout) :: value(return_values)
    type(error_t), allocatable, intent(out) :: error
    type(slow_map_t) :: map
    type(slow_turn_t) :: turn
    real(wp) :: area

    call new_slow_map(slider, velocity, slow_rtol, map)
    if (load >= slider%stiffness(1)*map%equilibrium) return
    call map%turn(load/slider%stiffness(1), turn, error)
    if (allocated(error) .or. .not. turn%returns) return
    associate (k => slider%stiffness(1), before => map%equilibrium - turn%from, after => map%equilibrium - turn%to)
      if (.not. after > 0.0_wp) return
      area = turn%log_area + log(before/after)
      value(:log_slope) = [k*turn%to, exp(min(area, log(huge(area)))), area]
      value(log_slope + 1:) = [turn%rise_time + turn%fall_time, k*turn%peak, k*turn%to, turn%rise_time, turn%fall_time, &
        turn%slip_length]
    end associate
  end subroutine from_valley
end module dst_cycle_return
