"""Image measurements of points: residuals and Jacobians of all observations at once.

Residual = projected − measured, in px, divided by the sigma of the measurement, or L⁻¹ times it where u and v have a
covariance L Lᵀ. The pose's tangent is (ω, v) in the camera frame. A calibration variable holds only the parameters that
are free, in units of ``calibration_scale`` so that a unit of each moves a pixel by about one pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.kernels import BEHIND_PX
from photogram.measures.mark_covariances import is_isotropic, lower_factors
from photogram.projection import (
    PARAMETERS,
    RADIAL,
    READOUT,
    TANGENTIAL,
    OrientedCameras,
    fill_field_slopes,
    project_at_row,
    project_point,
    project_point_jacobians,
    without_fields,
)
from photogram.survey import ControlPoints


@dataclass(frozen=True, eq=False)
class Observations:
    """Image observations: ``photograph`` (N,), ``point`` (N,), ``pixel`` (N, 2), ``sigma_px`` (N,).

    ``mixing`` is empty where ``sigma_px`` is that of both coordinates. Else it is (N, 2), and ``sigma_px`` that of u:
    of residuals r divided by it, the second whitened one is mixing₀ r₁ + mixing₁ r₀.
    """

    photograph: IntArray
    point: IntArray
    pixel: FloatArray
    sigma_px: FloatArray
    mixing: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))

    def select(self, keep: BoolArray | IntArray) -> Observations:
        """Keep the observations of the mask (N,), or of indices."""
        mixing = self.mixing[keep] if len(self.mixing) else self.mixing
        return Observations(self.photograph[keep], self.point[keep], self.pixel[keep], self.sigma_px[keep], mixing)

    def mix(self, rows: FloatArray) -> None:
        """Whiten residuals or Jacobians (N, 2, …) that were divided by ``sigma_px``, in place."""
        if len(self.mixing):
            a, b = self.mixing.T.reshape(2, len(self), *[1] * (rows.ndim - 2))
            with np.errstate(invalid="ignore"):  # infinite residuals of points behind their cameras
                rows[:, 1] = a * rows[:, 1] + b * rows[:, 0]

    def with_penalty(self, whitened: FloatArray) -> FloatArray:
        """Return whitened residuals (N, 2), of BEHIND_PX for points behind their cameras."""
        return np.where(np.isfinite(whitened), whitened, np.array([BEHIND_PX, 0.0]) / self.sigma_px[:, None])

    def __len__(self) -> int:
        return len(self.photograph)


def observed_marks(points: ControlPoints, keep: BoolArray | IntArray) -> Observations:
    """Return the marks of the mask (M,), or of indices, as observations of their points."""
    covariance = points.mark_covariance_px2[keep]
    L, mixing = lower_factors(covariance), np.zeros((0, 2))
    if not is_isotropic(covariance).all():
        mixing = np.column_stack([L[:, 0, 0], -L[:, 1, 0]]) / L[:, 1, 1, None]
    photograph = points.mark_photograph[keep]
    point = points.mark_point[keep]
    pixel = points.mark_pixel[keep]
    return Observations(photograph, point, pixel, np.ascontiguousarray(L[:, 0, 0]), mixing)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Whitened residuals (N, 2), Jacobians on pose (N, 2, 6), interior orientation and lens field (N, 2, 12 + K) and
    point (N, 2, 3); ``camera`` (N,) of each observation."""

    residual: FloatArray
    pose: FloatArray
    calibration: FloatArray
    point: FloatArray
    camera: IntArray


@njit(cache=True, nogil=True)
def _residuals(
    photograph: IntArray, point: IntArray, pixel: FloatArray, bare: FloatArray, sigma: FloatArray,
    cameras: OrientedCameras, X: FloatArray,
) -> FloatArray:  # fmt: skip
    residual = np.empty((len(photograph), 2))
    for i in range(len(photograph)):
        u, v, depth = project_at_row(cameras, photograph[i], X[point[i]], pixel[i, 1])
        if depth > 0.0:
            residual[i, 0], residual[i, 1] = (u - bare[i, 0]) / sigma[i], (v - bare[i, 1]) / sigma[i]
        else:
            residual[i, 0] = residual[i, 1] = np.inf
    return residual


@njit(cache=True, nogil=True)
def _linearise(
    photograph: IntArray, point: IntArray, pixel: FloatArray, bare: FloatArray, sigma: FloatArray,
    cameras: OrientedCameras, X: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # fmt: skip
    count, coefficients = len(photograph), cameras.functions.shape[4]
    residual, J_pose = np.empty((count, 2)), np.empty((count, 2, 6))
    J_camera, J_point = np.empty((count, 2, cameras.parameters.shape[1])), np.empty((count, 2, 3))
    for i in range(count):
        u, v, depth = project_point_jacobians(
            cameras, photograph[i], X[point[i]], pixel[i, 1], J_pose[i], J_camera[i], J_point[i]
        )
        if depth > 0.0:
            residual[i, 0], residual[i, 1] = (u - bare[i, 0]) / sigma[i], (v - bare[i, 1]) / sigma[i]
        else:
            residual[i, 0] = residual[i, 1] = 0.0
        if coefficients and depth > 0.0:
            c = cameras.camera[photograph[i]]
            fill_field_slopes(cameras, c, pixel[i, 0], pixel[i, 1], 1.0, coefficients, J_camera[i], 0, PARAMETERS)
        for row in range(2):  # written out: numba compiles operations on slices for seconds
            for k in range(6):
                J_pose[i, row, k] /= sigma[i]
            for k in range(J_camera.shape[2]):
                J_camera[i, row, k] /= sigma[i]
            for k in range(3):
                J_point[i, row, k] /= sigma[i]
    return residual, J_pose, J_camera, J_point


@njit(cache=True, nogil=True)
def _projected(photograph: IntArray, point: IntArray, cameras: OrientedCameras, X: FloatArray) -> FloatArray:
    pixel = np.empty((len(photograph), 2))
    for i in range(len(photograph)):
        pixel[i, 0], pixel[i, 1], _ = project_point(cameras, photograph[i], X[point[i]])
    return pixel


def predicted(photograph: IntArray, point: IntArray, cameras: OrientedCameras, X: FloatArray) -> Observations:
    """Return observations of points X (P, 3) where photographs (N,) show points (N,) of them, with a sigma of 1 px; NaN
    behind a camera."""
    pixel = _projected(photograph, point, cameras, X)
    return Observations(photograph, point, pixel, np.ones(len(point)))


def residuals(observations: Observations, cameras: OrientedCameras, X: FloatArray) -> FloatArray:
    """Return whitened residuals (N, 2) of points X (P, 3) in the world, m; infinite for points at or behind the
    projection centre."""
    o, bare = observations, without_fields(cameras, observations.photograph, observations.pixel)
    whitened = _residuals(o.photograph, o.point, o.pixel, bare, o.sigma_px, cameras, X)
    o.mix(whitened)
    whitened[np.isinf(whitened[:, 0]), 1] = np.inf
    return whitened


def linearise(observations: Observations, cameras: OrientedCameras, X: FloatArray) -> Linearisation:
    """Return whitened residuals and analytic Jacobians of all observations of points X (P, 3) in the world, m.

    Points at or behind the projection centre pull at nothing: theirs are zero.
    """
    o, bare = observations, without_fields(cameras, observations.photograph, observations.pixel)
    residual, pose, calibration, point = _linearise(o.photograph, o.point, o.pixel, bare, o.sigma_px, cameras, X)
    for rows in (residual, pose, calibration, point):
        o.mix(rows)
    return Linearisation(residual, pose, calibration, point, cameras.camera[o.photograph])


def calibration_scale(focal_px: float, coefficients: int = 0) -> FloatArray:
    """Return the units (12 + K,) in which calibration variables are solved: 1 px, also of the affinity and of the K
    ``coefficients`` of a lens field, 1/f for the distortion coefficients, and 1 ms for the read-out time."""
    unit = np.ones(PARAMETERS + coefficients)
    unit[RADIAL] = unit[TANGENTIAL] = 1.0 / focal_px
    unit[READOUT] = 1e-3
    return unit
