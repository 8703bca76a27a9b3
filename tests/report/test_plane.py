"""What is said of the plane of a surface: coordinates come to the world exactly, and to the map as it promises."""

from typing import Any

import numpy as np
import pytest
from lib.simulated.facade import upright_rotation
from makers import ground_point

from photogram.geodesy.frames import LocalFrame
from photogram.report.plane import plane_file, plane_numbers, points_on_plane
from photogram.surface.reference_plane import PlaneFit, ReferencePlane

UTM = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 120.0))
PLANE = ReferencePlane(np.array([12.0, -7.0, 3.0]), upright_rotation(205.0, 88.0))
CORNER = np.array([[-30.0, -5.0], [40.0, 20.0]])


def fit(plane: ReferencePlane | None, tilt_deg: float) -> PlaneFit:
    return PlaneFit(plane, tilt_deg, 1000, 0.7, 0.12, 0.01, 12.0)


def combined(record: dict[str, Any], origin: str, axes: str, points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """What a user does with plane.json."""
    a = record[axes]
    return np.asarray(record[origin] + points @ np.array([a["x"], a["y"], a["z"]]))


@pytest.mark.parametrize("frame", [UTM, LocalFrame.local()])
def test_coordinates_of_a_plane_come_to_the_world_and_to_the_map(frame: LocalFrame) -> None:
    numbers = plane_numbers(fit(PLANE, 88.0), frame, CORNER, 3, ["contour lines"])
    assert numbers["frame"] is not None
    record: dict[str, Any] = dict(plane_file(numbers["frame"], frame))
    rng = np.random.default_rng(0)
    relief_m = numbers["relief_m"]
    points = rng.uniform([-30.0, -5.0, -relief_m], [40.0, 20.0, relief_m], (200, 3))
    world = combined(record, "origin_world_m", "axes_world", points)
    assert np.abs(world - PLANE.world_from_plane(points)).max() < 1e-12
    exact = frame.map_from_world(world)
    error_m = np.linalg.norm(combined(record, "origin_map_m", "axes_map", points) - exact, axis=1)
    assert error_m.max() <= record["map_error_m"] + 1e-9
    assert record["map_error_m"] < 0.001
    assert numbers["facing_deg"] == (None if frame.is_local else pytest.approx(205.0))
    assert "Contour lines: not made" in numbers["sentence"]
    assert record["world"]["origin_map_m"] == list(frame.origin_map_m)


def test_a_level_plane_is_the_map() -> None:
    numbers = plane_numbers(fit(None, 3.2), UTM, CORNER, 0, [])
    assert (numbers["used"], numbers["frame"], numbers["facing_deg"]) == (False, None, None)
    assert "on the map" in numbers["sentence"]
    assert "3.2°" in numbers["sentence"]


def test_ground_points_on_a_plane() -> None:
    surveyed = PLANE.world_from_plane(np.array([[2.0, 3.0, 0.5]]))
    point = ground_point("C1", "check")
    point["surveyed_map_m"] = UTM.map_from_world(surveyed)[0].tolist()
    (turned,) = points_on_plane([point], PLANE, UTM)
    assert turned["surveyed_map_m"] == pytest.approx([2.0, 3.0, 0.5], abs=1e-6)
    assert turned["axis_roles"] == ["check"] * 3
    # x is level, y nearly up, z nearly level
    assert turned["surveyed_sigma_m"] == pytest.approx([0.01, 0.02, 0.01], rel=0.02)
    mixed = {**point, "axis_roles": ["control", "control", "check"], "surveyed_sigma_m": [0.01, None, 0.02]}
    (turned,) = points_on_plane([mixed], PLANE, UTM)  # type: ignore[list-item]
    assert turned["axis_roles"] == ["control"] * 3, "it took part along a part of every axis of the plane"
    assert turned["surveyed_sigma_m"] == [None] * 3
