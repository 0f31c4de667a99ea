"""Volumes and ROIs as they are in files, and label volumes into files."""

from __future__ import annotations

import gzip
from importlib import import_module
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume
from interslice import Segment
from test_recipes import structure_set

# Their own types say too little for a strict check.
nibabel: Any = import_module("nibabel")
nrrd: Any = import_module("nrrd")
pydicom: Any = import_module("pydicom")
sitk: Any = import_module("SimpleITK")

AXES = ((0.8, 0.6, 0.0), (-0.6, 0.8, 0.0), (0.0, 0.0, 1.0))
PLACE: dict[str, Any] = {"spacing": (3.0, 0.8, 1.0), "origin": (-7.5, 12.25, 100.0), "axes": AXES}


@pytest.mark.parametrize("name", ["a.nrrd", "a.seg.nrrd", "a.nii", "a.nii.gz", "a.mha"])
def test_written_and_read(tmp_path: Path, labels: Volume, name: str) -> None:
    path = tmp_path / name
    assert interslice.write_volume(path, labels, **PLACE) == path
    found = interslice.read_volume(path)
    (array,) = found.arrays
    np.testing.assert_array_equal(array, labels)
    assert array.dtype == labels.dtype and not found.grey and found.unit == "mm" and found.spaced
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), labels)
    for spacing, origin, axes in (
        (found.spacing, found.origin, found.axes),
        (image.GetSpacing()[::-1], image.GetOrigin(), np.array(image.GetDirection()).reshape(3, 3).T),
    ):
        np.testing.assert_allclose(spacing, PLACE["spacing"], rtol=0, atol=1e-6)
        np.testing.assert_allclose(origin, PLACE["origin"], rtol=0, atol=1e-6)
        np.testing.assert_allclose(axes, AXES, rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", [np.bool_, np.int8, ">i2", np.uint16, np.int32, np.uint32, np.int64, np.uint64])
def test_types_and_orders(tmp_path: Path, labels: Volume, kind: Any) -> None:
    given = np.asfortranarray((labels == 5) if kind is np.bool_ else labels.astype(kind))
    interslice.write_volume(tmp_path / "a.nrrd", given[:, ::-1])
    array = nrrd.read(str(tmp_path / "a.nrrd"))[0].T
    np.testing.assert_array_equal(array, given[:, ::-1])
    assert array.dtype == (np.uint8 if kind is np.bool_ else np.dtype(kind).newbyteorder("="))
    np.testing.assert_array_equal(interslice.read_volume(tmp_path / "a.nrrd").arrays[0], given[:, ::-1])


def test_an_image_has_its_place(tmp_path: Path, labels: Volume) -> None:
    affine = np.array([[0.0, 0.0, 2.0, 5.0], [-1.0, 0.0, 0.0, 6.0], [0.0, 1.5, 0.0, -7.0], [0.0, 0.0, 0.0, 1.0]])
    given = nibabel.Nifti1Image(labels.T, affine)
    interslice.write_volume(tmp_path / "a.nii.gz", given)
    found = nibabel.load(tmp_path / "a.nii.gz")
    np.testing.assert_allclose(found.affine, affine, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(found.dataobj), labels.T)
    with pytest.raises(ValueError, match="`spacing`, `origin` and `axes` are for arrays; an image has its own place"):
        interslice.write_volume(tmp_path / "a.nii.gz", given, origin=(0, 0, 0))


def test_what_becomes_an_array_has_a_place_given(tmp_path: Path, labels: Volume) -> None:
    class Held:
        """What numpy makes an array of, as it does of xarray's."""

        def __array__(self, dtype: Any = None, copy: Any = None) -> Volume:
            return labels

    interslice.write_volume(tmp_path / "a.nrrd", labels, **PLACE)
    for given in (labels.astype(int).tolist(), Held()):
        interslice.write_volume(tmp_path / "b.nrrd", given, **PLACE)
        one, other = (interslice.read_volume(tmp_path / name) for name in ("a.nrrd", "b.nrrd"))
        np.testing.assert_array_equal(one.arrays[0], other.arrays[0])
        assert one[3:] == other[3:]


def test_names_and_colours(tmp_path: Path, labels: Volume) -> None:
    segments = {1: Segment("liver, left", (255, 128, 0)), 5: Segment(None, (0, 1, 2)), 9: Segment("not drawn", None)}
    interslice.write_volume(tmp_path / "a.seg.nrrd", labels, segments=segments)
    header = nrrd.read_header(str(tmp_path / "a.seg.nrrd"))
    assert [header[f"Segment{k}_Name"] for k in range(3)] == ["liver, left", "5", "not drawn"]
    found = interslice.read_volume(tmp_path / "a.seg.nrrd").segments
    assert found[1] == segments[1] and found[5].colour == (0, 1, 2) and found[9].name == "not drawn"


def test_layers_of_segments_are_arrays(tmp_path: Path) -> None:
    both = np.zeros((2, 6, 5, 4), np.uint8)
    both[0, 1:5, 1:4, 1:3] = 3
    both[1, 2:6, 2:5, 1:3] = 3
    both[1, 0, 0, 0] = 4
    header: dict[str, Any] = {"space": "left-posterior-superior", "kinds": ["list", "domain", "domain", "domain"]}
    header |= {"space directions": np.vstack([[np.nan] * 3, np.eye(3)]), "space origin": np.zeros(3)}
    for k, (layer, value) in enumerate(((0, 3), (1, 3), (1, 4))):
        header |= {f"Segment{k}_LabelValue": str(value), f"Segment{k}_Layer": str(layer), f"Segment{k}_Name": f"s{k}"}
    nrrd.write(str(tmp_path / "a.seg.nrrd"), both, header)
    found = interslice.read_volume(tmp_path / "a.seg.nrrd")
    assert [segment.name for segment in found.segments.values()] == ["s0", "s1", "s2"]
    np.testing.assert_array_equal(found.arrays[0], (both[0] == 3).T * 1)
    np.testing.assert_array_equal(found.arrays[1], (both[1] == 3).T * 2 + (both[1] == 4).T * 3)


def test_grey_values(tmp_path: Path) -> None:
    greys = np.random.default_rng(3).normal(0, 100, (5, 6, 30))
    for kind in (np.int16, np.float32, np.float64):
        sitk.WriteImage(sitk.GetImageFromArray(greys.astype(kind)), str(tmp_path / "a.mha"))
        found = interslice.read_volume(tmp_path / "a.mha")
        assert found.grey and found.arrays[0].dtype == kind
        np.testing.assert_array_equal(found.arrays[0], greys.astype(kind))
    scaled = nibabel.Nifti1Image(greys, np.eye(4))
    scaled.header.set_data_dtype(np.int16)
    nibabel.save(scaled, tmp_path / "a.nii")
    np.testing.assert_allclose(interslice.read_volume(tmp_path / "a.nii").arrays[0].T, nibabel.load(tmp_path / "a.nii").get_fdata(), rtol=1e-6)
    # Labels that a program has saved as floats are whole numbers again.
    sitk.WriteImage(sitk.GetImageFromArray((greys > 0).astype(np.float32) * 300), str(tmp_path / "a.mha"))
    found = interslice.read_volume(tmp_path / "a.mha")
    assert not found.grey and found.arrays[0].dtype == np.int16 and found.arrays[0].max() == 300


def test_rois(tmp_path: Path) -> None:
    structure_set(tmp_path / "rt.dcm")
    (roi,) = interslice.read_rois(tmp_path / "rt.dcm")
    assert (roi.number, roi.name, len(roi.contours)) == (1, "Body", 5)
    for k, (kind, points) in enumerate(roi.contours):
        assert kind == "CLOSED_PLANAR" and points.shape == (60, 3)
        np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), (20, 22, 24, 22, 20)[k], atol=1e-3)
        np.testing.assert_array_equal(points[:, 2], 5.0 * k)
    assert interslice.read_rois(tmp_path)[0].name == "Body"


def test_a_roi_that_cannot_be_read_has_no_contours(tmp_path: Path) -> None:
    path = tmp_path / "rt.dcm"
    structure_set(path)
    damaged = pydicom.dcmread(path)
    damaged.ROIContourSequence[0].ContourSequence[1].NumberOfContourPoints = 7
    damaged.save_as(path)
    with pytest.warns(UserWarning, match=r"rt\.dcm: ROI 1 \(`Body`\), contour 2: Number of Contour Points is 7, but Contour Data has 60"):
        (roi,) = interslice.read_rois(path)
    assert (roi.name, roi.contours) == ("Body", [])


def test_what_is_wrong_is_said(tmp_path: Path, labels: Volume) -> None:
    path = tmp_path / "a.mha"
    path.write_text("before")
    for wrong, words in (
        ({"axes": np.ones((3, 3))}, "`axes` must be unit vectors; got one 1.73205 long"),
        ({"axes": [[1, 0, 0], [0.6, 0.8, 0], [0, 0, 1]]}, "axes 0 and 1 are not perpendicular"),
        ({"spacing": (1, 0, 1)}, "`spacing` must be positive; got 0"),
        ({"origin": (0, np.inf, 0)}, "the origin holds inf"),
    ):
        with pytest.raises(ValueError, match=words):
            interslice.write_volume(path, labels, **wrong)
    with pytest.raises(ValueError, match="must be whole numbers, of a type of integers; got float64"):
        interslice.write_volume(path, labels.astype(float))
    with pytest.raises(ValueError, match="within 16777216 either side of 0; got 16777217"):
        interslice.write_volume(path, labels.astype(np.int64) * (2**24 + 1))
    for beyond in (2**63, 2**64 - 1):
        with pytest.raises(ValueError, match=f"within 16777216 either side of 0; got {beyond}"):
            interslice.write_volume(path, np.where(labels > 0, np.uint64(beyond), np.uint64(0)))
    for colour in ((300, 0, 0), (-1, 0, 0), (1, 2)):
        with pytest.raises(ValueError, match=r"`segments` must have colours of three whole numbers from 0 to 255; label 5 has \("):
            interslice.write_volume(path, labels, segments={5: Segment("a", colour)})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"`segments` takes whole numbers; got 0\.5"):
        interslice.write_volume(path, labels, segments={1: Segment("a", (0.5, 0.2, 1.0))})  # type: ignore[arg-type]
    with pytest.raises(OSError, match=r"a\.stl: cannot write: is the name of no volume"):
        interslice.write_volume(tmp_path / "a.stl", labels)
    with pytest.raises(ValueError, match=r"a\.mha"):
        interslice.read_volume(path)
    with pytest.raises(FileNotFoundError, match=r"none\.mha"):
        interslice.read_volume(tmp_path / "none.mha")
    with pytest.raises(ValueError, match=r"a\.mha"):
        interslice.read_rois(path)
    (tmp_path / "stack.json").write_text("{}")
    with pytest.raises(ValueError, match="is not a label volume"):
        interslice.read_volume(tmp_path / "stack.json")
    assert path.read_text() == "before" and len(list(tmp_path.iterdir())) == 2


def test_a_header_that_asks_for_too_much(tmp_path: Path) -> None:
    """1.5 TiB, of which a few bytes say that they are there."""
    head = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 20000 20000 2000\nendian: little\nencoding: gzip\n\n"
    (tmp_path / "a.nrrd").write_bytes(head.encode() + gzip.compress(b"\0" * 1000))
    with pytest.raises(ValueError, match=r"a\.nrrd: 1600000000000 bytes of voxels are more than"):
        interslice.read_volume(tmp_path / "a.nrrd")


def test_a_zarr_that_holds_anything_else_stays(tmp_path: Path, labels: Volume) -> None:
    path = tmp_path / "exp.zarr"
    for _ in range(2):
        interslice.write_volume(path, labels, spacing=1)
    (path / "labels").mkdir()
    (path / "labels" / "notes.txt").write_text("mine")
    with pytest.raises(OSError, match=r"exp.zarr: .* holds more than an output does \(`labels`\), and is not replaced"):
        interslice.write_volume(path, labels, spacing=1)
    assert (path / "labels" / "notes.txt").read_text() == "mine"
