"""Runs what the file of results lacks, and makes tables and figures of it.

    benches/evaluation/run [--part PART] [--bodies N] [--only NAME[,NAME]] [--minutes N]
    benches/evaluation/run --tables | --again | --test | --picture K
"""

import argparse
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from . import bodies, measures, programs, results, selftest, terrain_programs, terrain_run, volume_run
from .rows import go_on, mask_row

BODIES = 504
PARTS = ("bodies", "terrain", "volumes")
#: `evaluate --leave 2` is asked for every so many bodies.
HOLD_OUT = 3
#: Seconds that a call may take.
LIMIT = 120
SCRATCH = Path("target/evaluation")


def judgement(body, with_hold_out):
    """What interslice says of its own result, and how far it is right."""
    mask, confidence = programs.interslice(body.given, wanted=("mask", "confidence"))
    found = {"confidence": measures.reliability(body, mask, confidence)}
    scores = programs.hold_out(body.given) if with_hold_out else None
    if scores and scores["surface_distance"] is not None:
        found |= {"holdout": scores["dice"], "holdout_distance": scores["surface_distance"]}
    return found


def run_body(number, wanted, file, seed):
    """Measures `wanted` programs on a body, and appends their rows."""
    body = bodies.body(number, seed)
    surface = measures.surface(body.field, 0, body.given.spacing)
    for name in wanted:
        found, mask = mask_row(name, body, surface, LIMIT)
        row = {"body": number, "program": name} | found
        if name == results.TRUTH:
            row |= {"kind": body.kind, "irregular": int(body.irregular)}
        if name == "interslice" and mask is not None:
            row |= judgement(body, number % HOLD_OUT == 0)
        file.append(row)


def missing(numbers, file, only, seed):
    """What the file lacks, body by body."""
    every = {results.TRUTH: 1} | {name: every for name, (_, every) in programs.PROGRAMS.items()}
    names = [results.TRUTH, *(name for name in programs.PROGRAMS if only is None or name in only)]
    done = file.read()
    for number in numbers:
        wanted = [name for name in names if number % every[name] == 0 and (number, name) not in done]
        if wanted:
            yield f"body {number} of {len(numbers)}", partial(run_body, number, wanted, file, seed)


def run(numbers, file, only=None, minutes=None, seed=bodies.SEED):
    """Measures what the file lacks; ends after so many minutes. Says whether it came to the end."""
    todo = list(missing(numbers, file, only, seed))
    if todo:
        programs.load()
    return go_on(todo, minutes)


def main():
    parser = argparse.ArgumentParser(prog="benches/evaluation/run", description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", type=int, default=BODIES, metavar="N", help=f"bodies 0 to N - 1 [default: {BODIES}]")
    parser.add_argument("--part", choices=PARTS, help="this part of the evaluation only")
    names = dict.fromkeys((results.TRUTH, *programs.PROGRAMS, *terrain_programs.PROGRAMS))
    parser.add_argument("--only", metavar="NAME[,NAME]", help=f"these programs only: {', '.join(names)}")
    parser.add_argument("--minutes", type=float, metavar="N", help="end a part after the case during which N minutes are over; run again to go on")
    parser.add_argument("--tables", action="store_true", help="tables and figures anew from the files of results, nothing else")
    parser.add_argument("--again", action="store_true", help="a tenth as many bodies of another seed: do their means lie within the intervals?")
    parser.add_argument("--test", action="store_true", help="test the measures with bodies of known answers")
    parser.add_argument("--picture", type=int, metavar="K", help="draw body K and what programs make of it into target/evaluation")
    options = parser.parse_args()
    only = options.only.split(",") if options.only else None
    for name in only or ():
        if name not in names:
            parser.error(f"--only: no program is called `{name}`")
    if options.picture is not None and not set(only or ()) <= set(programs.PROGRAMS):
        parser.error("--picture: draws what programs make of bodies; --only names another")
    if options.bodies < 1:
        parser.error(f"--bodies: at least 1; got {options.bodies}")
    needs_program = not (options.tables or options.test)
    if needs_program and not shutil.which(programs.PROGRAM):
        parser.error(f"no program {programs.PROGRAM}: build it (cargo build --release), or name another by INTERSLICE=<program>")

    if options.test:
        selftest.run()
    elif options.picture is not None:
        from . import pictures

        programs.load()
        print(pictures.draw(options.picture, only, SCRATCH))
    elif options.again:
        from . import tables

        again = replace(results.BODIES, path=SCRATCH / "again.csv")
        again.path.unlink(missing_ok=True)
        numbers = range(options.bodies // 10)
        run(numbers, again, only, options.minutes, bodies.SEED + 1)
        tables.compare(results.BODIES.read(), again.read())
    else:
        if not options.tables:
            parts = {
                "bodies": lambda: run(range(options.bodies), results.BODIES, only, options.minutes),
                "terrain": lambda: terrain_run.run(only, options.minutes),
                "volumes": lambda: volume_run.run(only, options.minutes),
            }
            for part in [options.part] if options.part else PARTS:
                parts[part]()
        from . import readme

        readme.write()


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
