"""Images of nibabel, SimpleITK and pynrrd: their geometry is used, and they come back as what they were."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume

# Their own types say too little for a strict check.
nibabel: Any = import_module("nibabel")
nrrd: Any = import_module("nrrd")
sitk: Any = import_module("SimpleITK")

TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def test_nibabel(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    affine = np.eye(4)
    affine[:3, :3] = TURN @ np.diag([1.0, 0.8, 3.0])
    affine[:3, 3] = [-20.0, 5.0, 40.0]
    given = nibabel.Nifti1Image(labels.T, affine)
    nibabel.save(given, tmp_path / "given.nii.gz")
    filled = interslice.fill(given, method="field")
    assert isinstance(filled, nibabel.Nifti1Image)
    np.testing.assert_allclose(filled.affine, affine)
    command("reconstruct", tmp_path / "given.nii.gz", "--labels", "all", "--method", "field", "-q", "-o", tmp_path / "out.nii")
    np.testing.assert_array_equal(np.asarray(filled.dataobj), np.asarray(nibabel.load(tmp_path / "out.nii").dataobj))


def test_units_are_those_of_the_file(tmp_path: Path, labels: Volume) -> None:
    for code, unit in (("micron", "um"), ("meter", "m"), ("mm", "mm"), ("unknown", "mm")):
        given = nibabel.Nifti1Image(labels.T, np.diag([1.0, 0.8, 3.0, 1.0]))
        given.header.set_xyzt_units(code)
        nibabel.save(given, tmp_path / "given.nii")
        of_image, of_file = interslice.read(nibabel.load(tmp_path / "given.nii")), interslice.read(tmp_path / "given.nii")
        assert of_image.unit == of_file.unit == unit
    mgh = nibabel.MGHImage(labels.T, np.diag([1.0, 0.8, 3.0, 1.0]))
    assert interslice.read(mgh).unit == "mm"
    header: dict[str, Any] = {"space dimension": 3, "space directions": np.diag([1.0, 0.8, 3.0])}
    for units, unit in ((["um"] * 3, "um"), (["", "", ""], "mm"), (["cm", "", "cm"], "cm")):
        nrrd.write(str(tmp_path / "given.nrrd"), labels.T, header | {"space units": units})
        of_image, of_file = interslice.read(nrrd.read(str(tmp_path / "given.nrrd"))), interslice.read(tmp_path / "given.nrrd")
        assert of_image.unit == of_file.unit == unit
    with pytest.raises(ValueError, match="space units are um and mm: all axes must have the same"):
        interslice.read((labels.T, header | {"space units": ["um", "mm", "mm"]}))


def test_simpleitk_keeps_what_still_holds(tmp_path: Path, labels: Volume) -> None:
    segments = {1: interslice.Segment("liver", (221, 130, 101)), 5: interslice.Segment("spleen", (157, 108, 162))}
    interslice.write_volume(tmp_path / "given.seg.nrrd", labels, spacing=(3, 1, 1), segments=segments)
    given = sitk.ReadImage(str(tmp_path / "given.seg.nrrd"))
    given.SetMetaData("Segment0_Extent", "6 26 11 29 0 16")
    filled = interslice.fill(given, method="field")
    kept = {key for key in given.GetMetaDataKeys() if not key.endswith("_Extent") and not key.startswith("ITK_")}
    assert {"Segment0_Name", "Segment1_Color"} <= kept < set(given.GetMetaDataKeys())
    assert {key: filled.GetMetaData(key) for key in filled.GetMetaDataKeys()} == {key: given.GetMetaData(key) for key in kept}
    sitk.WriteImage(filled, str(tmp_path / "filled.seg.nrrd"))
    found = interslice.read_volume(tmp_path / "filled.seg.nrrd")
    assert {label: (one.name, one.colour) for label, one in found.segments.items()} == {k: tuple(v) for k, v in segments.items()}
    with pytest.raises(ValueError, match="`labels` must have 3 axes; got an image of 2"):
        interslice.fill(given[:, :, 0])
    with pytest.raises(ValueError, match="`labels` must have 3 axes; got an image of 4"):
        interslice.fill(sitk.JoinSeries([given, given]))


def test_simpleitk(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    given = sitk.GetImageFromArray(labels)
    given.SetSpacing((1.0, 0.8, 3.0))
    given.SetOrigin((3.0, -4.0, 5.0))
    given.SetDirection(tuple(TURN.ravel()))
    sitk.WriteImage(given, str(tmp_path / "given.mha"))
    filled = interslice.fill(given, method="field")
    assert filled.GetSpacing() == given.GetSpacing() and filled.GetDirection() == given.GetDirection()
    assert filled.GetPixelID() == given.GetPixelID()
    command("reconstruct", tmp_path / "given.mha", "--labels", "all", "--method", "field", "-q", "-o", tmp_path / "out.mha")
    expected = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / "out.mha")))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(filled), expected)


def test_pynrrd(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    header = {
        "space": "right-anterior-superior",
        "space directions": np.diag([1.0, 0.8, 3.0]),
        "space origin": np.array([1.0, 2.0, 3.0]),
    }
    nrrd.write(str(tmp_path / "given.nrrd"), labels.T, header)
    given = nrrd.read(str(tmp_path / "given.nrrd"))
    filled, same = interslice.fill(given, method="field")
    assert same is given[1]
    command("reconstruct", tmp_path / "given.nrrd", "--labels", "all", "--method", "field", "-q", "-o", tmp_path / "out.nrrd")
    np.testing.assert_array_equal(filled, nrrd.read(str(tmp_path / "out.nrrd"))[0])
    # The place in the world, too.
    body = interslice.reconstruct(interslice.read(given, label=1), method="field")
    command("reconstruct", tmp_path / "given.nrrd", "--label", 1, "--method", "field", "-q", "-o", tmp_path / "a.ply")
    body.save(str(tmp_path / "b.ply"))
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_one_volume_of_four_axes_is_one(labels: Volume) -> None:
    flat = nibabel.Nifti1Image(labels.T, np.diag([1.0, 0.8, 3.0, 1.0]))
    deep = nibabel.Nifti1Image(labels.T[..., None], flat.affine)
    filled = interslice.fill(deep, method="field")
    assert filled.shape == deep.shape
    np.testing.assert_array_equal(np.asarray(filled.dataobj)[..., 0], np.asarray(interslice.fill(flat, method="field").dataobj))
    with pytest.raises(ValueError, match=r"`labels` must have 3 axes; got an image of the shape \(.*, 2\)"):
        interslice.fill(nibabel.Nifti1Image(np.stack([labels.T] * 2, axis=3), flat.affine))


def test_a_label_map_is_refused_and_not_asked_for_its_array(labels: Volume) -> None:
    with pytest.raises(TypeError, match="`labels` is a label map of SimpleITK"):
        interslice.fill(sitk.Cast(sitk.GetImageFromArray(labels), sitk.sitkLabelUInt8))
