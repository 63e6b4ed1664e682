#!/usr/bin/env bash
# tests/slurm/run.sh EXE [MPI_EXE MPI_TYPE]: starts a Slurm of one node in a temporary folder, submits jobs/slurm_array.sbatch and,
# with a build for MPI, jobs/slurm_mpi.sbatch as they are, lets the signal before the time limit stop and requeue them, and compares
# the merged results with that of one process. EXE is the program; MPI_EXE one built with MPI, of the type that srun knows
# (pmix for Open MPI, pmi2 for MPICH). Where Slurm cannot be started it is skipped, with a line that says why.
# Needs root, Debian packages slurm-wlm and munge, and python with h5py. Takes two to three minutes.
set -uo pipefail

checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
exe=$(realpath "${1:?program}") mpi_exe=${2:+$(realpath "$2")} mpi_type=${3:-pmix}
work=$(mktemp -d /tmp/slurm-test.XXXXXX)
pids=()
failed=0

skip() { printf 'Slurm: skipped: %s\n' "$*"; exit 0; }
fail() { printf 'Slurm: FAILED: %s\n' "$*"; failed=1; }
say() { printf 'Slurm: %s s: %s\n' "$SECONDS" "$*"; }

end() {
  local pid
  if [[ -e $work/slurm.conf ]]; then scancel --user=root > /dev/null 2>&1; sleep 1; fi
  for pid in "${pids[@]}"; do kill "$pid" 2> /dev/null; done
  for pid in "${pids[@]}"; do
    for _ in {1..50}; do kill -0 "$pid" 2> /dev/null || break; sleep 0.1; done
    kill -9 "$pid" 2> /dev/null
  done
  if ((failed)); then tail -n 40 "$work"/*.log "$work"/*.out 2> /dev/null; fi
  rm -rf "$work"
}
trap end EXIT

# wait_for SECONDS COMMAND...: until the command succeeds.
wait_for() {
  local until=$((SECONDS + $1))
  shift
  until "$@" > /dev/null 2>&1; do
    ((SECONDS < until)) || return 1
    sleep 0.2
  done
}

start_munge() {
  dd if=/dev/urandom of="$work/munge.key" bs=128 count=1 2> /dev/null
  chmod 400 "$work/munge.key"
  mkdir -m 755 "$work/munge"
  munged --foreground --force --key-file="$work/munge.key" --socket="$work/munge/socket" --pid-file="$work/munge/pid" \
    --seed-file="$work/munge/seed" --log-file="$work/munge.log" > "$work/munged.log" 2>&1 &
  pids+=($!)
  wait_for 10 munge --socket="$work/munge/socket" --no-input || skip "munged does not start: $(tail -n 1 "$work"/munge*.log)"
}

# Jobs requeued start as soon as their credential has expired; the controller looks at limits every few seconds.
write_configuration() {
  local host cores port
  host=$(hostname -s)
  cores=$(nproc)
  port=$(python3 -c 'import socket; a, b = socket.socket(), socket.socket(); a.bind(("", 0)); b.bind(("", 0)); print(a.getsockname()[1], b.getsockname()[1])')
  cat > "$work/slurm.conf" << END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=${port% *}
SlurmdPort=${port#* }
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket,cred_expire=5
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=2,bf_interval=2
SwitchType=switch/none
ReturnToService=2
MpiDefault=none
KillWait=5
OverTimeLimit=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
  mkdir -p "$work/state" "$work/spool"
  export SLURM_CONF=$work/slurm.conf
}

start_slurm() {
  slurmctld -D -f "$work/slurm.conf" > "$work/slurmctld.out.log" 2>&1 &
  pids+=($!)
  slurmd -D -f "$work/slurm.conf" > "$work/slurmd.out.log" 2>&1 &
  pids+=($!)
  wait_for 20 idle_node || skip "no node gets ready: $(tail -n 1 "$work/slurmctld.log" "$work/slurmd.log" 2> /dev/null | tr '\n' ' ')"
}

idle_node() { sinfo --noheader --format=%T | grep -q '^idle$'; }
no_jobs() { [[ -z $(squeue --noheader) ]]; }

# write_deck NAME SECONDS: a sweep of 60 cases that take so long on one core. Their length is measured: faster machines and later
# versions must not be done before the signal comes.
write_deck() {
  local length begun
  length=3000
  { cat "$checkout/inputs/low_frequency.nml"; cat << 'END'; } > "$work/$1.nml"
&sweep
  parameter = 'system.misalignment_deg', 'drive.velocity'
  first = 1.0, 1.0e-3
  last = 8.0, 4.0e-3
  count = 12, 5
  spacing = 'linear', 'log'
/
END
  begun=$(date +%s%N)
  "$exe" run "$work/$1.nml" -o "$work/trial.h5" --quiet --overwrite --set scene.t_end=$length --shard 1/15
  length=$((length * $2 * 1000000000 / ((($(date +%s%N) - begun) * 15 * $(nproc)) + 1)))
  rm -f "$work"/trial.h5*
  sed -i "s/t_end = 10.0 /t_end = $length.0 /" "$work/$1.nml"
  "$exe" run "$work/$1.nml" -o "$work/$1_serial.h5" --quiet || fail "the run of one process failed"
}

# compare NAME: the result of a job with that of one process, all but wall times.
compare() {
  python3 - "$work/$1_serial.h5" "$work/$1.h5" << 'END'
import sys
import h5py

def values(path):
    found = {}
    with h5py.File(path) as file:
        assert file.attrs["complete"] == 1
        file["sweep"].visititems(
            lambda name, item: found.update({name: item[()].tobytes()})
            if isinstance(item, h5py.Dataset) and name not in ("wall_time", "failures/result_text") else None)
    return found

sys.exit(values(sys.argv[1]) != values(sys.argv[2]))
END
}

for program in slurmctld slurmd sbatch srun munged; do
  command -v "$program" > /dev/null || skip "$program is not installed (Debian packages slurm-wlm, munge)"
done
((EUID == 0)) || skip "slurmd needs root"
python3 -c 'import h5py' 2> /dev/null || skip "python3 has no h5py"

start_munge
write_configuration
start_slurm
say "a node is ready"
export DYNSTICTION=$exe

# The limit is a minute; Slurm sends the signal at its next look at limits, at most half a minute after the start.
write_deck array 70
say "the run of one process is done"
sbatch --array=1-2 --cpus-per-task=1 --time=1 --signal=USR1@60 --output="$work/array-%a.out" \
  "$checkout/jobs/slurm_array.sbatch" "$work/array.nml" "$work/array.h5" || fail "sbatch of the array"
wait_for 300 no_jobs || fail "the array does not end"
stops=$(cat "$work"/array-*.out | grep -c 'stopped by SIGUSR1')
((stops > 0)) || fail "no task was stopped by the signal before the limit"
"$exe" merge "$work/array.nml" -o "$work/array.h5" || fail "merge: status $?"
if compare array; then say "array of 2 tasks, stopped and requeued $stops times: same as one process"; else fail "array: other numbers"; fi

if [[ -z $mpi_exe ]]; then
  printf 'Slurm: skipped jobs/slurm_mpi.sbatch: no program with MPI given\n'
elif ! srun --mpi=list 2>&1 | grep -q "$mpi_type"; then
  printf 'Slurm: skipped jobs/slurm_mpi.sbatch: this srun does not know %s\n' "$mpi_type"
elif (($(nproc) < 2)); then
  printf 'Slurm: skipped jobs/slurm_mpi.sbatch: one core only\n'
else
  # Here the signal is sent by hand, as soon as there are some cases.
  write_deck mpi 20
  say "the run of one process is done"
  export DYNSTICTION=$mpi_exe SLURM_MPI_TYPE=$mpi_type
  job=$(sbatch --parsable --nodes=1 --ntasks-per-node=2 --cpus-per-task=1 --time=10 --output="$work/mpi.out" \
    "$checkout/jobs/slurm_mpi.sbatch" "$work/mpi.nml" "$work/mpi.h5") || fail "sbatch of the MPI job"
  some_cases() { (($(stat -c %s "$work/mpi.h5.shard-000001") > 1000)); }
  wait_for 60 some_cases || fail "rank 1 finishes no case"
  scancel --signal=USR1 "$job"
  wait_for 200 no_jobs || fail "the MPI job does not end"
  stops=$(grep -c 'stopped by SIGUSR1' "$work/mpi.out")
  ((stops > 0)) || fail "the MPI job was not stopped by the signal"
  if compare mpi; then say "2 ranks, stopped and requeued $stops times: same as one process"; else fail "MPI: other numbers"; fi
fi
((failed)) || say "passed"
exit $failed
