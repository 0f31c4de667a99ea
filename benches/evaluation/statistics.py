"""Means, paired differences and shares of the rows of results, with 95 % intervals of a seeded bootstrap over bodies."""

import numpy as np
from scipy.optimize import minimize_scalar

from .measures import CONFIDENCES
from .programs import PROGRAMS
from .results import TRUTH

RESAMPLES = 4000
#: Gap over inradius, lower edges of the bins.
GAPS = (0.0, 0.25, 0.5, 1.0, 2.0)
#: Right side up: what a difference has to be multiplied by so that more is better.
MEASURES = {"dice": 1, "distance": -1, "distance95": -1, "volume": -1, "pieces": 1, "handles": 1, "crease": -1}
#: The k of the confidence that the program writes (src/surface/origin.rs).
SCALE = 0.63


def mean(values):
    """Mean, and the ends of its interval: 2.5 and 97.5 % of the means of resampled bodies."""
    values = np.asarray(values, float)
    picks = np.random.default_rng(0).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.percentile(values[picks].mean(1), (2.5, 97.5))
    return float(values.mean()), float(low), float(high)


def clustered(values, cluster):
    """The mean of each cluster's values, by a dict of values by case: cases of one terrain, or of one structure, count as one."""
    found = {}
    for case, value in values.items():
        if np.isfinite(value):
            found.setdefault(cluster(case), []).append(value)
    return [np.mean(v) for v in found.values()]


def score(rows, body, program, measure):
    """A measure of a row as it is averaged: volume without its sign, pieces and handles right (1) or not (0), crease by that of the truth's voxels."""
    row, truth = rows[body, program], rows[body, TRUTH]
    if measure == "volume":
        return abs(row["volume"])
    if measure in ("pieces", "handles"):
        return float(row[measure] == truth[measure])
    if measure == "crease":
        return row.get("crease", np.nan) / truth.get("crease", np.nan)
    return row[measure]


class Scores:
    """Rows as arrays over bodies."""

    def __init__(self, rows):
        self.rows = rows
        self.bodies = [b for b, program in rows if program == TRUTH]
        self.kind = {b: rows[b, TRUTH]["kind"] for b in self.bodies}
        self.gap = {b: rows[b, TRUTH]["gap"] / rows[b, TRUTH]["inradius"] for b in self.bodies}
        self.truth = {b: rows[b, TRUTH] for b in self.bodies}
        self.programs = [name for name in PROGRAMS if any((b, name) in rows for b in self.bodies)]

    def having(self, *programs):
        """Bodies of which each program has made something."""
        return [b for b in self.bodies if all("dice" in self.rows.get((b, p), {}) for p in programs)]

    def failures(self, program):
        return sum("failure" in self.rows.get((b, program), {}) for b in self.bodies)

    def of(self, bodies, program, measure):
        """A measure over bodies; where a crease has no value, both it and its body are left out."""
        values = np.array([score(self.rows, b, program, measure) for b in bodies])
        return values[np.isfinite(values)]

    def ahead(self, bodies, peer, measure, ours="interslice"):
        """Ours less the peer's, body by body, turned so that more is better for us; of a crease its distance from 1."""
        values = [np.array([score(self.rows, b, p, measure) for b in bodies]) for p in (ours, peer)]
        if measure == "crease":
            values = [np.abs(v - 1) for v in values]
        differences = MEASURES[measure] * (values[0] - values[1])
        return differences[np.isfinite(differences)]

    def groups(self):
        """Names of groups of bodies, and what is in them: all, classes, gaps, kinds of slices and pixels."""
        yield "all", self.bodies
        for kind in dict.fromkeys(self.kind.values()):
            yield kind, [b for b in self.bodies if self.kind[b] == kind]
        for low, high in zip(GAPS, (*GAPS[1:], np.inf)):
            name = f"gap below {high:g} inradius" if low == 0 else f"{low:g} to {high:g}" if high < np.inf else f"{low:g} and more"
            yield name, [b for b in self.bodies if low <= self.gap[b] < high]
        for flag, name in ((0, "equal gaps"), (1, "unlike gaps")):
            yield name, [b for b in self.bodies if self.truth[b]["irregular"] == flag]
        for long, name in ((False, "square pixels"), (True, "pixels of 1 to 2")):
            yield name, [b for b in self.bodies if (self.truth[b]["long"] > 1.5) == long]

    def confidences(self):
        """Voxels, right voxels and those that would be right by what is stated, by bins of confidence, [bodies, bins, 3], and their bodies."""
        bodies = [b for b in self.bodies if "confidence" in self.rows.get((b, "interslice"), {})]
        words = [self.rows[b, "interslice"]["confidence"].split() for b in bodies]
        found = np.array([[[float(n) for n in word.split(":")] for word in row] for row in words])
        found[:, :, 2] *= found[:, :, 0]
        return found, np.array(bodies)


def shares(counts):
    """Share of right voxels of each bin, with its interval over bodies: [3, bins]."""
    picks = np.random.default_rng(0).integers(len(counts), size=(RESAMPLES // 4, len(counts)))
    weights = np.apply_along_axis(np.bincount, 1, picks, minlength=len(counts)).astype(float)
    voxels, right = weights @ counts[:, :, 0], weights @ counts[:, :, 1]
    low, high = np.percentile(right / np.maximum(voxels, 1), (2.5, 97.5), axis=0)
    total = counts.sum(0)
    return np.stack([total[:, 1] / np.maximum(total[:, 0], 1), low, high])


def stated(counts):
    """Mean confidence of each bin, the lower edge where it is empty."""
    total = counts.sum(0)
    return np.where(total[:, 0] > 0, total[:, 2] / np.maximum(total[:, 0], 1), CONFIDENCES)


def fit(counts):
    """The k of `1 - (1 + |phi| / (k u))^-2 / 2` of least log loss over the voxels of all bins but the last, by the bins' mean confidences."""
    total, p = counts.sum(0)[:-1], stated(counts)[:-1]
    distance = SCALE * ((2 * (1 - p)) ** -0.5 - 1)

    def loss(k):
        q = 1 - 0.5 * (1 + distance / k) ** -2
        return -np.sum(total[:, 1] * np.log(q) + (total[:, 0] - total[:, 1]) * np.log(1 - q))

    return float(minimize_scalar(loss, bounds=(0.05, 5), method="bounded").x)


def calibration_error(counts):
    """Mean of |stated - share of right| over the voxels below 1, each bin by its voxels."""
    voxels, right, said = counts.sum(0)[:-1].T
    return float(np.sum(np.abs(said - right)) / voxels.sum())
