!> Friction laws: magnitude of the friction force as a function of the slip speed.
!>
!> There are two limits. The static limit F_s is the largest force that friction balances at rest; the kinetic limit F_0 = F(0+) is
!> the friction force as slip begins. They are equal unless a scene has a `mu_static` above F_0/W, or the limit ages: it grows with
!> the logarithm of the time at rest (Dieterich 1972). Rest and release depend on F_s, stops, forces and slopes in slip on F.
!>
!> Adding a law: extend `friction_law_t` here and name it in `new_friction_law`; docs/howto/friction_law.md.
!> Source: Nakano & Popov (2020), Eq. (3) (weakening) and its constant limit; docs/equations.md (stribeck, table).
module dst_friction
  use dst_kinds, only: wp
  use dst_monotone_cubic, only: monotone_cubic_t, new_monotone_cubic
  implicit none
  private

  public :: friction_law_t, new_friction_law, exponential_form, falls_exponentially

  !> A friction law, with its coefficients.
  type, abstract :: friction_law_t
    !> The static limit F_s [N], up to which the object stays at rest as rest begins; F(0), unless the scene has a higher one.
    real(wp) :: static_limit = 0.0_wp
    !> By how much it grows [N] in rests that last longer by a factor of e, much longer than this time [s].
    real(wp) :: ageing = 0.0_wp, ageing_time = 1.0_wp
    !> The kinetic limit F_0 = F(0) [N].
    real(wp) :: kinetic_limit = 0.0_wp
    !> The least force F(v) at any slip speed [N], or less.
    real(wp) :: least_force = 0.0_wp
  contains
    !> Force F(v) [N] and slope F'(v) [N s/m] at n slip speeds v [m/s].
    procedure(evaluate), deferred :: evaluate
    procedure :: least_up_to
    procedure :: limit_after
    procedure :: limit_rate
    procedure :: holds_more
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

  !> F = [mu_inf + (mu_0 - mu_inf) exp(-(v/v_f)^p) + viscous v] W, p >= 1. The law 'weakening' (Eq. 3) is that of p = 1 without
  !> the last term, and 'constant' that of mu_0 alone.
  type, extends(friction_law_t) :: exponential_friction_t
    !> mu_inf W [N].
    real(wp) :: limit = 0.0_wp
    !> (mu_0 - mu_inf) W [N].
    real(wp) :: drop = 0.0_wp
    !> 1/v_f [s/m].
    real(wp) :: decay = 0.0_wp
    !> p, without unit.
    real(wp) :: exponent = 1.0_wp
    !> viscous W [N s/m].
    real(wp) :: viscosity = 0.0_wp
  contains
    procedure :: evaluate => evaluate_exponential
    procedure :: least_up_to => least_exponential
  end type exponential_friction_t

  !> F through points (v, F), piecewise cubic and monotone where they are; constant above the last point.
  type, extends(friction_law_t) :: table_friction_t
    type(monotone_cubic_t) :: curve
  contains
    procedure :: evaluate => evaluate_table
  end type table_friction_t

contains

  !> The law called `name`, for a normal load [N] and its coefficients: `exponent` and `viscous` [s/m] of the law 'stribeck', the
  !> points `speed` [m/s] and `mu` of the law 'table'.
  subroutine new_friction_law(name, mu_0, mu_inf, v_f, normal_load, law, exponent, viscous, speed, mu)
    character(*), intent(in) :: name
    real(wp), intent(in) :: mu_0, mu_inf, v_f, normal_load
    class(friction_law_t), allocatable, intent(out) :: law
    real(wp), intent(in), optional :: exponent, viscous
    real(wp), intent(in), optional :: speed(:), mu(:)
    type(exponential_friction_t) :: exponential

    select case (name)
    case ('table')
      law = table_friction_t(static_limit=mu(1)*normal_load, curve=new_monotone_cubic(speed, mu*normal_load))
    case default
      exponential = exponential_friction_t(static_limit=mu_0*normal_load, limit=mu_0*normal_load)
      if (name /= 'constant') then
        exponential%limit = mu_inf*normal_load
        exponential%drop = (mu_0 - mu_inf)*normal_load
        exponential%decay = 1.0_wp/v_f
      end if
      if (name == 'stribeck') then
        exponential%exponent = exponent
        exponential%viscosity = viscous*normal_load
      end if
      law = exponential
    end select
    law%kinetic_limit = law%static_limit
    law%least_force = normal_load*min(mu_0, mu_inf)
    if (name == 'constant') law%least_force = law%kinetic_limit
    if (name == 'table') law%least_force = normal_load*minval(mu)
  end subroutine new_friction_law

  !> A lower bound of F [N] at all slip speeds up to this one [m/s].
  pure real(wp) function least_up_to(self, speed) result(least)
    class(friction_law_t), intent(in) :: self
    real(wp), intent(in) :: speed

    associate (unused => speed)
    end associate
    least = self%least_force
  end function least_up_to

  pure real(wp) function least_exponential(self, speed) result(least)
    class(exponential_friction_t), intent(in) :: self
    real(wp), intent(in) :: speed
    real(wp) :: force(1), slope(1)

    call self%evaluate(1, [speed], force, slope)
    least = min(self%kinetic_limit, force(1) - self%viscosity*speed)
  end function least_exponential

  !> The static limit [N] after so long a rest [s]: F_s + ageing ln(1 + age/ageing_time).
  elemental real(wp) function limit_after(self, age)
    class(friction_law_t), intent(in) :: self
    real(wp), intent(in) :: age

    limit_after = self%static_limit
    if (self%ageing > 0.0_wp) limit_after = limit_after + self%ageing*log(1.0_wp + age/self%ageing_time)
  end function limit_after

  !> How fast it grows then [N/s].
  elemental real(wp) function limit_rate(self, age)
    class(friction_law_t), intent(in) :: self
    real(wp), intent(in) :: age

    limit_rate = 0.0_wp
    if (self%ageing > 0.0_wp) limit_rate = self%ageing/(self%ageing_time + age)
  end function limit_rate

  !> Whether friction holds an object at rest against more than F_0.
  elemental logical function holds_more(self)
    class(friction_law_t), intent(in) :: self

    holds_more = self%static_limit > self%kinetic_limit .or. self%ageing > 0.0_wp
  end function holds_more

  !> The law as F = limit + drop exp(-decay v), if it has this form: with these numbers, many laws can be evaluated side by side.
  pure subroutine exponential_form(law, limit, drop, decay, is_exponential)
    class(friction_law_t), intent(in) :: law
    real(wp), intent(out) :: limit, drop, decay       !! N, N, s/m
    logical, intent(out) :: is_exponential

    limit = law%kinetic_limit
    drop = 0.0_wp
    decay = 0.0_wp
    is_exponential = .false.
    select type (law)
    type is (exponential_friction_t)
      limit = law%limit
      drop = law%drop
      decay = law%decay
      is_exponential = .not. abs(law%exponent - 1.0_wp) + law%viscosity > 0.0_wp
    end select
  end subroutine exponential_form

  !> Whether a law has the exponential form, constant friction included.
  pure logical function falls_exponentially(law)
    class(friction_law_t), intent(in) :: law
    real(wp) :: limit, drop, decay

    call exponential_form(law, limit, drop, decay, falls_exponentially)
  end function falls_exponentially

  !> Below v = 0, which only a stage beyond a stop can reach, the power is continued as an odd function for one v_f, and the force
  !> then by its tangent, so that it cannot overflow.
  pure subroutine evaluate_exponential(self, n, speed, force, slope)
    class(exponential_friction_t), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: speed(n)
    real(wp), intent(out) :: force(n), slope(n)
    !> From this v/v_f on, the exponential is 0 for each p >= 1, and up to here its power does not overflow.
    real(wp), parameter :: far = -2.0_wp*real(minexponent(1.0_wp), wp)
    real(wp) :: x, y, power, part
    integer :: i

    do i = 1, n
      x = -speed(i)*self%decay
      y = max(min(x, 1.0_wp), -far)
      ! |v/v_f|^(p - 1): finite at v = 0, where |v/v_f|^p/v is not.
      power = 1.0_wp
      if (self%exponent > 1.0_wp) power = abs(y)**(self%exponent - 1.0_wp)
      part = self%drop*exp(y*power)
      force(i) = self%limit + part*(1.0_wp + self%exponent*(x - min(x, 1.0_wp))) + self%viscosity*speed(i)
      slope(i) = self%viscosity - part*self%decay*(self%exponent*power)
    end do
  end subroutine evaluate_exponential

  pure subroutine evaluate_table(self, n, speed, force, slope)
    class(table_friction_t), intent(in) :: self
    integer, intent(in) :: n
    real(wp), intent(in) :: speed(n)
    real(wp), intent(out) :: force(n), slope(n)

    call self%curve%evaluate(speed, force, slope)
  end subroutine evaluate_table
end module dst_friction
