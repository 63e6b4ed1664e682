!> Polynomials on [0, 1] through values at given nodes: the form in which every integrator returns its dense output.
module dst_interpolation
  use dst_kinds, only: wp, pi
  use dst_linear_solve, only: solve_in_place
  implicit none
  private

  public :: grid_t, new_grid, chebyshev_grid, max_degree, last_begun

  !> Degree of the largest polynomial.
  integer, parameter :: max_degree = 7

  !> Nodes 0..degree in [0, 1] and the constants for interpolation on them. node(0) = 0.
  type :: grid_t
    integer :: degree = 0
    real(wp) :: node(0:max_degree) = 0.0_wp
    !> Barycentric weights.
    real(wp) :: barycentric(0:max_degree) = 0.0_wp
    !> derivative(i, j): derivative at node i of the j-th Lagrange polynomial.
    real(wp) :: derivative(0:max_degree, 0:max_degree) = 0.0_wp
    !> integral(i, j): integral from 0 to node i of the j-th Lagrange polynomial on the nodes 1..degree: the inverse of `derivative`
    !> there.
    real(wp) :: integral(max_degree, max_degree) = 0.0_wp
    !> Bernstein coefficients on [0, 1] from nodal values.
    real(wp) :: bernstein(0:max_degree, 0:max_degree) = 0.0_wp
    !> reciprocal(j, k) = 1/(node(j) - node(j - k)), for divided differences.
    real(wp) :: reciprocal(0:max_degree, max_degree) = 0.0_wp
  contains
    procedure :: lagrange
    procedure :: values_at
    procedure :: bernstein_coefficients
  end type grid_t

contains

  !> Grid on the given distinct nodes, the first one 0.
  pure function new_grid(nodes) result(grid)
    real(wp), intent(in) :: nodes(0:)
    type(grid_t) :: grid
    integer :: j, k

    grid%degree = size(nodes) - 1
    grid%node(0:grid%degree) = nodes
    call set_differentiation(grid)
    call set_integration(grid)
    call set_bernstein(grid)
    do k = 1, grid%degree
      do j = k, grid%degree
        grid%reciprocal(j, k) = 1.0_wp/(grid%node(j) - grid%node(j - k))
      end do
    end do
  end function new_grid

  !> The grid of the highest degree, on the extrema of Chebyshev's polynomial: a polynomial through values there is accurate
  !> everywhere.
  pure function chebyshev_grid() result(grid)
    type(grid_t) :: grid
    integer :: i

    grid = new_grid([(sin(0.5_wp*pi*real(i, wp)/real(max_degree, wp))**2, i=0, max_degree)])
  end function chebyshev_grid

  !> Number of the last of some parts, one after another, that begins at or before a position; the first one, if there is none.
  pure integer function last_begun(begins, at) result(last)
    real(wp), intent(in) :: begins(:), at
    integer :: above, middle

    last = 1
    above = size(begins) + 1
    do while (above - last > 1)
      middle = (last + above)/2
      if (begins(middle) <= at) then
        last = middle
      else
        above = middle
      end if
    end do
  end function last_begun

  !> Values at n positions `tau` (which may be outside [0, 1]), at most max_degree + 1, of the polynomial through `nodal`, in
  !> Newton's form: for several positions the cheapest, and accurate enough for a first guess. All loops have the full
  !> length, a constant for the compiler; terms beyond the degree are zero.
  pure subroutine values_at(self, nodal, n, tau, values)
    class(grid_t), intent(in) :: self
    real(wp), intent(in) :: nodal(0:max_degree)
    integer, intent(in) :: n
    real(wp), intent(in) :: tau(n)
    real(wp), intent(out) :: values(n)
    real(wp), dimension(0:max_degree) :: difference, position, value
    integer :: j, k

    difference = nodal
    do k = 1, max_degree
      do j = max_degree, k, -1
        difference(j) = (difference(j) - difference(j - 1))*self%reciprocal(j, k)
      end do
    end do
    position = 0.0_wp
    position(0:n - 1) = tau
    value = difference(max_degree)
    do j = max_degree - 1, 0, -1
      value = value*(position - self%node(j)) + difference(j)
    end do
    values = value(0:n - 1)
  end subroutine values_at

  !> Lagrange basis on the nodes 0..degree at position `tau` (which may be outside [0, 1]).
  pure subroutine lagrange(self, tau, basis)
    class(grid_t), intent(in) :: self
    real(wp), intent(in) :: tau
    real(wp), intent(out) :: basis(0:max_degree)
    real(wp) :: distance(0:max_degree), product
    integer :: j

    associate (s => self%degree)
      distance(0:s) = tau - self%node(0:s)
      ! Forward products from the left, backward products from the right: no division.
      product = 1.0_wp
      do j = 0, s
        basis(j) = self%barycentric(j)*product
        product = product*distance(j)
      end do
      product = 1.0_wp
      do j = s, 0, -1
        basis(j) = basis(j)*product
        product = product*distance(j)
      end do
    end associate
  end subroutine lagrange

  !> Barycentric weights and the differentiation matrix on the nodes 0..degree.
  pure subroutine set_differentiation(grid)
    type(grid_t), intent(inout) :: grid
    integer :: i, j

    associate (s => grid%degree, c => grid%node, b => grid%barycentric, d => grid%derivative)
      do j = 0, s
        b(j) = 1.0_wp
        do i = 0, s
          if (i /= j) b(j) = b(j)/(c(j) - c(i))
        end do
      end do
      do i = 0, s
        do j = 0, s
          if (i == j) cycle
          d(i, j) = (b(j)/b(i))/(c(i) - c(j))
          d(i, i) = d(i, i) + 1.0_wp/(c(i) - c(j))
        end do
      end do
    end associate
  end subroutine set_differentiation

  !> The matrix of integrals, column by column.
  pure subroutine set_integration(grid)
    type(grid_t), intent(inout) :: grid
    real(wp) :: matrix(grid%degree, grid%degree)
    logical :: singular
    integer :: j

    associate (s => grid%degree)
      do j = 1, s
        matrix = grid%derivative(1:s, 1:s)
        grid%integral(j, j) = 1.0_wp
        call solve_in_place(s, matrix, grid%integral(1:s, j), singular)
      end do
    end associate
  end subroutine set_integration

  !> Matrix from nodal values to Bernstein coefficients of the same polynomial on [0, 1]: each
  !> Lagrange polynomial is a product of linear factors, multiplied in Bernstein form.
  pure subroutine set_bernstein(grid)
    type(grid_t), intent(inout) :: grid
    real(wp) :: coefficient(0:grid%degree)
    integer :: i, j, k, degree

    do j = 0, grid%degree
      coefficient = 0.0_wp
      coefficient(0) = grid%barycentric(j)
      degree = 0
      do i = 0, grid%degree
        if (i == j) cycle
        ! Times tau - c_i = -c_i (1 - tau) + (1 - c_i) tau.
        degree = degree + 1
        coefficient(degree) = (1.0_wp - grid%node(i))*coefficient(degree - 1)
        do k = degree - 1, 1, -1
          coefficient(k) = (real(k, wp)*(1.0_wp - grid%node(i))*coefficient(k - 1) &
            - real(degree - k, wp)*grid%node(i)*coefficient(k))/real(degree, wp)
        end do
        coefficient(0) = -grid%node(i)*coefficient(0)
      end do
      grid%bernstein(0:grid%degree, j) = coefficient
    end do
  end subroutine set_bernstein

  !> Bernstein coefficients of the polynomial with the given values at the nodes; 0 beyond its degree. All loops have the full
  !> length, as in `values_at`.
  pure subroutine bernstein_coefficients(self, values, coefficient)
    class(grid_t), intent(in) :: self
    real(wp), intent(in) :: values(0:max_degree)
    real(wp), intent(out) :: coefficient(0:max_degree)
    integer :: j

    coefficient = 0.0_wp
    do j = 0, max_degree
      coefficient = coefficient + self%bernstein(:, j)*values(j)
    end do
  end subroutine bernstein_coefficients
end module dst_interpolation
