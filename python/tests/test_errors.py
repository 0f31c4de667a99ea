"""Errors: Python's own, with the words of the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume
from numpy.typing import NDArray


def test_words_are_those_of_the_command_line(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    np.save(tmp_path / "empty.npy", np.zeros_like(labels))
    said = command("reconstruct", tmp_path / "empty.npy", "-o", tmp_path / "o.stl", code=2).stderr
    with pytest.raises(ValueError) as raised:
        interslice.reconstruct(interslice.read(tmp_path / "empty.npy"))
    assert said == f"error: {raised.value}\n"
    said = command("reconstruct", tmp_path / "none.nrrd", "-o", tmp_path / "o.stl", code=2).stderr
    with pytest.raises(FileNotFoundError) as missing:
        interslice.read(tmp_path / "none.nrrd")
    assert said == f"error: {missing.value}\n"


def test_arrays_that_cannot_be(labels: Volume, masks: NDArray[np.bool_]) -> None:
    for given, error, words in [
        (labels[0], ValueError, "`labels` must have 3 axes; got 2"),
        (labels[:0], ValueError, "`labels` must not be empty"),
        (labels.astype(complex), TypeError, "`labels` must be an array of integers, bool, float32 or float64; got one of complex128"),
        (labels.astype(object), TypeError, "`labels` must be an array of integers"),
        (labels + 0.5, ValueError, "labels: "),
        (np.zeros_like(labels), ValueError, "labels: has no label: all voxels are 0"),
    ]:
        with pytest.raises(error, match=words):
            interslice.fill(given)
    with pytest.raises(ValueError, match="`spacing` must be a number, or 3, one for each axis of the array; got 2"):
        interslice.fill(labels, spacing=(1, 2))
    with pytest.raises(ValueError, match="`spacing` must be positive; got -1"):
        interslice.fill(labels, spacing=(1, 2, -1))
    with pytest.raises(ValueError, match="`axis` must be 0, 1 or 2, an axis of the array; got 3"):
        interslice.fill(labels, axis=3)
    with pytest.raises(ValueError, match="labels: has no label 7; labels are 1, 5"):
        interslice.fill(labels, only=[7])
    with pytest.raises(ValueError, match="`slices` must name slices 0 to 16; got 99"):
        interslice.fill(labels, slices=[0, 99])
    with pytest.raises(ValueError, match="`heights` must be as many as slices: 5 masks; got 2 heights"):
        interslice.reconstruct(masks, [0, 1])
    with pytest.raises(ValueError, match=r"slice 1 \(`\[1\]`\): height 0 must lie above"):
        interslice.reconstruct(masks, [0, 0, 1, 2, 3])
    with pytest.raises(ValueError, match="one of `masks`, `fields` and `polygons` must be given; got none"):
        interslice.reconstruct(heights=[0, 1])
    with pytest.raises(ValueError, match="slice 1 is 39 x 40, slice 0 40 x 40"):
        interslice.reconstruct([masks[0], masks[1, 1:]], [0, 1])
    with pytest.raises(TypeError, match="unknown option `fairr`"):
        interslice.fill(labels, fairr=1)  # type: ignore[call-overload]


def test_outputs_memory_and_machines(tmp_path: Path, masks: NDArray[np.bool_]) -> None:
    body = interslice.reconstruct(masks, range(5), method="field")
    with pytest.raises(OSError, match="cannot write"):
        body.save(tmp_path / "no" / "folder.stl")
    with pytest.raises(OSError, match=r"\.xyz"):
        body.save(tmp_path / "a.xyz")
    with pytest.raises(OSError, match="a completed RTSTRUCT needs an RTSTRUCT as input"):
        body.save(tmp_path / "a.dcm")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(MemoryError, match="this job needs about .* MiB of memory"):
        interslice.reconstruct(masks, range(5), memory="1M")
    # Where there is no driver at all it is the GPU that fails.
    with pytest.raises((ValueError, interslice.GpuError), match="adapter"):
        interslice.reconstruct(masks, range(5), backend="gpu", adapter="no such adapter")
    unknown = np.where(masks, 1.0, np.nan)
    with pytest.raises(ValueError, match="`masks` slice 0 has .* values that are NaN"):
        interslice.reconstruct(unknown, range(5))
    with pytest.raises(ValueError, match="`mask` has .* values that are NaN"):
        body.update(0, unknown[0])
    masked = np.ma.masked_array(masks, mask=masks)
    with pytest.raises(ValueError, match="has .* masked values"):
        interslice.reconstruct(masked, range(5))
    with pytest.raises(ValueError, match="has .* masked values"):
        interslice.fill(masked)
    with pytest.raises(ValueError, match="`slice` must be a slice's place, counted from 0; got -1"):
        body.update(-1, masks[0])
    with pytest.raises(ValueError, match="`spacing` is for `masks` and `fields`"):
        interslice.reconstruct(polygons=[[[(0, 0), (9, 0), (9, 9)]]] * 2, heights=range(2), spacing=0.5)
    with pytest.raises(ValueError, match="`slice` must lie in"):
        body.update(5, masks[0])
    with pytest.raises(ValueError, match="`mask` must be 40 x 40 as the body's slices; got 3 x 3"):
        body.update(0, np.ones((3, 3)))


def test_what_was_read_is_not_written_over(tmp_path: Path, labels: Volume) -> None:
    given = tmp_path / "given.npy"
    np.save(given, labels)
    link = tmp_path / "link.stl"
    link.symlink_to(given)
    body = interslice.reconstruct(interslice.read(given, label=1))
    with pytest.raises(OSError, match="input"):
        body.save(link)
    np.testing.assert_array_equal(np.load(given), labels)
