!> Motion of the far end of the spring: piecewise-linear velocity V(t) along X.
module dst_drive
  use dst_kinds, only: wp
  implicit none
  private

  public :: drive_t, drive_segment_t, new_drive

  !> Roundoff of a velocity between two knots, relative to the largest, with a margin. Twice: no change.
  real(wp), parameter :: velocity_roundoff = 4.0_wp*epsilon(1.0_wp)

  !> One stretch of the drive on which V is linear in time.
  type :: drive_segment_t
    real(wp) :: start = 0.0_wp          !! s
    real(wp) :: end = huge(1.0_wp)      !! s
    real(wp) :: velocity = 0.0_wp       !! V at start, m/s
    real(wp) :: acceleration = 0.0_wp   !! m/s2
    logical :: rests = .false.          !! the drive is treated as at rest (see with_rests)
  contains
    procedure :: velocity_at
    procedure :: displacement
    procedure :: velocity_square
  end type drive_segment_t

  !> The whole profile: consecutive segments; the last one has no end.
  type :: drive_t
    type(drive_segment_t), allocatable :: segment(:)
  contains
    procedure :: largest_speed
    procedure :: never_reverses
    procedure :: is_steady
    procedure :: distance
    procedure :: with_rests
  end type drive_t

contains

  !> From knots: times [s] (the first is 0, they never decrease, two equal ones make a jump) and velocities [m/s] there. After the
  !> last knot the velocity stays constant. A knot on the line between its neighbours is ignored, and so is a last one at which
  !> nothing changes.
  pure function new_drive(time, velocity) result(drive)
    real(wp), intent(in) :: time(:), velocity(:)
    type(drive_t) :: drive
    integer :: i, n, first, count

    n = size(time)
    allocate (drive%segment(n))
    count = 0
    first = 1
    do i = 2, n
      if (i < n) then
        if (on_line(time([first, i, i + 1]), velocity([first, i, i + 1]))) cycle
      end if
      if (time(i) > time(first)) then
        count = count + 1
        drive%segment(count) = drive_segment_t(time(first), time(i), velocity(first), &
                                               (velocity(i) - velocity(first))/(time(i) - time(first)))
      end if
      first = i
    end do
    count = count + 1
    drive%segment(count) = drive_segment_t(start=time(n), velocity=velocity(n))
    if (count > 1) then
      associate (before => drive%segment(count - 1), last => drive%segment(count))
        if (.not. (abs(before%acceleration) > 0.0_wp .or. abs(before%velocity - last%velocity) > 0.0_wp)) then
          before%end = last%end
          count = count - 1
        end if
      end associate
    end if
    drive%segment = drive%segment(:count)
  end function new_drive

  !> Whether the second of three knots lies on the line between the others, within roundoff.
  pure logical function on_line(time, velocity)
    real(wp), intent(in) :: time(3), velocity(3)   !! s, m/s
    real(wp) :: share

    on_line = time(1) < time(2) .and. time(2) < time(3)
    if (.not. on_line) return
    share = (time(2) - time(1))/(time(3) - time(1))
    on_line = abs(velocity(2) - velocity(1) - share*(velocity(3) - velocity(1))) <= velocity_roundoff*maxval(abs(velocity))
  end function on_line

  !> V(t) [m/s].
  pure real(wp) function velocity_at(self, time)
    class(drive_segment_t), intent(in) :: self
    real(wp), intent(in) :: time

    velocity_at = self%velocity + self%acceleration*(time - self%start)
  end function velocity_at

  !> Distance driven [m] from `time` [s] on, over `duration` [s], within the segment.
  elemental real(wp) function displacement(self, time, duration)
    class(drive_segment_t), intent(in) :: self
    real(wp), intent(in) :: time, duration

    displacement = duration*(self%velocity + self%acceleration*(time - self%start + 0.5_wp*duration))
  end function displacement

  !> Integral of V^2 [m2/s] from `time` [s] on, over `duration` [s], within the segment.
  pure real(wp) function velocity_square(self, time, duration)
    class(drive_segment_t), intent(in) :: self
    real(wp), intent(in) :: time, duration
    real(wp) :: first, last

    first = self%velocity_at(time)
    last = self%velocity_at(time + duration)
    velocity_square = duration*(first**2 + first*last + last**2)/3.0_wp
  end function velocity_square

  !> The same motion, with those parts marked in which the drive is treated as at rest: V = 0, and the part of a ramp through zero
  !> in which |V| is below `share` of its largest value.
  pure function with_rests(self, share) result(marked)
    class(drive_t), intent(in) :: self
    real(wp), intent(in) :: share
    type(drive_t) :: marked
    type(drive_segment_t) :: part
    real(wp) :: knot(4), last, slow
    integer :: i, k, count

    allocate (marked%segment(3*size(self%segment)))
    count = 0
    do i = 1, size(self%segment)
      associate (ramp => self%segment(i))
        knot = [ramp%start, ramp%start, ramp%start, ramp%end]
        slow = 0.0_wp
        if (abs(ramp%acceleration) > 0.0_wp) then
          last = ramp%velocity_at(ramp%end)
          slow = share*max(abs(ramp%velocity), abs(last))
          knot(2:3) = ramp%start + (sign(slow, ramp%acceleration)*[-1.0_wp, 1.0_wp] - ramp%velocity)/ramp%acceleration
          knot(2:3) = min(ramp%end, max(ramp%start, knot(2:3)))
        end if
        do k = 1, 3
          if (.not. knot(k + 1) > knot(k)) cycle
          part = drive_segment_t(knot(k), knot(k + 1), ramp%velocity_at(knot(k)), ramp%acceleration)
          part%rests = k == 2 .or. .not. (abs(ramp%velocity) > 0.0_wp .or. abs(ramp%acceleration) > 0.0_wp)
          count = count + 1
          marked%segment(count) = part
        end do
      end associate
    end do
    marked%segment = marked%segment(:count)
  end function with_rests

  !> Whether V has the same sign at all times.
  pure logical function never_reverses(self)
    class(drive_t), intent(in) :: self

    associate (velocity => knot_velocities(self%segment))
      never_reverses = .not. (any(velocity < 0.0_wp) .and. any(velocity > 0.0_wp))
    end associate
  end function never_reverses

  !> Whether the velocity is the same at all times up to one [s], however many knots there are.
  pure logical function is_steady(self, until)
    class(drive_t), intent(in) :: self
    real(wp), intent(in) :: until

    associate (segment => self%segment)
      is_steady = .not. any(segment%start < until .and. (abs(segment%acceleration) > 0.0_wp &
        .or. abs(segment%velocity - segment(1)%velocity) > 0.0_wp))
    end associate
  end function is_steady

  !> Distance driven [m] up to a time [s].
  pure real(wp) function distance(self, time)
    class(drive_t), intent(in) :: self
    real(wp), intent(in) :: time
    integer :: i

    distance = 0.0_wp
    do i = 1, size(self%segment)
      associate (segment => self%segment(i))
        if (segment%start >= time) exit
        distance = distance + segment%displacement(segment%start, min(time, segment%end) - segment%start)
      end associate
    end do
  end function distance

  !> Largest |V| of the profile [m/s]: it is reached at a knot.
  pure real(wp) function largest_speed(self)
    class(drive_t), intent(in) :: self

    largest_speed = maxval(abs(knot_velocities(self%segment)))
  end function largest_speed

  !> V [m/s] at both ends of each segment; the last one has the same V at its end, or none.
  pure function knot_velocities(segment) result(velocity)
    type(drive_segment_t), intent(in) :: segment(:)
    real(wp) :: velocity(2*size(segment) - 1)
    integer :: i

    velocity(1::2) = segment%velocity
    do i = 1, size(segment) - 1
      velocity(2*i) = segment(i)%velocity_at(segment(i)%end)
    end do
  end function knot_velocities
end module dst_drive
