!> The points of the law 'table': lists in the deck, or a CSV file next to it.
!>
!> The file has two columns, slip velocity [m/s] and friction coefficient, and may name them in its first line: table_speed and
!> table_mu. Its numbers become values of these keys, so that the resolved deck contains the points and the file is read once.
module dst_friction_table
  use dst_csv, only: csv_table_t, read_csv
  use dst_deck_values, only: deck_t, usage, used
  use dst_faults, only: place_t
  use dst_kinds, only: wp
  use dst_schema, only: find_key
  use dst_text, only: excerpt, integer_text, lower_case, real_text
  use dst_text_file, only: path_beside, read_text
  implicit none
  private

  public :: take_friction_table

  !> Numbers of points of a table, and bytes of a file with this number of lines.
  integer, parameter :: least_points = 2, most_points = 1000, most_bytes = 1000000
  !> Steepest change of the friction coefficient over the slip velocity [s/m]. Convention: far from overflow, and beyond any rig.
  real(wp), parameter :: steepest = 1.0e30_wp
  character(*), parameter :: columns = 'table_speed, table_mu'

contains

  !> For the law 'table': read its points, from the file if the deck names one, and check them; mu_0 becomes the first of them.
  subroutine take_friction_table(deck)
    type(deck_t), intent(inout) :: deck
    character(:), allocatable :: problem, path
    type(place_t) :: place
    integer :: law, speed, mu, table, mu_0

    law = find_key('friction', 'law')
    table = find_key('friction', 'table')
    speed = find_key('friction', 'table_speed')
    mu = find_key('friction', 'table_mu')
    mu_0 = find_key('friction', 'mu_0')
    if (usage(deck, table) /= used .or. .not. deck%value(law)%valid) return
    ! mu_0 follows from the points, and is not missing.
    deck%value(mu_0)%attempted = .true.
    if (deck%value(table)%user .and. deck%text_of('friction', 'table') /= '') then
      place = deck%value(table)%place
      deck%value(speed)%attempted = .true.
      deck%value(mu)%attempted = .true.
      if (.not. deck%value(table)%valid) return
      if (deck%value(speed)%user .or. deck%value(mu)%user) then
        call deck%faults%add(place, "'table' beside 'table_speed' or 'table_mu': give the file, or the points themselves")
        return
      end if
      path = path_beside(deck%name, deck%text_of('friction', 'table'))
      call read_points(path, deck%value(speed)%reals, deck%value(mu)%reals, problem)
      if (problem /= '') then
        call deck%faults%add(place, 'friction.table: '//problem)
        return
      end if
      deck%value(speed)%user = .true.
      deck%value(mu)%user = .true.
      deck%value(speed)%place = place
      deck%value(mu)%place = place
      deck%value(table)%texts(1) = ''
      deck%value(table)%user = .false.
    end if
    if (.not. (deck%value(speed)%user .and. deck%value(mu)%user)) return
    if (.not. (deck%value(speed)%valid .and. deck%value(mu)%valid)) return
    call check_points(deck, speed, mu, mu_0)
  end subroutine take_friction_table

  !> At least two points of increasing speed from 0 on.
  subroutine check_points(deck, speed, mu, mu_0)
    type(deck_t), intent(inout) :: deck
    integer, intent(in) :: speed, mu, mu_0
    character(:), allocatable :: problem
    integer :: i

    problem = ''
    associate (v => deck%value(speed)%reals, f => deck%value(mu)%reals)
      if (size(v) /= size(f)) then
        problem = integer_text(size(v))//" value(s) of 'table_speed' but "//integer_text(size(f))// &
          " of 'table_mu': give one friction coefficient for each slip velocity"
      else if (size(v) < least_points .or. size(v) > most_points) then
        problem = integer_text(size(v))//" point(s) in 'table_speed': give "//integer_text(least_points)//' to '// &
          integer_text(most_points)
      else if (abs(v(1)) > 0.0_wp) then
        problem = "table_speed(1) = '"//real_text(v(1))//"' is not the start: the first slip velocity must be 0.0 m/s"
      end if
      do i = 2, size(v)
        if (problem /= '') exit
        if (.not. v(i) > v(i - 1)) then
          problem = 'table_speed('//integer_text(i)//") = '"//real_text(v(i))//"' is not above the slip velocity ahead of it, "// &
            real_text(v(i - 1))//' m/s: slip velocities must increase'
        else if (.not. abs(f(i) - f(i - 1))/steepest < v(i) - v(i - 1)) then
          problem = 'table_mu('//integer_text(i)//") = '"//real_text(f(i))//"' changes by more than "//real_text(steepest)// &
            ' per m/s: give points further apart'
        end if
      end do
      if (problem == '' .and. deck%value(mu_0)%user .and. deck%value(mu_0)%valid) then
        if (abs(deck%value(mu_0)%reals(1) - f(1)) > 0.0_wp) then
          call deck%faults%add(deck%value(mu_0)%place, "mu_0 = '"//real_text(deck%value(mu_0)%reals(1))// &
            "' is not the first friction coefficient of the table, "//real_text(f(1))//': remove mu_0')
          return
        end if
      end if
      if (problem /= '') then
        call deck%faults%add(deck%value(speed)%place, problem)
      else
        deck%value(mu_0)%reals = [f(1)]
      end if
    end associate
  end subroutine check_points

  !> The points in a CSV file; `problem` is '' or names the file, the line, and what to do.
  subroutine read_points(path, speed, mu, problem)
    character(*), intent(in) :: path
    real(wp), allocatable, intent(inout) :: speed(:), mu(:)
    character(:), allocatable, intent(out) :: problem
    type(csv_table_t) :: table
    character(:), allocatable :: text
    integer :: line

    call read_text(path, most_bytes, text, problem)
    if (problem /= '') then
      problem = path//': '//problem//': give the path of a CSV file with the columns '//columns
      return
    end if
    call read_csv(text, table, problem)
    if (problem == '') then
      call check_table(table, line, problem)
      if (problem /= '' .and. line > 0) problem = ':'//integer_text(line)//': '//problem
      if (problem /= '' .and. line == 0) problem = ': '//problem
    end if
    if (problem /= '') then
      problem = path//problem
      return
    end if
    speed = table%values(1, :)
    mu = table%values(2, :)
  end subroutine read_points

  !> What is wrong with a table of points, and in which line if it is in one; else '' and 0.
  subroutine check_table(table, line, problem)
    type(csv_table_t), intent(in) :: table
    integer, intent(out) :: line
    character(:), allocatable, intent(out) :: problem
    integer :: n

    problem = ''
    line = table%first_line
    if (line > 0) then
      if (size(table%names) /= 2) then
        problem = integer_text(size(table%names))//' value(s): give two in each row, '//columns
      else if (table%has_names .and. .not. (is_name(1, 'table_speed') .and. is_name(2, 'table_mu'))) then
        problem = "'"//excerpt(trim(table%names(1)))//"', '"//excerpt(trim(table%names(2)))// &
          "' are neither two finite real numbers nor their names: name the columns in the first line: "//columns
      end if
      if (problem /= '') return
    end if
    do n = 1, size(table%line)
      line = table%line(n)
      associate (row => table%values(:, n))
        if (n > most_points) then
          problem = 'more than '//integer_text(most_points)//' points: give fewer'
        else if (any(row < 0.0_wp)) then
          problem = real_text(minval(row))//' is negative: slip velocities and friction coefficients must be >= 0'
        else if (n > 1) then
          if (.not. row(1) > table%values(1, n - 1)) problem = 'slip velocity '//real_text(row(1))// &
            ' m/s is not above the one ahead of it, '//real_text(table%values(1, n - 1))//' m/s: slip velocities must increase'
        end if
      end associate
      if (problem /= '') return
    end do
    line = 0
    n = size(table%line)
    if (n < least_points) problem = integer_text(n)//' point(s): give at least '//integer_text(least_points)// &
      ', a row for each: '//columns

  contains

    !> Whether column `k` has this name, with its group or without.
    logical function is_name(k, name)
      integer, intent(in) :: k
      character(*), intent(in) :: name

      is_name = lower_case(table%names(k)) == name .or. lower_case(table%names(k)) == 'friction.'//name
    end function is_name
  end subroutine check_table
end module dst_friction_table
