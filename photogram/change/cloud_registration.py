"""Co-registration of two clouds on ground that has not moved, point to surface.

Points are first replaced by their means over cells as wide as their errors are alike. Every mean of the later cloud has
a curved surface in the earlier one, of second degree through the nearest means; the motion makes the distances to their
tangent planes least, n·(p − q) (Chen & Medioni 1992). The covariance is that of the jackknife: the fit is made again
without each patch of the ground, so that neighbours may be off together (Tukey 1958; clusters as Bell & McCaffrey
2002).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray, nmad
from photogram.errors import SurfaceError
from photogram.survey import PointCloud
from photogram.volumes.stable_ground import FEWEST_CELLS, Motion, Registration
from photogram.wording import percent

SURFACE_POINTS, ROUNDS = 20, 30
"""Means through which a surface is laid, and rounds at most."""

MOST_NOISE = 0.1
"""Share of the variance of slopes that may be noise: by so much a shift in plan is found too small."""

AROUND_CELLS = 4
"""Cells around the stable ground from which the earlier cloud is taken."""

FAR_AWAY = 5.0
"""Normalised median absolute deviations beyond which a mean is not stable ground. Nothing says how noise differs from
place to place here, so a nearer limit would cut off the noise of the worst ones."""

PATCH_CELLS, ENOUGH_PATCHES = (20, 14, 10), 12
"""Side of the patches of the jackknife in cells: the largest that leaves so many patches, or else the last."""

NAMES = ("offset_east_m", "offset_north_m", "offset_m", "rotation_east_rad", "rotation_north_rad", "rotation_up_rad")
PARAMETERS: dict[Motion, tuple[int, ...]] = {"offset": (2,), "tilt": (2, 3, 4), "rigid": (0, 1, 2, 3, 4, 5)}
"""Of the six, those of a motion; rotations about axes through the middle of the stable ground."""


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A later cloud lies off by p − p₀ → R (p − p₀) + t; what was found is taken off by ``apply``."""

    centre_map_m: FloatArray
    """p₀ (3,)."""
    rotation: FloatArray
    """R (3, 3) that brings the later cloud to the earlier one."""
    shift_m: FloatArray
    """t (3,) that does."""
    covariance: FloatArray
    """Of shift and rotation (6, 6), 0 where they were not estimated."""

    def apply(self, points_map_m: FloatArray) -> FloatArray:
        """Return points (N, 3) of the later cloud as the earlier one has them."""
        return np.asarray((points_map_m - self.centre_map_m) @ self.rotation.T + self.centre_map_m + self.shift_m)

    def sigma_m(self, points_map_m: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the standard deviation (N,) that it leaves at points (N, 3) along normals (N, 3)."""
        gradient = _gradient(points_map_m - self.centre_map_m, normal)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", gradient, self.covariance, gradient)))


def _gradient(from_centre_m: FloatArray, normal: FloatArray) -> FloatArray:
    """Return what distances (N,) along normals gain (N, 6) by shifts and rotations."""
    return np.concatenate([normal, np.cross(from_centre_m, normal)], axis=1)


def _rotation(angle_rad: FloatArray) -> FloatArray:
    """Return the rotation by a vector (3,), by Rodrigues' formula."""
    size = float(np.linalg.norm(angle_rad))
    if size == 0.0:
        return np.eye(3)
    x, y, z = angle_rad / size
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(size) * k + (1.0 - np.cos(size)) * k @ k)


def _means(points_map_m: FloatArray, cell_m: float) -> FloatArray:
    """Return the means (K, 3) of points (N, 3) over square cells in plan."""
    if not len(points_map_m):
        return points_map_m
    origin = np.floor(points_map_m.min(axis=0))
    cell = np.floor((points_map_m[:, :2] - origin[:2]) / cell_m).astype(np.int64)
    _, of, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(of.reshape(-1), values) for values in (points_map_m - origin).T]
    return np.asarray(np.column_stack(sums) / count[:, None] + origin)


def _surfaces(earlier_m: FloatArray, tree: cKDTree, places_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the heights (N,) of places (N, 3) above surfaces of second degree through the points nearest in plan, the
    normals (N, 3), and the mean variance (2,) of their slopes by noise."""
    _, near = tree.query(places_m[:, :2], k=min(SURFACE_POINTS, len(earlier_m)))
    off = earlier_m[near] - places_m[:, None]
    scale = np.sqrt(np.mean(np.sum(off[..., :2] ** 2, axis=2)))
    x, y = off[..., 0] / scale, off[..., 1] / scale
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    normals = np.einsum("nki,nkj->nij", design, design) + 1e-9 * np.eye(6)
    fitted = np.linalg.solve(normals, np.einsum("nki,nk->ni", design, off[..., 2])[..., None])[..., 0]
    normal = np.column_stack([-fitted[:, 1] / scale, -fitted[:, 2] / scale, np.ones(len(places_m))])
    left = off[..., 2] - np.einsum("nki,ni->nk", design, fitted)
    noise = np.sum(left**2) / left.size * left.shape[1] / max(left.shape[1] - design.shape[2], 1)
    slopes = np.mean(np.diagonal(np.linalg.inv(normals), axis1=1, axis2=2)[:, 1:3], axis=0) * noise / scale**2
    return -fitted[:, 0], normal / np.linalg.norm(normal, axis=1)[:, None], slopes


def _jackknifed(gradient: FloatArray, residual: FloatArray, places_m: FloatArray, cell_m: float) -> FloatArray:
    """Return the covariance (P, P) of a fit from what it changes by without each patch, (N − N_k)⁻¹ u_k with the
    patch's normals N_k and u_k = Σ g r."""
    for cells in PATCH_CELLS:
        patch = np.floor(places_m[:, :2] / (cells * cell_m)).astype(np.int64)
        of = np.unique(patch, axis=0, return_inverse=True)[1].reshape(-1)
        patches = int(of.max()) + 1
        if patches >= ENOUGH_PATCHES:
            break
    products = gradient[:, :, None] * gradient[:, None, :]
    shape = products.shape[1:]
    normals = np.stack([np.bincount(of, column) for column in products.reshape(len(of), -1).T], axis=1)
    score = np.stack([np.bincount(of, column) for column in (gradient * residual[:, None]).T], axis=1)
    without = np.sum(products, axis=0) - normals.reshape(-1, *shape)
    change = np.einsum("kij,kj->ki", np.linalg.pinv(without), score)
    return np.asarray(change.T @ change * (patches - 1) / patches)


def register_clouds(
    earlier: PointCloud, later: PointCloud, polygons: Sequence[Any], motion: Motion, correlation_m: float
) -> tuple[Registration, RigidMotion]:
    """Return how a later cloud lies over an earlier one on stable polygons, and the motion that takes that off.

    Standard deviations come from the scatter of the residuals. Raises SurfaceError for fewer than FEWEST_CELLS cells
    of ``correlation_m`` with points, or ground too even for the motion.
    """
    area = shapely.union_all(list(polygons))
    around = shapely.buffer(area, AROUND_CELLS * correlation_m)  # surfaces at the rim need points beyond it
    inside = []
    for cloud, within in ((earlier, around), (later, area)):
        shapely.prepare(within)
        chosen = shapely.contains_xy(within, cloud.position_map_m[:, :2])
        inside.append(_means(cloud.position_map_m[chosen], correlation_m))
    if min(len(points) for points in inside) < FEWEST_CELLS:
        raise SurfaceError(
            f"stable ground: {min(len(points) for points in inside)} cells of {correlation_m:g} m have points of both "
            f"clouds, {FEWEST_CELLS} are needed: draw larger polygons where both have points"
        )
    points = inside[1]
    used, centre = list(PARAMETERS[motion]), points.mean(axis=0)
    rotation = np.eye(3)
    shift = np.zeros(3)
    before = np.zeros(0)
    earlier_m, from_centre = inside[0] - centre, points - centre
    tree = cKDTree(earlier_m[:, :2])
    for number in range(ROUNDS):
        moved = from_centre @ rotation.T + shift
        above, normal, slope_noise = _surfaces(earlier_m, tree, moved)
        residual = normal[:, 2] * above
        before = residual if number == 0 else before
        keep = np.abs(residual - np.median(residual)) <= max(FAR_AWAY * nmad(residual), 1e-9)
        gradient = _gradient(moved, normal)[:, used]
        normals = gradient[keep].T @ gradient[keep]
        step = np.zeros(6)
        step[used] = -np.linalg.lstsq(normals, gradient[keep].T @ residual[keep], rcond=1e-12)[0]
        turn = _rotation(step[3:])
        rotation, shift = turn @ rotation, turn @ shift + step[:3]
        if np.linalg.norm(step[:3]) < 1e-6 and np.linalg.norm(step[3:]) < 1e-9:
            break
    covariance = np.zeros((6, 6))
    jackknifed = _jackknifed(gradient[keep], residual[keep], from_centre[keep], correlation_m)
    covariance[np.ix_(used, used)] = jackknifed
    scatter = float(np.sqrt(np.mean(residual[keep] ** 2)))
    sigma = np.sqrt(np.diag(covariance))[used]
    slope = normal[keep, :2] / normal[keep, 2:]
    share = float(np.max(slope_noise / np.maximum(np.var(slope, axis=0), 1e-30)))
    if motion == "rigid" and share > MOST_NOISE:
        raise SurfaceError(
            f"co-registration: the stable ground is too flat to determine a rigid transformation "
            f"({percent(min(share, 1.0))} of its slope variation is noise): choose tilt, or add stable ground "
            "that slopes in different directions"
        )
    # what the later cloud is off by is the opposite of what brings it back
    value = np.concatenate([-shift, -_vector(rotation)])[used]
    record = Registration(
        motion=motion,
        names=tuple(NAMES[k] for k in used),
        value=value,
        sigma=sigma,
        expected_sigma=np.full(len(used), np.nan),
        centre_map_m=tuple(map(float, centre)),
        cells=int(keep.sum()),
        rejected=int((~keep).sum()),
        before_median_m=float(np.median(before)),
        before_nmad_m=nmad(before),
        after_rms_m=scatter,
        after_nmad_m=nmad(residual),
        remaining_m=0.0,
        patches=0,
    )
    return record, RigidMotion(centre, rotation, shift, covariance)


def _vector(rotation: FloatArray) -> FloatArray:
    """Return the vector (3,) of a small rotation."""
    return np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    ) / 2  # fmt: skip
