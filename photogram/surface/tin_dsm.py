"""Digital surface model (DSM) from irregular points.

Points that stick out of their neighbourhood are taken away, the rest is triangulated in plan (Delaunay), and heights
are interpolated linearly in the triangles at the cell centres. Nothing is extrapolated: outside the triangulation,
and in triangles that bridge a gap, a cell has no data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree
from threadpoolctl import threadpool_limits

from photogram.arrays import NMAD_FACTOR, BoolArray, FloatArray, IntArray, nmad
from photogram.errors import SettingError, SurfaceError
from photogram.measures.round_lengths import round_near
from photogram.settings.settings import Default, Settings, Within
from photogram.survey import PointCloud, Raster

Rule = Callable[[IntArray, FloatArray], FloatArray]
"""What a cell holds, from its triangle (K,) and the barycentric weights (K, 3) of its centre."""


NEAREST_PLACES = 4
"""Places whose mean says how well the shape is known at a point: those on the corners of its mesh."""

SPIKE_GSD = 1.1
"""Pixels on the ground below which a point is no spike unless a project says so: what a match off by a pixel is off by
in height, with rays that cross at a right angle."""

SPIKE_SPACING = 0.05

MAXIMUM_CELLS = 1_000_000_000
MAXIMUM_HELD_OUT = 20_000
TILE_CELLS = 400_000
CHUNK_POINTS = 40_000


@dataclass(frozen=True)
class SurfaceSettings(Settings):
    """How points become a surface."""

    cell_m: Annotated[
        float | None,
        Within(0.001, 1000, "m"),
        "Side of a cell.",
        Default("2 GSD, rounded; without `dense` the mean spacing of the points, rounded to 1, 2 or 5 · 10ⁿ"),
    ] = None
    maximum_gap_m: Annotated[
        float | None,
        Within(0.001, 100_000, "m"),
        "How far a cell of a hole looks for the surface around it where `dsm_filled.tif` closes it, 100 cells at most; "
        "without `dense`: triangles with longer edges hold no data.",
        Default("25 cells; without `dense` 10 times the median edge"),
    ] = None
    spike_nmad: Annotated[
        float,
        Within(0, 1e6, "NMAD"),
        "Without `dense`: points further from the plane through their neighbours are left out; 0 keeps every point.",
    ] = 6.0
    spike_minimum_m: Annotated[
        float | None,
        Within(0, 10_000, "m"),
        "Without `dense`: points nearer to that plane are never left out.",
        Default(f"{SPIKE_GSD:g} GSD; {SPIKE_SPACING:g} of the spacing where that is not known"),
    ] = None
    spike_neighbours: Annotated[
        int, Within(4, 1000), "Without `dense`: nearest points in plan that form a neighbourhood."
    ] = 20
    in_plan: Annotated[
        Literal["auto", "always"], "`always`: a surface is made although the photographs look sideways."
    ] = "auto"
    area: Annotated[
        str | None,
        "File of polygons in the plan of the map, GeoPackage or GeoJSON, relative to the project file, in which all "
        "ground is matched that two photographs see, and none beyond.",
        Default("ground that photographs see from above or resolve about as well as the rest"),
    ] = None
    plane: Annotated[
        Literal["none", "auto"],
        "`auto`: the surface is made on a plane fitted to the tie points where that leans; not in plan.",
    ] = "none"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plane == "auto" and self.in_plan == "always":
            raise SettingError("plane", "auto makes the surface on a plane, in_plan: always on the map: remove one")
        if self.plane == "auto" and self.area is not None:
            raise SettingError("area", "lies on the map, plane: auto makes the surface on a plane: remove one")


@dataclass(frozen=True, eq=False)
class PointPrecision:
    """Covariances of points along easting, northing and height, m², in two parts that add up.

    ``rays_m2`` (N, 3, 3) is what a point would scatter by if the photographs were known exactly: its own.
    ``cameras_m2`` (N, 3, 3) is what the errors of photographs and calibration add, which neighbours share.
    """

    rays_m2: FloatArray
    cameras_m2: FloatArray

    def select(self, keep: BoolArray | IntArray) -> PointPrecision:
        """Keep the points of a mask or of indices."""
        return PointPrecision(self.rays_m2[keep], self.cameras_m2[keep])


@dataclass(frozen=True, eq=False)
class ShapePrecision:
    """How well the shape of a survey is known, whatever its datum: at places (S, 3) of the map the covariances (S, 3,
    3), m², of what the cameras add, relative to the mean error of all places, and the covariance (3, 3) of that mean,
    the datum's part, both along easting, northing and height."""

    place_map_m: FloatArray
    covariance_m2: FloatArray
    datum_covariance_m2: FloatArray

    def at(self, points_map_m: FloatArray) -> FloatArray:
        """Return the covariances (N, 3, 3) at points (N, 2 or 3): the mean of the nearest places."""
        count = min(NEAREST_PLACES, len(self.place_map_m))
        _, near = cKDTree(self.place_map_m[:, :2]).query(points_map_m[:, :2], k=list(range(1, count + 1)))
        return np.asarray(self.covariance_m2[near].mean(axis=1))


@dataclass(frozen=True, eq=False)
class TinSurface:
    """A DSM, the standard deviations of its heights as far as the measurement goes, and how far it is off between
    points: ``held_out_m`` (K,) are heights interpolated from nine tenths of the points minus those of the rest.
    ``own`` are the standard deviations by the rays alone, which neighbours do not share, ``relative`` those without the
    datum's part, None where they are not known."""

    heights: Raster
    sigma: Raster
    own: Raster
    held_out_m: FloatArray
    relative: Raster | None = None


@dataclass(frozen=True, eq=False)
class _Triangles:
    """A triangulation of points (N, 3) relative to ``origin_map_m``, which of its triangles are surface, and the grid
    over it; ``kept`` are the numbers of the points among those that were given."""

    points_m: FloatArray
    kept: IntArray
    origin_map_m: FloatArray
    triangulation: Delaunay
    usable: BoolArray
    west_map_m: float
    north_map_m: float
    cell_m: float
    shape: tuple[int, int]

    @property
    def corner_m(self) -> tuple[float, float]:
        """Return the north-west corner of the grid in the triangulation's frame."""
        return self.west_map_m - self.origin_map_m[0], self.north_map_m - self.origin_map_m[1]


def surface_from_points(cloud: PointCloud, settings: SurfaceSettings | None = None) -> Raster:
    """Interpolate a DSM from points of the map frame; heights in m, NaN outside the data and in gaps.

    The corner of the grid is a multiple of the cell size, so that surfaces of one cell size fit onto each other. Of
    points with the same easting and northing one is used. Raises SurfaceError when fewer than three usable points
    remain, when they lie on one line, or when the settings leave no cell with data.
    """
    triangles = _triangulated(cloud, settings or SurfaceSettings())
    return _rasters(triangles, [_height_rule(triangles)])[0]


def surface_with_sigma(
    cloud: PointCloud,
    precision: PointPrecision,
    settings: SurfaceSettings,
    shape: ShapePrecision | None = None,
) -> TinSurface:
    """Interpolate a DSM as ``surface_from_points`` does, and the standard deviations of its heights in m, on one grid;
    and of what they owe to the rays alone; with a ``shape`` those without the datum's part too.

    With barycentric weights w of the three corners and the normal n = (−∂h/∂E, −∂h/∂N, 1) of their triangle, the height
    at a fixed place has the variance Σ w² nᵀ Σ_rays n + (Σ w √(nᵀ Σ_cameras n))²: the corners' own errors average out,
    those of the photographs, which neighbours share, do not. It is the error of measurement alone: what the surface
    does between the points is not in it, points held out tell that.
    """
    triangles = _triangulated(cloud, settings)
    own = precision.select(triangles.kept)
    alone = PointPrecision(own.rays_m2, np.zeros_like(own.cameras_m2))
    rules = [_height_rule(triangles), _sigma_rule(triangles, own), _sigma_rule(triangles, alone)]
    if shape is not None:
        places = cloud.position_map_m[triangles.kept]
        rules.append(_sigma_rule(triangles, PointPrecision(own.rays_m2, shape.at(places))))
    heights, deviations, scatter, *relative = _rasters(triangles, rules)
    held_out = _held_out_m(triangles.points_m, settings.maximum_gap_m)
    return TinSurface(heights, deviations, scatter, held_out, relative[0] if relative else None)


def _sigma_rule(triangles: _Triangles, precision: PointPrecision) -> Rule:
    """Return the rule of standard deviations of heights."""
    own, shared = _corner_variances(triangles, precision)

    def sigma(triangle: IntArray, weight: FloatArray) -> FloatArray:
        cameras = np.sum(weight * np.sqrt(shared[triangle]), axis=1)
        return np.asarray(np.sqrt(np.sum(weight**2 * own[triangle], axis=1) + cameras**2))

    return sigma


def _held_out_m(points_m: FloatArray, maximum_gap_m: float | None) -> FloatArray:
    """Return heights (K,) that nine tenths of the points interpolate at the places of the rest, minus the rest's own.

    At most MAXIMUM_HELD_OUT points are held out; those off the surface of the others say nothing.
    """
    order = np.random.default_rng(0).permutation(len(points_m))
    count = min(len(points_m) // 10, MAXIMUM_HELD_OUT)
    held_out, rest = points_m[order[:count]], points_m[order[count:]]
    try:
        triangulation = Delaunay(rest[:, :2])
    except QhullError:  # what is left lies on one line, or is too little
        return np.zeros(0)
    usable = _usable_triangles(rest[triangulation.simplices], maximum_gap_m)
    with threadpool_limits(1, "blas"):
        triangle = np.asarray(triangulation.find_simplex(held_out[:, :2]), dtype=np.int64)
        inside = np.flatnonzero((triangle >= 0) & usable[triangle])
        weight = _barycentric(triangulation, triangle[inside], held_out[inside, :2])
    height = np.sum(weight * rest[triangulation.simplices[triangle[inside]], 2], axis=1)
    return np.asarray(height - held_out[inside, 2])


def _barycentric(triangulation: Delaunay, triangle: IntArray, place_m: FloatArray) -> FloatArray:
    """Return the weights (K, 3) of the corners of triangles (K,) at places (K, 2)."""
    affine = triangulation.transform[triangle]
    weight = np.einsum("nij,nj->ni", affine[:, :2], place_m - affine[:, 2])
    return np.column_stack([weight, 1.0 - weight.sum(axis=1)])


def _corner_variances(triangles: _Triangles, precision: PointPrecision) -> tuple[FloatArray, FloatArray]:
    """Return for the corners (T, 3) of all triangles the variances across the surface of their own errors and of those
    of the photographs, m²."""
    simplices = triangles.triangulation.simplices
    corner = triangles.points_m[simplices]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(first, second)
    flat = np.where(triangles.usable, normal[:, 2], 1.0)
    normal = np.where(triangles.usable[:, None], normal / flat[:, None], [0.0, 0.0, 1.0])
    own, shared = (
        np.column_stack([np.einsum("ti,tij,tj->t", normal, part[simplices[:, k]], normal) for k in range(3)])
        for part in (precision.rays_m2, precision.cameras_m2)
    )
    return own, np.maximum(shared, 0.0)


def _triangulated(cloud: PointCloud, settings: SurfaceSettings) -> _Triangles:
    """Triangulate the points that are no spikes, and lay the grid over them."""
    kept = np.flatnonzero(np.isfinite(cloud.position_map_m).all(axis=1))
    _need_three(len(kept), len(cloud), "have finite coordinates")
    # Qhull and the planes lose digits on coordinates of 6 000 000 m.
    origin_map_m = np.floor(cloud.position_map_m[kept].min(axis=0))
    points_m = cloud.position_map_m[kept] - origin_map_m
    smooth = ~spikes(points_m, settings)
    kept, points_m = kept[smooth], points_m[smooth]
    _need_three(len(points_m), len(cloud), f"are no spikes (spike_nmad {settings.spike_nmad:g})")
    try:
        triangulation = Delaunay(points_m[:, :2])
    except QhullError as error:
        raise SurfaceError(
            f"surface: the {len(points_m)} points are collinear in plan: a surface needs points that span an area"
        ) from error
    corners = points_m[triangulation.simplices]
    usable = _usable_triangles(corners, settings.maximum_gap_m)
    cell_m = settings.cell_m or _cell_from_density(corners[usable], len(np.unique(triangulation.simplices[usable])))
    west, north, shape = _grid(corners[usable], origin_map_m, cell_m)
    return _Triangles(points_m, kept, origin_map_m, triangulation, usable, west, north, cell_m, shape)


def _height_rule(triangles: _Triangles) -> Rule:
    """Return the rule of heights over the map's zero."""
    height_m, simplices = triangles.points_m[:, 2], triangles.triangulation.simplices
    base_m = triangles.origin_map_m[2]

    def height(triangle: IntArray, weight: FloatArray) -> FloatArray:
        return np.asarray(np.sum(weight * height_m[simplices[triangle]], axis=1) + base_m)

    return height


def _rasters(triangles: _Triangles, rules: Sequence[Rule]) -> list[Raster]:
    """Return what each rule makes of the cells on the surface, NaN off it, by tiles of rows.

    Raises SurfaceError when no cell has its centre on the surface.
    """
    rows, columns = triangles.shape
    corner_m = triangles.corner_m
    cell_m = triangles.cell_m
    triangulation = triangles.triangulation
    values = [np.full(triangles.shape, np.nan, dtype=np.float32) for _ in rules]
    x = corner_m[0] + (np.arange(columns) + 0.5) * cell_m
    tile_rows, known = max(1, TILE_CELLS // columns), 0
    with threadpool_limits(1, "blas"):  # SciPy solves a 2 × 2 system per triangle, which threads make slower by far
        for top in range(0, rows, tile_rows):
            y = corner_m[1] - (np.arange(top, min(top + tile_rows, rows)) + 0.5) * cell_m
            centre = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
            triangle = triangulation.find_simplex(centre)
            inside = np.flatnonzero((triangle >= 0) & triangles.usable[triangle])
            triangle, known = triangle[inside], known + len(inside)
            weight = _barycentric(triangulation, triangle, centre[inside])
            for raster, rule in zip(values, rules, strict=True):
                raster[top : top + tile_rows].reshape(-1)[inside] = rule(triangle, weight)
    if not known:
        raise SurfaceError(f"surface: no cell of {cell_m:g} m has its centre on the surface: choose a smaller cell_m")
    return [Raster(raster, triangles.west_map_m, triangles.north_map_m, cell_m) for raster in values]


def spikes(points_m: FloatArray, settings: SurfaceSettings) -> BoolArray:
    """Return which points (N, 3), in m, stick out of their neighbourhood.

    Through the neighbours of each point, the point itself left out, goes the plane of least absolute deviations
    (iteratively reweighted least squares; Schlossmacher 1973). A point is a spike when its height above or below that
    plane exceeds ``spike_nmad`` times the larger of the NMAD of its neighbours about the plane and the NMAD of all
    points about their planes, and ``spike_minimum_m``. Steps and slopes raise their neighbours' NMAD and survive.
    """
    k = settings.spike_neighbours
    if settings.spike_nmad == 0 or len(points_m) <= k:
        return np.zeros(len(points_m), dtype=bool)
    tree = cKDTree(points_m[:, :2])
    height_m, nmad_m, apart_m = (np.empty(len(points_m)) for _ in range(3))
    for start in range(0, len(points_m), CHUNK_POINTS):
        chunk = slice(start, start + CHUNK_POINTS)
        distance, nearest = tree.query(points_m[chunk, :2], k + 1)
        apart_m[chunk], neighbour = np.asarray(distance)[:, 1], np.asarray(nearest, dtype=np.int64)
        height_m[chunk], nmad_m[chunk] = _height_over_neighbours(points_m[chunk], points_m[neighbour[:, 1:]])
    overall_m = nmad(height_m)
    least_m = (
        SPIKE_SPACING * float(np.median(apart_m)) if settings.spike_minimum_m is None else settings.spike_minimum_m
    )
    limit_m = np.maximum(settings.spike_nmad * np.maximum(nmad_m, overall_m), least_m)
    return np.asarray(np.abs(height_m) > limit_m)


def _height_over_neighbours(points_m: FloatArray, neighbours_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the height (N,) of points (N, 3) over the plane of their neighbours (N, k, 3), and the NMAD (N,) about
    it.
    """
    offset = neighbours_m - points_m[:, None]
    reach_m = np.maximum(np.abs(offset[..., :2]).max(axis=(1, 2)), 1e-6)
    design = np.concatenate([np.ones((*offset.shape[:2], 1)), offset[..., :2] / reach_m[:, None, None]], axis=2)
    level_m = np.median(offset[..., 2], axis=1)
    observed = offset[..., 2] - level_m[:, None]
    weight = np.ones_like(observed)
    # Neighbours on one line leave the slope across it open: the ridge keeps it at nought.
    ridge = np.diag([0.0, 1e-9, 1e-9])
    for _ in range(8):
        weighted = (design * weight[..., None]).transpose(0, 2, 1)
        normal = weighted @ design
        trace = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        plane = np.linalg.solve(normal + ridge * trace, weighted @ observed[..., None])
        residual = np.abs(observed - (design @ plane)[..., 0])
        nmad_m = NMAD_FACTOR * np.median(residual, axis=1)
        weight = 1.0 / np.maximum(residual, np.maximum(0.1 * nmad_m, 1e-9)[:, None])
    return -(plane[:, 0, 0] + level_m), nmad_m


def _need_three(usable: int, total: int, condition: str) -> None:
    if usable < 3:
        raise SurfaceError(f"surface: {usable} of {total} points {condition}: a surface needs at least 3")


def _usable_triangles(corners_m: FloatArray, maximum_gap_m: float | None) -> BoolArray:
    """Return which triangles (T, 3, 3) have an area and no edge, in plan, longer than the gap."""
    edge = corners_m[:, [1, 2, 0], :2] - corners_m[..., :2]
    length_m = np.hypot(edge[..., 0], edge[..., 1])
    longest_m = length_m.max(axis=1)
    gap_m = 10 * float(np.median(length_m)) if maximum_gap_m is None else maximum_gap_m
    double_area = np.abs(edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0])
    usable = (longest_m <= gap_m) & (double_area > 1e-9 * longest_m**2)
    if not usable.any():
        raise SurfaceError(
            f"surface: every triangle has an edge longer than maximum_gap_m = {gap_m:g} m; in the tightest the longest "
            f"edge is {longest_m.min():.3g} m: choose a larger gap"
        )
    return np.asarray(usable)


def _cell_from_density(corners_m: FloatArray, points: int) -> float:
    """Return the mean spacing of the points of triangles (T, 3, 3), rounded to 1, 2 or 5 times a power of ten, in m."""
    edge = corners_m[:, 1:, :2] - corners_m[:, :1, :2]
    area_m2 = 0.5 * np.abs(edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]).sum()
    return round_near(float(np.sqrt(area_m2 / points)))


def _grid(corners_m: FloatArray, origin_map_m: FloatArray, cell_m: float) -> tuple[float, float, tuple[int, int]]:
    """Return west, north and (rows, columns) of the grid that covers the triangles, its corner a multiple of the
    cell.
    """
    low = (corners_m[..., :2].min(axis=(0, 1)) + origin_map_m[:2]) / cell_m
    high = (corners_m[..., :2].max(axis=(0, 1)) + origin_map_m[:2]) / cell_m
    # The tolerance keeps a point on a corner from opening another row; it is far below half a cell.
    first, last = np.floor(low + 1e-6), np.ceil(high - 1e-6)
    columns, rows = (int(n) for n in np.maximum(last - first, 1))
    if rows * columns > MAXIMUM_CELLS:
        raise SurfaceError(
            f"surface: cells of {cell_m:g} m make a raster of {columns} x {rows}, more than {MAXIMUM_CELLS:,} cells: "
            "choose a larger cell_m"
        )
    return round(float(first[0]) * cell_m, 9), round(float(first[1] + rows) * cell_m, 9), (rows, columns)
