!> A run: scene in, samples and events out to a writer, in slices of wall time.
!>
!> This is the only run routine, of the executable and of Python.
module dst_simulation
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_assembly, only: new_motion
  use dst_stopwatch, only: wall_clock
  use dst_columns, only: columns, find_column, default_columns, damping_ratio_exists, row_of
  use dst_drive, only: drive_t
  use dst_errors, only: error_t, raise, result_done, deck_error, too_many_steps, not_finite, stopped_early
  use dst_kinds, only: wp, int64
  use dst_model_columns, only: gives_column
  use dst_motion, only: motion_t, next_piece, change_over, at_time
  use dst_motion_summary, only: motion_summary_t
  use dst_piece, only: no_event
  use dst_sampling, only: settle_interval, sample_time
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t
  use dst_state, only: instant_t
  use dst_stepper, only: work_count_t
  use dst_text, only: short_text
  use dst_writer, only: writer_t, quantity_t, event_t, outcome_t
  implicit none
  private

  public :: simulation_t, select_columns, check_piece, pieces_between_looks

  !> The clock is read once after this many pieces, or samples. Convention: a piece takes some microseconds; no number depends on
  !> it.
  integer, parameter :: pieces_between_looks = 16
  integer(int64), parameter :: samples_between_looks = 512

  !> How far the run is.
  type :: progress_t
    real(wp) :: elapsed = 0.0_wp           !! wall time so far, s
    integer(int64) :: samples = 0
    real(wp) :: sampled = 0.0_wp           !! time of the last sample, s
  end type progress_t

  !> One run: its motion, its method, and what is recorded.
  type, extends(progress_t) :: simulation_t
    type(scene_t) :: scene
    !> The motion, and one that alternates with it where the drive begins or ceases to rest.
    class(motion_t), allocatable :: motion, other
    type(motion_summary_t) :: summary
    !> Numbers of the output columns; the first is time.
    integer, allocatable :: selected(:)
    logical :: finished = .false.
    !> The part of the wall time before the run was resumed [s].
    real(wp) :: elapsed_before = 0.0_wp
    !> Instants to sample [s], from 0 to t_end, if the samples are not at equal intervals.
    real(wp), allocatable :: instants(:)
  contains
    procedure :: start
    procedure :: proceed
    procedure :: has_reached
    procedure :: state_at
    procedure :: outcome
    procedure :: output_columns
    procedure :: state_text
    procedure :: serialise
  end type simulation_t

contains

  !> Build the model and the method of the scene, whose model has been chosen, and place the object at time 0.
  subroutine start(self, scene, error)
    class(simulation_t), intent(inout) :: self
    type(scene_t), intent(in) :: scene
    type(error_t), allocatable, intent(out) :: error

    self%scene = scene
    call settle_interval(self%scene)
    call new_motion(self%scene, self%motion, self%other, error)
    if (.not. allocated(error)) call select_columns(self%scene, self%motion%slider, self%motion%drive, self%selected, error)
    if (allocated(error)) return
    call self%summary%start(self%motion, scene%settle)
  end subroutine start

  !> The numbers of the columns that a scene asks for, the time first.
  subroutine select_columns(scene, slider, drive, selected, error)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    integer, allocatable, intent(out) :: selected(:)
    type(error_t), allocatable, intent(out) :: error
    integer :: i, column

    if (scene%fields(1) == 'default') then
      selected = default_columns(slider, drive)
      selected = pack(selected, gives_column(scene%model, columns(selected)%name))
      return
    end if
    selected = [1]
    do i = 1, size(scene%fields)
      column = find_column(scene%fields(i))
      if (column == 0) then
        call raise(error, deck_error, 'output.fields: there is no column '//trim(scene%fields(i)), 'output.fields')
        return
      else if (columns(column)%name == 'zeta' .and. .not. damping_ratio_exists(slider, drive)) then
        call raise(error, deck_error, 'output.fields: zeta has no value where V sin(phi) = 0: leave zeta out', 'output.fields')
        return
      else if (.not. gives_column(scene%model, columns(column)%name)) then
        call raise(error, deck_error, "output.fields: model = '"//scene%model//"' does not give "// &
          trim(columns(column)%name)//': leave it out', 'output.fields')
        return
      end if
      if (all(selected /= column)) selected = [selected, column]
    end do
  end subroutine select_columns

  !> Descriptions of the columns written.
  pure function output_columns(self) result(descriptions)
    class(simulation_t), intent(in) :: self
    type(quantity_t), allocatable :: descriptions(:)

    descriptions = columns(self%selected)
  end function output_columns

  !> Continue for at most `seconds` of wall time [s], or to the end, or until the time `until` [s] has been reached or the writer is
  !> full. An error of the solver ends the run: it is then finished, and everything up to the error has been written.
  subroutine proceed(self, seconds, writer, error, until)
    class(simulation_t), intent(inout) :: self
    real(wp), intent(in) :: seconds
    type(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(in), optional :: until
    real(wp) :: begun, passed, last, limit
    integer :: looks_left

    begun = wall_clock()
    last = huge(1.0_wp)
    if (present(until)) last = until
    limit = huge(1.0_wp)
    if (self%scene%wall_limit > 0.0_wp) limit = self%scene%wall_limit - (self%elapsed - self%elapsed_before)
    passed = 0.0_wp
    looks_left = pieces_between_looks
    do while (.not. (allocated(error) .or. self%has_reached(min(last, end_time(self)))))
      if (is_due(self)) then
        call take_sample(self, writer, error)
        if (writer%rows >= writer%most_rows) exit
        if (modulo(self%samples, samples_between_looks) == 0) looks_left = 0
      else
        call advance(self, writer, last, error)
        looks_left = looks_left - 1
      end if
      if (looks_left == 0) then
        passed = wall_clock() - begun
        if (passed >= seconds .or. passed > limit) exit
        looks_left = pieces_between_looks
      end if
    end do
    passed = wall_clock() - begun
    self%elapsed = self%elapsed + passed
    self%finished = allocated(error) .or. self%has_reached(end_time(self))
    if (self%finished .or. passed <= limit) return
    call raise(error, stopped_early, 'stopped at the wall-time limit: raise output.wall_limit')
    self%finished = .true.
  end subroutine proceed

  !> Whether the motion has ended: at t_end, or because it has settled.
  pure logical function is_over(self)
    class(simulation_t), intent(in) :: self

    is_over = self%motion%piece%to%time >= end_time(self)
  end function is_over

  !> When the run ends [s]: at t_end, or earlier if it has settled.
  pure real(wp) function end_time(self)
    class(simulation_t), intent(in) :: self

    end_time = min(self%scene%t_end, self%summary%end_at)
  end function end_time

  !> Whether the motion has been computed up to `time` [s], and all samples up to it have been recorded.
  pure logical function has_reached(self, time)
    class(simulation_t), intent(in) :: self
    real(wp), intent(in) :: time

    has_reached = self%motion%piece%to%time >= time .and. .not. is_due(self)
  end function has_reached

  !> The row of output at `time` [s], within the last piece or, for a closed form, anywhere.
  subroutine state_at(self, time, row)
    class(simulation_t), intent(inout) :: self
    real(wp), intent(in) :: time
    real(wp), intent(out) :: row(:)

    call self%motion%show(time)
    call row_of(self%motion%slider, self%motion%instant(time), self%selected, row)
  end subroutine state_at

  !> One piece, checked and added to the summary, and its events. For a closed form it ends at the next sample, or at the time
  !> `last` [s].
  subroutine advance(self, writer, last, error)
    class(simulation_t), intent(inout) :: self
    type(writer_t), intent(inout) :: writer
    real(wp), intent(in) :: last
    type(error_t), allocatable, intent(out) :: error

    if (self%motion%in_closed_form) self%motion%next_look = min(next_sample(self), last)
    self%motion%t_end = end_time(self)
    if (allocated(self%other)) self%other%t_end = end_time(self)
    call next_piece(self%motion, self%other, error)
    if (allocated(error)) return
    call check_piece(self%motion, merge(0_int64, self%scene%max_steps, is_over(self)), error)
    if (allocated(error)) return
    call self%summary%follow(self%motion)
    call write_events(self, writer, error)
  end subroutine advance

  !> The events of the last piece, or that with which the motion begins.
  subroutine write_events(self, writer, error)
    class(simulation_t), intent(inout) :: self
    type(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    type(event_t), allocatable :: log(:)

    if (self%motion%piece%event == no_event) return
    call self%motion%events(log)
    call writer%add_events(log, error)
  end subroutine write_events

  !> Sanity of the last piece of a motion, and its limit of steps, 0 if there is none.
  subroutine check_piece(motion, max_steps, error)
    class(motion_t), intent(in) :: motion
    integer(int64), intent(in) :: max_steps
    type(error_t), allocatable, intent(out) :: error
    type(work_count_t) :: work
    character(60) :: limit

    associate (piece => motion%piece)
      associate (to => piece%to)
        if (.not. abs(to%time) + sum(abs(to%u)) + sum(abs(to%y)) + abs(to%position) + abs(to%drive_work) &
          + abs(to%friction_work) + abs(to%damper_work) <= huge(1.0_wp)) then
          call raise(error, not_finite, 'the motion is not finite after '//trim(at_time(piece%from))// &
            ': use a smaller rtol or another method')
          return
        end if
      end associate
      if (max_steps == 0) return
      work = motion%work()
      if (work%steps < max_steps) return
      write (limit, '(a,i0)') 'integrator.max_steps = ', max_steps
      call raise(error, too_many_steps, trim(limit)//' reached at '//trim(at_time(piece%to))//': raise it, or use a larger rtol')
    end associate
  end subroutine check_piece

  !> Whether a sample in the last piece has still to be taken: all steps are samples if there is no interval.
  pure logical function is_due(self)
    class(simulation_t), intent(in) :: self

    associate (now => self%motion%piece%to%time)
      is_due = self%samples == 0 .or. self%sampled < now
      if (is_due .and. self%scene%interval > 0.0_wp) is_due = next_sample(self) <= now
    end associate
  end function is_due

  !> Time of the next sample [s], if there is an interval.
  pure real(wp) function next_sample(self) result(time)
    class(simulation_t), intent(in) :: self

    if (allocated(self%instants)) then
      time = self%instants(min(self%samples + 1, size(self%instants, kind=int64)))
    else
      time = sample_time(self%scene%t_end, self%scene%interval, self%samples)
    end if
    if (is_over(self)) time = min(time, self%motion%piece%to%time)
  end function next_sample

  !> The next row of output, which is due.
  subroutine take_sample(self, writer, error)
    class(simulation_t), intent(inout) :: self
    type(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    type(instant_t) :: instant
    real(wp) :: row(size(self%selected))
    integer :: column

    if (self%samples == 0) call write_events(self, writer, error)
    if (allocated(error)) return
    if (self%scene%interval > 0.0_wp) then
      self%sampled = next_sample(self)
    else
      call self%motion%show(self%sampled)
      self%sampled = self%motion%next_instant(self%sampled)
    end if
    call self%motion%show(self%sampled)
    instant = self%motion%instant(self%sampled)
    call self%summary%see(self%motion, instant)
    self%samples = self%samples + 1
    call row_of(self%motion%slider, instant, self%selected, row)
    if (all(abs(row) <= huge(row))) then
      call writer%add_sample(row, error)
    else
      column = self%selected(findloc(abs(row) <= huge(row), .false., dim=1))
      call raise(error, not_finite, trim(columns(column)%name)//' is not finite at '//trim(at_time(instant%state))// &
        ': leave it out of output.fields, or scale the parameters')
    end if
  end subroutine take_sample

  !> How the run ended; `error` is the one that `proceed` returned.
  subroutine outcome(self, error, result)
    class(simulation_t), intent(in) :: self
    type(error_t), allocatable, intent(in) :: error
    type(outcome_t), intent(out) :: result

    result%result_code = result_done
    result%result_text = 'done'
    if (allocated(error)) then
      result%result_code = error%code
      result%result_text = error%text
    end if
    call self%summary%describe(self%motion, self%elapsed, result)
  end subroutine outcome

  !> Time and state, for messages.
  pure function state_text(self) result(text)
    class(simulation_t), intent(in) :: self
    character(:), allocatable :: text

    text = 't = '//trim(short_text(self%motion%piece%to%time))//' of '//trim(short_text(self%scene%t_end))//' s'
  end function state_text

  !> Save or load, between two calls of `proceed`. A simulation is loaded after it has been started.
  subroutine serialise(self, archive)
    class(simulation_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive
    logical, target :: may_rest

    if (allocated(self%other)) then
      may_rest = self%motion%may_rest
      call archive%serialise(c_loc(may_rest), storage_size(may_rest))
      if (may_rest .neqv. self%motion%may_rest) call change_over(self%motion, self%other)
      call self%other%serialise(archive)
    end if
    call self%motion%serialise(archive)
    call self%summary%serialise(archive)
    call archive%serialise(c_loc(self%progress_t), storage_size(self%progress_t))
    if (archive%is_loading()) self%elapsed_before = self%elapsed
  end subroutine serialise
end module dst_simulation
