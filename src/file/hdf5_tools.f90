!> The operations of HDF5 that this program needs: attributes, described datasets, datasets that grow, dimension scales.
!>
!> The last argument of every procedure is an `hdf5_t`, which records whether a call has failed. After the first failure HDF5 is not
!> called any more, so that a sequence of calls is checked once, at its end, and `failure_reason` then gives the reason of the first
!> failure. Every statement is guarded by `if (h5%status >= 0)`; objects that remain open after a failure are closed with the file.
!> Text is variable-length UTF-8. Sources: HDF5 1.10 reference manual; HDF5 Dimension Scale Specification.
module dst_hdf5_tools
  use, intrinsic :: iso_c_binding, only: c_ptr, c_int, c_char, c_size_t, c_double, nul => c_null_char, c_null_ptr, c_null_funptr, &
    c_loc, c_funloc, c_f_pointer
  use dst_hdf5_library, only: hid_t, hsize_t, h5open, h5dont_atexit, h5eset_auto, h5ewalk, h5e_error_t, h5e_default, &
    h5e_walk_upward, h5fcreate, h5fopen, h5fget_filesize, h5f_acc_trunc, h5f_acc_rdonly, h5f_close_strong, &
    h5f_libver_v18, h5iget_file_id, h5idec_ref, &
    h5tcopy, h5tset_size, h5tset_cset, h5tis_variable_str, h5tget_class, h5tget_size, h5t_variable, h5t_cset_utf8, h5t_c_s1, &
    h5t_native_double, h5t_native_int, h5t_std_i32le, h5t_ieee_f64le, h5t_integer, h5t_float, h5t_string, &
    h5screate_simple, h5sselect_hyperslab, h5sget_simple_extent_ndims, h5sget_simple_extent_npoints, h5s_all, h5s_unlimited, &
    h5s_select_set, h5aexists, h5acreate, h5aopen, h5awrite, h5aread, h5aget_type, h5aget_space, &
    h5dcreate, h5dopen, h5dget_type, h5dread, h5dwrite, h5dset_extent, h5dget_space, h5dget_create_plist, &
    h5dget_storage_size, h5dsset_scale, h5dsattach_scale, h5d_virtual, h5gcreate, h5gget_info, h5g_info_t, &
    h5lget_val, h5lget_name_by_idx, h5_index_name, h5_iter_inc, &
    h5pcreate, h5pset_chunk, h5pset_chunk_cache, h5pset_buffer, h5pset_fill_value, h5pset_fclose_degree, &
    h5pset_libver_bounds, &
    h5pget_layout, h5pget_external_count, h5p_default, h5p_dataset_create, h5p_dataset_access, &
    h5p_dataset_xfer, h5p_file_access
  use dst_kinds, only: wp, real64
  use dst_disk, only: path_t, with_remedy
  use dst_posix, only: c_set_environment, fortran_text, ignore_size_limit_signal
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: hdf5_t, start_hdf5, open_file, open_existing, failure_reason, damage_reason
  public :: put_attribute, get_attribute, put_value, get_text, create_group, release
  public :: dataset_t, create_dataset, open_dataset, append, append_texts, write_rows, read_rows, read_texts, make_scale, &
    attach_scale
  public :: names_in, read_list, get_number

  !> The status of a sequence of calls.
  type :: hdf5_t
    integer :: status = 0                  !! what the last call returned; negative after a failure
    character(:), allocatable :: refusal   !! an object that was refused although HDF5 could read it, and why
  contains
    procedure, private :: take
    procedure, private :: refuse
  end type hdf5_t

  !> Least room [bytes] in which values are converted.
  integer(c_size_t), parameter :: least_room = 64

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

contains

  !> Initialise HDF5: no messages on errors, no signal at a limit of file sizes, and without its clean-up at exit, which loops
  !> forever if the disk is full.
  subroutine start_hdf5(h5)
    type(hdf5_t), intent(out) :: h5

    integer(c_int) :: ignored

    call ignore_size_limit_signal()
    ! The locks of result_file say who writes. HDF5's own would be in their way.
    ignored = c_set_environment('HDF5_USE_FILE_LOCKING'//nul, 'FALSE'//nul, 1_c_int)
    h5%status = h5dont_atexit()
    h5%status = h5open()
    if (h5%status >= 0) h5%status = h5eset_auto(h5e_default, c_null_funptr, c_null_ptr)
  end subroutine start_hdf5

  !> Keep the identifier or number that a call returned; it is negative after a failure.
  subroutine take(self, returned, object)
    class(hdf5_t), intent(inout) :: self
    integer(hid_t), intent(in) :: returned
    integer(hid_t), intent(out) :: object

    object = returned
    if (object < 0) self%status = -1
  end subroutine take

  !> Create a file, in place of one that has the name, or open one; its objects are closed with it.
  subroutine open_file(file_name, mode, file, h5)
    character(*), intent(in) :: file_name
    integer, intent(in) :: mode
    integer(hid_t), intent(out) :: file
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: access

    file = -1
    if (h5%status >= 0) call h5%take(h5pcreate(h5p_file_access), access)
    if (h5%status >= 0) h5%status = h5pset_fclose_degree(access, h5f_close_strong)
    ! The oldest format with checksums of the metadata. A file of a newer one would have to be released with h5clear after a kill.
    if (h5%status >= 0) h5%status = h5pset_libver_bounds(access, h5f_libver_v18, h5f_libver_v18)
    if (h5%status >= 0) then
      if (mode == h5f_acc_trunc) then
        call h5%take(h5fcreate(file_name//nul, mode, h5p_default, access), file)
      else
        call h5%take(h5fopen(file_name//nul, mode, access), file)
      end if
    end if
    call release([access], h5)
  end subroutine open_file

  !> Open a file for reading.
  subroutine open_existing(file_name, file, h5)
    character(*), intent(in) :: file_name
    integer(hid_t), intent(out) :: file
    type(hdf5_t), intent(out) :: h5

    call start_hdf5(h5)
    call open_file(file_name, h5f_acc_rdonly, file, h5)
  end subroutine open_existing

  !> Close objects of any kind.
  subroutine release(objects, h5)
    integer(hid_t), intent(in) :: objects(:)
    type(hdf5_t), intent(inout) :: h5
    integer :: i

    do i = 1, size(objects)
      if (h5%status >= 0) h5%status = h5idec_ref(objects(i))
    end do
  end subroutine release

  !> Why the last HDF5 call failed: the operating system's message if there is one.
  function failure_reason() result(reason)
    character(:), allocatable :: reason
    character(*), parameter :: system_words = "error message = '"
    type(c_ptr), target :: description
    integer(c_int) :: ignored
    integer :: first

    description = c_null_ptr
    ignored = h5ewalk(h5e_default, h5e_walk_upward, c_funloc(keep_first_description), c_loc(description))
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
    type(h5e_error_t), pointer :: entry
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

    call write_attribute(object, name, h5t_std_i32le, h5t_native_int, c_loc(number), h5)
  end subroutine put_integer_attribute

  !> Write an attribute's value, and create the attribute if it does not exist.
  subroutine write_attribute(object, name, stored_as, memory_type, value, h5)
    integer(hid_t), intent(in) :: object, stored_as, memory_type
    character(*), intent(in) :: name
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: space, attribute

    if (h5%status >= 0) h5%status = h5aexists(object, name//nul)
    if (h5%status < 0) return
    if (h5%status > 0) then
      call h5%take(h5aopen(object, name//nul, h5p_default), attribute)
    else
      call create_scalar(space, h5)
      if (h5%status >= 0) &
        call h5%take(h5acreate(object, name//nul, stored_as, space, h5p_default, h5p_default), attribute)
      call release([space], h5)
    end if
    if (h5%status >= 0) h5%status = h5awrite(attribute, memory_type, value)
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
    call read_attribute(object, name, h5t_string, 'is no text', c_loc(address), h5)
    text = fortran_text(address)
  end subroutine get_text_attribute

  subroutine get_integer_attribute(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer, intent(out), target :: number
    type(hdf5_t), intent(inout) :: h5

    number = 0
    call read_attribute(object, name, h5t_integer, 'is no integer', c_loc(number), h5)
  end subroutine get_integer_attribute

  !> Read an attribute that has one value of a class of types: the address of a text, or an integer.
  subroutine read_attribute(object, name, class, otherwise, value, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, otherwise
    integer, intent(in) :: class
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: attribute, stored_as, space

    if (h5%status >= 0) call h5%take(h5aopen(object, name//nul, h5p_default), attribute)
    if (h5%status >= 0) call h5%take(h5aget_type(attribute), stored_as)
    if (h5%status >= 0) call h5%take(h5aget_space(attribute), space)
    call check_single(name, space, stored_as, class, otherwise, h5)
    if (h5%status >= 0) h5%status = h5aread(attribute, merge(stored_as, h5t_native_int, class == h5t_string), value)
    call release([attribute, stored_as], h5)
  end subroutine read_attribute

  !> Refuse a value of another class of types, or several values, for which there is no room. Texts must be given by their address.
  subroutine check_single(name, space, stored_as, class, otherwise, h5)
    character(*), intent(in) :: name, otherwise
    integer(hid_t), intent(in) :: space, stored_as
    integer, intent(in) :: class
    type(hdf5_t), intent(inout) :: h5
    logical :: is_right

    if (h5%status >= 0) h5%status = h5tget_class(stored_as)
    is_right = h5%status == class
    if (is_right .and. class == h5t_string) then
      h5%status = h5tis_variable_str(stored_as)
      is_right = h5%status > 0
    end if
    if (h5%status >= 0 .and. .not. is_right) call h5%refuse(name, otherwise)
    if (h5%status < 0) return
    if (h5sget_simple_extent_npoints(space) /= 1) call h5%refuse(name, 'is not a single value')
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

    call create_scalar(space, h5)
    if (h5%status >= 0) call h5%take(h5dcreate(group, trim(quantity%name)//nul, stored_as, space, h5p_default, h5p_default, &
      h5p_default), dataset)
    call create_transfer(1_hsize_t, transfer, h5)
    if (h5%status >= 0) h5%status = h5dwrite(dataset, memory_type, h5s_all, h5s_all, transfer, value)
    call describe(dataset, quantity, h5)
    call release([dataset, space, transfer], h5)
  end subroutine write_scalar

  !> The properties with which numbers are written. For a conversion HDF5 would clear a buffer of 1 MB each time.
  subroutine create_transfer(numbers, transfer, h5)
    integer(hsize_t), intent(in) :: numbers
    integer(hid_t), intent(out) :: transfer
    type(hdf5_t), intent(inout) :: h5
    integer(c_size_t), parameter :: most = 1048576

    if (h5%status >= 0) call h5%take(h5pcreate(h5p_dataset_xfer), transfer)
    if (h5%status >= 0) &
      h5%status = h5pset_buffer(transfer, min(most, max(least_room, 8*int(numbers, c_size_t))), c_null_ptr, c_null_ptr)
  end subroutine create_transfer

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

    address = c_null_ptr
    call read_scalar(object, name, h5t_string, 'is no text', c_loc(address), h5)
    text = fortran_text(address)
  end subroutine get_text

  !> Read a scalar dataset that holds a real number.
  subroutine get_number(object, name, number, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    real(wp), intent(out) :: number
    type(hdf5_t), intent(inout) :: h5
    real(real64), target :: stored

    stored = 0.0_real64
    call read_scalar(object, name, h5t_float, 'is no real number', c_loc(stored), h5)
    number = real(stored, wp)
  end subroutine get_number

  !> Read a dataset that has one value of a class of types: the address of a text, or a real number.
  subroutine read_scalar(object, name, class, otherwise, value, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name, otherwise
    integer, intent(in) :: class
    type(c_ptr), intent(in) :: value
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: dataset, stored_as, space

    call open_own(object, name, dataset, h5)
    if (h5%status >= 0) call h5%take(h5dget_space(dataset), space)
    if (h5%status >= 0) call h5%take(h5dget_type(dataset), stored_as)
    call check_single(name, space, stored_as, class, otherwise, h5)
    call check_size(name, dataset, 1_hsize_t, h5)
    if (h5%status >= 0) h5%status = h5dread(dataset, merge(stored_as, h5t_native_double, class == h5t_string), h5s_all, h5s_all, &
      h5p_default, value)
    call release([stored_as, dataset], h5)
  end subroutine read_scalar

  !> Create a group and open it.
  subroutine create_group(parent, name, group, h5)
    integer(hid_t), intent(in) :: parent
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: group
    type(hdf5_t), intent(inout) :: h5

    group = -1
    if (h5%status >= 0) call h5%take(h5gcreate(parent, name//nul, h5p_default, h5p_default, h5p_default), group)
  end subroutine create_group

  !> Create a dataset of texts, or of numbers stored as `stored_as`, in chunks of `chunk_rows`: empty, or with `rows` that are
  !> `fill`. For columns of numbers the cache has room for one chunk, or for none if `whole_chunks` are written.
  subroutine create_dataset(group, quantity, chunk_rows, dataset, h5, stored_as, row_length, whole_chunks, rows, fill)
    integer(hid_t), intent(in) :: group
    type(quantity_t), intent(in) :: quantity
    integer, intent(in) :: chunk_rows
    type(dataset_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t), intent(in), optional :: stored_as
    integer, intent(in), optional :: row_length
    logical, intent(in), optional :: whole_chunks
    integer, intent(in), optional :: rows
    real(real64), intent(in), optional, target :: fill
    integer(hsize_t), parameter :: longest_chunk = 16384   ! values of a row
    integer(hid_t) :: space, creation, access, file_type
    integer(hsize_t) :: chunk(2)
    integer :: rank, cached_rows

    if (present(row_length)) dataset%row_length = row_length
    if (present(rows)) dataset%rows = rows
    rank = size(extent(dataset, 0_hsize_t))
    chunk(:rank) = extent(dataset, int(chunk_rows, hsize_t))
    if (rank > 1) chunk(2) = min(chunk(2), longest_chunk)
    cached_rows = chunk_rows
    if (present(whole_chunks)) cached_rows = merge(0, chunk_rows, whole_chunks)
    if (h5%status >= 0) &
      call h5%take(h5screate_simple(rank, extent(dataset, dataset%rows), extent(dataset, h5s_unlimited)), space)
    if (h5%status >= 0) call h5%take(h5pcreate(h5p_dataset_create), creation)
    if (h5%status >= 0) h5%status = h5pset_chunk(creation, rank, chunk)
    if (h5%status >= 0 .and. present(fill)) h5%status = h5pset_fill_value(creation, h5t_native_double, c_loc(fill))
    call create_access(merge(cached_rows, -1, present(stored_as) .and. rank == 1), access, h5)
    if (present(stored_as)) then
      file_type = stored_as
    else
      call create_text_type(file_type, h5)
    end if
    if (h5%status >= 0) call h5%take(h5dcreate(group, trim(quantity%name)//nul, file_type, space, h5p_default, creation, access), &
      dataset%id)
    call release([space, creation, access], h5)
    if (.not. present(stored_as)) call release([file_type], h5)
    call describe(dataset%id, quantity, h5)
  end subroutine create_dataset

  !> The dimensions of a dataset with this number of rows.
  pure function extent(dataset, rows) result(sides)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: rows
    integer(hsize_t) :: sides(merge(2, 1, dataset%row_length > 0))

    sides(size(sides)) = dataset%row_length
    sides(1) = rows
  end function extent

  !> The properties with which a dataset is opened: its cache has room for this many rows; negative: HDF5's default.
  subroutine create_access(cached_rows, access, h5)
    integer, intent(in) :: cached_rows
    integer(hid_t), intent(out) :: access
    type(hdf5_t), intent(inout) :: h5
    integer(c_size_t), parameter :: slots = 7

    if (h5%status >= 0) call h5%take(h5pcreate(h5p_dataset_access), access)
    if (h5%status >= 0 .and. cached_rows >= 0) &
      h5%status = h5pset_chunk_cache(access, slots, int(8*cached_rows, c_size_t), 1.0_c_double)
  end subroutine create_access

  !> Open an existing column, with all its rows; each has `row_length` numbers if that is present and not 0.
  subroutine open_dataset(group, name, chunk_rows, dataset, h5, row_length)
    integer(hid_t), intent(in) :: group
    character(*), intent(in) :: name
    integer, intent(in) :: chunk_rows
    type(dataset_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer, intent(in), optional :: row_length
    integer(hid_t) :: access, space

    if (present(row_length)) dataset%row_length = row_length
    call create_access(chunk_rows, access, h5)
    call open_own(group, name, dataset%id, h5, access)
    if (h5%status >= 0) call h5%take(h5dget_space(dataset%id), space)
    if (h5%status >= 0) h5%status = h5sget_simple_extent_ndims(space)
    if (h5%status >= 0 .and. h5%status /= size(extent(dataset, dataset%rows))) &
      call h5%refuse(name, trim(merge('is no list ', 'is no table', dataset%row_length == 0)))
    if (h5%status >= 0) call h5%take(h5sget_simple_extent_npoints(space), dataset%rows)
    dataset%rows = dataset%rows/max(1_hsize_t, dataset%row_length)
    call release([access, space], h5)
  end subroutine open_dataset

  !> Open a dataset whose data are in the file: reached by hard links only, not in another file, not composed of other datasets.
  subroutine open_own(object, name, dataset, h5, access)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    integer(hid_t), intent(out) :: dataset
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t), intent(in), optional :: access
    integer(hid_t) :: creation, properties

    dataset = -1
    properties = h5p_default
    if (present(access)) properties = access
    call check_links(object, name, h5)
    if (h5%status >= 0) call h5%take(h5dopen(object, name//nul, properties), dataset)
    if (h5%status >= 0) call h5%take(h5dget_create_plist(dataset), creation)
    if (h5%status >= 0) h5%status = h5pget_layout(creation)
    ! A query of the extent of a virtual dataset would open its sources.
    if (h5%status == h5d_virtual) call h5%refuse(name, 'is made of other datasets')
    if (h5%status >= 0) h5%status = h5pget_external_count(creation)
    if (h5%status > 0) call h5%refuse(name, 'has its data in another file')
    call release([creation], h5)
  end subroutine open_own

  !> Refuse a path that contains a link of another kind.
  subroutine check_links(object, name, h5)
    integer(hid_t), intent(in) :: object
    character(*), intent(in) :: name
    type(hdf5_t), intent(inout) :: h5
    integer :: last

    last = 0
    do while (last <= len(name) .and. h5%status >= 0)
      last = last + index(name(last + 1:)//'/', '/')
      associate (part => name(:last - 1))
        ! A hard link has no value.
        if (h5lget_val(object, part//nul, c_null_ptr, 0_c_size_t, h5p_default) >= 0) call h5%refuse(part, 'is a link')
      end associate
    end do
  end subroutine check_links

  !> Refuse a dataset that claims more values than it has, or more than fit into the file.
  subroutine check_size(name, dataset, points, h5)
    character(*), intent(in) :: name
    integer(hid_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: points   !! number of values claimed
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: file, stored_as
    !> More bytes than this for one byte in the file no filter of HDF5 gives back.
    integer(hsize_t), parameter :: most_compressed = 1100
    integer(hsize_t) :: file_bytes, room

    if (h5%status >= 0) call h5%take(h5iget_file_id(dataset), file)
    if (h5%status >= 0) h5%status = h5fget_filesize(file, file_bytes)
    if (h5%status >= 0) call h5%take(h5dget_type(dataset), stored_as)
    if (h5%status < 0) return
    room = most_compressed*min(h5dget_storage_size(dataset), file_bytes)/max(1_c_size_t, h5tget_size(stored_as))
    call release([stored_as, file], h5)
    if (h5%status >= 0 .and. points > room) call h5%refuse(name, 'claims more than it has')
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

    if (h5%status >= 0) h5%status = h5dset_extent(dataset%id, extent(dataset, dataset%rows + rows))
    call put_rows(dataset, dataset%rows, rows, memory_type, values, h5)
    if (h5%status >= 0) dataset%rows = dataset%rows + rows
  end subroutine append_rows

  !> Write rows that begin at `values` after the first `first` rows of the dataset.
  subroutine put_rows(dataset, first, rows, memory_type, values, h5)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: first
    integer, intent(in) :: rows
    integer(hid_t), intent(in) :: memory_type
    type(c_ptr), intent(in) :: values
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: rows_in_file, rows_in_memory, transfer

    call select_rows(dataset, first, int(rows, hsize_t), rows_in_file, rows_in_memory, h5)
    call create_transfer(rows*max(1_hsize_t, dataset%row_length), transfer, h5)
    if (h5%status >= 0) h5%status = h5dwrite(dataset%id, memory_type, rows_in_memory, rows_in_file, transfer, values)
    call release([rows_in_memory, rows_in_file, transfer], h5)
  end subroutine put_rows

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
    from(1) = first
    if (h5%status >= 0) call h5%take(h5dget_space(dataset%id), rows_in_file)
    if (h5%status >= 0) &
      h5%status = h5sselect_hyperslab(rows_in_file, h5s_select_set, from, c_null_ptr, extent(dataset, rows), c_null_ptr)
    if (h5%status >= 0) call h5%take(h5screate_simple(rank, extent(dataset, rows), extent(dataset, rows)), rows_in_memory)
  end subroutine select_rows

  !> Write rows of numbers after the first `first` rows.
  subroutine write_rows(dataset, first, rows, values, h5)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: first
    integer, intent(in) :: rows
    real(real64), intent(in), contiguous, target :: values(:)
    type(hdf5_t), intent(inout) :: h5

    call put_rows(dataset, first, rows, h5t_native_double, c_loc(values(1)), h5)
  end subroutine write_rows

  !> Read all texts of a column. HDF5 allocates them: they are freed at the end of the process.
  subroutine read_texts(dataset, texts, h5)
    type(dataset_t), intent(in) :: dataset
    type(path_t), allocatable, intent(out) :: texts(:)
    type(hdf5_t), intent(inout) :: h5
    type(c_ptr), allocatable, target :: addresses(:)
    integer(hid_t) :: text_type
    integer :: i

    allocate (texts(merge(dataset%rows, 0_hsize_t, h5%status >= 0)))
    if (size(texts) == 0) return
    allocate (addresses(size(texts)))
    addresses = c_null_ptr
    call create_text_type(text_type, h5)
    if (h5%status >= 0) h5%status = h5dread(dataset%id, text_type, h5s_all, h5s_all, h5p_default, c_loc(addresses))
    call release([text_type], h5)
    do i = 1, size(texts)
      texts(i)%text = fortran_text(addresses(i))
    end do
  end subroutine read_texts

  !> Read the numbers of a dataset after its first `first` rows.
  subroutine read_rows(dataset, first, values, h5)
    type(dataset_t), intent(in) :: dataset
    integer(hsize_t), intent(in) :: first
    real(real64), intent(out), contiguous, target :: values(:)
    type(hdf5_t), intent(inout) :: h5
    integer(hid_t) :: rows_in_file, rows_in_memory

    if (size(values) == 0) return
    call select_rows(dataset, first, size(values, kind=hsize_t)/max(1_hsize_t, dataset%row_length), rows_in_file, &
      rows_in_memory, h5)
    if (h5%status >= 0) &
      h5%status = h5dread(dataset%id, h5t_native_double, rows_in_memory, rows_in_file, h5p_default, c_loc(values(1)))
    call release([rows_in_memory, rows_in_file], h5)
  end subroutine read_rows

  !> Make a column a dimension scale.
  subroutine make_scale(dataset, name, h5)
    type(dataset_t), intent(in) :: dataset
    character(*), intent(in) :: name
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) h5%status = h5dsset_scale(dataset%id, name//nul)
  end subroutine make_scale

  !> Make `scale` the coordinate of a dataset along a dimension: 1, the one that grows, or 2, along the rows.
  subroutine attach_scale(dataset, scale, side, h5)
    type(dataset_t), intent(in) :: dataset, scale
    integer, intent(in) :: side
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) h5%status = h5dsattach_scale(dataset%id, scale%id, side - 1)
  end subroutine attach_scale

  !> The names of all objects in a file or group, in alphabetical order; if there are many, the first ones.
  subroutine names_in(group, names, h5)
    integer(hid_t), intent(in) :: group
    type(path_t), allocatable, intent(out) :: names(:)
    type(hdf5_t), intent(inout) :: h5
    integer(hsize_t), parameter :: most_names = 1000
    character(257) :: name
    type(h5g_info_t) :: info
    integer(hsize_t) :: i

    info%links = 0
    if (h5%status >= 0) h5%status = h5gget_info(group, info)
    allocate (names(merge(min(info%links, most_names), 0_hsize_t, h5%status >= 0)))
    do i = 1, size(names)
      name = nul
      if (h5%status >= 0) h5%status = int(h5lget_name_by_idx(group, '.'//nul, h5_index_name, h5_iter_inc, i - 1_hsize_t, name, &
        len(name, c_size_t), h5p_default))
      names(i)%text = trim(name(:index(name, nul) - 1))
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

    call open_dataset(group, name, 1, dataset, h5)
    call check_size(name, dataset%id, dataset%rows, h5)
    if (h5%status >= 0) call h5%take(h5dget_type(dataset%id), stored_as)
    if (h5%status >= 0) h5%status = h5tget_class(stored_as)
    if (h5%status >= 0 .and. h5%status /= h5t_integer .and. h5%status /= h5t_float) call h5%refuse(name, 'holds no numbers')
    allocate (read(merge(dataset%rows, 0_hsize_t, h5%status >= 0)))
    call read_rows(dataset, 0_hsize_t, read, h5)
    call release([stored_as, dataset%id], h5)
    values = real(read, wp)
  end subroutine read_list

  subroutine create_text_type(text_type, h5)
    integer(hid_t), intent(out) :: text_type
    type(hdf5_t), intent(inout) :: h5

    if (h5%status >= 0) call h5%take(h5tcopy(h5t_c_s1), text_type)
    if (h5%status >= 0) h5%status = h5tset_size(text_type, h5t_variable)
    if (h5%status >= 0) h5%status = h5tset_cset(text_type, h5t_cset_utf8)
  end subroutine create_text_type

  !> The space of a single value: it has no dimensions.
  subroutine create_scalar(space, h5)
    integer(hid_t), intent(out) :: space
    type(hdf5_t), intent(inout) :: h5
    integer(hsize_t), parameter :: none(1) = 1

    if (h5%status >= 0) call h5%take(h5screate_simple(0, none, none), space)
  end subroutine create_scalar

  !> Text in the form that C uses.
  pure function c_bytes(text) result(bytes)
    character(*), intent(in) :: text
    character(c_char) :: bytes(len(text) + 1)

    bytes = transfer(text//nul, bytes)
  end function c_bytes
end module dst_hdf5_tools
