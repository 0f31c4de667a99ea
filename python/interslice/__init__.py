"""Fill the slices between painted ones, and turn stacks of contours into smooth closed surfaces.

>>> import interslice
>>> filled = interslice.fill(labels, spacing=(3.0, 0.8, 0.8))                       # doctest: +SKIP
>>> body = interslice.reconstruct(masks, heights=range(0, 60, 3), spacing=0.8)      # doctest: +SKIP
>>> vertices, faces = body.mesh()                                                   # doctest: +SKIP
"""

from interslice._api import evaluate, fill, inspect, links, read, reconstruct, stack
from interslice._files import Roi, Segment, Volume, read_rois, read_volume, write_volume
from interslice._native import (
    Body,
    GpuError,
    Settings,
    Stack,
    __version__,
    devices,
    doctor,
)

__all__ = [
    "Body",
    "GpuError",
    "Roi",
    "Segment",
    "Settings",
    "Stack",
    "Volume",
    "__version__",
    "devices",
    "doctor",
    "evaluate",
    "fill",
    "inspect",
    "links",
    "read",
    "read_rois",
    "read_volume",
    "reconstruct",
    "stack",
    "write_volume",
]
