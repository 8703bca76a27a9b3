"""photogram export: an adjusted survey for other programs. Arguments only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file

FormatName = Literal[
    "colmap", "colmap-text", "opensfm", "bundler", "metashape", "opf", "omega-phi-kappa", "yaw-pitch-roll",
    "undistorted",
]  # fmt: skip


def export(
    project: ProjectFile,
    form: Annotated[FormatName, typer.Option("--to", help="The program or form it is for.", show_default=False)],
    output: Annotated[Path, typer.Option(help="A new folder or file to write.", show_default=False)],
    photographs: Photographs = None,
) -> None:
    """Write an adjusted survey for another program: cameras, poses, tie points, and what else its files hold."""
    check_project_file(project)
    from photogram.exchange.work.export import run

    run(project, form, output, photographs)
