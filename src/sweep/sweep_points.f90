!> A list of points for a sweep, from a CSV file: names of keys in the first line, one case in each other line.
!>
!> Lines and fields are divided by dst_csv; blank lines are skipped. A fault is reported with its line.
module dst_sweep_points
  use dst_csv, only: blanks, find_fields, find_line, first_byte, line_end_of, separator_of
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

  character(*), parameter :: hdf5_signature = char(137)//'HDF'

  integer, parameter :: most_bytes = 2**28

contains

  !> The file that `sweep.points` names; a relative name is relative to the deck's folder.
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
    real(wp), allocatable :: values(:)
    character :: separator, line_end
    integer :: first, last, next, line, n, i

    path = path_of_points(deck)
    call read_bytes(path, most_bytes, text, reason)
    if (allocated(reason)) then
      call raise(error, file_error, path//': cannot be read: '//reason)
      return
    else if (index(text, hdf5_signature) == 1) then
      call raise(error, file_error, path//': is an HDF5 file, which only the program dynstiction reads: in Python give its '// &
        'datasets as parameters, with points=True')
      return
    end if
    line_end = line_end_of(text)
    next = first_byte(text)
    line = 0
    n = 0
    do while (next <= len(text) .and. .not. allocated(error))
      call find_line(text, line_end, next, first, last)
      line = line + 1
      if (verify(text(first:last), blanks) > 0) then
        if (allocated(axes)) then
          n = n + 1
          call read_row(axes, text(first:last), separator, path//':'//integer_text(line), n, error)
        else
          separator = separator_of(text(first:last))
          call read_names(deck, text(first:last), separator, path//':'//integer_text(line), axes, error)
          if (.not. allocated(error)) call make_room(axes, line_count(text(next:), line_end), path, error)
        end if
      end if
    end do
    if (n == 0 .and. .not. allocated(error)) call raise(error, file_error, path// &
      ': holds no points: give names of keys in the first line, and a case in each other line')
    if (allocated(error)) return
    do i = 1, size(axes)
      allocate (values, source=axes(i)%values(:n))
      call move_alloc(values, axes(i)%values)
    end do
  end subroutine read_csv

  !> Give the axes room for this many values.
  subroutine make_room(axes, most, path, error)
    type(axis_t), intent(inout) :: axes(:)
    integer, intent(in) :: most
    character(*), intent(in) :: path
    type(error_t), allocatable, intent(out) :: error
    integer :: i, status

    do i = 1, size(axes)
      allocate (axes(i)%values(most), stat=status)
      if (status == 0) cycle
      call raise(error, out_of_memory, path//': no memory for its points: divide it into several lists')
      return
    end do
  end subroutine make_room

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

  !> Make axis `i` that of the key `name`, which no earlier axis may have; `place` is the position of the name.
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

  !> A line with the values of case `n`.
  subroutine read_row(axes, line, separator, place, n, error)
    type(axis_t), intent(inout) :: axes(:)
    character(*), intent(in) :: line, place
    character, intent(in) :: separator
    integer, intent(in) :: n
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    integer, allocatable :: bounds(:, :)
    integer :: i

    call find_fields(line, separator, bounds)
    problem = ''
    if (size(bounds, 2) /= size(axes)) problem = integer_text(size(bounds, 2))//' value(s), but the first line names '// &
      integer_text(size(axes))//': give one for each'
    do i = 1, size(axes)
      if (problem /= '') exit
      associate (field => line(bounds(1, i):bounds(2, i)), value => axes(i)%values(n))
        call read_real(field, value, problem)
        if (problem == '') then
          problem = range_problem(axes(i)%key, value)
        else
          problem = "'"//excerpt(field)//"' "//problem//': give a finite real number'
        end if
      end associate
    end do
    if (problem /= '') call raise(error, file_error, place//': '//problem)
  end subroutine read_row
end module dst_sweep_points
