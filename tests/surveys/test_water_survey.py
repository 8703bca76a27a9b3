"""A simulated survey over a pond whose waves move: where water is asked for, the surface is level there, and shown."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from makers import undrawing_unless_all
from seeds import ALL

from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, remaining_stages, run_pipeline
from photogram.report.record.report import Report
from photogram.simulation.cover.leaves import CoverPlan
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.scene import Material
from photogram.simulation.simulated_survey import CoveredPlan, SimulatedSurvey, simulate
from photogram.surface.dsm import WATER

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
SEED = 4
PLAN = CoveredPlan(
    width_px=720, height_px=540, focal_px=600.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.75,
    strips=3, photographs_per_strip=4, buildings=1, trees=6, relief_m=3.0, cell_m=0.2, control_points=8,
    check_points=0,
    cover=CoverPlan(hedges=0, fences=0, power_lines=0, wood_trees=0, pond_radius_m=15.0, grass=False),
)  # fmt: skip


def kinds(survey: SimulatedSurvey, grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    """Return which cells of a grid are water, and the true height of the ground there."""
    east, north = grid.centres_map_m(grid.whole)
    place = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    world = survey.frame.world_from_map(np.column_stack([place, np.full(len(place), survey.frame.origin_map_m[2])]))
    scene = survey.scene
    column, row = np.rint((world[:, :2] - [scene.west_m, scene.south_m]) / scene.cell_m).astype(int).T
    water = scene.material[row, column] == Material.WATER
    height = scene.height(world[:, :2]) + survey.frame.origin_map_m[2]
    return water.reshape(grid.rows, grid.columns), height.reshape(grid.rows, grid.columns)


@pytest.fixture(scope="module")
def both(edit: Edit, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Report]]:
    """The survey, run without looking for water and with it; not to be written to."""
    first = tmp_path_factory.mktemp("water") / "none"
    write_demonstration(first, SEED, lambda *_: None, PLAN)
    cell_m = 0.2 if ALL else 0.3
    edit(first / "project.yaml", lambda v: v.update(surface={"cell_m": cell_m}, orthophoto={"cell_m": cell_m}))
    with undrawing_unless_all():
        found = {"none": (first, run_pipeline(load_project(first / "project.yaml")))}
    second = first.parent / "water"
    shutil.copytree(first, second)
    edit(second / "project.yaml", lambda v: v["photographs"].update(masks={"auto": ["water"]}))
    left = remaining_stages(load_project(second / "project.yaml"))
    assert left == ("surface", "relief", "orthophoto", "results")
    with undrawing_unless_all():
        return {**found, "water": (second, run_pipeline(load_project(second / "project.yaml")))}


def raster(folder: Path, name: str) -> np.ndarray:
    with rasterio.open(folder / "results" / name) as file:
        bands = file.read().astype(float)
    return np.asarray(np.where(bands == -9999.0, np.nan, bands))


def test_the_pond_is_level_and_shown_and_no_land_is_taken_for_it(both: dict[str, tuple[Path, Report]]) -> None:
    folder, report = both["water"]
    with rasterio.open(folder / "results" / "dsm_source.tif") as file:
        code = file.read(1)
        grid = MapGrid(file.transform.c, file.transform.f, file.transform.a, *file.shape)
    water, height = kinds(simulate(PLAN, SEED), grid)
    found = code == WATER
    assert found[water].mean() > 0.6
    assert found[~water].sum() < 0.03 * water.sum()
    filled, dsm, sigma = (raster(folder, f"{name}.tif")[0] for name in ("dsm_filled", "dsm", "dsm_sigma"))
    assert np.isnan(dsm[found]).all()
    assert np.isnan(sigma[found]).all()
    assert np.ptp(filled[found]) == 0.0
    assert abs(filled[found & water][0] - height[found & water].mean()) < 0.2
    row, column = np.nonzero(found)
    east, north = (at[of] for at, of in zip(grid.centres_map_m(grid.whole), (column, row), strict=True))
    with rasterio.open(folder / "results" / "orthophoto.tif") as file:
        shown = np.array(list(file.sample(np.column_stack([east, north]), indexes=4)))
    assert (shown == 255).all()
    said = report["dense"]["water"]
    assert said["cells"] == found.sum()
    assert len(said["areas"]) == 1
    assert said["areas"][0]["level_map_m"] == pytest.approx(filled[found][0], abs=1e-3)
    page = (folder / "results" / "report.html").read_text(encoding="utf-8")
    assert "in 1 area where nothing matches" in page


def test_the_rest_of_the_surface_is_as_it_was(both: dict[str, tuple[Path, Report]]) -> None:
    before, after = both["none"][0], both["water"][0]
    dry = raster(after, "dsm_source.tif")[0] != WATER
    for name in ("dsm", "dsm_filled", "dsm_sigma", "dsm_source"):
        assert np.array_equal(raster(before, f"{name}.tif")[0][dry], raster(after, f"{name}.tif")[0][dry], True)
    assert "water" not in both["none"][1]["dense"]
    assert "masks" not in both["water"][1]
