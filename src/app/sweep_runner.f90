!> Run a sweep, and present its shards as one result file: what `dynstiction run` does with a deck that has &sweep, and `merge`.
!>
!> The first process finds out what is to be done, from the deck and the shards that there are; all processes do it
!> (dst_sweep_work), each into a shard of its own; the first one presents the result.
module dst_sweep_runner
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
  use dst_sweep, only: sweep_t, axis_t, new_sweep, series_quantities
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
    type(share_wish_t) :: share          !! this process has a part of the cases, and knows of no other
  end type sweep_options_t

  !> A sweep, the shards beside its result file, and which cases they hold.
  type :: sweep_job_t
    type(sweep_t) :: sweep
    character(:), allocatable :: result_file
    type(sweep_options_t) :: options
    type(head_t) :: head                 !! of which sweep, build and division a new shard is
    type(path_t), allocatable :: files(:)   !! shards of this sweep and build
    type(index_t) :: index
  end type sweep_job_t

  !> Keys that say how a sweep is run, not what its cases are. The points themselves are, not where they stand.
  character(26), parameter :: changeable(6) = [character(26) :: 'scene.title', 'sweep.points', 'output.file', &
    'output.flush_seconds', 'output.checkpoint_interval', 'output.wall_limit']

contains

  !> Run all cases that no shard has yet, and merge the shards when all are done. All processes end with the same error, of which
  !> one has the text.
  subroutine run_sweep(deck, result_file, options, processes, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(sweep_job_t), target :: job
    type(sweep_work_t), target :: work
    integer, allocatable :: pending(:)
    logical :: is_needed

    if (processes%count > 1 .and. options%share%is_given) then
      call raise(error, usage_error, '--shard is for processes that know nothing of each other, these do: leave it out')
    else if (processes%rank == 0) then
      call open_job(deck, result_file, options, options%overwrite, job, error)
      if (.not. allocated(error)) call list_pending(job, work, pending, error)
    end if
    ! Nobody opens a shard before the first has looked at all.
    call processes%agree(error)
    if (allocated(error)) return
    is_needed = work%to_do > 0 .or. options%share%is_given
    call share_sweep(processes, deck, job, is_needed, error)
    if (is_needed) then
      if (.not. allocated(error)) call open_shard(work%shard, result_file, &
        merge(job%head%division%share, processes%rank, options%share%is_given), job%head, layout_of(job%sweep), error)
      call processes%agree(error)
      if (.not. allocated(error)) &
        call work%run(job%sweep, processes, pending, options%quiet .or. processes%rank > 0, error)
      call work%shard%close()
      call processes%agree(error)
      if (allocated(error)) return
    end if
    if (options%share%is_given) then
      call report_share(job, work%failed_before + work%failed, error)
    else if (processes%rank == 0) then
      call look_at_shards(job, .false., error)
      if (.not. allocated(error)) call present_result(job, processes, error)
    end if
    call processes%agree(error)
  end subroutine run_sweep

  !> Write what the shards hold so far to the result file.
  subroutine merge_sweep(deck, result_file, options, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(error_t), allocatable, intent(out) :: error
    type(sweep_job_t) :: job

    call open_job(deck, result_file, options, .false., job, error)
    if (allocated(error)) return
    call tell_of_others(job)
    if (job%index%done == 0) then
      call raise(error, file_error, result_file//': there is no finished case to merge: run the deck first')
    else
      call present_result(job, processes_t(), error)
    end if
  end subroutine merge_sweep

  !> The sweep of a deck, and what there is of it. `empties`: see `look_at_shards`.
  subroutine open_job(deck, result_file, options, empties, job, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    logical, intent(in) :: empties
    type(sweep_job_t), intent(inout) :: job
    type(error_t), allocatable, intent(out) :: error

    job%result_file = result_file
    job%options = options
    call sweep_of_deck(deck, job%sweep, error)
    if (allocated(error)) return
    job%head = head_of(job%sweep, identity_of_sweep(job%sweep))
    call look_at_shards(job, empties, error)
  end subroutine open_job

  !> The cases that are to be run: of all processes, or of this share.
  subroutine list_pending(job, work, pending, error)
    type(sweep_job_t), intent(in) :: job
    type(sweep_work_t), intent(inout) :: work
    integer, allocatable, intent(out) :: pending(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i, n, status

    call tell_of_others(job)
    work%to_do = count(job%index%state == missing)
    work%done_before = job%index%done
    work%failed_before = job%index%failed
    allocate (pending(work%to_do), stat=status)
    if (status /= 0) then
      call raise_no_memory(work%to_do, error)
      return
    end if
    n = 0
    do i = 1, size(job%index%state)
      if (job%index%state(i) /= missing) cycle
      n = n + 1
      pending(n) = i
    end do
  end subroutine list_pending

  !> The first process has read the points of a sweep; the others get them from it if there is work for them.
  subroutine share_sweep(processes, deck, job, is_needed, error)
    type(processes_t), intent(in) :: processes
    type(deck_t), intent(in) :: deck
    type(sweep_job_t), intent(inout) :: job
    logical, intent(inout) :: is_needed   !! as the first says
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), allocatable :: axes(:)
    character(:), allocatable :: names, identity
    integer :: i

    if (processes%count == 1) return
    ! The identity is that of the deck as it was read.
    identity = ''
    if (is_needed) identity = job%head%identity
    call processes%share_text(identity)
    is_needed = identity /= ''
    if (.not. is_needed) return
    if (deck%text_of(sweep_group, 'points') /= '') then
      if (processes%rank == 0) then
        axes = job%sweep%axes
        names = job%sweep%parameters()
      end if
      call processes%share_text(names)
      if (processes%rank > 0) allocate (axes(word_count(names)))
      do i = 1, size(axes)
        axes(i)%name = word(names, i)
        call processes%share_numbers(axes(i)%values)
      end do
    end if
    if (processes%rank == 0) return
    call new_sweep(deck, job%sweep, error, axes, .true.)
    job%head = head_of(job%sweep, identity)
  end subroutine share_sweep

  !> Of which sweep and build a shard must be.
  function head_of(sweep, identity) result(head)
    type(sweep_t), intent(in) :: sweep
    character(*), intent(in) :: identity   !! its first characters are kept
    type(head_t) :: head
    character(64) :: digest

    head%identity = identity
    digest = sha256(version//git_revision)
    head%build = digest(:len(head%build))
    head%columns = size(series_quantities(sweep))
    head%cases = sweep%cases
  end function head_of

  !> Every key that has an effect on a result, the names and values of a list.
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

  !> Block by block, so that the text of many values is not long.
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

  !> Which cases the shards beside the result file hold, and what has the result's name. Shards of another sweep or build are
  !> emptied with `empties`; else those of another sweep are refused, those of another build passed over. A process that has a part
  !> of the cases gets its division into the head, and reads neither what the others of it have nor cases that are not its own.
  subroutine look_at_shards(job, empties, error)
    type(sweep_job_t), intent(inout) :: job
    logical, intent(in) :: empties
    type(error_t), allocatable, intent(out) :: error
    type(head_t), allocatable :: heads(:)
    type(path_t), allocatable :: files(:)
    integer :: i, status, ignored

    job%index = index_t()
    call job%index%allocate(job%sweep%cases, block_of(job%sweep), status)
    if (status /= 0) then
      call raise_no_memory(job%sweep%cases, error)
      return
    end if
    call shards_of(job%result_file, files)
    call move_alloc(files, job%files)
    call read_heads(job, empties, heads, error)
    associate (share => job%options%share)
      if (.not. allocated(error)) call settle_division(share, divisions_of(heads, job%files), job%head%division, error)
      if (.not. (allocated(error) .or. job%options%overwrite)) &
        call look_at_result(job%result_file, job%head, share%is_given, job%files, job%index, error)
    end associate
    if (allocated(error) .or. job%index%is_in_result) return
    do i = 1, job%sweep%cases
      if (.not. job%head%division%has(i)) job%index%state(i) = without_concern
    end do
    do i = 1, size(job%files)
      associate (theirs => heads(i)%division, ours => job%head%division)
        if (ours%shares > 0 .and. theirs%shares == ours%shares .and. theirs%share /= ours%share) cycle
      end associate
      if (is_told_to_end()) call raise(error, stopped_early, stopped_by()//': start it again')
      if (allocated(error)) return
      call scan_shard(job%files(i)%text, layout_of(job%sweep), i, job%index, ignored, error)
      if (allocated(error)) return
    end do
  end subroutine look_at_shards

  !> The heads of all shards; those of other builds are left out.
  subroutine read_heads(job, empties, heads, error)
    type(sweep_job_t), intent(inout) :: job
    logical, intent(in) :: empties
    type(head_t), allocatable, intent(out) :: heads(:)
    type(error_t), allocatable, intent(out) :: error
    logical :: is_ours(size(job%files))
    type(path_t), allocatable :: files(:)
    type(identity_t) :: file
    integer :: i

    allocate (heads(size(job%files)))
    do i = 1, size(heads)
      call inspect_shard(job%files(i)%text, heads(i), error)
      if (.not. allocated(error)) call check_sweep(job%files(i)%text, heads(i), job%head, error)
      is_ours(i) = heads(i)%is_of_build(job%head)
      if (empties .and. (allocated(error) .or. .not. is_ours(i))) then
        call empty_shard(job%files(i)%text, job%head, error)
        heads(i) = head_t(is_whole=.false.)
        is_ours(i) = .true.
      end if
      if (allocated(error)) return
      if (.not. (heads(i)%is_whole .and. is_ours(i))) cycle
      file = identity_of(job%files(i)%text)
      associate (begun => job%index%begun)
        begun = min(heads(i)%begun, merge(begun, heads(i)%begun, begun > 0))
      end associate
      job%index%ended = max(job%index%ended, file%changed)
    end do
    job%index%of_other_builds = count(.not. is_ours)
    allocate (files, source=pack(job%files, is_ours))
    call move_alloc(files, job%files)
    heads = pack(heads, is_ours)
  end subroutine read_heads

  !> Shards of another build are left alone, but not silently.
  subroutine tell_of_others(job)
    type(sweep_job_t), intent(in) :: job
    type(progress_t) :: progress

    if (job%index%of_other_builds == 0) return
    progress = new_progress(job%sweep%deck%name, job%options%quiet)
    call progress%remark(integer_text(job%index%of_other_builds)//' shards are of another build of the program: they are left '// &
      'alone, and their cases run again (--overwrite empties them)')
  end subroutine tell_of_others

  subroutine raise_no_memory(cases, error)
    integer, intent(in) :: cases
    type(error_t), allocatable, intent(out) :: error

    call raise(error, out_of_memory, 'no memory for the list of '//integer_text(cases)// &
      ' cases: divide the sweep into several decks')
  end subroutine raise_no_memory

  !> Of a part of the cases there is no result file yet.
  subroutine report_share(job, failed, error)
    type(sweep_job_t), intent(in) :: job
    integer, intent(in) :: failed
    type(error_t), allocatable, intent(out) :: error

    associate (division => job%head%division)
      if (failed > 0) call raise(error, some_failed, integer_text(failed)//' of '// &
        integer_text(division%size(job%sweep%cases))//' cases of shard '//division%text()//' failed')
    end associate
  end subroutine report_share

  !> Merge the shards, unless that has been done, and remove them if they hold all cases.
  subroutine present_result(job, processes, error)
    type(sweep_job_t), intent(in) :: job
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(run_metadata_t) :: metadata
    type(scene_t) :: scene
    integer :: i

    associate (sweep => job%sweep, index => job%index)
      if (.not. index%is_in_result) then
        call scene_from_deck(sweep%deck, scene)
        call describe_run(sweep%deck, scene, '', metadata)
        metadata%processes = processes%count
        metadata%threads = thread_count(processes, sweep%cases)
        call merge_shards(sweep, job%head, job%files, index, metadata, job%result_file, job%options%overwrite, error)
        if (allocated(error)) return
      end if
      if (index%done == sweep%cases .and. .not. job%options%keep_shards) then
        do i = 1, size(job%files)
          call delete_shard(job%files(i)%text, job%head, error)
          if (allocated(error)) return
        end do
      end if
      if (index%done < sweep%cases) then
        call raise(error, stopped_early, integer_text(sweep%cases - index%done)//' of '// &
          integer_text(sweep%cases)//' cases have not been run: run the deck again to go on')
      else if (index%failed > 0) then
        call raise(error, some_failed, integer_text(index%failed)//' of '//integer_text(sweep%cases)// &
          ' cases failed: see result_code and failures in '//job%result_file)
      end if
    end associate
  end subroutine present_result
end module dst_sweep_runner
