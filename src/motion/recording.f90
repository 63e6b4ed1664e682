!> Pieces of a motion under a steady drive that are kept, to be read later and elsewhere: a passage from one release to the next.
!> Times and positions count from its beginning.
module dst_recording
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_dense_output, only: n_columns, column_position
  use dst_drive, only: drive_segment_t
  use dst_interpolation, only: grid_t, max_degree, last_begun
  use dst_kinds, only: wp, int64
  use dst_piece, only: piece_t, no_event
  use dst_slip_system, only: max_components
  use dst_state, only: state_t
  implicit none
  private

  public :: recording_t, most_pieces

  !> Largest number of pieces: some 40 MB. Convention: a passage with more is not kept.
  integer(int64), parameter :: most_pieces = 50000

  !> A piece without the data that all pieces share.
  type :: kept_piece_t
    type(state_t) :: from, to
    integer :: contact = 0, event = no_event
    integer :: grid = 0                       !! place among the grids
    real(wp) :: step = 0.0_wp
    real(wp) :: nodal(0:max_degree, n_columns) = 0.0_wp
  end type kept_piece_t

  !> What all pieces have of drive and system, and the grids of polynomials: that of steps, that of steps near rest, and that of
  !> closed forms.
  type :: shared_t
    type(drive_segment_t) :: drive
    real(wp) :: drive_coupling(max_components) = 0.0_wp
    integer :: held = 0, grids = 0
    logical :: is_polar = .false.
    type(grid_t) :: grid(3)
  end type shared_t

  !> Consecutive pieces.
  type :: recording_t
    integer :: count = 0
    type(shared_t), private :: shared
    type(kept_piece_t), allocatable :: kept(:)     !! valid up to `count`
  contains
    procedure :: clear
    procedure :: append
    procedure :: copy
    procedure :: get
    procedure :: place_of
    procedure :: duration
    procedure :: exchanged
    procedure :: serialise
  end type recording_t

contains

  pure subroutine clear(self)
    class(recording_t), intent(inout) :: self

    self%count = 0
  end subroutine clear

  pure subroutine append(self, piece)
    class(recording_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    type(kept_piece_t), allocatable :: larger(:)
    integer :: i

    if (.not. allocated(self%kept)) allocate (self%kept(32))
    if (self%count == size(self%kept)) then
      allocate (larger(2*self%count))
      larger(:self%count) = self%kept
      call move_alloc(larger, self%kept)
    end if
    if (self%count == 0) then
      self%shared%drive = piece%drive
      self%shared%drive_coupling = piece%drive_coupling
      self%shared%held = piece%held
      self%shared%is_polar = piece%is_polar
    end if
    self%count = self%count + 1
    associate (kept => self%kept(self%count))
      kept%from = piece%from
      kept%to = piece%to
      kept%contact = piece%contact
      kept%event = piece%event
      kept%step = piece%path%step
      kept%nodal = piece%path%nodal
      kept%grid = 0
      do i = 1, self%shared%grids
        if (same_grid(self%shared%grid(i), piece%path%grid)) kept%grid = i
      end do
      if (kept%grid == 0) then
        self%shared%grids = min(size(self%shared%grid), self%shared%grids + 1)
        kept%grid = self%shared%grids
        self%shared%grid(kept%grid) = piece%path%grid
      end if
      ! From its beginning on.
      if (self%count == 1) then
        kept%from%time = 0.0_wp
        kept%from%time_rest = 0.0_wp
        kept%from%position = 0.0_wp
      else
        kept%from%time = self%kept(self%count - 1)%to%time
        kept%from%time_rest = self%kept(self%count - 1)%to%time_rest
        kept%from%position = self%kept(self%count - 1)%to%position
      end if
      call kept%to%later(kept%from, piece%from%until(piece%to%time) + piece%to%time_rest)
      kept%to%position = kept%from%position + (piece%to%position - piece%from%position)
      kept%nodal(:, column_position) = kept%nodal(:, column_position) + (kept%from%position - piece%from%position)
    end associate
  end subroutine append

  !> Piece number `place` of the passage that begins with the state `begin`.
  pure subroutine get(self, place, begin, piece)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place
    type(state_t), intent(in) :: begin
    type(piece_t), intent(inout) :: piece

    associate (kept => self%kept(place))
      piece%from = kept%from
      piece%to = kept%to
      call piece%from%later(begin, kept%from%time + kept%from%time_rest)
      call piece%to%later(begin, kept%to%time + kept%to%time_rest)
      piece%from%position = begin%position + kept%from%position
      piece%to%position = begin%position + kept%to%position
      piece%contact = kept%contact
      piece%event = kept%event
      piece%drive = self%shared%drive
      piece%drive_coupling = self%shared%drive_coupling
      piece%held = self%shared%held
      piece%is_polar = self%shared%is_polar
      if (.not. same_grid(piece%path%grid, self%shared%grid(kept%grid))) piece%path%grid = self%shared%grid(kept%grid)
      piece%path%step = kept%step
      piece%path%nodal = kept%nodal
      piece%path%nodal(:, column_position) = kept%nodal(:, column_position) + begin%position
    end associate
  end subroutine get

  !> Become a copy of another recording, without its spare room.
  pure subroutine copy(self, other)
    class(recording_t), intent(inout) :: self
    type(recording_t), intent(in) :: other

    self%count = other%count
    self%shared = other%shared
    self%kept = other%kept(:other%count)
  end subroutine copy

  pure logical function same_grid(one, other)
    type(grid_t), intent(in) :: one, other

    same_grid = one%degree == other%degree .and. .not. abs(one%node(1) - other%node(1)) > 0.0_wp
  end function same_grid

  !> Number of the piece that contains the time `elapsed` [s].
  pure integer function place_of(self, elapsed) result(place)
    class(recording_t), intent(in) :: self
    real(wp), intent(in) :: elapsed

    place = last_begun(self%kept(:self%count)%from%time, elapsed)
  end function place_of

  !> Duration [s].
  pure real(wp) function duration(self)
    class(recording_t), intent(in) :: self

    associate (last => self%kept(self%count)%to)
      duration = last%time + last%time_rest
    end associate
  end function duration

  !> Sum of the absolute works of all pieces [J].
  pure real(wp) function exchanged(self)
    class(recording_t), intent(in) :: self

    associate (from => self%kept(:self%count)%from, to => self%kept(:self%count)%to)
      exchanged = sum(abs(to%drive_work - from%drive_work)) + sum(abs(to%friction_work - from%friction_work)) &
        + sum(abs(to%damper_work - from%damper_work))
    end associate
  end function exchanged

  !> Save or load.
  subroutine serialise(self, archive)
    class(recording_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(c_loc(self%count), storage_size(self%count))
    call archive%serialise(c_loc(self%shared), storage_size(self%shared))
    if (self%count == 0) return
    if (archive%is_loading()) allocate (self%kept(self%count))
    call archive%serialise(c_loc(self%kept(1)), storage_size(self%kept), self%count)
  end subroutine serialise
end module dst_recording
