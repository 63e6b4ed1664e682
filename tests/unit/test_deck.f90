!> Text, schema, scanner and deck.
program test_deck
  use checks, only: check, finish
  use dst_kinds, only: wp, int64
  use dst_errors, only: error_t, deck_error
  use dst_text, only: real_text, integer_text, quoted_text, read_real, read_integer, nearest_word, excerpt, word, word_count, &
                      has_word, lower_case
  use dst_schema, only: schema, key_count, group_names, sweep_group, keys_of, find_key, find_name, in_range, is_word_of, &
                        automatic, condition_count, condition_text, real_kind, choice_kind
  use dst_deck, only: deck_t, parse_deck, template
  implicit none

  character, parameter :: n = achar(10)
  character(*), parameter :: none(0) = [character(1) ::]
  character(*), parameter :: scene_group = '&scene t_end = 10.0 /'//n
  character(*), parameter :: system_group = '&system mass = 0.25, stiffness_x = 1e3, stiffness_y = 1e7, misalignment_deg = 1 /'//n
  character(*), parameter :: friction_group = '&friction mu_0 = 0.2, mu_inf = 0.15, v_f = 0.01, normal_load = 10 /'//n
  character(*), parameter :: drive_group = '&drive velocity = 1e-3 /'//n
  character(*), parameter :: rest = system_group//friction_group//drive_group
  character(*), parameter :: whole = scene_group//rest

  call test_numbers()
  call test_words()
  call test_schema()
  call test_good_decks()
  call test_bad_decks()
  call test_conditions()
  call test_drive()
  call test_settings()
  call test_template()

  call finish()

contains

  subroutine check_text(name, actual, expected)
    character(*), intent(in) :: name, actual, expected

    call check(name//": '"//actual//"' instead of '"//expected//"'", actual == expected .and. len(actual) == len(expected))
  end subroutine check_text

  logical function same_bits(a, b)
    real(wp), intent(in) :: a, b

    same_bits = transfer(a, 0_int64) == transfer(b, 0_int64)
  end function same_bits

  ! --- text

  subroutine test_numbers()
    integer :: i
    real(wp) :: x, u(2)
    real(wp), parameter :: numbers(10) = [0.0_wp, -0.0_wp, 10.0_wp, 0.1_wp, 1.0e-3_wp, 12345.678_wp, 1.0e7_wp, 1.0_wp/3.0_wp, &
      -2.5e-9_wp, 1.5e-200_wp]
    character(*), parameter :: texts = '0.0 -0.0 10.0 0.1 1.0e-3 12345.678 1.0e7 0.3333333333333333 -2.5e-9 1.5e-200'
    character(*), parameter :: reals = '1 -.5 5. +1d3 1.5D-03 1E+2 -0.0 0e999 1e0000000000002 9.999e307'
    real(wp), parameter :: values(10) = [1.0_wp, -0.5_wp, 5.0_wp, 1000.0_wp, 1.5e-3_wp, 100.0_wp, -0.0_wp, 0.0_wp, 100.0_wp, &
      9.999e307_wp]
    character(*), parameter :: not_reals = '. + - e3 .e3 1e 1e+ 1+3 1.0-3 1..2 1.2.3 0x10 NaN nan Infinity inf -inf 1.0f0 1_8 '// &
      '1,5 1e1.5 --1 1e--1 1d3e2 true z'

    do i = 1, size(numbers)
      call check_text('real_text', real_text(numbers(i)), word(texts, i))
    end do
    call random_seed()
    do i = 1, 2000
      call random_number(u)
      x = sign((0.1_wp + u(1))*10.0_wp**nint(600.0_wp*(u(2) - 0.5_wp)), u(1) - 0.5_wp)
      call check_read(real_text(x), x)
    end do
    do i = 1, size(values)
      call check_read(word(reals, i), values(i))
    end do
    do i = 1, word_count(not_reals)
      call check_no_real(word(not_reals, i), 'is not a real number')
    end do
    call check_no_real('', 'is not a real number')
    call check_no_real('1 2', 'is not a real number')
    call check_no_real(repeat('1', 300), 'is not a real number')
    call check_no_real('1e400', 'is beyond the range of double precision')
    call check_no_real('-1e99999999999999999999', 'is beyond the range of double precision')
    call check_no_real(repeat('1', 250)//'e99', 'is beyond the range of double precision')
    call check_no_real('9.99999999999999999999e307', 'is beyond the range of double precision')
    call check_no_real('9e308', 'is beyond the range of double precision')
    call check_no_real('1e-400', 'is below the range of double precision')
    call check_no_real('0.'//repeat('0', 240)//'1e-99', 'is below the range of double precision')
    call test_integers()
  end subroutine test_numbers

  subroutine check_read(text, expected)
    character(*), intent(in) :: text
    real(wp), intent(in) :: expected
    real(wp) :: value
    character(:), allocatable :: problem

    call read_real(text, value, problem)
    call check('read '//text//' '//problem, problem == '' .and. same_bits(value, expected))
  end subroutine check_read

  subroutine check_no_real(text, expected)
    character(*), intent(in) :: text, expected
    real(wp) :: value
    character(:), allocatable :: problem

    call read_real(text, value, problem)
    call check_text('refuse '//excerpt(text), problem, expected)
  end subroutine check_no_real

  subroutine test_integers()
    integer(int64) :: value
    character(:), allocatable :: problem
    integer :: i
    character(*), parameter :: not_integers = '1.0 1e3 + - 1- 0x1 a 1,2'

    call read_integer('-42', value, problem)
    call check('read -42', value == -42_int64 .and. problem == '')
    call read_integer('9223372036854775807', value, problem)
    call check('read the largest integer', value == huge(value) .and. problem == '')
    call check_text('largest integer', integer_text(huge(value)), '9223372036854775807')
    call read_integer('9223372036854775808', value, problem)
    call check_text('integer overflow', problem, 'is beyond the range of 64-bit integers')
    do i = 1, word_count(not_integers)
      call read_integer(word(not_integers, i), value, problem)
      call check_text('refuse '//word(not_integers, i), problem, 'is not an integer')
    end do
  end subroutine test_integers

  subroutine test_words()
    character(*), parameter :: wrong(6) = [character(12) :: 'masd', 'tiem', 'misalignment', 'MASS', 'damping', '']
    character(*), parameter :: near(6) = [character(16) :: 'mass', 'time', 'misalignment_deg', 'mass', '', '']
    integer :: i

    call check('word count', word_count('a bb ccc') == 3 .and. word_count('') == 0 .and. word_count('a  ') == 1)
    call check_text('second word', word('a bb ccc', 2), 'bb')
    call check_text('no fourth word', word('a bb ccc', 4), '')
    call check('a part is no word', has_word('abc def', 'def') .and. .not. has_word('abc def', 'ab'))
    call check('two words are no word', .not. has_word('abc def', 'abc def'))
    call check_text('lower case', lower_case('Mu_0Ü'), 'mu_0Ü')
    do i = 1, size(wrong)
      call check_text('near '//wrong(i), nearest_word(trim(wrong(i)), 'mass time title misalignment_deg'), trim(near(i)))
    end do
    call check_text('quotes doubled', quoted_text("it's"), "'it''s'")
    call check_text('short excerpt', excerpt('a'//achar(9)//'b'), 'a?b')
    call check('long excerpt', len(excerpt(repeat('x', 1000))) == 60)
    call check('excerpt keeps UTF-8 whole', verify(excerpt(repeat('é', 100)), 'é.') == 0 .and. &
               modulo(len(excerpt(repeat('é', 100))) - 3, 2) == 0)
  end subroutine test_words

  ! --- schema

  subroutine test_schema()
    integer :: i, j, k
    real(wp) :: x
    character(:), allocatable :: problem

    do i = 1, key_count
      associate (key => schema(i))
        call check('one key '//key%name, find_name(trim(key%name)) == i .and. find_key(trim(key%group), trim(key%name)) == i)
        call check('group of '//key%name, has_word(group_names, trim(key%group)))
        call check('meaning of '//key%name, key%meaning /= '')
        call check('a required key has a sample: '//key%name, .not. key%required .or. key%sample /= '' .or. key%default /= '')
        if (key%kind == choice_kind) call check('default of '//key%name, has_word(key%choices, trim(key%default)))
        if (is_word_of(key, trim(key%default))) then
          call check('the word stands outside the range: '//key%name, .not. in_range(key%range, automatic))
        else if (key%kind == real_kind .and. .not. key%required) then
          call read_real(trim(key%default), x, problem)
          call check('default in range: '//key%name, problem == '' .and. in_range(key%range, x))
        end if
        do j = 1, condition_count(key)
          call check('condition of '//key%name, find_name(key%used_by(j)%on) > 0)
          do k = 1, word_count(key%used_by(j)%choices)
            call check('choice '//word(key%used_by(j)%choices, k)//' of '//key%name, &
                       has_word(schema(find_name(key%used_by(j)%on))%choices, word(key%used_by(j)%choices, k)))
          end do
        end do
      end associate
    end do
    call check_text('keys of a group', keys_of('system'), 'mass stiffness_x stiffness_y damping_x damping_y misalignment_deg')
    call check_text('condition', condition_text(schema(find_name('step'))), 'method rk4')
  end subroutine test_schema

  ! --- decks

  !> Read a deck that must be valid.
  subroutine accept(text, deck)
    character(*), intent(in) :: text
    type(deck_t), intent(out) :: deck
    type(error_t), allocatable :: error

    call parse_deck(text, 'good.nml', none, deck, error)
    if (allocated(error)) call check(error%text, .false.)
  end subroutine accept

  subroutine test_good_decks()
    character(*), parameter :: others = 'stiffness_x=1e3 stiffness_y=1e7 misalignment_deg=1 /'
    character(*), parameter :: tail = n//scene_group//friction_group//drive_group
    type(deck_t) :: deck

    call accept(whole, deck)
    call check('set', deck%is_set('system', 'mass') .and. .not. deck%is_set('integrator', 'rtol'))
    call check('default', same_bits(deck%real_of('integrator', 'rtol'), 1.0e-8_wp))
    call check_text('default choice', deck%text_of('integrator', 'method'), 'radau13')
    call check('interval of files', same_bits(deck%real_of('output', 'checkpoint_interval'), 600.0_wp))
    call check_mass(drive_group//friction_group//system_group//scene_group)
    call check_mass('&system mass=0.25 '//others(:len(others) - 1)//'&end'//tail)
    call check_mass('&system mass=0.25 '//others(:len(others) - 1)//'&END'//tail)
    call check_mass('&SYSTEM MASS=0.25 '//others//tail)
    call check_mass('&system mass=0.25,stiffness_x=1e3,stiffness_y=1e7,misalignment_deg=1/'//tail)
    call check_mass('&system'//achar(9)//'mass'//achar(9)//'='//achar(9)//'0.25'//achar(9)//others//tail)
    call check_mass('&system'//achar(13)//n//'mass = 0.25'//achar(13)//n//others//achar(13)//tail)
    call check_mass('&system mass ='//n//'! comment'//n//' 0.25'//n//others//tail)
    call check_mass('&system mass'//n//' = 0.25 '//others//tail)
    call check_mass("! 'quote"//n//"&system ! it's / & ="//n//' mass = 0.25! "'//n//others//' ! end'//tail)
    call check_mass('&system mass = 0.25, '//others(:len(others) - 1)//', /'//tail)
    call check_mass('&system mass = 1*0.25 '//others//tail)
    call check_mass('&system mass = 2.5D-1 '//others//tail)
    call check_mass('&system mass = .25 '//others//tail)
    call check_mass('! µ, Ω, 摩擦'//n//'&system mass = 0.25 '//others//tail)
    call check_mass(char(239)//char(187)//char(191)//'&system mass = 0.25 '//others//tail)
    call check_mass(tail//'&system mass = 0.25 '//others)
    call check_mass('!'//repeat('x', 100000)//n//'&system mass = 0.25 '//others//tail)
    call check_mass(whole(:index(whole, 'normal') - 1)//'v_smooth = 0.0 '//whole(index(whole, 'normal'):)// &
                    '&integrator step = 0.0 /')
    call check_title("'it''s'", "it's")
    call check_title('"say ''no'' ""now"""', "say 'no' ""now""")
    call check_title("' a/b & c = d, ! e'", ' a/b & c = d, ! e')
    call check_title("'φ = 1°, 摩擦'", 'φ = 1°, 摩擦')
    call check_title("'"//repeat('x', 256)//"'", repeat('x', 256))
    call check_title("''", '')
    call accept(whole//"&output fields = 'u_x', 'X' 'zeta' /", deck)
    call check('fields', all(deck%texts_of('output', 'fields') == [character(4) :: 'u_x', 'X', 'zeta']))
    call accept(whole//'&integrator max_steps = 12345678901 /', deck)
    call check('integer', deck%integer_of('integrator', 'max_steps') == 12345678901_int64)
  end subroutine test_good_decks

  subroutine check_mass(text)
    character(*), intent(in) :: text
    type(deck_t) :: deck

    call accept(text, deck)
    call check('mass', same_bits(deck%real_of('system', 'mass'), 0.25_wp))
  end subroutine check_mass

  subroutine check_title(written, expected)
    character(*), intent(in) :: written, expected
    type(deck_t) :: deck

    call accept('&scene title='//written//' t_end=1 /'//rest, deck)
    call check_text('title', deck%text_of('scene', 'title'), expected)
  end subroutine check_title

  !> A deck with one fault, with `expected` in the text of the error. One of each kind: tests/python/test_decks.py.
  subroutine refuse(text, expected)
    character(*), intent(in) :: text, expected
    type(deck_t) :: deck
    type(error_t), allocatable :: error

    call parse_deck(text, 'bad.nml', none, deck, error)
    call check_refusal(error, deck_error, expected)
    if (allocated(error)) call check('one fault: '//error%text, index(error%text, n) == 0)
  end subroutine refuse

  subroutine check_refusal(error, code, expected)
    type(error_t), allocatable, intent(in) :: error
    integer, intent(in) :: code
    character(*), intent(in) :: expected

    call check('refused: '//expected, allocated(error))
    if (allocated(error)) call check("'"//expected//"' in "//error%text, error%code == code .and. index(error%text, expected) > 0)
  end subroutine check_refusal

  subroutine test_bad_decks()
    character(*), parameter :: s = '&scene t_end = 1'//n

    call refuse(s//' velocty=1 /'//n//rest, "the nearest is 'velocity' in &drive")
    call refuse("&scene t_end = title='x' /"//n//rest, "bad.nml:1: 't_end' has an empty value")
    call refuse('&scene t_end = 1,, /'//n//rest, "nothing before a ',' in 't_end'")
    call refuse("&scene t_end = '1' /"//n//rest, "'1' is text: 't_end' takes a real number without quotes")
    call refuse(s//' title = 3 /'//n//rest, "'3' is not text: 'title' takes text in quotes")
    call refuse(s//' model = full /'//n//rest, "'full' is not text: 'model' takes text in quotes")
    call refuse('&scene t_end = (1,2) /'//n//rest, "too many values for 't_end', from '2)' on: 2 given")
    call refuse(whole//'&integrator max_steps = 1e3 /', "'1e3' is not an integer")
    call refuse('&scene t_end = 2*1 /'//n//rest, "too many values for 't_end', from '1' on: 2 given")
    call refuse('&scene t_end = 2* /'//n//rest, "'2*' repeats nothing")
    call refuse(s//"title='"//repeat('x', 257)//"' /"//n//rest, '257 bytes given, at most 256 allowed')
    call refuse('$scene t_end=1 $end'//n//whole, "bad.nml:1: '$scene")
    call refuse('&scene t_end(1)=1 /'//n//rest, "'t_end(1)=1 /' sets a part of a key")
    call refuse('&scene t_end%x=1 /'//n//rest, "'t_end%x=1 /' sets a part of a key")
    call refuse('&scene t_end 1 /'//n//rest, "'t_end' without '='")
    call refuse('&scene t_end = = 1 /'//n//rest, "unexpected '= 1 /'")
    call refuse(s//"title='x'y /"//n//rest, "unexpected 'y /' in a value")
    call refuse('! '//char(228)//' '//n//whole, 'bad.nml:1: a character is not UTF-8')
    call refuse('! '//char(224)//char(128)//char(128)//n//whole, 'bad.nml:1: a character is not UTF-8')
    call refuse('! '//char(237)//char(160)//char(128)//n//whole, 'bad.nml:1: a character is not UTF-8')
    call refuse('! '//char(244)//char(144)//char(128)//char(128)//n//whole, 'bad.nml:1: a character is not UTF-8')
    call refuse(whole//'! '//char(226)//char(130), 'bad.nml:5: a character is not UTF-8')
    call refuse(whole//"&output fields='u_x'"//n//' 3 /', "bad.nml:6: '3' is not text")
    call refuse(whole//"&output fields='u_x','u_x' /", "'u_x' more than once in 'fields'")
    call refuse(whole//"&output fields='u_x','default' /", "'default' among other 'fields'")
    call test_all_in_one_go()
  end subroutine test_bad_decks

  subroutine test_all_in_one_go()
    type(deck_t) :: deck
    type(error_t), allocatable :: error
    integer :: lines, i

    call parse_deck('x'//n//'&scene t_end = -1, titel = 3 /'//n//system_group//'&friction mu_0 = a, normal_load = 1'//n// &
                    "contact = 'x /"//n//'/'//n//'&drive velocity = /', 'bad.nml', none, deck, error)
    call check('faults', allocated(error))
    if (.not. allocated(error)) return
    lines = 1 + count([(error%text(i:i) == n, i=1, len(error%text))])
    ! stray, range, unknown key, number, quote, empty value, and mu_inf and v_f missing.
    call check('eight faults at once'//n//error%text, lines == 8)
    call check('in the order of the lines', index(error%text, 'bad.nml:2:') < index(error%text, 'bad.nml:4:') .and. &
               index(error%text, 'bad.nml:4:') < index(error%text, 'bad.nml:5:'))
    call parse_deck(whole//'x', 'bad.nml', [character(13) :: 'system.mass=a', 'friction.mu=0'], deck, error)
    call check('the deck before the settings', index(error%text, 'bad.nml:5:') == 1 .and. &
               index(error%text, '--set system') < index(error%text, '--set friction'))
    call parse_deck(repeat('&x /'//n, 1000), 'bad.nml', none, deck, error)
    call check('a flood of faults ends', index(error%text, 'only the first faults are listed') > 0)
  end subroutine test_all_in_one_go

  !> Keys that a choice makes useless or necessary, through a second choice too.
  subroutine test_conditions()
    character(*), parameter :: constant = scene_group//system_group//drive_group// &
      "&friction law = 'constant', mu_0 = 0.2, normal_load = 10"
    character(*), parameter :: smoothed = scene_group//system_group//drive_group// &
      "&friction contact = 'smoothed', mu_0 = 0.2, mu_inf = 0.1, v_f = 0.01, normal_load = 10"
    type(deck_t) :: deck

    call accept(constant//' /', deck)
    call check('mu_inf unused', .not. deck%is_used('friction', 'mu_inf'))
    call refuse(constant//n//'v_f = 0.1 /', &
                "bad.nml:5: 'v_f' is not used with law constant: remove it, it works only with law weakening")
    call refuse(whole(:index(whole, 'mu_inf') - 1)//whole(index(whole, 'v_f'):), &
                "'mu_inf' is missing in &friction (needed with law weakening | stribeck)")
    call refuse(smoothed//' /', "'v_smooth' is missing in &friction (needed with contact smoothed)")
    call refuse(smoothed//' v_smooth = 0 /', "v_smooth = '0.0' is out of range: it must be > 0.0")
    call accept(smoothed//' v_smooth = 1e-9 /', deck)
    call refuse(whole(:index(whole, 'normal') - 1)//'v_smooth = 1e-6 '//whole(index(whole, 'normal'):), &
                "bad.nml:3: 'v_smooth' is not used with contact exact")
    call refuse(whole//'&integrator step = 1e-6 /', "'step' is not used with method radau13")
    call refuse(whole//"&integrator method = 'rk4' step = 1e-6 /", &
                "method 'rk4' cannot follow the exact contact of model 'full': choose contact = 'smoothed'")
    call accept(smoothed//" v_smooth = 1e-9 / &integrator method = 'rk4' step = 1e-6 /", deck)
    call refuse(smoothed//" v_smooth = 1e-9 / &integrator method = 'rk4' /", &
                "'step' is missing in &integrator (needed with method rk4)")
    call refuse(smoothed//" v_smooth = 1e-9 / &integrator method = 'rk4' step = 1e-6 rtol = 1e-5 /", &
                "'rtol' is not used with method rk4")
    call refuse(scene_group//system_group//drive_group//"&friction law = 'x' mu_0 = 0.2 normal_load = 1 /", "unknown law 'x'")
  end subroutine test_conditions

  subroutine test_drive()
    character(*), parameter :: head = scene_group//system_group//friction_group//'&drive '
    type(deck_t) :: deck

    call accept(head//'time = 0 1 1 3 velocity = 2*1e-3, 2*0 /', deck)
    call check('profile', all(abs(deck%reals_of('drive', 'velocity') - [1e-3_wp, 1e-3_wp, 0.0_wp, 0.0_wp]) <= 0.0_wp) .and. &
               all(abs(deck%reals_of('drive', 'time') - [0.0_wp, 1.0_wp, 1.0_wp, 3.0_wp]) <= 0.0_wp))
    call accept(head//'velocity = -1e-3 /', deck)
    call check('constant', size(deck%reals_of('drive', 'time')) == 1 .and. size(deck%reals_of('drive', 'velocity')) == 1)
    call refuse(head//n//'time = 0 1 velocity = 1 2 3 /', "bad.nml:5: 3 value(s) of 'velocity' but 2 of 'time'")
    call refuse(head//'velocity = 1 2 3 /', "3 value(s) of 'velocity' but 1 of 'time'")
    call refuse(head//'time = 1 2 velocity = 1 2 /', "time(1) = '1.0' is not the start")
    call refuse(head//'time = 0 2 1 velocity = 1 2 3 /', "time(3) = '1.0' is before the time ahead of it")
    call refuse(head//'time = 0 1 1 1 velocity = 1 2 3 4 /', "time(4) = '1.0' repeats a time once too often")
    call refuse(head//'time = 0 0 velocity = 1 2 /', "time(2) = '0.0' repeats a time once too often")
    call refuse(head//'time = 0 -1 velocity = 1 2 /', "time = '-1' is out of range")
    call refuse(head//'velocity = 1'//n//'2'//n//'x /', "bad.nml:6: 'x' is not a real number")
  end subroutine test_drive

  ! --- settings

  !> Settings that must be refused with `expected` in the error's text, or accepted if it is ''.
  subroutine set(settings, expected)
    character(*), intent(in) :: settings(:), expected
    type(deck_t) :: deck
    type(error_t), allocatable :: error

    call parse_deck(whole, 'deck.nml', settings, deck, error)
    if (expected /= '') then
      call check_refusal(error, deck_error, expected)
    else
      call check('accepted: '//settings(1), .not. allocated(error))
    end if
  end subroutine set

  subroutine test_settings()
    type(deck_t) :: deck
    type(error_t), allocatable :: error

    call parse_deck(whole, 'deck.nml', [character(40) :: 'system.mass=0.5', 'Integrator.METHOD = dopri5', &
                                        "scene.title='a, b'", 'output.fields=u_x,X', 'drive.time=0,2*1', &
                                        'drive.velocity=1,2,3', 'output.file=a b!.h5'], deck, error)
    call check('settings', .not. allocated(error))
    call check('a setting wins', same_bits(deck%real_of('system', 'mass'), 0.5_wp))
    call check_text('bare text', deck%text_of('integrator', 'method'), 'dopri5')
    call check_text('text in quotes', deck%text_of('scene', 'title'), 'a, b')
    call check_text('blank and sign', deck%text_of('output', 'file'), 'a b!.h5')
    call check('list of texts', all(deck%texts_of('output', 'fields') == [character(3) :: 'u_x', 'X']))
    call check('list', all(deck%reals_of('drive', 'time') <= [0.0_wp, 1.0_wp, 1.0_wp]))
    call check('is set', deck%is_set('integrator', 'method'))
    call set(['mass'], '--set mass: no ''=''')
    call set(['mass=1'], '--set mass=1: no group: write --set system.mass=VALUE')
    call set(['sytem.mass=1'], "unknown group '&sytem': the nearest is &system")
    call set([character(13) :: 'scene.t_end=1', 'system.mas=1'], "--set system.mas=1: unknown key 'mas'")
    call set([character(21) :: 'friction.law=constant', 'friction.mu_inf=', 'friction.v_f='], '')
    call set(['integrator.rtol='], '')
    call set(['system.mass='], "'mass' is missing in &system: add mass = VALUE in kg")
    call set([character(13) :: 'system.mass=', 'system.mass=2'], "'mass' set again")
    call set(['system.mass=x'], "'x' is not a real number")
    call set(['system.mass=0'], "mass = '0' is out of range")
    call set(['system.mass=1!2'], "unexpected '!2' in a value")
    call set(['system.mass=1/2'], "unexpected '/2': give only the value")
    call set(['system.mass=1 stiffness_x=2'], "unexpected 'stiffness_x=2'")
    call set(['integrator.method=radau8'], "unknown method 'radau8': the nearest is 'radau5'")
    call set([character(13) :: 'system.mass=1', 'system.mass=2'], "--set system.mass=2: 'mass' set again")
    call set(['friction.law=constant'], '')
    call set([character(21) :: 'friction.law=constant', 'friction.v_f=0.1'], "'v_f' is not used with law constant")
    call set(['integrator.step=1e-6'], "'step' is not used with method radau13")
    call set(['sweep.count=3'], '&sweep varies nothing')
    call set(['integrator.max_steps=9007199254740993'], "'9007199254740993' is not below 2^53")
    call set(['scene.title=a'//achar(10)//'b'], "control characters in 'title'")
    call set(['scene.title='//char(228)], 'a character that is not UTF-8: give plain UTF-8 text')
    call set(['scene.title='//achar(127)], 'control characters, or a character that is not UTF-8')
    call set(['integrator.method=rk4'], "--set integrator.method=rk4: method 'rk4' cannot follow")
  end subroutine test_settings

  ! --- template

  subroutine test_template()
    type(deck_t) :: deck
    type(error_t), allocatable :: error
    character(*), parameter :: models = 'full low_frequency high_frequency creep creep_asymptotic auto'
    character(:), allocatable :: text
    logical :: found(key_count)
    integer :: i, k

    found = .false.
    do k = 1, word_count(models)
      call template(word(models, k), text, error)
      call check('template', .not. allocated(error))
      call accept(text, deck)
      do i = 1, key_count
        ! A template is for one run.
        if (schema(i)%group == sweep_group) found(i) = .true.
        if (schema(i)%group == sweep_group) cycle
        associate (stands => index(text, n//'  '//trim(schema(i)%name)//' = ') > 0)
          found(i) = found(i) .or. stands
          if (deck%is_used(trim(schema(i)%group), trim(schema(i)%name))) &
            call check(word(models, k)//': in the template: '//schema(i)%name, stands)
        end associate
      end do
      call check('model '//word(models, k), deck%text_of('scene', 'model') == word(models, k))
    end do
    do i = 1, key_count
      call check('in some template: '//schema(i)%name, found(i))
    end do
  end subroutine test_template
end program test_deck
