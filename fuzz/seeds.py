"""Writes seeds by the field's own programs: numpy, nibabel, tifffile with imagecodecs, pynrrd."""

import io
import pathlib
import tempfile

import nibabel
import nrrd
import numpy
import tifffile

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
    out = io.BytesIO()
    tifffile.imwrite(out, DISC, compression="zstd", photometric="minisblack")
    keep("tiff", "zstd", out.getvalue())


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


if __name__ == "__main__":
    arrays()
    volumes()
    pages()
    segments()
