"""Tiles of a picture whose colours say where they are."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import Transformer
from rasterio.transform import from_origin

from photogram.errors import ProjectError
from photogram.files.maps.tile_pyramid import degree_grid, tiles_of

CRS, WEST, NORTH, CELL = "EPSG:32632", 576_641.0, 5_188_237.0, 0.05
ROWS, COLUMNS, HOLE = 300, 420, 60


def write_place_picture(path: Path) -> None:
    """Red grows to the east, green to the south; the north-west corner is transparent, and black there."""
    rgba = np.zeros((4, ROWS, COLUMNS), np.uint8)
    rgba[0] = np.rint(255.0 * (np.arange(COLUMNS) + 0.5) / COLUMNS)
    rgba[1] = np.rint(255.0 * (np.arange(ROWS) + 0.5) / ROWS)[:, None]
    rgba[2], rgba[3] = 90, 255
    rgba[:, :HOLE, :HOLE] = 0
    profile = {"driver": "GTiff", "width": COLUMNS, "height": ROWS, "count": 4, "dtype": "uint8", "photometric": "RGB"}
    with rasterio.open(
        path, "w", crs=CRS, transform=from_origin(WEST, NORTH, CELL, CELL), alpha="yes", **profile
    ) as to:
        to.write(rgba)


def test_every_pixel_lies_where_its_tile_says(tmp_path: Path) -> None:
    path = tmp_path / "orthophoto.tif"
    write_place_picture(path)
    grid = degree_grid(path, CRS, 64)
    to_map = Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    tiles = list(tiles_of(path, CRS, grid))
    assert [tile.level for tile in tiles].count(0) == 1
    assert {tile.level for tile in tiles} == set(range(grid.finest + 1))
    shown_m2 = list[float]()
    for tile in tiles:
        west, south, east, north = grid.bounds(tile.level, tile.column, tile.row)
        step = (np.arange(64) + 0.5) / 64
        x, y = to_map.transform(*np.meshgrid(west + step * (east - west), north - step * (north - south)))
        column, row = (x - WEST) / CELL, (NORTH - y) / CELL
        wide = 2.0 ** (grid.finest - tile.level)
        opaque = tile.rgba[..., 3] == 255
        inner = opaque & (np.minimum(column, COLUMNS - column) > 2 * wide) & (np.minimum(row, ROWS - row) > 2 * wide)
        inner &= (column > HOLE + 2 * wide) | (row > HOLE + 2 * wide)
        off_column = np.abs(tile.rgba[inner, 0] * (1.0 * COLUMNS) / 255.0 - column[inner])
        off_row = np.abs(tile.rgba[inner, 1] * (1.0 * ROWS) / 255.0 - row[inner])
        assert max(off_column.max(initial=0.0), off_row.max(initial=0.0)) < 1.0 + 0.75 * wide, "within its pixel"
        assert np.all(tile.rgba[..., 2][opaque] >= 89), "rims do not darken"
        if tile.level == grid.finest:
            shown_m2.append(np.count_nonzero(tile.rgba[..., 3] > 127) * CELL**2)
    assert sum(shown_m2) == pytest.approx((ROWS * COLUMNS - HOLE**2) * CELL**2, rel=0.02)


def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    path = tmp_path / "orthophoto.tif"
    path.write_bytes(b"II*\0damaged")
    with pytest.raises(ProjectError, match=r"orthophoto.tif: cannot be read .*: delete it and run again"):
        degree_grid(path, CRS, 64)
