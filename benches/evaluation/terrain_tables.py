"""Tables of docs/evaluation.md about contour maps, of terrain.csv. A terrain's maps count as one: intervals are of a bootstrap over terrains."""

import numpy as np

from . import statistics
from .layout import between, named, spread, table
from .results import TERRAIN, TRUTH
from .terrain_programs import PROGRAMS
from .terrains import HEIGHTS

OURS = ("interslice", "interslice --method field", "interslice --method field --pixel CELL")
#: Ahead or behind on a map: by more than this share of the interval.
BEHIND = 0.01
#: Fewer terrains than these give no interval.
ENOUGH = 5


class Maps:
    """Rows by map, (terrain, about how many heights), and program."""

    def __init__(self, rows):
        self.rows = rows
        self.maps = [case for case, program in rows if program == TRUTH]
        self.kind = {case: rows[case, TRUTH]["kind"] for case in self.maps}
        self.programs = [name for name in PROGRAMS if any((case, name) in rows for case in self.maps)]
        self.peers = [name for name in self.programs if name not in OURS]

    def having(self, *programs):
        """Maps of which each program has made something."""
        return [case for case in self.maps if all("rmse" in self.rows.get((case, p), {}) for p in programs)]

    def failures(self, program):
        return sum("failure" in self.rows.get((case, program), {}) for case in self.maps)

    def mean(self, maps, value):
        """Mean of value(map), with its interval over terrains."""
        return statistics.mean(statistics.clustered({case: value(case) for case in maps}, lambda case: case[0]))

    def of(self, maps, program, measure):
        return self.mean(maps, lambda case: self.rows[case, program].get(measure, np.nan))

    def ahead(self, maps, peer, measure):
        """How much less the error of interslice is than the peer's; of terraces the distance from 1."""
        error = (lambda row: abs(row["terraces"] - 1)) if measure == "terraces" else lambda row: row[measure]
        return self.mean(maps, lambda case: error(self.rows[case, peer]) - error(self.rows[case, "interslice"]))


def terrain(maps):
    """Means of each program."""
    rows = []
    for name in maps.programs:
        cases = maps.having(name)
        of = lambda measure: maps.of(cases, name, measure)  # noqa: E731
        row = [named(name), spread(of("share"), 1, 100), spread(of("off95"), 1, 100), spread(of("rmse"), 1), spread(of("slope"), 2)]
        row += [spread(of("outside"), 2), spread(of("terraces"), 2), f"{of('covered')[0]:.1f}", f"{of('seconds')[0]:.1f}"]
        rows.append(row)
    head = ["program", "RMSE, % of interval", "95 %, % of interval", "RMSE, m", "slope, °", "outside band, %", "terraces", "with height, %", "CPU s"]
    failed = [f"{name}: {maps.failures(name)}" for name in maps.programs if maps.failures(name)]
    terrains = len({case[0] for case in maps.maps})
    return table(head, rows) + f"\n\n{len(maps.maps)} maps of {terrains} terrains. Failures: {'; '.join(failed) or 'none'}."


def terrain_ahead(maps):
    """interslice less each peer, map by map, all measures."""
    rows = []
    for peer in [name for name in maps.programs if name != "interslice"]:
        cases = maps.having("interslice", peer)
        of = lambda measure: maps.ahead(cases, peer, measure)  # noqa: E731
        row = [peer, between(of("share"), 1, 100), between(of("off95"), 1, 100), between(of("slope"), 2), between(of("outside"), 2), between(of("terraces"), 2)]
        less = np.array([maps.rows[case, peer]["share"] - maps.rows[case, "interslice"]["share"] for case in cases])
        rows.append([*row, f"{np.sum(less > BEHIND)} : {np.sum(less < -BEHIND)}"])
    head = ["interslice beside", "RMSE, % of interval", "95 %, % of interval", "slope, °", "outside band, %", "terraces off 1", "maps ahead : behind"]
    return table(head, rows)


def terrain_groups(maps):
    """RMSE of interslice, and how much less it is than peers', by how many contours there are and by kind of terrain."""
    groups = [("all", maps.maps)]
    groups += [(f"about {count} contour heights", [case for case in maps.maps if case[1] == count]) for count in HEIGHTS]
    groups += [(kind, [case for case in maps.maps if maps.kind[case] == kind]) for kind in dict.fromkeys(maps.kind.values())]
    rows = []
    for name, members in groups:
        members = [case for case in maps.having("interslice") if case in members]
        if not members:
            continue
        row = [name, str(len(members)), f"{100 * maps.of(members, 'interslice', 'share')[0]:.1f}"]
        for peer in maps.peers:
            cases = [case for case in maps.having("interslice", peer) if case in members]
            enough = len({case[0] for case in cases}) >= ENOUGH
            row.append(between(maps.ahead(cases, peer, "share"), 1, 100, enough) if cases else "")
        rows.append(row)
    return table(["maps", "count", "interslice", *maps.peers], rows)


def terrain_real(maps):
    """RMSE in m of each program on the models of real places; the least in bold."""
    cases = [case for case in maps.maps if maps.kind[case] == "real"]
    rows = []
    for case in cases:
        found = {name: maps.rows.get((case, name), {}).get("rmse") for name in maps.programs}
        least = min(value for value in found.values() if value is not None)
        words = ["" if value is None else f"**{value:.1f}**" if value == least else f"{value:.1f}" for value in found.values()]
        rows.append([case[0], f"{maps.rows[case, TRUTH]['interval']:g}", *words])
    return table(["RMSE, m", "interval, m", *map(named, maps.programs)], rows)


def blocks():
    """The page's blocks by name."""
    maps = Maps(TERRAIN.read())
    if not maps.having("interslice", "SDF PCHIP"):
        raise SystemExit(f"{TERRAIN.path}: no map has both interslice and SDF PCHIP")
    return {f.__name__: f(maps) for f in (terrain, terrain_ahead, terrain_groups, terrain_real)}
