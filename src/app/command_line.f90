!> The command line: its words and its help, from the table in dst_command_table. The main program carries out the commands.
module dst_command_line
  use dst_command_table, only: command_entry_t, the_program, commands, options, exit_statuses, find_command, &
    find_option, command_names, options_of, is_option_of, operand_of
  use dst_disk, only: path_t
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, usage_error
  use dst_schema, only: schema, find_key, find_name, names_file
  use dst_share, only: share_t, take_share
  use dst_text, only: starts_with, has_word, with_blanks, lower_case, word, word_count, nearest_word, excerpt, alternatives, &
    integer_text, one_per_line, read_real
  implicit none
  private

  public :: command_t, program_arguments, is_own_command, parse_arguments, setting_list, help_text, usage_of, &
    errors_topic

  !> The keys of &sweep of which an option --vary gives one element each.
  character(9), parameter :: swept_keys(5) = [character(9) :: 'parameter', 'first', 'last', 'count', 'spacing']

  !> A parsed command with its options.
  type :: command_t
    character(:), allocatable :: name              !! a name of the table, version or help
    character(:), allocatable :: output            !! of -o; '' = not given
    type(path_t), allocatable :: operands(:)   !! decks, result files, or the model of the template
    type(path_t), allocatable :: settings(:)   !! of --set
    character(:), allocatable :: sensitivity       !! of --sensitivity, with blanks between the keys; '' = not given
    type(share_t) :: share                         !! of --share
    character(:), allocatable :: given             !! names of all options given, blank-separated
    !> For --vary: their number, and the lists of &sweep that they make, as settings; 'sweep' is then 'run'.
    integer :: variations = 0
    type(path_t) :: swept(size(swept_keys))
  contains
    procedure :: has
  end type command_t

  character, parameter :: n = achar(10)
  character(*), parameter :: see_help = ', see dynstiction --help'
  !> The page of help that is not about a command.
  character(*), parameter :: errors_topic = 'errors'
  !> Columns of the help: the longest line, the meaning of an option, and the meaning of a command.
  integer, parameter :: widest = 110, option_column = 25, command_column = 42

contains

  !> The arguments of this program.
  function program_arguments() result(arguments)
    type(path_t), allocatable :: arguments(:)
    integer :: i, length

    allocate (arguments(command_argument_count()))
    do i = 1, size(arguments)
      call get_command_argument(i, length=length)
      allocate (character(length) :: arguments(i)%text)
      if (length > 0) call get_command_argument(i, arguments(i)%text)
    end do
  end function program_arguments

  !> Whether the arguments, or the topic of help, are for the executable: any other word that comes first is a command of Python.
  pure logical function is_own_command(arguments)
    type(path_t), intent(in) :: arguments(:)
    integer :: i

    is_own_command = .true.
    if (size(arguments) == 0) return
    i = 1
    if (arguments(1)%text == 'help' .and. size(arguments) == 2) i = 2
    associate (text => arguments(i)%text)
      is_own_command = starts_with(text, '-') .or. len_trim(text) == 0 .or. &
        has_word(command_names()//' help '//errors_topic, text)
    end associate
  end function is_own_command

  !> Parse the arguments; a fault of usage goes to `error`.
  subroutine parse_arguments(arguments, command, error)
    type(path_t), intent(in) :: arguments(:)
    type(command_t), intent(out) :: command
    type(error_t), allocatable, intent(out) :: error
    logical :: only_operands
    integer :: i

    command%name = ''
    command%output = ''
    command%sensitivity = ''
    command%given = ''
    allocate (command%operands(0), command%settings(0))
    only_operands = .false.
    i = 1
    do while (i <= size(arguments) .and. .not. allocated(error))
      associate (text => arguments(i)%text)
        if (text == '--' .and. .not. only_operands) then
          only_operands = .true.
        else if (starts_with(text, '-') .and. len(text) > 1 .and. .not. only_operands) then
          call take_option(arguments, i, command, error)
        else if (command%name == '' .and. len(text) > 0) then
          command%name = text
        else
          call append(command%operands, text)
        end if
      end associate
      i = i + 1
    end do
    if (allocated(error)) return
    if (command%has('--version')) command%name = 'version'
    if (command%has('--help') .and. command%name == '') command%name = 'help'
    call check_command(command, error)
    if (command%variations > 0 .and. .not. (allocated(error) .or. command%has('--help'))) call settle_variations(command)
  end subroutine parse_arguments

  !> Append a word. An array constructor would do it, but with gfortran 12 it leaks the memory of the copies.
  pure subroutine append(words, text)
    type(path_t), allocatable, intent(inout) :: words(:)
    character(*), intent(in) :: text
    type(path_t), allocatable :: longer(:)
    integer :: i, n

    n = size(words) + 1
    allocate (longer(n))
    do i = 1, n - 1
      call move_alloc(words(i)%text, longer(i)%text)
    end do
    longer(n)%text = text
    call move_alloc(longer, words)
  end subroutine append

  !> Whether an option is given.
  pure logical function has(self, option)
    class(command_t), intent(in) :: self
    character(*), intent(in) :: option

    has = has_word(self%given, option)
  end function has

  !> Parse the option at `i` and its value; `i` then is the place of the value.
  subroutine take_option(arguments, i, command, error)
    type(path_t), intent(in) :: arguments(:)
    integer, intent(inout) :: i
    type(command_t), intent(inout) :: command
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: option, value
    integer :: equals

    option = arguments(i)%text
    value = ''
    equals = 0
    if (starts_with(option, '--')) equals = index(option, '=')
    if (equals > 0) then
      value = option(equals + 1:)
      option = option(:equals - 1)
    end if
    option = usual_name(option)
    if (equals > 0 .and. .not. takes_value(option)) then
      option = arguments(i)%text
    else if (equals == 0 .and. takes_value(option) .and. i < size(arguments)) then
      i = i + 1
      value = arguments(i)%text
    end if
    if (.not. has_word(options_of(''), option)) then
      call raise(error, usage_error, unknown_option_text(command%name, option))
    else if (takes_value(option) .and. len(value) == 0) then
      call raise(error, usage_error, option//' without '//trim(options(find_option(option, ''))%lacking))
    end if
    if (allocated(error)) return
    select case (option)
    case ('-o')
      call check_file_name(value, error)
      if (.not. allocated(error) .and. command%has('-o')) &
        call raise(error, usage_error, '-o given twice: give one output file')
      command%output = value
    case ('--set')
      call check_named_file(value, error)
      call append(command%settings, value)
    case ('--vary')
      call take_variation(value, command, error)
    case ('--share')
      call take_share(value, command%share, error)
    case ('--sensitivity')
      command%sensitivity = with_blanks(value, ',')
    end select
    command%given = trim(adjustl(command%given//' '//option))
  end subroutine take_option

  !> The name of an option in the table.
  pure function usual_name(option) result(name)
    character(*), intent(in) :: option
    character(:), allocatable :: name

    name = option
    select case (option)
    case ('-h')
      name = '--help'
    case ('-v', '-V')
      name = '--version'
    case ('--output')
      name = '-o'
    end select
  end function usual_name

  !> 'GROUP.KEY=FIRST:LAST:COUNT' or '...:log', which becomes an element of each list of &sweep.
  subroutine take_variation(text, command, error)
    character(*), intent(in) :: text
    type(command_t), intent(inout) :: command
    type(error_t), allocatable, intent(out) :: error
    character(*), parameter :: form = ': write --vary GROUP.KEY=FIRST:LAST:COUNT, like '// &
      '--vary system.misalignment_deg=0.5:20:40, with :log at its end for equal ratios'
    character(:), allocatable :: name, words, spacing, problem
    type(path_t) :: elements(size(swept_keys))
    real(wp) :: number
    integer :: equals, i, k

    equals = index(text, '=')
    words = with_blanks(text(equals + 1:), ':')
    spacing = 'linear'
    if (word_count(words) == 4) spacing = word(words, 4)
    problem = ''
    if (equals == 0) then
      problem = "has no '='"
    else if (word_count(words) < 3 .or. word_count(words) > 4 .or. count([(text(i:i) == ':', i=1, len(text))]) &
             /= word_count(words) - 1) then
      problem = 'does not have the parts FIRST:LAST:COUNT'
    else if (.not. has_word('linear log', spacing)) then
      problem = "has the unknown spacing '"//excerpt(spacing)//"'"
    else
      do i = 1, 3
        call read_real(word(words, i), number, problem)
        if (problem /= '') problem = "'"//excerpt(word(words, i))//"' "//problem
        if (problem /= '') exit
      end do
    end if
    if (problem /= '') then
      call raise(error, usage_error, "--vary '"//excerpt(text)//"' "//problem//form)
      return
    end if
    name = trim(adjustl(text(:equals - 1)))
    ! Names of keys are unique: the group may be left out.
    k = find_name(lower_case(name))
    if (k > 0) name = trim(schema(k)%group)//'.'//name
    elements = [path_t("'"//name//"'"), (path_t(word(words, i)), i=1, 3), path_t("'"//spacing//"'")]
    do i = 1, size(elements)
      if (command%variations == 0) then
        command%swept(i)%text = 'sweep.'//trim(swept_keys(i))//'='//elements(i)%text
      else
        command%swept(i)%text = command%swept(i)%text//','//elements(i)%text
      end if
    end do
    command%variations = command%variations + 1
  end subroutine take_variation

  !> A sweep of a deck is a run of the deck with the group &sweep that the options --vary make.
  subroutine settle_variations(command)
    type(command_t), intent(inout) :: command
    integer :: i

    if (command%name == 'sweep') command%name = 'run'
    do i = 1, size(command%swept)
      call append(command%settings, command%swept(i)%text)
    end do
    call append(command%settings, 'sweep.points=')
  end subroutine settle_variations

  !> Whether the word after the option belongs to it.
  pure logical function takes_value(option)
    character(*), intent(in) :: option

    takes_value = any(options%name == option .and. options%argument /= '')
  end function takes_value

  !> Fortran cannot use names of files that end with a blank: it would use another file.
  subroutine check_file_name(name, error)
    character(*), intent(in) :: name
    type(error_t), allocatable, intent(out) :: error

    if (len_trim(name) < len(name)) &
      call raise(error, usage_error, "file name '"//excerpt(name)//"' ends with a blank: remove the blank, or rename the file")
  end subroutine check_file_name

  !> The file that a setting names, if it names one.
  subroutine check_named_file(setting, error)
    character(*), intent(in) :: setting
    type(error_t), allocatable, intent(out) :: error
    integer :: dot, equals, k

    equals = index(setting, '=')
    dot = index(setting(:max(0, equals - 1)), '.')
    k = find_key(lower_case(setting(:max(0, dot - 1))), lower_case(setting(dot + 1:max(dot, equals - 1))))
    if (k == 0 .or. len(setting) == equals) return
    if (names_file(schema(k))) call check_file_name(setting(equals + 1:), error)
  end subroutine check_named_file

  !> What to write instead of an option that no command, or only another command, has.
  function unknown_option_text(command, option) result(text)
    character(*), intent(in) :: command, option
    character(:), allocatable :: text

    if (index('--output', option) == 1 .and. len(option) > 2) then
      text = "unknown option '"//excerpt(option)//"': the nearest is '-o' or '--output'"//see_help
    else if (find_command(command) == 0) then
      text = unknown_text('option', option, options_of('')//' --output')
    else
      text = unknown_text('option', option, options_of(command)//' --output --help')
      text = text(:len(text) - len(see_help))//', see dynstiction '//command//' --help'
    end if
  end function unknown_option_text

  function unknown_text(what, given, valid) result(text)
    character(*), intent(in) :: what, given, valid
    character(:), allocatable :: text

    text = 'unknown '//what//" '"//excerpt(given)//"': "
    if (nearest_word(given, valid) /= '') then
      text = text//"the nearest is '"//nearest_word(given, valid)//"'"//see_help
    else
      text = text//'there are '//alternatives(valid)//see_help
    end if
  end function unknown_text

  !> Whether the command exists, takes these options, and has the operands that it needs.
  subroutine check_command(command, error)
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    k = find_command(command%name)
    if (command%name == '') then
      call raise(error, usage_error, 'no command: give one of '//alternatives(command_names())//see_help)
    else if (command%name == 'version') then
      return
    else if (command%name == 'help') then
      call check_topic(command, error)
    else if (k == 0) then
      call raise(error, usage_error, unknown_text('command', command%name, command_names())// &
        '; a command of the Python package comes first')
    else if (.not. command%has('--help')) then
      call check_options(command, error)
      if (.not. allocated(error)) call check_operands(command, commands(k), error)
    end if
  end subroutine check_command

  !> The help is about a command, about errors, or about the program.
  subroutine check_topic(command, error)
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error

    if (size(command%operands) == 0) return
    associate (topic => command%operands(1)%text)
      if (size(command%operands) > 1) then
        call raise(error, usage_error, "'help' takes one command: '"//excerpt(command%operands(2)%text)//"' is too many")
      else if (.not. has_word(command_names()//' '//errors_topic, topic)) then
        call raise(error, usage_error, unknown_text('topic', topic, command_names()//' '//errors_topic))
      end if
    end associate
  end subroutine check_topic

  subroutine check_options(command, error)
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: option
    integer :: i

    do i = 1, word_count(command%given)
      option = word(command%given, i)
      if (has_word(options_of(command%name)//' --help --version', option)) cycle
      call raise(error, usage_error, "'"//command%name//"' takes no "//option//': remove it, see dynstiction '// &
                 command%name//' --help')
      return
    end do
  end subroutine check_options

  subroutine check_operands(command, entry, error)
    type(command_t), intent(in) :: command
    type(command_entry_t), intent(in) :: entry
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: operand, kind, allowed
    integer :: i, most

    operand = operand_of(entry)
    kind = trim(lower_case(operand(:index(operand//'.', '.') - 1)))
    do i = 1, size(command%operands)
      if (kind == 'deck' .or. kind == 'file') call check_file_name(command%operands(i)%text, error)
      if (allocated(error)) return
    end do
    most = merge(0, 1, operand == '')
    allowed = 'one '//kind
    if (most == 0) allowed = 'no operand'
    if (size(command%operands) > most .and. index(entry%operands, '...') == 0) then
      call raise(error, usage_error, "'"//command%name//"' takes "//allowed//": '"// &
        excerpt(command%operands(most + 1)%text)//"' is too many")
    else if (size(command%operands) == 0 .and. verify(entry%operands(:1), '[ ') == 1) then
      call raise(error, usage_error, "'"//command%name//"' without a "//kind//': write dynstiction '//command%name//' '//operand)
    else if (command%name == 'sweep' .and. command%variations == 0) then
      call raise(error, usage_error, "'sweep' varies nothing: write --vary GROUP.KEY=FIRST:LAST:COUNT, like "// &
        '--vary system.misalignment_deg=0.5:20:40')
    else if (size(command%operands) > 1 .and. command%output /= '') then
      call raise(error, usage_error, '-o names one file but several decks are given: run them one by one, '// &
                 'or let each deck name its output')
    end if
  end subroutine check_operands

  !> The settings in the form that the deck reader uses.
  function setting_list(command) result(settings)
    type(command_t), intent(in) :: command
    character(:), allocatable :: settings(:)
    integer :: i

    allocate (character(maxval([1, (len(command%settings(i)%text), i=1, size(command%settings))])) :: &
              settings(size(command%settings)))
    do i = 1, size(settings)
      settings(i) = command%settings(i)%text
    end do
  end function setting_list

  !> The help on a command, or on the program for any other name.
  pure function help_text(name) result(text)
    character(*), intent(in) :: name
    character(:), allocatable :: text
    integer :: i

    i = find_command(name)
    if (i > 0) then
      text = help_on(commands(i))
    else
      text = overview()
    end if
    text = text//n//'Exit status:'//n
    do i = 1, size(exit_statuses)
      call put_row(text, repeat(' ', merge(1, 0, exit_statuses(i)%status < 10))//integer_text(exit_statuses(i)%status), &
        exit_statuses(i)%meaning, 6)
    end do
  end function help_text

  pure function help_on(command) result(text)
    type(command_entry_t), intent(in) :: command
    character(:), allocatable :: text
    integer :: k

    text = 'Usage: '//usage_of(command)//n//n
    call put_words(text, command%meaning, 0)
    text = text//n//n
    do k = 1, size(options)
      if (is_option_of(options(k), trim(command%name))) &
        call put_row(text, trim(options(k)%name)//' '//options(k)%argument, options(k)%meaning, option_column)
    end do
    if (options_of(trim(command%name)) /= '') text = text//n
    text = text//'Examples:'//n//one_per_line(trim(command%examples), '  ')
  end function help_on

  !> 'dynstiction run DECK... [-o FILE] ...', over several lines if it is long.
  pure function usage_of(command) result(text)
    type(command_entry_t), intent(in) :: command
    character(:), allocatable :: text, option
    integer :: k

    text = trim('dynstiction '//trim(command%name)//' '//command%operands)
    do k = 1, size(options)
      if (.not. is_option_of(options(k), trim(command%name))) cycle
      if (k /= find_option(trim(options(k)%name), trim(command%name))) cycle
      option = trim(trim(options(k)%name)//' '//options(k)%argument)
      if (options(k)%times /= '1') option = '['//option//']'
      if (options(k)%times == '*') option = option//'...'
      call put(text, option, len('Usage: '))
    end do
  end function usage_of

  pure function overview() result(text)
    character(:), allocatable :: text
    integer :: i

    text = 'dynstiction: '//trim(the_program%brief)//n//n//'Usage:'//n
    do i = 1, size(commands)
      call put_row(text, 'dynstiction '//trim(commands(i)%name)//' '//commands(i)%operands, commands(i)%brief, command_column)
    end do
    text = text//'  dynstiction --version | --help | help COMMAND | help errors'//n//n
    call put_words(text, 'Figures, reports, measured traces, the trade of accuracy for time, and any other COMMAND: by the '// &
      'Python package, through the interpreter DYNSTICTION_PYTHON, else the python3 beside the executable, else that of PATH. '// &
      'dynstiction help python lists them.', 0)
    text = text//n
    text = text//n//trim(the_program%meaning)//n//one_per_line(trim(the_program%examples), '  ')
  end function overview

  !> One or several lines: '  name   meaning', with the meaning from `column` on.
  pure subroutine put_row(text, name, meaning, column)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: name, meaning
    integer, intent(in) :: column

    text = text//'  '//trim(name)//repeat(' ', max(0, column - 3 - len_trim(name)))
    call put_words(text, meaning, column)
    text = text//n
  end subroutine put_row

  !> The words of a text; lines after the first are indented.
  pure subroutine put_words(text, words, indent)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: words
    integer, intent(in) :: indent
    integer :: i

    do i = 1, word_count(words)
      call put(text, word(words, i), indent)
    end do
  end subroutine put_words

  !> Append a piece to the last line of the text if it fits there, otherwise to a new line that is indented.
  pure subroutine put(text, piece, indent)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: piece
    integer, intent(in) :: indent
    integer :: used

    used = len(text) - index(text, n, back=.true.)
    if (used + 1 + len(piece) > widest) then
      text = text//n//repeat(' ', indent)//piece
    else if (used == 0) then
      text = text//piece
    else
      text = text//' '//piece
    end if
  end subroutine put
end module dst_command_line
