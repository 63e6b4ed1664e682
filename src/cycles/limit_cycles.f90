!> The limit cycles of a scene: what it settles to, and what it cannot stay at.
module dst_limit_cycles
  use dst_assembly, only: slider_from_scene
  use dst_cycles, only: cycle_quantities, measures
  use dst_errors, only: error_t, raise, deck_error
  use dst_kinds, only: wp
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  use dst_slow_cycles, only: slow_cycle_t, find_slow_cycles
  use dst_slow_map, only: slow_map_t, new_slow_map
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: limit_cycles_t, limit_cycle_quantities, swing, log_multiplier, find_limit_cycles

  !> What is told of a cycle: as of those of a run, its swing, and how it changes a small disturbance.
  integer, parameter :: swing = measures + 1, log_multiplier = measures + 2, quantities = measures + 2
  type(quantity_t), parameter :: limit_cycle_quantities(quantities) = [cycle_quantities, &
    quantity_t('swing', 'N', 'peak_force less valley_force'), &
    quantity_t('log_multiplier', '1', 'log of the factor by which a disturbance grows in a cycle')]

  !> Accuracy of the motion. Ten times: the cycles of Fig. 3 differ by 1e-13 of themselves.
  real(wp), parameter :: rtol = 1.0e-12_wp

  !> The cycles of one scene under one drive velocity, by growing swing.
  type :: limit_cycles_t
    character(:), allocatable :: model
    real(wp) :: velocity = 0.0_wp                  !! |V|, m/s
    real(wp), allocatable :: value(:, :)           !! (quantity, cycle)
    !> Steady sliding: the load k_x u_x [N], and how a small disturbance of it changes [1/s].
    real(wp) :: sliding_load = 0.0_wp
    logical :: sliding_is_stable = .false.
    complex(wp), allocatable :: eigenvalues(:)
  contains
    procedure :: number
    procedure :: is_stable
  end type limit_cycles_t

contains

  !> The cycles of the slow motion of a scene, at one drive velocity [m/s].
  subroutine find_limit_cycles(scene, velocity, cycles, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(limit_cycles_t), intent(out) :: cycles
    type(error_t), allocatable, intent(out) :: error
    type(slider_t) :: slider
    type(slow_map_t) :: map
    type(slow_cycle_t), allocatable :: found(:)
    integer :: i

    call slider_from_scene(scene, slider)
    if (.not. (abs(slider%along(1)) > 0.0_wp .and. abs(slider%along(2)) > 0.0_wp)) then
      call raise(error, deck_error, 'system.misalignment_deg: the cycles of the slow motion are known for angles that are '// &
        'no multiple of 90: change it a little', 'system.misalignment_deg')
      return
    end if
    cycles%model = 'low_frequency'
    cycles%velocity = abs(velocity)
    call new_slow_map(slider, velocity, rtol, map)
    cycles%sliding_load = slider%stiffness(1)*map%equilibrium
    cycles%sliding_is_stable = map%damping > 0.0_wp
    cycles%eigenvalues = eigenvalues_of(slider, map%damping)
    call find_slow_cycles(map, found, error)
    if (allocated(error)) return
    allocate (cycles%value(quantities, size(found)))
    do i = 1, size(found)
      associate (cycle => found(i), stiffness => slider%stiffness(1))
        cycles%value(:, i) = [cycle%rise_time + cycle%fall_time, stiffness*cycle%peak, stiffness*cycle%valley, cycle%rise_time, &
          cycle%fall_time, cycle%slip_length, stiffness*(cycle%peak - cycle%valley), cycle%log_multiplier]
      end associate
    end do
  end subroutine find_limit_cycles

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

  !> Whether a cycle is one that the object can stay at.
  elemental logical function is_stable(self, i)
    class(limit_cycles_t), intent(in) :: self
    integer, intent(in) :: i

    is_stable = self%value(log_multiplier, i) < 0.0_wp
  end function is_stable
end module dst_limit_cycles
