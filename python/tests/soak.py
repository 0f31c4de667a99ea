"""Random calls from several threads at once, for as long as is asked: every answer is that of the same call alone, and memory stays.

    python soak.py [minutes] [threads]

Not part of the test suite. Ends with 1 at the first answer that differs, or if the resident set at the end is more than a quarter above that
after the first fifth of the time.
"""

from __future__ import annotations

import hashlib
import random
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import interslice
from conftest import drawn

KINDS = [np.uint8, np.int16, np.uint32, np.int64]


def digest(*arrays: NDArray[np.generic]) -> str:
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(repr((array.dtype.str, array.shape)).encode() + np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def call(seed: int, folder: Path) -> str:
    """One random call; the seed says which."""
    rng = random.Random(seed)
    labels = drawn(rng.randint(3, 5), rng.randint(2, 5), rng.choice([32, 40, 48])).astype(rng.choice(KINDS))
    if rng.random() < 0.3:
        labels = np.asfortranarray(labels)
    if rng.random() < 0.3:
        labels = labels[:, ::-1, :]
    if rng.random() < 0.3:
        labels.flags.writeable = False
    backends: list[Literal["cpu", "auto"]] = ["cpu", "cpu", "auto"]
    methods: list[Literal["field", "morph"]] = ["field", "morph"]
    backend, method = rng.choice(backends), rng.choice(methods)
    kind = rng.randrange(6)
    if kind == 0:
        return digest(interslice.fill(labels, spacing=(2.0, 1.0, 1.0), backend=backend, method=method))
    step = int(np.flatnonzero(labels.any(axis=(1, 2)))[1])
    masks = labels[::step] == 1
    heights = [2.0 * step * k for k in range(len(masks))]
    if kind == 1:
        errors = interslice.evaluate(interslice.stack(masks, heights=heights), backend=backend, method=method)
        return repr(sorted((k, repr(v)) for k, v in errors.items() if "seconds" not in k))
    if kind == 2:
        try:
            interslice.reconstruct(masks, heights=heights[::-1])
        except ValueError as wrong:
            return str(wrong)
        return "no error"
    body = interslice.reconstruct(masks, heights=heights, dz=1.0, backend=backend, method=method)
    if kind == 3:
        z = rng.uniform(0, heights[-1])
        return digest(body.distance(z), body.mask(z), *body.contours(z), *body.mesh())
    if kind == 4:
        body.update(1, masks[1][:, ::-1])
        return digest(body.distances(), np.array([body.volume, body.area]))
    paths = [folder / f"{threading.get_ident()}.{kind}" for kind in ("stl", "nii.gz", "npz")]
    body.save(*paths)
    return digest(*(np.frombuffer(path.read_bytes(), np.uint8) for path in paths[:2]))


def resident() -> float:
    """Of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def main(minutes: float, threads: int) -> int:
    count, wrong = [0], list[str]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        known = [call(seed, folder) for seed in range(120)]
        begin = time.monotonic()

        def work(number: int) -> None:
            rng = random.Random(number)
            while time.monotonic() - begin < 60 * minutes and not wrong:
                seed = rng.randrange(len(known))
                answer = call(seed, folder)
                count[0] += 1
                if answer != known[seed]:
                    wrong.append(f"call {seed} gives {answer}, alone {known[seed]}")

        alone = resident()
        workers = [threading.Thread(target=work, args=(n,)) for n in range(threads)]
        for worker in workers:
            worker.start()
        early, told = 0.0, time.monotonic()
        while any(worker.is_alive() for worker in workers):
            time.sleep(0.5)
            if not early and time.monotonic() - begin > 12 * minutes:
                early = resident()
            if time.monotonic() - told > 60:
                told = time.monotonic()
                print(f"{(told - begin) / 60:.1f} min: {count[0]} calls, {resident():.0f} MiB", flush=True)
        late = resident()
    print(f"{count[0]} calls from {threads} threads in {minutes} min; {alone:.0f} MiB before, {early:.0f} after a fifth, {late:.0f} at the end")
    if late > 1.25 * early:
        wrong.append("memory grows")
    print("\n".join(wrong) or "every answer as alone")
    return int(bool(wrong))


if __name__ == "__main__":
    given = [float(argument) for argument in sys.argv[1:]] + [30.0, 8.0][len(sys.argv) - 1 :]
    sys.exit(main(given[0], int(given[1])))
