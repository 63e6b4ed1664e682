!> The functions of HDF5's C library that this program calls, and the library's constants, with their C names. What a name of a
!> function means is in the reference manual of HDF5; its version number, as in H5Dopen2, is left out here.
!>
!> All of them exist with the same arguments in HDF5 1.10, 1.12, 1.14 and 2.0: functions whose structures have changed, like
!> H5Lget_info, are not called. Every function returns a negative number if it fails, unless it returns a size. Texts end with NUL;
!> the dimension that varies slowest is the first.
module dst_hdf5_library
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_size_t, c_double, c_char, c_ptr, c_funptr
  implicit none
  public

  !> Kinds of identifiers, and of numbers of rows, values and bytes.
  integer, parameter :: hid_t = c_int64_t, hsize_t = c_int64_t

  !> Identifiers that stand for a default.
  integer(hid_t), parameter :: h5p_default = 0, h5s_all = 0, h5e_default = 0

  !> How files are opened, flushed and closed, and the oldest version of the format that they have.
  integer(c_int), parameter :: h5f_acc_rdonly = 0, h5f_acc_trunc = 2, h5f_close_strong = 3, &
    h5f_libver_v18 = 1

  !> Classes of types, character sets, layouts, filters, orders.
  integer(c_int), parameter :: h5t_integer = 0, h5t_float = 1, h5t_string = 3, h5t_cset_utf8 = 1, &
    h5s_select_set = 0, h5d_virtual = 3, h5_index_name = 0, h5_iter_inc = 0, &
    h5e_walk_upward = 0

  !> Sizes without an upper bound.
  integer(hsize_t), parameter :: h5s_unlimited = -1
  integer(c_size_t), parameter :: h5t_variable = -1

  !> Types and classes of properties. hdf5_constants.c copies them from the library's variables when h5open is called: a variable
  !> with bind(c) in a module is another one than that of a shared library.
  integer(hid_t), protected, bind(c) :: h5t_c_s1, h5t_ieee_f64le, h5t_native_double, h5t_native_int, h5t_std_i8le, h5t_std_i32le, &
    h5t_std_i64le, h5p_dataset_access, h5p_dataset_create, h5p_dataset_xfer, h5p_file_access

  !> What the library says about a group (H5G_info_t).
  type, bind(c) :: h5g_info_t
    integer(c_int) :: storage
    integer(hsize_t) :: links
    integer(c_int64_t) :: order, is_mounted
  end type h5g_info_t

  !> One entry of the library's stack of errors (H5E_error2_t).
  type, bind(c) :: h5e_error_t
    integer(hid_t) :: class, major, minor
    integer(c_int) :: line
    type(c_ptr) :: procedure_name, source_file, description
  end type h5e_error_t

  ! Each has its own interface: for a procedure that is declared by an abstract one gfortran 12 passes values by reference.
  interface
    integer(hid_t) function h5acreate(object, name, stored_as, space, creation, access) bind(c, name='H5Acreate2')
      import :: c_char, hid_t
      integer(hid_t), value :: object, stored_as, space, creation, access
      character(c_char), intent(in) :: name(*)
    end function h5acreate
    integer(c_int) function h5aexists(object, name) bind(c, name='H5Aexists')
      import :: c_int, c_char, hid_t
      integer(hid_t), value :: object
      character(c_char), intent(in) :: name(*)
    end function h5aexists
    integer(hid_t) function h5aget_space(object) bind(c, name='H5Aget_space')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5aget_space
    integer(hid_t) function h5aget_type(object) bind(c, name='H5Aget_type')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5aget_type
    integer(hid_t) function h5aopen(object, name, access) bind(c, name='H5Aopen')
      import :: c_char, hid_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: name(*)
    end function h5aopen
    integer(c_int) function h5aread(attribute, memory_type, values) bind(c, name='H5Aread')
      import :: c_int, c_ptr, hid_t
      integer(hid_t), value :: attribute, memory_type
      type(c_ptr), value :: values
    end function h5aread
    integer(c_int) function h5awrite(attribute, memory_type, values) bind(c, name='H5Awrite')
      import :: c_int, c_ptr, hid_t
      integer(hid_t), value :: attribute, memory_type
      type(c_ptr), value :: values
    end function h5awrite
    integer(hid_t) function h5dcreate(object, name, stored_as, space, links, creation, access) bind(c, name='H5Dcreate2')
      import :: c_char, hid_t
      integer(hid_t), value :: object, stored_as, space, links, creation, access
      character(c_char), intent(in) :: name(*)
    end function h5dcreate
    integer(hid_t) function h5dget_create_plist(object) bind(c, name='H5Dget_create_plist')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5dget_create_plist
    integer(hid_t) function h5dget_space(object) bind(c, name='H5Dget_space')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5dget_space
    integer(hsize_t) function h5dget_storage_size(object) bind(c, name='H5Dget_storage_size')
      import :: hid_t, hsize_t
      integer(hid_t), value :: object
    end function h5dget_storage_size
    integer(hid_t) function h5dget_type(object) bind(c, name='H5Dget_type')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5dget_type
    integer(c_int) function h5dont_atexit() bind(c, name='H5dont_atexit')
      import :: c_int
    end function h5dont_atexit
    integer(hid_t) function h5dopen(object, name, access) bind(c, name='H5Dopen2')
      import :: c_char, hid_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: name(*)
    end function h5dopen
    integer(c_int) function h5dread(dataset, memory_type, in_memory, in_file, transfer, values) bind(c, name='H5Dread')
      import :: c_int, c_ptr, hid_t
      integer(hid_t), value :: dataset, memory_type, in_memory, in_file, transfer
      type(c_ptr), value :: values
    end function h5dread
    integer(c_int) function h5dsattach_scale(dataset, scale, side) bind(c, name='H5DSattach_scale')
      import :: c_int, hid_t
      integer(hid_t), value :: dataset, scale
      integer(c_int), value :: side
    end function h5dsattach_scale
    integer(c_int) function h5dset_extent(dataset, sides) bind(c, name='H5Dset_extent')
      import :: c_int, hid_t, hsize_t
      integer(hid_t), value :: dataset
      integer(hsize_t), intent(in) :: sides(*)
    end function h5dset_extent
    integer(c_int) function h5dsset_scale(object, name) bind(c, name='H5DSset_scale')
      import :: c_int, c_char, hid_t
      integer(hid_t), value :: object
      character(c_char), intent(in) :: name(*)
    end function h5dsset_scale
    integer(c_int) function h5dwrite(dataset, memory_type, in_memory, in_file, transfer, values) bind(c, name='H5Dwrite')
      import :: c_int, c_ptr, hid_t
      integer(hid_t), value :: dataset, memory_type, in_memory, in_file, transfer
      type(c_ptr), value :: values
    end function h5dwrite
    integer(c_int) function h5eset_auto(stack, print, user_data) bind(c, name='H5Eset_auto2')
      import :: c_int, c_ptr, c_funptr, hid_t
      integer(hid_t), value :: stack
      type(c_funptr), value :: print
      type(c_ptr), value :: user_data
    end function h5eset_auto
    integer(c_int) function h5ewalk(stack, direction, visit, user_data) bind(c, name='H5Ewalk2')
      import :: c_int, c_ptr, c_funptr, hid_t
      integer(hid_t), value :: stack
      integer(c_int), value :: direction
      type(c_funptr), value :: visit
      type(c_ptr), value :: user_data
    end function h5ewalk
    integer(c_int) function h5fclose(object) bind(c, name='H5Fclose')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5fclose
    integer(hid_t) function h5fcreate(name, mode, creation, access) bind(c, name='H5Fcreate')
      import :: c_int, c_char, hid_t
      character(c_char), intent(in) :: name(*)
      integer(c_int), value :: mode
      integer(hid_t), value :: creation, access
    end function h5fcreate
    integer(c_int) function h5fget_filesize(file, bytes) bind(c, name='H5Fget_filesize')
      import :: c_int, hid_t, hsize_t
      integer(hid_t), value :: file
      integer(hsize_t), intent(out) :: bytes
    end function h5fget_filesize
    integer(hid_t) function h5fopen(name, mode, access) bind(c, name='H5Fopen')
      import :: c_int, c_char, hid_t
      character(c_char), intent(in) :: name(*)
      integer(c_int), value :: mode
      integer(hid_t), value :: access
    end function h5fopen
    integer(hid_t) function h5gcreate(object, name, links, creation, access) bind(c, name='H5Gcreate2')
      import :: c_char, hid_t
      integer(hid_t), value :: object, links, creation, access
      character(c_char), intent(in) :: name(*)
    end function h5gcreate
    integer(c_int) function h5gget_info(group, info) bind(c, name='H5Gget_info')
      import :: c_int, hid_t, h5g_info_t
      integer(hid_t), value :: group
      type(h5g_info_t), intent(out) :: info
    end function h5gget_info
    integer(hid_t) function h5gopen(object, name, access) bind(c, name='H5Gopen2')
      import :: c_char, hid_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: name(*)
    end function h5gopen
    integer(c_int) function h5idec_ref(object) bind(c, name='H5Idec_ref')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5idec_ref
    integer(hid_t) function h5iget_file_id(object) bind(c, name='H5Iget_file_id')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5iget_file_id
    integer(c_int) function h5lexists(object, name, access) bind(c, name='H5Lexists')
      import :: c_int, c_char, hid_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: name(*)
    end function h5lexists
    integer(c_size_t) function h5lget_name_by_idx(object, group, kind, order, place, name, size, access) &
      bind(c, name='H5Lget_name_by_idx')
      import :: c_int, c_char, c_size_t, hid_t, hsize_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: group(*)
      integer(c_int), value :: kind, order
      integer(hsize_t), value :: place
      character(c_char), intent(inout) :: name(*)
      integer(c_size_t), value :: size
    end function h5lget_name_by_idx
    integer(c_int) function h5lget_val(object, name, value, size, access) bind(c, name='H5Lget_val')
      import :: c_int, c_char, c_ptr, c_size_t, hid_t
      integer(hid_t), value :: object, access
      character(c_char), intent(in) :: name(*)
      type(c_ptr), value :: value
      integer(c_size_t), value :: size
    end function h5lget_val
    integer(c_int) function h5open() bind(c, name='dst_h5open')
      import :: c_int
    end function h5open
    integer(hid_t) function h5pcreate(object) bind(c, name='H5Pcreate')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5pcreate
    integer(c_int) function h5pget_external_count(object) bind(c, name='H5Pget_external_count')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5pget_external_count
    integer(c_int) function h5pget_layout(object) bind(c, name='H5Pget_layout')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5pget_layout
    integer(c_int) function h5pset_buffer(transfer, bytes, conversion, background) bind(c, name='H5Pset_buffer')
      import :: c_int, c_ptr, c_size_t, hid_t
      integer(hid_t), value :: transfer
      integer(c_size_t), value :: bytes
      type(c_ptr), value :: conversion, background
    end function h5pset_buffer
    integer(c_int) function h5pset_chunk(creation, rank, sides) bind(c, name='H5Pset_chunk')
      import :: c_int, hid_t, hsize_t
      integer(hid_t), value :: creation
      integer(c_int), value :: rank
      integer(hsize_t), intent(in) :: sides(*)
    end function h5pset_chunk
    integer(c_int) function h5pset_fill_value(creation, memory_type, value) bind(c, name='H5Pset_fill_value')
      import :: c_int, c_ptr, hid_t
      integer(hid_t), value :: creation, memory_type
      type(c_ptr), value :: value
    end function h5pset_fill_value
    integer(c_int) function h5pset_chunk_cache(access, slots, bytes, preemption) bind(c, name='H5Pset_chunk_cache')
      import :: c_int, c_size_t, c_double, hid_t
      integer(hid_t), value :: access
      integer(c_size_t), value :: slots, bytes
      real(c_double), value :: preemption
    end function h5pset_chunk_cache
    integer(c_int) function h5pset_fclose_degree(object, choice) bind(c, name='H5Pset_fclose_degree')
      import :: c_int, hid_t
      integer(hid_t), value :: object
      integer(c_int), value :: choice
    end function h5pset_fclose_degree
    integer(c_int) function h5pset_libver_bounds(access, lowest, highest) bind(c, name='H5Pset_libver_bounds')
      import :: c_int, hid_t
      integer(hid_t), value :: access
      integer(c_int), value :: lowest, highest
    end function h5pset_libver_bounds
    integer(hid_t) function h5screate_simple(rank, sides, largest) bind(c, name='H5Screate_simple')
      import :: c_int, hid_t, hsize_t
      integer(c_int), value :: rank
      integer(hsize_t), intent(in) :: sides(*), largest(*)
    end function h5screate_simple
    integer(c_int) function h5sget_simple_extent_ndims(object) bind(c, name='H5Sget_simple_extent_ndims')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5sget_simple_extent_ndims
    integer(hsize_t) function h5sget_simple_extent_npoints(object) bind(c, name='H5Sget_simple_extent_npoints')
      import :: hid_t, hsize_t
      integer(hid_t), value :: object
    end function h5sget_simple_extent_npoints
    integer(c_int) function h5sselect_hyperslab(space, how, from, stride, sides, block) bind(c, name='H5Sselect_hyperslab')
      import :: c_int, c_ptr, hid_t, hsize_t
      integer(hid_t), value :: space
      integer(c_int), value :: how
      integer(hsize_t), intent(in) :: from(*), sides(*)
      type(c_ptr), value :: stride, block
    end function h5sselect_hyperslab
    integer(hid_t) function h5tcopy(object) bind(c, name='H5Tcopy')
      import :: hid_t
      integer(hid_t), value :: object
    end function h5tcopy
    integer(c_int) function h5tget_class(object) bind(c, name='H5Tget_class')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5tget_class
    integer(c_size_t) function h5tget_size(type) bind(c, name='H5Tget_size')
      import :: c_size_t, hid_t
      integer(hid_t), value :: type
    end function h5tget_size
    integer(c_int) function h5tis_variable_str(object) bind(c, name='H5Tis_variable_str')
      import :: c_int, hid_t
      integer(hid_t), value :: object
    end function h5tis_variable_str
    integer(c_int) function h5tset_cset(object, choice) bind(c, name='H5Tset_cset')
      import :: c_int, hid_t
      integer(hid_t), value :: object
      integer(c_int), value :: choice
    end function h5tset_cset
    integer(c_int) function h5tset_size(type, bytes) bind(c, name='H5Tset_size')
      import :: c_int, c_size_t, hid_t
      integer(hid_t), value :: type
      integer(c_size_t), value :: bytes
    end function h5tset_size
  end interface
end module dst_hdf5_library
