!> Fast cycles of a steadily driven object: from one release through slip and stick to the next.
module dst_fast_cycle
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  implicit none
  private

  public :: release_angle_t, release_at, fast_cycle_t

  !> A release: angle of K u to the soft axis [rad], counted positive on either side, and the side, the sign of u_y.
  type :: release_angle_t
    real(wp) :: angle = 0.0_wp, side = 1.0_wp
  contains
    procedure :: theta
    procedure :: serialise => serialise_release
  end type release_angle_t

  !> A cycle: its release, its length [s], the change of the angle [rad], and the share of the time at rest.
  type :: fast_cycle_t
    logical :: known = .false.
    type(release_angle_t) :: from
    real(wp) :: duration = 0.0_wp, turn = 0.0_wp, stick_share = 0.0_wp
  contains
    procedure :: serialise => serialise_cycle
  end type fast_cycle_t

contains

  !> The release at which friction has a direction [rad].
  pure type(release_angle_t) function release_at(theta) result(release)
    real(wp), intent(in) :: theta

    release%angle = abs(theta)
    release%side = sign(1.0_wp, theta)
  end function release_at

  !> The direction of friction [rad].
  pure real(wp) function theta(self)
    class(release_angle_t), intent(in) :: self

    theta = self%side*self%angle
  end function theta

  subroutine serialise_release(self, archive)
    class(release_angle_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(self%angle)
    call archive%serialise(self%side)
  end subroutine serialise_release

  subroutine serialise_cycle(self, archive)
    class(fast_cycle_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(self%known)
    call self%from%serialise(archive)
    call archive%serialise(self%duration)
    call archive%serialise(self%turn)
    call archive%serialise(self%stick_share)
  end subroutine serialise_cycle
end module dst_fast_cycle
