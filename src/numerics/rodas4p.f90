!> Coefficients of RODAS4P, a Rosenbrock method of order 4(3) in Hairer & Wanner's form,
!>
!>     (1/(gamma h) - J) k_i = f(z_0 + sum_j a_ij k_j) + sum_j c_ij k_j/h,
!>
!> stiffly accurate: z_1 = z_0 + sum_j a_sj k_j + k_s with the last stage s, and k_s is the difference to the embedded solution.
!>
!> The coefficients are published to 16 digits, the last of which are rounded: the order conditions hold to 1e-14 in any precision.
!> Source: Steinebach (1995), Preprint 1741, TH Darmstadt; Hairer & Wanner II, Sec. IV.7.
module dst_rodas4p
  use dst_kinds, only: wp
  implicit none
  private

  public :: stages, order, gamma, a, c

  !> Number of stages, and order of the solution.
  integer, parameter :: stages = 6, order = 4
  !> Diagonal coefficient.
  real(wp), parameter :: gamma = 0.25_wp
  !> a_ij of the arguments.
  real(wp), parameter :: a(stages, stages) = transpose(reshape([ &
    0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    1.831036793486759_wp, 0.4955183967433795_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    2.304376582692669_wp, -0.05249275245743001_wp, -1.176798761832782_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    -7.170454962423024_wp, -4.741636671481785_wp, -16.31002631330971_wp, -1.062004044111401_wp, 0.0_wp, 0.0_wp, &
    -7.170454962423024_wp, -4.741636671481785_wp, -16.31002631330971_wp, -1.062004044111401_wp, 1.0_wp, 0.0_wp], &
    [stages, stages]))
  !> c_ij of the increments.
  real(wp), parameter :: c(stages, stages) = transpose(reshape([ &
    0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    -12.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    -8.791795173947035_wp, -2.207865586973518_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    10.81793056857153_wp, 6.780270611428266_wp, 19.53485944642410_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
    34.19095006749676_wp, 15.49671153725963_wp, 54.74760875964130_wp, 14.16005392148534_wp, 0.0_wp, 0.0_wp, &
    34.62605830930532_wp, 15.30084976114473_wp, 56.99955578662667_wp, 18.40807009793095_wp, -5.714285714285717_wp, 0.0_wp], &
    [stages, stages]))
end module dst_rodas4p
