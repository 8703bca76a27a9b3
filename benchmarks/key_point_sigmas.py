"""Scatter of tie-point residuals by the size of their key points, in surveys that `photogram adjust` has finished.

    python benchmarks/key_point_sigmas.py PROJECT...

Each PROJECT is a project.yaml with its folders work/ and results/. Residuals of points with three rays or more are
divided by sqrt((2n − 3)/2n), which the adjustment of a point of n rays takes from its errors; the scatter is
1.4826 times the median of their absolute values. Sizes are in units of the smallest key points.
Adjust with adjustment.estimate_sigmas: false, since the law of sigmas is judged as stated.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from photogram.files.npz_json import read_arrays, read_record
from photogram.pipeline.pipeline import load_project
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.sfm.tie_points.features import SMALLEST_PX, picture_scale
from photogram.survey import TRANSFERRED, Features, TiePoints

EDGES = (1.0, 2.0, 4.0, 8.0, 16.0, np.inf)
FEWEST = 60  # observations that make a figure


def relative_sizes(project: Project, work: Path, tie: TiePoints) -> np.ndarray:
    """Return the size (N,) of each observation's key point over that of the smallest; NaN where it has none."""
    size = np.full(len(tie.photograph), np.nan)
    for index in np.unique(tie.photograph).tolist():
        camera = project.cameras[project.photographs[index].camera]
        scale = picture_scale(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])
        own = (tie.photograph == index) & (tie.feature != TRANSFERRED)
        features = read_record(work / "features.stage" / f"{index:05d}.npz", Features)
        size[own] = np.maximum(features.size_px[tie.feature[own]] / (SMALLEST_PX * scale), 1.0)
    return size


def scatter(values: np.ndarray) -> str:
    """Return 1.4826 times the median of the absolute values."""
    return f"{1.4826 * np.median(np.abs(values)):.3f}" if len(values) >= FEWEST else "–"


def main() -> None:
    """Print one table for each survey."""
    for path in map(Path, sys.argv[1:]):
        project, work = load_project(path), path.parent / "work"
        tie = read_record(work / "adjustment.stage" / "tie_points.npz", TiePoints)
        rays = tie.rays[tie.point].astype(float)
        error_px = read_arrays(work / "adjustment.stage" / "adjustment.npz")["residual_px"]
        error_px = error_px / np.sqrt((2 * rays - 3) / (2 * rays))[:, None]
        size, many = relative_sizes(project, work, tie), rays >= 3
        print(f"\n{path}, quality {project.quality}\n{'size':>16s} {'number':>8s} {'px':>7s} {'in sigmas':>10s}")
        classes = [(f"{a:g} to {b:g}", (size >= a) & (size < b)) for a, b in pairwise(EDGES)]
        for name, chosen in [*classes, ("by correlation", np.isnan(size))]:
            own = many & chosen
            whitened = error_px[own] / tie.sigma_px[own, None]
            print(f"{name:>16s} {np.count_nonzero(own):8d} {scatter(error_px[own]):>7s} {scatter(whitened):>10s}")


if __name__ == "__main__":
    main()
