!> The list of points of a sweep: from an HDF5 file with a dataset for each key, or from a CSV file.
module dst_sweep_list
  use dst_deck, only: deck_t
  use dst_deck_sweep, only: range_problem
  use dst_disk, only: path_t
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_tools, only: hid_t, hdf5_t, open_existing, close_file, failure_reason, refusal, names_in, read_list
  use dst_hdf5_origin, only: is_hdf5
  use dst_sweep, only: axis_t, name_axis
  use dst_sweep_points, only: path_of_points, points_of_csv
  use dst_text, only: integer_text
  implicit none
  private

  public :: read_points

contains

  !> Read the points of the file that a deck names.
  subroutine read_points(deck, axes, error)
    type(deck_t), intent(in) :: deck
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error

    if (is_hdf5(path_of_points(deck))) then
      call read_datasets(deck, path_of_points(deck), axes, error)
    else
      call points_of_csv(deck, axes, error)
    end if
  end subroutine read_points

  !> One-dimensional datasets of one length at the root, each with the name of its key. A name without a dot is not that of a key:
  !> coordinates and indices with such names, which other programs add, are skipped.
  subroutine read_datasets(deck, path, axes, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: path
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    type(path_t), allocatable :: names(:)
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    character(:), allocatable :: problem
    integer :: i, n

    call open_existing(path, file, h5)
    call names_in(file, '/', names, h5)
    if (h5%status < 0) then
      call raise(error, file_error, path//': cannot be read: '//failure_reason())
      return
    end if
    allocate (axes(count([(index(names(i)%text, '.') > 0, i=1, size(names))])))
    n = 0
    do i = 1, size(names)
      if (index(names(i)%text, '.') == 0) cycle
      n = n + 1
      call name_axis(deck, names(i)%text, axes, n, 'named', problem)
      if (problem == '') call take_values(file, names(i)%text, axes(n), problem)
      if (problem /= '') call raise(error, file_error, path//': '//problem)
      if (allocated(error)) exit
      if (size(axes(n)%values) /= size(axes(1)%values)) then
        call raise(error, file_error, path//": '"//names(i)%text//"' has "//integer_text(size(axes(n)%values))// &
          ' values, but the first dataset has '//integer_text(size(axes(1)%values))//': give datasets of one length')
        exit
      end if
    end do
    call close_file(file, h5)
    if (n == 0) call raise(error, file_error, path//': holds no points: give one-dimensional datasets with names of keys, '// &
      'like /system.misalignment_deg')
  end subroutine read_datasets

  subroutine take_values(file, name, axis, problem)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(axis_t), intent(inout) :: axis
    character(:), allocatable, intent(out) :: problem   !! '' if there is none
    type(hdf5_t) :: h5
    integer :: i

    call read_list(file, name, axis%values, h5)
    problem = ''
    if (h5%status < 0) problem = "'"//name//"' is no sound one-dimensional dataset of numbers: give one value a case"
    if (refusal(h5) /= '') problem = refusal(h5)//': give plain one-dimensional datasets of numbers, one value a case'
    do i = 1, size(axis%values)
      if (problem /= '') exit
      problem = range_problem(axis%key, axis%values(i))
      if (problem /= '') problem = "'"//name//"' value "//integer_text(i)//': '//problem
    end do
  end subroutine take_values
end module dst_sweep_list
