"""Smooth corrections over a picture that neither interior orientation nor attitude can describe.

Products of Legendre polynomials P_i(x) P_j(y) of the picture's coordinates, for u and for v, up to a total degree
(Tang, Fritsch, Cramer & Schneider 2012, A mathematical analysis and verification of self-calibration by orthogonal
polynomials), less their projection on the derivatives of the pixel by focal length, principal point, k1 to k4, p1, p2,
b1, b2 and by three rotations of the camera, which all of its photographs may have in common, and made orthonormal to
each other: the mean of B_k B_l over picture and coordinates is δ_kl. Means are taken by Gauss–Legendre quadrature. The
camera is the one the basis was made for: where its parameters move a little afterwards, the basis stays, and is
orthogonal to the first order.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, distort, image_plane

NODES = 32
"""Of the quadrature along a side: exact up to degree 63."""

TURN_RAD = 1e-5
"""Of the differences that stand for derivatives by rotations."""

LEAST_OWN = 0.05
"""RMS of what a product (RMS 1) adds to camera parameters and earlier products, below which it is left out."""


@dataclass(frozen=True, eq=False)
class FieldBasis:
    """K functions over the pictures of one camera, of RMS 1 for a coordinate.

    ``degree`` (K,): total degree of the product that each adds; low degrees come first. ``exponents`` (M, 2) of the
    products for u and for v. ``of_products`` (2 M, K) and ``of_camera`` (14, K): the factors of products and of the
    derivatives by camera and attitude in each.
    """

    camera: Camera
    degree: IntArray
    exponents: IntArray
    of_products: FloatArray
    of_camera: FloatArray

    def __len__(self) -> int:
        return len(self.degree)

    def at(self, pixel: FloatArray) -> FloatArray:
        """Return the functions (N, 2, K) at pixels (N, 2) within the picture."""
        products = _products(self.camera, self.exponents, pixel)
        return np.asarray(products @ self.of_products - _known_slopes(self.camera, pixel) @ self.of_camera)


def interior_slopes(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the derivatives (N, 2, 11) of the pixel by f, cx, cy, k1 to k4, p1, p2, b1, b2, at pixels (N, 2)."""
    x, y = image_plane(camera, pixel).T
    if camera.model == "fisheye":
        radius = np.maximum(np.hypot(x, y), 1e-12)
        x, y = x * np.arctan(radius) / radius, y * np.arctan(radius) / radius
    (k, (p1, p2), (b1, b2)), f = (camera.radial, camera.tangential, camera.affinity), camera.focal_px
    r2 = x * x + y * y
    stretch = 1.0 + r2 * np.polyval(k[::-1], r2)
    xd = x * stretch + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * stretch + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    one, zero = np.ones_like(x), np.zeros_like(x)
    lens = [(x * r2**n, y * r2**n) for n in (1, 2, 3, 4)]
    lens += [(2.0 * x * y, r2 + 2.0 * y * y), (r2 + 2.0 * x * x, 2.0 * x * y)]
    columns = [(xd, yd), (one, zero), (zero, one)]
    columns += [((f + b1) * dx + b2 * dy, f * dy) for dx, dy in lens]
    columns += [(xd, zero), (yd, zero)]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def attitude_slopes(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the derivatives (N, 2, 3) of the pixel by rotations of the camera about its axes, px/rad, at pixels
    (N, 2); by central differences."""
    ray = np.column_stack([image_plane(camera, pixel), np.ones(len(pixel))])

    def projected(rotation_rad: FloatArray) -> FloatArray:
        turned = ray + np.cross(rotation_rad, ray)
        return distort(camera, turned[:, :2] / turned[:, 2:] * camera.focal_px + camera.principal_point_px)

    sides = [[projected(sign * TURN_RAD * axis) for sign in (1.0, -1.0)] for axis in np.eye(3)]
    return np.stack([(ahead - behind) / (2.0 * TURN_RAD) for ahead, behind in sides], axis=-1)


def _known_slopes(camera: Camera, pixel: FloatArray) -> FloatArray:
    return np.concatenate([interior_slopes(camera, pixel), attitude_slopes(camera, pixel)], axis=2)


def field_basis(camera: Camera, degree: int) -> FieldBasis:
    """Return the functions of products up to a total ``degree``, low degrees first.

    Raises ValueError for a negative degree or one that the quadrature cannot integrate.
    """
    if not 0 <= degree < NODES // 2:
        raise ValueError(f"a lens field has a degree of 0 to {NODES // 2 - 1}, not {degree}")
    exponents = np.array([(total - j, j) for total in range(degree + 1) for j in range(total + 1)])
    pixel, weight = _quadrature(camera)
    root = np.sqrt(np.repeat(weight, 2) / 2.0)[:, None]
    products = root * _products(camera, exponents, pixel).reshape(len(root), -1)
    slopes = root * _known_slopes(camera, pixel).reshape(len(root), -1)
    scale = np.linalg.norm(slopes, axis=0)
    q, r = np.linalg.qr(slopes / scale)
    count = 2 * len(exponents)
    order = np.argsort(np.tile(exponents.sum(axis=1), 2), kind="stable")
    functions: list[FloatArray] = []
    factors: list[FloatArray] = []
    totals: list[int] = []
    for m in order:  # Gram-Schmidt, twice: each function keeps the degree of its product
        own, factor = products[:, m].copy(), np.eye(count + q.shape[1])[m]
        for _ in range(2):
            shares = q.T @ own
            own -= q @ shares
            factor[count:] += np.linalg.solve(r, shares) / scale
            for earlier, its in zip(functions, factors, strict=True):
                share = float(earlier @ own)
                own -= share * earlier
                factor -= share * its
        size = float(np.linalg.norm(own))
        if size < LEAST_OWN:
            continue
        functions.append(own / size)
        factors.append(factor / size)
        totals.append(int(exponents[m % len(exponents)].sum()))
    columns = np.array(factors).reshape(-1, count + q.shape[1]).T
    return FieldBasis(camera, np.array(totals, dtype=np.int64), exponents, columns[:count], columns[count:])


def _products(camera: Camera, exponents: IntArray, pixel: FloatArray) -> FloatArray:
    """Return the products (N, 2, 2 M) at pixels (N, 2), each of RMS 1 for a coordinate."""
    sides = np.array([camera.width_px, camera.height_px])
    at = (2.0 * pixel + 1.0) / sides - 1.0
    top = int(exponents.max())
    norm = np.sqrt(2.0 * np.arange(top + 1) + 1.0)
    along, down = (legendre.legvander(at[:, side], top) * norm for side in (0, 1))
    value = np.sqrt(2.0) * along[:, exponents[:, 0]] * down[:, exponents[:, 1]]
    zero = np.zeros_like(value)
    return np.stack([np.hstack([value, zero]), np.hstack([zero, value])], axis=1)


def _quadrature(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return pixels (N, 2) all over the picture and their weights (N,), of sum 1."""
    node, weight = legendre.leggauss(NODES)
    u, v = ((node + 1.0) * side / 2.0 - 0.5 for side in (camera.width_px, camera.height_px))
    pixel = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    return pixel, np.outer(weight, weight).ravel() / 4.0
