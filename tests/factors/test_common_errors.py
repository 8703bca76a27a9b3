"""What measurements have in common: analytic Jacobians against numerical ones, velocities, and what separates what."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import gtsam
import numpy as np
import pytest
from makers import simulated
from referees import native
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import without_attitudes
from photogram.arrays import FloatArray
from photogram.factors.common_errors import (
    Effect,
    attitude_groups,
    flight_time,
    parts,
    values_of,
    velocities,
)
from photogram.factors.linearised.rotations import attitude_misfits
from photogram.factors.priors import gnss_position, measured_attitude, vector_prior
from photogram.factors.variables import COMMON_ERROR, GNSS_OFFSET, POSE, key
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import CommonError, Photograph

START = datetime(2026, 5, 4, 9, 0, tzinfo=UTC)


def attitude_residual(measured: FloatArray, rotation: FloatArray, bias: FloatArray) -> tuple[FloatArray, ...]:
    e, of_turn, of_bias = attitude_misfits(measured[None], rotation[None], bias[None])
    return e[0], of_turn[0], of_bias[0]


def numerical(error: Callable[[FloatArray], FloatArray], size: int) -> FloatArray:
    """Central differences of a function of changes (size,) at zero."""
    step = 1e-6
    return np.column_stack([(error(step * e) - error(-step * e)) / (2 * step) for e in np.eye(size)])


def moved(values: gtsam.Values, variables: list[int], sizes: list[int], change: FloatArray) -> gtsam.Values:
    """The values with a pose and vectors moved by a change in their tangents, one after the other."""
    after, start = gtsam.Values(values), 0
    for variable, size in zip(variables, sizes, strict=True):
        delta, start = change[start : start + size], start + size
        if size == 6:
            after.update(variable, after.atPose3(variable).retract(delta))
        else:
            after.update(variable, after.atVector(variable) + delta)
    return after


def check_jacobians(factor: Any, values: gtsam.Values, sizes: list[int]) -> None:
    variables = list(factor.keys())
    A, b = factor.linearize(values).jacobian()
    np.testing.assert_allclose(-b, factor.whitenedError(values), rtol=1e-12)
    differences = numerical(lambda d: factor.whitenedError(moved(values, variables, sizes, d)), sum(sizes))
    np.testing.assert_allclose(A, differences, rtol=1e-5, atol=1e-5 * np.abs(A).max())


@pytest.mark.parametrize("flight", [None, 0])
@pytest.mark.parametrize("seed", range(3))
def test_positions_with_common_errors_have_the_jacobians_of_differences(seed: int, flight: int | None) -> None:
    rng = np.random.default_rng(seed)
    R, C, arm = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 30, 3), rng.normal(0, 0.4, 3)
    effects = [Effect(0, True, rng.normal(size=(3, 2))), Effect(1, False, rng.normal(0, 8, (3, 1))),
               Effect(2, False, 0.3 * np.eye(3))]  # fmt: skip
    common = [rng.normal(0, 0.2, 2), rng.normal(0, 0.02, 1), rng.normal(0, 0.2, 3)]
    measured, sigma, offset = rng.normal(0, 30, 3), np.array([0.02, 0.03, 0.05]), rng.normal(0, 0.3, 3)
    values = gtsam.Values()
    values.insert(key(POSE, 1), gtsam.Pose3(gtsam.Rot3(R), C))
    for k, q in enumerate(common):
        values.insert(key(COMMON_ERROR, k), q)
    if flight is not None:
        values.insert(key(GNSS_OFFSET, 0), offset)
    factor: Any = native(gnss_position(1, measured, sigma, flight, None, arm, effects))
    shift = sum((e.in_world(R) @ q for e, q in zip(effects, common, strict=True)), np.zeros(3))
    shift = shift + (np.zeros(3) if flight is None else offset)
    np.testing.assert_allclose(factor.whitenedError(values) * sigma, C - R @ arm - shift - measured, atol=1e-12)
    check_jacobians(factor, values, [6, *([] if flight is None else [3]), 2, 1, 3])


@pytest.mark.parametrize("heading_known", [True, False])
@pytest.mark.parametrize("size", [3, 4])
def test_attitudes_with_a_common_error_have_the_jacobians_of_differences(size: int, heading_known: bool) -> None:
    rng = np.random.default_rng(size)
    R, bias = Rotation.random(rng=rng).as_matrix(), rng.normal(0, 0.1, size)
    measured = R @ Rotation.from_rotvec(rng.normal(0, 0.2, 3)).as_matrix()
    values = gtsam.Values()
    values.insert(key(POSE, 0), gtsam.Pose3(gtsam.Rot3(R), rng.normal(size=3)))
    values.insert(key(COMMON_ERROR, 0), bias)
    factor = measured_attitude(0, measured, 0.03, heading_known=heading_known, error=0)
    check_jacobians(native(factor), values, [6, size])


def test_an_attitude_is_measured_with_its_bias() -> None:
    R, b, h = Rotation.from_euler("xyz", [3.0, 0.2, 1.0]).as_matrix(), np.array([0.02, -0.03, 0.01]), 0.1
    compass = Rotation.from_rotvec([0.0, 0.0, h]).as_matrix()
    measured = compass @ R @ Rotation.from_rotvec(b).as_matrix()
    e, _, _ = attitude_residual(measured, R, np.array([*b, h]))
    np.testing.assert_allclose(e, 0.0, atol=1e-14)
    without, of_turn, of_bias = attitude_residual(R, R, np.zeros(0))
    assert of_bias.shape == (3, 0)
    np.testing.assert_allclose(without, 0.0, atol=1e-14)
    np.testing.assert_allclose(of_turn, np.eye(3), atol=1e-14)


def test_the_jacobians_of_an_attitude_hold_for_small_and_for_large_turns() -> None:
    w, R = np.array([0.5, -0.2, 0.8]), Rotation.from_euler("xyz", [3.0, 0.2, 1.0]).as_matrix()
    for scale in (1.0, 1.001e-4, 0.999e-4, 0.0):
        measured = R @ Rotation.from_rotvec(-scale * w).as_matrix()
        bias = np.array([*(scale * w[::-1]), 0.3 * scale])

        def turned(d: FloatArray, measured: FloatArray = measured, bias: FloatArray = bias) -> FloatArray:
            return attitude_residual(measured, R @ Rotation.from_rotvec(d).as_matrix(), bias)[0]

        def biased(d: FloatArray, measured: FloatArray = measured, bias: FloatArray = bias) -> FloatArray:
            return attitude_residual(measured, R, bias + d)[0]

        _, of_turn, of_bias = attitude_residual(measured, R, bias)
        np.testing.assert_allclose(of_turn, numerical(turned, 3), atol=1e-9)
        np.testing.assert_allclose(of_bias, numerical(biased, 4), atol=1e-9)


def test_a_compass_is_a_direction_of_the_boresight_where_tilts_are_alike_and_no_other_where_they_differ() -> None:
    def columns(tilts_deg: list[float]) -> FloatArray:
        rows = []
        for n, tilt in enumerate(tilts_deg):
            R = Rotation.from_euler("ZX", [70.0 * n, 180.0 - tilt], degrees=True).as_matrix()
            rows.append(attitude_residual(R, R, np.zeros(4))[2])
        return np.concatenate(rows)

    assert np.linalg.matrix_rank(columns([0.0, 0.0, 0.0, 0.0]), tol=1e-9) == 3
    assert np.linalg.matrix_rank(columns([30.0, 30.0, 30.0, 30.0]), tol=1e-9) == 3
    assert np.linalg.matrix_rank(columns([0.0, 30.0, 0.0, 30.0]), tol=1e-9) == 4


def test_the_prior_pulls_to_zero() -> None:
    values = gtsam.Values()
    values.insert(key(COMMON_ERROR, 3), np.array([0.1, -0.4]))
    factor: Any = native(next(vector_prior(key(COMMON_ERROR, 3), np.zeros(2), np.array([0.1, 0.2]))))
    np.testing.assert_allclose(factor.whitenedError(values), [1.0, -2.0])
    check_jacobians(factor, values, [2])


# ---- velocities and times --------------------------------------------------------------------------------------------


def flown(time_s: Sequence[float | None], east_m: Sequence[float], flight: str = "1") -> list[Photograph]:
    """Photographs on a line to the east."""
    return [
        Photograph(
            f"{i}", 0, flight=flight, time=None if t is None else START + timedelta(seconds=t),
            gnss_world_m=np.array([x, 0.0, 50.0]), gnss_sigma_m=np.full(3, 0.02),
        )
        for i, (t, x) in enumerate(zip(time_s, east_m, strict=True))
    ]  # fmt: skip


def test_velocity_is_the_derivative_of_a_parabola_at_uneven_times() -> None:
    time = [0.0, 2.5, 4.2, 7.0]
    found = velocities(flown(time, [3.0 * t + 0.25 * t * t for t in time]))
    np.testing.assert_allclose(found[1:3, 0], [3.0 + 0.5 * t for t in time[1:3]])
    np.testing.assert_allclose(found[:, 1:], 0.0)


def test_velocity_at_the_end_of_a_strip_is_that_of_the_strip() -> None:
    photographs = flown([0.5, 2.5, 4.5, 8.1, 10.1, 12.1], [0.0, 10.0, 20.0, 21.0, 11.0, 1.0])
    np.testing.assert_allclose(velocities(photographs)[:, 0], [5.0, 5.0, 5.0, -5.0, -5.0, -5.0])


def test_no_velocity_across_gaps_without_times_or_from_coarse_ones() -> None:
    found = velocities(flown([0.5, 2.5, 4.5, 600.0, 700.0, 702.0], [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]))
    np.testing.assert_array_equal(np.isfinite(found[:, 0]), [True, True, True, False, True, True])
    found = velocities(flown([0.5, None, 4.5], [0.0, 10.0, 20.0]))
    np.testing.assert_array_equal(np.isfinite(found[:, 0]), [True, False, True])
    fast = velocities(flown([0.0, 1.0, 2.0, 3.0], [0.0, 10.0, 20.0, 30.0]))
    slow = velocities(flown([0.0, 2.0, 4.0, 6.0], [0.0, 10.0, 20.0, 30.0]))
    assert np.isnan(fast).all()  # whole seconds, one apart: off by a fifth and more
    np.testing.assert_array_equal(np.isfinite(slow[:, 0]), [False, True, True, False])
    assert np.isnan(velocities([Photograph("a", 0), Photograph("b", 0)])).all()
    assert np.isnan(velocities(flown([1.5, 1.5], [0.0, 1.0]))).all()


def test_flights_have_their_own_neighbours_and_times() -> None:
    both = flown([0.5, 2.5, 4.5], [0.0, 10.0, 20.0]) + [
        replace(p, flight="2") for p in flown([1.2, 3.2, 5.2], [500.0, 480.0, 460.0])
    ]
    np.testing.assert_allclose(velocities(both)[:, 0], [5.0, 5.0, 5.0, -10.0, -10.0, -10.0])
    np.testing.assert_allclose(flight_time(both), [-0.5, 0.0, 0.5] * 2)


def test_values_of_several_errors_stand_one_after_the_other() -> None:
    errors = (
        CommonError("attitude", "1", 0, np.ones(4), np.arange(4.0)),
        CommonError("time_offset", None, 0, np.ones(1), np.array([7.0])),
    )
    assert [values_of(errors)[part].tolist() for part in parts(errors)] == [[0.0, 1.0, 2.0, 3.0], [7.0]]
    assert not len(values_of(()))


def test_attitudes_stand_by_their_common_error() -> None:
    made = simulated(SurveyPlan(strips=2, photographs_per_strip=3, flights=2, attitude_sigma_deg=1.0))
    photographs = list(made.block.photographs)
    photographs[1] = replace(photographs[1], attitude_world_from_camera=None)
    photographs[2] = replace(photographs[2], attitude_sigma_rad=None)
    flight = photographs[-1].flight
    values: FloatArray = np.array([0.01, -0.02, 0.005, 0.03])
    error = CommonError("attitude", flight, None, np.full(4, 0.1), values)
    block = replace(made.block, photographs=tuple(photographs), common_errors=(error,))
    rotation = block.oriented_cameras().rotation
    groups = list(attitude_groups(block, rotation, values))
    assert [g.error for g in groups] == [-1, 0]
    assert sorted(np.concatenate([g.photograph for g in groups]).tolist()) == [0, 3, 4, 5]
    for group in groups:
        bias = values if group.error == 0 else np.zeros(0)
        for i, *found in zip(group.photograph.tolist(), *group[2:], strict=True):
            assert (photographs[i].flight == flight) == (group.error == 0)
            measured = photographs[i].attitude_world_from_camera
            assert measured is not None
            for value, expected in zip(found, attitude_residual(measured, rotation[i], bias), strict=True):
                np.testing.assert_allclose(value, expected, atol=1e-15)
    assert list(attitude_groups(without_attitudes(block), rotation, values)) == []
