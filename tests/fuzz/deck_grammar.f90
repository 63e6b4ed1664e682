!> Decks made from the schema: sound ones of every model, law, contact and method, in every way to write them.
module deck_grammar
  use dst_kinds, only: wp, int64
  use dst_text, only: word, word_count, has_word, real_text, integer_text, quoted_text
  use dst_schema, only: key_t, schema, key_count, group_names, sweep_group, find_key, in_range, condition_count, &
                        find_name, real_kind, reals_kind, integer_kind, texts_kind, choice_kind
  use fuzz_cases, only: case_t, dice_t, mutate, hostile_word, most_settings
  implicit none
  private

  public :: generate

  character, parameter :: newline = achar(10), tab = achar(9)

  !> What the values of one deck must agree on.
  type :: plan_t
    character(24) :: choice(key_count) = ''
    logical :: profile = .false.              !! several velocities, with their times
    logical :: sweeps = .false.               !! many cases
  end type plan_t

contains

  !> A case that is sound three times in ten, and else sound but for a few changes.
  subroutine generate(dice, case)
    type(dice_t), intent(inout) :: dice
    type(case_t), intent(out) :: case
    type(plan_t) :: plan
    integer :: i

    call choose(dice, plan)
    case%deck = deck_text(dice, plan)
    do i = 1, most_settings
      if (dice%chance(20)) call add_setting(dice, plan, case)
    end do
    if (dice%chance(30)) return
    do i = 0, dice%below(3)
      call mutate(dice, case)
    end do
  end subroutine generate

  !> A choice for every key that has one.
  subroutine choose(dice, plan)
    type(dice_t), intent(inout) :: dice
    type(plan_t), intent(out) :: plan
    character(:), allocatable :: choices
    integer :: i

    plan%profile = dice%chance(10)
    do i = 1, key_count
      if (schema(i)%kind /= choice_kind) cycle
      choices = trim(schema(i)%choices)
      plan%choice(i) = word(choices, 1 + dice%below(word_count(choices)))
    end do
    plan%sweeps = dice%chance(15) .and. plan%choice(find_key('scene', 'model')) /= 'auto'
  end subroutine choose

  !> Whether a key has a meaning with these choices.
  recursive logical function is_used(i, choice) result(answer)
    integer, intent(in) :: i
    character(*), intent(in) :: choice(:)
    integer :: n, on

    answer = .true.
    do n = 1, condition_count(schema(i))
      on = find_name(schema(i)%used_by(n)%on)
      ! Not in one expression: gfortran keeps the length of the choices where the recursive call would overwrite it.
      answer = answer .and. is_used(on, choice)
      answer = answer .and. has_word(schema(i)%used_by(n)%choices, trim(choice(on)))
    end do
  end function is_used

  function deck_text(dice, plan) result(text)
    type(dice_t), intent(inout) :: dice
    type(plan_t), intent(in) :: plan
    character(:), allocatable :: text, group
    integer :: g, i, first, start
    logical :: given

    text = ''
    first = dice%below(word_count(group_names))
    do g = 1, word_count(group_names)
      group = word(group_names, 1 + mod(g + first, word_count(group_names)))
      if (group == sweep_group) then
        if (plan%sweeps) text = text//sweep_text(dice, plan)
        cycle
      end if
      text = text//gap(dice)//'&'//group//gap(dice)//newline
      start = dice%below(key_count)
      do i = 1, key_count
        associate (k => 1 + mod(i + start, key_count))
          if (schema(k)%group /= group .or. .not. is_used(k, plan%choice)) cycle
          given = dice%chance(30) .or. (plan%profile .and. group == 'drive')
          if (.not. (schema(k)%required .or. plan%choice(k) /= '' .or. given)) cycle
          text = text//trim(schema(k)%name)//gap(dice)//'='//gap(dice)// &
                 values_text(dice, schema(k), plan, plan%choice(k))//blank(dice)
        end associate
      end do
      text = text//'/'
    end do
    if (dice%chance(80)) text = text//newline
  end function deck_text

  !> A grid over one or two keys that the deck uses.
  function sweep_text(dice, plan) result(text)
    type(dice_t), intent(inout) :: dice
    type(plan_t), intent(in) :: plan
    character(:), allocatable :: text, names, first, last, counts
    integer :: i, axes, varied(2)

    axes = 1 + dice%below(2)
    names = ''
    first = ''
    last = ''
    counts = ''
    varied = 0
    do i = 1, axes
      do
        varied(i) = 1 + dice%below(key_count)
        if (schema(varied(i))%kind == real_kind .and. .not. has_word('output sweep', trim(schema(varied(i))%group)) &
          .and. is_used(varied(i), plan%choice) .and. varied(1) /= varied(2)) exit
      end do
      associate (key => schema(varied(i)))
        names = names//quoted(dice, trim(key%group)//'.'//trim(key%name))//blank(dice)
        first = first//number_text(dice, key)//blank(dice)
        last = last//number_text(dice, key)//blank(dice)
        counts = counts//integer_text(1 + dice%below(40))//blank(dice)
      end associate
    end do
    text = gap(dice)//'&sweep'//gap(dice)//newline//'parameter = '//names//'first ='//gap(dice)//first//'last = '//last// &
      'count = '//counts
    if (dice%chance(30)) text = text//"spacing = 'linear'"//blank(dice)
    text = text//'/'
  end function sweep_text

  subroutine add_setting(dice, plan, case)
    type(dice_t), intent(inout) :: dice
    type(plan_t), intent(in) :: plan
    type(case_t), intent(inout) :: case
    integer :: i

    i = 1 + dice%below(key_count)
    case%setting_count = case%setting_count + 1
    case%settings(case%setting_count) = trim(schema(i)%group)//'.'//trim(schema(i)%name)//'='// &
      values_text(dice, schema(i), plan, plan%choice(i))
  end subroutine add_setting

  !> What may stand between two words of a group, and must.
  function blank(dice) result(text)
    type(dice_t), intent(inout) :: dice
    character(:), allocatable :: text

    select case (dice%below(6))
    case (0)
      text = ', '
    case (1)
      text = tab//' '
    case (2)
      text = " ! it's a /comment & = 'quoted"//newline
    case default
      text = newline//'  '
    end select
  end function blank

  !> What may stand anywhere between two words.
  function gap(dice) result(text)
    type(dice_t), intent(inout) :: dice
    character(:), allocatable :: text

    select case (dice%below(8))
    case (0)
      text = ''
    case (1)
      text = newline
    case (2)
      text = '! "&end/'//newline
    case default
      text = ' '
    end select
  end function gap

  !> Values as many as the key takes.
  function values_text(dice, key, plan, choice) result(text)
    type(dice_t), intent(inout) :: dice
    type(key_t), intent(in) :: key
    type(plan_t), intent(in) :: plan
    character(*), intent(in) :: choice
    character(:), allocatable :: text
    integer :: i, columns

    select case (key%kind)
    case (choice_kind)
      text = quoted(dice, trim(choice))
    case (real_kind)
      text = number_text(dice, key)
    case (reals_kind)
      text = number_text(dice, key)
      if (key%name == 'time') text = '0.0'
      if (.not. plan%profile) return
      if (key%name == 'time') text = '0, 1, 1.0, 3'
      if (key%name == 'velocity') text = '2*'//text//', 1*'//number_text(dice, key)//','//number_text(dice, key)
      return
    case (integer_kind)
      text = integer_text(int(dice%below(1000000), int64)*10_int64**dice%below(12))
    case (texts_kind)
      columns = word_count(key%choices) - 1
      i = dice%below(columns)
      text = quoted(dice, word(key%choices, 2 + i))
      if (dice%chance(50)) text = text//', '//quoted(dice, word(key%choices, 2 + mod(i + 1, columns)))
      if (dice%chance(30)) text = quoted(dice, 'default')
    case default
      text = quoted(dice, free_text(dice))
    end select
    if (dice%chance(5)) text = '1*'//text
  end function values_text

  !> Plain words, and every kind of character that a text may hold.
  function free_text(dice) result(text)
    type(dice_t), intent(inout) :: dice
    character(:), allocatable :: text
    integer :: i
    character(*), parameter :: pieces = 'a b1 it''s "so" ! / &end = '//char(195)//char(188)//' '//char(226)// &
      char(130)//char(172)//' $x ,; (1) %'

    text = ''
    do i = 1, dice%below(8)
      text = text//word(pieces, 1 + dice%below(word_count(pieces)))
      if (dice%chance(40)) text = text//' '
    end do
  end function free_text

  function quoted(dice, text) result(with_quotes)
    type(dice_t), intent(inout) :: dice
    character(*), intent(in) :: text
    character(:), allocatable :: with_quotes
    logical :: double

    double = dice%chance(30)
    with_quotes = quoted_text(text)
    if (double .and. scan(text, '''"') == 0) with_quotes = '"'//text//'"'
  end function quoted

  !> A number in the key's range nine times in ten, in one of the ways to write it.
  function number_text(dice, key) result(text)
    type(dice_t), intent(inout) :: dice
    type(key_t), intent(in) :: key
    character(:), allocatable :: text
    real(wp) :: number
    integer :: i

    do i = 1, 50
      number = random_number_of(dice, key)
      if (in_range(key%range, number)) exit
    end do
    select case (dice%below(6))
    case (0)
      text = '+'//real_text(abs(number))
    case (1)
      text = real_text(number)
      if (index(text, 'e') > 0) text(index(text, 'e'):index(text, 'e')) = merge('D', 'd', dice%chance(50))
    case default
      text = real_text(number)
    end select
    if (dice%below(200) == 0) text = hostile_word(dice)
  end function number_text

  !> Limits of the range, limits of the arithmetic, and any size between.
  real(wp) function random_number_of(dice, key) result(number)
    type(dice_t), intent(inout) :: dice
    type(key_t), intent(in) :: key

    select case (dice%below(12))
    case (0)
      number = max(key%range%low, -9.9e307_wp)
    case (1)
      ! Beyond this a deck's numbers end.
      number = min(key%range%high, 9.9e307_wp)
    case (2)
      number = merge(-0.0_wp, 0.0_wp, dice%chance(50))
    case (3)
      number = 10.0_wp**(dice%below(600) - 300)
    case (4)
      number = nearest(real(dice%below(1000), wp), 1.0_wp)
    case (5)
      number = 1.0e-307_wp*(1 + dice%below(90))
    case default
      number = real(dice%below(1000000), wp)*10.0_wp**(-dice%below(12))
    end select
    if (dice%chance(20)) number = -number
  end function random_number_of
end module deck_grammar
