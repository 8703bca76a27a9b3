"""The site of steep ground: faces of the stated angles, volumes as the formula has them."""

import numpy as np
import pytest
from lib.simulated.steep_site import HEAP_FACES_DEG, SteepBuilder, SteepSite, steep_site

from photogram.simulation.scene import Material
from photogram.simulation.simulated_survey import whole_survey_plan

EXTENT_M, CELL_M = 140.0, 0.1


@pytest.fixture(scope="module", name="site")
def _site() -> SteepSite:
    return steep_site(whole_survey_plan(), 2, 170.0, contrast=0.25)


def level_builder() -> SteepBuilder:
    """Return a builder of a level site without anything."""
    builder = SteepBuilder(1, EXTENT_M, CELL_M)
    builder.ground(1, 0.0)
    return builder


def slope_deg(builder: SteepBuilder) -> np.ndarray:
    """Return the slopes between diagonal neighbours of the height field, which are exact on a plane."""
    south, east = np.gradient(builder.height, CELL_M)
    return np.degrees(np.arctan(np.hypot(east, south)))


@pytest.mark.parametrize("face_deg", [30.0, 55.0, 80.0])
def test_a_heap_has_its_face_and_its_volume(face_deg: float) -> None:
    builder = level_builder()
    builder.heap(face_deg)
    (heap,) = builder.heaps
    distance = np.hypot(builder.xy[..., 0] - heap.east_m, builder.xy[..., 1] - heap.north_m)
    face = (distance > heap.top_m + 2 * CELL_M) & (distance < heap.foot_m - 2 * CELL_M)
    assert np.median(slope_deg(builder)[face]) == pytest.approx(face_deg, abs=0.05)
    assert builder.height[distance < heap.top_m - CELL_M] == pytest.approx(heap.height_m)
    assert np.sum(builder.height) * CELL_M**2 == pytest.approx(heap.volume_m3, rel=1e-2)
    assert not builder.height[distance > heap.foot_m].any()


def test_terraces_rise_step_by_step() -> None:
    builder = level_builder()
    builder.bench(70.0, steps=3)
    heights, counts = np.unique(np.round(builder.height, 6), return_counts=True)
    levels = heights[counts > 0.8 / CELL_M**2]  # ground, two strips, the top
    assert len(levels) == 4
    assert np.diff(levels) == pytest.approx(levels[1])
    steep = slope_deg(builder)[slope_deg(builder) > 65.0]
    assert np.median(steep) == pytest.approx(70.0, abs=0.1)


def test_a_gable_has_its_angle_and_stands_on_walls() -> None:
    builder = level_builder()
    builder.house(50.0)
    roof = builder.material == Material.ROOF_TILES
    assert np.median(slope_deg(builder)[roof]) == pytest.approx(50.0, abs=0.05)
    assert builder.height[roof].min() >= 2.5


def test_crowns_are_as_tall_as_an_ellipsoid_above_the_ground() -> None:
    builder = level_builder()
    builder.crown()
    (_, _, radius), crown = builder.taken[-1], builder.material == Material.TREE
    tall = builder.height.max()
    assert 0.9 * 1.5 - 0.01 <= tall <= 1.4 * 4.0
    assert np.sum(builder.height) * CELL_M**2 == pytest.approx(2.0 / 3.0 * np.pi * radius**2 * tall, rel=1e-2)
    assert crown.sum() * CELL_M**2 == pytest.approx(np.pi * radius**2, rel=0.02)


def test_a_site_is_the_same_from_the_same_seed_and_off_open_ground(site: SteepSite) -> None:
    again = steep_site(whole_survey_plan(), 2, 170.0, contrast=0.25)
    assert np.array_equal(site.scene.height_m, again.scene.height_m)
    assert site.scene.contrast == 0.25
    assert [heap.face_deg for heap in site.heaps] == list(HEAP_FACES_DEG)
    for heap in site.heaps:  # no target is painted on it
        assert not site.scene.open_ground(np.array([[heap.east_m, heap.north_m]]), 0.5).any()
