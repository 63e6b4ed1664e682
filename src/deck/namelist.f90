!> Scanner of Fortran namelist text: finds the groups, the keys and the words of their values, with their lines.
!>
!> Fortran's own namelist read silently accepts half of all mistakes and reports the wrong place for the others. The scanner only
!> uses the grammar; dst_deck interprets the groups and keys. It reads the text once, from left to right, and keeps positions, not
!> copies.
module dst_namelist
  use dst_text, only: excerpt, lower_case, utf8_width
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
    logical :: bare = .false.          !! without =, so perhaps no key at all
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
  character(*), parameter :: word_ends = blanks//newline//',/=!&''"(%'//nul
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

  !> Scan a deck, or with `key` the values of this key, as they are written after `=`: there ! begins no comment. Every fault is
  !> added to `list%faults`, and everything that could be read is kept in `list`.
  subroutine scan_namelist(given, list, key)
    character(*), intent(in) :: given
    type(namelist_t), intent(out) :: list
    character(*), intent(in), optional :: key
    character(:), allocatable :: text
    integer :: position, line

    ! Two, so that each character has a next one.
    text = given//nul//nul
    list%text = text
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
      call add_entry(next_word(), .true.)
      associate (group => list%entries(list%entry_count))
        if (group%name == '') then
          call refuse("'&' without a group name: write the name right after it, as in &scene")
          call skip_blank()
          group%name = next_word()
        end if
        name = excerpt(trim(group%name))
      end associate
      if (lower_case(name) == 'end') then
        call refuse("'&end' without a group to end: remove it")
        list%entry_count = list%entry_count - 1
        return
      end if
      do while (.not. list%faults%full())
        call skip_blank()
        select case (here())
        case (nul)
          call list%faults%add(place_t(last_line(given)), "missing '/': end the group &"//name//" with a '/'")
          return
        case ('/')
          position = position + 1
          return
        case ('&')
          before = position
          position = before + 1
          if (lower_case(next_word()) == 'end') return
          position = before
          call refuse("missing '/': end the group &"//name//" with a '/' before this line's '&'")
          return
        end select
        call scan_key()
        call read_values()
      end do
    end subroutine scan_group

    !> The key and its `=`.
    subroutine scan_key()
      character(:), allocatable :: name

      if (.not. begins_name(here())) then
        call add_entry('', .false.)
        call refuse_entry("'"//excerpt(rest_of_line())//"' where a key should be: write KEY = VALUE", line)
        return
      end if
      name = next_word()
      call add_entry(name, .false.)
      associate (it => list%entries(list%entry_count))
        if (here() == '(' .or. here() == '%') then
          call refuse_entry("'"//excerpt(name//rest_of_line())//"' sets a part of a key: give all values at once, as in "// &
                            excerpt(name)//' = VALUE, VALUE', it%line)
          ! Move past the subscript, within its line.
          call skip_until(newline//'=!/&')
        end if
        call skip_blank()
        if (here() == '=') then
          position = position + 1
        else
          call refuse_entry("'"//excerpt(name)//"' without '=': write KEY = VALUE", it%line)
          it%bare = .true.
        end if
      end associate
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
        if (here() == ',') then
          if (.not. after_value) &
            call refuse_entry("nothing before a ',' in '"//name// &
                              "': an empty value is not allowed, give it or remove the ','", line)
          after_value = .false.
          position = position + 1
        else if (next_key_follows()) then
          exit
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
      character(:), allocatable :: problem

      problem = ''
      token%line = line
      call read_repeat(token%repeat, problem)
      if (problem == '') then
        if (scan(here(), '''"') == 1) then
          call read_string(token, problem)
        else
          call read_bare(token, problem)
          if (scan(text(token%first:token%first), digits//'+-.') == 1) call take_unit(token, problem)
        end if
      end if
      if (problem /= '') then
        call refuse_entry(problem, token%line)
      else
        list%token_count = list%token_count + 1
        list%tokens(list%token_count) = token
      end if
    end subroutine read_token

    !> `n*` before a value.
    subroutine read_repeat(times, problem)
      integer, intent(out) :: times
      character(:), allocatable, intent(inout) :: problem
      character(:), allocatable :: number
      integer :: star

      times = 1
      star = position + verify(text(position:), digits) - 1
      if (star == position .or. text(star:star) /= '*') return
      number = text(position:star - 1)
      position = star + 1
      ! More than any list may have, and no overflow.
      times = huge(1)
      if (len(number) <= 9) read (number, *) times
      if (times < 1) then
        problem = "repeat count '"//number//"*' is not positive: give 1 or more"
      else if (scan(here(), word_ends) == 1 .and. scan(here(), '''"') == 0) then
        problem = "'"//excerpt(number)//"*' repeats an empty value: give the value after the '*'"
      end if
      if (problem /= '') call skip_until(word_ends)
    end subroutine read_repeat

    !> A string; it ends in its own line.
    subroutine read_string(token, problem)
      type(token_t), intent(inout) :: token
      character(:), allocatable, intent(inout) :: problem
      integer :: i

      token%quote = here()
      token%first = position + 1
      i = position
      do
        i = i + scan(text(i + 1:), token%quote//newline//nul)
        if (text(i:i) /= token%quote .or. text(i + 1:i + 1) /= token%quote) exit
        i = i + 1
      end do
      position = i
      token%last = i - 1
      if (text(i:i) /= token%quote) then
        if (text(i - 1:i - 1) == return) i = i - 1
        problem = 'unclosed quote '//token%quote//excerpt(text(token%first:i - 1))//': close it with '//token%quote// &
                  ' in the same line'
        return
      end if
      position = i + 1
      if (scan(here(), blanks//newline//',/!&'//nul) == 1) return
      problem = "'"//excerpt(rest_of_line())//"' directly after a closing quote: separate values by ',', and double a quote "// &
                'inside a string'
      position = position + 1
      call skip_until(blanks//newline//',/!&')
    end subroutine read_string

    !> A word without quotes.
    subroutine read_bare(token, problem)
      type(token_t), intent(inout) :: token
      character(:), allocatable, intent(inout) :: problem

      token%first = position
      call skip_until(word_ends)
      token%last = position - 1
      if (scan(here(), '=(%''"') == 0 .and. (here() /= '!' .or. .not. present(key))) return
      problem = "unexpected '"//excerpt(rest_of_line())//"' in a value: separate values by ',', put text in quotes"
      ! At least one character further, and past a bracket or quote that would only be found again.
      position = position + 1
      call skip_until(blanks//newline//',/&')
    end subroutine read_bare

    !> A unit after the number that was read, in its line: otherwise the '/' of mm/s would end the group.
    subroutine take_unit(token, problem)
      type(token_t), intent(inout) :: token
      character(:), allocatable, intent(inout) :: problem
      integer :: first, last, next

      ! There is no blank between them.
      last = end_of_run(token%first)
      do first = token%first, last
        if (scan(text(first:first), digits//'+-.') == 1 .or. .not. is_unit(text(first:last))) cycle
        token%last = first - 1
        exit
      end do
      if (first > last) then
        if (problem /= '') return
        first = position + verify(text(position:), ' '//tab) - 1
        last = end_of_run(first)
        if (first == position .or. .not. is_unit(text(first:last))) return
        ! It may be a key of the same name.
        next = last + verify(text(last + 1:), ' '//tab)
        if (text(next:next) == '=') return
      end if
      token%unit = text(first:last)
      position = last + 1
      problem = ''
    end subroutine take_unit

    !> The last place before a blank, a comma or a comment.
    integer function end_of_run(place)
      integer, intent(in) :: place

      end_of_run = place - 2 + scan(text(place:), blanks//newline//',!'//nul)
    end function end_of_run

    !> Whether a name and `=`, or a name and a subscript, begin here.
    logical function next_key_follows()
      integer :: before(2)

      next_key_follows = .false.
      if (.not. begins_name(here())) return
      before = [position, line]
      call skip_until(word_ends)
      next_key_follows = here() == '(' .or. here() == '%'
      call skip_blank()
      next_key_follows = next_key_follows .or. here() == '='
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

  !> A deck is UTF-8 without control characters; `plain` is false if it has bytes that no text file has.
  subroutine check_bytes(text, faults, plain)
    character(*), intent(in) :: text
    type(faults_t), intent(inout) :: faults
    logical, intent(out) :: plain
    integer :: i, line, bad_line, width

    plain = .true.
    bad_line = 0
    line = 1
    i = 1
    do while (i <= len(text))
      if (.not. is_plain(text, i)) then
        call faults%add(place_t(line), trim(merge('NUL bytes         ', 'control characters', text(i:i) == nul))// &
                        ' in the deck: a deck is plain UTF-8 text, not a binary file')
        plain = .false.
        return
      end if
      width = utf8_width(text(i:min(i + 3, len(text))))
      if (bad_line == 0 .and. width == 0) bad_line = line
      if (text(i:i) == newline) line = line + 1
      i = i + max(1, width)
    end do
    if (bad_line > 0) call faults%add(place_t(bad_line), 'a character is not UTF-8: save the deck as UTF-8 text')
  end subroutine check_bytes

  !> Whether `text` is UTF-8 without control characters.
  logical function is_plain_text(text)
    character(*), intent(in) :: text
    type(faults_t) :: faults

    call check_bytes(text, faults, is_plain_text)
    is_plain_text = faults%count == 0
  end function is_plain_text

  !> Whether byte `i` may be in a text: it is no control character except tab and line ends.
  pure logical function is_plain(text, i)
    character(*), intent(in) :: text
    integer, intent(in) :: i

    is_plain = iachar(text(i:i)) >= 32 .and. iachar(text(i:i)) /= 127 .or. scan(text(i:i), tab//newline) == 1
    if (text(i:i) == return) is_plain = index(text(i:min(i + 1, len(text)))//newline, return//newline) == 1
  end function is_plain

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
