"""The measures on bodies whose answers are known. `benches/evaluation/run --test`."""

import numpy as np

from . import bodies, measures, terrain_measures, terrain_programs, terrains, volumes
from .bodies import Given


def near(name, value, expected, tolerance):
    """Says the value, and ends where it is not within the tolerance of what is expected."""
    print(f"{name}: {value:.4g}, expected {expected:.4g} within {tolerance:g}")
    if not abs(value - expected) <= tolerance:
        raise SystemExit(f"{name}: {value} is not within {tolerance:g} of {expected}")


def grid(count):
    """z, y, x of voxel centres about the origin, side 1 mm."""
    line = np.arange(count) - (count - 1) / 2
    return line[:, None, None], line[None, :, None], line[None, None, :]


def overlap():
    """Two cubes of side 20, one shifted by 5: 2 * 15 / (20 + 20)."""
    one, other = np.zeros((2, 20, 40, 40), bool)
    one[:, 10:30, 10:30] = other[:, 10:30, 15:35] = True
    near("Dice of a shifted cube", measures.dice(one, other, [0, 19]), 0.75, 1e-12)
    other[5] = False
    near("Dice, the slice that differs is a given one", measures.dice(one, other, [0, 5, 19]), 0.75, 1e-12)


def surfaces():
    """Spheres of radius 20 and 21, exact and in voxels, on voxels of 2 x 1 x 1 mm; a sphere's area by samples within pixels."""
    z, y, x = grid(60)
    spacing, radius = (2.0, 1.0, 1.0), np.sqrt((2 * z) ** 2 + y**2 + x**2)
    exact = measures.surface(radius - 20, 0, spacing)
    mean, most = measures.surface_distances(exact, measures.surface(radius - 21, 0, spacing))
    near("distance of spheres of radius 20 and 21", mean, 1, 0.03)
    near("the same, 95 %", most, 1, 0.06)
    mean, _ = measures.surface_distances(exact, measures.surface(radius < 20, 0.5, spacing))
    near("distance of a sphere's voxels from it", mean, 0.25, 0.15)
    line = np.arange(60) - 29.5
    area = bodies.mask_area(lambda z, y, x: np.sqrt(z**2 + y**2 + x**2) - 20, 12.0, line, line)
    near("area of a sphere's section, % off", 100 * (area / (np.pi * (400 - 144)) - 1), 0, 0.1)


def topologies():
    """A torus, a hollow ball, the same cut open by the first slice, and two balls."""
    z, y, x = grid(60)
    ball = np.sqrt(z**2 + y**2 + x**2)
    torus = np.hypot(np.hypot(z, x) - 18, y) < 6
    two = np.minimum(np.sqrt((z - 15) ** 2 + y**2 + x**2), np.sqrt((z + 15) ** 2 + y**2 + x**2)) < 10
    hollow = np.abs(ball - 20) < 3
    expected = {
        "a torus": (torus, (1, 1, 0)),
        "a hollow ball": (hollow, (1, 0, 1)),
        "a hollow ball that is cut open": (hollow[30:], (1, 0, 0)),
        "two balls": (two, (2, 0, 0)),
    }
    for name, (mask, counts) in expected.items():
        for what, value, wanted in zip(("pieces", "handles", "voids"), measures.topology(mask), counts):
            near(f"{what} of {name}", value, wanted, 0)


def creases():
    """Cones that meet at the middle slice: it turns by twice arctan(slope). A cone alone turns by nothing."""
    z, y, x = grid(81)
    given = Given(np.zeros((3, 81, 81), bool), np.array([0, 40, 80]), (1.0, 1.0, 1.0))
    for slope in (0.25, 0.5):
        double, single = np.hypot(y, x) < 12 + slope * np.abs(z), np.hypot(y, x) < 22 + slope / 2 * z
        near(f"crease of cones of slope {slope}", measures.crease(double, given), np.degrees(2 * np.arctan(slope)), 2.5)
        near(f"crease of a cone of slope {slope / 2}", measures.crease(single, given), 0, 2.5)


def reliabilities():
    """Half of the voxels at confidence 0.95 are right, and all at 1."""
    body = bodies.body(0)
    mask, confidence = body.truth.copy(), np.ones(body.truth.shape, np.float32)
    free = [z for z in range(len(mask)) if z not in body.given.places]
    confidence[free[0]] = 0.955
    mask[free[0], : mask.shape[1] // 2] ^= True
    bins = [tuple(map(float, word.split(":"))) for word in measures.reliability(body, mask, confidence).split()]
    count, right, _ = bins[measures.CONFIDENCES.index(0.95)]
    near("share of right voxels at 0.955", right / count, 0.5, 0.02)
    near("what is stated of them", bins[measures.CONFIDENCES.index(0.95)][2], 0.955, 1e-4)
    near("share of right voxels at 1", bins[-1][1] / bins[-1][0], 1, 0)
    near("voxels in all bins", sum(n for n, _, _ in bins), len(free) * mask[0].size, 0)


def series():
    """Body 11 is the same each time, its given slices are those of the truth, and body 19 is of the same class but another."""
    one, again, other = bodies.body(11), bodies.body(11), bodies.body(19)
    near("voxels of body 11 that differ from body 11", np.count_nonzero(one.truth != again.truth), 0, 0)
    near("given voxels that differ from the truth", np.count_nonzero(one.truth[one.given.places] != one.given.masks), 0, 0)
    near("bodies 11 and 19 have the same volume (1: yes)", float(one.volume == other.volume), 0, 0)
    near("volume of body 11 in voxels, % of its samples", 100 * one.truth.sum() * np.prod(one.given.spacing) / one.volume, 100, 0.5)


def heights():
    """A plane that rises by 1 in 10, contours every 5 m: heights 1 m too high, stairs, and none at all in a quarter."""
    plane, levels, spacing = np.tile(np.arange(200) / 2, (100, 1)), np.arange(5.0, 96, 5), (4.0, 5.0)
    of = lambda made: terrain_measures.measure(plane, made, levels, 5.0, spacing)  # noqa: E731
    near("RMSE of heights 1 m too high", of(plane + 1)["rmse"], 1, 1e-9)
    near("the same as a share of the interval of 5 m", of(plane + 1)["share"], 0.2, 1e-9)
    near("cells outside their band by more than 0.25 m, %: the uppermost of ten", of(plane + 1)["outside"], 1800 / 179, 1e-9)
    near("cells outside their band of the truth, %", of(plane)["outside"], 0, 0)
    near("slope error of a plane twice as steep, degrees", of(2 * plane)["slope"], np.degrees(np.arctan(0.2) - np.arctan(0.1)), 1e-9)
    near("terraces of stairs at the contours' heights", of(np.floor(plane / 5) * 5)["terraces"], 179 / 17, 1e-9)
    holed = np.where(np.arange(200) < 50, np.nan, plane)
    near("cells with a height of their own, %", of(holed)["covered"], 100 * (190 - 50) / 179, 1e-9)


def maps():
    """The contour map of a plane has its lines where the plane has their heights, and its cells above them; terrain 3 is the same each time."""
    plane = np.tile(np.arange(81) / 2, (41, 1))
    given = terrains.Terrain("plane", "plane", plane + 0.25, 2, (10.0, 10.0)).map(8.0)
    near("contour heights of a plane from 0.25 to 40.25 m, every 8 m", len(given.levels), 5, 0)
    near("off the place of a contour, m", max(np.abs(line[:, 0] - (level - 0.25) * 10).max() for level, line in given.lines), 0, 1e-9)
    near("cells above 8 m", given.above[0].mean(), 33 / 41, 1e-12)
    distances = terrain_programs.line_distances(given)
    near("off the distance of the south-west corner from 8 m, m", distances[0, -1, 0] - 77.5, 0, 1e-9)
    height = terrain_programs.volume(given, lambda levels, phi: lambda layers: np.stack([np.interp(layer, levels, range(5)) * 80 + phi[0] for layer in layers]))
    near("off the height read off a volume, m", np.nanmax(np.abs(height - plane[::2, ::2] - 0.25)), 0, 1e-9)
    one, again = terrains.terrain(3), terrains.terrain(3)
    near("heights of terrain 3 that differ from terrain 3", np.count_nonzero(one.fine != again.fine), 0, 0)


def structures():
    """A ball of label 7 of which every fourth slice is given, from its first one."""
    z, y, x = grid(60)
    labels = np.where(np.sqrt(z**2 + y**2 + x**2) < 20, 7, 0)
    found = volumes.structure(labels, (2.0, 1.0, 1.0), 7, 4)
    near("given slices of a ball of 40", len(found.given.places), 10, 0)
    near("given voxels that differ from the truth", np.count_nonzero(found.truth[found.given.places] != found.given.masks), 0, 0)
    near("voxels of the ball up to its last given slice", found.truth.sum(), (labels == 7)[:47].sum(), 0)


def run():
    for test in (overlap, surfaces, topologies, creases, reliabilities, series, heights, maps, structures):
        test()
    print("the measures give the known answers")
