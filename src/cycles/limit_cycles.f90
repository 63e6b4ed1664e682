!> The limit cycles of a scene: stable ones, to which it settles, and unstable ones; and the map of a scene at one place, of which a
!> cycle is a fixed point.
module dst_limit_cycles
  use dst_assembly, only: slider_from_scene
  use dst_cycles, only: cycle_quantities, measures, peak, valley
  use dst_errors, only: error_t, raise, deck_error
  use dst_friction, only: falls_exponentially
  use dst_full_cycles, only: full_cycle_t, regularity_t, find_full_cycles, map_of, steady, go_around
  use dst_kinds, only: wp, pi
  use dst_passage, only: passage_t
  use dst_release_map, only: release_map_t, watch_t
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  use dst_slow_cycle, only: most_repeats
  use dst_slow_cycles, only: find_slow_cycles
  use dst_slow_map, only: slow_map_t, slow_turn_t, new_slow_map
  use dst_slow_validity, only: slow_validity_t, slow_validity, common_accuracy
  use dst_stability, only: steady_sliding_eigenvalues, is_stable
  use dst_writer, only: quantity_t, absent
  implicit none
  private

  public :: limit_cycles_t, limit_cycle_quantities, swing, log_multiplier, slow_cycles, find_limit_cycles
  public :: find_return, return_values

  integer, parameter :: swing = measures + 1, log_multiplier = measures + 2, slow_cycles = measures + 3, &
    release_angle = measures + 4, quantities = measures + 4
  !> Measures of a limit cycle: those of the cycles of a run, its amplitude, the growth of a small disturbance, of how many slow
  !> cycles it consists, and where it begins.
  type(quantity_t), parameter :: limit_cycle_quantities(quantities) = [cycle_quantities, &
    quantity_t('swing', 'N', 'peak_force minus valley_force'), &
    quantity_t('log_multiplier', '1', 'log of the factor by which a disturbance grows in a cycle'), &
    quantity_t('slow_cycles', '1', 'slow cycles after which it repeats; 0: it is the fast oscillation alone'), &
    quantity_t('release_angle', 'rad', 'direction of the force from the soft axis at the release with which it begins')]

  !> The place to which a motion returns; slope of the map there and ln of its size; the measures of the cycles between.
  integer, parameter :: to = 1, slope_there = 2, log_slope = 3, return_values = 3 + measures
  !> A passage that takes longer than this share of a long motion leads to no cycle that anybody looks for. Convention; twice: no
  !> change.
  real(wp), parameter :: patience = 0.05_wp
  !> Accuracy of the slow motion. Ten times: the cycles of Fig. 3 change by 1e-13, relative to them.
  real(wp), parameter :: slow_rtol = 1.0e-12_wp

  !> The cycles of one scene under one drive velocity, by increasing amplitude.
  type :: limit_cycles_t
    character(:), allocatable :: model
    real(wp) :: velocity = 0.0_wp                  !! |V|, m/s
    real(wp), allocatable :: value(:, :)           !! (quantity, cycle); NaN where it is not known
    logical, allocatable :: is_stable(:)
    !> Steady sliding: the load k_x u_x [N], and the growth rates of a small disturbance [1/s].
    real(wp) :: sliding_load = 0.0_wp
    logical :: sliding_is_stable = .false.
    complex(wp), allocatable :: eigenvalues(:)
    !> For the full model: what the motion from the scene's initial state is like.
    type(regularity_t) :: regularity
    real(wp) :: error = 0.0_wp                     !! of the slow motion, relative to the full one, estimated
  contains
    procedure :: number
  end type limit_cycles_t

contains

  !> The cycles of a scene at one drive velocity [m/s], in the model of the scene.
  subroutine find_limit_cycles(scene, velocity, cycles, error, watch)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(limit_cycles_t), intent(out) :: cycles
    type(error_t), allocatable, intent(out) :: error
    procedure(watch_t), optional :: watch
    type(slider_t) :: slider

    call slider_from_scene(scene, slider)
    cycles%velocity = abs(velocity)
    call check_model(scene, slider, cycles%model, error)
    if (allocated(error)) return
    if (cycles%model == 'full') then
      call take_full(scene, slider, velocity, cycles, error, watch)
    else
      call take_slow(slider, velocity, cycles, error)
    end if
  end subroutine find_limit_cycles

  !> The model in which the cycles of a scene are found, or why they are not.
  subroutine check_model(scene, slider, model, error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    character(:), allocatable, intent(out) :: model
    type(error_t), allocatable, intent(out) :: error

    model = trim(scene%model)
    if (model == 'auto') model = 'full'
    call refuse(model /= 'full' .and. model /= 'low_frequency', 'scene.model', "model '"//model//"' has no limit cycles that "// &
      "can be found here: give 'full' or 'low_frequency'")
    call refuse(model /= 'full' .and. slider%is_damped(), 'system.damping_'//merge('x', 'y', slider%damping(1) > 0.0_wp), &
      'cycles of the slow motion are found only without dampers: remove damping_x and damping_y')
    call refuse(.not. minval(abs(slider%along)) > 0.0_wp, 'system.misalignment_deg', &
      'cycles are found only if the angle is no multiple of 90: change it a little')
    call refuse(model == 'full' .and. scene%contact /= 'exact', 'friction.contact', &
      "the cycles of the full model are found only with contact 'exact', which has rest")
    call refuse(slider%law%ageing > 0.0_wp, 'friction.ageing', 'cycles are found from release to release, and with a limit '// &
      'that ages the angle of friction is not all that a release is: remove ageing')
    call refuse(model /= 'full' .and. slider%law%holds_more(), 'friction.mu_static', 'cycles of the slow motion are found only '// &
      "without a separate static limit: remove mu_static, or give model 'full'")
    call refuse(model /= 'full' .and. .not. falls_exponentially(slider%law), 'friction.law', 'cycles of the slow motion are '// &
      "found only with the laws 'constant' and 'weakening': give one of them, or model 'full'")

  contains

    subroutine refuse(is_so, key, why)
      logical, intent(in) :: is_so
      character(*), intent(in) :: key, why

      if (is_so .and. .not. allocated(error)) call raise(error, deck_error, key//': '//why, key)
    end subroutine refuse
  end subroutine check_model

  !> The cycles of the full model, and its steady sliding.
  subroutine take_full(scene, slider, velocity, cycles, error, watch)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(limit_cycles_t), intent(inout) :: cycles
    type(error_t), allocatable, intent(out) :: error
    procedure(watch_t), optional :: watch
    type(full_cycle_t), allocatable :: found(:)
    real(wp), allocatable :: swings(:)
    real(wp) :: force(1), slope(1)
    integer :: i, order

    allocate (cycles%eigenvalues(4))
    call steady_sliding_eigenvalues(slider, velocity, cycles%eigenvalues, error)
    if (.not. allocated(error)) call is_stable(slider, velocity, cycles%sliding_is_stable, error)
    if (allocated(error)) return
    call slider%law%evaluate(1, [abs(velocity)], force, slope)
    cycles%sliding_load = force(1)*abs(slider%along(1))
    call find_full_cycles(scene, velocity, cycles%sliding_is_stable, found, cycles%regularity, error, watch)
    if (allocated(error)) return
    allocate (cycles%value(quantities, size(found)), cycles%is_stable(size(found)))
    swings = found%measure(peak) - found%measure(valley)
    do i = 1, size(found)
      associate (cycle => found(i))
        order = count(swings < swings(i)) + count(swings(:i) <= swings(i) .and. swings(:i) >= swings(i))
        cycles%value(:, order) = [cycle%measure, swings(i), cycle%log_multiplier, real(cycle%slow_cycles, wp), &
          cycle%release(1)]
        if (cycle%release(1) > pi) cycles%value(release_angle, order) = absent()
        cycles%is_stable(order) = cycle%is_stable()
      end associate
    end do
  end subroutine take_full

  !> The cycles of the slow motion, and its steady sliding.
  subroutine take_slow(slider, velocity, cycles, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(limit_cycles_t), intent(inout) :: cycles
    type(error_t), allocatable, intent(out) :: error
    type(slow_map_t) :: map
    type(slow_turn_t), allocatable :: found(:)
    type(slow_validity_t) :: validity
    integer :: i

    validity = slow_validity(slider, velocity, common_accuracy)
    if (validity%obstacle /= '') then
      call raise(error, deck_error, 'scene.model: the slow motion does not hold here: '//trim(validity%obstacle)// &
        ": give model 'full'", 'scene.model')
      return
    end if
    cycles%error = validity%error
    call new_slow_map(slider, velocity, slow_rtol, map)
    cycles%sliding_load = slider%stiffness(1)*map%equilibrium
    cycles%sliding_is_stable = map%damping > 0.0_wp
    cycles%eigenvalues = eigenvalues_of(slider, map%damping)
    call find_slow_cycles(map, found, error)
    if (allocated(error)) return
    allocate (cycles%value(quantities, size(found)), cycles%is_stable(size(found)))
    do i = 1, size(found)
      associate (value => found(i)%measure(slider%stiffness(1)))
        cycles%value(:, i) = [value, value(peak) - value(valley), found(i)%log_area, 1.0_wp, absent()]
        cycles%is_stable(i) = found(i)%log_area < 0.0_wp
      end associate
    end do
  end subroutine take_slow

  !> The motion from a place after so many slow cycles under a drive velocity [m/s]; NaN if it does not return, or a number is not
  !> known. A place is the direction of the force at a release [rad] in the full model, the load k_x u_x at a valley [N] in the slow
  !> motion.
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
    if (whole%has_slope) value([slope_there, log_slope]) = [whole%slope, whole%log_slope]
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
      value(log_slope + 1:) = turn%measure(k)
    end associate
  end subroutine from_valley

  !> The roots of m x^2 + d x + k_x, by falling real part [1/s].
  pure function eigenvalues_of(slider, damping) result(eigenvalues)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: damping           !! d, N s/m
    complex(wp) :: eigenvalues(2)
    real(wp) :: half, square, larger

    half = 0.5_wp*damping/slider%mass
    square = slider%stiffness(1)/slider%mass
    if (half**2 < square) then
      eigenvalues = [cmplx(-half, sqrt(square - half**2), wp), cmplx(-half, -sqrt(square - half**2), wp)]
    else
      larger = -half - sign(sqrt(half**2 - square), half)
      eigenvalues = [cmplx(max(larger, square/larger), kind=wp), cmplx(min(larger, square/larger), kind=wp)]
    end if
  end function eigenvalues_of

  pure integer function number(self)
    class(limit_cycles_t), intent(in) :: self

    number = size(self%value, 2)
  end function number
end module dst_limit_cycles
