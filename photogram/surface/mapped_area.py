"""The area that a surface is asked for: polygons of the map, and the cells in them."""

from typing import Any

import numpy as np
import shapely

from photogram.arrays import BoolArray
from photogram.grid import MapGrid, Window

Geometry = Any  # of shapely, which has no types


def cells_within(area: Geometry | None, grid: MapGrid, window: Window) -> BoolArray:
    """Return which cells (rows, columns) of a window of a grid have their centre in an area of the map, all without
    one."""
    if area is None:
        return np.ones(window.shape, np.bool_)
    shapely.prepare(area)
    east, north = grid.centres_map_m(window)
    if not shapely.intersects(area, shapely.box(east[0], north[-1], east[-1], north[0])):
        return np.zeros(window.shape, np.bool_)
    return np.asarray(shapely.contains_xy(area, *np.meshgrid(east, north)), dtype=np.bool_)
