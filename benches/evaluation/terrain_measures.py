"""How near heights are to the truth. Every program is measured by these, over the cells between the lowest and the highest contour height.

A cell that a program leaves without height gets that of the nearest cell that has one; `covered` says how many had one of their own.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt

#: A cell lies outside its band where its height is beyond the band's contours by more than this share of the interval.
SLACK = 0.05
#: A cell lies at a contour's height where it is within this share of the interval of it.
NEAR = 0.05


def filled(heights):
    """Heights with those of the nearest cell where there are none."""
    none = ~np.isfinite(heights)
    if none.all():
        raise ValueError("no cell has a height")
    return heights[tuple(distance_transform_edt(none, return_distances=False, return_indices=True))] if none.any() else heights


def slopes(heights, spacing):
    """arctan |grad h|, degrees, by central differences."""
    return np.degrees(np.arctan(np.hypot(*np.gradient(heights, *spacing))))


def at_contours(heights, levels, interval):
    """Share of heights within NEAR of the interval of a contour's height."""
    return float(np.mean(np.abs(heights[:, None] - levels).min(1) < NEAR * interval))


def measure(truth, heights, levels, interval, spacing):
    """All measures of heights [y, x], by name."""
    levels = np.asarray(levels)
    between = (truth > levels[0]) & (truth < levels[-1])
    found = filled(heights)
    wanted, made = truth[between], found[between]
    off = made - wanted
    band = np.searchsorted(levels, wanted, side="right")
    low, high = levels[band - 1], levels[band]
    outside = (made < low - SLACK * interval) | (made > high + SLACK * interval)
    rmse = float(np.sqrt(np.mean(off**2)))
    return {
        "rmse": rmse,
        "share": rmse / interval,
        "off95": float(np.percentile(np.abs(off), 95)) / interval,
        "slope": float(np.sqrt(np.mean((slopes(found, spacing) - slopes(truth, spacing))[between] ** 2))),
        "outside": 100 * float(outside.mean()),
        "terraces": at_contours(made, levels, interval) / at_contours(wanted, levels, interval),
        "covered": 100 * float(np.isfinite(heights[between]).mean()),
    }
