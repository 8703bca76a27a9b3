"""Rough places and shapes of crosses, also of those that are no region of their own: a board's bars that end with it.

The middle of a cross looks the same after half a turn, and whatever surrounds it does not (as
symmetry transforms do, Reisfeld, Wolfson & Yeshurun 1995). The bars are where a star of rays from there is brightest,
or darkest.
"""

from collections.abc import Iterator
from itertools import product

import cv2
import numpy as np

from photogram.arrays import Float32Array, FloatArray
from photogram.marking.targets.initial_values import (
    LEAST_CONTRAST_DN,
    InitialValues,
    line_pairs,
    parameters,
    scored,
)
from photogram.marking.targets.picture import SHAPE, Pattern

RADII_PX = (4.0, 8.0)
"""Radii of the discs that must look the same after half a turn."""
MOST_ASYMMETRY = 0.3
CENTRES = 3
"""How many middles are tried for each radius."""
RAYS = 48
"""Rays in half a turn."""
LEAST_LEAN = 0.3
"""Sine of the angle between two bars at least."""
HALF_WIDTHS_PX = (0.8, 1.3, 2.1, 3.4, 5.5)
OPEN_REACH = 3.0
"""How many half widths of its bars a cross that goes on is scored."""
SHAPES = (0.12, 0.16, 0.22, 0.3)


def cross_initial_values(grey: FloatArray, near: FloatArray, reach_px: float) -> list[InitialValues]:
    """Return starts of crosses in a patch (H, W) whose middle lies at most ``reach_px`` from a rough place (2,)."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.float32)
    angle = np.arange(RAYS) * np.pi / RAYS
    open_ones: list[InitialValues] = []
    for radius in RADII_PX:
        for centre in middles(smooth, near, reach_px, radius):
            thetas = []
            from_centre = np.linspace(0.5, 1.25, 5) * radius
            along = np.concatenate([from_centre, -from_centre])
            for one, other, lean in line_pairs(smooth, centre, angle, along, 0.3 * LEAST_CONTRAST_DN, 3):
                if lean <= LEAST_LEAN:
                    continue
                for half, ratio in product(HALF_WIDTHS_PX, (0.6, 1.0, 1.6)):
                    # columns are where the axes of the target lie; a bar leans, so that it is narrower across
                    axes = np.column_stack([one * half * ratio**0.5, other * half / ratio**0.5]) / lean
                    thetas.append(parameters(centre, np.asarray(np.linalg.inv(axes), np.float64), 1.0))
            if thetas:
                open_ones += scored(grey, Pattern.OPEN_CROSS, thetas, OPEN_REACH).most_promising(0.3, 2)
    closed: list[InitialValues] = []
    for start in open_ones:
        for pattern in (Pattern.CROSS, Pattern.CROSSED_SQUARE):
            closed += scored(grey, pattern, list(_ended(start.theta))).most_promising(0.4, 1)
    return open_ones + closed


def middles(smooth: Float32Array, near: FloatArray, reach_px: float, radius_px: float) -> list[FloatArray]:
    """Return the places (2,) around which a patch (H, W) looks most the same after half a turn."""
    reach, outer = int(np.ceil(reach_px)), int(np.ceil(radius_px))
    u, v = (int(n) for n in np.round(near))
    wide = np.pad(smooth, reach + outer, mode="edge")[v : v + 2 * (reach + outer) + 1, u : u + 2 * (reach + outer) + 1]
    n = 2 * reach + 1
    if wide.shape != (n + 2 * outer, n + 2 * outer):
        return []
    off, total = np.zeros((n, n)), np.zeros((n, n))
    square = np.zeros((n, n))
    step = range(-outer, outer + 1)
    pairs = [(x, y) for x, y in product(step, step) if (y, x) > (0, 0) and x * x + y * y <= radius_px**2]
    for x, y in pairs:
        one = wide[outer + y : outer + y + n, outer + x : outer + x + n]
        other = wide[outer - y : outer - y + n, outer - x : outer - x + n]
        off += (one - other) ** 2
        total += one + other
        square += one**2 + other**2
    variance = square / (2 * len(pairs)) - (total / (2 * len(pairs))) ** 2
    asymmetry = off / len(pairs) / np.maximum(2.0 * variance, 1e-9)
    asymmetry[variance < LEAST_CONTRAST_DN**2 / 4.0] = 1.0
    low = cv2.erode(asymmetry, np.ones((3, 3)))
    rows, columns = np.nonzero((asymmetry <= low) & (asymmetry < MOST_ASYMMETRY))
    apart = np.hypot(rows - reach, columns - reach) / reach
    order = np.argsort(asymmetry[rows, columns] + 0.2 * apart**2)[:CENTRES]
    return [np.array([columns[i] + u - reach, rows[i] + v - reach], np.float64) for i in order]


def _ended(theta: FloatArray) -> Iterator[FloatArray]:
    """Yield the parameters of crosses that end, of one that goes on."""
    for shape in SHAPES:
        ended = theta.copy()
        ended[2:6] *= shape
        ended[SHAPE] = shape
        yield ended
