!> Passages as polynomials: their measures, and the motion inside the slip of laps, at Chebyshev points of a variable x in [-1, 1]
!> in which they are analytic. docs/cycle_map.md.
module dst_passage_table
  use dst_chebyshev, only: chebyshev_points, chebyshev_polynomials, chebyshev_coefficients, chebyshev_derivative, &
    cardinal_functions
  use dst_dense_output, only: column_u, column_y, column_position
  use dst_interpolation, only: grid_t, chebyshev_grid, max_degree
  use dst_kinds, only: wp
  use dst_observation, only: observations_t, new_observations
  use dst_passage, only: passage_t, slip_duration, duration, turn, measures
  use dst_piece, only: piece_t, stick_begins, slip_begins, slips, sticks
  use dst_recording, only: recording_t
  use dst_slider, only: slider_t
  use dst_state, only: state_t
  implicit none
  private

  public :: passage_table_t, new_passage_table, values

  !> The number of values that a table has: the measures and two derivatives.
  integer, parameter :: values = measures + 2

  !> The motion inside slip: change of u since the release [m], v [m/s], change of theta [rad].
  integer, parameter :: slip_columns = 4
  !> Panels into which a long piece in closed form is divided; and the number of pieces for which a panel is one of them: of more,
  !> as explicit methods need, several are one panel. Conventions; twice: no change, and 4e-12 of a measure.
  integer, parameter :: closed_form_panels = 3, few_pieces = 128
  !> Permitted error of the motion inside the slip, of which samples are taken, over that of the measures. Convention; twice: no
  !> change.
  real(wp), parameter :: allowed_inside = 300.0_wp

  !> Passages at Chebyshev points.
  type :: passage_table_t
    integer :: points = 0
    real(wp), allocatable :: point(:)
    !> Coefficients of the measures (measure, point) in Chebyshev polynomials, and of the derivatives of the turn and the duration.
    real(wp), allocatable :: coefficient(:, :)
    !> The slip of the laps at the points: ends of its panels as shares of its length, and nodal values (node, column, panel,
    !> point); no panels if the motion inside is not kept.
    integer :: panels = 0, pieces_in_panel = 1
    real(wp), allocatable, private :: panel_end(:)
    real(wp), allocatable, private :: inside(:, :, :, :)
    type(grid_t), private :: grid
    !> What a summary wants to know of them; and, where that is not smooth, of parts of them (dst_branch).
    type(observations_t) :: seen
    type(observations_t), allocatable :: part(:)
  contains
    procedure :: take
    procedure :: settle
    procedure :: error_of
    procedure :: error_inside
    procedure :: evaluate
    procedure :: describe
  end type passage_table_t

contains

  !> A table without passages.
  pure subroutine new_passage_table(points, table)
    integer, intent(in) :: points
    type(passage_table_t), intent(out) :: table

    table%points = points
    table%point = chebyshev_points(points)
    table%grid = chebyshev_grid()
    allocate (table%coefficient(values, points))
    call new_observations(points, table%seen)
  end subroutine new_passage_table

  !> Add the passage at point `j`; with a recording, also the motion inside, on the panels that the first one sets.
  pure subroutine take(self, j, passage, recording)
    class(passage_table_t), intent(inout) :: self
    integer, intent(in) :: j
    type(passage_t), intent(in) :: passage
    type(recording_t), intent(in), optional :: recording
    type(piece_t) :: piece
    integer :: now, i, k

    self%coefficient(:measures, j) = passage%measure
    if (.not. present(recording)) return
    if (.not. allocated(self%inside)) call set_panels(self, recording)
    now = 0
    do k = 1, self%panels
      do i = 0, max_degree
        call read_slip(recording, self%panel_end(k - 1) + self%grid%node(i)*(self%panel_end(k) - self%panel_end(k - 1)), &
          now, piece, self%inside(i, :, k, j))
      end do
    end do
    ! Slip begins and ends at rest.
    self%inside(0, 3, 1, j) = 0.0_wp
    self%inside(max_degree, 3, self%panels, j) = 0.0_wp
  end subroutine take

  !> The motion at a share of the slip of a recorded lap, no earlier than in the last call; `piece` is its number `now`, at first 0.
  pure subroutine read_slip(recording, share, now, piece, value)
    type(recording_t), intent(in) :: recording
    real(wp), intent(in) :: share
    integer, intent(inout) :: now
    type(piece_t), intent(inout) :: piece
    real(wp), intent(out) :: value(:)
    type(state_t) :: state
    integer :: before

    associate (n => recording%count, from => recording%kept(1)%from)
      associate (elapsed => share*recording%kept(n)%from%time)
        before = now
        now = max(1, now)
        do while (now < n - 1)
          if (recording%kept(now + 1)%from%time > elapsed) exit
          now = now + 1
        end do
        if (now /= before) call recording%get(now, state_t(), piece)
        state = piece%inside(min(1.0_wp, max(0.0_wp, (elapsed - piece%from%time)/piece%path%step)))
      end associate
      value = [state%u - from%u, state%y(1), state%y(2) - from%y(2)]
    end associate
  end subroutine read_slip

  !> Panels as the pieces of the slip of a lap, or some of them together; pieces in closed form are divided, as they are too long
  !> for polynomials on the grid.
  pure subroutine set_panels(self, recording)
    class(passage_table_t), intent(inout) :: self
    type(recording_t), intent(in) :: recording
    type(piece_t) :: piece
    integer :: i, j, parts, n

    associate (last => recording%count - 1, slip => recording%kept(recording%count)%from%time)
      allocate (self%panel_end(0:closed_form_panels*last))
      self%panel_end(0) = 0.0_wp
      n = 0
      self%pieces_in_panel = 1 + (last - 1)/few_pieces
      do i = 1, last
        call recording%get(i, state_t(), piece)
        parts = merge(1, closed_form_panels, abs(piece%path%grid%node(1) - self%grid%node(1)) > 0.0_wp)
        if (parts == 1 .and. modulo(i, self%pieces_in_panel) > 0 .and. i < last) cycle
        do j = 1, parts
          n = n + 1
          self%panel_end(n) = (piece%from%time + real(j, wp)/real(parts, wp)*piece%path%step)/slip
        end do
      end do
    end associate
    self%panels = n
    self%panel_end(n) = 1.0_wp
    allocate (self%inside(0:max_degree, slip_columns, n, self%points))
  end subroutine set_panels

  !> Convert the measures to polynomials.
  pure subroutine settle(self)
    class(passage_table_t), intent(inout) :: self

    self%coefficient(:measures, :) = transpose(chebyshev_coefficients(transpose(self%coefficient(:measures, :))))
    self%coefficient(measures + 1, :) = chebyshev_derivative(self%coefficient(turn, :))
    self%coefficient(values, :) = chebyshev_derivative(self%coefficient(duration, :))
  end subroutine settle

  !> Errors of duration and turn at `x`, relative to the former and to the largest turn, for the passage there.
  pure real(wp) function error_of(self, x, passage) result(error)
    class(passage_table_t), intent(in) :: self
    real(wp), intent(in) :: x
    type(passage_t), intent(in) :: passage
    real(wp) :: value(values)

    call self%evaluate(x, value)
    error = maxval(abs(value([duration, slip_duration]) - passage%measure([duration, slip_duration]))) &
      /passage%measure(duration)
    error = max(error, abs(value(turn) - passage%measure(turn))/max(abs(passage%measure(turn)), abs(self%coefficient(turn, 1))))
  end function error_of

  !> Largest error of the motion inside the slip of a recorded lap at `x`, relative to the largest elongation and slip speed in it:
  !> in the middle of each panel; over `allowed_inside`.
  pure real(wp) function error_inside(self, x, recording) result(error)
    class(passage_table_t), intent(in) :: self
    real(wp), intent(in) :: x
    type(recording_t), intent(in) :: recording
    real(wp), dimension(slip_columns) :: found, right, largest
    real(wp) :: nodal(0:max_degree, slip_columns), basis(0:max_degree), cardinal(self%points)
    type(piece_t) :: piece
    integer :: now, k

    error = 0.0_wp
    if (self%panels == 0) return
    now = 0
    call cardinal_functions(self%points, self%point, x, cardinal)
    call self%grid%lagrange(0.5_wp, basis)
    largest = [(maxval(abs(self%inside(:, k, :, :))), k=1, slip_columns)]
    do k = 1, self%panels
      call interpolate(self, cardinal, k, nodal)
      found = matmul(basis, nodal)
      call read_slip(recording, 0.5_wp*(self%panel_end(k - 1) + self%panel_end(k)), now, piece, right)
      ! The direction matters as much as the speed.
      error = max(error, maxval(abs(found(1:3) - right(1:3))/largest(1:3)), abs(found(4) - right(4))*right(3)/largest(3))
    end do
    error = error/allowed_inside
  end function error_inside

  !> The measures at `x`, and the derivatives of the turn and the duration.
  pure subroutine evaluate(self, x, value)
    class(passage_table_t), intent(in) :: self
    real(wp), intent(in) :: x
    real(wp), intent(out) :: value(values)
    real(wp) :: polynomial(self%points)
    integer :: i

    call chebyshev_polynomials(self%points, x, polynomial)
    value = 0.0_wp
    do i = 1, self%points
      value = value + polynomial(i)*self%coefficient(:, i)
    end do
  end subroutine evaluate

  !> The nodal values of a panel for the cardinal functions at a place.
  pure subroutine interpolate(self, cardinal, panel, nodal)
    class(passage_table_t), intent(in) :: self
    real(wp), intent(in) :: cardinal(:)
    integer, intent(in) :: panel
    real(wp), intent(out) :: nodal(0:max_degree, slip_columns)
    integer :: j

    nodal = 0.0_wp
    do j = 1, self%points
      nodal = nodal + cardinal(j)*self%inside(:, :, panel, j)
    end do
  end subroutine interpolate

  !> The lap at `x`, a passage with these measures that begins and ends with these elongations [m] at the angle `theta` of friction
  !> [rad], piece by piece. `like` is a piece of the same motion.
  pure subroutine describe(self, x, passage, slider, u, theta, like, recording)
    class(passage_table_t), intent(in) :: self
    real(wp), intent(in) :: x
    type(passage_t), intent(in) :: passage
    type(slider_t), intent(in) :: slider
    real(wp), intent(in) :: u(2, 2), theta
    type(piece_t), intent(in) :: like
    type(recording_t), intent(inout) :: recording
    real(wp) :: nodal(0:max_degree, slip_columns), cardinal(self%points), begin
    type(piece_t) :: piece
    integer :: i, k

    call recording%clear()
    call cardinal_functions(self%points, self%point, x, cardinal)
    piece%drive%velocity = like%drive%velocity
    piece%drive_coupling = like%drive_coupling
    piece%is_polar = like%is_polar
    piece%path%grid = self%grid
    piece%contact = slips
    piece%to%u = u(:, 1)
    piece%to%y(1:2) = [0.0_wp, theta]
    associate (slip => passage%measure(slip_duration), velocity => like%drive%velocity)
      do k = 1, self%panels
        call interpolate(self, cardinal, k, nodal)
        piece%from = piece%to
        begin = self%panel_end(k - 1)*slip
        piece%path%step = self%panel_end(k)*slip - begin
        associate (path => piece%path%nodal, step => piece%path%step)
          do i = 0, max_degree
            path(i, column_u:column_u + 1) = u(:, 1) + nodal(i, 1:2)
            path(i, column_y) = max(0.0_wp, nodal(i, 3))
            path(i, column_y + 1) = theta + nodal(i, 4)
            path(i, column_position) = velocity*(begin + self%grid%node(i)*step) - dot_product(nodal(i, 1:2), slider%along)
            ! The polynomials are those of u without the drive.
            path(i, column_u:column_u + 1) = path(i, column_u:column_u + 1) &
              - velocity*self%grid%node(i)*step*like%drive_coupling(1:2)
          end do
          piece%to%time = self%panel_end(k)*slip
          piece%to%u = u(:, 1) + nodal(max_degree, 1:2)
          piece%to%y(1:2) = path(max_degree, column_y:column_y + 1)
          piece%to%position = path(max_degree, column_position)
        end associate
        if (k == self%panels) then
          ! The rest ends with the release, which is known.
          piece%event = stick_begins
          piece%to%u = u(:, 2) - velocity*(passage%measure(duration) - slip)*like%drive_coupling(1:2)
          piece%to%position = velocity*slip - dot_product(piece%to%u - u(:, 1), slider%along)
        end if
        call recording%append(piece)
      end do
      call recording%kept(self%panels)%to%arrive(slip)
      piece%from = piece%to
      piece%from%y = 0.0_wp
      piece%to%time = passage%measure(duration)
      piece%to%u = u(:, 2)
      piece%to%y = 0.0_wp
    end associate
    piece%contact = sticks
    piece%event = slip_begins
    call recording%append(piece)
    call recording%kept(self%panels + 1)%to%arrive(passage%measure(duration))
  end subroutine describe
end module dst_passage_table
