"""Structures of label volumes, and what programs make of every second, fourth or eighth slice: measures what volumes.csv lacks."""

from functools import partial
from itertools import product

from . import measures, programs, volumes
from .results import TRUTH, VOLUMES
from .rows import go_on, mask_row

#: Seconds that a call may take.
LIMIT = 300
#: SyN takes minutes of a structure. The morph alone is told apart on the bodies.
PROGRAMS = [name for name in programs.PROGRAMS if name not in ("SyN", "interslice morph alone")]


def run_structure(source, label, step, wanted):
    """Measures `wanted` programs on a structure, and appends their rows."""
    found = volumes.structure(*volumes.labels(source.package, source.file), label, step)
    surface = measures.surface(found.truth, 0.5, found.given.spacing)
    for name in wanted:
        row = {"volume_of": source.name, "label": label, "step": step, "program": name} | mask_row(name, found, surface, LIMIT)[0]
        if name == TRUTH:
            row |= {"kind": source.name, "irregular": 0}
        VOLUMES.append(row)


def missing(only):
    """What the file lacks, structure by structure, of the volumes that are there."""
    names = [TRUTH, *(name for name in PROGRAMS if only is None or name in only)]
    done = VOLUMES.read()
    for source in volumes.SOURCES:
        there = volumes.labels(source.package, source.file)
        if there is None:
            print(f"{source.name} is left out: Debian's package {source.package} is not installed")
            continue
        for label, step in product(volumes.chosen(there[0]), volumes.STEPS):
            wanted = [name for name in names if ((source.name, label, step), name) not in done]
            if wanted:
                yield f"{source.name}, label {label}, every {step} slices", partial(run_structure, source, label, step, wanted)


def run(only=None, minutes=None):
    """Measures what the file lacks, of the volumes that are there; ends after so many minutes. Says whether it came to the end."""
    todo = list(missing(only))
    if todo:
        programs.load()
    return go_on(todo, minutes)
