!> Files that a result file must leave alone, and when one is made in between. The rest of its life:
!> tests/python/test_checkpoint.py, test_file.py, test_damaged_files.py, and tests/faults.
program test_result_file
  use, intrinsic :: iso_c_binding, only: c_int
  use checks, only: check, finish
  use dst_disk, only: identity_t, identity_of, operator(==), close_descriptor, create_file, delete_file, file_exists, write_bytes
  use dst_errors, only: error_t
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_kinds, only: wp, int64
  use dst_result_file, only: result_file_t, interim_t
  use dst_writer, only: quantity_t, outcome_t
  implicit none

  character(*), parameter :: name = 'test_result_file.h5', part = name//'.part'

  call delete_file(name)
  call delete_file(part)
  call test_claim()
  call test_replaced_part()
  call test_interim()
  call finish()

contains

  subroutine test_claim()
    type(result_file_t) :: file
    type(error_t), allocatable :: error
    type(identity_t) :: before, after

    call file%claim(' ', .true., error)
    call check('no name', refused(error, 'the file has no name'))
    call write_result(name, 'elsewhere')
    call file%claim(name, .true., error)
    call check('a result of another program', refused(error, 'no result of this program'))
    call check('stays', file_exists(name))
    call check('a refusal leaves nothing', .not. file_exists(part))
    call delete_file(name)
    ! Two names: the process was killed when the file had both.
    call write_result(name, 'dynstiction')
    call execute_command_line('ln '//name//' '//part)
    before = identity_of(name)
    call file%claim(name, .true., error)
    after = identity_of(name)
    call check('the file is whole', .not. allocated(error) .and. after == before .and. after%bytes == before%bytes)
    call file%discard()
    call delete_file(name)
  end subroutine test_claim

  !> Another file that has taken the name of the part is not changed.
  subroutine test_replaced_part()
    type(result_file_t) :: file
    type(error_t), allocatable :: error
    type(identity_t) :: other
    integer(int64), parameter :: no_state(0) = 0

    call file%claim(name, .false., error)
    call delete_file(part)
    call write_file(part, 'of another')
    call file%put_in_place(no_state, error)
    call check('another file has the name of the part', refused(error, 'removed, renamed or replaced'))
    other = identity_of(part)
    call check('it stays', other%bytes == len('of another'))
    call delete_file(part)
  end subroutine test_replaced_part

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
end program test_result_file
