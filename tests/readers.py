"""Outputs of the program, read by the field's own readers: the same geometry, the same body, watertight meshes.

    python readers.py <program>
"""

import subprocess
import sys
import tempfile
from pathlib import Path

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
            outputs = [folder / f"{source}.{e}" for e in ("nrrd", "nii.gz", "nii", "stl", "ply", "obj", "tif", "png", "zarr")]
            command = [program, "reconstruct", folder / source, "-q"]
            for path in outputs:
                command += ["-o", path]
            subprocess.run(command, check=True)
            volumes(source, given, outputs[:3])
            meshes(source, outputs[3:6])
            heights = tifffile.imread(outputs[6])
            chunks(source, outputs[:1] + outputs[8:])
            check(f"{source} -> tif", heights.shape == SIZES[1::-1] and np.nanmax(heights) == 20.0, heights.shape)
        for name, axis, direction in FRAMES:
            other_axes(program, folder, name, axis, np.array(direction, dtype=float))
        refused_pages(program, folder)


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


def meshes(source, paths):
    center = ORIGIN + STEPS.T @ np.array([19.0, 14.0, 4.0])
    for path in paths:
        mesh = trimesh.load(path)
        sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
        check(f"{path.name} -> trimesh", sound and mesh.euler_number == 2, f"volume {mesh.volume:.1f}")
        check(f"{path.name} -> place", np.abs(mesh.centroid - center).max() < 2.0, mesh.centroid.round(2))


# Axes of a volume as columns in LPS, and the axis its slices lie across.
FRAMES = [
    ("as scanned", "z", [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("flipped", "y", [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]),
    ("sagittal", "x", [[0, 0, -1], [1, 0, 0], [0, -1, 0]]),
    ("mirrored", "x", [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("oblique", "y", [[0.36, -0.8, 0.48], [0.48, 0.6, 0.64], [-0.8, 0, 0.6]]),
]
SIDES = np.array([0.75, 1.25, 1.5])


def other_axes(program, folder, name, axis, direction):
    """A volume painted on every fourth slice across `axis`, in every format: the body lies where the input lay, on the input's own grid."""
    across = "xyz".index(axis)
    sizes = [26, 22, 24]
    sizes[across] = 13
    ijk = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"))
    others = [a for a in range(3) if a != across]
    far = np.hypot(ijk[others[0]] - 11.0, ijk[others[1]] - 10.0)
    given = ((far < 6.0 + 0.2 * ijk[across]) & (ijk[across] % 4 == 0)).astype(np.uint16) * 5
    for source in written(folder, given, direction):
        spaced = source.suffix == ".npy" or source.name.endswith("plain.tif")
        placed = not spaced and source.suffix != ".tif"
        frame, origin = (direction, ORIGIN) if placed else (np.eye(3), np.zeros(3))
        outputs = [folder / f"out.{e}" for e in ("mha", "nrrd", "nii.gz", "stl")]
        command = [program, "reconstruct", source, "-q", "--label", "5", "--mask"]
        command += ["--spacing", ",".join(map(str, SIDES))] if spaced else []
        for path in outputs:
            command += ["-o", path]
        subprocess.run(command, check=True)
        what = f"{name}, across {axis}, {source.name}"
        for path in outputs[:3]:
            image = SimpleITK.ReadImage(str(path))
            array = SimpleITK.GetArrayFromImage(image).transpose(2, 1, 0)
            near = lambda a, b: np.abs(np.array(a) - np.array(b)).max() < (1e-6 if path.suffix != ".gz" else 1e-4)
            check(f"{what} -> {path.name}", array.shape == given.shape and near(image.GetSpacing(), SIDES) and near(image.GetOrigin(), origin) and near(image.GetDirection(), frame.ravel()))
            drawn = np.take(given, range(0, 13, 4), across) > 0
            check(f"{what} -> {path.name} contours", ((np.take(array, range(0, 13, 4), across) == 1) == drawn).all() and np.take(array, 2, across).sum() > 90)
        mesh = trimesh.load(outputs[3])
        index = np.array([11.0, 10.0, 6.0])[[others.index(a) if a in others else 2 for a in range(3)]]
        center = origin + frame @ (SIDES * index)
        check(f"{what} -> mesh", mesh.is_watertight and mesh.volume > 0 and np.abs(mesh.centroid - center).max() < 2.0, mesh.centroid.round(2))
        said = subprocess.run([program, "inspect", source, "--label", "5"], check=True, capture_output=True, text=True).stdout
        check(f"{what} -> inspect", f"slices lie along {axis} (painted slices stand alone" in said and f"labels: 5 ({(given > 0).sum()} voxels)" in said and "painted: 4 of 13 slices: 0, 4, 8, 12; empty slices between them: 3 (3 times)" in said)


def written(folder, given, direction):
    """The same labels by every writer of the field."""
    image = SimpleITK.GetImageFromArray(given.transpose(2, 1, 0).copy())
    image.SetSpacing(SIDES.tolist())
    image.SetOrigin(ORIGIN.tolist())
    image.SetDirection(direction.ravel().tolist())
    for name, packed in (("itk.mha", True), ("raw.mha", False), ("itk.mhd", False), ("packed.mhd", True), ("itk.nrrd", True), ("itk.nii.gz", True)):
        SimpleITK.WriteImage(image, str(folder / name), packed)
        yield folder / name
    SimpleITK.WriteImage(SimpleITK.Cast(image, SimpleITK.sitkFloat64), str(folder / "float.mha"))
    yield folder / "float.mha"
    header = {"space": "left-posterior-superior", "space directions": (direction * SIDES).T, "space origin": ORIGIN}
    nrrd.write(str(folder / "detached.nhdr"), given.astype(">i4"), {**header, "encoding": "gzip", "endian": "big"}, detached_header=True)
    yield folder / "detached.nhdr"
    np.save(folder / "c.npy", np.ascontiguousarray(given.T))
    np.save(folder / "fortran.npy", np.asfortranarray(given.T.astype(">i8")))
    yield folder / "c.npy"
    yield folder / "fortran.npy"
    pages = np.ascontiguousarray(given.T)
    sizes = {f"PhysicalSize{a}": s * f for a, s, f in zip("XYZ", SIDES, (1, 1000, 0.1))}
    units = {"PhysicalSizeXUnit": "mm", "PhysicalSizeYUnit": "\u00b5m", "PhysicalSizeZUnit": "cm"}
    tifffile.imwrite(folder / "a.ome.tif", pages, ome=True, compression="zlib", metadata={"axes": "ZYX", **sizes, **units})
    tifffile.imwrite(folder / "big.ome.tif", pages, ome=True, bigtiff=True, byteorder=">", tile=(16, 16), compression="zlib", metadata={"axes": "ZYX", **sizes, **units})
    tifffile.imwrite(folder / "imagej.tif", pages, imagej=True, resolution=(1 / SIDES[0], 1 / SIDES[1]), metadata={"axes": "ZYX", "spacing": SIDES[2], "unit": "mm"})
    tifffile.imwrite(folder / "plain.tif", pages, photometric="minisblack")
    for name in ("a.ome.tif", "big.ome.tif", "imagej.tif", "plain.tif"):
        yield folder / name


def refused_pages(program, folder):
    """A time or channel axis is refused by its name."""
    pages = np.ones((2, 5, 9, 8), np.uint8)
    for name, axes, options in (("time.ome.tif", "TZYX", {"ome": True}), ("channel.ome.tif", "CZYX", {"ome": True}), ("time.tif", "TZYX", {"imagej": True})):
        tifffile.imwrite(folder / name, pages, metadata={"axes": axes}, photometric="minisblack", **options)
        result = subprocess.run([program, "inspect", folder / name], capture_output=True, text=True)
        check(f"{name} is refused", result.returncode == 2 and f"no {name.split('.')[0]} axis" in result.stderr, result.stderr.strip())


main(sys.argv[1])
