!> A piece of a motion: one step, one stretch at rest, or one stretch in closed form, with the motion inside it.
module dst_piece
  use dst_dense_output, only: dense_output_t, column_u, column_y, column_position, n_columns
  use dst_drive, only: drive_segment_t
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_slip_system, only: max_components, max_unknowns, slip_system_t
  use dst_state, only: state_t
  implicit none
  private

  public :: piece_t, no_event, stick_begins, slip_begins, slips, touches, sticks

  !> The event at the end of a piece.
  integer, parameter :: no_event = 0, stick_begins = 1, slip_begins = 2
  !> Whether the object moves or rests; a touch is a rest so short that it does not count as a stick (dst_rest).
  integer, parameter :: slips = 0, touches = 1, sticks = 2

  !> From one state to another.
  type :: piece_t
    type(state_t) :: from, to
    integer :: contact = slips                         !! between its ends
    integer :: event = no_event                        !! at its end
    type(drive_segment_t) :: drive
    !> Elongation per displacement of the drive, and the axis along which nothing changes, 0 if there is none.
    real(wp) :: drive_coupling(max_components) = 0.0_wp
    integer :: held = 0
    !> Whether the slip unknowns are y = (v, theta).
    logical :: is_polar = .false.
    !> The motion in slip.
    type(dense_output_t) :: path
  contains
    procedure :: at
    procedure :: inside
    procedure :: slip_inside
    procedure :: obey
    procedure :: is_steady
  end type piece_t

contains

  !> The state at a time [s].
  pure function at(self, time) result(state)
    class(piece_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(state_t) :: state
    real(wp) :: elapsed

    if (time >= self%to%time) then
      state = self%to
    else
      elapsed = self%from%until(time)
      if (self%contact == slips) then
        state = self%inside(min(1.0_wp, max(0.0_wp, elapsed/self%path%step)))
      else
        state = self%from
        state%u = state%u + self%drive%displacement(self%from%time, elapsed)*self%drive_coupling
      end if
    end if
    state%time = time
  end function at

  !> The state at position `tau` in [0, 1] of slip. The work integrals are not interpolated, nor are quantities that the model keeps
  !> constant.
  pure function inside(self, tau) result(state)
    class(piece_t), intent(in) :: self
    real(wp), intent(in) :: tau
    type(state_t) :: state
    real(wp) :: value(n_columns)

    value = self%path%values_at(tau)
    call state%later(self%from, tau*self%path%step)
    state%u = value(column_u:column_u + max_components - 1) &
      + self%drive%displacement(self%from%time, tau*self%path%step)*self%drive_coupling
    state%y = value(column_y:column_y + max_unknowns - 1)
    state%position = value(column_position)
    if (self%held == 0) return
    state%u(self%held) = self%from%u(self%held)
    state%y(max_components) = self%from%y(max_components)
  end function inside

  !> The same, of which only time and slip unknowns are wanted.
  pure function slip_inside(self, tau) result(state)
    class(piece_t), intent(in) :: self
    real(wp), intent(in) :: tau
    type(state_t) :: state
    real(wp) :: basis(0:max_degree)
    integer :: k

    call state%later(self%from, tau*self%path%step)
    associate (s => self%path%grid%degree)
      call self%path%grid%lagrange(tau, basis)
      do k = 1, max_unknowns
        state%y(k) = dot_product(basis(0:s), self%path%nodal(0:s, column_y + k - 1))
      end do
    end associate
    if (self%held > 0) state%y(max_components) = self%from%y(max_components)
  end function slip_inside

  !> Whether the drive moves at a constant velocity, and goes on so after the piece.
  pure logical function is_steady(self)
    class(piece_t), intent(in) :: self

    is_steady = abs(self%drive%velocity) > 0.0_wp .and. .not. abs(self%drive%acceleration) > 0.0_wp &
      .and. self%to%time < self%drive%end
  end function is_steady

  !> From now on the pieces belong to this system.
  pure subroutine obey(self, system)
    class(piece_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system

    self%drive_coupling = system%drive_coupling
    self%is_polar = system%is_polar
    self%held = 0
    if (system%components < max_components) self%held = max_components + 1 - system%axis
  end subroutine obey
end module dst_piece
