!> The map from release to release: its tables give what steps give, and its branches are analytic in their own variables.
program test_release_map
  use checks, only: check, finish
  use dst_branch, only: branch_t, new_branch, in_root, in_distance, in_logarithm, nodes, tests, values
  use dst_errors, only: error_t
  use dst_kinds, only: wp, pi
  use dst_release_map, only: release_map_t, passage_t, new_release_map
  use dst_scene, only: scene_t
  use scenes, only: fig3
  implicit none

  call check_variables()
  call check_halving()
  call check_tables()
  call check_dampers()
  call finish()

contains

  !> A function that is analytic in a variable needs one interval in it, and its slope is right.
  subroutine check_variables()
    character(*), parameter :: name(3) = ['root     ', 'distance ', 'logarithm']
    real(wp), parameter :: end = 0.4_wp, at(3) = [0.41_wp, 0.6_wp, 1.1_wp]
    type(branch_t) :: branch
    real(wp) :: value(nodes + tests, values), found(values), slope, distance
    integer :: variable, i, k, side

    do variable = in_root, in_logarithm
      do i = 1, size(at)
        side = merge(1, -1, modulo(i + variable, 2) == 0)
        call new_branch(variable, end, real(side, wp), 0.8_wp, branch)
        do k = 1, nodes + tests
          value(k, :) = [1.0_wp, function_of(variable, abs(branch%angle(1, k) - end))]
        end do
        call branch%fill(1, value, .true., 1.0e-10_wp)
        distance = at(i) - end
        call check(trim(name(variable))//': tabulated', branch%is_known(branch%place_of(end + side*distance)))
        call branch%evaluate(1, end + side*distance, found, slope)
        call check(trim(name(variable))//': value', abs(found(2) - function_of(variable, distance)) <= 1.0e-10_wp)
        call check(trim(name(variable))//': slope', abs(slope - side*slope_of(variable, distance)) <= 1.0e-7_wp)
        call check(trim(name(variable))//': nothing on the other side', branch%place_of(end - side*distance) == 0)
      end do
    end do
  end subroutine check_variables

  pure real(wp) function function_of(variable, distance)
    integer, intent(in) :: variable
    real(wp), intent(in) :: distance

    select case (variable)
    case (in_root)
      function_of = exp(-sqrt(distance))
    case (in_distance)
      function_of = exp(-distance)
    case default
      function_of = sin(0.1_wp*log(distance))
    end select
  end function function_of

  pure real(wp) function slope_of(variable, distance)
    integer, intent(in) :: variable
    real(wp), intent(in) :: distance

    select case (variable)
    case (in_root)
      slope_of = -0.5_wp*exp(-sqrt(distance))/sqrt(distance)
    case (in_distance)
      slope_of = -exp(-distance)
    case default
      slope_of = 0.1_wp*cos(0.1_wp*log(distance))/distance
    end select
  end function slope_of

  !> Around a jump intervals are halved until they are short; the others are tabulated, and nothing is where a passage is unknown.
  subroutine check_halving()
    real(wp), parameter :: jump = 0.3_wp
    type(branch_t) :: branch
    real(wp) :: value(nodes + tests, values)
    integer :: visit, place, i, k, known
    logical :: is_wanted

    call new_branch(in_distance, 0.0_wp, 1.0_wp, 1.0_wp, branch)
    do i = 0, 100
      do visit = 1, 400
        place = branch%place_of((i + 0.1_wp)/101)
        is_wanted = branch%is_wanted(place)
        if (.not. is_wanted) cycle
        do k = 1, nodes + tests
          value(k, :) = [1.0_wp, merge(0.0_wp, 1.0_wp, branch%angle(place, k) < jump)]
        end do
        call branch%fill(place, value, .true., 1.0e-10_wp)
      end do
    end do
    known = 0
    do i = 0, 100
      if (branch%is_known(branch%place_of((i + 0.1_wp)/101))) known = known + 1
    end do
    call check('all but the neighbours of a jump are tabulated', known >= 98)
    call check('a jump is not', .not. branch%is_known(branch%place_of(jump)))
    call new_branch(in_distance, 0.0_wp, 1.0_wp, 1.0_wp, branch)
    call branch%fill(1, value, .false., 1.0e-10_wp)
    call check('what cannot be run is not tabulated', .not. branch%is_known(branch%place_of(0.5_wp)))
  end subroutine check_halving

  !> A map that has followed many slow cycles against one that only steps.
  subroutine check_tables()
    type(release_map_t) :: map, steps
    type(passage_t) :: passage, slip, right
    type(scene_t) :: scene
    type(error_t), allocatable :: error
    real(wp) :: alpha
    logical :: found
    integer :: i, n

    scene = fig3(10.0_wp, 'radau13', 1.0e-9_wp)
    scene%stiffness_y = 1.0e6_wp
    call new_release_map(scene, map, error)
    call map%first(alpha, found, error)
    call check('the motion has a release', found .and. .not. allocated(error))
    do i = 1, 80
      call map%come_back(alpha, .false., passage, slip, found, error)
      if (allocated(error) .or. .not. found) exit
      alpha = passage%to
    end do
    call check('80 slow cycles', .not. allocated(error) .and. found)
    call new_release_map(scene, steps, error)
    n = 0
    do i = 1, 40
      alpha = (9.0_wp + 70.0_wp*(real(i, wp)/40)**2)*pi/180
      call map%next(alpha, .true., passage, found, error)
      ! What was stepped has a rest.
      if (.not. found .or. passage%at_rest > 0.0_wp) cycle
      n = n + 1
      call steps%next(alpha, .true., right, found, error)
      call check('the same duration', abs(passage%duration - right%duration) <= 1.0e-7_wp*right%duration)
      call check('the same release', abs(passage%to - right%to) <= 1.0e-7_wp)
      if (right%has_slope) call check('the same slope', abs(passage%slope - right%slope) <= 1.0e-3_wp*max(1.0_wp, abs(right%slope)))
    end do
    call check('most are tabulated', n >= 30)
  end subroutine check_tables

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
    call new_release_map(scene, map, error)
    call map%first(first, found(1), error)
    call map%first(second, found(2), error)
    call map%first(third, found(3), error)
    call map%next(second, .false., passage, found(4), error)
    call check('the motion goes on from its releases', all(found) .and. abs(passage%to - third) <= 1.0e-8_wp)
    call check('which are apart', abs(third - second) > 1.0e-4_wp .and. abs(second - first) > 1.0e-4_wp)
  end subroutine check_dampers
end program test_release_map
