"""photogram check: validates a project before processing. Arguments only."""

from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file


def check(project: ProjectFile, photographs: Photographs = None) -> None:
    """Validate a project before processing (takes seconds)."""
    check_project_file(project)
    from photogram.cli.work.check import run

    run(project, photographs)
