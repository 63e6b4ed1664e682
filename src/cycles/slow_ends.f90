!> Where the stick-slip of the slow model ends: at which misalignment for a given drive velocity, and between which velocities for a
!> given misalignment.
!>
!> For each size of a cycle there is a parameter p (the logarithm of tan(phi), or of V) at which the cycle is a solution: the zero
!> of the gain G(x; p) of dst_slow_cycles. This curve p(x) has no folds where the curve of the cycles over p has them: a fold is an
!> extremum of p(x), at which the multiplier of the cycle is 1. Small cycles are near the point at which steady sliding changes its
!> stability.
!>
!> Stick-slip ends at the farthest p at which there is a cycle with an amplitude (peak to peak) of at least a share of F_0: at a
!> fold, or where the amplitude passes this share. The end is that of the full model only where the slow motion holds: its validity
!> is that at the end, or, if there is none, where steady sliding changes its stability.
module dst_slow_ends
  use dst_errors, only: error_t, raise, too_many_steps
  use dst_kinds, only: wp
  use dst_roots, only: bracket_t
  use dst_slider, only: slider_t
  use dst_slow_cycles, only: slow_cycle_t, slow_gain_t, slow_gain, slow_cycle_of, find_slow_cycles
  use dst_slow_map, only: slow_map_t, new_slow_map
  use dst_slow_validity, only: slow_validity_t, slow_validity, common_accuracy
  implicit none
  private

  public :: slow_end_t, ends_at_fold, ends_small, ends_nowhere
  public :: misalignment_end, velocity_end

  !> How stick-slip ends: not found, in a fold of cycles, or by a decrease of the amplitude.
  integer, parameter :: ends_nowhere = 0, ends_at_fold = 1, ends_small = 2
  !> Amplitude (peak to peak) over F_0 below which a cycle is ignored: as in docs/maps.md. Convention.
  real(wp), parameter :: least_swing = 0.05_wp
  !> Accuracy of the motion. Ten times: the ends of 60 random scenes change by at most 1e-10, relative to them.
  real(wp), parameter :: rtol = 1.0e-12_wp
  !> The distances in p from the change of stability of steady sliding at which the search for a large cycle begins and ends; and
  !> how near it comes to where there is none. Conventions.
  real(wp), parameter :: first_reach = 0.25_wp, last_reach = 100.0_wp, near_enough = 0.5_wp
  !> Step along the curve, and how far behind the farthest p the curve is left. Conventions. Half the step: the same ends.
  real(wp), parameter :: curve_step = 0.25_wp, far_behind = 0.7_wp
  !> Slope below which the curve is a canard, and the step there. Conventions.
  real(wp), parameter :: along_canard = 1.0e-5_wp, flat_step = 1.0_wp
  !> The steps are halved, down to the smallest one, if the curve is not found within this distance of its chord, relative to the
  !> step. Conventions.
  real(wp), parameter :: aside = 0.7_wp, least_step = 1.0e-7_wp
  !> Relative to the step along the curve: the difference of p for the gradient of the gain, and the first step aside. Conventions.
  real(wp), parameter :: gradient_share = 0.004_wp, first_share = 0.01_wp
  !> How far beyond the zero that the steepness of the gain promises its sign is looked at, and the smallest share of the first step
  !> aside. Conventions.
  real(wp), parameter :: beyond = 1.3_wp, least_share = 1.0e-3_wp
  integer, parameter :: max_points = 60, max_iterations = 80, max_turns = 8000
  !> Width to which p and x are found: a few roundoffs of p, which is of order one; and while the curve is followed. Twice: the same
  !> ends.
  real(wp), parameter :: fine = 16.0_wp*epsilon(1.0_wp), coarse = 1.0e-9_wp
  !> An extremum of p(x) that is lower than this is roundoff: where stick-slip ends abruptly, the curve is flat to all digits.
  real(wp), parameter :: flat = 1.0e-8_wp
  !> Largest value of a function that root finding uses: beyond it only the sign matters.
  real(wp), parameter :: enough = 1.0_wp

  !> An end of stick-slip.
  type :: slow_end_t
    integer :: kind = ends_nowhere
    real(wp) :: at = 0.0_wp                !! phi [rad] or V [m/s]
    type(slow_cycle_t) :: cycle            !! the last one
    !> Where steady sliding changes its stability, phi [rad] or V [m/s]; between it and a fold beyond it both are stable.
    real(wp) :: steady_limit = 0.0_wp
    type(slow_validity_t) :: validity      !! of the slow motion there
  end type slow_end_t

  !> The family of cycles of one slider, over the misalignment or over the drive velocity.
  type :: family_t
    type(slider_t) :: slider
    logical :: over_velocity = .false.
    real(wp) :: velocity = 0.0_wp          !! V [m/s] if it is not varied
    real(wp) :: outwards = 1.0_wp          !! the direction of p in which stick-slip ends
    real(wp) :: limit = 0.0_wp             !! F_0/k_x, m
    integer :: turns = 0                   !! number of turns that were followed
  end type family_t

  !> A point of the curve: the cycle with the valley exp(x) F_0/k_x below the equilibrium.
  type :: point_t
    real(wp) :: place(2) = 0.0_wp          !! x and p
    real(wp) :: swing = 0.0_wp             !! over F_0
    type(slow_gain_t) :: gain
  end type point_t

contains

  !> The misalignment at which stick-slip ends, at a drive velocity [m/s]; steady sliding is stable beyond `critical` [rad].
  subroutine misalignment_end(slider, velocity, critical, end, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity, critical
    type(slow_end_t), intent(out) :: end
    type(error_t), allocatable, intent(out) :: error
    type(family_t) :: family
    type(slider_t) :: at_end

    family%slider = slider
    family%velocity = abs(velocity)
    family%limit = slider%law%kinetic_limit/slider%stiffness(1)
    call find_end(family, log(tan(critical)), end, error)
    end%at = atan(exp(end%at))
    end%steady_limit = critical
    at_end = slider
    associate (angle => merge(critical, end%at, end%kind == ends_nowhere))
      at_end%along = [cos(angle), sin(angle)]
    end associate
    call judge(at_end, velocity, end, error)
  end subroutine misalignment_end

  !> The drive velocity at which stick-slip ends, at the slider's own misalignment; steady sliding is stable beyond `critical`
  !> [m/s], that is above it (`outwards` = 1) or below it (-1).
  subroutine velocity_end(slider, critical, outwards, end, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: critical, outwards
    type(slow_end_t), intent(out) :: end
    type(error_t), allocatable, intent(out) :: error
    type(family_t) :: family

    family%slider = slider
    family%over_velocity = .true.
    family%outwards = outwards
    family%limit = slider%law%kinetic_limit/slider%stiffness(1)
    call find_end(family, log(critical), end, error)
    end%at = exp(end%at)
    end%steady_limit = critical
    call judge(slider, merge(critical, end%at, end%kind == ends_nowhere), end, error)
  end subroutine velocity_end

  !> Whether the slow motion holds where it ends; if it does not, it is no matter that the end could not be computed.
  subroutine judge(slider, velocity, end, error)
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity
    type(slow_end_t), intent(inout) :: end
    type(error_t), allocatable, intent(inout) :: error

    end%validity = slow_validity(slider, velocity, common_accuracy)
    if (allocated(error) .and. end%validity%obstacle /= '') deallocate (error)
  end subroutine judge

  !> The farthest cycle that is large enough; steady sliding changes its stability at the parameter `first`. `end%at` is p.
  subroutine find_end(family, first, end, error)
    type(family_t), intent(inout) :: family
    real(wp), intent(in) :: first
    type(slow_end_t), intent(out) :: end
    type(error_t), allocatable, intent(out) :: error
    type(point_t) :: curve(max_points), farthest
    logical :: found
    integer :: n, k

    call find_large_cycle(family, first, curve(1), found, error)
    if (allocated(error) .or. .not. found) return
    call trace(family, curve, n, error)
    if (allocated(error)) return
    associate (outer => family%outwards*curve(:n)%place(2))
      k = maxloc(outer, dim=1)
      ! Where stick-slip ends abruptly the curve is flat, and each of its points is an end.
      if (curve(n)%swing <= least_swing .and. outer(k) - outer(n) < flat) k = n
    end associate
    farthest = curve(k)
    if (k == n .and. farthest%swing <= least_swing) then
      end%kind = ends_small
      call refine(family, .false., curve(n - 1), curve(n), farthest, error)
    else if (k < n) then
      ! The first point may be just before the fold.
      end%kind = ends_at_fold
      call refine(family, .true., curve(max(1, k - 1)), curve(k + 1), farthest, error)
    end if
    end%at = farthest%place(2)
    end%cycle = slow_cycle_of(farthest%gain)
  end subroutine find_end

  !> The largest cycle at a parameter nearly as far out as there is one: by steps that double from the parameter `first` on, then by
  !> bisection.
  subroutine find_large_cycle(family, first, point, found, error)
    type(family_t), intent(inout) :: family
    real(wp), intent(in) :: first
    type(point_t), intent(out) :: point
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    type(point_t) :: next
    real(wp) :: step, inside, beyond, middle
    logical :: there, is_bracketed

    call look_at(first, point, found)
    if (allocated(error)) return
    inside = first
    beyond = first
    is_bracketed = .false.
    there = found
    step = merge(family%outwards, -family%outwards, found)*first_reach
    do while (abs(step) < last_reach .and. .not. is_bracketed)
      call look_at(first + step, next, there)
      if (allocated(error)) return
      is_bracketed = there .neqv. found
      if (there) then
        point = next
        inside = first + step
      else
        beyond = first + step
      end if
      step = 2.0_wp*step
    end do
    found = is_bracketed
    do while (found .and. abs(beyond - inside) > near_enough)
      middle = 0.5_wp*(inside + beyond)
      call look_at(middle, next, there)
      if (allocated(error)) return
      if (there) then
        point = next
        inside = middle
      else
        beyond = middle
      end if
    end do

  contains

    !> The largest cycle at a parameter, if it is large enough.
    subroutine look_at(p, there, is_there)
      real(wp), intent(in) :: p
      type(point_t), intent(out) :: there
      logical, intent(out) :: is_there
      type(slow_map_t) :: map
      type(slow_cycle_t), allocatable :: cycles(:)

      call map_at(family, p, map)
      call find_slow_cycles(map, cycles, error)
      is_there = .false.
      if (allocated(error) .or. size(cycles) == 0) return
      associate (cycle => cycles(size(cycles)))
        there%place = [log((map%equilibrium - cycle%valley)/family%limit), p]
        there%swing = (cycle%peak - cycle%valley)/family%limit
      end associate
      is_there = there%swing >= least_swing
      if (is_there) call gain_at(family, there%place, there%gain, error)
    end subroutine look_at
  end subroutine find_large_cycle

  !> The curve from its first point on, outwards, as far as it matters: until the cycles are too small, or p is far behind. Each
  !> point is searched normal to the direction of the last one, at some distance ahead: the curve may turn back in x and in p.
  subroutine trace(family, curve, n, error)
    type(family_t), intent(inout) :: family
    type(point_t), intent(inout) :: curve(max_points)
    integer, intent(out) :: n
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: ahead(2), step, steepness
    logical :: found

    n = 1
    step = curve_step
    ahead = [0.0_wp, family%outwards]
    call turn_ahead(family, curve(1), gradient_share*step, ahead, steepness, error)
    do while (.not. allocated(error) .and. n < max_points)
      call find_point(family, curve(n)%place + step*ahead, across(ahead), aside*step, coarse, steepness, &
        curve(n + 1), found, error)
      if (allocated(error)) return
      if (.not. found) then
        step = 0.5_wp*step
        if (step < least_step) return
        cycle
      end if
      ! Along a canard only the size changes.
      step = min(merge(flat_step, curve_step, abs(ahead(2)) < along_canard), 2.0_wp*step)
      n = n + 1
      if (curve(n)%swing <= least_swing) return
      if (family%outwards*curve(n)%place(2) < maxval(family%outwards*curve(:n)%place(2)) - far_behind) return
      call turn_ahead(family, curve(n), gradient_share*step, ahead, steepness, error)
    end do
  end subroutine trace

  !> Turn a direction along the curve into the direction at a point of it, normal to the gradient of the gain; and how fast the gain
  !> grows across it.
  subroutine turn_ahead(family, point, difference, ahead, steepness, error)
    type(family_t), intent(inout) :: family
    type(point_t), intent(in) :: point
    real(wp), intent(in) :: difference      !! difference of p, for the gradient
    real(wp), intent(inout) :: ahead(2)
    real(wp), intent(out) :: steepness
    type(error_t), allocatable, intent(out) :: error
    type(slow_gain_t) :: beside
    real(wp) :: along(2)

    steepness = 0.0_wp
    call gain_at(family, point%place + [0.0_wp, difference], beside, error)
    if (allocated(error)) return
    along = [(beside%gain - point%gain%gain)/difference, -point%gain%slope]
    steepness = sign(hypot(along(1), along(2)), dot_product(along, ahead))
    ahead = along/steepness
  end subroutine turn_ahead

  !> The vector normal to a direction.
  pure function across(direction)
    real(wp), intent(in) :: direction(2)
    real(wp) :: across(2)

    across = [-direction(2), direction(1)]
  end function across

  !> The point of the curve between two others at which the cycles fold over, or at which the amplitude is the smallest one that
  !> counts.
  subroutine refine(family, at_fold, first, second, point, error)
    type(family_t), intent(inout) :: family
    logical, intent(in) :: at_fold
    type(point_t), intent(in) :: first, second
    type(point_t), intent(inout) :: point
    type(error_t), allocatable, intent(out) :: error
    type(bracket_t) :: bracket
    real(wp) :: share, chord(2), length, steepness
    logical :: found
    integer :: iteration

    bracket = bracket_t([0.0_wp, 1.0_wp], [value_of(first), value_of(second)])
    if (bracket%f(1)*bracket%f(2) > 0.0_wp) return
    chord = second%place - first%place
    length = hypot(chord(1), chord(2))
    steepness = 0.0_wp
    do iteration = 1, max_iterations
      share = bracket%false_position()
      if (modulo(iteration, 4) == 0) share = bracket%middle()
      call find_point(family, first%place + share*chord, across(chord/length), length, fine, steepness, point, &
        found, error)
      if (allocated(error) .or. .not. found) return
      if (.not. abs(value_of(point)) > 0.0_wp) return
      call bracket%narrow(share, value_of(point))
      ! At a fold p is an extremum.
      ! At a fold p is an extremum.
      if (bracket%width() <= merge(sqrt(fine), fine, at_fold)) return
    end do

  contains

    pure real(wp) function value_of(here)
      type(point_t), intent(in) :: here

      value_of = here%swing/least_swing - 1.0_wp
      if (at_fold) value_of = limited(here%gain%slope)
    end function value_of
  end subroutine refine

  !> The point of the curve that is nearest to a place, on the line through it in a direction, within some reach.
  subroutine find_point(family, place, direction, reach, width, steepness, point, found, error)
    type(family_t), intent(inout) :: family
    real(wp), intent(in) :: place(2), direction(2), reach
    real(wp), intent(in) :: width            !! width to which it is found
    real(wp), intent(inout) :: steepness     !! how fast the gain grows in this direction, 0 if that is not known
    type(point_t), intent(out) :: point
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    type(bracket_t) :: bracket
    type(slow_gain_t) :: here
    real(wp) :: step, far(2), gain(2), t, middle
    integer :: iteration, side, first

    found = .false.
    call gain_at(family, place, here, error)
    if (allocated(error)) return
    middle = here%gain
    far = 0.0_wp
    gain = middle
    step = first_share*reach
    first = 1
    if (abs(steepness) > 0.0_wp) then
      step = min(reach, max(least_share*step, beyond*abs(middle/steepness)))
      if (middle*steepness > 0.0_wp) first = 2
    end if
    search: do
      do iteration = 1, 2
        side = merge(first, 3 - first, iteration == 1)
        t = step*real(3 - 2*side, wp)
        call gain_at(family, place + t*direction, here, error)
        if (allocated(error)) return
        found = here%gain*middle <= 0.0_wp
        if (found) then
          bracket = bracket_t([far(side), t], limited([gain(side), here%gain]))
          exit search
        end if
        far(side) = t
        gain(side) = here%gain
      end do
      step = 2.0_wp*step
      if (step > reach) return
    end do search
    do iteration = 1, max_iterations
      t = bracket%false_position()
      if (modulo(iteration, 5) == 0) t = bracket%middle()
      call gain_at(family, place + t*direction, here, error)
      if (allocated(error)) return
      if (.not. abs(here%gain) > 0.0_wp) exit
      call bracket%narrow(t, limited(here%gain))
      if (abs(bracket%width()) <= width*max(1.0_wp, maxval(abs(place)))) exit
    end do
    if (abs(t) > 0.0_wp) steepness = (here%gain - middle)/t
    point = point_t(place + t*direction, (here%turn%peak - here%turn%from)/family%limit, here)
  end subroutine find_point

  !> The gain at x with the parameter p.
  subroutine gain_at(family, place, here, error)
    type(family_t), intent(inout) :: family
    real(wp), intent(in) :: place(2)       !! x and p
    type(slow_gain_t), intent(out) :: here
    type(error_t), allocatable, intent(out) :: error
    type(slow_map_t) :: map

    family%turns = family%turns + 1
    if (family%turns > max_turns) then
      call raise(error, too_many_steps, 'it was not found in a reasonable time: bring the parameters nearer to each other')
      return
    end if
    call map_at(family, place(2), map)
    call slow_gain(map, place(1) + log(family%limit/map%length), here, error)
  end subroutine gain_at

  !> The map with the parameter p.
  subroutine map_at(family, p, map)
    type(family_t), intent(in) :: family
    real(wp), intent(in) :: p
    type(slow_map_t), intent(out) :: map
    type(slider_t) :: slider

    slider = family%slider
    if (family%over_velocity) then
      call new_slow_map(slider, exp(p), rtol, map)
    else
      slider%along = [1.0_wp, exp(p)]/hypot(1.0_wp, exp(p))
      call new_slow_map(slider, family%velocity, rtol, map)
    end if
  end subroutine map_at

  !> A value in the form that root finding uses.
  elemental real(wp) function limited(value)
    real(wp), intent(in) :: value

    limited = max(-enough, min(enough, value))
  end function limited
end module dst_slow_ends
