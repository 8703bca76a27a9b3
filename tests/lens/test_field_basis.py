from dataclasses import replace

import numpy as np
import pytest
from makers import WIDE
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, distort, image_plane, project_points, unproject
from photogram.lens.field_basis import FieldBasis, attitude_slopes, field_basis, interior_slopes
from photogram.projection import READOUT

FISHEYE = replace(WIDE, model="fisheye", tangential=np.zeros(2))


@pytest.fixture(scope="module")
def basis() -> FieldBasis:
    return field_basis(WIDE, 6)


def _lattice() -> FloatArray:
    u, v = (np.arange(n) * side / n + side / (2 * n) - 0.5 for n, side in ((400, 4000), (300, 3000)))
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("camera", [WIDE, FISHEYE], ids=lambda camera: camera.model)
def test_interior_slopes_are_those_of_the_camera(camera: Camera) -> None:
    pixel = _lattice()[::997]
    ideal = image_plane(camera, pixel)
    slopes = interior_slopes(camera, pixel)
    for parameter in range(READOUT):
        step = 1e-5 * max(1.0, abs(camera.parameters[parameter]))
        ahead, behind = camera.parameters.copy(), camera.parameters.copy()
        ahead[parameter] += step
        behind[parameter] -= step
        sides = []
        for values in (ahead, behind):
            moved = camera.with_parameters(values)
            sides.append(distort(moved, ideal * moved.focal_px + moved.principal_point_px))
        numerical = (sides[0] - sides[1]) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, :, parameter], numerical, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("camera", [WIDE, FISHEYE], ids=lambda camera: camera.model)
def test_attitude_slopes_are_those_of_turned_poses(camera: Camera) -> None:
    pixel = _lattice()[::997]
    points = 50.0 * unproject(camera, pixel)
    slopes = attitude_slopes(camera, pixel)
    for axis in range(3):
        turns = (Rotation.from_rotvec(sign * 1e-4 * np.eye(3)[axis]).as_matrix() for sign in (1.0, -1.0))
        # the world turns against the camera
        ahead, behind = (project_points(camera, Pose(turn.T, np.zeros(3)), points) for turn in turns)
        np.testing.assert_allclose(slopes[:, :, axis], (ahead - behind) / 2e-4, rtol=1e-5, atol=1e-2)


def test_the_functions_are_orthonormal_and_free_of_the_camera(basis: FieldBasis) -> None:
    pixel = _lattice()  # not the nodes of the quadrature: 120 000 midpoints
    functions = basis.at(pixel).reshape(-1, len(basis))
    mean = functions.T @ functions / len(functions)
    np.testing.assert_allclose(mean, np.eye(len(basis)), atol=2e-3)
    known = np.concatenate([interior_slopes(WIDE, pixel), attitude_slopes(WIDE, pixel)], axis=2)
    slopes = known.reshape(len(functions), -1)
    slopes /= np.sqrt(np.mean(slopes**2, axis=0))
    assert np.abs(functions.T @ slopes / len(functions)).max() < 2e-3


def test_functions_and_camera_describe_every_product_up_to_the_degree(basis: FieldBasis) -> None:
    u, v = (2.0 * _lattice()[::53] + 1.0).T / np.array([[4000], [3000]]) - 1.0
    field = np.stack([u**3 * v**2 - 0.5 * u * v**3, 0.7 * u**4 - v**5], axis=-1).reshape(-1)
    pixel = _lattice()[::53]
    parts = basis.at(pixel), interior_slopes(WIDE, pixel), attitude_slopes(WIDE, pixel)
    columns = np.hstack([part.reshape(len(field), -1) for part in parts])
    columns /= np.linalg.norm(columns, axis=0)
    rest = field - columns @ np.linalg.lstsq(columns, field, rcond=None)[0]
    assert np.std(rest) < 0.02 * np.std(field)


def test_degrees_ascend_and_their_number_is_that_of_the_products_less_the_camera(basis: FieldBasis) -> None:
    assert np.all(np.diff(basis.degree) >= 0)
    assert 56 - 14 <= len(basis) <= 56 - 10
    assert len(field_basis(WIDE, 0)) == 0


def test_a_degree_beyond_the_quadrature_is_refused() -> None:
    with pytest.raises(ValueError, match="degree of 0 to 15"):
        field_basis(WIDE, 16)
