"""On a made site, whose bare terrain is known: simulated."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from photogram.errors import PhotogramError
from photogram.geodesy.frames import LocalFrame
from photogram.simulation.scene import Material, Scene, make_scene, surface_raster, terrain_height
from photogram.surface.dtm import Terrain, TerrainSettings, terrain_from_surface
from photogram.survey import Raster

SEED, RELIEF_M, NOISE_M = 5, 6.0, 0.03
FRAME = LocalFrame.near("EPSG:25832", np.array([[602_300.0, 5_794_200.0, 40.0]]))


def heights_of(scene: Scene, height_m: np.ndarray) -> np.ndarray:
    return surface_raster(replace(scene, height_m=height_m.astype(np.float32)), FRAME, 0.25).values


@pytest.fixture(scope="module")
def site() -> tuple[Raster, np.ndarray, np.ndarray, Terrain]:
    """Return the surface with noise and holes, its bare terrain, what covers it, and the terrain that was found."""
    scene = make_scene(SEED, 80.0, 0.2, RELIEF_M, buildings=5, trees=25)
    rows, columns = scene.height_m.shape
    x, y = scene.west_m + np.arange(columns) * scene.cell_m, scene.south_m + np.arange(rows) * scene.cell_m
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    bare = heights_of(scene, terrain_height(SEED, RELIEF_M, places).reshape(rows, columns))
    surface = surface_raster(scene, FRAME, 0.25)
    rng = np.random.default_rng(2)
    surface.values[:] += rng.normal(0.0, NOISE_M, surface.values.shape)
    surface.values[100:112, 40:60] = np.nan
    covered = heights_of(scene, (scene.material >= Material.TREE).astype(float)) - FRAME.origin_map_m[2] > 0.5
    return surface, bare, covered, terrain_from_surface(surface)


def test_houses_and_trees_are_taken_away(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    surface, bare, covered, terrain = site
    error = terrain.heights.values - bare
    known = np.isfinite(error)
    before = surface.values - bare
    assert np.sqrt(np.mean(before[covered & known] ** 2)) > 3.0
    assert np.sqrt(np.mean(error[covered & known] ** 2)) < 0.15
    assert np.sqrt(np.mean(error[~covered & known] ** 2)) < 0.05
    assert terrain.interpolated[covered & known].mean() > 0.98
    # half a metre beside walls and crowns is interpolated too
    assert terrain.interpolated[~covered & known].mean() < 0.1


def test_ground_keeps_its_heights_and_holes_stay(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    surface, _, _, terrain = site
    kept = np.isfinite(terrain.heights.values) & ~terrain.interpolated
    np.testing.assert_array_equal(terrain.heights.values[kept], surface.values[kept])
    assert not np.isfinite(terrain.heights.values[~np.isfinite(surface.values)]).any()
    assert not terrain.interpolated[~np.isfinite(surface.values)].any()


def test_same_surface_gives_the_same_terrain(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    surface, _, _, terrain = site
    np.testing.assert_array_equal(terrain_from_surface(surface).heights.values, terrain.heights.values)


def test_wide_gaps_stay_open(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    surface, _, _, terrain = site
    found = terrain_from_surface(surface, TerrainSettings(maximum_gap_m=2.0))
    opened = np.isfinite(terrain.heights.values) & ~np.isfinite(found.heights.values)
    assert 0 < opened.sum() < terrain.interpolated.sum()
    assert not opened[~terrain.interpolated].any()


def test_what_cannot_be_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PhotogramError, match="no ground found"):
        terrain_from_surface(Raster(np.full((9, 9), np.nan, np.float32), 0.0, 0.0, 0.5))
    with pytest.raises(PhotogramError, match="rigidness: must be 1, 2 or 3, found 4"):
        TerrainSettings(rigidness=4)  # type: ignore[arg-type]
    with pytest.raises(PhotogramError, match=r"step_m: must be from 0\.001 to 1000 m, found 0"):
        TerrainSettings(step_m=0)
    monkeypatch.setitem(sys.modules, "CSF_3DFin", None)
    with pytest.raises(PhotogramError, match="pip install csf-3dfin"):
        terrain_from_surface(Raster(np.zeros((9, 9), np.float32), 0.0, 0.0, 0.5))
