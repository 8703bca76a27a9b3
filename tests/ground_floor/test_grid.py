from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.geodesy.frames import LocalFrame
from photogram.grid import LATTICE_CELLS, MapGrid, Window, known_cells_map_m, verticals
from photogram.survey import Raster

FRAME = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 120.0))
GRID = MapGrid(602300.0, 5794200.0, 0.25, 300, 517)


def exact(window: Window, height_map_m: float) -> np.ndarray:
    east, north = GRID.centres_map_m(window)
    place = np.stack([*np.meshgrid(east, north), np.full(window.shape, height_map_m)], axis=-1)
    return np.asarray(FRAME.world_from_map(place.reshape(-1, 3)).reshape(*window.shape, 3))


@pytest.mark.parametrize("height_m", [-20.0, 131.0, 900.0])
def test_heights_on_verticals_are_places_of_the_map(height_m: float) -> None:
    window = Window(37, 101, 290, 517)
    lines = verticals(FRAME, GRID, window)
    world = lines.foot_world_m + (height_m - lines.base_map_m) * lines.up
    assert np.abs(world - exact(window, height_m)).max() < 5e-6


def test_in_a_grid_world_verticals_are_exact() -> None:
    frame = replace(FRAME, kind="grid")
    lines = verticals(frame, GRID, GRID.whole)
    east, north = GRID.centres_map_m(GRID.whole)
    assert np.allclose(lines.up, [0, 0, 1], atol=1e-12)
    assert np.allclose(lines.foot_world_m[3, :, 0] - lines.foot_world_m[3, 0, 0], east - east[0], atol=1e-9)
    assert np.allclose(lines.foot_world_m[:, 3, 1] - lines.foot_world_m[0, 3, 1], north - north[0], atol=1e-9)


@given(st.integers(0, 200), st.integers(0, 400), st.integers(1, 99), st.integers(1, 99))
def test_a_cell_has_one_vertical_whatever_the_window(row: int, column: int, rows: int, columns: int) -> None:
    window = Window(row, column, min(row + rows, GRID.rows), min(column + columns, GRID.columns))
    whole, part = verticals(FRAME, GRID, GRID.whole), verticals(FRAME, GRID, window)
    assert np.array_equal(whole.foot_world_m[window.slices], part.foot_world_m)
    assert np.array_equal(whole.up[window.slices], part.up)


@pytest.mark.parametrize("side", [1, 7, LATTICE_CELLS, 1000])
def test_tiles_cover_every_cell_once(side: int) -> None:
    grid = replace(GRID, rows=20, columns=33)
    count = np.zeros((20, 33), int)
    for window in grid.tiles(side):
        count[window.slices] += 1
    assert np.all(count == 1)


def test_a_grid_around_points_lies_on_multiples_of_the_cell() -> None:
    grid = MapGrid.around(np.array([[10.3, 20.4, 5.0], [17.1, 28.9, 6.0]]), 0.5)
    assert (grid.west_map_m, grid.north_map_m, grid.rows, grid.columns) == (10.0, 29.0, 18, 15)
    assert MapGrid.of(Raster(np.zeros((18, 15), np.float32), 10.0, 29.0, 0.5)) == grid
    assert grid.around_window(Window(0, 3, 5, 15), 2) == Window(0, 1, 7, 15)


WINDOWS = st.builds(
    lambda row, column, rows, columns: Window(row, column, row + rows, column + columns),
    *[st.integers(-9, 9)] * 2,
    *[st.integers(1, 7)] * 2,
)


@given(WINDOWS, WINDOWS)
def test_windows_have_the_cells_in_common_that_lie_in_both(one: Window, other: Window) -> None:
    def cells(window: Window | None) -> set[tuple[int, int]]:
        if window is None:
            return set()
        return set(product(range(window.row, window.row_end), range(window.column, window.column_end)))

    assert cells(one.common(other)) == cells(one) & cells(other)
    assert one.around(2).common(one) == one


def test_places_lie_in_cells_and_known_cells_at_their_centres() -> None:
    grid = MapGrid(500.0, 900.0, 0.5, 3, 4)
    assert grid.extent_map_m == (500.0, 502.0, 898.5, 900.0)
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    values[1, 2] = np.nan
    cells = known_cells_map_m(grid.raster(values))
    row, column = grid.cells_at(cells)
    assert len(cells) == 11
    np.testing.assert_array_equal(values[row, column], cells[:, 2])
    beside = np.array([[499.9, 899.0], [502.1, 899.0], [501.0, 900.1], [501.0, 898.4], [np.nan, 899.0]])
    assert [np.unique(index).tolist() for index in grid.cells_at(beside)] == [[-1], [-1]]
