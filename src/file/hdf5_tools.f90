!> The few things this program asks of HDF5: attributes, described datasets, columns that grow, dimension scales.
!>
!> Every procedure's last argument is a running `status`: 0 so far, negative after a failure; a procedure called with a
!> negative status does nothing, so that a sequence of calls is checked once, at its end, by `failure_reason`.
!> Text is variable-length UTF-8. Sources: HDF5 1.10 reference manual; HDF5 Dimension Scale Specification.
module dst_hdf5_tools
  use, intrinsic :: iso_c_binding, only: c_ptr, c_funptr, c_int, c_int64_t, c_size_t, c_char, c_null_char, c_null_ptr, &
    c_associated, c_loc, c_funloc, c_f_pointer
  use hdf5, only: hid_t, hsize_t, size_t, h5open_f, h5dont_atexit_f, h5eset_auto_f, h5fcreate_f, h5fopen_f, h5fclose_f, &
    h5pset_fclose_degree_f, h5p_file_access_f, h5f_close_strong_f, h5f_acc_excl_f, h5f_acc_rdonly_f, &
    h5pset_libver_bounds_f, h5f_libver_v18_f, &
    h5tcopy_f, h5tset_cset_f, h5tclose_f, h5tis_variable_str_f, h5screate_f, h5screate_simple_f, h5sclose_f, &
    h5sselect_hyperslab_f, &
    h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, h5sget_simple_extent_npoints_f, &
    h5aexists_f, h5acreate_f, h5aopen_f, h5awrite_f, h5aread_f, &
    h5aclose_f, h5aget_type_f, h5aget_space_f, &
    h5fget_filesize_f, h5iget_file_id_f, h5lget_info_f, h5l_type_hard_f, h5dget_create_plist_f, h5dget_storage_size_f, &
    h5pget_layout_f, h5pget_nfilters_f, h5pget_filter_f, h5pget_external_count_f, h5z_filter_shuffle_f, h5z_filter_fletcher32_f, &
    h5d_virtual_f, h5tget_size_f, &
    h5dcreate_f, h5dopen_f, h5dclose_f, h5dget_type_f, h5dread_f, h5dwrite_f, h5dset_extent_f, h5dget_space_f, h5gcreate_f, &
    h5gget_info_f, h5lexists_f, h5ldelete_f, h5lget_name_by_idx_f, h5_index_name_f, h5_iter_inc_f, h5tget_class_f, &
    h5t_integer_f, h5t_float_f, &
    h5pcreate_f, h5pclose_f, h5pset_chunk_f, h5pset_chunk_cache_f, h5pset_fletcher32_f, &
    h5t_string, h5t_cset_utf8_f, h5t_native_double, h5t_native_integer, h5t_std_i32le, h5t_ieee_f64le, &
    h5s_scalar_f, h5s_unlimited_f, h5s_select_set_f, h5p_dataset_create_f, h5p_dataset_access_f
  use dst_kinds, only: wp, real64, int64
  use dst_disk, only: path_t, wait_seconds, with_remedy
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: start_hdf5, open_file, open_existing, failure_reason, damage_reason, file_descriptor
  public :: put_attribute, get_attribute, put_text, get_text, put_number
  public :: create_group, delete_link, column_t, create_column, open_column, append, cut_column, copy_rows
  public :: make_scale, attach_scale, table_t, create_table, append_rows
  public :: refusal_t, message_list_t, create_messages, append_messages, names_in, read_list

  !> A one-dimensional dataset that grows.
  type :: column_t
    integer(hid_t) :: dataset = -1
    integer(hsize_t) :: rows = 0
    integer(int64) :: checksum = 0   !! of all rows
  end type column_t

  !> A two-dimensional dataset that grows row by row.
  type :: table_t
    integer(hid_t) :: dataset = -1
    integer(hsize_t) :: rows = 0
  end type table_t

  !> A one-dimensional dataset of texts that grows.
  type :: message_list_t
    integer(hid_t) :: dataset = -1
    integer(hsize_t) :: rows = 0
  end type message_list_t

  !> Which object of a file was not read though HDF5 would read it, and why.
  type :: refusal_t
    character(:), allocatable :: reason
  end type refusal_t

  !> Create or overwrite an attribute of a file, group or dataset.
  interface put_attribute
    module procedure put_text_attribute, put_integer_attribute, put_real_attribute
  end interface put_attribute

  !> Read an attribute.
  interface get_attribute
    module procedure get_text_attribute, get_integer_attribute
  end interface get_attribute

  !> One entry of HDF5's error stack (H5E_error2_t).
  type, bind(c) :: stack_entry_t
    integer(c_int64_t) :: class, major, minor
    integer(c_int) :: line
    type(c_ptr) :: procedure_name, source_file, description
  end type stack_entry_t

  type, bind(c) :: reason_t
    integer(c_int) :: length
    character(c_char) :: text(256)
  end type reason_t

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

    integer(c_int) function h5dsset_scale(dataset, name) bind(c, name='H5DSset_scale')
      import :: c_int, c_int64_t, c_char
      integer(c_int64_t), value :: dataset
      character(c_char), intent(in) :: name(*)
    end function h5dsset_scale

    integer(c_int) function h5dsattach_scale(dataset, scale, axis) bind(c, name='H5DSattach_scale')
      import :: c_int, c_int64_t
      integer(c_int64_t), value :: dataset, scale
      integer(c_int), value :: axis
    end function h5dsattach_scale

    integer(c_size_t) function c_strlen(string) bind(c, name='strlen')
      import :: c_size_t, c_ptr
      type(c_ptr), value :: string
    end function c_strlen
  end interface

contains

  !> Make HDF5 ready: silent on errors, and without its clean-up at exit, which loops when the disk is full.
  subroutine start_hdf5(status)
    integer, intent(out) :: status
    integer :: ignored

    call h5dont_atexit_f(ignored)
    call h5open_f(status)
    if (status == 0) call h5eset_auto_f(0, status)
  end subroutine start_hdf5

  !> Create a file that is not there, or open one, whose objects close with it.
  subroutine open_file(file_name, mode, file, status)
    character(*), intent(in) :: file_name
    integer, intent(in) :: mode
    integer(hid_t), intent(out) :: file
    integer, intent(inout) :: status
    integer(hid_t) :: access

    file = -1
    if (status < 0) return
    call h5pcreate_f(h5p_file_access_f, access, status)
    if (status < 0) return
    call h5pset_fclose_degree_f(access, h5f_close_strong_f, status)
    if (status < 0) return
    ! The oldest format with checksums of what describes the data. A newer one would have to be freed by h5clear after a kill.
    call h5pset_libver_bounds_f(access, h5f_libver_v18_f, h5f_libver_v18_f, status)
    if (status < 0) return
    if (mode == h5f_acc_excl_f) then
      call h5fcreate_f(file_name, mode, file, status, access_prp=access)
    else
      call h5fopen_f(file_name, mode, file, status, access_prp=access)
    end if
    if (status < 0) return
    call h5pclose_f(access, status)
  end subroutine open_file

  !> Open a file to read it. A run that was just killed may still be finishing a flush, and lock the file for that moment.
  subroutine open_existing(file_name, file, status)
    character(*), intent(in) :: file_name
    integer(hid_t), intent(out) :: file
    integer, intent(out) :: status
    integer, parameter :: most_tries = 10
    integer :: i

    do i = 1, most_tries
      call start_hdf5(status)
      call open_file(file_name, h5f_acc_rdonly_f, file, status)
      if (status >= 0) return
      if (index(failure_reason(), 'temporarily unavailable') == 0) return
      call wait_seconds(0.05_wp)
    end do
  end subroutine open_existing

  !> Why the last HDF5 call failed: the operating system's words when it had any.
  function failure_reason() result(reason)
    character(:), allocatable :: reason
    character(*), parameter :: system_words = "error message = '"
    integer(c_int64_t), parameter :: current_stack = 0
    integer(c_int), parameter :: innermost_first = 0
    type(reason_t), target :: found
    integer(c_int) :: ignored
    integer :: first, i

    found%length = 0
    ignored = h5ewalk(current_stack, innermost_first, c_funloc(keep_first_description), c_loc(found))
    allocate (character(found%length) :: reason)
    do i = 1, found%length
      reason(i:i) = found%text(i)
    end do
    first = index(reason, system_words)
    if (first > 0) then
      reason = reason(first + len(system_words):)
      reason = reason(:scan(reason//"'", "'") - 1)
    end if
    if (reason == '') reason = 'HDF5 gave no reason'
  end function failure_reason

  !> Why a file that is there could not be read, and what to do; a refusal says more than HDF5.
  function damage_reason(refusal) result(reason)
    type(refusal_t), intent(in), optional :: refusal
    character(:), allocatable :: reason

    if (present(refusal)) then
      if (allocated(refusal%reason)) then
        reason = refusal%reason//', as in no file of this program: do not trust the file, run the deck again'
        return
      end if
    end if
    reason = with_remedy(failure_reason())
    if (reason == failure_reason()) reason = 'the file is damaged ('//reason//'): run the deck again'
  end function damage_reason

  integer(c_int) function keep_first_description(depth, entry_address, user_data) bind(c) result(status)
    integer(c_int), value :: depth
    type(c_ptr), value :: entry_address, user_data
    type(stack_entry_t), pointer :: entry
    type(reason_t), pointer :: found
    character(c_char), pointer :: description(:)

    status = 0
    if (depth > 0) return
    call c_f_pointer(entry_address, entry)
    call c_f_pointer(user_data, found)
    if (.not. c_associated(entry%description)) return
    call c_f_pointer(entry%description, description, [c_strlen(entry%description)])
    found%length = min(size(description), size(found%text))
    found%text(:found%length) = description(:found%length)
  end function keep_first_description

  !> The operating system's descriptor of an open file.
  subroutine file_descriptor(file, descriptor, status)
    integer(hid_t), intent(in) :: file
    integer(c_int), intent(out) :: descriptor
    integer, intent(inout) :: status
    integer(c_int64_t), parameter :: default_access = 0
    integer(c_int), pointer :: value
    type(c_ptr) :: handle

    descriptor = -1
    if (status < 0) return
    status = h5fget_vfd_handle(int(file, c_int64_t), default_access, handle)
    if (status < 0) return
    call c_f_pointer(handle, value)
    descriptor = value
  end subroutine file_descriptor

  subroutine put_text_attribute(object, name, text, status)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, text
    integer, intent(inout) :: status
    character(c_char), target :: bytes(len(text) + 1)
    type(c_ptr), target :: address
    integer(hid_t) :: text_type

    if (status < 0) return
    bytes = c_bytes(text)
    address = c_loc(bytes)
    call create_text_type(text_type, status)
    call write_attribute(object, name, text_type, text_type, c_loc(address), status)
    call release_type(text_type, status)
  end subroutine put_text_attribute

  subroutine put_integer_attribute(object, name, number, status)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(in) :: number
    integer, intent(inout) :: status
    integer, target :: value

    value = number
    call write_attribute(object, name, h5t_std_i32le, h5t_native_integer, c_loc(value), status)
  end subroutine put_integer_attribute

  subroutine put_real_attribute(object, name, number, status)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    real(wp), intent(in) :: number
    integer, intent(inout) :: status
    real(real64), target :: value

    value = real(number, real64)
    call write_attribute(object, name, h5t_ieee_f64le, h5t_native_double, c_loc(value), status)
  end subroutine put_real_attribute

  !> Write an attribute's value, and create the attribute when it is not there.
  subroutine write_attribute(object, name, file_type, memory_type, value, status)
    integer(hid_t), intent(in) :: object, file_type, memory_type
    character(*), intent(in) :: name
    type(c_ptr), intent(in) :: value
    integer, intent(inout) :: status
    integer(hid_t) :: space, attribute
    integer :: ignored
    logical :: there

    if (status < 0) return
    call h5aexists_f(object, name, there, status)
    if (status < 0) return
    if (there) then
      call h5aopen_f(object, name, attribute, status)
    else
      call h5screate_f(h5s_scalar_f, space, status)
      if (status < 0) return
      call h5acreate_f(object, name, file_type, space, attribute, status)
      if (status < 0) return
      call h5sclose_f(space, ignored)
    end if
    if (status < 0) return
    call h5awrite_f(attribute, memory_type, value, status)
    if (status < 0) return
    call h5aclose_f(attribute, status)
  end subroutine write_attribute

  subroutine get_text_attribute(object, name, text, status, refusal)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    type(c_ptr), target :: address
    type(c_ptr) :: buffer
    integer(hid_t) :: attribute, text_type
    integer :: ignored

    text = ''
    if (status < 0) return
    call h5aopen_f(object, name, attribute, status)
    if (status < 0) return
    call h5aget_type_f(attribute, text_type, status)
    call check_text_type(name, text_type, status, refusal)
    call check_single(name, attribute, status, refusal)
    if (status < 0) return
    address = c_null_ptr
    buffer = c_loc(address)
    call h5aread_f(attribute, text_type, buffer, status)
    call h5tclose_f(text_type, ignored)
    call h5aclose_f(attribute, ignored)
    if (status >= 0) call take_text(address, text)
  end subroutine get_text_attribute

  !> Refuse texts that do not come as an address.
  subroutine check_text_type(name, text_type, status, refusal)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: text_type
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    logical :: is_variable

    if (status < 0) return
    call h5tis_variable_str_f(text_type, is_variable, status)
    if (status >= 0 .and. .not. is_variable) call refuse(name, 'is no text', status, refusal)
  end subroutine check_text_type

  !> Refuse an attribute of several values, for which there is no room.
  subroutine check_single(name, attribute, status, refusal)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: attribute
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hid_t) :: space

    if (status < 0) return
    call h5aget_space_f(attribute, space, status)
    call check_single_space(name, space, status, refusal)
  end subroutine check_single

  subroutine check_single_space(name, space, status, refusal)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: space
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hsize_t) :: points
    integer :: ignored

    if (status < 0) return
    call h5sget_simple_extent_npoints_f(space, points, status)
    if (status >= 0 .and. points /= 1) call refuse(name, 'is not a single value', status, refusal)
    call h5sclose_f(space, ignored)
  end subroutine check_single_space

  !> Treat an object of a file as damaged that HDF5 would read.
  subroutine refuse(name, why, status, refusal)
    character(*), intent(in) :: name, why
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal

    status = -1
    if (present(refusal)) refusal%reason = "'"//name//"' "//why
  end subroutine refuse

  !> HDF5 allocates a text that is read, a few times a file: it is left to the process's end.
  subroutine take_text(address, text)
    type(c_ptr), intent(in) :: address
    character(:), allocatable, intent(out) :: text
    character(c_char), pointer :: bytes(:)
    integer :: i

    text = ''
    if (.not. c_associated(address)) return
    call c_f_pointer(address, bytes, [c_strlen(address)])
    text = repeat(' ', size(bytes))
    do i = 1, size(bytes)
      text(i:i) = bytes(i)
    end do
  end subroutine take_text

  subroutine get_integer_attribute(object, name, number, status, refusal)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(out) :: number
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer, target :: value
    type(c_ptr) :: buffer
    integer(hid_t) :: attribute, stored_as
    integer :: class, ignored

    number = 0
    if (status < 0) return
    call h5aopen_f(object, name, attribute, status)
    if (status < 0) return
    call check_single(name, attribute, status, refusal)
    if (status < 0) return
    call h5aget_type_f(attribute, stored_as, status)
    if (status >= 0) call h5tget_class_f(stored_as, class, status)
    if (status >= 0 .and. class /= h5t_integer_f) call refuse(name, 'is no integer', status, refusal)
    if (status < 0) return
    buffer = c_loc(value)
    call h5tclose_f(stored_as, ignored)
    call h5aread_f(attribute, h5t_native_integer, buffer, status)
    call h5aclose_f(attribute, ignored)
    number = value
  end subroutine get_integer_attribute

  !> A scalar dataset of text.
  subroutine put_text(group, name, text, long_name, status)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name, text, long_name
    integer, intent(inout) :: status
    character(c_char), target :: bytes(len(text) + 1)
    type(c_ptr), target :: address
    integer(hid_t) :: text_type

    if (status < 0) return
    bytes = c_bytes(text)
    address = c_loc(bytes)
    call create_text_type(text_type, status)
    call write_scalar(group, quantity_t(name, '1', long_name), text_type, text_type, c_loc(address), status)
    call release_type(text_type, status)
  end subroutine put_text

  !> Read a scalar dataset of text.
  subroutine get_text(object, name, text, status, refusal)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    type(c_ptr), target :: address
    type(c_ptr) :: buffer
    integer(hid_t) :: dataset, text_type, space
    integer :: ignored

    text = ''
    call open_own_dataset(object, name, dataset, status, refusal)
    call check_size(name, dataset, status, refusal)
    if (status < 0) return
    call h5dget_space_f(dataset, space, status)
    call check_single_space(name, space, status, refusal)
    if (status < 0) return
    call h5dget_type_f(dataset, text_type, status)
    call check_text_type(name, text_type, status, refusal)
    if (status < 0) return
    address = c_null_ptr
    buffer = c_loc(address)
    call h5dread_f(dataset, text_type, buffer, status)
    call h5tclose_f(text_type, ignored)
    call h5dclose_f(dataset, ignored)
    if (status >= 0) call take_text(address, text)
  end subroutine get_text

  !> A scalar dataset of a number, stored as `file_type` (by default a double).
  subroutine put_number(group, quantity, number, status, file_type)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    real(wp), intent(in) :: number
    integer, intent(inout) :: status
    integer(hid_t), intent(in), optional :: file_type
    integer(hid_t) :: stored_as
    real(real64), target :: value

    stored_as = h5t_ieee_f64le
    if (present(file_type)) stored_as = file_type
    value = real(number, real64)
    call write_scalar(group, quantity, stored_as, h5t_native_double, c_loc(value), status)
  end subroutine put_number

  subroutine write_scalar(group, quantity, file_type, memory_type, value, status)
    integer(hid_t), intent(in) :: group, file_type, memory_type
    type(quantity_t), intent(in) :: quantity
    type(c_ptr), intent(in) :: value
    integer, intent(inout) :: status
    integer(hid_t) :: space, dataset
    integer :: ignored

    if (status < 0) return
    call h5screate_f(h5s_scalar_f, space, status)
    if (status < 0) return
    call h5dcreate_f(group, trim(quantity%name), file_type, space, dataset, status)
    if (status < 0) return
    call h5sclose_f(space, ignored)
    call h5dwrite_f(dataset, memory_type, value, status)
    call describe(dataset, quantity, status)
    if (status < 0) return
    call h5dclose_f(dataset, status)
  end subroutine write_scalar

  !> The attributes that every dataset has.
  subroutine describe(dataset, quantity, status)
    integer(hid_t), intent(in) :: dataset
    type(quantity_t), intent(in) :: quantity
    integer, intent(inout) :: status

    call put_attribute(dataset, 'units', trim(quantity%units), status)
    call put_attribute(dataset, 'long_name', trim(quantity%long_name), status)
  end subroutine describe

  !> Create a group and open it.
  subroutine create_group(parent, name, group, status)
    integer(hid_t), intent(in) :: parent
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: group
    integer, intent(inout) :: status

    group = -1
    if (status < 0) return
    call h5gcreate_f(parent, name, group, status)
  end subroutine create_group

  !> Remove a group or dataset, if it is there.
  subroutine delete_link(parent, name, status)
    integer(hid_t), intent(in) :: parent
    character(*), intent(in) :: name
    integer, intent(inout) :: status
    logical :: there

    if (status < 0) return
    call h5lexists_f(parent, name, there, status)
    if (status < 0) return
    if (there) call h5ldelete_f(parent, name, status)
    status = min(status, 0)
  end subroutine delete_link

  !> An empty column of `file_type` in chunks of `chunk_rows`, with room for one chunk in the cache, or for none if whole chunks
  !> are appended. Each chunk has a checksum, so that damage is found when it is read.
  subroutine create_column(group, quantity, file_type, chunk_rows, column, status, whole_chunks)
    integer(hid_t), intent(in) :: group, file_type
    type(quantity_t), intent(in) :: quantity
    integer, intent(in) :: chunk_rows
    type(column_t), intent(out) :: column
    integer, intent(inout) :: status
    logical, intent(in), optional :: whole_chunks
    integer(hid_t) :: space, creation, access
    integer :: cached_rows
    integer :: ignored

    if (status < 0) return
    call h5screate_simple_f(1, [0_hsize_t], space, status, [h5s_unlimited_f])
    if (status < 0) return
    call h5pcreate_f(h5p_dataset_create_f, creation, status)
    if (status < 0) return
    call h5pset_chunk_f(creation, 1, [int(chunk_rows, hsize_t)], status)
    if (status < 0) return
    call h5pset_fletcher32_f(creation, status)
    if (status < 0) return
    cached_rows = chunk_rows
    if (present(whole_chunks)) cached_rows = merge(0, chunk_rows, whole_chunks)
    call create_access(cached_rows, access, status)
    if (status < 0) return
    call h5dcreate_f(group, trim(quantity%name), file_type, space, column%dataset, status, creation, dapl_id=access)
    if (status < 0) return
    call h5pclose_f(access, ignored)
    call h5pclose_f(creation, ignored)
    call h5sclose_f(space, ignored)
    call describe(column%dataset, quantity, status)
  end subroutine create_column

  !> A column that is there already, with all its rows.
  subroutine open_column(group, name, chunk_rows, column, status, refusal)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    integer, intent(in) :: chunk_rows
    type(column_t), intent(out) :: column
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hid_t) :: access, space
    integer(hsize_t) :: rows(1), largest(1)
    integer :: ignored, rank

    call create_access(chunk_rows, access, status)
    if (status < 0) return
    call open_own_dataset(group, name, column%dataset, status, refusal, access)
    if (status < 0) return
    call h5pclose_f(access, ignored)
    call h5dget_space_f(column%dataset, space, status)
    if (status < 0) return
    call h5sget_simple_extent_ndims_f(space, rank, status)
    if (status >= 0 .and. rank /= 1) call refuse(name, 'is no list', status, refusal)
    if (status < 0) return
    call h5sget_simple_extent_dims_f(space, rows, largest, status)
    call h5sclose_f(space, ignored)
    status = min(status, 0)
    column%rows = rows(1)
  end subroutine open_column

  !> Open a dataset whose data are in the file as they are: behind hard links only, in no other file, not put together from
  !> others, not compressed.
  subroutine open_own_dataset(object, name, dataset, status, refusal, access)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: dataset
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hid_t), intent(in), optional :: access
    integer(hid_t) :: creation
    integer :: layout, externals, ignored

    dataset = -1
    call check_links(object, name, status, refusal)
    if (status < 0) return
    if (present(access)) then
      call h5dopen_f(object, name, dataset, status, access)
    else
      call h5dopen_f(object, name, dataset, status)
    end if
    if (status < 0) return
    call h5dget_create_plist_f(dataset, creation, status)
    if (status < 0) return
    call h5pget_layout_f(creation, layout, status)
    if (status < 0) return
    ! To ask for the extent of a virtual dataset opens its sources.
    if (layout == h5d_virtual_f) then
      call refuse(name, 'is made of other datasets', status, refusal)
      return
    end if
    call h5pget_external_count_f(creation, externals, status)
    if (status >= 0 .and. externals > 0) call refuse(name, 'has its data in another file', status, refusal)
    call check_filters(name, creation, status, refusal)
    call h5pclose_f(creation, ignored)
  end subroutine open_own_dataset

  !> Refuse a path on which a link leads elsewhere.
  subroutine check_links(object, name, status, refusal)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hsize_t) :: address
    integer(size_t) :: length
    integer :: last, next, character_set, order, kind
    logical :: is_ordered

    last = 0
    do while (last < len(name) .and. status >= 0)
      next = index(name(last + 1:)//'/', '/')
      last = last + next
      associate (part => name(:min(last - 1, len(name))))
        call h5lget_info_f(object, part, character_set, order, is_ordered, kind, address, length, status)
        if (status >= 0 .and. kind /= h5l_type_hard_f) call refuse(part, 'is a link', status, refusal)
      end associate
    end do
  end subroutine check_links

  !> Refuse what is compressed: a few bytes could fill the memory, or a filter be code from a plugin.
  subroutine check_filters(name, creation, status, refusal)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: creation
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(size_t) :: parameters
    integer :: i, n, flags, values(8), filter
    character(32) :: filter_name

    if (status < 0) return
    call h5pget_nfilters_f(creation, n, status)
    do i = 0, n - 1
      if (status < 0) return
      parameters = size(values)
      call h5pget_filter_f(creation, i, flags, parameters, values, len(filter_name, size_t), filter_name, filter, status)
      if (status >= 0 .and. filter /= h5z_filter_shuffle_f .and. filter /= h5z_filter_fletcher32_f) &
        call refuse(name, 'is compressed (h5repack -f NONE undoes that)', status, refusal)
    end do
  end subroutine check_filters

  !> Refuse a dataset that claims more than it has, or more than the file.
  subroutine check_size(name, dataset, status, refusal)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: dataset
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    integer(hid_t) :: file, stored_as, space
    integer(hsize_t) :: points, stored
    integer(size_t) :: value_bytes, file_bytes
    integer :: ignored

    if (status < 0) return
    call h5iget_file_id_f(dataset, file, status)
    if (status >= 0) call h5fget_filesize_f(file, file_bytes, status)
    if (status >= 0) call h5dget_type_f(dataset, stored_as, status)
    if (status >= 0) call h5tget_size_f(stored_as, value_bytes, status)
    if (status >= 0) call h5dget_space_f(dataset, space, status)
    if (status >= 0) call h5sget_simple_extent_npoints_f(space, points, status)
    if (status < 0) return
    ! It fails where nothing is stored.
    stored = 0
    call h5dget_storage_size_f(dataset, stored, ignored)
    if (ignored < 0) stored = 0
    call h5sclose_f(space, ignored)
    call h5tclose_f(stored_as, ignored)
    call h5fclose_f(file, ignored)
    if (points > min(stored, int(file_bytes, hsize_t))/value_bytes) call refuse(name, 'claims more than it has', status, refusal)
  end subroutine check_size

  subroutine create_access(cached_rows, access, status)
    integer, intent(in) :: cached_rows
    integer(hid_t), intent(out) :: access
    integer, intent(inout) :: status
    integer(size_t), parameter :: slots = 7

    access = -1
    if (status < 0) return
    call h5pcreate_f(h5p_dataset_access_f, access, status)
    if (status < 0) return
    call h5pset_chunk_cache_f(access, slots, int(8*cached_rows, size_t), 1.0, status)
  end subroutine create_access

  !> Append values to a column.
  subroutine append(column, values, status)
    type(column_t), intent(inout) :: column
    real(real64), intent(in), contiguous, target :: values(:)
    integer, intent(inout) :: status
    integer(hid_t) :: file_space, memory_space
    integer(hsize_t) :: count(1)
    integer :: ignored

    count = size(values)
    if (status < 0 .or. size(values) == 0) return
    call h5dset_extent_f(column%dataset, column%rows + count, status)
    if (status < 0) return
    call h5dget_space_f(column%dataset, file_space, status)
    if (status < 0) return
    call h5sselect_hyperslab_f(file_space, h5s_select_set_f, [column%rows], count, status)
    if (status < 0) return
    call h5screate_simple_f(1, count, memory_space, status)
    if (status < 0) return
    call h5dwrite_f(column%dataset, h5t_native_double, c_loc(values(1)), status, memory_space, file_space)
    if (status < 0) return
    call h5sclose_f(memory_space, ignored)
    call h5sclose_f(file_space, ignored)
    column%rows = column%rows + count(1)
    call add_to_checksum(column%checksum, values)
  end subroutine append

  !> Rotate and add without carry: no damage to a single value goes unnoticed.
  pure subroutine add_to_checksum(checksum, values)
    integer(int64), intent(inout) :: checksum
    real(real64), intent(in) :: values(:)
    integer, parameter :: places = 5
    integer :: i

    do i = 1, size(values)
      checksum = ieor(ishftc(checksum, places), transfer(values(i), checksum))
    end do
  end subroutine add_to_checksum

  !> Append to a column the `rows` rows that `from` has next.
  subroutine copy_rows(from, to, rows, status)
    type(column_t), intent(in) :: from
    type(column_t), intent(inout) :: to
    integer(hsize_t), intent(in) :: rows
    integer, intent(inout) :: status
    real(real64), allocatable, target :: values(:)
    type(c_ptr) :: buffer
    integer(hid_t) :: file_space, memory_space
    integer :: ignored

    if (status < 0) return
    call h5dget_space_f(from%dataset, file_space, status)
    if (status >= 0) call h5sselect_hyperslab_f(file_space, h5s_select_set_f, [to%rows], [rows], status)
    if (status >= 0) call h5screate_simple_f(1, [rows], memory_space, status)
    if (status < 0) return
    allocate (values(rows))
    buffer = c_loc(values)
    call h5dread_f(from%dataset, h5t_native_double, buffer, status, memory_space, file_space)
    if (status < 0) return
    call h5sclose_f(memory_space, ignored)
    call h5sclose_f(file_space, ignored)
    call append(to, values, status)
  end subroutine copy_rows

  !> Drop the rows behind the first `rows`.
  subroutine cut_column(column, rows, status)
    type(column_t), intent(inout) :: column
    integer(hsize_t), intent(in) :: rows
    integer, intent(inout) :: status

    if (status < 0) return
    column%rows = min(column%rows, rows)
    call h5dset_extent_f(column%dataset, [column%rows], status)
  end subroutine cut_column

  !> Make a column a dimension scale.
  subroutine make_scale(column, name, status)
    type(column_t), intent(in) :: column
    character(*), intent(in) :: name
    integer, intent(inout) :: status

    if (status < 0) return
    status = h5dsset_scale(int(column%dataset, c_int64_t), c_bytes(name))
  end subroutine make_scale

  !> Let `scale` be the coordinate of a dataset along its side `side` from 0, in the order of C.
  subroutine attach_scale(dataset, scale, status, side)
    integer(hid_t), intent(in) :: dataset
    type(column_t), intent(in) :: scale
    integer, intent(inout) :: status
    integer, intent(in), optional :: side
    integer(c_int) :: which

    which = 0
    if (present(side)) which = int(side, c_int)
    if (status < 0) return
    status = h5dsattach_scale(int(dataset, c_int64_t), int(scale%dataset, c_int64_t), which)
  end subroutine attach_scale

  !> An empty table of doubles with rows of `length` values, in chunks of several rows and with a checksum for each.
  subroutine create_table(group, quantity, length, table, status)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    integer, intent(in) :: length
    type(table_t), intent(out) :: table
    integer, intent(inout) :: status
    integer(hsize_t), parameter :: usual_chunk = 16384   ! values
    integer(hid_t) :: space, creation
    integer(hsize_t) :: chunk(2)
    integer :: ignored

    if (status < 0) return
    call h5screate_simple_f(2, [int(length, hsize_t), 0_hsize_t], space, status, [int(length, hsize_t), h5s_unlimited_f])
    if (status < 0) return
    call h5pcreate_f(h5p_dataset_create_f, creation, status)
    chunk(1) = min(int(length, hsize_t), usual_chunk)
    chunk(2) = max(1_hsize_t, usual_chunk/chunk(1))
    if (status >= 0) call h5pset_chunk_f(creation, 2, chunk, status)
    if (status >= 0) call h5pset_fletcher32_f(creation, status)
    if (status >= 0) call h5dcreate_f(group, trim(quantity%name), h5t_ieee_f64le, space, table%dataset, status, creation)
    if (status < 0) return
    call h5pclose_f(creation, ignored)
    call h5sclose_f(space, ignored)
    call describe(table%dataset, quantity, status)
  end subroutine create_table

  !> Append rows: values(place in the row, row).
  subroutine append_rows(table, values, status)
    type(table_t), intent(inout) :: table
    real(real64), intent(in), contiguous, target :: values(:, :)
    integer, intent(inout) :: status
    integer(hid_t) :: file_space, memory_space
    integer(hsize_t) :: count(2)
    integer :: ignored

    count = shape(values)
    if (status < 0 .or. size(values) == 0) return
    call h5dset_extent_f(table%dataset, [count(1), table%rows + count(2)], status)
    if (status >= 0) call h5dget_space_f(table%dataset, file_space, status)
    if (status < 0) return
    call h5sselect_hyperslab_f(file_space, h5s_select_set_f, [0_hsize_t, table%rows], count, status)
    if (status >= 0) call h5screate_simple_f(2, count, memory_space, status)
    if (status >= 0) call h5dwrite_f(table%dataset, h5t_native_double, c_loc(values(1, 1)), status, memory_space, file_space)
    if (status < 0) return
    call h5sclose_f(memory_space, ignored)
    call h5sclose_f(file_space, ignored)
    table%rows = table%rows + count(2)
  end subroutine append_rows

  !> An empty list of texts.
  subroutine create_messages(group, quantity, list, status)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    type(message_list_t), intent(out) :: list
    integer, intent(inout) :: status
    integer(hsize_t), parameter :: chunk = 1024
    integer(hid_t) :: space, creation, text_type
    integer :: ignored

    call create_text_type(text_type, status)
    if (status < 0) return
    call h5screate_simple_f(1, [0_hsize_t], space, status, [h5s_unlimited_f])
    if (status < 0) return
    call h5pcreate_f(h5p_dataset_create_f, creation, status)
    if (status >= 0) call h5pset_chunk_f(creation, 1, [chunk], status)
    if (status >= 0) call h5dcreate_f(group, trim(quantity%name), text_type, space, list%dataset, status, creation)
    if (status < 0) return
    call h5pclose_f(creation, ignored)
    call h5sclose_f(space, ignored)
    call describe(list%dataset, quantity, status)
    call release_type(text_type, status)
  end subroutine create_messages

  !> Append texts, one a row.
  subroutine append_messages(list, texts, status)
    type(message_list_t), intent(inout) :: list
    type(path_t), intent(in) :: texts(:)
    integer, intent(inout) :: status
    character(c_char), allocatable, target :: bytes(:)
    type(c_ptr), allocatable, target :: addresses(:)
    integer(hid_t) :: file_space, memory_space, text_type
    integer(hsize_t) :: count(1)
    integer :: i, first, length, ignored

    if (status < 0 .or. size(texts) == 0) return
    length = 0
    do i = 1, size(texts)
      length = length + len(texts(i)%text) + 1
    end do
    allocate (bytes(length), addresses(size(texts)))
    first = 1
    do i = 1, size(texts)
      length = len(texts(i)%text) + 1
      bytes(first:first + length - 1) = c_bytes(texts(i)%text)
      addresses(i) = c_loc(bytes(first))
      first = first + length
    end do
    count = size(texts)
    call create_text_type(text_type, status)
    if (status >= 0) call h5dset_extent_f(list%dataset, list%rows + count, status)
    if (status >= 0) call h5dget_space_f(list%dataset, file_space, status)
    if (status < 0) return
    call h5sselect_hyperslab_f(file_space, h5s_select_set_f, [list%rows], count, status)
    if (status >= 0) call h5screate_simple_f(1, count, memory_space, status)
    if (status >= 0) call h5dwrite_f(list%dataset, text_type, c_loc(addresses), status, memory_space, file_space)
    if (status < 0) return
    call h5sclose_f(memory_space, ignored)
    call h5sclose_f(file_space, ignored)
    call release_type(text_type, status)
    list%rows = list%rows + count(1)
  end subroutine append_messages

  !> The names of all that a file or group holds, in alphabetical order; of many the first.
  subroutine names_in(group, names, status)
    integer(hid_t), intent(in) :: group
    type(path_t), allocatable, intent(out) :: names(:)
    integer, intent(inout) :: status
    integer, parameter :: most_names = 1000
    character(256) :: name
    integer(hsize_t) :: i
    integer :: storage, count, order

    count = 0
    if (status >= 0) call h5gget_info_f(group, storage, count, order, status)
    count = min(count, most_names)
    allocate (names(count))
    do i = 1, count
      if (status >= 0) call h5lget_name_by_idx_f(group, '.', h5_index_name_f, h5_iter_inc_f, i - 1_hsize_t, name, status)
      names(i)%text = trim(name)
    end do
  end subroutine names_in

  !> All values of a one-dimensional dataset of numbers.
  subroutine read_list(group, name, values, status, refusal)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    real(wp), allocatable, intent(out) :: values(:)
    integer, intent(inout) :: status
    type(refusal_t), intent(inout), optional :: refusal
    type(column_t) :: column
    real(real64), allocatable, target :: read(:)
    type(c_ptr) :: buffer
    integer(hid_t) :: stored_as
    integer :: class, ignored

    allocate (values(0))
    call open_column(group, name, 1, column, status, refusal)
    call check_size(name, column%dataset, status, refusal)
    if (status < 0) return
    call h5dget_type_f(column%dataset, stored_as, status)
    if (status >= 0) call h5tget_class_f(stored_as, class, status)
    if (status >= 0 .and. class /= h5t_integer_f .and. class /= h5t_float_f) &
      call refuse(name, 'holds no numbers', status, refusal)
    if (status < 0) return
    call h5tclose_f(stored_as, ignored)
    allocate (read(column%rows))
    if (size(read) > 0) then
      buffer = c_loc(read)
      call h5dread_f(column%dataset, h5t_native_double, buffer, status)
    end if
    call h5dclose_f(column%dataset, ignored)
    values = real(read, wp)
  end subroutine read_list

  subroutine create_text_type(text_type, status)
    integer(hid_t), intent(out) :: text_type
    integer, intent(inout) :: status

    text_type = -1
    if (status < 0) return
    call h5tcopy_f(h5t_string, text_type, status)
    if (status < 0) return
    call h5tset_cset_f(text_type, h5t_cset_utf8_f, status)
  end subroutine create_text_type

  subroutine release_type(text_type, status)
    integer(hid_t), intent(in) :: text_type
    integer, intent(inout) :: status

    if (status < 0) return
    call h5tclose_f(text_type, status)
  end subroutine release_type

  !> Text as C keeps it.
  pure function c_bytes(text) result(bytes)
    character(*), intent(in) :: text
    character(c_char) :: bytes(len(text) + 1)
    integer :: i

    do i = 1, len(text)
      bytes(i) = text(i:i)
    end do
    bytes(len(text) + 1) = c_null_char
  end function c_bytes
end module dst_hdf5_tools
