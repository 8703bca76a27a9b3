"""photogram export: an adjusted survey for other programs. Arguments only; the work is in `photogram.cli.work`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from photogram.cli.app import app
from photogram.cli.arguments import Photographs, ProjectFile
from photogram.cli.beforehand import check_project_file

FormatName = Literal[
    "colmap", "colmap-text", "opensfm", "bundler", "metashape", "opf", "omega-phi-kappa", "yaw-pitch-roll",
    "undistorted",
]  # fmt: skip


@app.command()
def export(
    project: ProjectFile,
    form: Annotated[FormatName, typer.Option("--to", help="The program or form it is for.", show_default=False)],
    output: Annotated[Path, typer.Option(help="A new folder or file to write.", show_default=False)],
    photographs: Photographs = None,
) -> None:
    """Write an adjusted survey for another program: cameras, poses, tie points, and what else its files hold."""
    check_project_file(project)
    from photogram.cli.work.exchange.export import run

    run(project, form, output, photographs)
