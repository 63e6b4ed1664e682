!> Units that people write after the numbers of a deck, where none belong: used to say what the number would be without its unit.
module dst_units
  use dst_kinds, only: wp
  implicit none
  private

  public :: is_unit, factor_of

  !> A unit, and its value in the unit of a key.
  type :: unit_t
    character(8) :: name
    character(8) :: of_key
    real(wp) :: factor
  end type unit_t

  real(wp), parameter :: degrees_per_radian = 57.295779513082320876798154814105_wp

  type(unit_t), parameter :: units(*) = [ &
    unit_t('m', 'm', 1.0_wp), unit_t('cm', 'm', 1.0e-2_wp), unit_t('mm', 'm', 1.0e-3_wp), unit_t('um', 'm', 1.0e-6_wp), &
    unit_t('nm', 'm', 1.0e-9_wp), unit_t('s', 's', 1.0_wp), unit_t('ms', 's', 1.0e-3_wp), unit_t('us', 's', 1.0e-6_wp), &
    unit_t('min', 's', 60.0_wp), unit_t('h', 's', 3600.0_wp), unit_t('kg', 'kg', 1.0_wp), unit_t('g', 'kg', 1.0e-3_wp), &
    unit_t('t', 'kg', 1.0e3_wp), unit_t('N', 'N', 1.0_wp), unit_t('mN', 'N', 1.0e-3_wp), unit_t('kN', 'N', 1.0e3_wp), &
    unit_t('m/s', 'm/s', 1.0_wp), unit_t('cm/s', 'm/s', 1.0e-2_wp), unit_t('mm/s', 'm/s', 1.0e-3_wp), &
    unit_t('um/s', 'm/s', 1.0e-6_wp), unit_t('nm/s', 'm/s', 1.0e-9_wp), unit_t('N/m', 'N/m', 1.0_wp), &
    unit_t('kN/m', 'N/m', 1.0e3_wp), unit_t('MN/m', 'N/m', 1.0e6_wp), unit_t('N/mm', 'N/m', 1.0e3_wp), &
    unit_t('kN/mm', 'N/m', 1.0e6_wp), unit_t('N/um', 'N/m', 1.0e6_wp), unit_t('Ns/m', 'N s/m', 1.0_wp), &
    unit_t('N*s/m', 'N s/m', 1.0_wp), unit_t('Ns/mm', 'N s/m', 1.0e3_wp), unit_t('s/m', 's/m', 1.0_wp), &
    unit_t('deg', 'deg', 1.0_wp), unit_t('degrees', 'deg', 1.0_wp), unit_t('rad', 'deg', degrees_per_radian), &
    unit_t('Hz', '', 0.0_wp), unit_t('Pa', '', 0.0_wp), unit_t('%', '1', 1.0e-2_wp)]

contains

  !> Whether a word is one of these units.
  pure logical function is_unit(word)
    character(*), intent(in) :: word

    is_unit = len_trim(word) > 0 .and. len(word) <= len(units%name) .and. any(units%name == word)
  end function is_unit

  !> The factor from `unit` to the unit of a key; 0 if it is a unit of another quantity.
  pure real(wp) function factor_of(unit, of_key)
    character(*), intent(in) :: unit, of_key
    integer :: i

    factor_of = 0.0_wp
    do i = 1, size(units)
      if (units(i)%name == unit .and. units(i)%of_key == of_key) factor_of = units(i)%factor
    end do
  end function factor_of
end module dst_units
