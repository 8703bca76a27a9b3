"""Make masks.png: the orthophoto of a simulated survey with an object fixed to the camera, without a mask and with one.

    python docs/pictures/masks.py FOLDER

FOLDER takes both surveys, some 100 MB.
"""

import sys
from pathlib import Path

import numpy as np
import rasterio
import yaml
from PIL import Image

import photogram as pg
from photogram.files.photographs.images import read_tags, write_photograph
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.simulation.demonstration import write_demonstration

PLAN = pg.SurveyPlan(
    width_px=480,
    height_px=360,
    focal_px=600.0,
    principal_point_offset_px=(1.0, -0.7),
    calibration_sigmas=(2.0, 1.0, 1.0, 0.004, *(0.0,) * 7),
    flying_height_m=40.0,
    forward_overlap=0.8,
    side_overlap=0.7,
    relief_m=4.0,
    buildings=2,
    trees=4,
    target_radius_m=0.3,
    control_points=8,
    check_points=4,
    control_marks_per_photograph=4,
)
OBJECT = (slice(130, 220), slice(170, 314))


def survey(folder: Path, *, masked: bool) -> Path:
    """Write and run the survey, the object in every photograph; returns its orthophoto."""
    project = write_demonstration(folder, 3, lambda *_: None, PLAN)
    texture = np.kron(np.random.default_rng(1).integers(20, 235, (15, 24)), np.ones((6, 6))).astype(np.uint8)
    for path in sorted((folder / "photographs").iterdir()):
        pixels, tags = pg.read_photograph(path).copy(), read_tags(path)
        pixels[OBJECT] = texture[..., None]
        write_photograph(path, pixels, tags)
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    values["features"], values["surface"], values["orthophoto"] = {"maximum": 1500}, {"cell_m": 0.2}, {"cell_m": 0.1}
    if masked:
        used = np.ones((PLAN.height_px, PLAN.width_px), dtype=bool)
        used[128:222, 168:316] = False
        pg.write_mask(folder / "gear.png", used)
        for camera in values["cameras"].values():
            camera["mask"] = "gear.png"
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    run_pipeline(load_project(project))
    return folder / "results" / "deliverables/orthophoto.tif"


def picture(path: Path) -> np.ndarray:
    """Return an orthophoto (rows, columns, 3) on white."""
    with rasterio.open(path) as file:
        rgba = np.moveaxis(file.read(), 0, -1)
    return np.where(rgba[..., 3:] > 0, rgba[..., :3], 255).astype(np.uint8)


def main() -> None:
    """Make the picture."""
    folder = Path(sys.argv[1])
    shown = [picture(survey(folder / name, masked=name == "masked")) for name in ("free", "masked")]
    rows = min(len(part) for part in shown)
    beside = Image.fromarray(np.concatenate([part[:rows] for part in shown], axis=1))
    with Path(__file__).with_name("masks.png").open("wb") as file:
        beside.quantize(128).save(file, "PNG", optimize=True)


if __name__ == "__main__":
    main()
