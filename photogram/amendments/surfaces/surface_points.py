"""Which tie points lie on a known surface, and where they touch it.

Candidates are tie points of several rays that are spread over the block, of each square the one that its rays fix best.
Changed ground is what stands out from what a block can do as a whole: a shift, two slopes and the bend of a dome.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from photogram.amendments.surfaces.known_heights import WINDOW, KnownSurface
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.constraints.known_surface import IN_HEIGHT, UNKNOWNS, SurfaceControl
from photogram.factors.surfaces.known_surface import intersected_distances
from photogram.geodesy.frames import LocalFrame
from photogram.projection import OrientedCameras
from photogram.results import Adjustment
from photogram.survey import Block

SQUARES = 20
"""Along each side of the block, of which each gives a point."""

FEWEST_RAYS, MOST_RAYS = 3, 24
"""Of a point: two leave a mismatch unseen, and every pair of them is a block of the normal equations."""

FEWEST = 20
"""Points on the surface from which on it takes part."""

POOR = 4.0
"""Times the median standard deviation of the intersections across the surface, beyond which a point says little."""

AWAY = 3.29
"""Standard deviations, or times the scatter where that is larger, beyond which a point is not on the surface."""

SHAPES_ITERATIONS, FITS = 12, 20


@dataclass(frozen=True, eq=False)
class Touched:
    """Where points (K, 3) touch a known surface."""

    place_world_m: FloatArray
    """Points of the surface (K, 3) below or above them."""
    normal_world: FloatArray
    """Unit normals (K, 3) there."""
    up_world: FloatArray
    """Vertical directions (K, 3) there."""
    sigma_m: FloatArray
    """Standard deviations (K,) of the surface along its normals."""
    smooth: BoolArray
    """Where (K,) the surface is known and smooth; elsewhere everything is NaN."""


def touched(surface: KnownSurface, frame: LocalFrame, points_world_m: FloatArray) -> Touched:
    """Return where points (K, 3) of the world touch a surface."""
    at = frame.map_from_world(points_world_m)
    there = surface.at(at)
    smooth = surface.smooth(there)
    foot, slope = np.column_stack([at[smooth, :2], there.height_m[smooth]]), there.slope[smooth]
    east, north, up = np.zeros_like(foot), np.zeros_like(foot), np.zeros_like(foot)
    east[:, 0], east[:, 2], north[:, 1], north[:, 2], up[:, 2] = 1.0, slope[:, 0], 1.0, slope[:, 1], 1.0
    place, along_east, along_north, above = (frame.world_from_map(foot + step) for step in (0.0 * up, east, north, up))
    normal = np.cross(along_east - place, along_north - place)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    whole = [np.full((len(smooth), 3), np.nan) for _ in range(3)]
    for values, own in zip(whole, (place, normal, above - place), strict=True):
        values[smooth] = own
    return Touched(whole[0], whole[1], whole[2], there.sigma_m, smooth)


def candidates(result: Adjustment) -> IntArray:
    """Return the numbers of tie points that may lie on the surface, in all squares of the block: every one with rays
    enough, no photograph twice, and not badly fixed in height."""
    tie = result.block.tie_points
    rays, count = tie.rays, len(tie)
    once = np.ones(count, dtype=bool)
    same = (tie.point[1:] == tie.point[:-1]) & (tie.photograph[1:] == tie.photograph[:-1])
    once[tie.point[1:][same]] = False
    own_m = np.sqrt(result.covariances.tie_point_ray_m2[:, 2, 2])
    good = once & (rays >= FEWEST_RAYS) & (rays <= MOST_RAYS) & np.isfinite(own_m)
    good &= np.isfinite(tie.position_world_m).all(axis=1)
    if not good.any():
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(good & (own_m <= POOR * np.median(own_m[good])))


def spread(xy: FloatArray, rank: FloatArray, window_m: float) -> IntArray:
    """Return of points (P, 2) the one of least ``rank`` (P,) in each square, ascending, without those whose windows,
    of side ``window_m``, meet that of a better one: cells in both would count twice."""
    low, extent = xy.min(axis=0), float(np.ptp(xy, axis=0).max())
    side = max(extent / SQUARES, window_m, 1e-9)
    column, row = ((xy - low) / side).astype(np.int64).T
    square = row * (int(column.max()) + 1) + column
    order = np.lexsort((rank, square))
    first = order[np.unique(square[order], return_index=True)[1]]
    first = first[np.argsort(rank[first], kind="stable")]
    meeting = cKDTree(xy[first]).query_ball_point(xy[first], window_m * (1.0 - 1e-9), p=np.inf)
    kept: BoolArray = np.zeros(len(first), dtype=bool)
    for number, others in enumerate(meeting):
        kept[number] = not kept[others].any()
    return np.sort(first[kept])


@dataclass(frozen=True, eq=False)
class OnSurface:
    """Points (K) on a known surface: as the adjustment takes them, ``control``, of those which are ``kept`` (K,)."""

    control: SurfaceControl
    tie_points: IntArray
    """Their numbers (K,) among the tie points."""
    as_it_lies_m: FloatArray
    """How far (K,) they are above the surface along its normal, as the block lies."""
    distance_m: FloatArray
    """The same less what the block may do as a whole."""
    kept: BoolArray
    """Which (K,) are on it; the others are on changed ground, or are mismatches."""
    scatter: float
    """Factor by which the distances scatter more than stated, 1 at least."""

    @property
    def taking_part(self) -> SurfaceControl:
        """Return the points that take part, with the standard deviations that they scatter by."""
        part = self.control.select(self.kept)
        return replace(part, sigma_m=self.scatter * part.sigma_m)


def control_of(
    surface: KnownSurface, block: Block, points: IntArray, position_world_m: FloatArray, cameras: OrientedCameras
) -> tuple[SurfaceControl, BoolArray]:
    """Return tie points of a block as points on a surface, each where it is at ``position_world_m`` (K, 3), and which
    (K,) of them it is known at; the others are left out."""
    there = touched(surface, block.frame, position_world_m)
    known = there.smooth
    tie = block.tie_points
    rays = np.isin(tie.point, points[known])
    place, normal, up = there.place_world_m[known], there.normal_world[known], there.up_world[known]
    upright = np.einsum("ni,ni->n", normal, up)
    xy = place[:, :2] - place[:, :2].mean(axis=0) if known.any() else place[:, :2]
    edge = max(float(np.sqrt(np.mean(np.sum(xy**2, axis=1)))) if known.any() else 1.0, 1e-6)
    control = SurfaceControl(
        surface.name,
        tie.photograph[rays],
        np.searchsorted(points[known], tie.point[rays]).astype(np.int64),
        tie.pixel[rays],
        tie.sigma_px[rays],
        tie.position_world_m[points[known]],
        place,
        normal,
        np.column_stack([upright, upright[:, None] * xy / edge, -normal[:, :2]]),
        there.sigma_m[known],
        np.full(UNKNOWNS, surface.common_sigma_m),
    )
    _, _, own_m2 = intersected_distances(control, cameras)
    return replace(control, sigma_m=np.sqrt(control.sigma_m**2 + own_m2)), known


def shapes_of(control: SurfaceControl) -> FloatArray:
    """Return by how much the distances (K, 8) change with what a block may do as a whole: a shift along three axes,
    slopes and bends of its heights."""
    height = control.common[:, 0]
    u, v = control.common[:, 1:IN_HEIGHT].T / height
    bends = (height * shape for shape in (u, v, u * u - np.mean(u * u), u * v, v * v - np.mean(v * v)))
    return np.column_stack([control.normal_world, *bends])


def fitted(
    distance_m: FloatArray, sigma_m: FloatArray, shapes: FloatArray, loose: FloatArray
) -> tuple[FloatArray, BoolArray, float]:
    """Fit shapes (K, S) to distances (K,), each coefficient with the prior standard deviation ``loose`` (S,), by
    weights that leave out what stands out; returns the coefficients, which points are kept and their scatter."""
    A, b = shapes / sigma_m[:, None], distance_m / sigma_m
    weight: FloatArray = np.ones(len(b))
    x: FloatArray = np.zeros(shapes.shape[1])
    off: FloatArray = np.abs(b)
    scale = 1.0
    for k in range(FITS):
        W = A * weight[:, None]
        x = np.asarray(np.linalg.solve(A.T @ W + np.diag(loose**-2.0), W.T @ b))
        r = b - A @ x
        scale = max(1.0, 1.4826 * float(np.median(np.abs(r))))
        off = np.asarray(np.abs(r) / scale)
        weight = np.asarray(1.0 / (1.0 + off**2) if k < FITS // 2 else off <= AWAY, dtype=np.float64)
    return x, np.asarray(off <= AWAY), scale


def on_surface(
    surface: KnownSurface, result: Adjustment, block: Block, cameras: OrientedCameras, *, adjusted: bool
) -> OnSurface | None:
    """Return the tie points of an adjustment that lie on a surface, None where there are too few. ``block`` is that of
    the adjustment with its registered photographs alone, ``cameras`` these; ``adjusted`` says that the surface has
    taken part, so that the block lies on it and does nothing as a whole any more but what the surface is off by."""
    points = candidates(result)
    if len(points) < FEWEST:
        return None
    position = block.tie_points.position_world_m
    there = touched(surface, block.frame, position[points])
    points = points[there.smooth]
    if len(points) < FEWEST:
        return None
    own_m = np.sqrt(result.covariances.tie_point_ray_m2[points, 2, 2])
    chosen = points[spread(position[points, :2], own_m, WINDOW * surface.raster.cell_m)]
    if len(chosen) < FEWEST:
        return None
    plan_m = np.sqrt(np.nanmedian(result.covariances.tie_point_m2[chosen][:, [0, 1], [0, 1]], axis=0))
    at, moved = position[chosen], np.zeros(3)
    for _ in range(SHAPES_ITERATIONS):
        control, known = control_of(surface, block, chosen, at, cameras)
        if known.sum() < FEWEST:
            return None
        chosen, at = chosen[known], at[known]
        X, distance, _ = intersected_distances(control, cameras)
        shapes = shapes_of(control)
        loose = np.concatenate([np.maximum(3.0 * plan_m, 0.05), np.full(shapes.shape[1] - 2, 1e4)])
        if adjusted:
            shapes, loose = control.common, control.common_sigma_m
        x, kept, scale = fitted(distance, control.sigma_m, shapes, loose)
        rest = distance - shapes @ x
        if adjusted:
            break
        heights = np.zeros_like(X)
        heights[:, 2] = (shapes[:, 3:] @ x[3:]) / control.common[:, 0]
        last, moved = moved, x[:3]
        at = X - x[:3] - heights
        if np.abs(moved - last).max() < 0.01:
            break
    if kept.sum() < FEWEST:
        return None
    return OnSurface(control, chosen, distance, rest, kept, scale)
