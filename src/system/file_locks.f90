!> Locks of open files (flock). The locks of a process end with it.
module dst_file_locks
  use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, nul => c_null_char
  use dst_clock, only: wait_seconds
  use dst_kinds, only: wp
  use dst_posix, only: c_close, c_errno, c_flock, c_look_up, c_open, dst_ewouldblock, dst_lock_ex, dst_lock_nb, dst_lock_sh, &
    dst_o_nonblock, dst_o_rdonly
  implicit none
  private

  public :: lock_attempt, locked, held, without_locks, is_locked_elsewhere, process_with_lock
  public :: is_in_use

  !> Outcomes of an attempt to lock.
  integer, parameter :: locked = 0, held = 1, without_locks = 2

contains

  !> Lock a file; the outcome is `held` if another process has the lock, or `without_locks` if the file system has no locks.
  integer function lock_attempt(descriptor, shared) result(outcome)
    integer(c_int), intent(in) :: descriptor
    logical, intent(in), optional :: shared            !! with other processes that lock it as shared
    integer(c_int) :: operation

    operation = dst_lock_ex
    if (present(shared)) operation = merge(dst_lock_sh, dst_lock_ex, shared)
    outcome = locked
    if (c_flock(descriptor, operation + dst_lock_nb) /= 0) outcome = merge(held, without_locks, c_errno() == dst_ewouldblock)
  end function lock_attempt

  !> Lock an open file until it is closed; true if another process has the lock, and not only for the moment in which it checks
  !> whether the file is locked. A file system without locks is trusted.
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

  !> The process of this machine that has locked a file, from the list that Linux keeps; 0 if there is none in it.
  integer function process_with_lock(file_name) result(process)
    character(*), intent(in) :: file_name
    character(160) :: line
    character(16) :: words(4)
    character(64) :: place
    character(20) :: inode
    integer(c_int64_t) :: facts(5)
    integer :: unit, status, number

    process = 0
    if (c_look_up(-1_c_int, file_name//nul, facts) /= 0) return
    write (inode, '(i0)') facts(4)
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

  !> Whether another process has a file open and locked for writing.
  logical function is_in_use(file_name)
    character(*), intent(in) :: file_name
    integer(c_int) :: descriptor, ignored

    is_in_use = .false.
    descriptor = c_open(file_name//nul, dst_o_rdonly + dst_o_nonblock)
    if (descriptor < 0) return
    is_in_use = lock_attempt(descriptor, shared=.true.) == held
    ignored = c_close(descriptor)
  end function is_in_use
end module dst_file_locks
