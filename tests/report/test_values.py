"""Values of records of report.json: null where there is no figure, and fields under the names of the result."""

from dataclasses import dataclass
from typing import TypedDict

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.report.values import all_finite, finite, finites, record_of


@dataclass(frozen=True)
class Result:
    name: str
    rmse_m: float
    offset_m: FloatArray
    limits: tuple[float, ...]


class ResultRecord(TypedDict):
    offset_m: list[float | None]
    n: int
    name: str
    rmse_m: float | None
    limits: list[float]


def test_figure_that_is_not_finite_is_null() -> None:
    assert [finite(value) for value in (0.5, float("nan"), float("-inf"))] == [0.5, None, None]
    assert type(finite(np.float64(0.5))) is float
    assert finites(np.array([1.0, np.nan])) == [1.0, None]


def test_figures_belong_together_or_are_null() -> None:
    assert all_finite(np.array([1.0, 2.0])) == [1.0, 2.0]
    assert all_finite(np.array([1.0, np.inf])) is None


def test_record_takes_fields_of_its_names_in_the_order_of_its_type() -> None:
    result = Result("block", float("nan"), np.array([1.0, np.nan]), (2.0, 3.0))
    record = record_of(ResultRecord, result, n=4, name="other")
    assert list(record.items()) == [
        ("offset_m", [1.0, None]),
        ("n", 4),
        ("name", "other"),
        ("rmse_m", None),
        ("limits", [2.0, 3.0]),
    ]
    assert [type(value) for value in record["offset_m"]] == [float, type(None)]


def test_record_takes_every_field_of_its_type_and_no_other() -> None:
    result = Result("block", 1.0, np.zeros(2), ())
    with pytest.raises(TypeError, match="ResultRecord has no count"):
        record_of(ResultRecord, result, n=4, count=4)
    with pytest.raises(AttributeError, match="'n'"):
        record_of(ResultRecord, result)
