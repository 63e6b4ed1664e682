!> A piece of a motion as a stretch of which a summary is made.
module dst_piece_view
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

  public :: piece_view_t, moment_of, friction_of

  !> A piece: the last one, or one that was kept.
  type, extends(stretch_t) :: piece_view_t
    class(motion_t), pointer, private :: motion => null()
    type(piece_t), pointer, private :: piece => null()
  contains
    procedure :: show
    procedure :: at
    procedure :: friction
    procedure :: load
    procedure :: fastest
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

    least_friction = self%motion%slider%law%least_force
  end function least_friction

  !> The elongation is that of the nodes, and the displacement of the drive, which is quadratic in time.
  subroutine load(self, degree, coefficient)
    class(piece_view_t), intent(in) :: self
    integer, intent(out) :: degree
    real(wp), intent(out) :: coefficient(0:max_degree)
    real(wp) :: step, straight, curved
    integer :: i

    associate (piece => self%piece, grid => self%piece%path%grid, k => self%motion%slider%stiffness(1))
      coefficient = k*piece%from%u(1)
      degree = 2
      if (piece%held == 1) return
      step = piece%from%until(piece%to%time)
      if (.not. self%sticking) then
        step = piece%path%step
        degree = grid%degree
        call grid%bernstein_coefficients(k*piece%path%nodal(:, column_u), coefficient)
        if (degree == 1) coefficient(0:2) = [coefficient(0), 0.5_wp*(coefficient(0) + coefficient(1)), coefficient(1)]
        degree = max(2, degree)
      end if
      straight = k*piece%drive_coupling(1)*step*piece%drive%velocity_at(piece%from%time)
      curved = k*piece%drive_coupling(1)*0.5_wp*step**2*piece%drive%acceleration
      associate (n => real(degree, wp))
        coefficient(0:degree) = coefficient(0:degree) &
          + [(real(i, wp)*straight/n + real(i*(i - 1), wp)*curved/(n*(n - 1.0_wp)), i=0, degree)]
      end associate
    end associate
  end subroutine load

  !> An upper bound of |X'| [m/s]. In polar unknowns, X' = v cos(theta - phi), from the ranges of v and theta.
  real(wp) function fastest(self, enough)
    class(piece_view_t), intent(in) :: self
    real(wp), intent(in) :: enough
    real(wp) :: coefficient(0:max_degree), rate(0:max_degree), velocity(2), angle(2)
    type(state_t) :: state
    integer :: i

    if (self%sticking) then
      fastest = 0.0_wp
      return
    end if
    associate (path => self%piece%path, s => self%piece%path%grid%degree, along => self%motion%slider%along)
      if (self%piece%is_polar) then
        call path%speed_coefficients(coefficient)
        fastest = maxval(abs(coefficient(:s)))
        if (fastest <= enough) return
        call path%grid%bernstein_coefficients(path%nodal(:, column_y + 1), coefficient)
        angle = [minval(coefficient(:s)), maxval(coefficient(:s))] - atan2(along(2), along(1))
        ! The largest cosine is at an end, if there is no multiple of pi between.
        if (floor(angle(1)/pi) == floor(angle(2)/pi)) fastest = fastest*maxval(abs(cos(angle)))
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
        fastest = maxval(abs(coefficient(:s)))
      end if
    end associate
  end function fastest
end module dst_piece_view
