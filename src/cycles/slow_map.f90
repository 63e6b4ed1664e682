!> The slow motion from one valley of the load to the next: a map of one number.
!>
!> `low_frequency` is a planar equation (dst_low_frequency),
!>
!>     u_x' = V c - w,      m w' = k_x u_x - Phi(w),      Phi(w) = F(v) w/v,      v = sqrt(w^2 + (V s)^2),
!>
!> so that the elongation turns back where w = V c: at a valley below the equilibrium k_x u_x = Phi(V c), at a peak above it. Every
!> motion that does not die out passes valley after valley, and every limit cycle is a fixed point of the map from one to the next.
!> With A the distance of a valley from the equilibrium, Liouville's formula for the area also gives the slope of that map,
!>
!>     dA_1/dA_0 = (A_0/A_1) exp(-integral of Phi'(w)/m dt).
!>
!> Source: docs/cycles.md.
module dst_slow_map
  use dst_bernstein, only: first_zero
  use dst_cycles, only: measures
  use dst_dense_output, only: column_y, n_columns
  use dst_drive, only: new_drive
  use dst_errors, only: error_t, raise, too_many_steps
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_low_frequency, only: new_low_frequency
  use dst_piece, only: piece_t
  use dst_radau, only: new_radau
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  use dst_stepping, only: stepping_t
  implicit none
  private

  public :: slow_map_t, slow_turn_t, new_slow_map

  !> Number of steps of one turn after which it is given up. Convention; a turn of Fig. 3 takes 300 at rtol 1e-12.
  integer, parameter :: max_steps = 20000
  !> Distance from a stable equilibrium, over that of the valley before, at which the motion has ended. Convention; twice: no
  !> change.
  real(wp), parameter :: arrived = 1.0e-6_wp
  !> Stages of the method: order 13 suits the tight tolerances.
  integer, parameter :: stages = 7
  !> Time for which the largest slip speed is kept, over the time of a radian of the slow oscillation. Convention; twice: no change.
  real(wp), parameter :: memory = 10.0_wp

  !> The motion from a valley over a peak to the next valley.
  type :: slow_turn_t
    !> Whether there is a next valley; if not, the motion has reached the equilibrium.
    logical :: returns = .false.
    real(wp) :: from = 0.0_wp, peak = 0.0_wp, to = 0.0_wp     !! u_x at the valleys and between, m
    real(wp) :: rise_time = 0.0_wp, fall_time = 0.0_wp        !! up to the peak and from there, s
    real(wp) :: slip_length = 0.0_wp                          !! advance in X while the load falls, m
    real(wp) :: fastest = 0.0_wp                              !! largest |X'| at the ends of steps, m/s
    real(wp) :: log_area = 0.0_wp                             !! -integral of Phi'/m dt: the growth of an area in the plane
  contains
    procedure :: measure
  end type slow_turn_t

  !> The slow motion of one slider under a steady drive.
  type :: slow_map_t
    real(wp) :: velocity = 0.0_wp            !! |V|, m/s
    real(wp) :: equilibrium = 0.0_wp         !! u_x in steady sliding, m
    real(wp) :: damping = 0.0_wp             !! Phi'(V c) in steady sliding, N s/m
    real(wp) :: impedance = 0.0_wp           !! sqrt(m k_x), N s/m
    real(wp) :: length = 0.0_wp              !! sum of l_x = F_0/k_x and the amplitude of a free oscillation at V, m
    type(stepping_t), private :: motion
  contains
    procedure :: turn
    procedure :: decay
  end type slow_map_t

contains

  !> The map of a slider, which also stands for its mirror images, at a drive velocity [m/s] that is not 0 and a misalignment that
  !> is neither 0 nor 90 degrees.
  subroutine new_slow_map(slider, velocity, rtol, map)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    real(wp), intent(in) :: rtol
    type(slow_map_t), intent(out) :: map
    real(wp) :: force(1), slope(1)

    associate (own => map%motion%slider)
      own = slider
      own%along = abs(slider%along)
      own%free = [1.0_wp, 0.0_wp]
      own%direction_free = .false.
      ! The time scale of the steps is that of the soft spring: the other one is rigid.
      own%stiffness(2) = own%stiffness(1)
      map%velocity = abs(velocity)
      call own%law%evaluate(1, [map%velocity], force, slope)
      map%equilibrium = force(1)*own%along(1)/own%stiffness(1)
      map%length = own%law%kinetic_limit/own%stiffness(1) + map%velocity*own%along(1)*sqrt(own%mass/own%stiffness(1))
      map%impedance = sqrt(own%mass)*sqrt(own%stiffness(1))
      map%motion%system = new_low_frequency(own)
      map%motion%stepper = new_radau(stages, 1, 1, rtol)
      map%motion%stepper%memory = memory*sqrt(own%mass/own%stiffness(1))
      map%motion%drive = new_drive([0.0_wp], [map%velocity])
      map%motion%may_rest = .false.
      map%motion%t_end = huge(1.0_wp)
    end associate
    map%damping = slider%mass*map%decay(map%velocity*map%motion%slider%along(1))
  end subroutine new_slow_map

  !> The measures of its cycle, as in dst_cycles, with this stiffness [N/m].
  pure function measure(self, stiffness)
    class(slow_turn_t), intent(in) :: self
    real(wp), intent(in) :: stiffness
    real(wp) :: measure(measures)

    measure = [self%rise_time + self%fall_time, stiffness*self%peak, stiffness*self%to, self%rise_time, self%fall_time, &
      self%slip_length]
  end function measure

  !> Phi'(w)/m [1/s] at a slip velocity along the soft axis [m/s].
  pure real(wp) function decay(self, w)
    class(slow_map_t), intent(in) :: self
    real(wp), intent(in) :: w
    real(wp) :: coefficient(0:2), weakening

    call self%motion%system%decay_polynomial([w], self%velocity, coefficient, weakening)
    decay = coefficient(1)
  end function decay

  !> The motion from a valley at u_x = `from` [m], below the equilibrium, to the next one.
  subroutine turn(self, from, way, error)
    class(slow_map_t), intent(inout) :: self
    real(wp), intent(in) :: from
    type(slow_turn_t), intent(out) :: way
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: pulled, place, peak_time, peak_position, nearness
    type(state_t) :: there
    logical :: rises
    integer :: step

    associate (motion => self%motion, mass => self%motion%slider%mass, stiffness => self%motion%slider%stiffness(1))
      pulled = self%velocity*motion%slider%along(1)
      way%from = from
      way%peak = from
      way%to = self%equilibrium
      call motion%start([from, 0.0_wp], [pulled, 0.0_wp], 0.0_wp)
      call motion%stepper%restart([stiffness*(from - self%equilibrium)/mass], [0.0_wp])
      rises = .true.
      peak_time = 0.0_wp
      peak_position = 0.0_wp
      do step = 1, max_steps
        call motion%advance(error)
        if (allocated(error)) return
        associate (piece => motion%piece)
          way%fastest = max(way%fastest, abs(piece%to%y(1)))
          if (piece%to%y(1) > pulled .neqv. rises) then
            call add_area(self, piece, 1.0_wp, way%log_area)
          else
            place = crossing(piece, pulled)
            there = piece%inside(place)
            if (rises) then
              way%peak = there%u(1)
              peak_time = there%time
              peak_position = there%position
              way%rise_time = peak_time
              rises = .false.
              call add_area(self, piece, 1.0_wp, way%log_area)
            else
              call add_area(self, piece, place, way%log_area)
              way%to = there%u(1)
              way%fall_time = there%time - peak_time
              way%slip_length = there%position - peak_position
              way%returns = .true.
              return
            end if
          end if
          nearness = hypot(piece%to%u(1) - self%equilibrium, (piece%to%y(1) - pulled)*sqrt(mass/stiffness))
          if (self%damping > 0.0_wp .and. nearness < arrived*(self%equilibrium - from)) return
        end associate
      end do
    end associate
    call raise(error, too_many_steps, 'the slow motion takes too many steps from valley to valley: bring the parameters '// &
      'nearer to each other')
  end subroutine turn

  !> Position in (0, 1] of a piece at which the slip velocity passes a value [m/s].
  pure real(wp) function crossing(piece, value)
    type(piece_t), intent(in) :: piece
    real(wp), intent(in) :: value
    real(wp) :: missing(0:max_degree)

    associate (grid => piece%path%grid)
      call grid%bernstein_coefficients(value - piece%path%nodal(:, column_y), missing)
      crossing = min(1.0_wp, first_zero(sign(1.0_wp, value - piece%from%y(1))*missing(:grid%degree)))
    end associate
  end function crossing

  !> Add -integral of Phi'/m over a share of a piece, by the quadrature of the method.
  pure subroutine add_area(self, piece, share, log_area)
    class(slow_map_t), intent(in) :: self
    type(piece_t), intent(in) :: piece
    real(wp), intent(in) :: share
    real(wp), intent(inout) :: log_area
    real(wp) :: columns(n_columns)
    integer :: i

    associate (path => piece%path, grid => piece%path%grid)
      do i = 1, grid%degree
        columns = path%values_at(share*grid%node(i))
        log_area = log_area - share*path%step*grid%integral(grid%degree, i)*self%decay(columns(column_y))
      end do
    end associate
  end subroutine add_area
end module dst_slow_map
