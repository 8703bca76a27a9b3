from itertools import combinations

import numpy as np
import pytest

from photogram.camera import Camera, Pose, oriented_by, project_points
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import TiePoints
from photogram.triangulation import (
    consensus_intersections,
    ideal_observations,
    intersect_linear,
    intersect_tie_points,
    projection_matrices,
    ray_angles,
)

PLAN = SurveyPlan(strips=2, photographs_per_strip=5, control_points=6, check_points=2)


@pytest.fixture(scope="module")
def exact() -> SimulatedBlock:
    return simulate_block(PLAN, 3, tie_points=400, sigma_px=0.0)


def cameras_and_numbers(block: SimulatedBlock) -> tuple[Camera, np.ndarray]:
    return block.truth.camera, np.zeros(len(block.truth.poses), dtype=np.int64)


def consensus(block: SimulatedBlock, ties: TiePoints, limit_px: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    camera, camera_of = cameras_and_numbers(block)
    ideal = ideal_observations([camera], camera_of, ties)
    limit = np.broadcast_to(limit_px, len(ties.point)).astype(np.float64)
    points, inlier = consensus_intersections(
        ties.first_observation,
        ties.photograph,
        ties.pixel,
        ideal,
        limit,
        oriented_by([camera], camera_of, block.truth.poses),
    )
    return np.asarray(points), np.asarray(inlier)


def largest_angle(directions: np.ndarray) -> float:
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return float(np.arccos(np.clip((unit @ unit.T).min(), -1, 1)))


def test_projection_matrices_take_world_points_to_the_camera_frame(exact: SimulatedBlock) -> None:
    points = exact.tie_point_position_world_m[:5]
    P = projection_matrices(exact.truth.poses)
    for matrix, pose in zip(P, exact.truth.poses, strict=True):
        np.testing.assert_allclose(
            np.column_stack([points, np.ones(5)]) @ matrix.T, pose.camera_from_world(points), atol=1e-9
        )


def test_exact_rays_meet_in_the_exact_points_however_many(exact: SimulatedBlock) -> None:
    ties, truth = exact.block.tie_points, exact.tie_point_position_world_m
    camera, camera_of = cameras_and_numbers(exact)
    ideal = ideal_observations([camera], camera_of, ties)
    points = intersect_tie_points(ties, ideal, exact.truth.poses)
    assert {2, 3, 4, 6} <= set(ties.rays.tolist())
    np.testing.assert_allclose(points, truth, rtol=0, atol=1e-6)


@pytest.mark.parametrize("rays", [2, 3])
def test_a_stated_number_of_rays_uses_the_first_and_skips_points_with_fewer(exact: SimulatedBlock, rays: int) -> None:
    ties, truth = exact.block.tie_points, exact.tie_point_position_world_m
    camera, camera_of = cameras_and_numbers(exact)
    first = ties.first_observation
    # Only the observations that should be used are right: any other that were used would show.
    pixel = ties.pixel + 40.0
    for p in range(len(ties)):
        pixel[first[p] : min(first[p] + rays, first[p + 1])] -= 40.0
    moved = TiePoints(
        ties.photograph, ties.point, ties.feature, pixel, ties.sigma_px, ties.position_world_m, ties.colour
    )
    points = intersect_tie_points(moved, ideal_observations([camera], camera_of, moved), exact.truth.poses, rays)
    enough = ties.rays >= rays
    np.testing.assert_array_equal(np.isfinite(points).all(axis=1), enough)
    np.testing.assert_allclose(points[enough], truth[enough], rtol=0, atol=1e-6)


def test_noisy_rays_meet_where_the_singular_vector_says() -> None:
    block = simulate_block(PLAN, 5, tie_points=150, sigma_px=2.0)
    ties, poses = block.block.tie_points, block.truth.poses
    camera, camera_of = cameras_and_numbers(block)
    ideal = ideal_observations([camera], camera_of, ties)
    points = intersect_tie_points(ties, ideal, poses)
    first = ties.first_observation
    for p in range(len(ties)):
        rows = []
        for i in range(first[p], first[p + 1]):
            pose = poses[ties.photograph[i]]
            R = pose.rotation_world_from_camera.T
            P = np.hstack([R, -R @ pose.position_world_m[:, None]])
            rows += [ideal[i, 0] * P[2] - P[0], ideal[i, 1] * P[2] - P[1]]
        vector = np.linalg.svd(np.array(rows))[2][-1]
        np.testing.assert_allclose(points[p], vector[:3] / vector[3], rtol=0, atol=1e-7)
    assert np.abs(points - block.tie_point_position_world_m).max() > 1e-3


def test_photographs_without_a_pose_take_no_part(exact: SimulatedBlock) -> None:
    ties, truth = exact.block.tie_points, exact.tie_point_position_world_m
    camera, camera_of = cameras_and_numbers(exact)
    poses: list[Pose | None] = list(exact.truth.poses)
    poses[0] = poses[3] = poses[7] = None
    points = intersect_tie_points(ties, ideal_observations([camera], camera_of, ties), poses)
    rays = np.bincount(ties.point[~np.isin(ties.photograph, [0, 3, 7])], minlength=len(ties))
    assert 0 < np.count_nonzero(rays < 2) < len(ties)
    np.testing.assert_array_equal(np.isfinite(points).all(axis=1), rays >= 2)
    np.testing.assert_allclose(points[rays >= 2], truth[rays >= 2], rtol=0, atol=1e-6)
    nothing = intersect_tie_points(ties, ideal_observations([camera], camera_of, ties), [None] * len(poses))
    assert np.isnan(nothing).all()


def test_many_points_at_once_equal_each_alone(exact: SimulatedBlock) -> None:
    rng = np.random.default_rng(0)
    P = projection_matrices(exact.truth.poses[:3])[None].repeat(20, axis=0)
    ideal = rng.uniform(-0.1, 0.1, (20, 3, 2))
    together = intersect_linear(P, ideal)
    for p in range(20):
        np.testing.assert_allclose(intersect_linear(P[p : p + 1], ideal[p : p + 1])[0], together[p], rtol=1e-9)


def test_ideal_observations_use_each_photographs_own_camera(exact: SimulatedBlock) -> None:
    ties = exact.block.tie_points
    other = Camera("other", 1200, 900, 1500.0, np.array([600.0, 440.0]), np.array([0.05, 0.0, 0.0, 0.0]))
    camera_of = (np.arange(len(exact.truth.poses)) % 2).astype(np.int64)
    ideal = ideal_observations([exact.truth.camera, other], camera_of, ties)
    for camera, number in ((exact.truth.camera, 0), (other, 1)):
        mine = camera_of[ties.photograph] == number
        alone = ideal_observations([camera], np.zeros(len(camera_of), np.int64), ties)
        np.testing.assert_array_equal(ideal[mine], alone[mine])


def test_the_ray_angle_is_the_largest_between_used_rays(exact: SimulatedBlock) -> None:
    ties, truth = exact.block.tie_points, exact.tie_point_position_world_m
    centre = np.array([pose.position_world_m for pose in exact.truth.poses])
    used = np.random.default_rng(1).random(len(ties.point)) < 0.6
    angle = ray_angles(ties, used, centre, truth)
    first = ties.first_observation
    for p in range(len(ties)):
        members = [i for i in range(first[p], first[p + 1]) if used[i]]
        expected = largest_angle(truth[p] - centre[ties.photograph[members]]) if len(members) > 1 else 0.0
        assert angle[p] == pytest.approx(expected, abs=1e-7)


def test_rays_that_see_a_point_from_opposite_sides_are_far_apart() -> None:
    n = np.array([0, 0], dtype=np.int64)
    ties = TiePoints(np.array([0, 1]), n, n, np.zeros((2, 2)), np.ones(2), np.zeros((1, 3)), np.zeros((1, 3), np.uint8))
    centre = np.array([[-3.0, 0.0, 4.0], [3.0, 0.0, 4.0]])
    assert ray_angles(ties, np.ones(2, bool), centre, np.zeros((1, 3)))[0] == pytest.approx(2 * np.arctan2(3, 4))


def test_consensus_rejects_planted_mismatches_and_nothing_else() -> None:
    block = simulate_block(PLAN, 11, tie_points=600, sigma_px=0.3, mismatches=0.1)
    ties, truth = block.block.tie_points, block.tie_point_position_world_m
    points, inlier = consensus(block, ties, 3.0)
    right = np.bincount(ties.point[~block.mismatch], minlength=len(ties))
    sound = right >= 3
    assert sound.sum() > 350
    error = np.linalg.norm(points[sound] - truth[sound], axis=1)
    assert error.max() < 0.5
    of_sound = sound[ties.point]
    # A displacement along the epipolar line of a narrow bundle cannot be told; nearly all others can.
    assert np.mean(inlier[of_sound & block.mismatch]) < 0.03
    assert np.mean(inlier[of_sound & ~block.mismatch]) > 0.995
    camera = block.truth.camera
    for i in np.flatnonzero(inlier)[::50]:
        seen = project_points(camera, block.truth.poses[ties.photograph[i]], points[ties.point[i]][None])[0]
        assert np.linalg.norm(seen - ties.pixel[i]) < 3.0


def midpoint(block: SimulatedBlock, ideal: np.ndarray, photographs: list[int]) -> np.ndarray | None:
    """Halfway between two rays where they pass each other, None behind the photographs."""
    poses = [block.truth.poses[i] for i in photographs]
    a, b = (pose.rotation_world_from_camera @ [*xy, 1.0] for pose, xy in zip(poses, ideal, strict=True))
    base = poses[1].position_world_m - poses[0].position_world_m
    s, t, _ = np.linalg.solve(np.column_stack([a, -b, np.cross(a, b)]), base)
    if s <= 0 or t <= 0:
        return None
    return np.asarray((poses[0].position_world_m + s * a + poses[1].position_world_m + t * b) / 2)


def test_consensus_takes_the_pair_with_most_support_and_then_the_smallest_residuals() -> None:
    block = simulate_block(PLAN, 17, tie_points=120, sigma_px=2.0, mismatches=0.2)
    ties, (camera, camera_of) = block.block.tie_points, cameras_and_numbers(block)
    limit = np.random.default_rng(0).uniform(0.5, 6.0, len(ties.point))
    points, inlier = consensus(block, ties, limit)
    ideal = ideal_observations([camera], camera_of, ties)
    first, supports = ties.first_observation, []
    for p in range(len(ties)):
        members = np.arange(first[p], first[p + 1])
        best: tuple[int, float] = (0, 0.0)
        point, agreeing = np.full(3, np.nan), np.zeros(len(members), dtype=bool)
        for i, j in combinations(members.tolist(), 2):
            X = midpoint(block, ideal[[i, j]], ties.photograph[[i, j]].tolist())
            if X is None:
                continue
            seen = np.array(
                [project_points(camera, block.truth.poses[k], X[None])[0] for k in ties.photograph[members]]
            )
            error = np.sum((seen - ties.pixel[members]) ** 2, axis=1) / limit[members] ** 2
            rank = (int(np.sum(error < 1)), -float(np.sum(error[error < 1])))
            if rank[0] and (best[0] == 0 or rank > best):
                best, point, agreeing = rank, X, error < 1
        supports.append(best[0])
        if best[0] < 2:
            point, agreeing = np.full(3, np.nan), np.zeros(len(members), dtype=bool)
        np.testing.assert_allclose(points[p], point, rtol=0, atol=1e-6)
        np.testing.assert_array_equal(inlier[members], agreeing)
    assert {0, 1, 2, 3, 4} <= set(supports)


def test_consensus_of_exact_rays_is_the_exact_point(exact: SimulatedBlock) -> None:
    points, inlier = consensus(exact, exact.block.tie_points, 0.5)
    np.testing.assert_allclose(points, exact.tie_point_position_world_m, rtol=0, atol=1e-6)
    assert inlier.all()


def test_points_without_two_agreeing_rays_are_unknown(exact: SimulatedBlock) -> None:
    ties = exact.block.tie_points
    one, pair = int(np.flatnonzero(ties.rays == 2)[0]), int(np.flatnonzero(ties.rays == 2)[1])
    first = ties.first_observation
    pixel = ties.pixel.copy()
    camera, poses = exact.truth.camera, exact.truth.poses
    a, b = (poses[ties.photograph[first[pair] + k]] for k in (0, 1))
    # Straight off the epipolar line: the two rays pass each other by 30 px.
    base, ray = b.position_world_m - a.position_world_m, exact.tie_point_position_world_m[pair] - b.position_world_m
    off = np.cross(base, ray)
    aside = exact.tie_point_position_world_m[pair] + off / np.linalg.norm(off) * 30 * PLAN.gsd_m
    pixel[first[pair] + 1] = project_points(camera, b, aside[None])[0]
    keep = np.ones(len(ties.point), bool)
    keep[first[one] + 1] = False
    moved = TiePoints(
        ties.photograph, ties.point, ties.feature, pixel, ties.sigma_px, ties.position_world_m, ties.colour
    )
    cut = moved.select(np.ones(len(ties), bool), keep)
    points, inlier = consensus(exact, cut, 3.0)
    unknown = ~np.isfinite(points).all(axis=1)
    assert set(np.flatnonzero(unknown).tolist()) == {one, pair}
    assert not inlier[np.isin(cut.point, [one, pair])].any()
    assert inlier[~np.isin(cut.point, [one, pair])].all()


def test_rays_from_opposite_sides_are_a_half_turn_apart_whatever_the_rounding() -> None:
    count = 100
    centre = np.random.default_rng(2).normal(size=(count, 3))
    unit = centre / np.sqrt((centre**2).sum(axis=1, keepdims=True))
    assert (np.einsum("ij,ij->i", unit, unit) > 1).any(), "no product of unit vectors is above one"
    pair, each = np.arange(2 * count), np.repeat(np.arange(count), 2)
    ties = TiePoints(pair, each, pair, np.zeros((2 * count, 2)), np.ones(2 * count), np.zeros((count, 3)),
                     np.zeros((count, 3), np.uint8))  # fmt: skip
    both = np.stack([centre, -centre], axis=1).reshape(-1, 3)
    angle = ray_angles(ties, np.ones(2 * count, bool), both, np.zeros((count, 3)))
    np.testing.assert_allclose(angle, np.pi, rtol=0, atol=1e-7)


def seen_from(centres: np.ndarray, wrong: dict[int, list[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the consensus of photographs that look down at the point (0, 0, 0), some of them elsewhere."""
    camera = Camera("camera", 1000, 1000, 1000.0, np.array([500.0, 500.0]), np.zeros(4))
    poses = [Pose(np.diag([1.0, -1.0, -1.0]), centre) for centre in centres]
    looked_at = np.zeros((len(poses), 3))
    for photograph, place in wrong.items():
        looked_at[photograph] = place
    pixel = np.array([project_points(camera, pose, at[None])[0] for pose, at in zip(poses, looked_at, strict=True)])
    each, camera_of = np.arange(len(poses)), np.zeros(len(poses), dtype=np.int64)
    ties = TiePoints(each, np.zeros_like(each), each, pixel, np.ones(len(each)), np.zeros((1, 3)),
                     np.zeros((1, 3), np.uint8))  # fmt: skip
    points, inlier = consensus_intersections(
        ties.first_observation, each, pixel, ideal_observations([camera], camera_of, ties), np.ones(len(each)),
        oriented_by([camera], camera_of, poses),
    )  # fmt: skip
    return np.asarray(points[0]), np.asarray(inlier)


def test_rays_that_meet_behind_a_photograph_do_not_end_the_search() -> None:
    centres = np.array([[0.0, 0, 100], [10, 0, 100], [-20, 0, 100]])
    point, inlier = seen_from(centres, {1: [30.0, 0, 0]})
    np.testing.assert_allclose(point, 0, rtol=0, atol=1e-9)
    assert inlier.tolist() == [True, False, True]


def test_the_one_good_pair_of_a_long_track_is_found_where_it_is_tried() -> None:
    """Of the 190 pairs of twenty rays every third is tried, the tenth among them: the first ray and the eleventh."""
    centres = np.column_stack([np.arange(20.0), np.zeros(20), np.full(20, 100.0)])
    aside = {k: [0.0, 7.0 * k, 0.0] for k in range(20) if k not in (0, 10)}
    point, inlier = seen_from(centres, aside)
    np.testing.assert_allclose(point, 0, rtol=0, atol=1e-9)
    assert np.flatnonzero(inlier).tolist() == [0, 10]
