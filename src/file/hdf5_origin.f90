!> Reads from a result file which run wrote it, and whether that run can be resumed.
module dst_hdf5_origin
  use dst_ending, only: check_ending, has_ending
  use dst_errors, only: error_t, raise, file_error
  use dst_hdf5_tools, only: hid_t, hsize_t, hdf5_t, open_file, close_file, damage_reason, get_value, has_column, &
    open_dataset, read_rows, dataset_t
  use dst_kinds, only: wp, real64
  use dst_plain_numbers, only: number_text
  use dst_summary, only: summary_quantities
  use dst_text, only: integer_text, printable, has_word, word, word_count
  use dst_text_file, only: hdf5_signature, read_text
  implicit none
  private

  public :: origin_t, read_origin, check_is_result, is_hdf5, is_deck, describe_result

  !> The description of the run in the header of a result file.
  type :: origin_t
    character(:), allocatable :: version, created, deck_text, deck_resolved
    integer :: complete = 0
    integer :: result_code = -1
    character(:), allocatable :: result_text
  end type origin_t

  !> The value of the attribute `program` of a result.
  character(*), parameter :: this_program = 'dynstiction'

contains

  !> Whether a file is a result of this program: one that has its ending, or names the program.
  subroutine check_is_result(file_name, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: reason   !! unallocated if it is
    character(*), parameter :: remedy = ': use another name or remove it'
    character(:), allocatable :: program
    type(hdf5_t) :: h5
    integer(hid_t) :: file

    if (.not. is_hdf5(file_name)) then
      reason = 'the file exists and is not an HDF5 file'//remedy
      return
    end if
    if (has_ending(file_name)) return
    call open_file(file_name, .false., file, h5)
    call get_value(file, 'program', program, h5)
    if (h5%status < 0 .or. program /= this_program) reason = 'the file exists and is no result of this program'//remedy
    call close_file(file, h5)
  end subroutine check_is_result

  !> Whether a file begins as HDF5 files do.
  logical function is_hdf5(file_name)
    character(*), intent(in) :: file_name
    character(:), allocatable :: text, ignored

    call read_text(file_name, len(hdf5_signature), text, ignored)
    is_hdf5 = text == hdf5_signature
  end function is_hdf5

  !> Whether a file looks like a deck: it is text with a group, which no HDF5 file is.
  logical function is_deck(file_name)
    character(*), intent(in) :: file_name
    integer, parameter :: enough = 4096
    character(:), allocatable :: text, ignored

    call read_text(file_name, enough, text, ignored)
    is_deck = index(text, '&') > 0 .and. index(text, achar(0)) == 0
  end function is_deck

  !> A result file in one line, and its results in some more.
  subroutine describe_result(file_name, text, reason)
    character(*), intent(in) :: file_name
    character(:), allocatable, intent(out) :: text
    character(:), allocatable, intent(out) :: reason   !! unallocated on success

    text = ''
    if (is_hdf5(file_name)) then
      call check_ending(file_name, reason)
      if (allocated(reason)) return
      text = description(file_name)
    end if
    if (text /= '') return
    reason = 'it is no result of this program, or damaged: give a result file'
    if (is_deck(file_name)) reason = 'it is a deck, not a result: dynstiction run '//printable(file_name)//' makes one'
  end subroutine describe_result

  function description(file_name) result(text)
    character(*), intent(in) :: file_name
    character(:), allocatable :: text, program, model, method, created, version, revision, ending
    integer(hid_t) :: file
    type(hdf5_t) :: h5
    integer :: complete
    logical :: is_sweep

    call open_file(file_name, .false., file, h5)
    call get_value(file, 'program', program, h5)
    call get_value(file, 'model', model, h5)
    call get_value(file, 'method', method, h5)
    call get_value(file, 'created', created, h5)
    call get_value(file, 'version', version, h5)
    call get_value(file, 'git_revision', revision, h5)
    call get_value(file, 'complete', complete, h5)
    call get_value(file, 'result_text', ending, h5)
    text = ''
    if (h5%status < 0 .or. program /= this_program) then
      call close_file(file, h5)
      return
    end if
    text = 'run'
    is_sweep = has_column(file, 'sweep/result_code')
    if (is_sweep) then
      text = 'sweep'
      if (has_column(file, 'sweep/series/time')) text = 'sweep with series'
      if (has_column(file, 'sweep/cycles/cycle')) text = 'sweep with cycles'
    end if
    text = printable(text//' of model '//model//', method '//method//', '//created//', dynstiction '//version//' ('// &
      revision//'): '//trim(merge('complete    ', 'not complete', complete == 1))//', '//ending)
    if (is_sweep) then
      text = text//rows_of_sweep(file)
    else
      text = text//rows_of_run(file)
    end if
    call close_file(file, h5)
  end function description

  !> The length of a run, and its summary.
  function rows_of_run(file) result(text)
    integer(hid_t), intent(in) :: file
    character(:), allocatable :: text
    type(hdf5_t) :: h5
    type(dataset_t) :: time
    real(real64) :: last(1)
    real(wp) :: value
    integer :: i

    text = ''
    call open_dataset(file, 'time_series/time', time, h5)
    if (h5%status < 0) return
    text = row('samples', integer_text(int(time%rows)), '')
    if (time%rows > 0) then
      call read_rows(time, time%rows - 1, 1_hsize_t, last, h5)
      text = text//row('last sample', number_text(real(last(1), wp), 4)//' s', '')
    end if
    do i = 1, size(summary_quantities)
      associate (quantity => summary_quantities(i))
        ! What has no value is not in the file.
        h5 = hdf5_t()
        call get_value(file, 'summary/'//trim(quantity%name), value, h5)
        if (h5%status >= 0) text = text//row(quantity%name, with_unit(number_text(value, 4), quantity%units), quantity%long_name)
      end associate
    end do
  end function rows_of_run

  !> The parameters of a sweep, and the ranges of its results.
  function rows_of_sweep(file) result(text)
    integer(hid_t), intent(in) :: file
    character(:), allocatable :: text
    character(:), allocatable :: parameters
    type(hdf5_t) :: h5
    type(dataset_t) :: codes
    integer :: i

    text = ''
    call open_dataset(file, 'sweep/result_code', codes, h5)
    ! Reading the values of more cases would take too long.
    if (h5%status < 0 .or. codes%rows > 1000000) return
    text = row('cases', integer_text(int(codes%rows)), '')
    call get_value(file, 'sweep/parameters', parameters, h5)
    do i = 1, word_count(parameters)
      text = text//range_of('sweep/'//word(parameters, i), word(parameters, i), '', 'varied')
    end do
    do i = 1, size(summary_quantities)
      associate (quantity => summary_quantities(i))
        if (has_word('cycles period peak_force valley_force slip_length swing', trim(quantity%name))) &
          text = text//range_of('sweep/summary/'//trim(quantity%name), quantity%name, quantity%units, quantity%long_name)
      end associate
    end do

  contains

    function range_of(path, name, units, meaning) result(line)
      character(*), intent(in) :: path, name, units, meaning
      character(:), allocatable :: line
      type(dataset_t) :: column
      real(real64), allocatable :: values(:)

      line = ''
      allocate (values(codes%rows))
      h5 = hdf5_t()
      call open_dataset(file, path, column, h5)
      call read_rows(column, 0_hsize_t, codes%rows, values, h5)
      if (h5%status < 0 .or. .not. any(abs(values) <= huge(values))) return
      line = row(name, with_unit(number_text(real(minval(values, abs(values) <= huge(values)), wp), 4)//' to '// &
        number_text(real(maxval(values, abs(values) <= huge(values)), wp), 4), units), meaning)
    end function range_of
  end function rows_of_sweep

  !> A line that is indented: name, value, meaning.
  pure function row(name, value, meaning) result(line)
    character(*), intent(in) :: name, value, meaning
    character(:), allocatable :: line
    character(24) :: first
    character(26) :: second

    first = name
    second = value
    line = new_line('a')//trim('  '//first//second//meaning)
    if (len_trim(value) > len(second)) line = new_line('a')//trim('  '//first//value//' '//meaning)
  end function row

  !> A number and its unit, if it has one.
  pure function with_unit(number, units) result(text)
    character(*), intent(in) :: number, units
    character(:), allocatable :: text

    text = number
    if (units /= '' .and. units /= '1') text = text//' '//trim(units)
  end function with_unit

  !> Read the header of the result of a run that shall be resumed, an HDF5 file that is as it was when it was written.
  subroutine read_origin(file_name, shown_name, origin, error)
    character(*), intent(in) :: file_name, shown_name
    type(origin_t), intent(out) :: origin
    type(error_t), allocatable, intent(out) :: error
    type(hdf5_t) :: h5
    integer(hid_t) :: file

    call open_file(file_name, .false., file, h5)
    call get_value(file, 'complete', origin%complete, h5)
    call get_value(file, 'result_code', origin%result_code, h5)
    call get_value(file, 'result_text', origin%result_text, h5)
    call get_value(file, 'created', origin%created, h5)
    call get_value(file, 'version', origin%version, h5)
    call get_value(file, 'deck/text', origin%deck_text, h5)
    call get_value(file, 'deck/resolved', origin%deck_resolved, h5)
    if (h5%status < 0) call raise(error, file_error, shown_name//': cannot resume: '//damage_reason())
    call close_file(file, h5)
  end subroutine read_origin
end module dst_hdf5_origin
