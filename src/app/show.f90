!> Describes a result file, and how far the shares of its sweep are: what `dynstiction show` prints. Nothing is changed, and
!> processes that write are not disturbed.
module dst_show
  use dst_disk, only: file_exists, path_t
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_origin, only: describe_result
  use dst_share, only: share_t, shares_of
  use dst_sweep_file, only: sweep_head_t, read_head
  use dst_text, only: integer_text, printable, text_builder_t
  implicit none
  private

  public :: show_result

  integer, parameter :: longest_list = 80   !! characters

contains

  !> Lines about a result file, and about the shares of its sweep; it need not exist yet.
  subroutine show_result(result_file, text, error)
    character(*), intent(in) :: result_file
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(text_builder_t) :: builder
    type(path_t), allocatable :: files(:)
    type(share_t), allocatable :: shares(:)
    character(:), allocatable :: reason, said

    call shares_of(result_file, shares, files)
    if (file_exists(result_file)) then
      call describe_result(result_file, said, reason)
      if (.not. allocated(reason)) call builder%line(printable(result_file)//': '//said)
    else if (size(files) == 0) then
      reason = 'there is no such file, and no file of a share of a sweep beside it: give the -o of the run'
    end if
    if (allocated(reason)) then
      call raise(error, file_error, result_file//': '//reason)
    else
      call show_shares(shares, files, builder)
      text = builder%content()
    end if
  end subroutine show_result

  !> How far each share is, and which ones have no file.
  subroutine show_shares(shares, files, builder)
    type(share_t), intent(in) :: shares(:)
    type(path_t), intent(in) :: files(:)
    type(text_builder_t), intent(inout) :: builder
    type(sweep_head_t) :: head
    character(:), allocatable :: reason, missing
    integer :: i

    do i = 1, size(files)
      call read_head(files(i)%text, head, reason)
      if (allocated(reason)) then
        reason = 'cannot be read: '//reason
      else if (head%identity == '') then
        reason = 'is no file of a sweep'
      else
        reason = integer_text(head%done)//' of '//integer_text(head%cases)//' cases done, '//integer_text(head%failed)//' failed'
      end if
      call builder%line(printable(files(i)%text)//': '//reason)
    end do
    if (size(files) == 0) return
    missing = ''
    do i = 1, shares(1)%count
      if (any(shares%number == i)) cycle
      if (len(missing) > longest_list) exit
      missing = missing//' '//integer_text(i)
    end do
    if (len(missing) > longest_list) missing = missing//' ...'
    if (missing /= '') call builder%line('no file of a share I/'//integer_text(shares(1)%count)//' with I ='//missing)
  end subroutine show_shares
end module dst_show
