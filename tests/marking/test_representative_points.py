"""Tie points that hold a block together."""

from dataclasses import replace

import numpy as np
from makers import simulated, without_marks

from photogram.marking.predictions import predicted_places
from photogram.marking.representative_points import CELLS, representative_points
from photogram.simulation.simulated_survey import whole_survey_plan

PLAN = replace(whole_survey_plan(), strips=3, photographs_per_strip=4, control_points=6, check_points=2)


def test_places_are_known_nearly_as_well_as_with_all_points() -> None:
    block = without_marks(simulated(PLAN, tie_points=3000).block)
    kept = representative_points(block)
    assert len(kept) < len(block.tie_points) / 5
    whole, some = (
        dict(zip(zip(p.point.tolist(), p.photograph.tolist(), strict=True), p.radius_px.tolist(), strict=True))
        for p in (predicted_places(block), predicted_places(replace(block, tie_points=kept)))
    )
    ratio = [some[place] / whole[place] for place in whole.keys() & some.keys()]
    assert len(ratio) > 50
    assert 0.9 < np.median(ratio) < 1.5


def test_every_photograph_has_points_where_it_had_any() -> None:
    block = simulated(PLAN, tie_points=3000).block
    kept = representative_points(block)
    camera = block.cameras[0]
    for i in range(len(block.photographs)):
        had, has = (
            {tuple(c) for c in (t.pixel[t.photograph == i] // (camera.width_px / CELLS, camera.height_px / CELLS))}
            for t in (block.tie_points, kept)
        )
        assert has == had


def test_a_block_without_tie_points_has_none() -> None:
    block = simulated(PLAN, tie_points=40).block
    bare = replace(block, tie_points=block.tie_points.select(np.zeros(len(block.tie_points), dtype=bool)))
    assert len(representative_points(bare)) == 0
