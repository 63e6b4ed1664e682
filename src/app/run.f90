!> Run a deck into a result file, or continue a run that was stopped: what `dynstiction run` and `resume` do.
!>
!> The file is made whole at the end, at a stop, and from time to time; then the run goes on in a new file that begins with the rows
!> of the former (docs/checkpoints.md).
module dst_run
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_machine, only: host_name, job_name, utc_now
  use dst_kinds, only: wp, int64
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t, archive_of
  use dst_build_info, only: program_name, version, git_revision, compiler, build_flags
  use dst_deck, only: deck_t, parse_deck, resolved
  use dst_ending, only: read_state
  use dst_errors, only: error_t, raise, has_code, exit_status, file_error, out_of_memory, stopped_early
  use dst_hdf5_origin, only: origin_t, read_origin
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, attribute_t, create_hdf5
  use dst_model_choice, only: settle_model
  use dst_parameters, only: parameters_of
  use dst_progress, only: progress_t, new_progress, time_left
  use dst_result_file, only: result_file_t, interim_t
  use dst_sampling, only: run_samples
  use dst_scene, only: scene_t, scene_from_deck
  use dst_posix, only: stop_signal, stopped_by, no_signal
  use dst_simulation, only: simulation_t
  use dst_stopwatch, only: wall_clock
  use dst_plain_numbers, only: number_text, duration_text
  use dst_text, only: integer_text, printable
  use dst_writer, only: writer_t, outcome_t
  implicit none
  private

  public :: run_deck, resume_run, describe_run

  !> Wall time of one slice of the run [s]: signals, progress and interim files are handled between slices.
  real(wp), parameter :: slice = 0.05_wp
  !> The first number of a state: the version of what follows.
  integer, parameter :: state_format = 28
  !> Number of samples in memory from which on they are put into the file. Convention; no number depends on it.
  integer, parameter :: most_rows = 512

  !> A run in progress.
  type :: run_t
    type(result_file_t) :: file
    type(run_metadata_t) :: metadata
    type(simulation_t) :: simulation
    type(hdf5_writer_t) :: contents
    type(progress_t) :: progress
  end type run_t

contains

  !> Integrate the deck's scene into `result_file`. If the solver gives up, the file has everything up to that point and the result
  !> code; `error` says the same, and `report` says in one line what a run without error has found.
  subroutine run_deck(deck, result_file, overwrite, quiet, report, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    logical, intent(in) :: overwrite, quiet
    character(:), allocatable, intent(out) :: report
    type(error_t), allocatable, intent(out) :: error
    type(run_t) :: run

    report = ''
    call begin(run, deck, error)
    if (.not. allocated(error)) call run%file%claim(result_file, overwrite, error)
    if (allocated(error)) return
    call create_contents(run, error)
    if (.not. allocated(error)) then
      run%progress = new_progress(deck%name, quiet)
      if (run%metadata%model_choice /= '') call run%progress%remark("model 'auto' is "//run%metadata%model_choice)
      call carry_out(run, report, error)
    end if
    call run%file%discard()
  end subroutine run_deck

  !> Continue the run that wrote `result_file` from the state in it.
  subroutine resume_run(result_file, quiet, report, error)
    character(*), intent(in) :: result_file
    logical, intent(in) :: quiet
    character(:), allocatable, intent(out) :: report   !! as in `run_deck`
    type(error_t), allocatable, intent(out) :: error
    type(run_t) :: run

    report = ''
    run%progress = new_progress(result_file, quiet)
    call run%file%claim_again(result_file, error)
    if (allocated(error)) return
    call restore(run, error)
    if (.not. allocated(error)) call go_on(run, error)
    if (.not. allocated(error)) call carry_out(run, report, error)
    call run%file%discard()
  end subroutine resume_run

  !> Start the deck's scene, and describe it.
  subroutine begin(run, deck, error)
    type(run_t), intent(inout) :: run
    type(deck_t), intent(in) :: deck
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    character(:), allocatable :: model_choice

    call scene_from_deck(deck, scene)
    call settle_model(scene, model_choice)
    call run%simulation%start(scene, error)
    if (.not. allocated(error)) call describe_run(deck, run%simulation%scene, model_choice, run%metadata)
  end subroutine begin

  !> Create the file with its description and empty columns.
  subroutine create_contents(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error

    call create_hdf5(run%contents, run%file%path(), run%file%name, run%metadata, run%simulation%output_columns(), &
      expected_rows(run%simulation%scene), error)
  end subroutine create_contents

  !> Create the file with the rows of the one that has its name.
  subroutine go_on(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error

    call create_contents(run, error)
    if (.not. allocated(error)) call run%contents%copy_rows(run%file%place, error)
    if (.not. allocated(error)) call run%file%check_former(error)
  end subroutine go_on

  !> The run as it was when its file was made whole.
  subroutine restore(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error
    character(*), parameter :: run_again = ': run the deck again'
    type(origin_t) :: origin
    type(deck_t), allocatable :: deck
    type(archive_t) :: archive
    integer(int64), allocatable :: state(:)
    character(:), allocatable :: reason
    character(1) :: no_settings(0)
    integer, target :: format

    call read_state(run%file%place, state, reason)
    if (.not. allocated(reason)) then
      call read_origin(run%file%place, run%file%name, origin, error)
      if (allocated(error)) return
      if (origin%complete /= 0) then
        reason = 'the run is complete'
      else if (exit_status(origin%result_code) == 4 .and. origin%result_code /= out_of_memory) then
        reason = 'the solver gave up, and would fail again: '//origin%result_text
      else if (size(state) == 0) then
        reason = 'it holds no state of a run'//run_again
      else if (origin%version /= version) then
        reason = 'it is of version '//origin%version//', this program is version '//version//': resume with the former, or '// &
          'run the deck again'
      end if
    else
      reason = reason//run_again
    end if
    if (.not. allocated(reason)) then
      allocate (deck)
      call parse_deck(origin%deck_resolved, run%file%name, no_settings, deck, error)
      if (.not. allocated(error)) call begin(run, deck, error)
      if (allocated(error)) return
      run%metadata%created = origin%created
      run%metadata%deck_text = origin%deck_text
      run%metadata%deck_resolved = origin%deck_resolved
      call archive_of(state, archive)
      format = 0
      call archive%serialise(c_loc(format), storage_size(format))
      if (format == state_format) call run%simulation%serialise(archive)
      if (.not. archive%given_back()) reason = 'it holds another state than this program has: resume with the program that '// &
        'began the run, or run the deck again'
    end if
    if (allocated(reason)) call raise(error, file_error, run%file%name//': cannot resume: '//reason)
  end subroutine restore

  !> Integrate to the end or until a request to stop, and finish the file.
  subroutine carry_out(run, report, error)
    type(run_t), intent(inout) :: run
    character(:), allocatable, intent(out) :: report
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: end_error
    type(outcome_t) :: outcome

    report = ''
    call integrate(run, error)
    if (has_code(error, file_error)) return
    if (has_code(error, stopped_early)) call raise(error, stopped_early, stop_text(run))
    call run%simulation%outcome(error, outcome)
    if (value_or_zero(outcome, 'regularity') < 0.0_wp) call run%progress%remark( &
      'the motion is irregular, its cycles have a distribution and no value: Lyapunov exponent '// &
      number_text(outcome%summary_of('lyapunov_exponent'))//' +- '//number_text(outcome%summary_of('lyapunov_error'))// &
      ' per slow cycle')
    ! Errors of this size may have grown to the size of the motion.
    if (run%simulation%scene%rtol*value_or_zero(outcome, 'conditioning') > 1.0_wp) call run%progress%remark( &
      'conditioning '//number_text(outcome%summary_of('conditioning'))//': no rtol like this determines when the last events occur')
    call make_whole(run, outcome, has_code(error, stopped_early), end_error)
    ! A lost file matters more than a stopped run; it does not change the error of a solver that gave up.
    ! allow(C161)
    if (allocated(end_error) .and. (has_code(error, stopped_early) .or. .not. allocated(error))) call move_alloc(end_error, error)
    if (.not. allocated(error)) report = report_of(run, outcome)
  end subroutine carry_out

  !> Finish the file and give it its name; with the state, if the run can go on.
  subroutine make_whole(run, outcome, with_state, error)
    type(run_t), intent(inout) :: run
    type(outcome_t), intent(in) :: outcome
    logical, intent(in) :: with_state
    type(error_t), allocatable, intent(out) :: error
    type(archive_t) :: archive
    ! Allocated: it may need more room than a stack has.
    integer(int64), allocatable :: state(:)
    integer, target :: format

    call run%contents%finish(outcome, error)
    if (allocated(error)) return
    allocate (state(0))
    if (with_state) then
      format = state_format
      call archive%serialise(c_loc(format), storage_size(format))
      call run%simulation%serialise(archive)
      state = archive%words()
    end if
    call run%file%put_in_place(state, error)
  end subroutine make_whole

  !> 'my.h5: 10 s, 125001 samples, 8 cycles: period 0.915 s, peak 1.993 N, valley 1.169 N, slip 0.8822 mm (0.3 s)', and what to look
  !> at next.
  function report_of(run, outcome) result(text)
    type(run_t), intent(in) :: run
    type(outcome_t), intent(in) :: outcome
    character(:), allocatable :: text, took
    character(*), parameter :: no_cycle = ', no stick-slip cycle'
    integer :: cycles, repeats
    real(wp) :: period

    text = printable(run%file%name)//': '//shown(run%simulation%motion%piece%to%time, 's')//', '// &
      integer_text(run%simulation%samples)//' samples'
    if (.not. run%simulation%motion%in_closed_form) then
      cycles = nint(outcome%summary_of('cycles'))
      if (cycles == 0) text = text//no_cycle
      if (cycles == 1) text = text//', 1 cycle'
      if (cycles > 1) text = text//', '//integer_text(cycles)//' cycles'
      period = outcome%summary_of('period')
      if (cycles > 0 .and. ieee_is_nan(period)) then
        text = text//', ringing down to steady sliding'
      else if (cycles > 0) then
        text = text//': period '//shown(period, 's')//', peak '//shown(outcome%summary_of('peak_force'), 'N')//', valley '// &
          shown(outcome%summary_of('valley_force'), 'N')//', slip '//shown(1.0e3_wp*outcome%summary_of('slip_length'), 'mm')
        if (.not. ieee_is_nan(outcome%summary_of('repeats'))) then
          repeats = nint(outcome%summary_of('repeats'))
          if (repeats > 1) text = text//', repeats after '//integer_text(repeats)//' cycles'
        end if
      end if
    end if
    took = duration_text(run%simulation%elapsed)
    if (run%simulation%elapsed < 1.0_wp) took = number_text(run%simulation%elapsed, 2)//' s'
    text = text//' ('//took//'); see dynstiction plot '//printable(run%file%name)//new_line('a')
  end function report_of

  !> Four digits and the unit.
  function shown(value, unit) result(text)
    real(wp), intent(in) :: value
    character(*), intent(in) :: unit
    character(:), allocatable :: text

    text = number_text(value, 4)//' '//unit
  end function shown

  !> A value of the summary; 0 if there is none of this name.
  real(wp) function value_or_zero(outcome, name)
    type(outcome_t), intent(in) :: outcome
    character(*), intent(in) :: name

    value_or_zero = 0.0_wp
    if (any(outcome%summary%name == name)) value_or_zero = outcome%summary_of(name)
  end function value_or_zero

  !> Why the run was stopped, and how to continue it.
  function stop_text(run) result(text)
    type(run_t), intent(in) :: run
    character(:), allocatable :: text

    text = 'stopped at output.wall_limit'
    if (stop_signal() /= no_signal) text = stopped_by()
    text = text//' at '//run%simulation%state_text()//': continue with dynstiction resume '//run%file%name
  end function stop_text

  !> All slices of the run, until it is finished, fails, or is asked to stop.
  subroutine integrate(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: disk_error
    type(writer_t) :: writer
    type(interim_t) :: interim
    real(wp) :: now

    now = wall_clock()
    writer%most_rows = most_rows
    associate (simulation => run%simulation, scene => run%simulation%scene)
      interim = interim_t(scene%checkpoint_interval, begun=now - simulation%elapsed, made=now)
      do
        call simulation%proceed(slice, writer, error)
        call run%contents%take(writer, disk_error)
        if (allocated(disk_error) .and. .not. allocated(error)) call move_alloc(disk_error, error)
        if (simulation%finished .or. allocated(error)) exit
        if (stop_signal() /= no_signal) call raise(error, stopped_early, '')
        if (allocated(error)) exit
        call show_progress(run)
        if (.not. interim%is_due(wall_clock())) cycle
        call make_interim_file(run, error)
        if (allocated(error)) exit
        interim%made = wall_clock()
      end do
    end associate
    call run%progress%close()
  end subroutine integrate

  !> Show how far the run is, if it is time to.
  subroutine show_progress(run)
    type(run_t), intent(inout) :: run
    character(5) :: percent

    associate (time => run%simulation%motion%piece%to%time, t_end => run%simulation%scene%t_end, elapsed => run%simulation%elapsed)
      if (.not. run%progress%is_due(elapsed)) return
      write (percent, '(f5.1)') 100.0_wp*(time/t_end)
      call run%progress%show(percent//' %, t = '//number_text(time)//' of '//number_text(t_end)//' s'// &
        time_left(elapsed, time/t_end), elapsed)
    end associate
  end subroutine show_progress

  !> The file gets its name as it is now, and the run goes on in a new one.
  subroutine make_interim_file(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: not_finished
    type(outcome_t) :: outcome

    call raise(not_finished, stopped_early, 'not finished: this is the run at '//run%simulation%state_text()// &
      ': if it was killed, continue with dynstiction resume '//run%file%name)
    call run%simulation%outcome(not_finished, outcome)
    call make_whole(run, outcome, .true., error)
    if (.not. allocated(error)) call run%file%begin_next(error)
    if (.not. allocated(error)) call go_on(run, error)
  end subroutine make_interim_file

  !> Number of samples, as far as it is known beforehand.
  pure integer function expected_rows(scene)
    type(scene_t), intent(in) :: scene
    integer, parameter :: usual = 1024
    real(wp), parameter :: most = 1.0e9_wp

    expected_rows = int(min(run_samples(scene), most))
    if (expected_rows == 0) expected_rows = usual
  end function expected_rows

  !> The attributes of the file that describe its run.
  subroutine describe_run(deck, scene, model_choice, metadata)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene            !! the scene, with its model chosen
    character(*), intent(in) :: model_choice
    type(run_metadata_t), intent(out) :: metadata
    integer :: n

    allocate (metadata%attributes(9))
    n = 0
    call add('program', program_name)
    call add('version', version)
    call add('git_revision', git_revision)
    call add('compiler', compiler)
    call add('build_flags', build_flags)
    call add('host', host_name())
    call add('job', job_name())
    call add('model', scene%model)
    call add('method', scene%method_name())
    metadata%created = utc_now()
    metadata%model_choice = model_choice
    metadata%deck_text = deck%text
    metadata%deck_resolved = resolved(deck)
    ! A sweep without series leaves this to its cases.
    if (scene%interval < 0.0_wp) then
      call parameters_of(deck, metadata%parameters)
    else
      call parameters_of(deck, metadata%parameters, scene%interval)
    end if

  contains

    subroutine add(name, text)
      character(*), intent(in) :: name, text

      ! No array constructor: with gfortran 12 it leaks the memory of the copies.
      n = n + 1
      metadata%attributes(n)%name = name
      metadata%attributes(n)%text = text
    end subroutine add
  end subroutine describe_run
end module dst_run
