!> Reads a deck: Fortran namelist text, checked against the schema. All faults of a deck are reported at once.
module dst_deck
  use dst_kinds, only: wp, int64
  use dst_curves, only: take_friction_table, check_drive
  use dst_deck_sweep, only: check_sweep
  use dst_deck_text, only: resolved, template, has_model, has_other_condition
  use dst_deck_values, only: deck_t, value_t, usage, failing_condition, set_default, is_default, used
  use dst_errors, only: error_t, raise, raise_lines, deck_error
  use dst_faults, only: place_t
  use dst_methods, only: adaptive_methods, fixed_step_methods
  use dst_namelist, only: namelist_t, token_t, scan_namelist, token_text, last_line, is_plain_text
  use dst_plain_numbers, only: number_text
  use dst_schema, only: key_t, schema, key_count, group_names, find_key, find_name, is_text, names_file, keys_of, in_range, &
                        out_of_range_text, or_word, choice_problem, condition_text, sweep_group, longest_text, most_values, &
                        automatic, is_automatic, is_word_of, real_kind, reals_kind, integer_kind, text_kind, texts_kind, choice_kind
  use dst_text, only: lower_case, word, word_count, word_number, has_word, nearest_word, alternatives, excerpt, integer_text, &
                      real_text, read_real, read_integer
  use dst_text_file, only: read_text, hdf5_signature
  use dst_units, only: factor_of
  implicit none
  private

  public :: deck_t, read_deck, parse_deck, resolved, template, has_model

  !> A file with more bytes is not a deck.
  integer, parameter :: largest_deck = 1000000
  !> Below this every whole number is one in double precision.
  real(wp), parameter :: most_whole = 2.0_wp**53

contains

  !> Read the deck in a file. `settings` are 'group.key=value', and take precedence over the deck.
  subroutine read_deck(file_name, settings, deck, error)
    character(*), intent(in) :: file_name
    character(*), intent(in) :: settings(:)
    type(deck_t), intent(out) :: deck
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: text, problem

    call read_text(file_name, largest_deck, text, problem)
    if (index(text, hdf5_signature) == 1) then
      call raise(error, deck_error, file_name// &
        ': is a result or another HDF5 file, not a deck: see dynstiction show, plot or resume')
    else if (problem /= '') then
      call raise(error, deck_error, file_name//': '//problem//': a deck is a text file with at least &scene; dynstiction '// &
        'template > my.nml writes one')
    else
      call parse_deck(text, file_name, settings, deck, error)
    end if
  end subroutine read_deck

  !> Read a deck from memory; `name` is used as the file's name in messages. With `alone` each value is checked against its own key
  !> only: a part of a deck is not refused because keys are missing, or because values do not fit together. With `is_varied` the
  !> caller varies its parameters, and &sweep need not name any.
  subroutine parse_deck(text, name, settings, deck, error, alone, is_varied)
    character(*), intent(in) :: text, name
    character(*), intent(in) :: settings(:)
    type(deck_t), intent(out) :: deck
    type(error_t), allocatable, intent(out) :: error
    logical, intent(in), optional :: alone, is_varied
    type(namelist_t) :: list
    integer :: line_of(word_count(group_names)), i
    logical :: is_whole, needs_no_grid

    deck%name = name
    deck%text = text
    do i = 1, key_count
      call set_default(schema(i), deck%value(i))
    end do
    call scan_namelist(text, list)
    deck%faults = list%faults
    if (list%plain) then
      call take_entries(list, deck, line_of)
      do i = 1, size(settings)
        call take_setting(trim(settings(i)), i, deck)
      end do
    end if
    is_whole = list%plain
    if (present(alone)) is_whole = is_whole .and. .not. alone
    needs_no_grid = .false.
    if (present(is_varied)) needs_no_grid = is_varied
    if (is_whole) then
      call take_friction_table(deck)
      call check_keys(deck)
      call check_missing(deck, line_of, last_line(text))
      call check_contact(deck)
      call check_drive(deck)
      call check_fields(deck)
      call check_sweep(deck, line_of(word_number(group_names, sweep_group)), needs_no_grid)
    end if
    if (deck%faults%count > 0) call raise_lines(error, deck_error, deck%faults%report(name))
  end subroutine parse_deck

  !> The groups and keys of a scanned deck. `line_of` is the line of each known group, 0 if it is absent.
  subroutine take_entries(list, deck, line_of)
    type(namelist_t), intent(in) :: list
    type(deck_t), intent(inout) :: deck
    integer, intent(out) :: line_of(:)
    character(:), allocatable :: group
    integer :: i, g

    line_of = 0
    group = ''
    do i = 1, list%entry_count
      if (deck%faults%full()) exit
      associate (entry => list%entries(i))
        if (.not. entry%is_group) then
          if (group /= '' .and. entry%name /= '') call take_entry(list, i, group, deck)
          cycle
        end if
        group = lower_case(trim(entry%name))
        if (group == '') cycle
        g = word_number(group_names, group)
        if (g == 0) then
          call deck%faults%add(place_t(entry%line), unknown_group_text(trim(entry%name)))
          ! Its keys were to be those of the nearest group: none is missing there, and nothing follows from them.
          where (schema%group == nearest_word(group, group_names))
            deck%value%attempted = .true.
            deck%value%valid = .false.
          end where
          group = ''
        else if (line_of(g) > 0) then
          call deck%faults%add(place_t(entry%line), 'group &'//group//' given again: it began in line '// &
                               integer_text(line_of(g))//', put all its keys there')
        else
          line_of(g) = entry%line
        end if
      end associate
    end do
    if (.not. any(list%entries(:list%entry_count)%is_group) .and. deck%faults%count == 0) &
      call deck%faults%add(place_t(1), 'no group in the deck: it needs at least &scene, see dynstiction template')
  end subroutine take_entries

  function unknown_group_text(group) result(text)
    character(*), intent(in) :: group
    character(:), allocatable :: text

    if (nearest_word(group, group_names) /= '') then
      text = "unknown group '&"//excerpt(group)//"': the nearest is &"//nearest_word(group, group_names)
    else
      text = "unknown group '&"//excerpt(group)//"': the groups are "//group_names
    end if
  end function unknown_group_text

  !> The key and the values of entry `i`.
  subroutine take_entry(list, i, group, deck)
    type(namelist_t), intent(in) :: list
    integer, intent(in) :: i
    character(*), intent(in) :: group
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: key
    integer :: k

    associate (entry => list%entries(i), place => place_t(list%entries(i)%line))
      key = lower_case(trim(entry%name))
      k = find_key(group, key)
      if (k == 0) then
        if (.not. entry%faulty) call deck%faults%add(place, unknown_key_text(group, trim(entry%name)))
        ! The key that was meant is not missing as well.
        k = find_name(key)
        if (k == 0) k = meant_key(group, key)
        if (k > 0) deck%value(k)%attempted = .true.
      else if (deck%value(k)%attempted .and. deck%value(k)%place%line > 0) then
        call deck%faults%add(place, "'"//key//"' given again: it stands in line "//integer_text(deck%value(k)%place%line)// &
                             ' already, keep one of them')
      else if (entry%faulty) then
        deck%value(k)%attempted = .true.
        deck%value(k)%valid = .false.
        deck%value(k)%place = place
      else
        call take_values(deck, k, list, entry%first, entry%last, place)
      end if
    end associate
  end subroutine take_entry

  !> What to write instead of an unknown key.
  function unknown_key_text(group, key) result(text)
    character(*), intent(in) :: group, key
    character(:), allocatable :: text
    integer :: k

    k = find_name(lower_case(key))
    if (k > 0) then
      text = "'"//key//"' does not belong to &"//group//': put it in &'//trim(schema(k)%group)
      return
    end if
    text = "unknown key '"//excerpt(key)//"' in &"//group//': '
    k = meant_key(group, key)
    if (k == 0) then
      text = text//'its keys are '//keys_of(group)
    else if (schema(k)%group == group) then
      text = text//"the nearest is '"//trim(schema(k)%name)//"'"
    else
      text = text//"the nearest is '"//trim(schema(k)%name)//"' in &"//trim(schema(k)%group)
    end if
  end function unknown_key_text

  !> The key that was most likely meant, 0 if there is none: searched in its group first, then in all.
  integer function meant_key(group, key)
    character(*), intent(in) :: group, key
    character(:), allocatable :: nearest
    integer :: g

    nearest = nearest_word(key, keys_of(group))
    do g = 1, word_count(group_names)
      if (nearest == '') nearest = nearest_word(key, keys_of(word(group_names, g)))
    end do
    meant_key = 0
    if (nearest /= '') meant_key = find_name(nearest)
  end function meant_key

  !> 'group.key=value' from the command line; an empty value removes the key from the deck.
  subroutine take_setting(text, setting, deck)
    character(*), intent(in) :: text
    integer, intent(in) :: setting
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: group, key, given, problem
    type(namelist_t) :: list
    type(place_t) :: place
    integer :: equals, dot, k

    equals = index(text, '=')
    dot = index(text(:max(0, equals - 1)), '.')
    group = lower_case(trim(adjustl(text(:max(0, dot - 1)))))
    key = trim(adjustl(text(dot + 1:max(dot, equals - 1))))
    given = trim(adjustl(text(equals + 1:)))
    place = place_t(setting=setting, argument=excerpt(text))
    problem = ''
    k = find_name(lower_case(key))
    if (.not. is_plain_text(text)) then
      problem = 'control characters, or a character that is not UTF-8: give plain UTF-8 text'
    else if (equals == 0) then
      problem = "no '=': write --set GROUP.KEY=VALUE"
    else if (dot == 0) then
      problem = 'no group: write --set GROUP.KEY=VALUE'
      if (k > 0) problem = 'no group: write --set '//trim(schema(k)%group)//'.'//trim(schema(k)%name)//'=VALUE'
    else if (word_number(group_names, group) == 0) then
      problem = unknown_group_text(group)
    else if (find_key(group, lower_case(key)) == 0) then
      problem = unknown_key_text(group, key)
    else if (deck%value(k)%place%setting > 0) then
      problem = "'"//trim(schema(k)%name)//"' set again: a --set before sets it already, keep one of them"
    end if
    if (problem /= '') then
      call deck%faults%add(place, problem)
      return
    else if (given == '') then
      call set_default(schema(k), deck%value(k))
    else if (any(schema(k)%kind == [text_kind, choice_kind]) .and. scan(given, '''"') /= 1) then
      ! One text as it is: the shell has removed its quotes already.
      list%text = given
      list%tokens = [token_t(last=len(given))]
      call take_values(deck, k, list, 1, 1, place)
    else
      call scan_namelist(given, list, trim(schema(k)%name))
      if (list%faults%count == 0) then
        call take_values(deck, k, list, 1, list%token_count, place)
      else
        call deck%faults%add(place, trim(list%faults%item(1)%text))
        deck%value(k)%valid = .false.
        deck%value(k)%attempted = .true.
      end if
    end if
    deck%value(k)%place = place
  end subroutine take_setting

  !> Convert the words `first` to `last` to the value of key `k`; only the first fault of them is one.
  subroutine take_values(deck, k, list, first, last, place)
    type(deck_t), intent(inout) :: deck
    integer, intent(in) :: k
    type(namelist_t), intent(in) :: list
    integer, intent(in) :: first, last
    type(place_t), intent(in) :: place
    real(wp), allocatable :: reals(:)
    character(longest_text), allocatable :: texts(:)
    character(:), allocatable :: given, problem
    type(key_t) :: key
    real(wp) :: number
    integer(int64) :: total, most
    integer :: i, n

    key = schema(k)
    most = merge(most_values, 1, key%kind == reals_kind .or. key%kind == texts_kind)
    problem = ''
    total = 0_int64
    do i = first, last
      given = token_text(list, list%tokens(i))
      total = total + list%tokens(i)%repeat
      problem = form_problem(key, list%tokens(i), given, place%setting > 0)
      if (problem == '' .and. total > most) problem = "too many values for '"//trim(key%name)//"', from '"//excerpt(given)// &
        "' on: "//integer_text(sum(int(list%tokens(first:last)%repeat, int64)))//' given, at most '//integer_text(most)//' allowed'
      if (problem /= '') exit
    end do
    if (problem == '') then
      allocate (reals(merge(0_int64, total, is_text(key))), texts(merge(total, 0_int64, is_text(key))))
      n = 0
      do i = first, last
        given = token_text(list, list%tokens(i))
        associate (end => n + list%tokens(i)%repeat)
          if (is_text(key)) then
            problem = text_problem(key, given)
            texts(n + 1:end) = given
          else
            problem = number_problem(key, given, number)
            reals(n + 1:end) = number
          end if
          n = end
        end associate
        if (problem /= '') exit
      end do
    end if
    associate (value => deck%value(k))
      value%user = .true.
      value%attempted = .true.
      value%valid = problem == ''
      value%place = place
      if (value%valid) then
        call move_alloc(reals, value%reals)
        call move_alloc(texts, value%texts)
      else
        call deck%faults%add(place_t(list%tokens(i)%line, place%setting, place%argument), problem)
      end if
    end associate
  end subroutine take_values

  !> '' or the problem of one word: a text without quotes, a number with quotes, or one with a unit.
  function form_problem(key, token, given, is_setting) result(problem)
    type(key_t), intent(in) :: key
    type(token_t), intent(in) :: token
    character(*), intent(in) :: given
    logical, intent(in) :: is_setting     !! where a text needs no quotes
    character(:), allocatable :: problem, unreadable
    real(wp) :: number

    problem = ''
    if (is_text(key)) then
      if (token%quote == ' ' .and. .not. is_setting) &
        problem = "'"//excerpt(given)//"' is not text: '"//trim(key%name)//"' takes text in quotes"
    else if (token%quote /= ' ' .and. .not. is_word_of(key, given)) then
      problem = "'"//excerpt(given)//"' is text: '"//trim(key%name)//"' takes "// &
                trim(merge('an integer   ', 'a real number', key%kind == integer_kind))//' without quotes'//or_word(key)
    end if
    if (problem /= '' .or. token%unit == '') return
    problem = "'"//excerpt(given//' '//trim(token%unit))//"' has a unit: '"//trim(key%name)//"' takes the number alone"
    if (key%unit /= '' .and. key%unit /= '1') problem = problem//', in '//trim(key%unit)
    call read_real(given, number, unreadable)
    number = number*factor_of(token%unit, key%unit)
    if (unreadable == '' .and. factor_of(token%unit, key%unit) > 0.0_wp) problem = problem//': '//number_text(number, 9)
  end function form_problem

  !> '' or what is wrong with a word that should be the `number` of a key.
  function number_problem(key, given, number) result(problem)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given
    real(wp), intent(out) :: number
    character(:), allocatable :: problem, kind
    integer(int64) :: integer
    type(value_t) :: standard

    problem = ''
    number = automatic
    if (is_word_of(key, given)) return
    if (key%kind == integer_kind) then
      kind = 'an integer, like 1000'
      call read_integer(given, integer, problem)
      number = real(integer, wp)
      if (problem == '' .and. abs(number) >= most_whole) problem = 'is not below 2^53'
    else
      kind = 'a finite real number, like 1.0 or 2.5e-3'
      call read_real(given, number, problem)
    end if
    if (problem /= '') then
      problem = "'"//excerpt(given)//"' "//problem//": '"//trim(key%name)//"' takes "//kind//or_word(key)
    else if (.not. in_range(key%range, number)) then
      ! The value that switches an unused key off may be outside its range.
      call set_default(key, standard)
      if (.not. (key%required .and. any(abs(standard%reals - number) <= 0.0_wp))) problem = out_of_range_text(key, given)
    end if
  end function number_problem

  !> '' or the problem of one text: its length, or that it is none of the choices.
  function text_problem(key, given) result(problem)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given
    character(:), allocatable :: problem

    problem = ''
    if (len(given) > longest_text) then
      problem = "'"//excerpt(given)//"' is too long for '"//trim(key%name)//"': "//integer_text(len(given))// &
                ' bytes given, at most '//integer_text(longest_text)//' allowed'
    else if (key%choices /= '') then
      problem = choice_problem(key, given)
    else if (names_file(key) .and. len_trim(given) < len(given)) then
      problem = "file name '"//excerpt(given)//"' of '"//trim(key%name)//"' ends with a blank: remove the blank"
    end if
    if (scan(given, achar(10)//achar(13)) > 0) problem = "control characters in '"//trim(key%name)//"': give plain text"
  end function text_problem

  !> Keys that the user set although nothing uses them, or to a value that only an unused key may have. A key of the file that a
  !> setting makes useless is left out, with a note.
  subroutine check_keys(deck)
    type(deck_t), intent(inout) :: deck
    integer :: i

    do i = 1, key_count
      associate (key => schema(i), value => deck%value(i))
        if (.not. (value%user .and. value%valid)) cycle
        if (usage(deck, i) > used .and. .not. is_default(key, value)) then
          if (value%place%setting == 0 .and. deck%value(usage(deck, i))%place%setting > 0) then
            call deck%notes%add(value%place, "note: '"//trim(key%name)//"' is not used with "//failing_condition(deck, i)// &
                    ' and is left out')
            call set_default(key, value)
            cycle
          end if
          call deck%faults%add(value%place, "'"//trim(key%name)//"' is not used with "//failing_condition(deck, i)// &
                    ': remove it, it works only with '//condition_text(key))
        else if (usage(deck, i) == used .and. key%kind == real_kind) then
          if (.not. (in_range(key%range, value%reals(1)) .or. is_automatic(key, value%reals(1)))) &
            call deck%faults%add(value%place, out_of_range_text(key, real_text(value%reals(1)))//' with '//condition_text(key))
        end if
      end associate
    end do
  end subroutine check_keys

  !> Keys without default that the deck needs and does not have.
  subroutine check_missing(deck, line_of, end_line)
    type(deck_t), intent(inout) :: deck
    integer, intent(in) :: line_of(:), end_line
    character(:), allocatable :: group, missing
    integer :: g, i

    do g = 1, size(line_of)
      group = word(group_names, g)
      missing = ''
      do i = 1, key_count
        if (schema(i)%group /= group .or. .not. schema(i)%required) cycle
        if (deck%value(i)%attempted .or. usage(deck, i) /= used) cycle
        if (line_of(g) > 0) call deck%faults%add(place_t(line_of(g)), missing_text(schema(i)))
        missing = missing//' '//trim(schema(i)%name)
      end do
      if (line_of(g) == 0 .and. missing /= '') &
        call deck%faults%add(place_t(end_line), 'group &'//group//' is missing: add it with'//missing)
    end do
  end subroutine check_missing

  function missing_text(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text

    text = "'"//trim(key%name)//"' is missing in &"//trim(key%group)
    if (has_other_condition(key)) text = text//' (needed with '//condition_text(key)//')'
    text = text//': add '//trim(key%name)//' = VALUE'
    if (key%unit /= '' .and. key%unit /= '1') text = text//' in '//trim(key%unit)
    text = text//', the '//trim(key%meaning)
  end function missing_text

  !> A fixed step cannot end at the events of the exact contact; rodas4p supports no contact.
  subroutine check_contact(deck)
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: method

    if (.not. (deck%value(find_name('method'))%valid .and. deck%value(find_name('contact'))%valid)) return
    if (.not. deck%is_used('integrator', 'method')) return
    method = deck%text_of('integrator', 'method')
    if (method == 'rodas4p') then
      if (deck%text_of('scene', 'model') /= 'low_frequency') call deck%refuse('integrator', 'method', &
        "method 'rodas4p' is for sweeps of model 'low_frequency': choose another method")
      if (deck%real_of('system', 'damping_x') > 0.0_wp) call deck%refuse('system', 'damping_x', &
        "method 'rodas4p' knows no damping_x: use radau9, or damping_x = 0.0")
      if (.not. is_exponential(deck)) call deck%refuse('integrator', 'method', &
        "method 'rodas4p' follows friction that falls exponentially: choose law = 'weakening', or method 'radau9'")
    else if (has_word(fixed_step_methods, method)) then
      if (deck%text_of('scene', 'model') == 'full' .and. deck%text_of('friction', 'contact') == 'exact') &
        call deck%refuse('integrator', 'method', "method '"//method//"' cannot follow the exact contact of model 'full': "// &
        "choose contact = 'smoothed', or method "//alternatives(adaptive_methods))
    end if
  end subroutine check_contact

  !> Whether rodas4p supports the law. A coefficient that is varied is checked in each case.
  pure logical function is_exponential(deck)
    type(deck_t), intent(in) :: deck

    is_exponential = deck%text_of('friction', 'law') /= 'table'
    if (deck%text_of('friction', 'law') == 'stribeck') &
      is_exponential = abs(deck%real_of('friction', 'exponent') - 1.0_wp) + deck%real_of('friction', 'viscous') <= 0.0_wp
  end function is_exponential

  !> A column can be requested once; 'default' must be alone.
  subroutine check_fields(deck)
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: choices, choice
    integer :: i

    associate (value => deck%value(find_name('fields')))
      if (.not. value%valid) return
      choices = schema(find_name('fields'))%choices
      do i = 1, word_count(choices)
        choice = word(choices, i)
        if (count(value%texts == choice) > 1) &
          call deck%refuse('output', 'fields', "'"//choice//"' more than once in 'fields': name each column once")
      end do
      if (size(value%texts) > 1 .and. any(value%texts == 'default')) call deck%refuse('output', 'fields', &
        "'default' among other 'fields': give 'default' alone, or the columns by name")
    end associate
  end subroutine check_fields
end module dst_deck
