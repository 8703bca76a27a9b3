"""Where an orthophoto shows a target that was marked in photographs.

The neighbourhood of a mark is resampled onto the cells of the orthophoto, so that the mark lies in the middle: this is
what the orthophoto should show around the target, whatever the target looks like. The place where it correlates best is
where the orthophoto shows it (normalised cross-correlation, Lewis 1995, with a parabola through its peak). Surveyed
coordinates are not used. A target is found only where the correlation is high and has one peak, which an edge has not,
and where most of its marks agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.geodesy.frames import LocalFrame

GreyImage = Float32Array
TEMPLATE_CELLS = 7
"""Half of the side of what is looked for, in cells of the orthophoto."""
REACH_CELLS = 6
"""How far from where the marks intersect a target is looked for."""
LEAST_CORRELATION = 0.8
LEAST_CONTRAST_DN = 6.0
"""Standard deviation of the grey values around a mark below which there is no target to be found."""
RIVAL = 0.9
"""Share of the highest correlation that another peak may reach."""
APART_CELLS = 3
"""From where on it is another peak."""
AGREE_CELLS = 1.0
"""How far from their median the places that single marks give may lie."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A mark: grey values (H, W) of its photograph, camera, pose, and the mark (2,) itself, px."""

    grey: ByteArray
    camera: Camera
    pose: Pose
    pixel: FloatArray


@dataclass(frozen=True, eq=False)
class LocatedTarget:
    """A target in an orthophoto: easting and northing (2,), the median correlation, and of how many marks."""

    place_map_m: FloatArray
    correlation: float
    marks: int


def target_window_cells() -> int:
    """Return the side of the part of an orthophoto, around a target, that is searched."""
    return 2 * (TEMPLATE_CELLS + REACH_CELLS) + 1


def find_target(
    orthophoto: ByteArray, centre_map_m: FloatArray, cell_m: float, neighbourhoods: Sequence[GreyImage]
) -> LocatedTarget | str:
    """Return where an orthophoto shows a target, or why it was not found there.

    ``orthophoto`` (n, n, 4), red, green, blue, alpha, n as of target_window_cells, are the cells around the one whose
    centre is ``centre_map_m`` (2 or 3,), the target's approximate place; ``neighbourhoods`` those of its marks.
    """
    if not neighbourhoods:
        return "none of its marks has a neighbourhood"
    if not (orthophoto[..., 3] > 0).all():
        return "the orthophoto does not show all of its neighbourhood"
    grey = cv2.cvtColor(np.ascontiguousarray(orthophoto[..., :3]), cv2.COLOR_RGB2GRAY).astype(np.float32)
    peaks = [_peak(grey, template) for template in neighbourhoods]
    certain = [peak for peak in peaks if not isinstance(peak, str)]
    if not certain:
        return next(peak for peak in peaks if isinstance(peak, str))
    middle = np.median([place for place, _ in certain], axis=0)
    agree = [(place, score) for place, score in certain if float(np.max(np.abs(place - middle))) <= AGREE_CELLS]
    if 2 * len(agree) <= len(peaks):
        return "its marks do not agree on a place"
    off = np.mean([place for place, _ in agree], axis=0)
    place_map_m = centre_map_m[:2] + cell_m * off * np.array([1.0, -1.0])
    return LocatedTarget(place_map_m, float(np.median([score for _, score in agree])), len(agree))


def mark_neighbourhood(mark: Mark, centre_map_m: FloatArray, cell_m: float, frame: LocalFrame) -> GreyImage | None:
    """Return the neighbourhood (m, m) of a mark on cells of the map, with the mark in the middle, None beyond the
    border of the photograph. ``centre_map_m`` (3,) is the target's approximate place; the ground is taken as level."""
    step = cell_m * np.arange(-TEMPLATE_CELLS, TEMPLATE_CELLS + 1)
    east, north = np.meshgrid(step, -step)
    place = centre_map_m + np.stack([east, north, np.zeros_like(east)], axis=-1).reshape(-1, 3)
    pixel = project_points(mark.camera, mark.pose, frame.world_from_map(place))
    pixel += mark.pixel - pixel[len(pixel) // 2]
    if not np.isfinite(pixel).all():
        return None
    height, width = mark.grey.shape
    low, high = np.floor(pixel.min(axis=0)).astype(int) - 4, np.ceil(pixel.max(axis=0)).astype(int) + 5
    if (low < 0).any() or high[0] > width or high[1] > height:
        return None
    crop = mark.grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    side = pixel.reshape(*east.shape, 2)
    pixels_a_cell = float(np.linalg.norm(side[-1, -1] - side[0, 0]) / np.linalg.norm([2 * TEMPLATE_CELLS] * 2))
    if pixels_a_cell > 1.0:  # a cell of the orthophoto is the mean of its pixels
        crop = cv2.GaussianBlur(crop, (0, 0), 0.5 * float(np.sqrt(pixels_a_cell**2 - 1.0)) + 1e-3)
    local = (side - low).astype(np.float32)
    return np.asarray(cv2.remap(crop, local[..., 0], local[..., 1], cv2.INTER_CUBIC), np.float32)


def _peak(grey: GreyImage, template: GreyImage) -> tuple[FloatArray, float] | str:
    """Return where a template lies in an orthophoto, cells to the right and down from the middle, and how well it
    correlates; or why that is not certain."""
    if float(template.std()) < LEAST_CONTRAST_DN:
        return "there is no contrast around its mark"
    score = np.asarray(cv2.matchTemplate(grey, template, cv2.TM_CCOEFF_NORMED), np.float64)
    row, column = (int(i) for i in np.unravel_index(np.argmax(score), score.shape))
    best = float(score[row, column])
    if best < LEAST_CORRELATION:
        return f"nothing around its place looks like it (correlation {best:.2f})"
    if not (0 < row < score.shape[0] - 1 and 0 < column < score.shape[1] - 1):
        return f"what looks like it lies {REACH_CELLS} cells away or more"
    rows, columns = np.indices(score.shape)
    other = score[np.maximum(np.abs(rows - row), np.abs(columns - column)) >= APART_CELLS]
    if other.size and float(other.max()) > RIVAL * best:
        return "several places look like it"
    around = score[row - 1 : row + 2, column - 1 : column + 2]
    slope = 0.5 * np.array([around[1, 2] - around[1, 0], around[2, 1] - around[0, 1]])
    across = 0.25 * (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0])
    curvature = np.array(
        [
            [around[1, 2] - 2.0 * best + around[1, 0], across],
            [across, around[2, 1] - 2.0 * best + around[0, 1]],
        ]
    )
    if not float(np.linalg.eigvalsh(-curvature)[0]) > 0.0:
        return "several places look like it"
    sub = np.clip(-np.linalg.solve(curvature, slope), -1.0, 1.0)
    middle = (np.array(score.shape)[::-1] - 1) / 2.0
    return np.array([column, row]) + sub - middle, best
