"""How good a result is, from points that took no part in it, and which measurement does not fit the rest."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import norm

from photogram.adjustment.reliability import CRITICAL
from photogram.arrays import FloatArray
from photogram.measures.mark_covariances import lower_factors
from photogram.quality.asprs import AXES
from photogram.results import Adjustment


@dataclass(frozen=True)
class CheckAccuracy:
    """Differences adjusted − surveyed of ``n`` check points, in m: per axis easting, northing, height, in plan and in
    height.

    ``n_axis`` of them test each axis: a point may be a check in plan or in height alone. With Δ the differences: RMSE =
    sqrt(ΣΔ²/n) per axis, RMSE_H = sqrt(RMSE_E² + RMSE_N²), RMSE_V that of heights (ASPRS 2024, Edition 2, sec. 7.11).
    Not a number where there are no check points.
    """

    n: int
    n_axis: tuple[int, int, int]
    rmse_m: tuple[float, float, float]
    mean_m: tuple[float, float, float]
    rmse_h_m: float
    rmse_v_m: float


def check_accuracy(difference_map_m: FloatArray) -> CheckAccuracy:
    """Summarise differences adjusted − surveyed (n, 3) of check points along easting, northing and height of the map,
    in m; NaN is left out, and without any the figures are NaN."""
    known = np.isfinite(difference_map_m)
    count = known.sum(axis=0)
    total = np.where(count > 0, count, np.nan)
    difference = np.where(known, difference_map_m, 0.0)
    e, n, h = np.sqrt(np.sum(difference**2, axis=0) / total).tolist()
    mean = (difference.sum(axis=0) / total).tolist()
    axes = count.tolist()
    return CheckAccuracy(
        int(known.any(axis=1).sum()), (axes[0], axes[1], axes[2]), (e, n, h), (mean[0], mean[1], mean[2]),
        float(np.hypot(e, n)), h,
    )  # fmt: skip


FALSE_ALARMS = 0.002  # of surveys without a blunder, in which something is suspected all the same
Kind = Literal["control point", "mark", "GNSS position"]


@dataclass(frozen=True)
class Suspect:
    """A measurement that everything else contradicts.

    ``axis`` of the map, or of the photograph for a mark; ``w`` its test, standard normal without blunders; ``off`` by
    how much everything else disagrees with it, predicted minus measured, in m, for a mark in px.
    """

    kind: Kind
    name: str
    axis: str
    w: float
    off: float

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        unit = "px" if self.kind == "mark" else "m"
        sigma = abs(self.w)
        return (
            f"{self.kind} {self.name}, {self.axis}: all other observations predict {self.off:+.3f} {unit} "
            "from what was "
            f"measured, {sigma:.1f} sigma"
        )


def suspects(result: Adjustment) -> list[Suspect]:
    """Return the measurements that everything else contradicts, the worst first (data snooping; Baarda 1968).

    The limit of |w| is that which keeps false alarms among all tests together at FALSE_ALARMS. One blunder spreads to
    its neighbours: only the first is named with confidence, the others may be its effect.
    """
    r = result.tests.reliability
    points = result.block.control_points
    photographs = result.block.photographs
    tests = [r.ground_w, r.mark_w, r.gnss_w]
    count = sum(int(np.isfinite(w).sum()) for w in tests)
    if not count:
        return []
    limit = max(CRITICAL, float(norm.isf(FALSE_ALARMS / (2.0 * count))))
    suspected: list[Suspect] = []

    def add(kind: Kind, name: str, axis: str, sigma: float, redundancy: float, w: float) -> None:
        suspected.append(Suspect(kind, name, axis, float(w), float(w * sigma / np.sqrt(redundancy))))

    for g, axis in np.argwhere(np.abs(r.ground_w) > limit).tolist():
        sigma = points.sigma_m[g, axis]
        add("control point", points.name[g], AXES[axis], sigma, r.ground_redundancy[g, axis], r.ground_w[g, axis])
    for m, axis in np.argwhere(np.abs(r.mark_w) > limit).tolist():
        name = f"of {points.name[points.mark_point[m]]} in {photographs[points.mark_photograph[m]].name}"
        sigma_px = lower_factors(points.mark_covariance_px2[m][None])[0, axis, axis]
        add("mark", name, "uv"[axis], sigma_px, r.mark_redundancy[m, axis], r.mark_w[m, axis])
    for i, axis in np.argwhere(np.abs(r.gnss_w) > limit).tolist():
        sigma_m = photographs[i].gnss_sigma_m
        if sigma_m is not None:
            name = photographs[i].name
            add("GNSS position", name, AXES[axis], sigma_m[axis], r.gnss_redundancy[i, axis], r.gnss_w[i, axis])
    return sorted(suspected, key=lambda s: -abs(s.w))
