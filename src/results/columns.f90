!> Output columns: the quantities of the motion at one instant.
!>
!> Adding a column: its number, one line in `columns` and one case in `value_of`; docs/howto/output_column.md.
!> Source of the formulas: Nakano & Popov (2020), Eqs. (4)-(6) and (10); the elongation rates are the preprint's v_x and v_y.
module dst_columns
  use dst_kinds, only: wp, pi
  use dst_drive, only: drive_t
  use dst_slider, only: slider_t
  use dst_state, only: instant_t
  use dst_text, only: has_word
  use dst_writer, only: quantity_t, find_quantity
  implicit none
  private

  public :: columns, find_column, is_default, default_columns, damping_ratio_exists, row_of

  !> Numbers of the columns, in the order of the table.
  integer, parameter :: c_time = 1, c_u_x = 2, c_u_y = 3, c_w_x = 4, c_w_y = 5, c_x = 6, c_y = 7, c_x_rate = 8
  integer, parameter :: c_y_rate = 9, c_spring_force_x = 10, c_spring_force_y = 11
  integer, parameter :: c_friction = 12, c_theta = 13, c_psi = 14, c_sticking = 15, c_zeta = 16
  integer, parameter :: c_pull_force = 17, c_theta_deg = 18, c_u_x_rate = 19, c_u_y_rate = 20

  !> Columns that are written only if they are requested by name: they follow from the others.
  character(*), parameter :: columns_on_request = 'theta_deg u_x_rate u_y_rate'

  !> The table of columns: name, unit, meaning.
  type(quantity_t), parameter :: columns(*) = [ &
    quantity_t('time', 's', 'time'), &
    quantity_t('u_x', 'm', 'spring elongation along the soft axis'), &
    quantity_t('u_y', 'm', 'spring elongation along the stiff axis'), &
    quantity_t('w_x', 'm/s', 'slip velocity along the soft axis'), &
    quantity_t('w_y', 'm/s', 'slip velocity along the stiff axis'), &
    quantity_t('X', 'm', 'position along the drive'), &
    quantity_t('Y', 'm', 'position across the drive'), &
    quantity_t('X_rate', 'm/s', 'slip velocity along the drive'), &
    quantity_t('Y_rate', 'm/s', 'slip velocity across the drive'), &
    quantity_t('spring_force_x', 'N', 'spring force k_x u_x along the soft axis'), &
    quantity_t('spring_force_y', 'N', 'spring force k_y u_y along the stiff axis'), &
    quantity_t('friction', 'N', 'magnitude of the friction force'), &
    quantity_t('theta', 'rad', 'angle of the friction force to the soft axis'), &
    quantity_t('psi', 'rad', 'angle of the friction force to the drive'), &
    quantity_t('sticking', '1', '1 while the object sticks, 0 while it slips'), &
    quantity_t('zeta', '1', 'damping ratio of the soft mode, Eq. (10)'), &
    quantity_t('pull_force', 'N', 'force of springs and dampers on the object along the drive: what a load cell measures'), &
    quantity_t('theta_deg', 'deg', 'angle of the friction force to the soft axis'), &
    quantity_t('u_x_rate', 'm/s', 'elongation rate of the spring along the soft axis'), &
    quantity_t('u_y_rate', 'm/s', 'elongation rate of the spring along the stiff axis')]

contains

  !> Number of the column `name`, 0 if there is none.
  pure integer function find_column(name)
    character(*), intent(in) :: name

    find_column = find_quantity(columns, name)
  end function find_column

  !> Whether a column is one of those that 'default' means.
  elemental logical function is_default(name)
    character(*), intent(in) :: name

    is_default = .not. has_word(columns_on_request, trim(name))
  end function is_default

  !> The columns that 'default' means: all except those on request, and the damping ratio only if it exists.
  pure function default_columns(slider, drive) result(selected)
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    integer, allocatable :: selected(:)
    integer :: i

    selected = pack([(i, i=1, size(columns))], is_default(columns%name))
    if (.not. damping_ratio_exists(slider, drive)) selected = pack(selected, columns(selected)%name /= 'zeta')
  end function default_columns

  !> Eq. (10) divides by V sin(phi): it has a value if neither factor vanishes at any time.
  pure logical function damping_ratio_exists(slider, drive) result(exists)
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    real(wp) :: side
    integer :: i

    associate (segment => drive%segment, along => slider%along)
      side = sign(1.0_wp, segment(1)%velocity)
      exists = abs(along(2)) > 0.0_wp
      do i = 1, size(segment)
        exists = exists .and. side*segment(i)%velocity > 0.0_wp
        if (i < size(segment)) exists = exists .and. side*segment(i)%velocity_at(segment(i)%end) > 0.0_wp
      end do
    end associate
  end function damping_ratio_exists

  !> The values of the selected columns.
  pure subroutine row_of(slider, instant, selected, row)
    type(slider_t), intent(in) :: slider
    type(instant_t), intent(in) :: instant
    integer, intent(in) :: selected(:)
    real(wp), intent(out) :: row(:)
    integer :: i

    do i = 1, size(selected)
      row(i) = value_of(slider, instant, selected(i))
    end do
  end subroutine row_of

  pure real(wp) function value_of(slider, instant, column) result(value)
    type(slider_t), intent(in) :: slider
    type(instant_t), intent(in) :: instant
    integer, intent(in) :: column

    associate (u => instant%state%u, w => instant%velocity, e => slider%along)
      select case (column)
      case (c_time)
        value = instant%state%time
      case (c_u_x)
        value = u(1)
      case (c_u_y)
        value = u(2)
      case (c_w_x)
        value = w(1)
      case (c_w_y)
        value = w(2)
      case (c_x)
        value = instant%state%position
      case (c_y)
        value = u(1)*e(2) - u(2)*e(1)
      case (c_x_rate)
        value = w(1)*e(1) + w(2)*e(2)
      case (c_y_rate)
        value = w(2)*e(1) - w(1)*e(2)
      case (c_spring_force_x)
        value = instant%spring_force(1)
      case (c_spring_force_y)
        value = instant%spring_force(2)
      case (c_friction)
        value = instant%friction
      case (c_theta)
        value = instant%theta
      case (c_psi)
        value = instant%theta - atan2(e(2), e(1))
        if (abs(value) > pi) value = value - 2.0_wp*pi*anint(value/(2.0_wp*pi))
      case (c_sticking)
        value = merge(1.0_wp, 0.0_wp, instant%sticking)
      case (c_zeta)
        value = slider%law%kinetic_limit*abs(sin(instant%theta))**3 &
          /(2.0_wp*abs(instant%drive_velocity*e(2))*sqrt(slider%mass*slider%stiffness(1)))
      case (c_pull_force)
        value = slider%pull_force(instant%spring_force, instant%drive_velocity, w)
      case (c_theta_deg)
        value = instant%theta*(180.0_wp/pi)
      case (c_u_x_rate)
        value = instant%drive_velocity*e(1) - w(1)
      case (c_u_y_rate)
        value = instant%drive_velocity*e(2) - w(2)
      case default
        value = 0.0_wp
      end select
    end associate
  end function value_of
end module dst_columns
