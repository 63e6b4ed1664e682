!> All limit cycles of the slow motion: the fixed points of its map from valley to valley (dst_slow_map), stable and unstable.
!>
!> A place is given by x, the logarithm of the distance A of a valley from the equilibrium over the scene's own length, and the map
!> by its gain G(x) = ln(A_1/A_0): a cycle is a zero of G, stable if G falls there. G and its slope at any x follow from one turn,
!> so that no pair of cycles between two points of a scan is missed: where G turns back towards zero its extremum is searched.
module dst_slow_cycles
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_roots, only: bracket_t
  use dst_slow_map, only: slow_map_t, slow_turn_t
  implicit none
  private

  public :: find_slow_cycles

  !> Range of A over the scene's length in which cycles are searched, and the step of the scan in ln A. It is halved, down to the
  !> smallest one, if the gain between two points differs from the prediction of the slopes at both by more than this. Conventions.
  !> Half of all: the same cycles in 300 random scenes.
  real(wp), parameter :: rough = 0.1_wp, least_step = 0.005_wp
  real(wp), parameter :: smallest = 1.0e-3_wp, invisible = 1.0e-7_wp, first_largest = 2.0_wp, scan_step = 0.3_wp
  !> Doublings of the largest A in which every motion has to shrink. Conventions; twice each: no change.
  integer, parameter :: max_doublings = 40, max_points = 2000
  !> Gain that represents a motion which reaches the equilibrium.
  real(wp), parameter :: dead = -40.0_wp
  !> Iterations for a zero, and its width in x: roundoff.
  integer, parameter :: max_iterations = 80
  real(wp), parameter :: close = 8.0_wp*epsilon(1.0_wp)
  !> Roundoff of the gain, over the distance of the valley; and damping over sqrt(m k_x) that counts as zero. Conventions; twice
  !> each: no change.
  real(wp), parameter :: roundoff = 1.0e-11_wp, least_damping = 1.0e-12_wp

  !> The map at one place.
  type :: slow_gain_t
    real(wp) :: x = 0.0_wp
    real(wp) :: gain = 0.0_wp, slope = 0.0_wp      !! G and dG/dx
    type(slow_turn_t) :: turn = slow_turn_t()
  end type slow_gain_t

contains

  !> The cycles by increasing size, each as a turn; its `log_area` is the logarithm of its multiplier. Points at which the gain is
  !> no more than roundoff are skipped; the stability of the smallest motions is that of steady sliding.
  subroutine find_slow_cycles(map, cycles, error)
    type(slow_map_t), intent(inout) :: map
    type(slow_turn_t), allocatable, intent(out) :: cycles(:)
    type(error_t), allocatable, intent(out) :: error
    type(slow_gain_t) :: before, here, between
    real(wp) :: x, step, last
    integer :: point
    logical :: has_before

    allocate (cycles(0))
    has_before = abs(map%damping) > least_damping*map%impedance
    before = slow_gain_t(x=log(invisible), gain=-sign(1.0_wp, map%damping))
    last = log(first_largest)
    step = scan_step
    x = log(smallest)
    do point = 1, max_points
      call slow_gain(map, x, here, error)
      if (allocated(error)) return
      if (is_rough(before, here) .and. step > least_step) then
        step = 0.5_wp*step
        x = before%x + step
        cycle
      end if
      step = min(scan_step, 2.0_wp*step)
      if (abs(here%gain) > roundoff*(1.0_wp + exp(-x))) then
        if (has_before .and. before%gain*here%gain < 0.0_wp) then
          call take_cycle(before, here)
        else if (has_before .and. before%slope*before%gain < 0.0_wp .and. here%slope*here%gain > 0.0_wp) then
          call zero_between(map, before, here, .true., between, error)
          if (allocated(error)) return
          if (between%gain*before%gain < 0.0_wp) then
            call take_cycle(before, between)
            if (.not. allocated(error)) call take_cycle(between, here)
          end if
        end if
        if (allocated(error)) return
        ! Larger motions than the last cycle all shrink.
        if (x > last .and. here%gain < 0.0_wp) return
        has_before = .true.
        before = here
      end if
      if (x > last + real(max_doublings, wp)*log(2.0_wp)) return
      x = x + step
    end do

  contains

    subroutine take_cycle(first, second)
      type(slow_gain_t), intent(in) :: first, second
      type(slow_gain_t) :: root

      call zero_between(map, first, second, .false., root, error)
      if (.not. allocated(error)) cycles = [cycles, root%turn]
    end subroutine take_cycle
  end subroutine find_slow_cycles

  !> Whether the gain between two consecutive points differs from the prediction of the slopes at both.
  pure logical function is_rough(first, second)
    type(slow_gain_t), intent(in) :: first, second

    associate (step => second%x - first%x)
      is_rough = step <= 1.01_wp*scan_step
      if (is_rough) is_rough = abs((second%gain - first%gain)/step - 0.5_wp*(first%slope + second%slope)) > rough
    end associate
  end function is_rough

  !> The map at x.
  subroutine slow_gain(map, x, here, error)
    type(slow_map_t), intent(inout) :: map
    real(wp), intent(in) :: x
    type(slow_gain_t), intent(out) :: here
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: from, to

    here%x = x
    from = exp(x)*map%length
    call map%turn(map%equilibrium - from, here%turn, error)
    here%gain = dead
    if (allocated(error) .or. .not. here%turn%returns) return
    to = map%equilibrium - here%turn%to
    if (.not. to > 0.0_wp) return
    here%gain = log(to/from)
    here%slope = exp(max(dead, min(-dead, here%turn%log_area - 2.0_wp*here%gain))) - 1.0_wp
  end subroutine slow_gain

  !> The zero of the gain, or of its slope, between two points where it has opposite signs; that of the slope no further than to
  !> where the gain has another sign than at both points.
  subroutine zero_between(map, first, second, of_slope, here, error)
    type(slow_map_t), intent(inout) :: map
    type(slow_gain_t), intent(in) :: first, second
    logical, intent(in) :: of_slope
    type(slow_gain_t), intent(out) :: here
    type(error_t), allocatable, intent(out) :: error
    type(bracket_t) :: bracket
    real(wp) :: x, side
    integer :: iteration

    side = sign(1.0_wp, merge(second%slope, second%gain, of_slope))
    bracket = bracket_t([first%x, second%x], [-1.0_wp, 1.0_wp])
    x = bracket%middle()
    do iteration = 1, max_iterations
      call slow_gain(map, x, here, error)
      if (allocated(error)) return
      call bracket%narrow(x, side*merge(here%slope, here%gain, of_slope))
      if (of_slope) then
        if (here%gain*first%gain < 0.0_wp .or. bracket%width() <= sqrt(close)) return
        x = bracket%middle()
      else
        x = bracket%newton(x, side*here%gain, side*here%slope)
        if (abs(x - here%x) <= close*max(1.0_wp, abs(x))) return
      end if
    end do
  end subroutine zero_between
end module dst_slow_cycles
