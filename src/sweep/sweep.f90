!> A sweep: many cases of one deck that differ in a few numbers. This module defines and runs a case; it uses no file.
!>
!> Cases are numbered from 1; in a grid the last parameter varies fastest. A case depends on its number alone, so that its result is
!> the same whichever thread, process or machine computes it.
module dst_sweep
  use dst_kinds, only: wp, int64
  use dst_simd_batch, only: simd_batch_t, lane_count
  use dst_deck, only: deck_t
  use dst_deck_sweep, only: varied_key, variation_problem, range_problem, many_cases
  use dst_errors, only: error_t, raise, result_done, deck_error, out_of_memory
  use dst_model_columns, only: gives_column
  use dst_columns, only: columns, find_column, is_default
  use dst_cycles, only: cycle_quantities
  use dst_sampling, only: settle_interval, sample_count
  use dst_scene, only: scene_t, scene_from_deck, set_number
  use dst_schema, only: schema, sweep_group
  use dst_stopwatch, only: wall_clock
  use dst_simulation, only: simulation_t
  use dst_stepper, only: work_count_t
  use dst_summary, only: summary_quantities
  use dst_text, only: integer_text
  use dst_writer, only: writer_t, quantity_t, absent
  implicit none
  private

  public :: sweep_t, axis_t, case_t, watch_t, worker_t, name_axis, new_sweep, new_worker, cases_at_once
  public :: value_count, value_quantities, wall_time_value, table_quantities, series_interval

  !> A parameter and its values: along one side of a grid, or for each case of a list.
  type :: axis_t
    character(40) :: name = ''            !! 'system.misalignment_deg'
    integer :: key = 0                    !! its number in the schema
    real(wp), allocatable :: values(:)    !! in the deck's unit
  end type axis_t

  !> The cases of a deck.
  type :: sweep_t
    type(deck_t) :: deck
    type(axis_t), allocatable :: axes(:)
    logical :: is_list = .false.          !! the axes are columns of a list of cases, not sides of a grid
    !> What a case keeps besides its values: its time series, or its last stick-slip cycles.
    logical :: keeps_series = .false., keeps_cycles = .false.
    real(wp) :: interval = 0.0_wp         !! between the samples of a series, that of the deck itself [s]
    integer :: cases = 0
  contains
    procedure :: coordinates
    procedure :: parameters
    procedure :: table_rows
    procedure :: series_times
  end type sweep_t

  !> The result of a case.
  type :: case_t
    integer :: number = 0
    integer :: result_code = 0
    character(:), allocatable :: result_text          !! '' if done
    real(wp), allocatable :: values(:)                !! as value_quantities; NaN where the case has none
    real(wp), allocatable :: table(:, :)              !! (column, row): samples or cycles; not allocated if none are kept
  end type case_t

  !> Decides whether a case in progress continues; called every `slice`.
  type, abstract :: watch_t
  contains
    procedure(asked_to_stop), deferred :: asked_to_stop
  end type watch_t

  abstract interface
    logical function asked_to_stop(self)
      import :: watch_t
      class(watch_t), intent(inout) :: self
    end function asked_to_stop
  end interface

  !> The data that a thread needs to run cases, one after the other or, with method 'rodas4p', several side by side.
  type :: worker_t
    private
    type(scene_t) :: scene
    !> Cases in progress, 0 if there is room for one; and the wall time at which they began [s].
    integer, allocatable :: number(:)
    real(wp), allocatable :: begun(:)
    type(simd_batch_t), allocatable :: lanes
    integer :: kept = 0                   !! columns of the series besides time; the others are for the last state
    integer :: most_cycles = 0            !! number of cycles that are kept
  contains
    procedure :: has_room
    procedure :: is_idle
    procedure :: begin_case
    procedure :: next_result
  end type worker_t

  !> Wall time between two calls of the watch [s]; number of steps of all lanes between two calls. A process that distributes cases
  !> answers with this delay.
  real(wp), parameter :: slice = 1.0e-3_wp
  integer, parameter :: steps_between_looks = 500

  character(6), parameter :: final_columns(4) = [character(6) :: 'u_x', 'u_y', 'X', 'X_rate']
  integer, parameter :: summary_count = size(summary_quantities)
  integer, parameter :: final_count = size(final_columns)
  !> Summary, last state, number of steps, wall time.
  integer, parameter :: value_count = summary_count + final_count + 2
  integer, parameter :: steps_value = value_count - 1, wall_time_value = value_count

contains

  !> The quantities of `case_t%values`.
  pure function value_quantities() result(quantities)
    type(quantity_t) :: quantities(value_count)
    integer :: i

    quantities(:summary_count) = summary_quantities
    do i = 1, final_count
      associate (quantity => quantities(summary_count + i), column => columns(find_column(final_columns(i))))
        quantity%name = 'final_'//final_columns(i)
        quantity%units = column%units
        quantity%long_name = trim(column%long_name)//' at t_end'
      end associate
    end do
    quantities(steps_value) = quantity_t('steps', '1', 'accepted steps')
    quantities(wall_time_value) = quantity_t('wall_time', 's', 'wall time of the case')
  end function value_quantities

  !> The sweep of a deck that has been checked. `axes` replaces the list of points or the grid if the deck has neither.
  subroutine new_sweep(deck, sweep, error, axes, is_list)
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(out) :: sweep
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), intent(in), optional :: axes(:)
    logical, intent(in), optional :: is_list   !! of `axes`
    real(wp) :: cases
    integer :: i

    if (deck%text_of('scene', 'model') == 'auto') then
      call raise(error, deck_error, "model 'auto' in a sweep would mix models in one map: name the model", 'scene.model')
      return
    end if
    sweep%deck = deck
    sweep%keeps_series = deck%text_of(sweep_group, 'keep') == 'series'
    sweep%keeps_cycles = deck%text_of(sweep_group, 'keep') == 'cycles'
    if (sweep%keeps_series .and. deck%real_of('scene', 'settle') > 0.0_wp) then
      call raise(error, deck_error, "keep 'series' needs the same times in every case: leave scene.settle out", 'scene.settle')
      return
    end if
    if (sweep%keeps_series) sweep%interval = series_interval(deck)
    if (present(axes)) then
      sweep%axes = axes
      sweep%is_list = is_list
      call check_axes(sweep, error)
    else
      call axes_of_deck(deck, sweep%axes, error)
    end if
    if (allocated(error)) return
    cases = 1.0_wp
    do i = 1, merge(min(1, size(sweep%axes)), size(sweep%axes), sweep%is_list)
      cases = cases*real(size(sweep%axes(i)%values), wp)
    end do
    if (cases > many_cases .or. cases < 1.0_wp) then
      call raise(error, deck_error, 'a sweep has from 1 to '//integer_text(int(many_cases))//' cases')
    else
      sweep%cases = nint(cases)
    end if
  end subroutine new_sweep

  !> Interval of the samples of all cases of a deck with keep = 'series' [s].
  real(wp) function series_interval(deck)
    type(deck_t), intent(in) :: deck
    type(scene_t) :: scene

    call scene_from_deck(deck, scene)
    call settle_interval(scene)
    series_interval = scene%interval
  end function series_interval

  !> Check names and values that did not come with the deck.
  subroutine check_axes(sweep, error)
    type(sweep_t), intent(inout) :: sweep
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    integer :: i, j

    do i = 1, size(sweep%axes)
      associate (axis => sweep%axes(i))
        call name_axis(sweep%deck, trim(axis%name), sweep%axes, i, 'varied', problem)
        if (problem == '' .and. sweep%keeps_series .and. axis%name == 'scene.t_end') &
          problem = "keep 'series' needs the same times in every case: do not vary scene.t_end"
        do j = 1, size(axis%values)
          if (problem /= '') exit
          problem = range_problem(axis%key, axis%values(j))
          if (problem /= '') problem = 'value '//integer_text(j)//': '//problem
        end do
      end associate
      if (problem == '') cycle
      call raise(error, deck_error, problem)
      return
    end do
  end subroutine check_axes

  !> Make axis `i` that of the key `name`, which no earlier axis may have.
  subroutine name_axis(deck, name, axes, i, verb, problem)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: name
    type(axis_t), intent(inout) :: axes(:)
    character(*), intent(in) :: verb                    !! what is done to keys in the list from which the name comes
    integer, intent(in) :: i
    character(:), allocatable, intent(out) :: problem   !! '' if there is none

    problem = variation_problem(deck, name)
    if (problem /= '') return
    axes(i)%key = varied_key(name)
    axes(i)%name = trim(schema(axes(i)%key)%group)//'.'//schema(axes(i)%key)%name
    if (any(axes(:i - 1)%key == axes(i)%key)) problem = "'"//trim(axes(i)%name)//"' is "//verb//' twice: name it once'
  end subroutine name_axis

  !> The grid of the group &sweep.
  subroutine axes_of_deck(deck, axes, error)
    type(deck_t), intent(in) :: deck
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    character(256), allocatable :: names(:), spacing(:)
    real(wp), allocatable :: first(:), last(:), counts(:)
    integer :: i

    allocate (names, source=deck%texts_of(sweep_group, 'parameter'))
    allocate (spacing, source=deck%texts_of(sweep_group, 'spacing'))
    first = deck%reals_of(sweep_group, 'first')
    last = deck%reals_of(sweep_group, 'last')
    counts = deck%reals_of(sweep_group, 'count')
    allocate (axes(size(names)))
    do i = 1, size(axes)
      axes(i)%key = varied_key(trim(names(i)))
      axes(i)%name = trim(schema(axes(i)%key)%group)//'.'//schema(axes(i)%key)%name
      call spaced(first(i), last(i), nint(counts(i)), trim(spacing(min(i, size(spacing)))), axes(i)%values, error)
      if (allocated(error)) return
    end do
  end subroutine axes_of_deck

  !> `count` values from `first` to `last`, both exact, at equal distances or in equal ratios.
  pure subroutine spaced(first, last, count, spacing, values, error)
    real(wp), intent(in) :: first, last
    integer, intent(in) :: count
    character(*), intent(in) :: spacing
    real(wp), allocatable, intent(out) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: share
    logical :: wide
    integer :: i, status

    allocate (values(count), stat=status)
    if (status /= 0) then
      call raise(error, out_of_memory, 'no memory for '//integer_text(count)//' values of a parameter: use a smaller count')
      return
    end if
    ! The ratio or the difference of the limits may overflow.
    wide = max(abs(first), abs(last)) > sqrt(huge(first))
    if (spacing == 'log') wide = wide .or. min(abs(first), abs(last)) < sqrt(tiny(first))
    do i = 1, count
      share = real(i - 1, wp)/real(max(1, count - 1), wp)
      if (spacing == 'log' .and. wide) then
        values(i) = sign(exp((1.0_wp - share)*log(abs(first)) + share*log(abs(last))), first)
      else if (spacing == 'log') then
        values(i) = first*(last/first)**share
      else if (wide) then
        values(i) = (1.0_wp - share)*first + share*last
      else
        values(i) = first + (last - first)*share
      end if
    end do
    values(1) = first
    if (count > 1) values(count) = last
  end subroutine spaced

  !> Names of the parameters that vary, separated by blanks.
  pure function parameters(self) result(names)
    class(sweep_t), intent(in) :: self
    character(:), allocatable :: names
    integer :: i

    names = ''
    do i = 1, size(self%axes)
      names = names//trim(self%axes(i)%name)//' '
    end do
    names = trim(names)
  end function parameters

  !> Values of the parameters in a case, each in its deck's unit.
  pure function coordinates(self, number) result(values)
    class(sweep_t), intent(in) :: self
    integer, intent(in) :: number
    real(wp) :: values(size(self%axes))
    integer :: i, rest, place

    rest = number - 1
    do i = size(self%axes), 1, -1
      place = number
      if (.not. self%is_list) then
        place = modulo(rest, size(self%axes(i)%values)) + 1
        rest = rest/size(self%axes(i)%values)
      end if
      values(i) = self%axes(i)%values(place)
    end do
  end function coordinates

  !> Number of samples of a case, or of the cycles that it has at most; 0 if neither are kept.
  pure integer function table_rows(self)
    class(sweep_t), intent(in) :: self

    table_rows = 0
    if (self%keeps_series) &
      table_rows = nint(sample_count(self%deck%real_of('scene', 't_end'), self%interval))
    if (self%keeps_cycles) table_rows = int(self%deck%integer_of(sweep_group, 'cycles'))
  end function table_rows

  !> Times of the samples [s].
  pure function series_times(self) result(times)
    class(sweep_t), intent(in) :: self
    real(wp), allocatable :: times(:)
    integer :: i

    allocate (times(self%table_rows()))
    do i = 1, size(times)
      times(i) = real(i - 1, wp)*self%interval
    end do
    if (size(times) > 0) times(size(times)) = self%deck%real_of('scene', 't_end')
  end function series_times

  !> What is kept of each sample, except time, which is the same in all cases, or of each cycle; nothing if neither are kept.
  function table_quantities(sweep) result(quantities)
    type(sweep_t), intent(in) :: sweep
    type(quantity_t), allocatable :: quantities(:)
    type(worker_t) :: worker
    integer :: i

    if (sweep%keeps_cycles) then
      quantities = cycle_quantities
      return
    end if
    call new_worker(sweep, worker)
    quantities = [(columns(find_column(worker%scene%fields(i))), i=1, worker%kept)]
  end function table_quantities

  !> What one thread needs to run cases of the sweep.
  subroutine new_worker(sweep, worker)
    type(sweep_t), intent(in) :: sweep
    type(worker_t), intent(out) :: worker

    call scene_from_deck(sweep%deck, worker%scene)
    if (sweep%keeps_series) worker%scene%interval = sweep%interval
    call adapt_output(worker%scene, sweep%keeps_series, worker%kept)
    if (sweep%keeps_cycles) worker%most_cycles = sweep%table_rows()
    associate (places => cases_at_once(sweep))
      if (places > 1) allocate (worker%lanes)
      allocate (worker%number(places), worker%begun(places))
    end associate
    worker%number = 0
  end subroutine new_worker

  !> Number of cases that a worker has in progress.
  integer function cases_at_once(sweep)
    type(sweep_t), intent(in) :: sweep

    cases_at_once = merge(lane_count, 1, sweep%deck%text_of('integrator', 'method') == 'rodas4p')
  end function cases_at_once

  pure logical function has_room(self)
    class(worker_t), intent(in) :: self

    has_room = any(self%number == 0)
  end function has_room

  pure logical function is_idle(self)
    class(worker_t), intent(in) :: self

    is_idle = all(self%number == 0)
  end function is_idle

  !> Start case `number`, if there is room.
  subroutine begin_case(self, sweep, number)
    class(worker_t), intent(inout) :: self
    type(sweep_t), intent(in) :: sweep
    integer, intent(in) :: number
    real(wp) :: coordinates(size(sweep%axes))
    integer :: i, place

    place = findloc(self%number, 0, dim=1)
    self%number(place) = number
    self%begun(place) = wall_clock()
    coordinates = sweep%coordinates(number)
    do i = 1, size(coordinates)
      call set_number(self%scene, trim(schema(sweep%axes(i)%key)%name), coordinates(i))
    end do
    if (allocated(self%lanes)) call self%lanes%put_case(place, self%scene)
  end subroutine begin_case

  !> Continue until a case is done. If the watch asks to stop first, `done` is false and all cases in progress are discarded.
  subroutine next_result(self, watch, result, done)
    class(worker_t), intent(inout) :: self
    class(watch_t), intent(inout) :: watch
    type(case_t), intent(inout) :: result
    logical, intent(out) :: done
    type(error_t), allocatable :: error
    integer :: place

    result%values = spread(absent(), 1, value_count)
    place = 1
    if (allocated(self%lanes)) then
      call run_lanes(self%lanes, watch, place, done)
      if (done) call take_lane(self%lanes, place, self%most_cycles, result, error)
    else
      call run_case(self%scene, self%kept, self%most_cycles, watch, result, done, error)
    end if
    if (.not. done) return
    result%number = self%number(place)
    ! Cases side by side share the time.
    result%values(wall_time_value) = (wall_clock() - self%begun(place))/real(size(self%number), wp)
    result%result_code = result_done
    result%result_text = ''
    if (allocated(error)) then
      result%result_code = error%code
      result%result_text = error%text
    end if
    self%number(place) = 0
  end subroutine next_result

  !> Continue all lanes until one is done; `place` is the first of these.
  subroutine run_lanes(lanes, watch, place, done)
    type(simd_batch_t), intent(inout) :: lanes
    class(watch_t), intent(inout) :: watch
    integer, intent(out) :: place
    logical, intent(out) :: done
    integer :: i

    do
      do i = 1, steps_between_looks
        place = findloc(lanes%done, .true., dim=1)
        done = place > 0
        if (done) return
        call lanes%advance()
      end do
      if (watch%asked_to_stop()) return
    end do
  end subroutine run_lanes

  !> The result of the case in a lane.
  subroutine take_lane(lanes, place, most_cycles, result, error)
    type(simd_batch_t), intent(inout) :: lanes
    integer, intent(in) :: place, most_cycles
    type(case_t), intent(inout) :: result
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: final(final_count)
    integer(int64) :: steps

    associate (values => result%values)
      call lanes%values(place, values(:summary_count), final, steps, error)
      if (.not. allocated(error)) values(summary_count + 1:summary_count + final_count) = final
      values(steps_value) = real(steps, wp)
    end associate
    if (most_cycles > 0) result%table = lanes%summary(place)%kept_cycles(most_cycles)
  end subroutine take_lane

  !> Run one case.
  subroutine run_case(scene, kept, most_cycles, watch, result, done, error)
    type(scene_t), intent(inout) :: scene
    integer, intent(in) :: kept           !! columns of the series
    integer, intent(in) :: most_cycles    !! number of cycles that are kept
    class(watch_t), intent(inout) :: watch
    type(case_t), intent(inout) :: result
    logical, intent(out) :: done
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(writer_t) :: writer
    type(work_count_t) :: work
    integer :: i, column

    if (allocated(result%table)) deallocate (result%table)
    if (.not. (kept > 0 .or. scene%is_closed_form())) scene%interval = scene%t_end
    call simulation%start(scene, error)
    done = allocated(error)
    if (done) return
    do while (.not. done)
      call simulation%proceed(slice, writer, error)
      ! The events that a case keeps are in the summary.
      writer%events = 0
      done = simulation%finished .or. allocated(error)
      if (done) exit
      if (watch%asked_to_stop()) return
    end do
    call simulation%summary%values(simulation%motion, result%values(:summary_count))
    if (.not. simulation%motion%in_closed_form) then
      work = simulation%motion%work()
      result%values(steps_value) = real(work%steps, wp)
    end if
    if (writer%rows > 0 .and. .not. allocated(error)) then
      do i = 1, final_count
        do column = 1, size(simulation%selected)
          if (columns(simulation%selected(column))%name == final_columns(i)) &
            result%values(summary_count + i) = writer%samples(column, writer%rows)
        end do
      end do
    end if
    if (kept > 0) result%table = writer%samples(2:kept + 1, :writer%rows)
    if (most_cycles > 0) result%table = simulation%summary%kept_cycles(most_cycles)
  end subroutine run_case

  !> The columns contain the last state, and the limit is that of the sweep. A summary needs no series, except for the largest
  !> velocity of slow creep: creep is known in closed form, and its samples are searched for this velocity.
  subroutine adapt_output(scene, keeps_series, kept)
    type(scene_t), intent(inout) :: scene
    logical, intent(in) :: keeps_series
    integer, intent(out) :: kept          !! columns of the series
    integer :: i

    scene%wall_limit = 0.0_wp
    if (.not. keeps_series) then
      deallocate (scene%fields)
      allocate (scene%fields(0))
    else if (scene%fields(1) == 'default') then
      ! The damping ratio does not exist in every case; it can be computed from theta.
      scene%fields = pack(columns%name, columns%name /= 'time' .and. columns%name /= 'zeta' .and. is_default(columns%name) &
        .and. gives_column(scene%model, columns%name))
    end if
    kept = size(scene%fields)
    do i = 1, final_count
      if (.not. gives_column(scene%model, final_columns(i))) cycle
      if (all(scene%fields /= final_columns(i))) &
        scene%fields = [character(len(scene%fields)) :: scene%fields, final_columns(i)]
    end do
  end subroutine adapt_output
end module dst_sweep
