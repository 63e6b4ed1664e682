!> Reads a deck: Fortran namelist text, checked against the schema. All faults of a deck are reported at once.
module dst_deck
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, raise_lines, deck_error
  use dst_text, only: lower_case, word, word_count, nearest_word, alternatives, excerpt, integer_text, real_text, &
                      read_real, read_integer
  use dst_faults, only: faults_t, place_t
  use dst_methods, only: method_t, method_named, adaptive_methods
  use dst_plain_numbers, only: number_text
  use dst_namelist, only: namelist_t, scan_namelist, scan_values, token_text, last_line, is_plain_text
  use dst_schema, only: key_t, schema, key_count, group_names, find_key, find_name, is_text, names_file, keys_of, in_range, &
                        range_text, choice_problem, condition_text, sweep_group, longest_text, most_values, automatic, &
                        is_automatic, is_word_of, real_kind, reals_kind, integer_kind, text_kind, texts_kind, choice_kind
  use dst_deck_values, only: deck_t, value_t, usage, excluding_key, failing_condition, set_default, is_default, used, unused
  use dst_deck_text, only: resolved, template, has_model, has_other_condition
  use dst_deck_sweep, only: check_sweep
  use dst_friction_table, only: take_friction_table
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
      call take_groups(list, deck, line_of)
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
      call check_sweep(deck, line_of(group_number(sweep_group)), needs_no_grid)
    end if
    if (deck%faults%count > 0) call raise_lines(error, deck_error, deck%faults%report(name))
  end subroutine parse_deck

  !> The groups and assignments of a scanned deck. `line_of` is the line of each known group, 0 if it is absent.
  subroutine take_groups(list, deck, line_of)
    type(namelist_t), intent(in) :: list
    type(deck_t), intent(inout) :: deck
    integer, intent(out) :: line_of(:)
    character(:), allocatable :: group, nearest
    integer :: i, g

    line_of = 0
    nearest = ''
    do i = 1, list%group_count
      group = lower_case(trim(list%groups(i)%name))
      if (group == '') cycle
      g = group_number(group)
      if (g == 0) then
        call deck%faults%add(list%groups(i)%line, unknown_group_text(trim(list%groups(i)%name)))
        ! Its keys are not missing: they are in the group with the wrong name.
        nearest = nearest_word(group, group_names)
        if (nearest /= '') where (schema%group == nearest) deck%value%attempted = .true.
      else if (line_of(g) > 0) then
        call deck%faults%add(list%groups(i)%line, 'group &'//group//' given again: it began in line '// &
                        integer_text(line_of(g))//', put all its keys there')
      else
        line_of(g) = list%groups(i)%line
      end if
    end do
    if (list%group_count == 0 .and. deck%faults%count == 0) &
      call deck%faults%add(1, 'no group in the deck: it needs at least &scene, see dynstiction template')
    do i = 1, list%assignment_count
      if (deck%faults%full()) exit
      call take_assignment(list, i, line_of, deck)
    end do
  end subroutine take_groups

  !> Number of a group in `group_names`; 0 if unknown.
  pure integer function group_number(group)
    character(*), intent(in) :: group
    integer :: i

    group_number = 0
    do i = 1, word_count(group_names)
      if (word(group_names, i) == group) group_number = i
    end do
  end function group_number

  function unknown_group_text(group) result(text)
    character(*), intent(in) :: group
    character(:), allocatable :: text

    if (nearest_word(group, group_names) /= '') then
      text = "unknown group '&"//excerpt(group)//"': the nearest is &"//nearest_word(group, group_names)
    else
      text = "unknown group '&"//excerpt(group)//"': the groups are "//group_names
    end if
  end function unknown_group_text

  subroutine take_assignment(list, i, line_of, deck)
    type(namelist_t), intent(in) :: list
    integer, intent(in) :: i
    integer, intent(in) :: line_of(:)   !! of each known group, 0 if it is absent
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: group, key
    integer :: k

    associate (assignment => list%assignments(i))
      group = lower_case(trim(list%groups(assignment%group)%name))
      key = lower_case(trim(assignment%key))
      ! The keys of a group with a wrong name belong to the nearest group, if the deck does not have that one, too.
      if (group_number(group) == 0) then
        group = nearest_word(group, group_names)
        if (group == '') return
        if (line_of(group_number(group)) > 0) return
      end if
      if (key == '') return
      k = find_key(group, key)
      if (k == 0) then
        if (.not. assignment%bare) call deck%faults%add(assignment%line, unknown_key_text(group, trim(assignment%key)))
        ! The key that was meant is not missing as well.
        k = find_name(key)
        if (k == 0) k = meant_key(group, key)
        if (k > 0) deck%value(k)%attempted = .true.
      else if (deck%value(k)%attempted .and. deck%value(k)%place%line > 0) then
        call deck%faults%add(assignment%line, "'"//key//"' given again: it stands in line "// &
                        integer_text(deck%value(k)%place%line)//' already, keep one of them')
      else if (assignment%faulty) then
        deck%value(k)%attempted = .true.
        deck%value(k)%valid = .false.
        deck%value(k)%place%line = assignment%line
      else
        call take_values(schema(k), list, assignment%first, assignment%last, place_t(line=assignment%line), deck%value(k), &
                         deck%faults)
      end if
    end associate
  end subroutine take_assignment

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

  !> 'group.key=value' from the command line.
  subroutine take_setting(text, setting, deck)
    character(*), intent(in) :: text
    integer, intent(in) :: setting
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: group, key, problem
    type(place_t) :: place
    integer :: equals, dot, k

    place = place_t(setting=setting, argument=excerpt(text))
    k = 0
    equals = index(text, '=')
    dot = index(text(:max(0, equals - 1)), '.')
    group = lower_case(trim(adjustl(text(:max(0, dot - 1)))))
    key = trim(adjustl(text(dot + 1:max(dot, equals - 1))))
    problem = ''
    if (.not. is_plain_text(text)) then
      problem = 'control characters, or a character that is not UTF-8: give plain UTF-8 text'
    else if (equals == 0) then
      problem = "no '=': write --set GROUP.KEY=VALUE"
    else if (dot == 0) then
      problem = 'no group: write --set GROUP.KEY=VALUE'
      k = find_name(lower_case(key))
      if (k > 0) problem = 'no group: write --set '//trim(schema(k)%group)//'.'//trim(schema(k)%name)//'=VALUE'
    else if (group_number(group) == 0) then
      problem = unknown_group_text(group)
    else
      k = find_key(group, lower_case(key))
      if (k == 0) problem = unknown_key_text(group, key)
    end if
    if (len(problem) > 0) then
      call deck%faults%add(place, problem)
    else
      call set_value(schema(k), adjustl(text(equals + 1:)), place, deck%value(k), deck%faults)
    end if
  end subroutine take_setting

  !> The value of a setting: an empty one removes the key from the deck. Text needs no quotes there: the shell has removed one pair
  !> already.
  subroutine set_value(key, text, place, value, faults)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: text
    type(place_t), intent(in) :: place
    type(value_t), intent(inout) :: value
    type(faults_t), intent(inout) :: faults
    type(namelist_t) :: list
    character(:), allocatable :: problem

    if (value%place%setting > 0) then
      call faults%add(place, "'"//trim(key%name)//"' set again: a --set before sets it already, keep one of them")
      return
    end if
    if (len_trim(text) == 0) call set_default(key, value)
    value%place%setting = place%setting
    if (len_trim(text) == 0) return
    if (any(key%kind == [text_kind, choice_kind]) .and. scan(text, '''"') /= 1) then
      call start_value(place, value)
      value%texts = [character(longest_text) :: text]
      problem = text_problem(key, trim(text))
    else
      call scan_values(trim(text), trim(key%name), list, problem)
      if (len(problem) == 0) call take_values(key, list, 1, list%token_count, place, value, faults)
    end if
    value%attempted = .true.
    if (len(problem) == 0) return
    value%valid = .false.
    call faults%add(place, problem)
  end subroutine set_value

  subroutine start_value(place, value)
    type(place_t), intent(in) :: place
    type(value_t), intent(inout) :: value

    value%user = .true.
    value%attempted = .true.
    value%valid = .true.
    value%place = place
  end subroutine start_value

  !> Convert the words `first` to `last` to the value of a key. If several words have the wrong form, or if there are too many, only
  !> the first is a fault.
  subroutine take_values(key, list, first, last, place, value, faults)
    type(key_t), intent(in) :: key
    type(namelist_t), intent(in) :: list
    integer, intent(in) :: first, last
    type(place_t), intent(in) :: place
    type(value_t), intent(inout) :: value
    type(faults_t), intent(inout) :: faults
    real(wp), allocatable :: reals(:)
    character(longest_text), allocatable :: texts(:)
    character(:), allocatable :: given, problem
    integer(int64) :: total, most
    integer :: i, n

    call start_value(place, value)
    do i = first, last
      ! The text of a setting needs no quotes.
      call refuse(form_problem(key, list%tokens(i)%quote /= ' ' .or. (place%setting > 0 .and. is_text(key)), &
                               token_text(list, list%tokens(i))))
      if (value%valid .and. list%tokens(i)%unit /= '') call refuse(unit_problem(key, token_text(list, list%tokens(i)), &
                               trim(list%tokens(i)%unit)))
      if (.not. value%valid) return
    end do
    total = 0_int64
    most = merge(most_values, 1, key%kind == reals_kind .or. key%kind == texts_kind)
    do i = first, last
      total = total + list%tokens(i)%repeat
      if (total > most) &
        call refuse("too many values for '"//trim(key%name)//"', from '"//excerpt(token_text(list, list%tokens(i)))// &
                    "' on: "//integer_text(sum(int(list%tokens(first:last)%repeat, int64)))//' given, at most '// &
                    integer_text(most)//' allowed')
      if (.not. value%valid) return
    end do
    allocate (reals(merge(0_int64, total, is_text(key))))
    allocate (texts(merge(total, 0_int64, is_text(key))))
    n = 0
    do i = first, last
      given = token_text(list, list%tokens(i))
      associate (end => n + list%tokens(i)%repeat)
        if (is_text(key)) then
          call refuse(text_problem(key, given))
          texts(n + 1:end) = given
        else
          call read_number(key, given, reals(n + 1), problem)
          call refuse(problem)
          reals(n + 2:end) = reals(n + 1)
        end if
        n = end
      end associate
    end do
    if (size(reals) > 0) call move_alloc(reals, value%reals)
    if (size(texts) > 0) call move_alloc(texts, value%texts)

  contains

    !> Note the fault of word `i`.
    subroutine refuse(problem)
      character(*), intent(in) :: problem

      if (len(problem) == 0) return
      value%valid = .false.
      call faults%add(place_t(list%tokens(i)%line, place%setting, place%argument), problem)
    end subroutine refuse
  end subroutine take_values

  !> The problem of a number with a unit, and its value without the unit.
  function unit_problem(key, given, unit) result(problem)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given, unit
    character(:), allocatable :: problem, unreadable
    real(wp) :: number

    problem = "'"//excerpt(given//' '//unit)//"' has a unit: '"//trim(key%name)//"' takes the number alone"
    if (key%unit /= '' .and. key%unit /= '1') problem = problem//', in '//trim(key%unit)
    call read_real(given, number, unreadable)
    if (unreadable == '' .and. factor_of(unit, trim(key%unit)) > 0.0_wp) &
      problem = problem//': '//number_text(number*factor_of(unit, trim(key%unit)), 9)
  end function unit_problem

  !> '' or the problem of one word: a text without quotes, or a number with quotes.
  function form_problem(key, is_quoted, given) result(problem)
    type(key_t), intent(in) :: key
    logical, intent(in) :: is_quoted
    character(*), intent(in) :: given
    character(:), allocatable :: problem

    problem = ''
    if (is_quoted .eqv. is_text(key)) return
    if (is_word_of(key, given)) return
    if (is_text(key)) then
      problem = "'"//excerpt(given)//"' is not text: '"//trim(key%name)//"' takes text in quotes"
    else
      problem = "'"//excerpt(given)//"' is text: '"//trim(key%name)//"' takes "// &
                trim(merge('an integer   ', 'a real number', key%kind == integer_kind))//' without quotes'//or_word(key)
    end if
  end function form_problem

  !> A number of a key; `problem` is '' or says what is wrong with the word.
  subroutine read_number(key, given, number, problem)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given
    real(wp), intent(out) :: number
    character(:), allocatable, intent(out) :: problem
    character(:), allocatable :: kind
    integer(int64) :: integer
    type(value_t) :: alone

    if (key%kind == integer_kind) then
      kind = 'an integer, like 1000'
      call read_integer(given, integer, problem)
      number = real(integer, wp)
      if (problem == '' .and. abs(number) >= most_whole) problem = 'is not below 2^53'
    else
      kind = 'a finite real number, like 1.0 or 2.5e-3'
      call read_real(given, number, problem)
    end if
    if (is_word_of(key, given)) then
      number = automatic
      problem = ''
    else if (len(problem) > 0) then
      problem = "'"//excerpt(given)//"' "//problem//": '"//trim(key%name)//"' takes "//kind//or_word(key)
    else if (.not. in_range(key%range, number)) then
      ! The value that switches an unused key off may be outside its range.
      alone%reals = [number]
      if (.not. (key%required .and. is_default(key, alone))) problem = out_of_range_text(key, given)
    end if
  end subroutine read_number

  function out_of_range_text(key, given) result(text)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given
    character(:), allocatable :: text

    text = trim(key%name)//" = '"//excerpt(given)//"' is out of range: it must be "//range_text(key)
    if (key%unit /= '1') text = text//' (in '//trim(key%unit)//')'
    text = text//or_word(key)
  end function out_of_range_text

  !> ", or 'auto'" for a key of numbers that also accepts this word.
  function or_word(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text

    text = ''
    if (.not. is_text(key) .and. key%choices /= '') text = ", or '"//trim(key%choices)//"'"
  end function or_word

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
        if (usage(deck, i) == unused .and. .not. is_default(key, value)) then
          if (value%place%setting == 0 .and. deck%value(excluding_key(deck, i))%place%setting > 0) then
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
        if (line_of(g) > 0) call deck%faults%add(line_of(g), missing_text(schema(i)))
        missing = missing//' '//trim(schema(i)%name)
      end do
      if (line_of(g) == 0 .and. missing /= '') &
        call deck%faults%add(end_line, 'group &'//group//' is missing: add it with'//missing)
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
    type(method_t) :: method
    character(:), allocatable :: model, contact

    associate (given => deck%value(find_key('integrator', 'method')))
      if (.not. (given%valid .and. deck%value(find_key('friction', 'contact'))%valid)) return
      if (usage(deck, find_key('integrator', 'method')) /= used) return
      method = method_named(deck%text_of('integrator', 'method'))
      contact = deck%text_of('friction', 'contact')
      model = deck%text_of('scene', 'model')
      if (method%name == 'rodas4p' .and. model /= 'low_frequency') &
        call deck%faults%add(given%place, "method 'rodas4p' is for sweeps of model 'low_frequency': choose another method")
      if (method%name == 'rodas4p' .and. deck%real_of('system', 'damping_x') > 0.0_wp) call deck%faults%add( &
        deck%value(find_key('system', 'damping_x'))%place, "method 'rodas4p' knows no damping_x: use radau9, or damping_x = 0.0")
      if (method%name == 'rodas4p' .and. .not. is_exponential(deck)) &
        call deck%faults%add(given%place, "method 'rodas4p' follows friction that falls exponentially: choose "// &
                        "law = 'weakening', or method 'radau9'")
      if (model /= 'full') return
      if (method%kind == 'fixed_step' .and. contact == 'exact') &
        call deck%faults%add(given%place, "method '"//trim(method%name)//"' cannot follow the exact contact of model 'full': "// &
                        "choose contact = 'smoothed', or method "//alternatives(adaptive_methods))
    end associate
  end subroutine check_contact

  !> Whether rodas4p supports the law. A coefficient that is varied is checked in each case.
  pure logical function is_exponential(deck)
    type(deck_t), intent(in) :: deck

    is_exponential = deck%text_of('friction', 'law') /= 'table'
    if (deck%text_of('friction', 'law') == 'stribeck') &
      is_exponential = abs(deck%real_of('friction', 'exponent') - 1.0_wp) + deck%real_of('friction', 'viscous') <= 0.0_wp
  end function is_exponential

  !> The corners of the drive: as many times as velocities, from 0 on, never decreasing, with a jump between two velocities.
  subroutine check_drive(deck)
    type(deck_t), intent(inout) :: deck
    type(place_t) :: place
    integer :: i

    associate (time => deck%value(find_key('drive', 'time')), velocity => deck%value(find_key('drive', 'velocity')))
      if (.not. (velocity%user .and. velocity%valid .and. time%valid)) return
      place = velocity%place
      if (time%user) place = time%place
      if (size(time%reals) /= size(velocity%reals)) then
        call deck%faults%add(place, integer_text(size(velocity%reals))//" value(s) of 'velocity' but "// &
          integer_text(size(time%reals))//" of 'time': give one velocity for each time, or one velocity alone")
        return
      end if
      if (abs(time%reals(1)) > 0.0_wp) call deck%faults%add(place, "time(1) = '"//real_text(time%reals(1))// &
                                                 "' is not the start: the first time must be 0.0 s")
      do i = 2, size(time%reals)
        if (time%reals(i) < time%reals(i - 1)) then
          call deck%faults%add(place, 'time('//integer_text(i)//") = '"//real_text(time%reals(i))// &
            "' is before the time ahead of it, "//real_text(time%reals(i - 1))//' s: times must not decrease')
        else if (repeats_too_often(time%reals(:i))) then
          call deck%faults%add(place, 'time('//integer_text(i)//") = '"//real_text(time%reals(i))//"' "// &
                    'repeats a time once too often: give a time twice for a jump, but not 0.0 s')
        else
          cycle
        end if
        ! A fault after a wrong corner is seldom one of its own.
        exit
      end do
    end associate
  end subroutine check_drive

  !> Whether the last of these times is the third of its kind, or the second at the start, where there can be no jump.
  pure logical function repeats_too_often(time)
    real(wp), intent(in) :: time(:)

    associate (n => size(time))
      repeats_too_often = time(n) <= time(max(1, n - 2)) .and. (n > 2 .or. time(n) <= 0.0_wp)
    end associate
  end function repeats_too_often

  !> A column can be requested once; 'default' must be alone.
  subroutine check_fields(deck)
    type(deck_t), intent(inout) :: deck
    integer :: i, k
    character(:), allocatable :: choice

    k = find_key('output', 'fields')
    associate (value => deck%value(k))
      if (.not. value%valid) return
      do i = 1, word_count(schema(k)%choices)
        choice = word(schema(k)%choices, i)
        if (count(value%texts == choice) > 1) &
          call deck%faults%add(value%place, "'"//choice//"' more than once in 'fields': name each column once")
      end do
      if (size(value%texts) > 1 .and. any(value%texts == 'default')) &
        call deck%faults%add(value%place, "'default' among other 'fields': give 'default' alone, or the columns by name")
    end associate
  end subroutine check_fields
end module dst_deck
