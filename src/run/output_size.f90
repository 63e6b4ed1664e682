!> The number of values that a run or a sweep will write, counted as a real number before anything is computed: no count overflows.
module dst_output_size
  use dst_kinds, only: wp
  use dst_scene, only: scene_t
  implicit none
  private

  public :: sample_count, run_samples, most_samples, most_series_values

  !> Beyond this number samples have no distinct times in double precision: 2^53.
  real(wp), parameter :: most_samples = 2.0_wp**53
  !> Largest number of values in the series of one case, which is written as one piece of at most 2^31 words.
  real(wp), parameter :: most_series_values = 2.0e9_wp

contains

  !> Number of samples from 0 to `t_end` [s] every `interval` > 0 [s], both ends included; a multiple of the interval within
  !> roundoff of the end is the end. `huge` if there are more than `most_samples`.
  elemental real(wp) function sample_count(t_end, interval)
    real(wp), intent(in) :: t_end, interval

    sample_count = huge(sample_count)
    if (t_end/most_samples >= interval) return
    sample_count = aint(t_end*(1.0_wp - 4.0_wp*epsilon(1.0_wp))/interval) + 2.0_wp
    if (sample_count - 2.0_wp >= t_end*(1.0_wp - 4.0_wp*epsilon(1.0_wp))/interval) sample_count = sample_count - 1.0_wp
  end function sample_count

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
end module dst_output_size
