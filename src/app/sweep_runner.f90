!> Run a sweep, and present its shards as one result file: what `dynstiction run` does with a deck that has &sweep, and `merge`.
!>
!> A process has one shard. Its threads take the next case whenever they have finished one; the first thread also looks after
!> signals, limits, progress and the other processes, between two slices of its case.
module dst_sweep_runner
  use dst_build_info, only: version, git_revision
  use dst_dealer, only: dealer_t
  use dst_deck, only: deck_t, resolved
  use dst_deck_check, only: sweep_of_deck
  use dst_deck_sweep, only: varied_key
  use dst_deck_values, only: set_default
  use dst_disk, only: identity_of, identity_t, path_t, wait_seconds
  use dst_division, only: share_wish_t, settle_division
  use dst_errors, only: error_t, raise, usage_error, file_error, some_failed, out_of_memory, stopped_early
  use dst_hdf5_writer, only: run_metadata_t
  use dst_kinds, only: wp, int64, real64
  use dst_progress, only: progress_t, new_progress
  use dst_machine, only: environment
  use dst_processes, only: processes_t, patience_t
  use dst_run, only: describe_run
  use dst_scene, only: scene_t, scene_from_deck
  use dst_schema, only: schema, sweep_group
  use dst_sha256, only: sha256
  use dst_signals, only: stop_signal, is_told_to_end, stopped_by, no_signal
  use dst_stopwatch, only: wall_clock
  use dst_sweep, only: sweep_t, axis_t, new_sweep, case_t, watch_t, worker_t, new_worker, series_quantities
  use dst_sweep_file, only: block_of, merge_shards, look_at_result
  use dst_sweep_shard, only: shard_t, head_t, index_t, layout_of, shards_of, open_shard, inspect_shard, check_sweep, divisions_of, &
    missing, without_concern, scan_shard, empty_shard, delete_shard
  use dst_text, only: integer_text, word, word_count
  use dst_threads, only: task_t, run_in_threads
  implicit none
  private

  public :: sweep_options_t, run_sweep, merge_sweep

  !> Options of the command line.
  type :: sweep_options_t
    logical :: overwrite = .false., quiet = .false., keep_shards = .false.
    type(share_wish_t) :: share          !! this process has a part of the cases, and knows of no other
  end type sweep_options_t

  !> How fast the cases of this process are of late, to ask for as many as it needs.
  type :: pace_t
    real(wp) :: rate = 0.0_wp            !! cases a second
    real(wp) :: since = 0.0_wp           !! time [s] and finished cases when cases were last given
    integer :: finished = 0
  contains
    procedure :: measure
    procedure :: wanted
  end type pace_t

  !> What the threads of a process share.
  type :: state_t
    integer, allocatable :: given(:)     !! cases dealt out to this process
    integer :: next = 1                  !! the first of them that has not begun
    logical :: none_left = .false.       !! no more will be dealt out to this process
    integer :: stop = 0                  !! why cases under way are given up: a signal, or one of those below; 0 = they go on
    integer :: at_work = 0               !! threads
    integer :: finished = 0, failed = 0  !! of this process
    integer :: to_do = 0                 !! cases, of all processes
    integer :: done_before = 0, failed_before = 0
    real(wp) :: begun = 0.0_wp, limit = 0.0_wp, looked = 0.0_wp
    type(pace_t) :: pace
    type(shard_t) :: shard
    type(error_t), allocatable :: error  !! the first one of the shard
    type(processes_t) :: processes
    type(dealer_t) :: dealer
    type(progress_t) :: progress
  end type state_t

  !> Why a process stops, if not by a signal.
  integer, parameter :: at_limit = -1, by_error = -2

  type, extends(watch_t) :: sweep_watch_t
    type(state_t), pointer :: state => null()
    logical :: is_first = .false.        !! of the process's threads
  contains
    procedure :: asked_to_stop
  end type sweep_watch_t

  !> The threads' task.
  type, extends(task_t) :: cases_t
    type(sweep_t), pointer :: sweep => null()
    type(state_t), pointer :: state => null()
    type(worker_t) :: first_worker       !! is copied by each thread
  contains
    procedure :: work
  end type cases_t

  !> Threads beyond this serve no machine.
  integer, parameter :: most_threads = 1024

  !> Keys that say how a sweep is run, not what its cases are. The points themselves are, not where they stand.
  character(26), parameter :: changeable(6) = [character(26) :: 'scene.title', 'sweep.points', 'output.file', &
    'output.flush_seconds', 'output.checkpoint_interval', 'output.wall_limit']

  !> A process looks around once in so many seconds: messages, signals, limits. It asks for more cases when what it has lasts
  !> less than `ahead`, and for as many as last `piece`, or, of many processes, so long that rank 0 gets no more than one
  !> question in `message`.
  real(wp), parameter :: look = 5.0e-4_wp, ahead = 2.0e-3_wp, piece = 5.0e-3_wp, message = 5.0e-5_wp

contains

  !> Run all cases that no shard has yet, and merge the shards when all are done. All processes end with the same error, of which
  !> one has the text.
  subroutine run_sweep(deck, result_file, options, processes, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(processes_t), intent(in) :: processes
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t) :: sweep
    type(state_t), target :: state
    type(head_t) :: head
    integer, allocatable :: pending(:)
    integer :: to_do(1)

    state%processes = processes
    if (processes%is_first()) call prepare(deck, result_file, options, sweep, head, state, pending, error)
    ! Nobody opens a shard before the first has looked at all.
    call processes%agree(error)
    if (allocated(error)) return
    to_do = [state%to_do]
    call processes%sum_up(to_do)
    if (to_do(1) > 0 .or. options%share%is_given) then
      call share_sweep(processes, deck, sweep, head, error)
      call run_pending(sweep, head, result_file, options, state, pending, error)
      if (allocated(error)) return
    end if
    if (processes%is_first()) call present_result(sweep, head, result_file, options, state, error)
    call processes%agree(error)
  end subroutine run_sweep

  !> Run the cases, each process into its own shard.
  subroutine run_pending(sweep, head, result_file, options, state, pending, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(state_t), intent(inout), target :: state
    integer, allocatable, intent(inout) :: pending(:)
    type(error_t), allocatable, intent(inout) :: error

    associate (processes => state%processes)
      if (.not. allocated(error)) call open_shard(state%shard, result_file, &
        merge(head%division%share, processes%rank, options%share%is_given), head, layout_of(sweep), error)
      call processes%agree(error)
      if (.not. allocated(error)) then
        call run_cases(sweep, state, pending, options%quiet .or. .not. processes%is_first())
        if (allocated(state%error)) then
          call move_alloc(state%error, error)
        else if (state%stop /= 0) then
          call raise(error, stopped_early, stop_text(state))
        end if
      end if
      call state%shard%close()
      call processes%agree(error)
    end associate
  end subroutine run_pending

  !> What one process finds out for all: the sweep, and which of its cases are to be run.
  subroutine prepare(deck, result_file, options, sweep, head, state, pending, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(sweep_t), intent(out) :: sweep
    type(head_t), intent(out) :: head
    type(state_t), intent(inout) :: state
    integer, allocatable, intent(out) :: pending(:)
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(path_t), allocatable :: files(:)

    if (state%processes%count > 1 .and. options%share%is_given) then
      call raise(error, usage_error, '--shard is for processes that know nothing of each other, these do: leave it out')
      return
    end if
    call sweep_of_deck(deck, sweep, error)
    if (allocated(error)) return
    head = head_of(sweep, identity_of_sweep(sweep))
    call look_at_shards(sweep, head, result_file, options, options%overwrite, index, files, error)
    if (.not. allocated(error)) call choose_cases(sweep, index, options, state, pending, error)
  end subroutine prepare

  !> The first process has read the points of a sweep; the others get them from it.
  subroutine share_sweep(processes, deck, sweep, head, error)
    type(processes_t), intent(in) :: processes
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(inout) :: sweep
    type(head_t), intent(inout) :: head
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), allocatable :: axes(:)
    character(:), allocatable :: names, identity
    integer :: i

    if (processes%count == 1) return
    if (deck%text_of(sweep_group, 'points') == '') then
      if (.not. processes%is_first()) call new_sweep(deck, sweep, error)
    else
      if (processes%is_first()) then
        axes = sweep%axes
        names = sweep%parameters()
      end if
      call processes%share_text(names)
      if (.not. processes%is_first()) allocate (axes(word_count(names)))
      do i = 1, size(axes)
        axes(i)%name = word(names, i)
        call processes%share_numbers(axes(i)%values)
      end do
      if (.not. processes%is_first()) call new_sweep(deck, sweep, error, axes, .true.)
    end if
    ! The identity is that of the deck as it was read.
    identity = head%identity
    call processes%share_text(identity)
    if (.not. processes%is_first()) head = head_of(sweep, identity)
  end subroutine share_sweep

  !> Write what the shards hold so far to the result file.
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

    call sweep_of_deck(deck, sweep, error)
    if (allocated(error)) return
    head = head_of(sweep, identity_of_sweep(sweep))
    call look_at_shards(sweep, head, result_file, options, .false., index, files, error)
    if (allocated(error)) return
    call tell_of_others(sweep, index, options)
    if (index%done == 0) then
      call raise(error, file_error, result_file//': there is no finished case to merge: run the deck first')
    else
      call write_result(sweep, head, result_file, index, files, options, alone, error)
    end if
  end subroutine merge_sweep

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

  !> Which cases the shards beside `result_file` hold, and what has the result's name. Shards of another sweep or build are emptied
  !> with `empties`; else those of another sweep are refused, those of another build passed over. A process that has a part of the
  !> cases gets its division into `head`, and reads neither what the others of it have nor cases that are not its own.
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

  !> The heads of all shards; `files` and `heads` come back without those of other builds.
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

  !> Shards of another build are left alone, but not silently.
  subroutine tell_of_others(sweep, index, options)
    type(sweep_t), intent(in) :: sweep
    type(index_t), intent(in) :: index
    type(sweep_options_t), intent(in) :: options
    type(progress_t) :: progress

    if (index%of_other_builds == 0) return
    progress = new_progress(sweep%deck%name, options%quiet)
    call progress%remark(integer_text(index%of_other_builds)//' shards are of another build of the program: they are left '// &
      'alone, and their cases run again (--overwrite empties them)')
  end subroutine tell_of_others

  subroutine raise_no_memory(cases, error)
    integer, intent(in) :: cases
    type(error_t), allocatable, intent(out) :: error

    call raise(error, out_of_memory, 'no memory for the list of '//integer_text(cases)// &
      ' cases: divide the sweep into several decks')
  end subroutine raise_no_memory

  !> The cases of this process, or of all processes, that are not done.
  subroutine choose_cases(sweep, index, options, state, pending, error)
    type(sweep_t), intent(in) :: sweep
    type(index_t), intent(in) :: index
    type(sweep_options_t), intent(in) :: options
    type(state_t), intent(inout) :: state
    integer, allocatable, intent(out) :: pending(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i, n, pass, status

    do pass = 1, 2
      n = 0
      do i = 1, sweep%cases
        if (index%state(i) /= missing) cycle
        n = n + 1
        if (pass == 2) pending(n) = i
      end do
      if (pass == 2) cycle
      allocate (pending(n), stat=status)
      if (status == 0) cycle
      call raise_no_memory(n, error)
      return
    end do
    call tell_of_others(sweep, index, options)
    state%to_do = n
    state%done_before = index%done
    state%failed_before = index%failed
  end subroutine choose_cases

  !> All threads of the process.
  subroutine run_cases(sweep, state, pending, quiet)
    type(sweep_t), intent(in), target :: sweep
    type(state_t), intent(inout), target :: state
    integer, allocatable, intent(inout) :: pending(:)
    logical, intent(in) :: quiet
    type(cases_t), target :: cases
    integer :: threads

    state%limit = sweep%deck%real_of('output', 'wall_limit')
    state%begun = wall_clock()
    state%progress = new_progress(sweep%deck%name, quiet)
    allocate (state%given(0))
    call state%dealer%open(state%processes, pending)
    threads = thread_count(state%processes, sweep%cases)
    ! At first a case for each thread.
    state%pace%rate = threads/piece
    cases%sweep => sweep
    cases%state => state
    call new_worker(sweep, cases%first_worker)
    call run_in_threads(cases, threads)
    call state%dealer%close(state%processes, state%finished, state%failed, state%stop)
    deallocate (state%given)
    call state%progress%close()
  end subroutine run_cases

  !> As many threads as OpenMP counts processors or is told to take; of processors that several processes may use, a share.
  integer function thread_count(processes, cases) result(threads)
    !$ use omp_lib, only: omp_get_max_threads
    type(processes_t), intent(in) :: processes
    integer, intent(in) :: cases

    threads = 1
    !$ threads = omp_get_max_threads()
    if (environment('OMP_NUM_THREADS') == '' .and. processes%cores > 0) threads = min(threads, processes%cores)
    threads = min(threads, most_threads, cases)
  end function thread_count

  !> One thread: case after case.
  subroutine work(self, number)
    class(cases_t), intent(inout) :: self
    integer, intent(in) :: number
    type(sweep_watch_t) :: watch
    type(worker_t), allocatable :: worker
    type(case_t) :: case
    integer :: next
    logical :: done, none_left

    associate (sweep => self%sweep, state => self%state)
      !$omp atomic
      state%at_work = state%at_work + 1
      watch%state => self%state
      watch%is_first = number == 1
      allocate (worker, source=self%first_worker)
      do
        if (watch%asked_to_stop()) exit
        none_left = .false.
        do while (worker%has_room())
          call take_number(state, next, none_left)
          if (next == 0) exit
          call worker%begin_case(sweep, next)
        end do
        if (worker%is_idle()) then
          if (none_left) exit
          call wait_seconds(2.0e-4_wp)
          cycle
        end if
        call worker%next_result(watch, case, done)
        if (.not. done) exit
        call keep(state, case)
      end do
      if (watch%is_first) call wait_for_others(state)
      !$omp atomic
      state%at_work = state%at_work - 1
    end associate
  end subroutine work

  !> The first thread, without work itself, still looks around for the others, and rank 0 for other processes.
  subroutine wait_for_others(state)
    type(state_t), intent(inout) :: state
    type(patience_t) :: patience
    integer :: at_work

    do
      call look_around(state)
      !$omp atomic read
      at_work = state%at_work
      if (at_work <= 1 .and. state%dealer%others_are_done(state%processes)) exit
      call patience%check(state%processes)
      call wait_seconds(look)
    end do
  end subroutine wait_for_others

  !> The next case of this process; 0 if there is none now.
  subroutine take_number(state, number, none_left)
    type(state_t), intent(inout) :: state
    integer, intent(out) :: number
    logical, intent(out) :: none_left

    number = 0
    !$omp critical (dealing)
    if (state%next <= size(state%given)) then
      number = state%given(state%next)
      state%next = state%next + 1
    end if
    none_left = number == 0 .and. state%none_left
    !$omp end critical (dealing)
  end subroutine take_number

  subroutine keep(state, case)
    type(state_t), intent(inout) :: state
    type(case_t), intent(in) :: case
    type(error_t), allocatable :: error

    !$omp critical (keeping)
    if (.not. allocated(state%error)) then
      call state%shard%append(case, error)
      if (allocated(error)) then
        call move_alloc(error, state%error)
        !$omp atomic write
        state%stop = by_error
      else
        state%finished = state%finished + 1
        if (case%result_code /= 0) state%failed = state%failed + 1
      end if
    end if
    !$omp end critical (keeping)
  end subroutine keep

  !> The first thread looks around.
  logical function asked_to_stop(self)
    class(sweep_watch_t), intent(inout) :: self
    integer :: stop

    if (self%is_first) call look_around(self%state)
    !$omp atomic read
    stop = self%state%stop
    asked_to_stop = stop /= 0
  end function asked_to_stop

  !> New work, signals, the limit, progress.
  subroutine look_around(state)
    type(state_t), intent(inout) :: state
    integer, allocatable :: numbers(:)
    integer :: finished, failed, left, wanted, stop
    logical :: none_left
    real(wp) :: passed

    passed = wall_clock() - state%begun
    !$omp critical (dealing)
    left = size(state%given) - state%next + 1
    none_left = state%none_left
    !$omp end critical (dealing)
    if (left > 0 .and. passed - state%looked < look) return
    state%looked = passed
    !$omp critical (keeping)
    finished = state%finished
    failed = state%failed
    !$omp end critical (keeping)
    !$omp atomic read
    stop = state%stop
    if (stop == 0) stop = stop_signal()
    if (stop == 0 .and. state%limit > 0.0_wp .and. passed > state%limit) stop = at_limit
    wanted = 0
    if (.not. none_left .and. stop == 0) wanted = state%pace%wanted(left, finished, state%processes%count)
    call state%dealer%deal(state%processes, wanted, finished, failed, numbers, none_left, stop)
    if (stop /= 0) then
      !$omp atomic write
      state%stop = stop
    end if
    if (allocated(numbers)) then
      call state%pace%measure(passed, finished)
      !$omp critical (dealing)
      if (state%next <= size(state%given)) numbers = [state%given(state%next:), numbers]
      call move_alloc(numbers, state%given)
      state%next = 1
      state%none_left = none_left
      !$omp end critical (dealing)
    end if
    call state%progress%show_cases(state%done_before, state%dealer%finished, state%to_do, &
      state%failed_before + state%dealer%failed, passed)
  end subroutine look_around

  !> Cases to ask for while `left` have not begun. The pace may have changed: nothing is asked ahead before one of the
  !> cases given last is finished.
  pure integer function wanted(self, left, finished, ranks)
    class(pace_t), intent(in) :: self
    integer, intent(in) :: left, finished, ranks
    real(wp), parameter :: most = 1.0e6_wp

    wanted = 0
    if (left > 0 .and. finished == self%finished) return
    if (left <= self%rate*ahead) wanted = max(1, nint(min(most, self%rate*max(piece, ranks*message))))
  end function wanted

  !> Cases have been given at `time` [s], when `finished` were finished.
  subroutine measure(self, time, finished)
    class(pace_t), intent(inout) :: self
    real(wp), intent(in) :: time
    integer, intent(in) :: finished

    if (finished == self%finished .or. time <= self%since) return
    self%rate = (finished - self%finished)/(time - self%since)
    self%since = time
    self%finished = finished
  end subroutine measure

  !> The result file; or, of a part of the cases, how to get it.
  subroutine present_result(sweep, head, result_file, options, state, error)
    type(sweep_t), intent(in) :: sweep
    type(head_t), intent(in) :: head
    character(*), intent(in) :: result_file
    type(sweep_options_t), intent(in) :: options
    type(state_t), intent(in) :: state
    type(error_t), allocatable, intent(out) :: error
    type(head_t) :: again
    type(index_t) :: index
    type(path_t), allocatable :: files(:)
    integer :: failed

    if (options%share%is_given) then
      failed = state%failed_before + state%failed
      if (failed > 0) call raise(error, some_failed, integer_text(failed)//' of '// &
        integer_text(head%division%size(sweep%cases))//' cases of shard '//head%division%text()//' failed')
    else
      again = head
      call look_at_shards(sweep, again, result_file, options, .false., index, files, error)
      if (.not. allocated(error)) call write_result(sweep, head, result_file, index, files, options, state%processes, error)
    end if
  end subroutine present_result

  !> Merge the shards, unless that has been done, and remove them if they hold all cases.
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
      call describe_run(sweep%deck, scene%model, scene%method_name(), '', metadata)
      metadata%processes = processes%count
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
        integer_text(sweep%cases)//' cases have not been run: run the deck again to go on')
    else if (index%failed > 0) then
      call raise(error, some_failed, integer_text(index%failed)//' of '//integer_text(sweep%cases)// &
        ' cases failed: see result_code and failures in '//result_file)
    end if
  end subroutine write_result

  function stop_text(state) result(text)
    type(state_t), intent(in) :: state
    character(:), allocatable :: text

    text = 'stopped at output.wall_limit'
    if (state%stop > no_signal) text = stopped_by(state%stop)
    text = text//' after '//integer_text(state%done_before + state%dealer%finished)//' of '// &
      integer_text(state%done_before + state%to_do)//' cases: start it again to go on'
  end function stop_text
end module dst_sweep_runner
