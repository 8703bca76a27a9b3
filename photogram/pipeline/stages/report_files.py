"""The report page on disk: written beside report.json, made again from it, and printed as PDF."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from photogram.crs import crs_title
from photogram.errors import ReportError
from photogram.files.atomic import replacing
from photogram.files.npz_json import file_fingerprint, read_json, write_json
from photogram.pipeline.store.results_record import recorded, remove_made
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.report.figures.page_figures import PageFigure
from photogram.report.numbers.completion import complete
from photogram.report.page import report_page
from photogram.report.printing import print_pdf
from photogram.report.reading import making_of, read_report
from photogram.report.versions import versions

PAGE, PRINTED, NUMBERS, FIGURES, VIEW = "report.html", "report.pdf", "report.json", "figures.json", "view.html"


def run_facts(run: Run, stages: Sequence[str]) -> dict[str, Any]:
    """Return what the run knows of the survey beside its adjustment: days of flight, versions, memory, disbelief."""
    tags = run.notes()
    days = sorted(tag["time"][:10] for tag in tags if tag.get("time"))
    return {
        "survey": {
            "flown_first": days[0] if days else None,
            "flown_last": days[-1] if days else None,
            "crs_name": crs_title(run.project.crs),
        },
        "versions": versions(),
        "peak_memory_bytes": {name: run.workspace.summary(name).get("peak_memory_bytes") for name in stages},
    }


def disbelieved(run: Run) -> dict[str, int]:
    """Return how many attitudes and headings of the gimbal the adjustment did not believe."""
    summary = run.workspace.summary("adjustment")
    return {name: int(summary.get(name, 0)) for name in ("disbelieved_attitudes", "disbelieved_headings")}


def write_report(
    project: Project, numbers: dict[str, Any], figures: Sequence[PageFigure], kept: Path, products: Sequence[str]
) -> list[str]:
    """Complete the numbers, write report.json and report.html, and keep the figures in the folder ``kept``.

    ``products`` are the other files that this run has made in the folder of results: they are listed with size and
    checksum, and what an earlier run has made and this one has not is removed. Returns what was written into the
    folder of results. Raises WorkspaceError where a file cannot be written.
    """
    write_json(kept / FIGURES, [figure.to_json() for figure in figures])
    numbers["processed"] = datetime.now().astimezone().date().isoformat()
    numbers["deliverables"] = deliverables(project.results, products)
    _write(project, complete(numbers, project.report), [figure.to_json() for figure in figures])
    return [NUMBERS, PAGE]


def _write(project: Project, completed: dict[str, Any], figures: Sequence[dict[str, str]]) -> None:
    path = project.results / NUMBERS
    write_json(path, completed)
    # from the file itself, so that the page of today and one made again from it are the same
    page = report_page(read_json(path), figures)
    with replacing(project.results / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")


# ---- what belongs to a result ----------------------------------------------------------------------------------------


def deliverables(results: Path, products: Sequence[str]) -> list[dict[str, Any]]:
    """Return `{file, bytes, sha256}` of files in the folder of results, by name."""
    return [
        {"file": name, "bytes": (results / name).stat().st_size, "sha256": file_fingerprint(results / name)}
        for name in sorted(set(products))
    ]


def discard_prints(results: Path) -> None:
    """Remove report.pdf and view.html, which would outlive the results that they show; not where somebody has changed
    them since, with a signature for example: their report id says what they belong to."""
    remove_made(results, (PRINTED, VIEW))


# ---- made again, and printed -----------------------------------------------------------------------------------------


def remake_report(project: Project) -> Path:
    """Make report.html again from report.json, with what the project now asks of the report; returns its path.

    Figures are those drawn with the results; without their folder the page says that they are left out. Raises
    ReportError where there is no report.json, WorkspaceError where the figures are damaged.
    """
    path, workspace = project.results / NUMBERS, Workspace(project.work)
    if not path.is_file():
        raise ReportError(f"{path}: no results yet: run photogram adjust {project.path} first")
    drawn = read_json(workspace.file("results", FIGURES)) if workspace.stage("results").is_dir() else []
    numbers = read_report(path)
    former = numbers.get("report_id")
    with making_of(path):
        completed = complete(numbers, project.report)
        if completed["report_id"] != former:
            discard_prints(project.results)
        with recorded(project.results):
            _write(project, completed, drawn)
    return project.results / PAGE


def print_report(project: Project) -> Path:
    """Print report.html as report.pdf beside it; returns its path. Raises ReportError where no browser can."""
    page, target = project.results / PAGE, project.results / PRINTED
    with recorded(project.results), replacing(target) as temporary:
        print_pdf(page, temporary)
    return target
