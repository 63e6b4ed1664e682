!> A leap: many cycles at once, from release to release: those of a table, or an excursion that is reused.
module dst_leap
  use dst_archive, only: archive_t
  use dst_fast_cycle, only: release_angle_t, fast_cycle_t
  use dst_cycle_table, only: cycle_table_t, drive_work, friction_work, damper_work, exchanged, measures
  use dst_kinds, only: wp, int64
  use dst_piece, only: stick_begins, slip_begins
  use dst_recording, only: recording_t
  use dst_state, only: state_t
  implicit none
  private

  public :: leap_t

  !> Largest number of cycles of a leap. Convention: it limits the time between two readings of the clock.
  integer, parameter :: max_cycles = 4096

  !> A leap that is kept.
  type :: leap_t
    integer(int64) :: number = 0               !! 0: there is none
    real(wp) :: velocity = 0.0_wp              !! V, m/s
    type(release_angle_t) :: from, to
    real(wp) :: duration = 0.0_wp              !! s
    real(wp) :: drive_work = 0.0_wp, friction_work = 0.0_wp, damper_work = 0.0_wp, exchanged = 0.0_wp   !! J
    !> Logarithm of the factor by which a small difference of the angle grows, if it is known, and whether that was tried.
    logical :: stretch_known = .false., is_measured = .false.
    real(wp) :: log_stretch = 0.0_wp
    !> For an excursion: its releases, whether it is a whole slow cycle, and when the soft spring is longest [s].
    integer :: releases = 0
    logical :: is_whole = .false.
    !> Number of times it has been reused.
    integer :: uses = 0
    real(wp) :: slip_begins = 0.0_wp
    !> Cycles of a table, with angles and times [s] at their ends and the lengths of their slips [s].
    integer :: table = 0, cycles = 0
    !> Whether it can be reused: the first excursion is only kept to find out what the later ones forget.
    logical :: is_kept = .false.
    real(wp), allocatable :: angle(:), start(:), slip(:)
    !> Sum of the table's polynomials at all cycles.
    real(wp), allocatable :: total(:)
    !> Or an excursion.
    type(recording_t) :: recording
  contains
    procedure :: follow
    procedure :: keep
    procedure :: drop
    procedure :: cycle_of
    procedure :: cycle_at
    procedure :: events
    procedure :: serialise
  end type leap_t

contains

  !> Follow the cycles of a table from the release on, for `longest` [s] at most; there may be none.
  subroutine follow(self, number, table, longest)
    class(leap_t), intent(inout) :: self
    integer, intent(in) :: number            !! of the table
    type(cycle_table_t), intent(in) :: table
    real(wp), intent(in) :: longest
    real(wp) :: angle(0:max_cycles), start(0:max_cycles), slip(max_cycles), total(table%points), sums(measures)
    integer :: n

    angle(0) = self%from%angle
    call table%follow(longest, angle, start, slip, n, total)
    sums = matmul(total, table%coefficient)
    self%table = number
    self%cycles = n
    self%is_kept = n > 0
    if (allocated(self%angle)) deallocate (self%angle, self%start, self%slip, self%total)
    allocate (self%angle(n + 1), source=angle(:n))
    allocate (self%start(n + 1), source=start(:n))
    allocate (self%slip(n), source=slip(:n))
    allocate (self%total(table%points), source=total)
    self%to = release_angle_t(angle(n), self%from%side)
    self%duration = start(n)
    self%drive_work = sums(drive_work)
    self%friction_work = sums(friction_work)
    self%damper_work = sums(damper_work)
    self%exchanged = sums(exchanged)
    self%stretch_known = .true.
    self%is_measured = .true.
    self%log_stretch = table%log_stretch(angle(0:n - 1))
  end subroutine follow

  !> Keep the recording of an excursion, which is moved here.
  subroutine keep(self, excursion)
    class(leap_t), intent(inout) :: self
    type(recording_t), intent(inout) :: excursion
    type(state_t) :: first, now
    real(wp) :: longest
    integer :: i

    call excursion%move_to(self%recording)
    self%table = 0
    self%is_kept = .true.
    self%cycles = 0
    longest = 0.0_wp
    first = self%recording%from(1)
    now = first
    do i = 1, self%recording%count
      now = self%recording%to(i)
      if (self%recording%event(i) == stick_begins) self%cycles = self%cycles + 1
      if (abs(now%u(1)) > longest) self%slip_begins = self%recording%end_of(i)
      longest = max(longest, abs(now%u(1)))
    end do
    self%duration = self%recording%duration()
    self%exchanged = self%recording%exchanged()
    self%drive_work = now%drive_work - first%drive_work
    self%friction_work = now%friction_work - first%friction_work
    self%damper_work = now%damper_work - first%damper_work
  end subroutine keep

  !> Keep only where the excursion began and ended.
  pure subroutine drop(self)
    class(leap_t), intent(inout) :: self

    self%is_kept = .false.
    call self%recording%release()
  end subroutine drop

  !> Cycle number `i` of those in a table.
  pure type(fast_cycle_t) function cycle_of(self, i) result(cycle)
    class(leap_t), intent(in) :: self
    integer, intent(in) :: i

    cycle%known = .true.
    cycle%from = release_angle_t(self%angle(i), self%from%side)
    cycle%duration = self%start(i + 1) - self%start(i)
    cycle%turn = self%angle(i + 1) - self%angle(i)
    cycle%stick_share = 1.0_wp - self%slip(i)/cycle%duration
  end function cycle_of

  !> Number of the cycle that contains the time `elapsed` [s].
  pure integer function cycle_at(self, elapsed) result(place)
    class(leap_t), intent(in) :: self
    real(wp), intent(in) :: elapsed
    integer :: above, middle

    place = 1
    above = self%cycles + 1
    do while (above - place > 1)
      middle = (place + above)/2
      if (self%start(middle) <= elapsed) then
        place = middle
      else
        above = middle
      end if
    end do
  end function cycle_at

  !> Times of the events [s] after the beginning, and their kinds.
  pure subroutine events(self, time, kind)
    class(leap_t), intent(in) :: self
    real(wp), allocatable, intent(out) :: time(:)
    integer, allocatable, intent(out) :: kind(:)
    integer :: i

    if (self%table == 0) then
      call self%recording%events(time, kind)
      return
    end if
    allocate (time(2*self%cycles), kind(2*self%cycles))
    do i = 1, self%cycles
      time(2*i - 1) = self%start(i) + self%slip(i)
      time(2*i) = self%start(i + 1)
      kind(2*i - 1) = stick_begins
      kind(2*i) = slip_begins
    end do
  end subroutine events

  !> Save or load.
  subroutine serialise(self, archive)
    class(leap_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer :: points

    call archive%serialise(self%number)
    call archive%serialise(self%velocity)
    call self%from%serialise(archive)
    call self%to%serialise(archive)
    call archive%serialise(self%duration)
    call archive%serialise(self%drive_work)
    call archive%serialise(self%friction_work)
    call archive%serialise(self%damper_work)
    call archive%serialise(self%exchanged)
    call archive%serialise(self%slip_begins)
    call archive%serialise(self%releases)
    call archive%serialise(self%is_whole)
    call archive%serialise(self%uses)
    call archive%serialise(self%stretch_known)
    call archive%serialise(self%is_measured)
    call archive%serialise(self%log_stretch)
    call archive%serialise(self%table)
    call archive%serialise(self%cycles)
    call archive%serialise(self%is_kept)
    if (self%table == 0) then
      if (self%is_kept) call self%recording%serialise(archive)
      return
    end if
    points = 0
    if (.not. archive%is_loading()) points = size(self%total)
    call archive%serialise(points)
    if (archive%is_loading()) then
      if (allocated(self%angle)) deallocate (self%angle, self%start, self%slip, self%total)
      allocate (self%angle(self%cycles + 1), self%start(self%cycles + 1), self%slip(self%cycles), self%total(points))
    end if
    call archive%serialise(self%angle)
    call archive%serialise(self%start)
    call archive%serialise(self%slip)
    call archive%serialise(self%total)
  end subroutine serialise
end module dst_leap
