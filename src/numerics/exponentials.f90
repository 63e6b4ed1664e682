!> The exponential function in plain arithmetic, for loops that become vector instructions: these include
!> `exponentials.inc` directly.
module dst_exponentials
  use dst_kinds, only: wp, real64, int64
  implicit none
  private

  public :: exponentials

contains

  include 'exponentials.inc'
end module dst_exponentials
