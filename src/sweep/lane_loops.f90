!> The step of all lanes of dst_lane_step. Every loop over the lanes becomes vector instructions, without calls and branches.
submodule(dst_lane_step) dst_lane_loops
  implicit none

contains

  module procedure step_lanes
    integer :: from, to

    if (.not. attempts) then
      call evaluate(lanes%scene, lanes%point(lanes%here))
      return
    end if
    from = lanes%here
    to = 3 - from
    call attempt(lanes%scene, lanes%point(from), lanes%point(to), lanes%control)
    call evaluate(lanes%scene, lanes%point(to))
    call take_in(lanes%scene, lanes%point(from), lanes%point(to), lanes%control, lanes%account)
    lanes%here = to
  end procedure step_lanes

  !> Friction minus its limit.
  pure subroutine weaken(scene, speed, part)
    type(lane_scene_t), intent(in) :: scene
    real(wp), intent(in) :: speed(lane_count)
    real(wp), intent(out) :: part(lane_count)
    real(wp) :: x(lane_count)

    x = -speed*scene%decay
    call exponentials(lane_count, x, part)
    part = scene%drop*part

  contains

    include '../numerics/exponentials.inc'
  end subroutine weaken

  !> Compute all quantities of a point.
  pure subroutine evaluate(scene, point)
    type(lane_scene_t), intent(in) :: scene
    type(lane_point_t), intent(inout) :: point
    real(wp), dimension(lane_count) :: pull, part, slope, force, damping, dissipation_w, supply, supply_w
    integer :: l

    do l = 1, lane_count
      pull(l) = scene%stiffness(l)*point%u(l)
      point%speed(l) = sqrt(point%w(l)**2 + scene%across(l)**2)
      point%rate(l) = scene%cos_phi(l)*point%w(l) + scene%sin_phi(l)*scene%across(l)
      point%u_rate(l) = scene%drive_rate(l) - point%w(l)
    end do
    call weaken(scene, point%speed, part)
    do l = 1, lane_count
      point%friction(l) = scene%limit(l) + part(l)
      slope(l) = -scene%decay(l)*part(l)
    end do
    call slow_forces(lane_count, pull, point%w, scene%across, point%speed, point%friction, slope, force, damping, &
      point%dissipation, dissipation_w, supply, supply_w)
    do l = 1, lane_count
      point%w_rate(l) = force(l)*scene%per_mass(l)
      point%growth(l) = -damping(l)*scene%per_mass(l)
      point%w_curvature(l) = scene%stiffness_per_mass(l)*point%u_rate(l) + point%growth(l)*point%w_rate(l)
      point%supply(l) = scene%drive_rate(l)*pull(l) + supply(l)
      point%supply_rate(l) = scene%drive_rate(l)*scene%stiffness(l)*point%u_rate(l) + supply_w(l)*point%w_rate(l)
      point%dissipation_rate(l) = dissipation_w(l)*point%w_rate(l)
    end do

  contains

    include '../physics/slow_forces.inc'
  end subroutine evaluate

  !> One attempt from a point to the next, and the choice of the next step. A lane whose attempt is rejected stays at its point;
  !> idle lanes compute, too, without effect.
  pure subroutine attempt(scene, now, next, control)
    type(lane_scene_t), intent(in) :: scene
    type(lane_point_t), intent(in) :: now
    type(lane_point_t), intent(inout) :: next
    type(lane_control_t), intent(inout) :: control
    real(wp), dimension(lane_count, stages) :: k_u, k_w
    real(wp), dimension(lane_count) :: h, per_h, u, w, sum_u, sum_w, fastest, pivot, error, factor, root
    integer(int64) :: restrained(lane_count)
    real(wp) :: per_both, divisor, growth, angle, per_root, predicted, excess, time, end
    logical :: accepted
    integer :: i, j, l

    do l = 1, lane_count
      h(l) = min(control%next_step(l), scene%longest_step(l))
      h(l) = merge(scene%t_end(l) - now%time(l), h(l), now%time(l) + (1.0_wp + sliver)*h(l) >= scene%t_end(l))
      h(l) = merge(h(l), 1.0_wp, scene%busy(l) > 0.0_wp .and. h(l) > 0.0_wp)
      divisor = 1.0_wp - gamma*h(l)*(now%growth(l) - gamma*h(l)*scene%stiffness_per_mass(l))
      per_both = 1.0_wp/(h(l)*divisor)
      per_h(l) = divisor*per_both
      pivot(l) = gamma*h(l)*h(l)*per_both
      k_w(l, 1) = pivot(l)*(now%w_rate(l) + gamma*h(l)*scene%stiffness_per_mass(l)*now%u_rate(l))
      k_u(l, 1) = gamma*h(l)*(now%u_rate(l) - k_w(l, 1))
      fastest(l) = now%speed(l)
    end do
    do i = 2, stages
      u = now%u + a(i, 1)*k_u(:, 1)
      w = now%w + a(i, 1)*k_w(:, 1)
      sum_u = c(i, 1)*k_u(:, 1)
      sum_w = c(i, 1)*k_w(:, 1)
      do j = 2, i - 1
        do l = 1, lane_count
          u(l) = u(l) + a(i, j)*k_u(l, j)
          w(l) = w(l) + a(i, j)*k_w(l, j)
          sum_u(l) = sum_u(l) + c(i, j)*k_u(l, j)
          sum_w(l) = sum_w(l) + c(i, j)*k_w(l, j)
        end do
      end do
      call solve_stage(scene, h, per_h, pivot, u, w, sum_u, sum_w, fastest, k_u(:, i), k_w(:, i))
    end do
    ! The solution adds the last stage: the method is stiffly accurate, and that increment is the difference to the embedded one.
    do l = 1, lane_count
      u(l) = u(l) + k_u(l, stages)
      w(l) = w(l) + k_w(l, stages)
      error(l) = sqrt(k_w(l, stages)**2 + scene%stiffness_per_mass(l)*k_u(l, stages)**2) &
        /(scene%tolerance(l)*fastest(l) + scene%noise(l)*pivot(l)*(1.0_wp/gamma))
      error(l) = merge(error(l), no_number, error(l) <= huge(1.0_wp) .and. abs(u(l)) + abs(w(l)) <= huge(1.0_wp))
    end do
    do l = 1, lane_count
      root(l) = sqrt(sqrt(max(error(l), least_error)))
      per_root = 1.0_wp/root(l)
      factor(l) = safety*per_root
      predicted = factor(l)*(h(l)*control%per_last_step(l))*(control%last_root(l)*per_root)
      factor(l) = merge(min(factor(l), predicted), factor(l), control%last_root(l) > 0.0_wp .and. error(l) <= 1.0_wp)
      factor(l) = min(largest_factor, max(least_factor, factor(l)))
      factor(l) = merge(min(1.0_wp, factor(l)), factor(l), control%rejections(l) > 0.0_wp)
      growth = h(l)*now%growth(l)
      angle = h(l)*scene%frequency(l)
      restrained(l) = merge(1_int64, 0_int64, growth > longest_growth .or. (growth > 0.0_wp .and. angle > small_angle))
    end do
    if (sum(restrained) > 0) call restrain(scene%frequency, now%growth, h, restrained, factor, error)
    do l = 1, lane_count
      control%moved(l) = merge(scene%busy(l), 0.0_wp, error(l) <= 1.0_wp)
      control%step(l) = h(l)
      control%next_step(l) = h(l)*factor(l)
    end do
    do l = 1, lane_count
      accepted = control%moved(l) > 0.0_wp
      time = now%time(l)
      end = scene%t_end(l)
      end = merge(end, time + h(l), time + h(l) + sliver*h(l) >= end)
      next%time(l) = merge(end, time, accepted)
      next%u(l) = merge(u(l), now%u(l), accepted)
      next%w(l) = merge(w(l), now%w(l), accepted)
      control%last_root(l) = merge(root(l), control%last_root(l), accepted)
      control%per_last_step(l) = merge(per_h(l), control%per_last_step(l), accepted)
      control%rejections(l) = merge(0.0_wp, control%rejections(l) + 1.0_wp, accepted)
      control%steps(l) = control%steps(l) + control%moved(l)
      control%standing(l) = merge(control%standing(l) + control%moved(l), 0.0_wp, next%time(l) <= time)
    end do
    do l = 1, lane_count
      excess = max(control%rejections(l) - max_rejections, control%standing(l) - max_standing)
      excess = max(excess, merge(control%steps(l) + 1.0_wp - scene%max_steps(l), 0.0_wp, next%time(l) < scene%t_end(l)))
      control%gives_up(l) = merge(scene%busy(l), 0.0_wp, excess > 0.0_wp)
    end do
  end subroutine attempt

  !> A stage's increment from its argument (u, w) and sum_j c_ij k_j.
  pure subroutine solve_stage(scene, h, per_h, pivot, u, w, sum_u, sum_w, fastest, stage_u, stage_w)
    type(lane_scene_t), intent(in) :: scene
    real(wp), dimension(lane_count), intent(in) :: h, per_h, pivot, u, w, sum_u, sum_w
    real(wp), dimension(lane_count), intent(inout) :: fastest
    real(wp), dimension(lane_count), intent(out) :: stage_u, stage_w
    real(wp), dimension(lane_count) :: speed, part
    real(wp) :: friction, u_side, w_side
    integer :: l

    do l = 1, lane_count
      speed(l) = sqrt(w(l)**2 + scene%across(l)**2)
      fastest(l) = max(fastest(l), speed(l))
    end do
    call weaken(scene, speed, part)
    do l = 1, lane_count
      friction = (scene%limit(l) + part(l))*scene%per_mass(l)
      u_side = scene%drive_rate(l) - w(l) + sum_u(l)*per_h(l)
      w_side = scene%stiffness_per_mass(l)*u(l) - friction*w(l)/speed(l) + sum_w(l)*per_h(l)
      stage_w(l) = pivot(l)*(w_side + gamma*h(l)*scene%stiffness_per_mass(l)*u_side)
      stage_u(l) = gamma*h(l)*(u_side - stage_w(l))
    end do
  end subroutine solve_stage

  !> Limits of a step in which a disturbance grows.
  pure subroutine restrain(frequency, rate, step, restrained, factor, error)
    real(wp), dimension(lane_count), intent(in) :: frequency, rate, step
    integer(int64), intent(in) :: restrained(lane_count)
    real(wp), dimension(lane_count), intent(inout) :: factor, error
    real(wp) :: growth, angle, largest_angle
    integer :: l

    do l = 1, lane_count
      if (restrained(l) == 0) cycle
      growth = step(l)*rate(l)
      if (growth > longest_growth) then
        factor(l) = min(factor(l), shortened(longest_growth, growth))
        error(l) = max(error(l), growth/longest_growth)
      end if
      angle = step(l)*frequency(l)
      if (angle > small_angle) then
        largest_angle = (growth_accuracy*min(1.0_wp, 0.5_wp*growth/angle))**0.2_wp
        factor(l) = min(factor(l), shortened(largest_angle, angle))
        if (angle > largest_angle) error(l) = max(error(l), angle/largest_angle)
      end if
    end do
  end subroutine restrain

  !> Works of a step, by the trapezium rule with its correction from the slopes at both ends, of order 4; and whether the summary
  !> needs anything of the step but its length.
  pure subroutine take_in(scene, first, last, control, account)
    type(lane_scene_t), intent(in) :: scene
    type(lane_point_t), intent(in) :: first, last
    type(lane_control_t), intent(in) :: control
    type(lane_account_t), intent(inout) :: account
    real(wp) :: h, drive_work, friction_work, begin, end, drive, load, largest, fastest, excess(2), length
    real(wp) :: turning, notes
    integer :: l

    do l = 1, lane_count
      h = control%step(l)*control%moved(l)
      drive_work = 0.5_wp*h*(first%supply(l) + last%supply(l) + h*(1.0_wp/6.0_wp)*(first%supply_rate(l) - last%supply_rate(l)))
      friction_work = 0.5_wp*h*(first%dissipation(l) + last%dissipation(l) &
        + h*(1.0_wp/6.0_wp)*(first%dissipation_rate(l) - last%dissipation_rate(l)))
      account%drive_work(l) = account%drive_work(l) + drive_work
      account%friction_work(l) = account%friction_work(l) + friction_work
      account%exchanged(l) = account%exchanged(l) + abs(drive_work) + abs(friction_work)
    end do
    do l = 1, lane_count
      begin = first%time(l)
      end = last%time(l)
      drive = abs(scene%velocity(l))
      largest = account%largest_rate(l)
      fastest = max(abs(first%rate(l)), abs(last%rate(l)))
      excess(1) = abs(first%rate(l)) - tiny_rate*drive
      excess(2) = abs(last%rate(l)) - tiny_rate*drive
      turning = first%w_rate(l)*last%w_rate(l)
      load = scene%stiffness(l)*max(abs(first%u(l)), abs(last%u(l)))
      ! X' turns inside, slip begins, the load turns, creep begins or ends.
      notes = max(account%watched(l), merge(1.0_wp, 0.0_wp, control%steps(l) <= 1.0_wp .or. end >= scene%t_end(l)))
      notes = notes + merge(1.0_wp, 0.0_wp, turning <= 0.0_wp)
      notes = notes + merge(1.0_wp - account%has_slipped(l), 0.0_wp, load > min(first%friction(l), last%friction(l)))
      notes = notes + merge(1.0_wp, 0.0_wp, end - begin > short*account%natural_time(l) .and. fastest > creeping*drive)
      notes = notes + merge(1.0_wp, 0.0_wp, first%u_rate(l)*last%u_rate(l) <= 0.0_wp)
      notes = notes + merge(1.0_wp, 0.0_wp, end >= account%half(l) &
        .and. min(begin - account%half(l), excess(1)*excess(2), first%rate(l)*last%rate(l)) <= 0.0_wp)
      notes = notes*control%moved(l)
      length = merge(end - begin, 0.0_wp, begin >= account%half(l) .and. notes <= 0.0_wp)
      account%notes(l) = notes
      account%largest_rate(l) = max(largest, merge(fastest, 0.0_wp, notes <= 0.0_wp))
      account%quiet_time(l) = account%quiet_time(l) + length
      account%quiet_creep(l) = account%quiet_creep(l) + merge(length, 0.0_wp, excess(2) <= 0.0_wp)
    end do
  end subroutine take_in
end submodule dst_lane_loops
