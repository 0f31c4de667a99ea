"""Bodies with exact truth: f(x, y, z) < 0 is inside, f in mm near its zero set. Body k is the same wherever it is drawn.

A body lies in a ball of radius `scale` mm about the origin, turned at random, and is sampled at the voxel centres of thin slices. Some of these are
given, and what lies between the first and the last of them is the truth. Arrays have axes z, y, x, spacings are (dz, dy, dx) in mm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation

CLASSES = ("sphere", "ellipsoid", "torus", "cylinder", "cone", "tubes", "gyroid", "shell")
SEED = 20261124


@dataclass
class Given:
    """What a program is told: masks bool [n, y, x] on `places` (int [n], thin slices counted from the first of them), and the spacing."""

    masks: np.ndarray
    places: np.ndarray
    spacing: tuple

    @property
    def heights(self):
        """Heights of the given slices, mm."""
        return self.places * self.spacing[0]

    @property
    def thin_heights(self):
        """Heights of all thin slices from the first to the last given one, mm."""
        return np.arange(self.places[-1] + 1) * self.spacing[0]

    def sparse(self):
        """uint8 [z, y, x]: given slices painted with 1, the others empty."""
        out = np.zeros((self.places[-1] + 1, *self.masks.shape[1:]), np.uint8)
        out[self.places] = self.masks
        return out


@dataclass
class Body:
    """A body, its truth and what is given of it."""

    number: int
    kind: str
    irregular: bool
    given: Given
    #: f at the voxel centres of the thin slices, mm, float32 [z, y, x].
    field: np.ndarray
    #: Volume of the thin slices, mm3: areas where f < 0 by 8 x 8 samples a pixel, times dz.
    volume: float

    @property
    def truth(self):
        return self.field < 0

    @property
    def inradius(self):
        """Largest distance of a voxel of the truth from what is not the body, mm."""
        return float(distance_transform_edt(np.pad(self.truth, 1), sampling=self.given.spacing).max())

    @property
    def gap(self):
        """Mean distance of neighbouring given slices, mm."""
        return float(np.diff(self.given.heights).mean())


def capsule(p, a, b, radius):
    """Distance of points p [..., 3] from the segment a to b, less the radius."""
    along = b - a
    t = np.clip((p - a) @ along / (along @ along), 0, 1)
    return np.linalg.norm(p - a - t[..., None] * along, axis=-1) - radius


def smooth_minimum(a, b, k):
    """min(a, b), rounded where |a - b| < k (polynomial blend)."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0, 1)
    return b + (a - b) * h - k * h * (1 - h)


def ellipsoid(p, axes):
    """First-order distance k (k - 1) / |grad k^2 / 2| with k = |p / axes|; its zero set is the exact ellipsoid."""
    k = np.linalg.norm(p / axes, axis=-1)
    return k * (k - 1) / np.maximum(np.linalg.norm(p / axes**2, axis=-1), 1e-9)


def frustum(p, half, low, high):
    """Cone along z from radius `low` at -half to `high` at half: the largest of the distances from side and ends."""
    rho, z = np.hypot(p[..., 0], p[..., 1]), p[..., 2]
    slope = (high - low) / (2 * half)
    side = (rho - low - slope * (z + half)) / np.hypot(1, slope)
    return np.maximum(side, np.abs(z) - half)


def branches(rng):
    """Two to four tubes from the middle of a trunk's end, at least 40 degrees from each other."""
    radius = rng.uniform(0.09, 0.2)
    ways = [np.array([0.0, 0.0, -1.0])]
    wanted = rng.integers(3, 6)
    while len(ways) < wanted:
        way = Rotation.random(random_state=rng).apply([0.0, 0.0, 1.0])
        if max(way @ w for w in ways) < np.cos(np.radians(40)):
            ways.append(way)
    ends = [(w * (1 - radius), radius * rng.uniform(0.7, 1.0)) for w in ways]
    blend = rng.uniform(0.02, 0.1)

    def f(p):
        out = None
        for end, r in ends:
            tube = capsule(p, np.zeros(3), end, r)
            out = tube if out is None else smooth_minimum(out, tube, blend)
        return out

    return f


def gyroid(rng):
    """A sheet, or one of the two halves of space, about the gyroid, clipped by the unit ball."""
    wave = 2 * np.pi / rng.uniform(0.8, 1.5)
    shift, sheet = rng.uniform(0, 2 * np.pi, 3), rng.random() < 0.5
    half = rng.uniform(0.06, 0.1)

    def f(p):
        q = wave * p + shift
        s, c = np.sin(q), np.cos(q)
        g = (s[..., 0] * c[..., 1] + s[..., 1] * c[..., 2] + s[..., 2] * c[..., 0]) / (1.2 * wave)
        return np.maximum(np.abs(g) - half if sheet else g, np.linalg.norm(p, axis=-1) - 1)

    return f


def shape(kind, rng):
    """f of points [..., 3] for a body in the unit ball."""
    if kind == "sphere":
        return lambda p: np.linalg.norm(p, axis=-1) - 1
    if kind == "ellipsoid":
        axes = np.array([1.0, rng.uniform(0.4, 1.0), rng.uniform(0.25, 0.8)])
        return lambda p: ellipsoid(p, axes)
    if kind == "torus":
        tube = rng.uniform(0.12, 0.4)
        return lambda p: np.hypot(np.hypot(p[..., 0], p[..., 1]) - (1 - tube), p[..., 2]) - tube
    if kind == "cylinder":
        radius = rng.uniform(0.12, 0.6)
        return lambda p: frustum(p, np.sqrt(1 - radius**2), radius, radius)
    if kind == "cone":
        low, high = rng.uniform(0.3, 0.75), rng.uniform(0, 0.25)
        return lambda p: frustum(p, np.sqrt(1 - low**2), low, high)
    if kind == "tubes":
        return branches(rng)
    if kind == "gyroid":
        return gyroid(rng)
    if kind == "shell":
        axes, half = np.array([0.9, rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.9)]), rng.uniform(0.06, 0.12)
        return lambda p: np.abs(ellipsoid(p, axes)) - half
    raise ValueError(f"no class of bodies is called {kind}")


def choose_slices(rng, count, irregular):
    """Places of given slices among `count` that have the body: three or more, 2 to 12 thin slices apart."""
    while True:
        if irregular:
            steps = rng.integers(2, 13, count)
        else:
            steps = np.full(count, rng.integers(2, 13))
        places = rng.integers(steps[0]) + np.concatenate([[0], np.cumsum(steps)])
        places = places[places < count]
        if len(places) >= 3:
            return places


def mask_area(f, z, y, x):
    """Area of f < 0 on the plane z, in pixels: 8 x 8 samples in each pixel whose sign differs from a neighbour's."""
    inside = f(z, y[:, None], x[None, :]) < 0
    around = np.pad(inside, 1, mode="edge")
    corners = [around[a : a + len(y), b : b + len(x)] for a in range(3) for b in range(3)]
    edge = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    rows, columns = np.nonzero(edge)
    steps = (np.arange(8) - 3.5) / 8
    dy, dx = y[1] - y[0], x[1] - x[0]
    share = f(z, (y[rows] + steps[:, None, None] * dy), x[columns] + steps[None, :, None] * dx) < 0
    return inside[~edge].sum() + share.sum() / 64


def body(number, seed=SEED):
    """Body `number` of the series: its class is that of number modulo the count of classes."""
    rng = np.random.default_rng([seed, number])
    kind = CLASSES[number % len(CLASSES)]
    irregular = bool(rng.random() < 0.5)
    unit = shape(kind, rng)
    turn = Rotation.random(random_state=rng).as_matrix()
    dx = rng.uniform(0.6, 1.4)
    dy = dx * rng.choice([1.0, 0.5, 2.0], p=[0.7, 0.15, 0.15])
    scale = rng.uniform(28, 40) * dx
    centre = rng.uniform(-0.5, 0.5, 3) * dx

    def f(z, y, x):
        p = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
        return scale * unit((p - centre) @ turn / scale)

    line = np.linspace(-scale - dx, scale + dx, 64)
    z = line[(f(line[:, None, None], line[None, :, None], line[None, None, :]) < 0).any((1, 2))]
    dz = max((z[-1] - z[0]) / rng.integers(40, 81), 0.4 * dx)
    heights = np.arange(z[0] - 2 * dz, z[-1] + 2 * dz, dz)
    y, x = (d * np.arange(-np.ceil(scale / d) - 4, np.ceil(scale / d) + 5) for d in (dy, dx))
    field = f(heights[:, None, None], y[None, :, None], x[None, None, :]).astype(np.float32)
    drawn = np.flatnonzero((field < 0).any((1, 2)))
    places = drawn[0] + choose_slices(rng, drawn[-1] - drawn[0] + 1, irregular)
    field = np.ascontiguousarray(field[places[0] : places[-1] + 1])
    heights = heights[places[0] : places[-1] + 1]
    areas = sum(mask_area(f, height, y, x) for height in heights)
    places = places - places[0]
    given = Given(field[places] < 0, places, (float(dz), float(dy), float(dx)))
    return Body(number, kind, irregular, given, field, float(areas * dz * dy * dx))
