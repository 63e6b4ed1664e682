!> Where the stick-slip of a scene ends, in its misalignment and in its drive velocity: the solver's answer for the slow motion,
!> where that holds (dst_slow_validity), and where small cycles begin.
module dst_stick_slip_ends
  use dst_errors, only: error_t, raise, deck_error, usage_error
  use dst_friction, only: exponential_form, falls_exponentially
  use dst_kinds, only: wp
  use dst_slider, only: slider_t
  use dst_slow_ends, only: slow_end_t, misalignment_end, velocity_end
  use dst_slow_validity, only: slow_validity_t, slow_validity, common_accuracy
  use dst_small_cycles, only: bautin_point, critical_velocities, criticality
  use dst_stability, only: low_frequency_limit
  implicit none
  private

  public :: stick_slip_ends_t, find_stick_slip_ends

  !> All numbers of a scene are between this and its inverse if ends are searched: so their squares and products do not overflow.
  real(wp), parameter :: smallest = 1.0e-30_wp

  !> The ends of stick-slip of the slow motion. Where an end has an obstacle, the full motion ends elsewhere.
  type :: stick_slip_ends_t
    real(wp) :: drive_velocity = 0.0_wp          !! |V|, m/s
    !> The misalignment from which on steady sliding is stable [rad], 0 if friction does not weaken; whether small cycles are stable
    !> where they begin there.
    real(wp) :: critical_angle = 0.0_wp
    logical :: is_supercritical = .false.
    !> Where stick-slip ends at the present velocity.
    type(slow_end_t) :: misalignment
    !> The point at which small cycles change their stability [m/s, rad].
    logical :: has_bautin_point = .false.
    real(wp) :: bautin_velocity = 0.0_wp, bautin_angle = 0.0_wp
    !> At the present misalignment steady sliding is unstable from one velocity up to another [m/s], and stick-slip exists from one
    !> end to the other.
    logical :: has_critical_velocities = .false.
    real(wp) :: critical_velocity(2) = 0.0_wp
    type(slow_end_t) :: velocity(2)
  end type stick_slip_ends_t

contains

  !> The ends for a slider under a drive velocity [m/s] that is not 0.
  subroutine find_stick_slip_ends(slider, velocity, ends, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(stick_slip_ends_t), intent(out) :: ends
    type(error_t), allocatable, intent(out) :: error
    type(slider_t) :: own
    type(slow_validity_t) :: validity
    real(wp), parameter :: outwards(2) = [-1.0_wp, 1.0_wp]
    integer :: i

    ends%drive_velocity = abs(velocity)
    if (slider%is_damped()) then
      call raise(error, usage_error, 'ends of stick-slip are found only without dampers: remove damping_x and damping_y')
      return
    end if
    if (.not. falls_exponentially(slider%law)) then
      call raise(error, deck_error, "ends of stick-slip are found only with the laws 'constant' and 'weakening'", 'friction.law')
      return
    end if
    call low_frequency_limit(slider, velocity, ends%critical_angle, error)
    if (allocated(error) .or. .not. are_moderate(slider, velocity)) return
    own = slider
    own%along = abs(slider%along)
    if (ends%critical_angle > 0.0_wp) then
      ends%is_supercritical = criticality(own%law, velocity) > 0.0_wp
      call misalignment_end(own, velocity, ends%critical_angle, ends%misalignment, error)
      if (allocated(error)) return
    end if
    call bautin_point(own%law, ends%bautin_velocity, ends%bautin_angle, ends%has_bautin_point)
    if (ends%has_bautin_point) then
      own%along = [cos(ends%bautin_angle), sin(ends%bautin_angle)]
      validity = slow_validity(own, ends%bautin_velocity, common_accuracy)
      ends%has_bautin_point = validity%obstacle == ''
      own%along = abs(slider%along)
    end if
    if (.not. minval(own%along) > 0.0_wp) return
    call critical_velocities(own, ends%critical_velocity, ends%has_critical_velocities)
    if (.not. ends%has_critical_velocities) return
    do i = 1, 2
      call velocity_end(own, ends%critical_velocity(i), outwards(i), ends%velocity(i), error)
      if (allocated(error)) return
    end do
  end subroutine find_stick_slip_ends

  !> Whether the numbers of a scene are near enough to each other for the computation.
  pure logical function are_moderate(slider, velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    real(wp) :: limit, drop, decay, numbers(5)
    logical :: is_exponential

    call exponential_form(slider%law, limit, drop, decay, is_exponential)
    numbers = [slider%mass, slider%stiffness(1), slider%law%kinetic_limit, abs(velocity), max(decay, smallest)]
    are_moderate = all(numbers >= smallest .and. numbers <= 1.0_wp/smallest)
  end function are_moderate
end module dst_stick_slip_ends
