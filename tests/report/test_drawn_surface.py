"""The mesh of the surface for view.html against the raster that it was made of, and what the page holds of it."""

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from surface_files import (
    CELL_M,
    COLOUR,
    COLUMNS,
    DIFFERENCE,
    FILLED,
    HOUSE,
    ROWS,
    UNSEEN_COLUMNS,
    surface_on,
    write_surface,
)

from photogram.errors import ProjectError
from photogram.report.view.drawn_surface import INTERPOLATED, MEASURED, NOT_DRAWN, WALL, DrawnSurface, drawn_surface
from photogram.report.view.packing import UNKNOWN, pack_heights
from photogram.report.view.surface_scene import surface_scene

WEST, NORTH, BASE = 602_300.0, 5_794_160.0, 110.0
CRS = "EPSG:25832"


def mesh_of(folder: Path, monkeypatch: pytest.MonkeyPatch, every: int, *, sources: bool = True) -> DrawnSurface:
    monkeypatch.setattr("photogram.report.view.drawn_surface.MOST_CORNERS", -(-ROWS * COLUMNS // every**2))
    monkeypatch.setattr("photogram.report.view.drawn_surface._STRIP_CELLS", 7 * every * COLUMNS)
    heights, orthophoto, source = write_surface(folder, surface_on(WEST, NORTH, BASE), CRS)
    mesh = drawn_surface(heights, orthophoto, source if sources else None)
    assert mesh is not None
    assert mesh.every == every
    return mesh


@pytest.mark.parametrize("every", [1, 2, 4])
def test_corners_are_cells_of_the_raster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int) -> None:
    mesh, surface = mesh_of(tmp_path, monkeypatch, every), surface_on(WEST, NORTH, BASE)
    grid = mesh.corner_grid
    east, north = grid.centres_map_m(grid.whole)
    column, row = (east - WEST) / CELL_M - 0.5, (NORTH - north) / CELL_M - 0.5
    np.testing.assert_allclose(column, np.arange(0, COLUMNS, every), atol=1e-6)
    np.testing.assert_allclose(row, np.arange(0, ROWS, every), atol=1e-6)
    of_cells = surface.values[::every, ::every].copy()
    known = np.isfinite(mesh.height_m)
    np.testing.assert_array_equal(mesh.height_m[known], of_cells[known])
    shown = east < WEST + (COLUMNS - UNSEEN_COLUMNS) * CELL_M - every * CELL_M
    np.testing.assert_array_equal(known[:, shown], np.isfinite(of_cells)[:, shown])
    assert not known[:, east > WEST + (COLUMNS - UNSEEN_COLUMNS + every) * CELL_M].any()


@pytest.mark.parametrize("every", [1, 2, 4])
def test_squares_say_what_is_wall_and_what_is_not_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int
) -> None:
    mesh = mesh_of(tmp_path, monkeypatch, every)
    row, column = (np.arange(n) * every for n in mesh.kind.shape)
    inside = [
        ((first + every >= span.start) & (first < span.stop)) for first, span in zip((row, column), HOUSE, strict=True)
    ]
    within = [
        ((first >= span.start) & (first + every < span.stop)) for first, span in zip((row, column), HOUSE, strict=True)
    ]
    rim = np.outer(*inside) & ~np.outer(*within)
    np.testing.assert_array_equal(mesh.kind == WALL, rim)
    touched = (column + every >= FILLED[1].start) & (column < FILLED[1].stop)
    np.testing.assert_array_equal((mesh.kind == INTERPOLATED).any(axis=0), touched)
    assert (mesh.kind[:, touched] == INTERPOLATED).all()
    known = np.isfinite(mesh.height_m)
    corners = known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    np.testing.assert_array_equal(mesh.kind != NOT_DRAWN, corners)
    assert mesh_of(tmp_path, monkeypatch, every, sources=False).kind.max() == WALL


def test_the_stated_error_is_that_of_the_cells_between_corners(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second implementation: every cell by the plane through the three corners around it."""
    mesh, surface = mesh_of(tmp_path, monkeypatch, 4), surface_on(WEST, NORTH, BASE)
    off = []
    for row, column in np.argwhere(mesh.kind == MEASURED):
        nw, ne, sw, se = ([r, c, mesh.height_m[r, c]] for r in (row, row + 1) for c in (column, column + 1))
        for r in np.arange(4) / 4:
            for c in np.arange(4) / 4:
                corners = np.array([nw, ne, sw] if r + c <= 1 else [ne, sw, se], dtype=float)
                plane = np.linalg.solve(np.column_stack([corners[:, :2], np.ones(3)]), corners[:, 2])
                at = plane @ [row + r, column + c, 1.0]
                off.append(at - surface.values[round(4 * (row + r)), round(4 * (column + c))])
    assert mesh.rms_m == pytest.approx(np.sqrt(np.mean(np.square(off))), rel=1e-3)
    assert 0.002 < mesh.rms_m < 0.05
    assert mesh_of(tmp_path, monkeypatch, 1).rms_m < 1e-5


def test_the_picture_lies_over_the_corners_and_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of(tmp_path, monkeypatch, 2)
    picture = np.asarray(Image.open(io.BytesIO(mesh.jpeg)).convert("RGB"), dtype=int)
    width_m, height_m = mesh.picture_m
    assert width_m / picture.shape[1] == pytest.approx(height_m / picture.shape[0])
    assert width_m >= (mesh.corner_grid.columns - 1) * mesh.corner_grid.cell_m
    assert np.abs(picture - COLOUR).max() <= DIFFERENCE
    monkeypatch.setattr("photogram.report.view.drawn_surface.MOST_PIXELS", 40)
    smaller = mesh_of(tmp_path, monkeypatch, 2)
    assert max(Image.open(io.BytesIO(smaller.jpeg)).size) <= 40


def test_packed_heights_are_off_by_half_a_step_at_most(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of(tmp_path, monkeypatch, 1)
    scene, arrays = surface_scene(mesh)
    assert scene is not None
    assert scene["step_m"] == 0.001
    steps = np.frombuffer(base64.b64decode(arrays["heights"]), "<u2").reshape(mesh.height_m.shape)
    known = np.isfinite(mesh.height_m)
    assert (steps[~known] == UNKNOWN).all()
    assert np.abs(steps[known] * scene["step_m"] + scene["low_map_m"] - mesh.height_m[known]).max() <= 0.0005 + 1e-5
    squares = np.frombuffer(base64.b64decode(arrays["squares"]), "u1").reshape(mesh.kind.shape)
    np.testing.assert_array_equal(squares, mesh.kind)
    for range_m, step_m in ((60.0, 0.001), (100.0, 0.002), (1000.0, 0.02), (3000.0, 0.05)):
        packed, low_m, found = pack_heights(np.array([[-12.25, range_m - 12.25, np.nan]], dtype=np.float32))
        assert found == pytest.approx(step_m)
        np.testing.assert_allclose(packed[0, :2] * found + low_m, [-12.25, range_m - 12.25], atol=step_m / 2 + 1e-6)
        assert packed[0, 2] == UNKNOWN
    with pytest.raises(ValueError, match="no height is known"):
        pack_heights(np.full((2, 2), np.nan, dtype=np.float32))


def test_sources_of_another_surface_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    heights, orthophoto, _ = write_surface(tmp_path, surface_on(WEST, NORTH, BASE), CRS)
    _, _, other = write_surface(tmp_path / "other", surface_on(WEST + CELL_M, NORTH, BASE), CRS)
    with pytest.raises(ProjectError, match=r"dsm_source\.tif: its cells are not those of dsm_filled\.tif: run"):
        drawn_surface(heights, orthophoto, other)


def test_a_surface_that_the_orthophoto_does_not_show_is_none(tmp_path: Path) -> None:
    surface = surface_on(WEST, NORTH, BASE)
    surface.values[:, : COLUMNS - UNSEEN_COLUMNS] = np.nan
    heights, orthophoto, source = write_surface(tmp_path, surface, CRS)
    assert drawn_surface(heights, orthophoto, source) is None
    assert surface_scene(None) == (None, {})
