!> A table in a result file: columns with rows of one length. Rows wait in memory until there are many, and are then written in
!> their order, so that the memory hardly grows with the table, and chunks of the file are written whole.
module dst_hdf5_table
  use dst_hdf5_tools, only: hid_t, hsize_t, hdf5_t, dataset_t, column_t, create_column, open_dataset, write_rows, read_rows, &
    attach_scale
  use dst_kinds, only: real64
  implicit none
  private

  public :: table_t

  !> The columns, and their rows that wait to be written.
  type :: table_t
    type(column_t), allocatable :: columns(:)
    integer(hsize_t) :: rows = 0                       !! that the table has from the beginning on
    integer :: row_length = 0                          !! numbers of one column in a row; 0: one, without a second dimension
    integer :: chunk_rows = 1
    integer, private :: count = 0
    integer(hsize_t), allocatable, private :: waiting(:)      !! rows in ascending order
    integer, allocatable, private :: place(:)                 !! of their values
    real(real64), allocatable, private :: values(:, :, :)     !! (number in a row, place, column)
  contains
    procedure :: create
    procedure :: put_row
    procedure :: write_waiting
    procedure :: rows_in
    procedure :: take_rows
  end type table_t

contains

  !> Create the columns; `most` rows wait at most. `scales`: the coordinates of the rows, and of the numbers in a row; without this
  !> argument the first column is the coordinate of the rows.
  subroutine create(self, file, most, h5, scales)
    class(table_t), intent(inout) :: self
    integer(hid_t), intent(in) :: file
    integer, intent(in) :: most
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t), intent(in), optional :: scales(:)
    integer :: i, k

    self%count = 0
    if (.not. allocated(self%values)) &
      allocate (self%waiting(most), self%place(most), self%values(max(1, self%row_length), most, size(self%columns)))
    do i = 1, size(self%columns)
      associate (column => self%columns(i))
        column%dataset = dataset_t(rows=self%rows, row_length=self%row_length)
        call create_column(file, column, self%chunk_rows, i == 1 .and. .not. present(scales), h5)
        if (.not. present(scales)) then
          if (i > 1) call attach_scale(column%dataset, self%columns(1)%dataset, 0, h5)
        else
          do k = 1, size(scales)
            call attach_scale(column%dataset, scales(k), k - 1, h5)
          end do
        end if
      end associate
    end do
  end subroutine create

  !> Let a row wait; the rows that wait are written if there is no room for it.
  subroutine put_row(self, row, values, h5)
    class(table_t), intent(inout) :: self
    integer(hsize_t), intent(in) :: row           !! counted from 1
    real(real64), intent(in) :: values(:, :)      !! (number in the row, column)
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    if (self%count == size(self%waiting)) call self%write_waiting(h5)
    self%count = self%count + 1
    do i = self%count, 2, -1
      if (self%waiting(i - 1) <= row) exit
      self%waiting(i) = self%waiting(i - 1)
      self%place(i) = self%place(i - 1)
    end do
    self%waiting(i) = row
    self%place(i) = self%count
    self%values(:, self%count, :) = values
  end subroutine put_row

  !> Write the rows that wait: successive rows of a chunk at once.
  subroutine write_waiting(self, h5)
    class(table_t), intent(inout) :: self
    type(hdf5_t), intent(inout) :: h5
    real(real64), allocatable :: values(:, :)
    integer(hsize_t) :: chunk
    integer :: first, last, i

    chunk = self%chunk_rows
    first = 1
    do while (first <= self%count)
      do last = first, self%count - 1
        if (self%waiting(last + 1) /= self%waiting(last) + 1 .or. modulo(self%waiting(last), chunk) == 0) exit
      end do
      do i = 1, size(self%columns)
        values = self%values(:, self%place(first:last), i)
        call write_rows(self%columns(i)%dataset, self%waiting(first) - 1, size(values, 2, hsize_t), values, h5)
      end do
      first = last + 1
    end do
    self%count = 0
  end subroutine write_waiting

  !> Number of rows of this table in another file.
  integer(hsize_t) function rows_in(self, file, h5)
    class(table_t), intent(in) :: self
    integer(hid_t), intent(in) :: file
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: dataset

    call open_dataset(file, path_of(self%columns(1)), dataset, h5, self%row_length)
    rows_in = dataset%rows
  end function rows_in

  !> Take rows of this table in another file, from its row `begin` on: those that are wanted get the places `rows`.
  subroutine take_rows(self, file, begin, rows, is_wanted, from, to)
    class(table_t), intent(inout) :: self
    integer(hid_t), intent(in) :: file
    integer(hsize_t), intent(in) :: begin, rows(:)
    logical, intent(in) :: is_wanted(:)
    type(hdf5_t), intent(inout) :: from, to       !! status of reading that file, and of writing this one
    type(dataset_t) :: dataset
    real(real64), allocatable :: values(:, :, :)
    integer :: i

    allocate (values(max(1, self%row_length), size(rows), size(self%columns)))
    do i = 1, size(self%columns)
      call open_dataset(file, path_of(self%columns(i)), dataset, from, self%row_length)
      call read_rows(dataset, begin - 1, size(rows, kind=hsize_t), values(:, :, i), from)
    end do
    if (from%status < 0) return
    if (self%count + count(is_wanted) > size(self%waiting)) call self%write_waiting(to)
    do i = 1, size(rows)
      if (is_wanted(i)) call self%put_row(rows(i), values(:, i, :), to)
    end do
  end subroutine take_rows

  pure function path_of(column) result(path)
    type(column_t), intent(in) :: column
    character(:), allocatable :: path

    path = trim(column%group)//'/'//trim(column%quantity%name)
  end function path_of
end module dst_hdf5_table
