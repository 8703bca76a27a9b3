"""Profiles through a dense surface: where they are laid, and what they hold.

Lines are chosen on a coarse copy of the surface, and sampled on the surface itself.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import correlate1d, uniform_filter, uniform_filter1d

from photogram.arrays import Float32Array, FloatArray
from photogram.grid import decimated, known_cells_map_m
from photogram.report.numbers.dense_surface import DenseSurface, GroundMarks, Sampled, sampled
from photogram.survey import Raster

COARSE_CELLS = 500
"""Cells of the copy of the surface on which lines are chosen, along its longer side, at most."""
SAMPLES = 1000
"""Parts into which a profile is cut, at most."""
SHIFT_SHARE = 0.25
"""A line may leave the middle by this share of the site's width, to pass through a check point."""
NEAR_SHARE = 0.01
"""Check points within this share of a line's length, and two cells at least, are drawn beside it."""
BOX_SHARE, BOX_M = 0.015, 2.5
"""Largest side of the two flat places on either side of a step: in parts of the site's longer side, and in m."""
BOX_SPACING = 1.8
"""From the middle of one place to that of the other, in their sides: an edge that runs askew finds room between."""
STEP_SIGMAS, STEP_CELLS = 10.0, 4.0
"""What a step must exceed, in predicted sigmas and in cells, to be worth a profile."""
ROUGHNESS = 8.0
"""How many times a step must exceed the standard deviations of both sides about their planes."""
STEP_REACH = 12
"""A profile across a step reaches so many of its places to either side."""


@dataclass(frozen=True, eq=False)
class ProfileLine:
    """A straight line in the map from ``start_map_m`` to ``end_map_m`` (2,), its letter, and what it shows."""

    letter: str
    why: str
    start_map_m: FloatArray
    end_map_m: FloatArray

    @property
    def length_m(self) -> float:
        """Return its length in m."""
        return float(np.hypot(*(self.end_map_m - self.start_map_m)))

    @property
    def direction(self) -> FloatArray:
        """Return its unit vector (2,): east, north."""
        return np.asarray((self.end_map_m - self.start_map_m) / self.length_m)

    def along_and_across_m(self, places_map_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances (N,) from the start along the line, and offsets (N,) to its left, of places (N, 2)."""
        rest, (east, north) = places_map_m[:, :2] - self.start_map_m, self.direction
        return rest @ self.direction, rest @ np.array([-north, east])


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights and their standard deviations (N,) along a line at distances (N,), m, NaN in gaps; and the check points
    beside it: their distances (K,) along the line, and how much higher (K,) the surface is at their own places than
    they were surveyed, NaN over a hole."""

    line: ProfileLine
    distance_m: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray
    check_points: GroundMarks
    check_distance_m: FloatArray
    check_difference_m: FloatArray


def surface_profiles(dense: DenseSurface, ground: GroundMarks) -> list[Profile]:
    """Return the profiles of a dense surface: along the longest axis of the site, across it, and over the sharpest step
    between two flat places, where there is one.

    The first two go through the check point nearest to the middle, where one is near it. Empty where fewer than three
    coarse cells hold a height.
    """
    measured = np.isfinite(dense.heights.values)
    measured &= ~dense.filled
    coarse, share = decimated(dense.heights, COARSE_CELLS, measured)
    heights = replace(coarse, values=np.where(share >= 0.5, coarse.values, np.nan).astype(np.float32))
    if np.isfinite(heights.values).sum() < 3:
        return []
    lines = site_lines(heights, ground.place_map_m[ground.checks_height, :2])
    known = dense.sigma.values[:: max(1, dense.sigma.values.shape[0] // COARSE_CELLS)]
    noise_m = float(np.nanmedian(known)) if np.isfinite(known).any() else 0.0
    step = step_line(heights, max(STEP_CELLS * dense.cell_m, STEP_SIGMAS * noise_m))
    return [profile(dense, line, ground) for line in [*lines, *([] if step is None else [step])]]


def site_lines(heights: Raster, checks_map_m: FloatArray) -> list[ProfileLine]:
    """Return a line along the longer side of the smallest rectangle around the cells with data, and one across it."""
    centres = known_cells_map_m(heights)[:, :2]
    middle = centres.mean(axis=0)
    corner = cv2.boxPoints(cv2.minAreaRect((centres - middle).astype(np.float32))).astype(np.float64)
    longest = max(corner[1] - corner[0], corner[2] - corner[1], key=lambda side: float(np.hypot(*side)))
    longest = longest / np.hypot(*longest)
    across = np.array([longest[1], -longest[0]])
    lines = []
    for letter, axis, why in (("A", longest, "along the site"), ("B", across, "across the site")):
        direction = _as_read(axis)
        through = _through_a_check(centres, middle, direction, checks_map_m)
        line = _clipped(letter, why, centres, through, direction, heights.cell_m)
        if line is not None:
            lines.append(line)
    return lines


def _as_read(direction: FloatArray) -> FloatArray:
    """Return a direction (2,) or its opposite: towards the east or the south."""
    return direction if direction[0] - direction[1] > 0 else -direction


def _through_a_check(
    centres: FloatArray, middle: FloatArray, direction: FloatArray, checks_map_m: FloatArray
) -> FloatArray:
    """Return a place of the line: the check point nearest to the line through the middle, or the middle where none lies
    within SHIFT_SHARE of the width."""
    normal = np.array([-direction[1], direction[0]])
    width_m = float(np.ptp(centres @ normal))
    offset_m = np.abs((checks_map_m - middle) @ normal)
    if len(offset_m) and offset_m.min() <= SHIFT_SHARE * width_m:
        return np.asarray(checks_map_m[np.argmin(offset_m)])
    return middle


def _clipped(
    letter: str, why: str, centres: FloatArray, through: FloatArray, direction: FloatArray, cell_m: float
) -> ProfileLine | None:
    """Return the line from the first to the last cell with data that it meets, None where it meets fewer than two."""
    rest = centres - through
    on_line = np.abs(rest @ np.array([-direction[1], direction[0]])) <= cell_m
    along = rest[on_line] @ direction
    if len(along) < 2 or not np.ptp(along) > 0:
        return None
    return ProfileLine(letter, why, through + along.min() * direction, through + along.max() * direction)


def step_line(heights: Raster, least_m: float) -> ProfileLine | None:
    """Return the line across the sharpest step between two flat places, such as the edge of a roof over a yard.

    On either side of each cell, along the rows, the columns and the diagonals, stand two squares, each with a plane of
    least squares and a standard deviation s about it. A step is by how much the planes miss each other in the middle,
    which a slope does not. Of the steps beyond ``least_m`` it is the one that is the most times
    s₁ + s₂ + least_m / STEP_SIGMAS: a roof is, the crown of a tree is not, however high. None where none is ROUGHNESS
    times that.
    """
    cell_m, shape = heights.cell_m, heights.values.shape
    box = int(np.clip(round(min(BOX_SHARE * max(shape), BOX_M / cell_m)), 3, 40))
    mean, slope, spread = _planes(heights.values, box)
    best, place = ROUGHNESS, None
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        reach = round(BOX_SPACING * box / np.hypot(down, right))
        first, second = _shifted(shape, reach * down, reach * right)
        if mean[first].size == 0:
            continue
        to_middle = 0.5 * reach * (down * slope[0] + right * slope[1])
        step = np.abs(mean[second] - to_middle[second] - mean[first] - to_middle[first])
        times = step / (spread[first] + spread[second] + least_m / STEP_SIGMAS)
        times = np.where(step > least_m, times, 0.0)  # where nothing is known neither
        if times.max() > best:
            best = float(times.max())
            row, column = np.unravel_index(np.argmax(times), times.shape)
            corner = np.array([row + first[0].start, column + first[1].start])
            place = corner + 0.5 * reach * np.array([down, right]), np.array([right, -down], dtype=np.float64)
    if place is None:
        return None
    (south, east), direction = place
    middle = np.array([heights.west_map_m + (east + 0.5) * cell_m, heights.north_map_m - (south + 0.5) * cell_m])
    direction = _as_read(direction / np.hypot(*direction))
    centres = known_cells_map_m(heights)[:, :2]
    near = np.abs((centres - middle) @ direction) <= STEP_REACH * box * cell_m
    return _clipped("C", "over a sharp edge", centres[near], middle, direction, cell_m)


def _shifted(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return slices of all cells that have another one so many rows down and columns to the right, and of these."""

    def pair(length: int, shift: int) -> tuple[slice, slice]:
        one, other = slice(max(0, -shift), length - max(0, shift)), slice(max(0, shift), length - max(0, -shift))
        return one, other

    rows, columns = pair(shape[0], down), pair(shape[1], right)
    return (rows[0], columns[0]), (rows[1], columns[1])


def _planes(values: Float32Array, box: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for the squares of ``box`` cells around each their mean, the slopes (2, rows, columns) of the plane of
    least squares per row and per column, and the standard deviation about it; NaN where a cell of it is unknown.

    By moments: with the variance v = (n² − 1) / 12 of n rows, a slope is cov(h, x) / v, and the variance that is left
    var(h) − (cov(h, x)² + cov(h, y)²) / v.
    """
    known = np.isfinite(values)
    base = float(np.mean(values[known], dtype=np.float64))
    centred = np.where(known, values - base, 0.0).astype(np.float64)
    share, first, second = (
        uniform_filter(v, box, mode="constant") for v in (known.astype(np.float64), centred, centred**2)
    )
    ramp, variance = (np.arange(box) - (box - 1) / 2) / box, (box**2 - 1.0) / 12.0
    covariance = np.stack(
        [
            correlate1d(uniform_filter1d(centred, box, 1 - axis, mode="constant"), ramp, axis, mode="constant")
            for axis in (0, 1)
        ]
    )
    spread = np.sqrt(np.maximum(second - first**2 - np.sum(covariance**2, axis=0) / variance, 0.0))
    full = share > 1.0 - 0.5 / box**2
    return tuple(np.where(full, v, np.nan) for v in (first + base, covariance / variance, spread))  # type: ignore[return-value]


def profile(dense: DenseSurface, line: ProfileLine, ground: GroundMarks) -> Profile:
    """Sample a line at every cell, in SAMPLES equal steps at most, and find the check points beside it.

    The profile begins and ends where there is a surface.
    """
    count = int(np.clip(np.ceil(line.length_m / dense.cell_m), 2, SAMPLES)) + 1
    distance_m = np.linspace(0.0, line.length_m, count)
    at = sampled(dense, line.start_map_m + distance_m[:, None] * line.direction)
    known = np.flatnonzero(np.isfinite(at.height_m))
    if len(known) > 1:
        inner = slice(int(known[0]), int(known[-1]) + 1)
        ends = line.start_map_m + distance_m[known[[0, -1]], None] * line.direction
        line = replace(line, start_map_m=ends[0], end_map_m=ends[1])
        distance_m = distance_m[inner] - distance_m[inner][0]
        at = Sampled(at.height_m[inner], at.slope[inner], at.sigma_m[inner], at.inside[inner], at.filled[inner])
    checks = ground.select(ground.checks_height)
    along, offset = line.along_and_across_m(checks.place_map_m)
    near_m = max(NEAR_SHARE * line.length_m, 2.0 * dense.cell_m)
    near = np.flatnonzero((np.abs(offset) <= near_m) & (along >= 0) & (along <= line.length_m))
    checks = checks.select(near)
    difference_m = sampled(dense, checks.place_map_m).height_m - checks.place_map_m[:, 2]
    return Profile(line, distance_m, at.height_m, at.sigma_m, checks, along[near], difference_m)
