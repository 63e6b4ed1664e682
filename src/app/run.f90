!> Run a deck into a result file, or continue a run that was stopped: what `dynstiction run` and `resume` do.
module dst_run
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_machine, only: host_name, job_name
  use dst_processes, only: mpi_library
  use dst_kinds, only: wp
  use dst_archive, only: archive_t, archive_of
  use dst_build_info, only: program_name, version, git_revision, compiler, build_flags
  use dst_checkpoint, only: checkpoint_t
  use dst_deck, only: deck_t, parse_deck, resolved
  use dst_disk, only: utc_now
  use dst_errors, only: error_t, raise, has_code, exit_status, file_error, out_of_memory, result_done, &
    stopped_early
  use dst_hdf5_origin, only: origin_t, read_origin
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, bookmark_t, empty_bookmark, create_hdf5, rebuild_hdf5, &
    reopen_hdf5
  use dst_model_choice, only: settle_model
  use dst_output_size, only: run_samples
  use dst_parameters, only: parameters_of
  use dst_process, only: guard_t
  use dst_progress, only: progress_t, new_progress
  use dst_result_file, only: result_file_t
  use dst_scene, only: scene_t, scene_from_deck
  use dst_sha256, only: sha256
  use dst_signals, only: stop_signal, stopped_by, no_signal
  use dst_simulation, only: simulation_t
  use dst_plain_numbers, only: number_text, duration_text
  use dst_text, only: integer_text, printable
  use dst_writer, only: outcome_t
  implicit none
  private

  public :: run_deck, resume_run, describe_run

  !> Wall time of one slice of the run [s]: signals, progress, flushing and checkpoints are handled between slices.
  real(wp), parameter :: slice = 0.05_wp

  !> A run in progress.
  type :: run_t
    type(result_file_t) :: file
    type(simulation_t) :: simulation
    type(hdf5_writer_t) :: writer
    type(checkpoint_t) :: checkpoint   !! the last one, and the run to which it belongs
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
    type(scene_t) :: scene
    type(run_metadata_t) :: metadata
    character(:), allocatable :: model_choice

    report = ''
    call scene_from_deck(deck, scene)
    call settle_model(scene, model_choice)
    call run%simulation%start(scene, error)
    if (allocated(error)) return
    call describe_run(deck, run%simulation%scene, model_choice, metadata)
    call run%file%claim(result_file, overwrite, error)
    if (allocated(error)) return
    run%checkpoint%provenance_t = metadata%provenance_t
    call create_hdf5(run%writer, run%file%path(), result_file, metadata, run%simulation%output_columns(), error, &
      expected_rows(run%simulation%scene))
    call run%file%adopt()
    ! The file has a checkpoint from its first moment on.
    if (.not. allocated(error)) call save(run, .false., error)
    if (.not. allocated(error)) call run%file%put_in_place(error)
    if (allocated(error)) then
      call run%writer%discard()
      call run%file%abandon()
      return
    end if
    run%progress = new_progress(deck%name, quiet)
    if (model_choice /= '') call run%progress%remark("model 'auto' is "//model_choice)
    call carry_out(run, report, error)
    call run%file%release()
  end subroutine run_deck

  !> Continue the run that wrote `result_file` from its last checkpoint.
  subroutine resume_run(result_file, quiet, report, error)
    character(*), intent(in) :: result_file
    logical, intent(in) :: quiet
    character(:), allocatable, intent(out) :: report   !! as in `run_deck`
    type(error_t), allocatable, intent(out) :: error
    type(run_t) :: run
    type(error_t), allocatable :: no_checkpoint
    logical :: is_at_its_end

    report = ''
    run%progress = new_progress(result_file, quiet)
    call run%file%claim_unfinished(result_file, run%checkpoint, no_checkpoint, error)
    if (allocated(error)) return
    call check_origin(run, .not. allocated(no_checkpoint), is_at_its_end, error)
    ! Only now: a run that has ended has no checkpoint.
    if (.not. allocated(error)) call move_alloc(no_checkpoint, error)
    if (is_at_its_end .and. .not. allocated(error)) then
      call run%file%unseal()
      call run%file%seal(run%checkpoint%result_checksum, error)
      if (.not. allocated(error)) call run%file%delete_checkpoint()
    else if (.not. allocated(error)) then
      call go_on(run, error)
      if (.not. allocated(error)) call carry_out(run, report, error)
    end if
    call run%file%release()
  end subroutine resume_run

  !> Restore the run from its checkpoint, and prepare its file for writing.
  subroutine go_on(run, error)
    type(run_t), intent(inout) :: run
    type(error_t), allocatable, intent(out) :: error
    type(deck_t), allocatable :: deck
    type(scene_t) :: scene
    type(bookmark_t) :: bookmark
    character(:), allocatable :: model_choice
    character(1) :: no_settings(0)

    allocate (deck)
    call parse_deck(run%checkpoint%deck_resolved, run%file%name, no_settings, deck, error)
    if (allocated(error)) return
    call scene_from_deck(deck, scene)
    call settle_model(scene, model_choice)
    call run%simulation%start(scene, error)
    if (.not. allocated(error)) call load(run, bookmark, error)
    if (allocated(error)) return
    if (was_stopped(run%checkpoint)) then
      ! From here on no checksum protects the file as a whole.
      run%checkpoint%result_checksum = '-'
      call run%file%save_checkpoint(run%checkpoint, .true., error)
      if (.not. allocated(error)) call run%file%unseal()
    else
      call rebuild(run, deck, model_choice, bookmark, expected_rows(run%simulation%scene), error)
    end if
    if (.not. allocated(error)) &
      call reopen_hdf5(run%writer, run%file%path(), run%file%name, bookmark, run%simulation%output_columns(), error, &
        expected_rows(run%simulation%scene))
  end subroutine go_on

  !> Whether the run was stopped, not killed: then the checkpoint has a checksum of the complete file.
  pure logical function was_stopped(checkpoint)
    type(checkpoint_t), intent(in) :: checkpoint

    was_stopped = checkpoint%result_checksum /= '-'
  end function was_stopped

  !> The file must leave something to resume and must fit the checkpoint, if there is one. Damage anywhere in the file may make HDF5
  !> fail, so a child process reads it.
  subroutine check_origin(run, has_checkpoint, is_at_its_end, error)
    type(run_t), intent(in) :: run
    logical, intent(in) :: has_checkpoint
    logical, intent(out) :: is_at_its_end   !! only the seal is missing: the run was killed in its last moment
    type(error_t), allocatable, intent(out) :: error
    character(*), parameter :: at_its_end = 'at its end'
    type(guard_t) :: guard
    type(origin_t) :: origin
    character(:), allocatable :: answer

    is_at_its_end = .false.
    ! The file of a run that was stopped must be unchanged.
    if (has_checkpoint .and. was_stopped(run%checkpoint)) then
      if (.not. run%file%is_as_it_was_left(run%checkpoint%result_checksum)) then
        call raise(error, file_error, run%file%name//': cannot resume: the file is missing, or was changed or damaged since '// &
          'the run was stopped: put it back, or run the deck again')
        return
      end if
    end if
    call guard%begin()
    if (guard%in_child) then
      call read_origin(run%file%path(), run%file%name, origin, error)
      if (allocated(error)) call guard%reply(error%text)
      is_at_its_end = has_checkpoint .and. origin%complete == 1 .and. origin%result_code == result_done
      answer = ''
      if (.not. is_at_its_end) answer = what_has_ended(origin)
      if (answer == '' .and. has_checkpoint) answer = what_differs(run%checkpoint, origin)
      if (answer /= '') call guard%reply(run%file%name//': cannot resume: '//answer)
      if (is_at_its_end) call guard%reply(at_its_end)
      call guard%reply('')
    end if
    answer = answer_of(guard, run%file%name)
    is_at_its_end = answer == at_its_end
    if (answer /= '' .and. .not. is_at_its_end) call raise(error, file_error, answer)
  end subroutine check_origin

  !> Replace the file of a killed run by a new one: only the numbers of its columns are taken from the old file.
  subroutine rebuild(run, deck, model_choice, bookmark, rows, error)
    type(run_t), intent(inout) :: run
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: model_choice
    type(bookmark_t), intent(in) :: bookmark
    integer, intent(in) :: rows   !! expected number of rows
    type(error_t), allocatable, intent(out) :: error
    type(run_metadata_t) :: metadata
    type(guard_t) :: guard
    character(:), allocatable :: old_name, new_name, answer

    call describe_run(deck, run%simulation%scene, model_choice, metadata)
    metadata%provenance_t = run%checkpoint%provenance_t
    old_name = run%file%path()
    call run%file%replace_own()
    new_name = run%file%path()
    call guard%begin()
    if (guard%in_child) then
      call rebuild_hdf5(old_name, new_name, run%file%name, bookmark, metadata, run%simulation%output_columns(), guard, error, rows)
      if (allocated(error)) call guard%reply(error%text)
      call guard%reply('')
    end if
    answer = answer_of(guard, run%file%name)
    if (answer /= '') call raise(error, file_error, answer)
    call run%file%adopt()
    if (.not. allocated(error)) call run%file%put_in_place(error)
    if (allocated(error)) call run%file%discard()
  end subroutine rebuild

  !> The answer of the child process, '' if all is well.
  function answer_of(guard, result_file) result(answer)
    type(guard_t), intent(inout) :: guard
    character(*), intent(in) :: result_file
    character(:), allocatable :: answer

    call guard%await(answer)
    if (.not. allocated(answer)) answer = result_file//': cannot resume: it is so damaged that HDF5 fails on it: run the deck again'
  end function answer_of

  !> Why a run that ended without being stopped leaves nothing to resume; '' if it was stopped.
  pure function what_has_ended(origin) result(reason)
    type(origin_t), intent(in) :: origin
    character(:), allocatable :: reason

    reason = ''
    if (origin%complete /= 0) then
      reason = 'the run is complete'
    else if (exit_status(origin%result_code) == 4 .and. origin%result_code /= out_of_memory) then
      reason = 'the solver gave up, and would fail again: '//origin%result_text
    end if
  end function what_has_ended

  !> Why a checkpoint does not belong to the run of the result file, or not to this version of the program; '' if it does.
  pure function what_differs(checkpoint, origin) result(reason)
    type(checkpoint_t), intent(in) :: checkpoint
    type(origin_t), intent(in) :: origin
    character(:), allocatable :: reason
    character(*), parameter :: remedy = ': run the deck again'

    reason = ''
    if (origin%deck_sha256 /= sha256(origin%deck_text)) then
      reason = 'the deck in the file is damaged'//remedy
    else if (checkpoint%deck_sha256 /= origin%deck_sha256) then
      reason = 'the checkpoint is of another deck (SHA-256 '//checkpoint%deck_sha256//') than the file ('// &
        origin%deck_sha256//')'//remedy
    else if (checkpoint%deck_resolved /= origin%deck_resolved) then
      reason = 'the checkpoint is of another deck as used (SHA-256 '//sha256(checkpoint%deck_resolved)//') than the file ('// &
        sha256(origin%deck_resolved)//')'//remedy
    else if (checkpoint%created /= origin%created) then
      reason = 'the checkpoint is of the run begun at '//checkpoint%created//', the file of that begun at '// &
        origin%created//remedy
    else if (checkpoint%version /= version) then
      reason = 'the checkpoint is of version '//checkpoint%version//', this program is version '//version// &
        ': resume with the former, or run the deck again'
    end if
  end function what_differs

  !> Integrate to the end or until a request to stop, and finish the file.
  subroutine carry_out(run, report, error)
    type(run_t), intent(inout) :: run
    character(:), allocatable, intent(out) :: report
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: save_error, end_error
    type(outcome_t) :: outcome

    report = ''
    call integrate(run, error)
    if (has_code(error, stopped_early)) then
      call raise(error, stopped_early, stop_text(run))
      call save(run, .true., save_error)
      if (allocated(save_error)) call move_alloc(save_error, error)
    end if
    call run%simulation%outcome(error, outcome)
    if (is_irregular(outcome)) call run%progress%remark('the motion is irregular, its cycles have a distribution and no value: '// &
      'Lyapunov exponent '//number_text(outcome%summary_of('lyapunov_exponent'))//' +- '// &
      number_text(outcome%summary_of('lyapunov_error'))//' per slow cycle')
    call run%writer%finish(outcome, end_error)
    if (.not. allocated(end_error)) call run%file%seal(run%checkpoint%result_checksum, end_error)
    ! A lost file matters more than a stopped run; it does not change the error of a solver that gave up.
    ! allow(C161)
    if (allocated(end_error) .and. (has_code(error, stopped_early) .or. .not. allocated(error))) call move_alloc(end_error, error)
    if (has_code(error, stopped_early)) then
      call run%file%save_checkpoint(run%checkpoint, .true., save_error)
      if (allocated(save_error)) call move_alloc(save_error, error)
    else if (.not. has_code(error, file_error)) then
      ! A run that ended without being stopped is not continued.
      call run%file%delete_checkpoint()
    end if
    if (.not. allocated(error)) report = report_of(run, outcome)
  end subroutine carry_out

  !> 'my.h5: 10 s, 125001 samples, 8 cycles: period 0.915 s, peak 1.993 N, valley 1.169 N, slip 0.8822 mm (0.3 s)', and what to look
  !> at next.
  function report_of(run, outcome) result(text)
    type(run_t), intent(in) :: run
    type(outcome_t), intent(in) :: outcome
    character(:), allocatable :: text, took
    character(*), parameter :: no_cycle = ', no stick-slip cycle'
    integer :: cycles
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
      end if
    end if
    took = duration_text(run%simulation%elapsed)
    if (run%simulation%elapsed < 1.0_wp) took = shown(run%simulation%elapsed, 's', 2)
    text = text//' ('//took//'); see dynstiction plot '//printable(run%file%name)//new_line('a')
  end function report_of

  !> Four digits, or the requested number, and the unit.
  function shown(value, unit, figures) result(text)
    real(wp), intent(in) :: value
    character(*), intent(in) :: unit
    integer, intent(in), optional :: figures
    character(:), allocatable :: text
    integer :: digits

    digits = 4
    if (present(figures)) digits = figures
    text = number_text(value, digits)//' '//unit
  end function shown

  !> Whether the run is known to be irregular.
  logical function is_irregular(outcome)
    type(outcome_t), intent(in) :: outcome

    is_irregular = .false.
    if (any(outcome%summary%name == 'regularity')) is_irregular = outcome%summary_of('regularity') < 0.0_wp
  end function is_irregular

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
    real(wp) :: flushed, saved

    associate (simulation => run%simulation, scene => run%simulation%scene)
      flushed = simulation%elapsed
      saved = simulation%elapsed
      do
        call simulation%proceed(slice, run%writer, error)
        if (simulation%finished .or. allocated(error)) exit
        if (stop_signal() /= no_signal) call raise(error, stopped_early, '')
        if (allocated(error)) exit
        call run%progress%show('t', simulation%motion%piece%to%time, scene%t_end, simulation%elapsed)
        if (scene%checkpoint_interval > 0.0_wp .and. simulation%elapsed - saved >= scene%checkpoint_interval) then
          call save(run, .true., error)
          saved = simulation%elapsed
          flushed = saved
        else if (simulation%elapsed - flushed >= scene%flush_seconds) then
          call run%writer%flush(error)
          flushed = simulation%elapsed
        end if
        if (allocated(error)) exit
      end do
    end associate
    call run%progress%close()
  end subroutine integrate

  !> Write a checkpoint of everything done so far. `durable`: it and the result survive a power failure.
  subroutine save(run, durable, error)
    type(run_t), intent(inout) :: run
    logical, intent(in) :: durable
    type(error_t), allocatable, intent(out) :: error
    type(archive_t) :: archive
    type(bookmark_t) :: bookmark

    call run%writer%set_bookmark(durable, bookmark, error)
    if (allocated(error)) return
    call bookmark%serialise(archive)
    call run%simulation%serialise(archive)
    run%checkpoint%words = archive%words()
    run%checkpoint%result_checksum = '-'
    call run%file%save_checkpoint(run%checkpoint, durable, error)
  end subroutine save

  !> The simulation at the time of the checkpoint, and the length of the file then.
  subroutine load(run, bookmark, error)
    type(run_t), intent(inout) :: run
    type(bookmark_t), intent(out) :: bookmark
    type(error_t), allocatable, intent(out) :: error
    type(archive_t) :: archive

    bookmark = empty_bookmark(size(run%simulation%output_columns()))
    call archive_of(run%checkpoint%words, archive)
    call bookmark%serialise(archive)
    call run%simulation%serialise(archive)
    if (.not. archive%given_back()) call raise(error, file_error, run%file%name//': cannot resume: the checkpoint holds '// &
      'another state than this program has: resume with the program that began the run, or run the deck again')
  end subroutine load

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

    metadata%program = program_name
    metadata%version = version
    metadata%git_revision = git_revision
    metadata%compiler = compiler
    metadata%build_flags = build_flags
    metadata%host = host_name()
    metadata%job = job_name()
    metadata%mpi = mpi_library()
    metadata%created = utc_now()
    metadata%model = scene%model
    metadata%model_choice = model_choice
    metadata%method = scene%method_name()
    metadata%deck_text = deck%text
    metadata%deck_resolved = resolved(deck)
    metadata%deck_sha256 = sha256(deck%text)
    ! A sweep without series leaves this to its cases.
    if (scene%interval < 0.0_wp) then
      call parameters_of(deck, metadata%parameters)
    else
      call parameters_of(deck, metadata%parameters, scene%interval)
    end if
  end subroutine describe_run
end module dst_run
