"""The programs: each takes `Given` and gives a mask bool [z, y, x] on all thin slices, or a field that is negative inside.

Each is called as its own users would, on one thread. None is told anything but the given slices, their places and the spacing.
"""

import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import distance_transform_edt, map_coordinates

from .bodies import Given

PROGRAM = os.environ.get("INTERSLICE", "target/release/interslice")


def signed_distance(mask, sides):
    """In-plane distance from the contour, mm, negative inside; the contour lies half a pixel off the outermost pixels' centres."""
    outside, inside = (distance_transform_edt(m, sampling=sides) for m in (~mask, mask))
    half = (sides[0] + sides[1]) / 4
    return np.where(mask, half - inside, outside - half)


def signed_distances(given):
    return np.stack([signed_distance(mask, given.spacing[1:]) for mask in given.masks])


def linear(given):
    """phi = (1 - t) phi_0 + t phi_1."""
    phi, out = signed_distances(given), []
    for z in range(given.places[-1] + 1):
        k = min(np.searchsorted(given.places, z, side="right"), len(given.places) - 1)
        low, high = given.places[k - 1], given.places[k]
        t = (z - low) / (high - low)
        out.append((1 - t) * phi[k - 1] + t * phi[k])
    return np.stack(out)


def cubic(given):
    """The natural cubic spline of each pixel's distance."""
    return CubicSpline(given.heights, signed_distances(given), bc_type="natural")(given.thin_heights)


def pchip(given):
    """The monotone cubic of Fritsch and Carlson of each pixel's distance."""
    return PchipInterpolator(given.heights, signed_distances(given))(given.thin_heights)


def interslice(given, *options, wanted=("mask",)):
    """The command line, files and all: a label volume of the given slices in, masks or what else is `wanted` out."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "in.npy"), Path(folder, "out.npy")
        np.save(source, given.sparse())
        dz, dy, dx = given.spacing
        command = [PROGRAM, "reconstruct", source, "--axis", "z", "--spacing", f"{dx:.9g},{dy:.9g},{dz:.9g}", "-q"]
        outputs = {"mask": target, "confidence": Path(folder, "out.confidence.npy")}
        for name in wanted:
            command += ["-o", outputs[name]]
        subprocess.run([*command, "--backend", "cpu", "--threads", "1", *options], check=True, timeout=300)
        found = [np.load(outputs[name]) for name in wanted]
    return found[0].astype(bool) if len(found) == 1 else (found[0].astype(bool), *found[1:])


def hold_out(given):
    """What `interslice evaluate --leave 2` says of the given slices, None where it has fewer than four of them."""
    if len(given.places) < 4:
        return None
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "in.npy")
        np.save(source, given.sparse())
        dz, dy, dx = given.spacing
        command = [PROGRAM, "evaluate", source, "--axis", "z", "--spacing", f"{dx:.9g},{dy:.9g},{dz:.9g}", "--leave", "2", "--json"]
        answer = subprocess.run([*command, "--backend", "cpu"], check=True, timeout=300, capture_output=True, text=True)
    return json.loads(answer.stdout)


def on_squares(call):
    """A program that knows no sides of pixels, on masks whose pixels are cut into squares; a pixel is inside where half of its squares are."""

    def squared(given):
        dz, dy, dx = given.spacing
        rows, columns = max(round(dy / dx), 1), max(round(dx / dy), 1)
        masks = given.masks.repeat(rows, 1).repeat(columns, 2)
        found = call(Given(masks, given.places, (dz, dy / rows, dx / columns)))
        depth, (height, width) = len(found), given.masks.shape[1:]
        return found.reshape(depth, height, rows, width, columns).mean((2, 4)) >= 0.5

    return squared


@on_squares
def itk_contours(given):
    """MorphologicalContourInterpolator, as 3D Slicer and ITK-SNAP call it: along z, with its default distance transform and alignment."""
    import itk

    image = itk.image_from_array(given.sparse())
    made = itk.MorphologicalContourInterpolator.New(image)
    made.SetAxis(2)
    made.Update()
    return itk.array_from_image(made.GetOutput()).astype(bool)


@on_squares
def napari_labels(given):
    """`interpolate_sdf` of napari-label-interpolator, from slice to slice."""
    from napari_label_interpolator.interpolator import interpolate_sdf

    return np.asarray(interpolate_sdf(given.sparse(), 0, 0)).astype(bool)


@on_squares
def napari_annotator(given):
    """The distance-based way of napari-nD-annotator, from slice to slice with the weights that its worker takes."""
    from napari_nd_annotator._widgets.interpolation_widget import average_mask

    out = given.sparse().astype(bool)
    for k, (low, high) in enumerate(zip(given.places, given.places[1:])):
        for z in range(low + 1, high):
            out[z] = average_mask(given.masks[k].astype(np.uint8), given.masks[k + 1].astype(np.uint8), high - z, z - low) > 0
    return out


@on_squares
def vtk_contours(given):
    """vtkVoxelContoursToSurfaceFilter, then voxels of its closed surface by a stencil.

    The filter takes polygons of whole numbers: contours half way between pixels (marching squares) on a grid of half pixels. It is linear within a
    gap, so that slices numbered 0, 1, 2, ... are moved to their heights afterwards. Its surface has flat parts in the planes of the given slices,
    where the stencil may go either way: these slices are put back.
    """
    import vtk
    from skimage.measure import find_contours
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    points, polygons = vtk.vtkPoints(), vtk.vtkCellArray()
    for k, mask in enumerate(given.masks):
        for line in find_contours(np.pad(mask, 1).astype(float), 0.5):
            polygons.InsertNextCell(len(line) - 1)
            for y, x in np.rint(2 * line[:-1]):
                polygons.InsertCellPoint(points.InsertNextPoint(x, y, k))
    contours = vtk.vtkPolyData()
    contours.SetPoints(points)
    contours.SetPolys(polygons)
    surface = vtk.vtkVoxelContoursToSurfaceFilter()
    surface.SetInputData(contours)
    surface.Update()
    mesh = surface.GetOutput()
    corners = vtk_to_numpy(mesh.GetPoints().GetData()).astype(float)
    corners[:, :2] = corners[:, :2] / 2 - 1
    corners[:, 2] = np.interp(corners[:, 2], np.arange(len(given.places)), given.places)
    moved = vtk.vtkPoints()
    moved.SetData(numpy_to_vtk(corners, deep=True))
    mesh.SetPoints(moved)
    depth, height, width = (int(n) for n in (given.places[-1] + 1, *given.masks.shape[1:]))
    stencil = vtk.vtkPolyDataToImageStencil()
    stencil.SetInputData(mesh)
    stencil.SetOutputWholeExtent(0, width - 1, 0, height - 1, 0, depth - 1)
    image = vtk.vtkImageStencilToImage()
    image.SetInputConnection(stencil.GetOutputPort())
    image.SetOutputScalarTypeToUnsignedChar()
    image.Update()
    out = vtk_to_numpy(image.GetOutput().GetPointData().GetScalars()).reshape(depth, height, width) > 0
    out[given.places] = given.masks
    return out


def warp(phi, shift):
    """phi(x + shift), both in pixels; shift [2, y, x]."""
    return map_coordinates(phi, np.indices(phi.shape) + shift, order=1, mode="nearest")


@on_squares
def syn(given):
    """SyN (ANTs) of the distances of neighbouring given slices, clamped at 12 pixels: phi = (1 - t) phi_0(x + t v) + t phi_1(x + (1 - t) u).

    u takes the lower slice's grid to the upper slice, v the other way.
    """
    import ants

    phi = np.clip(signed_distances(given) / min(given.spacing[1:]), -12, 12).astype(np.float32)
    out = np.empty((given.places[-1] + 1, *phi.shape[1:]), np.float32)
    out[given.places] = phi
    for k, (low, high) in enumerate(zip(given.places, given.places[1:])):
        with tempfile.TemporaryDirectory() as folder:
            fixed, moving = (ants.from_numpy(p) for p in phi[k : k + 2])
            found = ants.registration(
                fixed, moving, type_of_transform="SyNOnly", syn_metric="meansquares", reg_iterations=(40, 40, 20), random_seed=1, outprefix=f"{folder}/"
            )
            u = np.moveaxis(ants.image_read(found["fwdtransforms"][0]).numpy(), -1, 0)
            v = np.moveaxis(ants.image_read(next(p for p in found["invtransforms"] if p.endswith(".nii.gz"))).numpy(), -1, 0)
        for z in range(low + 1, high):
            t = (z - low) / (high - low)
            out[z] = (1 - t) * warp(phi[k], t * v) + t * warp(phi[k + 1], (1 - t) * u)
    return out < 0


def interslice_field(given):
    return interslice(given, "--method", "field")


def interslice_morph(given):
    return interslice(given, "--motion", "none", "--fair", "0")


#: Name in tables: the call, and every how many bodies it is tried on.
PROGRAMS = {
    "interslice": (interslice, 1),
    "interslice --method field": (interslice_field, 1),
    "interslice morph alone": (interslice_morph, 1),
    "SDF linear": (linear, 1),
    "SDF cubic": (cubic, 1),
    "SDF PCHIP": (pchip, 1),
    "ITK MCI": (itk_contours, 1),
    "VTK": (vtk_contours, 1),
    "napari-label-interpolator": (napari_labels, 1),
    "napari-nD-annotator": (napari_annotator, 1),
    "SyN": (syn, 9),
}
#: Calls that start a program, files and all. The others are called once before they are timed.
COMMANDS = (interslice, interslice_field, interslice_morph)
WARM = Given(np.pad(np.ones((3, 8, 8), bool), ((0, 0), (4, 4), (4, 4))), np.array([0, 3, 6]), (1.0, 1.0, 1.0))


def load():
    """Imports what is slow to import, so that no call pays for it. No filter runs: threads that it started would be missing in a child."""
    import ants  # noqa: F401
    import itk
    import napari_label_interpolator.interpolator  # noqa: F401
    import napari_nd_annotator._widgets.interpolation_widget  # noqa: F401
    import vtk  # noqa: F401

    itk.MorphologicalContourInterpolator  # noqa: B018


def mask_of(answer):
    """A mask, of a mask or of a field that is negative inside."""
    return answer if answer.dtype == bool else answer < 0
