!> Samples and events kept in memory until they are taken: the writer behind the Python interface.
module dst_memory_writer
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, out_of_memory
  use dst_text, only: integer_text
  use dst_writer, only: writer_t, event_t, outcome_t
  implicit none
  private

  public :: memory_writer_t

  !> The samples and events since they were last fetched.
  type, extends(writer_t) :: memory_writer_t
    real(wp), allocatable :: samples(:, :)      !! (column, row), valid up to rows
    type(event_t), allocatable :: log(:)        !! valid up to events
    integer :: rows = 0
    integer :: events = 0
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: finish
  end type memory_writer_t

contains

  subroutine write_samples(self, samples, error)
    class(memory_writer_t), intent(inout) :: self
    real(wp), intent(in) :: samples(:, :)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: larger(:, :)
    integer :: room, status

    room = 0
    if (allocated(self%samples)) room = size(self%samples, 2)
    if (self%rows > room - size(samples, 2)) then
      call enlarge(room, self%rows, size(samples, 2))
      allocate (larger(size(samples, 1), room), stat=status)
      if (status /= 0 .or. room == 0) then
        call raise_no_memory(self%rows, 'samples', error)
        return
      end if
      if (self%rows > 0) larger(:, :self%rows) = self%samples(:, :self%rows)
      call move_alloc(larger, self%samples)
    end if
    self%samples(:, self%rows + 1:self%rows + size(samples, 2)) = samples
    self%rows = self%rows + size(samples, 2)
  end subroutine write_samples

  !> Double the capacity for `count` entries until there is room for `more`; 0 if the new one is too large for its integer.
  pure subroutine enlarge(room, count, more)
    integer, intent(inout) :: room
    integer, intent(in) :: count, more
    integer(int64) :: needed

    needed = int(count, int64) + more
    if (room > 0) needed = 2*needed
    needed = min(needed, int(huge(room), int64))
    room = merge(int(needed), 0, needed - count >= more)
  end subroutine enlarge

  subroutine raise_no_memory(count, what, error)
    integer, intent(in) :: count
    character(*), intent(in) :: what
    type(error_t), allocatable, intent(out) :: error

    call raise(error, out_of_memory, 'no memory for more than '//integer_text(count)//' '//what// &
      ': raise output.interval, name fewer output.fields, or fetch them more often')
  end subroutine raise_no_memory

  subroutine write_events(self, events, error)
    class(memory_writer_t), intent(inout) :: self
    type(event_t), intent(in) :: events(:)
    type(error_t), allocatable, intent(out) :: error
    type(event_t), allocatable :: larger(:)
    integer :: room, status

    room = 0
    if (allocated(self%log)) room = size(self%log)
    if (self%events > room - size(events)) then
      call enlarge(room, self%events, max(64, size(events)))
      allocate (larger(room), stat=status)
      if (status /= 0 .or. room == 0) then
        call raise_no_memory(self%events, 'events', error)
        return
      end if
      if (self%events > 0) larger(:self%events) = self%log(:self%events)
      call move_alloc(larger, self%log)
    end if
    self%log(self%events + 1:self%events + size(events)) = events
    self%events = self%events + size(events)
  end subroutine write_events

  !> The caller reads the outcome directly.
  subroutine finish(self, outcome, error)
    class(memory_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(out) :: error

    associate (unused => self, also_unused => outcome)
    end associate
  end subroutine finish
end module dst_memory_writer
