"""Whether GNSS positions of a flight are off together: tests of offsets that are estimated or held, against truth and
against each other. Surveys are simulated."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.gnss_offsets import estimated_offset_test, implied_offset_test, implied_offsets
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.factors.covariance import covariances
from photogram.report.numbers.gnss import gnss_numbers
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block

SETTINGS = AdjustmentSettings(robust_loss="none")
PLAN = SurveyPlan(
    strips=3, photographs_per_strip=4, control_points=8, check_points=2, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    calibration_sigmas=(0.0,) * 11,
)  # fmt: skip


def gnss_of(adjusted: Adjustment) -> Any:
    """The GNSS part of the report, as one reads it from the file."""
    return gnss_numbers(adjusted)


def shifted(block: Block, by_m: FloatArray, flight: str = "1") -> Block:
    """The block with the positions of a flight moved."""
    photographs = tuple(
        replace(p, gnss_world_m=p.gnss_world_m + by_m) if p.flight == flight and p.gnss_world_m is not None else p
        for p in block.photographs
    )
    return replace(block, photographs=photographs)


@pytest.fixture(scope="module")
def block() -> Block:
    return simulate_block(PLAN, 5, tie_points=300).block


def along_map(result: Adjustment) -> tuple[FloatArray, FloatArray]:
    axes = result.block.frame.rotation_world_from_map(np.zeros(3))
    return axes.T @ result.estimates.offset_world_m[0], axes.T @ result.covariances.offset_m2[0] @ axes


# ---- the statistics --------------------------------------------------------------------------------------------------


def test_without_an_offset_p_is_uniform() -> None:
    """A linear model by hand: measurements of the offset with covariance D, a prior P, truth zero."""
    rng = np.random.default_rng(11)
    B = rng.normal(0, 1, (3, 3))
    D, prior = B @ B.T * 0.01 + 0.001 * np.eye(3), np.array([0.1, 0.2, 0.3])
    Q = np.linalg.inv(np.linalg.inv(D) + np.diag(prior**-2.0))
    d = rng.multivariate_normal(np.zeros(3), D, 2000)
    tests = [estimated_offset_test(Q @ np.linalg.solve(D, x), Q, prior) for x in d]
    assert {t.degrees for t in tests} == {3}
    assert kstest([t.p for t in tests], "uniform").pvalue > 0.01
    for axis in range(3):
        assert kstest([t.p_axes[axis] for t in tests], "uniform").pvalue > 0.01
    # the prior takes no part in the statistic
    statistic = [float(x @ np.linalg.solve(D, x)) for x in d]
    np.testing.assert_allclose([t.chi2 for t in tests], statistic, rtol=1e-6)


def test_a_direction_that_only_the_prior_knows_is_not_tested() -> None:
    prior = np.array([0.1, 0.1, 10.0])
    Q = np.diag([0.02, 0.02, 10.0]) ** 2
    found = estimated_offset_test(np.array([0.09, 0.0, 0.0]), Q, prior)
    assert found.degrees == 2
    assert found.significant
    assert np.isnan(found.p_axes[2])
    nothing = estimated_offset_test(np.zeros(3), np.diag(prior**2), prior)
    assert (nothing.degrees, nothing.significant) == (0, False)
    assert not implied_offset_test(np.full(3, np.nan), np.full((3, 3), np.nan)).significant


# ---- the adjustment --------------------------------------------------------------------------------------------------


def test_an_offset_held_at_zero_is_implied_as_one_set_free_would_be(block: Block) -> None:
    """The score test takes one step; an adjustment with the offset nearly free is the referee."""
    off = shifted(block, np.array([0.05, -0.03, 0.08]))
    held = adjust(off, SETTINGS)
    free = adjust(replace(off, gnss_offset_sigma_m=np.full(3, 100.0)), SETTINGS)
    assert (held.decisions.flights_without_offset, free.decisions.flights_without_offset) == (("1",), ())
    sigma = np.sqrt(np.diag(free.covariances.offset_m2[0]))
    np.testing.assert_allclose(np.sqrt(np.diag(held.tests.implied_offset_covariance_m2[0])), sigma, rtol=0.02)
    assert np.all(np.abs(held.tests.implied_offset_world_m[0] - free.estimates.offset_world_m[0]) < 0.1 * sigma)
    one = implied_offset_test(held.tests.implied_offset_world_m[0], held.tests.implied_offset_covariance_m2[0])
    other = estimated_offset_test(*along_map(free), np.full(3, 100.0))
    assert one.chi2 == pytest.approx(other.chi2, rel=0.1)


def test_control_and_gnss_that_agree_are_said_to(block: Block) -> None:
    numbers = gnss_of(adjust(block, SETTINGS))
    flight = numbers["flights"]["1"]
    assert (flight["estimated"], flight["significant"]) == (False, False)
    assert "control and GNSS agree" in flight["sentence"]
    assert numbers["warnings"] == []
    assert numbers["sentence"].startswith("12 GNSS positions and 8 control points were adjusted together")


def test_a_contradiction_without_an_offset_is_a_warning(block: Block) -> None:
    numbers = gnss_of(adjust(shifted(block, np.array([0.0, 0.0, 0.5])), SETTINGS))
    flight = numbers["flights"]["1"]
    assert flight["significant"]
    assert flight["p"] < 1e-6
    assert flight["offset_m"][2] == pytest.approx(-0.5, abs=0.05)
    assert "contradict each other" in flight["sentence"]
    assert "gnss.offset_sigma_m" in flight["sentence"]
    assert flight["sentence"] in numbers["warnings"]
    assert flight["p_axes"][2] < 1e-6


def test_an_estimated_offset_is_tested_and_one_beyond_its_prior_warned_of(block: Block) -> None:
    off = replace(shifted(block, np.array([0.5, 0.0, 0.0])), gnss_offset_sigma_m=np.array([0.3, 0.3, 0.3]))
    flight = gnss_of(adjust(off, SETTINGS))["flights"]["1"]
    assert flight["estimated"]
    assert flight["significant"]
    assert flight["offset_m"][0] == pytest.approx(-0.5, abs=0.15)
    assert "it is estimated and removed" in flight["sentence"]

    other = replace(shifted(block, np.array([0.0, 0.0, 71.0])), gnss_offset_sigma_m=np.full(3, 100.0))
    numbers = gnss_of(adjust(other, SETTINGS))
    assert "estimated and removed, more than an antenna explains" in numbers["flights"]["1"]["sentence"]
    assert numbers["flights"]["1"]["sentence"] in numbers["warnings"]

    far = replace(shifted(block, np.array([0.0, 0.0, -44.0])), gnss_offset_sigma_m=np.array([1.0, 1.0, 1.0]))
    numbers = gnss_of(adjust(far, SETTINGS))
    assert "exceeds the prior" in numbers["flights"]["1"]["sentence"]
    assert "height" in numbers["flights"]["1"]["sentence"]
    assert numbers["warnings"]


def test_without_control_no_statement_is_made(block: Block) -> None:
    none = replace(block, control_points=block.control_points.with_role("check"))
    for sigma in (0.0, 0.5):
        free = replace(none, gnss_offset_sigma_m=np.full(3, sigma))
        flight = gnss_of(adjust(free, SETTINGS))["flights"]["1"]
        assert flight["degrees_of_freedom"] == 0
        assert (flight["chi2"], flight["p"], flight["significant"]) == (None, None, None)
        assert "without control points" in flight["sentence"] or "control points are needed" in flight["sentence"]


def test_each_flight_is_tested_by_itself() -> None:
    made = simulate_block(replace(PLAN, flights=2, strips=4), 7, tie_points=400).block
    numbers = gnss_of(adjust(shifted(made, np.array([0.0, 0.0, 0.4]), "2"), SETTINGS))
    assert set(numbers["flights"]) == {"1", "2"}
    assert numbers["flights"]["2"]["significant"]
    assert abs(numbers["flights"]["2"]["offset_m"][2]) > abs(numbers["flights"]["1"]["offset_m"][2])


def test_an_offset_is_implied_where_it_is_held_alone(block: Block) -> None:
    for sigma_m, flights in (((0.0,) * 3, ("1",)), ((0.5,) * 3, ())):
        problem = make_problem(replace(block, gnss_offset_sigma_m=np.array(sigma_m)), SETTINGS)
        state = start_state(problem)
        found, offset_m, covariance_m2 = implied_offsets(problem, state, covariances(problem, state))
        assert found == flights
        assert offset_m.shape == (len(flights), 3)
        assert covariance_m2.shape == (len(flights), 3, 3)
