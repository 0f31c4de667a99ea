#!/usr/bin/env bash
# Builds the program twice, from copies of the last commit in folders whose names differ, and compares the bytes.
#
#   bash tests/reproducible.sh [PROFILE] [options of cargo build]
#
# PROFILE is dist, what is handed out, where none is named. Folders of this machine do not get into the program: they are mapped to /src,
# /target and /cargo, for Rust and for C. Takes two builds from nothing.
set -euo pipefail
cd "$(dirname "$0")/.."
profile="${1:-dist}"
shift || true
cargo_home="${CARGO_HOME:-$HOME/.cargo}"
place="$(mktemp -d)"
trap 'rm -rf "$place"' EXIT

build() { # name of a folder, options
  local root="$place/$1"
  shift
  mkdir -p "$root/src"
  git archive HEAD | tar -x -C "$root/src"
  local maps=("$root/src=/src" "$root/target=/target" "$cargo_home=/cargo")
  # Build scripts and compilers of C see the same places under the same names.
  (cd "$root/src" &&
    RUSTFLAGS="$(printf -- '--remap-path-prefix=%s ' "${maps[@]}")" \
    CFLAGS="$(printf -- '-ffile-prefix-map=%s ' "${maps[@]}")" \
    CXXFLAGS="$(printf -- '-ffile-prefix-map=%s ' "${maps[@]}")" \
    CARGO_INCREMENTAL=0 CARGO_TARGET_DIR="$root/target" \
      cargo build --quiet --locked --bin interslice --profile "$profile" "$@")
  built="$root/target/$profile/interslice"
}

build one "$@"
first="$built"
build another/and/deeper "$@"
sha256sum "$first" "$built" | cut -d' ' -f1
if cmp "$first" "$built"; then echo "the same bytes, built twice (profile $profile)"; else exit 1; fi
