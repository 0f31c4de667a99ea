"""The file of results: a row for each body and program. Python's standard library is enough."""

import csv
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
RESULTS = FOLDER / "results.csv"
#: The truth's own voxels, which are measured as a program; its row says what the body is.
TRUTH = "truth"
#: Measures of a mask (measures.py), then the CPU seconds of the call, user and system.
MEASURES = ("dice", "distance", "distance95", "volume", "pieces", "handles", "voids", "crease", "changed", "seconds")
#: Of the body, in the row of its truth: class, gaps of unlike width or not, mean gap and inradius in mm, longest pixel side over shortest.
BODY = ("kind", "irregular", "gap", "inradius", "long")
#: Of interslice's own judgement, in the row of its default: Dice and mean distance of `evaluate --leave 2`, and bins of confidence.
JUDGEMENT = ("holdout", "holdout_distance", "confidence")
COLUMNS = ("body", "program", *MEASURES, "failure", *BODY, *JUDGEMENT)


def short(value):
    """A value as it stands in the file: four significant digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def append(path, row):
    """Adds a row, and the names of columns to a file that is not there yet."""
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow({name: short(value) for name, value in row.items()})


def read(path=RESULTS):
    """Rows by body and program, numbers as float; what is empty is left out. A last line that was cut short is an error."""
    if not path.exists():
        return {}
    words = {"program", "failure", "kind", "confidence"}
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = {}
    for row in rows:
        if None in row or None in row.values():
            raise SystemExit(f"{path}: the row of body {row['body']}, {row['program']}, has not {len(COLUMNS)} columns; delete it and run again")
        row = {k: v if k in words else float(v) for k, v in row.items() if v != ""}
        found[int(row["body"]), row["program"]] = row
    return found
