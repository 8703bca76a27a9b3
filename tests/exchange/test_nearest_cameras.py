"""The nearest camera without some terms: exact where it can be, as near as it says where not."""

from dataclasses import replace

import numpy as np
import pytest
from foreign import small_solution
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, field_at, image_plane, project_points, undistort
from photogram.exchange.formats.nearest_cameras import nearest_camera, without_fields
from photogram.exchange.formats.undistorted import pinhole_solution
from photogram.lens.fields import free_field
from photogram.projection import PARAMETER_NAMES

ALL = frozenset(PARAMETER_NAMES)
CAMERA = Camera(
    "c", 4000, 3000, 3650.0, np.array([2012.0, 1489.5]), np.array([-0.012, 0.02, -0.01, 0.0]),
    np.array([0.0004, -0.0003]), affinity=np.array([-1.2, 0.6]),
)  # fmt: skip


def seen(camera: Camera, seed: int = 3) -> tuple[Pose, np.ndarray, np.ndarray]:
    """A pose, points of the world before it, and their pixels."""
    rng = np.random.default_rng(seed)
    pixel = rng.uniform([0, 0], [camera.width_px - 1, camera.height_px - 1], (4000, 2))
    pose = Pose(Rotation.from_rotvec([3.0, 0.2, -0.1]).as_matrix(), np.array([50.0, -20.0, 100.0]))
    local = np.column_stack([image_plane(camera, pixel), np.ones(len(pixel))]) * rng.uniform(60, 90, (len(pixel), 1))
    return pose, pose.world_from_camera(local), pixel


def test_nothing_changes_where_nothing_is_lost() -> None:
    found = nearest_camera(CAMERA, ALL)
    assert found.camera is CAMERA
    assert (found.rms_px, found.largest_px) == (0.0, 0.0)
    np.testing.assert_array_equal(found.turn, np.eye(3))
    plain = replace(CAMERA, affinity=np.array([-1.2, 0.0]))
    assert nearest_camera(plain, ALL - {"b2", "k4"}).camera is plain


@pytest.mark.parametrize("terms", [ALL - {"b2"}, ALL - {"b1", "b2"}, frozenset({"focal_px", "k1", "k2"})])
def test_points_of_the_world_are_as_near_as_is_said(terms: frozenset[str]) -> None:
    found = nearest_camera(CAMERA, terms)
    lost = [value for name, value in zip(PARAMETER_NAMES, found.camera.parameters, strict=True) if name not in terms]
    assert all(value in (0.0, 1999.5, 1499.5) for value in lost)
    pose, points, pixel = seen(CAMERA)
    away = np.linalg.norm(project_points(found.camera, found.turned(pose), points) - pixel, axis=1)
    assert float(np.sqrt(np.mean(away**2))) == pytest.approx(found.rms_px, rel=0.15)
    assert away.max() <= 1.01 * found.largest_px
    bare = np.where(np.isin(PARAMETER_NAMES, list(terms)), CAMERA.parameters, 0.0)
    bare[1:3] = CAMERA.parameters[1:3] if "cx_px" in terms else [1999.5, 1499.5]
    dropped = project_points(CAMERA.with_parameters(bare), pose, points) - pixel
    assert found.rms_px < 0.85 * np.sqrt(np.mean(np.sum(dropped**2, axis=1)))


def test_half_of_a_skew_is_a_turn_about_the_axis() -> None:
    """b2 y is half a shear that no turn takes up and half a turn by b2 / 2f; f and b1 cannot shear across."""
    skewed = Camera("c", 3001, 3001, 3000.0, np.array([1500.0, 1500.0]), affinity=np.array([0.0, 0.8]))
    found = nearest_camera(skewed, ALL - {"b2", "k1", "k2", "k3", "k4", "p1", "p2"})
    assert Rotation.from_matrix(found.turn).as_rotvec()[2] == pytest.approx(-0.4 / 3000.0, rel=1e-3)
    # u' − u = b2 y / 2 and v' − v = b2 x / 2 remain, x and y up to 0.5
    assert found.largest_px == pytest.approx(0.4 * np.hypot(0.5, 0.5), rel=0.01)
    assert found.rms_px == pytest.approx(0.4 * np.sqrt(2 / 12), rel=0.1)


def test_a_fisheye_without_skew() -> None:
    wide = Camera("w", 2000, 1500, 900.0, np.array([1003.0, 747.0]), np.array([0.01, -0.004, 0.001, 0.0]),
                  affinity=np.array([0.5, 0.3]), model="fisheye")  # fmt: skip
    found = nearest_camera(wide, ALL - {"b2", "p1", "p2"})
    assert found.camera.affinity[1] == 0.0
    assert 0.01 < found.largest_px < 0.3


def with_field(camera: Camera) -> Camera:
    field = free_field(camera, 0.2)
    drawn = field.sigmas * np.random.default_rng(4).standard_normal(len(field.sigmas))
    return replace(camera, field=replace(field, coefficients=drawn))


def test_the_nearest_camera_without_its_lens_field_is_as_far_away_as_the_field_is_large() -> None:
    camera = with_field(CAMERA)
    assert camera.field is not None
    found = nearest_camera(camera, ALL - {"k4", "readout_s"})
    assert found.camera.field is None
    sides = np.meshgrid(np.linspace(-0.5, 3999.5, 25), np.linspace(-0.5, 2999.5, 25))
    size = np.linalg.norm(field_at(camera, np.stack(sides, axis=-1).reshape(-1, 2)), axis=1)
    # the field is free of what parameters and a turn describe
    assert 0.9 < found.rms_px / np.sqrt(np.mean(size**2)) < 1.0 + 1e-6
    pose, points, pixel = seen(camera)
    away = np.linalg.norm(project_points(found.camera, found.turned(pose), points) - pixel, axis=1)
    assert 0.7 * found.rms_px < np.sqrt(np.mean(away**2)) < found.rms_px  # the edge of the picture counts more there


def test_solutions_go_without_lens_fields_and_say_so() -> None:
    made = small_solution()
    bent = replace(made, cameras=tuple(with_field(c) for c in made.cameras))
    found, said = without_fields(bent)
    assert all(camera.field is None for camera in found.cameras)
    assert len(said) == len(made.cameras)
    assert all(text.startswith("The lens field of camera") for text in said)
    assert without_fields(made) == (made, ())


def test_undistorted_photographs_hold_the_field() -> None:
    made = small_solution()
    made = replace(made, cameras=tuple(with_field(c) for c in made.cameras))
    pinholes, tie = pinhole_solution(made), made.tie_points
    assert all(camera.field is None for camera in pinholes.cameras)
    camera = made.cameras[made.photographs[tie.photograph[0]].camera]
    np.testing.assert_allclose(pinholes.tie_points.pixel[0], undistort(camera, tie.pixel[:1])[0], atol=1e-9)
