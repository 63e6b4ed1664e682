!> A slow cycle: the passages from one release that follows a turn back of the force to the next one, with the motion inside those
!> that no table describes. One without a rest is one of them.
module dst_slow_cycle
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_interpolation, only: last_begun
  use dst_kinds, only: wp
  use dst_passage, only: passage_t, duration
  use dst_recording, only: recording_t
  use dst_state, only: state_t
  implicit none
  private

  public :: slow_cycle_t, most_repeats

  !> A motion repeats after so many slow cycles at most. Convention.
  integer, parameter :: most_repeats = 8

  !> Largest numbers of passages, and of pieces of those that were recorded. Conventions, twice each: no change; a longer slow cycle
  !> is not reused.
  integer, parameter :: most_passages = 100000, most_pieces = 16000

  !> The number of passages, of recordings and of pieces in them, and the sum of all.
  type :: totals_t
    integer :: count = 0, recordings = 0, pieces = 0
    logical :: is_complete = .false.
    type(passage_t) :: whole
  end type totals_t

  !> A passage, when it begins [s], and the number of its recording, 0 if it has none.
  type :: part_t
    type(passage_t) :: passage
    real(wp) :: begin = 0.0_wp
    integer :: recorded = 0
  end type part_t

  !> Consecutive passages.
  type :: slow_cycle_t
    type(totals_t) :: sum
    type(part_t), allocatable :: part(:)           !! valid up to `count`
    type(recording_t), allocatable :: recording(:) !! valid up to `recordings`
  contains
    procedure :: clear
    procedure :: append
    procedure :: join
    procedure :: lengthen
    procedure :: place_of
    procedure :: serialise
  end type slow_cycle_t

contains

  !> A slow cycle begins; its passages may have to be kept.
  pure subroutine clear(self, is_kept)
    class(slow_cycle_t), intent(inout) :: self
    logical, intent(in) :: is_kept

    self%sum = totals_t(whole=passage_t(slope=1.0_wp, has_slope=.true.), is_complete=is_kept)
  end subroutine clear

  !> Append a passage; the motion inside one that no table has is copied.
  pure subroutine append(self, passage, recording)
    class(slow_cycle_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    type(recording_t), intent(in) :: recording
    real(wp) :: begin

    begin = self%sum%whole%measure(duration)
    call self%sum%whole%go_on(passage)
    if (self%sum%count == most_passages .or. self%sum%pieces > most_pieces) self%sum%is_complete = .false.
    if (.not. self%sum%is_complete) return
    call make_room(self)
    self%sum%count = self%sum%count + 1
    self%part(self%sum%count) = part_t(passage, begin)
    if (passage%table(1) > 0) return
    self%sum%recordings = self%sum%recordings + 1
    self%part(self%sum%count)%recorded = self%sum%recordings
    call self%recording(self%sum%recordings)%copy(recording)
    self%sum%pieces = self%sum%pieces + recording%count
  end subroutine append

  !> Append the passages of another one.
  pure subroutine join(self, other)
    class(slow_cycle_t), intent(inout) :: self
    type(slow_cycle_t), intent(in) :: other
    type(passage_t) :: whole
    integer :: i

    ! Slow cycles like one before know their slope only as a whole.
    whole = self%sum%whole
    call whole%go_on(other%sum%whole)
    self%sum%is_complete = self%sum%is_complete .and. other%sum%is_complete
    do i = 1, other%sum%count
      call self%append(other%part(i)%passage, other%recording(max(1, other%part(i)%recorded)))
    end do
    self%sum%whole = whole
  end subroutine join

  !> Its last rest takes longer by this [s]; of one without a rest, its last piece.
  pure subroutine lengthen(self, by)
    class(slow_cycle_t), intent(inout) :: self
    real(wp), intent(in) :: by
    type(state_t) :: end

    self%sum%whole%measure(duration) = self%sum%whole%measure(duration) + by
    associate (last => self%part(self%sum%count))
      last%passage%measure(duration) = last%passage%measure(duration) + by
      if (last%recorded == 0) return
      associate (inside => self%recording(last%recorded))
        end = inside%kept(inside%count)%to
        call inside%kept(inside%count)%to%later(end, by)
      end associate
    end associate
  end subroutine lengthen

  pure subroutine make_room(self)
    class(slow_cycle_t), intent(inout) :: self
    type(part_t), allocatable :: part(:)
    type(recording_t), allocatable :: recording(:)

    if (.not. allocated(self%part)) allocate (self%part(16), self%recording(2))
    if (self%sum%count == size(self%part)) then
      allocate (part(2*self%sum%count))
      part(:self%sum%count) = self%part
      call move_alloc(part, self%part)
    end if
    if (self%sum%recordings == size(self%recording)) then
      allocate (recording(2*self%sum%recordings))
      recording(:self%sum%recordings) = self%recording
      call move_alloc(recording, self%recording)
    end if
  end subroutine make_room

  !> Number of the passage that contains the time `elapsed` [s].
  pure integer function place_of(self, elapsed) result(place)
    class(slow_cycle_t), intent(in) :: self
    real(wp), intent(in) :: elapsed

    place = last_begun(self%part(:self%sum%count)%begin, elapsed)
  end function place_of

  !> Save or load.
  subroutine serialise(self, archive)
    class(slow_cycle_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive
    integer :: i

    call archive%serialise(c_loc(self%sum), storage_size(self%sum))
    if (self%sum%count == 0) return
    if (archive%is_loading()) allocate (self%part(self%sum%count), self%recording(max(1, self%sum%recordings)))
    call archive%serialise(c_loc(self%part(1)), storage_size(self%part), self%sum%count)
    do i = 1, self%sum%recordings
      call self%recording(i)%serialise(archive)
    end do
  end subroutine serialise
end module dst_slow_cycle
