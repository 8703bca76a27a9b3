"""Tiles of a picture, which bound the memory of a detector, and the choice of key points that spread over it."""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.sfm.tie_points.detector import FeatureSettings


@dataclass(frozen=True)
class Tile:
    """A part of a picture: the rows and columns it answers for, and the pixels it sees, a margin more on every
    side."""

    top: int
    bottom: int
    left: int
    right: int
    v0: int
    u0: int
    grey: ByteArray

    def answers_for(self, place: FloatArray) -> BoolArray:
        """Return which places (N, 2) of the picture lie in the rows and columns."""
        u, v = place[:, 0], place[:, 1]
        return (u >= self.left - 0.5) & (u < self.right - 0.5) & (v >= self.top - 0.5) & (v < self.bottom - 0.5)


def _tile_edges(length_px: int, tile_px: int) -> IntArray:
    count = max(1, ceil(length_px / tile_px))
    return np.linspace(0, length_px, count + 1).round().astype(np.int64)


def picture_tiles(grey: ByteArray, settings: FeatureSettings) -> list[Tile]:
    """Return the tiles of a picture (H, W)."""
    rows, columns = _tile_edges(grey.shape[0], settings.tile_px), _tile_edges(grey.shape[1], settings.tile_px)
    margin = settings.overlap_px
    tiles = []
    for top, bottom in pairwise(rows.tolist()):
        for left, right in pairwise(columns.tolist()):
            v0, u0 = max(0, top - margin), max(0, left - margin)
            part = np.ascontiguousarray(grey[v0 : bottom + margin, u0 : right + margin])
            tiles.append(Tile(top, bottom, left, right, v0, u0, part))
    return tiles


def largest_tile_px(height_px: float, width_px: float, settings: FeatureSettings) -> float:
    """Return about how many pixels the largest tile of a picture sees."""
    sides = 1.0
    for side_px in (height_px, width_px):
        count = max(1, ceil(side_px / settings.tile_px))
        sides *= side_px / count + settings.overlap_px * min(count - 1, 2)
    return sides


def spread(
    place: FloatArray, angle_deg: FloatArray, strength: FloatArray, shape: tuple[int, int], settings: FeatureSettings
) -> IntArray:
    """Return which at most ``maximum`` of key points (N,) to take, the strongest of every cell of a picture of a
    ``shape`` first, by row, column and angle."""
    cells = settings.cells_per_side
    height_px, width_px = shape
    column = np.clip((place[:, 0] / width_px * cells).astype(np.int64), 0, cells - 1)
    row = np.clip((place[:, 1] / height_px * cells).astype(np.int64), 0, cells - 1)
    cell = row * cells + column
    order = np.lexsort((angle_deg, place[:, 0], place[:, 1], -strength, cell))
    starts = np.searchsorted(cell[order], np.arange(cells * cells))
    rank = np.arange(len(order)) - starts[cell[order]]
    chosen = order[np.lexsort((order, -strength[order], rank))[: settings.maximum]]
    return np.asarray(chosen[np.lexsort((angle_deg[chosen], place[chosen, 0], place[chosen, 1]))])
