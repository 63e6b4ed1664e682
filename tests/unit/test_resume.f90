!> A run whose state is repeatedly saved as words and loaded into a new simulation ends with the same bits in every sample, event,
!> summary value and count as the run without interruption.
program test_resume
  use, intrinsic :: iso_c_binding, only: c_loc
  use checks, only: check, finish
  use scenes, only: fig3, fast, constant_friction, along_a_line, without_map, begin, complete, identical
  use dst_archive, only: archive_t, archive_of
  use dst_errors, only: error_t
  use dst_kinds, only: wp, int64
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_writer, only: writer_t, outcome_t
  implicit none

  character(7), parameter :: methods(5) = ['radau5 ', 'radau9 ', 'radau13', 'dopri5 ', 'dop853 ']
  type(scene_t) :: scene
  integer :: i

  do i = 1, 3
    scene = fig3(4.2_wp, trim(methods(i)), 1.0e-6_wp)
    scene%interval = 0.01_wp
    call compare(trim(methods(i))//', two cycles', scene)
    call compare(trim(methods(i))//', two cycles, without the cycle map', without_map(scene))
  end do
  do i = 1, 5
    call compare(trim(methods(i))//', creep and turning back', turning_back(trim(methods(i))))
    call compare(trim(methods(i))//', dampers', damped(turning_back(trim(methods(i)))))
    call compare(trim(methods(i))//', low frequency', low_frequency(trim(methods(i))))
    call compare(trim(methods(i))//', along a line', along_a_line(fig3(2.9_wp, trim(methods(i)), 1.0e-7_wp)))
  end do
  ! The slow cycle repeats, and is leapt as a whole.
  scene = fig3(5.2_wp, 'radau9', 1.0e-6_wp)
  call compare('excursions reused', scene)
  call compare('without a rest', fast(scene))
  ! Inside repetitions, and inside laps.
  scene = fig3(5.0_wp, 'radau9', 1.0e-7_wp)
  scene%interval = 2.0e-5_wp
  call compare('inside repetitions', scene, every=1)
  scene = fig3(0.4_wp, 'dopri5', 1.0e-4_wp)
  scene%interval = 1.0e-6_wp
  call compare('inside laps, dopri5', scene, every=7)
  scene = fig3(0.4_wp, 'radau13', 1.0e-7_wp)
  scene%interval = 1.0e-6_wp
  scene%misalignment_deg = -1.0_wp
  call compare('inside laps, mirrored', scene, every=1)
  call compare('smoothed, without a rest', fast(smoothed('radau9')))
  call compare('slips in tables', irregular())
  call compare('radau9, smoothed', smoothed('radau9'))
  call compare('dop853, smoothed', smoothed('dop853'))
  scene = smoothed('rk4')
  scene%step = 2.0e-6_wp
  scene%t_end = min(scene%t_end, 0.05_wp)
  call compare('rk4, smoothed', scene)
  scene = turning_back('radau9')
  scene%model = 'high_frequency'
  scene%elongation_x = 5.0e-4_wp
  call compare('high frequency', scene)
  call compare('many samples in one rest', one_rest())
  call compare('closed form', closed_form())
  call test_misfits()
  call finish()

contains

  !> Words are given back bit for bit; a request for what is not there, or is of another size, changes nothing.
  subroutine test_misfits()
    real(wp), parameter :: values(3) = [-0.0_wp, tiny(1.0_wp)/8.0_wp, 1.0_wp/3.0_wp]
    type(archive_t) :: saved, loaded
    real(wp), target :: x(3)
    integer(int64), allocatable :: words(:)
    integer :: k

    x = values
    call saved%serialise(c_loc(x), storage_size(x), size(x))
    call check('what has been saved is not loaded', .not. saved%given_back())
    words = saved%words()
    do k = 1, 5
      x = 5.0_wp
      select case (k)
      case (1)
        call archive_of(words, loaded)
      case (2)
        call archive_of(words(:size(words) - 1), loaded)
      case (3)
        call archive_of([words, 0_int64], loaded)
      case (4)
        call archive_of(words, loaded)
      case (5)
        call archive_of(words(:0), loaded)
      end select
      call loaded%serialise(c_loc(x), storage_size(x), merge(2, 3, k == 4))
      call check('all is given back, or not', loaded%given_back() .eqv. k == 1)
      if (k == 1) call check('bit for bit', all(transfer(x, words) == transfer(values, words)))
      if (k /= 1 .and. k /= 3) call check('nothing is changed', all(identical(x, 5.0_wp)))
    end do
  end subroutine test_misfits

  !> Slow cycles of some passages that never repeat: laps and slips are tabulated, and observed.
  function irregular() result(scene)
    type(scene_t) :: scene

    scene = fig3(14.0_wp, 'radau9', 1.0e-5_wp)
    scene%stiffness_x = 2.0e4_wp
    scene%stiffness_y = 2.0e6_wp
    scene%mass = 0.4_wp
    scene%mu_0 = 0.25_wp
    scene%mu_inf = 0.18_wp
    scene%v_f = 4.0e-3_wp
    scene%normal_load = 20.0_wp
    scene%interval = 0.1_wp
  end function irregular

  function turning_back(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(0.09_wp, method, 1.0e-7_wp)
    scene%drive_time = [0.0_wp, 0.02_wp, 0.02_wp, 0.03_wp, 0.04_wp, 0.06_wp, 0.07_wp]
    scene%drive_velocity = [1.0e-3_wp, 1.0e-3_wp, 0.0_wp, 0.0_wp, 2.0e-3_wp, 2.0e-3_wp, -1.0e-3_wp]
  end function turning_back

  !> The same with dampers, of which that of the stiff spring is below the critical damping.
  pure function damped(scene) result(changed)
    type(scene_t), intent(in) :: scene
    type(scene_t) :: changed

    changed = scene
    changed%damping_x = 5.0_wp
    changed%damping_y = 300.0_wp
  end function damped

  function low_frequency(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(3.0_wp, method, 1.0e-6_wp)
    scene%model = 'low_frequency'
    scene%drive_time = [0.0_wp, 2.5_wp, 2.5_wp, 2.6_wp, 2.7_wp]
    scene%drive_velocity = [1.0e-3_wp, 1.0e-3_wp, 0.0_wp, 0.0_wp, -2.0e-3_wp]
    if (method(:2) == 'do') scene%t_end = 2.65_wp
  end function low_frequency

  function smoothed(method) result(scene)
    character(*), intent(in) :: method
    type(scene_t) :: scene

    scene = fig3(merge(0.03_wp, 3.0_wp, method(:2) /= 'ra'), method, 1.0e-6_wp)
    scene%contact = 'smoothed'
    scene%v_smooth = 1.0e-5_wp
  end function smoothed

  !> A drive so slow that the samples of one advance do not fit into the buffer.
  function one_rest() result(scene)
    type(scene_t) :: scene

    scene = fig3(0.6_wp, 'radau9', 1.0e-8_wp)
    scene%velocity_ratio = 0.0_wp
    scene%drive_velocity = 1.0e-7_wp
    scene%interval = 1.0e-4_wp
  end function one_rest

  function closed_form() result(scene)
    type(scene_t) :: scene

    scene = constant_friction(fig3(1.0_wp, 'radau9', 1.0e-8_wp))
    scene%model = 'creep'
    scene%fields = [character(24) :: 'u_x', 'X', 'theta', 'X_rate']
  end function closed_form

  !> The run without interruption, and cut as often as `proceed` permits; or at every `every`-th of these opportunities, many times
  !> with samples of a leap still pending.
  subroutine compare(name, scene, every)
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    integer, intent(in), optional :: every
    type(simulation_t) :: whole, cut
    type(writer_t) :: all_samples, writer
    type(outcome_t) :: expected, found
    type(error_t), allocatable :: error
    integer :: cuts, inside, spacing
    logical :: sound

    spacing = 1
    if (present(every)) spacing = every
    call complete(scene, whole, all_samples, sound)
    call check(name//': runs to the end', sound)
    call begin(scene, cut)
    inside = 0
    do cuts = 0, 100000
      call cut%proceed(0.0_wp, writer, error)
      if (cut%finished) exit
      if (modulo(cuts, spacing) /= 0) cycle
      if (cut%motion%leapt .and. .not. cut%has_reached(cut%motion%piece%to%time)) inside = inside + 1
      call carry_over(name, scene, cut)
    end do
    call check(name//': was cut', cuts > 2 .and. cut%finished .and. .not. allocated(error))
    if (present(every)) call check(name//': inside leaps', inside > 20)
    call check(name//': samples', all_samples%rows == writer%rows .and. all_samples%events == writer%events)
    if (all_samples%rows /= writer%rows .or. all_samples%events /= writer%events) return
    call check(name//': every sample', all(identical(all_samples%samples(:, :writer%rows), writer%samples(:, :writer%rows))))
    if (writer%events > 0) call check(name//': every event', &
      all(identical(all_samples%log(:writer%events)%time, writer%log(:writer%events)%time)) &
      .and. all(all_samples%log(:writer%events)%kind == writer%log(:writer%events)%kind))
    associate (a => whole%motion%piece%to, b => cut%motion%piece%to)
      call check(name//': the final state', all(identical([a%time, a%time_rest, a%u, a%y], [b%time, b%time_rest, b%u, b%y])))
    end associate
    call whole%outcome(error, expected)
    call cut%outcome(error, found)
    call compare_values(name, expected, found)
  end subroutine compare

  !> Into another simulation of the same scene, which then replaces it.
  subroutine carry_over(name, scene, simulation)
    character(*), intent(in) :: name
    type(scene_t), intent(in) :: scene
    type(simulation_t), intent(inout) :: simulation
    type(simulation_t) :: other
    type(archive_t) :: saved, loaded

    call simulation%serialise(saved)
    call archive_of(saved%words(), loaded)
    call begin(scene, other)
    call other%serialise(loaded)
    if (.not. loaded%given_back()) call check(name//': all given back', .false.)
    if (abs(other%elapsed - simulation%elapsed) > 0.0_wp) call check(name//': the wall time so far', .false.)
    simulation = other
  end subroutine carry_over

  subroutine compare_values(name, expected, found)
    character(*), intent(in) :: name
    type(outcome_t), intent(in) :: expected, found
    integer :: k

    call check(name//': the same summary values', size(expected%summary) == size(found%summary))
    if (size(expected%summary) /= size(found%summary)) return
    do k = 1, size(found%summary)
      call check(name//': '//trim(found%summary(k)%name), identical(expected%summary_value(k), found%summary_value(k)))
    end do
    do k = 1, size(found%statistics)
      if (found%statistics(k)%name == 'wall_time') cycle
      call check(name//': '//trim(found%statistics(k)%name), identical(expected%statistics_value(k), found%statistics_value(k)))
    end do
  end subroutine compare_values
end program test_resume
