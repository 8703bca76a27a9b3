"""Whether a result is as good as it says: points that took no part, and points left out one by one, against the
predicted covariances.

The errors of check points are correlated, since all of them were intersected from the same photographs; they are tested
together under their joint covariance, to which the survey of the check points adds its own. Under the same covariance
all others predict each of them, so that a check point whose own survey or marks are wrong can be named.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.quality.accuracy import FALSE_ALARMS
from photogram.quality.asprs import AXES
from photogram.results import Adjustment
from photogram.survey import ControlPoints

SIGNIFICANCE = 0.01  # two-sided, of a survey whose sigmas are right
REFUTED = 0.3  # probability of other differences at which predicted sigmas no longer test a single check point
LEAST_TESTED = 6  # degrees of freedom of other tests, of two points, from which a check point can be named


@dataclass(frozen=True)
class Shares:
    """z-scores of ``n`` differences: mean, root mean square, and the shares within 1, 2 and 3 sigma, which are 0.683,
    0.954 and 0.997 where the prediction is right."""

    n: int
    mean_z: float
    rms_z: float
    within_1: float
    within_2: float
    within_3: float


def shares(z: FloatArray) -> Shares:
    """Summarise z-scores (n,), NaN left out; not a number where there are none."""
    z = z[np.isfinite(z)]
    if not len(z):
        return Shares(0, *(float("nan"),) * 5)
    within = [float(np.mean(np.abs(z) <= k)) for k in (1.0, 2.0, 3.0)]
    return Shares(len(z), float(z.mean()), float(np.sqrt(np.mean(z**2))), *within)


@dataclass(frozen=True)
class SuspectCheck:
    """A check point that the block and all other check points contradict: ``off_m`` adjusted minus surveyed along the
    ``axis`` of its largest z-score ``z``, and ``statistic``, χ² with ``dof`` degrees of freedom without a blunder."""

    name: str
    axis: str
    off_m: float
    z: float
    statistic: float
    dof: int

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        return (
            f"check point {self.name} fits neither the block nor the other check points: {self.axis} "
            f"{self.off_m:+.3f} m, {abs(self.z):.1f} sigma; check its marks and its surveyed coordinates"
        )


@dataclass(frozen=True, eq=False)
class PredictedAgainstAchieved:
    """Check points against their predicted covariance."""

    n: int
    """Number of check points."""
    z: FloatArray
    """Differences (G, 3) over their predicted standard deviations along easting, northing and height, NaN where not
    checked."""
    distance2: FloatArray
    """Squared Mahalanobis distances (G,), χ² with the number of checked axes."""
    axes: dict[str, Shares]
    """Shares within 1, 2 and 3 sigma, by axis."""
    chi2: float
    """χ² of all points together."""
    dof: int
    """Its degrees of freedom."""
    p: float
    """Probability of a larger χ²."""
    suspects: tuple[SuspectCheck, ...] = ()
    """Check points that contradict everything else, the worst first."""

    @property
    def consistent(self) -> bool:
        """Return whether the differences are neither larger nor smaller than the prediction allows."""
        return SIGNIFICANCE / 2 <= self.p <= 1.0 - SIGNIFICANCE / 2

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        return "; ".join([self._whole, *(suspect.sentence for suspect in self.suspects)])

    @property
    def _whole(self) -> str:
        points = f"{self.n} check point{'s' if self.n > 1 else ''}"
        ratio = float(np.sqrt(self.chi2 / self.dof))
        test = f"χ² = {self.chi2:.1f} with {self.dof} degrees of freedom, p {_probability(self.p)}"
        if self.consistent:
            return f"{points}: the differences are as large as predicted, {ratio:.2f} times on average ({test})"
        if self.p < 0.5:
            return (
                f"{points}: the differences are {ratio:.2f} times as large as predicted ({test}): a stated "
                "sigma is too small, a measurement is wrong, or the calibration deforms the block; see "
                "Stated sigmas against residuals"
            )
        return (
            f"{points}: the differences are only {ratio:.2f} times as large as predicted ({test}): a stated "
            "sigma is too large; see Stated sigmas against residuals"
        )


def _probability(p: float) -> str:
    return "below 0.001" if p < 0.001 else "above 0.999" if p > 0.999 else f"{p:.3f}"


def checked_axes(points: ControlPoints) -> BoolArray:
    """Return which coordinates (G, 3) of ground points take no part in the adjustment, to be compared with it: those of
    check points, but for heights of a system that is not known."""
    return np.asarray(~points.controlled & ~np.isinf(points.sigma_m))


def _difference_map_m(result: Adjustment) -> FloatArray:
    """Return adjusted − surveyed (G, 3) of all ground points along easting, northing and height."""
    frame, points = result.block.frame, result.block.control_points
    difference = np.full((len(points), 3), np.nan)
    known = np.isfinite(result.estimates.ground_world_m).all(axis=1)
    adjusted = frame.map_from_world(result.estimates.ground_world_m[known])
    difference[known] = adjusted - frame.map_from_world(points.position_world_m[known])
    return difference


def predicted_against_achieved(result: Adjustment) -> PredictedAgainstAchieved | None:
    """Compare the differences of the check points with their predicted covariance; None where there are none.

    The covariance is that of the intersected points together (errors of photographs, calibration and marks) and the
    variances of their survey, along the axes of the map.
    """
    points = result.block.control_points
    difference = _difference_map_m(result)
    used = checked_axes(points) & np.isfinite(difference)
    rows = np.flatnonzero(used.ravel())
    if not len(rows):
        return None
    turn = np.kron(np.eye(len(points)), result.block.frame.rotation_world_from_map(np.zeros(3)))[:, rows]
    # points without a position have no covariance, and none of the rows
    joint = turn.T @ np.nan_to_num(result.covariances.ground_joint_m2) @ turn
    joint[np.diag_indices(len(rows))] += points.sigma_m.ravel()[rows] ** 2
    d = difference.ravel()[rows]
    z = np.full(difference.shape, np.nan)
    z.reshape(-1)[rows] = d / np.sqrt(np.diag(joint))
    distance2 = np.full(len(points), np.nan)
    for g in np.flatnonzero(used.any(axis=1)).tolist():
        own = np.flatnonzero(rows // 3 == g)
        distance2[g] = d[own] @ np.linalg.solve(joint[np.ix_(own, own)], d[own])
    value = float(d @ np.linalg.solve(joint, d))
    suspects = [
        _suspect(points.name[g], z[g], difference[g], statistic)
        for g, statistic in contradicting_points(d, joint, rows // 3, _left_out_tests(result))
    ]
    return PredictedAgainstAchieved(
        n=int(used.any(axis=1).sum()),
        z=z,
        distance2=distance2,
        axes={name: shares(z[:, axis]) for axis, name in enumerate(AXES)},
        chi2=value,
        dof=len(rows),
        p=float(chi2.sf(value, len(rows))),
        suspects=tuple(suspects),
    )


def _left_out_tests(result: Adjustment) -> list[tuple[int, float]]:
    """Return degrees of freedom and χ² of the control points, each predicted from everything but its own survey."""
    r = result.tests.reliability
    tests = list[tuple[int, float]]()
    for off, covariance in zip(r.ground_left_out_m, r.ground_left_out_covariance_m2, strict=True):
        known = np.isfinite(off)
        if known.any():
            tests.append((int(known.sum()), _square(np.where(known, off, 0.0), covariance, known)))
    return tests


def _suspect(name: str, z: FloatArray, difference_m: FloatArray, statistic: float) -> SuspectCheck:
    axis = int(np.nanargmax(np.abs(z)))
    return SuspectCheck(
        name, AXES[axis], float(difference_m[axis]), float(z[axis]), statistic, int(np.isfinite(z).sum())
    )


def contradicting_points(
    d: FloatArray, joint: FloatArray, point: IntArray, others: Sequence[tuple[int, float]] = ()
) -> list[tuple[int, float]]:
    """Return the points that the others contradict, each with its test T, the worst first.

    ``d`` (n,) are differences with their covariance ``joint`` (n, n), ``point`` (n,) says whose they are; ``others``
    are further tests of the block, degrees of freedom and χ², of control points left out. T is by how much dᵀ C⁻¹ d of
    all falls without the point, χ² with its k differences (as in data snooping). Where the rest refutes the predicted
    sigmas, T / k is compared with the variance factor of the rest (F test): a block that is worse than it says accuses
    nobody by itself. FALSE_ALARMS holds for all points together; the worst is set aside, and the rest tested again.
    Where too little else is tested to tell a bad point from a bad block, nothing is named.
    """
    contradicting = list[tuple[int, float]]()
    left = np.ones(len(d), dtype=bool)
    limit = float(np.log(FALSE_ALARMS / max(len(np.unique(point)), 1)))
    while left.any():
        tests = []
        for g in np.unique(point[left]).tolist():
            k, rest = int(np.count_nonzero(point[left] == g)), left & (point != g)
            statistic = _square(d, joint, left) - _square(d, joint, rest)
            # the largest first where the probability of several is too small to be told from 0
            tests.append((_log_chance(statistic, k, _rest(d, joint, point, rest, others)), -statistic, g))
        log_chance, negative, worst = min(tests)
        if log_chance >= limit:
            break
        contradicting.append((worst, -negative))
        left &= point != worst
    return contradicting


def _square(d: FloatArray, joint: FloatArray, of: BoolArray) -> float:
    return float(d[of] @ np.linalg.solve(joint[np.ix_(of, of)], d[of]))


def _rest(
    d: FloatArray, joint: FloatArray, point: IntArray, of: BoolArray, others: Sequence[tuple[int, float]]
) -> tuple[int, float]:
    """Return the degrees of freedom of all other tests, and their variance factor: the smaller of mean and median,
    since another blunder among them raises the mean."""
    each = [(int(np.count_nonzero(point[of] == g)), _square(d, joint, of & (point == g))) for g in np.unique(point[of])]
    each += others
    dof = sum(k for k, _ in each)
    if not dof:
        return 0, np.nan
    mean = (_square(d, joint, of) + sum(square for _, square in others)) / dof
    return dof, min(mean, float(np.median([square / chi2.median(k) for k, square in each])))


def _log_chance(statistic: float, k: int, rest: tuple[int, float]) -> float:
    """Return the logarithm of the probability of such a test by chance, 0 where the rest tests too little."""
    dof, factor = rest
    if dof < LEAST_TESTED:
        return 0.0
    if chi2.sf(factor * dof, dof) > REFUTED:
        return float(chi2.logsf(statistic, k))
    return float(f_distribution.logsf(statistic / k / factor, k, dof))


@dataclass(frozen=True)
class LeaveOneOut:
    """Control points predicted by all other observations: predicted minus surveyed along easting, northing, height."""

    n: int
    """Number of points."""
    rmse_m: tuple[float, float, float]
    """Root mean square errors."""
    mean_m: tuple[float, float, float]
    """Means."""
    rmse_h_m: float
    """RMSE in plan."""
    rmse_v_m: float
    """RMSE in height."""
    rms_z: tuple[float, float, float]
    """RMS of the differences over their sigmas."""
    worst: str
    """Name of the point with the largest difference."""
    worst_m: tuple[float, float, float]
    """Its differences."""
    worst_z: tuple[float, float, float]
    """The same over their sigmas."""


def _triple(values: FloatArray) -> tuple[float, float, float]:
    e, n, h = (float(v) for v in values)
    return e, n, h


def leave_one_out(result: Adjustment) -> LeaveOneOut | None:
    """Summarise what all other observations predict for each control point; None where nothing else determines any."""
    r, points = result.tests.reliability, result.block.control_points
    known = np.flatnonzero(np.isfinite(r.ground_left_out_m).all(axis=1))
    if not len(known):
        return None
    off = r.ground_left_out_m[known]
    z = off / np.sqrt(np.einsum("kii->ki", r.ground_left_out_covariance_m2[known]))
    rmse = np.sqrt(np.mean(off**2, axis=0))
    worst = int(np.argmax(np.linalg.norm(off, axis=1)))
    return LeaveOneOut(
        n=len(known),
        rmse_m=_triple(rmse),
        mean_m=_triple(off.mean(axis=0)),
        rmse_h_m=float(np.hypot(rmse[0], rmse[1])),
        rmse_v_m=float(rmse[2]),
        rms_z=_triple(np.sqrt(np.mean(z**2, axis=0))),
        worst=points.name[known[worst]],
        worst_m=_triple(off[worst]),
        worst_z=_triple(z[worst]),
    )
