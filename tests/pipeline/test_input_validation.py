"""What a check of a project file returns, by the function and by the command."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import ProjectError
from photogram.pipeline.input_validation import check_project
from photogram.project.findings import Finding, Findings

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
