"""How well the pixels of an orthophoto are known in plan: from the heights that they are rectified on, the rays that
show them and the errors that photographs have in common.

What photographs and calibration do to the surface as a whole moves the picture with it: it has the plan part of that
error. An error δh of a height by itself moves what is shown there along the ray by t δh, t being how far the ray goes
sideways for a metre up (Kraus 2007, section 7.3). So σ² = ½ (Σ_EE + Σ_NN + |t|² σ_h²) per axis.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, Int32Array
from photogram.grid import MapGrid, Window
from photogram.surface.dsm import SharedError, shared_plan_variance
from photogram.surface.ortho.cell_choice import Chosen
from photogram.surface.ortho.visibility import VISIBLE, SurfaceModel

NOTHING, SHOWN, DOUBTFUL, HIDDEN_EVERYWHERE, MASKED_EVERYWHERE = 0, 1, 2, 3, 4
"""What a cell of the surface is in an orthophoto: beside it or without a height; shown; shown by a photograph from
which the surface hides it, or nearly; hidden from all photographs; shown by masked pixels alone."""


class RaysAt(NamedTuple):
    """The rays that show the middles of the cells of a ``window`` of the surface: ``sideways`` (2, rows, columns) how
    far east and north a ray goes for a metre up, NaN without one, and ``state`` (rows, columns)."""

    window: Window
    sideways: Float32Array
    state: ByteArray


def rays_at(
    terrain: SurfaceModel,
    grid: MapGrid,
    window: Window,
    wide: Window,
    chosen: Chosen,
    near: Window,
    seen: ByteArray,
    slot: Int32Array,
) -> RaysAt:
    """Return the rays at the cells of the surface whose middles lie in a window of the orthophoto's grid. ``chosen``
    are the photographs of the cells of ``wide``, a window around it, ``seen`` (N, rows, columns) what the cells of the
    surface in ``near`` are in the photographs that ``slot`` (V,) numbers."""
    east, north = terrain.grid.centres_map_m(near)
    column, row = (
        np.floor(away / grid.cell_m).astype(np.int64) for away in (east - grid.west_map_m, grid.north_map_m - north)
    )
    rows = np.flatnonzero((row >= window.row) & (row < window.row_end))
    columns = np.flatnonzero((column >= window.column) & (column < window.column_end))
    if not len(rows) or not len(columns):
        return RaysAt(Window(0, 0, 0, 0), np.zeros((2, 0, 0), np.float32), np.zeros((0, 0), np.uint8))
    cells = Window(
        near.row + int(rows[0]), near.column + int(columns[0]),
        near.row + int(rows[-1]) + 1, near.column + int(columns[-1]) + 1,
    )  # fmt: skip
    at = np.ix_(row[rows] - wide.row, column[columns] - wide.column)
    label, weight = chosen.label[at], chosen.weight[at]
    height = terrain.heights(cells)
    sideways = np.zeros((2, *cells.shape), np.float32)
    places = east[columns][None, :], north[rows][:, None]
    for k in range(label.shape[2]):
        position = terrain.position_map_m[np.maximum(label[..., k], 0)]
        share = np.where(label[..., k] >= 0, weight[..., k], 0.0) / (position[..., 2] - height)
        for axis in (0, 1):
            sideways[axis] += (share * (position[..., axis] - places[axis])).astype(np.float32)
    shown = label[..., 0] >= 0
    sideways[:, ~shown] = np.nan
    first = np.maximum(slot[np.maximum(label[..., 0], 0)], 0)
    seen_in_first = (
        np.take_along_axis(seen[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], first[None], axis=0)[0]
        if len(seen)
        else np.zeros(cells.shape, np.uint8)
    )
    state = np.where(shown, np.where(seen_in_first == VISIBLE, SHOWN, DOUBTFUL), NOTHING)
    state = np.where(chosen.hidden[at] & ~shown, HIDDEN_EVERYWHERE, state)
    state = np.where(chosen.masked[at] & ~shown, MASKED_EVERYWHERE, state)
    return RaysAt(cells, sideways, state.astype(np.uint8))


def plan_sigma_m(rays: RaysAt, height_sigma_m: Float32Array, shared: SharedError, grid: MapGrid) -> Float32Array:
    """Return the standard deviations (rows, columns), m, per axis, of what the middles of cells of a surface on a
    ``grid`` show, NaN where nothing is shown."""
    common: FloatArray = shared_plan_variance(shared, grid, rays.window)
    own = np.sum(np.square(rays.sideways), axis=0) * np.square(height_sigma_m)
    return np.asarray(np.sqrt(0.5 * (common + own)), np.float32)
