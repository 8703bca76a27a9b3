"""Labels of a lattice of blocks, against those of the least sum that there is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, Int32Array
from photogram.surface.ortho.labelling import chosen_labels


def lists(rng: np.random.Generator, rows: int, columns: int) -> tuple[Int32Array, Float32Array]:
    """Draw lists of three out of five photographs, some shorter, sorted by cost."""
    candidate = np.array([rng.permutation(5)[:3] for _ in range(rows * columns)], np.int32).reshape(rows, columns, 3)
    cost = np.sort(rng.uniform(0.0, 1.0, candidate.shape), axis=2).astype(np.float32)
    short = rng.random((rows, columns)) < 0.3
    candidate[short, 2], cost[short, 2] = -1, np.inf
    return candidate, cost


@dataclass(frozen=True)
class Costs:
    """A drawn lattice: lists with their costs, prices of seams, and how much neighbours' candidates differ besides."""

    candidate: Int32Array
    cost: Float32Array
    prices: tuple[Float32Array, Float32Array]
    differ: tuple[ByteArray, ByteArray, float]

    @staticmethod
    def drawn(rng: np.random.Generator, shape: tuple[int, int]) -> Costs:
        candidate, cost = lists(rng, *shape)
        right, below = (rng.uniform(0.0, 0.4, shape).astype(np.float32) for _ in range(2))
        # of two photographs in one place: the same whichever block has which
        table = rng.integers(0, 256, (2, *shape, 5, 5)).astype(np.uint8)
        a, b = np.zeros((2, *shape, 3, 3), np.uint8)
        for i, j, k, n in product(range(shape[0]), range(shape[1]), range(3), range(3)):
            if j + 1 < shape[1]:
                a[i, j, k, n] = table[0, i, j, candidate[i, j, k], candidate[i, j + 1, n]]
            if i + 1 < shape[0]:
                b[i, j, k, n] = table[1, i, j, candidate[i, j, k], candidate[i + 1, j, n]]
        return Costs(candidate, cost, (right, below), (a, b, 0.002))

    def labels(self) -> Int32Array:
        return chosen_labels(self.candidate, self.cost, self.prices, self.differ, 15)

    def energy(self, label: NDArray[Any]) -> float:
        rows, columns = label.shape
        *by, unit = self.differ
        at = np.argmax(self.candidate == label[..., None], axis=2)
        total = float(np.take_along_axis(self.cost, at[..., None], axis=2).sum())
        for i, j in product(range(rows), range(columns)):
            for k, (r, c) in enumerate(((i, j + 1), (i + 1, j))):
                if r < rows and c < columns and label[r, c] != label[i, j]:
                    total += float(self.prices[k][i, j]) + unit * float(by[k][i, j, at[i, j], at[r, c]])
        return total

    def least(self) -> float:
        choices = product(*[[int(n) for n in c if n >= 0] for c in self.candidate.reshape(-1, 3)])
        return min(self.energy(np.array(c).reshape(self.cost.shape[:2])) for c in choices)


@pytest.mark.parametrize("shape", [(1, 6), (6, 1)])
def test_labels_along_a_line_are_the_best_there_are(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(12):
        costs = Costs.drawn(rng, shape)
        assert costs.energy(costs.labels()) == pytest.approx(costs.least(), abs=1e-5)


def test_labels_of_a_grid_are_nearly_the_best_there_are() -> None:
    rng, found, best = np.random.default_rng(6), 0.0, 0.0
    for _ in range(10):
        costs = Costs.drawn(rng, (2, 3))
        label = costs.labels()
        assert np.all((costs.candidate == label[..., None]).any(axis=2))
        found += costs.energy(label)
        best += costs.least()
    assert best <= found + 1e-6
    assert found < 1.02 * best


def test_a_block_that_nothing_sees_has_no_label() -> None:
    costs = Costs.drawn(np.random.default_rng(1), (3, 4))
    costs.candidate[1, 2], costs.cost[1, 2] = -1, np.inf
    assert np.array_equal(costs.labels() < 0, (costs.candidate < 0).all(axis=2))
