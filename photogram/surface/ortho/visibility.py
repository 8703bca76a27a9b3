"""What a photograph sees of a surface: where it lies on the ground, and which cells of a DSM something hides from it.

A cell is hidden where something nearer to the nadir point is seen at a larger angle from the vertical (angle-based
visibility, Habib, Kim & Kim 2007). The angles are followed along rays from the nadir point to every cell on the
outline of what a photograph shows (R2, Franklin & Ray 1994), so that a cell costs a few operations, whatever stands
around it. What is found of a cell and a photograph does not depend on what else is asked for.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from threading import Lock

import numpy as np
import shapely

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.errors import SurfaceError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import LATTICE_CELLS, MapGrid, Window
from photogram.projection import OrientedCameras, ideal_point, lens_of, without_field
from photogram.surface.views import Views
from photogram.survey import Raster

VISIBLE, BESIDE, HIDDEN, MASKED = 0, 1, 2, 3
"""What a cell is in a photograph: seen; seen, but within RIM_CELLS of what is hidden; hidden; masked. Where the DSM has
the edge of a roof is rarely where the photograph has it, so what lies beside is taken from another one that sees it."""

TOLERANCE_CELLS = 1.0
"""How far, in cells, a surface must stick out above a ray to hide what lies behind: noise of a DSM stays below."""

TOLERANCE_SIGMAS = 2.0
"""How many standard deviations of its own height, and of what hides it, a cell is given besides."""

UNSURE_CELLS = 2.0
"""Tolerance, in cells, from which it is not sure that a cell is hidden: where no photograph sees it the best one that
shows its place is taken."""

RIM_CELLS = 2
RIM_RISE = 2.0
"""Rise over run up to which a cell beside what is hidden belongs to the same ground, and not to the roof above it."""

LARGEST_TAN = 10.0
"""Tangent of the angle from the vertical beyond which a photograph is not looked at."""

CACHE_BYTES = 256_000_000
"""Of what photographs see, packed, is kept; what falls out is found again."""

_COARSE_CELLS, _COARSE_AT_ONCE, _BORDER_POINTS, _SHRINKS = 64, 16, 9, 4


ReadWindow = Callable[[Window], Float32Array]
"""Gives values (rows, columns) of a window of a grid, which may lie on disk."""


@dataclass(frozen=True, eq=False)
class WindowedSurface:
    """A DSM of which windows are read: heights of the map, NaN where there are none, and by how much each may be off
    relative to those around it, None where that is not known."""

    grid: MapGrid
    heights: ReadWindow
    sigmas: ReadWindow | None

    @staticmethod
    def of(raster: Raster, sigma_m: Float32Array | None = None) -> WindowedSurface:
        """Return the surface of a raster with the standard deviations (rows, columns) of its cells."""

        def heights(window: Window) -> Float32Array:
            return np.ascontiguousarray(raster.values[window.slices], dtype=np.float32)

        def sigmas(window: Window) -> Float32Array:
            assert sigma_m is not None
            return np.asarray(sigma_m[window.slices], np.float32)

        return WindowedSurface(MapGrid.of(raster), heights, None if sigma_m is None else sigmas)


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """A DSM in the map, and the photographs above it.

    ``position_map_m`` (V, 3) are the projection centres, ``boxes`` (V,) the cells of the DSM that each photograph
    shows, a box around them, None where there are none; ``slope`` (V, K, 2) how far east and north the rays along its
    border go for a metre down, NaN where that cannot be told; ``coarse`` (2, R, C) the lowest and the highest height of
    every 64 × 64 cells, ±infinity where nothing is known.
    """

    surface: WindowedSurface
    position_map_m: FloatArray
    boxes: tuple[Window | None, ...]
    slope: FloatArray
    coarse: Float32Array

    @staticmethod
    def under(views: Views, frame: LocalFrame, surface: WindowedSurface) -> SurfaceModel:
        """Return the terrain under photographs. Raises SurfaceError where the surface has no heights."""
        coarse = _lowest_highest(surface)
        if not np.isfinite(coarse[0]).any():
            raise SurfaceError("orthophoto: the surface has no heights: set orthophoto.enabled to false")
        position = np.ascontiguousarray(frame.map_from_world(views.position_world_m))
        slope = _border_slopes(views, frame, position)
        boxes = tuple(_box_shown(surface.grid, coarse, position[n], slope[n]) for n in range(len(views)))
        return SurfaceModel(surface, position, boxes, slope, coarse)

    @property
    def grid(self) -> MapGrid:
        """Return the grid of the DSM."""
        return self.surface.grid

    def cells_around(self, grid: MapGrid, window: Window, margin: int) -> Window:
        """Return the cells of the DSM under a window of another grid, ``margin`` more on each side, one at least."""
        dsm, (east, north) = self.grid, grid.centres_map_m(window)
        columns = np.floor((east[[0, -1]] - dsm.west_map_m) / dsm.cell_m).astype(int)
        rows = np.floor((dsm.north_map_m - north[[0, -1]]) / dsm.cell_m).astype(int)
        row, column = (int(np.clip(a - margin, 0, n - 1)) for a, n in ((rows[0], dsm.rows), (columns[0], dsm.columns)))
        return Window(
            row, column,
            int(np.clip(rows[1] + 1 + margin, row + 1, dsm.rows)),
            int(np.clip(columns[1] + 1 + margin, column + 1, dsm.columns)),
        )  # fmt: skip

    def heights(self, window: Window) -> Float32Array:
        """Return the heights (rows, columns) of a window of the DSM."""
        return self.surface.heights(window)

    def tolerances_m(self, window: Window) -> Float32Array:
        """Return how far (rows, columns) the surface may be off in a window of the DSM."""
        if self.surface.sigmas is None:
            return np.zeros(window.shape, np.float32)
        return np.ascontiguousarray(np.float32(TOLERANCE_SIGMAS) * self.surface.sigmas(window))

    def views_over(self, window: Window) -> Int32Array:
        """Return the photographs that may show something of a window of the DSM, in their order."""
        return np.array([n for n, box in enumerate(self.boxes) if box is not None and box.common(window)], np.int32)

    def seen_by(self, view: int) -> ByteArray:
        """Return what each cell of the box of a photograph is in it: VISIBLE, BESIDE or HIDDEN; a cell
        without height is VISIBLE."""
        box, grid = self.boxes[view], self.grid
        if box is None:
            return np.zeros((0, 0), np.uint8)
        east, north, above = self.position_map_m[view].tolist()
        column, row = (east - grid.west_map_m) / grid.cell_m - 0.5, (grid.north_map_m - north) / grid.cell_m - 0.5
        low, high = _range_in(self.coarse, box)
        share = float(np.clip((high - low) / max(above - low, 1e-6), 0.0, 1.0))
        outer = _towards(box, row, column, share)
        height = self.heights(outer)
        out = np.zeros(height.shape, np.uint8)
        allowed = self.tolerances_m(outer)
        ends = np.array([above - low, max(above - high, 0.0)])[:, None, None] * self.slope[view] / grid.cell_m
        border = np.array([row, column]) - [outer.row, outer.column] + ends.reshape(-1, 2)[:, ::-1] * [-1.0, 1.0]
        targets = _targets(border, height.shape)
        _follow_rays(height, allowed, (row - outer.row, column - outer.column), above, grid.cell_m, targets, out)
        _add_rim(height, np.float32(RIM_RISE * grid.cell_m), out)
        return np.ascontiguousarray(out[box.within(outer)])


def _lowest_highest(surface: WindowedSurface) -> Float32Array:
    """Return the lowest and the highest height of every 64 × 64 cells."""
    grid = surface.grid
    coarse = grid.coarser(_COARSE_CELLS)
    extremes = np.empty((2, coarse.rows, coarse.columns), np.float32)
    for window in grid.tiles(_COARSE_CELLS * _COARSE_AT_ONCE):
        part = surface.heights(window)
        known = np.isfinite(part)
        at = window.coarser(_COARSE_CELLS).slices
        rows, columns = (np.arange(0, n, _COARSE_CELLS) for n in part.shape)
        for k, (reduce, none) in enumerate(((np.minimum, np.inf), (np.maximum, -np.inf))):
            across = reduce.reduceat(np.where(known, part, np.float32(none)), columns, axis=1)
            extremes[k][at] = reduce.reduceat(across, rows, axis=0)
    return extremes


def _range_in(coarse: Float32Array, box: Window) -> tuple[float, float]:
    """Return the lowest and the highest height around a window, infinite where none is known."""
    at = box.coarser(_COARSE_CELLS).slices
    return float(coarse[0][at].min()), float(coarse[1][at].max())


@njit(cache=True, nogil=True)
def _border_rays(cameras: OrientedCameras, across: int, out: FloatArray) -> None:
    """Fill directions (V, 4 across, 3) in the world of rays along the border of each photograph; NaN where there are
    none."""
    R = cameras.rotation
    for n in range(len(out)):
        m = cameras.camera[n]
        width, height = cameras.size_px[m, 0], cameras.size_px[m, 1]
        q = lens_of(cameras.parameters, m)
        for k in range(4 * across):
            share, side = (k % across) / across, k // across
            u = share * width if side == 0 else (width if side == 1 else ((1.0 - share) * width if side == 2 else 0.0))
            v = (
                0.0
                if side == 0
                else (share * height if side == 1 else (height if side == 2 else (1.0 - share) * height))
            )
            u, v = without_field(cameras, m, u - 0.5, v - 0.5)
            x, y = ideal_point(cameras.model[m], q, u, v)
            for a in range(3):
                out[n, k, a] = R[n, a, 0] * x + R[n, a, 1] * y + R[n, a, 2]


def _border_slopes(views: Views, frame: LocalFrame, position: FloatArray) -> FloatArray:
    """Return how far east and north (V, K, 2) rays along the borders of the photographs go for a metre down, at most
    LARGEST_TAN; NaN where the border of a photograph cannot be told."""
    ray = np.empty((len(views), 4 * _BORDER_POINTS, 3))
    _border_rays(views.cameras, _BORDER_POINTS, ray)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    ends = frame.map_from_world((views.position_world_m[:, None] + 10.0 * ray).reshape(-1, 3)).reshape(ray.shape)
    step = ends - position[:, None]
    away = np.maximum(np.linalg.norm(step[..., :2], axis=2), 1e-12)
    down = np.maximum(-step[..., 2], away / LARGEST_TAN)
    return np.asarray(step[..., :2] / down[..., None])


def _box_shown(grid: MapGrid, coarse: Float32Array, centre: FloatArray, slope: FloatArray) -> Window | None:
    """Return a box around the cells that a photograph shows: as far as its border reaches down to the lowest height in
    the box."""
    if np.isnan(slope).any():
        slope = LARGEST_TAN * np.array([[-1.0, -1.0], [1.0, 1.0]])
    box = grid.whole
    for _ in range(_SHRINKS):
        low, high = _range_in(coarse, box)
        if not low < centre[2]:
            return None
        depth = np.array([centre[2] - low, max(centre[2] - high, 0.0)])
        place = centre[:2] + (depth[:, None, None] * slope).reshape(-1, 2)
        columns = (place[:, 0] - grid.west_map_m) / grid.cell_m
        rows = (grid.north_map_m - place[:, 1]) / grid.cell_m
        smaller = _clipped(grid, rows, columns)
        if smaller is None:
            return None
        box = smaller
    return box


def _clipped(grid: MapGrid, rows: FloatArray, columns: FloatArray) -> Window | None:
    """Return the cells of a grid around places of it, one more on each side; None beside the grid."""
    first = [int(np.clip(np.floor(a.min()) - 1, 0, n)) for a, n in ((rows, grid.rows), (columns, grid.columns))]
    last = [int(np.clip(np.ceil(a.max()) + 1, 0, n)) for a, n in ((rows, grid.rows), (columns, grid.columns))]
    if first[0] >= last[0] or first[1] >= last[1]:
        return None
    return Window(first[0], first[1], last[0], last[1])


def _towards(box: Window, row: float, column: float, share: float) -> Window:
    """Return a window widened by a share of the way from each of its cells to a place."""
    ends = []
    for first, last, place in ((box.row, box.row_end, row), (box.column, box.column_end, column)):
        moved = [a + share * (place - a) for a in (first, last)]
        ends.append((min(first, int(np.floor(min(moved)))), max(last, int(np.ceil(max(moved))))))
    return Window(ends[0][0], ends[1][0], ends[0][1], ends[1][1])


def _targets(border: FloatArray, shape: tuple[int, int]) -> IntArray:
    """Return the cells (N, 2) that rays are followed to: those on the outline of what a photograph shows,
    rows and columns of whose ``border`` (M, 2) may lie outside of the window; of all of it where the border is
    unknown."""
    rows, columns = shape
    whole = np.array([[-1.0, -1.0], [-1.0, columns], [rows, columns], [rows, -1.0]])
    hull = shapely.convex_hull(shapely.MultiPoint(border if np.isfinite(border).all() else whole))
    ring = shapely.get_coordinates(shapely.intersection(hull.buffer(2.0), shapely.box(-1.0, -1.0, rows, columns)))
    targets = []
    for axis, n in ((0, rows), (1, columns)):
        # where the outline crosses the middle of each row, and of each column
        middle = np.arange(n)
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        for (a0, b0), (a1, b1) in zip(ring[:-1][:, [axis, 1 - axis]], ring[1:][:, [axis, 1 - axis]], strict=True):
            if a0 == a1:
                continue
            at = middle[(middle >= min(a0, a1)) & (middle <= max(a0, a1))]
            b = b0 + (at - a0) * (b1 - b0) / (a1 - a0)
            low[at], high[at] = np.minimum(low[at], b), np.maximum(high[at], b)
        met = np.flatnonzero(low <= high)
        for side in (np.ceil(low[met]), np.floor(high[met])):
            other = np.clip(side, 0, shape[1 - axis] - 1).astype(np.int64)
            targets.append(np.column_stack([met, other] if axis == 0 else [other, met]))
    return np.concatenate(targets)


@njit(cache=True, nogil=True)
def _entry(place: float, slope: float, cells: int, first: float, last: float) -> tuple[float, float]:
    """Return the part of first to last, along the one axis, in which place + slope t lies in 0 to cells − 1."""
    if slope == 0.0:
        return (first, last) if -0.5 <= place < cells - 0.5 else (1.0, 0.0)
    a, b = (-0.49 - place) / slope, (cells - 0.51 - place) / slope
    return max(first, min(a, b)), min(last, max(a, b))


@njit(cache=True, nogil=True, error_model="numpy")
def _follow_rays(
    height: Float32Array,
    allowed: Float32Array,
    nadir: tuple[float, float],
    above: float,
    cell: float,
    targets: IntArray,
    out: ByteArray,
) -> None:
    """Mark the cells that are HIDDEN from a projection centre at a height ``above``, over the place ``nadir``, row and
    column, which may lie outside; along rays to the cells ``targets`` (N, 2).

    ``allowed`` (rows, columns) is how far a cell is raised before it counts as hidden, and lowered before it hides,
    and half of TOLERANCE_CELLS besides.
    """
    rows, columns = height.shape
    noise = 0.5 * TOLERANCE_CELLS * cell
    for n in range(len(targets)):
        tr, tc = targets[n, 0], targets[n, 1]
        dy, dx = tr - nadir[0], tc - nadir[1]
        steep = abs(dy) > abs(dx)
        major, minor = (dy, dx) if steep else (dx, dy)
        if abs(major) < 1.0:
            continue
        sign = 1.0 if major > 0.0 else -1.0
        slope = minor / abs(major)
        start = nadir[0] if steep else nadir[1]
        other = nadir[1] if steep else nadir[0]
        along, across = (rows, columns) if steep else (columns, rows)
        first = max(0.0, -start if sign > 0.0 else start - (along - 1))
        first, last = _entry(other, slope, across, first, abs(major) + 1e-9)
        # whole cells of the longer axis
        k = int(np.ceil(start + first)) if sign > 0.0 else int(np.floor(start - first))
        end = tr if steep else tc
        stretch = cell * np.sqrt(1.0 + slope * slope)
        # what stands one or two cells in front of a cell hides nothing of it: it is the surface's own roughness
        widest, one, two = 0.0, 0.0, 0.0
        while (sign > 0.0 and k <= end) or (sign < 0.0 and k >= end):
            t = abs(k - start)
            if t > last:
                break
            m = int(np.floor(other + slope * t + 0.5))
            r, c = (k, m) if steep else (m, k)
            k += 1 if sign > 0.0 else -1
            if m < 0 or m >= across:
                continue
            h = height[r, c]
            if np.isnan(h):
                widest, two, one = max(widest, two), one, 0.0
                continue
            d, depth, free = t * stretch, above - h, allowed[r, c] + noise
            if d < widest * (depth - free):
                out[r, c] = HIDDEN
            lowered = depth + free
            widest, two, one = max(widest, two), one, (d / lowered if lowered > 0.0 else np.inf)


@njit(cache=True, nogil=True)
def _add_rim(height: Float32Array, rise: np.float32, out: ByteArray) -> None:
    """Mark the cells BESIDE those that are HIDDEN, where both belong to the same ground."""
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            if out[r, c] != HIDDEN:
                continue
            for rr in range(max(r - RIM_CELLS, 0), min(r + RIM_CELLS + 1, rows)):
                for cc in range(max(c - RIM_CELLS, 0), min(c + RIM_CELLS + 1, columns)):
                    near = rise * max(abs(rr - r), abs(cc - c))
                    if out[rr, cc] == VISIBLE and abs(height[rr, cc] - height[r, c]) <= near:
                        out[rr, cc] = BESIDE


class SeenCells:
    """What photographs see of a terrain, each found when it is asked for; the last used ones are kept, packed, as far
    as CACHE_BYTES go. May be asked from several threads at once."""

    def __init__(
        self,
        terrain: SurfaceModel,
        cache_bytes: int = CACHE_BYTES,
        masked: Callable[[int], BoolArray | None] = lambda _: None,
    ) -> None:
        """``masked`` gives which cells of the box of a photograph are masked in it, None for none."""
        self._terrain = terrain
        self._room = cache_bytes
        self._masked = masked
        self._lock = Lock()
        self._packed: OrderedDict[int, Future[ByteArray]] = OrderedDict()

    def of(self, view: int) -> ByteArray:
        """Return what all cells of the box of a photograph are in it."""
        box = self._terrain.boxes[view]
        return np.zeros((0, 0), np.uint8) if box is None else self.part(view, box)

    def part(self, view: int, window: Window) -> ByteArray:
        """Return what the cells of a window are in a photograph: VISIBLE, BESIDE, HIDDEN or MASKED; HIDDEN beyond its
        box."""
        box = self._terrain.boxes[view]
        out = np.full(window.shape, HIDDEN, np.uint8)
        both = None if box is None else box.common(window)
        if box is None or both is None:
            return out
        rows, columns = both.within(box)
        first = columns.start // 8
        packed = self._planes(view)[:, rows, first : -(-columns.stop // 8)]
        planes = np.unpackbits(packed, axis=2)[..., columns.start - 8 * first : columns.stop - 8 * first]
        out[both.within(window)] = planes.sum(axis=0, dtype=np.uint8)
        return out

    def _planes(self, view: int) -> ByteArray:
        """Return whether each cell is more than VISIBLE, and more than BESIDE, as bits (2, rows, columns / 8); in a
        photograph with a mask also whether it is more than HIDDEN (3, …)."""
        with self._lock:
            mine = view not in self._packed
            future = self._packed.setdefault(view, Future())
            self._packed.move_to_end(view)
        if mine:
            try:
                seen = self._terrain.seen_by(view)
                masked = self._masked(view)
                if masked is not None:
                    seen[masked] = MASKED
                states = (BESIDE, HIDDEN) if masked is None else (BESIDE, HIDDEN, MASKED)
                future.set_result(np.packbits(np.stack([seen >= state for state in states]), axis=2))
            except BaseException as error:
                future.set_exception(error)
                raise
            self._make_room()
        return future.result()

    def _make_room(self) -> None:
        with self._lock:
            sizes = {n: f.result().nbytes for n, f in self._packed.items() if f.done()}
            total = sum(sizes.values())
            for n, size in sizes.items():
                if total <= self._room or len(self._packed) == 1:
                    break
                del self._packed[n]
                total -= size


@njit(cache=True, nogil=True, error_model="numpy")
def height_at(height: Float32Array, y: float, x: float) -> float:
    """Return the height of a place, in cells from the outer corner of an array of heights: bilinear between the centres
    of four cells where all are known, else that of the cell itself; NaN where it is not known."""
    rows, columns = height.shape
    r, c = int(np.floor(y - 0.5)), int(np.floor(x - 0.5))
    if 0 <= r < rows - 1 and 0 <= c < columns - 1:
        u, v = x - 0.5 - c, y - 0.5 - r
        upper = (1.0 - u) * height[r, c] + u * height[r, c + 1]
        lower = (1.0 - u) * height[r + 1, c] + u * height[r + 1, c + 1]
        between = (1.0 - v) * upper + v * lower
        if not np.isnan(between):
            return float(between)
    r, c = int(np.floor(y)), int(np.floor(x))
    if r < 0 or c < 0 or r >= rows or c >= columns:
        return np.nan
    return float(height[r, c])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def place_between(
    nodes: FloatArray, first: tuple[int, int], row: int, column: int, height: float, X: FloatArray
) -> None:
    """Fill the place (3,) in the world of the centre of a cell at a height over the base: ``nodes`` are those of
    ``vertical_nodes`` for a window that begins at ``first``."""
    down, right = (row + 0.5) / LATTICE_CELLS, (column + 0.5) / LATTICE_CELLS
    a, b = int(down), int(right)
    down, right = down - a, right - b
    a, b = a - first[0] // LATTICE_CELLS, b - first[1] // LATTICE_CELLS
    w00, w01 = (1.0 - down) * (1.0 - right), (1.0 - down) * right
    w10, w11 = down * (1.0 - right), down * right
    for k in range(3):
        foot = w00 * nodes[a, b, k] + w01 * nodes[a, b + 1, k] + w10 * nodes[a + 1, b, k] + w11 * nodes[a + 1, b + 1, k]
        X[k] = foot + height * nodes[a, b, 3 + k]
