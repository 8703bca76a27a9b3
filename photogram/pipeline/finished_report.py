"""The page of a finished survey, made again or printed."""

from pathlib import Path

from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.publishing.report_files import print_report, remake_report


def write_report(project: Path | str, *, photographs: Path | str | None = None, pdf: bool = False) -> tuple[Path, ...]:
    """Write report.html of a finished survey again from report.json, with the names and targets that its project file
    has now; returns its path, and that of report.pdf where ``pdf`` asks for it.

    ``photographs`` is the folder of the photographs in place of the project's. Raises ReportError where there are no
    results yet or no browser can print, ProjectError where the project file is wrong.
    """
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    page = remake_report(survey)
    return (page, print_report(survey)) if pdf else (page,)
