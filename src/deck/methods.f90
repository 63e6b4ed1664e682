!> The one list of methods, with their kind, order and stages.
!>
!> The following use it: the choices of `integrator.method`, the conditions of the keys that only some methods use, the assembly of
!> a run, and the candidates of Python's `trade`.
module dst_methods
  implicit none
  private

  public :: method_t, methods, method_named
  public :: method_names, adaptive_methods, fixed_step_methods

  !> Width of a name in the lists of words below, which are padded.
  integer, parameter :: width = 12

  !> A method.
  type :: method_t
    character(width) :: name
    character(10) :: kind    !! implicit, explicit, rosenbrock (for the cases of a sweep) or fixed_step (explicit)
    integer :: order
    integer :: stages        !! of a step, without the slope at its end
  end type method_t

  !> In the order in which they are offered.
  type(method_t), parameter :: methods(*) = [ &
    method_t('radau5', 'implicit', 5, 3), &
    method_t('radau9', 'implicit', 9, 5), &
    method_t('radau13', 'implicit', 13, 7), &
    method_t('dopri5', 'explicit', 5, 6), &
    method_t('dop853', 'explicit', 8, 12), &
    method_t('rodas4p', 'rosenbrock', 4, 6), &
    method_t('rk4', 'fixed_step', 4, 4)]

  ! In steps: flang 19 does not treat a component of a constant array as a constant, and gfortran 12 does not accept an expression
  ! as the source of `transfer`.
  integer :: i
  character(width), parameter :: names(*) = [(methods(i)%name, i=1, size(methods))]
  character(10), parameter :: kinds(*) = [(methods(i)%kind, i=1, size(methods))]
  logical, parameter :: has_fixed_step(*) = kinds == 'fixed_step'
  character(width), parameter :: adaptive(*) = pack(names, .not. has_fixed_step)
  character(width), parameter :: fixed_step(*) = pack(names, has_fixed_step)

  !> Their names, blank-separated: of all, of those that choose their step, and of the others.
  character(width*size(names)), parameter :: method_names = transfer(names, repeat(' ', width*size(names)))
  character(width*size(adaptive)), parameter :: adaptive_methods = transfer(adaptive, repeat(' ', width*size(adaptive)))
  character(width*size(fixed_step)), parameter :: fixed_step_methods = transfer(fixed_step, repeat(' ', width*size(fixed_step)))

contains

  !> The method of this name, which must be in the list.
  pure type(method_t) function method_named(name)
    character(*), intent(in) :: name

    method_named = methods(findloc(methods%name, name, dim=1))
  end function method_named
end module dst_methods
