!> Slow creep without inertia: Eq. (7) in closed form, its finite-k_y generalisation, and Eq. (8).
!>
!> Massless, constant friction F_0 = mu_0 W, kappa = k_x/k_y, l_x = F_0/k_x, tau = V t/l_x. While the
!> object creeps, |K u| = F_0; with k_x u_x/F_0 = sin(alpha) and k_y u_y/F_0 = cos(alpha),
!>
!>     (cos^2 alpha + kappa sin^2 alpha) d(alpha)/d(tau) = cos(alpha + phi)
!>
!> (kappa = 0 is Eq. 7). Before that, up to tau_1 = kappa/sqrt(kappa^2 c^2 + s^2), it is truly at rest, and
!> soft axis and to the drive, and the path g = ln[tan(psi_1/2)/tan(psi/2)],
!>
!>     tau - tau_1 = (1 - kappa) [sin(alpha - phi) - sin(alpha_1 - phi) + g s^2] + kappa g.
!>
!> The unknown is g. tau rises with it and is concave: tau' = cos^2 alpha + kappa sin^2 alpha lies between 0 and 1 and |tau''| <= 2
!> tau', so that iterations of high order converge from any start that is not far from the solution, and Newton's iteration from
!> everywhere. Small quantities (1 - exp(-g), psi, 1 - X'/V) are computed directly: nothing cancels for any phi.
!>
!> Source: Nakano & Popov (2020), Eqs. (6)-(8); docs/theory.md derives the closed form.
module dst_creep
  use dst_kinds, only: wp, pi
  implicit none
  private

  public :: creep_t, creep_path_t, new_creep_path, creep_at, creep_exact
  public :: creep_asymptotic

  !> The state of creep at one time; all ratios without unit.
  type :: creep_t
    real(wp) :: alpha = 0.0_wp       !! rad; sin(alpha) = k_x u_x/F_0
    real(wp) :: psi = 0.0_wp         !! rad, from the drive to friction; theta = phi + psi
    real(wp) :: speed = 0.0_wp       !! v/V
    real(wp) :: x_rate = 0.0_wp      !! X'/V
    real(wp) :: y_rate = 0.0_wp      !! Y'/V
    real(wp) :: position = 0.0_wp    !! X/l_x
    real(wp) :: deficit = 0.0_wp     !! 1 - X'/V
  end type creep_t

  !> Constants that depend on the misalignment and the stiffnesses only.
  type :: creep_path_t
    real(wp) :: phi = 0.0_wp                      !! rad
    real(wp) :: kappa = 0.0_wp                    !! k_x/k_y
    real(wp) :: s = 0.0_wp, c = 1.0_wp            !! sin(phi), cos(phi)
    real(wp) :: cos_2 = 1.0_wp                    !! cos(2 phi)
    real(wp) :: tau_1 = 0.0_wp, alpha_1 = 0.0_wp  !! where creep begins; alpha_1 in rad
    real(wp) :: anchor = 0.0_wp, head = 0.0_wp    !! tau - tau_1 = (tau - anchor) + head; anchor is 0 or 1
    real(wp) :: tail = 0.0_wp                     !! distance = (tau - 1) - phi + tail
    real(wp) :: weight = 0.0_wp                   !! s^2 + kappa c^2, the smallest value of tau'
    real(wp) :: turn = 1.0_wp                     !! up to this tau, differences are taken from the start
    real(wp) :: psi_1 = 0.5_wp*pi                 !! rad, psi at tau_1
    real(wp) :: q_1 = 1.0_wp                      !! tan(psi_1/2)
    real(wp) :: sine_1 = 0.0_wp, cosine_1 = 1.0_wp  !! of alpha_1
    real(wp) :: beta_sine = 0.0_wp, beta_cosine = 1.0_wp  !! of alpha_1 + phi
    real(wp) :: log_ratio = 0.0_wp                !! ln(2 tan(psi_1/2)/s); 0 for s = 0
  end type creep_path_t

  !> A point of the path.
  type :: point_t
    real(wp) :: g, decay, turned   !! g, exp(-g) and 1 - exp(-g)
    real(wp) :: tangent, q         !! tan((alpha - alpha_1)/2), tan(psi/2)
    real(wp) :: turn_sine          !! sin(alpha - alpha_1)
    real(wp) :: sin_alpha, cos_alpha, sin_psi, cos_psi
  end type point_t

  integer, parameter :: max_iterations = 200
  ! The constants below choose between expressions that agree and between first guesses: they affect roundoff and the number of
  ! iterations, not the result. They are chosen where two neighbours are equally good.
  !
  ! Below this elapsed tau, alpha is small and differences are taken from the start; above it they are taken from tau = 1.
  real(wp), parameter :: early = 0.3_wp
  ! From this sin(phi) on, the series in tau is near enough everywhere, and cheaper than an exponential and a logarithm.
  real(wp), parameter :: wide = 0.3_wp
  ! For steps up to this length, exp(-g) is updated by a rational function.
  real(wp), parameter :: longest_step = 0.4_wp
  ! A step of the fourth order leaves an error below its fourth power.
  real(wp), parameter :: last_step = 1.0e-4_wp
  real(wp), parameter :: roundoff = 4.0_wp*epsilon(1.0_wp)
  ! From this g on, exp(-g) is below all roundoff, also in quadruple precision: friction is along the drive. Derived.
  real(wp), parameter :: far = 1000.0_wp
  ! First guesses: the value of level/s^2 from which on the guess without the logarithm is nearer, and the coefficient that joins
  ! the other guess to it. Fitted.
  real(wp), parameter :: joint = 1.2_wp, bend = 0.6_wp
  ! Up to here the first term that the series of the position 'printed' omits is roundoff in double precision. Derived.
  real(wp), parameter :: small_tau = 0.1_wp

contains

  !> Exact creep at tau >= 0 for 0 < phi < pi/2 and 0 <= kappa < 1; for phi = 0 only before slip, tau < 1 (the caller checks the
  !> ranges).
  elemental function creep_exact(phi, kappa, tau) result(creep)
    real(wp), intent(in) :: phi, kappa, tau
    type(creep_t) :: creep

    creep = creep_at(new_creep_path(phi, kappa), tau)
  end function creep_exact

  !> The constants of creep for phi [rad] in [0, pi/2) and kappa in [0, 1).
  elemental function new_creep_path(phi, kappa) result(path)
    real(wp), intent(in) :: phi, kappa
    type(creep_path_t) :: path

    path%phi = phi
    path%kappa = kappa
    path%s = sin(phi)
    path%c = cos(phi)
    path%cos_2 = (path%c - path%s)*(path%c + path%s)
    path%beta_sine = path%s
    path%beta_cosine = path%c
    path%psi_1 = 0.5_wp*pi - phi
    path%tail = phi_minus_sine(phi)
    path%weight = (1.0_wp - kappa)*path%s**2 + kappa
    path%turn = early
    if (kappa > 0.0_wp) call delay(path)
    path%q_1 = path%beta_cosine/(1.0_wp + path%beta_sine)
    if (path%s > 0.0_wp) path%log_ratio = log(path%q_1) - log(0.5_wp*path%s)
  end function new_creep_path

  !> The stick before creep, which exists for a finite k_y. With r = sqrt(kappa^2 c^2 + s^2), all quantities are ratios to r, and
  !> 1 - tau_1 and r - s are written as ratios, too: late in the motion the digits of tau that count are those of kappa or s^2.
  elemental subroutine delay(path)
    type(creep_path_t), intent(inout) :: path
    real(wp) :: r, excess

    associate (s => path%s, c => path%c, kappa => path%kappa)
      r = hypot(kappa*c, s)
      path%tau_1 = kappa/r
      path%alpha_1 = atan2(kappa*c, s)
      path%sine_1 = kappa*c/r
      path%cosine_1 = s/r
      path%beta_sine = kappa*c*(c/r) + s*(s/r)
      path%beta_cosine = (1.0_wp - kappa)*c*(s/r)
      path%psi_1 = atan2(path%beta_cosine, path%beta_sine)
      if (path%tau_1 < 0.5_wp) then
        path%head = -path%tau_1
      else
        path%anchor = 1.0_wp
        path%head = (1.0_wp - kappa)*(1.0_wp + kappa)*(s/r)*(s/(r + kappa))
      end if
      excess = kappa*c*(kappa*c/(r + s))  ! r - s
      path%tail = path%tail + (kappa - excess)
      ! 1 - sin(alpha_1 - phi), the difference between tau - tau_1 and the distance
      path%turn = early*min(1.0_wp, 1.0_wp - (kappa*c*(c/r) - s*(s/r)))
    end associate
  end subroutine delay

  !> phi - sin(phi), also where phi is small.
  elemental real(wp) function phi_minus_sine(phi)
    real(wp), intent(in) :: phi
    real(wp) :: x

    if (phi > 0.5_wp) then
      phi_minus_sine = phi - sin(phi)
    else
      x = phi**2
      phi_minus_sine = phi*x/6.0_wp*(1.0_wp - x/20.0_wp*(1.0_wp - x/42.0_wp*(1.0_wp - x/72.0_wp*(1.0_wp - x/110.0_wp))))
    end if
  end function phi_minus_sine

  !> Creep at tau >= 0.
  elemental function creep_at(path, tau) result(creep)
    type(creep_path_t), intent(in) :: path
    real(wp), intent(in) :: tau
    type(creep_t) :: creep
    type(point_t) :: point
    real(wp) :: elapsed, distance, denominator, half

    elapsed = (tau - path%anchor) + path%head
    if (elapsed < 0.0_wp) then
      creep = creep_t(alpha=path%alpha_1, psi=path%psi_1, deficit=1.0_wp)
      return
    end if
    ! tau - tau_1 - (1 - kappa) [1 - sin(alpha_1 - phi)] = tau - 1 - s + kappa - (r - s), without rounding s
    distance = ((tau - 1.0_wp) - path%phi) + path%tail
    if (distance > far*path%weight) then
      ! exp(-g) is negligible: friction is along the drive.
      creep = creep_t(alpha=0.5_wp*pi - path%phi, speed=1.0_wp, x_rate=1.0_wp, &
        position=elapsed - path%c*(path%c - path%sine_1) - path%kappa*path%s*(path%s - path%cosine_1))
      return
    end if
    point = point_at(path, elapsed, distance)
    associate (s => path%s, c => path%c, kappa => path%kappa, sine => point%sin_alpha, cosine => point%cos_alpha, &
        t => point%tangent)
      ! One arctangent: of the smaller of the two parts of psi_1 = psi + (alpha - alpha_1).
      half = 2.0_wp*atan(min(t, point%q))
      if (t < point%q) then
        creep%alpha = path%alpha_1 + half
        creep%psi = path%psi_1 - half
      else
        creep%psi = half
        creep%alpha = (0.5_wp*pi - path%phi) - half
      end if
      denominator = 1.0_wp/(cosine**2 + kappa*sine**2)
      creep%speed = (cosine*s + kappa*sine*c)*denominator
      creep%x_rate = creep%speed*point%cos_psi
      creep%y_rate = creep%speed*point%sin_psi
      creep%deficit = point%sin_psi*(cosine*c - kappa*sine*s)*denominator
      ! X/l_x = (tau - tau_1) - c (sin alpha - sin alpha_1) - kappa s (cos alpha - cos alpha_1), with the solution inserted, so that
      ! nothing cancels for small phi.
      creep%position = s*point%turn_sine*(path%sine_1 + path%cosine_1*t) + (1.0_wp - kappa)*s**2*point%g &
        + kappa*(point%g - c*point%turn_sine*(path%cosine_1 - path%sine_1*t))
    end associate
  end function creep_at

  !> Solve for the path g at tau - tau_1 = elapsed, which is `distance` after the end of the turning of friction.
  pure function point_at(path, elapsed, distance) result(point)
    type(creep_path_t), intent(in) :: path
    real(wp), intent(in) :: elapsed, distance
    type(point_t) :: point
    real(wp) :: residual, step, second, third, correction, one_minus_kappa
    real(wp) :: share, inverse, sin_psi, cos_psi, sin_alpha, cos_alpha, above, below
    integer :: iteration

    one_minus_kappa = 1.0_wp - path%kappa
    call start(path, elapsed, distance, point)
    associate (s => path%s, c => path%c, q => point%q)
      do iteration = 1, max_iterations
        q = path%q_1*point%decay
        ! Everything is multiplied by 1 + q^2 at first, so that the two divisions need not wait for each other.
        cos_psi = (1.0_wp - q)*(1.0_wp + q)
        sin_psi = 2.0_wp*q
        cos_alpha = s*cos_psi + c*sin_psi
        sin_alpha = c*cos_psi - s*sin_psi
        inverse = (1.0_wp + q**2)**2/(cos_alpha**2 + path%kappa*sin_alpha**2)
        share = 1.0_wp/(1.0_wp + q**2)
        cos_psi = cos_psi*share
        sin_psi = sin_psi*share
        cos_alpha = cos_alpha*share
        sin_alpha = sin_alpha*share
        if (elapsed < path%turn) then
          ! sin(alpha - phi) - sin(alpha_1 - phi) = 2 sin(half) cos(alpha_1 - phi + half), tan(half) = above/below
          above = point%turned*path%beta_cosine
          below = 1.0_wp + point%decay + point%turned*path%beta_sine
          residual = elapsed - path%weight*point%g - one_minus_kappa*2.0_wp*above*(below*(path%cosine_1*c + path%sine_1*s) &
            - above*(path%sine_1*c - path%cosine_1*s))/(below**2 + above**2)
        else
          ! 1 - sin(alpha - phi) = 2 sin^2(phi + psi/2)
          residual = (distance - path%weight*point%g) + share*(one_minus_kappa*2.0_wp*(s + c*q)**2)
        end if
        step = residual*inverse
        if (abs(step) > longest_step) then
          if (abs(step) <= roundoff*point%g) exit
          ! Newton's step ends to the left of the solution, wherever it starts.
          call set_path(max(point%g + step, elapsed), point)
          cycle
        end if
        share = one_minus_kappa*sin_psi*inverse
        second = -share*sin_alpha*cos_alpha
        third = share*((sin_alpha**2 - cos_alpha**2)*sin_psi + sin_alpha*cos_alpha*cos_psi)*(1.0_wp/3.0_wp)
        correction = step - step**2*(second - step*(2.0_wp*second**2 - third))
        call move(correction, point)
        if (abs(correction) <= max(last_step*min(1.0_wp, point%g), roundoff*point%g)) exit
      end do
    end associate
    call complete(path, point)
  end function point_at

  !> A first guess of g: its series where tau is small or phi large; otherwise the root of the equation below without its logarithm;
  !> and after that the exponential decay towards psi = 0. With a = 2 tan(psi/2)/s and kappa = 0
  !>
  !>     ln a + [2 c a + cos(2 phi) a^2/2]/(1 + s^2 a^2/4) = ln(2 q_1/s) - 2 - (tau - 1 - s)/s^2 = w.
  pure subroutine start(path, elapsed, distance, point)
    type(creep_path_t), intent(in) :: path
    real(wp), intent(in) :: elapsed, distance
    type(point_t), intent(inout) :: point
    real(wp) :: s2, level, root, x, half, ratio

    if (elapsed < early .or. path%s > wide .or. path%kappa > 0.0_wp) then
      x = (1.0_wp - path%kappa)*(path%beta_cosine*elapsed)**2
      call set_path(elapsed*(1.0_wp + x*(1.0_wp/3.0_wp - path%beta_sine*elapsed/4.0_wp &
        + (12.0_wp*path%beta_cosine**2 + 7.0_wp*path%beta_sine**2)*elapsed**2/60.0_wp)), point)
      return
    end if
    s2 = path%s**2
    level = s2*(path%log_ratio - 2.0_wp) - distance
    if (level > joint*s2) then
      half = 2.0_wp*path%s*path%c
      root = sqrt(max(0.0_wp, half**2 + (2.0_wp*path%cos_2 - level)*level))
      point%decay = min(level/((half + root)*path%q_1), 1.0_wp)
      point%g = -log(point%decay)
    else
      x = distance/s2
      ratio = exp((path%log_ratio - 2.0_wp) - x)
      root = 1.0_wp + 2.0_wp*path%c*ratio/sqrt(1.0_wp + bend*ratio)
      point%g = x + 2.0_wp + log(root)
      ! exp(-g), with exp(log_ratio) = 2 q_1/s
      point%decay = 0.5_wp*path%s*ratio/(root*path%q_1)
    end if
    point%turned = 1.0_wp - point%decay
    ! The solution is beyond `elapsed`, since tau' < 1.
    if (point%g < elapsed) call set_path(elapsed, point)
  end subroutine start

  !> Set g and its exponentials.
  pure subroutine set_path(g, point)
    real(wp), intent(in) :: g
    type(point_t), intent(inout) :: point

    point%g = g
    if (g < longest_step) then
      point%turned = rise(g)
      point%decay = 1.0_wp - point%turned
    else
      point%decay = exp(-g)
      point%turned = 1.0_wp - point%decay
    end if
  end subroutine set_path

  !> Add to g, at most about longest_step, and update its exponentials.
  pure subroutine move(x, point)
    real(wp), intent(in) :: x
    type(point_t), intent(inout) :: point
    real(wp) :: fall

    if (abs(x) <= last_step) then
      fall = x*(1.0_wp - x*(0.5_wp - x*(1.0_wp/6.0_wp - x/24.0_wp)))*point%decay
    else
      fall = rise(x)*point%decay
    end if
    point%g = point%g + x
    point%turned = point%turned + fall
    point%decay = point%decay - fall
  end subroutine move

  !> 1 - exp(-x) for |x| <= longest_step to full relative precision: 2 T/(1 + T), with T = tanh(x/2) as a continued fraction that is
  !> cut where its error is 3e-18.
  elemental real(wp) function rise(x)
    real(wp), intent(in) :: x
    real(wp) :: y2, above, below

    y2 = 0.25_wp*x**2
    above = 0.5_wp*x*(10395.0_wp + y2*(1260.0_wp + 21.0_wp*y2))
    below = 10395.0_wp + y2*(4725.0_wp + y2*(210.0_wp + y2))
    rise = 2.0_wp*above/(below + above)
  end function rise

  !> The angles of a point from its path.
  pure subroutine complete(path, point)
    type(creep_path_t), intent(in) :: path
    type(point_t), intent(inout) :: point
    real(wp) :: t, q, share, turn_cosine

    ! tan((alpha - alpha_1)/2) = T cos(beta_1)/(1 + T sin(beta_1)), T = tanh(g/2)
    t = point%turned*path%beta_cosine/(1.0_wp + point%decay + point%turned*path%beta_sine)
    q = path%q_1*point%decay
    share = 1.0_wp/(1.0_wp + q**2)
    point%tangent = t
    point%q = q
    point%sin_psi = 2.0_wp*q*share
    turn_cosine = 1.0_wp/(1.0_wp + t**2)
    point%turn_sine = 2.0_wp*t*turn_cosine
    turn_cosine = (1.0_wp - t**2)*turn_cosine
    point%sin_alpha = path%sine_1*turn_cosine + path%cosine_1*point%turn_sine
    ! cos(alpha) = sin(phi + psi), cos(psi) = sin(alpha + phi)
    point%cos_alpha = path%s*(1.0_wp - q)*(1.0_wp + q)*share + path%c*point%sin_psi
    point%cos_psi = path%c*point%sin_alpha + path%s*point%cos_alpha
  end subroutine complete

  !> X'/V and X/l_x, its integral over tau, for 0 <= tau < 1; the rest of the state is 0. By `form`:
  !> 'first_power': Eq. (8) with the first power that Eqs. (6) and (7) give, X'/V = phi (phi + tau/sqrt(1 - tau^2));
  !> 'printed': Eq. (8) as printed in the preprint, with tau^2 in the numerator;
  !> 'third_order': the expansion of the exact creep through phi^2, with an error of order phi^3.
  elemental function creep_asymptotic(form, phi, tau) result(creep)
    character(*), intent(in) :: form
    real(wp), intent(in) :: phi, tau
    type(creep_t) :: creep
    real(wp) :: q, root, fall, half

    q = (1.0_wp - tau)*(1.0_wp + tau)
    root = sqrt(q)
    ! 1 - sqrt(1 - tau^2), also where tau is small.
    fall = tau**2/(1.0_wp + root)
    select case (form)
    case ('first_power')
      creep%x_rate = phi*(phi + tau/root)
      creep%position = phi*(phi*tau + fall)
    case ('printed')
      if (tau < small_tau) then
        ! (asin tau - tau sqrt(1 - tau^2))/2, which cancels for small tau.
        half = tau**3*(1.0_wp/3.0_wp + tau**2*(1.0_wp/10.0_wp + tau**2*(3.0_wp/56.0_wp + tau**2*(5.0_wp/144.0_wp &
          + tau**2*(35.0_wp/1408.0_wp + tau**2*(63.0_wp/3328.0_wp + tau**2*(77.0_wp/5120.0_wp)))))))
      else
        half = 0.5_wp*(asin(tau) - tau*root)
      end if
      creep%x_rate = phi*(phi + tau**2/root)
      creep%position = phi*(phi*tau + half)
    case default
      creep%x_rate = phi*tau/root + phi**2*(1.0_wp + 1.0_wp/q - 1.0_wp/(q*root))
      creep%position = phi*fall + phi**2*(tau + atanh(tau) - tau/root)
    end select
  end function creep_asymptotic
end module dst_creep
