!> What `dynstiction stability` prints: the linear theory of steady sliding for one scene.
module dst_stability_report
  use dst_kinds, only: wp, pi, degree
  use dst_errors, only: error_t, raise, deck_error
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_stability, only: critical_t, low_branch, fast_branch, steady_sliding_eigenvalues, critical_misalignment, &
                           low_frequency_limit, is_stable, damping_scale, overdamped_angle, damping_ratio, &
                           weakening_damping_ratio
  use dst_text, only: text_builder_t, formatted
  implicit none
  private

  public :: stability_report, held_velocities

contains

  !> One table for each velocity that the drive holds.
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
    allocate (velocities, source=held_velocities(scene%drive_time, scene%drive_velocity))
    if (size(velocities) == 0) then
      call raise(error, deck_error, 'drive.velocity: the drive holds no velocity but 0, so there is no steady sliding: '// &
                 'give one value that is not 0, or a profile that holds one')
      return
    end if
    call slider_from_scene(scene, slider)
    do i = 1, size(velocities)
      call describe(page, name, slider, velocities(i), scene%misalignment_deg, scene%contact, error)
      if (allocated(error)) then
        error%code = deck_error
        return
      end if
    end do
    text = page%content()
  end subroutine stability_report

  !> The speeds [m/s] other than 0 that a profile (times [s], velocities there) keeps for some time, each once.
  !> The last one holds for ever; one that a ramp only passes through has no steady sliding. The direction makes
  !> no difference.
  pure function held_velocities(time, velocity) result(held)
    real(wp), intent(in) :: time(:), velocity(:)
    real(wp), allocatable :: held(:)
    logical :: holds
    integer :: i

    allocate (held(0))
    do i = 1, size(velocity)
      holds = i == size(velocity)
      if (.not. holds) holds = time(i + 1) > time(i) .and. .not. abs(velocity(i + 1) - velocity(i)) > 0.0_wp
      if (.not. (holds .and. abs(velocity(i)) > 0.0_wp)) cycle
      if (all(abs(held - abs(velocity(i))) > 0.0_wp)) held = [held, abs(velocity(i))]
    end do
  end function held_velocities

  subroutine describe(page, name, slider, velocity, misalignment_deg, contact, error)
    type(text_builder_t), intent(inout) :: page
    character(*), intent(in) :: name, contact
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, misalignment_deg
    type(error_t), allocatable, intent(out) :: error
    logical :: stable

    call page%line('# '//name//': steady sliding at V = '//formatted('(es13.6)', velocity)//' m/s, phi = '// &
                   formatted('(f11.6)', misalignment_deg)//' deg')
    call list_eigenvalues(page, slider, velocity, error)
    if (.not. allocated(error)) call is_stable(slider, velocity, stable, error)
    if (allocated(error)) return
    call put_row(page, 'steady sliding is', trim(merge('stable    ', 'not stable', stable)))
    call page%line('')
    call list_critical_angles(page, slider, velocity, error)
    if (allocated(error)) return
    call page%line('')
    call list_damping(page, slider, velocity, contact)
    call page%line('')
  end subroutine describe

  subroutine list_eigenvalues(page, slider, velocity, error)
    type(text_builder_t), intent(inout) :: page
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(error_t), allocatable, intent(out) :: error
    complex(wp) :: eigenvalues(4)
    real(wp) :: size_
    character(100) :: row
    integer :: i

    call steady_sliding_eigenvalues(slider, velocity, eigenvalues, error)
    if (allocated(error)) return
    call page%line('eigenvalue    real part [1/s]    imaginary [rad/s]     frequency [Hz]    damping ratio')
    do i = 1, 4
      size_ = abs(eigenvalues(i))
      write (row, '(i10, es19.9, es21.9, es19.9, es17.6)') i, real(eigenvalues(i)), aimag(eigenvalues(i)), &
        abs(aimag(eigenvalues(i)))/(2.0_wp*pi), -real(eigenvalues(i))/max(size_, tiny(size_))
      call page%line(row)
    end do
  end subroutine list_eigenvalues

  subroutine list_critical_angles(page, slider, velocity, error)
    type(text_builder_t), intent(inout) :: page
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(error_t), allocatable, intent(out) :: error
    type(critical_t) :: critical
    real(wp) :: limit

    call critical_misalignment(slider, velocity, critical, error)
    if (.not. allocated(error)) call low_frequency_limit(slider, velocity, limit, error)
    if (allocated(error)) return
    if (critical%exists) then
      call put_row(page, 'critical angle, slow mode', angle_and_frequency(low_branch))
      call put_row(page, 'critical angle, fast mode', angle_and_frequency(fast_branch))
    else
      call put_row(page, 'critical angle', 'none between 0 and 90 deg')
    end if
    if (critical%window(2) > critical%window(1)) then
      call put_row(page, 'stable for', formatted('(f12.6)', critical%window(1)/degree)//' deg < |phi| < '// &
                 formatted('(f12.6)', critical%window(2)/degree)//' deg')
    else
      call put_row(page, 'stable for', 'no angle')
    end if
    call put_row(page, 'critical angle, rigid stiff axis', formatted('(f12.6)', limit/degree)//' deg, atan(sqrt(-V F''(V)/F(V)))')

  contains

    function angle_and_frequency(branch) result(text)
      integer, intent(in) :: branch
      character(:), allocatable :: text

      text = formatted('(f12.6)', critical%angle(branch)/degree)//' deg, at '// &
        formatted('(es14.7)', critical%frequency(branch))//' rad/s = '// &
        formatted('(es14.7)', critical%frequency(branch)/(2.0_wp*pi))//' Hz'
    end function angle_and_frequency
  end subroutine list_critical_angles

  !> The damping of the slow motion, Eq. (10); where it has no value the table says so.
  subroutine list_damping(page, slider, velocity, contact)
    type(text_builder_t), intent(inout) :: page
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    character(*), intent(in) :: contact
    type(error_t), allocatable :: error
    real(wp) :: lambda, angle, misalignment, zeta

    call damping_scale(slider, velocity, lambda, error)
    if (allocated(error)) then
      call put_row(page, 'Lambda, zeta, theta*', 'no value: '//error%text)
      return
    end if
    misalignment = atan2(slider%along(2), slider%along(1))
    call put_row(page, 'Lambda', formatted('(es14.7)', lambda))
    if (contact /= 'exact') call put_row(page, '', 'Lambda, zeta and theta* take the contact as exact')
    call put_row(page, 'zeta at theta = phi', formatted('(es14.7)', damping_ratio(lambda, misalignment))// &
      ', friction held at mu_0 W')
    call weakening_damping_ratio(slider, velocity, misalignment, zeta, error)
    if (.not. allocated(error)) call put_row(page, '', formatted('(es14.7)', zeta)//', with F(v)')
    call overdamped_angle(lambda, angle, error)
    if (allocated(error)) then
      call put_row(page, 'theta*', 'no value: '//error%text)
    else
      call put_row(page, 'theta*', formatted('(f12.6)', angle/degree)//' deg, where zeta = 1 with friction held at mu_0 W')
    end if
  end subroutine list_damping

  subroutine put_row(page, name, value)
    type(text_builder_t), intent(inout) :: page
    character(*), intent(in) :: name, value
    character(34) :: column

    column = name
    call page%line(column//value)
  end subroutine put_row
end module dst_stability_report
