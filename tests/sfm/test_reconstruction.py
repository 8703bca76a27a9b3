"""A growing block step by step, each step against the truth of a simulated flight."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.camera import Pose, image_plane, project_points, rotation_from_gimbal
from photogram.sfm.reconstruction import Structure, StructureSettings, resected
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, forward_overlap=0.75, control_points=0, check_points=0,
    calibration_sigmas=(0.0,) * 11,
)  # fmt: skip
COUNT = 8
SETTINGS = StructureSettings()


@cache
def simulated(seed: int = 1, sigma_px: float = 0.5, mismatches: float = 0.0) -> SimulatedBlock:
    return simulate_block(PLAN, seed, tie_points=400, sigma_px=sigma_px, mismatches=mismatches)


def structure_of(
    block: SimulatedBlock, photographs: range = range(COUNT), settings: StructureSettings = SETTINGS
) -> Structure:
    """The true poses of some photographs, and nothing else."""
    tie = replace(block.block.tie_points, position_world_m=np.full((len(block.block.tie_points), 3), np.nan))
    structure = Structure.empty(tie, block.block.cameras, np.zeros(COUNT, np.int64), settings)
    for i in photographs:
        structure.register(i, block.truth.poses[i])
    return structure


def disturb(structure: Structure, position_m: float, attitude_deg: float, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    structure.position += position_m * rng.standard_normal(structure.position.shape)
    noise = np.deg2rad(attitude_deg) * rng.standard_normal((COUNT, 3))
    structure.rotation = structure.rotation @ Rotation.from_rotvec(noise).as_matrix()


def settled(structure: Structure) -> Structure:
    structure.intersect()
    structure.adjust()
    structure.judge()
    return structure


def point_error(structure: Structure, block: SimulatedBlock) -> np.ndarray:
    return np.asarray(np.linalg.norm(structure.point - block.tie_point_position_world_m, axis=1))


@pytest.mark.parametrize(
    "wrong", [{"threshold_px": 0.0}, {"minimum_ray_angle_deg": 0.0}, {"minimum_points": 5}, {"minimum_share": 0.0}]
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        StructureSettings(**wrong)


# ---- intersection ----------------------------------------------------------------------------------------------------


def test_tie_points_are_intersected_exactly_where_they_are() -> None:
    block = simulated(sigma_px=1e-9)
    structure = structure_of(block)
    structure.intersect()
    assert structure.known.all()
    assert structure.good.all()
    assert point_error(structure, block).max() < 1e-6


def test_only_what_two_registered_photographs_see_is_intersected() -> None:
    block = simulated()
    structure = structure_of(block, range(3))
    structure.intersect()
    tie = structure.tie_points
    seen = tie.photograph < 3
    rays = np.bincount(tie.point[seen], minlength=len(tie))
    assert 0 < structure.known.sum() < len(tie)
    assert not structure.known[rays < 2].any()
    assert structure.known[rays >= 2].mean() > 0.99
    assert not structure.good[~seen].any()
    assert structure.visible[:3].tolist() == [
        int(structure.known[tie.point[tie.photograph == i]].sum()) for i in range(3)
    ]
    assert [pose is not None for pose in structure.poses()] == [True] * 3 + [False] * 5


def test_a_photograph_brings_only_its_own_tie_points() -> None:
    structure = structure_of(simulated())
    new = np.arange(COUNT) == 5
    structure.intersect(new)
    tie = structure.tie_points
    touched = np.isin(np.arange(len(tie)), tie.point[tie.photograph == 5])
    assert structure.known[touched].mean() > 0.99
    assert not structure.known[~touched].any()


def test_nearly_parallel_rays_make_no_point() -> None:
    block = simulated()
    # neighbours of a strip are 15 m apart, 80 m up: 11 degrees
    wide, narrow = (
        structure_of(block, range(2), replace(SETTINGS, minimum_ray_angle_deg=angle)) for angle in (5.0, 20.0)
    )
    wide.intersect()
    narrow.intersect()
    assert wide.known.sum() > 50
    assert not narrow.known.any()
    assert not narrow.good.any()


# ---- judgement -------------------------------------------------------------------------------------------------------


def test_mismatches_are_set_aside_and_taken_back() -> None:
    block = simulated(mismatches=0.1)
    structure = structure_of(block)
    structure.intersect()
    structure.judge()
    tie = structure.tie_points
    firm = (np.bincount(tie.point[structure.good], minlength=len(tie)) >= 3)[tie.point]
    assert structure.good[firm & ~block.mismatch].mean() > 0.98
    assert structure.good[firm & block.mismatch].mean() < 0.03
    before = structure.good.copy()
    structure.judge(1.0)
    assert structure.good.sum() < 0.95 * before.sum()
    structure.judge()
    lost = before & ~structure.good
    assert not structure.known[tie.point[lost]].any(), "only those of points that were forgotten do not come back"


def test_points_that_lose_their_rays_are_forgotten() -> None:
    structure = structure_of(simulated())
    structure.intersect()
    tie = structure.tie_points
    point = int(np.flatnonzero(structure.known & (tie.rays == 3))[0])
    mine = np.flatnonzero(tie.point == point)
    pixel = tie.pixel.copy()
    pixel[mine[1:]] += 100.0 * np.array([[1.0, 0.3], [-0.4, 1.0]])
    structure.tie_points = replace(tie, pixel=pixel)
    known = structure.known
    structure.judge()
    assert known[point]
    assert not structure.known[point]
    assert not structure.good[mine].any()
    assert structure.known.sum() > 0.98 * known.sum()


def test_a_photograph_is_withdrawn_with_what_it_alone_held() -> None:
    structure = structure_of(simulated())
    structure.intersect()
    out = np.arange(COUNT) < 3
    structure.withdraw(out)
    tie = structure.tie_points
    rays = np.bincount(tie.point[structure.good], minlength=len(tie))
    assert not structure.registered[:3].any()
    assert structure.registered[3:].all()
    assert not structure.good[out[tie.photograph]].any()
    assert rays[structure.known].min() >= 2
    assert rays[~structure.known].max() == 0


# ---- adjustment ------------------------------------------------------------------------------------------------------


def test_adjusting_brings_residuals_down_to_the_noise() -> None:
    block = simulated()
    structure = structure_of(block)
    structure.intersect()
    disturb(structure, 0.3, 0.2)
    before = float(np.median(structure.residual_px(structure.good)))
    structure.adjust(tolerance=1e-8)
    residual = structure.residual_px(structure.good)
    # sqrt(2 ln 2) sigma is the median length of a residual; adjusting takes some of it
    assert before > 5.0
    assert 0.6 * 0.5 * 1.18 < np.median(residual) < 0.5 * 1.18


def test_only_active_photographs_move() -> None:
    structure = structure_of(simulated())
    structure.intersect()
    active = np.isin(np.arange(COUNT), [2, 3])
    truth = structure.position.copy()
    structure.position[active] += 0.3
    R, C = structure.rotation.copy(), structure.position.copy()
    structure.adjust(active)
    np.testing.assert_array_equal(structure.rotation[~active], R[~active])
    np.testing.assert_array_equal(structure.position[~active], C[~active])
    assert np.linalg.norm(structure.position[active] - truth[active], axis=1).max() < 0.2


def freed(block: SimulatedBlock, sigmas: tuple[float, ...], focal_error: float = 0.0) -> SimulatedBlock:
    """The same observations under a camera that is known less well."""
    camera = block.block.cameras[0]
    wrong = replace(camera, focal_px=camera.focal_px * (1 + focal_error), sigmas=np.array(sigmas))
    return replace(block, block=replace(block.block, cameras=(wrong,)))


def test_the_calibration_moves_only_where_it_is_free_and_the_block_large_enough() -> None:
    free = (20.0, 0.0, 0.0, 0.05, *(0.0,) * 8)
    block = freed(simulated(), free, 0.002)
    start = block.block.cameras[0].parameters
    small = settled(structure_of(block, range(4)))
    np.testing.assert_array_equal(small.parameters[0], start)
    held = structure_of(block)
    held.intersect()
    held.adjust(calibrate=False)
    np.testing.assert_array_equal(held.parameters[0], start)
    whole = settled(structure_of(block))
    assert np.flatnonzero(whole.parameters[0] != start).tolist() == [0, 3]
    known = settled(structure_of(freed(simulated(), (0.0,) * 12)))
    np.testing.assert_array_equal(known.parameters[0], simulated().block.cameras[0].parameters)


def test_a_wrong_distortion_is_told_and_used_for_what_follows() -> None:
    block = simulated()
    camera = replace(
        block.block.cameras[0],
        radial=np.array([0.0, 0.0, -0.01, 0.0]),
        sigmas=np.array([0, 0, 0, 0.2, 0.2, *[0.0] * 7]),
    )
    structure = structure_of(replace(block, block=replace(block.block, cameras=(camera,))))
    for _ in range(3):
        settled(structure)
    assert structure.parameters[0, 3] == pytest.approx(-0.08, abs=0.02)
    fifth = np.arange(0, len(structure.good), 5)
    pixel = structure.tie_points.pixel[fifth]
    np.testing.assert_array_equal(structure.ideal(fifth), image_plane(structure.calibrated()[0], pixel))
    assert structure.good.mean() > 0.98


def test_a_calibration_that_no_camera_has_is_not_taken() -> None:
    """Attitudes of other photographs, as shuffled tags give them: a free calibration would follow them anywhere."""
    for seed in range(6):
        block = freed(simulated(seed), (40.0, 0.0, 0.0, 0.1, 0.1, *(0.0,) * 7))
        structure = structure_of(block)
        structure.point[:] = block.tie_point_position_world_m
        structure.rotation[:] = np.random.default_rng(seed).permutation(structure.rotation)
        structure.good[:] = True
        for _ in range(2):
            structure.adjust(iterations=8, huber_px=300.0)
        assert 0.5 < structure.parameters[0, 0] / PLAN.focal_px < 2.0
        assert np.isfinite(structure.ideal(structure.good)).all()
        assert np.isfinite(structure.position).all()


def test_neighbours_are_those_that_share_most() -> None:
    structure = structure_of(simulated())
    structure.intersect()
    tie = structure.tie_points
    mine = np.unique(tie.point[structure.good & (tie.photograph == 0)])
    shared = [int(np.isin(tie.point[structure.good & (tie.photograph == i)], mine).sum()) for i in range(COUNT)]
    active = structure.neighbours(np.arange(COUNT) == 0)
    assert active[0]
    assert active.sum() == 6
    others = [i for i in range(1, COUNT) if active[i]]
    left = [i for i in range(1, COUNT) if not active[i]]
    assert min(shared[i] for i in others) >= max(shared[i] for i in left)


# ---- resection -------------------------------------------------------------------------------------------------------


def test_a_photograph_is_resected_among_mismatches() -> None:
    block = simulated(mismatches=0.1)
    structure = structure_of(block, range(1, COUNT))
    structure.point[:] = block.tie_point_position_world_m
    assert structure.resect(0)
    truth = block.truth.poses[0]
    turn = Rotation.from_matrix(structure.rotation[0].T @ truth.rotation_world_from_camera).magnitude()
    assert np.linalg.norm(structure.position[0] - truth.position_world_m) < 0.2
    assert np.rad2deg(turn) < 0.15
    mine = structure.tie_points.photograph == 0
    np.testing.assert_array_equal(structure.good[mine], ~block.mismatch[mine])


def test_a_photograph_of_another_place_is_not_resected() -> None:
    block = simulated()
    rng = np.random.default_rng(1)
    for share, expected in ((0.5, True), (0.9, False)):
        structure = structure_of(block, range(1, COUNT))
        structure.point[:] = block.tie_point_position_world_m
        mine = np.flatnonzero(structure.tie_points.photograph == 0)
        wrong = mine[rng.permutation(len(mine)) < share * len(mine)]
        pixel = structure.tie_points.pixel.copy()
        pixel[wrong] = pixel[np.roll(wrong, 1)]
        structure.tie_points = replace(structure.tie_points, pixel=pixel)
        assert structure.resect(0) == expected
        assert structure.registered[0] == expected
        assert structure.good[mine].any() == expected


def test_too_few_known_points_resect_nothing() -> None:
    structure = structure_of(simulated(), range(1, COUNT))
    mine = structure.tie_points.point[structure.tie_points.photograph == 0]
    structure.point[mine[:19]] = simulated().tie_point_position_world_m[mine[:19]]
    assert not structure.resect(0)
    structure.point[mine[19]] = simulated().tie_point_position_world_m[mine[19]]
    assert structure.resect(0)


def test_far_coordinates_do_not_blur_a_resected_pose() -> None:
    rng = np.random.default_rng(0)
    camera = replace(simulated().block.cameras[0], radial=np.zeros(4), tangential=np.zeros(2))
    shift = np.array([600_000.0, 5_800_000.0, 300.0])
    pose = Pose(rotation_from_gimbal(38.0, -84.0, 3.0), np.array([13.0, -21.0, 80.0]))
    points = rng.uniform(-1, 1, (40, 3)) * [25.0, 25.0, 3.0] + [13.0, -15.0, 0.0]
    found = resected(points + shift, image_plane(camera, project_points(camera, pose, points)), 4.0 / camera.focal_px)
    assert found is not None
    np.testing.assert_allclose(found.position_world_m - shift, pose.position_world_m, atol=1e-5)
