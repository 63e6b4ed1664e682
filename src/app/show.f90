!> Describes a result file, and how far the shares of its sweep are: what `dynstiction show` prints. Nothing is changed, and
!> processes that write are not disturbed.
module dst_show
  use dst_disk, only: file_exists, path_t
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_origin, only: describe_result
  use dst_kinds, only: wp, int64, pi
  use dst_output_size, only: run_samples
  use dst_plain_numbers, only: number_text
  use dst_scene, only: scene_t
  use dst_share, only: share_t, shares_of
  use dst_sweep_file, only: sweep_head_t, read_head
  use dst_text, only: integer_text, printable, text_builder_t
  implicit none
  private

  public :: show_result, deck_in_brief

  integer, parameter :: longest_list = 80   !! characters

contains

  !> Describes the run of a deck whose scene is complete.
  function deck_in_brief(name, scene) result(text)
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    real(wp), parameter :: turn = 2.0_wp*pi

    call builder%line(printable(name)//': deck of model '//scene%model//', method '//scene%method_name())
    call put('time', number_text(scene%t_end, 4)//' s')
    if (scene%interval > 0.0_wp) call put('samples', integer_text(nint(run_samples(scene), int64))//', every '// &
      number_text(scene%interval, 4)//' s')
    if (size(scene%drive_velocity) == 1) then
      call put('drive', number_text(scene%drive_velocity(1), 4)//' m/s')
    else
      call put('drive', number_text(minval(scene%drive_velocity), 4)//' to '//number_text(maxval(scene%drive_velocity), 4)// &
        ' m/s in '//integer_text(size(scene%drive_velocity))//' corners')
    end if
    call put('misalignment', number_text(scene%misalignment_deg, 4)//' deg')
    call put('stiffness', number_text(scene%stiffness_x, 4)//' N/m, across '//number_text(scene%stiffness_y, 4)//' N/m')
    if (scene%mass > 0.0_wp) then
      call put('mass', number_text(scene%mass, 4)//' kg')
      call put('oscillation', number_text(sqrt(scene%stiffness_x)/sqrt(scene%mass)/turn)//' Hz, across '// &
        number_text(sqrt(scene%stiffness_y)/sqrt(scene%mass)/turn)//' Hz')
    end if
    call put('friction', 'law '//scene%law//', '//number_text(scene%mu_0*scene%normal_load, 4)//' N as slip begins')
    call put('next', 'dynstiction run '//printable(name)//', dynstiction stability '//printable(name))
    text = builder%content()

  contains

    subroutine put(what, value)
      character(*), intent(in) :: what, value
      character(16) :: first

      first = what
      call builder%line('  '//first//value)
    end subroutine put
  end function deck_in_brief

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
