!> The state of the object at one instant: in the unknowns of the models, and in plain quantities.
module dst_state
  use dst_kinds, only: wp
  use dst_slip_system, only: max_components, max_unknowns
  implicit none
  private

  public :: state_t, instant_t

  !> State in the unknowns of a model.
  type :: state_t
    real(wp) :: time = 0.0_wp                        !! s
    !> What rounding took from `time` [s]: so a sum of 1e8 steps is exact (Kahan).
    real(wp) :: time_rest = 0.0_wp
    real(wp) :: u(max_components) = 0.0_wp           !! spring elongation, m
    real(wp) :: y(max_unknowns) = 0.0_wp             !! slip unknowns of the model
    real(wp) :: position = 0.0_wp                    !! X, m
    real(wp) :: drive_work = 0.0_wp                  !! J
    real(wp) :: friction_work = 0.0_wp               !! J
    real(wp) :: damper_work = 0.0_wp                 !! J
  contains
    procedure :: later
    procedure :: until
    procedure :: arrive
  end type state_t

  !> State in plain quantities, whatever the model.
  type :: instant_t
    type(state_t) :: state
    real(wp) :: velocity(2) = 0.0_wp        !! slip velocity, m/s
    real(wp) :: drive_velocity = 0.0_wp     !! m/s
    real(wp) :: friction = 0.0_wp           !! N
    real(wp) :: theta = 0.0_wp              !! angle of friction to the soft axis, rad
    real(wp) :: spring_force(2) = 0.0_wp    !! N
    logical :: sticking = .false.           !! a touch does not count
  end type instant_t

contains

  !> Set the time to that of `from`, `duration` [s] later.
  elemental subroutine later(self, from, duration)
    class(state_t), intent(inout) :: self
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: duration
    real(wp) :: added, part

    added = duration + from%time_rest
    self%time = from%time + added
    part = self%time - from%time
    self%time_rest = (from%time - (self%time - part)) + (added - part)
  end subroutine later

  !> The duration [s] from now to a time [s].
  elemental real(wp) function until(self, time) result(duration)
    class(state_t), intent(in) :: self
    real(wp), intent(in) :: time

    duration = (time - self%time) - self%time_rest
  end function until

  !> Set the time to `time` [s] exactly.
  elemental subroutine arrive(self, time)
    class(state_t), intent(inout) :: self
    real(wp), intent(in) :: time

    self%time = time
    self%time_rest = 0.0_wp
  end subroutine arrive
end module dst_state
