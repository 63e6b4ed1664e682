!> What a summary wants to know of a passage of the release map, as a few numbers that are functions of its release, and as
!> polynomials where these are smooth.
module dst_observation
  use dst_chebyshev, only: chebyshev_polynomials, chebyshev_coefficients
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, duration
  use dst_piece, only: piece_t
  use dst_piece_view, only: piece_view_t
  use dst_recording, only: recording_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t
  use dst_stretch, only: moment_t, nowhere, tiny_rate, most_places => most_turns
  implicit none
  private

  public :: observation_t, observations_t, new_observations, observe, creep_time, largest_rate, pull, first_turn

  !> The numbers: the time at rest or in creep [s], the largest |X'| [m/s], the pull force [N], positive if the drive pulls, at its
  !> peak and at the valley that follows, with their times [s], and load [N], time [s] and X [m] at the points at which the load
  !> turns back. A passage with more of them is none of several that are alike. Convention; twice the turns: no change.
  integer, parameter :: creep_time = 1, largest_rate = 2, pull = 3, first_turn = 7, most_turns = 5
  integer, parameter :: observed = first_turn - 1 + 3*most_turns
  !> Permitted error of an interpolated number, relative to the largest one: this share of rtol, but no less than the second; and
  !> that of X relative to the elongation of the spring, from which it is found. Conventions; a tenth: no change of Fig. 3.
  real(wp), parameter :: share = 0.1_wp, smooth = 1.0e-8_wp, smooth_rate = 1.0e-7_wp, roundoff = 10.0_wp*epsilon(1.0_wp)
  !> Permitted relative error of the times of the pull force, of which only a frequency is made. Convention; twice: no change.
  real(wp), parameter :: rough = 1.0e-3_wp
  !> Most values of it that are compared.
  integer, parameter :: most_pulls = 512
  !> A pull force turns back otherwise if it does so by more than this share of its size. Convention; twice: no change.
  real(wp), parameter :: flat = 1.0e-7_wp
  !> Error of a pull force that is not smooth, over the largest one that was seen. Convention; twice: no change.
  real(wp), parameter :: doubtful = 10.0_wp

  !> A passage as it is seen from outside. Times and X count from its beginning.
  type :: observation_t
    real(wp) :: value(observed) = 0.0_wp
    integer :: turns = 0
    !> Whether all of it is creep or rest, and whether the load exceeds F(v) in it.
    logical :: is_creep = .true., begins_to_slip = .false.
    !> Error of the largest rate [m/s]; whether the pull force is as exact as the other numbers; if not, its error, and by how much
    !> it turns back otherwise [N], huge if its extremes are elsewhere.
    real(wp) :: rate_error = 0.0_wp
    logical :: pull_is_exact = .true.
    real(wp) :: pull_error = 0.0_wp, ripple = 0.0_wp
  end type observation_t

  !> Passages at Chebyshev points of a variable x in [-1, 1], as polynomials in it.
  type :: observations_t
    !> Whether they are smooth, so far as is known: all but the time in creep and the pull force; and the former, which has a kink
    !> where creep ends. (The latter has one where another of its peaks becomes the highest.)
    logical :: are_smooth = .true., creep_is_smooth = .true.
    !> One of them; the coefficients (number, point) in Chebyshev polynomials, and the permitted errors.
    type(observation_t), private :: like
    real(wp), allocatable, private :: coefficient(:, :)
    real(wp), private :: permitted(observed) = 0.0_wp
  contains
    procedure :: take
    procedure :: settle
    procedure :: test
    procedure :: is_there
    procedure :: at
    procedure :: tell
  end type observations_t

contains

  !> Room for passages at so many points.
  pure subroutine new_observations(points, observations)
    integer, intent(in) :: points
    type(observations_t), intent(out) :: observations

    allocate (observations%coefficient(observed, points))
  end subroutine new_observations

  !> Whether there are any.
  pure logical function is_there(self)
    class(observations_t), intent(in) :: self

    is_there = allocated(self%coefficient)
  end function is_there

  !> Add the passage at point `j`; the first one is any.
  pure subroutine take(self, j, seen, is_first)
    class(observations_t), intent(inout) :: self
    integer, intent(in) :: j
    type(observation_t), intent(in) :: seen
    logical, intent(in) :: is_first

    if (is_first) self%like = seen
    self%like%begins_to_slip = self%like%begins_to_slip .or. seen%begins_to_slip
    call compare(self, seen)
    self%coefficient(:, j) = seen%value
  end subroutine take

  !> Whether a passage may belong to the same smooth functions.
  pure subroutine compare(self, seen)
    class(observations_t), intent(inout) :: self
    type(observation_t), intent(in) :: seen

    self%are_smooth = self%are_smooth .and. seen%turns == self%like%turns .and. seen%turns <= most_turns
    self%creep_is_smooth = self%creep_is_smooth .and. (seen%is_creep .eqv. self%like%is_creep)
    self%like%ripple = max(self%like%ripple, seen%ripple)
  end subroutine compare

  !> Convert them to polynomials, at a tolerance; X is found from elongations up to `length` [m].
  pure subroutine settle(self, rtol, length)
    class(observations_t), intent(inout) :: self
    real(wp), intent(in) :: rtol, length

    associate (largest => maxval(abs(self%coefficient), dim=2))
      self%permitted = max(share*rtol, smooth)*largest
      self%permitted(largest_rate) = max(share*rtol, smooth_rate)*largest(largest_rate)
      self%like%rate_error = self%permitted(largest_rate)
      self%permitted(first_turn + 2::3) = self%permitted(first_turn + 2::3) + roundoff*length
      self%permitted(pull + 1:pull + 3:2) = rough*maxval(largest(pull + 1:pull + 3:2))
      self%like%pull_is_exact = self%like%ripple <= flat*maxval(largest(pull:pull + 2:2))
    end associate
    self%coefficient = transpose(chebyshev_coefficients(transpose(self%coefficient)))
  end subroutine settle

  !> Compare with the passage at `x`.
  pure subroutine test(self, x, seen)
    class(observations_t), intent(inout) :: self
    real(wp), intent(in) :: x
    type(observation_t), intent(in) :: seen
    type(observation_t) :: expected

    expected = self%at(x)
    call compare(self, seen)
    associate (wrong => abs(expected%value - seen%value))
      associate (right => wrong <= self%permitted, like => self%like)
        self%are_smooth = self%are_smooth .and. right(largest_rate) .and. all(right(first_turn:))
        self%creep_is_smooth = self%creep_is_smooth .and. right(creep_time)
        like%pull_is_exact = like%pull_is_exact .and. all(right(pull:pull + 3))
        like%pull_error = max(like%pull_error, doubtful*maxval(wrong(pull:pull + 2:2)))
      end associate
    end associate
  end subroutine test

  !> The passage at `x`.
  pure type(observation_t) function at(self, x)
    class(observations_t), intent(in) :: self
    real(wp), intent(in) :: x
    real(wp) :: polynomial(size(self%coefficient, 2))
    integer :: i

    call chebyshev_polynomials(size(polynomial), x, polynomial)
    at = self%like
    associate (n => first_turn - 1 + 3*min(most_turns, at%turns))
      at%value(:n) = 0.0_wp
      do i = 1, size(polynomial)
        at%value(:n) = at%value(:n) + polynomial(i)*self%coefficient(:n, i)
      end do
    end associate
  end function at

  !> What is seen of a passage at `x` under this drive velocity [m/s], if it is smooth there.
  pure subroutine tell(self, x, passage, velocity, seen, is_known)
    class(observations_t), intent(in) :: self
    real(wp), intent(in) :: x, velocity
    type(passage_t), intent(in) :: passage
    type(observation_t), intent(out) :: seen
    logical, intent(out) :: is_known

    is_known = self%are_smooth
    if (.not. is_known) return
    seen = self%at(x)
    is_known = self%creep_is_smooth
    if (seen%value(largest_rate) + seen%rate_error > tiny_rate*abs(velocity)) return
    ! All of it is creep.
    seen%value(creep_time) = passage%measure(duration)
    is_known = .true.
  end subroutine tell

  !> Observe a passage that was recorded in this motion.
  subroutine observe(motion, recording, seen)
    class(slip_stick_t), intent(in), target :: motion
    type(recording_t), intent(in) :: recording
    type(observation_t), intent(out) :: seen
    type(piece_t), target :: piece
    type(piece_view_t) :: view
    type(moment_t) :: last, turn
    real(wp) :: load(0:max_degree), places(most_places), creep, force(most_pulls), time(most_pulls)
    integer :: degree, count, pulls, i, k

    pulls = 0
    ! The largest rate at an end: inside most pieces there is none that is larger.
    do i = 1, recording%count
      seen%value(largest_rate) = max(seen%value(largest_rate), &
        abs(dot_product(motion%velocity(recording%kept(i)%to), motion%slider%along)))
    end do
    do i = 1, recording%count
      call recording%get(i, state_t(), piece)
      call view%show(motion, piece)
      if (i == 1) then
        last = view%first
        turn = view%first
      end if
      call view%load(degree, load)
      call view%turning_places(motion%closed_form%grid, load(:degree), places, count)
      do k = 1, count
        call pass(view%at(places(k)))
      end do
      call pass(view%last)
      creep = view%creep_time(motion%closed_form%grid, 0.0_wp, 1.0_wp)
      seen%is_creep = seen%is_creep .and. creep >= view%duration()
      seen%value(creep_time) = seen%value(creep_time) + creep
      seen%value(largest_rate) = view%largest_rate(motion%closed_form%grid, seen%value(largest_rate))
      if (.not. seen%begins_to_slip) seen%begins_to_slip = view%slip_begins_at(motion%closed_form%grid, load(:degree)) < nowhere
      call view%pull_polynomial(degree, load)
      call view%pull_turns(degree, load, places, count)
      call keep_pull(0.0_wp)
      do k = 1, count
        call keep_pull(places(k))
      end do
      call keep_pull(1.0_wp)
    end do
    call tell_pull()

  contains

    !> The pull force at a place of the piece.
    subroutine keep_pull(place)
      real(wp), intent(in) :: place

      pulls = pulls + 1
      if (pulls > most_pulls) return
      force(pulls) = view%pull_at(place)
      time(pulls) = view%first%time + place*view%duration()
    end subroutine keep_pull

    !> The pull force rises to a peak, falls to a valley, and rises: those of its largest fall.
    subroutine tell_pull()
      integer :: top, peak, valley

      if (pulls > most_pulls) then
        seen%ripple = huge(1.0_wp)
        return
      end if
      force(:pulls) = sign(1.0_wp, view%last%drive_velocity)*force(:pulls)
      top = 1
      peak = 1
      valley = 1
      do k = 2, pulls
        if (force(k) > force(top)) top = k
        if (force(top) - force(k) <= force(peak) - force(valley)) cycle
        peak = top
        valley = k
      end do
      seen%value(pull:pull + 3) = [force(peak), time(peak), force(valley), time(valley)]
      seen%ripple = max(way_back(force(:peak)), way_back(-force(peak:valley)), way_back(force(valley:pulls)))
      if (maxval(force(:pulls)) > max(force(1), force(peak), force(pulls)) .or. &
        minval(force(:pulls)) < min(force(1), force(valley), force(pulls))) seen%ripple = huge(1.0_wp)
    end subroutine tell_pull

    !> The largest fall of a force that rises.
    pure real(wp) function way_back(force)
      real(wp), intent(in) :: force(:)
      real(wp) :: highest
      integer :: j

      way_back = 0.0_wp
      highest = force(1)
      do j = 2, size(force)
        highest = max(highest, force(j))
        way_back = max(way_back, highest - force(j))
      end do
    end function way_back

    !> The load has come here without turning back; the last such place is a turn, if it turns back now.
    subroutine pass(here)
      type(moment_t), intent(in) :: here

      if ((here%force - last%force)*(last%force - turn%force) < 0.0_wp) then
        turn = last
        seen%turns = seen%turns + 1
        if (seen%turns <= most_turns) seen%value(first_turn + 3*(seen%turns - 1):first_turn + 3*seen%turns - 1) = &
          [turn%force, turn%time, turn%position]
      end if
      last = here
    end subroutine pass
  end subroutine observe
end module dst_observation
