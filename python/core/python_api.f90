!> The one flat file that f2py sees: runs by handle, and for arrays the equations of motion and slow creep.
!>
!> Texts travel as arrays of bytes in default integers, the kind that f2py translates without fault
!> (UTF-8, padded with blanks on the way out). A run lives on the heap and is known by its handle;
!> there is no module state, so different runs may proceed in different threads. Status 0 is
!> success, otherwise a code of dst_errors.
module dst_python_api
  use, intrinsic :: iso_c_binding, only: c_double, c_int, c_long_long, c_ptr, c_loc, c_f_pointer, c_intptr_t
  use dst_build_info, only: version, git_revision, compiler, build_flags
  use dst_machine, only: host_name, job_name
  use dst_kinds, only: wp, pi
  use dst_creep, only: creep_t, creep_path_t, new_creep_path, creep_at, &
    first_power => creep_first_power, printed => creep_printed, third_order => creep_third_order
  use dst_deck, only: deck_t, parse_deck, parse_values, resolved
  use dst_errors, only: error_t, raise, usage_error
  use dst_friction, only: new_friction_law
  use dst_full_model, only: full_smoothed_t, new_full_smoothed
  use dst_memory_writer, only: memory_writer_t
  use dst_model_choice, only: settle_model
  use dst_parameters, only: parameter_t, parameters_of
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema, key_count, condition_text, range_text
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: stage_terms_t, new_terms
  use dst_stability, only: critical_t, steady_sliding_eigenvalues, critical_misalignment, low_frequency_limit, &
                           damping_scale, damping_ratio, weakening_damping_ratio
  use dst_sweep, only: sweep_t, axis_t, case_t, watch_t, worker_t, new_sweep, new_worker, cases_at_once, value_count, &
    value_quantities
  use dst_sweep_points, only: read_csv
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: key_total, key_info, key_default, deck_open, deck_given, deck_numbers, deck_texts, deck_close
  public :: run_open, run_columns, column_info, run_advance, run_state, run_samples, run_events, run_instants, run_time
  public :: run_outcome, run_counts
  public :: summary_info, statistics_info, parameter_info, parameter_text, run_text_length, run_text, run_close
  public :: sweep_open, sweep_sizes, sweep_axis, sweep_value_info, sweep_run, sweep_stop, sweep_message
  public :: sweep_deck_length, sweep_deck, sweep_close
  public :: build_text, rhs, jacobian, creep_exact, creep_asymptotic, eigenvalues, critical, slow_damping

  !> A deck that has been read.
  type :: deck_session_t
    type(deck_t) :: deck
    type(error_t), allocatable :: error
  end type deck_session_t

  !> A run with everything that Python may ask of it.
  type :: session_t
    type(deck_t) :: deck
    type(simulation_t) :: simulation
    type(memory_writer_t) :: writer
    type(error_t), allocatable :: error
    type(outcome_t) :: outcome
    type(quantity_t), allocatable :: columns(:)
    type(parameter_t), allocatable :: parameters(:)
    character(:), allocatable :: resolved
    character(:), allocatable :: model_choice
  end type session_t

  !> A sweep. Its threads only read it, but for `stop`; each copies the worker, which is made under the interpreter's lock.
  type :: sweep_session_t
    type(sweep_t) :: sweep
    character(:), allocatable :: resolved
    type(worker_t) :: worker
    type(error_t), allocatable :: error
    logical :: stop = .false.
  end type sweep_session_t

  type, extends(watch_t) :: stop_watch_t
    type(sweep_session_t), pointer :: session => null()
  contains
    procedure :: asked_to_stop
  end type stop_watch_t

contains

  !> Number of keys that a deck may have.
  subroutine key_total(n)
    integer(c_int), intent(out) :: n

    n = int(key_count, c_int)
  end subroutine key_total

  !> Key i (from 1) of the schema: its kind (1 real, 2 integer, 3 text, 4 choice, 5 reals, 6 texts), what it takes and means.
  subroutine key_info(i, kind, required, group, name, units, range, choices, condition, meaning)
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: kind, required
    integer(c_int), intent(out) :: group(12), name(20), units(8), range(64), choices(256), condition(256), meaning(88)

    ! Not through the name below: gfortran 12 takes `key%kind` there for the kind of a number.
    kind = int(schema(i)%kind, c_int)
    associate (key => schema(i))
      required = merge(1_c_int, 0_c_int, key%required)
      call put_text(key%group, group)
      call put_text(key%name, name)
      call put_text(key%unit, units)
      call put_text(range_text(key), range)
      call put_text(key%choices, choices)
      call put_text(condition_text(key), condition)
      call put_text(key%meaning, meaning)
    end associate
  end subroutine key_info

  !> Default of key i as in a deck, text without quotes; blank if it has none.
  subroutine key_default(i, default)
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: default(16)

    call put_text(schema(i)%default, default)
  end subroutine key_default

  !> Read a deck and hold it against the schema as a whole, or with `alone` = 1 each value against its own key only. The
  !> handle is valid until deck_close, also on failure; `message` is cut at 8192 bytes.
  subroutine deck_open(n_deck, deck, n_name, name, n_settings, settings, alone, handle, status, message)
    integer(c_int), intent(in) :: n_deck, n_name, n_settings
    integer(c_int), intent(in) :: deck(n_deck), name(n_name), settings(n_settings), alone
    integer(c_long_long), intent(out) :: handle
    integer(c_int), intent(out) :: status, message(8192)
    ! Not f2py threadsafe, as run_open.
    type(deck_session_t), pointer :: session

    allocate (session)
    handle = handle_of(c_loc(session))
    if (alone == 1) then
      call parse_values(text_of(deck), text_of(name), lines_of(text_of(settings)), session%deck, session%error)
    else
      call parse_deck(text_of(deck), text_of(name), lines_of(text_of(settings)), session%deck, session%error)
    end if
    status = 0
    call put_text('', message)
    if (.not. allocated(session%error)) return
    status = int(session%error%code, c_int)
    call put_text(session%error%text, message)
  end subroutine deck_open

  !> Whether key i (from 1) is given, and its values: numbers of them, of texts, and the value of an integer key.
  subroutine deck_given(handle, i, given, n_numbers, n_texts, integer_value)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: given, n_numbers, n_texts
    integer(c_long_long), intent(out) :: integer_value
    type(deck_session_t), pointer :: session

    session => deck_of(handle)
    associate (value => session%deck%value(i))
      given = merge(1_c_int, 0_c_int, value%user)
      n_numbers = 0
      n_texts = 0
      if (allocated(value%reals)) n_numbers = int(size(value%reals), c_int)
      if (allocated(value%texts)) n_texts = int(size(value%texts), c_int)
      integer_value = int(value%integer, c_long_long)
    end associate
  end subroutine deck_given

  !> The n numbers of key i.
  subroutine deck_numbers(handle, i, n, values)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i, n
    real(c_double), intent(out) :: values(n)
    type(deck_session_t), pointer :: session

    session => deck_of(handle)
    values = real(session%deck%value(i)%reals, c_double)
  end subroutine deck_numbers

  !> The n texts of key i (byte, text).
  subroutine deck_texts(handle, i, n, texts)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i, n
    integer(c_int), intent(out) :: texts(256, n)
    type(deck_session_t), pointer :: session
    integer :: k

    session => deck_of(handle)
    do k = 1, n
      call put_text(session%deck%value(i)%texts(k), texts(:, k))
    end do
  end subroutine deck_texts

  !> Free the deck; the handle is void afterwards.
  subroutine deck_close(handle)
    integer(c_long_long), intent(in) :: handle
    type(deck_session_t), pointer :: session

    session => deck_of(handle)
    deallocate (session)
  end subroutine deck_close

  function deck_of(handle) result(session)
    integer(c_long_long), intent(in) :: handle
    type(deck_session_t), pointer :: session

    call c_f_pointer(address_of(handle), session)
  end function deck_of

  !> What Python keeps for an address, and back.
  pure integer(c_long_long) function handle_of(address)
    type(c_ptr), intent(in) :: address

    handle_of = int(transfer(address, 0_c_intptr_t), c_long_long)
  end function handle_of

  pure type(c_ptr) function address_of(handle)
    integer(c_long_long), intent(in) :: handle

    address_of = transfer(int(handle, c_intptr_t), address_of)
  end function address_of

  !> Read a deck and the parameters that are varied: their names one a line, the number of values of each, all values one
  !> after the other. Without names the deck's own &sweep is taken. `is_list` = 1: the values of a case have the same place.
  subroutine sweep_open(n_deck, deck, n_name, name, n_settings, settings, n_names, names, n_axes, sizes, n_values, values, &
                        is_list, handle, cases, axes, status)
    integer(c_int), intent(in) :: n_deck, n_name, n_settings, n_names, n_axes, n_values
    integer(c_int), intent(in) :: deck(n_deck), name(n_name), settings(n_settings), names(n_names), sizes(n_axes), is_list
    real(c_double), intent(in) :: values(n_values)
    integer(c_long_long), intent(out) :: handle
    integer(c_int), intent(out) :: cases, axes, status
    type(sweep_session_t), pointer :: session
    type(axis_t), allocatable :: given(:)
    character(max(1, n_names)), allocatable :: lines(:)
    type(deck_t), allocatable :: parsed
    integer :: i, first

    allocate (session, parsed)
    handle = handle_of(c_loc(session))
    call parse_deck(text_of(deck), text_of(name), lines_of(text_of(settings)), parsed, session%error)
    if (.not. allocated(session%error)) then
      lines = lines_of(text_of(names))
      if (size(lines) > 0) then
        allocate (given(size(lines)))
        first = 1
        do i = 1, size(given)
          given(i)%name = lines(i)
          given(i)%values = real(values(first:first + sizes(i) - 1), wp)
          first = first + sizes(i)
        end do
        call new_sweep(parsed, session%sweep, session%error, given, is_list == 1)
      else if (parsed%text_of('sweep', 'points') /= '') then
        call read_csv(parsed, given, session%error)
        if (.not. allocated(session%error)) call new_sweep(parsed, session%sweep, session%error, given, .true.)
      else if (parsed%is_sweep()) then
        call new_sweep(parsed, session%sweep, session%error)
      else
        call raise(session%error, usage_error, 'nothing is varied: give parameters, or a deck with &sweep')
      end if
    end if
    status = 0
    cases = 0
    axes = 0
    if (allocated(session%error)) then
      status = int(session%error%code, c_int)
      return
    end if
    session%resolved = resolved(session%sweep%deck)
    call new_worker(session%sweep, session%worker)
    cases = int(session%sweep%cases, c_int)
    axes = int(size(session%sweep%axes), c_int)
  end subroutine sweep_open

  !> Number of values of axis i (from 1), and of a case; of the cases that run side by side; and `is_list` = 1: the values of a
  !> case have the same place.
  subroutine sweep_sizes(handle, i, n_axis, n_case, n_at_once, is_list)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: n_axis, n_case, n_at_once, is_list
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    n_axis = int(size(session%sweep%axes(i)%values), c_int)
    n_case = int(value_count, c_int)
    n_at_once = int(cases_at_once(session%sweep), c_int)
    is_list = merge(1_c_int, 0_c_int, session%sweep%is_list)
  end subroutine sweep_sizes

  !> Axis i (from 1): its name, units, meaning and values.
  subroutine sweep_axis(handle, i, n, name, units, long_name, values)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i, n
    integer(c_int), intent(out) :: name(40), units(8), long_name(96)
    real(c_double), intent(out) :: values(n)
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    associate (axis => session%sweep%axes(i))
      call put_text(axis%name, name)
      call put_text(schema(axis%key)%unit, units)
      call put_text(schema(axis%key)%meaning, long_name)
      values = real(axis%values, c_double)
    end associate
  end subroutine sweep_axis

  !> Value i (from 1) of every case.
  subroutine sweep_value_info(i, name, units, long_name)
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: name(24), units(8), long_name(96)
    type(quantity_t) :: quantities(value_count)

    quantities = value_quantities()
    call put_description(quantities(i), name, units, long_name)
  end subroutine sweep_value_info

  !> Run the cases `first` to `first + n - 1`: values (value, case), result X
  subroutine sweep_run(handle, first, n, n_values, values, codes, messages)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: first, n, n_values
    real(c_double), intent(out) :: values(n_values, n)
    integer(c_int), intent(out) :: codes(n), messages(400, n)
    !f2py threadsafe
    type(sweep_session_t), pointer :: session
    type(stop_watch_t) :: watch
    type(worker_t) :: worker
    type(case_t) :: case
    integer :: next
    logical :: finished

    session => sweep_of(handle)
    watch%session => session
    worker = session%worker
    values = 0.0_c_double
    codes = -1
    messages = iachar(' ')
    next = int(first)
    do
      do while (worker%has_room() .and. next < first + n)
        call worker%begin_case(session%sweep, next)
        next = next + 1
      end do
      if (worker%is_idle()) exit
      call worker%next_result(watch, case, finished)
      if (.not. finished) exit
      associate (i => case%number - int(first) + 1)
        values(:, i) = real(case%values, c_double)
        codes(i) = int(case%result_code, c_int)
        if (case%result_code /= 0) call put_text(case%result_text, messages(:, i))
      end associate
    end do
  end subroutine sweep_run

  !> Give up what is under way.
  subroutine sweep_stop(handle)
    integer(c_long_long), intent(in) :: handle
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    !$omp atomic write
    session%stop = .true.
  end subroutine sweep_stop

  !> Why `sweep_open` failed, cut at 4096 bytes.
  subroutine sweep_message(handle, message)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(out) :: message(4096)
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    call put_text('', message)
    if (allocated(session%error)) call put_text(session%error%text, message)
  end subroutine sweep_message

  !> Bytes of the resolved deck of a sweep.
  subroutine sweep_deck_length(handle, n)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(out) :: n
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    n = int(len(session%resolved), c_int)
  end subroutine sweep_deck_length

  !> The resolved deck of a sweep.
  subroutine sweep_deck(handle, n, text)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n
    integer(c_int), intent(out) :: text(n)
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    call put_text(session%resolved, text)
  end subroutine sweep_deck

  !> Free the sweep; the handle is void afterwards.
  subroutine sweep_close(handle)
    integer(c_long_long), intent(in) :: handle
    type(sweep_session_t), pointer :: session

    session => sweep_of(handle)
    deallocate (session)
  end subroutine sweep_close

  logical function asked_to_stop(self)
    class(stop_watch_t), intent(inout) :: self

    !$omp atomic read
    asked_to_stop = self%session%stop
  end function asked_to_stop

  function sweep_of(handle) result(session)
    integer(c_long_long), intent(in) :: handle
    type(sweep_session_t), pointer :: session

    call c_f_pointer(address_of(handle), session)
  end function sweep_of

  !> Read a deck (text, name for messages, overrides 'group.key=value' one a line) and get ready to
  !> run. On failure the handle is still valid until run_close, and text 3 is the message.
  subroutine run_open(n_deck, deck, n_name, name, n_settings, settings, handle, status)
    integer(c_int), intent(in) :: n_deck, n_name, n_settings
    integer(c_int), intent(in) :: deck(n_deck), name(n_name), settings(n_settings)
    integer(c_long_long), intent(out) :: handle
    integer(c_int), intent(out) :: status
    ! Not f2py threadsafe: gfortran keeps lengths of text results in static storage, so decks are read
    ! one at a time, under the interpreter's lock.
    type(session_t), pointer :: session
    type(scene_t) :: scene

    allocate (session)
    handle = handle_of(c_loc(session))
    call parse_deck(text_of(deck), text_of(name), lines_of(text_of(settings)), session%deck, session%error)
    if (.not. allocated(session%error) .and. session%deck%is_sweep()) call raise(session%error, usage_error, &
      'the deck has a &sweep of many cases: use dynstiction.sweep, or remove the group')
    if (.not. allocated(session%error)) then
      call scene_from_deck(session%deck, scene)
      call settle_model(scene, session%model_choice)
      call session%simulation%start(scene, session%error)
    end if
    status = 0
    if (allocated(session%error)) then
      status = int(session%error%code, c_int)
      return
    end if
    session%columns = session%simulation%output_columns()
    session%resolved = resolved(session%deck)
    call parameters_of(session%deck, session%parameters)
  end subroutine run_open

  !> Number of output columns.
  subroutine run_columns(handle, n)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(out) :: n
    type(session_t), pointer :: session

    session => session_of(handle)
    n = int(size(session%columns), c_int)
  end subroutine run_columns

  !> Name, units and meaning of column i (from 1).
  subroutine column_info(handle, i, name, units, long_name)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: name(24), units(8), long_name(96)
    type(session_t), pointer :: session

    session => session_of(handle)
    call put_description(session%columns(i), name, units, long_name)
  end subroutine column_info

  !> Integrate for at most `seconds` of wall time [s] or until the simulated time `until` [s] has been `reached`; rows and
  !> events now wait to be taken.
  subroutine run_advance(handle, seconds, until, finished, reached, n_rows, n_events)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: seconds, until
    integer(c_int), intent(out) :: finished, reached, n_rows, n_events
    !f2py threadsafe
    type(session_t), pointer :: session

    session => session_of(handle)
    call session%simulation%proceed(real(seconds, wp), session%writer, session%error, until=real(until, wp))
    finished = merge(1_c_int, 0_c_int, session%simulation%finished)
    reached = merge(1_c_int, 0_c_int, session%simulation%has_reached(real(until, wp)))
    n_rows = int(session%writer%rows, c_int)
    n_events = int(session%writer%events, c_int)
  end subroutine run_advance

  !> What a sample at `time` [s] would hold, within the last advance.
  subroutine run_state(handle, time, n_columns, state)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: time
    integer(c_int), intent(in) :: n_columns
    real(c_double), intent(out) :: state(n_columns)
    type(session_t), pointer :: session
    real(wp) :: row(n_columns)

    session => session_of(handle)
    call session%simulation%state_at(real(time, wp), row)
    state = real(row, c_double)
  end subroutine run_state

  !> Take the waiting samples (row, column).
  subroutine run_samples(handle, n_columns, n_rows, samples)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_columns, n_rows
    real(c_double), intent(out) :: samples(n_rows, n_columns)
    type(session_t), pointer :: session
    !> Rows that fit into a processor's nearest memory: turned all at once, a long run's samples would take longer than its Python.
    integer, parameter :: block_rows = 128
    integer :: first, last

    session => session_of(handle)
    do first = 1, n_rows, block_rows
      last = min(first + block_rows - 1, int(n_rows))
      samples(first:last, :) = transpose(real(session%writer%samples(:, first:last), c_double))
    end do
    session%writer%rows = 0
  end subroutine run_samples

  !> Take the waiting events: time [s] and kind (1 = stick begins, 2 = slip begins).
  subroutine run_events(handle, n_events, time, kind)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_events
    real(c_double), intent(out) :: time(n_events)
    integer(c_int), intent(out) :: kind(n_events)
    type(session_t), pointer :: session

    session => session_of(handle)
    time = real(session%writer%event_time(:n_events), c_double)
    kind = int(session%writer%event_kind(:n_events), c_int)
    session%writer%events = 0
  end subroutine run_events

  !> Take samples at these instants [s] from now on, not at equal distances: from 0 to the end, one for each sample so far at least.
  subroutine run_instants(handle, n, instants)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: instants(n)
    type(session_t), pointer :: session

    session => session_of(handle)
    session%simulation%instants = real(instants, wp)
  end subroutine run_instants

  !> Simulated time reached [s].
  subroutine run_time(handle, time)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(out) :: time
    type(session_t), pointer :: session

    session => session_of(handle)
    time = real(session%simulation%trajectory%now%time, c_double)
  end subroutine run_time

  !> Sum up the run as far as it has come: result code; its text is text 3.
  subroutine run_outcome(handle, status)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(out) :: status
    type(session_t), pointer :: session

    session => session_of(handle)
    call session%simulation%outcome(session%error, session%outcome)
    status = 0
    if (allocated(session%error)) status = int(session%error%code, c_int)
  end subroutine run_outcome

  !> Number of summary values, counters and deck parameters.
  subroutine run_counts(handle, n_summary, n_statistics, n_parameters)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(out) :: n_summary, n_statistics, n_parameters
    type(session_t), pointer :: session

    session => session_of(handle)
    n_summary = 0
    n_statistics = 0
    if (allocated(session%outcome%summary)) n_summary = int(size(session%outcome%summary), c_int)
    if (allocated(session%outcome%statistics)) n_statistics = int(size(session%outcome%statistics), c_int)
    n_parameters = int(size(session%parameters), c_int)
  end subroutine run_counts

  !> Summary value i (from 1).
  subroutine summary_info(handle, i, name, units, long_name, value)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: name(24), units(8), long_name(96)
    real(c_double), intent(out) :: value
    type(session_t), pointer :: session

    session => session_of(handle)
    call put_description(session%outcome%summary(i), name, units, long_name)
    value = real(session%outcome%summary_value(i), c_double)
  end subroutine summary_info

  !> Counter i (from 1).
  subroutine statistics_info(handle, i, name, units, long_name, value)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: name(24), units(8), long_name(96)
    real(c_double), intent(out) :: value
    type(session_t), pointer :: session

    session => session_of(handle)
    call put_description(session%outcome%statistics(i), name, units, long_name)
    value = real(session%outcome%statistics_value(i), c_double)
  end subroutine statistics_info

  !> Deck parameter i (from 1); `is_text` = 1 if its value is what parameter_text gives.
  subroutine parameter_info(handle, i, name, units, long_name, value, is_text)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: name(24), units(8), long_name(96)
    real(c_double), intent(out) :: value
    integer(c_int), intent(out) :: is_text
    type(session_t), pointer :: session

    session => session_of(handle)
    associate (parameter => session%parameters(i))
      call put_description(parameter%quantity, name, units, long_name)
      value = real(parameter%value, c_double)
      is_text = merge(1_c_int, 0_c_int, allocated(parameter%text))
    end associate
  end subroutine parameter_info

  !> Text of deck parameter i, cut at 512 bytes.
  subroutine parameter_text(handle, i, text)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: i
    integer(c_int), intent(out) :: text(512)
    type(session_t), pointer :: session

    session => session_of(handle)
    call put_text(session%parameters(i)%text, text)
  end subroutine parameter_text

  !> Bytes of text `which`: 1 deck as read, 2 resolved deck, 3 error message, 4 model, 5 method, 6 why model 'auto' is that.
  subroutine run_text_length(handle, which, n)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: which
    integer(c_int), intent(out) :: n

    n = int(len(chosen_text(handle, which)), c_int)
  end subroutine run_text_length

  !> Text `which` (see run_text_length).
  subroutine run_text(handle, which, n, text)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: which, n
    integer(c_int), intent(out) :: text(n)

    call put_text(chosen_text(handle, which), text)
  end subroutine run_text

  !> Free the run; the handle is void afterwards.
  subroutine run_close(handle)
    integer(c_long_long), intent(in) :: handle
    type(session_t), pointer :: session

    session => session_of(handle)
    deallocate (session)
  end subroutine run_close

  !> What the extension was built from, 1 version, 2 revision, 3 compiler, 4 its flags, and where it runs: 5 host, 6 job.
  subroutine build_text(which, text)
    integer(c_int), intent(in) :: which
    integer(c_int), intent(out) :: text(512)

    select case (which)
    case (1)
      call put_text(version, text)
    case (2)
      call put_text(git_revision, text)
    case (3)
      call put_text(compiler, text)
    case (4)
      call put_text(build_flags, text)
    case (5)
      call put_text(host_name(), text)
    case default
      call put_text(job_name(), text)
    end select
  end subroutine build_text

  !> Right-hand side of Eqs. (1)-(5) for n states (u_x, u_y, w_x, w_y) [m, m/s]: their time derivatives.
  !> slider: mass, k_x, k_y, phi [rad], mu_0, mu_inf, v_f, W, V, v_smooth (SI). Without smoothing the
  !> friction has no value at w = 0; the caller excludes it.
  subroutine rhs(slider, n, state, derivative)
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: slider(10), state(4, n)
    real(c_double), intent(out) :: derivative(4, n)
    !f2py threadsafe
    type(full_smoothed_t) :: model
    type(stage_terms_t) :: terms
    real(wp) :: w(1, 2), gradient(1, 2, 2)
    integer :: i

    model = new_full_smoothed(slider_from(real(slider, wp)))
    terms = new_terms(1, 2)
    do i = 1, n
      call model%kinematics(1, real(state(3:4, i), wp), w, gradient)
      call model%dynamics(1, [real(slider(9), wp)], real(state(1:2, i), wp), real(state(3:4, i), wp), gradient, terms)
      derivative(1:2, i) = slider(9)*model%along - w(1, :)
      derivative(3:4, i) = terms%force(1, :)
    end do
  end subroutine rhs

  !> Jacobian of `rhs`: jacobian(i, j, :) = derivative of equation i by unknown j.
  subroutine jacobian(slider, n, state, matrix)
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: slider(10), state(4, n)
    real(c_double), intent(out) :: matrix(4, 4, n)
    !f2py threadsafe
    type(full_smoothed_t) :: model
    type(stage_terms_t) :: terms
    real(wp) :: w(1, 2), gradient(1, 2, 2)
    integer :: i

    model = new_full_smoothed(slider_from(real(slider, wp)))
    terms = new_terms(1, 2)
    do i = 1, n
      call model%kinematics(1, real(state(3:4, i), wp), w, gradient)
      call model%dynamics(1, [real(slider(9), wp)], real(state(1:2, i), wp), real(state(3:4, i), wp), gradient, terms)
      matrix(1:2, 1:2, i) = 0.0_c_double
      matrix(1:2, 3:4, i) = -gradient(1, :, :)
      matrix(3:4, 1:2, i) = terms%force_u(1, :, :)
      matrix(3:4, 3:4, i) = terms%force_y(1, :, :)
    end do
  end subroutine jacobian

  !> Exact creep for n points; phi [rad] and kappa have one value each point or one for all.
  !> creep(:, k): alpha, theta, psi [rad], v/V, X'/V, Y'/V, X/l_x, 1 - X'/V. fault: 0, or what the first point out of
  !> range (`point`, from 1) violates: 1 tau >= 0 and finite, 2 |phi| < pi/2, 3 0 <= kappa < 1, 4 tau < 1 if phi = 0.
  subroutine creep_exact(n, tau, n_phi, phi, n_kappa, kappa, creep, point, fault)
    integer(c_int), intent(in) :: n, n_phi, n_kappa
    real(c_double), intent(in) :: tau(n), phi(n_phi), kappa(n_kappa)
    real(c_double), intent(out) :: creep(n, 8)
    integer(c_int), intent(out) :: point, fault
    !f2py threadsafe
    type(creep_path_t) :: path
    type(creep_t) :: here
    real(wp) :: angle, ratio, side
    integer :: i

    angle = 0.0_wp
    ratio = 0.0_wp
    side = 1.0_wp
    path = new_creep_path(angle, ratio)
    fault = 0
    do i = 1, n
      point = int(i, c_int)
      ! Not `>`: a NaN must get in.
      if (.not. (abs(phi(min(i, n_phi)) - angle) <= 0.0_wp .and. abs(kappa(min(i, n_kappa)) - ratio) <= 0.0_wp)) then
        angle = phi(min(i, n_phi))
        ratio = kappa(min(i, n_kappa))
        if (.not. abs(angle) < 0.5_wp*pi) fault = 2
        if (.not. (ratio >= 0.0_wp .and. ratio < 1.0_wp)) fault = 3
        if (fault > 0) return
        path = new_creep_path(abs(angle), ratio)
        side = merge(-1.0_wp, 1.0_wp, angle < 0.0_wp)
      end if
      if (.not. (tau(i) >= 0.0_wp .and. tau(i) <= huge(tau))) fault = 1
      if (fault == 0 .and. .not. abs(angle) > 0.0_wp .and. tau(i) >= 1.0_wp) fault = 4
      if (fault > 0) return
      here = creep_at(path, real(tau(i), wp))
      creep(i, 1) = here%alpha
      creep(i, 2) = side*(here%psi + path%phi)
      creep(i, 3) = side*here%psi
      creep(i, 4) = here%speed
      creep(i, 5) = here%x_rate
      creep(i, 6) = side*here%y_rate
      creep(i, 7) = here%position
      creep(i, 8) = here%deficit
    end do
  end subroutine creep_exact

  !> X'/V after Eq. (8) for n points: form 1 first power, 2 as printed, 3 third order. fault as for creep_exact, and
  !> 5 for 0 <= tau < 1.
  subroutine creep_asymptotic(form, n, tau, n_phi, phi, x_rate, point, fault)
    integer(c_int), intent(in) :: form, n, n_phi
    real(c_double), intent(in) :: tau(n), phi(n_phi)
    real(c_double), intent(out) :: x_rate(n)
    integer(c_int), intent(out) :: point, fault
    !f2py threadsafe
    real(wp) :: angle
    integer :: i

    fault = 0
    do i = 1, n
      point = int(i, c_int)
      angle = abs(phi(min(i, n_phi)))
      if (.not. angle < 0.5_wp*pi) fault = 2
      if (.not. (tau(i) >= 0.0_wp .and. tau(i) < 1.0_wp)) fault = 5
      if (fault > 0) return
      select case (form)
      case (1)
        x_rate(i) = first_power(angle, real(tau(i), wp))
      case (2)
        x_rate(i) = printed(angle, real(tau(i), wp))
      case default
        x_rate(i) = third_order(angle, real(tau(i), wp))
      end select
    end do
  end subroutine creep_asymptotic

  !> Eigenvalues [1/s] of steady sliding for n sliders as in `rhs`: real and imaginary parts, by falling real part.
  !> On failure `failed` is the first slider (from 1) that has none, and `message` says why.
  subroutine eigenvalues(n, sliders, real_part, imaginary_part, failed, message)
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: sliders(10, n)
    real(c_double), intent(out) :: real_part(4, n), imaginary_part(4, n)
    integer(c_int), intent(out) :: failed, message(256)
    !f2py threadsafe
    type(error_t), allocatable :: error
    complex(wp) :: values(4)
    integer :: i

    call start_report(failed, message)
    do i = 1, n
      values = (0.0_wp, 0.0_wp)
      call check_parameters(real(sliders(:, i), wp), error)
      if (.not. allocated(error)) &
        call steady_sliding_eigenvalues(slider_from(real(sliders(:, i), wp)), real(sliders(9, i), wp), values, error)
      real_part(:, i) = real(values, c_double)
      imaginary_part(:, i) = real(aimag(values), c_double)
      call report(i, error, failed, message)
    end do
  end subroutine eigenvalues

  !> Critical misalignment for n sliders as in `rhs`, whose own misalignment has no effect: `exists` (0/1), angles [rad] and
  !> frequencies [rad/s] of the low and the fast branch, stable window [rad], rigid limit of the low branch [rad].
  subroutine critical(n, sliders, exists, angle, frequency, window, limit, failed, message)
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: sliders(10, n)
    integer(c_int), intent(out) :: exists(n)
    real(c_double), intent(out) :: angle(2, n), frequency(2, n), window(2, n), limit(n)
    integer(c_int), intent(out) :: failed, message(256)
    !f2py threadsafe
    type(error_t), allocatable :: error
    type(critical_t) :: found
    type(slider_t) :: slider
    real(wp) :: low_limit
    integer :: i

    call start_report(failed, message)
    do i = 1, n
      found = critical_t()
      low_limit = 0.0_wp
      call check_parameters(real(sliders(:, i), wp), error)
      if (.not. allocated(error)) then
        slider = slider_from(real(sliders(:, i), wp))
        call critical_misalignment(slider, real(sliders(9, i), wp), found, error)
      end if
      if (.not. allocated(error)) call low_frequency_limit(slider, real(sliders(9, i), wp), low_limit, error)
      exists(i) = merge(1_c_int, 0_c_int, found%exists)
      angle(:, i) = real(found%angle, c_double)
      frequency(:, i) = real(found%frequency, c_double)
      window(:, i) = real(found%window, c_double)
      limit(i) = real(low_limit, c_double)
      call report(i, error, failed, message)
    end do
  end subroutine critical

  !> Damping ratio of the slow motion at n angles theta [rad] for n sliders as in `rhs`: Eq. (10) with friction held at
  !> mu_0 W, or with the law's own friction if `weakening` is 1.
  subroutine slow_damping(n, sliders, theta, weakening, zeta, failed, message)
    integer(c_int), intent(in) :: n, weakening
    real(c_double), intent(in) :: sliders(10, n), theta(n)
    real(c_double), intent(out) :: zeta(n)
    integer(c_int), intent(out) :: failed, message(256)
    !f2py threadsafe
    type(error_t), allocatable :: error
    real(wp) :: value
    integer :: i

    call start_report(failed, message)
    do i = 1, n
      call check_parameters(real(sliders(:, i), wp), error)
      if (.not. (allocated(error) .or. abs(theta(i)) <= huge(theta))) &
        call raise(error, usage_error, 'theta is not a number or infinite: it must be finite')
      value = 0.0_wp
      if (.not. allocated(error)) call damping_of(slider_from(real(sliders(:, i), wp)), real(theta(i), wp))
      zeta(i) = real(value, c_double)
      call report(i, error, failed, message)
    end do

  contains

    subroutine damping_of(slider, angle)
      type(slider_t), intent(in) :: slider
      real(wp), intent(in) :: angle

      if (weakening == 1) then
        call weakening_damping_ratio(slider, real(sliders(9, i), wp), angle, value, error)
      else
        call damping_scale(slider, real(sliders(9, i), wp), value, error)
        value = damping_ratio(value, angle)
      end if
    end subroutine damping_of
  end subroutine slow_damping

  !> What a deck's reader would refuse, or what cannot be multiplied and squared to make a slider.
  subroutine check_parameters(values, error)
    real(wp), intent(in) :: values(10)
    type(error_t), allocatable, intent(out) :: error
    real(wp), parameter :: largest = sqrt(huge(1.0_wp))

    associate (friction => values(5:8), v_smooth => values(10))
      if (.not. (all(friction >= 0.0_wp) .and. all(friction <= huge(friction)) .and. values(7) >= tiny(1.0_wp))) then
        call raise(error, usage_error, 'mu_0, mu_inf, v_f or normal_load is out of range: mu_0, mu_inf and normal_load must be '// &
                   'finite and >= 0, v_f finite and > 0')
      else if (maxval(exponent(values(5:6))) + exponent(values(8)) > maxexponent(1.0_wp) - 2) then
        call raise(error, usage_error, 'mu_0 or mu_inf times normal_load is beyond the range of the numbers: give smaller ones')
      else if (.not. (v_smooth >= 0.0_wp .and. v_smooth < largest)) then
        call raise(error, usage_error, 'v_smooth is out of range: it must be finite and >= 0, and its square too')
      end if
    end associate
  end subroutine check_parameters

  subroutine start_report(failed, message)
    integer(c_int), intent(out) :: failed, message(256)

    failed = 0
    call put_text('', message)
  end subroutine start_report

  !> Keep the first error of a loop over sliders.
  subroutine report(i, error, failed, message)
    integer, intent(in) :: i
    type(error_t), allocatable, intent(in) :: error
    integer(c_int), intent(inout) :: failed, message(256)

    if (.not. allocated(error) .or. failed > 0) return
    failed = int(i, c_int)
    call put_text(error%text, message)
  end subroutine report

  function slider_from(values) result(slider)
    real(wp), intent(in) :: values(10)
    type(slider_t) :: slider

    slider%mass = values(1)
    slider%stiffness = values(2:3)
    slider%along = [cos(values(4)), sin(values(4))]
    call new_friction_law('weakening', values(5), values(6), values(7), values(8), slider%law)
    slider%smoothing = values(10)**2
  end function slider_from

  function session_of(handle) result(session)
    integer(c_long_long), intent(in) :: handle
    type(session_t), pointer :: session

    call c_f_pointer(address_of(handle), session)
  end function session_of

  function chosen_text(handle, which) result(text)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: which
    character(:), allocatable :: text
    type(session_t), pointer :: session

    session => session_of(handle)
    text = ''
    select case (which)
    case (1)
      if (allocated(session%deck%text)) text = session%deck%text
    case (2)
      if (allocated(session%resolved)) text = session%resolved
    case (3)
      if (allocated(session%error)) text = session%error%text
    case (4)
      text = session%simulation%scene%model
    case (5)
      text = session%simulation%scene%method_name()
    case default
      text = session%model_choice
    end select
  end function chosen_text

  subroutine put_description(quantity, name, units, long_name)
    type(quantity_t), intent(in) :: quantity
    integer(c_int), intent(out) :: name(:), units(:), long_name(:)

    call put_text(quantity%name, name)
    call put_text(quantity%units, units)
    call put_text(quantity%long_name, long_name)
  end subroutine put_description

  !> Text to bytes, cut or padded with blanks.
  pure subroutine put_text(text, bytes)
    character(*), intent(in) :: text
    integer(c_int), intent(out) :: bytes(:)
    integer :: i

    bytes = iachar(' ')
    do i = 1, min(len(text), size(bytes))
      bytes(i) = ichar(text(i:i), c_int)
    end do
  end subroutine put_text

  !> Bytes to text.
  pure function text_of(bytes) result(text)
    integer(c_int), intent(in) :: bytes(:)
    character(size(bytes)) :: text
    integer :: i

    do i = 1, size(bytes)
      text(i:i) = char(bytes(i))
    end do
  end function text_of

  !> The lines of a text that are not blank, padded to one length.
  pure function lines_of(text) result(lines)
    character(*), intent(in) :: text
    character(max(1, len(text))), allocatable :: lines(:)
    integer :: first, last, n, pass

    do pass = 1, 2
      n = 0
      first = 1
      do while (first <= len(text))
        last = index(text(first:), new_line('a'))
        last = merge(first + last - 2, len(text), last > 0)
        if (len_trim(text(first:last)) > 0) then
          n = n + 1
          if (pass == 2) lines(n) = text(first:last)
        end if
        first = last + 2
      end do
      if (pass == 1) allocate (lines(n))
    end do
  end function lines_of
end module dst_python_api
