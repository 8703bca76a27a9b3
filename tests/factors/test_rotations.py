"""Jacobians of rotations: those of GTSAM, and those of differences."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.factors.linearised.rotations import attitude_misfits, cross, inverse_right_jacobian, right_jacobian

DIRECTIONS = np.random.default_rng(4).normal(size=(40, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.01, 0.3, 1.5, 3.0, 3.1])
def test_jacobians_of_the_exponential_are_gtsams(angle: float) -> None:
    vector = angle * DIRECTIONS
    found = right_jacobian(vector), inverse_right_jacobian(vector)
    for own, theirs in zip(found, (gtsam.Rot3.ExpmapDerivative, gtsam.Rot3.LogmapDerivative), strict=True):
        np.testing.assert_allclose(own, [theirs(v) for v in vector], rtol=0, atol=1e-10)


@pytest.mark.parametrize("angle", [9.9e-5, 1.01e-4, 1e-3])
def test_small_turns_have_jacobians_to_the_last_digits(angle: float) -> None:
    """GTSAM's, of turns below 1e-3, are off by 1e-9; the series in 30 digits is the referee."""
    vector = angle * DIRECTIONS
    V = cross(vector).astype(np.longdouble)
    series = np.eye(3) - V / 2 + V @ V / 6 - V @ V @ V / 24 + V @ V @ V @ V / 120
    np.testing.assert_allclose(right_jacobian(vector), series.astype(float), rtol=0, atol=1e-11)
    inverse = inverse_right_jacobian(vector) @ right_jacobian(vector)
    np.testing.assert_allclose(inverse, np.broadcast_to(np.eye(3), inverse.shape), atol=1e-11)


def by_gtsam(measured: FloatArray, R: FloatArray, bias: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of one attitude, composed of GTSAM's functions."""
    boresight, heading = bias[:3] if len(bias) else np.zeros(3), bias[3:]
    B = gtsam.Rot3.Expmap(boresight).matrix()
    turned = R @ B
    predicted = gtsam.Rot3.Expmap(np.array([0.0, 0.0, heading[0]])).matrix() @ turned if len(heading) else turned
    e = gtsam.Rot3.Logmap(gtsam.Rot3(measured.T @ predicted))
    columns = [np.zeros((3, 0)), *([gtsam.Rot3.ExpmapDerivative(boresight)] if len(bias) else [])]
    columns += [turned[2][:, None]] if len(heading) else []
    inverse = gtsam.Rot3.LogmapDerivative(e)
    return e, inverse @ B.T, inverse @ np.hstack(columns)


@pytest.mark.parametrize("size", [0, 3, 4])
def test_attitudes_are_those_of_gtsam(size: int) -> None:
    rng = np.random.default_rng(size)
    R = Rotation.random(30, rng=rng).as_matrix()
    measured = R @ Rotation.from_rotvec(rng.normal(0, 0.3, (30, 3))).as_matrix()
    bias = rng.normal(0, 0.1, (30, size))
    found = attitude_misfits(measured, R, bias)
    expected = [by_gtsam(*each) for each in zip(measured, R, bias, strict=True)]
    for own, theirs in zip(found, zip(*expected, strict=True), strict=True):
        np.testing.assert_allclose(own, theirs, rtol=0, atol=1e-10)
