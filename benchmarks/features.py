"""Detectors side by side, on the same photographs at the same settings: seconds, photographs, tie points, check points.

    python benchmarks/features.py [--detectors sift sift_opencv orb] [--surveys simulated brighton_beach]
        [--settings default …] [--repeat 3] [--photographs N] [--data DATA]

The simulated survey is that of `photogram demo`, whose check points are compared with their truth; brighton_beach is a
real one of 18 photographs of 9 Mpx without check points, from DATA. Each is adjusted with every detector at every
setting, dense matching and products left out.

`s, one thread` is what one photograph takes from decoded pixels to key points: the fastest of the rounds, in which the
detectors take turns, the median over the photographs (N of them, spread over the survey). `features` and `matches` are
seconds of the stages, all cores at work. Tie points are those of the adjustment, with those measured by correlation.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from lib.shared_data import SHARED_DATA
from threadpoolctl import threadpool_limits

from photogram.arrays import ByteArray
from photogram.files.npz_json import read_json
from photogram.files.photographs.images import read_photograph
from photogram.pipeline.new_project import init
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.report.record.report import Report, oriented
from photogram.sfm.tie_points.detector import DETECTORS, FeatureSettings
from photogram.sfm.tie_points.features import find_features
from photogram.simulation.demonstration import write_demonstration

SETTINGS: Mapping[str, dict[str, Any]] = {
    "default": {},
    "4000 key points": {"features": {"maximum": 4000}},
    "doubled": {"features": {"doubled": "yes"}},
    "contrast 0.01": {"features": {"contrast_threshold": 0.01}},
    "quality medium": {"quality": "medium"},
}
"""What differs from the defaults; `doubled` is for SIFT alone."""

SURVEYS = ("simulated", "brighton_beach")
HEADER = (
    f"{'survey':14s} {'setting':16s} {'detector':12s} {'s, one thread':>13s} {'features':>8s} {'matches':>8s}"
    f" {'photographs':>11s} {'tie points':>10s} {'3 rays':>7s} {'observ.':>8s} {'px':>6s}"
    f" {'check, h m':>10s} {'v m':>6s}"
)


@dataclass(frozen=True)
class Row:
    """A survey with a detector at a setting; seconds of one photograph, and of two stages."""

    one_thread_s: float
    features_s: float
    matches_s: float
    report: Report
    check_m: tuple[float, float] | None
    """RMSE at check points in plan and height, against their truth; None without."""


def drafted(survey: str, data: Path, folder: Path) -> Path:
    """Return the project file of a survey, drafted in a folder."""
    if survey == "simulated":
        return write_demonstration(folder, 1, lambda *_: None, dense=False)
    folder.mkdir()
    return init(data / survey / "images", project=folder / "project.yaml").path


def with_settings(drawn: Path, detector: str, setting: str) -> Path:
    """Return a project file beside the drafted one, with folders of its own, that differs by detector and setting."""
    name = f"{detector} {setting}".replace(" ", "_")
    values, own = yaml.safe_load(drawn.read_text(encoding="utf-8")), SETTINGS[setting]
    for block in ("dense", "orthophoto", "contours"):
        values[block] = {"enabled": False}
    values |= {**own, "work": f"work_{name}", "results": f"results_{name}"}
    values["features"] = {**own.get("features", {}), "detector": detector}
    path = drawn.with_name(f"{name}.yaml")
    path.write_text(yaml.safe_dump(values, allow_unicode=True, sort_keys=False), encoding="utf-8")
    return path


def seconds_of_one(settings: FeatureSettings, reduction: int, pictures: Sequence[ByteArray]) -> float:
    """Return the median seconds of the search in a photograph, with one thread."""
    took = []
    for pixels in pictures:
        began = time.perf_counter()
        find_features("", pixels, settings, reduction)
        took.append(time.perf_counter() - began)
    return float(np.median(took))


def fastest(projects: Mapping[str, Project], photographs: int, rounds: int) -> dict[str, float]:
    """Return the seconds of one photograph by detector: the fastest of the rounds, after one that does not count."""
    first = next(iter(projects.values()))
    chosen = np.unique(np.linspace(0, len(first.photographs) - 1, photographs).round().astype(int)).tolist()
    pictures = [read_photograph(first.photographs[i].path) for i in chosen]
    seconds = dict.fromkeys(projects, np.inf)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            for number in range(rounds + 1):
                for name, project in projects.items():
                    took = seconds_of_one(project.features, REDUCTIONS[project.quality], pictures)
                    seconds[name] = min(seconds[name], took if number else np.inf)
    finally:
        cv2.setNumThreads(threads)
    return seconds


def check_points_m(report: Report, truth: Path) -> tuple[float, float] | None:
    """Return the RMSE of adjusted check points in plan and height, against the truth, None where none is known."""
    if not truth.is_file():
        return None
    known = read_json(truth)["ground_points_map_m"]
    checks = {p["name"]: p["adjusted_map_m"] for p in report["control_points"] if p["role"] == "check"}
    square = np.square([np.subtract(place, known[n]) for n, place in checks.items() if place is not None]).mean(axis=0)
    return float(np.sqrt(square[0] + square[1])), float(np.sqrt(square[2]))


def adjusted(project: Project, one_thread_s: float) -> Row:
    """Adjust a project and return its figures."""
    report = run_pipeline(project)
    seconds = report["seconds"]
    truth = project.path.with_name("truth.json")
    return Row(one_thread_s, seconds["features"], seconds["matches"], report, check_points_m(report, truth))


def lines(
    survey: str, setting: str, drawn: Path, detectors: Sequence[str], photographs: int, rounds: int
) -> Iterator[str]:
    """Yield the line of each detector on a survey at a setting."""
    projects = {name: load_project(with_settings(drawn, name, setting)) for name in detectors}
    seconds = fastest(projects, photographs, rounds)
    for name, project in projects.items():
        row = adjusted(project, seconds[name])
        adjustment = row.report["adjustment"]
        many = sum(count for rays, count in adjustment["tie_points_by_rays"].items() if int(rays) >= 3)
        of_all = f"{len(oriented(row.report['photographs']))} of {len(project.photographs)}"
        plan, height = ("–", "–") if row.check_m is None else (f"{value:.3f}" for value in row.check_m)
        rms_px = adjustment["reprojection_rms_px"]
        yield (
            f"{survey:14s} {setting:16s} {name:12s} {row.one_thread_s:13.3f} {row.features_s:8.1f} {row.matches_s:8.1f}"
            f" {of_all:>11s} {adjustment['tie_points']:10d} {many:7d} {adjustment['observations']:8d}"
            f" {'–' if rms_px is None else f'{rms_px:.3f}':>6s} {plan:>10s} {height:>6s}"
        )


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--detectors", nargs="+", choices=DETECTORS, default=["sift", "sift_opencv", "orb"])
    parser.add_argument("--surveys", nargs="+", choices=SURVEYS, default=list(SURVEYS))
    parser.add_argument("--settings", nargs="+", choices=list(SETTINGS), default=list(SETTINGS))
    parser.add_argument("--repeat", type=int, default=3, help="rounds that are timed")
    parser.add_argument("--photographs", type=int, default=4, help="that are timed, spread over the survey")
    parser.add_argument("--data", type=Path, default=SHARED_DATA)
    given = parser.parse_args()
    print(HEADER)
    with tempfile.TemporaryDirectory() as folder:
        for survey in given.surveys:
            drawn = drafted(survey, given.data, Path(folder) / survey)
            for setting in given.settings:
                for line in lines(survey, setting, drawn, given.detectors, given.photographs, given.repeat):
                    print(line, flush=True)


if __name__ == "__main__":
    main()
