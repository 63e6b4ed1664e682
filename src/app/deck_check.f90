!> Requirements on a deck beyond those of its text: a scene that can be set up, and results that can be written.
!>
!> `check`, and `run` before the first of its decks, call the same procedure, so that they refuse the same decks with the same
!> words.
module dst_deck_check
  use, intrinsic :: iso_c_binding, only: nul => c_null_char
  use dst_cycles, only: measures
  use dst_deck, only: deck_t
  use dst_deck_sweep, only: grid_cases, varied_key
  use dst_disk, only: folder_of, file_exists, true_path
  use dst_errors, only: error_t, raise, deck_error, file_error
  use dst_faults, only: faults_t
  use dst_kinds, only: wp
  use dst_model_choice, only: settle_model
  use dst_plain_numbers, only: number_text, bytes_text
  use dst_posix, only: free_space
  use dst_sampling, only: sample_count, run_samples, most_samples, most_series_values
  use dst_scene, only: scene_t, scene_from_deck
  use dst_scene_notes, only: scene_notes
  use dst_schema, only: sweep_group
  use dst_share, only: share_t
  use dst_simulation, only: simulation_t
  use dst_sweep, only: sweep_t, axis_t, new_sweep, value_count, table_quantities, series_interval
  use dst_sweep_points, only: read_points
  use dst_text, only: integer_text, printable
  implicit none
  private

  public :: check_deck, sweep_of_deck

  !> Files of this size are mentioned before the run.
  real(wp), parameter :: large = 1.0e9_wp

  !> The results that a deck will write.
  type :: demand_t
    real(wp) :: bytes = 0.0_wp            !! as far as it is known beforehand
    character(:), allocatable :: what     !! '1e7 samples of 16 columns'
    character(:), allocatable :: remedy
  end type demand_t

contains

  !> Refuse a deck, read without a fault, that cannot run, or whose results do not fit on the disk of `output`.
  subroutine check_deck(deck, output, share, notes, interval, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: output                 !! the result file
    type(share_t), intent(in) :: share                 !! of a sweep
    character(:), allocatable, intent(out) :: notes    !! settings that are seldom intended, and the size of large results
    real(wp), allocatable, intent(out) :: interval     !! between the samples of a run [s]; unallocated if cases have their own
    type(error_t), allocatable, intent(out) :: error
    type(demand_t) :: demand

    notes = ''
    if (deck%is_sweep()) then
      call weigh_sweep(deck, share, demand, notes, error)
    else
      call weigh_run(deck, demand, notes, interval, error)
    end if
    ! With a limit of wall time, the results up to this limit are wanted.
    if (.not. (allocated(error) .or. deck%real_of('output', 'wall_limit') > 0.0_wp)) call check_room(output, demand, error)
    if (allocated(error)) then
      call locate(deck, error)
    else if (demand%bytes >= large) then
      notes = notes//printable(deck%name)//': note: '//demand%what//' will take '//bytes_text(demand%bytes)//new_line('a')
    end if
  end subroutine check_deck

  !> A single run: model, method, columns, samples.
  subroutine weigh_run(deck, demand, notes, interval, error)
    type(deck_t), intent(in) :: deck
    type(demand_t), intent(out) :: demand
    character(:), allocatable, intent(out) :: notes
    real(wp), allocatable, intent(out) :: interval
    type(error_t), allocatable, intent(out) :: error
    type(simulation_t), allocatable :: simulation
    type(scene_t) :: scene
    character(:), allocatable :: model_choice, decisive   ! the interval between the samples
    real(wp) :: samples

    call scene_from_deck(deck, scene)
    decisive = 'output.interval'
    if (.not. abs(scene%interval) > 0.0_wp) decisive = 'integrator.step or give output.interval'
    ! The interval that 'auto' chooses is never too short.
    if (.not. scene%interval < 0.0_wp .and. run_samples(scene) > most_samples) then
      call raise(error, deck_error, 'more than 2^53 samples: raise '//decisive//', or lower scene.t_end', 'scene.t_end')
      return
    end if
    call settle_model(scene, model_choice)
    allocate (simulation)
    call simulation%start(scene, error)
    if (allocated(error)) return
    samples = run_samples(simulation%scene)
    interval = simulation%scene%interval
    call scene_notes(deck, simulation%scene, notes)
    associate (columns => simulation%output_columns())
      demand%bytes = samples*real(8*size(columns) - 7*count(columns%name == 'sticking'), wp)
      if (precision(1.0_wp) > 15) demand%bytes = demand%bytes + samples*real(8*size(columns), wp)
      demand%what = number_text(samples)//' samples of '//integer_text(size(columns))//' columns'
    end associate
    demand%remedy = 'raise '//decisive//', name fewer output.fields, or choose another disk'
  end subroutine weigh_run

  !> A sweep: its list of points, and a row for each case.
  subroutine weigh_sweep(deck, share, demand, notes, error)
    type(deck_t), intent(in) :: deck
    type(share_t), intent(in) :: share
    type(demand_t), intent(out) :: demand
    character(:), allocatable, intent(inout) :: notes
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t) :: sweep
    type(scene_t) :: scene
    real(wp) :: cases, numbers, samples

    numbers = 0.0_wp
    demand%remedy = 'use smaller counts'
    if (deck%text_of(sweep_group, 'keep') == 'cycles') then
      numbers = real(measures*deck%integer_of(sweep_group, 'cycles') + 1, wp)
      demand%remedy = demand%remedy//', fewer sweep.cycles'
    else if (deck%text_of(sweep_group, 'keep') == 'series') then
      samples = sample_count(deck%real_of('scene', 't_end'), series_interval(deck))
      call count_series(deck, samples, numbers, error)
      if (allocated(error)) return
      demand%remedy = demand%remedy//', a larger output.interval, fewer output.fields'
    end if
    if (deck%text_of(sweep_group, 'points') /= '') then
      call sweep_of_deck(deck, sweep, error)
      if (allocated(error)) return
      cases = real(sweep%cases, wp)
    else
      cases = grid_cases(deck)
    end if
    demand%remedy = demand%remedy//', or another disk'
    demand%bytes = 8.0_wp*cases*(real(value_count + 3, wp) + numbers)/real(share%count, wp)
    demand%what = number_text(cases)//' cases of '//number_text(real(value_count, wp) + numbers)//' numbers'
    call scene_from_deck(deck, scene)
    call scene_notes(deck, scene, notes, cases)
  end subroutine weigh_sweep

  !> Number of values in the series of a case.
  subroutine count_series(deck, samples, numbers, error)
    type(deck_t), intent(in) :: deck
    real(wp), intent(in) :: samples
    real(wp), intent(out) :: numbers
    type(error_t), allocatable, intent(out) :: error
    type(sweep_t) :: one
    integer :: columns

    one%deck = deck
    one%keeps_series = .true.
    columns = size(table_quantities(one))
    numbers = 0.0_wp
    if (samples < most_samples) numbers = samples*real(columns, wp)
    if (numbers > most_series_values .or. .not. samples < most_samples) call raise(error, deck_error, &
      'a case of a sweep keeps at most '//number_text(most_series_values)//' numbers, '// &
      number_text(aint(most_series_values/real(columns, wp)))//' samples of its '//integer_text(columns)// &
      ' columns: raise output.interval, or name fewer output.fields', &
      trim(merge('output.interval', 'sweep.keep     ', deck%is_set('output', 'interval'))))
  end subroutine count_series

  !> The grid or the list of points of a deck with &sweep.
  subroutine sweep_of_deck(deck, sweep, error)
    type(deck_t), intent(in) :: deck
    type(sweep_t), intent(out) :: sweep
    type(error_t), allocatable, intent(out) :: error
    type(axis_t), allocatable :: axes(:)   !! stays unallocated for a grid

    if (deck%text_of(sweep_group, 'points') /= '') call read_points(deck, axes, error)
    if (.not. allocated(error)) call new_sweep(deck, sweep, error, axes, .true.)
  end subroutine sweep_of_deck

  !> Whether the disk has room for the results whose size is known.
  subroutine check_room(output, demand, error)
    character(*), intent(in) :: output
    type(demand_t), intent(in) :: demand
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: folder
    real(wp) :: room

    if (.not. demand%bytes > 0.0_wp) return
    folder = folder_of(output)
    if (file_exists(output)) folder = folder_of(true_path(output))
    room = real(free_space(folder//nul), wp)
    if (demand%bytes <= room .or. room < 0.0_wp) return
    call raise(error, file_error, output//': cannot create: '//demand%what//' need '//bytes_text(demand%bytes)// &
      ', and the disk of '//folder//' has '//bytes_text(room)//': '//demand%remedy)
  end subroutine check_room

  !> Add the place in the deck, or the setting, of the value that causes an error.
  subroutine locate(deck, error)
    type(deck_t), intent(in) :: deck
    type(error_t), allocatable, intent(inout) :: error
    type(faults_t) :: faults

    if (error%code /= deck_error) return
    if (.not. allocated(error%key)) error%key = 'scene.model'
    call faults%add(deck%value(varied_key(error%key))%place, error%text)
    error%text = faults%report(deck%name)
  end subroutine locate
end module dst_deck_check
