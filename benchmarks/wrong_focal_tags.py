"""Rendered surveys whose tags give a wrong focal length: what the check points say, and what is rejected.

    python benchmarks/wrong_focal_tags.py [SEEDS]               default: 5, some 8 minutes each on two cores
    python benchmarks/wrong_focal_tags.py 3 --readout 0.033 --off 0 10        a rolling shutter, at 5 m/s

15 to 24 photographs straight down over buildings and trees, GNSS of 2 m, 4 to 6 control points of 3 to 5 cm, ten check
points. `photogram init` drafts each project from the photographs' tags; then the 35 mm equivalent is changed by so many
per cent, and the focal length, its readings and sigmas are those that init would write for it. Key points are found
once, and matched once for every error of the tags. Errors are adjusted minus true positions of the check points, in
GSD; z is the error over its predicted standard deviation, root mean square. Without control points the datum is GNSS's,
and the height of the block is what is tested.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from photogram.files.npz_json import read_json
from photogram.files.photographs.images import read_tags
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import stored_adjustment, stored_verdict
from photogram.project.draft.cameras import SIGMA_NAMES, tagged_camera
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate, whole_survey_plan
from photogram.simulation.survey_files import write_survey

OFF_PERCENT = (0, -5, 5, -10, 10, -15, 15, 20)
SHAPES = ((3, 5), (3, 6), (4, 5), (4, 6), (3, 7))
CONTROL, SIGMAS_M = (4, 6, 5, 4, 6), (0.03, 0.05, 0.04, 0.03, 0.05)
PLAN_GSD, HEIGHT_GSD = 1.0, 1.5
"""Errors of check points, in GSD, that a survey with right tags stays below."""


@dataclass(frozen=True)
class Outcome:
    """One run: errors at check points in plan and height, in GSD, their z, the focal length, and what was accused."""

    off_percent: int
    control: bool
    plan_gsd: float
    height_gsd: float
    z: tuple[float, float]
    focal_px: float
    focal_sigma_px: float
    accused_control: int
    blunders: tuple[str, ...]


def plan_of(seed: int, readout_s: float) -> SurveyPlan:
    """Return the plan of a survey of an ordinary consumer drone."""
    n = (seed - 1) % len(SHAPES)
    strips, per_strip = SHAPES[n]
    return replace(
        whole_survey_plan(), strips=strips, photographs_per_strip=per_strip, control_points=CONTROL[n],
        control_sigma_m=(SIGMAS_M[n],) * 3, check_points=10, readout_s=readout_s,
    )  # fmt: skip


def draft(folder: Path, control: bool, crs: str) -> dict[str, Any]:
    """Return the project that `photogram init` writes for the survey in ``folder``, ready for sparse work alone."""
    points = ["--control", str(folder / "points.csv"), "--marks", str(folder / "marks.csv")]
    path = folder / f"drafted_{control}.yaml"
    given = points if control else ["--check", str(folder / "check.txt")]
    command = Path(sys.executable).with_name("photogram")
    options = ["--crs", crs, "--heights", "ellipsoidal", "--project", str(path), *given]
    subprocess.run([command, "init", folder / "photographs", *options], check=True, stdout=subprocess.DEVNULL)
    values: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return values | {"dense": {"enabled": False}, "orthophoto": {"enabled": False}}


def with_tags(values: dict[str, Any], folder: Path, off_percent: int) -> dict[str, Any]:
    """Return the project as init would write it if the 35 mm equivalents were so many per cent off."""
    ((name, camera),) = values["cameras"].items()
    tags = [read_tags(path) for path in sorted((folder / "photographs").glob("*.JPG"))]
    wrong = [replace(t, focal_35mm_mm=round((t.focal_35mm_mm or 0.0) * (1.0 + off_percent / 100.0))) for t in tags]
    tagged = tagged_camera(name, wrong, None)
    if tagged is None:
        raise SystemExit(f"{folder}: the tags give no focal length")
    sigmas = {k: float(s) for k, s in zip(SIGMA_NAMES, tagged.sigmas, strict=True) if s > 0.0}
    if tagged.shutter is not None and tagged.shutter.sigma_s > 0.0:
        sigmas["readout_s"] = tagged.shutter.sigma_s
    changed = {"focal_px": float(tagged.focal_px), "sigmas": sigmas, "focal_readings_px": list(tagged.readings_px)}
    return {**values, "cameras": {name: {**camera, **changed}}}


def work_folder(folder: Path, off_percent: int) -> Path:
    """Return the work folder of both runs with the same tags: what is found before control points count is shared."""
    return folder / f"work_{off_percent:+d}"


def run(folder: Path, values: dict[str, Any], off_percent: int, control: bool) -> Outcome:
    """Adjust the survey and compare its check points with the truth."""
    name = f"{off_percent:+d}_{'control' if control else 'gnss'}"
    work, project = work_folder(folder, off_percent), folder / f"{name}.yaml"
    values = {**with_tags(values, folder, off_percent), "work": str(work), "results": str(folder / f"results_{name}")}
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    found = folder / "features"
    if found.is_dir() and not work.exists():
        work.mkdir()
        shutil.copytree(found, work / "features.stage")
    run_pipeline(load_project(project), until="adjustment")
    if not found.is_dir():
        shutil.copytree(work / "features.stage", found)
    with open_run(load_project(project)) as opened:
        result, verdict, block = stored_adjustment(opened), stored_verdict(opened), opened.block()
    truth = read_json(folder / "truth.json")
    points, camera = block.control_points, result.block.cameras[0]
    check = [g for g, role in enumerate(points.role) if role == "check"]
    right = block.frame.world_from_map(np.array([truth["ground_points_map_m"][points.name[g]] for g in check]))
    error = result.estimates.ground_world_m[check] - right
    z = error / np.sqrt(np.einsum("gii->gi", result.covariances.ground_m2[check]))
    gsd = float(truth["gsd_m"])
    accused = sum(kind == "control point" for kind, *_ in verdict["accused"])
    return Outcome(
        off_percent, control, float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))) / gsd,
        float(np.sqrt(np.mean(error[:, 2] ** 2))) / gsd,
        (float(np.sqrt(np.mean(z[:, :2] ** 2))), float(np.sqrt(np.mean(z[:, 2] ** 2)))),
        camera.focal_px, float(np.sqrt(result.covariances.calibration[0, 0, 0])), accused,
        tuple(b["kind"] for b in verdict["blunders"]),
    )  # fmt: skip


def show(title: str, outcomes: list[Outcome], focal_px: float) -> None:
    """Print one row for each error of the tags, over all seeds."""
    print(f"\n{title}\n   off  surveys   plan, height: worst GSD   z plan, height   f off: worst   control rejected")
    for off in dict.fromkeys(o.off_percent for o in outcomes):
        mine = [o for o in outcomes if o.off_percent == off]
        z = np.sqrt(np.mean(np.square([o.z for o in mine]), axis=0))
        focal = max(abs(o.focal_px / focal_px - 1.0) for o in mine)
        accused = sum(o.accused_control for o in mine)
        print(
            f"{off:+5d}%{len(mine):8d}{max(o.plan_gsd for o in mine):15.2f}{max(o.height_gsd for o in mine):8.2f}"
            f"{z[0]:13.2f}{z[1]:7.2f}{focal:14.2%}{accused:17d}"
        )


def main() -> None:
    """Print the tables with and without control points."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("seeds", nargs="?", type=int, default=5)
    parser.add_argument("--off", nargs="+", type=int, default=OFF_PERCENT, help="errors of the tags, per cent")
    parser.add_argument("--readout", type=float, default=0.0, help="seconds from the first to the last row")
    given = parser.parse_args()
    outcomes: list[Outcome] = []
    for seed in range(1, given.seeds + 1):
        with tempfile.TemporaryDirectory() as name:
            folder, survey = Path(name), simulate(plan_of(seed, given.readout), seed)
            write_survey(folder, survey, render_photographs(survey))
            drafted = {control: draft(folder, control, survey.plan.crs) for control in (True, False)}
            for off in given.off:
                for control, values in drafted.items():
                    outcomes.append(run(folder, values, off, control))
                    print(f"seed {seed}: {outcomes[-1]}", flush=True)
                shutil.rmtree(work_folder(folder, off))
    focal_px = whole_survey_plan().focal_px
    with_control, without = ([o for o in outcomes if o.control == wanted] for wanted in (True, False))
    print("\nsimulated; check points against their true positions")
    show("with control points", with_control, focal_px)
    good = np.mean([o.plan_gsd <= PLAN_GSD and o.height_gsd <= HEIGHT_GSD for o in with_control])
    print(f"within {PLAN_GSD:g} GSD in plan and {HEIGHT_GSD:g} in height: {good:.1%} of {len(with_control)} surveys")
    show("GNSS of 2 m alone", without, focal_px)


if __name__ == "__main__":
    main()
