!> A passage: the motion of a steadily driven object from one release to the next.
!>
!> At a release the object rests under |f| = F_s, so that the direction of this force is the whole state. alpha is its angle from
!> the soft to the stiff axis, each in the direction in which the drive pulls. A passage is a lap if it consists of one slip and one
!> rest and turns the force towards the soft axis; the others, which turn it back, end a slow cycle.
module dst_passage
  use dst_kinds, only: wp, int64
  use dst_piece, only: stick_begins, slip_begins, slips, sticks
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  implicit none
  private

  public :: passage_t, loss_t, passage_of, measured, alpha_of, theta_of, turning, still
  public :: duration, turn, slip_duration, drive_work, friction_work, damper_work, exchanged, measures

  !> The measures of a passage: its duration [s], the change of alpha [rad], the time until the object comes to its last rest [s],
  !> the works and the sum of their absolute values in the steps [J].
  integer, parameter :: duration = 1, turn = 2, slip_duration = 3, drive_work = 4, friction_work = 5, damper_work = 6, &
    exchanged = 7, measures = 7
  !> A passage that turns the force by less [rad] comes back to where it began: near a fixed point that the motion reaches from both
  !> sides in turn. Convention; twice: the same cycles of 12 random scenes.
  real(wp), parameter :: still = 1.0e-8_wp

  !> No loss is larger. Convention.
  real(wp), parameter :: most_lost = 1.0e100_wp

  !> What is lost in some passages: if each of them has a small relative error in its turn and its duration, these are the largest
  !> errors of the angle [rad] and of the time [s] at their end, over that error; they take so long [s]. A difference of the angle
  !> at their beginning is multiplied by `slope` at their end, and shifts the time by at most `shift` [s/rad].
  type :: loss_t
    real(wp) :: slope = 1.0_wp, shift = 0.0_wp, angle = 0.0_wp, time = 0.0_wp, lasted = 0.0_wp
  contains
    procedure :: go_on => lose_more
    procedure :: repeated
  end type loss_t

  !> From one release to the next, or over several passages.
  type :: passage_t
    real(wp) :: from = 0.0_wp, to = 0.0_wp      !! alpha, rad
    real(wp) :: measure(measures) = 0.0_wp
    !> The steps that it took, if it was run; and whether it is one slip and one rest.
    integer :: steps = 0
    logical :: is_plain = .false.
    !> Its table in the map (branch, place), 0 if it was run.
    integer :: table(2) = 0
    !> P'(alpha), and how the duration changes with alpha [s/rad].
    real(wp) :: slope = 0.0_wp, shift = 0.0_wp
    real(wp) :: log_slope = 0.0_wp              !! the sum of ln |P'| over the passages of a slow cycle or several
    type(loss_t) :: loss = loss_t()
    logical :: has_slope = .false.
  contains
    procedure :: turns_back
    procedure :: share_of_rest
    procedure :: take_slope
    procedure :: go_on
  end type passage_t

contains

  !> Whether the passage leads away from the soft axis, as a slip does.
  pure logical function turns_back(self)
    class(passage_t), intent(in) :: self

    turns_back = self%to >= self%from - still
  end function turns_back

  !> The share of the last rest.
  pure real(wp) function share_of_rest(self)
    class(passage_t), intent(in) :: self

    share_of_rest = 1.0_wp - self%measure(slip_duration)/max(tiny(1.0_wp), self%measure(duration))
  end function share_of_rest

  !> P' is known, and how the duration changes with alpha [s/rad].
  pure subroutine take_slope(self, slope, shift)
    class(passage_t), intent(inout) :: self
    real(wp), intent(in) :: slope, shift

    self%slope = slope
    self%shift = shift
    self%loss = loss_t(abs(slope), abs(shift), abs(self%measure(turn)), self%measure(duration), self%measure(duration))
    self%log_slope = log(max(tiny(1.0_wp), abs(slope)))
    self%has_slope = .true.
  end subroutine take_slope

  !> Continue with the passage that follows.
  pure subroutine go_on(self, next)
    class(passage_t), intent(inout) :: self
    type(passage_t), intent(in) :: next

    self%to = next%to
    self%measure = self%measure + next%measure
    self%shift = self%shift + self%slope*next%shift
    self%slope = self%slope*next%slope
    self%log_slope = self%log_slope + next%log_slope
    call self%loss%go_on(next%loss)
    self%has_slope = self%has_slope .and. next%has_slope
  end subroutine go_on

  !> What is lost if other passages follow.
  pure subroutine lose_more(self, next)
    class(loss_t), intent(inout) :: self
    type(loss_t), intent(in) :: next

    self%time = min(most_lost, self%time + next%shift*self%angle + next%time)
    self%angle = min(most_lost, next%slope*self%angle + next%angle)
    self%shift = min(most_lost, self%shift + self%slope*next%shift)
    self%slope = min(most_lost, self%slope*next%slope)
    self%lasted = self%lasted + next%lasted
  end subroutine lose_more

  !> What is lost in so many repetitions: each bit of the number stands for twice as many as the one before.
  pure function repeated(self, times) result(all)
    class(loss_t), intent(in) :: self
    integer(int64), intent(in) :: times
    type(loss_t) :: all, twice
    integer(int64) :: left

    all = loss_t()
    twice = self
    left = times
    do while (left > 0)
      if (modulo(left, 2_int64) == 1) call all%go_on(twice)
      call twice%go_on((twice))
      left = left/2
    end do
  end function repeated

  !> alpha [rad] of a direction `theta` of friction [rad], under this drive velocity [m/s].
  pure real(wp) function alpha_of(theta, slider, velocity) result(alpha)
    real(wp), intent(in) :: theta, velocity
    type(slider_t), intent(in) :: slider

    associate (pull => sign([1.0_wp, 1.0_wp], slider%along*velocity))
      alpha = atan2(pull(2)*sin(theta), pull(1)*cos(theta))
    end associate
  end function alpha_of

  !> The direction of friction [rad] at an angle alpha [rad].
  pure real(wp) function theta_of(alpha, slider, velocity) result(theta)
    real(wp), intent(in) :: alpha, velocity
    type(slider_t), intent(in) :: slider

    associate (pull => sign([1.0_wp, 1.0_wp], slider%along*velocity))
      theta = atan2(pull(2)*sin(alpha), pull(1)*cos(alpha))
    end associate
  end function theta_of

  !> The passage from `alpha` [rad] that was recorded from its release to the next one, under this drive velocity [m/s].
  pure type(passage_t) function passage_of(alpha, recording, slider, velocity) result(passage)
    real(wp), intent(in) :: alpha, velocity
    type(recording_t), intent(in) :: recording
    type(slider_t), intent(in) :: slider
    integer :: n

    passage = measured(recording)
    n = recording%count
    associate (value => passage%measure, from => recording%kept(1)%from, to => recording%kept(n)%to)
      if (slider%direction_free) &
        value(turn) = turn_of(slider, velocity, from%u, to%u, velocity*value(duration) - (to%position - from%position))
      passage%from = alpha
      passage%to = alpha + value(turn)
    end associate
    if (n < 2) return
    associate (kept => recording%kept(:n))
      passage%is_plain = kept(n)%contact == sticks .and. kept(n)%event == slip_begins .and. kept(n - 1)%event == stick_begins &
        .and. all(kept(:n - 1)%contact == slips) .and. all(kept(:n - 2)%event /= stick_begins)
    end associate
  end function passage_of

  !> What was recorded, which need not be a passage: without angles.
  pure type(passage_t) function measured(recording) result(passage)
    type(recording_t), intent(in) :: recording

    passage%steps = recording%count
    associate (value => passage%measure, from => recording%kept(1)%from, last => recording%kept(recording%count))
      value(duration) = recording%duration()
      value(slip_duration) = last%from%time + last%from%time_rest
      value(drive_work) = last%to%drive_work - from%drive_work
      value(friction_work) = last%to%friction_work - from%friction_work
      value(damper_work) = last%to%damper_work - from%damper_work
      value(exchanged) = recording%exchanged()
    end associate
  end function measured

  !> Angle [rad] by which the force on the object at rest has turned, towards larger alpha, after u has changed by `advance` [m]
  !> along the drive and the force is again at the static limit. From the ends alone it has the roundoff of the angle; from the
  !> advance, which counts from 0, its own.
  pure real(wp) function turn_of(slider, velocity, from, to, advance)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity         !! V [m/s]
    real(wp), intent(in) :: from(2), to(2)   !! u [m]
    real(wp), intent(in) :: advance
    real(wp), parameter :: least_slope = 0.01_wp
    integer, parameter :: iterations = 3
    real(wp) :: before(2), after(2), length(2), theta, angle, slope
    integer :: i

    before = slider%force_at_rest(from, velocity)
    after = slider%force_at_rest(to, velocity)
    angle = atan2(before(1)*after(2) - before(2)*after(1), dot_product(before, after))
    theta = atan2(before(2), before(1))
    length = slider%along*slider%law%static_limit/slider%stiffness
    do i = 1, iterations
      slope = length(2)*cos(theta + angle) - length(1)*sin(theta + angle)
      if (.not. abs(slope) > least_slope*maxval(abs(length))) exit
      associate (half => 0.5_wp*angle)
        angle = angle + (advance - 2.0_wp*sin(half)*(length(2)*cos(theta + half) - length(1)*sin(theta + half)))/slope
      end associate
    end do
    turn_of = angle*turning(slider, velocity)
  end function turn_of

  !> Whether alpha grows with theta (1) or against it (-1), under this drive velocity [m/s].
  pure real(wp) function turning(slider, velocity)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity

    turning = product(sign([1.0_wp, 1.0_wp], slider%along*velocity))
  end function turning
end module dst_passage
