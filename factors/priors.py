"""What is known before the adjustment, as GTSAM factors: surveyed positions, GNSS positions and their offsets, measured
attitudes, other common errors, calibrations.

The projection centre is C = GNSS + R l + offset, with the lever arm l from the antenna in the camera's axes where it is
known there. The offset (datum of the base station, height system) is one unknown per flight, with its own prior; what
else measurements have in common is in photogram.factors.common_errors. The attitude of a gimbal is a rotation with one
sigma about every axis. Sigmas of positions are stated along easting,
northing and height of the map.
"""

from collections.abc import Iterator, Sequence

import gtsam
import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.common_errors import Effect, attitude_residual
from photogram.factors.variables import COMMON_ERROR, CONTROL_POINT, GNSS_OFFSET, POSE, key

OWN_OFFSET_SIGMA_M = 1e-6
"""Of an offset whose prior is 0 along an axis while it is more along another: it stays there."""


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


def position_jacobian(rotation_world_from_camera: FloatArray, lever_arm_camera_m: FloatArray | None) -> FloatArray:
    """Return the Jacobian (3, 6) of the antenna's position C − R l on a pose's tangent (ω, v): [R [l]× R].

    From (C + R v) − R Exp(ω) l = C − R l + R v − R (ω × l), and ω × l = −[l]× ω (Barfoot 2017, eq. 7.16).
    """
    R = rotation_world_from_camera
    if lever_arm_camera_m is None:
        return np.hstack([np.zeros((3, 3)), R])
    return np.hstack([R @ gtsam.Rot3.Hat(lever_arm_camera_m), R])


def known_rotation(
    photograph: int, rotation_world_from_camera: FloatArray, sigma_rad: FloatArray
) -> gtsam.NonlinearFactor:
    """Return the factor of a photograph's rotation (3, 3) that is known to ``sigma_rad`` (3,) about the world's
    axes."""
    into = rotation_world_from_camera.T
    noise = gtsam.noiseModel.Gaussian.Covariance(into @ np.diag(sigma_rad**2) @ into.T)
    return gtsam.PoseRotationPrior3D(key(POSE, photograph), gtsam.Rot3(rotation_world_from_camera), noise)


def gnss_position(
    photograph: int,
    gnss_world_m: FloatArray,
    sigma_m: FloatArray,
    flight: int | None,
    axes: FloatArray | None = None,
    lever_arm_camera_m: FloatArray | None = None,
    effects: Sequence[Effect] = (),
) -> gtsam.NonlinearFactor:
    """Return the factor of a GNSS position (3,) in the world, m; ``flight`` names its offset, None when it has none;
    ``effects`` are those of other common errors.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world; ``lever_arm_camera_m``
    (3,) points from the antenna to the projection centre. Residual C − R (l + a) − offset − shift − GNSS, with the sums
    a and shift of the effects along the camera's axes and those of the world; Jacobians of position_jacobian on the
    pose, −I on the offset, −R M and −M on an error with the effect M.
    """
    noise = along_axes(sigma_m, axes)
    arm = np.zeros(3) if lever_arm_camera_m is None else lever_arm_camera_m
    if flight is None and lever_arm_camera_m is None and not effects:
        return gtsam.GPSFactor(key(POSE, photograph), gnss_world_m, noise)
    if flight is None and not effects:
        return gtsam.GPSFactorArm(key(POSE, photograph), gnss_world_m, -arm, noise)
    first = 1 if flight is None else 2
    turning = lever_arm_camera_m is not None or any(effect.in_camera for effect in effects)

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        keys = factor.keys()
        pose = values.atPose3(keys[0])
        R = pose.rotation().matrix()
        whole, shift = arm, gnss_world_m
        for effect, variable in zip(effects, keys[first:], strict=True):
            moved = effect.matrix @ values.atVector(variable)
            whole, shift = (whole + moved, shift) if effect.in_camera else (whole, shift + moved)
        if flight is not None:
            shift = shift + values.atPoint3(keys[1])
        if jacobians is not None:
            jacobians[0] = position_jacobian(R, whole if turning else None)
            if flight is not None:
                jacobians[1] = -np.eye(3)
            for n, effect in enumerate(effects):
                jacobians[first + n] = -effect.in_world(R)
        return np.asarray(pose.translation() - R @ whole - shift)

    keys = [key(POSE, photograph)] + ([] if flight is None else [key(GNSS_OFFSET, flight)])
    return gtsam.CustomFactor(noise, keys + [key(COMMON_ERROR, effect.error) for effect in effects], error)


def offset_prior(flight: int, sigma_m: FloatArray, axes: FloatArray | None = None) -> gtsam.NonlinearFactor:
    """Return the prior of a flight's GNSS offset: zero with sigmas (3,) in m along the columns of ``axes`` (3, 3)."""
    return gtsam.PriorFactorPoint3(key(GNSS_OFFSET, flight), np.zeros(3), along_axes(sigma_m, axes))


def common_offset_prior(flights: int, sigma_m: FloatArray, common_m: float, axes: FloatArray) -> gtsam.NonlinearFactor:
    """Return the joint prior of the GNSS offsets of several flights: zero with sigmas (3,) in m along the columns of
    ``axes`` (3, 3), of which ``common_m`` along the first two is one and the same error of all flights.

    Along one axis the covariance of n flights is σ² I + s² 11ᵀ, σ their own part. Its inverse is WᵀW with the symmetric
    W = (I − c 11ᵀ) / σ, c = (1 − (1 + n s² / σ²)^−½) / n.
    """
    n = flights
    common = np.array([common_m, common_m, 0.0])
    own = np.sqrt(np.maximum(sigma_m**2 - common**2, OWN_OFFSET_SIGMA_M**2))
    share = (1.0 - 1.0 / np.sqrt(1.0 + n * (common / own) ** 2)) / n
    alone = axes.T / own[:, None]
    together = axes.T * (share / own)[:, None]
    blocks = [np.vstack([alone - together if g == f else -together for g in range(n)]) for f in range(n)]

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        if jacobians is not None:
            for f, block in enumerate(blocks):
                jacobians[f] = block
        return np.asarray(
            sum(block @ values.atPoint3(k) for block, k in zip(blocks, factor.keys(), strict=True)), dtype=np.float64
        )

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(3 * n), [key(GNSS_OFFSET, f) for f in range(n)], error)


NO_HEADING_SIGMA_RAD = 10.0
"""Standard deviation of a heading that is not known: more than a turn, so that it says nothing."""


def _attitude_noise(rotation: FloatArray, sigma_rad: float, *, heading_known: bool) -> gtsam.noiseModel.Base:
    """Return the noise of a measured rotation (3, 3) about the camera's axes."""
    if heading_known:
        return gtsam.noiseModel.Isotropic.Sigma(3, sigma_rad)
    vertical = rotation[2]  # the world's up axis in the camera frame
    around = np.outer(vertical, vertical)
    covariance = sigma_rad**2 * (np.eye(3) - around) + NO_HEADING_SIGMA_RAD**2 * around
    return gtsam.noiseModel.Gaussian.Covariance(covariance)


def measured_attitude(
    photograph: int,
    rotation_world_from_camera: FloatArray,
    sigma_rad: float,
    *,
    heading_known: bool = True,
    error: int | None = None,
) -> gtsam.NonlinearFactor:
    """Return the factor of a measured attitude (3, 3) with one sigma in rad about every axis of the camera; ``error``
    names what it has in common with others.

    With the heading unknown nothing is said about turns around the vertical of the world. Residual and Jacobians of
    attitude_residual.
    """
    noise = _attitude_noise(rotation_world_from_camera, sigma_rad, heading_known=heading_known)
    if error is None:
        rotation = gtsam.Pose3(gtsam.Rot3(rotation_world_from_camera), np.zeros(3))
        return gtsam.PoseRotationPrior3D(key(POSE, photograph), rotation, noise)

    def residual(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        R, bias = values.atPose3(factor.keys()[0]).rotation().matrix(), values.atVector(factor.keys()[1])
        e, of_turn, of_bias = attitude_residual(rotation_world_from_camera, R, bias)
        if jacobians is not None:
            jacobians[0], jacobians[1] = np.hstack([of_turn, np.zeros((3, 3))]), of_bias
        return e

    return gtsam.CustomFactor(noise, [key(POSE, photograph), key(COMMON_ERROR, error)], residual)


def vector_prior(variable: int, expected: FloatArray, sigmas: FloatArray) -> Iterator[gtsam.NonlinearFactor]:
    """Yield the prior of a variable (d,), of a common error or a camera's free parameters for instance, at ``expected``
    (d,) with ``sigmas`` (d,), of which an infinite one says nothing; none when all are infinite."""
    known = np.flatnonzero(np.isfinite(sigmas))
    if not len(known):
        return
    selection = np.eye(len(sigmas))[known]

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        if jacobians is not None:
            jacobians[0] = selection
        return np.asarray(values.atVector(factor.keys()[0])[known] - expected[known])

    yield gtsam.CustomFactor(gtsam.noiseModel.Diagonal.Sigmas(sigmas[known]), [variable], error)
