!> A table of numbers in a CSV file, with names in its first line or without.
!>
!> Fields are separated by semicolons, commas, tabs or blanks: by the first of these that the first line contains. Fields may be in
!> double quotes; lines end with LF, CR LF or CR, or at the end of the file (RFC 4180, and the variants that spreadsheets write).
!> Blank lines are skipped. A fault is reported with its line.
module dst_csv
  use dst_kinds, only: wp
  use dst_text, only: excerpt, integer_text, read_real, with_blanks
  use dst_text_file, only: read_text, hdf5_signature
  implicit none
  private

  public :: csv_table_t, read_csv

  !> A table of numbers.
  type :: csv_table_t
    !> Fields of the first line, as they are written.
    character(:), allocatable :: names(:)
    !> Whether the first line has no numbers only: it is no row of the values.
    logical :: has_names = .false.
    real(wp), allocatable :: values(:, :)                    !! values(column, row), of which there are `rows`
    integer, allocatable :: line(:)                          !! line of each row
    integer :: rows = 0
    integer :: first_line = 0                                !! line of the names, 0 if there is none
  end type csv_table_t

  character, parameter :: lf = achar(10), cr = achar(13), tab = achar(9), quote = '"'
  !> Characters that may surround a field.
  character(*), parameter :: blanks = ' '//tab
  character(*), parameter :: separators = ';,'//tab//' '
  !> More columns are no table of keys; what is longer is no name of one.
  integer, parameter :: most_columns = 1000, longest_name = 200
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

contains

  !> The table in a file; `problem` is '' or the place and what is wrong there: 'PATH:LINE: ...'.
  subroutine read_csv(path, most_bytes, remedy, table, problem)
    character(*), intent(in) :: path
    integer, intent(in) :: most_bytes
    character(*), intent(in) :: remedy       !! what to give, if the file cannot be read
    type(csv_table_t), intent(out) :: table
    character(:), allocatable, intent(out) :: problem
    character(:), allocatable :: text, row
    integer, allocatable :: bounds(:, :)
    character :: separator, line_end
    integer :: next, last, line, i

    allocate (character(0) :: table%names(0))
    call read_text(path, most_bytes, text, problem)
    if (index(text, hdf5_signature) == 1) then
      problem = 'is an HDF5 file: write its columns as CSV'
    else if (problem /= '') then
      problem = problem//': '//remedy
    end if
    if (problem /= '') problem = path//': '//problem
    line_end = merge(lf, cr, index(text, lf) > 0)
    text = text//line_end
    next = merge(1 + len(byte_order_mark), 1, index(text, byte_order_mark) == 1)
    line = 0
    do while (next < len(text) .and. problem == '')
      last = next - 2 + index(text(next:), line_end)
      ! Quotes around a field are as good as blanks: no name of a key, and no number, has one inside.
      row = with_blanks(text(next:last), quote)
      if (row(max(1, len(row)):) == cr) row = row(:len(row) - 1)
      line = line + 1
      next = last + 2
      if (verify(row, blanks) == 0) cycle
      if (table%first_line == 0) then
        call read_names()
      else
        call find_fields(row, separator, bounds)
        if (size(bounds, 2) /= size(table%names)) problem = integer_text(size(bounds, 2))// &
          ' value(s), but the first line has '//integer_text(size(table%names))//': give one for each'
      end if
      if (problem == '' .and. .not. (line == table%first_line .and. table%has_names)) call read_values()
      if (problem /= '') problem = path//':'//integer_text(line)//': '//problem
    end do

  contains

    !> The first line, and room for the others.
    subroutine read_names()
      integer :: columns, rows
      real(wp) :: value
      character(:), allocatable :: unreadable

      do i = 1, len(separators)
        separator = separators(i:i)
        if (index(row, separator) > 0) exit
      end do
      call find_fields(row, separator, bounds)
      columns = size(bounds, 2)
      table%first_line = line
      if (columns > most_columns) problem = integer_text(columns)//' columns: give at most '//integer_text(most_columns)
      if (any(bounds(2, :) < bounds(1, :))) problem = 'an empty field: give each column a name'
      if (problem /= '') return
      deallocate (table%names)
      allocate (character(min(maxval(bounds(2, :) - bounds(1, :)) + 1, longest_name)) :: table%names(columns))
      do i = 1, columns
        table%names(i) = row(bounds(1, i):bounds(2, i))
        call read_real(row(bounds(1, i):bounds(2, i)), value, unreadable)
        table%has_names = table%has_names .or. unreadable /= ''
      end do
      rows = 1
      do i = next, len(text)
        if (text(i:i) == line_end) rows = rows + 1
      end do
      ! A row has two characters for each number, or it is too short.
      rows = min(rows, (len(text) - next)/(2*columns) + 2)
      allocate (table%values(columns, rows), table%line(rows))
    end subroutine read_names

    subroutine read_values()
      table%rows = table%rows + 1
      table%line(table%rows) = line
      do i = 1, size(table%names)
        associate (field => row(bounds(1, i):bounds(2, i)))
          call read_real(field, table%values(i, table%rows), problem)
          if (problem /= '') problem = "'"//excerpt(field)//"' "//problem//': give a finite real number'
        end associate
        if (problem /= '') return
      end do
    end subroutine read_values
  end subroutine read_csv

  !> First and last character of each field, without the blanks around it.
  pure subroutine find_fields(line, separator, bounds)
    character(*), intent(in) :: line
    character, intent(in) :: separator
    integer, allocatable, intent(out) :: bounds(:, :)
    integer, allocatable :: found(:, :)
    integer :: n, first, last

    allocate (found(2, len(line) + 1))
    n = 0
    first = 1
    do while (first <= len(line) + 1)
      last = first - 2 + index(line(first:), separator)
      if (last < first - 1) last = len(line)
      ! Several blanks in a row are one separator.
      if (last >= first .or. separator /= ' ') then
        n = n + 1
        found(1, n) = first - 1 + verify(line(first:last)//'.', blanks)
        found(2, n) = first - 1 + verify(line(first:last), blanks, back=.true.)
      end if
      first = last + 2
    end do
    bounds = found(:, :n)
  end subroutine find_fields
end module dst_csv
