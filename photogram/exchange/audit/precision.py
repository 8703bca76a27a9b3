"""Standard deviations as other programs state them: of omega, phi, kappa, and of points along the axes of the map."""

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import omega_phi_kappa_deg
from photogram.results import Adjustment

STEP_RAD = 1e-6
"""Of the numerical derivatives of the angles."""


def exterior_sigmas(result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of omega, phi, kappa, degrees, and of projection centres, m, (N, 3) each; NaN for
    photographs that took no part.

    The covariance of rotations about the camera's axes becomes that of the angles by their derivatives.
    """
    block = result.block
    angles, centres = (np.full((len(block.poses), 3), np.nan) for _ in range(2))
    for i, pose in enumerate(block.poses):
        if pose is None:
            continue
        to_map = block.frame.rotation_world_from_map(pose.position_world_m).T
        R = to_map @ pose.rotation_world_from_camera
        jacobian = np.column_stack(
            [
                (omega_phi_kappa_deg(_turned(R, k, STEP_RAD)) - omega_phi_kappa_deg(_turned(R, k, -STEP_RAD)))
                / (2.0 * STEP_RAD)
                for k in range(3)
            ]
        )
        angles[i] = np.sqrt(np.diag(jacobian @ result.covariances.rotation_rad2[i] @ jacobian.T))
        centres[i] = _along_map(to_map, result.covariances.position_m2[i])
    return angles, centres


def ground_sigmas(result: Adjustment) -> FloatArray:
    """Return the standard deviations (G, 3) of ground points, m, NaN for those that were not intersected."""
    frame = result.block.frame
    sigma = np.full(result.estimates.ground_world_m.shape, np.nan)
    for g, (point, covariance) in enumerate(
        zip(result.estimates.ground_world_m, result.covariances.ground_m2, strict=True)
    ):
        if np.isfinite(point).all():
            sigma[g] = _along_map(frame.rotation_world_from_map(point).T, covariance)
    return sigma


def _along_map(to_map: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.diag(to_map @ covariance_m2 @ to_map.T)))


def _turned(rotation: FloatArray, axis: int, angle_rad: float) -> FloatArray:
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[a, b], [a, b]], turn[b, a], turn[a, b] = np.cos(angle_rad), np.sin(angle_rad), -np.sin(angle_rad)
    return np.asarray(rotation @ turn)
