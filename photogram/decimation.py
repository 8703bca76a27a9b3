"""Rasters made small enough for a picture: means of blocks of cells, band by band.

What is drawn of fifty million cells is a picture of a thousand times a thousand; what is counted of them is counted
here too, in bands of rows, so that nothing but the rasters themselves has to be in memory.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from photogram.survey import FloatArray, Raster

BAND_CELLS = 2_000_000
"""About as many cells are worked on at once."""

BoolArray = NDArray[np.bool_]


def block_of(shape: tuple[int, ...], maximum: int) -> int:
    """Return how many cells a block has along each side, so that no side of a raster has more than ``maximum``."""
    return max(1, -(-max(shape) // maximum))


def bands(shape: tuple[int, ...], rows_at_once: int = 1) -> Iterator[slice]:
    """Yield slices of rows, each a multiple of ``rows_at_once`` but the last, of about BAND_CELLS cells."""
    rows, columns = shape
    step = max(1, BAND_CELLS // (columns * rows_at_once)) * rows_at_once
    for first in range(0, rows, step):
        yield slice(first, min(first + step, rows))


def block_means(
    values: NDArray[np.generic], block: int, keep: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the means (R, C) of ``block`` × ``block`` cells from the north-west corner, and which share (R, C) of each
    block's cells they are the mean of.

    Cells that are not finite, or not in ``keep``, do not count; a block without any is NaN. Blocks at the south and
    east are as large as there are cells.
    """
    rows, columns = values.shape
    shape = -(-rows // block), -(-columns // block)
    total, count = np.zeros(shape), np.zeros(shape)
    edges = np.arange(0, columns, block)
    for band in bands(values.shape, block):
        part = values[band].astype(np.float64)
        known = np.isfinite(part) if keep is None else np.isfinite(part) & keep[band]
        target = slice(band.start // block, -(-band.stop // block))
        for sums, cells in ((total, np.where(known, part, 0.0)), (count, known.astype(np.float64))):
            across = np.add.reduceat(cells, edges, axis=1)
            sums[target] = np.add.reduceat(across, np.arange(0, len(across), block), axis=0)
    heights, widths = (np.diff([*range(0, n, block), n]) for n in (rows, columns))
    size = heights[:, None] * widths
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan), count / size


def decimated(raster: Raster, maximum: int, keep: BoolArray | None = None) -> tuple[Raster, FloatArray]:
    """Return a raster of at most ``maximum`` cells along each side, means of blocks of a whole number of cells, and the
    share of each block that is known and in ``keep``.

    The corner stays where it was; blocks at the south and east may reach beyond the raster.
    """
    block = block_of(raster.values.shape, maximum)
    means, share = block_means(raster.values, block, keep)
    small = Raster(means.astype(np.float32), raster.west_map_m, raster.north_map_m, block * raster.cell_m)
    return small, share
