!> What a run tells: samples, events, and how it ended.
!>
!> A run writes samples and events into memory. Python reads them there, dst_hdf5_writer takes them into a file.
module dst_writer
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, out_of_memory
  use dst_text, only: integer_text, name_width, unit_width, meaning_width
  implicit none
  private

  public :: writer_t, quantity_t, event_t, outcome_t, find_quantity, absent

  !> Description of a column of the time series, of a summary value or of a counter.
  type :: quantity_t
    character(name_width) :: name = ''
    character(unit_width) :: units = ''   !! 'm', 'N', 's', 'm/s', 'rad', '1'
    character(meaning_width) :: long_name = ''
    !> Whether the quantity is a count, and is stored as an integer.
    logical :: counts = .false.
  end type quantity_t

  !> An event that occurs once, or again and again after a period.
  type :: event_t
    real(wp) :: time = 0.0_wp             !! for the first time, s
    integer :: kind = 0                   !! 1 = stick begins, 2 = slip begins
    integer(int64) :: occurs = 1          !! so many times
    real(wp) :: period = 0.0_wp           !! s
  end type event_t

  !> How a run ended.
  type :: outcome_t
    integer :: result_code = 0
    character(:), allocatable :: result_text
    type(quantity_t), allocatable :: summary(:)
    real(wp), allocatable :: summary_value(:)
    type(quantity_t), allocatable :: statistics(:)
    real(wp), allocatable :: statistics_value(:)
  contains
    procedure :: summary_of
  end type outcome_t

  !> The samples and events of a run that nobody has taken yet.
  type :: writer_t
    real(wp), allocatable :: samples(:, :)      !! (column, row), valid up to rows; the rows are in order of time
    type(event_t), allocatable :: log(:)        !! valid up to events, in order of time
    integer :: rows = 0
    integer :: events = 0
    integer :: most_rows = huge(1)              !! a run that has written so many pauses
  contains
    procedure :: add_sample
    !> Several events that occur again and again are a block: all of them occur, then all of them again a period later.
    procedure :: add_events
  end type writer_t

contains

  subroutine add_sample(self, sample, error)
    class(writer_t), intent(inout) :: self
    real(wp), intent(in) :: sample(:)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: larger(:, :)
    integer :: room, status

    if (.not. allocated(self%samples)) allocate (self%samples(size(sample), 0))
    if (self%rows == size(self%samples, 2)) then
      room = room_for(self%rows + 1_int64)
      allocate (larger(size(sample), room), stat=status)
      if (status /= 0 .or. room == self%rows) then
        call raise_no_memory(self%rows, 'samples', error)
        return
      end if
      larger(:, :self%rows) = self%samples
      call move_alloc(larger, self%samples)
    end if
    self%rows = self%rows + 1
    self%samples(:, self%rows) = sample
  end subroutine add_sample

  subroutine add_events(self, events, error)
    class(writer_t), intent(inout) :: self
    type(event_t), intent(in) :: events(:)
    type(error_t), allocatable, intent(out) :: error
    type(event_t), allocatable :: larger(:)
    integer :: room, status

    if (.not. allocated(self%log)) allocate (self%log(0))
    if (self%events > size(self%log) - size(events)) then
      room = room_for(int(self%events, int64) + size(events))
      allocate (larger(room), stat=status)
      if (status /= 0 .or. room - size(events) < self%events) then
        call raise_no_memory(self%events, 'events', error)
        return
      end if
      larger(:self%events) = self%log(:self%events)
      call move_alloc(larger, self%log)
    end if
    self%log(self%events + 1:self%events + size(events)) = events
    self%events = self%events + size(events)
  end subroutine add_events

  !> Room for these entries and as many more, as far as its integer goes.
  pure integer function room_for(needed)
    integer(int64), intent(in) :: needed
    integer(int64), parameter :: least = 512

    room_for = int(min(max(least, 2*needed), int(huge(room_for), int64)))
  end function room_for

  subroutine raise_no_memory(count, what, error)
    integer, intent(in) :: count
    character(*), intent(in) :: what
    type(error_t), allocatable, intent(out) :: error

    call raise(error, out_of_memory, 'no memory for more than '//integer_text(count)//' '//what// &
      ': raise output.interval, name fewer output.fields, or fetch them more often')
  end subroutine raise_no_memory

  !> Number of the quantity `name` in a list, 0 if it is not there.
  pure integer function find_quantity(quantities, name)
    type(quantity_t), intent(in) :: quantities(:)
    character(*), intent(in) :: name

    do find_quantity = size(quantities), 1, -1
      if (quantities(find_quantity)%name == name) return
    end do
  end function find_quantity

  !> What stands for a value that does not exist: NaN. Files leave it out.
  pure real(wp) function absent()
    absent = ieee_value(1.0_wp, ieee_quiet_nan)
  end function absent

  !> Value of a summary quantity, NaN if the run has none.
  pure real(wp) function summary_of(self, name)
    class(outcome_t), intent(in) :: self
    character(*), intent(in) :: name
    integer :: i

    summary_of = absent()
    i = find_quantity(self%summary, name)
    if (i > 0) summary_of = self%summary_value(i)
  end function summary_of
end module dst_writer
