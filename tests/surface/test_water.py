"""Water is found where key points and windows agree on nothing amid ground that matches, and nothing else is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from photogram.arrays import BoolArray
from photogram.camera import Camera, Pose, project_points, rotation_from_gimbal
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.surface.water import (
    CELLS,
    KeyPoints,
    SurfaceCells,
    Water,
    expected_matches,
    find_water,
    joined_cells,
    key_points_on_ground,
    surface_cells,
)
from photogram.survey import Features

SIDE = 60
GRID = MapGrid(1000.0, 2000.0, 1.0, SIDE, SIDE)
ROW, COLUMN = np.mgrid[:SIDE, :SIDE]
LAKE = (ROW - 30) ** 2 + (COLUMN - 25) ** 2 < 8**2
BANK = (ROW - 30) ** 2 + (COLUMN - 25) ** 2 < 11**2
LEVEL_M, FLYING_M = 50.0, 60.0
PHOTOGRAPHS = 6
FEWER = np.where(LAKE, 0.5, 1.0)


def site(lake: BoolArray = LAKE) -> SurfaceCells:
    """Ground 3 m above a lake, down to it on its bank; all but the lake is measured, and six photographs show it."""
    height = np.where(BANK, LEVEL_M + 0.1, LEVEL_M + 3.0).astype(np.float32)
    land = (~lake).astype(np.float32)
    return SurfaceCells(
        land, land, np.full(lake.shape, 6.0, np.float32), np.ones_like(lake),
        np.where(lake, np.float32(np.nan), height),
    )  # fmt: skip


def key_points(
    share: np.ndarray, density: np.ndarray | float = FEWER, blurred: Sequence[int] = (), green: np.ndarray | float = 0.0
) -> KeyPoints:
    """Key points of six photographs, ``density`` in each cell of each, of which the ``share`` matches; of blurred ones
    a fifth of that. How ``green`` they are."""
    rng = np.random.default_rng(5)
    parts = []
    for photograph in range(PHOTOGRAPHS):
        count = rng.poisson(np.broadcast_to(density, share.shape))
        cell = np.repeat(np.arange(share.size), count.ravel())
        chance = share.ravel()[cell] * (0.2 if photograph in blurred else 1.0)
        hue = np.broadcast_to(green, share.shape).ravel()[cell]
        parts.append(KeyPoints(np.full(len(cell), photograph), cell, rng.random(len(cell)) < chance, hue))
    return KeyPoints.joined(parts)


WATER_SHARE = np.where(LAKE, 0.02, 0.6)


def test_a_lake_is_found_as_far_as_it_goes_with_its_level_and_nothing_else() -> None:
    found = find_water(GRID, site(), key_points(WATER_SHARE), FLYING_M)
    assert len(found.level_m) == 1
    assert found.level_m[0] == pytest.approx(LEVEL_M + 0.1, abs=0.05)
    assert not (found.area > 0)[~LAKE].any()
    assert (found.area > 0)[LAKE].mean() > 0.95
    assert found.area_m2 == [float((found.area > 0).sum())]


def test_two_lakes_have_levels_of_their_own() -> None:
    upper = (ROW - 10) ** 2 + (COLUMN - 48) ** 2 < 7**2
    found = find_water(
        GRID, site(LAKE | upper), key_points(np.where(LAKE | upper, 0.01, 0.6), np.where(upper, 0.5, FEWER)), FLYING_M
    )
    assert sorted(np.round(found.level_m, 1).tolist()) == [LEVEL_M + 0.1, LEVEL_M + 3.0]
    assert found.area.max() == 2


@pytest.mark.parametrize("share", [0.15, 0.3])
def test_crowns_and_grass_that_move_are_no_water_even_where_no_height_was_kept(share: float) -> None:
    assert not find_water(GRID, site(), key_points(np.where(LAKE, share, 0.6)), FLYING_M).area.any()


def test_ground_that_larger_windows_have_measured_is_no_water_even_where_no_key_point_matches() -> None:
    cells = replace(site(), measured=np.ones((SIDE, SIDE), np.float32), low_m=np.full((SIDE, SIDE), 50.0, np.float32))
    assert not find_water(GRID, cells, key_points(np.where(LAKE, 0.0, 0.6)), FLYING_M).area.any()


def test_asphalt_without_key_points_is_no_water() -> None:
    points = key_points(np.where(LAKE, 0.0, 0.6), np.where(LAKE, 0.02, 1.0))
    assert not find_water(GRID, site(), points, FLYING_M).area.any()


def test_what_fewer_than_three_photographs_show_is_no_water() -> None:
    cells = replace(site(), shown=~LAKE)
    assert not find_water(GRID, cells, key_points(WATER_SHARE), FLYING_M).area.any()


def test_ground_that_few_photographs_show_is_measured_by_its_like() -> None:
    """At the rim, three photographs show the ground and a key point in eight matches: so does what lies amid it."""
    rim = ROW > 18
    cells = replace(site(), seen=np.where(rim, 3.0, 6.0).astype(np.float32))
    alike = key_points(np.where(LAKE, 0.03, np.where(rim, 0.12, 0.8)))
    assert not find_water(GRID, cells, alike, FLYING_M).area.any()
    expected = expected_matches(cells, alike)
    there = rim.ravel()[alike.cell]
    assert expected[there].mean() == pytest.approx(0.12, abs=0.02)
    assert expected[~there].mean() == pytest.approx(0.8, abs=0.05)


def test_photographs_that_are_blurred_prove_nothing() -> None:
    """The photographs over the hole match nowhere; one sharp one beside it does."""
    points = key_points(np.where(LAKE, 0.1, 0.6), blurred=range(1, PHOTOGRAPHS))
    over = LAKE.ravel()[points.cell] & (points.photograph == 0)
    blurred = KeyPoints(*(of[~over] for of in (points.photograph, points.cell, points.matched, points.green)))
    assert blurred.matched[LAKE.ravel()[blurred.cell]].mean() < 0.05
    assert not find_water(GRID, site(), blurred, FLYING_M).area.any()


def test_a_wood_of_which_nothing_matches_is_no_water_in_summer_or_winter() -> None:
    share = np.where(LAKE, 0.0, 0.6)
    for green, density, found in ((0.04, 0.5, 1), (0.15, 0.5, 0), (0.04, 1.0, 0)):
        points = key_points(share, np.where(LAKE, density, 1.0), green=np.where(LAKE, green, 0.3))
        assert len(find_water(GRID, site(), points, FLYING_M).level_m) == found


def test_a_hillside_is_no_water() -> None:
    cells = site()
    slope = np.where(LAKE, np.float32(np.nan), (50.0 + 0.2 * ROW).astype(np.float32))
    assert not find_water(GRID, replace(cells, low_m=slope), key_points(WATER_SHARE), FLYING_M).area.any()


def test_cars_that_have_moved_are_no_water() -> None:
    cars = (abs(ROW - 30) < 3) & (abs(COLUMN - 25) < 2)
    points = key_points(np.where(cars, 0.0, 0.6), np.where(cars, 4.0, 8.0))
    assert not find_water(GRID, site(cars), points, FLYING_M).area.any()


def test_a_block_in_which_nothing_is_well_measured_has_no_water() -> None:
    cells = replace(site(), measured=np.zeros((SIDE, SIDE), np.float32))
    points = key_points(WATER_SHARE)
    assert not expected_matches(cells, points).any()
    assert not find_water(GRID, cells, points, FLYING_M).area.any()


def test_what_windows_at_the_shore_carry_onto_the_water_is_water_and_a_tree_that_matches_is_not() -> None:
    inner = (ROW - 30) ** 2 + (COLUMN - 25) ** 2 < 6**2
    rim, tree = LAKE & ~inner, (abs(ROW - 30) < 2) & (COLUMN > 25) & LAKE & ~inner
    cells = site()
    low = np.where(rim, np.float32(LEVEL_M + 0.1), cells.low_m)
    cells = replace(cells, measured=(~inner).astype(np.float32), low_m=np.where(tree, np.float32(LEVEL_M + 4.0), low))
    points = key_points(np.where(LAKE & ~tree, 0.0, 0.6), np.where(tree, 2.0, FEWER))
    found = find_water(GRID, cells, points, FLYING_M)
    assert (found.area > 0)[rim & ~tree].mean() > 0.9
    assert not (found.area > 0)[tree | ~LAKE].any()


def test_larger_cells_say_what_those_of_the_surface_hold() -> None:
    height = np.full((12, 20), np.nan, np.float32)
    height[:8, :4] = np.arange(32).reshape(8, 4)
    finest, seen = np.zeros((12, 20), bool), np.full((12, 20), 4, np.uint8)
    finest[:8, :1], seen[8:] = True, 2
    cells = surface_cells(height, finest, seen)
    assert cells.measured.tolist() == [[0.5, 0, 0], [0, 0, 0]]
    assert cells.finest[0, 0] == 0.125
    assert cells.low_m[0, 0] == 6.0
    assert np.isnan(cells.low_m[0, 1])
    assert cells.seen.tolist() == [[4, 4, 4], [2, 2, 2]]
    assert cells.shown.tolist() == [[True] * 3, [False] * 3]
    parts = [(Window(0, a, 12, b), surface_cells(height[:, a:b], finest[:, a:b], seen[:, a:b]))
             for a, b in ((0, 16), (16, 20))]  # fmt: skip
    joined = joined_cells(MapGrid(0.0, 0.0, 1.0, 2, 3), parts)
    assert np.array_equal(joined.measured, cells.measured)
    assert np.array_equal(joined.shown, cells.shown)


def test_levels_stand_in_the_cells_of_the_surface() -> None:
    water = Water(MapGrid(0.0, 0.0, 8.0, 2, 2), np.array([[0, 1], [2, 0]]), np.array([5.0, 7.0]))
    levels = water.levels_m(Window(4, 4, 12, 12))
    assert np.isnan(levels[:4, :4]).all()
    assert (levels[:4, 4:] == 5.0).all()
    assert (levels[4:, :4] == 7.0).all()
    assert CELLS == 8


def test_key_points_lie_on_the_ground_that_their_photograph_shows() -> None:
    frame = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 120.0))
    grid = MapGrid(602340.0 - 50, 5794120.0 + 50, 1.0, 100, 100)
    height = (120.0 + 4.0 * np.sin(np.arange(100) / 15.0) + np.zeros((100, 1))).astype(np.float32)
    none = np.ones((100, 100), np.float32)
    hole = height.copy()
    hole[40:43, 40:43] = np.nan
    cells = SurfaceCells(none, none, none, none > 0, hole)
    camera = Camera("c", 800, 600, 500.0, np.array([399.5, 299.5]), radial=np.array([-0.05, 0.01, 0.0, 0.0]))
    pose = Pose(rotation_from_gimbal(30.0, -60.0, 4.0), np.array([5.0, -20.0, 60.0]))
    row, column = (a.ravel() for a in np.mgrid[30:75, 20:80])
    place = np.column_stack([grid.west_map_m + column + 0.5, grid.north_map_m - row - 0.5, height[row, column]])
    pixel = project_points(camera, pose, frame.world_from_map(place))
    inside = camera.contains(pixel)
    assert inside.sum() > 500
    matched = np.arange(0, inside.sum(), 3)
    count = int(inside.sum())
    colour = np.tile(np.array([50, 100, 50], np.uint8), (count, 1))
    features = Features(pixel[inside], np.ones(count), np.zeros(count), np.zeros((count, 4), np.uint8), colour)
    found = key_points_on_ground(7, camera, pose, frame, features, matched, grid, cells)
    assert found.green == pytest.approx(0.5)
    assert np.array_equal(found.cell, (row * 100 + column)[inside])
    assert np.array_equal(np.flatnonzero(found.matched), matched)
    assert (found.photograph == 7).all()
    upwards = replace(pose, rotation_world_from_camera=rotation_from_gimbal(30.0, 60.0, 4.0))
    assert not len(key_points_on_ground(7, camera, upwards, frame, features, matched, grid, cells).cell)
