"""What a check of a project file returns, by the function and by the command."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from photogram.errors import ProjectError
from photogram.files.clouds.points import write_cloud
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.pipeline import load_project
from photogram.project.findings import Finding, Findings
from photogram.project.measured.measured_survey import control_positions
from photogram.survey import PointCloud

Run = Callable[..., Any]


def test_the_function_finds_what_the_command_prints(survey: Path, photogram: Run) -> None:
    (survey / "photographs/sim_0001.JPG").write_bytes(b"no picture")
    project = survey / "project.yaml"
    outcome, findings = photogram("check", project), check_project(str(project))
    assert outcome.code == 1
    assert not findings.ready
    assert f"{len(findings.errors)} error" in outcome.out
    assert f"{len(findings.warnings)} warning" in outcome.out
    printed = " ".join(outcome.out.replace("│", " ").split())
    for finding in findings:
        assert finding.where.split()[0] in printed
    assert len(findings) == len(findings.errors) + len(findings.warnings) + len(findings.notes)


def test_a_file_with_errors_is_all_said_at_once(survey: Path, photogram: Run) -> None:
    project = survey / "project.yaml"
    project.write_text(project.read_text(encoding="utf-8").replace("photogram: 1", "photogram: 1\nfog: 2"), "utf-8")
    findings = check_project(project)
    assert [f.where for f in findings.errors] == ["project.yaml:2"]
    assert photogram("check", project).code == 1


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="No such file"):
        check_project(tmp_path / "project.yaml")


def test_findings_show_themselves() -> None:
    found = Findings(
        [Finding("error", "a.jpg", "<b>damaged</b>", "copy it"), Finding("note", "survey", "4 photographs")]
    )
    assert repr(found).splitlines() == [
        "<Findings, not ready: 1 error, 0 warnings>",
        "error: a.jpg: <b>damaged</b>: copy it",
        "note: survey: 4 photographs",
    ]
    assert "<td>error</td><td>a.jpg</td><td>&lt;b&gt;damaged&lt;/b&gt;</td><td>copy it</td>" in found._repr_html_()
    assert not found.ready
    assert found.notes.ready
    assert Findings().ready


@pytest.mark.parametrize(
    ("shift_m", "severity", "says"),
    [
        ((20_000.0, 0.0, 0.0), "error", "east of the survey"),
        ((0.0, 0.0, 500.0), "warning", "above the survey: check its height system"),
        ((0.0, 0.0, 0.0), None, ""),
    ],
)
def test_a_reference_far_off_is_seen_from_its_header(
    survey: Path, shift_m: tuple[float, float, float], severity: str | None, says: str
) -> None:
    path = survey / "project.yaml"
    control_m = control_positions(load_project(path))
    write_cloud(survey / "reference.laz", PointCloud(control_m + shift_m), load_project(path).crs)
    values = yaml.safe_load(path.read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump(values | {"comparison": {"reference": "reference.laz"}}), encoding="utf-8")
    found = [f for f in check_project(path) if f.where == "comparison.reference"]
    assert [f.severity for f in found] == ([] if severity is None else [severity])
    assert all(says in str(f) for f in found)
