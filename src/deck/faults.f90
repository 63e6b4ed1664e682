!> The faults found in one deck and in the settings of the command line, in the order of their lines.
module dst_faults
  use dst_text, only: text_builder_t, integer_text, printable
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
    generic :: add => add_at, add_in_line
    procedure :: full
    procedure :: report
    procedure, private :: add_at, add_in_line
  end type faults_t

contains

  !> Note a fault in a line of the deck.
  subroutine add_in_line(self, line, text)
    class(faults_t), intent(inout) :: self
    integer, intent(in) :: line
    character(*), intent(in) :: text

    call self%add_at(place_t(line=line), text)
  end subroutine add_in_line

  !> Note a fault.
  subroutine add_at(self, place, text)
    class(faults_t), intent(inout) :: self
    type(place_t), intent(in) :: place
    character(*), intent(in) :: text
    type(fault_t) :: fault
    integer :: i

    if (self%full()) return
    if (.not. allocated(self%item)) allocate (self%item(most_faults))
    fault%place = place
    fault%text = text
    i = self%count
    do while (i > 0)
      if (.not. before(place, self%item(i)%place)) exit
      self%item(i + 1) = self%item(i)
      i = i - 1
    end do
    self%item(i + 1) = fault
    self%count = self%count + 1
  end subroutine add_at

  pure logical function before(a, b)
    type(place_t), intent(in) :: a, b

    before = a%setting < b%setting .or. (a%setting == b%setting .and. a%line < b%line)
  end function before

  pure logical function full(self)
    class(faults_t), intent(in) :: self

    full = self%count == most_faults
  end function full

  !> One line for each fault: `NAME:LINE: what is wrong: what to do`.
  function report(self, name) result(text)
    class(faults_t), intent(in) :: self
    character(*), intent(in) :: name       !! the deck's file name
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    integer :: i

    do i = 1, self%count
      if (i > 1) call builder%append(achar(10))
      associate (place => self%item(i)%place)
        if (place%setting > 0) then
          call builder%append('--set '//trim(place%argument))
        else
          call builder%append(printable(name))
          if (place%line > 0) call builder%append(':'//integer_text(place%line))
        end if
        call builder%append(': '//printable(trim(self%item(i)%text)))
      end associate
    end do
    if (self%full()) call builder%append(achar(10)//printable(name)//': '//not_all_faults)
    text = builder%content()
  end function report
end module dst_faults
