"""What cameras do to the difference of two epochs, against adjustments of simulated measurements: what both follow
alike drops out, what is left is as large as predicted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import BoolArray, FloatArray
from photogram.camera import project_points
from photogram.change.epochs.difference_errors import difference_errors
from photogram.errors import SurfaceError
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations
from photogram.volumes.joint_errors import JointErrors

PLAN = SurveyPlan(
    strips=4, photographs_per_strip=4, flights=2, side_overlap=0.75, control_points=0, check_points=0,
    gnss_offset_sigma_m=(0.05, 0.05, 0.1),
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=50.0)
EARLIER = np.arange(16) % 8 < 4
"""Every other strip: both epochs show the same ground."""


@cache
def solved(seed: int, shared: bool) -> tuple[SimulatedBlock, Adjustment, JointErrors]:
    """A survey of two epochs, with tie points across them or each for itself."""
    made = simulate_block(PLAN, seed, tie_points=300, start_position_sigma_m=0.05, start_point_sigma_m=0.05)
    flights = ["may" if early else "june" for early in EARLIER]
    photographs = tuple(replace(p, flight=f) for p, f in zip(made.block.photographs, flights, strict=True))
    block = replace(made.block, photographs=photographs)
    if not shared:
        block = apart(block)
    result = adjust(block, SETTINGS)
    return made, result, difference_errors(result, SETTINGS, EARLIER, ~EARLIER)


def apart(block: Block) -> Block:
    """Every tie point twice, each with the rays of one epoch."""
    tie = block.tie_points
    point = 2 * tie.point + ~EARLIER[tie.photograph]
    order = np.argsort(point, kind="stable")
    kept = order[np.bincount(point, minlength=2 * len(tie))[point[order]] >= 2]
    number, own = np.unique(point[kept], return_inverse=True)
    return replace(
        block,
        tie_points=TiePoints(
            tie.photograph[kept], own.astype(np.int64), tie.feature[kept], tie.pixel[kept], tie.sigma_px[kept],
            tie.position_world_m[number // 2], tie.colour[number // 2],
        ),
    )  # fmt: skip


def moved_m(made: SimulatedBlock, result: Adjustment, epoch: BoolArray, points: FloatArray) -> FloatArray:
    """Where an epoch's adjusted photographs put true points (P, 3), seen without noise: errors of the photographs."""
    rays = [
        (i, p, pixel)
        for i in np.flatnonzero(epoch).tolist()
        for p, pixel in enumerate(project_points(made.truth.camera, made.truth.poses[i], points))
        if made.truth.camera.contains(pixel)
    ]
    rays.sort(key=lambda ray: (ray[1], ray[0]))
    photograph, point, pixel = (np.array(column) for column in zip(*rays, strict=True))
    marks = TiePoints(
        photograph, point, np.zeros_like(point), pixel, np.ones(len(point)), np.full((len(points), 3), np.nan),
        np.zeros((len(points), 3), dtype=np.uint8),
    )  # fmt: skip
    block = result.block
    found = consensus_intersections(
        marks.first_observation, photograph, pixel, ideal_observations(block.cameras, block.camera_of, marks),
        np.full(len(point), 100.0), block.oriented_cameras(),
    )[0]  # fmt: skip
    return np.asarray(found - points)


@pytest.mark.parametrize("shared", [True, False])
def test_errors_of_the_difference_are_as_large_as_predicted(shared: bool) -> None:
    squares = []
    for seed in range(30):
        made, result, errors = solved(seed, shared)
        frame = result.block.frame
        middle = np.argsort(np.linalg.norm(errors.place_map_m - errors.place_map_m.mean(axis=0), axis=1))[:5]
        ground = made.tie_point_position_world_m
        near = [int(np.argmin(np.linalg.norm(frame.map_from_world(ground)[:, :2] - at, axis=1))) for at in
                errors.place_map_m[middle]]  # fmt: skip
        error = moved_m(made, result, ~EARLIER, ground[near]) - moved_m(made, result, EARLIER, ground[near])
        factor = errors.factor_m[middle]
        known = np.isfinite(error).all(axis=1)
        sigma = np.sqrt(np.einsum("qir,qir->qi", factor, factor))
        squares.append(((error / sigma)[known] ** 2).mean(axis=0))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx([1.0, 1.0, 1.0], abs=0.3)


def test_common_tie_points_make_the_difference_better_known() -> None:
    tied, apart_ = (solved(1, shared)[2] for shared in (True, False))
    sigma = [np.sqrt(np.einsum("qr,qr->q", e.factor_m[:, 2], e.factor_m[:, 2])).mean() for e in (tied, apart_)]
    assert sigma[0] < 0.5 * sigma[1]


def test_an_epoch_against_itself_has_no_error() -> None:
    _, result, _ = solved(1, True)
    same = difference_errors(result, SETTINGS, EARLIER, EARLIER)
    assert np.abs(same.factor_m).max() < 1e-6


def test_epochs_of_nothing_in_common_are_refused() -> None:
    _, result, _ = solved(1, True)
    with pytest.raises(SurfaceError, match="no ground in common"):
        difference_errors(result, SETTINGS, EARLIER, np.zeros(16, dtype=bool))
