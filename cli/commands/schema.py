"""photogram schema: what the files of results, and a project, may hold. Arguments only."""

from typing import Annotated, Literal

import typer

DocumentName = Literal["report", "events", "project"]


def schema(
    document: Annotated[
        DocumentName,
        typer.Argument(
            help="Document: report, for report.json; events, for a line of --json; project, for project.yaml.",
            show_default=False,
        ),
    ],
) -> None:
    """Print the JSON Schema of report.json, the events of --json or project.yaml: keys, their types and units."""
    from photogram.cli.work.schema import run

    run(document)
