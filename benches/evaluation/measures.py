"""How near a mask is to the truth. Every program is measured by these, from its mask bool [z, y, x] of the thin slices.

The truth is the zero set of f, and its own voxels f < 0. `truth` among the programs is these voxels: what is left of a distance when every voxel is right.
"""

import numpy as np
from scipy.ndimage import label
from skimage.measure import euler_number, marching_cubes
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

from .programs import signed_distance

#: Vertices of a surface at which its distance from the other is measured, at most.
POINTS = 4000
#: Lower edges of the bins of confidence; the last has what is 1.
CONFIDENCES = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999, 1)


def dice(truth, mask, places):
    """2 |A and B| / (|A| + |B|) over the slices that were not given."""
    rest = np.delete(np.arange(len(truth)), places)
    a, b = truth[rest], mask[rest]
    return 2 * np.count_nonzero(a & b) / max(np.count_nonzero(a) + np.count_nonzero(b), 1)


def surface(volume, level, spacing):
    """Marching cubes: vertices [n, 3] in mm and triangles [m, 3]. Open at the first and the last slice, closed at the image's border."""
    outside = float(volume.max()) + 1 if level == 0 else 0.0
    padded = np.pad(volume.astype(np.float32), ((0, 0), (1, 1), (1, 1)), constant_values=outside)
    vertices, triangles, _, _ = marching_cubes(padded, level, spacing=spacing)
    return vertices.astype(float), triangles


def distances(points, other):
    """Distance of points [n, 3] from the triangles of the other surface."""
    vertices, triangles = other
    mesh, corners, cells, out = vtkPolyData(), vtkPoints(), vtkCellArray(), vtkDoubleArray()
    corners.SetData(numpy_to_vtk(vertices, deep=True))
    offsets = np.arange(0, 3 * len(triangles) + 1, 3)
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(triangles.ravel().astype(np.int64), deep=True))
    mesh.SetPoints(corners)
    mesh.SetPolys(cells)
    function = vtkImplicitPolyDataDistance()
    function.SetInput(mesh)
    function.EvaluateFunction(numpy_to_vtk(np.ascontiguousarray(points), deep=True), out)
    return np.abs(vtk_to_numpy(out))


def surface_distances(one, other):
    """Mean and 95 % of the distances of either surface's vertices from the other, mm; the mean is that of both ways' means."""
    ways = []
    for (vertices, _), against in ((one, other), (other, one)):
        if len(vertices) > POINTS:
            vertices = np.random.default_rng(0).choice(vertices, POINTS, replace=False)
        ways.append(distances(vertices, against))
    return float(np.mean([w.mean() for w in ways])), float(np.percentile(np.concatenate(ways), 95))


def topology(mask):
    """Pieces (of 26 neighbours), handles and voids: beta_0, beta_1 and beta_2, with Euler number beta_0 - beta_1 + beta_2."""
    padded = np.pad(mask, 1)
    pieces = label(padded, np.ones((3, 3, 3)))[1]
    voids = label(~padded)[1] - 1
    return pieces, pieces + voids - int(euler_number(padded, connectivity=3)), voids


def crease(mask, given):
    """Root mean square, degrees, of the angle by which the surface turns at a given slice, at pixels within one of its contour.

    The inclination is arctan(d phi / d z) of the in-plane distances phi, from the slice to half the smaller gap above it, and from as far below.
    Voxels alone give a few degrees, so that this is compared with the same measure of the truth's voxels. NaN where no such pixel is.
    """
    sides, angles = given.spacing[1:], []
    for below, place, above in zip(given.places, given.places[1:], given.places[2:]):
        step = max(min(place - below, above - place) // 2, 1)
        layers = [mask[z] for z in (place - step, place, place + step)]
        if not all(layer.any() for layer in layers):
            continue
        low, here, high = (signed_distance(layer, sides) for layer in layers)
        near = np.abs(here) <= np.mean(sides)
        rise = step * given.spacing[0]
        angles.append(np.arctan((high - here)[near] / rise) - np.arctan((here - low)[near] / rise))
    turned = np.concatenate(angles) if angles else np.zeros(0)
    return float(np.degrees(np.sqrt(np.mean(turned**2)))) if len(turned) else float("nan")


def measure(body, mask, truth_surface):
    """All measures of a mask, by name."""
    given, voxel = body.given, float(np.prod(body.given.spacing))
    mean, most = surface_distances(surface(mask, 0.5, given.spacing), truth_surface)
    pieces, handles, voids = topology(mask)
    return {
        "dice": dice(body.truth, mask, given.places),
        "distance": mean,
        "distance95": most,
        "volume": 100 * (np.count_nonzero(mask) * voxel / body.volume - 1),
        "pieces": pieces,
        "handles": handles,
        "voids": voids,
        "crease": crease(mask, given),
        "changed": int(np.count_nonzero(mask[given.places] != given.masks)),
    }


def reliability(body, mask, confidence):
    """Voxels of the slices that were not given, those of them that are right, and the mean of what is stated, by its bins: "count:right:mean ..."."""
    rest = np.delete(np.arange(len(mask)), body.given.places)
    right, stated = mask[rest] == body.truth[rest], confidence[rest].ravel().astype(float)
    bins = np.digitize(confidence[rest].ravel(), np.array(CONFIDENCES[1:], np.float32))
    counts, rights, sums = (np.bincount(bins, w, len(CONFIDENCES)) for w in (None, right.ravel(), stated))
    return " ".join(f"{n:.0f}:{r:.0f}:{s / max(n, 1):.5g}" for n, r, s in zip(counts, rights, sums))
