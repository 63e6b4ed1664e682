!> What a result file says about the run that wrote it, and whether that run can be gone on with.
module dst_hdf5_origin
  use hdf5, only: hid_t, h5fclose_f, h5lexists_f
  use dst_checkpoint, only: provenance_t
  use dst_disk, only: file_size
  use dst_errors, only: error_t, raise, file_error
  use dst_process, only: guard_t
  use dst_hdf5_tools, only: open_existing, damage_reason, get_attribute, get_text, hdf5_t
  use dst_text, only: printable
  implicit none
  private

  public :: origin_t, read_origin, check_is_result, is_hdf5, sweep_state_t, state_of_sweep, describe_result

  !> What the header of a result file says of the run.
  type, extends(provenance_t) :: origin_t
    integer :: complete = 0
    integer :: result_code = -1
    character(:), allocatable :: result_text
  end type origin_t

  !> What the result file of a sweep says of it.
  type :: sweep_state_t
    character(24) :: identity = ''               !! of the sweep; '' of what is no such file
    integer :: complete = 0, done = 0, failed = 0
  end type sweep_state_t

  !> What the attribute `program` of a result says.
  character(*), parameter :: this_program = 'dynstiction'

contains

  !> Whether a file is a result of this program. HDF5 may meet anything in it, so a child process looks.
  subroutine check_is_result(file_name, may_be_damaged, reason)
    character(*), intent(in) :: file_name
    logical, intent(in) :: may_be_damaged              !! one that HDF5 cannot read is a result all the same
    character(:), allocatable, intent(out) :: reason   !! unallocated if it is
    character(*), parameter :: remedy = ': use another name or remove it'
    type(guard_t) :: guard
    character(:), allocatable :: program
    type(hdf5_t) :: h5
    integer(hid_t) :: file

    if (.not. is_hdf5(file_name)) then
      reason = 'the file exists and is not an HDF5 file'//remedy
      return
    end if
    call guard%begin()
    if (guard%in_child) then
      call open_existing(file_name, file, h5)
      call get_attribute(file, 'program', program, h5)
      if (h5%status >= 0) then
        if (program == this_program) call guard%reply('')
      else if (may_be_damaged) then
        call guard%reply('')
      end if
      call guard%reply('the file exists and is no result of this program'//remedy)
    end if
    call guard%await(reason)
    if (.not. (allocated(reason) .or. may_be_damaged)) reason = 'the file exists, and HDF5 fails on it'//remedy
    if (.not. allocated(reason)) return
    if (reason == '') deallocate (reason)
  end subroutine check_is_result

  !> Whether a file begins like one of HDF5.
  logical function is_hdf5(file_name)
    character(*), intent(in) :: file_name
    character(*), parameter :: signature = char(137)//'HDF'//char(13)//char(10)//char(26)//char(10)
    character(len(signature)) :: beginning
    integer :: unit, io_status

    is_hdf5 = .false.
    if (file_size(file_name) < len(signature)) return
    open (newunit=unit, file=file_name, status='old', action='read', access='stream', form='unformatted', iostat=io_status)
    if (io_status /= 0) return
    read (unit, iostat=io_status) beginning
    is_hdf5 = io_status == 0 .and. beginning == signature
    close (unit)
  end function is_hdf5

  !> What a file says of its sweep. HDF5 may meet anything in it, so a child process looks.
  type(sweep_state_t) function state_of_sweep(file_name) result(state)
    character(*), intent(in) :: file_name
    type(guard_t) :: guard
    type(sweep_state_t) :: found
    character(:), allocatable :: identity, text
    character(80) :: answer
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    integer :: io_status

    if (.not. is_hdf5(file_name)) return
    call guard%begin()
    if (guard%in_child) then
      call open_existing(file_name, file, h5)
      call get_attribute(file, 'sweep_identity', identity, h5)
      call get_attribute(file, 'complete', found%complete, h5)
      call get_attribute(file, 'cases_done', found%done, h5)
      call get_attribute(file, 'cases_failed', found%failed, h5)
      if (h5%status < 0 .or. len(identity) /= len(found%identity)) call guard%reply('')
      write (answer, '(3(i0, 1x), a)') found%complete, found%done, found%failed, identity
      call guard%reply(trim(answer))
    end if
    call guard%await(text)
    io_status = 1
    if (allocated(text)) read (text, *, iostat=io_status) found%complete, found%done, found%failed, found%identity
    if (io_status == 0) state = found
  end function state_of_sweep

  !> What a result file is, in one line. A child process reads it.
  subroutine describe_result(file_name, text, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: text
    character(:), allocatable, intent(out) :: reason   !! unallocated on success
    type(guard_t) :: guard

    text = ''
    if (is_hdf5(file_name)) then
      call guard%begin()
      if (guard%in_child) call guard%reply(description(file_name))
      call guard%await(text)
      if (.not. allocated(text)) text = ''
    end if
    if (text == '') reason = 'it is no result of this program, or damaged: give a result file'
  end subroutine describe_result

  function description(file_name) result(text)
    character(*), intent(in) :: file_name
    character(:), allocatable :: text, program, model, method, created, version, revision, ending
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    integer :: complete

    call open_existing(file_name, file, h5)
    call get_attribute(file, 'program', program, h5)
    call get_attribute(file, 'model', model, h5)
    call get_attribute(file, 'method', method, h5)
    call get_attribute(file, 'created', created, h5)
    call get_attribute(file, 'version', version, h5)
    call get_attribute(file, 'git_revision', revision, h5)
    call get_attribute(file, 'complete', complete, h5)
    call get_attribute(file, 'result_text', ending, h5)
    text = ''
    if (h5%status < 0 .or. program /= this_program) return
    text = 'run'
    if (has(file, 'trade')) text = 'comparison of methods'
    if (has(file, 'sweep')) then
      text = 'sweep'
      if (has(file, 'sweep/series')) text = 'sweep with series'
      if (has(file, 'sweep/cycles')) text = 'sweep with cycles'
    end if
    text = printable(text//' of model '//model//', method '//method//', '//created//', dynstiction '//version//' ('// &
      revision//'): '//trim(merge('complete    ', 'not complete', complete == 1))//', '//ending)
  end function description

  logical function has(file, group)
    integer(hid_t), intent(in) :: file
    character(*), intent(in) :: group
    integer :: ignored

    call h5lexists_f(file, group, has, ignored)
  end function has

  !> Read the header of the result of a run that is to go on, an HDF5 file of which `result_file` says that it is not empty.
  subroutine read_origin(file_name, shown_name, origin, error)
    character(*), intent(in) :: file_name, shown_name
    type(origin_t), intent(out) :: origin
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer(hid_t) :: file
    integer :: ignored

    call open_existing(file_name, file, h5)
    call get_attribute(file, 'complete', origin%complete, h5)
    call get_attribute(file, 'result_code', origin%result_code, h5)
    call get_attribute(file, 'result_text', origin%result_text, h5)
    call get_attribute(file, 'created', origin%created, h5)
    call get_attribute(file, 'deck_sha256', origin%deck_sha256, h5)
    call get_text(file, 'deck/text', origin%deck_text, h5)
    call get_text(file, 'deck/resolved', origin%deck_resolved, h5)
    if (h5%status < 0) call raise(error, file_error, shown_name//': cannot resume: '//damage_reason(h5))
    if (file >= 0) call h5fclose_f(file, ignored)
  end subroutine read_origin
end module dst_hdf5_origin
