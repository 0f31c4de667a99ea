"""Contour maps, and what programs make of them: measures what terrain.csv lacks."""

from functools import partial

from . import terrain_measures, terrain_programs, terrains
from .calls import attempt
from .results import TERRAIN, TRUTH
from .rows import go_on

#: Made terrains, each with a map for each of `terrains.HEIGHTS`.
MADE = 12
#: Seconds that a call may take.
LIMIT = 300


def run_map(terrain, count, interval, wanted):
    """Measures `wanted` programs on a map, and appends their rows."""
    given = terrain.map(interval)
    measure = lambda heights: terrain_measures.measure(terrain.heights, heights, given.levels, interval, given.spacing)  # noqa: E731
    for name in wanted:
        row = {"terrain": terrain.name, "heights": count, "program": name}
        if name == TRUTH:
            row |= {"kind": terrain.kind, "interval": interval, "levels": len(given.levels)} | measure(terrain.heights)
        else:
            heights, seconds, failure = attempt(terrain_programs.PROGRAMS[name][0], given, LIMIT)
            row |= {"failure": failure} if heights is None else measure(heights) | {"seconds": seconds}
        TERRAIN.append(row)


def pieces(only):
    """What the file lacks, map by map, of the programs that are there."""
    missing = terrain_programs.missing()
    if missing:
        print(f"not found, and left out: {', '.join(missing)}")
    there = [name for name, (_, needed) in terrain_programs.PROGRAMS.items() if needed not in missing]
    names = [TRUTH, *(name for name in there if only is None or name in only)]
    done = TERRAIN.read()
    for terrain in [*terrains.real(), *map(terrains.terrain, range(MADE))]:
        for count, interval in zip(terrains.HEIGHTS, terrain.intervals()):
            wanted = [name for name in names if ((terrain.name, count), name) not in done]
            if wanted:
                yield f"{terrain.name}, contours every {interval:g} m", partial(run_map, terrain, count, interval, wanted)


def run(only=None, minutes=None):
    """Measures what the file lacks; ends after so many minutes. Says whether it came to the end."""
    return go_on(pieces(only), minutes)
