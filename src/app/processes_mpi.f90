!> The processes that a launcher started together, over MPI: how they agree, communicate, and end.
!>
!> MPI is started once, before anything can fail, and ended once. No process waits inside MPI: operations of several processes are
!> begun, and tested again and again with a pause between, so that a process which waits leaves its core to others and still notices
!> signals. Only the first thread of a process calls anything here. Source: MPI 3.1 standard, chapters 3, 5, 8 and 12.
!> `processes_serial.f90` is the same module for one process.
module dst_processes
  use mpi_f08, only: mpi_comm, mpi_comm_world, mpi_info_null, mpi_comm_type_shared, mpi_init_thread, mpi_thread_funneled, &
    mpi_comm_rank, mpi_comm_size, mpi_comm_split_type, mpi_comm_free, mpi_iprobe, mpi_recv, mpi_send, mpi_get_count, &
    mpi_allreduce, mpi_iallreduce, mpi_ibcast, mpi_test, mpi_abort, mpi_finalize, mpi_get_library_version, mpi_request, &
    mpi_status, mpi_status_ignore, mpi_any_source, mpi_any_tag, mpi_integer, mpi_integer8, mpi_double_precision, &
    mpi_character, mpi_sum, mpi_max, mpi_max_library_version_string
  use dst_errors, only: error_t, raise, usage_error, some_failed, stopped_early
  use dst_disk, only: wait_seconds
  use dst_kinds, only: wp, int64
  use dst_signals, only: stop_signal, stopped_by, no_signal, stop_listening, end_after
  use dst_stopwatch, only: wall_clock
  use dst_standard_streams, only: put_error
  use dst_text, only: printable
  use dst_threads, only: allowed_cores, most_cores
  implicit none
  private

  public :: processes_t, mpi_library

  !> All processes, as seen by one of them.
  type :: processes_t
    integer :: rank = 0, count = 1
    integer :: cores = 0                  !! this process's share of the cores that it may use on its machine; 0 = all of them
    logical, private :: started = .false.
  contains
    procedure :: start
    procedure :: agree
    procedure :: share_text
    procedure :: share_numbers
    procedure :: send
    procedure :: look_for_message
    procedure :: wait
    procedure :: end
    procedure, private :: finish
    procedure, private :: patience
  end type processes_t

  !> A process that has been asked to stop waits for others this long [s]. The first processes report this before the others do.
  real(wp), parameter :: longest_wait = 6.5_wp, stagger = 0.3_wp
  integer, parameter :: most_staggered = 8
  !> Pause between two tests of a pending operation [s].
  real(wp), parameter :: shortest_pause = 1.0e-4_wp, longest_pause = 5.0e-3_wp

contains

  !> Start MPI.
  subroutine start(self, error)
    class(processes_t), intent(out) :: self
    type(error_t), allocatable, intent(out) :: error
    integer :: provided

    call mpi_init_thread(mpi_thread_funneled, provided)
    self%started = .true.
    call mpi_comm_rank(mpi_comm_world, self%rank)
    call mpi_comm_size(mpi_comm_world, self%count)
    self%cores = own_cores()
    if (provided < mpi_thread_funneled) call raise(error, usage_error, &
      'this MPI cannot be used with threads: build with -Dopenmp=disabled, or install another MPI')
  end subroutine start

  !> The cores that a process may use, each divided by the number of processes that may use it.
  integer function own_cores()
    type(mpi_comm) :: machine
    integer :: allowed(most_cores), users(most_cores)

    allowed = merge(1, 0, allowed_cores())
    call mpi_comm_split_type(mpi_comm_world, mpi_comm_type_shared, 0, mpi_info_null, machine)
    call mpi_allreduce(allowed, users, most_cores, mpi_integer, mpi_sum, machine)
    call mpi_comm_free(machine)
    own_cores = max(1, int(sum(real(allowed, wp)/max(1, users)) + epsilon(1.0)))
  end function own_cores

  !> Give all processes one verdict: the gravest of their errors. Only the first process that has it keeps its text. To be stopped
  !> is less grave than failed cases, which are less grave than any other error.
  subroutine agree(self, error)
    class(processes_t), intent(in) :: self
    type(error_t), allocatable, intent(inout) :: error
    integer(int64), parameter :: codes = 2_int64**8, ranks = 2_int64**32
    integer(int64), asynchronous :: own, verdict
    integer(int64) :: weight
    type(mpi_request) :: request

    if (self%count == 1) return
    own = 0
    if (allocated(error)) then
      weight = 3
      if (error%code == some_failed) weight = 2
      if (error%code == stopped_early) weight = 1
      ! A process that has the text has not lost it to an earlier verdict.
      weight = 2*weight + merge(1, 0, error%text /= '')
      own = (weight*ranks + (ranks - 1 - self%rank))*codes + error%code
    end if
    call mpi_iallreduce(own, verdict, 1, mpi_integer8, mpi_max, mpi_comm_world, request)
    call self%finish(request)
    if (verdict == 0) return
    if (self%rank == ranks - 1 - modulo(verdict/codes, ranks)) return
    error = error_t(int(modulo(verdict, codes)), '')
  end subroutine agree

  !> Send the text of the first process to all.
  subroutine share_text(self, text)
    class(processes_t), intent(in) :: self
    character(:), allocatable, intent(inout), asynchronous :: text
    integer :: length
    type(mpi_request) :: request

    if (self%count == 1) return
    length = 0
    if (self%rank == 0) length = len(text)
    call share_length(self, length)
    if (self%rank > 0) text = repeat(' ', length)
    call mpi_ibcast(text, length, mpi_character, 0, mpi_comm_world, request)
    call self%finish(request)
  end subroutine share_text

  !> Send the numbers of the first process to all.
  subroutine share_numbers(self, numbers)
    class(processes_t), intent(in) :: self
    real(wp), allocatable, intent(inout), asynchronous :: numbers(:)
    integer :: length
    type(mpi_request) :: request

    if (self%count == 1) return
    length = 0
    if (self%rank == 0) length = size(numbers)
    call share_length(self, length)
    if (self%rank > 0) allocate (numbers(length))
    call mpi_ibcast(numbers, length*(storage_size(1.0_wp)/storage_size(1.0d0)), mpi_double_precision, 0, mpi_comm_world, request)
    call self%finish(request)
  end subroutine share_numbers

  subroutine share_length(self, length)
    class(processes_t), intent(in) :: self
    integer, intent(inout), asynchronous :: length
    type(mpi_request) :: request

    call mpi_ibcast(length, 1, mpi_integer, 0, mpi_comm_world, request)
    call self%finish(request)
  end subroutine share_length

  !> Send a short message.
  subroutine send(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(in) :: rank, subject, numbers(:)

    associate (unused => self)
    end associate
    call mpi_send(numbers, size(numbers), mpi_integer, rank, subject, mpi_comm_world)
  end subroutine send

  !> A message to this process, if there is one; else `numbers` are unallocated.
  subroutine look_for_message(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(out) :: rank, subject
    integer, allocatable, intent(out) :: numbers(:)
    type(mpi_status) :: status
    integer :: length
    logical :: there

    rank = -1
    subject = 0
    if (self%count == 1) return
    call mpi_iprobe(mpi_any_source, mpi_any_tag, mpi_comm_world, there, status)
    if (.not. there) return
    rank = status%mpi_source
    subject = status%mpi_tag
    call mpi_get_count(status, mpi_integer, length)
    allocate (numbers(length))
    call mpi_recv(numbers, length, mpi_integer, rank, subject, mpi_comm_world, mpi_status_ignore)
  end subroutine look_for_message

  !> End MPI, which may wait for a process that is gone. From here on signals have their usual effect, and one that came shortly
  !> before has it after a while.
  subroutine end(self)
    class(processes_t), intent(inout) :: self

    if (.not. self%started) return
    self%started = .false.
    call stop_listening()
    if (stop_signal() /= no_signal) call end_after(self%patience(), no_answer(), stopped_early)
    call mpi_finalize()
  end subroutine end

  !> Wait until the pending operations are finished.
  subroutine finish(self, request)
    class(processes_t), intent(in) :: self
    type(mpi_request), intent(inout) :: request
    real(wp) :: idle, told_at
    logical :: done

    idle = shortest_pause
    told_at = -1.0_wp
    do
      call mpi_test(request, done, mpi_status_ignore)
      if (done) return
      call self%wait(idle, told_at)
      idle = min(2.0_wp*idle, longest_pause)
    end do
  end subroutine finish

  !> Wait a moment for others. If they continue to keep this process waiting although it has been asked to stop, all processes are
  !> ended: finished cases are in files.
  subroutine wait(self, pause, told_at)
    class(processes_t), intent(in) :: self
    real(wp), intent(in) :: pause        !! s
    real(wp), intent(inout) :: told_at   !! wall time at which the request to stop was noticed [s]; negative before

    call wait_seconds(pause)
    if (stop_signal() == no_signal) return
    if (told_at < 0.0_wp) told_at = wall_clock()
    if (wall_clock() - told_at < self%patience()) return
    call put_error(no_answer()//new_line('a'))
    call mpi_abort(mpi_comm_world, stopped_early)
  end subroutine wait

  !> How long this process waits for others if it has been asked to stop [s].
  real(wp) function patience(self)
    class(processes_t), intent(in) :: self

    patience = longest_wait + stagger*min(self%rank, most_staggered)
  end function patience

  function no_answer() result(text)
    character(:), allocatable :: text

    text = 'dynstiction: '//stopped_by()//', and another process does not answer: all are ended; start it again to continue'
  end function no_answer

  !> Name and version of the library.
  function mpi_library() result(text)
    character(:), allocatable :: text
    character(mpi_max_library_version_string) :: version
    integer :: length, i

    call mpi_get_library_version(version, length)
    length = scan(version(:length)//new_line('a'), ','//new_line('a')//achar(0)) - 1
    do i = 1, length
      if (version(i:i) == achar(9)) version(i:i) = ' '
    end do
    text = printable(version(:length))
  end function mpi_library
end module dst_processes
