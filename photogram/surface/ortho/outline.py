"""The rim of an orthophoto and the polygons of its seams, from the lattice of blocks; and blocks from polygons.

The rim encloses what at least ENOUGH photographs look at, without its spikes and notches. Every test of a place against
a polygon counts the sides that a line to the west crosses (even-odd rule): it depends on the place alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.grid import MapGrid, Window

ENOUGH = 2
"""Photographs that must look at a place within the rim."""

SMOOTH_BLOCKS, SMOOTH_SHARE = 4.0, 0.02
"""Radius that spikes and notches of the rim must have to stay: in blocks, and in the root of the rim's area."""

SIMPLE_BLOCKS = 0.5
"""How far, in blocks, the simplified rim may lie from the smooth one."""

SEAM_BLOCKS = 1.5
"""Root of the area, in blocks, that a corner of a seam must have to stay."""

LEAST_SHARE = 0.01
"""Share of the largest part that another part of the rim, or a hole in it, must have to stay."""

Geometry = Any  # of shapely, which has no types


@dataclass(frozen=True, eq=False)
class SeamPolygon:
    """What is taken from a photograph: its number, and a polygon in the map."""

    view: int
    polygon: Geometry


def rim_of(looks: ByteArray, shown: BoolArray, blocks: MapGrid) -> Geometry | None:
    """Return the rim, polygons in the map, of the blocks (R, C) at which ENOUGH photographs look, or one where nowhere
    more do, as far as anything is ``shown``; None where nothing is.

    Its notches are filled from what one photograph shows.
    """
    whole = shapely.union_all(_boxes(shown, blocks))
    enough = (looks >= min(ENOUGH, int(looks[shown].max(initial=0)))) & shown
    if not enough.any():
        return None
    smooth = shapely.union_all(_boxes(enough, blocks))
    radius = max(SMOOTH_BLOCKS * blocks.cell_m, SMOOTH_SHARE * float(np.sqrt(smooth.area)))
    smooth = smooth.buffer(-radius).buffer(2.0 * radius).buffer(-radius)
    smooth = shapely.intersection(smooth, whole.buffer(-0.5 * blocks.cell_m))
    smooth = smooth.simplify(SIMPLE_BLOCKS * blocks.cell_m)
    parts = _polygons(smooth)
    if not parts:
        return shapely.normalize(whole)
    least = LEAST_SHARE * max(p.area for p in parts)
    kept = [
        shapely.Polygon(p.exterior, [hole for hole in p.interiors if shapely.Polygon(hole).area >= least])
        for p in parts
        if p.area >= least
    ]
    return shapely.normalize(shapely.MultiPolygon(kept))


def seam_polygons(label: Int32Array, blocks: MapGrid, rim: Geometry) -> list[SeamPolygon]:
    """Return the polygons, within a rim, that are taken from each photograph: those of ``label`` (R, C), simplified so
    that neighbours keep their common side."""
    views, whole = [], []
    for view in np.unique(label[label >= 0]).tolist():
        joined = shapely.union_all(_boxes(label == view, blocks))
        for part in shapely.get_parts(joined).tolist():
            views.append(view)
            whole.append(part)
    simple = shapely.coverage_simplify(np.array(whole, dtype=object), SEAM_BLOCKS * blocks.cell_m)
    seams = []
    for view, polygon in zip(views, simple.tolist(), strict=True):
        inside = shapely.intersection(polygon, rim)
        seams += [SeamPolygon(view, shapely.normalize(part)) for part in _polygons(inside)]
    return seams


def polygons_of(geometry: Geometry) -> Geometry | None:
    """Return the polygons of a geometry as one, None where it has none: an intersection may have points and lines."""
    parts = _polygons(geometry)
    return shapely.normalize(shapely.MultiPolygon(parts)) if parts else None


def _polygons(geometry: Geometry) -> list[Geometry]:
    return [p for p in shapely.get_parts(geometry).tolist() if p.geom_type == "Polygon" and p.area > 0.0]


def views_in_blocks(seams: Sequence[SeamPolygon], blocks: MapGrid) -> Int32Array:
    """Return the view (R, C) of the polygon in which the centre of each block lies, −1 outside of all."""
    view = np.full((blocks.rows, blocks.columns), -1, np.int32)
    for seam in seams:
        view[cells_inside(sides_of(seam.polygon), blocks, blocks.whole)] = seam.view
    return view


def sides_of(polygons: Geometry) -> FloatArray:
    """Return the sides (N, 4) of polygons: easting and northing of one end, and of the other, the lower one first."""
    sides = [np.zeros((0, 4))]
    for ring in shapely.get_rings(shapely.get_parts(polygons)).tolist():
        xy = shapely.get_coordinates(ring)
        sides.append(np.hstack([xy[:-1], xy[1:]]))
    upward = np.concatenate(sides)
    down = upward[:, 1] > upward[:, 3]
    upward[down] = upward[down][:, [2, 3, 0, 1]]
    return np.ascontiguousarray(upward)


def cells_inside(sides: FloatArray, grid: MapGrid, window: Window) -> BoolArray:
    """Return the cells (rows, columns) of a window of a grid, which may have none, whose centres lie inside polygons
    with these sides."""
    out = np.zeros(window.shape, np.bool_)
    if not out.size:
        return out
    east, north = grid.centres_map_m(window)
    near = sides[(sides[:, 1] <= north[0]) & (sides[:, 3] > north[-1])]
    _fill_inside(near, east, north, out)
    return out


@njit(cache=True, nogil=True)
def _fill_inside(sides: FloatArray, east: FloatArray, north: FloatArray, out: BoolArray) -> None:
    for i in range(len(north)):
        for k in range(len(sides)):
            if not sides[k, 1] <= north[i] < sides[k, 3]:
                continue
            share = (north[i] - sides[k, 1]) / (sides[k, 3] - sides[k, 1])
            crossing = sides[k, 0] + share * (sides[k, 2] - sides[k, 0])
            first = np.searchsorted(east, crossing)
            for j in range(first, len(east)):
                out[i, j] = not out[i, j]


def _boxes(mask: BoolArray, blocks: MapGrid) -> NDArray[np.object_]:
    """Return rectangles in the map over the blocks of a mask (R, C), one for each run of them in a row."""
    padded = np.zeros((blocks.rows, blocks.columns + 2), np.int8)
    padded[:, 1:-1] = mask
    step = np.diff(padded, axis=1)
    row, first = np.nonzero(step == 1)
    _, last = np.nonzero(step == -1)
    # sums of other terms would differ in the last digit, and leave gaps between rows
    north = blocks.north_map_m - np.arange(len(mask) + 1) * blocks.cell_m
    east = blocks.west_map_m + np.arange(mask.shape[1] + 1) * blocks.cell_m
    return np.asarray(shapely.box(east[first], north[row + 1], east[last], north[row]))
