"""Observations of poses and points against the factors that GTSAM has of its own, to 1e-10."""

from collections.abc import Sequence

import gtsam
import numpy as np
import pytest
from referees import native
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.factors.linearised.alike import Factors, together
from photogram.factors.linearised.poses import DistanceFactors
from photogram.factors.priors import (
    gnss_position,
    known_place,
    known_rotation,
    measured_attitude,
    offset_prior,
    surveyed_position,
)
from photogram.factors.reference.native import GtsamValues
from photogram.factors.variables import CONTROL_POINT, GNSS_OFFSET, POSE, key

RNG = np.random.default_rng(11)
AXES = Rotation.from_euler("zyx", [30.0, 3.0, -2.0], degrees=True).as_matrix()
SIGMA = np.array([0.02, 0.03, 0.05])
PLACE, ARM = RNG.normal(0, 30, 3), RNG.normal(0, 0.4, 3)
R0 = Rotation.random(rng=RNG).as_matrix()


def values() -> gtsam.Values:
    """Three poses, three points and an offset somewhere."""
    made = gtsam.Values()
    for i in range(3):
        R = R0 @ Rotation.from_rotvec(RNG.normal(0, 0.4, 3)).as_matrix()
        made.insert(key(POSE, i), gtsam.Pose3(gtsam.Rot3(R), RNG.normal(0, 30, 3)))
        made.insert(key(CONTROL_POINT, i), RNG.normal(0, 30, 3))
    made.insert(key(GNSS_OFFSET, 0), RNG.normal(0, 0.3, 3))
    return made


def whitened(sigma: FloatArray, axes: FloatArray) -> gtsam.noiseModel.Base:
    return gtsam.noiseModel.Gaussian.Covariance(axes @ np.diag(sigma**2) @ axes.T)


def distances(first: int, second: int) -> DistanceFactors:
    return DistanceFactors(np.array([[first, second]]), np.array([17.0]), np.array([0.01]))


POSE_0, POSE_1, POINT_0, POINT_1 = key(POSE, 0), key(POSE, 1), key(CONTROL_POINT, 0), key(CONTROL_POINT, 1)
ALONG = gtsam.noiseModel.Isotropic.Sigma(1, 0.01)
DIAGONAL = gtsam.noiseModel.Diagonal.Sigmas(SIGMA)
HEADING = np.outer(R0[2], R0[2])
NO_HEADING = gtsam.noiseModel.Gaussian.Covariance(0.02**2 * (np.eye(3) - HEADING) + 100.0 * HEADING)
TURN = gtsam.Pose3(gtsam.Rot3(R0), np.zeros(3))
PAIRS: dict[str, tuple[Factors, gtsam.NonlinearFactor]] = {
    "control point": (surveyed_position(0, PLACE, SIGMA), gtsam.PriorFactorPoint3(POINT_0, PLACE, DIAGONAL)),
    "control point along axes": (
        surveyed_position(0, PLACE, SIGMA, AXES), gtsam.PriorFactorPoint3(POINT_0, PLACE, whitened(SIGMA, AXES)),
    ),
    "GNSS": (gnss_position(0, PLACE, SIGMA, None), gtsam.GPSFactor(POSE_0, PLACE, DIAGONAL)),
    "GNSS along axes": (
        gnss_position(0, PLACE, SIGMA, None, AXES), gtsam.GPSFactor(POSE_0, PLACE, whitened(SIGMA, AXES)),
    ),
    "GNSS with an arm": (
        gnss_position(0, PLACE, SIGMA, None, AXES, ARM),
        gtsam.GPSFactorArm(POSE_0, PLACE, -ARM, whitened(SIGMA, AXES)),
    ),
    "offset": (
        offset_prior(0, SIGMA, AXES),
        gtsam.PriorFactorPoint3(key(GNSS_OFFSET, 0), np.zeros(3), whitened(SIGMA, AXES)),
    ),
    "attitude": (
        measured_attitude(1, R0, 0.02),
        gtsam.PoseRotationPrior3D(POSE_1, TURN, gtsam.noiseModel.Isotropic.Sigma(3, 0.02)),
    ),
    "attitude without heading": (
        measured_attitude(1, R0, 0.02, heading_known=False), gtsam.PoseRotationPrior3D(POSE_1, TURN, NO_HEADING),
    ),
    "rotation about the world's axes": (
        known_rotation(1, R0, SIGMA), gtsam.PoseRotationPrior3D(POSE_1, TURN, whitened(SIGMA, R0.T)),
    ),
    "distance of photographs": (distances(POSE_0, POSE_1), gtsam.RangeFactorPose3(POSE_0, POSE_1, 17.0, ALONG)),
    "distance of points": (distances(POINT_0, POINT_1), gtsam.RangeFactor3(POINT_0, POINT_1, 17.0, ALONG)),
    "distance of both": (distances(POSE_0, POINT_1), gtsam.RangeFactor3D(POSE_0, POINT_1, 17.0, ALONG)),
}  # fmt: skip


def assert_alike(found: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("name", PAIRS)
def test_every_factor_is_that_of_gtsam(name: str) -> None:
    own, theirs = PAIRS[name]
    for _ in range(5):
        at = values()
        A, b = theirs.linearize(at).jacobian()
        linear = own.linearised(GtsamValues(at))
        J, e = linear.jacobian[0], linear.misfit[0]
        assert_alike(J.T @ J, A.T @ A)  # whatever square root of the weights each has
        assert_alike(J.T @ e, -A.T @ b)
        assert own.cost(GtsamValues(at)) == pytest.approx(theirs.error(at), rel=1e-10)
        other, right = native(own).linearize(at).jacobian()
        np.testing.assert_array_equal(other, J)
        np.testing.assert_array_equal(right, -e)


def test_a_pose_that_is_held_has_the_gradient_of_gtsams_prior_where_it_is_held() -> None:
    pose = gtsam.Pose3(gtsam.Rot3(R0), PLACE)
    at = gtsam.Values()
    at.insert(POSE_0, pose)
    prior = gtsam.PriorFactorPose3(POSE_0, pose, gtsam.noiseModel.Diagonal.Sigmas(np.repeat([1e-3, 0.02], 3)))
    A, _ = prior.linearize(at).jacobian()
    held = known_rotation(0, R0, np.full(3, 1e-3)), known_place(0, PLACE, np.eye(3) / 0.02)
    J = np.concatenate([factor.linearised(GtsamValues(at)).jacobian[0] for factor in held])
    assert_alike(J.T @ J, A.T @ A)


def one_by_one(factors: Sequence[Factors], at: GtsamValues) -> FloatArray:
    return np.concatenate([factor.linearised(at).jacobian[0].ravel() for factor in factors])


def test_alike_factors_are_linearised_together_as_they_are_alone() -> None:
    at = GtsamValues(values())
    plain = [gnss_position(i, RNG.normal(0, 30, 3), SIGMA, None, AXES) for i in range(3)]
    offset = [gnss_position(i, RNG.normal(0, 30, 3), SIGMA, 0, AXES, ARM) for i in range(3)]
    attitudes = [measured_attitude(i, R0, 0.02) for i in range(3)]
    joined = together([each for three in zip(plain, offset, attitudes, strict=True) for each in three])
    assert [len(group) for group in joined] == [3, 3, 3]
    alone: tuple[Sequence[Factors], ...] = plain, offset, attitudes
    for group, single in zip(joined, alone, strict=True):
        np.testing.assert_allclose(
            group.linearised(at).jacobian.ravel(), one_by_one(single, at), rtol=1e-14, atol=1e-14
        )
        np.testing.assert_array_equal(group.alone(1).variables, single[1].variables)
        assert group.cost(at) == pytest.approx(sum(factor.cost(at) for factor in single), rel=1e-13)
