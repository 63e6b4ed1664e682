!> The values of a grid: over the whole range of numbers, and no more cases than can be counted; and the limits of what a case may
!> keep.
program test_sweep_grid
  use checks, only: check, finish
  use dst_cycles, only: most_cycles
  use dst_deck, only: deck_t, parse_deck
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_schema, only: schema, find_key, sweep_group
  use dst_sweep, only: sweep_t, new_sweep
  implicit none

  character, parameter :: n = new_line('a')
  character(*), parameter :: scene = '&scene'//n//" model = 'low_frequency', t_end = 1.0"//n//'/'//n// &
    '&system'//n//' mass = 0.25, stiffness_x = 1e3, misalignment_deg = 1.0'//n//'/'//n// &
    '&friction'//n//' mu_0 = 0.2, mu_inf = 0.15, v_f = 0.01, normal_load = 10.0'//n//'/'//n// &
    '&drive'//n//' velocity = 1e-3'//n//'/'//n

  call check_values('ratio beyond the numbers', 'friction.v_f', '1e-300', '1e300', 'log')
  call check_values('negative, ratio beyond the numbers', 'initial.elongation_x', '-1e300', '-1e-300', 'log')
  call check_values('difference beyond the numbers', 'initial.elongation_x', '-9.9e307', '9.9e307', 'linear')
  call check_values('usual, log', 'friction.v_f', '1e-3', '1e-1', 'log')
  call check_values('usual, linear', 'system.misalignment_deg', '-3.0', '7.0', 'linear')
  call check('as many cycles may be kept as the means are over at most', &
    nint(schema(find_key(sweep_group, 'cycles'))%range%high) == most_cycles)
  call finish()

contains

  !> All values are in order between both ends, which are exact.
  subroutine check_values(what, key, first, last, spacing)
    character(*), intent(in) :: what, key, first, last, spacing
    type(deck_t), allocatable :: deck
    type(sweep_t), allocatable :: sweep
    type(error_t), allocatable :: error
    character(1) :: no_settings(0)
    real(wp) :: ends(2)

    allocate (deck, sweep)
    call parse_deck(scene//'&sweep'//n//" parameter = '"//key//"', count = 9"//n//' first = '//first//', last = '//last//n// &
      " spacing = '"//spacing//"'"//n//'/'//n, 'deck', no_settings, deck, error)
    call check(what//': is read', .not. allocated(error))
    if (allocated(error)) return
    call new_sweep(deck, sweep, error)
    call check(what//': is a sweep of nine cases', .not. allocated(error) .and. sweep%cases == 9)
    read (first, *) ends(1)
    read (last, *) ends(2)
    associate (values => sweep%axes(1)%values)
      call check(what//': ends', all(abs(values([1, 9]) - ends) <= 0.0_wp))
      call check(what//': order', all(values(2:) > values(:8)))
    end associate
  end subroutine check_values
end program test_sweep_grid
