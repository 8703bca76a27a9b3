"""A survey with houses and trees: the surface closed within the rim, and the terrain that is made unasked."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import rasterio.features
import shapely
from scipy.interpolate import RegularGridInterpolator

from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, open_run, run_pipeline
from photogram.pipeline.stages.surfaces.closing import stored_closing
from photogram.pipeline.stages.surfaces.relief import ReliefSummary
from photogram.result_files import result_path
from photogram.surface.dsm import FILLED, HOLE, INTERPOLATED, MEASURED_IN, WATER


def raster(survey: Path, name: str) -> np.ndarray:
    with rasterio.open(result_path(survey / "results", name)) as file:
        return np.asarray(file.read(1, masked=True).astype(float).filled(np.nan))


def within_rim(survey: Path) -> np.ndarray:
    """Return which cells of the surface lie within the rim, by other code than photogram's."""
    _, _, rim, _ = pyogrio.raw.read(survey / "results/deliverables/outline.gpkg", layer="outline")
    with rasterio.open(survey / "results/deliverables/dsm.tif") as file:
        shapes = [shapely.geometry.mapping(part) for part in shapely.from_wkb(rim)]
        return np.asarray(rasterio.features.geometry_mask(shapes, file.shape, file.transform, invert=True))


def test_the_surface_has_no_holes_within_the_rim_and_says_what_is_made_up(finished_survey: Path) -> None:
    heights, filled, code = (raster(finished_survey, f"dsm{name}.tif") for name in ("", "_filled", "_source"))
    inside, known = within_rim(finished_survey), np.isfinite(heights)
    assert inside.sum() > 1000
    assert not known[inside].all()
    assert np.isfinite(filled[inside]).all()
    np.testing.assert_array_equal(filled[known], heights[known])
    np.testing.assert_array_equal(np.isin(code, [*MEASURED_IN.values()]), known)
    np.testing.assert_array_equal(code != HOLE, np.isfinite(filled))
    assert set(np.unique(code[~known])) <= {HOLE, FILLED, WATER, INTERPOLATED}


def test_the_orthophoto_stands_on_the_closed_surface(finished_survey: Path) -> None:
    filled, code = raster(finished_survey, "dsm_filled.tif"), raster(finished_survey, "dsm_source.tif")
    with open_run(load_project(finished_survey / "project.yaml")) as run:
        surface, rim = stored_closing(run)
    closed, far = surface.heights(surface.grid.whole), code == INTERPOLATED
    np.testing.assert_array_equal(closed[far], filled[far].astype(np.float32))
    _, _, written, _ = pyogrio.raw.read(finished_survey / "results/deliverables/outline.gpkg", layer="outline")
    assert shapely.union_all(shapely.from_wkb(written)).equals(rim)


def test_terrain_is_made_where_something_stands_on_the_ground(finished_survey: Path) -> None:
    terrain, source = (raster(finished_survey, f"dtm{name}.tif") for name in ("", "_source"))
    filled, sigma = raster(finished_survey, "dsm_filled.tif"), raster(finished_survey, "dtm_sigma.tif")
    assert np.nanmax(terrain - filled) < 1.0
    assert np.nanmax(filled - terrain) > 2.0  # a house or a tree
    np.testing.assert_array_equal(np.isfinite(terrain), np.isfinite(sigma))
    np.testing.assert_array_equal(source > 0, np.isfinite(terrain))
    layer = pyogrio.raw.read(finished_survey / "results/deliverables/contours.gpkg", columns=["height_m"])
    lines = shapely.get_coordinates(shapely.from_wkb(layer[2]))
    with rasterio.open(finished_survey / "results/deliverables/dtm.tif") as file:
        corner, shape = file.transform, file.shape
    grid = MapGrid(corner.c, corner.f, corner.a, *shape)
    east, north = grid.centres_map_m(grid.whole)
    at = RegularGridInterpolator((north[::-1], east), terrain[::-1], bounds_error=False)
    vertices = np.array([len(shapely.get_coordinates(line)) for line in shapely.from_wkb(layer[2])])
    off = at(lines[:, ::-1]) - np.repeat(layer[3][0], vertices)
    assert np.abs(off[np.isfinite(off)]).max() < 0.02


@pytest.mark.parametrize("enabled", [True, False])
def test_terrain_can_be_asked_for_and_against(adjusted_survey: Path, edit: object, enabled: bool) -> None:
    project = adjusted_survey / "project.yaml"
    edit(project, lambda v: v.update(terrain={"enabled": enabled}))  # type: ignore[operator]
    run_pipeline(load_project(project), until="relief")
    with open_run(load_project(project)) as run:
        summary = run.workspace.summary("relief", ReliefSummary)
        assert run.workspace.has("relief", "dtm.tif") == enabled
    assert summary["of"] == ("terrain" if enabled else "surface")
    assert "no_terrain" not in summary
