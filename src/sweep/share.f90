!> A share I/N of a sweep: the cases I, I+N, I+2N, ... Shares are run by processes that know nothing of each other, each into its
!> own file; neighbours, which mostly cost the same, are in different shares.
!>
!> `--share auto` takes I and N from what a launcher or a job array has put into the environment of this process.
module dst_share
  use dst_errors, only: error_t, raise, usage_error
  use dst_kinds, only: int64
  use dst_machine, only: environment
  use dst_disk, only: path_t, matching_files, stem_of
  use dst_text, only: excerpt, integer_text, read_integer
  implicit none
  private

  public :: share_t, take_share, shares_of, launched_together

  !> Part `number` of `count` of a sweep; 1 of 1 is all of it. A case has a row in the share, and both are counted from 1.
  type :: share_t
    integer :: number = 1, count = 1
  contains
    procedure :: size => share_size
    procedure :: case_of
    procedure :: row_of
    procedure :: text => share_text
    procedure :: file_name
  end type share_t

  integer, parameter :: most_shares = 999999
  character(*), parameter :: remedy = ': write --share I/N with 1 <= I <= N, like --share 3/16'
  character(*), parameter :: between = '-of-'

  !> Variables of Open MPI, of MPICH and related libraries, and of a step of Slurm: the number of processes, and the number of this
  !> one, counted from 0. A batch script of Slurm is no step: its program is started once.
  character(20), parameter :: sizes(3) = [character(20) :: 'OMPI_COMM_WORLD_SIZE', 'PMI_SIZE', 'SLURM_STEP_NUM_TASKS']
  character(20), parameter :: ranks(3) = [character(20) :: 'OMPI_COMM_WORLD_RANK', 'PMI_RANK', 'SLURM_PROCID']
  !> The job arrays of Slurm and of Grid Engine: index, first, last, step, and number of tasks, which Grid Engine does not tell.
  character(22), parameter :: arrays(5, 2) = reshape([character(22) :: &
    'SLURM_ARRAY_TASK_ID', 'SLURM_ARRAY_TASK_MIN', 'SLURM_ARRAY_TASK_MAX', 'SLURM_ARRAY_TASK_STEP', 'SLURM_ARRAY_TASK_COUNT', &
    'SGE_TASK_ID', 'SGE_TASK_FIRST', 'SGE_TASK_LAST', 'SGE_TASK_STEPSIZE', ''], [5, 2])

contains

  !> Number of cases of this share, of a sweep with so many.
  pure integer function share_size(self, cases)
    class(share_t), intent(in) :: self
    integer, intent(in) :: cases

    share_size = max(0, (cases - self%number)/self%count + 1)
    if (cases < self%number) share_size = 0
  end function share_size

  !> The case in a row.
  elemental integer function case_of(self, row)
    class(share_t), intent(in) :: self
    integer, intent(in) :: row

    case_of = self%number + (row - 1)*self%count
  end function case_of

  !> The row of a case of this share.
  elemental integer function row_of(self, case)
    class(share_t), intent(in) :: self
    integer, intent(in) :: case

    row_of = (case - self%number)/self%count + 1
  end function row_of

  !> 'I/N'
  pure function share_text(self) result(text)
    class(share_t), intent(in) :: self
    character(:), allocatable :: text

    text = integer_text(self%number)//'/'//integer_text(self%count)
  end function share_text

  !> 'phi.3-of-16.h5' for the share 3/16 of the sweep whose result is 'phi.h5', and that name itself for all of it.
  pure function file_name(self, result_file) result(name)
    class(share_t), intent(in) :: self
    character(*), intent(in) :: result_file
    character(:), allocatable :: name

    name = result_file
    if (self%count > 1) name = result_file(:stem_of(result_file))//'.'//integer_text(self%number)//between// &
      integer_text(self%count)//result_file(stem_of(result_file) + 1:)
  end function file_name

  !> The share that has the file `name` of a sweep with the result `result_file`; 1/1 if the name is no share's.
  pure type(share_t) function share_in_name(name, result_file) result(share)
    character(*), intent(in) :: name, result_file
    integer :: first, middle, last

    first = stem_of(result_file) + 2
    last = len(name) - (len(result_file) - stem_of(result_file))
    middle = index(name(:max(0, last)), between, back=.true.)
    if (middle <= first .or. middle > last) return
    share = share_t(number_in(name(first:middle - 1)), number_in(name(middle + len(between):last)))
    if (.not. is_possible(share)) share = share_t()
    if (share%file_name(result_file) /= name) share = share_t()
  end function share_in_name

  !> The files of shares of a sweep, and their shares.
  subroutine shares_of(result_file, shares, files)
    character(*), intent(in) :: result_file
    type(share_t), allocatable, intent(out) :: shares(:)
    type(path_t), allocatable, intent(out) :: files(:)
    integer :: i

    call matching_files(result_file(:stem_of(result_file))//'.', files)
    allocate (shares, source=[(share_in_name(files(i)%text, result_file), i=1, size(files))])
    files = pack(files, shares%count > 1)
    shares = pack(shares, shares%count > 1)
  end subroutine shares_of

  pure logical function is_possible(share)
    type(share_t), intent(in) :: share

    is_possible = share%number >= 1 .and. share%number <= share%count .and. share%count <= most_shares
  end function is_possible

  !> Parse the value of --share: I/N or auto.
  subroutine take_share(value, share, error)
    character(*), intent(in) :: value
    type(share_t), intent(out) :: share
    type(error_t), allocatable, intent(out) :: error
    integer :: slash

    if (value == 'auto') then
      call take_from_environment(share, error)
      return
    end if
    slash = index(value, '/')
    share = share_t(number_in(value(:slash - 1)), number_in(value(slash + 1:)))
    if (slash > 0 .and. is_possible(share)) return
    call raise(error, usage_error, "--share '"//excerpt(value)//"'"//remedy//', or --share auto')
  end subroutine take_share

  !> Digits as a number; -1 if there are none, or other characters, or too many.
  pure integer function number_in(text)
    character(*), intent(in) :: text
    character(:), allocatable :: problem
    integer(int64) :: number

    number_in = -1
    if (verify(text, '0123456789') > 0) return
    call read_integer(text, number, problem)
    if (problem == '' .and. number <= huge(number_in)) number_in = int(number)
  end function number_in

  !> The index of a job array, or the number of a process, or both: a task of an array may have several processes.
  subroutine take_from_environment(share, error)
    type(share_t), intent(out) :: share
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: variable
    integer :: processes, rank, tasks, task
    integer(int64) :: shares

    call read_array(task, tasks, error)
    if (allocated(error)) return
    call launched_together(processes, rank, variable)
    shares = int(max(1, tasks), int64)*max(1, processes)
    if (tasks == 0 .and. processes == 0) then
      call raise(error, usage_error, '--share auto: no launcher or job array tells the number of processes'//remedy)
    else if (rank < 0) then
      call raise(error, usage_error, '--share auto: '//variable//' tells of '//integer_text(processes)// &
        ' processes, but nothing tells which one this is'//remedy)
    else if (shares > most_shares) then
      call raise(error, usage_error, '--share auto: more than '//integer_text(most_shares)//' shares: start fewer processes')
    else
      share = share_t(task*max(1, processes) + rank + 1, int(shares))
    end if
  end subroutine take_from_environment

  !> The place of this task in its job array, counted from 0, and the number of tasks; 0 if there is no array.
  subroutine read_array(task, tasks, error)
    integer, intent(out) :: task, tasks
    type(error_t), allocatable, intent(out) :: error
    integer :: numbers(size(arrays, 1)), i, k

    task = 0
    tasks = 0
    numbers = -1
    do k = 1, size(arrays, 2)
      do i = 1, size(numbers)
        if (arrays(i, k) /= '') numbers(i) = number_in(environment(trim(arrays(i, k))))
      end do
      associate (number => numbers(1), first => numbers(2), last => numbers(3), step => max(1, numbers(4)))
        ! Grid Engine says 'undefined' outside of an array.
        if (number < 0) cycle
        tasks = (last - first)/step + 1
        task = (number - first)/step
        ! The indices of a part of an array do not say what the whole one was.
        if (first < 0 .or. number < first .or. number > last .or. modulo(number - first, step) /= 0 .or. &
            (numbers(5) >= 0 .and. numbers(5) /= tasks)) call raise(error, usage_error, '--share auto: '//trim(arrays(1, k))// &
          ' is of an array with gaps, or one whose first and last index are not known'//remedy)
      end associate
      return
    end do
  end subroutine read_array

  !> The processes that a launcher started together: their number, the number of this one, counted from 0 (-1: not known), and the
  !> variable that tells it; none: 0.
  subroutine launched_together(count, rank, variable)
    integer, intent(out) :: count, rank
    character(:), allocatable, intent(out) :: variable
    integer :: i

    do i = 1, size(sizes)
      variable = trim(sizes(i))
      count = number_in(environment(variable))
      if (count <= 0) cycle
      rank = number_in(environment(trim(ranks(i))))
      if (rank < 0) rank = number_in(environment('PMIX_RANK'))
      if (rank >= count) rank = -1
      return
    end do
    count = 0
    rank = 0
    variable = ''
  end subroutine launched_together
end module dst_share
