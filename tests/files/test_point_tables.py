"""Tables of points: what is written is read back as it was."""

from dataclasses import replace
from pathlib import Path

import pytest

from photogram.errors import WorkspaceError
from photogram.files.tables.control_files import read_points
from photogram.files.tables.point_tables import write_point_table
from photogram.files.tables.surveyed_points import SurveyedPoint

POINTS = (
    SurveyedPoint("G 01", (602314.4768000001, 5794093.914699999, -118.7493), (0.01, 0.02, 0.1 + 0.2), line=2),
    SurveyedPoint('pole "north", 2', (1 / 3, 2e6 / 3, 1e-7), (None, None, None), ("control", "check"), line=3),
    SurveyedPoint("#7", (1.0, 2.0, 3.0), (0.5, None, 0.5), ("check", "check"), line=4),
)


def test_points_are_read_back_with_every_digit(tmp_path: Path) -> None:
    write_point_table(tmp_path / "points.csv", POINTS[:2])
    found = read_points(tmp_path / "points.csv")
    assert found.points == POINTS[:2]
    assert found.geographic is False
    assert not found.holds_marks


def test_degrees_are_read_back_as_such(tmp_path: Path) -> None:
    point = SurveyedPoint("A", (8.123456789012345, 50.1, 118.75), (0.01, 0.01, 0.02), ("control", "check"), line=2)
    write_point_table(tmp_path / "points.csv", [point], geographic=True)
    found = read_points(tmp_path / "points.csv")
    assert found.points == (point,)
    assert found.geographic is True


def test_a_name_that_begins_a_comment_is_read_back(tmp_path: Path) -> None:
    write_point_table(tmp_path / "points.csv", [POINTS[2]])
    assert read_points(tmp_path / "points.csv").points == (replace(POINTS[2], line=2),)


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_point_table(tmp_path / "absent" / "points.csv", POINTS)
