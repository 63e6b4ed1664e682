!> Slow motion of several scenes side by side, one in each lane of the processor's vectors, integrated by dst_lane_step. It is made
!> for loose tolerances, with which a sweep runs many cases.
!>
!> Events inside a step are found on the polynomials of degree 5 that have the values and two derivatives of both ends. Most steps
!> contain no event: the summary does not see these.
!> A lane's result does not depend on its neighbours.
module dst_simd_batch
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, deck_error, step_underflow, too_many_steps, too_many_rejections
  use dst_friction, only: exponential_form
  use dst_lane_step, only: lanes_t, lane_control_t, lane_account_t, lane_count, max_rejections, step_lanes
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_interpolation, only: max_degree
  use dst_stretch, only: moment_t, stretch_t
  use dst_summary, only: summary_t, energies_t, summary_quantities, summary_values
  use dst_text, only: short_text
  implicit none
  private

  public :: simd_batch_t, lane_count

  !> Largest product of step and relaxation rate for which a step resolves the relaxation.
  real(wp), parameter :: longest_relaxation = 10.0_wp
  !> First step over the time scale of the soft spring: the step control finds its own within a few steps. Convention.
  real(wp), parameter :: first_step = 0.01_wp

  !> The cases side by side: `put_case` puts a case into a lane, `advance` continues all cases, and `values`
  !> takes out a case that is `done`.
  type :: simd_batch_t
    private
    !> Which lanes are done, and which of these the method cannot handle; whether a lane's case is new.
    logical, public :: done(lane_count) = .false.
    logical :: refused(lane_count) = .false.
    logical :: is_new = .false.
    type(lanes_t) :: lanes
    real(wp), dimension(lane_count) :: mass = 1.0_wp, first_u = 0.0_wp, second_u = 0.0_wp, first_position = 0.0_wp
    type(summary_t), public :: summary(lane_count)
  contains
    procedure :: put_case
    procedure :: advance
    procedure :: values
  end type simd_batch_t

  !> The last step of a lane, for the summary: u [m] and w [m/s] as polynomials in the share of the step.
  type, extends(stretch_t) :: lane_step_t
    class(simd_batch_t), pointer :: batch => null()
    integer :: lane = 1
    real(wp) :: u(0:5) = 0.0_wp, w(0:5) = 0.0_wp
  contains
    procedure :: at
    procedure :: friction
    procedure :: load
    procedure :: rate_bounds
    procedure :: least_friction
  end type lane_step_t

contains

  !> Put a scene into a free lane. A motion that does not slide all the time is done at once.
  subroutine put_case(self, lane, scene)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    type(scene_t), intent(in) :: scene
    type(slider_t) :: slider

    call slider_from_scene(scene, slider)
    call put_scene(self, lane, scene, slider)
    self%mass(lane) = slider%mass
    self%first_u(lane) = scene%elongation_x
    self%second_u(lane) = scene%elongation_y
    self%first_position(lane) = -dot_product([scene%elongation_x, scene%elongation_y], slider%along)
    associate (point => self%lanes%point(self%lanes%here))
      point%time(lane) = 0.0_wp
      point%u(lane) = scene%elongation_x
      point%w(lane) = scene%velocity_ratio*self%lanes%scene%drive_rate(lane)
    end associate
    call clear(self%lanes%control, self%lanes%account, lane)
    self%lanes%control%next_step(lane) = first_step*sqrt(slider%mass/slider%stiffness(1))
    self%summary(lane) = summary_t()
    call self%summary(lane)%cycles%begin(slider%along(1), slider%law%kinetic_limit, slider%stiffness(1), slider%mass)
    call self%summary(lane)%begin(moment_of(self, lane, self%lanes%here), energy(self, lane), scene%t_end, scene%settle)
    associate (account => self%lanes%account)
      account%half(lane) = self%summary(lane)%half
      account%natural_time(lane) = self%summary(lane)%cycles%natural_time
      account%largest_rate(lane) = self%summary(lane)%largest_rate
      account%watched(lane) = merge(1.0_wp, 0.0_wp, scene%settle > 0.0_wp)
      account%exchanged(lane) = self%summary(lane)%exchanged
    end associate
    self%done(lane) = self%refused(lane)
    self%is_new = .true.
  end subroutine put_case

  !> The numbers of a scene.
  subroutine put_scene(self, lane, scene, slider)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    logical :: is_exponential

    associate (lanes => self%lanes%scene)
      call exponential_form(slider%law, lanes%limit(lane), lanes%drop(lane), lanes%decay(lane), is_exponential)
      self%refused(lane) = .not. (is_exponential .and. .not. slider%is_damped() .and. size(scene%drive_velocity) == 1 &
        .and. abs(scene%drive_velocity(1)*slider%along(2)) > 0.0_wp)
      lanes%busy(lane) = 1.0_wp
      lanes%per_mass(lane) = 1.0_wp/slider%mass
      lanes%stiffness(lane) = slider%stiffness(1)
      lanes%stiffness_per_mass(lane) = slider%stiffness(1)/slider%mass
      lanes%frequency(lane) = sqrt(slider%stiffness(1)/slider%mass)
      lanes%cos_phi(lane) = slider%along(1)
      lanes%sin_phi(lane) = slider%along(2)
      lanes%velocity(lane) = scene%drive_velocity(1)
      lanes%drive_rate(lane) = scene%drive_velocity(1)*slider%along(1)
      lanes%across(lane) = scene%drive_velocity(1)*slider%along(2)
      lanes%t_end(lane) = scene%t_end
      lanes%tolerance(lane) = scene%rtol
      lanes%noise(lane) = slider%acceleration_noise()
      lanes%longest_step(lane) = merge(scene%step_max, scene%t_end, scene%step_max > 0.0_wp)
      lanes%max_steps(lane) = merge(real(scene%max_steps, wp), huge(1.0_wp), scene%max_steps > 0)
    end associate
  end subroutine put_scene

  !> Begin the counts and sums of a lane.
  pure subroutine clear(control, account, lane)
    type(lane_control_t), intent(inout) :: control
    type(lane_account_t), intent(inout) :: account
    integer, intent(in) :: lane

    control%last_root(lane) = 0.0_wp
    control%steps(lane) = 0.0_wp
    control%rejections(lane) = 0.0_wp
    control%standing(lane) = 0.0_wp
    control%gives_up(lane) = 0.0_wp
    account%drive_work(lane) = 0.0_wp
    account%friction_work(lane) = 0.0_wp
    account%has_slipped(lane) = 0.0_wp
    account%quiet_time(lane) = 0.0_wp
    account%quiet_creep(lane) = 0.0_wp
  end subroutine clear

  pure real(wp) function rate_along(self, lane, w)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane
    real(wp), intent(in) :: w

    associate (scene => self%lanes%scene)
      rate_along = scene%cos_phi(lane)*w + scene%sin_phi(lane)*scene%across(lane)
    end associate
  end function rate_along

  !> Kinetic and elastic energy of the motion along the soft axis [J].
  pure real(wp) function energy(self, lane)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane

    associate (now => self%lanes%point(self%lanes%here))
      energy = 0.5_wp*(self%mass(lane)*now%w(lane)**2 + self%lanes%scene%stiffness(lane)*now%u(lane)**2)
    end associate
  end function energy

  !> One attempted step in every lane.
  subroutine advance(self)
    class(simd_batch_t), intent(inout) :: self
    integer :: i

    if (self%is_new) call step_lanes(self%lanes, .false.)
    self%is_new = .false.
    call step_lanes(self%lanes, .true.)
    associate (account => self%lanes%account, control => self%lanes%control)
      do i = 1, lane_count
        if (account%notes(i) > 0.0_wp) call take_in(self, i)
        if (control%gives_up(i) > 0.0_wp) self%done(i) = .true.
      end do
    end associate
  end subroutine advance

  !> Add the last step of a lane to the summary, after the steps that were left out.
  subroutine take_in(self, lane)
    class(simd_batch_t), intent(inout), target :: self
    integer, intent(in) :: lane
    type(lane_step_t) :: step

    call last_step(self, lane, step)
    call catch_up(self, lane, step%first)
    associate (account => self%lanes%account, summary => self%summary(lane))
      call summary%take_in(step)
      account%largest_rate(lane) = summary%largest_rate
      account%has_slipped(lane) = merge(1.0_wp, 0.0_wp, summary%has_slipped)
      self%lanes%scene%t_end(lane) = min(self%lanes%scene%t_end(lane), summary%end_at)
      self%done(lane) = step%last%time >= self%lanes%scene%t_end(lane)
    end associate
  end subroutine take_in

  !> Add the steps that were left out to the summary, up to a moment.
  subroutine catch_up(self, lane, moment)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    type(moment_t), intent(in) :: moment

    associate (account => self%lanes%account)
      call self%summary(lane)%pass_over(moment, account%quiet_time(lane), account%quiet_creep(lane))
      self%summary(lane)%largest_rate = account%largest_rate(lane)
      account%quiet_time(lane) = 0.0_wp
      account%quiet_creep(lane) = 0.0_wp
    end associate
  end subroutine catch_up

  !> The state of a lane at one of the two points.
  pure type(moment_t) function moment_of(self, i, point) result(moment)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: i, point

    associate (now => self%lanes%point(point))
      moment = moment_at(self, i, now%time(i), now%u(i), now%w(i))
    end associate
  end function moment_of

  !> The state of a lane at a time [s], from u [m] and w [m/s]. X is the displacement of the drive minus the elongation.
  pure type(moment_t) function moment_at(self, i, time, u, w) result(moment)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: i
    real(wp), intent(in) :: time, u, w

    associate (scene => self%lanes%scene)
      moment = moment_t(time, self%first_position(i) + scene%velocity(i)*time - scene%cos_phi(i)*(u - self%first_u(i)), &
        rate_along(self, i, w), [w, scene%across(i)], scene%stiffness(i)*u, scene%drive_rate(i) - w, scene%velocity(i))
    end associate
  end function moment_at

  !> The last step of a lane. If it steps over the relaxation of the slip velocity, the rates at the ends say nothing about the
  !> motion between them.
  subroutine last_step(self, lane, step)
    class(simd_batch_t), intent(in), target :: self
    integer, intent(in) :: lane
    type(lane_step_t), intent(out) :: step
    real(wp) :: h

    step%batch => self
    step%lane = lane
    step%first = moment_of(self, lane, 3 - self%lanes%here)
    step%last = moment_of(self, lane, self%lanes%here)
    h = self%lanes%control%step(lane)
    associate (i => lane, from => self%lanes%point(3 - self%lanes%here), to => self%lanes%point(self%lanes%here))
      if (h*max(abs(from%growth(i)), abs(to%growth(i))) <= longest_relaxation) then
        step%u = quintic([from%u(i), h*from%u_rate(i), -h**2*from%w_rate(i)], [to%u(i), h*to%u_rate(i), -h**2*to%w_rate(i)])
        step%w = quintic([from%w(i), h*from%w_rate(i), h**2*from%w_curvature(i)], &
          [to%w(i), h*to%w_rate(i), h**2*to%w_curvature(i)])
      else
        step%u = cubic([from%u(i), h*from%u_rate(i)], [to%u(i), h*to%u_rate(i)])
        step%w(0:1) = [from%w(i), to%w(i) - from%w(i)]
      end if
    end associate
  end subroutine last_step

  function at(self, place) result(moment)
    class(lane_step_t), intent(in) :: self
    real(wp), intent(in) :: place
    type(moment_t) :: moment

    moment = moment_at(self%batch, self%lane, self%first%time + place*self%duration(), value_of(self%u, place), &
      value_of(self%w, place))
  end function at

  subroutine load(self, degree, coefficient)
    class(lane_step_t), intent(in) :: self
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)

    degree = 5
    coefficient(0:5) = self%batch%lanes%scene%stiffness(self%lane)*bernstein_from(self%u)
  end subroutine load

  function rate_bounds(self, enough) result(bounds)
    class(lane_step_t), intent(in) :: self
    real(wp), intent(in) :: enough
    real(wp) :: bounds(2), w(0:5)
    integer :: i

    associate (unused => enough)
    end associate
    w = bernstein_from(self%w)
    bounds = [0.0_wp, maxval([(abs(rate_along(self%batch, self%lane, w(i))), i=0, 5)])]
  end function rate_bounds

  pure real(wp) function least_friction(self)
    class(lane_step_t), intent(in) :: self

    associate (scene => self%batch%lanes%scene, i => self%lane)
      least_friction = scene%limit(i) + min(0.0_wp, scene%drop(i))
    end associate
  end function least_friction

  !> Bernstein coefficients of the polynomial with these coefficients of powers: c_i = sum_j p_j binomial(i, j)/binomial(5, j).
  pure function bernstein_from(p) result(coefficient)
    real(wp), intent(in) :: p(0:5)
    real(wp) :: coefficient(0:5)
    integer :: i, k

    coefficient = p/real([1, 5, 10, 10, 5, 1], wp)
    do k = 1, 5
      do i = 5, k, -1
        coefficient(i) = coefficient(i) + coefficient(i - 1)
      end do
    end do
  end function bernstein_from

  pure real(wp) function friction(self, speed)
    class(lane_step_t), intent(in) :: self
    real(wp), intent(in) :: speed

    associate (scene => self%batch%lanes%scene, i => self%lane)
      friction = scene%limit(i) + scene%drop(i)*exp(-speed*scene%decay(i))
    end associate
  end function friction

  !> Coefficients of the polynomial with these values, slopes and curvatures at 0 and 1.
  pure function quintic(first, last) result(p)
    real(wp), intent(in) :: first(3), last(3)
    real(wp) :: p(0:5), rest, slope, curve

    p(0:2) = [first(1), first(2), 0.5_wp*first(3)]
    rest = last(1) - sum(p(0:2))
    slope = last(2) - p(1) - 2.0_wp*p(2)
    curve = last(3) - first(3)
    p(3) = 10.0_wp*rest - 4.0_wp*slope + 0.5_wp*curve
    p(4) = -15.0_wp*rest + 7.0_wp*slope - curve
    p(5) = 6.0_wp*rest - 3.0_wp*slope + 0.5_wp*curve
  end function quintic

  !> Coefficients of the polynomial with these values and slopes at 0 and 1.
  pure function cubic(first, last) result(p)
    real(wp), intent(in) :: first(2), last(2)
    real(wp) :: p(0:5)

    p = 0.0_wp
    p(0:1) = first
    p(2) = 3.0_wp*(last(1) - first(1)) - 2.0_wp*first(2) - last(2)
    p(3) = -2.0_wp*(last(1) - first(1)) + first(2) + last(2)
  end function cubic

  pure real(wp) function value_of(p, tau)
    real(wp), intent(in) :: p(0:5), tau

    value_of = p(0) + tau*(p(1) + tau*(p(2) + tau*(p(3) + tau*(p(4) + tau*p(5)))))
  end function value_of

  !> The result of a lane that is done, and is free then: the summary's values, NaN if they do not exist, u_x, u_y, X and X' at
  !> the end, and the number of steps; or why it did not reach the end.
  subroutine values(self, lane, summary, final, steps, error)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    real(wp), intent(out) :: summary(size(summary_quantities)), final(4)
    integer(int64), intent(out) :: steps
    type(error_t), allocatable, intent(out) :: error
    type(moment_t) :: moment

    moment = moment_of(self, lane, self%lanes%here)
    call catch_up(self, lane, moment)
    associate (account => self%lanes%account, scene => self%lanes%scene, u => self%lanes%point(self%lanes%here)%u(lane))
      self%summary(lane)%exchanged = account%exchanged(lane)
      call summary_values(self%summary(lane), summary, energies_t(self%summary(lane)%first_energy, energy(self, lane), &
        account%drive_work(lane), account%friction_work(lane)))
      final = [u, self%second_u(lane), moment%position, moment%rate]
      steps = int(self%lanes%control%steps(lane), int64)
      if (moment%time < scene%t_end(lane)) call explain(self, lane, error)
      scene%busy(lane) = 0.0_wp
    end associate
    self%done(lane) = .false.
  end subroutine values

  !> Why a lane has stopped before its end.
  subroutine explain(self, lane, error)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane
    type(error_t), allocatable, intent(out) :: error
    character(24) :: place

    if (self%refused(lane)) then
      call raise(error, deck_error, "method 'rodas4p' follows sliding without rest, driven steadily with V sin(phi) /= 0, "// &
        'without dampers, and friction that falls exponentially: use radau9')
      return
    end if
    associate (control => self%lanes%control, max_steps => self%lanes%scene%max_steps(lane))
      place = 't = '//trim(short_text(self%lanes%point(self%lanes%here)%time(lane)))//' s'
      if (control%steps(lane) >= max_steps) then
        call raise(error, too_many_steps, 'integrator.max_steps reached at '//trim(place)//': raise it, or use a larger rtol')
      else if (control%rejections(lane) > max_rejections) then
        call raise(error, too_many_rejections, 'too many rejected steps at '//trim(place)//': use another method or a larger rtol')
      else
        call raise(error, step_underflow, 'the step vanishes at '//trim(place)//': use another method or a larger rtol')
      end if
    end associate
  end subroutine explain
end module dst_simd_batch
