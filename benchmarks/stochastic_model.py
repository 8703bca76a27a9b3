"""Simulated surveys whose sigmas nobody states: are they found, and is the result as good as with the true ones?

    python benchmarks/stochastic_model.py [SURVEYS] [--workers N]                 default: 200

Surveys of varied geometry, a third each: RTK with control points, RTK without, a consumer receiver with control points.
The true noise of key points and of points by correlation, two fifths of the observations, is 0.1 to 0.6 px each; stated
is the default, 0.5 px. The consumer receiver scatters by 0.3 to 1.5 m in plan and in height about the offset of its
flight, and 2, 2 and 3 m are assumed. Three surveys in four have mismatches. Each is adjusted three times: with sigmas
estimated, with the stated ones, and with the true ones given.

Estimated over true: of the sigmas. Error over prediction: root mean square of the errors of tie points in their
predicted sigmas. Against the truth: root mean square of the errors over that of the adjustment with the true sigmas.
Check points: adjusted minus surveyed, the share within 1, 2 and 3 predicted sigmas.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
from lib import study

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray, FloatArray
from photogram.quality.prediction_test import predicted_against_achieved
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import TRANSFERRED, Block

RECEIVERS = ("rtk, control", "rtk", "consumer")
STATED_PX, TRUE_PX = 0.5, (0.1, 0.6)
ASSUMED_M, TRUE_M = (2.0, 2.0, 3.0), (0.3, 1.5)
LABORATORY = (5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
CORRELATED = 0.4
WAYS = ("estimated", "stated", "true")


def plan_of(receiver: str, rng: np.random.Generator) -> SurveyPlan:
    """Draw a geometry."""
    plan_m, height_m = rng.uniform(*TRUE_M, 2)
    sigma, offset = (
        ((plan_m, plan_m, height_m), (1.0, 1.0, 2.0))
        if receiver == "consumer"
        else ((0.015, 0.015, 0.03), (0.02, 0.02, 0.03) if receiver == "rtk, control" else (0.0, 0.0, 0.0))
    )
    return SurveyPlan(
        focal_px=float(rng.uniform(900.0, 2000.0)), flying_height_m=float(rng.uniform(40.0, 120.0)),
        forward_overlap=float(rng.uniform(0.72, 0.85)), side_overlap=float(rng.uniform(0.6, 0.75)),
        strips=int(rng.integers(2, 5)), photographs_per_strip=int(rng.integers(4, 8)),
        relief_m=float(rng.uniform(0.0, 15.0)), gnss_sigma_m=sigma, gnss_offset_sigma_m=offset,
        control_points=0 if receiver == "rtk" else int(rng.integers(4, 8)), check_points=5,
        control_marks_per_photograph=0, calibration_sigmas=LABORATORY,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Survey:
    """A survey with all noise, sigmas as stated in its block; the true ones of tie points (N,) and positions (3,)."""

    made: SimulatedBlock
    block: Block
    true_px: FloatArray
    kinds_px: tuple[float, float]
    receiver: str

    @property
    def with_truth(self) -> Block:
        """Return the block with the true sigmas."""
        sigma = np.array(self.made.plan.gnss_sigma_m)
        photographs = tuple(replace(p, gnss_sigma_m=sigma, gnss_sigma_assumed=False) for p in self.block.photographs)
        return replace(
            self.block, photographs=photographs, tie_points=replace(self.block.tie_points, sigma_px=self.true_px)
        )


def survey(seed: int) -> Survey:
    """Simulate the observations of a survey."""
    rng = np.random.default_rng([seed, 17])
    receiver = RECEIVERS[seed % len(RECEIVERS)]
    plan, kinds = plan_of(receiver, rng), rng.uniform(*TRUE_PX, 2)
    wanted, mismatches = int(rng.integers(400, 900)), 0.03 * float(rng.random() < 0.75)
    for _ in range(10):
        try:
            made = simulate_block(
                plan, seed, tie_points=wanted, sigma_px=1e-3, mismatches=mismatches, detection=0.7,
                start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3, start_point_sigma_m=0.5,
            )  # fmt: skip
            break
        except ValueError:  # no room for so many points: fewer, and more overlap
            overlap = min(0.85, plan.forward_overlap + 0.05)
            plan = replace(plan, control_points=max(0, plan.control_points - 1), forward_overlap=overlap)
    else:
        raise RuntimeError(f"no survey with the seed {seed}")
    tie = made.block.tie_points
    n = len(tie.photograph)
    correlated = rng.random(n) < CORRELATED
    true_px = kinds[correlated.astype(np.int64)]
    tie = replace(
        tie,
        feature=np.where(correlated, TRANSFERRED, tie.feature),
        pixel=tie.pixel + true_px[:, None] * rng.standard_normal((n, 2)),
        sigma_px=np.full(n, STATED_PX),
    )
    photographs = made.block.photographs
    if receiver == "consumer":
        assumed = np.array(ASSUMED_M)
        photographs = tuple(replace(p, gnss_sigma_m=assumed, gnss_sigma_assumed=True) for p in photographs)
    block = replace(made.block, tie_points=tie, photographs=photographs)
    return Survey(made, block, true_px, (float(kinds[0]), float(kinds[1])), receiver)


def tie_point_errors(given: Survey, result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Return the errors (P, 3) of all tie points along the axes of the map and their sigmas (P, 3); NaN for points
    that were left out, or hold a mismatch."""
    tie, kept, made = given.block.tie_points, result.block.tie_points, given.made
    key = {(*k, i): n for n, (*k, i) in enumerate(zip(*tie.pixel.T.tolist(), tie.photograph.tolist(), strict=True))}
    rows = zip(*kept.pixel.T.tolist(), kept.photograph.tolist(), strict=True)
    source = np.array([key[row] for row in rows])
    point = tie.point[source[kept.first_observation[:-1]]]
    clean: BoolArray = np.bincount(kept.point, made.mismatch[source], minlength=len(kept)) == 0
    axes = result.block.frame.rotation_world_from_map(np.zeros(3))
    error, sigma = np.full((2, len(tie), 3), np.nan)
    off = (kept.position_world_m - made.tie_point_position_world_m[point]) @ axes
    error[point[clean]] = off[clean]
    variance = np.einsum("ki,nkl,li->ni", axes, result.covariances.tie_point_m2, axes)
    sigma[point[clean]] = np.sqrt(variance[clean])
    return error, sigma


@dataclass(frozen=True, eq=False)
class Trial:
    """One survey: estimated over true sigmas by kind, and by the way of adjustment sigma0, squares of the errors of
    tie points and of their ratios to the prediction, in plan and in height, with their number, and z of check
    points."""

    receiver: str
    ratio: dict[str, float]
    sigma0: dict[str, float]
    squares: dict[str, FloatArray]
    scores: dict[str, FloatArray]
    count: int
    z: dict[str, FloatArray]
    seconds: dict[str, float]


def trial(seed: int) -> Trial:
    """Adjust a survey in all ways."""
    given = survey(seed)
    ways = {
        "estimated": (given.block, AdjustmentSettings()),
        "stated": (given.block, AdjustmentSettings(estimate_sigmas=False)),
        "true": (given.with_truth, AdjustmentSettings(estimate_sigmas=False)),
    }
    results, seconds = {}, {}
    for way, (block, settings) in ways.items():
        start = time.perf_counter()
        results[way] = adjust(block, settings)
        seconds[way] = time.perf_counter() - start
    errors = {way: tie_point_errors(given, result) for way, result in results.items()}
    known = np.all([np.isfinite(error).all(axis=1) for error, _ in errors.values()], axis=0)
    squares: dict[str, FloatArray] = {}
    scores: dict[str, FloatArray] = {}
    z: dict[str, FloatArray] = {}
    for way, (error, sigma) in errors.items():
        parts = ((error[known] ** 2, squares), ((error[known] / sigma[known]) ** 2, scores))
        for value, into in parts:
            into[way] = np.array([np.sum(value[:, :2]) / 2.0, np.sum(value[:, 2])])
        achieved = predicted_against_achieved(results[way])
        assert achieved is not None
        z[way] = achieved.z[np.isfinite(achieved.z).all(axis=1)]
    found = results["estimated"].decisions.sigmas
    truth = dict(zip(("key_points", "transferred"), given.kinds_px, strict=True))
    truth |= {"gnss_plan": given.made.plan.gnss_sigma_m[0], "gnss_height": given.made.plan.gnss_sigma_m[2]}
    rows = zip(found.kind.tolist(), found.used_sigma.tolist(), strict=True)
    ratio = {kind: used / truth[kind] for kind, used in rows if kind in truth}
    sigma0 = {way: result.sigma0 for way, result in results.items()}
    return Trial(given.receiver, ratio, sigma0, squares, scores, int(known.sum()), z, seconds)


def show(done: list[Trial]) -> None:
    """Print the figures of surveys."""
    for kind in ("key_points", "transferred", "gnss_plan", "gnss_height"):
        ratio = np.array([t.ratio[kind] for t in done if kind in t.ratio])
        if len(ratio):
            print(
                f"  sigma of {kind:<12} estimated over true: {np.mean(ratio):.3f} ± {np.std(ratio):.3f}, "
                f"{ratio.min():.3f} to {ratio.max():.3f}; within 5 %: {np.mean(np.abs(ratio - 1) <= 0.05):.1%}"
            )
    total = sum(t.count for t in done)
    table = study.Table("sigmas   ", "sigma0   ", "error/prediction", "RMS, m        ", "against the truth", "s    ")
    for way in WAYS:
        score, square, true = (
            np.sqrt(sum(getattr(t, name)[which] for t in done) / total)
            for name, which in (("scores", way), ("squares", way), ("squares", "true"))
        )
        sigma0 = np.array([t.sigma0[way] for t in done])
        table.row(
            way,
            f"{sigma0.min():.2f}–{sigma0.max():.2f}",
            f"{score[0]:.2f}, {score[1]:.2f}",
            f"{square[0]:.4f}, {square[1]:.4f}",
            f"{square[0] / true[0]:.3f}, {square[1] / true[1]:.3f}",
            f"{sum(t.seconds[way] for t in done):.1f}",
        )
    z = np.concatenate([t.z["estimated"] for t in done])
    shares = ", ".join(f"{100 * share:.1f}" for share in study.shares_within(z))
    expected = ", ".join(f"{100 * share:.1f}" for share in study.EXPECTED_SHARES)
    print(f"  check points within 1, 2, 3 sigma: {shares} % of {z.size} (expected {expected})")


def main() -> None:
    """Print one table for each receiver, and one for all."""
    given = study.parser(__doc__, 200, workers=1).parse_args()
    with study.recorded(given.json):
        done = study.run(trial, given.seeds, given.workers)
        for receiver in (*RECEIVERS, "all"):
            mine = [t for t in done if receiver in (t.receiver, "all")]
            if mine:
                print(f"{receiver}: {len(mine)} simulated surveys; plan, height")
                show(mine)


if __name__ == "__main__":
    main()
