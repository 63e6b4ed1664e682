!> A result file is never changed, only replaced: it is written as NAME.part, and gets its name NAME when it is whole.
!>
!> So under the name there is nothing, the former file, or a whole one, at every moment. NAME.part is also the lock: this process
!> has it open and locked (flock), and the file that it becomes stays locked until the work ends or has a new NAME.part. One that no
!> process has locked was left by a process that was killed, and is used again. docs/checkpoints.md has the states.
module dst_result_file
  use, intrinsic :: iso_c_binding, only: c_double, c_int, nul => c_null_char
  use dst_disk, only: identity_t, identity_of, operator(==), close_descriptor, file_exists, folder_of, is_folder, is_written, &
    place_of, system_reason
  use dst_ending, only: append_ending, read_state
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_origin, only: check_is_result, is_deck, is_hdf5
  use dst_kinds, only: wp, int64
  use dst_posix, only: c_fsync, c_is_locked, c_keep_mode, c_open_locked, c_place, c_remove_own, c_rename, c_sync_folder, &
    set_file_size, wait_seconds
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: result_file_t, interim_t, check_target

  !> A result file that this process writes.
  type :: result_file_t
    character(:), allocatable :: name                !! as given by the user
    character(:), allocatable :: place               !! the file that links lead to
    type(identity_t), private :: former              !! the file that will be replaced
    integer(c_int), private :: descriptor = -1       !! of NAME.part, or of what it became: the lock
  contains
    procedure :: claim
    procedure :: claim_again
    procedure :: path
    procedure :: check_former
    procedure :: put_in_place
    procedure :: begin_next
    procedure :: discard
  end type result_file_t

  !> When a file is made whole while the work goes on: after the given interval, or a third of the time so far if that is longer.
  type :: interim_t
    real(wp) :: interval = 0.0_wp          !! s; 0: never
    real(wp) :: begun = 0.0_wp             !! wall clock when the work began [s]
    real(wp) :: made = 0.0_wp              !! wall clock when the file was made whole last [s]
  contains
    procedure :: is_due
  end type interim_t

contains

  !> Whether it is time, by the wall clock [s], to make the file whole.
  pure logical function is_due(self, now)
    class(interim_t), intent(in) :: self
    real(wp), intent(in) :: now

    is_due = self%interval > 0.0_wp .and. now - self%made >= max(self%interval, (now - self%begun)/3)
  end function is_due

  !> Whether a result may get this name: it is free, or belongs to a result that is to be replaced. `claim` checks again.
  subroutine check_target(name, overwrite, error)
    character(*), intent(in) :: name
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    type(identity_t) :: there

    there = identity_of(place_of(name))
    if (trim(name) == '') then
      reason = 'the file has no name: give one with -o'
    else if (is_folder(name)) then
      reason = 'it is a folder: give a file name'
    else if (.not. is_folder(folder_of(name))) then
      reason = 'the folder '//folder_of(name)//' does not exist: create it first'
      if (file_exists(folder_of(name))) reason = folder_of(name)//' is not a folder'
    else if (.not. there%exists) then
      return
    else if (.not. file_exists(name)) then
      reason = 'it is a symbolic link to a file that does not exist: remove it, or name that file'
    else if (.not. overwrite) then
      reason = 'the file exists: use --overwrite or another name'
      if (can_be_resumed(place_of(name))) reason = 'the file exists, of a run that did not reach its end: '// &
        'continue it with dynstiction resume '//printable(name)//', or begin again with --overwrite'
    else if (.not. there%is_regular) then
      reason = 'it is not a regular file: use another name'
    else if (there%bytes > 0) then
      call check_is_result(name, reason)
    end if
    if (allocated(reason)) call raise(error, file_error, name//': cannot create: '//reason)
  end subroutine check_target

  logical function can_be_resumed(path)
    character(*), intent(in) :: path
    integer(int64), allocatable :: state(:)
    character(:), allocatable :: reason

    call read_state(path, state, reason)
    can_be_resumed = size(state) > 0 .and. .not. allocated(reason)
  end function can_be_resumed

  !> Reserve the name for a new result. From now on no other process of this program can have it.
  subroutine claim(self, name, overwrite, error)
    class(result_file_t), intent(out) :: self
    character(*), intent(in) :: name
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    call check_target(name, overwrite, error)
    if (allocated(error)) return
    call take_part(self, name, reason)
    if (.not. allocated(reason)) then
      ! What was checked may have got its end, or another file, since then.
      call check_target(name, overwrite, error)
      if (allocated(error)) call self%discard()
    else
      call raise(error, file_error, name//': cannot create: '//reason)
    end if
  end subroutine claim

  !> Reserve the name of a file from which the work goes on: a new file with its rows will replace it.
  subroutine claim_again(self, name, error)
    class(result_file_t), intent(out) :: self
    character(*), intent(in) :: name
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason
    type(identity_t) :: there

    there = identity_of(place_of(name))
    if (.not. file_exists(name)) then
      reason = 'there is no such file: give the result file of the run'
    else if (is_folder(name)) then
      reason = 'it is a folder: give the result file of the run'
    else if (.not. there%is_regular .or. there%bytes == 0) then
      reason = 'it is empty or not a regular file: run the deck again'
    else if (is_deck(name)) then
      reason = 'it is a deck: dynstiction run '//printable(name)//' runs it; resume takes the result file of a run'
    else
      call take_part(self, name, reason)
    end if
    if (allocated(reason)) call raise(error, file_error, name//': cannot resume: '//reason)
  end subroutine claim_again

  !> Make NAME.part and lock it.
  subroutine take_part(self, name, reason)
    class(result_file_t), intent(inout) :: self
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    self%name = name
    self%place = place_of(name)
    call open_part(self%place, self%descriptor, reason)
    if (allocated(reason)) return
    self%former = identity_of(self%place)
    ! Its process has just made it whole, and goes on.
    if (.not. c_is_locked(self%place//nul)) return
    reason = is_written
    call self%discard()
  end subroutine take_part

  !> Create NAME.part, locked and empty; one that a killed process has left is used again.
  subroutine open_part(name, descriptor, reason)
    character(*), intent(in) :: name
    integer(c_int), intent(out) :: descriptor
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer, parameter :: most_tries = 2
    character(:), allocatable :: part
    type(identity_t) :: there
    integer :: i

    part = name//'.part'
    do i = 1, most_tries
      descriptor = c_open_locked(part//nul)
      if (descriptor < 0) reason = system_reason()
      if (descriptor < 0) return
      there = identity_of(descriptor)
      if (.not. there == identity_of(name)) exit
      ! The whole file has this name, too: its process was killed before it could take it away.
      call c_remove_own(part//nul, descriptor)
      call close_descriptor(descriptor)
    end do
    if (descriptor < 0) then
      reason = part//' is the same file, and cannot be removed'
    else if (there%bytes > 0) then
      if (.not. is_hdf5(part)) reason = 'a file called '//part//' does not belong to this program: move it away'
      if (allocated(reason)) then
        call close_descriptor(descriptor)
      else
        call set_file_size(descriptor, 0_int64)
      end if
    end if
  end subroutine open_part

  !> The path at which the file is written.
  function path(self)
    class(result_file_t), intent(in) :: self
    character(:), allocatable :: path

    path = self%place//'.part'
  end function path

  !> After its rows were copied, the file that has the name must still be the one that was found or made there; if there is none any
  !> more, the end says so.
  subroutine check_former(self, error)
    class(result_file_t), intent(in) :: self
    type(error_t), allocatable, intent(out) :: error
    type(identity_t) :: there

    there = identity_of(self%place)
    if (there%exists .and. .not. there == self%former) call raise(error, file_error, self%name//': cannot go on: another file '// &
      'has taken the name, and with it the rows so far: run the deck again')
  end subroutine check_former

  !> Give the file, which HDF5 has closed, its ending and its name. After an error NAME.part is gone. If another file has taken the
  !> name meanwhile, what was computed is kept beside it.
  subroutine put_in_place(self, state, error)
    class(result_file_t), intent(inout) :: self
    integer(int64), intent(in), contiguous :: state(:)   !! from which the run can be resumed; empty: it can not
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    call append_ending(self%descriptor, state, reason)
    if (.not. allocated(reason)) then
      if (c_fsync(self%descriptor) /= 0) reason = system_reason()
    end if
    if (.not. allocated(reason)) then
      if (.not. identity_of(self%path()) == identity_of(self%descriptor)) &
        reason = 'the file or its folder was removed, renamed or replaced during the run'
    end if
    if (.not. allocated(reason)) call take_name(self, reason)
    if (.not. allocated(reason)) return
    call self%discard()
    call raise(error, file_error, self%name//': cannot finish: '//reason)
  end subroutine put_in_place

  subroutine take_name(self, reason)
    class(result_file_t), intent(inout) :: self
    character(:), allocatable, intent(out) :: reason
    character(:), allocatable :: kept, failure
    type(identity_t) :: there, own
    logical :: placed
    integer :: i

    there = identity_of(self%place)
    own = identity_of(self%descriptor)
    placed = .false.
    if (.not. there%exists) then
      placed = c_place(self%path()//nul, self%place//nul) == 0
    else if (there == self%former) then
      call c_keep_mode(self%place//nul, self%descriptor)
      placed = c_rename(self%path()//nul, self%place//nul) == 0
    end if
    if (placed) then
      self%former = own
      call c_sync_folder(folder_of(self%place)//nul)
      return
    end if
    failure = system_reason()
    there = identity_of(self%place)
    if (.not. there%exists .or. there == self%former) then
      reason = failure
      return
    end if
    reason = 'another file has taken the name'
    do i = 1, 99
      kept = self%place//'.kept'
      if (i > 1) kept = kept//integer_text(i)
      if (c_place(self%path()//nul, kept//nul) /= 0) cycle
      reason = reason//': the result is in '//kept
      return
    end do
  end subroutine take_name

  !> The file has its name, and the work goes on in a new one: NAME.part again.
  subroutine begin_next(self, error)
    class(result_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    integer, parameter :: most_tries = 200
    character(:), allocatable :: reason
    integer(c_int) :: next
    integer :: i

    ! A process that may not have the name has looked at it, and lets go.
    do i = 1, most_tries
      call open_part(self%place, next, reason)
      if (.not. allocated(reason)) exit
      if (reason /= is_written) exit
      call wait_seconds(0.005_c_double)
    end do
    call close_descriptor(self%descriptor)
    self%descriptor = next
    if (.not. allocated(reason)) return
    self%descriptor = -1
    call raise(error, file_error, self%name//': cannot go on: '//reason//'; everything so far is in the file')
  end subroutine begin_next

  !> There will be no new file: remove NAME.part, if there is one, and release the name.
  subroutine discard(self)
    class(result_file_t), intent(inout) :: self

    if (self%descriptor < 0) return
    call c_remove_own(self%path()//nul, self%descriptor)
    call close_descriptor(self%descriptor)
  end subroutine discard
end module dst_result_file
