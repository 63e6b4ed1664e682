!> Friction laws: magnitude of the friction force against the slip speed.
!>
!> Adding a law: extend `friction_law_t` here and name it in `new_friction_law`; docs/howto/friction_law.md.
!> Source: Nakano & Popov (2020), Eq. (3) (weakening) and its constant limit.
module dst_friction
  use dst_kinds, only: wp
  implicit none
  private

  public :: friction_law_t, new_friction_law, exponential_form

  !> A friction law, with its coefficients.
  type, abstract :: friction_law_t
    !> The static limit F_0 = mu_0 W [N], which is also F(0).
    real(wp) :: static_limit = 0.0_wp
  contains
    !> Force F(v) [N] and slope F'(v) [N s/m] at n slip speeds v [m/s].
    procedure(evaluate), deferred :: evaluate
  end type friction_law_t

  abstract interface
    pure subroutine evaluate(self, n, speed, force, slope)
      import :: friction_law_t, wp
      class(friction_law_t), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: speed(n)
      real(wp), intent(out) :: force(n), slope(n)
    end subroutine evaluate
  end interface

  !> F = mu_0 W.
  type, extends(friction_law_t) :: constant_friction_t
  contains
    procedure :: evaluate => evaluate_constant
  end type constant_friction_t

  !> F = [mu_inf + (mu_0 - mu_inf) exp(-v/v_f)] W (Eq. 3).
  type, extends(friction_law_t) :: weakening_friction_t
    !> mu_inf W [N].
    real(wp) :: limit = 0.0_wp
    !> (mu_0 - mu_inf) W [N].
    real(wp) :: drop = 0.0_wp
    !> 1/v_f [s/m].
    real(wp) :: decay = 0.0_wp
  contains
    procedure :: evaluate => evaluate_weakening
  end type weakening_friction_t

contains

  !> The law called `name`, for a normal load [N] and its coefficients.
  subroutine new_friction_law(name, mu_0, mu_inf, v_f, normal_load, law)
    character(*), intent(in) :: name
    real(wp), intent(in) :: mu_0, mu_inf, v_f, normal_load
    class(friction_law_t), allocatable, intent(out) :: law

    select case (name)
    case ('weakening')
      law = weakening_friction_t(static_limit=mu_0*normal_load, limit=mu_inf*normal_load, &
        drop=(mu_0 - mu_inf)*normal_load, decay=1.0_wp/v_f)
    case default
      law = constant_friction_t(static_limit=mu_0*normal_load)
    end select
  end subroutine new_friction_law

  !> The law as F = limit + drop exp(-decay v), if it has this form: as numbers, many laws can be evaluated side by side.
  pure subroutine exponential_form(law, limit, drop, decay, is_exponential)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(out) :: limit, drop, decay       !! N, N, s/m
    logical, intent(out) :: is_exponential

    limit = law%static_limit
    drop = 0.0_wp
    decay = 0.0_wp
    is_exponential = .true.
    select type (law)
    type is (weakening_friction_t)
      limit = law%limit
      drop = law%drop
      decay = law%decay
    type is (constant_friction_t)
    class default
      is_exponential = .false.
    end select
  end subroutine exponential_form

  pure subroutine evaluate_constant(self, n, speed, force, slope)
    class(constant_friction_t), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: speed(n)
    real(wp), intent(out) :: force(n), slope(n)

    force = self%static_limit + 0.0_wp*speed
    slope = 0.0_wp
  end subroutine evaluate_constant

  !> Below v = 0, which only a stage beyond a stop can reach, the exponential is continued
  !> analytically for one v_f and then by its tangent, so that it cannot overflow.
  pure subroutine evaluate_weakening(self, n, speed, force, slope)
    class(weakening_friction_t), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: speed(n)
    real(wp), intent(out) :: force(n), slope(n)
    real(wp) :: x, y, part
    integer :: i

    do i = 1, n
      x = -speed(i)*self%decay
      y = min(x, 1.0_wp)
      part = self%drop*exp(y)
      force(i) = self%limit + part*(1.0_wp + (x - y))
      slope(i) = -part*self%decay
    end do
  end subroutine evaluate_weakening
end module dst_friction
