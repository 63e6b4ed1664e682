!> Describes a result file, and the progress of its sweep from the shards next to it: what `dynstiction show` prints. Nothing is
!> changed, and processes that write are not disturbed.
module dst_show
  use dst_disk, only: identity_of, identity_t, file_exists, path_t, process_with_lock, utc_at
  use dst_division, only: division_t
  use dst_errors, only: error_t, raise, file_error, out_of_memory
  use dst_hdf5_origin, only: describe_result
  use dst_kinds, only: wp, int64, pi
  use dst_output_size, only: run_samples
  use dst_plain_numbers, only: number_text
  use dst_scene, only: scene_t
  use dst_sweep_shard, only: head_t, index_t, layout_t, shards_of, inspect_shard, divisions_of, scan_shard, is_done, &
    is_being_written
  use dst_text, only: integer_text, printable, text_builder_t
  implicit none
  private

  public :: show_result, deck_in_brief

  !> Widths of the columns of the table.
  integer, parameter :: name_width = 16, done_width = 24, time_width = 22
  integer, parameter :: shown = 12   !! characters of an identity

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

  !> Lines about a result file, which need not exist yet.
  subroutine show_result(result_file, text, error)
    character(*), intent(in) :: result_file
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(text_builder_t) :: builder
    type(path_t), allocatable :: files(:)
    type(head_t), allocatable :: heads(:)
    logical, allocatable :: is_left(:), is_of_group(:)
    character(:), allocatable :: reason, said
    integer :: i

    call shards_of(result_file, files)
    if (file_exists(result_file)) then
      call describe_result(result_file, said, reason)
      if (.not. allocated(reason)) call builder%line(printable(result_file)//': '//said)
    else if (size(files) == 0) then
      reason = 'there is no such file, and no shard of a sweep beside it: give the -o of the run'
    end if
    if (allocated(reason)) then
      call raise(error, file_error, result_file//': '//reason)
      return
    end if
    allocate (heads(size(files)))
    do i = 1, size(files)
      call inspect_shard(files(i)%text, heads(i), error)
      if (allocated(error)) return
    end do
    ! An incomplete head belongs to a process that has only just begun, or was killed before.
    is_left = heads%is_whole
    if (size(files) > 0 .and. .not. any(is_left)) &
      call builder%line(printable(result_file)//': shards of a sweep, 0 cases done')
    do while (any(is_left))
      associate (first => heads(findloc(is_left, .true., dim=1)))
        is_of_group = is_left .and. heads%identity == first%identity .and. heads%build == first%build .and. &
          heads%cases == first%cases .and. heads%columns == first%columns
      end associate
      call show_sweep(result_file, pack(files, is_of_group), pack(heads, is_of_group), builder, error)
      if (allocated(error)) return
      is_left = is_left .and. .not. is_of_group
    end do
    text = builder%content()
  end subroutine show_result

  !> The shards of one sweep and one build.
  subroutine show_sweep(result_file, files, heads, builder, error)
    character(*), intent(in) :: result_file
    type(path_t), intent(in) :: files(:)
    type(head_t), intent(in) :: heads(:)
    type(text_builder_t), intent(inout) :: builder
    type(error_t), allocatable, intent(out) :: error
    type(index_t) :: index
    type(division_t), allocatable :: divisions(:)
    type(division_t) :: newest
    integer, allocatable :: done(:)
    integer :: records(size(files)), i, no_memory

    call index%allocate(heads(1)%cases, 0, no_memory)
    if (no_memory /= 0) then
      call raise(error, out_of_memory, result_file//': no memory for the list of '//integer_text(heads(1)%cases)//' cases')
      return
    end if
    do i = 1, size(files)
      call scan_shard(files(i)%text, layout_t(heads(i)%columns, huge(1)), i, index, records(i), error)
      if (allocated(error)) return
    end do
    divisions = divisions_of(heads, files)
    if (size(divisions) > 0) newest = divisions(size(divisions))
    call count_shares(newest, index, done)
    call builder%line(printable(result_file)//': shards of a sweep, '//integer_text(index%done)//' of '// &
      integer_text(heads(1)%cases)//' cases done, '//integer_text(index%failed)//' failed (sweep '// &
      printable(heads(1)%identity(:shown))//', build '//printable(heads(1)%build(:shown))//')')
    call builder%line(row('shard', 'cases done', 'begun', 'last change', ''))
    do i = 1, size(files)
      call builder%line(row_of(files(i)%text, heads(i), records(i), newest, done))
    end do
    if (newest%shares > 0) call show_missing(newest, heads, done, builder)
  end subroutine show_sweep

  !> For each share, the number of finished cases, whichever process computed them.
  subroutine count_shares(division, index, done)
    type(division_t), intent(in) :: division
    type(index_t), intent(in) :: index
    integer, allocatable, intent(out) :: done(:)
    integer :: i, share

    allocate (done(division%shares))
    done = 0
    if (division%shares == 0) return
    do i = 1, size(index%state)
      if (index%state(i) /= is_done) cycle
      share = division%share_of(i)
      done(share) = done(share) + 1
    end do
  end subroutine count_shares

  !> A shard: its part, its finished cases, its times, and the process that writes it.
  function row_of(file_name, head, records, newest, done) result(line)
    character(*), intent(in) :: file_name
    type(head_t), intent(in) :: head
    integer, intent(in) :: records
    type(division_t), intent(in) :: newest
    integer, intent(in) :: done(:)
    character(:), allocatable :: line, name, count, state
    type(identity_t) :: file
    integer :: process

    name = 'dealt out'
    count = integer_text(records)
    if (head%division%shares > 0) then
      name = head%division%text()
      ! In the current division, cases that other processes have finished count, too.
      if (head%division%shares == newest%shares) count = integer_text(done(head%division%share))
      count = count//' of '//integer_text(head%division%size(head%cases))
    end if
    state = ''
    if (is_being_written(file_name)) then
      state = 'being written'
      process = process_with_lock(file_name)
      if (process > 0) state = state//' by process '//integer_text(process)
    end if
    file = identity_of(file_name)
    line = row(name, count, utc_at(head%begun), utc_at(file%changed), state)
  end function row_of

  function row(name, done, begun, changed, state) result(line)
    character(*), intent(in) :: name, done, begun, changed, state
    character(:), allocatable :: line

    line = '  '//padded(name, name_width)//padded(done, done_width)//padded(begun, time_width)//padded(changed, time_width)//state
  end function row

  function padded(text, width) result(field)
    character(*), intent(in) :: text
    integer, intent(in) :: width
    character(:), allocatable :: field

    field = text//repeat(' ', max(1, width - len(text)))
  end function padded

  !> The shares of the newest division that have cases left and no shard, as ranges.
  subroutine show_missing(newest, heads, done, builder)
    type(division_t), intent(in) :: newest
    type(head_t), intent(in) :: heads(:)
    integer, intent(in) :: done(:)
    type(text_builder_t), intent(inout) :: builder
    logical, allocatable :: is_missing(:)
    type(division_t) :: division
    character(:), allocatable :: list
    integer :: i

    allocate (is_missing(0:size(done) + 1))
    is_missing = .false.
    division = newest
    do i = 1, size(done)
      division%share = i
      is_missing(i) = done(i) < division%size(heads(1)%cases)
    end do
    do i = 1, size(heads)
      if (heads(i)%division%shares == newest%shares) is_missing(heads(i)%division%share) = .false.
    end do
    list = ''
    do i = 1, size(done)
      if (.not. is_missing(i) .or. (is_missing(i - 1) .and. is_missing(i + 1))) cycle
      if (is_missing(i - 1)) then
        list = list//'-'//integer_text(i)
      else
        list = list//', '//integer_text(i)
      end if
    end do
    if (list /= '') call builder%line('  not begun: '//list(3:)//' of '//integer_text(newest%shares)// &
      ', each with --shard I/'//integer_text(newest%shares))
  end subroutine show_missing
end module dst_show
