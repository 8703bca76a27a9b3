from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from photogram.errors import FrameError, PhotogramError, ProjectError, WorkspaceError
from photogram.files.maps.contour_files import LAYER, read_contours, write_contours
from photogram.geodesy.crs import product_crs
from photogram.geodesy.height_systems import DeclaredHeights, Geoid, HeightSystem
from photogram.surface import contours as module
from photogram.surface.contours import ContourSettings, contour_lines, interval_for
from photogram.survey import Contours, Raster

MAP = "EPSG:25832+5799"
WEST, NORTH, CELL = 602_300.0, 5_794_200.0, 0.5
EVERY = ContourSettings(minimum_length_m=0.0)


def centres(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    north, east = np.meshgrid(
        NORTH - (np.arange(rows) + 0.5) * CELL, WEST + (np.arange(columns) + 0.5) * CELL, indexing="ij"
    )
    return east, north


def cone(rows: int = 201, columns: int = 241) -> Raster:
    """Return a cone of slope 1:5 with its tip, 50 m, in the middle of the raster."""
    east, north = centres(rows, columns)
    away = np.hypot(east - WEST - columns * CELL / 2, north - NORTH + rows * CELL / 2)
    return Raster((50.0 - 0.2 * away).astype(np.float32), WEST, NORTH, CELL)


def line(contours: Contours, number: int) -> np.ndarray:
    return contours.vertex_map_m[contours.first[number] : contours.first[number + 1]]


def test_lines_of_a_cone_are_circles_of_their_height() -> None:
    found = contour_lines(cone(), ContourSettings(interval_m=1.0))
    middle = np.array([WEST + 241 * CELL / 2, NORTH - 201 * CELL / 2])
    assert set(found.height_m) >= set(range(41, 50))
    for number, height in enumerate(found.height_m):
        vertices = line(found, number)
        # a chord of a cell inside a circle of radius r is off by cell² / 8 r at most
        radius = 5.0 * (50.0 - height)
        assert np.abs(np.hypot(*(vertices - middle).T) - radius).max() < CELL**2 / (4 * radius) + 1e-3
        if radius < 50.0:
            np.testing.assert_array_equal(vertices[0], vertices[-1])
            assert shapely.LinearRing(vertices).is_ccw is False  # higher ground to the right
    np.testing.assert_array_equal(found.is_index, found.height_m % 5 == 0)


def test_lines_of_a_plane_are_where_they_belong_and_stop_at_holes() -> None:
    east, _ = centres(60, 80)
    values = (100.0 + 0.1 * (east - WEST)).astype(np.float32)
    values[20:30, 30:50] = np.nan
    found = contour_lines(Raster(values, WEST, NORTH, CELL), ContourSettings(interval_m=0.25, minimum_length_m=0.0))
    for number, height in enumerate(found.height_m):
        np.testing.assert_allclose(line(found, number)[:, 0], WEST + 10.0 * (height - 100.0), atol=1e-3)
    column, row = (found.vertex_map_m - [WEST, NORTH]).T / [[CELL], [-CELL]] - 0.5
    inside = (row > 19) & (row < 30) & (column > 29) & (column < 50)
    assert not inside.any()
    heights, lines = np.unique(found.height_m, return_counts=True)
    assert dict(zip(heights.tolist(), lines.tolist(), strict=True))[102.0] == 2  # cut in two by the hole
    assert dict(zip(heights.tolist(), lines.tolist(), strict=True))[103.5] == 1


@given(st.floats(1e-4, 1e5))
def test_interval_is_round_and_makes_about_twenty_lines(relief_m: float) -> None:
    interval = interval_for(relief_m)
    assert f"{interval:e}"[:8] in {"1.000000", "2.000000", "5.000000"}
    assert interval >= 0.01
    if relief_m > 0.2:
        assert 12 <= relief_m / interval <= 32


def test_default_interval_follows_the_relief() -> None:
    assert interval_for(12.0) == 0.5
    assert interval_for(90.0) == 5.0
    assert contour_lines(cone()).interval_m == interval_for(0.2 * 70)


def test_a_single_wild_height_does_not_stop_lines_that_nobody_spaced() -> None:
    heights = np.tile(np.linspace(20.0, 21.0, 60), (50, 1))
    heights[25, 30] = 9000.0
    lines = contour_lines(Raster(heights.astype(np.float32), WEST, NORTH, CELL))
    assert np.ptp(heights) / lines.interval_m < 2000


def test_short_lines_are_left_out() -> None:
    surface = cone()
    surface.values[5, 5] += 3.0  # one cell of noise
    kept, all_lines = contour_lines(surface), contour_lines(surface, EVERY)
    assert len(kept) < len(all_lines)
    lengths = [
        np.array([np.hypot(*np.diff(line(found, n), axis=0).T).sum() for n in range(len(found))])
        for found in (kept, all_lines)
    ]
    assert lengths[0].min() >= 8 * CELL
    np.testing.assert_allclose(lengths[0], lengths[1][lengths[1] >= 8 * CELL])


@pytest.mark.parametrize(("unknown", "cut"), [(0, False), (8, False), (9, True), (16, True)])
def test_a_block_counts_where_half_of_it_is_known(unknown: int, cut: bool) -> None:
    """Lines of a plane that rises to the east run from south to north; where a block is a hole they are in two."""
    values = np.tile(np.arange(64, dtype=np.float32), (40, 1))
    values[20:24, 28:32].flat[:unknown] = np.nan
    found = contour_lines(
        Raster(values, WEST, NORTH, CELL), ContourSettings(interval_m=1.0, cell_m=4 * CELL, minimum_length_m=0.0)
    )
    through = np.count_nonzero(found.height_m == 28.0)
    assert through == (2 if cut else 1)
    assert np.count_nonzero(found.height_m == 50.0) == 1


def test_large_rasters_are_averaged_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAXIMUM_CELLS", 201 * 241 // 4)
    found = contour_lines(cone(), ContourSettings(interval_m=1.0))
    assert found.cell_m == 3 * CELL
    fine = contour_lines(cone(), ContourSettings(interval_m=1.0, cell_m=3 * CELL))
    np.testing.assert_array_equal(found.vertex_map_m, fine.vertex_map_m)
    middle = np.array([WEST + 241 * CELL / 2, NORTH - 201 * CELL / 2])
    low = found.vertex_map_m[found.first[:-1]][found.height_m == 42.0]
    assert np.abs(np.hypot(*(low - middle).T) - 40.0).max() < 0.05


def test_what_cannot_be_traced_is_said() -> None:
    for factor in (10.0, 1e12):  # the second has more heights than memory holds
        steep = replace(cone(), values=np.float32(factor) * cone().values)
        with pytest.raises(PhotogramError, match=r"interval of 0\.01 m makes .* choose a larger one"):
            contour_lines(steep, ContourSettings(interval_m=0.01))
    with pytest.raises(PhotogramError, match="no cell of the surface has a height"):
        contour_lines(Raster(np.full((3, 3), np.nan, np.float32), WEST, NORTH, CELL))
    with pytest.raises(PhotogramError, match=r"interval_m: must be from 0\.01 to 1000 m, found 0"):
        ContourSettings(interval_m=0.0)
    assert len(contour_lines(Raster(np.full((9, 9), 7.5, np.float32), WEST, NORTH, CELL))) == 0


def test_lines_survive_the_geopackage(tmp_path: Path) -> None:
    found = contour_lines(cone(), ContourSettings(interval_m=1.0))
    path = tmp_path / "contours.gpkg"
    write_contours(path, found, MAP)
    first = path.read_bytes()
    write_contours(path, found, MAP)
    assert path.read_bytes() == first
    assert list(tmp_path.iterdir()) == [path]
    assert pyogrio.list_layers(path).tolist() == [[LAYER, "LineString Z"]]
    about = pyogrio.read_info(path, layer=LAYER)
    assert CRS(about["crs"]).to_epsg() == 25832
    assert "DVR90 height" in about["layer_metadata"]["DESCRIPTION"]
    _, _, geometry, (height, index) = pyogrio.raw.read(path, layer=LAYER, columns=["height_m", "index"])
    np.testing.assert_array_equal(height, found.height_m)
    np.testing.assert_array_equal(index, found.is_index)
    vertices, of_line = shapely.get_coordinates(shapely.from_wkb(geometry), include_z=True, return_index=True)
    np.testing.assert_array_equal(vertices[:, :2], found.vertex_map_m)
    np.testing.assert_array_equal(vertices[:, 2], found.height_m[of_line])
    np.testing.assert_array_equal(np.bincount(of_line), np.diff(found.first))


@pytest.mark.parametrize("crs", [MAP, "EPSG:2193", "EPSG:2263", "EPSG:2263+5703"])
def test_lines_are_read_back_in_metres(tmp_path: Path, crs: str) -> None:
    found = contour_lines(cone(), ContourSettings(interval_m=1.0))
    write_contours(tmp_path / "contours.gpkg", found, crs)
    back = read_contours(tmp_path / "contours.gpkg", crs, found.interval_m, found.cell_m)
    np.testing.assert_allclose(back.height_m, found.height_m, rtol=1e-12)
    np.testing.assert_allclose(back.vertex_map_m, found.vertex_map_m, rtol=1e-12)
    np.testing.assert_array_equal(back.first, found.first)
    np.testing.assert_array_equal(back.is_index, found.is_index)
    with pytest.raises(ProjectError, match="cannot be read"):
        read_contours(tmp_path / "other.gpkg", crs, found.interval_m, found.cell_m)


@pytest.mark.parametrize("system", [None, "ellipsoidal", "orthometric"])
def test_the_code_of_the_plan_stays_whatever_heights_count_from(tmp_path: Path, system: HeightSystem | None) -> None:
    geoid = Geoid("EPSG:5773") if system == "orthometric" else None
    crs = product_crs("EPSG:2193", DeclaredHeights(output=system, geoid=geoid))
    found = contour_lines(cone(), ContourSettings(interval_m=1.0))
    write_contours(tmp_path / "contours.gpkg", found, crs)
    about = pyogrio.read_info(tmp_path / "contours.gpkg", layer=LAYER)
    assert about["crs"] == "EPSG:2193"
    assert about["total_bounds"][0] < 1e6 < about["total_bounds"][1], "easting, northing, though the map names it last"


def test_no_lines_make_an_empty_layer_and_faults_leave_nothing(tmp_path: Path) -> None:
    flat = contour_lines(Raster(np.full((9, 9), 7.5, np.float32), WEST, NORTH, CELL))
    with pytest.raises(FrameError, match="not a projected CRS"):
        write_contours(tmp_path / "contours.gpkg", flat, "EPSG:4326")
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_contours(tmp_path / "nowhere" / "contours.gpkg", flat, MAP)
    assert list(tmp_path.iterdir()) == []
    write_contours(tmp_path / "contours.gpkg", flat, MAP)
    assert pyogrio.read_info(tmp_path / "contours.gpkg", layer=LAYER)["features"] == 0
