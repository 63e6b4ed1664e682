!> Whether a motion that slips without a rest repeats.
!>
!> Such a motion has no releases by which a repetition would be known. It is looked at once in a period instead. What the difference
!> between two looks has along the flow is an error of the period, which the next look no longer has; what it has across shrinks as
!> the motion settles. The first period is the time between two peaks of the load; where differences do not shrink, between every
!> second, every third one, and so on. A look ends a step; so where differences shrink slowly, it is looked again after half of the
!> time in which they would be small enough, or as much time as has passed.
module dst_recurrence
  use dst_kinds, only: wp
  use dst_piece, only: piece_t
  use dst_slider, only: slider_t
  use dst_slow_cycle, only: most_repeats
  use dst_state, only: state_t
  use dst_tangent, only: take_out_flow, n_changes
  implicit none
  private

  public :: recurrence_t

  !> The load turns back where it leaves an extremum by more than this share of F_0, as for the cycles of a summary. Convention.
  real(wp), parameter :: threshold = 0.01_wp
  !> A period that is wrong by a larger share is not corrected, but that of the last two peaks. Convention; twice: no change.
  real(wp), parameter :: correctable = 0.1_wp
  !> If differences shrink so slowly that more periods are missing, half of them are left out. Convention.
  real(wp), parameter :: few = 4.0_wp
  !> Differences that do not shrink are taken for such that shrink by this factor. Convention; half as far from 1: no change.
  real(wp), parameter :: slowest = 0.99_wp

  !> What is known of the motion since its last rest. Plain data.
  type :: recurrence_t
    !> Whether the motion is looked at; its period [s], 0 as long as it is not known; and the motion at the last look.
    logical :: is_watched = .false.
    real(wp), private :: period = 0.0_wp
    !> The number of slow cycles in a period.
    integer :: in_period = 1
    type(state_t) :: last = state_t()
    !> How far two looks were apart across the flow, as dst_tangent measures it.
    real(wp), private :: apart = huge(1.0_wp)
    !> Whether the load rises; its highest value since it began to, or its lowest since it began to fall [N], and when [s].
    logical, private :: rises = .true.
    real(wp), private :: extreme = -huge(1.0_wp), extreme_at = 0.0_wp
    !> When the last peaks were [s], at places modulo their number; the number of peaks, and that with which the motion is watched
    !> again; whether there was a peak after the last look.
    real(wp), private :: peaked_at(0:most_repeats) = 0.0_wp
    integer, private :: peaks = 0, watched_from = 2
    logical, private :: has_peaked = .false.
  contains
    procedure :: see
    procedure :: next_look
    procedure :: look
  end type recurrence_t

contains

  !> Continue with a piece in slip under a steady drive; with the second peak the first look is taken.
  pure subroutine see(self, piece, slider)
    class(recurrence_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    type(slider_t), intent(in) :: slider
    real(wp) :: load

    load = slider%stiffness(1)*piece%to%u(1)*sign(1.0_wp, piece%drive%velocity*slider%along(1))
    if (merge(load > self%extreme, load < self%extreme, self%rises)) then
      self%extreme = load
      self%extreme_at = piece%to%time
      return
    end if
    if (abs(load - self%extreme) <= threshold*slider%law%kinetic_limit) return
    if (self%rises) then
      self%has_peaked = .true.
      self%peaks = self%peaks + 1
      self%peaked_at(modulo(self%peaks, size(self%peaked_at))) = self%extreme_at
      if (self%peaks == self%watched_from) then
        if (.not. self%period > 0.0_wp) self%period = peaks_apart(self)
        call take_look(self, piece%to)
      end if
    end if
    self%rises = .not. self%rises
    self%extreme = load
    self%extreme_at = piece%to%time
  end subroutine see

  !> The time between as many peaks as there are in a period [s].
  pure real(wp) function peaks_apart(self)
    class(recurrence_t), intent(in) :: self

    associate (n => size(self%peaked_at))
      peaks_apart = self%peaked_at(modulo(self%peaks, n)) - self%peaked_at(modulo(self%peaks - self%in_period, n))
    end associate
  end function peaks_apart

  !> When to look again [s].
  pure real(wp) function next_look(self)
    class(recurrence_t), intent(in) :: self
    type(state_t) :: then

    next_look = huge(1.0_wp)
    if (.not. self%is_watched) return
    call then%later(self%last, self%period)
    next_look = then%time
  end function next_look

  !> Look at the motion at the end of a piece, a period after the last look: whether it repeats, if differences across the flow of
  !> this size are `allowed`, and the period differs by no more than this share; and by how much the period is shorter [s].
  pure subroutine look(self, piece, slider, allowed, repeats, shorter)
    class(recurrence_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: allowed
    logical, intent(out) :: repeats
    real(wp), intent(out) :: shorter
    real(wp) :: difference(n_changes), before, shrinks, missing
    logical :: flows

    difference = [piece%to%u - self%last%u, piece%to%y - self%last%y]
    before = self%apart
    call take_out_flow(difference, piece, slider, shorter, self%apart, flows)
    ! All that follows shrinks as much.
    shrinks = 1.0_wp
    if (self%apart < before) shrinks = self%apart/before
    if (.not. self%apart > 0.0_wp) shrinks = 0.0_wp
    repeats = self%has_peaked .and. before < huge(1.0_wp) .and. shrinks < 1.0_wp .and. abs(shorter) <= allowed*self%period
    if (repeats) repeats = self%apart*max(1.0_wp, shrinks/(1.0_wp - shrinks)) <= allowed
    missing = 0.0_wp
    if (before < huge(1.0_wp) .and. self%apart > 0.0_wp) missing = log(allowed/self%apart)/log(min(shrinks, slowest))
    self%period = merge(peaks_apart(self), self%period - shorter, abs(shorter) > correctable*self%period)
    if (self%has_peaked .and. missing <= few) then
      call take_look(self, piece%to)
    else
      self%is_watched = .false.
      self%apart = huge(1.0_wp)
      self%watched_from = self%peaks + max(1, min(self%peaks, int(0.5_wp*missing)))
      if (shrinks < slowest) return
      self%in_period = 1 + modulo(self%in_period, most_repeats)
      self%period = 0.0_wp
      if (self%in_period > 1) self%watched_from = max(self%peaks, self%in_period) + 1
    end if
  end subroutine look

  !> Look at the motion.
  pure subroutine take_look(self, here)
    class(recurrence_t), intent(inout) :: self
    type(state_t), intent(in) :: here

    self%last = here
    self%is_watched = .true.
    self%has_peaked = .false.
  end subroutine take_look
end module dst_recurrence
