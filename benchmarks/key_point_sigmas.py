"""Scatter of tie-point residuals by the size of their key points, in surveys that `photogram adjust` has finished.

    python benchmarks/key_point_sigmas.py [PROJECT …] [--data DATA]

Each PROJECT is a project.yaml with its folders work/ and results/. Without one seven surveys are adjusted: the
simulated one of `photogram demo`, oriented by growth, at high, medium and low quality; sheffield_cross at high and
medium and brighton_beach at high and low quality, both in DATA, as `photogram init` drafts them.

Residuals of points with three rays or more are divided by sqrt((2n − 3)/2n), which the adjustment of a point of n rays
takes from its errors; the scatter is 1.4826 times the median of their absolute values. Sizes are in units of the
smallest key points. Surveys are adjusted with adjustment.estimate_sigmas: false, as a PROJECT must be: the law of
sigmas is judged as stated.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml
from lib.shared_data import SHARED_DATA

from photogram.files.records import read_record
from photogram.pipeline.pipeline import load_project
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.results import Estimates
from photogram.sfm.tie_points.detector import detector_named
from photogram.simulation.demonstration import write_demonstration
from photogram.survey import TRANSFERRED, Features, TiePoints

EDGES = (1.0, 2.0, 4.0, 8.0, 16.0, np.inf)
FEWEST = 60  # observations that make a figure


def relative_sizes(project: Project, work: Path, tie: TiePoints) -> np.ndarray:
    """Return the size (N,) of each observation's key point over that of the smallest; NaN where it has none."""
    size, detector = np.full(len(tie.photograph), np.nan), detector_named(project.features.detector)
    for index in np.unique(tie.photograph).tolist():
        camera = project.cameras[project.photographs[index].camera]
        scale = detector.scale(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])
        own = (tie.photograph == index) & (tie.feature != TRANSFERRED)
        features = read_record(work / "features.stage" / f"{index:05d}.npz", Features)
        size[own] = np.maximum(features.size_px[tie.feature[own]] / (detector.traits.smallest_px * scale), 1.0)
    return size


def scatter(values: np.ndarray) -> str:
    """Return 1.4826 times the median of the absolute values."""
    return f"{1.4826 * np.median(np.abs(values)):.3f}" if len(values) >= FEWEST else "–"


def photogram(*arguments: str) -> None:
    """Run a command of photogram."""
    subprocess.run([sys.executable, "-m", "photogram.cli.main", *arguments], check=True, stdout=subprocess.DEVNULL)


def adjusted_surveys(data: Path, folder: Path) -> Iterator[Path]:
    """Draft and adjust the seven surveys, each in a folder of its own, and yield their projects."""
    control = (
        "--control",
        f"{data}/sheffield_cross/gcp_file.txt",
        "--picture-size",
        "4000x3000",
        "--control-sigma",
        "0.5",
    )
    surveys: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
        "simulated": (("high", "medium", "low"), ()),
        "sheffield_cross": (("high", "medium"), control),
        "brighton_beach": (("high", "low"), ()),
    }
    for name, (qualities, options) in surveys.items():
        for quality in qualities:
            own = folder / f"{name}_{quality}"
            path = own / "project.yaml"
            if name == "simulated":
                path = write_demonstration(own, 1, lambda *_: None, dense=False)
            else:
                own.mkdir()
                photogram("init", f"{data}/{name}/images", *options, "--project", str(path))
            project = yaml.safe_load(path.read_text(encoding="utf-8"))
            project |= {"quality": quality, "dense": {"enabled": False}, "orthophoto": {"enabled": False}}
            project["adjustment"] = {**project.get("adjustment", {}), "estimate_sigmas": False}
            if name == "simulated":
                project["orientation"] = {**project.get("orientation", {}), "method": "growth"}
            path.write_text(yaml.safe_dump(project, allow_unicode=True, sort_keys=False), encoding="utf-8")
            photogram("adjust", str(path))
            yield path


def show(path: Path) -> None:
    """Print the table of a survey."""
    project, work = load_project(path), path.parent / "work"
    tie = read_record(work / "adjustment.stage" / "tie_points.npz", TiePoints)
    rays = tie.rays[tie.point].astype(float)
    error_px = read_record(work / "adjustment.stage" / "estimates.npz", Estimates).residual_px
    error_px = error_px / np.sqrt((2 * rays - 3) / (2 * rays))[:, None]
    size, many = relative_sizes(project, work, tie), rays >= 3
    print(f"\n{path.parent.name}, quality {project.quality}")
    print(f"{'size':>16s} {'number':>8s} {'px':>7s} {'in sigmas':>10s}")
    classes = [(f"{a:g} to {b:g}", (size >= a) & (size < b)) for a, b in pairwise(EDGES)]
    for name, chosen in [*classes, ("by correlation", np.isnan(size))]:
        own = many & chosen
        whitened = error_px[own] / tie.sigma_px[own, None]
        print(
            f"{name:>16s} {np.count_nonzero(own):8d} {scatter(error_px[own]):>7s} {scatter(whitened):>10s}", flush=True
        )


def main() -> None:
    """Print one table for each survey."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("projects", nargs="*", type=Path, metavar="PROJECT")
    parser.add_argument("--data", type=Path, default=SHARED_DATA)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for path in given.projects or adjusted_surveys(given.data, Path(folder)):
            show(path)


if __name__ == "__main__":
    main()
