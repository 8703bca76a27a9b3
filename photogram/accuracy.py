"""How good a result is, from points that took no part in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.survey import FloatArray


@dataclass(frozen=True)
class CheckAccuracy:
    """Differences adjusted − surveyed of ``n`` check points, in m: per axis easting, northing, height, in plan and in
    height.

    With Δ the differences: RMSE = sqrt(ΣΔ²/n) per axis, RMSE_H = sqrt(RMSE_E² + RMSE_N²), RMSE_V that of heights
    (ASPRS 2024, Edition 2, sec. 7.11). Not a number where there are no check points.
    """

    n: int
    rmse_m: tuple[float, float, float]
    mean_m: tuple[float, float, float]
    rmse_h_m: float
    rmse_v_m: float


def check_accuracy(difference_map_m: FloatArray) -> CheckAccuracy:
    """Summarise differences adjusted − surveyed (n, 3) of check points in the map frame, m; rows with NaN are left
    out."""
    known = difference_map_m[np.isfinite(difference_map_m).all(axis=1)]
    if not len(known):
        nothing = (float("nan"),) * 3
        return CheckAccuracy(0, nothing, nothing, float("nan"), float("nan"))
    e, n, h = np.sqrt(np.mean(known**2, axis=0)).tolist()
    mean = known.mean(axis=0).tolist()
    return CheckAccuracy(len(known), (e, n, h), (mean[0], mean[1], mean[2]), float(np.hypot(e, n)), h)
