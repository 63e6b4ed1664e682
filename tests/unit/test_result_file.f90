!> The life of a result file: which process has its name, what is refused and left unchanged.
!> Damage: tests/python/test_damaged_files.py and test_checkpoint.py.
program test_result_file
  use checks, only: check, finish
  use dst_disk, only: identity_t, identity_of, operator(==), delete_file, file_exists, place_file, matching_files, path_t
  use dst_ending, only: read_state
  use dst_errors, only: error_t
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_kinds, only: wp, int64
  use dst_result_file, only: result_file_t, interim_t
  use dst_writer, only: quantity_t, outcome_t
  implicit none

  character(*), parameter :: name = 'test_result_file.h5', part = name//'.part'
  integer(int64), parameter :: no_state(0) = 0

  call remove_all()
  call test_claim()
  call test_part()
  call test_life()
  call test_other_file()
  call test_interim()
  call remove_all()
  call finish()

contains

  subroutine test_claim()
    type(result_file_t) :: file
    type(error_t), allocatable :: error

    call file%claim('.', .true., error)
    call refused(error, 'it is a folder: give a file name')
    call file%claim(' ', .true., error)
    call refused(error, 'the file has no name')
    call file%claim('no/such/folder/x.h5', .true., error)
    call refused(error, 'the folder no/such/folder does not exist: create it first')
    call write_file(name, '&scene /')
    call file%claim(name, .false., error)
    call refused(error, 'the file exists: use --overwrite')
    call file%claim(name, .true., error)
    call refused(error, 'not an HDF5 file')
    call delete_file(name)
    call write_result(name, 'elsewhere')
    call file%claim(name, .true., error)
    call refused(error, 'no result of this program')
    call check('stays', file_exists(name))
    call check('refusals leave nothing', .not. file_exists(part))
    call remove_all()
  end subroutine test_claim

  !> One process at a time; what a killed process has left is used again, what is of others is refused.
  subroutine test_part()
    type(result_file_t) :: first, second
    type(error_t), allocatable :: error
    type(identity_t) :: file, after

    call first%claim(name, .false., error)
    call check('claimed', file_exists(part) .and. .not. allocated(error))
    call second%claim(name, .false., error)
    call refused(error, 'another process is writing this file')
    call first%discard()
    call check('gone', .not. file_exists(part))
    call write_result(part, 'dynstiction')
    call first%claim(name, .false., error)
    file = identity_of(part)
    call check('left by a killed process', .not. allocated(error) .and. file%bytes == 0)
    call first%discard()
    call write_file(part, 'precious')
    call first%claim(name, .false., error)
    call refused(error, 'does not belong to this program: move it away')
    call check('and stays', file_exists(part))
    call delete_file(part)
    call write_result(name, 'dynstiction')
    file = identity_of(name)
    call execute_command_line('ln '//name//' '//part)
    call first%claim(name, .true., error)
    call check('two names: the process was killed when the file had both', .not. allocated(error))
    after = identity_of(name)
    call check('the file is whole', after == file .and. after%bytes == file%bytes)
    call first%discard()
    call remove_all()
  end subroutine test_part

  !> A file is replaced, goes on with a state, and ends without one.
  subroutine test_life()
    type(result_file_t) :: file, second
    type(error_t), allocatable :: error
    type(identity_t) :: before
    integer(int64), allocatable :: state(:)
    character(:), allocatable :: reason

    call write_result(name, 'dynstiction')
    before = identity_of(name)
    call file%claim(name, .true., error)
    call check('the old file is still there', identity_of(name) == before)
    call replace_contents('new')
    call file%put_in_place([3_int64, 4_int64], error)
    call check('in place', .not. allocated(error))
    call check('in the place of the old one', .not. identity_of(name) == before)
    call check('the part is gone', .not. file_exists(part))
    call read_state(name, state, reason)
    call check('the state', .not. allocated(reason) .and. size(state) == 2)
    if (size(state) == 2) call check('the words of the state', all(state == [3_int64, 4_int64]))
    call second%claim(name, .false., error)
    call refused(error, 'continue it with dynstiction resume')
    call second%claim_again(name, error)
    call refused(error, 'another process is writing this file')
    call file%begin_next(error)
    call check('goes on', file_exists(part) .and. .not. allocated(error))
    call second%claim_again(name, error)
    call refused(error, 'another process is writing this file')
    call replace_contents('newer')
    call file%put_in_place(no_state, error)
    call file%discard()
    call read_state(name, state, reason)
    call check('at its end there is no state', .not. allocated(reason) .and. size(state) == 0)
    call remove_all()
    call second%claim_again(name, error)
    call refused(error, 'there is no such file')
    call check('no part is left', .not. file_exists(part))
  end subroutine test_life

  !> A file that has taken a name meanwhile is not changed, and what was computed is kept.
  subroutine test_other_file()
    type(result_file_t) :: file
    type(error_t), allocatable :: error
    type(identity_t) :: other
    logical :: placed

    call file%claim(name, .false., error)
    call replace_contents('new')
    call write_file(name, 'of another')
    call file%put_in_place(no_state, error)
    call refused(error, 'another file has taken the name')
    other = identity_of(name)
    call check('it stays', other%bytes == len('of another'))
    call check('the result is kept', file_exists(name//'.kept'))
    call check('not as a part', .not. file_exists(part))
    call remove_all()
    call file%claim(name, .false., error)
    call replace_contents('new')
    call delete_file(part)
    call write_file(part, 'of another')
    call file%put_in_place(no_state, error)
    call refused(error, 'removed, renamed or replaced')
    other = identity_of(part)
    call check('it stays, too', other%bytes == len('of another'))
    call remove_all()
    ! While the rows of a file that was made whole are copied.
    call file%claim(name, .false., error)
    call replace_contents('new')
    call file%put_in_place([3_int64], error)
    call file%begin_next(error)
    call file%check_former(error)
    call check('the rows are its own', .not. allocated(error))
    call write_file('other', 'of another')
    call delete_file(name)
    call place_file('other', name, placed)
    call file%check_former(error)
    call refused(error, 'another file has taken the name')
    call file%discard()
    call remove_all()
  end subroutine test_other_file

  !> After the interval, or a third of the time so far.
  subroutine test_interim()
    type(interim_t) :: interim

    interim = interim_t(10.0_wp, begun=100.0_wp, made=100.0_wp)
    call check('too early', .not. interim%is_due(109.0_wp))
    call check('after the interval', interim%is_due(110.0_wp))
    interim%made = 200.0_wp
    call check('less than a third', .not. interim%is_due(249.0_wp))
    call check('a third', interim%is_due(250.0_wp))
    interim%interval = 0.0_wp
    call check('never', .not. interim%is_due(1.0e9_wp))
  end subroutine test_interim

  !> As HDF5 does: the file keeps its identity.
  subroutine replace_contents(text)
    character(*), intent(in) :: text
    integer :: unit

    open (newunit=unit, file=part, access='stream', form='unformatted', status='old', action='readwrite')
    write (unit) text
    close (unit)
  end subroutine replace_contents

  !> An HDF5 file that names the program that wrote it.
  subroutine write_result(file_name, program)
    character(*), intent(in) :: file_name, program
    type(hdf5_writer_t) :: writer
    type(run_metadata_t) :: metadata
    type(quantity_t) :: no_columns(0)
    type(outcome_t) :: nothing
    type(error_t), allocatable :: error

    metadata%program = program
    metadata%version = '0'
    metadata%git_revision = '0'
    metadata%compiler = '0'
    metadata%build_flags = ''
    metadata%host = ''
    metadata%job = ''
    metadata%created = '0'
    metadata%model = 'full'
    metadata%method = 'radau9'
    metadata%deck_text = ''
    metadata%deck_resolved = ''
    metadata%deck_sha256 = ''
    nothing%result_text = ''
    call create_hdf5(writer, file_name, file_name, metadata, no_columns, error)
    call writer%finish(nothing, error)
  end subroutine write_result

  subroutine write_file(file_name, text)
    character(*), intent(in) :: file_name, text
    integer :: unit, io_status

    open (newunit=unit, file=file_name, status='new', action='write', access='stream', form='unformatted', iostat=io_status)
    if (io_status == 0) write (unit, iostat=io_status) text
    call check('written '//file_name, io_status == 0)
    close (unit)
  end subroutine write_file

  subroutine refused(error, words)
    type(error_t), allocatable, intent(in) :: error
    character(*), intent(in) :: words

    call check('refused: '//words, allocated(error))
    if (allocated(error)) call check(words//' in '//error%text, index(error%text, words) > 0)
  end subroutine refused

  subroutine remove_all()
    type(path_t), allocatable :: files(:)
    integer :: i

    call matching_files(name, files)
    do i = 1, size(files)
      call delete_file(files(i)%text)
    end do
  end subroutine remove_all
end program test_result_file
