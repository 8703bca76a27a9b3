"""The scores of surveys with canopy on heights made for it: perfect ones, with known errors, holes and curtains."""

from dataclasses import replace

import numpy as np
import pytest
from lib.canopy_scores import CANOPY, GROUND, CanopyScores, MapCover, canopy_scores, map_cover, table
from lib.dense_truth import simulated_truth
from lib.simulated.cover_truth import Kind

from photogram.grid import MapGrid
from photogram.simulation.cover.leaves import CoverPlan
from photogram.simulation.simulated_survey import canopy_plan, simulate
from photogram.survey import Raster

SIGMA_M = 0.05
COVER = CoverPlan(hedges=4, fences=3, wood_trees=10, pond_radius_m=5.0)


@pytest.fixture(scope="module", name="cover")
def _cover() -> MapCover:
    plan = replace(canopy_plan(400), trees=40, buildings=4, cell_m=0.2, cover=COVER)
    survey = simulate(plan, 2)
    return map_cover(survey, simulated_truth(survey, 0.36))


def raster(cover: MapCover, values: np.ndarray) -> Raster:
    return cover.truth.grid.raster(values.astype(np.float32))


def scored(cover: MapCover, values: np.ndarray, source: np.ndarray) -> CanopyScores:
    return canopy_scores(
        raster(cover, values), cover, raster(cover, np.full(values.shape, SIGMA_M)), source.astype(np.uint8)
    )


def true_heights(cover: MapCover, window: int = 1) -> np.ndarray:
    found = cover.reference_m(window)
    return np.where(np.isfinite(found), found, cover.cover.ground_m + cover.lift_m)


def test_the_truth_in_the_map_is_the_other_truth(cover: MapCover) -> None:
    solid = np.isin(cover.cover.kind, [Kind.OPEN, Kind.WATER, Kind.GRASS])
    known = np.isfinite(cover.truth.height_map_m) & solid & np.isnan(cover.cover.highest_m)
    error = (true_heights(cover) - cover.truth.height_map_m)[known]
    assert known.sum() > 10_000
    assert np.quantile(np.abs(error), 0.999) < 2e-3


def test_the_groups_share_no_cell_and_leave_none_out(cover: MapCover) -> None:
    assert np.all(sum(m.astype(int) for m in cover.groups.values()) == 1)
    assert all(m.sum() > 50 for m in cover.groups.values())


@pytest.mark.parametrize(("code", "window"), [(1, 1), (3, 2), (4, 4), (5, 8), (9, 1)])
def test_errors_over_sigmas_are_those_put_in(cover: MapCover, code: int, window: int) -> None:
    rng = np.random.default_rng(code)
    values = true_heights(cover, window)
    values += SIGMA_M * rng.standard_normal(values.shape)
    found = scored(cover, values, np.full(values.shape, code))
    assert {e.code for e in found.errors} == {code}
    for e in found.errors:
        if e.cells > 2000:
            assert e.robust == pytest.approx(1.0, abs=0.1)
            assert e.rms == pytest.approx(1.0, abs=0.1)
            assert e.far < 0.001
    assert {GROUND, CANOPY} <= {e.group for e in found.errors}
    assert found.far == 0.0
    assert found.completeness[0].any_level == 1.0
    assert found.completeness[0].finest == float(code == 1)
    assert "in curtains" in table(found)


def test_levels_are_judged_apart_and_holes_counted(cover: MapCover) -> None:
    values, source = true_heights(cover), np.ones(cover.cover.kind.shape)
    coarse = true_heights(cover, 4)
    rng = np.random.default_rng(0)
    level = rng.random(values.shape)
    values = np.where(level < 0.3, coarse + 0.5, values)
    source = np.where(level < 0.3, 4, source)
    values[level > 0.9], source[level > 0.9] = np.nan, 0
    found = scored(cover, values, source)
    ground = {e.code: e for e in found.errors if e.group == GROUND}
    assert ground[1].median_m == pytest.approx(0.0, abs=1e-4)
    assert ground[4].median_m == pytest.approx(0.5, abs=1e-4)
    assert ground[4].far == 1.0
    complete = {c.group: c for c in found.completeness}[GROUND]
    assert complete.any_level == pytest.approx(0.9, abs=0.02)
    assert complete.finest == pytest.approx(0.6, abs=0.02)
    assert found.far == pytest.approx(1 / 3, abs=0.02)


def test_water_and_curtains_are_told(cover: MapCover) -> None:
    values, source = true_heights(cover), np.ones(cover.cover.kind.shape)
    clean = scored(cover, values, source)
    assert clean.water_false == 0.0
    assert clean.curtain == 0
    assert clean.under_lines > 100
    water, line = cover.groups["water"], cover.cover.line_m
    high = np.where(np.isfinite(line), np.minimum(cover.cover.ground_m + 3.0, line - 1.0), -np.inf) + cover.lift_m
    wire = np.where(np.isfinite(line), line + cover.lift_m, -np.inf)
    bad = scored(cover, np.maximum(np.where(water, values + 0.4, values), high), source)
    assert bad.water_false == 1.0
    assert bad.water_cells == water.sum()
    assert bad.curtain > 30
    assert scored(cover, np.maximum(values, wire), source).curtain == 0  # the wire itself is none


def test_heights_on_the_ground_below_crowns_and_false_ones_are_told_apart(cover: MapCover) -> None:
    values, plants = true_heights(cover), cover.groups[CANOPY]
    source, ground = np.ones(values.shape), cover.cover.ground_m + cover.lift_m
    rng = np.random.default_rng(3)
    part = rng.random(values.shape)
    values[plants & (part < 0.4)] = ground[plants & (part < 0.4)]
    values[plants & (part > 0.9)] = ground[plants & (part > 0.9)] + 30.0
    values[plants & (part > 0.95)] = ground[plants & (part > 0.95)] - 2.0
    found = scored(cover, values, source)
    assert found.canopy_ground == pytest.approx(0.4, abs=0.06)  # and a few leaves as low as that
    assert found.canopy_false == pytest.approx(0.1, abs=0.01)


def test_a_surface_of_another_size_is_put_on_the_grid(cover: MapCover) -> None:
    values = true_heights(cover)[20:-30, 15:-10]
    grid = cover.truth.grid
    place = MapGrid(grid.west_map_m + 15 * grid.cell_m, grid.north_map_m - 20 * grid.cell_m, grid.cell_m, *values.shape)
    found = canopy_scores(place.raster(values.astype(np.float32)), cover)
    assert {e.code for e in found.errors} == {1}
    assert np.isnan(found.far)
    assert found.completeness[0].any_level > 0.9
