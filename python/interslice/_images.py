"""Arrays with a place in the world, from whatever holds them. Nothing is imported for it: an image's own library is there already."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from interslice._numbers import Spacing

# From right, anterior, superior (NIfTI) to left, posterior, superior (DICOM, ITK).
_LPS = np.diag([-1.0, -1.0, 1.0])
# Units of NIfTI's `xyzt_units`; the others are taken for millimetres, as from a file.
_NIFTI_UNITS = {1: "m", 3: "um"}
# Metadata that hold no longer: where a segment lies, which is another place once it is filled, and how ITK read the file.
_PASSING = re.compile(r"Segment\d+_Extent|ITK_.*")


class Image(NamedTuple):
    """An array, where it lies, and how another array becomes an image of the same kind."""

    array: np.ndarray[Any, Any]
    # The array's axes that are x, y and z.
    order: tuple[int, int, int]
    origin: tuple[float, ...]
    # Steps from voxel to voxel along x, y and z, in the world (LPS).
    steps: tuple[tuple[float, ...], ...]
    unit: str
    spaced: bool
    like: Callable[[np.ndarray[Any, Any]], Any]

    def place(self, name: str) -> dict[str, Any]:
        place = self._asdict()
        return {key: place[key] for key in ("order", "origin", "steps", "unit", "spaced")} | {"name": name}


def image(of: Any, spacing: Spacing | None, name: str) -> Image:
    """The array of an object, and its place: of nibabel, SimpleITK, ITK, what pynrrd reads (array, header), or an array."""
    if not has_place(of):
        return _plain(of, spacing, name)
    if hasattr(of, "affine"):
        found = _nibabel(of, name)
    elif hasattr(of, "GetSpacing"):
        found = _itk(of, name)
    else:
        found = _nrrd(of[0], of[1])
    if spacing is not None and found.spaced:
        raise ValueError(f"`spacing` is only for what has none of its own; {name} has")
    if spacing is not None:
        return _plain(found.array, spacing, name)._replace(like=found.like)
    return found


def has_place(of: Any) -> bool:
    """Whether an object is an image, or what pynrrd reads, and no mere array."""
    of_nibabel = hasattr(of, "affine") and hasattr(of, "dataobj")
    of_itk = hasattr(of, "GetSpacing") and hasattr(of, "GetDirection")
    return of_nibabel or of_itk or (isinstance(of, tuple) and len(of) == 2 and isinstance(of[1], dict))


def unmasked(of: Any, name: str) -> np.ndarray[Any, Any]:
    """The array, where none of its values is masked: nobody but its owner knows what those are."""
    if np.ma.is_masked(of):
        masked = int(np.count_nonzero(np.ma.getmaskarray(of)))
        raise ValueError(f"`{name}` has {masked} masked values: give what they stand for, `a.filled(0)` for outside")
    return np.asarray(of)


def sides(spacing: Spacing, axes: int, name: str = "spacing") -> list[float]:
    """One number for each axis of an array."""
    try:
        given = [float(h) for h in np.asarray(spacing, dtype=float).ravel()]
    except (TypeError, ValueError):
        raise ValueError(f"`{name}` must be a number, or {axes}, one for each axis of the array; got {spacing!r}") from None
    given = given * axes if np.ndim(spacing) == 0 else given
    if len(given) != axes:
        raise ValueError(f"`{name}` must be a number, or {axes}, one for each axis of the array; got {len(given)}")
    wrong = [h for h in given if not (np.isfinite(h) and h > 0)]
    if wrong:
        raise ValueError(f"`{name}` must be positive; got {wrong[0]}")
    return given


def _plain(of: Any, spacing: Spacing | None, name: str) -> Image:
    array = unmasked(of, name)
    steps = np.eye(3)
    if spacing is not None:
        steps = np.diag(sides(spacing, 3)[::-1])
    return Image(array, (2, 1, 0), (0.0,) * 3, _rows(steps), "px" if spacing is None else "mm", spacing is not None, _same)


def _nibabel(of: Any, name: str) -> Image:
    stored = np.asanyarray(of.dataobj)
    # One time of one channel is a volume, as in a file.
    more = stored.shape[3:]
    if any(count != 1 for count in more):
        raise ValueError(f"`{name}` must have 3 axes; got an image of the shape {stored.shape}")
    array = stored.reshape(stored.shape[:3]) if more else stored
    affine = np.asarray(of.affine, dtype=float)
    steps, origin = _LPS @ affine[:3, :3], _LPS @ affine[:3, 3]

    def like(filled: np.ndarray[Any, Any]) -> Any:
        header = of.header.copy()
        header.set_data_dtype(filled.dtype)
        return type(of)(filled.reshape(stored.shape), of.affine, header)

    # Formats other than NIfTI have millimetres.
    code = int(of.header["xyzt_units"]) & 7 if hasattr(of.header, "get_xyzt_units") else 0
    return Image(array, (0, 1, 2), tuple(origin), _rows(steps.T), _NIFTI_UNITS.get(code, "mm"), True, like)


def _itk(of: Any, name: str) -> Image:
    module = sys.modules[type(of).__module__.split(".")[0]]
    simple = hasattr(module, "GetArrayViewFromImage")
    if simple and of.GetPixelIDTypeAsString().startswith("label "):
        # SimpleITK itself ends the interpreter where the array of such is asked for.
        raise TypeError(f"`{name}` is a label map of SimpleITK, which has no array: `SimpleITK.LabelMapToLabel` makes an image of it")
    # The view of an image lives no longer than the image, which `like` keeps.
    array = module.GetArrayViewFromImage(of) if simple else module.array_view_from_image(of)
    spacing = np.asarray(of.GetSpacing(), dtype=float)
    if len(spacing) != 3:
        raise ValueError(f"`{name}` must have 3 axes; got an image of {len(spacing)}")
    direction = of.GetDirection()
    matrix = np.asarray(direction if simple else module.array_from_matrix(direction), dtype=float).reshape(len(spacing), -1)

    def like(filled: np.ndarray[Any, Any]) -> Any:
        if simple:
            image = module.GetImageFromArray(filled)
            image.CopyInformation(of)
            for key in of.GetMetaDataKeys():
                if not _PASSING.fullmatch(key):
                    image.SetMetaData(key, of.GetMetaData(key))
            return image
        image = module.image_from_array(filled)
        image.SetOrigin(of.GetOrigin())
        image.SetSpacing(of.GetSpacing())
        image.SetDirection(of.GetDirection())
        return image

    steps = (matrix * spacing).T
    return Image(array, (2, 1, 0), tuple(float(v) for v in of.GetOrigin()), _rows(steps), "mm", True, like)


def _nrrd(data: Any, header: dict[str, Any]) -> Image:
    array = np.asarray(data)
    steps, spaced = np.eye(3), False
    # A size that is not known is NaN.
    known = {key: header[key] for key in ("space directions", "spacings") if not _is_nothing(header.get(key))}
    if "space directions" in known:
        # Axes that are no axes of space have no directions.
        rows = [row for row in np.asarray(known["space directions"], dtype=float) if np.all(np.isfinite(row))]
        steps, spaced = np.asarray(rows), True
    elif "spacings" in known:
        steps, spaced = np.diag([float(h) for h in known["spacings"]]), True
    if steps.shape != (3, 3):
        raise ValueError(f"the header's directions must be of 3 axes; got {steps.shape[0]}")
    space = str(header.get("space", "left-posterior-superior")).lower()
    flip = {"left": 1.0, "right": -1.0, "l": 1.0, "r": -1.0}, {"posterior": 1.0, "anterior": -1.0, "p": 1.0, "a": -1.0}
    words = space.split("-") if "-" in space else list(space)
    turn = np.diag([flip[0].get(words[0], 1.0), flip[1].get(words[1] if len(words) > 1 else "", 1.0), 1.0])
    origin = np.asarray(header.get("space origin", (0.0,) * 3), dtype=float)
    units = [unit for unit in header.get("space units") or () if unit]
    for other in units:
        if other != units[0]:
            raise ValueError(f"space units are {units[0]} and {other}: all axes must have the same")
    unit = units[0] if units else "mm" if spaced else "px"
    return Image(array, (0, 1, 2), tuple(turn @ origin), _rows(steps @ turn), unit, spaced, lambda filled: (filled, header))


def _is_nothing(field: Any) -> bool:
    return field is None or bool(np.all(np.isnan(np.asarray(field, dtype=float))))


def _rows(steps: np.ndarray[Any, Any]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(v) for v in row) for row in steps)


def _same(filled: np.ndarray[Any, Any]) -> Any:
    return filled
