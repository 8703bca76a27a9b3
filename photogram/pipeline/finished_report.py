"""The page of a finished survey, made again or printed."""

from collections.abc import Collection
from pathlib import Path

from photogram.errors import PhotogramError
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.publishing.report_files import PRINTED, VIEW, print_report, remake_report
from photogram.pipeline.store.results_record import read_record
from photogram.pipeline.view import write_view
from photogram.project.project import Project
from photogram.wording import some


def prints_of(project: Project) -> tuple[str, ...]:
    """Return which of report.pdf and view.html lie in the folder of results; new results remove them."""
    return tuple(name for name in (PRINTED, VIEW) if (project.results / name).is_file())


def products_of(project: Project) -> tuple[str, ...]:
    """Return which files of photogram, but report.pdf and view.html, lie in the folder of results itself."""
    names = sorted(set(read_record(project.results)) - {PRINTED, VIEW})
    return tuple(name for name in names if "/" not in name and (project.results / name).is_file())


def removed_products(project: Project, before: Collection[str]) -> list[str]:
    """Return a sentence on the files that were there ``before`` and that new results have removed, if any."""
    gone = [name for name in before if not (project.results / name).exists()]
    return [f"{project.results}: removed {some(gone)}, made from earlier results."] if gone else []


def renewed_prints(project: Project, before: Collection[str]) -> list[str]:
    """Make report.pdf and view.html anew where they were there ``before`` and new results have removed them; returns a
    sentence of each, the reason of one that cannot be made."""
    made, said = {PRINTED: lambda: print_report(project), VIEW: lambda: write_view(project.results)}, list[str]()
    for name in before:
        if (project.results / name).is_file():
            continue
        try:
            said.append(f"{made[name]()}: made anew, of these results.")
        except PhotogramError as error:
            said.append(
                f"{project.results / name}: removed, since it showed earlier results, and not made anew: {error}"
            )
    return said


def write_report(project: Path | str, *, photographs: Path | str | None = None, pdf: bool = False) -> tuple[Path, ...]:
    """Write report.html of a finished survey again from report.json, with the names and targets that its project file
    has now; returns its path, and that of report.pdf where ``pdf`` asks for it.

    ``photographs`` is the folder of the photographs in place of the project's. Raises ReportError where there are no
    results yet or no browser can print, ProjectError where the project file is wrong.
    """
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    page = remake_report(survey)
    return (page, print_report(survey)) if pdf else (page,)
