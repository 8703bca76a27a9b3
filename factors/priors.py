"""What is known before the adjustment, as GTSAM factors: surveyed positions, GNSS positions and their offsets, measured
attitudes, calibrations.

The projection centre is C = GNSS + R l + offset, with the lever arm l from the antenna in the camera's axes where it is
known there. The offset (datum of the base station, height system) is one unknown per flight, with its own prior. The
attitude of a gimbal is a rotation with one sigma about every axis. Sigmas of positions are stated along easting,
northing and height of the map.
"""

from __future__ import annotations

import gtsam
import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, key


def along_axes(sigma_m: FloatArray, axes: FloatArray | None) -> gtsam.noiseModel.Base:
    """Return the noise of a position with sigmas (3,) in m along the columns of ``axes`` (3, 3), a rotation.

    Without ``axes`` the sigmas lie along the axes of the world itself. An infinite sigma leaves its axis open.
    """
    if axes is None or np.array_equal(axes, np.eye(3)):
        return gtsam.noiseModel.Diagonal.Sigmas(sigma_m)
    return gtsam.noiseModel.Gaussian.SqrtInformation(axes.T / sigma_m[:, None])


def surveyed_position(
    point: int, position_world_m: FloatArray, sigma_m: FloatArray, axes: FloatArray | None = None
) -> gtsam.NonlinearFactor:
    """Return the factor of control point ``point`` surveyed at a world position (3,), m.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world.
    """
    return gtsam.PriorFactorPoint3(key(CONTROL_POINT, point), position_world_m, along_axes(sigma_m, axes))


def measured_distance(first: int, second: int, length_m: float, sigma_m: float) -> gtsam.NonlinearFactor:
    """Return the factor of a distance between two control points, m."""
    noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma_m)
    return gtsam.RangeFactor3(key(CONTROL_POINT, first), key(CONTROL_POINT, second), length_m, noise)


def measured_base(first: int, second: int, length_m: float, sigma_m: float) -> gtsam.NonlinearFactor:
    """Return the factor of a distance between the projection centres of two photographs, m."""
    noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma_m)
    return gtsam.RangeFactorPose3(key(POSE, first), key(POSE, second), length_m, noise)


def position_jacobian(rotation_world_from_camera: FloatArray, lever_arm_camera_m: FloatArray | None) -> FloatArray:
    """Return the Jacobian (3, 6) of the antenna's position C − R l on a pose's tangent (ω, v): [R [l]× R].

    From (C + R v) − R Exp(ω) l = C − R l + R v − R (ω × l), and ω × l = −[l]× ω (Barfoot 2017, eq. 7.16).
    """
    R = rotation_world_from_camera
    if lever_arm_camera_m is None:
        return np.hstack([np.zeros((3, 3)), R])
    x, y, z = lever_arm_camera_m
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.hstack([R @ across, R])


def gnss_position(
    photograph: int,
    gnss_world_m: FloatArray,
    sigma_m: FloatArray,
    flight: int | None,
    axes: FloatArray | None = None,
    lever_arm_camera_m: FloatArray | None = None,
) -> gtsam.NonlinearFactor:
    """Return the factor of a GNSS position (3,) in the world, m; ``flight`` names its offset, None when it has none.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world; ``lever_arm_camera_m``
    (3,) points from the antenna to the projection centre. Residual C − R l − offset − GNSS; Jacobians of
    position_jacobian on the pose, and −I on the offset.
    """
    noise = along_axes(sigma_m, axes)
    arm = np.zeros(3) if lever_arm_camera_m is None else lever_arm_camera_m
    if flight is None and lever_arm_camera_m is None:
        return gtsam.GPSFactor(key(POSE, photograph), gnss_world_m, noise)
    if flight is None:
        return gtsam.GPSFactorArm(key(POSE, photograph), gnss_world_m, -arm, noise)

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        pose = values.atPose3(factor.keys()[0])
        R = pose.rotation().matrix()
        if jacobians is not None:
            jacobians[0] = position_jacobian(R, lever_arm_camera_m)
            jacobians[1] = -np.eye(3)
        return np.asarray(pose.translation() - R @ arm - values.atPoint3(factor.keys()[1]) - gnss_world_m)

    return gtsam.CustomFactor(noise, [key(POSE, photograph), key(GNSS_OFFSET, flight)], error)


def offset_prior(flight: int, sigma_m: FloatArray, axes: FloatArray | None = None) -> gtsam.NonlinearFactor:
    """Return the prior of a flight's GNSS offset: zero with sigmas (3,) in m along the columns of ``axes`` (3, 3)."""
    return gtsam.PriorFactorPoint3(key(GNSS_OFFSET, flight), np.zeros(3), along_axes(sigma_m, axes))


NO_HEADING_SIGMA_RAD = 10.0
"""Standard deviation of a heading that is not known: more than a turn, so that it says nothing."""


def measured_attitude(
    photograph: int, rotation_world_from_camera: FloatArray, sigma_rad: float, *, heading_known: bool = True
) -> gtsam.NonlinearFactor:
    """Return the factor of a measured attitude (3, 3) with one sigma in rad about every axis of the camera.

    With the heading unknown nothing is said about turns around the vertical of the world.
    """
    rotation = gtsam.Pose3(gtsam.Rot3(rotation_world_from_camera), np.zeros(3))
    if heading_known:
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Isotropic.Sigma(3, sigma_rad)
    else:
        vertical = rotation_world_from_camera[2]  # the world's up axis in the camera frame
        around = np.outer(vertical, vertical)
        covariance = sigma_rad**2 * (np.eye(3) - around) + NO_HEADING_SIGMA_RAD**2 * around
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return gtsam.PoseRotationPrior3D(key(POSE, photograph), rotation, noise)


def calibration_prior(camera: int, expected: FloatArray, sigmas: FloatArray) -> gtsam.NonlinearFactor | None:
    """Return the prior on a camera's free parameters, in the units of the calibration variable; None when all are
    unbounded.

    ``expected`` and ``sigmas`` (free,); an infinite sigma says nothing about its parameter.
    """
    known = np.flatnonzero(np.isfinite(sigmas))
    if not len(known):
        return None
    selection = np.zeros((len(known), len(sigmas)))
    selection[np.arange(len(known)), known] = 1.0

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        if jacobians is not None:
            jacobians[0] = selection
        return np.asarray(values.atVector(factor.keys()[0])[known] - expected[known])

    return gtsam.CustomFactor(gtsam.noiseModel.Diagonal.Sigmas(sigmas[known]), [key(CALIBRATION, camera)], error)
