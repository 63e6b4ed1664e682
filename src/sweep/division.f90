!> How the cases of a sweep are divided among processes that do not communicate, and what the environment says about them.
!>
!> Of each N cases in a row every share has one, so that shares differ by at most one case, and neighbours, which mostly cost the
!> same, are spread. The shares are rotated from row to row by the golden ratio, so that no grid is in step with N: the expensive
!> column of a grid comes to all shares in turn (D. E. Knuth, The Art of Computer Programming 3, section 6.4, theorem S).
module dst_division
  use dst_errors, only: error_t, raise, usage_error
  use dst_kinds, only: int64
  use dst_machine, only: environment
  use dst_text, only: excerpt, integer_text, read_integer
  implicit none
  private

  public :: division_t, share_wish_t, take_share_wish, settle_division, processes_here

  !> One process's part of a sweep. `shares` = 0: the cases are distributed by rank 0, not divided.
  type :: division_t
    integer :: share = 0, shares = 0           !! I of N
    integer :: first = 0, last = 0, step = 0   !! indices of the job array that began the division; step 0: none
    integer :: inner = 1                       !! number of processes in each task of the array
  contains
    procedure :: is_possible
    procedure :: share_of
    procedure :: has
    procedure :: size => share_size
    procedure :: text => share_text
  end type division_t

  !> What --shard asks for: I/N, or I of the N of the existing shards, or the values of the environment.
  type :: share_wish_t
    logical :: is_given = .false.
    logical :: is_auto = .false.
    logical :: redivide = .false.              !! --redivide is given
    integer :: share = 0, shares = 0           !! shares = 0: as in the existing shards
  end type share_wish_t

  !> The job array to which this process belongs.
  type :: array_t
    logical :: is_there = .false.
    integer :: index = 0, first = 0, last = 0, step = 1, count = 0
  end type array_t

  integer, parameter :: most_shares = 999999
  character(*), parameter :: usage = 'write --shard I/N with 1 <= I <= N, like --shard 3/16'

  !> Variables of Open MPI, of MPICH and related libraries, and of Slurm: the number of processes, and the number of this one,
  !> counted from 0.
  character(20), parameter :: sizes(3) = [character(20) :: 'OMPI_COMM_WORLD_SIZE', 'PMI_SIZE', 'SLURM_STEP_NUM_TASKS']
  character(20), parameter :: numbers(3) = [character(20) :: 'OMPI_COMM_WORLD_RANK', 'PMI_RANK', 'SLURM_PROCID']

contains

  !> Whether this program could have made the division.
  pure logical function is_possible(self)
    class(division_t), intent(in) :: self

    is_possible = min(self%share, self%shares) == 0 .and. max(self%share, self%shares) == 0
    if (.not. is_possible) is_possible = self%share >= 1 .and. self%share <= self%shares .and. self%shares <= most_shares
    if (self%step > 0 .and. is_possible) is_possible = self%first <= self%last .and. &
      self%shares == (int(self%last - self%first, int64)/self%step + 1)*self%inner
  end function is_possible

  !> The share that has a case.
  pure integer function share_of(self, case)
    class(division_t), intent(in) :: self
    integer, intent(in) :: case

    share_of = modulo(case - 1 + turn(self%shares, (case - 1)/self%shares), self%shares) + 1
  end function share_of

  !> Whether a case belongs to this share; all cases do if nothing is divided.
  pure logical function has(self, case)
    class(division_t), intent(in) :: self
    integer, intent(in) :: case

    has = .true.
    if (self%shares > 0) has = self%share_of(case) == self%share
  end function has

  !> Number of cases of this share.
  pure integer function share_size(self, cases)
    class(division_t), intent(in) :: self
    integer, intent(in) :: cases
    integer :: rows

    share_size = cases
    if (self%shares == 0) return
    rows = cases/self%shares
    share_size = rows
    if (modulo(self%share - 1 - turn(self%shares, rows), self%shares) < modulo(cases, self%shares)) share_size = rows + 1
  end function share_size

  !> 'I/N'
  function share_text(self) result(text)
    class(division_t), intent(in) :: self
    character(:), allocatable :: text

    text = integer_text(self%share)//'/'//integer_text(self%shares)
  end function share_text

  !> By how many places the shares are rotated in a row of cases, counted from 0: the fraction of row times golden ratio.
  pure integer function turn(shares, row)
    integer, intent(in) :: shares, row
    integer(int64), parameter :: whole = 2_int64**32, golden = 2654435769_int64   ! of `whole`

    turn = int(modulo(row*golden, whole)*shares/whole)
  end function turn

  !> Parse the value of --shard; whether there is such a share is checked after the shards have been read.
  subroutine take_share_wish(value, wish, error)
    character(*), intent(in) :: value
    type(share_wish_t), intent(inout) :: wish
    type(error_t), allocatable, intent(out) :: error
    integer :: slash
    logical :: is_understood

    wish%is_given = .true.
    wish%is_auto = value == 'auto'
    if (wish%is_auto) return
    slash = index(value//'/', '/')
    wish%share = number_in(value(:slash - 1))
    is_understood = wish%share >= 0 .and. wish%share <= most_shares
    if (slash <= len(value)) then
      wish%shares = number_in(value(slash + 1:))
      is_understood = is_understood .and. wish%shares >= 0 .and. wish%shares <= most_shares
      ! N = 0 is no share of any division, and does not mean the existing one.
      if (wish%shares == 0) wish%shares = -1
    end if
    if (.not. is_understood) call raise(error, usage_error, "--shard '"//excerpt(value)//"': "//usage//', or --shard auto')
  end subroutine take_share_wish

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

  !> The share of this process. `kept`: the divisions of the existing shards, the newest last.
  subroutine settle_division(wish, kept, division, error)
    type(share_wish_t), intent(in) :: wish
    type(division_t), intent(in) :: kept(:)
    type(division_t), intent(out) :: division
    type(error_t), allocatable, intent(out) :: error
    type(division_t) :: last
    integer :: i

    if (.not. wish%is_given) return
    ! A new division does not depend on the existing one.
    do i = 1, merge(0, size(kept), wish%redivide)
      ! A share that was given explicitly does not depend on an array.
      if (kept(i)%step > 0 .or. kept(i)%shares /= last%shares) last = kept(i)
    end do
    if (wish%is_auto) then
      call divide_by_environment(kept, last, division, error)
    else
      call divide_as_told(wish, kept, last, division, error)
    end if
  end subroutine settle_division

  subroutine divide_as_told(wish, kept, last, division, error)
    type(share_wish_t), intent(in) :: wish
    type(division_t), intent(in) :: kept(:), last
    type(division_t), intent(out) :: division
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: given, right, shares

    division%share = wish%share
    division%shares = merge(last%shares, wish%shares, wish%shares == 0)
    given = '--shard '//integer_text(wish%share)
    if (wish%shares /= 0) given = given//'/'//integer_text(max(0, wish%shares))
    shares = integer_text(last%shares)
    if (division%shares == 0) then
      call raise(error, usage_error, given//': the number of shards is not known yet: write --shard I/N, like --shard 3/16')
    else if (last%shares > 0 .and. .not. any(kept%shares == division%shares)) then
      right = 'I/'//shares//' with 1 <= I <= '//shares
      if (wish%share >= 1 .and. wish%share <= last%shares) right = integer_text(wish%share)//'/'//shares
      call raise(error, usage_error, given//': '//kept_text(last)//': write --shard '//right// &
        ', or divide it again with --redivide')
    else if (division%share < 1 .or. division%share > division%shares) then
      right = '1 <= I <= N, like --shard 3/16'
      if (last%shares > 0) right = '1 <= I <= '//integer_text(division%shares)
      call raise(error, usage_error, given//': there is no such shard: write --shard I/N with '//right)
    end if
  end subroutine divide_as_told

  function kept_text(kept) result(text)
    type(division_t), intent(in) :: kept
    character(:), allocatable :: text

    text = 'this sweep is divided by '//integer_text(kept%shares)
    if (kept%step == 0) return
    text = text//' ('//range_text(kept%first, kept%last, kept%step)
    if (kept%inner > 1) text = text//' with '//integer_text(kept%inner)//' processes a task'
    text = text//')'
  end function kept_text

  !> The index of an array, or the number of a process, or both: a task of an array may have several processes.
  subroutine divide_by_environment(kept, last, division, error)
    type(division_t), intent(in) :: kept(:), last
    type(division_t), intent(out) :: division
    type(error_t), allocatable, intent(out) :: error
    type(array_t) :: array
    character(:), allocatable :: variable
    integer :: count, number

    call read_array(array, error)
    if (allocated(error)) return
    call processes_here(count, number, variable)
    if (number < 0) then
      call raise(error, usage_error, '--shard auto: '//variable//' gives '//integer_text(count)//' processes, but nothing '// &
        'says which one this is: write --shard I/N')
    else if (array%is_there .and. last%step > 0) then
      call continue_array(array, max(1, count), last, division, error)
    else if (array%is_there) then
      call begin_array(array, max(1, count), last, division, error)
    else if (count > 0) then
      division%shares = count
    else
      call raise(error, usage_error, '--shard auto: there is no job array, and no launcher has started several processes: '// &
        'write --shard I/N')
    end if
    if (allocated(error)) return
    division%share = division%share + number + 1
    if (division%shares > most_shares) then
      call raise(error, usage_error, '--shard auto: more than '//integer_text(most_shares)//' shares: start fewer processes')
    else if (last%shares > 0 .and. .not. any(kept%shares == division%shares)) then
      call raise(error, usage_error, '--shard auto is --shard '//division%text()//' here, but '//kept_text(last)// &
        ': write --shard I/'//integer_text(last%shares)//', start as many tasks, or divide it again with --redivide')
    end if
  end subroutine divide_by_environment

  !> A part of the array that began the division, or all of it again. `share`: without the number of the process in the task.
  subroutine continue_array(array, processes, kept, division, error)
    type(array_t), intent(in) :: array
    integer, intent(in) :: processes
    type(division_t), intent(in) :: kept
    type(division_t), intent(inout) :: division
    type(error_t), allocatable, intent(out) :: error

    division = kept
    division%share = (array%index - kept%first)/kept%step*kept%inner
    if (processes /= kept%inner) then
      call raise(error, usage_error, '--shard auto: '//kept_text(kept)//', here a task has '//integer_text(processes)// &
        ': start '//integer_text(kept%inner)//' in each, or divide it again with --redivide')
    else if (array%first < kept%first .or. array%last > kept%last .or. modulo(array%index - kept%first, kept%step) /= 0) then
      call raise(error, usage_error, '--shard auto: index '//integer_text(array%index)//' of '// &
        range_text(array%first, array%last, 1)//' is not of the array that began, '//kept_text(kept)// &
        ': start indices of that, or divide it again with --redivide')
    end if
  end subroutine continue_array

  !> The array begins the division as it is, or is one with as many shares. `share`: without the number of the process in the task.
  subroutine begin_array(array, processes, kept, division, error)
    type(array_t), intent(in) :: array
    integer, intent(in) :: processes
    type(division_t), intent(in) :: kept
    type(division_t), intent(inout) :: division
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: remedy

    if ((array%last - array%first)/array%step + 1 == array%count .and. modulo(array%index - array%first, array%step) == 0) then
      division%share = (array%index - array%first)/array%step*processes
      division%shares = int(min(most_shares + 1_int64, int(array%count, int64)*processes))
      division%first = array%first
      division%last = array%last
      division%step = array%step
      division%inner = processes
    else
      remedy = 'start the whole array first, like '//range_text(array%first, array%last, 1)
      if (kept%shares > 0) remedy = kept_text(kept)//': write --shard I/'//integer_text(kept%shares)
      call raise(error, usage_error, '--shard auto: the array of '//integer_text(array%count)//' tasks from '// &
        integer_text(array%first)//' to '//integer_text(array%last)//' has gaps: '//remedy)
    end if
  end subroutine begin_array

  !> '--array=1-7:2'
  function range_text(first, last, step) result(text)
    integer, intent(in) :: first, last, step
    character(:), allocatable :: text

    text = '--array='//integer_text(first)
    if (last > first) text = text//'-'//integer_text(last)
    if (step > 1) text = text//':'//integer_text(step)
  end function range_text

  !> Slurm's description of a job array.
  subroutine read_array(array, error)
    type(array_t), intent(out) :: array
    type(error_t), allocatable, intent(out) :: error

    array%index = number_in(environment('SLURM_ARRAY_TASK_ID'))
    array%first = number_in(environment('SLURM_ARRAY_TASK_MIN'))
    array%last = number_in(environment('SLURM_ARRAY_TASK_MAX'))
    array%step = max(1, number_in(environment('SLURM_ARRAY_TASK_STEP')))
    array%count = number_in(environment('SLURM_ARRAY_TASK_COUNT'))
    array%is_there = array%index >= 0
    if (.not. array%is_there) return
    if (array%first < 0 .or. array%first > array%index .or. array%last < array%index .or. array%count < 1) &
      call raise(error, usage_error, '--shard auto: SLURM_ARRAY_TASK_ID is not between SLURM_ARRAY_TASK_MIN and _MAX, '// &
                 'or there is no SLURM_ARRAY_TASK_COUNT: write --shard I/N')
  end subroutine read_array

  !> The processes that a launcher started together: their number, the number of this one, counted from 0 (-1: not known), and the
  !> variable with these numbers; none: 0.
  subroutine processes_here(count, number, variable)
    integer, intent(out) :: count, number
    character(:), allocatable, intent(out) :: variable
    integer :: i

    do i = 1, size(sizes)
      variable = trim(sizes(i))
      count = number_in(environment(trim(sizes(i))))
      number = number_in(environment(trim(numbers(i))))
      if (number >= count) number = -1
      if (count > 0) return
    end do
    count = 0
    number = 0
    variable = ''
  end subroutine processes_here
end module dst_division
