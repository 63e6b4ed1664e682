!> The motion inside a step or a closed form, as polynomials in the position tau in [0, 1].
module dst_dense_output
  use dst_interpolation, only: grid_t, max_degree
  use dst_kinds, only: wp
  use dst_slip_system, only: max_components, max_unknowns
  implicit none
  private

  public :: dense_output_t, column_u, column_y, column_position, n_columns

  !> Columns of the nodal values.
  integer, parameter :: column_u = 1, column_y = 1 + max_components, column_position = column_y + max_unknowns
  integer, parameter :: n_columns = column_position

  !> Polynomials through their values at the nodes of a grid.
  type :: dense_output_t
    type(grid_t) :: grid
    real(wp) :: step = 0.0_wp                                !! duration, s
    !> Values at the nodes: u minus the drive's displacement, y, X. The columns are polynomials.
    real(wp) :: nodal(0:max_degree, n_columns) = 0.0_wp
  contains
    procedure :: values_at
    procedure :: take
    procedure :: speed_coefficients
    procedure :: end_slope
  end type dense_output_t

contains

  !> The values of all columns at position `tau`.
  pure function values_at(self, tau) result(value)
    class(dense_output_t), intent(in) :: self
    real(wp), intent(in) :: tau
    real(wp) :: value(n_columns), basis(0:max_degree)
    integer :: j

    call self%grid%lagrange(tau, basis)
    do j = 1, n_columns
      value(j) = dot_product(basis(0:self%grid%degree), self%nodal(0:self%grid%degree, j))
    end do
  end function values_at

  !> Become a copy of another one. A grid has many numbers, and there are few grids: the same one is not copied again.
  pure subroutine take(self, other)
    class(dense_output_t), intent(inout) :: self
    class(dense_output_t), intent(in) :: other

    if (self%grid%degree /= other%grid%degree .or. abs(self%grid%node(1) - other%grid%node(1)) > 0.0_wp) self%grid = other%grid
    self%step = other%step
    self%nodal = other%nodal
  end subroutine take

  !> Bernstein coefficients of the first slip unknown.
  pure subroutine speed_coefficients(self, coefficient)
    class(dense_output_t), intent(in) :: self
    real(wp), intent(out) :: coefficient(0:max_degree)

    call self%grid%bernstein_coefficients(self%nodal(:, column_y), coefficient)
  end subroutine speed_coefficients

  !> First and second derivative with respect to time [1/s, 1/s2] of the first slip unknown at the end.
  pure subroutine end_slope(self, slope, curvature)
    class(dense_output_t), intent(in) :: self
    real(wp), intent(out) :: slope, curvature
    real(wp) :: rate(0:max_degree)
    integer :: i

    rate = 0.0_wp
    associate (grid => self%grid, s => self%grid%degree)
      do i = 0, s
        rate(i) = dot_product(grid%derivative(i, 0:s), self%nodal(0:s, column_y))/self%step
      end do
      slope = rate(s)
      curvature = dot_product(grid%derivative(s, 0:s), rate(0:s))/self%step
    end associate
  end subroutine end_slope
end module dst_dense_output
