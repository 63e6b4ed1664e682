!> How each reduced model treats each output column, compared with the full model: the one table of this.
!>
!> `auto` chooses a model for a column that is requested by name only if the model follows that column. A model that the deck names
!> provides all columns but the absent ones: u_y = 0 of a rigid spring is that model's answer. A column that is not in the table is
!> provided by all models except the asymptotics, and followed by the full model alone.
module dst_model_columns
  implicit none
  private

  public :: gives_column, holds_column, column_obstacle

  !> How a model may treat a column. Followed: as in the full model, within the error of the model. Average: without the fast
  !> oscillation, in which the full model's velocities alternate between rest and twice their mean. Held: constant by construction
  !> at a constant drive velocity. Absent: no value.
  character, parameter :: followed = 'f', average = 'a', held = 'h', absent = '-'

  character(*), parameter :: models(*) = [character(16) :: 'low_frequency', 'high_frequency', 'creep', 'creep_asymptotic']

  !> A column and its treatment in each of `models`.
  type :: row_t
    character(24) :: column = ''
    character(size(models)) :: standing = ''
  end type row_t

  type(row_t), parameter :: table(*) = [ &
    row_t('time', 'ffff'), &
    row_t('u_x', 'fhf-'), &
    row_t('u_y', 'hfa-'), &
    row_t('w_x', 'afa-'), &
    row_t('w_y', 'hfa-'), &
    row_t('X', 'faff'), &
    row_t('Y', 'aaa-'), &
    row_t('X_rate', 'afaa'), &
    row_t('Y_rate', 'afa-'), &
    row_t('spring_force_x', 'fhf-'), &
    row_t('spring_force_y', 'afa-'), &
    row_t('friction', 'afa-'), &
    row_t('theta', 'aaa-'), &
    row_t('psi', 'aaa-'), &
    row_t('sticking', 'hfa-'), &
    row_t('zeta', 'aa--'), &
    row_t('u_x_rate', 'afa-'), &
    row_t('u_y_rate', 'hfa-')]
  type(row_t), parameter :: any_other = row_t('', 'aaa-')

contains

  !> Whether `model` has a value for a column.
  elemental logical function gives_column(model, column)
    character(*), intent(in) :: model, column

    gives_column = standing(model, column) /= absent
  end function gives_column

  !> Whether `model` keeps a column constant by construction.
  elemental logical function holds_column(model, column)
    character(*), intent(in) :: model, column

    holds_column = standing(model, column) == held
  end function holds_column

  !> Why `model` cannot replace the full one for a column: 'low_frequency holds u_y constant'; '' if it can.
  pure function column_obstacle(model, column) result(text)
    character(*), intent(in) :: model, column
    character(:), allocatable :: text

    text = ''
    select case (standing(model, column))
    case (average)
      text = trim(model)//' gives '//trim(column)//' without the fast oscillation'
    case (held)
      text = trim(model)//' holds '//trim(column)//' constant'
    case (absent)
      text = trim(model)//' does not give '//trim(column)
    end select
  end function column_obstacle

  elemental character function standing(model, column)
    character(*), intent(in) :: model, column
    type(row_t) :: row
    integer :: i

    row = any_other
    do i = 1, size(table)
      if (table(i)%column == column) row = table(i)
    end do
    standing = followed
    do i = 1, size(models)
      if (models(i) == model) standing = row%standing(i:i)
    end do
  end function standing
end module dst_model_columns
