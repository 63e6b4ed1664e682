!> Cases dealt out to processes: rank 0 gives them a few at a time while it works itself.
!>
!> Every call of `deal` is short: messages are looked for, not waited for. A process asks for cases as often as it likes, and takes
!> leave once; rank 0 answers each question, and says farewell to each process once: when any process stops, so that all do, or
!> else when all have taken leave. So no message is left over.
module dst_dealer
  use dst_disk, only: wait_seconds
  use dst_kinds, only: wp
  use dst_processes, only: processes_t, patience_t
  implicit none
  private

  public :: dealer_t

  !> The cases of a sweep, as one of its processes gets them.
  type :: dealer_t
    integer :: finished = 0, failed = 0              !! cases of all processes, as far as is known here
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
    class(processes_t), intent(in) :: processes
    integer, allocatable, intent(inout) :: pending(:)   !! is taken away

    call move_alloc(pending, self%pending)
    if (processes%is_first()) allocate (self%done_by(2, 0:processes%count - 1), source=0)
  end subroutine open

  !> Take more cases, if `wanted` are more than 0. `none_left` if there will be no more.
  subroutine deal(self, processes, wanted, finished, failed, numbers, none_left, stop)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, intent(in) :: wanted
    integer, intent(in) :: finished, failed              !! of this process so far
    integer, allocatable, intent(out) :: numbers(:)      !! unallocated if there are none now
    logical, intent(inout) :: none_left
    integer, intent(inout) :: stop                       !! why this process stops, 0 if it does not; on return: why any does

    if (processes%is_first()) then
      self%done_by(:, 0) = [finished, failed]
      call serve(self, processes, stop)
      if (wanted == 0) return
      call cut_piece(self, processes, wanted, numbers)
      none_left = size(numbers) == 0
    else
      if (wanted > 0 .and. .not. (self%asked .or. none_left)) then
        call processes%send(0, asks, [wanted, finished, failed])
        self%asked = .true.
      end if
      call hear(self, processes, numbers, none_left, stop)
    end if
  end subroutine deal

  !> Rank 0 answers all who have asked, and passes on that one of them stops.
  subroutine serve(self, processes, stop)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, intent(inout) :: stop
    integer, allocatable :: message(:), numbers(:)
    integer :: rank, subject

    do
      call processes%look_for_message(rank, subject, message)
      if (.not. allocated(message)) exit
      self%done_by(:, rank) = message(2:3)
      if (subject == asks) then
        call cut_piece(self, processes, message(1), numbers)
        call processes%send(rank, answers, numbers)
      else
        self%gone = self%gone + 1
        if (stop == 0) stop = message(1)
      end if
    end do
    self%finished = sum(self%done_by(1, :))
    self%failed = sum(self%done_by(2, :))
    if (stop /= 0) call say_farewell(self, processes, stop)
  end subroutine serve

  subroutine say_farewell(self, processes, stop)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, intent(in) :: stop
    integer :: rank

    if (self%farewell) return
    do rank = 1, processes%count - 1
      call processes%send(rank, farewells, [stop])
    end do
    self%farewell = .true.
  end subroutine say_farewell

  !> What rank 0 says, if it has said anything.
  subroutine hear(self, processes, numbers, none_left, stop)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, allocatable, intent(out) :: numbers(:)
    logical, intent(inout) :: none_left
    integer, intent(inout) :: stop
    integer, allocatable :: message(:)
    integer :: rank, subject

    call processes%look_for_message(rank, subject, message)
    if (.not. allocated(message)) return
    if (subject == farewells) then
      self%farewell = .true.
      if (stop == 0) stop = message(1)
    else
      self%asked = .false.
      none_left = size(message) == 0
      call move_alloc(message, numbers)
    end if
  end subroutine hear

  !> The less is left, the smaller the pieces. One process alone gets all.
  subroutine cut_piece(self, processes, wanted, numbers)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, intent(in) :: wanted
    integer, allocatable, intent(out) :: numbers(:)
    integer :: left, length

    if (processes%count == 1) then
      call move_alloc(self%pending, numbers)
      allocate (self%pending(0))
      return
    end if
    left = size(self%pending) - self%next + 1
    if (self%farewell) left = 0
    length = min(left, wanted, most, max(1, left/(part*processes%count)))
    numbers = self%pending(self%next:self%next + length - 1)
    self%next = self%next + length
  end subroutine cut_piece

  !> Whether rank 0 need not look after other processes any more.
  logical function others_are_done(self, processes)
    class(dealer_t), intent(in) :: self
    class(processes_t), intent(in) :: processes

    others_are_done = processes%rank > 0 .or. self%gone == processes%count - 1
  end function others_are_done

  !> Take leave of the other processes, and wait for them; then `finished` and `failed` are those of all. Of rank 0 all others
  !> must be done.
  subroutine close(self, processes, finished, failed, stop)
    class(dealer_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes
    integer, intent(in) :: finished, failed
    integer, intent(inout) :: stop                       !! as for `deal`
    real(wp), parameter :: pause = 2.0e-4_wp
    type(patience_t) :: patience
    integer, allocatable :: numbers(:)
    integer :: sums(2)
    logical :: none_left

    if (processes%is_first()) then
      call say_farewell(self, processes, stop)
    else
      do while (self%asked)
        call hear(self, processes, numbers, none_left, stop)
        if (self%asked) call wait_a_moment()
      end do
      call processes%send(0, leaves, [stop, finished, failed])
      do while (.not. self%farewell)
        call hear(self, processes, numbers, none_left, stop)
        if (.not. self%farewell) call wait_a_moment()
      end do
    end if
    sums = [finished, failed]
    call processes%sum_up(sums)
    if (allocated(self%pending)) deallocate (self%pending)
    self%finished = sums(1)
    self%failed = sums(2)

  contains

    subroutine wait_a_moment()
      call patience%check(processes)
      call wait_seconds(pause)
    end subroutine wait_a_moment
  end subroutine close
end module dst_dealer
