!> Motion of the far end of the spring: piecewise-linear velocity V(t) along X.
module dst_drive
  use dst_kinds, only: wp
  implicit none
  private

  public :: drive_t, drive_segment_t, new_drive

  !> One stretch of the drive on which V is linear in time.
  type :: drive_segment_t
    real(wp) :: start = 0.0_wp          !! s
    real(wp) :: end = huge(1.0_wp)      !! s
    real(wp) :: velocity = 0.0_wp       !! V at start, m/s
    real(wp) :: acceleration = 0.0_wp   !! m/s2
  contains
    procedure :: velocity_at
    procedure :: displacement
  end type drive_segment_t

  !> The whole profile: consecutive segments; the last one has no end.
  type :: drive_t
    type(drive_segment_t), allocatable :: segment(:)
  contains
    procedure :: largest_speed
  end type drive_t

contains

  !> From knots: times [s] (the first 0, never falling, two equal ones make a jump) and velocities
  !> [m/s] there. After the last knot the last velocity holds.
  pure function new_drive(time, velocity) result(drive)
    real(wp), intent(in) :: time(:), velocity(:)
    type(drive_t) :: drive
    integer :: i, n

    n = size(time)
    allocate (drive%segment(0))
    do i = 1, n - 1
      if (time(i + 1) <= time(i)) cycle
      drive%segment = [drive%segment, drive_segment_t(time(i), time(i + 1), velocity(i), &
        (velocity(i + 1) - velocity(i))/(time(i + 1) - time(i)))]
    end do
    drive%segment = [drive%segment, drive_segment_t(start=time(n), velocity=velocity(n))]
  end function new_drive

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

  !> Largest |V| of the profile [m/s]: it is reached at a knot.
  pure real(wp) function largest_speed(self)
    class(drive_t), intent(in) :: self
    integer :: i

    largest_speed = 0.0_wp
    do i = 1, size(self%segment)
      associate (segment => self%segment(i))
        largest_speed = max(largest_speed, abs(segment%velocity))
        if (i < size(self%segment)) largest_speed = max(largest_speed, abs(segment%velocity_at(segment%end)))
      end associate
    end do
  end function largest_speed
end module dst_drive
