!> Which mutant is active: settled when the program starts (mutant.c), so that the function is pure for all who call it.
module dst_mutant
  use, intrinsic :: iso_c_binding, only: c_bool, c_int
  implicit none
  private

  public :: mutant_is

  interface
    pure logical(c_bool) function mutant_is(number) bind(c)
      import :: c_bool, c_int
      integer(c_int), intent(in), value :: number
    end function mutant_is
  end interface
end module dst_mutant
