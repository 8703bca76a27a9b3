"""Constraints between points against simulated truth: what they give, and whether a wrong one is named.

    python benchmarks/constraints.py [--seeds 100]

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

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from lib.simulated.close_range import CloseRange, simulate_close_range

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.constraints.between_points import CommonSurface, Constraint, Distance, HeightDifference
from photogram.quality.gross_errors.snooped_adjustment import adjust_with_snooping
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


def rms(values: Sequence[float]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


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


def scale_bars(seeds: int) -> None:
    """Print what scale bars give to a free network, and whether a wrong one is named."""
    scale, check, named, innocent, alarms = list[float](), list[float](), 0, 0, 0
    for seed in range(seeds):
        survey, rng = simulate_close_range(seed), np.random.default_rng([seed, 3])
        measured = [length_m(survey, ends) + BAR_SIGMA_M * rng.standard_normal() for ends in (*BARS, CHECK)]
        bars = [
            Distance(ends=ends, length_m=length, sigma_m=BAR_SIGMA_M)
            for ends, length in zip(BARS, measured, strict=False)
        ]
        tested = Distance(ends=CHECK, length_m=measured[-1], sigma_m=BAR_SIGMA_M, role="check")
        result = adjust(replace(survey.block, constraints=(*bars, tested)), SETTINGS)
        scale.append(compared(survey, result))
        check.append(float(result.tests.constraints.z[-1]))
        right = adjust_with_snooping(replace(survey.block, constraints=tuple(bars)), SETTINGS)
        alarms += bool(right.blunders)
        wrong = seed % len(bars)
        redundancy = result.tests.constraints.redundancy[[wrong]]
        off_m = TIMES_MDB * float(minimal_detectable_blunder(np.array([BAR_SIGMA_M]), redundancy)[0])
        changed = replace(bars[wrong], length_m=bars[wrong].length_m + (off_m if seed % 2 else -off_m))
        bars[wrong] = changed
        verdict = adjust_with_snooping(replace(survey.block, constraints=tuple(bars)), SETTINGS)
        accused = [blunder.points for blunder in verdict.blunders]
        named += changed.ends in accused
        innocent += sum(points != changed.ends for points in accused)
    print(f"scale bars in a free network, {seeds} simulated surveys")
    print(f"  z of a length between them {rms(scale):.2f}, of a check bar {rms(check):.2f}")
    print(f"  a bar off by {TIMES_MDB} MDB: named {named / seeds:.0%}, innocent {innocent}, false alarms {alarms}")


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


def heights(kind: str, plan: SurveyPlan, seeds: int) -> None:
    """Print the heights of unsurveyed points with and without constraints of a kind."""
    z: dict[bool, list[float]] = {True: [], False: []}
    sigma: dict[bool, list[float]] = {True: [], False: []}
    check = list[float]()
    for seed in range(seeds):
        made = simulate_block(
            plan, seed, tie_points=80, start_position_sigma_m=0.05, start_attitude_sigma_deg=0.05,
            start_point_sigma_m=0.05,
        )  # fmt: skip
        block, free = unsurveyed(made.block)
        frame, points = block.frame, block.control_points
        height_m = frame.map_from_world(made.truth.control_position_world_m)[:, 2]
        up = frame.rotation_world_from_map(np.zeros(3))[:, 2]
        on = [next(g for g, role in enumerate(points.role) if role == "control"), *free]
        rng = np.random.default_rng([seed, 9])
        constraints = constraints_of(kind, [points.name[g] for g in on], height_m[on], rng)
        for constrained in (False, True):
            own = constraints if constrained else tuple(replace(c, role="check") for c in constraints)
            result = adjust(replace(block, constraints=own), SETTINGS)
            found = frame.map_from_world(result.estimates.ground_world_m[free])[:, 2]
            spread = [float(np.sqrt(up @ result.covariances.ground_m2[g] @ up)) for g in free]
            z[constrained] += ((found - height_m[free]) / spread).tolist()
            sigma[constrained] += spread
            if not constrained:
                check += result.tests.constraints.z[np.isfinite(result.tests.constraints.z)].tolist()
    (before, after) = (1000.0 * float(np.median(sigma[c])) for c in (False, True))
    print(f"  {kind:<20}{rms(z[False]):6.2f}{before:8.1f}{rms(z[True]):8.2f}{after:8.1f}{rms(check):10.2f}", flush=True)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    seeds = parser.parse_args().seeds
    scale_bars(seeds)
    print(f"\nheights of unsurveyed points, {seeds} simulated surveys")
    print("                       without:        with:             as checks:")
    print("                           z   sigma       z   sigma    check z")
    heights("height differences", PLAN, seeds)
    for kind in ("level surface", "plane"):
        heights(kind, replace(PLAN, relief_m=0.0), seeds)


if __name__ == "__main__":
    main()
