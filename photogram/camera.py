"""Interior and exterior orientation: cameras, poses, and what they make of arrays of points and pixels.

The camera models and the frames are those of `photogram.projection`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, radians, sin

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.errors import ImageError
from photogram.projection import (
    AFFINITY,
    CENTRE,
    FISHEYE,
    FOCAL,
    MODELS,
    PARAMETERS,
    RADIAL,
    RADIAL_TERMS,
    READOUT,
    TANGENTIAL,
    Model,
    OrientedCameras,
    distorted,
    equidistant,
    ideal_point,
    lens_of,
    pixel_of,
    project_point,
    shift_at,
)

VERTICAL = 1e-7
"""Level part of an optical axis, of unit length, below which it counts as vertical."""

_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

_ALONG_EASTING = 1e-9
"""What of an optical axis, of unit length, is not along the easting below which φ counts as ±90°."""


def _zeros(n: int) -> FloatArray:
    return np.zeros(n)


@dataclass(frozen=True, eq=False)
class LensField:
    """A smooth correction over the picture of a camera beside its parameters, in px.

    ``functions`` (R, Q, 2, K): K functions for u and v at the nodes of a lattice of R rows and Q columns, evenly spaced
    from edge to edge of the picture, bilinear between them; the field is their sum with the ``coefficients`` (K,).
    ``sigmas`` (K,): prior standard deviations of the coefficients, px; zeros hold them fixed.
    """

    functions: FloatArray
    coefficients: FloatArray
    sigmas: FloatArray

    def __post_init__(self) -> None:
        rows, columns, _, count = self.functions.shape
        if self.functions.shape[2] != 2 or min(rows, columns) < 2:
            raise ValueError(f"a lens field has functions (R, Q, 2, K), R and Q at least 2, not {self.functions.shape}")
        if self.coefficients.shape != (count,) or self.sigmas.shape != (count,):
            raise ValueError(f"a lens field of {count} functions has as many coefficients and sigmas")
        if np.any(self.sigmas > 0.0) and not np.all(self.sigmas > 0.0):
            raise ValueError("the coefficients of a lens field are all fixed or all free")

    @property
    def shift(self) -> FloatArray:
        """Return the field at the nodes (R, Q, 2), px."""
        return np.asarray(self.functions @ self.coefficients)

    @property
    def fixed(self) -> LensField:
        """Return the field with its coefficients fixed."""
        return replace(self, sigmas=np.zeros_like(self.sigmas))


@dataclass(frozen=True, eq=False)
class Camera:
    """Interior orientation of one camera.

    ``principal_point_px`` (2,), ``radial`` (4,) k1 k2 k3 k4, ``tangential`` (2,) p1 p2, ``affinity`` (2,) b1 b2,
    ``readout_s`` the time in which a rolling shutter reads a picture from the first row to the last, 0 for a global or
    mechanical one, negative where the picture is read upwards.
    ``sigmas`` (12,) in the order of PARAMETER_NAMES: 0 holds a parameter fixed, a positive value is its prior standard
    deviation, infinity leaves it free.
    ``considered_focal_sigma_px`` is that of a focal length which the adjustment does not change but which counts in
    every covariance all the same (a consider parameter: Tapley, Schutz & Born 2004, sec. 6.2); 0 for any other.
    ``field`` is what the lens does beside the parameters, None where nothing is known of it.
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
    readout_s: float = 0.0
    field: LensField | None = None

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ValueError(f"camera {self.name}: its model is {self.model!r}, expected {' or '.join(MODELS)}")
        sizes = {"principal_point_px": 2, "radial": RADIAL_TERMS, "tangential": 2, "sigmas": PARAMETERS, "affinity": 2}
        for name, size in sizes.items():
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != (size,):
                raise ValueError(f"camera {self.name}: {name} has shape {array.shape}, expected ({size},)")
            object.__setattr__(self, name, array)
        if not self.focal_px > 0:
            raise ValueError(f"camera {self.name}: the focal length must be positive, not {self.focal_px}")

    def __repr__(self) -> str:
        size = f"{self.width_px} × {self.height_px} px"
        return f"<Camera {self.name}: {size}, {self.model}, f {self.focal_px:.2f} px>"

    @property
    def parameters(self) -> FloatArray:
        """Return the interior orientation (12,) in the order of PARAMETER_NAMES."""
        return np.array(
            [self.focal_px, *self.principal_point_px, *self.radial, *self.tangential, *self.affinity, self.readout_s]
        )

    def with_parameters(self, parameters: FloatArray) -> Camera:
        """Return the same camera with the interior orientation ``parameters`` (12,), or (12 + K,) with the coefficients
        of its lens field, and zeros after them."""
        q, lens = np.asarray(parameters, dtype=np.float64), self.field
        if q.ndim != 1 or len(q) < PARAMETERS:
            raise ValueError(f"camera {self.name}: parameters of shape {q.shape}, expected ({PARAMETERS},)")
        own = 0 if lens is None else len(lens.coefficients)
        if len(q) > PARAMETERS and (len(q) < PARAMETERS + own or np.any(q[PARAMETERS + own :])):
            raise ValueError(f"camera {self.name}: {len(q) - PARAMETERS} coefficients of a lens field, expected {own}")
        if lens is not None and len(q) > PARAMETERS:
            lens = replace(lens, coefficients=q[PARAMETERS : PARAMETERS + own].copy())
        return replace(
            self,
            focal_px=float(q[FOCAL]),
            principal_point_px=q[CENTRE].copy(),
            radial=q[RADIAL].copy(),
            tangential=q[TANGENTIAL].copy(),
            affinity=q[AFFINITY].copy(),
            readout_s=float(q[READOUT]),
            field=lens,
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

    def contains(self, pixel: FloatArray) -> BoolArray:
        """Return which pixels (N, 2) lie within the photograph."""
        limit = np.array([self.width_px, self.height_px]) - 0.5
        return np.asarray(np.all((pixel >= -0.5) & (pixel <= limit), axis=-1))


@dataclass(frozen=True, eq=False)
class Pose:
    """Exterior orientation: ``rotation_world_from_camera`` (3, 3) and the projection centre ``position_world_m`` (3,),
    for a rolling shutter that of the middle row, and its ``velocity_world_m_s`` (3,), zero where it is not known."""

    rotation_world_from_camera: FloatArray
    position_world_m: FloatArray
    velocity_world_m_s: FloatArray = field(default_factory=lambda: _zeros(3))

    def __post_init__(self) -> None:
        vectors = (self.position_world_m, self.velocity_world_m_s)
        if self.rotation_world_from_camera.shape != (3, 3) or any(vector.shape != (3,) for vector in vectors):
            raise ValueError("a pose is a rotation (3, 3), a position (3,) and a velocity (3,)")

    def __repr__(self) -> str:
        east, north, up = self.position_world_m
        return f"<Pose at {east:.3f}, {north:.3f}, {up:.3f} m (world)>"

    def camera_from_world(self, points_world_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the world frame to the camera frame, in metres."""
        return (points_world_m - self.position_world_m) @ self.rotation_world_from_camera

    def world_from_camera(self, points_camera_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the camera frame to the world frame, in metres."""
        return points_camera_m @ self.rotation_world_from_camera.T + self.position_world_m


@dataclass(frozen=True, eq=False)
class Similarity:
    """``target = scale · rotation · source + translation``: ``rotation`` (3, 3), ``translation`` (3,)."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def points(self, source: FloatArray) -> FloatArray:
        """Transform points (N, 3)."""
        return np.asarray(self.scale * source @ self.rotation.T + self.translation)

    def pose(self, pose: Pose) -> Pose:
        """Transform the exterior orientation of a photograph."""
        return Pose(
            self.rotation @ pose.rotation_world_from_camera,
            self.points(pose.position_world_m[None])[0],
            self.scale * self.rotation @ pose.velocity_world_m_s,
        )


def oriented_cameras(
    cameras: Sequence[Camera],
    camera_of: IntArray,
    rotation: FloatArray,
    position: FloatArray,
    velocity: FloatArray | None = None,
) -> OrientedCameras:
    """Return photographs and their cameras as compiled code takes them.

    ``camera_of`` (N,) are the numbers of the photographs' cameras, ``rotation`` (N, 3, 3) world from camera,
    ``position`` (N, 3) in the world, m, ``velocity`` (N, 3), m/s, zero without.
    """
    velocity = np.zeros_like(position) if velocity is None else velocity
    return OrientedCameras(
        np.ascontiguousarray(camera_of, dtype=np.int64),
        np.ascontiguousarray(rotation, dtype=np.float64).reshape(-1, 3, 3),
        np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3),
        np.ascontiguousarray(velocity, dtype=np.float64).reshape(-1, 3),
        np.array([camera.kind for camera in cameras], dtype=np.int64),
        calibrations(cameras),
        np.array([camera.largest_radius for camera in cameras]),
        np.array([(camera.width_px, camera.height_px) for camera in cameras], dtype=np.int64).reshape(-1, 2),
        *_fields(cameras),
    )


def _coefficients(cameras: Sequence[Camera]) -> int:
    return max((len(c.field.coefficients) for c in cameras if c.field is not None), default=0)


def _with_fields(cameras: Sequence[Camera], own: FloatArray, name: str) -> FloatArray:
    """Return rows (C, 12) of cameras followed by what their lens fields call ``name``, zeros where there is none."""
    rows = np.zeros((len(cameras), PARAMETERS + _coefficients(cameras)))
    rows[:, :PARAMETERS] = own.reshape(-1, PARAMETERS)
    for row, camera in zip(rows, cameras, strict=True):
        if camera.field is not None:
            values = getattr(camera.field, name)
            row[PARAMETERS : PARAMETERS + len(values)] = values
    return rows


def calibrations(cameras: Sequence[Camera]) -> FloatArray:
    """Return the parameters (C, 12 + K) of cameras: interior orientation, then the coefficients of their lens fields,
    zeros where one has fewer than another."""
    return _with_fields(cameras, np.array([camera.parameters for camera in cameras]), "coefficients")


def calibration_sigmas(cameras: Sequence[Camera]) -> FloatArray:
    """Return the prior standard deviations (C, 12 + K) of ``calibrations``."""
    return _with_fields(cameras, np.array([camera.sigmas for camera in cameras]), "sigmas")


def _fields(cameras: Sequence[Camera]) -> tuple[FloatArray, FloatArray]:
    """Return the lens fields (C, R, Q, 2) of cameras at their nodes, and their functions (C, R, Q, 2, K)."""
    count, lattice = _coefficients(cameras), {c.field.functions.shape[:2] for c in cameras if c.field is not None}
    if not lattice:
        return np.zeros((len(cameras), 0, 0, 2)), np.zeros((len(cameras), 0, 0, 2, 0))
    if len(lattice) > 1:
        raise ValueError("the lens fields of the cameras of a block have lattices of one size")
    functions = np.zeros((len(cameras), *lattice.pop(), 2, count))
    shift = np.zeros(functions.shape[:-1])
    for c, camera in enumerate(cameras):
        if camera.field is not None:
            functions[c, ..., : len(camera.field.coefficients)] = camera.field.functions
            shift[c] = camera.field.shift
    return shift, functions


def oriented_by(cameras: Sequence[Camera], camera_of: IntArray, poses: Sequence[Pose | None]) -> OrientedCameras:
    """Return photographs with these poses as compiled code takes them; NaN for those that have none."""
    nowhere = np.full((3, 3), np.nan)
    return oriented_cameras(
        cameras,
        camera_of,
        np.array([nowhere if pose is None else pose.rotation_world_from_camera for pose in poses]),
        np.array([nowhere[0] if pose is None else pose.position_world_m for pose in poses]),
        np.array([np.zeros(3) if pose is None else pose.velocity_world_m_s for pose in poses]),
    )


@njit(cache=True)
def _shift_all(cameras: OrientedCameras, pixel: FloatArray) -> FloatArray:
    shift = np.empty_like(pixel)
    for i in range(len(pixel)):
        shift[i, 0], shift[i, 1] = shift_at(cameras, 0, pixel[i, 0], pixel[i, 1])
    return shift


def field_at(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the lens field (N, 2) of a camera at measured pixels (N, 2), px; zero where it has none."""
    if camera.field is None:
        return np.zeros((len(pixel), 2))
    return _shift_all(oriented_by([camera], np.zeros(0, dtype=np.int64), []), _contiguous(pixel))


@njit(cache=True)
def _project_all(cameras: OrientedCameras, X: FloatArray) -> FloatArray:
    pixel = np.empty((len(X), 2))
    for i in range(len(X)):
        pixel[i, 0], pixel[i, 1], _ = project_point(cameras, np.int64(0), X[i])
    return pixel


@njit(cache=True)
def _distort_all(model: int, parameters: FloatArray, ideal: FloatArray) -> FloatArray:
    pixel, q = np.empty_like(ideal), lens_of(parameters, 0)
    for i in range(len(ideal)):
        x, y = ideal[i, 0], ideal[i, 1]
        if model == FISHEYE:
            s, _, _ = equidistant(x, y, 1.0)
            x, y = x * s, y * s
        xd, yd, _, _, _ = distorted(q, x, y)
        pixel[i, 0], pixel[i, 1] = pixel_of(q, xd, yd)
    return pixel


@njit(cache=True)
def _undistort_all(model: int, parameters: FloatArray, pixel: FloatArray) -> FloatArray:
    ideal, q = np.empty_like(pixel), lens_of(parameters, 0)
    for i in range(len(pixel)):
        ideal[i, 0], ideal[i, 1] = ideal_point(model, q, pixel[i, 0], pixel[i, 1])
    return ideal


def _contiguous(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(array, dtype=np.float64)


def project_points(camera: Camera, pose: Pose, points_world_m: FloatArray) -> FloatArray:
    """Project points (N, 3) of the world frame, m, to pixels (N, 2), u to the right and v down, the centre of the
    top-left pixel at (0, 0).

    NaN for points at or behind the projection centre, and for those so far off the axis that the distortion folds back.
    """
    one = oriented_by([camera], np.zeros(1, dtype=np.int64), [pose])
    pixel = _project_all(one, _contiguous(points_world_m))
    limit = camera.largest_radius
    if np.isfinite(limit):
        x, y, z = pose.camera_from_world(points_world_m).T
        pixel[np.hypot(x, y) >= limit * z] = np.nan
    return pixel


def image_plane_or_nan(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the ideal image-plane coordinates (X/Z, Y/Z) (N, 2) of pixels (N, 2), NaN where the model cannot be
    inverted, or a fisheye looks 90° or more off its axis."""
    at = _contiguous(pixel)
    if camera.field is not None:
        at = at - field_at(camera, at)
    return _undistort_all(camera.kind, camera.parameters[None], at)


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
    """Remove distortion, lens field and affinity from pixels (N, 2), and the bend of a fisheye; the result is where a
    pinhole of the same K would see them.

    Raises ImageError where the distortion model cannot be inverted.
    """
    return image_plane(camera, pixel) * camera.focal_px + camera.principal_point_px


def distort(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Apply distortion, lens field and affinity to ideal pixels (N, 2), and the bend of a fisheye; the inverse of
    undistort."""
    ideal = (_contiguous(pixel) - camera.principal_point_px) / camera.focal_px
    distorted = _distort_all(camera.kind, camera.parameters[None], ideal)
    if camera.field is None:
        return distorted
    return distorted + field_at(camera, distorted + field_at(camera, distorted))


def unproject(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return unit directions (N, 3) in the camera frame (x right, y down, z forward) of pixels (N, 2), px.

    Raises ImageError where the distortion cannot be undone, or a fisheye looks 90° or more off its axis.
    """
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
    return np.asarray(_ENU_FROM_NED @ Rz @ Ry @ Rx @ _BODY_FROM_CAMERA)


def gimbal_from_rotation(rotation_true_north: FloatArray) -> tuple[float, float, float]:
    """Return yaw, pitch and roll in degrees of a rotation (3, 3) from the camera to east, north, up:
    rotation_from_gimbal undone.

    Of a photograph that looks straight down or up only the sum or the difference of yaw and roll is known: roll is 0
    there.
    """
    M = _ENU_FROM_NED.T @ rotation_true_north @ _BODY_FROM_CAMERA.T
    level = np.hypot(M[0, 0], M[1, 0])
    pitch = np.arctan2(-M[2, 0], level)  # the arcsine of nearly 1 would lose half of the digits
    if level < VERTICAL:
        return float(np.rad2deg(np.arctan2(-M[0, 1], M[1, 1]))), float(np.rad2deg(pitch)), 0.0
    yaw, roll = np.arctan2(M[1, 0], M[0, 0]), np.arctan2(M[2, 1], M[2, 2])
    return float(np.rad2deg(yaw)), float(np.rad2deg(pitch)), float(np.rad2deg(roll))


def rotation_from_omega_phi_kappa(angles_deg: Sequence[float] | FloatArray) -> FloatArray:
    """Return the rotation (3, 3) from the camera to easting, northing, up of photogrammetric angles in degrees.

    R = Rx(ω) Ry(φ) Rz(κ) diag(1, −1, −1): the photogrammetric image frame has x right, y up, z backward (Kraus 2007,
    sec. 2.1).
    """
    (so, sp, sk), (co, cp, ck) = np.sin(np.radians(angles_deg)), np.cos(np.radians(angles_deg))
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, co, -so], [0.0, so, co]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    Rz = np.array([[ck, -sk, 0.0], [sk, ck, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(Rx @ Ry @ Rz @ np.diag([1.0, -1.0, -1.0]))


def omega_phi_kappa_deg(rotation_map_from_camera: FloatArray) -> FloatArray:
    """Return the photogrammetric angles (3,) in degrees of a rotation from the camera to easting, northing, up:
    rotation_from_omega_phi_kappa undone.

    Of a photograph that looks level along the easting only the sum or the difference of ω and κ is known: ω is 0 there.
    """
    R = rotation_map_from_camera @ np.diag([1.0, -1.0, -1.0])
    level = np.hypot(R[0, 0], R[0, 1])
    phi = np.arctan2(R[0, 2], level)  # the arcsine of nearly 1 would lose half of the digits
    if level < _ALONG_EASTING:
        return np.degrees([0.0, phi, np.arctan2(R[1, 0], R[1, 1])])
    return np.degrees([np.arctan2(-R[1, 2], R[2, 2]), phi, np.arctan2(-R[0, 1], R[0, 0])])
