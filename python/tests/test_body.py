"""`reconstruct` and `Body`: the bytes of the command line, and everything that a body can be asked."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume
from numpy.typing import NDArray

HEIGHTS = [0.0, 3.0, 7.0, 10.0, 12.0]
Masks = NDArray[np.bool_]
FILES = ["v.nrrd", "v.nii.gz", "v.mha", "m.stl", "m.ply", "m.obj", "m.glb", "p.png", "v.tif", "v.npz", "h.dem.tif", "l.geojson", "c.contours.json"]


def test_files_are_those_of_the_command_line_byte_for_byte(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    np.save(tmp_path / "given.npy", labels)
    options = ["--spacing", "1,0.8,3", "--label", "1", "--dz", "1.5", "--end-top", "extrapolate", "--contours"]
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    ours.mkdir()
    theirs.mkdir()
    outputs = [word for name in FILES for word in ("-o", theirs / name)]
    command("reconstruct", tmp_path / "given.npy", *options, "-q", *outputs, "-o", theirs / "r.json")
    stack = interslice.read(tmp_path / "given.npy", spacing=[1, 0.8, 3], label=1)
    body = interslice.reconstruct(stack, dz=1.5, end_top="extrapolate")
    written = body.save(*[ours / name for name in FILES], contours=True)
    assert [Path(path).name for path in written] == FILES
    for name in FILES:
        assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name
    told, report = body.report, json.loads((theirs / "r.json").read_text())
    for key in ("volume", "area", "contours", "body", "settings", "ends", "warnings"):
        assert told[key] == report[key], key
    assert body.volume == report["volume"]
    # The same from the array.
    of_array = interslice.reconstruct(interslice.read(labels, spacing=(3, 0.8, 1), label=1), dz=1.5, end_top="extrapolate")
    of_array.save(ours / "again.ply")
    assert (ours / "again.ply").read_bytes() == (theirs / "m.ply").read_bytes()


def test_reports_are_those_of_the_command_line(command: Callable[..., Any], tmp_path: Path, labels: Volume) -> None:
    np.save(tmp_path / "given.npy", labels)
    given = ["--spacing", "1,0.8,3", "--label", "1", "--dz", "1.5", "--method", "field", "--simplify", "0.2"]
    command("reconstruct", tmp_path / "given.npy", *given, "-q", "-o", tmp_path / "theirs.json", "-o", tmp_path / "theirs.stl")
    stack = interslice.read(tmp_path / "given.npy", spacing=[1, 0.8, 3], label=1)
    body = interslice.reconstruct(stack, dz=1.5, method="field", simplify=0.2)
    body.save(tmp_path / "ours.json", tmp_path / "ours.html", tmp_path / "ours.stl")
    ours, theirs = (json.loads((tmp_path / f"{whose}.json").read_text()) for whose in ("ours", "theirs"))
    assert ours.keys() - {"profile"} == theirs.keys() - {"profile"} == body.report.keys()
    for report in (ours, body.report):
        for key in ("inputs", "bodies", "options", "machine"):
            assert report["provenance"][key] == theirs["provenance"][key], key
        for key in ("volume", "area", "areas", "warnings"):
            assert report[key] == theirs[key], key
    assert theirs["provenance"]["inputs"][0]["sha256"] in (tmp_path / "ours.html").read_text()
    body.save(tmp_path / "mask.json", mask=True)
    assert json.loads((tmp_path / "mask.json").read_text())["provenance"]["options"]["mask"] is True
    at = interslice.reconstruct(stack, at=[0.5, 2.0], method="field").report
    assert at["provenance"]["options"]["at"] == [0.5, 2.0]
    # What was made of other slices was not made of the file.
    body.update(1, stack_of(labels)[2])
    changed = body.report
    assert "provenance" not in changed and changed["volume"] != theirs["volume"]
    assert any("slices were changed" in warning and "warnings before this one" in warning for warning in changed["warnings"])
    # A file that is gone is told, and nothing else is lost.
    body = interslice.reconstruct(stack, method="field")
    (tmp_path / "given.npy").unlink()
    assert any("given.npy" in warning for warning in body.report["warnings"])


def stack_of(labels: Volume) -> Masks:
    painted: Masks = labels[::4] == 1
    return painted


def test_below_a_level_is_above_it_of_the_negated_array() -> None:
    z, y, x = np.mgrid[:5, :24, :26]
    dark = (4.0 * (z - 2.0) ** 2 + (y - 11.3) ** 2 + (x - 12.1) ** 2) ** 0.5
    below, above = interslice.read(dark, level=8.0, invert=True), interslice.read(-dark, level=-8.0)
    own, negated = (interslice.reconstruct(stack).distances() for stack in (below, above))
    assert np.array_equal(own, negated) and (own < 0).any() and (own > 0).any()
    with pytest.raises(ValueError, match="`invert` is not for labels"):
        interslice.read((dark < 8).astype(np.uint8), invert=True)


def test_save_is_told_what_reconstruct_was_told(tmp_path: Path, labels: Volume) -> None:
    def written(name: str, told: dict[str, Any], saved: dict[str, Any]) -> bytes:
        interslice.reconstruct(stack, method="field", **told).save(tmp_path / name, **saved)
        return (tmp_path / name).read_bytes()

    stack = interslice.read(labels, spacing=(3, 1, 1), label=5)
    cases: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
        ("m.stl", {"simplify": 0.5}, {"simplify": 0.05}),
        ("v.npy", {"mask": True}, {"distance": True}),
        ("v.npy", {"distance": True}, {"mask": True}),
        ("p.png", {"contours": True}, {"contours": False}),
    ]
    for name, option, other in cases:
        plain, as_told = written(name, {}, {}), written(name, option, {})
        assert plain != as_told == written(name, {}, option), option
        assert written(name, other, option) == as_told, "save's own wins"
    with pytest.raises(ValueError, match="`distance` is not what `mask` asks for"):
        written("v.npy", {}, {"mask": True, "distance": True})
    # None that counts nowhere is taken.
    options: dict[str, Any] = {"mask": True}
    for call in (interslice.evaluate, lambda stack, **given: interslice.fill(labels, **given)):
        with pytest.raises(ValueError, match="`options` of outputs are not for `"):
            call(stack, **options)
    with pytest.raises(ValueError, match="`like` is an option of the command line alone"):
        written("v.npy", {"like": tmp_path / "v.npy"}, {})


def test_masks_of_every_kind_are_one(masks: Masks) -> None:
    expected = interslice.reconstruct(masks, HEIGHTS, (0.8, 1.0), method="field").distances()
    for given in (list(masks), masks.astype(np.int16), np.asfortranarray(masks), masks.astype(">f4"), [m.tolist() for m in masks]):
        np.testing.assert_array_equal(interslice.reconstruct(given, HEIGHTS, (0.8, 1.0), method="field").distances(), expected)


def test_what_a_body_can_be_asked(masks: Masks) -> None:
    body = interslice.reconstruct(masks, HEIGHTS, 1.0, at=[0, 1, 2, 5, 12])
    assert body.heights == [0, 1, 2, 5, 12] and body.contour_heights == HEIGHTS and body.shape == [40, 40]
    for z, mask in zip(HEIGHTS, masks, strict=True):
        np.testing.assert_array_equal(body.mask(z), mask)
    later = body.distance(4.25)
    assert later.dtype == np.float32 and later.shape == (40, 40)
    np.testing.assert_array_equal(body.mask(4.25), later < 0)
    alone = interslice.reconstruct(masks, HEIGHTS, 1.0, at=[4.25]).distance(4.25)
    np.testing.assert_array_equal(later, alone)
    np.testing.assert_array_equal(body.masks(), body.distances() < 0)
    assert (body.distance(100.0) > 0).all()
    vertices, faces = body.mesh()
    assert vertices.shape[1] == faces.shape[1] == 3 and vertices.dtype == np.float64 and faces.dtype == np.uint32
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(body.volume, rel=1e-9)
    fewer = body.mesh(simplify=0.3)[1]
    assert 0 < len(fewer) < len(faces)
    (line,) = body.contours(5.0)
    x, y = line.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert area == pytest.approx(body.mask(5.0).sum(), rel=0.05)
    assert "Body of 5 slices and 5 layers" in repr(body)


def test_a_body_knows_where_it_lies(masks: Masks) -> None:
    axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    drawn = interslice.stack(masks, HEIGHTS, (0.8, 0.5), origin=(7.0, -3.0, 100.0), axes=axes)
    body = interslice.reconstruct(drawn, dz=0.5)
    assert body.origin == [7.0, -3.0, 100.0] and body.axes == axes
    layer, row, column = np.nonzero(body.masks())
    dy, dx = body.spacing
    steps = np.column_stack([column * dx, row * dy, np.array(body.heights)[layer]])
    middle = np.array(body.origin) + steps.mean(axis=0) @ np.array(body.axes)
    vertices, faces = body.mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    centroid = ((a + b + c) * volumes[:, None]).sum(axis=0) / 4 / volumes.sum()
    np.testing.assert_allclose(centroid, middle, atol=0.2)


def test_fields_grey_values_and_polygons(masks: Masks) -> None:
    y, x = np.mgrid[:40, :40]
    radii = [8.0, 9.5, 9.0, 7.5, 7.0]
    fields = [np.hypot(x - 19.5, y - 20.25) - r for r in radii]
    body = interslice.reconstruct(fields=fields, heights=HEIGHTS, spacing=1.0)
    np.testing.assert_allclose([body.mask(z).sum() for z in HEIGHTS], [np.pi * r * r for r in radii], rtol=0.03)
    grey = interslice.reconstruct(fields=[100 - f for f in fields], level=100, heights=HEIGHTS, spacing=1.0)
    np.testing.assert_allclose(grey.distances(), body.distances(), atol=1e-4)
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = [[np.column_stack([r * np.cos(angle), r * np.sin(angle)]), 3 * np.column_stack([np.cos(angle), np.sin(angle)])] for r in radii]
    drawn = interslice.reconstruct(polygons=ring, heights=HEIGHTS, pixel=0.5)
    assert drawn.spacing == [0.5, 0.5]
    expected = sum(np.pi * (9.0**2 - 3**2) for _ in range(12))
    assert drawn.volume == pytest.approx(expected, rel=0.15)
    assert len(drawn.contours(7.0)) == 2


def test_a_changed_slice_is_what_a_new_body_has(masks: Masks) -> None:
    body = interslice.reconstruct(masks, HEIGHTS, 1.0, method="field")
    before = body.volume
    changed = masks.copy()
    changed[2] = np.roll(masks[2], 1, axis=0)
    body.update(2, changed[2])
    assert 1 in body.stale and 2 in body.stale
    new = interslice.reconstruct(changed, HEIGHTS, 1.0, method="field")
    np.testing.assert_array_equal(body.distance(5.0), new.distance(5.0))
    np.testing.assert_array_equal(body.distances(), new.distances())
    assert body.stale == [] and body.volume == new.volume != before
    np.testing.assert_array_equal(body.mask(HEIGHTS[2]), changed[2])


def test_origin_and_axes(masks: Masks) -> None:
    plain = interslice.reconstruct(masks, HEIGHTS, 1.0, method="field").mesh()[0]
    moved = interslice.reconstruct(masks, HEIGHTS, 1.0, origin=(10, 20, 30), axes=[[0, 1, 0], [-1, 0, 0], [0, 0, 1]], method="field").mesh()[0]
    x, y, z = plain.T
    np.testing.assert_allclose(moved, np.column_stack([10 - y, 20 + x, 30 + z]), atol=1e-9)


def test_polygons_are_those_of_a_folder(tmp_path: Path) -> None:
    square = [[0, 0], [20, 0], [20, 15], [0, 15]]
    beside = [[x + 10, y + 5] for x, y in square]
    cases = [
        ([[square], [square, square], [square]], "drawn before point by point; left out"),
        ([[square, square]] * 3, "drawn before point by point; left out"),
        ([[square, [*square, square[0]]]] * 3, "drawn before point by point; left out"),
        ([[square, [[3, 3], [5, 5]]]] * 3, "polygon 2 left out, its 2 points bound no area"),
        ([[square, beside]] * 3, "lines cross on"),
    ]
    for lines, words in cases:
        entries = [{"z": 5 * k, "polygons": of_slice} for k, of_slice in enumerate(lines)]
        (tmp_path / "stack.json").write_text(json.dumps({"slices": entries}))
        of_file = interslice.read(tmp_path)
        drawn = interslice.stack(polygons=lines, heights=[0, 5, 10])
        for stack in (of_file, drawn):
            assert any(words in note for note in stack.notes), stack.notes
        with pytest.warns(UserWarning, match=words):
            bodies = [interslice.reconstruct(stack, dz=1.0) for stack in (of_file, drawn)]
        assert bodies[0].volume == bodies[1].volume > 2000


def test_masks_that_are_inside_out_are_told(masks: Masks) -> None:
    with pytest.warns(UserWarning, match="inside"):
        interslice.reconstruct(~masks, HEIGHTS)
