!> Names of files: where they lead, and which file has a name; and why a call of the system has failed, in words on which a user can
!> act. The calls themselves are in dst_posix. Nothing here depends on the format of a file.
module dst_disk
  use, intrinsic :: iso_c_binding, only: c_int, c_ptr, c_null_ptr, c_f_pointer, nul => c_null_char
  use dst_kinds, only: int64
  use dst_posix, only: c_close, c_forget_matches, c_free, c_look_up, c_matches, c_realpath, c_reason, fortran_text, identity_t, &
    operator(==)
  implicit none
  private

  public :: path_t, matching_files, file_exists, is_folder, folder_of, stem_of, place_of, true_path
  public :: identity_t, identity_of, operator(==)
  public :: close_descriptor, system_reason, with_remedy, is_written

  !> The name of a file, or another word of the command line.
  type :: path_t
    character(:), allocatable :: text
  end type path_t

  !> Identity of an open file, or of the file with a name; a symbolic link is not followed.
  interface identity_of
    module procedure identity_of_descriptor, identity_of_name
  end interface identity_of

  !> The reason that a file is locked.
  character(*), parameter :: is_written = 'another process is writing this file: wait until it ends, or use another name'

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
  type(identity_t) function identity_of_descriptor(descriptor) result(identity)
    integer(c_int), intent(in) :: descriptor

    call c_look_up(descriptor, nul, identity)
  end function identity_of_descriptor

  type(identity_t) function identity_of_name(file_name) result(identity)
    character(*), intent(in) :: file_name

    call c_look_up(-1_c_int, file_name//nul, identity)
  end function identity_of_name

  !> Close a file, if one is open; the descriptor is -1 afterwards.
  subroutine close_descriptor(descriptor)
    integer(c_int), intent(inout) :: descriptor
    integer(c_int) :: ignored

    if (descriptor >= 0) ignored = c_close(descriptor)
    descriptor = -1
  end subroutine close_descriptor

  !> Why the last system call failed, and what to do.
  function system_reason() result(reason)
    character(:), allocatable :: reason

    reason = with_remedy(fortran_text(c_reason()))
  end function system_reason

  !> A reason from the system, followed by what the user can do about it.
  pure function with_remedy(system_reason) result(reason)
    character(*), intent(in) :: system_reason
    character(:), allocatable :: reason

    character(*), parameter :: words(11) = [character(17) :: 'No space left', 'File too large', 'quota', 'No such file', &
      'stat info', 'Permission denied', 'Read-only', 'ymbolic link', 'Is a directory', 'No locks', 'Resource temporar']
    character(*), parameter :: remedies(11) = [character(96) :: &
      'the disk is full: free some space or write to another disk', &
      'the file-size limit is reached: raise it with "ulimit -f unlimited"', &
      'the disk quota is used up: free some space or write to another disk', &
      'the file or its folder was removed or renamed', 'the file or its folder was removed or renamed', &
      'no permission to write there: choose another folder with -o', &
      'the file system is read-only: choose another folder with -o', &
      'it is a symbolic link: remove it, or use another name', &
      'it is not a regular file: remove it, or use another name', &
      'this file system has no locks, and its .part is there: if no process writes it, remove it', &
      is_written]
    integer :: i

    reason = system_reason
    do i = size(words), 1, -1
      if (index(system_reason, trim(words(i))) > 0) reason = trim(remedies(i))
    end do
  end function with_remedy
end module dst_disk
