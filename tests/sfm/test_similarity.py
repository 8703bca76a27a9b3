"""Similarity transforms: exact round trips, a numerical optimiser as referee, and wrong positions among right ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, Similarity, project_points
from photogram.errors import OrientationError
from photogram.measures.collinearity import collinear
from photogram.sfm.similarity import (
    fit_similarity,
    open_turn_rad,
    robust_similarity,
    similarity_from_attitudes,
)


def random_similarity(seed: int) -> Similarity:
    rng = np.random.default_rng([seed, 7])
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(float(np.exp(rng.uniform(-5, 5))), rotation, rng.uniform(-1e4, 1e4, 3))


def assert_same(found: Similarity, expected: Similarity, source: np.ndarray, tolerance: float = 1e-9) -> None:
    """Compare by what they do to points: relative to the extent of the result."""
    wanted = expected.points(source)
    extent = np.linalg.norm(np.ptp(wanted, axis=0))
    assert np.abs(found.points(source) - wanted).max() < tolerance * extent
    assert found.scale == pytest.approx(expected.scale, rel=tolerance)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=tolerance)


def turn_deg(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.rad2deg(Rotation.from_matrix(first.T @ second).magnitude()))


@given(
    seed=st.integers(0, 10_000),
    count=st.integers(3, 40),
    flatness=st.sampled_from([0.0, 0.01, 1.0]),
)
def test_a_similarity_is_found_again(seed: int, count: int, flatness: float) -> None:
    rng = np.random.default_rng(seed)
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    source = np.vstack([corners, rng.uniform(-1, 1, (count - 3, 3)) * [1, 1, flatness]]) + rng.uniform(-5, 5, 3)
    truth = random_similarity(seed)
    found = fit_similarity(source, truth.points(source))
    assert_same(found, truth, source)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@given(seed=st.integers(0, 10_000))
def test_projections_do_not_change_under_a_similarity(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = Camera("c", 1000, 800, 900.0, np.array([500.0, 400.0]), np.array([-0.1, 0.02, 0.0, 0.0]))
    pose = Pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-10, 10, 3))
    points = pose.world_from_camera(np.column_stack([rng.uniform(-1, 1, (10, 2)), rng.uniform(3, 9, 10)]))
    moved = random_similarity(seed)
    np.testing.assert_allclose(
        project_points(camera, moved.pose(pose), moved.points(points)), project_points(camera, pose, points), atol=1e-5
    )


def test_weights_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    source, truth = rng.uniform(-10, 10, (12, 3)), random_similarity(4)
    target = truth.points(source) / truth.scale + rng.standard_normal((12, 3))
    weight = np.exp(rng.uniform(-3, 3, 12))
    found = fit_similarity(source, target, weight)

    def residual(x: np.ndarray) -> np.ndarray:
        moved = np.exp(x[0]) * source @ Rotation.from_rotvec(x[1:4]).as_matrix().T + x[4:]
        return np.asarray(((moved - target) * np.sqrt(weight)[:, None]).ravel())

    start = np.concatenate([[0.0], Rotation.from_matrix(truth.rotation).as_rotvec(), truth.translation / truth.scale])
    best = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    assert found.scale == pytest.approx(np.exp(best[0]), abs=1e-6)
    assert turn_deg(found.rotation, Rotation.from_rotvec(best[1:4]).as_matrix()) < 1e-4
    np.testing.assert_allclose(found.translation, best[4:], atol=1e-4)
    assert not np.allclose(found.translation, fit_similarity(source, target).translation, atol=0.01)


def test_a_mirrored_shape_is_turned_never_mirrored() -> None:
    source = np.random.default_rng(0).uniform(-1, 1, (10, 3))
    found = fit_similarity(source, source * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    assert np.linalg.norm(found.points(source) - source * [1, 1, -1], axis=1).max() > 0.1


LINE = np.array([0.0, 1.0, 2.5, 4.0, 7.0])[:, None] * [3.0, -2.0, 0.5]


def test_points_in_one_line_are_refused() -> None:
    beside = LINE.copy()
    beside[2] += [2.0, 3.0, 0.0]
    for source, target in ((LINE, LINE), (beside, LINE), (LINE, beside), (beside[:2], beside[:2])):
        with pytest.raises(OrientationError, match="collinear"):
            fit_similarity(source, target)
    fit_similarity(beside, beside)
    assert collinear(LINE + 0.01 * np.random.default_rng(0).standard_normal((5, 3)))
    assert collinear(np.zeros((0, 3)))
    assert not collinear(beside)


def flown(seed: int, rows: int = 4, columns: int = 6) -> np.ndarray:
    """Projection centres of a block, in metres: strips of 12 m base, 20 m apart."""
    rng = np.random.default_rng([seed, 1])
    x, y = np.meshgrid(20.0 * np.arange(rows), 12.0 * np.arange(columns), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 60.0)]) + rng.standard_normal((x.size, 3))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("seed", range(4))
def test_wrong_positions_are_left_out(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    target, truth = flown(seed), random_similarity(seed)
    source = (target - truth.translation) @ truth.rotation / truth.scale
    wrong = rng.permutation(len(target)) < round(share * len(target))
    measured = target + 0.05 * rng.standard_normal(target.shape)
    direction = rng.standard_normal((int(wrong.sum()), 3))
    measured[wrong] += direction / np.linalg.norm(direction, axis=1)[:, None] * rng.uniform(3, 200, (len(direction), 1))
    found, agrees = robust_similarity(source, measured, np.full(len(target), 0.05 * np.sqrt(3)), seed=seed)
    np.testing.assert_array_equal(agrees, ~wrong)
    assert np.linalg.norm(found.points(source) - target, axis=1).max() < 0.15
    assert turn_deg(found.rotation, truth.rotation) < 0.1


def test_a_position_weighs_what_it_is_known_to() -> None:
    rng = np.random.default_rng(0)
    target = flown(0)
    sigma = np.where(np.arange(len(target)) < 6, 0.01, 3.0)
    measured = target + sigma[:, None] * rng.standard_normal(target.shape)
    found, agrees = robust_similarity(target, measured, sigma * np.sqrt(3))
    error = np.linalg.norm(found.points(target) - target, axis=1)
    plain = np.linalg.norm(fit_similarity(target, measured).points(target) - target, axis=1)
    assert agrees.all()
    assert error[:6].max() < 0.03
    assert plain[:6].max() > 0.3


def test_the_same_positions_give_the_same_similarity() -> None:
    rng = np.random.default_rng(2)
    target = flown(2)
    measured = target + rng.standard_normal(target.shape)
    first, second = (robust_similarity(target, measured, np.full(len(target), 2.0)) for _ in range(2))
    np.testing.assert_array_equal(first[0].rotation, second[0].rotation)
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("seed", range(6))
def test_positions_of_other_photographs_agree_with_nothing(seed: int) -> None:
    """A similarity that shrinks the block to a point would agree with all that lie within a few sigmas of it."""
    target = flown(seed)
    measured = np.random.default_rng(seed).permutation(target + np.random.default_rng(seed).normal(0, 2, target.shape))
    with pytest.raises(OrientationError, match="belong to these photographs"):
        robust_similarity(target, measured, np.full(len(target), 4.0))


def test_robust_similarity_needs_three_positions_not_in_one_line() -> None:
    one = np.ones(5)
    for count in (0, 2, 5):
        with pytest.raises(OrientationError, match="collinear"):
            robust_similarity(LINE[:count], LINE[:count], one[:count])
    scattered = 100.0 * np.random.default_rng(1).standard_normal((4, 3))
    with pytest.raises(OrientationError, match="no three of 4 positions"):
        robust_similarity(scattered, scattered[[1, 0, 3, 2]] * [5, 1, 1] + [0, 0, 9], np.full(4, 1e-3))


# ---- attitudes -------------------------------------------------------------------------------------------------------


def measured_block(seed: int, count: int) -> tuple[Similarity, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A block in a frame of its own, and the positions and rotations of its photographs in the world."""
    rng = np.random.default_rng([seed, 5])
    truth, target = random_similarity(seed), flown(seed)[:count]
    attitude = Rotation.random(count, random_state=rng).as_matrix()
    source = (target - truth.translation) @ truth.rotation / truth.scale
    return truth, source, truth.rotation.T @ attitude, target, attitude


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("seed", range(3))
def test_two_positions_and_attitudes_are_enough(seed: int, count: int) -> None:
    truth, source, own, target, attitude = measured_block(seed, count)
    assert_same(similarity_from_attitudes(source, own, target, attitude), truth, source, 1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_attitude_and_a_wrong_position_do_not_turn_the_block(seed: int) -> None:
    truth, source, own, target, attitude = measured_block(seed, 6)
    rng = np.random.default_rng(seed)
    attitude = attitude @ Rotation.from_rotvec(np.deg2rad(0.5) * rng.standard_normal((6, 3))).as_matrix()
    attitude[seed] = attitude[seed] @ Rotation.from_euler("z", 120, degrees=True).as_matrix()
    target = target + 0.02 * rng.standard_normal(target.shape)
    target[(seed + 2) % 6] += [70.0, -30.0, 20.0]
    found = similarity_from_attitudes(source, own, target, attitude)
    assert turn_deg(found.rotation, truth.rotation) < 1.5
    assert found.scale == pytest.approx(truth.scale, rel=0.1)
    assert np.median(np.linalg.norm(found.points(source) - target, axis=1)) < 6.0


def test_photographs_in_one_place_have_no_scale() -> None:
    _, source, own, target, attitude = measured_block(0, 3)
    with pytest.raises(OrientationError, match="one place"):
        similarity_from_attitudes(0 * source, own, target, attitude)


# ---- what positions leave open ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("wobble_m", [1.0, 4.0])
def test_the_open_turn_is_as_large_as_fits_to_noisy_positions_scatter(wobble_m: float) -> None:
    rng = np.random.default_rng(8)
    along = np.array([1.0, 0.0, 0.0])
    source = 12.0 * np.arange(10.0)[:, None] * along + wobble_m * rng.standard_normal((10, 3))
    sigma = 0.1 * wobble_m
    turns, predicted = [], []
    for _ in range(300):
        target = source + sigma * rng.standard_normal(source.shape)
        predicted.append(open_turn_rad(source, target, np.full(10, sigma * np.sqrt(3))))
        turns.append(Rotation.from_matrix(fit_similarity(source, target).rotation).as_rotvec() @ along)
    assert np.std(turns) == pytest.approx(np.median(predicted), rel=0.15)


def test_noise_across_a_line_does_not_hold_the_turn_about_it() -> None:
    line = 12.0 * np.arange(10.0)[:, None] * [1.0, 0.0, 0.0]
    rng = np.random.default_rng(0)
    source, sigma = line + 0.6 * rng.standard_normal(line.shape), np.full(10, 2.0)
    assert open_turn_rad(source, source + 2.0 * rng.standard_normal(line.shape), sigma) > 0.4
    assert open_turn_rad(line, line + 2.0 * rng.standard_normal(line.shape), sigma) == np.inf
    assert open_turn_rad(flown(0), flown(0), np.full(24, 2.0)) < 0.02
