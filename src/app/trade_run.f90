!> Compare on a deck's scene into a file: what `dynstiction trade` does.
!>
!> The file is like that of a run, its summary and statistics those of the reference; the group /trade has one row a point in place
!> of the time series.
module dst_trade_run
  use dst_kinds, only: wp
  use dst_deck, only: deck_t
  use dst_errors, only: error_t, raise, stopped_early
  use dst_hdf5_writer, only: hdf5_writer_t, run_metadata_t, create_hdf5
  use dst_progress, only: progress_t, new_progress
  use dst_run, only: describe_run
  use dst_result_file, only: result_file_t
  use dst_scene, only: scene_t, scene_from_deck
  use dst_signals, only: stop_signal, stopped_by, no_signal
  use dst_trade, only: trade_t, start_trade
  use dst_trade_table, only: table_of
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: trade_deck

  !> Wall time between two looks at the progress [s].
  real(wp), parameter :: slice = 0.1_wp

contains

  !> Compare within `budget` seconds of wall time and write `output_file`; when stopped by a signal, with what was measured by then.
  subroutine trade_deck(deck, output_file, overwrite, quiet, budget, trade, error)
    type(deck_t), intent(in) :: deck
    character(*), intent(in) :: output_file
    logical, intent(in) :: overwrite, quiet
    real(wp), intent(in) :: budget
    type(trade_t), intent(out) :: trade
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: scene
    type(run_metadata_t) :: metadata
    type(result_file_t) :: file
    type(hdf5_writer_t) :: writer
    character(:), allocatable :: checksum
    type(quantity_t) :: no_series(0)
    type(outcome_t) :: outcome
    type(error_t), allocatable :: end_error

    call scene_from_deck(deck, scene)
    call start_trade(scene, budget, trade, error)
    if (allocated(error)) return
    call describe_run(deck, trade%scene%model, trim(trade%best%candidate%method), '', metadata)
    call file%claim(output_file, overwrite, error)
    if (allocated(error)) return
    call create_hdf5(writer, file%path(), output_file, metadata, no_series, error)
    call file%adopt()
    if (.not. allocated(error)) call file%put_in_place(error)
    if (allocated(error)) then
      call writer%discard()
      call file%abandon()
      return
    end if
    call compare(trade, new_progress(deck%name, quiet), error)
    outcome = trade%best_outcome
    if (allocated(error)) then
      outcome%result_code = error%code
      outcome%result_text = error%text
    end if
    if (trade%has_reference()) call writer%write_table('trade', table_of(trade), end_error)
    if (.not. allocated(end_error)) call writer%finish(outcome, end_error)
    if (.not. allocated(end_error)) call file%seal(checksum, end_error)
    call file%release()
    if (allocated(end_error) .and. .not. allocated(error)) call move_alloc(end_error, error)
  end subroutine trade_deck

  subroutine compare(trade, progress_line, error)
    type(trade_t), intent(inout) :: trade
    type(progress_t), intent(in) :: progress_line
    type(error_t), allocatable, intent(out) :: error
    type(progress_t) :: progress
    real(wp) :: elapsed

    progress = progress_line
    do while (.not. (trade%finished .or. allocated(error)))
      call trade%proceed(slice, error)
      elapsed = min(trade%elapsed(), trade%budget)
      if (stop_signal() /= no_signal .and. .not. (trade%finished .or. allocated(error))) &
        call raise(error, stopped_early, stopped_by()//': the file holds what was measured until then')
      call progress%show('wall time', elapsed, trade%budget, elapsed)
    end do
    call progress%close()
  end subroutine compare
end module dst_trade_run
