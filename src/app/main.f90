!> What the executable does. Only here is anything printed about errors.
module dst_main
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, has_code, exit_status, result_done, usage_error, file_error, stopped_early
  use dst_text, only: integer_text, one_per_line, printable
  use dst_disk, only: path_t, place_of, stem_of
  use dst_error_page, only: error_page
  use dst_cycles_report, only: cycles_report
  use dst_deck, only: deck_t, read_deck, resolved, template
  use dst_deck_check, only: check_deck
  use dst_command_line, only: command_t, program_arguments, is_own_command, parse_arguments, &
    setting_list, help_text, errors_topic
  use dst_catalogue, only: catalogue
  use dst_handover, only: hand_over
  use dst_plain_numbers, only: number_text
  use dst_progress, only: progress_t, new_progress
  use dst_result_file, only: check_target
  use dst_run, only: run_deck, resume_run
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: sweep_group
  use dst_share, only: launched_together
  use dst_sweep_points, only: path_of_points
  use dst_sweep_runner, only: check_sweep_target, run_sweep
  use dst_show, only: show_result
  use dst_signals, only: listen_to_requests, listen_to_signals, is_told_to_end, stopped_by
  use dst_machine, only: runs_v3
  use dst_stability_report, only: stability_report
  use dst_standard_streams, only: put_output, put_error
  use dst_stopwatch, only: wall_clock
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
  !> A search for cycles, and when it began [s].
  type(progress_t) :: progress
  real(wp) :: begun = 0.0_wp
  !> Exit status of the program: that of the first error.
  integer, public, protected :: status = result_done

contains

  !> Carry out the command.
  subroutine follow_arguments(self, number)
    class(program_t), intent(inout), target :: self
    integer, intent(in) :: number
    type(path_t), allocatable :: arguments(:)
    type(error_t), allocatable :: error
    logical :: is_ours

    associate (unused => self, also_unused => number)
    end associate
    call listen_to_requests()
    allocate (arguments, source=program_arguments())
    is_ours = is_own_command(arguments)
    if (is_ours) call parse_arguments(arguments, command, error)
    if (is_ours .and. .not. allocated(error)) then
      is_ours = .not. (command%has('--along') .or. command%has('--key'))
      if (.not. is_ours) arguments(1)%text = trim(merge('branch', 'range ', command%has('--along')))
    end if
    if (.not. is_ours) call hand_over(arguments, error)
    call complain(error)
    if (.not. allocated(error)) call execute()
  end subroutine follow_arguments

  !> Carry out the command.
  subroutine execute()
    type(error_t), allocatable :: error
    character(:), allocatable :: text, model

    if (command%name == 'help') then
      text = help_on_topic()
    else if (command%has('--help')) then
      text = help_text(command%name)
    else if (command%name == 'version') then
      text = version_text()
    else if (command%has('--json')) then
      text = catalogue(version)
    else if (command%name == 'template') then
      model = 'full'
      if (size(command%operands) == 1) model = command%operands(1)%text
      call template(model, text, error)
    end if
    call complain(error)
    if (allocated(error)) return
    if (allocated(text)) then
      call print_text(text)
    else if (command%name == 'run' .or. command%name == 'merge' .or. command%name == 'resume') then
      call run_each()
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

    text = 'loops:     '//trim(merge('x86-64-v3', 'plain    ', runs_v3()))// &
      new_line('a')//'rounding:  '//arithmetic_fingerprint()//new_line('a')
    text = program_name//' '//version//' ('//git_revision//', '//compiler//')'//new_line('a')//build_facts//text
  end function version_text

  !> Print what the command says about each operand, and all faults of the others.
  subroutine print_each()
    type(error_t), allocatable :: error
    character(:), allocatable :: text
    integer :: i

    do i = 1, size(command%operands)
      if (command%name == 'show') then
        call show_result(command%operands(i)%text, text, error)
      else
        call describe_deck(command%operands(i)%text, text, error)
      end if
      ! A search that was stopped has both.
      if (allocated(text)) then
        if (text /= '') call print_text(text)
      end if
      call complain(error)
    end do
  end subroutine print_each

  !> A deck as it is used, the linear theory of its scene, or its limit cycles.
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
    else
      call scene_from_deck(deck, scene)
      if (command%name == 'cycles') then
        call listen_to_signals()
        progress = new_progress(deck%name, .false.)
        begun = wall_clock()
        call cycles_report(deck, scene, printable(deck%name), command%sensitivity, text, error, is_stopped)
        call progress%close()
        if (is_told_to_end()) call raise(error, stopped_early, stopped_by()//': there may be more cycles')
      else
        call stability_report(scene, printable(deck%name), text, error)
      end if
      if (allocated(error)) error%text = printable(deck%name)//': '//error%text
    end if
  end subroutine describe_deck

  !> Show how far a search for cycles is; whether it has to end.
  logical function is_stopped(passages)
    integer(int64), intent(in) :: passages

    associate (elapsed => wall_clock() - begun)
      if (progress%is_due(elapsed)) call progress%show('cycles of '//number_text(real(passages, wp))//' passages', elapsed)
    end associate
    is_stopped = is_told_to_end()
  end function is_stopped

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
    call check_deck(deck, output_of(deck), command%share, notes, interval, error)
  end subroutine take_deck

  !> Print notes, which do not change the status.
  subroutine put_notes(notes)
    character(*), intent(in) :: notes   !! one in each line, each with a line end

    if (notes /= '') call put_error(one_per_line(notes(:len(notes) - 1), 'dynstiction: '))
  end subroutine put_notes

  !> Print what a run has found. Its file is complete, so nothing is lost if this output cannot be written.
  subroutine put_report(report)
    character(*), intent(in) :: report
    logical :: ignored

    if (report /= '') call put_output(report, ignored)
  end subroutine put_report

  !> Run the decks, join the shares of their sweeps, or continue runs. Nothing is done unless every deck is valid and every output
  !> file may be written.
  subroutine run_each()
    type(deck_t), allocatable :: decks(:)
    type(path_t), allocatable :: outputs(:)
    type(error_t), allocatable :: error
    integer :: i

    allocate (decks(size(command%operands)), outputs(size(command%operands)))
    if (command%name /= 'resume') call prepare(decks, outputs)
    if (status /= result_done) return
    call listen_to_signals()
    do i = 1, size(decks)
      call carry_out(command%operands(i)%text, decks(i), outputs(i), error)
      if (.not. allocated(error)) cycle
      ! The report of an error of a file names the file.
      if (error%code /= file_error .and. error%text /= '') error%text = printable(command%operands(i)%text)//': '//error%text
      call complain(error)
      if (has_code(error, stopped_early)) exit
    end do
  end subroutine run_each

  !> Read and check the decks, and the files that they will write.
  subroutine prepare(decks, outputs)
    type(deck_t), intent(inout) :: decks(:)
    type(path_t), intent(inout) :: outputs(:)
    type(error_t), allocatable :: error
    character(:), allocatable :: notes
    real(wp), allocatable :: interval
    integer :: i

    do i = 1, size(decks)
      call take_deck(command%operands(i)%text, decks(i), notes, interval, error)
      call complain(error)
      if (allocated(error)) cycle
      outputs(i)%text = output_of(decks(i))
      if (.not. command%has('--quiet')) call put_notes(notes)
    end do
    if (status /= result_done) return
    do i = 1, size(decks)
      call check_use(decks(i), error)
      if (.not. allocated(error)) &
        call check_output(outputs, i, inputs_of(decks), command%has('--overwrite'), decks(i)%is_sweep(), error)
      if (decks(i)%is_sweep() .and. .not. allocated(error)) &
        call check_sweep_target(decks(i), outputs(i)%text, command, error)
      call complain(error)
    end do
  end subroutine prepare

  !> Whether the command is one for this deck.
  subroutine check_use(deck, error)
    type(deck_t), intent(in) :: deck
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: variable
    integer :: processes, rank

    if (.not. deck%is_sweep()) then
      if (command%name == 'merge') then
        call raise(error, usage_error, printable(deck%name)//': has no &sweep: there is nothing to merge')
      else if (command%has('--share') .or. command%has('--retry')) then
        call raise(error, usage_error, printable(deck%name)//': has no &sweep: run it without --share and --retry')
      end if
    else if (command%name == 'run' .and. .not. command%has('--share')) then
      call launched_together(processes, rank, variable)
      if (processes > 1) call raise(error, usage_error, 'this is one of '//integer_text(processes)//' processes ('//variable// &
        '), which would all run the same cases: give each its share with --share auto, or start the program once')
    end if
  end subroutine check_use

  !> One run, sweep or merge, or the rest of a run.
  subroutine carry_out(operand, deck, output, error)
    character(*), intent(in) :: operand
    type(deck_t), intent(in) :: deck             !! of a new run
    type(path_t), intent(in) :: output       !! its file
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: report

    if (command%name == 'resume') then
      call resume_run(operand, command%has('--quiet'), report, error)
    else if (deck%is_sweep()) then
      call run_sweep(deck, output%text, command, report, error)
    else
      call run_deck(deck, output%text, command%has('--overwrite'), command%has('--quiet'), report, error)
    end if
    if (.not. command%has('--quiet')) call put_report(report)
  end subroutine carry_out

  !> The output file: of -o, of the deck, or the deck's name with .h5 in the current directory.
  function output_of(deck) result(file_name)
    type(deck_t), intent(in) :: deck
    character(:), allocatable :: file_name

    file_name = command%output
    ! The deck's own file is that of its run.
    associate (own => deck%name(index(deck%name, '/', back=.true.) + 1:stem_of(deck%name)))
      if (file_name == '' .and. command%variations > 0) file_name = own//'_sweep.h5'
      if (file_name == '') file_name = deck%text_of('output', 'file')
      if (file_name == '') file_name = own//'.h5'
    end associate
  end function output_of

  !> The files that the command reads: its decks and their lists of points.
  function inputs_of(decks) result(inputs)
    type(deck_t), intent(in) :: decks(:)
    type(path_t), allocatable :: inputs(:)
    integer :: i

    inputs = command%operands
    do i = 1, size(decks)
      if (.not. decks(i)%is_sweep()) cycle
      if (decks(i)%text_of(sweep_group, 'points') /= '') inputs = [inputs, path_t(path_of_points(decks(i)))]
    end do
  end function inputs_of

  !> Whether output `i` may be created, and is neither the output of another deck nor a file that is read.
  subroutine check_output(outputs, i, inputs, may_replace, is_sweep, error)
    type(path_t), intent(in) :: outputs(:), inputs(:)
    integer, intent(in) :: i
    logical, intent(in) :: may_replace, is_sweep   !! a sweep goes on in a file of its own
    type(error_t), allocatable, intent(out) :: error
    integer :: other

    associate (file_name => outputs(i)%text)
      do other = 1, size(inputs)
        if (allocated(error)) return
        if (place_of(inputs(other)%text) == place_of(file_name)) call raise(error, file_error, file_name// &
          ': this is a deck, or a list of points, of the command: use another name for the result')
      end do
      if (.not. (allocated(error) .or. is_sweep)) call check_target(file_name, may_replace, error)
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
    if (error%text /= '') call put_error(one_per_line(error%text, 'dynstiction: '))
    if (status == result_done) status = exit_status(error%code)
  end subroutine complain

  subroutine print_text(text)
    character(*), intent(in) :: text
    type(error_t), allocatable :: error
    logical :: failed

    call put_output(text, failed)
    if (.not. failed) return
    call raise(error, file_error, 'cannot write to the standard output: it is closed, or the disk is full')
    call complain(error)
  end subroutine print_text
end module dst_main
