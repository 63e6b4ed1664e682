!> Decks as text: the resolved deck (every key as used) and the template (every key explained).
module dst_deck_text
  use dst_errors, only: error_t, raise, usage_error
  use dst_kinds, only: wp, int64
  use dst_text, only: text_builder_t, real_text, integer_text, quoted_text, word, word_count, has_word, alternatives
  use dst_schema, only: key_t, schema, key_count, group_names, sweep_group, find_name, is_text, is_automatic, is_word_of, &
                        range_text, choice_problem, real_kind, reals_kind, integer_kind, texts_kind, choice_kind, &
                        condition_count, condition_text
  use dst_deck_values, only: deck_t, value_t, usage, element_count, used
  implicit none
  private

  public :: resolved, template, has_model, has_other_condition

  !> Column at which the comments begin.
  integer, parameter :: comment_column = 32

contains

  !> The complete deck: every key that has a meaning, as used, marked user or default. It reads back to the same deck. With
  !> `interval` [s] it also says what output.interval = 'auto' means for this deck.
  function resolved(deck, interval) result(text)
    type(deck_t), intent(in) :: deck
    real(wp), intent(in), optional :: interval
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    character(:), allocatable :: group, source
    integer :: g, i

    call builder%line('! The deck as used: every key, its source (user or default), unit and meaning.')
    do g = 1, word_count(group_names)
      group = word(group_names, g)
      if (group == sweep_group .and. .not. deck%is_sweep()) cycle
      call builder%line('&'//group)
      do i = 1, key_count
        if (schema(i)%group /= group .or. usage(deck, i) /= used .or. element_count(deck%value(i)) == 0) cycle
        source = trim(merge('user   ', 'default', deck%value(i)%user))//unit_text(schema(i))
        if (schema(i)%kind == real_kind .and. present(interval)) then
          if (is_automatic(schema(i), deck%value(i)%reals(1))) source = source//', here '//real_text(interval)
        end if
        call add_entry(builder, schema(i), deck%value(i), source//'; '//trim(schema(i)%meaning))
      end do
      call builder%line('/')
    end do
    text = builder%content()
  end function resolved

  !> `key = value, value, ...  ! comment`; a long list is written in several lines.
  subroutine add_entry(builder, key, value, comment)
    type(text_builder_t), intent(inout) :: builder
    type(key_t), intent(in) :: key
    type(value_t), intent(in) :: value
    character(*), intent(in) :: comment
    character(:), allocatable :: line, next
    integer, parameter :: widest = 100
    integer :: i

    line = '  '//trim(key%name)//' = '
    do i = 1, element_count(value)
      next = element_text(key, value, i)
      if (i > 1) line = line//','
      if (i > 1 .and. len(line) + len(next) > widest) then
        call builder%line(line)
        line = '   '
      end if
      if (i > 1) line = line//' '
      line = line//next
    end do
    call builder%line(line//repeat(' ', max(0, comment_column - len(line)))//' ! '//comment)
  end subroutine add_entry

  function element_text(key, value, i) result(text)
    type(key_t), intent(in) :: key
    type(value_t), intent(in) :: value
    integer, intent(in) :: i
    character(:), allocatable :: text

    if (is_text(key)) then
      text = quoted_text(trim(value%texts(i)))
    else if (is_automatic(key, value%reals(i))) then
      text = quoted_text(trim(key%choices))
    else if (key%kind == integer_kind) then
      text = integer_text(nint(value%reals(i), int64))
    else
      text = real_text(value%reals(i))
    end if
  end function element_text

  function unit_text(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text

    text = ''
    if (key%unit /= '' .and. key%unit /= '1') text = ', '//trim(key%unit)
  end function unit_text

  !> A deck with every key of `model`, its unit, range or choices, default and meaning. Physical values are those of Fig. 3.
  subroutine template(model, text, error)
    character(*), intent(in) :: model
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(text_builder_t) :: builder
    character(:), allocatable :: group, problem
    integer :: g, i

    problem = choice_problem(schema(find_name('model')), model)
    if (problem /= '') then
      call raise(error, usage_error, problem)
      return
    end if
    call builder%line('! A deck of dynstiction, model '//model//': every key, with unit, range or choices, default and meaning.')
    call builder%line('! A key with a default may be left out. Values are those of Fig. 3 of Nakano and Popov (2020).')
    call builder%line('! One value for each key, unless it says list; text in quotes; groups and keys in any order.')
    do g = 1, word_count(group_names)
      group = word(group_names, g)
      ! Most decks are no sweep.
      if (group == sweep_group) cycle
      call builder%line('')
      call builder%line('&'//group)
      do i = 1, key_count
        if (schema(i)%group == group .and. has_model(i, model)) &
          call add_template_entry(builder, schema(i), template_value(i, model), '')
      end do
      call builder%line('/')
    end do
    call builder%line('')
    call builder%line('! A deck of many cases has this group too: remove the first ! of its lines.')
    call builder%line('! For a quick look: dynstiction sweep DECK --vary system.misalignment_deg=0.5:20:40')
    call builder%line('!&'//sweep_group)
    do i = 1, key_count
      if (schema(i)%group == sweep_group) call add_template_entry(builder, schema(i), template_value(i, model), '!')
    end do
    call builder%line('!/')
    text = builder%content()
  end subroutine template

  !> Whether key `i` can be used with `model`, for any law, contact and method.
  pure recursive function has_model(i, model) result(answer)
    integer, intent(in) :: i
    character(*), intent(in) :: model
    logical :: answer
    integer :: n, on

    answer = .true.
    do n = 1, condition_count(schema(i))
      on = find_name(schema(i)%used_by(n)%on)
      answer = answer .and. has_model(on, model)
      if (schema(on)%name == 'model') answer = answer .and. has_word(schema(i)%used_by(n)%choices, model)
    end do
  end function has_model

  !> The value of key `i` in the template of `model`: that of Fig. 3, or the default where Fig. 3 does not use the key.
  pure recursive function template_value(i, model) result(value)
    integer, intent(in) :: i
    character(*), intent(in) :: model
    character(:), allocatable :: value
    integer :: n

    value = trim(schema(i)%sample)
    do n = 1, condition_count(schema(i))
      if (.not. has_word(schema(i)%used_by(n)%choices, template_value(find_name(schema(i)%used_by(n)%on), model))) value = ''
    end do
    if (value == '') value = trim(schema(i)%default)
    if (schema(i)%name == 'model') value = model
  end function template_value

  subroutine add_template_entry(builder, key, value, prefix)
    type(text_builder_t), intent(inout) :: builder
    type(key_t), intent(in) :: key
    character(*), intent(in) :: value, prefix
    character(:), allocatable :: shown, meaning

    shown = value
    if (is_text(key) .or. is_word_of(key, shown)) shown = quoted_text(shown)
    shown = prefix//'  '//trim(key%name)//' = '//shown
    meaning = trim(key%meaning)
    ! Conditions on the model are omitted in the template of that model.
    if (has_other_condition(key)) meaning = meaning//'; only with '//condition_text(key)
    call builder%line(prefix//'  ! '//meaning)
    call builder%line(shown//repeat(' ', max(0, comment_column - len(shown)))//' ! '//explanation(key))
  end subroutine add_template_entry

  !> Whether the use of a key depends on more than the model.
  pure logical function has_other_condition(key)
    type(key_t), intent(in) :: key

    has_other_condition = condition_count(key) > 0 .and. all(key%used_by%on /= 'model')
  end function has_other_condition

  !> 'real, kg, > 0.0; no default'.
  function explanation(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text

    select case (key%kind)
    case (real_kind)
      text = 'real'
    case (reals_kind)
      text = 'list of reals'
    case (integer_kind)
      text = 'integer'
    case (texts_kind)
      text = 'list of texts'
      if (key%choices /= '') text = 'list: '//alternatives(trim(key%choices))
    case (choice_kind)
      text = alternatives(trim(key%choices))
    case default
      text = 'text'
    end select
    text = text//unit_text(key)
    if (range_text(key) /= '') text = text//', '//range_text(key)
    if (.not. is_text(key) .and. key%choices /= '') text = text//' or '//quoted_text(trim(key%choices))
    if (key%required) then
      text = text//'; no default'
    else if (is_text(key) .or. is_word_of(key, trim(key%default))) then
      text = text//'; default '//quoted_text(trim(key%default))
    else if (key%default /= '') then
      text = text//'; default '//trim(key%default)
    end if
  end function explanation
end module dst_deck_text
