"""Bands of a multispectral camera on the orthophoto of their master: rendered surveys against simulated truth.

    python benchmarks/bands.py [--seeds 3] [--makers]

A colour camera and four bands on one body, 1280 × 960 pixels each, 2 × 5 exposures from 60 m, each band with a grey
function (two of them turn bright and dark round), a lens and a place of its own; lenses known as a laboratory
calibrates them, with --makers as makers state them (focal length and principal point to 5 px); relative poses as on a
drawing (0.3°, 5 mm). Run to the orthophoto. `measured` is what the stage reports of a band, root mean square per axis
of its patches in pixels of the orthophoto; `true` how far the adjusted cameras and poses put the image of a place on
the terrain from where the master's put theirs, in the same pixels, to the edges of all photographs.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from lib.simulated.band_survey import BandSurvey, write_band_survey
from lib.simulated.bands import on_terrain

from photogram.camera import Pose
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=5, width_px=1280, height_px=960, focal_px=1440.0, flying_height_m=60.0,
    control_points=6, check_points=2, control_marks_per_photograph=0, gnss_sigma_m=(0.015, 0.015, 0.03),
    gnss_offset_sigma_m=(0.02, 0.02, 0.03),
    calibration_sigmas=(0.5, 0.5, 0.5, 5e-4, 5e-4, 0.0, 0.0, 5e-5, 5e-5, 0.0, 0.0),
)  # fmt: skip
MAKERS = (5.0, 5.0, 5.0, 0.01, 0.01, 0.0, 0.0, 5e-4, 5e-4, 0.0, 0.0)
PLACES, EXTENT_M = 4000, 35.0


def _in_frame(block: Block, photograph: int, frame: LocalFrame) -> Pose:
    """Return an adjusted pose in the frame of the truth, which has its origin at the same place and another height."""
    pose = block.poses[photograph]
    assert pose is not None
    position = frame.world_from_map(block.frame.map_from_world(pose.position_world_m[None]))[0]
    return Pose(pose.rotation_world_from_camera, position)


def true_px(made: BandSurvey, block: Block, band: int, cell_m: float, seed: int) -> float:
    """Return how far a band (from 0) lies off the master on the terrain, root mean square per axis, in pixels."""
    rng, survey = np.random.default_rng([seed, 23]), made.survey
    xy = rng.uniform(-EXTENT_M, EXTENT_M, (PLACES, 2))
    X = np.column_stack([xy, survey.scene.height(xy)])
    count, off = len(survey.truth.poses), []
    for i, pose in enumerate(survey.truth.poses):
        adjusted = [_in_frame(block, i + count * k, survey.frame) for k in (0, band + 1)]
        master = on_terrain((survey.truth.camera, pose), (block.cameras[0], adjusted[0]), X)
        other = on_terrain((made.cameras[band], made.poses[band][i]), (block.cameras[band + 1], adjusted[1]), X)
        off.append((other - master)[np.isfinite(other - master).all(axis=1)])
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2))) / cell_m


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--makers", action="store_true", help="lenses as makers state them")
    given = parser.parse_args()
    plan = replace(PLAN, calibration_sigmas=MAKERS) if given.makers else PLAN
    print("simulated survey, band     patches   mean east, north px   measured RMS px   true RMS px")
    for seed in range(given.seeds):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            made = write_band_survey(folder, plan, seed + 1)
            project = load_project(folder / "project.yaml")
            run_pipeline(project, until="orthophoto")
            stage = folder / "work" / "orthophoto.stage"
            measured = json.loads((stage / "bands.json").read_text(encoding="utf-8"))
            cell_m = json.loads((stage / "grid.json").read_text(encoding="utf-8"))["cell_m"]
            with open_run(project) as run:
                block = block_as_adjusted(run)
            for band, camera in enumerate(made.names):
                found = measured[camera]
                east, north = found["mean_px"]
                print(
                    f"{seed + 1:6} {camera:12}{found['patches']:14}{east:14.2f}{north:8.2f}{found['rms_px']:16.2f}"
                    f"{true_px(made, block, band, cell_m, seed):14.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
