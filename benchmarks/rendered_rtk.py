"""Rendered RTK surveys without control, by `photogram init` and `photogram adjust` as they are: is the block as good as
it may be, and does its cloud say how good?

    python benchmarks/rendered_rtk.py [SEEDS]                   default: 7, some minutes each on two cores

28 photographs of 1200 × 900 px straight down from one height over terrain, buildings and trees; positions by RTK to
1.5 and 2.5 cm from a base whose coordinates are off by 2, 2, 3 cm (standard deviations; nothing states it), the maker's
calibration in the tags. Each survey is adjusted as `init` drafts it, and once more with the stated sigmas and no common
errors. Simulated.

block: what neighbouring points have in common of their errors in height, without that of the base, which nothing in
such a survey can tell: means over the squares of a 6 × 6 grid, RMS, in mm; shape: without the mean of the whole. check:
RMS at check points, plan and height, mm, with the base's error. z: heights of the cloud on open terrain over their
sigma, with the base's error, RMS of those within 5.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from lib.common_errors import base_off

from photogram.arrays import FloatArray
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.simulation.scene import terrain_height
from photogram.simulation.simulated_survey import SimulatedSurvey, render_photographs, simulate
from photogram.simulation.survey_files import write_survey
from photogram.simulation.survey_plan import rtk_plan
from photogram.survey import Photograph

WAYS: dict[str, dict[str, Any]] = {
    "default": {},
    "as stated": {"estimate_sigmas": False, "common_errors": "none"},
}
GRID, OFF_TERRAIN_M, BEYOND = 6, 0.3, 5.0


@dataclass(frozen=True)
class Outcome:
    """Errors of one adjustment, m, and of heights in sigmas; ``sigma_px`` the median used of tie points."""

    block_m: float
    shape_m: float
    plan_m: float
    height_m: float
    z: float
    sigma_px: float


def draft(folder: Path, crs: str) -> dict[str, Any]:
    """Return the project that `photogram init` writes, ready for sparse work alone."""
    path = folder / "drafted.yaml"
    command = [str(Path(sys.executable).with_name("photogram")), "init", str(folder / "photographs")]
    options = ["--crs", crs, "--heights", "ellipsoidal", "--project", str(path), "--check", str(folder / "check.txt")]
    subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
    values: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return values | {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}


def common_m(place: FloatArray, error: FloatArray) -> FloatArray:
    """Return the means of errors (N,) at places (N, 2) in the squares of a grid that hold ten points and more."""
    low, extent = place.min(axis=0), np.ptp(place, axis=0)
    row, column = np.minimum((place - low) / extent * GRID, GRID - 1).astype(np.int64).T
    square = row * GRID + column
    count = np.bincount(square, minlength=GRID**2)
    return np.asarray(np.bincount(square, error, GRID**2)[count >= 10] / count[count >= 10])


def adjusted(
    folder: Path, values: dict[str, Any], survey: SimulatedSurvey, base_height_m: float, settings: dict[str, Any]
) -> Outcome:
    """Adjust the survey in one way and compare it with the truth; its base is off by ``base_height_m``."""
    project = folder / "project.yaml"
    changed = {**values, "adjustment": {**values.get("adjustment", {}), **settings}}
    project.write_text(yaml.safe_dump({**changed, "work": "work", "results": "results"}, sort_keys=False))
    run_pipeline(load_project(project), until="adjustment")
    with open_run(load_project(project)) as opened:
        result, frame = stored_adjustment(opened), opened.block().frame
    ties, to_truth = result.block.tie_points, survey.frame.world_from_map
    place = to_truth(frame.map_from_world(ties.position_world_m))
    error = place[:, 2] - terrain_height(survey.seed, survey.plan.relief_m, place[:, :2])
    sigma = np.sqrt(result.covariances.tie_point_m2[:, 2, 2])
    open_ground = np.abs(error) < OFF_TERRAIN_M
    squares = common_m(place[open_ground, :2], error[open_ground] - base_height_m)
    z = (error / sigma)[open_ground]
    points, truth = result.block.control_points, survey.truth.control_position_world_m
    at_checks = (
        to_truth(frame.map_from_world(result.estimates.ground_world_m))
        - truth[[_number(survey, n) for n in points.name]]
    )
    return Outcome(
        float(np.sqrt(np.mean(squares**2))), float(np.std(squares)),
        float(np.sqrt(np.nanmean(np.sum(at_checks[:, :2] ** 2, axis=1)))),
        float(np.sqrt(np.nanmean(at_checks[:, 2] ** 2))),
        float(np.sqrt(np.mean(z[np.abs(z) < BEYOND] ** 2))), float(np.median(ties.sigma_px)),
    )  # fmt: skip


def _height_m(photographs: tuple[Photograph, ...]) -> float:
    return float(np.mean([p.gnss_world_m[2] for p in photographs if p.gnss_world_m is not None]))


def _number(survey: SimulatedSurvey, name: str) -> int:
    return survey.control_points.name.index(name)


def main() -> None:
    """Print a line for each survey and way, and the root mean squares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("seeds", type=int, nargs="?", default=7)
    found: dict[str, list[Outcome]] = {name: [] for name in WAYS}
    print("seed  way          block   shape   check plan  height      z  tie points px")

    def line(title: str, o: Outcome) -> str:
        mm = [1e3 * value for value in (o.block_m, o.shape_m, o.plan_m, o.height_m)]
        return f"{title:<17}{mm[0]:7.1f} {mm[1]:7.1f} {mm[2]:12.1f} {mm[3]:7.1f} {o.z:6.2f} {o.sigma_px:14.3f}"

    for seed in range(1, parser.parse_args().seeds + 1):
        with tempfile.TemporaryDirectory() as name:
            folder, survey = Path(name), simulate(rtk_plan(), seed)
            pictures, true = render_photographs(survey), survey.photographs
            photographs = base_off(true, survey.truth.poses, np.random.default_rng([seed, 12]))
            survey = replace(survey, photographs=photographs)
            base_height_m = _height_m(photographs) - _height_m(true)
            write_survey(folder, survey, pictures)
            values = draft(folder, survey.frame.crs)
            for way, settings in WAYS.items():
                found[way].append(adjusted(folder, values, survey, base_height_m, settings))
                print(line(f"{seed:4d}  {way}", found[way][-1]), flush=True)
    for way, each in found.items():
        each_m = np.array([[o.block_m, o.shape_m, o.plan_m, o.height_m, o.z, o.sigma_px] for o in each])
        figures = np.sqrt(np.mean(each_m**2, axis=0))
        print(line(f"RMS   {way}", Outcome(*figures.tolist())))


if __name__ == "__main__":
    main()
