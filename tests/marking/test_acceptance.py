"""What is taken for a target, and what is refused: likenesses that lack a part."""

import cv2
import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.marking.targets.acceptance import axes_px, evidence, ground, is_target
from photogram.marking.targets.fitting import Fit, fit
from photogram.marking.targets.picture import COUNT, Pattern, draw


def picture(pattern: Pattern) -> tuple[FloatArray, FloatArray]:
    theta = np.array([25.3, 24.6, 0.1, 0.0, 0.0, 0.1, 0.8, 0.25, 90.0, 200.0, 30.0, 0.0, 0.0])
    place = np.stack(np.meshgrid(np.arange(50.0), np.arange(50.0)), axis=-1).reshape(-1, 2)
    grey = np.empty(len(place))
    draw(int(pattern), theta, place, grey, np.empty((0, COUNT)))
    return grey.reshape(50, 50) + np.random.default_rng(1).normal(0, 3, (50, 50)), theta


def fitted(grey: FloatArray, pattern: Pattern, theta: FloatArray) -> Fit:
    found = fit(grey, pattern, theta)
    assert found is not None
    return found


KINDS = [
    Pattern.DISC_OF_QUADRANTS,
    Pattern.SQUARE_OF_QUADRANTS,
    Pattern.CIRCLE,
    Pattern.RING,
    Pattern.CROSS,
    Pattern.CORNER,
    Pattern.CROSSED_SQUARE,
]


@pytest.mark.parametrize("pattern", KINDS, ids=lambda p: p.name.lower())
def test_a_whole_target_is_taken_and_one_that_lacks_a_part_is_not(pattern: Pattern) -> None:
    grey, theta = picture(pattern)
    assert is_target(fitted(grey, pattern, theta), ground(grey))
    grey[25:40, 26:40] = 90.0
    found = fit(grey, pattern, theta)
    assert found is None or not is_target(found, ground(grey))


def test_evidence_states_sizes_and_contrast() -> None:
    grey, theta = picture(Pattern.CIRCLE)
    found = fitted(grey, Pattern.CIRCLE, theta)
    own = evidence(found, ground(grey))
    assert axes_px(found) == pytest.approx((20.0, 20.0), abs=0.2)
    assert own.contrast_dn == pytest.approx(110.0, abs=2.0)
    assert own.contrast_over_noise == pytest.approx(110.0 / 3.0, rel=0.2)
    assert own.weakest_sector > 0.95
    assert own.explained > 0.98
    assert own.contrast_over_strongest_blob <= own.contrast_over_blobs
    assert own.sigma_px == pytest.approx(float(np.sqrt(found.covariance_px2[0, 0])), rel=0.3)


def test_a_faint_target_is_refused() -> None:
    grey, theta = picture(Pattern.CIRCLE)
    grey = 90.0 + 0.1 * (grey - 90.0)
    assert not is_target(fitted(grey, Pattern.CIRCLE, theta), ground(grey))


def test_a_stone_among_stones_is_no_target_and_a_kerb_speaks_against_none() -> None:
    grey, theta = picture(Pattern.CIRCLE)
    fit_alone = fitted(grey, Pattern.CIRCLE, theta)
    kerb, stones = grey.copy(), grey.copy()
    kerb[:, :8] += 110.0
    v, u = np.mgrid[:50, :50]
    for x, y in ((6, 6), (6, 24), (6, 43), (25, 5), (25, 45), (43, 6), (44, 25), (43, 43), (15, 42), (34, 7)):
        stones[np.hypot(u - x, v - y) < 4] += 90.0
    assert is_target(fit_alone, ground(grey))
    assert is_target(fitted(kerb, Pattern.CIRCLE, theta), ground(kerb))
    among = fitted(stones, Pattern.CIRCLE, theta)
    assert evidence(among, ground(stones)).contrast_over_blobs < 0.4 * evidence(among, ground(kerb)).contrast_over_blobs
    assert not is_target(among, ground(stones))


def test_more_is_asked_of_a_target_that_nobody_expects() -> None:
    """Of small circles on ground that is more and more rough, some are taken only where someone has said so."""
    theta = np.array([25.3, 24.6, 0.28, 0.0, 0.0, 0.28, 1.4, 0.25, 90.0, 160.0, 30.0, 0.0, 0.0])
    place = np.stack(np.meshgrid(np.arange(50.0), np.arange(50.0)), axis=-1).reshape(-1, 2)
    clean = np.empty(len(place))
    draw(int(Pattern.CIRCLE), theta, place, clean, np.empty((0, COUNT)))
    rough = cv2.GaussianBlur(np.random.default_rng(8).normal(size=(50, 50)), (0, 0), 1.5)
    verdicts = []
    for noise in np.arange(1.0, 12.0, 0.25):
        grey = clean.reshape(50, 50) + noise * rough / rough.std()
        found = fit(grey, Pattern.CIRCLE, theta)
        if found is not None:
            verdicts.append((is_target(found, ground(grey)), is_target(found, ground(grey), is_expected=False)))
    assert {(True, True), (True, False), (False, False)} == set(verdicts)


def test_a_target_whose_centre_lies_at_the_edge_is_refused() -> None:
    grey, theta = picture(Pattern.DISC_OF_QUADRANTS)
    for cut, is_whole in ((0, True), (14, True), (23, False)):
        start = theta - np.array([cut, *np.zeros(12)])
        part = np.ascontiguousarray(grey[:, cut:])
        found = fit(part, Pattern.DISC_OF_QUADRANTS, start)
        assert (found is not None and is_target(found, ground(part))) == is_whole


def test_a_board_is_no_ground_of_its_own_fields() -> None:
    """The fields around the four that are fitted are blobs, but not of the ground."""
    v, u = np.mgrid[:60, :60] - 30.3
    board = np.where((np.floor(u / 8.0) + np.floor(v / 8.0)) % 2 == 0, 200.0, 40.0)
    inside = np.maximum(abs(u), abs(v)) < 16.0
    grey = cv2.GaussianBlur(np.where(inside, board, 90.0), (0, 0), 1.0)
    grey = grey + np.random.default_rng(9).normal(0, 3, grey.shape)
    theta = np.array([30.3, 30.3, 0.13, 0.0, 0.0, 0.13, 1.0, 0.5, 0.0, 200.0, 40.0, 0.0, 0.0])
    found = fitted(grey, Pattern.FIELDS, theta)
    assert evidence(found, ground(grey)).contrast_over_blobs > 30.0
    assert is_target(found, ground(grey))
