"""The accuracy that is expected of a flight, against what its adjustment gives and against a second computation."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.desk.coverage.expected_accuracy import AccuracyGrid, expected_accuracy, unplaced
from photogram.desk.coverage.tagged_flight import TaggedFlight
from photogram.gnss import Solution
from photogram.simulation.observations import simulate_block
from photogram.simulation.survey_plan import whole_survey_plan
from photogram.survey import Block

PLAN = replace(whole_survey_plan(), control_points=5, check_points=15, mark_sigma_px=0.5, relief_m=3.0)


def flight_of(block: Block) -> TaggedFlight:
    """Return the flight as tags that are without error would place it."""
    poses = [pose for pose in block.poses if pose is not None]
    count, points = len(poses), block.control_points
    none = np.zeros(0, dtype=np.int64)
    unmarked = replace(
        points, mark_photograph=none, mark_point=none, mark_pixel=np.zeros((0, 2)),
        mark_covariance_px2=np.zeros((0, 2, 2)),
    )  # fmt: skip
    return TaggedFlight(
        frame=block.frame,
        cameras=block.cameras,
        camera=np.array([p.camera for p in block.photographs]),
        name=block.photograph_names,
        flight=tuple(p.flight for p in block.photographs),
        rotation=np.array([pose.rotation_world_from_camera for pose in poses]),
        turned=np.ones(count, dtype=bool),
        centre_world_m=np.array([pose.position_world_m for pose in poses]),
        solution=tuple[Solution, ...](["single"] * count),
        ground_world_m=float(np.median(points.position_world_m[:, 2])),
        ground_by_tags=False,
        unplaced=0,
        block=replace(block, control_points=unmarked),
    )


@pytest.fixture(scope="module")
def block() -> Block:
    return simulate_block(PLAN, 3, tie_points=1500, sigma_px=0.5).block


def grid_of(flight: TaggedFlight) -> AccuracyGrid:
    found = expected_accuracy(flight)["grid"]
    assert found is not None, expected_accuracy(flight)["sentences"]
    return found


def test_it_is_what_the_adjustment_says_of_check_points(block: Block) -> None:
    found = grid_of(flight_of(block))
    result = adjust(block, AdjustmentSettings(estimate_sigmas=False))
    checks = [i for i, role in enumerate(block.control_points.role) if role == "check"]
    sigma = np.sqrt(np.einsum("gii->gi", result.covariances.ground_m2[checks]))
    place = block.frame.map_from_world(block.control_points.position_world_m[checks])
    column = ((place[:, 0] - found["west_map_m"]) / found["cell_m"]).astype(int)
    row = ((found["north_map_m"] - place[:, 1]) / found["cell_m"]).astype(int)
    cell = row * found["columns"] + column
    names: tuple[tuple[Literal["plan_m", "height_m"], FloatArray], ...] = (
        ("plan_m", np.hypot(sigma[:, 0], sigma[:, 1])),
        ("height_m", sigma[:, 2]),
    )
    for name, adjusted in names:
        expected = np.array([np.nan if v is None else v for v in found[name]])[cell]
        ratio = adjusted / expected
        assert 0.8 < np.median(ratio) < 1.25, (name, ratio)


def test_the_next_point_gives_what_it_promises(block: Block) -> None:
    """As the same computation does with that point among the others."""
    sparse = replace(block, control_points=block.control_points.select(np.arange(len(block.control_points.name)) < 1))
    flight = flight_of(sparse)
    before, found = expected_accuracy(flight), expected_accuracy(flight)
    assert before == found  # the same draws
    best = found["next_point"]
    assert best is not None
    points = flight.block.control_points
    more = replace(
        points,
        name=(*points.name, "next"),
        role=(*points.role, "control"),
        position_world_m=np.vstack(
            [points.position_world_m, block.frame.world_from_map(np.array([best["position_map_m"]]))]
        ),
        sigma_m=np.vstack([points.sigma_m, np.median(points.sigma_m, axis=0)]),
        controlled=np.vstack([points.controlled, [True] * 3]),
        sigma_assumed=np.append(points.sigma_assumed, False),
        mark_sigma_assumed=np.append(points.mark_sigma_assumed, False),
    )
    further = replace(flight, block=replace(flight.block, control_points=more))
    after = grid_of(further)
    assert found["grid"] is not None
    first = [float(v) for v in found["grid"]["height_m"] if v is not None]
    then = [float(v) for v in after["height_m"] if v is not None]
    assert len(first) == len(then)
    assert np.all(np.array(then) <= np.array(first) * (1 + 1e-9))
    text = expected_accuracy(further)["sentences"][0]["text"]
    assert f"± {100 * best['plan_m']:.1f} cm in plan and ± {100 * best['height_m']:.1f} cm in height" in text


def test_a_single_strip_encloses_no_area_and_is_told_all_the_same(block: Block) -> None:
    flight = flight_of(block)
    strip = np.arange(6)
    photographs = tuple(block.photographs[i] for i in strip)
    level = flight.centre_world_m[strip] * [1.0, 1.0, 0.0] + [0.0, 0.0, flight.centre_world_m[0, 2]]
    on_a_line = level[0] + np.outer(np.linspace(0.0, 1.0, len(strip)), level[-1] - level[0])
    one = replace(
        flight, camera=flight.camera[strip], name=flight.name[:6], flight=flight.flight[:6],
        rotation=flight.rotation[strip], turned=flight.turned[strip], centre_world_m=on_a_line,
        block=replace(
            flight.block, photographs=photographs,
            poses=tuple(Pose(R, C) for R, C in zip(flight.rotation[strip], on_a_line, strict=True)),
        ),
    )  # fmt: skip
    assert grid_of(one)
    assert "median within the survey" in expected_accuracy(one)["sentences"][0]["text"]
    few = replace(
        one, name=one.name[:2], camera=one.camera[:2], rotation=one.rotation[:2], centre_world_m=on_a_line[:2]
    )
    few = replace(few, block=replace(one.block, photographs=photographs[:2], poses=one.block.poses[:2]))
    assert expected_accuracy(few)["sentences"][0]["text"] == "No place is seen by three photographs."


def test_what_does_not_determine_a_survey_is_said(block: Block) -> None:
    flight = flight_of(block)
    bare = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs)
    none = np.zeros(len(block.control_points.name), dtype=bool)
    for there, words in (
        (replace(flight, ground_world_m=None), "nothing tells how high"),
        (replace(flight, centre_world_m=flight.centre_world_m * [1e3, 1e3, 1.0]), "do not overlap"),
        (
            replace(
                flight,
                block=replace(flight.block, photographs=bare, control_points=flight.block.control_points.select(none)),
            ),
            "do not determine the survey",
        ),
    ):
        found = expected_accuracy(there)
        assert (found["grid"], found["next_point"]) == (None, None)
        assert [sentence["severity"] for sentence in found["sentences"]] == ["warning"]
        assert words in found["sentences"][0]["text"]
    assert "No photograph has a position" in unplaced()["sentences"][0]["text"]
