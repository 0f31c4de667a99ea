"""Volumes and ROIs as they are in files, and label volumes into files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from interslice import _native
from interslice._images import has_place, image
from interslice._numbers import Spacing, Vector, numbers, whole, wholes

class Segment(NamedTuple):
    """Name and colour (red, green, blue, 0 to 255) of a label, as far as they are known."""

    name: str | None = None
    colour: tuple[int, int, int] | None = None


class Volume(NamedTuple):
    """A volume as it is in a file."""

    arrays: list[NDArray[Any]]
    """Voxels, axes (z, y, x); several arrays where the file has layers of segments that may overlap."""
    grey: bool
    """Whether the voxels are grey values, not labels."""
    segments: dict[int, Segment]
    """What the file says of labels."""
    spacing: tuple[float, float, float]
    """Distance of voxels along the axes of the arrays: (dz, dy, dx)."""
    origin: tuple[float, float, float]
    """Place of the first voxel in the world (LPS)."""
    axes: tuple[tuple[float, float, float], ...]
    """Directions of x, y and z, unit vectors in the world (LPS)."""
    unit: str
    spaced: bool
    """Whether the file says how far apart voxels are; else they are 1 apart."""
    format: str


class Roi(NamedTuple):
    """A region of interest of an RTSTRUCT."""

    number: int
    name: str
    colour: tuple[int, int, int] | None
    contours: list[tuple[str, NDArray[np.float64]]]
    """Kind (`CLOSED_PLANAR`, ...) and points (x, y, z) in mm (LPS) of each contour."""


def read_volume(path: str | os.PathLike[str]) -> Volume:
    """Read all voxels of a volume in any format of the command line, labels or grey values.

    Voxels are labels if they are whole numbers and do not look like an image's: few values, or neighbours that mostly have the same one.

    Raises ValueError for what is no volume or a damaged one, OSError for what cannot be read.
    """
    found = _native.read_volume(os.fspath(path))
    steps = np.array(found["steps"])
    lengths = np.linalg.norm(steps, axis=1)
    return Volume(
        arrays=found["arrays"],
        grey=found["grey"],
        segments={label: Segment(name, _colour(colour)) for label, (name, colour) in found["segments"].items()},
        spacing=_three(lengths[::-1]),
        origin=_three(found["origin"]),
        axes=tuple(_three(axis) for axis in steps / lengths[:, None]),
        unit=found["unit"],
        spaced=found["spaced"],
        format=found["format"],
    )


def write_volume(
    path: str | os.PathLike[str],
    labels: Any,
    *,
    spacing: Spacing | None = None,
    origin: Vector | None = None,
    axes: Sequence[Vector] | NDArray[Any] | None = None,
    unit: str = "mm",
    segments: Mapping[int, Segment] | None = None,
) -> Path:
    """Write labels into a file, the format by its extension, as the command line writes volumes. The file appears when it is complete.

    `labels` is an array of integers with axes (z, y, x), or an image, which has its own place. `spacing` is the distance of voxels along the axes
    of the array (dz, dy, dx), by default 1; `origin` the place of the first voxel, and `axes` the directions of x, y and z, unit vectors at right
    angles (LPS). `segments` are names and colours, which `.seg.nrrd` and `.nrrd` have.

    Raises ValueError for wrong input, OSError for a name that cannot be written.
    """
    if not has_place(labels):
        of = image(labels, 1.0 if spacing is None else spacing, "labels")
        place = of.place("labels")
        directions = np.eye(3) if axes is None else np.array(axes, dtype=float)
        if directions.shape != (3, 3):
            raise ValueError(f"`axes` must be three vectors of three numbers; got the shape {directions.shape}")
        wrong = [length for length in np.linalg.norm(directions, axis=1) if not abs(length - 1) <= 1e-3]
        if wrong:
            raise ValueError(f"`axes` must be unit vectors; got one {wrong[0]:g} long")
        lengths = np.array([step[axis] for axis, step in enumerate(of.steps)])
        place["steps"] = tuple(_three(step) for step in directions * lengths[:, None])
        place["origin"] = _three((0.0, 0.0, 0.0) if origin is None else numbers("origin", origin, 3))
        place["unit"] = unit
    elif spacing is not None or origin is not None or axes is not None:
        raise ValueError("`spacing`, `origin` and `axes` are for arrays; an image has its own place")
    else:
        of = image(labels, None, "labels")
        place = of.place("labels")
    named = [_named(label, segment) for label, segment in (segments or {}).items()]
    _native.write_volume(os.fspath(path), of.array, place, named)
    return Path(path)


def read_rois(path: str | os.PathLike[str], *, series: str | int | None = None) -> list[Roi]:
    """Read the ROIs of an RTSTRUCT, or of the one in a folder of DICOM files; `series` chooses among several.

    A ROI whose contours cannot be read has none, and a UserWarning says why. Raises ValueError for what is none or a damaged one, OSError for what cannot be
    read.
    """
    rois = _native.read_rois(os.fspath(path), None if series is None else str(series))
    for fault in (roi["fault"] for roi in rois if roi["fault"]):
        warnings.warn(f"{os.fspath(path)}: {fault}", UserWarning, stacklevel=2)
    return [Roi(roi["number"], roi["name"], _colour(roi["colour"]), roi["contours"]) for roi in rois]


def _three(given: Any) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in given)
    return x, y, z


def _named(label: Any, segment: Any) -> tuple[int, str | None, list[int] | None]:
    """Label, name and colour of a segment that is given."""
    if not isinstance(segment, (tuple, list)) or len(segment) != 2:
        raise ValueError(f"`segments` must have a Segment(name, colour) for each label; label {label} has {segment!r}")
    name, colour = segment
    return whole("segments", label), name, _shade(label, colour)


def _shade(label: int, colour: Any) -> list[int] | None:
    """A colour that is given."""
    if colour is None:
        return None
    given = wholes("segments", colour)
    if len(given) != 3 or not all(0 <= channel <= 255 for channel in given):
        raise ValueError(f"`segments` must have colours of three whole numbers from 0 to 255; label {label} has {tuple(given)}")
    return given


def _colour(found: Sequence[int] | None) -> tuple[int, int, int] | None:
    if found is None:
        return None
    red, green, blue = found
    return red, green, blue
