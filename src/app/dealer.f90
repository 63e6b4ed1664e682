!> Cases dealt out to processes: rank 0 gives them a few at a time while it works itself.
!>
!> Every call of `deal` is short: messages are looked for, not waited for. A process has one question under way at most, and takes
!> leave once. Rank 0 says farewell to each process once: when any process stops, so that all do, or else when all have taken leave;
!> until then it answers each question. So no message is left over.
module dst_dealer
  use dst_kinds, only: wp
  use dst_processes, only: processes_t
  implicit none
  private

  public :: dealer_t

  !> The cases of a sweep, as one of its processes gets them.
  type :: dealer_t
    integer :: finished = 0, failed = 0              !! of rank 0: cases of all processes, as far as is known there
    logical :: none_left = .false.                   !! no more cases come to this process
    type(processes_t), private :: processes
    integer, allocatable, private :: pending(:)      !! of rank 0: cases not yet dealt out, from `next` on
    integer, private :: next = 1
    integer, private :: gone = 0                     !! of rank 0: processes that have taken leave
    logical, private :: asked = .false.              !! an answer of rank 0 is on its way
    logical, private :: farewell = .false.           !! has come from rank 0, or been sent to all
    integer, allocatable, private :: done_by(:, :)   !! finished and failed cases of each rank
  contains
    procedure :: open
    procedure :: deal
    procedure :: others_are_done
    procedure :: close
  end type dealer_t

  !> What a message is about.
  integer, parameter :: asks = 1, answers = 2, leaves = 3, farewells = 4
  !> At most so many cases are given at once, so that an answer fits into a message that is sent without waiting; and of
  !> what is left no more than this part of a process's share.
  integer, parameter :: most = 512, part = 4

contains

  !> Begin to deal out the cases `pending` of rank 0.
  subroutine open(self, processes, pending)
    class(dealer_t), intent(out) :: self
    type(processes_t), intent(in) :: processes
    integer, allocatable, intent(inout) :: pending(:)   !! is taken away

    self%processes = processes
    call move_alloc(pending, self%pending)
    if (processes%rank == 0) allocate (self%done_by(2, 0:processes%count - 1), source=0)
  end subroutine open

  !> Take more cases, if `wanted` are more than 0.
  subroutine deal(self, wanted, finished, failed, numbers, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, intent(in) :: finished, failed           !! of this process so far
    integer, allocatable, intent(out) :: numbers(:)   !! unallocated if there are none now
    integer, intent(inout) :: stop                    !! why this process stops, 0 if it does not; on return: why any does

    if (self%processes%rank == 0) then
      self%done_by(:, 0) = [finished, failed]
      call serve(self, stop)
      if (wanted > 0) call cut_piece(self, wanted, numbers)
    else
      if (wanted > 0 .and. .not. (self%asked .or. self%farewell)) then
        call self%processes%send(0, asks, [wanted, finished, failed])
        self%asked = .true.
      end if
      call hear(self, numbers, stop)
    end if
    if (allocated(numbers)) self%none_left = size(numbers) == 0
  end subroutine deal

  !> Rank 0 answers all who have asked, and passes on that one of them stops.
  subroutine serve(self, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(inout) :: stop
    integer, allocatable :: message(:), numbers(:)
    integer :: rank, subject

    do
      call self%processes%look_for_message(rank, subject, message)
      if (.not. allocated(message)) exit
      self%done_by(:, rank) = message(2:3)
      if (subject == leaves) then
        self%gone = self%gone + 1
        if (stop == 0) stop = message(1)
      else if (.not. self%farewell) then
        call cut_piece(self, message(1), numbers)
        call self%processes%send(rank, answers, numbers)
      end if
    end do
    self%finished = sum(self%done_by(1, :))
    self%failed = sum(self%done_by(2, :))
    if (stop /= 0) call say_farewell(self, stop)
  end subroutine serve

  subroutine say_farewell(self, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: stop
    integer :: rank

    if (self%farewell) return
    do rank = 1, self%processes%count - 1
      call self%processes%send(rank, farewells, [stop])
    end do
    self%farewell = .true.
  end subroutine say_farewell

  !> What rank 0 says, if it has said anything.
  subroutine hear(self, numbers, stop)
    class(dealer_t), intent(inout) :: self
    integer, allocatable, intent(out) :: numbers(:)
    integer, intent(inout) :: stop
    integer, allocatable :: message(:)
    integer :: rank, subject

    call self%processes%look_for_message(rank, subject, message)
    if (.not. allocated(message)) return
    if (subject == farewells) then
      self%farewell = .true.
      if (stop == 0) stop = message(1)
    else
      self%asked = .false.
      call move_alloc(message, numbers)
    end if
  end subroutine hear

  !> The less is left, the smaller the pieces. One process alone gets all.
  subroutine cut_piece(self, wanted, numbers)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, allocatable, intent(out) :: numbers(:)
    integer :: left, length

    if (self%processes%count == 1) then
      call move_alloc(self%pending, numbers)
      allocate (self%pending(0))
      return
    end if
    left = size(self%pending) - self%next + 1
    length = min(left, wanted, most, max(1, left/(part*self%processes%count)))
    numbers = self%pending(self%next:self%next + length - 1)
    self%next = self%next + length
  end subroutine cut_piece

  !> Whether rank 0 need not look after other processes any more.
  logical function others_are_done(self)
    class(dealer_t), intent(in) :: self

    others_are_done = self%processes%rank > 0 .or. self%gone == self%processes%count - 1
  end function others_are_done

  !> Take leave of the other processes, and wait until rank 0 knows that all have: it then has the `finished` and `failed` of all.
  !> When rank 0 calls this, all others must be done.
  subroutine close(self, finished, failed, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: finished, failed
    integer, intent(inout) :: stop                    !! as for `deal`
    real(wp), parameter :: pause = 2.0e-4_wp          ! s
    real(wp) :: told_at
    integer, allocatable :: numbers(:)

    if (self%processes%rank == 0) then
      call self%deal(0, finished, failed, numbers, stop)
      call say_farewell(self, stop)
    else
      call self%processes%send(0, leaves, [stop, finished, failed])
      told_at = -1.0_wp
      do
        call hear(self, numbers, stop)
        if (self%farewell) exit
        call self%processes%wait(pause, told_at)
      end do
    end if
    if (allocated(self%pending)) deallocate (self%pending)
  end subroutine close
end module dst_dealer
