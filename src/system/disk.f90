!> What a result file asks of the operating system: may it be created, is there room for it, put it in its place.
!>
!> Reasons come back as the words a user can act upon. POSIX; nothing here knows the file's format.
module dst_disk
  use, intrinsic :: iso_c_binding, only: c_int, c_int16_t, c_int32_t, c_int64_t, c_intptr_t, c_char, c_ptr, c_funptr, c_size_t, &
    c_null_char, c_null_ptr, c_null_funptr, c_associated, c_f_pointer, c_loc
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: identity_t, identity_of, operator(==)
  public :: reserve_space, set_file_size, move_file, place_file, delete_file, delete_own_file
  public :: read_bytes, read_at, write_bytes, create_file, open_own_file, make_durable, make_name_durable
  public :: lock_attempt, locked, held, without_locks, lock_file, unlock_file, is_in_use, wait_seconds
  public :: open_for_appending, open_for_reading, is_locked_elsewhere, process_with_lock, append_words, read_words, close_descriptor
  public :: matching_files, path_t
  public :: file_exists, file_size, is_folder, folder_of, place_of, true_path, unique_word
  public :: system_error, system_reason, locked_by_a_reader, with_remedy, ignore_size_limit_signal
  public :: utc_now, utc_of, utc_at, seconds_now

  !> HDF5's lock is not to be had.
  character(*), parameter :: locked_by_a_reader = &
    'locked by another process, or the file system has no locks: close the other program, or use a disk that has locks'

  !> What became of an attempt to lock.
  integer, parameter :: locked = 0, held = 1, without_locks = 2

  ! Error numbers that mean "no room" on Linux.
  integer(c_int), parameter :: efbig = 27, enospc = 28, edquot = 122
  integer(c_int), parameter :: sigxfsz = 25

  ! Numbers of Linux.
  integer(c_int), parameter :: interrupted = 4, try_again = 11
  integer(c_int), parameter :: read_only = 0, read_write = 2, create_exclusively = 64 + 128, not_in_programs = 524288
  integer(c_int), parameter :: as_the_mask_says = int(o'666', c_int)

  !> Which file it is, whatever its name.
  type :: identity_t
    logical :: exists = .false.
    logical :: is_regular = .false.       !! not a folder, a link, a device, a pipe
    integer(int64) :: bytes = 0
    integer(int64) :: changed = 0         !! its bytes, last time [s since 1970]
    integer(int64), private :: inode = 0
    integer(c_int32_t), private :: device(2) = 0
  end type identity_t

  !> Two names, or two moments, of one file.
  interface operator(==)
    module procedure same_file
  end interface operator(==)

  !> Of an open file, or of what has a name.
  interface identity_of
    module procedure identity_of_descriptor, identity_of_name
  end interface identity_of

  !> What statx() tells (struct statx).
  type, bind(c) :: statx_t
    integer(c_int32_t) :: mask = 0, block_size = 0
    integer(c_int64_t) :: attributes = 0
    integer(c_int32_t) :: links = 0, user = 0, group = 0
    integer(c_int16_t) :: mode = 0, spare = 0
    integer(c_int64_t) :: inode = 0, bytes = 0, blocks = 0, attributes_mask = 0, times(8) = 0
    integer(c_int32_t) :: own_device(2) = 0, device(2) = 0
    integer(c_int64_t) :: others(14) = 0
  end type statx_t

  !> Soft and hard limit (struct rlimit).
  type, bind(c) :: limits_t
    integer(c_int64_t) :: soft = -1, hard = -1
  end type limits_t

  !> The name of a file.
  type :: path_t
    character(:), allocatable :: text
  end type path_t

  !> What glob() finds: the first members of glob_t, and room for the others.
  type, bind(c) :: found_paths_t
    integer(c_size_t) :: count = 0
    type(c_ptr) :: paths = c_null_ptr
    integer(c_int64_t) :: others(16) = 0
  end type found_paths_t

  interface
    integer(c_int) function c_glob(pattern, flags, on_error, found) bind(c, name='glob')
      import :: c_int, c_char, c_ptr, found_paths_t
      character(c_char), intent(in) :: pattern(*)
      integer(c_int), value :: flags
      type(c_ptr), value :: on_error
      type(found_paths_t), intent(inout) :: found
    end function c_glob

    subroutine c_globfree(found) bind(c, name='globfree')
      import :: found_paths_t
      type(found_paths_t), intent(inout) :: found
    end subroutine c_globfree

    integer(c_int) function c_statx(folder, path, flags, mask, found) bind(c, name='statx')
      import :: c_int, c_char, statx_t
      integer(c_int), value :: folder
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: flags, mask
      type(statx_t), intent(out) :: found
    end function c_statx

    integer(c_int) function c_fallocate(descriptor, mode, offset, length) bind(c, name='fallocate')
      import :: c_int, c_int64_t
      integer(c_int), value :: descriptor, mode
      integer(c_int64_t), value :: offset, length
    end function c_fallocate

    integer(c_int) function c_getrlimit(resource, limits) bind(c, name='getrlimit')
      import :: c_int, limits_t
      integer(c_int), value :: resource
      type(limits_t), intent(out) :: limits
    end function c_getrlimit

    integer(c_intptr_t) function c_pread(descriptor, bytes, count, offset) bind(c, name='pread')
      import :: c_int, c_int64_t, c_intptr_t, c_ptr, c_size_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
      integer(c_int64_t), value :: offset
    end function c_pread

    integer(c_int) function ftruncate(descriptor, length) bind(c)
      import :: c_int, c_int64_t
      integer(c_int), value :: descriptor
      integer(c_int64_t), value :: length
    end function ftruncate

    integer(c_int) function c_rename(from, to) bind(c, name='rename')
      import :: c_int, c_char
      character(c_char), intent(in) :: from(*), to(*)
    end function c_rename

    integer(c_int) function c_link(from, to) bind(c, name='link')
      import :: c_int, c_char
      character(c_char), intent(in) :: from(*), to(*)
    end function c_link

    integer(c_int) function c_open(path, flags, permissions) bind(c, name='open')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: flags, permissions
    end function c_open

    integer(c_intptr_t) function c_write(descriptor, bytes, count) bind(c, name='write')
      import :: c_int, c_intptr_t, c_ptr, c_size_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
    end function c_write

    integer(c_intptr_t) function c_pwrite(descriptor, bytes, count, offset) bind(c, name='pwrite')
      import :: c_int, c_int64_t, c_intptr_t, c_ptr, c_size_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
      integer(c_int64_t), value :: offset
    end function c_pwrite

    integer(c_int) function c_fsync(descriptor) bind(c, name='fsync')
      import :: c_int
      integer(c_int), value :: descriptor
    end function c_fsync

    integer(c_int) function c_close(descriptor) bind(c, name='close')
      import :: c_int
      integer(c_int), value :: descriptor
    end function c_close

    type(c_ptr) function c_error_number() bind(c, name='__errno_location')
      import :: c_ptr
    end function c_error_number

    integer(c_int) function c_flock(descriptor, operation) bind(c, name='flock')
      import :: c_int
      integer(c_int), value :: descriptor, operation
    end function c_flock

    integer(c_int) function c_usleep(microseconds) bind(c, name='usleep')
      import :: c_int
      integer(c_int), value :: microseconds
    end function c_usleep

    integer(c_int) function c_unlink(path) bind(c, name='unlink')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
    end function c_unlink

    type(c_ptr) function c_realpath(path, resolved) bind(c, name='realpath')
      import :: c_ptr, c_char
      character(c_char), intent(in) :: path(*)
      type(c_ptr), value :: resolved
    end function c_realpath

    type(c_ptr) function c_strerror(number) bind(c, name='strerror')
      import :: c_ptr, c_int
      integer(c_int), value :: number
    end function c_strerror

    integer(c_size_t) function c_strlen(string) bind(c, name='strlen')
      import :: c_size_t, c_ptr
      type(c_ptr), value :: string
    end function c_strlen

    subroutine c_free(address) bind(c, name='free')
      import :: c_ptr
      type(c_ptr), value :: address
    end subroutine c_free

    integer(c_intptr_t) function c_time(moment) bind(c, name='time')
      import :: c_intptr_t, c_ptr
      type(c_ptr), value :: moment
    end function c_time

    integer(c_int) function c_getpid() bind(c, name='getpid')
      import :: c_int
    end function c_getpid

    type(c_funptr) function c_signal(number, handler) bind(c, name='signal')
      import :: c_int, c_funptr
      integer(c_int), value :: number
      type(c_funptr), value :: handler
    end function c_signal
  end interface

contains

  !> The file that is open.
  type(identity_t) function identity_of_descriptor(descriptor) result(identity)
    integer(c_int), intent(in) :: descriptor
    integer(c_int), parameter :: the_descriptor_itself = 4096

    identity = looked_up(descriptor, '', the_descriptor_itself)
  end function identity_of_descriptor

  !> What has this name; a symbolic link is not followed.
  type(identity_t) function identity_of_name(file_name) result(identity)
    character(*), intent(in) :: file_name
    integer(c_int), parameter :: current_folder = -100, not_followed = 256

    identity = looked_up(current_folder, file_name, not_followed)
  end function identity_of_name

  type(identity_t) function looked_up(folder, path, flags) result(identity)
    integer(c_int), intent(in) :: folder, flags
    character(*), intent(in) :: path
    integer(c_int), parameter :: basic_facts = 2047, kind_of_file = 61440, regular_file = 32768
    type(statx_t) :: found

    identity%exists = c_statx(folder, c_text(path), flags, basic_facts, found) == 0
    if (.not. identity%exists) return
    identity%is_regular = iand(int(found%mode, c_int), kind_of_file) == regular_file
    identity%bytes = found%bytes
    identity%changed = found%times(7)
    identity%inode = found%inode
    identity%device = found%device
  end function looked_up

  pure logical function same_file(a, b)
    type(identity_t), intent(in) :: a, b

    same_file = a%exists .and. b%exists .and. a%inode == b%inode .and. all(a%device == b%device)
  end function same_file

  !> See that the open file can grow from `present` to `length` bytes. Where the file system cannot reserve, zeros are written
  !> behind the file's end, once.
  subroutine reserve_space(descriptor, present, length, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: present, length
    character(:), allocatable, intent(out) :: reason   !! unallocated when there is room
    integer(c_int), parameter :: file_size_limit = 1, keep_size = 1
    type(limits_t) :: limits
    integer(c_int) :: number

    number = 0
    if (c_getrlimit(file_size_limit, limits) == 0) then
      if (limits%soft >= 0 .and. length > limits%soft) number = efbig
    end if
    if (number == 0 .and. length > present) then
      do
        if (c_fallocate(descriptor, keep_size, present, length - present) == 0) return
        number = system_error()
        if (number /= interrupted) exit
      end do
    end if
    select case (number)
    case (0)
    case (efbig, enospc, edquot)
      reason = with_remedy(fortran_text(c_strerror(number)))
    case default
      call write_zeros(descriptor, length, reason)
    end select
  end subroutine reserve_space

  !> Let a file be `length` bytes long, if it is shorter. Without room it stays as it is.
  subroutine write_zeros(descriptor, length, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: length
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer, parameter :: block = 65536
    character(c_char), allocatable, target :: zeros(:)
    type(identity_t) :: file
    integer(int64) :: place

    file = identity_of(descriptor)
    allocate (zeros(block))
    zeros = c_null_char
    place = file%bytes
    do while (place < length .and. .not. allocated(reason))
      call write_all(descriptor, zeros(:min(length - place, size(zeros, kind=int64))), reason, place)
      place = place + size(zeros)
    end do
    if (allocated(reason)) call set_file_size(descriptor, file%bytes)
  end subroutine write_zeros

  !> Give back what was reserved beyond `length` bytes. Failing here loses no data.
  subroutine set_file_size(descriptor, length)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: length
    integer(c_int) :: ignored

    ignored = ftruncate(descriptor, int(length, c_int64_t))
  end subroutine set_file_size

  !> Move a file over another in one step.
  subroutine move_file(from, to, moved)
    character(*), intent(in) :: from, to
    logical, intent(out) :: moved

    moved = c_rename(c_text(from), c_text(to)) == 0
  end subroutine move_file

  !> Give a new file its name unless a file of that name has come to be meanwhile.
  subroutine place_file(from, to, placed)
    character(*), intent(in) :: from, to
    logical, intent(out) :: placed

    placed = c_link(c_text(from), c_text(to)) == 0
    if (placed) then
      call delete_file(from)
    else if (.not. file_exists(to)) then
      ! A file system without hard links.
      call move_file(from, to, placed)
    end if
  end subroutine place_file

  !> Create a file that was not there, open for reading and writing; a name that is taken, also by a link, is refused.
  subroutine create_file(file_name, descriptor, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    descriptor = opened(file_name, read_write + create_exclusively)
    if (descriptor < 0) reason = system_reason()
  end subroutine create_file

  !> Open the file `identity` for reading and writing, if this still is its name.
  subroutine open_own_file(file_name, identity, descriptor, reason)
    character(*), intent(in) :: file_name
    type(identity_t), intent(in) :: identity
    integer(c_int), intent(out) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    descriptor = -1
    if (identity_of(file_name) == identity) then
      descriptor = opened(file_name, read_write)
      if (descriptor < 0) reason = system_reason()
      if (descriptor < 0) return
      if (identity_of(descriptor) == identity) return
      call close_descriptor(descriptor)
    end if
    reason = 'the file or its folder was removed, renamed or replaced'
  end subroutine open_own_file

  !> A new descriptor, which programs started by this one do not get; -1 on failure.
  integer(c_int) function opened(file_name, flags) result(descriptor)
    character(*), intent(in) :: file_name
    integer(c_int), intent(in) :: flags

    do
      descriptor = c_open(c_text(file_name), flags + not_in_programs, as_the_mask_says)
      if (descriptor >= 0) return
      if (system_error() /= interrupted) return
    end do
  end function opened

  !> Write all of `text`, from byte `place` of a file on, counted from 0, or where the descriptor stands.
  subroutine write_bytes(descriptor, text, reason, place)
    integer(c_int), intent(in) :: descriptor
    character(*), intent(in), target :: text
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(int64), intent(in), optional :: place
    character(c_char), pointer, contiguous :: bytes(:)

    if (len(text) == 0) return
    call c_f_pointer(c_loc(text(1:1)), bytes, [len(text)])
    call write_all(descriptor, bytes, reason, place)
  end subroutine write_bytes

  !> Write all bytes in one call of the system, more only if that writes a part: from byte `place`, or where the file stands.
  subroutine write_all(descriptor, bytes, reason, place)
    integer(c_int), intent(in) :: descriptor
    character(c_char), intent(in), target, contiguous :: bytes(:)
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(int64), intent(in), optional :: place
    integer(int64) :: written
    integer(c_intptr_t) :: count
    integer(c_size_t) :: left

    call ignore_size_limit_signal()
    written = 0
    do while (written < size(bytes, kind=int64))
      left = int(size(bytes, kind=int64) - written, c_size_t)
      if (present(place)) then
        count = c_pwrite(descriptor, c_loc(bytes(written + 1)), left, place + written)
      else
        count = c_write(descriptor, c_loc(bytes(written + 1)), left)
      end if
      if (count >= 0) then
        written = written + count
      else if (system_error() == try_again) then
        ! A pipe or terminal that somebody has made non-blocking is full.
        call wait_seconds(0.001_wp)
      else if (system_error() /= interrupted) then
        reason = system_reason()
        return
      end if
    end do
  end subroutine write_all

  !> Read an open file from byte `place` (0 is the first); `complete`: so many bytes are there.
  subroutine read_at(descriptor, place, bytes, complete)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: place
    character(c_char), intent(inout), target, contiguous :: bytes(:)   !! behind the end of the file as they were
    logical, intent(out) :: complete
    integer(int64) :: done
    integer(c_intptr_t) :: count

    done = 0
    do while (done < size(bytes, kind=int64))
      count = c_pread(descriptor, c_loc(bytes(done + 1)), int(size(bytes, kind=int64) - done, c_size_t), place + done)
      if (count < 0) then
        if (system_error() == interrupted) cycle
      end if
      if (count <= 0) exit
      done = done + count
    end do
    complete = done == size(bytes, kind=int64)
  end subroutine read_at

  !> Open a regular file, created if need be, to append to it and nothing else; another process that has it open so is refused.
  subroutine open_for_appending(file_name, descriptor, bytes, is_elsewhere, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes               !! of the file
    logical, intent(out) :: is_elsewhere               !! another process is the reason
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(c_int), parameter :: read_write_create_append = 2 + 64 + 1024

    call ignore_size_limit_signal()
    is_elsewhere = .false.
    do
      call open_regular(file_name, read_write_create_append, descriptor, bytes, reason)
      if (allocated(reason)) return
      is_elsewhere = is_locked_elsewhere(descriptor)
      if (is_elsewhere) then
        reason = 'another process is writing it: wait until it ends'
        call close_descriptor(descriptor)
        return
      end if
      ! Who had it may have removed it before it was locked here.
      if (identity_of(file_name) == identity_of(descriptor)) return
      call close_descriptor(descriptor)
    end do
  end subroutine open_for_appending

  !> Lock a file; `held` by another process, or `without_locks` if its file system has none.
  integer function lock_attempt(descriptor, shared) result(outcome)
    integer(c_int), intent(in) :: descriptor
    logical, intent(in), optional :: shared            !! with others that lock it so
    integer(c_int), parameter :: share = 1, exclude = 2, or_fail = 4, would_block = 11
    integer(c_int) :: operation

    operation = exclude
    if (present(shared)) operation = merge(share, exclude, shared)
    outcome = locked
    if (c_flock(descriptor, operation + or_fail) == 0) return
    outcome = without_locks
    if (system_error() == would_block) outcome = held
  end function lock_attempt

  !> Lock an open file until it is closed; true if another process has the lock, and not only for a moment to look whether
  !> anybody has. A file system without locks is trusted.
  logical function is_locked_elsewhere(descriptor)
    integer(c_int), intent(in) :: descriptor
    integer, parameter :: most_tries = 5
    integer :: i

    do i = 1, most_tries
      is_locked_elsewhere = lock_attempt(descriptor) == held
      if (.not. is_locked_elsewhere) exit
      call wait_seconds(0.005_wp)
    end do
  end function is_locked_elsewhere

  !> The process of this machine that has locked a file, as Linux lists them; 0 if it lists none.
  integer function process_with_lock(file_name) result(process)
    character(*), intent(in) :: file_name
    character(160) :: line
    character(16) :: words(4)
    character(64) :: place
    character(20) :: inode
    type(identity_t) :: file
    integer :: unit, status, number

    process = 0
    file = identity_of(file_name)
    write (inode, '(i0)') file%inode
    open (newunit=unit, file='/proc/locks', status='old', action='read', iostat=status)
    if (status /= 0) return
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      ! '1: FLOCK  ADVISORY  WRITE 1234 08:01:5678 0 EOF': process, device and inode.
      read (line, *, iostat=status) words, number, place
      if (status /= 0) cycle
      if (words(2) == 'FLOCK' .and. place(index(place, ':', back=.true.) + 1:) == inode) process = max(0, number)
    end do
    close (unit)
  end function process_with_lock

  !> Open a regular file to read it.
  subroutine open_for_reading(file_name, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes               !! of the file
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    call open_regular(file_name, read_only, descriptor, bytes, reason)
  end subroutine open_for_reading

  !> Open what has this name itself, never what a link there leads to, if it is a regular file.
  subroutine open_regular(file_name, mode, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(in) :: mode
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    !> O_NONBLOCK, since a pipe would wait for its other end; O_NOFOLLOW of x86 and of ARM, each without effect there.
    integer(c_int), parameter :: itself = 2048 + 131072 + 32768
    integer(c_int), parameter :: no_such_file = 2, too_many_links = 40
    type(identity_t) :: file

    descriptor = opened(file_name, ior(mode, itself))
    if (descriptor >= 0) file = identity_of(descriptor)
    bytes = file%bytes
    if (file%is_regular) return
    if (descriptor >= 0) then
      reason = 'it is not a regular file: remove it, or use another name'
    else if (system_error() == no_such_file) then
      reason = 'it was removed meanwhile, or its folder was: see who else uses it, and start again'
    else if (system_error() == too_many_links) then
      reason = 'it is a symbolic link: remove it, or use another name'
    else
      reason = system_reason()
    end if
    call close_descriptor(descriptor)
  end subroutine open_regular

  !> The words of a file from word `first` (from 0) on; behind its end 0.
  subroutine read_words(descriptor, first, words)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: first
    integer(int64), intent(out), target, contiguous :: words(:)
    integer, parameter :: word_bytes = 8
    character(c_char), pointer, contiguous :: bytes(:)
    logical :: ignored

    words = 0
    call c_f_pointer(c_loc(words), bytes, [word_bytes*size(words, kind=int64)])
    call read_at(descriptor, word_bytes*first, bytes, ignored)
  end subroutine read_words

  !> Append 64-bit words in one call of the system, more only if that writes a part: what is killed in between has written
  !> all, nothing, or a part at the end.
  subroutine append_words(descriptor, words, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in), target, contiguous :: words(:)
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer, parameter :: word_bytes = 8
    character(c_char), pointer, contiguous :: bytes(:)

    call c_f_pointer(c_loc(words), bytes, [word_bytes*size(words, kind=int64)])
    call write_all(descriptor, bytes, reason)
  end subroutine append_words

  !> Close a file; the descriptor is -1 afterwards. `reason`: why what was written may be lost, unless it has one already.
  subroutine close_descriptor(descriptor, reason)
    integer(c_int), intent(inout) :: descriptor
    character(:), allocatable, intent(inout), optional :: reason
    integer(c_int) :: status

    status = 0
    if (descriptor >= 0) status = c_close(descriptor)
    descriptor = -1
    if (.not. present(reason) .or. status == 0) return
    if (allocated(reason)) return
    ! A call that was interrupted has closed the file all the same.
    if (system_error() /= interrupted) reason = system_reason()
  end subroutine close_descriptor

  !> The files whose names begin with `beginning`, in alphabetical order.
  subroutine matching_files(beginning, files)
    character(*), intent(in) :: beginning
    type(path_t), allocatable, intent(out) :: files(:)
    type(found_paths_t) :: found
    type(c_ptr), pointer :: paths(:)
    character(:), allocatable :: pattern
    integer :: i

    pattern = ''
    do i = 1, len(beginning)
      if (scan(beginning(i:i), '\*?[') > 0) pattern = pattern//'\'
      pattern = pattern//beginning(i:i)
    end do
    i = c_glob(c_text(pattern//'*'), 0_c_int, c_null_ptr, found)
    if (i /= 0) found%count = 0
    allocate (files(found%count))
    if (found%count == 0) return
    call c_f_pointer(found%paths, paths, [found%count])
    do i = 1, size(files)
      files(i)%text = fortran_text(paths(i))
    end do
    call c_globfree(found)
  end subroutine matching_files

  !> Let a closed file, or the entries of a folder, survive a power failure, where the system can do that.
  subroutine make_name_durable(name)
    character(*), intent(in) :: name
    integer(c_int) :: descriptor, ignored

    descriptor = opened(name, read_only)
    if (descriptor < 0) return
    ignored = c_fsync(descriptor)
    call close_descriptor(descriptor)
  end subroutine make_name_durable

  !> Let what was written to the open file survive a power failure.
  subroutine make_durable(descriptor, reason)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    do while (c_fsync(descriptor) /= 0)
      if (system_error() == interrupted) cycle
      reason = system_reason()
      return
    end do
  end subroutine make_durable

  !> All bytes of a file of at most `most` bytes.
  subroutine read_bytes(file_name, most, bytes, reason)
    character(*), intent(in) :: file_name
    integer, intent(in) :: most
    character(:), allocatable, intent(out) :: bytes, reason   !! reason: unallocated on success
    character(256) :: message
    integer(int64) :: length
    integer :: unit, io_status

    bytes = ''
    length = file_size(file_name)
    if (.not. file_exists(file_name)) then
      reason = 'there is no such file'
    else if (is_folder(file_name)) then
      reason = 'it is a folder'
    else if (length <= 0) then
      reason = 'it is empty or not a regular file'
    else if (length > most) then
      reason = 'it is too long'
    end if
    if (allocated(reason)) return
    open (newunit=unit, file=file_name, status='old', action='read', access='stream', form='unformatted', &
      iostat=io_status, iomsg=message)
    if (io_status == 0) then
      deallocate (bytes)
      allocate (character(int(length)) :: bytes)
      read (unit, iostat=io_status, iomsg=message) bytes
      close (unit)
    end if
    if (io_status /= 0) reason = with_remedy(after_last(trim(message), ': '))
  end subroutine read_bytes

  !> Give up the lock that HDF5 has on an open file.
  subroutine unlock_file(descriptor)
    integer(c_int), intent(in) :: descriptor
    integer(c_int), parameter :: unlock = 8
    integer(c_int) :: ignored

    if (are_files_locked()) ignored = c_flock(descriptor, unlock)
  end subroutine unlock_file

  !> Take HDF5's lock again; if a reader has come in between, go on without it.
  subroutine lock_file(descriptor)
    integer(c_int), intent(in) :: descriptor
    integer :: ignored

    if (are_files_locked()) ignored = lock_attempt(descriptor)
  end subroutine lock_file

  !> Whether another process has HDF5's lock of a file: for writing, or at all.
  logical function is_in_use(file_name, for_writing)
    character(*), intent(in) :: file_name
    logical, intent(in) :: for_writing
    integer(c_int), parameter :: read_only_at_once = 2048, shared = 1, exclusive = 2, or_fail = 4
    integer(c_int) :: descriptor

    is_in_use = .false.
    if (.not. are_files_locked()) return
    descriptor = opened(file_name, read_only_at_once)
    if (descriptor < 0) return
    is_in_use = c_flock(descriptor, merge(shared, exclusive, for_writing) + or_fail) /= 0
    call close_descriptor(descriptor)
  end function is_in_use

  !> Whether HDF5 locks files, as its environment variable says.
  logical function are_files_locked()
    character(16) :: value

    call get_environment_variable('HDF5_USE_FILE_LOCKING', value)
    are_files_locked = value /= 'FALSE' .and. value /= '0'
  end function are_files_locked

  !> Do nothing for a while.
  subroutine wait_seconds(seconds)
    real(wp), intent(in) :: seconds   !! below 1
    integer(c_int) :: ignored

    ignored = c_usleep(int(1.0e6_wp*seconds, c_int))
  end subroutine wait_seconds

  !> The number of the error of the last call of the system that failed.
  integer(c_int) function system_error()
    integer(c_int), pointer :: number

    call c_f_pointer(c_error_number(), number)
    system_error = number
  end function system_error

  !> Why the last call of the system failed, and what to do.
  function system_reason() result(reason)
    character(:), allocatable :: reason

    reason = with_remedy(fortran_text(c_strerror(system_error())))
  end function system_reason

  !> Remove a file, if it is there.
  subroutine delete_file(file_name)
    character(*), intent(in) :: file_name
    integer(c_int) :: ignored

    ignored = c_unlink(c_text(file_name))
  end subroutine delete_file

  !> Remove the file `identity`, if this still is its name.
  subroutine delete_own_file(file_name, identity)
    character(*), intent(in) :: file_name
    type(identity_t), intent(in) :: identity

    if (identity_of(file_name) == identity) call delete_file(file_name)
  end subroutine delete_own_file

  !> A system's reason, followed by what the user can do about it.
  pure function with_remedy(system_reason) result(reason)
    character(*), intent(in) :: system_reason
    character(:), allocatable :: reason

    if (index(system_reason, 'No space left') > 0) then
      reason = 'the disk is full: free some space or write to another disk'
    else if (index(system_reason, 'File too large') > 0) then
      reason = 'the file-size limit is reached: raise it with "ulimit -f unlimited"'
    else if (index(system_reason, 'quota') > 0) then
      reason = 'the disk quota is used up: free some space or write to another disk'
    else if (index(system_reason, 'No such file') > 0) then
      reason = 'the file or its folder was removed or renamed'
    else if (index(system_reason, 'Permission denied') > 0) then
      reason = 'no permission to write there: choose another folder with -o'
    else if (index(system_reason, 'Read-only') > 0) then
      reason = 'the file system is read-only: choose another folder with -o'
    else if (index(system_reason, 'temporarily unavailable') > 0 .or. index(system_reason, ' lock') > 0) then
      reason = locked_by_a_reader
    else
      reason = system_reason
    end if
  end function with_remedy

  !> Let a write beyond the file-size limit fail instead of killing the process.
  subroutine ignore_size_limit_signal()
    integer(c_intptr_t), parameter :: ignore = 1
    type(c_funptr) :: previous

    previous = c_signal(sigxfsz, transfer(ignore, c_null_funptr))
  end subroutine ignore_size_limit_signal

  !> Whether a file of any kind has this name.
  logical function file_exists(file_name)
    character(*), intent(in) :: file_name

    inquire (file=file_name, exist=file_exists)
  end function file_exists

  !> Bytes of a regular file, without opening it; 0 or less for what is none: opening a pipe could wait for ever.
  integer(int64) function file_size(file_name)
    character(*), intent(in) :: file_name

    inquire (file=file_name, size=file_size)
  end function file_size

  !> Whether the name is that of a folder.
  logical function is_folder(file_name)
    character(*), intent(in) :: file_name

    inquire (file=file_name//'/.', exist=is_folder)
  end function is_folder

  !> The folder in which a file stands; '.' when its name has none.
  pure function folder_of(file_name) result(folder)
    character(*), intent(in) :: file_name
    character(:), allocatable :: folder
    integer :: slash

    slash = scan(file_name, '/', back=.true.)
    select case (slash)
    case (0)
      folder = '.'
    case (1)
      folder = '/'
    case default
      folder = file_name(:slash - 1)
    end select
  end function folder_of

  !> The file behind symbolic links; the name itself when there is no such file.
  function true_path(file_name) result(path)
    character(*), intent(in) :: file_name
    character(:), allocatable :: path
    type(c_ptr) :: resolved

    resolved = c_realpath(c_text(file_name), c_null_ptr)
    if (c_associated(resolved)) then
      path = fortran_text(resolved)
      call c_free(resolved)
    else
      path = file_name
    end if
  end function true_path

  !> The same text for all names of one place, whether a file is there or not: its folder and the file behind links.
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

  !> A word that nobody else hits upon: lower-case letters and digits.
  function unique_word() result(word)
    character(10) :: word
    character(*), parameter :: digits = '0123456789abcdefghijklmnopqrstuvwxyz'
    integer(int64) :: number, ticks
    integer :: i, clock(8), digit

    call date_and_time(values=clock)
    call system_clock(ticks)
    number = modulo(ieor(ieor(ticks, ishft(int(c_getpid(), int64), 32)), 1000003_int64*clock(8)), huge(number))
    do i = 1, len(word)
      digit = int(modulo(number, len(digits, int64)))
      word(i:i) = digits(digit + 1:digit + 1)
      number = number/len(digits)
    end do
  end function unique_word

  !> Now, as ISO 8601 in UTC: '2026-01-31T23:59:59Z'.
  function utc_now() result(now)
    character(20) :: now
    integer :: clock(8)

    call date_and_time(values=clock)
    now = utc_of(clock)
  end function utc_now

  !> The same of any moment, in the values of `date_and_time`.
  pure function utc_of(clock) result(moment)
    integer, intent(in) :: clock(8)
    character(20) :: moment
    integer :: year, month, day, minutes, zone_days

    year = clock(1)
    month = clock(2)
    minutes = 60*clock(5) + clock(6) - clock(4)
    ! The time zone moves the date by one day at most.
    zone_days = (minutes - modulo(minutes, 1440))/1440
    day = clock(3) + zone_days
    if (day < 1) then
      month = month - 1
      if (month == 0) then
        month = 12
        year = year - 1
      end if
      day = month_length(year, month)
    else if (day > month_length(year, month)) then
      day = 1
      month = month + 1
      if (month == 13) then
        month = 1
        year = year + 1
      end if
    end if
    minutes = modulo(minutes, 1440)
    write (moment, '(i4.4, 2("-", i2.2), "T", i2.2, 2(":", i2.2), "Z")') year, month, day, minutes/60, modulo(minutes, 60), clock(7)
  end function utc_of

  !> The same of a moment in seconds since 1970.
  pure function utc_at(seconds) result(moment)
    integer(int64), intent(in) :: seconds   !! not negative
    character(20) :: moment
    integer, parameter :: day = 86400
    integer :: clock(8), second

    second = int(modulo(seconds, int(day, int64)))
    clock = [1970, 1, int(seconds/day) + 1, 0, second/3600, modulo(second, 3600)/60, modulo(second, 60), 0]
    do while (clock(3) > month_length(clock(1), clock(2)))
      clock(3) = clock(3) - month_length(clock(1), clock(2))
      clock(2) = clock(2) + 1
      if (clock(2) <= 12) cycle
      clock(2) = 1
      clock(1) = clock(1) + 1
    end do
    moment = utc_of(clock)
  end function utc_at

  !> Seconds since the beginning of 1970, UTC.
  integer(int64) function seconds_now()
    seconds_now = c_time(c_null_ptr)
  end function seconds_now

  !> Days of a month of the Gregorian calendar.
  pure integer function month_length(year, month)
    integer, intent(in) :: year, month
    integer, parameter :: lengths(12) = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]
    logical :: leap

    leap = modulo(year, 4) == 0 .and. (modulo(year, 100) /= 0 .or. modulo(year, 400) == 0)
    month_length = lengths(month)
    if (leap .and. month == 2) month_length = 29
  end function month_length

  pure function after_last(text, separator) result(tail)
    character(*), intent(in) :: text, separator
    character(:), allocatable :: tail
    integer :: found

    found = index(text, separator, back=.true.)
    tail = text
    if (found > 0) tail = text(found + len(separator):)
  end function after_last

  pure function c_text(text) result(bytes)
    character(*), intent(in) :: text
    character(c_char) :: bytes(len(text) + 1)
    integer :: i

    do i = 1, len(text)
      bytes(i) = text(i:i)
    end do
    bytes(len(text) + 1) = c_null_char
  end function c_text

  function fortran_text(address) result(text)
    type(c_ptr), intent(in) :: address
    character(:), allocatable :: text
    character(c_char), pointer, contiguous :: bytes(:)
    integer :: i

    call c_f_pointer(address, bytes, [c_strlen(address)])
    allocate (character(size(bytes)) :: text)
    do i = 1, size(bytes)
      text(i:i) = bytes(i)
    end do
  end function fortran_text
end module dst_disk
