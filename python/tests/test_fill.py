"""`fill`: what the command line makes of the same labels, whatever the array is like."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume, drawn
from numpy.typing import NDArray

SPACING = (3.0, 0.8, 1.0)


def of_command(command: Callable[..., Any], folder: Path, labels: NDArray[Any], *options: str) -> NDArray[Any]:
    """The command line's voxels, axes (z, y, x)."""
    given, filled = folder / "given.npy", folder / "filled.mha"
    np.save(given, labels)
    sides = ",".join(str(h) for h in reversed(SPACING))
    command("reconstruct", given, "--labels", "all", "--spacing", sides, "-q", "-o", filled, *options)
    header, _, data = filled.read_bytes().partition(b"ElementDataFile = LOCAL\n")
    kind = {b"MET_UCHAR": np.uint8, b"MET_USHORT": np.uint16, b"MET_INT": np.int32}
    fields = dict(line.split(b" = ") for line in header.splitlines() if b" = " in line)
    if fields.get(b"CompressedData") == b"True":
        import zlib

        data = zlib.decompress(data)
    return np.frombuffer(data, kind[fields[b"ElementType"]]).reshape(labels.shape)


def test_voxels_are_those_of_the_command_line(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    for options in ({}, {"method": "field"}, {"fair": 0.0, "motion": "none"}):
        words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
        expected = of_command(command, tmp_path, labels, *words)
        filled = interslice.fill(labels, spacing=SPACING, **options)
        assert filled.dtype == labels.dtype and filled.shape == labels.shape
        np.testing.assert_array_equal(filled, expected)
        assert set(np.unique(filled)) == {0, 1, 5}


@pytest.mark.parametrize("kind", ["bool", "u1", "i1", "<u2", ">u2", "<i2", ">i4", "<i4", "<u4", "<i8", ">u8", "<f4", ">f4", "<f8"])
def test_every_type(kind: str, labels: Volume) -> None:
    given = (labels == 1).astype(kind) if kind == "bool" else labels.astype(kind)
    filled = interslice.fill(given, spacing=SPACING, method="field")
    assert filled.dtype == given.dtype
    expected = interslice.fill((labels == 1).astype(np.uint8) if kind == "bool" else labels, spacing=SPACING, method="field")
    np.testing.assert_array_equal(filled.astype(np.int64), expected)


def test_every_order_and_stride(labels: Volume) -> None:
    expected = interslice.fill(labels, spacing=SPACING, method="field")
    wide = np.zeros((labels.shape[0], 2 * labels.shape[1], 3 * labels.shape[2]), np.uint8)
    wide[:, ::2, ::3] = labels
    read_only = labels.copy()
    read_only.flags.writeable = False
    turned = np.ascontiguousarray(labels[::-1, :, ::-1])[::-1, :, ::-1]
    swapped = np.ascontiguousarray(labels.transpose(1, 2, 0)).transpose(2, 0, 1)
    for given in (np.asfortranarray(labels), wide[:, ::2, ::3], read_only, turned, swapped):
        before = given.copy()
        np.testing.assert_array_equal(interslice.fill(given, spacing=SPACING, method="field"), expected)
        np.testing.assert_array_equal(given, before)


def test_slices_along_every_axis(labels: Volume) -> None:
    expected = interslice.fill(labels, spacing=SPACING, method="field")
    for axis in range(3):
        given = np.moveaxis(labels, 0, axis)
        spacing = np.insert(SPACING[1:], axis, SPACING[0])
        for asked in (None, axis, axis - 3):
            filled = interslice.fill(given, spacing=list(spacing), axis=asked, method="field")
            np.testing.assert_array_equal(np.moveaxis(filled, axis, 0), expected)


def test_drawn_slices_and_other_labels_stay(labels: Volume) -> None:
    filled, told = interslice.fill(labels, spacing=SPACING, only=[1], report=True, method="field")
    np.testing.assert_array_equal(filled[::4] == 1, labels[::4] == 1)
    np.testing.assert_array_equal(filled[labels == 5], 5)
    assert [entry["label"] for entry in told["labels"]] == [1] and told["labels"][0]["differing_pixels"] == 0
    # What lies in the way of another label, too.
    labels[6, 20, 14] = 9
    assert interslice.fill(labels, spacing=SPACING, only=[1], method="field")[6, 20, 14] == 9
    labels[6, 20, 14] = 0
    # A label on one slice cannot be filled: it is left as it is, and named.
    labels[8, 2:4, 2:4] = 9
    filled, told = interslice.fill(labels, spacing=SPACING, report=True, method="field")
    assert (filled[8] == 9).sum() == 4 and (filled[7] == 9).sum() == 0
    assert told["left_out"][0]["label"] == 9


def test_slices_of_each_label(labels: Volume) -> None:
    # What was drawn by another program between the slices does not count.
    labels[6, 5:35, 5:35] = 1
    filled = interslice.fill(labels, spacing=SPACING, slices={1: range(0, 17, 4), 5: [0, 8, 16]}, method="field")
    plain = interslice.fill(drawn() * (drawn() == 1), spacing=SPACING, slices={1: range(0, 17, 4)}, method="field")
    assert 150 < (filled[6] == 1).sum() < 300
    np.testing.assert_array_equal(filled[::4] == 1, plain[::4] == 1)
    np.testing.assert_array_equal(filled[[0, 8, 16]] == 5, labels[[0, 8, 16]] == 5)
    assert set(np.unique(filled)) == {0, 1, 5}
    only_one = interslice.fill(labels, spacing=SPACING, slices={1: range(0, 17, 4)}, method="field")
    np.testing.assert_array_equal(only_one[8] == 5, labels[8] == 5)
    assert (only_one[5] == 5).sum() == 0


def test_a_view_of_a_larger_array_is_not_written_to(labels: Volume) -> None:
    base = np.stack([labels, labels])
    interslice.fill(base[0], spacing=SPACING, method="field")
    np.testing.assert_array_equal(base[1], labels)
    np.testing.assert_array_equal(base[0], labels)


def test_the_report_is_that_of_the_command_line(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    np.save(tmp_path / "given.npy", labels)
    sides = ",".join(str(h) for h in reversed(SPACING))
    command("reconstruct", tmp_path / "given.npy", "--labels", "all", "--spacing", sides, "-q", "-o", tmp_path / "r.json")
    theirs = json.loads((tmp_path / "r.json").read_text())
    _, ours = interslice.fill(labels, spacing=SPACING, report=True)
    assert ours.keys() | {"provenance"} == theirs.keys()
    for own, other in zip(ours["labels"], theirs["labels"], strict=True):
        assert own.keys() == other.keys() and own["volume"] > 0 and own["areas"]["layers"]
        for key in ("label", "voxels", "volume", "area", "areas", "differing_pixels"):
            assert own[key] == other[key], key
        assert own["run"]["warnings"] == other["run"]["warnings"]


def on_slices(numbers: dict[int, list[int]]) -> Volume:
    """Discs of labels beside each other, each on some of 17 slices."""
    labels = np.zeros((17, 24, 60), np.uint8)
    y, x = np.mgrid[:24, :60]
    for label, own in numbers.items():
        labels[own] += (label * (np.hypot(x - 15 * label, y - 12) < 6)).astype(np.uint8)
    return labels


def test_a_label_that_goes_on_across_painted_slices_is_named() -> None:
    labels = on_slices({1: [0, 4, 8, 12, 16], 2: [4, 16]})
    with pytest.warns(UserWarning, match="label 2: interpolated across slices on which only others are painted"):
        across = interslice.fill(labels)
    assert np.all((across == 2).any(axis=(1, 2))[4:])
    ended = interslice.fill(labels, complete_slices=True)
    assert not (ended == 2).any(axis=(1, 2))[8:13].any()


def test_with_complete_slices_each_painted_slice_counts_for_all() -> None:
    labels = on_slices({1: [0, 4, 8, 12, 16], 2: [4, 8]})
    complete, chosen = interslice.fill(labels, complete_slices=True), interslice.fill(labels, slices=[0, 4, 8, 12, 16])
    np.testing.assert_array_equal(complete, chosen)
    areas = (complete == 2).sum(axis=(1, 2))
    assert areas[0] == areas[12] == 0 and 0 < areas[3] < areas[4] and 0 < areas[9] < areas[8]


def test_a_choice_that_takes_slices_between_the_painted_ones_is_told() -> None:
    with pytest.warns(UserWarning, match="`keep` takes every slice whose number is a multiple of 3, painted or not"):
        interslice.fill(on_slices({1: [0, 4, 8, 12, 16], 2: [0, 4, 8, 12, 16]}), keep=3)


def test_voxels_of_no_size_are_told() -> None:
    labels = on_slices({1: [0, 4, 8, 12, 16]})
    says = "nothing says how large voxels are: they count as cubes of 1 px; `spacing` says their sides"
    with pytest.warns(UserWarning, match=says):
        interslice.fill(labels)
    assert any(says in note for note in interslice.read(labels).notes)
    with pytest.warns(UserWarning, match=says):
        interslice.fill((labels, {"spacings": [float("nan")] * 3}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        interslice.fill(labels, spacing=1)
