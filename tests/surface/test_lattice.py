"""What photographs show of a lattice of ground: places against the projection itself, samples against scipy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from photogram.surface.dense.lattice import (
    TERMS,
    CellWindow,
    fill_lattice,
    fill_part,
    fill_places,
    fill_plan,
    grey_of_cells,
    nodes_of,
    places_per_cell,
    sample_lattice,
    scratch_for_samples,
)
from photogram.surface.dense.resolution import choose_views
from photogram.surface.views import places_in_view

HALF = 3


@pytest.mark.parametrize(("spacing", "count"), [(1.0, 1), (0.84, 1), (0.8, 2), (0.51, 2), (0.42, 2), (0.35, 3)])
def test_places_lie_about_a_pixel_apart(spacing: float, count: int) -> None:
    assert places_per_cell(spacing) == count


def flat(lattice: NDArray[Any], per_cell: int, columns: int) -> NDArray[Any]:
    """Return a lattice by phases (per_cell², Y × columns + …) as it lies on the ground, row by row."""
    rows = lattice.shape[1] // columns
    phases = lattice[:, : rows * columns].reshape(per_cell, per_cell, rows, columns)
    return phases.transpose(2, 0, 3, 1).reshape(rows * per_cell, columns * per_cell)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.integers(1, 4))
def test_a_surface_is_bilinear_between_cells(seed: int, per_cell: int, half: int) -> None:
    rng = np.random.default_rng(seed)
    surface = rng.normal(size=rng.integers(1, 9, 2)).astype(np.float32)
    rows, columns = surface.shape
    box = CellWindow(rows // 3, columns // 2, rows - rows // 3, columns - columns // 2)
    more = 2 * half // per_cell
    width = box.columns + more
    out = np.full((per_cell**2, (box.rows + more) * width + more), np.nan, np.float32)
    fill_lattice(surface, box, per_cell, half, width, out)
    y, x = ((np.arange(n * per_cell) - half) / per_cell for n in (box.rows + more, width))
    place = np.meshgrid(box.row + y, box.column + x, indexing="ij")
    expected = map_coordinates(surface.astype(np.float64), place, order=1, mode="nearest")
    assert np.abs(flat(out, per_cell, width) - expected).max() < 1e-5


def test_a_part_of_a_lattice_is_that_of_its_cells() -> None:
    rng = np.random.default_rng(1)
    surface = rng.normal(size=(40, 40)).astype(np.float32)
    patch, box = CellWindow(16, 16, 16, 14), CellWindow(20, 17, 5, 9)
    whole, part, alone = (np.zeros((4, rows * columns), np.float32) for rows, columns in ((19, 17), (8, 12), (8, 12)))
    fill_lattice(surface, patch, 2, HALF, 17, whole)
    fill_part(whole, patch, 17, box, 12, part)
    fill_lattice(surface, box, 2, HALF, 12, alone)
    assert np.array_equal(part, alone)


def sampled(plane: Any, view: int, box: CellWindow, above_m: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what a view shows of the lattice of a box along the plane, and the places in the world."""
    ground, m = plane.ground(), plane.per_cell
    more = 2 * HALF // m
    width = box.columns + more
    size = (box.rows + more) * width + more
    surface = np.full((m * m, size), 0.0, np.float32)
    height = plane.height_m.astype(np.float32)
    fill_lattice(height, box, m, HALF, width, surface)
    nodes = nodes_of(box, HALF / m, float(height.min()), float(height.max()) + above_m)
    room = scratch_for_samples(size)
    fill_plan(nodes, box, width, room, size)
    places, out = np.empty((2, TERMS), np.float32), np.empty((m * m, size), np.float32)
    fill_places(plane.crops(), ground, nodes, view, places)
    sample_lattice(plane.crops(), view, places, nodes, HALF, m, surface, above_m, room, out)
    rows, columns = (np.arange(n * m) for n in (box.rows + more, width))
    south, east = np.meshgrid((rows - HALF) / m, (columns - HALF) / m, indexing="ij")
    h = flat(surface, m, width) + above_m
    foot = ground.foot[box.row, box.column]
    place = foot + south[..., None] * ground.south + east[..., None] * ground.east
    return flat(out, m, width), place + h[..., None] * ground.up[box.row, box.column]


@pytest.mark.parametrize("view", range(5))
@pytest.mark.parametrize(("box", "above_m"), [(CellWindow(16, 32, 16, 16), 0.0), (CellWindow(48, 48, 3, 16), 2.4)])
def test_samples_are_bilinear_where_the_projection_puts_them(
    photographed_plane: Any, view: int, box: CellWindow, above_m: float
) -> None:
    """Heights from 6 % of the flying height below to 6 % above; grey values are less one of them."""
    found, place = sampled(photographed_plane, view, box, above_m)
    pixel = places_in_view(photographed_plane.views, view, place.reshape(-1, 3))
    expected = map_coordinates(photographed_plane.pictures[view].astype(np.float64), pixel.T[::-1], order=1)
    difference = found.ravel() - expected
    assert np.ptp(difference) < 1.0  # a hundredth of a pixel
    assert np.abs(difference - np.median(difference)).mean() < 0.1


def test_what_a_photograph_does_not_show_is_not_a_number(photographed_plane: Any) -> None:
    views = photographed_plane.views
    position = views.position_world_m + np.array([13.0, 0.0, 0.0])
    moved = replace(photographed_plane, views=replace(views, cameras=views.cameras._replace(position=position)))
    found, place = sampled(moved, 2, CellWindow(32, 0, 16, 16), 0.0)
    pixel = places_in_view(moved.views, 2, place.reshape(-1, 3))
    inside = ((pixel >= 0.01) & (pixel < views.size_px[2] - 1.01)).all(axis=1)
    outside = ((pixel < -0.01) | (pixel > views.size_px[2] - 0.99)).any(axis=1)
    assert 0.1 < inside.mean() < 0.9
    assert np.isfinite(found.ravel()[inside]).all()
    assert np.isnan(found.ravel()[outside]).all()


def test_cells_have_the_grey_of_the_straightest_photograph(photographed_plane: Any) -> None:
    plane = photographed_plane
    ground, guide = plane.ground(), np.empty(plane.height_m.shape, np.float32)
    grey_of_cells(plane.crops(), ground, plane.height_m.astype(np.float32), guide)
    place = ground.foot + plane.height_m[..., None] * ground.up
    for row, column in ((0, 0), (13, 60), (79, 79)):
        view = ground.views[row // plane.patch, column // plane.patch, 0]
        pixel = places_in_view(plane.views, view, place[row, column][None])[0]
        expected = map_coordinates(plane.pictures[view].astype(np.float64), pixel[::-1, None], order=1)
        assert guide[row, column] == pytest.approx(expected[0], abs=0.02)


def test_views_are_the_straightest_that_show_a_place(photographed_plane: Any) -> None:
    views = photographed_plane.views
    rng = np.random.default_rng(2)
    places = np.column_stack([rng.uniform(-30.0, 30.0, (400, 2)), rng.uniform(-3.0, 3.0, 400)])
    chosen, tangent = choose_views(views, places, 3)
    seen = np.stack([places_in_view(views, v, places) for v in range(len(views))], axis=1)
    inside = ((seen >= 0) & (seen <= views.size_px - 1)).all(axis=-1)
    away = views.position_world_m - places[:, None]
    lean = np.where(inside, np.hypot(away[..., 0], away[..., 1]) / away[..., 2], np.inf)
    expected = np.where(np.isfinite(np.sort(lean, axis=1)), np.argsort(lean, axis=1), -1)[:, :3]
    assert np.array_equal(chosen, expected)
    assert np.allclose(tangent, np.sort(lean, axis=1)[:, :3])
    assert 0 < np.mean(inside) < 1
    below = replace(views, cameras=views.cameras._replace(position=-views.position_world_m))
    assert np.all(choose_views(below, places, 2)[0] == -1)
