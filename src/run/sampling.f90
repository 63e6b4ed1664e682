!> When a run is sampled: how often with output.interval = 'auto', how many values that makes, and whether samples show the fast
!> oscillation of a scene.
!>
!> The mass on the spring of the stiff axis oscillates with sqrt(k_y/m)/2 pi. If the interval of the samples is more than half its
!> period, they show a slower oscillation that does not exist. This module does not change what is computed, only when it is
!> sampled. Numbers of values are counted as real numbers before anything is computed: no count overflows.
module dst_sampling
  use dst_assembly, only: slider_from_scene
  use dst_kinds, only: wp, int64, pi
  use dst_plain_numbers, only: number_text
  use dst_scene, only: scene_t
  use dst_schema, only: automatic
  use dst_slider, only: slider_t
  implicit none
  private

  public :: settle_interval, sampling_note, sample_count, sample_time, run_samples, most_samples, most_series_values

  !> Smallest number of samples in a period of the fast oscillation, and of the slow one; of samples of a run, and of samples in the
  !> time in which the drive loads the soft spring up to slip. Conventions of pictures: with 10 in a period a curve through the
  !> samples misses the peaks of a sine by up to 5 % of its amplitude.
  real(wp), parameter :: in_fast_period = 10.0_wp, in_slow_period = 100.0_wp, in_run = 1000.0_wp, in_loading = 500.0_wp
  !> Samples in a period of the fast oscillation below which a picture of them misleads.
  real(wp), parameter :: fewest_in_period = 4.0_wp
  !> Largest number of samples of a run: about 120 MB of 16 columns.
  real(wp), parameter :: most_automatic = 1.0e6_wp
  !> Beyond this number samples have no distinct times in double precision: 2^53.
  real(wp), parameter :: most_samples = 2.0_wp**53
  !> Largest number of values in the series of one case, which is written as one piece of at most 2^31 words.
  real(wp), parameter :: most_series_values = 2.0e9_wp
  !> The share of a run before its end up to which a multiple of the interval is the end: roundoff, with a margin. Twice: no change.
  real(wp), parameter :: almost_all = 1.0_wp - 4.0_wp*epsilon(1.0_wp)

contains

  !> Replace 'auto' by an interval between samples [s]. The model must have been chosen.
  subroutine settle_interval(scene)
    type(scene_t), intent(inout) :: scene

    if (abs(scene%interval - automatic) > 0.0_wp) return
    scene%interval_is_chosen = .true.
    scene%interval = fine_interval(scene)
    if (scene%interval < scene%t_end/most_automatic) scene%interval = rounded(scene%t_end/most_automatic, up=.true.)
  end subroutine settle_interval

  !> The interval between samples that shows all of the motion [s].
  real(wp) function fine_interval(scene) result(interval)
    type(scene_t), intent(in) :: scene
    type(slider_t) :: slider

    call slider_from_scene(scene, slider)
    interval = scene%t_end/in_run
    if (scene%is_closed_form()) then
      call shorten(slider%law%static_limit/in_loading, scene%stiffness_x*maxval(abs(scene%drive_velocity)))
    else
      call shorten(2.0_wp*pi/in_slow_period, sqrt(scene%stiffness_x)/sqrt(scene%mass))
      call shorten(2.0_wp*pi/in_fast_period, fast_frequency(scene))
    end if
    interval = rounded(interval, up=.false.)

  contains

    !> At most the ratio of two numbers, if that is a valid time.
    subroutine shorten(above, below)
      real(wp), intent(in) :: above, below

      if (below > 0.0_wp .and. above > tiny(1.0_wp)*below .and. above < interval*below) interval = above/below
    end subroutine shorten
  end function fine_interval

  !> Angular frequency of the fast oscillation [rad/s]; 0 if the model has none, or nothing excites it.
  real(wp) function fast_frequency(scene)
    type(scene_t), intent(in) :: scene
    type(slider_t) :: slider

    fast_frequency = 0.0_wp
    if (scene%model /= 'full' .and. scene%model /= 'high_frequency') return
    call slider_from_scene(scene, slider)
    if (scene%model == 'full' .and. .not. abs(slider%along(2)) + abs(scene%elongation_y) > 0.0_wp) return
    ! With a damper there may be no oscillation.
    if (scene%damping_y >= 2.0_wp*sqrt(scene%stiffness_y)*sqrt(scene%mass)) return
    fast_frequency = sqrt(scene%stiffness_y)/sqrt(scene%mass)
  end function fast_frequency

  !> Number of samples from 0 to `t_end` [s] every `interval` > 0 [s], both ends included. `huge` if there are more than
  !> `most_samples`.
  elemental real(wp) function sample_count(t_end, interval)
    real(wp), intent(in) :: t_end, interval

    sample_count = huge(sample_count)
    if (t_end/most_samples >= interval) return
    sample_count = aint(t_end*almost_all/interval) + 2.0_wp
    if (sample_count - 2.0_wp >= t_end*almost_all/interval) sample_count = sample_count - 1.0_wp
  end function sample_count

  !> The time [s] of a sample, by its number from 0 on; the end is sampled exactly.
  elemental real(wp) function sample_time(t_end, interval, number)
    real(wp), intent(in) :: t_end, interval
    integer(int64), intent(in) :: number

    sample_time = real(number, wp)*interval
    if (sample_time >= t_end*almost_all) sample_time = t_end
  end function sample_time

  !> Number of samples of a run; 0 if it is known only after the run: one for each step of a method that chooses its steps.
  pure real(wp) function run_samples(scene)
    type(scene_t), intent(in) :: scene

    run_samples = 0.0_wp
    if (scene%interval > 0.0_wp) then
      run_samples = sample_count(scene%t_end, scene%interval)
    else if (scene%step > 0.0_wp .and. .not. scene%is_closed_form()) then
      run_samples = sample_count(scene%t_end, scene%step)
      if (scene%max_steps > 0) run_samples = min(run_samples, real(scene%max_steps, wp))
    end if
  end function run_samples

  !> What the samples of a scene with its final interval will not show, and what to do; '' if they show everything.
  function sampling_note(scene) result(text)
    type(scene_t), intent(in) :: scene
    character(:), allocatable :: text
    character(:), allocatable :: how
    real(wp) :: in_period, needed

    text = ''
    ! Every step, or only the first and the last state.
    if (.not. scene%interval > 0.0_wp .or. scene%interval >= scene%t_end) return
    if (.not. fast_frequency(scene) > 0.0_wp) return
    in_period = 2.0_wp*pi/fast_frequency(scene)/scene%interval
    if (in_period >= fewest_in_period) return
    needed = fine_interval(scene)
    how = number_text(in_period, 2)//' samples in a period'
    if (in_period < 0.7_wp) how = 'one sample in '//number_text(1.0_wp/in_period, 2)//' periods'
    text = 'samples '//number_text(scene%interval)//' s apart do not show the fast oscillation of '// &
      number_text(fast_frequency(scene)/(2.0_wp*pi))//' Hz ('//how//'): '
    if (scene%interval_is_chosen) then
      text = text//"'auto' takes at most "//number_text(most_automatic)//' samples; output.interval = '//number_text(needed)// &
        ' shows it with '//number_text(sample_count(scene%t_end, needed))//' samples, or lower scene.t_end'
    else
      text = text//"give output.interval = 'auto', or "//number_text(needed)//' s'
    end if
  end function sampling_note

  !> A number of at most three digits that divides a power of ten, the next one to `time` above or below it.
  pure real(wp) function rounded(time, up)
    real(wp), intent(in) :: time
    logical, intent(in) :: up
    real(wp), parameter :: hundredths(11) = [100.0_wp, 125.0_wp, 160.0_wp, 200.0_wp, 250.0_wp, 320.0_wp, 400.0_wp, 500.0_wp, &
      640.0_wp, 800.0_wp, 1000.0_wp]
    integer :: exponent, i

    rounded = time
    ! Where powers of ten are not exact, a round number is none.
    if (time < 1.0e-15_wp .or. time > 1.0e15_wp) return
    exponent = floor(log10(time)) - 2
    do i = merge(1, size(hundredths), up), merge(size(hundredths), 1, up), merge(1, -1, up)
      if (exponent >= 0) then
        rounded = hundredths(i)*10.0_wp**exponent
      else
        rounded = hundredths(i)/10.0_wp**(-exponent)
      end if
      if (merge(rounded >= time, rounded <= time, up)) return
    end do
    rounded = time
  end function rounded
end module dst_sampling
