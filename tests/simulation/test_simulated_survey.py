import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from photogram.arrays import FloatArray
from photogram.camera import project_points
from photogram.simulation.rendering import visible
from photogram.simulation.simulated_survey import (
    SimulatedBlock,
    SimulatedSurvey,
    SurveyPlan,
    demonstration_plan,
    render_photographs,
    rtk_plan,
    simulate,
    simulate_block,
    truth_surface,
    whole_survey_plan,
)
from photogram.survey import Photograph

SMALL = SurveyPlan(width_px=400, height_px=300, focal_px=600.0, flying_height_m=60.0, cell_m=0.2, buildings=5, trees=30)
MANY = replace(SMALL, strips=10, photographs_per_strip=20, flights=3, control_points=150, check_points=60)


def measured(photograph: Photograph) -> FloatArray:
    assert photograph.gnss_world_m is not None
    return photograph.gnss_world_m


def consistent(normalised: np.ndarray) -> bool:
    """Whether normalised errors have the sum of squares of a standard normal, from both sides, at 99.9 %."""
    low, high = (float(chi2.ppf(share, normalised.size)) for share in (0.0005, 0.9995))
    return bool(low < np.sum(normalised**2) < high)


@pytest.fixture(scope="module")
def survey() -> SimulatedSurvey:
    return simulate(demonstration_plan(), 1)


@pytest.fixture(scope="module")
def block() -> SimulatedBlock:
    return simulate_block(MANY, 4, tie_points=6000, sigma_px=0.7, mismatches=0.1, start_point_sigma_m=2.0)


def arrays(block: SimulatedBlock) -> list[np.ndarray]:
    ties, control = block.block.tie_points, block.block.control_points
    gnss = [photograph.gnss_world_m for photograph in block.block.photographs]
    poses = [pose.position_world_m for pose in block.block.poses if pose is not None]
    return [
        ties.pixel, ties.photograph, ties.point, ties.position_world_m, control.position_world_m, control.mark_pixel,
        np.array(gnss), np.array(poses), block.block.cameras[0].parameters, block.mismatch,
    ]  # fmt: skip


def test_plan_knows_its_ground_sampling_distance_and_refuses_nonsense() -> None:
    assert demonstration_plan().gsd_m == pytest.approx(80.0 / 1800.0)
    assert demonstration_plan().stated_mark_sigma_px == pytest.approx(1 / np.sqrt(12))
    with pytest.raises(ValueError, match="overlaps"):
        SurveyPlan(forward_overlap=1.2)
    with pytest.raises(ValueError, match="strip per flight"):
        SurveyPlan(strips=2, flights=3)
    with pytest.raises(ValueError, match="11 values"):
        SurveyPlan(calibration_sigmas=(1.0,))
    with pytest.raises(ValueError, match="oblique strip"):
        SurveyPlan(oblique_strip=True, oblique_photographs=0)


@pytest.mark.parametrize("seed", [2, 3])
def test_demonstration_has_four_control_marks_in_every_photograph(seed: int) -> None:
    survey = simulate(demonstration_plan(), seed)
    control, check = survey.control_points.with_role("control"), survey.control_points.with_role("check")
    assert len(survey.photographs) == 12
    assert (len(control), len(check)) == (18, 8)
    assert np.bincount(control.mark_photograph, minlength=12).min() >= 4
    assert np.bincount(control.mark_point).min() >= 3
    assert np.bincount(check.mark_point, minlength=8).min() >= 2


def test_control_frames_the_check_points(survey: SimulatedSurvey) -> None:
    position = survey.truth.control_position_world_m[:, :2]
    control, check = position[:18], position[18:]
    for direction in np.linspace(0.0, 2 * np.pi, 17):
        away = np.array([np.cos(direction), np.sin(direction)])
        assert (check @ away).max() <= (control @ away).max()
    gap = np.linalg.norm(position[:, None] - position, axis=2) + 1e9 * np.eye(len(position))
    assert gap.min() > 3.5


def test_marks_are_whole_pixels_at_the_projection_of_visible_points(survey: SimulatedSurvey) -> None:
    marks, truth = survey.control_points, survey.truth
    assert np.array_equal(marks.mark_pixel, np.rint(marks.mark_pixel))
    for number, pose in enumerate(truth.poses):
        mine = marks.mark_photograph == number
        points = truth.control_position_world_m[marks.mark_point[mine]]
        assert visible(survey.scene, pose, points).all()
        assert np.abs(project_points(truth.camera, pose, points) - marks.mark_pixel[mine]).max() <= 0.5
        assert truth.camera.contains(marks.mark_pixel[mine]).all()


def test_hidden_points_have_no_mark() -> None:
    survey = simulate(replace(SMALL, buildings=25, trees=150, oblique_strip=True, oblique_angle_deg=35.0), 1)
    marks, truth, hidden = survey.control_points, survey.truth, 0
    for number, pose in enumerate(truth.poses):
        pixel = project_points(truth.camera, pose, truth.control_position_world_m)
        inside = np.all((pixel > 20) & (pixel < [380, 280]), axis=1)
        seen = visible(survey.scene, pose, truth.control_position_world_m)
        marked = np.isin(np.arange(len(marks)), marks.mark_point[marks.mark_photograph == number])
        assert np.array_equal(marked[inside], seen[inside])
        hidden += int(np.sum(inside & ~seen))
    assert hidden > 0


def test_points_far_outside_do_not_fold_back_into_the_photograph() -> None:
    plan = replace(MANY, radial=(-0.2, 0.0, 0.0, 0.0), tangential=(0.0, 0.0))
    block = simulate_block(plan, 1, tie_points=500)
    control, truth = block.block.control_points, block.truth
    centre = np.array([truth.poses[i].position_world_m for i in control.mark_photograph])
    away = np.linalg.norm((truth.control_position_world_m[control.mark_point] - centre)[:, :2], axis=1)
    assert away.max() < 45.0


def test_true_points_lie_on_the_surface_and_in_the_map(survey: SimulatedSurvey) -> None:
    position = survey.truth.control_position_world_m
    np.testing.assert_allclose(survey.scene.height(position[:, :2]), position[:, 2], atol=1e-9)
    in_map = survey.frame.map_from_world(position)
    assert np.all(np.abs(in_map - survey.plan.origin_map_m) < [100.0, 100.0, 30.0])
    raster = truth_surface(survey, 0.25)
    row = np.floor((raster.north_map_m - in_map[:, 1]) / 0.25).astype(int)
    column = np.floor((in_map[:, 0] - raster.west_map_m) / 0.25).astype(int)
    np.testing.assert_allclose(raster.values[row, column], in_map[:, 2], atol=0.01)


def test_flight_turns_about_between_strips(survey: SimulatedSurvey) -> None:
    poses, plan = survey.truth.poses, survey.plan
    up_in_picture = np.array([-pose.rotation_world_from_camera[:, 1] for pose in poses])
    assert np.all(up_in_picture[:4, 1] > 0.9)
    assert np.all(up_in_picture[4:8, 1] < -0.9)
    step = np.diff([pose.position_world_m[1] for pose in poses[:4]])
    assert np.mean(step) == pytest.approx((1 - plan.forward_overlap) * plan.height_px * plan.gsd_m, abs=0.7)
    times = [photograph.time for photograph in survey.photographs]
    assert all(a is not None and b is not None and a < b for a, b in pairwise(times))


def test_surveys_follow_from_the_seed(survey: SimulatedSurvey) -> None:
    again = simulate(demonstration_plan(), 1)
    assert np.array_equal(again.scene.height_m, survey.scene.height_m)
    assert np.array_equal(again.control_points.position_world_m, survey.control_points.position_world_m)
    assert np.array_equal(again.control_points.mark_pixel, survey.control_points.mark_pixel)


def test_blocks_follow_from_the_seed() -> None:
    first, again, other = (simulate_block(SMALL, seed, tie_points=300, mismatches=0.1) for seed in (7, 7, 8))
    assert all(np.array_equal(a, b) for a, b in zip(arrays(first), arrays(again), strict=True))
    assert not np.array_equal(arrays(first)[7], arrays(other)[7])


def test_photographs_are_rendered_in_order_and_repeatably() -> None:
    survey = simulate(replace(SMALL, strips=1, photographs_per_strip=2, control_points=5, check_points=0), 1)
    pictures = dict(render_photographs(survey))
    assert list(pictures) == [photograph.name for photograph in survey.photographs]
    for name, picture in render_photographs(survey):
        assert picture.shape == (300, 400, 3)
        assert np.array_equal(picture, pictures[name])


def test_measurements_have_the_noise_stated(block: SimulatedBlock) -> None:
    plan, truth, data = block.plan, block.truth, block.block
    for photograph, pose in zip(data.photographs, truth.poses, strict=True):
        assert photograph.flight in truth.gnss_offset_world_m
        assert photograph.attitude_sigma_rad == pytest.approx(np.radians(plan.attitude_sigma_deg))
        assert pose.rotation_world_from_camera.shape == (3, 3)
    pairs = list(zip(data.photographs, truth.poses, strict=True))
    gnss = np.array([measured(p) + truth.gnss_offset_world_m[p.flight] - t.position_world_m for p, t in pairs])
    assert consistent(gnss / plan.gnss_sigma_m)
    turn = np.array([t.rotation_world_from_camera.T @ np.asarray(p.attitude_world_from_camera) for p, t in pairs])
    assert consistent(Rotation.from_matrix(turn).as_rotvec() / np.radians(plan.attitude_sigma_deg))
    control = data.control_points
    assert consistent((control.position_world_m - truth.control_position_world_m) / control.sigma_m)
    pixel = np.array([
        project_points(truth.camera, truth.poses[i], truth.control_position_world_m[[p]])[0]
        for i, p in zip(control.mark_photograph, control.mark_point, strict=True)
    ])  # fmt: skip
    assert consistent((control.mark_pixel - pixel) / control.mark_sigma_px[:, None])


def test_offsets_and_cameras_scatter_as_stated() -> None:
    plan = replace(SMALL, flights=3, control_points=3, check_points=0)
    blocks = [simulate_block(plan, seed, tie_points=10) for seed in range(40)]
    offset = np.array([list(b.truth.gnss_offset_world_m.values()) for b in blocks])
    assert offset.shape == (40, 3, 3)
    assert consistent(offset / SMALL.gnss_offset_sigma_m)
    error = np.array([b.block.cameras[0].parameters - b.truth.camera.parameters for b in blocks])
    sigmas = np.array([*SMALL.calibration_sigmas, SMALL.readout_sigma_s])
    assert consistent(error[:, sigmas > 0] / sigmas[sigmas > 0])
    assert np.all(error[:, sigmas == 0] == 0)
    assert np.array_equal(blocks[0].block.cameras[0].sigmas, sigmas)


def test_tie_points_are_sorted_complete_and_noisy_as_stated(block: SimulatedBlock) -> None:
    ties, truth = block.block.tie_points, block.truth
    assert len(ties) == 6000
    assert ties.rays.min() >= 2
    assert np.all(np.diff(ties.point * 10_000 + ties.photograph) > 0)
    residual = np.empty_like(ties.pixel)
    for number, pose in enumerate(truth.poses):
        mine = ties.photograph == number
        seen = project_points(truth.camera, pose, block.tie_point_position_world_m)
        residual[mine] = ties.pixel[mine] - seen[ties.point[mine]]
        beneath = np.linalg.norm(block.tie_point_position_world_m[:, :2] - pose.position_world_m[:2], axis=1) < 40.0
        inside = beneath & np.all((seen > 4) & (seen < [395, 295]), axis=1)
        assert np.all(np.isin(np.flatnonzero(inside), ties.point[mine]))
        assert (
            np.linalg.norm(
                block.tie_point_position_world_m[ties.point[mine], :2] - pose.position_world_m[:2], axis=1
            ).max()
            < 40.0
        )
        assert np.array_equal(ties.feature[mine], np.arange(mine.sum()))
    assert consistent(residual[~block.mismatch] / ties.sigma_px[~block.mismatch, None])
    assert block.mismatch.mean() == pytest.approx(0.1, abs=1e-4)
    wrong = np.linalg.norm(residual[block.mismatch], axis=1)
    assert wrong.min() > 6.0
    assert wrong.max() < 305.0
    assert block.block.cameras[0].contains(ties.pixel).all()
    assert consistent((ties.position_world_m - block.tie_point_position_world_m) / 2.0)


def test_starting_poses_are_off_as_stated(block: SimulatedBlock) -> None:
    start = [pose for pose in block.block.poses if pose is not None]
    moved = [s.position_world_m - t.position_world_m for s, t in zip(start, block.truth.poses, strict=True)]
    turned = [
        t.rotation_world_from_camera.T @ s.rotation_world_from_camera
        for s, t in zip(start, block.truth.poses, strict=True)
    ]
    assert consistent(np.array(moved))
    assert consistent(Rotation.from_matrix(turned).as_rotvec() / np.radians(1.0))


def test_detection_thins_the_observations() -> None:
    every, half = (simulate_block(SMALL, 3, tie_points=2000, detection=d).block.tie_points for d in (1.0, 0.5))
    assert half.rays.min() >= 2
    assert half.rays.mean() < 0.75 * every.rays.mean()


def test_blunder_is_in_the_height_of_one_point() -> None:
    clean = simulate_block(SMALL, 5, tie_points=50).block.control_points
    plan = replace(SMALL, blunder_point="G03", control_height_blunder_m=0.8)
    spoilt = simulate_block(plan, 5, tie_points=50).block.control_points
    difference = spoilt.position_world_m - clean.position_world_m
    expected = np.zeros_like(difference)
    expected[2, 2] = 0.8
    np.testing.assert_allclose(difference, expected, atol=1e-12)
    with pytest.raises(ValueError, match="G99"):
        simulate_block(replace(plan, blunder_point="G99"), 5, tie_points=50)


def test_oblique_strip_crosses_and_looks_at_the_site() -> None:
    plan = replace(SMALL, oblique_strip=True)
    block = simulate_block(plan, 2, tie_points=500)
    assert len(block.truth.poses) == 16
    for pose in block.truth.poses[12:]:
        axis = pose.rotation_world_from_camera[:, 2]
        assert np.degrees(np.arccos(-axis[2])) == pytest.approx(25.0, abs=6.0)
        assert axis[0] > 0.3
    assert np.bincount(block.block.tie_points.photograph, minlength=16).min() > 50
    with pytest.raises(ValueError, match="horizon"):
        simulate_block(replace(plan, oblique_angle_deg=75.0), 2, tie_points=10)


@pytest.mark.parametrize("tilt_deg", [15.0, 25.0, 40.0])
def test_oblique_cameras_look_forward_at_the_ground_below_the_strip(tilt_deg: float) -> None:
    """Flown without error, the axis meets level ground on the strip's own line, centred on the site."""
    plan = replace(
        SMALL, oblique_strip=True, oblique_angle_deg=tilt_deg, oblique_photographs=5, attitude_noise_deg=0.0,
        position_noise_m=0.0, control_points=0, check_points=0,
    )  # fmt: skip
    poses = simulate_block(plan, 2, tie_points=500).truth.poses
    assert len(poses) == 12 + 5
    ground = []
    for pose in poses[12:]:
        right, down, axis = pose.rotation_world_from_camera.T
        assert np.degrees(np.arccos(-axis[2])) == pytest.approx(tilt_deg)
        np.testing.assert_allclose(right, [0, -1, 0], atol=1e-12)  # flying east, south is to the right
        assert down[2] < 0
        assert down[0] < 0
        np.testing.assert_allclose(np.cross(right, down), axis, atol=1e-12)
        ground.append(pose.position_world_m - axis * pose.position_world_m[2] / axis[2])
    np.testing.assert_allclose(np.mean(ground, axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(ground, axis=0), [[plan.base_m, 0, 0]] * 4, atol=1e-9)


def test_gnss_is_of_the_kind_the_sigmas_say() -> None:
    assert whole_survey_plan().rtk_flag is None
    assert rtk_plan().rtk_flag == 50
    assert replace(rtk_plan(), gnss_sigma_m=(0.3, 0.2, 0.5)).rtk_flag == 34
    block = simulate_block(replace(whole_survey_plan(400), strips=12, photographs_per_strip=12), 1, tie_points=50)
    pairs = list(zip(block.block.photographs, block.truth.poses, strict=True))
    gnss = np.array([measured(p) + block.truth.gnss_offset_world_m["1"] - t.position_world_m for p, t in pairs])
    assert gnss.std() == pytest.approx(2.0, rel=0.1)
    assert all(abs(p.height_above_ground_m - t.position_world_m[2]) <= 0.05 + 1e-9 for p, t in pairs)


def test_exif_focal_length_is_in_whole_millimetres_and_nothing_more_is_known() -> None:
    plan = whole_survey_plan(900)
    camera = simulate_block(plan, 1, tie_points=50).block.cameras[0]
    assert camera.focal_px == pytest.approx(29 / np.hypot(36, 24) * np.hypot(900, 675))
    assert np.array_equal(camera.principal_point_px, [449.5, 337.0])
    assert not camera.radial.any()
    assert not camera.tangential.any()
    assert abs(camera.focal_px - plan.focal_px) < 0.01 * plan.focal_px


def test_without_gnss_tags_nothing_else_changes() -> None:
    with_tags, without = (
        simulate_block(replace(SMALL, gnss_tags=tags), 3, tie_points=300).block for tags in (True, False)
    )
    for photograph in without.photographs:
        assert photograph.gnss_world_m is None
        assert photograph.gnss_sigma_m is None
        assert photograph.attitude_world_from_camera is None
        assert photograph.time is None
        assert photograph.height_above_ground_m is None
    assert np.array_equal(with_tags.tie_points.pixel, without.tie_points.pixel)
    assert np.array_equal(with_tags.control_points.mark_pixel, without.control_points.mark_pixel)


def test_memory_of_a_block_follows_its_observations() -> None:
    """Ground points are not tried in every photograph: that alone would take three times as much."""
    plan = replace(SMALL, strips=20, photographs_per_strip=40, control_points=20, check_points=10)
    tracemalloc.start()
    block = simulate_block(plan, 1, tie_points=16_000).block
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 600 * len(block.tie_points.photograph)


def test_plans_that_cannot_be_met_say_so() -> None:
    with pytest.raises(ValueError, match="raise control_points"):
        simulate_block(replace(SMALL, control_points=3, control_marks_per_photograph=4), 1, tie_points=10)
    apart = replace(SMALL, strips=1, photographs_per_strip=1, control_points=0, check_points=0)
    with pytest.raises(ValueError, match="raise the overlap"):
        simulate_block(apart, 1, tie_points=10)


def test_a_block_without_control_has_none() -> None:
    block = simulate_block(replace(SMALL, control_points=0, check_points=0), 1, tie_points=100).block
    assert len(block.control_points) == 0
    assert len(simulate(replace(SMALL, control_points=0, check_points=0), 1).control_points) == 0
