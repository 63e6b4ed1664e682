!> Decks as text: the resolved deck (every key as used) and the template (every key explained).
module dst_deck_text
  use dst_errors, only: error_t, raise, usage_error
  use dst_kinds, only: wp, int64
  use dst_text, only: text_builder_t, real_text, integer_text, quoted_text, word, word_count, has_word, alternatives
  use dst_schema, only: key_t, schema, key_count, group_names, sweep_group, find_name, is_text, is_automatic, is_word_of, &
                        range_text, choice_problem, real_kind, integer_kind, texts_kind, choice_kind, &
                        condition_count, condition_text
  use dst_deck_values, only: deck_t, value_t, usage, element_count, set_default, used
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
    type(deck_t) :: deck
    character(:), allocatable :: group, problem
    integer :: g, i

    problem = choice_problem(schema(find_name('model')), model)
    if (problem /= '') then
      call raise(error, usage_error, problem)
      return
    end if
    do i = 1, key_count
      call set_default(schema(i), deck%value(i))
    end do
    deck%value(find_name('model'))%texts = model
    call builder%line('! A deck of dynstiction, model '//model//': every key, with unit, range or choices, default and meaning.')
    call builder%line('! A key with a default may be left out. Values are those of Fig. 3 of Nakano and Popov (2020).')
    call builder%line('! One value for each key, unless it says list; text in quotes; groups and keys in any order.')
    do g = 1, word_count(group_names)
      group = word(group_names, g)
      ! Most decks are no sweep.
      if (group == sweep_group) cycle
      call builder%line('')
      call add_group(group, '')
    end do
    call builder%line('')
    call builder%line('! A deck of many cases has this group too: remove the first ! of its lines.')
    call builder%line('! For a quick look: dynstiction sweep DECK --vary system.misalignment_deg=0.5:20:40')
    call add_group(sweep_group, '!')
    text = builder%content()

  contains

    !> The keys of a group; those that Fig. 3 does not use have their default.
    subroutine add_group(group, prefix)
      character(*), intent(in) :: group, prefix
      character(:), allocatable :: value
      integer :: k

      call builder%line(prefix//'&'//group)
      do k = 1, key_count
        if (schema(k)%group /= group .or. .not. has_model(k, model)) cycle
        value = schema(k)%sample
        if (value == '' .or. usage(deck, k) /= used) value = schema(k)%default
        if (schema(k)%name == 'model') value = model
        call add_template_entry(builder, schema(k), value, prefix)
      end do
      call builder%line(prefix//'/')
    end subroutine add_group
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

  !> A key in a template: its meaning, its value, and an explanation.
  subroutine add_template_entry(builder, key, value, prefix)
    type(text_builder_t), intent(inout) :: builder
    type(key_t), intent(in) :: key
    character(*), intent(in) :: value, prefix
    character(:), allocatable :: shown, meaning

    shown = prefix//'  '//trim(key%name)//' = '//as_written(key, trim(value))
    meaning = trim(key%meaning)
    ! Conditions on the model are omitted in the template of that model.
    if (has_other_condition(key)) meaning = meaning//'; only with '//condition_text(key)
    call builder%line(prefix//'  ! '//meaning)
    call builder%line(shown//repeat(' ', max(0, comment_column - len(shown)))//' ! '//explanation(key))
  end subroutine add_template_entry

  !> A value as a deck has it: text in quotes.
  function as_written(key, value) result(text)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: value
    character(:), allocatable :: text

    text = value
    if (is_text(key) .or. is_word_of(key, value)) text = quoted_text(value)
  end function as_written

  !> Whether the use of a key depends on more than the model.
  pure logical function has_other_condition(key)
    type(key_t), intent(in) :: key

    has_other_condition = condition_count(key) > 0 .and. all(key%used_by%on /= 'model')
  end function has_other_condition

  !> 'real, kg, > 0.0; no default'.
  function explanation(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text
    ! In the order of the kinds.
    character(13), parameter :: says(6) = [character(13) :: 'real', 'integer', 'text', '', 'list of reals', 'list of texts']

    text = trim(says(key%kind))
    if (key%kind == texts_kind .and. key%choices /= '') text = 'list: '//alternatives(trim(key%choices))
    if (key%kind == choice_kind) text = alternatives(trim(key%choices))
    text = text//unit_text(key)
    if (range_text(key) /= '') text = text//', '//range_text(key)
    if (.not. is_text(key) .and. key%choices /= '') text = text//' or '//quoted_text(trim(key%choices))
    if (key%required) then
      text = text//'; no default'
    else if (is_text(key) .or. key%default /= '') then
      text = text//'; default '//as_written(key, trim(key%default))
    end if
  end function explanation
end module dst_deck_text
