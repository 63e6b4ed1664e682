!> The faults found in one deck and in the settings of the command line, in the order of their lines.
module dst_faults
  use dst_text, only: text_builder_t, integer_text, excerpt, printable
  implicit none
  private

  public :: faults_t, not_all_faults

  !> More faults than a reader would want: the search for more may stop.
  integer, parameter :: most_faults = 100
  character(*), parameter :: not_all_faults = 'only the first faults are listed: mend these and check again'

  type :: fault_t
    integer :: line = 0        !! line of the deck; 0 = the file as a whole
    integer :: setting = 0     !! number of the --set argument; 0 = the deck
    character(96) :: argument = ''
    character(480) :: text = ''
  end type fault_t

  !> The faults of a deck, collected.
  type :: faults_t
    integer :: count = 0
    type(fault_t), allocatable :: item(:)   !! on the heap: they are larger than a small stack
  contains
    procedure :: add
    procedure :: full
    procedure :: report
  end type faults_t

contains

  !> Note a fault in line `line` of the deck, or in the --set argument `argument`, number `setting`.
  subroutine add(self, line, text, setting, argument)
    class(faults_t), intent(inout) :: self
    integer, intent(in) :: line
    character(*), intent(in) :: text
    integer, intent(in), optional :: setting
    character(*), intent(in), optional :: argument
    type(fault_t) :: fault
    integer :: i

    if (self%full()) return
    if (.not. allocated(self%item)) allocate (self%item(most_faults))
    fault%line = line
    fault%text = text
    if (present(setting)) fault%setting = setting
    if (present(argument)) fault%argument = excerpt(argument)
    i = self%count
    do while (i > 0)
      if (.not. before(fault, self%item(i))) exit
      self%item(i + 1) = self%item(i)
      i = i - 1
    end do
    self%item(i + 1) = fault
    self%count = self%count + 1
  end subroutine add

  pure logical function before(a, b)
    type(fault_t), intent(in) :: a, b

    before = a%setting < b%setting .or. (a%setting == b%setting .and. a%line < b%line)
  end function before

  pure logical function full(self)
    class(faults_t), intent(in) :: self

    full = self%count == most_faults
  end function full

  !> One line a fault: `NAME:LINE: what is wrong: what would be right`.
  function report(self, name) result(text)
    class(faults_t), intent(in) :: self
    character(*), intent(in) :: name       !! the deck's file name
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    integer :: i

    do i = 1, self%count
      if (i > 1) call builder%append(achar(10))
      associate (fault => self%item(i))
        if (fault%setting > 0) then
          call builder%append('--set '//number(fault%setting)//' ('//trim(fault%argument)//')')
        else
          call builder%append(printable(name))
          if (fault%line > 0) call builder%append(':'//number(fault%line))
        end if
        call builder%append(': '//printable(trim(fault%text)))
      end associate
    end do
    if (self%full()) call builder%append(achar(10)//printable(name)//': '//not_all_faults)
    text = builder%content()
  end function report

  function number(i) result(text)
    integer, intent(in) :: i
    character(:), allocatable :: text

    text = integer_text(i)
  end function number
end module dst_faults
