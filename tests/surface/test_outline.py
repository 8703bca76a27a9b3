"""The rim of an orthophoto and the polygons of its seams."""

import numpy as np
import pytest
import shapely

from photogram.grid import MapGrid, Window
from photogram.surface.ortho.outline import cells_inside, rim_of, seam_polygons, sides_of, views_in_blocks

BLOCKS = MapGrid(5000.0, 7000.0, 0.5, 90, 120)
ROW, COLUMN = np.mgrid[0:90, 0:120]


def test_the_rim_leaves_out_spikes_and_closes_small_holes() -> None:
    looks = np.where((np.abs(ROW - 45) < 30) & (np.abs(COLUMN - 60) < 40), 5, 1).astype(np.uint8)
    looks[44:46, :] = 2  # a spike to the border
    looks[40:43, 50:53] = 1  # a small hole, one photograph shows it
    rim = rim_of(looks, np.ones(looks.shape, bool), BLOCKS)
    assert rim is not None
    inside = cells_inside(sides_of(rim), BLOCKS, BLOCKS.whole)
    assert not inside[44:46, :10].any()
    assert inside[40:43, 50:53].all()
    assert np.mean(inside[looks == 5]) > 0.97
    assert len(shapely.get_coordinates(rim)) < 100


def test_nothing_that_no_photograph_shows_lies_within_the_rim() -> None:
    shown = (ROW - 45) ** 2 + (COLUMN - 60) ** 2 < 35**2
    shown &= ~((ROW - 45) ** 2 + (COLUMN - 60) ** 2 < 12**2)
    looks = np.where(shown, 3, 0).astype(np.uint8)
    rim = rim_of(looks, shown, BLOCKS)
    inside = cells_inside(sides_of(rim), BLOCKS, BLOCKS.whole)
    assert not np.any(inside & ~shown)
    assert np.count_nonzero(inside) > 0.85 * np.count_nonzero(shown)
    assert rim_of(looks, np.zeros_like(shown), BLOCKS) is None


def test_where_one_photograph_is_all_there_is_its_own_rim_is_the_rim() -> None:
    shown = (ROW > 10) & (COLUMN > 20)
    rim = rim_of(shown.astype(np.uint8), shown, BLOCKS)
    assert rim is not None
    assert rim.area == pytest.approx(np.count_nonzero(shown) * 0.25, rel=0.05)


def test_cells_inside_do_not_depend_on_the_window() -> None:
    rng = np.random.default_rng(2)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 40))
    radius = rng.uniform(8.0, 20.0, 40)
    polygon = shapely.Polygon(np.column_stack([5030 + radius * np.cos(angle), 6978 + radius * np.sin(angle)]))
    polygon = polygon.difference(shapely.Point(5030, 6978).buffer(3.0))
    sides = sides_of(polygon)
    whole = cells_inside(sides, BLOCKS, BLOCKS.whole)
    east, north = BLOCKS.centres_map_m(BLOCKS.whole)
    assert np.array_equal(whole, shapely.contains_xy(polygon, *np.meshgrid(east, north)))
    windows = (Window(0, 0, 31, 47), Window(31, 13, 90, 120), Window(50, 50, 51, 51))
    empty = (Window(40, 50, 40, 60), Window(40, 50, 45, 50))  # of a tile narrower than a cell of the surface
    for window in (*windows, *empty):
        assert np.array_equal(cells_inside(sides, BLOCKS, window), whole[window.slices])


def test_seams_come_back_as_they_went() -> None:
    """What is read from the polygons differs from the blocks by the corners that were simplified away."""
    label = (COLUMN // 40 + 3 * ((ROW + COLUMN // 3) // 50)).astype(np.int32)
    label[20:30, 50:70] = 7
    rim = shapely.box(5000.0, 6955.0, 5060.0, 7000.0)
    seams = seam_polygons(label, BLOCKS, rim)
    again = views_in_blocks(seams, BLOCKS)
    assert np.mean(again == label) > 0.97
    assert sum(seam.polygon.area for seam in seams) == pytest.approx(rim.area)
    for i, seam in enumerate(seams):
        for other in seams[i + 1 :]:
            assert seam.polygon.intersection(other.polygon).area < 1e-6
    assert len(shapely.get_coordinates([seam.polygon for seam in seams])) < 200


def test_outside_of_all_polygons_no_photograph_is_asked_for() -> None:
    found = views_in_blocks(
        seam_polygons(np.full((90, 120), 4, np.int32), BLOCKS, shapely.box(5010, 6970, 5020, 6980)), BLOCKS
    )
    assert set(np.unique(found).tolist()) == {-1, 4}
    assert np.count_nonzero(found == 4) == 400


def test_rows_of_blocks_leave_no_gap_wherever_they_lie() -> None:
    """Sides of blocks that are not whole numbers round otherwise in every row."""
    blocks = MapGrid(602268.72, 5794179.24, 0.96, 122, 147)
    looks = np.full((blocks.rows, blocks.columns), 3, np.uint8)
    rim = rim_of(looks, looks > 0, blocks)
    assert rim is not None
    assert len(shapely.get_parts(rim)) == 1
    assert cells_inside(sides_of(rim), blocks, blocks.whole)[2:-2, 2:-2].all()
