"""Points eliminated from the normal equations by their 3 × 3 Schur complements, in one pass over all observations.

With the normal equations [U W; Wᵀ V] of cameras and points (Triggs et al. 2000, sec. 6.1), the reduced system of the
cameras is S = U − Σ_p W_p V_p⁻¹ W_pᵀ, and the covariance of a point is V_p⁻¹ + V_p⁻¹ W_pᵀ S⁻¹ W_p V_p⁻¹ (Förstner &
Wrobel 2016, sec. 15.4). With V_p = L Lᵀ, the Jacobians A_i on the pose and B_i on the point of ray i, and Z_i = B_i L⁻ᵀ
(2 × 3), the block of two photographs is A_iᵀ (δ_ij I − Z_i Z_jᵀ) A_j: nothing wider than two rows is ever multiplied.

Chunks of points are summed apart and added in order, so results do not depend on the number of cores.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.factors.elimination.covariance_kernels import covariances_of_points
from photogram.factors.elimination.kernels import accumulate, cost_of_points, substitute_points
from photogram.factors.elimination.loss import Loss
from photogram.factors.elimination.reduced import Layout, NormalEquations, blocks_of
from photogram.factors.elimination.reprojection import Observations, residuals
from photogram.projection import OrientedCameras, without_fields

MANY_OBSERVATIONS = 20_000  # from here on the work is shared among threads
CHUNKS = 4
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Rays:
    """Observations laid out for elimination: points in the order of their first photograph in the band.

    ``index`` (P,) are the points' own numbers; rays of point p are ``[first[p], first[p + 1])``, in the order of the
    band: ``photograph`` (N,), ``measured`` (N, 3) pixel and 1 / sigma, ``mixing`` as of ``Observations``. ``chunks``
    are ranges of points.
    """

    index: IntArray
    first: IntArray
    photograph: IntArray
    measured: FloatArray
    mixing: FloatArray
    chunks: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.photograph)


def first_observations(point: IntArray, count: int) -> IntArray:
    """Return the index (count + 1,) of each point's first observation in the sorted array ``point`` (N,)."""
    return np.searchsorted(point, np.arange(count + 1)).astype(np.int64)


@njit(cache=True, nogil=True)
def _in_band_order(number: IntArray, place: IntArray, points: int, places: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return the points in the order of their lowest place, the index of each one's first observation in what follows,
    and the observations, sorted by these points, then by ``place`` (N,), −1 first; ``number`` (N,) is their point."""
    lowest = np.full(points, places)
    for i in range(len(number)):
        if place[i] >= 0:
            lowest[number[i]] = min(lowest[number[i]], place[i])
    begin = np.zeros(places + 2, np.int64)
    for p in range(points):
        begin[lowest[p] + 1] += 1
    begin = np.cumsum(begin)
    order, rank = np.empty(points, np.int64), np.empty(points, np.int64)
    for p in range(points):
        rank[p] = begin[lowest[p]]
        order[rank[p]] = p
        begin[lowest[p]] += 1
    first = np.zeros(points + 1, np.int64)
    for i in range(len(number)):
        first[rank[number[i]] + 1] += 1
    first = np.cumsum(first)
    sequence, end = np.empty(len(number), np.int64), first[:-1].copy()
    for i in range(len(number)):
        p = rank[number[i]]
        k = end[p]
        while k > first[p] and place[sequence[k - 1]] > place[i]:
            sequence[k] = sequence[k - 1]
            k -= 1
        sequence[k] = i
        end[p] += 1
    return order, first, sequence


def lay_out(observations: Observations, index: IntArray, layout: Layout) -> Rays:
    """Lay out observations for the points ``index`` (P,), ascending; each of its points must be among them."""
    o = observations
    number_of = np.zeros(int(index.max(initial=-1)) + 1, dtype=np.int64)
    number_of[index] = np.arange(len(index))
    points, first, order = _in_band_order(
        number_of[o.point], layout.place[o.photograph], len(index), len(layout.photograph_at)
    )
    chunks = 1 if len(o) < MANY_OBSERVATIONS else CHUNKS
    edges = np.searchsorted(first, np.linspace(0, len(o), chunks + 1)[1:-1]).tolist()
    edges = [0, *edges, len(index)]
    measured = np.empty((len(o), 3))
    measured[:, :2], measured[:, 2] = o.pixel[order], 1.0 / o.sigma_px[order]
    mixing = o.mixing[order] if len(o.mixing) else o.mixing
    return Rays(index[points], first, o.photograph[order], measured, mixing, tuple(pairwise(edges)))


def in_chunks(work: Callable[[int, int], T], rays: Rays, pool: ThreadPoolExecutor | None) -> list[T]:
    """Call ``work`` on every chunk, in threads where there is a pool; results in the order of the chunks."""
    if pool is None or len(rays.chunks) == 1:
        return [work(begin, end) for begin, end in rays.chunks]
    return list(pool.map(work, *zip(*rays.chunks, strict=True)))


@dataclass(frozen=True, eq=False)
class Points:
    """Points as they stand: ``position`` (P, 3) in the world, m, and what is known of them apart from their rays:
    ``prior`` (P, 12), information row by row and right-hand side, empty for nothing."""

    position: FloatArray
    prior: FloatArray

    @staticmethod
    def unknown(position: FloatArray) -> Points:
        """Return points known from their rays alone."""
        return Points(position, np.zeros((0, 12)))


def eliminate(
    rays: Rays,
    cameras: OrientedCameras,
    points: Points,
    normal: NormalEquations,
    loss: Loss,
    damping: float,
    pool: ThreadPoolExecutor | None = None,
) -> int:
    """Add the reduced information of all points to the normal equations, in place.

    The points' own diagonal is scaled by 1 + ``damping`` (Marquardt 1963). Returns the first point
    that cannot be intersected, −1 when all can.
    """
    layout, whole = normal.layout, len(rays.chunks) == 1
    free_of, bare = layout.free_of, without_fields(cameras, rays.photograph, rays.measured)

    def work(begin: int, end: int) -> tuple[int, int, NormalEquations]:
        start, stop = (0, 0) if whole else _blocks(rays, layout, begin, end)
        part = normal if whole else normal.part(start, stop)
        failed = accumulate(
            begin, end, rays.first, rays.index, rays.photograph, rays.measured, rays.mixing, bare, cameras, layout.unit,
            points.position, layout.place, free_of, loss.kind, loss.threshold, loss.least_curvature, damping,
            points.prior, layout.block_at, start, part.A.reshape(-1), part.Q.reshape(-1), part.H,
        )  # fmt: skip
        return int(failed), start, part

    worst = -1
    for failed, start, part in in_chunks(work, rays, pool):
        if not whole:
            normal.add(part, start)
        worst = failed if worst < 0 else worst
    return worst


def observation_cost(
    rays: Rays,
    cameras: OrientedCameras,
    position: FloatArray,
    loss: Loss,
    pool: ThreadPoolExecutor | None = None,
) -> float:
    """Return the cost of the observations of points at ``position`` (P, 3) in the world, m."""
    if len(rays.mixing):
        return _mixed_cost(rays, cameras, position)
    bare = without_fields(cameras, rays.photograph, rays.measured)

    def work(begin: int, end: int) -> float:
        return float(
            cost_of_points(
                begin, end, rays.first, rays.index, rays.photograph, rays.measured, bare, cameras, position, loss.kind,
                loss.threshold,
            )
        )  # fmt: skip

    return sum(in_chunks(work, rays, pool))


def _mixed_cost(rays: Rays, cameras: OrientedCameras, position: FloatArray) -> float:
    """Return the cost, without a loss, of observations whose coordinates have a covariance."""
    point = np.repeat(rays.index, np.diff(rays.first))
    o = Observations(rays.photograph, point, rays.measured[:, :2], 1.0 / rays.measured[:, 2], rays.mixing)
    return 0.5 * float(np.sum(o.with_penalty(residuals(o, cameras, position)) ** 2))


def _blocks(rays: Rays, layout: Layout, begin: int, end: int) -> tuple[int, int]:
    """Return the range of the blocks of the photographs that see the points of a range."""
    places = layout.place[rays.photograph[rays.first[begin] : rays.first[end]]]
    places = places[places >= 0]
    if not len(places):
        return 0, 0
    return int(layout.first_block[places.min()]), int(layout.first_block[places.max() + 1])


def substitute(
    rays: Rays,
    cameras: OrientedCameras,
    points: Points,
    layout: Layout,
    loss: Loss,
    damping: float,
    step: tuple[FloatArray, FloatArray],
    moved: OrientedCameras,
    bend: FloatArray,
    pool: ThreadPoolExecutor | None = None,
) -> tuple[FloatArray, float, float]:
    """Return the points (P, 3) moved by their part of a step, the decrease that the linear model of the observations
    predicts, and the cost of the observations after it.

    ``step`` are the steps of the poses (6 free,) and the border; ``moved`` the cameras after it, ``bend`` (4, 3) what
    ``similarity_steps.bend_of`` adds to it; the decrease lacks the damping of the cameras and everything that is known
    of them but for the observations.
    """
    result = points.position.copy()
    free_of, bare = layout.free_of, without_fields(cameras, rays.photograph, rays.measured)
    moved_bare = without_fields(moved, rays.photograph, rays.measured)

    def work(begin: int, end: int) -> tuple[float, float]:
        return substitute_points(
            begin, end, rays.first, rays.index, rays.photograph, rays.measured, rays.mixing, bare, cameras, layout.unit,
            points.position, layout.place, free_of, loss.kind, loss.threshold, loss.least_curvature, damping,
            points.prior, *step, moved, moved_bare, bend, result,
        )  # fmt: skip

    parts = in_chunks(work, rays, pool)
    cost = _mixed_cost(rays, moved, result) if len(rays.mixing) else sum(p[1] for p in parts)
    return result, sum(p[0] for p in parts), cost


def point_covariances(
    rays: Rays,
    cameras: OrientedCameras,
    points: Points,
    layout: Layout,
    loss: Loss,
    covariance: tuple[FloatArray, FloatArray, FloatArray],
    pool: ThreadPoolExecutor | None = None,
) -> tuple[FloatArray, int]:
    """Return the covariances (P, 3, 3) of all points in the world, m², and the first that is singular, −1 when none is.

    ``covariance`` are the inverse of the poses' matrix within its band (flat, as A), T = A⁻¹ B (6 free, border) and the
    covariance of the border.
    """
    inverse, T, border = covariance
    rows = np.arange(layout.columns).reshape(-1, 6)
    low, high = np.minimum(rows[:, :, None], rows[:, None, :]), np.maximum(rows[:, :, None], rows[:, None, :])
    own = inverse[low * layout.stride + high].reshape(-1)
    pairs = blocks_of(inverse, layout).reshape(-1)
    turned = T.reshape(layout.free, 6, layout.border).transpose(0, 2, 1).reshape(-1)
    result = np.full((len(points.position), 3, 3), np.nan)
    free_of, bare = layout.free_of, without_fields(cameras, rays.photograph, rays.measured)

    def work(begin: int, end: int) -> int:
        return int(
            covariances_of_points(
                begin, end, rays.first, rays.index, rays.photograph, rays.measured, rays.mixing, bare, cameras,
                layout.unit,
                points.position, layout.place, free_of, loss.kind, loss.threshold, loss.least_curvature,
                points.prior, layout.block_at, pairs, own, turned, border, result,
            )
        )  # fmt: skip

    failed = [f for f in in_chunks(work, rays, pool) if f >= 0]
    return result, failed[0] if failed else -1
