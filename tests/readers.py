"""Outputs of the program, read by the field's own readers: the same geometry, the same body, watertight meshes.

    python readers.py <program>
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import jsonschema
import nibabel
import nrrd
import numpy as np
import SimpleITK
import tifffile
import trimesh
import zarr

# An oblique label volume, axes in LPS, one step a column; slices 0, 4, 8 are drawn.
SIZES = (40, 30, 9)
STEPS = np.array([[0.8, 0.6, 0.0], [-1.2, 1.6, 0.0], [0.0, 0.0, 2.5]])
ORIGIN = np.array([10.0, -20.5, 300.0])


def labels():
    x, y, z = np.meshgrid(*map(np.arange, SIZES), indexing="ij")
    disc = np.hypot(x - 19.0, y - 14.0) < 9.0 + 0.4 * z
    return (disc & (z % 4 == 0)).astype(np.uint8)


def check(name, holds, value=""):
    if not holds:
        sys.exit(f"{name}: wrong {value}")
    print(f"{name}: ok {value}")


def main(program):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        given = labels()
        header = {"space": "left-posterior-superior", "space directions": STEPS, "space origin": ORIGIN}
        nrrd.write(str(folder / "in.nrrd"), given, header)
        image = nibabel.Nifti1Image(given, np.vstack([np.column_stack([np.diag([-1, -1, 1]) @ STEPS.T, np.diag([-1, -1, 1]) @ ORIGIN]), [0, 0, 0, 1]]))
        nibabel.save(image, folder / "in.nii.gz")
        for source in ("in.nrrd", "in.nii.gz"):
            outputs = [folder / f"{source}.{e}" for e in ("nrrd", "nii.gz", "nii", "stl", "ply", "obj", "tif", "png", "zarr", "glb", "origin.nrrd", "confidence.nii.gz", "json")]
            command = [program, "reconstruct", folder / source, "-q"]
            for path in outputs:
                command += ["-o", path]
            subprocess.run(command, check=True)
            volumes(source, given, outputs[:3])
            meshes(source, outputs[3:6])
            heights = tifffile.imread(outputs[6])
            chunks(source, outputs[:1] + outputs[8:9])
            meshes(source, outputs[9:10])
            origins(source, given, outputs[:1] + outputs[10:12])
            report(source, outputs[12])
            simpler(source, program, folder)
            check(f"{source} -> tif", heights.shape == SIZES[1::-1] and np.nanmax(heights) == 20.0, heights.shape)


def volumes(source, given, paths):
    array, header = nrrd.read(str(paths[0]))
    check(f"{source} -> pynrrd", np.abs(header["space directions"] - STEPS).max() < 1e-6 and np.abs(header["space origin"] - ORIGIN).max() < 1e-6)
    drawn = [0, 4, 8]
    check(f"{source} -> pynrrd contours", ((array[:, :, drawn] < 0) == (given[:, :, drawn] > 0)).all(), array.dtype)
    check(f"{source} -> gap filled", (array[:, :, 2] < 0).sum() > 200)
    for path in paths[1:]:
        image = nibabel.load(path)
        lps = np.diag([-1, -1, 1, 1]) @ image.affine
        check(f"{path.name} -> nibabel", np.abs(lps[:3, :3] - STEPS.T).max() < 1e-6 and np.abs(lps[:3, 3] - ORIGIN).max() < 1e-4)
        check(f"{path.name} -> nibabel values", np.array_equal(np.asarray(image.dataobj), array))
    for path in paths:
        image = SimpleITK.ReadImage(str(path))
        steps = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
        check(f"{path.name} -> SimpleITK", np.abs(steps.T - STEPS).max() < 1e-5 and np.abs(np.array(image.GetOrigin()) - ORIGIN).max() < 1e-3)


def chunks(source, paths):
    array, _ = nrrd.read(str(paths[0]))
    group = zarr.open_group(paths[1], mode="r")
    level = group["0"]
    check(f"{source} -> zarr values", np.array_equal(np.asarray(level), array.transpose()), f"{level.dtype} {level.shape}, chunks {level.chunks}")
    own = group.attrs["interslice"]
    steps = np.array([own["space directions"][a] for a in "xyz"])
    check(f"{source} -> zarr place", np.abs(steps - STEPS).max() < 1e-6 and np.abs(np.array(own["space origin"]) - ORIGIN).max() < 1e-4)
    (image,) = group.attrs["ome"]["multiscales"]
    names = [axis["name"] for axis in image["axes"]]
    scale, translation = (t[t["type"]] for t in image["datasets"][0]["coordinateTransformations"])
    lengths = np.linalg.norm(STEPS, axis=1)
    along = STEPS @ ORIGIN / lengths
    sound = names == ["z", "y", "x"] == list(level.metadata.dimension_names) and group.attrs["ome"]["version"] == "0.5"
    check(f"{source} -> OME-Zarr", sound and np.allclose(scale[::-1], lengths) and np.allclose(translation[::-1], along, atol=1e-4), scale)


def origins(source, given, paths):
    array, origin, sure = nrrd.read(str(paths[0]))[0], nrrd.read(str(paths[1]))[0], np.asarray(nibabel.load(paths[2]).dataobj)
    drawn = np.zeros(SIZES, bool)
    drawn[:, :, [0, 4, 8]] = True
    check(f"{source} -> origin", (origin == np.where(array < 0, np.where(drawn, 1, 2), 0)).all(), np.bincount(origin.ravel()))
    sound = sure.dtype == np.float32 and sure.min() >= 0 and sure.max() <= 1 and (sure[drawn] == 1).all() and sure.min() < 0.5
    check(f"{source} -> confidence", sound, f"least {sure.min():.3f}")


def report(source, path):
    schema = json.loads((Path(__file__).parent.parent / "schema" / "report.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    told = json.loads(path.read_text())
    validator = jsonschema.Draft202012Validator(schema)
    check(f"{source} -> report.schema.json", not list(validator.iter_errors(told)), [e.message for e in validator.iter_errors(told)])
    # The schema would notice what is wrong.
    for spoil in ({"volume": "1"}, {"unheard_of": 1}, {"dims": [1]}):
        check(f"{source} -> report.schema.json refuses {spoil}", not validator.is_valid(told | spoil))


def simpler(source, program, folder):
    names = ["s.stl", "s.ply", "s.obj", "s.glb"]
    command = [program, "reconstruct", folder / source, "-q", "--simplify", "0.2"]
    for name in names:
        command += ["-o", folder / name]
    subprocess.run(command, check=True)
    meshes(source, [folder / name for name in names])
    full, few = trimesh.load(folder / f"{source}.stl"), trimesh.load(folder / "s.stl")
    check(f"{source} -> simplified", len(few.faces) < 0.5 * len(full.faces), f"{len(few.faces)} of {len(full.faces)} triangles")


def meshes(source, paths):
    center = ORIGIN + STEPS.T @ np.array([19.0, 14.0, 4.0])
    for path in paths:
        mesh = trimesh.load(path, force="mesh")
        sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
        check(f"{path.name} -> trimesh", sound and mesh.euler_number == 2, f"volume {mesh.volume:.1f}")
        check(f"{path.name} -> place", np.abs(mesh.centroid - center).max() < 2.0, mesh.centroid.round(2))


main(sys.argv[1])
