!> A piece of a motion in the form that the summary uses.
module dst_piece_view
  use dst_kinds, only: wp
  use dst_motion, only: motion_t
  use dst_piece, only: piece_t
  use dst_state, only: state_t
  use dst_summary, only: moment_t, stretch_t
  implicit none
  private

  public :: piece_view_t, moment_of, friction_of

  !> A piece: the last one, or one that was kept.
  type, extends(stretch_t) :: piece_view_t
    class(motion_t), pointer :: motion => null()
    type(piece_t), pointer :: piece => null()
  contains
    procedure :: at
    procedure :: friction
  end type piece_view_t

contains

  !> A state in a piece that slips with this velocity [m/s].
  pure function moment_of(motion, piece, state, velocity) result(moment)
    class(motion_t), intent(in) :: motion
    type(piece_t), intent(in) :: piece
    type(state_t), intent(in) :: state
    real(wp), intent(in) :: velocity(2)
    type(moment_t) :: moment

    associate (slider => motion%slider)
      moment%time = state%time
      moment%position = state%position
      moment%rate = dot_product(velocity, slider%along)
      moment%slip_velocity = velocity
      moment%force = slider%stiffness(1)*state%u(1)
      moment%drive_velocity = piece%drive%velocity_at(state%time)
      moment%force_rate = slider%stiffness(1)*slider%free(1)*(moment%drive_velocity*slider%along(1) - velocity(1))
    end associate
  end function moment_of

  function at(self, time) result(moment)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(moment_t) :: moment
    type(state_t) :: state
    real(wp) :: velocity(2)

    state = self%piece%at(time)
    velocity = 0.0_wp
    if (.not. self%sticking) velocity = self%motion%velocity(state)
    moment = moment_of(self%motion, self%piece, state, velocity)
  end function at

  pure real(wp) function friction(self, speed)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: speed

    friction = friction_of(self%motion, speed)
  end function friction

  !> F(v) [N] at a slip speed [m/s].
  pure real(wp) function friction_of(motion, speed)
    class(motion_t), intent(in) :: motion
    real(wp), intent(in) :: speed
    real(wp) :: force(1), slope(1)

    call motion%slider%law%evaluate(1, [speed], force, slope)
    friction_of = force(1)
  end function friction_of
end module dst_piece_view
