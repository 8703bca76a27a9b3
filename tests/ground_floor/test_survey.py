from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import check_shape
from photogram.camera import Camera
from photogram.geodesy.frames import LocalFrame
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import Block, ControlPoints, Features, Matches, Photograph, PointCloud, Raster, TiePoints


@st.composite
def tie_points(draw: st.DrawFn) -> TiePoints:
    rays = draw(st.lists(st.integers(0, 4), max_size=8))
    point = np.repeat(np.arange(len(rays)), rays).astype(np.int64)
    photograph = np.concatenate([np.arange(n) for n in rays] + [np.zeros(0)]).astype(np.int64)
    n = len(point)
    position = np.arange(3.0 * len(rays)).reshape(-1, 3)
    colour = (np.arange(3 * len(rays)) % 256).astype(np.uint8).reshape(-1, 3)
    return TiePoints(
        photograph, point, np.arange(n, dtype=np.int64), np.arange(2.0 * n).reshape(-1, 2), np.ones(n), position, colour
    )


CONTROL = ControlPoints(
    name=("A", "K", "B", "L"),
    role=("control", "check", "control", "check"),
    position_world_m=np.arange(12.0).reshape(4, 3),
    sigma_m=np.full((4, 3), 0.01),
    mark_photograph=np.array([0, 0, 0, 1, 1]),
    mark_point=np.array([2, 1, 0, 2, 3]),
    mark_pixel=np.arange(10.0).reshape(5, 2),
    mark_covariance_px2=isotropic_px2(np.arange(5.0)),
)


@given(ties=tie_points())
def test_rays_and_first_observations_count_the_same(ties: TiePoints) -> None:
    first = ties.first_observation
    assert len(first) == len(ties) + 1
    assert first[-1] == len(ties.point)
    np.testing.assert_array_equal(np.diff(first), ties.rays)
    for p in range(len(ties)):
        assert set(ties.point[first[p] : first[p + 1]].tolist()) <= {p}


@settings(max_examples=100)
@given(ties=tie_points(), data=st.data())
def test_selection_keeps_what_the_masks_keep(ties: TiePoints, data: st.DataObject) -> None:
    points = np.array(data.draw(st.lists(st.booleans(), min_size=len(ties), max_size=len(ties))), dtype=bool)
    n = len(ties.point)
    observations = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)), dtype=bool)
    kept = ties.select(points, observations)
    np.testing.assert_array_equal(kept.position_world_m, ties.position_world_m[points])
    np.testing.assert_array_equal(kept.colour, ties.colour[points])
    expected = [i for i in range(n) if observations[i] and points[ties.point[i]]]
    assert kept.feature.tolist() == expected
    np.testing.assert_array_equal(kept.pixel, ties.pixel[expected])
    # A point is the same point under its new number: its position says so.
    np.testing.assert_array_equal(kept.position_world_m[kept.point], ties.position_world_m[ties.point[expected]])
    np.testing.assert_array_equal(ties.select(points).feature, np.flatnonzero(points[ties.point]))


def test_observations_must_be_sorted_and_numbered_within_the_points() -> None:
    def with_points(point: list[int]) -> TiePoints:
        n = len(point)
        zeros = np.zeros(n, dtype=np.int64)
        return TiePoints(
            zeros, np.array(point), zeros, np.zeros((n, 2)), np.ones(n), np.zeros((2, 3)), np.zeros((2, 3), np.uint8)
        )

    assert with_points([0, 1, 1]).rays.tolist() == [1, 2]
    for wrong in ([1, 0], [-1, 0], [0, 2]):
        with pytest.raises(ValueError, match="sorted by point"):
            with_points(wrong)


def test_roles_part_the_points_with_their_marks() -> None:
    control, check = CONTROL.with_role("control"), CONTROL.with_role("check")
    assert (control.name, check.name) == (("A", "B"), ("K", "L"))
    np.testing.assert_array_equal(check.position_world_m, CONTROL.position_world_m[[1, 3]])
    assert control.mark_point.tolist() == [1, 0, 1]
    assert control.mark_photograph.tolist() == [0, 0, 1]
    assert control.mark_sigma_px.tolist() == [0.0, 2.0, 3.0]
    assert [check.name[p] for p in check.mark_point] == ["K", "L"]
    np.testing.assert_array_equal(check.mark_pixel, CONTROL.mark_pixel[[1, 4]])
    assert len(control.with_role("check")) == 0
    assert len(control.with_role("check").mark_point) == 0


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: check_shape("pixel", np.zeros((3, 3)), (None, 2)), r"pixel: shape \(3, 3\), expected \(None, 2\)"),
        (lambda: check_shape("pixel", np.zeros(3), (None, 2)), "pixel"),
        (lambda: Matches(0, 1, np.zeros((4, 3), np.int64)), "index"),
        (lambda: Photograph("a.jpg", 0, gnss_world_m=np.zeros(3)), "a.jpg: a GNSS position needs sigmas"),
        (lambda: Photograph("a.jpg", 0, gnss_sigma_m=np.zeros(3)), "a.jpg: a GNSS position needs sigmas"),
        (lambda: Photograph("a.jpg", 0, attitude_world_from_camera=np.zeros(3)), "attitude_world_from_camera"),
        (lambda: PointCloud(np.zeros((4, 3)), colour=np.zeros((3, 3), np.uint8)), "colour"),
        (lambda: PointCloud(np.zeros((4, 3)), sigma_m=np.zeros(4)), "sigma_m"),
        (lambda: Raster(np.zeros((2, 3), np.float32), 0.0, 0.0, 0.0), "cell size"),
        (lambda: replace(CONTROL, role=("control",)), "role"),
        (lambda: replace(CONTROL, sigma_m=np.zeros((3, 3))), "sigma_m"),
        (lambda: replace(CONTROL, mark_point=np.zeros(4, np.int64)), "mark_point"),
        (
            lambda: Features(
                np.zeros((2, 2)), np.ones(2), np.zeros(3), np.zeros((2, 128), np.uint8), np.zeros((2, 3), np.uint8)
            ),
            "angle_rad",
        ),
    ],
)
def test_wrong_shapes_are_refused_where_they_are_made(make: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make()


def test_a_block_has_one_pose_per_photograph_and_cannot_be_changed() -> None:
    none = np.zeros(0, np.int64)
    ties = TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    camera = Camera("c", 30, 20, 30.0, np.array([14.5, 9.5]))
    frame = LocalFrame("EPSG:25832", (0.0, 0.0, 0.0))
    block = Block(frame, (camera,), (Photograph("a.jpg", 0),), (None,), ties, CONTROL)
    assert block.gnss_offset_sigma_m.tolist() == [0.0, 0.0, 0.0]
    assert len(block.tie_points) == 0
    assert block.photograph_names == ("a.jpg",)
    assert block.registered.tolist() == [False]
    with pytest.raises(ValueError, match="one pose"):
        replace(block, poses=())
    with pytest.raises(FrozenInstanceError):
        block.poses = ()  # type: ignore[misc]
