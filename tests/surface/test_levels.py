"""A surface of several levels: each cell from the finest one that tells its height, with what it strays by."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.surface.dsm import MEASURED_IN, measured_in
from photogram.surface.levels import (
    LevelHeights,
    agreed_level,
    around_cells,
    confirmed,
    margin_cells,
    surface_of_levels,
)

CELL_M = 0.1


def level(height_m: Any, cells: int, row: int = 0, column: int = 0, sigma_m: float = 0.01) -> LevelHeights:
    height = np.asarray(height_m, np.float32)
    whole, no = np.ones(height.shape, np.uint8), np.zeros(height.shape, np.bool_)
    return LevelHeights(
        height, np.full_like(height, sigma_m), np.full_like(height, 1.0 / cells), whole * cells, whole * 5, cells, row,
        column, no, no, np.full_like(height, np.nan),
    )  # fmt: skip


def slope(rows: int, columns: int, cells: int, rise: float = 0.3) -> np.ndarray[Any, Any]:
    """Heights of a plane at the centres of cells, which rises to the south and half as fast to the east."""
    south, east = ((np.arange(n) + 0.5) * cells * CELL_M for n in (rows, columns))
    return rise * south[:, None] + 0.5 * rise * east[None]


def test_each_cell_is_of_the_finest_level_that_has_it() -> None:
    fine = slope(16, 24, 1)
    fine[4:12, 8:16] = np.nan
    two = slope(8, 12, 2)
    two[2:4, 4:8] = np.nan
    made = surface_of_levels(level(fine, 1), [level(two, 2), level(slope(4, 6, 4), 4)], CELL_M)
    expected = np.ones((16, 24), np.uint8)
    expected[4:12, 8:16], expected[4:8, 8:16] = 2, 4
    np.testing.assert_array_equal(made.cells, expected)
    np.testing.assert_array_equal(made.rays, expected)
    np.testing.assert_allclose(made.correlation, 1 / expected)
    np.testing.assert_array_equal(made.height_m[expected == 1], fine[expected == 1].astype(np.float32))
    # a plane is a plane at every level; only beside what is missing there is nothing to go on
    np.testing.assert_allclose(made.height_m[9:12, 10:14], slope(16, 24, 1)[9:12, 10:14], atol=1e-5)
    assert np.abs(made.height_m - slope(16, 24, 1)).max() < 0.3 * 4 * CELL_M


def test_a_hole_of_all_levels_stays_one() -> None:
    none = np.full((8, 8), np.nan)
    made = surface_of_levels(level(none, 1), [level(none[:4, :4], 2)], CELL_M)
    assert np.isnan(made.height_m).all()
    assert not made.cells.any()
    assert not made.rays.any()
    assert not made.correlation.any()


def test_on_level_ground_the_matching_alone_makes_the_sigma() -> None:
    fine = np.full((32, 32), 5.0)
    fine[10:20, 10:20] = np.nan
    made = surface_of_levels(level(fine, 1), [level(np.full((16, 16), 5.0), 2, sigma_m=0.07)], CELL_M)
    assert (made.cells[10:20, 10:20] == 2).all()
    np.testing.assert_allclose(made.sigma_m[10:20, 10:20], 0.07, rtol=1e-5)


def test_what_strays_around_a_cell_is_in_its_sigma() -> None:
    """Heights that scatter by so much about a level one: the mean square of what the window holds."""
    rng = np.random.default_rng(4)
    rough = rng.normal(0.0, 0.5, (64, 64))
    made = surface_of_levels(level(np.full((256, 256), np.nan), 1), [level(rough, 4)], CELL_M)
    inner = made.sigma_m[16:-16, 16:-16]
    # a cell and its neighbours are as far apart as two draws: sqrt(2) of the scatter, less what the cell itself weighs
    assert np.sqrt(np.mean(inner**2)) == pytest.approx(0.5 * np.sqrt(2 * (1 - 9 / 81)), rel=0.05)


def test_finer_heights_count_in_place_of_the_levels_own() -> None:
    """A window of level ground at 0 whose finer cells lie at 1 m in half of it."""
    fine = np.full((40, 40), np.nan)
    fine[:, 20:] = 1.0
    flat = level(np.zeros((10, 10)), 4)
    spread, covered = around_cells(flat, fine.astype(np.float32), fine.astype(np.float32), (0, 0, 4))
    weights = np.array([1, 2, 3, 2, 1]) / 9
    for column, ahead in ((4, weights[3:].sum()), (3, weights[4:].sum()), (2, 0.0), (5, weights[2:].sum())):
        assert spread[5, column] == pytest.approx(np.sqrt(ahead), abs=1e-6)
        assert covered[5, column] == pytest.approx(ahead, abs=1e-6)


def test_beside_a_wall_that_the_finest_level_shows_nothing_is_taken() -> None:
    wall = np.where(np.arange(64) < 32, 0.0, 6.0) * np.ones((64, 1))
    fine = wall.copy()
    fine[:, 31:33] = np.nan
    two = level(wall[::2, ::2], 2)
    made = surface_of_levels(level(fine, 1), [two], CELL_M)
    assert np.isnan(made.height_m[:, 31:33]).all()
    # in a crown, where the finest level has little, the same step is taken, with what it may be off by
    fine[:, 20:44] = np.nan
    made = surface_of_levels(level(fine, 1), [two], CELL_M)
    beside = made.cells[20:40, 31:33] == 2
    assert beside.all()
    assert made.sigma_m[20:40, 31:33].min() > 2.0


@pytest.mark.parametrize("rise", [0.3, 2.4, 4.5])
def test_on_a_steep_plane_larger_cells_lie_on_it_and_confirm_what_does(rise: float) -> None:
    fine, two = level(slope(32, 32, 1, rise), 1), level(slope(16, 16, 2, rise), 2)
    told = replace(fine, rays=np.full((32, 32), 2, np.uint8), seen=np.full((32, 32), 4, np.uint8))
    assert np.isfinite(confirmed(told, two, CELL_M).height_m[1:-1, 1:-1]).all()
    off = replace(told, height_m=told.height_m + np.float32(1.6 * 2 * CELL_M))
    assert np.isnan(confirmed(off, two, CELL_M).height_m[2:-2, 2:-2]).all()
    nothing = replace(fine, height_m=np.full_like(fine.height_m, np.nan))
    made = surface_of_levels(nothing, [two], CELL_M)
    np.testing.assert_allclose(made.height_m[2:-2, 2:-2], fine.height_m[2:-2, 2:-2], atol=1e-4)
    # and their sigmas say how much of the plane a window of theirs holds
    assert made.sigma_m[8:-8, 8:-8].min() > 0.9 * 2 * CELL_M * rise


def test_on_smooth_steep_ground_no_larger_cell_is_taken_and_none_is_asked() -> None:
    truth = slope(32, 32, 1, 2.4)
    face = np.zeros((32, 32), np.bool_)
    face[:, :16] = True
    fine = truth.copy()
    fine[:, 8:24] = np.nan
    two = level(np.zeros((16, 16)), 2)
    made = surface_of_levels(replace(level(fine, 1), face=face), [two], CELL_M)
    expected = np.ones((32, 32), np.uint8)
    expected[:, 8:16], expected[:, 16:24] = 0, 2
    np.testing.assert_array_equal(made.cells, expected)
    np.testing.assert_array_equal(np.isfinite(made.height_m), expected > 0)
    doubtful = replace(level(truth, 1), face=face, seen=np.full((32, 32), 5, np.uint8))
    np.testing.assert_array_equal(np.isfinite(confirmed(doubtful, two, CELL_M).height_m)[8:], face[8:])
    # nor is one asked of what pairs tell to a cell
    for off_cells, is_told in ((0.9, True), (-0.9, True), (1.1, False)):
        told = replace(doubtful, pairs_m=doubtful.height_m + np.float32(off_cells * CELL_M))
        np.testing.assert_array_equal(np.isfinite(confirmed(told, two, CELL_M).height_m)[8:], face[8:] | is_told)


def test_where_the_finest_level_tells_steep_ground_a_larger_cell_must_agree_with_pairs() -> None:
    """Among leaves, where it tells little, and on gentle ground a larger cell may lie anywhere."""
    fine = np.full((160, 160), 3.0)
    fine[70:90, 70:90] = np.nan
    pairs = np.full(fine.shape, np.nan, np.float32)
    pairs[70:90, 70:80] = 3.1 + 2.0 * CELL_M
    pairs[70:90, 80:85] = 2.9
    everywhere, two = np.ones(fine.shape, np.bool_), level(np.full((80, 80), 3.0), 2)
    given = replace(level(fine, 1), steep=everywhere, pairs_m=pairs)
    made = surface_of_levels(given, [two], CELL_M).cells[70:90, 70:90]
    assert not made[:, :10].any()
    assert (made[:, 10:15] == 2).all()
    assert not made[:, 15:].any()
    assert (surface_of_levels(replace(given, steep=~everywhere), [two], CELL_M).cells[70:90, 70:90] == 2).all()
    leaves = np.where(np.random.default_rng(3).random(fine.shape) < 0.4, given.height_m, np.float32(np.nan))
    assert (surface_of_levels(replace(given, height_m=leaves), [two], CELL_M).cells > 0).all()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), top=st.integers(0, 30), left=st.integers(0, 30))
def test_a_part_is_as_the_whole(seed: int, top: int, left: int) -> None:
    rng = np.random.default_rng(seed)
    size, side, margin = 240, 200, margin_cells((2, 4, 8))

    def heights(n: int) -> np.ndarray[Any, Any]:
        made = rng.normal(0.0, 0.3, (n, n))
        made[rng.random((n, n)) < 0.5] = np.nan
        return made

    every = {cells: heights(size // cells) for cells in (1, 2, 4, 8)}
    face, steep = (rng.random((size, size)) < share for share in (0.05, 0.5))
    finest = replace(level(every[1], 1), face=face, steep=steep, pairs_m=heights(size).astype(np.float32))
    whole = surface_of_levels(finest, [level(every[n], n) for n in (2, 4, 8)], CELL_M)
    first, last = (max(v, 0) for v in (top, left)), (min(v + side, size) for v in (top, left))
    (r0, c0), (r1, c1) = first, last
    parts = []
    for n in (2, 4, 8):
        r, c = max(r0 // n - 1, 0), max(c0 // n - 1, 0)
        rows, columns = -(-r1 // n) + 1, -(-c1 // n) + 1
        parts.append(level(every[n][r:rows, c:columns], n, r, c))
    cut = {name: layer[r0:r1, c0:c1] for name, layer in vars(finest).items() if np.ndim(layer)}
    part = surface_of_levels(replace(finest, **cut, row=r0, column=c0), parts, CELL_M)
    inner = (slice(margin, side - margin),) * 2
    at = (slice(r0 + margin, r0 + side - margin), slice(c0 + margin, c0 + side - margin))
    for name in ("height_m", "sigma_m", "correlation", "rays", "cells"):
        np.testing.assert_array_equal(getattr(part, name)[inner], getattr(whole, name)[at], err_msg=name)


def test_codes_of_sources_tell_the_side_of_cells() -> None:
    codes = np.array([[0, 1, 2, 3, 4, 5]], np.uint8)
    np.testing.assert_array_equal(measured_in(codes), [[0, 1, 0, 2, 4, 8]])
    assert sorted(MEASURED_IN) == [1, 2, 4, 8]


def test_what_half_of_the_photographs_tell_the_coarser_level_must_confirm() -> None:
    fine, two = level(slope(16, 16, 1), 1), level(slope(8, 8, 2), 2)
    off = fine.height_m.copy()
    off[4:8, 4:8] += 1.0
    gone = two.height_m.copy()
    gone[6:] = np.nan
    for agree, look, asked in ((2, 3, True), (3, 6, True), (3, 4, False), (4, 6, False), (3, 5, True)):
        told = replace(
            fine, height_m=off, rays=np.full((16, 16), agree, np.uint8), seen=np.full((16, 16), look, np.uint8)
        )
        kept = np.isfinite(confirmed(told, replace(two, height_m=gone), CELL_M).height_m)
        expected = np.ones((16, 16), bool)
        if asked:
            expected[4:8, 4:8] = expected[12:] = False
        np.testing.assert_array_equal(kept, expected, err_msg=f"{agree} of {look}")
        alone = np.isfinite(agreed_level(told, (2, 3)).height_m)
        assert alone.all() if not asked else not alone.any()
    assert np.isfinite(agreed_level(replace(told, rays=told.rays), (1, 2)).height_m).all()
