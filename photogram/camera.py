"""Interior and exterior orientation, projection and its Jacobians.

Brown–Conrady model (Brown 1971, eq. 7–8), as OpenCV evaluates it: with (x, y) = (X/Z, Y/Z) in the camera frame (x
right, y down, z forward) and r² = x² + y²,

    x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
    y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
    u = f x_d + cx,  v = f y_d + cy

Pixel frame: the centre of the top-left pixel is (0, 0). The project owns its projection because GTSAM's has no k3.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, radians, sin

import numpy as np
from numba import njit
from numpy.typing import NDArray

from photogram.errors import ImageError

FloatArray = NDArray[np.float64]

PARAMETER_NAMES = ("focal_px", "cx_px", "cy_px", "k1", "k2", "k3", "p1", "p2")
"""The order of interior orientation in every parameter vector of photogram."""


VERTICAL = 1e-7
"""Level part of an optical axis, of unit length, below which it counts as vertical."""


def _zeros(n: int) -> FloatArray:
    return np.zeros(n)


@dataclass(frozen=True, eq=False)
class Camera:
    """Interior orientation of one camera.

    ``principal_point_px`` (2,), ``radial`` (3,) k1 k2 k3, ``tangential`` (2,) p1 p2. ``sigmas`` (8,) in the order of
    PARAMETER_NAMES: 0 holds a parameter fixed, a positive value is its prior standard deviation, infinity leaves it
    free.
    """

    name: str
    width_px: int
    height_px: int
    focal_px: float
    principal_point_px: FloatArray
    radial: FloatArray = field(default_factory=lambda: _zeros(3))
    tangential: FloatArray = field(default_factory=lambda: _zeros(2))
    sigmas: FloatArray = field(default_factory=lambda: _zeros(8))

    def __post_init__(self) -> None:
        for name, size in (("principal_point_px", 2), ("radial", 3), ("tangential", 2), ("sigmas", 8)):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != (size,):
                raise ValueError(f"camera {self.name}: {name} has shape {array.shape}, expected ({size},)")
            object.__setattr__(self, name, array)
        if not self.focal_px > 0:
            raise ValueError(f"camera {self.name}: the focal length must be positive, not {self.focal_px}")

    @property
    def parameters(self) -> FloatArray:
        """Return the interior orientation (8,) in the order of PARAMETER_NAMES."""
        return np.array([self.focal_px, *self.principal_point_px, *self.radial, *self.tangential])

    def with_parameters(self, parameters: FloatArray) -> Camera:
        """Return the same camera with the interior orientation ``parameters`` (8,)."""
        return replace(
            self,
            focal_px=float(parameters[0]),
            principal_point_px=np.array(parameters[1:3]),
            radial=np.array(parameters[3:6]),
            tangential=np.array(parameters[6:8]),
        )

    @property
    def matrix(self) -> FloatArray:
        """Return the calibration matrix K (3, 3)."""
        cx, cy = self.principal_point_px
        return np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]])

    @property
    def largest_radius(self) -> float:
        """Return the ideal radius, at unit focal length, up to which the radial distortion grows; infinite without end.

        Beyond it the polynomial folds back and would show points from far outside within the photograph.
        """
        k1, k2, k3 = self.radial
        slope = np.array([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
        # Coefficients that do nothing within any field of view would send the other roots to infinity.
        squares = np.roots(np.where(np.abs(slope) < 1e-12, 0.0, slope))
        real = squares.real[(np.abs(squares.imag) < 1e-12) & (squares.real > 0)]
        return float(np.sqrt(real.min())) if len(real) else float("inf")

    def contains(self, pixel: FloatArray) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) lie within the photograph."""
        limit = np.array([self.width_px, self.height_px]) - 0.5
        return np.asarray(np.all((pixel >= -0.5) & (pixel <= limit), axis=-1))


@dataclass(frozen=True, eq=False)
class Pose:
    """Exterior orientation: ``rotation_world_from_camera`` (3, 3) and the projection centre ``position_world_m``
    (3,)."""

    rotation_world_from_camera: FloatArray
    position_world_m: FloatArray

    def __post_init__(self) -> None:
        if self.rotation_world_from_camera.shape != (3, 3) or self.position_world_m.shape != (3,):
            raise ValueError("a pose is a rotation (3, 3) and a position (3,)")

    def camera_from_world(self, points_world_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the world frame to the camera frame, in metres."""
        return (points_world_m - self.position_world_m) @ self.rotation_world_from_camera

    def world_from_camera(self, points_camera_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the camera frame to the world frame, in metres."""
        return points_camera_m @ self.rotation_world_from_camera.T + self.position_world_m


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def distort_point(q: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Distort ideal image-plane coordinates; returns x_d, y_d and the Jacobian entries ∂x_d/∂x, ∂x_d/∂y = ∂y_d/∂x,
    ∂y_d/∂y."""
    k1, k2, k3, p1, p2 = q[3], q[4], q[5], q[6], q[7]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    a = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    b = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    d = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return xd, yd, a, b, d


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def project_point(q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray) -> tuple[float, float, float]:
    """Project X (3,) by interior orientation q (8,), rotation world from camera R and centre C; returns u, v and the
    depth in m.

    The pixel of a point with depth at or below zero means nothing: the caller must test the depth.
    """
    dx, dy, dz = X[0] - C[0], X[1] - C[1], X[2] - C[2]
    px = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
    py = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    pz = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
    if pz <= 0.0:
        return np.nan, np.nan, pz
    xd, yd, _, _, _ = distort_point(q, px / pz, py / pz)
    return q[0] * xd + q[1], q[0] * yd + q[2], pz


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def project_point_jacobians(
    q: FloatArray,
    R: FloatArray,
    C: FloatArray,
    X: FloatArray,
    J_pose: FloatArray,
    J_camera: FloatArray,
    J_point: FloatArray,
) -> tuple[float, float, float]:
    """Project as project_point and fill the Jacobians of (u, v): pose (2, 6), interior orientation (2, 8), point (2,
    3).

    The pose's tangent is (ω, v) in the camera frame, R' = R Exp(ω), C' = C + R v to first order, as GTSAM's Pose3
    (Dellaert & Kaess 2017, sec. 6.3): with p = Rᵀ(X − C), ∂p/∂ω = [p]ₓ, ∂p/∂v = −I, ∂p/∂X = Rᵀ.
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
    f = q[0]
    x, y = px / pz, py / pz
    xd, yd, a, b, d = distort_point(q, x, y)
    w = f / pz
    for row in range(2):
        gx, gy = (a, b) if row == 0 else (b, d)
        g0, g1, g2 = w * gx, w * gy, -w * (gx * x + gy * y)
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
    power = f
    for k in range(3, 6):
        power *= r2
        J_camera[0, k], J_camera[1, k] = power * x, power * y
    J_camera[0, 6], J_camera[1, 6] = f * 2.0 * x * y, f * (r2 + 2.0 * y * y)
    J_camera[0, 7], J_camera[1, 7] = f * (r2 + 2.0 * x * x), f * 2.0 * x * y
    return f * xd + q[1], f * yd + q[2], pz


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
def _project_all(q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray) -> FloatArray:
    pixel = np.empty((len(X), 2))
    for i in range(len(X)):
        pixel[i, 0], pixel[i, 1], _ = project_point(q, R, C, X[i])
    return pixel


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _distort_all(q: FloatArray, ideal: FloatArray) -> FloatArray:
    pixel = np.empty_like(ideal)
    for i in range(len(ideal)):
        xd, yd, _, _, _ = distort_point(q, ideal[i, 0], ideal[i, 1])
        pixel[i, 0], pixel[i, 1] = q[0] * xd + q[1], q[0] * yd + q[2]
    return pixel


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _undistort_all(q: FloatArray, pixel: FloatArray) -> FloatArray:
    ideal = np.empty_like(pixel)
    for i in range(len(pixel)):
        ideal[i, 0], ideal[i, 1] = undistort_point(q, (pixel[i, 0] - q[1]) / q[0], (pixel[i, 1] - q[2]) / q[0])
    return ideal


def _contiguous(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(array, dtype=np.float64)


def project(camera: Camera, pose: Pose, points_world_m: FloatArray) -> FloatArray:
    """Project points (N, 3) of the world frame to pixels (N, 2).

    NaN for points at or behind the projection centre, and for those so far off the axis that the distortion folds back.
    """
    R = _contiguous(pose.rotation_world_from_camera)
    pixel: FloatArray = _project_all(
        camera.parameters, R, _contiguous(pose.position_world_m), _contiguous(points_world_m)
    )
    limit = camera.largest_radius
    if np.isfinite(limit):
        x, y, z = pose.camera_from_world(points_world_m).T
        pixel[np.hypot(x, y) >= limit * z] = np.nan
    return pixel


def image_plane(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the ideal, distortion-free image-plane coordinates (N, 2), unit focal length, of pixels (N, 2).

    Raises ImageError where the distortion model cannot be inverted.
    """
    ideal: FloatArray = _undistort_all(camera.parameters, _contiguous(pixel))
    lost = np.isnan(ideal).any(axis=1) & ~np.isnan(pixel).any(axis=1)
    if lost.any():
        u, v = pixel[lost][0]
        raise ImageError(
            f"camera {camera.name}: its distortion (k1 k2 k3 = {camera.radial.tolist()}) cannot be undone at pixel "
            f"({u:.1f}, {v:.1f}): check the coefficients and their order, or leave out marks that far from the centre"
        )
    return ideal


def undistort(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Remove radial and tangential distortion from pixels (N, 2); the result is where a pinhole of the same K would
    see them.

    Raises ImageError where the distortion model cannot be inverted.
    """
    return image_plane(camera, pixel) * camera.focal_px + camera.principal_point_px


def distort(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Apply radial and tangential distortion to ideal pixels (N, 2); the inverse of undistort."""
    ideal = (_contiguous(pixel) - camera.principal_point_px) / camera.focal_px
    distorted: FloatArray = _distort_all(camera.parameters, ideal)
    return distorted


def unproject(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return unit directions (N, 3) in the camera frame of pixels (N, 2). Raises ImageError as image_plane does."""
    ideal = image_plane(camera, pixel)
    ray = np.column_stack([ideal, np.ones(len(ideal))])
    return np.asarray(ray / np.linalg.norm(ray, axis=1, keepdims=True))


def rotation_from_gimbal(yaw_deg: float, pitch_deg: float, roll_deg: float) -> FloatArray:
    """Return the rotation (3, 3) from the camera (x right, y down, z forward) to east, north, up by DJI gimbal angles.

    Yaw is clockwise from true north, pitch above the horizon (−90 looks straight down, the picture's top then points to
    the yaw), roll right side down. With body axes forward, right, down and local axes north, east, down (ISO 1151-2):

        R = E Rz(yaw) Ry(pitch) Rx(roll) B,   E: east, north, up from north, east, down;   B: body from camera

    North is true north: for the north of a map grid subtract the meridian convergence from the yaw first.
    """
    y, p, r = radians(yaw_deg), radians(pitch_deg), radians(roll_deg)
    Rz = np.array([[cos(y), -sin(y), 0.0], [sin(y), cos(y), 0.0], [0.0, 0.0, 1.0]])
    Ry = np.array([[cos(p), 0.0, sin(p)], [0.0, 1.0, 0.0], [-sin(p), 0.0, cos(p)]])
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, cos(r), -sin(r)], [0.0, sin(r), cos(r)]])
    E = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    B = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return np.asarray(E @ Rz @ Ry @ Rx @ B)


def gimbal_from_rotation(rotation_true_north: FloatArray) -> tuple[float, float, float]:
    """Return yaw, pitch and roll in degrees of a rotation (3, 3) from the camera to east, north, up:
    rotation_from_gimbal undone.

    Of a photograph that looks straight down or up only the sum or the difference of yaw and roll is known: roll is 0
    there.
    """
    E = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    B = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    M = E.T @ rotation_true_north @ B.T
    level = np.hypot(M[0, 0], M[1, 0])
    pitch = np.arctan2(-M[2, 0], level)  # the arcsine of nearly 1 would lose half of the digits
    if level < VERTICAL:
        return float(np.rad2deg(np.arctan2(-M[0, 1], M[1, 1]))), float(np.rad2deg(pitch)), 0.0
    yaw, roll = np.arctan2(M[1, 0], M[0, 0]), np.arctan2(M[2, 1], M[2, 2])
    return float(np.rad2deg(yaw)), float(np.rad2deg(pitch)), float(np.rad2deg(roll))


def omega_phi_kappa_deg(rotation_map_from_camera: FloatArray) -> FloatArray:
    """Return the photogrammetric angles (3,) in degrees of a rotation from the camera to easting, northing, up.

    R = Rx(ω) Ry(φ) Rz(κ) diag(1, −1, −1): the photogrammetric image frame has x right, y up, z backward (Kraus 2007,
    sec. 2.1).
    """
    R = rotation_map_from_camera @ np.diag([1.0, -1.0, -1.0])
    return np.rad2deg(
        [np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(np.clip(R[0, 2], -1.0, 1.0)), np.arctan2(-R[0, 1], R[0, 0])]
    )
