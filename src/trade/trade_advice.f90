!> The cheapest settings that `trade` has measured to meet an accuracy, ready to paste into the deck.
module dst_trade_advice
  use dst_kinds, only: wp
  use dst_deck, only: deck_t
  use dst_deck_values, only: usage, unused, is_default
  use dst_errors, only: error_t, raise, result_done, usage_error, stopped_early
  use dst_schema, only: schema, key_count, find_key, longest_text, group_names, text_kind, choice_kind
  use dst_text, only: text_builder_t, real_text, quoted_text, formatted, word, word_count, has_word, nearest_word
  use dst_trade, only: trade_t
  use dst_trade_plan, only: candidate_t, same_family
  use dst_trade_quantities, only: quantities, quantity_count
  implicit none
  private

  public :: check_wish, cheapest, advice, advised_settings

  !> What a user reads most.
  character(*), parameter :: usual_quantities = 'final_elongation period peak_force creep_velocity'
  !> Errors scatter: a setting is trusted if its error is smaller than asked for by this factor.
  real(wp), parameter :: margin = 3.0_wp

  !> Format of the numbers in messages.
  character(*), parameter :: short = '(es8.1)'

contains

  !> Whether accuracy and quantity ('' = the usual ones, or 'all') can be meant.
  subroutine check_wish(accuracy, quantity, error)
    real(wp), intent(in) :: accuracy
    character(*), intent(in) :: quantity
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: names, near
    integer :: q

    if (.not. (accuracy > 0.0_wp .and. accuracy <= 1.0_wp)) then
      call raise(error, usage_error, 'the accuracy is out of range: it must be > 0.0 and <= 1.0')
      return
    end if
    names = 'all'
    do q = 1, quantity_count
      names = names//' '//trim(quantities(q)%name)
    end do
    if (quantity == '' .or. has_word(names, quantity)) return
    near = nearest_word(quantity, names)
    if (near /= '') near = "the nearest is '"//near//"', "
    call raise(error, usage_error, "unknown quantity '"//quantity//"': "//near//'there are '//names)
  end subroutine check_wish

  !> Number of the cheapest point whose errors stay below `accuracy` with the margin; 0 and an error if there is none.
  subroutine cheapest(trade, accuracy, quantity, best, error)
    type(trade_t), intent(in) :: trade
    real(wp), intent(in) :: accuracy
    character(*), intent(in) :: quantity
    integer, intent(out) :: best
    type(error_t), allocatable, intent(out) :: error
    logical :: wanted(quantity_count)
    integer :: i, nearest

    best = 0
    call check_wish(accuracy, quantity, error)
    if (allocated(error)) return
    wanted = are_wanted(quantity) .and. trade%reference_error >= 0.0_wp
    if (.not. any(wanted)) then
      call raise(error, usage_error, "the scene has no '"//quantity//"': choose another quantity, or a longer scene.t_end")
      return
    end if
    nearest = 0
    do i = 1, size(trade%points)
      if (trade%points(i)%result_code /= result_done) cycle
      if (nearest == 0) nearest = i
      if (largest_error(trade, i, wanted) < largest_error(trade, nearest, wanted)) nearest = i
      if (.not. is_trusted(trade, i, wanted, accuracy)) cycle
      if (best == 0) best = i
      if (trade%points(i)%seconds < trade%points(best)%seconds) best = i
    end do
    if (best > 0) return
    if (nearest == 0) then
      call raise(error, stopped_early, 'no setting was measured: raise --budget')
    else
      call raise(error, stopped_early, 'no setting that was measured meets '//formatted(short, accuracy)//' with a margin of '// &
        formatted(short, margin)//': the best, '//described(trade%points(nearest)%candidate)//', errs by '// &
        formatted(short, largest_error(trade, nearest, wanted))//', known to '// &
        formatted(short, maxval(trade%reference_error, mask=wanted))//': raise --budget or --accuracy')
    end if
  end subroutine cheapest

  pure function are_wanted(quantity) result(wanted)
    character(*), intent(in) :: quantity
    logical :: wanted(quantity_count)
    integer :: q

    do q = 1, quantity_count
      wanted(q) = quantity == 'all' .or. quantity == quantities(q)%name
      if (quantity == '') wanted(q) = has_word(usual_quantities, trim(quantities(q)%name))
    end do
  end function are_wanted

  !> Largest of the wanted errors of a point.
  pure real(wp) function largest_error(trade, i, wanted)
    type(trade_t), intent(in) :: trade
    integer, intent(in) :: i
    logical, intent(in) :: wanted(:)

    largest_error = maxval(trade%points(i)%error, mask=wanted)
  end function largest_error

  !> Whether a point meets the accuracy with the margin, and everything finer of its family meets it too.
  pure logical function is_trusted(trade, i, wanted, accuracy)
    type(trade_t), intent(in) :: trade
    integer, intent(in) :: i
    logical, intent(in) :: wanted(:)
    real(wp), intent(in) :: accuracy
    integer :: k

    is_trusted = margin*largest_error(trade, i, wanted) + maxval(trade%reference_error, mask=wanted) <= accuracy
    do k = 1, size(trade%points)
      if (.not. is_trusted) return
      if (trade%points(k)%result_code /= result_done) cycle
      associate (here => trade%points(i)%candidate, there => trade%points(k)%candidate)
        if (.not. same_family(here, there)) cycle
        if (there%rtol < here%rtol .or. there%step < here%step) is_trusted = largest_error(trade, k, wanted) <= accuracy
      end associate
    end do
  end function is_trusted

  !> The settings of point `best` as namelist groups, and as a command that also takes out what nothing uses any more.
  function advice(deck, trade, best) result(text)
    type(deck_t), intent(in) :: deck
    type(trade_t), intent(in) :: trade
    integer, intent(in) :: best
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    character(:), allocatable :: settings, command
    integer :: g, first, width

    associate (candidate => trade%points(best)%candidate)
      call builder%line('! '//described(candidate)//': '//formatted(short, trade%points(best)%seconds)//' s, errors '// &
        errors_text(trade, best))
      do g = 1, word_count(group_names)
        call add_group(candidate, word(group_names, g), builder)
      end do
    end associate
    settings = advised_settings(deck, trade, best)
    command = ''
    first = 1
    do while (first <= len(settings))
      width = index(settings(first:), new_line('a')) - 1
      associate (setting => settings(first:first + width - 1))
        command = command//' --set '//setting
        if (setting(width:) == '=') call builder%line('! Nothing uses '//setting(:width - 1)//' any more: remove it.')
      end associate
      first = first + width + 1
    end do
    call builder%line('! In place of the deck''s own values; or: dynstiction run '//deck%name//command)
    text = builder%content()
  end function advice

  !> The same as settings 'group.key=value', one a line; 'group.key=' takes a key out that nothing uses any more.
  function advised_settings(deck, trade, best) result(settings)
    type(deck_t), intent(in) :: deck
    type(trade_t), intent(in) :: trade
    integer, intent(in) :: best
    character(:), allocatable :: settings, value
    type(deck_t), allocatable :: changed
    integer :: i

    allocate (changed, source=deck)
    call change_texts(trade%points(best)%candidate, changed)
    settings = ''
    do i = 1, key_count
      value = value_text(trade%points(best)%candidate, trim(schema(i)%name))
      if (value == '' .and. .not. is_to_go(changed, i)) cycle
      settings = settings//trim(schema(i)%group)//'.'//trim(schema(i)%name)//'='//value//new_line('a')
    end do
  end function advised_settings

  !> 'low_frequency, radau9, rtol 1.0e-5'.
  function described(candidate) result(text)
    type(candidate_t), intent(in) :: candidate
    character(:), allocatable :: text

    text = trim(candidate%model)
    if (candidate%form /= '') text = text//' '//trim(candidate%form)
    if (candidate%method /= '') text = text//', '//trim(candidate%method)
    if (candidate%v_smooth > 0.0_wp) text = text//', v_smooth '//real_text(candidate%v_smooth)
    if (candidate%rtol > 0.0_wp) text = text//', rtol '//real_text(candidate%rtol)
    if (candidate%step > 0.0_wp) text = text//', step '//real_text(candidate%step)
  end function described

  function errors_text(trade, i) result(text)
    type(trade_t), intent(in) :: trade
    integer, intent(in) :: i
    character(:), allocatable :: text
    integer :: q

    text = ''
    do q = 1, quantity_count
      if (trade%points(i)%error(q) < 0.0_wp) cycle
      if (text /= '') text = text//', '
      text = text//trim(quantities(q)%name)//' '//formatted(short, trade%points(i)%error(q))
    end do
  end function errors_text

  !> Put the candidate's choices, on which the use of other keys depends, into a deck.
  subroutine change_texts(candidate, deck)
    type(candidate_t), intent(in) :: candidate
    type(deck_t), intent(inout) :: deck

    call change('scene', 'model', candidate%model)
    if (candidate%method /= '') call change('integrator', 'method', candidate%method)
    if (candidate%contact /= '') call change('friction', 'contact', candidate%contact)

  contains

    subroutine change(group, name, value)
      character(*), intent(in) :: group, name, value
      integer :: k

      k = find_key(group, name)
      deck%value(k)%texts = [character(longest_text) :: value]
    end subroutine change
  end subroutine change_texts

  !> Whether a key that the deck sets must go, since nothing uses it any more.
  pure logical function is_to_go(deck, i)
    type(deck_t), intent(in) :: deck
    integer, intent(in) :: i

    is_to_go = .false.
    if (.not. deck%value(i)%user) return
    if (usage(deck, i) == unused) is_to_go = .not. is_default(schema(i), deck%value(i))
  end function is_to_go

  !> The candidate's keys of one group.
  subroutine add_group(candidate, group, builder)
    type(candidate_t), intent(in) :: candidate
    character(*), intent(in) :: group
    type(text_builder_t), intent(inout) :: builder
    character(:), allocatable :: value
    logical :: begun
    integer :: i

    begun = .false.
    do i = 1, key_count
      if (schema(i)%group /= group) cycle
      value = value_text(candidate, trim(schema(i)%name))
      if (value == '') cycle
      if (.not. begun) call builder%line('&'//group)
      begun = .true.
      if (any(schema(i)%kind == [text_kind, choice_kind])) value = quoted_text(value)
      call builder%line('  '//trim(schema(i)%name)//' = '//value)
    end do
    if (begun) call builder%line('/')
  end subroutine add_group

  !> Value of a key that the candidate sets, '' if it does not.
  function value_text(candidate, key) result(value)
    type(candidate_t), intent(in) :: candidate
    character(*), intent(in) :: key
    character(:), allocatable :: value

    value = ''
    select case (key)
    case ('model')
      value = trim(candidate%model)
    case ('form')
      value = trim(candidate%form)
    case ('method')
      value = trim(candidate%method)
    case ('contact')
      value = trim(candidate%contact)
    case ('rtol')
      if (candidate%rtol > 0.0_wp) value = real_text(candidate%rtol)
    case ('step')
      if (candidate%step > 0.0_wp) value = real_text(candidate%step)
    case ('v_smooth')
      if (candidate%v_smooth > 0.0_wp) value = real_text(candidate%v_smooth)
    end select
  end function value_text
end module dst_trade_advice
