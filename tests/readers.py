"""Outputs of the program, read by the field's own readers: the same geometry, the same body, watertight meshes.

    python readers.py <program>
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import geopandas
import jsonschema
import nibabel
import nrrd
import numpy as np
import pydicom
import pydicom.dicomio
import rasterio
import shapely
import SimpleITK
import tifffile
import trimesh
import zarr
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLPolyDataReader

# The parser was written for pydicom 2, where dcmread had this name too.
pydicom.dicomio.read_file = pydicom.dcmread
from dicompylercore.dicomparser import DicomParser  # noqa: E402

# An oblique label volume, axes in LPS, one step a column; slices 0, 4, 8 are drawn.
SIZES = (40, 30, 9)
STEPS = np.array([[0.8, 0.6, 0.0], [-1.2, 1.6, 0.0], [0.0, 0.0, 2.5]])
ORIGIN = np.array([10.0, -20.5, 300.0])


def labels():
    x, y, z = np.meshgrid(*map(np.arange, SIZES), indexing="ij")
    disc = np.hypot(x - 19.0, y - 14.0) < 9.0 + 0.4 * z
    return (disc & (z % 4 == 0)).astype(np.uint8)


passed = 0


def check(name, holds, value=""):
    global passed
    if not holds:
        sys.exit(f"{name}: wrong {value}")
    passed += 1


def group(name):
    """Says how many checks have passed since the last group."""
    global passed
    if passed == 0:
        sys.exit(f"{name}: nothing was checked")
    print(f"{name}: {passed} checks passed")
    passed = 0


def main(program):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        structures(program, folder)
        group("completed RTSTRUCT")
        contour_map(program, folder)
        group("contour map")
        map_files(program, folder)
        group("files of maps")
        reports(program, folder)
        group("every kind of report")
        every_volume(program, folder)
        group("every volume format")
        given = labels()
        header = {"space": "left-posterior-superior", "space directions": STEPS, "space origin": ORIGIN}
        nrrd.write(str(folder / "in.nrrd"), given, header)
        image = nibabel.Nifti1Image(given, np.vstack([np.column_stack([np.diag([-1, -1, 1]) @ STEPS.T, np.diag([-1, -1, 1]) @ ORIGIN]), [0, 0, 0, 1]]))
        nibabel.save(image, folder / "in.nii.gz")
        for source in ("in.nrrd", "in.nii.gz"):
            kinds = ("nrrd", "nii.gz", "nii", "vti", "stl", "ply", "obj", "3mf", "groups.obj", "vtp", "dem.tif", "png", "zarr", "glb", "origin.nrrd", "confidence.nii.gz", "json")
            outputs = {kind: folder / f"{source}.{kind}" for kind in kinds}
            command = [program, "reconstruct", folder / source, "-q", "--distance"]
            for path in outputs.values():
                command += ["-o", path]
            subprocess.run(command, check=True)
            of = lambda *kinds: [outputs[kind] for kind in kinds]
            volumes(source, given, of("nrrd", "nii.gz", "nii"))
            image_data(source, *of("nrrd", "vti"))
            meshes(source, of("stl", "ply", "obj", "groups.obj", "3mf", "glb"))
            poly_data(source, *of("ply", "vtp"))
            heights = tifffile.imread(outputs["dem.tif"])
            chunks(source, of("nrrd", "zarr"))
            origins(source, given, of("nrrd", "origin.nrrd", "confidence.nii.gz"))
            report(source, outputs["json"])
            scene(source, program, folder)
            simpler(source, program, folder)
            # Heights of the world along the slices' axis.
            first = np.linalg.solve((STEPS / np.linalg.norm(STEPS, axis=1)[:, None]).T, ORIGIN)[2]
            top = np.nanmax(heights)
            check(f"{source} -> tif", heights.shape == SIZES[1::-1] and abs(top - first - 20.0) < 1e-4, (heights.shape, top))
            group(f"every output of {source}")
        for name, axis, direction in FRAMES:
            other_axes(program, folder, name, axis, np.array(direction, dtype=float))
            group(f"every input, {name}, cut across {axis}")
        refused_pages(program, folder)
        group("pages of time or channels")
        far_away(program, folder)
        group("meshes ten million pixels away")


def contour_map(program, folder):
    """A cone's contour lines, all but one cut at the west border of the map, to a GeoTIFF and to lines again."""
    lines = []
    for radius in (400, 300, 200, 100):
        end = np.arccos(max(-150 / radius, -1))
        t = np.linspace(-end, end, 361)
        line = np.column_stack([5e5 + radius * np.cos(t), 4e6 + radius * np.sin(t)]).round(6)
        lines.append({"type": "Feature", "properties": {"elev": 300 - radius / 2}, "geometry": {"type": "LineString", "coordinates": line.tolist()}})
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32611"}}
    given, tif, out = folder / "cone.geojson", folder / "cone.dem.tif", folder / "lines.geojson"
    given.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": lines}))
    subprocess.run([program, "reconstruct", given, "--border", "499850,3999600,500400,4000400", "--pixel", "10", "--end-top", "extrapolate", "-o", tif, "-o", out, "-q"], check=True)
    with rasterio.open(tif) as map:
        check("cone.geojson -> rasterio, system", map.crs.to_epsg() == 32611 and np.isnan(map.nodata) and map.dtypes == ("float32",), map.crs)
        bounds, heights = map.bounds, map.read(1, masked=True)
        place = bounds.left == 5e5 - 155 and bounds.top == 4e6 + 405 and map.transform.a == 10 and map.transform.e == -10
        check("cone.geojson -> rasterio, transform", place, bounds)
        rows, columns = np.indices(heights.shape)
        x, y = rasterio.transform.xy(map.transform, rows.ravel(), columns.ravel())
        r = np.hypot(np.array(x) - 5e5, np.array(y) - 4e6).reshape(heights.shape)
    check("cone.geojson -> rasterio, no data", (heights.mask == (r > 400))[np.abs(r - 400) > 1].all(), heights.mask.mean())
    # West of that the contours around the summit lie beyond the map, and nobody knows them.
    between = (r > 105) & (r < 395) & (np.array(x).reshape(r.shape) > 5e5 - 60)
    error = np.abs(heights - (300 - r / 2))[between].max()
    check("cone.geojson -> rasterio, heights", error < 2, error)
    drawn = json.loads(out.read_text())["features"]
    ends = [l[0][0] == l[-1][0] == 5e5 - 150 for f in drawn if f["properties"]["elevation"] < 220 for l in f["geometry"]["coordinates"]]
    check("cone.geojson -> geojson, open at the border", ends and all(ends), len(ends))


def map_files(program, folder):
    """The same lines in every format that geopandas writes, metric and in degrees, are the same terrain."""
    lines = geopandas.read_file(folder / "cone.geojson")
    check("cone.geojson -> geopandas", len(lines) == 4 and lines.crs.to_epsg() == 32611)
    command = ["--border", "499850,3999600,500400,4000400", "--pixel", "10", "--end-top", "extrapolate", "-q"]
    with rasterio.open(folder / "cone.dem.tif") as map:
        given, place = map.read(1, masked=True), map.transform
    for name in ("cone.gpkg", "cone.shp", "cone.geojson.json"):
        lines.to_file(folder / name, driver={"gpkg": "GPKG", "shp": "ESRI Shapefile", "json": "GeoJSON"}[name.rsplit(".", 1)[1]])
        out = folder / f"{name}.dem.tif"
        subprocess.run([program, "reconstruct", folder / name, *command, "-o", out], check=True)
        with rasterio.open(out) as map:
            heights = map.read(1, masked=True)
            check(f"geopandas -> {name}", map.transform == place and map.crs.to_epsg() == 32611 and (heights.mask == given.mask).all())
        check(f"geopandas -> {name}, heights", np.abs(heights - given).max() < 1e-3, np.abs(heights - given).max())
    # On the grid of a raster: its own again, and one that lies otherwise.
    here = [program, "reconstruct", folder / "cone.geojson", "--border", "499850,3999600,500400,4000400", "--end-top", "extrapolate", "-q", "--like"]
    other = {"driver": "GTiff", "width": 60, "height": 50, "count": 1, "dtype": "float32", "crs": "EPSG:32611"}
    with rasterio.open(folder / "other.tif", "w", **other, transform=rasterio.Affine(5.5, 0, 499900, 0, -7, 4000200)) as map:
        map.write(np.zeros((1, 50, 60), np.float32))
    for like in ("cone.dem.tif", "other.tif"):
        subprocess.run([*here, folder / like, "-o", folder / "like.dem.tif"], check=True)
        with rasterio.open(folder / like) as of, rasterio.open(folder / "like.dem.tif") as map:
            check(f"--like {like} -> rasterio", map.transform == of.transform and map.shape == of.shape and map.crs == of.crs, (map.transform, of.transform))
            heights = map.read(1, masked=True)
            rows, columns = np.indices(map.shape)
            x, y = rasterio.transform.xy(map.transform, rows.ravel(), columns.ravel())
        r = np.hypot(np.array(x) - 5e5, np.array(y) - 4e6).reshape(heights.shape)
        known = (r > 105) & (r < 395) & (np.array(x).reshape(r.shape) > 5e5 - 60)
        check(f"--like {like} -> heights", known.sum() > 500 and np.abs(heights - (300 - r / 2))[known].max() < 2.5, np.abs(heights - (300 - r / 2))[known].max())
    with rasterio.open(folder / "degrees.tif", "w", **(other | {"crs": "EPSG:4326"}), transform=rasterio.Affine(1e-4, 0, -117, 0, -1e-4, 36.1)) as map:
        map.write(np.zeros((1, 50, 60), np.float32))
    wrong = subprocess.run([*here, folder / "degrees.tif", "-o", folder / "degrees.dem.tif"], capture_output=True, text=True)
    check("--like degrees.tif is refused", wrong.returncode == 2 and "is a raster in EPSG:4326, but the map is in EPSG:32611; warp the raster" in wrong.stderr, wrong.stderr)
    # A system of one's own has no code; the program's own raster in it is a grid to be like.
    own = lines.copy().set_crs("+proj=tmerc +lat_0=36 +lon_0=-117.3 +k=0.9999 +x_0=500000 +y_0=4000000 +ellps=GRS80 +units=m", allow_override=True)
    own.to_file(folder / "own.shp")
    here[2] = folder / "own.shp"
    subprocess.run([*here[:-1], "--pixel", "10", "-o", folder / "own.dem.tif"], check=True)
    subprocess.run([*here, folder / "own.dem.tif", "--pixel", "10", "-o", folder / "again.dem.tif"], check=True)
    with rasterio.open(folder / "own.dem.tif") as of, rasterio.open(folder / "again.dem.tif") as map:
        same = np.array_equal(of.read(1), map.read(1), equal_nan=True)
        check("--like own.dem.tif -> rasterio", map.transform == of.transform and same and of.crs.to_epsg() is None, of.crs)
    # The lines that the program writes, read and compared with those that it was given.
    drawn = geopandas.read_file(folder / "lines.geojson")
    check("lines.geojson -> geopandas", drawn.crs.to_epsg() == 32611 and set(lines["elev"]) <= set(drawn["elevation"]), set(drawn["elevation"]))
    # At the border itself a line is closed, which rounds the corner within a pixel.
    within = shapely.box(499860, 3999600, 500400, 4000400)
    for level, given in zip(lines["elev"], lines.geometry):
        (own,) = drawn[drawn["elevation"] == level].geometry
        off = own.intersection(within).hausdorff_distance(given.intersection(within))
        check(f"lines.geojson -> geopandas, {level}", off < 1.0, off)


def ring(radius, z, points=80):
    t = 2 * np.pi * np.arange(points) / points
    return np.column_stack([120.0 + radius * np.cos(t), -80.0 + radius * np.sin(t), np.full(points, z)]).round(2)


def structure_set(path, rois):
    """An RTSTRUCT of rings: {name: [(radius, z), ...]}, the last ROI with image references."""
    meta = pydicom.dataset.FileMetaDataset()
    meta.TransferSyntaxUID = pydicom.uid.ImplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = pydicom.uid.RTStructureSetStorage
    meta.MediaStorageSOPInstanceUID = "1.2.3.4"
    d = pydicom.Dataset()
    d.file_meta = meta
    d.SOPClassUID, d.SOPInstanceUID, d.SeriesInstanceUID, d.Modality = meta.MediaStorageSOPClassUID, "1.2.3.4", "1.2.3.5", "RTSTRUCT"
    d.StructureSetLabel, d.ApprovalStatus = "readers", "APPROVED"
    d.StructureSetROISequence, d.ROIContourSequence = pydicom.Sequence(), pydicom.Sequence()
    for number, (name, rings) in enumerate(rois.items(), 1):
        roi, drawn = pydicom.Dataset(), pydicom.Dataset()
        roi.ROINumber, roi.ROIName, roi.ROIGenerationAlgorithm = number, name, "MANUAL"
        drawn.ReferencedROINumber, drawn.ContourSequence = number, pydicom.Sequence()
        drawn.ROIDisplayColor = [255, 100 * number, 0]
        for radius, z in rings:
            c, image = pydicom.Dataset(), pydicom.Dataset()
            image.ReferencedSOPClassUID, image.ReferencedSOPInstanceUID = pydicom.uid.CTImageStorage, f"1.2.9.{int(z)}"
            c.ContourImageSequence = pydicom.Sequence([image])
            c.ContourGeometricType, points = "CLOSED_PLANAR", ring(radius, z)
            c.NumberOfContourPoints, c.ContourData = len(points), [f"{v:.2f}" for v in points.ravel()]
            drawn.ContourSequence.append(c)
        d.StructureSetROISequence.append(roi)
        d.ROIContourSequence.append(drawn)
    d.save_as(path, enforce_file_format=True)


def raw_contours(path):
    d = pydicom.dcmread(path)
    return d, [[c.get_item("ContourData").value for c in r.ContourSequence] for r in d.ROIContourSequence]


def structures(program, folder):
    """A completed RTSTRUCT beside the one that came in."""
    given, completed = folder / "rtss.dcm", folder / "completed.dcm"
    structure_set(given, {"tumour": [(10, 6), (12, 12), (10, 18)], "body": [(40, z) for z in range(0, 26, 2)]})
    subprocess.run([program, "reconstruct", given, "--roi", "tumour", "-o", completed, "-q"], check=True)
    (_, before), (after, now) = raw_contours(given), raw_contours(completed)
    check("rtss.dcm -> pydicom, drawn bytes", now[0][: len(before[0])] == before[0] and now[1] == before[1] and isinstance(now[0][0], bytes))
    added = after.ROIContourSequence[0].ContourSequence[len(before[0]) :]
    points = [np.array(c.ContourData, float).reshape(-1, 3) for c in added]
    check("rtss.dcm -> pydicom, planes", [p[0, 2] for p in points] == [8, 10, 14, 16] and all(np.ptp(p[:, 2]) == 0 for p in points))
    radii = [np.hypot(p[:, 0] - 120, p[:, 1] + 80) for p in points]
    check("rtss.dcm -> pydicom, place", all(9.7 < r.min() and r.max() < 12.3 for r in radii), [r.mean().round(2) for r in radii])
    check("rtss.dcm -> pydicom, counts", all(int(c.NumberOfContourPoints) == len(p) for c, p in zip(added, points, strict=True)))
    images = [c.ContourImageSequence[0].ReferencedSOPInstanceUID for c in added]
    check("rtss.dcm -> pydicom, images", images == ["1.2.9.8", "1.2.9.10", "1.2.9.14", "1.2.9.16"])
    fresh = after.SOPInstanceUID == after.file_meta.MediaStorageSOPInstanceUID != "1.2.3.4" and after.SeriesInstanceUID != "1.2.3.5"
    said = after.StructureSetROISequence[0].ROIDescription
    check("rtss.dcm -> pydicom, marks", fresh and after.ApprovalStatus == "UNAPPROVED" and "interpolated, at 8, 10, 14, 16" in said, said)
    parsed = DicomParser(str(completed))
    tumour = parsed.GetStructures()[1]
    planes = parsed.GetStructureCoordinates(1)
    heights = sorted(float(z) for z in planes)
    check("rtss.dcm -> dicompyler-core", tumour["name"] == "tumour" and not tumour["empty"] and heights == [6, 8, 10, 12, 14, 16, 18], heights)
    sizes = [len(c["data"]) == c["num_points"] > 20 for plane in planes.values() for c in plane]
    check("rtss.dcm -> dicompyler-core, points", len(sizes) == 7 and all(sizes), sizes)
    subprocess.run([program, "reconstruct", given, "--all-rois", "-o", folder / "scene.glb", "-q"], check=True)
    scene = trimesh.load(folder / "scene.glb")
    check("rtss.dcm -> trimesh, names", list(scene.geometry) == ["tumour", "body"], list(scene.geometry))
    for number, mesh in enumerate(scene.geometry.values(), 1):
        srgb = 100 * number / 255
        wanted = [255, 255 * ((srgb + 0.055) / 1.055) ** 2.4, 0, 255]
        colour = np.array(mesh.visual.material.baseColorFactor, float)
        near = np.abs(mesh.centroid[:2] - [120, -80]).max() < 0.5
        check("rtss.dcm -> trimesh, scene", mesh.is_watertight and near and np.abs(colour - wanted).max() <= 1, (mesh.centroid, colour))


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


def vtk_file(reader, path):
    """What VTK reads without a word on its error output, and the words in the file."""
    wrong = []
    reader.AddObserver("ErrorEvent", lambda *_: wrong.append(path.name))
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    fields = data.GetFieldData()
    words = {fields.GetAbstractArray(k).GetName(): fields.GetAbstractArray(k).GetValue(0) for k in range(fields.GetNumberOfArrays())}
    check(f"{path.name} -> vtk", not wrong and words["unit"] == "mm" and words["space"] == "left-posterior-superior", words)
    return data


def image_data(source, volume, path):
    array, _ = nrrd.read(str(volume))
    data = vtk_file(vtkXMLImageDataReader(), path)
    voxels = vtk_to_numpy(data.GetPointData().GetScalars()).reshape(data.GetDimensions()[::-1])
    check(f"{source} -> vtk values", voxels.dtype == array.dtype and np.array_equal(voxels.T, array), voxels.shape)
    matrix = data.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(row, column) for column in range(3)] for row in range(3)])
    steps = direction * np.array(data.GetSpacing())
    check(f"{source} -> vtk place", np.abs(steps - STEPS.T).max() < 1e-6 and np.abs(np.array(data.GetOrigin()) - ORIGIN).max() < 1e-6, steps)


def poly_data(source, mesh, path):
    data = vtk_file(vtkXMLPolyDataReader(), path)
    points = vtk_to_numpy(data.GetPoints().GetData())
    faces = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    same = trimesh.load(mesh, process=False)
    check(f"{source} -> vtk points", points.dtype == np.float64 and np.abs(points - same.vertices).max() < 1e-4 and np.array_equal(faces, same.faces), points.shape)
    body = trimesh.Trimesh(points, faces, process=False)
    check(f"{source} -> vtk mesh", body.is_watertight and body.volume > 0, body.volume)
    normals = vtk_to_numpy(data.GetPointData().GetNormals())
    # Beside the mean of the triangles around each vertex, by area; the ends are flat and their edges sharp.
    around = np.zeros_like(points)
    np.add.at(around, faces, np.repeat(np.cross(*(points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2)))[:, None], 3, axis=1))
    along = (normals * around).sum(1) / np.linalg.norm(around, axis=1)
    sound = np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5 and along.mean() > 0.98 and np.quantile(along, 0.01) > 0.7
    check(f"{source} -> vtk normals", sound, (along.mean(), np.quantile(along, 0.01)))


def chunks(source, paths):
    array, _ = nrrd.read(str(paths[0]))
    zarr_place(source, paths[1], array, STEPS.T, ORIGIN)


def zarr_place(source, path, array, steps, origin):
    """The same voxels as `array` (x, y, z), `steps` along each axis as columns."""
    group = zarr.open_group(path, mode="r")
    level = group["0"]
    check(f"{source} -> zarr values", np.array_equal(np.asarray(level), array.transpose()), f"{level.dtype} {level.shape}, chunks {level.chunks}")
    own = group.attrs["interslice"]
    written = np.array([own["space directions"][a] for a in "xyz"])
    check(f"{source} -> zarr place", np.abs(written - steps.T).max() < 1e-6 and np.abs(np.array(own["space origin"]) - origin).max() < 1e-4, written)
    (image,) = group.attrs["ome"]["multiscales"]
    names = [axis["name"] for axis in image["axes"]]
    scale, translation = (t[t["type"]] for t in image["datasets"][0]["coordinateTransformations"])
    lengths = np.linalg.norm(steps, axis=0)
    along = origin @ steps / lengths
    sound = names == ["z", "y", "x"] == list(level.metadata.dimension_names) and group.attrs["ome"]["version"] == "0.5"
    check(f"{source} -> OME-Zarr", sound and np.allclose(scale[::-1], lengths) and np.allclose(translation[::-1], along, atol=1e-4), scale)


def origins(source, given, paths):
    array, origin, sure = nrrd.read(str(paths[0]))[0], nrrd.read(str(paths[1]))[0], np.asarray(nibabel.load(paths[2]).dataobj)
    drawn = np.zeros(SIZES, bool)
    drawn[:, :, [0, 4, 8]] = True
    check(f"{source} -> origin", (origin == np.where(array < 0, np.where(drawn, 1, 2), 0)).all(), np.bincount(origin.ravel()))
    sound = sure.dtype == np.float32 and sure.min() >= 0.5 and sure.max() <= 1 and (sure[drawn] == 1).all() and sure.min() < 0.7
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


def reports(program, folder):
    """Every kind of report fits the schema: labels, labels kept apart, ROIs, parts joined, a batch, a map."""
    given = np.where(labels(), np.where(np.indices(SIZES)[0] < 19, 3, 8), 0).astype(np.uint8)
    nrrd.write(str(folder / "two.nrrd"), given, {"space": "left-posterior-superior", "space directions": STEPS, "space origin": ORIGIN})
    run = lambda *arguments: subprocess.run([program, *arguments, "-q"], check=True, cwd=folder)
    run("reconstruct", "two.nrrd", "--labels", "all", "-o", "labels.json", "-o", "all.nrrd")
    run("reconstruct", "two.nrrd", "--labels", "3,8", "--keep-overlaps", "-o", "kept.json", "-o", "kept.nrrd")
    structure_set(folder / "two.dcm", {"tumour": [(10, 6), (12, 12), (10, 18)], "body": [(40, z) for z in range(0, 26, 2)]})
    run("reconstruct", "two.dcm", "--all-rois", "-o", "roi.json")
    for part in "12":
        run("run", "two.nrrd", "--part", f"{part}/2", "-o", f"{part}.section")
    run("merge", "1.section", "2.section", "-o", "merged.json")
    (folder / "jobs.jsonl").write_text(json.dumps({"id": "a", "input": "two.nrrd", "outputs": ["batch.json"], "options": {"label": 3}}) + "\n")
    run("batch", "jobs.jsonl")
    run("reconstruct", "cone.geojson", "--border", "499850,3999600,500400,4000400", "--pixel", "20", "-o", "map.json")
    # A surface whose way is looked at, as it moves far.
    subprocess.run([program, "demo", "fig7", "-o", "mountain"], check=True, cwd=folder, capture_output=True)
    report("demo fig7", folder / "mountain/fig7/report.json")
    check("demo fig7 -> explained", '"explained"' in (folder / "mountain/fig7/report.json").read_text(), "looked at")
    for name in ("labels", "kept", "roi.tumour", "roi.body", "merged", "batch", "map"):
        path = folder / f"{name}.json"
        report(name, path)
        made = json.loads(path.read_text())["provenance"]
        source = Path(made["inputs"][0]["file"])
        digest = hashlib.sha256((folder / source.name).read_bytes()).hexdigest()
        check(f"{name} -> provenance", made["inputs"][0]["sha256"] == digest and ("date" in made) == (name != "batch"), made)


def every_volume(program, folder):
    """Two labels in every volume format, by the format's own readers: voxels, type, sides and place within 1e-6, names and colours."""
    given = np.where(labels(), np.where(np.indices(SIZES)[0] < 19, 3, 300), 0).astype(np.int16)
    segments = {}
    for k, (number, name, colour) in enumerate([(3, "Leber links", "0.2 0.4 1"), (300, "Spine, lower", "1 0 0")]):
        segments |= {f"Segment{k}_LabelValue": str(number), f"Segment{k}_Name": name, f"Segment{k}_Color": colour, f"Segment{k}_Layer": "0"}
    steps = np.diag([0.75, 1.25, 2.5])
    header = {"space": "left-posterior-superior", "space directions": steps, "space origin": ORIGIN, **segments}
    nrrd.write(str(folder / "every.nrrd"), given, header)
    names = ("v.nrrd", "v.seg.nrrd", "v.nii", "v.nii.gz", "v.mha", "v.zarr", "v.tif", "v.ome.tif", "v.npy", "v.npz", "v.vti")
    command = [program, "reconstruct", folder / "every.nrrd", "-q", "--labels", "all"]
    subprocess.run(command + [a for name in names for a in ("-o", folder / name)], check=True)
    near = lambda a, b, bound=1e-6: np.abs(np.asarray(a, float) - np.asarray(b, float)).max() <= bound
    array, told = nrrd.read(str(folder / "v.nrrd"))
    check("v.nrrd -> pynrrd", array.dtype == np.int16 and near(told["space directions"], steps) and near(told["space origin"], ORIGIN))
    check("v.nrrd -> slices as drawn", (array[:, :, ::4] == given[:, :, ::4]).all() and set(np.unique(array[:, :, 2])) == {0, 3, 300})
    same, told = nrrd.read(str(folder / "v.seg.nrrd"))
    named = [(told[f"Segment{k}_LabelValue"], told[f"Segment{k}_Name"], told[f"Segment{k}_Color"]) for k in (0, 1)]
    check("v.seg.nrrd -> pynrrd", (same == array).all() and near(told["space directions"], steps) and near(told["space origin"], ORIGIN))
    check("v.seg.nrrd -> names", named == [("3", "Leber links", "0.200000 0.400000 1.000000"), ("300", "Spine, lower", "1.000000 0.000000 0.000000")], named)
    check("v.seg.nrrd -> extents", told["Segment1_Extent"] == "0 39 0 29 0 8" and told["Segmentation_ReferenceImageExtentOffset"] == "0 0 0")
    for name in ("v.nrrd", "v.seg.nrrd", "v.nii", "v.nii.gz", "v.mha"):
        image = SimpleITK.ReadImage(str(folder / name))
        check(f"{name} -> SimpleITK", (SimpleITK.GetArrayFromImage(image).T == array).all() and image.GetPixelIDTypeAsString() == "16-bit signed integer")
        # NIfTI has 32 bits for the place.
        place = near(image.GetSpacing(), np.diag(steps)) and near(image.GetOrigin(), ORIGIN, 1e-6 if "nii" not in name else 1e-5)
        check(f"{name} -> SimpleITK place", place and near(image.GetDirection(), np.eye(3).ravel()), image.GetOrigin())
    for name in ("v.nii", "v.nii.gz"):
        image = nibabel.load(folder / name)
        check(f"{name} -> nibabel", image.get_data_dtype() == np.int16 and (np.asarray(image.dataobj) == array).all())
        check(f"{name} -> nibabel place", near(image.affine[:3, :3], np.diag([-1, -1, 1]) @ steps) and near(image.affine[:3, 3], np.diag([-1, -1, 1]) @ ORIGIN, 1e-5))
    zarr_place("v.zarr", folder / "v.zarr", array, steps, ORIGIN)
    with tifffile.TiffFile(folder / "v.tif") as file:
        x, y = (file.pages[0].tags[t].value for t in ("XResolution", "YResolution"))
        said = file.imagej_metadata
        check("v.tif -> tifffile", file.is_imagej and (file.asarray() == array.T).all() and file.asarray().dtype == np.int16)
        check("v.tif -> tifffile sides", near([x[1] / x[0], y[1] / y[0], said["spacing"]], np.diag(steps)) and said["unit"] == "mm" and said["slices"] == 9, said)
    with tifffile.TiffFile(folder / "v.ome.tif") as file:
        pixels = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]["Pixels"]
        check("v.ome.tif -> tifffile", file.is_ome and file.series[0].axes == "ZYX" and (file.asarray() == array.T).all() and file.asarray().dtype == np.int16)
        sides = [pixels[f"PhysicalSize{a}"] for a in "XYZ"]
        check("v.ome.tif -> tifffile sides", near(sides, np.diag(steps)) and {pixels[f"PhysicalSize{a}Unit"] for a in "XYZ"} == {"mm"}, pixels)
    data = vtk_file(vtkXMLImageDataReader(), folder / "v.vti")
    voxels = vtk_to_numpy(data.GetPointData().GetScalars())
    check("v.vti -> vtk", voxels.dtype == np.int16 and (voxels.reshape(array.T.shape) == array.T).all() and near(data.GetSpacing(), np.diag(steps)))
    plain = np.load(folder / "v.npy")
    check("v.npy -> numpy", plain.dtype == np.int16 and (plain == array.T).all())
    with np.load(folder / "v.npz") as packed:
        check("v.npz -> numpy", packed["volume"].dtype == np.int16 and (packed["volume"] == array.T).all())
        check("v.npz -> numpy place", near(packed["spacing"], np.diag(steps)) and near(packed["origin"], ORIGIN) and near(packed["directions"], np.eye(3)))


def far_away(program, folder):
    """The same body near the origin, in a map, ten million pixels away and at a large height: closed, and of one volume, in every reader."""
    volumes = {}
    for side, origin in [(0.25, (0, 0, 0)), (0.25, (500003.21, 5400001.77, 312.5)), (1.0, (1e7, -1e7, 1e7)), (1.0, (0, 0, 1e9))]:
        steps = side * np.eye(3)
        nrrd.write(str(folder / "far.nrrd"), labels(), {"space": "left-posterior-superior", "space directions": steps, "space origin": np.array(origin, float)})
        paths = [folder / f"far.{e}" for e in ("stl", "ply", "obj", "glb")]
        subprocess.run([program, "reconstruct", folder / "far.nrrd", "-q"] + [a for p in paths for a in ("-o", p)], check=True)
        for path in paths:
            mesh = trimesh.load(path, force="mesh")
            sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2
            degenerate = int((trimesh.triangles.area(mesh.triangles - mesh.vertices[0]) == 0).sum())
            near = mesh.copy()
            near.apply_translation(-mesh.vertices[0])
            volume = near.volume / side**3
            first = volumes.setdefault(path.suffix, volume)
            check(f"{path.name} at {origin} -> trimesh", sound and degenerate == 0 and abs(volume / first - 1) < 1e-3, f"{degenerate} degenerate, volume {volume}, {first}")


def scene(source, program, folder):
    """In metres, y upwards: each point of the plain scene, turned and scaled."""
    turned = folder / "turned.glb"
    subprocess.run([program, "reconstruct", folder / source, "-q", "--units", "m", "--y-up", "-o", turned], check=True)
    plain, turned = (trimesh.load(path, force="mesh") for path in (folder / f"{source}.glb", turned))
    x, y, z = plain.vertices.T
    off = np.abs(turned.vertices - np.column_stack([x, z, -y]) / 1000).max()
    check(f"{source} -> trimesh, y up", off < 1e-6 and turned.is_watertight and turned.volume > 0, off)


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
        outputs = [folder / f"out.{e}" for e in ("mha", "nrrd", "nii.gz", "stl", "zarr")]
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
        zarr_place(what, outputs[4], array, frame * SIDES, origin)
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
    nrrd.write(str(folder / "bzip2.nrrd"), given, {**header, "encoding": "bzip2"})
    yield folder / "bzip2.nrrd"
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


main(os.path.abspath(sys.argv[1]))
