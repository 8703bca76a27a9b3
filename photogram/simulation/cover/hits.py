"""Rays against what stands on the ground of a made scene: leaves, which are discs, and thin lines with their thickness.

Discs and pieces of lines are filed in upright columns, the highest first, and columns in blocks with their lowest and
highest height: a ray walks from block to block, enters those at its height, and tests in each column what lies at its
height there (Amanatides & Woo 1987, on two levels). The first disc is found exactly. A line is thinner than a pixel, so
that not a hit but its share of the pixel's width is asked for.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.simulation.ray_cells import leave_cell, next_cell

COLUMN_M = 0.2
"""Side of a column."""

BLOCK_COLUMNS = 4
"""Side of a block, in columns."""

MARGIN_M = 0.1
"""What blocks reach beyond what is in them: half the width of a pixel on the ground, at the least."""


class Pieces(NamedTuple):
    """Discs and pieces of lines as the kernels take them; the first ``len(radius)`` items are discs."""

    centre: FloatArray
    """Centres of the discs (L, 3)."""
    normal: FloatArray
    """Their normals (L, 3), of unit length."""
    radius: FloatArray
    """Their radii (L,)."""
    start: FloatArray
    """Where the pieces of lines begin (W, 3)."""
    end: FloatArray
    """Where they end (W, 3)."""
    thickness: FloatArray
    """Their radii (W,)."""
    west: float
    south: float
    columns: int
    rows: int
    first: Int32Array
    """Where in ``item`` each column begins (rows × columns + 1,)."""
    item: Int32Array
    """What the columns hold, the highest first."""
    low: FloatArray
    """Lowest height of each item (L + W,)."""
    high: FloatArray
    """Highest height of each item (L + W,)."""
    block_low: FloatArray
    """Lowest height in each block, infinity for nothing."""
    block_high: FloatArray
    """Highest height in each block, minus infinity for nothing."""
    floor_m: float
    ceiling_m: float


@njit(cache=True, nogil=True)
def _filed(
    low: FloatArray, high: FloatArray, order: IntArray, columns: int, rows: int
) -> tuple[Int32Array, Int32Array]:
    """File boxes (N, 2), in units of columns, in all columns they touch, each column in the order given."""
    first = np.zeros(rows * columns + 1, np.int32)
    for n in range(len(low)):
        for r in range(int(low[n, 1]), int(high[n, 1]) + 1):
            for c in range(int(low[n, 0]), int(high[n, 0]) + 1):
                first[r * columns + c + 1] += 1
    for k in range(rows * columns):
        first[k + 1] += first[k]
    item, used = np.empty(first[-1], np.int32), first[:-1].copy()
    for m in range(len(order)):
        n = order[m]
        for r in range(int(low[n, 1]), int(high[n, 1]) + 1):
            for c in range(int(low[n, 0]), int(high[n, 0]) + 1):
                item[used[r * columns + c]] = n
                used[r * columns + c] += 1
    return first, item


@njit(cache=True, nogil=True)
def _block_heights(
    low: FloatArray, high: FloatArray, z_low: FloatArray, z_high: FloatArray, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest height of boxes (N, 2), in units of blocks, in each block."""
    lowest, highest = np.full(shape, np.inf), np.full(shape, -np.inf)
    for n in range(len(low)):
        for r in range(max(int(low[n, 1]), 0), min(int(high[n, 1]), shape[0] - 1) + 1):
            for c in range(max(int(low[n, 0]), 0), min(int(high[n, 0]), shape[1] - 1) + 1):
                lowest[r, c] = min(lowest[r, c], z_low[n])
                highest[r, c] = max(highest[r, c], z_high[n])
    return lowest, highest


def filed(
    centre: FloatArray,
    normal: FloatArray,
    radius: FloatArray,
    start: FloatArray,
    end: FloatArray,
    thickness: FloatArray,
) -> Pieces:
    """Return discs (L, 3), (L, 3), (L,) and pieces of lines (W, 3), (W, 3), (W,), all in metres, filed for the rays."""
    half = radius[:, None] * np.sqrt(np.clip(1.0 - normal**2, 0.0, 1.0))
    thick = thickness[:, None] + MARGIN_M
    low = np.concatenate([centre - half, np.minimum(start, end) - thick])
    high = np.concatenate([centre + half, np.maximum(start, end) + thick])
    side = COLUMN_M * BLOCK_COLUMNS
    if len(low):
        corner = low[:, :2].min(axis=0) - 2 * MARGIN_M
        blocks = np.ceil((high[:, :2].max(axis=0) + 2 * MARGIN_M - corner) / side).astype(int)
    else:
        corner, blocks = np.zeros(2), np.ones(2, dtype=int)
    columns, rows = (int(b) * BLOCK_COLUMNS for b in blocks)
    order = np.argsort(-high[:, 2], kind="stable")
    first, item = _filed((low[:, :2] - corner) / COLUMN_M, (high[:, :2] - corner) / COLUMN_M, order, columns, rows)
    lowest, highest = _block_heights(
        (low[:, :2] - MARGIN_M - corner) / side, (high[:, :2] + MARGIN_M - corner) / side, low[:, 2].copy(),
        high[:, 2].copy(), (int(blocks[1]), int(blocks[0])),
    )  # fmt: skip
    floor, ceiling = (low[:, 2].min() - MARGIN_M, high[:, 2].max() + MARGIN_M) if len(low) else (0.0, 0.0)
    centre, normal, radius, start, end, thickness = (
        np.ascontiguousarray(a, np.float64) for a in (centre, normal, radius, start, end, thickness)
    )
    return Pieces(
        centre, normal, radius, start, end, thickness, float(corner[0]), float(corner[1]), columns, rows, first, item,
        low[:, 2].copy(), high[:, 2].copy(), lowest, highest, float(floor), float(ceiling),
    )  # fmt: skip


@njit(cache=True)
def disc_hit(centre: FloatArray, normal: FloatArray, radius: float, o: FloatArray, d: FloatArray) -> float:
    """Return the parameter of the ray o + t d where it meets a disc, infinity where it does not for t > 0."""
    slope = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
    if slope == 0.0:
        return float(np.inf)
    x, y, z = centre[0] - o[0], centre[1] - o[1], centre[2] - o[2]
    t = (normal[0] * x + normal[1] * y + normal[2] * z) / slope
    if t <= 0.0:
        return float(np.inf)
    x, y, z = x - t * d[0], y - t * d[1], z - t * d[2]
    return float(t) if x * x + y * y + z * z <= radius * radius else float(np.inf)


@njit(cache=True)
def line_share(
    a: FloatArray, b: FloatArray, radius: float, o: FloatArray, d: FloatArray, pixel: float
) -> tuple[float, float]:
    """Return which share of a pixel's width a piece of line a–b takes, and the parameter of the ray o + t d nearest it.

    ``pixel`` is the width of a pixel at t = 1; the piece ends at a and b.
    """
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    w0, w1, w2 = a[0] - o[0], a[1] - o[1], a[2] - o[2]
    uu, ud, dd = u0 * u0 + u1 * u1 + u2 * u2, u0 * d[0] + u1 * d[1] + u2 * d[2], d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    wu, wd = w0 * u0 + w1 * u1 + w2 * u2, w0 * d[0] + w1 * d[1] + w2 * d[2]
    across = uu * dd - ud * ud
    s = min(max((wd * ud - wu * dd) / across, 0.0), 1.0) if across > 1e-12 * uu * dd else 0.0
    t = (wd + s * ud) / dd
    if t <= 0.0:
        return 0.0, np.inf
    x, y, z = w0 + s * u0 - t * d[0], w1 + s * u1 - t * d[1], w2 + s * u2 - t * d[2]
    distance, half = np.sqrt(x * x + y * y + z * z), 0.5 * pixel * t
    return max(min(distance + half, radius) - max(distance - half, -radius), 0.0) / (2.0 * half), t


@njit(cache=True)
def _in_block(
    p: Pieces, block: tuple[int, int], o: FloatArray, d: FloatArray, span: tuple[float, float], pixel: float,
    best: tuple[float, int, float, float, int],
) -> tuple[float, int, float, float, int]:  # fmt: skip
    """Test what the columns of a block hold along a ray, from span[0] to span[1]; ``best`` as first_cover returns."""
    hit, leaf, share, line_t, line = best
    x, y = o[0] - p.west, o[1] - p.south
    c0, r0 = block[0] * BLOCK_COLUMNS, block[1] * BLOCK_COLUMNS
    c = min(max(int(np.floor((x + span[0] * d[0]) / COLUMN_M)), c0), c0 + BLOCK_COLUMNS - 1)
    r = min(max(int(np.floor((y + span[0] * d[1]) / COLUMN_M)), r0), r0 + BLOCK_COLUMNS - 1)
    t, discs = span[0], len(p.radius)
    while t < min(span[1], hit) and c0 <= c < c0 + BLOCK_COLUMNS and r0 <= r < r0 + BLOCK_COLUMNS:
        along, up = leave_cell(c, COLUMN_M, x, d[0]), leave_cell(r, COLUMN_M, y, d[1])
        leave = min(along, up, span[1])
        z0, z1 = o[2] + t * d[2], o[2] + min(leave, hit) * d[2]
        low, high = min(z0, z1), max(z0, z1)
        k = r * p.columns + c
        for m in range(p.first[k], p.first[k + 1]):
            n = int(p.item[m])
            if p.high[n] < low:
                break
            if p.low[n] > high:
                continue
            if n < discs:
                s = disc_hit(p.centre[n], p.normal[n], p.radius[n], o, d)
                if s < hit:
                    hit, leaf = s, n
                    low = max(low, o[2] + hit * d[2]) if d[2] < 0.0 else low
            elif pixel > 0.0:
                part, s = line_share(p.start[n - discs], p.end[n - discs], p.thickness[n - discs], o, d, pixel)
                if part > share:
                    share, line_t, line = part, s, n - discs
        c, r = next_cell(c, r, along, up, d)
        t = max(t, leave)
    return hit, leaf, share, line_t, line


@njit(cache=True)
def first_cover(
    p: Pieces, o: FloatArray, d: FloatArray, end: float, pixel: float, touch: bool
) -> tuple[float, int, float, float, int]:
    """Follow the ray o + t d (world, m) up to ``end``: the parameter and the number of the first disc, infinity and −1
    for none, and share of the pixel, parameter and number of the line that takes most of it, 0, infinity and −1.

    ``pixel`` is the width of a pixel at t = 1, 0 to leave lines out. With ``touch`` the walk ends at the first block
    whose heights the ray passes, as if there were a disc, number 0.
    """
    best = (end, -1, 0.0, np.inf, -1)
    start, stop = 0.0, end
    if d[2] < 0.0:
        start, stop = max(start, (p.ceiling_m - o[2]) / d[2]), min(stop, (p.floor_m - o[2]) / d[2])
    elif d[2] > 0.0:
        start, stop = max(start, (p.floor_m - o[2]) / d[2]), min(stop, (p.ceiling_m - o[2]) / d[2])
    elif o[2] < p.floor_m or o[2] > p.ceiling_m:
        stop = start
    rows, columns = p.block_low.shape
    side = COLUMN_M * BLOCK_COLUMNS
    x, y = o[0] - p.west, o[1] - p.south
    for k in range(2):
        origin, width = (x, columns * side) if k == 0 else (y, rows * side)
        if d[k] == 0.0:
            if origin < 0.0 or origin >= width:
                stop = start
        else:
            near, far = -origin / d[k], (width - origin) / d[k]
            start, stop = max(start, min(near, far)), min(stop, max(near, far))
    t = start
    c = min(max(int(np.floor((x + t * d[0]) / side)), 0), columns - 1)
    r = min(max(int(np.floor((y + t * d[1]) / side)), 0), rows - 1)
    while t < min(stop, best[0]) and 0 <= c < columns and 0 <= r < rows:
        along, up = leave_cell(c, side, x, d[0]), leave_cell(r, side, y, d[1])
        leave = min(along, up, stop)
        z0, z1 = o[2] + t * d[2], o[2] + leave * d[2]
        if min(z0, z1) <= p.block_high[r, c] and max(z0, z1) >= p.block_low[r, c]:
            if touch:
                return t, 0, 0.0, np.inf, -1
            best = _in_block(p, (c, r), o, d, (t, leave), pixel, best)
        c, r = next_cell(c, r, along, up, d)
        t = max(t, leave)
    if best[1] < 0:
        return np.inf, -1, best[2], best[3], best[4]
    return best


@njit(cache=True, nogil=True)
def leaf_hits(p: Pieces, origin: FloatArray, direction: FloatArray, end: float) -> FloatArray:
    """Return where rays (N, 3), (N, 3) meet their first disc before ``end``, in units of their direction, infinity for
    none."""
    t = np.empty(len(direction))
    for i in range(len(direction)):
        t[i] = first_cover(p, origin[i], direction[i], end, 0.0, False)[0]
    return t


@njit(cache=True, nogil=True)
def leaves_over(
    p: Pieces, x: FloatArray, y: FloatArray, ground: FloatArray, step: FloatArray, samples: int
) -> tuple[FloatArray, Int32Array, FloatArray, FloatArray]:
    """Look down on cells with centres x, y (N,) over a level ``ground`` (N,) by samples × samples upright rays each.

    ``step`` (2, 2) are the sides of a cell. Returns of each cell the height of the highest disc, NaN where there is
    none, and its number, −1 for none; and mean and mean square of the height above the ground that the rays meet.
    """
    n = len(x)
    highest, leaf = np.full(n, np.nan), np.full(n, -1, np.int32)
    mean, square = np.zeros(n), np.zeros(n)
    down, o = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, p.ceiling_m + 1.0])
    weight = 1.0 / (samples * samples)
    for i in range(n):
        for k in range(samples * samples):
            u, v = (k % samples + 0.5) / samples - 0.5, (k // samples + 0.5) / samples - 0.5
            o[0], o[1] = x[i] + u * step[0, 0] + v * step[1, 0], y[i] + u * step[0, 1] + v * step[1, 1]
            t, number, _, _, _ = first_cover(p, o, down, np.inf, 0.0, False)
            z = o[2] - t
            if number >= 0 and z > ground[i]:
                mean[i] += weight * (z - ground[i])
                square[i] += weight * (z - ground[i]) ** 2
                if leaf[i] < 0 or z > highest[i]:
                    highest[i], leaf[i] = z, number
    return highest, leaf, mean, square
