!> The group &sweep of a deck: checks which keys may be varied, and whether its lists fit together.
module dst_deck_sweep
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
  use dst_kinds, only: wp
  use dst_curves, only: lengths_text
  use dst_deck_values, only: deck_t, usage, failing_condition, element_count, is_default, used
  use dst_faults, only: place_t
  use dst_schema, only: schema, sweep_group, find_key, in_range, is_automatic, is_text, range_text, reals_kind, &
                        integer_kind, longest_text
  use dst_text, only: lower_case, excerpt, real_text, has_word, alternatives
  use dst_writer, only: absent
  implicit none
  private

  public :: check_sweep, varied_key, variation_problem, range_problem, grid_cases, grid_keys, many_cases

  !> The keys that make a grid; an option --vary gives one element of each.
  character(9), parameter :: grid_keys(5) = [character(9) :: 'parameter', 'first', 'last', 'count', 'spacing']
  !> Groups whose keys describe how a case is written, not the case itself.
  character(*), parameter :: fixed_groups = 'output sweep'
  !> Models whose load on the soft spring rises and falls.
  character(*), parameter :: models_with_cycles = 'full low_frequency'
  !> Largest number of cases in one result file.
  real(wp), parameter :: many_cases = 1.0e9_wp

contains

  !> All faults of the group; `line` is its line in the deck, 0 if it is absent. Consequences of another fault are not reported. If
  !> the parameters come from elsewhere (`is_varied`), the deck's own grid is ignored.
  subroutine check_sweep(deck, line, is_varied)
    type(deck_t), intent(inout) :: deck
    integer, intent(in) :: line
    logical, intent(in) :: is_varied
    character(longest_text), allocatable :: names(:)
    character(:), allocatable :: model
    integer, allocatable :: keys(:)
    type(place_t) :: place
    integer :: i, n
    logical :: keeps_series
    real(wp) :: interval

    if (line == 0 .and. .not. deck%is_sweep()) return
    keeps_series = deck%text_of(sweep_group, 'keep') == 'series' .and. is_known(deck, 'keep')
    if (deck%text_of('scene', 'model') == 'auto') call deck%refuse('scene', 'model', &
      "model 'auto' in a sweep would mix models in one map: name the model")
    interval = deck%real_of('output', 'interval')
    if (keeps_series .and. .not. (interval > 0.0_wp .or. is_automatic(schema(find_key('output', 'interval')), interval))) &
      call deck%refuse(sweep_group, 'keep', "keep 'series' needs the same times in every case: give output.interval > 0")
    if (keeps_series .and. deck%text_of('integrator', 'method') == 'rodas4p') &
      call deck%refuse('integrator', 'method', "method 'rodas4p' keeps no series: use radau9, or keep = 'summary'")
    model = deck%text_of('scene', 'model')
    if (deck%text_of(sweep_group, 'keep') == 'cycles' .and. is_known(deck, 'keep') .and. &
        .not. has_word(models_with_cycles//' auto', model)) call deck%refuse(sweep_group, 'keep', "keep 'cycles': model '"// &
      model//"' has no stick-slip cycles: use keep = 'summary', or model "//alternatives(models_with_cycles))
    allocate (names, source=deck%texts_of(sweep_group, 'parameter'))
    n = size(names)
    allocate (keys, source=[(varied_key(trim(names(i))), i=1, n)])
    if (keeps_series .and. any(keys == find_key('scene', 't_end'))) &
      call deck%refuse(sweep_group, 'keep', "keep 'series' needs the same times in every case: do not vary scene.t_end")
    if (.not. (is_known(deck, 'parameter') .and. is_known(deck, 'points'))) return
    if (deck%text_of(sweep_group, 'points') /= '') then
      call check_no_grid(deck)
      return
    else if (names(1) == '') then
      if (is_varied) return
      ! At the group, or at the first of its keys if only a setting gives some.
      place = place_t(line)
      if (line == 0) place = deck%value(findloc(deck%value%user .and. schema%group == sweep_group, .true., dim=1))%place
      call deck%faults%add(place, "&sweep varies nothing: name parameter = 'GROUP.KEY', or points = 'FILE'")
      return
    end if
    call check_lengths(deck, n)
    do i = 1, n
      call check_axis(deck, trim(names(i)), i)
      if (keys(i) > 0 .and. any(keys(:i - 1) == keys(i))) &
        call deck%refuse(sweep_group, 'parameter', "'"//trim(names(i))//"' is varied twice: name it once")
    end do
    if (is_known(deck, 'count') .and. grid_cases(deck) > many_cases) &
      call deck%refuse(sweep_group, 'count', 'more than '//real_text(many_cases)//' cases: use smaller counts')
  end subroutine check_sweep

  !> Whether the value of a key of the group is valid: neither faulty, nor given under a wrong name.
  pure logical function is_known(deck, key)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: key

    associate (value => deck%value(find_key(sweep_group, key)))
      is_known = value%valid .and. (value%user .or. .not. value%attempted)
    end associate
  end function is_known

  !> Number of cases of the grid, exact unless there are more than a result file may have.
  pure real(wp) function grid_cases(deck) result(cases)
    type(deck_t), intent(in) :: deck
    integer :: i

    cases = 1.0_wp
    associate (counts => deck%value(find_key(sweep_group, 'count'))%reals)
      do i = 1, size(counts)
        if (cases <= many_cases) cases = cases*counts(i)
      end do
    end associate
  end function grid_cases

  !> A list of points must be alone.
  subroutine check_no_grid(deck)
    type(deck_t), intent(inout) :: deck
    integer :: i, k

    do i = 1, size(grid_keys)
      k = find_key(sweep_group, grid_keys(i))
      if (deck%value(k)%user .and. .not. is_default(schema(k), deck%value(k))) call deck%refuse(sweep_group, grid_keys(i), &
        "'"//trim(grid_keys(i))//"' beside 'points': give a grid or a list of points")
    end do
  end subroutine check_no_grid

  !> As many limits and counts as parameters; one spacing, or as many as parameters.
  subroutine check_lengths(deck, n)
    type(deck_t), intent(inout) :: deck
    integer, intent(in) :: n
    integer :: i, given

    do i = 1, size(grid_keys)
      given = element_count(deck%value(find_key(sweep_group, grid_keys(i))))
      if (given == n .or. (given == 1 .and. grid_keys(i) == 'spacing') .or. .not. is_known(deck, grid_keys(i))) cycle
      call deck%refuse(sweep_group, grid_keys(i), lengths_text(given, trim(grid_keys(i)), n, 'parameter', 'one for each'))
    end do
  end subroutine check_lengths

  !> One parameter and its values.
  subroutine check_axis(deck, name, i)
    type(deck_t), intent(inout) :: deck
    character(*), intent(in) :: name
    integer, intent(in) :: i
    character(:), allocatable :: problem
    character(longest_text), allocatable :: spacing(:)
    real(wp) :: first, last, number
    logical :: is_log

    number = element('count')
    if (ieee_is_nan(number)) number = 1.0_wp
    if (abs(number - anint(number)) > 0.0_wp) call deck%refuse(sweep_group, 'count', &
      real_text(number)//' is no whole number: count says how many values '//name//' has')
    problem = variation_problem(deck, name)
    if (problem /= '') then
      call deck%refuse(sweep_group, 'parameter', problem)
      return
    end if
    first = element('first')
    last = element('last')
    call check_limit('first', first)
    call check_limit('last', last)
    if (ieee_is_nan(first + last) .or. .not. is_known(deck, 'spacing')) return
    ! One for all parameters, or one for each.
    spacing = deck%texts_of(sweep_group, 'spacing')
    is_log = spacing(min(i, size(spacing))) == 'log'
    if (is_log .and. .not. (min(first, last) > 0.0_wp .or. max(first, last) < 0.0_wp)) &
      call deck%refuse(sweep_group, 'spacing', "spacing 'log' of "//name//' from '//real_text(first)// &
      ' to '//real_text(last)//': both must have the same sign, and not be 0')

  contains

    !> The value of this parameter in a list; NaN if it is not there.
    real(wp) function element(key)
      character(*), intent(in) :: key

      element = absent()
      associate (list => deck%value(find_key(sweep_group, key))%reals)
        if (is_known(deck, key) .and. size(list) >= i) element = list(i)
      end associate
    end function element

    subroutine check_limit(key, value)
      character(*), intent(in) :: key
      real(wp), intent(in) :: value

      if (ieee_is_nan(value)) return
      problem = range_problem(varied_key(name), value)
      if (problem /= '') call deck%refuse(sweep_group, key, problem)
    end subroutine check_limit
  end subroutine check_axis

  !> Index of the key 'group.name' in the schema; 0 if there is none.
  pure integer function varied_key(name)
    character(*), intent(in) :: name
    integer :: dot

    dot = index(name, '.')
    varied_key = find_key(lower_case(name(:max(0, dot - 1))), lower_case(trim(name(dot + 1:))))
  end function varied_key

  !> Why the deck's key 'group.name' cannot be varied; '' if it can.
  function variation_problem(deck, name) result(problem)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: name
    character(:), allocatable :: problem
    integer :: k

    problem = ''
    k = varied_key(name)
    if (k == 0) then
      problem = "there is no key '"//excerpt(name)//"': name it as GROUP.KEY, like system.misalignment_deg"
    else if (has_word(fixed_groups, trim(schema(k)%group)) .or. is_text(schema(k))) then
      problem = "'"//name//"' cannot be varied: name a number of &scene, &system, &friction, &drive, &initial or &integrator"
    else if (schema(k)%name == 'mu_0' .and. deck%text_of('friction', 'law') == 'table' .and. &
             usage(deck, find_key('friction', 'law')) == used) then
      problem = "'"//name//"' is the first friction coefficient of the table: vary another key"
    else if (usage(deck, k) > used) then
      problem = "'"//name//"' is not used with "//failing_condition(deck, k)//': vary another key'
    else if (schema(k)%kind == reals_kind .and. deck%value(k)%valid .and. deck%value(k)%user .and. &
             size(deck%reals_of(trim(schema(k)%group), trim(schema(k)%name))) /= 1) then
      problem = "'"//name//"' is a list in this deck: only a single value can be varied"
    end if
  end function variation_problem

  !> Why key `k` cannot have this value; '' if it can.
  function range_problem(k, value) result(problem)
    integer, intent(in) :: k
    real(wp), intent(in) :: value
    character(:), allocatable :: problem

    problem = ''
    if (.not. ieee_is_finite(value)) then
      problem = 'a value of '//trim(schema(k)%name)//' is not finite: give a finite number'
    else if (.not. in_range(schema(k)%range, value)) then
      problem = real_text(value)//' is out of range for '//trim(schema(k)%name)//': it must be finite'
      if (range_text(schema(k)) /= '') problem = problem//' and '//range_text(schema(k))
    else if (schema(k)%kind == integer_kind .and. abs(value - anint(value)) > 0.0_wp) then
      problem = real_text(value)//' is no whole number: '//trim(schema(k)%name)//' takes integers'
    end if
  end function range_problem
end module dst_deck_sweep
