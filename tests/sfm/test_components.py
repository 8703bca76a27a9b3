"""Components without common tie points: which are placed, by what, how well, and which are not."""

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from lib.simulated.pieces import in_pieces

from photogram.adjustment.oriented_subset import without_marks
from photogram.arrays import FloatArray, IntArray
from photogram.camera import Pose
from photogram.errors import OrientationError
from photogram.sfm.orientation import Orientation, OrientationSettings, georeferenced_again, orient
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block

PLAN = replace(
    whole_survey_plan(800), strips=4, photographs_per_strip=5, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    control_points=20, check_points=0,
)  # fmt: skip
AUTO = OrientationSettings()
MOVED = np.array([100.0, -50.0, 10.0])


@cache
def two(plan: SurveyPlan = PLAN, seed: int = 1, pieces: int = 2) -> tuple[SimulatedBlock, IntArray]:
    return in_pieces(simulate_block(plan, seed, tie_points=700, mismatches=0.05), pieces)


def bare(block: Block, *, gnss: IntArray | None = None, control: bool = True, attitudes: bool = True) -> Block:
    """The block before it is oriented, with the measured positions of the photographs ``gnss`` alone."""
    kept = range(len(block.photographs)) if gnss is None else gnss.tolist()
    photographs = tuple(
        replace(
            p,
            gnss_world_m=p.gnss_world_m if i in kept else None,
            gnss_sigma_m=p.gnss_sigma_m if i in kept else None,
            attitude_world_from_camera=p.attitude_world_from_camera if attitudes and i in kept else None,
            attitude_sigma_rad=p.attitude_sigma_rad if attitudes and i in kept else None,
        )
        for i, p in enumerate(block.photographs)
    )
    points = block.control_points
    points = points if control else points.with_roles(["check"] * len(points))
    return replace(block, photographs=photographs, poses=(None,) * len(photographs), control_points=points)


def errors_m(orientation: Orientation, simulated: SimulatedBlock) -> FloatArray:
    """Distances (N,) from the true projection centres, NaN without a pose."""
    pairs = zip(orientation.poses, simulated.truth.poses, strict=True)
    none = Pose(np.eye(3), np.full(3, np.nan))
    return np.array([np.linalg.norm((p or none).position_world_m - true.position_world_m) for p, true in pairs])


@pytest.mark.parametrize("method", ["auto", "growth"])
@pytest.mark.parametrize("pieces", [2, 4])
def test_measured_positions_place_every_component(method: Literal["auto", "growth"], pieces: int) -> None:
    made, piece = two(pieces=pieces)
    oriented = orient(bare(made.block, control=False), replace(AUTO, method=method))
    assert oriented.registered.all()
    assert oriented.method == ("attitude" if method == "auto" else "growth")
    assert oriented.ties == ("GNSS positions",) * pieces
    assert len(np.unique(oriented.component)) == pieces
    for number in range(pieces):
        assert len(np.unique(piece[oriented.component == number])) == 1
    assert np.nanmax(errors_m(oriented, made)) < 8.0


def test_control_points_place_every_component_without_any_position() -> None:
    made, _ = two()
    oriented = orient(bare(made.block, gnss=np.zeros(0, dtype=np.int64)), AUTO)
    assert oriented.registered.all()
    assert oriented.ties == ("control points", "control points")
    assert errors_m(oriented, made).max() < 1.0


def test_marked_points_tie_what_nothing_else_places() -> None:
    """Check points along the cut, whose coordinates place nothing, are marked in photographs of both sides."""
    made, piece = two(replace(PLAN, side_overlap=0.7, control_points=60))
    oriented = orient(bare(made.block, gnss=np.flatnonzero(piece == 0), control=False), AUTO)
    assert oriented.registered.all()
    assert set(oriented.ties) == {"GNSS positions", "marked points"}
    assert errors_m(oriented, made).max() < 12.0


def test_a_component_that_nothing_ties_is_named_and_left_out() -> None:
    made, piece = two()
    block = bare(made.block, gnss=np.flatnonzero(piece == 0), control=False)
    oriented = orient(without_marks(block, np.zeros(len(block.control_points.mark_point), dtype=bool)), AUTO)
    np.testing.assert_array_equal(oriented.registered, piece == 0)
    reason = oriented.reason[int(np.flatnonzero(piece == 1)[0])]
    assert "component of 10 photographs that shares no tie points with the block, and that nothing else ties" in reason
    assert "0 control points are marked in two of them, 0 have a GNSS position" in reason


def test_positions_that_contradict_shape_and_attitudes_place_no_further_component() -> None:
    """The positions of one half fit it when it is turned by 180° about the vertical."""
    made, piece = two()
    half = np.flatnonzero(piece == 0)
    middle = np.array([made.block.photographs[i].gnss_world_m for i in half]).mean(axis=0)
    photographs = list(made.block.photographs)
    for i in half.tolist():
        at = photographs[i].gnss_world_m
        assert at is not None
        photographs[i] = replace(photographs[i], gnss_world_m=middle + (at - middle) * [-1.0, -1.0, 1.0])
    block = bare(replace(made.block, photographs=tuple(photographs)), control=False)
    none = np.zeros(len(block.control_points.mark_point), dtype=bool)
    oriented = orient(without_marks(block, none), replace(AUTO, method="growth"))
    assert oriented.registered.sum() == 10
    assert "its GNSS positions do not agree with its shape" in " ".join(oriented.reason)


def test_photographs_of_a_site_far_away_are_left_out_and_told() -> None:
    made, piece = two()
    away = np.array([30_000.0, 0.0, 0.0])
    photographs = tuple(
        replace(p, gnss_world_m=p.gnss_world_m + away) if n == 1 and p.gnss_world_m is not None else p
        for p, n in zip(made.block.photographs, piece.tolist(), strict=True)
    )
    block = bare(replace(made.block, photographs=photographs), control=False)
    block = without_marks(block, np.zeros(len(block.control_points.mark_point), dtype=bool))
    oriented = orient(block, replace(AUTO, method="growth"))
    left = np.flatnonzero(~oriented.registered)
    assert len(left) == 10
    assert all("it lies 30.0 km off: another site, give it a project of its own" in oriented.reason[i] for i in left)


def test_components_take_the_calibration_of_the_first() -> None:
    made, piece = two(replace(PLAN, calibration_source="exif"))
    oriented = orient(bare(made.block), replace(AUTO, method="growth"))
    assert oriented.registered.all()
    assert len(oriented.parameters) == 1
    focal = made.truth.camera.focal_px
    assert oriented.parameters[0][0] == pytest.approx(focal, rel=0.05)
    assert errors_m(oriented, made)[piece == 1].max() < 6.0


def test_new_control_coordinates_place_every_component_again() -> None:
    made, _ = two()
    block = bare(made.block, gnss=np.zeros(0, dtype=np.int64))
    oriented = orient(block, AUTO)
    moved = replace(block.control_points, position_world_m=block.control_points.position_world_m + MOVED)
    again = georeferenced_again(replace(block, control_points=moved), oriented, AUTO)
    for before, after in zip(oriented.poses, again.poses, strict=True):
        assert before is not None
        assert after is not None
        shift = after.position_world_m - before.position_world_m
        np.testing.assert_allclose(shift, MOVED, atol=0.5)


def test_a_photograph_of_few_tie_points_joins_where_its_position_confirms_it() -> None:
    """It is left with 12 tie points, fewer than the 20 that are asked of one without a position."""
    made, _ = two(pieces=1)
    block = bare(made.block, control=False, attitudes=False)
    tie = block.tie_points
    own = np.flatnonzero(tie.photograph == 7)
    rng = np.random.default_rng(4)
    kept = np.ones(len(tie.photograph), dtype=bool)
    kept[own] = False
    seen = np.bincount(tie.point[kept], minlength=len(tie)) >= 3
    kept[rng.permutation(own[seen[tie.point[own]] & ~made.mismatch[own]])[:12]] = True
    points = np.bincount(tie.point[kept], minlength=len(tie)) >= 2
    few = replace(block, tie_points=tie.select(points, kept & points[tie.point]))
    confirmed = orient(few, replace(AUTO, method="growth"))
    assert confirmed.registered.all()
    assert errors_m(confirmed, made)[7] < 10.0
    photographs = list(few.photographs)
    photographs[7] = replace(photographs[7], gnss_world_m=np.array([400.0, 400.0, 80.0]))
    contradicted = orient(replace(few, photographs=tuple(photographs)), replace(AUTO, method="growth"))
    assert np.flatnonzero(~contradicted.registered).tolist() == [7]


def test_nothing_placed_says_why_the_largest_is_not() -> None:
    made, _ = two()
    block = bare(made.block, gnss=np.zeros(0, dtype=np.int64), control=False)
    with pytest.raises(OrientationError, match="cannot be georeferenced"):
        orient(block, AUTO)
