"""Distances to a mesh, against all its triangles one by one."""

import numpy as np
import pytest

from photogram.change.mesh_distances import mesh_distances, mesh_of
from photogram.survey import PointCloud, Raster


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(3.0 * np.sin(x / 2.0) * np.cos(y / 3.0))


def to_segment(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = np.clip(np.sum((p - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(p - a - along[:, None] * (b - a), axis=1))


def by_all(p: np.ndarray, corners: np.ndarray) -> float:
    """Return the least distance of a point to triangles (T, 3, 3), by their planes and their sides."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    off = np.sum((p - a) * normal, axis=1)
    foot = p - off[:, None] * normal
    inside = np.ones(len(corners), dtype=bool)
    for first, second in ((a, b), (b, c), (c, a)):
        inside &= np.sum(np.cross(second - first, foot - first) * normal, axis=1) >= 0.0
    sides = np.min([to_segment(p, *pair) for pair in ((a, b), (b, c), (c, a))], axis=0)
    return float(np.min(np.where(inside, np.abs(off), sides)))


def test_distances_are_those_to_the_nearest_of_all_triangles() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, 20.0, (900, 2)) + np.array([500_000.0, 6_000_000.0])
    mesh = mesh_of(PointCloud(np.column_stack([xy, hills(*(xy - [500_000.0, 6_000_000.0]).T)])))
    place = np.column_stack([rng.uniform(2.0, 18.0, (120, 2)), rng.uniform(-6.0, 6.0, 120)])
    place += [500_000.0, 6_000_000.0, 0.0]
    distance = mesh_distances(place, mesh)
    corners = mesh.points.position_map_m[mesh.triangulation.simplices[~mesh.bridging]]
    expected = [by_all(p, corners) for p in place]
    np.testing.assert_allclose(np.abs(distance), expected, atol=1e-8)
    above = place[:, 2] > mesh.heights(place)
    np.testing.assert_array_equal(distance > 0.0, above)


def test_on_a_slope_the_distance_is_shorter_than_the_height() -> None:
    east = np.tile(np.arange(40) * 0.5, (30, 1))
    raster = Raster((0.75 * (east + 0.25)).astype(np.float32), 0.0, 15.0, 0.5)
    place = np.array([[10.0, 7.0, 7.5 + 1.0], [10.0, 7.0, 7.5 - 0.5]])
    np.testing.assert_allclose(mesh_distances(place, mesh_of(raster)), [0.8, -0.4], atol=1e-6)


def test_beside_the_mesh_and_over_its_holes_there_is_no_distance() -> None:
    values = np.zeros((20, 30), np.float32)
    values[8:12, 10:16] = np.nan
    mesh = mesh_of(Raster(values, 0.0, 20.0, 1.0))
    place = np.array([[13.0, 10.0, 1.0], [-3.0, 10.0, 1.0], [5.0, 5.0, 1.0]])
    distance = mesh_distances(place, mesh)
    assert np.isnan(distance[:2]).all()
    assert distance[2] == pytest.approx(1.0)
