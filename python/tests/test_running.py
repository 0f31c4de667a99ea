"""Threads, Ctrl-C, progress; and what is told of inputs and machines."""

from __future__ import annotations

import importlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import interslice
import numpy as np
import pytest
from conftest import Volume, drawn
from numpy.typing import NDArray

# Not beside the package's source, which has no module.
HERE = Path(__file__).parent

# About ten seconds of work.
LONG = """
import sys, time, signal, numpy as np, interslice
# A shell that starts jobs in the background has them ignore it.
signal.signal(signal.SIGINT, signal.default_int_handler)
y, x = np.mgrid[:512, :512]
masks = [np.hypot(x - 256, y - 256) < 150 + 40 * np.sin(k) for k in range(40)]
print("ready", flush=True)
try:
    interslice.reconstruct(masks, range(0, 120, 3), method={method!r})
except KeyboardInterrupt:
    print("interrupted", time.time(), flush=True)
"""


def interrupted(program: list[str], after: float) -> tuple[str, float]:
    """Sends Ctrl-C to a program some seconds after it is ready; what it says then, and how many seconds later."""
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=HERE) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        time.sleep(after)
        sent = time.time()
        process.send_signal(signal.SIGINT)
        word, when = process.stdout.readline().split()
    return word, float(when) - sent


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of another kind there")
@pytest.mark.parametrize("method", ["field", "morph"])
@pytest.mark.parametrize("after", [0.6, 2.5])
def test_ctrl_c_ends_within_a_second(method: str, after: float) -> None:
    program = [sys.executable, "-c", LONG.format(method=method)]
    word, seconds = interrupted(program, after)
    assert word == "interrupted" and seconds < 1.0, (word, seconds)


# A body whose surface takes long to simplify: seconds of work.
FINE = """
import sys, time, signal, numpy as np, interslice
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)
y, x = np.mgrid[:192, :192]
angle = np.arctan2(y - 96, x - 96)
masks = [np.hypot(x - 96, y - 96) < 60 + 12 * np.sin(9 * angle + k) for k in range(16)]
body = interslice.reconstruct(masks, range(0, 48, 3), method="field", motion="none", dz=0.25)
print("ready", flush=True)
try:
    {call}
    print("finished", time.time(), flush=True)
except KeyboardInterrupt:
    print("interrupted", time.time(), flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of another kind there")
@pytest.mark.parametrize("after", [0.05, 1.5])
@pytest.mark.parametrize("call", ["body.mesh(simplify=0.02)", "body.save(*sys.argv[1:], simplify=0.02)"])
def test_ctrl_c_ends_what_follows_and_replaces_nothing(call: str, after: float, tmp_path: Path) -> None:
    old = [tmp_path / name for name in ("a.stl", "b.ply", "c.nrrd", "d.json")]
    for path in old:
        path.write_text(f"the old {path.name}")
    program = [sys.executable, "-c", FINE.format(call=call), *map(str, old)]
    word, seconds = interrupted(program, after)
    assert word == "interrupted" and seconds < 2.0, (word, seconds)
    assert [path.read_text() for path in old] == [f"the old {path.name}" for path in old]
    assert sorted(tmp_path.iterdir()) == sorted(old)


def test_nobody_waits_for_a_call_that_computes(labels: Volume) -> None:
    masks = drawn(size=160, count=8)[::4] == 1
    body = interslice.reconstruct(masks, range(0, 24, 3), method="field", dz=0.25)
    done, ticks = threading.Event(), [0]

    def tick() -> None:
        while not done.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    with ThreadPoolExecutor(2) as pool:
        ticking = pool.submit(tick)
        mesh = pool.submit(body.mesh, simplify=0.02)
        time.sleep(0.1)
        seen = (repr(body), body.heights, body.contour_heights, body.spacing, body.shape, body.unit)
        assert not mesh.done(), "what never changes waits for nobody"
        before = ticks[0]
        assert body.stale == []
        during = ticks[0] - before
        done.set()
        ticking.result()
        assert len(mesh.result()[1]) > 0
    assert during > 5, "who waits for the body keeps the lock of nobody else"
    assert seen[2:] == ([float(z) for z in range(0, 24, 3)], [1.0, 1.0], [160, 160], "mm")


def test_many_threads_give_what_one_gives(labels: Volume) -> None:
    given = [drawn(count=4 + k % 3) for k in range(8)]
    expected = [interslice.fill(one, method="field") for one in given]
    with ThreadPoolExecutor(8) as pool:
        for one, own in zip(pool.map(lambda one: interslice.fill(one, method="field"), given), expected, strict=True):
            np.testing.assert_array_equal(one, own)
    body = interslice.reconstruct(given[0][::4] == 1, range(4), method="field")
    with ThreadPoolExecutor(8) as pool:
        heights = [0.1 * k for k in range(30)]
        layers = list(pool.map(body.distance, heights))
    for z, layer in zip(heights, layers, strict=True):
        np.testing.assert_array_equal(layer, body.distance(z))


def test_the_lock_is_free_while_it_computes() -> None:
    counted, done = [0], threading.Event()

    def count() -> None:
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    began = time.time()
    interslice.fill(drawn(size=160, count=8))
    took = time.time() - began
    done.set()
    thread.join()
    assert counted[0] > 50 * took


def test_progress_is_told_and_may_end_the_run(labels: Volume) -> None:
    told: list[tuple[str, int, int]] = []
    given = drawn(size=480, count=30)
    interslice.fill(given, progress=lambda *state: told.append(state))
    assert all(isinstance(stage, str) and 0 <= done <= total for stage, done, total in told), told
    assert any(done < total for _, done, total in told), told

    def refuses(stage: str, done: int, total: int) -> None:
        raise LookupError(f"enough of {stage}")

    with pytest.raises(LookupError, match="enough of "):
        interslice.fill(given, progress=refuses)
    with pytest.raises(TypeError, match="`progress` must be a function"):
        interslice.fill(drawn(size=160, count=8), progress=7)  # type: ignore[call-overload]


def test_what_is_told(command: Callable[..., Any], tmp_path: Path, labels: Volume, masks: NDArray[np.bool_]) -> None:
    np.save(tmp_path / "given.npy", labels)
    assert interslice.inspect(tmp_path / "given.npy").splitlines()[:6] == command("inspect", tmp_path / "given.npy").stdout.splitlines()[:6]
    assert "slices lie along" in interslice.inspect(labels)
    stack = interslice.stack(masks, range(5))
    assert "5 slices (masks)" in interslice.inspect(stack) and len(stack) == 5
    score = interslice.evaluate(tmp_path / "given.npy", method="field")
    assert score["dice"] > 0.9 and score["leave"] == 2
    assert all(isinstance(device["name"], str) for device in interslice.devices())


def test_links_join_what_misses_itself() -> None:
    masks = np.zeros((3, 40, 40), bool)
    for k, x in enumerate((4, 16, 28)):
        masks[k, 15:23, x : x + 8] = True
    stack = interslice.stack(masks, [0, 4, 8])
    found = interslice.links(stack)
    assert [(one["slice"], one["from"], one["to"], one["auto"]) for one in found] == [(0, 1, 1, True), (1, 1, 1, True)]
    joined = [{key: one[key] for key in ("slice", "from", "to")} for one in found]
    assert interslice.reconstruct(stack, links=joined).mask(2.0).sum() > 30
    with pytest.raises(ValueError, match="links"):
        interslice.reconstruct(stack, links=[{"slice": 7, "from": 1, "to": 1}])


def test_the_command_comes_with_the_wheel(command: Callable[..., Any]) -> None:
    assert command("--version").stdout == f"interslice {interslice.__version__}\n"
    of_module = [sys.executable, "-m", "interslice", "--version"]
    module = subprocess.run(of_module, capture_output=True, text=True, check=True, cwd=HERE)
    assert module.stdout == f"interslice {interslice.__version__}\n"
    assert "unexpected argument" in command("reconstruct", "--nothing", code=2).stderr
    # A tool that imports every module of a package runs nothing.
    assert importlib.import_module("interslice.__main__").main
