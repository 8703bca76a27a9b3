"""Surface and orthophoto of a small block in memory, against the truth of a simulated survey."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from makers import simulated

from photogram.arrays import ByteArray
from photogram.errors import PhotogramError
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate
from photogram.surface.block_surfaces import make_orthophoto, match_surface
from photogram.survey import Block

PLAN = SurveyPlan(
    width_px=400,
    height_px=300,
    focal_px=600.0,
    flying_height_m=40.0,
    forward_overlap=0.8,
    side_overlap=0.7,
    strips=2,
    photographs_per_strip=3,
    buildings=0,
    trees=0,
    control_points=4,
    check_points=1,
)
CELL_M = 0.2


def flown() -> tuple[Block, Sequence[ByteArray]]:
    """A block at its true poses with tie points on the true surface, and its photographs."""
    survey = simulate(PLAN, 1)
    made = simulated(PLAN, tie_points=300)
    ties, rng = made.block.tie_points, np.random.default_rng(1)
    low, high = (np.percentile(made.tie_point_position_world_m[:, :2], q, axis=0) for q in (5, 95))
    plan = rng.uniform(low, high, (len(ties), 2))
    place = np.column_stack([plan, survey.scene.height(plan)])
    block = replace(
        made.block,
        frame=survey.frame,
        cameras=(survey.truth.camera,),
        poses=survey.truth.poses,
        tie_points=replace(ties, position_world_m=place),
    )
    return block, [pixels for _, pixels in render_photographs(survey)]


def test_heights_and_colours_of_a_block_are_those_of_its_ground() -> None:
    """Off the true surface by a third of a cell in the median and a cell at most in 95 of 100; every cell of the
    surface has a colour."""
    block, pictures = flown()
    survey = simulate(PLAN, 1)
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pictures]
    surface = match_surface(block, lambda n: np.asarray(grey[n]), cell_m=CELL_M)
    height, known = surface.height, np.isfinite(surface.height.values)
    assert known.mean() > 0.6
    rows, columns = np.nonzero(known)
    place = np.column_stack(
        [height.west_map_m + (columns + 0.5) * CELL_M, height.north_map_m - (rows + 0.5) * CELL_M, height.values[known]]
    )
    world = block.frame.world_from_map(place)
    error_m = np.abs(world[:, 2] - survey.scene.height(world[:, :2]))
    assert np.median(error_m) < 0.3 * CELL_M
    assert np.percentile(error_m, 95) < CELL_M
    assert np.all(surface.sigma.values[known] > 0.0)
    assert np.nanmedian(surface.correlation.values) > 0.8

    image = make_orthophoto(block, height, lambda n: pictures[n])
    assert image.colour.shape == (image.grid.rows, image.grid.columns, 4)
    shown = image.colour[..., 3] == 255
    area_m2 = known.sum() * CELL_M**2
    assert 0.9 * area_m2 < shown.sum() * image.grid.cell_m**2 < 1.2 * area_m2
    assert image.colour[shown][:, :3].std() > 5.0


def test_too_little_is_refused() -> None:
    block, pictures = flown()
    ties = block.tie_points
    nowhere = replace(block, tie_points=replace(ties, position_world_m=np.full_like(ties.position_world_m, np.nan)))
    with pytest.raises(PhotogramError):
        match_surface(nowhere, lambda n: pictures[n][..., 0])
