from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from photogram.camera import (
    Camera,
    Pose,
    Similarity,
    distort,
    gimbal_from_rotation,
    image_plane,
    omega_phi_kappa_deg,
    oriented_by,
    project_points,
    rotation_from_gimbal,
    rotation_from_omega_phi_kappa,
    undistort,
    unproject,
)
from photogram.errors import ImageError
from photogram.projection import (
    NEAR_AXIS,
    PARAMETER_NAMES,
    PARAMETERS,
    OrientedCameras,
    distorted,
    equidistant,
    project_point_jacobians,
)

DRONE = Camera(
    "drone",
    5472,
    3648,
    3674.195,
    np.array([2740.9, 1837.1]),
    np.array([-0.261203, 0.107443, -0.0356483, 0.0]),
    np.array([-0.00112104, 0.000839376]),
)
POSE = Pose(Rotation.from_euler("xyz", [171.0, 4.0, -63.0], degrees=True).as_matrix(), np.array([12.0, -7.0, 63.0]))


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    width, height = draw(st.integers(300, 9000)), draw(st.integers(200, 6000))
    focal = draw(st.floats(0.6, 3.0)) * max(width, height)
    centre = [draw(st.floats(0.45, 0.55)) * width, draw(st.floats(0.45, 0.55)) * height]
    radial = [draw(st.floats(-size, size)) for size in (0.3, 0.15, 0.05, 0.02)]
    tangential = [draw(st.floats(-0.003, 0.003)), draw(st.floats(-0.003, 0.003))]
    affinity = np.array([draw(st.floats(-20.0, 20.0)), draw(st.floats(-20.0, 20.0))])
    return Camera(
        "drawn", width, height, focal, np.array(centre), np.array(radial), np.array(tangential), affinity=affinity
    )


@st.composite
def fisheyes(draw: st.DrawFn) -> Camera:
    """Cameras that see up to 70° off their axis in the corners."""
    camera = draw(cameras())
    reach = draw(st.floats(0.4, 1.2))
    focal = 0.6 * float(np.hypot(camera.width_px, camera.height_px)) / reach
    radial = np.array([draw(st.floats(-size, size)) for size in (0.05, 0.02, 0.01, 0.003)])
    return replace(camera, focal_px=focal, radial=radial, model="fisheye")


def points_before(pose: Pose, camera: Camera, count: int, seed: int) -> np.ndarray:
    """Points that ``camera`` sees all over its picture, 20 to 90 m away."""
    rng = np.random.default_rng(seed)
    pixel = rng.uniform([0.0, 0.0], [camera.width_px - 1, camera.height_px - 1], (count, 2))
    plane = (pixel - camera.principal_point_px) / camera.focal_px
    if camera.model == "fisheye":
        theta = np.linalg.norm(plane, axis=1, keepdims=True)
        plane *= np.tan(np.minimum(theta, 1.4)) / theta
    ray = np.column_stack([plane, np.ones(count)])
    return pose.world_from_camera(ray * rng.uniform(20.0, 90.0, (count, 1)))


def central(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Jacobian by central differences of fourth order."""
    columns = []
    for k in range(len(at)):
        h = np.zeros(len(at))
        h[k] = step[k]
        columns.append(
            (8 * (function(at + h) - function(at - h)) - (function(at + 2 * h) - function(at - 2 * h))) / (12 * step[k])
        )
    return np.array(columns).T


def assert_close_by_row(analytic: np.ndarray, numerical: np.ndarray) -> None:
    """Within 1e-6 of the largest entry of each column: small entries of a column are differences of large numbers."""
    size = np.abs(numerical).max(axis=0)
    assert np.all(np.abs(analytic - numerical) <= 1e-6 * size + 1e-12), np.abs(analytic - numerical) / size


def one(camera: Camera) -> OrientedCameras:
    return oriented_by([camera], np.zeros(1, np.int64), [POSE])


@settings(max_examples=150, deadline=None)
@given(camera=st.one_of(cameras(), fisheyes()), place=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)))
def test_undistort_undoes_distort(camera: Camera, place: tuple[float, float]) -> None:
    ideal = np.array([[place[0] * (camera.width_px - 1), place[1] * (camera.height_px - 1)]])
    x, y = ((ideal - camera.principal_point_px) / camera.focal_px)[0]
    if camera.model == "fisheye":
        x, y = np.array([x, y]) * np.arctan(np.hypot(x, y)) / max(np.hypot(x, y), 1e-12)
    # The model must be invertible on the whole way from the centre to the point; beyond a fold, no inverse is right.
    for share in np.linspace(0.0, 1.0, 40):
        _, _, a, b, d = distorted(tuple(camera.parameters), share * x, share * y)
        assume(a * d - b * b > 0.05 and a + d > 0)
    np.testing.assert_allclose(undistort(camera, distort(camera, ideal)), ideal, rtol=0, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(place=st.tuples(st.floats(-0.5, 5471.5), st.floats(-0.5, 3647.5)))
def test_a_real_calibration_is_undone_to_a_billionth_of_a_pixel_everywhere(place: tuple[float, float]) -> None:
    pixel = np.array([place])
    np.testing.assert_allclose(distort(DRONE, undistort(DRONE, pixel)), pixel, rtol=0, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(camera=cameras(), seed=st.integers(0, 2**31))
def test_projection_agrees_with_opencv(camera: Camera, seed: int) -> None:
    # OpenCV knows neither k4 as a power of the radius nor b2.
    camera = replace(camera, radial=camera.radial * [1.0, 1.0, 1.0, 0.0], affinity=camera.affinity * [1.0, 0.0])
    points = points_before(POSE, camera, 40, seed)
    k1, k2, k3, _ = camera.radial
    R = POSE.rotation_world_from_camera.T
    expected, _ = cv2.projectPoints(
        points,
        cv2.Rodrigues(R)[0],
        -R @ POSE.position_world_m,
        camera.matrix + np.diag([camera.affinity[0], 0.0, 0.0]),
        np.array([k1, k2, *camera.tangential, k3]),
    )
    np.testing.assert_allclose(project_points(camera, POSE, points), expected.reshape(-1, 2), rtol=0, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(camera=fisheyes(), seed=st.integers(0, 2**31))
def test_the_fisheye_agrees_with_opencv(camera: Camera, seed: int) -> None:
    camera = replace(camera, tangential=np.zeros(2))
    points = points_before(POSE, camera, 40, seed)
    R = POSE.rotation_world_from_camera.T
    b1, b2 = camera.affinity
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None],
        cv2.Rodrigues(R)[0],
        -R @ POSE.position_world_m,
        camera.matrix + np.diag([b1, 0.0, 0.0]),
        camera.radial,
        alpha=b2 / (camera.focal_px + b1),
    )
    np.testing.assert_allclose(project_points(camera, POSE, points), expected.reshape(-1, 2), rtol=0, atol=1e-6)


def test_the_fisheye_is_smooth_where_its_series_ends() -> None:
    camera = Camera("eye", 4000, 3000, 1400.0, np.array([1999.5, 1499.5]), model="fisheye")
    tangent = np.sqrt(NEAR_AXIS) * np.array([0.0, 1e-9, 1e-3, 0.5, 1 - 1e-9, 1.0, 1 + 1e-9, 2.0])
    points = np.column_stack([tangent, np.zeros_like(tangent), np.ones_like(tangent)])
    pixel = project_points(camera, Pose(np.eye(3), np.zeros(3)), points)
    np.testing.assert_allclose(pixel[:, 0] - 1999.5, 1400.0 * np.arctan(tangent), rtol=0, atol=1e-12 * 2000)
    np.testing.assert_allclose(image_plane(camera, pixel)[:, 0], tangent, rtol=0, atol=1e-15)
    for model_point in points:
        analytic = np.array(equidistant(*(30.0 * model_point)))
        x, _, z = 30.0 * model_point
        numerical = central(lambda p: np.array(equidistant(p[0], 0.0, p[1])[:1]), np.array([x, z]), np.full(2, 1e-2))
        np.testing.assert_allclose([analytic[1] * x, -analytic[2]], numerical[0], rtol=1e-7, atol=1e-12)


def test_a_fisheye_that_looks_sideways_is_refused_with_the_place() -> None:
    camera = Camera("eye", 4000, 3000, 1200.0, np.array([1999.5, 1499.5]), model="fisheye")
    assert camera.largest_radius == np.inf
    assert camera.largest_image_radius == pytest.approx(np.pi / 2)
    edge = np.array([[1999.5 + 1200.0 * np.pi / 2 - 1.0, 1499.5]])
    np.testing.assert_allclose(distort(camera, undistort(camera, edge)), edge, atol=1e-6)
    with pytest.raises(ImageError, match=r"eye: .* at pixel \(3990\.0, 1499\.5\), which must be less than 90° off"):
        image_plane(camera, np.array([[2100.0, 1500.0], [3990.0, 1499.5]]))
    folding = replace(camera, radial=np.array([-0.25, 0.0, 0.0, 0.0]))
    assert folding.largest_radius == pytest.approx(np.tan(np.sqrt(4.0 / 3.0)))
    sideways = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 1.0], [2.0, 0.0, 1.0]])
    pixel = project_points(folding, Pose(np.eye(3), np.zeros(3)), sideways)
    assert np.isnan(pixel[:2]).all()
    assert np.isfinite(pixel[2]).all()


def test_undistortion_agrees_with_opencv() -> None:
    pixel = np.random.default_rng(3).uniform([0, 0], [5471, 3647], (200, 2))
    k1, k2, k3, _ = DRONE.radial
    coefficients = np.array([k1, k2, *DRONE.tangential, k3])
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-14)
    expected = cv2.undistortPoints(pixel[:, None], DRONE.matrix, coefficients, P=DRONE.matrix, criteria=criteria)
    np.testing.assert_allclose(undistort(DRONE, pixel), expected.reshape(-1, 2), rtol=0, atol=1e-6)


def test_each_coefficient_enters_as_brown_wrote_it() -> None:
    camera = Camera("plain", 2000, 1000, 1000.0, np.array([990.0, 505.0]))
    x, y = 0.3, -0.2
    r2, f = x * x + y * y, 1000.0
    moves = {
        "k1": (f * x * r2, f * y * r2),
        "k2": (f * x * r2**2, f * y * r2**2),
        "k3": (f * x * r2**3, f * y * r2**3),
        "k4": (f * x * r2**4, f * y * r2**4),
        "p1": (f * 2 * x * y, f * (r2 + 2 * y * y)),
        "p2": (f * (r2 + 2 * x * x), f * 2 * x * y),
        "b1": (x, 0.0),
        "b2": (y, 0.0),
    }
    ideal = np.array([[f * x + 990.0, f * y + 505.0]])
    for number, move in enumerate(moves.values(), start=3):
        parameters = camera.parameters.copy()
        parameters[number] = 0.01
        moved = distort(camera.with_parameters(parameters), ideal) - ideal
        np.testing.assert_allclose(moved[0], 0.01 * np.array(move), rtol=1e-9, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(camera=st.one_of(cameras(), fisheyes()), seed=st.integers(0, 2**31))
def test_projection_jacobians_agree_with_differences(camera: Camera, seed: int) -> None:
    X = points_before(POSE, camera, 1, seed)[0]
    rotation, centre = POSE.rotation_world_from_camera, POSE.position_world_m
    J_pose, J_camera, J_point = np.empty((2, 6)), np.empty((2, PARAMETERS)), np.empty((2, 3))
    at = project_points(camera, POSE, X[None])[0].tolist()
    u, v, depth = project_point_jacobians(one(camera), 0, X, at[1], J_pose, J_camera, J_point)

    def of_pose(t: np.ndarray) -> np.ndarray:
        moved = Pose(rotation @ Rotation.from_rotvec(t[:3]).as_matrix(), centre + rotation @ t[3:])
        return np.asarray(project_points(camera, moved, X[None])[0])

    assert depth > 0
    np.testing.assert_allclose([u, v], of_pose(np.zeros(6)), rtol=0, atol=1e-9)
    assert_close_by_row(J_pose, central(of_pose, np.zeros(6), np.array([1e-4] * 3 + [1e-2] * 3)))
    assert_close_by_row(J_point, central(lambda p: project_points(camera, POSE, p[None])[0], X, np.full(3, 1e-2)))
    step = np.where(np.isin(PARAMETER_NAMES, ("focal_px", "cx_px", "cy_px", "b1", "b2")), 1.0, 1e-3)
    of_camera = central(lambda q: project_points(camera.with_parameters(q), POSE, X[None])[0], camera.parameters, step)
    reach = float(np.abs((X - centre) @ rotation).max() / depth)
    np.testing.assert_allclose(J_camera, of_camera, rtol=1e-6, atol=1e-7 * camera.focal_px * max(1.0, reach))


@settings(max_examples=100, deadline=None)
@given(camera=cameras(), x=st.floats(-0.8, 0.8), y=st.floats(-0.8, 0.8))
def test_distortion_jacobian_agrees_with_differences(camera: Camera, x: float, y: float) -> None:
    q = tuple(camera.parameters)
    _, _, a, b, d = distorted(q, x, y)
    numerical = central(lambda t: np.array(distorted(q, t[0], t[1])[:2]), np.array([x, y]), np.full(2, 1e-3))
    np.testing.assert_allclose([[a, b], [b, d]], numerical, rtol=1e-6, atol=1e-8)


def test_points_behind_or_in_the_projection_centre_have_no_pixel() -> None:
    ahead = POSE.rotation_world_from_camera[:, 2]
    points = POSE.position_world_m + np.outer([30.0, -30.0, 0.0], ahead)
    pixel = project_points(DRONE, POSE, points)
    np.testing.assert_allclose(pixel[0], DRONE.principal_point_px, atol=1e-9)
    assert np.isnan(pixel[1:]).all()
    J = np.ones((2, 6)), np.ones((2, PARAMETERS)), np.ones((2, 3))
    u, v, depth = project_point_jacobians(one(DRONE), 0, points[1], 0.0, *J)
    assert np.isnan([u, v]).all()
    assert depth == pytest.approx(-30.0)
    assert all(not j.any() for j in J)


def test_a_distortion_that_folds_back_is_refused_with_the_place() -> None:
    middle = np.array([1999.5, 1499.5])
    folding = Camera("fisheye by mistake", 4000, 3000, 2000.0, middle, np.array([-0.6, 0.0, 0.0, 0.0]))
    centre = np.array([[2100.0, 1500.0]])
    np.testing.assert_allclose(distort(folding, undistort(folding, centre)), centre, atol=1e-9)
    with pytest.raises(ImageError, match=r"fisheye by mistake: .* cannot be undone at pixel \(3990\.0, 20\.0\)"):
        image_plane(folding, np.array([[2100.0, 1500.0], [3990.0, 20.0]]))


def test_places_just_before_the_fold_are_found_though_steps_do_not_settle_there() -> None:
    """1 − 0.3 r² folds back at r = 1.0541, where r (1 − 0.3 r²) has its largest value."""
    folding = Camera("c", 4000, 3000, 2000.0, np.array([1999.5, 1499.5]), np.array([-0.3, 0.0, 0.0, 0.0]))
    r = np.linspace(1.0, 1.0525, 4000)
    pixel = folding.principal_point_px + 2000.0 * np.column_stack([0.8 * r, 0.6 * r])
    np.testing.assert_allclose(undistort(folding, distort(folding, pixel)), pixel, rtol=0, atol=1e-8)


def test_unknown_pixels_stay_unknown() -> None:
    ideal = image_plane(DRONE, np.array([[np.nan, np.nan], [100.0, 200.0]]))
    assert np.isnan(ideal[0]).all()
    assert np.isfinite(ideal[1]).all()


def test_rays_point_at_what_is_seen() -> None:
    points = points_before(POSE, DRONE, 60, 8)
    ray = unproject(DRONE, project_points(DRONE, POSE, points))
    towards = POSE.camera_from_world(points)
    np.testing.assert_allclose(ray, towards / np.linalg.norm(towards, axis=1, keepdims=True), atol=1e-12)


def test_a_pose_takes_points_there_and_back() -> None:
    points = points_before(POSE, DRONE, 20, 5)
    np.testing.assert_allclose(POSE.world_from_camera(POSE.camera_from_world(points)), points, atol=1e-12)
    with pytest.raises(ValueError, match="pose"):
        Pose(np.eye(3), np.zeros((3, 1)))


def test_a_similarity_of_points_and_poses_changes_no_pixel() -> None:
    rng = np.random.default_rng(5)
    similarity = Similarity(3.5, Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix(), np.array([100.0, -20.0, 7.0]))
    camera = Camera("a", 640, 480, 500.0, np.array([320.0, 240.0]), np.array([-0.1, 0.02, 0.0, 0.0]))
    pose = Pose(Rotation.from_rotvec([0.1, 0.2, -0.3]).as_matrix(), np.array([0.5, 0.25, -4.0]))
    points = rng.uniform(-1.0, 1.0, (20, 3))
    moved = project_points(camera, similarity.pose(pose), similarity.points(points))
    np.testing.assert_allclose(moved, project_points(camera, pose, points), rtol=0, atol=1e-9)


def test_a_camera_knows_its_edges_width_from_height() -> None:
    pixel = np.array([[-0.5, -0.5], [5471.5, 3647.5], [3700.0, 3600.0], [3600.0, 3700.0], [-0.6, 10.0], [10.0, 3647.6]])
    assert DRONE.contains(pixel).tolist() == [True, True, True, False, False, False]


def test_parameters_keep_their_order() -> None:
    parameters = np.array([3000.0, 1.0, 2.0, 0.1, 0.2, 0.3, 0.6, 0.4, 0.5, 7.0, 8.0, 0.03])
    camera = DRONE.with_parameters(parameters)
    np.testing.assert_array_equal(camera.parameters, parameters)
    np.testing.assert_array_equal(camera.radial, [0.1, 0.2, 0.3, 0.6])
    np.testing.assert_array_equal(camera.tangential, [0.4, 0.5])
    np.testing.assert_array_equal(camera.affinity, [7.0, 8.0])
    np.testing.assert_array_equal(camera.matrix, [[3000.0, 0.0, 1.0], [0.0, 3000.0, 2.0], [0.0, 0.0, 1.0]])
    assert (camera.name, camera.width_px) == ("drone", 5472)


def test_a_camera_refuses_what_cannot_be() -> None:
    with pytest.raises(ValueError, match="focal length"):
        Camera("none", 10, 10, 0.0, np.zeros(2))
    with pytest.raises(ValueError, match="radial"):
        Camera("short", 10, 10, 10.0, np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match="expected brown or fisheye"):
        Camera("odd", 10, 10, 10.0, np.zeros(2), model="pinhole")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="radial"):
        Camera("three", 10, 10, 10.0, np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="sigmas"):
        Camera("eight", 10, 10, 10.0, np.zeros(2), sigmas=np.zeros(8))
    with pytest.raises(ValueError, match="parameters of shape"):
        DRONE.with_parameters(np.ones(9))


@settings(max_examples=100, deadline=None)
@given(yaw=st.floats(-179.9, 179.9), pitch=st.floats(-89.9, 89.9), roll=st.floats(-179.9, 179.9))
def test_gimbal_angles_come_back(yaw: float, pitch: float, roll: float) -> None:
    R = rotation_from_gimbal(yaw, pitch, roll)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(gimbal_from_rotation(R), (yaw, pitch, roll), atol=1e-6)


def test_gimbal_angles_mean_what_the_drone_means() -> None:
    right, down, ahead = np.eye(3)
    level_east = rotation_from_gimbal(90.0, 0.0, 0.0)
    np.testing.assert_allclose(level_east @ ahead, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(level_east @ right, [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(level_east @ down, [0.0, 0.0, -1.0], atol=1e-12)
    nadir = rotation_from_gimbal(30.0, -90.0, 0.0)
    np.testing.assert_allclose(nadir @ ahead, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(nadir @ -down, [np.sin(np.pi / 6), np.cos(np.pi / 6), 0.0], atol=1e-12)
    rolled = rotation_from_gimbal(0.0, 0.0, 10.0)
    assert (rolled @ right)[2] == pytest.approx(-np.sin(np.deg2rad(10.0)))
    assert (rotation_from_gimbal(0.0, 20.0, 0.0) @ ahead)[2] == pytest.approx(np.sin(np.deg2rad(20.0)))


@settings(max_examples=100, deadline=None)
@given(omega=st.floats(-179.9, 179.9), phi=st.floats(-89.9, 89.9), kappa=st.floats(-179.9, 179.9))
def test_omega_phi_kappa_follow_their_formula(omega: float, phi: float, kappa: float) -> None:
    Rx, Ry, Rz = (
        Rotation.from_euler(axis, angle, degrees=True) for axis, angle in zip("xyz", (omega, phi, kappa), strict=True)
    )
    R = (Rx * Ry * Rz).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(omega_phi_kappa_deg(R), [omega, phi, kappa], atol=1e-6)


def test_a_photograph_straight_down_with_its_top_to_the_north_has_no_angles() -> None:
    np.testing.assert_allclose(omega_phi_kappa_deg(rotation_from_gimbal(0.0, -90.0, 0.0)), np.zeros(3), atol=1e-12)


def test_points_beyond_the_fold_of_the_distortion_are_not_seen() -> None:
    # r (1 − r²/4) grows up to r² = 4/3 and is back at the centre at r = 2.
    camera = Camera("fold", 1000, 800, 500.0, np.array([499.5, 399.5]), np.array([-0.25, 0.0, 0.0, 0.0]))
    assert camera.largest_radius == pytest.approx(np.sqrt(4.0 / 3.0))
    nadir = Pose(np.eye(3), np.zeros(3))
    pixel = project_points(camera, nadir, np.array([[1.1, 0.0, 1.0], [1.2, 0.0, 1.0], [2.0, 0.0, 1.0]]))
    assert np.isfinite(pixel[0]).all()
    assert np.isnan(pixel[1:]).all()


@given(st.lists(st.floats(-180.0, 180.0), min_size=3, max_size=3))
def test_angles_come_back_to_all_digits(angles: list[float]) -> None:
    for phi in (angles[1], 90.0, -90.0, 90.0 - 1e-7):
        R = rotation_from_omega_phi_kappa([angles[0], phi, angles[2]])
        back = rotation_from_omega_phi_kappa(omega_phi_kappa_deg(R))
        np.testing.assert_allclose(back, R, rtol=0, atol=3e-9)


def test_the_angles_of_any_rotation_give_it_back() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        R = Rotation.from_rotvec(rng.normal(0.0, 1.5, 3)).as_matrix()
        back = rotation_from_omega_phi_kappa(omega_phi_kappa_deg(R))
        np.testing.assert_allclose(back, R, rtol=0, atol=1e-13)
