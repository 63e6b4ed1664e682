!> Whether a scene stick-slips: what its motion from rest settles to.
!>
!> The full model is run until two slow cycles agree, or until it is known to slide or to be irregular. Every friction law, damper
!> and static limit is that of the scene; nothing is assumed about its motion.
module dst_settling
  use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
  use dst_assembly, only: slider_from_scene
  use dst_divergence, only: regular, undecided, steady_sliding, ringing_down
  use dst_errors, only: error_t, too_many_steps
  use dst_kinds, only: wp, int64, pi
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_slider, only: slider_t
  use dst_writer, only: writer_t, outcome_t
  implicit none
  private

  public :: settling_t

  !> How long a motion is followed, one after the other, in times to load the spring up to F_0 and to oscillate once. One that does
  !> not repeat, but whose swing has fallen by no more than `lasting` since the time before, is followed no longer than the third,
  !> and no longer than that if it swings clearly: by so many times the least swing of stick-slip. One whose swing has fallen by
  !> more than `dying` is not followed beyond the last but one. Conventions.
  real(wp), parameter :: lengths(6) = [10.0_wp, 30.0_wp, 100.0_wp, 300.0_wp, 1000.0_wp, 3000.0_wp]
  integer, parameter :: long_enough = 3
  real(wp), parameter :: lasting = 1.0e-3_wp, dying = 0.2_wp, clearly = 2.0_wp
  !> Accuracy of the motion, and of the agreement of its cycles. Conventions; twice each: no change.
  real(wp), parameter :: rtol = 1.0e-6_wp, agreement = 1.0e-6_wp
  !> Steps of a run, some seconds. Convention; twice: no change.
  integer(int64), parameter :: max_steps = 200000_int64
  !> Swing of the load over F_0 above which a motion is stick-slip. Convention; twice: no change.
  real(wp), parameter :: least_swing = 0.05_wp

  !> A motion, as far as it is.
  type :: settling_t
    logical :: is_finished = .false.
    real(wp) :: limit = 0.0_wp                 !! F_0 = mu_0 W, N
    real(wp) :: swing = 0.0_wp                 !! peak to peak of k_x u_x, N; 0 in steady sliding
    type(scene_t), private :: scene
    real(wp), private :: length = 0.0_wp       !! one of `lengths`, s
    integer, private :: turn = 1               !! of the lengths
    type(simulation_t), allocatable, private :: simulation
    type(writer_t), private :: writer
  contains
    procedure :: start
    procedure :: proceed
    procedure :: stick_slips
    procedure :: least
  end type settling_t

contains

  !> Begin with a scene of which mass and stiffnesses are known, from rest, under a drive velocity [m/s] other than 0.
  subroutine start(self, scene, velocity, error)
    class(settling_t), intent(inout) :: self
    type(scene_t), intent(in) :: scene
    real(wp), intent(in) :: velocity
    type(error_t), allocatable, intent(out) :: error
    type(slider_t) :: slider

    call slider_from_scene(scene, slider)
    self%scene = scene
    associate (to => self%scene)
      to%model = 'full'
      to%method = 'radau13'
      to%rtol = rtol
      to%settle = agreement
      to%max_steps = max_steps
      to%drive_time = [0.0_wp]
      to%drive_velocity = [velocity]
      to%velocity_ratio = 0.0_wp
      to%fields = [character(len(to%fields)) :: 'u_x']
      to%wall_limit = 0.0_wp
      self%limit = slider%law%kinetic_limit
      self%length = self%limit/(to%stiffness_x*abs(velocity)) + 2.0_wp*pi*sqrt(to%mass/to%stiffness_x)
    end associate
    call begin(self, error)
  end subroutine start

  !> Run the scene from the beginning for the length whose turn it is.
  subroutine begin(self, error)
    class(settling_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    self%scene%t_end = lengths(self%turn)*self%length
    self%scene%interval = self%scene%t_end
    self%writer = writer_t()
    if (allocated(self%simulation)) deallocate (self%simulation)
    allocate (self%simulation)
    call self%simulation%start(self%scene, error)
  end subroutine begin

  !> Continue for at most `seconds` of wall time [s].
  subroutine proceed(self, seconds, error)
    class(settling_t), intent(inout) :: self
    real(wp), intent(in) :: seconds
    type(error_t), allocatable, intent(out) :: error
    type(error_t), allocatable :: none
    type(outcome_t) :: outcome
    real(wp) :: before
    integer :: verdict
    logical :: is_last

    call self%simulation%proceed(seconds, self%writer, error)
    if (.not. self%simulation%finished) return
    call self%simulation%outcome(none, outcome)
    if (allocated(error)) then
      ! It has been seen long enough if it clearly goes on.
      if (error%code /= too_many_steps .or. .not. outcome%summary_of('swing') >= clearly*self%least()) return
      deallocate (error)
      self%is_finished = .true.
      self%swing = outcome%summary_of('swing')
      return
    end if
    before = self%swing
    self%swing = outcome%summary_of('swing')
    verdict = undecided
    if (.not. ieee_is_nan(outcome%summary_of('regularity'))) verdict = nint(outcome%summary_of('regularity'))
    ! Neighbours that come closer may yet go far together.
    if (verdict == regular .and. .not. outcome%summary_of('repeats') > 0.0_wp) verdict = undecided
    is_last = self%turn == size(lengths)
    if (self%turn == size(lengths) - 1) is_last = self%swing < (1.0_wp - dying)*before
    associate (lasts => self%swing >= (1.0_wp - lasting)*before .and. self%turn > 1)
      if (verdict == regular) then
        self%is_finished = .true.
      else if (verdict == steady_sliding .or. (verdict == ringing_down .and. .not. self%stick_slips())) then
        self%swing = 0.0_wp
        self%is_finished = .true.
      else
        self%is_finished = is_last .or. lasts .and. (self%turn >= long_enough .or. self%swing >= clearly*self%least())
        ! It dies out, slowly.
        if (is_last .and. .not. lasts) self%swing = 0.0_wp
      end if
    end associate
    if (self%is_finished) return
    self%turn = self%turn + 1
    call begin(self, error)
  end subroutine proceed

  !> Whether the motion has come to stick-slip.
  pure logical function stick_slips(self)
    class(settling_t), intent(in) :: self

    stick_slips = self%swing >= self%least()
  end function stick_slips

  !> The swing from which on a motion is stick-slip [N].
  pure real(wp) function least(self)
    class(settling_t), intent(in) :: self

    least = least_swing*self%limit
  end function least
end module dst_settling
