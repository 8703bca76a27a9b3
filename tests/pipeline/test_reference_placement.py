"""References beside, above and below a survey are found before anything is compared with them."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from photogram.arrays import FloatArray
from photogram.files.clouds.points import write_cloud
from photogram.files.maps.rasters import write_raster
from photogram.grid import MapGrid
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.pipeline import load_project
from photogram.project.measured.measured_survey import control_positions
from photogram.survey import PointCloud, Raster


def cloud_reference(folder: Path, crs: str, control_m: FloatArray, shift_m: tuple[float, float, float]) -> str:
    write_cloud(folder / "reference.laz", PointCloud(control_m + shift_m), crs)
    return "reference.laz"


def raster_reference(folder: Path, crs: str, control_m: FloatArray, shift_m: tuple[float, float, float]) -> str:
    """A plane through the ground points, in the middle of whose cells it is right."""
    design = np.column_stack([control_m[:, :2] - control_m[0, :2], np.ones(len(control_m))])
    plane = np.linalg.lstsq(design, control_m[:, 2], rcond=None)[0]
    grid = MapGrid.around(control_m, 1.0)
    east, north = grid.centres_map_m(grid.whole)
    height = (east - control_m[0, 0])[None] * plane[0] + (north - control_m[0, 1])[:, None] * plane[1] + plane[2]
    values = (height + shift_m[2]).astype(np.float32)
    raster = Raster(values, grid.west_map_m + shift_m[0], grid.north_map_m + shift_m[1], grid.cell_m)
    write_raster(folder / "reference.tif", raster, crs)
    return "reference.tif"


@pytest.mark.parametrize("written", [cloud_reference, raster_reference])
@pytest.mark.parametrize("control", [True, False])
@pytest.mark.parametrize(
    ("shift_m", "severity", "says"),
    [
        ((20_000.0, 0.0, 0.0), "error", "east of the survey"),
        ((0.0, 0.0, 500.0), "warning", "above the survey: check its height system"),
        ((0.0, 0.0, -500.0), "warning", "below the survey: check its height system"),
        ((0.0, 0.0, 0.0), None, ""),
    ],
)
def test_a_reference_far_off_is_seen_by_the_check(
    survey: Path,
    written: Callable[..., str],
    control: bool,
    shift_m: tuple[float, float, float],
    severity: str | None,
    says: str,
) -> None:
    path = survey / "project.yaml"
    control_m = control_positions(load_project(path))
    name = written(survey, load_project(path).crs, control_m, shift_m)
    values = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not control:
        del values["control_points"]
    path.write_text(yaml.safe_dump(values | {"comparison": {"reference": name}}), encoding="utf-8")
    found = [f for f in check_project(path) if f.where == "comparison.reference"]
    assert [f.severity for f in found] == ([] if severity is None else [severity])
    assert all(says in str(f) for f in found)


def test_a_raster_off_by_the_height_of_a_geoid_is_seen_at_the_ground_points(survey: Path) -> None:
    path = survey / "project.yaml"
    control_m = control_positions(load_project(path))
    name = raster_reference(survey, load_project(path).crs, control_m, (0.0, 0.0, -47.0))
    values = yaml.safe_load(path.read_text(encoding="utf-8")) | {"comparison": {"reference": name}}
    path.write_text(yaml.safe_dump(values), encoding="utf-8")
    (found,) = (f for f in check_project(path) if f.where == "comparison.reference")
    assert re.search(r"it lies 4[5-9]\.\d m below the survey", str(found))
