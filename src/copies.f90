!> Copies of this program that a launcher started together, as its environment tells.
module dst_copies
  implicit none
  private

  public :: copies_t, copies_in_environment

  !> How many there are, and which this one is, counted from 0.
  type :: copies_t
    integer :: count = 1, number = 0
    character(:), allocatable :: variable    !! of the environment, that told
  end type copies_t

  !> Of Open MPI, of MPICH and its kin, and of Slurm.
  character(20), parameter :: sizes(4) = [character(20) :: 'OMPI_COMM_WORLD_SIZE', 'PMI_SIZE', 'MPI_LOCALNRANKS', &
    'SLURM_STEP_NUM_TASKS']
  character(20), parameter :: numbers(4) = [character(20) :: 'OMPI_COMM_WORLD_RANK', 'PMI_RANK', 'MPI_LOCALRANKID', &
    'SLURM_PROCID']

contains

  !> What the launcher says. One program alone is one copy.
  type(copies_t) function copies_in_environment() result(copies)
    integer :: i

    copies%variable = ''
    do i = 1, size(sizes)
      if (number_in(sizes(i)) < 2) cycle
      copies = copies_t(number_in(sizes(i)), number_in(numbers(i)), trim(sizes(i)))
      return
    end do
  end function copies_in_environment

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
