!> The contribution of the leaps of a cycle map to a summary. For the cycles of a table it follows from observations of the cycles
!> at its points.
module dst_leap_summary
  use dst_chebyshev, only: chebyshev_polynomials
  use dst_cycle_map, only: cycle_map_t, max_leaps
  use dst_cycle_survey, only: cycle_observer_t
  use dst_cycles, only: extremum_t, threshold
  use dst_kinds, only: wp, int64
  use dst_leap, only: leap_t
  use dst_motion, only: motion_t
  use dst_interpolation, only: grid_t, new_grid, max_degree
  use dst_piece, only: piece_t, stick_begins, slips
  use dst_piece_view, only: piece_view_t, moment_of, friction_of
  use dst_recording, only: recording_t
  use dst_state, only: state_t
  use dst_stretch, only: moment_t, stretch_t, tiny_rate
  use dst_summary, only: summary_t, passage_t
  implicit none
  private

  public :: leap_summary_t, observe_cycles

  !> The observations of a cycle: the largest |X'| [m/s], highest and lowest load with time and X,
  !> where they are in the cycle, and whether slip begins in it.
  integer, parameter :: largest_rate = 1, highest = 2, lowest = 5, highest_place = 8, lowest_place = 9, begins_to_slip = 10, &
    values = 10
  real(wp), parameter :: at_begin = -1.0_wp, inside = 0.0_wp, at_end = 1.0_wp
  !> If a cycle at a point comes this close to the largest |X'| so far, or to that of creep, the cycles between the points may
  !> exceed it.
  real(wp), parameter :: near_largest = 0.95_wp
  !> Permitted error of an interpolated time in creep, relative to a cycle. Convention; a tenth: no change of Fig. 3.
  real(wp), parameter :: smooth = 1.0e-8_wp
  !> A fall of the load within each cycle counts separately from this share of `threshold` on.
  real(wp), parameter :: large_ripple = 0.5_wp

  type, extends(cycle_observer_t) :: observer_t
  contains
    procedure :: observe
  end type observer_t

  !> The contribution of a leap that is kept.
  type :: known_passage_t
    integer(int64) :: number = 0
    type(passage_t) :: passage
  end type known_passage_t

  !> The contributions of the leaps that a map keeps, each computed once.
  type :: leap_summary_t
    private
    type(known_passage_t), allocatable :: known(:)
  contains
    procedure :: follow
  end type leap_summary_t

  !> Part of a leap in the form that the summary uses; time and X count from its beginning.
  type, extends(stretch_t) :: leap_view_t
    class(cycle_map_t), pointer :: map => null()
    type(leap_t), pointer :: leap => null()
    !> Bernstein coefficients of the load [N], and an upper bound of the slip speed [m/s].
    real(wp) :: coefficient(0:max_degree) = 0.0_wp, highest_speed = 0.0_wp
  contains
    procedure :: at
    procedure :: moment => moment_in
    procedure :: friction
    procedure :: load
    procedure :: fastest
    procedure :: least_friction
  end type leap_view_t

contains

  !> Observe the cycles of a map.
  subroutine observe_cycles(map)
    class(cycle_map_t), intent(inout) :: map

    if (.not. allocated(map%survey%observer)) allocate (map%survey%observer, source=observer_t(values=values))
  end subroutine observe_cycles

  !> A cycle, evaluated by its own summary.
  subroutine observe(self, steps, cycle, value)
    class(observer_t), intent(in) :: self
    class(motion_t), intent(in), target :: steps
    type(recording_t), intent(in) :: cycle
    real(wp), intent(out) :: value(:)
    type(summary_t) :: summary
    type(passage_t) :: passage

    associate (unused => self%values)
    end associate
    call summarise(steps, cycle, summary)
    passage = summary%passage()
    value(largest_rate) = passage%largest_rate
    value(highest:highest + 2) = [passage%highest%load, passage%highest%time, passage%highest%position]
    value(lowest:lowest + 2) = [passage%lowest%load, passage%lowest%time, passage%lowest%position]
    value(highest_place) = place_in(passage%highest)
    value(lowest_place) = place_in(passage%lowest)
    value(begins_to_slip) = merge(1.0_wp, 0.0_wp, summary%has_slipped)

  contains

    pure real(wp) function place_in(extremum)
      type(extremum_t), intent(in) :: extremum

      place_in = inside
      if (.not. extremum%time > 0.0_wp) place_in = at_begin
      if (extremum%time >= cycle%duration()) place_in = at_end
    end function place_in
  end subroutine observe

  !> The summary of a recording as if it were a run.
  subroutine summarise(steps, recording, summary)
    class(motion_t), intent(in), target :: steps
    type(recording_t), intent(in) :: recording
    type(summary_t), intent(out) :: summary
    type(piece_view_t) :: view
    type(piece_t), target :: piece
    integer :: i

    call begin_passage(steps, summary)
    do i = 1, recording%count
      call recording%get(i, piece)
      call view%show(steps, piece)
      if (i == 1) call summary%begin(view%first, 0.0_wp, 0.0_wp)
      if (piece%event == stick_begins) summary%sticks = summary%sticks + 1
      call summary%take_in(view)
    end do
    summary%exchanged = recording%exchanged()
  end subroutine summarise

  subroutine begin_passage(motion, summary)
    class(motion_t), intent(in) :: motion
    type(summary_t), intent(inout) :: summary

    associate (slider => motion%slider)
      call summary%cycles%begin(slider%along(1), slider%law%kinetic_limit, slider%stiffness(1), slider%mass)
    end associate
    summary%cycles%keeps_turns = .true.
  end subroutine begin_passage

  !> Add the last piece, a leap.
  subroutine follow(self, map, summary)
    class(leap_summary_t), intent(inout) :: self
    class(cycle_map_t), intent(in), target :: map
    type(summary_t), intent(inout) :: summary

    if (.not. allocated(self%known)) allocate (self%known(max_leaps))
    associate (known => self%known(map%current), leap => map%leaps(map%current), from => map%piece%from)
      if (known%number /= leap%number) then
        if (leap%table == 0) then
          call know_excursion(map, leap, known%passage)
        else
          call know_cycles(map, leap, summary%largest_rate, known%passage)
        end if
        known%number = leap%number
      end if
      if (.not. summary%has_slipped .and. leap%table > 0) call look_for_slip(map, leap, summary)
      call summary%add(known%passage, from%time - map%lead, from%position)
    end associate
  end subroutine follow

  !> The contribution of an excursion.
  subroutine know_excursion(map, leap, passage)
    class(cycle_map_t), intent(in) :: map
    type(leap_t), intent(in) :: leap
    type(passage_t), intent(out) :: passage
    type(summary_t) :: summary
    type(state_t) :: first

    call summarise(map%steps, leap%recording, summary)
    passage = summary%passage()
    first = leap%recording%from(1)
    passage%turns%time = passage%turns%time - first%time
    passage%turns%position = passage%turns%position - first%position
  end subroutine know_excursion

  !> The contribution of the cycles of a leap.
  subroutine know_cycles(map, leap, largest_so_far, passage)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    real(wp), intent(in) :: largest_so_far
    type(passage_t), intent(out) :: passage
    real(wp) :: polynomial(map%survey%table(leap%table)%points)
    integer :: i

    associate (table => map%survey%table(leap%table), n => leap%cycles)
      passage%duration = leap%duration
      passage%sticks = n
      passage%sticking_time = leap%duration - sum(leap%slip)
      passage%exchanged = leap%exchanged
      passage%creep_time = leap%duration
      if (maxval(table%observed(:, largest_rate)) > near_largest*tiny_rate*abs(leap%velocity)) &
        passage%creep_time = min(leap%duration, max(passage%sticking_time, creep_of(map, leap, 1, n)))
      if (maxval(table%observed(:, largest_rate)) > near_largest*largest_so_far) then
        do i = 1, n
          call chebyshev_polynomials(table%points, table%place(leap%angle(i)), polynomial)
          passage%largest_rate = max(passage%largest_rate, dot_product(polynomial, table%observed_coefficient(:, largest_rate)))
        end do
      end if
    end associate
    call find_turns(map, leap, passage%turns)
  end subroutine know_cycles

  !> Time in creep [s] of the cycles of a leap from one to another. It is no smooth function of the angle where creep begins to be
  !> interrupted: it is interpolated in ranges of cycles, which are halved until the interpolation is accurate.
  recursive real(wp) function creep_of(map, leap, first, last) result(creep)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    integer, intent(in) :: first, last
    type(grid_t) :: grid
    real(wp) :: value(0:max_degree), basis(0:max_degree), middle, error
    integer :: node(0:max_degree), i, k

    associate (length => last - first)
      if (length < 2*max_degree) then
        creep = sum([(creep_in(map, leap, i), i=first, last)])
        return
      end if
      node = first + nint(map%steps%closed_form%grid%node*real(length, wp))
      grid = new_grid(real(node - first, wp))
      value = [(creep_in(map, leap, node(k)), k=0, max_degree)]
      creep = 0.0_wp
      do i = first, last
        call grid%lagrange(real(i - first, wp), basis)
        creep = creep + dot_product(basis, value)
      end do
      ! Between two nodes, off the middle, on either side.
      error = 0.0_wp
      do k = 3, 5, 2
        i = (node(k) + node(k + 1))/2
        call grid%lagrange(real(i - first, wp), basis)
        middle = dot_product(basis, value)
        error = max(error, abs(middle - creep_in(map, leap, i)))
      end do
      if (error <= smooth*leap%duration/real(leap%cycles, wp)) return
      i = first + length/2
      creep = creep_of(map, leap, first, i) + creep_of(map, leap, i + 1, last)
    end associate
  end function creep_of

  !> That of one cycle.
  real(wp) function creep_in(map, leap, number) result(creep)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    integer, intent(in) :: number
    type(leap_view_t) :: view

    creep = 0.0_wp
    call first_part(map, leap, number, view)
    do while (view%first%time < leap%start(number + 1))
      creep = creep + view%creep_time(map%steps%closed_form%grid, 0.0_wp, 1.0_wp)
      call next_part(view)
    end do
  end function creep_in

  !> Points at which the load turns back in the cycles of a leap: in each of them if it falls far enough, else at the ends.
  subroutine find_turns(map, leap, turns)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    type(extremum_t), allocatable, intent(out) :: turns(:)
    integer :: first, last, i, n

    associate (table => map%survey%table(leap%table))
      if (maxval(table%observed(:, highest) - table%observed(:, lowest)) &
        > large_ripple*threshold*map%slider%law%kinetic_limit) then
        allocate (turns(2*leap%cycles + 1))
        n = 0
        do i = 1, leap%cycles
          call turns_of_cycle(i, turns(2*i - 1:2*i))
        end do
      else
        ! The load is highest where the angle to the soft axis is smallest.
        first = min(minloc(leap%angle(:leap%cycles), dim=1), maxloc(leap%angle(:leap%cycles), dim=1))
        last = max(minloc(leap%angle(:leap%cycles), dim=1), maxloc(leap%angle(:leap%cycles), dim=1))
        allocate (turns(5))
        call turns_of_cycle(first, turns(1:2))
        call turns_of_cycle(last, turns(3:4))
      end if
    end associate
    turns(size(turns)) = extremum_t(map%slider%law%static_limit*cos(leap%to%angle), leap%duration, advance_to(leap%cycles + 1))

  contains

    !> X at the beginning of a cycle, from that of the leap.
    pure real(wp) function advance_to(i)
      integer, intent(in) :: i

      associate (u => map%elongation_at(leap%from%side*leap%angle(i)), u_first => map%elongation_at(leap%from%theta()))
        advance_to = leap%velocity*leap%start(i) - dot_product(u - u_first, map%slider%along)
      end associate
    end function advance_to

    !> Highest and lowest load of a cycle, in the order of time.
    subroutine turns_of_cycle(i, pair)
      integer, intent(in) :: i
      type(extremum_t), intent(out) :: pair(2)
      type(passage_t) :: cycle
      real(wp) :: polynomial(map%survey%table(leap%table)%points), high(3), low(3), x

      associate (table => map%survey%table(leap%table))
        if (one_place(table%observed(:, highest_place)) .and. one_place(table%observed(:, lowest_place))) then
          call chebyshev_polynomials(table%points, table%place(leap%angle(i)), polynomial)
          high = matmul(polynomial, table%observed_coefficient(:, highest:highest + 2))
          low = matmul(polynomial, table%observed_coefficient(:, lowest:lowest + 2))
          x = advance_to(i)
          pair = [extremum_t(high(1), leap%start(i) + high(2), x + high(3)), extremum_t(low(1), leap%start(i) + low(2), x + low(3))]
        else
          call summarise_cycle(map, leap, i, cycle)
          pair = [cycle%highest, cycle%lowest]
        end if
      end associate
      if (pair(1)%time > pair(2)%time) pair = pair([2, 1])
    end subroutine turns_of_cycle

    pure logical function one_place(place)
      real(wp), intent(in) :: place(:)

      one_place = maxval(place) - minval(place) <= 0.0_wp
    end function one_place
  end subroutine find_turns

  !> A cycle of a leap, part by part.
  subroutine summarise_cycle(map, leap, number, passage)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    integer, intent(in) :: number
    type(passage_t), intent(out) :: passage
    type(summary_t) :: summary
    type(leap_view_t) :: view

    call begin_passage(map, summary)
    call first_part(map, leap, number, view)
    call summary%begin(view%first, 0.0_wp, 0.0_wp)
    do while (view%first%time < leap%start(number + 1))
      call summary%take_in(view)
      call next_part(view)
    end do
    passage = summary%passage()
  end subroutine summarise_cycle

  !> Find the instant in which slip begins for the first time.
  subroutine look_for_slip(map, leap, summary)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    type(summary_t), intent(inout) :: summary
    type(leap_view_t) :: view
    real(wp) :: load(0:max_degree)
    integer :: i, degree

    if (maxval(map%survey%table(leap%table)%observed(:, begins_to_slip)) <= 0.0_wp) return
    do i = 1, leap%cycles
      call first_part(map, leap, i, view)
      do while (view%first%time < leap%start(i + 1))
        if (.not. view%sticking) then
          call view%load(degree, load)
          call summary%follow_slip(view, load)
        end if
        if (summary%has_slipped) return
        call next_part(view)
      end do
    end do
  end subroutine look_for_slip

  !> The first part of a cycle of a leap.
  subroutine first_part(map, leap, number, view)
    class(cycle_map_t), intent(in), target :: map
    type(leap_t), intent(in), target :: leap
    integer, intent(in) :: number
    type(leap_view_t), intent(out) :: view

    view%map => map
    view%leap => leap
    view%last = view%moment(leap%start(number))
    call next_part(view)
  end subroutine first_part

  !> The part after this one.
  subroutine next_part(view)
    type(leap_view_t), intent(inout) :: view
    type(state_t) :: state
    real(wp) :: load(0:max_degree), speed(0:max_degree)
    integer :: contact, i

    view%first = view%last
    view%last = view%moment(view%map%next_in_leap(view%leap, view%first%time))
    call view%map%state_in_leap(view%leap, 0.5_wp*(view%first%time + view%last%time), state, contact)
    view%sticking = contact /= slips
    ! The load and the slip speed are polynomials in each panel of a table, and at rest.
    associate (grid => view%map%steps%closed_form%grid)
      do i = 0, max_degree
        call view%map%state_in_leap(view%leap, view%first%time + grid%node(i)*view%duration(), state, contact)
        load(i) = view%map%slider%stiffness(1)*state%u(1)
        speed(i) = merge(0.0_wp, state%y(1), view%sticking)
      end do
      call grid%bernstein_coefficients(load, view%coefficient)
      call grid%bernstein_coefficients(speed, load)
    end associate
    view%highest_speed = maxval(abs(load))
  end subroutine next_part

  function at(self, place) result(moment)
    class(leap_view_t), intent(in) :: self
    real(wp), intent(in) :: place
    type(moment_t) :: moment

    moment = self%moment(self%first%time + place*self%duration())
  end function at

  !> The motion at a time [s].
  function moment_in(self, time) result(moment)
    class(leap_view_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(moment_t) :: moment
    type(state_t) :: state
    integer :: contact

    call self%map%state_in_leap(self%leap, time, state, contact)
    moment = moment_of(self%map, self%map%piece, state)
  end function moment_in

  subroutine load(self, degree, coefficient)
    class(leap_view_t), intent(in) :: self
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)

    degree = max_degree
    coefficient = self%coefficient
  end subroutine load

  real(wp) function fastest(self, enough)
    class(leap_view_t), intent(in) :: self
    real(wp), intent(in) :: enough

    associate (unused => enough)
    end associate
    fastest = self%highest_speed
  end function fastest

  pure real(wp) function least_friction(self)
    class(leap_view_t), intent(in) :: self

    least_friction = self%map%slider%law%least_force
  end function least_friction

  pure real(wp) function friction(self, speed)
    class(leap_view_t), intent(in) :: self
    real(wp), intent(in) :: speed

    friction = friction_of(self%map, speed)
  end function friction
end module dst_leap_summary
