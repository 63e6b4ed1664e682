#!/usr/bin/env bash
# tests/slurm/cluster.sh COMMAND...: starts a Slurm of one node in a temporary folder, runs COMMAND in it and ends with its status.
# COMMAND finds SLURM_CONF set and SLURM_TEST_FOLDER, where the logs of the daemons are; jobs that it leaves are cancelled. The node
# claims 16 cores, whatever the machine has. Where Slurm cannot be started, a line says why, and the status is 77.
# Needs root and the Debian packages slurm-wlm and munge; nothing of a Slurm that is installed is touched.
set -uo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  awk 'NR > 1 { if (!/^#/) exit; sub(/^# ?/, ""); print }' "$0"
  exit 0
fi

work=$(mktemp -d /tmp/slurm-test.XXXXXX)
pids=()

skip() { printf 'Slurm: skipped: %s\n' "$*"; exit 77; }

end() {
  local pid
  if [[ ${SLURM_CONF:-} == "$work/slurm.conf" ]]; then
    scancel --user=root > /dev/null 2>&1
    wait_for 8 no_jobs || { scancel --signal=KILL --user=root; sleep 1; } > /dev/null 2>&1
  fi
  for pid in "${pids[@]}"; do kill "$pid" 2> /dev/null; done
  for pid in "${pids[@]}"; do
    for _ in {1..50}; do kill -0 "$pid" 2> /dev/null || break; sleep 0.1; done
    kill -9 "$pid" 2> /dev/null
  done
  rm -rf "$work"
}
trap end EXIT
trap 'exit 143' TERM
trap 'exit 130' INT

# wait_for SECONDS COMMAND...: until the command succeeds.
wait_for() {
  local until=$((SECONDS + $1))
  shift
  until "$@" > /dev/null 2>&1; do
    ((SECONDS < until)) || return 1
    sleep 0.2
  done
}

idle_node() { sinfo --noheader --format=%T | grep -q '^idle$'; }
no_jobs() { [[ -z $(squeue --noheader) ]]; }

start_munge() {
  dd if=/dev/urandom of="$work/munge.key" bs=128 count=1 2> /dev/null
  chmod 400 "$work/munge.key"
  mkdir -m 755 "$work/munge"
  munged --foreground --force --key-file="$work/munge.key" --socket="$work/munge/socket" --pid-file="$work/munge/pid" \
    --seed-file="$work/munge/seed" --log-file="$work/munge.log" > "$work/munged.log" 2>&1 &
  pids+=($!)
  wait_for 10 munge --socket="$work/munge/socket" --no-input || skip "munged does not start: $(tail -n 1 "$work"/munge*.log)"
}

# Jobs requeued start as soon as their credential has expired; the controller looks at limits every few seconds, and knows of
# jobs that have ended as long as the tests may take.
write_configuration() {
  local host ports
  host=$(hostname -s)
  ports=$(python3 -c 'import socket; a, b = socket.socket(), socket.socket(); a.bind(("", 0)); b.bind(("", 0)); print(a.getsockname()[1], b.getsockname()[1])')
  cat > "$work/slurm.conf" << END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=${ports% *}
SlurmdPort=${ports#* }
SlurmUser=root
SlurmdUser=root
SlurmdParameters=config_overrides
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
MinJobAge=3600
OverTimeLimit=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=16 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
  mkdir -p "$work/state" "$work/spool"
  export SLURM_CONF=$work/slurm.conf SLURM_TEST_FOLDER=$work
}

start_slurm() {
  slurmctld -D -f "$work/slurm.conf" > "$work/slurmctld.out.log" 2>&1 &
  pids+=($!)
  slurmd -D -f "$work/slurm.conf" > "$work/slurmd.out.log" 2>&1 &
  pids+=($!)
  wait_for 20 idle_node || skip "no node gets ready: $(tail -n 1 "$work/slurmctld.log" "$work/slurmd.log" 2> /dev/null | tr '\n' ' ')"
}

(($#)) || { printf 'tests/slurm/cluster.sh COMMAND...\n' >&2; exit 1; }
for program in slurmctld slurmd sbatch srun munged python3; do
  command -v "$program" > /dev/null || skip "$program is not installed (Debian packages slurm-wlm, munge)"
done
((EUID == 0)) || skip "slurmd needs root"

start_munge
write_configuration
start_slurm
"$@"
