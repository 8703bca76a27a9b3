"""photogram report: the page of a finished survey, made again or printed. Arguments only."""

from photogram.terminal.arguments import Pdf, Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file


def report(project: ProjectFile, photographs: Photographs = None, pdf: Pdf = False) -> None:
    """Regenerate report.html from report.json with the current names and targets of the project file."""
    check_project_file(project)
    from photogram.cli.work.report import run

    run(project, photographs, pdf)
