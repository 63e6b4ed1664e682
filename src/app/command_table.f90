!> The one table of commands, options and exit statuses: parsing, help, completion, manual page and documentation are made from it.
!>
!> A command of Python is carried out by the Python package, whose parser also takes its operands and options from here.
module dst_command_table
  use dst_text, only: name_width, meaning_width, has_word, word
  implicit none
  private

  public :: command_entry_t, option_t, exit_status_t, the_program, commands, options, exit_statuses
  public :: find_command, find_option, command_names, options_of, operand_of, is_option_of

  !> A command.
  type :: command_entry_t
    character(name_width) :: name
    character(name_width) :: operands    !! 'DECK...', one or more; '[MODEL]', one or none; '' = none
    logical :: of_python
    character(72) :: brief               !! in a few words
    character(640) :: meaning
    character(256) :: examples           !! one in each line
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
  logical, parameter :: ours = .false., python = .true.

  !> The parts of the help that are about the program as a whole.
  type(command_entry_t), parameter :: the_program = command_entry_t('', '', ours, &
    'stick-slip of a spring-slider with misaligned anisotropic stiffness', &
    'A DECK is a Fortran namelist file; SI units, angles in degrees. Start from the template:', &
    'dynstiction template > my.nml'//n//'dynstiction check my.nml'//n//'dynstiction run my.nml')

  !> name, operands, of Python?, brief, meaning, examples
  type(command_entry_t), parameter :: commands(*) = [ &
    command_entry_t('run', 'DECK...', ours, 'run decks and write their results', &
      'Run each deck and write its results to an HDF5 file: FILE, else output.file of the deck, else the deck''s name with .h5 '// &
      'in the current directory. All decks are checked before the first runs. Ctrl-C, SIGTERM, SIGUSR1 and output.wall_limit '// &
      'stop the run with a whole file: dynstiction resume continues it. A deck with &sweep runs all its cases, on all cores; '// &
      'started again after a stop or a kill, it runs the remaining cases. With --share it runs a part of them.', &
      'dynstiction run inputs/fig3.nml'//n// &
      'dynstiction run inputs/fig3.nml -o phi2.h5 --set system.misalignment_deg=2'//n// &
      'dynstiction run inputs/fig3.nml --set drive.time=0,1,1 --set drive.velocity=1e-3,1e-3,0'), &
    command_entry_t('sweep', 'DECK', ours, 'run a deck with a key varied', &
      'Run the deck for COUNT values of a key, from FIRST to LAST, on all cores, and write a summary of each case to FILE, '// &
      'else to the deck''s name with _sweep.h5 in the current directory. The last of several keys varies fastest. It is the '// &
      'same as dynstiction run of the deck with the group &sweep that --vary says.', &
      'dynstiction sweep my.nml --vary system.misalignment_deg=0.5:20:40'//n// &
      'dynstiction sweep my.nml --vary drive.velocity=1e-4:1e-1:30:log -o velocity.h5'), &
    command_entry_t('resume', 'FILE.h5...', ours, 'continue a run that was stopped or killed', &
      'Continue a run that was stopped or killed from the state in its last whole file, with the deck in it. The finished file '// &
      'has the same numbers as the file of a run without a stop, except the wall time.', &
      'dynstiction resume fig3.h5'), &
    command_entry_t('merge', 'DECK...', ours, 'join the shares of a sweep', &
      'Write the finished cases of a sweep from the files of its shares, like phi.3-of-16.h5, to FILE, like phi.h5. Deck, -o, '// &
      '--set and --vary are those of the run. Cases that have not been run are rows of NaN with result_code -1; the next merge '// &
      'adds them, and so does a run of the whole deck. The files of the shares are left alone.', &
      'dynstiction merge inputs/map_lambda.nml -o map_lambda.h5'), &
    command_entry_t('check', 'DECK...', ours, 'print the deck as used, run nothing', &
      'Check each deck, print it with every key as used, marked user or default, and run nothing. '// &
      'The output is a deck itself. All faults of a deck are reported at once, also if its results '// &
      'need more room than the disk has. A deck that passes will run.', &
      'dynstiction check inputs/fig3.nml'//n// &
      'dynstiction check inputs/fig3.nml --set integrator.method=dopri5 > complete.nml'), &
    command_entry_t('template', '[MODEL]', ours, 'print a deck with every key explained', &
      'Print a deck for MODEL (full) with every key, its unit, range or choices, default and meaning.', &
      'dynstiction template > my.nml'//n//'dynstiction template --json > dynstiction.json'), &
    command_entry_t('stability', 'DECK...', ours, 'whether steady sliding is stable', &
      'Print whether steady sliding at the drive velocity is stable: its eigenvalues, the critical misalignment '// &
      'angles, and the damping of the slow motion (Lambda, zeta, theta*); and where stick-slip ends, in the misalignment '// &
      'and in the velocity, and where both are stable, if the slow motion holds there. For a drive with several velocities, '// &
      'each one that is kept for some time and is not 0 is treated. No file is written.', &
      'dynstiction stability inputs/fig3.nml'//n// &
      'dynstiction stability inputs/fig3.nml --set system.misalignment_deg=10'), &
    command_entry_t('cycles', 'DECK...', ours, 'every limit cycle of a scene', &
      'Print every limit cycle of the scene, stable and unstable: period, peak, valley, swing, slip length, and the '// &
      'logarithm of its multiplier; also steady sliding with its eigenvalues, and from where it is reached. For a '// &
      'drive with several velocities, each one that is kept for some time and is not 0 is treated. No file is written.', &
      'dynstiction cycles inputs/fig3.nml'//n// &
      'dynstiction cycles inputs/fig3.nml --sensitivity system.mass,friction.v_f'//n// &
      'dynstiction cycles inputs/fig3.nml --set drive.velocity=0.075 --set system.misalignment_deg=3.5'), &
    command_entry_t('show', 'FILE...', ours, 'contents of a result, progress of a sweep', &
      'Print the contents of each file: for a run its model, method and summary, for a sweep its parameters and the ranges of '// &
      'its results, for a deck the run that it describes. For a sweep that is divided into shares, print how many cases of '// &
      'each are done, and which have no file yet; FILE itself need not exist. Nothing is changed, and no process is disturbed.', &
      'dynstiction show map_lambda.h5'), &
    command_entry_t('plot', 'FILE.h5...', python, 'draw a result file, or several side by side', &
      'Draw a result file, or one figure that compares several runs. Of a run with many cycles only the first ones are '// &
      'drawn, unless --from or --to is given. Prints the file it wrote.', &
      'dynstiction plot fig3.h5 --kind path'//n// &
      'dynstiction plot fig3.h5 --columns friction,theta --from 2 --to 3'//n// &
      'dynstiction plot 1deg.h5 2deg.h5 --overlay'), &
    command_entry_t('trade', 'DECK', python, 'measured error against cost of methods and models', &
      'Measure error against cost on the deck''s own scene: models, methods and tolerances, against a reference whose own '// &
      'error is estimated. Prints the best settings as a table, and the cheapest ones for an accuracy as lines of a deck; '// &
      'draws error against cost.', &
      'dynstiction trade inputs/fig3.nml --accuracy 1e-4'//n// &
      'dynstiction trade inputs/fig3.nml --accuracy 1e-2 --quantities period --budget 3'), &
    command_entry_t('compare', 'DECK TRACE', python, 'compare a measured trace with a scene', &
      'Compare a measured trace of the force along the pull with the run of a deck: period, peak, valley, slip time and creep '// &
      'before slip of both, cycle by cycle, with their scatter, and the mean force over a cycle. TRACE is a table of text or '// &
      'an HDF5 file with time and force. Prints a table, draws a figure.', &
      'dynstiction compare my.nml trace.csv'//n// &
      'dynstiction compare my.nml trace.csv --time t --force "F [mN]" --unit time=ms --from 10'), &
    command_entry_t('fit', 'DECK TRACE', python, 'find the parameters of a measured trace', &
      'Find parameters of a deck from a measured trace of the force along the pull: least squares on the mean waveform of '// &
      'its cycles and their period, first with the slow model, then with that of the deck. Prints values, errors, intervals, '// &
      'and what the trace does not determine; writes the fitted deck, draws waveform and residuals. TRACE is as for compare.', &
      'dynstiction fit my.nml trace.csv --free system.misalignment_deg,friction.mu_0'//n// &
      'dynstiction fit my.nml trace.csv --free system.mass --fitted fitted.nml'), &
    command_entry_t('report', 'FILE.h5', python, 'one HTML page with all contents of a result file', &
      'Write one HTML page: summary, figures, animation of the friction vector, cycles, parameters, solver '// &
      'statistics, provenance, deck. It needs neither network nor other files. Prints the file it wrote.', &
      'dynstiction report fig3.h5'), &
    command_entry_t('export', 'FILE.h5', python, 'write a result file''s tables as CSV', &
      'Write the tables of a result file as CSV: for a run time series, events and summary, for a sweep its '// &
      'cases and their cycles. Prints the files it wrote.', &
      'dynstiction export fig3.h5'), &
    command_entry_t('animate', 'FILE.h5', python, 'show a run from above', &
      'Show the object from above, while friction turns and the spring force and the position change. Prints what it wrote.', &
      'dynstiction animate fig3.h5 -o fig3.gif --from 2 --to 3'), &
    command_entry_t('paper', '', python, 'draw every figure of the paper', &
      'Run the decks of Nakano and Popov (2020) and draw every figure. Prints the files it wrote.', &
      'dynstiction paper -o figures')]

  character(*), parameter :: takes_settings = 'run sweep merge check stability cycles trade compare fit'

  !> name, argument, commands, times, meaning, lacking
  type(option_t), parameter :: options(*) = [ &
    option_t('-o', 'FILE', 'run sweep merge', '?', 'the output file (one deck only)', 'a file name: write -o FILE'), &
    option_t('--set', 'GROUP.KEY=VALUE', takes_settings, '*', &
      'use VALUE in place of the deck''s; may be repeated; text needs no quotes', 'a setting: write --set GROUP.KEY=VALUE'), &
    option_t('--set', 'GROUP.KEY=', takes_settings, '*', 'remove the key from the deck: its default is used', ''), &
    option_t('--vary', 'KEY=FIRST:LAST:COUNT', 'sweep merge', '*', &
      'values of GROUP.KEY, both ends included; :log at the end for equal ratios; several make a grid', &
      'a key: write --vary GROUP.KEY=FIRST:LAST:COUNT'), &
    option_t('--share', 'I/N', 'run sweep', '?', &
      'run the I-th of N equal parts of a sweep, into FILE.I-of-N.h5; dynstiction merge joins them', &
      'its number: write --share I/N or --share auto'), &
    option_t('--share', 'auto', 'run sweep', '?', 'I and N from the job array, or from the launcher of several processes', ''), &
    option_t('--retry', '', 'run sweep', '?', 'also run the cases again that failed before', ''), &
    option_t('--sensitivity', 'KEYS', 'run cycles', '?', &
      'also print how the cycle of the motion changes with parameters GROUP.KEY, with commas between them', &
      'parameters: write --sensitivity system.mass,friction.v_f'), &
    option_t('--overwrite', '', 'run sweep merge trade plot compare fit report export animate paper', '?', &
      'replace existing output files', ''), &
    option_t('--quiet', '', 'run sweep resume merge', '?', 'no progress, no notes, no summary', ''), &
    option_t('--json', '', 'template', '?', &
      'print all names as JSON: commands, options, exit statuses, keys, output columns, summary values, statistics', ''), &
    option_t('--help', '', '', '?', 'the help on the program, or on a command', ''), &
    option_t('--version', '', '', '?', 'the version of the program, and how it was built', ''), &
    option_t('--kind', 'KIND', 'plot', '?', 'for a run history, velocities, spectrogram, damping, creep, path, columns or '// &
      'cycle_map; default: by its model; for a sweep map (default), lambda, '// &
      'bifurcation', ''), &
    option_t('--quantity', 'NAME', 'plot', '?', &
      'quantity of a map of a sweep, like period (default: swing), or of a bifurcation diagram (peak_force)', ''), &
    option_t('--columns', 'NAMES', 'plot', '?', &
      'columns of a run to draw, with commas between them, like friction,theta; one panel each', &
      'names of columns: write --columns friction,theta'), &
    option_t('--overlay', '', 'plot', '?', 'draw several runs as lines in the same panels, not side by side', ''), &
    option_t('--from', 'T', 'plot', '?', &
      'first time of the run [s]; default of --from and --to: the first cycles, if there are many', ''), &
    option_t('--to', 'T', 'plot', '?', 'last time of the run [s]', ''), &
    option_t('-o', 'PNG', 'plot', '?', 'default: FILE.png, for several files comparison.png; also .pdf, .svg', ''), &
    option_t('--accuracy', 'A', 'trade', '?', 'of the recommended settings, which stay below it with a margin (1e-3)', ''), &
    option_t('--budget', 'S', 'trade', '?', 'wall time in seconds (10)', ''), &
    option_t('--quantities', 'NAMES', 'trade', '?', 'quantities that have this accuracy, with commas between them: values of '// &
      'the summary, elongation, slip_velocity, creep_velocity; default: elongation, period, peak_force and creep_velocity', ''), &
    option_t('-o', 'FIGURE', 'trade', '?', 'default: DECK with _trade.png, in the current folder; also .pdf, .svg', ''), &
    option_t('--time', 'COLUMN', 'compare fit', '?', &
      'column of times in TRACE: its number from 0, its name, or in HDF5 the path of a dataset; default: time, or 0', ''), &
    option_t('--force', 'COLUMN', 'compare fit', '?', 'the same for the force along the pull; default: force, or 1', ''), &
    option_t('--displacement', 'COLUMN', 'compare', '?', 'the same for the displacement along the pull, if it was measured', ''), &
    option_t('--lateral', 'COLUMN', 'compare', '?', 'the same for the lateral force, if it was measured', ''), &
    option_t('--unit', 'QUANTITY=UNIT', 'compare fit', '*', &
      'unit of time, force, displacement or lateral_force, like time=ms or force=mN, or its factor to SI, like force=-9.81e-3; '// &
      'default: that in TRACE, or SI', ''), &
    option_t('--delimiter', 'C', 'compare fit', '?', 'character between columns; default: found automatically', ''), &
    option_t('--interval', 'S', 'compare fit', '?', 'time between two samples [s], if there is no column of times', ''), &
    option_t('--from', 'T', 'compare fit', '?', 'first time of the trace that is used [s]', ''), &
    option_t('--to', 'T', 'compare fit', '?', 'last time of the trace that is used [s]', ''), &
    option_t('--free', 'KEYS', 'fit', '1', 'parameters GROUP.KEY to be found, with commas between them', &
      'parameters: write --free system.misalignment_deg'), &
    option_t('--starts', 'N', 'fit', '?', 'number of starts that are completed (2)', ''), &
    option_t('--seed', 'N', 'fit', '?', 'seed of the random starts (0): the same seed gives the same bits', ''), &
    option_t('--fitted', 'NML', 'fit', '?', 'the fitted deck; default: TRACE with _fitted.nml, in the current folder', ''), &
    option_t('-o', 'FIGURE', 'fit', '?', 'default: TRACE with _fitted.png, in the current folder; also .pdf, .svg', ''), &
    option_t('-o', 'FIGURE', 'compare', '?', 'default: TRACE with _compared.png, in the current folder; also .pdf, .svg', ''), &
    option_t('-o', 'HTML', 'report', '?', 'default: FILE.html', ''), &
    option_t('-o', 'DIR', 'export', '?', 'folder, created if it does not exist; default: the current one', ''), &
    option_t('-o', 'OUT', 'animate', '1', 'X.gif, X.mp4 (needs ffmpeg), or a folder for PNG frames', ''), &
    option_t('--from', 'T', 'animate', '?', &
      'first time of the run [s]; default of --from and --to: the first creep and three cycles', ''), &
    option_t('--to', 'T', 'animate', '?', 'last time of the run [s]', ''), &
    option_t('--fps', 'N', 'animate', '?', 'frames per second (20)', ''), &
    option_t('--seconds', 'S', 'animate', '?', 'length of the animation [s] (10)', ''), &
    option_t('-o', 'DIR', 'paper', '1', 'folder, created if it does not exist', ''), &
    option_t('--format', 'png|pdf|svg', 'paper', '?', 'default: png', '')]

  !> All exit statuses.
  type(exit_status_t), parameter :: exit_statuses(*) = [ &
    exit_status_t(0, 'done'), &
    exit_status_t(1, 'wrong usage'), &
    exit_status_t(2, 'a deck was refused; every error is printed as FILE:LINE: problem: suggestion'), &
    exit_status_t(3, 'a file or the output could not be read or written, exists already, or cannot be resumed'), &
    exit_status_t(4, 'the solver gave up, or there was no memory'), &
    exit_status_t(5, 'some cases of a sweep failed'), &
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

  !> The commands that Python carries out, or the others, blank-separated.
  pure function command_names(of_python) result(names)
    logical, intent(in) :: of_python
    character(:), allocatable :: names
    integer :: i

    names = ''
    do i = 1, size(commands)
      if (commands(i)%of_python .eqv. of_python) names = trim(names//' '//commands(i)%name)
    end do
    names = names(2:)
  end function command_names

  !> The options that a command takes, blank-separated; for '' those of the program and of all commands except Python's.
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

  !> Whether `command` takes the option; for '', whether the program or any command except Python's, which come last in an entry,
  !> does.
  pure logical function is_option_of(option, command)
    type(option_t), intent(in) :: option
    character(*), intent(in) :: command
    character(:), allocatable :: first

    first = word(option%commands, 1)
    is_option_of = has_word(option%commands, command)
    if (command == '') is_option_of = first == '' .or. has_word(command_names(of_python=.false.), first)
  end function is_option_of

  !> 'DECK', 'FILE.h5', 'MODEL' or ''.
  pure function operand_of(command) result(operand)
    type(command_entry_t), intent(in) :: command
    character(:), allocatable :: operand

    operand = command%operands(scan(command%operands, '[') + 1:len_trim(command%operands))
    if (verify(operand, '.]', back=.true.) < len(operand)) operand = operand(:verify(operand, '.]', back=.true.))
  end function operand_of
end module dst_command_table
