"""photogram check: validates a project before processing. Arguments only; the work is in `photogram.cli.work`."""

from __future__ import annotations

from photogram.cli.app import app
from photogram.cli.arguments import Photographs, ProjectFile
from photogram.cli.beforehand import check_project_file


@app.command()
def check(project: ProjectFile, photographs: Photographs = None) -> None:
    """Validate a project before processing (takes seconds)."""
    check_project_file(project)
    from photogram.cli.work.check import run

    run(project, photographs)
