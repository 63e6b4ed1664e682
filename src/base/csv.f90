!> Lines and fields of a CSV file.
!>
!> Fields are separated by semicolons, commas, tabs or blanks: by the first of these that the first line contains. Fields may be in
!> double quotes; lines end with LF, CR LF or CR, or at the end of the file (RFC 4180, and the variants that spreadsheets write).
module dst_csv
  implicit none
  private

  public :: line_end_of, first_byte, find_line, separator_of, find_fields, blanks

  character, parameter :: lf = achar(10), cr = achar(13), tab = achar(9), quote = '"'
  !> Characters that may surround a field.
  character(*), parameter :: blanks = ' '//tab
  character(*), parameter :: separators = ';,'//tab//' '
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

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
