"""The pictures of patterns and their derivatives, against the mean of many points and against differences."""

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.marking.targets.picture import (
    COUNT,
    RISE_U,
    RISE_V,
    Pattern,
    draw,
    level_shares,
    within,
)


def parameters(blur: float = 0.7) -> FloatArray:
    return np.array([20.3, 19.6, 0.08, 0.0, 0.0, 0.11, blur, 0.3, 90.0, 200.0, 30.0, 0.0, 0.0])


def lattice(size: int = 40) -> FloatArray:
    return np.stack(np.meshgrid(np.arange(float(size)), np.arange(float(size))), axis=-1).reshape(-1, 2)


def drawn(pattern: Pattern, theta: FloatArray, place: FloatArray) -> FloatArray:
    grey = np.empty(len(place))
    draw(int(pattern), theta, place, grey, np.empty((0, COUNT)))
    return grey


@pytest.mark.parametrize("pattern", list(Pattern), ids=lambda p: p.name.lower())
def test_derivatives_are_those_of_differences(pattern: Pattern) -> None:
    theta = parameters()
    theta[2:6] = 0.11, 0.02, -0.03, 0.09
    theta[RISE_U], theta[RISE_V] = 0.5, -0.3
    place, step = lattice(), 1e-6
    jacobian = np.empty((len(place), COUNT))
    draw(int(pattern), theta, place, np.empty(len(place)), jacobian)
    for index in range(COUNT):
        shift = np.zeros(COUNT)
        shift[index] = step
        numerical = (drawn(pattern, theta + shift, place) - drawn(pattern, theta - shift, place)) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:, index], numerical, atol=2e-6 * max(1.0, np.abs(numerical).max()))


def is_first(pattern: Pattern, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return 1 where a point shows the first level of a pattern of shape 0.3, 2 the second, 0 neither."""
    radius, same = np.hypot(x, y), x * y > 0
    square = np.maximum(np.abs(x), np.abs(y)) < 1
    bars = (np.abs(x) < 0.3) | (np.abs(y) < 0.3)
    arms = ((x > 0) & (x < 0.3) & (y > 0)) | ((y > 0) & (y < 0.3) & (x > 0))
    table = {
        Pattern.FIELDS: np.where(same, 1, 2),
        Pattern.DISC_OF_QUADRANTS: np.where(radius < 1, np.where(same, 1, 2), 0),
        Pattern.SQUARE_OF_QUADRANTS: np.where(square, np.where(same, 1, 2), 0),
        Pattern.CIRCLE: np.where(radius < 1, 1, 0),
        Pattern.RING: np.where(radius < 0.3, 2, np.where(radius < 1, 1, 0)),
        Pattern.CROSS: np.where(bars & square, 1, 0),
        Pattern.OPEN_CROSS: np.where((np.abs(x) < 1) | (np.abs(y) < 1), 1, 0),
        Pattern.CORNER: np.where(arms & square, 1, 0),
        Pattern.CROSSED_SQUARE: np.where(square, np.where(bars, 1, 2), 0),
        Pattern.OPEN_CORNER: np.where(((x > 0) & (x < 1) & (y > 0)) | ((y > 0) & (y < 1) & (x > 0)), 1, 0),
    }
    return np.asarray(table[pattern], np.float64)


@pytest.mark.parametrize("pattern", list(Pattern), ids=lambda p: p.name.lower())
@pytest.mark.parametrize("lean", [0.0, 0.05], ids=["upright", "leaning"])
def test_a_picture_is_the_mean_of_many_points_under_its_blur(pattern: Pattern, lean: float) -> None:
    theta, place = parameters(), lattice()
    theta[3] = lean
    step = np.arange(-31, 32) / 9.0
    du, dv = np.meshgrid(step, step)
    weight = np.exp(-0.5 * (du**2 + dv**2) / 0.7**2).ravel()
    q = (place[:, None] + np.column_stack([du.ravel(), dv.ravel()]) - theta[:2]) @ theta[2:6].reshape(2, 2).T
    level = np.array([90.0, 200.0, 30.0])[is_first(pattern, q[..., 0], q[..., 1]).astype(int)]
    truth = level @ weight / weight.sum()
    error = np.abs(drawn(pattern, theta, place) - truth)
    if pattern == Pattern.RING:  # a circle of three pixels has edges that are no lines
        error = error[np.hypot(*(place - theta[:2]).T) > 6.0]
    if pattern not in (Pattern.RING, Pattern.CIRCLE, Pattern.DISC_OF_QUADRANTS):  # where edges are lines
        assert float(error.max()) < 5.0  # points 1/9 px apart
    assert float(np.quantile(error, 0.98)) < 4.0
    assert float(error.max()) < 14.0


def test_shares_add_to_one() -> None:
    for pattern in Pattern:
        np.testing.assert_allclose(sum(level_shares(pattern, parameters(), lattice())), 1.0, atol=1e-12)


def test_pixels_of_a_circle_lie_in_it_or_beside_it() -> None:
    theta, place = parameters(), lattice()
    inside = within(int(Pattern.CIRCLE), theta, place, 0.0, 1.0)
    np.testing.assert_array_equal(inside, np.hypot(*((place - theta[:2]) * [0.08, 0.11]).T) <= 1.0)
    wider = within(int(Pattern.CIRCLE), theta, place, 2.0, 1.0)
    assert inside.sum() < wider.sum()
    assert (wider >= inside).all()
