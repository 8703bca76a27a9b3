"""What moved between two runs of a benchmark."""

import numpy as np
import pytest
from lib.moved import moved, numbers
from lib.study import PrintedTable


def table(*rows: str, columns: str = "survey | z | seconds") -> PrintedTable:
    return {"columns": columns.split(" | "), "rows": [row.split(" | ") for row in rows]}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.18", [(0.18, 0.01)]),
        ("67 94 100 %", [(67.0, 1.0), (94.0, 1.0), (100.0, 1.0)]),
        ("−3.5 to 2e-10", [(-3.5, 0.1), (2e-10, 1e-10)]),
        ("none", []),
    ],
)
def test_numbers_and_their_last_digits(text: str, expected: list[tuple[float, float]]) -> None:
    np.testing.assert_allclose(numbers(text), expected)


def test_the_last_digit_is_rounding_and_more_is_not() -> None:
    before, after = table("a | 1.00 | 3.0", "b | 1.00 | 3.0"), table("a | 1.01 | 3.0", "b | 1.02 | 3.0")
    [change] = moved([before], [after])
    assert (change.place, change.before, change.after) == ("table 1, b, z", "1.00", "1.02")
    assert change.change == pytest.approx(0.02)
    assert change.sentence == "table 1, b, z: 1.00 → 1.02 (+2 %)"


def test_times_scatter_by_a_quarter() -> None:
    before = table("a | 1.00 | 3.0")
    assert moved([before], [table("a | 1.00 | 3.7")]) == []
    assert [m.place for m in moved([before], [table("a | 1.00 | 4.5")])] == ["table 1, a, seconds"]


def test_the_largest_changes_stand_behind_what_has_no_measure() -> None:
    before = table("a | 1.00 | 3.0", "a | 2.00 | 3.0", "old | 1.0 | 1.0")
    after = table("a | 1.10 | 3.0", "a | 4.00 | 3.0", "new | 1.0 | 1.0")
    assert [m.place for m in moved([before], [after])] == [
        "table 1, new", "table 1, old", "table 1, a (2), z", "table 1, a, z",
    ]  # fmt: skip


def test_columns_are_compared_by_their_titles_and_words_count() -> None:
    before = table("a | 1.00 | 3.0 s")
    after = table("a | 5 | 1.00 | 3.0 min", columns="survey | n | z | seconds")
    assert [(m.place, m.before, m.after) for m in moved([before], [after])] == [
        ("table 1, a, n", "no such column", "5"), ("table 1, a, seconds", "3.0 s", "3.0 min"),
    ]  # fmt: skip
    assert [m.place for m in moved([before], [])] == ["tables"]
