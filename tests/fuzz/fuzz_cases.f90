!> Cases of the deck fuzzer: a deck's bytes and `--set` arguments, how they are kept in files, and changes to them.
module fuzz_cases
  use dst_kinds, only: wp
  use dst_text, only: word, word_count, real_text
  use dst_schema, only: schema, key_count, group_names
  use random_numbers, only: uniform
  implicit none
  private

  public :: case_t, save_case, load_case, mutate, splice, add_setting, below, chance

  !> No setting is longer, and no case has more of them.
  integer, parameter :: setting_length = 400, most_settings = 2

  type :: case_t
    character(:), allocatable :: deck
    character(setting_length) :: settings(most_settings) = ''
    integer :: setting_count = 0
  end type case_t

  character, parameter :: nul = achar(0), newline = achar(10)
  !> What parts the deck from the settings in a file.
  character(*), parameter :: divider = newline//nul//'--set'//nul
  !> A deck is not let grow beyond this; longer ones have a test of their own.
  integer, parameter :: most_bytes = 20000

contains

  !> A number from 0 to n - 1.
  integer function below(n)
    integer, intent(in) :: n

    below = min(n - 1, int(n*sum(uniform(1, 0.0_wp, 1.0_wp))))
  end function below

  !> True in `percent` of the calls.
  logical function chance(percent)
    integer, intent(in) :: percent

    chance = below(100) < percent
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
  subroutine mutate(case)
    type(case_t), intent(inout) :: case
    integer :: i
    logical :: in_setting

    in_setting = chance(40)
    if (in_setting .and. case%setting_count > 0) then
      i = 1 + below(case%setting_count)
      case%settings(i) = mutated(trim(case%settings(i)))
      ! The system ends an argument at a NUL.
      if (index(case%settings(i), nul) > 0) case%settings(i) = case%settings(i) (:index(case%settings(i), nul) - 1)
    else
      case%deck = mutated(case%deck)
      if (len(case%deck) > most_bytes) case%deck = case%deck(:most_bytes)
    end if
  end subroutine mutate

  !> The beginning of one deck and the end of another.
  subroutine splice(case, other)
    type(case_t), intent(inout) :: case
    type(case_t), intent(in) :: other

    case%deck = case%deck(:below(len(case%deck) + 1))//other%deck(1 + below(len(other%deck) + 1):)
    if (len(case%deck) > most_bytes) case%deck = case%deck(:most_bytes)
  end subroutine splice

  !> A number, a choice, or a word that readers stumble over, for any key.
  subroutine add_setting(case)
    type(case_t), intent(inout) :: case
    character(:), allocatable :: value
    integer :: k

    if (case%setting_count == most_settings) return
    k = 1 + below(key_count)
    value = schema(k)%choices
    value = word(value, 1 + below(max(1, word_count(value))))
    if (value == '') value = real_text(below(1000)*10.0_wp**(below(12) - 6))
    if (chance(20)) value = hostile_word()
    value = value(:index(value//nul, nul) - 1)
    case%setting_count = case%setting_count + 1
    case%settings(case%setting_count) = trim(schema(k)%group)//'.'//trim(schema(k)%name)//'='//value
  end subroutine add_setting

  !> One change: of a byte, of a stretch of bytes, or by a word that readers stumble over.
  function mutated(text) result(changed)
    character(*), intent(in) :: text
    character(:), allocatable :: changed
    integer :: first, last, to

    first = 1 + below(len(text) + 1)
    last = min(len(text), first + below(1 + below(40)))
    to = 1 + below(len(text) + 1)
    select case (below(10))
    case (0)
      changed = text(:first - 1)//char(below(256))//text(min(first + 1, len(text) + 1):)
    case (1)
      changed = text(:first - 1)//char(below(256))//text(first:)
    case (2)
      changed = text(:first - 1)//text(last + 1:)
    case (3)
      changed = text(:to - 1)//text(first:last)//text(to:)
    case (4)
      changed = text(:first - 1)//repeat(text(first:last), 1 + below(100))//text(first:)
    case (5)
      changed = text(:first - 1)
    case (6)
      changed = with_returns(text)
    case (7)
      changed = text(:first - 1)//name_of_schema()//text(last + 1:)
    case default
      changed = text(:first - 1)//hostile_word()//text(merge(first, last + 1, chance(50)):)
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

  function name_of_schema() result(text)
    character(:), allocatable :: text

    select case (below(3))
    case (0)
      text = '&'//word(group_names, 1 + below(word_count(group_names)))//newline
    case (1)
      text = trim(schema(1 + below(key_count))%name)//' = '
    case default
      text = schema(1 + below(key_count))%choices
      text = "'"//word(text, 1 + below(max(1, word_count(text))))//"'"
    end select
  end function name_of_schema

  !> What readers of decks stumble over.
  function hostile_word() result(text)
    character(:), allocatable :: text
    character(*), parameter :: words = '1e400 -1e400 1e-400 9.9e307 1.7976931348623157e308 4.9e-324 2.2250738585072014e-308 '// &
      'NaN inf '// &
      '-Infinity 0x1F z''1f'' 1_8 .5 5. +.5d-3 1d+308 -0.0 1e+ . - + e 1,,2 3*1 0*1 -1*2 '// &
      '1000000000*1 10000*0.0 10001*0.0 99999999999999999999*2 1e0000000000000000001 '// &
      '''it''''s'' ''a "b" c'' "x''y" '''' "" ''/'' ''!'' ''&end'' &end & / ! !'' = ( ) % '// &
      '$scene * , ; .true. (1,2) mass(1)=2 a%b=3 &scene &sweep &SCENE T_END default auto '// &
      '9223372036854775807 9223372036854775808'

    select case (below(14))
    case (0)
      text = nul
    case (1)
      text = char(239)//char(187)//char(191)
    case (2)
      text = char(195)//char(182)//char(226)//char(130)//char(172)//char(240)//char(159)//char(152)//char(128)
    case (3)
      text = char(128 + below(128))//char(128 + below(128))
    case (4)
      text = achar(127)//achar(27)//'[31m'
    case (5)
      text = achar(9)//achar(13)//newline
    case (6)
      text = repeat('x', below(600))
    case (7)
      text = repeat(' ', below(3000))
    case (8)
      text = repeat(newline, below(100))
    case default
      text = word(words, 1 + below(word_count(words)))//' '
    end select
  end function hostile_word
end module fuzz_cases
