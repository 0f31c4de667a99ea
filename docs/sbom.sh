#!/usr/bin/env bash
# Writes the software bill of materials (SBOM, CycloneDX 1.5) of the program and of the module for Python: every crate that is built into them or builds
# them, with version, licence and digest.
#
#   bash docs/sbom.sh FOLDER [SYSTEM]
#
# SYSTEM is a target triple of Rust, this machine's where none is named. Needs cargo-cyclonedx (cargo install cargo-cyclonedx --locked). What Cargo itself
# says (cargo tree) must be in it. The folder of the sources stands in it as /src; its date is that of SOURCE_DATE_EPOCH, or 1970.
set -euo pipefail
[ $# -ge 1 ] || { sed -n 's/^#   /  /p' "$0" >&2; exit 2; }
mkdir -p "$1"
out="$(cd "$1" && pwd)"
cd "$(dirname "$0")/.."
root="$PWD"
system="${2:-$(rustc -vV | sed -n 's/^host: //p')}"
trap 'rm -f interslice.cdx.json python/interslice-python.cdx.json' EXIT
export SOURCE_DATE_EPOCH="${SOURCE_DATE_EPOCH:-0}"
# Cargo.lock must be that of Cargo.toml: cargo-cyclonedx would bring it up to date.
cargo metadata --locked --format-version 1 >/dev/null
cargo cyclonedx --quiet --format json --spec-version 1.5 --target "$system"
for pair in interslice=. interslice-python=python; do
  name="${pair%=*}"
  sed "s|$root|/src|g" "${pair#*=}/$name.cdx.json" >"$out/$name.cdx.json"
  cargo tree --locked -p "$name" -e normal,build --target "$system" --prefix none -f '{p}' |
    python3 -c '
import json, sys
listed = {(c["name"], c["version"]) for c in json.load(open(sys.argv[1]))["components"]}
used = {tuple(line.split()[:2]) for line in sys.stdin if line.strip()}
missing = [name for name, version in used if not name.startswith("interslice") and (name, version[1:]) not in listed]
print(f"{sys.argv[1]}: {len(listed)} crates")
sys.exit(f"not in it: {sorted(missing)}" if missing else 0)
' "$out/$name.cdx.json"
done
