!> The processes that a launcher started together, in a build without MPI: there is one. `processes_mpi.f90` is the same module for
!> many.
module dst_processes
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  implicit none
  private

  public :: processes_t, patience_t, mpi_library

  !> The one process.
  type :: processes_t
    integer :: rank = 0, count = 1
    integer :: cores = 0                  !! all that it may use
  contains
    procedure :: start
    procedure :: is_first
    procedure :: agree
    procedure :: share_text
    procedure :: share_numbers
    procedure :: sum_up
    procedure :: send
    procedure :: look_for_message
    procedure :: end
  end type processes_t

  !> Waiting for other processes.
  type :: patience_t
  contains
    procedure :: check
  end type patience_t

contains

  !> There is nothing to start.
  subroutine start(self, error)
    class(processes_t), intent(out) :: self
    type(error_t), allocatable, intent(out) :: error

    associate (unused => self)
    end associate
  end subroutine start

  !> Whether this process does what only one does.
  pure logical function is_first(self)
    class(processes_t), intent(in) :: self

    is_first = self%rank == 0
  end function is_first

  !> Give all processes one verdict.
  subroutine agree(self, error)
    class(processes_t), intent(in) :: self
    type(error_t), allocatable, intent(inout) :: error

    associate (unused => self, also_unused => error)
    end associate
  end subroutine agree

  !> Give the text of the first process to all.
  subroutine share_text(self, text)
    class(processes_t), intent(in) :: self
    character(:), allocatable, intent(inout) :: text

    associate (unused => self, also_unused => text)
    end associate
  end subroutine share_text

  !> Give the numbers of the first process to all.
  subroutine share_numbers(self, numbers)
    class(processes_t), intent(in) :: self
    real(wp), allocatable, intent(inout) :: numbers(:)

    associate (unused => self, also_unused => numbers)
    end associate
  end subroutine share_numbers

  !> The sums of all processes' numbers.
  subroutine sum_up(self, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(inout) :: numbers(:)

    associate (unused => self, also_unused => numbers)
    end associate
  end subroutine sum_up

  !> Nobody is there to get a message.
  subroutine send(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(in) :: rank, subject
    integer, intent(in) :: numbers(:)

    associate (unused => self, also_unused => rank, third => subject, fourth => numbers)
    end associate
  end subroutine send

  !> No message ever is there: `numbers` are unallocated.
  subroutine look_for_message(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(out) :: rank, subject
    integer, allocatable, intent(inout) :: numbers(:)   !! unallocated if there is none

    associate (unused => self)
    end associate
    rank = -1
    subject = 0
    if (allocated(numbers)) deallocate (numbers)
  end subroutine look_for_message

  subroutine end(self)
    class(processes_t), intent(inout) :: self

    associate (unused => self)
    end associate
  end subroutine end

  !> There is nobody to wait for.
  subroutine check(self, processes)
    class(patience_t), intent(inout) :: self
    class(processes_t), intent(in) :: processes

    associate (unused => self, also_unused => processes)
    end associate
  end subroutine check

  !> ''
  function mpi_library() result(text)
    character(:), allocatable :: text

    text = ''
  end function mpi_library
end module dst_processes
