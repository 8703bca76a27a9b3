"""Observation-only simulated blocks: do the errors scatter as the adjustment predicts, and what do mismatches do?

    python benchmarks/predicted_uncertainty.py [SEEDS]                     default: 50

The normalised squared error of a position is eᵀ Σ⁻¹ e / 3; its expectation is 1. One camera, one tie point and one
check point of each block are taken, since those of one block share errors. Bounds are the 99 % bounds of χ².
"""

from dataclasses import dataclass

import numpy as np
from lib import study

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=3, buildings=0, trees=0, cell_m=1.0)
NAMES = ("camera", "tie point", "check point")


def _solve(seed: int, mismatches: float) -> tuple[SimulatedBlock, Adjustment]:
    block = simulate_block(
        PLAN, seed, tie_points=150, mismatches=mismatches, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    )
    return block, adjust(block.block, AdjustmentSettings())


def _camera_errors(block: SimulatedBlock, result: Adjustment) -> FloatArray:
    poses = [pose for pose in result.block.poses if pose is not None]
    return np.array([p.position_world_m - q.position_world_m for p, q in zip(poses, block.truth.poses, strict=True)])


def _point_error(block: SimulatedBlock, result: Adjustment, point: int) -> FloatArray:
    tie, kept = block.block.tie_points, result.block.tie_points
    o = kept.first_observation[point]
    same = (tie.photograph == kept.photograph[o]) & (tie.feature == kept.feature[o])
    return np.asarray(kept.position_world_m[point] - block.tie_point_position_world_m[tie.point[same][0]])


@dataclass(frozen=True)
class Trial:
    """Normalised squares of the errors of a camera, a tie point and a check point, sigma0, and the sums of the squared
    errors of cameras without and with mismatches."""

    squares: tuple[float, float, float]
    sigma0: float
    clean_m2: float
    spoilt_m2: float


def trial(seed: int) -> Trial:
    """Adjust a block without and with mismatches."""
    block, result = _solve(seed, 0.0)
    errors = _camera_errors(block, result)
    i, p = seed % len(errors), (7 * seed) % len(result.block.tie_points)
    g = next(g for g, role in enumerate(block.block.control_points.role) if role == "check")
    check = result.estimates.ground_world_m[g] - block.truth.control_position_world_m[g]
    error = np.array([errors[i], _point_error(block, result, p), check])
    covariance = (
        result.covariances.position_m2[i],
        result.covariances.tie_point_m2[p],
        result.covariances.ground_m2[g],
    )
    camera, tie, ground = study.normalised_squares(error, np.array(covariance)).tolist()
    spoilt = _camera_errors(*_solve(seed, 0.1))
    return Trial((camera, tie, ground), result.sigma0, float(np.sum(errors**2)), float(np.sum(spoilt**2)))


def main() -> None:
    """Adjust clean and spoilt blocks and print the figures."""
    given = study.parser(__doc__, 50).parse_args()
    with study.recorded(given.json):
        trials = study.run(trial, given.seeds, given.workers)
        low, high = study.mean_square_bounds(3 * len(trials))
        print(f"{len(trials)} simulated blocks of 6 photographs; 99 % bounds {low:.2f} to {high:.2f}")
        table = study.Table("error of a    ", "normalised square")
        for name, square in zip(NAMES, np.mean([t.squares for t in trials], axis=0), strict=True):
            table.row(name, f"{square:.3f}")
        sigma0 = [t.sigma0 for t in trials]
        print(f"sigma0: mean {np.mean(sigma0):.3f}, {min(sigma0):.3f} to {max(sigma0):.3f}")
        ratio = np.sqrt(sum(t.spoilt_m2 for t in trials) / sum(t.clean_m2 for t in trials))
        print(f"camera RMS error with 10 % gross mismatches, against none: {ratio:.3f} times")


if __name__ == "__main__":
    main()
