!> Throws decks at the deck reader. Every case must be refused with a message, or be accepted and then, resolved and
!> read again, give the same values; each within a second.
!>
!>     fuzz_deck grammar [COUNT [SEED]]     decks made from the schema, most of them damaged
!>     fuzz_deck guided [COUNT [SEED]]      changes to decks, going on from those that reached new parts of the reader
!>     fuzz_deck replay FILE...             the cases in these files
!>
!> The first failure ends the program with status 1; its case is in fuzz-MODE.case, also after a crash. COUNT is
!> 20 000, and 500 000 if the environment has DYNSTICTION_FULL=1.
program fuzz_deck
  use, intrinsic :: iso_fortran_env, only: error_unit
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_kinds, only: wp
  use fuzz_cases, only: case_t, dice_t, new_dice, save_case, load_case, mutate, splice
  use deck_grammar, only: generate
  use deck_oracle, only: verdict_t, examine
  implicit none

  interface
    subroutine coverage_begin() bind(c)
    end subroutine coverage_begin

    integer(c_int) function coverage_news() bind(c)
      import :: c_int
    end function coverage_news

    integer(c_int) function coverage_edges() bind(c)
      import :: c_int
    end function coverage_edges

    !> The system ends the program by a signal when the time is up.
    integer(c_int) function c_alarm(seconds) bind(c, name='alarm')
      import :: c_int
      integer(c_int), value :: seconds
    end function c_alarm
  end interface

  type :: tally_t
    integer :: cases = 0, accepted = 0
    real(wp) :: slowest = 0.0_wp   !! processor time [s]
  end type tally_t

  !> Processor time that a case may take, and wall time after which it counts as hung [s].
  real(wp), parameter :: most_seconds = 1.0_wp
  integer(c_int), parameter :: hung = 60
  !> The share of sound decks below which the generator would test nothing but refusals [%].
  integer, parameter :: least_accepted = 10

  character(:), allocatable :: mode
  type(tally_t) :: tally

  mode = argument(1)
  select case (mode)
  case ('grammar')
    call run_grammar(count_or_default(2, default_count()), count_or_default(3, 1))
  case ('guided')
    call run_guided(count_or_default(2, default_count()), count_or_default(3, 1))
  case ('replay')
    call replay()
  case default
    call stop_with('which mode? fuzz_deck grammar | guided | replay')
  end select
  print '(a, ": ", i0, " cases, ", i0, " accepted, slowest ", f0.4, " s, ", i0, " edges of the reader reached")', mode, &
     tally%cases, tally%accepted, tally%slowest, coverage_edges()

contains

  subroutine run_grammar(count, seed)
    integer, intent(in) :: count, seed
    type(dice_t) :: dice
    type(case_t) :: case
    integer :: i, news
    logical :: accepted

    do i = 1, count
      dice = new_dice(seed, i)
      call generate(dice, case)
      call try(case, accepted)
      news = coverage_news()
    end do
    if (tally%accepted < least_accepted*count/100) call stop_with('too few decks were accepted for a test of accepted decks')
  end subroutine run_grammar

  !> Cases that reach something new are kept, and later ones start from them: half of the time from an accepted one.
  subroutine run_guided(count, seed)
    integer, intent(in) :: count, seed
    integer, parameter :: most_kept = 20000
    type(case_t), allocatable :: kept(:)
    integer, allocatable :: sound(:)
    type(case_t) :: case
    type(dice_t) :: dice
    integer :: i, j, n, sounds
    logical :: accepted, fresh

    allocate (kept(most_kept), sound(most_kept))
    n = 0
    sounds = 0
    do i = 1, count
      dice = new_dice(seed + 1, i)
      fresh = dice%chance(5)
      if (fresh .or. sounds == 0) then
        call generate(dice, case)
      else
        j = sound(1 + dice%below(sounds))
        if (dice%chance(50)) j = 1 + dice%below(n)
        case = kept(j)
        if (dice%chance(10)) call splice(dice, case, kept(1 + dice%below(n)))
        do j = 0, dice%below(4)
          call mutate(dice, case)
        end do
      end if
      call try(case, accepted)
      if (coverage_news() == 0 .or. n == most_kept) cycle
      n = n + 1
      kept(n) = case
      if (.not. accepted) cycle
      sounds = sounds + 1
      sound(sounds) = n
    end do
    print '(i0, " cases reached something new, ", i0, " of them accepted")', n, sounds
  end subroutine run_guided

  subroutine replay()
    type(case_t) :: case
    integer :: i
    logical :: accepted

    do i = 2, command_argument_count()
      call load_case(argument(i), case)
      call try(case, accepted)
    end do
    if (tally%cases == 0) call stop_with('no case to replay')
  end subroutine replay

  !> One case; a failure ends the program and leaves the case behind.
  subroutine try(case, accepted)
    type(case_t), intent(in) :: case
    logical, intent(out) :: accepted
    type(verdict_t) :: verdict
    real(wp) :: begin, end
    integer(c_int) :: ignored
    character(:), allocatable :: file

    file = 'fuzz-'//mode//'.case'
    call save_case(case, file)
    call coverage_begin()
    ignored = c_alarm(hung)
    call cpu_time(begin)
    call examine(case, verdict)
    call cpu_time(end)
    ignored = c_alarm(0_c_int)
    if (end - begin > most_seconds) verdict%failure = 'took too long'
    if (verdict%failure /= '') call stop_with(file//': '//trim(verdict%failure))
    tally%cases = tally%cases + 1
    tally%slowest = max(tally%slowest, end - begin)
    accepted = verdict%accepted
    if (accepted) tally%accepted = tally%accepted + 1
  end subroutine try

  integer function default_count()
    character(8) :: full
    integer :: status

    call get_environment_variable('DYNSTICTION_FULL', full, status=status)
    default_count = merge(500000, 20000, status == 0 .and. full == '1')
  end function default_count

  function argument(n) result(text)
    integer, intent(in) :: n
    character(:), allocatable :: text
    integer :: length

    call get_command_argument(n, length=length)
    allocate (character(length) :: text)
    call get_command_argument(n, text)
  end function argument

  integer function count_or_default(n, default) result(number)
    integer, intent(in) :: n, default
    character(:), allocatable :: text

    number = default
    text = argument(n)
    if (text /= '') read (text, *) number
  end function count_or_default

  subroutine stop_with(text)
    character(*), intent(in) :: text

    write (error_unit, '(a)') 'fuzz_deck: '//text
    error stop 1
  end subroutine stop_with
end program fuzz_deck
