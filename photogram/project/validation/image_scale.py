"""Whether marks disagree with GNSS positions because of a common scale of their coordinates, not because of heights.

From above, control that lies too low and rays that are too wide look alike: a wrong focal length and marks that were
measured in pictures of another size give the symptom of two height systems. Each hypothesis has one unknown, and each
is fitted to the same rays with the same robust cost (height_datum): a height shift, a focal length, which scales
coordinates about the principal point, and a picture size, which scales them about the picture's corner.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import unproject
from photogram.project.validation.height_shift import HeightEvidence, Rays, ray_squares, rays_of, robust_cost

Kind = Literal["focal length", "picture size"]

LARGEST_FOCAL_ERROR = 0.35
"""Relative error of a stated focal length that is still plausible: another lens, another crop."""

SMALLEST_PICTURE = 0.1
"""Of marks: the width of their picture over that of the photograph."""

LEAST_ERROR = 0.05
"""Smaller relative errors are those of any lens, or of rounding."""

LEAST_GAIN = 20.0
"""Of the robust cost, half a sum of squares over variances, before a scale is accepted as explanation."""

_STEPS, _FINE_STEPS = 33, 21


@dataclass(frozen=True)
class ScaleFit:
    """A common scale that makes rays and directions agree best.

    ``scale`` is the true focal length over the stated one, or the width of the pictures of the marks over that of the
    photographs. ``cost`` is the robust cost that it leaves, ``cost_without`` that of a scale of 1. ``least`` is the
    relative error from which a scale is more than what lenses, stated sigmas and rounding leave.
    """

    kind: Kind
    scale: float
    cost: float
    cost_without: float
    least: float

    @property
    def significant(self) -> bool:
        """Return whether the scale explains most of what is wrong, and is no small one."""
        gain = self.cost_without - self.cost
        return gain > max(LEAST_GAIN, 0.6 * self.cost_without) and abs(self.scale - 1.0) > self.least


def _scaled_axis(rays: Rays, scale: float) -> Rays:
    """Return the rays of a camera whose focal length is ``scale`` times the stated one."""
    ray = rays.ray / np.array([scale, scale, 1.0])
    return replace(rays, ray=ray / np.linalg.norm(ray, axis=1)[:, None])


def _scaled_pictures(evidence: HeightEvidence, rays: Rays, scale: float) -> Rays:
    """Return the rays of marks that were measured in pictures of ``scale`` times the photographs' size."""
    points = evidence.points
    camera_of = evidence.camera_of[points.mark_photograph[rays.mark]]
    ray = np.empty_like(rays.ray)
    for number, camera in enumerate(evidence.cameras):
        own = camera_of == number
        ray[own] = unproject(camera, (points.mark_pixel[rays.mark[own]] + 0.5) / scale - 0.5)
    return replace(rays, ray=ray)


def _smallest_picture(evidence: HeightEvidence, rays: Rays) -> float:
    """Return the smallest scale of pictures that keeps every mark within its photograph."""
    points = evidence.points
    sizes = np.array([[camera.width_px, camera.height_px] for camera in evidence.cameras], dtype=np.float64)
    size = sizes[evidence.camera_of[points.mark_photograph[rays.mark]]]
    return max(SMALLEST_PICTURE, float(((points.mark_pixel[rays.mark] + 0.5) / size).max()))


def _best(cost: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return the scale between ``low`` and ``high`` that costs least, and its cost: on a grid, then between."""
    grid = np.geomspace(low, high, _STEPS)
    best = int(np.argmin([cost(scale) for scale in grid]))
    fine = np.geomspace(grid[max(best - 1, 0)], grid[min(best + 1, _STEPS - 1)], _FINE_STEPS)
    costs = [cost(scale) for scale in fine]
    return float(fine[int(np.argmin(costs))]), float(min(costs))


def fit_scales(evidence: HeightEvidence, shifts_m: FloatArray) -> list[ScaleFit]:
    """Return the fits of a focal length and of a picture size, the better one first; none where too few points are
    marked, or the marks fill their photographs so far that no other picture size is possible.

    ``shifts_m`` (S,) are the height shifts that are left open to each of them: zero alone where GNSS heights are sure,
    else as far as they may be off; a focal length is then not determined beside them, and not fitted. Raises ImageError
    as unproject does.
    """
    rays = rays_of(evidence)
    if rays is None:
        return []

    def cost_of(changed: Rays) -> float:
        return float(robust_cost(ray_squares(changed, shifts_m)).min())

    without, fits = cost_of(rays), []
    if len(shifts_m) == 1:
        low, high = 1.0 / (1.0 + LARGEST_FOCAL_ERROR), 1.0 / (1.0 - LARGEST_FOCAL_ERROR)
        best = _best(lambda s: cost_of(_scaled_axis(rays, s)), low, high)
        share = max(min(c.sigmas[0] / c.focal_px, 0.1) for c in evidence.cameras)
        if low < best[0] < high:  # at an end of the range the error is larger than plausible
            fits.append(ScaleFit("focal length", *best, without, max(LEAST_ERROR, 3.0 * share)))
    low = _smallest_picture(evidence, rays)
    if low < 1.0 - LEAST_ERROR:
        best = _best(lambda s: cost_of(_scaled_pictures(evidence, rays, s)), low, 1.0)
        fits.append(ScaleFit("picture size", *best, without, LEAST_ERROR))
    return sorted(fits, key=lambda fit: fit.cost)
