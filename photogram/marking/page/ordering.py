"""Which photographs of a point are marked first, and when more marks gain nothing."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.languages.said import Figures, Said

ENOUGH_MARKS = 4
"""Marks of a point before more of them may be said to gain nothing: with fewer, no wrong one can be identified."""

LEAST_MARKS = 2
"""Marks of a point that no further photograph shows."""

LEAST_GAIN = 0.25
"""Share of the variance of a point, in the direction that gains most, below which one more mark is not worth it."""

SPREAD_WEIGHT = 0.5
"""What a photograph gains that sees the point from the far side of all before it, relative to 1 for the centre of the
picture."""

_STEP = 1e-4  # of the distance, for differences


def best_first(
    pixel: FloatArray, size_px: FloatArray, azimuth_rad: FloatArray, inside: BoolArray, marked: BoolArray
) -> list[int]:
    """Return the order in which places (K) of a point are shown: marked ones, those inside, those outside a picture;
    among them the nearest to the middle of its picture first, and each next one also for how far around the point it
    looks from those before.

    ``pixel`` (K, 2) is the place, ``size_px`` (K, 2) the width and height of its picture, ``azimuth_rad`` (K,) the
    direction from the point to the photograph.
    """
    off = 2.0 * np.abs((pixel + 0.5) / size_px - 0.5)  # 0 in the middle, 1 at the edge
    central = 1.0 - np.clip(off.max(axis=1), 0.0, 1.0)
    order: list[int] = []
    for group in (marked, inside & ~marked, ~inside & ~marked):
        left = np.flatnonzero(group).tolist()
        while left:
            apart = [_apart(float(azimuth_rad[k]), azimuth_rad[order]) for k in left]
            score = [float(central[k]) + SPREAD_WEIGHT * a for k, a in zip(left, apart, strict=True)]
            order.append(left.pop(int(np.argmax(score))))
    return order


def _apart(azimuth_rad: float, others_rad: FloatArray) -> float:
    """Return how far a direction is from the nearest of others: 0 the same, 1 opposite or without others."""
    if not len(others_rad):
        return 1.0
    turned = np.abs((azimuth_rad - others_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return float(turned.min() / np.pi)


def azimuth_rad(point_world_m: FloatArray, pose: Pose) -> float:
    """Return the direction from a point (3,) to a photograph, clockwise from north."""
    east, north, _ = pose.position_world_m - point_world_m
    return float(np.arctan2(east, north))


def share_gained(
    camera: Camera,
    pose: Pose,
    point_world_m: FloatArray,
    covariance_m2: FloatArray,
    place_covariance_px2: FloatArray,
    mark_sigma_px: float,
) -> float:
    """Return the share of a point's variance that its mark in a photograph would take away, in the direction that it
    takes most of.

    The point (3,) is known with ``covariance_m2`` (3, 3), its place in the photograph with ``place_covariance_px2``
    (2, 2), of which the point is a part and the photograph's own pose the rest. The update of Kalman: with J the
    derivatives of the place, C of the point and Q of the place, J C Jᵀ (Q + σ² I)⁻¹ is what is taken away of the
    place's own variance. NaN where the point does not lie before the photograph.
    """
    step = _STEP * float(np.linalg.norm(pose.position_world_m - point_world_m))
    moved = np.vstack([point_world_m + step * np.eye(3), point_world_m - step * np.eye(3)])
    pixel = project_points(camera, pose, moved)
    J = (pixel[:3] - pixel[3:]).T / (2.0 * step)
    of_point = J @ covariance_m2 @ J.T
    whole = place_covariance_px2 + mark_sigma_px**2 * np.eye(2)
    if not np.isfinite(of_point).all():
        return float("nan")
    return float(min(np.linalg.eigvals(np.linalg.solve(whole, of_point)).real.max(), 1.0))


def is_enough(marks: int, gains: Sequence[float]) -> bool:
    """Return whether marks of a point suffice: none of the further photographs that may show it, ``gains`` of each,
    takes away much of its variance."""
    return marks >= (ENOUGH_MARKS if gains else LEAST_MARKS) and all(not gain > LEAST_GAIN for gain in gains)


def in_words(marks: int, sigma_m: FloatArray | None) -> Said:
    """Return how far a point is: its marks, and the largest of its standard deviations (3,) along the map's axes."""
    if sigma_m is None or not np.isfinite(sigma_m).all():
        return Said.plural("{n} mark", "{n} marks", marks)
    sigma = Figures(length(float(np.max(sigma_m))))
    return Said.plural(
        "{n} mark, sigma of the point {sigma}", "{n} marks, sigma of the point {sigma}", marks, sigma=sigma
    )


def in_short(marks: int, sigma_m: FloatArray | None) -> Said:
    """Return the same for a list."""
    if sigma_m is None or not np.isfinite(sigma_m).all():
        return in_words(marks, None)
    sigma = Figures(length(float(np.max(sigma_m))))
    return Said.plural("{n} mark, sigma {sigma}", "{n} marks, sigma {sigma}", marks, sigma=sigma)


def length(value: float) -> str:
    """Return a small length in two digits: 4 mm, 23 cm, 1.2 m."""
    if value < 0.0995:
        return f"{value * 1000:.2g} mm" if value < 0.00995 else f"{value * 1000:.0f} mm"
    return f"{value * 100:.0f} cm" if value < 0.995 else f"{value:.1f} m"
