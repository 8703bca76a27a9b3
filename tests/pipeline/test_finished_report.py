"""Pages beside the results of before: made anew where they were, or said why not."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import ReportError
from photogram.files.atomic import replacing
from photogram.pipeline import finished_report
from photogram.pipeline.finished_report import prints_of, products_of, removed_products, renewed_prints
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.store.results_record import recorded, remove_outdated
from photogram.project.project import Project

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


@pytest.fixture
def project(survey: Path, tmp_path: Path) -> Project:
    """A project whose folder of results is empty."""
    return replace(load_project(survey / "project.yaml"), results=tmp_path)


def test_what_new_results_have_removed_is_made_anew(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    printed, view = project.results / "deliverables/report.pdf", project.results / "deliverables/view.html"
    printed.parent.mkdir()
    for path in (printed, view):
        path.write_text("of before")
    before = prints_of(project)
    assert before == ("report.pdf", "view.html")
    made = list[str]()

    def making(path: Path) -> Path:
        made.append(path.name)
        path.write_text("anew")
        return path

    monkeypatch.setattr(finished_report, "print_report", lambda of: making(of.results / "deliverables/report.pdf"))
    monkeypatch.setattr(finished_report, "write_view", lambda results: making(results / "deliverables/view.html"))
    assert renewed_prints(project, before) == []  # somebody changed them: they were kept
    printed.unlink()
    assert renewed_prints(project, before) == [f"{printed}: made anew, of these results."]
    view.unlink()
    assert renewed_prints(project, ["view.html"]) == [f"{view}: made anew, of these results."]
    assert made == ["report.pdf", "view.html"]
    assert renewed_prints(project, ()) == []


def test_what_cannot_be_made_anew_is_said(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: Project) -> Path:
        raise ReportError("no browser is installed: install one")

    monkeypatch.setattr(finished_report, "print_report", refused)
    (said,) = renewed_prints(project, ["report.pdf"])
    assert said.endswith(
        "report.pdf: removed, since it showed earlier results, and not made anew: no browser is installed: install one"
    )
    assert prints_of(project) == ()


def test_products_that_new_results_remove_are_said(project: Project) -> None:
    results = project.results
    with recorded(results):
        for name in ("deliverables/dsm.tif", "deliverables/survey.dxf", "deliverables/view.html"):
            (results / name).parent.mkdir(exist_ok=True)
            with replacing(results / name) as path:
                path.write_text("of before")
    (results / "notes.txt").write_text("somebody's own")
    before = products_of(project)
    assert before == ("deliverables/dsm.tif", "deliverables/survey.dxf")
    assert removed_products(project, before) == []
    remove_outdated(results, ["deliverables/dsm.tif", "deliverables/view.html"])
    assert removed_products(project, before) == [f"{results}: removed survey.dxf, made from earlier results."]


def test_a_language_turns_the_texts_at_once_and_the_pictures_with_the_results(
    adjusted_survey: Path, photogram: Run, edit: Edit
) -> None:
    project, handed_over = adjusted_survey / "project.yaml", adjusted_survey / "results/deliverables"
    english = (handed_over / "report.html").read_text(encoding="utf-8")
    edit(project, lambda values: values.setdefault("report", {}).update(language="de"))
    said = photogram("report", project)
    assert "pictures are still in English: photogram adjust draws them in German." in said.out
    page = (handed_over / "report.html").read_text(encoding="utf-8")
    assert '<html lang="de">' in page
    assert page.count('" lang="en">') == 3  # of orthophoto, surface and plan
    assert (handed_over / "README.txt").read_text(encoding="utf-8").startswith("Ergebnisse einer photogrammetrischen")
    assert photogram("adjust", project).code == 0
    assert "pictures are still" not in photogram("report", project).out
    drawn = (handed_over / "report.html").read_text(encoding="utf-8")
    assert '" lang="en">' not in drawn
    assert 'alt="Lageplan mit ' in drawn
    edit(project, lambda values: values["report"].pop("language"))
    assert photogram("adjust", project).code == 0
    assert without_times((handed_over / "report.html").read_text(encoding="utf-8")) == without_times(english)


def without_times(page: str) -> str:
    """Return a page without the table of times and memory, which differ from run to run."""
    return re.sub(r'(?s)<section id="computation">.*?</section>|processed \d{4}-\d\d-\d\d', "", page)
