!> The lanes of dst_lane_step for every processor.
submodule(dst_lane_step) dst_lane_step_plain
  implicit none

contains

  module procedure step_lanes_plain
    call step_lanes(lanes, attempts)
  end procedure step_lanes_plain

  include 'lane_step.inc'
end submodule dst_lane_step_plain
