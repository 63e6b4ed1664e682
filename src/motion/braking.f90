!> The end of slip in closed form: with constant direction, the slip speed is v + acceleration t + jerk t^2/2.
module dst_braking
  use dst_dense_output, only: dense_output_t, column_u, column_y, column_position
  use dst_kinds, only: wp
  use dst_drive, only: drive_segment_t
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  implicit none
  private

  public :: braking_t, braking

  !> Permitted change of friction until the stop, as far as it is linear in v and beyond that, over the force that brakes.
  !> Conventions; twice: no change on Fig. 3.
  real(wp), parameter :: linear_change = 0.1_wp, curved_change = 0.01_wp

  !> The end of slip: v + acceleration t + jerk t^2/2 in a constant direction.
  type :: braking_t
    real(wp) :: acceleration = 0.0_wp  !! m/s2
    real(wp) :: jerk = 0.0_wp          !! m/s3
    !> Whether v falls to zero, and after what time [s].
    logical :: falls = .false.
    real(wp) :: delay = 0.0_wp
    !> Whether friction changes little and smoothly until then, compared with the force that brakes.
    logical :: steady = .false.
    !> Highest v until then [m/s].
    real(wp) :: highest = 0.0_wp
  contains
    procedure :: ends_within
    procedure :: end_of_slip
    procedure :: describe
    procedure, private :: slipped
  end type braking_t

contains

  !> Acceleration and jerk of the slip speed with constant direction, and when it reaches zero.
  pure function braking(slider, drive, from) result(stopping)
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    type(braking_t) :: stopping
    real(wp) :: direction(2), friction(1), slope(1), driven(2), discriminant, damping

    associate (v => from%y(1), theta => from%y(2), k => slider%stiffness, m => slider%mass)
      direction = [cos(theta), sin(theta)]
      driven = drive%velocity_at(from%time)*slider%drive_coupling()
      call slider%law%evaluate(1, [v], friction, slope)
      stopping%acceleration = (dot_product(k*from%u, direction) - friction(1))/m
      stopping%jerk = (dot_product(k*(driven - v*slider%free*direction), direction) - slope(1)*stopping%acceleration)/m
      damping = 0.0_wp
      if (slider%is_damped()) then
        associate (c => slider%damping)
          damping = dot_product(c*slider%free*direction, direction)
          stopping%acceleration = (dot_product(k*from%u + c*(driven - v*slider%free*direction), direction) - friction(1))/m
          stopping%jerk = (dot_product(k*(driven - v*slider%free*direction) + c*drive%acceleration*slider%drive_coupling(), &
            direction) - (slope(1) + damping)*stopping%acceleration)/m
        end associate
      end if
      discriminant = stopping%acceleration**2 - 2.0_wp*stopping%jerk*v
      stopping%falls = discriminant >= 0.0_wp
      if (stopping%falls) stopping%falls = sqrt(discriminant) > stopping%acceleration .and. &
        (stopping%acceleration < 0.0_wp .or. stopping%jerk < 0.0_wp)
      if (stopping%falls) stopping%delay = 2.0_wp*v/(sqrt(discriminant) - stopping%acceleration)
      associate (change => [(abs(slope(1)) + damping)*v, abs(friction(1) - slope(1)*v - slider%law%kinetic_limit)])
        stopping%steady = change(1) <= linear_change*m*abs(stopping%acceleration) .and. &
          change(2) <= curved_change*m*abs(stopping%acceleration)
      end associate
      stopping%highest = v
      if (stopping%falls .and. stopping%acceleration > 0.0_wp) &
        stopping%highest = v - 0.5_wp*stopping%acceleration**2/stopping%jerk
    end associate
  end function braking

  !> Whether slip ends smoothly within `time` [s], and is no faster than `cut` [m/s] until then.
  pure logical function ends_within(self, time, cut)
    class(braking_t), intent(in) :: self
    real(wp), intent(in) :: time, cut

    ends_within = self%falls .and. self%steady .and. self%highest <= cut .and. self%delay <= time
  end function ends_within

  !> The state at the end of slip. Its works follow from u, F(v) and the dampers, which vary until then.
  pure function end_of_slip(self, slider, drive, from) result(to)
    class(braking_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    type(state_t) :: to
    real(wp) :: direction(2), friction(1), slope(1), slipped, travel

    to = from
    associate (v => from%y(1), theta => from%y(2), delay => self%delay)
      direction = [cos(theta), sin(theta)]
      call slider%law%evaluate(1, [v], friction, slope)
      slipped = self%slipped(v, delay)
      travel = drive%displacement(from%time, delay)
      call to%later(from, delay)
      to%u = from%u + travel*slider%drive_coupling() - slipped*slider%free*direction
      to%y(1) = 0.0_wp
      to%position = from%position + slipped*dot_product(slider%along, direction)
      to%friction_work = from%friction_work + slider%law%kinetic_limit*slipped + slope(1)*v**2*delay/3.0_wp
      to%drive_work = from%drive_work + travel*dot_product(slider%stiffness*slider%drive_coupling(), 0.5_wp*(from%u + to%u)) &
        + slipped*dot_product(slider%held_force(from%u), direction)
    end associate
    if (slider%is_damped()) call add_damper_works(self, slider, drive, from, direction, to)
  end function end_of_slip

  !> Add the work of the drive through the dampers, and the work of the dampers: of polynomials of degree 4 in time.
  pure subroutine add_damper_works(self, slider, drive, from, direction, to)
    class(braking_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: direction(2)
    type(state_t), intent(inout) :: to
    !> Gauss's points and weights on [0, 1].
    real(wp), parameter :: half_way = 0.5_wp*sqrt(0.6_wp)
    real(wp), parameter :: point(3) = [0.5_wp - half_way, 0.5_wp, 0.5_wp + half_way]
    real(wp), parameter :: weight(3) = [5.0_wp, 8.0_wp, 5.0_wp]/18.0_wp
    real(wp) :: time, drive_velocity, speed, rate(2), works(2)
    integer :: i

    works = 0.0_wp
    do i = 1, 3
      time = point(i)*self%delay
      drive_velocity = drive%velocity_at(from%time + time)
      speed = from%y(1) + time*(self%acceleration + 0.5_wp*time*self%jerk)
      rate = slider%drive_coupling()*drive_velocity - speed*slider%free*direction
      works = works + weight(i)*self%delay &
        *[drive_velocity*sum(slider%damping*slider%drive_coupling()*rate), sum(slider%damping*rate**2)]
    end do
    to%drive_work = to%drive_work + works(1)
    to%damper_work = from%damper_work + works(2)
  end subroutine add_damper_works

  !> Distance slipped [m] in `time` [s] from the slip speed v [m/s] on.
  pure real(wp) function slipped(self, v, time)
    class(braking_t), intent(in) :: self
    real(wp), intent(in) :: v, time

    slipped = time*(v + time*(0.5_wp*self%acceleration + time*self%jerk/6.0_wp))
  end function slipped

  !> The motion before the stop, at the nodes of `path`.
  pure subroutine describe(self, slider, from, path)
    class(braking_t), intent(in) :: self
    type(slider_t), intent(in) :: slider
    type(state_t), intent(in) :: from
    type(dense_output_t), intent(inout) :: path
    real(wp) :: direction(2), time, way
    integer :: i

    path%step = self%delay
    associate (v => from%y(1), theta => from%y(2), nodal => path%nodal)
      direction = [cos(theta), sin(theta)]
      do i = 0, path%grid%degree
        time = path%grid%node(i)*self%delay
        way = self%slipped(v, time)
        nodal(i, column_u:column_u + 1) = from%u - way*slider%free*direction
        nodal(i, column_y) = max(0.0_wp, v + time*(self%acceleration + 0.5_wp*time*self%jerk))
        nodal(i, column_y + 1) = theta
        nodal(i, column_position) = from%position + way*dot_product(slider%along, direction)
      end do
    end associate
  end subroutine describe
end module dst_braking
