"""Relative orientation against true motions: scenes with depth, planes, turns on the spot, and noise."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.sfm.relative_orientation import RelativeOrientation, relative_orientations

FOCAL_PX = 1000.0
NOISE = 0.5 / FOCAL_PX
THRESHOLD = 2.0 / FOCAL_PX


@dataclass(frozen=True)
class Pair:
    """Matched ideal coordinates of two photographs that look down from 60 m, and how the second stands."""

    first: np.ndarray
    second: np.ndarray
    rotation: np.ndarray
    base: np.ndarray
    points: np.ndarray


def flown(seed: int, *, base_m: float = 15.0, relief_m: float = 12.0, count: int = 300, noise: float = NOISE) -> Pair:
    """Two photographs, x₂ = R x₁ + t; without relief the ground is an exact, tilted plane."""
    rng = np.random.default_rng([seed, 3])
    R = Rotation.from_euler("zxy", rng.normal(0, [180, 5, 5]), degrees=True).as_matrix()
    centre = base_m * np.array([1.0, rng.normal(0, 0.1), rng.normal(0, 0.1)])
    tilt = rng.normal(0, 0.15, 2)
    points = np.zeros((0, 3))
    while len(points) < count:
        xy = rng.uniform(-0.6, 0.6, (4 * count, 2)) * 60.0
        X = np.column_stack([xy, 60.0 + xy @ tilt + relief_m * rng.uniform(-0.5, 0.5, len(xy))])
        Y = (X - centre) @ R.T
        points = X[
            (Y[:, 2] > 1) & (np.abs(Y[:, :2]) < 0.6 * Y[:, 2:]).all(1) & (np.abs(X[:, :2]) < 0.6 * X[:, 2:]).all(1)
        ]
    X = points[:count]
    Y = (X - centre) @ R.T
    a, b = X[:, :2] / X[:, 2:], Y[:, :2] / Y[:, 2:]
    return Pair(a + noise * rng.standard_normal(a.shape), b + noise * rng.standard_normal(b.shape), R, -R @ centre, X)


def with_mismatches(pair: Pair, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Match a share of the points with another one's; returns the second coordinates and which are wrong."""
    wrong = np.random.default_rng([seed, 4]).permutation(len(pair.second)) < round(share * len(pair.second))
    second = pair.second.copy()
    second[wrong] = np.roll(second[wrong], 1, axis=0)
    return second, wrong


def errors_deg(found: RelativeOrientation, pair: Pair) -> tuple[float, float]:
    """Errors of the rotation, and of the direction of the base."""
    turn = Rotation.from_matrix(found.rotation @ pair.rotation.T).magnitude()
    cosine = found.translation @ pair.base / np.linalg.norm(pair.base) / np.linalg.norm(found.translation)
    return float(np.rad2deg(turn)), float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))


def best_deg(found: list[RelativeOrientation], pair: Pair) -> tuple[float, float]:
    return min((errors_deg(f, pair) for f in found), key=sum)


@pytest.mark.parametrize("seed", range(10))
def test_the_motion_over_relief_comes_first(seed: int) -> None:
    pair = flown(seed)
    second, wrong = with_mismatches(pair, 0.3, seed)
    found = relative_orientations(pair.first, second, THRESHOLD)
    turn, direction = errors_deg(found[0], pair)
    assert turn < 0.3
    assert direction < 1.0
    assert np.linalg.norm(found[0].translation) == pytest.approx(1.0)
    assert np.linalg.det(found[0].rotation) == pytest.approx(1.0)
    assert found[0].inliers[~wrong].mean() > 0.95
    assert found[0].inliers[wrong].mean() < 0.1
    counts = [int(f.inliers.sum()) for f in found]
    assert counts == sorted(counts, reverse=True)


def test_without_noise_the_motion_is_exact() -> None:
    pair = flown(1, noise=0.0)
    turn, direction = errors_deg(relative_orientations(pair.first, pair.second, THRESHOLD)[0], pair)
    assert turn < 1e-3
    assert direction < 1e-2


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("seed", range(12))
def test_over_a_plane_the_true_motion_is_among_those_returned(seed: int, noise: float) -> None:
    pair = flown(seed, relief_m=0.0, noise=noise)
    second, _ = with_mismatches(pair, 0.2, seed)
    found = relative_orientations(pair.first, second, THRESHOLD)
    turn, direction = best_deg(found, pair)
    assert turn < 0.2
    assert direction < 0.6
    assert 2 <= len(found) <= 5, "a plane always leaves two motions"


@pytest.mark.parametrize("base_m", [5.0, 15.0, 30.0])
def test_the_ray_angle_is_that_of_the_scene(base_m: float) -> None:
    pair = flown(2, base_m=base_m)
    found = relative_orientations(pair.first, pair.second, THRESHOLD)[0]
    centre = -pair.rotation.T @ pair.base
    a, b = pair.points, pair.points - centre
    cosine = np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    assert found.ray_angle_rad == pytest.approx(float(np.median(np.arccos(cosine))), rel=0.05)


@pytest.mark.parametrize("relief_m", [0.0, 12.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_turn_on_the_spot_shows_in_tiny_ray_angles(seed: int, relief_m: float) -> None:
    pair = flown(seed, base_m=1e-6, relief_m=relief_m)
    for found in relative_orientations(pair.first, pair.second, THRESHOLD):
        assert found.ray_angle_rad < np.deg2rad(0.3)
        assert errors_deg(found, pair)[0] < 0.5


@pytest.mark.parametrize("seed", range(8))
def test_nothing_is_read_out_of_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(-0.6, 0.6, (2, 300, 2))
    # what agrees by chance is far from enough for a seed
    assert all(found.inliers.sum() < 20 for found in relative_orientations(first, second, THRESHOLD))


def test_too_few_or_unusable_matches_give_nothing() -> None:
    pair = flown(0)
    assert relative_orientations(pair.first[:7], pair.second[:7], THRESHOLD) == []
    assert relative_orientations(pair.first[:0], pair.second[:0], THRESHOLD) == []
    same = np.zeros((50, 2))
    assert all(found.ray_angle_rad < 1e-3 for found in relative_orientations(same, same, THRESHOLD))


def test_the_same_matches_give_the_same_motion() -> None:
    pair = flown(5)
    second, _ = with_mismatches(pair, 0.3, 5)
    one, other = (relative_orientations(pair.first, second, THRESHOLD) for _ in range(2))
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.rotation, b.rotation)
        np.testing.assert_array_equal(a.translation, b.translation)
        np.testing.assert_array_equal(a.inliers, b.inliers)
