!> Scanner of Fortran namelist text: finds the groups, the keys and the words of their values, with their lines.
!>
!> Fortran's own namelist read silently accepts half of all mistakes and reports the wrong place for the others. The scanner only
!> uses the grammar; dst_deck interprets the groups and keys. It reads the text once, from left to right, and keeps positions, not
!> copies.
module dst_namelist
  use dst_text, only: decode, excerpt, lower_case
  use dst_faults, only: faults_t, place_t
  use dst_units, only: is_unit
  implicit none
  private

  public :: namelist_t, token_t, scan_namelist, token_text, last_line, is_plain_text

  !> A longer name is cut; no valid name is as long.
  integer, parameter :: name_length = 64

  !> One word of a value.
  type :: token_t
    integer :: line = 0
    integer :: first = 1, last = 0     !! its place in the text, without the outer quotes
    integer :: repeat = 1              !! of a repeat count n*
    character :: quote = ' '           !! the quote around it
    character(8) :: unit = ''          !! a unit after a number, where none belongs
  end type token_t

  !> One `&group`, or one `key = value` of the group before it.
  type :: entry_t
    character(name_length) :: name = ''
    logical :: is_group = .false.
    integer :: line = 0
    integer :: first = 1, last = 0     !! in `tokens`
    logical :: faulty = .false.        !! a fault of it has been noted
  end type entry_t

  !> A deck taken apart into groups and their keys, with their places.
  type :: namelist_t
    character(:), allocatable :: text
    type(entry_t), allocatable :: entries(:)
    type(token_t), allocatable :: tokens(:)
    integer :: entry_count = 0, token_count = 0
    logical :: plain = .true.          !! false if the text has bytes that no text file has
    type(faults_t) :: faults
  end type namelist_t

  character, parameter :: tab = achar(9), newline = achar(10), return = achar(13)
  !> The end of the text: no text has it inside.
  character, parameter :: nul = achar(0)
  character(*), parameter :: blanks = ' '//tab//return
  character(*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_'
  character(*), parameter :: digits = '0123456789'
  character(*), parameter :: word_ends = blanks//newline//',/=!&''"'//nul
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

  !> Scan a deck, or with `key` the values of this key, as they are written after `=`: there ! begins no comment. Every fault is
  !> added to `list%faults`, and everything that could be read is kept in `list`.
  subroutine scan_namelist(given, list, key)
    character(*), intent(in) :: given
    type(namelist_t), intent(out) :: list
    character(*), intent(in), optional :: key
    character(:), allocatable :: text, value_ends
    integer :: position, line

    ! Two, so that each character has a next one.
    text = given//nul//nul
    list%text = text
    value_ends = blanks//newline//',/&'//nul
    if (.not. present(key)) value_ends = value_ends//'!'
    ! There is room for all of it: a word, or a key with its =, takes two characters; what is shorter is a fault.
    allocate (list%entries(len(text)/2 + 102), list%tokens(len(text)/2 + 2))
    position = 1
    line = 1
    if (present(key)) then
      call add_entry(key, .false.)
      call read_values()
      if (list%faults%count == 0 .and. here() /= nul) &
        call refuse("unexpected '"//excerpt(given(position:))//"': give only the value")
      return
    end if
    call check_bytes(given, list%faults, list%plain)
    if (.not. list%plain) return
    if (index(text, byte_order_mark) == 1) position = 4
    do while (.not. list%faults%full())
      call skip_blank()
      if (here() == nul) exit
      if (here() == '&') then
        call scan_group()
      else
        call skip_stray()
      end if
    end do

  contains

    !> Everything from `&` to the end of the group: `/`, `&end`, or a fault: the next group, the end of the text.
    subroutine scan_group()
      character(:), allocatable :: name
      integer :: before

      position = position + 1
      name = next_word()
      if (name == '') then
        call refuse("'&' without a group name: write the name right after it, as in &scene")
        call skip_blank()
        name = next_word()
      end if
      call add_entry(name, .true.)
      do while (.not. list%faults%full())
        call skip_blank()
        select case (here())
        case (nul)
          call list%faults%add(place_t(last_line(given)), "missing '/': end the group &"//excerpt(name)//" with a '/'")
          return
        case ('/')
          position = position + 1
          return
        case ('&')
          before = position
          position = before + 1
          if (lower_case(next_word()) == 'end') return
          position = before
          call refuse("missing '/': end the group &"//excerpt(name)//" with a '/' before this line's '&'")
          return
        end select
        call scan_key()
        call read_values()
      end do
    end subroutine scan_group

    !> The key and its `=`.
    subroutine scan_key()
      character(:), allocatable :: name, shown
      integer :: part

      shown = "'"//excerpt(rest_of_line())//"'"
      if (.not. begins_name(here())) then
        call add_entry('', .false.)
        call refuse_entry(shown//' where a key should be: write KEY = VALUE', line)
        return
      end if
      name = next_word()
      part = scan(name//'(', '(%')
      call add_entry(name(:part - 1), .false.)
      if (part <= len(name)) call refuse_entry(shown//' sets a part of a key: give all values at once, as in '// &
        excerpt(name(:part - 1))//' = VALUE, VALUE', line)
      call skip_blank()
      if (here() == '=') then
        position = position + 1
      else
        call refuse_entry("'"//excerpt(name)//"' without '=': write KEY = VALUE", list%entries(list%entry_count)%line)
      end if
    end subroutine scan_key

    subroutine add_entry(name, is_group)
      character(*), intent(in) :: name
      logical, intent(in) :: is_group

      list%entry_count = list%entry_count + 1
      list%entries(list%entry_count) = entry_t(name, is_group, line, list%token_count + 1)
    end subroutine add_entry

    !> Note a fault in this line.
    subroutine refuse(text)
      character(*), intent(in) :: text

      call list%faults%add(place_t(line), text)
    end subroutine refuse

    !> Note the first fault of the last entry.
    subroutine refuse_entry(text, at)
      character(*), intent(in) :: text
      integer, intent(in) :: at   !! line

      associate (it => list%entries(list%entry_count))
        if (.not. it%faulty) call list%faults%add(place_t(at), text)
        it%faulty = .true.
      end associate
    end subroutine refuse_entry

    !> The values of the last key, up to the next key or the end of the group.
    subroutine read_values()
      character(:), allocatable :: name
      logical :: after_value

      name = excerpt(trim(list%entries(list%entry_count)%name))
      after_value = .false.
      do
        call skip_blank()
        if (scan(here(), '/&'//nul) == 1) exit
        if (next_key_follows()) exit
        if (here() == ',') then
          if (.not. after_value) call refuse_entry("nothing before a ',' in '"//name// &
            "': an empty value is not allowed, give it or remove the ','", line)
          after_value = .false.
          position = position + 1
        else
          call read_token()
          after_value = .true.
        end if
      end do
      associate (it => list%entries(list%entry_count))
        it%last = list%token_count
        if (it%last < it%first) call refuse_entry("'"//name//"' has an empty value: give a value or remove the key", it%line)
      end associate
    end subroutine read_values

    !> One word with its repeat count.
    subroutine read_token()
      type(token_t) :: token
      integer :: first, star

      first = position
      token%line = line
      star = first + verify(text(first:), digits) - 1
      if (star > first .and. text(star:star) == '*') then
        ! More than any list may have, and no overflow.
        token%repeat = huge(1)
        if (star - first <= 9) read (text(first:star - 1), *) token%repeat
        position = star + 1
      end if
      if (scan(here(), '''"') == 1) then
        call read_string(token)
        if (position == token%last + 1) then
          call refuse_entry('unclosed quote '//token%quote//excerpt(trim(text(token%first:token%last)))//': close it with '// &
            token%quote//' in the same line', line)
          return
        end if
      else
        token%first = position
        call skip_until(word_ends)
        token%last = position - 1
        if (scan(text(token%first:token%first), digits//'+-.') == 1) call take_unit(token)
        if (position > first .and. (token%last < token%first .or. token%repeat < 1)) then
          call refuse_entry("'"//excerpt(text(first:position - 1))//"' repeats nothing: give a count of 1 or more and, right "// &
            "after the '*', the value", line)
          return
        end if
      end if
      if (scan(here(), value_ends) == 0) then
        call refuse_entry("unexpected '"//excerpt(rest_of_line())//"' in a value: separate values by ',', put text in quotes, "// &
          'and double a quote inside it', line)
        ! At least one character further, past a quote that would only be found again.
        position = position + 1
        call skip_until(value_ends)
        return
      end if
      list%token_count = list%token_count + 1
      list%tokens(list%token_count) = token
    end subroutine read_token

    !> A string, up to behind the quote that ends it, or to the end of its line.
    subroutine read_string(token)
      type(token_t), intent(inout) :: token

      token%quote = here()
      token%first = position + 1
      do
        position = position + scan(text(position + 1:), token%quote//newline//nul)
        if (text(position:position + 1) /= repeat(token%quote, 2)) exit
        position = position + 1
      end do
      token%last = position - 1
      if (here() == token%quote) position = position + 1
    end subroutine read_string

    !> A unit after the number that was read, in its line: otherwise the '/' of mm/s would end the group.
    subroutine take_unit(token)
      type(token_t), intent(inout) :: token
      integer :: first, last, next

      ! There may be no blank between them.
      last = end_of_run(token%first)
      do first = token%first, last
        ! No unit begins as a number does.
        if (verify(text(first:first), digits//'+-.') == 0) cycle
        if (is_unit(text(first:last))) exit
      end do
      if (first <= last) then
        token%last = first - 1
      else
        first = position + verify(text(position:), ' '//tab) - 1
        last = end_of_run(first)
        ! It may be a key of the same name.
        next = last + verify(text(last + 1:), ' '//tab)
        if (first == position .or. .not. is_unit(text(first:last)) .or. text(next:next) == '=') return
      end if
      token%unit = text(first:last)
      position = last + 1
    end subroutine take_unit

    !> The last place before a blank, a comma or a comment.
    integer function end_of_run(place)
      integer, intent(in) :: place

      end_of_run = place - 2 + scan(text(place:), blanks//newline//',!'//nul)
    end function end_of_run

    !> Whether a name and `=` begin here.
    logical function next_key_follows()
      integer :: before(2)

      next_key_follows = .false.
      if (.not. begins_name(here())) return
      before = [position, line]
      call skip_until(word_ends)
      call skip_blank()
      next_key_follows = here() == '='
      position = before(1)
      line = before(2)
    end function next_key_follows

    !> Text between groups: one fault for all of it.
    subroutine skip_stray()
      call refuse("'"//excerpt(rest_of_line())//"' outside a group: put it between &GROUP and '/', or after a '!'")
      do while (scan(here(), '&'//nul) == 0)
        call skip_until(blanks//newline//'&!')
        call skip_blank()
      end do
    end subroutine skip_stray

    !> Move past blanks, line ends and comments.
    subroutine skip_blank()
      do
        if (here() == newline) then
          line = line + 1
        else if (here() == '!' .and. .not. present(key)) then
          call skip_until(newline)
          cycle
        else if (scan(here(), blanks) == 0) then
          return
        end if
        position = position + 1
      end do
    end subroutine skip_blank

    !> Move to the next character that is in `set`, or to the end.
    subroutine skip_until(set)
      character(*), intent(in) :: set

      position = position - 1 + scan(text(position:), set//nul)
    end subroutine skip_until

    !> The word from here to the next separator; '' if there is none.
    function next_word() result(word)
      character(:), allocatable :: word
      integer :: first

      first = position
      call skip_until(word_ends)
      word = text(first:position - 1)
    end function next_word

    !> Only as much as messages show, so that many faults in one long line cost no more than the line.
    function rest_of_line() result(rest)
      character(:), allocatable :: rest
      integer, parameter :: enough = 80

      rest = text(position:min(len(text), position + enough))
      rest = trim(rest(:scan(rest//nul, newline//return//nul) - 1))
    end function rest_of_line

    character function here()
      here = text(position:position)
    end function here
  end subroutine scan_namelist

  !> A letter, or a byte of a letter that is not ASCII.
  pure logical function begins_name(letter)
    character, intent(in) :: letter

    begins_name = scan(letter, letters) == 1 .or. iachar(letter) >= 128
  end function begins_name

  !> A deck is UTF-8 without control characters except tab and line ends; `plain` is false if it has bytes that no text file has.
  subroutine check_bytes(text, faults, plain)
    character(*), intent(in) :: text
    type(faults_t), intent(inout) :: faults
    logical, intent(out) :: plain
    integer :: i, line, bad_line, width, code

    bad_line = 0
    line = 1
    i = 1
    do while (i <= len(text))
      associate (byte => iachar(text(i:i)))
        plain = byte >= 32 .and. byte /= 127 .or. scan(text(i:i), tab//newline) == 1
      end associate
      if (text(i:i) == return) plain = index(text(i:min(i + 1, len(text)))//newline, return//newline) == 1
      if (.not. plain) then
        call faults%add(place_t(line), trim(merge('NUL bytes         ', 'control characters', text(i:i) == nul))// &
                        ' in the deck: a deck is plain UTF-8 text, not a binary file')
        return
      end if
      call decode(text(i:min(i + 3, len(text))), width, code)
      if (bad_line == 0 .and. width == 0) bad_line = line
      if (text(i:i) == newline) line = line + 1
      i = i + max(1, width)
    end do
    plain = .true.
    if (bad_line > 0) call faults%add(place_t(bad_line), 'a character is not UTF-8: save the deck as UTF-8 text')
  end subroutine check_bytes

  !> Whether `text` is UTF-8 without control characters.
  logical function is_plain_text(text)
    character(*), intent(in) :: text
    type(faults_t) :: faults

    call check_bytes(text, faults, is_plain_text)
    is_plain_text = faults%count == 0
  end function is_plain_text

  !> Number of the last line that has text.
  pure integer function last_line(text)
    character(*), intent(in) :: text
    integer :: i

    last_line = 1 + count([(text(i:i) == newline, i=1, len_trim(text) - 1)])
  end function last_line

  !> The characters of a token; doubled quotes of a string become single ones.
  pure function token_text(list, token) result(text)
    type(namelist_t), intent(in) :: list
    type(token_t), intent(in) :: token
    character(:), allocatable :: text
    integer :: i, length

    allocate (character(token%last - token%first + 1) :: text)
    length = 0
    i = token%first
    do while (i <= token%last)
      length = length + 1
      text(length:length) = list%text(i:i)
      if (token%quote /= ' ' .and. list%text(i:i) == token%quote) i = i + 1
      i = i + 1
    end do
    text = text(:length)
  end function token_text
end module dst_namelist
