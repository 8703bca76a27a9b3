"""Simulated surveys of varied geometry: are errors as large as predicted?

    python benchmarks/calibrated_uncertainty.py [SURVEYS] [--common nothing|base|antenna|compass]     default: 200

Every survey has a geometry of its own: strips, overlaps, flying height, relief, oblique photographs or none, number,
place and sigma of control points, sigma of marks and tie points, kind of GNSS, mismatches, and what is known of the
calibration. Observations are simulated with the noise that is stated, and adjusted with the settings of a project. The
table has the shares of errors within 1, 2 and 3 predicted standard deviations, which are 68.3, 95.4 and 99.7 % where
the prediction is right, and the root mean square of errors in sigmas, which is 1.

Check points: adjusted minus surveyed, the survey's own error included. Points left out: control points as everything
but their own survey predicts them. All others: adjusted minus true. Errors within one survey are correlated, so the
standard deviation of a share, in brackets, is that of the shares of the surveys divided by the root of their number.

With --common, surveys without control points get an error that all photographs share and that nothing states: RTK from
a base that is off by 2, 2, 3 cm (standard deviations), RTK with the antenna 5 cm ahead of the projection centre, or
positions of 2 to 3 m with a compass that is off by 3°; `nothing` is RTK without control points and without such an
error. Whether predictions still hold is printed, not assumed.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from lib import study
from lib.common_errors import COMMON_ERRORS

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError
from photogram.projection import PARAMETER_NAMES
from photogram.quality.asprs import AXES
from photogram.quality.prediction_test import predicted_against_achieved
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

KNOWN = (0.0,) * 11
LABORATORY = (5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
FREE = (np.inf, np.inf, np.inf, np.inf, np.inf, 0.0, 0.0, np.inf, np.inf, 0.0, 0.0)
TOLERANCE = 0.03
JUDGED = tuple(f"check points, {axis}" for axis in AXES)


OF_COMMON = {"nothing": 1, "base": 1, "antenna": 1, "compass": 2}
"""The kind of GNSS, see plan_of, whose surveys get a common error."""


def plan_of(rng: np.random.Generator, kind: int | None = None) -> SurveyPlan:
    """Draw a geometry; with a ``kind`` of GNSS, one without control points."""
    drawn = int(rng.integers(3))
    nearest, offset = (
        ((0.02, 0.02, 0.04), (0.3, 0.3, 0.5)),  # RTK, base in another system
        ((0.015, 0.015, 0.03), (0.0, 0.0, 0.0)),  # RTK
        ((2.0, 2.0, 3.0), (1.0, 1.0, 2.0)),  # consumer
    )[drawn if kind is None else kind]
    strips = int(rng.integers(2, 5))
    plan_sigma_m = float(rng.choice([0.005, 0.01, 0.02]))
    oblique = bool(rng.random() < 0.35)
    return SurveyPlan(
        focal_px=float(rng.uniform(900.0, 2000.0)), flying_height_m=float(rng.uniform(40.0, 120.0)),
        forward_overlap=float(rng.uniform(0.65, 0.85)), side_overlap=float(rng.uniform(0.55, 0.75)),
        strips=strips, photographs_per_strip=int(rng.integers(3, 7)), oblique_strip=oblique,
        oblique_photographs=int(rng.integers(3, 6)) if oblique else None,
        oblique_angle_deg=float(rng.uniform(15.0, 30.0)), flights=int(rng.integers(1, 3)),
        relief_m=float(rng.uniform(0.0, 15.0)), gnss_sigma_m=nearest, gnss_offset_sigma_m=offset,
        control_points=int(rng.integers(4, 11)) if kind is None else 0, check_points=5,
        control_sigma_m=(plan_sigma_m, plan_sigma_m, 1.5 * plan_sigma_m),
        mark_sigma_px=float(rng.choice([0.3, 0.5, 1.0])),
        calibration_sigmas=(KNOWN, LABORATORY, FREE)[int(rng.integers(3))],
    )  # fmt: skip


def survey(seed: int, common: str | None = None) -> SimulatedBlock:
    """Simulate the observations of a survey, with a common error."""
    rng = np.random.default_rng([seed, 11])
    plan = plan_of(rng, None if common is None else OF_COMMON[common])
    sigma_px = float(rng.choice([0.3, 0.5, 1.0]))
    made = _observed(seed, plan, sigma_px, rng)
    if common is None:
        return made
    photographs = COMMON_ERRORS[common](made.block.photographs, made.truth.poses, np.random.default_rng([seed, 12]))
    return replace(made, block=replace(made.block, photographs=photographs))


def _observed(seed: int, plan: SurveyPlan, sigma_px: float, rng: np.random.Generator) -> SimulatedBlock:
    for _ in range(10):
        try:
            return simulate_block(
                plan, seed, tie_points=int(rng.integers(200, 500)), sigma_px=sigma_px,
                mismatches=float(rng.choice([0.0, 0.03])), detection=float(rng.uniform(0.7, 1.0)),
                start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3, start_point_sigma_m=0.5,
            )  # fmt: skip
        except ValueError:  # no room for so many points, or too few in two photographs: fewer, more overlap
            overlap, fewer = min(0.85, plan.forward_overlap + 0.05), min(plan.control_points, 4)
            plan = replace(plan, control_points=max(fewer, plan.control_points - 1), forward_overlap=overlap)
    raise RuntimeError(f"no survey with the seed {seed}")


def _scores(error: FloatArray, covariance: FloatArray, axes: FloatArray) -> FloatArray:
    """Return errors (N, 3) in the world over their standard deviations along the axes of the map."""
    return np.asarray(error @ axes / np.sqrt(np.einsum("ki,nkl,li->ni", axes, covariance, axes)))


def _tie_point_errors(made: SimulatedBlock, result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Return the errors (P, 3) of the tie points kept that hold no mismatch, and their covariances."""
    tie, kept = made.block.tie_points, result.block.tie_points
    number = {(i, f): n for n, (i, f) in enumerate(zip(tie.photograph.tolist(), tie.feature.tolist(), strict=True))}
    source = np.array([number[i, f] for i, f in zip(kept.photograph.tolist(), kept.feature.tolist(), strict=True)])
    clean = np.bincount(kept.point, made.mismatch[source], minlength=len(kept)) == 0
    error = kept.position_world_m - made.tie_point_position_world_m[tie.point[source[kept.first_observation[:-1]]]]
    return error[clean], result.covariances.tie_point_m2[clean]


@dataclass(frozen=True, eq=False)
class Trial:
    """One survey: errors in sigmas by what they are errors of, and p of all check points together."""

    scores: dict[str, FloatArray]
    p: float


def trial(made: SimulatedBlock) -> Trial:
    """Adjust a survey and compare it with the truth. Raises AdjustmentError where something is not determined."""
    result = adjust(made.block, AdjustmentSettings(tie_point_sigma_px=float(made.block.tie_points.sigma_px[0])))
    achieved = predicted_against_achieved(result)
    assert achieved is not None
    axes, r = result.block.frame.rotation_world_from_map(np.zeros(3)), result.tests.reliability
    poses = [pose.position_world_m for pose in result.block.poses if pose is not None]
    centres = np.array(poses) - np.array([pose.position_world_m for pose in made.truth.poses])
    left_out = r.ground_left_out_m / np.sqrt(np.einsum("kii->ki", r.ground_left_out_covariance_m2))
    parts = {
        "check points": achieved.z,
        "points left out": left_out,
        "tie points": _scores(*_tie_point_errors(made, result), axes),
        "projection centres": _scores(centres, result.covariances.position_m2, axes),
    }
    scores = {
        f"{name}, {axis}": z[np.isfinite(z[:, k]), k]
        for name, z in parts.items()
        for k, axis in enumerate(AXES)
        if np.isfinite(z[:, k]).any()
    }
    sigma = np.sqrt(np.diag(result.covariances.calibration[0]))
    error = result.block.cameras[0].parameters - made.truth.camera.parameters
    for k in np.flatnonzero(sigma > 0).tolist():
        scores[f"calibration, {PARAMETER_NAMES[k]}"] = error[k : k + 1] / sigma[k]
    return Trial(scores, achieved.p)


def caught(common: str | None, seed: int) -> Trial | str:
    """Return the trial of a survey, or why it is not determined."""
    try:
        return trial(survey(seed, common))
    except AdjustmentError as fault:
        return f"survey {seed}: {fault}"


def row(name: str, trials: list[Trial]) -> tuple[list[object], bool]:
    """Return the row of the table, and whether its shares are as predicted."""
    each = [t.scores[name] for t in trials if len(t.scores.get(name, ()))]
    z = np.concatenate(each)
    shares = study.shares_within(z)
    spread = np.std([study.shares_within(part) for part in each], axis=0) / np.sqrt(len(each))
    texts = [f"{100 * share:.1f} ({100 * s:.1f})" for share, s in zip(shares, spread, strict=True)]
    good = bool(np.all(np.abs(shares - study.EXPECTED_SHARES) <= TOLERANCE))
    return [name, len(each), len(z), f"{study.rms(z):.3f}", f"{np.mean(z):+.3f}", *texts], good


def main() -> None:
    """Print one row for each kind of error."""
    parser = study.parser(__doc__, 200)
    parser.add_argument("--common", choices=list(COMMON_ERRORS), help="an error that all photographs share")
    given = parser.parse_args()
    with study.recorded(given.json):
        done = study.run(partial(caught, given.common), given.seeds, given.workers)
        trials = [t for t in done if isinstance(t, Trial)]
        left_open = [t for t in done if isinstance(t, str)]
        title = "" if given.common is None else f", without control points, common error: {given.common}"
        print(f"simulated{title}; {len(done)} surveys of varied geometry; {len(left_open)} not determined")
        limits = ("1 sigma, % (± its sd)", "2 sigma     ", "3 sigma     ")
        table = study.Table(f"{'errors':<28}", "surveys", "n    ", "RMS z", "mean z", *(f"within {s}" for s in limits))
        verdicts = {}
        for name in dict.fromkeys(name for t in trials for name in t.scores):
            cells, verdicts[name] = row(name, trials)
            table.row(*cells)
        p = np.array([t.p for t in trials])
        below = ", ".join(f"{np.mean(p < limit):.1%}" for limit in (0.01, 0.05, 0.5))
        uniform = study.kolmogorov_smirnov_p(p, "uniform")
        print(f"joint chi² of check points: p below 1 %, 5 %, 50 % in {below} of the surveys")
        print(f"the same, uniform by Kolmogorov–Smirnov: p = {uniform:.3f}")
        good = "yes" if all(verdicts[name] for name in JUDGED) else "NO"
        print(f"check points within {100 * TOLERANCE:.0f} points of the prediction on every axis: {good}")
        print("\n".join(left_open))


if __name__ == "__main__":
    main()
