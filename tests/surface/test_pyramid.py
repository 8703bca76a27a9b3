"""The levels of dense matching: grids that nest, ranges that hold the truth, nothing read from beyond the grid."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import Float32Array, FloatArray
from photogram.camera import Pose
from photogram.errors import PhotogramError
from photogram.grid import MapGrid, Window
from photogram.simulation.simulated_survey import SimulatedSurvey, SurveyPlan, simulate, truth_surface
from photogram.surface.dense.pyramid import (
    AROUND_CELLS,
    CLOSELY,
    COARSEST_MEASURED,
    DOUBTFUL_BETWEEN,
    MOST_STEPS,
    KnownGround,
    Level,
    Prior,
    correlation_histogram,
    finer_prior,
    first_prior,
    known_ground,
    least_correlation_of,
    mapped_ground,
    median_of_known,
    plan_levels,
)
from photogram.surface.dense.resolution import choose_views
from photogram.surface.views import Views
from photogram.survey import Block, TiePoints

CELL_M = 0.25


@pytest.fixture(scope="module")
def made() -> SimulatedSurvey:
    """Six photographs over hills, buildings and trees; nothing is rendered."""
    return simulate(SurveyPlan(strips=2, photographs_per_strip=3, flying_height_m=60.0, buildings=6, trees=30), 12)


def tie_points(made: SimulatedSurvey, count: int = 1500) -> FloatArray:
    """Return points (N, 3) of the world on the surface, roofs and trees included."""
    reach = 0.45 * (made.scene.extent_m[2] - made.scene.extent_m[0])
    plan = np.random.default_rng(5).uniform(-reach, reach, (count, 2))
    return np.column_stack([plan, made.scene.height(plan)])


def views_of(made: SimulatedSurvey) -> Views:
    none = np.zeros(0, np.int64)
    ties = TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    poses: tuple[Pose | None, ...] = made.truth.poses
    return Views.of(Block(made.frame, (made.truth.camera,), made.photographs, poses, ties, made.control_points))


@pytest.fixture(scope="module")
def known(made: SimulatedSurvey) -> KnownGround:
    points = tie_points(made)
    return known_ground(made.frame.map_from_world(points), points, views_of(made), 6)


@pytest.fixture(scope="module")
def levels(made: SimulatedSurvey, known: KnownGround) -> tuple[Level, ...]:
    return plan_levels(known, views_of(made), mapped_ground(made.frame, known, views_of(made), CELL_M, 2).grid)


def truth_of(made: SimulatedSurvey, grid: MapGrid) -> Float32Array:
    """Return the true heights of a grid over the base, NaN beyond the site: those of the next cell of a fine raster."""
    fine = truth_surface(made, 0.1)
    east, north = grid.centres_map_m(grid.whole)
    column = np.floor((east - fine.west_map_m) / fine.cell_m).astype(int)
    row = np.floor((fine.north_map_m - north) / fine.cell_m).astype(int)
    rows, columns = fine.values.shape
    inside = ((row >= 0) & (row < rows))[:, None] & ((column >= 0) & (column < columns))
    value = fine.values[np.ix_(np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1))]
    return np.where(inside, value - np.float32(made.frame.origin_map_m[2]), np.float32(np.nan))


def test_what_tie_points_tell_of_a_survey(made: SimulatedSurvey, known: KnownGround) -> None:
    assert known.flying_height_m == pytest.approx(60.0, abs=4.0)
    assert known.gsd_m == pytest.approx(made.plan.gsd_m, rel=0.07)
    assert 0.05 < known.spread < 1.0


def test_too_little_to_start_from_is_named(made: SimulatedSurvey) -> None:
    points = tie_points(made, 2)
    with pytest.raises(PhotogramError, match="2 in 6 photographs are too few"):
        known_ground(points, points, views_of(made), 6)
    above = tie_points(made) + np.array([0.0, 0.0, 500.0])
    with pytest.raises(PhotogramError, match="above the ground they show"):
        known_ground(above, above, views_of(made), 6)


def test_the_grid_holds_all_that_two_photographs_see(
    made: SimulatedSurvey, known: KnownGround, levels: tuple[Level, ...]
) -> None:
    grid, views = levels[-1].grid, views_of(made)
    points = tie_points(made, 3000)
    seen = (choose_views(views, points, 2)[0] >= 0).all(axis=1)
    place = made.frame.map_from_world(points[seen])
    column, row = (place[:, 0] - grid.west_map_m) / grid.cell_m, (grid.north_map_m - place[:, 1]) / grid.cell_m
    inside = (column >= 0) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
    assert inside.mean() > 0.995
    corners = np.array([[grid.west_map_m, grid.north_map_m]]) + grid.cell_m * np.array(
        [[0, 0], [grid.columns, 0], [0, -grid.rows], [grid.columns, -grid.rows]]
    )
    beyond = corners + 0.5 * known.flying_height_m * np.sign(corners - corners.mean(axis=0))
    outside = made.frame.world_from_map(np.column_stack([beyond, np.full(4, made.frame.origin_map_m[2])]))
    assert not (choose_views(views, outside, 2)[0] >= 0).all(axis=1).any()


def test_levels_nest(levels: tuple[Level, ...]) -> None:
    assert len(levels) > 1
    for coarse, fine in itertools.pairwise(levels):
        a, b = coarse.grid, fine.grid
        assert (a.west_map_m, a.north_map_m, a.cell_m) == (b.west_map_m, b.north_map_m, 2 * b.cell_m)
        assert 0 <= 2 * a.rows - b.rows <= 2 * len(levels)
        assert 0 <= 2 * a.columns - b.columns <= 2 * len(levels)
        assert coarse.reduction == 2 * fine.reduction
        assert coarse.step_m == pytest.approx(2 * fine.step_m)
    assert all(0 < level.spacing <= 1 for level in levels)


def test_the_first_range_holds_the_truth(made: SimulatedSurvey, known: KnownGround, levels: tuple[Level, ...]) -> None:
    level = levels[0]
    truth = truth_of(made, level.grid)
    prior = first_prior(known, level, level.grid.whole, made.frame.origin_map_m[2])
    on_site = np.isfinite(truth)
    assert np.mean((prior.low <= truth)[on_site] & (truth <= prior.high)[on_site]) > 0.998
    assert np.all((prior.low < prior.surface) & (prior.surface < prior.high))
    window = Window(3, 5, min(40, level.grid.rows), min(31, level.grid.columns))
    part = first_prior(known, level, window, made.frame.origin_map_m[2])
    for name in ("low", "high", "surface"):
        assert np.array_equal(getattr(part, name), getattr(prior, name)[window.slices])


def test_finer_ranges_hold_the_truth_and_are_narrow(
    made: SimulatedSurvey, known: KnownGround, levels: tuple[Level, ...]
) -> None:
    """From coarse heights with noise of a third of a step."""
    base = made.frame.origin_map_m[2]
    for coarse, fine in itertools.pairwise(levels):
        first = first_prior(known, fine, fine.grid.whole, base)
        noise = np.random.default_rng(1).normal(0.0, coarse.step_m / 3, (coarse.grid.rows, coarse.grid.columns))
        heights = (truth_of(made, coarse.grid) + noise).astype(np.float32)
        correlation = np.where(np.isfinite(heights), np.float32(0.9), np.float32(np.nan))
        prior = finer_prior(heights, correlation, coarse.grid.whole, fine, fine.grid.whole, first)
        truth = truth_of(made, fine.grid)
        on_site = np.isfinite(truth)
        assert np.mean((prior.low <= truth)[on_site] & (truth <= prior.high)[on_site]) > 0.985
        assert np.median(prior.high - prior.low) < 0.7 * np.median(first.high - first.low)


def flat_prior(shape: tuple[int, int]) -> Prior:
    low, high, middle = (np.full(shape, value, np.float32) for value in (-50.0, 50.0, 0.0))
    return Prior(low, high, middle)


@settings(max_examples=80)
@given(st.data(), st.integers(1, 70), st.integers(1, 61), st.booleans())
def test_a_finer_range_needs_a_few_cells_around_it_and_no_more(
    data: st.DataObject, rows: int, columns: int, odd: bool
) -> None:
    coarse = MapGrid(0.0, 0.0, 1.0, -(-rows // 2) + odd, -(-columns // 2) + odd)
    step_m = data.draw(st.sampled_from([0.4, 0.15]))  # 250 and 667 steps in all
    cells = data.draw(st.sampled_from([1, 2, 4, COARSEST_MEASURED]))
    fine = Level(MapGrid(0.0, 0.0, 0.5, rows, columns), 1, 0.5, step_m, cells)
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    shape = (coarse.rows, coarse.columns)
    heights = np.where(rng.random(shape) < 0.2, np.nan, rng.normal(size=shape)).astype(np.float32)
    correlation = np.where(np.isfinite(heights), np.float32(0.9), np.float32(np.nan))
    row, column = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, columns - 1))
    window = Window(row, column, data.draw(st.integers(row + 1, rows)), data.draw(st.integers(column + 1, columns)))
    half = Window(window.row // 2, window.column // 2, -(-window.row_end // 2), -(-window.column_end // 2))
    at = coarse.around_window(half, 3 if cells == COARSEST_MEASURED and step_m == 0.4 else AROUND_CELLS + 3)
    part = finer_prior(
        np.ascontiguousarray(heights[at.slices]), correlation[at.slices], at, fine, window, flat_prior(window.shape)
    )
    whole = finer_prior(heights, correlation, coarse.whole, fine, fine.grid.whole, flat_prior((rows, columns)))
    for name in ("low", "high", "surface", "worthwhile"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[window.slices])


def test_where_photographs_disagree_all_heights_are_searched_again() -> None:
    level = Level(MapGrid(0.0, 0.0, 0.5, 20, 20), 1, 0.5, 0.4, 2 * CLOSELY)
    heights, correlation = np.full((10, 10), 3.0, np.float32), np.full((10, 10), 0.9, np.float32)
    correlation[4, 4] = 0.2
    prior = finer_prior(heights, correlation, Window(0, 0, 10, 10), level, level.grid.whole, flat_prior((20, 20)))
    again = (prior.low == -50.0) & (prior.high == 50.0)
    assert again[6:12, 6:12].all()
    assert again.sum() == 36
    assert np.all(prior.surface == 3.0)
    heights[7, 7] = np.nan
    holed = finer_prior(heights, correlation, Window(0, 0, 10, 10), level, level.grid.whole, flat_prior((20, 20)))
    assert np.all(np.isfinite(holed.low) & np.isfinite(holed.high) & np.isfinite(holed.surface))


def test_small_cells_search_a_hole_between_the_heights_around_it() -> None:
    """And all heights where none was agreed on as far as is looked."""
    level = Level(MapGrid(0.0, 0.0, 0.5, 60, 60), 1, 0.5, 0.4, CLOSELY)
    heights, correlation = np.full((30, 30), 3.0, np.float32), np.full((30, 30), 0.9, np.float32)
    heights[:4, :4] = np.nan
    prior = finer_prior(heights, correlation, Window(0, 0, 30, 30), level, level.grid.whole, flat_prior((60, 60)))
    assert np.allclose([prior.low[0, 0], prior.high[0, 0]], [3.0 - 0.6, 3.0 + 0.6])
    heights[:20, :20] = np.nan
    prior = finer_prior(heights, correlation, Window(0, 0, 30, 30), level, level.grid.whole, flat_prior((60, 60)))
    assert (prior.low[0, 0], prior.high[0, 0]) == (-50.0, 50.0)
    assert prior.worthwhile is not None
    assert not prior.worthwhile[0, 0]


def test_the_finest_level_searches_doubtful_cells_between_the_heights_around_them() -> None:
    """A roof five metres up, a corner of which was taken for the ground: the roof is tried again there."""
    level = Level(MapGrid(0.0, 0.0, 0.5, 60, 60), 1, 0.5, 0.4)
    heights, correlation = np.zeros((30, 30), np.float32), np.full((30, 30), 0.9, np.float32)
    heights[10:20, 10:20] = 5.0
    heights[10:13, 10:13], correlation[10:13, 10:13] = 0.0, 0.2
    heights[2, 27], correlation[2, 27] = 0.0, 0.2
    prior = finer_prior(heights, correlation, Window(0, 0, 30, 30), level, level.grid.whole, flat_prior((60, 60)))
    beyond = 1.5 * level.step_m
    assert np.allclose(prior.high[20:26, 20:26], 5.0 + beyond)
    assert np.allclose(prior.low[20:26, 20:26], -beyond)
    # the ground is all there is around the other one
    assert np.allclose([prior.low[4, 54], prior.high[4, 54]], [-beyond, beyond])


def test_levels_that_count_leave_out_where_the_coarser_one_scatters_widely() -> None:
    """A wood on the left, level ground on the right; a low hedge in it scatters as well, but over a few steps."""
    level = Level(MapGrid(0.0, 0.0, 0.5, 80, 160), 1, 0.5, 0.4)
    rng = np.random.default_rng(7)
    heights, correlation = np.zeros((40, 80), np.float32), np.full((40, 80), 0.9, np.float32)
    heights[:, :40] = rng.uniform(-40.0, 40.0, (40, 40))
    heights[15:25, 55:65] = rng.uniform(0.0, 8.0, (10, 10))
    at, known = Window(0, 0, 40, 80), flat_prior((80, 160))
    coarsest = replace(level, cells=COARSEST_MEASURED)
    everywhere = finer_prior(heights, correlation, at, coarsest, level.grid.whole, known).worthwhile
    assert everywhere is not None
    assert everywhere.all()
    found = finer_prior(heights, correlation, at, level, level.grid.whole, known)
    assert found.worthwhile is not None
    assert found.worthwhile[:, :60].mean() < 0.1  # nine heights may be near each other by chance
    # four cells of the coarser level from level ground on it tells enough
    assert found.worthwhile[:, 78:].all()


def test_a_range_of_too_many_steps_is_searched_between_confirmed_heights_alone() -> None:
    """From a great flying height; a cell that agreed on a height of its own widens no search."""
    level = Level(MapGrid(0.0, 0.0, 0.5, 60, 60), 1, 0.5, 0.15)
    assert MOST_STEPS * level.step_m < 100.0
    heights, correlation = np.zeros((30, 30), np.float32), np.full((30, 30), 0.9, np.float32)
    heights[10:20, 10:20] = 5.0
    heights[10:13, 10:13], correlation[10:13, 10:13] = 0.0, 0.2
    heights[27:29, 1:3] = 40.0
    correlation[28, 5] = 0.2
    prior = finer_prior(heights, correlation, Window(0, 0, 30, 30), level, level.grid.whole, flat_prior((60, 60)))
    beyond = 1.5 * level.step_m
    assert np.allclose(prior.high[20:26, 20:26], 5.0 + beyond)
    assert np.allclose([prior.low[57, 11], prior.high[57, 11]], [-beyond, beyond])


def test_the_least_correlation_follows_the_ordinary_one() -> None:
    rng = np.random.default_rng(3)
    good = np.clip(rng.normal(0.95, 0.01, 200_000), 0, 1).astype(np.float32)
    poor = np.clip(rng.normal(0.7, 0.08, 200_000), 0, 1).astype(np.float32)
    high, low = (least_correlation_of(correlation_histogram(v)) for v in (good, poor))
    assert low == pytest.approx(0.7 - 3.0 * 0.08, abs=0.005)
    assert low < high < 0.95
    halves = correlation_histogram(poor[:7]) + correlation_histogram(poor[7:])
    assert np.array_equal(halves, correlation_histogram(poor))
    with_holes = np.concatenate([poor, np.zeros(90_000, np.float32), np.full(90_000, np.nan, np.float32)])
    assert least_correlation_of(correlation_histogram(with_holes)) == low
    assert least_correlation_of(correlation_histogram(np.full((3, 3), np.nan, np.float32))) == DOUBTFUL_BETWEEN[0]
    assert least_correlation_of(correlation_histogram(np.full((3, 3), 0.99, np.float32))) == DOUBTFUL_BETWEEN[1]


def test_the_median_takes_spikes_away_and_leaves_holes() -> None:
    z = np.zeros((9, 9), np.float32)
    z[4, 4] = 7.0
    assert np.all(median_of_known(z) == 0)
    z[2, 2] = np.nan
    found = median_of_known(z)
    assert np.isnan(found[2, 2])
    assert np.isnan(found).sum() == 1


def test_one_photograph_sees_no_surface(made: SimulatedSurvey, known: KnownGround) -> None:
    views = views_of(made)
    position = views.position_world_m + 1e4 * np.arange(6)[:, None] * [1.0, 0.0, 0.0]
    apart = replace(views, cameras=views.cameras._replace(position=position))
    with pytest.raises(PhotogramError, match="dense matching needs overlap"):
        mapped_ground(made.frame, known, apart, CELL_M, 2)
