"""Fits of patterns, and their covariances against the scatter of repeated noise."""

import cv2
import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.marking.targets.fitting import MODEL_ERROR, centre_covariance, fit, pixels
from photogram.marking.targets.picture import COUNT, Pattern, draw


def parameters() -> FloatArray:
    return np.array([20.3, 19.6, 0.11, 0.02, -0.03, 0.09, 0.8, 0.3, 90.0, 200.0, 30.0, 0.4, -0.3])


def drawn(pattern: Pattern, theta: FloatArray) -> FloatArray:
    place = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
    grey = np.empty(len(place))
    draw(int(pattern), theta, place, grey, np.empty((0, COUNT)))
    return grey.reshape(40, 40)


CLOSED = [p for p in Pattern if p not in (Pattern.OPEN_CROSS, Pattern.OPEN_CORNER)]


@pytest.mark.parametrize("pattern", CLOSED, ids=lambda p: p.name.lower())
def test_a_picture_without_noise_is_found_again(pattern: Pattern) -> None:
    theta = parameters()
    start = theta.copy()
    start[:7] += [0.8, -0.7, 0.006, -0.005, 0.004, 0.006, 0.3]
    start[8:11] += [20.0, -30.0, 10.0]
    found = fit(drawn(pattern, theta), pattern, start)
    assert found is not None
    np.testing.assert_allclose(found.theta[:2], theta[:2], atol=1e-3)
    assert found.explained > 0.9999


@pytest.mark.parametrize("smoothing", [0.0, 0.8], ids=["white", "correlated"])
def test_covariances_are_the_scatter_of_centres(smoothing: float) -> None:
    rng = np.random.default_rng(3)
    theta, pattern = parameters(), Pattern.DISC_OF_QUADRANTS
    clean, errors, stated = drawn(pattern, theta), [], []
    for _ in range(150):
        noise = rng.normal(size=clean.shape)
        noise = cv2.GaussianBlur(noise, (0, 0), smoothing) if smoothing else noise
        found = fit(clean + 4.0 * noise / noise.std(), pattern, theta)
        assert found is not None
        errors.append(found.theta[:2] - theta[:2])
        stated.append(found.covariance_px2 / MODEL_ERROR[pattern] ** 2)
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(np.sqrt(np.mean(stated, axis=0).diagonal()), scatter, rtol=0.25)


def test_correlated_noise_makes_the_covariance_larger() -> None:
    rng = np.random.default_rng(4)
    place = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2)
    jacobian = np.column_stack([np.ones(400), np.linspace(-1.0, 1.0, 400)])
    white = rng.normal(size=(20, 20))
    rough = cv2.GaussianBlur(white, (0, 0), 1.2)
    alone, together = (
        centre_covariance(place, jacobian, 3.0 * field.ravel() / field.std(), np.ones(400), np.zeros(400))
        for field in (white, rough)
    )
    assert together[0, 0] > 3.0 * alone[0, 0]


def test_a_pattern_beyond_the_patch_has_no_pixels_and_no_fit() -> None:
    theta = parameters()
    theta[0] = 120.0
    assert pixels(Pattern.CIRCLE, theta, (40, 40), 1.0) is None
    assert fit(np.zeros((40, 40)), Pattern.CIRCLE, theta) is None


def test_fields_keep_their_size_and_end_before_their_neighbours() -> None:
    """A board of fields 6 px wide: a fit that starts on twice the fields is the corner's, to noise."""
    rng = np.random.default_rng(7)
    v, u = np.mgrid[:400, :400] / 10.0
    fine = np.where((np.floor((u - 20.3) / 6.0) + np.floor((v - 19.6) / 6.0)) % 2 == 0, 200.0, 40.0)
    grey = cv2.GaussianBlur(fine, (0, 0), 7.0).reshape(40, 10, 40, 10).mean(axis=(1, 3)) + rng.normal(0, 3, (40, 40))
    start = parameters()
    start[:6] = 20.3, 19.6, 1.0 / 11.0, 0.0, 0.0, 1.0 / 11.0
    found = fit(grey, Pattern.FIELDS, start)
    assert found is not None
    assert found.explained > 0.98
    np.testing.assert_allclose(found.theta[:2] + 0.45, [20.3, 19.6], atol=0.05)


def test_rough_ground_counts_less_where_it_is_not_the_target() -> None:
    """Stones beside a checker disc leave squares that no picture of it explains."""
    theta, pattern = parameters(), Pattern.DISC_OF_QUADRANTS
    theta[2:6] = 0.13, 0.0, 0.0, 0.13
    rng = np.random.default_rng(5)
    stones = cv2.GaussianBlur(rng.normal(size=(40, 40)), (0, 0), 1.5)
    v, u = np.mgrid[:40, :40]
    beside = np.hypot(u - theta[0], v - theta[1]) > 9.0
    grey = drawn(pattern, theta) + rng.normal(0, 2, (40, 40)) + np.where(beside, 40.0 * stones / stones.std(), 0.0)
    found = fit(grey, pattern, theta)
    assert found is not None
    assert found.explained < found.explained_at_best - 0.02
    assert found.explained_at_best > 0.97
    np.testing.assert_allclose(found.theta[:2], theta[:2], atol=0.15)
