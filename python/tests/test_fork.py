"""Forked processes: what was computed before the fork is there, and more can be computed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

# Not beside the package's source, which has no module.
HERE = Path(__file__).parent

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks there")

FORKS = """
import os, sys, warnings
import numpy as np, interslice
from conftest import drawn

warnings.simplefilter("ignore")

def forked(work):
    child = os.fork()
    if child == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException as error:
            print(repr(error), flush=True)
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""

# Many calls, two at a time, of the kinds that compute.
CALLS = """
from concurrent.futures import ThreadPoolExecutor

labels = drawn()
filled = interslice.fill(labels)
body = interslice.reconstruct(labels[::4] == 1, range(0, 15, 3), method="field")
layer, mesh = body.distance(4.5), body.mesh(simplify=0.3)
ring = 9 * np.column_stack([np.cos(np.arange(60) / 9.55), np.sin(np.arange(60) / 9.55)])

def computes():
    assert (interslice.fill(labels) == filled).all()
    assert (body.distance(4.5) == layer).all() and (body.mesh(simplify=0.3)[1] == mesh[1]).all()
    with ThreadPoolExecutor(2) as pool:
        layers = pool.map(body.distance, [0.1 * k for k in range(20)])
        assert all(len(one) == 40 for one in layers)
    assert interslice.reconstruct(polygons=[[ring]] * 3, heights=[0, 1, 2], pixel=0.5).volume > 400
    assert interslice.inspect(labels) and interslice.evaluate(interslice.read(labels, spacing=(3, 1, 1)))["dice"] > 0.8

forked(computes)
forked(lambda: forked(computes))
print("done")
"""

DRIVER = """
interslice.devices()
labels = drawn()

def asks():
    try:
        interslice.fill(labels, backend="gpu")
        raise AssertionError("the driver was asked")
    except interslice.GpuError as error:
        assert "forked" in str(error) and "spawn" in str(error), error
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        interslice.fill(labels)
    assert any("forked" in str(one.message) for one in told), told
    assert (interslice.fill(labels, backend="cpu") != 0).any()

forked(asks)
print("done")
"""

POOL = """
import multiprocessing
from functools import partial

if __name__ == "__main__":
    given = [drawn(count=3 + k) for k in range(4)]
    fill = partial(interslice.fill, method="field")
    expected = [fill(one) for one in given]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        for one, own in zip(pool.map(fill, given), expected, strict=True):
            np.testing.assert_array_equal(one, own)
    print("done")
"""


@pytest.mark.parametrize("program", [CALLS, DRIVER, POOL], ids=["calls", "driver", "multiprocessing"])
def test_a_forked_process_computes(program: str) -> None:
    command = [sys.executable, "-c", FORKS + program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=HERE, start_new_session=True) as process:
        try:
            said, _ = process.communicate(timeout=120)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert (said, process.returncode) == ("done\n", 0)
