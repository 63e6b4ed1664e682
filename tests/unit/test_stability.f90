!> Linear theory of steady sliding: published figures, closed forms, and the eigenvalues compared with them.
program test_stability
  use dst_kinds, only: wp, pi, degree
  use dst_errors, only: error_t
  use dst_friction, only: new_friction_law
  use dst_slider, only: slider_t
  use dst_stability, only: critical_t, low_branch, fast_branch, steady_sliding_eigenvalues, critical_misalignment, &
                           low_frequency_limit, is_stable, damping_scale, overdamped_angle, damping_ratio, &
                           weakening_damping_ratio
  use dst_stability_report, only: held_velocities
  use checks, only: check, check_close, finish
  use random_numbers, only: start_random, uniform, log_uniform
  use scenes, only: fig3_slider
  implicit none

  call test_figure_3()
  call test_windows()
  call test_existence()
  call test_velocities()
  call test_damping()
  call test_weakening_damping()
  call test_special_friction()
  call test_symmetries()
  call test_random_sliders()
  call test_extremes()
  call test_refusals()
  call test_held_velocities()
  call finish()

contains

  !> Fig. 3's slider, with a ratio of the stiffnesses and a misalignment [deg].
  function slider_of(stiffness_ratio, misalignment_deg, mu_inf) result(slider)
    real(wp), intent(in) :: stiffness_ratio, misalignment_deg
    real(wp), intent(in), optional :: mu_inf
    type(slider_t) :: slider

    slider = fig3_slider(misalignment_deg, 1.0e3_wp*stiffness_ratio, mu_inf)
  end function slider_of

  function critical_of(slider, velocity) result(critical)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(critical_t) :: critical
    type(error_t), allocatable :: error

    call critical_misalignment(slider, velocity, critical, error)
    call check('critical angles without error', .not. allocated(error))
  end function critical_of

  real(wp) function limit_of(slider, velocity) result(limit)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(error_t), allocatable :: error

    call low_frequency_limit(slider, velocity, limit, error)
    call check('limit without error', .not. allocated(error))
  end function limit_of

  logical function stable(slider, velocity) result(holds)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(error_t), allocatable :: error

    call is_stable(slider, velocity, holds, error)
    call check('stability without error', .not. allocated(error))
  end function stable

  !> The eigenvalues at another misalignment [rad].
  function eigenvalues_at(slider, velocity, angle) result(eigenvalues)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, angle
    complex(wp) :: eigenvalues(4)
    type(slider_t) :: turned
    type(error_t), allocatable :: error

    turned = slider
    turned%along = [cos(angle), sin(angle)]
    call steady_sliding_eigenvalues(turned, velocity, eigenvalues, error)
    call check('eigenvalues without error', .not. allocated(error))
  end function eigenvalues_at

  !> More of Fig. 3: tests/python/test_stability.py.
  subroutine test_figure_3()
    type(critical_t) :: critical
    complex(wp) :: eigenvalues(4)

    critical = critical_of(slider_of(1.0e10_wp, 1.0_wp), 1.0e-3_wp)
    call check_close('a stiffer axis comes nearer to the limit', critical%angle(low_branch), &
                     limit_of(slider_of(1.0e10_wp, 1.0_wp), 1.0e-3_wp), 2.0e-11_wp)
    eigenvalues = eigenvalues_at(slider_of(1.0e4_wp, 1.0_wp), 1.0e-3_wp, 8.65603_wp*degree)
    call check('a pair, the positive imaginary part first', aimag(eigenvalues(1)) > 64.0_wp &
               .and. abs(eigenvalues(2) - conjg(eigenvalues(1))) <= 0.0_wp)
  end subroutine test_figure_3

  !> Expected: the sign changes of the largest real part of eigenvalues computed with 40 digits, bisected (mpmath).
  subroutine test_windows()
    real(wp), parameter :: ratio(4) = [4.0e2_wp, 5.0e2_wp, 1.0e3_wp, 1.0e4_wp]
    real(wp), parameter :: first(4) = [12.419841572245611_wp, 9.5223349074520279_wp, 8.7555808253331495_wp, 8.6560331384295429_wp]
    real(wp), parameter :: last(4) = [19.216159069102179_wp, 33.000471027848673_wp, 53.080636878362375_wp, 76.263436095299451_wp]
    type(critical_t) :: critical
    integer :: i

    do i = 1, size(ratio)
      critical = critical_of(slider_of(ratio(i), 1.0_wp), 1.0e-3_wp)
      call check_close('window begins', critical%window(1)/degree/first(i), 1.0_wp, 1.0e-13_wp)
      call check_close('window ends', critical%window(2)/degree/last(i), 1.0_wp, 1.0e-13_wp)
    end do
  end subroutine test_windows

  !> |F'| F/V = 353.3 m k_x. A sum of the stiffnesses above that is necessary for a window but not sufficient: the condition is
  !> (sqrt(k_y) - sqrt(k_x))^2 > 353.3 k_x, that is k_y/k_x > 391.9. The eigenvalues decide.
  subroutine test_existence()
    type(critical_t) :: critical
    real(wp) :: edge

    edge = (1.0_wp + sqrt(fast_mode_bound()))**2
    call check_close('|F''| F/(V m k_x)', fast_mode_bound(), 353.0_wp, 0.5_wp)
    call check_close('least stiffness ratio', edge, 391.9_wp, 0.05_wp)
    critical = critical_of(slider_of(edge*1.0001_wp, 1.0_wp), 1.0e-3_wp)
    call check('just above it there is a window', critical%exists .and. critical%window(2) > critical%window(1))
    call check('the eigenvalues agree', sign_changes(slider_of(edge*1.0001_wp, 1.0_wp), 1.0e-3_wp, 9000) == 2)
    critical = critical_of(slider_of(edge*0.9999_wp, 1.0_wp), 1.0e-3_wp)
    call check('just below it there is none', .not. critical%exists)
    call check('the eigenvalues agree on that', sign_changes(slider_of(edge*0.9999_wp, 1.0_wp), 1.0e-3_wp, 9000) == 0)
    call check('nor at 353', sign_changes(slider_of(353.5_wp, 1.0_wp), 1.0e-3_wp, 9000) == 0)
  end subroutine test_existence

  real(wp) function fast_mode_bound()
    type(slider_t) :: slider
    real(wp) :: force(1), slope(1)

    slider = slider_of(1.0_wp, 1.0_wp)
    call slider%law%evaluate(1, [1.0e-3_wp], force, slope)
    fast_mode_bound = abs(slope(1))*force(1)/1.0e-3_wp/(slider%mass*slider%stiffness(1))
  end function fast_mode_bound

  !> How often the largest real part changes its sign on a grid over (0, pi/2).
  integer function sign_changes(slider, velocity, points)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    integer, intent(in) :: points
    complex(wp) :: eigenvalues(4)
    logical :: below(points)
    integer :: i

    do i = 1, points
      eigenvalues = eigenvalues_at(slider, velocity, (real(i, wp) - 0.5_wp)/real(points, wp)*0.5_wp*pi)
      below(i) = real(eigenvalues(1)) < 0.0_wp
    end do
    sign_changes = count(below(2:) .neqv. below(:points - 1))
  end function sign_changes

  subroutine test_velocities()
    real(wp), parameter :: velocity(8) = [0.1_wp, 0.3_wp, 1.0_wp, 3.0_wp, 10.0_wp, 30.0_wp, 50.0_wp, 100.0_wp]
    real(wp), parameter :: expected(8) = [2.889_wp, 4.899_wp, 8.656_wp, 13.698_wp, 18.289_wp, 12.479_wp, 6.042_wp, 0.705_wp]
    type(critical_t) :: critical
    integer :: i

    do i = 1, 8
      critical = critical_of(slider_of(1.0e4_wp, 1.0_wp), velocity(i)*1.0e-3_wp)
      call check_close('phi_c(V)', critical%angle(low_branch)/degree, expected(i), 5.0e-4_wp)
    end do
  end subroutine test_velocities

  subroutine test_damping()
    type(error_t), allocatable :: error
    real(wp) :: lambda, angle

    call damping_scale(slider_of(1.0e4_wp, 1.0_wp), 1.0e-3_wp, lambda, error)
    call check_close('Lambda at 1 deg', lambda, 3623.9_wp, 0.05_wp)
    call check_close('zeta at theta = phi = 1 deg', damping_ratio(lambda, degree), 0.01926_wp, 5.0e-6_wp)
    call overdamped_angle(lambda, angle, error)
    call check_close('theta*', angle/degree, 3.733_wp, 5.0e-4_wp)
    call check_close('zeta(theta*) = 1', damping_ratio(lambda, angle), 1.0_wp, 1.0e-14_wp)
    call damping_scale(slider_of(1.0e4_wp, 10.0_wp), 1.0e-3_wp, lambda, error)
    call check_close('Lambda at 10 deg', lambda, 364.2_wp, 0.05_wp)
    call overdamped_angle(1.0_wp, angle, error)
    call check_close('theta* of Lambda = 1', angle, 0.5_wp*pi, 1.0e-15_wp)
  end subroutine test_damping

  subroutine test_weakening_damping()
    type(error_t), allocatable :: error
    complex(wp) :: eigenvalues(4)
    real(wp) :: zeta, plain
    type(slider_t) :: slider

    call check_close('zeta with weakening crosses 1', crossing(1.0_wp), 5.10_wp, 5.0e-3_wp)
    call check_close('zeta with weakening crosses 0', crossing(0.0_wp), 4.316_wp, 5.0e-4_wp)
    slider = slider_of(1.0e4_wp, 1.0_wp, mu_inf=0.2_wp)
    call weakening_damping_ratio(slider, 1.0e-3_wp, 0.3_wp, zeta, error)
    call damping_scale(slider, 1.0e-3_wp, plain, error)
    call check_close('friction that does not weaken', zeta/damping_ratio(plain, 0.3_wp), 1.0_wp, 1.0e-14_wp)
    call weakening_damping_ratio(slider, 1.0e-3_wp, 0.0_wp, zeta, error)
    call check_close('theta = 0', zeta, 0.0_wp, 0.0_wp)
    ! At theta = phi the slow motion is steady sliding with a rigid stiff axis.
    slider = slider_of(1.0e10_wp, 8.7_wp)
    call weakening_damping_ratio(slider, 1.0e-3_wp, 8.7_wp*degree, zeta, error)
    eigenvalues = eigenvalues_at(slider, 1.0e-3_wp, 8.7_wp*degree)
    call check_close('theta = phi is steady sliding', -real(eigenvalues(1))/abs(eigenvalues(1)), zeta, 1.0e-6_wp)
  end subroutine test_weakening_damping

  !> theta [deg] where zeta with weakening passes a value, for Fig. 3.
  real(wp) function crossing(value)
    real(wp), intent(in) :: value
    type(error_t), allocatable :: error
    real(wp) :: low, high, zeta
    integer :: i

    low = 3.0_wp
    high = 10.0_wp
    do i = 1, 60
      crossing = 0.5_wp*(low + high)
      call weakening_damping_ratio(slider_of(1.0e4_wp, 1.0_wp), 1.0e-3_wp, crossing*degree, zeta, error)
      if (zeta < value) then
        low = crossing
      else
        high = crossing
      end if
    end do
  end function crossing

  !> Constant friction is stable except along an axis, strengthening friction along one too; equal stiffnesses, no friction, and
  !> weakening with |F'| > F/V, where the sum of the eigenvalues is positive, are not. None of them has a critical angle.
  subroutine test_special_friction()
    logical, parameter :: is_stable(7) = [.true., .false., .false., .true., .false., .false., .false.]
    type(slider_t) :: slider(7)
    type(critical_t) :: critical
    real(wp) :: velocity
    integer :: i

    slider(1) = slider_of(1.0e4_wp, 1.0_wp, mu_inf=0.2_wp)
    slider(2) = slider_of(1.0e4_wp, 0.0_wp, mu_inf=0.2_wp)
    slider(3) = slider_of(1.0e4_wp, 90.0_wp, mu_inf=0.2_wp)
    slider(4) = slider_of(1.0e4_wp, 0.0_wp, mu_inf=0.3_wp)
    slider(5) = slider_of(1.0_wp, 20.0_wp)
    slider(6) = slider_of(1.0e4_wp, 20.0_wp)
    call new_friction_law('weakening', 0.5_wp, 0.0_wp, 1.0e-3_wp, 10.0_wp, slider(6)%law)
    slider(7) = slider_of(1.0e4_wp, 20.0_wp)
    call new_friction_law('constant', 0.0_wp, 0.0_wp, 1.0_wp, 10.0_wp, slider(7)%law)
    do i = 1, 7
      velocity = merge(2.0e-3_wp, 1.0e-3_wp, i == 6)
      call check('special friction: whether it is stable', stable(slider(i), velocity) .eqv. is_stable(i))
      if (i == 7) cycle
      critical = critical_of(slider(i), velocity)
      call check('special friction: no critical angle', .not. critical%exists)
      if (i > 3) cycle
      call check_close('constant friction: stable from 0', critical%window(1), 0.0_wp, 0.0_wp)
      call check_close('constant friction: to 90 deg', critical%window(2), 0.5_wp*pi, 0.0_wp)
      call check_close('constant friction: limit', limit_of(slider(i), velocity), 0.0_wp, 0.0_wp)
    end do
    call check('steep weakening: the eigenvalues agree', sign_changes(slider(6), 2.0e-3_wp, 900) == 0)
  end subroutine test_special_friction

  subroutine test_symmetries()
    type(critical_t) :: critical, swapped
    type(slider_t) :: slider
    complex(wp) :: here(4), there(4)

    slider = slider_of(1.0e3_wp, 1.0_wp)
    critical = critical_of(slider, 1.0e-3_wp)
    slider%stiffness = slider%stiffness([2, 1])
    swapped = critical_of(slider, 1.0e-3_wp)
    call check_close('x and y exchanged: slow', swapped%angle(low_branch), 0.5_wp*pi - critical%angle(low_branch), 1.0e-15_wp)
    call check_close('x and y exchanged: fast', swapped%angle(fast_branch), 0.5_wp*pi - critical%angle(fast_branch), 1.0e-15_wp)
    call check('the window stays in order', swapped%window(1) < swapped%window(2))
    slider = slider_of(1.0e4_wp, 1.0_wp)
    critical = critical_of(slider, 1.0e-3_wp)
    swapped = critical_of(slider, -1.0e-3_wp)
    call check_close('V to -V', swapped%angle(low_branch), critical%angle(low_branch), 0.0_wp)
    call check('phi to -phi', stable(slider_of(1.0e4_wp, -10.0_wp), 1.0e-3_wp))
    call check('phi to pi - phi', stable(slider_of(1.0e4_wp, 170.0_wp), 1.0e-3_wp))
    here = eigenvalues_at(slider, 1.0e-3_wp, 0.4_wp)
    there = eigenvalues_at(slider, 1.0e-3_wp, -0.4_wp)
    call check_close('eigenvalues for phi to -phi', maxval(abs(here - there)), 0.0_wp, 1.0e-11_wp)
    ! A large smoothing velocity changes the friction to F v/v_s: the trace is -(2 F + V F')/v_s.
    slider%smoothing = 1.0e2_wp**2
    here = eigenvalues_at(slider, 1.0e-3_wp, 0.4_wp)
    call check_close('smoothed contact: trace', real(sum(here))*slider%mass, -0.03859595547_wp, 1.0e-10_wp)
  end subroutine test_symmetries

  !> For any parameters: as many critical angles as a scan of the eigenvalues finds, the pair on the imaginary axis there, and one
  !> verdict.
  subroutine test_random_sliders()
    type(slider_t) :: slider
    type(critical_t) :: critical
    complex(wp) :: eigenvalues(4)
    real(wp) :: velocity, largest, angle
    integer :: i, branch, found, agreed, narrow, verdicts

    call start_random(20)
    found = 0
    agreed = 0
    narrow = 0
    verdicts = 0
    do i = 1, 300
      slider%mass = log_uniform(1.0e-3_wp, 1.0e2_wp)
      slider%stiffness = [log_uniform(1.0e1_wp, 1.0e4_wp), log_uniform(1.0e1_wp, 1.0e8_wp)]
      velocity = log_uniform(1.0e-4_wp, 1.0_wp)
      angle = sum(uniform(1, 0.05_wp, 1.5_wp))
      slider%along = [cos(angle), sin(angle)]
      call new_friction_law('weakening', sum(uniform(1, 0.1_wp, 1.0_wp)), sum(uniform(1, 0.0_wp, 0.6_wp)), &
        log_uniform(1.0e-4_wp, 1.0_wp), log_uniform(1.0e-1_wp, 1.0e2_wp), slider%law)
      critical = critical_of(slider, velocity)
      eigenvalues = eigenvalues_at(slider, velocity, angle)
      if ((real(eigenvalues(1)) < 0.0_wp .eqv. stable(slider, velocity)) .or. &
        abs(real(eigenvalues(1))) < 1.0e-13_wp*maxval(abs(eigenvalues))) verdicts = verdicts + 1
      if (critical%exists) then
        found = found + 1
        do branch = low_branch, fast_branch
          eigenvalues = eigenvalues_at(slider, velocity, critical%angle(branch))
          largest = maxval(abs(eigenvalues))
          call check_close('the real part vanishes', real(eigenvalues(1))/largest, 0.0_wp, 1.0e-13_wp)
          call check_close('at the frequency', aimag(eigenvalues(1))/largest, critical%frequency(branch)/largest, 1.0e-13_wp)
        end do
        ! A grid shows both only if they are farther from each other and from the ends than its spacing.
        if (minval([critical%window(1), critical%window(2) - critical%window(1), 0.5_wp*pi - critical%window(2)]) < 0.005_wp) then
          narrow = narrow + 1
          cycle
        end if
      end if
      if (sign_changes(slider, velocity, 400) == merge(2, 0, critical%exists)) agreed = agreed + 1
    end do
    call check('many of them have critical angles', found > 50)
    call check_close('the scan agrees', real(agreed + narrow, wp), 300.0_wp, 0.0_wp)
    call check_close('the verdict is that of the eigenvalues', real(verdicts, wp), 300.0_wp, 0.0_wp)
  end subroutine test_random_sliders

  !> Scales far apart, and units: powers of two change no bit.
  subroutine test_extremes()
    type(slider_t) :: slider
    type(critical_t) :: critical, scaled

    slider = slider_of(1.0e16_wp, 1.0_wp)
    critical = critical_of(slider, 1.0e-9_wp)
    call check_close('creep: the limit', critical%angle(low_branch)/limit_of(slider, 1.0e-9_wp), 1.0_wp, 1.0e-6_wp)
    slider = slider_of(1.0e4_wp, 1.0_wp)
    critical = critical_of(slider, 1.0e-3_wp)
    slider%mass = 0.25_wp*2.0_wp**4
    slider%stiffness = slider%stiffness*2.0_wp**4
    call new_friction_law('weakening', 0.2_wp, 0.15_wp, 0.01_wp, 160.0_wp, slider%law)
    scaled = critical_of(slider, 1.0e-3_wp)
    call check_close('unit of mass', maxval(abs(scaled%angle - critical%angle)), 0.0_wp, 0.0_wp)
    call check_close('unit of mass: frequency', maxval(abs(scaled%frequency - critical%frequency)), 0.0_wp, 0.0_wp)
  end subroutine test_extremes

  !> What has no answer is refused with its reason, in all procedures.
  subroutine test_refusals()
    type(slider_t) :: slider
    type(critical_t) :: critical
    type(error_t), allocatable :: error
    complex(wp) :: eigenvalues(4)
    real(wp) :: value
    logical :: holds

    slider = slider_of(1.0e4_wp, 1.0_wp)
    call steady_sliding_eigenvalues(slider, 0.0_wp, eigenvalues, error)
    call refused(error, 'finite and not 0')
    call critical_misalignment(slider, 0.0_wp, critical, error)
    call refused(error, 'finite and not 0')
    call low_frequency_limit(slider, 0.0_wp, value, error)
    call refused(error, 'finite and not 0')
    call is_stable(slider, 0.0_wp, holds, error)
    call refused(error, 'finite and not 0')
    call damping_scale(slider, 0.0_wp, value, error)
    call refused(error, 'V sin(phi)')
    call damping_scale(slider_of(1.0e4_wp, 0.0_wp), 1.0e-3_wp, value, error)
    call refused(error, 'V sin(phi)')
    call weakening_damping_ratio(slider_of(1.0e4_wp, 180.0_wp), 1.0e-3_wp, 0.1_wp, value, error)
    call refused(error, 'V sin(phi)')
    call overdamped_angle(0.9_wp, value, error)
    call refused(error, 'Lambda >= 1')
    call steady_sliding_eigenvalues(slider, 1.0e300_wp, eigenvalues, error)
    call check('a large V is taken', .not. allocated(error))
    slider%mass = 0.0_wp
    call steady_sliding_eigenvalues(slider, 1.0e-3_wp, eigenvalues, error)
    call refused(error, 'mass = 0 kg')
    call critical_misalignment(slider_of(-1.0_wp, 1.0_wp), 1.0e-3_wp, critical, error)
    call refused(error, 'stiffness_y = -1000 N/m')
    slider = slider_of(1.0e4_wp, 1.0_wp)
    slider%law%static_limit = -1.0_wp
    call critical_misalignment(slider, 1.0e-3_wp, critical, error)
    call refused(error, 'mu_0')
  end subroutine test_refusals

  subroutine refused(error, reason)
    type(error_t), allocatable, intent(in) :: error
    character(*), intent(in) :: reason

    call check('refused: '//reason, allocated(error))
    if (allocated(error)) call check(reason//' in '//error%text, index(error%text, reason) > 0)
  end subroutine refused

  subroutine test_held_velocities()
    call held('constant', [0.0_wp], [1.0_wp], [1.0_wp])
    call held('at rest', [0.0_wp], [0.0_wp], [real(wp) ::])
    call held('a ramp', [0.0_wp, 1.0_wp], [1.0_wp, 2.0_wp], [2.0_wp])
    call held('a hold, a jump, a reversal', [0.0_wp, 1.0_wp, 1.0_wp, 2.0_wp, 2.0_wp], [3.0_wp, 3.0_wp, 5.0_wp, 5.0_wp, -3.0_wp], &
              [3.0_wp, 5.0_wp])
    call held('a jump is no hold', [0.0_wp, 1.0_wp, 1.0_wp], [0.0_wp, 1.0_wp, 1.0_wp], [1.0_wp])
    call held('passed through', [0.0_wp, 1.0_wp, 2.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], [real(wp) ::])
  end subroutine test_held_velocities

  subroutine held(name, time, velocity, expected)
    character(*), intent(in) :: name
    real(wp), intent(in) :: time(:), velocity(:), expected(:)
    real(wp), allocatable :: found(:)

    allocate (found, source=held_velocities(time, velocity))
    call check('held velocities, '//name//': how many', size(found) == size(expected))
    if (size(found) == size(expected)) call check('held velocities, '//name, all(abs(found - expected) <= 0.0_wp))
  end subroutine held
end program test_stability
