"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.pipeline.project_file import PROJECT_FILE, project_file

ProjectFile = Annotated[
    Path,
    typer.Argument(
        help="Project file, or the folder of a project.yaml.", default_factory=lambda: PROJECT_FILE,
        show_default="project.yaml", callback=project_file,
    ),
]  # fmt: skip
Photographs = Annotated[
    Path | None,
    typer.Option("--photographs", help="Folder of the photographs; overrides photographs.folder of the project file."),
]
Pdf = Annotated[
    bool, typer.Option("--pdf", help="Also print report.pdf (needs an installed Chromium, Chrome or Edge).")
]
SolutionCrs = Annotated[
    str | None,
    typer.Option("--crs", help="CRS of its ground points and positions, where its files do not say it."),
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print only warnings, errors and the result in one line.")]
AsJson = Annotated[
    bool,
    typer.Option("--json", help="Print events for programs instead: one JSON object per line (see schema events)."),
]
