"""The projection of a point into a photograph, its inverse and its Jacobians, for compiled code.

Two models, in the camera frame (x right, y down, z forward):

    brown:    (x, y) = (X/Z, Y/Z)                  Brown–Conrady (Brown 1971, eq. 7–8), as OpenCV evaluates it
    fisheye:  (x, y) = (X, Y)/ρ · θ,               equidistant (Kannala & Brandt 2006, eq. 6); p1 = p2 = 0: cv2.fisheye
              ρ = hypot(X, Y), θ = atan2(ρ, Z)

and then for both, with r² = x² + y²,

    x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2 x²)
    y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + p1 (r² + 2 y²) + 2 p2 x y
    u = f x_d + cx + b1 x_d + b2 y_d,  v = f y_d + cy

A rolling shutter reads a picture of h rows from the first to the last within ``readout_s`` T, while the projection
centre moves on at the velocity w. At row v it stands at

    C(v) = C + w T (v / (h − 1) − 1/2)

C is that of the middle row. Where the row is not measured it follows from the projection itself, see ``at_its_row``.

What is left of a lens is a smooth field s(u, v), bilinear between the nodes of a lattice over the picture. A measured
pixel less the field there is the projection above; a point is hence seen at p + s(p + s(p)), p its projection: the
field's slopes are thousandths, and what is neglected is their square times the field.

A point must lie in front of the camera, Z > 0, in both models: the field of view of a fisheye is below 180°. Ideal
coordinates are (X/Z, Y/Z), whatever the model. Pixel frame: the centre of the top-left pixel is (0, 0). The project
owns its projection because GTSAM's has no k3.

Compiled code takes cameras as OrientedCameras, and no formula of theirs stands elsewhere. What is inlined becomes part
of the loop that calls it, with that loop's floating-point options, so that a loop pays nothing for it. Numbers of
photographs and cameras are given to it unsigned, so that none is tested for being negative at every element.
"""

from typing import Literal, NamedTuple, TypeVar

import numpy as np

from photogram.arrays import FloatArray, Index, IntArray
from photogram.compilation import njit

Model = Literal["brown", "fisheye"]

Share = Literal["itself", "focal length", "width"]


class CameraParameter(NamedTuple):
    """What photogram knows of one parameter of interior orientation, but for its formula.

    ``name`` in vectors and reports, ``words`` in sentences, ``unit`` px or none; the figures' ``digits`` after the
    point. In project.yaml its value is number ``place`` of ``key``, the only one where that is None, and its sigma
    stands at ``sigma_key``. Standard deviations, in ``share``: of the parameter itself, or of the focal length or the
    width of the photograph: ``weakest``, the prior of one that is left wholly free; ``unknown``, where nothing but the
    focal length of the tags is known, 0 for what is not estimated then; ``ordinary``, of a calibration some flights
    old. ``usual``: most calibrations give it; the others are zero where they are not named.
    """

    name: str
    words: str
    unit: str
    digits: int
    key: str
    place: int | None
    sigma_key: str
    share: Share
    weakest: float
    unknown: float
    ordinary: float
    usual: bool

    def in_its_unit(self, sigma: float, focal_px: float, width_px: int) -> float:
        """Return a standard deviation given in ``share`` in the parameter's own unit."""
        return sigma * {"itself": 1.0, "focal length": focal_px, "width": float(width_px)}[self.share]


CAMERA_PARAMETERS: tuple[CameraParameter, ...] = (
    CameraParameter("focal_px", "focal length", "px", 3, "focal_px", None, "focal_px", "focal length",
                    weakest=0.1, unknown=0.03, ordinary=0.005, usual=True),
    CameraParameter("cx_px", "principal point in x", "px", 3, "principal_point_px", 0, "principal_point_px", "width",
                    weakest=0.05, unknown=0.01, ordinary=0.002, usual=True),
    CameraParameter("cy_px", "principal point in y", "px", 3, "principal_point_px", 1, "principal_point_px", "width",
                    weakest=0.05, unknown=0.01, ordinary=0.002, usual=True),
    CameraParameter("k1", "k1", "", 7, "radial", 0, "k1", "itself",
                    weakest=0.3, unknown=0.1, ordinary=0.01, usual=True),
    CameraParameter("k2", "k2", "", 7, "radial", 1, "k2", "itself",
                    weakest=0.3, unknown=0.1, ordinary=0.02, usual=True),
    CameraParameter("k3", "k3", "", 7, "radial", 2, "k3", "itself",
                    weakest=0.3, unknown=0.05, ordinary=0.01, usual=True),
    CameraParameter("k4", "k4", "", 7, "radial", 3, "k4", "itself",
                    weakest=0.3, unknown=0.0, ordinary=0.0, usual=False),
    CameraParameter("p1", "p1", "", 7, "tangential", 0, "p1", "itself",
                    weakest=0.01, unknown=0.003, ordinary=0.0005, usual=True),
    CameraParameter("p2", "p2", "", 7, "tangential", 1, "p2", "itself",
                    weakest=0.01, unknown=0.003, ordinary=0.0005, usual=True),
    CameraParameter("b1", "b1", "px", 3, "affinity", 0, "b1", "focal length",
                    weakest=0.01, unknown=0.003, ordinary=0.0, usual=False),
    CameraParameter("b2", "b2", "px", 3, "affinity", 1, "b2", "focal length",
                    weakest=0.01, unknown=0.001, ordinary=0.0, usual=False),
    CameraParameter("readout_s", "read-out time", "s", 5, "readout_s", None, "readout_s", "itself",
                    weakest=0.1, unknown=0.0, ordinary=0.0, usual=False),
)  # fmt: skip
"""Interior orientation, in the order of every parameter vector of photogram."""

PARAMETER_NAMES = tuple(p.name for p in CAMERA_PARAMETERS)

SIGMA_KEYS = tuple(dict.fromkeys(p.sigma_key for p in CAMERA_PARAMETERS))
"""Where sigmas stand in project.yaml; cx and cy share one."""

PARAMETERS = len(PARAMETER_NAMES)

FOCAL, CX, CY, K1, K2, K3, K4, P1, P2, B1, B2, READOUT = range(PARAMETERS)
"""Where each parameter stands in such a vector."""

CENTRE, RADIAL, TANGENTIAL, AFFINITY = slice(CX, CY + 1), slice(K1, K4 + 1), slice(P1, P2 + 1), slice(B1, B2 + 1)

RADIAL_TERMS = RADIAL.stop - RADIAL.start

USUAL = np.array([p.usual for p in CAMERA_PARAMETERS])

BROWN, FISHEYE = 0, 1

SIDEWAYS = 4.0  # ideal radius, 76° off the axis, from which a fisheye is no pinhole even when its bend is undone

PROJECTIVE = 2  # as BROWN, but what lies behind is seen too, through the centre: no photograph, for published problems

MODELS: dict[Model, int] = {"brown": BROWN, "fisheye": FISHEYE}
"""The numbers by which compiled code knows the models."""

NEAR_AXIS = 1e-3
"""(ρ/Z)² below which the fisheye is evaluated by its series: the closed form loses its digits there."""

Six = tuple[float, float, float, float, float, float]

Number = TypeVar("Number", float, FloatArray)

Lens = tuple[float, ...]
"""The parameters (12,) of one camera, in the order of PARAMETER_NAMES."""


_ONES: Lens = (1.0,) * PARAMETERS


class OrientedCameras(NamedTuple):
    """Photographs with their exterior orientation, and their cameras: the one form in which compiled code takes them.

    Of photographs: ``camera`` (N,) the number of its camera; ``rotation`` (N, 3, 3) world from camera; ``position``
    (N, 3) of the projection centre in the world, m, and ``velocity`` (N, 3) of it, m/s, zero where it is not known. Of
    cameras: ``model`` (C,) its number in MODELS; ``parameters`` (C, 12 + K) in the order of PARAMETER_NAMES, then the
    K coefficients of lens fields; ``largest_radius`` (C,) the ideal radius beyond which the distortion folds back;
    ``size_px`` (C, 2) width and height; ``shift`` (C, R, Q, 2) the lens fields at their nodes, px, and ``functions``
    (C, R, Q, 2, K) their derivatives by the coefficients, without nodes where no camera has a field.
    ``largest_radius`` is that of the cameras as they were given; an adjustment, which changes the parameters, does not
    read it. ``Block.oriented_cameras`` and ``photogram.camera.oriented_by`` make them, ``recalibrated`` changes their
    parameters.
    """

    camera: IntArray
    rotation: FloatArray
    position: FloatArray
    velocity: FloatArray
    model: IntArray
    parameters: FloatArray
    largest_radius: FloatArray
    size_px: IntArray
    shift: FloatArray
    functions: FloatArray


def recalibrated(cameras: OrientedCameras, parameters: FloatArray) -> OrientedCameras:
    """Return the photographs with other parameters of their cameras, (C, 12) or, with those of lens fields, (C, 12 +
    K)."""
    shift = cameras.shift
    if parameters.shape[1] > PARAMETERS:
        shift = np.einsum("crqik,ck->crqi", cameras.functions, parameters[:, PARAMETERS:])
    return cameras._replace(parameters=np.ascontiguousarray(parameters), shift=np.ascontiguousarray(shift))


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(inline="always")
def turned(cameras: OrientedCameras, p: Index, dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """Turn an offset from the projection centre, in the world, into the frame of photograph ``p``."""
    R = cameras.rotation
    px = R[p, 0, 0] * dx + R[p, 1, 0] * dy + R[p, 2, 0] * dz
    py = R[p, 0, 1] * dx + R[p, 1, 1] * dy + R[p, 2, 1] * dz
    pz = R[p, 0, 2] * dx + R[p, 1, 2] * dy + R[p, 2, 2] * dz
    return px, py, pz


@njit(inline="always")
def in_camera(cameras: OrientedCameras, p: Index, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a place of the world in the frame of photograph ``p``."""
    C = cameras.position
    return turned(cameras, p, x - C[p, 0], y - C[p, 1], z - C[p, 2])


@njit(inline="always")
def share_at_row(v: Number, height_px: Number) -> Number:
    """Return how far the read-out is at row ``v``, of one or of (N,), from −1/2 at the first row to 1/2 at the last."""
    return v / (height_px - 1.0) - 0.5


@njit(inline="always")
def drift_at_row(cameras: OrientedCameras, p: Index, height_px: float, v: float) -> tuple[float, float, float]:
    """Return by how much the world drifts through the frame of photograph ``p`` until row ``v``, m per second of
    read-out: −Rᵀ w (v / (h − 1) − 1/2), the derivative of a place in that frame by the read-out time."""
    w, share = cameras.velocity, share_at_row(v, height_px)
    return turned(cameras, p, -share * w[p, 0], -share * w[p, 1], -share * w[p, 2])


@njit(inline="always")
def image_plane_of(model: int, px: float, py: float, pz: float) -> tuple[float, float, float, float, float]:
    """Return the image-plane coordinates (x, y) of a point in front of the camera, and s, t and e of ``stretch_of``."""
    s, t, e = 1.0 / pz, 0.0, 1.0 / (pz * pz)
    x, y = px / pz, py / pz
    if model == FISHEYE:
        s, t, e = equidistant(px, py, pz)
        x, y = px * s, py * s
    return x, y, s, t, e


@njit(inline="always")
def stretch_of(model: int, px: float, py: float, pz: float) -> tuple[float, float, float]:
    """Return s of (x, y) = s (X, Y), and t and e of its derivatives, see ``equidistant``; Brown's has s = 1/Z.

    Two divisions fewer than ``image_plane_of``, and the last digit of (x, y) is another.
    """
    s = 1.0 / pz
    t, e = 0.0, s * s
    if model == FISHEYE:
        s, t, e = equidistant(px, py, pz)
    return s, t, e


@njit(inline="always")
def lens_of(parameters: FloatArray, c: Index) -> Lens:
    """Return the parameters of camera ``c`` as numbers.

    Read them before the first branch: an array that is taken out of a tuple and used on both sides of a branch is
    counted, which costs more than the projection.
    """
    q = parameters
    return (
        q[c, FOCAL], q[c, CX], q[c, CY], q[c, K1], q[c, K2], q[c, K3], q[c, K4], q[c, P1], q[c, P2], q[c, B1], q[c, B2],
        q[c, READOUT],
    )  # fmt: skip


@njit(inline="always")
def distorted(q: Lens, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Distort image-plane coordinates (x, y) of either model; returns x_d, y_d and ∂x_d/∂x, ∂x_d/∂y = ∂y_d/∂x,
    ∂y_d/∂y."""
    k1, k2, k3, k4, p1, p2 = q[K1], q[K2], q[K3], q[K4], q[P1], q[P2]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4)))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return xd, yd, xx, xy, yy


@njit(inline="always")
def pixel_of(q: Lens, xd: float, yd: float) -> tuple[float, float]:
    """Return the pixel of distorted image-plane coordinates."""
    return q[FOCAL] * xd + q[CX] + (q[B1] * xd + q[B2] * yd), q[FOCAL] * yd + q[CY]


@njit(inline="always")
def misfit(q: Lens, xd: float, yd: float, u: float, v: float) -> tuple[float, float]:
    """Return the pixel of distorted coordinates less the measured one: ``pixel_of`` with an operation less."""
    du = (q[FOCAL] + q[B1]) * xd + q[B2] * yd + q[CX] - u
    return du, q[FOCAL] * yd + q[CY] - v


@njit(inline="always")
def pixel_slopes(q: Lens, weight: float, xx: float, xy: float, yy: float) -> tuple[float, float, float, float]:
    """Return ∂u/∂x, ∂u/∂y, ∂v/∂x, ∂v/∂y times ``weight`` from the derivatives of the distortion."""
    f, fu, skew = q[FOCAL], q[FOCAL] + q[B1], q[B2]
    return weight * (fu * xx + skew * xy), weight * (fu * xy + skew * yy), weight * f * xy, weight * f * yy


@njit(inline="always")
def slopes_in_camera(
    gx: float, gy: float, px: float, py: float, s: float, t: float, e: float
) -> tuple[float, float, float]:
    """Return the derivatives by (X, Y, Z) of the camera frame from those by (x, y) = s (X, Y), see ``stretch_of``."""
    along = gx * px + gy * py
    return gx * s + t * along * px, gy * s + t * along * py, -e * along


@njit(inline="always")
def slopes_of_pose(g0: float, g1: float, g2: float, px: float, py: float, pz: float) -> Six:
    """Return the derivatives by the pose's tangent from those by p in the camera frame.

    The tangent is (ω, v) in the camera frame, R' = R Exp(ω), C' = C + R v to first order, as GTSAM's Pose3 (Dellaert &
    Kaess 2017, sec. 6.3): with p = Rᵀ(X − C), ∂p/∂ω = [p]ₓ, ∂p/∂v = −I.
    """
    return g1 * pz - g2 * py, g2 * px - g0 * pz, g0 * py - g1 * px, -g0, -g1, -g2


@njit(inline="always")
def slopes_in_world(cameras: OrientedCameras, p: Index, g0: float, g1: float, g2: float) -> tuple[float, float, float]:
    """Return the derivatives by the point in the world from those in the camera frame: ∂p/∂X = Rᵀ."""
    R = cameras.rotation
    gx = R[p, 0, 0] * g0 + R[p, 0, 1] * g1 + R[p, 0, 2] * g2
    gy = R[p, 1, 0] * g0 + R[p, 1, 1] * g1 + R[p, 1, 2] * g2
    gz = R[p, 2, 0] * g0 + R[p, 2, 1] * g1 + R[p, 2, 2] * g2
    return gx, gy, gz


@njit(inline="always")
def fill_parameter_slopes(
    q: Lens, unit: Lens, weight: float, x: float, y: float, xd: float, yd: float, J: FloatArray,
    row: int, column: int,
) -> None:  # fmt: skip
    """Fill two rows of J, from ``row`` and ``column`` on, with the derivatives of (u, v) by those parameters of
    a camera whose ``unit`` is not zero, in these units, times ``weight``, all but the last one, the read-out time, of
    which ``drift_at_row`` tells; (x, y) before, (xd, yd) after the distortion."""
    a, k, one = np.uint64(row), np.uint64(column), np.uint64(1)
    d, r2, sv = a + one, x * x + y * y, weight * q[FOCAL]
    su, sb = weight * (q[FOCAL] + q[B1]), weight * q[B2]
    if unit[FOCAL] > 0.0:
        J[a, k], J[d, k] = weight * xd * unit[FOCAL], weight * yd * unit[FOCAL]
        k += one
    if unit[CX] > 0.0:
        J[a, k], J[d, k] = weight * unit[CX], 0.0
        k += one
    if unit[CY] > 0.0:
        J[a, k], J[d, k] = 0.0, weight * unit[CY]
        k += one
    du, dv = su * x + sb * y, sv * y
    for n in range(K1, K4 + 1):
        du, dv = du * r2, dv * r2
        if unit[n] > 0.0:
            J[a, k], J[d, k] = du * unit[n], dv * unit[n]
            k += one
    xy2, xx3, yy3 = 2.0 * x * y, r2 + 2.0 * x * x, r2 + 2.0 * y * y
    if unit[P1] > 0.0:
        J[a, k], J[d, k] = (su * xy2 + sb * yy3) * unit[P1], sv * yy3 * unit[P1]
        k += one
    if unit[P2] > 0.0:
        J[a, k], J[d, k] = (su * xx3 + sb * xy2) * unit[P2], sv * xy2 * unit[P2]
        k += one
    if unit[B1] > 0.0:
        J[a, k], J[d, k] = weight * xd * unit[B1], 0.0
        k += one
    if unit[B2] > 0.0:
        J[a, k], J[d, k] = weight * yd * unit[B2], 0.0


@njit(inline="always")
def node_before(at_px: float, side_px: float, nodes: int) -> tuple[int, float]:
    """Return the last node before a pixel's coordinate, and how far on it lies towards the next, from 0 to 1."""
    at = min(max((at_px + 0.5) / side_px, 0.0), 1.0) * (nodes - 1)
    before = min(int(at), nodes - 2)
    return before, at - before


@njit(inline="always")
def shift_within(S: FloatArray, c: Index, width_px: int, height_px: int, u: float, v: float) -> tuple[float, float]:
    """Return the lens field S (C, R, Q, 2) of camera ``c`` at a pixel, px; beyond the picture that of its edge."""
    du, dv = 0.0, 0.0
    if np.isfinite(u + v):
        column, x = node_before(u, width_px, S.shape[2])
        row, y = node_before(v, height_px, S.shape[1])
        j, i, one = np.uint64(column), np.uint64(row), np.uint64(1)
        a, b, d, e = (1.0 - y) * (1.0 - x), (1.0 - y) * x, y * (1.0 - x), y * x
        du = a * S[c, i, j, 0] + b * S[c, i, j + one, 0] + d * S[c, i + one, j, 0] + e * S[c, i + one, j + one, 0]
        dv = a * S[c, i, j, 1] + b * S[c, i, j + one, 1] + d * S[c, i + one, j, 1] + e * S[c, i + one, j + one, 1]
    return du, dv


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def shift_called(S: FloatArray, c: Index, width_px: int, height_px: int, u: float, v: float) -> tuple[float, float]:
    """Return ``shift_within``; inlined, it would count the array in loops that count references."""
    return shift_within(S, c, width_px, height_px, u, v)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def shown_called(S: FloatArray, c: Index, width_px: int, height_px: int, u: float, v: float) -> tuple[float, float]:
    """Return where a picture of camera ``c`` shows what the parameters project to (u, v): there the field is added."""
    du, dv = shift_within(S, c, width_px, height_px, u, v)
    du, dv = shift_within(S, c, width_px, height_px, u + du, v + dv)
    return u + du, v + dv


@njit(inline="always")
def shift_at(cameras: OrientedCameras, c: Index, u: float, v: float) -> tuple[float, float]:
    """Return the lens field of camera ``c`` at a pixel, px, zero where it has none."""
    S, width_px, height_px = cameras.shift, cameras.size_px[c, 0], cameras.size_px[c, 1]
    du, dv = 0.0, 0.0
    if S.shape[1] > 1:
        du, dv = shift_called(S, c, width_px, height_px, u, v)
    return du, dv


@njit(inline="always")
def without_field(cameras: OrientedCameras, c: Index, u: float, v: float) -> tuple[float, float]:
    """Return a measured pixel of camera ``c`` less the lens field there: what the parameters alone describe."""
    du, dv = shift_at(cameras, c, u, v)
    return u - du, v - dv


@njit(cache=True, nogil=True, error_model="numpy")
def _without_fields(cameras: OrientedCameras, photograph: IntArray, measured: FloatArray) -> FloatArray:
    bare = measured.copy()
    for i in range(len(bare)):
        c = cameras.camera[photograph[i]]
        bare[i, 0], bare[i, 1] = without_field(cameras, c, measured[i, 0], measured[i, 1])
    return bare


def without_fields(cameras: OrientedCameras, photograph: IntArray, measured: FloatArray) -> FloatArray:
    """Return measurements (N, 2 or more), u and v first, px, in photographs (N,) less the lens fields of their cameras;
    the array itself where no camera has one, so that loops over such blocks know nothing of fields."""
    if cameras.shift.shape[1] < 2:
        return measured
    return _without_fields(cameras, photograph, measured)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def fill_field_slopes(
    cameras: OrientedCameras, c: Index, u: float, v: float, weight: float, count: int, J: FloatArray, row: int,
    column: int,
) -> None:  # fmt: skip
    """Fill two rows of J, from ``row`` and ``column`` on, with the derivatives of (u, v) by the first ``count``
    coefficients of the lens field of camera ``c`` at a measured pixel, times ``weight``."""
    F = cameras.functions
    before, x = node_before(u, cameras.size_px[c, 0], F.shape[2])
    above, y = node_before(v, cameras.size_px[c, 1], F.shape[1])
    a, b = weight * (1.0 - y) * (1.0 - x), weight * (1.0 - y) * x
    d, e = weight * y * (1.0 - x), weight * y * x
    for n in range(2):
        for k in range(count):
            upper = a * F[c, above, before, n, k] + b * F[c, above, before + 1, n, k]
            lower = d * F[c, above + 1, before, n, k] + e * F[c, above + 1, before + 1, n, k]
            J[row + n, column + k] = upper + lower


@njit(inline="always")
def pixel_in_front(model: int, q: Lens, px: float, py: float, pz: float) -> tuple[float, float]:
    """Return the pixel at which a camera shows a point in its frame and in front of it."""
    if model == FISHEYE:
        s, _, _ = equidistant(px, py, pz)
        x, y = px * s, py * s
    else:
        x, y = px / pz, py / pz
    xd, yd, _, _, _ = distorted(q, x, y)
    return pixel_of(q, xd, yd)


ROWS_TRIED = 3
"""Projections after which the row that shows a point is known: each takes the error of the row down to the part of it
that the picture moves on meanwhile, some hundredths."""


@njit(inline="always")
def at_its_row(
    model: int, q: Lens, height_px: float, px: float, py: float, pz: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float]:
    """Return a place in the camera frame of the middle row as that of the row which shows it, the camera moving at
    (wx, wy, wz) m/s along its own axes; rows before the first and after the last count as these."""
    T, x, y, z = q[READOUT], px, py, pz
    for _ in range(ROWS_TRIED):
        if z <= 0.0:
            break
        _, v = pixel_in_front(model, q, x, y, z)
        way = T * min(max(share_at_row(v, height_px), -0.5), 0.5)
        x, y, z = px - way * wx, py - way * wy, pz - way * wz
    return x, y, z


@njit(inline="always")
def in_camera_at_its_row(
    cameras: OrientedCameras, p: Index, model: int, q: Lens, height_px: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return a place of the world in the frame of photograph ``p`` when it reads the row that shows it."""
    w = cameras.velocity
    px, py, pz = in_camera(cameras, p, x, y, z)
    wx, wy, wz = turned(cameras, p, w[p, 0], w[p, 1], w[p, 2])  # before the branch, which takes no array
    if q[READOUT] != 0.0 and (wx != 0.0 or wy != 0.0 or wz != 0.0):
        px, py, pz = at_its_row(model, q, height_px, px, py, pz, wx, wy, wz)
    return px, py, pz


@njit(inline="always")
def in_camera_at_row(
    cameras: OrientedCameras, p: Index, readout_s: float, height_px: float, v: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return a place of the world in the frame of photograph ``p`` when it reads row ``v``."""
    C, w, way = cameras.position, cameras.velocity, readout_s * share_at_row(v, height_px)
    return turned(
        cameras, p, x - (C[p, 0] + way * w[p, 0]), y - (C[p, 1] + way * w[p, 1]), z - (C[p, 2] + way * w[p, 2])
    )


@njit(inline="always")
def centre_at_row(cameras: OrientedCameras, p: Index, v: float) -> tuple[float, float, float]:
    """Return where in the world the projection centre of photograph ``p`` stands when it reads row ``v``."""
    C, w, c = cameras.position, cameras.velocity, cameras.camera[p]
    way = cameras.parameters[c, READOUT] * share_at_row(v, cameras.size_px[c, 1])
    return C[p, 0] + way * w[p, 0], C[p, 1] + way * w[p, 1], C[p, 2] + way * w[p, 2]


@njit(inline="always")
def project_at_row(cameras: OrientedCameras, p: Index, X: FloatArray, v: float) -> tuple[float, float, float]:
    """Project X (3,) as ``project_point``, with the projection centre of row ``v``, where the point was measured, and
    by the parameters alone: what it is compared with is the measurement less the lens field, ``without_fields``."""
    i = np.uint64(p)
    c = np.uint64(cameras.camera[i])
    height_px, model, q = cameras.size_px[c, 1], cameras.model[c], lens_of(cameras.parameters, c)
    px, py, pz = in_camera_at_row(cameras, i, q[READOUT], height_px, v, X[0], X[1], X[2])
    if pz <= 0.0:
        return np.nan, np.nan, pz
    x, y = pixel_in_front(model, q, px, py, pz)
    return x, y, pz


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def project_point(cameras: OrientedCameras, p: Index, X: FloatArray) -> tuple[float, float, float]:
    """Project X (3,) of the world into photograph ``p``; returns u, v and the depth in m.

    The pixel of a point with depth at or below zero means nothing: the caller must test the depth.
    """
    i = np.uint64(p)
    c = np.uint64(cameras.camera[i])
    S, width_px, height_px = cameras.shift, cameras.size_px[c, 0], cameras.size_px[c, 1]
    model, q = cameras.model[c], lens_of(cameras.parameters, c)
    px, py, pz = in_camera_at_its_row(cameras, i, model, q, height_px, X[0], X[1], X[2])
    if pz <= 0.0:
        return np.nan, np.nan, pz
    u, v = pixel_in_front(model, q, px, py, pz)
    if S.shape[1] > 1:
        u, v = shown_called(S, c, width_px, height_px, u, v)
    return u, v, pz


@njit(inline="always")
def seen_at(
    cameras: OrientedCameras, p: Index, X: FloatArray | tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return u, v and the depth of X (3,) as ``project_point``; NaN for u and v where the point lies behind the camera
    or beyond the radius at which the distortion folds back."""
    i = np.uint64(p)
    c = np.uint64(cameras.camera[i])
    S, width_px, height_px = cameras.shift, cameras.size_px[c, 0], cameras.size_px[c, 1]
    model, q, largest_radius = cameras.model[c], lens_of(cameras.parameters, c), cameras.largest_radius[c]
    px, py, pz = in_camera_at_its_row(cameras, i, model, q, height_px, X[0], X[1], X[2])
    if pz <= 0.0:
        return np.nan, np.nan, pz
    if np.isfinite(largest_radius) and px * px + py * py > (largest_radius * pz) ** 2:
        return np.nan, np.nan, pz
    u, v = pixel_in_front(model, q, px, py, pz)
    if S.shape[1] > 1:
        u, v = shown_called(S, c, width_px, height_px, u, v)
    return u, v, pz


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def seen_called(cameras: OrientedCameras, p: Index, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return ``seen_at`` of X = (x, y, z), compiled once for all that ask seldom: inlined, each place takes seconds to
    compile, and so does each type of number and layout of an array."""
    return seen_at(cameras, p, (x, y, z))


@njit(cache=True, nogil=True, error_model="numpy")
def project_point_jacobians(
    cameras: OrientedCameras,
    p: Index,
    X: FloatArray,
    v_px: float,
    J_pose: FloatArray,
    J_camera: FloatArray,
    J_point: FloatArray,
) -> tuple[float, float, float]:
    """Project as project_at_row, at ``v_px``, and fill the Jacobians of (u, v): pose (2, 6), see ``slopes_of_pose``,
    interior orientation (2, 12 or more), without lens fields, which ``fill_field_slopes`` adds, and point (2, 3)."""
    i = np.uint64(p)
    c = np.uint64(cameras.camera[i])
    model, q, height_px = cameras.model[c], lens_of(cameras.parameters, c), cameras.size_px[c, 1]
    px, py, pz = in_camera_at_row(cameras, i, q[READOUT], height_px, v_px, X[0], X[1], X[2])
    mx, my, mz = drift_at_row(cameras, i, height_px, v_px)
    if not pz > 0.0:
        J_pose[:] = 0.0
        J_camera[:] = 0.0
        J_point[:] = 0.0
        return np.nan, np.nan, pz
    x, y, s, t, e = image_plane_of(model, px, py, pz)
    xd, yd, xx, xy, yy = distorted(q, x, y)
    ux, uy, vx, vy = pixel_slopes(q, 1.0, xx, xy, yy)
    for row in range(2):
        gx, gy = (ux, uy) if row == 0 else (vx, vy)
        g0, g1, g2 = slopes_in_camera(gx, gy, px, py, s, t, e)
        J_pose[row, 0], J_pose[row, 1], J_pose[row, 2], J_pose[row, 3], J_pose[row, 4], J_pose[row, 5] = slopes_of_pose(
            g0, g1, g2, px, py, pz
        )
        J_point[row, 0], J_point[row, 1], J_point[row, 2] = slopes_in_world(cameras, i, g0, g1, g2)
        J_camera[row, READOUT] = g0 * mx + g1 * my + g2 * mz
    fill_parameter_slopes(q, _ONES, 1.0, x, y, xd, yd, J_camera, 0, 0)
    u, v = pixel_of(q, xd, yd)
    return u, v, pz


@njit(cache=True, nogil=True)
def undistort_point(q: Lens, xd: float, yd: float) -> tuple[float, float]:
    """Invert ``distorted`` by Newton's method with its analytic Jacobian; NaN where it does not converge."""
    x, y = xd, yd
    for _ in range(50):
        fx, fy, a, b, d = distorted(q, x, y)
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


@njit(cache=True, nogil=True)
def ideal_point(model: int, q: Lens, u: float, v: float) -> tuple[float, float]:
    """Return the ideal coordinates (X/Z, Y/Z) that a pixel shows; NaN
    where the model cannot be undone, such as where a fisheye looks sideways."""
    yd = (v - q[CY]) / q[FOCAL]
    xd = (u - q[CX] - q[B2] * yd) / (q[FOCAL] + q[B1])
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
