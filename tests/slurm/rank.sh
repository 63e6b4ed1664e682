#!/usr/bin/env bash
# tests/slurm/rank.sh PROGRAM ARGUMENT...: starts the program as a rank of a step, whose process id is then in the file pid.RANK. Ranks
# named in FAULT_RANKS do the line of bash FAULT before.
printf '%s\n' $$ > "pid.$SLURM_PROCID"
for rank in ${FAULT_RANKS:-}; do
  if ((rank == SLURM_PROCID)); then eval "${FAULT?}"; fi
done
exec "$@"
