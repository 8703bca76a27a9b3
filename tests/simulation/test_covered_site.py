import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from photogram.simulation.cover.hits import leaf_hits
from photogram.simulation.cover.leaves import CoverPlan, PlantKind
from photogram.simulation.covered_site import make_covered_scene
from photogram.simulation.scene import Material, Scene, make_scene, terrain_height

SITE = (5, 110.0, 0.2, 5.0, 3, 25)
PLAN = CoverPlan(hedges=3, fences=2, wood_trees=10, pond_radius_m=5.0)


@pytest.fixture(scope="module", name="scene")
def _scene() -> Scene:
    return make_covered_scene(*SITE, finest_wavelength_m=0.2, plan=PLAN)


def test_the_same_seed_makes_the_same_site(scene: Scene) -> None:
    again = make_covered_scene(*SITE, finest_wavelength_m=0.2, plan=PLAN)
    other = make_covered_scene(6, *SITE[1:], finest_wavelength_m=0.2, plan=PLAN)
    for name in ("height_m", "material", "light"):
        assert np.array_equal(getattr(scene, name), getattr(again, name))
        assert not np.array_equal(getattr(scene, name), getattr(other, name))
    assert scene.cover is not None
    assert again.cover is not None
    assert np.array_equal(scene.cover.leaves.centre_m, again.cover.leaves.centre_m)


def test_the_site_has_all_that_was_asked_for(scene: Scene) -> None:
    assert scene.cover is not None
    kinds = scene.cover.plants.kind
    assert 1 <= (kinds == PlantKind.HEDGE).sum() <= 3
    assert 12 <= (kinds == PlantKind.CROWN).sum() <= 25
    assert {Material.GRASS, Material.WATER, Material.LITTER, Material.ROOF_TILES} <= set(np.unique(scene.material))
    assert Material.TREE not in scene.material  # no domes
    radii = np.unique(scene.cover.lines.radius_m)
    assert radii.tolist() == [0.012, 0.015, 0.05, 0.13]  # rails, wires, posts, poles


def test_water_is_level_below_its_banks_and_grass_is_low(scene: Scene) -> None:
    axis = scene.west_m + np.arange(scene.height_m.shape[0]) * scene.cell_m
    bare = terrain_height(5, 5.0, np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)).reshape(
        scene.height_m.shape
    )
    water = scene.material == Material.WATER
    assert 0.3 * np.pi * 25 < water.sum() * scene.cell_m**2 < 2.5 * np.pi * 25
    assert np.ptp(scene.height_m[water]) == 0.0
    assert np.all(scene.height_m[water] < bare[water])
    level = scene.height_m[water][0]
    shore = binary_dilation(water, iterations=3) & ~water
    assert scene.height_m[shore].min() >= level
    above = (scene.height_m - bare)[(scene.material == Material.GRASS) & (scene.height_m > level + 1.0)]
    assert 0.0 < np.median(above) < 0.3
    assert 0.02 < above.std() < 0.2


def test_shadows_of_leaves_lie_where_leaves_are_before_the_sun(scene: Scene) -> None:
    assert scene.cover is not None
    rows, columns = np.nonzero(scene.material == Material.LITTER)
    rows, columns = rows[::7], columns[::7]
    origin = np.column_stack([
        scene.west_m + columns * scene.cell_m, scene.south_m + rows * scene.cell_m, scene.height_m[rows, columns]
    ])  # fmt: skip
    shaded = np.isfinite(leaf_hits(scene.cover.at_rest, origin, np.tile(scene.sun, (len(rows), 1)), np.inf))
    assert shaded.mean() > 0.2
    assert np.all(scene.light[rows, columns][shaded] == 0)


def test_open_ground_keeps_away_from_leaves_and_water(scene: Scene) -> None:
    xy = np.random.default_rng(1).uniform(-35.0, 35.0, (2000, 2))
    xy = xy[scene.open_ground(xy, 1.0)]
    assert len(xy) > 200
    assert scene.cover is not None
    assert np.isfinite(scene.cover.height(xy)).mean() < 0.01
    leaf = scene.cover.height(xy)
    np.testing.assert_array_equal(scene.top(xy), np.where(np.isnan(leaf), scene.height(xy), leaf))


def test_nothing_asked_for_is_bare_ground() -> None:
    nothing = CoverPlan(hedges=0, fences=0, power_lines=0, wood_trees=0, pond_radius_m=0.0, grass=False)
    bare = make_covered_scene(5, 60.0, 0.2, 4.0, 2, 0, finest_wavelength_m=0.2, plan=nothing)
    plain = make_scene(5, 60.0, 0.2, 4.0, 2, 0, finest_wavelength_m=0.2)
    for name in ("height_m", "material", "light"):
        assert np.array_equal(getattr(bare, name), getattr(plain, name))
