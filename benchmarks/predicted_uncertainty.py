"""Observation-only simulated blocks: do the errors scatter as the adjustment predicts, and what do mismatches do?

    python benchmarks/predicted_uncertainty.py [SEEDS]

The normalised squared error of a position is eᵀ Σ⁻¹ e / 3; its expectation is 1. One camera, one tie point and one
check point of each block are taken, since those of one block share errors. Bounds are the 99 % bounds of χ².
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=3, buildings=0, trees=0, cell_m=1.0)


def _solve(seed: int, mismatches: float) -> tuple[SimulatedBlock, Adjustment]:
    block = simulate_block(
        PLAN, seed, tie_points=150, mismatches=mismatches, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5
    )
    return block, adjust(block.block, AdjustmentSettings())


def _camera_errors(block: SimulatedBlock, result: Adjustment) -> FloatArray:
    poses = [pose for pose in result.block.poses if pose is not None]
    return np.array([p.position_world_m - q.position_world_m for p, q in zip(poses, block.truth.poses, strict=True)])


def _normalised(error: FloatArray, covariance: FloatArray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def _point_error(block: SimulatedBlock, result: Adjustment, point: int) -> FloatArray:
    tie, kept = block.block.tie_points, result.block.tie_points
    o = kept.first_observation[point]
    same = (tie.photograph == kept.photograph[o]) & (tie.feature == kept.feature[o])
    return np.asarray(kept.position_world_m[point] - block.tie_point_position_world_m[tie.point[same][0]])


def main(seeds: int) -> None:
    """Adjust clean and spoilt blocks and print the figures."""
    total = {"camera": 0.0, "tie point": 0.0, "check point": 0.0}
    sigma0, clean, spoilt = [], 0.0, 0.0
    for seed in range(seeds):
        block, result = _solve(seed, 0.0)
        errors = _camera_errors(block, result)
        i, p = seed % len(errors), (7 * seed) % len(result.block.tie_points)
        g = next(g for g, role in enumerate(block.block.control_points.role) if role == "check")
        check = result.estimates.ground_world_m[g] - block.truth.control_position_world_m[g]
        total["camera"] += _normalised(errors[i], result.covariances.position_m2[i])
        total["tie point"] += _normalised(_point_error(block, result, p), result.covariances.tie_point_m2[p])
        total["check point"] += _normalised(check, result.covariances.ground_m2[g])
        sigma0.append(result.sigma0)
        clean += float(np.sum(errors**2))
        spoilt += float(np.sum(_camera_errors(*_solve(seed, 0.1)) ** 2))
    low, high = (float(chi2.ppf(share, 3 * seeds)) / (3 * seeds) for share in (0.005, 0.995))
    print(f"{seeds} simulated blocks of 6 photographs; normalised squared errors, 99 % bounds {low:.2f} to {high:.2f}")
    for name, value in total.items():
        print(f"  {name:<12} {value / (3 * seeds):.3f}")
    print(f"sigma0: mean {np.mean(sigma0):.3f}, {min(sigma0):.3f} to {max(sigma0):.3f}")
    print(f"camera RMS error with 10 % gross mismatches, against none: {np.sqrt(spoilt / clean):.3f} times")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
