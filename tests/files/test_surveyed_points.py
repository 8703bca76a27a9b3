"""Surveyed points and marks: what they may hold."""

import pytest

from photogram.errors import ControlPointError
from photogram.files.tables.surveyed_points import UNSTATED, Mark, MarkSource, SurveyedPoint
from photogram.marking.files.actions import AddPoint


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (SurveyedPoint(" A"), "must be 1 to 255 printable"),
        (SurveyedPoint("A", (0.0, 0.0, float("inf"))), "position of A must be from"),
        (SurveyedPoint("A", None, (0.01, None, -1.0)), r"standard deviations of A \(m\) must be from"),
        (SurveyedPoint("A", crs="\n"), "must be printable"),
    ],
)
def test_a_point_out_of_range_is_refused(point: SurveyedPoint, words: str) -> None:
    with pytest.raises(ControlPointError, match=words):
        point.check()
    with pytest.raises(ControlPointError, match=words):
        AddPoint(point)


def test_an_added_point_has_all_standard_deviations_or_none() -> None:
    for sigma_m in (UNSTATED, (0.01, 0.01, 0.02)):
        assert AddPoint(SurveyedPoint("A", (1.0, 2.0, 3.0), sigma_m)).point.sigma_m == sigma_m
    with pytest.raises(ControlPointError, match="give all three, or none"):
        AddPoint(SurveyedPoint("A", (1.0, 2.0, 3.0), (0.01, None, 0.02)))


def test_marks_are_equal_wherever_they_were_read() -> None:
    mark = Mark("A", "a.jpg", (1.0, 2.0), (0.3, 0.4), source=MarkSource(7))
    assert mark == Mark("A", "a.jpg", (1.0, 2.0), (0.3, 0.4), source=MarkSource(9, is_of_photogram=True))
    assert mark != Mark("A", "a.jpg", (1.0, 2.0), (0.3, 0.4), rho=0.1)
