!> A summary with a load cell, of pieces and of the leaps of a cycle map, these passage by passage.
!>
!> What the summary wants to know of a passage is a function of its release, which is interpolated: from the passages of a table of
!> the map, or, if it has the motion inside, in parts of it that are halved until that is accurate. Where it is not smooth, and for
!> passages that were recorded, the motion inside is followed piece by piece. Of repetitions one is summarised as if it were a run.
module dst_passage_summary
  use dst_branch, only: most_parts
  use dst_chebyshev, only: chebyshev_points
  use dst_cycle_map, only: cycle_map_t
  use dst_cycles, only: extremum_t
  use dst_kinds, only: wp, int64
  use dst_load_cell, only: load_cell_t
  use dst_motion, only: motion_t
  use dst_observation, only: observation_t, observations_t, new_observations, observe, creep_time, largest_rate, pull, first_turn
  use dst_passage, only: passage_t, duration, slip_duration, exchanged
  use dst_piece, only: piece_t, stick_begins
  use dst_piece_view, only: piece_view_t
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  use dst_stretch, only: moment_t
  use dst_summary, only: summary_t, contribution_t
  implicit none
  private

  public :: piece_summary_t, begin_at_release

  !> Points of a part of a table, and between them, at which it is tested, once as many laps in it have been followed. Conventions;
  !> twice as many: measures by 1e-10.
  integer, parameter :: nodes = 9
  real(wp), parameter :: test_at(2) = [-0.94_wp, 0.18_wp]

  !> The last lap is followed if the largest rate of the run might be its own, unless that is known to this relative error.
  !> Convention; ten times: one of 80 random scenes is wrong by 1.6e-6.
  real(wp), parameter :: known_rate = 1.0e-7_wp

  !> The results of a motion so far, with what a load cell shows.
  type, extends(summary_t) :: piece_summary_t
    type(load_cell_t) :: load_cell
  contains
    procedure :: take_piece
    procedure :: take_leap
  end type piece_summary_t

contains

  !> Add a piece of a motion.
  subroutine take_piece(self, motion, piece)
    class(piece_summary_t), intent(inout) :: self
    class(motion_t), intent(in), target :: motion
    type(piece_t), intent(in), target :: piece
    type(piece_view_t) :: view
    integer(int64) :: before

    call view%show(motion, piece)
    if (piece%event == stick_begins) self%sticks = self%sticks + 1
    before = self%cycles%count
    call self%take_in(view)
    call self%load_cell%take_in(view)
    if (self%cycles%count > before) call self%load_cell%begin_cycle()
  end subroutine take_piece

  !> Add the last piece, a leap.
  subroutine take_leap(self, map)
    class(piece_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map

    if (map%repetitions > 0) then
      call take_repetitions(self, map)
    else
      call follow_passages(map, 0_int64, map%piece%from, self)
    end if
  end subroutine take_leap

  !> One of them is summarised, the others are like it.
  subroutine take_repetitions(self, map)
    class(piece_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map
    type(piece_summary_t) :: block
    type(state_t) :: begin
    integer(int64) :: done, times
    real(wp) :: lasting

    call begin_at_release(map%slider, map%piece%drive%velocity, map%piece%from%u, block)
    call follow_passages(map, 0_int64, state_t(u=map%piece%from%u), block)
    lasting = map%block_duration()
    block%length = lasting
    done = 0
    do while (done < map%repetitions)
      begin = map%piece%from
      call begin%later(map%piece%from, real(done, wp)*lasting)
      begin%position = map%piece%from%position + real(done, wp)*(map%piece%to%position - map%piece%from%position) &
        /real(map%repetitions, wp)
      ! Those up to the one in which the second half begins, this one, and the others.
      times = map%repetitions - done
      if (self%half > begin%time) times = min(times, int(min((self%half - begin%time)/lasting, 1.0e15_wp), int64))
      if (times > 0) then
        call self%add(block, block%cycles%turns(:block%cycles%turn_count), begin%time, begin%position, times, &
          (map%piece%to%position - map%piece%from%position)/real(map%repetitions, wp))
        if (begin%time >= self%load_cell%from) call self%load_cell%see_again(block%load_cell, begin%time, times, lasting)
      else
        times = 1
        call follow_passages(map, done, begin, self)
      end if
      done = done + times
    end do
  end subroutine take_repetitions

  !> A summary that begins at a release, with this elongation [m], and keeps all turns.
  subroutine begin_at_release(slider, velocity, u, summary)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, u(2)     !! V, m/s
    type(piece_summary_t), intent(out) :: summary

    associate (along => slider%along(1)*slider%free(1))
      call summary%cycles%begin(along, slider%law%kinetic_limit, slider%stiffness(1), slider%mass)
      summary%cycles%keeps_turns = .true.
      call summary%begin(moment_t(force=slider%stiffness(1)*u(1), elongation_rate=velocity*along, &
        drive_velocity=velocity), 0.0_wp, 0.0_wp)
    end associate
    call summary%load_cell%begin(velocity, 0.0_wp, .false.)
    summary%load_cell%keeps_forces = .true.
  end subroutine begin_at_release

  !> The passages of a repetition of a leap that begins with this state.
  subroutine follow_passages(map, repetition, begin, summary)
    class(cycle_map_t), intent(inout), target :: map
    integer(int64), intent(in) :: repetition
    type(state_t), intent(in) :: begin
    class(piece_summary_t), intent(inout) :: summary
    type(contribution_t) :: part
    type(extremum_t), allocatable :: turns(:)
    type(passage_t) :: passage
    type(observation_t) :: seen
    type(state_t) :: here
    type(piece_t), target :: piece
    real(wp) :: elapsed, u(2, 2)
    logical :: is_known
    integer :: k, i

    here = begin
    u(:, 2) = begin%u
    do k = 1, map%passages()
      call map%passage_number(k, passage, elapsed)
      call here%later(begin, elapsed)
      ! Each begins where the one before ended.
      u(:, 1) = u(:, 2)
      u(:, 2) = map%piece%to%u
      if (map%repetitions > 0) u(:, 2) = map%elongation(passage%to)
      here%u = u(:, 1)
      here%position = map%moved(begin%position, map%piece%drive%velocity*elapsed, here%u - begin%u)
      is_known = .false.
      associate (load_cell => summary%load_cell, side => sign(1.0_wp, map%piece%drive%velocity))
        if (passage%table(1) > 0 .and. (here%time >= summary%half .or. here%time + passage%measure(duration) < summary%half)) &
          call look_up(map, passage, here%time, u, summary, seen, part, turns, is_known)
        if (is_known .and. here%time >= load_cell%from .and. .not. seen%pull_is_exact) is_known = &
          .not. load_cell%may_hang_on(side*(seen%value([pull, pull + 2]) + [seen%pull_error, -seen%pull_error]), seen%ripple)
        ! How long an object has crept by a turn of the load is known where it is followed.
        if (is_known .and. summary%may_settle()) is_known = size(turns) == 1
        if (is_known) then
          call summary%add(part, turns, here%time, here%position, 1_int64, 0.0_wp)
          if (here%time < load_cell%from) cycle
          call load_cell%see(side*seen%value(pull), here%time + seen%value(pull + 1))
          call load_cell%see(side*seen%value(pull + 2), here%time + seen%value(pull + 3))
          call load_cell%see(dot_product(map%slider%force_at_rest(u(:, 2), map%piece%drive%velocity), map%slider%along), &
            here%time + passage%measure(duration))
        else
          call map%show_passage(repetition, k)
          do i = 1, map%shown%count
            call map%shown%get(i, here, piece)
            call summary%take_piece(map%steps, piece)
          end do
          summary%exchanged = summary%exchanged + passage%measure(exchanged)
        end if
      end associate
    end do
  end subroutine follow_passages

  !> What a passage adds to a summary, from observations, if they are smooth there.
  subroutine look_up(map, passage, time, u, summary, seen, part, turns, is_known)
    class(cycle_map_t), intent(inout), target :: map
    type(passage_t), intent(in) :: passage
    real(wp), intent(in) :: time, u(2, 2)        !! when it begins, s, and u at its ends, m
    class(summary_t), intent(in) :: summary      !! of what was before
    type(observation_t), intent(out) :: seen
    type(contribution_t), intent(out) :: part
    type(extremum_t), allocatable, intent(out) :: turns(:)
    logical, intent(out) :: is_known
    real(wp) :: x
    integer :: i

    associate (branch => map%maps(map%orbit%current)%branch(passage%table(1)), place => passage%table(2))
      x = branch%x_of(place, passage%from)
      is_known = .false.
      associate (whole => branch%table(place)%seen)
        if (branch%table(place)%panels > 0 .and. .not. (whole%are_smooth .and. whole%creep_is_smooth)) &
          call look_up_part(map, place, x, passage, seen, is_known)
        if (.not. is_known) call whole%tell(x, passage, map%piece%drive%velocity, seen, is_known)
      end associate
    end associate
    is_known = is_known .and. (summary%has_slipped .or. .not. seen%begins_to_slip)
    ! Rates grow from lap to lap: that of the last one has to be known.
    if (summary%half > 0.0_wp .and. time + 2.0_wp*passage%measure(duration) > 2.0_wp*summary%half) &
      is_known = is_known .and. (seen%value(largest_rate) + seen%rate_error < summary%largest_rate &
      .or. seen%rate_error < known_rate*seen%value(largest_rate))
    if (.not. is_known) return
    associate (lasting => passage%measure(duration), turn => seen%value(first_turn:))
      part%sticks = 1
      part%sticking_time = lasting - passage%measure(slip_duration)
      part%exchanged = passage%measure(exchanged)
      part%largest_rate = seen%value(largest_rate)
      part%length = lasting
      part%creep_time = min(lasting, max(part%sticking_time, seen%value(creep_time)))
      turns = [(extremum_t(turn(3*i - 2), turn(3*i - 1), turn(3*i)), i=1, seen%turns), &
        extremum_t(map%slider%stiffness(1)*u(1, 2), lasting, &
        map%moved(0.0_wp, map%piece%drive%velocity*lasting, u(:, 2) - u(:, 1)))]
    end associate
  end subroutine look_up

  !> A lap at `x` of a table from the smallest part that is smooth.
  subroutine look_up_part(map, place, x, passage, seen, is_known)
    class(cycle_map_t), intent(inout), target :: map
    integer, intent(in) :: place
    real(wp), intent(in) :: x
    type(passage_t), intent(in) :: passage
    type(observation_t), intent(out) :: seen
    logical, intent(out) :: is_known
    type(observations_t) :: observed
    real(wp) :: position
    integer :: i

    associate (branch => map%maps(map%orbit%current)%branch(1))
      if (.not. allocated(branch%table(place)%part)) allocate (branch%table(place)%part(most_parts))
      ! From -1 to 1 in each part.
      position = x
      i = 1
      is_known = .false.
      do while (i <= most_parts)
        associate (part => branch%table(place)%part(i), visits => branch%intervals(place)%visits_of_part(i))
          if (.not. part%is_there()) then
            visits = visits + 1
            if (visits <= nodes + size(test_at)) return
            call try_part(map, place, i, observed)
            part = observed
          end if
          call part%tell(position, passage, map%piece%drive%velocity, seen, is_known)
          if (is_known) exit
        end associate
        i = 2*i + merge(0, 1, position <= 0.0_wp)
        position = 2.0_wp*position + merge(1.0_wp, -1.0_wp, position <= 0.0_wp)
      end do
    end associate
  end subroutine look_up_part

  !> Observe laps in a part of a table.
  subroutine try_part(map, place, number, observed)
    class(cycle_map_t), intent(inout), target :: map
    integer, intent(in) :: place, number
    type(observations_t), intent(out) :: observed
    type(recording_t) :: recording
    real(wp) :: points(nodes)
    integer :: i

    points = chebyshev_points(nodes)
    call new_observations(nodes, observed)
    do i = 1, nodes
      call observed%take(i, lap_at(points(i)), i == 1)
    end do
    call observed%settle(map%rtol, map%slider%law%static_limit/map%slider%stiffness(1))
    do i = 1, size(test_at)
      if (observed%are_smooth) call observed%test(test_at(i), lap_at(test_at(i)))
    end do

  contains

    !> The lap at a position in [-1, 1] of the part.
    type(observation_t) function lap_at(position) result(seen)
      real(wp), intent(in) :: position
      type(passage_t) :: passage
      real(wp) :: x
      logical :: found
      integer :: i

      x = position
      i = number
      do while (i > 1)
        x = 0.5_wp*(x + merge(-1.0_wp, 1.0_wp, modulo(i, 2) == 0))
        i = i/2
      end do
      associate (here => map%maps(map%orbit%current))
        call here%look_up(here%branch(1)%angle(place, x), passage, found)
        call here%describe(passage, recording, found)
        call observe(here%steps, recording, seen)
      end associate
    end function lap_at
  end subroutine try_part
end module dst_passage_summary
