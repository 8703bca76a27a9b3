"""Polygons over cells: areas against shapely's, and what an integral gains where a corner moves."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from photogram.grid import MapGrid, Window
from photogram.volumes.outlines import coverage, outline_samples, window_of, window_of_all

GRID = MapGrid(100.0, 260.0, 0.5, 80, 120)
RING = shapely.Point(130.0, 240.0).buffer(11.3) - shapely.Point(128.0, 238.0).buffer(4.1)


def test_every_share_is_that_of_the_intersection() -> None:
    share = coverage(RING, GRID, GRID.whole)
    for row, column in [(18, 40), (40, 60), (43, 55), (30, 82), (0, 0)]:
        west, north = 100.0 + 0.5 * column, 260.0 - 0.5 * row
        cell = shapely.box(west, north - 0.5, west + 0.5, north)
        assert share[row, column] == pytest.approx(cell.intersection(RING).area / 0.25, abs=1e-12)
    assert share.sum() * 0.25 == pytest.approx(RING.area, rel=1e-12)


@given(
    corners=st.lists(st.tuples(st.floats(90, 170), st.floats(215, 265)), min_size=3, max_size=8),
    row=st.integers(0, 79),
    column=st.integers(0, 119),
)
def test_windows_side_by_side_have_the_area_of_the_polygon_on_the_grid(
    corners: list[tuple[float, float]], row: int, column: int
) -> None:
    polygon = shapely.MultiPoint(corners).convex_hull
    if polygon.geom_type != "Polygon":
        return
    windows = [
        Window(*w)
        for w in ((0, 0, row, column), (0, column, row, 120), (row, 0, 80, column), (row, column, 80, 120))
        if w[0] < w[2] and w[1] < w[3]
    ]
    area = sum(coverage(polygon, GRID, w).sum() for w in windows) * 0.25
    whole = shapely.box(100.0, 220.0, 160.0, 260.0)
    assert area == pytest.approx(polygon.intersection(whole).area, abs=1e-6)


def test_a_polygon_beyond_the_grid_has_no_window() -> None:
    assert window_of(shapely.box(0, 0, 10, 10), GRID) is None
    assert window_of(shapely.box(101.2, 258.1, 102.1, 259.9), GRID) == Window(0, 2, 4, 5)


def test_several_polygons_have_one_window() -> None:
    near, far, beyond = (
        shapely.box(101.2, 258.1, 102.1, 259.9),
        shapely.box(110, 250, 112, 251),
        shapely.box(0, 0, 9, 9),
    )
    assert window_of_all([near, far, beyond], GRID) == Window(0, 2, 20, 24)
    assert window_of_all([near], GRID) == window_of(near, GRID)
    assert window_of_all([beyond], GRID) == GRID.whole


def test_slopes_are_those_of_the_area_where_the_integrand_is_one() -> None:
    polygon = shapely.Polygon([(110, 230), (140, 232), (135, 250), (112, 247)], [[(120, 236), (124, 237), (121, 241)]])
    samples = outline_samples(polygon, 0.3)
    slopes = samples.slopes(np.ones(len(samples.share)), np.arange(len(samples.share)))
    rings = [np.array(r.coords)[:-1] for r in (polygon.exterior, *polygon.interiors)]
    for ring_number, ring in enumerate(rings):
        for corner in range(len(ring)):
            for axis in (0, 1):
                moved = [r.copy() for r in rings]
                moved[ring_number][corner, axis] += 1e-3
                gain = (shapely.Polygon(moved[0], moved[1:]).area - polygon.area) / 1e-3
                assert np.min(np.abs(slopes[:, axis] - gain)) < 2e-3
    assert np.abs(slopes.sum(axis=0)).max() < 1e-9  # a polygon that moves as a whole keeps its area


def test_an_integral_over_a_plane_gains_by_a_corner_what_the_moved_polygon_has_more() -> None:
    corners = np.array([(110.0, 230.0), (140.0, 232.0), (135.0, 250.0), (112.0, 247.0)])

    def integral(ring: np.ndarray) -> float:
        polygon = shapely.Polygon(ring)
        at = polygon.centroid
        return float(polygon.area * (0.2 * (at.x - 100.0) + 0.1 * (at.y - 200.0)))

    samples = outline_samples(shapely.Polygon(corners), 0.05)
    values = 0.2 * (samples.place_map_m[:, 0] - 100.0) + 0.1 * (samples.place_map_m[:, 1] - 200.0)
    slopes = samples.slopes(values, np.arange(len(values)))
    gains = []
    for corner in range(4):
        for axis in (0, 1):
            moved = corners.copy()
            moved[corner, axis] += 1e-4
            gains.append((integral(moved) - integral(corners)) / 1e-4)
    np.testing.assert_allclose(np.sort(slopes.ravel()), np.sort(gains), rtol=2e-3, atol=1e-2)
