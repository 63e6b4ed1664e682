!> A piece of a motion as a stretch of which a summary is made.
module dst_piece_view
  use dst_bernstein, only: sign_changes
  use dst_dense_output, only: column_u, column_y
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp, pi
  use dst_motion, only: motion_t
  use dst_piece, only: piece_t, slips
  use dst_slip_system, only: max_components, max_unknowns
  use dst_state, only: state_t
  use dst_stretch, only: moment_t, stretch_t
  implicit none
  private

  public :: piece_view_t, moment_of, friction_of, most_pull_turns

  !> Most points of a piece at which the pull force turns back.
  integer, parameter :: most_pull_turns = max_degree

  !> A piece: the last one, or one that was kept.
  type, extends(stretch_t) :: piece_view_t
    class(motion_t), pointer, private :: motion => null()
    type(piece_t), pointer, private :: piece => null()
  contains
    procedure :: show
    procedure :: at
    procedure :: slip_along
    procedure :: friction
    procedure :: load
    procedure :: pull_polynomial
    procedure, nopass :: pull_turns
    procedure :: pull_at
    procedure :: rate_bounds
    procedure :: least_friction
  end type piece_view_t

contains

  !> Become the view of a piece of a motion.
  subroutine show(self, motion, piece)
    class(piece_view_t), intent(inout) :: self
    class(motion_t), intent(in), target :: motion
    type(piece_t), intent(in), target :: piece

    self%motion => motion
    self%piece => piece
    self%sticking = piece%contact /= slips
    self%first = moment_of(motion, piece, piece%from)
    self%last = moment_of(motion, piece, piece%to)
  end subroutine show

  !> A state in a piece.
  pure function moment_of(motion, piece, state) result(moment)
    class(motion_t), intent(in) :: motion
    type(piece_t), intent(in) :: piece
    type(state_t), intent(in) :: state
    type(moment_t) :: moment

    associate (slider => motion%slider)
      moment%time = state%time
      moment%position = state%position
      moment%slip_velocity = motion%velocity(state)
      moment%rate = dot_product(moment%slip_velocity, slider%along)
      moment%force = slider%stiffness(1)*state%u(1)
      moment%drive_velocity = piece%drive%velocity_at(state%time)
      moment%elongation_rate = slider%free(1)*(moment%drive_velocity*slider%along(1) - moment%slip_velocity(1))
    end associate
  end function moment_of

  function at(self, place) result(moment)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: place
    type(moment_t) :: moment

    if (self%sticking) then
      moment = moment_of(self%motion, self%piece, self%piece%at(self%first%time + place*self%duration()))
    else
      moment = moment_of(self%motion, self%piece, self%piece%inside(place))
    end if
  end function at

  subroutine slip_along(self, place, rate, speed)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: place
    real(wp), intent(out) :: rate, speed
    real(wp) :: velocity(2)

    velocity = self%motion%velocity(self%piece%slip_inside(place))
    rate = dot_product(velocity, self%motion%slider%along)
    speed = hypot(velocity(1), velocity(2))
  end subroutine slip_along

  pure real(wp) function friction(self, speed)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: speed

    friction = friction_of(self%motion, speed)
  end function friction

  !> F(v) [N] at a slip speed [m/s].
  pure real(wp) function friction_of(motion, speed)
    class(motion_t), intent(in) :: motion
    real(wp), intent(in) :: speed
    real(wp) :: force(1), slope(1)

    call motion%slider%law%evaluate(1, [speed], force, slope)
    friction_of = force(1)
  end function friction_of

  pure real(wp) function least_friction(self)
    class(piece_view_t), intent(in) :: self
    real(wp) :: speed(0:max_degree)

    least_friction = self%motion%slider%law%least_force
    if (.not. self%piece%is_polar) return
    call self%piece%path%speed_coefficients(speed)
    least_friction = self%motion%slider%law%least_up_to(maxval(abs(speed(:self%piece%path%grid%degree))))
  end function least_friction

  subroutine load(self, degree, coefficient)
    class(piece_view_t), intent(in) :: self
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)

    call force_polynomial(self, self%motion%slider%stiffness*[1.0_wp, 0.0_wp], .false., degree, coefficient)
  end subroutine load

  !> Degree and Bernstein coefficients of the pull force [N]. In slip with dampers, or along a rigid spring, it is interpolated.
  subroutine pull_polynomial(self, degree, coefficient)
    class(piece_view_t), intent(in) :: self
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)

    associate (slider => self%motion%slider)
      call force_polynomial(self, slider%stiffness*slider%along, slider%is_damped() .or. is_led(self), degree, coefficient)
    end associate
  end subroutine pull_polynomial

  !> The places, in their order, at which the pull force, with these Bernstein coefficients, turns back.
  pure subroutine pull_turns(degree, coefficient, places, count)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:)
    real(wp), intent(out) :: places(most_pull_turns)
    integer, intent(out) :: count

    call sign_changes(degree - 1, coefficient(1:degree) - coefficient(:degree - 1), places, count)
  end subroutine pull_turns

  !> The pull force at a place [N].
  real(wp) function pull_at(self, place)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: place

    if (place <= 0.0_wp) then
      pull_at = pull_in(self, self%piece%from)
    else if (place >= 1.0_wp) then
      pull_at = pull_in(self, self%piece%to)
    else if (self%sticking) then
      pull_at = pull_in(self, self%piece%at(self%first%time + place*self%duration()))
    else
      pull_at = pull_in(self, self%piece%inside(place))
    end if
  end function pull_at

  !> The pull force in a state of the piece [N].
  pure real(wp) function pull_in(self, state)
    class(piece_view_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: force(2), velocity(2), speed

    associate (slider => self%motion%slider, drive => self%piece%drive)
      force = slider%stiffness*state%u
      velocity = 0.0_wp
      if (.not. self%sticking) velocity = self%motion%velocity(state)
      if (is_led(self)) then
        speed = hypot(velocity(1), velocity(2))
        force(2) = friction_of(self%motion, speed)*velocity(2)/sqrt(max(tiny(speed), speed**2 + slider%smoothing)) &
          + slider%mass*slider%along(2)*drive%acceleration
      end if
      pull_in = slider%pull_force(force, drive%velocity_at(state%time), velocity)
    end associate
  end function pull_in

  !> Whether the drive leads the object along the stiff axis: a rigid spring has the force that this needs.
  pure logical function is_led(self)
    class(piece_view_t), intent(in) :: self

    is_led = .not. self%sticking .and. self%piece%held == 2
  end function is_led

  !> Degree and Bernstein coefficients of a sum of forces [N] that are proportional to the elongations, by the factors `per_length`
  !> [N/m]; or of the pull force, interpolated at the nodes of a slip. An elongation is that of the nodes, and the displacement of
  !> the drive, which is quadratic in time.
  subroutine force_polynomial(self, per_length, is_pull, degree, coefficient)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: per_length(2)
    logical, intent(in) :: is_pull
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)
    real(wp) :: free(2), value(0:max_degree), step, straight, curved
    integer :: i

    associate (piece => self%piece, grid => self%piece%path%grid)
      coefficient = dot_product(per_length, piece%from%u)
      degree = 2
      free = per_length
      if (piece%held > 0 .and. .not. is_pull) free(piece%held) = 0.0_wp
      if (.not. any(abs(free) > 0.0_wp)) return
      step = piece%from%until(piece%to%time)
      value = 0.0_wp
      if (.not. self%sticking) then
        step = piece%path%step
        degree = grid%degree
        if (is_pull) then
          value(:degree) = [(pull_in(self, piece%inside(grid%node(i))), i=0, degree)]
        else
          value = free(1)*piece%path%nodal(:, column_u)
          if (abs(free(2)) > 0.0_wp) value = value + free(2)*piece%path%nodal(:, column_u + 1)
          if (piece%held > 0) value = value + per_length(piece%held)*piece%from%u(piece%held)
        end if
        call grid%bernstein_coefficients(value, coefficient)
        if (degree == 1) coefficient(0:2) = [coefficient(0), 0.5_wp*(coefficient(0) + coefficient(1)), coefficient(1)]
        degree = max(2, degree)
        if (is_pull) return
      end if
      straight = dot_product(free, piece%drive_coupling)*step*piece%drive%velocity_at(piece%from%time)
      curved = dot_product(free, piece%drive_coupling)*0.5_wp*step**2*piece%drive%acceleration
      associate (n => real(degree, wp))
        coefficient(0:degree) = coefficient(0:degree) &
          + [(real(i, wp)*straight/n + real(i*(i - 1), wp)*curved/(n*(n - 1.0_wp)), i=0, degree)]
      end associate
      if (.not. is_pull) return
      ! At rest the force of the dampers follows the velocity of the drive.
      associate (damped => dot_product(self%motion%slider%damping, self%motion%slider%along**2), drive => piece%drive)
        coefficient(0:2) = coefficient(0:2) &
          + damped*(drive%velocity_at(piece%from%time) + [0.0_wp, 0.5_wp, 1.0_wp]*step*drive%acceleration)
      end associate
    end associate
  end subroutine force_polynomial

  !> Bounds of |X'| [m/s]. In polar unknowns, X' = v cos(theta - phi), from the ranges of v and theta.
  function rate_bounds(self, enough) result(bounds)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: enough
    real(wp) :: bounds(2), coefficient(0:max_degree), rate(0:max_degree), velocity(2), angle(2)
    type(state_t) :: state
    integer :: i

    bounds = 0.0_wp
    if (self%sticking) return
    associate (path => self%piece%path, s => self%piece%path%grid%degree, along => self%motion%slider%along)
      if (self%piece%is_polar) then
        call path%speed_coefficients(coefficient)
        bounds = [max(0.0_wp, minval(coefficient(:s))), maxval(abs(coefficient(:s)))]
        if (bounds(2) <= enough) return
        call path%grid%bernstein_coefficients(path%nodal(:, column_y + 1), coefficient)
        angle = [minval(coefficient(:s)), maxval(coefficient(:s))] - atan2(along(2), along(1))
        ! The extreme cosines are at the ends, if there is no multiple of pi between, and no zero.
        if (floor(angle(1)/pi) == floor(angle(2)/pi)) bounds(2) = bounds(2)*maxval(abs(cos(angle)))
        bounds(1) = merge(bounds(1)*minval(abs(cos(angle))), 0.0_wp, floor(angle(1)/pi + 0.5_wp) == floor(angle(2)/pi + 0.5_wp))
      else
        state = self%piece%from
        rate = 0.0_wp
        do i = 0, s
          state%y = path%nodal(i, column_y:column_y + max_unknowns - 1)
          if (self%piece%held > 0) state%y(max_components) = self%piece%from%y(max_components)
          state%time = self%first%time + path%grid%node(i)*self%duration()
          velocity = self%motion%velocity(state)
          rate(i) = dot_product(velocity, along)
        end do
        call path%grid%bernstein_coefficients(rate, coefficient)
        bounds = [max(0.0_wp, minval(coefficient(:s)), -maxval(coefficient(:s))), maxval(abs(coefficient(:s)))]
      end if
    end associate
  end function rate_bounds
end module dst_piece_view
