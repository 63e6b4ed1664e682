!> A stretch of a motion under a steady drive, recorded piece by piece, to be read later.
module dst_recording
  use dst_archive, only: archive_t
  use dst_dense_output, only: n_columns
  use dst_interpolation, only: grid_t, max_degree
  use dst_kinds, only: wp
  use dst_piece, only: piece_t, no_event
  use dst_state, only: state_t
  implicit none
  private

  public :: recording_t

  !> A piece without the data that all pieces share.
  type :: kept_piece_t
    type(state_t) :: from, to
    integer :: contact = 0, event = no_event
    integer :: grid = 0                       !! place among the grids
    real(wp) :: step = 0.0_wp
    real(wp) :: nodal(0:max_degree, n_columns) = 0.0_wp
  end type kept_piece_t

  !> Consecutive pieces.
  type :: recording_t
    integer :: count = 0
    type(kept_piece_t), allocatable, private :: kept(:)     !! valid up to `count`
    !> The shared data: drive and system are those of this piece; polynomials are on one of the grids: that of steps, or that of
    !> closed forms.
    type(piece_t), private :: like
    integer, private :: grids = 0
    type(grid_t), private :: grid(2)
  contains
    procedure :: clear
    procedure :: release
    procedure :: append
    procedure :: move_to
    procedure :: get
    procedure :: contact
    procedure :: event
    procedure :: from
    procedure :: to
    procedure :: velocity
    procedure :: place_of
    procedure :: end_of
    procedure :: events
    procedure :: duration
    procedure :: exchanged
    procedure :: serialise
  end type recording_t

contains

  pure subroutine clear(self)
    class(recording_t), intent(inout) :: self

    self%count = 0
  end subroutine clear

  !> Delete the pieces and free their memory.
  pure subroutine release(self)
    class(recording_t), intent(inout) :: self

    self%count = 0
    if (allocated(self%kept)) deallocate (self%kept)
  end subroutine release

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
      self%like%drive = piece%drive
      self%like%drive_coupling = piece%drive_coupling
      self%like%held = piece%held
      self%like%is_polar = piece%is_polar
    end if
    self%count = self%count + 1
    associate (kept => self%kept(self%count))
      kept%from = piece%from
      kept%to = piece%to
      kept%contact = piece%contact
      kept%event = piece%event
      kept%step = piece%path%step
      kept%nodal = piece%path%nodal
      do i = 1, self%grids
        kept%grid = i
        if (same_grid(self%grid(i), piece%path%grid)) return
      end do
      self%grids = min(size(self%grid), self%grids + 1)
      kept%grid = self%grids
      self%grid(kept%grid) = piece%path%grid
    end associate
  end subroutine append

  !> Move the pieces to another recording, and take its memory.
  pure subroutine move_to(self, other)
    class(recording_t), intent(inout) :: self
    type(recording_t), intent(inout) :: other
    type(kept_piece_t), allocatable :: room(:)

    call move_alloc(other%kept, room)
    call move_alloc(self%kept, other%kept)
    call move_alloc(room, self%kept)
    other%count = self%count
    other%like = self%like
    other%grids = self%grids
    other%grid = self%grid
    self%count = 0
  end subroutine move_to

  !> Piece number `place`.
  pure subroutine get(self, place, piece)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place
    type(piece_t), intent(inout) :: piece

    associate (kept => self%kept(place))
      piece%from = kept%from
      piece%to = kept%to
      piece%contact = kept%contact
      piece%event = kept%event
      piece%drive = self%like%drive
      piece%drive_coupling = self%like%drive_coupling
      piece%held = self%like%held
      piece%is_polar = self%like%is_polar
      if (.not. same_grid(piece%path%grid, self%grid(kept%grid))) piece%path%grid = self%grid(kept%grid)
      piece%path%step = kept%step
      piece%path%nodal = kept%nodal
    end associate
  end subroutine get

  pure logical function same_grid(one, other)
    type(grid_t), intent(in) :: one, other

    same_grid = one%degree == other%degree .and. .not. abs(one%node(1) - other%node(1)) > 0.0_wp
  end function same_grid

  !> Whether the object slips or sticks in a piece.
  pure integer function contact(self, place)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place

    contact = self%kept(place)%contact
  end function contact

  !> The event at the end of a piece.
  pure integer function event(self, place)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place

    event = self%kept(place)%event
  end function event

  !> The state at the beginning of a piece.
  pure type(state_t) function from(self, place)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place

    from = self%kept(place)%from
  end function from

  !> The state at the end of a piece.
  pure type(state_t) function to(self, place)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place

    to = self%kept(place)%to
  end function to

  !> V [m/s].
  pure real(wp) function velocity(self)
    class(recording_t), intent(in) :: self

    velocity = self%like%drive%velocity
  end function velocity

  !> Number of the piece that contains the time `elapsed` [s] after the beginning.
  pure integer function place_of(self, elapsed) result(place)
    class(recording_t), intent(in) :: self
    real(wp), intent(in) :: elapsed
    integer :: above, middle

    place = 1
    above = self%count + 1
    do while (above - place > 1)
      middle = (place + above)/2
      if (elapsed_between(self%kept(1)%from, self%kept(middle)%from) <= elapsed) then
        place = middle
      else
        above = middle
      end if
    end do
  end function place_of

  !> The end of a piece, as time [s] after the beginning.
  pure real(wp) function end_of(self, place)
    class(recording_t), intent(in) :: self
    integer, intent(in) :: place

    end_of = elapsed_between(self%kept(1)%from, self%kept(place)%to)
  end function end_of

  !> Times of the events [s] after the beginning, and their kinds.
  pure subroutine events(self, time, kind)
    class(recording_t), intent(in) :: self
    real(wp), allocatable, intent(out) :: time(:)
    integer, allocatable, intent(out) :: kind(:)
    integer :: i, n

    n = count(self%kept(:self%count)%event /= no_event)
    allocate (time(n), kind(n))
    n = 0
    do i = 1, self%count
      if (self%kept(i)%event == no_event) cycle
      n = n + 1
      time(n) = self%end_of(i)
      kind(n) = self%kept(i)%event
    end do
  end subroutine events

  !> Duration [s].
  pure real(wp) function duration(self)
    class(recording_t), intent(in) :: self

    duration = self%end_of(self%count)
  end function duration

  !> Sum of the absolute works of all pieces [J].
  pure real(wp) function exchanged(self)
    class(recording_t), intent(in) :: self
    integer :: i

    exchanged = 0.0_wp
    do i = 1, self%count
      associate (from => self%kept(i)%from, to => self%kept(i)%to)
        exchanged = exchanged + abs(to%drive_work - from%drive_work) + abs(to%friction_work - from%friction_work) &
          + abs(to%damper_work - from%damper_work)
      end associate
    end do
  end function exchanged

  !> Time from one state to a later one [s].
  pure real(wp) function elapsed_between(from, to)
    type(state_t), intent(in) :: from, to

    elapsed_between = from%until(to%time) + to%time_rest
  end function elapsed_between

  !> Save or load.
  subroutine serialise(self, archive)
    class(recording_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer :: i

    call archive%serialise(self%count)
    call archive%serialise(self%grids)
    do i = 1, max(0, min(size(self%grid), self%grids))
      call self%grid(i)%serialise(archive)
    end do
    call archive%serialise(self%like%drive%start)
    call archive%serialise(self%like%drive%end)
    call archive%serialise(self%like%drive%velocity)
    call archive%serialise(self%like%drive_coupling)
    call archive%serialise(self%like%held)
    if (archive%is_loading()) then
      if (allocated(self%kept)) deallocate (self%kept)
      allocate (self%kept(max(32, self%count)))
    end if
    do i = 1, self%count
      associate (kept => self%kept(i))
        call kept%from%serialise(archive)
        call kept%to%serialise(archive)
        call archive%serialise(kept%contact)
        call archive%serialise(kept%event)
        call archive%serialise(kept%grid)
        call archive%serialise(kept%step)
        call archive%serialise(kept%nodal)
      end associate
    end do
  end subroutine serialise
end module dst_recording
