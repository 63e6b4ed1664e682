!> The length of the next step of an adaptive method, from the estimated error of the present one.
!>
!> If the estimate is of order k in the step h, the factor
!>
!>     f = safety*error**(-1/k),      error over tolerance,
!>
!> brings it to the tolerance, with a margin. The change of the error since the last accepted step gives more information, and a
!> method may use it in one of two ways:
!>
!>     prediction (Gustafsson):     f (h/h_last) (error/error_last)**(-1/k) if that is smaller than f,
!>     memory m (PI controller):    safety*error**(0.75 m - 1/k)*error_last**m in place of f.
!>
!> Source: Hairer & Wanner II, Sec. IV.2 (memory) and IV.8 (prediction).
module dst_step_control
  use dst_kinds, only: wp
  implicit none
  private

  public :: step_control_t, new_step_control, factor_for, shortened, no_number, unsolved_factor
  public :: safety, least_factor, least_error

  !> Margin to the tolerance, and the smallest factor. Hairer & Wanner's convention; nearer to 1: 9 % fewer iterations, larger
  !> errors.
  real(wp), parameter :: safety = 0.9_wp, least_factor = 0.2_wp
  !> Factor if an attempt gives no error at all. Convention.
  real(wp), parameter :: unsolved_factor = 0.25_wp
  !> The error used instead of one that is not a number; any large one gives the smallest factor.
  real(wp), parameter :: no_number = 1.0e6_wp
  !> Smallest error: it gives the largest factor at any order in use.
  real(wp), parameter :: least_error = 1.0e-10_wp
  !> Smallest error that a control with memory, or with prediction, keeps: an error that is all roundoff says nothing about the next
  !> one. Hairer & Wanner's conventions. Twice the latter: 0 to 2 % fewer iterations on Fig. 3.
  real(wp), parameter :: least_remembered = 1.0e-4_wp, least_predicting = 1.0e-2_wp
  !> The reduction of the exponent of the present error due to the memory. Hairer & Wanner's convention; nearer to 1: no change.
  real(wp), parameter :: memory_share = 0.75_wp

  !> The control of one method, with its state between steps.
  type :: step_control_t
    private
    real(wp) :: largest_factor = 1.0_wp
    real(wp) :: exponent = -1.0_wp
    real(wp) :: memory = 0.0_wp
    logical :: predicts = .false.
    !> Errors over tolerance of this attempt and of the last accepted step, 0 if there is none, and the length of that step [s].
    real(wp), public :: error = 0.0_wp, last_error = 0.0_wp, last_step = 0.0_wp
  contains
    procedure :: advise
    procedure :: accept
    procedure :: restart
  end type step_control_t

contains

  !> A control for an estimate of this order in the step.
  pure function new_step_control(order, largest_factor, predicts, memory) result(control)
    integer, intent(in) :: order
    real(wp), intent(in) :: largest_factor
    logical, intent(in), optional :: predicts
    real(wp), intent(in), optional :: memory
    type(step_control_t) :: control

    control%largest_factor = largest_factor
    if (present(predicts)) control%predicts = predicts
    if (present(memory)) control%memory = memory
    control%exponent = memory_share*control%memory - 1.0_wp/real(order, wp)
  end function new_step_control

  !> Factor for the step after an attempt of length `step` [s] with this error over tolerance, which is replaced by a number if it
  !> is not one. A step that repeats a rejected one is not followed by a longer one.
  pure subroutine advise(self, step, repeated, error, factor)
    class(step_control_t), intent(inout) :: self
    real(wp), intent(in) :: step
    logical, intent(in) :: repeated
    real(wp), intent(inout) :: error
    real(wp), intent(out) :: factor
    real(wp) :: change

    if (.not. error <= huge(error)) error = no_number
    self%error = max(error, least_error)
    factor = safety*self%error**self%exponent
    if (self%memory > 0.0_wp) factor = factor*max(self%last_error, least_remembered)**self%memory
    if (self%predicts .and. self%last_error > 0.0_wp .and. error <= 1.0_wp) then
      change = (self%error/max(self%last_error, least_predicting))**self%exponent
      factor = min(factor, factor*(step/self%last_step)*change)
    end if
    factor = min(self%largest_factor, max(least_factor, factor))
    if (repeated) factor = min(1.0_wp, factor)
  end subroutine advise

  !> The attempt has been accepted with this length [s].
  pure subroutine accept(self, step)
    class(step_control_t), intent(inout) :: self
    real(wp), intent(in) :: step

    self%last_error = self%error
    self%last_step = step
  end subroutine accept

  !> There is no last step any more.
  pure subroutine restart(self)
    class(step_control_t), intent(inout) :: self

    self%last_error = 0.0_wp
  end subroutine restart

  !> The factor from the error alone, for an estimate of this order.
  pure real(wp) function factor_for(error, order) result(factor)
    real(wp), intent(in) :: error
    integer, intent(in) :: order

    factor = max(least_factor, safety*max(error, least_error)**(-1.0_wp/real(order, wp)))
  end function factor_for

  !> The factor that reduces a step with the quantity `actual` so that it has the permitted one.
  pure real(wp) function shortened(allowed, actual) result(factor)
    real(wp), intent(in) :: allowed, actual

    factor = max(least_factor, safety*allowed/actual)
  end function shortened
end module dst_step_control
