!> The processes that a launcher started together, in a build without MPI: there is one. `processes_mpi.f90` is the same module for
!> many, and explains the procedures; here no message is ever sent, and the data of the one process are those of all.
module dst_processes
  use dst_disk, only: wait_seconds
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  implicit none
  private

  public :: processes_t, mpi_library

  !> The one process.
  type :: processes_t
    integer :: rank = 0, count = 1
    integer :: cores = 0                  !! all that the process may use
  contains
    procedure :: start
    procedure :: agree
    procedure :: share_text
    procedure :: share_numbers
    procedure :: send
    procedure :: look_for_message
    procedure :: wait
    procedure :: end
  end type processes_t

contains

  subroutine start(self, error)
    class(processes_t), intent(out) :: self
    type(error_t), allocatable, intent(out) :: error

    associate (unused => self)
    end associate
  end subroutine start

  subroutine agree(self, error)
    class(processes_t), intent(in) :: self
    type(error_t), allocatable, intent(inout) :: error

    associate (unused => self, also_unused => error)
    end associate
  end subroutine agree

  subroutine share_text(self, text)
    class(processes_t), intent(in) :: self
    character(:), allocatable, intent(inout) :: text

    associate (unused => self, also_unused => text)
    end associate
  end subroutine share_text

  subroutine share_numbers(self, numbers)
    class(processes_t), intent(in) :: self
    real(wp), allocatable, intent(inout) :: numbers(:)

    associate (unused => self, also_unused => numbers)
    end associate
  end subroutine share_numbers

  subroutine send(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(in) :: rank, subject, numbers(:)

    associate (unused => self, also_unused => rank, third => subject, fourth => numbers)
    end associate
  end subroutine send

  subroutine look_for_message(self, rank, subject, numbers)
    class(processes_t), intent(in) :: self
    integer, intent(out) :: rank, subject
    integer, allocatable, intent(inout) :: numbers(:)

    associate (unused => self)
    end associate
    rank = -1
    subject = 0
    if (allocated(numbers)) deallocate (numbers)
  end subroutine look_for_message

  subroutine wait(self, pause, told_at)
    class(processes_t), intent(in) :: self
    real(wp), intent(in) :: pause
    real(wp), intent(inout) :: told_at

    associate (unused => self, also_unused => told_at)
    end associate
    call wait_seconds(pause)
  end subroutine wait

  subroutine end(self)
    class(processes_t), intent(inout) :: self

    associate (unused => self)
    end associate
  end subroutine end

  !> ''
  function mpi_library() result(text)
    character(:), allocatable :: text

    text = ''
  end function mpi_library
end module dst_processes
