!> The lanes of dst_lane_step for processors with 256-bit vectors.
submodule(dst_lane_step) dst_lane_step_v3
  implicit none

contains

  module procedure step_lanes_v3
    call step_lanes(lanes, attempts)
  end procedure step_lanes_v3

  include 'lane_step.inc'
end submodule dst_lane_step_v3
