!> A list of points for a sweep, from a CSV file: names of keys in the first line, a case in each other line.
module dst_sweep_points
  use dst_disk, only: read_bytes
  use dst_errors, only: error_t, raise, file_error
  use dst_kinds, only: wp, int64
  use dst_namelist, only: is_plain_text
  use dst_schema, only: find_key
  use dst_sweep, only: axis_t
  use dst_text, only: excerpt, integer_text, read_real, word, word_count
  implicit none
  private

  public :: read_points

  integer, parameter :: most_bytes = 2**28
  character, parameter :: newline = achar(10)

contains

  !> Read `file_name`; a relative name is looked for beside the deck.
  subroutine read_points(file_name, deck_name, axes, error)
    character(*), intent(in) :: file_name, deck_name
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: path, text, line, reason
    real(wp), allocatable :: table(:, :)
    integer :: next, number, rows, columns, i

    path = file_name
    if (path(1:1) /= '/') path = deck_name(:index(deck_name, '/', back=.true.))//file_name
    call read_bytes(path, most_bytes, text, reason)
    if (.not. allocated(reason)) then
      if (.not. is_plain_text(text)) reason = 'it is not plain UTF-8 text'
    end if
    if (allocated(reason)) then
      call raise(error, file_error, path//': '//reason//': give a CSV file with names of keys in its first line')
      return
    end if
    next = 1
    call take_line(text, next, line)
    columns = word_count(line)
    allocate (axes(columns), table(columns, lines_in(text)))
    do i = 1, columns
      axes(i)%name = word(line, i)
      if (has_no_key(axes(i)%name)) then
        call raise(error, file_error, path//":1: there is no key '"//excerpt(word(line, i))// &
          "': name it as GROUP.KEY, like system.misalignment_deg")
        return
      end if
    end do
    rows = 0
    number = 1
    do while (next <= len(text))
      call take_line(text, next, line)
      number = number + 1
      if (line == '') cycle
      rows = rows + 1
      call read_row(line, table(:, rows), path, number, error)
      if (allocated(error)) exit
    end do
    do i = 1, columns
      axes(i)%values = table(i, :rows)
    end do
  end subroutine read_points

  !> Whether this is not of the form GROUP.KEY with a key of the schema.
  logical function has_no_key(name)
    character(*), intent(in) :: name
    integer :: dot

    dot = index(name, '.')
    has_no_key = find_key(name(:max(0, dot - 1)), trim(name(dot + 1:))) == 0
  end function has_no_key

  !> The line at `next`, with blanks for separators and quotes; `next` goes to the line after it.
  pure subroutine take_line(text, next, line)
    character(*), intent(in) :: text
    integer, intent(inout) :: next
    character(:), allocatable, intent(out) :: line
    integer :: length, i

    length = index(text(next:), newline) - 1
    if (length < 0) length = len(text) - next + 1
    line = text(next:next + length - 1)
    next = next + length + 1
    do i = 1, length
      if (scan(line(i:i), ',;"'//achar(9)//achar(13)) > 0) line(i:i) = ' '
    end do
  end subroutine take_line

  !> At most so many lines.
  pure integer function lines_in(text)
    character(*), intent(in) :: text
    integer :: i

    lines_in = 1
    do i = 1, len(text)
      if (text(i:i) == newline) lines_in = lines_in + 1
    end do
  end function lines_in

  subroutine read_row(line, values, path, number, error)
    character(*), intent(in) :: line, path
    real(wp), intent(out) :: values(:)
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    integer :: i

    values = 0.0_wp
    if (word_count(line) /= size(values)) then
      call raise(error, file_error, path//':'//integer_text(int(number, int64))//': '// &
        integer_text(int(word_count(line), int64))//' value(s): the first line names '//integer_text(int(size(values), int64)))
      return
    end if
    do i = 1, size(values)
      call read_real(word(line, i), values(i), problem)
      if (problem == '') cycle
      call raise(error, file_error, path//':'//integer_text(int(number, int64))//": '"//excerpt(word(line, i))//"' "//problem// &
        ': give a finite real number')
      return
    end do
  end subroutine read_row
end module dst_sweep_points
