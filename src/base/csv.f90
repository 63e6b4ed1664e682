!> A table of numbers in a CSV file, with names in its first line or without.
!>
!> Fields are separated by semicolons, commas, tabs or blanks: by the first of these that the first line contains. Fields may be in
!> double quotes; lines end with LF, CR LF or CR, or at the end of the file (RFC 4180, and the variants that spreadsheets write).
!> Blank lines are skipped. A fault is reported with its line.
module dst_csv
  use dst_kinds, only: wp
  use dst_text, only: excerpt, integer_text, read_real
  implicit none
  private

  public :: csv_table_t, read_csv

  !> A table of numbers.
  type :: csv_table_t
    !> Fields of the first line, as they are written.
    character(:), allocatable :: names(:)
    !> Whether the first line has no numbers only: it is no row of the values.
    logical :: has_names = .false.
    real(wp), allocatable :: values(:, :)                    !! values(column, row)
    integer, allocatable :: line(:)                          !! line of each row
    integer :: first_line = 0
  end type csv_table_t

  character, parameter :: lf = achar(10), cr = achar(13), tab = achar(9), quote = '"'
  !> Characters that may surround a field.
  character(*), parameter :: blanks = ' '//tab
  character(*), parameter :: separators = ';,'//tab//' '
  !> More columns are no table of keys; what is longer is no name of one.
  integer, parameter :: most_columns = 1000, longest_name = 200
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

  !> The table in a text; `problem` is '' or ':LINE: ' and what is wrong there.
  pure subroutine read_csv(text, table, problem)
    character(*), intent(in) :: text
    type(csv_table_t), intent(out) :: table
    character(:), allocatable, intent(out) :: problem
    integer, allocatable :: bounds(:, :)
    character :: separator, line_end
    integer :: first, last, next, line, n, columns, i

    problem = ''
    separator = ' '
    line_end = line_end_of(text)
    next = first_byte(text)
    line = 0
    n = 0
    columns = 0
    allocate (table%values(0, 0), table%line(0))
    do while (next <= len(text))
      call find_line(text, line_end, next, first, last)
      line = line + 1
      if (verify(text(first:last), blanks) == 0) cycle
      associate (row => text(first:last))
        if (columns == 0) separator = separator_of(row)
        call find_fields(row, separator, bounds)
        if (columns == 0) then
          columns = size(bounds, 2)
          table%first_line = line
          if (columns > most_columns) problem = integer_text(columns)//' columns: give at most '//integer_text(most_columns)
          if (any(bounds(2, :) < bounds(1, :))) problem = 'an empty field: give each column a name'
          if (problem /= '') then
            problem = ':'//integer_text(line)//': '//problem
            return
          end if
          allocate (character(min(maxval(bounds(2, :) - bounds(1, :)) + 1, longest_name)) :: table%names(columns))
          do i = 1, columns
            table%names(i) = row(bounds(1, i):bounds(2, i))
          end do
          table%has_names = .not. all([(is_number(row(bounds(1, i):bounds(2, i))), i=1, columns)])
          deallocate (table%values, table%line)
          ! A row has two characters for each number, or it is too short.
          i = min(line_count(text(first:), line_end), (len(text) - first)/(2*columns) + 2)
          allocate (table%values(columns, i), table%line(i))
          if (table%has_names) cycle
        end if
        if (size(bounds, 2) /= columns) problem = integer_text(size(bounds, 2))//' value(s), but the first line has '// &
          integer_text(columns)//': give one for each'
        n = n + 1
        table%line(n) = line
        do i = 1, columns
          if (problem /= '') exit
          associate (field => row(bounds(1, i):bounds(2, i)))
            call read_real(field, table%values(i, n), problem)
            if (problem /= '') problem = "'"//excerpt(field)//"' "//problem//': give a finite real number'
          end associate
        end do
      end associate
      if (problem /= '') then
        problem = ':'//integer_text(line)//': '//problem
        return
      end if
    end do
    table%values = table%values(:, :n)
    table%line = table%line(:n)
  end subroutine read_csv

  pure logical function is_number(field)
    character(*), intent(in) :: field
    character(:), allocatable :: problem
    real(wp) :: value

    call read_real(field, value, problem)
    is_number = problem == ''
  end function is_number

  !> Number of lines of a text, the last of which need not have a line end.
  pure integer function line_count(text, line_end)
    character(*), intent(in) :: text
    character, intent(in) :: line_end
    integer :: i

    line_count = 1
    do i = 1, len(text)
      if (text(i:i) == line_end) line_count = line_count + 1
    end do
  end function line_count

  !> The last character of a line end.
  pure character function line_end_of(text)
    character(*), intent(in) :: text

    line_end_of = lf
    if (index(text, lf) == 0) line_end_of = cr
  end function line_end_of

  !> Where the text begins, after a byte order mark.
  pure integer function first_byte(text)
    character(*), intent(in) :: text

    first_byte = 1
    if (index(text, byte_order_mark) == 1) first_byte = 1 + len(byte_order_mark)
  end function first_byte

  !> First and last character of the line that begins at `next`, without its line end; `next` is then the beginning of the next
  !> line.
  pure subroutine find_line(text, line_end, next, first, last)
    character(*), intent(in) :: text
    character, intent(in) :: line_end
    integer, intent(inout) :: next
    integer, intent(out) :: first, last

    first = next
    last = first - 2 + index(text(first:), line_end)
    if (last < first - 1) last = len(text)
    next = last + 2
    if (text(max(first, last):last) == cr) last = last - 1
  end subroutine find_line

  !> The separator of the fields of a file with this first line.
  pure character function separator_of(line)
    character(*), intent(in) :: line
    integer :: i

    do i = 1, len(separators)
      separator_of = separators(i:i)
      if (index(line, separator_of) > 0) return
    end do
  end function separator_of

  !> First and last character of each field, without the blanks and quotes around it.
  pure subroutine find_fields(line, separator, bounds)
    character(*), intent(in) :: line
    character, intent(in) :: separator
    integer, allocatable, intent(out) :: bounds(:, :)
    integer, allocatable :: found(:, :)
    integer :: n, first, length

    allocate (found(2, len(line) + 1))
    n = 0
    first = 1
    do while (first <= len(line) + 1)
      length = index(line(first:), separator) - 1
      if (length < 0) length = len(line) - first + 1
      ! Several blanks in a row are one separator.
      if (length > 0 .or. separator /= ' ') then
        n = n + 1
        found(:, n) = without_blanks(line, [first, first + length - 1])
        associate (inner => found(:, n))
          if (inner(2) > inner(1)) then
            if (line(inner(1):inner(1))//line(inner(2):inner(2)) == quote//quote) inner = without_blanks(line, inner + [1, -1])
          end if
        end associate
      end if
      first = first + length + 1
    end do
    bounds = found(:, :n)
  end subroutine find_fields

  pure function without_blanks(line, bounds) result(inner)
    character(*), intent(in) :: line
    integer, intent(in) :: bounds(2)
    integer :: inner(2)

    inner = bounds(1) - 1 + [verify(line(bounds(1):bounds(2))//'.', blanks), verify(line(bounds(1):bounds(2)), blanks, back=.true.)]
  end function without_blanks
end module dst_csv
