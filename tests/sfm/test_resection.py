"""Resection against true poses, with predicted errors, OpenCV and another program as referees."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from makers import PHANTOM, SharedData
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from photogram.camera import Camera, Pose, image_plane, oriented_by, project_points, rotation_from_gimbal
from photogram.errors import OrientationError
from photogram.geodesy.frames import LocalFrame
from photogram.measures.collinearity import collinear
from photogram.pipeline.pipeline import load_project
from photogram.projection import project_point_jacobians
from photogram.sfm.resection import p3p_poses, refine_pose, resect

ROOT = Path(__file__).parents[2]

CAMERA = PHANTOM
PINHOLE = replace(CAMERA, radial=np.zeros(4), tangential=np.zeros(2))
POSE = Pose(rotation_from_gimbal(38.0, -84.0, 3.0), np.array([13.0, -21.0, 58.0]))
SIGMA = 1.5


def ground(count: int, seed: int, camera: Camera = CAMERA) -> tuple[np.ndarray, np.ndarray]:
    """Points on rolling ground and their exact marks, spread over the photograph from its corners inwards."""
    rng = np.random.default_rng(seed)
    corners = np.array([[0.1, 0.12], [0.9, 0.2], [0.15, 0.85], [0.8, 0.9]])
    share = np.vstack([corners, rng.uniform(0.1, 0.9, (max(0, count - 4), 2))])[:count]
    pixel = share * [camera.width_px - 1, camera.height_px - 1]
    ray = np.column_stack([image_plane(camera, pixel), np.ones(count)]) * rng.uniform(50.0, 64.0, (count, 1))
    points = POSE.world_from_camera(ray)
    return points, project_points(camera, POSE, points)


def assert_same(pose: Pose, expected: Pose, position_m: float = 1e-6) -> None:
    np.testing.assert_allclose(pose.position_world_m, expected.position_world_m, rtol=0, atol=position_m)
    turn = Rotation.from_matrix(pose.rotation_world_from_camera.T @ expected.rotation_world_from_camera).magnitude()
    assert turn < position_m / 10


def test_three_points_allow_several_poses_and_all_of_them_see_the_marks() -> None:
    points, pixel = ground(3, 0)
    poses = p3p_poses(CAMERA, points, pixel)
    assert 2 <= len(poses) <= 4
    for pose in poses:
        np.testing.assert_allclose(project_points(CAMERA, pose, points), pixel, rtol=0, atol=1e-5)
        assert np.linalg.det(pose.rotation_world_from_camera) == pytest.approx(1.0)
    errors = sorted(float(np.linalg.norm(pose.position_world_m - POSE.position_world_m)) for pose in poses)
    assert errors[0] < 1e-6
    assert errors[1] > 1.0


def test_far_coordinates_do_not_blur_the_minimal_pose() -> None:
    points, pixel = ground(4, 1)
    shift = np.array([719950.0, 6191960.0, 0.0])
    far = resect(CAMERA, points + shift, pixel, np.full(4, SIGMA))
    np.testing.assert_allclose(far.p3p.position_world_m - shift, POSE.position_world_m, rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_exact_marks_of_four_points_give_the_exact_pose(seed: int) -> None:
    points, pixel = ground(4, seed)
    found = resect(CAMERA, points, pixel, np.full(4, SIGMA))
    assert_same(found.p3p, POSE, 1e-5)
    assert_same(found.refined, POSE)
    assert found.points == (0, 1, 2)
    assert found.check_px < 1e-4
    assert found.inliers.all()
    assert 1 <= found.solutions <= 4
    np.testing.assert_allclose(found.residual_px, 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_exact_marks_of_three_points_and_a_rough_position_give_the_exact_pose(seed: int) -> None:
    points, pixel = ground(3, seed)
    rough = POSE.position_world_m + np.random.default_rng(seed).normal(0, 0.3, 3)
    found = resect(CAMERA, points, pixel, np.full(3, SIGMA), expected_world_m=rough)
    assert_same(found.refined, POSE)
    assert np.isnan(found.check_px)
    other = max(
        p3p_poses(CAMERA, points, pixel),
        key=lambda p: float(np.linalg.norm(p.position_world_m - POSE.position_world_m)),
    )
    elsewhere = resect(CAMERA, points, pixel, np.full(3, SIGMA), expected_world_m=other.position_world_m)
    assert_same(elsewhere.refined, other)


@pytest.mark.parametrize("count", [5, 8, 30])
def test_exact_marks_of_many_points_give_the_exact_pose(count: int) -> None:
    points, pixel = ground(count, 3)
    found = resect(CAMERA, points, pixel, np.full(count, SIGMA))
    assert_same(found.refined, POSE)
    assert found.inliers.all()
    assert len(found.inliers) == count


@pytest.mark.parametrize("seed", range(8))
def test_two_wrong_points_of_eight_are_found_and_left_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, pixel = ground(8, seed)
    pixel = pixel + 0.5 * rng.standard_normal(pixel.shape)
    wrong = rng.permutation(8)[:2]
    pixel[wrong[0]] += [260.0, -90.0]
    points[wrong[1]] += [3.0, -4.0, 0.0]
    found = resect(CAMERA, points, pixel, np.full(8, 0.5))
    assert np.flatnonzero(~found.inliers).tolist() == sorted(wrong.tolist())
    assert_same(found.refined, POSE, 0.1)
    assert np.linalg.norm(found.residual_px[found.inliers], axis=1).max() < 3.0
    assert np.linalg.norm(found.residual_px[wrong], axis=1).min() > 50.0
    assert not set(found.points) & set(wrong.tolist())


def test_the_tolerance_of_marks_is_that_which_is_given() -> None:
    """A mark that is 7 px off agrees within the 10 px of the default, and not within 4 px."""
    points, pixel = ground(8, 1)
    pixel[3] += [7.0, 0.0]
    assert resect(CAMERA, points, pixel, np.full(8, 0.5)).inliers.all()
    strict = resect(CAMERA, points, pixel, np.full(8, 0.5), tolerance_px=4.0)
    assert np.flatnonzero(~strict.inliers).tolist() == [3]


def test_triples_of_many_marks_are_drawn_by_the_seed() -> None:
    points, pixel = ground(20, 1)
    drawn = [resect(CAMERA, points, pixel, np.full(20, 0.5), seed=seed) for seed in (0, 0, 1)]
    assert drawn[0].points == drawn[1].points != drawn[2].points
    for found in drawn:
        assert_same(found.refined, POSE)


@pytest.mark.parametrize("seed", range(6))
def test_survey_sigmas_count_in_the_picture(seed: int) -> None:
    """Half a metre is some 30 px here: points surveyed to that agree, a mark on another target does not."""
    points, pixel = ground(8, seed)
    moved = points + np.random.default_rng(seed).normal(0.0, 0.5, points.shape)
    pixel[5] += [900.0, 700.0] * np.sign([2741.0, 1837.0] - pixel[5])
    found = resect(CAMERA, moved, pixel, np.full(8, 0.5), sigma_m=np.full((8, 3), 0.5))
    assert found.inliers.tolist() == [True] * 5 + [False] + [True] * 2
    assert np.linalg.norm(found.refined.position_world_m - POSE.position_world_m) < 6.0


def test_the_survey_sigma_of_a_point_is_taken_across_its_ray() -> None:
    """Heights known to 5 m only excuse a horizontal error of 2 m no more than they must."""
    points, pixel = ground(8, 1)
    sigma_m = np.tile([0.01, 0.01, 5.0], (8, 1))
    below = resect(CAMERA, points, pixel, np.full(8, 0.5), sigma_m=sigma_m)
    assert_same(below.refined, POSE)
    wrong = points.copy()
    wrong[3] += [2.0, 1.0, 0.0]
    exact = resect(CAMERA, wrong, pixel, np.full(8, 0.5), sigma_m=np.full((8, 3), 0.01))
    assert np.flatnonzero(~exact.inliers).tolist() == [3]


@pytest.mark.parametrize("seed", range(6))
def test_marks_that_scatter_more_than_stated_are_resected_by_their_own_scatter(seed: int) -> None:
    """Marks of 8 px for which 0.5 px are stated, and one on another target: no four of ten need lie within 10 px."""
    points, pixel = ground(10, seed)
    rng = np.random.default_rng([seed, 1])
    pixel = pixel + 8.0 * rng.standard_normal(pixel.shape)
    pixel[6] += [500.0, 300.0] * np.sign([2741.0, 1837.0] - pixel[6])
    found = resect(CAMERA, points, pixel, np.full(10, 0.5))
    assert not found.inliers[6]
    assert found.inliers.sum() >= 6
    assert np.linalg.norm(found.refined.position_world_m - POSE.position_world_m) < 1.5


def test_points_in_any_order_give_the_same_pose() -> None:
    points, pixel = ground(8, 2)
    pixel = pixel + np.random.default_rng(0).standard_normal(pixel.shape)
    order = np.random.default_rng(1).permutation(8)
    one, other = (resect(CAMERA, points[o], pixel[o], np.full(8, 1.0)) for o in (np.arange(8), order))
    assert_same(one.refined, other.refined)
    np.testing.assert_allclose(other.residual_px, one.residual_px[order], atol=1e-6)


def jacobian(points: np.ndarray) -> np.ndarray:
    rows = []
    for X in points:
        J, J_camera, J_point = np.empty((2, 6)), np.empty((2, 12)), np.empty((2, 3))
        project_point_jacobians(
            oriented_by([CAMERA], np.zeros(1, np.int64), [POSE]),
            0,
            X,
            0.0,
            J,
            J_camera,
            J_point,
        )
        rows.append(J)
    return np.vstack(rows)


def test_errors_of_the_resection_are_as_large_as_predicted() -> None:
    points, exact = ground(6, 5)
    sigma_px = np.array([0.5, 0.5, 1.0, 1.0, 2.0, 0.7])
    A = jacobian(points) / np.repeat(sigma_px, 2)[:, None]
    information = A.T @ A
    covariance = np.linalg.inv(information)
    R = POSE.rotation_world_from_camera
    errors, fits = [], []
    for seed in range(200):
        pixel = exact + sigma_px[:, None] * np.random.default_rng(seed).standard_normal(exact.shape)
        found = resect(CAMERA, points, pixel, sigma_px).refined
        turn = Rotation.from_matrix(R.T @ found.rotation_world_from_camera).as_rotvec()
        errors.append(np.concatenate([turn, R.T @ (found.position_world_m - POSE.position_world_m)]))
        fits.append(np.sum(((project_points(CAMERA, found, points) - pixel) / sigma_px[:, None]) ** 2))
    error = np.array(errors)
    low, high = (chi2.ppf(q, 6 * 200) for q in (0.0005, 0.9995))
    assert low < np.einsum("ni,ij,nj->", error, information, error) < high
    low, high = (chi2.ppf(q, (12 - 6) * 200) for q in (0.0005, 0.9995))
    assert low < np.sum(fits) < high
    np.testing.assert_allclose(error.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.2)
    assert np.all(np.abs(error.mean(axis=0)) < 4 * np.sqrt(np.diag(covariance) / 200))


@pytest.mark.parametrize("seed", range(4))
def test_opencv_finds_the_same_least_squares_pose(seed: int) -> None:
    # Without distortion and with equal sigmas both minimise the same sum of squares.
    points, pixel = ground(8, seed, PINHOLE)
    pixel = pixel + np.random.default_rng(seed).standard_normal(pixel.shape)
    found = resect(PINHOLE, points, pixel, np.ones(8)).refined
    _, r, t = cv2.solvePnP(points, pixel, PINHOLE.matrix, np.zeros(4), flags=cv2.SOLVEPNP_ITERATIVE)
    r, t = cv2.solvePnPRefineLM(
        points, pixel, PINHOLE.matrix, np.zeros(4), r, t, (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-14)
    )
    R = cv2.Rodrigues(r)[0]
    assert_same(found, Pose(R.T, (-R.T @ t).ravel()), 1e-5)


def test_opencv_agrees_on_marks_freed_of_distortion() -> None:
    points, pixel = ground(8, 9)
    _, r, t = cv2.solvePnP(points, image_plane(CAMERA, pixel), np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_ITERATIVE)
    R = cv2.Rodrigues(r)[0]
    assert_same(resect(CAMERA, points, pixel, np.ones(8)).refined, Pose(R.T, (-R.T @ t).ravel()), 1e-4)


def test_precise_marks_count_for_more() -> None:
    points, pixel = ground(7, 4)
    pixel[6] += [6.0, -5.0]
    sigma_px = np.ones(7)
    equal = resect(CAMERA, points, pixel, sigma_px).refined
    sigma_px[6] = 100.0
    doubted = resect(CAMERA, points, pixel, sigma_px).refined
    offset = [float(np.linalg.norm(p.position_world_m - POSE.position_world_m)) for p in (equal, doubted)]
    assert offset[1] < 1e-2 * offset[0]


def test_refinement_starts_far_off_and_gives_up_on_points_behind() -> None:
    points, pixel = ground(6, 6)
    start = Pose(
        POSE.rotation_world_from_camera @ Rotation.from_rotvec([0.1, -0.08, 0.2]).as_matrix(),
        POSE.position_world_m + np.array([5.0, -4.0, 8.0]),
    )
    assert_same(refine_pose(CAMERA, start, points, pixel, np.ones(6)), POSE)
    behind = Pose(POSE.rotation_world_from_camera, POSE.position_world_m - np.array([0.0, 0.0, 200.0]))
    with pytest.raises(OrientationError, match="does not converge"):
        refine_pose(CAMERA, behind, points, pixel, np.ones(6))


def test_points_in_one_line_are_told() -> None:
    line = np.array([10.0, 0.0, 0.0]) * np.arange(5.0)[:, None] + [3.0, 2.0, 1.0]
    assert collinear(line)
    assert collinear(line + 0.05 * np.random.default_rng(0).standard_normal(line.shape))
    assert not collinear(line + np.array([0, 4.0, 0]) * (np.arange(5) == 2)[:, None])
    assert collinear(line[:2])


def failing(points: np.ndarray, pixel: np.ndarray, gnss: np.ndarray | None = None) -> str:
    with pytest.raises(OrientationError) as fault:
        resect(CAMERA, points, pixel, np.ones(len(pixel)), expected_world_m=gnss)
    return str(fault.value)


def test_too_few_or_useless_points_are_refused() -> None:
    points, pixel = ground(4, 1)
    assert "2 control points are marked, resection needs 4, or 3 and a GNSS position" in failing(
        points[:2], pixel[:2], points[0]
    )
    assert "3 control points allow up to four poses" in failing(points[:3], pixel[:3])
    line = points[0] + np.outer(np.arange(5.0), [4.0, 3.0, 0.1])
    assert "are collinear" in failing(line, project_points(CAMERA, POSE, line), POSE.position_world_m)


@pytest.mark.parametrize("seed", range(3))
def test_points_that_contradict_each_other_are_refused(seed: int) -> None:
    points, pixel = ground(7, seed)
    message = failing(np.random.default_rng(seed).permutation(points), pixel)
    assert "of its 7 control points agree with any pose" in message


def test_the_fourth_point_tells_how_far_it_is_off() -> None:
    points, pixel = ground(4, 2)
    pixel[3] += [3.0, 4.0]
    found = resect(CAMERA, points, pixel, np.ones(4))
    assert found.check_px == pytest.approx(5.0, abs=1e-4)
    assert_same(found.p3p, POSE, 1e-5)


def test_three_first_points_in_a_line_are_passed_over() -> None:
    points, _ = ground(4, 2)
    points[1] = 0.5 * (points[0] + points[2])
    found = resect(CAMERA, points, project_points(CAMERA, POSE, points), np.ones(4))
    assert_same(found.refined, POSE)
    assert found.points != (0, 1, 2)


def test_two_swapped_marks_of_four_are_a_contradiction() -> None:
    points, pixel = ground(4, 1)
    with pytest.raises(OrientationError, match="contradict each other"):
        resect(CAMERA, points, pixel[[0, 1, 3, 2]], np.ones(4))


@pytest.mark.parametrize("seed", range(8))
def test_three_points_that_magnify_noise_do_not_contradict_a_fourth(seed: int) -> None:
    """The first three are nearly in one line: what two pixels do to their pose is no contradiction."""
    points, _ = ground(4, seed)
    points[1] = 0.5 * (points[0] + points[2]) + 0.03 * (points[1] - points[0])
    pixel = project_points(CAMERA, POSE, points)
    for draw in range(10):
        noisy = pixel + 2.0 * np.random.default_rng([seed, draw]).standard_normal((4, 2))
        found = resect(CAMERA, points, noisy, np.ones(4))
        assert np.abs(found.residual_px).max() < 7.0
        assert np.linalg.norm(found.refined.position_world_m - POSE.position_world_m) < 1.0


def test_points_and_centre_near_one_cylinder_are_refined_all_the_same() -> None:
    """Steps shrink slowly there (the dangerous cylinder); the marks contradict nothing."""
    camera = Camera("s", 1200, 900, 1800.0, np.array([602.5, 447.5]), np.array([-0.08, 0.06, -0.01, 0.0]))
    pose = Pose(rotation_from_gimbal(180.0, -90.0, 0.0), np.array([-19.14, 17.38, 80.12]))
    points = np.array([[1.7, 24.8, 2.1], [-45.9, 14.2, 2.3], [-20.7, 11.2, 2.2], [-16.7, 29.3, 2.8]])
    exact = project_points(camera, pose, points)
    for seed in range(20):
        pixel = exact + 0.5 * np.random.default_rng(seed).standard_normal((4, 2))
        found = resect(camera, points, pixel, np.ones(4))
        assert np.abs(found.residual_px).max() < 3.0


# ---- real photographs -----------------------------------------------------------------------------------------------


def test_the_hillside_photographs_land_where_they_are_known_to(shared_data: SharedData) -> None:
    photographs = shared_data("dtu_phantom4/images")
    survey = load_project(ROOT / "examples" / "dtu_phantom4" / "project.yaml", photographs)
    frame = LocalFrame(survey.crs, (719940.0, 6191970.0, 100.0), "grid")
    control = survey.control_points_in(frame)
    known = [(0.387, 1.1), (0.459, 4.8), (0.418, 3.0)]
    for index, (photograph, (distance_m, check_px)) in enumerate(zip(survey.photographs, known, strict=True)):
        marks = control.mark_photograph == index
        points = control.position_world_m[control.mark_point[marks]]
        gnss = frame.world_from_map(np.array([photograph.gnss_map_m]))[0]
        found = resect(
            survey.cameras[0], points, control.mark_pixel[marks], control.mark_sigma_px[marks], expected_world_m=gnss
        )
        assert np.linalg.norm(found.p3p.position_world_m - gnss) == pytest.approx(distance_m, abs=0.005)
        assert found.check_px == pytest.approx(check_px, abs=0.1)
        assert found.points == (0, 1, 2)


def numbers(text: str | None) -> np.ndarray:
    return np.array((text or "").split(), dtype=float)


@pytest.mark.parametrize("number", [4167, 4168, 4169, 4170])
def test_another_programs_poses_are_found_again(number: int, shared_data: SharedData) -> None:
    folder = shared_data("mmvii_gcp4")
    solved = folder / "MMVII-PhgrProj" / "Ori" / "toto"
    calibration = ET.parse(solved / "Calib-PerspCentral-Foc-28000_Cam-PENTAX_K5.xml")
    radial = [float(calibration.findtext(f".//{k}") or "nan") for k in ("K1", "K2", "K3")]
    focal_px, centre = float(calibration.findtext(".//F") or "nan"), numbers(calibration.findtext(".//PP"))
    camera = Camera("Pentax K5", 1728, 1152, focal_px, centre, np.array([*radial, 0.0]))
    pose = ET.parse(solved / f"Ori-PerspCentral-IMGP{number}.JPG.xml")
    axes = np.column_stack([numbers(pose.findtext(f".//{axis}")) for axis in ("AxeI", "AxeJ", "AxeK")])
    checks = list(ET.parse(folder / "Ori-Ground_mm3d" / f"Orientation-IMGP{number}.JPG.xml").iter("Appuis"))
    points, pixel = (np.array([numbers(check.findtext(tag)) for check in checks]) for tag in ("Ter", "Im"))
    found = resect(camera, points, pixel, np.ones(len(pixel)))
    assert found.inliers.all()
    # That program's two formats of calibration differ by up to 0.05 px, at 5 m from the object.
    assert np.linalg.norm(found.refined.position_world_m - numbers(pose.findtext(".//Center"))) < 1e-4
    np.testing.assert_allclose(found.refined.rotation_world_from_camera, axes, rtol=0, atol=2e-5)
    assert np.abs(found.residual_px).max() < 0.06
