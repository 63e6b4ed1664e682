!> The points of the law 'table': lists in the deck, or a CSV file next to it.
!>
!> The file has two columns, slip velocity [m/s] and friction coefficient, and may name them in its first line: table_speed and
!> table_mu. Its numbers become values of these keys, so that the resolved deck contains the points and the file is read once.
module dst_friction_table
  use dst_csv, only: blanks, find_fields, find_line, first_byte, line_end_of, separator_of
  use dst_deck_values, only: deck_t, usage, used
  use dst_faults, only: place_t
  use dst_kinds, only: wp, int64
  use dst_schema, only: find_key
  use dst_text, only: excerpt, integer_text, lower_case, read_real, real_text
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
      path = deck%text_of('friction', 'table')
      if (path(1:1) /= '/') path = deck%name(:index(deck%name, '/', back=.true.))//path
      call read_table(path, deck%value(speed)%reals, deck%value(mu)%reals, problem)
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
  subroutine read_table(path, speed, mu, problem)
    character(*), intent(in) :: path
    real(wp), allocatable, intent(inout) :: speed(:), mu(:)
    character(:), allocatable, intent(out) :: problem
    character(:), allocatable :: text
    real(wp) :: row(2), point(2, most_points)
    character :: separator, line_end
    integer :: first, last, next, line, n
    logical :: begins, is_point

    call read_text(path, text, problem)
    if (problem /= '') return
    line_end = line_end_of(text)
    next = first_byte(text)
    line = 0
    n = 0
    begins = .true.
    do while (next <= len(text))
      call find_line(text, line_end, next, first, last)
      line = line + 1
      if (verify(text(first:last), blanks) == 0) cycle
      if (begins) separator = separator_of(text(first:last))
      call read_row(text(first:last), separator, begins, row, is_point, problem)
      begins = .false.
      if (problem == '' .and. is_point .and. n == most_points) problem = 'more than '//integer_text(most_points)// &
        ' points: give fewer'
      if (problem == '' .and. is_point .and. n > 0) then
        if (.not. row(1) > point(1, n)) problem = 'slip velocity '//real_text(row(1))//' m/s is not above the one ahead of it, '// &
          real_text(point(1, n))//' m/s: slip velocities must increase'
      end if
      if (problem == '' .and. is_point .and. any(row < 0.0_wp)) &
        problem = real_text(minval(row))//' is negative: slip velocities and friction coefficients must be >= 0'
      if (problem /= '') then
        problem = path//':'//integer_text(line)//': '//problem
        return
      end if
      if (.not. is_point) cycle
      n = n + 1
      point(:, n) = row
    end do
    if (n < least_points) then
      problem = path//': '//integer_text(n)//' point(s): give at least '//integer_text(least_points)//', a row for each: '//columns
      return
    end if
    speed = point(1, :n)
    mu = point(2, :n)
  end subroutine read_table

  !> A line of the file: a point, or the names of the columns if it is the first.
  subroutine read_row(line, separator, begins, row, is_point, problem)
    character(*), intent(in) :: line
    character, intent(in) :: separator
    logical, intent(in) :: begins
    real(wp), intent(out) :: row(2)
    logical, intent(out) :: is_point
    character(:), allocatable, intent(out) :: problem
    integer, allocatable :: bounds(:, :)
    integer :: i
    logical :: is_named(2)

    row = 0.0_wp
    problem = ''
    call find_fields(line, separator, bounds)
    is_point = .true.
    if (size(bounds, 2) /= 2) then
      problem = integer_text(size(bounds, 2))//' value(s): give two in each row, '//columns
      return
    end if
    if (begins) then
      is_named = [is_name(1, 'table_speed'), is_name(2, 'table_mu')]
      is_point = .not. all(is_named)
      if (.not. is_point) return
    end if
    do i = 1, 2
      associate (field => line(bounds(1, i):bounds(2, i)))
        call read_real(field, row(i), problem)
        if (problem == '') cycle
        problem = "'"//excerpt(field)//"' "//problem//': give a finite real number'
        if (begins) problem = problem//', or name the columns in the first line: '//columns
        return
      end associate
    end do

  contains

    !> Whether field `k` is this name, with its group or without.
    logical function is_name(k, name)
      integer, intent(in) :: k
      character(*), intent(in) :: name
      character(:), allocatable :: field

      field = lower_case(line(bounds(1, k):bounds(2, k)))
      is_name = field == name .or. field == 'friction.'//name
    end function is_name
  end subroutine read_row

  !> The bytes of a regular file of acceptable size; `problem` is '' or says why they cannot be read.
  subroutine read_text(path, text, problem)
    character(*), intent(in) :: path
    character(:), allocatable, intent(out) :: text, problem
    character(256) :: message
    integer(int64) :: bytes
    integer :: unit, ios
    logical :: exists

    text = ''
    problem = ''
    bytes = 0_int64
    inquire (file=path, exist=exists, size=bytes)
    if (.not. exists) then
      problem = path//': no such file: give the path of a CSV file with the columns '//columns
    else if (bytes > most_bytes) then
      problem = path//': '//integer_text(bytes)//' bytes are too many: give at most '//integer_text(most_points)//' points'
    else if (bytes <= 0) then
      ! Pipes and devices have no size either, and opening one could wait forever.
      problem = path//': is empty or not a regular file: give a CSV file with the columns '//columns
    end if
    if (problem /= '') return
    open (newunit=unit, file=path, access='stream', form='unformatted', status='old', action='read', iostat=ios, iomsg=message)
    if (ios == 0) then
      text = repeat(' ', int(bytes))
      read (unit, iostat=ios, iomsg=message) text
      close (unit)
    end if
    if (ios /= 0) problem = path//': cannot be read ('//trim(message)//'): give a readable CSV file'
  end subroutine read_text
end module dst_friction_table
