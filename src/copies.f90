!> Copies of this program that a launcher started together, as its environment tells.
module dst_copies
  use dst_errors, only: error_t, raise, usage_error
  use dst_text, only: integer_text
  implicit none
  private

  public :: check_alone, check_knowledge

  !> Of Open MPI, of MPICH and its kin, and of Slurm: how many processes there are, and which this one is, counted from 0.
  character(20), parameter :: sizes(4) = [character(20) :: 'OMPI_COMM_WORLD_SIZE', 'PMI_SIZE', 'MPI_LOCALNRANKS', &
    'SLURM_STEP_NUM_TASKS']
  character(20), parameter :: numbers(4) = [character(20) :: 'OMPI_COMM_WORLD_RANK', 'PMI_RANK', 'MPI_LOCALRANKID', &
    'SLURM_PROCID']

contains

  !> Refuse `what` to more than one process: each would write the same files.
  subroutine check_alone(what, error)
    character(*), intent(in) :: what
    type(error_t), allocatable, intent(out) :: error

    call refuse_copies(what//' is for one process', 'start it without the launcher', error)
  end subroutine check_alone

  !> Refuse several processes that each believe to be the only one of `ranks` processes.
  subroutine check_knowledge(ranks, error)
    integer, intent(in) :: ranks
    type(error_t), allocatable, intent(out) :: error

    if (ranks > 1) return
    call refuse_copies('they know nothing of each other', &
      'start the program once, build it with -Dmpi=enabled for this MPI, or use --shard', error)
  end subroutine check_knowledge

  !> The first copy says so for all.
  subroutine refuse_copies(reason, remedy, error)
    character(*), intent(in) :: reason, remedy
    type(error_t), allocatable, intent(out) :: error
    integer :: i, copies

    do i = 1, size(sizes)
      copies = number_in(sizes(i))
      if (copies < 2) cycle
      if (number_in(numbers(i)) > 0) then
        error = error_t(usage_error, '')
      else
        call raise(error, usage_error, 'this is one of '//integer_text(copies)//' copies ('//trim(sizes(i))//'), and '// &
          reason//': '//remedy)
      end if
      return
    end do
  end subroutine refuse_copies

  !> A number in the environment; 0 if there is none.
  integer function number_in(variable)
    character(*), intent(in) :: variable
    character(32) :: value
    integer :: status

    number_in = 0
    call get_environment_variable(trim(variable), value, status=status)
    if (status == 0) read (value, *, iostat=status) number_in
    if (status /= 0) number_in = 0
  end function number_in
end module dst_copies
