!> The executable: it makes its environment safe, carries out the command, and ends. Only here does the program end.
program dynstiction
  use, intrinsic :: iso_c_binding, only: c_funloc, c_int
  use dst_errors, only: exit_status, out_of_memory
  use dst_main, only: follow_arguments, status
  use dst_posix, only: c_exit, occupy_descriptors, put_error, run_with_room
  implicit none

  logical :: done

  call occupy_descriptors()
  done = run_with_room(c_funloc(follow_arguments))
  if (.not. done) call put_error('dynstiction: no memory for a stack: raise ulimit -s to 1024 or more'//new_line('a'))
  ! STOP would print its code.
  call c_exit(int(merge(status, exit_status(out_of_memory), done), c_int))
end program dynstiction
