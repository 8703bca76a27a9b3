"""What photographs show of a lattice of ground that all windows share.

The cells of a patch are looked up in the same photographs, on a lattice of places about a pixel apart that holds the
centres of the cells: ``per_cell`` places along the side of a cell. Each photograph is resampled onto it once for each
height, and every window takes its samples from there. Where the places of a patch fall in a photograph is projected
exactly at 3 × 3 nodes and three heights, and interpolated quadratically between these 27.

The lattice lies in memory by phases: place (m y + i, m x + j) of a lattice with m places per cell and X cells across
is sample (m i + j, X y + x), so that the same place of the windows of neighbouring cells lies in neighbouring memory,
and long compiled loops over cells fill the processor's lanes. Such loops need no leave to reorder sums: what they
compute is the same to the last bit, whatever the compiler makes of them.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.projection import OrientedCameras, seen_called

FARTHEST_PX = 1.2
"""How far apart places of the lattice may lie, in pixels."""


class Crops(NamedTuple):
    """Cameras and the part of each (reduced) picture that a block of cells needs, one after the other in ``pixels``.

    ``start`` (V,), ``left``, ``top``, ``width``, ``height`` (V,) of each crop; a pixel (u, v) of the photograph is
    (u, v) · ``scale`` in the reduced picture. Pixels that show nothing, because a mask leaves them out, are NaN.
    """

    cameras: OrientedCameras
    start: IntArray
    left: IntArray
    top: IntArray
    width: IntArray
    height: IntArray
    pixels: Float32Array
    scale: float


class GroundCells(NamedTuple):
    """The cells of a block: vertical lines ``foot`` and ``up`` (rows, columns, 3), the steps ``east`` and ``south``
    (3,) to the next cell, the places of the lattice ``per_cell`` along its side, and ``views`` (rows / patch, columns /
    patch, N): in which views the cells of a patch of ``patch`` × ``patch`` cells are matched, −1 for none; which of
    them do not see a cell, ``hidden`` (rows, columns, N), without cells where all see all."""

    foot: FloatArray
    up: FloatArray
    east: FloatArray
    south: FloatArray
    per_cell: int
    views: IntArray
    patch: int
    hidden: BoolArray


NOTHING_HIDDEN: BoolArray = np.zeros((0, 0, 0), dtype=np.bool_)
"""Where all views of a patch see all its cells."""


class CellWindow(NamedTuple):
    """Cells ``row`` to ``row`` + ``rows`` and ``column`` to ``column`` + ``columns`` of a block."""

    row: int
    column: int
    rows: int
    columns: int


class LatticeNodes(NamedTuple):
    """What places of a patch are counted from: rows and columns from cell (``row``, ``column``) in ``row_reach`` and
    ``column_reach`` cells, heights from ``height`` in ``height_reach`` m, each −1 to 1 over the patch."""

    row: float
    column: float
    row_reach: float
    column_reach: float
    height: float
    height_reach: float


class Scratch(NamedTuple):
    """Room (n,) in which samples are computed: where they lie in plan, the pixel to the north-west, and how far they
    lie beyond it."""

    east: Float32Array
    south: Float32Array
    at: Int32Array
    right: Float32Array
    down: Float32Array


@njit(cache=True, nogil=True)
def scratch_for_samples(cells: int) -> Scratch:
    """Return room for patches of up to ``cells`` places in a phase."""
    return Scratch(
        np.zeros(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.int32),
        np.zeros(cells, np.float32), np.zeros(cells, np.float32),
    )  # fmt: skip


def places_per_cell(spacing: float) -> int:
    """Return how many places along the side of a cell leave no pixel unread, pixels being ``spacing`` cells apart."""
    return int(np.ceil(1.0 / (FARTHEST_PX * spacing) - 1e-9))


@njit(cache=True, nogil=True)
def nodes_of(box: CellWindow, reach: float, low_m: float, high_m: float) -> LatticeNodes:
    """Return what places up to ``reach`` cells around a box, at heights from ``low_m`` to ``high_m``, count from."""
    row_reach, column_reach = 0.5 * (box.rows - 1) + reach, 0.5 * (box.columns - 1) + reach
    return LatticeNodes(
        box.row + 0.5 * (box.rows - 1), box.column + 0.5 * (box.columns - 1), row_reach, column_reach,
        0.5 * (low_m + high_m), max(0.5 * (high_m - low_m), 1e-3),
    )  # fmt: skip


TERMS = 12
"""Products of powers of height t, row v and column u in which a place is expanded: 1, t, t², u, ut, ut², u², uv, v, vt,
vt², v². The others are below a hundredth of a pixel over a patch."""


@njit(cache=True, nogil=True)
def fill_places(crops: Crops, ground: GroundCells, nodes: LatticeNodes, view: int, out: Float32Array) -> None:
    """Fill ``out`` (2, TERMS) with the coefficients of the places in a crop, x and y, as ``nodes`` count them; NaN
    where the view does not show all nodes."""
    rows, columns, _ = ground.foot.shape
    r, c = min(int(nodes.row + 0.5), rows - 1), min(int(nodes.column + 0.5), columns - 1)
    foot, up, X, f = ground.foot[r, c], ground.up[r, c], np.empty(3), np.empty((2, 3, 3, 3))
    for a in range(3):
        h = nodes.height + (a - 1) * nodes.height_reach
        for i in range(3):
            south = nodes.row + (i - 1) * nodes.row_reach - r
            for j in range(3):
                east = nodes.column + (j - 1) * nodes.column_reach - c
                for k in range(3):
                    X[k] = foot[k] + h * up[k] + south * ground.south[k] + east * ground.east[k]
                x, y, _ = seen_called(crops.cameras, view, X[0], X[1], X[2])
                f[0, a, i, j], f[1, a, i, j] = x * crops.scale - crops.left[view], y * crops.scale - crops.top[view]
    for e in range(2):
        for a in range(3):
            for i in range(3):
                _to_powers(f[e, a, i])
            for j in range(3):
                _to_powers(f[e, a, :, j])
        for i in range(3):
            for j in range(3):
                _to_powers(f[e, :, i, j])
        for a in range(3):
            out[e, a], out[e, 3 + a], out[e, 8 + a] = f[e, a, 0, 0], f[e, a, 0, 1], f[e, a, 1, 0]
        out[e, 6], out[e, 7], out[e, 11] = f[e, 0, 0, 2], f[e, 0, 1, 1], f[e, 0, 2, 0]


@njit(cache=True, nogil=True)
def _to_powers(f: FloatArray) -> None:
    """Turn values (3,) at −1, 0 and 1 into the coefficients of the parabola through them."""
    below, middle, above = f[0], f[1], f[2]
    f[0], f[1], f[2] = middle, 0.5 * (above - below), 0.5 * (above + below) - middle


@njit(cache=True, nogil=True)
def fill_lattice(
    surface: Float32Array, box: CellWindow, per_cell: int, half: int, columns: int, out: Float32Array
) -> None:
    """Fill ``out`` (per_cell², Y × ``columns``) with a surface (rows, columns of a block) on the lattice of a box and
    ``half`` places around it, bilinear between the cells."""
    rows, across = surface.shape[0], surface.shape[1]
    for i in range(per_cell):
        for y in range(out.shape[1] // columns):
            r = min(max(box.row + y + (i - half) / per_cell, 0.0), rows - 1.0)
            r0 = min(int(r), max(rows - 2, 0))
            r1, v = min(r0 + 1, rows - 1), np.float32(r - r0)
            for j in range(per_cell):
                for x in range(columns):
                    c = min(max(box.column + x + (j - half) / per_cell, 0.0), across - 1.0)
                    c0 = min(int(c), max(across - 2, 0))
                    c1, u = min(c0 + 1, across - 1), np.float32(c - c0)
                    low = surface[r0, c0] + u * (surface[r0, c1] - surface[r0, c0])
                    high = surface[r1, c0] + u * (surface[r1, c1] - surface[r1, c0])
                    out[i * per_cell + j, y * columns + x] = low + v * (high - low)


@njit(cache=True, nogil=True)
def fill_part(
    whole: Float32Array, patch: CellWindow, across: int, box: CellWindow, columns: int, out: Float32Array
) -> None:
    """Fill ``out`` (per_cell², Y × ``columns``) with the part of a lattice of a ``patch``, ``whole`` (per_cell², Y ×
    ``across``), that belongs to a box of it."""
    south, east = box.row - patch.row, box.column - patch.column
    for n in range(len(out)):
        for y in range(out.shape[1] // columns):
            start, at = y * columns, (south + y) * across + east
            for x in range(columns):
                out[n, start + x] = whole[n, at + x]


@njit(cache=True, nogil=True)
def fill_plan(nodes: LatticeNodes, box: CellWindow, columns: int, room: Scratch, size: int) -> None:
    """Fill ``room.east`` and ``room.south`` (``size``,) with the places (Y × ``columns``) of the first phase of the
    lattice of a box, as ``nodes`` count them, as if its windows began with its cells."""
    for y in range(size // columns + 1):
        south = np.float32((box.row + y - nodes.row) / nodes.row_reach)
        for x in range(min(columns, size - y * columns)):
            room.south[y * columns + x] = south
            room.east[y * columns + x] = np.float32((box.column + x - nodes.column) / nodes.column_reach)


@njit(cache=True, nogil=True)
def _sample_phase(
    crop: Float32Array,
    size: tuple[int, int],
    places: Float32Array,
    shift: tuple[float, float],
    height: tuple[float, float],
    less: np.float32,
    surface: Float32Array,
    room: Scratch,
    out: Float32Array,
) -> None:
    """Fill ``out`` (n,) with what a crop of ``size`` shows of the places (n,) of ``room``, shifted to the east and to
    the south by ``shift``, at a · ``surface`` (n,) + b of ``height`` (a, b); less ``less``, NaN where it shows
    nothing."""
    w, x_end, y_end = np.int32(size[0]), np.float32(size[0] - 1), np.float32(size[1] - 1)
    p0, pt, ptt, pu, put, putt, puu, puv, pv, pvt, pvtt, pvv = places[0]
    q0, qt, qtt, qu, qut, qutt, quu, quv, qv, qvt, qvtt, qvv = places[1]
    a, b, du, dv = np.float32(height[0]), np.float32(height[1]), np.float32(shift[0]), np.float32(shift[1])
    zero, nan, one = np.float32(0.0), np.float32(np.nan), np.uint64(1)
    east, south, at, right, down = room.east, room.south, room.at, room.right, room.down
    # in two loops: the first fills the processor's lanes, the second, which reads from anywhere, cannot
    for k in range(len(out)):
        u, v, t = east[k] + du, south[k] + dv, a * surface[k] + b
        x = p0 + t * (pt + t * ptt) + u * (pu + t * (put + t * putt) + u * puu + v * puv)
        x += v * (pv + t * (pvt + t * pvtt) + v * pvv)
        y = q0 + t * (qt + t * qtt) + u * (qu + t * (qut + t * qutt) + u * quu + v * quv)
        y += v * (qv + t * (qvt + t * qvtt) + v * qvv)
        shown = (x >= zero) & (x < x_end) & (y >= zero) & (y < y_end)
        x, y = x if shown else zero, y if shown else zero
        xi, yi = np.int32(x), np.int32(y)
        at[k] = yi * w + xi
        right[k], down[k] = x - np.float32(xi), y - np.float32(yi)
        out[k] = less if shown else nan
    for k in range(len(out)):
        n = np.uint64(at[k])
        m = n + np.uint64(w)
        top = crop[n] + right[k] * (crop[n + one] - crop[n])
        low = crop[m] + right[k] * (crop[m + one] - crop[m])
        out[k] = (top + down[k] * (low - top)) - out[k]


@njit(cache=True, nogil=True)
def sample_lattice(
    crops: Crops,
    view: int,
    places: Float32Array,
    nodes: LatticeNodes,
    half: int,
    per_cell: int,
    surface: Float32Array,
    above_m: float,
    room: Scratch,
    out: Float32Array,
) -> None:
    """Fill ``out`` (per_cell², n) with what a view shows of the lattice of the box of `fill_plan` and ``half`` places
    around it, at ``above_m`` over a ``surface`` (per_cell², n); NaN where it shows nothing.

    ``places`` (2, TERMS) are those of `fill_places`, counted as ``nodes``. Grey values are less that in the middle of
    the patch, so that sums of their products keep their digits.
    """
    size = (crops.width[view], crops.height[view])
    crop = crops.pixels[crops.start[view] : crops.start[view] + size[0] * size[1]]
    height = (1.0 / nodes.height_reach, (above_m - nodes.height) / nodes.height_reach)
    x, y = places[0, 0], places[1, 0]
    less = np.float32(0.0)
    if 0.0 <= x < size[0] and 0.0 <= y < size[1]:
        less = crop[int(y) * size[0] + int(x)]
        less = less if less == less else np.float32(0.0)
    for i in range(per_cell):
        south = (i - half) / per_cell / nodes.row_reach
        for j in range(per_cell):
            east, n = (j - half) / per_cell / nodes.column_reach, i * per_cell + j
            _sample_phase(crop, size, places, (east, south), height, less, surface[n], room, out[n])


@njit(cache=True, nogil=True)
def grey_of_cells(crops: Crops, ground: GroundCells, surface: Float32Array, out: Float32Array) -> None:
    """Fill ``out`` (rows, columns) with the grey values of a surface (m over the base), each in the first of its views;
    0 where that does not show it."""
    rows, columns = surface.shape
    X = np.empty(3)
    for r in range(rows):
        for c in range(columns):
            out[r, c] = np.float32(0.0)
            v = ground.views[r // ground.patch, c // ground.patch, 0]
            if v < 0:
                continue
            for k in range(3):
                X[k] = ground.foot[r, c, k] + surface[r, c] * ground.up[r, c, k]
            x, y, _ = seen_called(crops.cameras, v, X[0], X[1], X[2])
            x, y = x * crops.scale - crops.left[v], y * crops.scale - crops.top[v]
            if 0.0 <= x < crops.width[v] - 1 and 0.0 <= y < crops.height[v] - 1:
                i, j = int(y), int(x)
                at = crops.start[v] + i * crops.width[v] + j
                top = crops.pixels[at] + (x - j) * (crops.pixels[at + 1] - crops.pixels[at])
                at += crops.width[v]
                low = crops.pixels[at] + (x - j) * (crops.pixels[at + 1] - crops.pixels[at])
                grey = np.float32(top + (y - i) * (low - top))
                out[r, c] = grey if grey == grey else np.float32(0.0)
