!> The stages of a result file FILE.h5: its name, its lock, the unfinished file with which it begins, its checkpoint, its seal, its
!> end.
!>
!> docs/checkpoints.md has the table of states. The rules: no file gets its name before it is complete; no file is replaced, changed
!> or removed that does not belong to this program, or that has become another file meanwhile; a process that does any of this has
!> the lock. This module does not depend on the contents of the file.
module dst_result_file
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_checkpoint, only: checkpoint_t, checkpoint_name, encoded, is_checkpoint, read_checkpoint
  use dst_disk, only: identity_t, identity_of, operator(==), close_descriptor, create_file, delete_file, delete_own_file, &
    file_exists, folder_of, is_folder, is_in_use, locked_by_a_reader, make_durable, make_name_durable, move_file, open_own_file, &
    place_file, place_of, system_reason, wait_seconds, write_bytes
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_origin, only: check_is_result, is_deck
  use dst_kinds, only: wp, int64
  use dst_lock, only: lock_t, holder_of, is_left_behind
  use dst_seal, only: seal, break_seal, sound_seal
  use dst_text, only: printable
  implicit none
  private

  public :: result_file_t, check_target

  !> A result file that this process writes.
  type :: result_file_t
    character(:), allocatable :: name              !! as given by the user
    character(:), allocatable, private :: place    !! the file that links lead to
    logical, private :: has_name = .false.         !! it has its own name, not that of an unfinished file
    logical, private :: is_durable = .false.       !! file and checkpoint survive a power failure
    type(lock_t), private :: lock
    type(identity_t), private :: replaced          !! the file that has the name which this one will get
    ! Always open: so no other file can be mistaken for one of them.
    integer(c_int), private :: own = -1
    integer(c_int), private :: checkpoint = -1
  contains
    procedure :: claim
    procedure :: claim_unfinished
    procedure :: path
    procedure :: adopt
    procedure :: replace_own
    procedure :: put_in_place
    procedure :: save_checkpoint
    procedure :: is_as_it_was_left
    procedure :: unseal
    procedure :: seal => seal_own
    procedure :: delete_checkpoint
    procedure :: discard
    procedure :: abandon
    procedure :: release
  end type result_file_t

contains

  !> Whether a result may get this name: it is free, or belongs to a result that is to be replaced. `claim` checks again.
  subroutine check_target(name, overwrite, error, was_left_behind)
    character(*), intent(in) :: name
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error
    logical, intent(in), optional :: was_left_behind   !! its writer was killed; else the lock next to it says so
    character(:), allocatable :: reason
    type(identity_t) :: there
    logical :: may_be_damaged

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
      if (is_checkpoint(checkpoint_name(place_of(name)))) reason = 'the file exists, of a run that did not reach its end: '// &
        'continue it with dynstiction resume '//printable(name)//', or begin again with --overwrite'
    else if (.not. there%is_regular) then
      reason = 'it is not a regular file: use another name'
    else if (is_in_use(name, for_writing=.true.)) then
      reason = 'another process is writing this file'//holder_of(place_of(name))//': wait for it or use another name'
    else if (there%bytes > 0) then
      ! A process that was killed may have left a file that HDF5 cannot read. A lock or a checkpoint shows that it is of this
      ! program.
      may_be_damaged = is_checkpoint(checkpoint_name(place_of(name)))
      if (present(was_left_behind)) then
        may_be_damaged = may_be_damaged .or. was_left_behind
      else if (is_left_behind(place_of(name))) then
        may_be_damaged = .true.
      end if
      call check_is_result(name, may_be_damaged, reason)
    end if
    if (allocated(reason)) call raise(error, file_error, name//': cannot create: '//reason)
  end subroutine check_target

  !> Reserve the name for a new result. From now on no other process can have it.
  subroutine claim(self, name, overwrite, error)
    class(result_file_t), intent(out) :: self
    character(*), intent(in) :: name
    logical, intent(in) :: overwrite
    type(error_t), allocatable, intent(out) :: error

    call take_lock(self, name, 'cannot create', error)
    if (.not. allocated(error)) call check_target(name, overwrite, error, self%lock%was_left_behind)
    if (.not. allocated(error)) call check_checkpoint(self, error)
    if (allocated(error)) call self%release()
    if (.not. allocated(error)) self%replaced = identity_of(self%place)
  end subroutine claim

  !> Take over the result of a run that did not reach its end, with its checkpoint. Without a checkpoint `missing` says why.
  subroutine claim_unfinished(self, name, checkpoint, missing, error)
    class(result_file_t), intent(out) :: self
    character(*), intent(in) :: name
    type(checkpoint_t), intent(out) :: checkpoint
    type(error_t), allocatable, intent(out) :: missing, error
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
    end if
    if (allocated(reason)) then
      call raise(error, file_error, name//': cannot resume: '//reason)
      return
    end if
    call take_lock(self, name, 'cannot resume', error)
    if (allocated(error)) return
    self%has_name = .true.
    call open_own_file(self%place, identity_of(self%place), self%own, reason)
    if (.not. allocated(reason)) call wait_for_readers(self%place, reason)
    if (allocated(reason)) then
      call raise(error, file_error, name//': cannot resume: '//reason)
      call self%release()
      return
    end if
    call read_checkpoint(self%place, name, checkpoint, missing)
    if (allocated(missing)) return
    call open_own_file(checkpoint_name(self%place), identity_of(checkpoint_name(self%place)), self%checkpoint, reason)
    self%is_durable = .not. allocated(reason)
    if (self%is_durable) return
    call raise(error, file_error, checkpoint_name(name)//': cannot resume: '//reason)
    call self%release()
  end subroutine claim_unfinished

  !> HDF5 opens a file for writing if no process reads it.
  subroutine wait_for_readers(file_name, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    integer, parameter :: most_tries = 10
    integer :: i

    do i = 1, most_tries
      if (.not. is_in_use(file_name, for_writing=.false.)) return
      call wait_seconds(0.05_wp)
    end do
    reason = locked_by_a_reader
  end subroutine wait_for_readers

  subroutine take_lock(self, name, purpose, error)
    type(result_file_t), intent(inout) :: self
    character(*), intent(in) :: name, purpose
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    self%name = name
    self%place = place_of(name)
    call self%lock%take(self%place, reason)
    if (allocated(reason)) call raise(error, file_error, name//': '//purpose//': '//reason)
  end subroutine take_lock

  !> A file with the checkpoint's name is replaced if it is a checkpoint: its result is gone, or will be replaced.
  subroutine check_checkpoint(self, error)
    type(result_file_t), intent(in) :: self
    type(error_t), allocatable, intent(out) :: error
    type(identity_t) :: there

    there = identity_of(checkpoint_name(self%place))
    if (.not. there%exists) return
    if (is_checkpoint(checkpoint_name(self%place))) return
    call raise(error, file_error, checkpoint_name(self%name)//': cannot write the checkpoint: a file of this name does not '// &
      'belong to this program: move it away')
  end subroutine check_checkpoint

  !> The path at which the file is to be created, or is.
  function path(self)
    class(result_file_t), intent(in) :: self
    character(:), allocatable :: path

    path = self%place
    if (.not. self%has_name) path = self%lock%scratch_name(self%place)
  end function path

  !> The file that has been created at `path` is this one.
  subroutine adopt(self)
    class(result_file_t), intent(inout) :: self
    character(:), allocatable :: ignored

    call close_descriptor(self%own)
    call open_own_file(self%path(), identity_of(self%path()), self%own, ignored)
  end subroutine adopt

  !> A new file is going to be created that will replace the present one.
  subroutine replace_own(self)
    class(result_file_t), intent(inout) :: self

    self%replaced = identity_of(self%own)
    self%has_name = .false.
  end subroutine replace_own

  !> Give the file its name.
  subroutine put_in_place(self, error)
    class(result_file_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    logical :: placed

    if (.not. self%replaced%exists) then
      call place_file(self%path(), self%place, placed)
    else
      placed = identity_of(self%place) == self%replaced
      if (placed) call move_file(self%path(), self%place, placed)
    end if
    if (placed) then
      self%has_name = .true.
    else
      call raise(error, file_error, self%name//': cannot create: another file has taken the name: use another name')
    end if
  end subroutine put_in_place

  !> Replace the checkpoint; the old one is kept until the new one is complete. `durable`: it survives a power failure.
  subroutine save_checkpoint(self, checkpoint, durable, error)
    class(result_file_t), intent(inout) :: self
    type(checkpoint_t), intent(in) :: checkpoint
    logical, intent(in) :: durable
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: place, unfinished, reason
    integer(c_int) :: descriptor
    logical :: moved

    place = checkpoint_name(self%place)
    unfinished = self%lock%scratch_name(place)
    call create_file(unfinished, descriptor, reason)
    if (.not. allocated(reason)) call write_bytes(descriptor, encoded(checkpoint), reason, 0_int64)
    if (durable .and. .not. allocated(reason)) call make_durable(descriptor, reason)
    if (.not. allocated(reason)) then
      call move_file(unfinished, place, moved)
      if (.not. moved) reason = system_reason()
    end if
    if (allocated(reason)) then
      if (descriptor >= 0) call delete_own_file(unfinished, identity_of(descriptor))
      call close_descriptor(descriptor)
      call raise(error, file_error, checkpoint_name(self%name)//': cannot write the checkpoint: '//reason)
      return
    end if
    call close_descriptor(self%checkpoint)
    self%checkpoint = descriptor
    self%is_durable = durable
    if (durable) call make_name_durable(folder_of(place))
  end subroutine save_checkpoint

  !> Whether the file still has the seal's `checksum`.
  logical function is_as_it_was_left(self, checksum)
    class(result_file_t), intent(in) :: self
    character(*), intent(in) :: checksum

    is_as_it_was_left = sound_seal(self%own) == checksum
  end function is_as_it_was_left

  !> The file is going to be changed: its seal is removed.
  subroutine unseal(self)
    class(result_file_t), intent(in) :: self

    call break_seal(self%own)
  end subroutine unseal

  !> Append the seal with its `checksum` to the file, which is open only here. Data that were durable stay durable.
  subroutine seal_own(self, checksum, error)
    class(result_file_t), intent(in) :: self
    character(:), allocatable, intent(out) :: checksum
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    call seal(self%own, checksum, reason)
    if (self%is_durable .and. .not. allocated(reason)) call make_durable(self%own, reason)
    if (.not. allocated(reason)) then
      if (.not. identity_of(self%path()) == identity_of(self%own)) &
        reason = 'the file or its folder was removed, renamed or replaced during the run'
    end if
    if (allocated(reason)) call raise(error, file_error, self%name//': cannot finish: '//reason)
  end subroutine seal_own

  !> Remove the checkpoint: there is nothing left to resume.
  subroutine delete_checkpoint(self)
    class(result_file_t), intent(inout) :: self

    if (self%checkpoint >= 0) call delete_own_file(checkpoint_name(self%place), identity_of(self%checkpoint))
  end subroutine delete_checkpoint

  !> Remove an unfinished file: its name has the tag of this process, so it can be no other file.
  subroutine discard(self)
    class(result_file_t), intent(in) :: self

    if (.not. self%has_name) call delete_file(self%path())
  end subroutine discard

  !> There will be no result: remove its unfinished files, and release the name.
  subroutine abandon(self)
    class(result_file_t), intent(inout) :: self

    call self%discard()
    call self%delete_checkpoint()
    call self%release()
  end subroutine abandon

  !> Release the name for other processes.
  subroutine release(self)
    class(result_file_t), intent(inout) :: self

    call close_descriptor(self%own)
    call close_descriptor(self%checkpoint)
    call self%lock%release()
  end subroutine release
end module dst_result_file
