"""The plane that a surface counts its heights from where the map serves badly: a facade, a quarry face, a dam.

The plane is fitted to tie points: candidates through three of them that the photographs face, scored by a truncated
quadratic (MSAC; Torr & Zisserman 2000) in the narrowest band that holds half of the points, then least squares
of the distances, reweighted by Tukey's biweight (Beaton & Tukey 1974) until nothing moves. Triples are drawn by number,
with a fixed seed: the same points give the same plane, and points that are turned give the plane turned with them.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from photogram.arrays import NMAD_FACTOR, FloatArray
from photogram.camera import Pose
from photogram.geodesy.frames import LocalFrame
from photogram.survey import Block
from photogram.wording import percent

LEVEL_DEG = 10.0
"""A plane that leans less from level is the world's: a map shows it with all but 1.5 % of its lengths."""

LEAST_FACING = 0.5
"""Cosine between a plane's normal and the direction to the photographs: what is seen at less than 30° shows little."""

LEAST_AGREEMENT = 0.5
"""Length of the mean of the optical axes below which photographs look to all sides, and face no single plane."""

BANDS = (0.01, 0.02, 0.04, 0.08)
"""Distances from a plane up to which a point is on it, in distances of the photographs, narrowest first."""

ENOUGH, LEAST_SHARE = 0.5, 0.25
"""Share of the points with which a band is wide enough, and with which the widest must do at least."""

RELIEF_SHARE = 0.5
"""What lies further in front of the plane or behind it than this, in distances of the photographs, is no part of it."""

MINIMUM_POINTS = 20

_TRIPLES, _SAMPLE = 1500, 2000
_BIWEIGHT = 4.685  # of Tukey, 95 % efficient for normal errors
_ROUNDS = 100
_LINE = 3.0  # the points reach so many times farther along the plane, both ways, than across it
_UP, _EAST = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class ReferencePlane:
    """A right-handed frame on a plane: x level and to the right as the photographs see it, y up the plane, z out of it
    towards them."""

    origin_world_m: FloatArray
    """Origin (3,): the point of the plane next to the world's origin."""
    rotation_world_from_plane: FloatArray
    """Rotation (3, 3); its columns are the axes x, y, z in the world."""

    def plane_from_world(self, points_world_m: FloatArray) -> FloatArray:
        """Return the plane coordinates (N, 3) of points (N, 3) of the world."""
        return np.asarray((points_world_m - self.origin_world_m) @ self.rotation_world_from_plane)

    def world_from_plane(self, points_plane_m: FloatArray) -> FloatArray:
        """Return the world coordinates (N, 3) of points (N, 3) of the plane's frame."""
        return np.asarray(points_plane_m @ self.rotation_world_from_plane.T + self.origin_world_m)

    def covariance_m2(self, covariance_world_m2: FloatArray) -> FloatArray:
        """Return covariances (..., 3, 3) along the axes of the plane of those along the world's."""
        R = self.rotation_world_from_plane
        return np.asarray(R.T @ covariance_world_m2 @ R)


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A plane fitted to tie points."""

    plane: ReferencePlane | None
    """The plane, None where it is level: then the world's serves."""
    tilt_deg: float
    """Angle from level: 90 for an upright plane, more for one that hangs over."""
    points: int
    """Number of points that it was fitted to."""
    on_plane: float
    """Share of them within ``band_m`` of it."""
    band_m: float
    """Distance up to which a point counts as on the plane."""
    nmad_m: float
    """Normalised median absolute deviation of these from it."""
    distance_m: float
    """Median distance of the points from the nearest photograph."""

    @property
    def relief_m(self) -> float:
        """Distance from the plane beyond which a point is no part of its surface."""
        return RELIEF_SHARE * self.distance_m


def fit_plane(points_world_m: FloatArray, poses: tuple[Pose | None, ...]) -> PlaneFit | str:
    """Return the plane through most of the points (N, 3) that face photographs of these poses, or why there is none."""
    points = points_world_m[np.isfinite(points_world_m).all(axis=1)]
    if len(points) < MINIMUM_POINTS:
        return f"{len(points)} tie points are too few for a plane"
    oriented = [pose for pose in poses if pose is not None]
    axis = np.mean([pose.rotation_world_from_camera[:, 2] for pose in oriented], axis=0)
    agreement = float(np.linalg.norm(axis))
    if agreement < LEAST_AGREEMENT:
        return "the photographs look to all sides: no single plane shows what they show"
    towards = -axis / agreement
    nearest, _ = cKDTree(np.array([pose.position_world_m for pose in oriented])).query(points)
    distance_m = float(np.median(nearest))
    with threadpool_limits(1, "blas"):  # sums in one order, whatever the number of cores
        best = _consensus(points, towards, distance_m)
        if best is None:
            return "the tie points form no plane that the photographs face"
        normal, place, band_m, share = best
        if share < LEAST_SHARE:
            return (
                f"the tie points form no plane that the photographs face: at most {percent(share)} of them lie "
                f"within {band_m:.2g} m of one"
            )
        normal, place, spread_m = _refined(points, normal, place, towards, band_m)
    off = (points - place) @ normal
    on = np.abs(off) <= band_m
    nmad_m = float(NMAD_FACTOR * np.median(np.abs(off[on])))
    if spread_m[1] < _LINE * max(spread_m[0], nmad_m):
        return "the tie points lie along a line, through which many planes go"
    tilt_deg = float(np.rad2deg(np.arctan2(np.hypot(normal[0], normal[1]), normal[2])))
    plane = None if tilt_deg < LEVEL_DEG else _framed(normal, place)
    return PlaneFit(plane, tilt_deg, len(points), float(on.mean()), band_m, nmad_m, distance_m)


def _consensus(
    points: FloatArray, towards: FloatArray, distance_m: float
) -> tuple[FloatArray, FloatArray, float, float] | None:
    """Return normal (3,) and a point (3,) of the best plane through three points, the band it was scored in, and the
    share of the points within; None where no candidate faces the photographs."""
    rng = np.random.default_rng(0)
    sample = points[np.sort(rng.permutation(len(points))[:_SAMPLE])]
    a, b, c = (sample[rng.integers(len(sample), size=_TRIPLES)] for _ in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    usable = length > (BANDS[0] * distance_m) ** 2
    normal, a = normal[usable] / length[usable, None], a[usable]
    facing = normal @ towards
    normal, a = (values[np.abs(facing) >= LEAST_FACING] for values in (normal, a))
    if not len(a):
        return None
    off2 = (normal @ sample.T - np.sum(normal * a, axis=1)[:, None]) ** 2
    best = 0
    band_m = 0.0
    share = 0.0
    for band in BANDS:
        band_m = band * distance_m
        best = int(np.argmin(np.sum(np.minimum(off2, band_m**2), axis=1)))
        share = float(np.mean(off2[best] <= band_m**2))
        if share >= ENOUGH:
            break
    return normal[best], a[best], band_m, share


def _refined(
    points: FloatArray, normal: FloatArray, place: FloatArray, towards: FloatArray, band_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normal (3,) towards the photographs, centre (3,), and the standard deviations (3,) of the points across
    the plane and along it, after reweighted least squares of the distances of points within a band."""
    spread = np.zeros(3)
    for _ in range(_ROUNDS):
        off = (points - place) @ normal
        near = np.abs(off) <= band_m
        scale = max(float(NMAD_FACTOR * np.median(np.abs(off[near]))), 1e-6 * band_m)
        weight = np.where(near, np.clip(1.0 - (off / (_BIWEIGHT * scale)) ** 2, 0.0, None) ** 2, 0.0)
        centre = weight @ points / weight.sum()
        apart = points - centre
        value, vector = np.linalg.eigh((weight[:, None] * apart).T @ apart / weight.sum())
        turned = vector[:, 0] * (1.0 if vector[:, 0] @ towards > 0.0 else -1.0)
        moved = max(float(np.linalg.norm(turned - normal)), abs(float((centre - place) @ turned)) / band_m)
        normal = turned
        place = centre
        spread = np.sqrt(np.maximum(value, 0.0))
        if moved < 1e-10:
            break
    return normal, place, spread


def _framed(normal: FloatArray, place: FloatArray) -> ReferencePlane:
    """Return the frame on a plane that is not level."""
    right = np.cross(_UP, normal)
    across = float(np.linalg.norm(right))
    # a ceiling is level too, and seen from below: east is to the right
    right = right / across if across > np.sin(np.deg2rad(LEVEL_DEG)) else _EAST - (_EAST @ normal) * normal
    right = right / np.linalg.norm(right)
    rotation = np.column_stack([right, np.cross(normal, right), normal])
    return ReferencePlane(np.asarray((place @ normal) * normal), rotation)


def block_on_plane(block: Block, plane: ReferencePlane) -> Block:
    """Return an adjusted block in the frame of a plane: cameras, poses, tie points and ground points turned rigidly.

    The map of its frame is the plane: x, y, and the distance in front. What was measured along the axes of the map
    (GNSS, attitudes, offsets, the sigmas of ground points) has done its work and is left out: it serves to make
    surfaces, not to be adjusted.
    """
    R = plane.rotation_world_from_plane
    points = block.control_points
    return replace(
        block,
        frame=LocalFrame.local(),
        photographs=tuple(
            replace(
                photograph,
                gnss_world_m=None,
                gnss_sigma_m=None,
                attitude_world_from_camera=None,
                attitude_sigma_rad=None,
                lever_arm_camera_m=None,
            )
            for photograph in block.photographs
        ),
        poses=tuple(
            None
            if pose is None
            else Pose(
                R.T @ pose.rotation_world_from_camera,
                plane.plane_from_world(pose.position_world_m),
                R.T @ pose.velocity_world_m_s,
            )
            for pose in block.poses
        ),
        tie_points=replace(
            block.tie_points, position_world_m=plane.plane_from_world(block.tie_points.position_world_m)
        ),
        control_points=replace(
            points,
            position_world_m=plane.plane_from_world(points.position_world_m),
            sigma_m=np.full(points.sigma_m.shape, np.nan),
        ),
        gnss_offset_sigma_m=np.zeros(3),
        common_errors=(),
        constraints=(),
        known_surface=None,
    )
