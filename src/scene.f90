!> A scene: what a deck asks for, typed. The deck has been checked; nothing is checked here.
module dst_scene
  use dst_kinds, only: wp, int64
  use dst_schema, only: longest_text
  use dst_deck, only: deck_t
  implicit none
  private

  public :: scene_t, scene_from_deck

  type :: scene_t
    character(:), allocatable :: title
    character(:), allocatable :: model, law, contact, method
    character(:), allocatable :: form                    !! of Eq. (8)
    character(:), allocatable :: quantities              !! for which model 'auto' is settled, with this accuracy:
    real(wp) :: accuracy = 0.0_wp
    character(:), allocatable :: output_file             !! '' = after the deck's name
    real(wp) :: t_end = 0.0_wp                           !! s
    real(wp) :: mass = 0.0_wp                            !! kg; 0 where the model has none
    real(wp) :: stiffness_x = 0.0_wp                     !! N/m
    real(wp) :: stiffness_y = 0.0_wp                     !! N/m; 0 where the model has none
    real(wp) :: misalignment_deg = 0.0_wp                !! deg
    real(wp) :: mu_0 = 0.0_wp                            !! friction coefficient at rest
    real(wp) :: mu_inf = 0.0_wp                          !! at high slip velocity; mu_0 for the constant law
    real(wp) :: v_f = 1.0_wp                             !! m/s; without effect for the constant law
    real(wp) :: normal_load = 0.0_wp                     !! N
    real(wp) :: v_smooth = 0.0_wp                        !! m/s
    real(wp) :: velocity_ratio = 0.0_wp                  !! X'(0)/V
    real(wp) :: elongation_x = 0.0_wp                    !! m
    real(wp) :: elongation_y = 0.0_wp                    !! m
    real(wp) :: rtol = 0.0_wp
    real(wp) :: step = 0.0_wp                            !! s
    real(wp) :: v_cut = 0.0_wp                           !! m/s
    real(wp) :: step_max = 0.0_wp                        !! s, 0 = no limit
    integer(int64) :: max_steps = 0_int64                !! 0 = no limit
    real(wp) :: interval = 0.0_wp                        !! s, 0 = every accepted step
    real(wp) :: checkpoint_interval = 0.0_wp             !! s of wall time, 0 = none
    real(wp) :: wall_limit = 0.0_wp                      !! s of wall time, 0 = none
    real(wp) :: flush_seconds = 0.0_wp                   !! s of wall time
    real(wp), allocatable :: drive_time(:)               !! s, corners of the drive; one entry at 0 = constant
    real(wp), allocatable :: drive_velocity(:)           !! m/s
    character(24), allocatable :: fields(:)              !! columns of the time series, or 'default'
  end type scene_t

contains

  subroutine scene_from_deck(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(out) :: scene

    scene%title = deck%text_of('scene', 'title')
    scene%model = deck%text_of('scene', 'model')
    scene%form = deck%text_of('scene', 'form')
    scene%quantities = deck%text_of('scene', 'quantities')
    scene%accuracy = deck%real_of('scene', 'accuracy')
    scene%t_end = deck%real_of('scene', 't_end')
    call take_system(deck, scene)
    call take_friction(deck, scene)
    scene%drive_time = deck%reals_of('drive', 'time')
    scene%drive_velocity = deck%reals_of('drive', 'velocity')
    scene%velocity_ratio = deck%real_of('initial', 'velocity_ratio')
    scene%elongation_x = deck%real_of('initial', 'elongation_x')
    scene%elongation_y = deck%real_of('initial', 'elongation_y')
    call take_integrator(deck, scene)
    call take_output(deck, scene)
  end subroutine scene_from_deck

  subroutine take_system(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(inout) :: scene

    if (deck%is_used('system', 'mass')) scene%mass = deck%real_of('system', 'mass')
    scene%stiffness_x = deck%real_of('system', 'stiffness_x')
    if (deck%is_used('system', 'stiffness_y')) scene%stiffness_y = deck%real_of('system', 'stiffness_y')
    scene%misalignment_deg = deck%real_of('system', 'misalignment_deg')
  end subroutine take_system

  subroutine take_friction(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(inout) :: scene

    scene%law = deck%text_of('friction', 'law')
    scene%contact = deck%text_of('friction', 'contact')
    scene%mu_0 = deck%real_of('friction', 'mu_0')
    scene%mu_inf = scene%mu_0
    scene%v_f = 1.0_wp
    if (deck%is_used('friction', 'mu_inf')) scene%mu_inf = deck%real_of('friction', 'mu_inf')
    if (deck%is_used('friction', 'v_f')) scene%v_f = deck%real_of('friction', 'v_f')
    scene%normal_load = deck%real_of('friction', 'normal_load')
    scene%v_smooth = deck%real_of('friction', 'v_smooth')
  end subroutine take_friction

  subroutine take_integrator(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(inout) :: scene

    scene%method = deck%text_of('integrator', 'method')
    scene%rtol = deck%real_of('integrator', 'rtol')
    scene%step = deck%real_of('integrator', 'step')
    scene%v_cut = deck%real_of('integrator', 'v_cut')
    scene%step_max = deck%real_of('integrator', 'step_max')
    scene%max_steps = deck%integer_of('integrator', 'max_steps')
  end subroutine take_integrator

  subroutine take_output(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(inout) :: scene
    character(longest_text), allocatable :: fields(:)

    allocate (fields, source=deck%texts_of('output', 'fields'))
    allocate (scene%fields(size(fields)))
    scene%fields = fields(:)(:len(scene%fields))
    scene%output_file = deck%text_of('output', 'file')
    scene%interval = deck%real_of('output', 'interval')
    scene%checkpoint_interval = deck%real_of('output', 'checkpoint_interval')
    scene%wall_limit = deck%real_of('output', 'wall_limit')
    scene%flush_seconds = deck%real_of('output', 'flush_seconds')
  end subroutine take_output
end module dst_scene
