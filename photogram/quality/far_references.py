"""References that lie far from the clouds compared with them: how far, in words, and what distances are measured to.

The nearest point of ground far below has so many rivals that a search among all of them takes minutes: as many as lie
within √(2 D h) of the plumb line, for a height D and a relief h.
"""

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.survey import PointCloud

FAR_SPACINGS = 20.0
"""Spacings of a reference beyond which it lies far off."""

THINNED = 0.05
"""Side of the cells of which one point is left, in distances: by even ground a distance changes by 0.3 % at most."""

KILOMETRES_M = 10_000.0
"""Distance from which one is said in kilometres."""

_NAMES = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
BESIDE_REMEDY = "check its CRS and unit, the order of its coordinates, and whether a local origin was taken off it"
ABOVE_REMEDY = "check its height system (comparison.heights), its unit, and that of the control points"


def extent_of(points_map_m: FloatArray) -> FloatArray:
    """Return the lowest and highest coordinates (2, K) of points (N, K), NaN left out."""
    return np.stack([np.nanmin(points_map_m, axis=0), np.nanmax(points_map_m, axis=0)])


def beside(reference_m: FloatArray, survey_m: FloatArray) -> str:
    """Return in words how far the extent of a reference (2, 2 or more) lies beside that of a survey in plan; empty
    where they overlap."""
    gap = np.maximum(reference_m[0, :2] - survey_m[1, :2], 0.0) - np.maximum(survey_m[0, :2] - reference_m[1, :2], 0.0)
    if not gap.any():
        return ""
    name = _NAMES[round(float(np.arctan2(*gap)) / (np.pi / 4)) % 8]
    distance_m = float(np.linalg.norm(gap))
    distance = f"{distance_m:.0f} m" if distance_m < KILOMETRES_M else f"{distance_m / 1000:.0f} km"
    return f"it lies {distance} {name} of the survey"


def above(height_m: float) -> str:
    """Return in words that a reference lies so far above the survey, or below where negative."""
    return f"it lies {abs(height_m):.1f} m {'above' if height_m > 0 else 'below'} the survey"


def is_far(offset_m: float, scatter_m: float, spacing_m: float) -> bool:
    """Return whether a reference lies far off in height: beyond its spacing and what heights scatter by."""
    return abs(offset_m) > max(FAR_SPACINGS * spacing_m, 10.0 * scatter_m)


def spacing_of(points_map_m: FloatArray) -> float:
    """Return the mean spacing in m of points (N, 3) in plan, as if they filled their extent."""
    return float(np.sqrt(np.prod(np.ptp(points_map_m[:, :2], axis=0)) / len(points_map_m)))


def thinned(reference: PointCloud, offset_m: float) -> PointCloud:
    """Return of a reference the point of each cell that a cloud ``offset_m`` above it, below where negative, is
    nearest to: the highest, or the lowest."""
    points = reference.position_map_m
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / (THINNED * abs(offset_m))).astype(np.int64)
    key = cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]
    order = np.lexsort((-np.sign(offset_m) * points[:, 2], key))
    first: BoolArray = np.append(True, np.diff(key[order]) > 0)
    return PointCloud(points[order[first]])
