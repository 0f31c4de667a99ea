"""What the module has."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self, Unpack

from interslice._options import SettingsOptions

__version__: str

_Progress = Callable[[str, int, int], object]

class GpuError(RuntimeError):
    """The GPU cannot do the work: there is none, its limits are too small, it was lost, or its self-test has failed."""

@final
class Settings:
    """Settings of a reconstruction: names, ranges and defaults are those of the command line."""

    def __new__(cls, preset: Literal["paper", "fast"] | None = None, **settings: Unpack[SettingsOptions]) -> Self: ...
    def replace(self, **settings: Unpack[SettingsOptions]) -> Settings:
        """These settings with some others."""
    def to_dict(self) -> dict[str, Any]:
        """Names and values."""
    @staticmethod
    def options() -> list[dict[str, Any]]:
        """What there is to set: name, help (with range and unit), default and choices, as `--help` has them."""
    def __getattr__(self, name: str) -> Any: ...
    def __eq__(self, other: object) -> bool: ...

@final
class Stack:
    """A stack of contours, as `read` and `stack` give it."""

    @property
    def heights(self) -> list[float]: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def shape(self) -> list[int]: ...
    @property
    def spacing(self) -> list[float]: ...
    @property
    def unit(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    def __len__(self) -> int: ...

@final
class Body:
    """A reconstructed body."""

    @property
    def heights(self) -> list[float]:
        """Heights of the output layers."""
    @property
    def contour_heights(self) -> list[float]:
        """Heights of the slices."""
    @property
    def shape(self) -> list[int]: ...
    @property
    def spacing(self) -> list[float]: ...
    @property
    def origin(self) -> list[float]:
        """Where column 0 and row 0 are at height 0 in the world (LPS): column i and row j at height z are at `origin + i dx axes[0] + j dy axes[1] + z axes[2]`."""
    @property
    def axes(self) -> list[list[float]]:
        """Unit vectors along a row, along a column and upwards."""
    @property
    def unit(self) -> str: ...
    @property
    def volume(self) -> float:
        """Volume enclosed by the surface, unit cubed."""
    @property
    def area(self) -> float:
        """Area of the surface, unit squared."""
    @property
    def report(self) -> dict[str, Any]:
        """What was done and how well each contour is met, as the report of the command line."""
    @property
    def stale(self) -> list[int]:
        """Intervals between slices, from 0, whose layers are out of date."""
    def distance(self, z: float) -> NDArray[np.float32]:
        """Signed distance within the plane at a height, in the unit of the spacing: negative inside, clamped 14 px from the contour (`half_width` and 8 more)."""
    def mask(self, z: float) -> NDArray[np.bool_]:
        """Which pixels are inside on the plane at a height."""
    def distances(self) -> NDArray[np.float32]:
        """Signed distances of all output layers, as `distance` has them."""
    def masks(self) -> NDArray[np.bool_]:
        """Which pixels are inside on all output layers."""
    def contours(self, z: float) -> list[NDArray[np.float64]]:
        """Closed lines on the plane at a height: arrays of points (x, y) along the directions of columns and rows from the world's origin, in the unit of the spacing."""
    def mesh(self, simplify: float | None = None) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
        """The closed surface: vertices (x, y, z) in the world (LPS), in the unit of the spacing, and the vertices' numbers of each triangle."""
    def save(
        self,
        *paths: str | PathLike[str],
        mask: bool | None = None,
        distance: bool | None = None,
        contours: bool | None = None,
        simplify: float | None = None,
    ) -> list[Any]:
        """Write files; formats by extension, as on the command line. What is None is as `reconstruct` was told."""
    def update(self, slice: int, mask: NDArray[Any], *, field: bool = False) -> None:
        """Put another mask, or field that is negative inside, in the place of a slice. What depends on it is computed when asked for."""

def _settings(settings: dict[str, Any]) -> Settings: ...
def _names() -> dict[str, list[str]]: ...
def fill(
    labels: NDArray[Any],
    place: dict[str, Any],
    choice: dict[str, Any],
    only: list[int] | None = None,
    own_slices: dict[int, list[int]] | None = None,
    progress: _Progress | None = None,
    base: Settings | None = None,
    preset: str | None = None,
    options: dict[str, Any] | None = None,
) -> tuple[NDArray[Any], dict[str, Any]]: ...
def read_volume(path: str) -> dict[str, Any]: ...
def write_volume(path: str, labels: NDArray[Any], place: dict[str, Any], segments: list[tuple[int, str | None, list[int] | None]]) -> Any: ...
def read_rois(path: str, series: str | None = None) -> list[dict[str, Any]]: ...
def read(path: str, options: dict[str, Any] | None = None) -> Stack: ...
def read_array(array: NDArray[Any], place: dict[str, Any], choice: dict[str, Any]) -> Stack: ...
def stack_of_arrays(slices: Any, lie: dict[str, Any], kind: str, level: float | None) -> Stack: ...
def stack_of_polygons(polygons: Sequence[Sequence[NDArray[np.float64]]], lie: dict[str, Any], pixel: Any) -> Stack: ...
def reconstruct(
    stack: Stack,
    at: list[float] | None = None,
    progress: _Progress | None = None,
    base: Settings | None = None,
    preset: str | None = None,
    options: dict[str, Any] | None = None,
) -> Body: ...
def inspect(stack: Stack) -> str: ...
def evaluate(
    stack: Stack,
    leave: int = 2,
    progress: _Progress | None = None,
    base: Settings | None = None,
    preset: str | None = None,
    options: dict[str, Any] | None = None,
) -> dict[str, Any]: ...
def links(stack: Stack) -> list[dict[str, Any]]: ...
def devices() -> list[dict[str, Any]]:
    """The GPUs of this machine, best first."""
def doctor(adapter: str | None = None) -> list[str]:
    """Test whether a GPU and its driver compute rightly; what was found, in words. Raises GpuError where they do not."""
def command(arguments: list[str]) -> int: ...
