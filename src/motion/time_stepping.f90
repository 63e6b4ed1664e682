!> Motion by a scheme that solves for rest itself: its unknowns are the slip velocity, and a step may end with w = 0.
module dst_time_stepping
  use dst_kinds, only: wp
  use dst_piece, only: stick_begins, slip_begins, slips, sticks
  use dst_rest, only: is_held, limit_roundoff, spring_force_size
  use dst_stepping, only: stepping_t
  implicit none
  private

  public :: time_stepping_t

  !> Motion by time steps without events.
  type, extends(stepping_t) :: time_stepping_t
  contains
    procedure :: begin
    procedure :: settle
  end type time_stepping_t

contains

  !> Begin with the present state, at rest or in motion.
  subroutine begin(self)
    class(time_stepping_t), intent(inout) :: self

    call self%stepping_t%begin()
    associate (now => self%piece%to)
      if (any(abs(now%y) > 0.0_wp)) return
      if (.not. is_held(self%slider, now%u, self%drive_velocity(), self%piece%drive%acceleration)) return
    end associate
    self%contact = sticks
    call self%note_event(stick_begins)
  end subroutine begin

  !> Whether the object is at rest now, according to the method, and the event that this is. A step that ends with w = 0 under more
  !> load than friction can balance is a turn.
  subroutine settle(self, stopped, truncated)
    class(time_stepping_t), intent(inout) :: self
    logical, intent(in) :: stopped, truncated
    logical :: rests

    associate (unused => [stopped, truncated])
    end associate
    associate (now => self%piece%to)
      rests = .not. any(abs(now%y) > 0.0_wp) .and. &
        spring_force_size(self%slider, now%u, self%drive_velocity()) <= self%slider%law%static_limit*(1.0_wp + limit_roundoff)
    end associate
    if (rests .and. self%contact == slips) call self%note_event(stick_begins)
    if (.not. rests .and. self%contact == sticks) call self%note_event(slip_begins)
    self%contact = merge(sticks, slips, rests)
    if (.not. rests) self%piece%contact = slips
  end subroutine settle
end module dst_time_stepping
