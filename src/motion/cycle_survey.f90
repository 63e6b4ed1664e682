!> Tables of fast cycles, made if they save work: how wide a table can be, how many points it needs, and the cycles that are run for
!> it. docs/cycle_map.md.
module dst_cycle_survey
  use dst_archive, only: archive_t
  use dst_cycle_table, only: cycle_table_t, new_cycle_table, is_cycle, measures_of, duration, turn, slip_duration, measures
  use dst_drive, only: drive_segment_t
  use dst_errors, only: error_t
  use dst_fast_cycle, only: release_angle_t, release_at, fast_cycle_t
  use dst_kinds, only: wp, pi
  use dst_motion, only: motion_t
  use dst_piece, only: slip_begins, sticks, touches
  use dst_recording, only: recording_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t
  use dst_stepper, only: work_count_t
  implicit none
  private

  public :: cycle_survey_t, cycle_observer_t

  ! The effects of "twice" were measured on Fig. 3 to 10 s (rtol 1e-6 and 1e-8) and with k_y = 1e6 N/m to 20 s, where excursions do
  ! not repeat: Newton iterations of the whole run, and the error of w at its end. All are conventions.
  !
  !> Smallest and largest number of points of a table.
  integer, parameter :: least_points = 5, most_points = 64
  !> Permitted difference of the cycles left out of a table from its polynomials: this share of rtol, as the error of a method in a
  !> cycle is far below rtol, plus some roundoffs. Twice: 1 % fewer iterations, the same error; no change.
  real(wp), parameter :: allowed_error = 0.003_wp, allowed_roundoff = 5000.0_wp*epsilon(1.0_wp)
  !> Permitted error of the motion inside the slip, of which samples are taken, over rtol. Slow cycles that are one cycle of a table
  !> forget their beginning, so that a few points give their measures, but not their motion:
  !> the table is made narrower, by this margin. Twice: no change on Fig. 3.
  real(wp), parameter :: allowed_inside = 10.0_wp, narrower = 0.7_wp
  !> If more points do not reduce the error to this share, it is the error of the method, which is made in each cycle anyway: it may
  !> be this share of rtol. Twice: no change (radau5 needs them).
  real(wp), parameter :: noise_ratio = 0.3_wp, allowed_noise = 0.1_wp
  !> Number of cycles, for each one that is run for a table, from which on a table saves work: as long as no table has failed, for
  !> the first one, and the increase after each failure. Twice: 3 to 17 % more iterations; no change on Fig. 3, four times as many
  !> with k_y = 1e6 N/m; no change.
  real(wp), parameter :: profit = 1.5_wp, first_profit = 20.0_wp, disappointment = 2.0_wp
  !> Points of a table over the expected ones, after one had too few, and the largest ratio; and the ratio of its error to the
  !> permitted one up to which more points are sure to help. 1.1 instead of 1.05: 2 % more iterations; twice: no change.
  real(wp), parameter :: margin = 1.05_wp, most_hardness = 2.5_wp, near_miss = 1000.0_wp
  !> Width of a table: share of the distance to the soft axis, and of that to where sticks are expected to end (half: 40 to 70 %
  !> more iterations), and this many times the range of the run (twice: no change); how it shrinks (0.75 instead of 0.5: 4 to 12 %
  !> more), and the smallest share of the distance (twice: no change).
  real(wp), parameter :: share_of_way = 0.7_wp, share_of_sticks = 0.62_wp, reach = 1.5_wp, shrink = 0.5_wp, least_share = 0.01_wp
  !> Distance before the release at which a table begins [rad] if cycles seem to converge. Twice: no change.
  real(wp), parameter :: margin_behind = 0.05_wp
  integer, parameter :: max_trials = 6
  !> A distance larger than any angle [rad].
  real(wp), parameter :: far_away = 1.0e3_wp
  !> Remaining error of Newton's method in the cycles of a table, over rtol: it would be noise in the table. Convention; twice: no
  !> change.
  real(wp), parameter :: exact_share = 1.0e-6_wp
  !> Largest numbers of tables, of places where none could be made, and of pieces of a cycle and of an excursion.
  integer, parameter :: max_tables = 64, max_refused = 64, max_pieces = 3000, most_pieces = 20000
  !> A cycle that lasts this many times longer than the one before is not one of the fast cycles. Twice: 3 to 60 % more iterations.
  real(wp), parameter :: patience = 3.0_wp

  !> Angles at which no table could be made.
  type :: refusal_t
    real(wp) :: velocity = 0.0_wp, side = 0.0_wp, first = 0.0_wp, last = 0.0_wp
  end type refusal_t

  !> An observer, which needs more of the cycles in a table than the map does: some values of each, smooth in its angle.
  type, abstract :: cycle_observer_t
    integer :: values = 0
  contains
    procedure(observe), deferred :: observe
  end type cycle_observer_t

  abstract interface
    !> The values of a cycle that was made by these steps, from time 0 and X = 0 on.
    subroutine observe(self, steps, cycle, value)
      import :: cycle_observer_t, motion_t, recording_t, wp
      class(cycle_observer_t), intent(in) :: self
      class(motion_t), intent(in), target :: steps
      type(recording_t), intent(in) :: cycle
      real(wp), intent(out) :: value(:)
    end subroutine observe
  end interface

  !> The tables, and data about the cycles before a release.
  type :: cycle_survey_t
    class(cycle_observer_t), allocatable :: observer
    real(wp) :: rtol = 0.0_wp
    type(cycle_table_t), allocatable :: table(:)     !! valid up to `tables`
    integer :: tables = 0
    !> The last two cycles, and the time from one excursion to the next [s], 0 if it is not known.
    type(fast_cycle_t) :: last, before
    real(wp) :: slow_period = 0.0_wp
    !> Cycles that were run.
    integer :: sampled = 0
    !> V [m/s] of the present cycles.
    real(wp), private :: velocity = 0.0_wp
    !> The motion that runs them, and the last of them.
    class(slip_stick_t), allocatable, private :: scout
    type(recording_t), private :: sample
    type(refusal_t), private :: refused(max_refused)
    integer, private :: refusals = 0
    !> The profit that the next table must have, as `profit`; points that tables need in addition to those expected.
    real(wp), private :: asked = first_profit, hardness = 1.0_wp
  contains
    procedure :: table_of
    procedure :: make_table
    procedure :: run_releases
    procedure :: work
    procedure :: serialise => serialise_survey
  end type cycle_survey_t

contains

  !> The table that holds a release, 0 if there is none.
  pure integer function table_of(self, velocity, here) result(table)
    class(cycle_survey_t), intent(in) :: self
    real(wp), intent(in) :: velocity          !! V, m/s
    type(release_angle_t), intent(in) :: here

    do table = self%tables, 1, -1
      associate (t => self%table(table))
        if (.not. abs(t%velocity - velocity) > 0.0_wp .and. t%side*here%side > 0.0_wp .and. t%holds(here%angle)) return
      end associate
    end do
  end function table_of

  !> Make a table that begins with a release, if it saves work; 0 if there is none.
  subroutine make_table(self, steps, velocity, here, longest, rest, table)
    class(cycle_survey_t), intent(inout) :: self
    class(slip_stick_t), intent(in) :: steps  !! the motion with these cycles
    real(wp), intent(in) :: velocity          !! V, m/s
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: longest, rest     !! time up to which leaps have to end, and to the end of the run [s]
    integer, intent(out) :: table
    real(wp) :: width

    table = 0
    if (self%tables == max_tables .or. self%refusals == max_refused) return
    if (.not. self%last%known .or. .not. self%before%known) return
    self%velocity = velocity
    width = promising_width(self, here, rest)
    if (.not. pays(self, here, width, far_away, longest)) return
    call prepare(self, steps)
    call build_table(self, here, width, longest, table)
  end subroutine make_table

  !> Allocate tables and a scout: many runs need none.
  subroutine prepare(self, steps)
    class(cycle_survey_t), intent(inout) :: self
    class(slip_stick_t), intent(in) :: steps

    if (allocated(self%scout)) return
    allocate (self%scout, source=steps)
    self%scout%stepper%count = work_count_t()
    self%scout%stepper%newton_share = exact_share
    allocate (self%table(max_tables))
  end subroutine prepare

  !> How far from a release a table may reach [rad], estimated without running a cycle.
  pure real(wp) function promising_width(self, here, rest) result(width)
    class(cycle_survey_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: rest
    real(wp) :: left
    integer :: i

    associate (last => self%last, previous => self%before)
      width = min(share_of_way*way_to_axis(self, here), reach*abs(last%turn)*rest/last%duration)
      ! Turns that decrease in equal ratios lead to a cycle that repeats itself.
      width = min(width, reach*way_to_repetition(self))
      width = max(width, least_share*way_to_axis(self, here))
      left = way_to_graze(last%from%angle - previous%from%angle, previous%stick_share, last%stick_share)
      width = min(width, share_of_sticks*(left - abs(last%turn)))
      do i = 1, self%tables
        associate (table => self%table(i))
          if (abs(table%velocity - self%velocity) > 0.0_wp .or. table%side*here%side < 0.0_wp) cycle
          if (last%turn < 0.0_wp .and. table%last < here%angle) width = min(width, here%angle - table%last)
          if (last%turn > 0.0_wp .and. table%first > here%angle) width = min(width, table%first - here%angle)
        end associate
      end do
      do i = 1, self%refusals
        associate (refusal => self%refused(i))
          if (abs(refusal%velocity - self%velocity) > 0.0_wp .or. refusal%side*here%side < 0.0_wp) cycle
          if (here%angle >= refusal%first .and. here%angle <= refusal%last) width = 0.0_wp
        end associate
      end do
    end associate
  end function promising_width

  !> The distance to a cycle that repeats itself [rad], if turns continue to decrease in equal ratios; far away if they do not.
  pure real(wp) function way_to_repetition(self) result(way)
    class(cycle_survey_t), intent(in) :: self

    way = far_away
    associate (shrinks => self%before%turn - self%last%turn, turn => self%last%turn)
      if (shrinks*turn > 0.0_wp) way = turn**2/abs(shrinks)
    end associate
  end function way_to_repetition

  !> The distance to the soft axis [rad].
  pure real(wp) function way_to_axis(self, here) result(way)
    class(cycle_survey_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here

    way = merge(here%angle, pi - here%angle, self%last%turn < 0.0_wp)
  end function way_to_axis

  !> Number of points of a table of some width that ends `left` [rad] before its functions cease to be smooth. The error of
  !> interpolation is rho^-n, where rho is the sum of the half axes of the largest ellipse around [-1, 1] in which they are
  !> analytic.
  pure integer function points_for(self, width, left) result(points)
    class(cycle_survey_t), intent(in) :: self
    real(wp), intent(in) :: width, left
    real(wp) :: end, rho

    end = 1.0_wp + 2.0_wp*min(left/width, 1.0e3_wp)
    rho = end + sqrt(end**2 - 1.0_wp)
    points = max(least_points, min(most_points, ceiling(-self%hardness*log(allowed_by(self))/log(rho))))
  end function points_for

  !> Permitted error of a table.
  pure real(wp) function allowed_by(self) result(error)
    class(cycle_survey_t), intent(in) :: self

    error = allowed_error*self%rtol + allowed_roundoff
  end function allowed_by

  !> Towards the end of sticks their share goes to zero like a square root: the distance from the later of two cycles [rad].
  pure real(wp) function way_to_graze(way, share, later_share) result(left)
    real(wp), intent(in) :: way, share, later_share

    left = far_away
    if (later_share < share) left = abs(way)*later_share**2/(share**2 - later_share**2)
  end function way_to_graze

  !> Whether the cycles in a table of this width save more than those that are run for it cost.
  pure logical function pays(self, here, width, left, longest)
    class(cycle_survey_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: width, left, longest
    real(wp) :: cycles, passes, needed

    associate (last => self%last)
      pays = width > 0.0_wp
      if (.not. pays) return
      needed = self%asked*real(points_for(self, width, min(left, way_to_axis(self, here) - width)) + 4, wp)
      ! An upper limit above all relevant values keeps the quotients finite where the angle stops changing.
      cycles = 1.0e6_wp
      if (abs(last%turn)*cycles > width .and. way_to_repetition(self) > width) cycles = width/abs(last%turn)
      passes = 1.0_wp
      if (self%slow_period > 0.0_wp) passes = max(1.0_wp, longest/self%slow_period)
      pays = cycles > 4.0_wp .and. min(cycles*passes, longest/last%duration) > needed
    end associate
  end function pays

  !> Make a table that begins with a release. If that fails, the place is kept.
  subroutine build_table(self, here, widest, longest, table)
    class(cycle_survey_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: widest, longest
    integer, intent(out) :: table
    real(wp) :: width, way, left, error, former
    type(cycle_table_t) :: filled
    logical :: found, is_noise
    integer :: trial

    table = 0
    error = huge(error)
    width = widest
    left = far_away
    way = sign(1.0_wp, self%last%turn)
    do trial = 1, max_trials
      if (.not. pays(self, here, width, left, longest)) return
      if (left > way_to_axis(self, here)) then
        call look_ahead(self, release_angle_t(here%angle + way*width, here%side), way, left, found)
        if (.not. found) then
          width = shrink*width
          left = far_away
          cycle
        end if
        left = min(width + left, way_to_axis(self, here))
        width = min(width, share_of_sticks*left)
        left = left - width
      end if
      former = error
      call fill_table(self, here, way*width, points_for(self, width, left), filled, error)
      is_noise = trial > 1 .and. error <= allowed_noise*self%rtol .and. error > noise_ratio*former
      if (error <= allowed_by(self) .or. is_noise) then
        self%tables = self%tables + 1
        self%table(self%tables) = filled
        table = self%tables
        self%asked = min(self%asked, profit)
        return
      end if
      if (filled%error <= allowed_by(self)) then
        ! Only the motion inside is not accurate enough; its error is that of a polynomial.
        left = left + width
        width = width*narrower*(allowed_by(self)/error)**(1.0_wp/real(filled%points, wp))
        left = left - width
        cycle
      end if
      ! More points are enough if the error was slightly too large.
      if (error > near_miss*allowed_by(self)) self%asked = disappointment*self%asked
      if (error < 1.0_wp) self%hardness = max(self%hardness, min(most_hardness, &
        margin*self%hardness*log(allowed_by(self))/log(error)))
      if (error < 1.0_wp .and. trial == 1) cycle
      left = left + (1.0_wp - shrink)*width
      width = shrink*width
    end do
    self%refusals = self%refusals + 1
    self%refused(self%refusals) = refusal_t(self%velocity, here%side, min(here%angle, here%angle + way*width), &
      max(here%angle, here%angle + way*width))
  end subroutine build_table

  !> Whether there are cycles at a release, and the distance from there to where sticks end [rad].
  subroutine look_ahead(self, from, way, left, found)
    class(cycle_survey_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: from
    real(wp), intent(in) :: way              !! direction, +1 or -1
    real(wp), intent(out) :: left
    logical, intent(out) :: found
    real(wp) :: first(measures), second(measures)

    left = far_away
    call run_cycle(self, from, found)
    if (.not. found) return
    first = measures_of(self%sample, from%side, self%scout%slider)
    ! Beyond a cycle that repeats itself they turn back: then it is not known where sticks end in this direction.
    if (.not. first(turn)*way > 0.0_wp) return
    call run_cycle(self, release_angle_t(from%angle + first(turn), from%side), found)
    if (.not. found) return
    second = measures_of(self%sample, from%side, self%scout%slider)
    left = way_to_graze(first(turn), stick_share(first), stick_share(second))

  contains

    pure real(wp) function stick_share(measure)
      real(wp), intent(in) :: measure(measures)

      stick_share = 1.0_wp - measure(slip_duration)/measure(duration)
    end function stick_share
  end subroutine look_ahead

  !> Run the cycles at the points of a table that begins with a release, and some between the points, from which its error follows.
  subroutine fill_table(self, here, way, points, table, error)
    class(cycle_survey_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: way              !! distance to its other end, rad
    integer, intent(in) :: points
    type(cycle_table_t), intent(out) :: table
    real(wp), intent(out) :: error           !! huge if one of them is not a cycle
    logical :: found
    real(wp), allocatable :: observed(:)
    real(wp) :: measure(measures), expected(measures), largest_turn, begin, inside
    integer :: j

    inside = 0.0_wp
    j = 0
    if (allocated(self%observer)) j = self%observer%values
    allocate (observed(j))
    error = huge(error)
    begin = begin_of_table(self, here, way)
    associate (first => min(begin, here%angle + way), last => max(begin, here%angle + way))
      call new_cycle_table(self%velocity, here%side, first, last, points, size(observed), table)
    end associate
    largest_turn = 0.0_wp
    do j = 1, points
      call run_cycle(self, release_angle_t(table%angle_at(table%point(j)), here%side), found)
      if (.not. found) return
      if (allocated(self%observer)) call self%observer%observe(self%scout, self%sample, observed)
      call table%take(j, self%sample, observed, self%scout%slider, self%scout%closed_form%grid)
      largest_turn = max(largest_turn, abs(table%coefficient(j, turn)))
    end do
    call table%settle()
    do j = 1, 2
      ! At the largest value of the polynomial that vanishes at the points.
      associate (angle => table%angle_at(sign(cos(pi/real(points, wp)), real(2*j - 3, wp))))
        call run_cycle(self, release_angle_t(angle, here%side), found)
        if (.not. found) return
        measure = measures_of(self%sample, here%side, self%scout%slider)
        expected = table%measures_at(angle)
        inside = max(inside, table%error_inside(self%scout%closed_form%grid, angle, self%sample))
        table%error = max(table%error, abs(measure(duration)/expected(duration) - 1.0_wp), &
          abs(measure(turn) - expected(turn))/largest_turn)
      end associate
    end do
    error = max(table%error, inside*allowed_by(self)/(allowed_inside*self%rtol + allowed_roundoff))
  end subroutine fill_table

  !> The beginning of a table that continues from a release: there, or at the end of the table before, if that is near.
  pure real(wp) function begin_of_table(self, here, way) result(begin)
    class(cycle_survey_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: way
    integer :: i

    ! Cycles that repeat themselves may be on either side of the release.
    begin = here%angle
    if (abs(self%last%turn) < abs(self%before%turn)) begin = here%angle - margin_behind*way
    do i = 1, self%tables
      associate (table => self%table(i), near => 3.0_wp*abs(self%last%turn))
        if (abs(table%velocity - self%velocity) > 0.0_wp .or. table%side*here%side < 0.0_wp) cycle
        if (way < 0.0_wp .and. table%first >= here%angle .and. table%first < max(begin, here%angle + near)) begin = table%first
        if (way > 0.0_wp .and. table%last <= here%angle .and. table%last > min(begin, here%angle - near)) begin = table%last
      end associate
    end do
  end function begin_of_table

  !> Run the full model from a release to the next one into `sample`.
  subroutine run_cycle(self, from, found)
    class(cycle_survey_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: from
    logical, intent(out) :: found
    type(error_t), allocatable :: error
    real(wp) :: longest

    found = .false.
    self%sampled = self%sampled + 1
    call self%sample%clear()
    associate (scout => self%scout, last => self%last)
      longest = patience*last%duration*max(1.0_wp, sin(last%from%angle)/sin(from%angle))
      call place(self, self%velocity, 2.0_wp*longest, from)
      do while (self%sample%count < max_pieces)
        call scout%advance(error)
        if (allocated(error) .or. scout%contact == touches .or. scout%piece%to%time > longest) return
        call self%sample%append(scout%piece)
        if (scout%piece%contact == sticks) exit
      end do
    end associate
    found = is_cycle(self%sample)
  end subroutine run_cycle

  !> Run the full model from a release under this drive velocity [m/s] to the release that is so many releases later.
  subroutine run_releases(self, velocity, from, releases, longest, to, found)
    class(cycle_survey_t), intent(inout) :: self
    real(wp), intent(in) :: velocity
    type(release_angle_t), intent(in) :: from
    integer, intent(in) :: releases
    real(wp), intent(in) :: longest          !! time in which that release has to occur, s
    type(release_angle_t), intent(out) :: to
    logical, intent(out) :: found
    type(error_t), allocatable :: error
    integer :: pieces, left

    found = .false.
    if (.not. allocated(self%scout)) return
    left = releases
    associate (scout => self%scout)
      call place(self, velocity, longest, from)
      do pieces = 1, most_pieces
        call scout%advance(error)
        if (allocated(error) .or. scout%contact == touches .or. scout%finished()) return
        if (scout%piece%contact /= sticks .or. scout%piece%event /= slip_begins) cycle
        left = left - 1
        if (left > 0) cycle
        to = release_at(scout%piece%to%y(2))
        found = .true.
        return
      end do
    end associate
  end subroutine run_releases

  !> Place the scout at a release, with a drive that is steady up to a time [s].
  subroutine place(self, velocity, t_end, from)
    class(cycle_survey_t), intent(inout) :: self
    real(wp), intent(in) :: velocity, t_end
    type(release_angle_t), intent(in) :: from

    associate (scout => self%scout)
      scout%t_end = t_end
      scout%segment = 1
      scout%drive%segment = [drive_segment_t(velocity=velocity)]
      scout%piece%drive = scout%drive%segment(1)
      call scout%place_at_release(from%theta(), state_t())
    end associate
  end subroutine place

  !> The cost of the cycles that were run.
  pure function work(self)
    class(cycle_survey_t), intent(in) :: self
    type(work_count_t) :: work

    work = work_count_t()
    if (.not. allocated(self%scout)) return
    work = self%scout%work()
    work%events = 0
    work%cycles_sampled = self%sampled
  end function work

  !> Save or load; for a scout that does not exist yet, `steps` is the model.
  subroutine serialise_survey(self, archive, steps)
    class(cycle_survey_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    class(slip_stick_t), intent(in) :: steps
    logical :: is_prepared
    integer :: i

    is_prepared = allocated(self%scout)
    call archive%serialise(is_prepared)
    if (is_prepared) then
      call prepare(self, steps)
      call self%scout%serialise(archive)
    end if
    call archive%serialise(self%tables)
    do i = 1, max(0, min(max_tables, self%tables))
      call self%table(i)%serialise(archive)
    end do
    call self%last%serialise(archive)
    call self%before%serialise(archive)
    call archive%serialise(self%slow_period)
    call archive%serialise(self%sampled)
    call archive%serialise(self%asked)
    call archive%serialise(self%hardness)
    call archive%serialise(self%refusals)
    do i = 1, max(0, min(max_refused, self%refusals))
      associate (refusal => self%refused(i))
        call archive%serialise(refusal%velocity)
        call archive%serialise(refusal%side)
        call archive%serialise(refusal%first)
        call archive%serialise(refusal%last)
      end associate
    end do
  end subroutine serialise_survey
end module dst_cycle_survey
