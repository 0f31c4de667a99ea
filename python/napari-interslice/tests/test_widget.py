"""The widget in real napari."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from napari_interslice._widget import MARKED, PREVIEW, FillWidget


def drawn(size: int = 48) -> np.ndarray[Any, Any]:
    z, y, x = np.mgrid[:13, :size, :size].astype(float)
    labels = np.where((x - size / 3) ** 2 + (y - size / 2) ** 2 < (6 + z / 3) ** 2 * (size / 48) ** 2, 2, 0).astype(np.uint8)
    labels[(x - size * 0.75) ** 2 + (y - size / 2) ** 2 < (size / 8) ** 2] = 7
    labels[np.arange(13) % 4 != 0] = 0
    return labels


@pytest.fixture
def opened(make_napari_viewer: Callable[..., Any]) -> tuple[Any, Any, FillWidget]:
    viewer = make_napari_viewer(show=os.environ.get("INTERSLICE_SHOTS") is not None)
    layer = viewer.add_labels(drawn(), name="organs", scale=(3.0, 0.8, 0.8))
    _, widget = viewer.window.add_plugin_dock_widget("napari-interslice", "Fill between slices")
    return viewer, layer, widget


def filled(qtbot: Any, widget: FillWidget) -> None:
    widget.start.click()
    qtbot.waitUntil(lambda: widget.start.isEnabled(), timeout=60_000)


def test_fill_preview_keep_undo(opened: tuple[Any, Any, FillWidget], qtbot: Any) -> None:
    viewer, layer, widget = opened
    layer.selected_label = 2
    before = layer.data.copy()
    # A voxel of another label in the way.
    layer.data[6, 24, 16] = before[6, 24, 16] = 9
    filled(qtbot, widget)
    np.testing.assert_array_equal(layer.data, before)
    preview = viewer.layers[PREVIEW]
    assert not preview.editable and list(preview.scale) == [3.0, 0.8, 0.8]
    expected = interslice.fill(before, spacing=(3.0, 0.8, 0.8), only=[2])
    np.testing.assert_array_equal(preview.data, expected)
    np.testing.assert_array_equal(viewer.layers[MARKED].data, (expected != 0) & (before == 0))
    if shots := os.environ.get("INTERSLICE_SHOTS"):
        viewer.dims.set_current_step(0, 6)
        viewer.screenshot(str(Path(shots) / "preview.png"), canvas_only=False)
    widget.keep.click()
    np.testing.assert_array_equal(layer.data[before != 0], before[before != 0])
    np.testing.assert_array_equal(layer.data, expected)
    assert layer.data[6, 24, 16] == 9 and (layer.data[5] == 7).sum() == 0
    assert PREVIEW not in viewer.layers and MARKED in viewer.layers
    layer.undo()
    np.testing.assert_array_equal(layer.data, before)


def test_all_labels_and_drop(opened: tuple[Any, Any, FillWidget], qtbot: Any) -> None:
    viewer, layer, widget = opened
    widget.which.setCurrentIndex(1)
    widget.method.setCurrentIndex(1)
    filled(qtbot, widget)
    assert set(np.unique(viewer.layers[PREVIEW].data[5])) == {0, 2, 7}
    widget.drop.click()
    assert [one.name for one in viewer.layers] == ["organs"]
    np.testing.assert_array_equal(layer.data, drawn())


def test_cancel(opened: tuple[Any, Any, FillWidget], qtbot: Any) -> None:
    viewer, layer, widget = opened
    layer.data = drawn(1000)
    layer.selected_label = 2
    widget.start.click()
    assert widget.stop.isEnabled() and not widget.start.isEnabled()
    qtbot.wait(200)
    widget.stop.click()
    qtbot.waitUntil(lambda: widget.start.isEnabled(), timeout=10_000)
    assert widget.said.text() == "Cancelled." and PREVIEW not in viewer.layers


def test_mistakes_are_told(opened: tuple[Any, Any, FillWidget], qtbot: Any) -> None:
    viewer, layer, widget = opened
    layer.selected_label = 5
    filled(qtbot, widget)
    assert widget.said.text() == "labels: has no label 5; labels are 2, 7"
    viewer.layers.clear()
    widget.start.click()
    assert widget.said.text() == "There is no Labels layer to fill."


def test_the_recipe(make_napari_viewer: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[3] / "docs" / "python.md").read_text().split("## napari\n")[1]
    code = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)[0]
    viewer = make_napari_viewer()
    monkeypatch.setattr("napari.Viewer", lambda **_: viewer)
    known: dict[str, Any] = {}
    exec(code, known)
    assert (known["layer"].data[1:8] == 3).any(axis=(1, 2)).all()
