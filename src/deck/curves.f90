!> The curves of a deck: the drive velocity over the time, and the friction coefficient over the slip velocity, of the law 'table'.
!>
!> The points of the law are lists in the deck, or a CSV file next to it with two columns, slip velocity [m/s] and friction
!> coefficient, which its first line may name: table_speed and table_mu. Its numbers become values of these keys, so that the
!> resolved deck contains the points and the file is read once.
module dst_curves
  use dst_csv, only: csv_table_t, read_csv
  use dst_deck_values, only: deck_t, set_default, usage, used
  use dst_kinds, only: wp
  use dst_schema, only: schema, find_key, in_range, out_of_range_text
  use dst_text, only: excerpt, integer_text, lower_case, real_text
  use dst_text_file, only: path_beside
  implicit none
  private

  public :: take_friction_table, check_drive, lengths_text

  !> Numbers of points of a table, and bytes of a file with this number of lines.
  integer, parameter :: least_points = 2, most_points = 1000, most_bytes = 1000000
  !> Steepest change of the friction coefficient over the slip velocity [s/m]. Convention: far from overflow, and beyond any rig.
  real(wp), parameter :: steepest = 1.0e30_wp
  character(11), parameter :: names(2) = [character(11) :: 'table_speed', 'table_mu']
  character(*), parameter :: columns = 'table_speed, table_mu'

contains

  !> For the law 'table': read its points, from the file if the deck names one, and check them; mu_0 becomes the first of them.
  subroutine take_friction_table(deck)
    type(deck_t), intent(inout) :: deck
    type(csv_table_t) :: points
    character(:), allocatable :: path, problem
    integer :: i

    associate (table => deck%value(find_key('friction', 'table')), mu_0 => deck%value(find_key('friction', 'mu_0')), &
               speed => deck%value(find_key('friction', 'table_speed')), mu => deck%value(find_key('friction', 'table_mu')))
      if (usage(deck, find_key('friction', 'table')) /= used .or. .not. deck%value(find_key('friction', 'law'))%valid) return
      ! mu_0 follows from the points, and is not missing.
      mu_0%attempted = .true.
      path = ''
      problem = ''
      if (table%user .and. table%texts(1) /= '') then
        path = path_beside(deck%name, trim(table%texts(1)))
        if (speed%user .or. mu%user) then
          problem = "'table' beside 'table_speed' or 'table_mu': give the file, or the points themselves"
        else if (table%valid) then
          call read_points(path, points, problem)
        end if
        speed%attempted = .true.
        mu%attempted = .true.
        if (problem /= '') call deck%refuse('friction', 'table', problem)
        if (problem /= '' .or. .not. table%valid) return
        speed%user = .true.
        mu%user = .true.
        speed%place = table%place
        mu%place = table%place
        speed%reals = points%values(1, :points%rows)
        mu%reals = points%values(2, :points%rows)
        call set_default(schema(find_key('friction', 'table')), table)
      end if
      if (.not. (speed%user .and. mu%user .and. speed%valid .and. mu%valid)) return
      call check_points(speed%reals, mu%reals, problem, i)
      if (problem /= '') then
        if (path /= '' .and. i > 0) path = path//':'//integer_text(points%line(i))
        if (path /= '') path = path//': '
        call deck%refuse('friction', 'table_speed', path//problem)
      else if (mu_0%user .and. mu_0%valid .and. any(abs(mu_0%reals - mu%reals(1)) > 0.0_wp)) then
        call deck%refuse('friction', 'mu_0', "mu_0 = '"//real_text(mu_0%reals(1))// &
          "' is not the first friction coefficient of the table, "//real_text(mu%reals(1))//': remove mu_0')
      else
        mu_0%reals = mu%reals(:1)
      end if
    end associate
  end subroutine take_friction_table

  !> The points in a CSV file; `problem` is '' or the place, and what is wrong there.
  subroutine read_points(path, points, problem)
    character(*), intent(in) :: path
    type(csv_table_t), intent(out) :: points
    character(:), allocatable, intent(out) :: problem
    integer :: i

    call read_csv(path, most_bytes, 'give the path of a CSV file with the columns '//columns, points, problem)
    if (problem /= '') return
    if (points%first_line == 0) then
      problem = path//': 0 point(s): give at least '//integer_text(least_points)//', a row for each: '//columns
    else if (size(points%names) /= 2) then
      problem = integer_text(size(points%names))//' value(s): give two in each row, '//columns
    else if (points%has_names .and. .not. all([(lower_case(points%names(i)) == names(i) .or. &
             lower_case(points%names(i)) == 'friction.'//names(i), i=1, 2)])) then
      problem = "'"//excerpt(trim(points%names(1)))//"', '"//excerpt(trim(points%names(2)))// &
        "' are neither two finite real numbers nor their names: name the columns in the first line: "//columns
    end if
    if (problem /= '' .and. points%first_line > 0) problem = path//':'//integer_text(points%first_line)//': '//problem
  end subroutine read_points

  !> At least two points, in range, of increasing speed from 0 on: `problem` is '' or the first fault, which is that of point `i`,
  !> or of all if this is 0.
  subroutine check_points(speed, mu, problem, i)
    real(wp), intent(in) :: speed(:), mu(:)
    character(:), allocatable, intent(out) :: problem
    integer, intent(out) :: i

    i = 0
    problem = ''
    if (size(speed) /= size(mu)) then
      problem = lengths_text(size(speed), 'table_speed', size(mu), 'table_mu', 'one friction coefficient for each slip velocity')
    else if (size(speed) < least_points .or. size(speed) > most_points) then
      problem = integer_text(size(speed))//" point(s) in 'table_speed': give "//integer_text(least_points)//' to '// &
        integer_text(most_points)
    end if
    if (problem /= '') return
    do i = 1, size(speed)
      ! Of a file: the lists of a deck are in range.
      if (.not. in_range(schema(find_key('friction', 'table_speed'))%range, speed(i))) then
        problem = out_of_range_text(schema(find_key('friction', 'table_speed')), real_text(speed(i)))
      else if (.not. in_range(schema(find_key('friction', 'table_mu'))%range, mu(i))) then
        problem = out_of_range_text(schema(find_key('friction', 'table_mu')), real_text(mu(i)))
      else if (i == 1 .and. speed(1) > 0.0_wp) then
        problem = item_text('table_speed', speed, 1)//'is not the start: the first slip velocity must be 0.0 m/s'
      else if (i > 1) then
        associate (before => max(1, i - 1))
          if (.not. speed(i) > speed(before)) then
            problem = item_text('table_speed', speed, i)//'is not above the slip velocity ahead of it, '// &
              real_text(speed(before))//' m/s: slip velocities must increase'
          else if (.not. abs(mu(i) - mu(before))/steepest < speed(i) - speed(before)) then
            problem = item_text('table_mu', mu, i)//'changes by more than '//real_text(steepest)// &
              ' per m/s: give points further apart'
          end if
        end associate
      end if
      if (problem /= '') return
    end do
  end subroutine check_points

  !> The corners of the drive: as many times as velocities, from 0 on, never decreasing, with a jump between two velocities. A fault
  !> after a wrong corner is seldom one of its own.
  subroutine check_drive(deck)
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: problem
    integer :: i

    associate (velocity => deck%value(find_key('drive', 'velocity')), given => deck%value(find_key('drive', 'time')))
      if (.not. (velocity%user .and. velocity%valid .and. given%valid)) return
      problem = ''
      associate (time => given%reals)
        if (size(time) /= size(velocity%reals)) then
          problem = lengths_text(size(velocity%reals), 'velocity', size(time), 'time', &
            'one velocity for each time, or one velocity alone')
        else if (abs(time(1)) > 0.0_wp) then
          problem = item_text('time', time, 1)//'is not the start: the first time must be 0.0 s'
        end if
        do i = 2, size(time)
          if (problem /= '') exit
          if (time(i) < time(i - 1)) then
            problem = item_text('time', time, i)//'is before the time ahead of it, '//real_text(time(i - 1))// &
              ' s: times must not decrease'
          else if (time(i) <= time(max(1, i - 2)) .and. (i > 2 .or. time(i) <= 0.0_wp)) then
            ! The third of its kind, or the second at the start, where there can be no jump.
            problem = item_text('time', time, i)//'repeats a time once too often: give a time twice for a jump, but not 0.0 s'
          end if
        end do
      end associate
      if (problem /= '') call deck%refuse('drive', trim(merge('time    ', 'velocity', given%user)), problem)
    end associate
  end subroutine check_drive

  !> "NAME(i) = 'VALUE' ".
  function item_text(name, values, i) result(text)
    character(*), intent(in) :: name
    real(wp), intent(in) :: values(:)
    integer, intent(in) :: i
    character(:), allocatable :: text

    text = name//'('//integer_text(i)//") = '"//real_text(values(i))//"' "
  end function item_text

  !> What is wrong with two lists that should be of one length.
  function lengths_text(count, name, other_count, other, remedy) result(text)
    integer, intent(in) :: count, other_count
    character(*), intent(in) :: name, other, remedy
    character(:), allocatable :: text

    text = integer_text(count)//" value(s) of '"//name//"' but "//integer_text(other_count)//" of '"//other//"': give "//remedy
  end function lengths_text
end module dst_curves
