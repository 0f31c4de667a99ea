"""Structures of label volumes, and what programs make of every second, fourth or eighth slice: measures what volumes.csv lacks."""

import time

from . import measures, programs, volumes
from .calls import attempt
from .results import TRUTH, VOLUMES

#: Seconds that a call may take.
LIMIT = 300
#: SyN takes minutes of a structure. The morph alone is told apart on the bodies.
PROGRAMS = [name for name in programs.PROGRAMS if name not in ("SyN", "interslice morph alone")]


def run_structure(source, label, step, wanted):
    """Measures `wanted` programs on a structure, and appends their rows."""
    found = volumes.structure(*volumes.labels(source.package, source.file), label, step)
    surface = measures.surface(found.truth, 0.5, found.given.spacing)
    sides = found.given.spacing[1:]
    for name in wanted:
        row = {"volume_of": source.name, "label": label, "step": step, "program": name}
        if name == TRUTH:
            mask, seconds, failure = found.truth, 0.0, ""
            row |= {"kind": source.name, "irregular": 0, "gap": found.gap, "inradius": found.inradius, "long": max(sides) / min(sides)}
        else:
            call = programs.PROGRAMS[name][0]
            mask, seconds, failure = attempt(call, found.given, LIMIT, None if call in programs.COMMANDS else programs.WARM, programs.mask_of)
        if mask is None:
            row |= {"failure": failure}
        elif not mask.any():
            row |= {"failure": "nothing came out", "seconds": seconds}
        else:
            row |= measures.measure(found, mask, surface) | {"seconds": seconds}
        VOLUMES.append(row)


def run(only=None, minutes=None):
    """Measures what the file lacks, of the volumes that are there; ends after so many minutes. Says whether it came to the end."""
    names = [TRUTH, *(name for name in PROGRAMS if only is None or name in only)]
    done, start, loaded = VOLUMES.read(), time.monotonic(), False
    for source in volumes.SOURCES:
        there = volumes.labels(source.package, source.file)
        if there is None:
            print(f"{source.name} is left out: Debian's package {source.package} is not installed")
            continue
        for label in volumes.chosen(there[0]):
            for step in volumes.STEPS:
                wanted = [name for name in names if ((source.name, label, step), name) not in done]
                if not wanted:
                    continue
                if minutes is not None and time.monotonic() - start > 60 * minutes:
                    print(f"{minutes:g} minutes are over; run again to go on at {source.name}, label {label}")
                    return False
                if not loaded:
                    programs.load()
                    loaded = True
                run_structure(source, label, step, wanted)
                print(f"{source.name}, label {label}, every {step} slices, {time.monotonic() - start:.0f} s", flush=True)
    return True
