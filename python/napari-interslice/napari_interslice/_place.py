"""Places of volumes between files (LPS, axes in any order) and napari (axes that run to the head, the back and the left)."""

from __future__ import annotations

from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]


class Turn(NamedTuple):
    """How a file's array was turned to be shown, as the layer's metadata keep it."""

    order: tuple[int, int, int]
    """The file's axes (0 is x, which runs fastest) that run to the left, the back and the head."""
    flipped: tuple[bool, bool, bool]
    """Which of these the file has the other way round."""
    axes: tuple[tuple[float, float, float], ...]
    """Unit vectors (LPS) along the shown array's axes to the left, the back and the head."""


UPRIGHT = Turn((0, 1, 2), (False, False, False), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


def turn_of(axes: Array) -> Turn:
    """The turn after which axes with these directions (rows x, y, z; LPS) lie as near to left, back and head as they can."""
    order = max(permutations(range(3)), key=lambda order: sum(abs(axes[order[world], world]) for world in range(3)))
    flipped = tuple(bool(axes[order[world], world] < 0) for world in range(3))
    own = [-axes[axis] if flip else axes[axis] for axis, flip in zip(order, flipped, strict=True)]
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in own)
    return Turn((order[0], order[1], order[2]), (flipped[0], flipped[1], flipped[2]), rows)


def shown(array: Array, turn: Turn) -> Array:
    """An array (z, y, x) of a file with the axes (head, back, left)."""
    turned = array.transpose([2 - turn.order[world] for world in (2, 1, 0)])
    return np.ascontiguousarray(turned[tuple(slice(None, None, -1 if turn.flipped[world] else 1) for world in (2, 1, 0))])


def stored(array: Array, turn: Turn) -> Array:
    """The way back."""
    turned = array[tuple(slice(None, None, -1 if turn.flipped[world] else 1) for world in (2, 1, 0))]
    return turned.transpose(np.argsort([2 - turn.order[world] for world in (2, 1, 0)]))


def translation(origin: Array, steps: Array, shape: tuple[int, ...], turn: Turn) -> list[float]:
    """Where napari has the first voxel of the shown array, along its axes. `shape` is that of the array (z, y, x), `steps` are rows x, y, z."""
    for world in range(3):
        if turn.flipped[world]:
            axis = turn.order[world]
            origin = origin + (shape[2 - axis] - 1) * steps[axis]
    return [float(t) for t in np.linalg.solve(np.array(turn.axes).T, origin)[::-1]]


def place(matrix: Array, shape: tuple[int, ...], turn: Turn) -> tuple[Array, Array]:
    """Origin and steps (rows x, y, z; LPS) of the stored array, of napari's matrix from voxels of the shown one to its world, both (head, back,
    left)."""
    own = np.array(turn.axes).T
    steps = (own @ matrix[:3, :3][::-1, ::-1]).T
    origin = own @ matrix[:3, 3][::-1]
    in_file = np.empty((3, 3))
    for world, axis in enumerate(turn.order):
        in_file[axis] = steps[world]
        if turn.flipped[world]:
            origin = origin + (shape[2 - world] - 1) * steps[world]
            in_file[axis] = -steps[world]
    return origin, in_file
