!> The stages of a result file: which process has its name, what is refused and left unchanged, what a killed process leaves.
program test_result_file
  use, intrinsic :: iso_c_binding, only: c_int
  use checks, only: check, finish
  use dst_checkpoint, only: checkpoint_t, read_checkpoint
  use dst_disk, only: identity_t, identity_of, operator(==), close_descriptor, create_file, delete_file, file_exists, move_file, &
    path_t, matching_files, write_bytes
  use dst_errors, only: error_t
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_kinds, only: int64
  use dst_lock, only: lock_t
  use dst_result_file, only: result_file_t
  use dst_writer, only: quantity_t
  implicit none

  character(*), parameter :: name = 'test_result_file.h5', n = achar(10)

  call remove_all()
  call test_lock()
  call test_claim()
  call test_life()
  call test_other_file()
  call remove_all()
  call finish()

contains

  !> One process at a time; a lock that no process has is taken over with the unfinished files of its process.
  subroutine test_lock()
    type(lock_t) :: first, second
    character(:), allocatable :: reason
    character(10), parameter :: tag = 'abcdefghij'

    call first%take(name, reason)
    call check('taken', file_exists(name//'.lock') .and. .not. allocated(reason))
    call second%take(name, reason)
    call check('held', holds(reason, 'another process is writing this file (process '))
    call first%release()
    call check('gone', .not. file_exists(name//'.lock'))
    call second%release()

    call write_file(name//'.lock', 'dynstiction lock'//n//'process 4194305'//n//'host nowhere'//n//'tag '//tag//n)
    call write_file(name//'.'//tag//'.part', 'unfinished')
    call write_file(name//'.checkpoint.'//tag//'.part', 'unfinished')
    call write_file(name//'.other.part', 'of another')
    call first%take(name, reason)
    call check('taken over', .not. allocated(reason))
    call check('the unfinished result is gone', .not. file_exists(name//'.'//tag//'.part'))
    call check('the unfinished checkpoint is gone', .not. file_exists(name//'.checkpoint.'//tag//'.part'))
    call check('what is of others stays', file_exists(name//'.other.part'))
    call check('a name of its own', first%scratch_name(name) /= second%scratch_name(name))
    call first%release()
    call first%release()

    call write_file(name//'.lock', 'precious')
    call first%take(name, reason)
    call check('what is no lock is refused', holds(reason, 'no lock of this program: move it away'))
    call first%release()
    call check('and stays', file_exists(name//'.lock'))
    call remove_all()
    call first%take('no/such/folder/x.h5', reason)
    call check('no folder', holds(reason, 'the folder no/such/folder does not exist: create it first'))
  end subroutine test_lock

  subroutine test_claim()
    type(result_file_t) :: file
    type(error_t), allocatable :: error

    call file%claim('.', .true., error)
    call check('a folder', refused(error, 'it is a folder: give a file name'))
    call file%claim(' ', .true., error)
    call check('no name', refused(error, 'the file has no name'))
    call write_file(name, '&scene /')
    call file%claim(name, .false., error)
    call check('an existing file', refused(error, 'the file exists: use --overwrite'))
    call file%claim(name, .true., error)
    call check('what is not HDF5', refused(error, 'not an HDF5 file'))
    call delete_file(name)
    call write_result('elsewhere')
    call file%claim(name, .true., error)
    call check('a result of another program', refused(error, 'no result of this program'))
    call check('stays', file_exists(name))
    call delete_file(name)
    call write_file(name//'.checkpoint', 'precious')
    call file%claim(name, .true., error)
    call check('what is no checkpoint', refused(error, 'does not belong to this program: move it away'))
    call check('refusals leave no lock', .not. file_exists(name//'.lock'))
    call remove_all()
  end subroutine test_claim

  !> From the claim to the seal.
  subroutine test_life()
    type(result_file_t) :: file, second
    type(checkpoint_t) :: checkpoint
    type(error_t), allocatable :: error, missing
    type(identity_t) :: before
    character(:), allocatable :: checksum

    call write_result('dynstiction')
    before = identity_of(name)
    call file%claim(name, .true., error)
    call check('claimed', .not. allocated(error))
    call second%claim(name, .true., error)
    call check('claimed once', refused(error, 'another process is writing'))
    call write_file(file%path(), 'new')
    call file%adopt()
    call file%save_checkpoint(some_checkpoint(), .false., error)
    call check('a checkpoint', file_exists(name//'.checkpoint') .and. .not. allocated(error))
    call check('the old file is still there', identity_of(name) == before)
    call file%put_in_place(error)
    call check('in place', .not. allocated(error))
    call check('in the place of the old one', .not. identity_of(name) == before)
    call file%seal(checksum, error)
    call check('sealed', .not. allocated(error) .and. checksum /= '-')
    call file%release()

    call second%claim_unfinished(name, checkpoint, missing, error)
    call check('something to resume', .not. allocated(error) .and. .not. allocated(missing))
    call check('the same checkpoint', checkpoint%deck_text == 'a deck' .and. all(checkpoint%words == [1_int64, 2_int64]))
    call check('as it was left', second%is_as_it_was_left(checksum))
    call second%unseal()
    before = identity_of(name)
    call check('without its seal', before%bytes == len('new'))
    call check('not as it was left', .not. second%is_as_it_was_left(checksum))
    call second%delete_checkpoint()
    call second%release()
    call second%claim_unfinished(name, checkpoint, missing, error)
    call check('without a checkpoint', allocated(missing))
    call second%release()
    call remove_all()
    call second%claim_unfinished(name, checkpoint, missing, error)
    call check('nothing to resume', refused(error, 'there is no such file'))
    call check('no lock is left', .not. file_exists(name//'.lock'))
  end subroutine test_life

  !> A file that has taken a name meanwhile is not changed.
  subroutine test_other_file()
    type(result_file_t) :: file
    type(error_t), allocatable :: error
    type(identity_t) :: other
    character(:), allocatable :: checksum
    logical :: moved

    call file%claim(name, .false., error)
    call write_file(file%path(), 'new')
    call file%adopt()
    call write_file(name, 'of another')
    call file%put_in_place(error)
    call check('another file has the name', refused(error, 'another file has taken the name'))
    call file%abandon()
    other = identity_of(name)
    call check('it stays', other%bytes == len('of another'))
    call delete_file(name)

    call file%claim(name, .false., error)
    call write_file(file%path(), 'new')
    call file%adopt()
    call file%save_checkpoint(some_checkpoint(), .true., error)
    call file%put_in_place(error)
    call move_file(name, name//'.moved', moved)
    call write_file(name, 'of another')
    call delete_file(name//'.checkpoint')
    call write_file(name//'.checkpoint', 'of another')
    call file%seal(checksum, error)
    call check('no seal for another file', refused(error, 'removed, renamed or replaced'))
    call file%delete_checkpoint()
    call file%release()
    other = identity_of(name)
    call check('it stays as it is', other%bytes == len('of another'))
    call check('so does what is called like the checkpoint', file_exists(name//'.checkpoint'))
    call remove_all()
  end subroutine test_other_file

  !> An HDF5 file that names the program that wrote it.
  subroutine write_result(program)
    character(*), intent(in) :: program
    type(hdf5_writer_t) :: writer
    type(run_metadata_t) :: metadata
    type(quantity_t) :: no_columns(0)
    type(error_t), allocatable :: error

    metadata%program = program
    metadata%version = '0'
    metadata%git_revision = '0'
    metadata%compiler = '0'
    metadata%build_flags = ''
    metadata%host = ''
    metadata%job = ''
    metadata%mpi = ''
    metadata%created = '0'
    metadata%model = 'full'
    metadata%method = 'radau9'
    metadata%deck_text = ''
    metadata%deck_resolved = ''
    metadata%deck_sha256 = ''
    call create_hdf5(writer, name, name, metadata, no_columns, error)
    call writer%discard()
  end subroutine write_result

  type(checkpoint_t) function some_checkpoint() result(checkpoint)
    checkpoint%version = '0'
    checkpoint%git_revision = '0'
    checkpoint%compiler = '0'
    checkpoint%deck_sha256 = '0'
    checkpoint%created = '0'
    checkpoint%result_checksum = '-'
    checkpoint%deck_text = 'a deck'
    checkpoint%deck_resolved = 'a deck'
    allocate (checkpoint%words, source=[1_int64, 2_int64])
  end function some_checkpoint

  subroutine write_file(file_name, text)
    character(*), intent(in) :: file_name, text
    character(:), allocatable :: reason
    integer(c_int) :: descriptor

    call create_file(file_name, descriptor, reason)
    if (.not. allocated(reason)) call write_bytes(descriptor, text, reason, 0_int64)
    call check('written '//file_name, .not. allocated(reason))
    call close_descriptor(descriptor)
  end subroutine write_file

  logical function refused(error, words)
    type(error_t), allocatable, intent(in) :: error
    character(*), intent(in) :: words

    refused = allocated(error)
    if (refused) refused = index(error%text, words) > 0
  end function refused

  logical function holds(reason, words)
    character(:), allocatable, intent(in) :: reason
    character(*), intent(in) :: words

    holds = allocated(reason)
    if (holds) holds = index(reason, words) > 0
  end function holds

  subroutine remove_all()
    type(path_t), allocatable :: files(:)
    integer :: i

    call matching_files(name, files)
    do i = 1, size(files)
      call delete_file(files(i)%text)
    end do
  end subroutine remove_all
end program test_result_file
