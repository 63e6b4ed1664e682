!> Computes the missing cases of a sweep, or of a share of it, with all threads of this process, into its file.
!>
!> A thread takes the next case whenever it has finished one. The first thread also handles signals, limits and progress, and makes
!> the file whole when that is due, between two slices of its case.
module dst_sweep_work
  use, intrinsic :: iso_c_binding, only: c_f_pointer, c_funloc, c_int, c_loc, c_ptr
  use dst_errors, only: error_t, raise, stopped_early
  use dst_kinds, only: wp, real64
  use dst_posix, only: no_signal, run_in_threads, stop_signal, stopped_by, wait_seconds
  use dst_plain_numbers, only: number_text
  use dst_progress, only: progress_t, new_progress, time_left
  use dst_result_file, only: interim_t
  use dst_stopwatch, only: wall_clock
  use dst_sweep, only: sweep_t, case_t, watch_t, worker_t, new_worker
  use dst_sweep_file, only: sweep_file_t, not_run
  use dst_text, only: integer_text
  implicit none
  private

  public :: sweep_work_t, run_missing_cases, thread_count

  !> Data that the threads share.
  type :: sweep_work_t
    type(sweep_file_t) :: file
    logical :: retry = .false.                   !! cases that failed are run again
    type(error_t), allocatable, private :: error !! the first one of the file
    integer, private :: to_do = 0, finished = 0  !! cases
    integer, private :: row = 0                  !! the last one that was taken
    integer, private :: stop = 0                 !! why cases are given up: a signal, or one of those below; 0 = they continue
    integer, private :: at_work = 0              !! number of threads with a case
    real(wp), private :: begun = 0.0_wp, looked = 0.0_wp, limit = 0.0_wp   !! s
    type(interim_t), private :: interim
    type(sweep_t), pointer, private :: sweep => null()
    type(worker_t), private :: first_worker      !! each thread gets a copy
    type(progress_t), private :: progress
  contains
    procedure :: is_pending
  end type sweep_work_t

  !> Why the cases stop, if not by a signal.
  integer, parameter :: at_limit = -1, by_error = -2

  type, extends(watch_t) :: sweep_watch_t
    type(sweep_work_t), pointer :: shared => null()
    logical :: is_first = .false.                !! first of the threads
  contains
    procedure :: asked_to_stop
  end type sweep_watch_t

  !> More threads than this are useful on no machine.
  integer, parameter :: most_threads = 1024

  !> Signals and limits are handled once in this many seconds, also by a first thread without a case.
  real(wp), parameter :: look = 5.0e-4_wp

contains

  !> Whether a row has a case that is to be run.
  elemental logical function is_pending(self, row)
    class(sweep_work_t), intent(in) :: self
    integer, intent(in) :: row

    is_pending = self%file%code(row) == not_run .or. (self%retry .and. self%file%code(row) > 0)
  end function is_pending

  !> Run the cases that the file lacks. `error` says why not all were run; the file is then still open, unless it cannot be written.
  subroutine run_missing_cases(self, sweep, quiet, error)
    type(sweep_work_t), intent(inout), target :: self
    type(sweep_t), intent(in), target :: sweep
    logical, intent(in) :: quiet
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    self%sweep => sweep
    self%to_do = count([(self%is_pending(i), i=1, self%file%rows)])
    self%limit = sweep%deck%real_of('output', 'wall_limit')
    self%begun = wall_clock()
    self%interim = interim_t(sweep%deck%real_of('output', 'checkpoint_interval'), self%begun, self%begun)
    self%progress = new_progress(sweep%deck%name, quiet)
    call new_worker(sweep, self%first_worker)
    call run_in_threads(c_funloc(run_cases), c_loc(self), int(thread_count(self%to_do), c_int))
    call self%progress%close()
    if (allocated(self%error)) then
      call move_alloc(self%error, error)
    else if (self%stop /= 0) then
      call raise(error, stopped_early, stop_text(self))
    end if
  end subroutine run_missing_cases

  !> As many threads as OpenMP counts processors or is set to use.
  integer function thread_count(cases) result(threads)
    !$ use omp_lib, only: omp_get_max_threads
    integer, intent(in) :: cases

    threads = 1
    !$ threads = omp_get_max_threads()
    threads = min(threads, most_threads, cases)
  end function thread_count

  !> One thread, which computes case after case.
  subroutine run_cases(task, number) bind(c)
    type(c_ptr), value :: task              !! the sweep_work_t
    integer(c_int), value :: number
    type(sweep_work_t), pointer :: self
    type(sweep_watch_t) :: watch
    type(worker_t), allocatable :: worker
    type(case_t) :: case
    integer :: next
    logical :: done

    call c_f_pointer(task, self)
    !$omp atomic
    self%at_work = self%at_work + 1
    watch%shared => self
    watch%is_first = number == 1
    allocate (worker, source=self%first_worker)
    do
      if (watch%asked_to_stop()) exit
      do while (worker%has_room())
        !$omp critical (dealing)
        next = next_row(self)
        !$omp end critical (dealing)
        if (next == 0) exit
        call worker%begin_case(self%sweep, self%file%share%case_of(next))
      end do
      if (worker%is_idle()) exit
      call worker%next_result(watch, case, done)
      if (.not. done) exit
      call keep(self, case)
    end do
    !$omp atomic
    self%at_work = self%at_work - 1
    if (watch%is_first) call wait_for_others(self)
  end subroutine run_cases

  !> The next row whose case is to be run; 0 if there is none.
  integer function next_row(self)
    class(sweep_work_t), intent(inout) :: self

    next_row = 0
    do while (self%row < self%file%rows .and. next_row == 0)
      self%row = self%row + 1
      if (self%is_pending(self%row)) next_row = self%row
    end do
  end function next_row

  !> The first thread, when it has no case, still handles what is due.
  subroutine wait_for_others(self)
    type(sweep_work_t), intent(inout) :: self
    integer :: at_work

    do
      !$omp atomic read
      at_work = self%at_work
      if (at_work == 0) exit
      call look_around(self)
      call wait_seconds(real(look, real64))
    end do
  end subroutine wait_for_others

  !> A finished case goes to the file.
  subroutine keep(self, case)
    type(sweep_work_t), intent(inout) :: self
    type(case_t), intent(in) :: case

    !$omp critical (keeping)
    if (.not. allocated(self%error)) then
      call self%file%put(case, self%error)
      self%finished = self%finished + 1
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

  !> Signals, the limit, progress, and the file.
  subroutine look_around(self)
    type(sweep_work_t), intent(inout) :: self
    integer :: finished, failed, stop
    logical :: is_lost
    real(wp) :: passed
    character(:), allocatable :: pace

    passed = wall_clock() - self%begun
    if (passed - self%looked < look) return
    self%looked = passed
    !$omp critical (keeping)
    finished = self%finished
    failed = self%file%failed
    is_lost = allocated(self%error)
    !$omp end critical (keeping)
    stop = stop_signal()
    if (stop == 0 .and. self%limit > 0.0_wp .and. passed > self%limit) stop = at_limit
    if (is_lost) stop = by_error
    if (stop /= 0) then
      !$omp atomic write
      self%stop = stop
    else if (self%interim%is_due(self%begun + passed) .and. finished < self%to_do) then
      call make_whole(self)
    end if
    if (.not. self%progress%is_due(passed)) return
    pace = ''
    if (finished > 0) pace = ', '//number_text(real(finished, wp)/passed)//' cases/s'// &
      time_left(passed, real(finished, wp)/real(self%to_do, wp))
    call self%progress%show(integer_text(self%file%rows - self%to_do + finished)//' of '//integer_text(self%file%rows)// &
      ' cases, '//integer_text(failed)//' failed'//pace, passed)
  end subroutine look_around

  !> Make the file whole, and go on in a new one. Other threads wait if they have finished a case.
  subroutine make_whole(self)
    type(sweep_work_t), intent(inout) :: self

    !$omp critical (keeping)
    if (self%file%is_changed .and. .not. allocated(self%error)) then
      call self%file%make_whole(self%error)
      if (.not. allocated(self%error)) call self%file%go_on(self%error)
      self%interim%made = wall_clock()
    end if
    !$omp end critical (keeping)
  end subroutine make_whole

  !> Why the sweep has stopped, how far it is, and how to continue.
  function stop_text(self) result(text)
    type(sweep_work_t), intent(in) :: self
    character(:), allocatable :: text

    text = 'stopped at output.wall_limit'
    if (self%stop > no_signal) text = stopped_by()
    text = text//' after '//integer_text(self%file%done)//' of '//integer_text(self%file%rows)// &
      ' cases: start it again to continue'
  end function stop_text
end module dst_sweep_work
