!> Slow creep as the motion of a scene: Eq. (7) for a finite k_y, and Eq. (8), in closed form.
!>
!> Friction F_0 does not depend on the slip velocity and the object has no mass, so that the motion depends only on the displacement
!> of the drive, with D(t)/l_x in place of tau: the drive may be any that never reverses, from unstretched springs. Other quadrants
!> of the misalignment and a negative velocity are mirror images.
!>
!> Source: Nakano & Popov (2020), Eqs. (6)-(8); docs/theory.md.
module dst_creep_motion
  use dst_kinds, only: wp
  use dst_creep, only: creep_t, creep_path_t, new_creep_path, creep_at, creep_asymptotic
  use dst_drive, only: drive_t
  use dst_errors, only: error_t, raise, deck_error
  use dst_motion, only: motion_t
  use dst_piece, only: stick_begins, slip_begins, slips, sticks
  use dst_rest, only: release_delay
  use dst_slider, only: slider_t, direction_of
  use dst_state, only: instant_t
  use dst_text, only: short_text
  implicit none
  private

  public :: creep_motion_t, new_creep_motion

  !> The creep of one scene.
  type, extends(motion_t) :: creep_motion_t
    !> Form of Eq. (8); empty for the exact creep.
    character(12) :: form = ''
    !> Misalignment in the first quadrant [rad], and the signs that convert the motion back from there.
    real(wp) :: phi = 0.0_wp
    real(wp) :: side(2) = 1.0_wp, drive_sign = 1.0_wp
    !> l_x = F_0/k_x [m].
    real(wp) :: length = 0.0_wp
    type(creep_path_t) :: path
    !> End of the true stick at the start [s]; huge if it is after the motion.
    real(wp) :: stick_end = 0.0_wp
  contains
    procedure :: go_on
    procedure :: instant
  end type creep_motion_t

contains

  !> Creep of a slider up to t_end [s]; `form` is empty for the exact creep, else that of Eq. (8). It is an error if the formula has
  !> no value up to then.
  subroutine new_creep_motion(slider, drive, form, t_end, motion, error)
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    character(*), intent(in) :: form
    real(wp), intent(in) :: t_end
    type(creep_motion_t), intent(out) :: motion
    type(error_t), allocatable, intent(out) :: error

    motion%in_closed_form = .true.
    motion%slider = slider
    motion%drive = drive
    motion%t_end = t_end
    motion%piece%drive = drive%segment(1)
    motion%form = form
    motion%phi = atan2(abs(slider%along(2)), abs(slider%along(1)))
    motion%length = slider%law%kinetic_limit/slider%stiffness(1)
    if (drive%distance(t_end) < 0.0_wp) motion%drive_sign = -1.0_wp
    motion%side = motion%drive_sign*sign([1.0_wp, 1.0_wp], slider%along)
    call check_range(motion, t_end, error)
    if (allocated(error) .or. form /= '') return
    motion%path = new_creep_path(motion%phi, slider%stiffness(1)/slider%stiffness(2))
    motion%stick_end = stick_time(motion, t_end)
    if (.not. motion%stick_end > 0.0_wp) return
    motion%contact = sticks
    motion%piece%event = stick_begins
  end subroutine new_creep_motion

  !> Refuse scenes for which the formulas are not valid.
  subroutine check_range(motion, t_end, error)
    type(creep_motion_t), intent(in) :: motion
    real(wp), intent(in) :: t_end
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: travel

    travel = abs(motion%drive%distance(t_end))
    if (.not. motion%slider%law%kinetic_limit > 0.0_wp) then
      call raise(error, deck_error, 'slow creep needs friction: mu_0 and normal_load must be > 0')
    else if (.not. motion%drive%never_reverses()) then
      call raise(error, deck_error, 'slow creep holds for a drive that never reverses, and drive.velocity changes '// &
        "its sign: use model = 'low_frequency' or 'full'")
    else if (.not. abs(motion%slider%along(1)) > 0.0_wp) then
      call raise(error, deck_error, 'slow creep holds for |misalignment_deg| < 90 and its mirror images: '// &
        'here the drive has no component along the soft axis')
    else if (motion%form == '') then
      if (motion%slider%stiffness(2) <= motion%slider%stiffness(1)) then
        call raise(error, deck_error, 'slow creep holds for stiffness_y > stiffness_x')
      else if (.not. motion%phi > 0.0_wp .and. travel >= motion%length) then
        call raise(error, deck_error, 'without misalignment the object sticks and then slips: slow creep holds while '// &
          range_text(motion))
      end if
    else if (.not. motion%phi > 0.0_wp) then
      call raise(error, deck_error, 'Eq. (8) holds for 0 < |misalignment_deg| < 90')
    else if (travel >= motion%length) then
      call raise(error, deck_error, 'Eq. (8) holds for V t/l_x < 1, while '//trim(range_text(motion))// &
        "; model = 'creep' has no such limit")
    end if
  end subroutine check_range

  !> 'the drive has moved by less than l_x = mu_0*normal_load/stiffness_x = 0.002 m, t_end < 2 s'
  function range_text(motion) result(text)
    type(creep_motion_t), intent(in) :: motion
    character(160) :: text

    text = 'the drive has moved by less than l_x = mu_0*normal_load/stiffness_x = '//trim(short_text(motion%length))//' m'
    if (size(motion%drive%segment) == 1) &
      text = trim(text)//', t_end < '//trim(short_text(motion%length/motion%drive%largest_speed()))//' s'
  end function range_text

  !> When the spring force reaches the static limit [s]; huge if not before t_end.
  pure real(wp) function stick_time(motion, t_end)
    type(creep_motion_t), intent(in) :: motion
    real(wp), intent(in) :: t_end
    real(wp) :: u(2), delay
    integer :: i

    stick_time = huge(stick_time)
    do i = 1, size(motion%drive%segment)
      associate (segment => motion%drive%segment(i))
        u = motion%drive%distance(segment%start)*motion%slider%along
        delay = release_delay(motion%slider, u, segment, segment%start)
        if (delay >= min(t_end, segment%end) - segment%start) cycle
        stick_time = segment%start + delay
        return
      end associate
    end do
  end function stick_time

  !> Continue to the end of the true stick or to the next instant at which the motion is read.
  subroutine go_on(self, horizon, error)
    class(creep_motion_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error

    associate (unused => error)
    end associate
    associate (time => self%piece%to%time)
      time = horizon
      if (self%contact == slips .or. time < self%stick_end .or. self%stick_end >= self%t_end) return
      time = self%stick_end
    end associate
    self%contact = slips
    self%piece%event = slip_begins
  end subroutine go_on

  !> The motion at a time [s]. Eq. (8) gives only the position and the velocity along the drive.
  pure function instant(self, time)
    class(creep_motion_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(instant_t) :: instant
    real(wp) :: driven
    integer :: i

    i = 1
    do while (time > self%drive%segment(i)%end)
      i = i + 1
    end do
    instant%state%time = time
    instant%drive_velocity = self%drive%segment(i)%velocity_at(time)
    driven = self%drive%distance(time)
    if (self%form /= '') then
      call follow_asymptotics(self, abs(driven)/self%length, instant)
    else if (time < self%stick_end) then
      instant%sticking = .true.
      instant%state%u = driven*self%slider%along
      instant%spring_force = self%slider%stiffness*instant%state%u
      instant%friction = hypot(instant%spring_force(1), instant%spring_force(2))
      instant%theta = direction_of(instant%spring_force)
    else
      call follow_exact(self, abs(driven)/self%length, instant)
    end if
  end function instant

  pure subroutine follow_exact(self, tau, instant)
    type(creep_motion_t), intent(in) :: self
    real(wp), intent(in) :: tau
    type(instant_t), intent(inout) :: instant
    type(creep_t) :: creep
    real(wp) :: direction(2)

    creep = creep_at(self%path, tau)
    direction = self%side*[sin(creep%alpha), cos(creep%alpha)]
    instant%friction = self%slider%law%kinetic_limit
    instant%spring_force = instant%friction*direction
    instant%state%u = instant%spring_force/self%slider%stiffness
    instant%state%position = self%drive_sign*self%length*creep%position
    instant%velocity = abs(instant%drive_velocity)*creep%speed*direction
    instant%theta = direction_of(direction)
  end subroutine follow_exact

  pure subroutine follow_asymptotics(self, tau, instant)
    type(creep_motion_t), intent(in) :: self
    real(wp), intent(in) :: tau
    type(instant_t), intent(inout) :: instant
    type(creep_t) :: creep

    creep = creep_asymptotic(self%form, self%phi, tau)
    instant%velocity = creep%x_rate*instant%drive_velocity*self%slider%along
    instant%state%position = self%drive_sign*self%length*creep%position
  end subroutine follow_asymptotics
end module dst_creep_motion
