!> A list of points for a sweep, from a CSV file: names of keys in the first line, a case in each other line.
!>
!> Fields are separated by what the first line has: semicolons, commas, tabs or blanks, the first of these that it holds. They
!> may stand in double quotes; blank lines are passed over; lines end with LF, CR LF or the file (RFC 4180, and what spreadsheets
!> make of it). A fault is reported with its line.
module dst_sweep_points
  use dst_deck, only: deck_t
  use dst_deck_sweep, only: varied_key, variation_problem, range_problem
  use dst_disk, only: read_bytes
  use dst_errors, only: error_t, raise, file_error, out_of_memory
  use dst_kinds, only: wp
  use dst_schema, only: schema, sweep_group
  use dst_sweep, only: axis_t
  use dst_text, only: excerpt, integer_text, read_real
  implicit none
  private

  public :: path_of_points, read_csv, name_axis

  character(*), parameter :: line_ends = achar(10)//achar(13), tab = achar(9), quote = '"'
  character(*), parameter :: separators = ';,'//tab//' '
  character(*), parameter :: hdf5_signature = char(137)//'HDF'
  character(*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

  integer, parameter :: most_bytes = 2**28

contains

  !> The file that `sweep.points` names; a relative name is looked for beside the deck.
  function path_of_points(deck) result(path)
    type(deck_t), intent(in) :: deck
    character(:), allocatable :: path

    path = deck%text_of(sweep_group, 'points')
    if (path(1:1) /= '/') path = deck%name(:index(deck%name, '/', back=.true.))//path
  end function path_of_points

  !> Read the points of a deck.
  subroutine read_csv(deck, axes, error)
    type(deck_t), intent(in) :: deck
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: path, text, reason
    real(wp), allocatable :: table(:, :)
    character :: separator
    integer :: first, last, line, n, i, status

    path = path_of_points(deck)
    call read_bytes(path, most_bytes, text, reason)
    if (allocated(reason)) then
      call raise(error, file_error, path//': cannot be read: '//reason)
      return
    end if
    if (index(text, hdf5_signature) == 1) then
      call raise(error, file_error, path//': is an HDF5 file, which only the program dynstiction reads: in Python give its '// &
        'datasets as parameters, with points=True')
      return
    end if
    first = 1
    if (index(text(:min(3, len(text))), byte_order_mark) == 1) first = 4
    line = 0
    n = 0
    allocate (table(0, 0))
    do while (first <= len(text))
      last = line_end(text, first)
      line = line + 1
      if (verify(text(first:last), ' '//tab) > 0) then
        if (.not. allocated(axes)) then
          separator = separator_of(text(first:last))
          call read_names(deck, text(first:last), separator, path//':'//integer_text(line), axes, error)
          if (allocated(error)) return
          deallocate (table)
          allocate (table(1 + line_count(text(last + 1:)), size(axes)), stat=status)
          if (status /= 0) call raise(error, out_of_memory, path//': no memory for its points: divide it into several lists')
        else
          n = n + 1
          call read_row(axes, text(first:last), separator, path//':'//integer_text(line), table(n, :), error)
        end if
        if (allocated(error)) return
      end if
      first = last + 2
      ! CR LF ends one line.
      if (first <= len(text)) then
        if (text(first - 1:first) == achar(13)//achar(10)) first = first + 1
      end if
    end do
    if (n == 0) then
      call raise(error, file_error, path//': holds no points: give names of keys in the first line, and a case in each other line')
      return
    end if
    do i = 1, size(axes)
      allocate (axes(i)%values(n), stat=status)
      if (status /= 0) then
        call raise(error, out_of_memory, path//': no memory for its points: divide it into several lists')
        return
      end if
      axes(i)%values = table(:n, i)
    end do
  end subroutine read_csv

  !> The last character of the line that begins at `first`.
  pure integer function line_end(text, first)
    character(*), intent(in) :: text
    integer, intent(in) :: first

    line_end = scan(text(first:), line_ends)
    if (line_end == 0) line_end = len(text) - first + 2
    line_end = first + line_end - 2
  end function line_end

  pure integer function line_count(text)
    character(*), intent(in) :: text
    integer :: i

    line_count = 0
    do i = 1, len(text)
      if (scan(text(i:i), line_ends) > 0) line_count = line_count + 1
    end do
  end function line_count

  pure character function separator_of(line)
    character(*), intent(in) :: line
    integer :: i

    do i = 1, len(separators)
      separator_of = separators(i:i)
      if (index(line, separator_of) > 0) return
    end do
  end function separator_of

  !> The first line.
  subroutine read_names(deck, line, separator, place, axes, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: line, place
    character, intent(in) :: separator
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    integer, allocatable :: bounds(:, :)
    integer :: i

    call find_fields(line, separator, bounds)
    allocate (axes(size(bounds, 2)))
    do i = 1, size(axes)
      call name_axis(deck, line(bounds(1, i):bounds(2, i)), place, axes, i, error)
      if (allocated(error)) return
    end do
  end subroutine read_names

  !> Let axis `i` be of the key `name`, which no axis before it has; `place` is where the name stands.
  subroutine name_axis(deck, name, place, axes, i, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: name, place
    type(axis_t), intent(inout) :: axes(:)
    integer, intent(in) :: i
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem

    problem = variation_problem(deck, name)
    if (problem == '' .and. any(axes(:i - 1)%key == varied_key(name))) problem = "'"//name//"' is named twice: name it once"
    if (problem /= '') then
      call raise(error, file_error, place//': '//problem)
      return
    end if
    axes(i)%key = varied_key(name)
    axes(i)%name = trim(schema(axes(i)%key)%group)//'.'//schema(axes(i)%key)%name
  end subroutine name_axis

  !> A line with the values of a case.
  subroutine read_row(axes, line, separator, place, values, error)
    type(axis_t), intent(in) :: axes(:)
    character(*), intent(in) :: line, place
    character, intent(in) :: separator
    real(wp), intent(out) :: values(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    integer, allocatable :: bounds(:, :)
    integer :: i

    values = 0.0_wp
    call find_fields(line, separator, bounds)
    if (size(bounds, 2) /= size(values)) then
      call raise(error, file_error, place//': '//integer_text(size(bounds, 2))// &
        ' value(s), but the first line names '//integer_text(size(values))//': give one for each')
      return
    end if
    do i = 1, size(values)
      associate (field => line(bounds(1, i):bounds(2, i)))
        call read_real(field, values(i), problem)
        if (problem /= '') then
          problem = "'"//excerpt(field)//"' "//problem//': give a finite real number'
        else
          problem = range_problem(axes(i)%key, values(i))
        end if
      end associate
      if (problem == '') cycle
      call raise(error, file_error, place//': '//problem)
      return
    end do
  end subroutine read_row

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
      ! Several blanks separate once.
      if (length > 0 .or. separator /= ' ') then
        n = n + 1
        found(:, n) = trimmed(line, [first, first + length - 1])
      end if
      first = first + length + 1
    end do
    allocate (bounds, source=found(:, :n))
  end subroutine find_fields

  pure function trimmed(line, bounds) result(inner)
    character(*), intent(in) :: line
    integer, intent(in) :: bounds(2)
    integer :: inner(2)

    inner = without_blanks(line, bounds)
    if (inner(2) <= inner(1)) return
    if (line(inner(1):inner(1)) == quote .and. line(inner(2):inner(2)) == quote) &
      inner = without_blanks(line, inner + [1, -1])
  end function trimmed

  pure function without_blanks(line, bounds) result(inner)
    character(*), intent(in) :: line
    integer, intent(in) :: bounds(2)
    integer :: inner(2)

    inner = bounds
    do while (inner(1) <= inner(2))
      if (scan(line(inner(1):inner(1)), ' '//tab) == 0) exit
      inner(1) = inner(1) + 1
    end do
    do while (inner(1) <= inner(2))
      if (scan(line(inner(2):inner(2)), ' '//tab) == 0) exit
      inner(2) = inner(2) - 1
    end do
  end function without_blanks
end module dst_sweep_points
