!> Run a sweep or a share of it, and join shares: what `dynstiction run` does with a deck that has &sweep, and `merge`.
module dst_sweep_runner
  use dst_arithmetic, only: arithmetic_fingerprint
  use dst_build_info, only: version, git_revision
  use dst_command_line, only: command_t
  use dst_deck, only: deck_t, resolved
  use dst_deck_check, only: sweep_of_deck
  use dst_deck_sweep, only: varied_key
  use dst_deck_values, only: set_default
  use dst_disk, only: file_exists, path_t, place_of
  use dst_errors, only: error_t, raise, has_code, file_error, some_failed, stopped_early
  use dst_hdf5_writer, only: run_metadata_t
  use dst_kinds, only: wp, real64
  use dst_plain_numbers, only: duration_text
  use dst_posix, only: is_told_to_end, stopped_by
  use dst_result_file, only: check_target
  use dst_run, only: describe_run
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema
  use dst_sha256, only: sha256
  use dst_share, only: share_t, shares_of
  use dst_stopwatch, only: wall_clock
  use dst_sweep, only: sweep_t
  use dst_sweep_file, only: sweep_file_t, sweep_head_t, read_head
  use dst_sweep_work, only: sweep_work_t, run_missing_cases, thread_count
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: check_sweep_target, run_sweep

  !> Keys that say how a sweep is run, not what its cases are. The points themselves belong to the cases, the name of their file
  !> does not.
  character(26), parameter :: changeable(5) = [character(26) :: 'scene.title', 'sweep.points', 'output.file', &
    'output.checkpoint_interval', 'output.wall_limit']

  character(*), parameter :: of_another_build = 'is of another build of the program, or of a machine that rounds differently: '// &
    'go on with that program, or begin again with --overwrite'
  !> What is done about the file that has the name.
  integer, parameter :: to_begin = 1, to_go_on = 2, nothing_to_do = 3

contains

  !> Whether `run`, or `merge`, may write the file of a sweep.
  subroutine check_sweep_target(deck, result_file, command, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t) :: sweep
    type(sweep_head_t) :: found
    type(share_t), allocatable :: shares(:)
    type(path_t), allocatable :: files(:)
    character(:), allocatable :: name
    integer :: plan, other

    call shares_of(result_file, shares, files)
    other = findloc(shares%count /= command%share%count, .true., dim=1)
    name = command%share%file_name(result_file)
    call check_target(name, .true., error)
    if (allocated(error)) return
    if (command%share%count > 1 .and. other > 0 .and. .not. command%has('--overwrite')) then
      call raise(error, file_error, name//': cannot create: '//files(other)%text//' is of another division: use --share I/'// &
        integer_text(shares(other)%count)//', or join or move away the files of that division first')
    else if (file_exists(name)) then
      call sweep_of_deck(deck, sweep, error)
      if (.not. allocated(error)) call look_at(name, head_of(sweep, command%share), command, plan, found, error)
    end if
  end subroutine check_sweep_target

  !> Run all cases of the share that its file lacks; or join the files of all shares, and an incomplete one that has the result's
  !> name.
  subroutine run_sweep(deck, result_file, command, report, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file      !! of the whole sweep
    type(command_t), intent(in) :: command
    character(:), allocatable, intent(out) :: report
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t), target :: sweep
    type(sweep_work_t), target :: work
    type(sweep_head_t) :: found
    type(share_t), allocatable :: shares(:)
    type(path_t), allocatable :: files(:)
    type(error_t), allocatable :: stopped
    real(wp) :: begun
    character(:), allocatable :: name
    logical :: joins
    integer :: plan, rows

    joins = command%name == 'merge'
    begun = wall_clock()
    report = ''
    plan = to_begin
    name = command%share%file_name(result_file)
    call sweep_of_deck(deck, sweep, error)
    if (.not. allocated(error)) call look_at(name, head_of(sweep, command%share), command, plan, found, error)
    if (joins .and. plan == nothing_to_do .and. .not. allocated(error)) &
      call raise(error, file_error, name//': the file is complete: use --overwrite to join the shares again')
    if (joins .and. .not. allocated(error)) call check_shares(sweep, name, shares, files, error)
    if (allocated(error)) return
    rows = command%share%size(sweep%cases)
    found%done = rows
    if (plan /= nothing_to_do .and. rows > 0) then
      call open_file(work%file, sweep, name, command, plan, error)
      if (allocated(error)) return
      if (joins) then
        call take_shares(work%file, shares, files, stopped)
      else
        work%retry = command%has('--retry')
        call run_missing_cases(work, sweep, command%has('--quiet'), stopped)
      end if
      if (work%file%is_changed .and. .not. has_code(stopped, file_error)) call work%file%make_whole(error)
      call work%file%discard()
      if (.not. allocated(error)) call move_alloc(stopped, error)
      if (allocated(error)) return
      found%done = work%file%done
      found%failed = work%file%failed
    end if
    call conclude(name, command%share, rows, found%failed, found%done, error)
    if (.not. allocated(error)) report = report_on(name, command%share, rows, begun)
  end subroutine run_sweep

  !> Open the file of a share for new rows.
  subroutine open_file(file, sweep, result_file, command, plan, error)
    type(sweep_file_t), intent(inout) :: file
    type(sweep_t), intent(in), target :: sweep
    character(*), intent(in) :: result_file
    type(command_t), intent(in) :: command
    integer, intent(in) :: plan
    type(error_t), allocatable, intent(out) :: error
    type(run_metadata_t) :: metadata
    type(scene_t) :: scene

    call scene_from_deck(sweep%deck, scene)
    if (sweep%keeps_series) scene%interval = sweep%interval
    call describe_run(sweep%deck, scene, '', metadata)
    metadata%threads = thread_count(command%share%size(sweep%cases))
    call file%open(result_file, sweep, command%share, head_of(sweep, command%share), metadata, plan == to_go_on, &
      command%has('--overwrite'), error)
  end subroutine open_file

  !> The error of a sweep that is not complete, or in which cases failed.
  subroutine conclude(result_file, share, cases, failed, done, error)
    character(*), intent(in) :: result_file
    type(share_t), intent(in) :: share
    integer, intent(in) :: cases, failed, done
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: of_all

    of_all = ' of '//integer_text(cases)//' cases '
    if (share%count > 1) of_all = of_all//'of share '//share%text()//' '
    if (done < cases) then
      call raise(error, stopped_early, integer_text(cases - done)//of_all//'have not been run: run the deck again to run them')
    else if (failed > 0) then
      call raise(error, some_failed, integer_text(failed)//of_all//'failed: see result_code and failures in '//result_file// &
        '; --retry runs them again')
    end if
  end subroutine conclude

  function report_on(result_file, share, cases, begun) result(report)
    character(*), intent(in) :: result_file
    type(share_t), intent(in) :: share
    integer, intent(in) :: cases
    real(wp), intent(in) :: begun      !! wall time [s]
    character(:), allocatable :: report

    report = '; see dynstiction plot '//printable(result_file)
    if (share%count > 1) report = '; dynstiction merge joins the shares'
    report = printable(result_file)//': '//integer_text(cases)//' cases, 0 failed ('//duration_text(wall_clock() - begun)//')'// &
      report//new_line('a')
  end function report_on

  !> The files of the shares: all of this sweep and build, and of one division.
  subroutine check_shares(sweep, result_file, shares, files, error)
    type(sweep_t), intent(in) :: sweep
    character(*), intent(in) :: result_file
    type(share_t), allocatable, intent(out) :: shares(:)
    type(path_t), allocatable, intent(out) :: files(:)
    type(error_t), allocatable, intent(out) :: error
    type(share_t), parameter :: example = share_t(1, 16)
    type(sweep_head_t) :: ours, theirs
    character(:), allocatable :: reason
    integer :: i

    call shares_of(result_file, shares, files)
    if (size(files) == 0) call raise(error, file_error, result_file//': there is no file of a share, like '// &
      example%file_name(result_file)//': run the deck with --share I/N first')
    do i = 1, size(files)
      if (allocated(error)) return
      if (shares(i)%count /= shares(1)%count) then
        call raise(error, file_error, files(1)%text//' and '//files(i)%text//' are of different divisions of the sweep: move '// &
          'those of one away, and run the deck for what is missing')
        return
      end if
      call read_head(files(i)%text, theirs, reason)
      ours = head_of(sweep, shares(i))
      if (allocated(reason)) then
        reason = 'cannot be read: '//reason//': run this share again with --overwrite'
      else if (theirs%identity /= ours%identity .or. theirs%share /= ours%share) then
        reason = 'is no share of this sweep: move it away, or give the deck and the settings with which it was run'
      else if (theirs%build /= ours%build) then
        reason = of_another_build
      end if
      if (allocated(reason)) call raise(error, file_error, files(i)%text//': '//reason)
    end do
  end subroutine check_shares

  !> Copy the rows of all shares, as many cases at a time as fit into the memory.
  subroutine take_shares(file, shares, files, error)
    type(sweep_file_t), intent(inout) :: file
    type(share_t), intent(in) :: shares(:)
    type(path_t), intent(in) :: files(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: first, i

    do first = 1, file%rows, file%window
      do i = 1, size(files)
        call file%take_rows(files(i)%text, shares(i), first, error)
        if (allocated(error)) return
        if (.not. is_told_to_end()) cycle
        call raise(error, stopped_early, stopped_by()//' while shares were joined: start it again')
        return
      end do
    end do
  end subroutine take_shares

  !> What is to be done about the file that has the name; `found` describes it.
  subroutine look_at(name, head, command, plan, found, error)
    character(*), intent(in) :: name
    type(sweep_head_t), intent(in) :: head
    type(command_t), intent(in) :: command
    integer, intent(out) :: plan
    type(sweep_head_t), intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    plan = to_begin
    call check_target(name, .true., error)
    if (allocated(error)) return
    if (.not. file_exists(name)) return
    call read_head(place_of(name), found, reason)
    if (found%identity == head%identity .and. found%share == head%share .and. found%build == head%build) then
      if (.not. found%complete .or. (command%has('--retry') .and. found%failed > 0)) then
        plan = to_go_on
      else if (.not. command%has('--overwrite')) then
        plan = nothing_to_do
      end if
    else if (.not. command%has('--overwrite')) then
      if (allocated(reason)) then
        reason = 'cannot be read: '//reason//': --overwrite replaces it'
      else if (found%identity == head%identity .and. found%share == head%share) then
        reason = of_another_build
      end if
      if (allocated(reason)) then
        call raise(error, file_error, name//': '//reason)
      else
        call check_target(name, .false., error)
      end if
    end if
  end subroutine look_at

  !> The sweep, and the build on its kind of machine, to which a file must belong.
  function head_of(sweep, share) result(head)
    type(sweep_t), intent(in) :: sweep
    type(share_t), intent(in) :: share
    type(sweep_head_t) :: head
    character(64) :: digest

    digest = identity_of_sweep(sweep)
    head%identity = digest(:len(head%identity))
    digest = sha256(version//git_revision//arithmetic_fingerprint())
    head%build = digest(:len(head%build))
    head%share = share%text()
  end function head_of

  !> Every key that has an effect on a result, with the names and values of a list.
  function identity_of_sweep(sweep) result(identity)
    type(sweep_t), intent(in) :: sweep
    character(64) :: identity
    type(deck_t) :: deck
    integer :: i, k

    deck = sweep%deck
    do i = 1, size(changeable)
      k = varied_key(trim(changeable(i)))
      call set_default(schema(k), deck%value(k))
    end do
    identity = sha256(resolved(deck))
    if (.not. sweep%is_list) return
    do i = 1, size(sweep%axes)
      identity = sha256(identity//trim(sweep%axes(i)%name))
      call add_values(sweep%axes(i)%values, identity)
    end do
  end function identity_of_sweep

  !> Block by block, so that the text of many values stays short.
  subroutine add_values(values, digest)
    real(wp), intent(in) :: values(:)
    character(64), intent(inout) :: digest
    integer, parameter :: block = 4096
    character(8*block) :: bytes
    integer :: first, n

    do first = 1, size(values), block
      n = min(block, size(values) - first + 1)
      bytes = ''
      bytes(:8*n) = transfer(real(values(first:first + n - 1), real64), bytes(:8*n))
      digest = sha256(digest//bytes(:8*n))
    end do
  end subroutine add_values
end module dst_sweep_runner
