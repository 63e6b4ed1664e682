!> HDF5 for Fortran: attributes, described datasets, datasets that grow, dimension scales. hdf5_calls.c calls the library.
!>
!> The last argument of every procedure is an `hdf5_t`, the status of a sequence of calls. After the first failure HDF5 is not
!> called any more, so that a sequence is checked once, at its end, and `failure_reason` then gives the reason of the first failure.
!> Objects are closed with their file.
module dst_hdf5_tools
  use, intrinsic :: iso_c_binding, only: c_bool, c_char, c_double, c_int, c_int64_t, c_ptr, nul => c_null_char
  use dst_kinds, only: wp, real64
  use dst_disk, only: with_remedy
  use dst_posix, only: fortran_text
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: hid_t, hsize_t, hdf5_t, open_file, close_file, failure_reason, damage_reason
  public :: as_text, as_double, as_int8, as_int32, as_int64
  public :: put_attribute, put_value, get_value, create_group, has_column
  public :: dataset_t, column_t, create_column, open_dataset, write_rows, read_rows, append_text, text_of_row, attach_scale

  !> Kinds of identifiers, and of numbers of rows.
  integer, parameter :: hid_t = c_int64_t, hsize_t = c_int64_t

  enum, bind(c)
    !> How values are stored, as in hdf5_calls.c.
    enumerator :: as_text, as_double, as_int8, as_int32, as_int64
  end enum

  !> The status of a sequence of calls.
  type, bind(c) :: hdf5_t
    integer(c_int) :: status = 0                 !! negative after a failure
  end type hdf5_t

  !> A dataset that grows: one number or text in each row, or rows of `row_length` numbers.
  type, bind(c) :: dataset_t
    integer(hid_t) :: id = -1
    integer(hsize_t) :: rows = 0
    integer(hsize_t) :: row_length = 0           !! 0: it has one dimension
  end type dataset_t

  !> A column of a file.
  type :: column_t
    type(quantity_t) :: quantity
    character(24) :: group = ''                  !! in which it is, like sweep/summary
    integer(c_int) :: stored_as = as_double
    real(c_double) :: fill = 0.0_c_double        !! value of rows that are not written
    type(dataset_t) :: dataset = dataset_t()
  end type column_t

  !> Create or overwrite an attribute of a file, group or dataset.
  interface put_attribute
    module procedure put_text_attribute, put_integer_attribute
  end interface put_attribute

  !> Read an attribute of a file or of a group in it, or the value of a scalar dataset: a text, an integer, a real number.
  interface get_value
    module procedure get_text, get_integer, get_number
  end interface get_value

  !> Create a scalar dataset.
  interface put_value
    module procedure put_text, put_number
  end interface put_value

  interface
    integer(hid_t) function c_open(path, is_new, h5) bind(c, name='dst_h5_open')
      import :: c_bool, c_char, hdf5_t, hid_t
      character(c_char), intent(in) :: path(*)
      logical(c_bool), value :: is_new
      type(hdf5_t), intent(inout) :: h5
    end function c_open

    !> Close a file that was opened.
    subroutine close_file(file, h5) bind(c, name='dst_h5_close')
      import :: hdf5_t, hid_t
      integer(hid_t), value :: file
      type(hdf5_t), intent(inout) :: h5
    end subroutine close_file

    type(c_ptr) function c_failure() bind(c, name='dst_h5_failure')
      import :: c_ptr
    end function c_failure

    !> Create a group and open it; its name ends with NUL.
    integer(hid_t) function create_group(parent, name, h5) bind(c, name='dst_h5_create_group')
      import :: c_char, hdf5_t, hid_t
      integer(hid_t), value :: parent
      character(c_char), intent(in) :: name(*)
      type(hdf5_t), intent(inout) :: h5
    end function create_group

    subroutine c_put(object, words, is_attribute, kind, text, number, h5) bind(c, name='dst_h5_put')
      import :: c_bool, c_char, c_double, c_int, hdf5_t, hid_t
      integer(hid_t), value :: object
      character(c_char), intent(in) :: words(*), text(*)
      logical(c_bool), value :: is_attribute
      integer(c_int), value :: kind
      real(c_double), value :: number
      type(hdf5_t), intent(inout) :: h5
    end subroutine c_put

    type(c_ptr) function c_get(object, name, kind, number, h5) bind(c, name='dst_h5_get')
      import :: c_char, c_double, c_int, c_ptr, hdf5_t, hid_t
      integer(hid_t), value :: object
      character(c_char), intent(in) :: name(*)
      integer(c_int), value :: kind
      real(c_double), intent(inout) :: number
      type(hdf5_t), intent(inout) :: h5
    end function c_get

    subroutine c_create_dataset(group, words, kind, chunk_rows, is_scale, fill, dataset, h5) bind(c, name='dst_h5_create_dataset')
      import :: c_bool, c_char, c_double, c_int, c_int64_t, dataset_t, hdf5_t, hid_t
      integer(hid_t), value :: group
      character(c_char), intent(in) :: words(*)
      integer(c_int), value :: kind
      integer(c_int64_t), value :: chunk_rows
      logical(c_bool), value :: is_scale
      real(c_double), value :: fill
      type(dataset_t), intent(inout) :: dataset
      type(hdf5_t), intent(inout) :: h5
    end subroutine c_create_dataset

    subroutine c_open_dataset(group, name, dataset, h5) bind(c, name='dst_h5_open_dataset')
      import :: c_char, dataset_t, hdf5_t, hid_t
      integer(hid_t), value :: group
      character(c_char), intent(in) :: name(*)
      type(dataset_t), intent(inout) :: dataset
      type(hdf5_t), intent(inout) :: h5
    end subroutine c_open_dataset

    !> Write rows of numbers after the first `first` rows; new rows are appended.
    subroutine write_rows(dataset, first, rows, values, h5) bind(c, name='dst_h5_write_rows')
      import :: c_double, dataset_t, hdf5_t, hsize_t
      type(dataset_t), intent(inout) :: dataset
      integer(hsize_t), value :: first, rows
      real(c_double), intent(in) :: values(*)
      type(hdf5_t), intent(inout) :: h5
    end subroutine write_rows

    !> Read rows of numbers after the first `first` rows.
    subroutine read_rows(dataset, first, rows, values, h5) bind(c, name='dst_h5_read_rows')
      import :: c_double, dataset_t, hdf5_t, hsize_t
      type(dataset_t), intent(in) :: dataset
      integer(hsize_t), value :: first, rows
      real(c_double), intent(inout) :: values(*)
      type(hdf5_t), intent(inout) :: h5
    end subroutine read_rows

    subroutine c_append_text(dataset, text, h5) bind(c, name='dst_h5_append_text')
      import :: c_char, dataset_t, hdf5_t
      type(dataset_t), intent(inout) :: dataset
      character(c_char), intent(in) :: text(*)
      type(hdf5_t), intent(inout) :: h5
    end subroutine c_append_text

    type(c_ptr) function c_text_of_row(dataset, row, h5) bind(c, name='dst_h5_text')
      import :: c_ptr, dataset_t, hdf5_t, hsize_t
      type(dataset_t), intent(in) :: dataset
      integer(hsize_t), value :: row
      type(hdf5_t), intent(inout) :: h5
    end function c_text_of_row

    !> Make `scale` the coordinate of a dataset along a dimension: 0, the one that grows, or 1, along the rows.
    subroutine attach_scale(dataset, scale, side, h5) bind(c, name='dst_h5_attach_scale')
      import :: c_int, dataset_t, hdf5_t
      type(dataset_t), intent(in) :: dataset, scale
      integer(c_int), value :: side
      type(hdf5_t), intent(inout) :: h5
    end subroutine attach_scale
  end interface

contains

  !> Open a file for reading; or create one, in place of one that has the name.
  subroutine open_file(file_name, creates, file, h5)
    character(*), intent(in) :: file_name
    logical, intent(in) :: creates
    integer(hid_t), intent(out) :: file
    type(hdf5_t), intent(inout) :: h5

    file = c_open(file_name//nul, logical(creates, c_bool), h5)
  end subroutine open_file

  !> Why the last HDF5 call failed: the operating system's message if there is one.
  function failure_reason() result(reason)
    character(:), allocatable :: reason
    character(*), parameter :: system_words = "error message = '"
    integer :: first

    reason = fortran_text(c_failure())
    first = index(reason, system_words)
    if (first > 0) then
      reason = reason(first + len(system_words):)
      reason = reason(:scan(reason//"'", "'") - 1)
    end if
    if (reason == '') reason = 'HDF5 gave no reason'
  end function failure_reason

  !> Why an existing file could not be read, and what to do.
  function damage_reason() result(reason)
    character(:), allocatable :: reason

    reason = with_remedy(failure_reason())
    if (reason == failure_reason()) reason = 'the file is damaged ('//reason//'): run the deck again'
  end function damage_reason

  subroutine put_text_attribute(object, name, text, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, text
    type(hdf5_t), intent(inout) :: h5

    call c_put(object, name//nul, .true._c_bool, as_text, text//nul, 0.0_c_double, h5)
  end subroutine put_text_attribute

  subroutine put_integer_attribute(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(in) :: number
    type(hdf5_t), intent(inout) :: h5

    call c_put(object, name//nul, .true._c_bool, as_int32, nul, real(number, c_double), h5)
  end subroutine put_integer_attribute

  subroutine put_text(group, quantity, text, h5)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    character(*), intent(in) :: text
    type(hdf5_t), intent(inout) :: h5

    call c_put(group, words_of(quantity), .false._c_bool, as_text, text//nul, 0.0_c_double, h5)
  end subroutine put_text

  !> A counter is stored as an integer.
  subroutine put_number(group, quantity, number, h5)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    real(wp), intent(in) :: number
    type(hdf5_t), intent(inout) :: h5

    call c_put(group, words_of(quantity), .false._c_bool, merge(as_int64, as_double, quantity%counts), nul, &
      real(number, c_double), h5)
  end subroutine put_number

  !> A name, its unit and its meaning, as C takes them.
  pure function words_of(quantity) result(words)
    type(quantity_t), intent(in) :: quantity
    character(:), allocatable :: words

    words = trim(quantity%name)//nul//trim(quantity%units)//nul//trim(quantity%long_name)//nul
  end function words_of

  subroutine get_text(object, name, text, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    type(hdf5_t), intent(inout) :: h5
    real(c_double) :: none

    text = fortran_text(c_get(object, name//nul, as_text, none, h5))
  end subroutine get_text

  subroutine get_integer(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(out) :: number
    type(hdf5_t), intent(inout) :: h5
    real(wp) :: value

    call get_number(object, name, value, h5)
    number = nint(value)
  end subroutine get_integer

  subroutine get_number(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    real(wp), intent(out) :: number
    type(hdf5_t), intent(inout) :: h5
    real(c_double) :: value
    type(c_ptr) :: none

    value = 0.0_c_double
    none = c_get(object, name//nul, as_double, value, h5)
    number = real(value, wp)
  end subroutine get_number

  !> Whether a file has this column.
  logical function has_column(file, name)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: name
    type(dataset_t) :: column
    type(hdf5_t) :: h5

    call open_dataset(file, name, column, h5)
    has_column = h5%status >= 0
  end function has_column

  !> Create a column with the rows of its dataset, which are its `fill`, in chunks of `chunk_rows`, and the groups on its path.
  !> `is_scale`: it is a coordinate of others.
  subroutine create_column(file, column, chunk_rows, is_scale, h5)
    integer(hid_t), intent(in) :: file
    type(column_t), intent(inout) :: column
    integer, intent(in) :: chunk_rows
    logical, intent(in) :: is_scale
    type(hdf5_t), intent(inout) :: h5

    call c_create_dataset(file, trim(column%group)//'/'//words_of(column%quantity), column%stored_as, int(chunk_rows, hsize_t), &
      logical(is_scale, c_bool), column%fill, column%dataset, h5)
  end subroutine create_column

  !> Open an existing column, with all its rows; each has `row_length` numbers if that is present and not 0.
  subroutine open_dataset(group, name, dataset, h5, row_length)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    type(dataset_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer, intent(in), optional :: row_length

    if (present(row_length)) dataset%row_length = row_length
    call c_open_dataset(group, name//nul, dataset, h5)
  end subroutine open_dataset

  !> Append a row to a column of texts.
  subroutine append_text(dataset, text, h5)
    type(dataset_t), intent(inout) :: dataset
    character(*), intent(in) :: text
    type(hdf5_t), intent(inout) :: h5

    call c_append_text(dataset, text//nul, h5)
  end subroutine append_text

  !> A row of a column of texts. HDF5 allocates them: they are freed at the end of the process.
  function text_of_row(dataset, row, h5) result(text)
    type(dataset_t), intent(in) :: dataset
    integer, intent(in) :: row                   !! counted from 1
    type(hdf5_t), intent(inout) :: h5
    character(:), allocatable :: text

    text = fortran_text(c_text_of_row(dataset, row - 1_hsize_t, h5))
  end function text_of_row
end module dst_hdf5_tools
