!> The points of `trade` as a table: the one description of /trade in the file and of the columns in Python.
module dst_trade_table
  use dst_kinds, only: wp
  use dst_trade, only: trade_t, point_t
  use dst_trade_quantities, only: quantities, quantity_count, not_applicable
  use dst_writer, only: table_column_t
  implicit none
  private

  public :: table_of

contains

  !> One row a point: the reference, the run that tells its error, and the candidates in the order in which they were tried.
  function table_of(trade) result(table)
    type(trade_t), intent(in) :: trade
    type(table_column_t), allocatable :: table(:)
    type(point_t), allocatable :: points(:)
    integer :: q, n, i

    allocate (points(size(trade%points) + 2))
    points(1) = trade%best
    points(2) = trade%second
    points(3:) = trade%points
    allocate (table(15 + quantity_count))
    n = 0
    call put_numbers('point', '1', 'number of the point', [(real(i, wp), i=1, size(points))])
    call put_texts('role', 'reference, check (its errors are those of the reference) or candidate', &
      [character(200) :: 'reference', 'check', spread('candidate', 1, size(trade%points))])
    ! In parentheses: values, not parts of the points.
    call put_texts('model', 'equations', (points%candidate%model))
    call put_texts('form', 'of Eq. (8)', (points%candidate%form))
    call put_texts('method', 'integrator; empty for a closed form', (points%candidate%method))
    call put_texts('contact', 'exact or smoothed; empty where the model has no choice', (points%candidate%contact))
    call put_numbers('rtol', '1', 'relative tolerance; 0 = not used', (points%candidate%rtol))
    call put_numbers('step', 's', 'fixed step; 0 = not used', (points%candidate%step))
    call put_numbers('v_smooth', 'm s-1', 'smoothing velocity; 0 = not used', (points%candidate%v_smooth))
    call put_numbers('seconds', 's', 'wall time; of an abandoned run what it would have been at its pace', (points%seconds))
    call put_numbers('steps', '1', 'accepted steps', (points%steps))
    call put_numbers('rhs', '1', 'evaluations of the equations of motion', (points%rhs))
    call put_numbers('newton', '1', 'Newton iterations', (points%newton))
    call put_numbers('result_code', '1', '0 = done, 40 to 49 = the solver gave up, 75 = no budget, 2 = cannot be used', &
      real(points%result_code, wp))
    do q = 1, quantity_count
      call put_numbers('error_'//trim(quantities(q)%name), '1', 'error of: '//quantities(q)%long_name, (points%error(q)))
      table(n)%fill = not_applicable
    end do
    call put_texts('text', 'how it ended', (points%text))

  contains

    subroutine put_numbers(name, units, long_name, values)
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: values(:)

      n = n + 1
      table(n)%quantity%name = name
      table(n)%quantity%units = units
      table(n)%quantity%long_name = long_name
      allocate (table(n)%number, source=values)
    end subroutine put_numbers

    subroutine put_texts(name, long_name, texts)
      character(*), intent(in) :: name, long_name, texts(:)
      integer :: row

      n = n + 1
      table(n)%quantity%name = name
      table(n)%quantity%units = '1'
      table(n)%quantity%long_name = long_name
      allocate (table(n)%text(size(texts)))
      do row = 1, size(texts)
        table(n)%text(row) = texts(row)
      end do
    end subroutine put_texts
  end function table_of
end module dst_trade_table
