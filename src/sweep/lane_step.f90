!> A step of several slow motions side by side, one in each lane of the processor's vectors; dst_simd_batch manages their cases.
!>
!> The equations are those of dst_low_frequency for a steady drive, with v = sqrt(w^2 + (V s)^2),
!>
!>     u' = V c - w,      w' = (k u - F(v) w/v)/m =: f(u, w),
!>
!> and the method is RODAS4P, linearly implicit of order 4(3): with J the Jacobian at the start of a step of length h,
!>
!>     (1/(gamma h) - J) k_i = f(z_0 + sum_j a_ij k_j) + sum_j c_ij k_j/h,      z_1 = z_0 + sum_i b_i k_i.
!>
!> It needs no iteration, so that every lane does the same at the same time, each with its own step. The elongation is eliminated by
!> hand, so that a division solves the linear system. Counts are reals, as vectors have numbers of one length.
!>
!> Source: Steinebach (1995), Preprint 1741, TH Darmstadt; Hairer & Wanner II, Sec. IV.7.
module dst_lane_step
  use dst_kinds, only: wp, real64, int64
  use dst_rodas4p, only: stages, gamma, a, c
  use dst_step_control, only: safety, least_factor, least_error, shortened, no_number
  use dst_stretch, only: tiny_rate
  implicit none
  private

  public :: lanes_t, lane_control_t, lane_account_t, lane_count, max_rejections, step_lanes

  !> Number of cases side by side: each operation is one of several vectors, which do not wait for each other.
  integer, parameter :: lane_count = 16

  !> X' and the load may turn twice between the ends of a step that is longer than this share of the soft spring's period, while the
  !> object is faster than this share of the drive velocity. Convention.
  real(wp), parameter :: short = 0.25_wp, creeping = 0.5_wp

  !> Largest product of step and growth rate with which the growth of unstable creep is followed, as in dst_radau.
  real(wp), parameter :: longest_growth = 2.0_wp
  !> An oscillation of frequency omega loses the share 1.8e-5 (h omega)**6 of its amplitude in a step: at most a hundredth of its
  !> growth. Below h omega = 0.5 no growth is affected.
  real(wp), parameter :: growth_accuracy = 1.0e-2_wp/1.8e-5_wp, small_angle = 0.5_wp
  !> Largest factor between steps. Convention.
  real(wp), parameter :: largest_factor = 6.0_wp
  !> If the remaining step to the end would be less than this share of a step, the step goes to the end. Convention.
  real(wp), parameter :: sliver = 1.0e-6_wp
  !> Number of rejections of one step, and of steps below the resolution of the time, after which a lane gives up.
  real(wp), parameter :: max_rejections = 60.0_wp, max_standing = 10000.0_wp

  !> The scenes.
  type :: lane_scene_t
    !> k/m and its root, 1/m, V c, and whether there is a case (1 or 0).
    real(wp), dimension(lane_count) :: stiffness_per_mass = 1.0_wp, frequency = 1.0_wp, per_mass = 1.0_wp
    real(wp), dimension(lane_count) :: drive_rate = 0.0_wp, busy = 0.0_wp
    real(wp), dimension(lane_count) :: stiffness = 1.0_wp, cos_phi = 1.0_wp, sin_phi = 1.0_wp
    real(wp), dimension(lane_count) :: velocity = 0.0_wp, across = 0.0_wp
    !> Friction: limit + drop exp(-decay v).
    real(wp), dimension(lane_count) :: limit = 0.0_wp, drop = 0.0_wp, decay = 0.0_wp
    real(wp), dimension(lane_count) :: t_end = 0.0_wp, tolerance = 1.0_wp, noise = 0.0_wp, longest_step = 1.0_wp
    real(wp), dimension(lane_count) :: max_steps = huge(1.0_wp)
  end type lane_scene_t

  !> A point of the motion and the quantities computed there.
  type :: lane_point_t
    real(wp), dimension(lane_count) :: time = 0.0_wp, u = 0.0_wp, w = 1.0_wp
    !> u', w', w'' and dw'/dw.
    real(wp), dimension(lane_count) :: u_rate = 0.0_wp, w_rate = 0.0_wp, w_curvature = 0.0_wp, growth = 0.0_wp
    !> v, F(v) and X'.
    real(wp), dimension(lane_count) :: speed = 1.0_wp, friction = 0.0_wp, rate = 0.0_wp
    !> Powers of drive and friction [W] and their rates.
    real(wp), dimension(lane_count) :: supply = 0.0_wp, supply_rate = 0.0_wp, dissipation = 0.0_wp, dissipation_rate = 0.0_wp
  end type lane_point_t

  !> The control of the steps, as in dst_step_control with prediction. Its roots are fourth roots of error over tolerance.
  type :: lane_control_t
    real(wp), dimension(lane_count) :: next_step = 1.0_wp, step = 1.0_wp
    !> Values of the last accepted step; the root is 0 if there is none.
    real(wp), dimension(lane_count) :: last_root = 0.0_wp, per_last_step = 1.0_wp
    real(wp), dimension(lane_count) :: steps = 0.0_wp, rejections = 0.0_wp, standing = 0.0_wp
    !> Whether the last attempt was accepted, and whether the lane gives up (1 or 0).
    real(wp), dimension(lane_count) :: moved = 0.0_wp, gives_up = 0.0_wp
  end type lane_control_t

  !> Sums, and the data for the summary.
  type :: lane_account_t
    !> Works and the sum of their absolute values [J].
    real(wp), dimension(lane_count) :: drive_work = 0.0_wp, friction_work = 0.0_wp, exchanged = 0.0_wp
    !> Data for the summary: the middle of the run [s], the period on the soft spring [s], the largest |X'| so far [m/s], whether
    !> slip has begun (1 or 0), whether the summary needs every step (1 or 0).
    real(wp), dimension(lane_count) :: half = 0.0_wp, natural_time = 1.0_wp, largest_rate = 0.0_wp
    real(wp), dimension(lane_count) :: has_slipped = 0.0_wp, watched = 0.0_wp
    !> Steps that the summary need not see: the time since it saw one, as far as it is in the second half, and the part of it in
    !> creep [s].
    real(wp), dimension(lane_count) :: quiet_time = 0.0_wp, quiet_creep = 0.0_wp
    !> Reasons why the summary has to see the last step.
    real(wp), dimension(lane_count) :: notes = 0.0_wp
  end type lane_account_t

  !> All lanes. The last step goes from point 3 - here to point here.
  type :: lanes_t
    type(lane_scene_t) :: scene
    type(lane_point_t) :: point(2)
    integer :: here = 1
    type(lane_control_t) :: control
    type(lane_account_t) :: account
  end type lanes_t

  interface
    !> One attempted step in every lane; or, if a case has been put in, evaluate the present points of the lanes.
    pure module subroutine step_lanes(lanes, attempts)
      type(lanes_t), intent(inout) :: lanes
      logical, intent(in) :: attempts
    end subroutine step_lanes
  end interface
end module dst_lane_step
