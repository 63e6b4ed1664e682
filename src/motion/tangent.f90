!> The derivative of a motion with respect to its beginning or to a parameter, carried along with it from piece to piece.
!>
!> It is the derivative of the numbers, not of the equations. The nodal values Z of a step solve G(Z; u_0, y_0) = 0, so that
!>
!>     G_Z dZ = -(G_u0 du_0 + G_y0 dy_0),
!>
!> where G_Z is Newton's matrix once more, one for all directions; it needs nothing but the values that a piece has, and so costs
!> nothing where it is not wanted. Pieces in closed form and those of explicit methods are polynomials as well: for them G is
!> collocation at their nodes. The length of a step is held. At a stop u' = V e - w is continuous, and so is du at a fixed time. At
!> a release the time shifts by
!>
!>     dt = -n.df/(n.f'),      n = f/|f|,  f = K u + C V e,  f' = K V e + C V' e,
!>
!> and what follows is seen from there: du + V e dt is along the circle |f| = F_s. Where slip turns without a rest, the time shifts
!> with the zero of v. Where V changes, or will, a time counts, and the next piece is seen at fixed times again.
!>
!> With respect to a parameter of the rig G, f and F_s have a derivative of their own: a difference of rigs on either side of it,
!> with the same nodal values.
module dst_tangent
  use dst_dense_output, only: column_u, column_y
  use dst_drive, only: drive_segment_t
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, turning
  use dst_piece, only: piece_t, slips
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms, max_components, max_unknowns
  use dst_state, only: state_t
  use dst_stepping, only: stepping_t
  implicit none
  private

  public :: tangent_t, variation_t, directions_t, trail_t, set_slope, carry, rate_in, take_out_flow, n_changes

  !> Numbers that may change: u and y.
  integer, parameter :: n_changes = max_components + max_unknowns

  !> How the state changes in one direction at the end of a piece.
  type :: tangent_t
    real(wp) :: u(max_components) = 0.0_wp, y(max_unknowns) = 0.0_wp
    !> Whether y(1) is a slip speed, which ends at 0.
    logical :: is_polar = .true.
    !> How the time changes from which the piece is seen.
    real(wp) :: clock = 0.0_wp
    !> Whether the object rests; and how the time changes further at which the slip speed has fallen to zero.
    logical :: rests = .true.
    real(wp) :: delay = 0.0_wp
    !> When the last rest began [s], and how that changes.
    real(wp) :: rest_since = 0.0_wp, rest_shift = 0.0_wp
  contains
    procedure :: set_off
  end type tangent_t

  !> Two rigs on either side of one, and how far they are apart in a parameter; none: the direction is one of the beginning.
  type :: variation_t
    class(stepping_t), allocatable :: more, less
    real(wp) :: apart = 1.0_wp
  contains
    procedure :: is_there
    procedure :: drift
  end type variation_t

  !> Directions of some tangents, with room for the terms of a step.
  type :: directions_t
    type(variation_t), allocatable :: variation(:)
    integer, private :: nodes = 0
    type(stage_terms_t), private :: terms, others
  contains
    procedure :: follow
    procedure, private :: prepare
  end type directions_t

  !> What happens to a direction in a piece: u and y at its nodes, and the time from which it is seen.
  type :: trail_t
    real(wp) :: inside(0:max_degree, n_changes) = 0.0_wp
    real(wp) :: clock = 0.0_wp
  end type trail_t

contains

  !> P' of a passage that was recorded from one release to the next: how the direction of friction at its end changes with that at
  !> its beginning. It has none if it hangs on a release that just happens.
  subroutine set_slope(recording, system, slider, passage)
    type(recording_t), intent(in) :: recording
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(passage_t), intent(inout) :: passage
    type(directions_t) :: beginning
    type(tangent_t) :: tangent(1)
    type(piece_t) :: piece
    logical :: found

    allocate (beginning%variation(1))
    call carry(recording, system, slider, beginning, tangent, found)
    if (.not. found) return
    call recording%get(1, state_t(), piece)
    call passage%take_slope(tangent(1)%y(2), tangent(1)%clock*turning(slider, piece%drive%velocity))
  end subroutine set_slope

  !> Through a passage that was recorded from one release to the next: how the direction y(2) and the time `clock` of its end change
  !> with the direction of friction at its beginning or, with a variation, with that and the same direction.
  subroutine carry(recording, system, slider, directions, tangents, found, trail)
    type(recording_t), intent(in) :: recording
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(directions_t), intent(inout) :: directions
    type(tangent_t), intent(out) :: tangents(:)
    logical, intent(out) :: found
    type(trail_t), allocatable, intent(inout), optional :: trail(:, :)   !! of each direction in each piece
    type(piece_t) :: piece
    integer :: i, k

    if (present(trail)) then
      if (allocated(trail)) deallocate (trail)
      allocate (trail(size(tangents), recording%count))
    end if
    do i = 1, recording%count
      call recording%get(i, state_t(), piece)
      if (i == 1) then
        do k = 1, size(tangents)
          tangents(k)%u = begun(directions%variation(k))
        end do
      end if
      if (present(trail)) then
        call directions%follow(tangents, piece, system, slider, found, trail(:, i))
      else
        call directions%follow(tangents, piece, system, slider, found)
      end if
      if (.not. found) return
    end do
    do k = 1, size(tangents)
      call tangents(k)%set_off(piece%to, piece%drive, slider, directions%variation(k), found)
      if (.not. found) return
    end do

  contains

    !> How the elongation changes with which the passage begins: with its direction, or in the same direction.
    pure function begun(variation) result(u)
      type(variation_t), intent(in) :: variation
      real(wp) :: u(2), theta

      associate (force => slider%force_at_rest(piece%from%u, piece%drive%velocity))
        u = [-force(2), force(1)]/slider%stiffness
        if (.not. variation%is_there()) return
        theta = atan2(force(2), force(1))
      end associate
      associate (more => variation%more, less => variation%less)
        u = (more%slider%elongation_at_limit(theta, more%piece%drive%velocity) &
          - less%slider%elongation_at_limit(theta, less%piece%drive%velocity))/variation%apart
      end associate
    end function begun
  end subroutine carry

  !> Whether it is one of a parameter.
  elemental logical function is_there(self)
    class(variation_t), intent(in) :: self

    is_there = allocated(self%more)
  end function is_there

  !> How the elongation changes by which the drive stretches the springs of the object at rest, from a time on that changes itself
  !> by `clock`, for so long [s].
  pure function drift(self, time, elapsed, clock)
    class(variation_t), intent(in) :: self
    real(wp), intent(in) :: time, elapsed, clock
    real(wp) :: drift(2)

    associate (more => self%more, less => self%less, later => 0.5_wp*clock*self%apart)
      drift = (more%piece%drive%displacement(time + later, elapsed)*more%slider%drive_coupling() &
        - less%piece%drive%displacement(time - later, elapsed)*less%slider%drive_coupling())/self%apart
    end associate
  end function drift

  !> Continue to the end of a piece. With respect to the beginning the drive must be steady.
  subroutine follow(self, tangents, piece, system, slider, found, trail)
    class(directions_t), intent(inout) :: self
    type(tangent_t), intent(inout) :: tangents(:)
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    logical, intent(out) :: found
    type(trail_t), intent(inout), optional :: trail(:)
    real(wp) :: rate(n_changes), slope, curvature
    logical :: stops
    integer :: k

    found = .true.
    stops = .false.
    if (piece%contact /= slips) then
      do k = 1, size(tangents)
        associate (one => tangents(k), variation => self%variation(k))
          if (present(trail)) trail(k)%clock = one%clock
          if (present(trail)) trail(k)%inside = spread([one%u, one%y], 1, max_degree + 1)
          one%rests = .true.
          if (variation%is_there()) one%u = one%u + variation%drift(piece%from%time, &
            piece%from%until(piece%to%time) + piece%to%time_rest, one%clock)
        end associate
      end do
    else
      if (tangents(1)%is_polar .and. .not. piece%from%y(1) > 0.0_wp) then
        do k = 1, size(tangents)
          call tangents(k)%set_off(piece%from, piece%drive, slider, self%variation(k), found)
          if (.not. found) return
        end do
      end if
      tangents%rests = .false.
      if (present(trail)) trail%clock = tangents%clock
      call through_slip(self, tangents, piece, system, piece%path%grid%degree, system%components, system%unknowns, found, trail)
      if (.not. found) return
      stops = tangents(1)%is_polar .and. .not. piece%to%y(1) > 0.0_wp
    end if
    if (abs(piece%drive%acceleration) > 0.0_wp .or. piece%to%time >= piece%drive%end) then
      rate = rate_in(piece, 1.0_wp)
      do k = 1, size(tangents)
        associate (one => tangents(k))
          one%u = one%u - one%clock*rate(:max_components)
          one%y = one%y - one%clock*rate(max_components + 1:)
          one%clock = 0.0_wp
        end associate
      end do
    end if
    if (.not. stops) return
    call piece%path%end_slope(slope, curvature)
    tangents%delay = 0.0_wp
    if (slope < 0.0_wp) tangents%delay = -tangents%y(1)/slope
    tangents%rest_since = piece%to%time
    tangents%rest_shift = tangents%clock + tangents%delay
  end subroutine follow

  !> Rates of u and y [1/s] at position `tau` in [0, 1] of a piece.
  pure function rate_in(piece, tau) result(rate)
    type(piece_t), intent(in) :: piece
    real(wp), intent(in) :: tau
    real(wp) :: rate(n_changes), basis(0:max_degree), weight(0:max_degree)
    integer :: i

    rate = 0.0_wp
    if (piece%contact == slips) then
      associate (path => piece%path, s => piece%path%grid%degree)
        call path%grid%lagrange(tau, basis)
        weight(0:s) = matmul(basis(0:s), path%grid%derivative(0:s, 0:s))/path%step
        do i = 1, max_components
          rate(i) = dot_product(weight(0:s), path%nodal(0:s, column_u + i - 1))
        end do
        do i = 1, max_unknowns
          rate(max_components + i) = dot_product(weight(0:s), path%nodal(0:s, column_y + i - 1))
        end do
      end associate
    end if
    associate (duration => piece%from%until(piece%to%time) + piece%to%time_rest)
      rate(:max_components) = rate(:max_components) &
        + piece%drive%velocity_at(piece%from%time + tau*duration)*piece%drive_coupling
    end associate
  end function rate_in

  !> Take out of a difference of u and y at the end of a piece in slip what it has along the flow, which is a shift of the time [s];
  !> the size of what is left: speeds are measured in V, lengths in V sqrt(m/k), a direction in rad. `flows`: the state changes at
  !> all.
  pure subroutine take_out_flow(difference, piece, slider, shift, size_of, flows)
    real(wp), intent(inout) :: difference(n_changes)
    type(piece_t), intent(in) :: piece
    type(slider_t), intent(in) :: slider
    real(wp), intent(out) :: shift, size_of
    logical, intent(out) :: flows
    real(wp), dimension(n_changes) :: flow, measured
    real(wp) :: square

    measured = 0.0_wp
    measured(:max_components) = sqrt(slider%stiffness/slider%mass)/piece%drive%velocity
    measured(max_components + 1:max_components + 2) = 1.0_wp/piece%drive%velocity
    if (piece%is_polar) measured(max_components + 2) = 1.0_wp
    flow = rate_in(piece, 1.0_wp)
    square = sum((measured*flow)**2)
    flows = square > 0.0_wp
    shift = 0.0_wp
    if (flows) shift = sum(measured*flow*(measured*difference))/square
    difference = difference - shift*flow
    size_of = sqrt(sum((measured*difference)**2))
  end subroutine take_out_flow

  !> Slip begins in the direction of the force. From a rest it begins when the force reaches the limit; otherwise where slip has
  !> turned.
  subroutine set_off(self, from, drive, slider, variation, found)
    class(tangent_t), intent(inout) :: self
    type(state_t), intent(in) :: from
    type(drive_segment_t), intent(in) :: drive
    type(slider_t), intent(in) :: slider
    type(variation_t), intent(in) :: variation
    logical, intent(out) :: found
    real(wp) :: force(2), change(2), loading(2), outward, limit, velocity, age, ageing

    velocity = drive%velocity_at(from%time)
    force = slider%force_at_rest(from%u, velocity)
    loading = slider%loading_rate(velocity, drive%acceleration)
    ! How the force changes at the time from which it has been seen so far.
    change = slider%stiffness*self%u + self%clock*slider%loading_rate(0.0_wp, drive%acceleration)
    age = -from%until(self%rest_since)
    ! The limit grows from the time on at which the rest has begun.
    ageing = hypot(force(1), force(2))*slider%law%limit_rate(age)
    limit = ageing*(self%clock - self%rest_shift)
    if (variation%is_there()) then
      associate (more => variation%more, less => variation%less)
        change = change + (more%slider%force_at_rest(from%u, more%piece%drive%velocity_at(from%time)) &
          - less%slider%force_at_rest(from%u, less%piece%drive%velocity_at(from%time)))/variation%apart
        limit = limit + hypot(force(1), force(2)) &
          *(more%slider%law%limit_after(age) - less%slider%law%limit_after(age))/variation%apart
      end associate
    end if
    if (self%rests) then
      outward = dot_product(force, loading) - ageing
      found = outward > 0.0_wp
      if (.not. found) return
      self%delay = (limit - dot_product(force, change))/outward
    else
      found = any(abs(force) > 0.0_wp)
      if (.not. found) return
    end if
    self%u = self%u + self%delay*velocity*slider%drive_coupling()
    self%clock = self%clock + self%delay
    change = change + self%delay*loading
    self%y = 0.0_wp
    self%y(2) = (force(1)*change(2) - force(2)*change(1))/dot_product(force, force)
  end subroutine set_off

  !> Room for the terms of a step with so many nodes.
  subroutine prepare(self, nodes, system)
    class(directions_t), intent(inout) :: self
    integer, intent(in) :: nodes
    class(slip_system_t), intent(in) :: system

    if (self%nodes == nodes) return
    self%nodes = nodes
    self%terms = new_terms(nodes, system%components, system%unknowns)
    if (any(self%variation%is_there())) self%others = self%terms
  end subroutine prepare

  !> Through a step in slip with s nodes, n components and m unknowns. Compiled for the full model with each number of stages, and
  !> for any other.
  subroutine through_slip(self, tangents, piece, system, s, n, m, found, trail)
    type(directions_t), intent(inout) :: self
    type(tangent_t), intent(inout) :: tangents(:)
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    integer, intent(in) :: s, n, m
    logical, intent(out) :: found
    type(trail_t), intent(inout), optional :: trail(:)

    call self%prepare(s, system)
    select case (100*s + 10*n + m)
    case (322)
      call step_3_2(self, tangents, piece, system, found, trail)
    case (522)
      call step_5_2(self, tangents, piece, system, found, trail)
    case (722)
      call step_7_2(self, tangents, piece, system, found, trail)
    case default
      call step_of_any_size(self, tangents, piece, system, s, n, m, found, trail)
    end select
  end subroutine through_slip

  subroutine step_3_2(self, tangents, piece, system, found, trail)
    integer, parameter :: s = 3, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_3_2

  subroutine step_5_2(self, tangents, piece, system, found, trail)
    integer, parameter :: s = 5, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_5_2

  subroutine step_7_2(self, tangents, piece, system, found, trail)
    integer, parameter :: s = 7, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_7_2

  subroutine step_of_any_size(self, tangents, piece, system, s, n, m, found, trail)
    integer, intent(in) :: s, n, m
    include 'tangent_step.inc'
  end subroutine step_of_any_size
end module dst_tangent
