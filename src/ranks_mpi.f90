!> The processes of a sweep, over MPI. Rank 0 deals out the cases a few at a time while it works itself.
!>
!> Only the first thread of a process calls anything here. Every call of `deal` is short: messages are looked for, not waited for.
!> A process asks for cases as often as it likes, and takes leave once; rank 0 answers each question, and says farewell to each
!> process once: when any process stops, so that all do, or else when all have taken leave. So no message is left over.
!> Source: MPI 3.1 standard, chapters 3 and 12. `ranks_serial.f90` is the same module for one process.
module dst_ranks
  use mpi_f08, only: mpi_comm_world, mpi_init_thread, mpi_comm_rank, mpi_comm_size, mpi_iprobe, mpi_recv, mpi_send, &
    mpi_get_count, mpi_barrier, mpi_allreduce, mpi_finalize, mpi_status, mpi_integer, mpi_any_source, mpi_any_tag, &
    mpi_status_ignore, mpi_in_place, mpi_sum, mpi_max, mpi_thread_funneled
  use dst_disk, only: wait_seconds
  use dst_errors, only: error_t, raise, usage_error
  use dst_kinds, only: wp
  implicit none
  private

  public :: ranks_t, start_ranks

  !> The processes of a sweep, as seen by one of them.
  type :: ranks_t
    integer :: rank = 0, count = 1
    integer, allocatable, private :: pending(:)      !! of rank 0: cases not yet dealt out, from `next` on
    integer, private :: next = 1
    integer, private :: gone = 0                     !! of rank 0: processes that have taken leave
    logical, private :: asked = .false.              !! an answer of rank 0 is on its way
    logical, private :: farewell = .false.           !! has come from rank 0, or been sent to all
    integer, allocatable, private :: done_by(:, :)   !! finished and failed cases of each rank
    integer :: finished = 0, failed = 0              !! of all processes, as far as is known here
  contains
    procedure :: open_list
    procedure :: deal
    procedure :: others_are_done
    procedure :: close_list
    procedure :: stop_all
    procedure :: end
  end type ranks_t

  integer, parameter :: asks = 1, answers = 2, leaves = 3, farewells = 4
  !> At most so many cases are given at once, so that an answer fits into a message that is sent without waiting; and of
  !> what is left no more than this part of a process's share.
  integer, parameter :: most = 512, part = 4

contains

  !> Start MPI.
  subroutine start_ranks(ranks, error)
    type(ranks_t), intent(out) :: ranks
    type(error_t), allocatable, intent(out) :: error
    integer :: provided

    call mpi_init_thread(mpi_thread_funneled, provided)
    call mpi_comm_rank(mpi_comm_world, ranks%rank)
    call mpi_comm_size(mpi_comm_world, ranks%count)
    allocate (ranks%done_by(2, 0:ranks%count - 1), source=0)
    if (provided < mpi_thread_funneled) call raise(error, usage_error, &
      'this MPI cannot be used with threads: build with -Dopenmp=disabled, or install another MPI')
  end subroutine start_ranks

  !> Begin to deal out the cases `pending` of rank 0.
  subroutine open_list(self, pending)
    class(ranks_t), intent(inout) :: self
    integer, allocatable, intent(inout) :: pending(:)   !! is taken away

    call move_alloc(pending, self%pending)
    self%next = 1
    self%gone = 0
    self%asked = .false.
    self%farewell = .false.
  end subroutine open_list

  !> Take more cases, if `wanted` are more than 0. `none_left` if there will be no more.
  subroutine deal(self, wanted, finished, failed, numbers, none_left, stop)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, intent(in) :: finished, failed              !! of this process so far
    integer, allocatable, intent(out) :: numbers(:)      !! unallocated if there are none now
    logical, intent(inout) :: none_left
    logical, intent(inout) :: stop                       !! this process stops; on return: any process does

    self%done_by(:, self%rank) = [finished, failed]
    if (self%rank == 0) then
      call serve(self, stop)
      if (wanted > 0) then
        call cut_piece(self, wanted, numbers)
        none_left = size(numbers) == 0
      end if
    else
      if (wanted > 0 .and. .not. (self%asked .or. none_left)) then
        call mpi_send([wanted, finished, failed], 3, mpi_integer, 0, asks, mpi_comm_world)
        self%asked = .true.
      end if
      call hear(self, numbers, none_left, stop)
    end if
  end subroutine deal

  !> Rank 0 answers all who have asked, and passes on that one of them stops.
  subroutine serve(self, stop)
    class(ranks_t), intent(inout) :: self
    logical, intent(inout) :: stop
    type(mpi_status) :: status
    integer, allocatable :: numbers(:)
    integer :: message(3)
    logical :: there

    do
      call mpi_iprobe(mpi_any_source, mpi_any_tag, mpi_comm_world, there, status)
      if (.not. there) exit
      call mpi_recv(message, 3, mpi_integer, status%mpi_source, status%mpi_tag, mpi_comm_world, mpi_status_ignore)
      self%done_by(:, status%mpi_source) = message(2:)
      if (status%mpi_tag == asks) then
        call cut_piece(self, message(1), numbers)
        call mpi_send(numbers, size(numbers), mpi_integer, status%mpi_source, answers, mpi_comm_world)
      else
        self%gone = self%gone + 1
        stop = stop .or. message(1) > 0
      end if
    end do
    self%finished = sum(self%done_by(1, :))
    self%failed = sum(self%done_by(2, :))
    if (stop) call say_farewell(self, stop)
  end subroutine serve

  subroutine say_farewell(self, stop)
    class(ranks_t), intent(inout) :: self
    logical, intent(in) :: stop
    integer :: rank

    if (self%farewell) return
    do rank = 1, self%count - 1
      call mpi_send([merge(1, 0, stop)], 1, mpi_integer, rank, farewells, mpi_comm_world)
    end do
    self%farewell = .true.
  end subroutine say_farewell

  !> What rank 0 says, if it has said anything.
  subroutine hear(self, numbers, none_left, stop)
    class(ranks_t), intent(inout) :: self
    integer, allocatable, intent(out) :: numbers(:)
    logical, intent(inout) :: none_left, stop
    type(mpi_status) :: status
    integer :: length, message(1)
    logical :: there

    if (.not. self%farewell) then
      call mpi_iprobe(0, farewells, mpi_comm_world, there, mpi_status_ignore)
      if (there) then
        call mpi_recv(message, 1, mpi_integer, 0, farewells, mpi_comm_world, mpi_status_ignore)
        self%farewell = .true.
        stop = stop .or. message(1) > 0
      end if
    end if
    if (.not. self%asked) return
    call mpi_iprobe(0, answers, mpi_comm_world, there, status)
    if (.not. there) return
    call mpi_get_count(status, mpi_integer, length)
    allocate (numbers(length))
    call mpi_recv(numbers, length, mpi_integer, 0, answers, mpi_comm_world, mpi_status_ignore)
    self%asked = .false.
    none_left = length == 0
  end subroutine hear

  !> The less is left, the smaller the pieces.
  subroutine cut_piece(self, wanted, numbers)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, allocatable, intent(out) :: numbers(:)
    integer :: left, length

    left = size(self%pending) - self%next + 1
    if (self%farewell) left = 0
    length = min(left, wanted, most, max(1, left/(part*self%count)))
    numbers = self%pending(self%next:self%next + length - 1)
    self%next = self%next + length
  end subroutine cut_piece

  !> Whether rank 0 need not look after other processes any more.
  logical function others_are_done(self)
    class(ranks_t), intent(in) :: self

    others_are_done = self%rank > 0 .or. self%gone == self%count - 1
  end function others_are_done

  !> Take leave of the other processes, and wait for them; then `finished` and `failed` are those of all. Of rank 0 all others
  !> must be done.
  subroutine close_list(self, finished, failed, stop)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: finished, failed
    logical, intent(inout) :: stop                       !! as for `deal`
    ! A process that waits leaves its core to others.
    real(wp), parameter :: pause = 2.0e-4_wp
    integer, allocatable :: numbers(:)
    integer :: sums(2)
    logical :: none_left

    if (self%rank == 0) then
      call say_farewell(self, stop)
    else
      do while (self%asked)
        call hear(self, numbers, none_left, stop)
        call wait_seconds(pause)
      end do
      call mpi_send([merge(1, 0, stop), finished, failed], 3, mpi_integer, 0, leaves, mpi_comm_world)
      do while (.not. self%farewell)
        call hear(self, numbers, none_left, stop)
        call wait_seconds(pause)
      end do
    end if
    sums = [finished, failed]
    call mpi_allreduce(mpi_in_place, sums, 2, mpi_integer, mpi_sum, mpi_comm_world)
    self%finished = sums(1)
    self%failed = sums(2)
  end subroutine close_list

  !> Whether and why any process stopped: the largest `code` of all.
  subroutine stop_all(self, code)
    class(ranks_t), intent(in) :: self
    integer, intent(inout) :: code

    associate (unused => self)
    end associate
    call mpi_allreduce(mpi_in_place, code, 1, mpi_integer, mpi_max, mpi_comm_world)
  end subroutine stop_all

  subroutine end(self)
    class(ranks_t), intent(in) :: self

    associate (unused => self)
    end associate
    call mpi_barrier(mpi_comm_world)
    call mpi_finalize()
  end subroutine end
end module dst_ranks
