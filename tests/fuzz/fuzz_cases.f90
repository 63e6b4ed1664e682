!> Cases of the deck fuzzer: a deck's bytes and `--set` arguments, how they are kept in files, and changes to them.
module fuzz_cases
  use dst_kinds, only: int64
  use dst_text, only: word, word_count
  use dst_schema, only: schema, key_count, group_names
  implicit none
  private

  public :: case_t, dice_t, new_dice, save_case, load_case, mutate, splice, hostile_word, setting_length, most_settings

  !> No setting is longer, and no case has more of them.
  integer, parameter :: setting_length = 400, most_settings = 2

  type :: case_t
    character(:), allocatable :: deck
    character(setting_length) :: settings(most_settings) = ''
    integer :: setting_count = 0
  end type case_t

  !> Reproducible random numbers: the minimal standard generator of Park and Miller, Comm. ACM 31 (1988) 1192, with
  !> their later multiplier 48271.
  type :: dice_t
    private
    integer(int64) :: state = 1_int64
  contains
    procedure :: below
    procedure :: chance
  end type dice_t

  integer(int64), parameter :: modulus = 2147483647_int64, multiplier = 48271_int64

  character, parameter :: nul = achar(0), newline = achar(10)
  !> What parts the deck from the settings in a file.
  character(*), parameter :: divider = newline//nul//'--set'//nul
  !> A deck is not let grow beyond this; longer ones have a test of their own.
  integer, parameter :: most_bytes = 20000

contains

  !> Random numbers that depend on the seed and on which case they are for.
  type(dice_t) function new_dice(seed, number) result(dice)
    integer, intent(in) :: seed, number
    integer :: i, ignored

    dice%state = 1_int64 + mod(1000003_int64*seed + 7919_int64*number, modulus - 1_int64)
    do i = 1, 4
      ignored = dice%below(2)
    end do
  end function new_dice

  !> A number from 0 to n - 1.
  integer function below(self, n)
    class(dice_t), intent(inout) :: self
    integer, intent(in) :: n

    self%state = mod(multiplier*self%state, modulus)
    below = int(mod(self%state/8_int64, int(n, int64)))
  end function below

  !> True in `percent` of the calls.
  logical function chance(self, percent)
    class(dice_t), intent(inout) :: self
    integer, intent(in) :: percent

    chance = self%below(100) < percent
  end function chance

  !> The deck, and after a divider every setting, ended by NUL.
  subroutine save_case(case, file)
    type(case_t), intent(in) :: case
    character(*), intent(in) :: file
    integer :: unit, i

    open (newunit=unit, file=file, access='stream', form='unformatted', status='replace', action='write')
    write (unit) case%deck
    if (case%setting_count > 0) write (unit) divider
    do i = 1, case%setting_count
      write (unit) trim(case%settings(i))//nul
    end do
    close (unit)
  end subroutine save_case

  subroutine load_case(file, case)
    character(*), intent(in) :: file
    type(case_t), intent(out) :: case
    character(:), allocatable :: bytes
    integer :: unit, size, first, width

    open (newunit=unit, file=file, access='stream', form='unformatted', status='old', action='read')
    inquire (unit=unit, size=size)
    allocate (character(size) :: bytes)
    read (unit) bytes
    close (unit)
    first = index(bytes, divider)
    if (first == 0) then
      case%deck = bytes
      return
    end if
    case%deck = bytes(:first - 1)
    first = first + len(divider)
    do while (first <= size .and. case%setting_count < most_settings)
      width = index(bytes(first:)//nul, nul) - 1
      case%setting_count = case%setting_count + 1
      case%settings(case%setting_count) = bytes(first:first + width - 1)
      first = first + width + 1
    end do
  end subroutine load_case

  !> Change the deck in one place, or a setting if there is one.
  subroutine mutate(dice, case)
    type(dice_t), intent(inout) :: dice
    type(case_t), intent(inout) :: case
    integer :: i
    logical :: in_setting

    in_setting = dice%chance(40)
    if (in_setting .and. case%setting_count > 0) then
      i = 1 + dice%below(case%setting_count)
      case%settings(i) = mutated(dice, trim(case%settings(i)))
      ! The system ends an argument at a NUL.
      if (index(case%settings(i), nul) > 0) case%settings(i) = case%settings(i) (:index(case%settings(i), nul) - 1)
    else
      case%deck = mutated(dice, case%deck)
      if (len(case%deck) > most_bytes) case%deck = case%deck(:most_bytes)
    end if
  end subroutine mutate

  !> The beginning of one deck and the end of another.
  subroutine splice(dice, case, other)
    type(dice_t), intent(inout) :: dice
    type(case_t), intent(inout) :: case
    type(case_t), intent(in) :: other

    case%deck = case%deck(:dice%below(len(case%deck) + 1))//other%deck(1 + dice%below(len(other%deck) + 1):)
    if (len(case%deck) > most_bytes) case%deck = case%deck(:most_bytes)
  end subroutine splice

  !> One change: of a byte, of a stretch of bytes, or by a word that readers stumble over.
  function mutated(dice, text) result(changed)
    type(dice_t), intent(inout) :: dice
    character(*), intent(in) :: text
    character(:), allocatable :: changed
    integer :: first, last, to

    first = 1 + dice%below(len(text) + 1)
    last = min(len(text), first + dice%below(1 + dice%below(40)))
    to = 1 + dice%below(len(text) + 1)
    select case (dice%below(10))
    case (0)
      changed = text(:first - 1)//char(dice%below(256))//text(min(first + 1, len(text) + 1):)
    case (1)
      changed = text(:first - 1)//char(dice%below(256))//text(first:)
    case (2)
      changed = text(:first - 1)//text(last + 1:)
    case (3)
      changed = text(:to - 1)//text(first:last)//text(to:)
    case (4)
      changed = text(:first - 1)//repeat(text(first:last), 1 + dice%below(100))//text(first:)
    case (5)
      changed = text(:first - 1)
    case (6)
      changed = with_returns(text)
    case (7)
      changed = text(:first - 1)//name_of_schema(dice)//text(last + 1:)
    case default
      changed = text(:first - 1)//hostile_word(dice)//text(merge(first, last + 1, dice%chance(50)):)
    end select
  end function mutated

  !> Line ends of another system.
  function with_returns(text) result(changed)
    character(*), intent(in) :: text
    character(:), allocatable :: changed
    integer :: i, n

    allocate (character(2*len(text)) :: changed)
    n = 0
    do i = 1, len(text)
      if (text(i:i) == newline) then
        n = n + 1
        changed(n:n) = achar(13)
      end if
      n = n + 1
      changed(n:n) = text(i:i)
    end do
    changed = changed(:n)
  end function with_returns

  function name_of_schema(dice) result(text)
    type(dice_t), intent(inout) :: dice
    character(:), allocatable :: text

    select case (dice%below(3))
    case (0)
      text = '&'//word(group_names, 1 + dice%below(word_count(group_names)))//newline
    case (1)
      text = trim(schema(1 + dice%below(key_count))%name)//' = '
    case default
      text = schema(1 + dice%below(key_count))%choices
      text = "'"//word(text, 1 + dice%below(max(1, word_count(text))))//"'"
    end select
  end function name_of_schema

  !> What readers of decks stumble over.
  function hostile_word(dice) result(text)
    type(dice_t), intent(inout) :: dice
    character(:), allocatable :: text
    character(*), parameter :: words = '1e400 -1e400 1e-400 9.9e307 1.7976931348623157e308 4.9e-324 2.2250738585072014e-308 '// &
      'NaN inf '// &
      '-Infinity 0x1F z''1f'' 1_8 .5 5. +.5d-3 1d+308 -0.0 1e+ . - + e 1,,2 3*1 0*1 -1*2 '// &
      '1000000000*1 10000*0.0 10001*0.0 99999999999999999999*2 1e0000000000000000001 '// &
      '''it''''s'' ''a "b" c'' "x''y" '''' "" ''/'' ''!'' ''&end'' &end & / ! !'' = ( ) % '// &
      '$scene * , ; .true. (1,2) mass(1)=2 a%b=3 &scene &sweep &SCENE T_END default auto '// &
      '9223372036854775807 9223372036854775808'

    select case (dice%below(14))
    case (0)
      text = nul
    case (1)
      text = char(239)//char(187)//char(191)
    case (2)
      text = char(195)//char(182)//char(226)//char(130)//char(172)//char(240)//char(159)//char(152)//char(128)
    case (3)
      text = char(128 + dice%below(128))//char(128 + dice%below(128))
    case (4)
      text = achar(127)//achar(27)//'[31m'
    case (5)
      text = achar(9)//achar(13)//newline
    case (6)
      text = repeat('x', dice%below(600))
    case (7)
      text = repeat(' ', dice%below(3000))
    case (8)
      text = repeat(newline, dice%below(100))
    case default
      text = word(words, 1 + dice%below(word_count(words)))//' '
    end select
  end function hostile_word
end module fuzz_cases
