"""The levels that are fitted to a patch under rough parameters, and the squares that remain."""

import numpy as np

from photogram.arrays import FloatArray
from photogram.marking.targets.picture import COUNT, FREE, OUTSIDE, RISE_U, SECOND, Pattern, draw, within
from photogram.marking.targets.scoring import score, score_all


def parameters() -> FloatArray:
    return np.array([20.3, 19.6, 0.08, 0.0, 0.0, 0.11, 0.7, 0.3, 90.0, 200.0, 30.0, 0.0, 0.0])


def drawn(pattern: Pattern) -> FloatArray:
    place = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
    grey = np.empty(len(place))
    draw(int(pattern), parameters(), place, grey, np.empty((0, COUNT)))
    return grey.reshape(40, 40)


def test_levels_are_found_again() -> None:
    place = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
    for pattern in Pattern:
        levels = FREE[pattern][(FREE[pattern] >= OUTSIDE) & (FREE[pattern] <= SECOND)]
        theta = parameters()
        theta[OUTSIDE:] = 0.0
        n, left, total = score(int(pattern), theta, levels, drawn(pattern), np.array([0, 0, 39, 39]), 1, 3.0, 1.0)
        assert n == within(int(pattern), theta, place, 3.0, 1.0).sum()
        assert left < 1e-4 * total
        np.testing.assert_allclose(theta[levels], parameters()[levels], atol=0.01)


def test_a_place_that_is_off_leaves_more_squares_and_one_beyond_the_patch_is_not_judged() -> None:
    pattern = Pattern.CROSSED_SQUARE
    levels = FREE[pattern][(FREE[pattern] >= OUTSIDE) & (FREE[pattern] < RISE_U)]
    thetas = np.tile(parameters(), (3, 1))
    thetas[1, 0] += 2.0
    thetas[2, 0] += 300.0
    verdict = np.ones((3, 3))
    score_all(int(pattern), thetas, levels, drawn(pattern), 1.0, verdict)
    assert verdict[0, 1] < 0.01 * verdict[0, 2]
    assert verdict[1, 1] > 0.2 * verdict[1, 2]
    assert (verdict[2] == 0.0).all()
