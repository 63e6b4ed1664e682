!> Radau IIA collocation on [0, 1] with any odd number of stages, computed to working precision.
!>
!> Nodes: zeros of P_s - P_(s-1) (Legendre), the last one is 1. Weights and integration matrix follow from the discrete
!> orthogonality of the Legendre polynomials on these nodes, so no coefficient is typed from a table and any precision is possible.
!>
!> Source: Hairer & Wanner, Solving Ordinary Differential Equations II, Sec. IV.5 and IV.8.
module dst_collocation
  use dst_kinds, only: wp
  use dst_interpolation, only: grid_t, new_grid, max_degree
  implicit none
  private

  public :: collocation_t, radau_iia, max_stages, max_rows

  !> Stages of the largest method, and rows of its matrices: these are padded with zeros to an even number, for loops by pairs.
  integer, parameter :: max_stages = max_degree, max_rows = 2*((max_stages + 1)/2)
  !> Most Newton iterations; the change of the root, relative to it, that is roundoff; and where the search for the pole begins,
  !> over the number of stages (a little above the pole). Twice: at most the last digit of gamma.
  integer, parameter :: max_iterations = 200
  real(wp), parameter :: root_roundoff = 2.0_wp*epsilon(1.0_wp), pole_roundoff = 4.0_wp*epsilon(1.0_wp)
  real(wp), parameter :: pole_start = 1.3_wp

  !> A stiffly accurate collocation method.
  type :: collocation_t
    integer :: stages = 0
    !> Classical order 2 s - 1.
    integer :: order = 0
    !> Interpolation on 0 and the nodes c_1 … c_s = 1.
    type(grid_t) :: grid
    !> Quadrature weights b.
    real(wp) :: weight(max_stages) = 0.0_wp
    !> Integration matrix A: integral from 0 to c_i of the j-th Lagrange polynomial.
    real(wp) :: integral(max_rows, max_stages) = 0.0_wp
    !> Its inverse: rows and columns 1 ... s of the grid's derivative matrix.
    real(wp) :: inverse(max_rows, max_stages) = 0.0_wp
    !> Inverse of the real eigenvalue of the inverse of A: the weight of the error estimate.
    real(wp) :: gamma = 0.0_wp
  end type collocation_t

contains

  !> Radau IIA with `stages` stages (order 2 stages - 1).
  pure function radau_iia(stages) result(method)
    integer, intent(in) :: stages
    type(collocation_t) :: method
    real(wp) :: node(0:stages), legendre(0:stages, stages), value
    integer :: i, j, k

    method%stages = stages
    method%order = 2*stages - 1
    node(0) = 0.0_wp
    do i = 1, stages
      node(i) = 0.5_wp*(1.0_wp + radau_zero(stages, i))
      legendre(:, i) = legendre_values(stages, 2.0_wp*node(i) - 1.0_wp)
    end do
    method%grid = new_grid(node)
    do j = 1, stages
      value = 0.0_wp
      do k = 0, stages - 1
        value = value + real(2*k + 1, wp)*legendre(k, j)**2
      end do
      method%weight(j) = 1.0_wp/value
    end do
    do j = 1, stages
      do i = 1, stages
        value = node(i)
        do k = 1, stages - 1
          value = value + 0.5_wp*legendre(k, j)*(legendre(k + 1, i) - legendre(k - 1, i))
        end do
        method%integral(i, j) = method%weight(j)*value
      end do
    end do
    method%inverse(1:stages, 1:stages) = method%grid%derivative(1:stages, 1:stages)
    method%gamma = 1.0_wp/real_pole(stages)
  end function radau_iia

  !> The i-th zero in ascending order of P_s - P_(s-1) on [-1, 1], by Newton's method
  !> from its asymptotic position.
  pure function radau_zero(s, i) result(x)
    integer, intent(in) :: s, i
    real(wp) :: x
    real(wp) :: p(0:s), dp(0:s), f, df, correction
    integer :: iteration

    if (i == s) then
      x = 1.0_wp
      return
    end if
    x = cos(2.0_wp*acos(-1.0_wp)*real(s - i, wp)/real(2*s - 1, wp))
    do iteration = 1, max_iterations
      p = legendre_values(s, x)
      dp = legendre_derivatives(s, x, p)
      f = p(s) - p(s - 1)
      df = dp(s) - dp(s - 1)
      correction = f/df
      x = x - correction
      if (abs(correction) <= root_roundoff) exit
    end do
  end function radau_zero

  !> Legendre polynomials P_0 … P_n at x.
  pure function legendre_values(n, x) result(p)
    integer, intent(in) :: n
    real(wp), intent(in) :: x
    real(wp) :: p(0:n)
    integer :: k

    p(0) = 1.0_wp
    if (n > 0) p(1) = x
    do k = 1, n - 1
      p(k + 1) = (real(2*k + 1, wp)*x*p(k) - real(k, wp)*p(k - 1))/real(k + 1, wp)
    end do
  end function legendre_values

  !> Derivatives of P_0 … P_n at x from their values there.
  pure function legendre_derivatives(n, x, p) result(dp)
    integer, intent(in) :: n
    real(wp), intent(in) :: x, p(0:n)
    real(wp) :: dp(0:n)
    integer :: k

    dp(0) = 0.0_wp
    do k = 1, n
      dp(k) = real(k, wp)*p(k - 1) + x*dp(k - 1)
    end do
  end function legendre_derivatives

  !> The real zero of the denominator of the (s-1, s) Padé approximation of exp, which is the
  !> stability function of Radau IIA; s is odd, so there is exactly one.
  pure function real_pole(s) result(z)
    integer, intent(in) :: s
    real(wp) :: z
    real(wp) :: coefficient(0:s), q, dq
    integer :: k, iteration

    coefficient(0) = 1.0_wp
    do k = 1, s
      coefficient(k) = -coefficient(k - 1)*real(s - k + 1, wp)/(real(k, wp)*real(2*s - k, wp))
    end do
    z = pole_start*real(s, wp)
    do iteration = 1, max_iterations
      q = coefficient(s)
      dq = 0.0_wp
      do k = s - 1, 0, -1
        dq = dq*z + q
        q = q*z + coefficient(k)
      end do
      z = z - q/dq
      if (abs(q/dq) <= pole_roundoff*z) exit
    end do
  end function real_pole
end module dst_collocation
