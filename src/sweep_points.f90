!> The sweep of a deck: its grid, or its list of points from a CSV file: names of keys in the first line, a case in each other line.
module dst_sweep_points
  use dst_errors, only: error_t, raise, file_error
  use dst_kinds, only: wp, int64
  use dst_deck, only: deck_t
  use dst_schema, only: sweep_group
  use dst_sweep, only: axis_t, sweep_t, new_sweep
  use dst_text, only: integer_text, read_real, word, word_count
  implicit none
  private

  public :: sweep_of_deck

contains

  !> The sweep of a deck that has been checked.
  subroutine sweep_of_deck(deck, sweep, error)
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(out) :: sweep
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), allocatable :: axes(:)

    if (deck%text_of(sweep_group, 'points') == '') then
      call new_sweep(deck, sweep, error)
    else
      call read_points(deck%text_of(sweep_group, 'points'), deck%name, axes, error)
      if (.not. allocated(error)) call new_sweep(deck, sweep, error, axes, .true.)
    end if
  end subroutine sweep_of_deck

  !> Read `file_name`; a relative name is looked for beside the deck.
  subroutine read_points(file_name, deck_name, axes, error)
    character(*), intent(in) :: file_name, deck_name
    type(axis_t), allocatable, intent(out) :: axes(:)
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: path
    character(1000) :: line
    real(wp), allocatable :: table(:, :), larger(:, :)
    integer :: unit, status, i, n

    path = file_name
    if (path(1:1) /= '/') path = deck_name(:index(deck_name, '/', back=.true.))//file_name
    open (newunit=unit, file=path, status='old', action='read', iostat=status)
    if (status == 0) read (unit, '(a)', iostat=status) line
    if (status /= 0) then
      call raise(error, file_error, path//': cannot be read: give a CSV file with names of keys in its first line')
      return
    end if
    call blank_out(line)
    allocate (axes(word_count(line)))
    do i = 1, size(axes)
      axes(i)%name = word(line, i)
    end do
    allocate (table(size(axes), 64))
    n = 0
    do
      read (unit, '(a)', iostat=status) line
      if (status /= 0) exit
      call blank_out(line)
      if (line == '') cycle
      if (n == size(table, 2)) then
        allocate (larger(size(axes), 2*n))
        larger(:, :n) = table
        call move_alloc(larger, table)
      end if
      n = n + 1
      call read_row(line, table(:, n), path, n + 1, error)
      if (allocated(error)) exit
    end do
    close (unit)
    do i = 1, size(axes)
      axes(i)%values = table(i, :n)
    end do
  end subroutine read_points

  subroutine read_row(line, values, path, number, error)
    character(*), intent(in) :: line, path
    real(wp), intent(out) :: values(:)
    integer, intent(in) :: number
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: problem
    integer :: i

    values = 0.0_wp
    if (word_count(line) /= size(values)) then
      call raise(error, file_error, path//':'//integer_text(int(number, int64))//': '// &
        integer_text(int(word_count(line), int64))//' value(s): the first line names '//integer_text(int(size(values), int64)))
      return
    end if
    do i = 1, size(values)
      call read_real(word(line, i), values(i), problem)
      if (problem == '') cycle
      call raise(error, file_error, path//':'//integer_text(int(number, int64))//": '"//word(line, i)//"' "//problem// &
        ': give a finite real number')
      return
    end do
  end subroutine read_row

  !> Separators and quotes as blanks.
  pure subroutine blank_out(line)
    character(*), intent(inout) :: line
    integer :: i

    do i = 1, len(line)
      if (scan(line(i:i), ',;"'//achar(9)//achar(13)) > 0) line(i:i) = ' '
    end do
  end subroutine blank_out
end module dst_sweep_points
