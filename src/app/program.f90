!> The executable: it makes its environment safe, carries out the command, and ends. Only here does the program end.
program dynstiction
  use, intrinsic :: iso_c_binding, only: c_int
  use dst_errors, only: exit_status, out_of_memory
  use dst_main, only: program_t, status
  use dst_posix, only: c_exit
  use dst_standard_streams, only: occupy_descriptors, put_error
  use dst_threads, only: run_with_room
  implicit none

  type(program_t) :: whole
  logical :: done

  call occupy_descriptors()
  call run_with_room(whole, done)
  if (.not. done) call put_error('dynstiction: no memory for a stack: raise ulimit -s to 1024 or more'//new_line('a'))
  ! STOP would print its code.
  call c_exit(int(merge(status, exit_status(out_of_memory), done), c_int))
end program dynstiction
