"""What a photograph sees of a surface: heights of a DSM, and rays that are followed over it to the projection centre.

A ray is tested at places that depend on the cell and the photograph alone; where it stays above a whole block of cells,
these are passed over, which changes nothing but the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from photogram.arrays import FloatArray
from photogram.compilation import njit
from photogram.errors import PhotogramError
from photogram.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.surface.views import Views
from photogram.survey import Raster

Heights = NDArray[np.float32]

BLOCK_CELLS = 16
START_CELLS, STEP_CELLS = 3.0, 0.75
"""Where the test of a ray begins, in cells of the DSM in plan, and the way from one place of it to the next."""

TOLERANCE_CELLS = 1.0
"""How far, in cells, a surface must stick out above a ray to hide what lies behind: noise of a DSM stays below."""

STRICT, NARROW = 0, 1
"""How a ray is tested, see ``is_hidden``."""

EDGE_CELLS = 4.0
"""Difference in height within five cells, in cells, from which there is a height edge: 45° are no edge."""


class Relief(NamedTuple):
    """Part of a DSM as compiled code takes it, from the cell (``row``, ``column``) of the whole DSM on.

    ``height`` (R, C), NaN where it is not known; ``highest`` (R, C) of each cell and those within two of it, and of
    ``blocks``
    of cells, −infinity where nothing is known; ``edge`` (R, C): whether there is a height edge within two cells.
    ``ceiling`` is the highest place of the whole DSM. Heights in m of the map.
    """

    height: Heights
    highest: Heights
    blocks: Heights
    edge: NDArray[np.bool_]
    row: int
    column: int
    west: float
    north: float
    cell: float
    ceiling: float


@dataclass(frozen=True, eq=False)
class Terrain:
    """A DSM in the map and the projection centres ``position_map_m`` (V, 3) above it."""

    surface: Raster
    position_map_m: FloatArray
    ceiling_m: float

    @staticmethod
    def under(views: Views, frame: LocalFrame, surface: Raster) -> Terrain:
        """Return the terrain under photographs. Raises PhotogramError where the surface has no heights."""
        if not np.isfinite(surface.values).any():
            raise PhotogramError("orthophoto: the surface has no heights: set orthophoto.enabled to false")
        ceiling = float(np.nanmax(surface.values))
        return Terrain(surface, np.ascontiguousarray(frame.map_from_world(views.position_world_m)), ceiling)

    def around(self, grid: MapGrid, window: Window) -> Relief:
        """Return as much of the surface as rays from the window of a grid to the photographs may meet."""
        dsm = MapGrid.of(self.surface)
        east, north = grid.centres_map_m(window)
        columns = np.floor((east[[0, -1]] - dsm.west_map_m) / dsm.cell_m).astype(int)
        rows = np.floor((dsm.north_map_m - north[[0, -1]]) / dsm.cell_m).astype(int)
        near = Window(rows[0], columns[0], rows[1] + 1, columns[1] + 1)
        own = self.surface.values[_clipped(dsm, near, 4).slices]
        lowest = float(np.nanmin(own)) if np.isfinite(own).any() else self.ceiling_m
        reach_m = self._reach_m(east, north, lowest)
        part = _clipped(dsm, near, 8 + int(np.ceil(reach_m / dsm.cell_m)))
        return self._relief(dsm, part)

    def _reach_m(self, east: FloatArray, north: FloatArray, lowest: float) -> float:
        """Return how far in plan a ray from the lowest place of a window goes before it is above everything."""
        corner = np.array([(e, n) for e in (east[0], east[-1]) for n in (north[0], north[-1])])
        away = np.linalg.norm(self.position_map_m[:, None, :2] - corner, axis=2).max(axis=1)
        above = self.position_map_m[:, 2] - lowest
        share = np.where(above > 0.0, (self.ceiling_m - lowest) / np.maximum(above, 1e-6), 1.0)
        return float((away * np.clip(share, 0.0, 1.0)).max(initial=0.0))

    def _relief(self, dsm: MapGrid, part: Window) -> Relief:
        height = np.ascontiguousarray(self.surface.values[part.slices], dtype=np.float32)
        known = np.isfinite(height)
        low, high = np.where(known, height, np.float32(np.inf)), np.where(known, height, np.float32(-np.inf))
        with np.errstate(invalid="ignore"):
            step = maximum_filter(high, 5, mode="nearest") - minimum_filter(low, 5, mode="nearest")
        highest = maximum_filter(high, 5, mode="nearest")
        rows, columns = (-(-n // BLOCK_CELLS) for n in height.shape)
        padded = np.full((rows * BLOCK_CELLS, columns * BLOCK_CELLS), -np.inf, np.float32)
        padded[: height.shape[0], : height.shape[1]] = highest
        blocks = padded.reshape(rows, BLOCK_CELLS, columns, BLOCK_CELLS).max(axis=(1, 3))
        edge = step > EDGE_CELLS * dsm.cell_m
        return Relief(
            height, highest, np.ascontiguousarray(blocks), edge, part.row, part.column, dsm.west_map_m, dsm.north_map_m,
            dsm.cell_m, self.ceiling_m,
        )  # fmt: skip


def _clipped(grid: MapGrid, window: Window, margin: int) -> Window:
    """Return a window that may reach beyond the grid, widened by a margin, as far as the grid goes; one cell at
    least."""
    row, column = (
        int(np.clip(a - margin, 0, n - 1)) for a, n in ((window.row, grid.rows), (window.column, grid.columns))
    )
    row_end = int(np.clip(window.row_end + margin, row + 1, grid.rows))
    return Window(row, column, row_end, int(np.clip(window.column_end + margin, column + 1, grid.columns)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _known(relief: Relief, row: int, column: int) -> float:
    r, c = row - relief.row, column - relief.column
    if r < 0 or c < 0 or r >= relief.height.shape[0] or c >= relief.height.shape[1]:
        return np.nan
    return float(relief.height[r, c])


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def height_at(relief: Relief, east: float, north: float) -> float:
    """Return the height of a place of the map: bilinear between the centres of four cells where all are known, else
    that of the cell itself; NaN where it is not known."""
    x, y = (east - relief.west) / relief.cell, (relief.north - north) / relief.cell
    c, r = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    u, v = x - 0.5 - c, y - 0.5 - r
    upper = (1.0 - u) * _known(relief, r, c) + u * _known(relief, r, c + 1)
    lower = (1.0 - u) * _known(relief, r + 1, c) + u * _known(relief, r + 1, c + 1)
    height = (1.0 - v) * upper + v * lower
    if np.isnan(height):
        return float(_known(relief, int(np.floor(y)), int(np.floor(x))))
    return float(height)


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def at_edge(relief: Relief, east: float, north: float) -> bool:
    """Return whether a place of the map is near a height edge."""
    r = int(np.floor((relief.north - north) / relief.cell)) - relief.row
    c = int(np.floor((east - relief.west) / relief.cell)) - relief.column
    if r < 0 or c < 0 or r >= relief.height.shape[0] or c >= relief.height.shape[1]:
        return False
    return bool(relief.edge[r, c])


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def is_hidden(relief: Relief, place: tuple[float, float, float], centre: FloatArray, mercy: int) -> bool:
    """Return whether the surface hides a place of the map from a projection centre (3,) in the map.

    What stands in the way has a rim of two cells, so that nothing of a roof whose edge is not where the DSM has it is
    taken for the ground behind; ``mercy`` is STRICT for that, NARROW to do without the rim.
    """
    east, north, height = place
    surface = relief.height if mercy == NARROW else relief.highest
    dx, dy = (centre[0] - east) / relief.cell, (north - centre[1]) / relief.cell
    length = np.sqrt(dx * dx + dy * dy)
    if length <= START_CELLS:
        return False
    dx, dy, rise = dx / length, dy / length, (centre[2] - height) / length
    x, y = (east - relief.west) / relief.cell, (relief.north - north) / relief.cell
    raised = height + TOLERANCE_CELLS * relief.cell
    k = 0
    while True:
        s = START_CELLS + k * STEP_CELLS
        ray = raised + s * rise
        if s >= length or ray > relief.ceiling:
            return False
        c, r = int(np.floor(x + s * dx)) - relief.column, int(np.floor(y + s * dy)) - relief.row
        if r < 0 or c < 0 or r >= relief.height.shape[0] or c >= relief.height.shape[1]:
            return False
        if surface[r, c] > ray:
            return True
        k += 1
        if rise > 0.0 and ray >= relief.blocks[r // BLOCK_CELLS, c // BLOCK_CELLS]:
            k = max(k, int(np.floor((_way_out(relief, r, c, x, y, dx, dy) - START_CELLS) / STEP_CELLS)))


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _way_out(relief: Relief, r: int, c: int, x: float, y: float, dx: float, dy: float) -> float:
    """Return how far from (x, y), in cells, a ray leaves the block of a cell of the relief."""
    out = np.inf
    if dx > 0.0:
        out = min(out, ((c // BLOCK_CELLS + 1) * BLOCK_CELLS + relief.column - x) / dx)
    elif dx < 0.0:
        out = min(out, (c // BLOCK_CELLS * BLOCK_CELLS + relief.column - x) / dx)
    if dy > 0.0:
        out = min(out, ((r // BLOCK_CELLS + 1) * BLOCK_CELLS + relief.row - y) / dy)
    elif dy < 0.0:
        out = min(out, (r // BLOCK_CELLS * BLOCK_CELLS + relief.row - y) / dy)
    return out
