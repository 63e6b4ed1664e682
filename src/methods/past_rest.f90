!> An explicit method for motion that can rest: where the slip is slow compared with itself, Radau IIA makes the step.
!>
!> An explicit method evaluates y' = g/B, which has no value at rest, and near a rest the direction of slip relaxes in the time that
!> is left. So steps in which the slip is slow anywhere, as the first one after a release and the last one before a stop, are those
!> of Radau IIA.
module dst_past_rest
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_drive, only: drive_segment_t
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_radau, only: radau_t, new_radau
  use dst_runge_kutta, only: runge_kutta_t, new_runge_kutta
  use dst_slip_system, only: slip_system_t
  use dst_state, only: state_t
  use dst_stepper, only: stepper_t, attempt_t, serialise_stepper
  implicit none
  private

  public :: past_rest_t, new_past_rest

  !> The slip is slow below this share of the largest slip speed in the step, in this slip, or in the last one. With dopri5 on Fig.
  !> 3 (1 s, rtol 1e-6) twice is 20 % less work, half 38 % more.
  real(wp), parameter :: slow = 0.1_wp
  !> The stages of Radau IIA, and its tolerance over rtol: so accurate that a passage hardly depends on where the methods take
  !> turns. With 3 stages at rtol itself the release map has no tables below 1e-6.
  integer, parameter :: stages = 5
  real(wp), parameter :: near_share = 0.1_wp

  !> An explicit method `away` from rest, and an implicit one `near` it.
  type, extends(stepper_t) :: past_rest_t
    type(runge_kutta_t) :: away
    type(radau_t) :: near
    !> Whether the last attempt is that of `near`.
    logical, private :: is_near = .false.
    !> `peak_speed` at the end of the last slip [m/s].
    real(wp), private :: usual_speed = 0.0_wp
  contains
    procedure :: restart
    procedure :: begin_slip
    procedure :: attempt
    procedure :: accept
    procedure :: serialise
  end type past_rest_t

contains

  !> The explicit method called `method_name`, for a system with these numbers of components and slip unknowns.
  function new_past_rest(method_name, components, unknowns, rtol) result(stepper)
    character(*), intent(in) :: method_name
    integer, intent(in) :: components, unknowns
    real(wp), intent(in) :: rtol
    type(past_rest_t) :: stepper

    stepper%away = new_runge_kutta(method_name, components, unknowns, rtol)
    stepper%near = new_radau(stages, components, unknowns, near_share*rtol)
    stepper%grid = stepper%away%grid
    stepper%noise_floor = stepper%away%noise_floor
    stepper%near%explicit = .true.
  end function new_past_rest

  pure subroutine restart(self, rate, curvature)
    class(past_rest_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    call self%away%restart(rate, curvature)
    call self%near%restart(rate, curvature)
    self%start_speed = 0.0_wp
    self%peak_speed = 0.0_wp
  end subroutine restart

  pure subroutine begin_slip(self, rate, curvature)
    class(past_rest_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    self%usual_speed = self%peak_speed
    call self%restart(rate, curvature)
    call self%near%begin_slip(rate, curvature)
  end subroutine begin_slip

  subroutine attempt(self, system, drive, from, step, to, outcome, to_stop)
    class(past_rest_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(in), optional :: to_stop
    real(wp) :: coefficient(0:max_degree)

    self%is_near = .not. (system%turns_back .or. from%y(1) > slow*max(self%peak_speed, self%usual_speed))
    if (present(to_stop)) self%is_near = self%is_near .or. to_stop
    if (.not. self%is_near) then
      call lend(self, self%away)
      call self%away%attempt(system, drive, from, step, to, outcome)
      call take_back(self, self%away)
      if (system%turns_back) return
      self%is_near = .not. outcome%solved
      if (outcome%solved) then
        ! A rejected step has no dense output.
        outcome%solved = outcome%error <= 1.0_wp
        if (.not. outcome%solved) return
        call self%speed_coefficients(coefficient)
        self%is_near = minval(coefficient(:self%grid%degree)) <= slow*self%speed_scale
      end if
      if (.not. self%is_near) return
    end if
    call lend(self, self%near)
    call self%near%attempt(system, drive, from, step, to, outcome, to_stop)
    call take_back(self, self%near)
  end subroutine attempt

  !> What a method needs of the motion so far.
  pure subroutine lend(self, method)
    class(past_rest_t), intent(in) :: self
    class(stepper_t), intent(inout) :: method

    method%count = self%count
    method%unseen = self%unseen
    method%newton_share = self%newton_share
  end subroutine lend

  !> The attempt of a method is that of this one.
  pure subroutine take_back(self, method)
    class(past_rest_t), intent(inout) :: self
    class(stepper_t), intent(in) :: method

    call self%take(method)
    self%count = method%count
    self%speed_scale = method%speed_scale
    self%unseen_growth = method%unseen_growth
    self%emerged = method%emerged
  end subroutine take_back

  !> The other method begins again where it is needed next.
  pure subroutine accept(self)
    class(past_rest_t), intent(inout) :: self

    call self%note_speed()
    call self%note_growth()
    if (self%is_near) then
      call self%near%accept()
    else
      call self%away%accept()
      associate (rate => self%away%end_rate())
        call self%near%restart(rate, 0.0_wp*rate)
      end associate
    end if
  end subroutine accept

  !> Save or load.
  subroutine serialise(self, archive)
    class(past_rest_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call serialise_stepper(self, archive)
    call self%away%serialise(archive)
    call self%near%serialise(archive)
    call archive%serialise(c_loc(self%usual_speed), storage_size(self%usual_speed))
  end subroutine serialise
end module dst_past_rest
