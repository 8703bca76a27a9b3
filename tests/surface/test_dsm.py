"""From matched heights to a surface: made walls, curtains, holes and planes; propagation of errors on a moved plane."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.grid import MapGrid, Window
from photogram.surface.dsm import (
    FACE_SUPPORT,
    FILL_DIRECTIONS,
    KEPT_MARGIN_CELLS,
    SUPPORT,
    filled_heights,
    filtered_heights,
    patch_cells,
    shared_error,
    sure_cells,
    surface_sigma_m,
)
from photogram.surface.planes import REACH, STEEPEST

CELL_M = 0.25
MANY = 10_000


def gentle(height: FloatArray | Float32Array) -> BoolArray:
    return np.zeros(height.shape, np.bool_)


def kept(height: FloatArray, correlation: float = 0.9, rays: int = 3, sigma_m: float = 0.0) -> Float32Array:
    sigma, agreed = (np.full(height.shape, value, np.float32) for value in (sigma_m, correlation))
    count = np.full(height.shape, rays, np.uint8)
    return filtered_heights(
        height.astype(np.float32), sigma, agreed, count, count, gentle(height), gentle(height), CELL_M, 0.6
    )


def test_what_differs_by_its_noise_alone_stays() -> None:
    noisy = 10.0 + np.random.default_rng(1).normal(0.0, 0.3, (60, 70))
    inner = (slice(1, -1), slice(1, -1))
    assert np.isfinite(kept(noisy, rays=2)[inner]).mean() < 0.7
    assert np.isfinite(kept(noisy, sigma_m=0.3)[inner]).mean() > 0.996


def test_on_smooth_steep_ground_five_neighbours_are_enough() -> None:
    """A strip of two cells, at whose ends the outer ones have three neighbours, and all others five."""
    height = np.full((40, 40), np.nan, np.float32)
    height[4:36, 20:22] = 3.0
    some, count = np.full(height.shape, 0.9, np.float32), np.full(height.shape, 3, np.uint8)
    for steep, stays in ((gentle(height), False), (~gentle(height), True)):
        found = np.isfinite(filtered_heights(height, 0 * some, some, count, count, steep, gentle(height), CELL_M, 0.6))
        assert found[5:35, 20:22].all() == stays
        assert found.sum() == (60 if stays else 0)
        assert SUPPORT == FACE_SUPPORT + 1


def test_two_photographs_do_not_outvote_three_others() -> None:
    height = np.zeros((12, 12), np.float32)
    some = np.full(height.shape, 0.9, np.float32)
    for rays, seen, stays in ((2, 2, True), (2, 4, True), (2, 5, False), (2, 6, False), (3, 6, True), (1, 2, False)):
        agree, see = (np.full(height.shape, n, np.uint8) for n in (rays, seen))
        found = filtered_heights(height, 0 * some, some, agree, see, gentle(height), gentle(height), CELL_M, 0.6)
        assert np.isfinite(found[INSIDE]).all() == stays


@pytest.mark.parametrize(
    ("rays", "correlation", "stays"),
    [(1, 0.4, False), (2, 0.4, True), (3, 0.4, True), (3, 0.2, False), (2, -0.1, False)],
)
def test_what_pairs_tell_needs_half_the_correlation_and_no_majority(rays: int, correlation: float, stays: bool) -> None:
    height = plane(30, 40, 0.5, 0.0).astype(np.float32)
    little = np.full(height.shape, correlation, np.float32)
    agree, look = (np.full(height.shape, n, np.uint8) for n in (rays, 6))
    for told, kept_ in ((gentle(height), False), (~gentle(height), stays)):
        found = filtered_heights(height, 0 * little, little, agree, look, gentle(height), told, CELL_M, 0.6)
        assert np.isfinite(found[INSIDE]).all() == kept_
        assert np.isfinite(found).any() == kept_


def pit(side: int) -> FloatArray:
    """Return a plane with a square pit, 4 m deep; its outermost cells lack the support of neighbours."""
    height = np.full((60, 60), 10.0)
    height[20 : 20 + side, 20 : 20 + side] -= 4.0
    return height


@pytest.mark.parametrize(("side", "rays", "stays"), [(8, 2, False), (8, 3, True), (12, 2, True)])
def test_a_small_patch_that_stands_alone_needs_a_third_photograph(side: int, rays: int, stays: bool) -> None:
    height = pit(side)
    count = np.full(height.shape, rays, np.uint8)
    sigma, some = np.zeros(height.shape, np.float32), np.full(height.shape, 0.9, np.float32)
    found = filtered_heights(
        height.astype(np.float32), sigma, some, count, count, gentle(height), gentle(height), CELL_M, 0.6
    )
    assert np.isfinite(found[20 : 20 + side, 20 : 20 + side]).any() == stays
    assert np.isfinite(found[1:19, 1:-1]).all()
    counted = patch_cells(height.astype(np.float32), sigma, count, CELL_M, MANY)
    assert set(np.unique(counted)) == {side * side, 60 * 60 - side * side}
    few = patch_cells(height.astype(np.float32), sigma, count, CELL_M, side * side + 1)
    assert np.array_equal(few, np.minimum(counted, side * side + 1)), "counted no further than asked"


def test_small_patches_need_nearly_all_photographs_and_single_cells_go() -> None:
    for side, rays, seen, stays in ((8, 3, 4, True), (8, 3, 5, False), (4, 6, 6, False)):
        height = pit(side).astype(np.float32)
        agree, see = (np.full(height.shape, n, np.uint8) for n in (rays, seen))
        some = np.full(height.shape, 0.9, np.float32)
        found = filtered_heights(
            height, np.zeros_like(height), some, agree, see, gentle(height), gentle(height), CELL_M, 0.6
        )
        assert np.isfinite(found[20 : 20 + side, 20 : 20 + side]).any() == stays, side


def test_a_patch_is_connected_over_corners_and_not_across_holes_nor_by_the_sigma_of_two_photographs() -> None:
    none = np.nan
    height = np.array([[0.0, none, 5.0, none], [none, 0.2, none, 5.4], [0.0, none, none, none]], np.float32)
    for rays, sigma_m, counted in ((2, 0.1, [1, 1]), (3, 0.0, [1, 1]), (3, 0.1, [2, 2])):
        sigma, count = np.full_like(height, sigma_m), np.full(height.shape, rays, np.uint8)
        found = patch_cells(height, sigma, count, CELL_M, MANY)
        assert found[[0, 1, 2], [0, 1, 0]].tolist() == [3, 3, 3]
        assert found[[0, 1], [2, 3]].tolist() == counted
        assert np.all(found[np.isnan(height)] == 0)


@given(st.integers(0, 50), st.integers(0, 30), st.integers(0, 30))
@settings(max_examples=20, deadline=None)
def test_what_is_kept_does_not_depend_on_the_window(seed: int, row: int, column: int) -> None:
    rng, margin, side = np.random.default_rng(seed), KEPT_MARGIN_CELLS, 20
    shape = (side + 2 * margin + 40, side + 2 * margin + 40)
    coarse = 3.0 * rng.integers(0, 3, (shape[0] // 4 + 1, shape[1] // 4 + 1))
    height = np.kron(coarse, np.ones((4, 4)))[: shape[0], : shape[1]].astype(np.float32)
    rays = rng.integers(2, 4, shape).astype(np.uint8)
    sigma, some = np.zeros(shape, np.float32), np.full(shape, 0.9, np.float32)
    steep, told = (rng.random(shape) < share for share in (0.5, 0.2))

    def of(at: tuple[slice, slice]) -> Float32Array:
        return filtered_heights(height[at], sigma[at], some[at], rays[at], rays[at], steep[at], told[at], CELL_M, 0.6)

    part = (slice(row, row + side + 2 * margin), slice(column, column + side + 2 * margin))
    inner = (slice(margin, margin + side),) * 2
    whole = of((slice(None), slice(None)))[part][inner]
    assert np.array_equal(of(part)[inner], whole, equal_nan=True)
    assert np.isfinite(whole).any()


def plane(rows: int, columns: int, east: float, south: float) -> FloatArray:
    """Return heights of a plane that rises by so many metres per metre."""
    row, column = np.mgrid[:rows, :columns]
    return np.asarray(10.0 + CELL_M * (east * column + south * row))


INSIDE = (slice(1, -1), slice(1, -1))


@pytest.mark.parametrize("slope_deg", [-80.0, -55.0, 0.0, 30.0, 57.0, 70.0, 80.0])
@pytest.mark.parametrize("towards_deg", [0.0, 30.0, 45.0, 90.0])
def test_every_cell_of_a_plane_stays(slope_deg: float, towards_deg: float) -> None:
    rise, towards = np.tan(np.radians(slope_deg)), np.radians(towards_deg)
    height = plane(20, 30, rise * np.cos(towards), rise * np.sin(towards))
    # a plane of the steepest correlates as little as a fifth of what is asked of level ground
    correlation = 0.9 if abs(slope_deg) < 57.0 else 0.61 * np.cos(np.radians(slope_deg))
    inside = (slice(2, -2), slice(2, -2))  # in a corner level ground outvotes the plane
    assert np.array_equal(kept(height, correlation)[inside], height[inside].astype(np.float32))


def test_where_a_steep_face_meets_level_ground_every_cell_stays() -> None:
    rise = np.tan(np.radians(70.0)) * CELL_M
    face = np.broadcast_to(np.clip(np.arange(40) - 15.4, 0.0, 9.0) * rise, (24, 40))
    assert np.isfinite(kept(face)[INSIDE]).all()


def test_what_two_photographs_tell_is_no_steep_face() -> None:
    """Neighbours across the corner are further away: along the rows the limit is that of the diagonal."""
    assert np.isnan(kept(plane(20, 30, 1.05 * np.sqrt(2.0) * REACH, 0.0), rays=2)).all()
    assert np.isnan(kept(plane(20, 30, REACH, REACH), rays=2)).all()
    assert np.isfinite(kept(plane(20, 30, 0.9 * REACH, 0.0), rays=2)[INSIDE]).all()


def test_steeper_than_the_steepest_goes() -> None:
    assert np.isnan(kept(plane(20, 30, STEEPEST + 1.05 * np.sqrt(2.0) * REACH, 0.0))).all()


def test_a_face_is_not_asked_to_be_seen_by_photographs_that_it_is_turned_away_from() -> None:
    """What hangs beneath a crown is as steep, but no face."""
    height = plane(9, 9, np.tan(np.radians(75.0)), 0.0).astype(np.float32)
    for slope, face, rays, seen, is_sure in (
        (height, True, 3, 6, True), (height, True, 2, 3, False), (height, True, 3, 8, False),
        (height, False, 3, 6, False), (0.0 * height, True, 3, 6, False), (0.0 * height, False, 4, 6, True),
    ):  # fmt: skip
        agree, see = (np.full(height.shape, n, np.uint8) for n in (rays, seen))
        sure, cosine = sure_cells(slope, agree, see, np.full(height.shape, face), CELL_M)
        assert (sure == is_sure).all()
        level = rays < 3 or not slope.any()
        assert cosine == pytest.approx(1.0 if level else np.cos(np.radians(75.0)), rel=1e-5)


def test_a_large_standard_deviation_does_not_hold_a_scatter_together() -> None:
    """Of a face that is the error of its place, which its neighbours share."""
    rng = np.random.default_rng(5)
    height = rng.uniform(-40.0 * CELL_M, 40.0 * CELL_M, (40, 60)).astype(np.float32)
    count, steep = np.full(height.shape, 4, np.uint8), np.ones(height.shape, np.bool_)
    sigma, some = np.full(height.shape, 20.0 * CELL_M, np.float32), np.full(height.shape, 0.9, np.float32)
    found = filtered_heights(height, sigma, some, count, count, steep, gentle(height), CELL_M, 0.6)
    assert np.isfinite(found[3:-3, 3:-3]).mean() < 0.01


def test_a_face_is_a_patch_and_a_piece_of_a_curtain_belongs_to_neither_side() -> None:
    height = np.zeros((30, 40))
    height[:, 20:] = 8.0
    height[10:14, 18:20] = [3.1, 4.6]
    count, sigma = np.full(height.shape, 3, np.uint8), np.zeros(height.shape, np.float32)
    found = patch_cells(height.astype(np.float32), sigma, count, CELL_M, MANY)
    assert found[12, 18] == 8
    face = plane(30, 40, 2.7, 0.0).astype(np.float32)
    assert (patch_cells(face, sigma, count, CELL_M, MANY) == face.size).all()


@pytest.mark.parametrize("wall_m", [1.5, 2.5, 3.5, 5.0, 9.0])
def test_a_row_that_hangs_between_two_levels_goes(wall_m: float) -> None:
    height = np.zeros((24, 40))
    height[:, 20:] = wall_m
    height[:, 19] = 0.45 * wall_m
    found = kept(height)
    assert np.isnan(found[1:-1, 19]).all()
    assert np.all(found[1:-1, 1:18] == 0.0)
    assert np.all(found[1:-1, 21:-1] == np.float32(wall_m))


def test_a_curtain_between_roof_and_ground_is_taken_away() -> None:
    height = np.zeros((24, 40))
    height[:, 20:] = 8.0
    height[:, 17:20] = [2.0, 4.0, 6.0]
    found = kept(height)
    assert np.isnan(found[1:-1, 17:20]).all()
    assert np.all(found[1:-1, 1:16] == 0.0)
    assert np.all(found[1:-1, 21:-1] == 8.0)


def test_a_height_of_its_own_goes_and_a_wall_leaves_both_sides() -> None:
    height = np.zeros((15, 15))
    height[7, 7] = 3.0
    found = kept(height)
    assert np.isnan(found[7, 7])
    assert np.isfinite(found[INSIDE]).sum() == 13 * 13 - 1


@pytest.mark.parametrize(("correlation", "rays"), [(0.59, 3), (0.9, 1), (np.nan, 3)])
def test_what_the_photographs_do_not_agree_on_goes(correlation: float, rays: int) -> None:
    assert np.isnan(kept(np.zeros((9, 9)), correlation, rays)).all()


def holed(rows: int, columns: int, seed: int) -> BoolArray:
    return np.random.default_rng(seed).random((rows, columns)) < 0.6


def test_a_hole_behind_a_wall_takes_the_height_of_the_ground() -> None:
    height = np.full((40, 40), 2.0, np.float32)
    height[10:30, 10:20] = 12.0
    height[8:32, 20:25] = np.nan
    found = filled_heights(height, CELL_M, 12)
    assert np.all(found[8:32, 20:25] == 2.0)
    assert np.array_equal(found[np.isfinite(height)], height[np.isfinite(height)])


@settings(max_examples=40)
@given(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.integers(1, 8))
def test_a_hole_in_a_plane_is_filled_with_the_plane(east: float, south: float, half: int) -> None:
    """The middle of a hole: what lies on opposite sides of it is met at the same distance."""
    height = plane(33, 33, east, south).astype(np.float32)
    holes = height.copy()
    holes[16 - half : 17 + half, 16 - half : 17 + half] = np.nan
    found = filled_heights(holes, CELL_M, 12)
    assert found[16, 16] == pytest.approx(height[16, 16], abs=1e-5)
    # elsewhere between the lowest and the highest height around it
    edge = height[15 - half : 18 + half, 15 - half : 18 + half]
    assert np.nanmin(found - edge.min()) >= min(0.0, float(height.min() - edge.min())) - 1e-5
    level = filled_heights(np.where(np.isnan(holes), holes, np.float32(3.5)), CELL_M, 12)
    assert np.all(level == np.float32(3.5))


def test_nothing_is_extrapolated() -> None:
    height = np.full((60, 60), np.nan, np.float32)
    height[:, :20] = 5.0
    assert np.isnan(filled_heights(height, CELL_M, 30)[:, 20:]).all()
    height[:, 41:] = 5.0
    assert np.isnan(filled_heights(height, CELL_M, 10)[:, 20:41]).all(), "out of reach from both sides"
    assert FILL_DIRECTIONS > 3, "a straight edge is met in three directions"


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.integers(0, 40), st.integers(1, 9))
def test_filling_does_not_depend_on_the_window(seed: int, row: int, column: int, reach: int) -> None:
    rng = np.random.default_rng(seed)
    height = np.where(rng.random((50, 60)) < 0.15, rng.uniform(0.0, 9.0, (50, 60)), np.nan).astype(np.float32)
    grid = MapGrid(0.0, 100.0, CELL_M, 50, 60)
    window = Window(row, column, min(row + 17, 50), min(column + 13, 60))
    outer = grid.around_window(window, reach + 1)
    part = filled_heights(np.ascontiguousarray(height[outer.slices]), CELL_M, reach)
    at = (slice(row - outer.row, window.row_end - outer.row), slice(column - outer.column, None))
    whole = filled_heights(height, CELL_M, reach)[window.slices]
    assert np.array_equal(part[at][:, : window.shape[1]], whole, equal_nan=True)


def covariances(count: int, rng: np.random.Generator) -> FloatArray:
    root = 0.02 * rng.normal(size=(count, 3, 3))
    return np.asarray(root @ root.transpose(0, 2, 1))


@pytest.mark.parametrize(("east", "south"), [(0.7, -0.4), (2.7, 1.0), (-5.6, 0.0)])
def test_sigma_is_that_of_a_plane_moved_by_the_errors_of_the_photographs(east: float, south: float) -> None:
    """A plane is moved as a whole, many times; its height at a fixed place scatters by what is predicted."""
    rng = np.random.default_rng(6)
    grid = MapGrid(500.0, 900.0, CELL_M, 12, 14)
    one = covariances(1, rng)
    shared = shared_error(np.array([[501.0, 899.0, 3.0], [502.0, 898.0, 3.0]]), np.repeat(one, 2, axis=0), grid, 2.0)
    height, matching = plane(12, 14, east, south).astype(np.float32), np.full((12, 14), 0.013, np.float32)
    sigma = surface_sigma_m(shared, grid, grid.whole, height, matching)
    moved = rng.multivariate_normal(np.zeros(3), one[0], 200_000)
    # south is −north: the height of the moved plane at a fixed place
    error = moved[:, 2] - east * moved[:, 0] + south * moved[:, 1] + 0.013 * rng.normal(size=200_000)
    assert np.allclose(sigma, error.std(), rtol=0.01)


def test_sigma_beside_a_hole_and_a_wall_takes_the_gentler_side() -> None:
    rng = np.random.default_rng(7)
    grid = MapGrid(0.0, 10.0, CELL_M, 8, 8)
    shared = shared_error(np.array([[1.0, 9.0, 0.0]]), covariances(1, rng), grid, 1.0)
    height = np.zeros((8, 8), np.float32)
    height[:, 4:] = 6.0
    level = surface_sigma_m(shared, grid, grid.whole, np.zeros_like(height), np.zeros_like(height))
    walled = surface_sigma_m(shared, grid, grid.whole, height, np.zeros_like(height))
    assert np.array_equal(walled, level)
    alone = np.full((8, 8), np.nan, np.float32)
    alone[4, 4] = 1.0
    assert surface_sigma_m(shared, grid, grid.whole, alone, np.zeros_like(height))[4, 4] == level[4, 4]


def test_shared_errors_are_interpolated_between_nodes_and_do_not_depend_on_the_window() -> None:
    rng = np.random.default_rng(8)
    grid = MapGrid(2000.0, 3000.0, CELL_M, 40, 48)
    place = np.column_stack([rng.uniform(2000, 2012, 300), rng.uniform(2990, 3000, 300), np.zeros(300)])
    height_variance = 1e-4 * (1.0 + (place[:, 0] - 2000.0) / 12.0)
    covariance = np.zeros((300, 3, 3))
    covariance[:, 2, 2] = height_variance
    shared = shared_error(place, covariance, grid, 1.0)
    level = np.zeros((40, 48), np.float32)
    sigma = surface_sigma_m(shared, grid, grid.whole, level, level)
    east, _ = grid.centres_map_m(grid.whole)
    expected = np.sqrt(1e-4 * (1.0 + (east - 2000.0) / 12.0))
    assert np.abs(sigma / expected - 1.0)[2:-2, 4:-4].max() < 0.06  # eight neighbours are not quite at the node
    window = Window(7, 11, 29, 40)
    part = surface_sigma_m(shared, grid, window, level[window.slices], level[window.slices])
    assert np.array_equal(part, sigma[window.slices])
