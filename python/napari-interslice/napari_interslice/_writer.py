"""Writers of Labels layers: volumes with place, names and colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import interslice
import numpy as np
from napari.utils.colormaps import DirectLabelColormap
from napari.utils.transforms import Affine

from napari_interslice._place import UPRIGHT, Turn, place, stored
from napari_interslice._reader import KEY


# Extensions that are written; the manifest has them again.
EXTENSIONS = (".seg.nrrd", ".nrrd", ".nii.gz", ".nii", ".mha")


class NotSavedError(OSError):
    """A layer cannot be written. napari keeps silent about a writer's ValueError."""


def write_slicer(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Writes a Labels layer as a segmentation of 3D Slicer."""
    return write(path, ".seg.nrrd", data, meta)


def write_nifti(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Writes a Labels layer as NIfTI."""
    return write(path, ".nii.gz", data, meta)


def write_nrrd(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Writes a Labels layer as NRRD."""
    return write(path, ".nrrd", data, meta)


def write_metaimage(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Writes a Labels layer as MetaImage."""
    return write(path, ".mha", data, meta)


def write(path: str, extension: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Writes a Labels layer. The layer's scale and place count; a layer that was read keeps the axes of its file. A name without an extension
    that is known, as one types it into a dialog, gets `extension`."""
    target = path if path.lower().endswith(EXTENSIONS) else path + extension
    try:
        return [str(written(target, data, meta))]
    except ValueError as error:
        raise NotSavedError(f"{target}: {error}") from error


def written(path: str, data: Any, meta: dict[str, Any]) -> Path:
    name = meta.get("name", "labels")
    if meta.get("multiscale"):
        raise ValueError(f"layer `{name}` is multiscale; a file holds one scale")
    labels = np.asarray(data)
    if labels.ndim != 3:
        raise ValueError(f"layer `{name}` must have 3 axes to be written as a volume; it has {labels.ndim}")
    turn = Turn(*meta.get("metadata", {}).get(KEY, {}).get("turn", UPRIGHT))
    origin, steps = place(matrix(meta, name), labels.shape, turn)
    lengths = np.linalg.norm(steps, axis=1)
    return interslice.write_volume(
        path,
        stored(labels, turn),
        spacing=tuple(lengths[::-1]),
        origin=tuple(origin),
        axes=steps / lengths[:, None],
        unit=unit(meta, name),
        segments=segments(labels, meta),
    )


def matrix(meta: dict[str, Any], name: str) -> np.ndarray[Any, Any]:
    """The layer's matrix from voxels to napari's world."""
    own = Affine(scale=meta["scale"], translate=meta["translate"], rotate=meta["rotate"], shear=meta["shear"]).affine_matrix
    whole: np.ndarray[Any, Any] = np.asarray(meta["affine"]) @ own
    if not abs(np.linalg.det(whole)) > 0:
        raise ValueError(f"layer `{name}` has a scale of 0: {list(meta['scale'])}")
    return whole


def unit(meta: dict[str, Any], name: str) -> str:
    """The unit of lengths. A layer in pixels has that of the file that was read, else millimetres."""
    names = {f"{one:~}" for one in meta.get("units") or ()}
    if len(names) > 1:
        raise ValueError(f"layer `{name}` has axes in {' and '.join(sorted(names))}; all must have one unit")
    found = names.pop() if names else "px"
    if found not in ("px", "pix", "pixel", ""):
        return found
    unit: str = meta.get("metadata", {}).get(KEY, {}).get("unit", "mm")
    return unit


def segments(labels: np.ndarray[Any, Any], meta: dict[str, Any]) -> dict[int, interslice.Segment]:
    """Names of the layer's table, and the colours in which napari shows labels."""
    features, colormap = meta.get("features"), meta.get("colormap")
    names: dict[int, str] = {}
    if features is not None and "index" in features and "name" in features:
        names = {int(label): str(name) for label, name in zip(features["index"], features["name"], strict=True) if label != 0}
    known = set(names) | {int(label) for label in np.unique(labels)}
    if isinstance(colormap, DirectLabelColormap):
        known |= {label for label in colormap.color_dict if label is not None}
    found = {}
    for label in sorted(known - {0}):
        name = names.get(label)
        colour = None if colormap is None else np.asarray(colormap.map(label)).ravel()
        rgb = None if colour is None else (round(255 * colour[0]), round(255 * colour[1]), round(255 * colour[2]))
        found[label] = interslice.Segment(None if name == str(label) else name, rgb)
    return found
