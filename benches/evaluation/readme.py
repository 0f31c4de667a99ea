"""The table of README.md: means of the three parts of the evaluation, and all pages together."""

from . import page, statistics, tables, terrain_tables, volume_tables
from .layout import OURS, table
from .results import BODIES, TERRAIN, VOLUMES
from .statistics import Scores
from .terrain_tables import Maps
from .volumes import STEPS

#: Peers that are named, the best first.
PEERS = 4


def row(words, ours, peers, digits, sign):
    """Our mean and those of the best peers; bold the best of all. More is better where sign is 1."""
    best = sorted(peers.items(), key=lambda item: -sign * item[1])[:PEERS]
    bold = lambda value: f"**{value:.{digits}f}**" if all(sign * value >= sign * other for other in (ours, *peers.values())) else f"{value:.{digits}f}"  # noqa: E731
    return [words, bold(ours), ", ".join(f"{name} {bold(value)}" for name, value in best)]


def readme():
    """One row for each part."""
    rows = []
    scores = Scores(BODIES.read())
    bodies = scores.having("interslice")
    peers = [p for p in scores.programs if p not in OURS and len(scores.having(p)) == len(bodies)]
    dice = {p: statistics.mean(scores.of(bodies, p, "dice"))[0] for p in ("interslice", *peers)}
    rows.append(row(f"Dice over slices that were left out, {len(bodies)} bodies with exact truth", dice.pop("interslice"), dice, 3, 1))

    scores = Scores(VOLUMES.read())
    middle = STEPS[len(STEPS) // 2]
    cases = [case for case in scores.having(*scores.programs) if case[2] == middle]
    dice = {p: volume_tables.of(scores, cases, p, "dice")[0] for p in scores.programs if p == "interslice" or p not in OURS}
    rows.append(row(f"the same, {len(cases)} organs and brain regions, every {middle}th slice given", dice.pop("interslice"), dice, 3, 1))

    maps = Maps(TERRAIN.read())
    cases = maps.having("interslice", *maps.peers)
    off = {p: 100 * maps.of(cases, p, "share")[0] for p in ("interslice", *maps.peers)}
    rows.append(row(f"RMSE of heights, % of the contour interval, {len(cases)} contour maps (less is better)", off.pop("interslice"), off, 1, -1))
    return table(["mean", "interslice", "its best peers"], rows)


def write():
    """All blocks into their pages."""
    page.write({"readme": readme()} | tables.blocks() | volume_tables.blocks() | terrain_tables.blocks())
    page.check()
