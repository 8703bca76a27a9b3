"""Where a camera shows a point, rotations, and the map: differentiated by complex steps and differences alone.

The derivative of an analytic f is Im f(x + ih)/h to the last digits (Squire & Trapp 1998): no formula of a derivative
is written down that could be wrong. Brown (1971), the equidistant fisheye of Kannala & Brandt (2006).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[Any]
F, CX, CY, K1, K2, K3, K4, P1, P2, B1, B2, READOUT = range(12)
STEP, NEAR_AXIS = 1e-30, 1e-3


def image_of(fisheye: Numbers, q: Numbers, p: Numbers) -> Numbers:
    """Return the pixels (n, 2) of points p (n, 3) in front of cameras, m along their axes, with parameters q (n, 12 or
    more); ``fisheye`` (n,) tells the model. Takes complex numbers."""
    x, y, z = p.T
    w = (x * x + y * y) / (z * z)
    near = w.real < NEAR_AXIS
    root = np.sqrt(np.where(near, 1.0, w))
    series = 1.0 - w * (1 / 3 - w * (1 / 5 - w * (1 / 7 - w * (1 / 9 - w / 11))))
    stretch = np.where(fisheye, np.where(near, series, np.arctan(root) / root), 1.0) / z
    x, y = x * stretch, y * stretch
    r2 = x * x + y * y
    radial = 1.0 + r2 * (q[:, K1] + r2 * (q[:, K2] + r2 * (q[:, K3] + r2 * q[:, K4])))
    xd = x * radial + 2.0 * q[:, P1] * x * y + q[:, P2] * (r2 + 2.0 * x * x)
    yd = y * radial + q[:, P1] * (r2 + 2.0 * y * y) + 2.0 * q[:, P2] * x * y
    return np.stack([q[:, F] * xd + q[:, CX] + q[:, B1] * xd + q[:, B2] * yd, q[:, F] * yd + q[:, CY]], axis=1)


def derivatives(fisheye: Numbers, q: Numbers, p: Numbers, wanted: list[int]) -> tuple[Numbers, Numbers]:
    """Return the derivatives of ``image_of`` by p (n, 2, 3) and by the ``wanted`` parameters (n, 2, k)."""
    by_place, by_parameter = np.empty((len(p), 2, 3)), np.empty((len(p), 2, len(wanted)))
    for k in range(3):
        by_place[:, :, k] = image_of(fisheye, q, p + 1j * STEP * np.eye(3)[k]).imag / STEP
    for n, k in enumerate(wanted):
        by_parameter[:, :, n] = image_of(fisheye, q + 1j * STEP * np.eye(q.shape[1])[k], p).imag / STEP
    return by_place, by_parameter


def nodes_around(size_px: Numbers, shape: tuple[int, int], pixel: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return rows and columns (n, 4) of the nodes around pixels (n, 2) in a lattice of ``shape`` over pictures of
    ``size_px`` (n, 2), and their weights (n, 4): bilinear."""
    nodes = np.array([shape[1], shape[0]])
    at = np.clip((pixel + 0.5) / size_px, 0.0, 1.0) * (nodes - 1)
    before = np.minimum(at.astype(np.int64), nodes - 2)
    (x, y), (j, i) = (at - before).T, before.T
    weights = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x], axis=1)
    return np.stack([i, i, i + 1, i + 1], 1), np.stack([j, j + 1, j, j + 1], 1), weights


def cross(v: Numbers) -> Numbers:
    """Return the matrices (n, 3, 3) of the cross products with vectors (n, 3)."""
    return np.cross(v[:, None], np.eye(3)).transpose(0, 2, 1)


def rotation(v: Numbers) -> Numbers:
    """Return the rotations (n, 3, 3) about vectors (n, 3), rad (Rodrigues)."""
    angle, V = np.linalg.norm(v, axis=1)[:, None, None], cross(v)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * V + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (V @ V))


def rotation_vector(R: Numbers) -> Numbers:
    """Return the vectors (n, 3), rad, of rotations (n, 3, 3) by less than π."""
    axis = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine, cosine = np.linalg.norm(axis, axis=1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    small = (sine < 1e-8) & (cosine > 0.0)
    return np.asarray(axis * np.where(small, 1.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))[:, None])


def turn_of(v: Numbers) -> Numbers:
    """Return J (n, 3, 3) of Log(Exp(v) Exp(w)) = v + J w to first order, of vectors v (n, 3) shorter than π: the
    inverse right Jacobian (Chirikjian 2012, sec. 10.86)."""
    a, V = np.linalg.norm(v, axis=1)[:, None, None], cross(v)
    safe = np.where(a < 1e-4, 1.0, a)
    factor = np.where(a < 1e-4, 1 / 12 + a**2 / 720, 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)))
    return np.asarray(np.eye(3) + 0.5 * V + factor * (V @ V))


KRUEGER = (
    (1 / 2, -2 / 3, 5 / 16, 41 / 180, -127 / 288, 7891 / 37800),
    (0, 13 / 48, -3 / 5, 557 / 1440, 281 / 630, -1983433 / 1935360),
    (0, 0, 61 / 240, -103 / 140, 15061 / 26880, 167603 / 181440),
    (0, 0, 0, 49561 / 161280, -179 / 168, 6601661 / 7257600),
    (0, 0, 0, 0, 34729 / 80640, -3418889 / 1995840),
    (0, 0, 0, 0, 0, 212378941 / 319334400),
)
"""Of the series to the sixth power of the third flattening (Karney 2011, eq. 35)."""


def transverse_mercator(ellipsoid_m: Numbers, parameters: Numbers, place: Numbers) -> Numbers:
    """Return easting and northing (n, 2) of latitude and longitude (n, 2), rad; ``parameters`` are latitude and
    longitude of the origin, rad, the scale there, false easting and northing, m."""
    (a, b), (lat0, lon0, scale, *false) = ellipsoid_m, parameters
    n, e = (a - b) / (a + b), np.sqrt(1.0 - (b / a) ** 2)
    latitude, turn = np.append(place[:, 0], lat0), np.append(place[:, 1] - lon0, 0.0)
    tau = np.sinh(np.arctanh(np.sin(latitude)) - e * np.arctanh(e * np.sin(latitude)))
    zeta = np.arctan2(tau, np.cos(turn)) + 1j * np.arcsinh(np.sin(turn) / np.hypot(tau, np.cos(turn)))
    series = np.array(KRUEGER) @ n ** np.arange(1, 7)
    whole = zeta + np.sin(2.0 * np.outer(zeta, np.arange(1, 7))) @ series
    unit = scale * a / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0 + n**6 / 256.0)
    return np.asarray(unit * np.column_stack([whole.imag, whole.real - whole.real[-1]])[:-1] + false)


def map_from_world(ellipsoid_m: Numbers, parameters: Numbers, origin: Numbers, world: Numbers) -> Numbers:
    """Return easting, northing and ellipsoidal height (n, 3) of places (n, 3) along east, north and up at an ``origin``
    of such latitude and longitude, rad, and height, m."""
    a, b = ellipsoid_m
    e2, (lat, lon, high) = 1.0 - (b / a) ** 2, origin
    (sf, cf), (sl, cl) = ((np.sin(v), np.cos(v)) for v in (lat, lon))
    nu = a / np.sqrt(1.0 - e2 * sf**2)
    centre = np.array([(nu + high) * cf * cl, (nu + high) * cf * sl, (nu * (1.0 - e2) + high) * sf])
    axes = np.array([[-sl, -sf * cl, cf * cl], [cl, -sf * sl, cf * sl], [0.0, cf, sf]])
    X, Y, Z = (centre + world @ axes.T).T
    level = np.hypot(X, Y)
    latitude = np.arctan2(Z, level * (1.0 - e2))
    for _ in range(8):  # each step takes the error down to e² of it
        latitude = np.arctan2(Z + e2 * a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2) * np.sin(latitude), level)
    c, s = np.cos(latitude), np.sin(latitude)
    plan = transverse_mercator(ellipsoid_m, parameters, np.column_stack([latitude, np.arctan2(Y, X)]))
    return np.column_stack([plan, level * c + Z * s - a * np.sqrt(1.0 - e2 * s**2)])
