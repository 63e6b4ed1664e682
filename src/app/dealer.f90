!> Distributes cases to processes: rank 0 gives out a few at a time while it computes itself. A single process has all cases from
!> the start.
!>
!> Every call of `deal` is short: it looks for messages and does not wait for them. A process has at most one pending request, and
!> reports once that it is done. Rank 0 dismisses each process once: when any process stops, so that all stop, or else when all are
!> done; until then it answers each request. So no message is left over.
!>
!> A process asks for more cases when its own last less than `ahead`, and asks for as many as last `piece` at its recent speed, or,
!> with many processes, so many that rank 0 gets at most one request in `message`.
module dst_dealer
  use dst_kinds, only: wp
  use dst_processes, only: processes_t
  implicit none
  private

  public :: dealer_t

  !> The cases of a sweep, as one of its processes receives them.
  type :: dealer_t
    integer :: finished = 0, failed = 0              !! on rank 0: cases of all processes, as far as they have reported
    logical :: none_left = .false.                   !! no more cases come to this process
    type(processes_t), private :: processes
    integer, allocatable, private :: given(:)        !! cases of this process; those from `next` on are not begun
    integer, private :: next = 1
    !> Speed of this process [cases/s]; time [s] and number of finished cases when the last cases were given.
    real(wp), private :: rate = 0.0_wp, since = 0.0_wp
    integer, private :: finished_then = 0
    logical, private :: asked = .false.              !! an answer of rank 0 is on its way
    logical, private :: farewell = .false.           !! has arrived from rank 0, or has been sent to all
    ! For rank 0 only.
    integer, allocatable, private :: pending(:)      !! cases that are not distributed, from `first` on
    integer, private :: first = 1
    integer, private :: gone = 0                     !! number of processes that are done
    integer, allocatable, private :: done_by(:, :)   !! finished and failed cases of each rank
  contains
    procedure :: open
    procedure :: take
    procedure :: left
    procedure :: wanted
    procedure :: deal
    procedure :: others_are_done
    procedure :: close
  end type dealer_t

  !> Kinds of messages.
  integer, parameter :: asks = 1, answers = 2, leaves = 3, farewells = 4
  !> At most this many cases are given at once, so that an answer fits into a message that is sent without waiting; and at most this
  !> part of a process's share of the remaining cases.
  integer, parameter :: most = 512, part = 4
  real(wp), parameter :: ahead = 2.0e-3_wp, piece = 5.0e-3_wp, message = 5.0e-5_wp   ! s

contains

  !> Begin to distribute the cases `pending` of rank 0. At first a process asks for one case for each of its threads.
  subroutine open(self, processes, threads, pending)
    class(dealer_t), intent(out) :: self
    type(processes_t), intent(in) :: processes
    integer, intent(in) :: threads
    integer, allocatable, intent(inout) :: pending(:)   !! is moved away

    self%processes = processes
    self%rate = threads/piece
    if (processes%rank == 0) allocate (self%done_by(2, 0:processes%count - 1), source=0)
    self%none_left = processes%count == 1
    if (self%none_left) then
      call move_alloc(pending, self%given)
    else
      allocate (self%given(0))
      call move_alloc(pending, self%pending)
    end if
  end subroutine open

  !> The next case of this process; 0 if it has none now.
  integer function take(self)
    class(dealer_t), intent(inout) :: self

    take = 0
    if (self%left() == 0) return
    take = self%given(self%next)
    self%next = self%next + 1
  end function take

  !> Number of cases of this process that have not begun.
  pure integer function left(self)
    class(dealer_t), intent(in) :: self

    left = size(self%given) - self%next + 1
  end function left

  !> How many cases to ask for when `finished` are finished here. The speed may have changed: nothing is requested ahead before one
  !> of the last cases given is finished.
  pure integer function wanted(self, finished)
    class(dealer_t), intent(in) :: self
    integer, intent(in) :: finished
    real(wp), parameter :: countable = 1.0e6_wp

    wanted = 0
    if (self%none_left .or. self%left() > self%rate*ahead) return
    if (self%left() > 0 .and. finished == self%finished_then) return
    wanted = max(1, nint(min(countable, self%rate*max(piece, self%processes%count*message))))
  end function wanted

  !> Exchange messages; take more cases, if `wanted` is more than 0 and there are any.
  subroutine deal(self, wanted, finished, failed, time, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, intent(in) :: finished, failed           !! numbers of this process so far
    real(wp), intent(in) :: time                      !! s
    integer, intent(inout) :: stop                    !! why this process stops, 0 if it does not; on return: why any process does
    integer, allocatable :: numbers(:)

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
    if (.not. allocated(numbers)) return
    self%none_left = size(numbers) == 0
    numbers = [self%given(self%next:), numbers]
    call move_alloc(numbers, self%given)
    self%next = 1
    if (finished == self%finished_then .or. time <= self%since) return
    self%rate = (finished - self%finished_then)/(time - self%since)
    self%since = time
    self%finished_then = finished
  end subroutine deal

  !> Rank 0 answers all processes that have asked, and informs the others if one of them stops.
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

  !> The message of rank 0, if there is one.
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

  !> The fewer cases remain, the smaller are the pieces.
  subroutine cut_piece(self, wanted, numbers)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, allocatable, intent(out) :: numbers(:)
    integer :: left, length

    left = size(self%pending) - self%first + 1
    length = min(left, wanted, most, max(1, left/(part*self%processes%count)))
    numbers = self%pending(self%first:self%first + length - 1)
    self%first = self%first + length
  end subroutine cut_piece

  !> Whether rank 0 need not serve other processes any more.
  logical function others_are_done(self)
    class(dealer_t), intent(in) :: self

    others_are_done = self%processes%rank > 0 .or. self%gone == self%processes%count - 1
  end function others_are_done

  !> Report to the other processes that this one is done, and wait until rank 0 has the report of all: it then has the sum of
  !> `finished` and `failed`. When rank 0 calls this, all others must be done.
  subroutine close(self, finished, failed, stop)
    class(dealer_t), intent(inout) :: self
    integer, intent(in) :: finished, failed
    integer, intent(inout) :: stop                    !! as for `deal`
    real(wp), parameter :: pause = 2.0e-4_wp          ! s
    real(wp) :: told_at
    integer, allocatable :: numbers(:)

    if (self%processes%rank == 0) then
      self%done_by(:, 0) = [finished, failed]
      call serve(self, stop)
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
    deallocate (self%given)
    if (allocated(self%pending)) deallocate (self%pending)
  end subroutine close
end module dst_dealer
