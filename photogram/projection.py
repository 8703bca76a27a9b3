"""The projection of a point into a photograph, its inverse and its Jacobians, for compiled code.

Two models, in the camera frame (x right, y down, z forward):

    brown:    (x, y) = (X/Z, Y/Z)                  Brown–Conrady (Brown 1971, eq. 7–8), as OpenCV evaluates it
    fisheye:  (x, y) = (X, Y)/ρ · θ,               equidistant (Kannala & Brandt 2006, eq. 6); p1 = p2 = 0: cv2.fisheye
              ρ = hypot(X, Y), θ = atan2(ρ, Z)

and then for both, with r² = x² + y²,

    x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2 x²)
    y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + p1 (r² + 2 y²) + 2 p2 x y
    u = f x_d + cx + b1 x_d + b2 y_d,  v = f y_d + cy

A point must lie in front of the camera, Z > 0, in both models: the field of view of a fisheye is below 180°. Ideal
coordinates are (X/Z, Y/Z), whatever the model. Pixel frame: the centre of the top-left pixel is (0, 0). The project
owns its projection because GTSAM's has no k3.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.compilation import njit

Model = Literal["brown", "fisheye"]

PARAMETER_NAMES = ("focal_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2")
"""The order of interior orientation in every parameter vector of photogram."""

PARAMETERS = len(PARAMETER_NAMES)

RADIAL, TANGENTIAL, AFFINITY = slice(3, 7), slice(7, 9), slice(9, 11)

RADIAL_TERMS = RADIAL.stop - RADIAL.start

CLASSIC = np.array([name not in ("k4", "b1", "b2") for name in PARAMETER_NAMES])
"""The eight parameters that most sources give; the others are zero, and held, where a vector leaves them out."""

BROWN, FISHEYE = 0, 1

SIDEWAYS = 4.0  # ideal radius, 76° off the axis, from which a fisheye is no pinhole even when its bend is undone

PROJECTIVE = 2  # as BROWN, but what lies behind is seen too, through the centre: no photograph, for published problems

MODELS: dict[Model, int] = {"brown": BROWN, "fisheye": FISHEYE}
"""The numbers by which compiled code knows the models."""

NEAR_AXIS = 1e-3
"""(ρ/Z)² below which the fisheye is evaluated by its series: the closed form loses its digits there."""


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[misc, unused-ignore]
def equidistant(px: float, py: float, pz: float) -> tuple[float, float, float]:
    """Return s = θ/ρ of a point p in front of a fisheye, so that (x, y) = s (X, Y), and t and e of its derivatives.

    ∂s/∂ρ = t ρ, ∂s/∂Z = −e; with w = ρ/Z: s = (1 − w²/3 + w⁴/5 …)/Z, t = (−2/3 + 4/5 w² − 6/7 w⁴ …)/Z³ near the axis.
    """
    rho2 = px * px + py * py
    e = 1.0 / (rho2 + pz * pz)
    w2 = rho2 / (pz * pz)
    if w2 < NEAR_AXIS:
        s = (1.0 - w2 * (1 / 3 - w2 * (1 / 5 - w2 * (1 / 7 - w2 * (1 / 9 - w2 / 11))))) / pz
        t = (-2 / 3 + w2 * (4 / 5 - w2 * (6 / 7 - w2 * (8 / 9 - w2 * (10 / 11 - w2 * 12 / 13))))) / (pz * pz * pz)
        return s, t, e
    rho = np.sqrt(rho2)
    s = np.arctan2(rho, pz) / rho
    return s, (pz * e - s) / rho2, e


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def distort_point(q: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Distort image-plane coordinates (x, y) of either model; returns x_d, y_d and the Jacobian entries ∂x_d/∂x,
    ∂x_d/∂y = ∂y_d/∂x, ∂y_d/∂y."""
    k1, k2, k3, k4, p1, p2 = q[3], q[4], q[5], q[6], q[7], q[8]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4)))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    a = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    b = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    d = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return xd, yd, a, b, d


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def pixel_of(q: FloatArray, xd: float, yd: float) -> tuple[float, float]:
    """Return the pixel of distorted image-plane coordinates."""
    return q[0] * xd + q[1] + (q[9] * xd + q[10] * yd), q[0] * yd + q[2]


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def project_point(model: int, q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray) -> tuple[float, float, float]:
    """Project X (3,) by a model of MODELS with interior orientation q (11,), rotation world from camera R and centre C;
    returns u, v and the depth in m.

    The pixel of a point with depth at or below zero means nothing: the caller must test the depth.
    """
    dx, dy, dz = X[0] - C[0], X[1] - C[1], X[2] - C[2]
    px = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
    py = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    pz = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
    if pz <= 0.0:
        return np.nan, np.nan, pz
    if model == FISHEYE:
        s, _, _ = equidistant(px, py, pz)
        x, y = px * s, py * s
    else:
        x, y = px / pz, py / pz
    xd, yd, _, _, _ = distort_point(q, x, y)
    u, v = pixel_of(q, xd, yd)
    return u, v, pz


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def project_point_jacobians(
    model: int,
    q: FloatArray,
    R: FloatArray,
    C: FloatArray,
    X: FloatArray,
    J_pose: FloatArray,
    J_camera: FloatArray,
    J_point: FloatArray,
) -> tuple[float, float, float]:
    """Project as project_point and fill the Jacobians of (u, v): pose (2, 6), interior orientation (2, 11), point (2,
    3).

    The pose's tangent is (ω, v) in the camera frame, R' = R Exp(ω), C' = C + R v to first order, as GTSAM's Pose3
    (Dellaert & Kaess 2017, sec. 6.3): with p = Rᵀ(X − C), ∂p/∂ω = [p]ₓ, ∂p/∂v = −I, ∂p/∂X = Rᵀ. In both models
    (x, y) = s (p_x, p_y), see equidistant; Brown's has s = 1/p_z.
    """
    dx, dy, dz = X[0] - C[0], X[1] - C[1], X[2] - C[2]
    px = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
    py = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    pz = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
    if pz <= 0.0:
        J_pose[:] = 0.0
        J_camera[:] = 0.0
        J_point[:] = 0.0
        return np.nan, np.nan, pz
    f, b1, b2 = q[0], q[9], q[10]
    s, t, e = 1.0 / pz, 0.0, 1.0 / (pz * pz)
    x, y = px / pz, py / pz
    if model == FISHEYE:
        s, t, e = equidistant(px, py, pz)
        x, y = px * s, py * s
    xd, yd, a, b, d = distort_point(q, x, y)
    for row in range(2):
        gx, gy = f * b, f * d
        if row == 0:
            gx, gy = (f + b1) * a + b2 * b, (f + b1) * b + b2 * d
        along = gx * px + gy * py
        g0, g1, g2 = gx * s + along * t * px, gy * s + along * t * py, -along * e
        J_pose[row, 0] = g1 * pz - g2 * py
        J_pose[row, 1] = g2 * px - g0 * pz
        J_pose[row, 2] = g0 * py - g1 * px
        J_pose[row, 3] = -g0
        J_pose[row, 4] = -g1
        J_pose[row, 5] = -g2
        for k in range(3):
            J_point[row, k] = R[k, 0] * g0 + R[k, 1] * g1 + R[k, 2] * g2
    r2 = x * x + y * y
    J_camera[0, 0], J_camera[1, 0] = xd, yd
    J_camera[0, 1], J_camera[1, 1] = 1.0, 0.0
    J_camera[0, 2], J_camera[1, 2] = 0.0, 1.0
    du, dv, power = (f + b1) * x + b2 * y, f * y, 1.0
    for k in range(3, 7):
        power *= r2
        J_camera[0, k], J_camera[1, k] = power * du, power * dv
    xy2, xx3, yy3 = 2.0 * x * y, r2 + 2.0 * x * x, r2 + 2.0 * y * y
    J_camera[0, 7], J_camera[1, 7] = (f + b1) * xy2 + b2 * yy3, f * yy3
    J_camera[0, 8], J_camera[1, 8] = (f + b1) * xx3 + b2 * xy2, f * xy2
    J_camera[0, 9], J_camera[1, 9] = xd, 0.0
    J_camera[0, 10], J_camera[1, 10] = yd, 0.0
    u, v = pixel_of(q, xd, yd)
    return u, v, pz


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def undistort_point(q: FloatArray, xd: float, yd: float) -> tuple[float, float]:
    """Invert distort_point by Newton's method with its analytic Jacobian; NaN where it does not converge."""
    x, y = xd, yd
    for _ in range(50):
        fx, fy, a, b, d = distort_point(q, x, y)
        ex, ey = xd - fx, yd - fy
        determinant = a * d - b * b
        if not determinant > 1e-3:
            return np.nan, np.nan
        sx, sy = (d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant
        x += sx
        y += sy
        if sx * sx + sy * sy < 1e-30 * (1.0 + x * x + y * y):
            return x, y
    if ex * ex + ey * ey < 1e-26:
        return x, y
    return np.nan, np.nan


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def ideal_point(model: int, q: FloatArray, u: float, v: float) -> tuple[float, float]:
    """Return the ideal coordinates (X/Z, Y/Z) that a pixel shows; NaN where the model cannot be undone, such as where a
    fisheye looks sideways."""
    yd = (v - q[2]) / q[0]
    xd = (u - q[1] - q[10] * yd) / (q[0] + q[9])
    x, y = undistort_point(q, xd, yd)
    if model != FISHEYE:
        return x, y
    theta = np.sqrt(x * x + y * y)
    if not theta < np.pi / 2:
        return np.nan, np.nan
    if theta * theta < NEAR_AXIS:
        w2 = theta * theta
        stretch = 1.0 + w2 * (1 / 3 + w2 * (2 / 15 + w2 * (17 / 315 + w2 * (62 / 2835 + w2 * 1382 / 155925))))
    else:
        stretch = np.tan(theta) / theta
    return x * stretch, y * stretch


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def seen_at(
    model: int, q: FloatArray, R: FloatArray, C: FloatArray, largest_radius: float, X: FloatArray
) -> tuple[float, float, float]:
    """Return u, v and the depth of X (3,) as ``project_point``; NaN for u and v where the point lies behind the camera
    or beyond the radius at which the distortion folds back."""
    u, v, depth = project_point(model, q, R, C, X)
    if np.isfinite(largest_radius) and depth > 0.0:
        dx, dy, dz = X[0] - C[0], X[1] - C[1], X[2] - C[2]
        px = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
        py = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
        if px * px + py * py > (largest_radius * depth) ** 2:
            return np.nan, np.nan, depth
    return u, v, depth
