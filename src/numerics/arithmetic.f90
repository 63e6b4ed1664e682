!> What distinguishes the arithmetic of two machines that run the same program: the last bits of the functions of the mathematical
!> library, one by one and in vectors, and whether a product and a sum are rounded once or twice.
module dst_arithmetic
  use dst_kinds, only: wp
  use dst_sha256, only: sha256
  implicit none
  private

  public :: arithmetic_fingerprint

  integer, parameter :: points = 512

contains

  !> Eight hexadecimal digits, equal on machines on which a run gives the same bits. They are a hash of values of every function
  !> that the core uses: other digits prove other bits, equal ones make them very probable.
  function arithmetic_fingerprint() result(digits)
    character(8) :: digits
    real(wp) :: x(points), y(points), values(points, 15)
    character(storage_size(1.0_wp)/8*size(values)) :: bytes
    character(64) :: digest
    real(wp) :: z
    integer :: i

    do i = 1, points
      x(i) = real(i, wp)/47.0_wp
      y(i) = 1.0_wp/real(3*i, wp)
    end do
    ! Loops that a compiler turns into calls of vector functions.
    values(:, 1) = exp(-x)
    values(:, 2) = log(x)
    values(:, 3) = sin(x)
    values(:, 4) = cos(x)
    values(:, 5) = tan(x)
    values(:, 6) = atan2(x, y)
    values(:, 7) = hypot(x, y)
    values(:, 8) = x**y
    values(:, 9) = asin(y)
    values(:, 10) = acos(y)
    values(:, 11) = atan(x)
    values(:, 12) = tanh(y)
    values(:, 13) = log10(x)
    values(:, 14) = gamma(x)
    ! One after the other, each from the value before: no compiler makes vectors of it.
    z = 0.3_wp
    do i = 1, points
      z = sin(exp(-z*x(i)) + cos(z) + log(2.0_wp + z*z - y(i)) + atan2(z, x(i)) + hypot(z, y(i)))
      values(i, 15) = z
    end do
    bytes = transfer(values, bytes)
    digest = sha256(bytes)
    digits = digest(:len(digits))
  end function arithmetic_fingerprint
end module dst_arithmetic
