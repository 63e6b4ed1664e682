!> Sweeps: the values of a grid, over the whole range of numbers, and no more cases than can be counted; the limits of what a case
!> may keep; and shares: every case is in one of them, a share knows its rows, and a file its share.
program test_sweep
  use checks, only: check, finish
  use dst_cycles, only: most_cycles
  use dst_deck, only: deck_t, parse_deck
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_schema, only: schema, find_key, sweep_group
  use dst_share, only: share_t
  use dst_sweep, only: sweep_t, new_sweep
  use dst_text, only: integer_text
  implicit none

  character, parameter :: n = new_line('a')
  character(*), parameter :: scene = '&scene'//n//" model = 'low_frequency', t_end = 1.0"//n//'/'//n// &
    '&system'//n//' mass = 0.25, stiffness_x = 1e3, misalignment_deg = 1.0'//n//'/'//n// &
    '&friction'//n//' mu_0 = 0.2, mu_inf = 0.15, v_f = 0.01, normal_load = 10.0'//n//'/'//n// &
    '&drive'//n//' velocity = 1e-3'//n//'/'//n

  integer :: cases

  call check_values('ratio beyond the numbers', 'friction.v_f', '1e-300', '1e300', 'log')
  call check_values('negative, ratio beyond the numbers', 'initial.elongation_x', '-1e300', '-1e-300', 'log')
  call check_values('difference beyond the numbers', 'initial.elongation_x', '-9.9e307', '9.9e307', 'linear')
  call check_values('usual, log', 'friction.v_f', '1e-3', '1e-1', 'log')
  call check_values('usual, linear', 'system.misalignment_deg', '-3.0', '7.0', 'linear')
  call check('as many cycles may be kept as the means are over at most', &
    nint(schema(find_key(sweep_group, 'cycles'))%range%high) == most_cycles)
  do cases = 1, 40
    call check_division(cases)
  end do
  call check_name('phi.h5', 'phi.3-of-16.h5')
  call check_name('a.b/phi', 'a.b/phi.3-of-16')
  call check_name('a.b/phi.x.h5', 'a.b/phi.x.3-of-16.h5')
  call check_name('.h5', '.h5.3-of-16')
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

  !> Cases of all shares are those of the sweep, in order, and as evenly divided as can be.
  subroutine check_division(cases)
    integer, intent(in) :: cases
    type(share_t) :: share
    integer :: taken(cases), i, n, row
    logical :: is_even

    do n = 1, cases + 3
      taken = 0
      is_even = .true.
      do i = 1, n
        share = share_t(i, n)
        is_even = is_even .and. abs(share%size(cases) - cases/n) <= 1
        do row = 1, share%size(cases)
          taken(share%case_of(row)) = taken(share%case_of(row)) + 1
        end do
      end do
      call check(integer_text(cases)//' cases in '//integer_text(n)//' shares', all(taken == 1) .and. is_even)
    end do
  end subroutine check_division

  subroutine check_name(result_file, expected)
    character(*), intent(in) :: result_file, expected
    type(share_t) :: share

    share = share_t(3, 16)
    call check('the file of share 3/16 of '//result_file, share%file_name(result_file) == expected)
    share = share_t()
    call check('all of '//result_file, share%file_name(result_file) == result_file)
  end subroutine check_name
end program test_sweep
