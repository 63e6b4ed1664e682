!> The command line: its words and its help, from the table in dst_command_table. The main program carries out the commands.
module dst_command_line
  use dst_command_table, only: command_entry_t, the_program, commands, options, exit_statuses, command_names, options_of
  use dst_disk, only: path_t
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, usage_error
  use dst_deck_sweep, only: grid_keys
  use dst_schema, only: schema, find_name
  use dst_share, only: share_t, take_share
  use dst_text, only: has_word, with_blanks, lower_case, word, word_count, nearest_word, excerpt, alternatives, &
    integer_text, one_per_line, read_real
  implicit none
  private

  public :: command_t, program_arguments, is_own_command, parse_arguments, setting_list, help_text, usage_of, &
    errors_topic

  !> A parsed command with its options.
  type :: command_t
    character(:), allocatable :: name              !! a name of the table, or of a page of help; '' = the program itself
    character(:), allocatable :: output            !! of -o; '' = not given
    type(path_t), allocatable :: operands(:)   !! decks, result files, or the model of the template
    type(path_t), allocatable :: settings(:)   !! of --set
    character(:), allocatable :: sensitivity       !! of --sensitivity, with blanks between the keys; '' = not given
    type(share_t) :: share                         !! of --share
    character(:), allocatable :: given             !! names of all options given, blank-separated
    !> For --vary: their number, and the lists of &sweep that they make; 'sweep' is then 'run'.
    integer :: variations = 0
    type(path_t) :: swept(size(grid_keys))
  contains
    procedure :: has
  end type command_t

  character, parameter :: n = achar(10)
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
      is_own_command = index(text, '-') == 1 .or. text == '' .or. has_word(command_names()//' help '//errors_topic, text)
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
    do i = size(arguments), 1, -1
      associate (text => arguments(i)%text)
        ! Fortran would use another file.
        if (len_trim(text) < len(text)) &
          call raise(error, usage_error, "'"//excerpt(text)//"' ends with a blank: remove the blank, or rename the file")
      end associate
    end do
    only_operands = .false.
    i = 1
    do while (i <= size(arguments) .and. .not. allocated(error))
      associate (text => arguments(i)%text)
        if (text == '--' .and. .not. only_operands) then
          only_operands = .true.
        else if (index(text, '-') == 1 .and. len(text) > 1 .and. .not. only_operands) then
          call take_option(arguments, i, command, error)
        else if (command%name == '' .and. len(text) > 0) then
          command%name = text
        else
          call append(command%operands, text)
        end if
      end associate
      i = i + 1
    end do
    if (.not. allocated(error)) call check_command(command, error)
    if (command%variations == 0 .or. command%has('--help') .or. allocated(error)) return
    ! A sweep of a deck is a run of the deck with the group &sweep that the options --vary make.
    if (command%name == 'sweep') command%name = 'run'
    do i = 1, size(grid_keys)
      call append(command%settings, 'sweep.'//trim(grid_keys(i))//'='//command%swept(i)%text)
    end do
    call append(command%settings, 'sweep.points=')
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
    character(9), parameter :: other_names(4) = [character(9) :: '-h', '-v', '-V', '--output']
    character(9), parameter :: names(4) = [character(9) :: '--help', '--version', '--version', '-o']
    character(:), allocatable :: option, value
    integer :: equals, k

    option = arguments(i)%text
    value = ''
    equals = 0
    if (index(option, '--') == 1) equals = index(option, '=')
    if (equals > 0) then
      value = option(equals + 1:)
      option = option(:equals - 1)
    end if
    k = findloc(other_names, option, dim=1)
    if (k > 0) option = trim(names(k))
    k = findloc(options%name, option, dim=1)
    if (k > 0) then
      if (options(k)%argument == '') then
        if (equals > 0) k = 0
      else if (equals == 0 .and. i < size(arguments)) then
        i = i + 1
        value = arguments(i)%text
      end if
    end if
    if (k == 0) then
      if (has_word(command_names(), command%name)) then
        call raise(error, usage_error, unknown_text('option', arguments(i)%text, options_of(command%name)//' --output --help', &
          command%name//' '))
      else
        call raise(error, usage_error, unknown_text('option', arguments(i)%text, options_of('')//' --output', ''))
      end if
    else if (options(k)%argument /= '' .and. value == '') then
      call raise(error, usage_error, option//' without its value: write '//option//' '//trim(options(k)%argument)// &
        ', see dynstiction '//trim(adjustl(command%name//' --help')))
    end if
    if (allocated(error)) return
    select case (option)
    case ('-o')
      if (command%has('-o')) call raise(error, usage_error, '-o given twice: give one output file')
      command%output = value
    case ('--set')
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

  !> 'GROUP.KEY=FIRST:LAST:COUNT' or '...:log', which becomes an element of each list of &sweep.
  subroutine take_variation(text, command, error)
    character(*), intent(in) :: text
    type(command_t), intent(inout) :: command
    type(error_t), allocatable, intent(out) :: error
    character(*), parameter :: form = ': write --vary GROUP.KEY=FIRST:LAST:COUNT, like '// &
      '--vary system.misalignment_deg=0.5:20:40, with :log at its end for equal ratios'
    character(:), allocatable :: name, words, problem
    type(path_t) :: elements(size(grid_keys))
    real(wp) :: number
    integer :: equals, i, k

    equals = index(text, '=')
    words = with_blanks(text(equals + 1:), ':')
    if (count([(text(i:i) == ':', i=1, len(text))]) == 2) words = words//' linear'
    problem = ''
    if (equals == 0) then
      problem = "has no '='"
    else if (word_count(words) /= 4 .or. .not. has_word('linear log', word(words, 4))) then
      problem = 'does not have the parts FIRST:LAST:COUNT'
    end if
    do i = 1, 3
      if (problem /= '') exit
      call read_real(word(words, i), number, problem)
      if (problem /= '') problem = "'"//excerpt(word(words, i))//"' "//problem
    end do
    if (problem /= '') then
      call raise(error, usage_error, "--vary '"//excerpt(text)//"' "//problem//form)
      return
    end if
    name = trim(adjustl(text(:equals - 1)))
    ! Names of keys are unique: the group may be left out.
    k = find_name(lower_case(name))
    if (k > 0) name = trim(schema(k)%group)//'.'//name
    elements = [path_t("'"//name//"'"), (path_t(word(words, i)), i=1, 3), path_t("'"//word(words, 4)//"'")]
    do i = 1, size(elements)
      if (command%variations > 0) elements(i)%text = command%swept(i)%text//','//elements(i)%text
    end do
    command%swept = elements
    command%variations = command%variations + 1
  end subroutine take_variation

  function unknown_text(what, given, valid, command) result(text)
    character(*), intent(in) :: what, given, valid
    character(*), intent(in) :: command   !! whose help says more, with a blank; '' = that of the program
    character(:), allocatable :: text

    text = 'unknown '//what//" '"//excerpt(given)//"': "
    if (nearest_word(given, valid) /= '') then
      text = text//"the nearest is '"//nearest_word(given, valid)//"'"
    else
      text = text//'there are '//alternatives(valid)
    end if
    text = text//', see dynstiction '//command//'--help'
  end function unknown_text

  !> Whether the command exists, takes these options, and has the operands that it needs. `help TOPIC` becomes `TOPIC --help`.
  subroutine check_command(command, error)
    type(command_t), intent(inout) :: command
    type(error_t), allocatable, intent(out) :: error
    integer :: k

    if (command%name == 'help') then
      command%given = command%given//' --help'
      command%name = ''
      if (size(command%operands) > 0) command%name = command%operands(1)%text
      if (size(command%operands) > 1) call raise(error, usage_error, "'help' takes one command: '"// &
        excerpt(command%operands(2)%text)//"' is too many")
    end if
    k = findloc(commands%name, command%name, dim=1)
    if (allocated(error) .or. command%has('--version')) return
    if (command%has('--help') .and. (command%name == '' .or. command%name == errors_topic)) return
    if (command%name == '') then
      call raise(error, usage_error, 'no command: give one of '//alternatives(command_names())//', see dynstiction --help')
    else if (k == 0) then
      call raise(error, usage_error, unknown_text('command', command%name, command_names(), '')// &
        '; a command of the Python package comes first')
    else if (.not. command%has('--help')) then
      call check_options(command, error)
      if (.not. allocated(error)) call check_operands(command, trim(commands(k)%operands), error)
    end if
  end subroutine check_command

  subroutine check_options(command, error)
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    do i = 1, word_count(command%given)
      if (has_word(options_of(command%name), word(command%given, i))) cycle
      call raise(error, usage_error, "'"//command%name//"' takes no "//word(command%given, i)//': remove it, see dynstiction '// &
                 command%name//' --help')
      return
    end do
  end subroutine check_options

  !> `expected`: as in the table, 'DECK...', 'FILE.h5...' or '[MODEL]'.
  subroutine check_operands(command, expected, error)
    type(command_t), intent(in) :: command
    character(*), intent(in) :: expected
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: operand, kind

    operand = expected(scan(expected, '[') + 1:verify(expected, '.]', back=.true.))
    kind = lower_case(operand(:index(operand//'.', '.') - 1))
    if (size(command%operands) > 1 .and. index(expected, '...') == 0) then
      call raise(error, usage_error, "'"//command%name//"' takes one "//kind//": '"//excerpt(command%operands(2)%text)// &
        "' is too many")
    else if (size(command%operands) == 0 .and. expected(1:1) /= '[') then
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

    i = findloc(commands%name, name, dim=1)
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
      if (has_word(options(k)%commands, trim(command%name))) &
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
      if (.not. has_word(options(k)%commands, trim(command%name))) cycle
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
