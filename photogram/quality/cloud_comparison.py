"""Point clouds against a reference: nearest distances, height differences, and robust statistics of both.

Agreement with a reference is accuracy only where the reference is known to be better than the cloud.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import map_coordinates
from scipy.spatial import Delaunay, QhullError, cKDTree
from threadpoolctl import threadpool_limits

from photogram.arrays import BoolArray, FloatArray, nmad
from photogram.errors import SettingError, SurfaceError
from photogram.quality.far_references import (
    ABOVE_REMEDY,
    BESIDE_REMEDY,
    FAR_SPACINGS,
    above,
    beside,
    extent_of,
    is_far,
    spacing_of,
    thinned,
)
from photogram.survey import PointCloud, Raster

FAR_M = 5.0
"""In height, beyond which a reference is doubted: no two height systems of one site are nearer by chance."""


@dataclass(frozen=True)
class CloudStatistics:
    """Statistics of differences, m."""

    points: int
    """Number of points."""
    compared: int
    """Points where the reference has data."""
    mean_m: float
    """Mean."""
    std_m: float
    """Standard deviation about the mean with n − 1, NaN of a single difference."""
    median_m: float
    """Median."""
    nmad_m: float
    """Normalised median absolute deviation."""
    rmse_m: float
    """Root mean square."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A cloud against a reference, after the filter."""

    position_map_m: FloatArray
    """Compared points (N, 3)."""
    surface_difference_m: FloatArray
    """Cloud minus reference in height (N,), NaN where the reference has no data."""
    cloud_distance_m: FloatArray
    """Distance to the nearest point of the reference (N,)."""
    cloud_to_surface: CloudStatistics
    """Statistics of the height differences."""
    cloud_to_cloud: CloudStatistics
    """Statistics of the distances."""
    removed: int
    """Points removed by the SOR filter."""

    @property
    def doubt(self) -> str:
        """Return in words that the reference lies far off in height, where it does beyond FAR_M and what heights
        scatter by, and what to check."""
        heights = self.cloud_to_surface
        far = is_far(heights.median_m, heights.nmad_m, FAR_M / FAR_SPACINGS)
        return f"the reference: {above(-heights.median_m)}: {ABOVE_REMEDY}" if far else ""

    def __repr__(self) -> str:
        heights = self.cloud_to_surface
        figures = f"mean {heights.mean_m:+.4f} m, NMAD {heights.nmad_m:.4f} m in height"
        return f"<Comparison of {len(self.position_map_m)} points, {self.removed} filtered out: {figures}>"


def statistics(differences_m: FloatArray) -> CloudStatistics:
    """Return the statistics of differences (N,) in m, NaN left out. Raises SurfaceError when none is left."""
    d = differences_m[np.isfinite(differences_m)]
    if len(d) == 0:
        raise SurfaceError(
            f"comparison: none of the {len(differences_m)} points lies where the reference has data: "
            "check that both are of the same site and in the same CRS"
        )
    return CloudStatistics(
        points=len(differences_m),
        compared=len(d),
        mean_m=float(d.mean()),
        std_m=float(d.std(ddof=1)) if len(d) > 1 else float("nan"),
        median_m=float(np.median(d)),
        nmad_m=nmad(d),
        rmse_m=float(np.sqrt(np.mean(d * d))),
    )


def sor_filter(points_m: FloatArray, neighbours: int = 6, sigma: float = 1.0) -> BoolArray:
    """Return which points (N, 3) statistical outlier removal keeps, point for point as CloudCompare does.

    After Rusu et al. 2008. The mean distance of a point to its nearest points may exceed the mean of these means by
    at most ``sigma`` of their standard deviations (with n). CloudCompare counts the point itself among the
    ``neighbours`` and leaves it out of the mean: 6 neighbours are the point and the 5 nearest others.
    """
    if neighbours < 2:
        raise SettingError("neighbours", f"must be at least 2, the point itself counts, found {neighbours}")
    count = min(neighbours, len(points_m))
    if count < 2:
        return np.ones(len(points_m), dtype=bool)
    centred = points_m - points_m.mean(axis=0)
    distance = np.asarray(cKDTree(centred).query(centred, count)[0], dtype=np.float64)
    mean = distance[:, 1:].mean(axis=1)
    return np.asarray(mean <= mean.mean() + sigma * mean.std())


def cloud_to_cloud(cloud: PointCloud, reference: PointCloud) -> FloatArray:
    """Return the distance (N,) in m of each point to the nearest point of the reference.

    Raises SurfaceError when the reference is empty.
    """
    if len(reference) == 0:
        raise SurfaceError("comparison: the reference contains no points")
    origin = reference.position_map_m[0]
    tree = cKDTree(reference.position_map_m - origin)
    distance, _ = tree.query(cloud.position_map_m - origin)
    return np.asarray(distance, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class TriangulatedCloud:
    """A reference cloud triangulated in plan (Delaunay), made once by ``triangulate`` for all clouds compared with it.

    ``points`` the cloud; ``origin_map_m`` (3,) the origin of the triangulation; ``bridging`` (T,) which of its
    triangles have an edge longer than the maximum gap in plan and are no surface.
    """

    points: PointCloud
    origin_map_m: FloatArray
    triangulation: Delaunay
    bridging: BoolArray

    def heights(self, points_map_m: FloatArray) -> FloatArray:
        """Return the height (K,) in m of the surface at points (K, 2 or more) of the map, NaN off it and in gaps."""
        place = points_map_m[:, :2] - self.origin_map_m[:2]
        height_m = self.points.position_map_m[:, 2] - self.origin_map_m[2]
        with threadpool_limits(1, "blas"):  # SciPy solves a 2 × 2 system per triangle: threads take 60 times the CPU
            height = LinearNDInterpolator(self.triangulation, height_m)(place)
            triangle = self.triangulation.find_simplex(place)
        bridged = (triangle >= 0) & self.bridging[triangle]
        return np.where(bridged, np.nan, height + self.origin_map_m[2])


Reference: TypeAlias = Raster | PointCloud | TriangulatedCloud


def triangulate(reference: PointCloud, maximum_gap_m: float | None = None) -> TriangulatedCloud:
    """Triangulate a reference cloud in plan; triangles with an edge longer than ``maximum_gap_m`` there, by default 10
    times the median edge, count as gaps.

    Raises SurfaceError for a cloud of fewer than three points, or of points on one line.
    """
    if len(reference) < 3:
        raise SurfaceError(f"comparison: the reference has {len(reference)} points: a surface needs at least 3")
    origin = reference.position_map_m.min(axis=0)
    vertex = reference.position_map_m - origin
    try:
        triangulation = Delaunay(vertex[:, :2])
    except QhullError as error:
        raise SurfaceError(
            f"comparison: the {len(reference)} points of the reference lie on one line in plan"
        ) from error
    corners = vertex[triangulation.simplices][..., :2]
    edge_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    gap_m = 10 * np.median(edge_m) if maximum_gap_m is None else maximum_gap_m
    return TriangulatedCloud(reference, origin, triangulation, edge_m.max(axis=1) > gap_m)


def cloud_to_surface(cloud: PointCloud, reference: Reference) -> FloatArray:
    """Return the height (N,) in m of each point above (positive) or below the reference.

    NaN where the reference has no data. A raster is interpolated bilinearly between cell centres; all four must hold
    data. A cloud is triangulated (``triangulate``) and interpolated linearly. Raises SurfaceError for a reference
    cloud of fewer than three points, or of points on one line.
    """
    points = cloud.position_map_m
    if isinstance(reference, Raster):
        return points[:, 2] - _raster_height(reference, points)
    surface = triangulate(reference) if isinstance(reference, PointCloud) else reference
    return points[:, 2] - surface.heights(points)


def compare_to_reference(cloud: PointCloud, reference: Reference, sor: bool = True) -> Comparison:
    """Compare a cloud with a reference in the same CRS, by height and by nearest distance.

    ``sor`` first filters the cloud with sor_filter's defaults. The points of a raster, for the nearest distances, are
    its cell centres. For several clouds give a reference cloud as ``triangulate`` returns it. Nearest distances from a
    reference that lies far off in height are measured to its thinned points. Raises SurfaceError when the cloud is
    empty or does not overlap the reference.
    """
    if len(cloud) == 0:
        raise SurfaceError("comparison: the cloud contains no points")
    apart = beside(_extent(reference), extent_of(cloud.position_map_m))
    if apart:
        raise SurfaceError(f"comparison: the reference does not overlap the cloud; {apart}: {BESIDE_REMEDY}")
    surface = triangulate(reference) if isinstance(reference, PointCloud) else reference
    keep = sor_filter(cloud.position_map_m) if sor else np.ones(len(cloud), dtype=bool)
    kept = PointCloud(cloud.position_map_m[keep])
    difference = cloud_to_surface(kept, surface)
    overlap = statistics(difference)
    spacing_m = surface.cell_m if isinstance(surface, Raster) else spacing_of(surface.points.position_map_m)
    far = is_far(overlap.median_m, overlap.nmad_m, spacing_m)
    if far:
        around_m = abs(overlap.median_m)
        place_m = kept.position_map_m
        there = _cell_centres(surface, place_m, around_m) if isinstance(surface, Raster) else surface.points
        distance = cloud_to_cloud(kept, thinned(there, overlap.median_m))
    elif isinstance(surface, Raster):
        distance = _distance_to_cells(kept, surface)
    else:
        distance = cloud_to_cloud(kept, surface.points)
    return Comparison(kept.position_map_m, difference, distance, overlap, statistics(distance), int(np.sum(~keep)))


def _raster_height(raster: Raster, points_map_m: FloatArray) -> FloatArray:
    column = (points_map_m[:, 0] - raster.west_map_m) / raster.cell_m - 0.5
    row = (raster.north_map_m - points_map_m[:, 1]) / raster.cell_m - 0.5
    # A NaN among the four cells makes the sample NaN, whatever its weight.
    return np.asarray(
        map_coordinates(
            raster.values, np.stack([row, column]), output=np.float64, order=1, mode="constant", cval=np.nan
        )
    )


def _distance_to_cells(cloud: PointCloud, raster: Raster) -> FloatArray:
    """Return the distance (N,) to the nearest cell centre with data, reading no more of the raster than it takes.

    A distance found within a margin around the cloud is exact when it is not longer than the margin; the longest
    distance found bounds every true one, so a second pass with that margin is always exact.
    """
    margin_m = 10 * raster.cell_m
    for _ in range(2):
        cells = _cell_centres(raster, cloud.position_map_m, margin_m)
        if len(cells) == 0:
            cells = _cell_centres(raster, cloud.position_map_m, np.inf)
            return cloud_to_cloud(cloud, cells)
        distance = cloud_to_cloud(cloud, cells)
        if distance.max() <= margin_m:
            break
        margin_m = float(distance.max())
    return distance


def _extent(reference: Reference) -> FloatArray:
    """Return the lowest and highest easting and northing (2, 2) of a reference."""
    if isinstance(reference, Raster):
        rows, columns = reference.values.shape
        west, north, cell = reference.west_map_m, reference.north_map_m, reference.cell_m
        return np.array([[west, north - rows * cell], [west + columns * cell, north]])
    points = reference.points if isinstance(reference, TriangulatedCloud) else reference
    return extent_of(points.position_map_m[:, :2])


def _cell_centres(raster: Raster, points_map_m: FloatArray, margin_m: float) -> PointCloud:
    """Return the centres of the cells with data within a margin of the points' bounding box."""
    rows, columns = raster.values.shape
    easting = raster.west_map_m + (np.arange(columns) + 0.5) * raster.cell_m
    northing = raster.north_map_m - (np.arange(rows) + 0.5) * raster.cell_m
    low, high = points_map_m[:, :2].min(axis=0) - margin_m, points_map_m[:, :2].max(axis=0) + margin_m
    column = np.flatnonzero((easting >= low[0]) & (easting <= high[0]))
    row = np.flatnonzero((northing >= low[1]) & (northing <= high[1]))
    values = raster.values[np.ix_(row, column)]
    i, j = np.nonzero(np.isfinite(values))
    return PointCloud(np.column_stack([easting[column[j]], northing[row[i]], values[i, j].astype(np.float64)]))
