!> What a result file says about the run that wrote it: enough to go on with that run.
module dst_hdf5_origin
  use hdf5, only: hid_t, h5fclose_f, h5f_acc_rdonly_f
  use dst_kinds, only: wp
  use dst_disk, only: file_exists, is_folder, wait_seconds, with_remedy
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_tools, only: start_hdf5, open_file, failure_reason, get_attribute, get_text
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
    else
      call read_fields(file_name, origin, reason)
    end if
    if (allocated(reason)) call raise(error, file_error, file_name//': cannot resume: '//reason)
  end subroutine read_origin

  !> A run that was just killed may still be finishing a flush, and lock the file for that moment.
  subroutine read_fields(file_name, origin, reason)
    character(*), intent(in) :: file_name
    type(origin_t), intent(inout) :: origin
    character(:), allocatable, intent(out) :: reason
    integer, parameter :: most_tries = 10
    integer(hid_t) :: file
    integer :: status, ignored, i

    do i = 1, most_tries
      call start_hdf5(status)
      call open_file(file_name, h5f_acc_rdonly_f, file, status)
      if (status >= 0) exit
      reason = failure_reason()
      if (index(reason, 'temporarily unavailable') == 0) exit
      call wait_seconds(0.05_wp)
    end do
    if (status >= 0) then
      if (allocated(reason)) deallocate (reason)
      call get_attribute(file, 'complete', origin%complete, status)
      call get_attribute(file, 'result_code', origin%result_code, status)
      call get_attribute(file, 'result_text', origin%result_text, status)
      call get_attribute(file, 'created', origin%created, status)
      call get_attribute(file, 'deck_sha256', origin%deck_sha256, status)
      call get_text(file, 'deck/text', origin%deck_text, status)
      call get_text(file, 'deck/resolved', origin%deck_resolved, status)
      if (status < 0) reason = failure_reason()
      call h5fclose_f(file, ignored)
    end if
    if (allocated(reason)) reason = with_remedy(reason)
  end subroutine read_fields
end module dst_hdf5_origin
