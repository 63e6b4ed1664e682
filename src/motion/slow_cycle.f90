!> A slow cycle: the passages from one release that follows a turn back of the force to the next one, with the motion inside those
!> that no table describes.
module dst_slow_cycle
  use dst_archive, only: archive_t
  use dst_interpolation, only: last_begun
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, duration
  use dst_recording, only: recording_t
  use dst_release_map, only: release_map_t
  implicit none
  private

  public :: slow_cycle_t

  !> Largest numbers of passages, and of pieces of those that were recorded. Conventions: a longer slow cycle is not reused.
  integer, parameter :: most_passages = 100000, most_pieces = 16000

  !> Consecutive passages.
  type :: slow_cycle_t
    integer :: count = 0
    type(passage_t), allocatable :: passage(:)     !! valid up to `count`
    !> When each begins [s], and the number of its recording, 0 if it has none.
    real(wp), allocatable :: begin(:)
    integer, allocatable :: recorded(:)
    integer :: recordings = 0, pieces = 0
    type(recording_t), allocatable :: recording(:) !! valid up to `recordings`
    !> The sum of all.
    type(passage_t) :: whole
    logical :: is_complete = .false.
  contains
    procedure :: clear
    procedure :: append
    procedure :: place_of
    procedure :: serialise
  end type slow_cycle_t

contains

  !> A slow cycle begins.
  pure subroutine clear(self)
    class(slow_cycle_t), intent(inout) :: self

    self%count = 0
    self%recordings = 0
    self%pieces = 0
    self%is_complete = .true.
    self%whole = passage_t()
  end subroutine clear

  !> Append a passage; the motion inside one that no table has is copied.
  pure subroutine append(self, passage, recording)
    class(slow_cycle_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    type(recording_t), intent(in) :: recording

    if (.not. self%is_complete) return
    if (self%count == most_passages .or. self%pieces > most_pieces) then
      self%is_complete = .false.
      return
    end if
    call make_room(self)
    self%count = self%count + 1
    self%passage(self%count) = passage
    self%begin(self%count) = self%whole%measure(duration)
    self%recorded(self%count) = 0
    if (self%count == 1) self%whole = passage_t(from=passage%from, slope=1.0_wp, has_slope=.true.)
    call self%whole%go_on(passage)
    if (passage%table(1) > 0) return
    self%recordings = self%recordings + 1
    self%recorded(self%count) = self%recordings
    call self%recording(self%recordings)%copy(recording)
    self%pieces = self%pieces + recording%count
  end subroutine append

  pure subroutine make_room(self)
    class(slow_cycle_t), intent(inout) :: self
    type(passage_t), allocatable :: passage(:)
    type(recording_t), allocatable :: recording(:)
    real(wp), allocatable :: begin(:)
    integer, allocatable :: recorded(:)
    integer :: n

    if (.not. allocated(self%passage)) allocate (self%passage(16), self%begin(16), self%recorded(16), self%recording(2))
    if (self%count == size(self%passage)) then
      n = self%count
      allocate (passage(2*n), begin(2*n), recorded(2*n))
      passage(:n) = self%passage
      begin(:n) = self%begin
      recorded(:n) = self%recorded
      call move_alloc(passage, self%passage)
      call move_alloc(begin, self%begin)
      call move_alloc(recorded, self%recorded)
    end if
    if (self%recordings == size(self%recording)) then
      allocate (recording(2*self%recordings))
      recording(:self%recordings) = self%recording
      call move_alloc(recording, self%recording)
    end if
  end subroutine make_room

  !> Number of the passage that contains the time `elapsed` [s].
  pure integer function place_of(self, elapsed) result(place)
    class(slow_cycle_t), intent(in) :: self
    real(wp), intent(in) :: elapsed

    place = last_begun(self%begin(:self%count), elapsed)
  end function place_of

  !> Save or load; passages of tables are taken from the map again.
  subroutine serialise(self, archive, map)
    class(slow_cycle_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    class(release_map_t), intent(in) :: map
    type(recording_t) :: recording
    type(passage_t) :: passage
    integer :: i, n
    logical :: is_recorded, found

    n = self%count
    call archive%serialise(n)
    found = self%is_complete
    call archive%serialise(found)
    if (archive%is_loading()) call self%clear()
    do i = 1, n
      is_recorded = .false.
      if (.not. archive%is_loading()) then
        passage = self%passage(i)
        is_recorded = self%recorded(i) > 0
        if (is_recorded) recording = self%recording(self%recorded(i))
      end if
      call archive%serialise(passage%from)
      call archive%serialise(is_recorded)
      if (is_recorded) then
        passage%table = 0
        call archive%serialise(passage%to)
        call archive%serialise(passage%measure)
        call archive%serialise(passage%is_plain)
        call recording%serialise(archive)
      end if
      if (.not. archive%is_loading()) cycle
      if (.not. is_recorded) call map%look_up((passage%from), passage, found)
      if (is_recorded) passage%has_slope = .false.
      call self%append(passage, recording)
    end do
    if (archive%is_loading()) self%is_complete = self%is_complete .and. found
  end subroutine serialise
end module dst_slow_cycle
