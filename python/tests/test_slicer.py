"""The script for 3D Slicer, with a stand-in for what it asks of Slicer: names, numbers and arrays. Slicer itself is not run."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import drawn

SCRIPT = Path(__file__).parents[1] / "slicer3d" / "fill_segmentation.py"
SPACING = (1.0, 0.8, 3.0)


class Node:
    """A segmentation of masks by name."""

    def __init__(self, masks: dict[str, np.ndarray[Any, Any]], volume: object) -> None:
        self.masks = masks
        self.volume = volume
        segments = SimpleNamespace(GetNumberOfSegments=lambda: len(masks))
        segments.GetNthSegmentID = lambda n: f"id {list(masks)[n]}"
        segments.GetSegment = lambda key: SimpleNamespace(GetName=lambda: key[3:])
        self.GetSegmentation = lambda: segments
        self.GetReferenceImageGeometryReferenceRole = lambda: "role"
        self.GetNodeReference = lambda role: self.volume


@pytest.fixture
def slicer(monkeypatch: pytest.MonkeyPatch) -> Any:
    found: dict[str, Node] = {}

    def update(mask: np.ndarray[Any, Any], node: Node, key: str, volume: object) -> None:
        assert volume is node.volume
        node.masks[key[3:]] = mask

    module = ModuleType("slicer")
    module.util = SimpleNamespace(  # type: ignore[attr-defined]
        getNode=found.__getitem__,
        arrayFromSegmentBinaryLabelmap=lambda node, key, volume: node.masks[key[3:]].copy(),
        updateSegmentBinaryLabelmapFromArray=update,
    )
    monkeypatch.setitem(sys.modules, "slicer", module)
    return found


def test_segments_are_filled_in_place(slicer: dict[str, Node]) -> None:
    labels = drawn()
    single = np.zeros_like(labels)
    single[4, 3:6, 3:6] = 1
    masks = {"liver": (labels == 1).astype(np.uint8), "tumour": (labels == 5).astype(np.uint8), "dot": single}
    slicer["Segmentation"] = Node(dict(masks), SimpleNamespace(GetSpacing=lambda: SPACING))
    script = runpy.run_path(str(SCRIPT))
    done = script["fill_segmentation"](method="field")
    now = slicer["Segmentation"].masks
    for name in ("liver", "tumour"):
        expected = interslice.fill(masks[name], spacing=SPACING[::-1], method="field")
        np.testing.assert_array_equal(now[name], expected)
        assert done[name] == f"{expected.sum() - masks[name].sum()} voxels filled"
    np.testing.assert_array_equal(now["dot"], single)
    assert done["dot"].startswith("left as it is: it is painted on fewer than two slices")
    slicer["Segmentation"].volume = None
    with pytest.raises(ValueError, match="has no source volume"):
        script["fill_segmentation"]()
