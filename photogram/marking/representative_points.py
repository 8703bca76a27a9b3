"""Some of a block's tie points, which hold its photographs together nearly as all of them do.

A block is adjusted anew for every mark that is made, and the pose of a photograph gains little from its hundredth tie
point where its tenth was well spread.
"""

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.survey import Block, TiePoints

CELLS = 5
"""Cells along each side of a photograph, of which each keeps the tie point with the most rays."""
FEWER_CELLS = 3
"""The same in blocks of more than MANY photographs."""
MANY = 200


def representative_points(block: Block) -> TiePoints:
    """Return the tie points that have the most rays in some cell of some photograph."""
    points = block.tie_points
    if not len(points):
        return points
    cells = CELLS if len(block.photographs) <= MANY else FEWER_CELLS
    rays = np.bincount(points.point, minlength=len(points))
    cell = _cells(block, points, cells)
    order = np.lexsort((points.point, -rays[points.point], cell))
    first = np.ones(len(order), dtype=bool)
    first[1:] = cell[order][1:] != cell[order][:-1]
    kept = np.zeros(len(points), dtype=bool)
    kept[points.point[order[first]]] = True
    return points.select(kept)


def _cells(block: Block, points: TiePoints, cells: int) -> IntArray:
    """Return a number (N,) for the photograph and the cell in it of each observation."""
    sizes: FloatArray = np.array([(c.width_px, c.height_px) for c in block.cameras], dtype=np.float64)
    share = (points.pixel + 0.5) / sizes[block.camera_of[points.photograph]]
    column, row = np.clip(np.floor(share * cells), 0, cells - 1).astype(np.int64).T
    return np.asarray((points.photograph * cells + row) * cells + column, dtype=np.int64)
