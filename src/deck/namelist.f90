!> Scanner of Fortran namelist text: finds the groups, the keys and the words of their values, with their lines.
!>
!> Fortran's own namelist read silently accepts half of all mistakes and reports the wrong place for the others. The scanner only
!> uses the grammar; dst_deck interprets the groups and keys. It reads the text once, from left to right, and keeps positions, not
!> copies.
module dst_namelist
  use dst_text, only: excerpt, lower_case, utf8_width
  use dst_faults, only: faults_t
  use dst_units, only: is_unit
  implicit none
  private

  public :: namelist_t, group_entry_t, assignment_t, token_t, name_length
  public :: scan_namelist, scan_values, token_text, last_line, is_plain_text

  !> A longer name is cut; no valid name is as long.
  integer, parameter :: name_length = 64

  !> One `&group … /` of a deck.
  type :: group_entry_t
    character(name_length) :: name = ''
    integer :: line = 0
  end type group_entry_t

  !> One word of a value.
  type :: token_t
    integer :: line = 0
    integer :: first = 1, last = 0     !! its place in the text, without the outer quotes
    integer :: repeat = 1              !! of a repeat count n*
    character :: quote = ' '           !! the quote around it
    character(8) :: unit = ''          !! a unit after a number, where none belongs
  end type token_t

  !> One `key = value` of a deck.
  type :: assignment_t
    integer :: group = 0               !! in `groups`
    character(name_length) :: key = ''
    integer :: line = 0
    integer :: first = 1, last = 0     !! in `tokens`
    logical :: faulty = .false.        !! a fault of it has been noted
    logical :: bare = .false.          !! without =, so perhaps no key at all
  end type assignment_t

  !> A deck taken apart into groups and assignments, with their places.
  type :: namelist_t
    character(:), allocatable :: text
    type(group_entry_t), allocatable :: groups(:)
    type(assignment_t), allocatable :: assignments(:)
    type(token_t), allocatable :: tokens(:)
    integer :: group_count = 0, assignment_count = 0, token_count = 0
    integer :: position = 1, line = 1
    logical :: comments = .true.       !! whether ! begins a comment
    logical :: plain = .true.          !! false if the text has bytes that no text file has
    type(faults_t) :: faults
  end type namelist_t

  character, parameter :: tab = achar(9), newline = achar(10), return = achar(13)
  character(*), parameter :: blanks = ' '//tab//return
  character(*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_'
  character(*), parameter :: digits = '0123456789'
  character(*), parameter :: word_ends = blanks//newline//',/=!&''"(%'
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

  !> Scan `text`; every fault is added to `list%faults`, and everything that could be read is kept in `list`.
  subroutine scan_namelist(text, list)
    character(*), intent(in) :: text
    type(namelist_t), intent(out) :: list

    call begin(text, list)
    call check_bytes(text, list%faults, list%plain)
    if (.not. list%plain) return
    if (index(text, byte_order_mark) == 1) list%position = 4
    do while (.not. list%faults%full())
      call skip_blank(list)
      if (at_end(list)) exit
      if (here(list) == '&') then
        call scan_group(list)
      else
        call skip_stray(list)
      end if
    end do
  end subroutine scan_namelist

  !> Scan `text` as the values of one key, as they are written after `=`; all words are in list%tokens.
  subroutine scan_values(text, key, list, problem)
    character(*), intent(in) :: text
    character(*), intent(in) :: key         !! for messages
    type(namelist_t), intent(out) :: list
    character(:), allocatable, intent(out) :: problem     !! '' or the first fault

    call begin(text, list)
    list%comments = .false.
    call begin_assignment(list, key, 1)
    call read_values(list)
    if (list%faults%count == 0 .and. .not. at_end(list)) &
      call list%faults%add(1, "unexpected '"//excerpt(text(list%position:))//"': give only the value")
    problem = ''
    if (list%faults%count > 0) problem = trim(list%faults%item(1)%text)
  end subroutine scan_values

  !> Reset the list: nothing of `text` has been read. There is room for all of it: a word, or a key with its =, takes two
  !> characters.
  subroutine begin(text, list)
    character(*), intent(in) :: text
    type(namelist_t), intent(inout) :: list
    integer :: i

    list%text = text
    allocate (list%groups(count([(text(i:i) == '&', i=1, len(text))])))
    allocate (list%assignments(len(text)/2 + 2), list%tokens(len(text)/2 + 2))
  end subroutine begin

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
        call faults%add(line, trim(merge('NUL bytes         ', 'control characters', iachar(text(i:i)) == 0))// &
                        ' in the deck: a deck is plain UTF-8 text, not a binary file')
        plain = .false.
        return
      end if
      width = utf8_width(text(i:min(i + 3, len(text))))
      if (bad_line == 0 .and. width == 0) bad_line = line
      if (text(i:i) == newline) line = line + 1
      i = i + max(1, width)
    end do
    if (bad_line > 0) call faults%add(bad_line, 'a character is not UTF-8: save the deck as UTF-8 text')
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

    select case (iachar(text(i:i)))
    case (13)
      is_plain = i == len(text)
      if (.not. is_plain) is_plain = text(i + 1:i + 1) == newline
    case (9, 10)
      is_plain = .true.
    case default
      is_plain = iachar(text(i:i)) >= 32 .and. iachar(text(i:i)) /= 127
    end select
  end function is_plain

  !> Everything from `&` to the end of the group.
  subroutine scan_group(list)
    type(namelist_t), intent(inout) :: list
    type(group_entry_t) :: group

    list%position = list%position + 1
    group%line = list%line
    group%name = next_word(list)
    if (group%name == '') then
      call list%faults%add(list%line, "'&' without a group name: write the name right after it, as in &scene")
      call skip_blank(list)
      group%name = next_word(list)
    end if
    if (lower_case(group%name) == 'end') then
      call list%faults%add(list%line, "'&end' without a group to end: remove it")
      return
    end if
    list%group_count = list%group_count + 1
    list%groups(list%group_count) = group
    call scan_assignments(list)
  end subroutine scan_group

  subroutine scan_assignments(list)
    type(namelist_t), intent(inout) :: list
    logical :: ended

    do while (.not. list%faults%full())
      call skip_blank(list)
      call end_of_group(list, ended)
      if (ended) return
      call scan_key(list)
      call read_values(list)
    end do
  end subroutine scan_assignments

  !> Whether the group ends here: `/`, `&end`, or a fault: the next group, the end of the text.
  subroutine end_of_group(list, ended)
    type(namelist_t), intent(inout) :: list
    logical, intent(out) :: ended
    integer :: before

    ended = .true.
    associate (group => list%groups(list%group_count))
      if (at_end(list)) then
        call list%faults%add(last_line(list%text), "missing '/': end the group &"//excerpt(trim(group%name))//" with a '/'")
      else if (here(list) == '/') then
        list%position = list%position + 1
      else if (here(list) == '&') then
        before = list%position
        list%position = before + 1
        if (lower_case(next_word(list)) == 'end') return
        list%position = before
        call list%faults%add(list%line, "missing '/': end the group &"//excerpt(trim(group%name))// &
                             " with a '/' before this line's '&'")
      else
        ended = .false.
      end if
    end associate
  end subroutine end_of_group

  !> The key and its `=`.
  subroutine scan_key(list)
    type(namelist_t), intent(inout) :: list
    character(:), allocatable :: key

    if (.not. begins_name(here(list))) then
      call list%faults%add(list%line, "'"//excerpt(rest_of_line(list))//"' where a key should be: write KEY = VALUE")
      call begin_assignment(list, '', list%line)
      list%assignments(list%assignment_count)%faulty = .true.
      return
    end if
    key = next_word(list)
    call begin_assignment(list, key, list%line)
    associate (assignment => list%assignments(list%assignment_count))
      if (here(list) == '(' .or. here(list) == '%') then
        call list%faults%add(list%line, "'"//excerpt(key//rest_of_line(list))// &
                             "' sets a part of a key: give all values at once, as in "//excerpt(key)//' = VALUE, VALUE')
        assignment%faulty = .true.
        ! Move past the subscript, within its line.
        list%position = list%position + span_until(list, newline//'=!/&')
      end if
      call skip_blank(list)
      if (here(list) == '=') then
        list%position = list%position + 1
        return
      end if
      if (.not. assignment%faulty) &
        call list%faults%add(assignment%line, "'"//excerpt(key)//"' without '=': write KEY = VALUE")
      assignment%faulty = .true.
      assignment%bare = .true.
    end associate
  end subroutine scan_key

  subroutine begin_assignment(list, key, line)
    type(namelist_t), intent(inout) :: list
    character(*), intent(in) :: key
    integer, intent(in) :: line

    list%assignment_count = list%assignment_count + 1
    list%assignments(list%assignment_count) = assignment_t(group=list%group_count, key=key, line=line, &
                                                           first=list%token_count + 1)
  end subroutine begin_assignment

  !> The values of the last assignment, up to the next key or the end of the group.
  subroutine read_values(list)
    type(namelist_t), intent(inout) :: list
    logical :: after_value, faulty

    after_value = .false.
    associate (assignment => list%assignments(list%assignment_count))
      do
        call skip_blank(list)
        if (at_end(list) .or. here(list) == '/' .or. here(list) == '&') exit
        if (here(list) == ',') then
          if (.not. (after_value .or. assignment%faulty)) then
            call list%faults%add(list%line, "nothing before a ',' in '"//excerpt(trim(assignment%key))// &
                                 "': an empty value is not allowed, give it or remove the ','")
            assignment%faulty = .true.
          end if
          after_value = .false.
          list%position = list%position + 1
        else if (next_key_follows(list)) then
          exit
        else
          call read_token(list, assignment%faulty, faulty)
          assignment%faulty = assignment%faulty .or. faulty
          after_value = .true.
        end if
      end do
      assignment%last = list%token_count
      if (assignment%last < assignment%first .and. .not. assignment%faulty) then
        call list%faults%add(assignment%line, "'"//excerpt(trim(assignment%key))// &
                             "' has an empty value: give a value or remove the key")
        assignment%faulty = .true.
      end if
    end associate
  end subroutine read_values

  !> One word with its repeat count; a fault is noted unless `silent`.
  subroutine read_token(list, silent, faulty)
    type(namelist_t), intent(inout) :: list
    logical, intent(in) :: silent
    logical, intent(out) :: faulty
    type(token_t) :: token
    character(:), allocatable :: problem

    problem = ''
    token%line = list%line
    call read_repeat(list, token%repeat, problem)
    if (len(problem) > 0) then
      continue
    else if (here(list) == '''' .or. here(list) == '"') then
      call read_string(list, token, problem)
    else
      call read_bare(list, token, problem)
      if (scan(list%text(token%first:token%first), digits//'+-.') == 1) call take_unit(list, token, problem)
    end if
    faulty = len(problem) > 0
    if (faulty) then
      if (.not. silent) call list%faults%add(token%line, problem)
    else
      list%token_count = list%token_count + 1
      list%tokens(list%token_count) = token
    end if
  end subroutine read_token

  !> `n*` before a value.
  subroutine read_repeat(list, times, problem)
    type(namelist_t), intent(inout) :: list
    integer, intent(out) :: times
    character(:), allocatable, intent(inout) :: problem
    character(:), allocatable :: count_text
    integer :: width
    ! More than any list may have, and no overflow.
    integer, parameter :: longest = 9

    times = 1
    width = span(list, digits)
    if (width == 0 .or. list%position + width > len(list%text)) return
    if (list%text(list%position + width:list%position + width) /= '*') return
    count_text = list%text(list%position:list%position + width - 1)
    if (width > longest) then
      times = huge(1)
    else
      read (count_text, *) times
    end if
    list%position = list%position + width + 1
    if (times < 1) then
      problem = "repeat count '"//count_text//"*' is not positive: give 1 or more"
    else if (at_end(list) .or. (scan(here(list), word_ends) == 1 .and. scan(here(list), '''"') == 0)) then
      problem = "'"//excerpt(count_text)//"*' repeats an empty value: give the value after the '*'"
    end if
    if (len(problem) > 0) list%position = list%position + span_until(list, word_ends)
  end subroutine read_repeat

  !> A string; it ends in its own line.
  subroutine read_string(list, token, problem)
    type(namelist_t), intent(inout) :: list
    type(token_t), intent(inout) :: token
    character(:), allocatable, intent(inout) :: problem
    integer :: i
    logical :: is_closed

    token%quote = here(list)
    token%first = list%position + 1
    i = token%first
    do
      if (i > len(list%text)) exit
      if (list%text(i:i) == newline) exit
      if (list%text(i:i) == token%quote) then
        if (i == len(list%text)) exit
        if (list%text(i + 1:i + 1) /= token%quote) exit
        i = i + 1
      end if
      i = i + 1
    end do
    token%last = i - 1
    is_closed = i <= len(list%text)
    if (is_closed) is_closed = list%text(i:i) /= newline
    list%position = i + merge(1, 0, is_closed)
    if (.not. is_closed) then
      if (list%text(i - 1:i - 1) == return) i = i - 1
      problem = 'unclosed quote '//token%quote//excerpt(list%text(token%first:i - 1))// &
                ': close it with '//token%quote//' in the same line'
    else if (.not. at_end(list)) then
      if (scan(here(list), blanks//newline//',/!&') == 0) then
        problem = "'"//excerpt(rest_of_line(list))//"' directly after a closing quote: "// &
                  "separate values by ',', and double a quote inside a string"
        list%position = list%position + max(1, span_until(list, blanks//newline//',/!&'))
      end if
    end if
  end subroutine read_string

  !> A word without quotes.
  subroutine read_bare(list, token, problem)
    type(namelist_t), intent(inout) :: list
    type(token_t), intent(inout) :: token
    character(:), allocatable, intent(inout) :: problem

    token%first = list%position
    list%position = list%position + span_until(list, word_ends)
    token%last = list%position - 1
    if (at_end(list)) return
    if (scan(here(list), '=(%''"') == 0 .and. (list%comments .or. here(list) /= '!')) return
    problem = "unexpected '"//excerpt(rest_of_line(list))//"' in a value: separate values by ',', put text in quotes"
    ! At least one character further, and past a bracket or quote that would only be found again.
    list%position = list%position + 1
    list%position = list%position + span_until(list, blanks//newline//',/&')
  end subroutine read_bare

  !> A unit after the number that was read, in its line: otherwise the '/' of mm/s would end the group.
  subroutine take_unit(list, token, problem)
    type(namelist_t), intent(inout) :: list
    type(token_t), intent(inout) :: token
    character(:), allocatable, intent(inout) :: problem
    integer :: first, last, number

    ! There is no blank between them.
    last = end_of_run(token%first)
    do number = token%first, last
      if (scan(list%text(number:number), digits//'+-.') == 1) cycle
      if (is_unit(list%text(number:last))) then
        call accept(number)
        return
      end if
    end do
    if (len(problem) > 0) return
    first = list%position + span(list, ' '//tab)
    if (first == list%position .or. first > len(list%text)) return
    last = end_of_run(first)
    if (.not. is_unit(list%text(first:last))) return
    ! It may be a key of the same name.
    number = verify(list%text(last + 1:), ' '//tab)
    if (number > 0) then
      if (list%text(last + number:last + number) == '=') return
    end if
    number = token%last
    call accept(first)
    token%last = number

  contains

    !> The last place before a blank, a comma or a comment.
    integer function end_of_run(place)
      integer, intent(in) :: place

      end_of_run = scan(list%text(place:), blanks//newline//',!')
      end_of_run = merge(len(list%text), place + end_of_run - 2, end_of_run == 0)
    end function end_of_run

    subroutine accept(place)
      integer, intent(in) :: place   !! where the unit begins

      token%unit = list%text(place:last)
      token%last = place - 1
      list%position = last + 1
      problem = ''
    end subroutine accept
  end subroutine take_unit

  !> Whether a name and `=`, or a name and a subscript, begin here.
  logical function next_key_follows(list)
    type(namelist_t), intent(inout) :: list
    integer :: position, line
    character(:), allocatable :: name

    next_key_follows = .false.
    if (.not. begins_name(here(list))) return
    position = list%position
    line = list%line
    name = next_word(list)
    next_key_follows = here(list) == '(' .or. here(list) == '%'
    call skip_blank(list)
    next_key_follows = next_key_follows .or. here(list) == '='
    list%position = position
    list%line = line
  end function next_key_follows

  !> Text between groups: one fault for all of it.
  subroutine skip_stray(list)
    type(namelist_t), intent(inout) :: list

    call list%faults%add(list%line, "'"//excerpt(rest_of_line(list))// &
                         "' outside a group: put it between &GROUP and '/', or after a '!'")
    do while (.not. (at_end(list) .or. here(list) == '&'))
      list%position = list%position + span_until(list, blanks//newline//'&!')
      call skip_blank(list)
    end do
  end subroutine skip_stray

  !> Move past blanks, line ends and comments.
  subroutine skip_blank(list)
    type(namelist_t), intent(inout) :: list

    do while (.not. at_end(list))
      if (here(list) == newline) then
        list%line = list%line + 1
      else if (here(list) == '!' .and. list%comments) then
        list%position = list%position + span_until(list, newline) - 1
      else if (scan(here(list), blanks) == 0) then
        return
      end if
      list%position = list%position + 1
    end do
  end subroutine skip_blank

  !> The word from here to the next separator; '' if there is none.
  function next_word(list) result(word)
    type(namelist_t), intent(inout) :: list
    character(:), allocatable :: word
    integer :: width

    width = span_until(list, word_ends)
    word = list%text(list%position:list%position + width - 1)
    list%position = list%position + width
  end function next_word

  !> A letter, or a byte of a letter that is not ASCII.
  pure logical function begins_name(letter)
    character, intent(in) :: letter

    begins_name = scan(letter, letters) == 1 .or. iachar(letter) >= 128
  end function begins_name

  pure function rest_of_line(list) result(rest)
    type(namelist_t), intent(in) :: list
    character(:), allocatable :: rest
    ! Only as much as messages show, so that many faults in one long line cost no more than the line.
    integer, parameter :: enough = 80
    integer :: last, width

    last = min(len(list%text), list%position + enough)
    width = scan(list%text(list%position:last), newline//return)
    if (width > 0) last = list%position + width - 2
    rest = trim(list%text(list%position:last))
  end function rest_of_line

  !> Number of characters from here that are in `set`.
  pure integer function span(list, set)
    type(namelist_t), intent(in) :: list
    character(*), intent(in) :: set

    span = 0
    if (at_end(list)) return
    span = verify(list%text(list%position:), set) - 1
    if (span < 0) span = len(list%text) - list%position + 1
  end function span

  !> Number of characters from here up to the first one in `set`.
  pure integer function span_until(list, set)
    type(namelist_t), intent(in) :: list
    character(*), intent(in) :: set

    span_until = 0
    if (at_end(list)) return
    span_until = scan(list%text(list%position:), set) - 1
    if (span_until < 0) span_until = len(list%text) - list%position + 1
  end function span_until

  pure logical function at_end(list)
    type(namelist_t), intent(in) :: list

    at_end = list%position > len(list%text)
  end function at_end

  !> The character here; at the end one that no text has.
  pure character function here(list)
    type(namelist_t), intent(in) :: list

    here = achar(0)
    if (.not. at_end(list)) here = list%text(list%position:list%position)
  end function here

  !> Number of the last line that has text.
  pure integer function last_line(text)
    character(*), intent(in) :: text
    integer :: i

    last_line = 1
    do i = 1, len_trim(text) - 1
      if (text(i:i) == newline) last_line = last_line + 1
    end do
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
