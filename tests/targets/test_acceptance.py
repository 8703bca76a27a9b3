"""What is taken for a target, and what is refused: likenesses that lack a part."""

from __future__ import annotations

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.targets.acceptance import axes_px, evidence, is_target
from photogram.targets.fitting import Fit, fit
from photogram.targets.picture import COUNT, Pattern, draw


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
]


@pytest.mark.parametrize("pattern", KINDS, ids=lambda p: p.name.lower())
def test_a_whole_target_is_taken_and_one_that_lacks_a_part_is_not(pattern: Pattern) -> None:
    grey, theta = picture(pattern)
    assert is_target(fitted(grey, pattern, theta))
    grey[25:40, 26:40] = 90.0
    found = fit(grey, pattern, theta)
    assert found is None or not is_target(found)


def test_evidence_states_sizes_and_contrast() -> None:
    grey, theta = picture(Pattern.CIRCLE)
    found = fitted(grey, Pattern.CIRCLE, theta)
    own = evidence(found)
    assert axes_px(found) == pytest.approx((20.0, 20.0), abs=0.2)
    assert own.contrast_dn == pytest.approx(110.0, abs=2.0)
    assert own.contrast_over_noise == pytest.approx(110.0 / 3.0, rel=0.2)
    assert own.weakest_sector > 0.95


def test_a_faint_target_is_refused() -> None:
    grey, theta = picture(Pattern.CIRCLE)
    grey = 90.0 + 0.1 * (grey - 90.0)
    assert not is_target(fitted(grey, Pattern.CIRCLE, theta))
