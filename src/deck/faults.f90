!> The faults found in one deck and in the settings of the command line, in the order of their lines.
module dst_faults
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: faults_t, place_t, not_all_faults

  !> Largest number of faults that a reader would want: the search for more may stop.
  integer, parameter :: most_faults = 100
  character(*), parameter :: not_all_faults = 'only the first faults are listed: fix these and check again'

  !> The place of a value: in a line of the deck, or in an argument of --set.
  type :: place_t
    integer :: line = 0              !! 0 = the deck as a whole
    integer :: setting = 0           !! number of the argument; 0 = the deck
    character(96) :: argument = ''   !! in the form used in messages
  end type place_t

  type :: fault_t
    type(place_t) :: place
    character(480) :: text = ''
  end type fault_t

  !> The list of the faults of a deck.
  type :: faults_t
    integer :: count = 0
    type(fault_t), allocatable :: item(:)   !! on the heap: they are larger than a small stack
  contains
    procedure :: add
    procedure :: full
    procedure :: report
  end type faults_t

contains

  !> Note a fault, after those of the same place.
  subroutine add(self, place, text)
    class(faults_t), intent(inout) :: self
    type(place_t), intent(in) :: place
    character(*), intent(in) :: text
    integer :: i

    if (self%full()) return
    if (.not. allocated(self%item)) allocate (self%item(most_faults))
    do i = self%count, 1, -1
      associate (other => self%item(i)%place)
        if (other%setting < place%setting .or. (other%setting == place%setting .and. other%line <= place%line)) exit
      end associate
      self%item(i + 1) = self%item(i)
    end do
    self%item(i + 1) = fault_t(place, text)
    self%count = self%count + 1
  end subroutine add

  pure logical function full(self)
    class(faults_t), intent(in) :: self

    full = self%count == most_faults
  end function full

  !> One line for each fault: `NAME:LINE: what is wrong: what to do`.
  function report(self, name) result(text)
    class(faults_t), intent(in) :: self
    character(*), intent(in) :: name       !! the deck's file name
    character(:), allocatable :: text
    integer :: i

    text = ''
    do i = 1, self%count
      if (i > 1) text = text//new_line('a')
      associate (place => self%item(i)%place)
        if (place%setting > 0) then
          text = text//'--set '//trim(place%argument)
        else
          text = text//printable(name)
          if (place%line > 0) text = text//':'//integer_text(place%line)
        end if
        text = text//': '//printable(trim(self%item(i)%text))
      end associate
    end do
    if (self%full()) text = text//new_line('a')//printable(name)//': '//not_all_faults
  end function report
end module dst_faults
