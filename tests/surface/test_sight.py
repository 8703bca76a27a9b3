"""Which photographs see cells: walls and faces against plain geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.grid import Verticals
from photogram.surface.dense.sight import GRAZING, hidden_cells

CELL_M, PATCH = 0.5, 8
EAST, SOUTH = np.array([CELL_M, 0.0, 0.0]), np.array([0.0, -CELL_M, 0.0])


def flat_lines(rows: int, columns: int) -> Verticals:
    """Return vertical lines over cells from the origin on to the east and south."""
    row, column = np.mgrid[:rows, :columns]
    foot = np.stack([CELL_M * column, -CELL_M * row, np.zeros(row.shape)], axis=-1)
    up = np.zeros_like(foot)
    up[..., 2] = 1.0
    return Verticals(0.0, foot, up)


def seen(
    position: FloatArray, surface: Float32Array, slope: Float32Array | None = None, told: BoolArray | None = None,
    tolerance_m: float = 0.1,
) -> tuple[BoolArray, Float32Array]:  # fmt: skip
    """Return what `hidden_cells` tells of all photographs at places (V, 3)."""
    rows, columns = surface.shape
    views = np.broadcast_to(np.arange(len(position)), (-(-rows // PATCH), -(-columns // PATCH), len(position))).copy()
    return hidden_cells(
        position, views, PATCH, flat_lines(rows, columns), (EAST, SOUTH), surface,
        np.zeros((rows, columns, 2), np.float32) if slope is None else slope,
        np.ones((rows, columns), bool) if told is None else told, tolerance_m,
    )  # fmt: skip


@settings(max_examples=40)
@given(st.floats(25.0, 75.0), st.floats(2.0, 9.0), st.integers(0, 3))
def test_a_wall_hides_the_ground_behind_it(elevation_deg: float, wall_m: float, side: int) -> None:
    """As far as its height over the tangent of the elevation; whichever way one looks, and nothing from above."""
    tangent, size, first = np.tan(np.radians(elevation_deg)), 60, 30
    surface = np.zeros((9, size), np.float32)
    surface[:, first : first + 4] = wall_m
    surface = np.rot90(surface, side).copy()
    away = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])[side]
    middle = CELL_M * np.array([(surface.shape[1] - 1) / 2, -(surface.shape[0] - 1) / 2])
    far = 1e5  # rays are parallel
    oblique = np.array([*(middle + far * away), far * tangent])
    hidden, _ = seen(np.array([oblique, [*middle, far]]), surface, tolerance_m=0.0)
    assert not hidden[..., 1].any()
    found = np.rot90(hidden[..., 0], -side)
    assert np.all(found == found[:1])
    behind = CELL_M * (first - np.arange(size))  # to the first cell of the wall
    expected = (behind > 0) & (behind * tangent < wall_m)
    sure = np.abs(behind * tangent - wall_m) > 0.02
    assert np.array_equal(found[0][sure], expected[sure])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_face_is_not_seen_from_behind(side: float) -> None:
    """One of 70° that rises to the east is seen from the west, from above, and from the east above 70° alone."""
    tangent, column = float(np.tan(np.radians(70.0))), np.arange(24)
    surface = np.tile(np.float32(side * tangent * CELL_M) * column.astype(np.float32), (8, 1))
    slope = np.zeros((8, 24, 2), np.float32)
    slope[..., 0] = side * tangent * CELL_M
    middle, far = np.array([CELL_M * 12, -CELL_M * 4]), 1e5
    elevations = np.radians([90.0, 60.0, 30.0, 60.0, 82.0])
    facing = side * np.array([0.0, -1.0, -1.0, 1.0, 1.0])
    position = np.column_stack(
        [middle[0] + far * facing * np.cos(elevations), np.full(5, middle[1]), far * np.sin(elevations)]
    )
    hidden, well = seen(position, surface, slope)
    assert not hidden[..., [0, 1, 2, 4]].any()
    assert hidden[..., 3].all()
    normal = np.array([-side * tangent, 0.0, 1.0]) / np.hypot(tangent, 1.0)
    ray = (position - [*middle, 0.0]) / np.linalg.norm(position - [*middle, 0.0], axis=1)[:, None]
    expected = np.where(ray @ normal > GRAZING, ray @ normal, 0.0) * PATCH * PATCH
    assert np.allclose(well, expected, rtol=2e-3)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_what_is_not_told_is_never_hidden_and_hides_nothing(seed: int) -> None:
    """And a view that a patch does not have hides nothing; what must stand higher to hide hides no more."""
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(3, 30)), int(rng.integers(3, 30))
    surface = (6.0 * rng.random(shape)).astype(np.float32)
    slope = rng.normal(size=(*shape, 2)).astype(np.float32)
    told = rng.random(shape) < 0.5
    position = np.array([[40.0, 10.0, 12.0], [-30.0, -5.0, 15.0], [5.0, -4.0, 60.0]])
    hidden, well = seen(position, surface, slope, told)
    assert not hidden[~told].any()
    assert hidden[told].any() or told.sum() < 20
    assert np.all(well >= 0.0)
    elsewhere = np.where(told, surface, 50.0 * rng.random(shape)).astype(np.float32)
    assert np.array_equal(seen(position, elsewhere, slope, told)[0], hidden)
    less, _ = seen(position, surface, slope, told, tolerance_m=2.0)
    assert np.all(hidden | ~less)
    views = np.full((-(-shape[0] // PATCH), -(-shape[1] // PATCH), 3), -1)
    views[..., 1] = 2
    of_one, well_of_one = hidden_cells(
        position, views, PATCH, flat_lines(*shape), (EAST, SOUTH), surface, slope, told, 0.1
    )
    assert np.array_equal(of_one[..., 1], hidden[..., 2])
    assert not of_one[..., [0, 2]].any()
    assert np.array_equal(well_of_one[..., 1], well[..., 2])
