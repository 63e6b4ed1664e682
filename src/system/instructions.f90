!> Which build of the hot loops runs. They are compiled for every processor, and once more for x86-64-v3, with vectors of 256 bits
!> (meson.build); both give the same bits.
module dst_instructions
  use dst_machine, only: environment
  use dst_posix, only: has_v3
  implicit none
  private

  public :: runs_v3

contains

  !> Whether to run what is compiled for x86-64-v3: where the processor can, unless DYNSTICTION_INSTRUCTIONS is 'plain'.
  logical function runs_v3()
    runs_v3 = has_v3()
    if (runs_v3) runs_v3 = environment('DYNSTICTION_INSTRUCTIONS') /= 'plain'
  end function runs_v3
end module dst_instructions
