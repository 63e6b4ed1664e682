!> How a small difference grows along a motion that slips without a rest.
!>
!> Its derivative with respect to the beginning is carried along (dst_tangent). What it has along the flow is a shift of the time,
!> which neither grows nor shrinks, and is taken out; what is left is measured and made as large as before, piece by piece. The
!> lengths by which its components are measured do not matter in the long run. In the plane an area grows by the integral of the
!> trace (Liouville), and so does the difference: friction at slow speeds shrinks it by more than any step can show.
module dst_growth
  use dst_dense_output, only: column_y
  use dst_eigenvalues, only: find_eigenvalues
  use dst_kinds, only: wp
  use dst_piece, only: piece_t
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t, max_components
  use dst_state, only: state_t
  use dst_tangent, only: tangent_t, directions_t, take_out_flow, n_changes
  implicit none
  private

  public :: growth_t, cycle_growth

  !> Of a smaller growth roundoff is too large a part.
  real(wp), parameter :: least_growth = sqrt(epsilon(1.0_wp))

  !> A difference that is followed. Plain data.
  type :: growth_t
    logical :: is_followed = .false.
    !> In the plane the trace tells all.
    logical, private :: is_planar = .false.
    !> The logarithm of its growth since that was last asked for.
    real(wp), private :: logarithm = 0.0_wp
    type(tangent_t), private :: tangent(1) = tangent_t()
  contains
    procedure :: begin
    procedure :: follow
    procedure :: tell
  end type growth_t

contains

  !> Begin with some difference, which turns with the axes. `is_polar`: the first unknown of the system is a slip speed, which ends
  !> at 0.
  pure subroutine begin(self, system, slider, velocity, is_polar)
    class(growth_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity            !! V, m/s
    logical, intent(in) :: is_polar

    self%is_followed = .true.
    self%is_planar = system%components + system%unknowns == 2
    self%logarithm = 0.0_wp
    self%tangent = tangent_t(rests=.false., is_polar=is_polar)
    associate (first => system%axis, last => system%axis + system%components - 1)
      self%tangent(1)%u(first:last) = velocity*sqrt(slider%mass/slider%stiffness(first:last)) &
        *sign(1.0_wp, slider%along(first:last))
    end associate
  end subroutine begin

  !> Continue to the end of a piece in slip, under a steady drive.
  subroutine follow(self, piece, system, slider)
    class(growth_t), intent(inout) :: self
    type(piece_t), intent(in) :: piece
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    type(directions_t) :: beginning
    real(wp) :: coefficient(0:2), weakening, difference(n_changes), shift, size_of
    integer :: i

    associate (velocity => piece%drive%velocity, tangent => self%tangent(1))
      if (self%is_planar) then
        associate (path => piece%path, s => piece%path%grid%degree)
          do i = 1, s
            call system%decay_polynomial(path%nodal(i, column_y:column_y), velocity, coefficient, weakening)
            self%logarithm = self%logarithm - path%step*path%grid%integral(s, i)*coefficient(1)/coefficient(2)
          end do
        end associate
        return
      end if
      allocate (beginning%variation(1))
      call beginning%follow(self%tangent, piece, system, slider, self%is_followed)
      if (.not. self%is_followed) return
      difference = [tangent%u, tangent%y]
      call take_out_flow(difference, piece, slider, shift, size_of, self%is_followed)
      self%is_followed = self%is_followed .and. size_of > tiny(size_of)
      if (.not. self%is_followed) return
      self%logarithm = self%logarithm + log(size_of)
      tangent%u = difference(:max_components)/size_of
      tangent%y = difference(max_components + 1:)/size_of
    end associate
  end subroutine follow

  !> The logarithm of the growth since this was asked last, and whether it is known: not if it is too small.
  pure subroutine tell(self, logarithm, is_known)
    class(growth_t), intent(inout) :: self
    real(wp), intent(out) :: logarithm
    logical, intent(out) :: is_known

    logarithm = self%logarithm
    is_known = self%is_planar .or. logarithm > log(least_growth)
    self%logarithm = 0.0_wp
  end subroutine tell

  !> The logarithm of the growth in a slow cycle without a rest that ends as it began, and whether it is known: that of its largest
  !> multiplier, besides that of a shift of the time, which is 1. If that is too small it is known no better.
  subroutine cycle_growth(recording, system, slider, velocity, logarithm, is_known)
    type(recording_t), intent(in) :: recording
    class(slip_system_t), intent(in) :: system
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: velocity            !! V, m/s
    real(wp), intent(out) :: logarithm
    logical, intent(out) :: is_known
    type(growth_t) :: growth
    type(directions_t) :: beginning
    type(tangent_t) :: tangent(system%components + system%unknowns)
    type(piece_t) :: piece
    complex(wp) :: multiplier(size(tangent))
    real(wp) :: change(size(tangent), size(tangent))
    integer :: i, k

    logarithm = 0.0_wp
    call recording%get(1, state_t(), piece)
    call growth%begin(system, slider, velocity, piece%is_polar)
    tangent = tangent_t(rests=.false., is_polar=piece%is_polar)
    associate (n => system%components, first => system%axis, last => system%axis + system%components - 1)
      do k = 1, size(tangent)
        if (k <= n) tangent(k)%u(first + k - 1) = 1.0_wp
        if (k > n) tangent(k)%y(k - n) = 1.0_wp
      end do
      allocate (beginning%variation(size(tangent)))
      is_known = .true.
      do i = 1, recording%count
        call recording%get(i, state_t(), piece)
        if (growth%is_planar) then
          call growth%follow(piece, system, slider)
        else if (is_known) then
          call beginning%follow(tangent, piece, system, slider, is_known)
        end if
      end do
      if (growth%is_planar) call growth%tell(logarithm, is_known)
      if (growth%is_planar .or. .not. is_known) return
      do k = 1, size(tangent)
        change(:, k) = [tangent(k)%u(first:last), tangent(k)%y(:system%unknowns)]
      end do
    end associate
    call find_eigenvalues(change, multiplier, is_known)
    if (.not. is_known) return
    multiplier(minloc(abs(multiplier - 1.0_wp), 1)) = 0.0_wp
    associate (largest => maxval(abs(multiplier)))
      is_known = largest > least_growth
      logarithm = log(max(least_growth, largest))
    end associate
  end subroutine cycle_growth
end module dst_growth
