"""Programs that make heights of a contour map: each takes `Map` and gives heights [y, x] in m at its cells, NaN where it has none.

Each is called as its own users would, on one thread, with its defaults. Lines and cells are the same for all.
"""

import json
import shutil
import subprocess
import tempfile
from functools import wraps
from pathlib import Path

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator, CubicSpline, PchipInterpolator, RBFInterpolator
from scipy.spatial import cKDTree

from .programs import PROGRAM

#: Seconds that a program started from here may take.
LIMIT = 280
#: Layers within a contour interval where heights are read off a volume.
LAYERS = 8


def command(*words, folder=None):
    """Runs a program; what it said is in the error where it fails."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=LIMIT, cwd=folder)
    if done.returncode:
        raise RuntimeError((done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}")[-200:])


def in_folder(call):
    """Gives a program a folder of its own, by its second argument."""

    @wraps(call)
    def placed(given, *options):
        with tempfile.TemporaryDirectory() as folder:
            return call(given, Path(folder), *options)

    return placed


def write_lines(given, path):
    """The contour lines as GeoJSON, with their attribute `elevation`, in metres (UTM zone 33 N)."""
    lines = [
        {"type": "Feature", "properties": {"elevation": level}, "geometry": {"type": "LineString", "coordinates": np.round(line, 4).tolist()}}
        for level, line in given.lines
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32633"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": lines}))


def write_points(given, path):
    """The points of the lines as x, y, z."""
    np.savetxt(path, given.points, "%.4f", ",", header="x,y,z", comments="")


#: The columns x, y, z of points.csv as places with a height.
POINTS = """<OGRVRTDataSource><OGRVRTLayer name="points"><SrcDataSource>points.csv</SrcDataSource><GeometryType>wkbPoint25D</GeometryType>
<GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/></OGRVRTLayer></OGRVRTDataSource>"""


def edges(given):
    """West, east, south and north edge of the cells, m."""
    (rows, columns), (dy, dx) = given.shape, given.spacing
    return -dx / 2, (columns - 0.5) * dx, -dy / 2, (rows - 0.5) * dy


@in_folder
def interslice(given, folder, *options):
    """The command line: contour lines as GeoJSON in, a GeoTIFF on the cells of another out."""
    import tifffile

    write_lines(given, folder / "lines.geojson")
    (rows, columns), (dy, dx) = given.shape, given.spacing
    west, _, _, north = edges(given)
    tags = [(33550, "d", 3, (dx, dy, 0.0)), (33922, "d", 6, (0.0, 0.0, 0.0, west, north, 0.0))]
    tags.append((34735, "H", 16, (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32633)))
    tifffile.imwrite(folder / "cells.tif", np.zeros((rows, columns), np.float32), extratags=[(*tag, True) for tag in tags])
    border = f"0,0,{(columns - 1) * dx:.6f},{(rows - 1) * dy:.6f}"
    words = [PROGRAM, "reconstruct", folder / "lines.geojson", "--end-top", "extrapolate", "--border", border, "--like", folder / "cells.tif"]
    command(*words, "-o", folder / "out.dem.tif", "--backend", "cpu", "--threads", "1", "-q", *options)
    return tifffile.imread(folder / "out.dem.tif").astype(float)


def interslice_field(given):
    return interslice(given, "--method", "field")


def interslice_cells(given):
    """The field method, told how wide the cells are that are wanted: the shorter side of them."""
    return interslice(given, "--method", "field", "--pixel", f"{min(given.spacing):.9g}")


@in_folder
def grass(given, folder, *modules):
    """Modules of GRASS, on the contour lines `lines` (attribute elevation), that make the raster `out`; session, import and export are part of it."""
    write_lines(given, folder / "lines.geojson")
    (rows, columns), (west, east, south, north) = given.shape, edges(given)
    script = [
        f"v.in.ogr -o input={folder}/lines.geojson output=lines --quiet",
        f"g.region n={north} s={south} e={east} w={west} rows={rows} cols={columns}",
        *modules,
        f"r.out.bin -f input=out output={folder}/out.bin bytes=8 null=-99999 --quiet",
    ]
    (folder / "script").write_text("set -e\n" + "\n".join(script) + "\n")
    command("grass", "--tmp-location", "XY", "--exec", "bash", folder / "script")
    found = np.fromfile(folder / "out.bin").reshape(rows, columns)
    return np.where(found == -99999, np.nan, found)


def grass_contour(given):
    """r.surf.contour on the lines' cells."""
    return grass(
        given,
        "v.to.rast input=lines type=line output=cells use=attr attribute_column=elevation --quiet",
        "r.surf.contour input=cells output=out --quiet",
    )


def grass_spline(given):
    """v.surf.rst: the regularised spline with tension through the lines' points."""
    return grass(given, "v.surf.rst input=lines zcolumn=elevation elevation=out --quiet")


@in_folder
def gdal(given, folder, method):
    """gdal_grid on the lines' points."""
    write_points(given, folder / "points.csv")
    (rows, columns), (west, east, south, north) = given.shape, edges(given)
    words = ["gdal_grid", "-q", "-a", method, "-txe", west, east, "-tye", north, south, "-outsize", columns, rows, "-ot", "Float64", "-of", "ENVI"]
    (folder / "points.vrt").write_text(POINTS)
    command(*words, "--config", "GDAL_NUM_THREADS", "1", "-l", "points", "points.vrt", "out.img", folder=folder)
    return np.fromfile(folder / "out.img").reshape(rows, columns)


def gdal_linear(given):
    """Delaunay triangles of all points, flat within each."""
    return gdal(given, "linear:radius=0:nodata=nan")


def gdal_inverse(given):
    """Inverse squared distances of the nearest 12 points within 25 cells."""
    return gdal(given, f"invdistnn:power=2:radius={25 * max(given.spacing):.0f}:max_points=12:nodata=nan")


@in_folder
def gmt(given, folder):
    """blockmean, then surface with the tension 0.35 that its manual gives for steep topography."""
    write_points(given, folder / "points.csv")
    (rows, columns), (dy, dx) = given.shape, given.spacing
    region = [f"-R0/{(columns - 1) * dx:.6f}/0/{(rows - 1) * dy:.6f}", f"-I{dx:.9g}/{dy:.9g}"]
    with open(folder / "means.csv", "w") as file:
        subprocess.run(["gmt", "blockmean", "points.csv", "-h1", *region, "-Vq"], stdout=file, check=True, timeout=LIMIT, cwd=folder)
    command("gmt", "surface", "means.csv", *region, "-T0.35", "-Gout.grd", "-Vq", folder=folder)
    with open(folder / "out.bin", "wb") as file:
        subprocess.run(["gmt", "grd2xyz", "out.grd", "-ZTLd"], stdout=file, check=True, timeout=LIMIT, cwd=folder)
    return np.fromfile(folder / "out.bin").reshape(rows, columns)


def clough_tocher(given):
    """SciPy's C1 surface over the Delaunay triangles of all points."""
    points = given.points
    return CloughTocher2DInterpolator(points[:, :2], points[:, 2])(*given.centres)


def thin_plate(given):
    """SciPy's thin-plate spline of the nearest 64 points of each cell."""
    points, (x, y) = given.points, given.centres
    return RBFInterpolator(points[:, :2], points[:, 2], neighbors=64)(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)


def line_distances(given):
    """Distance of each cell from each level's lines, negative above it, m [k, y, x]: from points a quarter of a cell apart."""
    x, y = given.centres
    cells, step, out = np.column_stack([x.ravel(), y.ravel()]), min(given.spacing) / 4, []
    for level, above in zip(given.levels, given.above):
        points = []
        for line in (line for of, line in given.lines if of == level):
            along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            at = np.linspace(0, along[-1], max(int(along[-1] / step), 1) + 1)
            points.append(np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)]))
        distance = cKDTree(np.concatenate(points)).query(cells)[0].reshape(x.shape)
        out.append(np.where(above, -distance, distance))
    return np.stack(out)


def read_heights(phi, layers):
    """The height at which phi [layer, y, x] leaves the ground, linear between layers; NaN below the first layer and above the last."""
    inside = phi < 0
    count = inside.cumprod(0).sum(0)
    k = np.clip(count, 1, len(layers) - 1)
    low, high = (np.take_along_axis(phi, (k + d)[None], 0)[0] for d in (-1, 0))
    part = low / np.where(low == high, 1, low - high)
    heights = layers[k - 1] + np.clip(part, 0, 1) * (layers[k] - layers[k - 1])
    return np.where((count == 0) | (count == len(layers)), np.nan, heights)


def volume(given, interpolate):
    levels = given.levels
    layers = np.interp(np.arange(LAYERS * (len(levels) - 1) + 1) / LAYERS, np.arange(len(levels)), levels)
    return read_heights(interpolate(levels, line_distances(given))(layers), layers)


def pchip(given):
    """Distances from the lines, with the monotone cubic of Fritsch and Carlson in each cell."""
    return volume(given, PchipInterpolator)


def cubic(given):
    """The same with natural cubic splines."""
    return volume(given, lambda levels, phi: CubicSpline(levels, phi, bc_type="natural"))


#: Name in tables: the call, and the command it needs beside Python's packages.
PROGRAMS = {
    "interslice": (interslice, PROGRAM),
    "interslice --method field": (interslice_field, PROGRAM),
    "interslice --method field --pixel CELL": (interslice_cells, PROGRAM),
    "SDF PCHIP": (pchip, None),
    "SDF cubic": (cubic, None),
    "GRASS r.surf.contour": (grass_contour, "grass"),
    "GRASS v.surf.rst": (grass_spline, "grass"),
    "GDAL linear": (gdal_linear, "gdal_grid"),
    "GDAL invdistnn": (gdal_inverse, "gdal_grid"),
    "GMT surface": (gmt, "gmt"),
    "Clough-Tocher": (clough_tocher, None),
    "thin plates": (thin_plate, None),
}


def missing():
    """Commands that are not to be found."""
    return sorted({needed for _, needed in PROGRAMS.values() if needed and not shutil.which(needed)})
