"""What the experiments of `photogram study` do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from photogram.arrays import FloatArray
from photogram.camera import undistort
from photogram.cli.screen.terminal import bars, console
from photogram.cli.screen.watching import Terminal, stage_weights
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, make_folder_within
from photogram.files.npz_json import write_json
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.project.project import Project
from photogram.report.figures.ransac_study import inliers_by_iteration, inliers_by_sample_size
from photogram.sfm.ransac_study import RansacStudy, Residual, needed_iterations
from photogram.sfm.ransac_study import study as study_ransac
from photogram.sfm.tie_points.matching import candidate_matches


def _candidates(project: Project, names: list[str], ratio: float) -> tuple[str, str, FloatArray, FloatArray]:
    """Return the names of a pair and the undistorted pixels (M, 2) of its candidate matches, not verified."""
    with open_run(project) as run:
        known = {(run.names[m.first], run.names[m.second]): (m.first, m.second) for m, _ in run.matches()}
        if tuple(names[::-1]) in known:
            names = names[::-1]
        if names and tuple(names) not in known:
            pairs = ", ".join(" ".join(p) for p in known)
            raise ProjectError(f"the pair {' '.join(names)} is not matched; the pairs are: {pairs}")
        first, second = names if names else next(iter(known))
        pair = known[first, second]
        features = [run.features(i) for i in pair]
    index = candidate_matches(features[0], features[1], replace(project.matching, ratio=ratio))
    cameras = [project.cameras[project.photographs[i].camera] for i in pair]
    pixel = [undistort(c, f.pixel[index[:, k]]) for k, (c, f) in enumerate(zip(cameras, features, strict=True))]
    return first, second, pixel[0], pixel[1]


def _show(result: RansacStudy) -> None:
    best = [f"best of {n}" for n in result.iterations]
    table = Table(
        "sample",
        "threshold" if result.residual == "algebraic" else "px",
        *best,
        "needed for 99 %",
        title="Inliers by sample size and threshold",
    )
    for s, size in enumerate(result.sample_sizes):
        for t, threshold in enumerate(result.thresholds_px):
            needed = float(needed_iterations(float(result.inlier_fraction[t]), size))
            found = [str(int(n)) for n in result.best_inliers[s, t]]
            table.add_row(str(size), f"{threshold:g}", *found, f"{needed:.0f}")
    console.print(table)


def run(
    project: Path,
    photographs: Path | None,
    pair: tuple[str, str] | None,
    counts: list[int],
    sizes: list[int],
    limits_px: list[float],
    residual: Residual,
    ratio: float,
    seed: int,
) -> None:
    """Run RANSAC with many settings on one pair of photographs; show its inliers, and write them and pictures."""
    survey = load_project(project, photographs)
    with bars() as progress:
        run_pipeline(survey, watcher=Terminal(progress, stage_weights(survey, "matches")), until="matches")
    first, second, first_px, second_px = _candidates(survey, list(pair) if pair else [], ratio)
    result = study_ransac(first_px, second_px, counts, sizes, limits_px, seed, residual)
    pictures = f"{escape(first)} and {escape(second)}"
    console.print(f"{pictures}: {result.points} candidate matches at ratio {ratio:g}, {residual} distance")
    _show(result)
    folder = survey.results / "study"
    make_folder(survey.results)
    make_folder_within(folder)
    for number, threshold in enumerate(result.thresholds_px):
        unit = "" if residual == "algebraic" else "px"
        inliers_by_iteration(folder / f"ransac_iterations_{threshold:g}{unit}.png", result, number)
    inliers_by_sample_size(folder / "ransac_sample_size.png", result)
    write_json(
        folder / "ransac.json",
        {
            "pair": [first, second],
            "candidates": result.points,
            "ratio": ratio,
            "residual": residual,
            "iterations": result.iterations,
            "sample_sizes": result.sample_sizes,
            "thresholds_px": result.thresholds_px,
            "best_inliers": result.best_inliers,
            "inlier_fraction": result.inlier_fraction,
            "needed_iterations": np.array(
                [[needed_iterations(float(w), n) for w in result.inlier_fraction] for n in sizes]
            ),
        },
    )
    console.print(f"Written: {escape(str(folder))}", soft_wrap=True)
