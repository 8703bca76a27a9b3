"""Semi-global regularisation against a slow second implementation, straight from the formula, and on made volumes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import Float32Array, FloatArray
from photogram.surface.dense.semi_global import CostVolume, regularised

PATHS = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]


def volume_of(costs: list[list[list[int]]], first: list[list[int]], guide: FloatArray | Float32Array) -> CostVolume:
    """Return the volume of costs[row][column][hypothesis]."""
    cells = [cell for row in costs for cell in row]
    start = np.concatenate([[0], np.cumsum([len(cell) for cell in cells])]).astype(np.int64)
    cost = np.array([c for cell in cells for c in cell], dtype=np.uint8)
    return CostVolume(cost, start, np.array(first, dtype=np.int32).ravel(), guide.astype(np.float32))


def summed_by_formula(volume: CostVolume, small: float, large: float, contrast: float) -> list[dict[int, int]]:
    """Return the sums over all paths, hypothesis by hypothesis, of every cell: Hirschmüller (2008), eq. 12 to 14."""
    rows, columns = volume.shape
    own = [
        {int(volume.first[n]) + k: int(c) for k, c in enumerate(volume.cost[volume.start[n] : volume.start[n + 1]])}
        for n in range(rows * columns)
    ]
    total = [dict.fromkeys(cell, 0) for cell in own]
    for dr, dc in PATHS:
        along: dict[tuple[int, int], dict[int, int]] = {}
        for row in range(rows)[:: -1 if dr < 0 else 1]:
            for column in range(columns)[:: -1 if dc < 0 else 1]:
                cell, before = own[row * columns + column], along.get((row - dr, column - dc), {})
                along[row, column] = dict(cell)
                if before:
                    change = abs(float(volume.guide[row, column] - volume.guide[row - dr, column - dc]))
                    jump = min(before.values()) + int(max(large / (1.0 + change / contrast), small + 1.0))
                    for d, c in cell.items():
                        near = [before[e] + int(small) for e in (d - 1, d + 1) if e in before]
                        same = [before[d]] if d in before else []
                        along[row, column][d] = c + min([*same, *near, jump]) - min(before.values())
                for d, c in along[row, column].items():
                    total[row * columns + column][d] += c
    return total


@st.composite
def ragged_volumes(draw: st.DrawFn) -> CostVolume:
    rows, columns = draw(st.integers(1, 5)), draw(st.integers(1, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    most = draw(st.integers(0, 6))
    costs = [[rng.integers(0, 255, rng.integers(0, most + 1)).tolist() for _ in range(columns)] for _ in range(rows)]
    first = rng.integers(-3, 4, (rows, columns)).tolist()
    return volume_of(costs, first, rng.integers(0, 256, (rows, columns)).astype(np.float32) / np.float32(3.0))


@settings(max_examples=150)
@given(ragged_volumes(), st.floats(0.0, 40.0), st.floats(0.5, 200.0), st.floats(0.5, 60.0))
def test_the_recursion_is_that_of_the_formula(volume: CostVolume, small: float, more: float, contrast: float) -> None:
    rows, columns = volume.shape
    total = summed_by_formula(volume, small, small + more, contrast)
    best, own = regularised(volume, small, small + more, contrast)
    for n, (cell, found, cost) in enumerate(zip(total, best.ravel(), own.ravel(), strict=True)):
        if not cell:
            assert np.isnan(found)
            assert np.isnan(cost)
            continue
        d = min(cell, key=lambda d: (cell[d], d))
        fraction = 0.0
        if d - 1 in cell and d + 1 in cell:
            left, right = cell[d - 1], cell[d + 1]
            fraction = 0.5 * (left - right) / (left - 2 * cell[d] + right) if left + right > 2 * cell[d] else 0.0
        assert found == np.float32(d + fraction)
        assert cost == volume.cost[volume.start[n] + d - volume.first[n]]
    assert best.shape == own.shape == (rows, columns)


def test_without_penalties_every_cell_takes_its_cheapest_hypothesis() -> None:
    rng = np.random.default_rng(4)
    costs = [[(2 * rng.permutation(9)).tolist() for _ in range(23)] for _ in range(17)]
    best, own = regularised(volume_of(costs, [[5] * 23] * 17, np.zeros((17, 23))), 0.0, 0.0, 1.0)
    assert np.array_equal(np.rint(best), 5 + np.array(costs).argmin(axis=2))
    assert np.all(own == 0)


def sloping_costs(noise: float) -> tuple[FloatArray, FloatArray]:
    """Return a plane, in hypotheses, and costs (rows, columns, 24) that are lowest there but for their noise."""
    row, column = np.mgrid[:60, :70]
    plane = 4.0 + 0.11 * column + 0.13 * row
    away = np.abs(np.arange(24) - plane[..., None])
    costs = 60 + 50 * np.minimum(away, 2.0) + noise * np.random.default_rng(1).standard_normal(away.shape)
    return plane, np.clip(costs, 0, 254)


@pytest.mark.parametrize("noise", [0.0, 35.0])
def test_a_plane_is_found_in_noise(noise: float) -> None:
    plane, costs = sloping_costs(noise)
    volume = volume_of(costs.astype(int).tolist(), [[0] * 70] * 60, np.zeros((60, 70)))
    best, _ = regularised(volume, 15.0, 80.0, 30.0)
    alone = np.abs(costs.argmin(axis=2) - plane) <= 1
    together = np.abs(best - plane) <= 1
    assert together.mean() > 0.97
    assert alone.mean() < 0.8 or noise == 0


@pytest.mark.parametrize("edge", [11, 14, 17])
def test_a_jump_lies_where_the_guide_changes(edge: int) -> None:
    """Between two heights that the pictures tell, ten columns tell nothing: the grey values decide."""
    costs = np.full((12, 30, 10), 100)
    costs[:, :10, 2] = costs[:, 20:, 8] = 0
    guide = np.where(np.arange(30) < edge, 40.0, 200.0) * np.ones((12, 1))
    best, _ = regularised(volume_of(costs.tolist(), [[0] * 30] * 12, guide), 20.0, 90.0, 20.0)
    assert np.all(np.rint(best[:, :edge]) == 2)
    assert np.all(np.rint(best[:, edge:]) == 8)


def test_cells_without_hypotheses_are_holes_and_end_a_path() -> None:
    costs = np.full((5, 9, 4), 90)
    costs[:, :4, 1], costs[:, 5:, 3] = 0, 30
    cells = costs.tolist()
    for row in cells:
        row[4] = []
    best, own = regularised(volume_of(cells, [[0] * 9] * 5, np.zeros((5, 9))), 5.0, 250.0, 30.0)
    assert np.isnan(best[:, 4]).all()
    assert np.isnan(own[:, 4]).all()
    assert np.all(np.rint(best[:, :4]) == 1)
    assert np.all(np.rint(best[:, 5:]) == 3)


def test_a_volume_without_any_hypothesis_is_all_holes() -> None:
    best, own = regularised(volume_of([[[], []]], [[0, 0]], np.zeros((1, 2))), 5.0, 50.0, 30.0)
    assert np.isnan(best).all()
    assert np.isnan(own).all()
