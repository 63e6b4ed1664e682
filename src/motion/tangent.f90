!> The derivative of a motion with respect to its beginning, carried along with it from piece to piece.
!>
!> It is the derivative of the numbers, not of the equations. The nodal values Z of a step solve G(Z; u_0, y_0) = 0, so that
!>
!>     G_Z dZ = -(G_u0 du_0 + G_y0 dy_0),
!>
!> where G_Z is Newton's matrix once more; it needs nothing but the values that a piece has, and so costs nothing where it is not
!> wanted. Pieces in closed form and those of explicit methods are polynomials as well: for them G is collocation at their nodes.
!> The length of a step is held. At a stop u' = V e - w is continuous, and so is du at a fixed time. At a release the time shifts by
!>
!>     dt = -n.K du/(n.K V e),      n = f/|f|,  f = K u + C V e,
!>
!> and what follows is seen from there: du + V e dt is along the circle |f| = F_s. Where slip turns without a rest, the time shifts
!> with the zero of v.
!>
!> With respect to a parameter of the rig G, f and F_s have a derivative of their own: a difference of rigs on either side of it, with
!> the same nodal values.
module dst_tangent
  use dst_dense_output, only: column_u, column_y
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_passage, only: passage_t
  use dst_piece, only: piece_t, slips
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms, max_components, max_unknowns
  use dst_state, only: state_t
  implicit none
  private

  public :: tangent_t, rig_t, variation_t, set_slope, carry

  !> How the state changes at the end of a piece, per change at the beginning of the motion or of the rig; and, if wanted, u at
  !> its nodes.
  type :: tangent_t
    real(wp) :: u(max_components) = 0.0_wp, y(max_unknowns) = 0.0_wp
    real(wp) :: inside(0:max_degree, max_components) = 0.0_wp
    logical :: has_inside = .false.
    !> Whether y(1) is a slip speed, which ends at 0.
    logical :: is_polar = .true.
    !> How the time changes from which the piece is seen.
    real(wp) :: clock = 0.0_wp
    !> Whether the object rests; and how the time changes at which the slip speed has fallen to zero.
    logical :: rests = .true.
    real(wp) :: delay = 0.0_wp
  contains
    procedure :: follow
    procedure :: set_off
  end type tangent_t

  !> What the motion hangs on under a steady drive.
  type :: rig_t
    type(slider_t) :: slider
    class(slip_system_t), allocatable :: system
    real(wp) :: velocity = 0.0_wp              !! V, m/s
  end type rig_t

  !> Two rigs on either side of one, and how far they are apart in a parameter.
  type :: variation_t
    type(rig_t) :: more, less
    real(wp) :: apart = 1.0_wp
  contains
    procedure :: drift
  end type variation_t

contains

  !> P' of a passage that was recorded from one release to the next: how the direction of friction at its end changes with that at
  !> its beginning. It has none if it hangs on a release that just happens.
  subroutine set_slope(recording, system, slider, passage)
    type(recording_t), intent(in) :: recording
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(passage_t), intent(inout) :: passage
    type(tangent_t) :: tangent
    logical :: found

    call carry(recording, system, slider, tangent, found)
    if (found) call passage%take_slope(tangent%y(2))
  end subroutine set_slope

  !> Through a passage that was recorded from one release to the next: how the direction y(2) and the time `clock` of its end change
  !> with the direction of friction at its beginning or, if there is a variation, with that and the same direction.
  subroutine carry(recording, system, slider, tangent, found, variation, trail)
    type(recording_t), intent(in) :: recording
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(tangent_t), intent(out) :: tangent
    logical, intent(out) :: found
    type(variation_t), intent(in), optional :: variation
    type(tangent_t), allocatable, intent(inout), optional :: trail(:)   !! after each piece
    type(stage_terms_t) :: terms
    type(piece_t) :: piece
    integer :: i, nodes

    nodes = 0
    tangent%has_inside = present(trail)
    if (present(trail)) then
      if (allocated(trail)) deallocate (trail)
      allocate (trail(recording%count))
    end if
    do i = 1, recording%count
      call recording%get(i, state_t(), piece)
      if (i == 1) then
        associate (force => slider%force_at_rest(piece%from%u, piece%drive%velocity))
          tangent%u = [-force(2), force(1)]/slider%stiffness
          if (present(variation)) tangent%u = (begun(variation%more) - begun(variation%less))/variation%apart
        end associate
      end if
      if (piece%contact == slips .and. piece%path%grid%degree /= nodes) then
        nodes = piece%path%grid%degree
        terms = new_terms(nodes, system%components, system%unknowns)
      end if
      call tangent%follow(piece, system, slider, terms, found, variation)
      if (.not. found) return
      if (present(trail)) trail(i) = tangent
    end do
    call tangent%set_off(piece%to, piece%drive%velocity, slider, found, variation)

  contains

    !> The elongation with which the passage of another rig begins, in the same direction.
    pure function begun(rig) result(u)
      type(rig_t), intent(in) :: rig
      real(wp) :: u(2)

      associate (force => slider%force_at_rest(piece%from%u, piece%drive%velocity))
        u = rig%slider%elongation_at_limit(atan2(force(2), force(1)), rig%velocity)
      end associate
    end function begun
  end subroutine carry

  !> How V e changes, the rate [m/s] at which the drive stretches the springs of the object at rest.
  pure function drift(self)
    class(variation_t), intent(in) :: self
    real(wp) :: drift(2)

    drift = (self%more%velocity*self%more%slider%drive_coupling() - self%less%velocity*self%less%slider%drive_coupling()) &
      /self%apart
  end function drift

  !> Continue to the end of a piece.
  subroutine follow(self, piece, system, slider, terms, found, variation)
    class(tangent_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(stage_terms_t), intent(inout) :: terms
    logical, intent(out) :: found
    type(variation_t), intent(in), optional :: variation
    real(wp) :: rate, curvature

    found = .true.
    if (piece%contact /= slips) then
      self%rests = .true.
      if (present(variation)) self%u = self%u + variation%drift() &
        *(piece%to%time - piece%from%time + (piece%to%time_rest - piece%from%time_rest))
      return
    end if
    if (self%is_polar .and. .not. piece%from%y(1) > 0.0_wp) then
      if (.not. self%rests) then
        self%u = self%u + self%delay*piece%drive%velocity_at(piece%from%time)*piece%drive_coupling
        self%clock = self%clock + self%delay
      end if
      call self%set_off(piece%from, piece%drive%velocity_at(piece%from%time), slider, found, variation)
      if (.not. found) return
    end if
    self%rests = .false.
    call through_slip(self, piece, system, piece%path%grid%degree, system%components, system%unknowns, terms, found, variation)
    if (piece%to%y(1) > 0.0_wp .or. .not. self%is_polar) return
    call piece%path%end_slope(rate, curvature)
    self%delay = 0.0_wp
    if (rate < 0.0_wp) self%delay = -self%y(1)/rate
  end subroutine follow

  !> Slip begins in the direction of the force. From a rest it begins when the force reaches the limit.
  subroutine set_off(self, from, velocity, slider, found, variation)
    class(tangent_t), intent(inout) :: self
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: velocity         !! V, m/s
    type(slider_t), intent(in) :: slider
    logical, intent(out) :: found
    type(variation_t), intent(in), optional :: variation
    real(wp) :: force(2), change(2), growth(2), outward, limit, delay

    force = slider%force_at_rest(from%u, velocity)
    change = slider%stiffness*self%u
    limit = 0.0_wp
    if (present(variation)) then
      associate (more => variation%more, less => variation%less)
        change = change + (more%slider%force_at_rest(from%u, more%velocity) - less%slider%force_at_rest(from%u, less%velocity)) &
          /variation%apart
        limit = hypot(force(1), force(2))*(more%slider%law%static_limit - less%slider%law%static_limit)/variation%apart
      end associate
    end if
    if (self%rests) then
      growth = slider%drive_coupling()*velocity
      outward = dot_product(force, slider%stiffness*growth)
      found = outward > 0.0_wp
      if (.not. found) return
      delay = (limit - dot_product(force, change))/outward
      self%u = self%u + delay*growth
      self%clock = self%clock + delay
      change = change + delay*slider%stiffness*growth
    else
      found = any(abs(force) > 0.0_wp)
      if (.not. found) return
    end if
    self%y = 0.0_wp
    self%y(2) = (force(1)*change(2) - force(2)*change(1))/dot_product(force, force)
  end subroutine set_off

  !> Through a step in slip with s nodes, n components and m unknowns; the terms have room for all nodes. Compiled for the full model
  !> with each number of stages, and for any other.
  subroutine through_slip(self, piece, system, s, n, m, terms, found, variation)
    class(tangent_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    integer, intent(in) :: s, n, m
    type(stage_terms_t), intent(inout) :: terms
    logical, intent(out) :: found
    type(variation_t), intent(in), optional :: variation

    select case (100*s + 10*n + m)
    case (322)
      call step_3_2(self, piece, system, terms, found, variation)
    case (522)
      call step_5_2(self, piece, system, terms, found, variation)
    case (722)
      call step_7_2(self, piece, system, terms, found, variation)
    case default
      call step_of_any_size(self, piece, system, s, n, m, terms, found, variation)
    end select
  end subroutine through_slip

  subroutine step_3_2(self, piece, system, terms, found, variation)
    integer, parameter :: s = 3, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_3_2

  subroutine step_5_2(self, piece, system, terms, found, variation)
    integer, parameter :: s = 5, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_5_2

  subroutine step_7_2(self, piece, system, terms, found, variation)
    integer, parameter :: s = 7, n = 2, m = 2
    include 'tangent_step.inc'
  end subroutine step_7_2

  subroutine step_of_any_size(self, piece, system, s, n, m, terms, found, variation)
    integer, intent(in) :: s, n, m
    include 'tangent_step.inc'
  end subroutine step_of_any_size
end module dst_tangent
