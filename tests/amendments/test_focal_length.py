"""A focal length by its source and by the photographs together: exact limits, and what parts of pictures say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.amendments.focal_length import (
    SHARED,
    WRONG_BY,
    model_sigma_px,
    picture_parts,
    settled,
    without_prior,
)
from photogram.results import PhotographsSay
from photogram.survey import TiePoints

GIVEN, SIGMA = 1000.0, 30.0


@given(st.floats(500.0, 1500.0), st.floats(0.1, 500.0), st.floats(500.0, 1500.0), st.floats(1.0, 500.0))
def test_taking_a_prior_out_undoes_putting_it_in(value: float, sigma: float, prior: float, prior_sigma: float) -> None:
    weight, prior_weight = sigma**-2, prior_sigma**-2
    together = (weight * value + prior_weight * prior) / (weight + prior_weight)
    found = without_prior(together, (weight + prior_weight) ** -0.5, prior, prior_sigma)
    assert found == pytest.approx((value, sigma), rel=1e-3)


def test_what_the_prior_alone_determines_is_not_known_without_it() -> None:
    assert without_prior(GIVEN, SIGMA, GIVEN, SIGMA) == (GIVEN, float("inf"))


def test_source_and_photographs_that_agree_are_weighted_by_their_precision() -> None:
    found = settled([GIVEN], SIGMA, PhotographsSay(1010.0, 30.0, 0.0))
    assert found.focal_px == pytest.approx(1005.0, abs=0.5)
    assert found.sigma_px == pytest.approx(30.0 / np.sqrt(2.0), rel=0.05)
    assert found.rejected < 0.05


@pytest.mark.parametrize("off", [-0.2, -0.15, -0.1, 0.12, 0.2])
def test_a_source_far_from_sure_photographs_is_rejected(off: float) -> None:
    wanted = GIVEN * (1.0 + off)
    found = settled([GIVEN], 0.03 * GIVEN, PhotographsSay(wanted, 1.0, 0.0))
    assert found.focal_px == pytest.approx(wanted, abs=0.5)
    assert found.sigma_px == pytest.approx(1.0, rel=0.05)
    assert found.rejected > 0.7


def test_another_reading_of_the_source_is_taken_where_the_photographs_want_it() -> None:
    """5 % off by the reading in use, on the spot by the other: nothing is wrong with the source."""
    say = PhotographsSay(950.0, 5.0, 0.0)
    assert settled([GIVEN], 10.0, say).rejected > 0.9
    assert settled([GIVEN, 950.0], 10.0, say).rejected < 0.02


def test_photographs_that_hardly_know_leave_the_source_and_its_tail() -> None:
    found = settled([GIVEN], SIGMA, PhotographsSay(1600.0, 5.0, 600.0))
    assert abs(found.focal_px - GIVEN) < 2.0 * SIGMA
    assert SIGMA < found.sigma_px < 3.0 * SIGMA


def test_control_points_move_the_balance() -> None:
    say = PhotographsSay(1150.0, 5.0, 60.0)
    values = [settled([GIVEN], SIGMA, say, evidence).focal_px for evidence in (-20.0, 0.0, 20.0)]
    assert values == sorted(values)
    assert values[2] - values[0] > 40.0


def test_sigma_covers_source_and_photographs_where_neither_is_more_likely() -> None:
    """Where the components weigh the same, the spread between them is in the sigma."""
    for wanted in np.linspace(1000.0, 1500.0, 51):
        found = settled([GIVEN], SIGMA, PhotographsSay(float(wanted), 5.0, 120.0))
        assert min(abs(found.focal_px - GIVEN), abs(found.focal_px - wanted)) < 2.5 * found.sigma_px


def test_parts_that_scatter_as_predicted_show_no_error_of_the_model() -> None:
    """Independent halves of the information: differences to the whole have the difference of the variances."""
    rng, whole_sigma = np.random.default_rng(1), 5.0
    sigmas = np.full(6, whole_sigma * np.sqrt(2.0))
    draws = [model_sigma_px(0.0, whole_sigma, whole_sigma * rng.standard_normal(6), sigmas) for _ in range(1000)]
    assert np.mean(np.array(draws) > 0.0) < 0.05


def test_parts_that_scatter_more_show_by_how_much() -> None:
    rng = np.random.default_rng(2)
    draws = [model_sigma_px(0.0, 5.0, 100.0 * rng.standard_normal(6), np.full(6, 8.0)) for _ in range(400)]
    assert np.sqrt(np.mean(np.square(draws))) == pytest.approx(SHARED * 100.0, rel=0.1)
    assert np.isinf(model_sigma_px(0.0, 5.0, np.zeros(2), np.ones(2)))


def test_parts_cover_the_picture_and_leave_other_cameras_alone() -> None:
    rng = np.random.default_rng(3)
    n, width, height = 4000, 1200, 900
    pixel = rng.uniform([0, 0], [width - 1, height - 1], (n, 2))
    point = np.arange(n, dtype=np.int64)
    ties = TiePoints(
        np.zeros(n, np.int64), point, point, pixel, np.ones(n), np.zeros((n, 3)), np.zeros((n, 3), np.uint8)
    )
    own = np.ones(n, dtype=bool)
    own[:500] = False
    parts = list(picture_parts(ties, own, width, height))
    assert len(parts) == 6
    for keep in parts:
        assert keep[~own].all()
        assert keep[own].mean() == pytest.approx(0.6, abs=0.03)
    assert np.all(np.sum(parts, axis=0) >= 3), "three pairs, each of which covers the whole picture"
    assert WRONG_BY > 0.15, "tags are off by 5 to 20 %"
