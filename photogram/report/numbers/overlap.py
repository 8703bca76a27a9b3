"""How many photographs see each place of the ground.

The ground is the surface of the tie points on a coarse grid and, beyond it, what two photographs show and resolve, at
the height of the next tie point. What hides behind houses and trees counts as seen: tie points do not describe them
well enough to tell.
"""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.tri import LinearTriInterpolator, Triangulation
from scipy.ndimage import median

from photogram.arrays import BoolArray, FloatArray
from photogram.compilation import njit
from photogram.errors import SurfaceError
from photogram.projection import OrientedCameras, project_point
from photogram.results import Adjustment
from photogram.surface.dense.pyramid import MINIMUM_RAYS, known_ground, nearest_in_plan
from photogram.surface.dense.resolution import choose_views
from photogram.surface.views import Views
from photogram.survey import Block, Raster

CELLS = 100
"""Cells along the longer side of the ground."""

BRIDGED_CELLS = 12
"""Ground without tie points, water for example, is bridged up to this many cells."""

REACH, MOST_CELLS_AROUND = 2.0, 300
"""How far beyond the tie points ground is looked for, in flying heights, and in cells at most."""


@dataclass(frozen=True, eq=False)
class Overlap:
    """Number of photographs that see each cell of the ground, NaN where there is no ground; ``amid`` are its cells
    (rows, columns) amid the tie points."""

    photographs: Raster
    amid: BoolArray

    @property
    def counts(self) -> FloatArray:
        """Return the number of photographs (cells,) of all cells that two or more see."""
        values = self.photographs.values
        return values[np.nan_to_num(values) >= MINIMUM_RAYS].astype(np.float64)

    @property
    def area_m2(self) -> float:
        """Return the area of the ground that two photographs or more see, in m² of the map."""
        return len(self.counts) * self.photographs.cell_m**2

    @property
    def share_amid(self) -> float:
        """Return the part of the ground amid the tie points, 0 to 1, that two photographs or more see."""
        return float(np.mean(self.photographs.values[self.amid] >= MINIMUM_RAYS))

    def share(self, photographs: int) -> float:
        """Return which part, 0 to 1, of the ground that two photographs or more see so many see."""
        counts = self.counts
        return float(np.mean(counts >= photographs)) if len(counts) else 0.0


@njit(cache=True)
def _count(cameras: OrientedCameras, widest: FloatArray, X: FloatArray) -> FloatArray:
    R, C, size_px = cameras.rotation, cameras.position, cameras.size_px
    seen = np.zeros(len(X))
    for i in range(len(R)):
        c = cameras.camera[i]
        for n in range(len(X)):
            dx, dy, dz = X[n, 0] - C[i, 0], X[n, 1] - C[i, 1], X[n, 2] - C[i, 2]
            depth = R[i, 0, 2] * dx + R[i, 1, 2] * dy + R[i, 2, 2] * dz
            if depth <= 0.0 or dx * dx + dy * dy + dz * dz > widest[c] * depth * depth:
                continue
            u, v, _ = project_point(cameras, i, X[n])
            if -0.5 <= u <= size_px[c, 0] - 0.5 and -0.5 <= v <= size_px[c, 1] - 0.5:
                seen[n] += 1.0
    return seen


def _views(result: Adjustment, points_world_m: FloatArray) -> FloatArray:
    """Return the number (P,) of registered photographs whose format holds each of points (P, 3)."""
    cameras = result.block.cameras
    # the squared secant of the widest ray: beyond it the distortion folds points from outside back into the format
    widest = 1.0 + np.array([c.largest_radius for c in cameras]) ** 2
    chosen = [i for i, pose in enumerate(result.block.poses) if pose is not None]
    return _count(result.block.oriented_cameras(chosen), widest, np.ascontiguousarray(points_world_m))


def _thinned(tie_point_map_m: FloatArray) -> tuple[FloatArray, float]:
    """Return of tie points (P, 3) one per half cell, at the median height there, and the size of a cell, in m."""
    low, high = np.percentile(tie_point_map_m[:, :2], [0.5, 99.5], axis=0)
    margin_m = 0.02 * float((high - low).max())
    # a few distant points, on the horizon of an oblique photograph, would make the cells too coarse
    near = np.all((tie_point_map_m[:, :2] >= low - margin_m) & (tie_point_map_m[:, :2] <= high + margin_m), axis=1)
    points = tie_point_map_m[near]
    cell_m = float(np.ptp(points[:, :2], axis=0).max(initial=0.0)) / CELLS
    if not cell_m > 0:
        return points[:1], 1.0
    group = np.unique(np.floor(points[:, :2] / (cell_m / 2)), axis=0, return_inverse=True)[1].reshape(-1)
    first = np.unique(group, return_index=True)[1]
    heights = np.asarray(median(points[:, 2], group, np.arange(len(first))))
    return np.column_stack([points[first, :2], heights]), cell_m


def _ground(tie_point_map_m: FloatArray) -> Raster | None:
    """Return the triangulated surface of tie points (P, 3) on a coarse grid, None where they span no area."""
    points, cell_m = _thinned(tie_point_map_m)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    spread = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False)
    if len(points) < 3 or spread[1] < 1e-6 * spread[0]:
        return None
    columns, rows = np.maximum(np.ceil((high - low) / cell_m - 1e-6), 1).astype(np.int64)
    # coordinates of 6 000 000 m would cost the triangulation its digits
    mesh = Triangulation(*(points[:, :2] - low).T)
    corner = np.column_stack([mesh.x, mesh.y])[mesh.triangles]
    edge = corner[:, [1, 2, 0]] - corner
    longest = np.hypot(edge[..., 0], edge[..., 1]).max(axis=1)
    area = np.abs(edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0])
    mesh.set_mask((longest > BRIDGED_CELLS * cell_m) | (area < 1e-9 * longest**2))
    x, y = np.meshgrid((np.arange(columns) + 0.5) * cell_m, (rows - 0.5 - np.arange(rows)) * cell_m)
    height = LinearTriInterpolator(mesh, points[:, 2])(x, y).filled(np.nan)
    if not np.isfinite(height).any():
        return None
    return Raster(height.astype(np.float32), float(low[0]), float(low[1] + rows * cell_m), cell_m)


def ground_overlap(result: Adjustment, tie_point_map_m: FloatArray) -> Overlap | None:
    """Count the photographs that see each cell of the ground that tie points (P, 3) of the map describe.

    The ground is their triangulated surface, about CELLS × CELLS cells, and what two photographs resolve around it;
    None where they span no area.
    """
    amid_points = _ground(tie_point_map_m) if len(tie_point_map_m) >= 3 else None
    if amid_points is None:
        return None
    ground, amid = _with_surroundings(amid_points, result.block, tie_point_map_m)
    row, column = np.nonzero(np.isfinite(ground.values))
    easting = ground.west_map_m + (column + 0.5) * ground.cell_m
    northing = ground.north_map_m - (row + 0.5) * ground.cell_m
    centre_map_m = np.column_stack([easting, northing, ground.values[row, column].astype(np.float64)])
    values = np.full(ground.values.shape, np.nan, dtype=np.float32)
    values[row, column] = _views(result, result.block.frame.world_from_map(centre_map_m))
    return Overlap(Raster(values, ground.west_map_m, ground.north_map_m, ground.cell_m), amid)


def _with_surroundings(ground: Raster, block: Block, tie_point_map_m: FloatArray) -> tuple[Raster, BoolArray]:
    """Return the ground with what two photographs show and resolve around it, and which cells it had before."""
    views, world = Views.of(block), block.frame.world_from_map(tie_point_map_m)
    try:
        known = known_ground(tie_point_map_m, world, views, MINIMUM_RAYS)
    except SurfaceError:  # photographs from the side or from below: there is no ground but that of the tie points
        return ground, np.isfinite(ground.values)
    cells = min(int(np.ceil(REACH * known.flying_height_m / ground.cell_m)), MOST_CELLS_AROUND)
    height = np.pad(ground.values, cells, constant_values=np.nan)
    wide = Raster(
        height, ground.west_map_m - cells * ground.cell_m, ground.north_map_m + cells * ground.cell_m, ground.cell_m
    )
    amid = np.isfinite(height)
    row, column = np.nonzero(~amid)
    plan = np.column_stack(
        [wide.west_map_m + (column + 0.5) * wide.cell_m, wide.north_map_m - (row + 0.5) * wide.cell_m]
    )
    points, _ = _thinned(tie_point_map_m)
    beside_m = points[nearest_in_plan(points, plan, 1)[:, 0], 2]
    resolving = replace(views, coarsest_m=known.coarsest_m)
    places = block.frame.world_from_map(np.column_stack([plan, beside_m]))
    seen = (choose_views(resolving, places, MINIMUM_RAYS)[0] >= 0).all(axis=1)
    height[row[seen], column[seen]] = beside_m[seen]
    rows, columns = (np.flatnonzero(np.isfinite(height).any(axis=axis)) for axis in (1, 0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    west, north = wide.west_map_m + columns[0] * wide.cell_m, wide.north_map_m - rows[0] * wide.cell_m
    return Raster(height[part], west, north, wide.cell_m), amid[part]
