"""Stacks of known shape, and the command line that comes with the module."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

Volume = NDArray[np.uint8]


def drawn(count: int = 5, every: int = 4, size: int = 40) -> Volume:
    """Two labels that touch, painted on every so many slices: axes (z, y, x)."""
    z, y, x = np.mgrid[: (count - 1) * every + 1, :size, :size].astype(float)
    t = z / z.max()
    left = (x - 14 - 2 * t) ** 2 + (y - 20) ** 2 < (8 + 2 * np.sin(3 * t)) ** 2
    right = (x - 26) ** 2 + (y - 21 + 2 * t) ** 2 < (6 + t) ** 2
    labels = np.where(left, 1, np.where(right, 5, 0)).astype(np.uint8)
    labels[np.arange(len(labels)) % every != 0] = 0
    return labels


@pytest.fixture
def labels() -> Volume:
    return drawn()


@pytest.fixture
def masks() -> NDArray[np.bool_]:
    painted: NDArray[np.bool_] = drawn()[::4] == 1
    return painted


@pytest.fixture
def command() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the command line of the wheel."""
    program = str(Path(sys.executable).with_name("interslice"))

    def run(*arguments: object, code: int = 0) -> subprocess.CompletedProcess[str]:
        result = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)
        assert result.returncode == code, result.stderr
        return result

    return run
