!> What `trade` tries on a scene: models x methods x tolerances, smoothing widths and fixed steps, the most telling first.
module dst_trade_plan
  use dst_kinds, only: wp, pi
  use dst_scene, only: scene_t
  use dst_simulation, only: slider_from_scene
  use dst_slider, only: slider_t
  use dst_text, only: word, word_count
  implicit none
  private

  public :: candidate_t, candidates_of, apply_candidate, same_family

  !> A way to compute the scene. What it does not use is 0 or ''.
  type :: candidate_t
    character(20) :: model = '', method = '', contact = '', form = ''
    real(wp) :: rtol = 0.0_wp
    real(wp) :: step = 0.0_wp        !! s
    real(wp) :: v_smooth = 0.0_wp    !! m/s
    integer :: rank = 0              !! lower ones are tried first
    character(120) :: obstacle = ''  !! why it cannot be tried
  end type candidate_t

  character(*), parameter :: adaptive_methods = 'radau9 radau13 radau5 dopri5 dop853'
  !> Relative tolerances 10^-n and when they are tried: every second first.
  integer, parameter :: exponents(9) = [6, 4, 8, 3, 10, 5, 7, 9, 11], ranks(9) = [1, 2, 3, 4, 5, 6, 6, 7, 7]
  !> Smoothing velocities over V sin(phi).
  real(wp), parameter :: smoothing_shares(4) = [0.1_wp, 1.0_wp, 1.0e-2_wp, 1.0e-3_wp]
  integer, parameter :: most = 200

  type :: list_t
    type(candidate_t), allocatable :: candidates(:)   !! has room for the most there may be
    integer :: count = 0
  end type list_t

contains

  !> Candidates in the order in which they are to be tried. The scene's model is the one of the reference.
  subroutine candidates_of(scene, candidates)
    type(scene_t), intent(in) :: scene
    type(candidate_t), allocatable, intent(out) :: candidates(:)
    type(list_t), allocatable :: list      ! on the heap: it is larger than a small stack
    integer :: rank, i, n

    allocate (list)
    call add_tolerances(list, scene%model, scene%contact, scene%v_smooth)
    if (scene%model == 'full') then
      call add_reduced_models(list, scene)
      call add_smoothed(list, scene)
      call add_moreau_jean(list, scene)
    end if
    if (scene%model == 'low_frequency') call add_fixed_steps(list, scene, 'low_frequency')
    allocate (candidates(list%count))
    n = 0
    do rank = 0, maxval(list%candidates(:list%count)%rank)
      do i = 1, list%count
        if (list%candidates(i)%rank /= rank) cycle
        n = n + 1
        candidates(n) = list%candidates(i)
      end do
    end do
  end subroutine candidates_of

  pure subroutine add(list, candidate)
    type(list_t), intent(inout) :: list
    type(candidate_t), intent(in) :: candidate

    if (.not. allocated(list%candidates)) allocate (list%candidates(most))
    if (list%count == most) return
    list%count = list%count + 1
    list%candidates(list%count) = candidate
  end subroutine add

  !> All adaptive methods at all tolerances on one model.
  subroutine add_tolerances(list, model, contact, v_smooth)
    type(list_t), intent(inout) :: list
    character(*), intent(in) :: model, contact
    real(wp), intent(in) :: v_smooth
    integer :: i, m

    do i = 1, size(exponents)
      do m = 1, word_count(adaptive_methods)
        call add(list, candidate_t(model=model, method=word(adaptive_methods, m), contact=contact, &
          rtol=10.0_wp**(-exponents(i)), v_smooth=v_smooth, rank=ranks(i)))
      end do
    end do
  end subroutine add_tolerances

  !> Models that leave something out.
  subroutine add_reduced_models(list, scene)
    type(list_t), intent(inout) :: list
    type(scene_t), intent(in) :: scene
    character(*), parameter :: forms = 'first_power third_order printed'
    integer :: i

    call add(list, candidate_t(model='creep', rank=1))
    do i = 1, word_count(forms)
      call add(list, candidate_t(model='creep_asymptotic', form=word(forms, i), rank=1))
    end do
    call add_tolerances(list, 'low_frequency', '', 0.0_wp)
    call add_fixed_steps(list, scene, 'low_frequency')
    call add(list, candidate_t(model='high_frequency', rank=1, &
      obstacle='it holds the load along the soft axis, which no whole scene does'))
  end subroutine add_reduced_models

  !> rk4 on a model of slow motion.
  subroutine add_fixed_steps(list, scene, model)
    type(list_t), intent(inout) :: list
    type(scene_t), intent(in) :: scene
    character(*), intent(in) :: model
    integer :: i

    do i = 0, 3
      call add(list, candidate_t(model=model, method='rk4', &
        step=rounded(min(slow_period(scene)/16.0_wp, scene%t_end/16.0_wp)/4.0_wp**i), rank=2 + i))
    end do
  end subroutine add_fixed_steps

  !> The smoothed contact, for smoothing velocities below V sin(phi).
  subroutine add_smoothed(list, scene)
    type(list_t), intent(inout) :: list
    type(scene_t), intent(in) :: scene
    real(wp) :: v_smooth, speed
    type(slider_t) :: slider
    integer :: i

    call slider_from_scene(scene, slider)
    speed = maxval(abs(scene%drive_velocity))*max(abs(slider%along(2)), 1.0e-3_wp)
    if (scene%contact /= 'exact') then
      call try('rk4', v_smooth=scene%v_smooth, step_share=2.0_wp, rank=2)
      call try('rk4', v_smooth=scene%v_smooth, step_share=0.5_wp, rank=3)
      return
    end if
    do i = 1, size(smoothing_shares)
      v_smooth = rounded(smoothing_shares(i)*speed)
      call try('radau9', v_smooth, rank=i, rtol=1.0e-6_wp)
      call try('radau9', v_smooth, rank=i + 1, rtol=1.0e-4_wp)
      call try('dopri5', v_smooth, rank=i, rtol=1.0e-4_wp)
      call try('dopri5', v_smooth, rank=i + 3, rtol=1.0e-6_wp)
      call try('rk4', v_smooth, rank=i + 1, step_share=2.0_wp)
      call try('rk4', v_smooth, rank=i + 2, step_share=0.5_wp)
    end do

  contains

    !> The friction direction relaxes at the rate F_0/(m v_smooth); rk4 is stable up to 2.8 of its inverse.
    subroutine try(method, v_smooth, rank, rtol, step_share)
      character(*), intent(in) :: method
      real(wp), intent(in) :: v_smooth
      integer, intent(in) :: rank
      real(wp), intent(in), optional :: rtol, step_share
      type(candidate_t) :: candidate

      if (.not. v_smooth > 0.0_wp) return
      candidate%model = 'full'
      candidate%method = method
      candidate%contact = 'smoothed'
      candidate%v_smooth = v_smooth
      candidate%rank = rank
      if (present(rtol)) candidate%rtol = rtol
      if (present(step_share)) then
        if (.not. slider%law%onset > 0.0_wp) return
        candidate%step = rounded(step_share*slider%mass*v_smooth/slider%law%onset)
      end if
      call add(list, candidate)
    end subroutine try
  end subroutine add_smoothed

  !> From a part of the slow period down to a thousandth of the fast one.
  subroutine add_moreau_jean(list, scene)
    type(list_t), intent(inout) :: list
    type(scene_t), intent(in) :: scene
    real(wp) :: step
    integer :: i

    if (scene%contact /= 'exact') then
      call add(list, candidate_t(model='full', method='moreau_jean', contact='exact', rank=1, &
        obstacle='it knows only the exact contact, and the scene has the smoothed one'))
      return
    end if
    step = min(slow_period(scene)/16.0_wp, scene%t_end/16.0_wp)
    i = 0
    do while (step > 1.0e-3_wp*fast_period(scene) .and. i < 12)
      call add(list, candidate_t(model='full', method='moreau_jean', contact='exact', step=rounded(step), rank=1 + (i + 1)/2))
      step = 0.25_wp*step
      i = i + 1
    end do
  end subroutine add_moreau_jean

  !> Periods of the free oscillations [s].
  pure real(wp) function slow_period(scene)
    type(scene_t), intent(in) :: scene

    slow_period = 2.0_wp*pi*sqrt(scene%mass/scene%stiffness_x)
  end function slow_period

  pure real(wp) function fast_period(scene)
    type(scene_t), intent(in) :: scene

    fast_period = 2.0_wp*pi*sqrt(scene%mass/max(scene%stiffness_x, scene%stiffness_y))
  end function fast_period

  !> Two digits are enough for what a user is to type.
  real(wp) function rounded(value)
    real(wp), intent(in) :: value
    character(16) :: text

    write (text, '(es16.1e3)') value
    read (text, *) rounded
  end function rounded

  !> The scene as the candidate computes it. What it does not use is as in a deck that does not set it.
  subroutine apply_candidate(candidate, scene)
    type(candidate_t), intent(in) :: candidate
    type(scene_t), intent(inout) :: scene
    real(wp), parameter :: unused_rtol = 1.0e-8_wp

    scene%model = trim(candidate%model)
    if (candidate%method /= '') scene%method = trim(candidate%method)
    if (candidate%form /= '') scene%form = trim(candidate%form)
    scene%contact = 'exact'
    if (candidate%contact /= '') scene%contact = trim(candidate%contact)
    scene%rtol = candidate%rtol
    scene%step = candidate%step
    scene%v_smooth = candidate%v_smooth
    if (candidate%rtol > 0.0_wp) return
    scene%rtol = unused_rtol
    scene%step_max = 0.0_wp
  end subroutine apply_candidate

  !> Whether two candidates differ in tolerance or step only.
  pure logical function same_family(a, b)
    type(candidate_t), intent(in) :: a, b

    same_family = a%model == b%model .and. a%method == b%method .and. a%contact == b%contact .and. a%form == b%form &
      .and. .not. abs(a%v_smooth - b%v_smooth) > 0.0_wp
  end function same_family
end module dst_trade_plan
