!> The machine on which this process runs: its name and clock; the scheduler's job to which the process belongs, and its
!> environment.
module dst_machine
  use, intrinsic :: iso_c_binding, only: c_size_t, nul => c_null_char
  use dst_posix, only: c_gethostname, c_utc
  implicit none
  private

  public :: host_name, job_name, environment, utc_now

contains

  !> The name of the machine; '' if it has none.
  function host_name() result(name)
    character(:), allocatable :: name
    character(256) :: text

    name = ''
    if (c_gethostname(text, len(text, c_size_t)) == 0) name = text(:index(text//nul, nul) - 1)
  end function host_name

  !> The scheduler's name of the job: with Slurm '1234', or '1234_5' of an array; with PBS and LSF their names; '' without a
  !> scheduler.
  function job_name() result(name)
    character(:), allocatable :: name

    name = environment('SLURM_ARRAY_JOB_ID')
    if (name /= '') name = name//'_'//environment('SLURM_ARRAY_TASK_ID')
    if (name == '') name = environment('SLURM_JOB_ID')
    if (name == '') name = environment('PBS_JOBID')
    if (name == '') name = environment('LSB_JOBID')
  end function job_name

  !> An environment variable; '' if it is not set.
  function environment(name) result(value)
    character(*), intent(in) :: name
    character(:), allocatable :: value
    integer :: length

    call get_environment_variable(name, length=length)
    allocate (character(length) :: value)
    if (length > 0) call get_environment_variable(name, value)
  end function environment

  !> Now, as ISO 8601 in UTC: '2026-01-31T23:59:59Z'.
  character(20) function utc_now()
    character(21) :: text

    call c_utc(text)
    utc_now = text(:20)
  end function utc_now

end module dst_machine
