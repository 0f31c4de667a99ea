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
from test_recipes import structure_set


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
        (labels + 0.5, ValueError, "labels: voxel x = 0, y = 0, z = 0 is 0.5"),
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


def test_whole_numbers_are_whole(labels: Volume, masks: NDArray[np.bool_]) -> None:
    stack = interslice.stack(masks, range(5))
    fill: Any = interslice.fill
    evaluate: Any = interslice.evaluate
    wrong: list[tuple[Callable[[], Any], str]] = [
        (lambda: fill(labels, slices=[-1, 4]), "`slices` takes numbers from 0; got -1"),
        (lambda: fill(labels, slices={1: [0, -4]}), "`slices` takes numbers from 0; got -4"),
        (lambda: fill(labels, slices=[0.9, 4.9]), "`slices` takes whole numbers; got 0.9"),
        (lambda: fill(labels, keep=-1), "`keep` takes numbers from 0; got -1"),
        (lambda: fill(labels, axis="z"), "`axis` takes whole numbers; got z"),
        (lambda: fill(labels, only=[1.7]), "`only` takes whole numbers; got 1.7"),
        (lambda: fill(labels, only=[2**70]), "`only` takes numbers of 64 bits; got 1180591620717411303424"),
        (lambda: evaluate(stack, leave=-1), "`leave` must be at least 2: .*; got -1"),
        (lambda: evaluate(stack, leave=2.5), "`leave` takes whole numbers; got 2.5"),
        (lambda: interslice.Settings(redistance=2**70), "`redistance` is a number beyond 64 bits; got 1180591620717411303424"),
    ]
    for call, words in wrong:
        with pytest.raises(ValueError, match=words):
            call()
    expected = fill(labels, slices=[0, 8, 16], only=[1], axis=0)
    given = fill(labels, slices=np.array([0.0, 8.0, 16.0]), only=[np.int8(1)], axis=np.int64(-3))
    np.testing.assert_array_equal(given, expected)


def test_numbers_that_are_names(tmp_path: Path, labels: Volume) -> None:
    # Where there is no driver at all it is the GPU that fails.
    with pytest.raises((ValueError, interslice.GpuError), match="adapter"):
        interslice.fill(labels, backend="gpu", adapter=99)
    structure_set(tmp_path / "rt.dcm")
    calls: list[Callable[[Any], Any]] = [
        lambda series: interslice.read(tmp_path, series=series),
        lambda series: interslice.read_rois(tmp_path, series=series),
    ]
    for call in calls:
        for series in (99, "99"):
            with pytest.raises(ValueError, match="`series`.*99"):
                call(series)


def test_axes_are_perpendicular_unit_vectors(masks: NDArray[np.bool_]) -> None:
    ring = [[[(0, 0), (9, 0), (9, 9)]]] * 5
    cases: list[tuple[Any, str]] = [
        ([[2, 0, 0], [0, 1, 0], [0, 0, 1]], "axis 0 is 2 long; it must be 1"),
        ([[1, 0, 0], [0.6, 0.8, 0], [0, 0, 1]], "axes 0 and 1 are not perpendicular"),
        ([[1, 0, 0], [0, 1, 0], [0, 1, 0]], "axes 1 and 2 are not perpendicular"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 0]], "axis 2 is 0 long"),
        ([[1, 0, 0], [0, float("nan"), 0], [0, 0, 1]], "axis 1 is NaN long"),
    ]
    givens: list[dict[str, Any]] = [{"masks": masks}, {"fields": masks - 0.5}, {"polygons": ring}]
    makes: list[Callable[..., Any]] = [interslice.stack, interslice.reconstruct]
    for axes, words in cases:
        for given in givens:
            for make in makes:
                with pytest.raises(ValueError, match=words):
                    make(**given, heights=range(5), axes=axes)
    with pytest.raises(ValueError, match="the origin holds inf"):
        interslice.stack(masks, range(5), origin=(0, float("inf"), 0))


@pytest.mark.parametrize("side", [1e-200, 1e-40, 1e300])
def test_lengths_are_those_that_single_precision_holds(labels: Volume, masks: NDArray[np.bool_], side: float) -> None:
    heights = np.arange(5.0)
    for call in (
        lambda: interslice.reconstruct(masks, heights, spacing=side),
        lambda: interslice.stack(masks, heights * side),
        lambda: interslice.fill(labels, spacing=side),
    ):
        with pytest.raises(ValueError, match="must lie between 1e-15 and 1e15; got"):
            call()


def test_polygons_are_lists_of_lines() -> None:
    line = np.array([(0, 0), (9, 0), (9, 9)])
    with pytest.raises(ValueError, match=r"for each slice, a list of lines, .*; a line of slice 0 has the shape \(2,\)"):
        interslice.stack(polygons=[line, line], heights=[0, 1])
    with pytest.raises(ValueError, match=r"a line of slice 1 has the shape \(3, 3\)"):
        interslice.stack(polygons=[[line], [np.ones((3, 3))]], heights=[0, 1])


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
    # The file says no spacing.
    with pytest.warns(UserWarning, match="nothing says how large voxels are"):
        body = interslice.reconstruct(interslice.read(given, label=1))
    with pytest.raises(OSError, match="input"):
        body.save(link)
    np.testing.assert_array_equal(np.load(given), labels)


def test_wrong_arguments_are_named(labels: Volume, masks: NDArray[np.bool_]) -> None:
    fill: Any = interslice.fill
    stack: Any = interslice.stack
    made = interslice.stack(masks, range(5))
    wrong: list[tuple[Callable[[], Any], type[Exception], str]] = [
        (lambda: fill(labels, complete_slices=1), ValueError, "`complete_slices` must be True or False; got 1"),
        (lambda: fill(labels, only=1), ValueError, "`only` takes several values, such as a list; got 1"),
        (lambda: fill(labels, slices=3), ValueError, "`slices` takes several values, such as a list; got 3"),
        (lambda: fill(labels, slices={1: 3}), ValueError, "`slices` takes several values, such as a list; got 3"),
        (lambda: fill(labels, spacing="a"), ValueError, "`spacing` must be a number, or 3, one for each axis of the array; got 'a'"),
        (lambda: fill(labels, progress=3), TypeError, "`progress` must be a function, .*; got 3"),
        (lambda: fill("labels.nii"), TypeError, "`labels` must be an array or an image, .*; got 'labels.nii'"),
        (lambda: fill(None), TypeError, "`labels` must be an array or an image, .*; got None"),
        (lambda: fill(np.ma.masked_equal(labels, 1)), ValueError, "`labels` has .* masked values"),
        (lambda: stack(np.ma.masked_equal(masks, 1), range(5)), ValueError, "`masks` has .* masked values"),
        (lambda: stack(masks, range(5), origin=(1, 2)), ValueError, "`origin` takes 3 numbers; got 2"),
        (lambda: stack(masks, range(5), axes=np.eye(3)[:2]), ValueError, "`axes` must be three vectors; got 2"),
        (lambda: stack(masks, range(5), unit=None), ValueError, "`unit` must be a text, such as mm; got None"),
        (lambda: stack(masks, ["0 mm", 1, 2, 3, 4]), ValueError, "`heights` takes numbers; got '0 mm'"),
        (lambda: stack(masks, np.array(5)), ValueError, "`heights` takes several values, such as a list; got array"),
        (lambda: stack(masks, 5), ValueError, "`heights` takes several values, such as a list; got 5"),
        (lambda: stack(polygons=[[[(0, 0), (9,)]]], heights=[0]), ValueError, "`polygons` must have, .* a line of slice 0 is none"),
        (lambda: stack(polygons=[1], heights=[0]), ValueError, "`polygons` takes several values, such as a list; got 1"),
        (lambda: stack(polygons=[[]], heights=[0], pixel=-1), ValueError, "`pixel` must be positive; got -1"),
        (lambda: interslice.reconstruct(masks, range(5), at=[float("nan")]), ValueError, "`at` takes finite heights; got nan"),
        (lambda: interslice.reconstruct(made, unit="km"), ValueError, "`unit` is not for a Stack"),
        (lambda: interslice.reconstruct(made, origin=(9, 0, 0)), ValueError, "`origin` is not for a Stack"),
        (lambda: interslice.reconstruct(made, axes=-np.eye(3)), ValueError, "`axes` is not for a Stack"),
        (lambda: interslice.reconstruct(made, level=0.5), ValueError, "`level` is not for a Stack"),
        (lambda: interslice.reconstruct(made, fields=masks), ValueError, "`fields` is not for a Stack"),
        (lambda: stack(masks, range(5), pixel=0.1), ValueError, "`pixel` is for `polygons`"),
        (lambda: stack(polygons=[[]], heights=[0], level=1), ValueError, "`level` is for `fields`"),
        (lambda: interslice.write_volume("x.nrrd", labels, segments={1: "liver"}), ValueError, "`segments` must have a Segment.*; label 1 has 'liver'"),  # type: ignore[dict-item]
        (lambda: interslice.write_volume("x.nrrd", labels, origin=(1, 2)), ValueError, "`origin` takes 3 numbers; got 2"),
    ]
    for call, error, words in wrong:
        with pytest.raises(error, match=words):
            call()


def test_heights_that_are_not_even_are_no_volume(tmp_path: Path, masks: NDArray[np.bool_]) -> None:
    body = interslice.reconstruct(masks, range(5), at=[0, 1, 2, 4])
    with pytest.raises(OSError, match="layers must lie evenly; got heights 0 and 1"):
        body.save(tmp_path / "x.nrrd")
    body.save(tmp_path / "x.npy")
    body.save(tmp_path / "x.contours.json")
    assert {file.name for file in tmp_path.iterdir()} == {"x.npy", "x.contours.json"}


def test_what_is_asked_for_its_items_has_several_values(masks: NDArray[np.bool_]) -> None:
    class Slices:
        def __getitem__(self, k: int) -> Any:
            return masks[k]

    given: Any = Slices()
    assert interslice.reconstruct(given, range(5), dz=1.0).volume == interslice.reconstruct(masks, range(5), dz=1.0).volume
