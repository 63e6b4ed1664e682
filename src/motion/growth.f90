!> How a small difference grows along a motion that slips without a rest.
!>
!> Its derivative with respect to the beginning is carried along (dst_tangent). What it has along the flow is a shift of the time,
!> which neither grows nor shrinks, and is taken out; what is left is measured and made as large as before, piece by piece. The
!> lengths by which its components are measured do not matter in the long run. In the plane an area grows by the integral of the
!> trace (Liouville), and so does the difference: friction at slow speeds shrinks it by more than any step can show.
module dst_growth
  use dst_dense_output, only: column_u, column_y
  use dst_kinds, only: wp
  use dst_piece, only: piece_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms
  use dst_tangent, only: tangent_t
  implicit none
  private

  public :: growth_t

  !> A difference that is followed. Plain data.
  type :: growth_t
    logical :: is_followed = .false.
    !> The logarithm of its growth since that was last asked for.
    real(wp), private :: logarithm = 0.0_wp
    type(tangent_t), private :: tangent = tangent_t()
  contains
    procedure :: begin
    procedure :: follow
    procedure :: grown
  end type growth_t

contains

  !> Begin with some difference, which turns with the axes. `is_polar`: the first unknown of the system is a slip speed, which ends at 0.
  pure subroutine begin(self, system, slider, velocity, is_polar)
    class(growth_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity            !! V, m/s
    logical, intent(in) :: is_polar

    self%is_followed = .true.
    self%logarithm = 0.0_wp
    self%tangent = tangent_t(rests=.false., is_polar=is_polar)
    associate (first => system%axis, last => system%axis + system%components - 1)
      self%tangent%u(first:last) = velocity*sqrt(slider%mass/slider%stiffness(first:last))*sign(1.0_wp, slider%along(first:last))
    end associate
  end subroutine begin

  !> Continue to the end of a piece in slip, under a steady drive.
  subroutine follow(self, piece, system, slider)
    class(growth_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(stage_terms_t) :: terms
    type(tangent_t) :: flow, measured
    real(wp) :: rate(piece%path%grid%degree + 1), coefficient(0:2), weakening, size_of, along
    integer :: i

    associate (path => piece%path, s => piece%path%grid%degree, first => system%axis, last => system%axis + system%components - 1)
      if (last - first + 1 + system%unknowns == 2) then
        do i = 1, s
          call system%decay_polynomial(path%nodal(i, column_y:column_y), piece%drive%velocity, coefficient, weakening)
          self%logarithm = self%logarithm - path%step*path%grid%integral(s, i)*coefficient(1)/coefficient(2)
        end do
        return
      end if
      terms = new_terms(s, system%components, system%unknowns)
      call self%tangent%follow(piece, system, slider, terms, self%is_followed)
      if (.not. self%is_followed) return
      rate = path%grid%derivative(s, 0:s)/path%step
      do i = first, last
        flow%u(i) = dot_product(rate, path%nodal(0:s, column_u + i - 1)) + piece%drive%velocity*piece%drive_coupling(i)
      end do
      do i = 1, system%unknowns
        flow%y(i) = dot_product(rate, path%nodal(0:s, column_y + i - 1))
      end do
      measured = scaled(flow)
      size_of = product_of(measured, measured)
      self%is_followed = size_of > 0.0_wp
      if (.not. self%is_followed) return
      along = product_of(measured, scaled(self%tangent))/size_of
      self%tangent%u(first:last) = self%tangent%u(first:last) - along*flow%u(first:last)
      self%tangent%y = self%tangent%y - along*flow%y
      measured = scaled(self%tangent)
      size_of = sqrt(product_of(measured, measured))
      self%is_followed = size_of > tiny(size_of)
      if (.not. self%is_followed) return
      self%logarithm = self%logarithm + log(size_of)
      self%tangent%u = self%tangent%u/size_of
      self%tangent%y = self%tangent%y/size_of
    end associate

  contains

    !> In speeds V, and lengths V sqrt(m/k); a direction in rad.
    pure type(tangent_t) function scaled(difference) result(numbers)
      type(tangent_t), intent(in) :: difference

      associate (first => system%axis, last => system%axis + system%components - 1)
        numbers%u(first:last) = difference%u(first:last)*sqrt(slider%stiffness(first:last)/slider%mass)/piece%drive%velocity
      end associate
      numbers%y = difference%y/piece%drive%velocity
      if (self%tangent%is_polar) numbers%y(2) = difference%y(2)
    end function scaled

    pure real(wp) function product_of(one, other)
      type(tangent_t), intent(in) :: one, other

      product_of = sum(one%u*other%u) + sum(one%y*other%y)
    end function product_of
  end subroutine follow

  !> The logarithm of the growth since this was asked last.
  real(wp) function grown(self)
    class(growth_t), intent(inout) :: self

    grown = self%logarithm
    self%logarithm = 0.0_wp
  end function grown
end module dst_growth
