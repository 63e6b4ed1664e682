!> Derivatives of a run with respect to parameters: of its samples and of the times of its events.
!>
!> The motion is run step by step, and the tangents of its parameters with it (dst_tangent). At a fixed time the state changes by
!> what it changes by as seen from a clock that changes, minus the rate times the change of the clock; the columns follow from the
!> state and from the rig.
module dst_derivatives
  use dst_columns, only: columns, row_of
  use dst_deck_values, only: deck_t
  use dst_errors, only: error_t, raise, deck_error, usage_error
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp, int64, pi
  use dst_piece, only: no_event, slip_begins, slips
  use dst_sampling, only: settle_interval, sample_count, sample_time
  use dst_scene, only: scene_t
  use dst_schema, only: longest_text
  use dst_simulation, only: select_columns, check_piece, pieces_between_looks
  use dst_slip_system, only: max_components
  use dst_state, only: state_t
  use dst_stepping, only: stepping_t
  use dst_stopwatch, only: wall_clock
  use dst_tangent, only: tangent_t, trail_t, directions_t, rate_in, n_changes
  use dst_variation, only: steps_of, vary
  use dst_writer, only: writer_t
  implicit none
  private

  public :: derivatives_t

  !> Columns are differences over changes of the state of this size, relative to what is large for it: linear but for zeta, friction
  !> and the direction of smoothed slip. Ten times: u and w change by 3e-9 of what is large for them, friction by 5e-6; a tenth: by
  !> 2e-8, friction by 1e-7.
  real(wp), parameter :: small = 1.0e-5_wp
  !> Slip slower than this share of a slow speed has no size of its own.
  real(wp), parameter :: slow = 1.0e-9_wp

  !> Columns at instants, times of events, and their derivatives; and the run, as far as it is.
  type :: derivatives_t
    character(longest_text), allocatable :: key(:)
    real(wp), allocatable :: parameter(:)                    !! values of the keys
    logical, allocatable, private :: begins(:)               !! whether a key is no part of the rig, but where the run begins
    integer, allocatable :: selected(:)                      !! numbers of the columns
    real(wp), allocatable, private :: whole(:)               !! a whole turn, of a column that is an angle; 0 of another
    !> The columns and then their changes per change of each parameter, one sample after another; and of each event the time, the
    !> kind, and the changes of the time.
    type(writer_t) :: samples, events
    logical :: is_finished = .false.
    real(wp), allocatable, private :: time(:)                !! of the samples, s
    integer, private :: segment = 1
    integer(int64), private :: max_steps = 0
    class(stepping_t), allocatable, private :: steps
    type(directions_t), private :: directions
    type(tangent_t), allocatable, private :: tangents(:)
    type(trail_t), allocatable, private :: trail(:)
  contains
    procedure :: start
    procedure :: proceed
  end type derivatives_t

contains

  !> Begin with the run of a deck's scene and the keys GROUP.KEY in a list: at these times [s], or at those of its samples if none
  !> are given.
  subroutine start(self, deck, scene, keys, times, error)
    class(derivatives_t), intent(inout) :: self
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: keys         !! separated by blanks
    real(wp), intent(in) :: times(:)         !! rising
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    call steps_of(scene, self%steps, error)
    if (.not. allocated(error)) call vary(deck, scene, keys, self%key, self%parameter, self%directions%variation, error)
    if (.not. allocated(error)) call place_samples(scene, times, self%time, error)
    if (.not. allocated(error)) call select_columns(scene, self%steps%slider, self%steps%drive, self%selected, error)
    if (.not. allocated(error) .and. size(self%key) == 0) &
      call raise(error, usage_error, 'no parameter is named: name one as GROUP.KEY, like system.mass')
    if (allocated(error)) return
    self%whole = merge(2.0_wp*pi, merge(360.0_wp, 0.0_wp, columns(self%selected)%units == 'deg'), &
      columns(self%selected)%units == 'rad')
    self%max_steps = scene%max_steps
    self%begins = index(self%key, 'initial.') == 1
    allocate (self%tangents(size(self%key)), self%trail(size(self%key)))
    do k = 1, size(self%key)
      associate (variation => self%directions%variation(k), one => self%tangents(k))
        one%u = (variation%more%piece%to%u - variation%less%piece%to%u)/variation%apart
        one%y = (variation%more%piece%to%y - variation%less%piece%to%y)/variation%apart
        one%is_polar = self%steps%system%is_polar
      end associate
    end do
    if (self%steps%piece%event /= no_event) call add_event(self, self%tangents%clock, error)
    self%segment = self%steps%segment
  end subroutine start

  !> When to sample [s]: at these times, or as a run does.
  subroutine place_samples(scene, times, time, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: times(:)
    real(wp), allocatable, intent(out) :: time(:)
    type(error_t), allocatable, intent(inout) :: error
    type(scene_t) :: settled
    integer(int64) :: i

    time = times
    if (any(times > scene%t_end)) then
      call raise(error, deck_error, 'scene.t_end: the run ends before the last of the times: raise it', 'scene.t_end')
    else if (size(times) == 0) then
      settled = scene
      call settle_interval(settled)
      if (settled%interval > 0.0_wp) then
        time = sample_time(scene%t_end, settled%interval, &
          [(i, i=0_int64, int(sample_count(scene%t_end, settled%interval), int64) - 1_int64)])
      else
        call raise(error, deck_error, 'output.interval: derivatives are at given times: give an interval > 0', 'output.interval')
      end if
    end if
  end subroutine place_samples

  !> Continue for at most `seconds` of wall time [s].
  subroutine proceed(self, seconds, error)
    class(derivatives_t), intent(inout) :: self
    real(wp), intent(in) :: seconds
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: begun
    integer :: i

    begun = wall_clock()
    do
      do i = 1, pieces_between_looks
        self%is_finished = self%steps%finished() .or. self%samples%rows == size(self%time)
        if (self%is_finished) return
        call go_on(self, error)
        if (allocated(error)) return
      end do
      if (wall_clock() - begun >= seconds) return
    end do
  end subroutine proceed

  !> The next piece, with its event and its samples.
  subroutine go_on(self, error)
    class(derivatives_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    logical :: found

    associate (steps => self%steps)
      call steps%advance(error)
      if (.not. allocated(error)) call check_piece(steps, merge(0_int64, self%max_steps, steps%finished()), error)
      if (allocated(error)) return
      if (steps%segment /= self%segment) call enter_segment(self)
      ! What is not held by then does not wait for a limit.
      if (steps%piece%contact == slips .and. steps%piece%from%time <= steps%piece%drive%start) then
        self%tangents%rests = .false.
        self%tangents%delay = 0.0_wp
      end if
      if (self%time(self%samples%rows + 1) <= steps%piece%to%time) then
        call self%directions%follow(self%tangents, steps%piece, steps%system, steps%slider, found, self%trail)
      else
        call self%directions%follow(self%tangents, steps%piece, steps%system, steps%slider, found)
      end if
      if (found) call note_event(self, found, error)
      if (.not. found) &
        call raise(error, usage_error, 'the motion hangs on a release that just happens, and has no derivative after it')
      do while (self%samples%rows < size(self%time) .and. .not. allocated(error))
        if (self%time(self%samples%rows + 1) > steps%piece%to%time) exit
        call self%samples%add_sample(row_at(self, self%time(self%samples%rows + 1)), error)
      end do
    end associate
  end subroutine go_on

  !> The rigs on either side are driven on.
  subroutine enter_segment(self)
    class(derivatives_t), intent(inout) :: self
    integer :: k

    self%segment = self%steps%segment
    do k = 1, size(self%key)
      associate (more => self%directions%variation(k)%more, less => self%directions%variation(k)%less)
        more%piece%drive = more%drive%segment(self%segment)
        less%piece%drive = less%drive%segment(self%segment)
      end associate
    end do
  end subroutine enter_segment

  !> The event at the end of the last piece.
  subroutine note_event(self, found, error)
    class(derivatives_t), intent(inout) :: self
    logical, intent(out) :: found
    type(error_t), allocatable, intent(inout) :: error
    type(tangent_t) :: there
    real(wp) :: shift(size(self%tangents))
    integer :: k

    found = .true.
    associate (piece => self%steps%piece)
      if (piece%event == no_event) return
      ! A rest that lasts longer than a touch is known at a given time.
      shift = 0.0_wp
      if (piece%contact == slips) shift = self%tangents%clock + self%tangents%delay
      do k = 1, size(self%tangents)
        if (piece%event /= slip_begins .or. .not. found) cycle
        there = self%tangents(k)
        call there%set_off(piece%to, piece%drive, self%steps%slider, self%directions%variation(k), found)
        shift(k) = there%clock
      end do
      if (found) call add_event(self, shift, error)
    end associate
  end subroutine note_event

  subroutine add_event(self, shift, error)
    class(derivatives_t), intent(inout) :: self
    real(wp), intent(in) :: shift(:)
    type(error_t), allocatable, intent(inout) :: error

    associate (piece => self%steps%piece)
      call self%events%add_sample([piece%to%time, real(piece%event, wp), shift], error)
    end associate
  end subroutine add_event

  !> The columns at a time [s] of the last piece, and their derivatives.
  function row_at(self, time) result(row)
    class(derivatives_t), intent(in) :: self
    real(wp), intent(in) :: time
    real(wp) :: row(size(self%selected)*(1 + size(self%key)))
    real(wp) :: change(size(self%selected), 0:size(self%key))
    type(state_t) :: state
    real(wp) :: rate(n_changes), direction(n_changes), basis(0:max_degree), tau, elapsed, by_state(size(self%selected), n_changes)
    integer :: k

    associate (steps => self%steps, piece => self%steps%piece)
      state = piece%at(time)
      elapsed = piece%from%until(time)
      tau = 1.0_wp
      if (piece%contact == slips) then
        tau = min(1.0_wp, max(0.0_wp, elapsed/piece%path%step))
        call piece%path%grid%lagrange(tau, basis)
      else
        associate (duration => piece%from%until(piece%to%time) + piece%to%time_rest)
          if (duration > 0.0_wp) tau = min(1.0_wp, elapsed/duration)
        end associate
      end if
      rate = rate_in(piece, tau)
      change(:, 0) = row_by(steps, self%selected, state, piece%contact)
      by_state = slopes_at(self, state)
      do k = 1, size(self%trail)
        associate (variation => self%directions%variation(k), one => self%trail(k))
          if (piece%contact == slips) then
            associate (s => piece%path%grid%degree)
              direction = matmul(basis(0:s), one%inside(0:s, :))
            end associate
          else
            direction = 0.0_wp
            direction(:max_components) = one%inside(0, :max_components) + variation%drift(piece%from%time, elapsed, one%clock)
          end if
          change(:, k) = matmul(by_state, direction - one%clock*rate)
          if (self%begins(k)) cycle
          change(:, k) = change(:, k) + difference(self%whole, row_by(variation%more, self%selected, state, piece%contact), &
            row_by(variation%less, self%selected, state, piece%contact), variation%apart)
        end associate
      end do
    end associate
    row = reshape(change, shape(row))
  end function row_at

  !> Derivatives of the columns with the elongations and the unknowns of slip, in a state of the last piece.
  function slopes_at(self, state) result(slopes)
    class(derivatives_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: slopes(size(self%selected), n_changes)
    real(wp) :: by(n_changes)
    integer :: i

    associate (steps => self%steps, slider => self%steps%slider, u => by(:max_components), y => by(max_components + 1:))
      u = abs(state%u)
      where (slider%stiffness > 0.0_wp) u = max(u, slider%law%static_limit/slider%stiffness)
      y = max(merge(abs(state%y(1)), maxval(abs(state%y)), steps%system%is_polar), &
        slow*minval(u*sqrt(slider%stiffness/slider%mass), mask=slider%stiffness > 0.0_wp))
      if (steps%system%is_polar) y(2) = 1.0_wp
      by = max(small*by, tiny(1.0_wp))
      slopes = 0.0_wp
      do i = 1, max_components + merge(steps%system%unknowns, 0, steps%piece%contact == slips)
        ! The model may have no spring along this axis.
        if (i <= max_components) then
          if (.not. slider%stiffness(i) > 0.0_wp) cycle
        end if
        slopes(:, i) = difference(self%whole, row_by(steps, self%selected, beside(by(i)), steps%piece%contact), &
          row_by(steps, self%selected, beside(-by(i)), steps%piece%contact), 2.0_wp*by(i))
      end do
    end associate

  contains

    !> The state with a little more of one of its numbers.
    type(state_t) function beside(more)
      real(wp), intent(in) :: more

      beside = state
      if (i <= max_components) beside%u(i) = state%u(i) + more
      if (i > max_components) beside%y(i - max_components) = state%y(i - max_components) + more
    end function beside
  end function slopes_at

  !> Columns of a rig in a state of the motion. Its position X is how far the drive has come, less the elongation.
  function row_by(rig, selected, state, contact) result(row)
    class(stepping_t), intent(in) :: rig
    integer, intent(in) :: selected(:)
    type(state_t), intent(in) :: state
    integer, intent(in) :: contact
    real(wp) :: row(size(selected))
    type(state_t) :: there

    there = state
    there%position = rig%drive%distance(state%time) - dot_product(state%u, rig%slider%along)
    call row_of(rig%slider, rig%instant_of(there, contact), selected, row)
  end function row_by

  !> The difference quotient of two rows of which some have whole turns, without these.
  pure function difference(whole, more, less, apart) result(slope)
    real(wp), intent(in) :: whole(:), more(:), less(:), apart
    real(wp) :: slope(size(more))

    slope = more - less
    where (whole > 0.0_wp) slope = slope - whole*anint(slope/whole)
    slope = slope/apart
  end function difference
end module dst_derivatives
