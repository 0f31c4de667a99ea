"""Writes seeds by the field's own programs: numpy, nibabel, tifffile with imagecodecs, pynrrd, zarr, sqlite3."""

import io
import json
import math
import pathlib
import sqlite3
import struct
import tempfile

import nibabel
import nrrd
import numpy
import tifffile
import zarr

SEEDS = pathlib.Path(__file__).parent / "seeds"
BETWEEN = b"\n%%%%\n"
z, y, x = numpy.mgrid[:3, :10, :12]
DISC = (numpy.hypot(x - 5 - 0.5 * z, y - 4.5) < 3.4 - 0.5 * z).astype(numpy.uint8)


def keep(target, name, data):
    (SEEDS / target).mkdir(exist_ok=True)
    (SEEDS / target / name).write_bytes(data)


def arrays():
    for name, save in [("plain", numpy.savez), ("packed", numpy.savez_compressed)]:
        out = io.BytesIO()
        save(out, labels=DISC, spacing=numpy.array([2.0, 0.5, 0.5]))
        keep("npz", name, out.getvalue())


def volumes():
    turned = DISC.transpose(2, 1, 0)
    affine = numpy.diag([-0.5, -0.5, 2.0, 1.0])
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        nibabel.Nifti2Image(turned, affine).to_filename(folder / "a.nii")
        keep("nifti", "two", (folder / "a.nii").read_bytes())
        for name, image in [
            ("analyze", nibabel.AnalyzeImage(turned, affine)),
            ("nifti", nibabel.Nifti1Pair(turned, affine)),
        ]:
            image.to_filename(folder / f"{name}.img")
            pair = [(folder / f"{name}.{e}").read_bytes() for e in ["hdr", "img"]]
            keep("analyze", name, BETWEEN.join(pair))


def pages():
    for name, settings in [("zstd", {"compression": "zstd"}), ("tiles", {"compression": "lzw", "tile": (16, 16)})]:
        out = io.BytesIO()
        tifffile.imwrite(out, DISC, photometric="minisblack", **settings)
        keep("tiff", name, out.getvalue())


def segments():
    header = {
        "type": "uint8",
        "dimension": 4,
        "space": "left-posterior-superior",
        "sizes": [2, 12, 10, 3],
        "space directions": numpy.array([[numpy.nan] * 3, [0.5, 0, 0], [0, 0.5, 0], [0, 0, 2]]),
        "kinds": ["list", "domain", "domain", "domain"],
        "space origin": [0, 0, 0],
        "encoding": "gzip",
    }
    for k, (name, colour) in enumerate([("liver", "0.8 0.4 0.2"), ("cyst", "0.1 0.9 0.2")]):
        header |= {f"Segment{k}_{key}": value for key, value in
                   {"Name": name, "Layer": str(k), "LabelValue": "1", "Color": colour}.items()}
    turned = DISC.transpose(2, 1, 0)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "a.seg.nrrd"
        nrrd.write(str(path), numpy.stack([turned, numpy.roll(turned, 2, axis=0)]), header)
        keep("nrrd", "layers", path.read_bytes())


def chunks():
    """An image's attributes, an array's metadata, and its two chunks; Zarr 2 by Blosc, Zarr 3 by zstd and in shards."""
    image = {"axes": [{"name": a, "type": "space", "unit": "micrometer"} for a in "zyx"],
             "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [2, 0.5, 0.5]}]}]}
    colours = {"colors": [{"label-value": 1, "rgba": [200, 100, 50, 255]}]}
    two = {"multiscales": [image | {"version": "0.4"}], "image-label": colours}
    three = {"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": [image], "image-label": colours}}}
    for name, version, settings in [
        ("blosc", 2, {"chunks": (2, 10, 12), "chunk_key_encoding": {"name": "v2", "separator": "/"}}),
        ("zlib", 2, {"chunks": (2, 10, 12), "chunk_key_encoding": {"name": "v2", "separator": "/"}}),
        ("zstd", 3, {"chunks": (2, 10, 12)}),
        ("shards", 3, {"chunks": (1, 5, 6), "shards": (2, 10, 12)}),
    ]:
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "0"
            compressors = zarr.codecs.BloscCodec() if version == 3 else "auto"
            if version == 2:
                import numcodecs
                compressors = numcodecs.Blosc() if name == "blosc" else numcodecs.Zlib()
            elif name == "zstd":
                compressors = zarr.codecs.ZstdCodec()
            array = zarr.create_array(path, shape=DISC.shape, dtype="uint8", zarr_format=version, compressors=compressors, **settings)
            array[:] = DISC
            names = ["0/zarr.json", "0/c/0/0/0", "0/c/1/0/0"] if version == 3 else ["0/.zarray", "0/0/0/0", "0/1/0/0"]
            pieces = [json.dumps(three if version == 3 else two).encode()]
            pieces += [(pathlib.Path(folder) / n).read_bytes() for n in names]
            keep("zarr", name, BETWEEN.join(pieces))


def lines():
    """Three rings in a GeoPackage of small pages."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "a.gpkg"
        base = sqlite3.connect(path)
        base.executescript("""PRAGMA page_size = 512; PRAGMA application_id = 0x47504B47;
            CREATE TABLE gpkg_spatial_ref_sys (srs_id INTEGER PRIMARY KEY, organization TEXT, organization_coordsys_id INTEGER, definition TEXT);
            CREATE TABLE gpkg_contents (table_name TEXT, data_type TEXT);
            CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER);
            CREATE TABLE a (fid INTEGER PRIMARY KEY, geom BLOB, elev REAL);
            INSERT INTO gpkg_spatial_ref_sys VALUES (32611, 'EPSG', 32611, '');
            INSERT INTO gpkg_contents VALUES ('a', 'features');
            INSERT INTO gpkg_geometry_columns VALUES ('a', 'geom', 'MULTILINESTRING', 32611);""")
        for k, radius in enumerate([40.0, 25.0, 10.0]):
            ring = [(5e5 + radius * math.cos(math.tau * (n % 9) / 9), 4e6 + radius * math.sin(math.tau * (n % 9) / 9)) for n in range(10)]
            line = struct.pack("<BII", 1, 2, len(ring)) + b"".join(struct.pack("<dd", *p) for p in ring)
            blob = b"GP" + struct.pack("<BBi", 0, 1, 32611) + struct.pack("<BII", 1, 5, 1) + line
            base.execute("INSERT INTO a VALUES (?, ?, ?)", (k, blob, 100.0 + 10 * k))
        base.commit()
        base.close()
        keep("geopackage", "cone", path.read_bytes())


if __name__ == "__main__":
    chunks()
    lines()
    arrays()
    volumes()
    pages()
    segments()
