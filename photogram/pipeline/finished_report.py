"""The page of a finished survey, made again or printed."""

from collections.abc import Collection
from pathlib import Path

from photogram.errors import PhotogramError
from photogram.languages.language import Language
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.publishing.report_files import (
    PRINTED,
    VIEW,
    picture_languages,
    print_report,
    remake_report,
)
from photogram.pipeline.store.results_record import read_record
from photogram.pipeline.view import write_view
from photogram.project.project import Project
from photogram.result_files import ResultFolder, result_path
from photogram.wording import some


def prints_of(project: Project) -> tuple[str, ...]:
    """Return which of report.pdf and view.html lie in the folder of results; new results remove them."""
    return tuple(name for name in (PRINTED, VIEW) if result_path(project.results, name).is_file())


def products_of(project: Project) -> tuple[str, ...]:
    """Return which files of photogram, but report.pdf and view.html, lie in the folder of results and in
    its three folders."""
    names = [name for name in sorted(read_record(project.results)) if Path(name).name not in (PRINTED, VIEW)]
    places = ("", *ResultFolder)
    return tuple(n for n in names if n.rpartition("/")[0] in places and (project.results / n).is_file())


def removed_products(project: Project, before: Collection[str]) -> list[str]:
    """Return a sentence on the files that were there ``before`` and that new results have removed, if any."""
    left = {path.name for place in ("", *ResultFolder) for path in (project.results / place).glob("*")}
    gone = [Path(name).name for name in before if Path(name).name not in left]
    return [f"{project.results}: removed {some(gone)}, made from earlier results."] if gone else []


def renewed_prints(project: Project, before: Collection[str]) -> list[str]:
    """Make report.pdf and view.html anew where they were there ``before`` and new results have removed them; returns a
    sentence of each, the reason of one that cannot be made."""
    made, said = {PRINTED: lambda: print_report(project), VIEW: lambda: write_view(project.results)}, list[str]()
    for name in before:
        if result_path(project.results, name).is_file():
            continue
        try:
            said.append(f"{made[name]()}: made anew, of these results.")
        except PhotogramError as error:
            place = result_path(project.results, name)
            said.append(f"{place}: removed, since it showed earlier results, and not made anew: {error}")
    return said


def write_report(project: Path | str, *, photographs: Path | str | None = None, pdf: bool = False) -> tuple[Path, ...]:
    """Write report.html of a finished survey again from report.json, with the names and targets that its project file
    has now; returns its path, and that of report.pdf where ``pdf`` asks for it.

    ``photographs`` is the folder of the photographs in place of the project's. Raises ReportError where there are no
    results yet or no browser can print, ProjectError where the project file is wrong.
    """
    return report_of(load_project(Path(project), None if photographs is None else Path(photographs)), pdf=pdf)


def report_of(project: Project, *, pdf: bool) -> tuple[Path, ...]:
    """Write the report of a project that is loaded, as `write_report` does."""
    page = remake_report(project)
    return (page, print_report(project)) if pdf else (page,)


def labels_of_before(project: Project) -> list[str]:
    """Return a sentence where pictures of the client's part were drawn in another language than it now has."""
    asked = Language(project.report.language)
    drawn = {Language(code) for code in picture_languages(project)} - {asked}
    return [
        f"The labels of the pictures are still in {language.name}: photogram adjust draws them in {asked.name}."
        for language in sorted(drawn, key=lambda language: language.name)
    ]
