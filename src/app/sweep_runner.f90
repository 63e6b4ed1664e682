!> Run a sweep, and merge its shards into one result file: what `dynstiction run` does with a deck that has &sweep, and `merge`.
!>
!> The first process finds out which cases are to be run, from the deck and the existing shards; all processes run them
!> (dst_sweep_work), each into its own shard; the first one writes the result.
module dst_sweep_runner
  use dst_arithmetic, only: arithmetic_fingerprint
  use dst_build_info, only: version, git_revision
  use dst_deck, only: deck_t, resolved
  use dst_deck_check, only: sweep_of_deck
  use dst_deck_sweep, only: varied_key
  use dst_deck_values, only: set_default
  use dst_disk, only: identity_of, identity_t, path_t
  use dst_division, only: share_wish_t, settle_division
  use dst_errors, only: error_t, raise, usage_error, file_error, some_failed, out_of_memory, stopped_early
  use dst_hdf5_writer, only: run_metadata_t
  use dst_kinds, only: wp, real64
  use dst_processes, only: processes_t
  use dst_progress, only: progress_t, new_progress
  use dst_run, only: describe_run
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema, sweep_group
  use dst_sha256, only: sha256
  use dst_signals, only: is_told_to_end, stopped_by
  use dst_sweep, only: sweep_t, axis_t, new_sweep, table_quantities
  use dst_sweep_file, only: block_of, merge_shards, look_at_result
  use dst_sweep_shard, only: head_t, index_t, layout_of, shards_of, open_shard, inspect_shard, check_sweep, divisions_of, &
    missing, without_concern, scan_shard, empty_shard, delete_shard
  use dst_sweep_work, only: sweep_work_t, thread_count
  use dst_text, only: integer_text, word, word_count
  implicit none
  private

  public :: sweep_options_t, run_sweep, merge_sweep

  !> Options of the command line.
  type :: sweep_options_t
    logical :: overwrite = .false., quiet = .false., keep_shards = .false.
    type(share_wish_t) :: share          !! this process has a part of the cases, and does not communicate with others
  end type sweep_options_t

  !> Keys that say how a sweep is run, not what its cases are. The points themselves belong to the cases, the name of their file
  !> does not.
  character(26), parameter :: changeable(5) = [character(26) :: 'scene.title', 'sweep.points', 'output.file', &
    'output.checkpoint_interval', 'output.wall_limit']

contains

  !> Run all cases that no shard contains yet, and merge the shards when all are finished. All processes end with the same error,
  !> and one of them has its text.
  subroutine run_sweep(deck, result_file, options, processes, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t) :: sweep
    type(sweep_work_t), target :: work
    type(head_t) :: head
    integer, allocatable :: pending(:)
    logical :: is_needed

    if (processes%count > 1 .and. options%share%is_given) then
      call raise(error, usage_error, '--shard is for processes that do not communicate, and these do: leave it out')
    else if (processes%rank == 0) then
      call prepare(deck, result_file, options, sweep, head, work, pending, error)
    end if
    ! No process opens a shard before the first one has read all shards.
    call processes%agree(error)
    if (allocated(error)) return
    is_needed = work%to_do > 0 .or. options%share%is_given
    call share_sweep(processes, deck, sweep, head, is_needed, error)
    if (is_needed) then
      if (.not. allocated(error)) call open_shard(work%shard, result_file, &
        merge(head%division%share, processes%rank, options%share%is_given), head, layout_of(sweep), error)
      call processes%agree(error)
      if (.not. allocated(error)) call work%run(sweep, processes, pending, options%quiet .or. processes%rank > 0, error)
      call work%shard%close()
      call processes%agree(error)
      if (allocated(error)) return
    end if
    if (processes%rank == 0) call present_result(sweep, head, result_file, options, work, processes, error)
    call processes%agree(error)
  end subroutine run_sweep

  !> What one process finds out for all: the sweep, and which of its cases are to be run.
  subroutine prepare(deck, result_file, options, sweep, head, work, pending, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(sweep_t), intent(out) :: sweep
    type(head_t), intent(out) :: head
    type(sweep_work_t), intent(inout) :: work
    integer, allocatable, intent(out) :: pending(:)
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(path_t), allocatable :: files(:)
    integer :: i, n, status

    call begin_sweep(deck, sweep, head, error)
    if (.not. allocated(error)) call look_at_shards(sweep, head, result_file, options, options%overwrite, index, files, error)
    if (allocated(error)) return
    call tell_of_others(sweep, index, options)
    work%to_do = count(index%state == missing)
    work%done_before = index%done
    work%failed_before = index%failed
    allocate (pending(work%to_do), stat=status)
    if (status /= 0) then
      call raise_no_memory(work%to_do, error)
      return
    end if
    n = 0
    do i = 1, sweep%cases
      if (index%state(i) /= missing) cycle
      n = n + 1
      pending(n) = i
    end do
  end subroutine prepare

  !> The sweep of a deck, and the contents of the heads of its shards.
  subroutine begin_sweep(deck, sweep, head, error)
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(out) :: sweep
    type(head_t), intent(out) :: head
    type(error_t), allocatable, intent(out) :: error

    call sweep_of_deck(deck, sweep, error)
    if (.not. allocated(error)) head = head_of(sweep, identity_of_sweep(sweep))
  end subroutine begin_sweep

  !> The first process has read the points of a sweep; it sends them to the others if the sweep is needed.
  subroutine share_sweep(processes, deck, sweep, head, is_needed, error)
    type(processes_t), intent(in) :: processes
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(inout) :: sweep
    type(head_t), intent(inout) :: head
    logical, intent(inout) :: is_needed   !! the value of the first process
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), allocatable :: axes(:)
    character(:), allocatable :: names, identity
    integer :: i

    if (processes%count == 1) return
    ! The identity is that of the deck as it was read.
    identity = ''
    if (is_needed) identity = head%identity
    call processes%share_text(identity)
    is_needed = identity /= ''
    if (.not. is_needed) return
    if (deck%text_of(sweep_group, 'points') /= '') then
      if (processes%rank == 0) then
        axes = sweep%axes
        names = sweep%parameters()
      end if
      call processes%share_text(names)
      if (processes%rank > 0) allocate (axes(word_count(names)))
      do i = 1, size(axes)
        axes(i)%name = word(names, i)
        call processes%share_numbers(axes(i)%values)
      end do
    end if
    if (processes%rank == 0) return
    call new_sweep(deck, sweep, error, axes, .true.)
    head = head_of(sweep, identity)
  end subroutine share_sweep

  !> Write the finished cases of the shards to the result file.
  subroutine merge_sweep(deck, result_file, options, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(error_t), allocatable, intent(out) :: error
    type(processes_t) :: alone
    type(sweep_t) :: sweep
    type(head_t) :: head
    type(index_t) :: index
    type(path_t), allocatable :: files(:)

    call begin_sweep(deck, sweep, head, error)
    if (.not. allocated(error)) call look_at_shards(sweep, head, result_file, options, .false., index, files, error)
    if (allocated(error)) return
    call tell_of_others(sweep, index, options)
    if (index%done == 0) then
      call raise(error, file_error, result_file//': there is no finished case to merge: run the deck first')
    else
      call write_result(sweep, head, result_file, index, files, options, alone, error)
    end if
  end subroutine merge_sweep

  !> The sweep and the build, on its kind of machine, to which a shard must belong.
  function head_of(sweep, identity) result(head)
    type(sweep_t), intent(in) :: sweep
    character(*), intent(in) :: identity   !! its first characters are kept
    type(head_t) :: head
    character(64) :: digest

    head%identity = identity
    digest = sha256(version//git_revision//arithmetic_fingerprint())
    head%build = digest(:len(head%build))
    head%columns = size(table_quantities(sweep))
    head%cases = sweep%cases
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

  !> Which cases the shards next to `result_file` contain, and which file has the result's name. Shards of another sweep or build
  !> are emptied with `empties`; otherwise those of another sweep are refused, and those of another build are skipped. A process
  !> that has a part of the cases gets its division into `head`, and reads neither the shards of other parts nor cases that are not
  !> its own.
  subroutine look_at_shards(sweep, head, result_file, options, empties, index, files, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(inout) :: head
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    logical, intent(in) :: empties
    type(index_t), intent(out) :: index
    type(path_t), allocatable, intent(out) :: files(:)   !! shards of this sweep and build
    type(error_t), allocatable, intent(out) :: error
    type(head_t), allocatable :: heads(:)
    integer :: i, status, ignored

    call index%allocate(sweep%cases, block_of(sweep), status)
    if (status /= 0) then
      call raise_no_memory(sweep%cases, error)
      return
    end if
    call shards_of(result_file, files)
    call read_heads(head, empties, files, heads, index, error)
    if (.not. allocated(error)) call settle_division(options%share, divisions_of(heads, files), head%division, error)
    if (.not. (allocated(error) .or. options%overwrite)) &
      call look_at_result(result_file, head, options%share%is_given, files, index, error)
    if (allocated(error) .or. index%is_in_result) return
    do i = 1, sweep%cases
      if (.not. head%division%has(i)) index%state(i) = without_concern
    end do
    do i = 1, size(files)
      associate (theirs => heads(i)%division, ours => head%division)
        if (ours%shares > 0 .and. theirs%shares == ours%shares .and. theirs%share /= ours%share) cycle
      end associate
      if (is_told_to_end()) call raise(error, stopped_early, stopped_by()//': start it again')
      if (allocated(error)) return
      call scan_shard(files(i)%text, layout_of(sweep), i, index, ignored, error)
      if (allocated(error)) return
    end do
  end subroutine look_at_shards

  !> The heads of all shards; `files` and `heads` are returned without those of other builds.
  subroutine read_heads(head, empties, files, heads, index, error)
    type(head_t), intent(in) :: head
    logical, intent(in) :: empties
    type(path_t), allocatable, intent(inout) :: files(:)
    type(head_t), allocatable, intent(out) :: heads(:)
    type(index_t), intent(inout) :: index
    type(error_t), allocatable, intent(out) :: error
    logical :: is_ours(size(files))
    type(identity_t) :: file
    integer :: i

    allocate (heads(size(files)))
    do i = 1, size(files)
      call inspect_shard(files(i)%text, heads(i), error)
      if (.not. allocated(error)) call check_sweep(files(i)%text, heads(i), head, error)
      is_ours(i) = heads(i)%is_of_build(head)
      if (empties .and. (allocated(error) .or. .not. is_ours(i))) then
        call empty_shard(files(i)%text, head, error)
        heads(i) = head_t(is_whole=.false.)
        is_ours(i) = .true.
      end if
      if (allocated(error)) return
      if (.not. (heads(i)%is_whole .and. is_ours(i))) cycle
      file = identity_of(files(i)%text)
      index%begun = min(heads(i)%begun, merge(index%begun, heads(i)%begun, index%begun > 0))
      index%ended = max(index%ended, file%changed)
    end do
    index%of_other_builds = count(.not. is_ours)
    files = pack(files, is_ours)
    heads = pack(heads, is_ours)
  end subroutine read_heads

  !> Shards of another build or kind of machine are skipped, with a remark.
  subroutine tell_of_others(sweep, index, options)
    type(sweep_t), intent(in) :: sweep
    type(index_t), intent(in) :: index
    type(sweep_options_t), intent(in) :: options
    type(progress_t) :: progress

    if (index%of_other_builds == 0) return
    progress = new_progress(sweep%deck%name, options%quiet)
    call progress%remark(integer_text(index%of_other_builds)//' shards are of another build of the program, '// &
      'or of a machine that rounds differently: they are left alone, and their cases run again (--overwrite empties them)')
  end subroutine tell_of_others

  subroutine raise_no_memory(cases, error)
    integer, intent(in) :: cases
    type(error_t), allocatable, intent(out) :: error

    call raise(error, out_of_memory, 'no memory for the list of '//integer_text(cases)// &
      ' cases: divide the sweep into several decks')
  end subroutine raise_no_memory

  !> The result file; or, for a part of the cases, how to make it.
  subroutine present_result(sweep, head, result_file, options, work, processes, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(sweep_work_t), intent(in) :: work
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(head_t) :: again
    type(index_t) :: index
    type(path_t), allocatable :: files(:)
    integer :: failed

    if (options%share%is_given) then
      failed = work%failed_before + work%failed
      if (failed > 0) call raise(error, some_failed, integer_text(failed)//' of '// &
        integer_text(head%division%size(sweep%cases))//' cases of shard '//head%division%text()//' failed')
    else
      again = head
      call look_at_shards(sweep, again, result_file, options, .false., index, files, error)
      if (.not. allocated(error)) call write_result(sweep, head, result_file, index, files, options, processes, error)
    end if
  end subroutine present_result

  !> Merge the shards, unless that has been done, and remove them if they contain all cases.
  subroutine write_result(sweep, head, result_file, index, files, options, processes, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    character(*), intent(in) :: result_file
    type(index_t), intent(in) :: index
    type(path_t), intent(in) :: files(:)
    type(sweep_options_t), intent(in) :: options
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(run_metadata_t) :: metadata
    type(scene_t) :: scene
    integer :: i

    if (.not. index%is_in_result) then
      call scene_from_deck(sweep%deck, scene)
      if (sweep%keeps_series) scene%interval = sweep%interval
      call describe_run(sweep%deck, scene, '', metadata)
      metadata%threads = thread_count(processes, sweep%cases)
      call merge_shards(sweep, head, files, index, metadata, result_file, options%overwrite, error)
      if (allocated(error)) return
    end if
    if (index%done == sweep%cases .and. .not. options%keep_shards) then
      do i = 1, size(files)
        call delete_shard(files(i)%text, head, error)
        if (allocated(error)) return
      end do
    end if
    if (index%done < sweep%cases) then
      call raise(error, stopped_early, integer_text(sweep%cases - index%done)//' of '// &
        integer_text(sweep%cases)//' cases have not been run: run the deck again to run them')
    else if (index%failed > 0) then
      call raise(error, some_failed, integer_text(index%failed)//' of '//integer_text(sweep%cases)// &
        ' cases failed: see result_code and failures in '//result_file)
    end if
  end subroutine write_result
end module dst_sweep_runner
