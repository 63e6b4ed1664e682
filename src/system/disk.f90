!> What a result file needs from the operating system: whether it may be created, its lock, and its rename into place.
!>
!> Failures are returned as reasons on which a user can act. Nothing here depends on the format of the file.
module dst_disk
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_char, nul => c_null_char
  use dst_kinds, only: wp, int64
  use dst_paths, only: path_t, matching_files, file_exists, is_folder, folder_of, place_of, true_path
  use dst_posix, only: c_close, c_errno, c_flock, c_free_space, c_fsync, c_keep_mode, c_link, c_look_up, c_open, c_read, c_reason, &
    c_rename, c_unlink, c_write, dst_eexist, dst_eloop, dst_enoent, dst_ewouldblock, dst_lock_ex, dst_lock_nb, dst_lock_sh, &
    dst_o_creat, dst_o_excl, dst_o_nofollow, dst_o_nonblock, dst_o_rdonly, dst_o_rdwr, fortran_text, set_file_size
  implicit none
  private

  public :: identity_t, identity_of, operator(==)
  public :: free_space, move_file, place_file, delete_file, delete_own_file
  public :: read_at, write_at, make_durable, make_name_durable
  public :: lock_new_file, is_locked, keep_mode, open_regular, close_descriptor
  public :: system_reason, with_remedy
  ! From other modules.
  public :: set_file_size
  public :: path_t, matching_files, file_exists, is_folder, folder_of, place_of, true_path

  !> Identity of a file, whatever its name is.
  type :: identity_t
    logical :: exists = .false.
    logical :: is_regular = .false.       !! neither a folder, a link, a device nor a pipe
    integer(int64) :: bytes = 0
    integer(int64) :: changed = 0         !! time of the last change of its bytes [s since 1970]
    integer(int64), private :: inode = 0, device = 0
  end type identity_t

  !> Whether two names, or two moments, refer to one file.
  interface operator(==)
    module procedure same_file
  end interface operator(==)

  !> Identity of an open file, or of the file with a name.
  interface identity_of
    module procedure identity_of_descriptor, identity_of_name
  end interface identity_of

contains

  !> Identity of the open file.
  type(identity_t) function identity_of_descriptor(descriptor) result(identity)
    integer(c_int), intent(in) :: descriptor

    identity = looked_up(descriptor, '')
  end function identity_of_descriptor

  !> Identity of the file with this name; a symbolic link is not followed.
  type(identity_t) function identity_of_name(file_name) result(identity)
    character(*), intent(in) :: file_name

    identity = looked_up(-1_c_int, file_name)
  end function identity_of_name

  type(identity_t) function looked_up(descriptor, path) result(identity)
    integer(c_int), intent(in) :: descriptor
    character(*), intent(in) :: path
    integer(c_int64_t) :: facts(5)

    identity%exists = c_look_up(descriptor, path//nul, facts) == 0
    if (identity%exists) identity = identity_t(.true., facts(1) /= 0, facts(2), facts(3), facts(4), facts(5))
  end function looked_up

  pure logical function same_file(a, b)
    type(identity_t), intent(in) :: a, b

    same_file = a%exists .and. b%exists .and. a%inode == b%inode .and. a%device == b%device
  end function same_file

  !> Number of bytes that may still be written in a folder; `huge` if the file system does not report it. Quotas are not considered.
  real(wp) function free_space(folder)
    character(*), intent(in) :: folder

    free_space = real(c_free_space(folder//nul), wp)
    if (free_space < 0.0_wp) free_space = huge(free_space)
  end function free_space

  !> Move a file over another in one step.
  subroutine move_file(from, to, moved)
    character(*), intent(in) :: from, to
    logical, intent(out) :: moved

    moved = c_rename(from//nul, to//nul) == 0
  end subroutine move_file

  !> Give a new file its name, unless a file with that name was created meanwhile.
  subroutine place_file(from, to, placed)
    character(*), intent(in) :: from, to
    logical, intent(out) :: placed

    placed = c_link(from//nul, to//nul) == 0
    if (placed) then
      call delete_file(from)
    else if (.not. file_exists(to)) then
      ! For a file system without hard links.
      call move_file(from, to, placed)
    end if
  end subroutine place_file

  !> Open the file with this name, which is created if necessary, for reading and writing, and lock it until it is closed.
  subroutine lock_new_file(file_name, descriptor, is_held, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    logical, intent(out) :: is_held                    !! another process has locked it: the reason
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(int64) :: ignored
    logical :: is_new

    is_held = .false.
    do
      descriptor = c_open(file_name//nul, dst_o_rdwr + dst_o_creat + dst_o_excl)
      is_new = descriptor >= 0
      if (.not. is_new) then
        if (c_errno() == dst_eexist) then
          call open_regular(file_name, .true., descriptor, ignored, reason)
          ! The process that had it may have removed it meanwhile.
          if (allocated(reason) .and. .not. is_there(file_name)) cycle
        else
          reason = system_reason()
        end if
        if (allocated(reason)) return
      end if
      if (c_flock(descriptor, dst_lock_ex + dst_lock_nb) /= 0) then
        is_held = c_errno() == dst_ewouldblock
        if (is_held) then
          reason = 'another process has locked it'
        else if (.not. is_new) then
          reason = 'this file system has no locks, and '//file_name//' is there: if no process writes it, remove it'
        end if
      end if
      if (.not. allocated(reason)) then
        if (identity_of(file_name) == identity_of(descriptor)) return
      end if
      call close_descriptor(descriptor)
      if (allocated(reason)) return
    end do
  end subroutine lock_new_file

  !> Whether a process has locked this file for itself alone.
  logical function is_locked(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: reason
    integer(c_int) :: descriptor
    integer(int64) :: ignored

    is_locked = .false.
    call open_regular(file_name, .false., descriptor, ignored, reason)
    if (allocated(reason)) return
    if (c_flock(descriptor, dst_lock_sh + dst_lock_nb) /= 0) is_locked = c_errno() == dst_ewouldblock
    call close_descriptor(descriptor)
  end function is_locked

  logical function is_there(file_name)
    character(*), intent(in) :: file_name
    type(identity_t) :: file

    file = identity_of(file_name)
    is_there = file%exists
  end function is_there

  !> Give an open file the permissions of the file with this name.
  subroutine keep_mode(file_name, descriptor)
    character(*), intent(in) :: file_name
    integer(c_int), intent(in) :: descriptor

    call c_keep_mode(file_name//nul, descriptor)
  end subroutine keep_mode

  !> Write `count` bytes into an open file, from byte `place` on (0 is the first).
  subroutine write_at(descriptor, place, bytes, count, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: place, count
    character(c_char), intent(in) :: bytes(*)
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    if (c_write(descriptor, bytes, count, place) /= 0) reason = system_reason()
  end subroutine write_at

  !> Read an open file from byte `place` (0 is the first); `complete`: as many bytes as requested are there.
  subroutine read_at(descriptor, place, bytes, complete)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: place
    character(c_char), intent(inout), contiguous :: bytes(:)   !! bytes after the end of the file are unchanged
    logical, intent(out) :: complete

    complete = c_read(descriptor, bytes, size(bytes, kind=int64), place) == size(bytes, kind=int64)
  end subroutine read_at

  !> Open the file with this name itself, never the target of a link, if it is a regular file.
  subroutine open_regular(file_name, for_writing, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    logical, intent(in) :: for_writing                 !! and for reading
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes               !! of the file
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(identity_t) :: file

    ! O_NONBLOCK, since opening a pipe would wait for its other end.
    descriptor = c_open(file_name//nul, merge(dst_o_rdwr, dst_o_rdonly, for_writing) + dst_o_nonblock + dst_o_nofollow)
    if (descriptor >= 0) file = identity_of(descriptor)
    bytes = file%bytes
    if (file%is_regular) return
    if (descriptor >= 0) then
      reason = 'it is not a regular file: remove it, or use another name'
    else if (c_errno() == dst_enoent) then
      reason = 'it was removed meanwhile, or its folder was: find out which program uses it, and start again'
    else if (c_errno() == dst_eloop) then
      reason = 'it is a symbolic link: remove it, or use another name'
    else
      reason = system_reason()
    end if
    call close_descriptor(descriptor)
  end subroutine open_regular

  !> Close a file, if one is open; the descriptor is -1 afterwards.
  subroutine close_descriptor(descriptor)
    integer(c_int), intent(inout) :: descriptor
    integer(c_int) :: ignored

    if (descriptor >= 0) ignored = c_close(descriptor)
    descriptor = -1
  end subroutine close_descriptor

  !> Make a closed file, or the entries of a folder, survive a power failure, if the system can do that.
  subroutine make_name_durable(name)
    character(*), intent(in) :: name
    integer(c_int) :: descriptor, ignored

    descriptor = c_open(name//nul, dst_o_rdonly)
    if (descriptor < 0) return
    ignored = c_fsync(descriptor)
    call close_descriptor(descriptor)
  end subroutine make_name_durable

  !> Make the data written to the open file survive a power failure.
  subroutine make_durable(descriptor, reason)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    if (c_fsync(descriptor) /= 0) reason = system_reason()
  end subroutine make_durable

  !> Why the last system call failed, and what to do.
  function system_reason() result(reason)
    character(:), allocatable :: reason

    reason = with_remedy(fortran_text(c_reason()))
  end function system_reason

  !> Remove a file, if it exists.
  subroutine delete_file(file_name)
    character(*), intent(in) :: file_name
    integer(c_int) :: ignored

    ignored = c_unlink(file_name//nul)
  end subroutine delete_file

  !> Remove the file `identity`, if it still has this name.
  subroutine delete_own_file(file_name, identity)
    character(*), intent(in) :: file_name
    type(identity_t), intent(in) :: identity

    if (identity_of(file_name) == identity) call delete_file(file_name)
  end subroutine delete_own_file

  !> A reason from the system, followed by what the user can do about it.
  pure function with_remedy(system_reason) result(reason)
    character(*), intent(in) :: system_reason
    character(:), allocatable :: reason

    character(*), parameter :: words(7) = [character(17) :: 'No space left', 'File too large', 'quota', 'No such file', &
      'stat info', 'Permission denied', 'Read-only']
    character(*), parameter :: remedies(7) = [character(72) :: &
      'the disk is full: free some space or write to another disk', &
      'the file-size limit is reached: raise it with "ulimit -f unlimited"', &
      'the disk quota is used up: free some space or write to another disk', &
      'the file or its folder was removed or renamed', 'the file or its folder was removed or renamed', &
      'no permission to write there: choose another folder with -o', &
      'the file system is read-only: choose another folder with -o']
    integer :: i

    reason = system_reason
    do i = size(words), 1, -1
      if (index(system_reason, trim(words(i))) > 0) reason = trim(remedies(i))
    end do
  end function with_remedy
end module dst_disk
