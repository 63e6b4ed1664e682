!> Candidates for the word that is being typed in a shell.
!>
!> `dynstiction complete WORD...` is called by the scripts in tools/completion with the words after the program's name; the last one
!> is being typed. It prints the candidates, one in each line; a line '*.nml' or '*.h5' represents the files with that ending, '*/'
!> folders, and a candidate that ends in '=' is only the beginning of a word. So the shells need no list of commands, options or
!> keys of their own.
module dst_completion
  use dst_columns, only: columns
  use dst_command_line, only: argument_t, takes_value
  use dst_command_table, only: commands, options, find_command, command_names, options_of, is_option_of, operand_of
  use dst_schema, only: schema, key_count, find_key, find_name, real_kind, reals_kind
  use dst_summary, only: summary_quantities
  use dst_text, only: text_builder_t, starts_with, lower_case, has_word, with_blanks, word, word_count
  implicit none
  private

  public :: is_completion, completions

  !> Kinds of figure: those of the Python package.
  character(*), parameter :: kinds_of_figure = 'history velocities spectrogram damping creep path columns cycle_map '// &
    'map lambda bifurcation'

contains

  !> Whether the program is called by a shell for this purpose.
  pure logical function is_completion(arguments)
    type(argument_t), intent(in) :: arguments(:)

    is_completion = .false.
    if (size(arguments) > 1) is_completion = arguments(1)%text == 'complete'
  end function is_completion

  !> The candidates for the last of the arguments, one in each line.
  function completions(arguments) result(text)
    type(argument_t), intent(in) :: arguments(:)
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    character(:), allocatable :: command, option, typed
    integer :: i, operands

    command = ''
    option = ''
    operands = 0
    do i = 2, size(arguments) - 1
      ! A word is an option's value, an option, the command, or one of its operands.
      if (takes_value(option)) then
        option = ''
      else if (starts_with(arguments(i)%text, '-')) then
        option = arguments(i)%text
      else
        option = ''
        if (command == '') then
          command = arguments(i)%text
        else
          operands = operands + 1
        end if
      end if
    end do
    typed = arguments(size(arguments))%text
    if (takes_value(option)) then
      call offer_values(builder, command, option, typed)
    else if (starts_with(typed, '--set=')) then
      call offer_settings(builder, '--set=', typed)
    else if (command == '') then
      call offer(builder, command_names(of_python=.false.)//' '//command_names(of_python=.true.)//' --help --version', typed)
    else if (starts_with(typed, '-')) then
      call offer(builder, options_of(command)//' --help', typed)
    else if (find_command(command) > 0) then
      call offer_operand(builder, operand_of(commands(find_command(command))), operands, typed)
    end if
    text = builder%content()
  end function completions

  !> If there are several operands of different kinds, the next one.
  subroutine offer_operand(builder, kinds, given, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: kinds, typed
    integer, intent(in) :: given

    if (kinds /= '') call offer_kind(builder, word(kinds, min(given + 1, word_count(kinds))), typed)
  end subroutine offer_operand

  subroutine offer_values(builder, command, option, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: command, option, typed
    integer :: i

    if (option == '--set') then
      call offer_settings(builder, '', typed)
    else if (option == '--quantity') then
      do i = 1, size(summary_quantities)
        call offer(builder, trim(summary_quantities(i)%name), typed)
      end do
    else if (option == '--unit') then
      call offer(builder, 'time= force=', typed)
    else
      do i = 1, size(options)
        if (options(i)%name == option .and. is_option_of(options(i), command)) &
          call offer_kind(builder, trim(options(i)%argument), typed)
      end do
    end if
  end subroutine offer_values

  !> GROUP.KEY=, and after it the words from which the key takes one.
  subroutine offer_settings(builder, before, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: before, typed
    character(:), allocatable :: name
    integer :: i, n, dot

    if (index(typed(len(before) + 1:), '=') == 0) then
      do i = 1, key_count
        call offer(builder, before//trim(schema(i)%group)//'.'//trim(schema(i)%name)//'=', typed)
      end do
      return
    end if
    name = typed(len(before) + 1:len(before) + index(typed(len(before) + 1:), '=') - 1)
    dot = index(name, '.')
    i = find_key(name(:dot - 1), name(dot + 1:))
    if (i == 0) return
    do n = 1, word_count(schema(i)%choices)
      call offer(builder, before//name//'='//word(schema(i)%choices, n), typed)
    end do
  end subroutine offer_settings

  !> The keys that can be fitted: real numbers of &system and &friction, several with commas between them.
  subroutine offer_parameters(builder, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: typed
    integer :: i

    do i = 1, key_count
      if (schema(i)%kind /= real_kind .or. .not. has_word('system friction', trim(schema(i)%group))) cycle
      call offer_in_list(builder, trim(schema(i)%group)//'.'//trim(schema(i)%name), typed)
    end do
  end subroutine offer_parameters

  !> A word of a list with commas, of which the last is being typed.
  subroutine offer_in_list(builder, name, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: name, typed

    call offer(builder, typed(:index(typed, ',', back=.true.))//name, typed)
  end subroutine offer_in_list

  !> GROUP.KEY= for the keys that a sweep can vary.
  subroutine offer_varied(builder, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: typed
    integer :: i

    do i = 1, key_count
      if (schema(i)%kind == real_kind .or. schema(i)%kind == reals_kind) &
        call offer(builder, trim(schema(i)%group)//'.'//trim(schema(i)%name)//'=', typed)
    end do
  end subroutine offer_varied

  !> Candidates for an operand or an option's argument: words are candidates themselves, capitals mean a kind of file or word.
  subroutine offer_kind(builder, kind, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: kind, typed
    integer :: i

    select case (kind)
    case ('DECK', 'NML')
      call builder%line('*.nml')
    case ('FILE', 'FILE.h5')
      call builder%line('*.h5')
    case ('TRACE')
      call builder%line('*.csv')
      call builder%line('*.h5')
    case ('FIGURE')
      call builder%line('*.png')
    case ('OUT')
      call builder%line('*.gif')
      call builder%line('*.mp4')
    case ('DIR')
      call builder%line('*/')
    case ('KIND')
      call offer(builder, kinds_of_figure, typed)
    case ('NAMES')
      do i = 1, size(columns)
        call offer_in_list(builder, trim(columns(i)%name), typed)
      end do
    case ('KEYS')
      call offer_parameters(builder, typed)
    case ('COMMAND')
      call offer(builder, command_names(of_python=.false.)//' '//command_names(of_python=.true.), typed)
    case ('PNG', 'HTML')
      call builder%line('*.'//lower_case(kind))
    case ('MODEL')
      call offer(builder, schema(find_name('model'))%choices, typed)
    case default
      if (starts_with(kind, 'KEY=')) then
        call offer_varied(builder, typed)
      else if (lower_case(kind) == kind) then
        call offer(builder, with_blanks(kind, '|'), typed)
      end if
    end select
  end subroutine offer_kind

  !> The words that begin with the characters typed so far.
  subroutine offer(builder, words, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: words, typed
    integer :: n

    do n = 1, word_count(words)
      if (starts_with(word(words, n), typed)) call builder%line(word(words, n))
    end do
  end subroutine offer
end module dst_completion
