!> Run a deck into a result file: what `dynstiction run` does.
module dst_run
  use dst_kinds, only: wp
  use dst_build_info, only: program_name, version, git_revision, compiler
  use dst_deck, only: deck_t, resolved
  use dst_errors, only: error_t, stopped_early
  use dst_model_choice, only: settle_model
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, text_parameter_t, create_hdf5
  use dst_parameters, only: parameter_t, parameters_of
  use dst_progress, only: progress_t, new_progress
  use dst_scene, only: scene_t, scene_from_deck
  use dst_sha256, only: sha256
  use dst_simulation, only: simulation_t
  use dst_writer, only: outcome_t
  implicit none
  private

  public :: run_deck, metadata_of

  !> Wall time of one slice of the run [s]: how often progress and flushing get their turn.
  real(wp), parameter :: slice = 0.1_wp

contains

  !> Integrate the deck's scene into `output_file`. A solver that gives up leaves a file with all up
  !> to that point and its result code; `error` says the same.
  subroutine run_deck(deck, output_file, overwrite, quiet, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: output_file
    logical, intent(in) :: overwrite, quiet
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t) :: simulation
    type(hdf5_writer_t) :: writer
    type(scene_t) :: scene
    type(outcome_t) :: outcome
    type(progress_t) :: progress
    type(error_t), allocatable :: end_error
    character(:), allocatable :: model_choice

    call scene_from_deck(deck, scene)
    call settle_model(scene, model_choice)
    call simulation%start(scene, error)
    if (allocated(error)) return
    call create_hdf5(writer, output_file, overwrite, metadata_of(deck, simulation%scene%model, &
      simulation%method_name(), model_choice), simulation%output_columns(), error, expected_rows(scene))
    if (allocated(error)) return
    progress = new_progress(deck%name, quiet)
    if (model_choice /= '') call progress%remark("model 'auto' is "//model_choice)
    call integrate(simulation, writer, progress, error)
    call simulation%outcome(error, outcome)
    call writer%finish(outcome, end_error)
    if (.not. allocated(end_error)) return
    ! A file that is lost matters more than a run that was stopped; a solver that gave up does not change by it.
    if (allocated(error)) then
      if (error%code /= stopped_early) return
    end if
    call move_alloc(end_error, error)
  end subroutine run_deck

  !> All slices of the run.
  subroutine integrate(simulation, writer, progress_line, error)
    type(simulation_t), intent(inout) :: simulation
    type(hdf5_writer_t), intent(inout) :: writer
    type(progress_t), intent(in) :: progress_line
    type(error_t), allocatable, intent(out) :: error
    type(progress_t) :: progress
    real(wp) :: flushed

    progress = progress_line
    flushed = 0.0_wp
    do
      call simulation%proceed(slice, writer, error)
      if (simulation%finished .or. allocated(error)) exit
      call progress%show(simulation%trajectory%now%time, simulation%scene%t_end, simulation%elapsed)
      if (simulation%elapsed - flushed >= simulation%scene%flush_seconds) then
        call writer%flush(error)
        if (allocated(error)) exit
        flushed = simulation%elapsed
      end if
    end do
    call progress%close()
  end subroutine integrate

  !> Number of samples, as far as it is known beforehand.
  pure integer function expected_rows(scene)
    type(scene_t), intent(in) :: scene

    expected_rows = 1024
    if (scene%interval > 0.0_wp) expected_rows = int(min(scene%t_end/scene%interval + 2.0_wp, 1.0e9_wp))
  end function expected_rows

  !> What the file says about its run.
  function metadata_of(deck, model, method, model_choice) result(metadata)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: model, method, model_choice
    type(run_metadata_t) :: metadata
    type(parameter_t), allocatable :: parameters(:)
    logical, allocatable :: is_text(:)
    integer :: i, numbers, texts

    metadata%program = program_name
    metadata%version = version
    metadata%git_revision = git_revision
    metadata%compiler = compiler
    metadata%model = model
    metadata%model_choice = model_choice
    metadata%method = method
    metadata%deck_text = deck%text
    metadata%deck_resolved = resolved(deck)
    metadata%deck_sha256 = sha256(deck%text)
    call parameters_of(deck, parameters)
    allocate (is_text(size(parameters)))
    do i = 1, size(parameters)
      is_text(i) = allocated(parameters(i)%text)
    end do
    allocate (metadata%parameters(count(.not. is_text)), metadata%parameter_value(count(.not. is_text)))
    allocate (metadata%text_parameters(count(is_text)))
    numbers = 0
    texts = 0
    do i = 1, size(parameters)
      if (is_text(i)) then
        texts = texts + 1
        metadata%text_parameters(texts)%name = parameters(i)%quantity%name
        metadata%text_parameters(texts)%long_name = parameters(i)%quantity%long_name
        metadata%text_parameters(texts)%value = parameters(i)%text
      else
        numbers = numbers + 1
        metadata%parameters(numbers) = parameters(i)%quantity
        metadata%parameter_value(numbers) = parameters(i)%value
      end if
    end do
  end function metadata_of
end module dst_run
