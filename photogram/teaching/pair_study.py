"""RANSAC with many settings on one pair of a survey's photographs, for teaching."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import undistort
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, make_folder_within
from photogram.files.npz_json import write_json
from photogram.pipeline.pipeline import open_run
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.matches import stored_matches
from photogram.project.project import Project
from photogram.result_files import STUDY
from photogram.sfm.tie_points.matching import candidate_matches
from photogram.teaching.figures import inliers_by_iteration, inliers_by_sample_size
from photogram.teaching.ransac_study import RansacStudy, Residual, needed_iterations
from photogram.teaching.ransac_study import study as study_ransac


@dataclass(frozen=True, eq=False)
class PairStudy:
    """What RANSAC found with many settings in the candidate matches of the photographs ``first`` and ``second``, that
    passed a test at ``ratio``."""

    first: str
    second: str
    ratio: float
    result: RansacStudy


def candidate_pixels(project: Project, names: Sequence[str], ratio: float) -> tuple[str, str, FloatArray, FloatArray]:
    """Return the names of a pair, the first matched one where none are given, and the undistorted pixels (M, 2) of its
    candidate matches, not verified. Needs the stage `matches`. Raises ProjectError where the pair is not matched."""
    names = list(names)
    with open_run(project) as run:
        known = {(run.names[m.first], run.names[m.second]): (m.first, m.second) for m, _ in stored_matches(run)}
        if not known:
            raise ProjectError(f"{project.path}: no pair of photographs was matched")
        if tuple(names[::-1]) in known:
            names = names[::-1]
        if names and tuple(names) not in known:
            pairs = ", ".join(" ".join(p) for p in known)
            raise ProjectError(f"the pair {' '.join(names)} is not matched; the pairs are: {pairs}")
        first, second = names if names else next(iter(known))
        pair = known[first, second]
        features = [stored_features(run, i) for i in pair]
    index = candidate_matches(features[0], features[1], replace(project.matching, ratio=ratio))
    cameras = [project.cameras[project.photographs[i].camera] for i in pair]
    pixel = [undistort(c, f.pixel[index[:, k]]) for k, (c, f) in enumerate(zip(cameras, features, strict=True))]
    return first, second, pixel[0], pixel[1]


def study_pair(
    project: Project,
    names: Sequence[str],
    ratio: float,
    counts: Sequence[int],
    sizes: Sequence[int],
    limits_px: Sequence[float],
    seed: int,
    residual: Residual,
) -> PairStudy:
    """Run RANSAC on one pair with every number of iterations, sample size and threshold in px. Needs the stage
    `matches`. Raises ProjectError where the pair is not matched, PhotogramError where its matches are too few."""
    first, second, first_px, second_px = candidate_pixels(project, names, ratio)
    result = study_ransac(first_px, second_px, counts, sizes, limits_px, seed, residual)
    return PairStudy(first, second, ratio, result)


def write_study(results: Path | str, study: PairStudy) -> Path:
    """Write the figures of a study and pictures of them within a folder of results; returns where they are.
    Raises WorkspaceError where a file cannot be written."""
    results = Path(results)
    result, folder = study.result, results / STUDY
    make_folder(results)
    make_folder_within(folder.parent)
    make_folder_within(folder)
    for number, threshold in enumerate(result.thresholds_px):
        unit = "" if result.residual == "algebraic" else "px"
        inliers_by_iteration(folder / f"ransac_iterations_{threshold:g}{unit}.png", result, number)
    inliers_by_sample_size(folder / "ransac_sample_size.png", result)
    write_json(
        folder / "ransac.json",
        {
            "pair": [study.first, study.second],
            "candidates": result.points,
            "ratio": study.ratio,
            "residual": result.residual,
            "iterations": result.iterations,
            "sample_sizes": result.sample_sizes,
            "thresholds_px": result.thresholds_px,
            "best_inliers": result.best_inliers,
            "inlier_fraction": result.inlier_fraction,
            "needed_iterations": np.array(
                [[needed_iterations(float(w), n) for w in result.inlier_fraction] for n in result.sample_sizes]
            ),
        },
    )
    return folder
