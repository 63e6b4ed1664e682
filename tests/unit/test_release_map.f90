!> The map from release to release: its tables give what steps give, and its branches are analytic in their own variables.
program test_release_map
  use checks, only: check, check_close, finish
  use dst_branch, only: branch_t, new_branch
  use dst_errors, only: error_t
  use dst_full_cycles, only: map_of
  use dst_kinds, only: wp, pi, int64
  use dst_observation, only: observation_t, observe, pull, first_turn
  use dst_passage, only: passage_t, loss_t, duration, turn, measures
  use dst_passage_table, only: passage_table_t, new_passage_table, values
  use dst_release_map, only: release_map_t
  use dst_scene, only: scene_t
  use random_numbers, only: start_random, log_uniform
  use scenes, only: fig3
  implicit none

  call check_variables()
  call check_halving()
  call check_tables()
  call check_slips()
  call check_remembered()
  call check_slopes()
  call check_dampers()
  call check_loss()
  call finish()

contains

  !> A function that is analytic in the distance, its square root or its logarithm needs one interval, and its slope is right; the
  !> first place takes the square root itself.
  subroutine check_variables()
    character(*), parameter :: name(3) = ['root     ', 'distance ', 'logarithm']
    real(wp), parameter :: end = 0.4_wp, at(3) = [0.41_wp, 0.6_wp, 1.1_wp]
    integer, parameter :: points = 29
    type(branch_t) :: branch
    type(passage_table_t) :: table
    type(passage_t) :: passage
    real(wp) :: value(values), distance, right(3, 2)
    integer :: variable, i, k, side, place

    do variable = 1, size(name)
      do i = 1, size(at)
        side = merge(1, -1, modulo(i + variable, 2) == 0)
        call new_branch(end, real(side, wp), 1.0e-5_wp, 0.8_wp, variable == 1 .and. i == 1, branch)
        call new_passage_table(points, table)
        do k = 1, points
          passage%measure = 1.0_wp
          right = functions_of(abs(branch%angle(1, table%point(k)) - end))
          passage%measure(turn) = right(variable, 1)
          call table%take(k, passage)
        end do
        call table%settle()
        call branch%keep(1, table)
        distance = at(i) - end
        right = functions_of(distance)
        associate (here => end + side*distance)
          place = branch%place_of(here)
          call check(trim(name(variable))//': tabulated', branch%intervals(place)%is_known)
          call branch%table(place)%evaluate(branch%x_of(place, here), value)
          call check(trim(name(variable))//': value', abs(value(turn) - right(variable, 1)) <= 1.0e-10_wp)
          call check(trim(name(variable))//': slope', &
            abs(branch%x_rate(place, here)*value(measures + 1) - side*right(variable, 2)) <= 1.0e-7_wp)
          call check(trim(name(variable))//': nothing on the other side', branch%place_of(end - side*distance) == 0)
        end associate
      end do
    end do
  end subroutine check_variables

  !> Functions that are analytic in the square root, in itself, and in the logarithm; and their slopes.
  pure function functions_of(distance) result(value)
    real(wp), intent(in) :: distance
    real(wp) :: value(3, 2)

    value(:, 1) = [exp(-sqrt(distance)), exp(-distance), sin(0.1_wp*log(distance))]
    value(:, 2) = [-0.5_wp*exp(-sqrt(distance))/sqrt(distance), -exp(-distance), 0.1_wp*cos(0.1_wp*log(distance))/distance]
  end function functions_of

  !> If the square root does not hold, the logarithm does; halves of halves hold what the whole held, until they are short.
  subroutine check_halving()
    real(wp), parameter :: here = 0.3_wp
    type(branch_t) :: branch
    integer :: place, before, i

    call new_branch(0.0_wp, 1.0_wp, 1.0e-4_wp, 1.0_wp, .true., branch)
    call branch%refine(branch%place_of(here))
    call check('the logarithm first', .not. branch%has_root() .and. size(branch%intervals) == 1)
    before = 0
    do i = 1, 10
      place = branch%place_of(here)
      call check('a place holds its angle', abs(branch%x_of(place, here)) <= 1.0_wp)
      call check('and has no halves', all(branch%intervals(place)%half == 0))
      if (place == before) exit
      before = place
      call branch%refine(place)
    end do
    call check('not without end', i > 5 .and. i < 10)
    call check('the others hold the rest', branch%place_of(0.9_wp) /= place .and. branch%place_of(1.1_wp) == 0)
  end subroutine check_halving

  !> A map that has followed many slow cycles against one that only steps: where another singularity is near the end of sticks, laps
  !> are in the logarithm of the distance, else in its square root.
  subroutine check_tables()
    real(wp), parameter :: stiffness(2) = [1.0e6_wp, 1.0e7_wp]
    integer, parameter :: slow_cycles(2) = [80, 10], least(2) = [30, 20]
    type(release_map_t) :: map, steps
    type(passage_t) :: passage, slip, right
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: alpha
    logical :: found
    integer :: i, k, n

    do k = 1, size(stiffness)
      scene = fig3(10.0_wp, 'radau13', 1.0e-9_wp)
      scene%stiffness_y = stiffness(k)
      call map_of(scene, map, error)
      call map%first(alpha, found, error)
      call check('the motion has a release', found .and. .not. allocated(error))
      do i = 1, slow_cycles(k)
        call map%come_back(alpha, passage, slip, found, error)
        if (allocated(error) .or. .not. found) exit
        alpha = passage%to
      end do
      call check('so many slow cycles', .not. allocated(error) .and. found)
      call check('the variable of laps', map%branch(1)%has_root() .eqv. k == 2)
      call map_of(scene, steps, error)
      n = 0
      do i = 1, 40
        alpha = (9.0_wp + 70.0_wp*(real(i, wp)/40)**2)*pi/180
        call map%next(alpha, passage, found, error)
        if (.not. found .or. passage%table(1) == 0) cycle
        n = n + 1
        call steps%next(alpha, right, found, error)
        call check('the same duration', &
          abs(passage%measure(duration) - right%measure(duration)) <= 1.0e-7_wp*right%measure(duration))
        call check('the same release', abs(passage%to - right%to) <= 1.0e-7_wp)
        if (right%has_slope) call check('the same slope', &
          abs(passage%slope - right%slope) <= 1.0e-3_wp*max(1.0_wp, abs(right%slope)))
      end do
      call check('most are tabulated', n >= least(k))
    end do
  end subroutine check_tables

  !> What slips of an irregular motion show is what runs show.
  subroutine check_slips()
    real(wp), parameter :: stiffness(2) = [1.0e6_wp, 3.0e5_wp]
    type(release_map_t), target :: map
    type(passage_t) :: passage, slip
    type(observation_t) :: seen, right
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: alpha
    logical :: found
    integer :: i, k, n

    n = 0
    do k = 1, size(stiffness)
      scene = fig3(10.0_wp, 'radau13', 1.0e-9_wp)
      scene%stiffness_y = stiffness(k)
      call map_of(scene, map, error)
      map%keeps_motion = .true.
      call map%first(alpha, found, error)
      do i = 1, 40
        call map%come_back(alpha, passage, slip, found, error)
        if (allocated(error) .or. .not. found) exit
        alpha = passage%to
        if (slip%table(1) /= 2 .or. i < 25) cycle
        associate (branch => map%branch(2), table => map%branch(2)%table(slip%table(2)))
          if (.not. table%seen%are_smooth) cycle
          seen = table%seen%at(branch%x_of(slip%table(2), slip%from))
        end associate
        call map%run(slip%from, map%longest, passage, found, error)
        call observe(map%steps, map%recording, right)
        n = n + 1
        call check('as many turns of the load', seen%turns == right%turns)
        associate (same => abs(seen%value - right%value) <= 1.0e-7_wp*abs(right%value) + 1.0e-12_wp, &
          error => maxval(abs(seen%value(pull:pull + 2:2) - right%value(pull:pull + 2:2))))
          call check('the same observations', all(same(:pull - 1)) .and. all(same(first_turn:)))
          call check('the pull force, within its error', merge(all(same), error <= seen%pull_error, seen%pull_is_exact))
        end associate
      end do
    end do
    call check('slips in tables', n >= 10)
  end subroutine check_slips

  !> Passages that a map gives by those next to them that were run, against one that only steps.
  subroutine check_remembered()
    real(wp), parameter :: stiffness(2) = [1.0e6_wp, 1.0e7_wp], misalignment(2) = [6.0_wp, 1.0_wp], error_of_end = 1.0e-7_wp
    type(release_map_t) :: map, steps
    type(passage_t) :: passage, right
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: alpha
    logical :: found
    integer :: i, k, n

    call start_random(5)
    do k = 1, 2
      scene = fig3(10.0_wp, 'radau13', 1.0e-8_wp)
      scene%stiffness_y = stiffness(k)
      scene%misalignment_deg = misalignment(k)
      scene%drive_velocity = merge(1.0e-2_wp, 1.0e-3_wp, k == 1)
      call map_of(scene, map, error)
      call map_of(scene, steps, error)
      map%recalls = error_of_end
      n = 0
      do i = 1, 100
        alpha = log_uniform(0.3_wp, 1.5_wp)
        call map%next(alpha, passage, found, error)
        if (allocated(error) .or. .not. found .or. passage%table(1) > 0 .or. passage%steps > 0) cycle
        n = n + 1
        call steps%run(alpha, steps%longest, right, found, error)
        call check_close('the end of a passage that was not run', passage%to, right%to, 10.0_wp*error_of_end)
        call check('of its kind', passage%turns_back() .eqv. right%turns_back())
      end do
      call check('most are not run', n >= 50)
    end do
  end subroutine check_remembered

  !> P' of passages that are run against differences, in random scenes of all methods and laws. A passage that ends a slow cycle
  !> begins near the end of sticks, where P is not smooth: there a difference is not accurate.
  subroutine check_slopes()
    character(*), parameter :: method(5) = [character(7) :: 'radau5', 'radau9', 'radau13', 'dopri5', 'dop853']
    integer, parameter :: scenes = 40
    real(wp), parameter :: step(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], h = 1.0e-4_wp, smooth = 1.0e-4_wp
    type(release_map_t) :: map
    type(passage_t) :: passage, beside(4)
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: alpha, difference(2)
    logical :: found(5)
    integer :: i, k, n, counted(size(method))

    counted = 0
    call start_random(34)
    do n = 1, scenes
      scene = fig3(50.0_wp, trim(method(1 + modulo(n, size(method)))), 1.0e-12_wp)
      scene%misalignment_deg = log_uniform(0.2_wp, 20.0_wp)
      scene%stiffness_y = log_uniform(1.0e5_wp, 1.0e7_wp)
      scene%mass = log_uniform(0.03_wp, 3.0_wp)
      scene%drive_velocity = log_uniform(3.0e-4_wp, 1.0e-2_wp)
      scene%v_f = log_uniform(3.0e-3_wp, 3.0e-2_wp)
      if (modulo(n, 3) == 0) scene%damping_y = log_uniform(0.1_wp, 10.0_wp)
      if (modulo(n, 4) == 0) scene%mu_static = 0.21_wp
      if (modulo(n, 7) == 0) then
        scene%law = 'stribeck'
        scene%exponent = 1.5_wp
        scene%viscous = 0.1_wp
      end if
      call map_of(scene, map, error)
      if (allocated(error)) cycle
      do i = 1, 3
        alpha = log_uniform(0.1_wp, 1.4_wp)
        call map%next(alpha, passage, found(5), error)
        if (allocated(error) .or. .not. found(5)) cycle
        do k = 1, 4
          call map%run(alpha + h*step(k), map%longest, beside(k), found(k), error)
          if (allocated(error)) found(k) = .false.
        end do
        if (.not. all(found)) cycle
        difference = [(beside(3)%to - beside(2)%to)/(2.0_wp*h), (beside(4)%to - beside(1)%to)/(4.0_wp*h)]
        associate (scale => max(1.0_wp, abs(passage%slope)))
          if (abs(difference(2) - difference(1)) > smooth*scale) cycle
          counted(1 + modulo(n, size(method))) = counted(1 + modulo(n, size(method))) + 1
          call check(trim(scene%method)//': it has a slope', passage%has_slope)
          call check_close(trim(scene%method)//': the slope', passage%slope, &
            difference(1) + (difference(1) - difference(2))/3.0_wp, 1.0e-8_wp*scale)
        end associate
      end do
    end do
    call check('enough passages of each method', all(counted >= 5))
  end subroutine check_slopes

  !> With dampers, a release is where the force on the object at rest is the limit: the map continues the motion from there.
  subroutine check_dampers()
    type(release_map_t) :: map
    type(passage_t) :: passage
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: first, second, third
    logical :: found(4)

    scene = fig3(10.0_wp, 'radau9', 1.0e-10_wp)
    scene%damping_x = 0.3_wp
    scene%damping_y = 2.0_wp
    call map_of(scene, map, error)
    call map%first(first, found(1), error)
    call map%first(second, found(2), error)
    call map%first(third, found(3), error)
    call map%next(second, passage, found(4), error)
    call check('the motion goes on from its releases', all(found) .and. abs(passage%to - third) <= 1.0e-8_wp)
    call check('which are apart', abs(third - second) > 1.0e-4_wp .and. abs(second - first) > 1.0e-4_wp)
  end subroutine check_dampers

  !> What is lost in repetitions is what is lost in one after the other; in very many it grows with their number if differences
  !> shrink, and has an end if they grow.
  subroutine check_loss()
    type(loss_t) :: one, each, most
    integer :: i

    one = loss_t(0.5_wp, 0.25_wp, 2.0_wp, 1.0_wp, 1.0_wp)
    each = loss_t()
    do i = 1, 13
      call each%go_on(one)
    end do
    most = one%repeated(13_int64)
    associate (found => [most%slope, most%shift, most%angle, most%time, most%lasted], &
        right => [each%slope, each%shift, each%angle, each%time, each%lasted])
      call check('loss of repetitions', all(abs(found - right) <= 1.0e-14_wp*right))
    end associate
    ! The angle is off by 4, which shifts the time by 1 each time.
    most = one%repeated(1000000000000_int64)
    call check_close('angle after very many', most%angle, 4.0_wp, 1.0e-10_wp)
    call check_close('time after very many', most%time/most%lasted, 2.0_wp, 1.0e-10_wp)
    one%slope = 3.0_wp
    most = one%repeated(1000000000000_int64)
    call check('loss without limit', most%time > 1.0e99_wp .and. most%time < huge(most%time))
  end subroutine check_loss
end program test_release_map
