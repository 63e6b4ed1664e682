!> Measured error against cost on one scene: what `dynstiction trade` does, in slices of wall time.
!>
!> A survey finds the time scales of the motion. The reference is radau13 at the smallest tolerance, its error what radau9 at ten
!> times that tolerance differs from it. Then every candidate that is not costly runs in turn, after them the costly ones, the
!> cheapest first, until the budget of wall time is used up. What does not fit is skipped or abandoned, and stays in the list
!> with the reason.
module dst_trade
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, result_done, usage_error, deck_error, stopped_early
  use dst_memory_writer, only: memory_writer_t
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t, wall_clock
  use dst_plain_numbers, only: number_text
  use dst_method_table, only: method_order
  use dst_trade_plan, only: candidate_t, candidates_of, apply_candidate, same_family
  use dst_trade_quantities, only: quantities, quantity_count, observation_t, observation_plan_t, plan_observation, &
    tune_frequency, observe_run, errors_of, not_applicable
  use dst_writer, only: outcome_t
  implicit none
  private

  public :: trade_t, point_t, start_trade, resolution

  !> One candidate and what came of it.
  type :: point_t
    type(candidate_t) :: candidate
    integer :: result_code = stopped_early   !! of dst_errors; 0 = done
    character(200) :: text = 'not tried'     !! 'done', or why not
    real(wp) :: seconds = 0.0_wp             !! wall time of the run, s
    real(wp) :: steps = 0.0_wp, rhs = 0.0_wp, newton = 0.0_wp
    !> Errors in the order of dst_trade_quantities; not_applicable if there is none.
    real(wp) :: error(quantity_count) = not_applicable
  end type point_t

  !> Stages in their order.
  integer, parameter :: survey = 1, reference = 2, check = 3, comparison = 4

  !> A comparison: what is to be tried, what was measured, and on what budget.
  type :: trade_t
    type(scene_t) :: scene                   !! of the reference
    real(wp) :: budget = 0.0_wp              !! s of wall time
    type(point_t), allocatable :: points(:)
    !> The reference, and the run by which its error is known.
    type(point_t) :: best, second
    type(outcome_t) :: best_outcome
    real(wp) :: reference_error(quantity_count) = not_applicable
    type(observation_plan_t) :: plan
    logical :: finished = .false.
    integer, private :: stage = survey
    !> Numbers of the points in the order of this round, how many of them have had their turn, and which have to wait.
    integer, allocatable, private :: order(:)
    integer, private :: taken = 0, current = 0
    logical, allocatable, private :: postponed(:)
    logical, private :: second_round = .false.
    real(wp), private :: begun = 0.0_wp, allowance = 0.0_wp, seconds_per_rhs = 0.0_wp
    integer, private :: repeats = 0
    type(observation_t), private :: best_observation
    type(simulation_t), allocatable, private :: run
    type(memory_writer_t), private :: samples
  contains
    procedure :: proceed
    procedure :: elapsed
    procedure :: has_reference
  end type trade_t

  !> An error counts as measured from this multiple of the reference's own on.
  real(wp), parameter :: resolution = 100.0_wp
  !> A quantity that the reference itself knows no better is none.
  real(wp), parameter :: worst_reference = 1.0e-2_wp
  real(wp), parameter :: smallest_rtol = 1.0e-13_wp, loosest_reference = 1.0e-9_wp
  integer, parameter :: survey_samples = 4000
  !> Share of the budget left that one candidate may take before the costly ones have their turn.
  real(wp), parameter :: share = 0.08_wp
  !> Share of what a candidate may take after which its pace is looked at.
  real(wp), parameter :: proof = 0.15_wp
  !> Shorter runs are repeated so often, and the shortest time counts [s].
  real(wp), parameter :: short_run = 0.02_wp
  integer, parameter :: most_repeats = 3

contains

  !> Get ready to compare on a scene, within `budget` seconds of wall time from now on.
  subroutine start_trade(scene, budget, self, error)
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: budget
    type(trade_t), intent(out) :: self
    type(error_t), allocatable, intent(out) :: error
    type(candidate_t), allocatable :: candidates(:)
    integer :: i

    if (.not. (budget > 0.0_wp .and. budget <= huge(budget))) then
      call raise(error, usage_error, 'the budget is out of range: it must be > 0.0 s and finite')
      return
    end if
    self%begun = wall_clock()
    self%budget = budget
    self%scene = scene
    if (scene%model == 'auto') self%scene%model = 'full'
    if (scene%is_closed_form()) then
      call raise(error, deck_error, "model '"//scene%model//"' is a closed form and leaves nothing to compare: "// &
        "choose model = 'full', which has it among its candidates")
      return
    end if
    self%scene%max_steps = 0
    self%scene%wall_limit = 0.0_wp
    call candidates_of(self%scene, candidates)
    allocate (self%points(size(candidates)))
    do i = 1, size(candidates)
      self%points(i)%candidate = candidates(i)
    end do
    self%order = [(i, i=1, size(candidates))]
    allocate (self%postponed(size(candidates)), source=.false.)
    self%best%candidate = candidate_t(model=self%scene%model, method='radau13', contact=scene%contact, &
      v_smooth=scene%v_smooth, rtol=smallest_rtol)
    self%second%candidate = self%best%candidate
    self%second%candidate%method = 'radau9'
    call start_run(self, error)
  end subroutine start_trade

  !> Wall time since the start [s].
  real(wp) function elapsed(self)
    class(trade_t), intent(in) :: self

    elapsed = wall_clock() - self%begun
  end function elapsed

  !> Whether there is something to compare with.
  pure logical function has_reference(self)
    class(trade_t), intent(in) :: self

    has_reference = self%stage == comparison
  end function has_reference

  !> Go on for at most `seconds` of wall time [s]. It is an error if there is no reference.
  subroutine proceed(self, seconds, error)
    class(trade_t), intent(inout) :: self
    real(wp), intent(in) :: seconds
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: run_error
    real(wp) :: now, until, slice

    now = self%elapsed()
    until = now + seconds
    do while (.not. self%finished .and. now < until)
      if (.not. allocated(self%run)) call next_candidate(self)
      if (self%finished) exit
      slice = min(until, self%budget) - now
      if (self%stage == comparison) slice = min(slice, proof*self%allowance)
      call self%run%proceed(max(0.0_wp, slice), self%samples, run_error)
      now = self%elapsed()
      if (self%run%finished) then
        call conclude(self, run_error, error)
      else if (self%stage < comparison .and. now >= self%budget) then
        call raise(error, stopped_early, 'the budget of '//number_text(self%budget)// &
          ' s does not suffice for the reference: raise --budget, or lower scene.t_end')
      else if (is_hopeless(self)) then
        call abandon(self)
      end if
      if (allocated(error)) self%finished = .true.
    end do
  end subroutine proceed

  !> Whether the candidate that runs has taken what it may, or its pace tells after some time that it will by far.
  pure logical function is_hopeless(self)
    class(trade_t), intent(in) :: self
    real(wp) :: expected

    is_hopeless = .false.
    if (self%stage /= comparison) return
    expected = self%run%elapsed*self%scene%t_end/max(self%run%trajectory%now%time, tiny(1.0_wp))
    is_hopeless = self%run%elapsed > self%allowance .or. &
      self%run%elapsed > proof*self%allowance .and. expected > 3.0_wp*self%allowance
  end function is_hopeless

  !> Begin the run of the present stage; `error` if its scene is refused.
  subroutine start_run(self, error)
    class(trade_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene

    scene = self%scene
    scene%interval = scene%t_end
    deallocate (scene%fields)
    allocate (scene%fields(1))
    scene%fields(1) = 'default'
    if (allocated(self%run)) deallocate (self%run)
    allocate (self%run)
    self%samples%rows = 0
    self%samples%events = 0
    ! Columns differ between models.
    if (allocated(self%samples%samples)) deallocate (self%samples%samples)
    if (self%stage == survey) then
      call apply_candidate(survey_candidate(self), scene)
      scene%interval = scene%t_end/real(survey_samples, wp)
    else
      self%run%instants = self%plan%instants
      select case (self%stage)
      case (reference)
        call apply_candidate(self%best%candidate, scene)
      case (check)
        call apply_candidate(self%second%candidate, scene)
      case default
        call apply_candidate(self%points(self%current)%candidate, scene)
      end select
    end if
    call self%run%start(scene, error)
  end subroutine start_run

  pure type(candidate_t) function survey_candidate(self)
    class(trade_t), intent(in) :: self

    survey_candidate = self%second%candidate
    survey_candidate%rtol = 1.0e-6_wp
  end function survey_candidate

  !> A run has come to its end, or its solver has given up.
  subroutine conclude(self, run_error, error)
    class(trade_t), intent(inout) :: self
    type(error_t), allocatable, intent(inout) :: run_error
    type(error_t), allocatable, intent(out) :: error
    type(outcome_t) :: outcome
    type(observation_t) :: observation

    call self%run%outcome(run_error, outcome)
    if (self%stage == comparison) then
      call conclude_candidate(self, outcome)
      return
    end if
    if (allocated(run_error)) then
      call loosen(self, run_error, error)
    else
      select case (self%stage)
      case (survey)
        call plan_observation(self%run, self%samples, self%plan)
        self%seconds_per_rhs = self%run%elapsed/max(1.0_wp, outcome%statistic('rhs'))
      case (reference)
        call tune_frequency(self%run, self%samples, self%plan)
        call observe_run(self%plan, self%run, self%samples, outcome, self%best_observation)
        call take_work(self%best, self%run%elapsed, outcome)
        self%best_outcome = outcome
        self%second%candidate%rtol = 10.0_wp*self%best%candidate%rtol
      case (check)
        call observe_run(self%plan, self%run, self%samples, outcome, observation)
        call take_work(self%second, self%run%elapsed, outcome)
        call judge_reference(self, observation)
      end select
      self%stage = self%stage + 1
    end if
    if (allocated(error)) return
    if (self%stage == comparison) then
      deallocate (self%run)
    else
      call start_run(self, error)
    end if
  end subroutine conclude

  !> The reference where its solver gives up: at a larger tolerance.
  subroutine loosen(self, run_error, error)
    class(trade_t), intent(inout) :: self
    type(error_t), allocatable, intent(inout) :: run_error
    type(error_t), allocatable, intent(out) :: error

    if (self%stage == reference .and. self%best%candidate%rtol < loosest_reference) then
      self%best%candidate%rtol = 10.0_wp*self%best%candidate%rtol
    else if (self%stage == check .and. self%second%candidate%rtol < loosest_reference) then
      self%second%candidate%rtol = 10.0_wp*self%second%candidate%rtol
    else
      call move_alloc(run_error, error)
      error%text = 'there is no reference: '//error%text
    end if
  end subroutine loosen

  !> The reference's own error: what the second run differs from it. A quantity on which they disagree is dropped.
  subroutine judge_reference(self, observation)
    class(trade_t), intent(inout) :: self
    type(observation_t), intent(in) :: observation
    real(wp), parameter :: roundoff = 10.0_wp*epsilon(1.0_wp)

    self%reference_error = errors_of(self%plan, observation, self%best_observation)
    where (self%reference_error > worst_reference)
      self%best_observation%has = .false.
      self%reference_error = not_applicable
    end where
    where (self%reference_error < 0.0_wp)
      self%best_observation%has = .false.
    else where
      ! That two runs agree by chance to the last digit makes neither exact.
      self%reference_error = max(self%reference_error, roundoff)
    end where
    self%second%error = self%reference_error
  end subroutine judge_reference

  subroutine conclude_candidate(self, outcome)
    class(trade_t), intent(inout) :: self
    type(outcome_t), intent(in) :: outcome
    type(observation_t) :: observation
    type(error_t), allocatable :: ignored

    associate (point => self%points(self%current))
      self%repeats = self%repeats + 1
      if (self%repeats > 1) then
        point%seconds = min(point%seconds, self%run%elapsed)
      else
        point%result_code = outcome%result_code
        point%text = outcome%result_text
        call take_work(point, self%run%elapsed, outcome)
        if (outcome%result_code == result_done) then
          call observe_run(self%plan, self%run, self%samples, outcome, observation)
          point%error = errors_of(self%plan, observation, self%best_observation)
        end if
      end if
      if (point%result_code == result_done .and. point%seconds < short_run .and. self%repeats < most_repeats &
        .and. left(self) > 10.0_wp*point%seconds) then
        call start_run(self, ignored)
      else
        deallocate (self%run)
      end if
    end associate
  end subroutine conclude_candidate

  subroutine take_work(point, seconds, outcome)
    type(point_t), intent(inout) :: point
    real(wp), intent(in) :: seconds
    type(outcome_t), intent(in) :: outcome

    point%seconds = seconds
    point%steps = outcome%statistic('steps')
    point%rhs = outcome%statistic('rhs')
    point%newton = outcome%statistic('newton')
    if (outcome%result_code == result_done) then
      point%result_code = result_done
      point%text = 'done'
    end if
  end subroutine take_work

  !> Give up the candidate that runs; its cost is kept as what it would have been at the pace so far.
  subroutine abandon(self)
    class(trade_t), intent(inout) :: self
    type(outcome_t) :: outcome
    type(error_t), allocatable :: none

    associate (point => self%points(self%current), now => self%run%trajectory%now%time)
      call self%run%outcome(none, outcome)
      call take_work(point, self%run%elapsed, outcome)
      point%result_code = stopped_early
      point%text = 'abandoned after '//number_text(self%run%elapsed)//' s at t = '//number_text(now)// &
        ' s: the budget did not suffice'
      point%seconds = self%run%elapsed*self%scene%t_end/max(now, self%scene%t_end*1.0e-6_wp)
    end associate
    self%postponed(self%current) = .not. self%second_round
    deallocate (self%run)
  end subroutine abandon

  !> Start the next candidate that may be tried, and note why the ones before it may not.
  subroutine next_candidate(self)
    class(trade_t), intent(inout) :: self
    type(error_t), allocatable :: error
    real(wp) :: expected

    do
      if (self%taken == size(self%order)) then
        if (self%second_round) exit
        call begin_second_round(self)
        cycle
      end if
      self%taken = self%taken + 1
      self%current = self%order(self%taken)
      associate (point => self%points(self%current))
        call find_obstacle(self, point%candidate, error)
        self%allowance = merge(1.0_wp, share, self%second_round)*left(self)
        expected = expected_seconds(self, point%candidate)
        if (.not. allocated(error)) then
          if (expected > self%allowance .or. left(self) <= 0.0_wp) then
            call skip(self, point, expected)
            cycle
          end if
          self%repeats = 0
          call start_run(self, error)
          if (.not. allocated(error)) return
          deallocate (self%run)
        end if
        point%result_code = error%code
        point%text = error%text
      end associate
    end do
    self%finished = .true.
  end subroutine next_candidate

  !> For now, or for good.
  subroutine skip(self, point, expected)
    class(trade_t), intent(inout) :: self
    type(point_t), intent(inout) :: point
    real(wp), intent(in) :: expected

    self%postponed(self%current) = .not. self%second_round
    ! That it was abandoned in the first round says more.
    if (point%steps > 0.0_wp) return
    point%text = 'skipped: the budget was used up'
    if (left(self) > 0.0_wp) point%text = 'skipped: it was expected to take '//number_text(expected)//' s, and '// &
      number_text(left(self))//' s of the budget were left'
  end subroutine skip

  !> The costly candidates in the order of their cost.
  subroutine begin_second_round(self)
    class(trade_t), intent(inout) :: self
    real(wp) :: expected(size(self%points))
    integer :: i

    do i = 1, size(self%points)
      expected(i) = max(self%points(i)%seconds, expected_seconds(self, self%points(i)%candidate))
    end do
    deallocate (self%order)
    allocate (self%order(count(self%postponed)))
    do i = 1, size(self%order)
      self%order(i) = minloc(expected, dim=1, mask=self%postponed)
      self%postponed(self%order(i)) = .false.
    end do
    self%taken = 0
    self%second_round = .true.
  end subroutine begin_second_round

  !> Why a candidate cannot take the deck's place: its own obstacle, or output that its closed form does not give.
  subroutine find_obstacle(self, candidate, error)
    class(trade_t), intent(in) :: self
    type(candidate_t), intent(in) :: candidate
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t) :: trial
    type(scene_t) :: scene

    if (candidate%obstacle /= '') then
      call raise(error, deck_error, trim(candidate%obstacle))
    else if (method_order(candidate%method) == 0) then
      scene = self%scene
      call apply_candidate(candidate, scene)
      call trial%start(scene, error)
    end if
  end subroutine find_obstacle

  !> Budget left [s].
  real(wp) function left(self)
    class(trade_t), intent(in) :: self

    left = self%budget - self%elapsed()
  end function left

  !> What a candidate is expected to cost [s], from the nearest of its family; 0 if nothing is known.
  pure real(wp) function expected_seconds(self, candidate) result(expected)
    class(trade_t), intent(in) :: self
    type(candidate_t), intent(in) :: candidate
    real(wp), parameter :: rhs_per_step = 4.0_wp
    real(wp) :: ratio, nearest
    integer :: i

    expected = 0.0_wp
    if (candidate%step > 0.0_wp) expected = self%seconds_per_rhs*rhs_per_step*self%scene%t_end/candidate%step
    nearest = huge(1.0_wp)
    do i = 1, size(self%points)
      associate (point => self%points(i))
        if (.not. same_family(point%candidate, candidate) .or. .not. point%seconds > 0.0_wp) cycle
        ratio = 1.0_wp
        if (candidate%step > 0.0_wp) then
          ratio = point%candidate%step/candidate%step
        else if (candidate%rtol > 0.0_wp) then
          ratio = (point%candidate%rtol/candidate%rtol)**(1.0_wp/real(max(1, method_order(candidate%method)), wp))
        end if
        if (abs(log(ratio)) >= nearest) cycle
        nearest = abs(log(ratio))
        expected = point%seconds*ratio
      end associate
    end do
  end function expected_seconds
end module dst_trade
