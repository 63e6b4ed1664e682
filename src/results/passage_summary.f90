!> The contribution of the leaps of a cycle map to a summary, passage by passage.
!>
!> What the summary wants to know of a passage is a function of its release. It is interpolated, in parts of a table of the map that are
!> halved until that is accurate; where it is not smooth, and for passages that were recorded, the motion inside is followed piece
!> by piece. For repetitions the contribution of all their passages is found once.
module dst_passage_summary
  use dst_chebyshev, only: chebyshev_points, chebyshev_polynomials, chebyshev_coefficients
  use dst_cycle_map, only: cycle_map_t
  use dst_cycles, only: extremum_t
  use dst_kinds, only: wp, int64
  use dst_passage, only: passage_t, duration, slip_duration, exchanged
  use dst_piece, only: piece_t, stick_begins
  use dst_piece_view, only: piece_view_t
  use dst_state, only: state_t
  use dst_stretch, only: moment_t
  use dst_summary, only: summary_t, contribution_t
  implicit none
  private

  public :: passage_summary_t

  !> The observations of a passage: the time in creep [s], the largest |X'| [m/s], and load [N], time [s] and X [m] at the points at
  !> which the load turns back. Of a passage with more of them there are no observations. Convention.
  integer, parameter :: creep_time = 1, largest_rate = 2, first_turn = 3, most_turns = 5, values = 2 + 3*most_turns
  !> Points of a part, and between them, at which it is tested; halvings of a table. Conventions.
  integer, parameter :: nodes = 9, most_halvings = 6
  real(wp), parameter :: test_at(2) = [-0.94_wp, 0.18_wp]
  !> Permitted error of an observation, relative to the largest one, and that of X relative to the elongation of the spring, from
  !> which it is found. Conventions; a tenth: no change of Fig. 3.
  real(wp), parameter :: smooth = 1.0e-8_wp, roundoff = 10.0_wp*epsilon(1.0_wp)

  !> A part of a table of the map, in its variable x.
  type :: part_t
    real(wp) :: first = -1.0_wp, last = 1.0_wp
    integer :: halvings = 0, half(2) = 0
    logical :: is_tried = .false., is_known = .false., begins_to_slip = .false.
    integer :: turns = 0
    real(wp) :: coefficient(nodes, values) = 0.0_wp
  end type part_t

  !> The observations of a table of the map.
  type :: observations_t
    integer :: table(3) = 0                   !! map, branch, place
    integer :: count = 0
    type(part_t), allocatable :: part(:)      !! valid up to `count`
  end type observations_t

  !> The observations so far.
  type :: passage_summary_t
    private
    type(observations_t), allocatable :: tables(:)
  contains
    procedure :: follow
  end type passage_summary_t

contains

  !> Add the last piece, a leap.
  subroutine follow(self, map, summary)
    class(passage_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map
    type(summary_t), intent(inout) :: summary
    type(contribution_t) :: block
    type(state_t) :: begin
    integer(int64) :: done, times
    real(wp) :: lasting

    if (.not. allocated(self%tables)) allocate (self%tables(0))
    if (map%repetitions == 0) then
      call follow_passages(self, map, 0_int64, map%piece%from, summary)
      return
    end if
    call summarise_block(self, map, block)
    lasting = map%block_duration()
    done = 0
    do while (done < map%repetitions)
      begin = map%piece%from
      call begin%later(map%piece%from, real(done, wp)*lasting)
      begin%position = map%piece%from%position + real(done, wp)*(map%piece%to%position - map%piece%from%position) &
        /real(map%repetitions, wp)
      ! Those up to the one in which the second half begins, this one, and the others.
      times = map%repetitions - done
      if (summary%half > begin%time) times = min(times, int(min((summary%half - begin%time)/lasting, 1.0e15_wp), int64))
      if (times > 0) then
        call summary%add(block, begin%time, begin%position, times, &
          (map%piece%to%position - map%piece%from%position)/real(map%repetitions, wp))
      else
        times = 1
        call follow_passages(self, map, done, begin, summary)
      end if
      done = done + times
    end do
  end subroutine follow

  !> All passages of a repetition, as if they were a run.
  subroutine summarise_block(self, map, block)
    class(passage_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map
    type(contribution_t), intent(out) :: block
    type(summary_t) :: summary
    type(state_t) :: begin

    begin = state_t(u=map%piece%from%u)
    call begin_passage(map, begin%u, summary)
    call follow_passages(self, map, 0_int64, begin, summary)
    block = summary%contribution()
    block%duration = map%block_duration()
  end subroutine summarise_block

  !> A summary that begins at a release, with this elongation [m].
  subroutine begin_passage(map, u, summary)
    class(cycle_map_t), intent(in) :: map
    real(wp), intent(in) :: u(2)
    type(summary_t), intent(out) :: summary

    associate (slider => map%slider, velocity => map%piece%drive%velocity)
      call summary%cycles%begin(slider%along(1), slider%law%kinetic_limit, slider%stiffness(1), slider%mass)
      summary%cycles%keeps_turns = .true.
      call summary%begin(moment_t(force=slider%stiffness(1)*u(1), elongation_rate=velocity*slider%along(1), &
        drive_velocity=velocity), 0.0_wp, 0.0_wp)
    end associate
  end subroutine begin_passage

  !> The passages of a repetition of a leap that begins with this state.
  subroutine follow_passages(self, map, repetition, begin, summary)
    class(passage_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map
    integer(int64), intent(in) :: repetition
    type(state_t), intent(in) :: begin
    type(summary_t), intent(inout) :: summary
    type(passage_t) :: passage
    type(contribution_t) :: contribution
    type(state_t) :: here
    real(wp) :: elapsed
    logical :: is_known
    integer :: k

    here = begin
    do k = 1, map%passages()
      call map%passage_number(k, passage, elapsed)
      call here%later(begin, elapsed)
      here%u = map%maps(map%current)%elongation(passage%from)
      here%position = begin%position + map%piece%drive%velocity*elapsed - dot_product(here%u - begin%u, map%slider%along)
      is_known = .false.
      if (passage%table(1) == 1 .and. (here%time >= summary%half .or. here%time + passage%measure(duration) < summary%half)) &
        call look_up(self, map, passage, summary%has_slipped, contribution, is_known)
      if (is_known) then
        call summary%add(contribution, here%time, here%position, 1_int64, 0.0_wp)
      else
        call map%show_passage(repetition, k)
        call take_in_shown(map, here, summary)
        summary%exchanged = summary%exchanged + passage%measure(exchanged)
      end if
    end do
  end subroutine follow_passages

  !> The passage that is shown, piece by piece, from this state on.
  subroutine take_in_shown(map, begin, summary)
    class(cycle_map_t), intent(inout), target :: map
    type(state_t), intent(in) :: begin
    type(summary_t), intent(inout) :: summary
    type(piece_view_t) :: view
    type(piece_t), target :: piece
    integer :: i

    do i = 1, map%shown%count
      call map%shown%get(i, begin, piece)
      call view%show(map%steps, piece)
      if (piece%event == stick_begins) summary%sticks = summary%sticks + 1
      call summary%take_in(view)
    end do
  end subroutine take_in_shown

  !> The contribution of a passage from the observations, if they are smooth there.
  subroutine look_up(self, map, passage, has_slipped, contribution, is_known)
    class(passage_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(inout), target :: map
    type(passage_t), intent(in) :: passage
    logical, intent(in) :: has_slipped
    type(contribution_t), intent(out) :: contribution
    logical, intent(out) :: is_known
    real(wp) :: value(values), polynomial(nodes), x, u(2)
    integer :: here, i, turns

    here = 0
    do i = 1, size(self%tables)
      if (all(self%tables(i)%table == [map%current, passage%table])) here = i
    end do
    if (here == 0) then
      self%tables = [self%tables, observations_t(table=[map%current, passage%table], count=1)]
      here = size(self%tables)
      allocate (self%tables(here)%part(2**(most_halvings + 1) - 1))
    end if
    associate (branch => map%maps(map%current)%branch(passage%table(1)), table => self%tables(here))
      x = branch%x_of(passage%table(2), passage%from)
      i = 1
      do
        if (.not. table%part(i)%is_tried) call try_part(map, passage%table(2), table, i)
        if (table%part(i)%half(1) == 0) exit
        i = table%part(i)%half(merge(1, 2, x <= 0.5_wp*(table%part(i)%first + table%part(i)%last)))
      end do
      is_known = table%part(i)%is_known .and. (has_slipped .or. .not. table%part(i)%begins_to_slip)
      if (.not. is_known) return
      associate (part => table%part(i))
        call chebyshev_polynomials(nodes, 2.0_wp*(x - part%first)/(part%last - part%first) - 1.0_wp, polynomial)
        value = matmul(polynomial, part%coefficient)
        turns = part%turns
      end associate
    end associate
    associate (lasting => passage%measure(duration))
      contribution%duration = lasting
      contribution%sticks = 1
      contribution%sticking_time = lasting - passage%measure(slip_duration)
      contribution%creep_time = min(lasting, max(contribution%sticking_time, value(creep_time)))
      contribution%exchanged = passage%measure(exchanged)
      contribution%largest_rate = value(largest_rate)
      u = map%maps(map%current)%elongation(passage%to)
      allocate (contribution%turns(turns + 1))
      do i = 1, turns
        associate (turn => value(first_turn + 3*(i - 1):))
          contribution%turns(i) = extremum_t(turn(1), turn(2), turn(3))
        end associate
      end do
      contribution%turns(turns + 1) = extremum_t(map%slider%stiffness(1)*u(1), lasting, map%piece%drive%velocity*lasting &
        - dot_product(u - map%maps(map%current)%elongation(passage%from), map%slider%along))
    end associate
  end subroutine look_up

  !> Observe passages in a part of a table; it is halved if the observations are not smooth.
  subroutine try_part(map, place, table, number)
    class(cycle_map_t), intent(inout), target :: map
    integer, intent(in) :: place, number
    type(observations_t), intent(inout) :: table
    real(wp) :: value(nodes, values), test(values), polynomial(nodes), points(nodes), allowed(values)
    integer :: kind(2), here(2), i
    logical :: is_smooth, slips

    associate (part => table%part(number))
      part%is_tried = .true.
      points = chebyshev_points(nodes)
      kind = 0
      is_smooth = .true.
      do i = 1, nodes
        call observe(points(i), value(i, :), here, slips)
        part%begins_to_slip = part%begins_to_slip .or. slips
        if (i == 1) kind = here
        is_smooth = is_smooth .and. all(here == kind) .and. here(1) <= most_turns
      end do
      part%coefficient = chebyshev_coefficients(value)
      allowed = smooth*maxval(abs(value), dim=1)
      allowed(first_turn + 2::3) = allowed(first_turn + 2::3) + roundoff*map%slider%law%static_limit/map%slider%stiffness(1)
      do i = 1, size(test_at)
        if (.not. is_smooth) exit
        call observe(test_at(i), test, here, slips)
        call chebyshev_polynomials(nodes, test_at(i), polynomial)
        is_smooth = all(here == kind) .and. all(abs(matmul(polynomial, part%coefficient) - test) <= allowed)
      end do
      part%is_known = is_smooth
      part%turns = kind(1)
      if (is_smooth .or. part%halvings == most_halvings) return
      part%half = table%count + [1, 2]
      table%part(part%half)%first = [part%first, 0.5_wp*(part%first + part%last)]
      table%part(part%half)%last = [0.5_wp*(part%first + part%last), part%last]
      table%part(part%half)%halvings = part%halvings + 1
    end associate
    table%count = table%count + 2

  contains

    !> The observations of the passage at a position in [-1, 1] of the part, and how often the load turns back in it, and whether it
    !> is all creep.
    subroutine observe(position, value, kind, slips)
      real(wp), intent(in) :: position
      real(wp), intent(out) :: value(values)
      integer, intent(out) :: kind(2)
      logical, intent(out) :: slips
      type(passage_t) :: passage
      type(summary_t) :: summary
      type(contribution_t) :: one
      real(wp) :: x
      logical :: found
      integer :: i

      associate (part => table%part(number), maps => map%maps(map%current))
        x = part%first + 0.5_wp*(part%last - part%first)*(1.0_wp + position)
        call maps%look_up(maps%branch(1)%angle(place, x), passage, found)
        call maps%describe(passage, found)
        call map%shown%copy(maps%recording)
      end associate
      call begin_passage(map, map%shown%kept(1)%from%u, summary)
      call take_in_shown(map, state_t(), summary)
      one = summary%contribution()
      slips = summary%has_slipped
      value = 0.0_wp
      value(creep_time) = one%creep_time
      value(largest_rate) = one%largest_rate
      associate (turns => size(one%turns) - 1)
        do i = 1, min(turns, most_turns)
          value(first_turn + 3*(i - 1):first_turn + 3*i - 1) = [one%turns(i)%load, one%turns(i)%time, one%turns(i)%position]
        end do
        kind = [turns, merge(1, 0, one%creep_time >= one%duration)]
      end associate
    end subroutine observe
  end subroutine try_part
end module dst_passage_summary
