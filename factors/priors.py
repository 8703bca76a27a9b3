"""What is known before the adjustment, as factors: surveyed positions, GNSS positions and their offsets, measured
attitudes, other common errors, calibrations.

The projection centre is C = GNSS + R l + offset, with the lever arm l from the antenna in the camera's axes where it is
known there. The offset (datum of the base station, height system) is one unknown per flight, with its own prior; what
else measurements have in common is in photogram.factors.common_errors. The attitude of a gimbal is a rotation with one
sigma about every axis. Sigmas of positions are stated along easting,
northing and height of the map.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.common_errors import Effect
from photogram.factors.linearised.alike import VectorFactors
from photogram.factors.linearised.poses import AttitudeFactors, PositionFactors
from photogram.factors.linearised.rotations import cross
from photogram.factors.variables import COMMON_ERROR, CONTROL_POINT, GNSS_OFFSET, POSE, key

OWN_OFFSET_SIGMA_M = 1e-6
"""Of an offset whose prior is 0 along an axis while it is more along another: it stays there."""
NO_HEADING_SIGMA_RAD = 10.0
"""Standard deviation of a heading that is not known: more than a turn, so that it says nothing."""


def _keys(*variables: int) -> IntArray:
    return np.array([variables], dtype=np.int64)


def _known(variable: int, expected: FloatArray, whitening: FloatArray) -> VectorFactors:
    return VectorFactors(_keys(variable), (whitening[None],), (expected[None],))


def along_axes(sigma_m: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return what whitens (3, 3) a position with sigmas (3,) in m along the columns of ``axes`` (3, 3), a rotation.

    Without ``axes`` the sigmas lie along the axes of the world itself. An infinite sigma leaves its axis open.
    """
    return np.asarray((np.eye(3) if axes is None else axes.T) / sigma_m[:, None])


def surveyed_position(
    point: int, position_world_m: FloatArray, sigma_m: FloatArray, axes: FloatArray | None = None
) -> VectorFactors:
    """Return the factor of control point ``point`` surveyed at a world position (3,), m.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world.
    """
    return _known(key(CONTROL_POINT, point), position_world_m, along_axes(sigma_m, axes))


def position_jacobian(rotation_world_from_camera: FloatArray, lever_arm_camera_m: FloatArray | None) -> FloatArray:
    """Return the Jacobian (3, 6) of the antenna's position C − R l on a pose's tangent (ω, v): [R [l]× R].

    From (C + R v) − R Exp(ω) l = C − R l + R v − R (ω × l), and ω × l = −[l]× ω (Barfoot 2017, eq. 7.16).
    """
    arm = np.zeros(3) if lever_arm_camera_m is None else lever_arm_camera_m
    return np.hstack([rotation_world_from_camera @ cross(arm[None])[0], rotation_world_from_camera])


def known_rotation(photograph: int, rotation_world_from_camera: FloatArray, sigma_rad: FloatArray) -> AttitudeFactors:
    """Return the factor of a photograph's rotation (3, 3) that is known to ``sigma_rad`` (3,) about the world's
    axes."""
    W = rotation_world_from_camera / sigma_rad[:, None]
    return AttitudeFactors(_keys(key(POSE, photograph)), W[None], rotation_world_from_camera[None])


def known_place(photograph: int, position_world_m: FloatArray, whitening: FloatArray) -> PositionFactors:
    """Return the factor of a projection centre (3,), whitened by (r, 3)."""
    return PositionFactors(_keys(key(POSE, photograph)), whitening[None], position_world_m[None], np.zeros((1, 3)))


def gnss_position(
    photograph: int,
    gnss_world_m: FloatArray,
    sigma_m: FloatArray,
    flight: int | None,
    axes: FloatArray | None = None,
    lever_arm_camera_m: FloatArray | None = None,
    effects: Sequence[Effect] = (),
) -> PositionFactors:
    """Return the factor of a GNSS position (3,) in the world, m; ``flight`` names its offset, None when it has none;
    ``effects`` are those of other common errors.

    Its sigmas (3,) in m lie along the columns of ``axes`` (3, 3), the map's axes in the world; ``lever_arm_camera_m``
    (3,) points from the antenna to the projection centre. Residual C − R (l + a) − offset − shift − GNSS, with the sums
    a and shift of the effects along the camera's axes and those of the world.
    """
    moving = [] if flight is None else [(key(GNSS_OFFSET, flight), False, np.eye(3))]
    moving += [(key(COMMON_ERROR, effect.error), effect.in_camera, effect.matrix) for effect in effects]
    return PositionFactors(
        _keys(key(POSE, photograph), *(variable for variable, _, _ in moving)),
        along_axes(sigma_m, axes)[None],
        gnss_world_m[None],
        (np.zeros(3) if lever_arm_camera_m is None else lever_arm_camera_m)[None],
        tuple(matrix[None] for _, _, matrix in moving),
        tuple(in_camera for _, in_camera, _ in moving),
    )


def offset_prior(flight: int, sigma_m: FloatArray, axes: FloatArray | None = None) -> VectorFactors:
    """Return the prior of a flight's GNSS offset: zero with sigmas (3,) in m along the columns of ``axes`` (3, 3)."""
    return _known(key(GNSS_OFFSET, flight), np.zeros(3), along_axes(sigma_m, axes))


def common_offset_prior(flights: int, sigma_m: FloatArray, common_m: float, axes: FloatArray) -> VectorFactors:
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
    variables = _keys(*(key(GNSS_OFFSET, f) for f in range(n)))
    return VectorFactors(variables, tuple(block[None] for block in blocks), (np.zeros((1, 3)),) * n)


def _attitude_whitening(rotation: FloatArray, sigma_rad: float, *, heading_known: bool) -> FloatArray:
    """Return what whitens (3, 3) a measured rotation (3, 3) about the camera's axes."""
    if heading_known:
        return np.eye(3) / sigma_rad
    vertical = rotation[2]  # the world's up axis in the camera frame
    around = np.outer(vertical, vertical)
    return np.asarray((np.eye(3) - around) / sigma_rad + around / NO_HEADING_SIGMA_RAD)


def measured_attitude(
    photograph: int,
    rotation_world_from_camera: FloatArray,
    sigma_rad: float,
    *,
    heading_known: bool = True,
    error: int | None = None,
) -> AttitudeFactors:
    """Return the factor of a measured attitude (3, 3) with one sigma in rad about every axis of the camera; ``error``
    names what it has in common with others.

    With the heading unknown nothing is said about turns around the vertical of the world.
    """
    variables = [key(POSE, photograph)] + ([] if error is None else [key(COMMON_ERROR, error)])
    W = _attitude_whitening(rotation_world_from_camera, sigma_rad, heading_known=heading_known)
    return AttitudeFactors(_keys(*variables), W[None], rotation_world_from_camera[None])


def vector_prior(variable: int, expected: FloatArray, sigmas: FloatArray) -> Iterator[VectorFactors]:
    """Yield the prior of a variable (d,), of a common error or a camera's free parameters for instance, at ``expected``
    (d,) with ``sigmas`` (d,), of which an infinite one says nothing; none when all are infinite."""
    known = np.flatnonzero(np.isfinite(sigmas))
    if len(known):
        yield _known(variable, expected, (np.eye(len(sigmas)) / sigmas[:, None])[known])
