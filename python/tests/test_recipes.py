"""The recipes of docs/python.md, each run as it stands."""

from __future__ import annotations

import re
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import drawn

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def recipes() -> dict[str, str]:
    """Code by heading."""
    parts = re.split(r"^## (.*)$", PAGE.read_text(), flags=re.MULTILINE)[1:]
    found = {}
    for heading, text in zip(parts[::2], parts[1::2], strict=True):
        code = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
        if code:
            found[heading] = "\n".join(code)
    return found


def run(heading: str) -> dict[str, Any]:
    known: dict[str, Any] = {}
    exec(compile(recipes()[heading], f"docs/python.md, {heading}", "exec"), known)
    return known


def structure_set(path: Path) -> None:
    """An RTSTRUCT with one ROI: circles on five planes."""
    pydicom: Any = import_module("pydicom")

    def one(**fields: Any) -> Any:
        made = pydicom.Dataset()
        for name, value in fields.items():
            setattr(made, name, value)
        return made

    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    contours = []
    for k, radius in enumerate((20.0, 22.0, 24.0, 22.0, 20.0)):
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(60, 5.0 * k)])
        data = [f"{v:.4f}" for v in points.ravel()]
        contours.append(one(ContourGeometricType="CLOSED_PLANAR", NumberOfContourPoints=60, ContourData=data))
    meta = pydicom.dataset.FileMetaDataset()
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.481.3"
    meta.MediaStorageSOPInstanceUID = "1.2.3.4"
    file = one(
        SOPClassUID=meta.MediaStorageSOPClassUID,
        SOPInstanceUID=meta.MediaStorageSOPInstanceUID,
        Modality="RTSTRUCT",
        SeriesInstanceUID="1.2.3.5",
        StudyInstanceUID="1.2.3.6",
        StructureSetROISequence=[one(ROINumber=1, ROIName="Body", ReferencedFrameOfReferenceUID="1.2.3.7")],
        ROIContourSequence=[one(ReferencedROINumber=1, ContourSequence=contours)],
    )
    file.file_meta = meta
    file.save_as(path, enforce_file_format=True)


def test_every_recipe_is_run_here_or_in_napari() -> None:
    here = set(re.findall(r"run\(\"(.*?)\"\)", Path(__file__).read_text()))
    assert set(recipes()) - {"napari"} == here


def test_fill_a_label_array() -> None:
    known = run("Fill a label array")
    assert known["interpolated"].sum() > 1000


def test_rtstruct_to_nifti(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    structure_set(tmp_path / "rtstruct.dcm")
    monkeypatch.chdir(tmp_path)
    body = run("RTSTRUCT to NIfTI")["body"]
    nibabel: Any = import_module("nibabel")
    voxels = nibabel.load("body.nii.gz")
    assert np.asarray(voxels.dataobj).sum() * np.prod(voxels.header.get_zooms()) == pytest.approx(body.volume, rel=0.05)


def test_names_and_colours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    known = run("Names and colours")
    assert known["volume"].format == "NRRD" and (tmp_path / "organs.seg.nrrd").is_file()


def test_a_mesh_for_printing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    known = run("A mesh for printing")
    assert (tmp_path / "vase.stl").stat().st_size == 84 + 50 * len(known["faces"])


def test_a_cohort(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nibabel: Any = import_module("nibabel")
    (tmp_path / "cohort").mkdir()
    for k in range(3):
        image = nibabel.Nifti1Image(drawn(count=3 + k).T, np.diag([1.0, 1.0, 3.0, 1.0]))
        nibabel.save(image, tmp_path / "cohort" / f"case{k}.nii.gz")
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        # joblib's own, of machines on which it cannot count the cores.
        warnings.simplefilter("ignore", UserWarning)
        assert run("A cohort with joblib")["done"] == [f"case{k}.nii.gz" for k in range(3)]
    filled = nibabel.load(tmp_path / "cohort" / "filled_case1.nii.gz")
    np.testing.assert_array_equal(np.asarray(filled.dataobj).T, interslice.fill(drawn(count=4), spacing=(3, 1, 1), method="field"))


def test_change_a_slice() -> None:
    known = run("Change a slice")
    assert known["body"].stale == [] and known["below"].shape == (64, 64)
