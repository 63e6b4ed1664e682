!> What `dynstiction cycles` prints: the limit cycles of a scene, and steady sliding beside them.
module dst_cycles_report
  use dst_assembly, only: slider_from_scene
  use dst_cycles, only: peak, valley
  use dst_errors, only: error_t, raise, deck_error
  use dst_kinds, only: wp
  use dst_limit_cycles, only: limit_cycles_t, find_limit_cycles, limit_cycle_quantities
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  use dst_stability_report, only: held_velocities
  use dst_text, only: text_builder_t, formatted, integer_text
  implicit none
  private

  public :: cycles_report

contains

  !> One table for each velocity that the drive holds.
  subroutine cycles_report(scene, name, text, error)
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: name
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(text_builder_t) :: page
    type(limit_cycles_t) :: cycles
    type(slider_t) :: slider
    real(wp), allocatable :: velocities(:)
    integer :: i

    text = ''
    allocate (velocities, source=held_velocities(scene%drive_time, scene%drive_velocity))
    if (size(velocities) == 0) then
      call raise(error, deck_error, 'drive.velocity: the drive holds no velocity but 0, so there is nothing to settle to: '// &
        'give one value that is not 0, or a profile that holds one')
      return
    end if
    call slider_from_scene(scene, slider)
    do i = 1, size(velocities)
      call find_limit_cycles(scene, velocities(i), cycles, error)
      if (allocated(error)) then
        error%code = deck_error
        return
      end if
      call page%line('# '//name//': limit cycles at V = '//formatted('(es13.6)', velocities(i))//' m/s, phi = '// &
        formatted('(f11.6)', scene%misalignment_deg)//' deg, model '//cycles%model)
      call list_sliding(page, cycles)
      call list_cycles(page, cycles, slider)
      call page%line('')
    end do
    text = page%content()
  end subroutine cycles_report

  subroutine list_sliding(page, cycles)
    type(text_builder_t), intent(inout) :: page
    type(limit_cycles_t), intent(in) :: cycles
    character(100) :: row
    integer :: i

    call page%row('steady sliding is', trim(merge('stable    ', 'not stable', cycles%sliding_is_stable))//', at a load of '// &
      formatted('(es16.9)', cycles%sliding_load)//' N')
    do i = 1, size(cycles%eigenvalues)
      write (row, '(a, es16.9, a, es16.9, a)') 'eigenvalue ', real(cycles%eigenvalues(i)), ' 1/s, ', aimag(cycles%eigenvalues(i)), &
        ' rad/s'
      call page%row('', row)
    end do
  end subroutine list_sliding

  subroutine list_cycles(page, cycles, slider)
    type(text_builder_t), intent(inout) :: page
    type(limit_cycles_t), intent(in) :: cycles
    type(slider_t), intent(in) :: slider
    integer :: i, k

    if (cycles%number() == 0) call page%row('cycles', 'none')
    do i = 1, cycles%number()
      call page%line('')
      call page%row('cycle '//integer_text(i), trim(merge('stable  ', 'unstable', cycles%is_stable(i))))
      do k = 1, size(limit_cycle_quantities)
        call page%row('  '//trim(limit_cycle_quantities(k)%name), formatted('(es22.14)', cycles%value(k, i))//' '// &
          trim(limit_cycle_quantities(k)%units))
      end do
      if (cycles%is_stable(i)) then
        call page%row('  apparent static friction', formatted('(es22.14)', cycles%value(peak, i)/ &
          slider%law%static_limit)//' mu_0')
      else if (cycles%sliding_is_stable .and. i == 1) then
        call page%row('', '  between '//formatted('(es14.7)', cycles%value(valley, i))//' N and '// &
          formatted('(es14.7)', cycles%value(peak, i))//' N the object comes to steady sliding')
      end if
    end do
  end subroutine list_cycles
end module dst_cycles_report
