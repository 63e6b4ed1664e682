!> Samples and events kept in memory until they are taken: the writer behind the Python interface.
module dst_memory_writer
  use dst_kinds, only: wp
  use dst_errors, only: error_t
  use dst_writer, only: writer_t, outcome_t
  implicit none
  private

  public :: memory_writer_t

  !> The samples and events since they were last fetched.
  type, extends(writer_t) :: memory_writer_t
    real(wp), allocatable :: samples(:, :)      !! (column, row), valid up to rows
    real(wp), allocatable :: event_time(:)      !! s, valid up to events
    integer, allocatable :: event_kind(:)
    integer :: rows = 0
    integer :: events = 0
  contains
    procedure :: write_samples
    procedure :: write_events
    procedure :: flush
    procedure :: finish
  end type memory_writer_t

contains

  subroutine write_samples(self, samples, error)
    class(memory_writer_t), intent(inout) :: self
    real(wp), intent(in) :: samples(:, :)
    type(error_t), allocatable, intent(out) :: error
    real(wp), allocatable :: larger(:, :)
    integer :: needed

    needed = self%rows + size(samples, 2)
    if (.not. allocated(self%samples)) allocate (self%samples(size(samples, 1), needed))
    if (needed > size(self%samples, 2)) then
      allocate (larger(size(samples, 1), 2*needed))
      larger(:, :self%rows) = self%samples(:, :self%rows)
      call move_alloc(larger, self%samples)
    end if
    self%samples(:, self%rows + 1:needed) = samples
    self%rows = needed
  end subroutine write_samples

  subroutine write_events(self, time, kind, error)
    class(memory_writer_t), intent(inout) :: self
    real(wp), intent(in) :: time(:)
    integer, intent(in) :: kind(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: needed

    if (.not. allocated(self%event_time)) allocate (self%event_time(64), self%event_kind(64))
    needed = self%events + size(time)
    if (needed > size(self%event_time)) then
      self%event_time = [self%event_time(:self%events), spread(0.0_wp, 1, 2*needed)]
      self%event_kind = [self%event_kind(:self%events), spread(0, 1, 2*needed)]
    end if
    self%event_time(self%events + 1:needed) = time
    self%event_kind(self%events + 1:needed) = kind
    self%events = needed
  end subroutine write_events

  !> Memory needs no flush.
  subroutine flush(self, error)
    class(memory_writer_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    associate (unused => self)
    end associate
  end subroutine flush

  !> The reader asks for the outcome itself.
  subroutine finish(self, outcome, error)
    class(memory_writer_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(error_t), allocatable, intent(out) :: error

    associate (unused => self, also_unused => outcome)
    end associate
  end subroutine finish
end module dst_memory_writer
