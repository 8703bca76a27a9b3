"""photogram study: experiments for students on the pieces of the chain."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
import typer
from rich.table import Table

from photogram.camera import undistort
from photogram.cli.adjust import Photographs, ProjectFile
from photogram.cli.app import app
from photogram.cli.terminal import Terminal, bars, console
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, make_folder_within
from photogram.matching import candidate_matches
from photogram.pipeline import load_project, open_run, run_pipeline
from photogram.project import Project
from photogram.ransac_study import RansacStudy, needed_iterations
from photogram.ransac_study import study as study_ransac
from photogram.report.study_pictures import inliers_by_iteration, inliers_by_sample_size
from photogram.survey import FloatArray
from photogram.workspace import write_json

experiments = typer.Typer(help="Experiments for students on the pieces of the chain.", no_args_is_help=True)
app.add_typer(experiments, name="study")


def _numbers(text: str, option: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as fault:
        raise typer.BadParameter(f"{option}: {text!r} is not a list of numbers such as 8,10,12") from fault
    return values


def _counts(text: str, option: str) -> list[int]:
    values = _numbers(text, option)
    if any(not value.is_integer() for value in values):
        raise typer.BadParameter(f"{option}: {text!r} is not a list of whole numbers such as 8,10,12")
    return [int(value) for value in values]


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


@experiments.command()
def ransac(
    project: ProjectFile,
    photographs: Photographs = None,
    pair: Annotated[
        tuple[str, str] | None, typer.Option(help="The two photographs; the first matched pair if not given.")
    ] = None,
    iterations: Annotated[str, typer.Option(help="Numbers of iterations.")] = "10,100,1000",
    sample_sizes: Annotated[str, typer.Option(help="Matches per sample, 8 and more.")] = "8,10,12,16,24",
    thresholds: Annotated[str, typer.Option(help="Thresholds in px.")] = "0.5,1,2,4",
    residual: Annotated[
        Literal["sampson", "symmetric", "algebraic"], typer.Option(help="Distance that is tested.")
    ] = "sampson",
    ratio: Annotated[
        float,
        typer.Option(min=0.01, max=1.0, help="Ratio test of the candidates; nearer to 1 lets more wrong ones through."),
    ] = 0.95,
    seed: Annotated[int, typer.Option(help="Seed of the random samples.")] = 0,
) -> None:
    """Run the textbook RANSAC with the 8-point algorithm on candidate matches, and plot its inliers."""
    sizes, counts = _counts(sample_sizes, "--sample-sizes"), _counts(iterations, "--iterations")
    limits_px = _numbers(thresholds, "--thresholds")
    survey = load_project(project, photographs)
    with bars() as progress:
        run_pipeline(survey, watcher=Terminal(progress), until="matches")
    first, second, first_px, second_px = _candidates(survey, list(pair) if pair else [], ratio)
    result = study_ransac(first_px, second_px, counts, sizes, limits_px, seed, residual)
    console.print(f"{first} and {second}: {result.points} candidate matches at ratio {ratio:g}, {residual} distance")
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
    console.print(f"Written: {folder}")
