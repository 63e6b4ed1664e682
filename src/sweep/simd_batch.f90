!> Slow motion of several scenes side by side, one in each lane of the processor's vectors.
!>
!> The equations are those of dst_low_frequency for a steady drive, with v = sqrt(w^2 + (V s)^2),
!>
!>     u' = V c - w,      w' = (k u - F(v) w/v)/m =: f(u, w),
!>
!> and the method is RODAS4P, linearly implicit of order 4(3): with J the Jacobian at the start of a step of length h,
!>
!>     (1/(gamma h) - J) k_i = f(z_0 + sum_j a_ij k_j) + sum_j c_ij k_j/h,      z_1 = z_0 + sum_i b_i k_i.
!>
!> It needs no iteration, so that every lane does the same at the same time, each with its own step. It is made for loose
!> tolerances, where a sweep wants many cases. The elongation is eliminated by hand: what is solved is a division.
!>
!> What happens inside a step is read from the polynomials of degree 5 that have the values and two derivatives of both ends.
!> A lane's result does not depend on its neighbours.
!>
!> Source: Steinebach (1995), Preprint 1741, TH Darmstadt; Hairer & Wanner II, Sec. IV.7.
module dst_simd_batch
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, raise, deck_error, step_underflow, too_many_steps, too_many_rejections
  use dst_friction, only: exponential_form
  use dst_low_frequency, only: slow_forces
  use dst_rodas4p, only: stages, order, gamma, a, c
  use dst_scene, only: scene_t
  use dst_assembly, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_step_control, only: step_control_t, new_step_control, shortened, no_number
  use dst_summary, only: summary_t, energies_t, moment_t, stretch_t, summary_quantities, summary_values
  use dst_text, only: short_text
  implicit none
  private

  public :: simd_batch_t, lane_count

  !> Cases side by side.
  integer, parameter :: lane_count = 8

  !> Step times growth rate up to which the growth of unstable creep is followed, as in dst_radau.
  real(wp), parameter :: longest_growth = 2.0_wp
  !> An oscillation of frequency omega loses 1.8e-5 (h omega)**6 of itself in a step: a hundredth of its growth at most. Below
  !> h omega = 0.5 that does not matter to any growth.
  real(wp), parameter :: growth_accuracy = 1.0e-2_wp/1.8e-5_wp, small_angle = 0.5_wp
  !> Step times relaxation rate up to which a step resolves the relaxation.
  real(wp), parameter :: longest_relaxation = 10.0_wp
  !> Largest factor between steps. Convention.
  real(wp), parameter :: largest_factor = 6.0_wp
  !> First step over the time scale of the soft spring: the control finds its own within a few. Convention.
  real(wp), parameter :: first_step = 0.01_wp
  !> A step that would leave less than this share of itself to the end goes there. Convention.
  real(wp), parameter :: sliver = 1.0e-6_wp
  !> Rejections of one step, and steps below the resolution of the time, after which a lane gives up.
  integer, parameter :: max_rejections = 60, max_standing = 10000

  !> What belongs to the start of a step.
  type :: step_start_t
    real(wp), dimension(lane_count) :: time = 0.0_wp, u = 0.0_wp, w = 1.0_wp
    !> u', w', w'' and dw'/dw.
    real(wp), dimension(lane_count) :: u_rate = 0.0_wp, w_rate = 0.0_wp, w_curvature = 0.0_wp, growth = 0.0_wp
    !> Powers of drive and friction [W] and their rates.
    real(wp), dimension(lane_count) :: supply = 0.0_wp, supply_rate = 0.0_wp, dissipation = 0.0_wp, dissipation_rate = 0.0_wp
  end type step_start_t

  !> The cases side by side: `put_case` puts one in a lane, `advance` goes on with all, `values` takes out what is `done`.
  type :: simd_batch_t
    private
    !> Which lanes have a case, and which of these are done.
    logical :: busy(lane_count) = .false.
    logical, public :: done(lane_count) = .false.
    ! Of the scenes; refused are those that the method cannot follow.
    logical :: refused(lane_count) = .false.
    real(wp), dimension(lane_count) :: mass = 1.0_wp, stiffness = 1.0_wp, cos_phi = 1.0_wp, across = 0.0_wp
    real(wp), dimension(lane_count) :: velocity = 0.0_wp, sin_phi = 1.0_wp
    real(wp), dimension(lane_count) :: limit = 0.0_wp, drop = 0.0_wp, decay = 0.0_wp
    real(wp), dimension(lane_count) :: t_end = 0.0_wp, tolerance = 1.0_wp, noise = 0.0_wp, longest_step = 0.0_wp
    real(wp), dimension(lane_count) :: first_u = 0.0_wp, second_u = 0.0_wp, first_position = 0.0_wp
    integer(int64) :: max_steps(lane_count) = 0
    ! Of the motion.
    type(step_start_t) :: now, before
    type(moment_t) :: moment(lane_count)              !! at `before`
    logical :: moved(lane_count) = .false.            !! since `before`
    real(wp), dimension(lane_count) :: next_step = 1.0_wp
    type(step_control_t) :: control(lane_count)
    real(wp), dimension(lane_count) :: drive_work = 0.0_wp, friction_work = 0.0_wp
    integer(int64) :: steps(lane_count) = 0
    integer :: rejections(lane_count) = 0, standing(lane_count) = 0
    type(summary_t) :: summary(lane_count)
  contains
    procedure :: put_case
    procedure :: advance
    procedure :: values
  end type simd_batch_t

  !> The last step of a lane, as the summary sees it.
  type, extends(stretch_t) :: lane_step_t
    class(simd_batch_t), pointer :: lanes => null()
    integer :: lane = 1
  contains
    procedure :: at
    procedure :: friction
  end type lane_step_t

contains

  !> Put a scene into a free lane. What does not slide all the time is done at once.
  subroutine put_case(self, lane, scene)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    type(scene_t), intent(in) :: scene
    type(slider_t) :: slider
    logical :: is_exponential

    call slider_from_scene(scene, slider)
    call exponential_form(slider%law, self%limit(lane), self%drop(lane), self%decay(lane), is_exponential)
    self%refused(lane) = .not. (is_exponential .and. size(scene%drive_velocity) == 1 &
      .and. abs(scene%drive_velocity(1)*slider%along(2)) > 0.0_wp)
    self%mass(lane) = slider%mass
    self%stiffness(lane) = slider%stiffness(1)
    self%cos_phi(lane) = slider%along(1)
    self%sin_phi(lane) = slider%along(2)
    self%velocity(lane) = scene%drive_velocity(1)
    self%across(lane) = self%velocity(lane)*slider%along(2)
    self%t_end(lane) = scene%t_end
    self%tolerance(lane) = scene%rtol
    self%noise(lane) = slider%acceleration_noise()
    self%longest_step(lane) = merge(scene%step_max, scene%t_end, scene%step_max > 0.0_wp)
    self%max_steps(lane) = scene%max_steps
    self%first_u(lane) = scene%elongation_x
    self%second_u(lane) = scene%elongation_y
    self%first_position(lane) = -dot_product([scene%elongation_x, scene%elongation_y], slider%along)
    self%now%time(lane) = 0.0_wp
    self%now%u(lane) = scene%elongation_x
    self%now%w(lane) = scene%velocity_ratio*scene%drive_velocity(1)*slider%along(1)
    self%now%u_rate(lane) = self%velocity(lane)*self%cos_phi(lane) - self%now%w(lane)
    self%moment(lane) = moment_of(self, lane)
    self%summary(lane) = summary_t()
    call self%summary(lane)%cycles%begin(slider%along(1), slider%law%static_limit, slider%stiffness(1), slider%mass)
    call self%summary(lane)%begin(self%moment(lane), energy(self, lane), scene%t_end, scene%settle)
    self%busy(lane) = .true.
    self%done(lane) = self%refused(lane)
    self%moved(lane) = .false.
    self%next_step(lane) = first_step*sqrt(self%mass(lane)/self%stiffness(lane))
    self%control(lane) = new_step_control(order, largest_factor, predicts=.true., by_square_roots=.true.)
    self%drive_work(lane) = 0.0_wp
    self%friction_work(lane) = 0.0_wp
    self%steps(lane) = 0
    self%rejections(lane) = 0
    self%standing(lane) = 0
  end subroutine put_case

  pure real(wp) function rate_along(self, lane, w)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane
    real(wp), intent(in) :: w

    rate_along = self%cos_phi(lane)*w + self%sin_phi(lane)*self%across(lane)
  end function rate_along

  !> X, from what the drive moved and the spring did not follow.
  pure real(wp) function position_of(self, lane, time, u)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane
    real(wp), intent(in) :: time, u

    position_of = self%first_position(lane) + self%velocity(lane)*time - self%cos_phi(lane)*(u - self%first_u(lane))
  end function position_of

  !> Kinetic and elastic energy of the motion along the soft axis [J].
  pure real(wp) function energy(self, lane)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: lane

    energy = 0.5_wp*(self%mass(lane)*self%now%w(lane)**2 + self%stiffness(lane)*self%now%u(lane)**2)
  end function energy

  !> One attempted step in every lane, unless a lane has just come to its end: then that is `done`.
  subroutine advance(self)
    class(simd_batch_t), intent(inout) :: self

    call evaluate_start(self)
    call take_in(self)
    if (any(self%busy .and. self%done)) return
    call attempt(self)
  end subroutine advance

  !> Everything that is known at the points where the lanes are.
  subroutine evaluate_start(self)
    class(simd_batch_t), intent(inout) :: self
    real(wp), dimension(lane_count) :: pull, speed, friction, slope, force, damping, dissipation_w, supply, supply_w
    real(wp) :: part
    integer :: i

    associate (now => self%now)
      do i = 1, lane_count
        pull(i) = self%stiffness(i)*now%u(i)
        speed(i) = sqrt(now%w(i)**2 + self%across(i)**2)
        part = weakening(self%drop(i), self%decay(i), speed(i))
        friction(i) = self%limit(i) + part
        slope(i) = -self%decay(i)*part
      end do
      call slow_forces(lane_count, pull, now%w, self%across, speed, friction, slope, force, damping, &
        now%dissipation, dissipation_w, supply, supply_w)
      do i = 1, lane_count
        now%u_rate(i) = self%velocity(i)*self%cos_phi(i) - now%w(i)
        now%w_rate(i) = force(i)/self%mass(i)
        now%growth(i) = -damping(i)/self%mass(i)
        now%w_curvature(i) = self%stiffness(i)/self%mass(i)*now%u_rate(i) + now%growth(i)*now%w_rate(i)
        now%supply(i) = self%velocity(i)*self%cos_phi(i)*self%stiffness(i)*now%u(i) + supply(i)
        now%supply_rate(i) = self%velocity(i)*self%cos_phi(i)*self%stiffness(i)*now%u_rate(i) + supply_w(i)*now%w_rate(i)
        now%dissipation_rate(i) = dissipation_w(i)*now%w_rate(i)
      end do
    end associate
  end subroutine evaluate_start

  !> Works, extremes and ends, in the lanes that have moved.
  subroutine take_in(self)
    class(simd_batch_t), intent(inout), target :: self
    type(lane_step_t) :: step
    integer :: i

    step%lanes => self
    step%parts = 2
    do i = 1, lane_count
      if (.not. (self%busy(i) .and. self%moved(i))) cycle
      call take_works(self, i)
      step%lane = i
      step%first = self%moment(i)
      step%last = moment_of(self, i)
      self%moment(i) = step%last
      call self%summary(i)%take_in(step)
      self%moved(i) = .false.
      self%done(i) = self%now%time(i) >= self%t_end(i) .or. self%summary(i)%settled_at >= 0.0_wp
    end do
    self%before = self%now
  end subroutine take_in

  !> Powers integrated with the trapezium's rule and its correction from the slopes at both ends, of order 4.
  pure subroutine take_works(self, i)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: i
    real(wp) :: h, drive_work, friction_work

    associate (from => self%before, to => self%now)
      h = self%control(i)%last_step
      drive_work = 0.5_wp*h*(from%supply(i) + to%supply(i) + h/6.0_wp*(from%supply_rate(i) - to%supply_rate(i)))
      friction_work = 0.5_wp*h*(from%dissipation(i) + to%dissipation(i) &
        + h/6.0_wp*(from%dissipation_rate(i) - to%dissipation_rate(i)))
    end associate
    self%drive_work(i) = self%drive_work(i) + drive_work
    self%friction_work(i) = self%friction_work(i) + friction_work
    self%summary(i)%exchanged = self%summary(i)%exchanged + abs(drive_work) + abs(friction_work)
  end subroutine take_works

  !> Where a lane is.
  pure type(moment_t) function moment_of(self, i) result(moment)
    class(simd_batch_t), intent(in) :: self
    integer, intent(in) :: i

    associate (now => self%now)
      moment = moment_t(now%time(i), position_of(self, i, now%time(i), now%u(i)), rate_along(self, i, now%w(i)), &
        [now%w(i), self%across(i)], self%stiffness(i)*now%u(i), self%stiffness(i)*now%u_rate(i), self%velocity(i))
    end associate
  end function moment_of

  !> Inside a step u and w are polynomials in its share. Where it passes over the relaxation of the slip velocity, the rates at the
  !> ends say nothing of what is between them.
  function at(self, time) result(moment)
    class(lane_step_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(moment_t) :: moment
    real(wp) :: h, tau, u, w, p(0:5), q(0:5)

    associate (lanes => self%lanes, i => self%lane, from => self%lanes%before, to => self%lanes%now)
      h = lanes%control(i)%last_step
      if (h*max(abs(from%growth(i)), abs(to%growth(i))) <= longest_relaxation) then
        p = quintic([from%u(i), h*from%u_rate(i), -h**2*from%w_rate(i)], [to%u(i), h*to%u_rate(i), -h**2*to%w_rate(i)])
        q = quintic([from%w(i), h*from%w_rate(i), h**2*from%w_curvature(i)], [to%w(i), h*to%w_rate(i), h**2*to%w_curvature(i)])
      else
        p = cubic([from%u(i), h*from%u_rate(i)], [to%u(i), h*to%u_rate(i)])
        q = [from%w(i), to%w(i) - from%w(i), 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
      end if
      tau = (time - from%time(i))/h
      u = value_of(p, tau)
      w = value_of(q, tau)
      moment = moment_t(time, position_of(lanes, i, time, u), rate_along(lanes, i, w), [w, lanes%across(i)], &
        lanes%stiffness(i)*u, lanes%stiffness(i)*slope_of(p, tau)/h, lanes%velocity(i))
    end associate
  end function at

  pure real(wp) function friction(self, speed)
    class(lane_step_t), intent(in) :: self
    real(wp), intent(in) :: speed

    associate (lanes => self%lanes, i => self%lane)
      friction = lanes%limit(i) + weakening(lanes%drop(i), lanes%decay(i), speed)
    end associate
  end function friction

  !> What friction has above its limit. It stands here, not in dst_friction, for the compiler's vectors.
  elemental real(wp) function weakening(drop, decay, speed)
    real(wp), intent(in) :: drop, decay, speed

    weakening = drop*exp(-speed*decay)
  end function weakening

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

  pure real(wp) function slope_of(p, tau)
    real(wp), intent(in) :: p(0:5), tau

    slope_of = p(1) + tau*(2.0_wp*p(2) + tau*(3.0_wp*p(3) + tau*(4.0_wp*p(4) + tau*5.0_wp*p(5))))
  end function slope_of

  !> One attempt in all lanes. Idle lanes go through the motions.
  subroutine attempt(self)
    class(simd_batch_t), intent(inout) :: self
    real(wp), dimension(lane_count, stages) :: k_u, k_w
    real(wp), dimension(lane_count) :: h, u, w, sum_u, sum_w, speed, friction, fastest, pivot, error
    integer :: i, j, l

    associate (now => self%now)
      do l = 1, lane_count
        h(l) = min(self%next_step(l), self%longest_step(l))
        if (now%time(l) + (1.0_wp + sliver)*h(l) >= self%t_end(l)) h(l) = self%t_end(l) - now%time(l)
        if (.not. (self%busy(l) .and. h(l) > 0.0_wp)) h(l) = 1.0_wp
        pivot(l) = gamma*h(l)/(1.0_wp - gamma*h(l)*(now%growth(l) - gamma*h(l)*self%stiffness(l)/self%mass(l)))
        k_w(l, 1) = pivot(l)*(now%w_rate(l) + gamma*h(l)*self%stiffness(l)/self%mass(l)*now%u_rate(l))
        k_u(l, 1) = gamma*h(l)*(now%u_rate(l) - k_w(l, 1))
        fastest(l) = sqrt(now%w(l)**2 + self%across(l)**2)
      end do
      do i = 2, stages
        u = now%u
        w = now%w
        sum_u = 0.0_wp
        sum_w = 0.0_wp
        do j = 1, i - 1
          do l = 1, lane_count
            u(l) = u(l) + a(i, j)*k_u(l, j)
            w(l) = w(l) + a(i, j)*k_w(l, j)
            sum_u(l) = sum_u(l) + c(i, j)*k_u(l, j)
            sum_w(l) = sum_w(l) + c(i, j)*k_w(l, j)
          end do
        end do
        do l = 1, lane_count
          speed(l) = sqrt(w(l)**2 + self%across(l)**2)
          friction(l) = self%limit(l) + weakening(self%drop(l), self%decay(l), speed(l))
        end do
        do l = 1, lane_count
          sum_u(l) = self%velocity(l)*self%cos_phi(l) - w(l) + sum_u(l)/h(l)
          sum_w(l) = (self%stiffness(l)*u(l) - friction(l)*w(l)/speed(l))/self%mass(l) + sum_w(l)/h(l)
          k_w(l, i) = pivot(l)*(sum_w(l) + gamma*h(l)*self%stiffness(l)/self%mass(l)*sum_u(l))
          k_u(l, i) = gamma*h(l)*(sum_u(l) - k_w(l, i))
          fastest(l) = max(fastest(l), speed(l))
        end do
      end do
      ! The method is stiffly accurate: the last stage's increment is the difference to the embedded solution.
      do l = 1, lane_count
        u(l) = u(l) + k_u(l, stages)
        w(l) = w(l) + k_w(l, stages)
        error(l) = sqrt(k_w(l, stages)**2 + self%stiffness(l)/self%mass(l)*k_u(l, stages)**2) &
          /(self%tolerance(l)*fastest(l) + self%noise(l)*pivot(l)/gamma)
      end do
    end associate
    do l = 1, lane_count
      if (self%busy(l)) call decide(self, l, h(l), u(l), w(l), error(l))
    end do
  end subroutine attempt

  !> Accept or reject the attempt of a lane, and choose its next step.
  pure subroutine decide(self, l, h, u, w, estimate)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: l
    real(wp), intent(in) :: h, u, w, estimate
    real(wp) :: error, factor, growth, angle, largest_angle

    error = estimate
    if (.not. abs(u) + abs(w) <= huge(u)) error = no_number
    call self%control(l)%advise(h, self%rejections(l) > 0, error, factor)
    growth = h*self%now%growth(l)
    if (growth > longest_growth) then
      factor = min(factor, shortened(longest_growth, growth))
      error = max(error, growth/longest_growth)
    end if
    angle = h*sqrt(self%stiffness(l)/self%mass(l))
    if (growth > 0.0_wp .and. angle > small_angle) then
      largest_angle = (growth_accuracy*min(1.0_wp, 0.5_wp*growth/angle))**0.2_wp
      factor = min(factor, shortened(largest_angle, angle))
      if (angle > largest_angle) error = max(error, angle/largest_angle)
    end if
    self%next_step(l) = h*factor
    if (error > 1.0_wp) then
      self%rejections(l) = self%rejections(l) + 1
      self%done(l) = self%rejections(l) > max_rejections
      return
    end if
    self%standing(l) = merge(0, self%standing(l) + 1, self%now%time(l) + h > self%now%time(l))
    self%now%time(l) = self%now%time(l) + h
    if (self%now%time(l) + sliver*h >= self%t_end(l)) self%now%time(l) = self%t_end(l)
    self%now%u(l) = u
    self%now%w(l) = w
    self%moved(l) = .true.
    call self%control(l)%accept(h)
    self%rejections(l) = 0
    self%steps(l) = self%steps(l) + 1
    self%done(l) = self%standing(l) > max_standing .or. &
      (self%max_steps(l) > 0 .and. self%steps(l) >= self%max_steps(l) .and. self%now%time(l) < self%t_end(l))
  end subroutine decide

  !> What a lane that is done came to, which is free then: the summary's values, whether they exist, u_x, u_y, X and X' at
  !> the end, and the number of steps; or why it did not get there.
  subroutine values(self, lane, summary, given, final, steps, error)
    class(simd_batch_t), intent(inout) :: self
    integer, intent(in) :: lane
    real(wp), intent(out) :: summary(size(summary_quantities)), final(4)
    logical, intent(out) :: given(size(summary_quantities))
    integer(int64), intent(out) :: steps
    type(error_t), allocatable, intent(out) :: error

    associate (time => self%now%time(lane), u => self%now%u(lane))
      call summary_values(self%summary(lane), summary, given, energies_t(self%summary(lane)%first_energy, energy(self, lane), &
        self%drive_work(lane), self%friction_work(lane)))
      final = [u, self%second_u(lane), position_of(self, lane, time, u), rate_along(self, lane, self%now%w(lane))]
      steps = self%steps(lane)
      if (time < self%t_end(lane) .and. self%summary(lane)%settled_at < 0.0_wp) call explain(self, lane, error)
    end associate
    self%busy(lane) = .false.
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
        'and friction that falls exponentially: use radau9')
      return
    end if
    place = 't = '//trim(short_text(self%now%time(lane)))//' s'
    if (self%max_steps(lane) > 0 .and. self%steps(lane) >= self%max_steps(lane)) then
      call raise(error, too_many_steps, 'integrator.max_steps reached at '//trim(place)//': raise it, or use a larger rtol')
    else if (self%rejections(lane) > max_rejections) then
      call raise(error, too_many_rejections, 'too many rejected steps at '//trim(place)//': use another method or a larger rtol')
    else
      call raise(error, step_underflow, 'the step vanishes at '//trim(place)//': use another method or a larger rtol')
    end if
  end subroutine explain
end module dst_simd_batch
