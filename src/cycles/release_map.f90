!> The slow cycle of the full model as a map of one number: from the release with which a slow cycle begins to that of the next one.
!>
!> At a release the angle of the spring force is the whole state (dst_cycle_table). A slow cycle leads over many fast cycles and one
!> excursion to the release with which the next one begins. Unstable cycles are found in the same way as stable ones, as zeros of
!> the map minus identity: because of rest, the motion need not be followed backwards. docs/cycles.md.
module dst_release_map
  use dst_assembly, only: new_motion
  use dst_cycle_map, only: cycle_map_t
  use dst_errors, only: error_t
  use dst_fast_cycle, only: release_angle_t
  use dst_kinds, only: wp, int64
  use dst_motion, only: motion_t, next_piece
  use dst_motion_summary, only: motion_summary_t
  use dst_scene, only: scene_t
  implicit none
  private

  public :: release_map_t, new_release_map

  !> Number of pieces after which there is no return. Convention.
  integer, parameter :: max_pieces = 200000

  !> The motion of a scene, and its summary.
  type :: release_map_t
    class(motion_t), allocatable :: motion
    type(motion_summary_t) :: summary
    class(motion_t), allocatable, private :: other
  contains
    procedure :: begin
    procedure :: come_back
    procedure :: has_returns
  end type release_map_t

contains

  !> The motion of a scene from its initial state on.
  subroutine new_release_map(scene, map, error)
    type(scene_t), intent(in) :: scene
    type(release_map_t), intent(out) :: map
    type(error_t), allocatable, intent(out) :: error

    call new_motion(scene, map%motion, map%other, error)
    if (allocated(error)) return
    call map%summary%start(map%motion, 0.0_wp)
    select type (motion => map%motion)
    class is (cycle_map_t)
      motion%reuses = .false.
    end select
  end subroutine new_release_map

  !> Whether the model is one whose releases can be followed.
  logical function has_returns(self)
    class(release_map_t), intent(in) :: self

    select type (motion => self%motion)
    class is (cycle_map_t)
      has_returns = .true.
    class default
      has_returns = .false.
    end select
  end function has_returns

  !> Begin again with a release and an empty summary; the growth of a difference need not be computed from here on.
  subroutine begin(self, from, with_growth)
    class(release_map_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: from
    logical, intent(in) :: with_growth
    type(motion_summary_t) :: empty          !! as a constructor here would need the names of private components

    select type (motion => self%motion)
    class is (cycle_map_t)
      call motion%begin_at_release(from)
      if (.not. with_growth) call motion%divergence%lose()
    end select
    self%summary = empty
    call self%summary%start(self%motion, 0.0_wp)
  end subroutine begin

  !> Continue to the next return: its release, and the logarithm of the factor by which a small difference has grown since the last
  !> one.
  subroutine come_back(self, to, log_stretch, is_known, found, error)
    class(release_map_t), intent(inout) :: self
    type(release_angle_t), intent(out) :: to
    real(wp), intent(out) :: log_stretch
    logical, intent(out) :: is_known         !! whether this logarithm is known
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    integer(int64) :: before, returns
    integer :: piece

    found = .false.
    call look(before)
    do piece = 1, max_pieces
      if (self%motion%finished()) return
      call next_piece(self%motion, self%other, error)
      if (allocated(error)) return
      call self%summary%follow(self%motion)
      call look(returns)
      found = returns > before
      if (found) return
    end do

  contains

    subroutine look(count)
      integer(int64), intent(out) :: count

      count = 0
      log_stretch = 0.0_wp
      is_known = .false.
      select type (motion => self%motion)
      class is (cycle_map_t)
        count = motion%divergence%returns
        to = motion%returned_to
        call motion%divergence%last(log_stretch, is_known)
      end select
    end subroutine look
  end subroutine come_back
end module dst_release_map
