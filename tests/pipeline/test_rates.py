"""From work to seconds: rates, workers, the speed of the machine, and what is not asked for."""

from dataclasses import fields
from typing import get_args

import pytest

from photogram.pipeline.costs.rates import compilation_seconds, predicted_seconds
from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.pipeline import STAGES, stage_named
from photogram.pipeline.stage_costs import Part, Workload
from photogram.pipeline.stage_names import STAGE_NAMES

WORK = Workload(
    photographs=20,
    megapixels=240.0,
    search=27.0,
    comparisons=33.0,
    pairs=150.0,
    key_points=2e5,
    observations=7e4,
    dense_mcells=8.0,
    raster_mcells=12.0,
    contoured_mcells=12.0,
    terrain_mcells=0.0,
    terrain_mblocks=0.0,
    orthophoto_mpx=30.0,
    comparison=1.0,
)


def rate(stage: str, part: str) -> float:
    """Return the seconds of a unit as the stage states them."""
    (found,) = [r.seconds for r in stage_named(stage).costs.rates if r.part == part]
    return found


def test_every_stage_costs_something() -> None:
    assert tuple(stage.name for stage in STAGES) == STAGE_NAMES
    assert all(stage.costs.rates for stage in STAGES)
    assert all(r.seconds > 0 for stage in STAGES for r in stage.costs.rates)
    assert all(bool(stage.costs.kernels) == (stage.costs.compilation_s > 0) for stage in STAGES)


def test_seconds_are_rate_times_amount_shared_among_the_workers() -> None:
    for workers in (1, 2, 8):
        dense = predicted_seconds(STAGES, WORK, Speed(), workers)["dense"] - stage_named("dense").costs.constant_s
        expected = (8.0 * rate("dense", "dense_mcells") + 240.0 * rate("dense", "megapixels")) / workers
        assert dense == pytest.approx(expected)
    one, eight = (predicted_seconds(STAGES, WORK, Speed(), workers)["adjustment"] for workers in (1, 8))
    assert one == eight  # of one block


def test_a_rate_counts_any_part_of_the_work() -> None:
    assert [field.name for field in fields(Workload)] == list(get_args(Part))


def test_a_slower_part_of_the_machine_slows_what_resembles_it() -> None:
    usual, slow = (predicted_seconds(STAGES, WORK, speed, 2) for speed in (Speed(), Speed(dense=3.0)))
    assert slow["dense"] > 2.5 * usual["dense"]
    assert all(slow[stage] == usual[stage] for stage in STAGE_NAMES if stage != "dense")
    slow = predicted_seconds(STAGES, WORK, Speed(2.0, 2.0, 2.0, 2.0), 2)
    assert all(slow[stage] == pytest.approx(2 * usual[stage]) for stage in STAGE_NAMES)


def test_what_is_not_compiled_is_compiled_by_the_plain_speed() -> None:
    nothing, whole = dict.fromkeys(STAGE_NAMES, 0.0), stage_named("dense").costs.compilation_s
    assert compilation_seconds(STAGES, nothing, Speed())["dense"] == whole
    half = compilation_seconds(STAGES, dict.fromkeys(STAGE_NAMES, 0.5), Speed(plain=2.0))
    assert half["dense"] == pytest.approx(whole)
    assert sum(compilation_seconds(STAGES, dict.fromkeys(STAGE_NAMES, 1.0), Speed()).values()) == 0.0
