"""Dense heights of steep ground beside their truth, by the slope of the truth, and the volumes of heaps.

All is judged in cells that three photographs see. A cell's slope is that of the true surface over the cell. A cell
steeper than WALL_DEG is a wall; walls and the cells beside them stand in a row of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import binary_dilation

from lib.dense_scores import PHOTOGRAPHS, on_grid
from lib.dense_truth import Truth, centres_map_m
from lib.simulated.steep_site import Heap
from photogram.arrays import BoolArray, FloatArray, nmad
from photogram.geodesy.frames import LocalFrame
from photogram.survey import Raster

CLASSES_DEG = (0.0, 15.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
WALL_DEG = 85.0
BAD_GSD, GROSS_GSD = 3.0, 10.0
WALLS = "walls and the cells beside them"
AROUND_M = 1.0  # of a heap's foot, over which its volume is taken


@dataclass(frozen=True)
class SlopeScores:
    """Heights of the cells of a class: their number, the share with a height, errors of these; of errors over their
    standard deviations the shares within 1, 2 and 3, NaN without."""

    name: str
    cells: int
    completeness: float
    bad: float
    gross: float
    nmad_gsd: float
    within: tuple[float, float, float]


def true_slope_deg(truth: Truth) -> FloatArray:
    """Return the slope (rows, columns) of the true surface over each cell, from the middles of its sides."""
    centre, half = centres_map_m(truth.grid), truth.grid.cell_m / 2.0
    rise = [
        truth.height_at(centre + np.array(step)) - truth.height_at(centre - np.array(step))
        for step in ((half, 0.0), (0.0, half))
    ]
    slope = np.degrees(np.arctan(np.hypot(*rise) / truth.grid.cell_m))
    return np.asarray(slope).reshape(truth.height_map_m.shape)


def slope_classes(slope_deg: FloatArray) -> dict[str, BoolArray]:
    """Return masks (rows, columns) that share no cell: classes of slope, and walls with what lies beside them."""
    wall = binary_dilation(np.nan_to_num(slope_deg) > WALL_DEG, np.ones((3, 3), bool))
    classes = {
        f"{low:.0f} to {high:.0f}°": (slope_deg >= low) & (slope_deg < high) & ~wall
        for low, high in pairwise(CLASSES_DEG)
    }
    return {**classes, WALLS: wall}


def steep_scores(heights: Raster, sigma: Raster | None, truth: Truth) -> list[SlopeScores]:
    """Return the scores of heights, and of their own standard deviations where given, by class."""
    values = on_grid(heights, truth.grid)
    own = np.full(values.shape, np.nan) if sigma is None else on_grid(sigma, truth.grid)
    seen = (truth.seen >= PHOTOGRAPHS) & np.isfinite(truth.height_map_m)
    rows = []
    for name, cells in slope_classes(true_slope_deg(truth)).items():
        asked = seen & cells
        there = asked & np.isfinite(values)
        if not there.any():
            continue
        error = values[there] - truth.height_map_m[there]
        ratio = np.abs(error) / own[there]
        known = ratio[np.isfinite(ratio)]
        one, two, three = (float(np.mean(known <= k)) if len(known) else float("nan") for k in (1.0, 2.0, 3.0))
        rows.append(
            SlopeScores(
                name,
                int(asked.sum()),
                float(there.sum() / asked.sum()),
                float(np.mean(np.abs(error) > BAD_GSD * truth.gsd_m)),
                float(np.mean(np.abs(error) > GROSS_GSD * truth.gsd_m)),
                nmad(error) / truth.gsd_m,
                (one, two, three),
            )
        )
    return rows


def volume_errors(heights: Raster, truth: Truth, heaps: Sequence[Heap], frame: LocalFrame) -> list[tuple[Heap, float]]:
    """Return by which share of its volume each heap comes out too large, of those whose cells all have heights but for
    one in a hundred, which count as true."""
    difference = on_grid(heights, truth.grid) - truth.height_map_m
    place = centres_map_m(truth.grid).reshape(*difference.shape, 2)
    errors = []
    for heap in heaps:
        middle = frame.map_from_world(np.array([[heap.east_m, heap.north_m, 0.0]]))[0, :2]
        over = np.linalg.norm(place - middle, axis=-1) < heap.foot_m + AROUND_M
        there = over & np.isfinite(difference)
        if over.any() and there.sum() >= 0.99 * over.sum():
            errors.append((heap, float(difference[there].sum() * truth.grid.cell_m**2 / heap.volume_m3)))
    return errors
