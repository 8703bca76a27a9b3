"""Least squares matching against places in pictures that were moved, turned and made brighter."""

import cv2
import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from photogram.arrays import FloatArray
from photogram.marking.targets.matching import Template, match_centre, sampled


def ground(rng: np.random.Generator) -> FloatArray:
    rough = cv2.GaussianBlur(rng.normal(size=(160, 160)), (0, 0), 2.0)
    return np.asarray(120.0 + 30.0 * rough / rough.std(), np.float64)


def moved(grey: FloatArray, place: FloatArray, A: FloatArray, to: FloatArray) -> FloatArray:
    """Return a picture (80, 80) in which what lies at ``place`` (2,) lies at ``to`` (2,), under an affine map."""
    u, v = np.meshgrid(np.arange(80.0), np.arange(80.0))
    there = place + np.stack([u - to[0], v - to[1]], axis=-1) @ np.linalg.inv(A).T
    return np.asarray(map_coordinates(grey, [there[..., 1], there[..., 0]], order=5, mode="nearest"), np.float64)


def test_places_are_found_in_pictures_that_lean_and_their_sigmas_are_true() -> None:
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(40):
        whole, place, to = ground(rng), rng.uniform(70, 90, 2), rng.uniform(37, 43, 2)
        A = np.eye(2) + rng.uniform(-0.1, 0.1, (2, 2))
        template = (moved(whole, place, np.eye(2), np.array([40.3, 39.8])) + rng.normal(0, 3, (80, 80))).astype(
            np.float32
        )
        grey = (0.8 * moved(whole, place, A, to) + 20.0 + rng.normal(0, 3, (80, 80))).astype(np.float32)
        found = match_centre([Template(template, np.array([40.3, 39.8]))], grey, to + np.array([3.0, -2.0]))
        assert found is not None
        assert np.abs(found.centre_px - to).max() < 0.25
        ratios.append((found.centre_px - to) / found.sigma_px)
    assert 0.6 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.4


def test_other_ground_is_not_matched() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        template = Template(ground(rng)[:60, :60].astype(np.float32), np.array([30.0, 30.0]))
        assert match_centre([template], ground(rng)[:80, :80].astype(np.float32), np.array([40.0, 40.0])) is None


def test_an_edge_is_not_matched() -> None:
    rng = np.random.default_rng(3)
    edge = np.where(np.arange(80) < 40, 60.0, 160.0) + rng.normal(0, 2, (80, 80))
    template = Template(edge.astype(np.float32), np.array([40.0, 40.0]))
    assert match_centre([template], edge.astype(np.float32), np.array([41.0, 38.0])) is None


def test_a_template_that_disagrees_with_two_is_left_out() -> None:
    rng = np.random.default_rng(4)
    grey = ground(rng).astype(np.float32)
    right = Template(grey, np.array([80.0, 80.0]))
    wrong = Template(grey, np.array([86.0, 80.0]))
    near = np.array([81.0, 79.0])
    found = match_centre([right, right, wrong], grey, near)
    assert found is not None
    np.testing.assert_allclose(found.centre_px, [80.0, 80.0], atol=0.02)
    assert match_centre([], grey, near) is None


def test_slopes_are_those_of_a_plane() -> None:
    v, u = np.mgrid[:30, :30].astype(np.float64)
    value, slope_u, slope_v = sampled(spline_filter(2.0 * u - 3.0 * v, order=3), np.array([[12.3, 14.6]]))
    np.testing.assert_allclose([value[0], slope_u[0], slope_v[0]], [24.6 - 43.8, 2.0, -3.0], atol=1e-4)
