!> What `dynstiction cycles` prints: the limit cycles of a scene, and its steady sliding.
module dst_cycles_report
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_assembly, only: slider_from_scene
  use dst_cycles, only: cycle_quantities, period, peak, valley, threshold
  use dst_deck_values, only: deck_t
  use dst_divergence, only: regular, irregular, steady_sliding
  use dst_errors, only: error_t
  use dst_full_cycles, only: regularity_t
  use dst_kinds, only: wp
  use dst_limit_cycles, only: limit_cycles_t, find_limit_cycles, limit_cycle_quantities, log_multiplier, slow_cycles
  use dst_release_map, only: watch_t
  use dst_scene, only: scene_t
  use dst_sensitivity, only: sensitivity_t, find_sensitivity
  use dst_slider, only: slider_t
  use dst_stability_report, only: held_velocities
  use dst_plain_numbers, only: long_text
  use dst_text, only: text_builder_t, integer_text, short_text
  implicit none
  private

  public :: cycles_report, sensitivity_report

contains

  !> One table for each velocity that the drive keeps for some time; with the sensitivity of the motion to the listed keys.
  subroutine cycles_report(deck, scene, name, keys, text, error, watch)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: name, keys
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    procedure(watch_t), optional :: watch    !! who looks on, and may end the search
    type(text_builder_t) :: page
    type(limit_cycles_t) :: cycles
    type(slider_t) :: slider
    real(wp), allocatable :: velocities(:)
    integer :: i

    text = ''
    call held_velocities(scene, velocities, error)
    if (allocated(error)) return
    call slider_from_scene(scene, slider)
    do i = 1, size(velocities)
      call find_limit_cycles(scene, velocities(i), cycles, error, watch)
      if (allocated(error)) return
      call page%line('# '//name//': limit cycles at V = '//long_text(velocities(i))//' m/s, phi = '// &
        long_text(scene%misalignment_deg)//' deg, model '//cycles%model)
      call list_sliding()
      call list_cycles()
      if (cycles%model == 'full') call list_regularity(page, cycles%regularity)
      if (keys /= '') call list_sensitivity(page, deck, scene, velocities(i), keys, error)
      if (allocated(error)) return
      call page%line('')
    end do
    text = page%content()

  contains

    subroutine list_sliding()
      integer :: k

      call page%row('steady sliding is', trim(merge('stable    ', 'not stable', cycles%sliding_is_stable))//', at a load of '// &
        long_text(cycles%sliding_load)//' N')
      do k = 1, size(cycles%eigenvalues)
        call page%row('', 'eigenvalue '//long_text(real(cycles%eigenvalues(k)))//' 1/s, '// &
          long_text(aimag(cycles%eigenvalues(k)))//' rad/s')
      end do
    end subroutine list_sliding

    subroutine list_cycles()
      integer :: n, k

      if (cycles%number() == 0) call page%row('cycles', 'none')
      do n = 1, cycles%number()
        call page%line('')
        if (.not. cycles%is_stable(n) .and. cycles%value(slow_cycles, n) > 1.0_wp) then
          ! There may be very many of these.
          call page%row('cycle '//integer_text(n), 'unstable, of '//integer_text(nint(cycles%value(slow_cycles, n)))// &
            ' slow cycles in '//long_text(cycles%value(period, n))//' s, between '//long_text(cycles%value(valley, n))// &
            ' N and '//long_text(cycles%value(peak, n))//' N, log_multiplier '//long_text(cycles%value(log_multiplier, n)))
          cycle
        end if
        call page%row('cycle '//integer_text(n), trim(merge('stable  ', 'unstable', cycles%is_stable(n))))
        do k = 1, size(limit_cycle_quantities)
          if (ieee_is_nan(cycles%value(k, n))) cycle
          call page%row('  '//trim(limit_cycle_quantities(k)%name), long_text(cycles%value(k, n))//' '// &
            trim(limit_cycle_quantities(k)%units))
        end do
        if (cycles%is_stable(n)) then
          call page%row('  apparent static friction', long_text(cycles%value(peak, n)/ &
            slider%law%kinetic_limit)//' mu_0')
        else if (cycles%sliding_is_stable .and. n == 1) then
          call page%row('', '  between '//long_text(cycles%value(valley, n))//' N and '// &
            long_text(cycles%value(peak, n))//' N the object reaches steady sliding')
        end if
      end do
    end subroutine list_cycles
  end subroutine cycles_report

  !> The sensitivity of the motion to the listed keys at each velocity that the drive keeps for some time.
  subroutine sensitivity_report(deck, scene, keys, text, error)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: keys
    character(:), allocatable, intent(out) :: text
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: none
    type(text_builder_t) :: page
    real(wp), allocatable :: velocities(:)
    integer :: i

    call held_velocities(scene, velocities, none)
    do i = 1, size(velocities)
      call list_sensitivity(page, deck, scene, velocities(i), keys, error)
      if (allocated(error)) return
    end do
    text = page%content()
  end subroutine sensitivity_report

  !> How far was searched, and what the motion from the scene's initial state is like: a cycle that it settles to, or a distribution
  !> of cycles.
  subroutine list_regularity(page, regularity)
    type(text_builder_t), intent(inout) :: page
    type(regularity_t), intent(in) :: regularity
    integer :: k

    call page%line('')
    call page%row('cycles were looked for', 'of up to '//integer_text(regularity%searched)//' slow cycle'// &
      trim(merge('s', ' ', regularity%searched /= 1)))
    select case (regularity%verdict)
    case (regular)
      if (regularity%repeats > 0) then
        call page%row('motion of the scene', 'regular: it repeats after '//integer_text(regularity%repeats)//' slow cycle'// &
          trim(merge('s', ' ', regularity%repeats > 1)))
      else
        call page%row('motion of the scene', 'regular: it comes slowly to a cycle')
      end if
    case (irregular)
      call page%row('motion of the scene', 'irregular: its cycles have a distribution, and no value')
    case (steady_sliding)
      call page%row('motion of the scene', 'steady sliding')
    case default
      call page%row('motion of the scene', 'undecided whether regular or irregular')
      if (regularity%cycles == 0 .and. regularity%swing > 0.0_wp) &
        call page%row('', 'its load swings by '//long_text(regularity%swing)//' N in sliding that is not stable; '// &
        'cycles have more than '//trim(short_text(100.0_wp*threshold))//' % of F_0')
    end select
    if (.not. ieee_is_nan(regularity%exponent)) then
      call page%row('  Lyapunov exponent', long_text(regularity%exponent)//' +- '// &
        long_text(regularity%error)//' per slow cycle, from '//integer_text(regularity%slow_cycles)//' slow cycles')
    end if
    if (regularity%repeats > 0 .or. regularity%cycles < 2) return
    do k = 1, size(cycle_quantities)
      call page%row('  '//cycle_quantities(k)%name, long_text(regularity%mean(k))//' +- '// &
        long_text(regularity%scatter(k))//' '//trim(cycle_quantities(k)%units)//' (standard deviation)')
    end do
  end subroutine list_regularity

  !> Of the motion at one velocity [m/s], in percent of a measure for one percent of a parameter.
  subroutine list_sensitivity(page, deck, scene, velocity, keys, error)
    type(text_builder_t), intent(inout) :: page
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    character(*), intent(in) :: keys
    type(error_t), allocatable, intent(out) :: error
    type(sensitivity_t) :: sensitivity
    character(15*size(cycle_quantities)) :: line
    integer :: i

    call find_sensitivity(deck, scene, velocity, keys, sensitivity, error)
    if (allocated(error)) return
    call page%line('')
    write (line, '(*(a15))') adjustr(cycle_quantities%name(:15))
    call page%row('percent per percent', trim(line))
    do i = 1, size(sensitivity%key)
      write (line, '(*(f15.4))') sensitivity%derivative(:, i)*sensitivity%parameter(i)/sensitivity%value
      call page%row('  '//trim(sensitivity%key(i)), trim(line))
    end do
  end subroutine list_sensitivity
end module dst_cycles_report
