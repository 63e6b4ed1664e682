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
    values(:, :14) = reshape([exp(-x), log(x), sin(x), cos(x), tan(x), atan2(x, y), hypot(x, y), x**y, asin(y), acos(y), atan(x), &
      tanh(y), log10(x), gamma(x)], [points, 14])
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
