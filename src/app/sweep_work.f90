!> One process that computes cases of a sweep and writes them to its shard.
!>
!> Its threads take the next case whenever they have finished one. The first thread also handles signals, limits, progress and the
!> other processes, between two slices of its case.
module dst_sweep_work
  use dst_dealer, only: dealer_t
  use dst_disk, only: wait_seconds
  use dst_errors, only: error_t, raise, stopped_early
  use dst_kinds, only: wp
  use dst_machine, only: environment
  use dst_processes, only: processes_t
  use dst_progress, only: progress_t, new_progress
  use dst_signals, only: stop_signal, stopped_by, no_signal
  use dst_stopwatch, only: wall_clock
  use dst_sweep, only: sweep_t, case_t, watch_t, worker_t, new_worker
  use dst_sweep_shard, only: shard_t
  use dst_text, only: integer_text
  use dst_threads, only: task_t, run_in_threads
  implicit none
  private

  public :: sweep_work_t, thread_count

  !> Data that the threads of a process share.
  type, extends(task_t) :: sweep_work_t
    integer :: to_do = 0                         !! cases, of all processes
    integer :: done_before = 0, failed_before = 0
    type(shard_t) :: shard
    integer :: failed = 0                        !! cases of this process
    integer, private :: finished = 0             !! cases of this process, including those that failed
    type(error_t), allocatable, private :: error !! the first one of the shard
    integer, private :: stop = 0                 !! why cases are given up: a signal, or one of those below; 0 = they continue
    integer, private :: at_work = 0              !! number of threads with a case
    real(wp), private :: begun = 0.0_wp, looked = 0.0_wp, limit = 0.0_wp   !! s
    type(sweep_t), pointer, private :: sweep => null()
    type(worker_t), private :: first_worker      !! each thread gets a copy
    type(processes_t), private :: processes
    type(dealer_t), private :: dealer
    type(progress_t), private :: progress
  contains
    procedure :: run
    procedure :: work => run_cases
  end type sweep_work_t

  !> Why a process stops, if not by a signal.
  integer, parameter :: at_limit = -1, by_error = -2

  type, extends(watch_t) :: sweep_watch_t
    type(sweep_work_t), pointer :: shared => null()
    logical :: is_first = .false.                !! first of the process's threads
  contains
    procedure :: asked_to_stop
  end type sweep_watch_t

  !> More threads than this are useful on no machine.
  integer, parameter :: most_threads = 1024

  !> A process handles messages, signals and limits once in this many seconds.
  real(wp), parameter :: look = 5.0e-4_wp
  !> A thread without a case looks for one after this many seconds. Convention: short compared with the interval above.
  real(wp), parameter :: idle = 2.0e-4_wp

contains

  !> Run the cases `pending`, whose list is on rank 0, with all processes and their threads. `error` says why not all were run.
  subroutine run(self, sweep, processes, pending, quiet, error)
    class(sweep_work_t), intent(inout) :: self
    type(sweep_t), intent(in), target :: sweep
    type(processes_t), intent(in) :: processes
    integer, allocatable, intent(inout) :: pending(:)   !! is moved away
    logical, intent(in) :: quiet
    type(error_t), allocatable, intent(out) :: error
    integer :: threads

    self%sweep => sweep
    self%processes = processes
    self%limit = sweep%deck%real_of('output', 'wall_limit')
    self%begun = wall_clock()
    self%progress = new_progress(sweep%deck%name, quiet)
    threads = thread_count(processes, sweep%cases)
    call new_worker(sweep, self%first_worker)
    call self%dealer%open(processes, threads, pending)
    call run_in_threads(self, threads)
    call self%dealer%close(self%finished, self%failed, self%stop)
    call self%progress%close()
    if (allocated(self%error)) then
      call move_alloc(self%error, error)
    else if (self%stop /= 0) then
      call raise(error, stopped_early, stop_text(self))
    end if
  end subroutine run

  !> As many threads as OpenMP counts processors or is set to use; a share, if several processes may use the processors.
  integer function thread_count(processes, cases) result(threads)
    !$ use omp_lib, only: omp_get_max_threads
    type(processes_t), intent(in) :: processes
    integer, intent(in) :: cases

    threads = 1
    !$ threads = omp_get_max_threads()
    if (environment('OMP_NUM_THREADS') == '' .and. processes%cores > 0) threads = min(threads, processes%cores)
    threads = min(threads, most_threads, cases)
  end function thread_count

  !> One thread, which computes case after case.
  subroutine run_cases(self, number)
    class(sweep_work_t), intent(inout), target :: self
    integer, intent(in) :: number
    type(sweep_watch_t) :: watch
    type(worker_t), allocatable :: worker
    type(case_t) :: case
    integer :: next
    logical :: done, none_left

    !$omp atomic
    self%at_work = self%at_work + 1
    watch%shared => self
    watch%is_first = number == 1
    allocate (worker, source=self%first_worker)
    do
      if (watch%asked_to_stop()) exit
      none_left = .false.
      do while (worker%has_room())
        !$omp critical (dealing)
        next = self%dealer%take()
        none_left = next == 0 .and. self%dealer%none_left
        !$omp end critical (dealing)
        if (next == 0) exit
        call worker%begin_case(self%sweep, next)
      end do
      if (worker%is_idle()) then
        if (none_left) exit
        call wait_seconds(idle)
        cycle
      end if
      call worker%next_result(watch, case, done)
      if (.not. done) exit
      call keep(self, case)
    end do
    if (watch%is_first) call wait_for_others(self)
    !$omp atomic
    self%at_work = self%at_work - 1
  end subroutine run_cases

  !> The first thread, when it has no case, still handles the interruptions for the others, and rank 0 for other processes.
  subroutine wait_for_others(self)
    type(sweep_work_t), intent(inout) :: self
    real(wp) :: told_at
    integer :: at_work

    told_at = -1.0_wp
    do
      call look_around(self)
      !$omp atomic read
      at_work = self%at_work
      if (at_work <= 1 .and. self%dealer%others_are_done()) exit
      call self%processes%wait(look, told_at)
    end do
  end subroutine wait_for_others

  !> A finished case goes to the shard.
  subroutine keep(self, case)
    type(sweep_work_t), intent(inout) :: self
    type(case_t), intent(in) :: case

    !$omp critical (keeping)
    if (.not. allocated(self%error)) then
      call self%shard%append(case, self%error)
      if (allocated(self%error)) then
        !$omp atomic write
        self%stop = by_error
      else
        self%finished = self%finished + 1
        if (case%result_code /= 0) self%failed = self%failed + 1
      end if
    end if
    !$omp end critical (keeping)
  end subroutine keep

  !> The first thread handles what is due.
  logical function asked_to_stop(self)
    class(sweep_watch_t), intent(inout) :: self
    integer :: stop

    if (self%is_first) call look_around(self%shared)
    !$omp atomic read
    stop = self%shared%stop
    asked_to_stop = stop /= 0
  end function asked_to_stop

  !> New cases, signals, the limit, progress.
  subroutine look_around(self)
    type(sweep_work_t), intent(inout) :: self
    integer :: finished, failed, left, wanted, stop
    real(wp) :: passed

    passed = wall_clock() - self%begun
    !$omp critical (dealing)
    left = self%dealer%left()
    !$omp end critical (dealing)
    if (left > 0 .and. passed - self%looked < look) return
    self%looked = passed
    !$omp critical (keeping)
    finished = self%finished
    failed = self%failed
    !$omp end critical (keeping)
    !$omp atomic read
    stop = self%stop
    if (stop == 0) stop = stop_signal()
    if (stop == 0 .and. self%limit > 0.0_wp .and. passed > self%limit) stop = at_limit
    !$omp critical (dealing)
    wanted = merge(self%dealer%wanted(finished), 0, stop == 0)
    call self%dealer%deal(wanted, finished, failed, passed, stop)
    !$omp end critical (dealing)
    if (stop /= 0) then
      !$omp atomic write
      self%stop = stop
    end if
    call self%progress%show_cases(self%done_before, self%dealer%finished, self%to_do, &
      self%failed_before + self%dealer%failed, passed)
  end subroutine look_around

  !> Why the sweep has stopped, how far it is, and how to continue.
  function stop_text(self) result(text)
    type(sweep_work_t), intent(in) :: self
    character(:), allocatable :: text

    text = 'stopped at output.wall_limit'
    if (self%stop > no_signal) text = stopped_by(self%stop)
    text = text//' after '//integer_text(self%done_before + self%dealer%finished)//' of '// &
      integer_text(self%done_before + self%to_do)//' cases: start it again to continue'
  end function stop_text
end module dst_sweep_work
