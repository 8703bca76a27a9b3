"""Numbers grouped by value, beside a stable sort."""

from __future__ import annotations

import numpy as np

from photogram.arrays import grouped


def test_numbers_are_grouped_as_a_stable_sort_does() -> None:
    number = np.random.default_rng(1).integers(0, 7, 200)
    number[number == 3] = 2  # a number that nothing has
    order, first = grouped(number, 9)
    np.testing.assert_array_equal(order, np.argsort(number, kind="stable"))
    assert first.tolist() == np.searchsorted(np.sort(number), np.arange(10)).tolist()


def test_nothing_is_grouped_into_nothing() -> None:
    order, first = grouped(np.zeros(0, dtype=np.int64), 2)
    assert order.tolist() == []
    assert first.tolist() == [0, 0, 0]
