"""Files opened and saved in real napari; nibabel, pynrrd and SimpleITK say independently what is in them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import interslice
import npe2
import numpy as np
import pytest
from napari.layers import Image, Labels, Shapes
from napari_interslice._reader import of_dicom, of_pair
from napari_interslice._widget import PREVIEW

# Their own types say too little for a strict check.
nibabel: Any = import_module("nibabel")
nrrd: Any = import_module("nrrd")
sitk: Any = import_module("SimpleITK")
pydicom: Any = import_module("pydicom")

Array = np.ndarray[Any, Any]
PLUGIN = "napari-interslice"
SPACING = (0.8, 0.9, 3.0)
ORIGIN = (-12.5, 30.25, -101.75)
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
# Directions of the file's axes as columns, LPS: as DICOM has them, flipped as NIfTI mostly is, sagittal slices, oblique.
DIRECTIONS = {
    "upright": np.eye(3),
    "flipped": np.diag([-1.0, -1.0, 1.0]),
    "sagittal": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
    "oblique": TURN,
}


@pytest.fixture
def viewer(make_napari_viewer: Callable[..., Any]) -> Iterator[Any]:
    yield make_napari_viewer(show=os.environ.get("INTERSLICE_SHOTS") is not None)


def painted() -> Array:
    """Labels 2 and 7 (z, y, x), no axis like another."""
    labels = np.zeros((9, 14, 20), np.uint16)
    labels[2:8:2, 3:9, 4:12] = 2
    labels[1, 10:13, 14:18] = 700
    return labels


def image(labels: Array, directions: Array) -> Any:
    made = sitk.GetImageFromArray(labels)
    made.SetSpacing(SPACING)
    made.SetOrigin(ORIGIN)
    made.SetDirection(tuple(directions.ravel()))
    return made


def same(path: Path, other: Path, off: float = 1e-6) -> None:
    """SimpleITK finds the same voxels in the same place."""
    one, two = sitk.ReadImage(str(path)), sitk.ReadImage(str(other))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(one), sitk.GetArrayFromImage(two))
    assert one.GetPixelID() == two.GetPixelID()
    for corner in ((0, 0, 0), tuple(n - 1 for n in one.GetSize())):
        np.testing.assert_allclose(one.TransformIndexToPhysicalPoint(corner), two.TransformIndexToPhysicalPoint(corner), rtol=0, atol=off)
    np.testing.assert_allclose(one.GetSpacing(), two.GetSpacing(), rtol=0, atol=off)
    np.testing.assert_allclose(one.GetDirection(), two.GetDirection(), rtol=0, atol=off)


@pytest.mark.parametrize("extension", [".nii.gz", ".nii", ".nrrd", ".mha"])
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_a_volume_comes_back_as_it_was(viewer: Any, tmp_path: Path, directions: str, extension: str) -> None:
    given, saved = tmp_path / f"given{extension}", tmp_path / f"saved{extension}"
    sitk.WriteImage(image(painted(), DIRECTIONS[directions]), str(given))
    (layer,) = viewer.open(given, plugin=PLUGIN)
    assert isinstance(layer, Labels) and layer.name == "given" and {str(u) for u in layer.units} == {"millimeter"}
    assert layer.save(str(saved), plugin=PLUGIN) == [str(saved)]
    # NIfTI holds places in 32 bits, which SimpleITK rounds once more when it computes directions.
    same(saved, given)
    if extension.startswith(".nii"):
        one, two = nibabel.load(given), nibabel.load(saved)
        np.testing.assert_array_equal(np.asarray(one.dataobj), np.asarray(two.dataobj))
        np.testing.assert_allclose(two.affine, one.affine, rtol=0, atol=1e-6)


@pytest.mark.parametrize("directions", ["upright", "flipped", "sagittal"])
def test_voxels_are_shown_where_they_lie(viewer: Any, tmp_path: Path, directions: str) -> None:
    labels = np.zeros((9, 14, 20), np.uint8)
    labels[2, 3, 5] = 1
    made = image(labels, DIRECTIONS[directions])
    sitk.WriteImage(made, str(tmp_path / "a.nrrd"))
    (layer,) = viewer.open(tmp_path / "a.nrrd", plugin=PLUGIN)
    (index,) = np.argwhere(layer.data)
    world = made.TransformIndexToPhysicalPoint((5, 3, 2))
    np.testing.assert_allclose(layer.data_to_world(index), world[::-1], rtol=0, atol=1e-9)
    assert (np.asarray(layer.scale) > 0).all()


def segmentation(path: Path) -> None:
    header = {
        "space": "left-posterior-superior",
        "space directions": np.diag(SPACING),
        "space origin": np.array(ORIGIN),
        "Segment0_LabelValue": "2",
        "Segment0_Name": "left lung",
        "Segment0_Color": "0.2 0.4 0.8",
        "Segment1_LabelValue": "700",
        "Segment1_Name": "tumour",
        "Segment1_Color": "1 0 0",
    }
    nrrd.write(str(path), painted().T, header)


def test_segments_keep_names_and_colours(viewer: Any, tmp_path: Path) -> None:
    segmentation(tmp_path / "given.seg.nrrd")
    (layer,) = viewer.open(tmp_path / "given.seg.nrrd", plugin=PLUGIN)
    assert layer.name == "given"
    assert dict(zip(layer.features["index"], layer.features["name"], strict=True)) == {2: "left lung", 700: "tumour"}
    np.testing.assert_allclose(layer.get_color(2), [0.2, 0.4, 0.8, 1.0], atol=1e-6)
    # Whoever paints another label sees it.
    layer.data[0, 0, 0] = 9
    layer.refresh()
    assert layer.get_color(9)[3] == 1
    viewer.dims.set_current_step(0, 2)
    assert "left lung" in str(layer.get_status(layer.data_to_world((2, 4, 6)), world=True))
    layer.save(str(tmp_path / "saved.seg.nrrd"), plugin=PLUGIN)
    data, header = nrrd.read(str(tmp_path / "saved.seg.nrrd"))
    np.testing.assert_array_equal(data.T, layer.data)
    np.testing.assert_allclose(header["space directions"], np.diag(SPACING), rtol=0, atol=1e-6)
    np.testing.assert_allclose(header["space origin"], ORIGIN, rtol=0, atol=1e-6)
    said = {}
    for k in range(3):
        colour = [float(c) for c in header[f"Segment{k}_Color"].split()]
        said[int(header[f"Segment{k}_LabelValue"])] = (header[f"Segment{k}_Name"], np.round(colour, 6).tolist())
    assert said[2] == ("left lung", [0.2, 0.4, 0.8]) and said[700] == ("tumour", [1.0, 0.0, 0.0]) and said[9][0] == "9"
    assert header["type"] == "uint16"


def test_overlapping_segments_are_layers(viewer: Any, tmp_path: Path) -> None:
    both = np.zeros((2, 10, 8, 6), np.uint8)
    both[0, 1:8, 1:6, 1:5] = 1
    both[1, 4:9, 2:7, 2:4] = 1
    header: dict[str, Any] = {
        "space": "left-posterior-superior",
        "kinds": ["list", "domain", "domain", "domain"],
        "space directions": np.vstack([[np.nan] * 3, np.diag(SPACING)]),
        "space origin": np.array(ORIGIN),
    }
    for k, name in enumerate(("organ", "lesion")):
        header |= {f"Segment{k}_LabelValue": "1", f"Segment{k}_Layer": str(k), f"Segment{k}_Name": name, f"Segment{k}_Color": f"{k} 1 0"}
    nrrd.write(str(tmp_path / "both.seg.nrrd"), both, header)
    organ, lesion = viewer.open(tmp_path / "both.seg.nrrd", plugin=PLUGIN)
    assert (organ.name, lesion.name) == ("both: organ", "both: lesion")
    np.testing.assert_array_equal(organ.data, both[0].T * 1)
    np.testing.assert_array_equal(lesion.data, both[1].T * 2)
    assert list(lesion.features["name"]) == ["lesion"]


def test_a_scan_is_an_image(viewer: Any, tmp_path: Path) -> None:
    grey = np.random.default_rng(1).normal(0, 300, (9, 14, 20))
    for kind, name in ((np.int16, "ct.nii.gz"), (np.float32, "mr.mha")):
        sitk.WriteImage(image(grey.astype(kind), np.eye(3)), str(tmp_path / name))
        (layer,) = viewer.open(tmp_path / name, plugin=PLUGIN)
        assert isinstance(layer, Image) and layer.data.dtype == kind
        np.testing.assert_array_equal(layer.data, grey.astype(kind))
        np.testing.assert_allclose(layer.scale, SPACING[::-1], atol=1e-6)
        np.testing.assert_allclose(layer.translate, ORIGIN[::-1], atol=1e-6)


def test_filled_and_saved(viewer: Any, tmp_path: Path, qtbot: Any) -> None:
    sitk.WriteImage(image(painted(), DIRECTIONS["sagittal"]), str(tmp_path / "a.nii.gz"))
    (layer,) = viewer.open(tmp_path / "a.nii.gz", plugin=PLUGIN)
    _, widget = viewer.window.add_plugin_dock_widget(PLUGIN, "Fill between slices")
    layer.selected_label = 2
    widget.start.click()
    qtbot.waitUntil(lambda: widget.start.isEnabled(), timeout=60_000)
    preview = viewer.layers[PREVIEW]
    assert preview.units == layer.units
    np.testing.assert_array_equal(preview.translate, layer.translate)
    widget.keep.click()
    layer.save(str(tmp_path / "b.nii.gz"), plugin=PLUGIN)
    given, saved = nibabel.load(tmp_path / "a.nii.gz"), nibabel.load(tmp_path / "b.nii.gz")
    np.testing.assert_allclose(saved.affine, given.affine, rtol=0, atol=1e-6)
    expected = interslice.fill(given, only=[2])
    np.testing.assert_array_equal(np.asarray(saved.dataobj), np.asarray(expected.dataobj))
    assert (np.asarray(saved.dataobj) == 2).sum() > (np.asarray(given.dataobj) == 2).sum()


def test_a_layer_from_elsewhere_has_its_own_place(viewer: Any, tmp_path: Path) -> None:
    layer = viewer.add_labels(painted(), scale=(3.0, 0.9, 0.8), translate=(5.0, 6.0, 7.0))
    layer.save(str(tmp_path / "a.mha"), plugin=PLUGIN)
    found = sitk.ReadImage(str(tmp_path / "a.mha"))
    assert found.GetSpacing() == (0.8, 0.9, 3.0) and found.GetOrigin() == (7.0, 6.0, 5.0)
    # A scale that is changed in napari counts.
    (again,) = viewer.open(tmp_path / "a.mha", plugin=PLUGIN)
    again.scale = (2.5, 0.9, 0.8)
    again.save(str(tmp_path / "b.mha"), plugin=PLUGIN)
    assert sitk.ReadImage(str(tmp_path / "b.mha")).GetSpacing() == (0.8, 0.9, 2.5)


def test_a_name_without_extension_gets_that_of_the_format(viewer: Any, tmp_path: Path) -> None:
    """As the dialog gives it: the writer is chosen by the filter, and the name is what was typed."""
    layer = viewer.add_labels(painted(), name="mine")
    for command, name in (("nifti", "a.v2.nii.gz"), ("slicer", "a.v2.seg.nrrd"), ("nrrd", "a.v2.nrrd"), ("metaimage", "a.v2.mha")):
        (writer,) = [w for w in npe2.PluginManager.instance().iter_compatible_writers(["labels"]) if w.command == f"{PLUGIN}.write_{command}"]
        assert viewer.layers.save(str(tmp_path / "a.v2"), selected=True, _writer=writer) == [str(tmp_path / name)]
    viewer.layers.save(str(tmp_path / "b.nii.gz"), plugin=PLUGIN)
    same(tmp_path / "b.nii.gz", tmp_path / "a.v2.mha")
    assert layer in viewer.layers.selection


def structures(path: Path) -> None:
    """An RTSTRUCT of two ROIs, one with a hole, planes 2.5 mm apart."""
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.481.3"
    meta.MediaStorageSOPInstanceUID = "1.2.3"
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    file = pydicom.dataset.FileDataset(str(path), {}, file_meta=meta, preamble=b"\0" * 128)
    file.SOPClassUID, file.SOPInstanceUID, file.Modality = meta.MediaStorageSOPClassUID, "1.2.3", "RTSTRUCT"
    file.StructureSetROISequence, file.ROIContourSequence = [], []
    for number, (name, heights) in enumerate({"Heart ": (-10.0, -7.5, -2.5), "Lung": (-7.5,), "Empty": ()}.items(), 1):
        roi, drawn = pydicom.Dataset(), pydicom.Dataset()
        roi.ROINumber, roi.ROIName = number, name
        drawn.ReferencedROINumber, drawn.ROIDisplayColor, drawn.ContourSequence = number, [255, 128, 0], []
        for z in heights:
            contour = pydicom.Dataset()
            contour.ContourGeometricType, contour.NumberOfContourPoints = "CLOSED_PLANAR", 4
            contour.ContourData = [10, 20, z, 40, 20, z, 40, 50, z, 10, 50, z]
            drawn.ContourSequence.append(contour)
        file.StructureSetROISequence.append(roi)
        file.ROIContourSequence.append(drawn)
    file.save_as(path, enforce_file_format=True)


def test_an_rtstruct_is_shapes(viewer: Any, tmp_path: Path) -> None:
    structures(tmp_path / "rt.dcm")
    heart, lung = viewer.open(tmp_path / "rt.dcm", plugin=PLUGIN)
    assert isinstance(heart, Shapes) and [heart.name, lung.name] == ["Heart", "Lung"]
    assert len(heart.data) == 3 and set(heart.shape_type) == {"path"}
    world = np.array([heart.data_to_world(point) for point in heart.data[2]])
    np.testing.assert_allclose(world, [[-2.5, 20, 10], [-2.5, 20, 40], [-2.5, 50, 40], [-2.5, 50, 10], [-2.5, 20, 10]])
    np.testing.assert_allclose(heart.edge_color[0], [1.0, 128 / 255, 0.0, 1.0])
    # One step of the slider is one plane.
    assert viewer.dims.range[0].step == 2.5 and viewer.dims.nsteps[0] == 4
    shown = []
    for step in range(4):
        viewer.dims.set_current_step(0, step)
        shown.append(int(heart._data_view._displayed.sum()))
    assert shown == [1, 1, 0, 1]


def test_what_is_wrong_is_said(viewer: Any, tmp_path: Path) -> None:
    sitk.WriteImage(image(painted(), np.eye(3)), str(tmp_path / "whole.nii.gz"))
    (tmp_path / "half.nii.gz").write_bytes((tmp_path / "whole.nii.gz").read_bytes()[:150])
    nibabel.save(nibabel.Nifti1Image(np.zeros((4, 5, 6, 7), np.uint8), np.eye(4)), tmp_path / "film.nii")
    (tmp_path / "no.nrrd").write_text("hello")
    for name, words in {"half.nii.gz": "half.nii.gz: ", "film.nii": "as a file of its own", "no.nrrd": "no.nrrd: "}.items():
        with pytest.raises(ValueError, match=words):
            viewer.open(tmp_path / name, plugin=PLUGIN)
    assert len(viewer.layers) == 0
    flat = viewer.add_labels(np.ones((5, 6), np.uint8), name="flat")
    with pytest.raises(OSError, match=r"flat\.mha: layer `flat` must have 3 axes to be written as a volume; it has 2"):
        flat.save(str(tmp_path / "flat.mha"), plugin=PLUGIN)
    large = viewer.add_labels(np.full((2, 3, 4), 1 << 30), name="large")
    (tmp_path / "large.mha").write_text("before")
    with pytest.raises(OSError, match="within 16777216 either side of 0; got 1073741824"):
        large.save(str(tmp_path / "large.mha"), plugin=PLUGIN)
    good = viewer.add_labels(np.ones((2, 3, 4), np.uint8), name="good", shear=[0.2, 0, 0])
    with pytest.raises(OSError, match="not perpendicular"):
        good.save(str(tmp_path / "large.mha"), plugin=PLUGIN)
    with pytest.raises(OSError, match="nowhere"):
        good.save(str(tmp_path / "nowhere" / "a.mha"), plugin=PLUGIN)
    # What was there is there, and nothing half done beside it.
    assert (tmp_path / "large.mha").read_text() == "before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.nii", "half.nii.gz", "large.mha", "no.nrrd", "whole.nii.gz"]


def test_two_files_are_one_volume(viewer: Any, tmp_path: Path) -> None:
    nibabel.save(nibabel.Nifti1Pair(painted().T, np.diag([-0.8, -0.9, 3.0, 1.0])), tmp_path / "a.img")
    for name in ("a.img", "a.hdr"):
        (layer,) = viewer.open(tmp_path / name, plugin=PLUGIN)
        np.testing.assert_array_equal(layer.data, painted())
        np.testing.assert_allclose(layer.scale, (3.0, 0.9, 0.8), atol=1e-6)
    (tmp_path / "light.hdr").write_bytes(b"#?RADIANCE\n")
    (tmp_path / "raw.img").write_bytes(b"1234")
    assert of_pair(str(tmp_path / "a.hdr")) is not None
    assert of_pair(str(tmp_path / "light.hdr")) is None and of_pair(str(tmp_path / "raw.img")) is None


def test_a_file_without_spacing_gets_none(viewer: Any, tmp_path: Path) -> None:
    nrrd.write(str(tmp_path / "a.nrrd"), painted().T)
    (layer,) = viewer.open(tmp_path / "a.nrrd", plugin=PLUGIN)
    assert {str(u) for u in layer.units} == {"pixel"} and list(layer.scale) == [1, 1, 1]
    layer.save(str(tmp_path / "b.nrrd"), plugin=PLUGIN)
    assert set(nrrd.read_header(str(tmp_path / "b.nrrd"))["space units"]) == {"px"}


def test_other_dicom_files_are_left_to_others(tmp_path: Path) -> None:
    structures(tmp_path / "rt.dcm")
    assert of_dicom(str(tmp_path / "rt.dcm")) is not None
    (tmp_path / "ct.dcm").write_bytes((tmp_path / "rt.dcm").read_bytes().replace(b"1.1.481.3", b"1.1.2\0\0\0\0"))
    assert of_dicom(str(tmp_path / "ct.dcm")) is None
    assert of_dicom(str(tmp_path / "missing.dcm")) is None and of_dicom([str(tmp_path / "rt.dcm")]) is None
