"""Reader of medical volumes and RTSTRUCTs: with their place, names and colours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import interslice
import numpy as np
from napari.utils.colormaps import DirectLabelColormap, label_colormap

from napari_interslice._place import shown, translation, turn_of

LayerData = tuple[Any, dict[str, Any], str]
Reader = Callable[[Any], list[LayerData]]

# What stands in the metadata of a layer for the writer.
KEY = "interslice"
# Units of lengths that napari knows under these names.
UNITS = ("um", "µm", "mm", "cm", "m", "in", "ft")
# Sizes of the headers of NIfTI-1 and Analyze, and of NIfTI-2, with which they begin.
HEADERS = {348, 540}
# SOP class of an RTSTRUCT, and how far into a DICOM file it stands at the latest.
RTSTRUCT = b"1.2.840.10008.5.1.4.1.1.481.3"
BEGIN = 4096
# A label that the file does not know.
UNKNOWN = (0.7, 0.7, 0.7, 1.0)


def of_volume(path: Any) -> Reader | None:
    """The reader of a volume."""
    return read_volume if isinstance(path, str) else None


def of_pair(path: Any) -> Reader | None:
    """The reader of Analyze, or NIfTI in two files; none for other files of these names (pictures of high range, raw bytes)."""
    if not isinstance(path, str):
        return None
    headers = [Path(path).with_suffix(suffix) for suffix in (".hdr", ".HDR")]
    for header in headers:
        if header.is_file():
            with header.open("rb") as file:
                begin = file.read(4)
            sizes = {int.from_bytes(begin, "little"), int.from_bytes(begin, "big")}
            return read_volume if sizes & HEADERS else None
    return None


def of_dicom(path: Any) -> Reader | None:
    """The reader of an RTSTRUCT; none for any other DICOM file."""
    if not isinstance(path, str) or not Path(path).is_file():
        return None
    with Path(path).open("rb") as file:
        found = file.read(BEGIN).partition(RTSTRUCT)
    is_rtstruct = found[1] != b"" and not found[2][:1].isdigit() and found[2][:1] != b"."
    return read_rtstruct if is_rtstruct else None


def read_volume(path: str) -> list[LayerData]:
    """Labels as Labels layers, one for each layer of segments that may overlap; grey values as an Image layer."""
    volume = interslice.read_volume(path)
    axes = np.array(volume.axes)
    steps = axes * np.array(volume.spacing[::-1])[:, None]
    turn = turn_of(axes)
    unit = volume.unit if volume.spaced else "px"
    shape = volume.arrays[0].shape
    about: dict[str, Any] = {
        "scale": [volume.spacing[2 - turn.order[world]] for world in (2, 1, 0)],
        "translate": translation(np.array(volume.origin), steps, shape, turn),
        "metadata": {KEY: {"turn": turn, "unit": unit}},
    }
    if unit in UNITS:
        about["units"] = (unit,) * 3
    name = title(path)
    if volume.grey:
        return [(shown(volume.arrays[0], turn), {**about, "name": name}, "image")]
    layers: list[LayerData] = []
    for k, array in enumerate(volume.arrays):
        segments = volume.segments
        if len(volume.arrays) > 1:
            there = set(np.unique(array).tolist())
            segments = {label: segment for label, segment in segments.items() if label in there}
        names = [segment.name for segment in segments.values() if segment.name]
        own = f"{name}: {', '.join(names)}" if len(volume.arrays) > 1 and 0 < len(names) <= 3 else name
        if own == name and len(volume.arrays) > 1:
            own = f"{name} (layer {k + 1})"
        layers.append((shown(array, turn), {**about, "name": own, **appearance(segments)}, "labels"))
    return layers


def appearance(segments: Mapping[int, interslice.Segment]) -> dict[str, Any]:
    """Names in the layer's table, which the status bar shows; colours where the file has some."""
    known: dict[str, Any] = {}
    if any(segment.name for segment in segments.values()):
        names = [segment.name or str(label) for label, segment in segments.items()]
        known["features"] = {"index": np.array(list(segments), dtype=np.int64), "name": np.array(names, dtype=object)}
    if any(segment.colour for segment in segments.values()):
        cyclic = label_colormap()
        colours: dict[int | None, Any] = {None: UNKNOWN, 0: (0.0, 0.0, 0.0, 0.0)}
        for label, segment in segments.items():
            colours[label] = cyclic.map(label) if segment.colour is None else (*(c / 255 for c in segment.colour), 1.0)
        known["colormap"] = DirectLabelColormap(color_dict=colours)
    return known


def read_rtstruct(path: str) -> list[LayerData]:
    """The closed contours of each ROI as lines of a Shapes layer with its name and colour. They are no polygons: napari takes half a minute to
    triangulate those of a thorax, and half a second for lines."""
    drawn = []
    for roi in interslice.read_rois(path):
        lines = [points[:, ::-1] for kind, points in roi.contours if kind.startswith("CLOSED") and len(points) > 2]
        if lines:
            drawn.append((roi, lines))
    if not drawn:
        raise ValueError(f"{path}: has no closed contour; there is nothing to show")
    first, step = planes([line for _, lines in drawn for line in lines], path)
    layers: list[LayerData] = []
    for roi, lines in drawn:
        colour = [0.7, 0.7, 0.7] if roi.colour is None else [c / 255 for c in roi.colour]
        about = {
            "name": roi.name.strip() or f"ROI {roi.number}",
            "shape_type": "path",
            "edge_color": [*colour, 1.0],
            "face_color": "transparent",
            "edge_width": 1.0,
            "scale": [step, 1.0, 1.0],
            "translate": [first, 0.0, 0.0],
            "units": ("mm",) * 3,
            "metadata": {KEY: {"roi": roi.number,}},
        }
        closed = [np.vstack([line, line[:1]]) for line in lines]
        layers.append(([(line - [first, 0, 0]) / [step, 1, 1] for line in closed], about, "shapes"))
    return layers


def planes(lines: Sequence[np.ndarray[Any, Any]], path: str) -> tuple[float, float]:
    """The lowest plane of contours and the distance of planes, of which napari makes steps of its slider."""
    for k, line in enumerate(lines):
        if np.ptp(line[:, 0]) > 0.1:
            raise ValueError(
                f"{path}: contour {k + 1} leaves its plane across the body's axis by {np.ptp(line[:, 0]):.1f} mm (at most 0.1): napari shows "
                "contours on axial planes only; `interslice reconstruct` reads this file"
            )
        line[:] = [[np.median(line[:, 0]), 0, 0]] + line * [0, 1, 1]
    heights = np.unique([line[0, 0] for line in lines])
    gaps = np.diff(heights)
    gaps = gaps[gaps > 0.1]
    return float(heights[0]), float(gaps.min()) if len(gaps) else 1.0


def title(path: str) -> str:
    """A file's name without what says its format."""
    name = Path(path).name
    for extension in (".seg.nrrd", ".nii.gz"):
        if name.lower().endswith(extension) and len(name) > len(extension):
            return name[: -len(extension)]
    return Path(path).stem
