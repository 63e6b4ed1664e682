!> The processes of a sweep, over MPI. Rank 0 deals out the work a little at a time while it works itself.
!>
!> Only the first thread of a process calls anything here. Every call of `deal` is short: messages are looked for, not waited for.
!> Source: MPI 3.1 standard, chapters 3 and 12. `ranks_serial.f90` is the same module for one process.
module dst_ranks
  use mpi_f08, only: mpi_comm_world, mpi_init_thread, mpi_comm_rank, mpi_comm_size, mpi_bcast, mpi_iprobe, mpi_recv, mpi_send, &
    mpi_barrier, mpi_allreduce, mpi_finalize, mpi_status, mpi_integer, mpi_any_source, mpi_status_ignore, mpi_in_place, &
    mpi_sum, mpi_max, mpi_thread_funneled
  use dst_errors, only: error_t, raise, usage_error
  implicit none
  private

  public :: ranks_t, start_ranks

  !> The processes of a sweep, as seen by one of them.
  type :: ranks_t
    integer :: rank = 0, count = 1
    !> Cases not yet given to a process: a piece of a list from `next` to `last`. Rank 0 knows.
    integer, private :: next = 1, last = 0
    integer, private :: ended = 0              !! processes that have taken leave of rank 0
    logical, private :: asked = .false.        !! an answer of rank 0 is on its way
    integer, allocatable, private :: done_by(:, :)   !! finished and failed cases of each rank
    integer :: finished = 0, failed = 0        !! of all processes, as far as is known here
  contains
    procedure :: share
    procedure :: open_list
    procedure :: deal
    procedure :: close_list
    procedure :: stop_all
    procedure :: end
  end type ranks_t

  integer, parameter :: asks = 1, answers = 2, leaves = 3
  !> At most so many cases are given at once; and of what is left no more than this part of a process's share.
  integer, parameter :: most = 256, part = 4

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

  !> Give all processes what the first one has.
  subroutine share(self, list)
    class(ranks_t), intent(in) :: self
    integer, allocatable, intent(inout) :: list(:)
    integer :: length

    length = size(list)
    call mpi_bcast(length, 1, mpi_integer, 0, mpi_comm_world)
    if (self%rank > 0) then
      deallocate (list)
      allocate (list(length))
    end if
    call mpi_bcast(list, length, mpi_integer, 0, mpi_comm_world)
  end subroutine share

  !> Begin to deal out a list of `length` pieces of work.
  subroutine open_list(self, length)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: length

    self%next = 1
    self%last = length
    self%ended = 0
    self%asked = .false.
  end subroutine open_list

  !> Take the next pieces, if `wanted`: `range(1)` to `range(2)`, empty if there are none now; `none_left` if there will be no more.
  subroutine deal(self, wanted, finished, failed, range, none_left)
    class(ranks_t), intent(inout) :: self
    logical, intent(in) :: wanted
    integer, intent(in) :: finished, failed   !! of this process so far
    integer, intent(out) :: range(2)
    logical, intent(inout) :: none_left
    logical :: there

    range = [1, 0]
    self%done_by(:, self%rank) = [finished, failed]
    if (self%rank == 0) then
      call serve(self)
      if (wanted) call cut_piece(self, range, none_left)
    else
      if (wanted .and. .not. (self%asked .or. none_left)) then
        call mpi_send([finished, failed], 2, mpi_integer, 0, asks, mpi_comm_world)
        self%asked = .true.
      end if
      if (.not. self%asked) return
      call mpi_iprobe(0, answers, mpi_comm_world, there, mpi_status_ignore)
      if (.not. there) return
      call mpi_recv(range, 2, mpi_integer, 0, answers, mpi_comm_world, mpi_status_ignore)
      self%asked = .false.
      none_left = range(2) < range(1)
    end if
  end subroutine deal

  !> Rank 0 answers all who have asked.
  subroutine serve(self)
    class(ranks_t), intent(inout) :: self
    type(mpi_status) :: status
    integer :: range(2), done(2)
    logical :: there, ignored

    do
      call mpi_iprobe(mpi_any_source, asks, mpi_comm_world, there, status)
      if (.not. there) exit
      call mpi_recv(done, 2, mpi_integer, status%mpi_source, asks, mpi_comm_world, mpi_status_ignore)
      self%done_by(:, status%mpi_source) = done
      call cut_piece(self, range, ignored)
      call mpi_send(range, 2, mpi_integer, status%mpi_source, answers, mpi_comm_world)
    end do
    do
      call mpi_iprobe(mpi_any_source, leaves, mpi_comm_world, there, status)
      if (.not. there) exit
      call mpi_recv(done, 2, mpi_integer, status%mpi_source, leaves, mpi_comm_world, mpi_status_ignore)
      self%done_by(:, status%mpi_source) = done
      self%ended = self%ended + 1
    end do
    self%finished = sum(self%done_by(1, :))
    self%failed = sum(self%done_by(2, :))
  end subroutine serve

  !> The less is left, the smaller the pieces.
  subroutine cut_piece(self, range, none_left)
    class(ranks_t), intent(inout) :: self
    integer, intent(out) :: range(2)
    logical, intent(out) :: none_left
    integer :: length

    length = max(1, min(most, (self%last - self%next + 1)/(part*self%count)))
    range = [self%next, min(self%last, self%next + length - 1)]
    self%next = range(2) + 1
    none_left = range(2) < range(1)
  end subroutine cut_piece

  !> Wait until every process has done its work; then `finished` and `failed` are those of all.
  subroutine close_list(self, finished, failed)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: finished, failed
    integer :: range(2), sums(2)
    logical :: none_left

    if (self%rank == 0) then
      do while (self%ended < self%count - 1)
        none_left = .true.
        call self%deal(.false., finished, failed, range, none_left)
        call pause()
      end do
    else
      ! An answer that is on its way must not meet the next sweep.
      if (self%asked) call mpi_recv(range, 2, mpi_integer, 0, answers, mpi_comm_world, mpi_status_ignore)
      call mpi_send([finished, failed], 2, mpi_integer, 0, leaves, mpi_comm_world)
    end if
    sums = [finished, failed]
    call mpi_allreduce(mpi_in_place, sums, 2, mpi_integer, mpi_sum, mpi_comm_world)
    self%finished = sums(1)
    self%failed = sums(2)
  end subroutine close_list

  !> A waiting process leaves its core to others.
  subroutine pause()
    use, intrinsic :: iso_c_binding, only: c_int
    interface
      integer(c_int) function c_usleep(microseconds) bind(c, name='usleep')
        import :: c_int
        integer(c_int), value :: microseconds
      end function c_usleep
    end interface
    integer(c_int) :: ignored

    ignored = c_usleep(200_c_int)
  end subroutine pause

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
