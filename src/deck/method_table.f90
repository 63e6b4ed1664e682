!> The methods of integration: their names, kinds and orders. The choices of decks and what compares methods read them here.
module dst_method_table
  implicit none
  private

  public :: method_table, method_order, implicit_methods, explicit_methods, sweep_methods, fixed_step_methods

  !> A method's name and order.
  type :: method_t
    character(12) :: name = ''
    integer :: order = 0
  end type method_t

  !> All methods, kind by kind.
  type(method_t), parameter :: method_table(*) = [ &
    method_t('radau5', 5), method_t('radau9', 9), method_t('radau13', 13), &
    method_t('dopri5', 5), method_t('dop853', 8), &
    method_t('rodas4p', 4), &
    method_t('rk4', 4), method_t('moreau_jean', 1)]

  !> Names by kind, separated by blanks: Radau IIA.
  character(*), parameter :: implicit_methods = trim(method_table(1)%name)//' '//trim(method_table(2)%name)//' '// &
    trim(method_table(3)%name)
  !> Explicit ones that choose their step.
  character(*), parameter :: explicit_methods = trim(method_table(4)%name)//' '//trim(method_table(5)%name)
  !> For the cases of a sweep only.
  character(*), parameter :: sweep_methods = trim(method_table(6)%name)
  !> With a fixed step.
  character(*), parameter :: fixed_step_methods = trim(method_table(7)%name)//' '//trim(method_table(8)%name)

contains

  !> Order of a method, 0 for a name that is none.
  pure integer function method_order(name) result(order)
    character(*), intent(in) :: name
    integer :: i

    order = 0
    do i = 1, size(method_table)
      if (method_table(i)%name == name) order = method_table(i)%order
    end do
  end function method_order
end module dst_method_table
