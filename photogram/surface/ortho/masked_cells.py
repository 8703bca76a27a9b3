"""Which cells of a surface a photograph shows in pixels that its mask leaves out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from photogram.compilation import njit
from photogram.geodesy.frames import LocalFrame
from photogram.grid import vertical_nodes
from photogram.projection import FOCAL, OrientedCameras, seen_called
from photogram.sfm.tie_points.masked import clear_px
from photogram.surface.ortho.visibility import SurfaceModel, place_between
from photogram.surface.views import Views

RESAMPLED_PX = 2.0
"""How far from a place the pixels lie that its colour is interpolated from."""

_FARTHEST_PX = 255


@dataclass(frozen=True, eq=False)
class Masks:
    """The masks of views: which of them (V,) have one, and what gives it, (H, W) of the pixels that are used."""

    masked: BoolArray
    of: Callable[[int], BoolArray | None]

    def cells(self, views: Views, frame: LocalFrame, terrain: SurfaceModel, view: int) -> BoolArray | None:
        """Return which cells of the box that a view shows of a terrain are masked in it, None without a mask: those
        whose colour any pixel that is left out would have a part in."""
        used, box = self.of(view) if self.masked[view] else None, terrain.boxes[view]
        if used is None or box is None:
            return None
        clear = np.minimum(clear_px(used), _FARTHEST_PX).astype(np.uint8)
        out = np.zeros(box.shape, np.bool_)
        lines = (float(frame.origin_map_m[2]), vertical_nodes(frame, terrain.grid, box))
        _masked_cells(
            terrain.heights(box), terrain.grid.cell_m, (box.row, box.column), lines, views.cameras, view, clear, out
        )
        return out


@njit(cache=True, nogil=True)
def _masked_cells(
    height: Float32Array,
    cell_m: float,
    first: tuple[int, int],
    lines: tuple[float, FloatArray],
    cameras: OrientedCameras,
    view: int,
    clear: ByteArray,
    out: BoolArray,
) -> None:
    """Fill which cells (R, C) a view shows nearer to what is left out than colours are taken from: ``clear`` (H, W) is
    how far away it begins."""
    base, nodes = lines
    focal, X = cameras.parameters[cameras.camera[view], FOCAL], np.empty(3)
    for i in range(height.shape[0]):
        for j in range(height.shape[1]):
            h = height[i, j]
            if np.isnan(h):
                continue
            place_between(nodes, first, first[0] + i, first[1] + j, h - base, X)
            u, v, depth = seen_called(cameras, view, X[0], X[1], X[2])
            if not (u >= -0.5 and v >= -0.5 and u <= clear.shape[1] - 0.5 and v <= clear.shape[0] - 0.5):
                continue
            column = min(max(int(np.rint(u)), 0), clear.shape[1] - 1)
            row = min(max(int(np.rint(v)), 0), clear.shape[0] - 1)
            out[i, j] = clear[row, column] <= RESAMPLED_PX + 0.71 * cell_m * focal / depth
