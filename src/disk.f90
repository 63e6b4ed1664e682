!> What a result file asks of the operating system: may it be created, is there room for it, put it in its place.
!>
!> Reasons come back as the words a user can act upon. POSIX; nothing here knows the file's format.
module dst_disk
  use, intrinsic :: iso_c_binding, only: c_int, c_int16_t, c_int32_t, c_int64_t, c_intptr_t, c_char, c_ptr, c_funptr, c_size_t, &
    c_null_char, c_null_ptr, c_null_funptr, c_associated, c_f_pointer, c_loc
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: prepare_file, reserve_space, set_file_size, move_file, place_file, delete_file
  public :: read_bytes, replace_file, append_text, make_durable, make_name_durable
  public :: open_exclusively, lock_file, unlock_file, is_being_written, wait_seconds
  public :: open_for_appending, open_for_reading, append_words, read_words, close_descriptor, matching_files, path_t
  public :: file_exists, file_size, is_folder, folder_of, true_path, scratch_name, with_remedy, ignore_size_limit_signal, utc_now, &
    utc_of

  ! Error numbers that mean "no room" on Linux.
  integer(c_int), parameter :: efbig = 27, enospc = 28, edquot = 122
  integer(c_int), parameter :: sigxfsz = 25

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

  !> What statx() tells: its first members, and room for the others.
  type, bind(c) :: file_facts_t
    integer(c_int32_t) :: mask = 0, block_size = 0
    integer(c_int64_t) :: attributes = 0
    integer(c_int32_t) :: links = 0, owner = 0, group = 0
    integer(c_int16_t) :: mode = 0, spare = 0
    integer(c_int64_t) :: inode = 0, size = 0, others(26) = 0
  end type file_facts_t

  interface
    integer(c_int) function c_statx(folder, path, flags, mask, facts) bind(c, name='statx')
      import :: c_int, c_char, file_facts_t
      integer(c_int), value :: folder, flags, mask
      character(c_char), intent(in) :: path(*)
      type(file_facts_t), intent(inout) :: facts
    end function c_statx

    integer(c_intptr_t) function c_pread(descriptor, bytes, count, offset) bind(c, name='pread')
      import :: c_int, c_intptr_t, c_ptr, c_size_t, c_int64_t
      integer(c_int), value :: descriptor
      type(c_ptr), value :: bytes
      integer(c_size_t), value :: count
      integer(c_int64_t), value :: offset
    end function c_pread

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

    integer(c_int) function posix_fallocate(descriptor, offset, length) bind(c)
      import :: c_int, c_int64_t
      integer(c_int), value :: descriptor
      integer(c_int64_t), value :: offset, length
    end function posix_fallocate

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

    integer(c_int) function c_creat(path, permissions) bind(c, name='creat')
      import :: c_int, c_char
      character(c_char), intent(in) :: path(*)
      integer(c_int), value :: permissions
    end function c_creat

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

    integer(c_int) function c_lockf(descriptor, command, length) bind(c, name='lockf')
      import :: c_int, c_int64_t
      integer(c_int), value :: descriptor, command
      integer(c_int64_t), value :: length
    end function c_lockf

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

  !> Create `file_name` as an empty file, or see that it may be written when it is there.
  subroutine prepare_file(file_name, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    character(256) :: message
    character(:), allocatable :: folder
    integer :: unit, io_status

    if (file_exists(file_name)) then
      open (newunit=unit, file=file_name, status='old', action='readwrite', iostat=io_status, iomsg=message)
    else
      open (newunit=unit, file=file_name, status='new', action='readwrite', iostat=io_status, iomsg=message)
    end if
    if (io_status == 0) then
      close (unit)
      return
    end if

    folder = folder_of(file_name)
    if (is_folder(folder)) then
      reason = with_remedy(after_last(trim(message), ': '))
    else if (file_exists(folder)) then
      reason = folder//' is not a folder'
    else
      reason = 'the folder '//folder//' does not exist: create it first'
    end if
  end subroutine prepare_file

  !> See that the open file can grow to `length` bytes; a file system that cannot tell counts as able.
  subroutine reserve_space(descriptor, length, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: length
    character(:), allocatable, intent(out) :: reason   !! unallocated when there is room
    integer(c_int) :: number

    number = posix_fallocate(descriptor, 0_c_int64_t, int(length, c_int64_t))
    select case (number)
    case (efbig, enospc, edquot)
      reason = with_remedy(fortran_text(c_strerror(number)))
    end select
  end subroutine reserve_space

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

  !> Put a file with these bytes in the place of another, or of none, in one step: whatever happens, the old file or the
  !> new one is there. `durable`: even after a power failure.
  subroutine replace_file(file_name, bytes, durable, reason)
    character(*), intent(in) :: file_name, bytes
    logical, intent(in) :: durable
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    character(:), allocatable :: unfinished

    unfinished = file_name//'~'
    call write_bytes(unfinished, c_text(bytes), len(bytes), durable, reason)
    if (.not. allocated(reason)) then
      if (c_rename(c_text(unfinished), c_text(file_name)) /= 0) reason = system_reason()
    end if
    if (allocated(reason)) then
      call delete_file(unfinished)
    else if (durable) then
      call make_name_durable(folder_of(file_name))
    end if
  end subroutine replace_file

  !> Write the first `length` bytes into a file.
  subroutine write_bytes(file_name, bytes, length, durable, reason)
    character(*), intent(in) :: file_name
    character(c_char), intent(in), target :: bytes(:)
    integer, intent(in) :: length
    logical, intent(in) :: durable
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(c_int), parameter :: everyone_may_read = int(o'644', c_int)
    integer(c_int) :: descriptor
    integer(c_intptr_t) :: count
    integer :: written

    call ignore_size_limit_signal()
    descriptor = c_creat(c_text(file_name), everyone_may_read)
    if (descriptor < 0) then
      reason = system_reason()
      return
    end if
    written = 0
    do while (written < length .and. .not. allocated(reason))
      count = c_write(descriptor, c_loc(bytes(written + 1)), int(length - written, c_size_t))
      if (count < 0) reason = system_reason()
      written = written + int(count)
    end do
    if (durable .and. .not. allocated(reason)) call make_durable(descriptor, reason)
    if (c_close(descriptor) /= 0 .and. .not. allocated(reason)) reason = system_reason()
  end subroutine write_bytes

  !> Open a regular file, created if need be, to append to it and nothing else; another process that has it open so is refused.
  subroutine open_for_appending(file_name, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes               !! of the file
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(c_int), parameter :: read_write_create_append = 2 + 64 + 1024
    integer(c_int), parameter :: exclusive_or_fail = 2 + 4, would_block = 11
    integer(c_int), pointer :: number

    call ignore_size_limit_signal()
    call open_regular(file_name, read_write_create_append, descriptor, bytes, reason)
    if (allocated(reason)) return
    if (c_flock(descriptor, exclusive_or_fail) == 0) return
    call c_f_pointer(c_error_number(), number)
    ! A file system without locks is trusted.
    if (number == would_block) then
      reason = 'another process is writing it: wait until it ends'
      call close_descriptor(descriptor)
    end if
  end subroutine open_for_appending

  !> Open a regular file to read it.
  subroutine open_for_reading(file_name, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes               !! of the file
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(c_int), parameter :: read_only = 0

    call open_regular(file_name, read_only, descriptor, bytes, reason)
  end subroutine open_for_reading

  !> Open what has this name itself, never what a link there leads to, if it is a regular file.
  subroutine open_regular(file_name, mode, descriptor, bytes, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(in) :: mode
    integer(c_int), intent(out) :: descriptor
    integer(int64), intent(out) :: bytes
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    !> O_CLOEXEC; O_NONBLOCK, since a pipe would wait for its other end; O_NOFOLLOW of x86 and of ARM, each without effect there.
    integer(c_int), parameter :: itself = 524288 + 2048 + 131072 + 32768
    integer(c_int), parameter :: everyone_may_read = int(o'644', c_int), no_such_file = 2, too_many_links = 40
    integer(c_int), parameter :: empty_path = int(z'1000', c_int), type_and_size = int(z'201', c_int)
    integer, parameter :: type_bits = int(o'170000'), regular = int(o'100000')
    type(file_facts_t) :: facts
    integer(c_int), pointer :: number

    bytes = 0
    descriptor = c_open(c_text(file_name), ior(mode, itself), everyone_may_read)
    if (descriptor < 0) then
      call c_f_pointer(c_error_number(), number)
      if (number == no_such_file) then
        reason = 'it was removed meanwhile, or its folder was: see who else uses it, and start again'
      else if (number == too_many_links) then
        reason = 'it is a symbolic link: remove it, or use another name'
      else
        reason = system_reason()
      end if
    else if (c_statx(descriptor, c_text(''), empty_path, type_and_size, facts) /= 0) then
      reason = system_reason()
    else if (iand(int(facts%mode), type_bits) /= regular) then
      reason = 'it is not a regular file: remove it, or use another name'
    else
      bytes = facts%size
    end if
    if (allocated(reason)) call close_descriptor(descriptor)
  end subroutine open_regular

  !> The words of a file from word `first` (from 0) on; behind its end 0.
  subroutine read_words(descriptor, first, words)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in) :: first
    integer(int64), intent(out), target, contiguous :: words(:)
    integer, parameter :: word_bytes = 8
    character(c_char), pointer :: bytes(:)
    integer(int64) :: length, read
    integer(c_intptr_t) :: count

    words = 0
    length = word_bytes*size(words, kind=int64)
    call c_f_pointer(c_loc(words(1)), bytes, [length])
    read = 0
    do while (read < length)
      count = c_pread(descriptor, c_loc(bytes(read + 1)), int(length - read, c_size_t), word_bytes*first + read)
      if (count <= 0) exit
      read = read + count
    end do
  end subroutine read_words

  !> Append 64-bit words in one call of the system, more only if that writes a part: what is killed in between has written
  !> all, nothing, or a part at the end.
  subroutine append_words(descriptor, words, reason)
    integer(c_int), intent(in) :: descriptor
    integer(int64), intent(in), target, contiguous :: words(:)
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer, parameter :: word_bytes = 8
    character(c_char), pointer :: bytes(:)
    integer(int64) :: length, written
    integer(c_intptr_t) :: count

    length = word_bytes*size(words, kind=int64)
    call c_f_pointer(c_loc(words(1)), bytes, [length])
    written = 0
    do while (written < length .and. .not. allocated(reason))
      count = c_write(descriptor, c_loc(bytes(written + 1)), int(length - written, c_size_t))
      if (count < 0) reason = system_reason()
      written = written + count
    end do
  end subroutine append_words

  !> Append a text to a closed file; without room for it, nothing.
  subroutine append_text(file_name, text)
    character(*), intent(in) :: file_name, text
    integer(c_int), parameter :: write_append = 1 + 1024
    character(c_char), target :: bytes(len(text) + 1)
    integer(c_intptr_t) :: ignored
    integer(c_int) :: descriptor

    descriptor = c_open(c_text(file_name), write_append, 0_c_int)
    if (descriptor < 0) return
    bytes = c_text(text)
    ignored = c_write(descriptor, c_loc(bytes), len(text, c_size_t))
    call close_descriptor(descriptor)
  end subroutine append_text

  !> Close a file; the descriptor is -1 afterwards.
  subroutine close_descriptor(descriptor)
    integer(c_int), intent(inout) :: descriptor
    integer(c_int) :: ignored

    if (descriptor >= 0) ignored = c_close(descriptor)
    descriptor = -1
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
    integer(c_int), parameter :: read_only = 0
    integer(c_int) :: descriptor, ignored

    descriptor = c_open(c_text(name), read_only, 0_c_int)
    if (descriptor < 0) return
    ignored = c_fsync(descriptor)
    ignored = c_close(descriptor)
  end subroutine make_name_durable

  !> Let what was written to the open file survive a power failure.
  subroutine make_durable(descriptor, reason)
    integer(c_int), intent(in) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    if (c_fsync(descriptor) /= 0) reason = system_reason()
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

  !> Open a file, so that no other process opens it this way until it is closed. HDF5 does not see this lock, nor do
  !> child processes share it.
  subroutine open_exclusively(file_name, descriptor, reason)
    character(*), intent(in) :: file_name
    integer(c_int), intent(out) :: descriptor          !! -1 where files are not locked
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer(c_int), parameter :: read_write = 2, test_and_lock = 2
    integer(c_int64_t), parameter :: whole_file = 0

    descriptor = -1
    if (.not. are_files_locked()) return
    descriptor = c_open(c_text(file_name), read_write, 0_c_int)
    if (descriptor >= 0) then
      if (c_lockf(descriptor, test_and_lock, whole_file) == 0) return
    end if
    reason = system_reason()
    call close_descriptor(descriptor)
  end subroutine open_exclusively

  !> Take HDF5's lock again; if a reader has come in between, go on without it.
  subroutine lock_file(descriptor)
    integer(c_int), intent(in) :: descriptor
    integer(c_int), parameter :: exclusive_or_fail = 2 + 4
    integer(c_int) :: ignored

    if (are_files_locked()) ignored = c_flock(descriptor, exclusive_or_fail)
  end subroutine lock_file

  !> Whether another process has HDF5's lock for writing.
  logical function is_being_written(file_name)
    character(*), intent(in) :: file_name
    integer(c_int), parameter :: read_only_at_once = 2048, shared_or_fail = 1 + 4
    integer(c_int) :: descriptor

    is_being_written = .false.
    if (.not. are_files_locked()) return
    descriptor = c_open(c_text(file_name), read_only_at_once, 0_c_int)
    if (descriptor < 0) return
    is_being_written = c_flock(descriptor, shared_or_fail) /= 0
    call close_descriptor(descriptor)
  end function is_being_written

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

  !> Why the last call of the system failed, and what to do.
  function system_reason() result(reason)
    character(:), allocatable :: reason
    integer(c_int), pointer :: number

    call c_f_pointer(c_error_number(), number)
    reason = with_remedy(fortran_text(c_strerror(number)))
  end function system_reason

  !> Remove a file, if it is there.
  subroutine delete_file(file_name)
    character(*), intent(in) :: file_name
    integer(c_int) :: ignored

    ignored = c_unlink(c_text(file_name))
  end subroutine delete_file

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
      reason = 'locked by another process, or the file system has no locks: close the other program, ' &
        //'or set HDF5_USE_FILE_LOCKING=FALSE'
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

  !> A name beside `file_name` that no other process uses.
  function scratch_name(file_name) result(name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: name
    character(12) :: process

    write (process, '(i0)') c_getpid()
    name = file_name//'.'//trim(process)//'.part'
  end function scratch_name

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
    character(c_char), pointer :: bytes(:)
    integer :: i

    call c_f_pointer(address, bytes, [c_strlen(address)])
    allocate (character(size(bytes)) :: text)
    do i = 1, size(bytes)
      text(i:i) = bytes(i)
    end do
  end function fortran_text
end module dst_disk
