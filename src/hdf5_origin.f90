!> What a result file says about the run that wrote it, and whether that run can be gone on with.
module dst_hdf5_origin
  use hdf5, only: hid_t, h5fclose_f
  use dst_disk, only: file_exists, file_size, is_folder
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_tools, only: open_existing, damage_reason, get_attribute, get_text, refusal_t
  implicit none
  private

  public :: origin_t, read_origin

  !> What the header of a result file says of the run.
  type :: origin_t
    integer :: complete = 0
    integer :: result_code = -1
    character(:), allocatable :: result_text, created, deck_sha256
    character(:), allocatable :: deck_text       !! the deck as read
    character(:), allocatable :: deck_resolved   !! every key as used
  end type origin_t

contains

  !> Read the header of the result of a run that is to go on.
  subroutine read_origin(file_name, origin, error)
    character(*), intent(in) :: file_name
    type(origin_t), intent(out) :: origin
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: reason

    if (.not. file_exists(file_name)) then
      reason = 'there is no such file: give the result file of the run'
    else if (is_folder(file_name)) then
      reason = 'it is a folder: give the result file of the run'
    else if (file_size(file_name) <= 0) then
      reason = 'it is empty or not a regular file: run the deck again'
    else
      call read_fields(file_name, origin, reason)
    end if
    if (allocated(reason)) call raise(error, file_error, file_name//': cannot resume: '//reason)
  end subroutine read_origin

  subroutine read_fields(file_name, origin, reason)
    character(*), intent(in) :: file_name
    type(origin_t), intent(inout) :: origin
    character(:), allocatable, intent(out) :: reason
    type(refusal_t) :: refusal
    integer(hid_t) :: file
    integer :: status, ignored

    call open_existing(file_name, file, status)
    call get_attribute(file, 'complete', origin%complete, status, refusal)
    call get_attribute(file, 'result_code', origin%result_code, status, refusal)
    call get_attribute(file, 'result_text', origin%result_text, status, refusal)
    call get_attribute(file, 'created', origin%created, status, refusal)
    call get_attribute(file, 'deck_sha256', origin%deck_sha256, status, refusal)
    call get_text(file, 'deck/text', origin%deck_text, status, refusal)
    call get_text(file, 'deck/resolved', origin%deck_resolved, status, refusal)
    if (status < 0) reason = damage_reason(refusal)
    if (file >= 0) call h5fclose_f(file, ignored)
  end subroutine read_fields
end module dst_hdf5_origin
