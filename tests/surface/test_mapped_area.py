"""Cells of an area of the map: those whose centre lies in its polygons."""

import numpy as np
import shapely

from photogram.grid import MapGrid, Window
from photogram.surface.mapped_area import cells_within

GRID = MapGrid(100.0, 200.0, 0.5, 40, 60)


def test_cells_of_a_triangle_are_those_whose_centre_lies_in_it() -> None:
    area = shapely.Polygon([(103.0, 183.0), (120.0, 183.0), (103.0, 197.0)])
    window = Window(3, 2, 38, 51)
    east, north = np.meshgrid(*GRID.centres_map_m(window))
    expected = (east > 103.0) & (north > 183.0) & ((east - 103.0) / 17.0 + (north - 183.0) / 14.0 < 1.0)
    inside = cells_within(area, GRID, window)
    assert inside.sum() > 400
    assert np.array_equal(inside, expected)


def test_all_cells_without_an_area_and_none_far_from_it() -> None:
    assert cells_within(None, GRID, GRID.whole).all()
    assert not cells_within(shapely.box(0.0, 0.0, 10.0, 10.0), GRID, GRID.whole).any()
