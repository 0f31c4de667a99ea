#!/usr/bin/env bash
# Runs the program on emulated processors with other vector instructions, and compares the bytes of what it writes with those of this machine's.
#
#   bash tests/processors.sh [PROGRAM]
#
# PROGRAM is target/release/interslice where none is named. Nehalem has no AVX, Haswell has AVX2 and FMA; the loops that are compiled once for each,
# and the C library's own, choose by what they find. QEMU's user mode has no AVX-512: whether this machine has it is said. Takes some minutes;
# needs qemu-x86_64 (Debian: qemu-user).
set -euo pipefail
cd "$(dirname "$0")/.."
program="${1:-target/release/interslice}"
if ! command -v qemu-x86_64 >/dev/null; then
  echo "qemu-x86_64 is missing (Debian: qemu-user)" >&2
  exit 2
fi
place="$(mktemp -d)"
trap 'rm -rf "$place"' EXIT
# A body that branches, by the morph, and the example of contour lines by the field method.
"$program" demo fig7 -o "$place/demo" >/dev/null

run() { # name of a folder, how the program is called
  local out="$place/$1"
  shift
  mkdir "$out"
  export SOURCE_DATE_EPOCH=0
  "$@" reconstruct "$place/demo/fig7" -o "$out/morph.nrrd" -o "$out/morph.stl" --backend cpu >/dev/null 2>&1
  "$@" reconstruct examples/jacksboro -o "$out/relief.nrrd" --method field --backend cpu >/dev/null 2>&1
  (cd "$out" && sha256sum -- *)
}

here="$(run here "$program")"
echo "$here"
echo "this machine: $(grep -o -w -E 'avx|avx2|fma|avx512f' /proc/cpuinfo | sort -u | tr '\n' ' ')"
for processor in Nehalem Haswell; do
  if [ "$(run "$processor" qemu-x86_64 -cpu "$processor" "$program")" != "$here" ]; then
    echo "$processor: other bytes" >&2
    exit 1
  fi
  echo "$processor: the same bytes"
done
