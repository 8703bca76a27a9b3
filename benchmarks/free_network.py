"""Eight close-range photographs without any georeference: are relative standard deviations what errors show, and is the
scale that one distance gives as good as predicted?

    python benchmarks/free_network.py [--seeds 50]

Errors are those after the best similarity (with a distance, the best motion), divided by what is predicted: their root
mean square is 1 where the prediction is right, in brackets its standard deviation over the surveys.
"""

from __future__ import annotations

import argparse

import numpy as np
from lib.simulated.close_range import simulate_close_range
from scipy.stats import kstest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray

BAR_SIGMA_M = 0.002
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0)


def squares(error: FloatArray, covariance: FloatArray) -> float:
    """Return the mean square of normalised errors (N, 3)."""
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return float(np.mean(np.einsum("ni,ni->n", error, solved)) / 3.0)


def run(seeds: int, sigma_m: float | None) -> None:
    """Print a row for surveys without a distance, or with one."""
    found, z = np.zeros((seeds, 4)), np.zeros(seeds)
    for seed in range(seeds):
        survey = simulate_close_range(seed, distance_sigma_m=sigma_m)
        result = adjust(survey.block, SETTINGS)
        pose, tie, marked = survey.errors(result)
        R = np.array([p.rotation_world_from_camera for p in result.block.poses if p is not None])
        found[seed] = (
            squares(np.einsum("nij,nj->ni", R, pose[:, 3:]), result.covariances.position_m2),
            squares(pose[:, :3], result.covariances.rotation_rad2),
            squares(tie, result.covariances.tie_point_m2),
            squares(marked, result.covariances.ground_m2),
        )
        joint = result.covariances.ground_joint_m2.reshape(4, 3, 4, 3)
        apart = result.estimates.ground_world_m[2] - result.estimates.ground_world_m[3]
        along = apart / np.linalg.norm(apart)
        C = joint[2, :, 2] + joint[3, :, 3] - joint[2, :, 3] - joint[3, :, 2]
        true_m = np.linalg.norm(survey.marked_m[2] - survey.marked_m[3])
        z[seed] = (np.linalg.norm(apart) - true_m) / np.sqrt(along @ C @ along)
    mean, spread = found.mean(axis=0), found.std(axis=0) / np.sqrt(seeds)
    cells = "  ".join(f"{np.sqrt(m):5.3f} ({0.5 * s / np.sqrt(m):.3f})" for m, s in zip(mean, spread, strict=True))
    scale = ""
    if sigma_m is not None:
        scale = f"{z.mean():+5.2f} ± {z.std():4.2f}, p {kstest(z, 'norm').pvalue:.2f}"
    print(f"{'none' if sigma_m is None else '1':>9}  {cells}  {scale}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    print(f"{seeds} surveys, 8 photographs, 90 tie points, 0.5 px; a distance of 1.5 m known to 2 mm")
    print("distances  centres        attitudes      tie points     marked points  error of scale over sigma")
    for sigma_m in (None, BAR_SIGMA_M):
        run(seeds, sigma_m)


if __name__ == "__main__":
    main()
