!> The one table of the keys of a deck.
!>
!> The reader, `check`, `template`, the attributes of the HDF5 file, the keywords of the Python package and the manual page are made
!> from it. A key is added by adding its entry here.
module dst_schema
  use dst_kinds, only: wp, int64
  use dst_methods, only: method_names, adaptive_methods, fixed_step_methods
  use dst_text, only: name_width, unit_width, value_width, meaning_width, real_text, integer_text, &
                      has_word, nearest_word, alternatives, excerpt
  implicit none
  private

  public :: key_t, range_t, schema, key_count, group_names, sweep_group
  public :: real_kind, integer_kind, text_kind, choice_kind, reals_kind, texts_kind, kind_names
  public :: longest_text, most_values, automatic
  public :: find_key, find_name, is_text, names_file, keys_of, in_range, is_automatic, is_word_of, range_text, &
            out_of_range_text, or_word, choice_problem, condition_count, condition_text

  integer, parameter :: real_kind = 1, integer_kind = 2, text_kind = 3, choice_kind = 4
  integer, parameter :: reals_kind = 5, texts_kind = 6
  !> Their names, in the order of these numbers.
  character(*), parameter :: kind_names = 'real integer text choice reals texts'

  !> Bytes of the longest text value; numbers in the longest list.
  integer, parameter :: longest_text = 256, most_values = 10000

  !> The number that a real key has in place of the word 'auto', which leaves the value to the program: outside the key's range.
  real(wp), parameter :: automatic = -1.0_wp

  !> An interval; an open end excludes the limit.
  type :: range_t
    real(wp) :: low = -huge(1.0_wp), high = huge(1.0_wp)
    logical :: low_open = .false.
  end type range_t

  !> The condition that the key `on` has one of these choices, blank-separated.
  type :: condition_t
    character(name_width) :: on = ''
    character(128) :: choices = ''
  end type condition_t

  type :: key_t
    character(name_width) :: group
    character(name_width) :: name
    integer :: kind
    character(unit_width) :: unit
    type(range_t) :: range
    logical :: required                 !! the user must give it if it is used
    character(value_width) :: default   !! as in a deck, text without quotes; of a required key: permitted if it is not used
    character(value_width) :: sample    !! Fig. 3's value, for the template
    character(256) :: choices           !! blank-separated; '' = free; for a real key the word that it also accepts
    type(condition_t) :: used_by(2)     !! all of them must be true
    character(meaning_width) :: meaning
  end type key_t

  type(range_t), parameter :: any_real = range_t()
  type(range_t), parameter :: positive = range_t(low=0.0_wp, low_open=.true.)
  type(range_t), parameter :: non_negative = range_t(low=0.0_wp)
  type(range_t), parameter :: one_turn = range_t(low=-360.0_wp, high=360.0_wp)
  !> From 1e-13 on in double precision, from 1e-31 on in quadruple precision.
  type(range_t), parameter :: tolerances = range_t(low=10.0_wp**(2 - precision(1.0_wp)), high=1.0e-1_wp)

  !> The groups, in the order in which a deck is printed.
  character(*), parameter :: group_names = 'scene system friction drive initial integrator output sweep'
  !> The group that turns a deck into many cases; a deck without it is one run.
  character(*), parameter :: sweep_group = 'sweep'

  !> Models of the whole motion in the plane, and all models.
  character(*), parameter :: plane_models = 'full'
  character(*), parameter :: models = plane_models//' low_frequency high_frequency creep creep_asymptotic auto'
  !> Friction laws that have mu_inf and v_f, and all laws.
  character(*), parameter :: weakening_laws = 'weakening stribeck'
  character(*), parameter :: laws = 'constant table '//weakening_laws
  character(*), parameter :: columns = 'default u_x u_y w_x w_y X Y X_rate Y_rate spring_force_x spring_force_y '// &
    'friction theta psi sticking zeta pull_force theta_deg u_x_rate u_y_rate'

  type(condition_t), parameter :: none = condition_t(), always(2) = none
  type(condition_t), parameter :: dynamic(2) = [condition_t('model', plane_models//' low_frequency high_frequency auto'), none]
  type(condition_t), parameter :: elastic(2) = [condition_t('model', plane_models//' high_frequency creep auto'), none]
  type(condition_t), parameter :: soft_damped(2) = [condition_t('model', plane_models//' low_frequency auto'), none]
  type(condition_t), parameter :: transverse(2) = [condition_t('model', plane_models//' high_frequency auto'), none]
  type(condition_t), parameter :: contacts(2) = [condition_t('model', plane_models//' auto'), none]
  type(condition_t), parameter :: asymptotic(2) = [condition_t('model', 'creep_asymptotic'), none]
  type(condition_t), parameter :: undecided(2) = [condition_t('model', 'auto'), none]
  type(condition_t), parameter :: weakens(2) = [condition_t('law', weakening_laws), none]
  type(condition_t), parameter :: stribeck(2) = [condition_t('law', 'stribeck'), none]
  type(condition_t), parameter :: tabulated(2) = [condition_t('law', 'table'), none]
  type(condition_t), parameter :: exact(2) = [condition_t('contact', 'exact'), none]
  type(condition_t), parameter :: resting(2) = [condition_t('contact', 'exact'), condition_t('model', plane_models//' auto')]
  type(condition_t), parameter :: smoothed(2) = [condition_t('contact', 'smoothed'), none]
  type(condition_t), parameter :: fixed_step(2) = [condition_t('method', fixed_step_methods), none]
  type(condition_t), parameter :: adaptive(2) = [condition_t('method', adaptive_methods), none]
  type(condition_t), parameter :: leaping(2) = &
    [condition_t('method', adaptive_methods), condition_t('model', plane_models//' low_frequency high_frequency auto')]

  type(condition_t), parameter :: keeping_cycles(2) = [condition_t('keep', 'cycles'), none]

  logical, parameter :: must = .true., may = .false.

  !> group, key, kind, unit, range, required?, default, sample, choices, used_by, meaning
  type(key_t), parameter :: schema(*) = [ &
    key_t('scene', 'title', text_kind, '', any_real, may, '', 'Fig. 3, Nakano & Popov (2020)', '', always, &
          'what the scene shows; kept in the results'), &
    key_t('scene', 'model', choice_kind, '', any_real, may, 'full', '', models, always, &
          'the equations to integrate'), &
    key_t('scene', 'form', choice_kind, '', any_real, may, 'first_power', '', 'first_power printed third_order', asymptotic, &
          'form of Eq. (8): derived from Eq. (7), printed in the preprint, or with the next order'), &
    key_t('scene', 'quantities', choice_kind, '', any_real, may, 'stick_slip', '', 'stick_slip creep high_frequency', &
          undecided, 'quantities for which the model is chosen'), &
    key_t('scene', 'accuracy', real_kind, '1', range_t(low=1.0e-12_wp, high=1.0_wp), may, '1.0e-3', '', '', undecided, &
          'error against the full model that is allowed in these quantities'), &
    key_t('scene', 't_end', real_kind, 's', positive, must, '', '10.0', '', always, &
          'end of the simulated time'), &
    key_t('scene', 'settle', real_kind, '1', range_t(low=0.0_wp, high=1.0_wp), may, '0.0', '', '', dynamic, &
          'the run ends when two successive stick-slip cycles agree to this; 0 = at t_end'), &
    key_t('system', 'mass', real_kind, 'kg', positive, must, '', '0.25', '', dynamic, &
          'mass of the object'), &
    key_t('system', 'stiffness_x', real_kind, 'N/m', positive, must, '', '1.0e3', '', always, &
          'stiffness along the soft principal axis'), &
    key_t('system', 'stiffness_y', real_kind, 'N/m', positive, must, '', '1.0e7', '', elastic, &
          'stiffness along the stiff principal axis'), &
    key_t('system', 'damping_x', real_kind, 'N s/m', non_negative, may, '0.0', '', '', soft_damped, &
          'damping parallel to the spring along the soft axis'), &
    key_t('system', 'damping_y', real_kind, 'N s/m', non_negative, may, '0.0', '', '', transverse, &
          'damping parallel to the spring along the stiff axis'), &
    key_t('system', 'misalignment_deg', real_kind, 'deg', one_turn, must, '', '1.0', '', always, &
          'angle phi from the drive direction to the soft axis'), &
    key_t('friction', 'law', choice_kind, '', any_real, may, 'weakening', '', laws, dynamic, &
          'how friction depends on the slip velocity'), &
    key_t('friction', 'mu_0', real_kind, '1', non_negative, must, '', '0.20', '', always, &
          'friction coefficient F(0)/W as slip begins; with law table the first of table_mu'), &
    key_t('friction', 'mu_inf', real_kind, '1', non_negative, must, '', '0.15', '', weakens, &
          'friction coefficient at high slip velocity'), &
    key_t('friction', 'v_f', real_kind, 'm/s', positive, must, '', '0.010', '', weakens, &
          'slip velocity over which friction weakens'), &
    key_t('friction', 'exponent', real_kind, '1', range_t(low=1.0_wp, high=10.0_wp), may, '1.0', '', '', stribeck, &
          'p of (v/v_f)^p; below 1 the slope at rest would be infinite'), &
    key_t('friction', 'viscous', real_kind, 's/m', non_negative, may, '0.0', '', '', stribeck, &
          'friction coefficient that is added per slip velocity'), &
    key_t('friction', 'table_speed', reals_kind, 'm/s', non_negative, must, '0.0', '', '', tabulated, &
          'slip velocities of the points of the law, from 0 on'), &
    key_t('friction', 'table_mu', reals_kind, '1', non_negative, must, '0.0', '', '', tabulated, &
          'friction coefficients there; constant after the last'), &
    key_t('friction', 'table', text_kind, '', any_real, may, '', '', '', tabulated, &
          'CSV file of the points, a row for each: table_speed, table_mu; in place of these keys'), &
    key_t('friction', 'mu_static', real_kind, '1', non_negative, may, '0.0', '', '', exact, &
          'friction coefficient up to which rest holds, >= F(0)/W; 0 = F(0)/W'), &
    key_t('friction', 'ageing', real_kind, '1', non_negative, may, '0.0', '', '', resting, &
          'growth of this coefficient with rest: by ageing*ln(1 + time at rest/ageing_time)'), &
    key_t('friction', 'ageing_time', real_kind, 's', positive, may, '1.0', '', '', resting, &
          'time at rest from which on it grows'), &
    key_t('friction', 'normal_load', real_kind, 'N', non_negative, must, '', '10.0', '', always, &
          'normal load W'), &
    key_t('friction', 'contact', choice_kind, '', any_real, may, 'exact', '', 'exact smoothed', contacts, &
          'exact: set-valued at rest, with events; smoothed: w/sqrt(|w|^2 + v_smooth^2)'), &
    key_t('friction', 'v_smooth', real_kind, 'm/s', positive, must, '0.0', '', '', smoothed, &
          'smoothing velocity, to be far below V sin(phi)'), &
    key_t('drive', 'velocity', reals_kind, 'm/s', any_real, must, '', '1.0e-3', '', always, &
          'drive velocity: one value, or one for each time; constant after the last'), &
    key_t('drive', 'time', reals_kind, 's', non_negative, may, '0.0', '', '', always, &
          'corners of a piecewise-linear velocity, from 0 on; a time given twice is a jump'), &
    key_t('initial', 'velocity_ratio', real_kind, '1', any_real, may, '0.0', '1.0e-6', '', dynamic, &
          'initial velocity along the drive over the drive velocity, X''(0)/V'), &
    key_t('initial', 'elongation_x', real_kind, 'm', any_real, may, '0.0', '', '', dynamic, &
          'initial elongation of the spring along the soft axis; high_frequency keeps it constant'), &
    key_t('initial', 'elongation_y', real_kind, 'm', any_real, may, '0.0', '', '', transverse, &
          'initial elongation of the spring along the stiff axis'), &
    key_t('integrator', 'method', choice_kind, '', any_real, may, 'radau13', '', method_names, dynamic, &
          'radau*: implicit; dopri5, dop853, rk4: explicit; rodas4p: sweeps'), &
    key_t('integrator', 'rtol', real_kind, '1', tolerances, may, '1.0e-8', '', '', adaptive, &
          'relative tolerance of a step'), &
    key_t('integrator', 'step', real_kind, 's', positive, must, '0.0', '', '', fixed_step, &
          'the fixed step'), &
    key_t('integrator', 'step_max', real_kind, 's', non_negative, may, '0.0', '', '', adaptive, &
          'longest step; 0 = no limit'), &
    key_t('integrator', 'cycle_map', choice_kind, '', any_real, may, 'auto', '', 'auto off', leaping, &
          'whether slow cycles that repeat are leapt, and fast cycles by their map where that is cheaper'), &
    key_t('integrator', 'max_steps', integer_kind, '1', non_negative, may, '0', '', '', dynamic, &
          'largest number of steps of a run; 0 = no limit'), &
    key_t('output', 'file', text_kind, '', any_real, may, '', '', '', always, &
          'file of the results; empty = the deck''s name with .h5, in the current directory'), &
    key_t('output', 'interval', real_kind, 's', non_negative, may, 'auto', '', 'auto', always, &
          'time between samples; auto = shows all motion, in up to 1e6 samples; 0 = every accepted step'), &
    key_t('output', 'fields', texts_kind, '', any_real, may, 'default', '', columns, always, &
          'columns of the time series; default: all but theta_deg, u_x_rate, u_y_rate'), &
    key_t('output', 'checkpoint_interval', real_kind, 's', non_negative, may, '600.0', '', '', always, &
          'least wall time between interim files, which resume continues; 0 = only when the run is stopped'), &
    key_t('output', 'wall_limit', real_kind, 's', non_negative, may, '0.0', '', '', always, &
          'wall time after which the run stops; 0 = no limit'), &
    key_t('sweep', 'parameter', texts_kind, '', any_real, may, '', 'system.misalignment_deg', '', always, &
          'keys that are varied, as GROUP.KEY; the last varies fastest'), &
    key_t('sweep', 'first', reals_kind, '', any_real, may, '', '0.5', '', always, &
          'first value of each parameter, in its own unit'), &
    key_t('sweep', 'last', reals_kind, '', any_real, may, '', '20.0', '', always, &
          'last value of each parameter'), &
    key_t('sweep', 'count', reals_kind, '1', range_t(low=1.0_wp, high=1.0e9_wp), may, '', '40', '', always, &
          'number of values of each parameter, a whole number each'), &
    key_t('sweep', 'spacing', texts_kind, '', any_real, may, 'linear', '', 'linear log', always, &
          'spacing of the values: one for all parameters, or one for each'), &
    key_t('sweep', 'points', text_kind, '', any_real, may, '', '', '', always, &
          'CSV file, a column for each GROUP.KEY and a case a row, in place of the above'), &
    key_t('sweep', 'keep', choice_kind, '', any_real, may, 'summary', '', 'summary series cycles', always, &
          'what is kept of a case: its summary, or the time series too, or its last stick-slip cycles too'), &
    key_t('sweep', 'cycles', integer_kind, '1', range_t(low=1.0_wp, high=100.0_wp), may, '50', '', '', keeping_cycles, &
          'largest number of cycles kept of a case: the last of those that the means are over')]

  !> Number of keys.
  integer, parameter :: key_count = size(schema)

contains

  !> Index of a key; 0 if the group has no such key.
  pure integer function find_key(group, name)
    character(*), intent(in) :: group, name

    find_key = find_name(name)
    if (find_key == 0) return
    if (schema(find_key)%group /= group) find_key = 0
  end function find_key

  !> Index of the key of this name in any group; 0 if there is none. Key names are unique.
  pure integer function find_name(name)
    character(*), intent(in) :: name

    find_name = findloc(schema%name, name, dim=1)
  end function find_name

  !> Whether the values of a key are texts.
  pure logical function is_text(key)
    type(key_t), intent(in) :: key

    is_text = any(key%kind == [text_kind, texts_kind, choice_kind])
  end function is_text

  !> Whether the value of a key is the name of a file.
  pure logical function names_file(key)
    type(key_t), intent(in) :: key

    names_file = key%kind == text_kind .and. any(key%name == [character(name_width) :: 'file', 'points', 'table'])
  end function names_file

  !> The names of a group's keys, blank-separated.
  pure function keys_of(group) result(names)
    character(*), intent(in) :: group
    character(:), allocatable :: names
    integer :: i

    names = ''
    do i = 1, key_count
      if (schema(i)%group == group) names = names//trim(schema(i)%name)//' '
    end do
    names = trim(names)
  end function keys_of

  !> Whether a value lies in the interval.
  elemental logical function in_range(range, value)
    type(range_t), intent(in) :: range
    real(wp), intent(in) :: value

    in_range = value >= range%low .and. value <= range%high
    if (range%low_open) in_range = in_range .and. value > range%low
  end function in_range

  !> Whether the key accepts this word in place of a number.
  pure logical function is_word_of(key, given)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given

    is_word_of = key%choices /= '' .and. .not. is_text(key) .and. has_word(key%choices, given)
  end function is_word_of

  !> Whether this number of the key represents the word 'auto'.
  pure logical function is_automatic(key, value)
    type(key_t), intent(in) :: key
    real(wp), intent(in) :: value

    is_automatic = is_word_of(key, 'auto') .and. .not. abs(value - automatic) > 0.0_wp
  end function is_automatic

  !> '> 0.0', '>= 0', '>= a and <= b'; '' if every finite value is valid.
  function range_text(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text

    text = ''
    if (key%range%low > -huge(1.0_wp)) text = trim(merge('> ', '>=', key%range%low_open))//' '//limit_text(key, key%range%low)
    if (key%range%high < huge(1.0_wp)) then
      if (len(text) > 0) text = text//' and '
      text = text//'<= '//limit_text(key, key%range%high)
    end if
  end function range_text

  function limit_text(key, limit) result(text)
    type(key_t), intent(in) :: key
    real(wp), intent(in) :: limit
    character(:), allocatable :: text

    if (key%kind == integer_kind) then
      text = integer_text(nint(limit, int64))
    else
      text = real_text(limit)
    end if
  end function limit_text

  !> What is wrong with a number of a key that is outside its range, as it was `given`.
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

  !> '' if the key has this choice.
  function choice_problem(key, given) result(problem)
    type(key_t), intent(in) :: key
    character(*), intent(in) :: given
    character(:), allocatable :: problem

    problem = ''
    if (has_word(key%choices, given)) return
    problem = 'unknown '//trim(key%name)//" '"//excerpt(given)//"': "
    if (nearest_word(given, key%choices) /= '') &
      problem = problem//"the nearest is '"//nearest_word(given, key%choices)//"', "
    problem = problem//'choose '//alternatives(key%choices)
  end function choice_problem

  !> Number of conditions under which a key is used.
  pure integer function condition_count(key)
    type(key_t), intent(in) :: key

    condition_count = count(key%used_by%on /= '')
  end function condition_count

  !> 'law weakening', 'method dopri5 | dop853 and contact exact'; '' when always used.
  pure function condition_text(key) result(text)
    type(key_t), intent(in) :: key
    character(:), allocatable :: text
    integer :: n

    text = ''
    do n = 1, condition_count(key)
      if (n > 1) text = text//' and '
      text = text//trim(key%used_by(n)%on)//' '//alternatives(key%used_by(n)%choices)
    end do
  end function condition_text
end module dst_schema
