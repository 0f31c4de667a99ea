"""The files of results: a row for each case and program. Python's standard library is enough."""

import csv
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
#: The truth itself, which is measured as a program; its row says what the case is.
TRUTH = "truth"
#: Measures of a mask (measures.py), then the CPU seconds of the call, user and system.
MASK = ("dice", "distance", "distance95", "volume", "pieces", "handles", "voids", "crease", "changed", "seconds")
#: Of the body, in the row of its truth: class, gaps of unlike width or not, mean gap and inradius in mm, longest pixel side over shortest.
BODY = ("kind", "irregular", "gap", "inradius", "long")
#: Of interslice's own judgement, in the row of its default: Dice and mean distance of `evaluate --leave 2`, and bins of confidence.
JUDGEMENT = ("holdout", "holdout_distance", "confidence")
#: Measures of heights (terrain_measures.py), then CPU seconds.
HEIGHTS = ("rmse", "share", "off95", "slope", "outside", "terraces", "covered", "seconds")
#: Of the contour map, in the row of its truth: kind of terrain, interval in m, and how many contour heights it has.
MAP = ("kind", "interval", "levels")
#: Columns that are no numbers.
WORDS = {"program", "failure", "kind", "confidence", "terrain", "volume_of"}


def short(value):
    """A value as it stands in a file: four significant digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Results:
    """A file of results. Its first columns say what a row is of; the last of them is the program."""

    path: Path
    case: tuple
    columns: tuple

    def append(self, row):
        """Adds a row, and the names of columns to a file that is not there yet."""
        new = not self.path.exists()
        with self.path.open("a", newline="") as file:
            writer = csv.DictWriter(file, (*self.case, "program", *self.columns), lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow({name: short(value) for name, value in row.items()})

    def read(self):
        """Rows by case (a tuple where it has several columns) and program, numbers as float; what is empty is left out. A last line that was cut
        short is an error."""
        if not self.path.exists():
            return {}
        with self.path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        found = {}
        for row in rows:
            case = tuple(row[name] if name in WORDS else int(row[name]) for name in self.case)
            if None in row or None in row.values():
                raise SystemExit(f"{self.path}: the row of {' '.join(map(str, case))}, {row['program']}, is cut short; delete it and run again")
            row = {k: v if k in WORDS else float(v) for k, v in row.items() if v != ""}
            found[case if len(case) > 1 else case[0], row["program"]] = row
        return found


BODIES = Results(FOLDER / "results.csv", ("body",), (*MASK, "failure", *BODY, *JUDGEMENT))
TERRAIN = Results(FOLDER / "terrain.csv", ("terrain", "heights"), (*HEIGHTS, "failure", *MAP))
VOLUMES = Results(FOLDER / "volumes.csv", ("volume_of", "label", "step"), (*MASK, "failure", *BODY))
