!> What `trade` has found, as text: the reference, every point that was measured, and every one that was not with the reason.
module dst_trade_report
  use dst_kinds, only: wp
  use dst_errors, only: result_done
  use dst_text, only: text_builder_t
  use dst_trade, only: trade_t, point_t, resolution
  use dst_trade_plan, only: candidate_t
  use dst_trade_quantities, only: quantities
  use dst_writer, only: find_quantity
  implicit none
  private

  public :: trade_report

  !> Quantities that get a column: name and heading.
  character(*), parameter :: shown(5) = [character(16) :: 'final_elongation', 'final_velocity', 'period', 'peak_force', &
    'creep_velocity']
  character(*), parameter :: headings(5) = [character(10) :: 'final u', 'final w', 'period', 'peak', 'creep']

  integer, parameter :: name_width = 63

contains

  !> The table of a comparison as text.
  function trade_report(trade) result(text)
    type(trade_t), intent(in) :: trade
    character(:), allocatable :: text
    type(text_builder_t) :: builder
    integer :: i

    call builder%line('Errors against the reference; <: below 100 times its own; -: the scene has no such value.')
    call builder%line(head()//error_heads()//'       wall s      Newton         rhs')
    call builder%line(row(trade, trade%best, 'reference', errors=.false.))
    call builder%line(row(trade, trade%second, 'its error', errors=.true.))
    do i = 1, size(trade%points)
      if (trade%points(i)%result_code == result_done) call builder%line(row(trade, trade%points(i), '', errors=.true.))
    end do
    if (any(trade%points%result_code /= result_done)) call builder%line('Without result:')
    do i = 1, size(trade%points)
      if (trade%points(i)%result_code == result_done) cycle
      call builder%line(name_of(trade%points(i)%candidate)//'  '//trade%points(i)%text)
    end do
    text = builder%content()
  end function trade_report

  pure function head() result(text)
    character(:), allocatable :: text
    character(name_width) :: buffer

    buffer = 'model                method      rtol      step s    v_smooth'
    text = buffer
  end function head

  pure function error_heads() result(text)
    character(:), allocatable :: text
    integer :: q

    text = ''
    do q = 1, size(headings)
      text = text//' '//headings(q)
    end do
  end function error_heads

  function name_of(candidate) result(text)
    type(candidate_t), intent(in) :: candidate
    character(name_width) :: text

    text = candidate%model
    if (candidate%form /= '') text = 'Eq. (8) '//candidate%form
    text(22:) = candidate%method
    text(34:) = number_or_blank(candidate%rtol)//'  '//number_or_blank(candidate%step)//'  '//number_or_blank(candidate%v_smooth)
  end function name_of

  function number_or_blank(value) result(text)
    real(wp), intent(in) :: value
    character(8) :: text

    text = ''
    if (value > 0.0_wp) write (text, '(es8.1)') value
  end function number_or_blank

  !> One line of the table; `role` is shown in place of the smoothing velocity.
  function row(trade, point, role, errors) result(text)
    type(trade_t), intent(in) :: trade
    type(point_t), intent(in) :: point
    character(*), intent(in) :: role
    logical, intent(in) :: errors
    character(:), allocatable :: text
    character(name_width) :: name
    character(40) :: costs
    integer :: i

    name = name_of(point%candidate)
    if (role /= '') name(54:) = role
    text = name
    do i = 1, size(shown)
      text = text//' '//error_text(find_quantity(quantities, shown(i)))
    end do
    write (costs, '(es13.2,2i12)') point%seconds, nint(point%newton), nint(min(point%rhs, 2.0e9_wp))
    text = text//costs

  contains

    !> An error in ten characters.
    function error_text(q) result(entry)
      integer, intent(in) :: q
      character(10) :: entry
      real(wp) :: floor

      floor = resolution*trade%reference_error(q)
      if (trade%reference_error(q) < 0.0_wp) then
        entry = '-'
      else if (.not. errors) then
        entry = ''
      else if (role == '' .and. point%error(q) <= floor) then
        write (entry, '(a,es7.1)') '<', max(floor, epsilon(floor))
      else
        write (entry, '(1x,es7.1)') point%error(q)
      end if
    end function error_text
  end function row
end module dst_trade_report
