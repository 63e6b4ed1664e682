!> The curves of a deck: the drive velocity over the time, and the friction coefficient over the slip velocity, of the law 'table'.
!>
!> The points of the law are lists in the deck, or a CSV file next to it with two columns, slip velocity [m/s] and friction
!> coefficient, which its first line may name: table_speed and table_mu. Its numbers become values of these keys, so that the
!> resolved deck contains the points and the file is read once.
module dst_curves
  use dst_csv, only: csv_table_t, read_csv
  use dst_deck_values, only: deck_t, usage, used
  use dst_kinds, only: wp
  use dst_schema, only: schema, find_key, in_range, out_of_range_text
  use dst_text, only: excerpt, integer_text, lower_case, real_text
  use dst_text_file, only: path_beside, read_text
  implicit none
  private

  public :: take_friction_table, check_drive, lengths_text

  !> Numbers of points of a table, and bytes of a file with this number of lines.
  integer, parameter :: least_points = 2, most_points = 1000, most_bytes = 1000000
  !> Steepest change of the friction coefficient over the slip velocity [s/m]. Convention: far from overflow, and beyond any rig.
  real(wp), parameter :: steepest = 1.0e30_wp
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
      if (table%user .and. table%texts(1) /= '') then
        path = path_beside(deck%name, trim(table%texts(1)))
        speed%attempted = .true.
        mu%attempted = .true.
        if (.not. table%valid) return
        if (speed%user .or. mu%user) then
          call deck%refuse('friction', 'table', &
            "'table' beside 'table_speed' or 'table_mu': give the file, or the points themselves")
          return
        end if
        call read_points(path, points, problem)
        if (problem /= '') then
          call deck%refuse('friction', 'table', path//problem)
          return
        end if
        speed%user = .true.
        mu%user = .true.
        speed%place = table%place
        mu%place = table%place
        speed%reals = points%values(1, :)
        mu%reals = points%values(2, :)
        table%texts(1) = ''
        table%user = .false.
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
    call check_range('table_speed', speed)
    if (problem == '') call check_range('table_mu', mu)
    if (problem /= '') return
    i = 1
    if (speed(1) > 0.0_wp) problem = item_text('table_speed', speed, 1)//'is not the start: the first slip velocity must be 0.0 m/s'
    if (problem /= '') return
    do i = 2, size(speed)
      if (.not. speed(i) > speed(i - 1)) then
        problem = item_text('table_speed', speed, i)//'is not above the slip velocity ahead of it, '//real_text(speed(i - 1))// &
          ' m/s: slip velocities must increase'
      else if (.not. abs(mu(i) - mu(i - 1))/steepest < speed(i) - speed(i - 1)) then
        problem = item_text('table_mu', mu, i)//'changes by more than '//real_text(steepest)//' per m/s: give points further apart'
      end if
      if (problem /= '') return
    end do

  contains

    !> Of a file: the lists of a deck are in range.
    subroutine check_range(key, values)
      character(*), intent(in) :: key
      real(wp), intent(in) :: values(:)

      associate (entry => schema(find_key('friction', key)))
        i = findloc(in_range(entry%range, values), .false., dim=1)
        if (i > 0) problem = out_of_range_text(entry, real_text(values(i)))
      end associate
    end subroutine check_range
  end subroutine check_points

  !> The points in a CSV file; `problem` is '' or the line, and what is wrong there.
  subroutine read_points(path, points, problem)
    character(*), intent(in) :: path
    type(csv_table_t), intent(out) :: points
    character(:), allocatable, intent(out) :: problem
    character(:), allocatable :: text

    call read_text(path, most_bytes, text, problem)
    if (problem /= '') then
      problem = ': '//problem//': give the path of a CSV file with the columns '//columns
      return
    end if
    call read_csv(text, points, problem)
    if (problem /= '') return
    if (size(points%names) == 0) then
      problem = ': 0 point(s): give at least '//integer_text(least_points)//', a row for each: '//columns
    else if (size(points%names) /= 2) then
      problem = integer_text(size(points%names))//' value(s): give two in each row, '//columns
    else if (points%has_names .and. .not. (is_name(1, 'table_speed') .and. is_name(2, 'table_mu'))) then
      problem = "'"//excerpt(trim(points%names(1)))//"', '"//excerpt(trim(points%names(2)))// &
        "' are neither two finite real numbers nor their names: name the columns in the first line: "//columns
    end if
    if (problem /= '' .and. points%first_line > 0) problem = ':'//integer_text(points%first_line)//': '//problem
    if (problem == '' .and. size(points%line) > most_points) problem = ':'//integer_text(points%line(most_points + 1))// &
      ': more than '//integer_text(most_points)//' points: give fewer'

  contains

    !> Whether column `k` has this name, with its group or without.
    logical function is_name(k, name)
      integer, intent(in) :: k
      character(*), intent(in) :: name

      is_name = lower_case(points%names(k)) == name .or. lower_case(points%names(k)) == 'friction.'//name
    end function is_name
  end subroutine read_points

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
