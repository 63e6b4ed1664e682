!> Throws decks at the deck reader. Every case must be refused with a message, or be accepted and then, resolved and
!> read again, give the same values; each within a second.
!>
!>     fuzz_deck COUNT SEED FILE...
!>
!> tries the files, and then COUNT random changes of those that are sound. The first failure ends the program with status 1; its
!> case is in fuzz.case, also after a crash. COUNT is multiplied by 25 if the environment has DYNSTICTION_FULL=1.
program fuzz_deck
  use, intrinsic :: iso_fortran_env, only: error_unit
  use, intrinsic :: iso_c_binding, only: c_int
  use deck_oracle, only: verdict_t, examine
  use dst_kinds, only: wp
  use fuzz_cases, only: case_t, save_case, load_case, mutate, splice, add_setting, below, chance
  use random_numbers, only: start_random
  implicit none

  interface
    !> The system ends the program by a signal when the time is up.
    integer(c_int) function c_alarm(seconds) bind(c, name='alarm')
      import :: c_int
      integer(c_int), value :: seconds
    end function c_alarm
  end interface

  !> Processor time that a case may take, and wall time after which it counts as hung [s].
  real(wp), parameter :: most_seconds = 1.0_wp
  integer(c_int), parameter :: hung = 60
  !> The share of sound decks below which nothing but refusals would be tested [%].
  integer, parameter :: least_accepted = 10

  type(case_t), allocatable :: file(:)
  type(case_t) :: case
  real(wp) :: slowest = 0.0_wp
  integer :: accepted = 0, count, i, j
  integer, allocatable :: sound(:)

  count = number(1)*merge(25, 1, is_full())
  call start_random(number(2))
  allocate (file(command_argument_count() - 2))
  sound = [integer ::]
  do i = 1, size(file)
    call load_case(argument(i + 2), file(i))
    call try(file(i))
    if (accepted > size(sound)) sound = [sound, i]
  end do
  accepted = 0
  do i = 1, count
    ! Not in one expression: gfortran asks for the place twice, for the length and for the bytes.
    j = sound(1 + below(size(sound)))
    case = file(j)
    if (chance(10)) call splice(case, file(1 + below(size(file))))
    if (chance(30)) call add_setting(case)
    if (.not. chance(30)) then
      do j = 0, below(3)
        call mutate(case)
      end do
    end if
    call try(case)
  end do
  if (100*accepted < least_accepted*count) call stop_with('too few decks were accepted for a test of accepted decks')
  print '(i0, " files and ", i0, " changes, ", i0, " accepted, slowest ", f0.4, " s")', &
    size(file), count, accepted, slowest

contains

  !> One case; a failure ends the program and leaves the case behind.
  subroutine try(case)
    type(case_t), intent(in) :: case
    type(verdict_t) :: verdict
    real(wp) :: begin, end
    integer(c_int) :: ignored

    call save_case(case, 'fuzz.case')
    ignored = c_alarm(hung)
    call cpu_time(begin)
    call examine(case, verdict)
    call cpu_time(end)
    ignored = c_alarm(0_c_int)
    slowest = max(slowest, end - begin)
    if (end - begin > most_seconds) verdict%failure = 'took too long'
    if (verdict%failure /= '') call stop_with('fuzz.case: '//trim(verdict%failure))
    if (verdict%accepted) accepted = accepted + 1
  end subroutine try

  logical function is_full()
    character(8) :: full
    integer :: status

    call get_environment_variable('DYNSTICTION_FULL', full, status=status)
    is_full = status == 0 .and. full == '1'
  end function is_full

  function argument(n) result(text)
    integer, intent(in) :: n
    character(:), allocatable :: text
    integer :: length

    call get_command_argument(n, length=length)
    allocate (character(length) :: text)
    call get_command_argument(n, text)
  end function argument

  integer function number(n)
    integer, intent(in) :: n
    character(:), allocatable :: text

    text = argument(n)
    read (text, *) number
  end function number

  subroutine stop_with(text)
    character(*), intent(in) :: text

    write (error_unit, '(a)') 'fuzz_deck: '//text
    error stop 1
  end subroutine stop_with
end program fuzz_deck
