!> Candidates for the word that is being typed in a shell.
!>
!> `dynstiction complete WORD...` is called by the scripts in tools/completion with the words after the program's name; the last one
!> is being typed. It prints the candidates, one in each line; a line '*.nml' or '*.h5' represents the files with that ending, '*/'
!> folders, and a candidate that ends in '=' is only the beginning of a word. So the shells need no list of commands, options or
!> keys of their own.
module dst_completion
  use dst_command_line, only: argument_t, takes_value
  use dst_command_table, only: commands, options, find_command, command_names, options_of, is_option_of, operand_of
  use dst_schema, only: schema, key_count, find_key, find_name, real_kind, reals_kind
  use dst_text, only: text_builder_t, starts_with, lower_case, with_blanks, word, word_count
  implicit none
  private

  public :: is_completion, completions

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
    integer :: i

    command = ''
    option = ''
    do i = 2, size(arguments) - 1
      ! A word is an option's value, an option, the command, or one of its operands.
      if (takes_value(option)) then
        option = ''
      else if (starts_with(arguments(i)%text, '-')) then
        option = arguments(i)%text
      else
        option = ''
        if (command == '') command = arguments(i)%text
      end if
    end do
    typed = arguments(size(arguments))%text
    if (takes_value(option)) then
      call offer_values(builder, command, option, typed)
    else if (starts_with(typed, '--set=')) then
      call offer_settings(builder, '--set=', typed)
    else if (command == '') then
      call offer(builder, command_names()//' --help --version', typed)
    else if (starts_with(typed, '-')) then
      call offer(builder, options_of(command)//' --help', typed)
    else if (find_command(command) > 0) then
      call offer_kind(builder, operand_of(commands(find_command(command))), typed)
    end if
    text = builder%content()
  end function completions

  subroutine offer_values(builder, command, option, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: command, option, typed
    integer :: i

    if (option == '--set') then
      call offer_settings(builder, '', typed)
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
      call offer_keys(builder, [(.true., i=1, key_count)], before, '=', typed)
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

  !> GROUP.KEY of some keys, between two texts.
  subroutine offer_keys(builder, which, before, after, typed)
    type(text_builder_t), intent(inout) :: builder
    logical, intent(in) :: which(:)
    character(*), intent(in) :: before, after, typed
    integer :: i

    do i = 1, key_count
      if (which(i)) call offer(builder, before//trim(schema(i)%group)//'.'//trim(schema(i)%name)//after, typed)
    end do
  end subroutine offer_keys

  !> Candidates for an operand or an option's argument: words are candidates themselves, capitals mean a kind of file or word.
  subroutine offer_kind(builder, kind, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: kind, typed

    select case (kind)
    case ('DECK')
      call builder%line('*.nml')
    case ('FILE', 'FILE.h5')
      call builder%line('*.h5')
    case ('KEYS')
      ! The parameters of a motion: real numbers of &system and &friction, several with commas between them.
      call offer_keys(builder, schema%kind == real_kind .and. (schema%group == 'system' .or. schema%group == 'friction'), &
        typed(:index(typed, ',', back=.true.)), '', typed)
    case ('MODEL')
      call offer(builder, schema(find_name('model'))%choices, typed)
    case default
      if (starts_with(kind, 'KEY=')) then
        call offer_keys(builder, schema%kind == real_kind .or. schema%kind == reals_kind, '', '=', typed)
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
