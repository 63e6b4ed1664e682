!> What `dynstiction stability` prints: whether a scene stick-slips, and the linear theory of its steady sliding.
module dst_stability_report
  use dst_kinds, only: wp, pi, degree
  use dst_errors, only: error_t, raise, deck_error
  use dst_scene, only: scene_t
  use dst_settling, only: settling_t
  use dst_assembly, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_stability, only: critical_t, low_branch, fast_branch, steady_sliding_eigenvalues, critical_misalignment, &
                           low_frequency_limit, is_stable, damping_scale, overdamped_angle, damping_ratio, &
                           weakening_damping_ratio
  use dst_plain_numbers, only: long_text, number_text
  use dst_text, only: text_builder_t, integer_text
  implicit none
  private

  public :: stability_report, held_velocities

contains

  !> One table for each velocity that the drive keeps for some time.
  subroutine stability_report(scene, name, text, error)
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(text_builder_t) :: page
    type(slider_t) :: slider
    real(wp), allocatable :: velocities(:)
    integer :: i

    text = ''
    if (.not. (scene%mass > 0.0_wp .and. scene%stiffness_y > 0.0_wp)) then
      call raise(error, deck_error, 'scene.model: the linear theory of steady sliding needs a mass and both stiffnesses, '// &
                 "which model '"//scene%model//"' does not have: give a deck of model 'full'")
      return
    end if
    call held_velocities(scene, velocities, error)
    if (allocated(error)) return
    call slider_from_scene(scene, slider)
    do i = 1, size(velocities)
      call describe(page, name, scene, slider, velocities(i), error)
      if (allocated(error)) then
        error%code = deck_error
        return
      end if
    end do
    text = page%content()
  end subroutine stability_report

  !> The speeds [m/s] other than 0 that the drive of a scene keeps for some time, each once. The last one continues without end; a
  !> speed that a ramp only passes through has no steady sliding. The direction makes no difference.
  subroutine held_velocities(scene, held, error)
    type(scene_t), intent(in) :: scene
    real(wp), allocatable, intent(out) :: held(:)
    type(error_t), allocatable, intent(out) :: error
    logical :: holds
    integer :: i

    allocate (held(0))
    associate (time => scene%drive_time, velocity => scene%drive_velocity)
      do i = 1, size(velocity)
        holds = i == size(velocity)
        if (.not. holds) holds = time(i + 1) > time(i) .and. .not. abs(velocity(i + 1) - velocity(i)) > 0.0_wp
        if (.not. (holds .and. abs(velocity(i)) > 0.0_wp)) cycle
        if (all(abs(held - abs(velocity(i))) > 0.0_wp)) held = [held, abs(velocity(i))]
      end do
    end associate
    if (size(held) == 0) call raise(error, deck_error, 'drive.velocity: the drive holds no velocity but 0, so there is nothing '// &
      'to settle to: give one value that is not 0, or a profile that holds one')
  end subroutine held_velocities

  !> One table, at one velocity [m/s].
  subroutine describe(page, name, scene, slider, velocity, error)
    type(text_builder_t), intent(inout) :: page
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(error_t), allocatable, intent(out) :: error
    complex(wp) :: eigenvalues(4)
    type(critical_t) :: critical
    real(wp) :: limit
    logical :: stable

    call page%line('# '//name//': at V = '//long_text(velocity)//' m/s, phi = '//long_text(scene%misalignment_deg)// &
      ' deg, model full')
    call is_stable(slider, velocity, stable, error)
    if (.not. allocated(error)) call steady_sliding_eigenvalues(slider, velocity, eigenvalues, error)
    if (.not. allocated(error)) call critical_misalignment(slider, velocity, critical, error)
    if (.not. allocated(error)) call low_frequency_limit(slider, velocity, limit, error)
    if (allocated(error)) return
    call put_verdicts()
    call page%line('')
    call list_eigenvalues()
    call page%line('')
    call list_critical_angles()
    call page%line('')
    call list_damping()
    call page%line('')

  contains

    !> What a motion from rest comes to, and whether steady sliding is stable, in one sentence.
    subroutine put_verdicts()
      type(error_t), allocatable :: unsettled
      type(settling_t) :: motion
      character(:), allocatable :: text

      call motion%start(scene, velocity, unsettled)
      do while (.not. (allocated(unsettled) .or. motion%is_finished))
        call motion%proceed(huge(1.0_wp), unsettled)
      end do
      if (allocated(unsettled)) then
        text = 'whether there is stick-slip is not known ('//unsettled%text//')'
      else
        text = trim(merge('stick-slip   ', 'no stick-slip', motion%stick_slips()))//' (the load swings by '// &
          number_text(motion%swing, 4)//' N'
        if (motion%limit > 0.0_wp) text = text//', '//number_text(100.0_wp*motion%swing/motion%limit, 2)//' % of mu_0 W'
        text = text//')'
      end if
      call page%line(text//'; steady sliding is '//trim(merge('stable    ', 'not stable', stable)))
    end subroutine put_verdicts

    subroutine list_eigenvalues()
      character(19) :: row(5)
      integer :: i

      call page%line('eigenvalue    real part [1/s]    imaginary [rad/s]    frequency [Hz]     damping ratio')
      do i = 1, size(eigenvalues)
        associate (growth => real(eigenvalues(i)), turning => aimag(eigenvalues(i)), size_of => abs(eigenvalues(i)))
          row = [character(19) :: '         '//integer_text(i), long_text(growth), long_text(turning), &
            long_text(abs(turning)/(2.0_wp*pi)), long_text(-growth/max(size_of, tiny(size_of)))]
        end associate
        call page%line(row(1)(:14)//row(2)//row(3)(:19)//'  '//row(4)//row(5))
      end do
    end subroutine list_eigenvalues

    subroutine list_critical_angles()
      if (critical%has(low_branch)) call page%row('critical angle, slow mode', angle_and_frequency(low_branch))
      if (critical%has(fast_branch)) call page%row('critical angle, fast mode', angle_and_frequency(fast_branch))
      if (.not. critical%exists) call page%row('critical angle', 'none between 0 and 90 deg')
      if (critical%window(2) > critical%window(1)) then
        call page%row('stable for', long_text(critical%window(1)/degree)//' deg < |phi| < '// &
          long_text(critical%window(2)/degree)//' deg')
      else
        call page%row('stable for', 'no angle')
      end if
      call page%row('critical angle, rigid stiff axis', long_text(limit/degree)//' deg, '// &
        trim(merge('atan(sqrt(-(F''(V) + c_x)/(F(V)/V + c_x)))', 'atan(sqrt(-V F''(V)/F(V)))                ', slider%is_damped())))
    end subroutine list_critical_angles

    function angle_and_frequency(branch) result(text)
      integer, intent(in) :: branch
      character(:), allocatable :: text

      text = long_text(critical%angle(branch)/degree)//' deg, at '// &
        long_text(critical%frequency(branch))//' rad/s = '// &
        long_text(critical%frequency(branch)/(2.0_wp*pi))//' Hz'
    end function angle_and_frequency

    !> The damping of the slow motion, Eq. (10); if it has no value the table says so.
    subroutine list_damping()
      type(error_t), allocatable :: none
      real(wp) :: lambda, angle, misalignment, zeta

      call page%line('Damping of the slow motion (rigid stiff axis)')
      call damping_scale(slider, velocity, lambda, none)
      if (allocated(none)) then
        call page%row('Lambda, zeta, theta*', 'no value: '//none%text)
        return
      end if
      misalignment = atan2(slider%along(2), slider%along(1))
      if (slider%damping(1) > 0.0_wp) call page%row('damping ratio of c_x', long_text(&
        0.5_wp*slider%damping(1)/(sqrt(slider%mass)*sqrt(slider%stiffness(1))))// &
        ', which adds to zeta: Lambda includes friction only')
      call page%row('Lambda', long_text(lambda))
      if (scene%contact /= 'exact') call page%row('', 'Lambda, zeta and theta* take the contact as exact')
      call page%row('zeta at theta = phi', long_text(damping_ratio(lambda, misalignment))// &
        ', friction constant at mu_0 W')
      call weakening_damping_ratio(slider, velocity, misalignment, zeta, none)
      if (.not. allocated(none)) call page%row('', long_text(zeta)//', with F(v)')
      call overdamped_angle(lambda, angle, none)
      if (allocated(none)) then
        call page%row('theta*', 'no value: '//none%text)
      else
        call page%row('theta*', long_text(angle/degree)//' deg, where zeta = 1 with friction constant at mu_0 W')
      end if
    end subroutine list_damping
  end subroutine describe
end module dst_stability_report
