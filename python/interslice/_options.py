"""Names and types of options. The names are those of the command line; tests/test_settings.py compares them with the module's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict


class SettingsOptions(TypedDict, total=False):
    method: Literal["morph", "field"]
    fair: float
    motion: Literal["field", "rigid", "none"]
    link: Literal["off", "auto"]
    link_reach: float
    links: Sequence[dict[str, Any]]
    anti_alias: Literal["none", "eq6", "kernel"]
    sigma: float
    slope: Literal["linear", "natural", "hyman", "pchip", "catmull"]
    spline_end: Literal["natural", "parabolic", "not-a-knot"] | None
    clamp_bottom: float | None
    clamp_top: float | None
    end_bottom: str
    end_top: str
    cap_gaps: float | None
    sweep: Literal["both", "forward"]
    redistance: int
    cfl: float
    half_width: float
    cut_off: float
    seed_spacing: float
    tolerance: float
    backend: Literal["auto", "gpu", "cpu"]
    adapter: str | int | None
    memory: int | str | None
    gpu_memory: int | str | None


class RunOptions(SettingsOptions, total=False):
    dz: float | None
    isotropic: bool
    mask: bool
    distance: bool
    contours: bool
    simplify: float | None
    units: Literal["m"] | None
    y_up: bool


class ReadOptions(TypedDict, total=False):
    level: float | None
    invert: bool
    label: int | str | None
    roi: str | int | Sequence[str | int]
    series: str | int | None
    pixel: float | None
    elevation: str | None
    z_unit: Literal["m", "ft", "us-ft"] | None
    layer: str | None
    border: str | Sequence[float] | None
    below: Literal["nodata", "constant", "extrapolate"] | None
    crs: str | None
    crs_out: str | None
    keep: int | None
    slices: Sequence[int] | None
