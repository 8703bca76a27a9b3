import numpy as np
import pytest

from photogram.geodesy.frames import LocalFrame
from photogram.simulation.scene import (
    BLOCK_CELLS,
    Material,
    Scene,
    gradient_noise,
    make_scene,
    paint_targets,
    surface_raster,
    terrain_height,
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(5, 80.0, 0.2, relief_m=6.0, buildings=5, trees=25)


def open_places(scene: Scene, count: int, reach_m: float = 2.0) -> np.ndarray:
    xy = np.random.default_rng(0).uniform(-30.0, 30.0, (400, 2))
    xy = xy[scene.open_ground(xy, reach_m)]
    chosen = [xy[0]]
    for place in xy:
        if np.linalg.norm(place - np.array(chosen), axis=1).min() > 10.0:
            chosen.append(place)
    return np.array(chosen[:count])


def test_noise_has_no_mean_and_is_continuous() -> None:
    xyz = np.random.default_rng(1).uniform(-300.0, 300.0, (20000, 3))
    value = np.array([gradient_noise(7, *p) for p in xyz])
    near = np.array([gradient_noise(7, *(p + 1e-4)) for p in xyz])
    assert abs(value.mean()) < 0.01
    assert 0.2 < value.std() < 0.4
    assert np.abs(value).max() < 1.2
    assert np.abs(near - value).max() < 1e-3
    assert abs(np.corrcoef(value, [gradient_noise(8, *p) for p in xyz])[0, 1]) < 0.03


def test_noise_is_continuous_across_lattice_planes() -> None:
    for axis in range(3):
        p = np.array([-3.3, 2.4, 5.7])
        p[axis] = np.round(p[axis])
        low, high = p.copy(), p.copy()
        low[axis] -= 1e-9
        high[axis] += 1e-9
        assert gradient_noise(3, *low) == pytest.approx(gradient_noise(3, *high), abs=1e-7)


def test_terrain_has_the_relief_asked_for() -> None:
    xy = np.random.default_rng(2).uniform(-100.0, 100.0, (5000, 2))
    spans = [np.ptp(terrain_height(seed, 8.0, xy)) for seed in range(10)]
    assert 5.0 < np.median(spans) < 14.0
    np.testing.assert_allclose(terrain_height(3, 16.0, xy), 2 * terrain_height(3, 8.0, xy))
    assert np.array_equal(terrain_height(3, 8.0, xy[::-1])[::-1], terrain_height(3, 8.0, xy))


def test_the_same_seed_makes_the_same_site(scene: Scene) -> None:
    again = make_scene(5, 80.0, 0.2, relief_m=6.0, buildings=5, trees=25)
    other = make_scene(6, 80.0, 0.2, relief_m=6.0, buildings=5, trees=25)
    for name in ("height_m", "material", "light"):
        assert np.array_equal(getattr(scene, name), getattr(again, name))
        assert not np.array_equal(getattr(scene, name), getattr(other, name))


def test_site_has_walls_roofs_trees_and_roads_on_the_terrain(scene: Scene) -> None:
    x = np.linspace(-40.0, 40.0, len(scene.height_m))
    bare = terrain_height(5, 6.0, np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)).reshape(scene.height_m.shape)
    above = scene.height_m - bare
    ground = scene.material < Material.TREE
    assert np.abs(above[ground]).max() < 1e-5
    assert set(np.unique(scene.material)) >= {Material.MEADOW, Material.ROAD, Material.TREE, Material.ROOF_TILES}
    roof = scene.material >= Material.ROOF_TILES
    assert above[roof].min() > 1.0
    step = np.abs(np.diff(scene.height_m, axis=1))
    assert step[roof[:, 1:] ^ roof[:, :-1]].max() > 3.0


def test_height_is_bilinear(scene: Scene) -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(-39.9, 39.9, (500, 2))
    p = (xy + 40.0) / 0.2
    c, r = np.floor(p).astype(int).T
    u, v = (p - np.floor(p)).T
    h = scene.height_m.astype(float)
    expected = (
        (1 - u) * (1 - v) * h[r, c] + u * (1 - v) * h[r, c + 1] + (1 - u) * v * h[r + 1, c] + u * v * h[r + 1, c + 1]
    )
    np.testing.assert_allclose(scene.height(xy), expected, atol=1e-9)
    assert scene.height(np.array([[500.0, -40.0]]))[0] == pytest.approx(h[0, -1])


def test_blocks_hold_the_highest_vertex_of_unequal_sides(scene: Scene) -> None:
    part = Scene(
        scene.height_m[:70, :133], scene.material[:70, :133], scene.light[:70, :133], -40.0, -40.0, 0.2,
        np.zeros((0, 2)), 0.0, 0.1, scene.sun, 0,
    )  # fmt: skip
    n = BLOCK_CELLS
    expected = [[part.height_m[r : r + n + 1, c : c + n + 1].max() for c in range(0, 132, n)] for r in range(0, 69, n)]
    assert np.array_equal(part.block_max, np.array(expected))


def test_shadows_lie_north_of_what_casts_them(scene: Scene) -> None:
    shaded = np.argwhere(scene.light == 0)[::50]
    assert len(shaded) > 20
    for row, column in shaded:
        place = np.array([column, row]) * 0.2 - 40.0
        steps = np.arange(0.2, 40.0, 0.1)[:, None]
        path = place + steps * scene.sun[:2]
        ray = scene.height_m[row, column] + steps[:, 0] * scene.sun[2]
        assert np.any(scene.height(path) > ray - 0.3)


def test_open_ground_keeps_away_from_objects_and_edges(scene: Scene) -> None:
    tree = np.argwhere(scene.material == Material.TREE)[0][::-1] * 0.2 - 40.0
    places = np.array([tree, tree + np.array([0.0, -1.0]), [39.9, 0.0]])
    assert not scene.open_ground(places, 2.0).any()
    free = open_places(scene, 5)
    ring = free[:, None] + 1.9 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 40)])
    np.testing.assert_allclose(
        scene.height(ring.reshape(-1, 2)), terrain_height(5, 6.0, ring.reshape(-1, 2)), atol=0.02
    )


def test_targets_lie_on_level_ground(scene: Scene) -> None:
    places = open_places(scene, 4)
    painted = paint_targets(scene, places, 0.35)
    np.testing.assert_allclose(painted.targets_world_m[:, 2], scene.height(places), atol=1e-6)
    for place, height in zip(places, painted.targets_world_m[:, 2], strict=True):
        ring = place + 0.45 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 30)])
        np.testing.assert_allclose(painted.height(ring), height, atol=1e-5)
    assert set(np.unique(painted.block_target)) == {-1, 0, 1, 2, 3}


def test_targets_that_cannot_be_painted(scene: Scene) -> None:
    tree = np.argwhere(scene.material == Material.TREE)[0][::-1] * 0.2 - 40.0
    with pytest.raises(ValueError, match="open ground"):
        paint_targets(scene, tree[None], 0.35)
    place = open_places(scene, 1, 4.0)[0]
    with pytest.raises(ValueError, match="too close"):
        paint_targets(scene, np.array([place, place + 0.8]), 0.35)


def test_surface_raster_is_exact_in_the_map(scene: Scene) -> None:
    frame = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 120.0))
    raster = surface_raster(scene, frame, 0.5)
    rows, columns = np.nonzero(np.isfinite(raster.values))
    easting, northing = raster.west_map_m + (columns + 0.5) * 0.5, raster.north_map_m - (rows + 0.5) * 0.5
    world = frame.world_from_map(np.column_stack([easting, northing, raster.values[rows, columns].astype(float)]))
    assert np.abs(world[:, 2] - scene.height(world[:, :2])).max() < 1e-3
    assert np.isfinite(raster.values).mean() > 0.9
    assert raster.west_map_m % 0.5 == 0
