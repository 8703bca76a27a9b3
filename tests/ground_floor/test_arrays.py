"""Numbers grouped by value, against a stable sort; the scatter of numbers; the shapes of a record's arrays."""

from types import SimpleNamespace

import numpy as np
import pytest

from photogram.arrays import check_shapes, grouped, nmad


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


def test_the_scatter_of_a_sample_is_its_standard_deviation_and_that_of_nothing_unknown() -> None:
    sample = np.random.default_rng(3).normal(5.0, 2.0, 10_000)
    sample[:500] += 1000.0
    assert nmad(sample) == pytest.approx(2.0, rel=0.1)
    assert np.isnan(nmad(np.zeros(0)))


def test_a_record_names_the_field_of_another_shape_and_passes_over_what_is_not_there() -> None:
    record = SimpleNamespace(pixel=np.zeros((3, 2)), size_px=np.zeros(4), colour=None)
    check_shapes(record, pixel=(None, 2), colour=(3, 3))
    with pytest.raises(ValueError, match=r"^size_px: shape \(4,\), expected \(3,\)$"):
        check_shapes(record, pixel=(3, 2), size_px=(3,))
