"""Writes docs/soup.md: every crate in Cargo.lock, with version, licence, what it is for, the features that bring it in, and anomalies known to us.

    python3 docs/soup.py            writes the sheet
    python3 docs/soup.py --check    fails where the sheet is not that of Cargo.lock, a licence is not allowed, or a source is not crates.io

Python's standard library and cargo are enough. Licences that are allowed stand in deny.toml.
"""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHEET = ROOT / "docs" / "soup.md"
# A registry; `deny.toml` (`unknown-registry`) says that it must be crates.io.
REGISTRY = "registry+"
MEMBERS = {"interslice": "program", "interslice-python": "module"}
# The systems for which releases are made.
SYSTEMS = {"Linux": "x86_64-unknown-linux-gnu", "macOS": "aarch64-apple-darwin", "Windows": "x86_64-pc-windows-msvc"}

# What the direct dependencies are used for. A new one without a row here is an error.
USES = {
    "adler2": "checksum of zlib streams that are packed in parallel (PNG, TIFF, NRRD)",
    "base64": "pictures and numbers within the report's page",
    "blake3": "fingerprints of batch jobs and of recorded answers",
    "bytemuck": "numbers as bytes for files and for the GPU's buffers, without `unsafe` of our own",
    "bzip2": "NRRD packed by bzip2, in",
    "clap": "the command line",
    "clap_complete": "completions for shells",
    "clap_mangen": "man pages",
    "csv": "manifests of batches as CSV",
    "ctrlc": "Ctrl-C, SIGTERM and SIGHUP end a run in good order",
    "dicom-core": "DICOM: values and tags",
    "dicom-dictionary-std": "DICOM: names of tags",
    "dicom-encoding": "names of ROIs in character sets that change on the way",
    "dicom-object": "DICOM RTSTRUCT, in and out",
    "divan": "benchmarks",
    "flate2": "deflate, zlib and gzip",
    "geojson": "contour maps as GeoJSON, in",
    "getrandom": "random names of temporary files, through tempfile; python/Cargo.toml names it so that tests and module share one build",
    "glam": "vectors and matrices",
    "gltf-json": "meshes as .glb: the JSON part",
    "image": "PNG and TIFF slices in, pictures out",
    "indicatif": "progress bars",
    "libc": "CPU clocks of threads, advice to the allocator (Linux), a signal that is ignored (Unix)",
    "libm": "exp, tan, atan2, pow, hypot of the numerics: the C library's differ by processor",
    "meshopt": "--simplify (meshoptimizer, C++)",
    "multiversion": "loops compiled for several instruction sets, chosen at run time",
    "naga": "tests that shaders and their Rust structs agree",
    "nifti": "NIfTI headers",
    "num-integer": "through zarrs and numpy; named for the tests so that they and the module share one build",
    "numpy": "arrays of numpy",
    "png": "numbers of colours of PNG with a palette",
    "pollster": "waits for what wgpu answers",
    "proj4rs": "contour maps in degrees, reprojected to UTM",
    "proptest": "property tests",
    "pyo3": "the module for Python",
    "quick-xml": "OME-XML in TIFF, XML in 3MF and VTK files",
    "rayon": "threads",
    "rstar": "nearest points and edges",
    "rusqlite": "contour maps as GeoPackage, in (SQLite, C)",
    "rustc-hash": "numbers of the surface's vertices by their edges",
    "rustix": "a folder is exchanged for another in one step (Linux, macOS)",
    "serde": "settings, manifests, reports",
    "serde_json": "JSON",
    "serde_path_to_error": "the key at which JSON is wrong",
    "sha2": "digests of input files in the report",
    "shapefile": "contour maps as shapefile, in",
    "sysinfo": "free memory and disk",
    "tempfile": "temporary files that are renamed at the end",
    "thiserror": "error messages",
    "tiff": "TIFF volumes in, GeoTIFF and TIFF out",
    "time": "the date in a report",
    "toml": "settings files",
    "weezl": "TIFF packed by LZW, in",
    "wgpu": "the GPU path",
    "zarrs": "Zarr and OME-Zarr, in and out",
    "zip": ".npz in and out, 3MF out",
    "zstd": "TIFF and Zarr packed by zstd, in (zstd, C)",
}

# What we know of and have met; where it is kept from the user. `no row` means: none known to us.
ANOMALIES = {
    "dicom-object": "Believes lengths, allocates by them and recurses into sequences; leaves bytes unread where a length is no multiple of its numbers' "
    "size. `src/rtstruct/guard.rs` refuses such files first.",
    "image": "A colour profile of 1 MB in a PNG unpacks to 1 GB. `src/input/grey_image.rs` sets limits.",
    "shapefile": "Allocates by the numbers of parts and points that a file says. `src/terrain/guard.rs` checks them first.",
    "tiff": "Refuses sound tiles and strips that are packed by LZW (0.11.3). `src/input/volume/tiff_lzw.rs` unpacks them.",
    "zarrs": "Codecs unpack all there is before they compare sizes. `src/input/volume/zarr_bounded.rs` bounds them.",
}


def metadata():
    command = ["cargo", "metadata", "--locked", "--all-features", "--format-version", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"cargo metadata failed: {done.stderr.strip()}")
    return json.loads(done.stdout)


def allowed_licences():
    return set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])


def is_allowed(expression, allowed):
    """Whether an SPDX expression can be met by allowed licences: `/` is an old way to write OR, `X WITH Y` one licence."""
    words = re.findall(r"\(|\)|[^\s()/]+|/", re.sub(r"(\S+) WITH (\S+)", r"\1_WITH_\2", expression))

    def either(words):
        met = both(words)
        while words and words[0] in ("OR", "/"):
            words.pop(0)
            met = both(words) or met
        return met

    def both(words):
        met = one(words)
        while words and words[0] == "AND":
            words.pop(0)
            met = one(words) and met
        return met

    def one(words):
        word = words.pop(0)
        if word != "(":
            return word.replace("_WITH_", " WITH ") in allowed
        met = either(words)
        words.pop(0)
        return met

    return either(words)


def tree(*options, package="interslice", edges="normal,build", target="all"):
    """Name and version of all that cargo builds for a package."""
    command = ["cargo", "tree", "--locked", "-p", package, "-e", edges, "--target", target, "--prefix", "none", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"cargo tree failed: {done.stderr.strip()}")
    crates = (line.split()[:2] for line in done.stdout.splitlines() if line)
    return {(name, version.removeprefix("v")) for name, version in crates}


def parts():
    """Pairs of a part and its crates; a crate is of the first part that has it."""
    everything = ("--all-features",)
    yield "program", tree(*everything, edges="normal,no-proc-macro")
    yield "build", tree(*everything)
    yield "Python", tree(package="interslice-python")
    yield "tests", tree(*everything, edges="normal,build,dev")


def by_feature(features):
    """For each crate the features that bring it in: each by itself, or where several are needed, those without which it is not there."""
    choose = lambda some: tree("--no-default-features", "--features", ",".join(sorted(some)))
    features = set(features) - {"default"}
    always, alone = choose(()), {f: choose({f}) for f in features}
    lacking = {f: tree("--all-features") - choose(features - {f}) for f in features}

    def of(crate):
        if crate in always:
            return "always"
        one = sorted(f for f in features if crate in alone[f])
        return ", ".join(one) or " with ".join(sorted(f for f in features if crate in lacking[f]))

    return of


def reach(meta):
    """For each package: the direct dependencies through which it comes, as (member, kind, name)."""
    nodes = {node["id"]: node for node in meta["resolve"]["nodes"]}
    packages = {package["id"]: package for package in meta["packages"]}
    through = {}
    for member, node in nodes.items():
        owner = packages[member]["name"]
        if owner not in MEMBERS:
            continue
        for direct in node["deps"]:
            name = packages[direct["pkg"]]["name"]
            for kind in {kind["kind"] or "normal" for kind in direct["dep_kinds"]}:
                seen, todo = set(), [] if name in MEMBERS else [direct["pkg"]]
                while todo:
                    package = todo.pop()
                    if package not in seen:
                        seen.add(package)
                        through.setdefault(package, set()).add((MEMBERS[owner], kind, name))
                        todo += [dep["pkg"] for dep in nodes[package]["deps"]]
    return through


def rows(meta):
    allowed = allowed_licences()
    packages = {package["id"]: package for package in meta["packages"]}
    program = next(package for package in meta["packages"] if package["name"] == "interslice")
    through, features, own = reach(meta), by_feature(program["features"]), list(parts())
    systems = {name: tree("--all-features", target=triple) for name, triple in SYSTEMS.items()}
    lines, wrong = [], []
    for package in sorted(meta["packages"], key=lambda p: (p["name"], p["version"])):
        name, version = crate = package["name"], package["version"]
        if name in MEMBERS:
            continue
        if not (package["source"] or "").startswith(REGISTRY):
            wrong.append(f"{name} {version} comes from {package['source']}, not from a registry")
        licence = package["license"] or ""
        if not licence or not is_allowed(licence, allowed):
            wrong.append(f"{name} {version} has the licence `{licence}`, which deny.toml does not allow")
        part = next((part for part, crates in own if crate in crates), "not built")
        of_program = part in ("program", "build")
        on = [system for system, crates in systems.items() if crate in crates]
        on = "all" if len(on) == len(systems) else ", ".join(on) or "others"
        ways = through.get(package["id"], set())
        ways = {via for owner, kind, via in ways if not of_program or (owner == "program" and kind != "dev")}
        if is_direct(meta, packages, package["id"]):
            if name not in USES:
                wrong.append(f"{name} has no row in USES of docs/soup.py")
            use = USES.get(name, "")
        else:
            use = "through " + listed(sorted(ways))
        brought = features(crate) if of_program else ""
        cells = [name, version, licence, part, on if of_program else "", use, brought, ANOMALIES.get(name, "none known to us")]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    known = {package["name"] for package in meta["packages"]}
    wrong += [f"{name}, named in docs/soup.py, is no longer in Cargo.lock" for name in {*USES, *ANOMALIES} - known]
    return lines, wrong


def is_direct(meta, packages, wanted):
    of_members = (node for node in meta["resolve"]["nodes"] if packages[node["id"]]["name"] in MEMBERS)
    return any(dep["pkg"] == wanted for node in of_members for dep in node["deps"])


def listed(names):
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


HEAD = """# Software of others

Every crate that `Cargo.lock` names, for a sheet of software of unknown provenance (SOUP, IEC 62304). `python3 docs/soup.py` writes this page;
`python3 docs/soup.py --check` and `tests/pages/software.rs` fail where it is not that of `Cargo.lock`.

- *part*: what is linked into the program and its library, what only builds them (macros, too), the module for Python, or tests and benchmarks;
  "not built" stands in `Cargo.lock` as an option of others that nobody takes.
- *on*: the systems on which the program has it; "others" are systems for which no release is made, such as WebAssembly.
- *features*: the features of the program that bring it in; all are on by default. Crates with C or C++ code in them are blosc-src, libsqlite3-sys,
  libz-sys, lz4-sys, meshopt and zstd-sys.
- *known anomalies*: what we have met ourselves, and where it is kept from the user. The database of advisories was not at hand when this page was
  written: run `cargo deny check advisories` before you rely on this column.

| crate | version | licence | part | on | used for | features | known anomalies |
|---|---|---|---|---|---|---|---|
"""


def main():
    lines, wrong = rows(metadata())
    if wrong:
        sys.exit("\n".join(wrong))
    text = HEAD + "\n".join(lines) + "\n"
    if sys.argv[1:] == ["--check"]:
        if not SHEET.exists() or SHEET.read_text() != text:
            sys.exit("docs/soup.md is not that of Cargo.lock: run python3 docs/soup.py")
        print(f"docs/soup.md is that of Cargo.lock: {len(lines)} crates from crates.io, with licences that deny.toml allows")
    elif sys.argv[1:]:
        sys.exit(__doc__)
    else:
        SHEET.write_text(text)


if __name__ == "__main__":
    main()
