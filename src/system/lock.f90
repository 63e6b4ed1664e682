!> The lock of a result file: the file FILE.h5.lock next to it, while a process writes it or prepares to write it.
!>
!> The operating system keeps the lock (flock) while the process lives, or a child of it that is still writing. The text of the file
!> is for messages, and for the names of files that a killed process left unfinished. A lock that no process has is stale, and is
!> taken over. If a file system has no locks, the text decides: the process that it names must be of this machine and must have
!> ended.
module dst_lock
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_kinds, only: wp, int64
  use dst_disk, only: identity_t, identity_of, operator(==), path_t, create_file, open_own_file, close_descriptor, delete_file, &
    delete_own_file, folder_of, is_folder, lock_attempt, locked, held, without_locks, matching_files, read_bytes, set_file_size, &
    unique_word, wait_seconds, write_bytes
  use dst_machine, only: host_name
  use dst_posix, only: c_errno, c_getpid, c_kill, dst_eexist, dst_esrch
  use dst_text, only: integer_text, value_in
  implicit none
  private

  public :: lock_t, holder_of, is_left_behind

  !> The right to write a file.
  type :: lock_t
    private
    character(:), allocatable :: file_name   !! of the lock file
    integer(c_int) :: descriptor = -1
    character(10) :: tag = ''                !! a part of the names of unfinished files
    logical, public :: was_left_behind = .false.   !! the lock, by a process that was killed while it wrote the file
  contains
    procedure :: take
    procedure :: scratch_name
    procedure :: release
    procedure, private :: try
    procedure, private :: write_text
  end type lock_t

  !> The process that has a lock, as the text of the lock says.
  type :: holder_t
    integer :: process = 0
    character(:), allocatable :: host, tag
  end type holder_t

  character(*), parameter :: signature = 'dynstiction lock', extension = '.lock', unfinished = '.part'
  character, parameter :: n = achar(10)
  integer, parameter :: longest_text = 1024

contains

  !> Take the lock of `file_name`, or say which process has it. Unfinished files of a killed process are removed.
  subroutine take(self, file_name, reason)
    class(lock_t), intent(out) :: self
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    ! For this long a child of a killed process may still be writing.
    integer, parameter :: most_tries = 100
    real(wp), parameter :: pause = 0.02_wp
    type(holder_t) :: before
    logical :: again
    integer :: i

    self%file_name = file_name//extension
    self%tag = unique_word()
    do i = 1, most_tries
      call self%try(before, again, reason)
      if (.not. again) exit
      call wait_seconds(pause)
    end do
    if (allocated(reason)) return
    self%was_left_behind = before%process > 0
    call remove_unfinished(file_name, before)
    call self%write_text(reason)
    if (allocated(reason)) call self%release()
  end subroutine take

  !> The name under which `file_name` is written until it is complete.
  pure function scratch_name(self, file_name) result(name)
    class(lock_t), intent(in) :: self
    character(*), intent(in) :: file_name
    character(:), allocatable :: name

    name = file_name//'.'//self%tag//unfinished
  end function scratch_name

  !> Let other processes write the file.
  subroutine release(self)
    class(lock_t), intent(inout) :: self

    if (self%descriptor < 0) return
    call delete_own_file(self%file_name, identity_of(self%descriptor))
    call close_descriptor(self%descriptor)
  end subroutine release

  !> Try once. `again`: the obstacle may be gone in a moment.
  subroutine try(self, before, again, reason)
    class(lock_t), intent(inout) :: self
    type(holder_t), intent(out) :: before              !! the process that had the lock, and has ended
    logical, intent(out) :: again
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(identity_t) :: identity
    logical :: is_new

    again = .false.
    call create_file(self%file_name, self%descriptor, reason)
    is_new = self%descriptor >= 0
    if (is_new) then
      identity = identity_of(self%descriptor)
      before = holder_in('')
    else
      if (c_errno() /= dst_eexist) then
        if (.not. is_folder(folder_of(self%file_name))) reason = 'the folder '//folder_of(self%file_name)// &
          ' does not exist: create it first'
        return
      end if
      identity = identity_of(self%file_name)
      call read_holder(self%file_name, identity, before, reason)
      if (allocated(reason)) return
      call open_own_file(self%file_name, identity, self%descriptor, reason)
      ! The process that had the lock may have removed it meanwhile.
      if (allocated(reason)) again = .not. identity_of(self%file_name) == identity
      if (allocated(reason)) return
    end if
    select case (lock_attempt(self%descriptor))
    case (locked)
      again = .not. identity_of(self%file_name) == identity
      if (again) reason = 'the lock changes hands: try again'
    case (held)
      ! The lock belongs to a child of a process that has ended, or to a process that has not written its name yet.
      again = has_ended(before) .or. before%process == 0
      reason = 'locked: another process is writing this file'//named(before)//': wait until it ends, or use another name'
    case (without_locks)
      if (.not. is_new) then
        again = has_ended(before)
        if (again) call delete_own_file(self%file_name, identity)
        reason = 'locked: another process is writing this file'//named(before)//', and this file system cannot say whether '// &
          'it still does: if it has ended, remove '//self%file_name
      end if
    end select
    if (allocated(reason)) call close_descriptor(self%descriptor)
  end subroutine try

  !> The process that the text of a lock names. A file that is not a lock is refused.
  subroutine read_holder(file_name, identity, holder, reason)
    character(*), intent(in) :: file_name
    type(identity_t), intent(in) :: identity
    type(holder_t), intent(out) :: holder
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    character(:), allocatable :: text, ignored

    text = ''
    if (identity%is_regular .and. identity%bytes > 0) call read_bytes(file_name, longest_text, text, ignored)
    holder = holder_in(text)
    ! A lock without text was created a moment ago, or its process was killed while it created the lock. A lock that is gone is no
    ! obstacle.
    if (.not. identity%exists .or. (identity%is_regular .and. identity%bytes == 0)) return
    if (index(text, signature//n) == 1) return
    if (identity_of(file_name) == identity) reason = file_name//' is no lock of this program: move it away'
  end subroutine read_holder

  !> Lines with a name and a value.
  pure type(holder_t) function holder_in(text) result(holder)
    character(*), intent(in) :: text
    character(:), allocatable :: process
    integer :: io_status

    process = value_in(text, 'process')
    read (process, *, iostat=io_status) holder%process
    if (io_status /= 0) holder%process = 0
    holder%host = value_in(text, 'host')
    holder%tag = value_in(text, 'tag')
  end function holder_in

  !> An unfinished file has the tag of its process in its name.
  subroutine remove_unfinished(file_name, holder)
    character(*), intent(in) :: file_name
    type(holder_t), intent(in) :: holder
    type(path_t), allocatable :: files(:)
    character(:), allocatable :: ending
    integer :: i

    if (len(holder%tag) /= len(unique_word())) return
    ending = '.'//holder%tag//unfinished
    call matching_files(file_name//'.', files)
    do i = 1, size(files)
      associate (name => files(i)%text)
        if (index(name, ending, back=.true.) == len(name) - len(ending) + 1) call delete_file(name)
      end associate
    end do
  end subroutine remove_unfinished

  subroutine write_text(self, reason)
    class(lock_t), intent(in) :: self
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    call set_file_size(self%descriptor, 0_int64)
    call write_bytes(self%descriptor, signature//n//'process '//integer_text(int(c_getpid()))//n//'host '//host_name()// &
      n//'tag '//self%tag//n, reason, 0_int64)
  end subroutine write_text

  !> Whether the process has certainly ended.
  logical function has_ended(holder)
    type(holder_t), intent(in) :: holder

    has_ended = .false.
    if (holder%process <= 0) return
    if (holder%host /= host_name()) return
    if (c_kill(int(holder%process, c_int), 0_c_int) /= 0) has_ended = c_errno() == dst_esrch
  end function has_ended

  !> Whether a process had the lock of a file and was killed: then the file was written by this program, in whatever state it is.
  logical function is_left_behind(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: reason
    type(holder_t) :: holder

    call read_holder(file_name//extension, identity_of(file_name//extension), holder, reason)
    is_left_behind = .not. allocated(reason) .and. holder%process > 0
  end function is_left_behind

  !> The other process that has the lock of a file: ' (process 123 on node7)'; '' if it is not known.
  function holder_of(file_name) result(text)
    character(*), intent(in) :: file_name
    character(:), allocatable :: text, reason
    type(holder_t) :: holder

    call read_holder(file_name//extension, identity_of(file_name//extension), holder, reason)
    if (holder%process == c_getpid()) holder%process = 0
    text = named(holder)
  end function holder_of

  !> ' (process 123 on node7)', as far as it is known.
  function named(holder) result(text)
    type(holder_t), intent(in) :: holder
    character(:), allocatable :: text

    text = ''
    if (holder%process > 0) text = ' (process '//integer_text(holder%process)//' on '//holder%host//')'
  end function named
end module dst_lock
