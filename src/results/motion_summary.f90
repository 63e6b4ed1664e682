!> The summary of a single run: it passes the pieces of the motion to dst_summary.
module dst_motion_summary
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_archive, only: archive_t
  use dst_creep_end, only: creep_end_t, creep_end
  use dst_cycle_map, only: cycle_map_t
  use dst_kinds, only: wp
  use dst_motion, only: motion_t
  use dst_piece, only: stick_begins, slips, sticks
  use dst_passage_summary, only: passage_summary_t
  use dst_piece_view, only: piece_view_t, moment_of
  use dst_state, only: instant_t
  use dst_stepper, only: work_count_t
  use dst_summary, only: summary_t, energies_t, summary_quantities, summary_values
  use dst_writer, only: quantity_t, outcome_t, find_quantity
  implicit none
  private

  public :: motion_summary_t, statistics

  !> The counters of the work done, in the order of `describe`.
  type(quantity_t), parameter :: statistics(*) = [ &
    quantity_t('steps', '1', 'accepted steps', .true.), &
    quantity_t('rejected', '1', 'rejected steps', .true.), &
    quantity_t('rhs', '1', 'evaluations of the equations of motion', .true.), &
    quantity_t('jacobians', '1', 'evaluations of the Jacobian of a step', .true.), &
    quantity_t('factorisations', '1', 'factorised linear systems', .true.), &
    quantity_t('newton', '1', 'Newton iterations', .true.), &
    quantity_t('landings', '1', 'steps solved for the length at which they end in a stop', .true.), &
    quantity_t('events', '1', 'stick and slip events', .true.), &
    quantity_t('cycles_leapt', '1', 'passages from release to release that the cycle map leapt', .true.), &
    quantity_t('cycles_sampled', '1', 'passages that were run for the cycle map', .true.), &
    quantity_t('excursions_reused', '1', 'passages computed by steps that were repeated', .true.), &
    quantity_t('map_error', '1', 'largest relative error of the cycle map, in passages that were left out'), &
    quantity_t('wall_time', 's', 'wall time of the run')]

  !> The results of a run so far.
  type, extends(summary_t) :: motion_summary_t
    type(passage_summary_t), private :: leaps
  contains
    procedure :: start
    procedure :: follow
    procedure :: see
    procedure :: values
    procedure :: describe
    procedure :: serialise
  end type motion_summary_t

contains

  !> Begin with a motion that has been started.
  subroutine start(self, motion, settle)
    class(motion_summary_t), intent(inout) :: self
    class(motion_t), intent(inout) :: motion
    real(wp), intent(in) :: settle    !! to what two cycles have to agree to end the run, 0 if they need not
    type(creep_end_t) :: end

    if (motion%piece%event == stick_begins) self%sticks = 1
    if (motion%in_closed_form) return
    associate (slider => motion%slider)
      ! High frequency: the longitudinal load is given.
      if (minval(slider%free) > 0.0_wp .and. .not. (slider%smoothing > 0.0_wp .or. slider%is_damped()) .and. &
        motion%drive%is_steady(motion%t_end)) then
        end = creep_end(slider, motion%drive%segment(1)%velocity)
        if (end%exists) self%fast_decay = end%decay
      end if
      call self%cycles%begin(slider%along(1)*merge(1.0_wp, 0.0_wp, slider%free(1) > 0.0_wp), slider%law%kinetic_limit, &
        slider%stiffness(1), slider%mass)
    end associate
    call self%begin(moment_of(motion, motion%piece, motion%piece%to), motion%energy(motion%velocity_now()), motion%t_end, settle)
  end subroutine start

  !> Process the last piece.
  subroutine follow(self, motion)
    class(motion_summary_t), intent(inout) :: self
    class(motion_t), intent(inout), target :: motion
    type(piece_view_t) :: view

    associate (piece => motion%piece)
      if (motion%in_closed_form) then
        if (piece%contact == sticks) self%sticking_time = piece%to%time
        return
      else if (motion%leapt) then
        select type (motion)
        class is (cycle_map_t)
          call self%leaps%follow(motion, self%summary_t)
        end select
        return
      end if
      call view%show(motion, piece)
      self%exchanged = self%exchanged + abs(piece%to%drive_work - piece%from%drive_work) + &
        abs(piece%to%friction_work - piece%from%friction_work)
      if (motion%slider%is_damped()) self%exchanged = self%exchanged + abs(piece%to%damper_work - piece%from%damper_work)
      if (piece%event == stick_begins) self%sticks = self%sticks + 1
      if (self%undecided_from < 0.0_wp .and. motion%is_undecided()) self%undecided_from = piece%to%time
    end associate
    call self%take_in(view)
  end subroutine follow

  !> Process a sample of a motion in closed form, which has no steps.
  subroutine see(self, motion, instant)
    class(motion_summary_t), intent(inout) :: self
    class(motion_t), intent(in) :: motion
    type(instant_t), intent(in) :: instant

    if (motion%in_closed_form) &
      self%largest_rate = max(self%largest_rate, abs(dot_product(instant%velocity, motion%slider%along)))
  end subroutine see

  !> The values of all `summary_quantities`, NaN for those that this run does not have.
  subroutine values(self, motion, value)
    class(motion_summary_t), intent(in) :: self
    class(motion_t), intent(in) :: motion
    real(wp), intent(out) :: value(:)
    real(wp) :: exponent, exponent_error
    integer :: verdict, repeats

    if (motion%in_closed_form) then
      call summary_values(self%summary_t, value)
    else
      call summary_values(self%summary_t, value, energies_t(self%first_energy, motion%energy(motion%velocity_now()), &
        motion%piece%to%drive_work, motion%piece%to%friction_work, &
        merge(max(0.0_wp, motion%piece%to%damper_work), -1.0_wp, motion%slider%is_damped())))
    end if
    select type (motion)
    class is (cycle_map_t)
      ! An irregular beginning is no irregular motion: what repeats has the exponent of what is repeated.
      repeats = motion%orbit%repeats
      associate (told => value(find_quantity(summary_quantities, 'repeats')))
        if (repeats == 0 .and. .not. ieee_is_nan(told)) repeats = nint(told)
      end associate
      if (repeats > 0) then
        call put('lyapunov_exponent', motion%orbit%divergence%mean_of(repeats))
        return
      end if
      call motion%orbit%divergence%estimate(exponent, exponent_error, verdict)
      call put('lyapunov_exponent', exponent)
      call put('lyapunov_error', exponent_error)
      if (.not. ieee_is_nan(exponent)) call put('regularity', real(verdict, wp))
    end select

  contains

    subroutine put(name, number)
      character(*), intent(in) :: name
      real(wp), intent(in) :: number

      value(find_quantity(summary_quantities, name)) = number
    end subroutine put
  end subroutine values

  !> Write summary and statistics into the outcome. Quantities without a value are omitted.
  subroutine describe(self, motion, wall_time, outcome)
    class(motion_summary_t), intent(in) :: self
    class(motion_t), intent(in) :: motion
    real(wp), intent(in) :: wall_time
    type(outcome_t), intent(inout) :: outcome
    type(work_count_t) :: work
    real(wp) :: value(size(summary_quantities))

    call self%values(motion, value)
    outcome%summary = pack(summary_quantities, .not. ieee_is_nan(value))
    outcome%summary_value = pack(value, .not. ieee_is_nan(value))
    work = motion%work()
    outcome%statistics = statistics
    outcome%statistics_value = [real([work%steps, work%rejected, work%rhs, work%jacobians, work%factorisations, work%newton, &
      work%landings, work%events, work%cycles_leapt, work%cycles_sampled, work%excursions_reused], wp), work%map_error, wall_time]
  end subroutine describe

  !> Save or load.
  subroutine serialise(self, archive)
    class(motion_summary_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call self%summary_t%serialise(archive)
    call self%leaps%serialise(archive)
  end subroutine serialise
end module dst_motion_summary
