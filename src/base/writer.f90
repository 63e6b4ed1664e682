!> Where the results of a run go: the interface that the run loop uses.
!>
!> Kinds of writer: HDF5 file (`dst_hdf5_writer`), arrays in memory (`dst_memory_writer`).
module dst_writer
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t
  use dst_text, only: name_width, unit_width, meaning_width
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

  !> Receives samples, events and the outcome from the run routine.
  type, abstract :: writer_t
  contains
    !> Append samples(column, row); the rows come in order of time.
    procedure(write_samples), deferred :: write_samples
    !> Append events, in order of time. Several that occur again and again are a block: all of them occur, then all of them again
    !> a period later.
    procedure(write_events), deferred :: write_events
    !> Write how the run ended, and close; nothing may be written afterwards.
    procedure(finish), deferred :: finish
  end type writer_t

  abstract interface
    subroutine write_samples(self, samples, error)
      import :: writer_t, wp, error_t
      class(writer_t), intent(inout) :: self
      real(wp), intent(in) :: samples(:, :)
      type(error_t), allocatable, intent(out) :: error
    end subroutine write_samples

    subroutine write_events(self, events, error)
      import :: writer_t, event_t, error_t
      class(writer_t), intent(inout) :: self
      type(event_t), intent(in) :: events(:)
      type(error_t), allocatable, intent(out) :: error
    end subroutine write_events

    subroutine finish(self, outcome, error)
      import :: writer_t, outcome_t, error_t
      class(writer_t), intent(inout) :: self
      type(outcome_t), intent(in) :: outcome
      type(error_t), allocatable, intent(out) :: error
    end subroutine finish
  end interface

contains

  !> Number of the quantity `name` in a list, 0 if it is not there.
  pure integer function find_quantity(quantities, name)
    type(quantity_t), intent(in) :: quantities(:)
    character(*), intent(in) :: name

    find_quantity = findloc(quantities%name, name, dim=1)
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
