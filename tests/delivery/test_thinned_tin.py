"""Triangulations of known surfaces, held to every cell by scipy's interpolation."""

from pathlib import Path

import numpy as np
import pytest
from delivered import hill
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from photogram.delivery.thinned_tin import heights_of, interval_of, reduced_raster, thinned_tin
from photogram.errors import SurfaceError
from photogram.files.maps.rasters import write_raster
from photogram.grid import MapGrid
from photogram.survey import Raster


def cells(raster: Raster) -> np.ndarray:
    """Easting, northing and height (N, 3) of the cells that have one."""
    row, column = np.nonzero(np.isfinite(raster.values))
    east, north = raster.west_map_m + (column + 0.5) * raster.cell_m, raster.north_map_m - (row + 0.5) * raster.cell_m
    return np.column_stack([east, north, raster.values[row, column].astype(np.float64)])


@pytest.mark.parametrize("error_m", [0.5, 0.1, 0.02])
def test_no_cell_is_farther_off_than_asked_for(error_m: float) -> None:
    raster = hill()
    tin, own = thinned_tin(raster, error_m), cells(raster)
    assert tin.greatest_m <= error_m + 1e-4
    assert tin.cells == len(own)
    assert tin.covered > 0.995 * tin.cells
    middle = own[:, :2].mean(axis=0)
    # another Delaunay triangulation of the same vertices, and of the cells that both cover
    again = Delaunay(tin.vertex_map_m[:, :2] - middle)
    heights = LinearNDInterpolator(again, tin.vertex_map_m[:, 2])(own[:, :2] - middle)
    off = np.abs(heights - own[:, 2])
    assert np.nanpercentile(off, 99.5) <= error_m + 1e-4
    assert np.sqrt(np.nanmean(off**2)) == pytest.approx(tin.rms_m, rel=0.1)


def test_vertices_are_cells_and_triangles_are_disjoint_and_counter_clockwise() -> None:
    raster = hill()
    tin = thinned_tin(raster, 0.05)
    known = {tuple(np.round(place, 6)) for place in cells(raster)}
    assert {tuple(np.round(place, 6)) for place in tin.vertex_map_m} <= known
    a, b, c = (tin.vertex_map_m[tin.triangle[:, i], :2] for i in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(tin.cells * raster.cell_m**2, rel=0.02)
    assert set(np.unique(tin.triangle)) == set(range(len(tin.vertex_map_m)))


def test_cells_that_are_fixed_are_vertices_and_heights_are_those_of_the_triangles() -> None:
    raster = hill()
    fixed = np.zeros(raster.values.shape, dtype=bool)
    fixed[::7, 100] = fixed[:30, 10] = True  # the latter without heights, but for ten
    tin = thinned_tin(raster, 0.5, fixed=fixed)
    held = {tuple(np.round(place, 6)) for place in tin.vertex_map_m}
    known = fixed & np.isfinite(raster.values)
    wanted = {tuple(np.round(place, 6)) for place in cells(raster)[known[np.isfinite(raster.values)]]}
    assert len(wanted) == np.count_nonzero(known) < np.count_nonzero(fixed)
    assert wanted <= held
    off = np.abs(heights_of(tin, MapGrid.of(raster)) - raster.values)
    assert np.count_nonzero(np.isfinite(off)) == tin.covered
    assert np.nanmax(off) == pytest.approx(tin.greatest_m, abs=1e-4)
    twice = MapGrid(
        raster.west_map_m + raster.cell_m / 4, raster.north_map_m - raster.cell_m / 4, raster.cell_m / 2, 399, 479
    )
    fine = heights_of(tin, twice)
    np.testing.assert_allclose(fine[::2, ::2], heights_of(tin, MapGrid.of(raster)), atol=1e-3)


def test_holes_stay_holes() -> None:
    values = np.full((120, 160), 10.0, np.float32)
    values[40:80, 50:110] = np.nan
    tin = thinned_tin(Raster(values, 1000.0, 2000.0, 1.0), 0.01)
    centre = tin.vertex_map_m[tin.triangle, :2].mean(axis=1) - [1000.0, 2000.0]
    inside = (centre[:, 0] > 52) & (centre[:, 0] < 108) & (centre[:, 1] < -42) & (centre[:, 1] > -78)
    assert not inside.any()
    a, b, c = (tin.vertex_map_m[tin.triangle[:, i], :2] for i in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert area.sum() == pytest.approx(119 * 159 - 41 * 61, rel=0.01)
    assert tin.covered > 0.99 * tin.cells


def test_the_number_of_vertices_is_bounded_and_the_error_told() -> None:
    noise = np.random.default_rng(1).normal(0.0, 1.0, (60, 60)).astype(np.float32)
    tin = thinned_tin(Raster(noise, 0.0, 0.0, 1.0), 0.01, most=500)
    assert len(tin.vertex_map_m) <= 500
    assert tin.greatest_m > 1.0


def test_a_plane_needs_its_corners_and_a_line_is_none() -> None:
    y, x = np.mgrid[0:40, 0:40].astype(np.float32)
    tin = thinned_tin(Raster(0.5 * x - 0.25 * y, 0.0, 0.0, 1.0), 0.001)
    assert len(tin.vertex_map_m) == 4
    line = np.full((9, 9), np.nan, np.float32)
    line[4] = 1.0
    for values in (line, np.full((9, 9), np.nan, np.float32)):
        with pytest.raises(SurfaceError, match="three cells that do not lie on one line"):
            thinned_tin(Raster(values, 0.0, 0.0, 1.0), 0.01)


def test_a_large_raster_is_averaged_strip_by_strip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raster = hill()
    write_raster(tmp_path / "dsm.tif", raster, "EPSG:25832")
    np.testing.assert_array_equal(reduced_raster(tmp_path / "dsm.tif").values, raster.values)
    monkeypatch.setattr("photogram.delivery.thinned_tin._STRIP_CELLS", 3000)
    fewer = reduced_raster(tmp_path / "dsm.tif", most=12_000)
    assert (fewer.values.shape, fewer.cell_m) == ((100, 120), 0.5)
    mean = raster.values.reshape(100, 2, 120, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(fewer.values, mean, atol=1e-4)
    assert interval_of(raster) == 1.0
