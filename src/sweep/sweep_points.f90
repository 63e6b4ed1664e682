!> A list of points for a sweep, from a CSV file: names of keys in the first line, one case in each other line.
!>
!> A fault is reported with its line.
module dst_sweep_points
  use dst_csv, only: csv_table_t, read_csv
  use dst_deck, only: deck_t
  use dst_deck_sweep, only: range_problem
  use dst_errors, only: error_t, raise, file_error
  use dst_schema, only: sweep_group
  use dst_sweep, only: axis_t, name_axis
  use dst_text, only: integer_text
  use dst_text_file, only: path_beside
  implicit none
  private

  public :: path_of_points, read_points

  integer, parameter :: most_bytes = 2**28

contains

  !> The file that `sweep.points` names; a relative name is relative to the deck's folder.
  function path_of_points(deck) result(path)
    type(deck_t), intent(in) :: deck
    character(:), allocatable :: path

    path = path_beside(deck%name, deck%text_of(sweep_group, 'points'))
  end function path_of_points

  !> Read the points of a deck.
  subroutine read_points(deck, axes, error)
    type(deck_t), intent(in) :: deck
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    type(csv_table_t) :: table
    character(:), allocatable :: path, problem
    integer :: i, n

    path = path_of_points(deck)
    call read_csv(path, most_bytes, 'give a CSV file with the values of keys', table, problem)
    if (problem == '' .and. (table%rows == 0 .or. .not. table%has_names)) &
      problem = path//': holds no points: give names of keys in the first line, and a case in each other line'
    if (problem /= '') then
      call raise(error, file_error, problem)
      return
    end if
    allocate (axes(size(table%names)))
    do i = 1, size(axes)
      call name_axis(deck, trim(table%names(i)), axes, i, 'named', problem)
      if (problem /= '') call raise(error, file_error, path//':'//integer_text(table%first_line)//': '//problem)
      if (allocated(error)) return
      axes(i)%values = table%values(i, :table%rows)
    end do
    do n = 1, table%rows
      do i = 1, size(axes)
        problem = range_problem(axes(i)%key, axes(i)%values(n))
        if (problem == '') cycle
        call raise(error, file_error, path//':'//integer_text(table%line(n))//': '//problem)
        return
      end do
    end do
  end subroutine read_points
end module dst_sweep_points
