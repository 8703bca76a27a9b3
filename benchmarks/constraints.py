"""Constraints between points against simulated truth: what they give, and whether a wrong one is named.

    python benchmarks/constraints.py [SEEDS]                 default: 100

Scale bars: photographs around an object without any georeference, scaled by four bars of 2 mm between four marked
points; a fifth bar is a check, a sixth length is compared with its truth. Each survey again with one bar in turn that
is off by 1.5 times its minimal detectable blunder: `named` is the share in which it is rejected by its name, `innocent`
counts others, `false alarms` rejections in the surveys without a blunder.

Heights: eight photographs from above, three surveyed control points; the other marked points, which nobody has
surveyed, have levelled differences of 1 mm to the first control point, or lie on a level surface or on a plane (0.5 mm,
on level ground). z is the error of their heights over the predicted standard deviation, root mean square, expectation
1; `sigma` what is predicted, mm, in the median; `check z` that of the same observations as checks of the adjustment
without them. The peer is the adjustment without constraints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from lib import study
from lib.simulated.close_range import CloseRange, simulate_close_range
from lib.study import rms

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.constraints.between_points import CommonSurface, Constraint, Distance, HeightDifference
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0)
BAR_SIGMA_M, RISE_SIGMA_M, SURFACE_SIGMA_M = 0.002, 0.001, 0.0005
BARS, CHECK, COMPARED = (("A", "B"), ("C", "D"), ("A", "C"), ("B", "D")), ("A", "D"), ("B", "C")
NAMES = "ABCD"
TIMES_MDB = 1.5
PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=7, check_points=2, calibration_sigmas=(0.0,) * 11
)  # fmt: skip


def length_m(survey: CloseRange, ends: tuple[str, str]) -> float:
    """Return the true distance of two marked points."""
    a, b = (NAMES.index(name) for name in ends)
    return float(np.linalg.norm(survey.marked_m[a] - survey.marked_m[b]))


def compared(survey: CloseRange, result: Adjustment) -> float:
    """Return the error of a length that no bar measured, over its predicted standard deviation."""
    a, b = (NAMES.index(name) for name in COMPARED)
    apart = result.estimates.ground_world_m[a] - result.estimates.ground_world_m[b]
    J = np.zeros(3 * len(NAMES))
    J[3 * a : 3 * a + 3] = apart / np.linalg.norm(apart)
    J[3 * b : 3 * b + 3] = -J[3 * a : 3 * a + 3]
    sigma = float(np.sqrt(J @ result.covariances.ground_joint_m2 @ J))
    return (float(np.linalg.norm(apart)) - length_m(survey, COMPARED)) / sigma


def scaled(seed: int) -> tuple[float, float, bool, bool, int]:
    """Return z of a length and of a check bar, whether a right bar is accused, a wrong one named, and innocent ones."""
    survey, rng = simulate_close_range(seed), np.random.default_rng([seed, 3])
    measured = [length_m(survey, ends) + BAR_SIGMA_M * rng.standard_normal() for ends in (*BARS, CHECK)]
    bars = [
        Distance(ends=ends, length_m=length, sigma_m=BAR_SIGMA_M) for ends, length in zip(BARS, measured, strict=False)
    ]
    tested = Distance(ends=CHECK, length_m=measured[-1], sigma_m=BAR_SIGMA_M, role="check")
    result = adjust(replace(survey.block, constraints=(*bars, tested)), SETTINGS)
    right = adjust_with_snooping(replace(survey.block, constraints=tuple(bars)), SETTINGS)
    wrong = seed % len(bars)
    redundancy = result.tests.constraints.redundancy[[wrong]]
    off_m = TIMES_MDB * float(minimal_detectable_blunder(np.array([BAR_SIGMA_M]), redundancy)[0])
    changed = replace(bars[wrong], length_m=bars[wrong].length_m + (off_m if seed % 2 else -off_m))
    bars[wrong] = changed
    verdict = adjust_with_snooping(replace(survey.block, constraints=tuple(bars)), SETTINGS)
    accused = [blunder.points for blunder in verdict.blunders]
    innocent = sum(points != changed.ends for points in accused)
    z = compared(survey, result), float(result.tests.constraints.z[-1])
    return *z, bool(right.blunders), changed.ends in accused, innocent


def unsurveyed(block: Block) -> tuple[Block, list[int]]:
    """Return a block of which only the first three control points are surveyed, and the numbers of the others."""
    points = block.control_points
    free = [g for g, role in enumerate(points.role) if role == "control"][3:]
    position, sigma = points.position_world_m.copy(), points.sigma_m.copy()
    position[free], sigma[free] = np.nan, np.inf
    return replace(block, control_points=replace(points, position_world_m=position, sigma_m=sigma)), free


def constraints_of(
    kind: str, names: Sequence[str], height_m: np.ndarray, rng: np.random.Generator
) -> tuple[Constraint, ...]:
    """Return the constraints of a kind between points of these names and true heights; the first is surveyed."""
    if kind == "height differences":
        return tuple(
            HeightDifference(
                ends=(names[0], name), difference_m=float(h - height_m[0] + RISE_SIGMA_M * rng.standard_normal()),
                sigma_m=RISE_SIGMA_M,
            )
            for name, h in zip(names[1:], height_m[1:], strict=True)
        )  # fmt: skip
    sigmas = (SURFACE_SIGMA_M,) * len(names)
    if kind == "level surface":
        return (CommonSurface("s", "level surface", tuple(names), sigmas),)
    return (CommonSurface("s", "plane", tuple(names), sigmas),)


@dataclass(frozen=True)
class Heights:
    """Errors of unsurveyed heights over their sigmas, and these, m, without and with constraints; z of checks."""

    z: tuple[list[float], list[float]]
    sigma_m: tuple[list[float], list[float]]
    check_z: list[float]


def heights(kind: str, plan: SurveyPlan, seed: int) -> Heights:
    """Return the heights of unsurveyed points with and without constraints of a kind."""
    made = simulate_block(
        plan, seed, tie_points=80, start_position_sigma_m=0.05, start_attitude_sigma_deg=0.05, start_point_sigma_m=0.05
    )
    block, free = unsurveyed(made.block)
    frame, points = block.frame, block.control_points
    height_m = frame.map_from_world(made.truth.control_position_world_m)[:, 2]
    up = frame.rotation_world_from_map(np.zeros(3))[:, 2]
    on = [next(g for g, role in enumerate(points.role) if role == "control"), *free]
    rng = np.random.default_rng([seed, 9])
    constraints = constraints_of(kind, [points.name[g] for g in on], height_m[on], rng)
    as_checks = tuple(replace(c, role="check") for c in constraints)
    results = [adjust(replace(block, constraints=own), SETTINGS) for own in (as_checks, constraints)]
    sigmas = [[float(np.sqrt(up @ r.covariances.ground_m2[g] @ up)) for g in free] for r in results]
    error_m = [frame.map_from_world(r.estimates.ground_world_m[free])[:, 2] - height_m[free] for r in results]
    without, constrained = ((e / s).tolist() for e, s in zip(error_m, sigmas, strict=True))
    check = results[0].tests.constraints.z
    return Heights((without, constrained), (sigmas[0], sigmas[1]), check[np.isfinite(check)].tolist())


def main() -> None:
    """Print both tables."""
    given = study.parser(__doc__, 100).parse_args()
    count = len(given.seeds)
    with study.recorded(given.json):
        z, check_z, alarms, named, innocent = zip(*study.run(scaled, given.seeds, given.workers), strict=True)
        print(f"scale bars in a free network, {count} simulated surveys")
        print(f"  z of a length between them {rms(z):.2f}, of a check bar {rms(check_z):.2f}")
        accused = f"innocent {sum(innocent)}, false alarms {sum(alarms)}"
        print(f"  a bar off by {TIMES_MDB} MDB: named {sum(named) / count:.0%}, {accused}")
        print(f"\nheights of unsurveyed points, {count} simulated surveys")
        table = study.Table("constraint        ", "without: z", "sigma", "with: z", "sigma", "as checks: z")
        flat = replace(PLAN, relief_m=0.0)
        for kind, plan in (("height differences", PLAN), ("level surface", flat), ("plane", flat)):
            done = study.run(partial(heights, kind, plan), given.seeds, given.workers)
            cells = []
            for k in (0, 1):
                sigma_mm = 1000.0 * float(np.median([s for h in done for s in h.sigma_m[k]]))
                cells += [f"{rms([z for h in done for z in h.z[k]]):.2f}", f"{sigma_mm:.1f}"]
            table.row(kind, *cells, f"{rms([z for h in done for z in h.check_z]):.2f}")


if __name__ == "__main__":
    main()
