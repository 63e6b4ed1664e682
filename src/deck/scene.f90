!> A scene: the content of a deck, as typed values. The deck has been checked; nothing is checked here.
module dst_scene
  use dst_kinds, only: wp, int64
  use dst_schema, only: schema, key_count, longest_text, real_kind, integer_kind
  use dst_deck, only: deck_t
  implicit none
  private

  public :: scene_t, scene_from_deck, set_number

  !> Everything that one run depends on, in the units of the deck.
  type :: scene_t
    character(:), allocatable :: title
    character(:), allocatable :: model, law, contact, method
    character(:), allocatable :: cycle_map               !! 'auto' or 'off'
    character(:), allocatable :: form                    !! of Eq. (8)
    character(:), allocatable :: quantities              !! for which model 'auto' is chosen, with this accuracy:
    real(wp) :: accuracy = 0.0_wp
    character(:), allocatable :: output_file             !! '' = after the deck's name
    real(wp) :: t_end = 0.0_wp                           !! s
    real(wp) :: settle = 0.0_wp                          !! permitted difference of two cycles at the end of the run; 0 = none
    real(wp) :: mass = 0.0_wp                            !! kg; 0 if the model has none
    real(wp) :: stiffness_x = 0.0_wp                     !! N/m
    real(wp) :: stiffness_y = 0.0_wp                     !! N/m; 0 if the model has none
    real(wp) :: damping_x = 0.0_wp                       !! N s/m
    real(wp) :: damping_y = 0.0_wp                       !! N s/m
    real(wp) :: misalignment_deg = 0.0_wp                !! deg
    real(wp) :: mu_0 = 0.0_wp                            !! friction coefficient at rest
    real(wp) :: mu_inf = 0.0_wp                          !! at high slip velocity; mu_0 if there is none
    real(wp) :: v_f = 1.0_wp                             !! m/s; without effect for the constant law
    real(wp) :: exponent = 1.0_wp                        !! of the law stribeck
    real(wp) :: viscous = 0.0_wp                         !! s/m, of the law stribeck
    real(wp) :: mu_static = 0.0_wp                       !! up to which rest lasts; 0 = the value of the law at v = 0
    real(wp) :: ageing = 0.0_wp, ageing_time = 1.0_wp    !! growth of the static coefficient with rest; s
    real(wp) :: normal_load = 0.0_wp                     !! N
    real(wp) :: v_smooth = 0.0_wp                        !! m/s
    real(wp) :: velocity_ratio = 0.0_wp                  !! X'(0)/V
    real(wp) :: elongation_x = 0.0_wp                    !! m
    real(wp) :: elongation_y = 0.0_wp                    !! m
    real(wp) :: rtol = 0.0_wp
    real(wp) :: step = 0.0_wp                            !! s
    real(wp) :: step_max = 0.0_wp                        !! s, 0 = no limit
    integer(int64) :: max_steps = 0_int64                !! 0 = no limit
    real(wp) :: interval = 0.0_wp                        !! s, 0 = every accepted step, `automatic` = not yet chosen
    logical :: interval_is_chosen = .false.              !! by the program, not by the deck
    real(wp) :: checkpoint_interval = 0.0_wp             !! s of wall time, 0 = none
    real(wp) :: wall_limit = 0.0_wp                      !! s of wall time, 0 = none
    real(wp), allocatable :: drive_time(:)               !! s, corners of the drive; one entry at 0 = constant
    real(wp), allocatable :: drive_velocity(:)           !! m/s
    real(wp), allocatable :: table_speed(:)              !! m/s, points of the law table
    real(wp), allocatable :: table_mu(:)
    character(24), allocatable :: fields(:)              !! columns of the time series, or 'default'
  contains
    procedure :: is_closed_form
    procedure :: method_name
  end type scene_t

contains

  !> Whether the model has a closed form at any time, without a method.
  pure logical function is_closed_form(self)
    class(scene_t), intent(in) :: self

    is_closed_form = self%model == 'creep' .or. self%model == 'creep_asymptotic'
  end function is_closed_form

  !> The method, for the result file.
  pure function method_name(self) result(name)
    class(scene_t), intent(in) :: self
    character(:), allocatable :: name

    name = self%method
    if (self%is_closed_form()) name = 'closed form'
  end function method_name

  !> The scene that a checked deck describes.
  subroutine scene_from_deck(deck, scene)
    type(deck_t), intent(in) :: deck
    type(scene_t), intent(out) :: scene
    character(longest_text), allocatable :: fields(:)
    integer :: i

    scene%title = deck%text_of('scene', 'title')
    scene%model = deck%text_of('scene', 'model')
    scene%form = deck%text_of('scene', 'form')
    scene%quantities = deck%text_of('scene', 'quantities')
    scene%law = deck%text_of('friction', 'law')
    scene%contact = deck%text_of('friction', 'contact')
    scene%drive_time = deck%reals_of('drive', 'time')
    scene%drive_velocity = deck%reals_of('drive', 'velocity')
    scene%method = deck%text_of('integrator', 'method')
    scene%table_speed = deck%reals_of('friction', 'table_speed')
    scene%table_mu = deck%reals_of('friction', 'table_mu')
    scene%cycle_map = deck%text_of('integrator', 'cycle_map')
    allocate (fields, source=deck%texts_of('output', 'fields'))
    allocate (scene%fields(size(fields)))
    scene%fields = fields(:)(:len(scene%fields))
    scene%output_file = deck%text_of('output', 'file')
    ! Every key with one number. If a physical key is not used, the scene keeps the value that switches it off.
    do i = 1, key_count
      associate (key => schema(i))
        if (key%required .and. .not. deck%is_used(trim(key%group), trim(key%name))) cycle
        if (key%kind == real_kind .or. key%kind == integer_kind) &
          call set_number(scene, trim(key%name), deck%real_of(trim(key%group), trim(key%name)))
      end associate
    end do
  end subroutine scene_from_deck

  !> Set the component of the key `name`, in its unit. Safe in threads: no text of deferred length is used.
  subroutine set_number(scene, name, value)
    type(scene_t), intent(inout) :: scene
    character(*), intent(in) :: name
    real(wp), intent(in) :: value

    select case (name)
    case ('accuracy')
      scene%accuracy = value
    case ('t_end')
      scene%t_end = value
    case ('settle')
      scene%settle = value
    case ('mass')
      scene%mass = value
    case ('stiffness_x')
      scene%stiffness_x = value
    case ('stiffness_y')
      scene%stiffness_y = value
    case ('damping_x')
      scene%damping_x = value
    case ('damping_y')
      scene%damping_y = value
    case ('misalignment_deg')
      scene%misalignment_deg = value
    case ('mu_0')
      scene%mu_0 = value
      if (scene%law == 'constant' .or. index(scene%model, 'creep') == 1) scene%mu_inf = value
    case ('mu_inf')
      scene%mu_inf = value
    case ('v_f')
      scene%v_f = value
    case ('exponent')
      scene%exponent = value
    case ('viscous')
      scene%viscous = value
    case ('mu_static')
      scene%mu_static = value
    case ('ageing')
      scene%ageing = value
    case ('ageing_time')
      scene%ageing_time = value
    case ('normal_load')
      scene%normal_load = value
    case ('v_smooth')
      scene%v_smooth = value
    case ('velocity')
      scene%drive_velocity = value
    case ('velocity_ratio')
      scene%velocity_ratio = value
    case ('elongation_x')
      scene%elongation_x = value
    case ('elongation_y')
      scene%elongation_y = value
    case ('rtol')
      scene%rtol = value
    case ('step')
      scene%step = value
    case ('step_max')
      scene%step_max = value
    case ('max_steps')
      scene%max_steps = nint(value, int64)
    case ('interval')
      scene%interval = value
    case ('checkpoint_interval')
      scene%checkpoint_interval = value
    case ('wall_limit')
      scene%wall_limit = value
    end select
  end subroutine set_number
end module dst_scene
