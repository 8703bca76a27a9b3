"""Roles of ground points written into a project file."""

from pathlib import Path

import pytest

from photogram.errors import ProjectError
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.roles import write_roles
from photogram.survey import Role

TEXT = """photogram: 1
# what follows was written by hand
control_points:
  files:
    - path: points.csv # of Monday
      role: check
  list:
    - {name: "67-1", role: check, position_m: [1, 2, 3], sigma_m: [1, 1, 1]}
    - name: B
      position_m: [1, 2, 3]
      sigma_m: [1, 1, 1]
"""
POINTS = "name,easting,northing,height,sigma,role\n1,10,20,30,0.1,control\nyes,11,21,31,0.1,\n"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "points.csv").write_text(POINTS)
    (tmp_path / "project.yaml").write_text(TEXT)
    return tmp_path / "project.yaml"


def test_a_role_goes_where_its_point_is_named(project: Path) -> None:
    roles: dict[str, Role] = {"67-1": "control", "B": "check", "1": "check", "yes": "control"}
    write_roles(project, roles, lambda _: None)
    text = project.read_text()
    assert '{name: "67-1", role: "control", position_m: [1, 2, 3], sigma_m: [1, 1, 1]}' in text
    assert text.endswith('      sigma_m: [1, 1, 1]\n      role: "check"\n')
    assert '      roles:\n        "1": "check"\n        "yes": "control"\n' in text
    assert [line for line in text.splitlines() if "#" in line] == [line for line in TEXT.splitlines() if "#" in line]


def test_a_point_that_is_not_there_is_named_and_changes_nothing(project: Path) -> None:
    with pytest.raises(ProjectError, match="no ground point 'C'"):
        write_roles(project, {"B": "check", "C": "check"}, lambda _: None)
    assert project.read_text() == TEXT


def test_the_survey_takes_the_roles_and_refuses_those_of_nobody(survey: Path) -> None:
    """Of points in a table, whose own column says otherwise."""
    path = survey / "project.yaml"
    given = load_project(path).control_points[:2]
    place = ["{:.3f},{:.3f},{:.3f}".format(*point.position_map_m) for point in given]
    rows = f"name,easting,northing,height,sigma,role\nT1,{place[0]},0.02,control\nT2,{place[1]},0.02,\n"
    (survey / "table.csv").write_text(rows)
    text = path.read_text()
    head = "control_points:\n"
    assert head in text
    with_table = text.replace(head, f"{head}  files:\n    - {{path: table.csv, role: control}}\n", 1)
    path.write_text(with_table)
    write_roles(path, {"T1": "check"}, load_project)
    roles = {point.name: point.role for point in load_project(path).control_points}
    assert (roles["T1"], roles["T2"]) == ("check", "control")
    path.write_text(with_table.replace("role: control}", "role: control, roles: {T3: check}}"))
    with pytest.raises(ProjectError, match=r"there is no point 'T3' in table\.csv: allowed here: T1, T2"):
        load_project(path)
