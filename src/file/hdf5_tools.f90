!> The operations of HDF5 that this program needs: attributes, described datasets, datasets that grow, dimension scales.
!>
!> The last argument of every procedure is an `hdf5_t`, which records whether a call has failed. After the first failure HDF5 is not
!> called any more, so that a sequence of calls is checked once, at its end, and `failure_reason` then gives the reason of the first
!> failure. Every statement is guarded by `if (h5%status >= 0)`; objects that remain open after a failure are closed with the file.
!> Text is variable-length UTF-8. Sources: HDF5 1.10 reference manual; HDF5 Dimension Scale Specification.
module dst_hdf5_tools
  use, intrinsic :: iso_c_binding, only: c_ptr, c_funptr, c_int, c_int64_t, c_char, c_null_char, c_null_ptr, c_loc, &
    c_funloc, c_f_pointer
  use hdf5, only: hid_t, hsize_t, size_t, h5open_f, h5dont_atexit_f, h5eset_auto_f, h5fcreate_f, h5fopen_f, h5iget_file_id_f, &
    h5idec_ref_f, h5fget_filesize_f, h5pset_fclose_degree_f, h5p_file_access_f, h5f_close_strong_f, h5f_acc_excl_f, &
    h5f_acc_rdonly_f, h5pset_libver_bounds_f, h5f_libver_v18_f, &
    h5tcopy_f, h5tset_cset_f, h5tis_variable_str_f, h5tget_class_f, h5tget_size_f, h5t_string, h5t_cset_utf8_f, &
    h5t_native_double, h5t_native_integer, h5t_std_i32le, h5t_ieee_f64le, h5t_integer_f, h5t_float_f, h5t_string_f, &
    h5screate_f, h5screate_simple_f, h5sselect_hyperslab_f, h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, &
    h5sget_simple_extent_npoints_f, h5s_scalar_f, h5s_unlimited_f, h5s_select_set_f, &
    h5aexists_f, h5acreate_f, h5aopen_f, h5awrite_f, h5aread_f, h5aget_type_f, h5aget_space_f, &
    h5dcreate_f, h5dopen_f, h5dget_type_f, h5dread_f, h5dwrite_f, h5dset_extent_f, h5dget_space_f, h5dget_create_plist_f, &
    h5dget_storage_size_f, h5d_virtual_f, h5gcreate_f, h5gget_info_f, &
    h5lexists_f, h5ldelete_f, h5lget_info_f, h5lget_name_by_idx_f, h5l_type_hard_f, h5_index_name_f, h5_iter_inc_f, &
    h5pcreate_f, h5pset_chunk_f, h5pset_chunk_cache_f, h5pset_buffer_f, h5pset_fletcher32_f, h5pget_layout_f, h5pget_nfilters_f, &
    h5pget_filter_f, h5pget_external_count_f, h5z_filter_shuffle_f, h5z_filter_fletcher32_f, h5p_dataset_create_f, &
    h5p_dataset_access_f, h5p_dataset_xfer_f
  use h5ds, only: h5dsset_scale_f, h5dsattach_scale_f
  use dst_kinds, only: wp, real64
  use dst_disk, only: path_t, wait_seconds, with_remedy
  use dst_posix, only: fortran_text, ignore_size_limit_signal
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: hdf5_t, start_hdf5, open_file, open_existing, failure_reason, damage_reason, file_descriptor
  public :: put_attribute, get_attribute, put_value, get_text, create_group, delete_link, release
  public :: dataset_t, create_dataset, open_dataset, append, append_texts, cut, read_rows, make_scale, attach_scale
  public :: names_in, read_list, get_number

  !> The status of a sequence of calls.
  type :: hdf5_t
    integer :: status = 0                  !! negative after a failure
    character(:), allocatable :: refusal   !! an object that was refused although HDF5 could read it, and why
  contains
    procedure, private :: refuse
  end type hdf5_t

  !> Room [bytes] to convert one value.
  integer(hsize_t), parameter :: conversion_buffer = 64

  !> A dataset that grows: one number or text in each row, or rows of `row_length` numbers.
  type :: dataset_t
    integer(hid_t) :: id = -1
    integer(hsize_t) :: rows = 0
    integer(hsize_t) :: row_length = 0     !! 0: it has one dimension
  end type dataset_t

  !> Create or overwrite an attribute of a file, group or dataset.
  interface put_attribute
    module procedure put_text_attribute, put_integer_attribute
  end interface put_attribute

  !> Read an attribute.
  interface get_attribute
    module procedure get_text_attribute, get_integer_attribute
  end interface get_attribute

  !> Create a scalar dataset.
  interface put_value
    module procedure put_text, put_number
  end interface put_value

  !> One entry of HDF5's error stack (H5E_error2_t).
  type, bind(c) :: stack_entry_t
    integer(c_int64_t) :: class, major, minor
    integer(c_int) :: line
    type(c_ptr) :: procedure_name, source_file, description
  end type stack_entry_t

  interface
    integer(c_int) function h5ewalk(stack, direction, visit, user_data) bind(c, name='H5Ewalk2')
      import :: c_int, c_int64_t, c_funptr, c_ptr
      integer(c_int64_t), value :: stack
      integer(c_int), value :: direction
      type(c_funptr), value :: visit
      type(c_ptr), value :: user_data
    end function h5ewalk

    integer(c_int) function h5fget_vfd_handle(file, access, handle) bind(c, name='H5Fget_vfd_handle')
      import :: c_int, c_int64_t, c_ptr
      integer(c_int64_t), value :: file, access
      type(c_ptr), intent(out) :: handle
    end function h5fget_vfd_handle
  end interface

contains

  !> Initialise HDF5: no messages on errors, no signal at a limit of file sizes, and without its clean-up at exit, which loops
  !> forever if the disk is full.
  subroutine start_hdf5(h5)
    type(hdf5_t), intent(out) :: h5
    integer :: ignored

    call ignore_size_limit_signal()
    call h5dont_atexit_f(ignored)
    call h5open_f(h5%status)
    if (h5%status >= 0) call h5eset_auto_f(0, h5%status)
  end subroutine start_hdf5

  !> Create a file that does not exist, or open one; its objects are closed with it.
  subroutine open_file(file_name, mode, file, h5)
    character(*), intent(in) :: file_name
    integer, intent(in) :: mode
    integer(hid_t), intent(out) :: file
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: access

    file = -1
    if (h5%status >= 0) call h5pcreate_f(h5p_file_access_f, access, h5%status)
    if (h5%status >= 0) call h5pset_fclose_degree_f(access, h5f_close_strong_f, h5%status)
    ! The oldest format with checksums of the metadata. A file of a newer one would have to be released with h5clear after a kill.
    if (h5%status >= 0) call h5pset_libver_bounds_f(access, h5f_libver_v18_f, h5f_libver_v18_f, h5%status)
    if (h5%status >= 0) then
      if (mode == h5f_acc_excl_f) then
        call h5fcreate_f(file_name, mode, file, h5%status, access_prp=access)
      else
        call h5fopen_f(file_name, mode, file, h5%status, access_prp=access)
      end if
    end if
    call release([access], h5)
  end subroutine open_file

  !> Open a file for reading. A run that was just killed may still be finishing a flush, and lock the file for that moment.
  subroutine open_existing(file_name, file, h5)
    character(*), intent(in) :: file_name
    integer(hid_t), intent(out) :: file
    type(hdf5_t), intent(out) :: h5
    integer, parameter :: most_tries = 10
    integer :: i

    do i = 1, most_tries
      call start_hdf5(h5)
      call open_file(file_name, h5f_acc_rdonly_f, file, h5)
      if (h5%status >= 0) return
      if (index(failure_reason(), 'temporarily unavailable') == 0) return
      call wait_seconds(0.05_wp)
    end do
  end subroutine open_existing

  !> Close objects of any kind.
  subroutine release(objects, h5)
    integer(hid_t), intent(in) :: objects(:)
    type(hdf5_t), intent(inout) :: h5
    integer :: i, references

    do i = 1, size(objects)
      if (h5%status >= 0) call h5idec_ref_f(objects(i), references, h5%status)
    end do
  end subroutine release

  !> Why the last HDF5 call failed: the operating system's message if there is one.
  function failure_reason() result(reason)
    character(:), allocatable :: reason
    character(*), parameter :: system_words = "error message = '"
    integer(c_int64_t), parameter :: current_stack = 0
    integer(c_int), parameter :: innermost_first = 0
    type(c_ptr), target :: description
    integer(c_int) :: ignored
    integer :: first

    description = c_null_ptr
    ignored = h5ewalk(current_stack, innermost_first, c_funloc(keep_first_description), c_loc(description))
    reason = fortran_text(description)
    first = index(reason, system_words)
    if (first > 0) then
      reason = reason(first + len(system_words):)
      reason = reason(:scan(reason//"'", "'") - 1)
    end if
    if (reason == '') reason = 'HDF5 gave no reason'
  end function failure_reason

  integer(c_int) function keep_first_description(depth, entry_address, user_data) bind(c) result(status)
    integer(c_int), value :: depth
    type(c_ptr), value :: entry_address, user_data
    type(stack_entry_t), pointer :: entry
    type(c_ptr), pointer :: description

    status = 0
    if (depth > 0) return
    call c_f_pointer(entry_address, entry)
    call c_f_pointer(user_data, description)
    description = entry%description
  end function keep_first_description

  !> Why an existing file could not be read, and what to do; a refusal says more than HDF5 does.
  function damage_reason(h5) result(reason)
    type(hdf5_t), intent(in) :: h5
    character(:), allocatable :: reason

    if (allocated(h5%refusal)) then
      reason = h5%refusal//', as in no file of this program: do not trust the file, run the deck again'
      return
    end if
    reason = with_remedy(failure_reason())
    if (reason == failure_reason()) reason = 'the file is damaged ('//reason//'): run the deck again'
  end function damage_reason

  !> Treat an object of a file as damaged although HDF5 could read it.
  subroutine refuse(self, name, why)
    class(hdf5_t), intent(inout) :: self
    character(*), intent(in) :: name, why

    self%status = -1
    self%refusal = "'"//name//"' "//why
  end subroutine refuse

  !> The operating system's descriptor of an open file.
  subroutine file_descriptor(file, descriptor, h5)
    integer(hid_t), intent(in) :: file
    integer(c_int), intent(out) :: descriptor
    type(hdf5_t), intent(inout) :: h5
    integer(c_int64_t), parameter :: default_access = 0
    integer(c_int), pointer :: value
    type(c_ptr) :: handle

    descriptor = -1
    if (h5%status >= 0) h5%status = h5fget_vfd_handle(int(file, c_int64_t), default_access, handle)
    if (h5%status < 0) return
    call c_f_pointer(handle, value)
    descriptor = value
  end subroutine file_descriptor

  subroutine put_text_attribute(object, name, text, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, text
    type(hdf5_t), intent(inout) :: h5
    character(c_char), target :: bytes(len(text) + 1)
    type(c_ptr), target :: address
    integer(hid_t) :: text_type

    bytes = c_bytes(text)
    address = c_loc(bytes)
    call create_text_type(text_type, h5)
    call write_attribute(object, name, text_type, text_type, c_loc(address), h5)
    call release([text_type], h5)
  end subroutine put_text_attribute

  subroutine put_integer_attribute(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(in), target :: number
    type(hdf5_t), intent(inout) :: h5

    call write_attribute(object, name, h5t_std_i32le, h5t_native_integer, c_loc(number), h5)
  end subroutine put_integer_attribute

  !> Write an attribute's value, and create the attribute if it does not exist.
  subroutine write_attribute(object, name, stored_as, memory_type, value, h5)
    integer(hid_t), intent(in) :: object, stored_as, memory_type
    character(*), intent(in) :: name
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: space, attribute
    logical :: there

    if (h5%status >= 0) call h5aexists_f(object, name, there, h5%status)
    if (h5%status < 0) return
    if (there) then
      call h5aopen_f(object, name, attribute, h5%status)
    else
      call h5screate_f(h5s_scalar_f, space, h5%status)
      if (h5%status >= 0) call h5acreate_f(object, name, stored_as, space, attribute, h5%status)
      call release([space], h5)
    end if
    if (h5%status >= 0) call h5awrite_f(attribute, memory_type, value, h5%status)
    call release([attribute], h5)
  end subroutine write_attribute

  !> HDF5 allocates the text that is read, a few times for each file: it is freed at the end of the process.
  subroutine get_text_attribute(object, name, text, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    type(hdf5_t), intent(inout) :: h5
    type(c_ptr), target :: address

    address = c_null_ptr
    call read_attribute(object, name, h5t_string_f, 'is no text', c_loc(address), h5)
    text = fortran_text(address)
  end subroutine get_text_attribute

  subroutine get_integer_attribute(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(out), target :: number
    type(hdf5_t), intent(inout) :: h5

    number = 0
    call read_attribute(object, name, h5t_integer_f, 'is no integer', c_loc(number), h5)
  end subroutine get_integer_attribute

  !> Read an attribute that has one value of a class of types: the address of a text, or an integer.
  subroutine read_attribute(object, name, class, otherwise, value, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, otherwise
    integer, intent(in) :: class
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    type(c_ptr) :: buffer
    integer(hid_t) :: attribute, stored_as, space

    buffer = value
    if (h5%status >= 0) call h5aopen_f(object, name, attribute, h5%status)
    if (h5%status >= 0) call h5aget_type_f(attribute, stored_as, h5%status)
    if (h5%status >= 0) call h5aget_space_f(attribute, space, h5%status)
    call check_single(name, space, stored_as, class, otherwise, h5)
    if (h5%status >= 0) call h5aread_f(attribute, merge(stored_as, h5t_native_integer, class == h5t_string_f), buffer, h5%status)
    call release([attribute, stored_as], h5)
  end subroutine read_attribute

  !> Refuse a value of another class of types, or several values, for which there is no room. Texts must be given by their address.
  subroutine check_single(name, space, stored_as, class, otherwise, h5)
    character(*), intent(in) :: name, otherwise
    integer(hid_t), intent(in) :: space, stored_as
    integer, intent(in) :: class
    type(hdf5_t), intent(inout) :: h5
    integer(hsize_t) :: points
    integer :: found
    logical :: is_right

    found = class
    if (h5%status >= 0) call h5tget_class_f(stored_as, found, h5%status)
    is_right = found == class
    if (h5%status >= 0 .and. class == h5t_string_f .and. is_right) call h5tis_variable_str_f(stored_as, is_right, h5%status)
    if (h5%status >= 0 .and. .not. is_right) call h5%refuse(name, otherwise)
    if (h5%status >= 0) call h5sget_simple_extent_npoints_f(space, points, h5%status)
    if (h5%status >= 0 .and. points /= 1) call h5%refuse(name, 'is not a single value')
    call release([space], h5)
  end subroutine check_single

  subroutine put_text(group, quantity, text, h5)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    character(*), intent(in) :: text
    type(hdf5_t), intent(inout) :: h5
    character(c_char), target :: bytes(len(text) + 1)
    type(c_ptr), target :: address
    integer(hid_t) :: text_type

    bytes = c_bytes(text)
    address = c_loc(bytes)
    call create_text_type(text_type, h5)
    call write_scalar(group, quantity, text_type, text_type, c_loc(address), h5)
    call release([text_type], h5)
  end subroutine put_text

  !> Stored as a double, or as `stored_as`.
  subroutine put_number(group, quantity, number, h5, stored_as)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    real(wp), intent(in) :: number
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t), intent(in), optional :: stored_as
    integer(hid_t) :: file_type
    real(real64), target :: value

    file_type = h5t_ieee_f64le
    if (present(stored_as)) file_type = stored_as
    value = real(number, real64)
    call write_scalar(group, quantity, file_type, h5t_native_double, c_loc(value), h5)
  end subroutine put_number

  subroutine write_scalar(group, quantity, stored_as, memory_type, value, h5)
    integer(hid_t), intent(in) :: group, stored_as, memory_type
    type(quantity_t), intent(in) :: quantity
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: space, dataset, transfer

    if (h5%status >= 0) call h5screate_f(h5s_scalar_f, space, h5%status)
    if (h5%status >= 0) call h5dcreate_f(group, trim(quantity%name), stored_as, space, dataset, h5%status)
    ! For the conversion of each value HDF5 would clear a buffer of 1 MB: this is a tenth of the work of a run of one second.
    if (h5%status >= 0) call h5pcreate_f(h5p_dataset_xfer_f, transfer, h5%status)
    if (h5%status >= 0) call h5pset_buffer_f(transfer, conversion_buffer, h5%status)
    if (h5%status >= 0) call h5dwrite_f(dataset, memory_type, value, h5%status, xfer_prp=transfer)
    call describe(dataset, quantity, h5)
    call release([dataset, space, transfer], h5)
  end subroutine write_scalar

  !> The attributes that every dataset has.
  subroutine describe(dataset, quantity, h5)
    integer(hid_t), intent(in) :: dataset
    type(quantity_t), intent(in) :: quantity
    type(hdf5_t), intent(inout) :: h5

    call put_attribute(dataset, 'units', trim(quantity%units), h5)
    call put_attribute(dataset, 'long_name', trim(quantity%long_name), h5)
  end subroutine describe

  !> Read a scalar dataset of text.
  subroutine get_text(object, name, text, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    type(hdf5_t), intent(inout) :: h5
    type(c_ptr), target :: address
    type(c_ptr) :: buffer
    integer(hid_t) :: dataset, text_type, space

    address = c_null_ptr
    buffer = c_loc(address)
    call open_own(object, name, dataset, h5)
    if (h5%status >= 0) call h5dget_space_f(dataset, space, h5%status)
    if (h5%status >= 0) call h5dget_type_f(dataset, text_type, h5%status)
    call check_single(name, space, text_type, h5t_string_f, 'is no text', h5)
    call check_size(name, dataset, 1_hsize_t, h5)
    if (h5%status >= 0) call h5dread_f(dataset, text_type, buffer, h5%status)
    call release([text_type, dataset], h5)
    text = fortran_text(address)
  end subroutine get_text

  !> Read a scalar dataset that holds a real number.
  subroutine get_number(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    real(wp), intent(out) :: number
    type(hdf5_t), intent(inout) :: h5
    real(real64), target :: stored
    type(c_ptr) :: buffer
    integer(hid_t) :: dataset, number_type, space

    stored = 0.0_real64
    buffer = c_loc(stored)
    call open_own(object, name, dataset, h5)
    if (h5%status >= 0) call h5dget_space_f(dataset, space, h5%status)
    if (h5%status >= 0) call h5dget_type_f(dataset, number_type, h5%status)
    call check_single(name, space, number_type, h5t_float_f, 'is no real number', h5)
    call check_size(name, dataset, 1_hsize_t, h5)
    if (h5%status >= 0) call h5dread_f(dataset, h5t_native_double, buffer, h5%status)
    call release([number_type, dataset], h5)
    number = real(stored, wp)
  end subroutine get_number

  !> Create a group and open it.
  subroutine create_group(parent, name, group, h5)
    integer(hid_t), intent(in) :: parent
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: group
    type(hdf5_t), intent(inout) :: h5

    group = -1
    if (h5%status >= 0) call h5gcreate_f(parent, name, group, h5%status)
  end subroutine create_group

  !> Remove a group or dataset, if it exists.
  subroutine delete_link(parent, name, h5)
    integer(hid_t), intent(in) :: parent
    character(*), intent(in) :: name
    type(hdf5_t), intent(inout) :: h5
    logical :: there

    if (h5%status >= 0) call h5lexists_f(parent, name, there, h5%status)
    if (h5%status < 0) return
    if (there) call h5ldelete_f(parent, name, h5%status)
  end subroutine delete_link

  !> Create an empty dataset of texts, or of numbers stored as `stored_as`, in chunks of `chunk_rows`. For columns of numbers the
  !> cache has room for one chunk, or for none if `whole_chunks` are appended. Each chunk of numbers has a checksum, by which damage
  !> is found when the chunk is read.
  subroutine create_dataset(group, quantity, chunk_rows, dataset, h5, stored_as, row_length, whole_chunks)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    integer, intent(in) :: chunk_rows
    type(dataset_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t), intent(in), optional :: stored_as
    integer, intent(in), optional :: row_length
    logical, intent(in), optional :: whole_chunks
    integer(hsize_t), parameter :: longest_chunk = 16384   ! values of a row
    integer(hid_t) :: space, creation, access, file_type
    integer(hsize_t) :: chunk(2)
    integer :: rank, cached_rows

    if (present(row_length)) dataset%row_length = row_length
    rank = size(extent(dataset, 0_hsize_t))
    chunk(:rank) = extent(dataset, int(chunk_rows, hsize_t))
    if (rank > 1) chunk(1) = min(chunk(1), longest_chunk)
    cached_rows = chunk_rows
    if (present(whole_chunks)) cached_rows = merge(0, chunk_rows, whole_chunks)
    if (h5%status >= 0) &
      call h5screate_simple_f(rank, extent(dataset, 0_hsize_t), space, h5%status, extent(dataset, h5s_unlimited_f))
    if (h5%status >= 0) call h5pcreate_f(h5p_dataset_create_f, creation, h5%status)
    if (h5%status >= 0) call h5pset_chunk_f(creation, rank, chunk, h5%status)
    if (h5%status >= 0 .and. present(stored_as)) call h5pset_fletcher32_f(creation, h5%status)
    call create_access(merge(cached_rows, -1, present(stored_as) .and. rank == 1), access, h5)
    if (present(stored_as)) then
      file_type = stored_as
    else
      call create_text_type(file_type, h5)
    end if
    if (h5%status >= 0) &
      call h5dcreate_f(group, trim(quantity%name), file_type, space, dataset%id, h5%status, creation, dapl_id=access)
    call release([space, creation, access], h5)
    if (.not. present(stored_as)) call release([file_type], h5)
    call describe(dataset%id, quantity, h5)
  end subroutine create_dataset

  !> The dimensions of a dataset with this number of rows.
  pure function extent(dataset, rows) result(sides)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: rows
    integer(hsize_t) :: sides(merge(2, 1, dataset%row_length > 0))

    sides(1) = dataset%row_length
    sides(size(sides)) = rows
  end function extent

  !> The properties with which a dataset is opened: its cache has room for this many rows; negative: HDF5's default.
  subroutine create_access(cached_rows, access, h5)
    integer, intent(in) :: cached_rows
    integer(hid_t), intent(out) :: access
    type(hdf5_t), intent(inout) :: h5
    integer(size_t), parameter :: slots = 7

    if (h5%status >= 0) call h5pcreate_f(h5p_dataset_access_f, access, h5%status)
    if (h5%status >= 0 .and. cached_rows >= 0) &
      call h5pset_chunk_cache_f(access, slots, int(8*cached_rows, size_t), 1.0, h5%status)
  end subroutine create_access

  !> Open an existing column of numbers, with all its rows.
  subroutine open_dataset(group, name, chunk_rows, dataset, h5)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    integer, intent(in) :: chunk_rows
    type(dataset_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: access, space
    integer(hsize_t) :: rows(1), largest(1)
    integer :: rank

    call create_access(chunk_rows, access, h5)
    call open_own(group, name, dataset%id, h5, access)
    if (h5%status >= 0) call h5dget_space_f(dataset%id, space, h5%status)
    if (h5%status >= 0) call h5sget_simple_extent_ndims_f(space, rank, h5%status)
    if (h5%status >= 0 .and. rank /= 1) call h5%refuse(name, 'is no list')
    if (h5%status >= 0) call h5sget_simple_extent_dims_f(space, rows, largest, h5%status)
    if (h5%status >= 0) dataset%rows = rows(1)
    call release([access, space], h5)
  end subroutine open_dataset

  !> Open a dataset whose data are directly in the file: reached by hard links only, not in another file, not composed of other
  !> datasets, not compressed.
  subroutine open_own(object, name, dataset, h5, access)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t), intent(in), optional :: access
    integer(hid_t) :: creation
    integer :: layout, externals

    dataset = -1
    call check_links(object, name, h5)
    if (h5%status >= 0) call h5dopen_f(object, name, dataset, h5%status, access)
    if (h5%status >= 0) call h5dget_create_plist_f(dataset, creation, h5%status)
    if (h5%status >= 0) call h5pget_layout_f(creation, layout, h5%status)
    ! A query of the extent of a virtual dataset would open its sources.
    if (h5%status >= 0 .and. layout == h5d_virtual_f) call h5%refuse(name, 'is made of other datasets')
    if (h5%status >= 0) call h5pget_external_count_f(creation, externals, h5%status)
    if (h5%status >= 0 .and. externals > 0) call h5%refuse(name, 'has its data in another file')
    call check_filters(name, creation, h5)
    call release([creation], h5)
  end subroutine open_own

  !> Refuse a path that contains a link of another kind.
  subroutine check_links(object, name, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    type(hdf5_t), intent(inout) :: h5
    integer(hsize_t) :: address
    integer(size_t) :: length
    integer :: last, character_set, order, kind
    logical :: is_ordered

    last = 0
    do while (last <= len(name) .and. h5%status >= 0)
      last = last + index(name(last + 1:)//'/', '/')
      associate (part => name(:last - 1))
        call h5lget_info_f(object, part, character_set, order, is_ordered, kind, address, length, h5%status)
        if (h5%status >= 0 .and. kind /= h5l_type_hard_f) call h5%refuse(part, 'is a link')
      end associate
    end do
  end subroutine check_links

  !> Refuse a compressed dataset: a few bytes could fill the memory, or a filter could be code from a plugin.
  subroutine check_filters(name, creation, h5)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: creation
    type(hdf5_t), intent(inout) :: h5
    integer(size_t) :: parameters
    integer :: i, n, flags, values(8), filter
    character(32) :: filter_name

    n = 0
    if (h5%status >= 0) call h5pget_nfilters_f(creation, n, h5%status)
    do i = 0, n - 1
      parameters = size(values)
      if (h5%status >= 0) call h5pget_filter_f(creation, i, flags, parameters, values, len(filter_name, size_t), filter_name, &
        filter, h5%status)
      if (h5%status >= 0 .and. filter /= h5z_filter_shuffle_f .and. filter /= h5z_filter_fletcher32_f) &
        call h5%refuse(name, 'is compressed (h5repack -f NONE undoes that)')
    end do
  end subroutine check_filters

  !> Refuse a dataset that claims more values than it has, or more than fit into the file.
  subroutine check_size(name, dataset, points, h5)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: points   !! number of values claimed
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: file, stored_as
    integer(hsize_t) :: stored
    integer(size_t) :: value_bytes, file_bytes
    integer :: no_storage

    if (h5%status >= 0) call h5iget_file_id_f(dataset, file, h5%status)
    if (h5%status >= 0) call h5fget_filesize_f(file, file_bytes, h5%status)
    if (h5%status >= 0) call h5dget_type_f(dataset, stored_as, h5%status)
    if (h5%status >= 0) call h5tget_size_f(stored_as, value_bytes, h5%status)
    if (h5%status < 0) return
    call h5dget_storage_size_f(dataset, stored, no_storage)
    if (no_storage < 0) stored = 0
    call release([stored_as, file], h5)
    if (points > min(stored, int(file_bytes, hsize_t))/value_bytes) call h5%refuse(name, 'claims more than it has')
  end subroutine check_size

  !> Append rows of numbers, one after the other in `values`.
  subroutine append(dataset, rows, values, h5)
    type(dataset_t), intent(inout) :: dataset
    integer, intent(in) :: rows
    real(real64), intent(in), target :: values(*)
    type(hdf5_t), intent(inout) :: h5

    if (rows > 0) call append_rows(dataset, rows, h5t_native_double, c_loc(values(1)), h5)
  end subroutine append

  !> Append texts, one in each row.
  subroutine append_texts(dataset, texts, h5)
    type(dataset_t), intent(inout) :: dataset
    type(path_t), intent(in) :: texts(:)
    type(hdf5_t), intent(inout) :: h5
    character(c_char), allocatable, target :: bytes(:)
    type(c_ptr), allocatable, target :: addresses(:)
    integer(hid_t) :: text_type
    integer :: i, first, length

    if (size(texts) == 0) return
    allocate (bytes(sum([(len(texts(i)%text) + 1, i=1, size(texts))])), addresses(size(texts)))
    first = 1
    do i = 1, size(texts)
      length = len(texts(i)%text) + 1
      bytes(first:first + length - 1) = c_bytes(texts(i)%text)
      addresses(i) = c_loc(bytes(first))
      first = first + length
    end do
    call create_text_type(text_type, h5)
    call append_rows(dataset, size(texts), text_type, c_loc(addresses), h5)
    call release([text_type], h5)
  end subroutine append_texts

  !> Append rows that begin at `values`.
  subroutine append_rows(dataset, rows, memory_type, values, h5)
    type(dataset_t), intent(inout) :: dataset
    integer, intent(in) :: rows
    integer(hid_t), intent(in) :: memory_type
    type(c_ptr), intent(in) :: values
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: rows_in_file, rows_in_memory

    if (h5%status >= 0) call h5dset_extent_f(dataset%id, extent(dataset, dataset%rows + rows), h5%status)
    call select_rows(dataset, dataset%rows, int(rows, hsize_t), rows_in_file, rows_in_memory, h5)
    if (h5%status >= 0) call h5dwrite_f(dataset%id, memory_type, values, h5%status, rows_in_memory, rows_in_file)
    call release([rows_in_memory, rows_in_file], h5)
    if (h5%status >= 0) dataset%rows = dataset%rows + rows
  end subroutine append_rows

  !> The rows of a dataset after its first `first` ones, in the file and in memory.
  subroutine select_rows(dataset, first, rows, rows_in_file, rows_in_memory, h5)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: first, rows
    integer(hid_t), intent(out) :: rows_in_file, rows_in_memory
    type(hdf5_t), intent(inout) :: h5
    integer(hsize_t) :: from(2)
    integer :: rank

    rank = size(extent(dataset, rows))
    from = 0
    from(rank) = first
    if (h5%status >= 0) call h5dget_space_f(dataset%id, rows_in_file, h5%status)
    if (h5%status >= 0) &
      call h5sselect_hyperslab_f(rows_in_file, h5s_select_set_f, from(:rank), extent(dataset, rows), h5%status)
    if (h5%status >= 0) call h5screate_simple_f(rank, extent(dataset, rows), rows_in_memory, h5%status)
  end subroutine select_rows

  !> Read the numbers of a column after its first `first` rows.
  subroutine read_rows(dataset, first, values, h5)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: first
    real(real64), intent(out), contiguous, target :: values(:)
    type(hdf5_t), intent(inout) :: h5
    type(c_ptr) :: buffer
    integer(hid_t) :: rows_in_file, rows_in_memory

    if (size(values) == 0) return
    buffer = c_loc(values(1))
    call select_rows(dataset, first, size(values, kind=hsize_t), rows_in_file, rows_in_memory, h5)
    if (h5%status >= 0) call h5dread_f(dataset%id, h5t_native_double, buffer, h5%status, rows_in_memory, rows_in_file)
    call release([rows_in_memory, rows_in_file], h5)
  end subroutine read_rows

  !> Drop the rows of a column after the first `rows`.
  subroutine cut(dataset, rows, h5)
    type(dataset_t), intent(inout) :: dataset
    integer(hsize_t), intent(in) :: rows
    type(hdf5_t), intent(inout) :: h5

    dataset%rows = min(dataset%rows, rows)
    if (h5%status >= 0) call h5dset_extent_f(dataset%id, [dataset%rows], h5%status)
  end subroutine cut

  !> Make a column a dimension scale.
  subroutine make_scale(dataset, name, h5)
    type(dataset_t), intent(in) :: dataset
    character(*), intent(in) :: name
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) call h5dsset_scale_f(dataset%id, h5%status, name)
  end subroutine make_scale

  !> Make `scale` the coordinate of a dataset along a dimension: 1, the one that grows, or 2, along the rows. HDF5 counts from 1,
  !> but in C's order.
  subroutine attach_scale(dataset, scale, side, h5)
    type(dataset_t), intent(in) :: dataset, scale
    integer, intent(in) :: side
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) call h5dsattach_scale_f(dataset%id, scale%id, side, h5%status)
  end subroutine attach_scale

  !> The names of all objects in a file or group, in alphabetical order; if there are many, the first ones.
  subroutine names_in(group, names, h5)
    integer(hid_t), intent(in) :: group
    type(path_t), allocatable, intent(out) :: names(:)
    type(hdf5_t), intent(inout) :: h5
    integer, parameter :: most_names = 1000
    character(256) :: name
    integer(hsize_t) :: i
    integer :: storage, count, order

    count = 0
    if (h5%status >= 0) call h5gget_info_f(group, storage, count, order, h5%status)
    count = min(count, most_names)
    allocate (names(count))
    do i = 1, count
      if (h5%status >= 0) &
        call h5lget_name_by_idx_f(group, '.', h5_index_name_f, h5_iter_inc_f, i - 1_hsize_t, name, h5%status)
      names(i)%text = trim(name)
    end do
  end subroutine names_in

  !> All values of a one-dimensional dataset of numbers.
  subroutine read_list(group, name, values, h5)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    real(wp), allocatable, intent(out) :: values(:)
    type(hdf5_t), intent(inout) :: h5
    type(dataset_t) :: dataset
    real(real64), allocatable :: read(:)
    integer(hid_t) :: stored_as
    integer :: class

    call open_dataset(group, name, 1, dataset, h5)
    call check_size(name, dataset%id, dataset%rows, h5)
    if (h5%status >= 0) call h5dget_type_f(dataset%id, stored_as, h5%status)
    if (h5%status >= 0) call h5tget_class_f(stored_as, class, h5%status)
    if (h5%status >= 0 .and. class /= h5t_integer_f .and. class /= h5t_float_f) call h5%refuse(name, 'holds no numbers')
    allocate (read(merge(dataset%rows, 0_hsize_t, h5%status >= 0)))
    call read_rows(dataset, 0_hsize_t, read, h5)
    call release([stored_as, dataset%id], h5)
    values = real(read, wp)
  end subroutine read_list

  subroutine create_text_type(text_type, h5)
    integer(hid_t), intent(out) :: text_type
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) call h5tcopy_f(h5t_string, text_type, h5%status)
    if (h5%status >= 0) call h5tset_cset_f(text_type, h5t_cset_utf8_f, h5%status)
  end subroutine create_text_type

  !> Text in the form that C uses.
  pure function c_bytes(text) result(bytes)
    character(*), intent(in) :: text
    character(c_char) :: bytes(len(text) + 1)

    bytes = transfer(text//c_null_char, bytes)
  end function c_bytes
end module dst_hdf5_tools
