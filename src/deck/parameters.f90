!> The keys of a deck as a result file shows them: name, unit, meaning, value.
module dst_parameters
  use dst_kinds, only: wp
  use dst_deck_values, only: deck_t, usage, element_count, used
  use dst_schema, only: schema, key_count, sweep_group, is_automatic, is_text
  use dst_writer, only: quantity_t
  implicit none
  private

  public :: parameter_t, parameters_of

  !> One key as used; `text` is allocated for keys that hold text.
  type :: parameter_t
    type(quantity_t) :: quantity
    real(wp) :: value = 0.0_wp
    character(:), allocatable :: text
  end type parameter_t

contains

  !> Every key that the deck uses and that has a single value. For output.interval = 'auto' the value is the `interval` [s] that is
  !> used; if there is none the key is omitted.
  subroutine parameters_of(deck, parameters, interval)
    type(deck_t), intent(in) :: deck
    type(parameter_t), allocatable, intent(out) :: parameters(:)
    real(wp), intent(in), optional :: interval
    type(parameter_t) :: found(key_count)
    integer :: i, k, n
    logical :: is_chosen

    n = 0
    do i = 1, key_count
      associate (key => schema(i), value => deck%value(i))
        if (key%group == sweep_group .or. usage(deck, i) /= used) cycle
        if (.not. is_text(key) .and. element_count(value) /= 1) cycle
        is_chosen = .false.
        if (.not. is_text(key)) is_chosen = is_automatic(key, value%reals(1))
        if (is_chosen .and. .not. present(interval)) cycle
        n = n + 1
        found(n)%quantity = quantity_t(key%name, key%unit, key%meaning)
        if (key%unit == '') found(n)%quantity%units = '1'
        if (is_text(key)) then
          found(n)%text = trim(value%texts(1))
          do k = 2, size(value%texts)
            found(n)%text = found(n)%text//' '//trim(value%texts(k))
          end do
        else
          found(n)%value = value%reals(1)
          if (is_chosen) found(n)%value = interval
        end if
      end associate
    end do
    allocate (parameters, source=found(:n))
  end subroutine parameters_of
end module dst_parameters
