#!/usr/bin/env bash
# Runs tests under a sanitizer, which sees what no result shows: races and undefined behaviour.
#
#   bash tests/sanitizers.sh thread [TESTS...]    ThreadSanitizer: the tests in which threads share something
#   bash tests/sanitizers.sh miri [TESTS...]      Miri: the allocator's tests, and the unit tests of the queue for a GPU and of shared answers
#
# TESTS are lines of the lists below that are named by their first word (`lib`, `batches`). The standard library is built with it, too. Needs a nightly
# toolchain: rustup toolchain install nightly --component rust-src,miri. Takes half an hour for ThreadSanitizer, on two cores, most of it building.
# Reports lie in target/sanitizers; exit code 1 where there is one, or a test failed. docs/trust.md says what came of it.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() { sed -n 's/^#   /  /p' "$0" >&2; exit 2; }
[ $# -ge 1 ] || usage
kind="$1"
shift
system="x86_64-unknown-linux-gnu"
place="$PWD/target/sanitizers/$kind"
reports="$place/reports"

# A program of tests and the names of those that run, all where none is named. Other tests have one thread, or as many that share nothing but rayon's
# pool, as these do; or they limit the address space, of which ThreadSanitizer takes terabytes.
case "$kind" in
  thread)
    lists=(
      "lib"
      "gpu runs_at_once neither_a_second_run a_failing_gpu replay::"
      "batches manifests:: index:: split:: a_job_that_panics device:: an_interrupt"
      "outputs stream::"
      "surface topology::"
    )
    ;;
  miri) lists=("allocator" "lib gpu::queue:: backend::answers::") ;;
  *) usage ;;
esac

chosen=()
for list in "${lists[@]}"; do
  if [ $# = 0 ] || [[ " $* " == *" ${list%% *} "* ]]; then chosen+=("$list"); fi
done
[ ${#chosen[@]} -gt 0 ] || usage

target_of() { if [ "$1" = lib ]; then echo "--lib"; else echo "--test=$1"; fi; }
targets=()
for list in "${chosen[@]}"; do targets+=("$(target_of "${list%% *}")"); done

rm -rf "$reports"
mkdir -p "$reports"
export CARGO_TARGET_DIR="$place" CARGO_INCREMENTAL=0 CARGO_PROFILE_QUICK_DEBUG=line-tables-only
if [ "$kind" = miri ]; then
  # Without libraries in C, which Miri cannot run.
  export MIRIFLAGS="-Zmiri-disable-isolation"
  for list in "${chosen[@]}"; do
    read -r -a words <<<"$list"
    cargo +nightly miri test --locked --no-default-features --features gpu "$(target_of "${words[0]}")" -- "${words[@]:1}"
  done
  exit
fi
export RUSTFLAGS="-Zsanitizer=$kind"
# Every process writes its reports into a file of its own, those that a test starts, too.
export TSAN_OPTIONS="suppressions=$PWD/tests/tsan.supp log_path=$reports/report ignore_noninstrumented_modules=1"
build=(cargo +nightly test --locked --profile quick -Zbuild-std --target "$system")
"${build[@]}" --no-run "${targets[@]}"

failed=0
for list in "${chosen[@]}"; do
  read -r -a words <<<"$list"
  # Addresses are not drawn: ThreadSanitizer's own must be free.
  setarch -R "${build[@]}" --quiet "$(target_of "${words[0]}")" -- "${words[@]:1}" || failed=1
done

count() { cat "$reports"/* 2>/dev/null | grep -c "$1" || true; }
found="$(count '^WARNING: ThreadSanitizer')"
echo "$found reports in $(find "$reports" -type f | wc -l) files ($reports)"
[ "$failed" = 0 ] && [ "$found" = 0 ]
