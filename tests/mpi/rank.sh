#!/bin/sh
# rank.sh ROOM COMMAND...: what mpirun starts for each rank (see faults.py). ROOM/rank.N, which is read first, may keep rank N
# from beginning, make it late, or say where and with which faults of the system (shim.c) it runs.
room=$1
shift
rank=${OMPI_COMM_WORLD_RANK:-${PMI_RANK:-0}}
export FAULT_DIR="$room/work" FAULT_LOG="$room/log.$rank" FAULT_GATE="$room/gate" FAULT_STATUS="$room/status.$rank"
if [ -e "$room/rank.$rank" ]; then . "$room/rank.$rank"; fi
exec env LD_PRELOAD="$FAULT_SHIM" "$@"
