!> What the executable does. Only here is anything printed about errors.
module dst_main
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, has_code, exit_status, result_done, usage_error, file_error, stopped_early
  use dst_text, only: integer_text, one_per_line, printable, real_text
  use dst_disk, only: place_of
  use dst_error_page, only: error_page
  use dst_cycles_report, only: cycles_report
  use dst_hdf5_origin, only: sweep_state_t, state_of_sweep, is_deck
  use dst_model_choice, only: settle_model
  use dst_sampling, only: settle_interval
  use dst_plain_numbers, only: duration_text
  use dst_stopwatch, only: wall_clock
  use dst_deck, only: deck_t, read_deck, parse_deck, resolved, template, key_table
  use dst_deck_check, only: check_deck
  use dst_command_line, only: argument_t, command_t, program_arguments, is_python_command, parse_arguments, &
    setting_list, help_text, errors_topic
  use dst_catalogue, only: catalogue
  use dst_completion, only: is_completion, completions
  use dst_handover, only: hand_over
  use dst_division, only: processes_here
  use dst_processes, only: processes_t, mpi_library
  use dst_result_file, only: check_target
  use dst_run, only: run_deck, resume_run
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: sweep_group
  use dst_sweep_file, only: is_of_unfinished_sweep
  use dst_sweep_points, only: path_of_points
  use dst_sweep_runner, only: sweep_options_t, run_sweep, merge_sweep
  use dst_show, only: show_result, deck_in_brief
  use dst_signals, only: listen_to_requests, listen_to_signals
  use dst_instructions, only: runs_v3
  use dst_stability_report, only: stability_report
  use dst_standard_streams, only: put_output, put_error
  use dst_threads, only: task_t
  use dst_arithmetic, only: arithmetic_fingerprint
  use dst_build_info, only: program_name, version, git_revision, compiler, build_facts
  implicit none
  private

  public :: program_t

  !> The program as a task, since it needs a thread with a large enough stack.
  type, extends(task_t) :: program_t
  contains
    procedure :: work => follow_arguments
  end type program_t

  type(command_t) :: command
  type(processes_t) :: processes
  !> Number of processes of this program that a launcher has started together, the number of this one, and the variable that says
  !> so.
  integer :: copies = 0, copy = 0
  character(:), allocatable :: copies_variable
  !> Exit status of the program: that of the first error.
  integer, public, protected :: status = result_done

contains

  !> Carry out the command.
  subroutine follow_arguments(self, number)
    class(program_t), intent(inout), target :: self
    integer, intent(in) :: number
    type(argument_t), allocatable :: arguments(:)
    type(error_t), allocatable :: error, usage

    associate (unused => self, also_unused => number)
    end associate
    call listen_to_requests()
    allocate (arguments, source=program_arguments())
    if (is_completion(arguments)) then
      call print_text(completions(arguments))
      return
    end if
    call processes_here(copies, copy, copies_variable)
    if (is_python_command(arguments)) then
      call check_alone("'"//arguments(1)%text//"'", error)
      if (.not. allocated(error)) call hand_over(arguments, error)
      call complain(error)
      return
    end if
    call parse_arguments(arguments, command, usage)
    ! Before anything can fail except the parsing. It is not needed by processes that take their shares from the environment, nor by
    ! one that is replaced by Python.
    if (copies > 1 .and. .not. (command%share%is_auto .or. command%name == 'trade')) call processes%start(error)
    if (.not. allocated(error)) call move_alloc(usage, error)
    call processes%agree(error)
    call complain(error)
    if (.not. allocated(error)) call execute()
    call agree_on_status()
    call processes%end()
  end subroutine follow_arguments

  !> Processes that communicate end with one status.
  subroutine agree_on_status()
    type(error_t), allocatable :: verdict

    if (status /= result_done) verdict = error_t(status, '')
    call processes%agree(verdict)
    if (allocated(verdict)) status = exit_status(verdict%code)
  end subroutine agree_on_status

  !> Whether this is one of several copies that do not communicate.
  pure logical function is_lost()
    is_lost = copies > 1 .and. processes%count == 1 .and. .not. command%share%is_given
  end function is_lost

  !> Refuse `what`, or a sweep if it is '', to several copies, each of which would write the same files.
  subroutine check_alone(what, error)
    character(*), intent(in) :: what
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    if (.not. is_lost()) return
    reason = what//' is for one process: start it without the launcher'
    if (what == '') reason = 'they do not communicate: start the program once, build it with -Dmpi=enabled for this '// &
      'MPI, or use --shard'
    call raise(error, usage_error, 'this is one of '//integer_text(copies)//' copies ('//copies_variable//'), and '//reason)
  end subroutine check_alone

  !> Carry out the command. Texts are printed by the first process; runs and merges are done by all; everything else is done by one
  !> process, while the others wait for its status.
  subroutine execute()
    type(error_t), allocatable :: error
    character(:), allocatable :: text, model

    if (command%name == 'help') then
      text = help_on_topic()
    else if (command%has('--help')) then
      text = help_text(command%name)
    else if (command%name == 'version') then
      text = version_text()
    else if (command%name == 'template') then
      model = 'full'
      if (size(command%operands) == 1) model = command%operands(1)%text
      call template(model, text, error)
      call processes%agree(error)
    else if (command%has('--json')) then
      text = catalogue(version)
    else if (command%name == 'keys') then
      text = key_table()
    else if (command%name /= 'run') then
      call check_alone("'"//command%name//"'", error)
    end if
    call complain(error)
    if (allocated(error)) return
    if (allocated(text)) then
      call print_text(text)
    else if (command%name == 'run' .or. command%name == 'merge') then
      call run_decks()
    else if (processes%rank > 0) then
      ! After a signal to all processes, the first one decides when to end.
      call listen_to_signals()
    else if (command%name == 'trade') then
      call compare_settings()
    else if (command%name == 'resume') then
      call resume_runs()
    else
      call print_each()
    end if
  end subroutine execute

  !> What 'help' prints: about the program, a command, or errors.
  function help_on_topic() result(text)
    character(:), allocatable :: text

    if (size(command%operands) == 0) then
      text = help_text('')
    else if (command%operands(1)%text == errors_topic) then
      text = error_page()
    else
      text = help_text(command%operands(1)%text)
    end if
  end function help_on_topic

  function version_text() result(text)
    character(:), allocatable :: text

    text = mpi_library()
    if (text == '') text = 'no'
    text = 'MPI:       '//text//new_line('a')//'loops:     '//trim(merge('x86-64-v3', 'plain    ', runs_v3()))// &
      new_line('a')//'rounding:  '//arithmetic_fingerprint()//new_line('a')
    text = program_name//' '//version//' ('//git_revision//', '//compiler//')'//new_line('a')//build_facts//text
  end function version_text

  !> Print what the command says about each operand, and all faults of the others.
  subroutine print_each()
    type(error_t), allocatable :: error
    character(:), allocatable :: text
    logical :: is_result
    integer :: i

    do i = 1, size(command%operands)
      is_result = command%name == 'show'
      if (is_result) is_result = .not. is_deck(command%operands(i)%text)
      if (is_result) then
        call show_result(command%operands(i)%text, text, error)
      else
        call describe_deck(command%operands(i)%text, text, error)
      end if
      call complain(error)
      if (.not. allocated(error)) call print_text(text)
    end do
  end subroutine print_each

  !> A deck as it is used or in brief, the linear theory of its scene, or its limit cycles.
  subroutine describe_deck(file_name, text, error)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(deck_t), allocatable :: deck
    type(scene_t) :: scene
    character(:), allocatable :: notes
    real(wp), allocatable :: interval

    allocate (deck)
    call take_deck(file_name, deck, notes, interval, error)
    if (allocated(error)) return
    if (command%name == 'check') then
      call put_notes(notes)
      text = resolved(deck, interval)
    else if (command%name == 'show') then
      call scene_from_deck(deck, scene)
      call settle_model(scene, notes)
      call settle_interval(scene)
      text = deck_in_brief(deck%name, scene)
    else
      call scene_from_deck(deck, scene)
      if (command%name == 'cycles') then
        call cycles_report(scene, printable(deck%name), text, error)
      else
        call stability_report(scene, printable(deck%name), text, error)
      end if
      if (allocated(error)) error%text = printable(deck%name)//': '//error%text
    end if
  end subroutine describe_deck

  !> A deck with the settings of the command; a deck that 'check' and 'run' accept without an error will run.
  subroutine take_deck(file_name, deck, notes, interval, error)
    character(*), intent(in) :: file_name
    type(deck_t), intent(out) :: deck
    character(:), allocatable, intent(out) :: notes   !! what is allowed but seldom intended, one in each line
    real(wp), allocatable, intent(out) :: interval    !! between the samples of a run that is checked [s]
    type(error_t), allocatable, intent(out) :: error

    notes = ''
    call read_deck(file_name, setting_list(command), deck, error)
    if (allocated(error) .or. .not. (command%name == 'check' .or. command%name == 'run')) return
    associate (share => command%share)
      call check_deck(deck, output_of(deck), merge(max(1, share%shares), 0, share%is_given), notes, interval, error)
    end associate
  end subroutine take_deck

  !> Print notes, which do not change the status.
  subroutine put_notes(notes)
    character(*), intent(in) :: notes   !! one in each line, each with a line end

    if (notes /= '' .and. .not. is_mute()) call put_error(one_per_line(notes(:len(notes) - 1), 'dynstiction: '))
  end subroutine put_notes

  !> Print what a run has found. Its file is complete, so nothing is lost if this output cannot be written.
  subroutine put_report(report)
    character(*), intent(in) :: report
    logical :: ignored

    if (report /= '' .and. .not. is_mute()) call put_output(report, ignored)
  end subroutine put_report

  !> Let Python measure error against cost on a deck's scene, if the arguments, the deck and the name of the file are correct.
  subroutine compare_settings()
    type(deck_t), allocatable :: deck
    type(argument_t) :: output(1)
    type(error_t), allocatable :: error
    character(:), allocatable :: notes
    real(wp), allocatable :: interval

    allocate (deck)
    call take_deck(command%operands(1)%text, deck, notes, interval, error)
    if (.not. allocated(error)) then
      output(1)%text = command%output
      if (command%output == '') output(1)%text = name_after(deck, '_trade.h5')
      call check_output(output, 1, command%operands, command%has('--overwrite'), error)
    end if
    if (.not. allocated(error)) call hand_over(words_of_trade(output(1)%text), error)
    call complain(error)
  end subroutine compare_settings

  !> The command 'trade' in the form that Python takes.
  function words_of_trade(output) result(words)
    character(*), intent(in) :: output
    type(argument_t), allocatable :: words(:)
    integer :: i

    words = [argument_t('trade'), argument_t('--output='//output), argument_t('--budget='//real_text(command%budget)), &
             argument_t('--quantity='//command%quantity)]
    if (command%accuracy > 0.0_wp) words = [words, argument_t('--accuracy='//real_text(command%accuracy))]
    do i = 1, size(command%settings)
      words = [words, argument_t('--set='//command%settings(i)%text)]
    end do
    if (command%has('--overwrite')) words = [words, argument_t('--overwrite')]
    if (command%has('--all')) words = [words, argument_t('--all')]
    if (command%has('--quiet')) words = [words, argument_t('--quiet')]
    words = [words, argument_t('--'), command%operands]
  end function words_of_trade

  !> Run the decks, or merge their shards: nothing is done unless every deck is valid and every output file may be written.
  subroutine run_decks()
    type(deck_t), allocatable :: decks(:)
    type(argument_t), allocatable :: outputs(:)
    type(error_t), allocatable :: error
    integer :: i

    allocate (decks(size(command%operands)), outputs(size(command%operands)))
    if (processes%rank == 0) call prepare(decks, outputs)
    call agree_on_status()
    if (status /= result_done) return
    call listen_to_signals()
    do i = 1, size(decks)
      call share_deck(decks(i), outputs(i)%text, error)
      if (.not. allocated(error)) call carry_out(decks(i), outputs(i)%text, error)
      call processes%agree(error)
      call complain_of(decks(i)%name, error)
      if (has_code(error, stopped_early)) exit
    end do
  end subroutine run_decks

  !> Read and check the decks, and the files that they will write.
  subroutine prepare(decks, outputs)
    type(deck_t), intent(inout) :: decks(:)
    type(argument_t), intent(inout) :: outputs(:)
    type(error_t), allocatable :: error
    character(:), allocatable :: notes, what
    real(wp), allocatable :: interval
    logical :: may_replace
    integer :: i

    do i = 1, size(decks)
      call take_deck(command%operands(i)%text, decks(i), notes, interval, error)
      call complain(error)
      if (allocated(error)) cycle
      outputs(i)%text = output_of(decks(i))
      if (.not. command%has('--quiet')) call put_notes(notes)
    end do
    if (status == result_done .and. command%name == 'run') then
      what = 'a run'
      if (decks(1)%is_sweep()) what = ''
      if (size(decks) > 1) what = 'a command with several decks'
      call check_alone(what, error)
      call complain(error)
    end if
    if (status /= result_done) return
    do i = 1, size(decks)
      may_replace = command%has('--overwrite')
      if (decks(i)%is_sweep() .and. .not. may_replace) may_replace = is_of_unfinished_sweep(outputs(i)%text)
      call check_output(outputs, i, inputs_of(decks), may_replace, error)
      call complain(error)
    end do
  end subroutine prepare

  !> Send the deck that the first process has read to all.
  subroutine share_deck(deck, output, error)
    type(deck_t), intent(inout) :: deck
    character(:), allocatable, intent(inout) :: output
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: name, text
    character(1) :: no_settings(0)

    if (processes%count == 1) return
    if (processes%rank == 0) then
      name = deck%name
      text = resolved(deck)
    end if
    call processes%share_text(name)
    call processes%share_text(text)
    call processes%share_text(output)
    if (processes%rank > 0) call parse_deck(text, name, no_settings, deck, error)
  end subroutine share_deck

  !> One run or merge, by one process, or a sweep, by many.
  subroutine carry_out(deck, output, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: output
    type(error_t), allocatable, intent(out) :: error
    type(sweep_options_t) :: options
    character(:), allocatable :: report
    real(wp) :: begun

    options = sweep_options_t(overwrite=command%has('--overwrite'), quiet=command%has('--quiet'), &
      keep_shards=command%has('--keep-shards'), share=command%share)
    if (command%name == 'merge' .and. .not. deck%is_sweep()) then
      call raise(error, usage_error, 'has no &sweep: there is nothing to merge')
    else if (command%name == 'merge') then
      if (processes%rank == 0) call merge_sweep(deck, output, options, error)
    else if (deck%is_sweep()) then
      begun = wall_clock()
      call run_sweep(deck, output, options, processes, error)
      if (.not. (allocated(error) .or. options%quiet .or. options%share%is_given .or. processes%rank > 0)) &
        call report_sweep(output, wall_clock() - begun)
    else if (command%share%is_given) then
      call raise(error, usage_error, 'has no &sweep: run it without --shard')
    else if (processes%rank == 0) then
      call run_deck(deck, output, options%overwrite, options%quiet, report, error)
      if (.not. options%quiet) call put_report(report)
    end if
  end subroutine carry_out

  !> Print the result of a sweep, and what to look at next.
  subroutine report_sweep(output, seconds)
    character(*), intent(in) :: output
    real(wp), intent(in) :: seconds
    type(sweep_state_t) :: state

    state = state_of_sweep(output)
    call put_report(printable(output)//': '//integer_text(state%done)//' cases, '//integer_text(state%failed)//' failed ('// &
      duration_text(seconds)//'); see dynstiction plot '//printable(output)//new_line('a'))
  end subroutine report_sweep

  !> Report an error of an operand; the report of an error of a file names the file.
  subroutine complain_of(name, error)
    character(*), intent(in) :: name
    type(error_t), allocatable, intent(inout) :: error

    if (.not. allocated(error)) return
    if (error%code /= file_error .and. error%text /= '') error%text = printable(name)//': '//error%text
    call complain(error)
  end subroutine complain_of

  !> Continue each run in turn.
  subroutine resume_runs()
    type(error_t), allocatable :: error
    character(:), allocatable :: report
    integer :: i

    call listen_to_signals()
    do i = 1, size(command%operands)
      call resume_run(command%operands(i)%text, command%has('--quiet'), report, error)
      if (.not. command%has('--quiet')) call put_report(report)
      call complain_of(command%operands(i)%text, error)
      if (has_code(error, stopped_early)) exit
    end do
  end subroutine resume_runs

  !> The output file: of -o, of the deck, or the deck's name with .h5 in the current directory.
  function output_of(deck) result(file_name)
    type(deck_t), intent(in) :: deck
    character(:), allocatable :: file_name

    file_name = command%output
    ! The deck's own file is that of its run.
    if (file_name == '' .and. command%is_quick_sweep) file_name = name_after(deck, '_sweep.h5')
    if (file_name == '') file_name = deck%text_of('output', 'file')
    if (file_name == '') file_name = name_after(deck, '.h5')
  end function output_of

  !> The deck's name with another extension, in the current directory.
  function name_after(deck, ending) result(file_name)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: ending
    character(:), allocatable :: file_name
    integer :: first, last

    first = index(deck%name, '/', back=.true.) + 1
    last = index(deck%name, '.', back=.true.) - 1
    ! A dot that begins the name or is in a folder's name begins no extension.
    if (last < first) last = len(deck%name)
    file_name = deck%name(first:last)//ending
  end function name_after

  !> The files that the command reads: its decks and their lists of points.
  function inputs_of(decks) result(inputs)
    type(deck_t), intent(in) :: decks(:)
    type(argument_t), allocatable :: inputs(:)
    integer :: i

    inputs = command%operands
    do i = 1, size(decks)
      if (.not. decks(i)%is_sweep()) cycle
      if (decks(i)%text_of(sweep_group, 'points') /= '') inputs = [inputs, argument_t(path_of_points(decks(i)))]
    end do
  end function inputs_of

  !> Whether output `i` may be created, and is neither the output of another deck nor a file that is read.
  subroutine check_output(outputs, i, inputs, may_replace, error)
    type(argument_t), intent(in) :: outputs(:), inputs(:)
    integer, intent(in) :: i
    logical, intent(in) :: may_replace
    type(error_t), allocatable, intent(out) :: error
    integer :: other

    associate (file_name => outputs(i)%text)
      do other = 1, size(inputs)
        if (allocated(error)) return
        if (place_of(inputs(other)%text) == place_of(file_name)) call raise(error, file_error, file_name// &
          ': this is a deck, or a list of points, of the command: use another name for the result')
      end do
      if (.not. allocated(error)) call check_target(file_name, may_replace, error)
      do other = 1, i - 1
        if (allocated(error)) return
        if (place_of(outputs(other)%text) == place_of(file_name)) &
          call raise(error, file_error, file_name//': two decks write this file: give each deck its own output.file')
      end do
    end associate
  end subroutine check_output

  !> Print an error, if there is one; the first one decides the exit status.
  subroutine complain(error)
    type(error_t), allocatable, intent(in) :: error

    if (.not. allocated(error)) return
    ! If another process prints the message, only the status counts here.
    if (error%text /= '' .and. .not. is_mute()) call put_error(one_per_line(error%text, 'dynstiction: '))
    if (status == result_done) status = exit_status(error%code)
  end subroutine complain

  !> Of copies that do not communicate the first one prints for all.
  pure logical function is_mute()
    is_mute = is_lost() .and. copy > 0
  end function is_mute

  subroutine print_text(text)
    character(*), intent(in) :: text
    type(error_t), allocatable :: error
    logical :: failed

    if (is_mute() .or. processes%rank > 0) return
    call put_output(text, failed)
    if (.not. failed) return
    call raise(error, file_error, 'cannot write to the standard output: it is closed, or the disk is full')
    call complain(error)
  end subroutine print_text
end module dst_main
