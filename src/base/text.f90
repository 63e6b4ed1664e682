!> Text operations that decks and the command line need: words, numbers, the nearest valid name.
module dst_text
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_kinds, only: wp, real64, int64
  implicit none
  private

  public :: text_builder_t, name_width, unit_width, value_width, meaning_width
  public :: lower_case, with_blanks, word, word_count, word_number, has_word, nearest_word, alternatives, excerpt, &
    printable, one_per_line, decode
  public :: short_length, real_text, short_text, integer_text, quoted_text, read_real, read_integer

  !> Widths of the texts in tables of keys, columns, commands and so on. The compiler refuses a text that would be cut.
  integer, parameter :: name_width = 24, unit_width = 8, value_width = 32, meaning_width = 96

  !> Text that grows; the time to append is proportional to the length of what is appended.
  type :: text_builder_t
    private
    character(:), allocatable :: buffer
    integer :: length = 0
  contains
    procedure :: append
    procedure :: line
    procedure :: row
    procedure :: content
  end type text_builder_t

  !> The digits of an integer.
  interface integer_text
    module procedure text_of_long, text_of_integer
  end interface integer_text

  character(*), parameter :: newline = achar(10)
  character(*), parameter :: digits = '0123456789'
  !> No name of a deck or a command is longer; a longer word is not near to any name.
  integer, parameter :: longest_name = 40
  !> No number needs more characters than this.
  integer, parameter :: longest_number = 256

  !> Characters of `short_text`: room for ten digits of any number, in quadruple precision, too.
  integer, parameter :: short_length = 24

contains

  subroutine append(self, text)
    class(text_builder_t), intent(inout) :: self
    character(*), intent(in) :: text
    character(:), allocatable :: larger

    if (.not. allocated(self%buffer)) allocate (character(1024) :: self%buffer)
    if (self%length + len(text) > len(self%buffer)) then
      allocate (character(2*(self%length + len(text))) :: larger)
      larger(:self%length) = self%buffer(:self%length)
      call move_alloc(larger, self%buffer)
    end if
    self%buffer(self%length + 1:self%length + len(text)) = text
    self%length = self%length + len(text)
  end subroutine append

  !> Append `text` without its trailing blanks, and end the line.
  subroutine line(self, text)
    class(text_builder_t), intent(inout) :: self
    character(*), intent(in) :: text

    call self%append(trim(text)//newline)
  end subroutine line

  !> A line of a table: a name, and from a fixed column on its value.
  subroutine row(self, name, value)
    class(text_builder_t), intent(inout) :: self
    character(*), intent(in) :: name, value
    character(34) :: column

    column = name
    call self%line(column//value)
  end subroutine row

  function content(self) result(text)
    class(text_builder_t), intent(in) :: self
    character(:), allocatable :: text

    text = ''
    if (self%length > 0) text = self%buffer(:self%length)
  end function content

  !> A list with blanks in place of its separators.
  pure function with_blanks(list, separator) result(words)
    character(*), intent(in) :: list
    character(1), intent(in) :: separator
    character(len(list)) :: words
    integer :: i

    words = list
    do i = 1, len(list)
      if (words(i:i) == separator) words(i:i) = ' '
    end do
  end function with_blanks

  !> ASCII letters in lower case.
  pure function lower_case(text) result(lower)
    character(*), intent(in) :: text
    character(len(text)) :: lower
    integer :: i

    do i = 1, len(text)
      lower(i:i) = text(i:i)
      if (text(i:i) >= 'A' .and. text(i:i) <= 'Z') lower(i:i) = achar(iachar(text(i:i)) + 32)
    end do
  end function lower_case

  !> Word `n` of a list separated by blanks; '' if there are fewer.
  pure function word(list, n) result(text)
    character(*), intent(in) :: list
    integer, intent(in) :: n
    character(:), allocatable :: text
    integer :: first, last, i

    first = 1
    last = 0
    do i = 1, n
      call find_word(list, first, last)
    end do
    text = list(first:last)
  end function word

  !> The next word after position `last`; an empty word at the end of the list if there is none.
  pure subroutine find_word(list, first, last)
    character(*), intent(in) :: list
    integer, intent(out) :: first
    integer, intent(inout) :: last

    first = last + max(1, verify(list(last + 1:), ' '))
    last = first + scan(list(first:), ' ') - 2
    if (last < first) last = len_trim(list)
  end subroutine find_word

  !> Number of words of a list separated by blanks.
  pure integer function word_count(list)
    character(*), intent(in) :: list
    integer :: first, last

    word_count = 0
    last = 0
    do
      call find_word(list, first, last)
      if (last < first) return
      word_count = word_count + 1
    end do
  end function word_count

  !> The number of a word in a list separated by blanks; 0 if it is not there.
  pure integer function word_number(list, text) result(n)
    character(*), intent(in) :: list, text
    integer :: first, last

    ! Does not copy the list: the conditions of a deck are evaluated some hundred times.
    last = 0
    do n = 1, len(list)
      call find_word(list, first, last)
      if (last < first) exit
      if (last - first + 1 == len(text) .and. list(first:last) == text) return
    end do
    n = 0
  end function word_number

  !> Whether `text` is one of the words of a list separated by blanks.
  pure logical function has_word(list, text)
    character(*), intent(in) :: list, text

    has_word = word_number(list, text) > 0 .or. (list == '' .and. len(text) == 0)
  end function has_word

  !> The words of a list in the form in which a choice is shown: 'a | b | c'.
  pure function alternatives(list) result(text)
    character(*), intent(in) :: list
    character(:), allocatable :: text
    integer :: i

    text = word(list, 1)
    do i = 2, word_count(list)
      text = text//' | '//word(list, i)
    end do
  end function alternatives

  !> The word of `list` that is nearest to `text` by edit distance; '' when none is near.
  pure function nearest_word(text, list) result(nearest)
    character(*), intent(in) :: text, list
    character(:), allocatable :: nearest
    integer :: i, best, distance

    nearest = ''
    if (len(text) == 0 .or. len(text) > longest_name) return
    best = max(1, len(text)/3) + 1
    do i = 1, word_count(list)
      distance = edit_distance(lower_case(text), lower_case(word(list, i)))
      if (distance >= best) cycle
      best = distance
      nearest = word(list, i)
    end do
  end function nearest_word

  !> Number of insertions, deletions, replacements and swaps of neighbours that turn a into b.
  pure integer function edit_distance(a, b)
    character(*), intent(in) :: a, b
    integer :: d(-1:len(a), -1:len(b)), i, j, replace

    d(0:, 0) = [(i, i=0, len(a))]
    d(0, 0:) = [(j, j=0, len(b))]
    do j = 1, len(b)
      do i = 1, len(a)
        replace = merge(0, 1, a(i:i) == b(j:j))
        d(i, j) = min(d(i - 1, j) + 1, d(i, j - 1) + 1, d(i - 1, j - 1) + replace)
        if (i == 1 .or. j == 1) cycle
        if (a(i:i) == b(j - 1:j - 1) .and. a(i - 1:i - 1) == b(j:j)) d(i, j) = min(d(i, j), d(i - 2, j - 2) + 1)
      end do
    end do
    edit_distance = d(len(a), len(b))
  end function edit_distance

  !> `text` in the form that messages use: at most 60 bytes, cut between UTF-8 characters; control characters and bytes that are not
  !> UTF-8 become '?'.
  pure function excerpt(text) result(shown)
    character(*), intent(in) :: text
    character(:), allocatable :: shown
    integer, parameter :: longest = 60
    integer :: last

    last = len(text)
    if (last > longest) then
      last = longest - 3
      do while (last > 1 .and. iand(iachar(text(last + 1:last + 1)), 192) == 128)
        last = last - 1
      end do
    end if
    shown = printable(text(:last))
    if (last < len(text)) shown = shown//'...'
  end function excerpt

  !> `text` in a form that is safe on a terminal: control characters, and bytes that are not UTF-8, become '?'. Of fixed length, for
  !> the same reason as `short_text`.
  pure function printable(text) result(shown)
    character(*), intent(in) :: text
    character(len(text)) :: shown
    integer :: i, width, code

    shown = text
    i = 1
    do while (i <= len(shown))
      call decode(shown(i:min(i + 3, len(shown))), width, code)
      if (.not. is_harmless(code)) width = 0
      if (width == 0) shown(i:i) = '?'
      i = i + max(1, width)
    end do
  end function printable

  !> The UTF-8 character with which `text` begins (RFC 3629): the number of its bytes, 0 if it does not begin with one, and its
  !> code.
  pure subroutine decode(text, width, code)
    character(*), intent(in) :: text
    integer, intent(out) :: width, code
    !> The least code with so many bytes: none may be longer than necessary. The largest of all, and the surrogates, which are none.
    integer, parameter :: least(4) = [0, 128, 2048, 65536], largest = 1114111, surrogates(2) = [55296, 57343]
    integer, parameter :: first_byte(5) = [0, 192, 224, 240, 248]
    integer :: i, byte

    byte = iachar(text(1:1))
    width = count(byte >= first_byte)
    code = byte - first_byte(width)
    if (width > len(text) .or. width > size(least) .or. (width == 1 .and. byte >= 128)) width = 0
    do i = 2, width
      byte = iachar(text(i:i))
      if (byte < 128 .or. byte >= 192) width = 0
      if (width == 0) return
      code = 64*code + byte - 128
    end do
    if (width == 0) return
    if (code < least(width) .or. code > largest .or. (code >= surrogates(1) .and. code <= surrogates(2))) width = 0
  end subroutine decode

  !> Whether a character, by its code, neither controls a terminal, nor breaks a line, nor changes the direction of writing.
  pure logical function is_harmless(code)
    integer, intent(in) :: code
    !> U+0000 to U+001F, U+007F to U+009F, U+2028 to U+202E, U+2066 to U+2069.
    integer, parameter :: first(4) = [0, 127, 8232, 8294], last(4) = [31, 159, 8238, 8297]

    is_harmless = .not. any(code >= first .and. code <= last)
  end function is_harmless

  !> Every line of `text` after `prefix`, in a form that is safe on a terminal.
  pure function one_per_line(text, prefix) result(lines)
    character(*), intent(in) :: text, prefix
    character(:), allocatable :: lines
    integer :: first, width

    lines = ''
    first = 1
    do while (first <= len(text))
      width = index(text(first:)//newline, newline)
      lines = lines//prefix//printable(text(first:min(first + width - 2, len(text))))//newline
      first = first + width
    end do
  end function one_per_line

  !> The shortest decimal text that is read back as the same bits.
  function real_text(value) result(text)
    real(wp), intent(in) :: value
    character(:), allocatable :: text
    character(48) :: buffer, form
    character(:), allocatable :: mantissa
    integer :: figures, exponent, ios
    real(wp) :: again
    ! At most 17 digits are needed in double precision and 36 in quadruple precision. A number that is read from fewer than the
    ! precision has these digits and zeros at the precision, too, unless it is so small that it has lost digits.
    integer, parameter :: enough = precision(1.0_wp), most_figures = enough + 3

    do figures = merge(1, enough, abs(value) < tiny(value)), most_figures
      ! The two digits of the number of decimals are at fixed places, because writing and reading a format takes as long as the
      ! number itself.
      form = '(es48.'//achar(iachar('0') + (figures - 1)/10)//achar(iachar('0') + mod(figures - 1, 10))//'e4)'
      write (buffer, form) abs(value)
      read (buffer, *, iostat=ios) again
      if (ios == 0 .and. again <= abs(value) .and. again >= abs(value)) exit
    end do
    buffer = adjustl(buffer)
    mantissa = buffer(1:1)//buffer(3:index(buffer, 'E') - 1)
    mantissa = mantissa(:max(1, verify(mantissa, '0', back=.true.)))
    read (buffer(index(buffer, 'E') + 1:), '(i5)') exponent
    text = decimal_text(mantissa, exponent)
    if (sign(1.0_wp, value) < 0.0_wp) text = '-'//text
  end function real_text

  !> A number for people: '0', '12.3', '0.00123', '123456', '1.23e7': up to `figures` (5) significant digits; whole numbers up to a
  !> million with all digits. Not of deferred length as `real_text` is: gfortran keeps such a length in static storage, which
  !> threads would share.
  pure function short_text(value, figures) result(text)
    real(wp), intent(in) :: value
    integer, intent(in), optional :: figures
    character(short_length) :: text, buffer, form
    integer :: exponent, decimals

    decimals = 4
    if (present(figures)) decimals = figures - 1
    if (.not. abs(value) <= huge(value)) then
      text = merge('NaN     ', 'infinite', ieee_is_nan(value))
      return
    else if (.not. abs(value) > 0.0_wp) then
      text = '0'
      return
    end if
    write (form, '(a, i0, a)') '(es24.', decimals, 'e4)'
    write (buffer, form) value
    read (buffer(index(buffer, 'E') + 1:), *) exponent
    if (exponent < -3 .or. exponent > 5) then
      write (text, '(a, a, i0)') trim(without_zeros(buffer(:index(buffer, 'E') - 1))), 'e', exponent
    else
      write (form, '(a, i0, a)') '(f24.', max(0, decimals - exponent), ')'
      write (text, form) value
      if (exponent < decimals) text = without_zeros(text)
    end if
    text = adjustl(text)
    if (text(len_trim(text):) == '.') text = text(:len_trim(text) - 1)
    if (text(1:1) == '.') text = '0'//text(:len(text) - 1)
    if (text(1:2) == '-.') text = '-0'//text(2:len(text) - 1)
  end function short_text

  !> A decimal fraction without blanks and without the zeros at its end, of fixed length as `short_text` is.
  pure function without_zeros(decimal) result(text)
    character(*), intent(in) :: decimal
    character(short_length) :: text

    text = adjustl(decimal)
    text = text(:verify(text, ' 0', back=.true.))
    if (text(len_trim(text):) == '.') text = text(:len_trim(text) - 1)
  end function without_zeros

  !> The number d.ddd·10^exponent from its significant digits, without an exponent if it is easy to read without one.
  pure function decimal_text(mantissa, exponent) result(text)
    character(*), intent(in) :: mantissa
    integer, intent(in) :: exponent
    character(:), allocatable :: text
    integer :: whole

    if (exponent >= 0 .and. exponent <= 4) then
      whole = exponent + 1
      text = mantissa//repeat('0', max(0, whole + 1 - len(mantissa)))
      text = text(:whole)//'.'//text(whole + 1:)
    else if (exponent < 0 .and. exponent >= -2) then
      text = '0.'//repeat('0', -exponent - 1)//mantissa
    else
      text = mantissa(1:1)//'.'//mantissa(2:)
      if (len(mantissa) == 1) text = text//'0'
      text = text//'e'//integer_text(exponent)
    end if
  end function decimal_text

  !> An integer, in as few characters as possible.
  pure function text_of_long(value) result(text)
    integer(int64), intent(in) :: value
    character(:), allocatable :: text
    character(24) :: buffer

    write (buffer, '(i0)') value
    text = trim(buffer)
  end function text_of_long

  pure function text_of_integer(value) result(text)
    integer, intent(in) :: value
    character(:), allocatable :: text

    text = text_of_long(int(value, int64))
  end function text_of_integer

  !> Text in the form that a deck uses: in single quotes, with quotes inside doubled.
  pure function quoted_text(text) result(quoted)
    character(*), intent(in) :: text
    character(:), allocatable :: quoted
    integer :: i

    quoted = "'"
    do i = 1, len(text)
      quoted = quoted//text(i:i)
      if (text(i:i) == "'") quoted = quoted//"'"
    end do
    quoted = quoted//"'"
  end function quoted_text

  !> A real number in Fortran's notation. `problem` is '' or says what is wrong with the word.
  pure subroutine read_real(text, value, problem)
    character(*), intent(in) :: text
    real(wp), intent(out) :: value
    character(:), allocatable, intent(out) :: problem
    ! Beyond these powers of ten the conversion itself could overflow or lose digits. A result file contains doubles.
    integer, parameter :: highest = range(1.0_real64), lowest = -highest
    ! 10**(highest + 1), as a literal: a compiler may round the power to a neighbour.
    real(wp), parameter :: beyond = 1.0e308_wp
    integer :: power
    logical :: is_real, is_zero

    value = 0.0_wp
    problem = ''
    call take_apart(text, is_real, is_zero, power)
    if (.not. is_real) then
      problem = 'is not a real number'
    else if (is_zero) then
      if (index(text, '-') == 1) value = -value
    else if (power > highest) then
      problem = 'is beyond the range of double precision'
    else if (power < lowest) then
      problem = 'is below the range of double precision'
    else
      read (text, *) value
      ! Digits beyond double precision may round up to a number that could not be read back.
      if (abs(value) >= beyond) problem = 'is beyond the range of double precision'
    end if
  end subroutine read_real

  !> An integer. `problem` is '' or says what is wrong with the word.
  pure subroutine read_integer(text, value, problem)
    character(*), intent(in) :: text
    integer(int64), intent(out) :: value
    character(:), allocatable, intent(out) :: problem
    integer :: ios

    value = 0_int64
    problem = 'is not an integer'
    if (len(text) > longest_number .or. unsigned(text) == '' .or. verify(unsigned(text), digits) > 0) return
    problem = ''
    read (text, *, iostat=ios) value
    if (ios /= 0) problem = 'is beyond the range of 64-bit integers'
  end subroutine read_integer

  !> [sign] digits [. digits] [e|d [sign] digits], with at least one digit before the exponent; also the power of ten of the first
  !> digit that is not zero.
  pure subroutine take_apart(text, is_real, is_zero, power)
    character(*), intent(in) :: text
    logical, intent(out) :: is_real, is_zero
    integer, intent(out) :: power
    character(:), allocatable :: figures, exponent
    integer :: letter, point, first, shift
    ! Large enough to be out of range with any mantissa.
    integer, parameter :: out_of_range = 100000

    letter = scan(text//'e', 'eEdD')
    figures = unsigned(text(:letter - 1))
    exponent = unsigned(text(letter + 1:))
    point = index(figures//'.', '.')
    figures = figures(:point - 1)//figures(point + 1:)
    is_real = len(text) <= longest_number .and. len(figures) > 0 .and. verify(figures//exponent, digits) == 0 .and. &
      (len(exponent) > 0 .or. letter > len(text))
    first = verify(figures, '0')
    is_zero = first == 0
    power = point - first - 1
    first = verify(exponent, '0')
    if (.not. is_real .or. first == 0) return
    shift = out_of_range
    if (len(exponent) - first < 5) read (exponent, *) shift
    power = power + merge(-shift, shift, text(letter + 1:letter + 1) == '-')
  end subroutine take_apart

  pure function unsigned(text) result(rest)
    character(*), intent(in) :: text
    character(:), allocatable :: rest

    rest = text
    if (scan(text, '+-') == 1) rest = text(2:)
  end function unsigned
end module dst_text
