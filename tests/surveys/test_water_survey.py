"""A simulated survey over a pond whose waves move: where water is asked for, the surface is level there, and shown."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from makers import undrawing_unless_all
from scipy.ndimage import distance_transform_edt
from seeds import ALL

from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, remaining_stages, run_pipeline
from photogram.report.record.report import Report
from photogram.result_files import result_path
from photogram.simulation.cover.leaves import CoverPlan
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.scene import Material
from photogram.simulation.simulated_survey import CoveredPlan, SimulatedSurvey, simulate
from photogram.surface.dsm import INTERPOLATED, WATER

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
    assert left == ("surface", "volumes", "relief", "orthophoto", "results")
    with undrawing_unless_all():
        return {**found, "water": (second, run_pipeline(load_project(second / "project.yaml")))}


def raster(folder: Path, name: str) -> np.ndarray:
    with rasterio.open(result_path(folder / "results", name)) as file:
        bands = file.read().astype(float)
    return np.asarray(np.where(bands == -9999.0, np.nan, bands))


def test_the_pond_is_level_and_shown_and_no_land_is_taken_for_it(both: dict[str, tuple[Path, Report]]) -> None:
    folder, report = both["water"]
    with rasterio.open(folder / "results" / "quality/dsm_source.tif") as file:
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
    with rasterio.open(folder / "results" / "deliverables/orthophoto.tif") as file:
        shown = np.array(list(file.sample(np.column_stack([east, north]), indexes=4)))
    assert (shown == 255).all()
    said = report["dense"]["water"]
    assert said["cells"] == found.sum()
    assert len(said["areas"]) == 1
    assert said["areas"][0]["level_map_m"] == pytest.approx(filled[found][0], abs=1e-3)
    page = (folder / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    assert "in 1 area where nothing matches" in page


def test_the_rest_of_the_surface_is_as_it_was(both: dict[str, tuple[Path, Report]]) -> None:
    before, after = both["none"][0], both["water"][0]
    # far from heights what is interpolated follows the water as well
    dry = ~np.isin(raster(after, "dsm_source.tif")[0], (WATER, INTERPOLATED))
    for name in ("dsm", "dsm_filled", "dsm_sigma", "dsm_source"):
        assert np.array_equal(raster(before, f"{name}.tif")[0][dry], raster(after, f"{name}.tif")[0][dry], True)
    assert "water" not in both["none"][1]["dense"]
    assert "masks" not in both["water"][1]


def photographs_showing(report: Report, places_map_m: np.ndarray) -> np.ndarray:
    """Return how many photographs show places (N, 3) of the map, by the formulas of the Brown model alone."""
    count = np.zeros(len(places_map_m), dtype=int)
    for photograph in report["photographs"].values():
        assert photograph["registered"]
        camera = report["cameras"][photograph["camera"]]
        R = np.array(photograph["rotation_camera_from_map"]).reshape(3, 3)
        seen = (places_map_m - photograph["position_map_m"]) @ R.T
        x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        square = x * x + y * y
        (k1, k2, k3, *_), (p1, p2) = camera["radial"], camera["tangential"]
        radial = 1.0 + k1 * square + k2 * square**2 + k3 * square**3
        cx, cy = camera["principal_point_px"]
        u = cx + camera["focal_px"] * (x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x))
        v = cy + camera["focal_px"] * (y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y)
        within = (u >= -0.5) & (v >= -0.5) & (u <= camera["width_px"] - 0.5) & (v <= camera["height_px"] - 0.5)
        count += within & (seen[:, 2] > 0) & (square < 1.0)
    return count


@pytest.mark.parametrize("name", ["none", "water"])
def test_areas_are_those_of_the_rasters_and_of_the_poses(both: dict[str, tuple[Path, Report]], name: str) -> None:
    """One statement of areas: report.json, page and terminal hold what the rasters hold, and what the poses show."""
    folder, report = both[name]
    code, filled = raster(folder, "dsm_source.tif")[0].astype(int), raster(folder, "dsm_filled.tif")[0]
    dense, overlap = report["dense"], report["block"]["overlap"]
    assert overlap is not None
    areas, cell_m2 = dense["areas"], dense["cell_m"] ** 2
    cells = np.bincount(code[code != 255].ravel(), minlength=8)
    assert areas["measured_m2"] == pytest.approx(cells[[1, 3, 4, 5]].sum() * cell_m2)
    assert areas["measured_m2"] == pytest.approx(np.isfinite(raster(folder, "dsm.tif")).sum() * cell_m2)
    assert areas["filled_m2"] == pytest.approx(cells[2] * cell_m2)
    assert areas["water_m2"] == pytest.approx(cells[6] * cell_m2)
    told = [areas[key] for key in ("measured_m2", "filled_m2", "water_m2", "interpolated_m2")]
    assert areas["mapped_m2"] == pytest.approx(sum(told))
    assert areas["interpolated_m2"] == pytest.approx(cells[7] * cell_m2)
    assert np.isfinite(filled).sum() * cell_m2 == pytest.approx(sum(told))
    rows = int(1.5 * max(filled.shape))
    wide = np.pad(filled, rows, constant_values=np.nan)
    known, at = np.isfinite(wide), distance_transform_edt(np.isnan(wide), return_distances=False, return_indices=True)
    row, column = np.mgrid[: wide.shape[0], : wide.shape[1]]
    with rasterio.open(folder / "results" / "deliverables/dsm_filled.tif") as file:
        corner = file.transform
    east = corner.c + (column - rows + 0.5) * dense["cell_m"]
    north = corner.f - (row - rows + 0.5) * dense["cell_m"]
    step = 3
    places = np.stack([east, north, np.where(known, wide, wide[tuple(at)])], axis=-1)[::step, ::step]
    seen = photographs_showing(report, places.reshape(-1, 3))
    again_m2 = np.count_nonzero(seen >= 2) * cell_m2 * step**2
    assert overlap["area_m2"] == areas["mapped_m2"] == pytest.approx(again_m2, rel=0.03)
    assert overlap["share_3_or_more"] == pytest.approx(np.mean(seen[seen >= 2] >= 3), abs=0.02)
    seen_twice_m2 = dense["cells"]["seen_2_or_more"] * cell_m2
    assert areas["seen_3_or_more_m2"] == pytest.approx(overlap["share_3_or_more"] * seen_twice_m2)
    assert abs(overlap["median"] - np.median(seen[seen >= 2])) <= 1
    page = (folder / "results" / "deliverables/report.html").read_text(encoding="utf-8")
    for key in ("mapped_m2", "measured_m2", "filled_m2", "interpolated_m2"):
        assert f"{areas[key]:,.0f} m²".replace(",", "\u202f") in page, key
