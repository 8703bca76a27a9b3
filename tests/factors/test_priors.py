"""The joint prior of GNSS offsets: against its covariance, and in a block without control against what it must give."""

from dataclasses import replace
from typing import Literal

import gtsam
import numpy as np
import pytest
from makers import LEAST_SQUARES, simulated
from referees import native
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.factors.priors import common_offset_prior
from photogram.factors.variables import GNSS_OFFSET, key
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=0, check_points=0, flights=2, side_overlap=0.7,
    gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.0, 0.0, 0.0),
)  # fmt: skip
DATUM_M = 2.0


def test_a_common_offset_has_the_covariance_that_it_states() -> None:
    sigma, common, flights = np.array([2.5, 2.0 + 1e-9, 0.3]), 2.0, 3
    axes = Rotation.from_euler("zyx", [20.0, 2.0, -1.0], degrees=True).as_matrix()
    factor = native(common_offset_prior(flights, sigma, common, axes))
    values = gtsam.Values()
    offset = np.random.default_rng(3).normal(size=(flights, 3))
    for f in range(flights):
        values.insert(key(GNSS_OFFSET, f), offset[f])
    along = np.zeros((3 * flights, 3 * flights))
    for axis, shared in enumerate((common, common, 0.0)):
        at = axis + 3 * np.arange(flights)
        along[np.ix_(at, at)] = shared**2
        along[at, at] = sigma[axis] ** 2
    turn = np.kron(np.eye(flights), axes)
    covariance = turn @ along @ turn.T
    linear = factor.linearize(values)
    A = linear.jacobian()[0]
    np.testing.assert_allclose(A.T @ A @ covariance, np.eye(9), atol=1e-4)
    o = offset.ravel()
    assert factor.error(values) == pytest.approx(0.5 * o @ np.linalg.solve(covariance, o), rel=1e-4)


def adjusted(offset_m: float, datum_m: float, engine: Literal["fast", "reference"] = "fast") -> Adjustment:
    block = simulated(PLAN).block
    prior = np.array([np.hypot(offset_m, datum_m)] * 2 + [offset_m])
    block = replace(block, gnss_offset_sigma_m=prior, datum_sigma_m=datum_m)
    return adjust(block, replace(LEAST_SQUARES, engine=engine))


def plan_sigma_m(result: Adjustment) -> float:
    return float(np.sqrt(np.mean(np.diagonal(result.covariances.tie_point_m2, axis1=1, axis2=2)[:, :2])))


def test_an_accepted_datum_counts_once_in_the_position_of_a_block_of_several_flights() -> None:
    without, with_it = adjusted(0.0, 0.0), adjusted(0.0, DATUM_M)
    assert plan_sigma_m(with_it) == pytest.approx(np.hypot(plan_sigma_m(without), DATUM_M), rel=1e-3)
    heights = [r.covariances.tie_point_m2[:, 2, 2] for r in (without, with_it)]
    np.testing.assert_allclose(heights[1], heights[0], rtol=1e-3)
    # nothing of the shape is lost: the same error of all flights turns and bends nothing
    points = [r.block.tie_points.position_world_m for r in (without, with_it)]
    np.testing.assert_allclose(points[1], points[0], atol=1e-5)


def test_two_flights_may_be_off_by_their_own_beside_the_datum() -> None:
    result = adjusted(0.1, DATUM_M)
    a, b = (np.diag(c)[:2] for c in result.covariances.offset_m2)
    np.testing.assert_allclose(np.sqrt([a, b]), DATUM_M, rtol=0.01)
    assert np.all(np.abs(result.estimates.offset_world_m[0] - result.estimates.offset_world_m[1])[:2] < 0.1)


def test_both_engines_know_the_joint_prior() -> None:
    fast, reference = adjusted(0.1, DATUM_M), adjusted(0.1, DATUM_M, "reference")
    assert fast.cost == pytest.approx(reference.cost, rel=1e-6)
    np.testing.assert_allclose(fast.estimates.offset_world_m, reference.estimates.offset_world_m, atol=1e-6)
