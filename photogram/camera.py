"""Interior and exterior orientation, projection and its Jacobians.

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

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, radians, sin
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photogram.compilation import njit
from photogram.errors import ImageError

FloatArray = NDArray[np.float64]

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

VERTICAL = 1e-7
"""Level part of an optical axis, of unit length, below which it counts as vertical."""


def _zeros(n: int) -> FloatArray:
    return np.zeros(n)


def all_parameters(values: FloatArray) -> FloatArray:
    """Return values (11,) of all parameters: of those in CLASSIC (8,), with zeros for the others."""
    if values.shape != (np.count_nonzero(CLASSIC),):
        return values
    full = _zeros(PARAMETERS)
    full[CLASSIC] = values
    return full


def models_of(cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """Return the models (cameras,) of cameras, by their numbers in MODELS."""
    return np.array([camera.kind for camera in cameras], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Camera:
    """Interior orientation of one camera.

    ``principal_point_px`` (2,), ``radial`` (4,) k1 k2 k3 k4, ``tangential`` (2,) p1 p2, ``affinity`` (2,) b1 b2.
    ``sigmas`` (11,) in the order of PARAMETER_NAMES: 0 holds a parameter fixed, a positive value is its prior standard
    deviation, infinity leaves it free. ``radial`` may lack k4, ``sigmas`` those of k4, b1 and b2 (CLASSIC): zero then.
    ``considered_focal_sigma_px`` is that of a focal length which the adjustment does not change but which counts in
    every covariance all the same (a consider parameter: Tapley, Schutz & Born 2004, sec. 6.2); 0 for any other.
    """

    name: str
    width_px: int
    height_px: int
    focal_px: float
    principal_point_px: FloatArray
    radial: FloatArray = field(default_factory=lambda: _zeros(4))
    tangential: FloatArray = field(default_factory=lambda: _zeros(2))
    sigmas: FloatArray = field(default_factory=lambda: _zeros(PARAMETERS))
    affinity: FloatArray = field(default_factory=lambda: _zeros(2))
    model: Model = "brown"
    considered_focal_sigma_px: float = 0.0

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ValueError(f"camera {self.name}: its model is {self.model!r}, expected {' or '.join(MODELS)}")
        sizes = {"principal_point_px": 2, "radial": RADIAL_TERMS, "tangential": 2, "sigmas": PARAMETERS, "affinity": 2}
        for name, size in sizes.items():
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if name == "radial" and array.shape == (3,):
                array = np.append(array, 0.0)
            elif name == "sigmas":
                array = all_parameters(array)
            if array.shape != (size,):
                raise ValueError(f"camera {self.name}: {name} has shape {array.shape}, expected ({size},)")
            object.__setattr__(self, name, array)
        if not self.focal_px > 0:
            raise ValueError(f"camera {self.name}: the focal length must be positive, not {self.focal_px}")

    @property
    def parameters(self) -> FloatArray:
        """Return the interior orientation (11,) in the order of PARAMETER_NAMES."""
        return np.array([self.focal_px, *self.principal_point_px, *self.radial, *self.tangential, *self.affinity])

    def with_parameters(self, parameters: FloatArray) -> Camera:
        """Return the same camera with the interior orientation ``parameters`` (11,), or (8,) as in CLASSIC."""
        q = all_parameters(np.asarray(parameters, dtype=np.float64))
        if q.shape != (PARAMETERS,):
            raise ValueError(f"camera {self.name}: parameters of shape {q.shape}, expected ({PARAMETERS},)")
        return replace(
            self,
            focal_px=float(q[0]),
            principal_point_px=q[1:3].copy(),
            radial=q[RADIAL].copy(),
            tangential=q[TANGENTIAL].copy(),
            affinity=q[AFFINITY].copy(),
        )

    @property
    def kind(self) -> int:
        """Return the number by which compiled code knows the camera's model."""
        return MODELS[self.model]

    @property
    def matrix(self) -> FloatArray:
        """Return the calibration matrix K (3, 3)."""
        cx, cy = self.principal_point_px
        return np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]])

    @property
    def _fold(self) -> float:
        """Return the r up to which the radial distortion grows; infinite without end."""
        k1, k2, k3, k4 = self.radial
        slope = np.array([9.0 * k4, 7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
        # Coefficients that do nothing within any field of view would send the other roots to infinity.
        squares = np.roots(np.where(np.abs(slope) < 1e-12, 0.0, slope))
        real = squares.real[(np.abs(squares.imag) < 1e-12) & (squares.real > 0)]
        return float(np.sqrt(real.min())) if len(real) else float("inf")

    @property
    def largest_radius(self) -> float:
        """Return the ideal radius, at unit focal length, up to which the radial distortion grows; infinite without end.

        Beyond it the polynomial folds back and would show points from far outside within the photograph.
        """
        fold = self._fold
        if self.model == "brown":
            return fold
        return float(np.tan(fold)) if fold < np.pi / 2 else float("inf")

    @property
    def largest_image_radius(self) -> float:
        """Return the radius in the photograph, at unit focal length, up to which the projection can be undone: where
        the radial distortion folds back, or a fisheye looks sideways; infinite without end."""
        r = self._fold if self.model == "brown" else min(self._fold, np.pi / 2)
        return float(r * (1.0 + r**2 * np.polyval(self.radial[::-1], r**2))) if np.isfinite(r) else float("inf")

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


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _project_all(model: int, q: FloatArray, R: FloatArray, C: FloatArray, X: FloatArray) -> FloatArray:
    pixel = np.empty((len(X), 2))
    for i in range(len(X)):
        pixel[i, 0], pixel[i, 1], _ = project_point(model, q, R, C, X[i])
    return pixel


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _distort_all(model: int, q: FloatArray, ideal: FloatArray) -> FloatArray:
    pixel = np.empty_like(ideal)
    for i in range(len(ideal)):
        x, y = ideal[i, 0], ideal[i, 1]
        if model == FISHEYE:
            s, _, _ = equidistant(x, y, 1.0)
            x, y = x * s, y * s
        xd, yd, _, _, _ = distort_point(q, x, y)
        pixel[i, 0], pixel[i, 1] = pixel_of(q, xd, yd)
    return pixel


@njit(cache=True)  # type: ignore[misc, unused-ignore]
def _undistort_all(model: int, q: FloatArray, pixel: FloatArray) -> FloatArray:
    ideal = np.empty_like(pixel)
    for i in range(len(pixel)):
        ideal[i, 0], ideal[i, 1] = ideal_point(model, q, pixel[i, 0], pixel[i, 1])
    return ideal


def _contiguous(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(array, dtype=np.float64)


def project(camera: Camera, pose: Pose, points_world_m: FloatArray) -> FloatArray:
    """Project points (N, 3) of the world frame to pixels (N, 2).

    NaN for points at or behind the projection centre, and for those so far off the axis that the distortion folds back.
    """
    R = _contiguous(pose.rotation_world_from_camera)
    pixel: FloatArray = _project_all(
        camera.kind, camera.parameters, R, _contiguous(pose.position_world_m), _contiguous(points_world_m)
    )
    limit = camera.largest_radius
    if np.isfinite(limit):
        x, y, z = pose.camera_from_world(points_world_m).T
        pixel[np.hypot(x, y) >= limit * z] = np.nan
    return pixel


def image_plane_or_nan(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the ideal image-plane coordinates (X/Z, Y/Z) (N, 2) of pixels (N, 2), NaN where the model cannot be
    inverted, or a fisheye looks 90° or more off its axis."""
    ideal: FloatArray = _undistort_all(camera.kind, camera.parameters, _contiguous(pixel))
    return ideal


def image_plane(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the ideal image-plane coordinates (X/Z, Y/Z) (N, 2) of pixels (N, 2), whatever the model.

    Raises ImageError where the model cannot be inverted, or a fisheye looks 90° or more off its axis.
    """
    ideal = image_plane_or_nan(camera, pixel)
    lost = np.isnan(ideal).any(axis=1) & ~np.isnan(pixel).any(axis=1)
    if lost.any():
        u, v = pixel[lost][0]
        sideways = ", which must be less than 90° off the axis" if camera.model == "fisheye" else ""
        raise ImageError(
            f"camera {camera.name}: its distortion (k1 k2 k3 k4 = {camera.radial.tolist()}) cannot be undone at pixel "
            f"({u:.1f}, {v:.1f}){sideways}: check the coefficients and their order, or leave out marks that far from "
            "the centre"
        )
    return ideal


def undistort(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Remove distortion and affinity from pixels (N, 2), and the bend of a fisheye; the result is where a pinhole of
    the same K would see them.

    Raises ImageError where the distortion model cannot be inverted.
    """
    return image_plane(camera, pixel) * camera.focal_px + camera.principal_point_px


def distort(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Apply distortion and affinity to ideal pixels (N, 2), and the bend of a fisheye; the inverse of undistort."""
    ideal = (_contiguous(pixel) - camera.principal_point_px) / camera.focal_px
    distorted: FloatArray = _distort_all(camera.kind, camera.parameters, ideal)
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
