!> What a shell may offer for the word that is being typed.
!>
!> `dynstiction complete WORD...` is called by the scripts in tools/completion with the words after the program's name; the last
!> one is being typed. It prints the candidates, a line each; a line '*.nml' or '*.h5' stands for the files of that ending. So the
!> shells know no command, option or key themselves.
module dst_completion
  use dst_command_line, only: argument_t, commands, python_commands, options_of, takes_value, trade_quantities
  use dst_schema, only: key_t, schema, key_count, find_key, find_name
  use dst_text, only: text_builder_t, starts_with, word, word_count
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

  !> The candidates for the last of the arguments, a line each.
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
      call offer_values(builder, option, typed)
    else if (starts_with(typed, '--set=')) then
      call offer_settings(builder, '--set=', typed)
    else if (command == '') then
      call offer(builder, commands//' '//python_commands//' --help --version', typed)
    else if (starts_with(typed, '-')) then
      call offer(builder, options_of(command)//' --help', typed)
    else
      call offer_operands(builder, command, typed)
    end if
    text = builder%content()
  end function completions

  subroutine offer_values(builder, option, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: option, typed

    select case (option)
    case ('--set')
      call offer_settings(builder, '', typed)
    case ('-o')
      call builder%line('*.h5')
    case ('--quantity')
      call offer(builder, trade_quantities//' all', typed)
    end select
  end subroutine offer_values

  !> GROUP.KEY=, and after it the words of which the key takes one.
  subroutine offer_settings(builder, before, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: before, typed
    character(:), allocatable :: name
    integer :: i, n, dot

    if (index(typed(len(before) + 1:), '=') == 0) then
      do i = 1, key_count
        call offer(builder, before//name_of(schema(i))//'=', typed)
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

  subroutine offer_operands(builder, command, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: command, typed

    select case (command)
    case ('run', 'merge', 'check', 'stability', 'trade')
      call builder%line('*.nml')
    case ('resume', 'show')
      call builder%line('*.h5')
    case ('template')
      call offer(builder, schema(find_name('model'))%choices, typed)
    end select
  end subroutine offer_operands

  !> Those of the words that begin like the one that is being typed.
  subroutine offer(builder, words, typed)
    type(text_builder_t), intent(inout) :: builder
    character(*), intent(in) :: words, typed
    integer :: n

    do n = 1, word_count(words)
      if (starts_with(word(words, n), typed)) call builder%line(word(words, n))
    end do
  end subroutine offer

  pure function name_of(key) result(name)
    type(key_t), intent(in) :: key
    character(:), allocatable :: name

    name = trim(key%group)//'.'//trim(key%name)
  end function name_of
end module dst_completion
