!> The summary of a single run: what dst_passage_summary makes of its pieces, and how small differences grow in its cycles.
module dst_motion_summary
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_creep_end, only: creep_end_t, creep_end
  use dst_cycle_map, only: cycle_map_t
  use dst_cycles, only: period
  use dst_divergence, only: divergence_t, regular, undecided
  use dst_growth, only: growth_t, cycle_growth
  use dst_kinds, only: wp, int64
  use dst_motion, only: motion_t
  use dst_piece, only: piece_t, stick_begins, slips, sticks
  use dst_passage, only: passage_t, duration, turn
  use dst_passage_summary, only: piece_summary_t
  use dst_piece_view, only: moment_of
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t
  use dst_state, only: instant_t
  use dst_stepper, only: work_count_t
  use dst_stepping, only: stepping_t
  use dst_summary, only: energies_t, summary_quantities, summary_values
  use dst_writer, only: quantity_t, outcome_t, absent, find_quantity
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

  !> A pull force that swings by less than this share of F_0 slides, and has no frequency. Convention; twice: no change.
  real(wp), parameter :: visible = 1.0e-6_wp
  !> Of cycles that repeat so many are told: the others are alike. Convention; twice: no change.
  integer(int64), parameter :: most_told = 1000

  !> What is known of a motion that does not rest: how small differences grow in its cycles. Plain data.
  type :: restless_t
    type(growth_t) :: growth = growth_t()
    type(divergence_t) :: divergence = divergence_t()
    !> Whether there was a rest in the present cycle.
    logical :: has_rested = .true.
  end type restless_t

  !> The results of a run so far.
  type, extends(piece_summary_t) :: motion_summary_t
    type(restless_t), private :: restless
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
    associate (velocity => motion%drive%segment%velocity)
      call self%load_cell%begin(sum(velocity(:findloc(abs(velocity) > 0.0_wp, .true., dim=1))), motion%t_end, settle > 0.0_wp)
    end associate
  end subroutine start

  !> Process the last piece.
  subroutine follow(self, motion)
    class(motion_summary_t), intent(inout) :: self
    class(motion_t), intent(inout), target :: motion
    integer(int64) :: before

    associate (piece => motion%piece)
      if (motion%in_closed_form) then
        if (piece%contact == sticks) self%sticking_time = piece%to%time
        return
      else if (motion%leapt) then
        select type (motion)
        class is (cycle_map_t)
          if (motion%orbit%is_restless) then
            call follow_repeated(self%restless, motion)
          else
            call rest(self%restless)
          end if
          call self%take_leap(motion)
        end select
        return
      end if
      self%exchanged = self%exchanged + abs(piece%to%drive_work - piece%from%drive_work) + &
        abs(piece%to%friction_work - piece%from%friction_work)
      if (motion%slider%is_damped()) self%exchanged = self%exchanged + abs(piece%to%damper_work - piece%from%damper_work)
      if (self%undecided_from < 0.0_wp .and. motion%is_undecided()) self%undecided_from = piece%to%time
      before = self%cycles%count
      call self%take_piece(motion, piece)
    end associate
    select type (motion)
    class is (cycle_map_t)
      call follow_growth(self, motion%piece, motion%steps%system, motion%slider, self%cycles%count > before)
    type is (stepping_t)
      call follow_growth(self, motion%piece, motion%system, motion%slider, self%cycles%count > before)
    end select
  end subroutine follow

  !> There was a rest: what follows is another motion.
  pure subroutine rest(known)
    type(restless_t), intent(inout) :: known

    if (known%growth%is_followed) known = restless_t()
    known%has_rested = .true.
  end subroutine rest

  !> Follow how a small difference grows, from the end of a cycle without a rest on until there is one.
  subroutine follow_growth(self, piece, system, slider, ends_cycle)
    class(motion_summary_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    logical, intent(in) :: ends_cycle
    real(wp) :: grown
    logical :: is_known

    ! Equal springs have no soft axis, and its load has no cycle that would be a property of the motion.
    if (minval(slider%free) > 0.0_wp .and. .not. abs(slider%stiffness(1) - slider%stiffness(2)) > 0.0_wp) return
    associate (known => self%restless)
      if (piece%contact /= slips .or. .not. piece%is_steady()) then
        call rest(known)
        return
      end if
      if (known%growth%is_followed) call known%growth%follow(piece, system, slider)
      if (.not. ends_cycle) return
      if (known%growth%is_followed) then
        call known%growth%tell(grown, is_known)
        associate (last => self%cycles%last_cycle())
          call complete_cycles(known%divergence, last(period), grown, is_known, 1_int64)
        end associate
      else if (.not. known%has_rested) then
        call known%growth%begin(system, slider, piece%drive%velocity, piece%is_polar)
      end if
      known%has_rested = .false.
    end associate
  end subroutine follow_growth

  !> The growth in a slow cycle without a rest that repeats.
  subroutine follow_repeated(known, map)
    type(restless_t), intent(inout) :: known
    type(cycle_map_t), intent(inout) :: map
    real(wp) :: grown
    logical :: is_known

    associate (velocity => map%piece%drive%velocity, system => map%steps%system)
      if (.not. known%growth%is_followed) call known%growth%begin(system, map%slider, velocity, map%piece%is_polar)
      call map%show_passage(0_int64, 1)
      call cycle_growth(map%shown, system, map%slider, velocity, grown, is_known)
    end associate
    associate (cycles => map%orbit%recurrence%in_period)
      call complete_cycles(known%divergence, map%block_duration()/real(cycles, wp), grown/real(cycles, wp), is_known, &
        cycles*map%repetitions)
    end associate
  end subroutine follow_repeated

  !> So many slow cycles without a rest, of this duration [s], are complete, in each of which a small difference grows by
  !> exp(grown). Relative to the motion, its size changes the duration as much.
  pure subroutine complete_cycles(divergence, lasting, grown, is_known, times)
    type(divergence_t), intent(inout) :: divergence
    real(wp), intent(in) :: lasting, grown
    logical, intent(in) :: is_known
    integer(int64), intent(in) :: times
    type(passage_t) :: one
    integer(int64) :: i

    do i = 1, min(times, most_told)
      call divergence%come_back(grown, is_known)
    end do
    one%measure(duration) = lasting
    one%measure(turn) = 1.0_wp
    call one%take_slope(exp(grown), lasting)
    call divergence%lose(one, times)
  end subroutine complete_cycles

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
    integer :: verdict, told, repeats, m

    if (motion%in_closed_form) then
      call summary_values(self%summary_t, value)
      return
    end if
    call summary_values(self%summary_t, value, energies_t(self%first_energy, motion%energy(motion%velocity_now()), &
      motion%piece%to%drive_work, motion%piece%to%friction_work, &
      merge(max(0.0_wp, motion%piece%to%damper_work), -1.0_wp, motion%slider%is_damped())))
    if (.not. motion%slider%free(1) > 0.0_wp) return
    associate (pull => self%load_cell%movement)
      if (pull%highest >= pull%lowest) then
        call put('pull_peak', pull%highest)
        call put('pull_valley', pull%lowest)
        call put('pull_swing', pull%highest - pull%lowest)
      end if
      if (pull%highest - pull%lowest > visible*motion%slider%law%kinetic_limit) then
        if (pull%frequency() > 0.0_wp) then
          call put('pull_frequency', pull%frequency())
        else if (self%settled_at >= 0.0_wp) then
          call put('pull_frequency', 1.0_wp/of('period'))
        end if
      end if
    end associate
    verdict = self%without_cycles()
    ! An irregular beginning is no irregular motion: what repeats has the exponent of what is repeated.
    repeats = 0
    if (.not. ieee_is_nan(of('repeats'))) repeats = nint(of('repeats'))
    told = undecided
    exponent = absent()
    exponent_error = exponent
    select type (motion)
    class is (cycle_map_t)
      ! The map's slow cycles in a repetition; the load may have more peaks in them, or fewer.
      m = motion%orbit%repeats
      if (m == 0 .and. repeats > 0) m = motion%slow_cycles_in(real(repeats, wp)*of('period'))
      if (self%settled_at >= 0.0_wp .and. m > 0) then
        ! Two cycles agree, too, where a motion passes an unstable one.
        if (motion%orbit%divergence%mean_of(m) > 0.0_wp) then
          m = 0
          repeats = 0
          call put('repeats', 0.0_wp)
        end if
      end if
      if (m > 0) repeats = m
      if (m > 0 .and. .not. ieee_is_nan(of('period'))) repeats = max(1, nint(motion%lasted(m)/of('period')))
      if (.not. self%restless%growth%is_followed) then
        call put('conditioning', motion%orbit%divergence%conditioning())
        if (m > 0) then
          exponent = motion%orbit%divergence%mean_of(m)*real(m, wp)/real(repeats, wp)
        else
          call motion%orbit%divergence%estimate(exponent, exponent_error, told)
        end if
      end if
    end select
    if (self%restless%growth%is_followed) then
      call put('conditioning', self%restless%divergence%conditioning())
      call self%restless%divergence%estimate(exponent, exponent_error, told)
    end if
    if (repeats > 0) then
      verdict = regular
    else if (verdict == undecided .and. .not. ieee_is_nan(exponent)) then
      verdict = told
    end if
    associate (drive => motion%piece%drive)
      if (repeats > 0 .or. abs(drive%velocity) > 0.0_wp .and. .not. abs(drive%acceleration) > 0.0_wp) &
        call put('regularity', real(verdict, wp))
    end associate
    call put('lyapunov_exponent', exponent)
    call put('lyapunov_error', exponent_error)

  contains

    pure real(wp) function of(name)
      character(*), intent(in) :: name

      of = value(find_quantity(summary_quantities, name))
    end function of

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
    outcome%statistics_value = [real([work%steps, work%rejected, work%rhs, work%newton, work%newton, work%newton, &
      work%landings, work%events, work%cycles_leapt, work%cycles_sampled, work%excursions_reused], wp), work%map_error, wall_time]
  end subroutine describe

  !> Save or load.
  subroutine serialise(self, archive)
    class(motion_summary_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call self%summary_t%serialise(archive)
    call archive%serialise(c_loc(self%restless), storage_size(self%restless))
    call archive%serialise(c_loc(self%load_cell%cell_state_t), storage_size(self%load_cell%cell_state_t))
  end subroutine serialise
end module dst_motion_summary
