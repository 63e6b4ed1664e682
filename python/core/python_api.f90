!> The one flat file for f2py: decks, runs and sweeps by handle, and functions of the theory for arrays.
!>
!> Texts are passed in as arrays of single characters, since f2py cuts a longer one at a NUL; texts that are returned are UTF-8.
!> Objects on the heap are accessed by handles and asked by name; each answer is a text and an array of numbers. There is no module
!> state, so different runs may proceed in different threads. Status 0 is success, otherwise a code of dst_errors.
module dst_python_api
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use, intrinsic :: iso_c_binding, only: c_double, c_int, c_long_long, c_loc, c_f_pointer, c_intptr_t, c_null_ptr
  use dst_assembly, only: slider_from_scene
  use dst_build_info, only: version, git_revision, compiler, build_flags
  use dst_catalogue, only: catalogue
  use dst_machine, only: host_name, job_name
  use dst_kinds, only: wp, int64
  use dst_creep, only: creep_t, creep_path_t, new_creep_path, creep_at, creep_asymptotic
  use dst_cycles, only: cycle_quantities
  use dst_deck, only: deck_t, parse_deck, resolved
  use dst_creep_end, only: creep_end_t, creep_end
  use dst_columns, only: columns
  use dst_deck_values, only: element_count
  use dst_derivatives, only: derivatives_t
  use dst_errors, only: error_t, raise, usage_error
  use dst_faults, only: not_all_faults
  use dst_friction, only: new_friction_law
  use dst_full_model, only: full_smoothed_t, new_full_smoothed
  use dst_limit_cycles, only: limit_cycles_t, limit_cycle_quantities, find_limit_cycles, find_return, return_values
  use dst_model_choice, only: settle_model
  use dst_parameters, only: parameter_t, parameters_of
  use dst_sampling, only: sampling_note
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema, key_count, is_automatic, integer_kind, real_kind, reals_kind
  use dst_scene_notes, only: stiffness_note
  use dst_sensitivity, only: sensitivity_t, find_sensitivity
  use dst_settling, only: settling_t
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: stage_terms_t, new_terms
  use dst_stability, only: critical_t, steady_sliding_eigenvalues, critical_misalignment, low_frequency_limit, &
                           damping_scale, damping_ratio, weakening_damping_ratio
  use dst_stability_report, only: held_velocities
  use dst_sweep, only: sweep_t, axis_t, case_t, watch_t, worker_t, new_sweep, new_worker, cases_at_once, value_quantities, &
    table_quantities
  use dst_sweep_points, only: read_points
  use dst_text, only: text_builder_t, integer_text, printable, short_text
  use dst_writer, only: writer_t, quantity_t, outcome_t
  implicit none
  private

  public :: make, proceed, ask, answer, release
  public :: run_state, run_samples, sweep_run, sweep_stop
  public :: evaluate

  !> What parts the rows of an answer, and the cells of a row: no deck has the second one.
  character, parameter :: nl = new_line('a'), bar = achar(31)

  !> The parameters of a slider in the order of the vectors that the routines for arrays use: in SI units.
  character(*), parameter :: slider_parameters(12) = [character(12) :: 'mass', 'stiffness_x', 'stiffness_y', 'misalignment', &
    'mu_0', 'mu_inf', 'v_f', 'normal_load', 'velocity', 'v_smooth', 'damping_x', 'damping_y']

  !> The object of a handle: the library itself, a deck, or one of the types below.
  type :: session_t
    type(error_t), allocatable :: error
    type(deck_t), allocatable :: deck
    character(:), allocatable :: text        !! of the last answer
    real(wp), allocatable :: number(:, :)    !! of the last answer (column, row)
  contains
    procedure :: reply
  end type session_t

  !> A run with everything that Python may need of it.
  type, extends(session_t) :: run_t
    type(simulation_t) :: simulation
    type(writer_t) :: writer
    character(:), allocatable :: model_choice
  contains
    procedure :: reply => reply_of_run
  end type run_t

  !> A sweep. Its threads only read it, except `stop`; each copies the worker, which is made under the interpreter's lock.
  type, extends(session_t) :: sweep_session_t
    type(sweep_t) :: sweep
    type(worker_t) :: worker
    logical :: stop = .false.
  contains
    procedure :: reply => reply_of_sweep
  end type sweep_session_t

  !> What was found of the settled motion, the cycles or the steady sliding of a scene.
  type, extends(session_t) :: cycles_session_t
    type(limit_cycles_t) :: cycles
    type(sensitivity_t) :: sensitivity
    type(derivatives_t) :: derivatives
    type(settling_t) :: settling
    real(wp), allocatable :: found(:)        !! the answer 'found'
  contains
    procedure :: reply => reply_of_cycles
  end type cycles_session_t

  !> The target of a handle. (f2py cannot parse a `select type` in it.)
  type :: holder_t
    class(session_t), pointer :: session => null()
    type(run_t), pointer :: run => null()
    type(sweep_session_t), pointer :: sweep => null()
    type(cycles_session_t), pointer :: cycles => null()
  end type holder_t

  type, extends(watch_t) :: stop_watch_t
    type(sweep_session_t), pointer :: session => null()
  contains
    procedure :: asked_to_stop
  end type stop_watch_t

contains

  !> Make the object of a handle, which is valid until `release`, also on failure; then the answer 'message' says why, and
  !> 'faults' where (line, setting). All but the library read a deck: its text, its name for messages, and its overrides
  !> 'group.key=value', one in each line. What they need beside it is in `words` and `numbers`:
  !>
  !> * 'library': answers that do not depend on a deck, 'slider', 'catalogue' and 'origin'.
  !> * 'deck': a deck of which each value is checked against its own key only.
  !> * 'run': a run from its beginning; with numbers, its samples are at these times [s] between 0 and the end, and at both.
  !> * 'sweep': the cases for the parameters that are varied, their names in the lines of `words`. The numbers are 1 if the values
  !>   of a case have the same place, else 0, then how many values each has, then all values, one after the other. Without names the
  !>   deck's own &sweep is used.
  !> * 'cycles': the limit cycles in the model `words` or, if that is blank, in the deck's own.
  !> * 'return': where the motion in that model returns to; the numbers are the place and how many slow cycles later.
  !> * 'sensitivity': that of the settled motion to the keys GROUP.KEY in `words`, with blanks between them.
  !> * 'derivatives': those of the run with respect to these keys, not yet begun; the numbers are times [s], or none for those of
  !>   its samples.
  !> * 'settling': the motion from rest, not yet begun.
  !> * 'steady': the linear theory of steady sliding; its answer 'found' is the velocity [m/s], the misalignment [rad], and the
  !>   values of `evaluate` for 'eigenvalues' and 'critical'.
  !>
  !> Cycles, sensitivity, settling and steady sliding are those under the only drive velocity that is kept for some time and is not
  !> 0.
  subroutine make(what, n_deck, deck, n_name, name, n_settings, settings, n_words, words, n_numbers, numbers, handle, status)
    character(len=*), intent(in) :: what
    integer(c_int), intent(in) :: n_deck, n_name, n_settings, n_words, n_numbers
    character(len=1), intent(in) :: deck(n_deck), name(n_name), settings(n_settings), words(n_words)
    real(c_double), intent(in) :: numbers(n_numbers)
    integer(c_long_long), intent(out) :: handle
    integer(c_int), intent(out) :: status
    ! Not f2py threadsafe: gfortran keeps lengths of text results in static storage, so decks are read one at a time, under the
    ! interpreter's lock.
    type(holder_t), pointer :: holder
    real(wp), allocatable :: given(:)
    integer :: i

    allocate (holder)
    handle = int(transfer(c_loc(holder), 0_c_intptr_t), c_long_long)
    select case (what)
    case ('library', 'deck')
      allocate (holder%session)
    case ('run')
      allocate (holder%run)
      holder%session => holder%run
    case ('sweep')
      allocate (holder%sweep)
      holder%session => holder%sweep
    case default
      allocate (holder%cycles)
      holder%session => holder%cycles
    end select
    status = 0
    if (what == 'library') return
    call read_deck(holder%session, text_of(deck), text_of(name), text_of(settings), what == 'deck', &
      what == 'sweep' .and. n_words > 0)
    status = status_of(holder%session)
    if (status /= 0) return
    ! Very many numbers have no room on the stack.
    allocate (given(size(numbers)))
    do i = 1, size(numbers)
      given(i) = real(numbers(i), wp)
    end do
    if (associated(holder%run)) call begin_run(holder%run, given)
    if (associated(holder%sweep)) call list_cases(holder%sweep, lines_of(text_of(words)), given)
    if (associated(holder%cycles)) call find(what, holder%cycles, text_of(words), given)
    status = status_of(holder%session)
  end subroutine make

  subroutine begin_run(self, times)
    type(run_t), intent(inout) :: self
    real(wp), intent(in) :: times(:)
    type(scene_t) :: scene

    if (self%deck%is_sweep()) then
      call raise(self%error, usage_error, &
        'the deck has a &sweep of many cases: use dynstiction.sweep, or remove the group')
      return
    end if
    call scene_from_deck(self%deck, scene)
    call settle_model(scene, self%model_choice)
    if (size(times) > 0) then
      ! They take the place of samples at intervals, not of those of each step.
      if (.not. abs(scene%interval) > 0.0_wp) scene%interval = scene%t_end
      self%simulation%instants = [0.0_wp, pack(times, times > 0.0_wp .and. times < scene%t_end), scene%t_end]
    end if
    call self%simulation%start(scene, self%error)
  end subroutine begin_run

  subroutine list_cases(self, names, numbers)
    type(sweep_session_t), intent(inout) :: self
    character(*), intent(in) :: names(:)
    real(wp), intent(in) :: numbers(:)
    type(axis_t), allocatable :: given(:)
    integer :: i, first, length

    if (size(names) > 0) then
      allocate (given(size(names)))
      first = 2 + size(given)
      do i = 1, size(given)
        length = nint(numbers(1 + i))
        given(i)%name = names(i)
        given(i)%values = numbers(first:first + length - 1)
        first = first + length
      end do
      call new_sweep(self%deck, self%sweep, self%error, given, numbers(1) > 0.0_wp)
    else if (self%deck%text_of('sweep', 'points') /= '') then
      call read_points(self%deck, given, self%error)
      if (.not. allocated(self%error)) call new_sweep(self%deck, self%sweep, self%error, given, .true.)
    else if (self%deck%is_sweep()) then
      call new_sweep(self%deck, self%sweep, self%error)
    else
      call raise(self%error, usage_error, 'nothing is varied: give parameters, or a deck with &sweep')
    end if
    if (.not. allocated(self%error)) call new_worker(self%sweep, self%worker)
  end subroutine list_cases

  !> Find `what` of `make`, or begin with it.
  subroutine find(what, self, words, numbers)
    character(*), intent(in) :: what, words
    type(cycles_session_t), intent(inout) :: self
    real(wp), intent(in) :: numbers(:)
    type(scene_t) :: scene
    real(wp), allocatable :: velocities(:)

    call scene_from_deck(self%deck, scene)
    if (what == 'derivatives') then
      call self%derivatives%start(self%deck, scene, words, numbers, self%error)
      return
    end if
    if ((what == 'cycles' .or. what == 'return') .and. words /= '') scene%model = words
    call held_velocities(scene, velocities, self%error)
    if (allocated(self%error)) then
      self%error%code = usage_error
      return
    end if
    if (size(velocities) > 1) then
      call raise(self%error, usage_error, 'the drive holds several velocities, '//trim(short_text(velocities(1)))//' and '// &
        trim(short_text(velocities(2)))//' m/s among them: give one, as drive={"time": None, "velocity": V}')
      return
    end if
    select case (what)
    case ('cycles')
      call find_limit_cycles(scene, velocities(1), self%cycles, self%error)
    case ('return')
      allocate (self%found(return_values), source=0.0_wp)
      call find_return(scene, velocities(1), numbers(1), nint(numbers(2)), self%found, self%error)
    case ('sensitivity')
      call find_sensitivity(self%deck, scene, velocities(1), words, self%sensitivity, self%error)
    case ('settling')
      call self%settling%start(scene, velocities(1), self%error)
    case ('steady')
      call find_steady(self, scene, velocities(1))
    end select
  end subroutine find

  subroutine find_steady(self, scene, velocity)
    type(cycles_session_t), intent(inout) :: self
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(slider_t) :: slider
    complex(wp) :: roots(4)
    real(wp) :: critical(9)

    if (.not. (scene%mass > 0.0_wp .and. scene%stiffness_y > 0.0_wp)) then
      call raise(self%error, usage_error, 'the linear theory of steady sliding needs a mass and both stiffnesses, which model '// &
                 "'"//trim(scene%model)//"' does not have: give a scene of model 'full'")
      return
    end if
    call slider_from_scene(scene, slider)
    call steady_sliding_eigenvalues(slider, velocity, roots, self%error)
    if (.not. allocated(self%error)) call critical_values(slider, velocity, critical, self%error)
    if (allocated(self%error)) return
    allocate (self%found, source=[velocity, atan2(slider%along(2), slider%along(1)), real(roots, wp), aimag(roots), critical])
  end subroutine find_steady

  !> Continue for at most `seconds` of wall time [s]: with derivatives, with the motion from rest, or with a run until it has
  !> `reached` the simulated time `until` [s]. `time` [s] is how far it has come, `status` the result code of a run that has ended.
  subroutine proceed(handle, seconds, until, finished, reached, time, status)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: seconds, until
    integer(c_int), intent(out) :: finished, reached, status
    real(c_double), intent(out) :: time
    !f2py threadsafe
    type(holder_t), pointer :: held
    logical :: is_finished, has_reached

    held => holder_of(handle)
    has_reached = .false.
    time = 0.0_c_double
    if (associated(held%run)) then
      associate (simulation => held%run%simulation)
        if (.not. simulation%finished) &
          call simulation%proceed(real(seconds, wp), held%run%writer, held%run%error, until=real(until, wp))
        is_finished = simulation%finished
        has_reached = simulation%has_reached(real(until, wp))
        time = real(simulation%motion%piece%to%time, c_double)
      end associate
    else if (allocated(held%cycles%derivatives%key)) then
      call held%cycles%derivatives%proceed(real(seconds, wp), held%cycles%error)
      is_finished = held%cycles%derivatives%is_finished
    else
      call held%cycles%settling%proceed(real(seconds, wp), held%cycles%error)
      is_finished = held%cycles%settling%is_finished
    end if
    finished = merge(1_c_int, 0_c_int, is_finished)
    reached = merge(1_c_int, 0_c_int, has_reached)
    status = status_of(held%session)
  end subroutine proceed

  !> Texts as arguments of their own: gfortran 12 mistakes the length of a text function inside another one in a call.
  subroutine read_deck(session, text, name, settings, alone, is_varied)
    class(session_t), intent(inout) :: session
    character(*), intent(in) :: text, name, settings
    logical, intent(in) :: alone, is_varied

    allocate (session%deck)
    call parse_deck(text, name, lines_of(settings), session%deck, session%error, alone, is_varied)
  end subroutine read_deck

  integer(c_int) function status_of(session)
    class(session_t), intent(in) :: session

    status_of = 0
    if (allocated(session%error)) status_of = int(session%error%code, c_int)
  end function status_of

  !> Ask for `which`: how many bytes, columns and rows the answer has.
  subroutine ask(handle, which, n_bytes, n_columns, n_rows)
    integer(c_long_long), intent(in) :: handle
    character(len=*), intent(in) :: which
    integer(c_int), intent(out) :: n_bytes, n_columns, n_rows
    type(holder_t), pointer :: held
    type(text_builder_t) :: text

    held => holder_of(handle)
    call give(held%session, reshape([real(wp) ::], [0, 0]))
    call held%session%reply(which, text)
    held%session%text = text%content()
    n_bytes = int(len(held%session%text), c_int)
    n_columns = int(size(held%session%number, 1), c_int)
    n_rows = int(size(held%session%number, 2), c_int)
  end subroutine ask

  !> The answer for which was asked last: its text, and its numbers (column, row).
  subroutine answer(handle, n_bytes, n_columns, n_rows, text, numbers)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_bytes, n_columns, n_rows
    character(len=n_bytes), intent(out) :: text
    real(c_double), intent(out) :: numbers(n_columns, n_rows)
    type(holder_t), pointer :: held

    held => holder_of(handle)
    text = held%session%text
    numbers = real(held%session%number, c_double)
  end subroutine answer

  !> Free the object of a handle; the handle is invalid afterwards.
  subroutine release(handle)
    integer(c_long_long), intent(in) :: handle
    type(holder_t), pointer :: held

    held => holder_of(handle)
    deallocate (held%session)
    deallocate (held)
  end subroutine release

  !> The target of a handle: the number is its address.
  function holder_of(handle) result(holder)
    integer(c_long_long), intent(in) :: handle
    type(holder_t), pointer :: holder

    call c_f_pointer(transfer(int(handle, c_intptr_t), c_null_ptr), holder)
  end function holder_of

  !> Numbers for an answer.
  subroutine give(self, number)
    class(session_t), intent(inout) :: self
    real(wp), intent(in) :: number(:, :)

    ! Not by assignment: gfortran 12 writes beside a component.
    if (allocated(self%number)) deallocate (self%number)
    allocate (self%number, source=number)
  end subroutine give

  !> Room for so many numbers of an answer, all 0. Many are put there one by one: array constructors are on the stack.
  subroutine make_room(self, columns, rows)
    class(session_t), intent(inout) :: self
    integer, intent(in) :: columns, rows

    if (allocated(self%number)) deallocate (self%number)
    allocate (self%number(columns, rows), source=0.0_wp)
  end subroutine make_room

  !> What a writer has kept, in rows of this length, for an answer.
  subroutine give_kept(self, writer, length)
    class(session_t), intent(inout) :: self
    type(writer_t), intent(in) :: writer
    integer, intent(in) :: length

    if (writer%rows > 0) then
      call give(self, writer%samples(:, :writer%rows))
    else
      call give(self, reshape([real(wp) ::], [length, 0]))
    end if
  end subroutine give_kept

  !> Numbers for an answer, in one row.
  subroutine give_row(self, number)
    class(session_t), intent(inout) :: self
    real(wp), intent(in) :: number(:)

    call give(self, reshape(number, [size(number), 1]))
  end subroutine give_row

  !> Quantities and their numbers (column, row) for an answer.
  subroutine describe(self, text, quantities, number)
    class(session_t), intent(inout) :: self
    type(text_builder_t), intent(inout) :: text
    type(quantity_t), intent(in) :: quantities(:)
    real(wp), intent(in), optional :: number(:, :)
    integer :: i

    do i = 1, size(quantities)
      call text%line(row_of(quantities(i)))
    end do
    if (present(number)) then
      call give(self, number)
    else
      call give(self, reshape([real(wp) ::], [0, size(quantities)]))
    end if
  end subroutine describe

  !> Name, unit and meaning.
  pure function row_of(quantity) result(row)
    type(quantity_t), intent(in) :: quantity
    character(:), allocatable :: row

    row = trim(quantity%name)//bar//trim(quantity%units)//bar//trim(quantity%long_name)
  end function row_of

  subroutine list(text, names)
    type(text_builder_t), intent(inout) :: text
    character(*), intent(in) :: names(:)
    integer :: i

    do i = 1, size(names)
      call text%line(names(i))
    end do
  end subroutine list

  !> Answers of every session: 'message', 'resolved' (deck), 'catalogue' (commands, options, keys, columns, ... as JSON), in the
  !> lines of 'origin' the source and the build of the core, the host of this process, and the name that the scheduler gives the
  !> job; 'slider' (names), 'faults' (line, setting), and for a deck 'values'.
  subroutine reply(self, which, text)
    class(session_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(text_builder_t), intent(inout) :: text
    integer :: i

    select case (which)
    case ('message')
      if (allocated(self%error)) call text%append(self%error%text)
    case ('resolved')
      call text%append(resolved(self%deck))
    case ('catalogue')
      call text%append(catalogue(version))
    case ('origin')
      call text%append(version//nl//git_revision//nl//compiler//nl//build_flags//nl//host_name()//nl//job_name())
    case ('slider')
      call list(text, slider_parameters)
    case ('faults')
      associate (faults => self%deck%faults)
        do i = 1, faults%count
          call text%line(printable(trim(faults%item(i)%text)))
        end do
        if (faults%full()) call text%line(not_all_faults)
        call give(self, reshape(real([(faults%item(i)%place%line, faults%item(i)%place%setting, i=1, faults%count), &
          (0, 0, i=1, merge(1, 0, faults%full()))], wp), [2, faults%count + merge(1, 0, faults%full())]))
      end associate
    case ('values')
      call reply_values(self, text)
    end select
  end subroutine reply

  !> GROUP.KEY and value of every key that is set: a text, or a number. A list has a row for each of its values.
  subroutine reply_values(self, text)
    class(session_t), intent(inout) :: self
    type(text_builder_t), intent(inout) :: text
    character(:), allocatable :: word
    integer :: counts(key_count), i, k, row

    counts = [(element_count(self%deck%value(i)), i=1, key_count)]
    where (.not. self%deck%value%user) counts = 0
    call make_room(self, 1, sum(counts))
    row = 0
    do i = 1, key_count
      do k = 1, counts(i)
        row = row + 1
        word = ''
        select case (schema(i)%kind)
        case (integer_kind)
          word = integer_text(nint(self%deck%value(i)%reals(k), int64))
        case (real_kind, reals_kind)
          self%number(1, row) = self%deck%value(i)%reals(k)
          if (is_automatic(schema(i), self%number(1, row))) word = schema(i)%choices
        case default
          word = self%deck%value(i)%texts(k)
        end select
        call text%line(trim(schema(i)%group)//'.'//trim(schema(i)%name)//bar//word)
      end do
    end do
  end subroutine reply_values

  !> Also 'about', whose lines are the model, the method, why model 'auto' was taken as it, what the samples will not show, why the
  !> method is slow, and then the resolved deck; 'columns', 'parameters', in which a text has the second number 1, the 'ending' as
  !> far as the run has proceeded: the summary, whose second numbers are -1, and counters (1) and other numbers (0) of the work; and
  !> the 'events' so far: time [s], kind (1 = stick begins, 2 = slip begins), how often it occurs, and its period [s]; 'rows', the
  !> number of samples.
  subroutine reply_of_run(self, which, text)
    class(run_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(text_builder_t), intent(inout) :: text
    type(parameter_t), allocatable :: parameters(:)
    type(outcome_t) :: outcome
    integer :: i

    select case (which)
    case ('about')
      associate (scene => self%simulation%scene)
        call text%append(trim(scene%model)//nl//trim(scene%method_name())//nl//self%model_choice//nl//sampling_note(scene)//nl// &
          stiffness_note(scene, 1.0_wp)//nl//resolved(self%deck))
      end associate
    case ('columns')
      call describe(self, text, self%simulation%output_columns())
    case ('parameters')
      call parameters_of(self%deck, parameters, self%simulation%scene%interval)
      call make_room(self, 2, size(parameters))
      do i = 1, size(parameters)
        self%number(:, i) = [parameters(i)%value, merge(1.0_wp, 0.0_wp, allocated(parameters(i)%text))]
        if (.not. allocated(parameters(i)%text)) parameters(i)%text = ''
        call text%line(row_of(parameters(i)%quantity)//bar//parameters(i)%text)
      end do
    case ('ending')
      call self%simulation%outcome(self%error, outcome)
      associate (values => [outcome%summary_value, outcome%statistics_value])
        call describe(self, text, [outcome%summary, outcome%statistics], transpose(reshape([values, &
          [(-1.0_wp, i=1, size(outcome%summary))], merge(1.0_wp, 0.0_wp, outcome%statistics%counts)], [size(values), 2])))
      end associate
    case ('events')
      associate (log => self%writer%log(1:self%writer%events))
        call make_room(self, 4, size(log))
        do i = 1, size(log)
          self%number(:, i) = [log(i)%time, real(log(i)%kind, wp), real(log(i)%occurs, wp), log(i)%period]
        end do
      end associate
    case ('rows')
      call give_row(self, [real(self%writer%rows, wp)])
    case default
      call self%session_t%reply(which, text)
    end select
  end subroutine reply_of_run

  !> The 'resolved' deck is that of the sweep, with the values that it determines; also its 'size' (cases, how many of them run side
  !> by side, and whether it is a list), 'axes' with the numbers of their values, the values of all 'points', one axis after the
  !> other, 'quantities' of a case, those of its 'cycles', with the number of cycles that are kept, and 'stiffness_note'.
  subroutine reply_of_sweep(self, which, text)
    class(sweep_session_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(text_builder_t), intent(inout) :: text
    type(scene_t) :: scene
    integer :: i, n

    associate (axes => self%sweep%axes)
      select case (which)
      case ('resolved')
        call text%append(resolved(self%sweep%deck))
      case ('stiffness_note')
        call scene_from_deck(self%sweep%deck, scene)
        call text%append(stiffness_note(scene, real(self%sweep%cases, wp)))
      case ('size')
        call give_row(self, real([self%sweep%cases, cases_at_once(self%sweep), merge(1, 0, self%sweep%is_list)], wp))
      case ('axes')
        call describe(self, text, [(quantity_t(axes(i)%name, schema(axes(i)%key)%unit, schema(axes(i)%key)%meaning), &
          i=1, size(axes))], reshape(real([(size(axes(i)%values), i=1, size(axes))], wp), [1, size(axes)]))
      case ('points')
        call make_room(self, sum([(size(axes(i)%values), i=1, size(axes))]), 1)
        n = 0
        do i = 1, size(axes)
          self%number(n + 1:n + size(axes(i)%values), 1) = axes(i)%values
          n = n + size(axes(i)%values)
        end do
      case ('quantities')
        call describe(self, text, value_quantities())
      case ('cycles')
        if (self%sweep%keeps_cycles) then
          associate (quantities => table_quantities(self%sweep))
            call describe(self, text, quantities, spread(spread(real(self%sweep%table_rows(), wp), 1, 1), 2, size(quantities)))
          end associate
        end if
      case default
        call self%session_t%reply(which, text)
      end select
    end associate
  end subroutine reply_of_sweep

  !> Also 'model', 'cycle_quantities', the values of all 'cycles' (a row for each, the last value says whether it is stable), its
  !> 'verdict' (with exponent, error, slow cycles, cycles, repeats, searched; then the load of steady sliding, whether that is
  !> stable, the velocity, the error of the model) and the 'eigenvalues' of steady sliding, 'regularity' (mean and scatter of each
  !> quantity), 'sensitivity', of each measure of the cycle the value and the derivatives with respect to the 'parameters',
  !> 'columns', 'samples' and 'events' of a run with derivatives, 'settling' (F_0, the swing of the load, and that from which on it
  !> is stick-slip [N]), and the row 'found'.
  subroutine reply_of_cycles(self, which, text)
    class(cycles_session_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(text_builder_t), intent(inout) :: text
    integer :: i, n

    associate (cycles => self%cycles, regularity => self%cycles%regularity, derivatives => self%derivatives)
      select case (which)
      case ('model')
        call text%append(cycles%model)
      case ('cycle_quantities')
        call describe(self, text, limit_cycle_quantities)
      case ('cycles')
        n = size(limit_cycle_quantities) + 1
        call give(self, reshape([(cycles%value(:, i), merge(1.0_wp, 0.0_wp, cycles%is_stable(i)), i=1, cycles%number())], &
          [n, cycles%number()]))
      case ('eigenvalues')
        call give_row(self, [real(cycles%eigenvalues, wp), aimag(cycles%eigenvalues)])
      case ('regularity')
        call describe(self, text, cycle_quantities, &
          transpose(reshape([regularity%mean, regularity%scatter], [size(cycle_quantities), 2])))
      case ('verdict')
        call give_row(self, [real(regularity%verdict, wp), regularity%exponent, regularity%error, &
          real([regularity%slow_cycles, regularity%cycles, regularity%repeats, regularity%searched], wp), &
          cycles%sliding_load, merge(1.0_wp, 0.0_wp, cycles%sliding_is_stable), cycles%velocity, cycles%error])
      case ('sensitivity')
        associate (derivative => self%sensitivity%derivative)
          call describe(self, text, cycle_quantities, &
            transpose(reshape([self%sensitivity%value, derivative], [size(derivative, 1), 1 + size(derivative, 2)])))
        end associate
      case ('columns')
        call describe(self, text, columns(derivatives%selected))
      case ('samples')
        call give_kept(self, derivatives%samples, size(derivatives%selected)*(1 + size(derivatives%key)))
      case ('events')
        call give_kept(self, derivatives%events, 2 + size(derivatives%key))
      case ('parameters')
        if (allocated(derivatives%key)) then
          call list(text, derivatives%key)
          call give(self, reshape(derivatives%parameter, [1, size(derivatives%parameter)]))
        else
          call list(text, self%sensitivity%key)
          call give(self, reshape(self%sensitivity%parameter, [1, size(self%sensitivity%parameter)]))
        end if
      case ('settling')
        call give_row(self, [self%settling%limit, self%settling%swing, self%settling%least()])
      case ('found')
        call give_row(self, self%found)
      case default
        call self%session_t%reply(which, text)
      end select
    end associate
  end subroutine reply_of_cycles

  !> The values of a sample at `time` [s], within the last advance.
  subroutine run_state(handle, time, n_columns, state)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: time
    integer(c_int), intent(in) :: n_columns
    real(c_double), intent(out) :: state(n_columns)
    type(holder_t), pointer :: held
    real(wp) :: row(n_columns)

    held => holder_of(handle)
    call held%run%simulation%state_at(real(time, wp), row)
    state = real(row, c_double)
  end subroutine run_state

  !> The samples so far (row, column).
  subroutine run_samples(handle, n_rows, n_columns, samples)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_rows, n_columns
    real(c_double), intent(inout) :: samples(n_rows, n_columns)   !! f2py would clear one that is made here, which takes as long
    type(holder_t), pointer :: held
    !> Number of rows that fit into a processor's cache: if all were transposed at once, this would take longer than the rest of
    !> Python's work.
    integer, parameter :: block_rows = 128
    integer :: from, to

    held => holder_of(handle)
    do from = 1, n_rows, block_rows
      to = min(from + block_rows - 1, int(n_rows))
      samples(from:to, :) = transpose(real(held%run%writer%samples(:, from:to), c_double))
    end do
  end subroutine run_samples

  !> Run the cases `first` to `first + n - 1`: values (value, case), cycles (quantity, cycle, case) with their numbers, result
  !> codes (-1: not run) and messages.
  subroutine sweep_run(handle, first, n, n_values, n_columns, n_rows, values, cycles, counts, codes, messages)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: first, n, n_values, n_columns, n_rows
    real(c_double), intent(out) :: values(n_values, n), cycles(n_columns, n_rows, n)
    integer(c_int), intent(out) :: counts(n), codes(n)
    character(len=400), intent(out) :: messages(n)
    !f2py threadsafe
    type(holder_t), pointer :: held
    type(stop_watch_t) :: watch
    type(worker_t) :: worker
    type(case_t) :: case
    integer :: next
    logical :: finished

    held => holder_of(handle)
    watch%session => held%sweep
    worker = held%sweep%worker
    values = 0.0_c_double
    cycles = ieee_value(cycles, ieee_quiet_nan)
    counts = 0
    codes = -1
    messages = ''
    next = int(first)
    do
      do while (worker%has_room() .and. next < first + n)
        call worker%begin_case(held%sweep%sweep, next)
        next = next + 1
      end do
      if (worker%is_idle()) exit
      call worker%next_result(watch, case, finished)
      if (.not. finished) exit
      associate (i => case%number - int(first) + 1)
        values(:, i) = real(case%values, c_double)
        if (n_rows > 0 .and. allocated(case%table)) then
          counts(i) = size(case%table, 2)
          cycles(:, :counts(i), i) = real(case%table, c_double)
        end if
        codes(i) = int(case%result_code, c_int)
        if (case%result_code /= 0) messages(i) = case%result_text
      end associate
    end do
  end subroutine sweep_run

  !> Discard the cases in progress.
  subroutine sweep_stop(handle)
    integer(c_long_long), intent(in) :: handle
    type(holder_t), pointer :: held

    held => holder_of(handle)
    !$omp atomic write
    held%sweep%stop = .true.
  end subroutine sweep_stop

  logical function asked_to_stop(self)
    class(stop_watch_t), intent(inout) :: self

    !$omp atomic read
    asked_to_stop = self%session%stop
  end function asked_to_stop

  !> A function of the theory at n points, with its arguments there: values (value, point). On failure `failed` is the first point
  !> (from 1) without a result, and `message` says why.
  !>
  !> Of `slider_parameters` and a state (u_x, u_y, w_x, w_y) [m, m/s], by Equations (1)-(5):
  !> 'rhs': the right-hand side, their time derivatives. 'jacobian': its derivative, of equation i by unknown j at (i, j). Without
  !> smoothing the friction has no value at w = 0, which the caller has to exclude.
  !>
  !> Of tau, phi [rad] and kappa, within the range of the function:
  !> 'exact' creep: alpha, theta, psi [rad], v/V, X'/V, Y'/V, X/l_x, 1 - X'/V.
  !> 'first_power', 'printed', 'third_order': X'/V from Eq. (8).
  !>
  !> Of `slider_parameters`, and an angle theta [rad] for the last two:
  !> 'eigenvalues' of steady sliding [1/s]: four real parts, four imaginary parts, by falling real part.
  !> 'critical' misalignment: see `critical_values`.
  !> 'creep_end': whether slow creep ends in slip (0/1), the angle of friction there [rad], slip speed [m/s], load [N], decay D.
  !> 'damping' ratio of the slow motion at theta: Eq. (10), with friction constant at mu_0 W; 'weakening': with the law's own
  !> friction.
  subroutine evaluate(what, n_given, n, given, n_values, values, failed, message)
    character(len=*), intent(in) :: what
    integer(c_int), intent(in) :: n_given, n, n_values
    real(c_double), intent(in) :: given(n_given, n)
    real(c_double), intent(out) :: values(n_values, n)
    integer(c_int), intent(out) :: failed
    character(len=256), intent(out) :: message
    !f2py threadsafe
    type(error_t), allocatable :: error
    type(full_smoothed_t) :: model
    type(stage_terms_t) :: terms
    type(creep_path_t) :: path
    type(creep_t) :: here
    real(wp) :: now(n_given), last(n_given), found(n_values)
    integer :: i

    failed = 0
    message = ''
    values = 0.0_c_double
    last = huge(last)
    terms = new_terms(1, 2, 2)
    do i = 1, n
      now = real(given(:, i), wp)
      select case (what)
      case ('rhs', 'jacobian')
        ! A model serves all its states, and a path all times on it.
        if (any(abs(now(:12) - last(:12)) > 0.0_wp)) model = new_full_smoothed(slider_from(now))
        call equations(model, now(9), now(13:), terms, found)
      case ('exact')
        if (any(abs(now(2:3) - last(2:3)) > 0.0_wp)) path = new_creep_path(abs(now(2)), now(3))
        here = creep_at(path, now(1))
        associate (side => merge(-1.0_wp, 1.0_wp, now(2) < 0.0_wp))
          found = [here%alpha, side*(here%psi + path%phi), side*here%psi, here%speed, here%x_rate, side*here%y_rate, &
            here%position, here%deficit]
        end associate
      case ('first_power', 'printed', 'third_order')
        here = creep_asymptotic(what, abs(now(2)), now(1))
        found = here%x_rate
      case default
        call check_parameters(now, error)
        if (.not. allocated(error)) call steady_sliding(what, slider_from(now), now(9), now(n_given), found, error)
      end select
      last = now
      if (allocated(error)) then
        failed = int(i, c_int)
        message = error%text
        return
      end if
      values(:, i) = real(found, c_double)
    end do
  end subroutine evaluate

  !> The right-hand side at a state, or with 16 values its Jacobian.
  subroutine equations(model, drive_velocity, state, terms, values)
    type(full_smoothed_t), intent(in) :: model
    real(wp), intent(in) :: drive_velocity, state(4)
    type(stage_terms_t), intent(inout) :: terms
    real(wp), intent(out) :: values(:)
    real(wp) :: w(1, 2), gradient(1, 2, 2), jacobian(4, 4)

    call model%kinematics(1, state(3:4), w, gradient)
    call model%dynamics(1, [drive_velocity], state(1:2), state(3:4), gradient, terms)
    if (size(values) == 4) then
      values = [drive_velocity*model%drive_coupling - w(1, :), terms%force(1, :)]
    else
      jacobian(1:2, 1:2) = 0.0_wp
      jacobian(1:2, 3:4) = -gradient(1, :, :)
      jacobian(3:4, 1:2) = terms%force_u(1, :, :)
      jacobian(3:4, 3:4) = terms%force_y(1, :, :)
      values = reshape(jacobian, [16])
    end if
  end subroutine equations

  !> The linear theory of `evaluate`.
  subroutine steady_sliding(what, slider, velocity, theta, values, error)
    character(*), intent(in) :: what
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, theta
    real(wp), intent(out) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    type(creep_end_t) :: end
    complex(wp) :: roots(4)
    real(wp) :: value

    value = 0.0_wp
    if (what == 'eigenvalues') then
      call steady_sliding_eigenvalues(slider, velocity, roots, error)
      values = [real(roots), aimag(roots)]
    else if (what == 'critical') then
      call critical_values(slider, velocity, values, error)
    else if (what == 'creep_end') then
      ! It has the same requirements as steady sliding.
      call low_frequency_limit(slider, velocity, value, error)
      if (.not. allocated(error)) end = creep_end(slider, velocity)
      values = [merge(1.0_wp, 0.0_wp, end%exists), end%angle, end%speed, end%load, end%decay]
    else if (.not. abs(theta) <= huge(theta)) then
      call raise(error, usage_error, 'theta is not a number or infinite: it must be finite')
    else if (what == 'weakening') then
      call weakening_damping_ratio(slider, velocity, theta, value, error)
      values = value
    else
      call damping_scale(slider, velocity, value, error)
      values = damping_ratio(value, theta)
    end if
  end subroutine steady_sliding

  !> Critical misalignment; the slider's own is ignored: whether each branch has one (0/1), two angles [rad], frequencies [rad/s] of
  !> the low and the fast branch, stable window [rad], rigid limit of the low branch [rad].
  subroutine critical_values(slider, velocity, values, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    real(wp), intent(out) :: values(9)
    type(error_t), allocatable, intent(out) :: error
    type(critical_t) :: branches
    real(wp) :: limit

    limit = 0.0_wp
    call critical_misalignment(slider, velocity, branches, error)
    if (.not. allocated(error)) call low_frequency_limit(slider, velocity, limit, error)
    values = [merge(1.0_wp, 0.0_wp, branches%has), branches%angle, branches%frequency, branches%window, limit]
  end subroutine critical_values

  !> Sliders that a deck's reader would refuse, or whose numbers are out of range for products and squares.
  subroutine check_parameters(values, error)
    real(wp), intent(in) :: values(12)
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: least(12)
    integer :: i

    least = 0.0_wp
    ! Masses, stiffnesses and v_f are not 0; any misalignment is one, and each function has its own velocities.
    least([1, 2, 3, 7]) = tiny(1.0_wp)
    least([4, 9]) = -huge(1.0_wp)
    do i = 1, size(values)
      if (i == 9 .or. (values(i) >= least(i) .and. values(i) <= huge(1.0_wp))) cycle
      call raise(error, usage_error, trim(slider_parameters(i))//' = '//trim(short_text(values(i)))//': it must be finite'// &
                 trim(merge(' and > 0 ', merge(' and >= 0', '         ', least(i) >= 0.0_wp), least(i) > 0.0_wp)))
      return
    end do
    if (maxval(exponent(values(5:6))) + exponent(values(8)) > maxexponent(1.0_wp) - 2) then
      call raise(error, usage_error, 'mu_0 or mu_inf times normal_load is beyond the range of the numbers: give smaller ones')
    else if (.not. values(10) < sqrt(huge(1.0_wp))) then
      call raise(error, usage_error, 'v_smooth is out of range: it must be finite and >= 0, and its square too')
    end if
  end subroutine check_parameters

  function slider_from(values) result(slider)
    real(wp), intent(in) :: values(12)
    type(slider_t) :: slider

    slider%mass = values(1)
    slider%stiffness = values(2:3)
    slider%along = [cos(values(4)), sin(values(4))]
    call new_friction_law('weakening', values(5), values(6), values(7), values(8), slider%law)
    slider%smoothing = values(10)**2
    slider%damping = values(11:12)
  end function slider_from

  !> Characters to text.
  pure function text_of(characters) result(text)
    character(len=1), intent(in) :: characters(:)
    character(size(characters)) :: text

    text = transfer(characters, text)
  end function text_of

  !> The lines of a text, padded to one length.
  pure function lines_of(text) result(lines)
    character(*), intent(in) :: text
    character(max(1, len(text))), allocatable :: lines(:)
    integer :: first, width, i, n

    n = 0
    if (len(text) > 0) n = 1 + count([(text(i:i) == new_line('a'), i=1, len(text))])
    allocate (lines(n))
    first = 1
    do i = 1, size(lines)
      width = index(text(first:)//new_line('a'), new_line('a')) - 1
      lines(i) = text(first:first + width - 1)
      first = first + width + 1
    end do
  end function lines_of
end module dst_python_api
