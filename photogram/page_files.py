"""The report page on disk: written beside report.json, made again from it, and printed as PDF."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from photogram.errors import ReportError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.frames import crs_title
from photogram.project import Project
from photogram.records import Run
from photogram.report.completion import complete
from photogram.report.page import report_page
from photogram.report.page_figures import PageFigure
from photogram.report.printing import print_pdf
from photogram.report.reading import making_of, read_report
from photogram.report.versions import versions
from photogram.workspace import file_fingerprint, read_json, write_json

PAGE, PRINTED, NUMBERS, FIGURES, VIEW = "report.html", "report.pdf", "report.json", "figures.json", "view.html"


def run_facts(run: Run, stages: Sequence[str]) -> dict[str, Any]:
    """Return what the run knows of the survey beside its adjustment: days of flight, versions, memory, disbelief."""
    tags = read_json(run.workspace.stage("photographs") / "tags.json")
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
    discard_undelivered(project.results, products)
    numbers["processed"] = datetime.now().astimezone().date().isoformat()
    numbers["deliverables"] = deliverables(project.results, products)
    _write(project, numbers, [figure.to_json() for figure in figures])
    return [NUMBERS, PAGE]


def _write(project: Project, numbers: dict[str, Any], figures: Sequence[dict[str, str]]) -> None:
    path = project.results / NUMBERS
    completed = complete(numbers, project.report)
    if _recorded(path).get("report_id") != completed["report_id"]:
        discard_prints(project.results)
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


def _recorded(path: Path) -> dict[str, Any]:
    """Return the report.json of an earlier run, {} where there is none that can be read: it is written anew."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as fault:
        raise WorkspaceError(
            f"{path}: belongs to an earlier result and cannot be removed ({fault.strerror}): remove it"
        ) from fault


def discard_prints(results: Path) -> None:
    """Remove report.pdf and view.html, which would outlive the results that they show."""
    for name in (PRINTED, VIEW):
        _remove(results / name)


def discard_undelivered(results: Path, products: Sequence[str]) -> None:
    """Remove what report.json lists of an earlier run and this one has not made.

    Only where the file is still the one that was listed, by its checksum: a file that somebody has put in its place is
    theirs.
    """
    listed = _recorded(results / NUMBERS).get("deliverables")
    within = results.resolve()
    for entry in listed if isinstance(listed, list) else []:
        name, checksum = (entry.get("file"), entry.get("sha256")) if isinstance(entry, dict) else (None, None)
        if not isinstance(name, str) or name in products:
            continue
        path = results / name
        made_here = within in path.resolve().parents and path.is_file() and not path.is_symlink()
        if made_here and file_fingerprint(path) == checksum:
            _remove(path)


# ---- made again, and printed -----------------------------------------------------------------------------------------


def remake_report(project: Project) -> Path:
    """Make report.html again from report.json, with what the project now asks of the report; returns its path.

    Figures are those drawn with the results; without their folder the page says that they are left out. Raises
    ReportError where there is no report.json.
    """
    path, figures = project.results / NUMBERS, project.work / "results" / FIGURES
    if not path.is_file():
        raise ReportError(f"{path}: there are no results yet: run photogram adjust {project.path} first")
    numbers, drawn = read_report(path), read_json(figures) if figures.is_file() else []
    with making_of(path):
        _write(project, numbers, drawn)
    return project.results / PAGE


def print_report(project: Project) -> Path:
    """Print report.html as report.pdf beside it; returns its path. Raises ReportError where no browser can."""
    page, target = project.results / PAGE, project.results / PRINTED
    with replacing(target) as temporary:
        print_pdf(page, temporary)
    return target
