!> The one table of the executable's commands, options and exit statuses: parsing, help, completion, manual page and documentation
!> are made from it. The Python package has a table of its own commands, of which the executable knows nothing.
module dst_command_table
  use dst_text, only: name_width, meaning_width, has_word
  implicit none
  private

  public :: command_entry_t, option_t, exit_status_t, the_program, commands, options, exit_statuses
  public :: find_command, find_option, command_names, options_of, operand_of, is_option_of

  !> A command.
  type :: command_entry_t
    character(name_width) :: name
    character(name_width) :: operands    !! 'DECK...', one or more; '[MODEL]', one or none; '' = none
    character(72) :: brief               !! in a few words
    character(640) :: meaning
    character(288) :: examples           !! one in each line
  end type command_entry_t

  !> An option; one that takes several kinds of values has an entry for each.
  type :: option_t
    character(name_width) :: name
    character(name_width) :: argument    !! what follows, in capitals, or the words of which one follows: 'png|pdf'; '' = nothing
    character(meaning_width) :: commands   !! that take it; '' = the program itself
    character :: times                   !! how often it is given. '?': at most once, '*': any number of times; '1': once
    character(192) :: meaning
    character(64) :: lacking             !! the argument: what is missing, and what to write
  end type option_t

  !> An exit status of the program.
  type :: exit_status_t
    integer :: status
    character(meaning_width) :: meaning
  end type exit_status_t

  character, parameter :: n = achar(10)

  !> The parts of the help that are about the program as a whole.
  type(command_entry_t), parameter :: the_program = command_entry_t('', '', &
    'stick-slip of a spring-slider with misaligned anisotropic stiffness', &
    'A DECK is a Fortran namelist file; SI units, angles in degrees. Start from the template:', &
    'dynstiction template > my.nml'//n//'dynstiction check my.nml'//n//'dynstiction run my.nml')

  !> name, operands, brief, meaning, examples
  type(command_entry_t), parameter :: commands(*) = [ &
    command_entry_t('run', 'DECK...', 'run decks and write their results', &
      'Run each deck and write its results to an HDF5 file: FILE, else output.file of the deck, else the deck''s name with .h5 '// &
      'in the current directory. All decks are checked before the first runs. Ctrl-C, SIGTERM, SIGUSR1 and output.wall_limit '// &
      'stop the run with a whole file: dynstiction resume continues it. A deck with &sweep runs all its cases, on all cores; '// &
      'started again after a stop or a kill, it runs the remaining cases. With --share it runs a part of them.', &
      'dynstiction run inputs/fig3.nml'//n// &
      'dynstiction run inputs/fig3.nml -o phi2.h5 --set system.misalignment_deg=2'//n// &
      'dynstiction run inputs/fig3.nml --set drive.time=0,1,1 --set drive.velocity=1e-3,1e-3,0'), &
    command_entry_t('sweep', 'DECK', 'run a deck with a key varied', &
      'Run the deck for COUNT values of a key, from FIRST to LAST, on all cores, and write a summary of each case to FILE, '// &
      'else to the deck''s name with _sweep.h5 in the current directory. The last of several keys varies fastest. It is the '// &
      'same as dynstiction run of the deck with the group &sweep that --vary says.', &
      'dynstiction sweep my.nml --vary system.misalignment_deg=0.5:20:40'//n// &
      'dynstiction sweep my.nml --vary drive.velocity=1e-4:1e-1:30:log -o velocity.h5'), &
    command_entry_t('resume', 'FILE.h5...', 'continue a run that was stopped or killed', &
      'Continue a run that was stopped or killed from the state in its last whole file, with the deck in it. The finished file '// &
      'has the same numbers as the file of a run without a stop, except the wall time.', &
      'dynstiction resume fig3.h5'), &
    command_entry_t('merge', 'DECK...', 'join the shares of a sweep', &
      'Write the finished cases of a sweep from the files of its shares, like phi.3-of-16.h5, to FILE, like phi.h5. Deck, -o, '// &
      '--set and --vary are those of the run. Cases that have not been run are rows of NaN with result_code -1; the next merge '// &
      'adds them, and so does a run of the whole deck. The files of the shares are left alone.', &
      'dynstiction merge inputs/map_lambda.nml -o map_lambda.h5'), &
    command_entry_t('check', 'DECK...', 'print the deck as used, run nothing', &
      'Check each deck, print it with every key as used, marked user or default, and run nothing. '// &
      'The output is a deck itself. All faults of a deck are reported at once, also if its results '// &
      'need more room than the disk has. A deck that passes will run.', &
      'dynstiction check inputs/fig3.nml'//n// &
      'dynstiction check inputs/fig3.nml --set integrator.method=dopri5 > complete.nml'), &
    command_entry_t('template', '[MODEL]', 'print a deck with every key explained', &
      'Print a deck for MODEL (full) with every key, its unit, range or choices, default and meaning.', &
      'dynstiction template > my.nml'//n//'dynstiction template --json > dynstiction.json'), &
    command_entry_t('stability', 'DECK...', 'whether there is stick-slip, and whether sliding is stable', &
      'Print whether the scene has stick-slip and whether steady sliding at the drive velocity is stable; then its '// &
      'eigenvalues, the critical misalignment angles, and the damping of the slow motion (Lambda, zeta, theta*). With --key: '// &
      'where both change, in any number of the deck. For a drive with several velocities, '// &
      'each one that is kept for some time and is not 0 is treated. No file is written.', &
      'dynstiction stability inputs/fig3.nml'//n// &
      'dynstiction stability inputs/fig3.nml --key system.damping_x,drive.velocity'//n// &
      'dynstiction stability inputs/fig3.nml --set system.misalignment_deg=10'), &
    command_entry_t('cycles', 'DECK...', 'every limit cycle of a scene', &
      'Print every limit cycle of the scene, stable and unstable: period, peak, valley, swing, slip length, and the '// &
      'logarithm of its multiplier; also steady sliding with its eigenvalues, and from where it is reached. For a '// &
      'drive with several velocities, each one that is kept for some time and is not 0 is treated. No file is written.', &
      'dynstiction cycles inputs/fig3.nml'//n// &
      'dynstiction cycles inputs/fig3.nml --sensitivity system.mass,friction.v_f'//n// &
      'dynstiction cycles inputs/fig3.nml --along system.misalignment_deg=1:9'//n// &
      'dynstiction cycles inputs/fig3.nml --set drive.velocity=0.075 --set system.misalignment_deg=3.5'), &
    command_entry_t('show', 'FILE...', 'contents of a result, progress of a sweep', &
      'Print the contents of each file: for a run its model, method and summary, for a sweep its parameters and the ranges of '// &
      'its results. For a sweep that is divided into shares, print how many cases of '// &
      'each are done, and which have no file yet; FILE itself need not exist. Nothing is changed, and no process is disturbed.', &
      'dynstiction show map_lambda.h5')]

  character(*), parameter :: takes_settings = 'run sweep merge check stability cycles'

  !> name, argument, commands, times, meaning, lacking
  type(option_t), parameter :: options(*) = [ &
    option_t('-o', 'FILE', 'run sweep merge', '?', 'the output file (one deck only)', 'a file name: write -o FILE'), &
    option_t('--set', 'GROUP.KEY=VALUE', takes_settings, '*', &
      'use VALUE in place of the deck''s, without VALUE its default; may be repeated; text needs no quotes', &
      'a setting: write --set GROUP.KEY=VALUE'), &
    option_t('--vary', 'KEY=FIRST:LAST:COUNT', 'sweep merge', '*', &
      'values of GROUP.KEY, both ends included; :log at the end for equal ratios; several make a grid', &
      'a key: write --vary GROUP.KEY=FIRST:LAST:COUNT'), &
    option_t('--share', 'I/N', 'run sweep', '?', &
      'run the I-th of N equal parts of a sweep, into FILE.I-of-N.h5; dynstiction merge joins them', &
      'its number: write --share I/N or --share auto'), &
    option_t('--share', 'auto', 'run sweep', '?', 'I and N from the job array, or from the launcher of several processes', ''), &
    option_t('--retry', '', 'run sweep', '?', 'also run the cases again that failed before', ''), &
    option_t('--sensitivity', 'KEYS', 'cycles', '?', &
      'also print how the cycle of the motion changes with parameters GROUP.KEY, with commas between them', &
      'parameters: write --sensitivity system.mass,friction.v_f'), &
    option_t('--along', 'KEY=FROM:TO', 'cycles', '?', &
      'follow the cycles over GROUP.KEY: folds, doublings and ends; the same as dynstiction branch, which Python carries out', &
      'a range: write --along GROUP.KEY=FROM:TO'), &
    option_t('--key', 'KEYS', 'stability', '?', &
      'where both change in numbers GROUP.KEY, with commas between them; the same as dynstiction range, which Python carries out', &
      'parameters: write --key system.damping_x,drive.velocity'), &
    option_t('--overwrite', '', 'run sweep merge', '?', &
      'replace existing output files', ''), &
    option_t('--quiet', '', 'run sweep resume merge', '?', 'no progress, no notes, no summary', ''), &
    option_t('--json', '', 'template', '?', &
      'print all names as JSON: commands, options, exit statuses, keys, output columns, summary values, statistics', ''), &
    option_t('--help', '', '', '?', 'the help on the program, or on a command', ''), &
    option_t('--version', '', '', '?', 'the version of the program, and how it was built', '')]

  !> All exit statuses.
  type(exit_status_t), parameter :: exit_statuses(*) = [ &
    exit_status_t(0, 'done'), &
    exit_status_t(1, 'wrong usage'), &
    exit_status_t(2, 'a deck was refused; every error is printed as FILE:LINE: problem: suggestion'), &
    exit_status_t(3, 'a file or the output could not be read or written, exists already, or cannot be resumed'), &
    exit_status_t(4, 'the solver gave up, or there was no memory'), &
    exit_status_t(5, 'some cases of a sweep failed'), &
    exit_status_t(6, 'a fit does not explain its trace'), &
    exit_status_t(75, 'stopped early by a signal or at the wall-time limit: can be continued')]

contains

  !> Index of a command; 0 if there is none of this name.
  pure integer function find_command(name)
    character(*), intent(in) :: name

    find_command = findloc(commands%name, name, dim=1)
    if (len_trim(name) < len(name)) find_command = 0
  end function find_command

  !> Index of an option's first entry for `command`, or for any command if that is ''; 0 if there is none.
  pure integer function find_option(name, command) result(k)
    character(*), intent(in) :: name, command

    do k = 1, size(options)
      if (options(k)%name == name .and. (command == '' .or. has_word(options(k)%commands, command))) return
    end do
    k = 0
  end function find_option

  !> All commands, blank-separated.
  pure function command_names() result(names)
    character(:), allocatable :: names
    integer :: i

    names = ''
    do i = 1, size(commands)
      names = trim(names//' '//commands(i)%name)
    end do
    names = names(2:)
  end function command_names

  !> The options that a command takes, blank-separated; for '' those of the program and of all commands.
  pure function options_of(command) result(names)
    character(*), intent(in) :: command
    character(:), allocatable :: names
    integer :: k

    names = ''
    do k = 1, size(options)
      if (.not. is_option_of(options(k), command) .or. has_word(names, trim(options(k)%name))) cycle
      names = trim(names//' '//options(k)%name)
    end do
    names = adjustl(names)
  end function options_of

  !> Whether `command` takes the option; for '', whether the program or any command does.
  pure logical function is_option_of(option, command)
    type(option_t), intent(in) :: option
    character(*), intent(in) :: command

    is_option_of = command == '' .or. has_word(option%commands, command)
  end function is_option_of

  !> 'DECK', 'FILE.h5', 'MODEL' or ''.
  pure function operand_of(command) result(operand)
    type(command_entry_t), intent(in) :: command
    character(:), allocatable :: operand

    operand = command%operands(scan(command%operands, '[') + 1:len_trim(command%operands))
    if (verify(operand, '.]', back=.true.) < len(operand)) operand = operand(:verify(operand, '.]', back=.true.))
  end function operand_of
end module dst_command_table
