"""Planes fitted to tie points, and blocks and surfaces in their frames."""

from typing import Any

import numpy as np
import pytest
from lib.simulated.close_range import simulate_close_range
from lib.simulated.facade import upright_rotation
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, project_points
from photogram.geodesy.frames import LocalFrame
from photogram.surface.reference_plane import (
    LEVEL_DEG,
    PlaneFit,
    ReferencePlane,
    block_on_plane,
    fit_plane,
)
from photogram.surface.tin_dsm import PointPrecision, SurfaceSettings, surface_with_sigma
from photogram.survey import PointCloud

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
DOWN = np.diag([1.0, -1.0, -1.0])
CAMERA = Camera("c", 4000, 3000, 3000.0, np.array([1999.5, 1499.5]))


def looking_down(height_m: float = 10.0) -> tuple[Pose, ...]:
    """Photographs from above, of a site of 20 × 12 m."""
    return tuple(Pose(DOWN, np.array([x, y, height_m])) for x in (-6.0, -2.0, 2.0, 6.0) for y in (-3.0, 3.0))


def turned(poses: tuple[Pose, ...], R: FloatArray, shift_m: FloatArray) -> tuple[Pose, ...]:
    return tuple(Pose(R @ p.rotation_world_from_camera, R @ p.position_world_m + shift_m) for p in poses)


def wall(rng: np.random.Generator, count: int = 3000) -> FloatArray:
    """A level site with the relief of a facade: a wall with noise of 5 mm, three tenths of it balconies 1.2 m deep, a
    tenth ground in front of it, up to where the photographs are taken, and a few points far behind."""
    place = rng.uniform([-10.0, -6.0], [10.0, 6.0], (count, 2))
    height = rng.normal(0.0, 0.005, count)
    height[: 3 * count // 10] += 1.2
    ground = slice(3 * count // 10, 4 * count // 10)
    place[ground, 1] = -6.0 + rng.normal(0.0, 0.02, count // 10)
    height[ground] = rng.uniform(0.0, 10.0, count // 10)
    height[-20:] = -30.0
    return np.column_stack([place, height])


def fitted(points: FloatArray, poses: tuple[Pose | None, ...]) -> tuple[PlaneFit, ReferencePlane]:
    fit = fit_plane(points, poses)
    assert isinstance(fit, PlaneFit)
    assert fit.plane is not None
    return fit, fit.plane


@pytest.mark.parametrize("facing_deg", [0.0, 37.0, 180.0, 291.0])
@pytest.mark.parametrize("tilt_deg", [90.0, 60.0, 110.0])
def test_a_wall_with_balconies_and_ground_in_front(facing_deg: float, tilt_deg: float) -> None:
    R, shift = upright_rotation(facing_deg, tilt_deg), np.array([5.0, -40.0, 12.0])
    points = wall(np.random.default_rng(1)) @ R.T + shift
    fit, plane = fitted(points, turned(looking_down(), R, shift))
    found = plane.rotation_world_from_plane
    # 0.5 cm of noise on 1800 points over 20 × 12 m
    assert np.rad2deg(np.arccos(np.clip(found[:, 2] @ R[:, 2], -1.0, 1.0))) < 0.02
    assert np.abs(found - R).max() < 1e-3
    assert fit.tilt_deg == pytest.approx(tilt_deg, abs=0.02)
    assert plane.plane_from_world(shift[None])[0, 2] == pytest.approx(0.0, abs=1e-3)
    assert fit.nmad_m == pytest.approx(0.005, rel=0.1)
    assert fit.on_plane == pytest.approx(0.6, abs=0.03)
    assert found[2, 0] == 0.0, "x is level"
    assert found[2, 1] > 0.0, "y points up"
    assert np.allclose(found.T @ found, np.eye(3), atol=1e-14)
    assert np.linalg.det(found) == pytest.approx(1.0)
    assert np.allclose(np.cross(found[:, 2], plane.origin_world_m), 0.0, atol=1e-9), "the origin is next to the world's"


def test_the_frame_is_as_the_photographs_see_it() -> None:
    """Looking north at a wall: east is to the right of the pictures, up is up."""
    R = upright_rotation(180.0)
    poses = turned(looking_down(), R, np.zeros(3))
    _, plane = fitted(wall(np.random.default_rng(2)) @ R.T, poses)
    assert np.allclose(plane.rotation_world_from_plane, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-3)
    corner = plane.world_from_plane(np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]))
    left, right, below = project_points(CAMERA, poses[0], corner)
    assert left[0] < right[0]
    assert right[1] < below[1]


def test_points_that_are_turned_give_the_plane_turned_with_them() -> None:
    points, poses = wall(np.random.default_rng(3)), looking_down()
    first = upright_rotation(20.0)
    fit, plane = fitted(points @ first.T, turned(poses, first, np.zeros(3)))
    second = Rotation.from_euler("z", 77.0, degrees=True).as_matrix()
    again, other = fitted(points @ (second @ first).T, turned(poses, second @ first, np.zeros(3)))
    assert np.allclose(other.rotation_world_from_plane, second @ plane.rotation_world_from_plane, atol=1e-9)
    assert np.allclose(other.origin_world_m, second @ plane.origin_world_m, atol=1e-8)
    assert again.nmad_m == pytest.approx(fit.nmad_m, rel=1e-6)


def test_the_same_points_give_the_same_plane() -> None:
    R = upright_rotation(20.0)
    points, poses = wall(np.random.default_rng(3)) @ R.T, turned(looking_down(), R, np.zeros(3))
    (_, one), (_, two) = fitted(points, poses), fitted(points, poses)
    assert one.rotation_world_from_plane.tobytes() == two.rotation_world_from_plane.tobytes()
    assert one.origin_world_m.tobytes() == two.origin_world_m.tobytes()


def test_coordinates_go_to_the_world_and_back() -> None:
    rng = np.random.default_rng(4)
    plane = ReferencePlane(np.array([3.0, -2.0, 8.0]), upright_rotation(123.0, 71.0))
    points = rng.uniform(-50.0, 50.0, (100, 3))
    assert np.abs(plane.plane_from_world(plane.world_from_plane(points)) - points).max() < 1e-12
    assert np.allclose(plane.world_from_plane(np.eye(3)) - plane.origin_world_m, plane.rotation_world_from_plane.T)
    A = rng.standard_normal((5, 3, 3))
    C = A @ A.transpose(0, 2, 1)
    n = plane.rotation_world_from_plane[:, 2]
    assert np.allclose(plane.covariance_m2(C)[:, 2, 2], np.einsum("i,nij,j->n", n, C, n))


def symmetric_site(rng: np.random.Generator) -> FloatArray:
    """A site whose best plane is exactly level: every point stands on both sides of both axes."""
    quarter = np.column_stack([rng.uniform(0.2, 10.0, 300), rng.uniform(0.2, 6.0, 300), rng.normal(0.0, 0.05, 300)])
    quarter[:60, 2] += 1.2
    return np.vstack([quarter * np.array([x, y, 1.0]) for x in (-1, 1) for y in (-1, 1)])


def test_a_level_survey_turned_has_the_same_surface_on_its_plane() -> None:
    rng = np.random.default_rng(5)
    points, poses = symmetric_site(rng), looking_down()
    A = 0.01 * rng.standard_normal((2, len(points), 3, 3))
    own, shared = A @ A.transpose(0, 1, 3, 2)
    level = fit_plane(points, poses)
    assert isinstance(level, PlaneFit)
    assert level.plane is None, "the world's serves"
    settings = SurfaceSettings(cell_m=0.25, spike_nmad=0.0)
    before = surface_with_sigma(PointCloud(points), PointPrecision(own, shared), settings)

    R = upright_rotation(212.0)
    fit, plane = fitted(points @ R.T, turned(poses, R, np.zeros(3)))
    assert fit.tilt_deg == pytest.approx(90.0, abs=1e-9)
    on_plane = plane.plane_from_world(points @ R.T)
    turned_own, turned_shared = (plane.covariance_m2(R @ C @ R.T) for C in (own, shared))
    after = surface_with_sigma(PointCloud(on_plane), PointPrecision(turned_own, turned_shared), settings)

    offset_m = points[0, 2] - on_plane[0, 2]  # the plane's height over the level zero
    assert before.heights.values.shape == after.heights.values.shape
    assert (before.heights.west_map_m, before.heights.north_map_m) == (
        after.heights.west_map_m,
        after.heights.north_map_m,
    )
    known = np.isfinite(before.heights.values)
    assert np.array_equal(known, np.isfinite(after.heights.values))
    assert known.mean() > 0.9
    # a triangulation of points that move by 1e-12 may turn an edge over; heights are stored to 1e-7
    assert np.percentile(np.abs(after.heights.values + offset_m - before.heights.values)[known], 99.0) < 1e-6
    assert np.percentile(np.abs(after.sigma.values / before.sigma.values - 1.0)[known], 99.0) < 1e-5


def test_a_block_on_its_plane_has_the_same_pixels() -> None:
    made = simulate_close_range(1)
    plane = ReferencePlane(np.array([0.3, -0.2, 0.1]), upright_rotation(200.0, 85.0))
    block = block_on_plane(made.block, plane)
    assert block.frame == LocalFrame.local()
    back = plane.world_from_plane(block.tie_points.position_world_m)
    assert np.allclose(back, made.block.tie_points.position_world_m, atol=1e-12)
    for before, after in zip(made.block.poses, block.poses, strict=True):
        assert before is not None
        assert after is not None
        seen = project_points(made.block.cameras[0], before, made.block.tie_points.position_world_m)
        assert np.allclose(project_points(block.cameras[0], after, block.tie_points.position_world_m), seen, atol=1e-8)
    assert block.poses[0] is not None
    assert (
        block_on_plane(made.block.__class__(**{**vars(made.block), "poses": (None,) * 8}), plane).poses == (None,) * 8
    )


def test_a_level_site_keeps_the_world() -> None:
    rng = np.random.default_rng(6)
    points = np.column_stack([rng.uniform(-10, 10, (500, 2)), rng.normal(0.0, 0.3, 500)])
    for tilt_deg, is_level in ((0.0, True), (LEVEL_DEG - 2.0, True), (LEVEL_DEG + 2.0, False), (35.0, False)):
        R = upright_rotation(70.0, tilt_deg)
        fit = fit_plane(points @ R.T, turned(looking_down(), R, np.zeros(3)))
        assert isinstance(fit, PlaneFit)
        assert (fit.plane is None) == is_level
        assert fit.tilt_deg == pytest.approx(tilt_deg, abs=0.6)


def test_hills_are_no_reason_to_leave_the_map() -> None:
    """A relief of a third of the flying height: the best plane is level all the same."""
    rng = np.random.default_rng(7)
    place = rng.uniform(-100, 100, (3000, 2))
    height = 8.0 * np.sin(place[:, 0] / 20.0) + 7.0 * np.cos(place[:, 1] / 17.0)
    poses = tuple(Pose(DOWN, np.array([x, y, 60.0])) for x in (-60.0, 0.0, 60.0) for y in (-60.0, 0.0, 60.0))
    fit = fit_plane(np.column_stack([place, height]), poses)
    assert isinstance(fit, PlaneFit)
    assert fit.plane is None


def test_a_ceiling_has_a_frame_too() -> None:
    R = np.diag([1.0, -1.0, -1.0])
    rng = np.random.default_rng(8)
    points = np.column_stack([rng.uniform(-10, 10, (500, 2)), rng.normal(0.0, 0.01, 500)])
    _, plane = fitted(points @ R.T, turned(looking_down(), R, np.zeros(3)))
    assert np.allclose(plane.rotation_world_from_plane, R, atol=1e-2)
    assert np.linalg.det(plane.rotation_world_from_plane) == pytest.approx(1.0)


def around(count: int, radius_m: float) -> tuple[Pose, ...]:
    """Photographs from all sides, level, of what stands in the middle."""
    return tuple(
        Pose(upright_rotation(a) @ DOWN, -radius_m * (upright_rotation(a) @ DOWN)[:, 2])
        for a in np.linspace(0.0, 360.0, count, endpoint=False)
    )


def test_where_there_is_no_plane_none_is_made_up() -> None:
    rng = np.random.default_rng(9)
    side = upright_rotation(180.0)
    poses = turned(looking_down(), side, np.zeros(3))
    flat = np.column_stack([rng.uniform(-10, 10, (500, 2)), np.zeros(500)]) @ side.T
    line = np.outer(rng.uniform(-10, 10, 500), [1.0, 0.0, 0.0]) + rng.normal(0.0, 0.01, (500, 3))
    ground = np.column_stack([rng.uniform(-10, 10, (500, 2)), -1.5 + rng.normal(0.0, 0.01, 500)])
    ball = rng.standard_normal((500, 3))
    ball *= (8.0 * rng.uniform(0.0, 1.0, 500) ** (1 / 3) / np.linalg.norm(ball, axis=1))[:, None]
    for points, taken, reason in (
        (flat[:10], poses, "10 tie points are too few"),
        (flat, around(12, 20.0), "look to all sides"),
        (line, poses, "plane"),
        (ground, poses, "no plane that the photographs face"),
        (ball, poses, "no plane that the photographs face"),
    ):
        found = fit_plane(points, taken)
        assert isinstance(found, str), reason
        assert reason in found


def test_points_without_a_position_and_photographs_without_a_pose_take_no_part() -> None:
    R = upright_rotation(20.0)
    points, poses = wall(np.random.default_rng(3)) @ R.T, turned(looking_down(), R, np.zeros(3))
    fit, plane = fitted(points, poses)
    more, other = fitted(np.vstack([points, np.full((7, 3), np.nan)]), (*poses, None))
    assert more.points == fit.points
    assert np.array_equal(plane.rotation_world_from_plane, other.rotation_world_from_plane)
