!> The sensitivity of a settled regular motion: the derivative of its cycle with respect to parameters of the rig.
!>
!> The cycle is a fixed point of the map of its slow cycles, theta -> P(theta; p). A passage of it that was run has the derivatives
!> of its turn and of its duration with respect to theta and to p (dst_tangent), and so have the peak and the valley of the load in
!> its slip, whose times shift with the zero of u_x'. The fixed point shifts by
!>
!>     dtheta/dp = (dP/dp)/(1 - dP/dtheta),
!>
!> and with it all that is measured. No run is compared with another one.
module dst_sensitivity
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_cycles, only: extremum_t, measures, period, peak, valley, stick_time, slip_time, slip_length
  use dst_dense_output, only: column_u
  use dst_deck_values, only: deck_t
  use dst_errors, only: error_t, raise, deck_error, usage_error
  use dst_full_cycles, only: full_cycle_t, orbit_t, regularity_t, settle, sharpen, steady, measure, shares
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, duration
  use dst_piece, only: piece_t, slips
  use dst_release_map, only: release_map_t
  use dst_scene, only: scene_t
  use dst_schema, only: longest_text
  use dst_state, only: state_t
  use dst_tangent, only: tangent_t, trail_t, variation_t, directions_t, carry, rate_in, n_changes
  use dst_variation, only: vary
  implicit none
  private

  public :: sensitivity_t, find_sensitivity

  !> The measures of the cycle, as in dst_cycles, and their derivatives (measure, parameter); the names and values of the
  !> parameters.
  type :: sensitivity_t
    real(wp) :: value(measures) = 0.0_wp
    real(wp), allocatable :: derivative(:, :), parameter(:)
    character(longest_text), allocatable :: key(:)
  end type sensitivity_t

contains

  !> The sensitivity of the motion of a deck's scene, which keeps one drive velocity [m/s], to the keys GROUP.KEY in a list.
  subroutine find_sensitivity(deck, scene, velocity, keys, sensitivity, error)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    character(*), intent(in) :: keys         !! separated by blanks
    type(sensitivity_t), intent(out) :: sensitivity
    type(error_t), allocatable, intent(out) :: error
    type(full_cycle_t), allocatable :: cycles(:)
    type(regularity_t) :: regularity
    type(release_map_t) :: map
    type(variation_t), allocatable :: variation(:)
    type(orbit_t) :: orbit
    real(wp) :: pull

    ! The mirror image has the same cycles, but the key has the sign of the scene.
    pull = sign(velocity, scene%drive_velocity(1))
    if (scene%model /= 'full' .or. scene%contact /= 'exact') call raise(error, deck_error, &
      "scene.model: sensitivities are those of model 'full' with contact 'exact': give these", 'scene.model')
    if (.not. allocated(error)) &
      call vary(deck, steady(scene, pull), keys, sensitivity%key, sensitivity%parameter, variation, error)
    if (allocated(error)) return
    call settle(scene, pull, map, orbit, cycles, regularity, error)
    if (allocated(error)) return
    if (orbit%goes_on .and. regularity%repeats == 0) then
      call raise(error, usage_error, 'the motion does not repeat, so that its cycles have no sensitivity: long means of '// &
        'an irregular motion have one, by runs at both values')
      return
    end if
    call sharpen(steady(scene, pull), cycles, map, error)
    if (allocated(error)) return
    if (size(cycles) > 0) then
      if (.not. ieee_is_nan(cycles(1)%log_multiplier)) then
        call differentiate(map, cycles(1)%release(1), cycles(1)%repeats, variation, sensitivity, error)
        return
      end if
    end if
    call raise(error, usage_error, 'the motion comes to no cycle with rest: its sensitivity is not known')
  end subroutine find_sensitivity

  !> Around the cycle that begins with a release. Direction 1 is that of this release, the others are those of the parameters.
  subroutine differentiate(map, alpha, slow_cycles, variation, sensitivity, error)
    type(release_map_t), intent(inout) :: map
    real(wp), intent(in) :: alpha
    integer, intent(in) :: slow_cycles
    type(variation_t), intent(in) :: variation(:)
    type(sensitivity_t), intent(inout) :: sensitivity
    type(error_t), allocatable, intent(out) :: error
    type(directions_t) :: directions
    type(passage_t) :: passage
    type(tangent_t) :: tangents(1 + size(variation))
    type(trail_t), allocatable :: trail(:, :)
    type(extremum_t) :: high, low
    real(wp), dimension(1 + size(variation)) :: turned, lasting, direct
    real(wp), dimension(measures, slow_cycles, 1 + size(variation)) :: change
    real(wp), dimension(measures, slow_cycles) :: each
    real(wp) :: slip(measures, 1 + size(variation)), total(measures, 1 + size(variation)), release, lasted
    logical :: found
    integer :: i, k

    allocate (directions%variation(1 + size(variation)))
    directions%variation(2:) = variation
    release = alpha
    direct = 1.0_wp
    direct(1) = 0.0_wp
    turned = 0.0_wp
    turned(1) = 1.0_wp
    do i = 1, slow_cycles
      lasted = 0.0_wp
      lasting = 0.0_wp
      do
        call map%run(release, map%longest, passage, found, error)
        if (allocated(error)) return
        if (found) call carry(map%recording, map%steps%system, map%steps%slider, directions, tangents, found, trail)
        lasted = lasted + passage%measure(duration)
        if (found .and. passage%turns_back()) then
          call measure(map, lasted, each(:, i), high, low)
          do k = 1, size(tangents)
            if (found) call differentiate_slip(map, high%time, low%time, trail(k, :), directions%variation(k), slip(:, k), found)
          end do
        end if
        if (.not. found) then
          call raise(error, usage_error, 'the cycle hangs on a release that just happens, and has no derivative')
          return
        end if
        ! What the parameter does here, and what the beginning does, which it has turned.
        if (passage%turns_back()) change(:, i, :) = spread(turned, 1, measures)*spread(slip(:, 1), 2, size(turned)) &
          + spread(direct, 1, measures)*slip
        lasting = lasting + turned*tangents(1)%clock + direct*tangents%clock
        turned = turned*tangents(1)%y(2) + direct*tangents%y(2)
        release = passage%to
        if (passage%turns_back()) exit
      end do
      change(period, i, :) = lasting
      if (low%time < high%time) change(slip_time, i, :) = change(slip_time, i, :) + lasting
      change(stick_time, i, :) = lasting - change(slip_time, i, :)
    end do
    sensitivity%value = sum(shares(each)*each, 2)
    total = sum(spread(shares(each), 3, size(turned))*change, 2)
    allocate (sensitivity%derivative(measures, size(variation)))
    do k = 1, size(variation)
      sensitivity%derivative(:, k) = total(:, k + 1) + total(:, 1)*turned(k + 1)/(1.0_wp - turned(1))
    end do
  end subroutine differentiate

  !> The derivatives of the measures of a slip: of the loads at its extremes, which are there at the times `high` and `low` [s], of
  !> the time between them, and of the advance.
  subroutine differentiate_slip(map, high, low, trail, variation, derivative, found)
    type(release_map_t), intent(in) :: map
    real(wp), intent(in) :: high, low
    type(trail_t), intent(in) :: trail(:)
    type(variation_t), intent(in) :: variation
    real(wp), intent(out) :: derivative(measures)
    logical, intent(out) :: found
    real(wp), dimension(2) :: u_high, u_low, of_high, of_low, of_direction
    real(wp) :: delay(2), side, of_velocity, of_stiffness

    derivative = 0.0_wp
    of_direction = 0.0_wp
    of_velocity = 0.0_wp
    of_stiffness = 0.0_wp
    if (variation%is_there()) then
      associate (more => variation%more, less => variation%less)
        of_direction = (more%slider%along - less%slider%along)/variation%apart
        of_velocity = (more%piece%drive%velocity - less%piece%drive%velocity)/variation%apart
        of_stiffness = (more%slider%stiffness(1) - less%slider%stiffness(1))/variation%apart
      end associate
    end if
    call look(high, u_high, of_high, delay(1), found)
    if (found) call look(low, u_low, of_low, delay(2), found)
    if (.not. found) return
    associate (slider => map%steps%slider)
      side = sign(1.0_wp, slider%along(1)*map%velocity)
      derivative(peak) = side*(slider%stiffness(1)*of_high(1) + of_stiffness*u_high(1))
      derivative(valley) = side*(slider%stiffness(1)*of_low(1) + of_stiffness*u_low(1))
      derivative(slip_time) = delay(2) - delay(1)
      ! X is V t - u.e but for a constant.
      derivative(slip_length) = sign(1.0_wp, map%velocity)*(of_velocity*(low - high) + map%velocity*(delay(2) - delay(1)) &
        - dot_product(of_low - of_high, slider%along) - dot_product(u_low - u_high, of_direction))
    end associate

  contains

    !> The elongation u [m] at an extremum of the load, how it changes there, and how its time does [s].
    subroutine look(time, u, of_u, of_time, is_inside)
      real(wp), intent(in) :: time
      real(wp), intent(out) :: u(2), of_u(2), of_time
      logical, intent(out) :: is_inside
      type(piece_t) :: piece
      type(state_t) :: state
      real(wp) :: tau, basis(0:max_degree), rate(n_changes), of_rate, bend
      integer :: place

      place = map%recording%place_of(time)
      call map%recording%get(place, state_t(), piece)
      is_inside = piece%contact == slips
      if (.not. is_inside) return
      tau = min(1.0_wp, piece%from%until(time)/piece%path%step)
      state = piece%inside(tau)
      u = state%u
      associate (grid => piece%path%grid, s => piece%path%grid%degree, h => piece%path%step, change => trail(place))
        call grid%lagrange(tau, basis)
        of_u = matmul(basis(0:s), change%inside(0:s, :2))
        rate = rate_in(piece, tau)
        of_rate = dot_product(basis(0:s), matmul(grid%derivative(0:s, 0:s), change%inside(0:s, 1)))/h
        bend = dot_product(basis(0:s), matmul(grid%derivative(0:s, 0:s), &
          matmul(grid%derivative(0:s, 0:s), piece%path%nodal(0:s, column_u))))/h**2
        of_time = -of_rate/bend
        of_u = of_u + rate(:2)*of_time
        of_time = of_time + change%clock
      end associate
    end subroutine look
  end subroutine differentiate_slip
end module dst_sensitivity
