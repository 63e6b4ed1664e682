!> The processes of a sweep, in a build without MPI: there is one. `ranks_mpi.f90` is the same module for many.
module dst_ranks
  use dst_errors, only: error_t
  implicit none
  private

  public :: ranks_t, start_ranks

  !> The one process of a sweep without MPI.
  type :: ranks_t
    integer :: rank = 0, count = 1
    integer, allocatable, private :: pending(:)   !! cases not yet dealt out
    integer :: finished = 0, failed = 0           !! of all processes, as far as is known here
  contains
    procedure :: open_list
    procedure :: deal
    procedure :: others_are_done
    procedure :: close_list
    procedure :: stop_all
    procedure :: end
  end type ranks_t

contains

  !> There is one process.
  subroutine start_ranks(ranks, error)
    type(ranks_t), intent(out) :: ranks
    type(error_t), allocatable, intent(out) :: error

    ranks%count = 1
  end subroutine start_ranks

  !> Begin to deal out the cases `pending`.
  subroutine open_list(self, pending)
    class(ranks_t), intent(inout) :: self
    integer, allocatable, intent(inout) :: pending(:)   !! is taken away

    call move_alloc(pending, self%pending)
  end subroutine open_list

  !> Take more cases, if `wanted` are more than 0: here all there are. `none_left` if there will be no more.
  subroutine deal(self, wanted, finished, failed, numbers, none_left, stop)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: wanted
    integer, intent(in) :: finished, failed              !! of this process so far
    integer, allocatable, intent(out) :: numbers(:)      !! unallocated if there are none now
    logical, intent(inout) :: none_left
    logical, intent(inout) :: stop                       !! this process stops; on return: any process does

    associate (unused => stop)
    end associate
    self%finished = finished
    self%failed = failed
    if (wanted == 0) return
    call move_alloc(self%pending, numbers)
    none_left = .true.
  end subroutine deal

  logical function others_are_done(self)
    class(ranks_t), intent(in) :: self

    associate (unused => self)
    end associate
    others_are_done = .true.
  end function others_are_done

  !> Take leave of the other processes, and wait for them; then `finished` and `failed` are those of all.
  subroutine close_list(self, finished, failed, stop)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: finished, failed
    logical, intent(inout) :: stop                       !! as for `deal`

    associate (unused => stop)
    end associate
    self%finished = finished
    self%failed = failed
  end subroutine close_list

  !> Whether and why any process stopped: the largest `code` of all.
  subroutine stop_all(self, code)
    class(ranks_t), intent(in) :: self
    integer, intent(inout) :: code

    associate (unused => self, also_unused => code)
    end associate
  end subroutine stop_all

  subroutine end(self)
    class(ranks_t), intent(in) :: self

    associate (unused => self)
    end associate
  end subroutine end
end module dst_ranks
