!> The interface of an integrator to a motion by steps: attempt a step, read the motion inside it, accept it.
module dst_stepper
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_kinds, only: wp, int64
  use dst_linear_solve, only: solve_in_place
  use dst_drive, only: drive_segment_t
  use dst_dense_output, only: dense_output_t, column_u, column_y
  use dst_interpolation, only: max_degree
  use dst_roots, only: bracket_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms
  use dst_state, only: state_t
  use dst_step_control, only: unsolved_factor
  implicit none
  private

  public :: serialise_stepper
  public :: stepper_t, attempt_t, work_count_t

  !> Remaining error of the solution of an implicit method over rtol: far below the error of the method. Twice: 2 to 5 % fewer
  !> iterations on Fig. 3, the same error. Ten times: 7 to 20 % fewer, up to 15 times the error.
  real(wp), parameter :: usual_share = 0.001_wp

  !> The result of an attempted step.
  type :: attempt_t
    logical :: solved = .false.
    !> Estimated error over tolerance; the step is good up to 1.
    real(wp) :: error = huge(1.0_wp)
    !> Factor by which the step size may change.
    real(wp) :: factor = unsolved_factor
  end type attempt_t

  !> Counters of all kinds of work.
  type :: work_count_t
    integer(int64) :: steps = 0
    integer(int64) :: rejected = 0
    integer(int64) :: rhs = 0
    !> Iterations of Newton's method, each with a Jacobian and a factorisation.
    integer(int64) :: newton = 0
    !> Number of steps whose length was solved for, so that they end in a stop.
    integer(int64) :: landings = 0
    integer(int64) :: events = 0
    !> From the cycle map: cycles leapt, cycles run for its tables, excursions taken from an earlier one; its relative error.
    integer(int64) :: cycles_leapt = 0
    integer(int64) :: cycles_sampled = 0
    integer(int64) :: excursions_reused = 0
    real(wp) :: map_error = 0.0_wp
  contains
    procedure :: plus
  end type work_count_t

  !> The last attempt of a method, its length and its polynomials on the nodes of the method; and what goes on from step to step.
  type, extends(dense_output_t) :: stepper_state_t
    type(work_count_t) :: count
    !> Largest slip speed in the attempt [m/s].
    real(wp) :: speed_scale = 0.0_wp
    !> Largest slip speed since the restart [m/s], and recently: the latter decays in the time `memory` [s].
    real(wp) :: start_speed = 0.0_wp
    real(wp) :: peak_speed = 0.0_wp
    !> The power of e by which a disturbance lost in roundoff would have grown in the present stretch of unstable motion.
    real(wp) :: unseen = 0.0_wp
  end type stepper_state_t

  !> A method.
  type, abstract, extends(stepper_state_t) :: stepper_t
    !> Whether it makes disturbances as large as its tolerance at any time.
    logical :: explicit = .false.
    !> Remaining error of the solution of an implicit method, over rtol.
    real(wp) :: newton_share = usual_share
    !> The time in which `peak_speed` decays [s].
    real(wp) :: memory = huge(1.0_wp)
    !> Growth rate [1/s] of a disturbance of steady sliding that is too small to be visible in this attempt, 0 if there is none; and
    !> the share of the slip speed below which a disturbance is not visible.
    real(wp) :: unseen_growth = 0.0_wp
    real(wp) :: noise_floor = epsilon(1.0_wp)
    !> Whether a visible disturbance has grown from roundoff alone.
    logical :: emerged = .false.
    !> Terms of the equations at one point of a turn.
    type(stage_terms_t) :: turn_terms
  contains
    !> Begin again after a discontinuity: y starts with this rate and curvature.
    procedure(restart), deferred :: restart
    !> The same at a release, from rest.
    procedure :: begin_slip
    !> Try one step of length `step` from `from` and, if solved, give its end `to`; with `to_stop` a step of unknown length, near
    !> `step`, that ends where the slip speed vanishes: self%step is its length then. Only implicit methods can do that.
    procedure(attempt), deferred :: attempt
    !> The last attempt has been accepted.
    procedure(accept), deferred :: accept
    !> Save or load everything on which a later attempt depends; a method adds its own data.
    procedure :: serialise => serialise_stepper
    !> Process the slip speed of the accepted step.
    procedure :: note_speed
    !> What the last attempt may have missed where the slip turns back, over tolerance.
    procedure :: error_of_turns
    !> Whether the motion differs visibly from steady sliding.
    procedure :: is_disturbed
    !> Note in an attempt how fast a disturbance grows, and whether it is visible.
    procedure :: look_at_growth
    !> Add the growth of disturbances that were not visible in the accepted step.
    procedure :: note_growth
    procedure :: is_undecided
  end type stepper_t

  abstract interface
    pure subroutine restart(self, rate, curvature)
      import :: stepper_t, wp
      class(stepper_t), intent(inout) :: self
      real(wp), intent(in) :: rate(:), curvature(:)
    end subroutine restart

    subroutine attempt(self, system, drive, from, step, to, outcome, to_stop)
      import :: stepper_t, slip_system_t, drive_segment_t, state_t, attempt_t, wp
      class(stepper_t), intent(inout) :: self
      class(slip_system_t), intent(in) :: system
      type(drive_segment_t), intent(in) :: drive
      type(state_t), intent(in) :: from
      real(wp), intent(in) :: step
      type(state_t), intent(out) :: to
      type(attempt_t), intent(out) :: outcome
      logical, intent(in), optional :: to_stop
    end subroutine attempt

    pure subroutine accept(self)
      import :: stepper_t
      class(stepper_t), intent(inout) :: self
    end subroutine accept
  end interface

contains

  pure subroutine begin_slip(self, rate, curvature)
    class(stepper_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    call self%restart(rate, curvature)
  end subroutine begin_slip

  !> Where the slip turns back, its speed passes through a minimum and friction through its peak, perhaps in such a short time that
  !> no stage is in it. The largest error over tolerance of such turns in the last attempt; `allowed` is the permitted error of the
  !> slip velocity of each component [m/s].
  real(wp) function error_of_turns(self, system, drive, from, allowed) result(error)
    class(stepper_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: allowed(:)
    integer :: i
    !> Share of its neighbour's value from which on a velocity at an end of the step belongs to a turn. Convention; twice: no change
    !> in Fig. 3.
    real(wp), parameter :: close = 0.2_wp

    error = 0.0_wp
    associate (last => column_y + system%unknowns - 1, s => self%grid%degree, c => self%grid%node, y => self%nodal)
      do i = 1, s
        if (system%has_turned(y(i - 1, column_y:last), y(i, column_y:last))) error = max(error, &
          defect_around(turn_between(c(i - 1), c(i))))
      end do
      if (.not. system%turns_back) return
      if (abs(self%nodal(0, column_y)) < close*abs(self%nodal(1, column_y))) &
        error = max(error, defect_around(0.0_wp))
      if (abs(self%nodal(s, column_y)) < close*abs(self%nodal(s - 1, column_y))) &
        error = max(error, defect_around(1.0_wp))
    end associate

  contains

    !> Position between two others at which the slip of the last attempt has turned by a right angle from the first one.
    real(wp) function turn_between(first, last) result(position)
      real(wp), intent(in) :: first, last
      !> 1e-12 of a step: a shorter turn is a point.
      integer, parameter :: halvings = 40
      type(bracket_t) :: bracket
      integer :: iteration

      bracket = bracket_t([first, last], [-1.0_wp, 1.0_wp])
      do iteration = 1, halvings
        position = bracket%middle()
        call bracket%narrow(position, merge(1.0_wp, -1.0_wp, system%has_turned(y_at(first), y_at(position))))
      end do
    end function turn_between

    !> The slip unknowns of the last attempt at a position.
    function y_at(tau) result(y)
      real(wp), intent(in) :: tau
      real(wp) :: y(system%unknowns), basis(0:max_degree)

      call self%grid%lagrange(tau, basis)
      y = matmul(basis(0:self%grid%degree), self%nodal(0:self%grid%degree, column_y:column_y + system%unknowns - 1))
    end function y_at

    !> The defect of the polynomials, B y' - g, summed at distances from a position that are halved again and again: whatever the
    !> width of a peak is, some of these points are in it. The result is an error over tolerance of the slip velocity, with quickly
    !> relaxing components damped.
    real(wp) function defect_around(middle) result(total)
      real(wp), intent(in) :: middle
      integer, parameter :: distances = 24
      !> Share of the step in which a relaxing component decays: about gamma of Radau IIA. Twice: no change in Fig. 3.
      real(wp), parameter :: relaxation = 0.2_wp
      real(wp), dimension(system%components) :: u, velocity
      real(wp), dimension(system%unknowns) :: y, rate, defect
      real(wp) :: velocity_y(system%components, system%unknowns), basis(0:max_degree), slope(0:max_degree)
      real(wp) :: matrix(system%unknowns, system%unknowns)
      logical :: singular
      real(wp) :: distance, place, elapsed, weight
      integer :: j, k, side

      if (.not. allocated(self%turn_terms%force)) self%turn_terms = new_terms(1, system%components, system%unknowns)
      total = 0.0_wp
      distance = 0.5_wp
      associate (n => system%components, m => system%unknowns, s => self%grid%degree, terms => self%turn_terms)
        do j = 1, distances
          distance = 0.5_wp*distance
          do side = -1, 1, 2
            place = middle + real(side, wp)*distance
            if (place < 0.0_wp .or. place > 1.0_wp) cycle
            elapsed = place*self%step
            call self%grid%lagrange(place, basis)
            slope(0:s) = matmul(basis(0:s), self%grid%derivative(0:s, 0:s))
            do k = 1, n
              u(k) = dot_product(basis(0:s), self%nodal(0:s, column_u + system%axis + k - 2)) &
                + system%drive_coupling(system%axis + k - 1)*drive%displacement(from%time, elapsed)
            end do
            do k = 1, m
              y(k) = dot_product(basis(0:s), self%nodal(0:s, column_y + k - 1))
              rate(k) = dot_product(slope(0:s), self%nodal(0:s, column_y + k - 1))
            end do
            call system%kinematics(1, y, velocity, velocity_y)
            call system%dynamics(1, [drive%velocity_at(from%time + elapsed)], u, y, velocity_y, terms)
            do k = 1, m
              weight = abs(terms%inertia(1, k)) &
                + relaxation*self%step*max(0.0_wp, -(terms%force_y(1, k, k) + terms%damping(1, k, k)))
              defect(k) = max(0.0_wp, abs(self%step*terms%force(1, k) - terms%inertia(1, k)*rate(k)) &
                - self%step*system%acceleration_noise)
              if (system%is_damped) then
                matrix(k, 1:m) = relaxation*self%step*terms%damping(1, k, :)
                matrix(k, k) = matrix(k, k) + weight
                defect(k) = sign(defect(k), self%step*terms%force(1, k) - terms%inertia(1, k)*rate(k))
              else
                defect(k) = defect(k)/max(weight, tiny(weight))
              end if
            end do
            ! A damper resists the slip along its axis only.
            if (system%is_damped) then
              call solve_in_place(m, matrix, defect, singular)
              if (singular) cycle
              total = total + distance*maxval(abs(matmul(velocity_y, defect))/max(allowed(1:n), tiny(distance)))
              cycle
            end if
            total = total + distance*maxval(matmul(abs(velocity_y), defect)/max(allowed(1:n), tiny(distance)))
          end do
        end do
      end associate
    end function defect_around
  end function error_of_turns

  !> Whether the motion at the start of the step differs from steady sliding by more than roundoff; under a drive that changes its
  !> velocity, by more than the lag with which steady sliding follows and more than the step's own error. Smaller differences are
  !> numerical, and long steps may damp them. Differences below `least` of the slip speed are never visible, those below
  !> `least_on_ramp` not under such a drive.
  logical function is_disturbed(self, system, drive, from, least, least_on_ramp)
    class(stepper_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: least, least_on_ramp   !! relative to the slip speed
    !> Multiples of roundoff, of the noise of the forces and of the lag behind a ramp that are not disturbances. Conventions, with
    !> room for the sums of a long run; they matter if steady sliding is unstable.
    real(wp), parameter :: roundoff = 200.0_wp*epsilon(1.0_wp), noises = 10.0_wp, lags = 3.0_wp
    real(wp) :: velocity(1, system%components), velocity_y(1, system%components, system%unknowns)
    real(wp) :: coefficient(0:system%components + system%unknowns), weakening, drive_velocity, change, allowed, floor
    integer :: k

    if (.not. allocated(self%turn_terms%force)) self%turn_terms = new_terms(1, system%components, system%unknowns)
    is_disturbed = .false.
    drive_velocity = drive%velocity_at(from%time)
    floor = (roundoff + least)*self%speed_scale
    if (abs(drive%acceleration) > 0.0_wp) floor = floor + least_on_ramp*self%speed_scale
    associate (n => system%components, m => system%unknowns, first => system%axis, &
        last => system%axis + system%components - 1, terms => self%turn_terms)
      call system%kinematics(1, from%y(1:m), velocity, velocity_y)
      call system%dynamics(1, [drive_velocity], from%u(first:last), from%y(1:m), velocity_y, terms)
      call system%decay_polynomial(from%y(1:m), drive_velocity, coefficient, weakening)
      do k = 1, n
        associate (ahead => system%drive_coupling(first + k - 1), frequency => system%frequency(first + k - 1))
          change = sum(velocity_y(1, k, :)*terms%force(1, :)/max(terms%inertia(1, :), tiny(change)))
          allowed = floor + noises*system%acceleration_noise/frequency &
            + lags*abs(drive%acceleration*weakening)/frequency**2
          is_disturbed = is_disturbed .or. abs(velocity(1, k) - drive_velocity*ahead) > allowed &
            .or. abs(change - drive%acceleration*ahead) > allowed*frequency
        end associate
      end do
    end associate
  end function is_disturbed

  !> Note that disturbances grow at this rate [1/s], and whether one is visible. If one appears after a long stretch in which none
  !> was visible, while nothing changes the drive, it has grown from roundoff.
  pure subroutine look_at_growth(self, drive, from, growth, disturbed)
    class(stepper_t), intent(inout) :: self
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: growth
    logical, intent(in) :: disturbed
    !> Growth, as a power of e, that is within roundoff or within those of an explicit method.
    real(wp), parameter :: roundoff_growth = 3.0_wp
    real(wp) :: long

    long = merge(0.0_wp, roundoff_growth, self%explicit)
    self%unseen_growth = merge(0.0_wp, growth, disturbed)
    self%emerged = disturbed .and. self%unseen > long .and. from%time > drive%start .and. .not. abs(drive%acceleration) > 0.0_wp
  end subroutine look_at_growth

  pure subroutine note_speed(self)
    class(stepper_t), intent(inout) :: self

    self%start_speed = max(self%start_speed, self%speed_scale)
    self%peak_speed = max(self%peak_speed/(1.0_wp + self%step/self%memory), self%speed_scale)
  end subroutine note_speed

  pure subroutine note_growth(self)
    class(stepper_t), intent(inout) :: self

    if (self%emerged) then
      self%unseen = huge(self%unseen)
    else
      self%unseen = merge(self%unseen + self%unseen_growth*self%step, 0.0_wp, self%unseen_growth > 0.0_wp)
    end if
    self%emerged = .false.
  end subroutine note_growth

  !> Whether an invisible disturbance would have grown to the size of the motion by now: then the time at which the object leaves
  !> steady sliding depends on disturbances that are below the resolution of the numbers.
  pure logical function is_undecided(self)
    class(stepper_t), intent(in) :: self

    is_undecided = self%unseen > -log(self%noise_floor)
  end function is_undecided

  !> Save or load what every method has.
  subroutine serialise_stepper(self, archive)
    class(stepper_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(c_loc(self%stepper_state_t), storage_size(self%stepper_state_t))
  end subroutine serialise_stepper

  !> The sum of the work of both.
  pure type(work_count_t) function plus(self, other) result(sum)
    class(work_count_t), intent(in) :: self
    type(work_count_t), intent(in) :: other

    sum%steps = self%steps + other%steps
    sum%rejected = self%rejected + other%rejected
    sum%rhs = self%rhs + other%rhs
    sum%newton = self%newton + other%newton
    sum%landings = self%landings + other%landings
    sum%events = self%events + other%events
    sum%cycles_leapt = self%cycles_leapt + other%cycles_leapt
    sum%cycles_sampled = self%cycles_sampled + other%cycles_sampled
    sum%excursions_reused = self%excursions_reused + other%excursions_reused
    sum%map_error = max(self%map_error, other%map_error)
  end function plus
end module dst_stepper
