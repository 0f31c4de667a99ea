"""Fill the slices between painted ones of a segmentation in 3D Slicer, in place.

Paste into the Python console, or run it there:

    exec(open("fill_segmentation.py").read())
    fill_segmentation("Segmentation")

Names, colours and geometry of the segments stay; painted slices stay as they are; segments are filled one by one, as they may overlap.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np


def fill_mask(mask: np.ndarray[Any, Any], spacing: tuple[float, float, float], **settings: Any) -> np.ndarray[Any, Any] | None:
    """A mask with axes (k, j, i) filled, or None where it has nothing to fill: painted on one slice, or on none."""
    import interslice  # docs/slicer.md says how to install it

    painted = (np.asarray(mask) != 0).astype(np.uint8)
    if min(np.count_nonzero(painted.any(axis=tuple(b for b in range(3) if b != axis))) for axis in range(3)) < 2:
        return None
    filled = np.asarray(interslice.fill(painted, spacing=spacing, **settings))
    return np.where(painted != 0, np.asarray(mask), filled.astype(mask.dtype))


def fill_segmentation(segmentation: Any = "Segmentation", volume: Any = None, **settings: Any) -> dict[str, str]:
    """Fill all segments of a segmentation node, given by itself or by name; `volume` is the reference volume, by default its own.

    `settings` are those of `interslice.fill`, such as method="field" or end_top="extrapolate". Returns what was done with each segment.
    """
    slicer: Any = import_module("slicer")
    node = slicer.util.getNode(segmentation) if isinstance(segmentation, str) else segmentation
    if volume is None:
        volume = node.GetNodeReference(node.GetReferenceImageGeometryReferenceRole())
    if volume is None:
        raise ValueError("the segmentation has no source volume: name one with volume=")
    # Arrays of Slicer have axes (k, j, i), spacings (i, j, k).
    spacing = tuple(reversed(volume.GetSpacing()))
    done: dict[str, str] = {}
    segments = node.GetSegmentation()
    for n in range(segments.GetNumberOfSegments()):
        key = segments.GetNthSegmentID(n)
        name = segments.GetSegment(key).GetName()
        mask = slicer.util.arrayFromSegmentBinaryLabelmap(node, key, volume)
        try:
            filled = None if mask is None else fill_mask(mask, spacing, **settings)
        except ValueError as error:
            done[name] = f"left as it is: {error}"
            continue
        if filled is None:
            done[name] = "left as it is: it is painted on fewer than two slices"
            continue
        slicer.util.updateSegmentBinaryLabelmapFromArray(filled, node, key, volume)
        done[name] = f"{int(np.count_nonzero(filled)) - int(np.count_nonzero(mask))} voxels filled"
    return done
