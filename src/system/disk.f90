!> What a result file needs from the operating system: which file has a name, and why a call has failed, in words on which a user can
!> act. The calls themselves are in dst_posix. Nothing here depends on the format of the file.
module dst_disk
  use, intrinsic :: iso_c_binding, only: c_int, nul => c_null_char
  use dst_paths, only: path_t, matching_files, file_exists, is_folder, folder_of, place_of, true_path
  use dst_posix, only: c_close, c_look_up, c_reason, fortran_text, identity_t, operator(==)
  implicit none
  private

  public :: identity_t, identity_of, operator(==)
  public :: close_descriptor, system_reason, with_remedy, is_written
  ! From other modules.
  public :: path_t, matching_files, file_exists, is_folder, folder_of, place_of, true_path

  !> Identity of an open file, or of the file with a name; a symbolic link is not followed.
  interface identity_of
    module procedure identity_of_descriptor, identity_of_name
  end interface identity_of

  character(*), parameter :: is_written = 'another process is writing this file: wait until it ends, or use another name'

contains

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
