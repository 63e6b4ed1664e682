!> Names of files: where they lead, and what has these names.
module dst_paths
  use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_f_pointer, nul => c_null_char
  use dst_kinds, only: int64
  use dst_posix, only: c_forget_matches, c_free, c_matches, c_realpath, fortran_text
  implicit none
  private

  public :: path_t, matching_files, file_exists, is_folder, folder_of, stem_of, place_of, true_path

  !> The name of a file.
  type :: path_t
    character(:), allocatable :: text
  end type path_t

contains

  !> Whether a file of any kind has this name.
  logical function file_exists(file_name)
    character(*), intent(in) :: file_name

    inquire (file=file_name, exist=file_exists)
  end function file_exists

  !> Whether a folder has this name.
  logical function is_folder(file_name)
    character(*), intent(in) :: file_name

    inquire (file=file_name//'/.', exist=is_folder)
  end function is_folder

  !> The folder that contains a file; '.' if its name contains no folder.
  pure function folder_of(file_name) result(folder)
    character(*), intent(in) :: file_name
    character(:), allocatable :: folder
    integer :: slash

    slash = scan(file_name, '/', back=.true.)
    folder = '.'
    if (slash > 0) folder = file_name(:max(1, slash - 1))
  end function folder_of

  !> Length of a name without its extension. A dot that begins the name or is in a folder's name begins no extension.
  pure integer function stem_of(name)
    character(*), intent(in) :: name

    stem_of = index(name, '.', back=.true.) - 1
    if (stem_of <= index(name, '/', back=.true.)) stem_of = len(name)
  end function stem_of

  !> The file behind symbolic links; the name itself when there is no such file.
  function true_path(file_name) result(path)
    character(*), intent(in) :: file_name
    character(:), allocatable :: path
    type(c_ptr) :: resolved

    resolved = c_realpath(file_name//nul, c_null_ptr)
    path = fortran_text(resolved)
    if (path == '') path = file_name
    call c_free(resolved)
  end function true_path

  !> The same text for all names of one place, whether a file is there or not: its folder, and the file that links lead to.
  function place_of(file_name) result(place)
    character(*), intent(in) :: file_name
    character(:), allocatable :: place, folder

    if (file_exists(file_name)) then
      place = true_path(file_name)
    else
      folder = true_path(folder_of(file_name))
      if (folder == '/') folder = ''
      place = folder//'/'//file_name(index(file_name, '/', back=.true.) + 1:)
    end if
  end function place_of

  !> The files whose names begin with `beginning`, in alphabetical order.
  subroutine matching_files(beginning, files)
    character(*), intent(in) :: beginning
    type(path_t), allocatable, intent(out) :: files(:)
    type(c_ptr), pointer :: names(:)
    type(c_ptr) :: found, first_name
    integer(int64) :: count, i

    count = c_matches(beginning//nul, found, first_name)
    allocate (files(count))
    if (count > 0) call c_f_pointer(first_name, names, [count])
    do i = 1, count
      files(i)%text = fortran_text(names(i))
    end do
    call c_forget_matches(found)
  end subroutine matching_files
end module dst_paths
