"""M3C2: distances of two clouds along the normals of the ground, with their level of detection (Lague et al. 2013).

py4dgeo (3DGeo, Heidelberg) computes distances, spreads and counts; it is installed by the extra ``change``. Where both
clouds say how good their points are, the level of detection is that of precision maps (James et al. 2017): by their
standard deviations, with errors of neighbours that are alike counted once, and what all share added once. Without, it
is by roughness.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Annotated

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import PhotogramError, SurfaceError
from photogram.settings.settings import Default, Settings, Within
from photogram.survey import PointCloud
from photogram.volumes.correlation import independent_points
from photogram.volumes.differences import LEVEL

CYLINDER_SPACINGS, NORMAL_CYLINDERS = 4.0, 2.0
"""Radius of the cylinder in spacings of the points (50 points), and that of normals in radii of the cylinder."""

LEAST_POINTS = 4
"""Points of each cloud below which a distance has no level of detection (Lague et al. 2013 take 5 to be enough)."""

NEAREST = 24
"""Points near a core point whose standard deviations are averaged."""


@dataclass(frozen=True)
class M3C2Settings(Settings):
    """Scales of M3C2."""

    radius_m: Annotated[
        float | None,
        Within(0.0001, 10_000, "m"),
        "Radius of the cylinder, half the projection scale.",
        Default("by the spacing of the points"),
    ] = None
    normal_radius_m: Annotated[
        float | None,
        Within(0.0001, 10_000, "m"),
        "Radius of the ball in which a normal is determined, half the normal scale.",
        Default("by the spacing of the points"),
    ] = None
    spacing_m: Annotated[
        float | None, Within(0.0001, 10_000, "m"), "Spacing of core points.", Default("radius of the cylinder")
    ] = None
    depth_m: Annotated[float, Within(0.0001, 10_000, "m"), "How far along the normal ground is looked for."] = 10.0


@dataclass(frozen=True, eq=False)
class CloudErrors:
    """Standard deviations of a cloud, m."""

    own_m: FloatArray
    """Of each point's height, its own (N,)."""
    common_m: FloatArray
    """Of what neighbours share, at each point (N,)."""
    correlation_m: float
    """Width over which own errors correlate."""


@dataclass(frozen=True, eq=False)
class M3C2:
    """Distances at core points (N,), later minus earlier along the normal; NaN where a cloud has no points."""

    core_map_m: FloatArray
    """(N, 3)."""
    normal: FloatArray
    """Unit vectors (N, 3), upwards."""
    distance_m: FloatArray
    level_m: FloatArray
    """Level of detection, 95 %; NaN with fewer than LEAST_POINTS of one cloud."""
    roughness_level_m: FloatArray
    """The same by roughness alone (Lague et al. 2013, eq. 1)."""
    points: FloatArray
    """Points of both clouds in the cylinder (N, 2)."""
    settings: M3C2Settings
    """As they were used."""

    @property
    def significant(self) -> BoolArray:
        """Return where the distance exceeds its level of detection."""
        return np.abs(self.distance_m) > self.level_m


def spacing_of(cloud: PointCloud) -> float:
    """Return the spacing of a cloud's points in plan: the median distance to the fourth neighbour, which in a square
    lattice is its side."""
    xy = cloud.position_map_m[:, :2] - cloud.position_map_m[0, :2]
    some = xy[np.unique(np.linspace(0, len(xy) - 1, min(len(xy), 20_000)).astype(np.int64))]
    distance = np.asarray(cKDTree(xy).query(some, k=min(5, len(xy)))[0])
    return float(max(np.median(distance[:, -1]), 1e-6))


def core_points(cloud: PointCloud, spacing_m: float) -> FloatArray:
    """Return the points (N, 3) of a cloud nearest to the middles of square cells of a spacing in plan."""
    xy = cloud.position_map_m[:, :2] - cloud.position_map_m[:, :2].min(axis=0)
    cell = np.floor(xy / spacing_m).astype(np.int64)
    off = np.sum((xy - (cell + 0.5) * spacing_m) ** 2, axis=1)
    order = np.lexsort((off, cell[:, 0], cell[:, 1]))
    new = np.any(np.diff(cell[order], axis=0, prepend=-1) != 0, axis=1)
    return cloud.position_map_m[np.sort(order[new])]


def m3c2(
    earlier: PointCloud,
    later: PointCloud,
    settings: M3C2Settings | None = None,
    errors: tuple[CloudErrors, CloudErrors] | None = None,
    aligned: Callable[[FloatArray, FloatArray], FloatArray] | None = None,
) -> M3C2:
    """Compare two clouds at core points of the earlier one.

    ``errors`` are those of the earlier and the later cloud; ``aligned`` gives for points (N, 3) and normals (N, 3) the
    standard deviation (N,) that an alignment leaves. Raises PhotogramError where py4dgeo is not installed,
    SurfaceError where a cloud has fewer than LEAST_POINTS points.
    """
    if min(len(earlier), len(later)) < LEAST_POINTS:
        raise SurfaceError(f"M3C2: a cloud has fewer than {LEAST_POINTS} points: export it again")
    settings = settings or M3C2Settings()
    spacing = max(spacing_of(earlier), spacing_of(later))
    radius = settings.radius_m or CYLINDER_SPACINGS * spacing
    used = M3C2Settings(
        radius, settings.normal_radius_m or NORMAL_CYLINDERS * radius, settings.spacing_m or radius, settings.depth_m
    )
    core = core_points(earlier, used.spacing_m or radius)
    normal, distance, spread, count = _distances(earlier, later, core, used)
    enough = np.all(count >= LEAST_POINTS, axis=1)
    scatter = np.sqrt(np.sum(spread**2 / np.maximum(count, 1.0), axis=1))
    registration = np.zeros(len(core)) if aligned is None else aligned(core, normal)
    by_roughness = np.where(enough, LEVEL * (scatter + registration), np.nan)
    level = by_roughness
    if errors is not None:
        variance = registration**2
        for cloud, of, s, n in zip((earlier, later), errors, spread.T, count.T, strict=True):
            variance = variance + _mean_variance(core, normal, cloud, of, s, n, radius)
        level = np.where(enough, LEVEL * np.sqrt(variance), np.nan)
    return M3C2(core, normal, distance, level, by_roughness, count, used)


def _mean_variance(
    core_m: FloatArray,
    normal: FloatArray,
    cloud: PointCloud,
    errors: CloudErrors,
    spread_m: FloatArray,
    count: FloatArray,
    radius_m: float,
) -> FloatArray:
    """Return the variance (N,) of the mean of a cloud's points in a cylinder along its normal.

    Own errors of points within a correlation length count once; where the ground is rougher than they are, its spread
    counts in their place. Heights are what errs: along a normal n it is n_z times as much.
    """
    origin = cloud.position_map_m[0]
    distance, near = cKDTree(cloud.position_map_m - origin).query(
        core_m - origin, k=min(NEAREST, len(cloud)), distance_upper_bound=2.0 * radius_m
    )
    known = np.isfinite(distance)
    near = np.where(known, near, 0)
    total = np.maximum(known.sum(axis=1), 1)
    own = np.sum(np.where(known, errors.own_m[near] ** 2, 0.0), axis=1) / total
    common = np.sum(np.where(known, errors.common_m[near] ** 2, 0.0), axis=1) / total
    up = normal[:, 2] ** 2
    worth = independent_points(count, radius_m, errors.correlation_m)
    alone = np.maximum(up * own / np.maximum(worth, 1.0), spread_m**2 / np.maximum(count, 1.0))
    return np.asarray(alone + up * common)


def _py4dgeo() -> ModuleType:
    """Return py4dgeo without its habit of printing, and of leaving a log file where the command runs. Raises
    PhotogramError where it is not installed."""
    try:
        module = import_module("py4dgeo")
    except ImportError as error:
        raise PhotogramError(
            f"M3C2 needs py4dgeo ({error}): pip install 'photogram[change]', which has it for Linux (x86-64), "
            "macOS 14 (arm64) and Windows"
        ) from error
    log = logging.getLogger("py4dgeo")
    for handler in tuple(log.handlers):
        log.removeHandler(handler)
        handler.close()
    return module


def _distances(
    earlier: PointCloud, later: PointCloud, core_m: FloatArray, settings: M3C2Settings
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return normals (N, 3), distances (N,), spreads (N, 2) and numbers of points (N, 2) as py4dgeo finds them."""
    py4dgeo = _py4dgeo()
    origin = np.floor(core_m.mean(axis=0))  # py4dgeo's search trees hold single precision
    epochs = tuple(py4dgeo.Epoch(np.ascontiguousarray(c.position_map_m - origin)) for c in (earlier, later))
    algorithm = py4dgeo.M3C2(
        epochs=epochs, corepoints=np.ascontiguousarray(core_m - origin), normal_radii=[settings.normal_radius_m],
        cyl_radius=settings.radius_m, max_distance=settings.depth_m, registration_error=0.0,
    )  # fmt: skip
    distance, uncertainty = algorithm.run()
    spread = np.column_stack([uncertainty["spread1"], uncertainty["spread2"]])
    count = np.column_stack([uncertainty["num_samples1"], uncertainty["num_samples2"]]).astype(np.float64)
    return (
        np.array(algorithm.directions(), dtype=np.float64), np.array(distance, dtype=np.float64),
        np.nan_to_num(spread), count,
    )  # fmt: skip
