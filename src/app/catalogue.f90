!> All names that the executable and its results use, as JSON: commands, options, exit statuses, keys of a deck, columns, summary
!> values, statistics. `dynstiction template --json` prints it; the manual page, the documentation and the Python package read it.
module dst_catalogue
  use dst_command_line, only: usage_of
  use dst_command_table, only: command_entry_t, option_t, the_program, commands, options, exit_statuses, options_of
  use dst_deck, only: has_model
  use dst_columns, only: columns
  use dst_methods, only: methods
  use dst_schema, only: schema, key_count, kind_names, is_text, is_word_of, find_name, range_text, condition_count
  use dst_summary, only: summary_quantities
  use dst_text, only: integer_text, word, word_count
  use dst_motion_summary, only: statistics
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: catalogue

  character, parameter :: n = achar(10)

contains

  !> The catalogue of this version of the program.
  function catalogue(version) result(text)
    character(*), intent(in) :: version
    character(:), allocatable :: text
    integer :: i

    text = '{"version": '//quoted(version)//','//n//'"program": '//of_command(the_program)//','//n//'"commands": ['
    do i = 1, size(commands)
      call add(text, of_command(commands(i)))
    end do
    text = text//'],'//n//'"options": ['
    do i = 1, size(options)
      call add(text, of_option(options(i)))
    end do
    text = text//'],'//n//'"exit_statuses": ['
    do i = 1, size(exit_statuses)
      call add(text, '{"status": '//integer_text(exit_statuses(i)%status)//', "meaning": '//quoted(exit_statuses(i)%meaning)//'}')
    end do
    text = text//'],'//n//'"keys": ['
    do i = 1, key_count
      call add(text, of_key(i))
    end do
    text = text//'],'//n//'"methods": ['
    do i = 1, size(methods)
      call add(text, '{"name": '//quoted(methods(i)%name)//', "kind": '//quoted(methods(i)%kind)//', "order": '// &
        integer_text(methods(i)%order)//', "stages": '//integer_text(methods(i)%stages)//'}')
    end do
    call add_quantities(text, 'columns', columns)
    call add_quantities(text, 'summary', summary_quantities)
    call add_quantities(text, 'statistics', statistics)
    text = text//']}'//n
  end function catalogue

  !> An item of a list.
  subroutine add(text, item)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: item

    ! The brackets save copies of the whole text.
    if (text(len(text):) == '[') then
      text = text//(n//item)
    else
      text = text//(','//n//item)
    end if
  end subroutine add

  function of_command(command) result(text)
    type(command_entry_t), intent(in) :: command
    character(:), allocatable :: text

    text = '{"name": '//quoted(command%name)//', "operands": '//quoted(command%operands)//', "brief": '//quoted(command%brief)// &
      ', "meaning": '//quoted(command%meaning)//', "usage": '//quoted(usage_of(command))//', "options": '// &
      of_words(options_of(trim(command%name)))//', "examples": '//quoted(command%examples)//'}'
  end function of_command

  function of_option(option) result(text)
    type(option_t), intent(in) :: option
    character(:), allocatable :: text

    text = '{"name": '//quoted(option%name)//', "argument": '//quoted(option%argument)//', "commands": '// &
      of_words(option%commands)//', "times": '//quoted(option%times)//', "meaning": '//quoted(option%meaning)//'}'
  end function of_option

  !> A key; its default as in a deck, null if it has none. `models`: those that can use it; `used_by`: the other conditions.
  function of_key(i) result(text)
    integer, intent(in) :: i
    character(:), allocatable :: text, default, models, used_by
    integer :: k

    associate (key => schema(i), all_models => schema(find_name('model'))%choices)
      default = trim(key%default)
      if (is_text(key) .or. is_word_of(key, default)) default = quoted(default)
      if (default == '') default = 'null'
      models = ''
      do k = 1, word_count(all_models)
        if (has_model(i, word(all_models, k))) models = models//' '//word(all_models, k)
      end do
      used_by = ''
      do k = 1, condition_count(key)
        if (k > 1) used_by = used_by//', '
        used_by = used_by//quoted(key%used_by(k)%on)//': '//of_words(key%used_by(k)%choices)
      end do
      text = '{"group": '//quoted(key%group)//', "name": '//quoted(key%name)//', "kind": '//quoted(word(kind_names, key%kind))// &
        ', "required": '//trim(merge('true ', 'false', key%required))//', "units": '//quoted(key%unit)//', "range": '// &
        quoted(range_text(key))//', "choices": '//of_words(key%choices)//', "default": '//default//', "models": '// &
        of_words(adjustl(models))//', "used_by": {'//used_by//'}, "meaning": '//quoted(key%meaning)//'}'
    end associate
  end function of_key

  subroutine add_quantities(text, name, quantities)
    character(:), allocatable, intent(inout) :: text
    character(*), intent(in) :: name
    type(quantity_t), intent(in) :: quantities(:)
    integer :: i

    text = text//'],'//n//'"'//name//'": ['
    do i = 1, size(quantities)
      call add(text, '{"name": '//quoted(quantities(i)%name)//', "units": '//quoted(quantities(i)%units)//', "long_name": '// &
        quoted(quantities(i)%long_name)//'}')
    end do
  end subroutine add_quantities

  function of_words(words) result(text)
    character(*), intent(in) :: words
    character(:), allocatable :: text
    integer :: i

    text = ''
    do i = 1, word_count(words)
      text = text//', '//quoted(word(words, i))
    end do
    text = '['//text(min(3, len(text) + 1):)//']'
  end function of_words

  !> A JSON string, without trailing blanks.
  pure function quoted(text) result(string)
    character(*), intent(in) :: text
    character(:), allocatable :: string
    integer :: i

    string = trim(text)
    do i = len(string), 1, -1
      if (string(i:i) == n) then
        string = string(:i - 1)//'\n'//string(i + 1:)
      else if (scan(string(i:i), '"\') == 1) then
        string = string(:i - 1)//'\'//string(i:)
      end if
    end do
    string = '"'//string//'"'
  end function quoted
end module dst_catalogue
