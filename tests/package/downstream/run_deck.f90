!> Reads a deck, runs it in memory, and prints the last elongation along the soft axis [m].
!> An example of a program that uses the library:
!>
!>     gfortran run_deck.f90 $(pkg-config --cflags --libs dynstiction)
program run_deck
  use dst_deck, only: deck_t, read_deck
  use dst_errors, only: error_t
  use dst_kinds, only: wp
  use dst_writer, only: writer_t
  use dst_columns, only: columns, find_column
  use dst_scene, only: scene_t, scene_from_deck
  use dst_simulation, only: simulation_t
  implicit none

  type(deck_t) :: deck
  type(scene_t) :: scene
  type(simulation_t) :: simulation
  type(writer_t) :: writer
  type(error_t), allocatable :: error
  character(256) :: name
  integer :: row

  call get_command_argument(1, name)
  call read_deck(trim(name), [character(24) :: 'output.fields=u_x', 'scene.t_end=2.5'], deck, error)
  call stop_on(error)
  call scene_from_deck(deck, scene)
  call simulation%start(scene, error)
  call stop_on(error)
  do while (.not. simulation%finished)
    call simulation%proceed(1.0_wp, writer, error)
    call stop_on(error)
  end do
  row = findloc(simulation%selected, find_column('u_x'), dim=1)
  print '(a, es24.16, 1x, a)', 'u_x =', writer%samples(row, writer%rows), trim(columns(find_column('u_x'))%units)

contains

  subroutine stop_on(error)
    type(error_t), allocatable, intent(in) :: error

    if (.not. allocated(error)) return
    print '(a)', error%text
    error stop 1
  end subroutine stop_on
end program run_deck
