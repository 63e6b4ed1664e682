!> The machine that this process runs on, the job of a scheduler that it is of, and its environment. POSIX.
module dst_machine
  use, intrinsic :: iso_c_binding, only: c_int, c_size_t, c_char, c_null_char
  implicit none
  private

  public :: host_name, job_name, environment

  interface
    integer(c_int) function c_gethostname(name, length) bind(c, name='gethostname')
      import :: c_int, c_char, c_size_t
      character(c_char), intent(out) :: name(*)
      integer(c_size_t), value :: length
    end function c_gethostname
  end interface

contains

  !> The name of the machine; '' if it has none.
  function host_name() result(name)
    character(:), allocatable :: name
    character(c_char) :: bytes(256)
    integer :: i

    name = ''
    if (c_gethostname(bytes, size(bytes, kind=c_size_t)) /= 0) return
    do i = 1, size(bytes)
      if (bytes(i) == c_null_char) exit
      name = name//bytes(i)
    end do
  end function host_name

  !> What the scheduler calls the job: of Slurm '1234', or '1234_5' of an array; of PBS and LSF their names; '' without a scheduler.
  function job_name() result(name)
    character(:), allocatable :: name

    name = environment('SLURM_ARRAY_JOB_ID')
    if (name /= '') name = name//'_'//environment('SLURM_ARRAY_TASK_ID')
    if (name == '') name = environment('SLURM_JOB_ID')
    if (name == '') name = environment('PBS_JOBID')
    if (name == '') name = environment('LSB_JOBID')
  end function job_name

  !> A variable of the environment, '' if there is none.
  function environment(name) result(value)
    character(*), intent(in) :: name
    character(:), allocatable :: value
    integer :: length

    call get_environment_variable(name, length=length)
    allocate (character(length) :: value)
    if (length > 0) call get_environment_variable(name, value)
  end function environment
end module dst_machine
