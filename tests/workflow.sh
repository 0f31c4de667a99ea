#!/usr/bin/env bash
# workflow/Snakefile for real: a batch of 20 jobs and a split reconstruction, and every byte as plain runs make it.
#
#   bash tests/workflow.sh         on a one-node Slurm that it starts and stops, with a worker of each killed on its way (as root)
#   bash tests/workflow.sh local   by Snakemake on this machine alone
#
# Installs what is missing (Debian: Slurm, munge; Snakemake from tests/workflow.txt into target/workflow). Tests the program that INTERSLICE
# names, or builds it.
set -euo pipefail
cd "$(dirname "$0")/.."
repository="$PWD"
how="${1:-slurm}"
fail() { echo "workflow: $*" >&2; exit 1; }
say() { echo "$(date +%T) $*"; }
[ "$how" = slurm ] || [ "$how" = local ] || fail "expected slurm or local; got $how"

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
install() { as_root apt-get update -q && as_root apt-get install -o DPkg::Lock::Timeout=300 -qy --no-install-recommends "$@"; }
if [ "$how" = slurm ]; then
  [ "$(id -u)" = 0 ] || fail "Slurm's daemons need root here; nothing was tested (\`local\` needs none)"
  for command in slurmctld slurmd munged squeue; do
    command -v "$command" >/dev/null || { DEBIAN_FRONTEND=noninteractive install slurmctld slurmd slurm-client munge && break; }
  done
fi
python3 -c 'import ensurepip, venv' 2>/dev/null || install python3 python3-venv
if [ ! -x target/workflow/bin/snakemake ]; then
  python3 -m venv target/workflow
  target/workflow/bin/pip install --quiet --disable-pip-version-check -r tests/workflow.txt
fi
[ -n "${INTERSLICE:-}" ] || cargo build --locked --release
program="$(realpath "${INTERSLICE:-target/release/interslice}")"
snakemake="$repository/target/workflow/bin/snakemake"

place="$(mktemp -d)"
daemons=()
clean_up() {
  local pid
  [ -z "${SLURM_CONF:-}" ] || scancel --user=root --signal=KILL 2>/dev/null || true
  for pid in ${workflow:-} "${daemons[@]}"; do kill "$pid" 2>/dev/null || true; done
  for pid in ${workflow:-} "${daemons[@]}"; do wait "$pid" 2>/dev/null || true; done
  rm -rf "$place"
}
trap clean_up EXIT
mkdir "$place/given" "$place/plain"

# Tubes that wander: 20 small ones, and one of 60 slices.
target/workflow/bin/python - "$place/given" <<'PYTHON'
import json, sys
from pathlib import Path
import numpy

place = Path(sys.argv[1])


def tube(path, size, slices, radius):
    y, x = numpy.mgrid[:size, :size]
    z = numpy.arange(slices)
    middle = size / 2 + size / 6 * numpy.array([numpy.sin(0.4 * z), numpy.cos(0.3 * z)])
    inside = [numpy.hypot(x - a, y - b) < radius * (1 + 0.3 * numpy.sin(0.5 * k)) for k, (a, b) in enumerate(middle.T)]
    head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {size} {size} {slices}\nspacings: 1 1 4\nencoding: raw\n\n"
    path.write_bytes(head.encode() + numpy.array(inside, dtype="uint8").tobytes())


names = [f"tube{k:02}" for k in range(20)]
for k, name in enumerate(names):
    tube(place / f"{name}.nrrd", 80, 10, 10 + k / 2)
tube(place / "long.nrrd", 120, 60, 24)
job = lambda name: {"id": name, "input": f"{name}.nrrd", "outputs": [f"out/{name}.nrrd", f"out/{name}.stl"]}
(place / "manifest.jsonl").write_text("".join(json.dumps(job(name)) + "\n" for name in names))
PYTHON
bodies="$(cd "$place/given" && basename -s .nrrd tube*.nrrd)"

cat >"$place/given/config.yaml" <<YAML
interslice: $program
options: "--backend cpu"
batch: {manifest: manifest.jsonl, processes: 2}
split:
  long:
    input: long.nrrd
    outputs: [out/long.nrrd, out/long.stl, out/long.png, out/long.json]
    options: "--end-top extrapolate"
    parts: 3
folder: parts
threads: 1
mem_mb: 1500
resources: {runtime: 60}
YAML

say "plain runs"
for body in $bodies; do
  "$program" reconstruct "$place/given/$body.nrrd" -o "$place/plain/$body.nrrd" -o "$place/plain/$body.stl" --backend cpu --quiet
done
"$program" reconstruct "$place/given/long.nrrd" --end-top extrapolate --backend cpu --quiet \
  -o "$place/plain/long.nrrd" -o "$place/plain/long.stl" -o "$place/plain/long.png" -o "$place/plain/long.json"

cd "$place/given"
run_workflow() { "$snakemake" -s "$repository/workflow/Snakefile" --configfile config.yaml --retries 2 "$@" >>"$place/snakemake.log" 2>&1; }
done_lines() { cat results.jsonl 2>/dev/null | grep -c "\"status\":\"done\"" || true; }
show_and_fail() { find "$place" -name "*.log" -exec tail -n 60 {} + >&2; fail "$*"; }
# Waits for a command to succeed while the workflow runs, at most 10 minutes.
wait_for() {
  local k
  for k in $(seq 6000); do
    if "$@" >/dev/null; then return; fi
    kill -0 "$workflow" 2>/dev/null || show_and_fail "the workflow ended before: $*"
    sleep 0.1
  done
  show_and_fail "10 minutes without: $*"
}
# The process of the program that runs this subcommand in our folder, the first if there are several.
process_of() {
  local folder
  for folder in /proc/[0-9]*; do
    if [ "$(readlink "$folder/exe")" = "$program" ] && [ "$(readlink "$folder/cwd")" = "$PWD" ] &&
      tr '\0' ' ' <"$folder/cmdline" | grep -q "^$program $1 "; then
      basename "$folder"
      return
    fi
  done 2>/dev/null
  return 1
}

if [ "$how" = local ]; then
  say "Snakemake, here"
  run_workflow --cores 2 || show_and_fail "snakemake failed"
else
  say "Slurm"
  export SLURM_CONF="$place/slurm.conf"
  chmod 755 "$place"
  mkdir "$place/state" "$place/spool" "$place/munge"
  port=$((20000 + $$ % 20000))
  # Snakemake keeps SLURM_CONF from the steps of a job.
  mkdir "$place/bin"
  printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$place/bin/srun"
  chmod +x "$place/bin/srun"
  export PATH="$place/bin:$PATH"
  # GPUs that are counted, not used: what is tested is that the requests arrive.
  cat >"$SLURM_CONF" <<CONF
ClusterName=workflow
SlurmctldHost=localhost
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$place/munge/socket
CredType=cred/munge
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SlurmdParameters=config_overrides
MinJobAge=3600
KillWait=5
GresTypes=gpu
NodeName=localhost CPUs=6 RealMemory=12000 Gres=gpu:3
PartitionName=main Nodes=localhost Default=YES State=UP
CONF
  printf 'NodeName=localhost Name=gpu File=/dev/%s\n' null zero full >"$place/gres.conf"
  echo "CgroupPlugin=cgroup/v1" >"$place/cgroup.conf"
  dd if=/dev/urandom of="$place/munge/key" bs=1024 count=1 status=none
  chmod 600 "$place/munge/key"
  munged --foreground --force --key-file="$place/munge/key" --socket="$place/munge/socket" --pid-file="$place/munge/pid" \
    --log-file="$place/munge/log" --seed-file="$place/munge/seed" >"$place/munged.log" 2>&1 &
  daemons+=($!)
  for k in $(seq 100); do [ ! -S "$place/munge/socket" ] || break; sleep 0.1; done
  slurmctld -D >"$place/slurmctld.log" 2>&1 &
  daemons+=($!)
  slurmd -D -N localhost >"$place/slurmd.log" 2>&1 &
  daemons+=($!)
  for k in $(seq 300); do [ "$(sinfo -h -o %t 2>/dev/null)" != idle ] || break; sleep 0.2; done
  [ "$(sinfo -h -o %t)" = idle ] || show_and_fail "Slurm does not start"

  say "Snakemake on Slurm $(slurmctld -V | cut -d' ' -f2)"
  sed -i 's/^resources:.*/resources: {runtime: 60, gpu: 1}/' config.yaml
  run_workflow --executor slurm --jobs 6 --latency-wait 60 --slurm-status-command squeue \
    --slurm-init-seconds-before-status-checks 2 &
  workflow=$!
  some_are_done() { [ "$(done_lines)" -ge 4 ]; }
  # Known before it is needed: on a busy machine the search takes as long as some jobs.
  batch_runs() { killed="$(process_of batch)"; }
  wait_for batch_runs
  wait_for some_are_done
  kill -9 "$killed" || show_and_fail "process $killed of the batch has ended"
  finished_then="$(done_lines)"
  [ "$finished_then" -lt 20 ] || fail "the batch was over when it was to be killed"
  say "killed a process of the batch (kill -9 $killed) when $finished_then of 20 jobs were done"
  part_runs() { of_part="$(process_of run)" && part="$(tr '\0' ' ' <"/proc/$of_part/cmdline" | sed 's/.*--part \([0-9]*\).*/\1/')"; }
  wait_for part_runs
  cancelled="$(squeue -h -t R -o '%i %k' | grep "rule_part_wildcards_.*[_=]$part\$" | cut -d' ' -f1)"
  [ -n "$cancelled" ] || show_and_fail "Slurm does not know part $part: $(squeue -h -o '%i %k')"
  scancel "$cancelled"
  say "cancelled part $part of 3 (scancel $cancelled)"
  wait "$workflow" || show_and_fail "snakemake failed"
  workflow=
fi

say "what is there"
for path in "$place"/plain/*; do
  name="$(basename "$path")"
  [ -f "out/$name" ] || fail "$name is missing"
  [ "${name##*.}" = json ] || cmp "$path" "out/$name" || fail "$name differs from a plain run"
done
[ "$(ls out | wc -l)" = "$(ls "$place/plain" | wc -l)" ] || fail "more is there than plain runs make: $(ls out)"
left="$(find . -name '*.section' -o -name '*.tmp')"
[ -z "$left" ] || fail "left behind: $left"
if [ "$how" = slurm ]; then scontrol -o show jobs >"$place/jobs"; else : >"$place/jobs"; fi
"$repository/target/workflow/bin/python" - "$place" "$how" <<'PYTHON'
import json, re, sys
from collections import Counter
from pathlib import Path

place, how = Path(sys.argv[1]), sys.argv[2]
lines = [json.loads(line) for line in (place / "given/results.jsonl").read_text().splitlines()]
assert all(line["status"] == "done" for line in lines), lines
times = Counter(line["id"] for line in lines)
assert times == {f"tube{k:02}": 1 for k in range(20)}, f"jobs that were not done once: {times}"


def report(folder):
    told = json.loads((place / folder / "long.json").read_text())
    return {name: value for name, value in told.items() if name not in ("stages", "backend", "backend_reason", "provenance")}


assert report("given/out") == report("plain"), "the reports differ"
assert len(report("plain")["contours"]) == 60
jobs = [dict(re.findall(r"(\w+)=(\S*)", line)) for line in (place / "jobs").read_text().splitlines()]
if how == "slurm":
    rule = lambda job: re.match("rule_([a-z]+)", job["Comment"])[1]
    ended = Counter((rule(job), job["JobState"]) for job in jobs)
    print(dict(ended))
    assert ended == {
        ("batch", "COMPLETED"): 2, ("batch", "FAILED"): 1, ("plan", "COMPLETED"): 1,
        ("part", "COMPLETED"): 3, ("part", "CANCELLED"): 1, ("merge", "COMPLETED"): 1,
    }, "not the jobs that were expected"
    needs = [part["memory_mib"] * 5 // 4 + 250 for part in json.loads((place / "given/parts/long/plan.json").read_text())]
    for job in jobs:
        gpus, memory = "gpu:1" in job.get("TresPerJob", ""), int(re.search(r"mem=(\d+)M", job["TRES"])[1])
        assert gpus == (rule(job) in ("batch", "part")), f"GPUs of {job}"
        assert rule(job) != "part" or memory in needs + [2 * n for n in needs], f"memory of {job}: expected {needs}"
PYTHON

say "the same again: nothing is done twice"
cp results.jsonl "$place/results.before"
stat -c '%n %Y %i' out/* >"$place/out.before"
run_workflow --cores 2 || show_and_fail "snakemake failed"
cmp results.jsonl "$place/results.before" || fail "jobs were done again"
stat -c '%n %Y %i' out/* | cmp - "$place/out.before" || fail "outputs were made again"
say "all as plain runs make it"
