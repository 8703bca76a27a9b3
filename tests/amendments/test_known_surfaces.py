"""A known surface is control where it is right, is named where it is wrong, and changed ground does not pull."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.amendments.surfaces.surface_points import fitted, spread
from photogram.arrays import FloatArray
from photogram.report.known_surface import gives_heights, known_surface_numbers
from photogram.results import Adjustment
from photogram.simulation.observations import SimulatedBlock, simulate_block
from photogram.simulation.scene import terrain_height
from photogram.simulation.survey_plan import CONSUMER_GNSS_SIGMA_M, RTK_GNSS_SIGMA_M, SurveyPlan
from photogram.survey import Block, Raster

SIGMA_M, COMMON_M = 0.1, 0.05


def surveyed(*, rtk: bool, seed: int = 4) -> tuple[SimulatedBlock, Block]:
    plan = SurveyPlan(
        strips=3, photographs_per_strip=5, relief_m=10.0, control_points=5, check_points=5,
        gnss_sigma_m=RTK_GNSS_SIGMA_M if rtk else CONSUMER_GNSS_SIGMA_M,
        gnss_offset_sigma_m=(0.02, 0.02, 0.03) if rtk else (1.5, 1.5, 3.0),
        calibration_sigmas=(20.0, 5.0, 5.0, 0.02, 0.02, 0.0, 0.0, 0.0005, 0.0005, 0.0, 0.0),
    )  # fmt: skip
    made = simulate_block(plan, seed, tie_points=1500)
    points = made.block.control_points
    return made, made.block if rtk else replace(made.block, control_points=points.with_roles(["check"] * len(points)))


def surface_of(
    made: SimulatedBlock, *, higher_m: float = 0.0, tilted_m: float = 0.0, heaps: bool = False
) -> KnownSurface:
    rng, frame = np.random.default_rng([made.seed, 7]), made.block.frame
    places = frame.map_from_world(made.tie_point_position_world_m)[:, :2]
    low, high = places.min(axis=0) - 10.0, places.max(axis=0) + 10.0
    columns, rows = np.ceil(high - low).astype(int).tolist()
    east, north = np.meshgrid(low[0] + np.arange(columns) + 0.5, high[1] - np.arange(rows) - 0.5)
    cells = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, frame.origin_map_m[2])])
    for _ in range(3):
        world = frame.world_from_map(cells)
        world[:, 2] = terrain_height(made.seed, made.plan.relief_m, world[:, :2])
        cells[:, 2] = frame.map_from_world(world)[:, 2]
    height = cells[:, 2].reshape(east.shape) + SIGMA_M * rng.standard_normal(east.shape) + higher_m
    height += tilted_m * (east - east.mean()) / 35.0
    if heaps:
        raised = np.zeros_like(height)
        while np.mean(raised > 0.0) < 0.1:
            k = rng.integers(0, east.size)
            raised[np.hypot(east - east.flat[k], north - north.flat[k]) < 6.0] = rng.uniform(1.0, 3.0)
        height -= raised
    return KnownSurface(
        "dem.tif", Raster(height.astype(np.float32), float(low[0]), float(high[1]), 1.0), SIGMA_M, COMMON_M
    )


def mean_height_m(made: SimulatedBlock, result: Adjustment) -> float:
    truth = made.truth.control_position_world_m
    return float(np.mean((result.estimates.ground_world_m - truth)[:, 2]))


@pytest.fixture(scope="module")
def without_control() -> tuple[SimulatedBlock, Block]:
    return surveyed(rtk=False)


def test_a_surface_gives_a_survey_without_control_its_heights(without_control: tuple[SimulatedBlock, Block]) -> None:
    made, block = without_control
    alone = adjust_with_snooping(block, AdjustmentSettings()).result
    assert alone.decisions.known_surface is None
    assert known_surface_numbers(alone) is None
    for heaps in (False, True):
        surface = surface_of(made, heaps=heaps)
        verdict = adjust_with_snooping(block, AdjustmentSettings(), known_surface=surface)
        result, decision = verdict.result, verdict.result.decisions.known_surface
        assert decision is not None
        assert decision.adopted
        assert decision.used > 60
        assert (decision.set_aside > 3) == heaps
        assert abs(decision.mean_m) < 0.02
        assert abs(mean_height_m(made, alone)) > 0.3
        assert abs(mean_height_m(made, result)) < 3.0 * COMMON_M
        assert decision.above_sigma_m[0] == pytest.approx(COMMON_M, rel=0.05)
        assert "known_surface" in result.tests.components.group.tolist()
        assert gives_heights(result)
        numbers = known_surface_numbers(result)
        assert numbers is not None
        assert numbers["gives_heights"]
        assert "The datum of the heights is that of the surface" in numbers["sentence"]
        (made_of,) = [d for d in result.decisions.made if d.about == "known surface"]
        assert made_of.adopted


@pytest.mark.parametrize(("higher_m", "tilted_m", "words"), [(0.3, 0.0, "m above the ground"), (0.0, 0.4, "is tilted")])
def test_a_wrong_surface_is_named_and_left_out(higher_m: float, tilted_m: float, words: str) -> None:
    made, block = surveyed(rtk=True)
    alone = adjust_with_snooping(block, AdjustmentSettings()).result
    surface = surface_of(made, higher_m=higher_m, tilted_m=tilted_m)
    result = adjust_with_snooping(block, AdjustmentSettings(), known_surface=surface).result
    decision = result.decisions.known_surface
    assert decision is not None
    assert not decision.adopted
    assert decision.p < 0.001
    assert words in decision.sentence
    assert result.block.known_surface is None
    np.testing.assert_allclose(result.estimates.ground_world_m, alone.estimates.ground_world_m, atol=1e-9)
    (made_of,) = [d for d in result.decisions.made if d.about == "known surface"]
    assert made_of.rivals == ("heights of GNSS positions and control points",)


def test_a_right_surface_is_not_accused_beside_control() -> None:
    made, block = surveyed(rtk=True)
    result = adjust_with_snooping(block, AdjustmentSettings(), known_surface=surface_of(made)).result
    decision = result.decisions.known_surface
    assert decision is not None
    assert decision.adopted
    assert not gives_heights(result)
    assert abs(mean_height_m(made, result)) < 0.06


def test_a_surface_elsewhere_is_left_out_for_want_of_points(without_control: tuple[SimulatedBlock, Block]) -> None:
    made, block = without_control
    there = surface_of(made)
    moved = replace(there, raster=replace(there.raster, west_map_m=there.raster.west_map_m + 5000.0))
    decision = adjust_with_snooping(block, AdjustmentSettings(), known_surface=moved).result.decisions.known_surface
    assert decision is not None
    assert "fewer than 20 tie points" in decision.sentence


def test_what_stands_out_is_left_out_of_a_fit() -> None:
    rng = np.random.default_rng(3)
    xy: FloatArray = rng.uniform(-1.0, 1.0, (200, 2))
    shapes = np.column_stack([np.ones(200), xy])
    distance = shapes @ [0.5, -0.2, 0.1] + 0.05 * rng.standard_normal(200)
    distance[:30] += 2.0
    x, kept, scale = fitted(distance, np.full(200, 0.05), shapes, np.full(3, 1e3))
    np.testing.assert_allclose(x, [0.5, -0.2, 0.1], atol=0.02)
    assert not kept[:30].any()
    assert kept[30:].mean() > 0.98
    assert scale < 1.3


def test_points_are_spread_over_squares_and_no_cell_counts_twice() -> None:
    xy = np.random.default_rng(1).uniform(0.0, 100.0, (5000, 2))
    chosen = spread(xy, np.arange(5000.0), 10.0)
    apart = np.abs(xy[chosen][:, None] - xy[chosen]).max(axis=2) + 100.0 * np.eye(len(chosen))
    assert apart.min() >= 10.0 * (1.0 - 1e-9)
    # every other point is near a better one, or in the square of one
    assert len(chosen) > 40
    assert chosen[0] == 0
    wide = spread(xy, np.arange(5000.0), 0.1)
    assert 390 <= len(wide) <= 401
    assert np.all(np.diff(wide) > 0)
