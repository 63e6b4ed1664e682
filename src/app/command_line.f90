!> The command line: its words, its help. What the commands do is the main program's matter.
module dst_command_line
  use dst_division, only: share_wish_t, take_share_wish
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, usage_error
  use dst_schema, only: schema, find_key, names_file
  use dst_text, only: starts_with, has_word, lower_case, word, word_count, nearest_word, excerpt, alternatives, read_real
  implicit none
  private

  public :: argument_t, command_t, program_arguments, is_python_command, parse_arguments, setting_list, help_text
  public :: commands, python_commands, options_of, takes_value, trade_quantities

  !> One word of the command line.
  type :: argument_t
    character(:), allocatable :: text
  end type argument_t

  !> A command as understood, with its options.
  type :: command_t
    character(:), allocatable :: name              !! one of `commands`, version or help
    character(:), allocatable :: output            !! of -o; '' = not given
    type(argument_t), allocatable :: operands(:)   !! decks, result files, or the template's model
    type(argument_t), allocatable :: settings(:)   !! of --set
    integer :: operand_count = 0, setting_count = 0
    character(:), allocatable :: quantity          !! of --quantity; '' = not given
    real(wp) :: accuracy = 0.0_wp                  !! of --accuracy; 0 = not given
    real(wp) :: budget = 10.0_wp                   !! of --budget, s
    logical :: overwrite = .false., quiet = .false., keep_shards = .false.
    type(share_wish_t) :: share                    !! of --shard and --redivide
    logical :: help = .false.                      !! help on the command is wanted, not the command
  end type command_t

  !> All commands, in the order of the help.
  character(*), parameter :: commands = 'run resume merge check template keys stability trade show'
  character(*), parameter :: commands_on_files = 'run resume merge check stability trade show'
  !> Commands of the Python package, to which the executable hands over.
  character(*), parameter :: python_commands = 'plot report export animate paper validate-creep'
  !> What 'trade' measures besides quantities of the user: those of the Python package, for completion.
  character(*), parameter :: trade_quantities = 'final_elongation final_velocity period peak_force valley_force slip_length '// &
    'max_X_rate creep_velocity fast_amplitude fast_phase sticks first_peak_force'
  character(*), parameter :: options_with_value = '-o --set --shard --accuracy --budget --quantity'
  character(*), parameter :: all_options = options_with_value//' --overwrite --quiet --keep-shards --redivide --help --version'
  character(*), parameter :: see_help = ', see dynstiction --help'

contains

  !> The arguments of this program.
  function program_arguments() result(arguments)
    type(argument_t), allocatable :: arguments(:)
    integer :: i, length

    allocate (arguments(command_argument_count()))
    do i = 1, size(arguments)
      call get_command_argument(i, length=length)
      allocate (character(length) :: arguments(i)%text)
      if (length > 0) call get_command_argument(i, arguments(i)%text)
    end do
  end function program_arguments

  !> Whether the command is one that Python carries out: it comes first.
  pure logical function is_python_command(arguments)
    type(argument_t), intent(in) :: arguments(:)

    is_python_command = .false.
    if (size(arguments) > 0) is_python_command = has_word(python_commands, arguments(1)%text)
  end function is_python_command

  !> Understand the arguments; a fault of usage goes to `error`.
  subroutine parse_arguments(arguments, command, error)
    type(argument_t), intent(in) :: arguments(:)
    type(command_t), intent(out) :: command
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: options
    logical :: version, only_operands
    integer :: i

    command%name = ''
    command%output = ''
    command%quantity = ''
    allocate (command%operands(size(arguments)), command%settings(size(arguments)))
    options = ''
    version = .false.
    only_operands = .false.
    i = 1
    do while (i <= size(arguments) .and. .not. allocated(error))
      if (only_operands .or. .not. is_option(arguments(i)%text)) then
        call take_operand(arguments(i)%text, command)
      else if (arguments(i)%text == '--') then
        only_operands = .true.
      else
        call take_option(arguments, i, command, version, options, error)
      end if
      i = i + 1
    end do
    if (allocated(error)) return
    if (version) command%name = 'version'
    if (command%help .and. command%name == '') command%name = 'help'
    call check_command(command, options, error)
  end subroutine parse_arguments

  pure logical function is_option(text)
    character(*), intent(in) :: text

    is_option = starts_with(text, '-') .and. len(text) > 1
  end function is_option

  !> The first operand is the command.
  subroutine take_operand(text, command)
    character(*), intent(in) :: text
    type(command_t), intent(inout) :: command

    if (command%name == '' .and. len(text) > 0) then
      command%name = text
    else
      command%operand_count = command%operand_count + 1
      command%operands(command%operand_count)%text = text
    end if
  end subroutine take_operand

  !> The option at `i`, and its value, on which `i` then stands. `options` collects the names.
  subroutine take_option(arguments, i, command, version, options, error)
    type(argument_t), intent(in) :: arguments(:)
    integer, intent(inout) :: i
    type(command_t), intent(inout) :: command
    logical, intent(inout) :: version
    character(:), allocatable, intent(inout) :: options
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: option, value

    option = arguments(i)%text
    if (starts_with(option, '--set=')) option = '--set'
    select case (option)
    case ('-o', '--set', '--shard')
      call option_value(arguments, i, option, value, error)
      if (allocated(error)) return
      if (option == '-o') then
        if (has_word(options, '-o')) call raise(error, usage_error, '-o given twice: give one output file')
        command%output = value
      else if (option == '--shard') then
        call take_share_wish(value, command%share, error)
      else
        call check_named_file(value, error)
        command%setting_count = command%setting_count + 1
        command%settings(command%setting_count)%text = value
      end if
    case ('--accuracy', '--budget', '--quantity')
      call option_value(arguments, i, option, value, error)
      if (.not. allocated(error)) call take_wish(option, value, command, error)
      if (allocated(error)) return
    case ('--overwrite')
      command%overwrite = .true.
    case ('--quiet')
      command%quiet = .true.
    case ('--keep-shards')
      command%keep_shards = .true.
    case ('--redivide')
      command%share%redivide = .true.
    case ('--version')
      version = .true.
    case ('--help', '-h')
      command%help = .true.
    case default
      call raise(error, usage_error, unknown_text('option', option, all_options))
    end select
    options = trim(adjustl(options//' '//option))
  end subroutine take_option

  !> The options of 'trade' that have a value.
  subroutine take_wish(option, value, command, error)
    character(*), intent(in) :: option, value
    type(command_t), intent(inout) :: command
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    real(wp) :: number

    if (option == '--quantity') then
      command%quantity = value
      return
    end if
    call read_real(value, number, problem)
    if (problem == '' .and. .not. number > 0.0_wp) problem = 'is out of range'
    if (problem /= '') then
      call raise(error, usage_error, option//" '"//excerpt(value)//"' "//problem//': give a number > 0, like '// &
                 trim(merge('1e-3', '30  ', option == '--accuracy')))
    else if (option == '--accuracy') then
      command%accuracy = number
    else
      command%budget = number
    end if
  end subroutine take_wish

  subroutine option_value(arguments, i, option, value, error)
    type(argument_t), intent(in) :: arguments(:)
    integer, intent(inout) :: i
    character(*), intent(in) :: option
    character(:), allocatable, intent(out) :: value
    type(error_t), allocatable, intent(out) :: error

    value = ''
    if (starts_with(arguments(i)%text, '--set=')) then
      value = arguments(i)%text(len('--set=') + 1:)
    else if (i < size(arguments)) then
      i = i + 1
      value = arguments(i)%text
    end if
    if (option == '-o' .and. len(value) > 0) call check_file_name(value, error)
    if (len(value) > 0) return
    if (option == '-o') then
      call raise(error, usage_error, '-o without a file name: write -o FILE')
    else if (option == '--shard') then
      call raise(error, usage_error, '--shard without its number: write --shard I/N or --shard auto')
    else if (option /= '--set') then
      call raise(error, usage_error, option//' without a value: see dynstiction trade --help')
    else
      call raise(error, usage_error, '--set without a setting: write --set GROUP.KEY=VALUE')
    end if
  end subroutine option_value

  !> Fortran's files have no names that end with a blank: another file would be meant.
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

  !> Whether the command exists, takes these options, and has the operands it needs.
  subroutine check_command(command, options, error)
    type(command_t), intent(in) :: command
    character(*), intent(in) :: options
    type(error_t), allocatable, intent(out) :: error

    if (command%name == '') then
      call raise(error, usage_error, 'no command: give one of '//alternatives(commands//' '//python_commands)//see_help)
    else if (command%name == 'version' .or. command%name == 'help') then
      return
    else if (has_word(python_commands, command%name)) then
      call raise(error, usage_error, "'"//command%name//"' comes first: write dynstiction "//command%name//' ...')
    else if (.not. has_word(commands, command%name)) then
      call raise(error, usage_error, unknown_text('command', command%name, commands//' '//python_commands))
    else if (.not. command%help) then
      call check_options(command, options, error)
      if (.not. allocated(error)) call check_operands(command, error)
    end if
  end subroutine check_command

  !> The options that a command takes, blank-separated, besides --help.
  pure function options_of(name) result(options)
    character(*), intent(in) :: name
    character(:), allocatable :: options

    select case (name)
    case ('run')
      options = '-o --set --overwrite --quiet --shard --redivide --keep-shards'
    case ('merge')
      options = '-o --set --overwrite --quiet --keep-shards'
    case ('resume')
      options = '--quiet'
    case ('check', 'stability')
      options = '--set'
    case ('trade')
      options = '-o --set --accuracy --quantity --budget --overwrite --quiet'
    case default
      options = ''
    end select
  end function options_of

  !> Whether the word after the option belongs to it.
  pure logical function takes_value(option)
    character(*), intent(in) :: option

    takes_value = has_word(options_with_value, option)
  end function takes_value

  subroutine check_options(command, options, error)
    type(command_t), intent(in) :: command
    character(*), intent(in) :: options
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: option
    integer :: i

    option = ''
    do i = 1, word_count(options)
      option = word(options, i)
      if (.not. has_word(options_of(command%name)//' -h --help --version', option)) exit
    end do
    if (i <= word_count(options)) &
      call raise(error, usage_error, "'"//command%name//"' takes no "//option//': remove it, see dynstiction '// &
                 command%name//' --help')
  end subroutine check_options

  subroutine check_operands(command, error)
    type(command_t), intent(in) :: command
    type(error_t), allocatable, intent(out) :: error
    integer :: i

    if (has_word(commands_on_files, command%name)) then
      do i = 1, command%operand_count
        call check_file_name(command%operands(i)%text, error)
        if (allocated(error)) return
      end do
    end if
    if (command%name == 'keys') then
      if (command%operand_count > 0) &
        call raise(error, usage_error, "'keys' takes no operand: '"//excerpt(command%operands(1)%text)//"' is too many")
    else if (command%name == 'template') then
      if (command%operand_count > 1) &
        call raise(error, usage_error, "'template' takes one model: '"//excerpt(command%operands(2)%text)//"' is too many")
    else if (command%name == 'resume' .and. command%operand_count == 0) then
      call raise(error, usage_error, "'resume' without a file: write dynstiction resume FILE.h5")
    else if (command%name == 'show' .and. command%operand_count == 0) then
      call raise(error, usage_error, "'show' without a file: write dynstiction show FILE.h5")
    else if (command%operand_count == 0) then
      call raise(error, usage_error, "'"//command%name//"' without a deck: write dynstiction "//command%name//' DECK')
    else if (command%operand_count > 1 .and. command%name == 'trade') then
      call raise(error, usage_error, "'trade' takes one deck: '"//excerpt(command%operands(2)%text)//"' is too many")
    else if (command%share%redivide .and. .not. command%share%is_given) then
      call raise(error, usage_error, '--redivide without --shard: give the new division, like --shard 3/16')
    else if (command%quantity /= '' .and. .not. command%accuracy > 0.0_wp) then
      call raise(error, usage_error, '--quantity without --accuracy: give the accuracy that it shall have')
    else if (command%operand_count > 1 .and. command%output /= '') then
      call raise(error, usage_error, '-o names one file but several decks are given: run them one by one, '// &
                 'or let each deck name its output')
    end if
  end subroutine check_operands

  !> The settings as the deck reader takes them.
  function setting_list(command) result(settings)
    type(command_t), intent(in) :: command
    character(:), allocatable :: settings(:)
    integer :: i, longest

    longest = 1
    do i = 1, command%setting_count
      longest = max(longest, len(command%settings(i)%text))
    end do
    allocate (character(longest) :: settings(command%setting_count))
    do i = 1, command%setting_count
      settings(i) = command%settings(i)%text
    end do
  end function setting_list

  !> The help on a command, or on the program for any other name.
  function help_text(name) result(text)
    character(*), intent(in) :: name
    character(:), allocatable :: text
    character, parameter :: n = achar(10)

    select case (name)
    case ('run')
      text = 'Usage: dynstiction run DECK... [-o FILE] [--set GROUP.KEY=VALUE]... [--overwrite] [--quiet]'//n//n// &
        'Run each deck and write its results to an HDF5 file: FILE, else output.file of the deck,'//n// &
        'else the deck''s name with .h5 in the current directory. All decks are checked before the first runs.'//n// &
        'Ctrl-C, SIGTERM, SIGUSR1 and output.wall_limit stop the run with a checkpoint: go on with dynstiction resume.'//n//n// &
        '  -o FILE                the output file (one deck only)'//n// &
        '  --set GROUP.KEY=VALUE  use VALUE in place of the deck''s; may be repeated; text needs no quotes'//n// &
        '  --set GROUP.KEY=       as if the deck did not set the key'//n// &
        '  --overwrite            replace an existing output file'//n// &
        '  --quiet                no progress'//n// &
        '  --shard I/N            of a sweep: the I-th of N equal parts of its cases; dynstiction merge joins the shards'//n// &
        '  --shard I              the same where the shards that there are say N'//n// &
        '  --shard auto           I and N from the job array, or from the launcher of several processes'//n// &
        '  --redivide             with --shard: another N than that of the shards; what is done stays done'//n// &
        '  --keep-shards          of a sweep: do not remove the shards when the result file is whole'//n//n// &
        'A deck with &sweep runs all its cases, on all cores; started again after a stop or a kill, it goes on.'//n//n// &
        'Examples:'//n// &
        '  dynstiction run inputs/fig3.nml'//n// &
        '  dynstiction run inputs/fig3.nml -o phi2.h5 --set system.misalignment_deg=2'//n// &
        '  dynstiction run inputs/fig3.nml --set drive.time=0,1,1 --set drive.velocity=1e-3,1e-3,0'//n//n// &
        exit_codes(n)
    case ('merge')
      text = 'Usage: dynstiction merge DECK... [-o FILE] [--set GROUP.KEY=VALUE]... [--overwrite] [--keep-shards]'//n//n// &
        'Write the finished cases of a sweep from its shards FILE.shard-* to FILE. Deck, -o and --set are those of the run.'//n// &
        'Cases that have not been run are rows of NaN with result_code -1; the shards are then kept, and the next'//n// &
        'merge or run of the same sweep replaces the file.'//n//n// &
        '  --overwrite            replace an existing result file'//n// &
        '  --keep-shards          do not remove the shards when all cases are there'//n//n// &
        'Example:'//n// &
        '  dynstiction merge inputs/map_lambda.nml -o map_lambda.h5'//n//n// &
        exit_codes(n)
    case ('show')
      text = 'Usage: dynstiction show FILE.h5...'//n//n// &
        'Print what each result file is: model, method, whether it is complete. Of a sweep that is not at its end, print'//n// &
        'from its shards FILE.h5.shard-* how many cases are done, and of each shard its part, its times, and whether a'//n// &
        'process is writing it; FILE.h5 itself need not be there yet. Nothing is changed, and nobody is disturbed.'//n//n// &
        'Example:'//n// &
        '  dynstiction show map_lambda.h5'//n//n// &
        exit_codes(n)
    case ('resume')
      text = 'Usage: dynstiction resume FILE.h5... [--quiet]'//n//n// &
        'Go on with a run that was stopped or killed, from the checkpoint beside its result file, FILE.h5.checkpoint.'//n// &
        'The deck is that in FILE.h5. The finished file holds the same numbers as that of a run without a stop,'//n// &
        'but for the wall time.'//n//n// &
        '  --quiet                no progress'//n//n// &
        'Example:'//n// &
        '  dynstiction resume fig3.h5'//n//n// &
        exit_codes(n)
    case ('check')
      text = 'Usage: dynstiction check DECK... [--set GROUP.KEY=VALUE]...'//n//n// &
        'Check each deck, print it with every key as used, marked user or default, and run nothing.'//n// &
        'What is printed is a deck itself. All faults of a deck are reported in one go, also that its results'//n// &
        'need more room than the disk has. What passes runs.'//n//n// &
        '  --set GROUP.KEY=VALUE  use VALUE in place of the deck''s; may be repeated; text needs no quotes'//n// &
        '  --set GROUP.KEY=       as if the deck did not set the key'//n//n// &
        'Examples:'//n// &
        '  dynstiction check inputs/fig3.nml'//n// &
        '  dynstiction check inputs/fig3.nml --set integrator.method=dopri5 > complete.nml'//n//n// &
        exit_codes(n)
    case ('template')
      text = 'Usage: dynstiction template [MODEL]'//n//n// &
        'Print a deck for MODEL (full) with every key, its unit, range or choices, default and meaning.'//n//n// &
        'Example:'//n// &
        '  dynstiction template > my.nml'//n//n// &
        exit_codes(n)
    case ('keys')
      text = 'Usage: dynstiction keys'//n//n// &
        'Print every key that a deck may have, a line each: GROUP.KEY, its kind, unit, range or choices and default, and'//n// &
        'its meaning, with tabs between the three.'//n//n// &
        'Example:'//n// &
        '  dynstiction keys | grep velocity'//n//n// &
        exit_codes(n)
    case ('stability')
      text = 'Usage: dynstiction stability DECK... [--set GROUP.KEY=VALUE]...'//n//n// &
        'Print whether steady sliding at the drive velocity is stable: its eigenvalues, the critical misalignment'//n// &
        'angles, and the damping of the slow motion (Lambda, zeta, theta*). Of a drive with several velocities,'//n// &
        'each one that is held and is not 0 is treated. Nothing runs, and no file is written.'//n//n// &
        '  --set GROUP.KEY=VALUE  use VALUE in place of the deck''s; may be repeated; text needs no quotes'//n// &
        '  --set GROUP.KEY=       as if the deck did not set the key'//n//n// &
        'Examples:'//n// &
        '  dynstiction stability inputs/fig3.nml'//n// &
        '  dynstiction stability inputs/fig3.nml --set system.misalignment_deg=10'//n//n// &
        exit_codes(n)
    case ('trade')
      text = 'Usage: dynstiction trade DECK [--accuracy A] [--quantity NAME] [--budget S] [-o FILE]'//n// &
        '                         [--set GROUP.KEY=VALUE]... [--overwrite] [--quiet]'//n//n// &
        'Measure error against cost on the deck''s own scene: models, methods, tolerances, fixed steps and smoothing'//n// &
        'velocities, against a reference whose own error is estimated. Prints a table, also of what failed or was'//n// &
        'skipped, and writes every point to FILE, else to the deck''s name with _trade.h5 in the current directory;'//n// &
        'dynstiction plot FILE draws it. The Python package does both.'//n//n// &
        '  --accuracy A           print the cheapest settings whose errors are below A with a margin'//n// &
        '  --quantity NAME        errors of which quantity; all; by default final_elongation, period, peak_force'//n// &
        '                         and creep_velocity, as far as the scene has them'//n// &
        '  --budget S             wall time in seconds (10)'//n// &
        '  -o FILE                the output file'//n// &
        '  --set GROUP.KEY=VALUE  use VALUE in place of the deck''s; may be repeated; text needs no quotes'//n// &
        '  --overwrite            replace an existing output file'//n// &
        '  --quiet                no progress and no table'//n//n// &
        'Examples:'//n// &
        '  dynstiction trade inputs/fig3.nml --accuracy 1e-4'//n// &
        '  dynstiction trade inputs/fig3.nml --accuracy 1e-2 --quantity period --budget 3 --quiet'//n//n// &
        exit_codes(n)
    case default
      text = 'dynstiction: stick-slip of a spring-slider with misaligned anisotropic stiffness'//n//n// &
        'Usage:'//n// &
        '  dynstiction run DECK... [-o FILE] [--set GROUP.KEY=VALUE]... [--overwrite] [--quiet]'//n// &
        '  dynstiction resume FILE.h5... [--quiet]                go on with a run that was stopped or killed'//n// &
        '  dynstiction merge DECK... [-o FILE]                    join the shards of a sweep'//n// &
        '  dynstiction show FILE.h5...                            what a result is, how far a sweep has come'//n// &
        '  dynstiction check DECK... [--set GROUP.KEY=VALUE]...   print the deck as used, run nothing'//n// &
        '  dynstiction template [MODEL]                           print a deck with every key explained'//n// &
        '  dynstiction keys                                       print every key of a deck, a line each'//n// &
        '  dynstiction stability DECK... [--set GROUP.KEY=VALUE]...   whether steady sliding is stable'//n// &
        '  dynstiction trade DECK [--accuracy A] [--budget S]     measured error against cost of methods and models'//n// &
        '  dynstiction --version | --help | COMMAND --help'//n//n// &
        'By the Python package, through the interpreter DYNSTICTION_PYTHON, else the python3 beside the executable,'//n// &
        'else that of PATH:'//n// &
        '  dynstiction plot FILE.h5... [--kind KIND] [-o PNG]     draw a result file, or several side by side'//n// &
        '  dynstiction report FILE.h5 [-o HTML]                   one page with all that a file holds'//n// &
        '  dynstiction export FILE.h5 --csv [-o DIR]              its tables as CSV'//n// &
        '  dynstiction animate FILE.h5 -o OUT                     a film of the object from above'//n// &
        '  dynstiction paper -o DIR                               every figure of the paper'//n// &
        '  dynstiction validate-creep                             which exponent Eq. (8) has'//n//n// &
        'A DECK is a Fortran namelist file; SI units, angles in degrees. Start from the template:'//n// &
        '  dynstiction template > my.nml'//n// &
        '  dynstiction check my.nml'//n// &
        '  dynstiction run my.nml'//n//n// &
        exit_codes(n)
    end select
  end function help_text

  pure function exit_codes(n) result(text)
    character, intent(in) :: n      !! line end
    character(:), allocatable :: text

    text = 'Exit status:'//n// &
      '   0  done'//n// &
      '   1  wrong usage'//n// &
      '   2  a deck was refused; each fault as FILE:LINE: what is wrong: what would be right'//n// &
      '   3  a file or the output could not be read or written, exists already, or cannot be resumed'//n// &
      '   4  the solver gave up, or there was no memory'//n// &
      '   5  some cases of a sweep failed'//n// &
      '  75  stopped early by a signal or at the wall-time limit, with a checkpoint'//n
  end function exit_codes
end module dst_command_line
