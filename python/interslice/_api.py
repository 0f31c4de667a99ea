"""The functions of the package: arguments to what the module takes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from interslice import _native
from interslice._images import image, sides, unmasked
from interslice._native import Body, Settings, Stack
from interslice._numbers import Spacing, Vector, answer, called, counted, numbers, several, whole, wholes

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from interslice._options import ReadOptions, RunOptions, SettingsOptions

Progress = Callable[[str, int, int], object]


def _choice(
    axis: int | None = None,
    slices: Iterable[int] | None = None,
    keep: int | None = None,
    complete_slices: bool = False,
    level: float | None = None,
    invert: bool = False,
    label: int | None = None,
) -> dict[str, Any]:
    along = None
    if axis is not None:
        along = whole("axis", axis)
        if not -3 <= along < 3:
            raise ValueError(f"`axis` must be 0, 1 or 2, an axis of the array; got {axis}")
        along %= 3
    return {
        "axis": along,
        "slices": None if slices is None else [counted("slices", k) for k in several("slices", slices)],
        "keep": None if keep is None else counted("keep", keep),
        "complete_slices": answer("complete_slices", complete_slices),
        "level": None if level is None else float(level),
        "invert": answer("invert", invert),
        "label": None if label is None else whole("label", label),
    }


@overload
def fill(
    labels: Any,
    *,
    spacing: Spacing | None = None,
    axis: int | None = None,
    slices: Iterable[int] | Mapping[int, Iterable[int]] | None = None,
    keep: int | None = None,
    complete_slices: bool = False,
    only: Iterable[int] | None = None,
    report: Literal[False] = False,
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: Literal["paper", "fast"] | None = None,
    **options: Unpack[SettingsOptions],
) -> Any: ...


@overload
def fill(
    labels: Any,
    *,
    spacing: Spacing | None = None,
    axis: int | None = None,
    slices: Iterable[int] | Mapping[int, Iterable[int]] | None = None,
    keep: int | None = None,
    complete_slices: bool = False,
    only: Iterable[int] | None = None,
    report: Literal[True],
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: Literal["paper", "fast"] | None = None,
    **options: Unpack[SettingsOptions],
) -> tuple[Any, dict[str, Any]]: ...


@overload
def fill(
    labels: Any,
    *,
    spacing: Spacing | None = None,
    axis: int | None = None,
    slices: Iterable[int] | Mapping[int, Iterable[int]] | None = None,
    keep: int | None = None,
    complete_slices: bool = False,
    only: Iterable[int] | None = None,
    report: bool,
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: Literal["paper", "fast"] | None = None,
    **options: Unpack[SettingsOptions],
) -> Any: ...


def fill(
    labels: Any,
    *,
    spacing: Spacing | None = None,
    axis: int | None = None,
    slices: Iterable[int] | Mapping[int, Iterable[int]] | None = None,
    keep: int | None = None,
    complete_slices: bool = False,
    only: Iterable[int] | None = None,
    report: bool = False,
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: str | None = None,
    **options: Any,
) -> Any:
    """Fill a label volume that is painted on some of its slices.

    `labels` is an array of three axes with whole numbers, 0 for the background, or an image of nibabel, SimpleITK or ITK, or (array, header) of
    pynrrd, whose geometry is used. The result is of the same kind, type and shape; voxels that are painted keep their labels, and labels
    that are not filled are as they were. `spacing` is the distance of voxels along each axis of the array, in the array's order (1 where nothing says it,
    with a warning); `axis` that along which slices lie (default: that along which painted slices stand alone, else that of the coarsest spacing).

    `slices` are the slices that count, for all labels or for each one (`{label: slices}`; the others are left alone); by default those on which a
    label is painted: it goes on across slices on which only others are, and a warning names it. With `complete_slices` a painted slice counts for
    all labels: those that are not on it end before it. `only` names the labels to fill. `progress` is called as `progress(stage, done, total)`.
    `options` are the settings, and those of the machine, of the command line; with `report=True` the result is (labels, report).

    Raises ValueError for wrong input, MemoryError, OSError, GpuError.
    """
    if labels is None or isinstance(labels, (str, os.PathLike)):
        raise TypeError(f"`labels` must be an array or an image, such as `read_volume(path).arrays[0]`; got {labels!r}")
    of = image(labels, spacing, "labels")
    own: dict[int, list[int]] | None = None
    if isinstance(slices, Mapping):
        own = {whole("slices", label): sorted({counted("slices", k) for k in several("slices", chosen)}) for label, chosen in slices.items()}
        slices = sorted(set().union(*own.values()))
    names = None if only is None else wholes("only", only)
    choice = _choice(axis, slices, keep, complete_slices)
    made, told = _native.fill(of.array, of.place("labels"), choice, names, own, called(progress), settings, preset, options)
    filled = of.like(made)
    return (filled, told) if report else filled


def read(
    source: Any,
    *,
    spacing: Spacing | None = None,
    axis: int | Literal["auto", "x", "y", "z"] | None = None,
    **options: Unpack[ReadOptions],
) -> Stack:
    """Read a stack from a file or folder in any format of the command line, or its painted slices from a volume in an array or image.

    `options` are those of the command line under Input. For arrays these are `level`, `invert`, `label`, `keep` and `slices`; `spacing` and `axis` are
    then those of `fill`. For files `spacing` is (dx, dy, dz) and `axis` a letter, as on the command line.
    """
    if isinstance(source, (str, os.PathLike)):
        given: dict[str, Any] = dict(options, spacing=spacing, axis=axis)
        return _native.read(os.fspath(source), given)
    of = image(source, spacing, "labels")
    if isinstance(axis, str):
        raise ValueError(f"`axis` of an array is a number; got `{axis}`")
    known = ("invert", "keep", "label", "level", "slices")
    for name in options:
        if name not in known:
            raise TypeError(f"`{name}` is not for arrays; there are {', '.join(known)}")
    chosen: dict[str, Any] = dict(options)
    return _native.read_array(of.array, of.place("labels"), _choice(axis, **chosen))


def stack(
    masks: Any = None,
    heights: Iterable[float] | None = None,
    spacing: Spacing | None = None,
    *,
    polygons: Iterable[Iterable[Any]] | None = None,
    fields: Any = None,
    level: float | None = None,
    pixel: float | tuple[float, float] | None = None,
    origin: Vector = (0.0, 0.0, 0.0),
    axes: Sequence[Vector] | NDArray[Any] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    unit: str = "mm",
) -> Stack:
    """Make a stack of masks, fields or polygons at `heights` (increasing).

    `masks` are arrays of two axes, or one of three, not 0 inside. `fields` are negative inside; with `level` they are grey values, inside above it.
    `polygons` has, for each slice, closed lines: arrays of points (x, y); points within an odd number of them are inside; `pixel` is the side
    of the pixels on which they are laid. `spacing` is the distance of rows and of columns of the others (default 1). Pixel (0, 0) at height 0 lies
    at `origin`; `axes` are the directions of columns, rows and heights (LPS).
    """
    given = [kind for kind, value in (("masks", masks), ("fields", fields), ("polygons", polygons)) if value is not None]
    if len(given) != 1:
        raise ValueError(f"one of `masks`, `fields` and `polygons` must be given; got {' and '.join(given) or 'none'}")
    if heights is None:
        raise ValueError("`heights` must be given, one for each slice")
    if not isinstance(unit, str):
        raise ValueError(f"`unit` must be a text, such as mm; got {unit!r}")
    directions = [numbers("axes", axis, 3) for axis in several("axes", axes)]
    if len(directions) != 3:
        raise ValueError(f"`axes` must be three vectors; got {len(directions)}")
    lie = {
        "heights": numbers("heights", heights),
        "spacing": sides(1.0 if spacing is None else spacing, 2),
        "origin": numbers("origin", origin, 3),
        "axes": directions,
        "unit": unit,
    }
    if polygons is not None:
        if level is not None:
            raise ValueError("`level` is for `fields`, which it cuts")
        if spacing is not None:
            raise ValueError("`spacing` is for `masks` and `fields`; polygons have `pixel`, the side of the pixels on which they are laid")
        drawn = [[_line(k, line) for line in several("polygons", lines)] for k, lines in enumerate(several("polygons", polygons))]
        return _native.stack_of_polygons(drawn, lie, None if pixel is None else tuple(sides(pixel, 2, "pixel")))
    kind = given[0]
    if kind == "masks" and level is not None:
        raise ValueError("`level` is for `fields`, which it cuts")
    if pixel is not None:
        raise ValueError("`pixel` is for `polygons`; masks and fields have `spacing`")
    arrays: Any = masks if kind == "masks" else fields
    arrays = unmasked(arrays, kind) if isinstance(arrays, np.ndarray) else [unmasked(slice_, kind) for slice_ in several(kind, arrays)]
    return _native.stack_of_arrays(arrays, lie, kind, level)


def reconstruct(
    masks: Any = None,
    heights: Iterable[float] | None = None,
    spacing: Spacing | None = None,
    *,
    polygons: Iterable[Iterable[Any]] | None = None,
    fields: Any = None,
    level: float | None = None,
    pixel: float | tuple[float, float] | None = None,
    origin: Vector = (0.0, 0.0, 0.0),
    axes: Sequence[Vector] | NDArray[Any] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    unit: str = "mm",
    at: Iterable[float] | None = None,
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: Literal["paper", "fast"] | None = None,
    **options: Unpack[RunOptions],
) -> Body:
    """Reconstruct the body between contours: of a Stack, a path, or the arguments of `stack`.

    `at` are the output heights, else `dz` is their distance (default: that of the input, else the smaller pixel side). `progress` is called as
    `progress(stage, done, total)`. `options` are the settings, and those of the machine and of outputs, of the command line; `Body.save` may be told
    other ones of outputs.

    Raises ValueError for wrong input, MemoryError, OSError, GpuError.
    """
    if isinstance(masks, (str, os.PathLike)):
        masks = read(masks)
    if isinstance(masks, Stack):
        if heights is not None or spacing is not None:
            raise ValueError("`heights` and `spacing` are not for a Stack, which has its own")
        given = {"polygons": polygons, "fields": fields, "level": level, "pixel": pixel}
        named = [name for name, value in given.items() if value is not None]
        named += ["origin"] if numbers("origin", origin, 3) != [0.0, 0.0, 0.0] else []
        named += ["axes"] if not np.array_equal(np.asarray(axes, dtype=float), np.eye(3)) else []
        named += ["unit"] if unit != "mm" else []
        if named:
            raise ValueError(f"`{named[0]}` is not for a Stack, which is as it was read or made: say it to `read` or `stack`")
        of = masks
    else:
        of = stack(
            masks,
            heights,
            spacing,
            polygons=polygons,
            fields=fields,
            level=level,
            pixel=pixel,
            origin=origin,
            axes=axes,
            unit=unit,
        )
    wanted = None if at is None else numbers("at", at)
    for z in wanted or ():
        if not np.isfinite(z):
            raise ValueError(f"`at` takes finite heights; got {z}")
    return _native.reconstruct(of, wanted, called(progress), settings, preset, dict(options))


def evaluate(
    stack: Any,
    *,
    leave: int = 2,
    progress: Progress | None = None,
    settings: Settings | None = None,
    preset: Literal["paper", "fast"] | None = None,
    **options: Unpack[SettingsOptions],
) -> dict[str, Any]:
    """Leave out every `leave`-th slice, reconstruct it from the others, and say how well it was found, as `interslice evaluate --json`."""
    return _native.evaluate(_stack(stack), whole("leave", leave), called(progress), settings, preset, dict(options))


def inspect(stack: Any) -> str:
    """Say what is in a stack, before any work: the words of `interslice inspect`."""
    return _native.inspect(_stack(stack))


def links(stack: Any) -> list[dict[str, Any]]:
    """Find pairs of parts of neighbouring slices that miss each other and may be the same: entries for the setting `links`, with reasons."""
    return _native.links(_stack(stack))


def _line(k: int, line: Any) -> NDArray[np.float64]:
    """A closed line of slice `k`."""
    try:
        points = np.ascontiguousarray(line, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise ValueError(f"`polygons` must have, for each slice, a list of lines, each an array of points (x, y); a line of slice {k} is none: {e}") from None
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(
            f"`polygons` must have, for each slice, a list of lines, each an array of points (x, y); a line of slice {k} has the shape {points.shape}"
        )
    return points


def _stack(of: Any) -> Stack:
    return of if isinstance(of, Stack) else read(of)
