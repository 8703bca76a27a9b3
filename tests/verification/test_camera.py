"""Projection, rotations and the map of the checker, against the engine's, OpenCV's and PROJ's."""

import numpy as np
import pytest
from makers import WIDE
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from photogram.camera import Pose, oriented_by
from photogram.factors.elimination.reprojection import Observations, linearise
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.map_projection import projection_of
from photogram.verification import camera as cam


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_pixels_and_derivatives_are_those_of_the_engine(model: str) -> None:
    camera = WIDE.with_parameters(WIDE.parameters)
    object.__setattr__(camera, "model", model)
    rng = np.random.default_rng(1)
    points = rng.normal([0.0, 0.0, 10.0], [4.0, 3.0, 1.0], (40, 3))
    points[0] = [1e-6, -2e-6, 9.0]
    cameras = oriented_by([camera], np.zeros(1, np.int64), [Pose(np.eye(3), np.zeros(3))])
    none = np.zeros(40, np.int64)
    linear = linearise(Observations(none, np.arange(40), np.zeros((40, 2)), np.ones(40)), cameras, points)
    fisheye, q = np.full(40, model == "fisheye"), np.tile(camera.parameters, (40, 1))
    by_place, by_parameter = cam.derivatives(fisheye, q, points, list(range(11)))
    np.testing.assert_allclose(cam.image_of(fisheye, q, points), linear.residual, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(by_place, linear.point, rtol=1e-11, atol=1e-8)
    np.testing.assert_allclose(by_parameter, linear.calibration[:, :, :11], rtol=1e-11, atol=1e-9)


def test_rotations_and_their_vectors_belong_together() -> None:
    v = np.random.default_rng(2).normal(0.0, 1.0, (20, 3))
    v[:3] = [[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.0, 1e-5, 0.0]]
    np.testing.assert_allclose(cam.rotation(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(cam.rotation_vector(cam.rotation(v)), v, atol=1e-13)
    small = np.array([[3e-7, -2e-7, 1e-7]])
    turned = cam.rotation_vector(cam.rotation(v) @ cam.rotation(np.tile(small, (20, 1)))) - v
    np.testing.assert_allclose(turned, cam.turn_of(v) @ small[0], atol=1e-12)


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:31467", "EPSG:27700", "EPSG:32722"])
def test_the_map_is_that_of_proj(crs: str) -> None:
    origin = {"EPSG:31467": (3500100.0, 5500000.0), "EPSG:27700": (500000.0, 200000.0), "EPSG:32722": (7e5, 7.5e6)}
    frame = LocalFrame(crs, (*origin.get(crs, (600000.0, 5800000.0)), 100.0))
    projection = projection_of(crs)
    geodetic = Transformer.from_crs(crs, frame._crs.geodetic_crs, always_xy=True)
    lon, lat = np.radians(geodetic.transform(*frame.origin_map_m[:2]))
    world = np.random.default_rng(3).normal(0.0, [2000.0, 2000.0, 100.0], (50, 3))
    found = cam.map_from_world(
        np.array(projection.semi_axes_m), np.array(projection.parameters), np.array([lat, lon, 100.0]), world
    )
    np.testing.assert_allclose(found, frame.map_from_world(world), rtol=0.0, atol=2e-8)


def test_nodes_of_a_lens_field_interpolate_a_plane() -> None:
    rng, size = np.random.default_rng(4), np.array([[400.0, 300.0]])
    pixel = rng.uniform(-0.5, [399.5, 299.5], (30, 2))
    i, j, w = cam.nodes_around(np.tile(size, (30, 1)), (7, 9), pixel)
    plane = 2.0 * np.arange(9)[None, :] - 3.0 * np.arange(7)[:, None]
    expected = 2.0 * (pixel[:, 0] + 0.5) / 400.0 * 8.0 - 3.0 * (pixel[:, 1] + 0.5) / 300.0 * 6.0
    np.testing.assert_allclose(np.sum(w * plane[i, j], axis=1), expected, atol=1e-11)
