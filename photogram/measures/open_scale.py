"""The scale of a block whose attitudes are measured, and whose positions scatter by more than it is wide.

With heading and tilt known, positions are linear in the scale, and the one that fits them best may be zero or less: the
block shrinks to a point, and nothing is determined. But a scale is positive: of the normal distribution N(s, σ²) that
positions give it, what is below zero is cut off. What that adds is an observation of the scale which, with the
positions, has the mean and the variance of the truncated distribution (moments matched as in expectation propagation,
Minka 2001).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from photogram.arrays import FloatArray
from photogram.survey import Block

SURE = 3.0
"""Standard deviations above zero, from which nothing of the distribution is cut off."""
_PLACING = 3  # control points, or positions


@dataclass(frozen=True)
class OpenScale:
    """What keeps an open scale positive: the distance between the photographs ``first`` and ``last``, m."""

    first: int
    last: int
    distance_m: float
    sigma_m: float


def positive_scale(scale: float, sigma: float) -> tuple[float, float]:
    """Return the observation, and its standard deviation, that with another of ``scale`` and ``sigma`` has the moments
    of that one's normal distribution above zero."""
    a = scale / sigma
    hazard = float(np.exp(-0.5 * a * a - log_ndtr(a))) / np.sqrt(2.0 * np.pi)
    mean, variance = sigma * (a + hazard), sigma**2 * (1.0 - hazard * (a + hazard))
    added = 1.0 / (1.0 / variance - 1.0 / sigma**2)
    return added * (mean / variance - scale / sigma**2), float(np.sqrt(added))


def _scale_by_positions(centre_m: FloatArray, gnss_m: FloatArray, sigma_m: FloatArray) -> tuple[float, float]:
    """Return by how much projection centres (N, 3) are to be enlarged to fit positions (N, 3), and its sigma."""
    weight = 1.0 / sigma_m**2
    p, q = (x - np.sum(weight * x, axis=0) / weight.sum(axis=0) for x in (centre_m, gnss_m))
    information = float(np.sum(weight * p * p))
    return float(np.sum(weight * p * q)) / information, 1.0 / float(np.sqrt(information))


def open_scale(block: Block) -> OpenScale | None:
    """Return what keeps the scale of a block positive, all of whose photographs are oriented and which no distance
    scales; None where control points or positions tell it, or attitudes do not hold its heading."""
    points = block.control_points.fully_controlled()
    marked = np.unique(points.mark_point[np.isfinite(points.mark_sigma_px)])
    attitudes = sum(p.attitude_world_from_camera is not None for p in block.photographs)
    known = [i for i, p in enumerate(block.photographs) if p.gnss_world_m is not None]
    if len(known) < _PLACING or len(marked) >= _PLACING or attitudes < 2:
        return None
    centre_m = np.array([pose.position_world_m for pose in block.poses if pose is not None])
    gnss_m, sigma_m = (
        np.array([getattr(block.photographs[i], name) for i in known]) for name in ("gnss_world_m", "gnss_sigma_m")
    )
    scale, sigma = _scale_by_positions(centre_m[known], gnss_m, sigma_m)
    if scale > SURE * sigma:
        return None
    first = int(np.argmin(np.linalg.norm(centre_m - np.median(centre_m, axis=0), axis=1)))
    length_m = np.linalg.norm(centre_m - centre_m[first], axis=1)
    last = int(np.argmax(length_m))
    observed, its_sigma = positive_scale(scale, sigma)
    return OpenScale(first, last, observed * float(length_m[last]), its_sigma * float(length_m[last]))
