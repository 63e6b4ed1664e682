!> Which build of the hot loops is used. They are compiled for every processor, and once more for x86-64-v3, with vectors of 256
!> bits (meson.build); both builds give the same bits.
module dst_instructions
  use dst_machine, only: environment
  use dst_posix, only: has_v3
  implicit none
  private

  public :: runs_v3

contains

  !> Whether to use the code compiled for x86-64-v3: if the processor supports it, unless DYNSTICTION_INSTRUCTIONS is 'plain'.
  logical function runs_v3()
    runs_v3 = has_v3()
    if (runs_v3) runs_v3 = environment('DYNSTICTION_INSTRUCTIONS') /= 'plain'
  end function runs_v3
end module dst_instructions
