"""Control points whose list names no accuracy: is what they scatter by found, and nobody accused?

    python benchmarks/assumed_control.py [SURVEYS]                 default: 50

Observations are simulated: 40 photographs without GNSS, ten control points, ten check points. `init` assumes 3, 3, 5 cm
for a list without accuracy. The points are those of a hand-held receiver (2 m), of a careless survey (20 cm), as good
as assumed (3 cm), or of a total station (5 mm); two of them may be 20 m or 1 m off. `stated` says 3, 3, 5 cm of those
of the hand-held receiver. Accused: control points that are rejected and were right. Named: both blunders are rejected.
Errors over sigmas are those of the check points against the truth, in all three axes; a block that control points place
has them in common, so that within a survey they are alike, and 1, 2, 3 sigma over all surveys ought to hold 68, 95 and
99.7 %. Sigma found is the median of used over true sigma.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from lib import study

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.errors import PhotogramError
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

ASSUMED_M = np.array([0.03, 0.03, 0.05])
PLAN = SurveyPlan(
    strips=5, photographs_per_strip=8, gnss_tags=False, control_points=10, check_points=10,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip
CASES = {
    "hand-held, 2 m": (2.0, 0, True),
    "hand-held, two blunders of 20 m": (2.0, 2, True),
    "careless, 20 cm": (0.2, 0, True),
    "as assumed, 3 cm": (0.03, 0, True),
    "total station, 5 mm": (0.005, 0, True),
    "total station, two blunders of 1 m": (0.005, -2, True),
    "stated 3, 3, 5 cm, hand-held, 2 m": (2.0, 0, False),
}


@dataclass(frozen=True)
class Trial:
    """What became of a survey: points accused, whether its blunders are named, errors over sigmas, sigma used over
    true."""

    accused: int
    named: bool
    ratios: tuple[float, ...]
    sigma_ratio: float
    contradicted: bool


def survey(sigma_m: float, blunders: int, assumed: bool, seed: int) -> tuple[Block, np.ndarray, set[str]]:
    """Simulate a survey; returns its block, the true positions of its points and the names of those that are wrong."""
    made = simulate_block(
        replace(PLAN, control_sigma_m=(sigma_m,) * 3), seed, tie_points=1500, start_position_sigma_m=0.3,
        start_attitude_sigma_deg=0.2,
    )  # fmt: skip
    points = made.block.control_points
    truth = made.truth.control_position_world_m
    rng = np.random.default_rng([seed, 11])
    control = np.flatnonzero(np.array(points.role) == "control")
    wrong = rng.choice(control, abs(blunders), replace=False)
    position = points.position_world_m.copy()
    for g in wrong.tolist():
        way = rng.standard_normal(3)
        position[g] += (20.0 if blunders > 0 else 1.0) * way / np.linalg.norm(way)
    points = replace(
        points, position_world_m=position, sigma_m=np.tile(ASSUMED_M, (len(points), 1)),
        sigma_assumed=np.full(len(points), assumed),
    )  # fmt: skip
    return replace(made.block, control_points=points), truth, {points.name[g] for g in wrong.tolist()}


def trial(case: str, seed: int) -> Trial | None:
    """Adjust one survey of a case, None where it is refused."""
    sigma_m, blunders, assumed = CASES[case]
    block, truth, wrong = survey(sigma_m, blunders, assumed, seed)
    try:
        verdict = adjust_with_snooping(block, AdjustmentSettings())
    except PhotogramError:
        return None
    rejected = {a.name for a in verdict.rejected if a.kind == "control point"}
    result, check = verdict.result, np.array(block.control_points.role) == "check"
    off = result.estimates.ground_world_m[check] - truth[check]
    sigma = np.sqrt(np.einsum("gii->gi", result.covariances.ground_m2[check]))
    points = result.block.control_points
    used = float(np.median(points.sigma_m[points.used])) / sigma_m
    said = any("contradicted by a factor" in warning for warning in result.warnings)
    return Trial(len(rejected - wrong), wrong <= rejected, tuple((off / sigma).ravel().tolist()), used, said)


def main() -> None:
    """Print the table."""
    parser = study.parser(__doc__, 50)
    given = parser.parse_args()
    with study.recorded(given.json):
        print(f"simulated; {len(given.seeds)} surveys of each kind\n")
        table = study.Table(
            "control points                 ", "adjusted", "accused", "named", "sigma found", "errors / sigmas",
            "within 1, 2, 3 sigma, %", "said to be contradicted",
        )  # fmt: skip
        for case, (_, blunders, _) in CASES.items():
            done = [t for t in study.run(partial(trial, case), given.seeds, given.workers) if t is not None]
            z = np.array([ratio for t in done for ratio in t.ratios])
            table.row(
                case, len(done), f"{sum(t.accused for t in done)} of {10 * len(done)}",
                f"{np.mean([t.named for t in done]):.0%}" if blunders else "",
                f"{np.median([t.sigma_ratio for t in done]):.2f}", f"{study.rms(z):.2f}",
                " ".join(f"{100.0 * share:.1f}" for share in study.shares_within(z)),
                f"{np.mean([t.contradicted for t in done]):.0%}",
            )  # fmt: skip


if __name__ == "__main__":
    main()
