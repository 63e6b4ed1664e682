!> How many pieces of work a second rank 0 of a sweep can deal out: mpirun -n 3 bench_dealer [CASES A PIECE [PIECES]]
!>
!> The other ranks do nothing but ask; rank 0 does nothing but answer. Prints pieces a second, of wall time and of rank 0's
!> processor time, of which a part is spent in looking for messages.
program bench_dealer
  use, intrinsic :: iso_fortran_env, only: output_unit
  use dst_dealer, only: dealer_t
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_processes, only: processes_t
  use dst_stopwatch, only: wall_clock
  implicit none

  type(processes_t) :: processes
  type(dealer_t) :: dealer
  type(error_t), allocatable :: error
  integer, allocatable :: pending(:)
  integer :: pieces, size_of_piece, i, status, taken, stop
  real(wp) :: begun, begun_processor, ended_processor, passed
  character(32) :: argument

  size_of_piece = 64
  call get_command_argument(1, argument, status=status)
  if (status == 0) read (argument, *) size_of_piece
  pieces = 200000
  call get_command_argument(2, argument, status=status)
  if (status == 0) read (argument, *) pieces
  call processes%start(error)
  if (processes%rank == 0) then
    allocate (pending(pieces*size_of_piece))
    do i = 1, size(pending)
      pending(i) = i
    end do
  end if
  begun = wall_clock()
  call cpu_time(begun_processor)
  call dealer%open(processes, 1, pending)
  taken = 0
  stop = 0
  do while (.not. merge(dealer%others_are_done(), dealer%none_left, processes%rank == 0))
    call dealer%deal(merge(0, size_of_piece, processes%rank == 0), taken, 0, 0.0_wp, stop)
    do while (dealer%take() > 0)
      taken = taken + 1
    end do
  end do
  call dealer%close(taken, 0, stop)
  passed = wall_clock() - begun
  call cpu_time(ended_processor)
  if (processes%rank == 0) write (output_unit, '(a, i0, a, 2(es9.2, a))') 'pieces of ', size_of_piece, ' cases: ', &
    pieces/passed, ' a second, ', pieces/(ended_processor - begun_processor), ' a second of processor time of rank 0'
  call processes%end()
end program bench_dealer
