"""Tables of docs/evaluation.md about label volumes, of volumes.csv. A structure's runs count as one: intervals are of a bootstrap over structures."""

import numpy as np

from . import statistics
from .layout import OURS, SHORT, between, named, spread, table
from .results import TRUTH, VOLUMES
from .statistics import Scores
from .tables import BEHIND
from .volumes import SOURCES, STEPS


def structure(case):
    """What counts as one: a label of a volume, whichever slices are given."""
    return case[:2]


def mean(values):
    """Mean of a dict of values by case, with its interval over structures."""
    return statistics.mean(statistics.clustered(values, structure))


def of(scores, cases, program, measure):
    return mean({case: statistics.score(scores.rows, case, program, measure) for case in cases})


def ahead(scores, cases, peer, measure):
    """Ours less the peer's, turned so that more is better for us; of a crease its distance from 1."""

    def value(case):
        ours, theirs = (statistics.score(scores.rows, case, program, measure) for program in ("interslice", peer))
        return abs(theirs - 1) - abs(ours - 1) if measure == "crease" else statistics.MEASURES[measure] * (ours - theirs)

    return mean({case: value(case) for case in cases})


def volumes(scores):
    """Means of each program."""
    rows = []
    for name in scores.programs:
        cases = scores.having(name)
        row = [named(name)]
        row += [spread(of(scores, [case for case in cases if case[2] == step], name, "dice"), 4) for step in STEPS]
        row += [spread(of(scores, cases, name, measure), digits) for measure, digits in (("distance", 3), ("distance95", 3), ("volume", 2))]
        row += [spread(of(scores, cases, name, "pieces"), 1, 100), spread(of(scores, cases, name, "crease"), 3)]
        rows.append([*row, f"{np.mean([scores.rows[case, name]['seconds'] for case in cases]):.2f}"])
    head = ["program", *(f"Dice, 1 of {step}" for step in STEPS), "distance, mm", "95 %, mm", "volume, % off", "pieces right, %", "crease", "CPU s"]
    failed = [f"{name}: {scores.failures(name)}" for name in scores.programs if scores.failures(name)]
    words = f"{len(set(map(structure, scores.bodies)))} structures of {len(set(scores.kind.values()))} volumes. Failures: {'; '.join(failed) or 'none'}."
    return table(head, rows) + "\n\n" + words


def volumes_ahead(scores):
    """interslice less each peer, structure by structure, all measures."""
    rows = []
    for peer in [name for name in scores.programs if name != "interslice"]:
        cases = scores.having("interslice", peer)
        row = [peer, *(between(ahead(scores, [case for case in cases if case[2] == step], peer, "dice"), 1, 1000) for step in STEPS)]
        row += [between(ahead(scores, cases, peer, "distance"), 1, 1000), between(ahead(scores, cases, peer, "distance95"), 0, 1000)]
        row += [between(ahead(scores, cases, peer, "volume"), 2), between(ahead(scores, cases, peer, "pieces"), 1, 100), between(ahead(scores, cases, peer, "crease"), 3)]
        dice = np.array([scores.rows[case, "interslice"]["dice"] - scores.rows[case, peer]["dice"] for case in cases])
        rows.append([*row, f"{np.sum(dice > BEHIND)} : {np.sum(dice < -BEHIND)}"])
    head = ["interslice beside", *(f"Dice, 0.001, 1 of {step}" for step in STEPS), "distance, µm", "95 %, µm", "volume, %", "pieces, %", "crease off 1"]
    return table([*head, "runs ahead : behind"], rows)


def volumes_sources(scores):
    """What each volume is, and how far interslice is ahead there."""
    peers = [name for name in scores.programs if name not in OURS]
    rows = []
    for source in SOURCES:
        cases = [case for case in scores.having("interslice", *peers) if case[0] == source.name]
        if cases:
            row = [source.name, source.shows, f"{source.package}, {source.licence}", str(len(set(map(structure, cases))))]
            row.append(f"{of(scores, cases, 'interslice', 'dice')[0]:.4f}")
            rows.append(row + [between(ahead(scores, cases, peer, "dice"), 1, 1000, interval=False) for peer in peers])
    return table(["volume", "of what", "package, its licence", "structures", "interslice", *(SHORT.get(p, p) for p in peers)], rows)


def blocks():
    """The page's blocks by name."""
    scores = Scores(VOLUMES.read())
    if not scores.having("interslice", "SDF PCHIP"):
        raise SystemExit(f"{VOLUMES.path}: no structure has both interslice and SDF PCHIP")
    return {f.__name__: f(scores) for f in (volumes, volumes_ahead, volumes_sources)}
