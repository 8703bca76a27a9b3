"""Eight close-range photographs without any georeference: are relative standard deviations what errors show, and is the
scale that one distance gives as good as predicted?

    python benchmarks/free_network.py [SEEDS]                 default: 50

Errors are those after the best similarity (with a distance, the best motion), divided by what is predicted: their root
mean square is 1 where the prediction is right, in brackets its standard deviation over the surveys.
"""

from functools import partial

import numpy as np
from lib import study
from lib.simulated.close_range import simulate_close_range

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings

BAR_SIGMA_M = 0.002
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0)


TITLES = (
    "known distances",
    "projection centres",
    "attitudes",
    "tie points",
    "marked points",
    "error of scale over sigma",
)


def trial(sigma_m: float | None, seed: int) -> tuple[list[float], float]:
    """Return the mean normalised squares of a survey's errors, and the error of its scale over its sigma."""
    survey = simulate_close_range(seed, distance_sigma_m=sigma_m)
    result = adjust(survey.block, SETTINGS)
    pose, tie, marked = survey.errors(result)
    R = np.array([p.rotation_world_from_camera for p in result.block.poses if p is not None])
    parts = (
        (np.einsum("nij,nj->ni", R, pose[:, 3:]), result.covariances.position_m2),
        (pose[:, :3], result.covariances.rotation_rad2),
        (tie, result.covariances.tie_point_m2),
        (marked, result.covariances.ground_m2),
    )
    joint = result.covariances.ground_joint_m2.reshape(4, 3, 4, 3)
    apart = result.estimates.ground_world_m[2] - result.estimates.ground_world_m[3]
    along = apart / np.linalg.norm(apart)
    C = joint[2, :, 2] + joint[3, :, 3] - joint[2, :, 3] - joint[3, :, 2]
    true_m = np.linalg.norm(survey.marked_m[2] - survey.marked_m[3])
    z = float((np.linalg.norm(apart) - true_m) / np.sqrt(along @ C @ along))
    return [float(np.mean(study.normalised_squares(*part))) for part in parts], z


def main() -> None:
    """Print the table."""
    given = study.parser(__doc__, 50).parse_args()
    count = len(given.seeds)
    with study.recorded(given.json):
        print(f"{count} surveys, 8 photographs, 90 tie points, 0.5 px; a distance of 1.5 m known to 2 mm")
        table = study.Table(*TITLES)
        for sigma_m in (None, BAR_SIGMA_M):
            squares, scales = zip(*study.run(partial(trial, sigma_m), given.seeds, given.workers), strict=True)
            root, spread = np.sqrt(np.mean(squares, axis=0)), np.std(squares, axis=0) / np.sqrt(count)
            cells = [f"{r:5.3f} ({0.5 * s / r:.3f})" for r, s in zip(root, spread, strict=True)]
            p = study.kolmogorov_smirnov_p(scales, "norm")
            scale = "" if sigma_m is None else f"{np.mean(scales):+5.2f} ± {np.std(scales):4.2f}, p {p:.2f}"
            table.row("none" if sigma_m is None else "1", *cells, scale)


if __name__ == "__main__":
    main()
