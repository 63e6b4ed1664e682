!> The one flat file for f2py: decks, runs and sweeps by handle, and for arrays the equations of motion and slow creep.
!>
!> Texts are passed in as arrays of single characters, since f2py cuts a longer one at a NUL; texts that are returned are UTF-8,
!> padded with blanks. Objects on the heap are accessed by handles, and described by named tables and texts: there is no module
!> state, so different runs may proceed in different threads. Status 0 is success, otherwise a code of dst_errors.
module dst_python_api
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use, intrinsic :: iso_c_binding, only: c_double, c_int, c_long_long, c_ptr, c_loc, c_f_pointer, c_intptr_t
  use dst_assembly, only: slider_from_scene
  use dst_build_info, only: version, git_revision, compiler, build_flags
  use dst_catalogue, only: catalogue
  use dst_machine, only: host_name, job_name
  use dst_kinds, only: wp, int64, pi
  use dst_creep, only: creep_t, creep_path_t, new_creep_path, creep_at, &
    first_power => creep_first_power, printed => creep_printed, third_order => creep_third_order
  use dst_cycle_return, only: find_return, return_values
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
  use dst_limit_cycles, only: limit_cycles_t, limit_cycle_quantities, find_limit_cycles
  use dst_memory_writer, only: memory_writer_t
  use dst_model_choice, only: settle_model
  use dst_parameters, only: parameter_t, parameters_of
  use dst_sampling, only: sampling_note
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema, key_count, is_automatic, integer_kind, real_kind, reals_kind
  use dst_sensitivity, only: sensitivity_t, find_sensitivity
  use dst_settling, only: settling_t
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: stage_terms_t, new_terms
  use dst_stability, only: critical_t, steady_sliding_eigenvalues, critical_misalignment, low_frequency_limit, &
                           damping_scale, damping_ratio, weakening_damping_ratio
  use dst_stability_report, only: held_velocities
  use dst_stiffness, only: stiffness_note
  use dst_sweep, only: sweep_t, axis_t, case_t, watch_t, worker_t, new_sweep, new_worker, cases_at_once, value_quantities, &
    table_quantities
  use dst_sweep_points, only: read_points
  use dst_text, only: integer_text, printable, short_text
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: make, proceed, table_size, table, text_size, text, release
  public :: run_advance, run_state, run_instants, run_samples, sweep_run, sweep_stop
  public :: equations, creep, steady_sliding

  character(*), parameter :: nl = new_line('a')
  !> No text in a table is longer than this.
  integer, parameter :: longest_cell = 512

  !> The parameters of a slider in the order of the vectors that the routines for arrays use: in SI units.
  character(*), parameter :: slider_parameters(12) = [character(12) :: 'mass', 'stiffness_x', 'stiffness_y', 'misalignment', &
    'mu_0', 'mu_inf', 'v_f', 'normal_load', 'velocity', 'v_smooth', 'damping_x', 'damping_y']

  !> Texts and numbers (column, row) that describe an object.
  type :: table_t
    character(longest_cell), allocatable :: text(:, :)
    real(wp), allocatable :: number(:, :)
  end type table_t

  !> The object of a handle: the library itself, a deck, or one of the types below.
  type :: session_t
    type(error_t), allocatable :: error
    type(deck_t), allocatable :: deck
    type(table_t) :: table                   !! the last one that was requested
    character(:), allocatable :: text        !! the last one that was requested
  contains
    procedure :: make_table
    procedure :: make_text
  end type session_t

  !> A run with everything that Python may need of it.
  type, extends(session_t) :: run_t
    type(simulation_t) :: simulation
    type(memory_writer_t) :: writer
    type(outcome_t) :: outcome
    logical :: is_summed_up = .false.        !! `outcome` is that of the finished run
    character(:), allocatable :: model_choice
  contains
    procedure :: make_table => make_run_table
    procedure :: make_text => make_run_text
  end type run_t

  !> A sweep. Its threads only read it, except `stop`; each copies the worker, which is made under the interpreter's lock.
  type, extends(session_t) :: sweep_session_t
    type(sweep_t) :: sweep
    type(worker_t) :: worker
    logical :: stop = .false.
  contains
    procedure :: make_table => make_sweep_table
    procedure :: make_text => make_sweep_text
  end type sweep_session_t

  !> What was found of the settled motion, the cycles or the steady sliding of a scene.
  type, extends(session_t) :: cycles_session_t
    type(limit_cycles_t) :: cycles
    type(sensitivity_t) :: sensitivity
    type(derivatives_t) :: derivatives
    type(settling_t) :: settling
    real(wp), allocatable :: found(:)        !! the row of the table 'found'
  contains
    procedure :: make_table => make_cycles_table
    procedure :: make_text => make_cycles_text
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

  !> Make the object of a handle, which is valid until `release`, also on failure; then the text 'message' says why, and the table
  !> 'faults' where (line, setting). All but the library read a deck: its text, its name for messages, and its overrides
  !> 'group.key=value', one in each line. What they need beside it is in `words` and `numbers`:
  !>
  !> * 'library': data that do not depend on a deck, the table 'slider' and the texts 'catalogue' (commands, options, keys, columns,
  !>   ... as JSON) and 'origin'.
  !> * 'deck': a deck of which each value is checked against its own key only.
  !> * 'run': a run from its beginning.
  !> * 'sweep': the cases for the parameters that are varied, their names in the lines of `words`. The numbers are 1 if the values
  !>   of a case have the same place, else 0, then how many values each has, then all values, one after the other. Without names the
  !>   deck's own &sweep is used.
  !> * 'cycles': the limit cycles in the model `words` or, if that is blank, in the deck's own.
  !> * 'return': where the motion in that model returns to; the numbers are the place and how many slow cycles later.
  !> * 'sensitivity': that of the settled motion to the keys GROUP.KEY in `words`, with blanks between them.
  !> * 'derivatives': those of the run with respect to these keys, not yet begun; the numbers are times [s], or none for those of
  !>   its samples.
  !> * 'settling': the motion from rest, not yet begun.
  !> * 'steady': the linear theory of steady sliding; its row 'found' is the velocity [m/s], the misalignment [rad], and the values
  !>   of `steady_sliding` for 'eigenvalues' and 'critical'.
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

    allocate (holder)
    handle = handle_of(c_loc(holder))
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
    if (associated(holder%run)) call begin_run(holder%run)
    if (associated(holder%sweep)) call list_cases(holder%sweep, lines_of(text_of(words)), real(numbers, wp))
    if (associated(holder%cycles)) call find(what, holder%cycles, text_of(words), real(numbers, wp))
    status = status_of(holder%session)
  end subroutine make

  subroutine begin_run(self)
    type(run_t), intent(inout) :: self
    type(scene_t) :: scene

    if (self%deck%is_sweep()) then
      call raise(self%error, usage_error, &
        'the deck has a &sweep of many cases: use dynstiction.sweep, or remove the group')
      return
    end if
    call scene_from_deck(self%deck, scene)
    call settle_model(scene, self%model_choice)
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
    allocate (velocities, source=held_velocities(scene%drive_time, scene%drive_velocity))
    if (size(velocities) == 0) then
      call raise(self%error, usage_error, 'the drive holds no velocity but 0: give one value that is not 0')
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
    type(critical_t) :: branches
    complex(wp) :: roots(4)
    real(wp) :: limit

    if (.not. (scene%mass > 0.0_wp .and. scene%stiffness_y > 0.0_wp)) then
      call raise(self%error, usage_error, 'the linear theory of steady sliding needs a mass and both stiffnesses, which model '// &
                 "'"//trim(scene%model)//"' does not have: give a scene of model 'full'")
      return
    end if
    call slider_from_scene(scene, slider)
    call steady_sliding_eigenvalues(slider, velocity, roots, self%error)
    if (.not. allocated(self%error)) call critical_misalignment(slider, velocity, branches, self%error)
    if (.not. allocated(self%error)) call low_frequency_limit(slider, velocity, limit, self%error)
    if (allocated(self%error)) return
    allocate (self%found, source=[velocity, atan2(slider%along(2), slider%along(1)), real(roots, wp), aimag(roots), &
      merge(1.0_wp, 0.0_wp, branches%has), branches%angle, branches%frequency, branches%window, limit])
  end subroutine find_steady

  !> Continue with derivatives, or with the motion from rest, for at most `seconds` of wall time [s].
  subroutine proceed(handle, seconds, finished, status)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: seconds
    integer(c_int), intent(out) :: finished, status
    !f2py threadsafe
    type(holder_t), pointer :: held
    logical :: is_finished

    held => holder_of(handle)
    associate (self => held%cycles)
      if (allocated(self%derivatives%key)) then
        call self%derivatives%proceed(real(seconds, wp), self%error)
        is_finished = self%derivatives%is_finished
      else
        call self%settling%proceed(real(seconds, wp), self%error)
        is_finished = self%settling%is_finished
      end if
    end associate
    finished = merge(1_c_int, 0_c_int, is_finished)
    status = status_of(held%cycles)
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

  !> Make the table `which`, and its sizes: rows, columns of texts and of numbers, and bytes of the longest text.
  subroutine table_size(handle, which, n_rows, n_texts, n_numbers, n_bytes)
    integer(c_long_long), intent(in) :: handle
    character(len=*), intent(in) :: which
    integer(c_int), intent(out) :: n_rows, n_texts, n_numbers, n_bytes
    type(holder_t), pointer :: held

    held => holder_of(handle)
    call held%session%make_table(which)
    n_rows = int(size(held%session%table%text, 2), c_int)
    n_texts = int(size(held%session%table%text, 1), c_int)
    n_numbers = int(size(held%session%table%number, 1), c_int)
    n_bytes = max(1_c_int, int(maxval(len_trim(held%session%table%text)), c_int))
  end subroutine table_size

  !> The table whose sizes were requested last: texts and numbers (column, row).
  subroutine table(handle, n_rows, n_texts, n_numbers, n_bytes, texts, numbers)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_rows, n_texts, n_numbers, n_bytes
    character(len=n_bytes), intent(out) :: texts(n_texts, n_rows)
    real(c_double), intent(out) :: numbers(n_numbers, n_rows)
    type(holder_t), pointer :: held

    held => holder_of(handle)
    texts = held%session%table%text
    numbers = real(held%session%table%number, c_double)
  end subroutine table

  !> Make the text `which`, and its number of bytes.
  subroutine text_size(handle, which, n_bytes)
    integer(c_long_long), intent(in) :: handle
    character(len=*), intent(in) :: which
    integer(c_int), intent(out) :: n_bytes
    type(holder_t), pointer :: held

    held => holder_of(handle)
    call held%session%make_text(which)
    n_bytes = int(len(held%session%text), c_int)
  end subroutine text_size

  !> The text whose size was requested last.
  subroutine text(handle, n_bytes, content)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n_bytes
    character(len=n_bytes), intent(out) :: content
    type(holder_t), pointer :: held

    held => holder_of(handle)
    content = held%session%text
  end subroutine text

  !> Free the object of a handle; the handle is invalid afterwards.
  subroutine release(handle)
    integer(c_long_long), intent(in) :: handle
    type(holder_t), pointer :: held

    held => holder_of(handle)
    deallocate (held%session)
    deallocate (held)
  end subroutine release

  function holder_of(handle) result(holder)
    integer(c_long_long), intent(in) :: handle
    type(holder_t), pointer :: holder

    call c_f_pointer(address_of(handle), holder)
  end function holder_of

  !> Conversion between an address and the number that Python keeps for it.
  pure integer(c_long_long) function handle_of(address)
    type(c_ptr), intent(in) :: address

    handle_of = int(transfer(address, 0_c_intptr_t), c_long_long)
  end function handle_of

  pure type(c_ptr) function address_of(handle)
    integer(c_long_long), intent(in) :: handle

    address_of = transfer(int(handle, c_intptr_t), address_of)
  end function address_of

  pure subroutine new_table(table, rows, texts, numbers)
    type(table_t), intent(out) :: table
    integer, intent(in) :: rows, texts, numbers

    allocate (table%text(texts, rows), table%number(numbers, rows))
    table%text = ''
    table%number = 0.0_wp
  end subroutine new_table

  !> A table of numbers alone, (column, row).
  pure subroutine put_numbers(table, number)
    type(table_t), intent(out) :: table
    real(wp), intent(in) :: number(:, :)

    allocate (table%text(0, size(number, 2)))
    allocate (table%number, source=number)
  end subroutine put_numbers

  !> A table of one row of numbers.
  pure subroutine put_row(table, number)
    type(table_t), intent(out) :: table
    real(wp), intent(in) :: number(:)

    call put_numbers(table, reshape(number, [size(number), 1]))
  end subroutine put_row

  !> Tables of every session: 'slider', 'faults', and for a deck 'values'.
  subroutine make_table(self, which)
    class(session_t), intent(inout) :: self
    character(*), intent(in) :: which
    integer :: i

    select case (which)
    case ('slider')
      call new_table(self%table, size(slider_parameters), 1, 0)
      self%table%text(1, :) = slider_parameters
    case ('faults')
      associate (faults => self%deck%faults)
        call new_table(self%table, faults%count + merge(1, 0, faults%full()), 1, 2)
        if (faults%full()) self%table%text(1, faults%count + 1) = not_all_faults
        do i = 1, faults%count
          self%table%text(1, i) = printable(trim(faults%item(i)%text))
          self%table%number(:, i) = real([faults%item(i)%place%line, faults%item(i)%place%setting], wp)
        end do
      end associate
    case ('values')
      call make_table_of_values(self%deck, self%table)
    case default
      call new_table(self%table, 0, 0, 0)
    end select
  end subroutine make_table

  !> Group, key and value of every key that is set: a text, or a number. A list has a row for each of its values.
  subroutine make_table_of_values(deck, table)
    type(deck_t), intent(in) :: deck
    type(table_t), intent(out) :: table
    integer :: counts(key_count), i, k, row

    counts = [(element_count(deck%value(i)), i=1, key_count)]
    where (.not. deck%value%user) counts = 0
    call new_table(table, sum(counts), 3, 1)
    row = 0
    do i = 1, key_count
      do k = 1, counts(i)
        row = row + 1
        table%text(1:2, row) = [character(longest_cell) :: schema(i)%group, schema(i)%name]
        select case (schema(i)%kind)
        case (integer_kind)
          table%text(3, row) = integer_text(nint(deck%value(i)%reals(k), int64))
        case (real_kind, reals_kind)
          table%number(1, row) = deck%value(i)%reals(k)
          if (is_automatic(schema(i), deck%value(i)%reals(k))) table%text(3, row) = schema(i)%choices
        case default
          table%text(3, row) = deck%value(i)%texts(k)
        end select
      end do
    end do

  end subroutine make_table_of_values

  !> Also 'columns', 'parameters', in which a text has the second number 1, 'summary', and 'statistics', in which a counter has it,
  !> as far as the run has proceeded, and the waiting 'events': time [s], kind (1 = stick begins, 2 = slip begins), how often it
  !> occurs, and its period [s].
  subroutine make_run_table(self, which)
    class(run_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(parameter_t), allocatable :: parameters(:)
    integer :: i

    select case (which)
    case ('columns')
      call describe(self%table, self%simulation%output_columns(), 0)
    case ('parameters')
      call parameters_of(self%deck, parameters, self%simulation%scene%interval)
      call new_table(self%table, size(parameters), 4, 2)
      do i = 1, size(parameters)
        call put_quantity(self%table%text(:3, i), parameters(i)%quantity)
        self%table%number(1, i) = parameters(i)%value
        if (.not. allocated(parameters(i)%text)) cycle
        self%table%text(4, i) = parameters(i)%text
        self%table%number(2, i) = 1.0_wp
      end do
    case ('summary', 'statistics')
      if (.not. self%is_summed_up) call self%simulation%outcome(self%error, self%outcome)
      self%is_summed_up = self%simulation%finished
      associate (outcome => self%outcome)
        if (which == 'summary') then
          call describe(self%table, outcome%summary, 1)
          self%table%number(1, :) = outcome%summary_value
        else
          call describe(self%table, outcome%statistics, 2)
          self%table%number(1, :) = outcome%statistics_value
          self%table%number(2, :) = merge(1.0_wp, 0.0_wp, outcome%statistics%counts)
        end if
      end associate
    case ('events')
      call new_table(self%table, self%writer%events, 0, 4)
      associate (log => self%writer%log(:self%writer%events))
        self%table%number(1, :) = log%time
        self%table%number(2, :) = real(log%kind, wp)
        self%table%number(3, :) = real(log%occurs, wp)
        self%table%number(4, :) = log%period
      end associate
      self%writer%events = 0
    case default
      call self%session_t%make_table(which)
    end select
  end subroutine make_run_table

  !> Also its 'size' (cases, how many of them run side by side, and whether it is a list), 'axes' with the numbers of their values,
  !> the values of all 'points', one axis after the other, 'quantities' of a case, and those of its 'cycles', with the number of
  !> cycles that are kept.
  subroutine make_sweep_table(self, which)
    class(sweep_session_t), intent(inout) :: self
    character(*), intent(in) :: which
    integer :: i

    select case (which)
    case ('size')
      call put_row(self%table, real([self%sweep%cases, cases_at_once(self%sweep), merge(1, 0, self%sweep%is_list)], wp))
    case ('axes')
      call new_table(self%table, size(self%sweep%axes), 3, 1)
      do i = 1, size(self%sweep%axes)
        associate (axis => self%sweep%axes(i))
          call put_quantity(self%table%text(:, i), quantity_t(axis%name, schema(axis%key)%unit, schema(axis%key)%meaning))
          self%table%number(1, i) = size(axis%values)
        end associate
      end do
    case ('points')
      call put_row(self%table, [(self%sweep%axes(i)%values, i=1, size(self%sweep%axes))])
    case ('quantities')
      call describe(self%table, value_quantities(), 0)
    case ('cycles')
      if (self%sweep%keeps_cycles) then
        call describe(self%table, table_quantities(self%sweep), 1)
        self%table%number = real(self%sweep%table_rows(), wp)
      else
        call new_table(self%table, 0, 3, 1)
      end if
    case default
      call self%session_t%make_table(which)
    end select
  end subroutine make_sweep_table

  !> Also 'cycle_quantities', the values of all 'cycles' (a row for each, the last value says whether it is stable), its 'verdict'
  !> (with exponent, error, slow cycles, cycles, repeats, searched; then the load of steady sliding, whether that is stable, the
  !> velocity, the error of the model) and the 'eigenvalues' of steady sliding, 'regularity' (mean and scatter of each quantity),
  !> 'sensitivity', of each measure of the cycle the value and the derivatives with respect to the 'parameters', 'columns',
  !> 'samples' and 'events' of a run with derivatives, 'settling' (F_0, the swing of the load, and that from which on it is
  !> stick-slip [N]), and the row 'found'.
  subroutine make_cycles_table(self, which)
    class(cycles_session_t), intent(inout) :: self
    character(*), intent(in) :: which
    integer :: i

    select case (which)
    case ('cycle_quantities')
      call describe(self%table, limit_cycle_quantities, 0)
    case ('cycles')
      associate (cycles => self%cycles)
        call new_table(self%table, cycles%number(), 0, size(limit_cycle_quantities) + 1)
        self%table%number(:size(limit_cycle_quantities), :) = cycles%value
        self%table%number(size(limit_cycle_quantities) + 1, :) = merge(1.0_wp, 0.0_wp, cycles%is_stable)
      end associate
    case ('eigenvalues')
      call put_row(self%table, [real(self%cycles%eigenvalues, wp), aimag(self%cycles%eigenvalues)])
    case ('regularity')
      associate (regularity => self%cycles%regularity)
        call describe(self%table, cycle_quantities, 2)
        self%table%number(1, :) = regularity%mean
        self%table%number(2, :) = regularity%scatter
      end associate
    case ('verdict')
      associate (regularity => self%cycles%regularity, cycles => self%cycles)
        call put_row(self%table, [real(regularity%verdict, wp), regularity%exponent, regularity%error, &
          real([regularity%slow_cycles, regularity%cycles, regularity%repeats, regularity%searched], wp), &
          cycles%sliding_load, merge(1.0_wp, 0.0_wp, cycles%sliding_is_stable), cycles%velocity, cycles%error])
      end associate
    case ('sensitivity')
      associate (derivative => self%sensitivity%derivative)
        call describe(self%table, cycle_quantities, 1 + size(derivative, 2))
        self%table%number(1, :) = self%sensitivity%value
        self%table%number(2:, :) = transpose(derivative)
      end associate
    case ('columns')
      call describe(self%table, columns(self%derivatives%selected), 0)
    case ('samples')
      associate (value => self%derivatives%value, change => self%derivatives%change)
        call new_table(self%table, size(value, 2), 0, size(value, 1)*(1 + size(change, 2)))
        self%table%number(:size(value, 1), :) = value
        do i = 1, size(value, 2)
          self%table%number(size(value, 1) + 1:, i) = reshape(change(:, :, i), [size(value, 1)*size(change, 2)])
        end do
      end associate
    case ('events')
      associate (derivatives => self%derivatives, n => self%derivatives%events)
        call new_table(self%table, n, 0, 2 + size(derivatives%key))
        self%table%number(1, :) = derivatives%event(:n)%time
        self%table%number(2, :) = derivatives%event(:n)%kind
        self%table%number(3:, :) = derivatives%shift(:, :n)
      end associate
    case ('parameters')
      if (allocated(self%derivatives%key)) then
        call list_parameters(self%derivatives%key, self%derivatives%parameter)
      else
        call list_parameters(self%sensitivity%key, self%sensitivity%parameter)
      end if
    case ('settling')
      call put_row(self%table, [self%settling%limit, self%settling%swing, self%settling%least()])
    case ('found')
      call put_row(self%table, self%found)
    case default
      call self%session_t%make_table(which)
    end select

  contains

    subroutine list_parameters(key, value)
      character(*), intent(in) :: key(:)
      real(wp), intent(in) :: value(:)

      call new_table(self%table, size(key), 1, 1)
      self%table%text(1, :) = key
      self%table%number(1, :) = value
    end subroutine list_parameters
  end subroutine make_cycles_table

  !> Also 'model'.
  subroutine make_cycles_text(self, which)
    class(cycles_session_t), intent(inout) :: self
    character(*), intent(in) :: which

    if (which == 'model') then
      self%text = self%cycles%model
    else
      call self%session_t%make_text(which)
    end if
  end subroutine make_cycles_text

  !> Name, units and meaning of quantities, with room for numbers.
  subroutine describe(table, quantities, numbers)
    type(table_t), intent(out) :: table
    type(quantity_t), intent(in) :: quantities(:)
    integer, intent(in) :: numbers
    integer :: i

    call new_table(table, size(quantities), 3, numbers)
    do i = 1, size(quantities)
      call put_quantity(table%text(:, i), quantities(i))
    end do
  end subroutine describe

  pure subroutine put_quantity(cells, quantity)
    character(*), intent(out) :: cells(:)
    type(quantity_t), intent(in) :: quantity

    cells(1) = quantity%name
    cells(2) = quantity%units
    cells(3) = quantity%long_name
  end subroutine put_quantity

  !> Texts of every session: 'message', 'resolved' (deck), 'catalogue', and in the lines of 'origin' the source and the build of the
  !> core, the host of this process, and the name that the scheduler gives the job.
  subroutine make_text(self, which)
    class(session_t), intent(inout) :: self
    character(*), intent(in) :: which

    self%text = ''
    select case (which)
    case ('message')
      if (allocated(self%error)) self%text = self%error%text
    case ('resolved')
      self%text = resolved(self%deck)
    case ('catalogue')
      self%text = catalogue(version)
    case ('origin')
      self%text = version//nl//git_revision//nl//compiler//nl//build_flags//nl//host_name()//nl//job_name()
    end select
  end subroutine make_text

  !> Also 'about', whose lines are the model, the method, why model 'auto' was taken as it, what the samples will not show, why the
  !> method is slow, and then the resolved deck.
  subroutine make_run_text(self, which)
    class(run_t), intent(inout) :: self
    character(*), intent(in) :: which

    if (which == 'about') then
      associate (scene => self%simulation%scene)
        self%text = trim(scene%model)//nl//trim(scene%method_name())//nl//self%model_choice//nl//sampling_note(scene)//nl// &
          stiffness_note(scene, 1.0_wp)//nl//resolved(self%deck)
      end associate
    else
      call self%session_t%make_text(which)
    end if
  end subroutine make_run_text

  !> The deck is that of the sweep, with the values that it determines; also 'stiffness_note'.
  subroutine make_sweep_text(self, which)
    class(sweep_session_t), intent(inout) :: self
    character(*), intent(in) :: which
    type(scene_t) :: scene

    select case (which)
    case ('resolved')
      self%text = resolved(self%sweep%deck)
    case ('stiffness_note')
      call scene_from_deck(self%sweep%deck, scene)
      self%text = stiffness_note(scene, real(self%sweep%cases, wp))
    case default
      call self%session_t%make_text(which)
    end select
  end subroutine make_sweep_text

  !> Integrate for at most `seconds` of wall time [s] or until the simulated time `until` [s] has been `reached`; rows and events
  !> can then be fetched. `time` [s] is how far it has come, `status` the result code of a run that has ended.
  subroutine run_advance(handle, seconds, until, finished, reached, n_rows, n_events, time, status)
    integer(c_long_long), intent(in) :: handle
    real(c_double), intent(in) :: seconds, until
    integer(c_int), intent(out) :: finished, reached, n_rows, n_events, status
    real(c_double), intent(out) :: time
    !f2py threadsafe
    type(holder_t), pointer :: held

    held => holder_of(handle)
    call held%run%simulation%proceed(real(seconds, wp), held%run%writer, held%run%error, until=real(until, wp))
    finished = merge(1_c_int, 0_c_int, held%run%simulation%finished)
    reached = merge(1_c_int, 0_c_int, held%run%simulation%has_reached(real(until, wp)))
    n_rows = int(held%run%writer%rows, c_int)
    n_events = int(held%run%writer%events, c_int)
    time = real(held%run%simulation%motion%piece%to%time, c_double)
    status = status_of(held%run)
  end subroutine run_advance

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

  !> Sample at these instants [s] from now on, not at equal intervals: from 0 to the end, with at least one for each sample so far.
  subroutine run_instants(handle, n, instants)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: n
    real(c_double), intent(in) :: instants(n)
    type(holder_t), pointer :: held
    real(wp), allocatable :: taken(:)

    held => holder_of(handle)
    ! Not by assignment: gfortran 12 writes beside the component.
    allocate (taken(n), source=real(instants, wp))
    call move_alloc(taken, held%run%simulation%instants)
  end subroutine run_instants

  !> Fetch the waiting samples (row, column) into the rows after the first `before` ones.
  subroutine run_samples(handle, before, n_rows, n_columns, samples)
    integer(c_long_long), intent(in) :: handle
    integer(c_int), intent(in) :: before, n_rows, n_columns
    real(c_double), intent(inout) :: samples(n_rows, n_columns)   !! f2py would clear one that is made here, which takes as long
    type(holder_t), pointer :: held
    !> Number of rows that fit into a processor's cache: if all were transposed at once, this would take longer than the rest of
    !> Python's work.
    integer, parameter :: block_rows = 128
    integer :: from, to

    held => holder_of(handle)
    do from = 1, n_rows - before, block_rows
      to = min(from + block_rows - 1, int(n_rows - before))
      samples(before + from:before + to, :) = transpose(real(held%run%writer%samples(:, from:to), c_double))
    end do
    held%run%writer%rows = 0
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

  !> Equations (1)-(5) at n states (u_x, u_y, w_x, w_y) [m, m/s]; `slider` as `slider_parameters`. With one column: the right-hand
  !> side, their time derivatives. With four: its Jacobian, of equation i by unknown j at (i, j). Without smoothing the friction has
  !> no value at w = 0, which the caller has to exclude.
  subroutine equations(slider, n, state, n_columns, values)
    integer(c_int), intent(in) :: n, n_columns
    real(c_double), intent(in) :: slider(12), state(4, n)
    real(c_double), intent(out) :: values(4, n_columns, n)
    !f2py threadsafe
    type(full_smoothed_t) :: model
    type(stage_terms_t) :: terms
    real(wp) :: w(1, 2), gradient(1, 2, 2)
    integer :: i

    model = new_full_smoothed(slider_from(real(slider, wp)))
    terms = new_terms(1, 2, 2)
    do i = 1, n
      call model%kinematics(1, real(state(3:4, i), wp), w, gradient)
      call model%dynamics(1, [real(slider(9), wp)], real(state(1:2, i), wp), real(state(3:4, i), wp), gradient, terms)
      if (n_columns == 1) then
        values(1:2, 1, i) = slider(9)*model%drive_coupling - w(1, :)
        values(3:4, 1, i) = terms%force(1, :)
      else
        values(1:2, 1:2, i) = 0.0_c_double
        values(1:2, 3:4, i) = -gradient(1, :, :)
        values(3:4, 1:2, i) = terms%force_u(1, :, :)
        values(3:4, 3:4, i) = terms%force_y(1, :, :)
      end if
    end do
  end subroutine equations

  !> Creep at n points of phi [rad] and kappa. For the form 'exact' values(:, k) are
  !> alpha, theta, psi [rad], v/V, X'/V, Y'/V, X/l_x, 1 - X'/V. For others they are X'/V from Eq. (8): 'first_power', 'printed',
  !> 'third_order'. fault: 0, or the condition that the first point out of range (`point`, from 1) violates: 1 tau >= 0 and finite,
  !> 2 |phi| < pi/2, 3 0 <= kappa < 1, 4 tau < 1 if phi = 0, 5 0 <= tau < 1 for Eq. (8).
  subroutine creep(form, n, tau, phi, kappa, n_values, values, point, fault)
    character(len=*), intent(in) :: form
    integer(c_int), intent(in) :: n, n_values
    real(c_double), intent(in) :: tau(n), phi(n), kappa(n)
    real(c_double), intent(out) :: values(n, n_values)
    integer(c_int), intent(out) :: point, fault
    !f2py threadsafe
    type(creep_path_t) :: path
    type(creep_t) :: here
    real(wp) :: angle, ratio, side, time
    integer :: i

    angle = 0.0_wp
    ratio = 0.0_wp
    side = 1.0_wp
    path = new_creep_path(angle, ratio)
    fault = 0
    do i = 1, n
      point = int(i, c_int)
      ! Not `>`: a NaN must be found, too.
      if (.not. (abs(phi(i) - angle) <= 0.0_wp .and. abs(kappa(i) - ratio) <= 0.0_wp)) then
        angle = phi(i)
        ratio = kappa(i)
        if (.not. abs(angle) < 0.5_wp*pi) fault = 2
        if (.not. (ratio >= 0.0_wp .and. ratio < 1.0_wp)) fault = 3
        if (fault > 0) return
        if (form == 'exact') path = new_creep_path(abs(angle), ratio)
        side = merge(-1.0_wp, 1.0_wp, angle < 0.0_wp)
      end if
      time = real(tau(i), wp)
      if (form /= 'exact') then
        if (.not. (time >= 0.0_wp .and. time < 1.0_wp)) fault = 5
      else if (.not. (time >= 0.0_wp .and. time <= huge(tau))) then
        fault = 1
      else if (.not. abs(angle) > 0.0_wp .and. time >= 1.0_wp) then
        fault = 4
      end if
      if (fault > 0) return
      select case (form)
      case ('exact')
        here = creep_at(path, time)
        values(i, :) = real([here%alpha, side*(here%psi + path%phi), side*here%psi, here%speed, here%x_rate, side*here%y_rate, &
                             here%position, here%deficit], c_double)
      case ('first_power')
        values(i, 1) = real(first_power(abs(angle), time), c_double)
      case ('printed')
        values(i, 1) = real(printed(abs(angle), time), c_double)
      case default
        values(i, 1) = real(third_order(abs(angle), time), c_double)
      end select
    end do
  end subroutine creep

  !> Linear theory for n sliders as in `equations`: values (value, slider), for the request `what`.
  !> 'eigenvalues' of steady sliding [1/s]: four real parts, four imaginary parts, by falling real part.
  !> 'critical' misalignment; the slider's own is ignored: whether each branch has one (0/1), two angles [rad], frequencies [rad/s]
  !> of the low and the fast branch, stable window [rad], rigid limit of the low branch [rad].
  !> 'creep_end': whether slow creep ends in slip (0/1), the angle of friction there [rad], slip speed [m/s], load [N], decay D.
  !> 'damping' ratio of the slow motion at the angles `theta` [rad]: Eq. (10), with friction constant at mu_0 W; 'weakening': with
  !> the law's own friction.
  !> On failure `failed` is the first slider (from 1) without a result, and `message` says why.
  subroutine steady_sliding(what, n, sliders, theta, n_values, values, failed, message)
    character(len=*), intent(in) :: what
    integer(c_int), intent(in) :: n, n_values
    real(c_double), intent(in) :: sliders(12, n), theta(n)
    real(c_double), intent(out) :: values(n_values, n)
    integer(c_int), intent(out) :: failed
    character(len=256), intent(out) :: message
    !f2py threadsafe
    type(error_t), allocatable :: error
    integer :: i

    failed = 0
    message = ''
    values = 0.0_c_double
    do i = 1, n
      call check_parameters(real(sliders(:, i), wp), error)
      if (.not. allocated(error)) &
        call evaluate(slider_from(real(sliders(:, i), wp)), real(sliders(9, i), wp), real(theta(i), wp), values(:, i))
      if (.not. allocated(error)) cycle
      failed = int(i, c_int)
      message = error%text
      return
    end do

  contains

    subroutine evaluate(slider, velocity, angle, found)
      type(slider_t), intent(in) :: slider
      real(wp), intent(in) :: velocity, angle
      real(c_double), intent(out) :: found(:)
      type(critical_t) :: branches
      type(creep_end_t) :: end
      complex(wp) :: roots(4)
      real(wp) :: value

      value = 0.0_wp
      if (what == 'eigenvalues') then
        call steady_sliding_eigenvalues(slider, velocity, roots, error)
        found = real([real(roots), aimag(roots)], c_double)
      else if (what == 'critical') then
        call critical_misalignment(slider, velocity, branches, error)
        if (.not. allocated(error)) call low_frequency_limit(slider, velocity, value, error)
        found = real([merge(1.0_wp, 0.0_wp, branches%has), branches%angle, branches%frequency, branches%window, value], c_double)
      else if (what == 'creep_end') then
        ! It has the same requirements as steady sliding.
        call low_frequency_limit(slider, velocity, value, error)
        if (.not. allocated(error)) end = creep_end(slider, velocity)
        found = real([merge(1.0_wp, 0.0_wp, end%exists), end%angle, end%speed, end%load, end%decay], c_double)
      else
        if (.not. abs(angle) <= huge(angle)) then
          call raise(error, usage_error, 'theta is not a number or infinite: it must be finite')
        else if (what == 'weakening') then
          call weakening_damping_ratio(slider, velocity, angle, value, error)
        else
          call damping_scale(slider, velocity, value, error)
          value = damping_ratio(value, angle)
        end if
        found = real(value, c_double)
      end if
    end subroutine evaluate
  end subroutine steady_sliding

  !> Sliders that a deck's reader would refuse, or whose numbers are out of range for products and squares.
  subroutine check_parameters(values, error)
    real(wp), intent(in) :: values(12)
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
