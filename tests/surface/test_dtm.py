"""On a made site, whose bare terrain is known: simulated."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.errors import PhotogramError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.simulation.scene import Material, Scene, make_scene, surface_raster, terrain_height
from photogram.surface.dtm import Terrain, TerrainSettings, terrain_from_surface, terrain_model
from photogram.survey import Raster

SEED, RELIEF_M, NOISE_M = 5, 6.0, 0.03
HOLE = np.s_[100:112, 40:60]
FRAME = LocalFrame.near("EPSG:25832", np.array([[602_300.0, 5_794_200.0, 40.0]]))


def heights_of(scene: Scene, height_m: np.ndarray) -> np.ndarray:
    return surface_raster(replace(scene, height_m=height_m.astype(np.float32)), FRAME, 0.25).values


def sigma_of(surface: Raster) -> Raster:
    return replace(surface, values=np.where(np.isfinite(surface.values), np.float32(NOISE_M), np.float32(np.nan)))


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
    surface.values[HOLE] = np.nan
    covered = heights_of(scene, (scene.material >= Material.TREE).astype(float)) - FRAME.origin_map_m[2] > 0.5
    return surface, bare, covered, terrain_from_surface(surface, sigma_of(surface))


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
    np.testing.assert_array_equal(
        terrain_from_surface(surface, sigma_of(surface)).heights.values, terrain.heights.values
    )


def test_what_all_heights_share_hides_nothing(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    """A survey that GNSS alone has placed is known to ± 10 m in height, and to centimetres in its shape."""
    surface, _, covered, terrain = site
    own, grid = sigma_of(surface).values, MapGrid.of(surface)
    shared_m = np.broadcast_to(np.linspace(9.0, 12.0, grid.columns, dtype=np.float32), own.shape)
    whole = np.hypot(own, shared_m)

    def read(window: Window) -> tuple[np.ndarray, np.ndarray]:
        return surface.values[window.slices], whole[window.slices]

    model = terrain_model(grid, read, None, lambda window: own[window.slices])
    assert not model.is_bare
    assert terrain_model(grid, read).is_bare, "the sigma of the datum would hide every house"
    (window,) = model.windows
    tile = model.tile(window)
    np.testing.assert_array_equal(tile.height, terrain.heights.values)
    known = np.isfinite(tile.sigma)
    np.testing.assert_array_equal(tile.sigma[known & ~tile.interpolated], whole[known & ~tile.interpolated])
    within = known & tile.interpolated
    assert (covered & within).sum() > 1000
    expected = np.hypot(terrain.sigma.values, shared_m)
    np.testing.assert_allclose(tile.sigma[within], expected[within], rtol=5e-3)


def test_wide_gaps_stay_open(site: tuple[Raster, np.ndarray, np.ndarray, Terrain]) -> None:
    surface, _, _, terrain = site
    found = terrain_from_surface(surface, sigma_of(surface), TerrainSettings(maximum_gap_m=2.0))
    opened = np.isfinite(terrain.heights.values) & ~np.isfinite(found.heights.values)
    assert 0 < opened.sum() < terrain.interpolated.sum()
    assert not opened[~terrain.interpolated].any()


def test_sigma_is_the_surfaces_on_the_ground_and_true_where_interpolated(
    site: tuple[Raster, np.ndarray, np.ndarray, Terrain],
) -> None:
    surface, bare, _, terrain = site
    known = np.isfinite(terrain.heights.values)
    np.testing.assert_array_equal(np.isfinite(terrain.sigma.values), known)
    kept = known & ~terrain.interpolated
    np.testing.assert_array_equal(terrain.sigma.values[kept], sigma_of(surface).values[kept])
    ratio = (terrain.heights.values - bare) / terrain.sigma.values
    assert 0.7 < np.sqrt(np.mean(ratio[terrain.interpolated] ** 2)) < 1.3


def test_what_was_not_measured_is_interpolated_from_the_ground(
    site: tuple[Raster, np.ndarray, np.ndarray, Terrain],
) -> None:
    surface, bare, _, _ = site
    filled = replace(surface, values=surface.values.copy())
    filled.values[HOLE] = bare[HOLE] + 4.0  # as a hole that was filled from a roof
    terrain = terrain_from_surface(filled, sigma_of(surface))
    assert terrain.interpolated[HOLE].all()
    assert np.abs(terrain.heights.values - bare)[HOLE].max() < 0.5


def test_what_cannot_be_is_said() -> None:
    nothing = Raster(np.full((9, 9), np.nan, np.float32), 0.0, 0.0, 0.5)
    with pytest.raises(PhotogramError, match="no ground found"):
        terrain_from_surface(nothing, nothing)
    with pytest.raises(PhotogramError, match=r"maximum_gap_m: must be from 0\.001 to 100000 m, found 0"):
        TerrainSettings(maximum_gap_m=0)
