!> A scene: the content of a deck, as typed values. The deck has been checked; nothing is checked here.
module dst_scene
  use dst_kinds, only: wp
  use dst_schema, only: schema, key_count, real_kind, integer_kind
  use dst_deck, only: deck_t
  use dst_scene_numbers, only: scene_numbers_t
  implicit none
  private

  public :: scene_t, scene_from_deck, set_number

  !> Everything that one run depends on, in the units of the deck: a component for each key with one number, of its name, and these.
  !> A number that the model or the law does not have is 0.
  type, extends(scene_numbers_t) :: scene_t
    character(:), allocatable :: title
    character(:), allocatable :: model, law, contact, method
    character(:), allocatable :: cycle_map               !! 'auto' or 'off'
    character(:), allocatable :: form                    !! of Eq. (8)
    character(:), allocatable :: quantities              !! for which model 'auto' is chosen
    character(:), allocatable :: output_file             !! '' = after the deck's name
    logical :: interval_is_chosen = .false.              !! by the program, not by the deck
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
    scene%fields = [character(len(scene%fields)) :: deck%texts_of('output', 'fields')]
    scene%output_file = deck%text_of('output', 'file')
    ! Without effect for the constant law, but not 0.
    scene%v_f = 1.0_wp
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

    call scene%set(name, value)
    if (name == 'velocity') scene%drive_velocity = value
    if (name == 'mu_0' .and. (scene%law == 'constant' .or. index(scene%model, 'creep') == 1)) scene%mu_inf = value
  end subroutine set_number
end module dst_scene
