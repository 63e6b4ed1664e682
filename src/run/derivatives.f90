!> Derivatives of a run with respect to parameters: of its samples and of the times of its events.
!>
!> The motion is run step by step, and the tangents of its parameters with it (dst_tangent). At a fixed time the state changes by what
!> it changes by as seen from a clock that changes, minus the rate times the change of the clock; the columns follow from the state
!> and from the rig.
module dst_derivatives
  use dst_columns, only: columns, row_of
  use dst_deck_values, only: deck_t
  use dst_errors, only: error_t, raise, deck_error, too_many_steps
  use dst_kinds, only: wp, pi
  use dst_interpolation, only: max_degree
  use dst_output_size, only: sample_count
  use dst_piece, only: no_event, slip_begins, slips
  use dst_sampling, only: settle_interval
  use dst_scene, only: scene_t
  use dst_schema, only: longest_text
  use dst_slip_system, only: max_components
  use dst_state, only: state_t
  use dst_stepper, only: work_count_t
  use dst_stepping, only: stepping_t
  use dst_tangent, only: tangent_t, trail_t, directions_t, rate_in, n_changes
  use dst_text, only: integer_text
  use dst_variation, only: steps_of, vary
  use dst_writer, only: event_t
  implicit none
  private

  public :: derivatives_t, find_derivatives

  !> Columns are differences over changes of the state of this size, relative to what is large for it: linear but for zeta and for
  !> friction. Ten times, a tenth: no change to 1e-9.
  real(wp), parameter :: small = 1.0e-5_wp
  !> Slip slower than this share of a slow speed has no size of its own.
  real(wp), parameter :: slow = 1.0e-9_wp

  !> Columns at instants, times of events, and their derivatives.
  type :: derivatives_t
    character(longest_text), allocatable :: key(:)
    real(wp), allocatable :: parameter(:)                    !! values of the keys
    real(wp), allocatable :: time(:)                         !! of the samples, s
    real(wp), allocatable :: value(:, :)                     !! (column, sample)
    real(wp), allocatable :: change(:, :, :)                 !! per change of a parameter: (column, parameter, sample)
    type(event_t), allocatable :: event(:)                   !! valid up to `events`
    integer :: events = 0
    real(wp), allocatable :: shift(:, :)                     !! of the time of an event per change of a parameter: (parameter, event)
  end type derivatives_t

contains

  !> The derivatives of the run of a deck's scene with respect to the keys GROUP.KEY in a list, at these times [s], or at those of its
  !> samples if none are given.
  subroutine find_derivatives(deck, scene, keys, times, derivatives, error)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: keys         !! separated by blanks
    real(wp), intent(in) :: times(:)         !! rising
    type(derivatives_t), intent(out) :: derivatives
    type(error_t), allocatable, intent(out) :: error
    class(stepping_t), allocatable :: steps
    type(directions_t) :: directions
    type(tangent_t), allocatable :: tangents(:)
    type(trail_t), allocatable :: trail(:)
    type(work_count_t) :: work
    logical :: found
    integer :: segment, sampled, k

    call steps_of(scene, steps, error)
    if (.not. allocated(error)) call vary(deck, scene, keys, derivatives%key, derivatives%parameter, directions%variation, error)
    if (.not. allocated(error)) call place_samples(scene, times, derivatives, error)
    if (allocated(error)) return
    allocate (tangents(size(derivatives%key)), trail(size(derivatives%key)))
    do k = 1, size(tangents)
      associate (more => directions%variation(k)%more%piece%to, less => directions%variation(k)%less%piece%to)
        tangents(k)%u = (more%u - less%u)/directions%variation(k)%apart
        tangents(k)%y = (more%y - less%y)/directions%variation(k)%apart
        tangents(k)%is_polar = steps%system%is_polar
      end associate
    end do
    if (steps%piece%event /= no_event) call add_event(derivatives, event_t(0.0_wp, steps%piece%event), tangents%clock)
    segment = steps%segment
    sampled = 0
    do while (.not. steps%finished() .and. sampled < size(derivatives%time))
      call steps%advance(error)
      work = steps%work()
      if (.not. allocated(error) .and. scene%max_steps > 0 .and. work%steps >= scene%max_steps) call raise(error, too_many_steps, &
        'integrator.max_steps = '//integer_text(scene%max_steps)//' reached: raise it, or use a larger rtol')
      if (allocated(error)) return
      if (steps%segment /= segment) then
        segment = steps%segment
        do k = 1, size(tangents)
          associate (more => directions%variation(k)%more, less => directions%variation(k)%less)
            more%piece%drive = more%drive%segment(segment)
            less%piece%drive = less%drive%segment(segment)
          end associate
        end do
      end if
      ! What is not held by then does not wait for a limit.
      if (steps%piece%contact == slips .and. steps%piece%from%time <= steps%piece%drive%start) then
        tangents%rests = .false.
        tangents%delay = 0.0_wp
      end if
      if (derivatives%time(sampled + 1) <= steps%piece%to%time) then
        call directions%follow(tangents, steps%piece, steps%system, steps%slider, found, trail)
      else
        call directions%follow(tangents, steps%piece, steps%system, steps%slider, found)
      end if
      if (found) call note_event(steps, directions, tangents, derivatives, found)
      if (.not. found) then
        call raise(error, deck_error, 'the motion hangs on a release that just happens, and has no derivative after it')
        return
      end if
      do while (sampled < size(derivatives%time))
        if (derivatives%time(sampled + 1) > steps%piece%to%time) exit
        sampled = sampled + 1
        call look(steps, directions, trail, derivatives%time(sampled), derivatives%value(:, sampled), &
          derivatives%change(:, :, sampled))
      end do
    end do
  end subroutine find_derivatives

  !> When to sample: at these times [s], or as a run does.
  subroutine place_samples(scene, times, derivatives, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: times(:)
    type(derivatives_t), intent(inout) :: derivatives
    type(error_t), allocatable, intent(inout) :: error
    type(scene_t) :: settled
    integer :: i

    derivatives%time = times
    if (any(times > scene%t_end)) then
      call raise(error, deck_error, 'scene.t_end: the run ends before the last of the times: raise it', 'scene.t_end')
      return
    else if (size(times) == 0) then
      settled = scene
      call settle_interval(settled)
      if (.not. settled%interval > 0.0_wp) then
        call raise(error, deck_error, 'output.interval: derivatives are at given times: give an interval > 0', 'output.interval')
        return
      end if
      associate (n => int(sample_count(scene%t_end, settled%interval)))
        derivatives%time = [(min(scene%t_end, real(i, wp)*settled%interval), i=0, n - 1)]
      end associate
    end if
    associate (n => size(derivatives%time))
      allocate (derivatives%value(size(columns), n), derivatives%change(size(columns), size(derivatives%key), n))
      allocate (derivatives%event(64), derivatives%shift(size(derivatives%key), 64))
    end associate
  end subroutine place_samples

  !> The event at the end of the last piece.
  subroutine note_event(steps, directions, tangents, derivatives, found)
    class(stepping_t), intent(in) :: steps
    type(directions_t), intent(in) :: directions
    type(tangent_t), intent(in) :: tangents(:)
    type(derivatives_t), intent(inout) :: derivatives
    logical, intent(out) :: found
    type(tangent_t) :: there
    real(wp) :: shift(size(tangents))
    integer :: k

    found = .true.
    associate (piece => steps%piece)
      if (piece%event == no_event) return
      ! A rest that lasts longer than a touch is known at a given time.
      shift = 0.0_wp
      if (piece%contact == slips) shift = tangents%clock + tangents%delay
      do k = 1, size(tangents)
        if (piece%event /= slip_begins .or. .not. found) cycle
        there = tangents(k)
        call there%set_off(piece%to, piece%drive, steps%slider, directions%variation(k), found)
        shift(k) = there%clock
      end do
      call add_event(derivatives, event_t(piece%to%time, piece%event), shift)
    end associate
  end subroutine note_event

  subroutine add_event(derivatives, event, shift)
    type(derivatives_t), intent(inout) :: derivatives
    type(event_t), intent(in) :: event
    real(wp), intent(in) :: shift(:)

    associate (n => derivatives%events)
      n = n + 1
      if (n > size(derivatives%event)) then
        derivatives%event = [derivatives%event, derivatives%event]
        derivatives%shift = reshape([derivatives%shift, derivatives%shift], [size(shift), size(derivatives%event)])
      end if
      derivatives%event(n) = event
      derivatives%shift(:, n) = shift
    end associate
  end subroutine add_event

  !> All columns at a time [s] of the last piece, and their derivatives.
  subroutine look(steps, directions, trail, time, value, change)
    class(stepping_t), intent(in) :: steps
    type(directions_t), intent(in) :: directions
    type(trail_t), intent(in) :: trail(:)
    real(wp), intent(in) :: time
    real(wp), intent(out) :: value(:), change(:, :)
    type(state_t) :: state
    real(wp) :: rate(n_changes), direction(n_changes), basis(0:max_degree), tau, elapsed
    integer :: i, k

    associate (piece => steps%piece)
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
      value = row_by(steps, state, piece%contact)
      do k = 1, size(trail)
        associate (variation => directions%variation(k), one => trail(k))
          if (piece%contact == slips) then
            associate (s => piece%path%grid%degree)
              direction = matmul(basis(0:s), one%inside(0:s, :))
            end associate
          else
            direction = 0.0_wp
            direction(:max_components) = one%inside(0, :max_components) + variation%drift(piece%from%time, elapsed, one%clock)
          end if
          direction = direction - one%clock*rate
          change(:, k) = difference(row_by(variation%more, state, piece%contact), &
            row_by(variation%less, state, piece%contact), variation%apart)
          do i = 1, n_changes, max_components
            call add_direction(i, min(n_changes, i + max_components - 1), change(:, k))
          end do
        end associate
      end do
    end associate

  contains

    !> Add what some of the unknowns do.
    subroutine add_direction(first, last, changes)
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: changes(:)
      real(wp) :: ends(n_changes), scale(n_changes), by
      type(state_t) :: more, less

      associate (slider => steps%slider)
        scale(:max_components) = max(abs(state%u), slider%law%static_limit/slider%stiffness)
        scale(max_components + 1:) = max(abs(state%y), slow*minval(scale(:max_components)*sqrt(slider%stiffness/slider%mass)))
        if (steps%system%is_polar) scale(max_components + 2) = 1.0_wp
      end associate
      ends = 0.0_wp
      ends(first:last) = direction(first:last)
      if (.not. any(abs(ends) > 0.0_wp)) return
      by = small/maxval(abs(ends)/max(scale, tiny(1.0_wp)))
      more = moved(by*ends)
      less = moved(-by*ends)
      changes = changes + difference(row_by(steps, more, steps%piece%contact), &
        row_by(steps, less, steps%piece%contact), 2.0_wp*by)
    end subroutine add_direction

    pure type(state_t) function moved(by)
      real(wp), intent(in) :: by(n_changes)

      moved = state
      moved%u = state%u + by(:max_components)
      moved%y = state%y + by(max_components + 1:)
    end function moved
  end subroutine look

  !> All columns of a rig in a state of the motion. Its position X is how far the drive has come, less the elongation.
  function row_by(rig, state, contact) result(row)
    class(stepping_t), intent(in) :: rig
    type(state_t), intent(in) :: state
    integer, intent(in) :: contact
    real(wp) :: row(size(columns))
    type(state_t) :: there
    integer :: i

    there = state
    there%position = rig%drive%distance(state%time) - dot_product(state%u, rig%slider%along)
    call row_of(rig%slider, rig%instant_of(there, contact), [(i, i=1, size(columns))], row)
  end function row_by

  !> The difference quotient of two rows; angles have no whole turns.
  pure function difference(more, less, apart) result(slope)
    real(wp), intent(in) :: more(:), less(:), apart
    real(wp) :: slope(size(more)), whole(size(more))

    whole = 0.0_wp
    where (columns%units == 'rad') whole = 2.0_wp*pi
    where (columns%units == 'deg') whole = 360.0_wp
    slope = more - less
    where (whole > 0.0_wp) slope = slope - whole*anint(slope/whole)
    slope = slope/apart
  end function difference
end module dst_derivatives
