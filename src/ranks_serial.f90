!> The processes of a sweep, in a build without MPI: there is one. `ranks_mpi.f90` is the same module for many.
module dst_ranks
  use dst_errors, only: error_t
  implicit none
  private

  public :: ranks_t, start_ranks

  !> The one process of a sweep without MPI.
  type :: ranks_t
    integer :: rank = 0, count = 1
    !> Cases not yet given to a process: a piece of a list from `next` to `last`.
    integer, private :: next = 1, last = 0
    integer :: finished = 0, failed = 0       !! of all processes, as far as is known here
  contains
    procedure :: share
    procedure :: open_list
    procedure :: deal
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

  !> Give all processes what the first one has.
  subroutine share(self, list)
    class(ranks_t), intent(in) :: self
    integer, allocatable, intent(inout) :: list(:)

    associate (unused => self, also_unused => list)
    end associate
  end subroutine share

  !> Begin to deal out a list of `length` pieces of work.
  subroutine open_list(self, length)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: length

    self%next = 1
    self%last = length
  end subroutine open_list

  !> Take the next pieces, if `wanted`: `range(1)` to `range(2)`, empty if there are none now; `none_left` if there will be no more.
  subroutine deal(self, wanted, finished, failed, range, none_left)
    class(ranks_t), intent(inout) :: self
    logical, intent(in) :: wanted
    integer, intent(in) :: finished, failed   !! of this process so far
    integer, intent(out) :: range(2)
    logical, intent(inout) :: none_left

    range = [1, 0]
    self%finished = finished
    self%failed = failed
    if (.not. wanted) return
    range = [self%next, self%last]
    none_left = .true.
  end subroutine deal

  !> Wait until every process has done its work; then `finished` and `failed` are those of all.
  subroutine close_list(self, finished, failed)
    class(ranks_t), intent(inout) :: self
    integer, intent(in) :: finished, failed

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
